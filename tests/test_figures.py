"""Verification: a gif shows every frame, exactly, at its time; a plot shows what its table says.

The frames are drawn by PyBullet here, without any of our code; the tables follow Bullet's law of
one step, `v += dt (-g - k v (1 + |v|)); z += dt v`, beside its closed forms.
"""

from __future__ import annotations

import functools
import io
import itertools
import re
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import polars as pl
import pybullet as p
import pybullet_data
import pytest
from conftest import some
from drop_physics import colours, render, simulate
from drop_physics.errors import ScenarioError
from drop_physics.figures import animation, convergence_plot, style
from drop_physics.figures.animation import check_animation
from drop_physics.figures.gif import Gif, delay_cs, write_gif
from drop_physics.figures.plot import Facts, build_figure, facts_of, plot_drop
from drop_physics.scenario import Scenario
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.transforms import Bbox
from PIL import Image

Pixels = np.ndarray

# -- gif: what comes in ---------------------------------------------------------------------------


def png_of(pixels: Pixels, *, effort: int = 1) -> bytes:
    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, "png", compress_level=effort)
    return stream.getvalue()


@pytest.fixture(scope="module")
def standard_frames() -> list[Pixels]:
    """Return the experiment's 41 pictures, each of shape (360, 480, 3)."""
    client = p.connect(p.DIRECT)
    try:
        p.setAdditionalSearchPath(pybullet_data.getDataPath(), physicsClientId=client)
        p.setGravity(0, 0, -9.81, physicsClientId=client)
        p.loadURDF("plane.urdf", physicsClientId=client)
        p.loadURDF("cube_small.urdf", [0, 0, 1], physicsClientId=client)
        view = p.computeViewMatrixFromYawPitchRoll([0, 0, 0.5], 2.0, 45.0, -25.0, 0.0, 2)
        projection = p.computeProjectionMatrixFOV(60.0, 480 / 360, 0.1, 10.0)
        frames = []
        for step in range(241):
            if step % 6 == 0:
                rgba = p.getCameraImage(
                    480,
                    360,
                    view,
                    projection,
                    renderer=p.ER_TINY_RENDERER,
                    physicsClientId=client,
                )[2]
                frames.append(np.reshape(np.asarray(rgba, np.uint8), (360, 480, 4))[:, :, :3])
            p.stepSimulation(physicsClientId=client)
        return frames
    finally:
        p.disconnect(client)


def coloured(count: int, *, seed: int = 0, size: tuple[int, int] = (40, 30)) -> Pixels:
    """Return a picture with a given number of colours, at random places."""
    rng = np.random.default_rng(seed)
    packed = rng.choice(1 << 24, count, replace=False)
    palette = np.stack([packed >> 16, packed >> 8 & 255, packed & 255], axis=1).astype(np.uint8)
    width, height = size
    indices = np.arange(width * height) % count
    return palette[rng.permutation(indices).reshape(height, width)]


def written(frames: Sequence[Pixels], *, fps: float = 20.0) -> tuple[Gif, bytes]:
    stream = io.BytesIO()
    pictures = animation.decoded(map(png_of, frames))
    return write_gif(pictures, stream, fps=fps), stream.getvalue()


def decoded(gif: bytes) -> tuple[list[Pixels], list[int]]:
    """Return the pictures that a viewer shows, and for how long each [ms]."""
    with Image.open(io.BytesIO(gif)) as image:
        pictures, delays_ms = [], []
        for frame in range(image.n_frames):
            image.seek(frame)
            delays_ms.append(image.info["duration"])
            pictures.append(np.asarray(image.convert("RGB")))
        return pictures, delays_ms


def same(ours: Sequence[Pixels], theirs: Sequence[Pixels]) -> bool:
    return len(ours) == len(theirs) and all(map(np.array_equal, ours, theirs))


# -- gif: what comes out --------------------------------------------------------------------------


@pytest.mark.long
def test_every_recorded_frame_is_in_the_gif_to_the_pixel(standard_frames: list[Pixels]) -> None:
    still = sum(map(np.array_equal, standard_frames, standard_frames[1:]))
    assert still >= 10  # the box is still in the end: other writers merge these
    wrote, gif = written(standard_frames)
    pictures, delays_ms = decoded(gif)
    assert wrote == Gif(frames=41, duration_s=2.05, quantised=0)
    assert same(pictures, standard_frames)
    assert delays_ms == [50] * 41
    with Image.open(io.BytesIO(gif)) as image:
        assert image.info["loop"] == 0  # forever


def test_only_what_changed_is_stored(standard_frames: list[Pixels]) -> None:
    first, *_ = standard_frames
    _, alone = written([first])
    _, fifty = written([first] * 50)
    assert (len(fifty) - len(alone)) / 49 < 32  # bytes for a frame in which nothing changes
    again = io.BytesIO()
    pngs = [png_of(first), png_of(first, effort=9)]
    write_gif(animation.decoded(pngs), again, fps=20)
    assert len(again.getvalue()) - len(alone) < 32  # the same picture in another file
    spot = first.copy()
    spot[100:103, 200:205] = (255, 0, 0)
    with Image.open(io.BytesIO(written([first, spot])[1])) as image:
        image.seek(1)
        assert image.tile[0].extents == (200, 100, 205, 103)


