"""The momentum of bodies: what it was, what it became, and what gave or took it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.markup import escape

from drop_physics.console.output import table
from drop_physics.console.words import CAUSES
from drop_physics.messages import Message, localized, translated

if TYPE_CHECKING:
    from drop_physics.analysis.results import BodyAnalysis

MOST_BODIES = 3
"""Bodies of which it is told; all are in the JSON."""


def momentum_lines(bodies: list[BodyAnalysis]) -> list[str]:
    """Tell the momentum of the first bodies at the start and the end, and by cause."""
    lines = []
    for body in [body for body in bodies if body.momentum is not None][:MOST_BODIES]:
        assert body.momentum is not None
        rows = {
            translated(Message("at the start")): body.momentum.start_kg_m_s,
            **{
                translated(CAUSES[name]): each
                for name, each in body.momentum.by_cause_kg_m_s.items()
                if any(each)
            },
            translated(Message("at the end")): body.momentum.end_kg_m_s,
        }
        numbers = [
            (axis, [f"{value + 0.0:+.4g}" for value in values], True)
            for axis, values in zip("xyz", zip(*rows.values(), strict=True), strict=True)
        ]
        title = localized("[bold]Momentum of {body}[/] [kg m/s]", body=escape(body.label))
        lines += ["", title.replace("[kg", r"\[kg"), *table([("", [*rows], False), *numbers])]
    return lines
