"""`energy-gained`: bodies leave a contact with more energy than they brought."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drop_physics.analysis.answers.answer import Answer, Effect, Finding, Scene, Span
from drop_physics.analysis.answers.asked_of_bodies import AskedOfBodies
from drop_physics.analysis.answers.placing import Placing
from drop_physics.analysis.contact_points import Pairs
from drop_physics.analysis.explained.changes import energy_of
from drop_physics.analysis.explained.recording import Explained
from drop_physics.messages import Message

GAINED = 0.01
"""Share of the energy that they brought."""
FREE = 6
"""Degrees of freedom of one rigid body."""


@dataclass
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


class EnergyGained(Answer):
    """Of both bodies together; neither moved by a call, nor with joints."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._placing = Placing(scene)
        self._asked = AskedOfBodies(scene, "restitution")
        self._open: dict[tuple[int, int], Episode] = {}
        self._found: dict[tuple[int, int], list[Episode]] = {}

    def see(self, explained: Explained) -> None:
        """Take a piece."""
        self._placing.see(explained)
        self._asked.see(explained)
        pairs = self.scene.touches.pairs
        acts = (pairs.normal_n > 0) & (pairs.body[:, 0] != pairs.body[:, 1])
        for first, second in np.unique(pairs.body[acts], axis=0).tolist():
            rows = np.flatnonzero(acts & (pairs.body == [first, second]).all(axis=1))
            for part in np.split(rows, np.flatnonzero(np.diff(pairs.step[rows]) != 1) + 1):
                self._take((first, second), self._episode(pairs, part, explained))

    def _episode(self, pairs: Pairs, rows: NDArray[np.intp], explained: Explained) -> Episode:
        bodies, step = pairs.body[rows[0]].tolist(), int(pairs.step[rows[0]])
        given = float(pairs.energy_j[rows].sum())
        moved = self._placing.moved(pairs.body[rows], pairs.step[rows, None]).any()
        sure = pairs.explained[rows].all() and not moved
        brought = sum(_kinetic_j(explained, number, step) for number in bodies)
        return Episode(
            step, int(pairs.step[rows[-1]]), brought if sure else np.nan, given,
            float(pairs.approach_m_s[rows[0]]), float(pairs.parting_m_s[rows[-1]]),
            float(pairs.restitution[rows].max()),
        )  # fmt: skip

    def _take(self, both: tuple[int, int], episode: Episode) -> None:
        last = self._open.get(both)
        if last is not None and last.last + 1 == episode.first:
            # What it brought is what it began with; what is not sure of a part is not of the whole.
            last.brought_j += 0.0 * episode.brought_j
            last.last, last.parting_m_s = episode.last, episode.parting_m_s
            last.given_j += episode.given_j
            last.restitution = max(last.restitution, episode.restitution)
        else:
            self._close(both)
            self._open[both] = episode

    def _close(self, both: tuple[int, int]) -> None:
        """Keep the episode that gave most, and how many did."""
        episode = self._open.pop(both, None)
        if episode is None or episode.restitution <= 0:
            return  # without, what gives it is not sure
        faster = episode.parting_m_s > episode.approach_m_s > 0
        if faster and episode.given_j > GAINED * episode.brought_j > 0:
            found = self._found.setdefault(both, [])
            found.append(episode)
            found[:] = sorted(found, key=lambda each: -each.given_j)[:1]

    def findings(self) -> Iterator[Finding]:
        """Yield each pair that gained energy."""
        for both in [*self._open]:
            self._close(both)
        for (first, second), (episode,) in self._found.items():
            movers = [number for number in (first, second) if self.scene.body(number).moving]
            if len(movers) != 1 or len(self.scene.touches.rows(movers[0])) > 1:
                continue  # a third body may have given it
            asked = self._asked.values
            body, other = (second, first) if second in asked or first not in asked else (
                first, second)  # fmt: skip
            values = {
                "other": self.scene.body(other).label, "gained": episode.given_j,
                "approach": episode.approach_m_s, "parting": episode.parting_m_s,
                "brought": episode.brought_j, "restitution": episode.restitution,
            }  # fmt: skip
            message = Message(
                "gains {gained:.3g} J on {brought:.3g} J from contact with {other}: it comes at "
                "{approach:.4g} m/s and leaves at {parting:.4g} m/s; their restitution is "
                "{restitution:.3g}, and the push out of the overlap comes on top",
                **values,
            )
            yield Finding(
                code="energy-gained",
                level="broken",
                message=message,
                advice=Message(
                    "give them less restitution, or no push: "
                    "p.setPhysicsEngineParameter(contactERP=0)"
                ),
                body=self.scene.body(body).label,
                other=self.scene.body(other).label,
                effect=Effect(episode.given_j, "J"),
                share=episode.given_j / episode.brought_j,
                steps=Span(episode.first, episode.last, episode.last - episode.first + 1),
                site=self._asked.site(body) or self._asked.site(other),
            )


def _kinetic_j(explained: Explained, number: int, step: int) -> float:
    """Return the kinetic energy of a body as a step began; 0 if it stands.

    nan with joints.
    """
    judged = explained.bodies.get(number)
    if judged is None:
        return 0.0
    for steps in judged.stretches:
        at = np.flatnonzero(steps.steps == step)
        if len(at) and steps.law.tree.size == FREE:
            return float(energy_of(steps.law, steps.before.at(at), np.zeros((1, 3)))[0][0])
    return np.nan
