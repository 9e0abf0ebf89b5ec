"""Rules about bodies that only friction holds, lying or gripped: `slides`, `creeps`.

Below its limit, MuJoCo's friction is a damper: under load a contact creeps at a speed set by the
contact's regularisation (impratio, the cone), whatever the coefficient. At its limit, the contact
slides.
"""

from __future__ import annotations

import numpy as np

from drop_physics.arrays import Flags, Float64, Int64
from drop_physics.explain.contact_points import COMMON
from drop_physics.messages import Message
from drop_physics.physics.vectors import lengths
from drop_physics.rules.by_name import called
from drop_physics.rules.chunk import StepChunk
from drop_physics.rules.engines import MUJOCOS
from drop_physics.rules.rows import Noted, Remedy, SayingRow
from drop_physics.rules.rule import Match, body_rule, pair_rule
from drop_physics.rules.runs import Runs
from drop_physics.rules.steady import is_steady
from drop_physics.rules.tables import BodyColumns, PairColumns
from drop_physics.rules.thresholds import (
    AT_LIMIT_SHARE,
    CREEPS_M_S,
    CREEPS_STEPS,
    EACH_STEP,
    FROM_REST,
    GRIPPED,
    HOPS_STEPS,
    LANDS_M_S,
    LEFT_M,
    LOADED,
    SLIDES_SHARE,
    SLIDES_USED,
    SLIPS_M,
    SLIPS_SHARE,
    SLIPS_STEPS,
    STEEP,
    STRAIGHT,
    USUAL_FRICTION,
)
from drop_physics.trace.history import Seen

IMPRATIO = 10.0
"""The recommended ratio of the stiffness of friction to that of normal forces."""


@body_rule("slides", "asked", consecutive=True, subject=1, engines=MUJOCOS)
def slides_off(bodies: BodyColumns, chunk: StepChunk) -> Match | None:
    """Holding a body's weight by friction alone requires more than the possible friction."""
    return _held(bodies, steady=False, chunk=chunk)


@slides_off.counts
def _(
    runs: Runs,
    weight: Float64,
    needed: Float64,
    used: Float64,
    available: Float64,
    sizes_m: Float64,
) -> Float64:
    went_m, moved_m, gets_away = called(_ways, runs)
    holds = gets_away & called(_beyond, runs) & (went_m >= SLIDES_SHARE * moved_m)
    holds &= (weight == 0) | (needed < STEEP * weight)
    holds &= (went_m > SLIPS_SHARE * sizes_m) & (used >= SLIDES_USED * available)
    return np.where(holds, went_m, 0.0)


@slides_off.notes
def _(
    seen: Seen,
    on: int,
    slip: list[float],
    available: float,
    normal: float,
    weight: float,
    needed: float,
    time: float,
) -> Noted:
    return {
        "other": seen.bodies[on].label,
        "went": float(np.linalg.norm(slip)),
        "available": float(_gives(available, normal, weight)) / time,
        "given": available / normal,
        # Without a word of the model it is 1.
        "level": "note" if available < USUAL_FRICTION * normal else None,
        "needed": needed / time,
        "wanted": needed / (weight or normal),
    }


slides_off.rows(
    SayingRow(
        says=Message(
            "{body} slides {went:.3g} m on {other} in {steps}: friction there gives at most "
            "{available:.3g} N (coefficient {given:.3g}), and its weight takes {needed:.3g} N of "
            "it ({wanted:.3g})"
        ),
        advice=Message(
            "a friction well above {wanted:.2g} where they touch (that of a <pair> counts, else of "
            "the <geom> with the higher priority, else the larger), or press them together with "
            "more force"
        ),
        cure=Remedy("friction", "body", "wanted", form="above"),
        effect="went",
        normal="body_size_m",
    )
)


@body_rule(
    "creeps",
    "model",
    least_count=CREEPS_STEPS,
    consecutive=True,
    subject=1,
    engines=MUJOCOS,
    proposes=True,
)
def gives_way(bodies: BodyColumns, chunk: StepChunk) -> Match | None:
    """Friction below its limit is a damper: a body held by it creeps, whatever the coefficient."""
    return _held(bodies, steady=True, chunk=chunk)


@gives_way.counts
def _(
    runs: Runs, slower: Float64, count: Int64, needed: Float64, available: Float64, used: Float64
) -> Float64:
    went_m, _, gets_away = called(_ways, runs)
    holds = gets_away & ~called(_beyond, runs) & (slower >= EACH_STEP * count)
    holds &= (needed > LOADED * available) & (used < AT_LIMIT_SHARE * available)
    return np.where(holds, went_m, 0.0)


