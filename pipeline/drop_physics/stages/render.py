"""The command `render`: makes a video of a recording's images or poses, and a plot."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from drop_physics.analysis.results import Analysis
from drop_physics.drop.analysis import fall_of
from drop_physics.drop.case import DropCase
from drop_physics.drop.results import FallAnalysis
from drop_physics.engines.cures import call_of
from drop_physics.errors import RecordingError, ScenarioError, check_suffix
from drop_physics.explain.rows import MOST_ROWS
from drop_physics.figures.animation import MAX_FPS, check_animation, write_animation
from drop_physics.figures.gif import MADE_BY_DROP
from drop_physics.figures.playback import EVERY_FRAME, STANDARD_FPS, Animation
from drop_physics.figures.plot import Plot
from drop_physics.files.outputs import check_apart, check_kind, check_target
from drop_physics.files.whole import written_whole
from drop_physics.installed import PYBULLET, is_installed
from drop_physics.messages import Message
from drop_physics.printable import Printable
from drop_physics.recording.contents import is_script
from drop_physics.recording.damage import damaged
from drop_physics.recording.reader import Recording, read
from drop_physics.scenario import View
from drop_physics.stages import verbs
from drop_physics.stages.analyze.sources import Sources
from drop_physics.stages.film import Film, beside_film, frames_film, poses_film
from drop_physics.stages.verbs.taken import takes_those_of
from drop_physics.workers import Worker, cores

if TYPE_CHECKING:
    import polars as pl
    from PIL import Image

    from drop_physics.recording.falling import Progress  # its module loads Rerun
    from drop_physics.rules.choice import Choice


SHORT, SHORT_FPS = 32, 10.0
"""Largest number of frames of a short video, and its frames per second."""
DRAW_PLOT = "drop_physics.figures.panel_plot:render"


@dataclass(frozen=True)
class Rendering(Printable, reported_by="drop_physics.report.run"):
    """The rendered files; a path is None if there was nothing to render."""

    gif: Path | None
    """Path of the animation; None without frames."""
    frames: int
    """Number of frames in the animation; WebP and APNG merge equal consecutive frames."""
    fps: float
    """Frames per second."""
    plot: Path | None
    """Path of the plot."""
    speed: float | None = field(metadata={"json": False})
    """Playback speed: simulated seconds per second."""


@takes_those_of(verbs.RenderArguments)
def render(asked: verbs.RenderArguments) -> Rendering:
    """Write an animation of a recording's frames, and a plot.

    The plot of a drop shows heights and errors, the plot of a script the subjects of its findings.

    Returns
    -------
    The written files; no gif if the recording has no frames and `out` is not given.

    Raises
    ------
    RecordingError
        If the recording is missing, damaged, or has no frames although `out` is given.
    ScenarioError
        If the frame rate or speed is not possible, or a file's suffix is not supported.
    OutputError
        If a file cannot be written, or would replace a file that the same command reads or writes.
    DropError
        If PyAV is missing for an .mp4.
    """
    animation = asked.animation or EVERY_FRAME
    path = Path(asked.recording)
    of_drop = not is_script(path)
    if not of_drop and animation.caption:
        raise ScenarioError("--caption needs a theory, which only a drop has; omit it")
    if of_drop and asked.body is not None:
        raise ScenarioError(
            "--body is for recordings of scripts, and a drop has only one body; omit it"
        )
    gif, plotted = _targets(path, asked.out, asked.plot, animation, force=asked.force)
    held = read(path)
    if of_drop:
        analysis, shown = _of_drop(held, whole=animation.caption or animation.with_plot)
    else:
        analysis, shown = _of_script(held, asked.choice, Sources.of(held, asked.script))
    with ExitStack() as running:
        made = _film(
            held,
            analysis.table if of_drop else None,
            animation,
            MAX_FPS[gif.suffix],
            asked.view,
            asked.body,
            asked.dark,
            _hiring(running, asked.assistant),
            asked=asked.out is not None or asked.view is not None,
        )
        if made is None and asked.out is not None:
            raise RecordingError(
                "{path} has no frames to make {gif} from; record it without --no-camera",
                path=path,
                gif=gif,
            )
        if asked.assistant is not None:  # it has time for that while the gif is written
            asked.assistant.ask(DRAW_PLOT, shown, plotted.suffix[1:], asked.dark)
        asked.meanwhile()
        pictured = 0
        if made is not None:
            check_animation(gif, made.played.fps)
            beside = shown if animation.with_plot and shown.panels else None
            pictures = _composed(
                made, beside, _captions(analysis, animation), asked.dark, asked.progress, gif
            )
            with (
                written_whole(gif, force=asked.force, ours=asked.out is None) as file,
                _refused(path),
            ):
                pictured = write_animation(pictures, file, suffix=gif.suffix, fps=made.played.fps)
    with written_whole(plotted, force=asked.force, ours=asked.plot is None) as file:
        kind = plotted.suffix[1:]
        file.write(
            _drawn(shown, kind, asked.dark) if asked.assistant is None else asked.assistant.answer()
        )
    return Rendering(
        gif=gif if pictured else None,
        frames=pictured,
        fps=made.played.fps if made else animation.fps or STANDARD_FPS,
        plot=plotted,
        speed=made.played.speed if made else None,
    )


def _targets(
    path: Path,
    out: Path | str | None,
    plot: Path | str | None,
    animation: Animation,
    *,
    force: bool,
) -> tuple[Path, Path]:
    """Return the paths of video and plot, after checking that both can be written."""
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
    return gif, plotted


def _of_drop(held: Recording, *, whole: bool) -> tuple[Analysis | FallAnalysis, Plot]:
    """Return a drop's analysis and its plot; with `whole`, the table has all samples."""
    from drop_physics.stages.panels.of_drop import plot_of_drop

    case = DropCase(held.scenario, held.engine, held.seen)
    fall = fall_of(case, whole=whole or case.samples <= MOST_ROWS)
    return fall, plot_of_drop(fall)


