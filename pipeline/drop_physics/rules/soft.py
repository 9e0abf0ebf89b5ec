"""Rules about MuJoCo's soft contacts and constraints: `deep-penetration`, `constraint-lags`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from drop_physics.arrays import Flags, Float64, Int64
from drop_physics.explain.bodies import Record
from drop_physics.messages import Message
from drop_physics.physics.kinematics import kinematics
from drop_physics.physics.laws.mujoco.contact import impedance, rest_depth_m, shortest_s
from drop_physics.rules.body_properties import thickness_m
from drop_physics.rules.by_name import called
from drop_physics.rules.engines import MUJOCOS
from drop_physics.rules.rows import Noted, Remedy, SayingRow, Worst
from drop_physics.rules.rule import Match, body_rule, pair_rule
from drop_physics.rules.steady import is_steady
from drop_physics.rules.tables import BodyColumns, PairColumns
from drop_physics.rules.thresholds import (
    CARRIES,
    LAG_SHARE,
    LEFT_M,
    SINKS_M,
    SINKS_STEPS,
)
from drop_physics.trace.events import Body, Equality
from drop_physics.trace.history import Seen

USUAL_S, USUAL_SHARE = 0.02, 0.9
"""MuJoCo's default time constant in `solref`, and its default impedance at first touch in
`solimp`."""
OPPOSED = 0.5
"""Share of all normal forces below which forces on opposite sides cancel most of each other."""


def _staying(pair: PairColumns, depth_m: Float64, least_m: float) -> Int64:
    """Return the indices of rows in which an overlap of at least `least_m` stays the same."""
    rows = np.flatnonzero((depth_m >= least_m) & (pair.body != pair.other))
    rows = rows[np.lexsort((pair.step[rows], *pair.keys[rows].T))]
    lasts = np.zeros(len(rows), np.bool_)
    first, last = rows[: max(len(rows) - SINKS_STEPS + 1, 0)], rows[SINKS_STEPS - 1 :]
    lasts[SINKS_STEPS - 1 :] = (pair.keys[first] == pair.keys[last]).all(axis=1) & (
        pair.step[last] - pair.step[first] == SINKS_STEPS - 1
    )
    return np.asarray(rows[lasts & is_steady(depth_m[rows])])


@pair_rule("deep-penetration", "model", engines=MUJOCOS)
def sinks_in(pair: PairColumns, seen: Seen) -> Match:
    """A contact is soft, or too soft for its load, so that a resting body sinks in."""
    rows = _staying(pair, pair.pairs.depth_m, SINKS_M)
    numbers = {
        "links": pair.links[rows],
        "bodies": pair.pairs.body[rows],
        "force": np.linalg.norm(pair.pairs.pressed_n[rows], axis=1),
        "pressed": pair.pairs.normal_n[rows],
        "loaded": _loaded(pair, seen)[rows],
        "timestep": pair.timestep_s[rows],
    }
    return Match(rows, pair.pairs.depth_m[rows], numbers, keys=pair.keys[rows])


def _loaded(pair: PairColumns, seen: Seen) -> Flags:
    """Flag the sides of contacts that a free body presses on, shape (m, 2)."""
    bodies, known = pair.pairs.body, seen.bodies
    free = [number for number, body in known.items() if body.base_moves]
    presses = np.isin(bodies[:, ::-1], free) & (pair.pairs.normal_n > 0)[:, None]
    keys = pair.step[:, None] * len(known) + np.searchsorted(sorted(known), bodies)
    return np.isin(keys, keys[presses])


@sinks_in.notes
def _(
    worst: Worst,
    seen: Seen,
    bodies: list[int],
    links: list[int],
    size: float,
    force: float,
    pressed: float,
) -> Noted | None:
    soft = seen.soft(bodies, links)
    if soft is None:
        return None
    solref, solimp = soft
    shaped = solimp[1] < USUAL_SHARE or (solimp[0] < USUAL_SHARE and size < solimp[2])
    if not shaped and not solref[0] > USUAL_S:
        return called(_carries, worst, solref=solref, solimp=solimp)
    return {
        # What is held from two sides carries no load that one number tells.
        "under": Message(", under {force:N} then") if force > OPPOSED * pressed else "",
        "solver": "solimp" if shaped else "solref",
        "text": " ".join(f"{each:g}" for each in (solimp[:3] if shaped else solref)),
        "usual": "0.9 0.95 0.001" if shaped else "0.02 1",
        "light": None,
    }


def _carries(
    seen: Seen,
    subject: Body,
    partner: Body,
    bodies: list[int],
    links: list[int],
    loaded: list[bool],
    size: float,
    force: float,
    timestep: float,
    solref: Sequence[float],
    solimp: Sequence[float],
) -> Noted | None:
    """Return notes on a contact that carries far more than a body's weight; None for others.

    A contact's stiffness follows from its time constant and the bodies' mass, whatever the load.
    """
    masses_kg = {
        each.body.number: float(each.reported["mass_kg"][0])
        for each in seen.dynamics
        if each.body.base_moves and each.body.number in (subject.number, partner.number)
    }
    if not masses_kg or any(len(each.links) > 1 and each.moving for each in (subject, partner)):
        return None
    light = min(masses_kg, key=lambda number: masses_kg[number])
    *_, told = (each for each in seen.settings if each.client == subject.client)
    gravity_m_s2 = np.linalg.norm([told.values[f"gravityAcceleration{axis}"] for axis in "XYZ"])
    weight = float(gravity_m_s2) * masses_kg[light]
    if not weight or not loaded[bodies.index(light)] or force < CARRIES * weight:
        return None
    least_s = shortest_s(timestep)
    thin_m = min(map(thickness_m, map(seen.bodies.__getitem__, bodies), links))
    # What is pressed flat may let its load down on something else.
    stiffens = 0 < least_s < solref[0] and size < thin_m / 2
    return {
        "light": seen.bodies[light].label,
        "mass": masses_kg[light],
        "ratio": force / weight,
        "stiffens": stiffens,
        "shortest": least_s,
        "left": _left_m(size, solref, solimp, least_s) * 1e3 if stiffens else 0.0,
    }


CARRYING = SayingRow(
    says=Message(
        "{body} gets {size:mm} into {other}, under {force:N} then, {ratio:.3g} times what "
        "{light} weighs ({mass:.3g} kg): MuJoCo makes a contact as stiff as the masses that "
        "touch ask for, whatever lies on them"
    )
)
sinks_in.rows(
    SayingRow(
        when=lambda light: light is None,
        says=Message(
            "{body} gets {size:mm} into {other}{under}: their contact has "
            "{solver} {text}, which is softer than MuJoCo's own {usual}"
        ),
        advice=Message("{call} of both <geom>s, or of the <pair> of them"),
        cure=Remedy("solref", "body"),
        level="note",  # the model gives this softness
    ),
    SayingRow(
        when=lambda stiffens: stiffens,
        advice=Message(
            "{call} of both <geom>s, the least for this timestep, leaves {left:.2g} mm; or give "
            "{light} a mass nearer to that of what lies on it"
        ),
        cure=Remedy("solref", "body", "shortest", form="contact"),
    ).like(CARRYING),
    SayingRow(advice=Message("give {light} a mass nearer to that of what lies on it")).like(
        CARRYING
    ),
    like=SayingRow(effect="size", normal="body_size_m"),
)


def _left_m(
    depth_m: float, solref: Sequence[float], solimp: Sequence[float], constant_s: float
) -> float:
    """Return a contact's depth under the same load with another time constant [m]."""
    d, square = impedance(depth_m, solimp), (solimp[1] * solref[0] * solref[1]) ** 2
    load_m_s2 = depth_m * d**2 / ((1 - d) * square)  # of a body that one point carries
    return rest_depth_m(load_m_s2, 1, (constant_s, 1.0), solimp) or 0.0


