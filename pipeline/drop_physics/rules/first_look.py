"""What is read from each body as it is in its first step, and what its file says of its links."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator

from drop_physics.explain.steps import Steps
from drop_physics.physics.tree import BASE, RATES, Tree
from drop_physics.rules.answer import Answer, Finding, Scene
from drop_physics.trace.events import Body, FileLink


class FirstLook(Answer):
    """A rule of bodies as they came."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._seen: set[int] = set()
        self.found: list[Finding] = []

    def see(self) -> None:
        """Look at the bodies that have their first step in this piece."""
        for judged, steps in self.scene.stretches():
            if judged.body.number not in self._seen:
                self._seen.add(judged.body.number)
                if len(judged.body.links) == steps.law.tree.links + 1:
                    self.look(judged.body, steps)

    @abstractmethod
    def look(self, body: Body, steps: Steps) -> None:
        """Look at a body; `steps` begin with its first one."""

    def findings(self) -> Iterator[Finding]:
        """Yield what was found of each body."""
        yield from self.found


def moving_links(tree: Tree) -> list[int]:
    """Return the links whose mass a step depends on: those that can move."""
    moves = [not tree.fixed]
    for link, parent in enumerate(tree.parents):
        moves.append(moves[parent + 1] or RATES[tree.joints[link]] > 0)
    return [link for link in range(BASE, tree.links) if moves[link + 1]]


def told_links(body: Body, tree: Tree) -> dict[int, FileLink]:
    """Return what the file says of the links that can move, as far as it tells."""
    told = {each.name: each for each in body.asked.links}
    return {
        link: told[body.links[link + 1]]
        for link in moving_links(tree)
        if body.links[link + 1] in told
    }
