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
springs that yield; sleeping bodies; delayed actuators; MuJoCo reset the simulation within the step;
the step used data derived from another state, with which its replay reaches the recorded state; the
reason is unknown; another engine made the step, and MuJoCo's step leads to another state."""
