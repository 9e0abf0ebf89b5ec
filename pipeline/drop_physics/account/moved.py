"""Rows for motion that nothing commanded, and for bodies that were pushed but did not move."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drop_physics.account.asked import COMMANDED, Axis, axis_at_end, turned_axis
from drop_physics.account.ledger import OWN, Ledger, given_and_taken
from drop_physics.account.rows import AccountRow, RowTerm, magnitude
from drop_physics.account.series import BaseTrack, JointSeries
from drop_physics.account.shaped import mass_outside, too_inert
from drop_physics.account.starting import (
    base_at_start,
    pushed_askew,
    spins_at_start,
    starts_beyond,
    turned_at_start,
)
from drop_physics.account.subjects import MeasuredBody
from drop_physics.account.terms import CONTACT, FRICTION, HELD, Term
from drop_physics.account.words import LEAST_SHARE, RowWords
from drop_physics.account.written import WrittenStates
from drop_physics.arrays import Flags, Float64
from drop_physics.messages import Message
from drop_physics.quantities import number, quantity

MOVED = 0.01
"""A displacement below this share of the body's size, or below this angle [rad], is no motion."""
TURNED_RAD = 0.03
APPLIED = Term("applied")
UPRIGHT = 0.999
"""Cosine above which gravity counts as parallel to an axis."""
LITTLE = 0.1
"""Energy given by forces below this share of that of the mean motion, or of the losses, does not
explain the motion."""
BEGUN = 0.01
"""Share of a turn above which the turn counts as begun."""
STEADY = 0.5
"""A push that acts in less than this share of the steps, or alternates, has no meaningful mean
force."""
STRAINED = 1e-3
"""Share of the body's weight, times its size for a torque, above which the engine's motor counts as
holding a joint."""
ROUND = 1e-6
"""Share of the `STRAINED` threshold below which a force counts as zero."""
RESTS, ODD_ONE = 0.2, 0.9
"""Salience of a joint that stays where it is, and of one whose motor alone is left on."""
LARGE_M = 10.0
"""Size above which a body is reported with its size and mass: most models are in metres."""
FALL = 5.0
"""Number of body sizes below which a fall driven by gravity alone is ordinary."""


def joint_row(
    subject: MeasuredBody, axis: Axis, series: JointSeries, coupled: Message, words: RowWords
) -> AccountRow | None:
    """Return the row for a joint that was not commanded: how it moved, and why.

    `coupled` describes the equality by which it follows another joint, if there is one.
    """
    k, ledger = axis.joint_rate, subject.ledger
    after = series.after[:, k]
    start = float(series.before[0, k])
    if not np.isfinite(start):  # a spherical joint has no single angle
        timestep_s = words.timesteps_s(subject, series.steps)
        after, start = np.cumsum(series.rate[:, k] * timestep_s), 0.0
    way = np.nan_to_num(np.abs(after - start))
    at = int(np.argmax(way))
    step = int(series.steps[at])
    held = series.controlled("default", "unknown")[:, k].mean() > 0.5
    driven = [
        term.cause
        for term in ledger.impulse
        if term.cause.startswith("actuator ") and ledger.impulse[term][:, axis.rate].any()
    ]
    if way[at] / axis.scale < LITTLE and APPLIED in ledger.impulse:
        pushed = _Pushed(axis.rate, axis.name, axis.unit, axis.force_unit)
        row = _held(subject, pushed, float(way[at]), step, words)
        if row is not None:
            return row
    if way[at] / axis.scale <= MOVED:
        return None if driven else _resting(subject, axis, series, start, words, held=held)
    gave, took = given_and_taken(ledger.works([axis.rate], ledger.window(ledger.first, step)))
    if subject.body.node_of:
        why = _elastic(subject, float(words.timesteps_s(subject, series.steps[-1:])[0]))
    elif driven:
        why = Message("driven by {actuator}", actuator=driven[0])
    elif np.isfinite(series.asked_rate[:, k]).any():
        why = Message("told to stand")
    elif held and axis.joint.kind == "spherical":
        why = Message("no call commands it: the engine's own motor holds its pose at 0")
    elif held:
        limit = float(np.nanmax(series.limit[:, k]))
        why = Message(
            "no call commands it: the engine's own motor holds its rate at 0 with {limit} at most",
            limit=quantity(limit, axis.force_unit),
        )
    elif series.switched_off[:, k].mean() > 0.5:
        why = Message("its motor is off: the force that a call gives it is 0")
    elif APPLIED in ledger.impulse and ledger.impulse[APPLIED][:, axis.rate].any():
        why = Message("no motor commands it; the script pushes it")
    elif any(each.cause == HELD and of[:, axis.rate].any() for each, of in ledger.impulse.items()):
        why = Message("no motor commands it; a constraint acts on it") + coupled
    elif subject.body.actuators and not ledger.seconds.any():
        why = Message("what drives it is not known, as no step is explained")
    elif axis.joint.kind == "spherical":
        why = Message("no target of its motor is known")
    else:
        why = Message("nothing commands it")
    why = why + starts_beyond(axis.joint, start, axis.unit)
    why = why + _mimicked(subject, axis) + _reached(subject, axis) + _undamped(subject, axis)
    return AccountRow(
        kind="moved",
        joint=axis.name,
        told=Message(
            "{start} to {end} at {time}; {why}",
            start=quantity(start, axis.unit),
            end=quantity(float(after[at]), axis.unit),
            time=words.time(subject, step),
            why=why,
        ),
        asked=start,
        got=float(after[at]),
        gap=float(after[at]) - start,
        unit=axis.unit,
        step=step,
        terms=_works(subject, gave, took, words),
        salience=float(way[at]) / axis.scale * 0.8,
        subject=subject.body,
        group=("moved", axis.unit, subject.kind, _most(gave), magnitude(way[at] / axis.scale)),
    )


