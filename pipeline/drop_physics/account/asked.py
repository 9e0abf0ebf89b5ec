"""Rows for joints that were commanded: a position, a velocity or a torque, and what resulted."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from drop_physics.account.balance import (
    JointBalance,
    forces_by_cause,
    holder_of,
    is_at_rest,
    since_target,
)
from drop_physics.account.ledger import OWN
from drop_physics.account.names import main_axis
from drop_physics.account.rows import AccountRow, magnitude
from drop_physics.account.series import JointSeries
from drop_physics.account.shaped import off_axle
from drop_physics.account.subjects import MeasuredBody
from drop_physics.account.terms import GAP, GIVEN, RATE, Term
from drop_physics.account.words import RowWords
from drop_physics.arrays import Flags, Float64, Int64
from drop_physics.explain.driving import strongest
from drop_physics.messages import Message
from drop_physics.physics.kinematics import kinematics
from drop_physics.quantities import number, quantity
from drop_physics.trace.events import Actuator, Joint

DRIVES = ("motors", GIVEN, GAP, RATE)
"""Causes that apply a joint's command; they come first among a row's terms."""
COMMANDED = (GIVEN, GAP, RATE)
"""Causes whose size a commanded torque or control sets, unlike that of the engine's default
motor."""
FEEBLE = 0.5
"""A torque that starts below this share of its maximum is reported with its maximum."""
FEW = 0.2
"""A torque that acts in less than this share of the steps is reported with their number."""
SELDOM = 0.02
"""A joint commanded in less than this share of the steps does not count as commanded."""
HOLD_STEPS, LATE = 5, 0.85
"""After a jump of the target, the gap counts in steps in which it is larger than at the jump, and
from the share LATE of the hold on, if the target stays the same for at least HOLD_STEPS."""
ROUND = 1e-9
ARRIVED = 0.01
"""Largest distance from a position at which a joint has arrived there: a share of the joint's
scale, in radians or of the body's size."""


@dataclass(frozen=True)
class Axis:
    """One degree of freedom of a joint."""

    joint: Joint
    name: str
    joint_rate: int
    """Index of the joint's rate among the rates of all joints."""
    rate: int
    """Index of the joint's rate in the generalised velocity u."""
    scale: float
    """Scale of a path: the size of the body [m] for a sliding joint, 1 rad for a revolute one."""

    @property
    def unit(self) -> str:
        """The unit of the joint's position."""
        return "m" if self.joint.kind == "prismatic" else "rad"

    @property
    def force_unit(self) -> str:
        """The unit of the joint's force or torque."""
        return "N" if self.joint.kind == "prismatic" else "N m"


def axes_of(subject: MeasuredBody, words: RowWords) -> Iterator[Axis]:
    """Yield the degrees of freedom of all joints of a body."""
    body, first = subject.body, subject.tree.first_rate
    for joint, place in zip(body.joints, body.rates, strict=True):
        for k in range(place.start, place.stop):
            scale = subject.size_m if joint.kind == "prismatic" else 1.0
            yield Axis(joint, words.names.rate(body, k), k, first + k, scale)


