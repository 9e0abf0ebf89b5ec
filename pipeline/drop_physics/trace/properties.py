"""Determines which link PyBullet's `changeDynamics` really changes: the named one, or the base.

PyBullet sends one link index with all properties of a call, and each of the setters overwrites it:
most with the named link, some with the base. So the last setter decides for all properties (bullet3
#3314, #4133; `pybullet_changeDynamicsInfo` in `pybullet.c` for the order,
`b3ChangeDynamicsInfoSet…` in `PhysicsClientC_API.cpp` for the link). Measured with PyBullet 3.2.7
(`tests/test_bullet_calls.py`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from drop_physics.physics.tree import BASE
from drop_physics.trace.acts import Act

NAMED, TO_BASE = True, False
ORDER: Mapping[str, bool] = {
    "jointLimitForce": NAMED,
    "jointLowerLimit": NAMED,
    "mass": NAMED,
    "anisotropicFriction": NAMED,
    "localInertiaDiagonal": NAMED,
    "lateralFriction": NAMED,
    "spinningFriction": NAMED,
    "rollingFriction": NAMED,
    "linearDamping": TO_BASE,
    "angularDamping": TO_BASE,
    "jointDamping": NAMED,
    "restitution": NAMED,
    "contactStiffness": NAMED,
    "frictionAnchor": NAMED,
    "ccdSweptSphereRadius": NAMED,
    "activationState": TO_BASE,
    "contactProcessingThreshold": NAMED,
    "maxJointVelocity": TO_BASE,
    "collisionMargin": TO_BASE,
}
"""The setters in PyBullet's order, by argument, and whether each writes the index of the named
link.

The setter of `sleepThreshold` writes no index.
"""
PROPERTIES = ORDER.keys() | {"jointUpperLimit", "contactDamping", "sleepThreshold"}
"""All properties that a call of `changeDynamics` can set."""
OF_BODIES = frozenset(
    ("linearDamping", "angularDamping", "maxJointVelocity", "activationState", "sleepThreshold")
)
"""Properties that a btMultiBody has only once: they are set whichever link a call names."""
OF_JOINTS = frozenset(("jointDamping", "jointLowerLimit", "jointUpperLimit", "jointLimitForce"))
"""Properties that a base does not have: they are lost if a call reaches the base."""
REPORTED: Mapping[str, str] = {
    "mass": "mass_kg",
    "lateralFriction": "lateral_friction",
    "localInertiaDiagonal": "inertia_kg_m2",
    "restitution": "restitution",
    "rollingFriction": "rolling_friction",
    "spinningFriction": "spinning_friction",
    "contactDamping": "contact_damping",
    "contactStiffness": "contact_stiffness",
    "collisionMargin": "collision_margin_m",
}
"""Arguments whose value `getDynamicsInfo` reports, with the property's name in a recording.

`getJointInfo` and `getConstraintInfo` are not used: they return values cached in the client, so
limits and damping of a joint stay those of its file.
"""
REPORTED_SETTINGS: Mapping[str, str] = {
    "timeStep": "fixedTimeStep",
    "gravX": "gravityAccelerationX",
    "gravY": "gravityAccelerationY",
    "gravZ": "gravityAccelerationZ",
    "enableRealTimeSimulation": "useRealTimeSimulation",
}
"""Names in `getPhysicsEngineParameters` of arguments that have another name there."""
SETTERS = Act.SET_GRAVITY, Act.SET_TIMESTEP, Act.SET_REAL_TIME, Act.SET_ENGINE
"""Acts of the calls that set these engine settings."""
VECTORS = frozenset(("anisotropicFriction", "localInertiaDiagonal"))
"""Arguments that PyBullet passes on whatever their values are."""


def takes(name: str, values: Mapping[str, Sequence[float]]) -> bool:
    """Return whether PyBullet passes the given value of an argument on to the engine.

    PyBullet treats negative numbers as not given, and so a lower limit without an upper limit at
    least as high.
    """
    if name not in values:
        return False
    if name in ("jointLowerLimit", "jointUpperLimit"):
        lower, upper = values.get("jointLowerLimit", (1.0,)), values.get("jointUpperLimit", (-1.0,))
        return lower[0] <= upper[0]
    return name in VECTORS or (len(values[name]) > 0 and values[name][0] >= 0)


def link_reached(values: Mapping[str, Sequence[float]]) -> int:
    """Return the link whose properties a call really changes, from its numeric arguments.

    The base is -1. If no argument has a setter, the named link is returned.
    """
    named = int(first) if math.isfinite(first := values.get("linkIndex", (BASE,))[0]) else BASE
    setters = [to_named for name, to_named in ORDER.items() if takes(name, values)]
    return named if not setters or setters[-1] == NAMED else BASE


def arrives(name: str, named: int, reached: int) -> bool:
    """Return whether a property that PyBullet accepts reaches the link that the call names."""
    if name in OF_BODIES:
        return True
    return named == reached and not (name in OF_JOINTS and reached == BASE)
