"""Why a robot that was put back turns on: its joints keep their rates."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from drop_physics.messages import Message
from drop_physics.rules.answer import Answer, Effect, Finding, Notes, Scene
from drop_physics.rules.joint import name_of, units_of

KEPT, TURNS = 1e-9, 0.1
"""A base or a joint that was put is farther from where it was [m, rad]; a rate that is not rest
[rad/s, m/s]."""


class RatesLeft(Answer):
    """`resetBasePositionAndOrientation` stops a base, and leaves the rates of its joints."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._after: dict[int, tuple[int, NDArray[np.float64]]] = {}
        """By body: its last step, and where its base and joints were after it."""
        self._found: Notes[int] = Notes()

    def see(self) -> None:
        """Note where a base was put, once, while joints turned that no call put."""
        for driven in self.scene.driven():
            number, steps = driven.body.number, driven.steps
            now = np.hstack([steps.after.position_m, driven.after])
            last, came = self._after.get(number, (-1, now[:0]))
            came = np.vstack([came if last + 1 == steps.steps[0] else now[:1], now[:-1]])
            self._after[number] = int(steps.steps[-1]), now[-1:]
            moved = np.abs(np.hstack([steps.before.position_m, driven.before]) - came) > KEPT
            rates = np.abs(steps.before.velocity[:, steps.law.tree.first_rate :])
            put = steps.put & moved[:, :3].any(axis=1) & ~moved[:, 3:].any(axis=1)
            put &= self.scene.placing.placed(np.full(len(steps), number), steps.steps)
            rows = np.flatnonzero(put & (rates.max(axis=1) > TURNS))
            if len(rows) and not steps.law.tree.fixed:
                most = rates[rows].argmax(axis=1)
                k = int(most[rates[rows].max(axis=1).argmax()])
                asked = driven.asked.target_velocity[rows[0], k]
                self._found.add(
                    number,
                    steps.steps[rows],
                    rates[rows].max(axis=1),
                    driven=asked != 0,
                    joint=name_of(driven, k),
                    unit=units_of(driven, k)[0],
                )

    def findings(self) -> Iterator[Finding]:
        """Yield a line per robot."""
        for number, each in self._found.items():
            body, unit = self.scene.body(number), f"{each.at['unit']}/s"
            yield Finding(
                code="reset-leaves",
                level="note" if each.at["driven"] else "asked",
                message=Message(
                    "{joint} still turns at {rate:.3g} {unit} where a call puts {body}: it sets "
                    "the base, and leaves the rates of joints",
                    joint=each.at["joint"],
                    rate=each.most,
                    unit=unit,
                    body=body.label,
                ),
                advice=Message("call p.resetJointState(body, joint, position, 0) for each, too"),
                body=body.label,
                joint=each.at["joint"],
                effect=Effect(each.most, unit),
                steps=each.span,
                site=self.scene.placing.site(body, each.first),
            )