def position_row(
    subject: MeasuredBody,
    axis: Axis,
    series: JointSeries,
    words: RowWords,
    needs: float | None,
    stiffness: float | None = None,
) -> AccountRow | None:
    """Return the row for a joint with position targets: target, position reached, and causes.

    `needs` is the force or torque required to hold the last target [N] or [N m], None if unknown.
    `stiffness` is that of a controller in the script [N/m] or [N m/rad]; None if the engine's own
    motor or actuator controls the position.
    """
    k, steps = axis.joint_rate, series.steps
    target, after = series.target[:, k], series.after[:, k]
    known = np.isfinite(target)
    off = after - target
    gap = np.abs(off)
    counts = _counting(series.before[:, k], target, gap) & known & np.isfinite(gap)
    if not counts.any():
        return None
    at = _worst(gap, counts)
    last = int(np.flatnonzero(known)[-1])
    asked = max(float(np.ptp(target[known])), float(np.abs(target[known] - after[0]).max()))
    at = _telling(gap, counts, at, last)
    window = words.around(subject, int(steps[at]), len(series))
    sign = float(np.sign(target[at] - after[at])) or 1.0
    forces = subject.ledger.forces(axis.rate, window, sign)
    terms = words.terms(subject, forces, axis.force_unit, drives=DRIVES)
    near = slice(max(0, at - 2), at + 3)
    at_limit = bool(series.at_limit[near, k].mean() > 0.5)
    told = Message(
        "{asked}, got {got}",
        asked=quantity(float(target[at]), axis.unit),
        got=quantity(float(after[at]), axis.unit),
    )
    if target[at]:
        told = told + Message(" ({gap})", gap=quantity(float(off[at]), axis.unit, "+"))
    told = told + Message(" at {time}", time=words.time(subject, int(steps[at])))
    if stiffness is not None:
        unit = f"{axis.force_unit}/{axis.unit}"
        told = Message("by its control, {stiffness}: ", stiffness=quantity(stiffness, unit)) + told
    jumps = np.abs(np.diff(target[known])) > ROUND
    if len(jumps) > 10 and jumps.mean() > 0.5:
        told = told + Message(", while its target moves")
    if at == last:
        told = told + Message(", at the end")
    elif abs(off[last] - off[at]) < 0.02 * gap[at]:
        told = told + Message(", and at the end")
    else:
        told = told + Message("; {gap} at the end", gap=quantity(float(off[last]), axis.unit, "+"))
    if at_limit:
        limit = quantity(float(series.limit[at, k]), axis.force_unit)
        told = told + Message("; its drive at its limit of {limit}", limit=limit)
        if needs is not None and abs(needs) > series.limit[at, k]:
            holding = quantity(abs(needs), axis.force_unit)
            told = told + Message(", holding its target takes {needs}", needs=holding)
    told = told + (turned_axis(subject, axis) if axis.unit == "m" else Message(""))
    salience = float(gap[at]) / axis.scale / (asked / axis.scale + 0.1)
    row = at if is_at_rest(series, k, since_target(series, k, at), at) else last
    since, around = (
        since_target(series, k, row),
        words.around(subject, int(steps[row]), len(series)),
    )
    towards = subject.ledger.forces(axis.rate, around, float(np.sign(target[row] - after[row])))
    holder, held = holder_of(towards)
    balance = JointBalance(
        joint_rate=k,
        goal=float(target[row]),
        gap=float(off[row]),
        ends=row == last,
        rests=is_at_rest(series, k, since, row),
        at_limit=bool(series.at_limit[row, k]),
        limited=float(series.at_limit[since : row + 1, k].mean()),
        limit=float(series.limit[row, k]),
        needs=needs,
        forces=forces_by_cause(towards, {term: words.drives(term, DRIVES) for term in towards}),
        fixed=subject.tree.fixed,
        holder=holder,
        held=held,
    )
    return AccountRow(
        kind="asked",
        joint=axis.name,
        told=told,
        asked=float(target[at]),
        got=float(after[at]),
        gap=float(off[at]),
        unit=axis.unit,
        step=int(steps[at]),
        at_limit=at_limit,
        terms=terms,
        mean=words.mean(subject, axis.rate, window),
        salience=salience,
        subject=subject.body,
        group=("position", subject.kind, words.opposing(forces), magnitude(salience)),
        gives_j=given_j(subject, axis, words),
        cause="position",
        span=(int(steps[since]), int(steps[row]), row - since + 1),
        noted={"balance": balance},
    )


def ignored_row(
    subject: MeasuredBody,
    axis: Axis,
    series: JointSeries,
    words: RowWords,
    target: float,
    line: str,
) -> AccountRow | None:
    """Return the row for a joint whose motor turns at a rate, and ignores a position given to it.

    `target` is the position, and `line` the script line that gives it. A joint that arrives there
    nevertheless has no row.
    """
    got, rate = float(series.after[-1, axis.joint_rate]), series.asked_rate[-1, axis.joint_rate]
    if abs(got - target) <= ARRIVED * axis.scale or not np.isfinite(rate):
        return None
    step = int(series.steps[-1])
    return AccountRow(
        kind="asked",
        joint=axis.name,
        told=Message(
            "{asked}, got {got} at {time}, at the end: {line} commands a rate, {rate}, and ignores "
            "the position",
            asked=quantity(target, axis.unit),
            got=quantity(got, axis.unit),
            time=words.time(subject, step),
            line=line,
            rate=quantity(float(rate), f"{axis.unit}/s"),
        ),
        asked=target,
        got=got,
        gap=got - target,
        unit=axis.unit,
        step=step,
        salience=abs(got - target) / axis.scale / (abs(target) / axis.scale + 0.1),
        subject=subject.body,
        group=("ignored", subject.kind, line),
    )