def _of_script(
    held: Recording, choice: Choice | None, sources: Sources
) -> tuple[Analysis | FallAnalysis, Plot]:
    """Return the analysis of a script's recording, and its plot."""
    # With all rules, which a drop can do without until its film is being drawn.
    from drop_physics.analysis.story import Story
    from drop_physics.rules.choice import EVERY
    from drop_physics.stages.analyze.explaining import explained
    from drop_physics.stages.panels import plot_of

    given = choice or EVERY
    analysis = Story(
        explained(held).recording.seen,
        held.origin_and_end,
        call_of=call_of(held.seen.engine),
        reports=lambda finding: given.reports(finding, sources.ignored_at(finding.site)),
    ).analysis()
    return analysis, plot_of(analysis)


def _hiring(running: ExitStack, assistant: Worker | None) -> Callable[[int], list[Worker]]:
    """Return a function that starts worker processes; a running one is used as the first."""

    def hire(count: int) -> list[Worker]:
        workers = [] if assistant is None else [assistant]
        while len(workers) < min(count, cores()):
            workers.append(running.enter_context(Worker()))
        return workers

    return hire


def _film(
    held: Recording,
    table: pl.DataFrame | None,
    animation: Animation,
    most_fps: float,
    view: View | None,
    body: str | None,
    dark: bool,
    hire: Callable[[int], list[Worker]],
    *,
    asked: bool,
) -> Film | None:
    """Return a video of the recorded images or, with a camera or without images, of the poses.

    None for a drop without frames, and for an unrequested video that cannot be drawn on this
    machine.
    """
    if view is None and (taken := frames_film(held, animation, most_fps)) is not None:
        return taken
    if (view is None and held.drop is not None) or not (asked or is_installed(PYBULLET)):
        return None
    captioned = held.drop is not None and (animation.caption or animation.with_plot)
    return poses_film(
        held,
        animation,
        most_fps,
        view=view or "standard",
        body=body,
        table=table,
        dark=dark,
        clock=not captioned,
        hire=hire,
    )


