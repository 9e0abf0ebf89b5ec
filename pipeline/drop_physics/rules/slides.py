"""Rules about slipping: `slides`, `creeps`, `friction-pyramid`, `dragged-by-nothing`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drop_physics.arrays import Flags, Float64, Int64
from drop_physics.explain.steps import BodySteps, Steps
from drop_physics.messages import Message
from drop_physics.physics.rotations import rotate, rotate_inverse
from drop_physics.physics.vectors import lengths
from drop_physics.rules.body_properties import AskedOfBodies
from drop_physics.rules.chunk import StepChunk
from drop_physics.rules.engines import ANY, MUJOCOS
from drop_physics.rules.placing import NEAR, Placing
from drop_physics.rules.rows import Noted, Remedy, SayingRow
from drop_physics.rules.rule import Match, pair_rule, side_rule
from drop_physics.rules.tables import PairColumns
from drop_physics.rules.thresholds import (
    AHEAD,
    CREEPS_M,
    CREEPS_M_S,
    CREEPS_STEADY,
    CREEPS_STEPS,
    CREEPS_STRAIGHT,
    CREEPS_USED,
    FROM_REST,
    GRIPPED,
    LANDS_M_S,
    NO_FORCE,
    PYRAMID,
    PYRAMID_M_S,
    PYRAMID_STEPS,
    PYRAMID_TURNS_RAD,
    SLIDES,
    SLIPS_M,
    SLIPS_M_S,
    SLIPS_SHARE,
    SLIPS_STEPS,
    STAYS,
    STEEP,
    TREMBLES_M_S,
    USUAL_FRICTION,
)
from drop_physics.trace.events import Body
from drop_physics.trace.history import Seen

Rows = NDArray[np.intp]


@side_rule(
    "slides",
    "asked",
    consecutive=True,
    argument="lateralFriction",
    least_count=SLIPS_STEPS,
    proposes=True,
)
def slides(pair: PairColumns, placing: Placing, chunk: StepChunk) -> Match:
    """Gravity and the support's acceleration need more than the possible friction; no push acts."""
    return _slips(pair, pair.pairs.slip_m_s > SLIPS_M_S, placing, chunk)


@slides.counts
def _(
    until_against: Float64,
    until_available: Float64,
    slid: Float64,
    moved: Float64,
    turning: Float64,
    held: Float64,
    began: Float64,
    size: Float64,
    normal: Float64,
    needed: Float64,
    sizes_m: Float64,
) -> Float64:
    beyond = (until_against > until_available) & (slid >= SLIDES * moved)
    slips = beyond | ((turning > held) & (held > 0))
    rested = began <= FROM_REST * size
    touches = normal > NO_FORCE * lengths(needed)
    far = slid > np.maximum(SLIPS_M, SLIPS_SHARE * sizes_m)
    return np.where(far & rested & slips & touches, slid, 0.0)


@slides.notes
def _(
    asked: AskedOfBodies,
    subject: Body,
    partner: Body,
    held: float,
    turning: float,
    time: float,
    until_time: float,
    until_normal: float,
    until_available: float,
    until_against: float,
) -> Noted | None:
    given = asked.of["lateralFriction"].values
    least, most = sorted(given.get(each.number, 1.0) for each in (subject, partner))
    if most < USUAL_FRICTION:
        return None  # calls made both slippery
    # Of nothing no factor makes something.
    share = until_against / until_available if until_available > 0 else 0.0
    return {
        "level": "note" if least < USUAL_FRICTION else None,
        "held": held / time,
        "turning": turning / time,
        "available": until_available / until_time,
        "given": until_available / until_normal,
        "needed": until_against / until_time,
        "wanted": until_against / until_normal,
        "factor": float(f"{max(2.0, 2 * share):.3g}"),
    }


