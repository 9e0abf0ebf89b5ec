"""Forces and torques from calls: how long they last, and where they act."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drop_physics.analysis.answers.answer import Answer, Effect, Finding, Scene, Span, site_of
from drop_physics.analysis.answers.arguments import calls_of, given, number
from drop_physics.analysis.explained.recording import Explained
from drop_physics.analysis.explained.steps import Steps
from drop_physics.laws.kinematics import kinematics
from drop_physics.laws.tree import BASE
from drop_physics.messages import Message
from drop_physics.seen.calls import WORLD_FRAME, Call
from drop_physics.seen.events import Body

Float64 = NDArray[np.float64]

TORQUE_CONTROL = 1
SOON = 10
"""Steps: what is gone by then was no kick that stays; given again by then, it was to last."""
NEGLIGIBLE = 0.01
"""Of a body's greatest speed."""


@dataclass
class _Pushes:
    """Calls of one function for one body."""

    body: Body
    call: Call
    """The first."""
    size: float
    """Of its force or torque [N] or [N m]."""
    first: int
    last: int
    count: int = 1
    """Steps in which there was one."""
    apart: int = 0
    """Steps between two of them; 0 before there are two, -1 if that is not always the same."""
    given_m_s: Float64 | None = None
    """The change of velocity that a single one made, shape (3,)."""
    before_m_s: Float64 | None = None
    after_m_s: Float64 | None = None
    """Velocity before it, and SOON after it."""

    def add(self, step: int) -> None:
        if step == self.last:
            return
        apart = step - self.last
        self.apart = apart if self.apart in (0, apart) else -1
        self.last, self.count = step, self.count + 1


class PushLastedAStep(Answer):
    """A force or torque from a call acts in the next step, and then is gone."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._pushes: dict[tuple[int, str, tuple[float, ...]], _Pushes] = {}
        """By body, function, and link or joints."""
        self._fastest_m_s: dict[int, float] = {}

    def see(self, explained: Explained) -> None:
        """Follow the pushes of each body, and what the first one changed."""
        names = "applyExternal", "setJointMotorControl"
        for call, body in calls_of(explained.piece, self.scene.seen.appearances, *names):
            torque = number(call, "controlMode") == TORQUE_CONTROL
            if torque or call.function.startswith("applyExternal"):
                where = given(call, "linkIndex") or given(call, "jointIndices")
                where = tuple(where or given(call, "jointIndex"))
                key = body.number, "torque" if torque else call.function, where
                if key in self._pushes:
                    self._pushes[key].add(call.at.step)
                elif np.isfinite(size := _size(call)) and size > 0:
                    step = call.at.step
                    self._pushes[key] = _Pushes(body, call, size, step, step)
        for number_, judged in explained.bodies.items():
            for steps in judged.stretches:
                if not steps.law.tree.fixed and len(steps):
                    speed_m_s = np.linalg.norm(steps.after.velocity[:, 3:6], axis=1).max()
                    fastest = max(self._fastest_m_s.get(number_, 0.0), float(speed_m_s))
                    self._fastest_m_s[number_] = fastest
                    for (pushed, function, _), push in self._pushes.items():
                        its = pushed == number_ and function == "applyExternalForce"
                        if its and push.count == 1:
                            _follow(push, steps)

    def findings(self) -> Iterator[Finding]:
        """Yield those that were to last."""
        for each in self._pushes.values():
            if each.apart > 1 and each.count > 2:
                yield _repeated(each)
            elif each.count == 1:
                yield self._single(each)

    def _single(self, push: _Pushes) -> Finding:
        gone = False
        if push.given_m_s is not None:
            speed = float(np.linalg.norm(push.given_m_s))
            gone = speed < NEGLIGIBLE * self._fastest_m_s.get(push.body.number, 0.0)
            if push.before_m_s is not None and push.after_m_s is not None and speed > 0:
                stays = (push.after_m_s - push.before_m_s) @ push.given_m_s / speed
                gone |= bool(stays < NEGLIGIBLE * speed)
        message = Message(
            "{body} is pushed with {size:.3g} {unit} in one step, step {step:,}: a force lasts one "
            "step",
            body=push.body.label, size=push.size, unit=_unit(push), step=push.first + 1,
        )  # fmt: skip
        return Finding(
            code="push-lasted-a-step", level="asked" if gone else "note", message=message,
            advice=_advice(push.call), body=push.body.label, site=site_of(push.call),
            steps=Span(push.first + 1, push.first + 1, 1),
        )  # fmt: skip


def _size(call: Call) -> float:
    """Return the size of what a call gives [N] or [N m]; of several joints, the largest."""
    for name in ("forceObj", "torqueObj"):
        if vector := given(call, name):
            return float(np.linalg.norm(vector))
    return float(np.abs([*given(call, "force"), *given(call, "forces")]).max(initial=0.0))


def _unit(push: _Pushes) -> str:
    joints = given(push.call, "jointIndex") or given(push.call, "jointIndices")
    kinds = {push.body.joints[int(joint)].kind for joint in joints}
    force = push.call.function == "applyExternalForce" or kinds == {"prismatic"}
    return "N" if force else "N m"


def _follow(push: _Pushes, steps: Steps) -> None:
    """Note what a push changed of a base's velocity."""
    row, later = (np.flatnonzero(steps.steps == push.first + n) for n in (1, 1 + SOON))
    if len(row) and "applied" in steps.terms:
        mass_kg = steps.law.tree.masses_kg.sum()
        push.given_m_s = steps.terms["applied"][row[0], 3:6] / mass_kg
        push.before_m_s = steps.before.velocity[row[0], 3:6].copy()
    if len(later):
        push.after_m_s = steps.after.velocity[later[0], 3:6].copy()