def _resting(
    subject: MeasuredBody,
    axis: Axis,
    series: JointSeries,
    start: float,
    words: RowWords,
    *,
    held: bool,
) -> AccountRow | None:
    """Return the row for a joint that no call commands and that stays where it is.

    A joint has a row if the engine's own motor holds it (`held`) against other forces, or if a call
    has switched the motor off and no force acts along the joint nevertheless.
    """
    k, ledger = axis.joint_rate, subject.ledger
    whole = ledger.window(ledger.first, ledger.last)
    forces = ledger.forces(axis.rate, whole)
    works = ledger.impulse.get(Term("motors"), np.zeros((ledger.bins, axis.rate + 1)))
    # Along with what swings, its sign changes, and the mean says little.
    motor = float(np.abs(works[:, axis.rate]).sum()) / (float(ledger.seconds.sum()) or np.inf)
    others = sum(abs(force) for term, force in forces.items() if term.cause != "motors")
    least = STRAINED * subject.weight_n * axis.scale
    switched_off = series.switched_off.mean(axis=0) > 0.5
    off, unmoved, loose = switched_off[k], motor + others < ROUND * least, int(switched_off.sum())
    if not (held and motor > least) and not (off and unmoved and not subject.is_weightless):
        return None
    if held:
        told = Message(
            "stays at {start}: no call commands it, and the engine's own motor holds its rate at 0 "
            "with {motor} on average, {limit} at most",
            start=quantity(start, axis.unit),
            motor=quantity(motor, axis.force_unit),
            limit=quantity(float(np.nanmax(series.limit[:, k])), axis.force_unit),
        )
        if loose:
            told = told + Message("; calls switch off the motors of {loose} others", loose=loose)
    else:
        told = Message(
            "stays at {start}: its motor is off, and no force acts along it, gravity included; "
            "axis along the world's {axis}",
            start=quantity(start, axis.unit),
            axis=axis_at_end(subject, axis),
        )
    return AccountRow(
        kind="held",
        joint=axis.name,
        told=told,
        got=start,
        unit=axis.unit,
        step=ledger.last,
        terms=words.terms(subject, forces, axis.force_unit) if held else (),
        mean=words.mean(subject, axis.rate, whole),
        salience=ODD_ONE if held and loose else RESTS,
        subject=subject.body,
        group=("resting", subject.kind, held),
    )


