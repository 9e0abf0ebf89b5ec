"""The report of `drop view`, printed before the viewer opens."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drop_physics.explain.jsonable import jsonable
from drop_physics.messages import Message, joined, shell_command
from drop_physics.report.blocks import Fact, Facts, Report, Section

if TYPE_CHECKING:
    from drop_physics.stages.view import View

COLUMN = 19
"""Width of the column of titles."""


def json_of(view: View) -> dict[str, Any]:
    """Return the JSON object that `--json` prints."""
    names = ("recordings", "layers", "golden", "same", "first_difference")
    viewer = {name: getattr(view.viewer, name) for name in ("command", "url", "page")}
    return dict(jsonable({name: getattr(view, name) for name in names} | viewer))


def report_of(view: View) -> Report:
    """Report what the viewer shows, and its address."""
    shown = " ".join(map(str, [*view.recordings, *view.layers]))
    rows = [Fact(Message("showing"), shown)]
    if view.golden is not None:
        words = joined(": ", [str(view.golden), _difference(view)])
        rows.append(Fact(Message("golden, in grey"), words))
    if view.viewer.page is not None:
        words = Message("{page}   (Ctrl-C ends it)", page=view.viewer.page)
        rows.append(Fact(Message("open in a browser"), words))
    notes = [
        Message(
            "{layer} belongs to an earlier recording; make it again with: {again}",
            layer=str(layer),
            again=shell_command(
                "drop", "analyze", Path(str(layer).removesuffix(".analysis.rrd") + ".rrd")
            ),
        )
        for layer in view.stale
    ]
    return Report(sections=[Section([Facts(rows, COLUMN)])], notes=notes, next=[*_next(view)])


def _next(view: View) -> Iterator[str]:
    """Yield the command that describes the recording in text, for recordings made by `drop`."""
    (recording, *_), golden = view.recordings, view.golden
    if golden is not None:
        yield shell_command("drop", "check", recording, "--against", golden)
    elif not view.is_foreign:
        yield shell_command("drop", "analyze", recording)


def _difference(view: View) -> Message:
    step = view.first_difference
    if view.same:
        return Message("the same physics")
    if step is not None:
        return Message("differs from step {step} on", step=step)
    if view.settings_differ:
        return Message("differs in its settings")
    if not view.not_compared:
        return Message("nothing compared")
    return Message(
        "no difference, but {bodies} could not be compared", bodies=", ".join(view.not_compared)
    )
