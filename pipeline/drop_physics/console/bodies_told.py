"""What the bodies of a script did: the verdict first, then joints and bodies."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from rich.markup import escape

from drop_physics.console.findings_told import finding_lines
from drop_physics.console.flights_told import contact_lines, fall_lines, flight_lines
from drop_physics.console.momentum_told import momentum_lines
from drop_physics.console.output import columns_of, counted, cut, left, right, titled, wrapped
from drop_physics.console.output import width as columns
from drop_physics.console.words import CAUSES, SEGMENTS, kinds_of_samples
from drop_physics.messages import Message, joined, localized, translated
from drop_physics.trace.events import ENDED

if TYPE_CHECKING:
    from drop_physics.analysis.results import Analysis, BodyAnalysis, StepSum
    from drop_physics.explain.joints import JointRow
    from drop_physics.rules.answer import Finding

MOST_BODIES, MOST_ROBOTS, MOST_JOINTS = 12, 4, 8
"""That are listed without --verbose; all are in the JSON."""
NO_MOTOR = "off", "unknown", "default"
NAME = 8
"""Columns that names take at least."""
CELL, CONTROL, LONGEST_JOINT = 8, 10, 24
"""Columns of a joint's numbers, of how it is driven, and of its name."""


def lines_of_bodies(analysis: Analysis, *, verbose: bool = False) -> list[str]:
    """Tell what the bodies of a script did."""
    moving = [
        body for body in analysis.bodies if body.segments["still"] < sum(body.segments.values())
    ]
    alone = len(analysis.bodies) < len(analysis.by_body)
    found = finding_lines(analysis.findings, verbose=verbose, left_out=analysis.left_out)
    lines = [*_headline(analysis), *found]
    joints = _joints(moving, analysis.findings, verbose=verbose or alone)
    lines += joints
    if joints or verbose or alone:
        lines += _of_substeps(analysis)
    lines += ["", *_bodies(analysis, moving, verbose=verbose or alone)]
    for body in moving:
        for each in body.at:
            lines += ["", *sum_lines(body, each)]
    if verbose or alone:
        lines += momentum_lines(moving)
        lines += flight_lines(moving)
        lines += contact_lines(moving)
    else:
        lines += fall_lines(moving)
    if not (verbose or alone) and any(body.flights or body.contacts for body in moving):
        more = Message("flights, contacts and all else: --verbose, --body NAME, --at T, --json")
        lines += ["", *(f"[dim]{escape(line)}[/]" for line in wrapped(translated(more), columns()))]
    return lines


# -- the verdict ----------------------------------------------------------------------------------


def _headline(analysis: Analysis) -> list[str]:
    """Say what this is, how it ended, and how much of it is explained."""
    origin, there = analysis.origin or {}, len(analysis.by_body)
    ended = ENDED.get(str(origin["ended"]), Message("never finished"))
    bodies: Message = counted(there, "body", "bodies")
    if len(analysis.bodies) != there:
        bodies = Message("{shown} of {bodies}", shown=len(analysis.bodies), bodies=bodies)
    words = Message(
        "{script} {ended}: {bodies}, {steps}, {explained}",
        script=str(origin["script"]),
        ended=ended,
        bodies=bodies,
        steps=counted(max(0, analysis.samples - 1), "step"),
        explained=_explained(analysis),
    )
    first, *rest = map(escape, wrapped(translated(words), columns(), indent="  "))
    name = escape(str(origin["script"]))
    return [first.replace(name, f"[bold]{name}[/]", 1), *rest]


def _explained(analysis: Analysis) -> Message:
    explained = analysis.explained
    if not explained.of:
        return Message("nothing moved")
    if explained.samples == explained.of and not explained.remainder:
        return Message("all explained to the bit")
    if explained.samples == explained.of:
        return Message("all explained to {remainder:.0e}", remainder=explained.remainder)
    return Message(
        "{share:.4g} % explained; from {time:.4g} s on not all: {why}",
        share=math.floor(1e4 * explained.samples / explained.of) / 100,
        time=explained.until_s or 0.0,
        why=str(explained.why),
    )


