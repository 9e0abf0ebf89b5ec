"""Render a recording: its frames as a gif, its heights and errors as a plot."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from drop_physics.analysis.drop.analysis import fall_of
from drop_physics.analysis.drop.case import case_seen
from drop_physics.analysis.drop.results import FallAnalysis
from drop_physics.analysis.results import Analysis
from drop_physics.analysis.story import analysis_of
from drop_physics.errors import RecordingError, ScenarioError, check_suffix
from drop_physics.figures.animation import MAX_FPS, check_animation, decoded, write_animation
from drop_physics.figures.gif import MADE_BY_DROP
from drop_physics.figures.playback import EVERY_FRAME, STANDARD_FPS, Animation, Playback, playback
from drop_physics.figures.story import Story
from drop_physics.files.outputs import check_apart, check_kind, check_target
from drop_physics.files.whole import written_whole
from drop_physics.messages import Message
from drop_physics.recording.checks import damaged
from drop_physics.recording.contents import is_script
from drop_physics.recording.reader import Recording, frames, read
from drop_physics.scenario import View
from drop_physics.shown import Shown
from drop_physics.stages.film import film
from drop_physics.stages.telling import story_of
from drop_physics.workers import Worker

if TYPE_CHECKING:
    from PIL import Image

    from drop_physics.figures.composition import Composition
    from drop_physics.recording.falling import Progress  # its module loads Rerun


@dataclass(frozen=True)
class Rendering(Shown, lines_of="drop_physics.console.show_run:rendering_lines"):
    """What was rendered; a path is None where there was nothing to render."""

    gif: Path | None
    """The gif; None without frames."""
    frames: int
    """How many frames it shows; of equal ones in a row WebP and APNG keep the first."""
    fps: float
    """Frames per second."""
    plot: Path | None
    """The plot."""
    speed: float | None
    """Simulated seconds per second of the animation."""


def render(
    recording: Path | str,
    *,
    out: Path | str | None = None,
    animation: Animation = EVERY_FRAME,
    plot: Path | str | None = None,
    dark: bool = False,
    view: View | None = None,
    body: str | None = None,
    force: bool = False,
    progress: Progress = lambda *_: None,
    assistant: Worker | None = None,
) -> Rendering:
    """Make a gif of a recording's frames, and a plot.

    That of a drop shows heights and errors, that of a script what its findings are about.

    Parameters
    ----------
    recording
        The recording to read.
    out
        The `.gif`, `.webp`, `.apng` or `.mp4` file to write; None puts a gif beside the recording
        under the recording's name.
    animation
        How it plays, and what is shown beside the frames.
    plot
        A `.png` or `.svg` file for the plot; None puts a .png beside the recording.
    dark
        Whether plots and captions are for a dark page.
    view, body
        Of a script: the camera that looks at its recorded poses, and the body that it looks at,
        as for `film`.
    force
        Whether existing files may be replaced; a gif and a plot under their default names are
        replaced anyway if drop made them.
    progress
        Called while it runs.
    assistant
        A worker to draw the plot while the gif is written.

    Returns
    -------
    What was written; without a gif if the recording has no frames and `out` is not given.

    Raises
    ------
    RecordingError
        If the recording is missing, damaged, or has no frames although `out` is given.
    ScenarioError
        If the frame rate or speed cannot be shown, or a file has another suffix.
    OutputError
        If a file cannot be written, or would replace what the same command reads or writes.
    DropError
        If PyAV is missing for an .mp4.
    """
    path = Path(recording)
    of_drop = not is_script(path)
    if not of_drop:
        if animation.caption:
            raise ScenarioError("--caption needs a theory, which only a drop has; omit it")
    elif view is not None or body is not None:
        raise ScenarioError(
            "--camera and --body are for recordings of scripts; a drop's frames are taken when it "
            "is recorded, with: drop simulate --camera"
        )
    gif = path.with_suffix(".gif") if out is None else Path(out)
    plotted = path.with_suffix(".png") if plot is None else Path(plot)
    written = [(gif, out, b"GIF8"), (plotted, plot, b"\x89PNG")]
    check_animation(gif, animation.fps)
    check_suffix("--plot", plotted, (".png", ".svg"))
    check_apart([target for target, *_ in written], inputs=[path])
    for target, named, beginning in written:
        check_target(target, force=force or named is None)
        if named is None and not force:
            check_kind(target, beginning, MADE_BY_DROP)

    report = functools.partial(progress, Message("writing {suffix}", suffix=gif.suffix[1:]))
    read_back = read(path)
    analysis: Analysis | FallAnalysis
    if of_drop:
        analysis = fall_of(case_seen(read_back.scenario, read_back.engine, read_back.seen)).analysis
    else:
        ended = {name: (read_back.ended or {}).get(name) for name in ("ended", "error")}
        analysis = analysis_of(read_back.seen, read_back.origin | ended)
    drawing = (story_of(analysis), plotted.suffix[1:], dark)
    if assistant is not None:
        assistant.ask("drop_physics.figures.story_plot:told_story", *drawing)
    beside = drawing[0] if animation.with_plot and drawing[0].panels else None
    pictured, plays = 0, None
    if not isinstance(analysis, FallAnalysis):
        pictured, plays = film(
            read_back, gif, animation=animation, view=view, body=body, dark=dark, story=beside,
            force=force, ours=out is None, report=report,
        )  # fmt: skip
    elif read_back.camera is not None:
        recorded = list(frames(path))
        plays = _played(read_back, len(recorded), animation, gif)
        composition = None
        if animation.caption or animation.with_plot:
            from drop_physics.figures.composition import Composition  # loads matplotlib

            size_px = read_back.camera.size_px
            composition = Composition(analysis.table, size_px, beside, dark=dark)
        pictures = _pictures(recorded, plays, composition, report)
        with written_whole(gif, force=force, ours=out is None) as file, _refused(path):
            pictured = write_animation(pictures, file, suffix=gif.suffix, fps=plays.fps)
    elif out is not None:
        raise RecordingError(
            "{path} has no frames to make {gif} from; record it without --no-camera",
            path=path,
            gif=gif,
        )
    with written_whole(plotted, force=force, ours=plot is None) as file:
        file.write(_plot(*drawing) if assistant is None else assistant.answer())
    return Rendering(
        gif=gif if pictured else None,
        frames=pictured,
        fps=plays.fps if plays else animation.fps or STANDARD_FPS,
        plot=plotted,
        speed=plays.speed if plays else None,
    )


def plot_of(analysis: Analysis | FallAnalysis, *, dark: bool = False) -> bytes:
    """Return the plot of an analysis as PNG, as `render` draws it."""
    return _plot(story_of(analysis), "png", dark)


def _plot(story: Story, format: str, dark: bool) -> bytes:  # noqa: A002
    from drop_physics.figures.story_plot import told_story  # loads matplotlib

    return told_story(story, format, dark=dark)


@contextmanager
def _refused(path: Path) -> Iterator[None]:
    """Report frames that are not pictures as damage of the recording."""
    try:
        yield
    except ValueError as error:
        raise damaged(path, error.args[0]) from None


def _played(recording: Recording, count: int, animation: Animation, out: Path) -> Playback:
    assert recording.camera is not None
    interval_s = recording.camera.capture_every * recording.scenario.timestep_s
    played = playback(animation, max(count, 1), interval_s, most_fps=MAX_FPS[out.suffix])
    check_animation(out, played.fps)
    return played


def _pictures(
    recorded: Sequence[tuple[int, bytes]],
    played: Playback,
    composition: Composition | None,
    report: Callable[[int, int], None],
) -> Iterator[Image.Image]:
    """Yield the animation, picture by picture, and report each one."""
    shown = [recorded[number] for number in played.frames] if recorded else []
    pictures = zip(shown, decoded(png for _, png in shown), strict=True)
    for done, ((step, _), picture) in enumerate(pictures, start=1):
        yield picture if composition is None else composition.composed(picture, step)
        report(done, len(shown))
