"""Chooses the curves that show a recording, which are the same in plot, video and viewer."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

from drop_physics.account.rows import AccountRow
from drop_physics.analysis.results import Analysis
from drop_physics.fields import counted
from drop_physics.figures.plot import Panel, Plot
from drop_physics.messages import Message, joined
from drop_physics.stages.panels.kinds import (
    KINDS,
    Drawable,
    Kind,
    energy,
    of_finding,
    of_row,
    side_by_side,
)
from drop_physics.trace.events import Body

if TYPE_CHECKING:
    from drop_physics.drop.results import FallAnalysis

MOST_PANELS = 4
"""Largest number of panels in a plot."""
MOST_BODIES = 3
"""Largest number of bodies whose energy the viewer shows."""


def plot_of(analysis: Analysis | FallAnalysis) -> Plot:
    """Return the plot of a recording."""
    if not isinstance(analysis, Analysis) or analysis.kind == "drop":
        from drop_physics.drop.results import FallAnalysis
        from drop_physics.stages.panels.of_drop import plot_of_drop

        assert isinstance(analysis, FallAnalysis)
        return plot_of_drop(analysis)
    title, *lines = _verdict(analysis)
    return Plot(title, lines, [*_panels(analysis)][:MOST_PANELS])


def _verdict(analysis: Analysis) -> Iterator[str]:
    explained, script = analysis.explained, str((analysis.origin or {}).get("script") or "")
    if not analysis.findings:
        yield Message(
            "{script}: no finding in {bodies}, {steps}",
            script=script,
            bodies=counted(len(analysis.bodies), "body", "bodies"),
            steps=counted(sum(analysis.stepped), "step"),
        )
    for finding in analysis.findings[:1]:
        first, _, rest = finding.said.partition(": ")
        if first == finding.body:
            more, _, rest = rest.partition(": ")
            first = f"{first}: {more}"
        yield first
        if rest:
            yield rest
        if finding.advised:
            yield finding.advised
    yield Message(
        "{script}: {explained:,} of {of:,} samples explained, findings: {findings}",
        script=script,
        explained=explained.samples,
        of=explained.of,
        findings=len(analysis.findings),
    )


def _panels(analysis: Analysis) -> Iterator[Panel]:
    """Yield the panels (groups of curves): those of findings first, then of general interest."""
    subject, done = Drawable(analysis), frozenset[Kind]()
    for number, finding in enumerate(analysis.findings, 1):
        kind, panels = of_finding(subject, finding, str(number), done)
        done |= {kind} if kind else frozenset()
        yield from panels
    for body in subject.about:
        for kind in KINDS:
            if kind not in done and (panels := [*kind(subject, body, None)]):
                done |= {kind}
                yield from panels


def plot_of_row(analysis: Analysis, rows: Sequence[AccountRow]) -> Plot:
    """Return a plot for the first account row that has a curve, with its moment marked.

    If no row has a curve, the plot has neither panels nor title.
    """
    subject = Drawable(analysis)
    for row in rows:
        if (panel := of_row(subject, row)) is not None:
            return Plot(joined("  ", [row.kind, row.who, row.told]), [], [panel])
    return Plot("", [], [])


def viewed(analysis: Analysis, bodies: Mapping[int, Body]) -> tuple[list[Panel], list[str]]:
    """Return the viewer's panels, and the relevant bodies, in order."""
    subject = Drawable(analysis)
    panels, done = [*side_by_side(subject, bodies)], frozenset[Kind]()
    for finding in analysis.findings:
        if finding.joint is None:
            kind, more = of_finding(subject, finding, done=done)
            done |= {kind} if kind else frozenset()
            panels += more
    for body in subject.about[:MOST_BODIES]:
        panels += energy(subject, body, None)
    return panels, [body.label for body in subject.about]
