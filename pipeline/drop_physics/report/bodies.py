"""The report of a script's bodies: the verdict first, then joints and bodies."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

from drop_physics.explain.cause_names import cause_in_words
from drop_physics.fields import counted
from drop_physics.messages import Message, columns_of, joined
from drop_physics.quantities import rounded_off
from drop_physics.report import account
from drop_physics.report.blocks import (
    Block,
    Column,
    DataTable,
    Fact,
    Facts,
    Failure,
    FindingList,
    Report,
    Section,
    Words,
)
from drop_physics.report.episodes import ended_well, episode_lines
from drop_physics.report.flights import contact_by, contacts, falls, flights, momentum
from drop_physics.report.words import MISSING, SEGMENTS, kinds_of_samples
from drop_physics.rules.choice import minor
from drop_physics.trace.events import ENDED

if TYPE_CHECKING:
    from drop_physics.account.joints import JointRow
    from drop_physics.account.rows import AccountRow
    from drop_physics.analysis.results import Analysis, BodyAnalysis, StepSum
    from drop_physics.explain.actuators import ActuatorRow
    from drop_physics.rules.answer import Finding

MOST_FINDINGS = 3
"""Most findings listed without --verbose; the JSON contains all."""
MOST_BODIES, MOST_LACKS = 12, 3
"""Most body names in a line, and most lines about unexplained steps without --verbose."""
LACKS = 10
"""Width of the titles of lines about unexplained steps."""
FAILED = "script-failed"
"""Code of the finding for the error that ended a script."""
NAME = 8
"""Minimum width of a column of names."""
CELL, FORCE, CONTROL, LONGEST_JOINT = 8, 7, 8, 24
"""Widths of the columns of joint positions, torques, drives and names."""


@dataclass(frozen=True)
class OneScreen:
    """The findings and the account's rows that fit on one screen."""

    failed: Finding | None
    """The error that ended the script."""
    findings: list[Finding]
    """Other findings, the most certain first, and those of little weight last."""
    most_findings: int
    """Number of findings shown."""
    rows: list[AccountRow]
    """Rows of the account that no displayed finding covers."""
    most_rows: int
    """Number of rows shown."""


def one_screen(
    analysis: Analysis, *, verbose: bool = False, most_rows: int | None = None
) -> OneScreen:
    """Choose what to show on one screen; `most_rows` overrides the limit for the account."""
    failed = next((finding for finding in analysis.findings if finding.code == FAILED), None)
    findings = [finding for finding in analysis.findings if finding.code != FAILED]
    well = not verbose and most_rows is None and ended_well(analysis.episodes)
    little = [] if verbose else minor(findings, analysis.account)
    little += [each for each in findings if well and each.level == "note" and each not in little]
    shown = [finding for finding in findings if finding not in little]
    shown.sort(key=lambda each: each.proof == "none")  # the surest first
    most = len(shown) if verbose else min(len(shown), MOST_FINDINGS)
    told = analysis.account
    if well:  # what holds a joint, say, is then held on purpose
        told = [row for row in told if row.misled]
    rows = account.rows_beside(told, shown[:most])
    if most_rows is None:
        most_rows = len(rows) if verbose else account.FEW if shown else account.MANY
    return OneScreen(failed, [*shown, *little], most, rows, most_rows)


def report_of_bodies(
    analysis: Analysis, *, verbose: bool = False, most_rows: int | None = None
) -> Report:
    """Report how a script's bodies move; `most_rows` limits the rows of the account."""
    moving = [
        body for body in analysis.bodies if body.segments["still"] < sum(body.segments.values())
    ]
    alone = len(analysis.bodies) < len(analysis.by_body)
    screen = one_screen(analysis, verbose=verbose, most_rows=most_rows)
    found = FindingList(
        screen.findings,
        screen.most_findings,
        analysis.left_out,
        analysis.sources,
        looked_at=None if screen.failed or analysis.samples < 2 else looked_at(analysis),
    )
    its = analysis.episodes, analysis.episode, analysis.samples
    episodes = [*episode_lines(*its, verbose=verbose)]
    sections = [*episodes, Section([found], apart=False)]
    sections += account.account_of(screen.rows, screen.most_rows)
    verbose = verbose or alone
    if verbose:
        sections += _joints(moving)
    sections += _of_substeps(analysis)
    if verbose:
        sections.append(Section([*_bodies(analysis, moving)]))
    sections += [sum_of(body, each) for body in moving for each in body.at]
    if verbose:
        sections += [*momentum(moving), *flights(moving), *contacts(moving)]
    else:
        sections += falls(moving)
    sections.append(Section([*_not_said(moving, verbose=verbose)]))
    return Report(
        error=Failure(screen.failed, analysis.sources) if screen.failed else None,
        verdict=_headline(analysis, verbose=verbose),
        sections=sections,
    )


