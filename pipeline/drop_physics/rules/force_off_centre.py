"""Why a force makes a body whirl: a point of the body is given as one of the world, or as its own.

As its own: where the body is in the world, in a frame that begins there.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from drop_physics.explain.steps import Steps
from drop_physics.messages import Message
from drop_physics.physics.kinematics import kinematics
from drop_physics.physics.tree import BASE
from drop_physics.rules.answer import Answer, Cure, Effect, Finding, Notes, Scene
from drop_physics.rules.arguments import given, number, site_of
from drop_physics.trace.acts import Act
from drop_physics.trace.calls import WORLD_FRAME, Call
from drop_physics.trace.events import Body

SAME_M = 1e-6
"""A point this near to the centre is the centre."""
FRAMES = {True: Message("the world's frame"), False: Message("its own frame")}
ADVICE = {
    True: Message("give it in p.LINK_FRAME, or at the body's position"),
    False: Message("give it in p.WORLD_FRAME, or at [0, 0, 0]"),
}


class ForceOffCentre(Answer):
    """A point in the other frame than the one that is named."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._off: Notes[int] = Notes()
        self._late: list[tuple[Call, Body]] = []
        """Those whose step is in the next piece."""

    def see(self) -> None:
        """Compare where forces act with where their bodies are."""
        end = self.scene.piece.end
        calls = [*self._late, *self.scene.calls_of(Act.PUSH)]
        self._late = [pair for pair in calls if pair[0].at.step + 1 >= end]
        told: dict[tuple[int, int, bool], list[Call]] = {}
        for call, body in calls:
            world = int(number(call, "flags", 0.0)) == WORLD_FRAME
            vectors = len(given(call, "posObj")) == len(given(call, "forceObj")) == 3
            if vectors and call.at.step + 1 < end:
                key = body.number, int(number(call, "linkIndex", float(BASE))), world
                told.setdefault(key, []).append(call)
        for (number_, link, world), its in told.items():
            for _, steps in self.scene.stretches(number_):
                if BASE <= link < steps.law.tree.links:
                    self._compare(self.scene.body(number_), link, steps, its, world=world)

    def _compare(
        self, body: Body, link: int, steps: Steps, calls: list[Call], *, world: bool
    ) -> None:
        """Note steps whose forces act beside the body, and within it if in its own frame.

        Together: each of a drone's rotors is beside it, and all four lift it at its centre.
        """
        tree, ends = steps.law.tree, np.array([call.at.step + 1 for call in calls])
        rows = np.minimum(np.searchsorted(steps.steps, ends), max(len(steps) - 1, 0))
        known = np.flatnonzero(steps.steps[rows] == ends) if len(steps) else np.empty(0, int)
        if tree.fixed or not (tree.inertias_kg_m2 > 0).all() or not len(known):
            return  # it may not be free to turn
        points, forces = (
            np.array([given(calls[k], name) for k in known]) for name in ("posObj", "forceObj")
        )
        centre = kinematics(tree, steps.before.at(rows[known])).position_m(link)
        strength = np.maximum(np.linalg.norm(forces, axis=1), 1e-300)[:, None]
        same = np.abs(points - centre).max(axis=1) <= SAME_M
        moments = np.cross(points - centre if world else points, forces)
        arms = np.linalg.norm(moments / strength, axis=1)
        ends, each = np.unique(ends[known], return_inverse=True)

        def mean_m(values: NDArray[np.float64]) -> NDArray[np.float64]:
            """Return how long sums of a step are over the sum of its forces [m], shape (n,)."""
            sums = np.zeros((len(ends), 4))
            np.add.at(sums, each, np.hstack([values, strength]))
            return np.asarray(np.linalg.norm(sums[:, :3], axis=1) / sums[:, 3])

        box = np.array(body.bounds_m[6 * (link + 1) : 6 * (link + 2)])
        size_m = float(np.linalg.norm(box[3:] - box[:3])) / 2 if len(box) == 6 else 0.0
        own = np.maximum(mean_m(np.cross(points, forces)), mean_m(points * strength))
        meant = own <= size_m if world else np.bincount(each, ~same) == 0
        off = np.flatnonzero((mean_m(moments) > size_m) & meant)
        if len(off):
            farthest = np.array([np.where(each == k, arms, -1.0).argmax() for k in off])
            first = calls[known[np.flatnonzero(each == off[0])[0]]]
            ends, told = ends[off], {"point": points[farthest], "arm": arms[farthest]}
            order = -ends.astype(float)  # of all the first is told
            self._off.add(
                body.number, ends, order, told, size=size_m, site=site_of(first), world=world
            )

    def findings(self) -> Iterator[Finding]:
        """Yield the first such force of each body."""
        for number_, each in self._off.items():
            body, arm = self.scene.body(number_).label, each.at["arm"]
            message = Message(
                "{body} is pushed beside itself: the point ({point}) is in {frame}, {arm:.3g} m "
                "off its centre, so the force spins it",
                body=body,
                point=", ".join(f"{x:g}" for x in each.at["point"]),
                arm=arm,
                frame=FRAMES[each.at["world"]],
            )
            yield Finding(
                code="force-off-centre",
                level="asked",
                message=message,
                body=body,
                advice=ADVICE[each.at["world"]],
                cure=Cure("push-at-centre", body),
                effect=Effect(arm, "m"),
                share=arm / each.at["size"],
                steps=each.span,
                site=each.at["site"],
            )
