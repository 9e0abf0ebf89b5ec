"""Record a scene and return its findings."""

from __future__ import annotations

from pathlib import Path

from drop_physics.analysis.story import Story
from drop_physics.engines.cures import call_of
from drop_physics.rules.answer import Finding
from drop_physics.trace.history import Seen
from scenes import ORIGIN, record

COMPLETE = {**ORIGIN, "ended": "finished", "error": None}
"""Metadata of a script that ran to its end."""


def findings(scene: str, path: Path, **origin: str) -> list[Finding]:
    """Record a scene (`scenes.record`), and return its findings, most severe first."""
    return told_whole(record(scene, path).seen, **origin)


def told_whole(seen: Seen, **origin: str) -> list[Finding]:
    """Return a recording's findings, analyzed as a single chunk."""
    return Story(seen, COMPLETE | origin, call_of=call_of(seen.engine)).analysis().findings


def codes(scene: str, path: Path) -> list[str]:
    """Return the codes of all findings, most severe first."""
    return [finding.code for finding in findings(scene, path)]


def told_in_pieces(seen: Seen, **origin: str) -> list[Finding]:
    """Return a recording's findings, analyzed in ten chunks."""
    story = Story(seen, COMPLETE | origin, call_of=call_of(seen.engine))
    steps = max(7, max(seen.samples.values()) // 10)
    for piece in story.explanation.pieces(steps):
        story.see(piece)
    return story.findings()


def found(scene: str, folder: Path, code: str) -> list[Finding]:
    """Record a scene in a folder, and return its findings of one code."""
    return [each for each in findings(scene, folder / "scene.rrd") if each.code == code]


def in_pieces(scene: str, folder: Path, code: str) -> list[Finding]:
    """Return a scene's findings of one code, computed from the recording chunk by chunk."""
    said = told_in_pieces(record(scene, folder / "pieces.rrd").seen)
    return [each for each in said if each.code == code]