def _repeated(push: _Pushes) -> Finding:
    message = Message(
        "{body} is pushed by p.{function} every {n} steps, which acts in 1 of {n}: a force lasts "
        "one step",
        body=push.body.label, function=push.call.function, n=push.apart,
    )  # fmt: skip
    lost = 1 - 1 / push.apart
    return Finding(
        code="push-lasted-a-step", level="asked" if push.apart <= SOON else "note",
        message=message, advice=_advice(push.call), body=push.body.label,
        effect=Effect(lost, "1"), share=lost, site=site_of(push.call),
        steps=Span(push.first + 1, push.last + 1, push.count),
    )  # fmt: skip


def _advice(call: Call) -> Message:
    return Message(
        "call p.{function} before each p.stepSimulation() in which it is to act",
        function=call.function,
    )


@dataclass
class _Off:
    """Forces that act beside a body."""

    body: Body
    call: Call
    point_m: tuple[float, ...]
    arm_m: float
    size_m: float
    first: int
    last: int
    count: int = 1


class ForceOffCentre(Answer):
    """A point of the body, given as one of the world."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._off: dict[int, _Off] = {}
        self._late: dict[int, list[Call]] = {}
        """Those whose step is in the next piece."""

    def see(self, explained: Explained) -> None:
        """Compare where forces of the world's frame act with where their bodies are."""
        pushes, self._late = self._late, {}
        for call, body in calls_of(
            explained.piece, self.scene.seen.appearances, "applyExternalForce"
        ):
            world = int(number(call, "flags", 0.0)) == WORLD_FRAME
            if world and len(given(call, "posObj")) == len(given(call, "forceObj")) == 3:
                late = call.at.step + 1 >= explained.piece.end
                (self._late if late else pushes).setdefault(body.number, []).append(call)
        for body_number, calls in pushes.items():
            judged = explained.bodies.get(body_number)
            for steps in judged.stretches if judged is not None else ():
                self._compare(judged.body, steps, calls)  # type: ignore[union-attr]

    def _compare(self, body: Body, steps: Steps, calls: list[Call]) -> None:
        rows = np.searchsorted(steps.steps, [each.at.step + 1 for each in calls])
        kept = [(int(row), call) for row, call in zip(rows, calls, strict=True)
            if row < len(steps) and steps.steps[row] == call.at.step + 1]  # fmt: skip
        if not kept:
            return
        tree = steps.law.tree
        if tree.fixed or not (tree.inertias_kg_m2 > 0).all():
            return  # it may not be free to turn
        kin = kinematics(tree, steps.before.at(np.array([row for row, _ in kept])))
        for k, (_, call) in enumerate(kept):
            link = int(number(call, "linkIndex", float(BASE)))
            if not BASE <= link < len(body.joints):
                continue
            point, force = np.array(given(call, "posObj")), np.array(given(call, "forceObj"))
            size_m = _size_m(body, link)
            arm = point - kin.position_m(link)[k]
            strength = np.linalg.norm(force)
            arm_m = float(np.linalg.norm(np.cross(arm, force)) / strength) if strength else 0.0
            # Beside the body, and within it if it were in its own frame.
            if arm_m > size_m >= np.linalg.norm(point):
                known = self._off.get(body.number)
                if known is None:
                    self._off[body.number] = _Off(body, call, given(call, "posObj"), arm_m, size_m,
                        call.at.step + 1, call.at.step + 1)  # fmt: skip
                elif call.at.step + 1 > known.last:
                    known.last, known.count = call.at.step + 1, known.count + 1

    def findings(self) -> Iterator[Finding]:
        """Yield the first such force of each body."""
        for each in self._off.values():
            message = Message(
                "{body} is pushed beside itself: the point ({point}) is in the world's frame, "
                "{arm:.3g} m off its centre, so the force spins it",
                body=each.body.label, point=", ".join(f"{x:g}" for x in each.point_m),
                arm=each.arm_m,
            )  # fmt: skip
            yield Finding(
                code="force-off-centre", level="asked", message=message, body=each.body.label,
                advice=Message("give it in p.LINK_FRAME, or at the body's position"),
                effect=Effect(each.arm_m, "m"), share=each.arm_m / each.size_m,
                steps=Span(each.first, each.last, each.count), site=site_of(each.call),
            )  # fmt: skip


def _size_m(body: Body, link: int) -> float:
    """Return the radius of a ball around a link, as it was added; 0 if it has no extent."""
    box = np.array(body.bounds_m[6 * (link + 1) : 6 * (link + 2)])
    return float(np.linalg.norm(box[3:] - box[:3])) / 2 if len(box) == 6 else 0.0