@gives_way.notes
def _(seen: Seen, on: int, slip: list[float], used: float, available: float, time: float) -> Noted:
    went_m, settings = float(np.linalg.norm(slip)), seen.settings[-1].values
    ratio = float(np.ravel(settings.get("impratio", 1.0))[0])
    return {
        "other": seen.bodies[on].label,
        "went": went_m,
        "speed": went_m * 1e3 / time,
        "share": 1e2 * used / available,
        "impratio": ratio,
        "cone": Message("elliptic") if settings.get("cone") else Message("pyramidal"),
        "loose": not settings.get("cone") or ratio < IMPRATIO,
    }


gives_way.rows(
    SayingRow(
        when=lambda loose: loose,
        advice=Message('{call}, or noslip_iterations="5"'),
        cure=Remedy("impratio", value=IMPRATIO),
    ),
    SayingRow(cure=Remedy("noslip", value=5.0)),
    like=SayingRow(
        says=Message(
            "{body} creeps {went:mm} on {other} in {time:.3g} s, {speed:.3g} mm/s, with "
            "{share:.2g} % of the friction that it could have: below its limit friction is a "
            "damper (impratio {impratio:g}, {cone} cone)"
        ),
        effect="went",
        normal="body_size_m",
    ),
)


def _ways(slip: Float64, way: Float64, slid: Float64) -> tuple[Float64, Float64, Flags]:
    """Return the paths of contact and body [m], and flags of the steady slides, shape (n,)."""
    went_m, moved_m = lengths(slip), lengths(way)
    straight = np.minimum(slid, went_m) > STRAIGHT * np.maximum(slid, moved_m)
    return went_m, moved_m, (went_m >= SLIPS_M) & straight


def _gives(available: float | Float64, normal: float | Float64, weight: float | Float64) -> Float64:
    """Return the impulse that friction can give under the body's own weight [N s].

    The higher normal force of a landing lasts a few steps, and supports nothing afterwards.
    """
    given = available / np.maximum(normal, np.finfo(float).tiny)
    return np.where(np.asarray(weight) > 0, given * weight, available)


def _beyond(needed: Float64, available: Float64, normal: Float64, weight: Float64) -> Flags:
    """Flag the runs of steps in which the required friction exceeds the available one, if any."""
    gives = _gives(available, normal, weight)
    return np.asarray((needed > gives) & (gives > LOADED * needed))