def looked_at(analysis: Analysis) -> Message:
    """Describe what was examined, for an analysis without findings."""
    joints = sum(len({row.name for row in body.joints}) for body in analysis.bodies)
    return Message(
        "no finding in {bodies}, {joints}, {steps}; the rules know common mistakes only",
        bodies=counted(len(analysis.bodies), "body", "bodies"),
        joints=counted(joints, "movable joint"),
        steps=steps_of(analysis),
    )


def steps_of(analysis: Analysis) -> Message:
    """Return the number of steps, of all simulations together, with the number of these."""
    steps = counted(sum(analysis.stepped), "step")
    if len(analysis.stepped) < 2:
        return steps
    return Message("{steps} in {n} simulations", steps=steps, n=len(analysis.stepped))


# -- the verdict ----------------------------------------------------------------------------------


def _headline(analysis: Analysis, *, verbose: bool) -> Words:
    """Return the opening line: the script, how it ended, and the share of explained samples."""
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
        steps=steps_of(analysis),
        explained=_explained(analysis, verbose=verbose),
    )
    return Words(words, key=str(origin["script"]), indent="  ")


def _explained(analysis: Analysis, *, verbose: bool) -> Message:
    explained = analysis.explained
    if not explained.of and any(body.soft for body in analysis.bodies):
        return Message("no motion to explain")
    if not explained.of:
        moved = analysis.samples > 1
        return Message("nothing moved by itself") if moved else Message("nothing was stepped")
    if explained.samples == explained.of and not explained.remainder:
        return Message("100 % explained, to the bit")
    if explained.samples == explained.of and verbose:
        return Message("100 % explained, to {remainder:.0e}", remainder=explained.remainder)
    if explained.samples == explained.of:
        return Message("100 % explained")
    return Message(
        "{share:.4g} % explained; from {time:.4g} s on not all: {why}",
        share=math.floor(1e4 * explained.samples / explained.of) / 100,
        time=explained.until_s or 0.0,
        why=str(explained.why),
    )


def _of_substeps(analysis: Analysis) -> Iterator[Section]:
    """Yield a note on the substep to which reported torques and forces belong."""
    if analysis.origin is not None and analysis.origin.get("kind") == "imported":
        return  # whose states are apart, and which has no forces then
    reported = analysis.engine.values() if isinstance(analysis.engine, dict) else ()
    substeps = max((int(each["numSubSteps"]) for each in reported), default=0)
    if substeps < 2:
        return
    words = Message(
        "numSubSteps={substeps}: torques, limits and contact forces are those of the last substep",
        substeps=substeps,
    )
    yield Section([Words(words, "dim")], apart=False)


# -- joints ---------------------------------------------------------------------------------------


def _joints(bodies: Sequence[BodyAnalysis]) -> Iterator[Section]:
    """Yield the tables of joints."""
    for body in bodies:
        if body.joints:
            table = joint_table(body.label, sorted(body.joints, key=_place), body.actuators)
            yield Section([replace(table, left_out=_narrow)])