SLIDES_ON = SayingRow(
    says=Message(
        "{body} slides {slid:.3g} m on {other} in {steps}: friction there gives at most "
        "{available:.3g} N (coefficient {given:.3g}), staying takes {needed:.3g} N "
        "({wanted:.3g})"
    )
)
slides.rows(
    SayingRow(
        when=lambda until_against, until_available: until_against <= until_available,
        says=Message(
            "{body} turns in the grip of {other}, {slid:.3g} m at the contact in {steps}: friction "
            "there gives at most {held:.3g} N m about it, and its weight beside it takes "
            "{turning:.3g} N m"
        ),
        advice=Message("grip it at its centre of mass, or with more force or friction"),
    ),
    # Of what there is, nothing is so rough.
    SayingRow(when=lambda wanted: wanted > STEEP).like(SLIDES_ON),
    SayingRow(
        when=lambda until_available: until_available > 0,
        advice=Message(
            "raise the product of both bodies' coefficients well above {wanted:.3g}: {call}, or "
            "press them together with more force"
        ),
        cure=Remedy("friction", "body", "factor"),
    ).like(SLIDES_ON),
    SayingRow(
        advice=Message(
            "give both bodies a lateralFriction, with a product well above {wanted:.3g}"
        ),
    ).like(SLIDES_ON),
    like=SayingRow(effect="slid", normal="body_size_m"),
)


@side_rule(
    "creeps", "model", consecutive=True, argument="lateralFriction", least_count=CREEPS_STEPS
)
def creeps(pair: PairColumns, placing: Placing, chunk: StepChunk) -> Match:
    """The solver stops before contacts rest: its changes get small, or its iterations run out."""
    return _slips(
        pair,
        (pair.pairs.slip_m_s > TREMBLES_M_S) & (pair.pairs.slip_m_s < CREEPS_M_S),
        placing,
        chunk,
    )


@creeps.counts
def _(
    needed: Float64,
    way: Float64,
    size: Float64,
    time: Float64,
    slid: Float64,
    moved: Float64,
    used: Float64,
    available: Float64,
) -> Float64:
    needed, went = (lengths(each) for each in (needed, way))
    holds = (went > CREEPS_M) & (size * time < CREEPS_STEADY * went)
    holds &= np.minimum(slid, went) > CREEPS_STRAIGHT * np.maximum(slid, moved)
    holds &= np.maximum(needed, np.abs(used)) < CREEPS_USED * available
    return np.where(holds, slid, 0.0)


@creeps.notes
def _(way: list[float], needed: list[float], available: float, time: float) -> Noted:
    return {
        "went": float(np.linalg.norm(way)),
        "available": available / time,
        "needed": float(np.linalg.norm(needed)) / time,
    }


creeps.rows(
    SayingRow(
        says=Message(
            "{body} creeps {went:mm} on {other} in {time:.3g} s: friction there could give "
            "{available:.3g} N and staying takes {needed:.3g} N, but the solver ends before the "
            "contact is at rest"
        ),
        cure=Remedy(
            "solver", value=500.0, given={"solverResidualThreshold": 0, "numSolverIterations": 500}
        ),
        effect="went",
        normal="body_size_m",
    )
)


def _slips(pair: PairColumns, slips: Flags, placing: Placing, chunk: StepChunk) -> Match:
    """Return the steps in which a body slips on its support, and nothing else pushes it.

    Sums over the steps: path of the slip as a length (`slid`) and as a vector (`way`), and path of
    the centre (`moved`) [m]; time [s]; impulses [N s] of the normal force, of the available and of
    the used friction, of the friction that moving with the support requires (`needed`), and of its
    part against the slip (`against`); in a grip, the moment of that friction about the contact
    normal (`turning`), and the moment that friction can exert (`held`) [N m s]. Sums of forces
    leave out the steps in which a grip closes.
    """
    free = np.isin(pair.body, [body.body.number for body in _free_bodies(chunk)])
    rows = np.flatnonzero(slips & free & (pair.pairs.normal_n > 0) & (pair.body != pair.other))
    asked, others, pushed, way, arm = _acting(pair, rows, placing)
    line, normal = pair.pairs.line[rows], pair.pairs.normal_n[rows]
    along = _dot(asked, line)
    needed, way = asked - along[:, None] * line, way - _dot(way, line)[:, None] * line
    # What is held from both sides hangs back, whoever else carries it; elsewhere that is a push.
    gripped = lengths(pair.pairs.pressed_n[rows]) < GRIPPED * normal
    alone = (pushed <= NO_FORCE * normal) & (gripped | (others <= NO_FORCE * normal))
    alone &= pair.pairs.one_line[rows] & pair.own(pair.pairs.explained)[rows]
    # What lies on one side presses with what it needs, on average: step by step it chatters.
    pressed = np.where(gripped, normal, np.abs(along))
    steady = ~gripped | (np.abs(pair.pairs.approach_m_s[rows]) < LANDS_M_S)
    # How the links that touch slip past each other: they may turn together, and go along an arc,
    # which either end of the step shows from one side.
    ends = (
        pair.own(each) - pair.others(each)
        for each in (pair.pairs.ended_m_s, pair.pairs.carried_m_s)
    )
    slip = np.mean([*ends], axis=0)[rows]
    slip -= _dot(slip, line)[:, None] * line
    moved = lengths(way)
    needs = lengths(needed).clip(1e-300)
    turning, held = np.zeros((2, len(rows)))
    if gripped.any():
        turning = np.abs(_dot(np.cross(arm, asked), line)) * gripped
        held = gripped * pair.own(pair.pairs.held_n_m)[rows]
    dt = pair.timestep_s[rows]
    forces = {
        "time": np.ones(len(rows)),
        "normal": pressed,
        "available": pair.pairs.available_n[rows] / normal * pressed,
        "used": pair.sign * _dot(pair.pairs.tangential_n[rows], needed) / needs,
        "against": -_dot(needed, way) / moved.clip(1e-300),
        "turning": turning,
        "held": held,
    }
    sums = {name: force * steady * dt for name, force in forces.items()}
    sums |= {"slid": pair.pairs.slip_m_s[rows] * dt, "moved": moved * dt, "way": slip * dt[:, None]}
    sums["needed"] = needed * (steady * dt)[:, None]
    firsts = {"began": pair.pairs.began_slip_m_s[rows]}
    bodies, step, placing = pair.body[rows], pair.step[rows], placing
    begins = placing.moved(bodies, step) | placing.restored(bodies, step)
    return Match(
        rows, pair.pairs.slip_m_s[rows], sums=sums, firsts=firsts, holds=alone, begins=begins
    )


