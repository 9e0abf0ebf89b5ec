"""The rule `not-taken`: what a script or its model asks for, and the engine ignores."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from drop_physics.arrays import Flags, Float64
from drop_physics.explain.bodies import Record
from drop_physics.messages import Message
from drop_physics.physics.tree import BASE
from drop_physics.physics.vectors import lengths
from drop_physics.rules.body_properties import AskedOfBodies
from drop_physics.rules.engines import MUJOCOS
from drop_physics.rules.ik_answers import IK_LISTS
from drop_physics.rules.indexed import bodies_of, body_at
from drop_physics.rules.inputs import Inputs, Use
from drop_physics.rules.rows import Case, Noted, Remedy, SayingRow
from drop_physics.rules.rule import Match, actuator_rule, input_rule, joint_rule, pair_rule
from drop_physics.rules.tables import ActuatorColumns, JointColumns, PairColumns
from drop_physics.rules.thresholds import (
    AT_TARGET_RAD,
    COASTS_RAD_S,
    COASTS_STEPS,
    LEFT_M,
    ROLLING,
    ROLLS_SLIP,
    SCALE,
    WHEEL_TURN_RAD,
)
from drop_physics.trace.acts import Act
from drop_physics.trace.events import Body
from drop_physics.trace.history import Seen
from drop_physics.trace.motors import POSITION, VELOCITY
from drop_physics.trace.switches import NO_ACTUATION, is_off


@joint_rule("not-taken", "asked", reason="no-effect", least_count=COASTS_STEPS)
def joint_friction(joints: JointColumns) -> Match:
    """PyBullet ignores the `<dynamics friction>` of a joint, which coasts with its motor off."""
    friction = joints.of_joints(lambda joint: joint.friction)
    off = (
        (joints.asked.impulse == 0)
        & (joints.asked.pd != 1)
        & (joints.steps.reported.commanded == 0)
    )
    where = off & (friction > 0) & (np.abs(joints.rate) > COASTS_RAD_S)
    return Match(where, np.abs(joints.rate), {"friction": friction})


joint_friction.rows(
    SayingRow(
        says=Message(
            '{joint} coasts: PyBullet never uses the <dynamics friction="{friction:g}"/> of its '
            "file"
        ),
        advice=Message("a velocity motor of that force resists: {call}"),
        cure=Remedy("force", "joint", "friction"),
    )
)


@joint_rule("not-taken", "asked", reason="no-effect", least_count=COASTS_STEPS)
def without_force(joints: JointColumns) -> Match:
    """A motor with a force of 0 is off, whatever its target."""
    asked, speed, placed = joints.asked, joints.target_velocity, joints.mode == POSITION
    off = np.abs(joints.after - asked.target)
    misses = placed & (asked.pd != 1) & (off > joints.at_target)
    misses |= (joints.mode == VELOCITY) & (speed != 0)
    return Match(
        misses & (asked.force == 0) & (joints.steps.reported.commanded == 0),
        np.where(placed, off, np.abs(speed)),
        {"target": asked.target, "speed": speed, "placed": placed},
        most={"high": asked.target, "low": -asked.target, "told_last": asked.told},
        firsts={"told_first": asked.told},
    )


@without_force.counts
def _(
    placed: Flags,
    high: Float64,
    low: Float64,
    told_last: Float64,
    told_first: Float64,
    size: Float64,
) -> Float64:
    # One that stands, or is told once, may be there to turn the motor off.
    changes = np.where(placed, high + low > AT_TARGET_RAD, told_last > told_first)
    return np.where(changes, size, 0.0)


without_force.rows(
    SayingRow(
        when=lambda placed: placed,
        says=Message(
            "{joint}{more} is {size:gap} off its target of {target:at}: a motor that is given "
            "force=0 is off"
        ),
    ),
    SayingRow(
        says=Message(
            "{joint}{more} is asked for {speed:.3g} {unit}/s: a motor that is given force=0 is off"
        ),
        unit="{unit}/s",
    ),
    like=SayingRow(
        advice=Message("give it a force, or no force=…, which lets it take any"), effect="size"
    ),
)


@joint_rule("not-taken", "asked", reason="no-effect", least_count=COASTS_STEPS)
def ball_velocity(joints: JointColumns) -> Match:
    """The motor of a ball joint takes no target velocity."""
    ball = joints.of_joints(lambda joint: float(joint.kind == "spherical")) > 0
    asked = np.abs(joints.target_velocity)
    where = ball & (asked > 0) & (joints.asked.kp == 0) & (joints.torque == 0) & (joints.rate == 0)
    return Match(where, asked, {"asked": joints.target_velocity})


ball_velocity.rows(
    SayingRow(
        says=Message(
            "{joint} stays where it is, though its targetVelocity is {asked:.3g} rad/s: the motor "
            "of a ball joint has no velocity target"
        ),
        advice=Message(
            "switch its motor off with p.setJointMotorControlMultiDof(…, "
            "p.POSITION_CONTROL, targetPosition=[0, 0, 0, 1], force=[0, 0, 0]), and turn it "
            "with p.TORQUE_CONTROL, or give target positions"
        ),
    )
)


@input_rule("not-taken", "asked", "no-effect")
def damping_of_base(inputs: Inputs) -> Iterator[Case]:
    """Joint damping belongs to a link; PyBullet ignores it in a call for the base."""
    uses = [use for use in inputs.of(Act.SET_PROPERTY) if use.body and "jointDamping" in use.low]
    links = {use.body.number for use in uses if use.body and use.high["linkIndex"][0] >= 0}
    for use in uses:
        joints = sum(bool(joint.widths[1]) for joint in use.body.joints) if use.body else 0
        if use.body and joints and use.body.number not in links:
            damping = float(use.high["jointDamping"][0])
            yield Case(call=use.first, subject=use.body, values={"damping": damping, "n": joints})


damping_of_base.rows(
    SayingRow(
        says=Message(
            "jointDamping={damping:g} given to the base of {body} damps none of its {n} joints "
            "that move: a joint's damping goes by its link"
        ),
        advice=Message("p.changeDynamics(body, joint, jointDamping=…) for each joint"),
    )
)


@input_rule("not-taken", "asked", "no-effect")
def ik_lists(inputs: Inputs) -> Iterator[Case]:
    """Inverse kinematics ignores lists without one number for each movable joint."""
    for use in inputs.of(Act.SOLVE_IK, Act.SOLVE_SEVERAL_IK):
        movable = sum(1 for joint in use.body.joints if joint.widths[1]) if use.body else 0
        widths = {name: len(use.low[name]) for name in IK_LISTS if name in use.low}
        wrong = {name: width for name, width in widths.items() if use.body and width != movable}
        for name, width in [*wrong.items()][:1]:
            told = {"name": name, "width": width, "movable": movable, "n": movable}
            yield Case(call=use.first, subject=use.body, values=told)


ik_lists.rows(
    SayingRow(
        says=Message(
            "inverse kinematics ignores {name}, and all four lists with it: it has a length of "
            "{width}, and {body} has {movable} joints that move"
        ),
        advice=Message("give lists with one number for each joint that moves: {n}"),
    )
)


@input_rule("not-taken", "asked", "other-client")
def other_client(inputs: Inputs) -> Iterator[Case]:
    """A setter without `physicsClientId` acts on client 0, and not on the other simulation."""
    for act in (Act.SET_GRAVITY, Act.SET_TIMESTEP, Act.SET_ENGINE):
        mine, left = inputs.left_out(act)
        for client in left[:1]:
            count = sum(use.count for use in mine)
            told = {"function": act.function, "client": client, "count": count}
            yield Case(call=mine[0].first, values={**told, "target": str(client)})


other_client.rows(
    SayingRow(
        says=Message(
            "p.{function} is called {count} times for client 0, and never for client {client}: "
            "without physicsClientId a call is client 0's"
        ),
        cure=Remedy("right-client", "target", given={"function": "function", "client": "client"}),
    )
)


@input_rule("not-taken", "asked", "scale-keeps-mass")
def scale_keeps_mass(inputs: Inputs, seen: Seen, asked: AskedOfBodies) -> Iterator[Case]:
    """`globalScaling` scales the shapes of a body, but not its mass."""
    moves = {number for number, body in seen.bodies.items() if body.base_moves}
    pushed = set[int]().union(*(pair for pair in inputs.touched if {*pair} <= moves))
    heavy = {
        request.body.number
        for request in inputs.requests
        if request.name == "mass" and request.body
    }
    for number in sorted(pushed - heavy):
        body = seen.bodies[number]
        scale, first = body.asked.scale, inputs.first_dynamics(body)
        mass_kg = 0.0 if first is None else float(np.nansum(first.reported["mass_kg"]))
        if mass_kg > 0 and not 1 / SCALE <= scale <= SCALE:
            dense = mass_kg * scale**3
            yield Case(
                call=asked.load(body),
                subject=body,
                values={
                    "mass": mass_kg,
                    "scale": scale,
                    "dense": dense,
                    "written": float(f"{dense:.2g}"),
                    "part": float(abs(np.log10(scale**3))),
                },
            )


scale_keeps_mass.rows(
    SayingRow(
        says=Message(
            "{body} has the {mass:.3g} kg of its file at {scale:.3g} times the file's size: "
            "globalScaling leaves masses as they are; of the same density it would have "
            "{dense:.2g} kg"
        ),
        cure=Remedy("mass", "body", "written"),
        share="part",
    )
)


@input_rule("not-taken", "asked", "contact-despite-filter")
def contact_despite_filter(inputs: Inputs, seen: Seen) -> Iterator[Case]:
    """Two bodies touch if either mask allows it, unless collisionFilterMode is 0."""
    masks: dict[int, Use] = {}
    for use in inputs.of(Act.FILTER_GROUP):
        if use.body is not None and "collisionFilterMask" in use.low:
            masks[use.body.number] = use
    modes = [
        use.last.values["collisionFilterMode"][0]
        for use in inputs.of(Act.SET_ENGINE)
        if "collisionFilterMode" in use.low
    ]
    for pair, steps in inputs.touched.items():
        if not masks.keys() >= {*pair} or modes[-1:] == [0]:
            continue
        group, mask = (
            [int(masks[n].last.values[f"collisionFilter{which}"][0]) for n in pair]
            for which in ("Group", "Mask")
        )
        lets = [bool(group[k] & mask[1 - k]) for k in (0, 1)]
        if lets[0] == lets[1]:
            continue
        off, on = pair if lets[0] else pair[::-1]
        other = seen.bodies[on].label
        yield Case(
            call=masks[off].last,
            subject=seen.bodies[off],
            values={
                "off": seen.bodies[off].label,
                "on": other,
                "other": other,
                "steps": steps,
            },
        )


contact_despite_filter.rows(
    SayingRow(
        says=Message(
            "{off} is not to touch {on} by its mask, and touches it in {steps:,} steps: either "
            "one's mask is enough, as collisionFilterMode is OR by default"
        ),
        cure=Remedy("collision-off", form="both-masks"),
    )
)


@input_rule("not-taken", "asked", "no-effect", engines=MUJOCOS)
def without_joint(inputs: Inputs, seen: Seen) -> Iterator[Case]:
    """A body without a joint is part of the world: no force moves it."""
    for (client, act, place), force in inputs.lasting.forces.items():
        body = body_at(seen, client, place) if act is Act.SET_BODY_FORCE else None
        if body is None or (body.moving and place):
            continue
        told = {"field": f"{force.call.function}[{place}]", "of_world": place == 0}
        if place == 0:
            first = next(each for each in bodies_of(seen, client) if each.moving)
            told |= {"index": first.engine_id, "body": first.label}
        yield Case(call=force.call, subject=body, values=told)


without_joint.rows(
    SayingRow(
        when=lambda of_world: of_world,
        says=Message("{field} is of the world, which no force moves"),
        advice=Message("the index of the body that is meant, such as {index} of {body}"),
    ),
    SayingRow(
        says=Message(
            "{body} is given {field}, and has no joint: what has none is part of the world, which "
            "no force moves"
        ),
        advice=Message("<freejoint/> in its <body>"),
    ),
    like=SayingRow(share=1.0),
)


@input_rule("not-taken", "model", "inactive", engines=MUJOCOS)
def never_active(inputs: Inputs, seen: Seen, records: Mapping[int, Record]) -> Iterator[Case]:
    """An equality that is never active exerts no force, and its bodies move apart."""
    forces = inputs.lasting.forces
    switched = {client for client, act, _ in forces if act is Act.SET_ACTIVE}
    for equality in seen.equalities:
        number, end = equality.at.call, seen.steps_of(equality.client)
        mine = forces.get((equality.client, Act.SET_ACTIVE, number))
        # A script that switches others knows of this one.
        known = equality.client in switched if mine is None else mine.until(end) > 0
        if (
            equality.active
            or known
            or equality.tendons
            or (equality.link_a, equality.link_b) != (BASE, BASE)
        ):
            continue
        body, other = seen.bodies[equality.body_b], seen.bodies[equality.body_a]
        ways = [_way_m(inputs, one.number, end, records) for one in (body, other)]
        apart_m = float(np.linalg.norm(ways[0] - ways[1]))
        if not apart_m >= LEFT_M:
            continue
        told = {"apart": apart_m, "name": equality.name, "number": number, "mine": mine}
        call = None if mine is None else mine.call
        yield Case(call=call, subject=body, values={"other": other.label, **told})


never_active.rows(
    SayingRow(
        when=lambda mine: mine is not None,
        says=Message(
            "{body} and {other} part by {apart:.3g} m: eq_active[{number}] is written, and a "
            "reset before the next step sets it back, so {name} does not join them"
        ),
    ),
    SayingRow(
        says=Message(
            "{body} and {other} part by {apart:.3g} m: {name}, which joins them, is not active"
        )
    ),
    like=SayingRow(
        advice=Message('active="true" of it, or data.eq_active[{number}] = 1 after each reset'),
        effect="apart",
        share="apart",
    ),
)


def _way_m(inputs: Inputs, number: int, end: int, records: Mapping[int, Record]) -> Float64:
    """Return how far a base moved during the run [m], shape (3,); nan if unknown."""
    motion = inputs.motions.get(number)
    if motion is not None and motion.first_m is not None and motion.last_m is not None:
        return motion.last_m - motion.first_m
    base = records[number].base_at(np.array([0, end]))[:, :3]
    return np.asarray(base[1] - base[0])


@actuator_rule("not-taken", "asked", reason="no-effect", engines=MUJOCOS)
def switched_off(actuators: ActuatorColumns, seen: Seen) -> Match | None:
    """An actuator has a control, but a flag of the model switches all actuators off."""
    if not is_off(seen, actuators.client, NO_ACTUATION):
        return None
    return Match(actuators.given != 0, np.abs(actuators.given))


switched_off.rows(
    SayingRow(
        says=Message(
            "{name} is given up to {size:.4g}, and no actuator acts: a flag of the model switches "
            "actuation off"
        ),
        advice=Message('without <flag actuation="disable"/> of <option>'),
        share=1.0,
        site=Act.SET_CONTROL,
    )
)


ROLLS_WITH = 6
"""The smallest `condim` with which rolling friction acts."""


@pair_rule("not-taken", "asked", reason="no-effect", least_count=COASTS_STEPS, engines=MUJOCOS)
def rolls_on(pair: PairColumns, seen: Seen) -> Match | None:
    """Rolling friction acts only with condim 6: with less, a rolling body is not braked."""
    given = seen.condims.values()
    if not any(1 < condim < ROLLS_WITH and rolling > ROLLING for condim, rolling in given):
        return None
    # What is carried goes along with what it touches; what rolls turns, on what stands still.
    stands = ~pair.points.moves[pair.starts, 1 - pair.side]
    rows = np.flatnonzero((pair.pairs.normal_n > 0) & stands)
    touching, (way, turn) = pair.own(pair.pairs.ended_m_s), np.zeros((2, len(pair.step)))
    for steps, which, at in pair.of_bodies(rows):
        if not steps.law.tree.fixed:
            spin, velocity = np.split(steps.after.velocity[at, :6], 2, axis=1)
            turn[rows[which]] = lengths(spin)
            way[rows[which]] = lengths(velocity - touching[rows[which]])
    # What slips little does not slide.
    rolls, dt = pair.pairs.slip_m_s < ROLLS_SLIP * way, pair.timestep_s
    numbers = {"bodies": pair.pairs.body, "links": pair.links}
    return Match(rolls, way * dt, numbers, {"way": way * dt, "turn": turn * dt})


@rolls_on.counts
def _(turn: Float64, way: Float64) -> Float64:
    # What tips over turns less.
    return np.where(turn > WHEEL_TURN_RAD, way, 0.0)


@rolls_on.notes
def _(seen: Seen, subject: Body, bodies: list[int], links: list[int]) -> Noted | None:
    condim, rolling = seen.condim(bodies, links)
    # What has wheels is driven.
    if subject.joints or not (1 < condim < ROLLS_WITH and rolling > ROLLING):
        return None
    return {"condim": condim, "rolling": rolling}


rolls_on.rows(
    SayingRow(
        says=Message(
            "{body} rolls {way:.3g} m on {other} in {steps}, unbraked: their rolling friction of "
            "{rolling:g} acts with condim 6, and theirs is {condim}"
        ),
        cure=Remedy("friction", "body", float(ROLLS_WITH), form="condim"),
        effect="way",
        normal="body_size_m",
    )
)
