"""`reading`: what a number that the script reads stands for."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from drop_physics.messages import Message
from drop_physics.rules.inputs import Inputs
from drop_physics.rules.rule import Said, input_rule
from drop_physics.rules.thresholds import STALE_M
from drop_physics.trace.acts import Act
from drop_physics.trace.readings import Reading


def _site(reading: Reading) -> str:
    return f"{reading.file}:{reading.line}"


@input_rule("reading", "note", "reading-stale")
def stale(inputs: Inputs) -> Iterator[Said]:
    """The pose of a link is that of one step earlier, unless it is computed again."""
    for each in inputs.scene.seen.readings:
        if each.act is not Act.READ_LINK:
            continue
        if each.flags.get("computeForwardKinematics", 0) != 0 or each.last_step < 1:
            continue
        ways = [
            (inputs.link_way_m.get((each.number, s.body, s.link), 0.0), s)
            for s in each.targets
            if s.link is not None
        ]
        way_m, subject = max(ways, default=(0.0, None), key=lambda one: one[0])
        if subject is None or way_m < STALE_M or subject.link is None:
            continue
        body = inputs.scene.seen.bodies[subject.body]
        message = Message(
            "the pose of {link} that p.{function} gives is one step old: {way:.2g} mm where it is "
            "fastest",
            link=body.links[subject.link + 1],
            function=each.function,
            way=way_m * 1e3,
        )
        advice = Message(
            "p.{function}(…, computeForwardKinematics=True) gives that of now",
            function=each.function,
        )
        yield Said(
            subject=body, site=_site(each), message=message, advice=advice, share=way_m / STALE_M
        )


@input_rule("reading", "note", "reading-static")
def static(inputs: Inputs) -> Iterator[Said]:
    """The velocity of a base that only calls move is what a call gave it, and 0 without one."""
    posed = {u.body.number: u for u in inputs.of(Act.SET_POSE) if u.body is not None}
    given = {u.body.number for u in inputs.of(Act.SET_VELOCITY) if u.body is not None}
    for each in inputs.scene.seen.readings:
        if each.act is not Act.READ_VELOCITY:
            continue
        for number in {s.body for s in each.targets}:
            body = inputs.scene.seen.bodies.get(number)
            use = posed.get(number)
            if body is None or use is None or body.base_moves or number in given:
                continue
            if len(use.steps) < 2 or use.constant("posObj"):
                continue
            message = Message(
                "the velocity of {body} that p.getBaseVelocity gives is 0: it has no mass, and "
                "calls move it by its pose alone",
                body=body.label,
            )
            advice = Message("p.resetBaseVelocity(body, …) beside the pose gives it one")
            yield Said(subject=body, site=_site(each), message=message, advice=advice, share=1.0)


@input_rule("reading", "note", "reading-torque")
def torque(inputs: Inputs) -> Iterator[Said]:
    """`getJointState` gives the torque of the motor, and not that of TORQUE_CONTROL."""
    for each in inputs.scene.seen.readings:
        if each.act is not Act.READ_JOINT:
            continue
        for subject in each.targets:
            joint = (subject.body, subject.link)
            if subject.link is None or joint not in inputs.torque_alone:
                continue
            body = inputs.scene.seen.bodies[subject.body]
            message = Message(
                "the torque of {joint} that p.{function} gives is its motor's, which is off: 0, "
                "whatever p.TORQUE_CONTROL applies",
                joint=body.joints[subject.link].name,
                function=each.function,
            )
            advice = Message("the torque is the one that the script gives")
            name = body.joints[subject.link].name
            yield Said(
                subject=body,
                joint=name,
                site=_site(each),
                message=message,
                advice=advice,
                share=1.0,
            )
            break


@input_rule("reading", "note", "reading-depth")
def depth(inputs: Inputs) -> Iterator[Said]:
    """The depth buffer of a camera with perspective is not linear in the distance."""
    for each in inputs.scene.seen.readings:
        lens = each.camera
        if lens is None or lens.near_far_m is None or lens.projection[11] == 0:
            continue
        near, far = lens.near_far_m
        if not 0 < near < far < np.inf:
            continue
        message = Message(
            "the depth that p.getCameraImage gives is no distance: from 0 at near={near:.3g} m to "
            "1 at far={far:.3g} m, and not linear",
            near=near,
            far=far,
        )
        advice = Message("far * near / (far - (far - near) * depth) is the distance in m")
        yield Said(site=_site(each), message=message, advice=advice)
        return
