"""Outcomes of a replayed step, and reasons why a step may have no explanation."""

from __future__ import annotations

EXPLAINED, REPLAYED, OTHER = 0, 1, 2
"""Outcomes: the sum closes; the recorded state is reached without a sum; another state is reached.
"""
REASONS = (
    *("", "remainder", "nothing moves", "integrator", "version", "flex", "plugin", "plastic"),
    *("sleep", "delay", "auto-reset", "stale", "unknown"),
    "another engine",
)
"""Why a step is not explained: the sum leaves a remainder; there is no degree of freedom; no sum is
implemented for the integrator; this version of MuJoCo was not tested; deformable bodies; plugins;
springs that yield; sleeping bodies; delayed actuators; MuJoCo has reset itself within the step; the
step used data of another state, which were found to lead to the recorded one; none of these;
another engine made the step, and MuJoCo leads to another state."""