def _held(bodies: BodyColumns, *, steady: bool, chunk: StepChunk) -> Match | None:
    """Return the steps in which a free body lies on something, or is gripped from two sides.

    Steps in which a grip closes are left out, since the normal force is larger then than later;
    with `steady`, only steps after a while of nearly constant normal force count.

    Sums over the steps: time [s]; impulses [N s] of the normal force, of the possible friction
    (`available`), of the actual friction (`used`), of the friction that the weight requires
    (`needed`) and of the weight's normal component (`weight`); the path at the contact as a length
    (`slid`) and as a vector (`slip`), and the path of the body's centre relative to its support
    (`way`) [m]; number of steps as slow as a creep (`slower`). Steps between two touches in quick
    succession count, too, since a body hops on soft contacts.
    """
    body, pairs, n = bodies.batch.bodies[0].body, chunk.pairs, len(bodies.step)
    its, points = pairs.of_body.get(body.number, np.empty(0, np.int64)), pairs.points
    row = np.searchsorted(bodies.step, points.step[its]).clip(max=n - 1)
    pressed = (points.normal_n[its] > 0) & (bodies.step[row] == points.step[its])
    its, row = its[pressed], row[pressed]
    if not body.base_moves or len(body.links) != 1 or bodies.law.tree.size != 6 or not len(its):
        return None
    side = (points.body[its, 0] != body.number).astype(int)
    sign, other = np.where(side == 0, 1.0, -1.0)[:, None], points.body[its, 1 - side]
    weight, normal = points.normal_n[its], points.normal[its]

    def summed(values: Float64) -> Float64:
        found = np.zeros((n, *values.shape[1:]))
        np.add.at(found, row, values)
        return found

    total, line = summed(weight), np.zeros((n, 3))
    rising = np.argsort(weight, kind="stable")  # of a step's points the one that presses most stays
    line[row[rising]] = normal[rising]
    askew = np.abs(np.einsum("ki,ki->k", normal, line[row])) < COMMON
    unsure = askew | ~points.explained[its].all(axis=1)
    lowest, highest = np.full(n, np.inf), np.full(n, -np.inf)
    np.minimum.at(lowest, row, other)
    np.maximum.at(highest, row, other)
    gripped = lengths(summed(sign * normal * weight[:, None])) < GRIPPED * total
    available = summed(points.friction[its] * weight)
    holds = (total > 0) & (summed(unsure.astype(float)) == 0) & np.isfinite(available)
    holds &= gripped | (lowest == highest)
    mean = weight[:, None] / total[row, None]
    if steady:
        holds &= is_steady(total)
    else:
        holds &= ~(gripped & _closes(total > 0, summed(points.approach_m_s[its] * mean[:, 0])))
    if not holds.any():
        return None
    slip = summed(sign * points.slip_m_s[its] * mean)
    way = bodies.after.velocity[:, 3:6] - summed(points.ended_m_s[its, 1 - side] * mean)
    weigh = float(bodies.law.tree.masses_kg[0]) * bodies.reported.gravity_m_s2
    along = np.einsum("ni,ni->n", weigh, line)
    way -= np.einsum("ni,ni->n", way, line)[:, None] * line
    speed, dt = lengths(slip), bodies.reported.timestep_s
    # Each step counts with the next touch, if that is not long after the one before.
    places = np.flatnonzero(holds)
    before = np.searchsorted(places, np.arange(n), side="right") - 1
    rows = np.flatnonzero((before >= 0) & (before + 1 - holds < len(places)))
    last, following = places[before[rows]], places[before[rows] + 1 - holds[rows]]
    near = bodies.step[following] - bodies.step[last] <= HOPS_STEPS
    rows, at = rows[near], following[near]
    time, touching = dt[rows], holds[rows] * dt[rows]
    return Match(
        rows,
        speed[at],
        {"on": lowest[at].astype(np.int64)},
        {
            "time": time,
            "normal": total[rows] * touching,
            "available": np.where(holds[rows], available[rows], 0.0) * touching,
            "used": lengths(summed(sign * points.tangential_n[its]))[rows] * touching,
            "needed": lengths(weigh - along[:, None] * line)[at] * time,
            "weight": np.where(gripped, 0.0, np.abs(along))[at] * time,
            "slid": speed[at] * time,
            "slower": holds[rows] & (speed[rows] < CREEPS_M_S),
            "slip": slip[at] * time[:, None],
            "way": way[at] * time[:, None],
        },
        counts=holds[rows].astype(np.int64),
        keys=np.column_stack([bodies.body[rows], lowest[at].astype(np.int64)]),
    )


def _closes(touches: Flags, approach_m_s: Float64) -> Flags:
    """Flag the steps from first touch until the parts rest against each other, shape (n,).

    A touch is a first one if there was no contact in the HOPS_STEPS before.
    """
    count, n = np.append(0, np.cumsum(touches)), np.arange(len(touches))
    first = touches & (count[n] == count[np.maximum(n - HOPS_STEPS, 0)])
    begun = np.maximum.accumulate(np.where(first, n, -1))
    slow = np.maximum.accumulate(np.where(touches & (approach_m_s < LANDS_M_S), n, -1))
    return touches & (slow < begun)


@pair_rule(
    "slides", "model", reason="condim", consecutive=True, least_count=SLIPS_STEPS, engines=MUJOCOS
)
def without_friction(pair: PairColumns) -> Match:
    """Contacts of condim 1 have no friction, so that bodies slide."""
    where = (pair.pairs.normal_n > 0) & (pair.pairs.summed(pair.points.friction) == 0)
    where &= pair.body != pair.other
    numbers = {"bodies": pair.pairs.body, "links": pair.links}
    way = pair.pairs.slip_m_s * pair.timestep_s
    return Match(
        where, pair.pairs.slip_m_s, numbers, {"slid": way}, firsts={"began": pair.pairs.slip_m_s}
    )


@without_friction.counts
def _(began: Float64, size: Float64, slid: Float64) -> Float64:
    # A puck that was thrown may be to glide on.
    rested = began <= FROM_REST * size
    return np.where(rested & (slid > LEFT_M), slid, 0.0)


without_friction.rows(
    SayingRow(
        when=lambda seen, bodies, links: seen.condim(bodies, links)[0] <= 1,
        says=Message(
            "{body} slides {slid:.3g} m on {other} in {steps} without friction: their contacts "
            "have condim 1, whatever friction= gives"
        ),
        cure=Remedy("friction", "body", 3.0, form="condim"),
        effect="slid",
        normal="body_size_m",
    )
)
