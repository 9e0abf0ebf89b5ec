"""`not-taken`: what the engine ignores of what was asked."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from drop_physics.messages import Message
from drop_physics.rules.answer import Cure
from drop_physics.rules.input_rule import InputSubject, input_rule
from drop_physics.rules.inputs import Inputs, Use
from drop_physics.rules.joint import effort
from drop_physics.rules.rule import Match, Said, Worst, joint_rule
from drop_physics.rules.tables import JointColumns
from drop_physics.rules.thresholds import COASTS_RAD_S, COASTS_STEPS, SCALE
from drop_physics.trace.acts import Act

IK_LISTS = ("lowerLimits", "upperLimits", "jointRanges", "restPoses")


@joint_rule("not-taken", "asked", reason="no-effect", least_count=COASTS_STEPS)
def joint_friction(joints: JointColumns) -> Match:
    """PyBullet never uses `<dynamics friction>` of a joint, which coasts with its motor off."""
    friction = joints.of_joints(lambda joint: joint.friction)
    off = (joints.impulse == 0) & (joints.pd != 1) & (joints.steps.reported.commanded == 0)
    where = off & (friction > 0) & (np.abs(joints.rate) > COASTS_RAD_S)
    return Match(where, np.abs(joints.rate), {"friction": friction})


@joint_friction.says
def _(worst: Worst) -> Said:
    return Said(
        message=Message(
            '{joint} coasts: PyBullet never uses the <dynamics friction="{friction:g}"/> of its '
            "file",
            joint=worst.joint,
            friction=worst.friction,
        ),
        advice=Message(
            "p.setJointMotorControl2(…, {link}, p.VELOCITY_CONTROL, targetVelocity=0, "
            "force={friction:g}) resists with {force}",
            link=worst.link,
            friction=worst.friction,
            force=effort(worst.friction, worst.effort),
        ),
        cure=Cure("force", worst.joint, worst.friction),
    )


@joint_rule("not-taken", "asked", reason="no-effect", least_count=COASTS_STEPS)
def ball_velocity(joints: JointColumns) -> Match:
    """The motor of a ball joint takes no target velocity."""
    ball = joints.of_joints(lambda joint: float(joint.kind == "spherical")) > 0
    asked = np.abs(joints.target_velocity)
    where = ball & (asked > 0) & (joints.kp == 0) & (joints.torque == 0) & (joints.rate == 0)
    return Match(where, asked, {"asked": joints.target_velocity})


@ball_velocity.says
def _(worst: Worst) -> Said:
    return Said(
        message=Message(
            "{joint} stays where it is, though its targetVelocity is {asked:.3g} rad/s: the motor "
            "of a ball joint has no velocity target",
            joint=worst.joint,
            asked=worst.asked,
        ),
        advice=Message(
            "switch its motor off with p.setJointMotorControlMultiDof(…, "
            "p.POSITION_CONTROL, targetPosition=[0, 0, 0, 1], force=[0, 0, 0]), and turn it "
            "with p.TORQUE_CONTROL, or give target positions"
        ),
    )


@input_rule("not-taken", "asked", "no-effect")
def ik_lists(inputs: Inputs) -> Iterator[tuple[InputSubject, Said]]:
    """Inverse kinematics ignores lists that do not have one number for each movable joint."""
    for use in inputs.of(Act.SOLVE_IK, Act.SOLVE_SEVERAL_IK):
        if use.body is None:
            continue
        movable = sum(1 for joint in use.body.joints if joint.widths[1])
        widths = {name: len(use.low[name]) for name in IK_LISTS if name in use.low}
        wrong = [(name, width) for name, width in widths.items() if width != movable]
        if not wrong:
            continue
        name, width = wrong[0]
        message = Message(
            "inverse kinematics ignores {name}, and all four lists with it: it has a length of "
            "{width}, and {body} has {movable} joints that move",
            name=name,
            width=width,
            body=use.body.label,
            movable=movable,
        )
        advice = Message("give lists with one number for each joint that moves: {n}", n=movable)
        yield (
            InputSubject(use.first, use.body),
            Said(message=message, advice=advice),
        )


@input_rule("not-taken", "asked", "other-client")
def other_client(inputs: Inputs) -> Iterator[tuple[InputSubject, Said]]:
    """A setter without `physicsClientId` is client 0's, and the other simulation has none."""
    for act in (Act.SET_GRAVITY, Act.SET_TIMESTEP, Act.SET_ENGINE):
        mine, left = inputs.left_out(act)
        count = sum(use.count for use in mine)
        if not left:
            continue
        message = Message(
            "p.{function} is called {count} times for client 0, and never for client {client}: "
            "without physicsClientId a call is client 0's",
            function=act.function,
            count=count,
            client=left[0],
        )
        advice = Message(
            "p.{function}(…, physicsClientId={client})", function=act.function, client=left[0]
        )
        given = {"function": act.function, "client": left[0]}
        cure = Cure("right-client", str(left[0]), given=given)
        yield InputSubject(mine[0].first), Said(message=message, advice=advice, cure=cure)


