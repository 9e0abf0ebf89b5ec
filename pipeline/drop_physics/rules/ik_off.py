"""Why a hand is not where it was wanted, though its joints are on their targets."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from drop_physics.explain.joints import Driven, target_of
from drop_physics.messages import Message
from drop_physics.physics.kinematics import kinematics
from drop_physics.physics.tree import States, Tree
from drop_physics.rules.answer import Answer, Cure, Effect, Finding, Scene, Span
from drop_physics.rules.arguments import given, number, site_of
from drop_physics.rules.joint import distance
from drop_physics.trace.acts import Act
from drop_physics.trace.calls import Call
from drop_physics.trace.events import Body
from drop_physics.trace.motors import POSITION

Float64 = NDArray[np.float64]

OFF_M = 5e-3
"""What is less off is good enough for most hands."""
JOINTS = 0.2
"""Joints add less than this share of it."""
AGAIN = 50
"""Answers for one point, each from where the last one led: no more iterations help."""

ENOUGH = 1000
"""Iterations than which more hardly help."""


@dataclass(frozen=True)
class _Sent:
    """An answer that the motors were given."""

    call: Call
    link: int
    point_m: tuple[float, ...]
    times: int
    """How many answers for this point they had got, one after the other."""


@dataclass(frozen=True)
class _Off:
    sent: _Sent
    joint: str
    off_m: float
    step: int
    reach_m: float
    """How far from the first joint of its arm the hand gets, at most."""
    away_m: float
    """How far from there the point is."""


class IkOff(Answer):
    """`calculateInverseKinematics` ends after 20 iterations, wherever it has got to."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._asked: dict[int, Call] = {}
        """By body, the latest question."""
        self._sent: dict[int, list[_Sent]] = {}
        self._off: dict[int, _Off] = {}

    def see(self) -> None:
        """Match targets with answers, and look where those that stood until rest led."""
        for number_, sent in self._sent.items():
            self._sent[number_] = sent[-1:]
        if not self.scene.piece.calls.of(Act.SOLVE_IK) and not self._sent:
            return
        for call, body in self.scene.calls_of(Act.SOLVE_IK, Act.COMMAND):
            if call.act is Act.SOLVE_IK:
                self._asked[body.number] = call
            elif number(call, "controlMode") == POSITION:
                self._send(call, body)
        for number_, sent in self._sent.items():
            for driven in self.scene.joints.latest.get(number_, []):
                ends = [each.call.at.step for each in sent[1:]]
                for each, end in zip(sent, [*ends, int(driven.steps.steps[-1])], strict=True):
                    self._judge(driven, each, end)

    def _send(self, call: Call, body: Body) -> None:
        """Note an answer if a target is one of its numbers, to the bit."""
        asked = self._asked.get(body.number)
        if asked is None or asked.at.step != call.at.step or not asked.result:
            return
        targets = given(call, "targetPositions") or given(call, "targetPosition")
        point, link = given(asked, "targetPosition"), int(number(asked, "endEffectorLinkIndex"))
        if asked.result not in targets or len(point) != 3 or not 0 <= link < len(body.joints):
            return
        del self._asked[body.number]
        sent = self._sent.setdefault(body.number, [])
        same = bool(sent) and (sent[-1].link, sent[-1].point_m) == (link, point)
        sent.append(_Sent(asked, link, point, sent[-1].times + 1 if same else 1))

    def _judge(self, driven: Driven, sent: _Sent, end: int) -> None:
        """Compare where the targets and the joints have the hand with the point asked for."""
        steps, tree = driven.steps, driven.steps.law.tree
        row = int(np.searchsorted(steps.steps, end, side="right")) - 1
        if row < 0 or steps.steps[row] <= sent.call.at.step or sent.link >= tree.links:
            return
        places = driven.body.rates
        rates = [
            places[link].start
            for link in tree.branch(sent.link)
            if places[link].stop > places[link].start
        ]
        target = target_of(driven)[row]
        told = driven.asked.began[row, rates]
        rests = sent.times >= AGAIN or driven.resting[row, rates].all()
        if not rates or not rests or np.isnan(target[rates]).any():
            return
        if (told > sent.call.at.step).any():
            return
        reached = steps.after.at(slice(row, row + 1))
        wanted = reached.joints.copy()
        for rate in rates:
            link = next(link for link, at in enumerate(places) if at.start == rate < at.stop)
            if tree.coordinates[link].stop > tree.coordinates[link].start:
                wanted[0, tree.coordinates[link]] = target[rate]
        local = -tree.centres_m[sent.link]
        there, answer = (
            kinematics(tree, states).point_m(sent.link, local)[0]
            for states in (reached, replace(reached, joints=wanted))
        )
        off_m = float(np.linalg.norm(there - sent.point_m))
        by_joints_m = float(np.linalg.norm(there - answer))
        known = self._off.get(driven.body.number)
        if known is not None and known.sent.point_m == sent.point_m:
            del self._off[driven.body.number]  # it was asked for again
            known = None
        if (
            off_m > OFF_M
            and by_joints_m < JOINTS * off_m
            and (known is None or off_m > known.off_m)
        ):
            name = driven.body.joints[sent.link].name
            first_m, reach_m = _reach(tree, reached, sent.link, steps.law.lower, steps.law.upper)
            away_m = float(np.linalg.norm(first_m - sent.point_m))
            step = int(steps.steps[row])
            self._off[driven.body.number] = _Off(sent, name, off_m, step, reach_m, away_m)

    def findings(self) -> Iterator[Finding]:
        """Yield the worst of each robot."""
        for number_, worst in self._off.items():
            body, sent = self.scene.body(number_), worst.sent
            point = ", ".join(f"{x:.4g}" for x in sent.point_m)
            values: dict[str, object] = {
                "joint": worst.joint,
                "off": distance(worst.off_m, "m"),
                "point": point,
                "times": sent.times,
                "away": worst.away_m,
                "reach": worst.reach_m,
            }
            solves = False
            if worst.away_m > worst.reach_m:
                message = Message(
                    "{joint}: the hand rests {off} from the point ({point}) with its joints on "
                    "their targets: that is out of reach, {away:.3g} m from the first joint of an "
                    "arm that is {reach:.3g} m long"
                )
                advice = Message("ask for a point within reach")
            elif sent.times < AGAIN:
                message = Message(
                    "{joint}: the hand rests {off} from the point ({point}) with its joints on "
                    "their targets: p.calculateInverseKinematics gave an answer that is so far off"
                )
                advice = Message(
                    "p.calculateInverseKinematics(…, maxNumIterations=1000, "
                    "residualThreshold=1e-6), or ask again from where the arm has got to"
                )
                solves = number(sent.call, "maxNumIterations", 0.0) < ENOUGH
                if not solves:
                    advice = Message("ask again from where the arm has got to")
            else:
                message = Message(
                    "{joint}: the hand is {off} from the point ({point}) with its joints on "
                    "their targets, after {times} answers of p.calculateInverseKinematics: it "
                    "finds no way there"
                )
                advice = Message("ask for a point within reach")
            cure = Cure("ik", value=1000.0) if solves else None
            size_m = np.ptp(np.reshape(body.bounds_m, (-1, 3)), axis=0).max(initial=0.0)
            yield Finding(
                code="ik-off",
                level="asked",
                message=Message(message, **values),
                advice=advice,
                cure=cure,
                body=body.label,
                joint=worst.joint,
                effect=Effect(worst.off_m, "m"),
                share=worst.off_m / max(float(size_m), worst.off_m),
                steps=Span(sent.call.at.step + 1, worst.step, worst.step - sent.call.at.step),
                site=site_of(sent.call),
            )


def _reach(
    tree: Tree, state: States, hand: int, lower: Float64, upper: Float64
) -> tuple[Float64, float]:
    """Return where the first joint of a hand's arm is, and how far from there the hand gets.

    That is the sum of the distances from joint to joint, which only sliding joints change: those
    get no farther than their limits.
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
