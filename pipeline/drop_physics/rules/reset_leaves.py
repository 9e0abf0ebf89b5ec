"""Why a robot that was put back runs off again: its motors keep their targets."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from drop_physics.explain.joints import Driven, target_of
from drop_physics.messages import Message
from drop_physics.rules.answer import Answer, Cure, Effect, Finding, Level, Scene, Span
from drop_physics.rules.engines import MUJOCOS
from drop_physics.rules.joint import OFF, distance, name_of, place, units_of
from drop_physics.trace.acts import Act

WATCHED = 240
"""For how many steps after it was put somewhere a joint is watched."""
SAME = 1e-6
"""Closer than that [rad] or [m] it is back: one that is put there with some noise is not."""


@dataclass(kw_only=True)
class _Put:
    """A joint that a call put somewhere, with a motor that has a target from before."""

    joint: str
    unit: str
    position: float
    target: float
    back: bool
    """Whether it was put back to where it was when that target was given, or its episode began."""
    told: float
    function: str
    """Which call put it there."""
    site: float
    first: int
    last: int
    reached: float
    work_j: float = 0.0
    """The motor's."""

    @property
    def off(self) -> float:
        """How far it was driven towards the target."""
        return abs(self.position - self.target) - abs(self.reached - self.target)


@dataclass
class _Joint:
    after: float = np.nan
    """Where it was at the last step."""
    told: float = np.nan
    """When its target was given."""
    start: float = np.nan
    """Where it was then."""
    episode: int = 0
    """The first step after it was last put somewhere."""
    home: float = np.nan
    """Where it was then."""
    watched: _Put | None = None