@pair_rule("margin", "note", engines=MUJOCOS)
def held_apart(pair: PairColumns) -> Match:
    """A margin makes contacts push before bodies touch, so that one rests above the other."""
    rows = _staying(pair, pair.pairs.gap_m, SINKS_M)
    return Match(rows, pair.pairs.gap_m[rows], keys=pair.keys[rows])


held_apart.rows(
    SayingRow(
        says=Message(
            "{body} stays {size:gap} away from {other}, which pushes it from there on: their "
            "<geom>s have a margin"
        ),
        advice=Message('margin="0" of both'),
        effect="size",
        normal="body_size_m",
    )
)


def _follows(bodies: BodyColumns, seen: Seen) -> Iterator[tuple[Equality, int, int]]:
    """Yield each equality of a body with one that calls move, with the latter's id and the link."""
    number = bodies.batch.bodies[0].body.number
    if not seen.equalities:
        return
    moved = {put.body.number for put in seen.puts}
    for equality in seen.equalities:
        if equality.tendons:
            continue
        for lead, body, link in (
            (equality.body_a, equality.body_b, equality.link_b),
            (equality.body_b, equality.body_a, equality.link_a),
        ):
            leads = lead in moved and not seen.bodies[lead].moving
            if equality.active and body == number and leads and link < bodies.law.tree.links:
                yield equality, lead, link


