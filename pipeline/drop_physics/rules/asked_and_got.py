"""Rules about calls without the intended effect: `not-taken`, `taken-elsewhere`, `overwritten`."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from drop_physics.arrays import Flags, Float64
from drop_physics.messages import Message, joined
from drop_physics.physics.tree import BASE
from drop_physics.physics.vectors import lengths
from drop_physics.rules.answer import Span, so_many
from drop_physics.rules.arguments import given, site_of
from drop_physics.rules.body_properties import AskedOfBodies
from drop_physics.rules.ik_answers import IK_LISTS
from drop_physics.rules.inputs import Inputs, Use
from drop_physics.rules.rows import Case, Remedy, SayingRow
from drop_physics.rules.rule import Match, input_rule, joint_rule
from drop_physics.rules.tables import JointColumns
from drop_physics.rules.thresholds import (
    AT_TARGET_RAD,
    COASTS_RAD_S,
    COASTS_STEPS,
    DEEP_M,
    FALLS_STEPS,
    FRAME_APART_M,
    HALF_THE_STEPS,
    LEFT_M,
    OVERLAPS_STEPS,
    SAME_GAP,
    SCALE,
)
from drop_physics.trace.acts import Act
from drop_physics.trace.events import Body
from drop_physics.trace.history import Seen
from drop_physics.trace.motors import POSITION, VELOCITY
from drop_physics.trace.requests import Request


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


# -- taken-elsewhere ------------------------------------------------------------------------------


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


# -- overwritten ----------------------------------------------------------------------------------


@input_rule("overwritten", "asked", "command-overwritten")
def command_overwritten(inputs: Inputs, seen: Seen) -> Iterator[Case]:
    """A joint has one motor: if it gets a position and a velocity command in a step, one counts."""
    for (number, joint, _), (first, last, steps) in inputs.overridden.items():
        body, made = seen.bodies[number], inputs.motions[number].samples
        if len(steps) >= COASTS_STEPS and joint < len(body.joints):
            yield Case(
                subject=body,
                site=site_of(last),
                span=Span(min(steps) + 1, max(steps) + 1, len(steps)),
                values={
                    "joint": body.joints[joint].name,
                    "alone": first is last,
                    "first": site_of(first),
                    "last": site_of(last),
                    "steps": so_many(len(steps)),
                    "part": len(steps) / max(made, 1),
                },
            )


command_overwritten.rows(
    SayingRow(
        when=lambda alone: alone,
        says=Message(
            "{joint} is commanded more than once before a step, by {last} with different "
            "targets, in {steps}: it has one motor, and only the last command counts"
        ),
        advice=Message("give each joint one target before a step"),
    ),
    SayingRow(
        says=Message(
            "{joint} is commanded twice before a step, by {first} and then by {last}, in "
            "{steps}: it has one motor, and only the last command counts"
        ),
        advice=Message(
            "give one command: p.POSITION_CONTROL takes targetVelocity=… and maxVelocity=…, too"
        ),
    ),
    like=SayingRow(share="part"),
)


@input_rule("overwritten", "asked", "pose-set-each-step")
def pose_set_each_step(inputs: Inputs, seen: Seen) -> Iterator[Case]:
    """A pose set in every step exerts no force: the body passes through obstacles."""
    carried = [
        use
        for use in inputs.of(Act.SET_VELOCITY)
        if any(np.any(each) for each in (*use.low.values(), *use.high.values()))
    ]
    for use in inputs.of(Act.SET_JOINT, Act.SET_POSE):
        call, body = use.first, use.body
        made = seen.samples.get(call.client, 1) - 1 - call.at.step
        if body is None or len(use.steps) < HALF_THE_STEPS * max(made, 1):
            continue
        # What stays in its place goes through nothing, nor what has the velocity of its way.
        stays = use.constant("posObj") and use.constant("ornObj")
        if stays or any(
            each.body and each.body.number == body.number and each.steps & use.steps
            for each in carried
        ):
            continue
        number = int(call.values.get("jointIndex", (BASE,))[0])
        deep = {
            step: depth_m
            for step, (depth_m, link) in inputs.deepest[body.number].items()
            if step - 1 in use.steps and number in (BASE, *_branch(body, link))
        }
        if len(deep) < OVERLAPS_STEPS:
            continue
        most = max(deep.values())
        by_joint = call.act is Act.SET_JOINT
        joint = body.joints[number].name if by_joint and number >= 0 else None
        yield Case(
            call=call,
            subject=body,
            span=Span(min(deep), max(deep), len(deep)),
            values={
                "joint": joint,
                "by_joint": by_joint,
                "what": joint or body.label,
                "function": call.function,
                "count": len(use.steps),
                "deep": most * 1e3,
                "most": most,
            },
        )


POSED = SayingRow(cure=Remedy("support-velocity", bodies=("body",)), proposed=True)
pose_set_each_step.rows(
    SayingRow(when=lambda by_joint: by_joint, cure=Remedy("without", "what", form="driven")),
    # What it presses onto something else stays in the way of any velocity, too.
    SayingRow(
        when=lambda subject: subject.base_moves,
        advice=Message("move it by a force, a velocity, or a constraint"),
    ).like(POSED),
    # A body without mass moves only where calls put it, and pushes others by its overlap.
    SayingRow(
        advice=Message("{call}, or give it a mass and move it by a constraint"), level="note"
    ).like(POSED),
    like=SayingRow(
        says=Message(
            "{what} is set by p.{function} in {count:,} steps, and gets {deep:.3g} mm into "
            "what it meets: a pose that is set has no force"
        ),
        effect="most",
        normal=DEEP_M,
    ),
)


def _branch(body: Body, link: int) -> tuple[int, ...]:
    """Return the links from a given link down to the base."""
    return () if link < 0 else (link, *_branch(body, body.joints[link].parent))


@input_rule("overwritten", "asked", "drive-lags")
def drive_lags(inputs: Inputs) -> Iterator[Case]:
    """A constraint closes only a share of its gap in a step, so a moving target stays ahead."""
    for drive in inputs.drives.values():
        if len(drive.targets_m) < FALLS_STEPS * 2:
            continue
        places_m = np.array(drive.places_m)
        ahead_m = np.array(drive.targets_m) - places_m
        mean_m = ahead_m.mean(axis=0)
        gap_m = float(np.linalg.norm(mean_m))
        made_m = float(lengths(np.diff(places_m, axis=0))[1:].mean())
        steady = np.abs(ahead_m - mean_m).max() <= SAME_GAP * gap_m
        if steady and 0 < made_m < (1 - SAME_GAP) * gap_m:
            share = made_m / gap_m
            yield Case(
                call=drive.call,
                subject=drive.body,
                values={
                    "made": made_m * 1e3,
                    "gap": gap_m * 1e3,
                    "share": share,
                    "part": 1 - share,
                },
            )


drive_lags.rows(
    SayingRow(
        says=Message(
            "{body} goes {made:.2g} mm a step where p.changeConstraint asks for {gap:.2g} mm: the "
            "target is set from where {body} is, and a step makes {share:.2g} of the way there"
        ),
        advice=Message("set each target from the last target, not from the body"),
        share="part",
    )
)
