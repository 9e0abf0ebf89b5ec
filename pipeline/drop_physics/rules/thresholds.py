"""All thresholds of the rules in one table: value, unit, what it limits, and what needs it."""

from __future__ import annotations

from typing import NamedTuple


class Threshold(NamedTuple):
    """A number that decides whether a rule holds."""

    value: float
    unit: str
    """`share` of what the meaning names; `1` of a count."""
    meaning: str
    """What it limits, as a sentence."""
    evidence: str
    """The corpus case or measurement that needs it."""


TABLE: dict[str, Threshold] = {}
"""By the name of the constant."""


def _of(name: str, value: float, unit: str, meaning: str, evidence: str) -> float:
    TABLE[name] = Threshold(value, unit, meaning, evidence)
    return value


AT_TARGET_RAD = _of(
    "AT_TARGET_RAD",
    1e-2,
    "rad",
    "A joint closer to its target is there.",
    "0.01 rad is half a degree",
)
AT_TARGET_M = _of(
    "AT_TARGET_M", 1e-3, "m", "A sliding joint closer to its target is there.", "a gripper's finger"
)
BEYOND_RANGE = _of(
    "BEYOND_RANGE",
    0.01,
    "share",
    "Least share of a joint's range by which a target lies beyond it.",
    "limits that files round",
)
OTHER_FORCE = _of(
    "OTHER_FORCE",
    0.01,
    "share",
    "A force that differs by less from the one that was given is that force.",
    "rounding of impulses",
)
CROSSINGS = _of(
    "CROSSINGS",
    3,
    "1",
    "Least number of steps in which a joint passes its target.",
    "a joint that passes it once or twice overshoots for another reason",
)
