"""Compares a PyBullet run with a MuJoCo run, by removing known differences between engines."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import numpy as np

from drop_physics.arrays import Float64
from drop_physics.compare.paired import PairedBody, farthest, paired_bodies
from drop_physics.engines.mujoco.described import described
from drop_physics.engines.mujoco.known import known_differences as known_of_mujoco
from drop_physics.engines.mujoco.swapping import Swapper, numbers_of
from drop_physics.engines.mujoco.taken import joined
from drop_physics.engines.pybullet.known import Likeness
from drop_physics.engines.pybullet.known import known_differences as known_of_bullet
from drop_physics.engines.pybullet.logged import BODY
from drop_physics.engines.pybullet.replayed import Replayer
from drop_physics.errors import DropError
from drop_physics.experiments.swap.answer import ProvedDifference
from drop_physics.experiments.swap.engines import WhyEngines
from drop_physics.explain.times import StepTimes
from drop_physics.stages.diff.by_calls import logged, placed, steps_of
from drop_physics.stages.diff.sides import RunSide
from drop_physics.temporary import temporary_folder
from drop_physics.trace.events import Body
from drop_physics.trace.history import Seen
from drop_physics.trace.logs import KnownDifference, LoggedCall

AGREES = 1e-9
"""Largest difference in motion without contact up to which engines count as equal, even if a
smaller tolerance is given."""


def answered_by_engines(
    a: RunSide, b: RunSide, tolerance: float, tell: Callable[[int], None]
) -> tuple[ProvedDifference, int]:
    """Explain how runs of two engines differ; also return the number of repeated runs.

    Raises
    ------
    DropError
        If a process ends early, or no bodies of the runs correspond.
    """
    with ExitStack() as stack:
        folder = stack.enter_context(temporary_folder())
        bullet, other = (a, b) if not a.recording.steps.clients else (b, a)
        runs = _Runs(bullet, other, folder, stack, tell)
        why = runs.why(tolerance or AGREES, is_swapped=bullet is b)
        return why.answer(), runs.jobs


class _Runs:
    """One run of each engine, repeated with known differences removed."""

    def __init__(
        self,
        bullet: RunSide,
        other: RunSide,
        folder: Path,
        stack: ExitStack,
        tell: Callable[[int], None],
    ) -> None:
        self._bullet, self._other, self._folder, self._tell = bullet, other, folder, tell
        self._log, log = logged(bullet)
        steps = other.recording.steps
        client = steps.clients[0]
        self._frames = joined([*steps.pieces(client, 0, 1 << 62)])
        model = folder / "model.mjb"
        model.write_bytes(steps.model(self._frames.model))
        self._swapper = stack.enter_context(Swapper(other.python, other.environment, model))
        self._fields, _ = self._swapper.fields()
        where = [Path(bullet.target).absolute().parent]
        self._replayer = stack.enter_context(Replayer(bullet.python, bullet.environment, where))
        seen = bullet.recording.seen
        numbers = {
            came.body.number: made[1]
            for made, call in log.made
            if made[0] == BODY and (came := seen.calls.body_at(call, int(call.result))) is not None
        }
        self.lengths = steps_of(bullet), steps_of(other)
        self._pairs = _pairs(bullet, other, min(self.lengths))
        if not self._pairs:
            raise DropError(
                "{a} and {b} have no body that moves in common: one needs as many joints as the "
                "other",
                a=bullet.name,
                b=other.name,
            )
        self._numbers = [numbers.get(body.number, -1) for body, _, _ in self._pairs]
        first = min(other.recording.seen.bodies)
        self._described = described(self._fields, client=0, first=first, folder=folder)
        self.known = [*self._known()]

    @property
    def jobs(self) -> int:
        """Number of repeated runs."""
        return self._replayer.jobs + self._swapper.jobs

    def why(self, tolerance: float, *, is_swapped: bool) -> WhyEngines:
        """Return which known differences explain how the runs differ."""
        paired = [each for _, _, each in self._pairs]
        labels = [label for each in paired for label in np.array(each.labels)[_compared(each)]]
        units = [unit for each in paired for unit in np.array(each.units)[_compared(each)]]
        side = self._other if is_swapped else self._bullet
        count = min(self.lengths)
        times_s = StepTimes(side.recording.seen, 0).of_all(np.arange(1, count + 1))
        lengths = self.lengths[::-1] if is_swapped else self.lengths

        def trails(known: Sequence[int], steps: int) -> tuple[Float64, Float64] | None:
            self._tell(self.jobs)
            return self._trails([self.known[each] for each in known], steps)

        known = [replace(k, value=k.other, other=k.value) if is_swapped else k for k in self.known]
        return WhyEngines(
            known,
            trails,
            labels,
            units,
            lengths,
            times_s,
            tolerance,
            self._touches,
            lambda: farthest(paired, count - 1),
        )

    def _known(self) -> list[KnownDifference]:
        opt = {name: self._fields[f"opt.{name}"] for name in ("timestep", "gravity")}
        found: list[KnownDifference] = []
        timestep_s = _timestep_s(self._bullet)
        for (body, other, _), number in zip(self._pairs, self._numbers, strict=True):
            if number < 0:
                continue
            reported = next(
                each.reported
                for each in self._other.recording.seen.dynamics
                if each.body.number == other.number
            )
            alike = len(body.links) == len(other.links)
            likeness = Likeness(
                float(opt["timestep"].item()),
                [float(each) for each in opt["gravity"]],
                reported["mass_kg"].tolist() if alike else None,
                reported["inertia_kg_m2"].tolist() if alike else None,
                bool(np.any(self._fields["jnt_limited"])),
            )
            for each in known_of_bullet(number, len(body.links) - 1, timestep_s, likeness):
                found = _with(found, each)
        return [*(each for each in found if each.calls), *known_of_mujoco(self._fields)]

    def _trails(
        self, known: Sequence[KnownDifference], steps: int
    ) -> tuple[Float64, Float64] | None:
        """Return the coordinates of both runs after each step; PyBullet's come first."""
        calls = [call for each in known for call in each.calls]
        edits = [edit for each in known for edit in each.edits]
        mine = [each.a[1 : steps + 1][:, _compared(each)] for _, _, each in self._pairs]
        theirs = [each.b[1 : steps + 1][:, _compared(each)] for _, _, each in self._pairs]
        if calls:
            setup = sum(each.step == 0 for each in self._log)
            log: list[LoggedCall] = [*self._log[:setup], *calls, *self._log[setup:]]
            states = self._replayer.states(placed(log, self._folder), steps)
            if states is None or any(number not in states for number in self._numbers):
                return None
            mine = [
                states[number][:, [*np.array(each.places)[_compared(each)]]]
                for number, (_, _, each) in zip(self._numbers, self._pairs, strict=True)
            ]
        if edits:
            trail = numbers_of(self._described, self._swapper.trail(self._frames, edits))
            theirs = [
                trail[other.number][:steps, _compared(each)] for _, other, each in self._pairs
            ]
        return np.hstack(mine)[:steps], np.hstack(theirs)[:steps]

    def _touches(self, step: int) -> bool:
        contacts = self._bullet.recording.seen.contacts
        return bool((contacts["step"] <= step + 1).any())