def _is_free(steps: Steps) -> bool:
    """Return whether steps are explained, and belong to bodies without joints."""
    return steps.law.tree.size == 6 and bool(steps.terms)


def _free_bodies(chunk: StepChunk) -> list[BodySteps]:
    """Return the explained steps of free bodies without joints in the latest chunk."""
    free = (batch.bodies for batch, _ in chunk.batches if _is_free(batch.whole))
    return [body for bodies in free for body in bodies]


def _acting(pair: PairColumns, rows: Rows, placing: Placing) -> tuple[Float64, ...]:
    """Return the load that weight and acceleration put on a body's contact, (n, 3) [N].

    The acceleration is that of a body that moves with its support. Further results: the forces of
    other bodies, and the forces of pushes and constraints, shape (n,) each [N]; the velocity of the
    centre relative to the support [m/s], and the centre's position relative to the contact [m],
    shape (n, 3) each. Values are nan for unexplained steps.
    """
    asked, way, arm = np.full((3, len(rows), 3), np.nan)
    others, pushed = np.full((2, len(rows)), np.nan)
    began, ended, goes = (
        pair.others(each)[rows]
        for each in (pair.pairs.began_m_s, pair.pairs.carried_m_s, pair.pairs.ended_m_s)
    )
    step, dt = pair.step[rows], pair.timestep_s[rows, None]
    support = ended - began
    # Between steps calls may give it another velocity.
    placed = placing.moved(pair.other[rows], step)
    if placed.any():
        last = pair.before(rows)
        now = np.flatnonzero((last >= 0) & placed)
        support[now] += began[now] - ended[last[now]]
    for steps, its, at in pair.of_bodies(rows):
        if not _is_free(steps):
            continue
        terms = {
            name: steps.terms[name][at, 3:6] / dt[its]
            for name in ("contacts", "constraints", "applied")
        }
        weight = support[its] / dt[its] - steps.reported.gravity_m_s2[at]
        asked[its] = steps.law.tree.masses_kg[0] * weight
        touched = terms["contacts"] - pair.sign * pair.pairs.force_n[rows[its]]
        others[its] = lengths(touched)
        pushed[its] = lengths(terms["constraints"] + terms["applied"])
        way[its] = steps.after.velocity[at, 3:6] - goes[its]
        arm[its] = steps.before.position_m[at] - pair.own(pair.pairs.centre_m)[rows[its]]
    return asked, others, pushed, way, arm


def _dot(a: Float64, b: Float64) -> Float64:
    return np.asarray(np.einsum("ni,ni->n", a, b))


# -- friction-pyramid -----------------------------------------------------------------------------


