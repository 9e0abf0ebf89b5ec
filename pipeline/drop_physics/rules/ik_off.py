"""The rule `ik-off`: an end effector misses its point although all joints reached their targets."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np

from drop_physics.arrays import Float64
from drop_physics.explain.joints import JointTelemetry, target_of
from drop_physics.messages import Message
from drop_physics.physics.kinematics import kinematics
from drop_physics.physics.tree import States, Tree
from drop_physics.rules.arguments import given, number, site_of
from drop_physics.rules.ik_answers import IK_LISTS, SentAnswer
from drop_physics.rules.inputs import Inputs
from drop_physics.rules.joint import aimed
from drop_physics.rules.rows import Noted, Remedy, SayingRow
from drop_physics.rules.rule import Match, body_rule
from drop_physics.rules.tables import BodyColumns
from drop_physics.rules.thresholds import HAND_M, IK_AGAIN, IK_ENOUGH, IK_JOINTS
from drop_physics.trace.events import Body


@body_rule("ik-off", "asked", subject=1)
def ik_off(bodies: BodyColumns, inputs: Inputs) -> Match | None:
    """`calculateInverseKinematics` stops after 20 iterations, converged or not."""
    keys, found = [], []
    for driven in bodies.driven:
        joints = driven.body.joints
        # An answer has no number for a fixed joint: what is sent to one is another's.
        shifted = any(not joints[each].widths[1] for each in inputs.commanded[driven.body.number])
        sent = [] if shifted else inputs.ik.latest.get(driven.body.number, [])
        ends = [*(each.call.at.step for each in sent[1:]), int(driven.steps.steps[-1])]
        for each, end in zip(sent, ends, strict=False):
            if (off := _off(driven, each, end)) is not None:
                keys.append((driven.body.number, each.place))
                found.append(off)
    if not found:
        return None
    numbers = {name: np.array([each[name] for each in found]) for name in found[0]}
    # What was asked for again, and then answered better, is no miss: of a point the last counts.
    return Match(numbers.pop("row"), numbers["at"], numbers, keys=np.array(keys))


def _off(driven: JointTelemetry, sent: SentAnswer, end: int) -> dict[str, object] | None:
    """Return distances of end effector and solution from the requested point; None if unclear."""
    steps, tree = driven.steps, driven.steps.law.tree
    row = int(np.searchsorted(steps.steps, end, side="right")) - 1
    if row < 0 or steps.steps[row] <= sent.call.at.step or not 0 <= sent.link < tree.links:
        return None
    at = [tree.rates[link] for link in tree.branch(sent.link)]
    rates = [each.start - tree.first_rate for each in at if each.stop > each.start]
    target, widths = target_of(driven)[row], [joint.widths[1] for joint in driven.body.joints]
    rests = sent.times >= IK_AGAIN or driven.resting[row, rates].all()
    later = (driven.asked.began[row, rates] > sent.call.at.step).any()
    if not rates or not rests or later or np.isnan(target[rates]).any():
        return None
    reached = steps.after.at(slice(row, row + 1))
    wanted = aimed(driven, row)[None]
    local = -tree.centres_m[sent.link]
    there, answer = (
        kinematics(tree, states).point_m(sent.link, local)[0]
        for states in (reached, replace(reached, joints=wanted))
    )
    first_m, reach_m = _reach(tree, reached, sent.link, steps.law.lower, steps.law.upper)
    return {
        "row": steps.rows.start + row,
        "at": float(steps.steps[row]),
        "off": float(np.linalg.norm(there - sent.point_m)),
        "by_joints": float(np.linalg.norm(there - answer)),
        "hand": driven.body.joints[sent.link].name,
        "point": ", ".join(f"{x:.4g}" for x in sent.point_m),
        "times": sent.times,
        "iterations": number(sent.call, "maxNumIterations", 0.0),
        "reach": reach_m,
        "away": float(np.linalg.norm(first_m - sent.point_m)),
        "asked_at": site_of(sent.call),
        "lists": ", ".join(
            name for name in IK_LISTS if len(given(sent.call, name)) == sum(map(bool, widths))
        ),
    }


@ik_off.counts
def _(off: Float64, by_joints: Float64) -> Float64:
    return np.where((off > HAND_M) & (by_joints < IK_JOINTS * off), off, 0.0)


@ik_off.notes
def _(subject: Body, hand: str, off: float, lists: str) -> Noted:
    size_m = np.ptp(np.reshape(subject.bounds_m, (-1, 3)), axis=0).max(initial=0.0)
    return {"joint": hand, "part": off / max(float(size_m), off), "proposed": bool(lists)}


OFF_ITS_POINT = Message(
    "{joint}: the hand rests {off:gap} from the point ({point}) with its joints on their "
    "targets: p.calculateInverseKinematics gave an answer that is that far off"
)
ik_off.rows(
    SayingRow(
        when=lambda away, reach: away > reach,
        says=Message(
            "{joint}: the hand rests {off:gap} from the point ({point}) with its joints on their "
            "targets: that is out of reach, {away:.3g} m from the first joint of an arm that is "
            "{reach:.3g} m long"
        ),
        advice=Message("ask for a point within reach"),
    ),
    SayingRow(
        when=lambda lists: lists,
        says=Message(
            "{joint}: the hand is {off:gap} from the point ({point}) with its joints on their "
            "targets: p.calculateInverseKinematics gave an answer that is that far off, with "
            "{lists}"
        ),
        advice=Message("ask without these lists, which draw answers towards a pose"),
    ),
    SayingRow(
        when=lambda times: times >= IK_AGAIN,
        says=Message(
            "{joint}: the hand is {off:gap} from the point ({point}) with its joints on their "
            "targets, after {times} answers of p.calculateInverseKinematics: it finds no way there"
        ),
        advice=Message("ask for a point within reach"),
    ),
    SayingRow(
        when=lambda iterations: iterations < IK_ENOUGH,
        says=OFF_ITS_POINT,
        advice=Message("{call}, or ask again from where the arm has got to"),
        cure=Remedy("ik", value=1000.0),
    ),
    SayingRow(says=OFF_ITS_POINT, advice=Message("ask again from where the arm has got to")),
    like=SayingRow(effect="off", share="part", site="asked_at"),
)


def _reach(
    tree: Tree, state: States, hand: int, lower: Float64, upper: Float64
) -> tuple[Float64, float]:
    """Return the position of an arm's first joint [m], and the largest reach from there [m].

    The reach is the sum of the distances between consecutive joints. Only sliding joints change
    these distances, up to their limits.
    """
    kin, branch = kinematics(tree, state), sorted(tree.branch(hand))
    moving = next(link for link in branch if tree.rates[link].stop > tree.rates[link].start)
    arm = [link for link in branch if link >= moving]
    joints_m = [kin.point_m(link, -tree.centres_m[link])[0] for link in arm]
    reach_m = sum(float(np.linalg.norm(b - a)) for a, b in pairwise(joints_m))
    for link in arm:
        if tree.joints[link] == "prismatic":
            rate = tree.rates[link].start - tree.first_rate
            low, high = float(lower[rate]), float(upper[rate])
            reach_m += abs(low) + abs(high) if low <= high else math.inf
    return joints_m[0], reach_m
