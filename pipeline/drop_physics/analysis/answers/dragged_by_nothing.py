"""`dragged-by-nothing`: calls move a support that has no velocity, and what lies on it stays."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from drop_physics.analysis.answers.answer import Answer, Effect, Finding, Scene, Span
from drop_physics.analysis.answers.asked_of_bodies import size_m
from drop_physics.analysis.answers.placing import NEAR, Placing
from drop_physics.analysis.contact_points import Pairs
from drop_physics.analysis.explained.recording import Explained
from drop_physics.messages import Message

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
        self._placing = Placing(scene)
        self._moves: dict[int, tuple[Int64, Float64]] = {}
        puts: dict[int, dict[int, Float64]] = {}
        for each in scene.seen.puts:  # of several for a step, the last counts
            puts.setdefault(each.body.number, {})[each.at.step + 1] = each.base
        for number, told in puts.items():
            if len(told) > NEAR:
                self._moves[number] = np.array([*told], np.int64), np.array([*told.values()])
        self._ways: dict[tuple[int, int], Float64] = {}
        """Of the support and of what lies on it [m], shape (2, 3), by both."""
        self._spans: dict[tuple[int, int], Span] = {}

    def see(self, explained: Explained) -> None:
        """Take a piece."""
        self._placing.see(explained)
        pairs = self.scene.touches.pairs
        fixed = ~pairs.points.moves[pairs.starts]
        for support in self._moves:
            for side in (0, 1):
                its = (pairs.body[:, side] == support) & fixed[:, side] & ~fixed[:, 1 - side]
                rows = np.flatnonzero(its & (pairs.available_n > 0))  # without friction none would
                for other in np.unique(pairs.body[rows, 1 - side]).tolist():
                    self._add(pairs, rows[pairs.body[rows, 1 - side] == other], side)

    def _add(self, pairs: Pairs, rows: NDArray[np.intp], side: int) -> None:
        support, body = pairs.body[rows[0], side], pairs.body[rows[0], 1 - side]
        steps, bases = self._moves[int(support)]
        at = np.searchsorted(steps, pairs.step[rows])
        held = np.minimum(at, len(steps) - 1)
        moved = (at > 0) & (steps[held] == pairs.step[rows])
        moved &= steps[held] - steps[held - 1] <= NEAR
        rows, held = rows[moved], held[moved]
        way = bases[held, :3] - bases[held - 1, :3]
        still = np.linalg.norm(bases[held, 7:10], axis=1) < 1e-9
        rows, way = rows[still], way[still]
        if not len(rows):
            return
        line = pairs.line[rows]
        weights = pairs.points.normal_n[:, None]
        going = pairs.summed(weights * pairs.points.ended_m_s[:, 1 - side])[rows]
        going = going / pairs.normal_n[rows, None] * pairs.timestep_s[rows, None]
        ways = [(each - np.einsum("mi,mi->m", each, line)[:, None] * line).sum(axis=0)
            for each in (way, going)]  # fmt: skip
        key = int(support), int(body)
        self._ways[key] = self._ways.get(key, np.zeros((2, 3))) + np.array(ways)
        span = self._spans.get(key, Span(int(pairs.step[rows[0]]), 0, 0))
        self._spans[key] = Span(span.first, int(pairs.step[rows[-1]]), span.count + len(rows))

    def findings(self) -> Iterator[Finding]:
        """Yield each body that stays behind its support."""
        for (support, body), (way, going) in self._ways.items():
            behind = float(np.linalg.norm(way - going))
            ahead = float(np.linalg.norm(way))
            went = float(np.linalg.norm(going))
            if went > STAYS * ahead or behind < LEAST * size_m(self.scene.body(body)):
                continue
            span = self._spans[support, body]
            yield Finding(
                code="dragged-by-nothing",
                level="asked",
                message=Message(
                    "stays behind while calls move {other} by {ahead:.3g} m under it: a body that "
                    "is set where it is has no velocity, and drags nothing",
                    other=self.scene.body(support).label, ahead=ahead,
                ),
                advice=Message(
                    "set the velocity, too: p.resetBaseVelocity({other}, …), each step",
                    other=self.scene.body(support).label,
                ),
                body=self.scene.body(body).label,
                other=self.scene.body(support).label,
                effect=Effect(behind, "m"),
                share=behind / size_m(self.scene.body(body)),
                steps=span,
                site=self._placing.site(self.scene.body(support), span.last),
            )  # fmt: skip