def _timestep_s(side: RunSide) -> float:
    times = StepTimes(side.recording.seen, 0).of_all(np.arange(2))
    return float(times[1] - times[0])


def _with(found: list[KnownDifference], each: KnownDifference) -> list[KnownDifference]:
    """Add another body's known difference, unless one of the same kind is in the list."""
    same = next((other for other in found if other.name == each.name), None)
    if same is None:
        return [*found, each]
    calls = [*same.calls, *(call for call in each.calls if call not in same.calls)]
    both = KnownDifference(same.name, same.is_setting, calls, (), same.value, same.other)
    return [both if other is same else other for other in found]


def _pairs(bullet: RunSide, other: RunSide, steps: int) -> list[tuple[Body, Body, PairedBody]]:
    """Pair the bodies that move in both runs: by name, or else in order."""
    a, b = bullet.recording.seen, other.recording.seen
    mine, theirs = (_moving(seen) for seen in (a, b))
    named = {body.name: body for body in theirs}
    found = [(body, named[body.name]) for body in mine if body.name in named]
    rest = [
        [body for body in bodies if all(body is not each for pair in found for each in pair)]
        for bodies in (mine, theirs)
    ]
    found += zip(*rest, strict=False)
    pairs = [(x, y, paired_bodies(a, b, [(x, y)], steps)) for x, y in found]
    return [(x, y, held[0]) for x, y, held in pairs if held]


def _moving(seen: Seen) -> list[Body]:
    """Return the bodies that move in a recording."""
    piece = seen.sampled.piece(0, 1)
    moving = {*np.unique(piece.bases["body"]).tolist(), *piece.joints}
    return [body for number, body in sorted(seen.bodies.items()) if number in moving]


def _compared(body: PairedBody) -> list[int]:
    """Return the coordinates that both engines share, since inertia axes may differ."""
    return [n for n, place in enumerate(body.places) if not 3 <= place < 7]
