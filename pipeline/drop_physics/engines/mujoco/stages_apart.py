"""Finds the first computation stage of a step that differs between two MuJoCo versions."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drop_physics.engines.mujoco.elements import Matched
from drop_physics.messages import Message
from drop_physics.trace.swaps import StageApart

Float64 = NDArray[np.float64]

ROUNDING = 1e-9
"""A difference up to this share of the largest number counts as rounding."""
STAGES = (
    *("kinematics", "collision", "constraint", "passive", "actuator", "bias", "solver"),
    "integrator",
)
ROW_KINDS = (
    *("equality", "joint friction", "tendon friction", "joint limit", "tendon limit", "contact"),
    *("contact", "contact"),
)
"""Types of constraint rows (`mjtConstraint`)."""
FORCES = {"passive": "qfrc_passive", "actuator": "qfrc_actuator", "bias": "qfrc_bias"}
FORCES |= {"solver": "qfrc_constraint"}
NUMBERS = {
    "dist": (Message("the distance of the same contact points"), 1),
    "pos": (Message("the position of the same contact points"), 3),
    "frame": (Message("the normal of the same contact points"), 3),
}
"""Quantities of a contact point: description, and number of components."""
TOLD = {
    "passive": Message("the passive forces"),
    "actuator": Message("the forces of actuators"),
    "bias": Message("the forces of motion"),
    "solver": Message("the constraint forces of the same rows"),
}
"""Descriptions of a stage's forces."""


@dataclass(frozen=True, eq=False)
class Computed:
    """Results of a step's stages: positions, contacts, forces and accelerations."""

    positions: Float64
    """Positions of the bodies [m], shape (bodies, 3)."""
    geoms: Float64
    """The two geoms of each contact, shape (n, 2)."""
    points: Mapping[str, Float64]
    """Contact quantities: `dist`, `pos`, `frame`."""
    rows: Mapping[str, Float64]
    """Constraint row quantities: `pos`, `aref`, `R`, `type`."""
    forces: Mapping[str, Float64]

    @classmethod
    def of(cls, stages: Mapping[str, list[Float64]], row: int) -> Computed:
        """Return the results of one of many computed steps, by its row."""
        geoms = stages["geoms"][row].reshape(-1, 2)
        return cls(
            stages["xpos"][row].reshape(-1, 3),
            geoms,
            {name: stages[name][row].reshape(-1, width) for name, (_, width) in NUMBERS.items()},
            {name: stages[f"efc_{name}"][row] for name in ("pos", "aref", "R", "type")},
            {name: stages[name][row] for name in FORCES.values()},
        )


def stages_apart(
    mine: Computed, theirs: Computed, matched: Matched
) -> tuple[StageApart, StageApart | None]:
    """Return the first stage that differs at all, and the first that differs beyond rounding."""
    found = sorted(_found(mine, theirs, matched), key=lambda each: STAGES.index(each.stage))
    found = found or [StageApart("integrator", 0.0, Message("the velocities"))]
    return found[0], next((each for each in found if each.size > ROUNDING), None)


def _found(mine: Computed, theirs: Computed, matched: Matched) -> Iterator[StageApart]:
    bodies = matched.pairs("body")
    a, b = (np.array([body[side] for body in bodies], np.int64) for side in (0, 1))
    if (size := _size(mine.positions[a], theirs.positions[b])) is not None:
        yield StageApart("kinematics", size, Message("the positions of bodies"))
    yield from _collisions(mine, theirs, matched)
    yield from _rows(mine, theirs)
    dofs = matched.pairs("dof")
    a, b = (np.array([dof[side] for dof in dofs], np.int64) for side in (0, 1))
    for stage, name in FORCES.items():
        if (size := _size(mine.forces[name][a], theirs.forces[name][b])) is not None:
            yield StageApart(stage, size, TOLD[stage])


def _size(mine: Float64, theirs: Float64) -> float | None:
    """Return the largest difference relative to the largest number; None if bitwise equal."""
    if mine.shape != theirs.shape:
        return np.inf
    if mine.tobytes() == theirs.tobytes():
        return None
    scale = max(float(np.abs(mine).max()), 1e-300)
    return float(np.abs(mine - theirs).max()) / scale


def _collisions(mine: Computed, theirs: Computed, matched: Matched) -> Iterator[StageApart]:
    other = {j: i for i, j in matched.pairs("geom")}
    points = [
        _by_pair(mine, {}),
        _by_pair(theirs, other),
    ]
    elements = matched.a
    for pair in sorted(points[0].keys() | points[1].keys()):
        known = all(0 <= each < elements.count("geom") for each in pair)
        names = tuple(elements.label("geom", each) if known else f"{each}" for each in pair)
        bodies = [elements.body_label("geom", each) for each in pair] if known else []
        told = (names[0], names[1]), tuple(filter(None, bodies))
        a, b = points[0].get(pair, []), points[1].get(pair, [])
        if len(a) != len(b):
            what = Message("{a} → {b} contact points", a=len(a), b=len(b))
            yield StageApart("collision", np.inf, what, *told)
            continue
        for name, (word, _) in NUMBERS.items():
            if (size := _size(mine.points[name][a], theirs.points[name][b])) is not None:
                yield StageApart("collision", size, word, *told)


def _by_pair(computed: Computed, other: Mapping[int, int]) -> dict[tuple[int, int], list[int]]:
    """Return each geom pair's contacts, by index, with the geoms numbered as in the first model."""
    found: dict[tuple[int, int], list[int]] = {}
    for row, pair in enumerate(computed.geoms.astype(np.int64).tolist()):
        low, high = sorted(other.get(geom, -2 - geom) if other else geom for geom in pair)
        found.setdefault((low, high), []).append(row)
    return found


def _rows(mine: Computed, theirs: Computed) -> Iterator[StageApart]:
    kinds = mine.rows["type"]
    if kinds.tobytes() != theirs.rows["type"].tobytes():
        counts = len(kinds), len(theirs.rows["type"])
        what = Message("{a} → {b} rows of constraints", a=counts[0], b=counts[1])
        yield StageApart("constraint", np.inf, what)
        return
    for kind in np.unique(kinds).astype(np.int64).tolist():
        its = kinds == kind
        for name in ("pos", "aref", "R"):
            if (size := _size(mine.rows[name][its], theirs.rows[name][its])) is not None:
                what = Message("{name} of the rows of {kind}", name=name, kind=ROW_KINDS[kind])
                yield StageApart("constraint", size, what)
