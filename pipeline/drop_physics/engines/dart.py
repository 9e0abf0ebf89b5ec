"""A drop in DART.

With its ODE collision detector: DART's own finds one point for a box on a plane, and has no
capsules. Sleeping is disabled.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from importlib.metadata import version
from typing import Any

import dartpy
import numpy as np

from drop_physics.engines.session import (
    Numbers,
    PrimitiveShape,
    RigidBody,
    Session,
    force_of_point,
)
from drop_physics.option_types import Quaternion
from drop_physics.physics.rotations import matrix
from drop_physics.scenario import Scenario

FARTHEST_M = 5e8
"""Distance from the origin [m] at which ODE's collision detector aborts: 2^29, as measured."""
SHAPES: dict[str, Callable[..., Any]] = {
    "box": lambda a, b, c: dartpy.dynamics.BoxShape((a, b, c)),
    "sphere": lambda radius, *_: dartpy.dynamics.SphereShape(radius),
    "cylinder": lambda radius, length, _: dartpy.dynamics.CylinderShape(radius, length),
    "capsule": lambda radius, length, _: dartpy.dynamics.CapsuleShape(radius, length),
}


class DartSession(Session):
    """One free body above a plane."""

    def __init__(self, scenario: Scenario, body: RigidBody) -> None:
        self._world = world = dartpy.simulation.World()
        world.setTimeStep(scenario.timestep_s)
        world.setGravity((0.0, 0.0, scenario.effective_gravity_m_s2))
        world.setCollisionDetector(dartpy.simulation.CollisionDetectorType.ODE)
        sleep = world.getDeactivationOptions()
        sleep.mEnabled = False
        world.setDeactivationOptions(sleep)
        skeleton = dartpy.dynamics.Skeleton(body.name)
        self._joint, self._node = skeleton.createFreeJointAndBodyNodePair()
        inertia = np.diag(body.inertia_kg_m2)
        self._node.setInertia(dartpy.dynamics.Inertia(body.mass_kg, np.zeros(3), inertia))
        for axis in range(3, 6):  # force per speed
            rate = body.mass_kg * (scenario.linear_damping or 0.0)
            self._joint.setDampingCoefficient(axis, rate)
        self._surfaces = [_attached(self._node, shape) for shape in body.shapes]
        turn = _rotation_vector(scenario.orientation_xyzw)
        self._joint.setPositions([*turn, 0.0, 0.0, scenario.height_m])
        self._joint.setVelocities([*scenario.spin_rad_s, *scenario.velocity_m_s])
        world.addSkeleton(skeleton)
        self._floor = None
        if scenario.floor:
            ground = dartpy.dynamics.Skeleton("floor")
            _, node = ground.createWeldJointAndBodyNodePair()
            plane = node.createShapeNode(dartpy.dynamics.PlaneShape([0.0, 0.0, 1.0], 0.0))
            plane.createCollisionAspect()
            self._floor = plane.createDynamicsAspect()
            world.addSkeleton(ground)
        for surface in (*self._surfaces, *[self._floor] * scenario.floor):
            if scenario.friction is not None:
                surface.setFrictionCoeff(scenario.friction)
            if scenario.restitution is not None:
                surface.setRestitutionCoeff(scenario.restitution)

    def step(self) -> None:
        """Take one timestep.

        Raises
        ------
        RuntimeError
            If the body is so far away that the collision detector would abort.
        """
        if not (np.abs(self._joint.getPositions()[3:]) < FARTHEST_M).all():
            raise RuntimeError("the body is too far away")
        self._world.step()

    def state(self) -> Numbers:
        """Return position, orientation, velocity and spin; DART stores a rotation vector."""
        at, moving = self._joint.getPositions(), self._joint.getVelocities()
        angle = float(np.sqrt(at[:3] @ at[:3]))
        scale = np.sin(angle / 2) / angle if angle else 0.5
        x, y, z = (at[:3] * scale).tolist()
        return (*at[3:].tolist(), x, y, z, float(np.cos(angle / 2)), *moving[3:], *moving[:3])

    def contacts(self) -> Iterator[Numbers]:
        """Yield the contact points of the last step, as detected at its beginning."""
        for point in self._world.getLastCollisionResult().getContacts():
            first = point.collisionObject1.getShapeFrame().asShapeNode().getBodyNodePtr()
            sign = 1.0 if first == self._node else -1.0
            depth_m = float(point.penetrationDepth)
            yield force_of_point(point.point, sign * point.normal, -depth_m, sign * point.force)

    def reported(self) -> dict[str, Any]:
        """Return the values that the world holds."""
        inertia, own = self._node.getInertia(), next(iter(self._surfaces), None)
        floor = self._floor
        return {
            "engine_version": version("dartpy"),
            "timestep_s": self._world.getTimeStep(),
            "gravity_m_s2": tuple(self._world.getGravity().tolist()),
            "body_type": "FreeJoint",
            "mass_kg": inertia.getMass(),
            "inertia_kg_m2": tuple(np.diag(inertia.getMoment()).tolist()),
            "lateral_friction": own and own.getFrictionCoeff(),
            "restitution": own and own.getRestitutionCoeff(),
            "floor_lateral_friction": floor and floor.getFrictionCoeff(),
            "floor_restitution": floor and floor.getRestitutionCoeff(),
        }


def _attached(node: Any, shape: PrimitiveShape) -> Any:  # noqa: ANN401 - the library is untyped
    """Add a shape to a body, and return its surface."""
    part = node.createShapeNode(SHAPES[shape.kind](*shape.size_m))
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = matrix(shape.orientation), shape.position_m
    part.setRelativeTransform(dartpy.math.Isometry3(pose))
    part.createCollisionAspect()
    return part.createDynamicsAspect()


def _rotation_vector(orientation: Quaternion) -> list[float]:
    """Return axis times angle of a unit quaternion x, y, z, w."""
    *axis, w = orientation
    sine = math.hypot(*axis)
    scale = 2 * math.atan2(sine, w) / sine if sine else 0.0
    return [part * scale for part in axis]
