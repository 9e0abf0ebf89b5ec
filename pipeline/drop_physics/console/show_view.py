"""Say what is being shown, before the viewer opens."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from drop_physics.console.output import note, print_json, print_lines, titled
from drop_physics.messages import Message, joined, shell_command

if TYPE_CHECKING:
    from drop_physics.stages.view import View


def show_view(view: View, *, as_json: bool) -> None:
    """Print what is shown, and where."""
    for layer in view.stale:
        recording = Path(str(layer).removesuffix(".analysis.rrd") + ".rrd")
        note(
            Message(
                "{layer} belongs to an earlier recording; make it again with: {again}",
                layer=str(layer),
                again=shell_command("drop", "analyze", recording),
            )
        )
    if as_json:
        print_json(
            {
                "recordings": list(map(str, view.recordings)),
                "layers": list(map(str, view.layers)),
                "golden": None if view.golden is None else str(view.golden),
                "same": view.same,
                "first_difference": view.first_difference,
                "command": view.viewer.command,
                "url": view.viewer.url,
                "page": view.viewer.page,
            }
        )
    else:
        print_lines(*view_lines(view))


def view_lines(view: View) -> list[str]:
    """Say what is shown, and where."""
    lines = titled(
        Message("showing"), " ".join(map(str, [*view.recordings, *view.layers])), column=19
    )
    if view.golden is not None:
        step = view.first_difference
        if view.same:
            difference = Message("the same physics")
        elif step is None and view.not_compared:
            difference = Message(
                "no difference, but {bodies} could not be compared",
                bodies=", ".join(view.not_compared),
            )
        elif step is None:
            difference = Message("differs in its settings")
        else:
            difference = Message("differs from step {step} on", step=step)
        words = joined(": ", [str(view.golden), difference])
        lines += titled(Message("golden, in grey"), words, column=19)
    if view.viewer.page is not None:
        words = Message("{page}   (Ctrl-C ends it)", page=view.viewer.page)
        lines += titled(Message("open in a browser"), words, column=19)
    return lines
