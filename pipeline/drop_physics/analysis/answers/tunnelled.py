"""`tunnelled`: a body is on one side of a box and, a step later, on the other."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from drop_physics.analysis.answers.answer import Answer, Effect, Finding, Notes, Scene
from drop_physics.analysis.explained.bodies import records_of
from drop_physics.laws.columns import rotation
from drop_physics.messages import Message
from drop_physics.seen.events import Collision

Float64 = NDArray[np.float64]

FILTERS = "setCollisionFilter"
"""Functions, by the beginning of their names, after which bodies may pass each other."""


class Tunnelled(Answer):
    """Bodies are looked at where steps begin: between two of them nothing is in the way."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._records = records_of(scene.seen)
        self._boxes: dict[int, Collision] = {}
        """Of bodies that nothing moves, and which are one box."""
        put = [each.body.number for each in scene.seen.puts]
        for number, body in scene.seen.bodies.items():
            one_box = len(body.collisions) == 1 and body.collisions[0].kind == "box"
            if one_box and not body.moving and put.count(number) <= 1 and not body.before:
                self._boxes[number] = body.collisions[0]
        self._thinnest_m = min((min(each.size_m) for each in self._boxes.values()), default=np.inf)
        self._filtered = False
        self._found: Notes[tuple[int, int]] = Notes()

    def see(self) -> None:
        """Take a piece."""
        self._filtered |= any(each.function.startswith(FILTERS) for each in self.scene.piece.calls)
        if not self._boxes or self._filtered:
            return
        for number, judged in self.scene.judged.items():
            body = judged.body
            if body.joints or not body.base_moves or not body.collisions:
                continue
            for steps in judged.stretches:
                before_m, after_m = steps.before.position_m, steps.after.position_m
                ways_m = np.linalg.norm(after_m - before_m, axis=1)
                rows = np.flatnonzero(ways_m > self._thinnest_m)
                for other, box in self._boxes.items() if len(rows) else ():
                    if self.scene.body(other).client != body.client:
                        continue
                    base = self._records[other].told(steps.steps[rows])
                    axis = _through(before_m[rows], after_m[rows], base, box)
                    through = np.flatnonzero(axis >= 0)
                    if len(through):
                        thick_m = np.array(box.size_m)[axis[through]]
                        at = {"step": steps.steps[rows][through], "thick": thick_m,
                            "timestep": steps.reported.timestep_s[rows][through]}  # fmt: skip
                        self._found.add((number, other), at["step"], ways_m[rows][through], at)

    def findings(self) -> Iterator[Finding]:
        """Yield each body that went through a box without touching it."""
        for (number, other), found in self._found.items():
            if self._filtered or any(
                each.other == self.scene.body(other).label
                for each in self.scene.touches.rows(number)
            ):
                continue  # they may be meant to pass; or it was held off, and pushed through
            body, box = self.scene.body(number), self.scene.body(other)
            yield Finding(
                code="tunnelled",
                level="broken",
                message=Message(
                    "passes through {other} at {time:.4g} s without touching it: it goes "
                    "{way:.3g} m in one step, and {other} is {thick:.3g} m thick",
                    other=box.label, way=found.most, thick=found.at["thick"],
                    time=self.scene.times[body.client].of(found.at["step"]),
                ),
                advice=Message(
                    "use a timestep in which it goes less than that: p.setTimeStep({shorter:.1g})",
                    shorter=found.at["timestep"] * found.at["thick"] / found.most / 2,
                ),
                body=body.label,
                other=box.label,
                effect=Effect(found.most, "m"),
                share=found.most / found.at["thick"],
                steps=found.span,
            )  # fmt: skip


def _through(
    before_m: Float64, after_m: Float64, base: Float64, box: Collision
) -> NDArray[np.intp]:
    """Return through which pair of faces of a box ways go, whole; -1 where they do not."""
    turns = np.moveaxis(rotation(base[:, 3:7].T), -1, 0)
    shape = np.moveaxis(rotation(np.array(box.orientation)[:, None]), -1, 0)[0]
    half_m = np.array(box.size_m) / 2
    begins, ends = (
        (np.einsum("nji,nj->ni", turns, each - base[:, :3]) - box.position_m) @ shape
        for each in (before_m, after_m)
    )
    found = np.full(len(begins), -1)
    for axis in range(3):
        a, b = begins[:, axis], ends[:, axis]
        apart = (np.minimum(a, b) < -half_m[axis]) & (np.maximum(a, b) > half_m[axis])
        # Where it enters and leaves must be on the faces.
        within = apart.copy()
        for face in (-half_m[axis], half_m[axis]):
            share = np.divide(face - a, b - a, out=np.zeros_like(a), where=b != a)
            at = begins + share[:, None] * (ends - begins)
            others = [k for k in range(3) if k != axis]
            within &= (np.abs(at[:, others]) < half_m[others]).all(axis=1)
        found[within] = axis
    return found
