"""Compares the same drop in two engines: first difference, its size, and its error terms."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace

import numpy as np

from drop_physics.drop.case import DropCase
from drop_physics.explain.decomposition import TERMS, error_and_terms
from drop_physics.fields import decimals
from drop_physics.messages import Message, joined
from drop_physics.physics.base import Law, Motion
from drop_physics.physics.laws.bullet.law import BulletLaw
from drop_physics.scenario import ENGINES

SHOWN = 1e-3
"""Smallest share of the distance for which a term is named."""
LEAST_M = 5e-8
"""A smaller distance would be printed as 0.0000 mm."""
REPLAYED = 100_000
"""Largest number of steps for which an integration rule is replayed step by step."""
REPLAYED_M = 1e-12
"""Largest distance between the path by a law and the engine's [m]; measured over 1 s: 1e-15."""
NAMES = {
    "timestep": Message("timestep"),
    "damping": Message("damping"),
    "interaction": Message("interaction"),
    "rounding": Message("rounding"),
}
"""Names of the terms, as shown in messages."""


@dataclass(frozen=True)
class Flight:
    """A drop up to its first contact."""

    case: DropCase
    motion: Motion
    """The samples before the first one with a contact."""


def flight_of(case: DropCase) -> Flight:
    """Return the flight of a drop, without reading samples after it."""
    parts: list[Motion] = []
    for part in case.parts():
        near = np.flatnonzero(part.contact_points)
        parts.append(part.at(slice(int(near[0]) if len(near) else len(part))))
        if len(near):
            break
    return Flight(case, Motion.joined(parts))


def apart(run: Flight, golden: Flight, *, parts_at: int | None) -> Message:
    """Describe the difference between two engines that simulated the same scenario.

    Parameters
    ----------
    run, golden
        The two drops, with the same timestep and number of samples.
    parts_at
        The first sample that differs; None if none does.
    """
    names = {
        name: ENGINES[flight.case.scenario.engine]
        for name, flight in (("run", run), ("golden", golden))
    }
    touch = min(len(run.motion), len(golden.motion))
    if parts_at is None:
        return Message("{run} and {golden} agree to the bit", **names)
    if parts_at >= touch:
        return Message(
            "{run} and {golden} agree to the bit until contact (step {step}); from there on each "
            "has its own",
            step=touch,
            **names,
        )
    last = touch - 1
    clauses = [Message("{run} and {golden} diverge at step {step}", step=parts_at, **names)]
    if last > parts_at and run.case.is_rigid and golden.case.is_rigid:
        clauses.append(_distance(run, golden, last))
    advice = [_undamped(run, golden, last), _undamped(golden, run, last)]
    return joined("; ", [*clauses, *filter(None, advice)])


def _distance(run: Flight, golden: Flight, last: int) -> Message:
    """Describe the largest distance along an axis, and the error terms that cause it."""
    apart_m = run.motion.position_m[last] - golden.motion.position_m[last]
    time_s = last * run.case.timestep_s
    axis = int(np.argmax(np.abs(apart_m)))
    if abs(apart_m[axis]) < LEAST_M:
        return Message(
            "in the air, at {time:.4g} s, they are less than 0.0001 mm apart", time=time_s
        )
    distance = Message(
        "in the air, at {time:.4g} s, they are {distance} mm apart along {axis}",
        time=time_s,
        distance=decimals(apart_m[axis] * 1e3, 4, "+"),
        axis="xyz"[axis],
    )
    parts = []
    for flight in (run, golden):
        case, motion = flight.case, flight.motion
        held = np.flatnonzero(case.law.limited(motion.before())[: last + 1])
        if len(held):
            clamped = Message(
                "{engine} clamps a velocity in step {step}",
                engine=ENGINES[case.scenario.engine],
                step=int(held[0]),
            )
            return joined("; ", [distance, clamped])
        start = motion.at(slice(0, 1))
        _, terms = error_and_terms(start, motion.position_m[last], case.law, steps=last)
        parts.append(terms)
    if None in parts:
        return distance
    terms_m = {
        name: getattr(parts[0], name)[axis] - getattr(parts[1], name)[axis] for name in TERMS
    }
    shares = [
        Message("{term} {distance}", term=NAMES[name], distance=decimals(value_m * 1e3, 4, "+"))
        for name, value_m in terms_m.items()
        if abs(value_m) > SHOWN * abs(apart_m[axis])
    ]
    return joined(": ", [distance, joined(", ", shares)]) if shares else distance


def _undamped(flight: Flight, other: Flight, last: int) -> Message | None:
    """Describe that Bullet without damping would agree with the other engine; None if not."""
    law = flight.case.law
    if not isinstance(law, BulletLaw) or not (law.linear_damping or law.angular_damping):
        return None
    if last > REPLAYED:
        return None
    undamped = replace(law, linear_damping=0.0, angular_damping=0.0)
    off_m, to_the_bit = _off(_path(undamped, flight.motion, last), undamped, other)
    options = ["--linear-damping 0"] if law.linear_damping else []
    spins = flight.motion.spin_rad_s[: last + 1].any()
    options += ["--angular-damping 0"] if law.angular_damping and spins else []
    if not options:
        return None
    named = " ".join(options)
    if to_the_bit:
        return Message(
            "drop it in PyBullet with {options} and they agree to the bit until contact",
            options=named,
        )
    if off_m < 1e-9:
        return Message(
            "drop it in PyBullet with {options} and they agree to {distance:.1g} m until contact",
            options=named,
            distance=10.0 ** math.ceil(math.log10(max(off_m, REPLAYED_M))),
        )
    return None


def _path(law: Law, motion: Motion, last: int) -> Motion:
    """Return the motion by an integration rule, step by step from the release; last + 1 rows."""
    motions = [motion.at(slice(0, 1))]
    for _ in range(last):
        motions.append(law.step(motions[-1]))
    return Motion.joined(motions)


def _off(path: Motion, law: Law, other: Flight) -> tuple[float, bool]:
    """Return a path's largest distance from another engine's [m], and whether the bits agree.

    An orientation counts as the displacement of the body's surface.
    """
    samples = other.motion.at(slice(len(path)))
    mine, theirs = path.orientation, samples.orientation
    mine = np.where((mine * theirs).sum(axis=1, keepdims=True) < 0, -mine, mine)  # -q turns like q
    turn_rad = 2 * np.linalg.norm(mine - theirs, axis=1).max()
    off_m = float(np.abs(path.position_m - samples.position_m).max())
    same = all(
        np.array_equal(getattr(path, each.name), getattr(samples, each.name))
        for each in fields(Motion)
    )
    return max(off_m, float(turn_rad) * other.case.engine.reach_m), same and bool(
        law.bits(path).all()
    )
