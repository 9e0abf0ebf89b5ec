"""The rule about joints that PyBullet's default motor holds in place."""

from __future__ import annotations

import numpy as np

from drop_physics.arrays import Flags, Float64, Int64
from drop_physics.explain.commands import DEFAULT
from drop_physics.explain.joints import DrivenJoints
from drop_physics.messages import Message
from drop_physics.rules.answer import Cure
from drop_physics.rules.body_properties import length_m
from drop_physics.rules.inputs import Inputs
from drop_physics.rules.rows import Noted, SayingRow
from drop_physics.rules.rule import Match, joint_rule
from drop_physics.rules.runs import Runs
from drop_physics.rules.tables import JointColumns
from drop_physics.rules.thresholds import (
    COASTS_STEPS,
    HOLDS,
    LIMITED_OFTEN,
    MOVES,
    NO_TERM,
    ROLLS,
    SAME_SIGN,
)
from drop_physics.trace.events import Body

CAUSES = {
    "gravity": Message("its weight"),
    "contacts": Message("contacts"),
    "applied": Message("forces that calls apply"),
    "constraints": Message("constraints"),
}
"""Terms that push a joint against the default motor, with their descriptions."""
TORQUE = np.array([[[False, True]]])
"""Index of the table's plane for joints driven by torques."""


@joint_rule("default-motor", "asked", commanded=False, least_count=COASTS_STEPS)
def default_motor(joints: JointColumns) -> Match | None:
    """A joint is held by its motor against torques, weight or a collision."""
    steps, default, torqued = (
        joints.steps,
        joints.mode == DEFAULT,
        ~np.isnan(joints.asked.torque_since),
    )
    # Until a call gives it another motor, it was to stay where it was.
    sent = ~default & ~torqued
    on = (joints.asked.impulse > 0) & (joints.asked.pd != 1) & (steps.closes & ~steps.put)[:, None]
    on &= steps.covered and not joints.body.before
    terms = {name: joints.term(name) for name in steps.terms if name != "motors"}
    acting = sum(terms.values(), np.zeros(on.shape))
    largest = np.max([np.abs(term) for term in terms.values()], axis=0, initial=0.0)
    sign = np.sign(acting) * (np.abs(acting) > NO_TERM * largest)
    # What carries a robot that stands is not to move it, but for the wheels of one that is to roll.
    contacts = np.abs(joints.term("contacts"))
    gravity = steps.terms.get("gravity", np.zeros((len(on), steps.law.tree.size)))
    weight = np.linalg.norm(gravity[:, : steps.law.tree.first_rate], axis=1)
    whole = weight[:, None] * joints.of_joints(lambda joint: length_m(joints.body, joint) / 2)
    wheel = default.all() & (np.abs(joints.term("gravity")) < NO_TERM * whole)
    wheel &= (contacts > ROLLS * whole) & (joints.term("constraints") == 0)
    carried = steps.law.tree.fixed or _hangs(joints)
    asks = {name: carried | wheel | (name in ("applied", "constraints")) for name in CAUSES}
    acting, motor = acting * np.abs(sign), joints.term("motors")
    sums = {
        "acting": np.abs(acting),
        "net": acting,
        **{name: joints.term(name) * sign * ask for name, ask in asks.items()},
        "taken": np.minimum(-motor * sign, np.abs(acting)).clip(0),
        "weak": joints.at_limit,
        "time": steps.reported.timestep_s[:, None],
    }
    own = on & ~torqued & default & ~sent.any(axis=0)
    # In the step of the first torque it may still get a motor, as it does in turn with torques.
    torques = on & (joints.asked.torque_since < joints.step[:, None] - 1)
    planes = np.stack([own, torques], axis=2)
    where = planes | np.stack([sent, np.zeros_like(sent)], axis=2)
    return Match(
        where,
        np.zeros(where.shape),
        {"torque": TORQUE},
        {name: each[:, :, None] * planes for name, each in sums.items()},
        {"most": np.abs(joints.torque)},
        lasts={
            "sent": sent,
            "own": default,
            "limit": joints.limit,
            "motor_site": joints.asked.site,
            "inertia": joints.inertia,
            "torque_site": joints.asked.torque_site,
        },
        counts=planes.astype(np.int64),
    )


@default_motor.counts
def _(
    runs: Runs,
    acting: Float64,
    inertia: Float64,
    taken: Float64,
    net: Float64,
    torque: Flags,
    sent: Flags,
    keys: Int64,
    weak: Float64,
    count: Int64,
) -> Float64:
    holds = (acting > MOVES * inertia) & (taken > HOLDS * acting)
    asks = np.max([runs[name] for name in CAUSES], axis=0)
    asked = (asks > HOLDS * acting) & (np.abs(net) > SAME_SIGN * acting)
    holds &= torque | (asked & ~sent)
    # Where torques are commanded, they are what the reader asks about; nothing is held where one
    # motor has to give way.
    torqued = np.isin(keys[:, 0], keys[holds & torque, 0])
    gives = ~torque & (weak > LIMITED_OFTEN * count)
    torqued |= np.isin(keys[:, 0], keys[gives, 0])
    return np.where(holds & (torque | ~torqued), taken, 0.0)


@default_motor.notes
def _(
    inputs: Inputs,
    telemetry: DrivenJoints,
    subject: Body,
    joint: str,
    link: int,
    torque: bool,
    own: bool,
    gravity: float,
    contacts: float,
    applied: float,
    constraints: float,
    acting: float,
    taken: float,
    time: float,
    motor_site: float,
    torque_site: float,
) -> Noted | None:
    asks = dict(zip(CAUSES, (gravity, contacts, applied, constraints), strict=True))
    term = max(CAUSES, key=lambda name: asks[name])
    commanded = any(inputs.commanded.values())
    if commanded and not torque and term == "gravity":
        return None  # who commands others may want it to hold its weight
    ball = subject.joints[link].kind == "spherical"
    motor = Message("the velocity motor that PyBullet gives every joint")
    if ball:
        motor = Message("the position motor to 0 that PyBullet gives every ball joint")
    elif not own:
        motor = Message(
            "the motor set at {site}, which still acts", site=telemetry.cited(motor_site)
        )
    return {
        "motor": motor,
        "given": taken / time,
        "share": min(taken / acting, 1.0),
        "term": CAUSES[term],
        "level": "note" if commanded and not torque else None,
        "cure": Cure("default-motor-off", joint, form="ball" if ball else ""),
        "called": telemetry.cited(torque_site),
    }


default_motor.rows(
    SayingRow(
        when=lambda torque: torque,
        says=Message(
            "{joint} does not follow the torques that it is given, but is held by {motor}: it "
            "takes up to {most:N}, {share:.0%} of what acts on it"
        ),
        proposed=False,
    ),
    SayingRow(
        says=Message(
            "{joint} is held by {motor}: it takes {share:.0%} of what acts on it, mainly {term}, "
            "{given:N} of its {limit:N} on average"
        ),
        proposed=True,
    ),
    like=SayingRow(
        advice=Message("turn it off: {call}"),
        effect="most",
        unit="{effort}",
        share="share",
        site="called",
    ),
)


def _hangs(joints: JointColumns) -> bool:
    """Return whether constraints hold up the base, except those between the body's own links."""
    pulls = np.abs(joints.steps.terms.get("constraints", np.zeros((1, 1))))
    along = pulls[:, 3 : joints.steps.law.tree.first_rate]
    return bool(along.max(initial=0.0) > NO_TERM * pulls.max(initial=0.0))