@pytest.mark.parametrize("fps", [20, 24, 30, 50, 12.5, 7, 1, 0.1])
def test_every_frame_starts_at_its_time(fps: float) -> None:
    frames = [coloured(2, seed=seed, size=(4, 3)) for seed in range(31)]
    wrote, gif = written(frames, fps=fps)
    _, delays_ms = decoded(gif)
    starts_ms = [0, *itertools.accumulate(delays_ms)]
    assert starts_ms == [10 * round(100 * frame / fps) for frame in range(32)]
    assert wrote.duration_s == starts_ms[-1] / 1000
    assert delays_ms == [10 * delay_cs(frame, fps=fps) for frame in range(31)]


def test_thirty_frames_per_second_take_turns() -> None:
    assert [delay_cs(frame, fps=30) for frame in range(6)] == [3, 4, 3, 3, 4, 3]


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5, 127, 128, 129, 255, 256])
def test_up_to_256_colours_are_exact(count: int) -> None:
    frame = coloured(count)
    wrote, gif = written([frame])
    assert same(decoded(gif)[0], [frame])
    assert wrote.quantised == 0


def test_new_colours_get_a_palette_of_their_own() -> None:
    frames = [coloured(200, seed=seed) for seed in (1, 2, 2, 1, 3)]  # 600 colours in total
    frames.append(frames[-1].copy())
    frames[-1][3, 4] = (1, 2, 3)
    wrote, gif = written(frames)
    assert same(decoded(gif)[0], frames)
    assert wrote.quantised == 0


def test_colours_one_step_apart_are_told_apart() -> None:
    ramp = np.arange(256, dtype=np.uint8)
    for channel in range(3):
        frame = np.zeros((16, 16, 3), np.uint8)
        frame[:, :, channel] = ramp.reshape(16, 16)
        assert same(decoded(written([frame])[1])[0], [frame])


def test_more_colours_than_a_gif_holds_are_reported_and_close() -> None:
    y, x = np.mgrid[:60, :80]
    gradient = np.stack([4 * y, 3 * x, y + x], axis=2).astype(np.uint8)
    plain = np.full_like(gradient, 200)
    wrote, gif = written([plain, gradient, plain])
    assert wrote.quantised == 1
    pictures, _ = decoded(gif)
    assert same(pictures[::2], [plain, plain])
    off = np.abs(pictures[1].astype(int) - gradient)
    assert off.max() > 0
    assert off.mean() < 8  # of 255; 256 colours for 4800


def test_frames_are_written_as_they_come() -> None:
    """Memory does not grow with the number of frames: each is written before the next is taken."""
    stream = io.BytesIO()
    lengths = []

    def pngs() -> Iterator[bytes]:
        for seed in range(5):
            lengths.append(len(stream.getvalue()))
            yield png_of(coloured(9, seed=seed))

    write_gif(animation.decoded(pngs()), stream, fps=20)
    assert lengths[0] == 0
    assert all(later > sooner for sooner, later in itertools.pairwise(lengths))


def test_transparency_is_not_needed_and_greys_will_do() -> None:
    grey = np.arange(48, dtype=np.uint8).reshape(6, 8)
    assert same(decoded(written([grey])[1])[0], [np.stack([grey] * 3, axis=2)])


@pytest.mark.parametrize("fps", [0, -1, 50.001, 1e9, 0.0001, float("nan"), float("inf")])
def test_a_rate_that_no_gif_can_show_is_refused(fps: float) -> None:
    rule = rf"^fps must be .*, got {re.escape(f'{fps:g}')}; try fps=\d+$"
    with pytest.raises(ScenarioError, match=rule) as refused:
        check_animation(Path("fall.gif"), fps)
    # What it says to try works.
    check_animation(Path("fall.gif"), float(str(refused.value).rpartition("=")[2]))


