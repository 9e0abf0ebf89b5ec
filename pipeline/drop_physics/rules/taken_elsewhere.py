"""The rule `taken-elsewhere`: calls and writes that act on something else than was meant."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from drop_physics.messages import Message, joined
from drop_physics.rules.arguments import given
from drop_physics.rules.body_properties import AskedOfBodies
from drop_physics.rules.engines import MUJOCOS
from drop_physics.rules.indexed import turn_at
from drop_physics.rules.inputs import Inputs
from drop_physics.rules.rows import Case, Remedy, SayingRow
from drop_physics.rules.rule import input_rule
from drop_physics.rules.thresholds import (
    FRAME_APART_M,
    LEFT_M,
)
from drop_physics.trace.acts import Act
from drop_physics.trace.events import Body
from drop_physics.trace.history import Seen
from drop_physics.trace.requests import Request


@input_rule("taken-elsewhere", "asked", "call-elsewhere")
def call_elsewhere(inputs: Inputs, seen: Seen) -> Iterator[Case]:
    """A `changeDynamics` call for a link acts on the base because a later setter redirects it."""
    lost: dict[int, list[Request]] = {}
    for request in inputs.requests:
        if request.body is not None and request.reached != request.link and not request.taken:
            lost.setdefault(request.body.number, []).append(request)
    for number, found in lost.items():
        body, call, link = seen.bodies[number], found[0].call, found[0].link
        its = [each for each in found if each.call.at.call == call.at.call]
        carriers = [name for name in CARRIERS if name in call.values]
        told: dict[str, object] = {
            "names": joined(", ", [each.name for each in its]),
            "link": body.links[link + 1],
            "carriers": carriers,
            "carrier": joined(", ", carriers),
            "part": float(len(found)),
        }
        for each in its:
            if each.got and each.elsewhere:
                told |= {"name": each.name, "got": each.got[0], "base": each.elsewhere[0]}
                break
        yield Case(call=call, subject=body, values=told | {"both": "base" in told})


call_elsewhere.rows(
    SayingRow(
        when=lambda both: both,
        says=Message(
            "{names} given to {link} of {body} went to its base, as in each call that also "
            "has {carrier}: {name} of the link is {got:.3g}, of the base {base:.3g}"
        ),
    ),
    SayingRow(
        says=Message(
            "{names} given to {link} of {body} went to its base: a call that also has {carrier} "
            "does"
        )
    ),
    like=SayingRow(
        cure=Remedy("right-link", "link", given={"arguments": "carriers"}), share="part"
    ),
)


CARRIERS = (
    *("maxJointVelocity", "collisionMargin", "linearDamping", "angularDamping"),
    "activationState",
)


@input_rule("taken-elsewhere", "asked", "wrong-body")
def wrong_body(inputs: Inputs, asked: AskedOfBodies) -> Iterator[Case]:
    """A body that was created without mass gets a mass, and falls."""
    for request in inputs.requests:
        body = request.body
        if body is None or request.name != "mass" or request.link != -1 or not request.asked[0] > 0:
            continue
        moved_m = inputs.motions[body.number].moved_m
        if _stood(inputs, request, asked) and moved_m >= LEFT_M:
            yield Case(
                call=request.call,
                subject=body,
                values={
                    "mass": request.asked[0],
                    "moved": moved_m,
                    "function": request.call.function,
                },
            )


wrong_body.rows(
    SayingRow(
        says=Message(
            "{body} stood still without mass, is given {mass:.3g} kg, and moves {moved:.3g} m away"
        ),
        advice=Message("{call}: mass 0 keeps a body in place"),
        cure=Remedy("without", "body", form="of-body", given={"function": "function"}),
        effect="moved",
        unit="m",
        share="moved",
    )
)


def _stood(inputs: Inputs, request: Request, asked: AskedOfBodies) -> bool:
    """Return whether a body had no mass until a call gave it one.

    A body that a call made massless is assumed to be released on purpose. So is a body created
    without mass, unless the same script line also sets the mass of bodies that already had one.
    """
    body = request.body
    if request.before is not None:
        return request.before[0] == 0 and not any(
            each.body is body and each.name == "mass" and each.asked[0] == 0
            for each in inputs.requests
        )
    load = None if body is None else asked.load(body)
    if body is None or load is None:
        return False
    if load.act is Act.MAKE:
        return not _made_kg(asked, body) and any(
            each.name == "mass" and each.call.site.place == request.call.site.place
            for each in inputs.requests
            if each.body is not None and _made_kg(asked, each.body)
        )
    fixed = given(load, "useFixedBase") or (0.0,)
    return fixed[0] == 1 or any(link.mass_kg == 0 for link in body.asked.links[:1])


def _made_kg(asked: AskedOfBodies, body: Body) -> float:
    """Return the mass given to a body when it was created; 0 if it was loaded from a file."""
    load = asked.load(body)
    return 0.0 if load is None else (given(load, "baseMass") or (0.0,))[0]


@input_rule("taken-elsewhere", "asked")
def by_index(inputs: Inputs, seen: Seen) -> Iterator[Case]:
    """Targets for movable joints are sent to joint indices that include fixed joints."""
    uses = inputs.of(Act.SOLVE_IK, Act.SOLVE_SEVERAL_IK)
    solved = {use.body.number: use.first for use in uses if use.body is not None}
    for number in sorted(inputs.commanded, key=lambda each: each not in solved):
        body, commanded = seen.bodies[number], inputs.commanded[number]
        movable = [joint.link for joint in body.joints if joint.widths[1]]
        fixed = [joint for joint in body.joints if not joint.widths[1] and joint.link in commanded]
        left = [body.joints[link].name for link in movable if link not in commanded]
        if fixed and left and len(commanded) == len(movable):
            yield Case(
                subject=body,
                call=solved.get(number),
                values={
                    "solved": number in solved,
                    "joint": left[0],
                    "fixed": fixed[0].name,
                    "left": joined(", ", left[:3]),
                    "n": len(movable),
                    "sent": dict(zip(sorted(commanded), movable, strict=True)),
                    "part": float(len(left)),
                },
            )


by_index.rows(
    SayingRow(
        when=lambda solved: solved,
        says=Message(
            "commands go to {fixed}, a fixed joint, and none to {left}: inverse kinematics "
            "answers for the {n} joints that move, in their order, and skips fixed ones"
        ),
        reason="ik-index",
    ),
    SayingRow(
        says=Message(
            "commands go to {fixed}, a fixed joint, and none to {left}: {n} joints move, and these "
            "{n} targets were given to joints by index"
        ),
        advice=Message(
            "the targets to the joints that move, for which p.getJointInfo(body, joint)[3] > -1"
        ),
        reason="joint-index",
    ),
    like=SayingRow(
        cure=Remedy("right-link", "body", form="joints", given={"links": "sent"}), share="part"
    ),
)


@input_rule("taken-elsewhere", "asked", "reset-frame")
def reset_frame(inputs: Inputs, asked: AskedOfBodies) -> Iterator[Case]:
    """A reset of a pose places the body's centre of mass; loading places the frame of its file."""
    for use in inputs.of(Act.SET_POSE):
        body = use.body
        load = None if body is None else asked.load(body)
        first = None if body is None else inputs.first_dynamics(body)
        if body is None or load is None or load.act is not Act.LOAD or first is None:
            continue
        frame_m = np.nan_to_num(first.reported["inertial_position_m"][0])
        apart_m = float(np.linalg.norm(frame_m))
        place = given(load, "basePosition") or (0.0, 0.0, 0.0)
        if np.array_equal(given(use.first, "posObj"), place) and apart_m >= FRAME_APART_M:
            told = {"apart": apart_m, "z": float(frame_m[2])}
            yield Case(call=use.first, subject=body, values=told)


