"""Rules about forces that calls apply: how long they act, and where."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator

import numpy as np

from drop_physics.arrays import Float64
from drop_physics.messages import Message
from drop_physics.physics.kinematics import in_world, kinematics, motion
from drop_physics.physics.vectors import cross, distinct_rows, groups, lengths, summed
from drop_physics.rules.answer import Span
from drop_physics.rules.arguments import site_of
from drop_physics.rules.inputs import Inputs, Use
from drop_physics.rules.rows import Case, Noted, Remedy, SayingRow
from drop_physics.rules.rule import Match, body_rule, input_rule
from drop_physics.rules.tables import BodyColumns
from drop_physics.rules.thresholds import NEGLIGIBLE, SAME_POINT_M, SOON_STEPS
from drop_physics.trace.acts import PUSHES, Act
from drop_physics.trace.calls import WORLD_FRAME
from drop_physics.trace.events import Body
from drop_physics.trace.history import Seen
from drop_physics.trace.motors import TORQUE

FORCES = "forceObj", "torqueObj", "force", "forces"
"""Arguments that contain forces and torques."""
PLACES = "linkIndex", "jointIndex", "jointIndices"
"""Arguments that contain the point of application."""


@input_rule("push-lasted-a-step", "note", proposes=True)
def push_lasted_a_step(inputs: Inputs, seen: Seen) -> Iterator[Case]:
    """A force or torque of a call acts in the next step only."""
    alike: defaultdict[tuple[int, Act], list[Use]] = defaultdict(list)
    for use in inputs.of(*PUSHES, Act.COMMAND):
        torque = use.first.act in PUSHES or use.low.get("controlMode", (None,))[0] == TORQUE
        # Pushed in turn, each place is pushed less often than all together.
        varies = any(name in use.low and not use.constant(name) for name in PLACES)
        in_turn = varies and use.count < 2 * len(use.steps)
        if use.body is not None and torque and not in_turn and _size(use) > 0:
            alike[use.body.number, use.first.act].append(use)
    for (number, act), uses in alike.items():
        body, call = seen.bodies[number], uses[0].first
        steps = sorted(set[int]().union(*(use.steps for use in uses)))
        apart = {*np.diff(steps).tolist()}
        every, lost = max(apart, default=0), 0.0
        in_turn = len(steps) > 2 and apart == {every} and every > 1
        if in_turn:
            asked, lost = every <= SOON_STEPS, 1 - 1 / every
        elif len(steps) == 1 and steps[0] + 1 < seen.samples.get(body.client, 0):
            asked = act is Act.PUSH and _came_to_nothing(inputs, number)
        else:
            continue
        places = call.values.get("jointIndex") or call.values.get("jointIndices") or ()
        slides = {body.joints[int(place)].kind for place in places} == {"prismatic"}
        yield Case(
            call=call,
            subject=body,
            span=Span(steps[0] + 1, steps[-1] + 1, len(steps)),
            values={
                "in_turn": in_turn,
                "level": "asked" if asked else None,
                "function": call.function,
                "n": every,
                "size": _size(uses[0]),
                "unit": "N" if slides or act is Act.PUSH else "N m",
                "step": steps[0] + 1,
                "lost": lost,
            },
        )


push_lasted_a_step.rows(
    SayingRow(
        when=lambda in_turn: in_turn,
        says=Message(
            "{body} is pushed by p.{function} every {n} steps, which acts in 1 of {n}: a "
            "force lasts one step"
        ),
        effect="lost",
        unit="1",
    ),
    SayingRow(
        says=Message(
            "{body} is pushed with {size:.3g} {unit} in one step, step {step:,}: a force "
            "lasts one step"
        )
    ),
    like=SayingRow(
        cure=Remedy("push-repeated", given={"function": "function"}),
        share="lost",
    ),
)


def _size(use: Use) -> float:
    """Return the magnitude of the first force applied [N] or [N m]; the largest of several."""
    given = {name: use.first.values[name] for name in FORCES if name in use.first.values}
    sizes = [
        math.hypot(*np.ravel(each)) if name.endswith("Obj") else np.abs(each).max(initial=0.0)
        for name, each in given.items()
    ]
    return float(max(sizes, default=0.0))


def _came_to_nothing(inputs: Inputs, number: int) -> bool:
    """Return whether other forces cancelled a body's first push in the same step."""
    pushed = (life for (one, _), life in inputs.lives.items() if one == number)
    return any(life.opposed > 1 - NEGLIGIBLE for life in pushed)


