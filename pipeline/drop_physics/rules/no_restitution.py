"""Why something does not bounce: the engine multiplies both restitutions, that of most is 0.

Or it comes slower than Bullet's threshold, or a contact stops it before it touches: of the rebound
`e v - gap / timestep` is left.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from drop_physics.messages import Message
from drop_physics.rules.answer import Answer, Cure, Effect, Finding, Scene, Span

THRESHOLD_M_S = 0.2
"""Bullet's own: slower contacts do not bounce."""
OF_THRESHOLD = "restitutionVelocityThreshold"
PLACED_S = 1 / 60
"""A body that is placed, not dropped, comes at what gravity gives it in that time, or slower."""
SOFTLY = 0.5
"""Share of the approach that is left of what takes longer than a step to stop."""
SWALLOWED = 0.5
"""Share of what was asked for, below which it does not bounce: overlap alone lifts a little."""


class NoRestitution(Answer):
    """The engine multiplies both bodies' restitution; that of most files is 0."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._asked = scene.asked.of["restitution"]
        self._met: dict[tuple[int, int], tuple[int, tuple[float, ...]]] = {}
        """The first impact of a pair, or that above Bullet's threshold (of a corner that comes down
        after it the speed is the impact's): its step; approach and rebound [m/s], restitution, the
        gap that was left [m], and that over the timestep [m/s]."""
        self._chosen = False
        """Whether a call sets the threshold: then it is not Bullet's own that counts."""

    def see(self) -> None:
        """Take a piece."""
        self._chosen |= bool(self.scene.piece.calls.with_argument(OF_THRESHOLD))
        pairs = self.scene.touches.pairs
        wanted = [number for number, value in self._asked.values.items() if value > 0]
        if not wanted or not len(pairs.starts):
            return
        approach, rebound = pairs.approach_m_s, pairs.parting_m_s
        meets = np.isin(pairs.body, wanted).any(axis=1) & (pairs.body[:, 0] != pairs.body[:, 1])
        meets &= (approach > 9.81 * PLACED_S) & (rebound > -SOFTLY * approach)
        for row in np.flatnonzero(meets).tolist():
            both = tuple(pairs.body[row].tolist())
            if both not in self._met or self._met[both][1][0] < THRESHOLD_M_S < approach[row]:
                gap_m, product = float(pairs.gap_m[row]), float(pairs.restitution[row])
                lost_m_s = gap_m / float(pairs.timestep_s[row])
                numbers = float(approach[row]), float(rebound[row]), product, gap_m, lost_m_s
                self._met[both] = int(pairs.step[row]), numbers

    def findings(self) -> Iterator[Finding]:
        """Yield each pair of which one was to bounce."""
        for (first, second), (step, numbers) in self._met.items():
            approach, rebound, product, gap_m, lost_m_s = numbers
            springy, none = (first, second) if first in self._asked.values else (second, first)
            asked, other = (self._asked.values.get(each, 0.0) for each in (springy, none))
            if springy in self._asked.changed or self._asked.since[springy] >= step:
                continue  # it may have been another when they met
            if none in self._asked.values and other == 0:
                continue  # a call asked for just that
            if not self._is_to_bounce(springy, none):
                continue
            if {first, second} & self.scene.asked.of["contactStiffness"].values.keys():
                continue  # what is soft rebounds by a law of its own
            if approach < THRESHOLD_M_S and self._chosen:
                continue
            slow = product > 0 and approach < THRESHOLD_M_S
            early = not slow and lost_m_s > (1 - SWALLOWED) * product * approach > 0
            if not slow and not early and (product > 0 or other > 0):
                continue  # it bounces as the engine has it: a link has none, or it came later
            wanted = product if slow or early else asked
            if rebound > SWALLOWED * wanted * approach or (approach < THRESHOLD_M_S and not slow):
                continue
            # What moves is what bounces.
            body, on = (springy, none) if self.scene.body(springy).moving else (none, springy)
            label = self.scene.body(none).label
            why, advice, cure = (
                _early(gap_m, (self.scene.body(body).label, self.scene.body(on).label))
                if early
                else _cause(asked, label, slow=slow)
            )
            yield Finding(
                code="no-restitution",
                level="asked",
                message=Message(
                    "{body} does not bounce off {other}: it meets it at {speed:.3g} m/s and leaves "
                    "at {rebound:.3g} m/s; {why}",
                    body=self.scene.body(body).label,
                    other=self.scene.body(on).label,
                    speed=approach,
                    rebound=max(rebound, 0.0),
                    why=why,
                ),
                advice=advice,
                cure=cure,
                body=self.scene.body(body).label,
                other=self.scene.body(on).label,
                effect=Effect(wanted * approach, "m/s"),
                share=wanted,
                steps=Span(step, step, 1),
                site=self._asked.site(springy),
            )

    def _is_to_bounce(self, springy: int, none: int) -> bool:
        """Return whether it is asked of what moves: a floor has restitution for other things."""
        body = self.scene.body
        chosen = [
            number
            for number, value in self._asked.values.items()
            if value > 0 and body(number).moving and body(number).client == body(springy).client
        ]
        return bool(body(springy).moving) or none in chosen or not (body(none).joints or chosen)


def _early(gap_m: float, both: tuple[str, str]) -> tuple[Message, Message, Cure]:
    """Return why it does not bounce where a contact acts before it touches, and what helps."""
    return (
        Message(
            "PyBullet stops it {gap:.3g} mm before they touch, and takes that distance over the "
            "timestep off its rebound",
            gap=gap_m * 1e3,
        ),
        Message(
            "p.changeDynamics(body, -1, contactProcessingThreshold=0) on both lets contacts act "
            "only where they touch"
        ),
        Cure("restitution", given={"contactProcessingThreshold": 0}, bodies=both),
    )


def _cause(asked: float, none: str, *, slow: bool) -> tuple[Message, Message, Cure]:
    """Return why it does not bounce, and what changes it."""
    if slow:
        return (
            Message("PyBullet lets nothing bounce that comes slower than 0.2 m/s"),
            Message("p.setPhysicsEngineParameter(restitutionVelocityThreshold=…) sets that speed"),
            Cure("restitution", given={"restitutionVelocityThreshold": 0}),
        )
    return (
        Message("restitution is the product of both bodies', {asked:.3g} × 0", asked=asked),
        Message("give {other} restitution, too: p.changeDynamics(…, restitution=1)", other=none),
        Cure("restitution", none, 1.0, bodies=(none,)),
    )