@input_rule("not-taken", "asked", "scale-keeps-mass")
def scale_keeps_mass(inputs: Inputs) -> Iterator[tuple[InputSubject, Said]]:
    """`globalScaling` scales what a body looks like, and leaves the mass of its file."""
    heavy = {each.body.number for each in inputs.requests if each.name == "mass" and each.body}
    for number, body in inputs.scene.seen.bodies.items():
        scale = body.asked.scale
        touches = any(number in pair and _moving(inputs, pair) for pair in inputs.touched)
        first = inputs.first_dynamics(body)
        mass_kg = 0.0 if first is None else float(np.nansum(first.reported["mass_kg"]))
        if 1 / SCALE <= scale <= SCALE or number in heavy or not touches or not mass_kg > 0:
            continue
        message = Message(
            "{body} has the {mass:.3g} kg of its file at {scale:.3g} times the file's size: "
            "globalScaling leaves masses as they are; of the same density it would have "
            "{dense:.2g} kg",
            body=body.label,
            mass=mass_kg,
            scale=scale,
            dense=mass_kg * scale**3,
        )
        advice = Message("p.changeDynamics(body, -1, mass={dense:.2g})", dense=mass_kg * scale**3)
        load = inputs.scene.asked.load(body)
        cure = Cure("mass", body.label, float(f"{mass_kg * scale**3:.2g}"))
        share = float(abs(np.log10(scale**3)))
        said = Said(message=message, advice=advice, cure=cure, share=share)
        yield InputSubject(load, body), said


def _moving(inputs: Inputs, pair: tuple[int, int]) -> bool:
    bodies = inputs.scene.seen.bodies
    return all(number in bodies and bodies[number].base_moves for number in pair)


@input_rule("not-taken", "asked", "contact-despite-filter")
def contact_despite_filter(inputs: Inputs) -> Iterator[tuple[InputSubject, Said]]:
    """Two bodies touch if either one's mask lets them, unless collisionFilterMode is 0."""
    masks: dict[int, Use] = {}
    for use in inputs.of(Act.FILTER_GROUP):
        if use.body is not None and "collisionFilterMask" in use.low:
            masks[use.body.number] = use
    strict = [
        use.last.values["collisionFilterMode"][0] == 0
        for use in inputs.of(Act.SET_ENGINE)
        if "collisionFilterMode" in use.low
    ]
    for pair, steps in inputs.touched.items():
        if not all(number in masks for number in pair) or (strict and strict[-1]):
            continue
        group, mask = (
            [int(masks[n].last.values[f"collisionFilter{which}"][0]) for n in pair]
            for which in ("Group", "Mask")
        )
        lets = [bool(group[k] & mask[1 - k]) for k in (0, 1)]
        if lets[0] == lets[1]:
            continue
        bodies = [masks[n].body for n in pair]
        off, on = (bodies[1], bodies[0]) if not lets[0] else (bodies[0], bodies[1])
        message = Message(
            "{off} is not to touch {on} by its mask, and touches it in {steps:,} steps: either "
            "one's mask is enough, as collisionFilterMode is OR by default",
            off=off.label if off else "",
            on=on.label if on else "",
            steps=steps,
        )
        advice = Message("p.setPhysicsEngineParameter(collisionFilterMode=0) asks both masks")
        subject = InputSubject(masks[off.number].last if off else None, off)
        cure = Cure("collision-off", form="both-masks")
        other = on.label if on else None
        yield subject, Said(message=message, advice=advice, cure=cure, other=other)