def _captions(
    analysis: Analysis | FallAnalysis, animation: Animation
) -> Callable[[float], str] | None:
    if not isinstance(analysis, FallAnalysis) or not (animation.caption or animation.with_plot):
        return None
    from drop_physics.figures.composition import Captions  # loads matplotlib

    return Captions(analysis.table)


def _composed(
    film: Film,
    plot: Plot | None,
    captions: Callable[[float], str] | None,
    dark: bool,
    progress: Progress,
    gif: Path,
) -> Iterator[Image.Image]:
    """Yield the images with caption and plot added, and report progress."""
    composition: Composition | None = None
    words, count = Message("writing {suffix}", suffix=gif.suffix[1:]), len(film.times_s)
    moments = zip(film.pictures, film.times_s, strict=True)
    for done, (picture, time_s) in enumerate(moments, start=1):
        if plot is None and captions is None:
            yield picture
        else:
            from drop_physics.figures.composition import Composition  # loads matplotlib

            composition = composition or Composition(picture.size, plot, captions, dark=dark)
            yield composition.composed(picture, time_s)
        progress(words, done, count)


@dataclass(frozen=True)
class ShortFilm:
    """A video of a few seconds."""

    gif: bytes
    times_s: Sequence[float]
    """Simulated time of each frame [s]."""


def film_of(recording: Path, *, dark: bool = False) -> ShortFilm:
    """Return a short video of a recording's poses, with the colours of a light or dark page.

    Raises
    ------
    RecordingError
        If the recording cannot be read, or has no poses to show.
    """
    held, stream = read(recording), io.BytesIO()
    with ExitStack() as running:
        made = poses_film(
            held,
            Animation(fps=SHORT_FPS),
            SHORT_FPS,
            view="standard",
            body=None,
            table=None,
            most=SHORT,
            dark=dark,
            clock=True,
            hire=_hiring(running, None),
        )
        write_animation(made.pictures, stream, suffix=".gif", fps=SHORT_FPS)
    return ShortFilm(stream.getvalue(), made.times_s)


def check_film(film: Path, *, inputs: Sequence[Path], force: bool) -> None:
    """Check that a video can be written, before any work is done for it.

    Raises
    ------
    ScenarioError
        If the suffix is that of no supported format.
    OutputError
        If the file exists, or is one of the inputs.
    DropError
        If the format needs a library that is not installed.
    """
    check_animation(film, None)
    check_apart([film], inputs=inputs)
    check_target(film, force=force)


def film_beside(
    recording: Path | str,
    other: Path | str,
    out: Path | str,
    *,
    titles: tuple[str, str],
    dark: bool = False,
    force: bool = False,
    progress: Progress = lambda *_: None,
) -> int:
    """Write a video of two runs of a script side by side; return the number of frames.

    Parameters
    ----------
    recording, other
        The recordings of both runs, including entities for display.
    out
        The `.gif`, `.webp`, `.apng` or `.mp4` file to write.
    titles
        The titles above the two images.
    dark, force, progress
        The same as in `render`.

    Raises
    ------
    RecordingError
        If a recording cannot be read, or has no poses to show.
    ScenarioError, OutputError, DropError
        For the reasons of `render`.
    """
    film = Path(out)
    check_film(film, inputs=[Path(recording), Path(other)], force=force)
    with ExitStack() as running:
        made = beside_film(
            read(Path(recording)),
            read(Path(other)),
            titles,
            EVERY_FRAME,
            MAX_FPS[film.suffix],
            dark=dark,
            hire=_hiring(running, None),
        )
        pictures = _composed(made, None, None, dark, progress, film)
        with written_whole(film, force=force) as file:
            return write_animation(pictures, file, suffix=film.suffix, fps=made.played.fps)


def _drawn(plot: Plot, format: str, dark: bool) -> bytes:  # noqa: A002
    from drop_physics.figures import panel_plot  # loads matplotlib

    return panel_plot.render(plot, format, dark)


@contextmanager
def _refused(path: Path) -> Iterator[None]:
    """Convert decoding errors of images into the error for a damaged recording."""
    try:
        yield
    except ValueError as error:
        raise damaged(path, error.args[0]) from None