def rate_row(
    subject: MeasuredBody, axis: Axis, series: JointSeries, words: RowWords
) -> AccountRow | None:
    """Return the row for a joint with a velocity motor: commanded and reached velocity."""
    k, steps = axis.joint_rate, series.steps
    asked, rate = series.asked_rate[:, k], series.rate[:, k]
    known = np.isfinite(asked)
    timestep_s = words.timesteps_s(subject, steps)
    missed = np.where(known, rate - asked, 0.0)
    missed = np.where(np.isfinite(missed), missed, 0.0)
    lost = np.cumsum(missed * timestep_s)
    wanted = np.cumsum(np.where(known, asked, 0.0) * timestep_s)
    came = float(np.where(known, np.nan_to_num(rate), 0.0) @ timestep_s)
    width = max(3, len(series) // 20)
    mean = np.convolve(missed, np.ones(width) / width, "same")
    at = int(np.argmax(np.abs(mean)))
    spell = slice(max(0, at - width // 2), min(len(series), at + width // 2 + 1))
    window = subject.ledger.window(int(steps[spell][0]), int(steps[spell][-1]))
    aim = float(np.nanmean(asked[spell])) if known[spell].any() else 0.0
    sign = float(np.sign(aim)) or 1.0
    forces = subject.ledger.forces(axis.rate, window, sign)
    got = float(np.mean(rate[spell]))
    at_limit = bool(series.at_limit[spell, k].mean() > 0.5)
    told = Message(
        "{asked}, got {got} on average from {start} to {end}; {wanted} in all, got {came}",
        asked=quantity(aim, f"{axis.unit}/s"),
        got=quantity(got, f"{axis.unit}/s"),
        start=words.time(subject, int(steps[spell][0])),
        end=words.time(subject, int(steps[spell][-1])),
        wanted=quantity(float(wanted[-1]), axis.unit),
        came=quantity(came, axis.unit),
    )
    if at_limit:
        told = told + Message("; its drive at its limit")
    along, off = axis_at_end(subject, axis), off_axle(subject, axis.joint)
    told = told + Message("; axis along the world's {axis} at the end", axis=along) + off
    return AccountRow(
        kind="asked",
        joint=axis.name,
        told=told,
        asked=aim,
        got=got,
        gap=got - aim,
        unit=f"{axis.unit}/s",
        step=int(steps[at]),
        at_limit=at_limit,
        terms=words.terms(subject, forces, axis.force_unit, drives=DRIVES),
        mean=words.mean(subject, axis.rate, window),
        salience=float(np.abs(lost).max()) / (float(np.abs(wanted).max()) + 0.1 * axis.scale),
        subject=subject.body,
        group=("rate", subject.kind, round(aim, 3), along, str(off), words.opposing(forces)),
        gives_j=given_j(subject, axis, words),
    )


def torque_row(
    subject: MeasuredBody,
    axis: Axis,
    series: JointSeries,
    words: RowWords,
    actuators: Mapping[Actuator, Float64],
) -> AccountRow | None:
    """Return the row for a joint with a commanded torque: what the torque worked against.

    `actuators` maps the actuators on the joint to their controls, shape (n,) each.
    """
    ledger, k, steps = subject.ledger, axis.joint_rate, series.steps
    drive = sum(
        (
            ledger.impulse[term][:, axis.rate]
            for term in ledger.impulse
            if words.drives(term, COMMANDED)
        ),
        start=np.zeros(ledger.bins),
    )
    acting = np.flatnonzero(np.abs(drive) > ROUND * max(np.abs(drive).max(), 1e-300))
    if not len(acting) or not ledger.seconds[acting].any():
        return None
    balance = drive.copy()
    for cause in ("gravity", "spring", "gravity compensation"):
        if Term(cause) in ledger.impulse:
            balance = balance + ledger.impulse[Term(cause)][:, axis.rate]
    begins, is_broken = int(acting[0]), False
    if np.abs(balance[acting[:3]]).max() < 0.05 * np.abs(drive[acting[:3]]).max():
        broken = acting[np.abs(balance[acting]) > 0.1 * np.abs(drive[acting]).max()]
        if len(broken) and Term("gravity") in ledger.impulse:
            begins, is_broken = int(broken[0]), True
    lasts = max(3, len(acting) // 50)
    window = slice(begins, begins + lasts)
    forces = ledger.forces(axis.rate, window)
    given = sum(force for term, force in forces.items() if words.drives(term, COMMANDED))
    sign = float(np.sign(given)) or 1.0
    forces = {term: force * sign for term, force in forces.items()}
    after = series.after[:, k]
    start = float(series.before[0, k])
    ways = np.nan_to_num(after - start)
    if not np.isfinite(start):
        ways = np.cumsum(series.rate[:, k] * words.timesteps_s(subject, steps))
    moved = float(ways[np.argmax(np.abs(ways))])
    way = abs(moved)
    took = -sum(f for term, f in forces.items() if f < 0 and term is not OWN and term != OWN)
    cancelled = min(1.0, took / max(abs(given), 1e-12))
    told = _controls(actuators, axis.joint.widths[1]) + Message(
        "moved {way}", way=quantity(moved, axis.unit, "+")
    )
    if forces:
        mean = {
            "force": quantity(given, axis.force_unit, "+" if given else ""),
            "steps": int(ledger.counts[window].sum()),
            "time": words.time(subject, ledger.first + begins * ledger.width),
        }
        told = told + (
            Message("; balanced until {time}, then {force} as the mean of {steps:,} steps", **mean)
            if is_broken
            else Message("; from {time} on {force} as the mean of {steps:,} steps", **mean)
        )
        known = ledger.seconds > 0
        most = float(np.max(np.abs(drive[known]) / ledger.seconds[known]))
        if abs(given) < FEEBLE * most:
            told = told + Message(", at most {most}", most=quantity(most, axis.force_unit))
            if not ledger.covers(ledger.window(ledger.first, ledger.last)):
                told = told + Message(" in the steps that are explained")
        if ledger.width == 1 and len(acting) < FEW * len(series):
            told = told + Message(
                "; it acts in {acting:,} of {steps:,} steps", acting=len(acting), steps=len(series)
            )
    still = way / axis.scale < 0.1
    step = ledger.first + begins * ledger.width
    return AccountRow(
        kind="given",
        joint=axis.name,
        told=told,
        asked=abs(given),
        got=-forces.get(OWN, 0.0) if forces else None,
        unit=axis.force_unit,
        step=step,
        terms=words.terms(subject, forces, axis.force_unit, drives=COMMANDED),
        mean=words.mean(subject, axis.rate, window),
        salience=max(min(way / axis.scale, 1.0) * 0.6, cancelled * 0.7 if still else 0.0),
        subject=subject.body,
        group=("torque", subject.kind, words.opposing(forces), still),
        gives_j=given_j(subject, axis, words),
    )


def given_j(subject: MeasuredBody, axis: Axis, words: RowWords) -> float:
    """Return the energy that motors and actuators gave a joint in all explained steps [J]."""
    works = subject.ledger.work
    driven = (works[term][:, axis.rate] for term in works if words.drives(term, DRIVES))
    return sum((float(work[work > 0].sum()) for work in driven), start=0.0)


def _controls(actuators: Mapping[Actuator, Float64], width: int) -> Message:
    """Describe the script's controls for a joint, and the force after clamping and gear."""
    told = Message("")
    for actuator, given in actuators.items():
        if not np.isfinite(given).any():
            continue
        most = strongest(given)
        told = told + Message("ctrl {given}", given=number(most))
        if actuator.ctrl_range is not None:
            clipped = float(np.clip(most, *actuator.ctrl_range))
            if clipped != most:
                told = told + Message(" clamped to {clipped}", clipped=number(clipped))
        if actuator.gear != 1 and width == 1:  # those of a ball's three axes are not recorded
            told = told + Message(" × gear {gear}", gear=number(actuator.gear))
        told = told + Message("; ")
    return told


def clamped_rows(
    subject: MeasuredBody, controls: Mapping[Actuator, Float64], steps: Int64
) -> Iterator[AccountRow]:
    """Yield a row for each actuator whose control was outside its range in some steps."""
    for actuator, given in controls.items():
        if actuator.ctrl_range is None or not np.isfinite(given).any():
            continue
        low, high = actuator.ctrl_range
        below: Flags = given < low - 1e-12
        above: Flags = given > high + 1e-12
        outside = below | above
        if not outside.any():
            continue
        at = int(np.nanargmax(np.where(outside, np.abs(given), 0.0)))
        asked, got = float(given[at]), float(np.clip(given[at], low, high))
        yield AccountRow(
            kind="asked",
            actuator=actuator.name,
            told=_clamped(actuator, asked, int(below.sum()), int(above.sum()), len(given)),
            asked=asked,
            got=got,
            gap=got - asked,
            unit="",
            step=int(steps[at]),
            salience=0.9 * abs(asked - got) / max(abs(asked), 1e-12) + 0.3 * float(outside.mean()),
            subject=subject.body,
            group=("clamped", subject.kind, round(asked, 6)),
        )


def _clamped(actuator: Actuator, asked: float, below: int, above: int, steps: int) -> Message:
    """Describe in how many steps a control is clamped to the ends of its range."""
    assert actuator.ctrl_range is not None
    low, high = actuator.ctrl_range
    got, most, least = (high, above, below) if asked > high else (low, below, above)
    known = {"asked": number(asked), "got": number(got), "of": steps, "steps": most}
    if least:
        return Message(
            "ctrl {asked}, clamped to {got} in {steps:,} and to {other} in {least:,} of {of:,} "
            "steps",
            **known,
            other=number(low if asked > high else high),
            least=least,
        )
    return Message(
        "ctrl {asked}, clamped to {got} by its range {low} to {high} in {steps:,} of {of:,} steps",
        **known,
        low=number(low),
        high=number(high),
    )


def _counting(before: Float64, target: Float64, gap: Float64) -> Flags:
    """Flag the steps in which a gap counts as an error, not as the way to a new target, shape (n,).

    After a jump of the target, steps count while the gap is larger than at the jump, and in the
    last part of the time until the next jump. If the target moves in more than 30 % of the steps,
    steps count from the first one whose gap is at most the median gap.
    """
    counts = np.ones(len(target), np.bool_)
    jumped = np.ones(len(target), np.bool_)
    jumped[1:] = (target[1:] != target[:-1]) & np.isfinite(target[1:])
    starts = np.flatnonzero(jumped)
    holds = np.diff(starts, append=len(target))
    held = holds >= HOLD_STEPS
    began, hold = (np.repeat(each[held], holds[held]) for each in (starts, holds))
    its = np.flatnonzero(np.repeat(held, holds))
    away = gap[its] > np.abs(before[began] - target[began]) * 1.02 + ROUND
    counts[its] = away | (its - began >= LATE * hold)
    if jumped.mean() > 0.3 and np.isfinite(gap).any():
        near = np.flatnonzero(gap <= np.nanmedian(gap) * 1.001 + 1e-12)
        counts[: int(near[0])] = False
    return counts


def _worst(gap: Float64, counts: Flags) -> int:
    """Return the step with the largest gap or, if that is a spike, the first typical large gap."""
    limit = float(np.percentile(gap[counts], 98))
    large = np.flatnonzero(counts & (gap >= limit * 0.999))
    at = int(large[np.argmax(gap[large])])
    return at if gap[at] <= 3 * limit else int(large[np.argsort(gap[large])[0]])


def _telling(gap: Float64, counts: Flags, worst: int, last: int) -> int:
    """Return the step to report: the end, if the gap there is steady and nearly the largest.

    A hold is described by its steady part, not by the bounce that precedes it.
    """
    tail = slice(max(0, last - max(10, len(gap) // 10)), last + 1)
    steady = float(np.ptp(gap[tail])) < 0.1 * float(gap[last]) + ROUND
    return last if counts[last] and steady and gap[last] >= 0.5 * gap[worst] else worst


def axes_in_world(subject: MeasuredBody, axis: Axis) -> tuple[Float64, Float64] | None:
    """Return a joint's axis at start and end of a recording, as unit vectors in world axes."""
    ledger = subject.ledger
    known = np.flatnonzero(ledger.counts)
    if not len(known):
        return None
    kin = kinematics(ledger.tree, ledger.ends.at(known[[0, -1]]))
    along = kin.axes[axis.joint.link][axis.joint_rate - subject.body.rates[axis.joint.link].start]
    lengths = np.linalg.norm(along, axis=0)
    return None if not lengths.all() else (along[:, 0] / lengths[0], along[:, 1] / lengths[1])


def axis_at_end(subject: MeasuredBody, axis: Axis) -> str:
    """Return the world axis nearest to a joint's axis at the end."""
    axes = axes_in_world(subject, axis)
    return "?" if axes is None else main_axis(axes[1])


def turned_axis(subject: MeasuredBody, axis: Axis) -> Message:
    """Describe where a joint's axis points at start and end, if it turned; else nothing."""
    axes = axes_in_world(subject, axis)
    if axes is None:
        return Message("")
    first, end = axes
    if np.arccos(np.clip(first @ end, -1.0, 1.0)) < 0.5:
        return Message("")
    return Message(
        "; its axis is {first} at first, {end} at the end",
        first=main_axis(first),
        end=main_axis(end),
    )
