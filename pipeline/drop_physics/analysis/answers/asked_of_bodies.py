"""Which calls set a property of bodies, and how large bodies are."""

from __future__ import annotations

import numpy as np

from drop_physics.analysis.answers.answer import Scene, site_of
from drop_physics.analysis.explained.recording import Explained
from drop_physics.seen.calls import Meanings
from drop_physics.seen.events import Body


class AskedOfBodies:
    """The last `changeDynamics` of each body that set one of some properties."""

    def __init__(self, scene: Scene, *names: str) -> None:
        self._scene, self._names = scene, {*names}
        self._sites: dict[int, str] = {}
        self.values: dict[int, float] = {}
        """By the number of a body: the greatest that a call set."""
        self.since: dict[int, int] = {}
        """After which step it was set first."""
        self.changed: set[int] = set()
        """Bodies of which calls set different values, one after the other."""

    def see(self, explained: Explained) -> None:
        """Take a piece."""
        meanings = Meanings(explained.piece.calls, self._scene.seen.appearances)
        for call, _, came in meanings.of_bodies("changeDynamics"):
            values, number = call.values, came.body.number
            for name in self._names & values.keys():
                self._sites[number] = site_of(call)
                value = float(values[name][0])
                self.since.setdefault(number, call.at.step)
                if value != self.values.get(number, value):
                    self.changed.add(number)
                self.values[number] = max(self.values.get(number, value), value)

    def site(self, body: int) -> str | None:
        """Return file and line of that call."""
        return self._sites.get(body)


def edges_m(body: Body) -> list[float]:
    """Return the edges of the boxes around its links, the shortest first, as it was added."""
    boxes = np.reshape(body.bounds_m, (-1, 2, 3))
    return sorted(np.ravel(boxes[:, 1] - boxes[:, 0]).tolist()) or [1.0]


def size_m(body: Body) -> float:
    """Return the longest edge of the box around a body, as it was added; 1 if it is unknown."""
    return max(edges_m(body)[-1], 1e-9)