@body_rule("constraint-lags", "model", engines=MUJOCOS)
def constraint_lags(bodies: BodyColumns, records: Mapping[int, Record], seen: Seen) -> Match | None:
    """A body joined to one that only calls move lags behind, since the latter has no velocity."""
    rows, parts = np.arange(len(bodies.step)), []
    for equality, lead, link in _follows(bodies, seen):
        # Where it is as a step begins: what is written before it counts.
        led_m = records[lead].base_at(bodies.step)[:, :3]
        apart_m = led_m - kinematics(bodies.law.tree, bodies.before).position_m(link)
        way_m = np.linalg.norm(np.diff(led_m, axis=0, prepend=np.nan), axis=1)
        speed_m_s = way_m / bodies.reported.timestep_s
        numbers = [apart_m, speed_m_s, np.full(len(rows), equality.kind, object)]
        numbers.append(np.tile(equality.solref[:2], (len(rows), 1)))
        steady = is_steady(apart_m) & is_steady(speed_m_s)
        keys = np.column_stack([bodies.keys, np.full(len(rows), lead)])
        parts.append((rows, np.linalg.norm(apart_m, axis=1) * steady, keys, steady, *numbers))
    if not parts:
        return None
    where, size, keys, steady, apart, speed, kind, solref = map(
        np.concatenate, zip(*parts, strict=True)
    )
    numbers_of = {"apart": apart, "speed": speed, "kind": kind, "solref": solref}
    return Match(
        where, size, numbers_of, firsts={"began": apart}, keys=keys, counts=steady.astype(np.int64)
    )


@constraint_lags.notes
def _(
    seen: Seen, apart: list[float], began: list[float], speed: float, solref: list[float]
) -> Noted | None:
    lag_m = float(np.linalg.norm(np.subtract(apart, began)))
    constant_s, ratio = solref
    lasts_s = 2 * constant_s * ratio**2
    if not (constant_s > 0 and speed > 0 and lag_m > LEFT_M):
        return None
    if abs(lag_m / speed - lasts_s) > LAG_SHARE * lasts_s:
        return None
    least_s = 2 * float(np.ravel(seen.settings[-1].values["fixedTimeStep"])[0])
    left = 2 * least_s * speed * 1e3
    return {"lag": lag_m, "lasts": lasts_s, "shortest": least_s, "left": left}


constraint_lags.rows(
    SayingRow(
        says=Message(
            "{body} follows {other} {lag:mm} behind: {other} is moved at {speed:.3g} m/s "
            "and has no velocity for MuJoCo, so what is held to it is 2 × the time "
            "constant of solref = {lasts:.3g} s late"
        ),
        advice=Message("{call} of the <{kind}>, the least for this timestep, leaves {left:.2g} mm"),
        cure=Remedy("solref", "body", "shortest"),
        effect="lag",
        normal=LEFT_M,
    )
)
