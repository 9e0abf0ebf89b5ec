"""`friction-pyramid`: friction along two axes, each with its own limit."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from drop_physics.analysis.answers.answer import Answer, Effect, Finding, Scene, Span
from drop_physics.analysis.explained.recording import Explained
from drop_physics.messages import Message

SETTING = "set_enableConeFriction"
SLIDES_M_S = 0.01
MORE = 1.1
"""Of μN: more than a cone gives, in the median step."""
LEAST = 10
"""Sliding steps of which that is said."""


@dataclass
class Sliding:
    """Steps in which a pair slides."""

    first: int
    last: int = 0
    steps: int = 0
    more: int = 0
    """In how many of them friction was more than MORE."""
    most: float = 0.0


class FrictionPyramid(Answer):
    """Asked for with enableConeFriction=0; the default is a cone."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._clients = {
            each.client
            for each in scene.seen.settings
            if float(np.ravel(each.values.get(SETTING, 1.0))[0]) == 0
        }
        self._found: dict[tuple[int, int], Sliding] = {}

    def see(self, _: Explained) -> None:
        """Take a piece."""
        pairs = self.scene.touches.pairs
        if not self._clients:
            return
        slides = (pairs.slip_m_s > SLIDES_M_S) & (pairs.available_n > 0)
        for first, second in np.unique(pairs.body[slides], axis=0).tolist():
            if self.scene.body(first).client not in self._clients or first == second:
                continue
            rows = np.flatnonzero(slides & (pairs.body == [first, second]).all(axis=1))
            used = np.linalg.norm(pairs.tangential_n[rows], axis=1) / pairs.available_n[rows]
            steps = pairs.step[rows]
            found = self._found.setdefault((first, second), Sliding(int(steps[0])))
            found.last, found.steps = int(steps[-1]), found.steps + len(rows)
            found.more += int((used > MORE).sum())
            found.most = max(found.most, float(used.max()))

    def findings(self) -> Iterator[Finding]:
        """Yield each pair that friction brakes more than its coefficient allows."""
        for (first, second), found in self._found.items():
            if found.steps < LEAST or found.more <= found.steps / 2:
                continue
            yield Finding(
                code="friction-pyramid",
                level="model",
                message=Message(
                    "friction on {other} brakes it with up to {most:.3g} times μN: with "
                    "enableConeFriction=0 each of two axes has a limit of its own",
                    other=self.scene.body(first).label, most=found.most,
                ),
                advice=Message("call p.setPhysicsEngineParameter(enableConeFriction=1)"),
                body=self.scene.body(second).label,
                other=self.scene.body(first).label,
                effect=Effect(found.most, "1"),
                share=found.most,
                steps=Span(found.first, found.last, found.more),
            )  # fmt: skip
