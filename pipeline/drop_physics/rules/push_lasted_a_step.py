"""Forces and torques from calls act in one step."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drop_physics.explain.steps import Steps
from drop_physics.messages import Message
from drop_physics.rules.answer import Answer, Cure, Effect, Finding, Noted, Scene
from drop_physics.rules.arguments import given, number, site_of
from drop_physics.trace.acts import PUSHES, Act
from drop_physics.trace.calls import Call
from drop_physics.trace.events import Body
from drop_physics.trace.motors import TORQUE

Float64 = NDArray[np.float64]
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
    noted: Noted
    """Steps in which there was one."""
    apart: int = 0
    """Steps between two of them; 0 before there are two, -1 if that is not always the same."""
    given_m_s: Float64 | None = None
    """The change of velocity that the first one made, shape (3,)."""
    before_m_s: Float64 | None = None
    after_m_s: Float64 | None = None
    """Velocity before it, and SOON after it."""

    def add(self, step: int) -> None:
        """Take a further one."""
        if step > self.noted.last:
            apart = step - self.noted.last
            self.apart = apart if self.apart in (0, apart) else -1
            self.noted.last, self.noted.count = step, self.noted.count + 1

    def follow(self, steps: Steps) -> None:
        """Note what the first one changed of a base's velocity."""
        row, later = (np.flatnonzero(steps.steps == self.noted.first + n) for n in (0, SOON))
        if len(row) and "applied" in steps.terms:
            self.given_m_s = steps.terms["applied"][row[0], 3:6] / steps.law.tree.masses_kg.sum()
            self.before_m_s = steps.before.velocity[row[0], 3:6].copy()
        if len(later):
            self.after_m_s = steps.after.velocity[later[0], 3:6].copy()

    def gone(self, fastest_m_s: float) -> bool:
        """Return whether nothing of what it changed is to be seen soon after."""
        if self.given_m_s is None or self.before_m_s is None:
            return False
        speed = float(np.linalg.norm(self.given_m_s))
        if speed < NEGLIGIBLE * fastest_m_s or self.after_m_s is None:
            return speed < NEGLIGIBLE * fastest_m_s
        stays = (self.after_m_s - self.before_m_s) @ self.given_m_s
        return bool(speed > 0 and stays < NEGLIGIBLE * speed**2)


class PushLastedAStep(Answer):
    """A force or torque from a call acts in the next step, and then is gone."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._pushes: dict[tuple[int, Act, tuple[float, ...]], _Pushes] = {}
        """By body, act, and link or joints."""
        self._fastest_m_s: dict[int, float] = {}

    def see(self) -> None:
        """Follow the pushes of each body, and what the first one changed."""
        acts = [*PUSHES]
        if any(
            (each.values["controlMode"] == TORQUE).any()
            for each in self.scene.piece.calls.commands()
        ):
            acts.append(Act.COMMAND)
        for call, body in self.scene.calls_of(*acts):
            torque = number(call, "controlMode") == TORQUE
            if torque or call.act in PUSHES:
                where = given(call, "linkIndex") or given(call, "jointIndices")
                where = tuple(where or given(call, "jointIndex"))
                key, step = (body.number, call.act, where), call.at.step + 1
                if key in self._pushes:
                    self._pushes[key].add(step)
                elif np.isfinite(size := _size(call)) and size > 0:
                    self._pushes[key] = _Pushes(body, call, size, Noted(step, step, 1))
        for judged, steps in self.scene.stretches():
            number_ = judged.body.number
            if not steps.law.tree.fixed and len(steps):
                speed_m_s = np.linalg.norm(steps.after.velocity[:, 3:6], axis=1).max()
                fastest = max(self._fastest_m_s.get(number_, 0.0), float(speed_m_s))
                self._fastest_m_s[number_] = fastest
                for (pushed, act, _), push in self._pushes.items():
                    if pushed == number_ and act is Act.PUSH:
                        push.follow(steps)

    def findings(self) -> Iterator[Finding]:
        """Yield those that were to last."""
        for each in self._pushes.values():
            if each.apart > 1 and each.noted.count > 2:
                message = Message(
                    "{body} is pushed by p.{function} every {n} steps, which acts in 1 of {n}: a "
                    "force lasts one step",
                    body=each.body.label,
                    function=each.call.function,
                    n=each.apart,
                )
                asked, lost = each.apart <= SOON, 1 - 1 / each.apart
            elif each.noted.count == 1:
                message = Message(
                    "{body} is pushed with {size:.3g} {unit} in one step, step {step:,}: a force "
                    "lasts one step",
                    body=each.body.label,
                    size=each.size,
                    unit=_unit(each),
                    step=each.noted.first,
                )
                asked, lost = each.gone(self._fastest_m_s.get(each.body.number, 0.0)), 0.0
            else:
                continue
            yield Finding(
                code="push-lasted-a-step",
                level="asked" if asked else "note",
                message=message,
                advice=Message(
                    "call p.{function} before each p.stepSimulation() in which it is to act",
                    function=each.call.function,
                ),
                cure=Cure("push-repeated"),
                body=each.body.label,
                effect=Effect(lost, "1") if lost else None,
                share=lost,
                site=site_of(each.call),
                steps=each.noted.span,
            )


def _size(call: Call) -> float:
    """Return the size of what a call gives [N] or [N m]; of several joints, the largest."""
    for name in ("forceObj", "torqueObj"):
        if vector := given(call, name):
            return float(np.linalg.norm(vector))
    return float(np.abs([*given(call, "force"), *given(call, "forces")]).max(initial=0.0))


def _unit(push: _Pushes) -> str:
    joints = given(push.call, "jointIndex") or given(push.call, "jointIndices")
    kinds = {push.body.joints[int(joint)].kind for joint in joints}
    force = push.call.act is Act.PUSH or kinds == {"prismatic"}
    return "N" if force else "N m"
