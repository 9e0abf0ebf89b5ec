"""Why something bounces ever higher: the push out of the overlap comes on top of restitution.

Without that push, restitution still turns the speed around that gravity adds in the step of the
impact (`btMultiBodyConstraintSolver::setupMultiBodyContactConstraint`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from drop_physics.explain.changes import energy_of
from drop_physics.explain.contact_points import Pairs
from drop_physics.messages import Message
from drop_physics.rules.answer import Answer, Effect, Finding, Scene, Span
from drop_physics.rules.runs import Runs, consecutive

GAINED = 0.01
"""Share of the energy that they brought."""
FREE = 6
"""Degrees of freedom of one rigid body."""
PUSHED = Message("the push out of the overlap comes on top")
LESS_PUSH = Message(
    "give them less restitution, or no push: p.setPhysicsEngineParameter(contactERP=0)"
)
STEPPED = Message("it turns the speed around that gravity gives them in that step, too")
SHORTER = Message("give them less restitution, or use a shorter timestep: p.setTimeStep(…)")


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
            self,
            last=more.last,
            brought_j=self.brought_j + 0.0 * more.brought_j,
            given_j=self.given_j + more.given_j,
            parting_m_s=more.parting_m_s,
            restitution=max(self.restitution, more.restitution),
        )

    @property
    def gains(self) -> bool:
        """Whether they part faster than they came; without restitution what did it is not sure."""
        faster = self.parting_m_s > self.approach_m_s > 0
        return self.restitution > 0 and faster and self.given_j > GAINED * self.brought_j > 0


class EnergyGained(Answer):
    """Bodies leave a contact with more energy than they brought; no call moves them, no joints."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._runs: Runs[Episode] = Runs(lambda _, each: each.given_j if each.gains else 0.0)
        self._without_push = {
            each.client
            for each in scene.seen.settings
            if float(np.ravel(each.values.get("set_contactERP", 1.0))[0]) == 0
        }

    def see(self) -> None:
        """Take a piece."""
        pairs = self.scene.touches.pairs
        for both, rows in consecutive(pairs, pairs.normal_n > 0):
            self._runs.add(both, self._episode(pairs, rows))

    def _episode(self, pairs: Pairs, rows: NDArray[np.intp]) -> Episode:
        step = int(pairs.step[rows[0]])
        moved = self.scene.placing.moved(pairs.body[rows], pairs.step[rows, None]).any()
        sure = pairs.explained[rows].all() and not moved
        brought = sum(_kinetic_j(self.scene, each, step) for each in pairs.body[rows[0]].tolist())
        return Episode(
            step,
            int(pairs.step[rows[-1]]),
            brought if sure else np.nan,
            float(pairs.energy_j[rows].sum()),
            float(pairs.approach_m_s[rows[0]]),
            float(pairs.parting_m_s[rows[-1]]),
            float(pairs.restitution[rows].max()),
        )

    def findings(self) -> Iterator[Finding]:
        """Yield each pair that gained energy."""
        for *both, episode in self._runs.most():
            movers = [number for number in both if self.scene.body(number).moving]
            if any(len(self.scene.touches.rows(number)) > 1 for number in movers):
                continue  # a third body may have given it
            number = movers[0]
            other = next(each for each in both if each != number)
            pushed = self.scene.body(number).client not in self._without_push
            message = Message(
                "contact of {body} with {other} adds {gained:.3g} J to {brought:.3g} J of motion: "
                "they come together at {approach:.4g} m/s and part at {parting:.4g} m/s; their "
                "restitution is {restitution:.3g}, and {why}",
                body=self.scene.body(number).label,
                other=self.scene.body(other).label,
                gained=episode.given_j,
                brought=episode.brought_j,
                approach=episode.approach_m_s,
                parting=episode.parting_m_s,
                restitution=episode.restitution,
                why=PUSHED if pushed else STEPPED,
            )
            yield Finding(
                code="energy-gained",
                level="broken",
                message=message,
                advice=LESS_PUSH if pushed else SHORTER,
                body=self.scene.body(number).label,
                other=self.scene.body(other).label,
                effect=Effect(episode.given_j, "J"),
                share=episode.given_j / episode.brought_j,
                steps=Span(episode.first, episode.last, episode.last - episode.first + 1),
                site=self.scene.asked.of["restitution"].site(number, other),
            )


def _kinetic_j(scene: Scene, number: int, step: int) -> float:
    """Return the kinetic energy of a body as a step began: 0 if it stands, nan with joints."""
    for _, steps in scene.stretches(number):
        at = np.flatnonzero(steps.steps == step)
        if len(at) and steps.law.tree.size == FREE:
            return float(energy_of(steps.law, steps.before.at(at), np.zeros((1, 3)))[0][0])
    return np.nan if number in scene.judged else 0.0
