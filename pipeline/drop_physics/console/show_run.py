"""Say what was made of a drop or a script: recording, animation, plot."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from drop_physics.console.output import counted, made, note, print_json, print_lines
from drop_physics.console.show_analysis import analysis_lines
from drop_physics.console.words import PLOT, RECORDING
from drop_physics.messages import Message, joined, shell_command

if TYPE_CHECKING:
    from drop_physics.stages.render import Rendering
    from drop_physics.stages.run import Run
    from drop_physics.stages.simulate import Simulation

_FILE = 17
"""Column of what was made."""


def show_simulation(simulation: Simulation, *, as_json: bool) -> None:
    """Print what `simulate` made."""
    if as_json:
        print_json(_simulation_json(simulation))
    else:
        print_lines(*simulation_lines(simulation))


def show_rendering(rendering: Rendering, recording: Path, *, as_json: bool) -> None:
    """Print what `render` made of a recording."""
    if recording.suffix == ".part":
        note(
            Message(
                "{recording} was never finished: this shows what it holds, unverified",
                recording=str(recording),
            )
        )
    if as_json:
        print_json(_rendering_json(rendering))
    else:
        print_lines(*rendering_lines(rendering))


def show_run(run: Run, *, as_json: bool) -> None:
    """Print the whole story of a drop."""
    if as_json:
        print_json(
            {
                "simulate": _simulation_json(run.simulation),
                "analyze": run.analysis.as_json(),
                "render": _rendering_json(run.rendering),
            }
        )
    else:
        print_lines(*run_lines(run))


def run_lines(run: Run) -> list[str]:
    """Tell the whole story of a drop, and where its files are."""
    command = shell_command("drop", "view", run.simulation.recording)
    return [
        *analysis_lines(run.analysis),
        "",
        *simulation_lines(run.simulation),
        *rendering_lines(run.rendering),
        *made(Message("see it move"), command, column=_FILE),
    ]


def _simulation_json(simulation: Simulation) -> dict[str, Any]:
    return {
        "recording": str(simulation.recording),
        "recording_id": simulation.recording_id,
        "samples": simulation.samples,
        "frames": simulation.frames,
        "bytes": simulation.bytes,
        "wall_s": simulation.wall_s,
    }


def _rendering_json(rendering: Rendering) -> dict[str, Any]:
    return {
        "gif": None if rendering.gif is None else str(rendering.gif),
        "frames": rendering.frames,
        "fps": rendering.fps,
        "plot": None if rendering.plot is None else str(rendering.plot),
    }


def simulation_lines(simulation: Simulation) -> list[str]:
    """Say what was recorded."""
    facts = Message(
        "{samples}, {frames}, {kilobytes:,.0f} kB, {wall_s:.1f} s",
        samples=counted(simulation.samples, "sample"),
        frames=counted(simulation.frames, "frame"),
        kilobytes=simulation.bytes / 1e3,
        wall_s=simulation.wall_s,
    )
    return made(RECORDING, simulation.recording, facts, column=_FILE)


def rendering_lines(rendering: Rendering) -> list[str]:
    """Say what was rendered, and how it plays."""
    lines = []
    if rendering.gif is not None:
        frames = counted(rendering.frames, "frame")
        facts = [frames, f"{rendering.frames / rendering.fps:.2f} s"]
        if rendering.speed is not None:
            facts.append(_speed(rendering.speed))
        lines += made(rendering.gif.suffix[1:], rendering.gif, joined(", ", facts), column=_FILE)
    if rendering.plot is not None:
        lines += made(PLOT, rendering.plot, column=_FILE)
    return lines


def _speed(speed: float) -> Message:
    """Return a speed in words: real time, or what part or multiple of it."""
    if abs(speed - 1) < 5e-4:
        return Message("in real time")
    if speed < 1:
        return Message("{times:.4g} times slower", times=1 / speed)
    return Message("{times:.4g} times faster", times=speed)
