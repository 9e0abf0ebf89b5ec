"""Why a robot that was put back runs off again: its motors keep their targets."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from drop_physics.analysis.answers.answer import Answer, Effect, Finding, Notes, Scene, Span
from drop_physics.analysis.answers.joint import OFF, distance, name_of, place, units_of
from drop_physics.analysis.answers.placing import Placing
from drop_physics.analysis.explained.recording import Explained
from drop_physics.analysis.joints import Driven, target_of
from drop_physics.messages import Message

WATCHED = 240
"""For how many steps after it was put somewhere a joint is watched."""

KEPT, TURNS = 1e-9, 0.1
"""A base or a joint that was put is farther from where it was [m, rad]; a rate that is not rest
[rad/s, m/s]."""
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

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._joints: dict[int, dict[int, _Joint]] = {}
        self._found: dict[int, dict[str, _Put]] = {}
        self._restored: dict[int, set[int]] = {}
        """By client, after which steps a state was restored, in this piece or just before it."""

    def see(self, explained: Explained) -> None:
        """Take a piece."""
        steps = {client: {max(held)} for client, held in self._restored.items()}
        for call in explained.piece.calls:
            if call.function == "restoreState":
                steps.setdefault(call.client, set()).add(call.at.step)
        self._restored = steps
        for number in explained.bodies:
            for driven in self.scene.joints.latest.get(number, []):
                joints, targets = self._joints.setdefault(number, {}), target_of(driven)
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
            yield Finding(
                code="reset-leaves",
                level="asked" if worst.back else "note",
                message=Message(
                    "{joint} is put to {position} and driven off by {off}: its motor keeps the "
                    "target of {target} that it had before (joints of this robot: {count})",
                    joint=worst.joint, position=place(worst.position, worst.unit),
                    off=distance(worst.off, worst.unit), target=place(worst.target, worst.unit),
                    count=len(found),
                ),
                advice=Message(
                    "give the motors new targets after p.{function}", function=worst.function
                ),
                body=self.scene.body(number).label,
                joint=worst.joint,
                effect=Effect(worst.off, worst.unit),
                share=worst.off,
                steps=Span(worst.first, worst.last, worst.last - worst.first + 1),
                site=self.scene.site(worst.site),
            )  # fmt: skip

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
            joint=name_of(driven, k), unit=unit, position=position, target=target, first=first,
            back=any(abs(position - home) < SAME for home in homes), told=told,
            function="restoreState" if restored else "resetJointState",
            site=float(driven.asked.site[row, k]), last=first, reached=position,
        )  # fmt: skip

    def _end(self, number: int, joint: _Joint) -> None:
        """Judge what was watched."""
        put, joint.watched = joint.watched, None
        if put is None or put.work_j <= 0 or put.off < OFF[put.unit]:
            return
        found = self._found.setdefault(number, {})
        known = found.get(put.joint)
        if known is None or (put.back, put.off) > (known.back, known.off):
            found[put.joint] = put


class RatesLeft(Answer):
    """`resetBasePositionAndOrientation` stops a base, and leaves the rates of its joints."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._placing = Placing(scene)
        self._after: dict[int, tuple[int, NDArray[np.float64]]] = {}
        """By body: its last step, and where its base and joints were after it."""
        self._found: Notes[int] = Notes()

    def see(self, explained: Explained) -> None:
        """Note where a base was put, once, while joints turned that no call put."""
        self._placing.see(explained)
        for number in explained.bodies:
            for driven in self.scene.joints.latest.get(number, []):
                steps, none = driven.steps, np.zeros((0, 3 + driven.after.shape[1]))
                now = np.hstack([steps.after.position_m, driven.after])
                last, came = self._after.get(number, (-1, none))
                came = np.vstack([came if last + 1 == steps.steps[0] else now[:1], now[:-1]])
                self._after[number] = int(steps.steps[-1]), now[-1:]
                moved = np.abs(np.hstack([steps.before.position_m, driven.before]) - came) > KEPT
                rates = np.abs(steps.before.velocity[:, steps.law.tree.first_rate :])
                put = steps.put & moved[:, :3].any(axis=1) & ~moved[:, 3:].any(axis=1)
                put &= self._placing.placed(np.full(len(steps), number), steps.steps)
                rows = np.flatnonzero(put & (rates.max(axis=1) > TURNS))
                if len(rows) and not steps.law.tree.fixed:
                    most = rates[rows].argmax(axis=1)
                    k = int(most[rates[rows].max(axis=1).argmax()])
                    asked = driven.asked.target_velocity[rows[0], k]
                    self._found.add(
                        number, steps.steps[rows], rates[rows].max(axis=1), driven=asked != 0,
                        joint=name_of(driven, k), unit=units_of(driven, k)[0],
                    )  # fmt: skip

    def findings(self) -> Iterator[Finding]:
        """Yield a line per robot."""
        for number, each in self._found.items():
            body, unit = self.scene.body(number), f"{each.at['unit']}/s"
            yield Finding(
                code="reset-leaves", level="note" if each.at["driven"] else "asked",
                message=Message(
                    "{joint} still turns at {rate:.3g} {unit} where a call puts {body}: it sets "
                    "the base, and leaves the rates of joints",
                    joint=each.at["joint"], rate=each.most, unit=unit, body=body.label,
                ),
                advice=Message("call p.resetJointState(body, joint, position, 0) for each, too"),
                body=body.label, joint=each.at["joint"], effect=Effect(each.most, unit),
                steps=each.span, site=self._placing.site(body, each.first),
            )  # fmt: skip


def _watch(put: _Put, driven: Driven, k: int, first: int, end: int) -> None:
    """Follow a joint through some rows."""
    end = min(end, first + WATCHED - (put.last - put.first))
    if end > first:
        rows = slice(first, end)
        moved = driven.after[rows, k] - driven.before[rows, k]
        put.work_j += float((driven.torque[rows, k] * moved).sum())
        put.reached, put.last = float(driven.after[end - 1, k]), int(driven.steps.steps[end - 1])
