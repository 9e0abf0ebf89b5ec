"""Verification: a GIF shows every frame exactly and at its time; a plot shows the given data.

The frames are drawn by PyBullet here, without any of our code.
"""

from __future__ import annotations

import io
import itertools
import re
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pybullet as p
import pybullet_data
import pytest
from conftest import some
from drop_physics import colours
from drop_physics.errors import ScenarioError
from drop_physics.figures import animation, style
from drop_physics.figures.animation import check_animation
from drop_physics.figures.gif import delay_cs, write_gif
from drop_physics.figures.panel_plot import build_figure, render
from drop_physics.figures.plot import Curve, Panel, Plot
from drop_physics.figures.theme import LIGHT
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from PIL import Image

Pixels = np.ndarray

# -- gif: what comes in ---------------------------------------------------------------------------


def png_of(pixels: Pixels, *, effort: int = 1) -> bytes:
    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, "png", compress_level=effort)
    return stream.getvalue()


@pytest.fixture(scope="module")
def standard_frames() -> list[Pixels]:
    """Return the 41 frames of the standard experiment, each of shape (360, 480, 3)."""
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
    """Return an image with a given number of colours, at random pixels."""
    rng = np.random.default_rng(seed)
    packed = rng.choice(1 << 24, count, replace=False)
    palette = np.stack([packed >> 16, packed >> 8 & 255, packed & 255], axis=1).astype(np.uint8)
    width, height = size
    indices = np.arange(width * height) % count
    return palette[rng.permutation(indices).reshape(height, width)]


def written(frames: Sequence[Pixels], *, fps: float = 20.0) -> tuple[int, bytes]:
    stream = io.BytesIO()
    pictures = animation.decoded(map(png_of, frames))
    return write_gif(pictures, stream, fps=fps), stream.getvalue()


def decoded(gif: bytes) -> tuple[list[Pixels], list[int]]:
    """Return the images that a viewer shows, and the duration of each [ms]."""
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
    assert wrote == 31
    assert delays_ms == [10 * delay_cs(frame, fps=fps) for frame in range(31)]


def test_thirty_frames_per_second_take_turns() -> None:
    assert [delay_cs(frame, fps=30) for frame in range(6)] == [3, 4, 3, 3, 4, 3]


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5, 127, 128, 129, 255, 256])
def test_up_to_256_colours_are_exact(count: int) -> None:
    frame = coloured(count)
    wrote, gif = written([frame])
    assert same(decoded(gif)[0], [frame])
    assert wrote == 1


def test_new_colours_get_a_palette_of_their_own() -> None:
    frames = [coloured(200, seed=seed) for seed in (1, 2, 2, 1, 3)]  # 600 colours in total
    frames.append(frames[-1].copy())
    frames[-1][3, 4] = (1, 2, 3)
    wrote, gif = written(frames)
    assert same(decoded(gif)[0], frames)
    assert wrote == len(frames)


def test_colours_one_step_apart_are_told_apart() -> None:
    ramp = np.arange(256, dtype=np.uint8)
    for channel in range(3):
        frame = np.zeros((16, 16, 3), np.uint8)
        frame[:, :, channel] = ramp.reshape(16, 16)
        assert same(decoded(written([frame])[1])[0], [frame])


def test_more_colours_than_a_gif_holds_are_close() -> None:
    y, x = np.mgrid[:60, :80]
    gradient = np.stack([4 * y, 3 * x, y + x], axis=2).astype(np.uint8)
    plain = np.full_like(gradient, 200)
    wrote, gif = written([plain, gradient, plain])
    assert wrote == 3
    pictures, _ = decoded(gif)
    assert same(pictures[::2], [plain, plain])
    off = np.abs(pictures[1].astype(int) - gradient)
    assert off.max() > 0
    assert off.mean() < 8  # of 255; 256 colours for 4800


def test_frames_are_written_as_they_come() -> None:
    """Memory does not grow with the number of frames: each is written before the next is read."""
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


# -- plots -----------------------------------------------------------------------------------------


def line(axes: Axes, label: str) -> tuple[np.ndarray, np.ndarray]:
    (curve,) = (curve for curve in axes.lines if curve.get_label() == label)
    return np.asarray(curve.get_xdata()), np.asarray(curve.get_ydata())


def texts(axes: Axes) -> list[str]:
    return [text.get_text() for text in axes.texts]


PLOT = Plot(
    "A & <b> $x$",
    ["what it means"],
    [
        Panel("height", "m", [Curve("box", np.arange(3.0), np.array([0.0, 1.0, 4.0]), "#0072b2")]),
    ],
)


@pytest.mark.parametrize("format", some(["png", "svg"], 1))
def test_the_same_story_gives_the_same_bytes(format: str) -> None:  # noqa: A002
    assert render(PLOT, format, dark=True) == render(PLOT, format, dark=True)


