"""`dragged-by-nothing`: calls move a support that has no velocity, and what lies on it stays."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from drop_physics.explain.contact_points import Pairs
from drop_physics.messages import Message
from drop_physics.rules.answer import Answer, Effect, Finding, Notes, Scene
from drop_physics.rules.asked_of_bodies import size_m
from drop_physics.rules.placing import NEAR

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]

STAYS = 0.5
"""Share of the support's way that what lies on it goes at most."""
LEAST = 0.05
"""Share of its size that the support is ahead of it."""


class DraggedByNothing(Answer):
    """Friction acts on velocities: where only poses are set, there is none to be dragged by."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._moves: dict[int, tuple[Int64, Float64]] = {}
        puts: dict[int, dict[int, Float64]] = {}
        for each in scene.seen.puts:  # of several for a step, the last counts
            puts.setdefault(each.body.number, {})[each.at.step + 1] = each.base
        for number, told in puts.items():
            if len(told) > NEAR:
                self._moves[number] = np.array([*told], np.int64), np.array([*told.values()])
        self._ways: dict[tuple[int, int], Float64] = {}
        """Of the support and of what lies on it [m], shape (2, 3), by both."""
        self._notes: Notes[tuple[int, int]] = Notes()

    def see(self) -> None:
        """Take a piece."""
        pairs = self.scene.touches.pairs
        fixed = ~pairs.points.moves[pairs.starts]
        slides = pairs.available_n > 0  # without friction no velocity would drag
        for *both, rows in pairs.by_pair(slides) if self._moves else ():
            for side, support in enumerate(both):
                if support in self._moves:
                    its = rows[fixed[rows, side] & ~fixed[rows, 1 - side]]
                    self._add(pairs, its, side, support, both[1 - side])

    def _add(
        self, pairs: Pairs, rows: NDArray[np.int64], side: int, support: int, body: int
    ) -> None:
        steps, bases = self._moves[support]
        held = np.minimum(np.searchsorted(steps, pairs.step[rows]), len(steps) - 1)
        moved = (held > 0) & (steps[held] == pairs.step[rows])
        moved &= steps[held] - steps[held - 1] <= NEAR
        moved &= np.linalg.norm(bases[held, 7:10], axis=1) < 1e-9
        rows, held = rows[moved], held[moved]
        if not len(rows):
            return
        weights = pairs.points.normal_n[:, None]
        going = pairs.summed(weights * pairs.points.ended_m_s[:, 1 - side])[rows]
        going = going / pairs.normal_n[rows, None] * pairs.timestep_s[rows, None]
        line = pairs.line[rows]
        ways = [
            (each - np.einsum("mi,mi->m", each, line)[:, None] * line).sum(axis=0)
            for each in (bases[held, :3] - bases[held - 1, :3], going)
        ]
        key = support, body
        self._ways[key] = self._ways.get(key, np.zeros((2, 3))) + np.array(ways)
        self._notes.add(key, pairs.step[rows], pairs.normal_n[rows])

    def findings(self) -> Iterator[Finding]:
        """Yield each body that stays behind its support."""
        for (support, body), ways in self._ways.items():
            behind, (ahead, went) = np.linalg.norm(ways[0] - ways[1]), np.linalg.norm(ways, axis=1)
            size = size_m(self.scene.body(body))
            if went > STAYS * ahead or behind < LEAST * size:
                continue
            span, on = self._notes[support, body].span, self.scene.body(support)
            yield Finding(
                code="dragged-by-nothing",
                level="asked",
                message=Message(
                    "{body} stays behind while calls move {other} by {ahead:.3g} m under it: a "
                    "body that is set where it is has no velocity, and drags nothing",
                    body=self.scene.body(body).label,
                    other=on.label,
                    ahead=float(ahead),
                ),
                advice=Message(
                    "set the velocity, too: p.resetBaseVelocity({other}, …), each step",
                    other=on.label,
                ),
                body=self.scene.body(body).label,
                other=on.label,
                effect=Effect(float(behind), "m"),
                share=float(behind) / size,
                steps=span,
                site=self.scene.placing.site(on, span.last),
            )
