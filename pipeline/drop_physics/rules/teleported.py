"""Bodies that a call puts elsewhere while they move."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from drop_physics.messages import Message
from drop_physics.physics.tree import States
from drop_physics.rules.answer import Answer, Effect, Finding, Notes, Scene

MOVING_M_S = 1e-3


class Teleported(Answer):
    """Bodies that a call puts elsewhere while they move; a restored state is none of these."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._last: dict[int, tuple[int, int, States]] = {}
        """By body: life, step, and the state of the last sample."""
        self._jumps: Notes[int] = Notes()

    def see(self) -> None:
        """Compare states that calls set with those before."""
        for judged, steps in self.scene.stretches():
            number = judged.body.number
            if steps.law.tree.fixed or not len(steps):
                continue
            life, rows = steps.epoch.life, np.flatnonzero(steps.put[1:]) + 1
            pairs = [(steps.after.at(rows - 1), steps.steps[rows - 1], rows)]
            known = self._last.get(number)
            if steps.put[0] and known is not None and known[0] == life:
                pairs.insert(0, (known[2], np.array([known[1]]), np.array([0])))
            for came, at, its in pairs:
                way = steps.before.position_m[its] - came.position_m
                way_m, speed = (
                    np.linalg.norm(each, axis=1) for each in (way, came.velocity[:, 3:6])
                )
                moved = (way_m > 0) & (speed > MOVING_M_S) & (at == steps.steps[its] - 1)
                moved &= ~self.scene.placing.restored(number, steps.steps[its])
                if moved.any():
                    told = {"way": way_m[moved], "speed": speed[moved]}
                    first = np.arange(int(moved.sum()), 0, -1.0)  # of all the first is told
                    self._jumps.add(number, at[moved], first, told)
            self._last[number] = life, int(steps.steps[-1]), steps.after.at(slice(-1, None))

    def findings(self) -> Iterator[Finding]:
        """Yield the first time of each body."""
        for number, each in self._jumps.items():
            body = self.scene.body(number)
            more = Message(" (the first of {n:,} times)", n=each.count) if each.count > 1 else ""
            message = Message(
                "{body} is put {way:.3g} m away at step {step:,}{more}, while it moves at "
                "{speed:.3g} m/s: no force takes it there",
                body=body.label,
                way=each.at["way"],
                step=each.first,
                more=more,
                speed=each.at["speed"],
            )
            yield Finding(
                code="teleported",
                level="note",
                message=message,
                body=body.label,
                effect=Effect(each.at["way"], "m"),
                steps=each.span,
                site=self.scene.placing.site(body, each.last + 1),
            )
