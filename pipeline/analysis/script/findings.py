"""What a script's recording gives away: the mistakes and surprises that people ask about.

Each finding says what was seen, with the number, why it is so, and the one call that changes it. A
false one is worse than one that is missing: each rests on what was recorded, and on nothing else.
"""

from __future__ import annotations

from pipeline.analysis.script import (
    contact_findings,
    joint_findings,
    motion_findings,
    setting_findings,
)
from pipeline.analysis.script.evidence import Evidence
from pipeline.analysis.script.results import ScriptFinding


def findings_of(evidence: Evidence) -> list[ScriptFinding]:
    """Return what a recording gives away: of the whole first, then of its bodies."""
    return [
        *setting_findings.findings(evidence),
        *motion_findings.findings(evidence),
        *contact_findings.findings(evidence),
        *joint_findings.findings(evidence),
    ]