class ResetLeaves(Answer):
    """`resetJointState` and `restoreState` set positions and rates, and no motors."""

    cure: ClassVar[str | None] = "targets-held"
    """What gives motors new targets."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._joints: dict[int, dict[int, _Joint]] = {}
        self._found: dict[int, dict[str, _Put]] = {}
        self._restored: dict[int, set[int]] = {}
        """By client, after which steps a state was restored, in this piece or just before it."""

    def see(self) -> None:
        """Take a piece."""
        steps = {client: {max(held)} for client, held in self._restored.items()}
        for call in self.scene.piece.calls.of(Act.RESTORE):
            steps.setdefault(call.client, set()).add(call.at.step)
        self._restored = steps
        for driven in self.scene.driven():
            joints = self._joints.setdefault(driven.body.number, {})
            targets = target_of(driven)
            for k in range(targets.shape[1]):
                self._see(joints.setdefault(k, _Joint()), driven, k, targets[:, k])

    def findings(self) -> Iterator[Finding]:
        """Yield a line per robot."""
        for number, joints in self._joints.items():
            for joint in joints.values():
                self._end(number, joint)
            found = self._found.get(number, {})
            if not found:
                continue
            worst = max(found.values(), key=lambda each: (each.back, each.off))
            message, advice, level = self._words(worst, len(found))
            yield Finding(
                code="reset-leaves",
                level=level,
                message=message,
                advice=advice,
                cure=None if self.cure is None else Cure(self.cure, self.scene.body(number).label),
                body=self.scene.body(number).label,
                joint=worst.joint,
                effect=Effect(worst.off, worst.unit),
                share=worst.off,
                steps=Span(worst.first, worst.last, worst.last - worst.first + 1),
                site=self.scene.site(worst.site),
            )

    def _words(self, put: _Put, count: int) -> tuple[Message, Message, Level]:
        """Return what is said of the worst joint of a robot, its cure, and how grave it is."""
        message = Message(
            "{joint} is reset to {position}, then driven {off} away: its motor keeps the "
            "target of {target} that it had before (joints of this robot: {count})",
            joint=put.joint,
            position=place(put.position, put.unit),
            off=distance(put.off, put.unit),
            target=place(put.target, put.unit),
            count=count,
        )
        advice = Message("give the motors new targets after p.{function}", function=put.function)
        return message, advice, "asked" if put.back else "note"

    def _see(self, joint: _Joint, driven: Driven, k: int, target: NDArray[np.float64]) -> None:
        steps, before, after = driven.steps, driven.before[:, k], driven.after[:, k]
        began, told = driven.asked.began[:, k], driven.asked.told[:, k]
        came = np.append(joint.after, after[:-1])
        moved = steps.put & (np.abs(before - came) > OFF[units_of(driven, k)[0]])
        new = np.append(began[0] != joint.told, np.diff(began) != 0)
        if joint.watched is not None and told[0] != joint.watched.told:
            self._end(driven.body.number, joint)
        again = np.append(False, np.diff(told) != 0)
        puts = np.flatnonzero(moved)
        if np.isnan(joint.home):
            joint.home = float(before[0])
        for first, end in pairwise([-1, *puts.tolist(), len(steps)]):
            if first >= 0:
                self._end(driven.body.number, joint)
                since = int(np.flatnonzero(new[: first + 1])[-1]) if new[: first + 1].any() else -1
                if since >= 0:
                    joint.start = float(before[since])
                if told[first] < steps.steps[first] - 1 and driven.limit[first, k] > 0:
                    joint.watched = self._put(joint, driven, k, first, float(target[first]))
                joint.episode, joint.home = int(steps.steps[first]), float(before[first])
            if joint.watched is not None:
                first = max(first, 0)
                given = np.flatnonzero(again[first + 1 : end])
                until = end if not len(given) else first + 1 + int(given[0])
                _watch(joint.watched, driven, k, first, until)
                if until < end:
                    self._end(driven.body.number, joint)
        if new.any():
            joint.told, joint.start = float(began[-1]), float(before[np.flatnonzero(new)[-1]])
        joint.after = float(after[-1])

    def _put(self, joint: _Joint, driven: Driven, k: int, row: int, target: float) -> _Put | None:
        unit, _ = units_of(driven, k)
        position, first = float(driven.before[row, k]), int(driven.steps.steps[row])
        if not np.isfinite(target):
            return None
        told = float(driven.asked.told[row, k])
        restored = first - 1 in self._restored.get(driven.body.client, ())
        homes = [joint.start, *([joint.home] if told >= joint.episode - 1 else [])]
        return _Put(
            joint=name_of(driven, k),
            unit=unit,
            position=position,
            target=target,
            first=first,
            back=any(abs(position - home) < SAME for home in homes),
            told=told,
            function=(Act.RESTORE if restored else Act.SET_JOINT).function,
            site=float(driven.asked.site[row, k]),
            last=first,
            reached=position,
        )

    def _end(self, number: int, joint: _Joint) -> None:
        """Judge what was watched."""
        put, joint.watched = joint.watched, None
        if put is None or put.work_j <= 0 or put.off < OFF[put.unit]:
            return
        found = self._found.setdefault(number, {})
        known = found.get(put.joint)
        if known is None or (put.back, put.off) > (known.back, known.off):
            found[put.joint] = put


class StateLeavesControl(ResetLeaves):
    """Writing `qpos` sets positions, and not what actuators are given."""

    engines = MUJOCOS
    cure = None

    def _words(self, put: _Put, count: int) -> tuple[Message, Message, Level]:
        """Return what is said; a script that sends it there again on purpose looks the same."""
        message = Message(
            "{joint} is put to {position} and driven off by {off}: ctrl keeps the {target} that it "
            "had before qpos was written (joints of this robot: {count})",
            joint=put.joint,
            position=place(put.position, put.unit),
            off=distance(put.off, put.unit),
            target=place(put.target, put.unit),
            count=count,
        )
        advice = Message("write data.ctrl with data.qpos, or reset both by mujoco.mj_resetData")
        return message, advice, "model"


def _watch(put: _Put, driven: Driven, k: int, first: int, end: int) -> None:
    """Follow a joint through some rows."""
    end = min(end, first + WATCHED - (put.last - put.first))
    if end > first:
        rows = slice(first, end)
        moved = driven.after[rows, k] - driven.before[rows, k]
        put.work_j += float((driven.torque[rows, k] * moved).sum())
        put.reached, put.last = float(driven.after[end - 1, k]), int(driven.steps.steps[end - 1])