@dataclass(frozen=True, kw_only=True)
class DriveRow:
    """A row of the table of joints: a joint's degree of freedom, or an actuator."""

    name: str
    control: str
    target: float | None = None
    reached: float | None
    off: float | None = None
    unit: str
    torque: float | None
    limit: float | None
    needs: float | None = None
    torque_unit: str
    notes: tuple[Message | Literal[""], ...]

    @staticmethod
    def of_joint(row: JointRow) -> DriveRow:
        """Make the row for a joint's degree of freedom."""
        return DriveRow(
            name=_name(row),
            control=row.control,
            target=row.target,
            reached=row.reached,
            off=row.off,
            unit=row.unit,
            torque=row.torque,
            limit=row.force_limit,
            needs=row.needs,
            torque_unit=row.torque_unit,
            notes=(_stopped(row.at_stop_steps), _limited(row.at_force_limit_steps)),
        )

    @staticmethod
    def of_actuator(row: ActuatorRow) -> DriveRow:
        """Make the row for an actuator that moves several joints: length, force, moment arms."""
        asks = row.kind == "position"
        known = None not in (row.given, row.length)
        arms = [
            Message("arm {arm} on {joint}", arm=f"{arm:.3g}", joint=joint)
            for joint, arm in row.moments.items()
        ]
        return DriveRow(
            name=row.name,
            control=row.kind,
            target=row.given if asks else None,
            reached=row.length,
            off=(row.length or 0.0) - (row.given or 0.0) if asks and known else None,
            unit="",
            torque=row.force,
            limit=None if row.force_range is None else max(map(abs, row.force_range)),
            torque_unit="",
            notes=(joined(", ", arms) if arms else "", _limited(row.at_force_limit_steps)),
        )


def _stopped(steps: int) -> Message | Literal[""]:
    return Message("at its stop in {steps}", steps=counted(steps, "step")) if steps else ""


def _limited(steps: int) -> Message | Literal[""]:
    return Message("at its limit in {steps}", steps=counted(steps, "step")) if steps else ""


def joint_table(
    label: str, joints: Sequence[JointRow], actuators: Sequence[ActuatorRow] = ()
) -> DataTable:
    """Return the table of a body's joints and actuators; each row has units of its own.

    An actuator on a single joint rate is shown in the row of that rate; an actuator on a tendon, a
    site or several rates has its own row.
    """
    single = {joint.name for joint in joints if joint.axis is None}
    rows = [
        *map(DriveRow.of_joint, joints),
        *(
            DriveRow.of_actuator(each)
            for each in actuators
            if each.acts_on != "joint" or each.target not in single
        ),
    ]
    names = [row.name for row in rows]
    column = min(max(map(columns_of, (label, *names))) + 2, LONGEST_JOINT)
    notes = zip(*(row.notes for row in rows), strict=True)
    return DataTable(
        [
            Column("", names, least=column - 1, most=column - 1),
            Column(Message("control"), [row.control for row in rows], least=CONTROL, gap=1),
            *_numbers(POSITIONS, rows, CELL, drop=-1),
            Column("", [row.unit for row in rows], gap=1),
            *_numbers(TORQUES, rows, FORCE, drop=3),
            Column("", [row.torque_unit for row in rows], gap=1, drop=2),
            *(Column("", [*each], fits=True) for each in notes),
        ],
        title=label,
    )


def _narrow(heads: str) -> Words:
    """Name the columns that were left out for lack of room."""
    return Words(Message("left out, for want of room: {heads}", heads=heads), "dim")


def _place(joint: JointRow) -> tuple[int, int]:
    return joint.index, joint.axis or 0


def _name(joint: JointRow) -> str:
    return joint.name if joint.axis is None else f"{joint.name} {'xyz'[joint.axis]}"


def _number(value: float | None, form: str) -> str:
    if value is None or not math.isfinite(value):
        return MISSING
    # What rounds to zero has no sign.
    text = format(value, form)
    text = text if len(text) < CELL else format(value, "+.2g" if form[0] == "+" else ".2g")
    return format(0.0, form) if not text.strip("+-0.") else text


Cells = Mapping[Message, Callable[[DriveRow], str]]
"""Function that returns a row's value for a column."""
POSITIONS: Cells = {
    Message("target"): lambda row: _number(row.target, ".3f"),
    Message("reached"): lambda row: _number(row.reached, ".3f"),
    Message("off"): lambda row: _number(row.off, "+.3f"),
}
"""Columns in the joint's unit: rad or m, or per second for a velocity motor."""
TORQUES: Cells = {
    Message("torque"): lambda row: _number(row.torque, ".1f"),
    Message("limit"): lambda row: _number(row.limit, ".4g"),
    Message("needs"): lambda row: _number(row.needs, ".1f"),
}
"""Columns in the unit of the joint's torque or force: N m or N."""


def _numbers(cells: Cells, rows: Sequence[DriveRow], least: int, *, drop: int) -> Iterator[Column]:
    """Yield columns whose order of removal counts up from `drop`; those up to 0 stay."""
    for place, (head, text) in enumerate(cells.items(), drop):
        yield Column(
            head, [*map(text, rows)], right=True, least=least - 1, gap=1, drop=max(0, place)
        )


