"""What the plot of a script tells: the verdict, and the panels that show it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import polars as pl
from numpy.typing import NDArray

from drop_physics import colours
from drop_physics.analysis.answers.answer import Finding
from drop_physics.analysis.curves import FORCES, Curves
from drop_physics.analysis.joints import JointRow
from drop_physics.analysis.results import Analysis, BodyAnalysis
from drop_physics.figures.story_plot import Curve, Look, Panel, Story
from drop_physics.messages import Message

Float64 = NDArray[np.float64]

MOST_PANELS, MOST_CAUSES = 4, 4
LEAST_SHARE = 0.02
"""Causes that gave less of what was given are left out."""
FLIES = 0.1
"""A body flies if a flight is at least this share of its samples."""
WHOLE = 0.9
"""A finding that covers more of the time than this is not marked."""
FAR = 3.0
"""A limit over so many times the largest torque is not drawn."""


def story_of(analysis: Analysis) -> Story:
    """Return what the plot of a script tells."""
    title, *lines = _verdict(analysis)
    return Story(title, lines, [*_panels(analysis)][:MOST_PANELS])


def _verdict(analysis: Analysis) -> Iterator[str]:
    explained, script = analysis.explained, str((analysis.origin or {}).get("script") or "")
    if not analysis.findings:
        yield Message("{script}: nothing needs a second look", script=script)
    for finding in analysis.findings[:1]:
        first, _, rest = finding.said.partition(": ")
        if first == finding.body:
            more, _, rest = rest.partition(": ")
            first = f"{first}: {more}"
        yield first
        if rest:
            yield rest
        if finding.advice:
            yield finding.advice
    yield Message(
        "{script}: {explained:,} of {of:,} samples explained, findings: {findings}",
        script=script, explained=explained.samples, of=explained.of,
        findings=len(analysis.findings),
    )  # fmt: skip


# -- which panels ---------------------------------------------------------------------------------


def _panels(analysis: Analysis) -> Iterator[Panel]:
    """Yield what the findings are about, the gravest first, then energy and flights."""
    told = _Told(analysis)
    for number, finding in enumerate(analysis.findings, 1):
        yield from told.of(finding, str(number))
    yield from told.rest()


class _Told:
    """Makes each kind of panel once."""

    def __init__(self, analysis: Analysis) -> None:
        self._analysis = analysis
        assert analysis.curves is not None  # of a script
        self._curves = analysis.curves
        self._bodies = {body.label: body for body in analysis.bodies}
        self._done: set[str] = set()

    def of(self, finding: Finding, mark: str) -> Iterator[Panel]:
        """Yield the panels that show what a finding says."""
        body = self._bodies.get(finding.body or "")
        if body is None:
            return
        panels: list[Panel] = []
        if finding.joint is not None and self._is_new("joint"):
            row = next((row for row in body.joints if row.name == finding.joint), None)
            panels = [] if row is None else [*self._joint(body, row)]
        elif finding.other in self._bodies and self._is_new("friction"):
            panels = [*self._friction(body, self._bodies[finding.other])]
        elif _flies(body) and self._is_new("heights"):
            panels = [*self._heights(body)]
        for panel in panels:
            yield replace(panel, mark=mark, span_s=self._span_s(finding, body))

    def rest(self) -> Iterator[Panel]:
        """Yield what is worth a look in any case, of the body that the findings are about."""
        bodies = [*self._bodies.values()]
        about = [self._bodies[each.body] for each in self._analysis.findings
            if each.body in self._bodies]  # fmt: skip
        moving = sorted(bodies, key=lambda each: each.segments["still"] - sum(
            each.segments.values()))  # fmt: skip
        about += [body for body in moving if body.segments["still"] < sum(body.segments.values())]
        for body in about:
            rows = [row for row in body.joints if row.off is not None]
            if rows and self._is_new("joint"):
                yield from self._joint(body, max(rows, key=lambda row: abs(row.off or 0.0)))
            if _flies(body) and self._is_new("heights"):
                yield from self._heights(body)
            if body.energy is not None and "energy" not in self._done:
                panels = [*self._energy(body)]
                self._done |= {"energy"} if panels else set()
                yield from panels

    def _is_new(self, kind: str) -> bool:
        new = kind not in self._done
        self._done.add(kind)
        return new

    # -- what is in them --------------------------------------------------------------------------

    def _joint(self, body: BodyAnalysis, row: JointRow) -> Iterator[Panel]:
        curves = self._curves.joints(body.id)
        k = body.joints.index(row)
        if curves is None:
            return
        its = Curves(curves.steps, {name: each[:, k] for name, each in curves.columns.items()})
        angle = "m" if row.kind == "prismatic" else "rad"
        what, unit = ("rate", f"{angle}/s") if row.control == "velocity" else ("position", angle)
        asked = {"rate": "target_rate", "position": "target"}[what]
        title = Message("{joint}: position", joint=row.name)
        if what == "rate":
            title = Message("{joint}: rate", joint=row.name)
        yield Panel(title, unit, [
            self._curve(body, its, what, Message("reached"), colours.SIMULATED),
            self._curve(body, its, asked, Message("target"), "", dashed=True),
        ])  # fmt: skip
        force = "N" if row.kind == "prismatic" else "N m"
        torque = its.columns["torque"]
        most = float(np.nanmax(np.abs(torque), initial=0.0))
        limits = []
        if np.nanmin(its.columns["limit"], initial=np.inf) <= FAR * most:
            its.columns["lower"] = -its.columns["limit"]
            sides = [("limit", torque.max() > 0.5 * most), ("lower", torque.min() < -0.5 * most)]
            limits = [self._curve(body, its, side, Message("limit"), colours.TIMESTEP, dashed=True)
                for side, near in sides if near]  # fmt: skip
        title = Message("{joint}: torque of its motor", joint=row.name)
        drawn = self._curve(body, its, "torque", Message("torque"), colours.ROUNDING)
        yield Panel(title, force, [drawn, *limits], zero=True)

    def _friction(self, body: BodyAnalysis, other: BodyAnalysis) -> Iterator[Panel]:
        its = self._curves.friction(body.id, other.id)
        if its is None or len(its.steps) < 2:
            return
        title = Message("friction between {body} and {other}", body=body.label, other=other.label)
        yield Panel(title, "N", [
            self._curve(body, its, "available", Message("available"), colours.FREE_FALL, wide=True),
            self._curve(body, its, "used", Message("used"), colours.INTERACTION),
        ], zero=True)  # fmt: skip

    def _energy(self, body: BodyAnalysis) -> Iterator[Panel]:
        its = self._curves.energy(body.id)
        if its is None:
            return
        sizes = {name: float(np.nanmax(np.abs(its.columns[name]), initial=0.0)) for name in FORCES}
        causes = sorted(FORCES, key=lambda name: -sizes[name])[:MOST_CAUSES]
        causes = [name for name in causes if sizes[name] > LEAST_SHARE * sizes[causes[0]]]
        if not causes or not its.columns["whole"].any():
            return
        title = Message("energy of {body} since the start, by cause", body=body.label)
        whole = self._curve(body, its, "whole", Message("together"), "")
        yield Panel(title, "J", [whole, *(
            self._curve(body, its, name, name, colours.CAUSES[name]) for name in causes
        )], zero=True)  # fmt: skip

    def _heights(self, body: BodyAnalysis) -> Iterator[Panel]:
        rows = self._analysis.table.filter(pl.col("body") == body.id)
        times_s, z_m = rows["time_s"].to_numpy(), rows["z_m"].to_numpy()
        fall_m = z_m - rows["error_z_m"].fill_null(np.nan).to_numpy()
        title = Message("height of {body}", body=body.label)
        yield Panel(title, "m", [
            Curve(Message("free fall"), times_s, fall_m, colours.FREE_FALL, "wide"),
            Curve(Message("simulated"), times_s, z_m, colours.SIMULATED),
        ])  # fmt: skip

    def _curve(
        self, body: BodyAnalysis, its: Curves, column: str, name: str, colour: str,
        *, dashed: bool = False, wide: bool = False,
    ) -> Curve:  # fmt: skip
        steps, values = its.steps, its.columns[column]
        gaps = np.flatnonzero(np.diff(steps) > 1.5 * np.diff(steps).min(initial=len(steps))) + 1
        times_s = self._curves.times_s(body.id, steps)
        look: Look = "dashed" if dashed else "wide" if wide else "line"
        return Curve(
            name, np.insert(times_s, gaps, times_s[gaps]), np.insert(values, gaps, np.nan), colour,
            look,
        )  # fmt: skip

    def _span_s(self, finding: Finding, body: BodyAnalysis) -> tuple[float, float] | None:
        steps = finding.steps
        if steps is None or steps.last - steps.first > WHOLE * self._analysis.samples:
            return None
        ends = np.array([steps.first, steps.last])
        first_s, last_s = self._curves.times_s(body.id, ends).tolist()
        return first_s, last_s


def _flies(body: BodyAnalysis) -> bool:
    longest = max((each.last_step - each.first_step for each in body.flights), default=0)
    return longest > FLIES * sum(body.segments.values())