# -- force-off-centre -----------------------------------------------------------------------------


@body_rule("force-off-centre", "asked", subject=1, proposes=True)
def force_off_centre(bodies: BodyColumns) -> Match | None:
    """A point in world coordinates is given in the body's frame, or the other way round."""
    tree, pushes = bodies.law.tree, bodies.reported.applied
    strength = lengths(pushes.force_n)
    pushes, strength = pushes.at(strength > 0), strength[strength > 0]
    if tree.fixed or not (tree.inertias_kg_m2 > 0).all() or not len(pushes):
        return None  # it may not be free to turn
    kin = kinematics(tree, bodies.before.at(pushes.step))
    moved = motion(kin, bodies.before.velocity[pushes.step]).velocities
    centre, timestep_s = pushes.point_m, bodies.reported.timestep_s[pushes.step]
    itself, reach_m = np.empty_like(centre), np.empty(len(centre))
    boxes = np.reshape(bodies.batch.bodies[0].body.bounds_m, (-1, 2, 3))
    for link, its in groups(pushes.link):
        itself[its] = in_world(kin, link, its, centre[its])
        # A point that was read a step ago may be as much farther as the link moved since.
        way_m = lengths(moved[link + 1].T[its]) * timestep_s[its]
        reach_m[its] = way_m + lengths(np.diff(boxes[link + 1], axis=0))[0] / 2
    # Together: each of a drone's rotors is beside it, and all four lift it at its centre.
    keys = np.column_stack([pushes.step, pushes.link])
    keys, first, each = distinct_rows(keys)
    count, reach_m = len(keys), reach_m[first]

    def arms_m(moments: Float64) -> Float64:
        """Return the lever arm of forces on a link [m]: moment over sum of magnitudes."""
        sums = summed(each, np.column_stack([moments, strength]), count=count)
        return lengths(sums[:, :3]) / sums[:, 3]

    beside = arms_m(pushes.torque_n_m) > reach_m
    within = arms_m(pushes.torque_n_m + cross(centre, pushes.force_n)) <= reach_m
    off = lengths(pushes.torque_n_m - cross(itself, pushes.force_n)) > SAME_POINT_M * strength
    own = np.bincount(each, off) == 0
    chosen = beside & (within | own)
    arm = lengths(pushes.torque_n_m[first]) / strength[first]
    numbers = {"arm": arm, "reach": reach_m, "centre": centre[first]}
    return Match(
        keys[chosen, 0],
        np.ones(int(chosen.sum())),  # of all the first is told
        {name: values[chosen] for name, values in numbers.items()},
        keys=np.column_stack([bodies.body[keys[:, 0]], keys[:, 1], own])[chosen],
    )


@force_off_centre.notes
def _(inputs: Inputs, subject: Body, keys: list[int], centre: list[float]) -> Noted | None:
    own = keys[2]
    pushes = (
        use.first for use in inputs.of(Act.PUSH) if use.body and use.body.number == subject.number
    )
    mistaken = (push for push in pushes if (WORLD_FRAME in push.values.get("flags", ())) != own)
    call = next(mistaken, None)
    if call is None or (own and not np.allclose(call.values["posObj"], centre, atol=SAME_POINT_M)):
        return None
    frame = Message("its own frame") if own else Message("the world's frame")
    meant = "WORLD_FRAME" if own else "LINK_FRAME"
    return {"frame": frame, "meant": meant, "called": site_of(call)}


force_off_centre.rows(
    SayingRow(
        says=Message(
            "{body} is pushed {arm:.3g} m off its centre, beside all of it, and spins: the "
            "point is in {frame}"
        ),
        cure=Remedy("push-at-centre", "body", given={"frame": "meant"}),
        effect="arm",
        normal="reach",
        site="called",
    )
)