def _of_substeps(analysis: Analysis) -> list[str]:
    """Say of which substep torques and forces are."""
    told = analysis.engine.values() if isinstance(analysis.engine, dict) else ()
    substeps = max((int(each["numSubSteps"]) for each in told), default=0)
    if substeps < 2:
        return []
    words = Message(
        "numSubSteps={substeps}: torques, limits and contact forces are those of the last substep",
        substeps=substeps,
    )
    return [f"[dim]{escape(line)}[/]" for line in wrapped(translated(words), columns())]


# -- joints ---------------------------------------------------------------------------------------

Cell = tuple[str, Callable[["JointRow"], str]]


def _joints(bodies: list[BodyAnalysis], findings: list[Finding], *, verbose: bool) -> list[str]:
    """Return a table of the joints; without `verbose` only those that calls drive.

    Those with findings come first where there are too many; what does not fit is left out.
    """
    lines: list[str] = []
    named = {each.joint for each in findings}
    robots = [body for body in bodies if any(_told(row, named) for row in body.joints)]
    # Those with findings first, of many.
    robots.sort(key=lambda body: not any(each.body == body.label for each in findings))
    shown_robots = bodies if verbose else robots[:MOST_ROBOTS]
    for body in sorted(shown_robots, key=lambda body: body.id):
        rows = [row for row in body.joints if verbose or _told(row, named)]
        rows.sort(key=lambda row: row.name not in named)
        shown = sorted(rows if verbose else rows[:MOST_JOINTS], key=_place)
        if not shown:
            continue
        named_ = (body.label, *map(_name, shown))
        column = min(max(map(columns_of, named_)) + 2, LONGEST_JOINT)
        cells = CELLS[: max(2, (columns() - column - CONTROL) // CELL)]
        heads = "".join(right(translated(head), CELL) for head, _ in cells)
        label = escape(left(cut(body.label, column - 1), column))
        control = left(localized("control"), CONTROL)
        lines += ["", f"[bold]{label}[/][dim]{control}{heads}[/]"]
        lines += [_joint(row, cells, column) for row in shown]
        if len(rows) > len(shown):
            joints = counted(len(rows) - len(shown), "joint")
            more = Message("and {joints}: --verbose", joints=joints)
            lines.append(f"[dim]{escape(translated(more))}[/]")
    if len(robots) > MOST_ROBOTS and not verbose:
        more = Message(
            "and the joints of {bodies} more: --verbose",
            bodies=counted(len(robots) - MOST_ROBOTS, "body", "bodies"),
        )
        lines += ["", f"[dim]{escape(translated(more))}[/]"]
    return lines


def _told(row: JointRow, named: set[str | None]) -> bool:
    """Return whether a joint is shown: a call drives it, or a finding names it."""
    return row.control not in NO_MOTOR or row.name in named


def _joint(row: JointRow, cells: Sequence[Cell], column: int) -> str:
    notes = [
        Message("at its stop in {steps}", steps=counted(row.at_stop_steps, "step")),
        Message("at its limit in {steps}", steps=counted(row.at_force_limit_steps, "step")),
    ]
    held = (row.at_stop_steps, row.at_force_limit_steps)
    line = left(cut(_name(row), column - 1), column) + left(row.control, CONTROL)
    line += "".join(right(text(row), CELL) for _, text in cells)
    for steps, note in zip(held, notes, strict=True):
        longer = f"{line}  {translated(note)}"
        if steps and columns_of(longer) <= columns():
            line = longer
    return escape(line.rstrip())


def _place(joint: JointRow) -> tuple[int, int]:
    return joint.index, joint.axis or 0


def _name(joint: JointRow) -> str:
    return joint.name if joint.axis is None else f"{joint.name} {'xyz'[joint.axis]}"


def _number(value: float | None, form: str) -> str:
    if value is None or not math.isfinite(value):
        return "–"
    # What rounds to zero has no sign.
    text = format(value, form)
    text = text if len(text) < CELL else format(value, "+.2g" if form[0] == "+" else ".2g")
    return format(0.0, form) if not text.strip("+-0.") else text


CELLS: Sequence[Cell] = (
    (Message("target"), lambda row: _number(row.target, ".3f")),
    (Message("reached"), lambda row: _number(row.reached, ".3f")),
    (Message("off"), lambda row: _number(row.off, "+.3f")),
    (Message("torque"), lambda row: _number(row.torque, ".1f")),
    (Message("limit"), lambda row: _number(row.force_limit, ".4g")),
    (Message("needs"), lambda row: _number(row.needs, ".1f")),
)
"""What a row of a joint has, under which heading: rad, m, N m or N."""


# -- bodies ---------------------------------------------------------------------------------------


def _bodies(analysis: Analysis, moving: list[BodyAnalysis], *, verbose: bool) -> list[str]:
    """Return a line per moving body: its mass, samples and energy; and what is unexplained."""
    lines = []
    shown = moving[:MOST_BODIES]
    column = min(max((columns_of(body.label) for body in shown), default=NAME) + 2, 30)
    for body in shown:
        lines += titled(body.label, _facts(body, verbose=verbose), column=column, style="bold")
        for run in body.unexplained:
            words = Message(
                "unexplained: {samples} from step {step} on: {reason}",
                samples=counted(run.samples, "sample"),
                step=run.first_step,
                reason=run.reason,
            )
            lines += titled("", words, column=column)
    more = len(moving) - len(shown)
    if more > 0:
        bodies = counted(more, "body", "bodies")
        lines.append(localized("and {bodies} more: see --json, or --body", bodies=bodies))
    soft = [body.label for body in analysis.bodies if body.soft]
    still = [body for body in analysis.bodies if body not in moving and not body.soft]
    if still:
        names = [body.label for body in still]
        lines += titled(Message("still"), _first_of(names), column=column, style="dim")
    if soft:
        words = Message("{bodies}: its motion is not recorded", bodies=_first_of(soft))
        lines += titled(Message("soft"), words, column=column, style="dim")
    return lines


def _first_of(labels: list[str]) -> str:
    return ", ".join(labels[:MOST_BODIES]) + (" …" if len(labels) > MOST_BODIES else "")


def _facts(body: BodyAnalysis, *, verbose: bool) -> Message:
    mass: str = f"{body.mass_kg:.4g} kg"
    if len(body.links) > 1:
        mass = joined(", ", [mass, counted(len(body.links) - 1, "link")])
    # What a call set at the beginning is no news.
    rest = {name: n for name, n in body.segments.items() if verbose or (name, n) != ("set", 1)}
    facts = joined(": ", [mass, kinds_of_samples(rest)])
    if body.energy is None:
        return facts
    changes: str = f"{body.energy.start_j + 0.0:.4g} → {body.energy.end_j + 0.0:.4g} J"
    causes = sorted(body.energy.by_cause_j.items(), key=lambda cause: -abs(cause[1]))
    named = [
        Message("{joules} {cause}", joules=f"{value:+.3g}", cause=CAUSES[name])
        for name, value in causes[: 2 * verbose]
        if abs(value) > 1e-9
    ]
    return joined("; ", [facts, joined(": ", [changes, joined(", ", named)]) if named else changes])


def sum_lines(body: BodyAnalysis, each: StepSum) -> list[str]:
    """Return a step as its sum: a row per term, a column per degree of freedom."""
    title = localized(
        "[bold]{body}[/] at {time:.4g} s, step {step}: {segment}",
        body=escape(body.label),
        time=each.time_s,
        step=each.step,
        segment=SEGMENTS[each.segment],
    )
    if each.terms is None or each.remainder is None:
        return [title]
    base = (
        []
        if len(each.remainder) < 6 or not body.momentum
        else [*["ωx", "ωy", "ωz", "vx", "vy", "vz"]]
    )
    heads = base + [_name(joint) for joint in body.joints]
    rows = {name: term for name, term in each.terms.items() if any(term)}
    rows["remainder"] = each.remainder
    lines = [title]
    for number, head in enumerate(heads):
        if number < len(each.remainder):
            terms = [
                Message(
                    "{term} {distance}",
                    term=CAUSES.get(name, name),
                    distance=f"{term[number]:+.3e}",
                )
                for name, term in rows.items()
                if term[number]
            ]
            lines += titled(
                head, joined(", ", terms or ["0"]), column=min(28, max(map(columns_of, heads)) + 2)
            )
    return lines
