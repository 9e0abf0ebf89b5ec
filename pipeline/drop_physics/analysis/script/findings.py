"""Findings: the common mistakes and surprises that a script's recording reveals.

Each finding says what was seen, with the number, why it is so, and the one call that changes it. A
false finding is worse than a missing one: each rests on the recording alone.
"""

from __future__ import annotations

from drop_physics.analysis.script import (
    contact_findings,
    joint_findings,
    motion_findings,
    setting_findings,
)
from drop_physics.analysis.script.evidence import Evidence
from drop_physics.analysis.script.results import ScriptFinding


def findings_of(evidence: Evidence) -> list[ScriptFinding]:
    """Return the findings: on the whole recording first, then on its bodies."""
    return [
        *setting_findings.findings(evidence),
        *motion_findings.findings(evidence),
        *contact_findings.findings(evidence),
        *joint_findings.findings(evidence),
    ]