@pair_rule("friction-pyramid", "model", least_count=PYRAMID_STEPS)
def friction_pyramid(pair: PairColumns, seen: Seen) -> Match | None:
    """Friction exceeds μN in most steps, or deflects a slide, since enableConeFriction is 0."""
    clients = seen.clients_with("set_enableConeFriction", 0)
    bodies = [number for number, body in seen.bodies.items() if body.client in clients]
    slides = (
        (pair.pairs.slip_m_s > PYRAMID_M_S)
        & (pair.pairs.available_n > 0)
        & (pair.body != pair.other)
    )
    used = lengths(pair.pairs.tangential_n) / pair.pairs.available_n
    more = used > PYRAMID
    where = slides & np.isin(pair.body, bodies)
    along = pair.pairs.tangential_n / lengths(pair.pairs.tangential_n)[:, None]
    return Match(
        where,
        used,
        sums={"every": np.ones(len(used))},
        firsts={"began": along},
        lasts={"ended": along},
        counts=more.astype(np.int64),
    )


@friction_pyramid.counts
def _(began: Float64, ended: Float64, count: Int64, every: Float64, size: Float64) -> Float64:
    straight = (began * ended).sum(axis=1) > np.cos(PYRAMID_TURNS_RAD)
    return np.where((2 * count > every) | ~straight, size, 0.0)


friction_pyramid.rows(
    SayingRow(
        says=Message(
            "friction on {other} brakes {body} with up to {size:.3g} times μN: with "
            "enableConeFriction=0 each of two axes has a limit of its own"
        ),
        cure=Remedy("cone", value=1.0),
        effect="size",
        unit="1",
    )
)


# -- dragged-by-nothing ---------------------------------------------------------------------------


@side_rule("dragged-by-nothing", "asked", engines=ANY)
def dragged_by_nothing(pair: PairColumns, placing: Placing) -> Match | None:
    """Friction depends on velocities, and a support moved only by setting poses has none."""
    moves = pair.points.moves[pair.starts]
    lies = moves[:, pair.side] & ~moves[:, 1 - pair.side] & (pair.pairs.available_n > 0)
    ahead_m, where = np.zeros((len(lies), 3)), np.zeros(len(lies), np.bool_)
    for support, (steps, bases) in placing.animated.items():
        rows = np.flatnonzero(lies & (pair.other == support))
        held = np.minimum(np.searchsorted(steps, pair.step[rows]), len(steps) - 1)
        moved = (held > 0) & (steps[held] == pair.step[rows])
        moved &= steps[held] - steps[held - 1] <= NEAR
        moved &= np.abs(bases[held, 7:13]).max(axis=1, initial=0.0) < 1e-9
        where[rows] = moved
        now, then, at_m = bases[held], bases[held - 1], pair.others(pair.pairs.centre_m)[rows]
        # Where the point of the support that it touches was before the call.
        turned_m = rotate(now[:, 3:7], rotate_inverse(then[:, 3:7], at_m - then[:, :3]))
        ahead_m[rows] = now[:, :3] + turned_m - at_m
    if not where.any():
        return None
    went_m = pair.own(pair.pairs.ended_m_s) * pair.timestep_s[:, None]
    ways = {"ahead_m": _along(ahead_m, pair.pairs.line), "went_m": _along(went_m, pair.pairs.line)}
    return Match(where, pair.pairs.normal_n, sums=ways)


@dragged_by_nothing.notes
def _(
    placing: Placing,
    partner: Body,
    last: int,
    body_size_m: float,
    ahead_m: list[float],
    went_m: list[float],
) -> Noted | None:
    ways = np.array([ahead_m, went_m])
    behind, (ahead, went) = float(np.linalg.norm(ways[0] - ways[1])), lengths(ways)
    if went > STAYS * ahead or behind < AHEAD * body_size_m:
        return None
    return {"ahead": ahead, "behind": behind, "called": placing.site(partner, last)}


dragged_by_nothing.rows(
    SayingRow(
        engines=MUJOCOS,
        advice=Message("let a <joint> with an actuator move it, or <weld> it to the mocap body"),
    ),
    SayingRow(cure=Remedy("support-velocity", "other", bodies=("other",))),
    like=SayingRow(
        says=Message(
            "{body} stays behind while calls move {other} by {ahead:.3g} m under it: a "
            "body whose pose is set has no velocity, and drags nothing"
        ),
        effect="behind",
        normal="body_size_m",
        site="called",
    ),
)


def _along(ways: Float64, line: Float64) -> Float64:
    """Return the components of paths along the contact surface, shape (n, 3)."""
    return np.asarray(ways - np.einsum("mi,mi->m", ways, line)[:, None] * line)