def _elastic(subject: MeasuredBody, timestep_s: float) -> Message:
    """Describe the natural frequencies of an elastic body, and the timestep's stability limit.

    An explicit step of duration h, which takes v from the forces at its start and x from the new
    v, is stable up to the frequency ω with ω² h (h + 2 β) = 4, where β is the damping.
    """
    told = Message("its elasticity moves it")
    if not subject.body.elastic:
        return told
    highest, *damping_s = subject.body.elastic
    told = told + Message(
        ", with natural frequencies of up to {highest}", highest=quantity(highest, "rad/s")
    )
    for damping in damping_s:
        most = 2 / np.sqrt(timestep_s * (timestep_s + 2 * damping))
        told = told + Message(
            "; an explicit step of {timestep} is stable up to {most}",
            timestep=quantity(timestep_s, "s"),
            most=quantity(float(most), "rad/s"),
        )
    return told


def _mimicked(subject: MeasuredBody, axis: Axis) -> Message:
    """Describe which joint a joint should follow according to its file (`mimic`), or nothing."""
    for each in subject.body.asked.mimics:
        if each.joint == axis.joint.name:
            return Message(
                "; its file says that it follows {ratio} × {other}",
                ratio=number(each.multiplier),
                other=each.of,
            )
    return Message("")


def _undamped(subject: MeasuredBody, axis: Axis) -> Message:
    """Describe a joint damping that its file states but the engine does not apply, or nothing."""
    works = subject.ledger.work.get(Term("joint damping"))
    if works is not None and works[:, axis.rate].any():
        return Message("")
    for each in subject.body.asked.dampings:
        if each.joint == axis.joint.name and each.damping != axis.joint.damping:
            return Message(
                "; its file gives it a damping of {asked}, the engine has {got}",
                asked=number(each.damping),
                got=number(axis.joint.damping),
            )
    return Message("")