# -- bodies ---------------------------------------------------------------------------------------


def _bodies(analysis: Analysis, moving: Sequence[BodyAnalysis]) -> Iterator[Block]:
    """Yield a line per body with mass, samples and energy, then the bodies that never moved."""
    column = min(max((columns_of(body.label) for body in moving), default=NAME) + 2, 30)
    yield Facts([Fact(body.label, _facts(body), "bold") for body in moving], column)
    moves = {body.id for body in moving}
    still = [body.label for body in analysis.bodies if body.id not in moves and not body.soft]
    if still:
        yield Facts([Fact(Message("still"), _first_of(still), "dim")], column)


def _not_said(moving: Sequence[BodyAnalysis], *, verbose: bool) -> Iterator[Block]:
    """Yield notes on unexplained samples, and on options that show more."""
    lacks = [
        Message(
            "{body}: {samples} from step {step} on: {reason}",
            body=body.label,
            samples=counted(run.samples, "unexplained sample"),
            step=run.first_step,
            reason=run.reason,
        )
        for body in moving
        for run in body.unexplained
    ]
    shown = lacks if verbose else lacks[:MOST_LACKS]
    if len(lacks) > len(shown):
        shown.append(Message("and {more} more: --verbose", more=len(lacks) - len(shown)))
    if shown:
        heads = [Message("not said"), *[""] * (len(shown) - 1)]
        yield Facts([*map(Fact, heads, shown)], LACKS)
    if not verbose and moving:
        more = Message("joints, energy, flights, contacts: --verbose, --body NAME, --at T, --json")
        yield Words(more, "dim")


def _first_of(labels: list[str]) -> str:
    return ", ".join(labels[:MOST_BODIES]) + (" …" if len(labels) > MOST_BODIES else "")


def _facts(body: BodyAnalysis) -> Message:
    mass: str = f"{body.mass_kg:.4g} kg"
    if len(body.links) > 1:
        mass = joined(", ", [mass, counted(len(body.links) - 1, "link")])
    facts = joined(": ", [mass, kinds_of_samples(body.segments)])
    if body.energy is None:
        return facts
    changes: str = f"{body.energy.start_j + 0.0:.4g} → {body.energy.end_j + 0.0:.4g} J"
    causes = sorted(body.energy.by_cause_j.items(), key=lambda cause: -abs(cause[1]))
    named = [
        Message("{joules} {cause}", joules=f"{value:+.3g}", cause=cause_in_words(name))
        for name, value in causes[:2]
        if abs(value) > 1e-9
    ]
    return joined("; ", [facts, joined(": ", [changes, joined(", ", named)]) if named else changes])


def sum_of(body: BodyAnalysis, each: StepSum) -> Section:
    """Return a step's sum of impulses: a line per degree of freedom, which lists the terms."""
    title = Message(
        "{body} at {time:.4g} s, step {step}: {segment}",
        body=body.label,
        time=each.time_s,
        step=each.step,
        segment=SEGMENTS[each.segment],
    )
    if each.terms is not None:
        title += Message("; impulses [N s], of rotations [N m s]")
    blocks: list[Block] = [Words(title, key=body.label)]
    if each.terms is not None and each.remainder is not None:
        base = len(each.remainder) > 5 and body.momentum
        heads = [*(("ωx", "ωy", "ωz", "vx", "vy", "vz") if base else ()), *map(_name, body.joints)]
        largest = max((abs(part) for term in each.terms.values() for part in term), default=0.0)
        rows = {
            name: [rounded_off(part, largest) for part in term] for name, term in each.terms.items()
        }
        rows["remainder"] = [*each.remainder]
        facts = [
            Fact(head, _sum({name: term[at] for name, term in rows.items()}))
            for at, head in enumerate(heads[: len(each.remainder)])
        ]
        blocks.append(Facts(facts, min(28, max(map(columns_of, heads), default=0) + 2)))
    if each.contact_by:
        blocks.append(Words(contact_by(each.contact_by), indent="  "))
    return Section(blocks)


def _sum(terms: Mapping[str, float]) -> Message:
    return joined(
        ", ",
        [
            Message("{term} {distance}", term=cause_in_words(name), distance=f"{value:+.3e}")
            for name, value in terms.items()
            if value
        ]
        or ["0"],
    )
