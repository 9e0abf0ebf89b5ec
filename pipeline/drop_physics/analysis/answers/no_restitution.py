"""`no-restitution`: restitution is set, and what lands does not bounce."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from drop_physics.analysis.answers.answer import Answer, Effect, Finding, Scene, Span
from drop_physics.analysis.answers.asked_of_bodies import AskedOfBodies
from drop_physics.analysis.explained.recording import Explained
from drop_physics.messages import Message

THRESHOLD_M_S = 0.2
"""Bullet's own: slower contacts do not bounce."""
STOPPED = 1e-3
"""Share of the approach that is left of what is stopped."""
SWALLOWED = 0.5
"""Share of what was asked for, below which it does not bounce: overlap alone lifts a little."""


@dataclass
class Meeting:
    """What became of the fastest approach of a pair."""

    step: int
    approach_m_s: float
    rebound_m_s: float
    count: int


class NoRestitution(Answer):
    """The engine multiplies both bodies' restitution; that of most files is 0."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._asked = AskedOfBodies(scene, "restitution")
        self._soft = AskedOfBodies(scene, "contactStiffness")
        self._met: dict[tuple[int, int], Meeting] = {}

    def see(self, explained: Explained) -> None:
        """Take a piece."""
        self._asked.see(explained)
        self._soft.see(explained)
        pairs = self.scene.touches.pairs
        wanted = [number for number, value in self._asked.values.items() if value > 0]
        if not wanted or not len(pairs.starts):
            return
        # Where the engine has restitution, it bounces as it says.
        fast = (pairs.approach_m_s > THRESHOLD_M_S) & (pairs.restitution == 0)
        # What is soft, or pressed by others, takes longer than a step to stop.
        fast &= pairs.parting_m_s > -STOPPED * pairs.approach_m_s
        fast &= np.isin(pairs.body, wanted).any(axis=1) & (pairs.body[:, 0] != pairs.body[:, 1])
        for row in np.flatnonzero(fast).tolist():
            first, second = pairs.body[row].tolist()
            approach, rebound = float(pairs.approach_m_s[row]), float(pairs.parting_m_s[row])
            met = self._met.setdefault((first, second), Meeting(0, 0.0, 0.0, 0))
            met.count += 1
            if approach > met.approach_m_s:
                met.step, met.approach_m_s = int(pairs.step[row]), approach
                met.rebound_m_s = max(rebound, 0.0)

    def findings(self) -> Iterator[Finding]:
        """Yield each pair of which one was to bounce."""
        for (first, second), met in self._met.items():
            given, none = (first, second) if first in self._asked.values else (second, first)
            asked = self._asked.values[given]
            if self._asked.values.get(none, 0.0) > 0 or asked <= 0:
                continue  # both were given: a link has none, or it came later
            if given in self._asked.changed or self._asked.since[given] >= met.step:
                continue  # it may have been another when they met
            if {first, second} & self._soft.values.keys():
                continue  # what is soft rebounds by a law of its own
            # What moves is what bounces.
            body, other = (given, none) if self.scene.body(given).moving else (none, given)
            if met.rebound_m_s > SWALLOWED * asked * met.approach_m_s:
                continue
            yield Finding(
                code="no-restitution",
                level="asked",
                message=Message(
                    "does not bounce off {other}: it meets it at {speed:.3g} m/s and leaves at "
                    "{rebound:.3g} m/s; restitution is the product of both bodies', "
                    "{asked:.3g} × 0",
                    other=self.scene.body(other).label, speed=met.approach_m_s,
                    rebound=met.rebound_m_s, asked=asked,
                ),
                advice=Message(
                    "give {other} restitution, too: p.changeDynamics(…, restitution=1)",
                    other=self.scene.body(none).label,
                ),
                body=self.scene.body(body).label,
                other=self.scene.body(other).label,
                effect=Effect(asked * met.approach_m_s, "m/s"),
                share=asked,
                steps=Span(met.step, met.step, met.count),
                site=self._asked.site(given),
            )  # fmt: skip
