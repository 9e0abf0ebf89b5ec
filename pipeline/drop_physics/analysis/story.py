"""From a recording to the verdict: every body explained, then every question answered."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from drop_physics.analysis.answers.answer import Finding, Scene
from drop_physics.analysis.answers.every import ANSWERS, ranked
from drop_physics.analysis.explained.recording import Explained, Explanation
from drop_physics.analysis.joints import JointTable
from drop_physics.analysis.times import Times
from drop_physics.analysis.touches import TouchTable
from drop_physics.seen.history import Seen


class Story:
    """Goes through a recording once."""

    def __init__(self, seen: Seen, origin: Mapping[str, Any]) -> None:
        clients = {each.client for each in seen.settings}
        self.explanation = Explanation(seen)
        self.scene = Scene(
            seen=seen,
            origin=origin,
            times={client: Times(seen, client) for client in clients},
            joints=JointTable(seen),
            touches=TouchTable(seen),
        )
        self._answers = [question(self.scene) for question in ANSWERS]

    def see(self, explained: Explained) -> None:
        """Take a piece."""
        self.scene.joints.add(explained)
        self.scene.touches.add(explained)
        for answer in self._answers:
            answer.see(explained)

    def findings(self) -> list[Finding]:
        """Return what the answers found, the gravest first, after the last piece."""
        return ranked(each for answer in self._answers for each in answer.findings())


def findings_of(seen: Seen, origin: Mapping[str, Any]) -> list[Finding]:
    """Return what the answers find in a whole recording."""
    story = Story(seen, origin)
    for explained in story.explanation.pieces():
        story.see(explained)
    return story.findings()