def test_an_svg_keeps_its_text_as_text_and_no_date() -> None:
    svg = render(PLOT, "svg", dark=False).decode()
    for text in ("time [s]", "height [m]", "A &amp; &lt;b&gt; $x$"):
        assert f">{text}</text>" in svg
    assert "dc:date" not in svg
    assert "sans-serif" in svg  # for readers without matplotlib's own font


def test_an_svg_is_xml_whatever_names_hold() -> None:
    named = replace(PLOT.panels[0], title="a\x1b[31m\x00")
    svg = render(replace(PLOT, title="\x07\x1b", panels=[named]), "svg", dark=False)
    texts = [each.text for each in ElementTree.fromstring(svg).iter() if each.text]
    assert {r"\u0007\u001b", r"a\u001b[31m\u0000 [m]"} <= set(texts)


def test_the_users_own_settings_are_ignored_and_untouched() -> None:
    import matplotlib

    plain = render(PLOT, "png", dark=False)
    with matplotlib.rc_context({"font.size": 30, "lines.linewidth": 9, "axes.grid": True}):
        assert render(PLOT, "png", dark=False) == plain
        assert matplotlib.rcParams["font.size"] == 30
    assert "matplotlib.pyplot" not in sys.modules


@pytest.mark.parametrize(("dark", "page"), [(False, (255, 255, 255)), (True, (13, 17, 23))])
def test_the_page_is_light_or_dark(dark: bool, page: tuple[int, int, int]) -> None:
    with Image.open(io.BytesIO(render(PLOT, "png", dark=dark))) as image:
        assert image.convert("RGB").getpixel((0, 0)) == page


@pytest.mark.parametrize(
    ("largest_m", "shown", "factor"),
    [
        (2e-9, "nm", 1e9),
        (5e-3, "mm", 1e3),
        (0.5, "m", 1.0),
        (2e4, "km", 1e-3),
    ],
)
def test_lengths_are_in_the_unit_that_reads_best(
    largest_m: float, shown: str, factor: float
) -> None:
    curve = Curve("box", np.arange(2.0), np.array([0.0, largest_m]), "#0072b2")
    (axes,) = build_figure(Plot("t", [], [Panel("height", "m", [curve])]), LIGHT).axes
    assert axes.get_title(loc="left") == f"height [{shown}]"
    assert axes.lines[0].get_ydata()[-1] == pytest.approx(factor * largest_m)


def test_areas_add_up_to_the_curve_over_them_and_are_inside_the_panel() -> None:
    up, down, both = np.array([1.0, 2.0]), np.array([-3.0, -5.0]), np.array([4.0, -1.0])
    times_s = np.arange(2.0)
    curves = [
        Curve(name, times_s, values, colour)
        for name, values, colour in (
            ("total", up + down + both, ""),
            ("up", up, "#d55e00"),
            ("down", down, "#009e73"),
            ("both", both, "#cc79a7"),
        )
    ]
    story = Plot("t", [], [Panel("error", "J", curves, zero=True, stacked=True)])
    (axes,) = build_figure(story, LIGHT).axes
    reach = np.array([area.get_datalim(axes.transData).intervaly for area in axes.collections])
    assert reach.min() == -6  # -5 and -1, at the end
    assert reach.max() == 5  # 1 and 4, at the start
    low, high = axes.get_ylim()
    assert low < -6 < 5 < high


@pytest.mark.parametrize(
    ("largest", "unit"),
    [
        (0.0, "m"),
        (0.0099, "mm"),
        (0.01, "m"),
        (9999.0, "m"),
        (1e4, "km"),
        (1e-9, "nm"),
        (1e-12, "nm"),
        (float("inf"), "m"),
    ],
)
def test_the_usual_unit_is_kept_from_a_hundredth_to_9999_of_it(largest: float, unit: str) -> None:
    assert style.unit_for(largest, style.METRES, usual="m").name == unit


def test_the_colours_are_those_that_readers_have_learnt() -> None:
    """Texts, docs and images use the palette of Okabe and Ito, and two greys."""
    assert colours.TERMS == {
        "timestep": "#d55e00",  # vermilion
        "damping": "#009e73",  # bluish green
        "interaction": "#cc79a7",  # reddish purple
        "rounding": "#e69f00",  # orange
    }
    assert (colours.SIMULATED, colours.DAMPED_FALL, colours.FREE_FALL) == (
        "#0072b2",
        "#56b4e9",
        "#8a8f98",
    )
    # Vermilion for what moves, purple for what turns, sky blue for height.
    assert (colours.KINETIC, colours.ROTATION, colours.POTENTIAL) == (
        "#d55e00",
        "#cc79a7",
        "#56b4e9",
    )


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
