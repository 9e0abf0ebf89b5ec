"""Ask a recorded scene a question: what its findings say."""

from __future__ import annotations

from pathlib import Path

from drop_physics.analysis.story import Story
from drop_physics.engines.cures import call_of
from drop_physics.rules.answer import Finding
from drop_physics.trace.history import Seen
from scenes import ORIGIN, record

COMPLETE = {**ORIGIN, "ended": "finished", "error": None}
"""What is said of a script that came to its end."""


def findings(scene: str, path: Path, **origin: str) -> list[Finding]:
    """Record a scene (`scenes.record`), and return what is found in it, the gravest first."""
    return told_whole(record(scene, path).seen, **origin)


def told_whole(seen: Seen, **origin: str) -> list[Finding]:
    """Return the findings of a recording."""
    return Story(seen, COMPLETE | origin, call_of=call_of(seen.engine)).analysis().findings


def codes(scene: str, path: Path) -> list[str]:
    """Return the codes of all findings, the gravest first."""
    return [finding.code for finding in findings(scene, path)]


def told_in_pieces(seen: Seen, **origin: str) -> list[Finding]:
    """Return the findings of a recording that is read in ten pieces, of seven steps at least."""
    story = Story(seen, COMPLETE | origin, call_of=call_of(seen.engine))
    steps = max(7, max(seen.samples.values()) // 10)
    for piece in story.explanation.pieces(steps):
        story.see(piece)
    return story.findings()


def found(scene: str, folder: Path, code: str) -> list[Finding]:
    """Record a scene in a folder, and return the findings of one code."""
    return [each for each in findings(scene, folder / "scene.rrd") if each.code == code]


def in_pieces(scene: str, folder: Path, code: str) -> list[Finding]:
    """Return the same where the recording comes in pieces."""
    said = told_in_pieces(record(scene, folder / "pieces.rrd").seen)
    return [each for each in said if each.code == code]
