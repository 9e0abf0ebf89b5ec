"""Whether a restored state runs as it did before."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from drop_physics.analysis.answers.answer import Answer, Effect, Finding, Scene, Span, site_of
from drop_physics.analysis.answers.arguments import given
from drop_physics.analysis.explained.recording import Explained
from drop_physics.analysis.explained.steps import Steps
from drop_physics.messages import Message
from drop_physics.seen.calls import Call

Float64 = NDArray[np.float64]

BEGINS = "saveState", "restoreState"
SETS = ("changeDynamics", "setGravity", "createConstraint", "changeConstraint",
    "removeConstraint", "setJointMotorControl", "setPhysicsEngineParameter", "setTimeStep",
    "setCollisionFilter")  # fmt: skip
"""Beginnings of functions whose effect restoreState does not take back."""
MOST_STEPS = 64
"""After a restore, that are compared."""


@dataclass
class _Branch:
    """What followed a state that was saved or restored."""

    restore: Call
    states: dict[tuple[int, int], Float64] = field(default_factory=dict)
    """By body and steps after it."""
    calls: dict[int, list[Call]] = field(default_factory=dict)
    """By steps after it."""
    sets: dict[tuple[object, ...], Call] = field(default_factory=dict)
    """What was set until the next restore, by function and what it names."""
    touched: bool = False
    """Whether there were contacts in its first step."""


class RestoreDiffers(Answer):
    """Compares each branch of a saved state with the first that made the same calls."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._now: dict[int, _Branch] = {}
        self._before: dict[tuple[object, ...], _Branch] = {}
        """By saved state, the branch before."""
        self._found: dict[tuple[object, ...], Finding] = {}

    def see(self, explained: Explained) -> None:
        """Follow the branches of each simulation."""
        piece = explained.piece
        for client in {each.client for each in self.scene.seen.bodies.values()}:
            calls = [each for each in piece.calls if each.client == client and not each.raised]
            restores = [each for each in calls if each.function in BEGINS]
            if not restores and client not in self._now:
                continue
            marks = [each.at.call for each in restores]
            which = np.searchsorted(marks, [each.at.call for each in calls], side="right")
            for k, restore in enumerate([None, *restores]):
                if restore is not None:
                    self._close(client)
                    self._now[client] = _Branch(restore)
                branch = self._now.get(client)
                if branch is not None:
                    own = [call for call, n in zip(calls, which, strict=True)
                        if n == k and call is not restore]  # fmt: skip
                    last = restores[k].at.step if k < len(restores) else piece.end
                    _follow(branch, explained, client, own, last)

    def _close(self, client: int) -> None:
        """Compare a branch that has ended with the one before."""
        branch = self._now.pop(client, None)
        if branch is None:
            return
        key = client, *_state(branch.restore)
        before = self._before.get(key)
        if before is not None and key not in self._found:
            finding = self._compared(before, branch)
            if finding is not None:
                self._found[key] = finding
        self._before[key] = branch

    def findings(self) -> Iterator[Finding]:
        """Yield the first branches of each saved state that differ."""
        for client in [*self._now]:
            self._close(client)
        yield from self._found.values()

    def _compared(self, first: _Branch, second: _Branch) -> Finding | None:
        calls = [(first.calls.get(n, []), second.calls.get(n, [])) for n in range(MOST_STEPS)]
        same = next((n for n, (one, other) in enumerate(calls) if _said(one) != _said(other)),
            MOST_STEPS)  # fmt: skip
        common = [key for key in first.states.keys() & second.states.keys() if key[1] <= same]
        apart = {key: float(np.abs(first.states[key] - second.states[key]).max(initial=0.0))
            for key in common if first.states[key].shape == second.states[key].shape}  # fmt: skip
        differ = [key for key, gap in apart.items() if gap > 0]
        if not differ:
            return None
        number, step = min(differ, key=lambda key: key[1])
        cause = _cause(first, second)
        if cause is None:
            return None
        why, call = cause
        last = max(key[1] for key in common)
        worst = max((key for key in common if key[1] == last), key=apart.__getitem__)
        message = Message(
            "{body} runs differently after p.restoreState(…) although the calls are the same: from "
            "step {step:,} on, and by {gap:.2g} after {last:,} steps; {why}",
            body=self.scene.body(number).label, step=second.restore.at.step + step,
            gap=apart[worst], last=last, why=why,
        )  # fmt: skip
        begin = second.restore.at.step
        return Finding(
            code="restore-differs", level="asked", message=message,
            body=self.scene.body(number).label, effect=Effect(apart[worst], "m or rad"),
            share=min(apart[worst], 1.0), site=site_of(call or second.restore),
            steps=Span(begin + step, begin + last, last - step + 1),
        )  # fmt: skip


def _follow(
    branch: _Branch, explained: Explained, client: int, calls: list[Call], last: int
) -> None:
    """Take the states and calls of a branch in a piece, up to sample `last`."""
    start = branch.restore.at.step
    for call in calls:
        if call.at.step - start < MOST_STEPS:
            branch.calls.setdefault(call.at.step - start, []).append(call)
        # A force that no step has used yet waits for the next.
        waits = call.function.startswith("applyExternal") and call.at.step == last
        if waits or call.function.startswith(SETS):
            branch.sets.setdefault(_named(call), call)
    for number, judged in explained.bodies.items():
        if judged.body.client != client:
            continue
        for steps in judged.stretches:
            until = min(last, start + MOST_STEPS)
            rows = np.flatnonzero((steps.steps > start) & (steps.steps <= until))
            for row in rows.tolist():
                branch.states[number, int(steps.steps[row]) - start] = _numbers(steps, row)
            if len(rows) and steps.steps[rows[0]] == start + 1:
                branch.touched |= bool((steps.sides.step == start + 1).any())


def _state(call: Call) -> tuple[object, ...]:
    """Return which saved state a call makes or restores."""
    if call.function == "saveState":
        return (call.result,)
    return given(call, "stateId") or (call.arguments,)


def _numbers(steps: Steps, row: int) -> Float64:
    """Return position and joints after a step."""
    return np.concatenate((steps.after.position_m[row], steps.after.joints[row]))


def _said(calls: list[Call]) -> list[tuple[object, ...]]:
    return [(each.function, each.numbers) for each in calls]


def _named(call: Call) -> tuple[object, ...]:
    """Return what a call sets: its function, and the body and joint that it names."""
    names = zip(call.site.names, call.numbers, strict=True)
    ids = tuple(n for name, n in names if name.endswith(("Id", "Index", "Indices", "Mode")))
    return call.function, ids


def _cause(first: _Branch, second: _Branch) -> tuple[Message, Call | None] | None:
    """Return why a branch differs from the one before, and the call to blame."""
    again = {_named(each) for each in second.calls.get(0, [])}
    left = [call for named, call in first.sets.items() if named not in again]
    if left:
        return Message(
            "p.{function}({arguments}) came in between, and restoreState does not take it back",
            function=left[0].function, arguments=left[0].arguments,
        ), left[0]  # fmt: skip
    if first.touched or second.touched:
        return Message(
            "restoreState does not bring back all of the impulses that contacts start from"
        ), None
    return None