@pytest.mark.parametrize(
    ("pngs", "message"),
    [
        ([], "at least one frame, got none"),
        ([b"no picture"], "must be a PNG, got frame 0"),
        ([png_of(coloured(2))[:-40]], "must be a PNG, got frame 0"),
        (
            [png_of(coloured(2)), png_of(coloured(2, size=(40, 31)))],
            r"one size, got \(40, 31\) px in frame 1 after \(40, 30\) px",
        ),
    ],
    ids=["none", "not a PNG", "cut short", "two sizes"],
)
def test_frames_that_make_no_gif_are_named(pngs: list[bytes], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        write_gif(animation.decoded(pngs), io.BytesIO(), fps=20)


def test_the_gif_needs_no_plotting_library() -> None:
    code = (
        "import sys, drop_physics.figures.gif; print({'matplotlib', 'polars'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"


# -- plot: what comes in --------------------------------------------------------------------------

DAMPING = float(np.float32(0.04))
TERMS = ("timestep", "damping", "interaction", "rounding")


def table_of(
    *,
    timestep_s: float = 1 / 240,
    steps: int = 240,
    height_m: float = 1.0,
    gravity_m_s2: float = 9.81,
    damping: float = DAMPING,
    floor: bool = True,
    restitution: float = 0.0,
    stepped: bool = True,
) -> pl.DataFrame:
    """Return the table of a drop from rest: Bullet's law, and the closed forms beside it."""
    rest_m = 0.025
    g, k, dt = (gravity_m_s2, damping, timestep_s) if stepped else (0.0, 0.0, timestep_s)
    heights, landed = [height_m], [False]
    z, v = height_m, 0.0
    for _ in range(steps):
        depth = z - rest_m
        v += dt * (-g - k * v * (1 + abs(v)))
        if floor and depth < 0:
            bounce = -restitution * v if v < -0.2 else 0.0
            v = max(v, bounce - 0.08 * depth / dt)
        z += dt * v
        heights.append(z)
        landed.append(landed[-1] or (floor and depth < 0))
    t = np.arange(steps + 1) * dt
    simulated, in_air = np.array(heights), ~np.array(landed)
    free = height_m - g * t**2 / 2
    damped = free
    if g and k:
        w = np.sqrt(g / k + 1 / 4)
        phi = np.arctanh(1 / (2 * w))
        damped = height_m + t / 2 - np.log(np.cosh(k * w * t + phi) / np.cosh(phi)) / k
    timestep = -g * t * dt / 2
    rounding = np.zeros(steps + 1)
    interaction = simulated - free - timestep - (damped - free)
    terms = dict(zip(TERMS, (timestep, damped - free, interaction, rounding), strict=True))
    still = np.abs(simulated - rest_m) < 1e-4
    stops = rest_m if floor else -np.inf
    explained = in_air & (free > stops)
    return pl.DataFrame(
        {
            "step": np.arange(steps + 1),
            "time_s": t,
            "phase": np.where(in_air, "falling", np.where(still, "rest", "contact")),
            "simulated_m": simulated,
            "free_fall_m": np.maximum(free, stops),
            "damped_fall_m": np.maximum(damped, stops),
        }
        | {
            f"{name}_m": [
                v if holds else None for v, holds in zip(values.tolist(), explained, strict=True)
            ]
            for name, values in terms.items()
        }
    ).with_columns(error_m=pl.sum_horizontal(f"{name}_m" for name in TERMS))


def uncovered() -> pl.DataFrame:
    columns = [pl.lit(None, dtype=pl.Float64).alias(f"{name}_m") for name in TERMS]
    return table_of().with_columns(columns)


TABLES = {
    "standard": table_of(),
    "Moon, still in the air": table_of(gravity_m_s2=1.62),
    "no floor": table_of(floor=False),
    "not stepped": table_of(stepped=False),
    "one sample": table_of(steps=0),
    "two samples": table_of(steps=1),
    "0.1 ms": table_of(timestep_s=1e-5, steps=10),
    "20 km": table_of(height_m=20000.0, timestep_s=1 / 60, steps=4000, floor=False),
    "bounces": table_of(restitution=0.8, steps=480),
    "a long, fine run": table_of(timestep_s=1 / 4800, steps=9600),
    "coarse": table_of(timestep_s=0.1, steps=20),
    "starts in the floor": table_of(height_m=0.02),
    "without theory": uncovered(),
}
STANDARD = TABLES["standard"]


def axes_of(figure: Figure) -> dict[str, Axes]:
    main = {str(axes.get_label()): axes for axes in figure.axes}
    return main | {str(axes.get_label()): axes for axes in main["height"].child_axes}


@functools.cache
def panels(name: str) -> dict[str, Axes]:
    """Return the axes of a table's figure by their labels."""
    return axes_of(build_figure(TABLES[name]))


def line(axes: Axes, label: str) -> tuple[np.ndarray, np.ndarray]:
    (curve,) = (curve for curve in axes.lines if curve.get_label() == label)
    return np.asarray(curve.get_xdata()), np.asarray(curve.get_ydata())


def texts(axes: Axes) -> list[str]:
    return [text.get_text() for text in axes.texts]


# -- plot: what comes out -------------------------------------------------------------------------


@pytest.mark.parametrize("name", some(TABLES, 4))
def test_every_drop_can_be_plotted(name: str, tmp_path: Path) -> None:
    path = tmp_path / "plot.png"
    plot_drop(TABLES[name], path, format="png")
    with Image.open(path) as image:
        assert image.size == (1200, 900)
        assert image.convert("RGB").getpixel((0, 0)) == (255, 255, 255)
    assert path.stat().st_size < 100_000


def test_a_plot_for_dark_pages_is_dark() -> None:
    stream = io.BytesIO()
    plot_drop(STANDARD, stream, format="png", dark=True)
    with Image.open(stream) as image:
        assert image.convert("RGB").getpixel((0, 0)) == (13, 17, 23)
    (title, *_) = build_figure(STANDARD, dark=True).texts
    assert title.get_color() == style.DARK.text


@pytest.mark.parametrize("name", ["standard", "Moon, still in the air", "bounces", "20 km"])
def test_no_words_overlap_or_leave_the_page(name: str) -> None:
    figure = build_figure(TABLES[name])
    figure.draw_without_rendering()
    words = [*figure.texts, *figure.legends[0].get_texts()]
    for axes in axes_of(figure).values():
        words += [axes.xaxis.label, axes.yaxis.label, *axes.texts]
        words += [axes.get_title(loc="left") and axes._left_title]
    boxes = [(word, word.get_window_extent()) for word in words if word and word.get_text()]
    for word, box in boxes:
        assert figure.bbox.x0 <= box.x0 <= box.x1 <= figure.bbox.x1, word
    for (word, box), (other, other_box) in itertools.combinations(boxes, 2):
        assert not box.overlaps(other_box), (word, other)


STRIKING = {
    "the impact in the middle": (table_of(gravity_m_s2=1.62, steps=480), None),
    "lands where the rest is told": (table_of(steps=115), Facts("", impact_s=0.448, rest_m=0.025)),
    "bounces where the rest is told": (
        table_of(steps=250, restitution=0.2),
        Facts("", impact_s=0.448, rest_m=0.025),
    ),
    "flies over the impact": (
        table_of().with_columns(pl.col("simulated_m").reverse()),
        Facts("", impact_s=0.97, rest_m=None),
    ),
}
"""Drops in which a curve or the impact's line once ran through words."""


@pytest.mark.parametrize("name", some([*TABLES, *STRIKING], 1))
def test_no_word_is_struck_through(name: str) -> None:
    table, facts = STRIKING[name] if name in STRIKING else (TABLES[name], None)
    figure = build_figure(table, facts)
    figure.draw_without_rendering()
    panels = axes_of(figure)
    words = [*figure.texts, *(text for axes in panels.values() for text in axes.texts)]
    words += [axis.label for axes in panels.values() for axis in (axes.xaxis, axes.yaxis)]
    words += [axes._left_title for axes in panels.values()]
    struck = [
        (text.get_text(), line.get_label())
        for axes in panels.values()
        for line in axes.lines
        for text in words
        if text.get_text() and runs_through(line, text.get_window_extent())
    ]
    assert struck == []


def runs_through(line: Line2D, box: Bbox) -> bool:
    """Whether a curve has a point in a box."""
    path = line.get_transform().transform_path(line.get_path())
    return path.intersects_bbox(box, filled=False)


def test_impact_and_rest_are_labelled_wherever_there_is_room() -> None:
    for name, (table, facts) in STRIKING.items():
        words = " ".join(texts(axes_of(build_figure(table, facts))["height"]))
        assert "impact at" in words, name
        assert ("rests at" in words) == (facts is None or facts.rest_m is not None), name


@pytest.mark.parametrize("floor", [True, False])
def test_beside_a_body_that_nobody_stepped_no_theory_falls(floor: bool) -> None:
    fallen = table_of(floor=floor, steps=240)
    nothing = [pl.lit(None, pl.Float64).alias(f"{name}_m") for name in TERMS]
    table = fallen.with_columns(*nothing, simulated_m=pl.lit(1.0), phase=pl.lit("falling"))
    figure = build_figure(table)
    axes = axes_of(figure)["height"]
    assert [curve.get_label() for curve in axes.lines] == ["simulated"]
    assert [label.get_text() for label in figure.legends[0].get_texts()] == ["simulated"]
    assert axes.get_ylim()[0] == 0
    moved = table.with_columns(simulated_m=1.0 - 1e-6 * pl.col("time_s"))
    assert len(axes_of(build_figure(moved))["height"].lines) == 3


def test_without_weight_theory_stays_where_the_body_does() -> None:
    (above, *_) = build_figure(TABLES["not stepped"]).axes  # its theory has no weight either
    drawn = {str(line.get_label()): np.asarray(line.get_ydata()) for line in above.lines}
    assert drawn.keys() == {"free fall", "damped fall", "simulated"}
    assert all((heights == 1).all() for heights in drawn.values())


@pytest.mark.parametrize(
    ("scenario", "title"),
    [
        (Scenario(), "cube_small.urdf dropped from 1 m"),
        (Scenario(velocity_m_s=(0, 0, 3), height_m=2), "cube_small.urdf thrown from 2 m"),
        (Scenario(velocity_m_s=(-1, 0, 0)), "cube_small.urdf thrown from 1 m"),
        (Scenario(spin_rad_s=(0, 5, 0)), "cube_small.urdf dropped from 1 m"),
        (Scenario(stepped=False, floor=False), "cube_small.urdf dropped from 1 m"),
    ],
    ids=["dropped", "up", "sideways", "spun", "not stepped"],
)
def test_the_title_says_whether_it_was_thrown(
    scenario: Scenario, title: str, tmp_path: Path
) -> None:
    simulate(scenario, tmp_path / "run.rrd", camera=None)
    render(tmp_path / "run.rrd", plot=tmp_path / "run.svg")
    drawn = (tmp_path / "run.svg").read_text()
    assert f">{title}</text>" in drawn
    assert (">free fall</text>" in drawn) == scenario.stepped


@pytest.mark.parametrize("format", ["png", "svg"])
def test_the_same_table_gives_the_same_bytes(format: str) -> None:  # noqa: A002
    streams = io.BytesIO(), io.BytesIO()
    for stream in streams:
        plot_drop(STANDARD, stream, format=format)  # type: ignore[arg-type]
    assert streams[0].getvalue() == streams[1].getvalue()


def test_an_svg_keeps_its_text_as_text_and_no_date() -> None:
    stream = io.BytesIO()
    plot_drop(STANDARD, stream, format="svg", facts=Facts("A & <b> $x$", at_s=0.3))
    svg = stream.getvalue().decode()
    for text in ("time [s]", "−1.820", "timestep", "A &amp; &lt;b&gt; $x$"):
        assert f">{text}</text>" in svg
    assert "dc:date" not in svg
    assert "sans-serif" in svg  # for readers without matplotlib's own font


def test_the_users_own_settings_are_ignored_and_untouched() -> None:
    import matplotlib

    before, plain = io.BytesIO(), io.BytesIO()
    plot_drop(STANDARD, plain, format="png")
    with matplotlib.rc_context({"font.size": 30, "lines.linewidth": 9, "axes.grid": True}):
        plot_drop(STANDARD, before, format="png")
        assert matplotlib.rcParams["font.size"] == 30
    assert before.getvalue() == plain.getvalue()
    assert "matplotlib.pyplot" not in sys.modules


def test_curves_are_the_tables_columns() -> None:
    axes = panels("standard")["height"]
    times, heights = line(axes, "simulated")
    assert np.array_equal(times, STANDARD["time_s"])
    assert np.array_equal(heights, STANDARD["simulated_m"])
    for label, column in (("free fall", "free_fall_m"), ("damped fall", "damped_fall_m")):
        _, theory = line(axes, label)
        assert np.array_equal(theory, STANDARD[column].to_numpy())
        assert theory.min() == 0.025


def test_the_terms_add_up_to_the_line_over_them() -> None:
    axes = panels("standard")["error"]
    explained = STANDARD.drop_nulls("timestep_m")
    times, total = line(axes, "total")
    assert np.array_equal(times, explained["time_s"])
    errors_mm = 1e3 * (explained["simulated_m"] - explained["free_fall_m"]).to_numpy()
    assert total == pytest.approx(errors_mm, abs=1e-12)
    stacked = {}  # height of the stack at the last sample, down and up
    for area in axes.collections:
        name = str(area.get_label())
        if name in TERMS:
            edges = area.get_paths()[0].vertices
            stacked.setdefault(name, []).extend(edges[np.isclose(edges[:, 0], times[-1]), 1])
    last = explained.row(-1, named=True)
    assert min(stacked["timestep"]) == pytest.approx(1e3 * last["timestep_m"])
    assert max(stacked["damping"]) == pytest.approx(1e3 * last["damping_m"])
    top_mm = 1e3 * (last["damping_m"] + last["interaction_m"])
    assert max(stacked["interaction"]) == pytest.approx(top_mm)
    on_damping = max(edge for edge in stacked["interaction"] if edge < top_mm - 1e-9)
    assert on_damping == pytest.approx(1e3 * last["damping_m"])


def test_the_sum_is_written_out_at_the_time_asked_for() -> None:
    written = texts(panels("standard")["error"])
    assert "at 0.3 s, in mm" in written
    sums = ["−6.131", "timestep", "+4.310", "damping", "+0.001", "interaction", "0", "rounding"]
    assert written[1:] == [*sums, "−1.820", "total"]
    earlier = build_figure(STANDARD, Facts("", at_s=0.1))
    assert texts(axes_of(earlier)["error"])[1] == "−2.044"  # -9.81 * 0.1 / 480 m


def test_the_moment_that_is_written_out_is_marked_where_it_is_in_the_stack() -> None:
    """A dot on the total, and a line through the whole stack, from −6.131 to +4.311 mm."""
    axes = panels("standard")["error"]
    row = STANDARD.row(72, named=True)
    (dot, *_) = (
        curve for curve in axes.lines if curve.get_marker() == "o" and len(curve.get_xdata()) == 1
    )
    assert (dot.get_xdata()[0], dot.get_ydata()[0]) == (
        pytest.approx(0.3), pytest.approx(1e3 * (row["simulated_m"] - row["free_fall_m"])),
    )  # fmt: skip
    lines = (
        collection for collection in axes.collections if isinstance(collection, LineCollection)
    )
    segments = (segment for collection in lines for segment in collection.get_segments())
    upright = [segment for segment in segments if segment[0][0] == segment[1][0]]
    (through,) = upright
    top_mm = 1e3 * (row["damping_m"] + row["interaction_m"])
    assert through[:, 0] == pytest.approx(0.3)
    assert through[:, 1] == pytest.approx([1e3 * row["timestep_m"], top_mm])


@pytest.mark.parametrize(("at_s", "shown"), [(0.0, "0 s"), (5.0, "0.4458 s"), (None, "0.4458 s")])
def test_a_time_without_terms_becomes_the_nearest_with(at_s: float | None, shown: str) -> None:
    written = texts(axes_of(build_figure(STANDARD, Facts("", at_s=at_s)))["error"])
    assert written[0] == f"at {shown}, in mm"


def test_impact_and_rest_are_pointed_out() -> None:
    facts = facts_of(STANDARD)
    # Semi-implicit Euler with damping, between samples 107 and 108.
    assert facts.impact_s == pytest.approx(0.44793, abs=1e-5)
    assert facts.rest_m == STANDARD["simulated_m"][-1]
    axes = panels("standard")
    assert texts(axes["height"]) == ["impact at 0.4479 s", "rests at 25.000 mm"]
    for panel in ("height", "error"):
        (dashed,) = (curve for curve in axes[panel].lines if curve.get_linestyle() == "--")
        assert dashed.get_xdata() == [facts.impact_s] * 2
    times, heights = line(axes["impact"], "simulated")
    assert axes["impact"].get_xlabel() == "time from impact [ms]"
    assert axes["impact"].get_ylabel() == "height [mm]"
    assert -4e3 / 240 < times[0] < -3e3 / 240  # shown from four steps before it on
    lowest = int(np.argmin(heights))
    assert heights[lowest] == pytest.approx(16.18, abs=0.01)  # mm
    assert times[lowest] == pytest.approx(1e3 * (108 / 240 - facts.impact_s))  # ms


def test_a_table_alone_tells_what_was_dropped() -> None:
    facts = facts_of(STANDARD)
    assert (facts.title, facts.subtitle) == ("Dropped from 1 m", "240 steps of 1/240 s")
    assert facts_of(TABLES["two samples"]).subtitle == "1 step of 1/240 s"
    assert facts_of(TABLES["coarse"]).subtitle == "20 steps of 1/10 s"
    assert facts_of(TABLES["one sample"]).subtitle == ""
    assert facts_of(table_of(timestep_s=0.003, steps=3)).subtitle == "3 steps of 0.003 s"


def test_without_an_impact_there_is_none() -> None:
    for name in ("Moon, still in the air", "no floor", "not stepped", "one sample"):
        facts = facts_of(TABLES[name])
        assert (facts.impact_s, facts.rest_m) == (None, None)
        assert "impact" not in panels(name)


def test_high_bounces_are_not_covered_by_the_enlargement() -> None:
    assert "impact" not in panels("bounces")
    assert "impact" not in axes_of(build_figure(table_of(restitution=0.6)))  # a third of the fall


def test_in_other_units_curves_marks_and_words_are_in_them() -> None:
    """A short fall from 20 mm above the floor: the time axis and all marks are in ms."""
    table = table_of(height_m=0.025 + 1e-5, timestep_s=1e-5, steps=800, gravity_m_s2=9.81)
    axes = axes_of(build_figure(table))
    impact_ms = 1e3 * (facts_of(table).impact_s or 0)
    assert axes["error"].get_xlabel() == "time [ms]"
    assert texts(axes["height"])[0] == f"impact at {impact_ms:.4g} ms"
    for panel in ("height", "error"):
        (dashed,) = (curve for curve in axes[panel].lines if curve.get_linestyle() == "--")
        assert dashed.get_xdata() == pytest.approx([impact_ms] * 2)
    explained = 1e3 * table.drop_nulls("timestep_m")["time_s"].to_numpy()
    assert line(axes["height"], "simulated")[0] == pytest.approx(1e3 * table["time_s"].to_numpy())
    assert line(axes["error"], "total")[0] == pytest.approx(explained)


@pytest.mark.parametrize(
    ("name", "time", "height", "error"),
    [
        ("standard", "s", "m", "mm"),
        ("not stepped", "s", "m", "mm"),
        ("one sample", "s", "m", "mm"),
        ("0.1 ms", "µs", "m", "nm"),
        ("20 km", "s", "km", "km"),
        ("two samples", "ms", "m", "mm"),
    ],
)
def test_every_axis_has_a_unit_that_fits(name: str, time: str, height: str, error: str) -> None:
    axes = panels(name)
    assert axes["error"].get_xlabel() == f"time [{time}]"
    assert axes["height"].get_ylabel() == f"height of the centre [{height}]"
    assert axes["error"].get_ylabel() == f"simulated − free fall [{error}]"


@pytest.mark.parametrize(
    ("largest", "unit"),
    [(0.0, "m"), (0.0099, "mm"), (0.01, "m"), (9999.0, "m"), (1e4, "km"), (1e-9, "nm"),
     (1e-12, "nm"), (float("inf"), "m")],
)  # fmt: skip
def test_the_usual_unit_is_kept_from_a_hundredth_to_9999_of_it(largest: float, unit: str) -> None:
    assert style.unit_for(largest, style.METRES, usual="m").name == unit


@pytest.mark.parametrize(
    ("largest", "decimals"), [(6.131, 3), (61.31, 2), (613.1, 1), (6131.0, 0), (0.06, 5), (0.0, 0)]
)
def test_the_largest_number_is_shown_with_four_digits(largest: float, decimals: int) -> None:
    assert style.decimals_for(largest) == decimals


@pytest.mark.parametrize(
    ("timestep_s", "shown"),
    [(1 / 240, "1/240 s"), (0.5, "1/2 s"), (1.0, "1 s"), (0.0041, "0.0041 s"), (0.3, "0.3 s")],
)
def test_a_timestep_is_a_fraction_only_where_it_is_that_fraction(
    timestep_s: float, shown: str
) -> None:
    """1/0.0041 is 243.9: near 1/244, but another timestep."""
    assert style.seconds(timestep_s) == shown


def test_errors_of_a_nanometre_have_an_axis_of_their_own() -> None:
    """Rounding errors of 1e-16 m do not: there the axis stays in mm, from −1 to 1."""
    tiny = STANDARD.with_columns(pl.col(f"{name}_m") * 1e-7 for name in TERMS)
    axes = axes_of(build_figure(tiny))["error"]
    assert axes.get_ylabel() == "simulated − free fall [nm]"
    assert line(axes, "total")[1].min() < -0.1
    assert axes.get_ylim() != (-1, 1)


def test_no_error_is_a_flat_line_in_the_middle() -> None:
    axes = panels("not stepped")["error"]
    assert not line(axes, "total")[1].any()
    assert axes.get_ylim() == (-1, 1)


def test_long_runs_are_thinned_but_keep_their_end() -> None:
    table = TABLES["a long, fine run"]
    times, _ = line(panels("a long, fine run")["height"], "simulated")
    assert len(times) == 2000
    assert times[0] == 0
    assert times[-1] == table["time_s"][-1]


def test_one_thing_has_one_colour_in_both_panels() -> None:
    axes = panels("standard")
    curves = {
        "free fall": colours.FREE_FALL,
        "damped fall": colours.DAMPED_FALL,
        "simulated": colours.SIMULATED,
    }
    for panel, (label, colour) in itertools.product(("height", "impact"), curves.items()):
        (drawn,) = (curve for curve in axes[panel].lines if curve.get_label() == label)
        assert drawn.get_color() == colour
    for area in axes["error"].collections:
        if (name := str(area.get_label())) in colours.TERMS:
            assert area.get_facecolor()[0] == pytest.approx(to_rgba(colours.TERMS[name], 0.75))
    squares = [curve.get_color() for curve in axes["error"].lines if curve.get_marker() == "s"]
    assert squares == list(colours.TERMS.values())  # in the order of the sum beside them


def test_the_colours_are_those_that_readers_have_learnt() -> None:
    """As in texts, docs and pictures: Okabe and Ito's, and two greys."""
    assert colours.TERMS == {
        "timestep": "#d55e00",  # vermilion
        "damping": "#009e73",  # bluish green
        "interaction": "#cc79a7",  # reddish purple
        "rounding": "#e69f00",  # orange
    }
    assert (colours.SIMULATED, colours.DAMPED_FALL, colours.FREE_FALL) == (
        "#0072b2", "#56b4e9", "#8a8f98",
    )  # fmt: skip
    # Vermilion for what moves, purple for what turns, sky blue for height.
    assert (colours.KINETIC, colours.ROTATION, colours.POTENTIAL) == (
        "#d55e00", "#cc79a7", "#56b4e9",
    )  # fmt: skip


@pytest.mark.parametrize(
    "colour",
    [colours.TOTAL_IN_VIEWER, colours.KINETIC, colours.SIMULATED, *colours.ENGINES.values()],
)
@pytest.mark.parametrize("page", ["#ffffff", "#0d1011"], ids=["light", "dark"])
def test_what_matters_in_the_viewer_is_seen_in_both_of_its_themes(colour: str, page: str) -> None:
    """WCAG 2 requires a contrast of 3 between a line and its background."""

    def luminance(of: str) -> float:
        linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in to_rgba(of)]
        return float(np.dot(linear[:3], (0.2126, 0.7152, 0.0722)))

    dark, light = sorted((luminance(colour), luminance(page)))
    assert (light + 0.05) / (dark + 0.05) > 3


def test_an_empty_table_is_refused() -> None:
    with pytest.raises(ValueError, match="at least one sample"):
        build_figure(STANDARD.clear())


@pytest.mark.parametrize(
    ("value", "decimals", "shown"),
    [
        (0.0, 3, "0"),
        (-6.13125, 3, "−6.131"),
        (4.3102, 3, "+4.310"),
        (-2.8e-13, 3, "−3×10⁻¹³"),
        (6.8e-4, 3, "+0.001"),
        (5e-4, 3, "+0.001"),
        (4e-4, 3, "+4×10⁻⁴"),
        (1234.5, 0, "+1234"),
    ],
)
def test_numbers_are_signed_and_never_a_false_zero(value: float, decimals: int, shown: str) -> None:
    assert style.signed(value, decimals) == shown


def test_theory_ends_where_a_bounce_begins() -> None:
    """It does not predict bounces; for a body that stays down it predicts its rest height."""
    tables = (
        (TABLES["bounces"], True),
        (table_of(restitution=0.25), True),  # 6 % of the fall: visible
        (table_of(restitution=0.08), False),  # 0.6 % of it: not visible
        (STANDARD, False),
    )
    for table, ends in tables:
        (above, _) = (axes for axes in build_figure(table).axes if axes.get_label() != "impact")
        drawn = {line.get_label(): line for line in above.get_lines()}
        for curve in ("free fall", "damped fall"):
            assert np.isnan(drawn[curve].get_ydata()).any() == ends
        assert not np.isnan(drawn["simulated"].get_ydata()).any()


def test_a_long_subtitle_takes_two_lines_that_nothing_overlaps() -> None:
    figure = build_figure(STANDARD, Facts(title="t", subtitle=25 * "word "))
    figure.draw_without_rendering()
    (_, subtitle, *_) = figure.texts
    (legend,) = figure.legends
    assert "\n" in subtitle.get_text()
    assert not subtitle.get_window_extent().overlaps(legend.get_window_extent())
    assert subtitle.get_window_extent().x1 < figure.bbox.x1


# -- convergence ----------------------------------------------------------------------------------

STEPS_S = np.array([1 / 240, 1 / 480, 1 / 960])
ERRORS_M = {
    "total": np.array([-1.8e-3, 1.2e-3, 2.8e-3]),
    "timestep": -1.4715 * STEPS_S,
    "damping": np.full(3, 4.3e-3),
    "interaction": np.array([7e-7, 5e-7, 3e-7]),
    "rounding": np.array([3e-16, 5e-16, 4e-16]),
}


def study(count: int = 1) -> Figure:
    shown = [convergence_plot.Panel(f"{n}", STEPS_S, ERRORS_M, 1 / 341) for n in range(count)]
    return convergence_plot.build_figure(shown, title="t", ink=style.LIGHT)


def test_errors_are_drawn_in_millimetres_over_the_timestep_in_seconds() -> None:
    """Their absolute values; finer timesteps are to the right."""
    (axes,) = study().axes
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("timestep [s]", "|error| [mm]")
    for name in ("total", "timestep", "damping", "interaction"):
        times, errors = line(axes, name)
        assert np.array_equal(times, STEPS_S)
        assert errors == pytest.approx(1e3 * np.abs(ERRORS_M[name]))
    left, right = axes.get_xlim()
    assert left > STEPS_S[0] > STEPS_S[-1] > right
    axes.figure.draw_without_rendering()
    assert [label.get_text() for label in axes.get_xticklabels()] == ["1/240", "1/480", "1/960"]
    assert "rounding at most 5×10⁻¹³ mm" in texts(axes)


def test_each_error_has_its_colour_and_its_name_where_it_ends() -> None:
    (axes,) = study().axes
    inks = {"total": style.LIGHT.text} | colours.TERMS
    drawn = {str(curve.get_label()): curve.get_color() for curve in axes.lines}
    names = {label.get_text(): label for label in axes.texts if label.get_text() in inks}
    low, high = np.log10(axes.get_ylim())
    for name in ("total", "timestep", "damping", "interaction"):
        assert (drawn[name], names[name].get_color()) == (inks[name], inks[name])
        end = (np.log10(1e3 * abs(ERRORS_M[name][-1])) - low) / (high - low)
        # Names that would overlap, those of damping and total, are moved up.
        assert end - 1e-9 <= names[name].xy[1] < end + 0.06


def test_the_total_dips_where_timestep_and_damping_cancel() -> None:
    """4.3 mm = 1.4715 m/s × dt at 1/342 s; the mark is at the study's timestep, here 1/341 s."""
    (axes,) = study().axes
    (times, total) = next(curve.get_data() for curve in axes.lines if len(curve.get_xdata()) > 100)
    assert times[np.argmin(total)] == pytest.approx(4.3e-3 / 1.4715, rel=2e-3)
    assert total == pytest.approx(1e3 * np.abs(4.3e-3 - 1.4715 * np.asarray(times)))
    (mark,) = (curve for curve in axes.lines if list(curve.get_ydata()) == [0, 1])
    assert list(mark.get_xdata()) == [1 / 341] * 2
    (label,) = (label for label in axes.texts if "cancel" in label.get_text())
    assert label.get_text().endswith("cancel at 1/341 s")
    assert label.xy[0] == 1 / 341
    axes.get_figure().draw_without_rendering()
    assert label.get_bbox_patch() is not None  # it hides what is below: not the total
    dip = axes.transData.transform(np.column_stack([times, total]))
    hidden = label.get_bbox_patch().get_window_extent()
    half = 3 / 2 * 150 / 72  # of the total's width [px]
    assert not any(hidden.contains(x + half, y) for x, y in dip)


@pytest.mark.parametrize(
    ("count", "words"),
    [(4, "first order"), (5, "; 1 more panel not shown"), (7, "; 3 more panels")],
)
def test_panels_for_which_there_is_no_room_are_counted(count: int, words: str) -> None:
    figure = study(count)
    assert len(figure.axes) == 4
    assert words in figure.texts[1].get_text()
    assert ("not shown" in figure.texts[1].get_text()) == (count > 4)


def test_one_timestep_is_not_a_convergence_study() -> None:
    with pytest.raises(ScenarioError, match="needs two or more, got 1"):
        convergence_plot.check_plot(Path("errors.png"), timesteps=1, engines=False)
    convergence_plot.check_plot(Path("errors.svg"), timesteps=2, engines=False)
