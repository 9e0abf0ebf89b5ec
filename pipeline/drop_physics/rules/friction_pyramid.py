"""`friction-pyramid`: friction along two axes, each with its own limit."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from drop_physics.messages import Message
from drop_physics.rules.answer import Answer, Effect, Finding, Notes, Scene

SETTING = "set_enableConeFriction"
SLIDES_M_S = 0.01
MORE = 1.1
"""Of μN: more than a cone gives, in the median step."""
LEAST = 10
"""Sliding steps of which that is said."""


class FrictionPyramid(Answer):
    """Asked for with enableConeFriction=0; the default is a cone."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._clients = {
            each.client
            for each in scene.seen.settings
            if float(np.ravel(each.values.get(SETTING, 1.0))[0]) == 0
        }
        self._slides: Notes[tuple[int, int, bool]] = Notes()
        """By both bodies, and whether friction was more."""

    def see(self) -> None:
        """Take a piece."""
        pairs = self.scene.touches.pairs
        slides = (pairs.slip_m_s > SLIDES_M_S) & (pairs.available_n > 0)
        for first, second, rows in pairs.by_pair(slides) if self._clients else ():
            if self.scene.body(first).client in self._clients and first != second:
                used = np.linalg.norm(pairs.tangential_n[rows], axis=1) / pairs.available_n[rows]
                for more in (False, True):
                    its = (used > MORE) == more
                    if its.any():
                        self._slides.add((first, second, more), pairs.step[rows[its]], used[its])

    def findings(self) -> Iterator[Finding]:
        """Yield each pair that friction brakes more than its coefficient allows."""
        for (first, second, more), found in self._slides.items():
            less = self._slides.get((first, second, False))
            if not more or found.count < LEAST or (less and less.count >= found.count):
                continue
            yield Finding(
                code="friction-pyramid",
                level="model",
                message=Message(
                    "friction on {other} brakes {body} with up to {most:.3g} times μN: with "
                    "enableConeFriction=0 each of two axes has a limit of its own",
                    other=self.scene.body(first).label,
                    body=self.scene.body(second).label,
                    most=found.most,
                ),
                advice=Message("call p.setPhysicsEngineParameter(enableConeFriction=1)"),
                body=self.scene.body(second).label,
                other=self.scene.body(first).label,
                effect=Effect(found.most, "1"),
                share=found.most,
                steps=found.span,
            )
