"""Why something bounces too little, or ever higher."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from drop_physics.analysis.answers.answer import Answer, Effect, Finding, Scene, Span
from drop_physics.analysis.answers.asked_of_bodies import AskedOfBodies
from drop_physics.analysis.answers.placing import Placing
from drop_physics.analysis.contact_points import Pairs
from drop_physics.analysis.explained.changes import energy_of
from drop_physics.analysis.explained.recording import Explained
from drop_physics.messages import Message

THRESHOLD_M_S = 0.2
"""Bullet's own: slower contacts do not bounce."""
PLACED_S = 1 / 60
"""A body that is placed, not dropped, comes at what gravity gives it in that time, or slower."""
SOFTLY = 0.5
"""Share of the approach that is left of what takes longer than a step to stop."""
SWALLOWED = 0.5
"""Share of what was asked for, below which it does not bounce: overlap alone lifts a little."""
GAINED = 0.01
"""Share of the energy that they brought."""
FREE = 6
"""Degrees of freedom of one rigid body."""


class NoRestitution(Answer):
    """The engine multiplies both bodies' restitution; that of most files is 0."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._asked = AskedOfBodies(scene, "restitution")
        self._soft = AskedOfBodies(scene, "contactStiffness")
        self._met: dict[tuple[int, int], tuple[int, float, float, float]] = {}
        """The fastest approach of a pair: step, approach, rebound, restitution."""

    def see(self, explained: Explained) -> None:
        """Take a piece."""
        self._asked.see(explained)
        self._soft.see(explained)
        pairs = self.scene.touches.pairs
        wanted = [number for number, value in self._asked.values.items() if value > 0]
        if not wanted or not len(pairs.starts):
            return
        approach, rebound = pairs.approach_m_s, pairs.parting_m_s
        meets = np.isin(pairs.body, wanted).any(axis=1) & (pairs.body[:, 0] != pairs.body[:, 1])
        meets &= (approach > 9.81 * PLACED_S) & (rebound > -SOFTLY * approach)
        for row in np.flatnonzero(meets).tolist():
            both = tuple(pairs.body[row].tolist())
            if approach[row] > self._met.get(both, (0, 0.0))[1]:
                numbers = float(approach[row]), float(rebound[row]), float(pairs.restitution[row])
                self._met[both] = int(pairs.step[row]), *numbers

    def findings(self) -> Iterator[Finding]:
        """Yield each pair of which one was to bounce."""
        for (first, second), (step, approach, rebound, product) in self._met.items():
            given, none = (first, second) if first in self._asked.values else (second, first)
            asked, other = (self._asked.values.get(each, 0.0) for each in (given, none))
            if given in self._asked.changed or self._asked.since[given] >= step:
                continue  # it may have been another when they met
            if {first, second} & self._soft.values.keys():
                continue  # what is soft rebounds by a law of its own
            slow = product > 0 and approach < THRESHOLD_M_S
            if not slow and (product > 0 or other > 0):
                continue  # it bounces as the engine has it: a link has none, or it came later
            wanted = product if slow else asked
            if rebound > SWALLOWED * wanted * approach or (approach < THRESHOLD_M_S and not slow):
                continue
            # What moves is what bounces.
            body, on = (given, none) if self.scene.body(given).moving else (none, given)
            why, advice = _cause(asked, self.scene.body(none).label, slow=slow)
            yield Finding(
                code="no-restitution", level="asked",
                message=Message(
                    "does not bounce off {other}: it meets it at {speed:.3g} m/s and leaves at "
                    "{rebound:.3g} m/s; {why}",
                    other=self.scene.body(on).label, speed=approach, rebound=max(rebound, 0.0),
                    why=why,
                ),
                advice=advice, body=self.scene.body(body).label, other=self.scene.body(on).label,
                effect=Effect(wanted * approach, "m/s"), share=wanted, steps=Span(step, step, 1),
                site=self._asked.site(given),
            )  # fmt: skip


def _cause(asked: float, none: str, *, slow: bool) -> tuple[Message, Message | None]:
    """Return why it does not bounce, and what changes it."""
    if slow:
        return Message("PyBullet lets nothing bounce that comes slower than 0.2 m/s"), Message(
            "p.setPhysicsEngineParameter(restitutionVelocityThreshold=…) sets that speed"
        )
    return (
        Message("restitution is the product of both bodies', {asked:.3g} × 0", asked=asked),
        Message("give {other} restitution, too: p.changeDynamics(…, restitution=1)", other=none),
    )


@dataclass(frozen=True)
class Episode:
    """Consecutive steps of contact."""

    first: int
    last: int
    brought_j: float
    """Kinetic energy of both as it began; nan where it is not known."""
    given_j: float
    approach_m_s: float
    parting_m_s: float
    """Along the normal, as it began and as it ended."""
    restitution: float

    def then(self, more: Episode) -> Episode:
        """Return both as one; what is not sure of a part is not of the whole."""
        return replace(
            self, last=more.last, brought_j=self.brought_j + 0.0 * more.brought_j,
            given_j=self.given_j + more.given_j, parting_m_s=more.parting_m_s,
            restitution=max(self.restitution, more.restitution),
        )  # fmt: skip

    @property
    def gains(self) -> bool:
        """Whether they part faster than they came; without restitution what did it is not sure."""
        faster = self.parting_m_s > self.approach_m_s > 0
        return self.restitution > 0 and faster and self.given_j > GAINED * self.brought_j > 0


class EnergyGained(Answer):
    """Bodies leave a contact with more energy than they brought; no call moves them, no joints."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._placing = Placing(scene)
        self._asked = AskedOfBodies(scene, "restitution")
        self._open: dict[tuple[int, int], Episode] = {}
        self._found: dict[tuple[int, int], Episode] = {}

    def see(self, explained: Explained) -> None:
        """Take a piece."""
        self._placing.see(explained)
        self._asked.see(explained)
        pairs = self.scene.touches.pairs
        for *both, rows in pairs.by_pair(pairs.normal_n > 0):
            for part in np.split(rows, np.flatnonzero(np.diff(pairs.step[rows]) != 1) + 1):
                if both[0] != both[1]:
                    self._take((both[0], both[1]), self._episode(pairs, part, explained))

    def _episode(self, pairs: Pairs, rows: NDArray[np.intp], explained: Explained) -> Episode:
        step = int(pairs.step[rows[0]])
        moved = self._placing.moved(pairs.body[rows], pairs.step[rows, None]).any()
        sure = pairs.explained[rows].all() and not moved
        brought = sum(_kinetic_j(explained, each, step) for each in pairs.body[rows[0]].tolist())
        return Episode(
            step, int(pairs.step[rows[-1]]), brought if sure else np.nan,
            float(pairs.energy_j[rows].sum()), float(pairs.approach_m_s[rows[0]]),
            float(pairs.parting_m_s[rows[-1]]), float(pairs.restitution[rows].max()),
        )  # fmt: skip

    def _take(self, both: tuple[int, int], episode: Episode) -> None:
        last = self._open.pop(both, None)
        if last is not None and last.last + 1 == episode.first:
            episode = last.then(episode)
        elif last is not None:
            self._close(both, last)
        self._open[both] = episode

    def _close(self, both: tuple[int, int], episode: Episode) -> None:
        """Keep the episode that gave most."""
        known = self._found.get(both)
        if episode.gains and (known is None or episode.given_j > known.given_j):
            self._found[both] = episode

    def findings(self) -> Iterator[Finding]:
        """Yield each pair that gained energy."""
        for both, last in self._open.items():
            self._close(both, last)
        for both, episode in self._found.items():
            movers = [number for number in both if self.scene.body(number).moving]
            if len(movers) != 1 or len(self.scene.touches.rows(movers[0])) > 1:
                continue  # a third body may have given it
            number = movers[0]
            other = next(each for each in both if each != number)
            message = Message(
                "gains {gained:.3g} J on {brought:.3g} J from contact with {other}: it comes at "
                "{approach:.4g} m/s and leaves at {parting:.4g} m/s; their restitution is "
                "{restitution:.3g}, and the push out of the overlap comes on top",
                other=self.scene.body(other).label, gained=episode.given_j,
                approach=episode.approach_m_s, parting=episode.parting_m_s,
                brought=episode.brought_j, restitution=episode.restitution,
            )  # fmt: skip
            yield Finding(
                code="energy-gained", level="broken", message=message,
                advice=Message(
                    "give them less restitution, or no push: "
                    "p.setPhysicsEngineParameter(contactERP=0)"
                ),
                body=self.scene.body(number).label, other=self.scene.body(other).label,
                effect=Effect(episode.given_j, "J"), share=episode.given_j / episode.brought_j,
                steps=Span(episode.first, episode.last, episode.last - episode.first + 1),
                site=self._asked.site(number) or self._asked.site(other),
            )  # fmt: skip


def _kinetic_j(explained: Explained, number: int, step: int) -> float:
    """Return the kinetic energy of a body as a step began: 0 if it stands, nan with joints."""
    judged = explained.bodies.get(number)
    for steps in () if judged is None else judged.stretches:
        at = np.flatnonzero(steps.steps == step)
        if len(at) and steps.law.tree.size == FREE:
            return float(energy_of(steps.law, steps.before.at(at), np.zeros((1, 3)))[0][0])
    return 0.0 if judged is None else np.nan