def _reached(subject: MeasuredBody, axis: Axis) -> Message:
    """Describe the first and last force that calls applied along a joint, if it changed."""
    ledger = subject.ledger
    if APPLIED not in ledger.impulse:
        return Message("")
    acting = np.flatnonzero(ledger.impulse[APPLIED].any(axis=1))
    few = max(1, len(acting) // 20)
    ends = [slice(int(part[0]), int(part[-1]) + 1) for part in (acting[:few], acting[-few:])]
    first, last = (ledger.forces(axis.rate, end).get(APPLIED, 0.0) for end in ends)
    if abs(first - last) <= 0.5 * max(abs(first), abs(last)):
        return Message("")
    told = Message(
        "; the applied force gives it {first} at first, {last} in the last steps in which it acts",
        first=quantity(first, axis.force_unit, "+"),
        last=quantity(last, axis.force_unit, "+"),
    )
    return told + turned_axis(subject, axis)


@dataclass(frozen=True)
class _Pushed:
    """A degree of freedom on which a force acts although it hardly moves."""

    rate: int
    """Index of the rate in the generalised velocity."""
    joint: str | None
    """Name of the joint; None for a free base."""
    unit: str
    """Unit of the position."""
    force_unit: str
    """Unit of the force."""


def _held(
    subject: MeasuredBody, pushed: _Pushed, way: float, step: int, words: RowWords
) -> AccountRow | None:
    """Return the row for what holds a degree of freedom that is pushed; None if it moves."""
    ledger = subject.ledger
    given = ledger.impulse[APPLIED][:, pushed.rate]
    acting = np.flatnonzero(given)
    if not len(acting) or abs(given.sum()) < STEADY * np.abs(given).sum():
        return None
    window = slice(int(acting[0]), int(acting[-1]) + 1)
    if len(acting) < STEADY * (window.stop - window.start):
        return None
    forces = ledger.forces(pushed.rate, window)
    if not forces:
        return None
    push = forces.get(APPLIED, 0.0)
    forces = {term: force * (float(np.sign(push)) or 1.0) for term, force in forces.items()}
    against = -sum(force for force in forces.values() if force < 0)
    return AccountRow(
        kind="held",
        joint=pushed.joint,
        told=Message(
            "pushed with {push}, moved {way}",
            push=quantity(abs(push), pushed.force_unit),
            way=quantity(way, pushed.unit),
        ),
        asked=abs(push),
        got=-forces.get(OWN, 0.0),
        unit=pushed.force_unit,
        step=step,
        terms=words.terms(subject, forces, pushed.force_unit),
        mean=words.mean(subject, pushed.rate, window),
        salience=0.5 * min(1.0, against / max(abs(push), 1e-12)),
        subject=subject.body,
        group=("held", subject.kind, words.opposing(forces)),
    )


def base_rows(
    subject: MeasuredBody,
    track: BaseTrack,
    gravity_m_s2: Float64,
    written: WrittenStates,
    commanded: Message,
    words: RowWords,
    *,
    w_first: bool,
) -> Iterator[AccountRow]:
    """Yield rows for the path and the rotation of a floating base, with the terms behind them.

    `written` are the states that the script wrote; `commanded` describes joint commands that turn
    the base; `w_first` says whether the engine's quaternions begin with w.
    """
    way = track.farthest_m - track.start_m
    distance = float(np.linalg.norm(way))
    row = None
    if distance / subject.size_m < LITTLE and APPLIED in subject.ledger.impulse:
        push = subject.ledger.impulse[APPLIED][:, 3:6].sum(axis=0)
        pushed = _Pushed(3 + int(np.argmax(np.abs(push))), None, "m", "N")
        row = _held(subject, pushed, distance, max(track.farthest_step, 1), words)
    rows = [] if row is None else [row]
    if not rows and distance / subject.size_m > MOVED and track.farthest_step >= 0:
        rows += _ways(subject, track, way, gravity_m_s2, written, words)
    frame = words.names.base_frame(subject.body.number)
    base = base_at_start(track.start_orientation, frame)
    if track.most_turned_rad > TURNED_RAD:
        turn = _turn(subject, track, written, base, words)
        rows.append(replace(turn, told=turn.told + commanded))
    started = turned_at_start(base, w_first=w_first) + too_inert(subject)
    if APPLIED in subject.ledger.impulse:
        push = subject.ledger.impulse[APPLIED][:, 3:6].sum(axis=0)
        started = started + pushed_askew(base, push)
    started = started + _size(subject) + _untouched(subject, track, gravity_m_s2)
    first = max(rows, key=lambda each: each.salience, default=None)
    for each in rows:
        yield replace(each, told=each.told + started) if each is first and started else each


def _size(subject: MeasuredBody) -> Message:
    """Describe the size and the mass of a body that is larger than usual, or nothing."""
    if subject.size_m <= LARGE_M:
        return Message("")
    size, mass = quantity(subject.size_m, "m"), quantity(subject.mass_kg, "kg")
    return Message("; it is {size} long and has {mass}", size=size, mass=mass)


def _untouched(subject: MeasuredBody, track: BaseTrack, gravity_m_s2: Float64) -> Message:
    """Describe the height from which a body without contacts falls, or nothing."""
    ledger, pull = subject.ledger, float(np.linalg.norm(gravity_m_s2))
    causes = {term.cause for term in ledger.impulse}
    if not pull or causes & {CONTACT, "contacts", HELD, *COMMANDED, APPLIED.cause}:
        return Message("")
    up = -gravity_m_s2 / pull
    fell_m = float((track.start_m - track.farthest_m) @ up)
    whole = ledger.window(ledger.first, ledger.last)
    if fell_m < FALL * subject.size_m or not ledger.covers(whole):
        return Message("")
    height = quantity(float(track.start_m @ up), "m")
    return Message("; it falls from a height of {height} and touches nothing", height=height)


def _ways(
    subject: MeasuredBody,
    track: BaseTrack,
    way: Float64,
    gravity_m_s2: Float64,
    written: WrittenStates,
    words: RowWords,
) -> Iterator[AccountRow]:
    # Slanted gravity makes no axis the upright one, and the displacement stays in one part.
    upright = np.abs(gravity_m_s2) > UPRIGHT * np.linalg.norm(gravity_m_s2)
    far, sideways = float(np.linalg.norm(way)), float(np.linalg.norm(way * ~upright))
    main = ~upright if 2 * sideways**2 > far**2 else upright
    first = _way(subject, track, way, main, written, words)
    fell = bool(main[upright].any()) and _most_given(first) == "gravity"
    short = fell and far < FALL * subject.size_m
    apart = fell and sideways / subject.size_m > 0.02
    if apart:  # a row of its own
        first = _way(subject, track, way * upright, upright, written, words)
    yield replace(first, salience=far / subject.size_m * (0.25 if short else 0.6))
    if apart:
        aside = _way(subject, track, way * ~upright, ~upright, written, words)
        yield replace(aside, salience=sideways / subject.size_m * 0.6)


def _way(
    subject: MeasuredBody,
    track: BaseTrack,
    way: Float64,
    axes: Flags,
    written: WrittenStates,
    words: RowWords,
) -> AccountRow:
    """Return the row for a base's path, along the world axes given in `axes`."""
    ledger, step, main = subject.ledger, track.farthest_step, way * axes
    window = ledger.window(track.first_step, step)
    rates = [3 + int(k) for k in np.flatnonzero(axes)]
    gave, took = given_and_taken(ledger.works(rates, window))
    far, axis = float(np.linalg.norm(way)), int(np.argmax(np.abs(main)))
    stepped_m, size_m = ledger.way[window, 3:6].sum(axis=0) * axes, float(np.linalg.norm(main))
    put = bool(written.written) and ledger.covers(window)
    put = put and float(np.linalg.norm(main - stepped_m)) > LITTLE * size_m
    besides = way - main
    told = Message("{way}", way=_along_axes(main, far))
    if np.linalg.norm(besides) > 0.1 * far:
        told = told + Message(" (and {besides})", besides=_along_axes(besides, far))
    told = told + Message(" by {time}", time=words.time(subject, step))
    if put:
        told = told + Message(
            "; the script wrote its state, steps move it by {stepped}",
            stepped=_along_axes(stepped_m, size_m)
            or quantity(float(stepped_m @ main) / size_m, "m", "+"),
        )
        if written.stopped > STEADY * written.written:
            told = told + Message("; {count:,} of these writes stop it", count=written.stopped)
        if 2 * stepped_m @ main < size_m**2:
            gave, took = {}, {}
    else:
        told = told + _from_start(ledger, rates, window, written, step)
    return AccountRow(
        kind="moved",
        told=told,
        got=far,
        unit="m",
        step=step,
        terms=_works(subject, gave, took, words),
        subject=subject.body,
        group=("base", subject.kind, _most(gave), axis, main[axis] > 0, magnitude(far)),
    )


def _from_start(
    ledger: Ledger, rates: Sequence[int], window: slice, written: WrittenStates, step: int
) -> Message:
    """Describe the initial or written velocity that a motion comes from, or nothing."""
    gave, took = given_and_taken(ledger.works(rates, window))
    moving_j = max(ledger.mean_kinetic_j(rates, window), -sum(took.values(), start=0.0))
    if not ledger.covers(window) or sum(gave.values()) >= LITTLE * moving_j:
        return Message("")
    if written.first_step is not None and written.first_step <= step:
        return Message("; no force gives it that: the script wrote its state")
    return Message("; no force gives it that: its start velocity")


def _along_axes(way: Float64, far: float) -> str:
    """Return the components of a path along the world's axes, without small ones."""
    large = [k for k in range(3) if abs(way[k]) > 0.1 * far]
    return ", ".join(f"{'xyz'[k]} {quantity(float(way[k]), 'm', '+')}" for k in large)


def _turn(
    subject: MeasuredBody,
    track: BaseTrack,
    written: WrittenStates,
    base: Float64 | None,
    words: RowWords,
) -> AccountRow:
    """Return the row for a base's rotation; `base` is the orientation of its axes at the start."""
    ledger, step, angle_rad = subject.ledger, track.most_turned_step, track.most_turned_rad
    spun_rad = float(np.linalg.norm(track.most_spun_rad))
    if spun_rad > np.pi and not written.way.any():
        step, angle_rad = track.most_spun_step, spun_rad
    window = ledger.window(track.first_step, step)
    gave, took = given_and_taken(ledger.works([0, 1, 2], window))
    axis = int(np.argmax(np.abs(track.most_spun_rad)))
    told = Message(
        "{angle}°, mostly about {axis}, by {time}",
        angle=number(float(np.degrees(angle_rad))),
        axis="xyz"[axis],
        time=words.time(subject, step),
    )
    if track.end_rad_s > 0.05:
        told = told + Message("; still {spin} rad/s at the end", spin=number(track.end_rad_s))
    if unforced := _from_start(ledger, [0, 1, 2], window, written, step):
        told = told + unforced
        least_j = ROUND * ledger.mean_kinetic_j([0, 1, 2], window)
        gave, took = (
            {term: work for term, work in side.items() if abs(work) > least_j}
            for side in (gave, took)
        )
        if written.first_step is None or written.first_step > step:
            told = told + spins_at_start(base, track.start_rad_s)
    told = told + _pressed_beside(subject, window, words) + mass_outside(subject)
    return AccountRow(
        kind="turned",
        told=told,
        got=angle_rad,
        unit="rad",
        step=step,
        terms=_works(subject, gave, took, words),
        salience=track.most_turned_rad * 0.45,
        subject=subject.body,
        group=("turned", subject.kind, _most(gave), axis, magnitude(angle_rad)),
    )


def _pressed_beside(subject: MeasuredBody, window: slice, words: RowWords) -> Message:
    """Describe the lever arm of a contact force when a body began to rotate, or nothing.

    The lever arm of a force F about the centre of mass is T / F, with T its moment about that
    point.
    """
    ledger = subject.ledger
    known = np.flatnonzero(ledger.counts[window]) + window.start
    if subject.tree.links or not len(known):
        return Message("")
    turned = np.linalg.norm(np.cumsum(ledger.way[known, :3], axis=0), axis=1)
    begins = int(known[np.argmax(turned > BEGUN * turned.max())])
    few = slice(max(0, begins - 2), min(begins + 3, ledger.bins))
    first, end = (ledger.first + each * ledger.width for each in (few.start, few.stop))
    sums = {term: each[few, :6].sum(axis=0) for term, each in ledger.impulse.items()}
    pressing = [term for term in sums if term.cause == CONTACT]
    if not pressing:
        return Message("")
    term = max(pressing, key=lambda each: float(np.linalg.norm(sums[each][3:])))
    moments = {each: float(np.linalg.norm(part[:3])) for each, part in sums.items()}
    if moments[term] <= LEAST_SHARE * max(moments.values()):
        return Message("")
    pushed = float(np.linalg.norm(sums[term][3:]))
    rubbed = sums.get(replace(term, cause=FRICTION), np.zeros(6))
    return Message(
        "; as it began, from {start} to {end}, {partner} pressed it {arm} beside its centre of "
        "mass on average and rubbed with {share} of that force",
        start=words.time(subject, first),
        end=words.time(subject, min(end - 1, ledger.last)),
        partner=words.names.partner(subject.body.number, term),
        arm=quantity(moments[term] / pushed, "m"),
        share=number(float(np.linalg.norm(rubbed[3:])) / pushed),
    )


def _works(
    subject: MeasuredBody, gave: Mapping[Term, float], took: Mapping[Term, float], words: RowWords
) -> tuple[RowTerm, ...]:
    """Convert the energies that causes gave and took to terms of a row, without small ones."""
    most = max(map(abs, (*gave.values(), *took.values())), default=0.0)
    sides = (words.terms(subject, side, "J", beside=most)[:3] for side in (gave, took))
    return tuple(term for side in sides for term in side)


def _most(gave: Mapping[Term, float]) -> str | None:
    """Return the cause that gave the most energy."""
    return max(gave, key=lambda term: gave[term]).cause if gave else None


def _most_given(row: AccountRow) -> str | None:
    return row.towards[0].cause if row.towards else None
