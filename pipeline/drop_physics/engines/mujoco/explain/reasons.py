"""Outcomes of a repeated step, and reasons for a missing sum."""

from __future__ import annotations

EXPLAINED, REPLAYED, OTHER = 0, 1, 2
"""Outcomes: the sum closes; the recorded state is reached without a sum; another state is reached.
"""
REASONS = (
    *("", "remainder", "nothing moves", "integrator", "version", "flex", "plugin", "plastic"),
    *("sleep", "delay", "auto-reset", "stale", "unknown"),
    "another engine",
)
"""Why a step is not explained: the sum leaves something; there is no degree of freedom; the
integrator has no sum here; this version's law was not tested; deformable bodies; plugins; springs
that yield; sleeping bodies; delayed actuators; MuJoCo has reset itself within it; it was taken with
data of another state, which were found to lead to the recorded one; none of these; another engine
has made it, and MuJoCo leads elsewhere."""
