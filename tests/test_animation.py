"""Verification: an animation shows the right frames at the right time, in every format.

The files are decoded again, by Pillow and PyAV, and compared with the recording's own frames.
"""

from __future__ import annotations

import io
import itertools
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import Drop, some
from drop_physics.errors import DropError, ScenarioError
from drop_physics.figures import animation, composition
from drop_physics.figures.animation import check_animation, write_animation
from drop_physics.figures.composition import caption
from drop_physics.figures.growing_plot import GrowingPlot
from drop_physics.figures.playback import Animation, playback
from drop_physics.recording.frames import frames
from drop_physics.recording.reader import read
from drop_physics.stages.panels import plot_of
from drop_physics.stages.render import render
from drop_physics.stages.run import Run
from PIL import Image

Pixels = np.ndarray


def shown(path: Path) -> tuple[list[Pixels], list[float]]:
    """Return the images that a viewer shows, and when each starts [s], with the end time last."""
    if path.suffix == ".mp4":
        import av

        with av.open(str(path)) as film:
            pictures = list(film.decode(video=0))
            begins = [float(frame.time) for frame in pictures]
            step = begins[1] - begins[0]
            return [picture.to_ndarray(format="rgb24") for picture in pictures], [
                *begins,
                begins[-1] + step,
            ]
    pictures, delays = [], []
    with Image.open(path) as image:
        for number in range(image.n_frames):
            image.seek(number)
            image.load()
            delays.append(image.info["duration"] / 1000)
            pictures.append(np.asarray(image.convert("RGB")))
    return pictures, [0.0, *itertools.accumulate(delays)]


@pytest.fixture(scope="module")
def recorded(standard: Run) -> list[Pixels]:
    pngs = (png for _, png in frames(read(standard.simulation.recording)))
    return [np.asarray(image) for image in animation.decoded(pngs)]


# -- which frames, and when -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("wanted", "fps", "speed", "shown_frames"),
    [
        ({}, 20.0, 0.5, range(41)),
        ({"fps": 30.0}, 30.0, 0.75, range(41)),
        ({"speed": 1.0}, 40.0, 1.0, range(41)),
        ({"speed": 0.25}, 10.0, 0.25, range(41)),
        ({"speed": 2.0}, 50.0, 2.0, None),  # 80 frames a second are more than a gif shows
        ({"speed": 1.0, "fps": 20.0}, 20.0, 1.0, range(0, 41, 2)),
        ({"speed": 0.25, "fps": 20.0}, 20.0, 0.25, None),  # each twice
    ],
)
def test_speed_and_rate_decide_what_is_shown(
    wanted: dict[str, float], fps: float, speed: float, shown_frames: range | None
) -> None:
    played = playback(Animation(**wanted), 41, 6 / 240, most_fps=50)
    assert (played.fps, played.speed) == pytest.approx((fps, speed))
    if shown_frames is not None:
        assert played.frames == list(shown_frames)
    # Each picture is the recorded frame nearest to its time, from the first to the last.
    simulated_s = np.array(played.frames) / 40
    wanted_s = np.arange(len(played.frames)) / played.fps * played.speed
    assert np.abs(simulated_s - wanted_s).max() <= 0.5 / 40 + 1e-12
    assert played.frames[0] == 0
    assert 1 - simulated_s[-1] < played.speed / played.fps


@pytest.mark.parametrize("speed", [0.0, -1.0, float("nan"), float("inf")])
def test_a_speed_is_above_zero(speed: float) -> None:
    with pytest.raises(ScenarioError, match="speed must be above 0"):
        Animation(speed=speed)


@pytest.mark.parametrize(("speed", "fps"), [(1e-9, 50.0), (1e-300, 1.0), (5e-324, 20.0)])
def test_no_film_is_endless(speed: float, fps: float) -> None:
    with pytest.raises(ScenarioError, match="at most 100,000 pictures"):
        playback(Animation(speed=speed, fps=fps), 41, 6 / 240, most_fps=50)


def test_a_recording_of_any_length_is_shown_completely() -> None:
    assert len(playback(Animation(speed=1.0, fps=40.0), 200_001, 1 / 40, most_fps=50).frames) == (
        200_001
    )


