"""Say what is being shown, before the viewer opens."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.console.output import note, print_json, print_lines, titled
from pipeline.messages import shell_command

if TYPE_CHECKING:
    from pipeline.stages.view import View


def show_view(view: View, *, as_json: bool) -> None:
    """Print what is shown, and where."""
    for layer in view.stale:
        recording = Path(str(layer).removesuffix(".analysis.rrd") + ".rrd")
        again = shell_command("drop", "analyze", recording)
        note(f"{layer} belongs to an earlier recording; make it again with: {again}")
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
    lines = titled("showing", " ".join(map(str, [*view.recordings, *view.layers])), column=19)
    if view.golden is not None:
        step = view.first_difference
        where = "in its settings" if step is None else f"from step {step} on"
        found = "the same physics" if view.same else f"differs {where}"
        lines += titled("golden, in grey", f"{view.golden}: {found}", column=19)
    if view.viewer.page is not None:
        lines += titled("open in a browser", f"{view.viewer.page}   (Ctrl-C ends it)", column=19)
    return lines
