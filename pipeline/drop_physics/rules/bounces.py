"""Rules about bodies that do not bounce as their restitution demands, or bounce too high."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from drop_physics.account.touches import TouchTable
from drop_physics.arrays import Flags, Float64
from drop_physics.explain.changes import energy_of
from drop_physics.messages import Message
from drop_physics.physics.vectors import distinct_rows
from drop_physics.rules.body_properties import AskedOfBodies
from drop_physics.rules.chunk import StepChunk
from drop_physics.rules.engines import ANY, MUJOCOS
from drop_physics.rules.inputs import Inputs
from drop_physics.rules.placing import Placing
from drop_physics.rules.rows import Noted, Remedy, SayingRow
from drop_physics.rules.rule import Match, pair_rule
from drop_physics.rules.tables import PairColumns
from drop_physics.rules.thresholds import BOUNCES_M_S, GAINED, PLACED_M_S, SOFTLY, SWALLOWED
from drop_physics.trace.acts import Act
from drop_physics.trace.events import Body
from drop_physics.trace.history import Seen

OF_THRESHOLD = "restitutionVelocityThreshold"


@pair_rule("no-restitution", "asked")
def no_restitution(pair: PairColumns, asked: AskedOfBodies, seen: Seen) -> Match | None:
    """The engine multiplies the restitution of both bodies, which is 0 for most bodies.

    Other reasons are a contact slower than Bullet's threshold, and a contact that brakes the bodies
    before they touch, which reduces the rebound to `e v - gap / timestep`.
    """
    body, values = pair.pairs.body, asked.of["restitution"].values
    springy = np.isin(body, [number for number, value in values.items() if value > 0])
    if not springy.any():
        return None
    approach, rebound = pair.pairs.approach_m_s, pair.pairs.parting_m_s
    meets = springy.any(axis=1) & (body[:, 0] != body[:, 1])
    # What is placed, not dropped, comes slowly; what takes longer than a step to stop is soft.
    meets &= (approach > PLACED_M_S) & (rebound > -SOFTLY * approach)
    first = (np.isin(body, seen.moving) * 2 + springy).argmax(axis=1)
    rows = np.arange(len(body))
    # A corner that comes down after the impact is faster: the first that may bounce counts.
    may_bounce = np.where(approach > BOUNCES_M_S, 2.0, 1.0)
    numbers: dict[str, NDArray[Any]] = {
        "approach": approach,
        "rebound": rebound,
        "product": pair.pairs.restitution,
    }
    numbers |= {
        "gap": pair.pairs.gap_m,
        "lost": pair.pairs.gap_m / pair.timestep_s,
        "step": pair.step,
    }
    keys = np.stack([body[rows, first], body[rows, 1 - first]], axis=1)
    return Match(meets, may_bounce, numbers, keys=keys)


@no_restitution.notes
def _(
    asked: AskedOfBodies,
    inputs: Inputs,
    seen: Seen,
    subject: Body,
    partner: Body,
    approach: float,
    rebound: float,
    product: float,
    gap: float,
    lost: float,
    step: int,
) -> Noted | None:
    pair, bouncy, speed = (subject, partner), asked.of["restitution"], approach
    springy, none = pair if bouncy.values.get(pair[0].number, 0.0) > 0 else pair[::-1]
    wanted, unwanted = (bouncy.values.get(each.number, 0.0) for each in (springy, none))
    uses = [use for use in inputs.of(Act.SET_ENGINE) if OF_THRESHOLD in use.high]
    slowest = max([float(use.high[OF_THRESHOLD][0]) for use in uses], default=BOUNCES_M_S)
    soft = asked.of["contactStiffness"].values.keys() & {each.number for each in pair}
    slow = product > 0 and speed < slowest
    early = not slow and lost > (1 - SWALLOWED) * product * speed > 0
    gives_way = bool(soft) and product > 0 and not slow and not early
    if speed < BOUNCES_M_S and uses and not slow:
        return None  # one that is so slow may have bounced before
    if not (slow or early or gives_way) and (
        product > 0 or unwanted > 0 or soft or speed < slowest
    ):
        return None  # it bounces as the engine has it: a link has none, or it came later
    share = product if product > 0 else wanted
    # It may have had another when they met; or a call asked for just that.
    meant = springy.number in bouncy.changed or bouncy.since[springy.number] >= step
    meant |= none.number in bouncy.values and unwanted == 0
    if meant or rebound > SWALLOWED * share * speed:
        return None
    chosen = {
        number
        for number, value in bouncy.values.items()
        if value > 0 and seen.bodies[number].moving and seen.bodies[number].client == none.client
    }
    # A floor has restitution for other things.
    if not (springy.moving or none.number in chosen or not (none.joints or chosen)):
        return None
    return {
        "slow": slow,
        "early": early,
        "gives_way": gives_way,
        "slowest": slowest,
        "asked": wanted,
        "speed": speed,
        "rebound": max(rebound, 0.0),
        "gap": gap * 1e3,
        "springless": none.label,
        # With more than 1 in all it would gain energy.
        "most": 1 / max(wanted, 1.0),
        "share": share,
        "lost": share * speed,
        "called": bouncy.site(springy.number),
    }


no_restitution.rows(
    SayingRow(
        when=lambda slow: slow,
        why=Message(
            "PyBullet lets nothing bounce that comes slower than {slowest:g} m/s, its "
            "restitutionVelocityThreshold"
        ),
        cure=Remedy("solver", value=0.0, given={"restitutionVelocityThreshold": 0}),
    ),
    SayingRow(
        when=lambda early: early,
        why=Message(
            "PyBullet stops it {gap:.3g} mm before they touch, and takes that distance over the "
            "timestep off its rebound"
        ),
        advice=Message("{call} on both lets contacts act only where they touch"),
        cure=Remedy(
            "restitution", given={"contactProcessingThreshold": 0}, bodies=("body", "other")
        ),
    ),
    SayingRow(
        when=lambda gives_way: gives_way,
        why=Message(
            "with contactStiffness and contactDamping it lands on a spring with a damper, which "
            "takes the rebound"
        ),
        advice=Message("leave both out of p.changeDynamics, or give a smaller contactDamping"),
    ),
    SayingRow(
        why=Message("restitution is the product of both bodies', {asked:.3g} × 0"),
        advice=Message("give {springless} restitution, too: {call}"),
        cure=Remedy("restitution", "springless", "most", bodies=("springless",)),
    ),
    like=SayingRow(
        says=Message(
            "{body} does not bounce off {other}: it meets it at {speed:.3g} m/s and leaves at "
            "{rebound:.3g} m/s; {why}"
        ),
        effect="lost",
        unit="m/s",
        share="share",
        site="called",
    ),
)


# -- energy-gained --------------------------------------------------------------------------------


FINER = 4.0
"""Divisor by which a trial reduces the timestep."""


@pair_rule("energy-gained", "broken", consecutive=True, argument="restitution", engines=ANY)
def energy_gained(pair: PairColumns, placing: Placing, seen: Seen, chunk: StepChunk) -> Match:
    """Two bodies leave a contact with more energy than they had, without calls or joints."""
    rows = np.flatnonzero((pair.pairs.normal_n > 0) & (pair.body != pair.other))
    bodies, steps = pair.pairs.body[rows], pair.step[rows]
    moved = placing.moved(bodies, steps[:, None]).any(axis=1)
    solref = _solref(pair, rows, seen)
    # Less damped than critically, or by a number of its own; what else did it is not sure.
    springs = ((solref[:, 0] < 0) | (solref[:, 1] < 1)).astype(float)
    restitution = np.where(np.isnan(solref[:, 0]), pair.pairs.restitution[rows], springs)
    return Match(
        rows,
        np.zeros(len(rows)),
        sums={"gained": pair.pairs.energy_j[rows].sum(axis=1)},
        most={
            "unsure": moved | ~pair.pairs.explained[rows].all(axis=1),
            "restitution": restitution,
        },
        firsts={
            "brought": _kinetic_j(pair, rows, chunk),
            "approach": pair.pairs.approach_m_s[rows],
            "solref": solref,
            "timestep": pair.timestep_s[rows],
        },
        lasts={"parting": pair.pairs.parting_m_s[rows]},
        keys=pair.keys[rows],
    )


@energy_gained.counts
def _(
    restitution: Float64,
    parting: Float64,
    approach: Float64,
    unsure: Flags,
    gained: Float64,
    brought: Float64,
) -> Float64:
    # Without restitution what did it is not sure.
    faster = (restitution > 0) & (parting > approach) & (approach > 0)
    gains = faster & ~unsure & (gained > GAINED * brought) & (brought > 0)
    return np.where(gains, gained, 0.0)


@energy_gained.notes
def _(touches: TouchTable, subject: Body, partner: Body, solref: list[float]) -> Noted | None:
    if any(each.moving and len(touches.rows(each.number)) > 1 for each in (subject, partner)):
        return None  # a third body may have given it
    return {"soft": " ".join(f"{each:g}" for each in np.ravel(solref))}


GAINS = Message(
    "contact of {body} with {other} adds {gained:.3g} J to {brought:.3g} J of kinetic "
    "energy: they come together at {approach:.4g} m/s and part at {parting:.4g} m/s; their "
    "restitution is {restitution:.3g}, and {why}"
)
energy_gained.rows(
    SayingRow(
        engines=MUJOCOS,
        says=Message(
            "contact of {body} with {other} adds {gained:.3g} J to {brought:.3g} J of kinetic "
            "energy: they come together at {approach:.4g} m/s and part at {parting:.4g} m/s; it is "
            "a spring (solref {soft}) that acts for {steps} of {timestep:g} s"
        ),
        advice=Message("use a shorter timestep: {call}, or more damping in solref"),
        cure=Remedy("timestep", value=FINER),
    ),
    SayingRow(
        when=lambda seen, subject: subject.client in seen.clients_with("set_contactERP", 0),
        says=GAINS,
        why=Message("it turns the speed around that gravity gives them in that step, too"),
        advice=Message("give them less restitution, or use a shorter timestep: {call}"),
        cure=Remedy("timestep", value=FINER),
    ),
    SayingRow(
        says=GAINS,
        why=Message("the push out of the overlap comes on top"),
        advice=Message("give them less restitution, or no push: {call}"),
        cure=Remedy("solver", value=0.0, given={"contactERP": 0}),
    ),
    like=SayingRow(effect="gained", unit="J", normal="brought"),
)


def _solref(pair: PairColumns, rows: NDArray[np.intp], seen: Seen) -> Float64:
    """Return `solref` of each row's first contact, shape (rows, 2); nan for other engines."""
    seen, first = seen, pair.starts[rows]
    if not seen.softness:
        return np.full((len(rows), 2), np.nan)
    places = np.column_stack([pair.points.body[first], pair.points.link[first]])
    known, _, which = distinct_rows(places)
    soft = [seen.soft(each[:2], each[2:]) for each in known.tolist()]
    held = [(np.nan, np.nan) if each is None else each[0][:2] for each in soft]
    return np.reshape(held, (-1, 2))[which]


def _kinetic_j(pair: PairColumns, rows: NDArray[np.intp], chunk: StepChunk) -> Float64:
    """Return the kinetic energy of both bodies before the steps in which they first touch.

    The energy is 0 for bodies at rest and nan for bodies with joints; shape (rows,) [J].
    """
    energy_j, bodies = np.zeros(len(rows)), pair.pairs.body[rows]
    begins = np.flatnonzero(pair.before(rows) < 0)
    for side in (0, 1):
        number, step = bodies[begins, side], pair.step[rows[begins]]
        of_side = np.where(np.isin(number, [*chunk.judged]), np.nan, 0.0)
        for steps, its, at in chunk.steps_at(number, step):
            if steps.law.tree.size == 6:
                of_side[its] = energy_of(steps.law, steps.before.at(at), np.zeros((len(at), 3)))[0]
        energy_j[begins] += of_side
    return energy_j
