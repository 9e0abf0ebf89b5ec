"""`taken-elsewhere`: what acts, but on something else than was named."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from drop_physics.messages import Message, joined
from drop_physics.rules.answer import Cure, Effect
from drop_physics.rules.arguments import given
from drop_physics.rules.input_rule import InputSubject, input_rule
from drop_physics.rules.inputs import Inputs
from drop_physics.rules.rule import Said
from drop_physics.rules.thresholds import FRAME_APART_M, LEFT_M
from drop_physics.trace.acts import Act
from drop_physics.trace.events import Body
from drop_physics.trace.requests import Request


@input_rule("taken-elsewhere", "asked", "call-elsewhere")
def call_elsewhere(inputs: Inputs) -> Iterator[tuple[InputSubject, Said]]:
    """A call of `changeDynamics` for a link lands on the base where a later setter carries it."""
    lost: dict[int, list[Request]] = {}
    for each in inputs.requests:
        if each.body is not None and each.reached != each.link and not each.taken:
            lost.setdefault(each.body.number, []).append(each)
    for found in lost.values():
        first = found[0]
        its = [each for each in found if each.call.at.call == first.call.at.call]
        body, call = first.body, first.call
        if body is None:
            continue
        names = joined(", ", [each.name for each in its])
        link = body.links[first.link + 1]
        carrier = joined(", ", [n for n in _CARRIERS if n in call.values])
        told = next((each for each in its if each.got is not None and each.elsewhere), None)
        message = Message(
            "{names} given to {link} of {body} went to its base: a call that also has {carrier} "
            "does",
            names=names,
            link=link,
            body=body.label,
            carrier=carrier,
        )
        if told is not None and told.got and told.elsewhere:
            message = Message(
                "{names} given to {link} of {body} went to its base, as in each call that also has "
                "{carrier}: {name} of the link is {got:.3g}, of the base {base:.3g}",
                names=names,
                link=link,
                body=body.label,
                carrier=carrier,
                name=told.name,
                got=told.got[0],
                base=told.elsewhere[0],
            )
        advice = Message("give {carrier} in a call of its own", carrier=carrier)
        carriers = [name for name in _CARRIERS if name in call.values]
        cure = Cure("right-link", link, given={"arguments": carriers})
        said = Said(message=message, advice=advice, cure=cure, share=float(len(found)))
        yield InputSubject(call, body), said


_CARRIERS = (
    "maxJointVelocity",
    "collisionMargin",
    "linearDamping",
    "angularDamping",
    "activationState",
)


@input_rule("taken-elsewhere", "asked", "wrong-body")
def wrong_body(inputs: Inputs) -> Iterator[tuple[InputSubject, Said]]:
    """A body that was made to stay is given mass, and falls."""
    for each in inputs.requests:
        body = each.body
        if body is None or each.name != "mass" or each.link != -1 or not each.asked[0] > 0:
            continue
        moved_m = inputs.motions[body.number].moved_m
        if not _stood(inputs, each) or moved_m < LEFT_M:
            continue
        message = Message(
            "{body} stood still without mass, is given {mass:.3g} kg, and moves {moved:.3g} m away",
            body=body.label,
            mass=each.asked[0],
            moved=moved_m,
        )
        advice = Message(
            "leave {body} out of the call: mass 0 keeps a body in place", body=body.label
        )
        yield (
            InputSubject(each.call, body),
            Said(
                message=message,
                advice=advice,
                cure=Cure(
                    "without",
                    body.label,
                    form="of-body",
                    given={"function": each.call.function},
                ),
                effect=Effect(moved_m, "m"),
                share=moved_m,
            ),
        )


def _stood(inputs: Inputs, request: Request) -> bool:
    """Return whether a body had no mass before a request: by the engine, its load or its file.

    What a call itself made massless is let go on purpose; so is what is made without mass, unless
    its line gives mass to bodies that have some, too.
    """
    body = request.body
    if request.before is not None:
        return request.before[0] == 0 and not any(
            each.body is body and each.name == "mass" and each.asked[0] == 0
            for each in inputs.requests
        )
    load = None if body is None else inputs.scene.asked.load(body)
    if body is None or load is None:
        return False
    if load.act is Act.MAKE:
        return not _made_kg(inputs, body) and any(
            each.name == "mass" and each.call.site.place == request.call.site.place
            for each in inputs.requests
            if each.body is not None and _made_kg(inputs, each.body)
        )
    fixed = given(load, "useFixedBase") or (0.0,)
    return fixed[0] == 1 or any(link.mass_kg == 0 for link in body.asked.links[:1])


def _made_kg(inputs: Inputs, body: Body) -> float:
    """Return the mass with which a body was made; 0 of one from a file."""
    load = inputs.scene.asked.load(body)
    return 0.0 if load is None else (given(load, "baseMass") or (0.0,))[0]


@input_rule("taken-elsewhere", "asked", "ik-index")
def ik_index(inputs: Inputs) -> Iterator[tuple[InputSubject, Said]]:
    """Answers of inverse kinematics are sent to joints by their index, fixed joints among them."""
    for use in inputs.of(Act.SOLVE_IK, Act.SOLVE_SEVERAL_IK):
        body = use.body
        if body is None:
            continue
        commanded = inputs.commanded[body.number]
        movable = [joint.link for joint in body.joints if joint.widths[1]]
        fixed = [joint for joint in body.joints if not joint.widths[1] and joint.link in commanded]
        left = [link for link in movable if link not in commanded]
        if not fixed or not left or len(commanded) != len(movable):
            continue
        message = Message(
            "commands go to {fixed}, a fixed joint, and none to {left}: inverse kinematics answers "
            "for the {n} joints that move, in their order, and skips fixed ones",
            fixed=fixed[0].name,
            left=joined(", ", [body.joints[link].name for link in left[:3]]),
            n=len(movable),
        )
        advice = Message(
            "send the answers to the joints for which p.getJointInfo(body, joint)[3] > -1"
        )
        sent = dict(zip(sorted(commanded), movable, strict=True))
        cure = Cure("right-link", body.label, form="joints", given={"links": sent})
        subject = InputSubject(use.first, body, body.joints[left[0]].name)
        yield subject, Said(message=message, advice=advice, cure=cure, share=float(len(left)))


@input_rule("taken-elsewhere", "asked", "reset-frame")
def reset_frame(inputs: Inputs) -> Iterator[tuple[InputSubject, Said]]:
    """A reset places the centre of mass, where a load places the frame of the file."""
    for use in inputs.of(Act.SET_POSE):
        body = use.body
        load = None if body is None else inputs.scene.asked.load(body)
        if body is None or load is None or load.act is not Act.LOAD:
            continue
        first = inputs.first_dynamics(body)
        if first is None:
            continue
        frame_m = np.nan_to_num(first.reported["inertial_position_m"][0])
        apart_m = float(np.linalg.norm(frame_m))
        place = given(load, "basePosition") or (0.0, 0.0, 0.0)
        same = np.array_equal(given(use.first, "posObj"), place)
        if not same or apart_m < FRAME_APART_M:
            continue
        message = Message(
            "{body} is reset to the place that it was loaded at, but a reset places its centre of "
            "mass, which is {apart:.3g} m from the origin of its file ({z:+.3g} m in z)",
            body=body.label,
            apart=apart_m,
            z=float(frame_m[2]),
        )
        advice = Message(
            "p.multiplyTransforms(position, orientation, *p.getDynamicsInfo(body, -1)[3:5]) is "
            "where its centre of mass belongs"
        )
        cure = Cure("lifted", body.label, float(frame_m[2]), form="frame")
        effect = Effect(apart_m, "m")
        yield (
            InputSubject(use.first, body),
            Said(message=message, advice=advice, cure=cure, effect=effect, share=1.0),
        )
