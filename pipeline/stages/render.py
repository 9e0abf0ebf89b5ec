"""Turn a recording into pictures: a gif of its frames, and a plot of its heights and errors."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.budget.analysis import analysis_of
from pipeline.budget.results import Analysis
from pipeline.errors import RecordingError, ScenarioError
from pipeline.fields import fraction
from pipeline.figures.facts import Facts
from pipeline.figures.gif import check_fps, write_gif
from pipeline.recording.checks import AGAIN
from pipeline.recording.files import check_target, written_whole
from pipeline.recording.reader import Recording, frames, read
from pipeline.scenario import Scenario
from pipeline.stages.simulate import Progress
from pipeline.workers import Worker


@dataclass(frozen=True)
class Rendering:
    """What was rendered; a path is None where there was nothing to render."""

    gif: Path | None
    """The gif; None where there are no frames."""
    frames: int
    """How many frames it has."""
    fps: float
    """How many it shows per second."""
    plot: Path
    """The plot."""


def render(
    recording: Path | str,
    *,
    out: Path | str | None = None,
    fps: float = 20.0,
    plot: Path | str | None = None,
    force: bool = False,
    progress: Progress = lambda *_: None,
    assistant: Worker | None = None,
) -> Rendering:
    """Make a gif of a recording's frames, and a plot of its heights and errors.

    Parameters
    ----------
    recording
        The recording to read.
    out
        The gif to write; None puts it beside the recording under the recording's name.
    fps
        Frames per second of the gif, at most 50.
    plot
        A `.png` or `.svg` file for the plot; None puts a .png beside the recording.
    force
        Whether files named here may be replaced; those under their own names always are.
    progress
        Called while it runs.
    assistant
        A worker to draw the plot while the gif is written.

    Returns
    -------
    What was written; without a gif where the recording has no frames and none was asked for.

    Raises
    ------
    RecordingError
        If the recording is missing, damaged, or has no frames while a gif is asked for by name.
    ScenarioError
        If the frame rate cannot be shown, or a file has another suffix.
    OutputError
        If a file cannot be written.
    """
    path = Path(recording)
    gif = path.with_suffix(".gif") if out is None else Path(out)
    plotted = path.with_suffix(".png") if plot is None else Path(plot)
    _check_suffix("--out", gif, (".gif",))
    _check_suffix("--plot", plotted, (".png", ".svg"))
    check_fps(fps)
    check_target(gif, force=force or out is None)
    check_target(plotted, force=force or plot is None)

    read_back = read(path)
    analysis = analysis_of(read_back.scenario, read_back.engine, read_back.states)
    drawing = (analysis.table, plotted.suffix[1:], _facts(read_back.scenario, analysis))
    if assistant is not None:
        assistant.ask("pipeline.figures.plot:plotted", *drawing)
    count = 0
    if read_back.camera is not None:
        pngs = _reported(path, read_back, progress)
        with written_whole(gif, force=force or out is None) as file, _refused(path):
            count = write_gif(pngs, file, fps=fps).frames
    elif out is not None:
        raise RecordingError(
            f"{path} has no frames to make {gif} of; record it without --no-camera"
        )
    with written_whole(plotted, force=force or plot is None) as file:
        file.write(_plot(*drawing) if assistant is None else assistant.answer())
    return Rendering(gif if count else None, count, fps, plotted)


def _plot(*drawing: Any) -> bytes:  # noqa: ANN401
    from pipeline.figures.plot import plotted  # loads matplotlib, which another process may do

    return plotted(*drawing)


@contextmanager
def _refused(path: Path) -> Iterator[None]:
    """Blame the recording for frames that are no pictures."""
    try:
        yield
    except ValueError as error:
        raise RecordingError(f"{path} is damaged: {error}; {AGAIN}") from None


def _check_suffix(option: str, path: Path, suffixes: tuple[str, ...]) -> None:
    if path.suffix not in suffixes:
        raise ScenarioError(f"{option} must end in {' or '.join(suffixes)}, got {str(path)!r}")


def _facts(scenario: Scenario, analysis: Analysis) -> Facts:
    damping = "default" if scenario.linear_damping is None else f"{scenario.linear_damping:g}"
    impact, rest = analysis.impact, analysis.rest
    return Facts(
        title=f"{scenario.body} dropped from {scenario.height_m:g} m",
        subtitle=f"timestep {fraction(scenario.timestep_s)} s, linear damping {damping}",
        at_s=analysis.at[0].time_s if analysis.at else None,
        impact_s=None if impact is None else impact.time_simulated_s,
        rest_m=None if rest is None else rest.height_m,
    )


def _reported(path: Path, recording: Recording, progress: Progress) -> Iterator[bytes]:
    """Yield the PNGs of a recording in step order, and report each one."""
    assert recording.camera is not None
    total = recording.scenario.steps // recording.camera.capture_every + 1
    for done, (_, png) in enumerate(frames(path), start=1):
        yield png
        progress("writing gif", done, total)