reset_frame.rows(
    SayingRow(
        says=Message(
            "{body} is reset to the place that it was loaded at, but a reset places its centre of "
            "mass, which is {apart:.3g} m from the origin of its file ({z:+.3g} m in z)"
        ),
        cure=Remedy("lifted", "body", "z", form="frame"),
        effect="apart",
        share=1.0,
    )
)


@input_rule("taken-elsewhere", "model", "quaternion-order", engines=MUJOCOS)
def w_first(inputs: Inputs, seen: Seen) -> Iterator[Case]:
    """MuJoCo expects quaternions with w first: with w last, a turn about z becomes half a turn."""
    for (client, place), (call, turn) in inputs.lasting.turned.items():
        body = turn_at(seen, client, place)
        if body is None:
            continue
        angle = 2 * math.atan2(turn[2], turn[3])
        written = ", ".join(f"{each:.3g}" for each in turn)
        told = {"place": place, "end": place + 4, "turn": written, "angle": angle}
        yield Case(call=call, subject=body, values=told)


W_FIRST = SayingRow(
    says=Message(
        "qpos[{place}:{end}] gives {body} the quaternion ({turn}), half a turn: MuJoCo has w "
        "first; with w last it would be {why}"
    ),
    advice=Message("np.roll(quaternion, 1) puts w first"),
    share=1.0,
)


w_first.rows(
    SayingRow(when=lambda angle: angle, why=Message("{angle:.3g} rad about z")),
    # Half a turn about z may be meant.
    SayingRow(why=Message("no turn"), level="note"),
    like=W_FIRST,
)
