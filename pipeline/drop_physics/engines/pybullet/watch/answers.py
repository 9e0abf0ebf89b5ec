"""Picks numbers from what PyBullet's functions return, named as in `pybullet.reads`."""

from __future__ import annotations

from typing import Any

from ...watching.pipe import ANSWERS

POINTS = frozenset(("getContactPoints", "getClosestPoints"))
"""Functions that return contact points."""
DISTANCE, FORCE = 8, 9
"""Indices of distance and normal force in a contact point."""
NUMBERED = frozenset(
    (
        "getJointState",
        "getJointStates",
        "getLinkState",
        "getBasePositionAndOrientation",
        "getBaseVelocity",
        "calculateInverseKinematics",
        "calculateInverseDynamics",
        "rayTest",
    )
)
"""Functions whose first return values are kept; for a list, those of its first element."""
SINGLE = (int, float)


def numbers_in(name: str, answer: Any) -> list[float]:
    """Return the numbers to record from a function's return value, at most `ANSWERS`."""
    if name in POINTS:
        points = answer or ()
        if not points:
            return [0.0]
        forces = [point[FORCE] for point in points]
        return [len(points), forces[0], sum(forces), min(point[DISTANCE] for point in points)]
    return _flat(answer, []) if name in NUMBERED else []


def _flat(answer: Any, found: list[float]) -> list[float]:
    """Append the numbers in nested tuples to a list."""
    for each in answer:
        if len(found) >= ANSWERS:
            break
        if isinstance(each, SINGLE):
            found.append(each)
        elif isinstance(each, (tuple, list)):
            _flat(each, found)
    return found
