"""Lists the events of an analysis for the viewer, one line of English each."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from dataclasses import asdict
from typing import TYPE_CHECKING

import numpy as np

from drop_physics.analysis.results import Analysis
from drop_physics.fields import decimals

if TYPE_CHECKING:
    from drop_physics.drop.results import DropAnalysis, Moment

WIDTH = 44
"""Longest line in the viewer's event list [characters]."""
MOST_ROWS = 12
"""Largest number of account rows that are listed as events."""


def events(analysis: Analysis) -> list[tuple[int, float, str]]:
    """Return the events in order, each with its step, its time [s] and one line of text."""
    if analysis.kind == "script":
        return sorted(_of_bodies(analysis))
    from drop_physics.drop.results import DropAnalysis

    assert isinstance(analysis, DropAnalysis)
    timestep_s = analysis.scenario["timestep_s"]
    return [(step, step * timestep_s, line) for step, line in _of_drop(analysis)]


def _of_bodies(analysis: Analysis) -> Iterator[tuple[int, float, str]]:
    # Lines begin with the time, which the viewer cuts off in its own column.
    for finding in analysis.findings:
        step = None if finding.steps is None else finding.steps.first
        if step is not None and (time_s := _time_s(analysis, step)) is not None:
            about = finding.joint or finding.body
            line = f"{finding.code}: {about}" if about else finding.code
            yield step, time_s, f"{time_s:.3f} s  {line}"
    for row in analysis.account[:MOST_ROWS]:
        if row.step is not None and row.time_s is not None:
            line = textwrap.shorten(f"{row.kind}: {row.who}", WIDTH, placeholder=" …")
            yield row.step, row.time_s, f"{row.time_s:.3f} s  {line}"
    for body in analysis.bodies:
        for contact in body.contacts:
            others = ", ".join(sorted({partner.body for partner in contact.by}))
            line = textwrap.shorten(f"{body.label} meets {others}", WIDTH, placeholder=" …")
            yield contact.first_step, contact.start_s, f"{contact.start_s:.3f} s  {line}"


def _time_s(analysis: Analysis, step: int) -> float | None:
    """Return the time of a step [s]; None if no body has a sample of it."""
    for rows in analysis.rows:
        place = int(np.searchsorted(rows.columns["step"], step))
        if place < len(rows.columns["step"]) and rows.columns["step"][place] == step:
            return float(rows.columns["time_s"][place])
    return None


def _of_drop(analysis: DropAnalysis) -> list[tuple[int, str]]:
    """Return the events of a drop with their steps: release, error breakdowns, impact and rest."""
    height_m = analysis.table["simulated_m"][0]
    lines = [(0, f"release at {height_m:g} m")]
    lines += [(moment.step, _sum(moment)) for moment in analysis.at]
    impact, rest = analysis.impact, analysis.rest
    if impact is not None:
        # `impact.step` is the first sample that the contact has acted on; the body is in the floor,
        # and perhaps deepest, a step earlier.
        touches = min(impact.step, impact.lowest_step)
        lines.append((touches, f"first contact, arriving at {impact.speed_m_s:.3f} m/s"))
    if analysis.tumbled_step is not None:
        lines.append((analysis.tumbled_step, "tumbles from here on"))
    if impact is not None and impact.penetration_m is not None:
        depth_mm = impact.penetration_m * 1e3
        lines.append((impact.lowest_step, f"lowest point, {depth_mm:.3f} mm in the floor"))
    lines += [
        (bounce.step, f"rebound at {bounce.rebound_m_s:.3f} m/s") for bounce in analysis.bounces
    ]
    if rest is not None and rest.settled_step is not None:
        lines.append((rest.settled_step, f"at rest at {rest.height_m * 1e3:.3f} mm"))
    return sorted(lines, key=lambda event: event[0])


def _sum(moment: Moment) -> str:
    """Format a position error as a sum of its terms, without terms that round to zero."""
    terms = moment.terms_m
    total = f"{decimals(moment.error_m * 1e3, 2, '+')} mm off"
    if terms is None:
        return total
    parts = [
        f"{name} {value_m * 1e3:+.2f}"
        for name, value_m in asdict(terms).items()
        if abs(value_m) > 5e-6
    ]
    return f"{total}: {', '.join(parts)}" if parts else total
