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
"""All thresholds by the names of their constants."""


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
COASTS_RAD_S = _of(
    "COASTS_RAD_S",
    1e-2,
    "rad/s",
    "Least rate at which a joint without a motor coasts.",
    "crane_drift",
)
COASTS_STEPS = _of(
    "COASTS_STEPS",
    10,
    "1",
    "Least number of steps in which a joint does not do what its file or a call asks.",
    "crane_drift, spherical",
)
SCALE = _of(
    "SCALE",
    2,
    "1",
    "A body scaled by less, up or down, keeps its mass to within a factor of eight.",
    "tiny_and_heavy",
)
FRAME_APART_M = _of(
    "FRAME_APART_M",
    1e-3,
    "m",
    "Least distance of a centre of mass from its file's origin that a reset must heed.",
    "base_com",
)
LEFT_M = _of("LEFT_M", 1e-2, "m", "Least way of a body that has left its place.", "mass_for_all")
EACH_STEP = _of(
    "EACH_STEP", 0.9, "share", "Least share of the steps that are each step.", "float_off_edge"
)
FALLS_STEPS = _of(
    "FALLS_STEPS",
    5,
    "1",
    "Least number of steps in flight before which a velocity was set.",
    "float_off_edge",
)
HALF_THE_STEPS = _of(
    "HALF_THE_STEPS",
    0.5,
    "share",
    "Least share of the steps from the first call on in which a pose is set step by step.",
    "reset_joint_each",
)
DEEP_M = _of(
    "DEEP_M", 1e-3, "m", "Least overlap that a contact alone does not allow.", "reset_joint_each"
)
OVERLAPS_STEPS = _of(
    "OVERLAPS_STEPS", 5, "1", "Least number of steps with such an overlap.", "reset_joint_each"
)
SAME_GAP = _of(
    "SAME_GAP",
    0.05,
    "share",
    "Largest change of the gap between a body and the targets set from it.",
    "lift_by_constraint",
)
STALE_M = _of(
    "STALE_M",
    1e-3,
    "m",
    "Least way of a link in one step that its stale pose is off.",
    "link_stale",
)
APART = _of(
    "APART",
    0.05,
    "share",
    "Least distance of the points that a constraint joins, over the smaller body's size.",
    "apart",
)
APART_RAD = _of(
    "APART_RAD",
    0.05,
    "rad",
    "Least angle between the frames that a constraint joins.",
    "constraint_turned",
)
CLOSES = _of(
    "CLOSES",
    0.5,
    "share",
    "Largest share of that gap that is left within ten steps: a spring leaves more.",
    "spring_constraint",
)