# -- formats --------------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", some([".gif", ".webp", ".apng"], 1))
@pytest.mark.parametrize(("wanted", "end_s"), some([({"speed": 1.0}, 1.025), ({}, 2.05)], 1))
def test_every_pixel_is_shown_at_its_time(
    standard: Run,
    recorded: list[Pixels],
    tmp_path: Path,
    suffix: str,
    wanted: dict[str, float],
    end_s: float,
) -> None:
    path = tmp_path / f"fall{suffix}"
    rendering = render(
        standard.simulation.recording,
        out=path,
        animation=Animation(**wanted),
        plot=tmp_path / "p.png",
    )
    assert (rendering.gif, rendering.frames) == (path, 41)
    pictures, begins = shown(path)
    assert begins[-1] == pytest.approx(end_s, abs=0.006)
    for number in (0, 1, 7, 18, 39, 40):
        middle_s = (number + 0.5) / rendering.fps
        at = int(np.searchsorted(begins[:-1], middle_s, side="right")) - 1
        assert np.array_equal(pictures[at], recorded[number])
    with Image.open(path) as image:
        assert image.info["loop"] == 0  # forever


@pytest.mark.parametrize("suffix", [".webp", ".apng"])
def test_every_picture_begins_to_the_millisecond(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"many{suffix}"
    pictures = [Image.new("RGB", (8, 8), (number, 0, 0)) for number in range(31)]
    with path.open("wb") as file:
        write_animation(pictures, file, suffix=suffix, fps=30)
    begins = shown(path)[1]
    assert begins == pytest.approx([round(1000 * number / 30) / 1000 for number in range(32)])


@pytest.mark.long
@pytest.mark.needs("av")
def test_a_film_has_every_frame_in_nearly_its_colours(
    standard: Run, recorded: list[Pixels], tmp_path: Path
) -> None:
    path = tmp_path / "fall.mp4"
    render(
        standard.simulation.recording,
        out=path,
        animation=Animation(speed=1.0),
        plot=tmp_path / "p.png",
    )
    pictures, begins = shown(path)
    assert len(pictures) == 41
    assert begins == pytest.approx([number / 40 for number in range(42)], abs=1e-4)
    for picture, own in zip(pictures, recorded, strict=True):
        assert np.abs(picture.astype(int) - own).mean() < 4  # of 255


@pytest.mark.needs("av")
def test_a_film_of_odd_size_is_padded() -> None:
    stream = io.BytesIO()
    write_animation([Image.new("RGB", (33, 21), "red")] * 3, stream, suffix=".mp4", fps=10)
    import av

    stream.seek(0)
    with av.open(stream) as film:
        (first, *others) = film.decode(video=0)
    assert (first.width, first.height, len(others)) == (34, 22, 2)


@pytest.mark.parametrize(
    "suffix", [".gif", ".webp", ".apng", pytest.param(".mp4", marks=pytest.mark.needs("av"))]
)
def test_no_frames_make_no_animation(suffix: str) -> None:
    with pytest.raises(ValueError, match="at least one frame"):
        write_animation([], io.BytesIO(), suffix=suffix, fps=20)


@pytest.mark.parametrize(
    ("name", "fastest"),
    [
        ("a.gif", 50.0),
        ("a.webp", 1000.0),
        ("a.apng", 1000.0),
        pytest.param("a.mp4", 240.0, marks=pytest.mark.needs("av")),
    ],
)
def test_a_format_plays_up_to_its_fastest_rate(name: str, fastest: float) -> None:
    check_animation(Path(name), fastest)
    with pytest.raises(ScenarioError, match=f"at most {fastest:g} in a {Path(name).suffix}"):
        check_animation(Path(name), fastest * 1.001)


@pytest.mark.parametrize("name", ["fall.png", "fall.avi", "fall"])
def test_a_format_is_named_by_its_suffix(name: str) -> None:
    with pytest.raises(ScenarioError, match=r"^out must end in .gif, .webp, .apng or .mp4, got"):
        check_animation(Path(name), None)


def test_a_film_without_pyav_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    with pytest.raises(DropError, match=r"pip install av"):
        check_animation(Path("fall.mp4"), None)


# -- beside the frames ----------------------------------------------------------------------------


def test_the_caption_says_time_height_and_error() -> None:
    assert caption(0.3, 0.55672969, -0.0018203) == "t 0.300 s  height 0.5567 m  error  −1.820 mm"
    assert caption(1, 0.025, 0.0089, ended=True).endswith("m  last error  +8.900 mm")


def test_caption_and_plot_are_those_of_the_step_that_is_shown(
    standard: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    """After the last error value in the plot, the caption keeps showing it."""
    captioned: list[tuple[float, ...]] = []

    def noted(*values: float, ended: bool) -> str:
        captioned.append((*values, ended))
        return caption(*values, ended=ended)

    monkeypatch.setattr(composition, "caption", noted)
    table, picture = standard.analysis.table, Image.new("RGB", (240, 180), "white")
    story = plot_of(standard.analysis)
    captions = composition.Captions(table)
    both = composition.Composition(picture.size, story, captions, dark=False)
    plot = GrowingPlot(story, picture.size, dark=False)
    for step in (0, 72, 107, 108, 240):
        whole = both.composed(picture, step / 240)
        row, error_m = table.row(step, named=True), table["error_m"][min(step, 107)]
        assert captioned.pop() == (row["time_s"], row["simulated_m"], error_m, step > 107)
        beside = np.asarray(whole)[:180, 240:]
        assert np.array_equal(beside, np.asarray(plot.at(row["time_s"])))


@pytest.mark.long
def test_the_camera_picture_stays_itself(
    standard: Run, recorded: list[Pixels], tmp_path: Path
) -> None:
    """The image is unchanged to the pixel, even in a GIF: plot and caption leave enough colours."""
    path = tmp_path / "fall.gif"
    render(
        standard.simulation.recording,
        out=path,
        animation=Animation(with_plot=True),
        plot=tmp_path / "p.png",
    )
    pictures, _ = shown(path)
    assert len(pictures) == 41
    for picture, own in zip(pictures, recorded, strict=True):
        assert picture.shape[1] == 2 * 480
        assert np.array_equal(picture[:360, :480], own)
    captions = {picture[360:, :480].tobytes() for picture in pictures}
    assert len(captions) == 41  # each moment has its own


def test_the_plot_grows_with_time(standard: Run) -> None:
    plot = GrowingPlot(plot_of(standard.analysis), (480, 360), dark=False)
    ends = [np.asarray(plot.at(time_s)).astype(int) for time_s in (0.0, 0.2, 0.4, 1.0)]
    blank, *_, whole = ends
    columns = [np.flatnonzero((end != blank).any(axis=(0, 2))) for end in ends[1:]]
    reached = [int(changed.max()) for changed in columns]
    assert reached == sorted(reached)
    per_s = (reached[2] - reached[0]) / 0.8
    assert reached[1] - reached[0] == pytest.approx(0.2 * per_s, abs=2)
    for end, now in zip(ends[1:3], reached[:2], strict=True):
        # Up to the current time it equals the whole plot, after it the empty one.
        assert np.array_equal(end[:, :now], whole[:, :now])
        assert np.array_equal(end[:, now + 1 :], blank[:, now + 1 :])


def test_a_caption_needs_no_plot(standard: Run) -> None:
    picture = Image.new("RGB", (480, 360), "white")
    captions = composition.Captions(standard.analysis.table)
    bare = composition.Composition(picture.size, None, captions, dark=False)
    start, later = (bare.composed(picture, time_s) for time_s in (0.0, 0.3))
    assert start.width == 480
    assert start.height > 360
    assert start.tobytes() != later.tobytes()


@pytest.mark.long
def test_the_command_line_says_how_fast_it_plays(drop: Drop, standard: Run) -> None:
    run = str(standard.simulation.recording)
    options = ("--speed", "0.25", "--caption", "--out", "slow.webp", "--plot", "p.svg")
    done = drop("render", run, *options)
    assert "slow.webp   41 frames, 4.10 s, 4 times slower" in done.stdout
    printed = json.loads(drop("render", run, *options, "--force", "--json").stdout)
    assert printed == {"gif": "slow.webp", "frames": 41, "fps": 10.0, "plot": "p.svg"}


def test_frames_alone_need_no_plotting_library() -> None:
    code = (
        "import sys, drop_physics.figures.animation; print({'matplotlib', 'av'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"
