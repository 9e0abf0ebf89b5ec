"""Validation: the standard drop gives the published results, bit for bit."""

from __future__ import annotations

import hashlib
import io

import numpy as np
import pytest
from conftest import Recorder, judge, some
from drop_physics.recording.frames import frames
from drop_physics.recording.reader import read
from drop_physics.stages.run import Run
from engine import ROUNDS_ONCE, drive
from PIL import Image

# The law uses only + - × ÷ √, so every bit is reproducible where each of them rounds once.
IN_THE_AIR = 0.0 if ROUNDS_ONCE else 1e-12
# The contact solver's early exit is a discrete branch.
AT_REST = 0.0 if ROUNDS_ONCE else 1e-9


def exactly(value: float, tolerance: float = IN_THE_AIR) -> object:
    return pytest.approx(value, abs=tolerance, rel=0)


@pytest.mark.parametrize(
    ("timestep_s", "linear_damping", "z_03", "printed_m"),
    some(
        [
            (1 / 240, None, 0.5567296523863766, "-0.0018"),
            (1 / 480, None, 0.5597951433403751, "+0.0012"),
            (1 / 960, None, 0.5613277333771846, "+0.0028"),
            (1 / 240, 0.0, 0.5524187499999997, "-0.0061"),
            (1 / 480, 0.0, 0.5554843749999994, "-0.0031"),
            (1 / 960, 0.0, 0.5570171875000008, "-0.0015"),
        ],
        2,
    ),
)
def test_the_articles_table_comes_out_digit_by_digit(
    recorded: Recorder,
    timestep_s: float,
    linear_damping: float | None,
    z_03: float,
    printed_m: str,
) -> None:
    recording = recorded(timestep_s=timestep_s, linear_damping=linear_damping)
    (moment,) = judge(recording, at_s=[0.3]).at
    assert moment.simulated_m == exactly(z_03)
    assert f"{moment.error_m:+.4f}" == printed_m


def test_the_articles_four_figures_are_printed(standard: Run) -> None:
    table, (moment,) = standard.analysis.table, standard.analysis.at
    assert f"{table['simulated_m'][0]:.4f}" == "1.0000"
    assert f"{table['simulated_m'][-1]:.4f}" == "0.0250"
    # 0.55855 exactly: printed as 0.5585 because the nearest double lies below it
    printed = [f"{value:.4f}" for value in (moment.simulated_m, moment.free_fall_m, moment.error_m)]
    assert printed == ["0.5567", "0.5585", "-0.0018"]


@pytest.mark.parametrize(
    ("linear_damping", "v_03", "lowest_m", "lowest_step", "z_1"),
    [
        (None, -2.892568262058582, 0.01618091982485528, 108, 0.024988017444784807),
        (0.0, -2.943000000000005, 0.015934374999998453, 107, 0.02498801945886594),
    ],
)
def test_speed_lowest_point_and_rest_are_the_engines(
    recorded: Recorder,
    linear_damping: float | None,
    v_03: float,
    lowest_m: float,
    lowest_step: int,
    z_1: float,
) -> None:
    recording = recorded(linear_damping=linear_damping)
    impact = judge(recording).impact
    assert impact is not None
    assert recording.states["vz_m_s"][72] == exactly(v_03)
    assert impact.lowest_m == exactly(lowest_m)
    assert impact.lowest_step == lowest_step
    assert recording.states["z_m"][-1] == exactly(z_1, AT_REST)


@pytest.mark.parametrize(
    ("timestep_s", "linear_damping", "z_1"),
    [
        (1 / 480, None, 0.024989520534716106),
        (1 / 960, None, 0.02498965277673074),
        (1 / 480, 0.0, 0.024989520534896992),
        (1 / 960, 0.0, 0.02498965277675301),
    ],
)
def test_rest_at_finer_timesteps_is_the_engines(
    recorded: Recorder, timestep_s: float, linear_damping: float | None, z_1: float
) -> None:
    recording = recorded(timestep_s=timestep_s, linear_damping=linear_damping)
    assert recording.states["z_m"][-1] == exactly(z_1, AT_REST)


@pytest.mark.parametrize(
    ("mistake", "z_1"),
    [
        ({"stepped": False}, 1.0),
        ({"gravity_set": False}, 1.0),
        ({"floor": False}, -3.5783295613954387),
        ({"gravity_m_s2": -1.62}, 0.2056535771354357),
    ],
    ids=["no step", "no gravity", "no floor", "Moon"],
)
def test_the_articles_mistakes_and_the_moon_end_where_it_says(
    recorded: Recorder, mistake: dict[str, float], z_1: float
) -> None:
    heights_m = recorded(**mistake).states["z_m"]
    assert heights_m[-1] == exactly(z_1)
    if z_1 == 1.0:
        assert set(heights_m) == {1.0}


@pytest.mark.parametrize("linear_damping", [None, 0.0])
@pytest.mark.parametrize("timestep_s", [1 / 240, 1 / 480])
def test_every_sample_is_what_pybullet_gives_a_plain_script(
    recorded: Recorder, timestep_s: float, linear_damping: float | None
) -> None:
    recording = recorded(timestep_s=timestep_s, linear_damping=linear_damping)
    expected = drive(
        timestep_s=timestep_s,
        samples=len(recording.states),
        dynamics={} if linear_damping is None else {"linearDamping": linear_damping},
    )
    assert np.array_equal(
        recording.states.select("x_m", "y_m", "z_m").to_numpy(), expected.position_m
    )
    velocity_m_s = recording.states.select("vx_m_s", "vy_m_s", "vz_m_s").to_numpy()
    assert np.array_equal(velocity_m_s, expected.velocity_m_s)


def test_frames_are_pybullets_own_to_the_pixel(standard: Run) -> None:
    expected = drive(picture_every=6).picture_hashes
    actual = {}
    for step, png in frames(read(standard.simulation.recording)):
        pixels = np.asarray(Image.open(io.BytesIO(png)).convert("RGB"))
        assert pixels.shape == (360, 480, 3)
        actual[step] = hashlib.sha256(pixels.tobytes()).hexdigest()
    assert len(actual) == 41
    assert actual == expected
