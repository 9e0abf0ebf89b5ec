"""Ask a recorded scene a question: what its findings say."""

from __future__ import annotations

from pathlib import Path

from drop_physics.analysis.answers.answer import Finding
from drop_physics.analysis.story import findings_of
from scenes import ORIGIN, record


def findings(scene: str, path: Path, **origin: str) -> list[Finding]:
    """Record a scene (`scenes.record`), and return what is found in it, the gravest first."""
    recording = record(scene, path)
    return findings_of(recording.seen, {**ORIGIN, "ended": "finished", "error": None, **origin})


def codes(scene: str, path: Path) -> list[str]:
    """Return the codes of all findings, the gravest first."""
    return [each.code for each in findings(scene, path)]
