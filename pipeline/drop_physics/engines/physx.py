"""A drop in PhysX 5, on the processor, through SAPIEN; its numbers are float32. Nothing sleeps."""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Iterator, Sequence
from importlib.metadata import version
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drop_physics.engines.session import (
    Numbers,
    PrimitiveShape,
    RigidBody,
    Session,
    force_of_point,
)
from drop_physics.scenario import Scenario

with warnings.catch_warnings():  # about Vulkan, which is not used here
    warnings.simplefilter("ignore")
    import sapien
    from sapien import physx

X_TO_Z = (0.5, -0.5, -0.5, -0.5)
"""Rotation w, x, y, z: PhysX's planes face x, and its cylinders have their axis along x."""


class PhysxSession(Session):
    """One free body above a plane."""

    def __init__(self, scenario: Scenario, body: RigidBody) -> None:
        config = physx.PhysxSceneConfig()
        config.gravity = np.array((0.0, 0.0, scenario.effective_gravity_m_s2), dtype=np.float32)
        physx.set_scene_config(config)  # for systems created from here on
        self._system = physx.PhysxCpuSystem()
        self._system.timestep = scenario.timestep_s
        self._scene = sapien.Scene([self._system])
        own = physx.get_default_material()
        friction = (own.static_friction, own.dynamic_friction)
        if scenario.friction is not None:
            friction = (scenario.friction,) * 2
        restitution = own.restitution if scenario.restitution is None else scenario.restitution
        self._material = physx.PhysxMaterial(*friction, restitution)
        self._body = moving = physx.PhysxRigidDynamicComponent()
        for shape in body.shapes:
            moving.attach(self._shape(shape))
        moving.mass, moving.cmass_local_pose = body.mass_kg, sapien.Pose()
        moving.inertia = body.inertia_kg_m2
        if scenario.linear_damping is not None:
            moving.linear_damping = scenario.linear_damping
        if scenario.angular_damping is not None:
            moving.angular_damping = scenario.angular_damping
        if scenario.solver_iterations is not None:
            moving.solver_position_iterations = scenario.solver_iterations
        moving.sleep_threshold = 0.0
        x, y, z, w = _settled(scenario.orientation_xyzw)
        self._add(moving, sapien.Pose((0.0, 0.0, scenario.height_m), (w, x, y, z)))
        moving.linear_velocity, moving.angular_velocity = scenario.velocity_m_s, scenario.spin_rad_s
        if scenario.floor:
            ground = physx.PhysxRigidStaticComponent()
            ground.attach(physx.PhysxCollisionShapePlane(self._material))
            self._add(ground, sapien.Pose((0.0, 0.0, 0.0), X_TO_Z))
        self._has_floor = scenario.floor

    def _shape(self, shape: PrimitiveShape) -> physx.PhysxCollisionShape:
        x, y, z, w = shape.orientation
        pose, (a, b, c) = sapien.Pose(shape.position_m, (w, x, y, z)), shape.size_m
        if shape.kind == "box":
            part = physx.PhysxCollisionShapeBox(np.array((a, b, c)) / 2, self._material)
        elif shape.kind == "sphere":
            part = physx.PhysxCollisionShapeSphere(a, self._material)
        else:
            kind = getattr(physx, f"PhysxCollisionShape{shape.kind.title()}")
            part = kind(a, b / 2, self._material)
            pose = pose * sapien.Pose((0.0, 0.0, 0.0), X_TO_Z)
        part.local_pose = pose
        return part

    def _add(self, component: physx.PhysxRigidBaseComponent, pose: sapien.Pose) -> None:
        entity = sapien.Entity()
        entity.add_component(component)
        entity.set_pose(pose)
        self._scene.add_entity(entity)

    def step(self) -> None:
        """Take one timestep."""
        self._system.step()

    def state(self) -> Numbers:
        """Return position, orientation, velocity and spin: float32, widened."""
        pose = self._body.entity_pose
        w, x, y, z = _wide(pose.q)
        moving = _wide(self._body.linear_velocity), _wide(self._body.angular_velocity)
        return (*_wide(pose.p), x, y, z, w, *moving[0], *moving[1])

    def contacts(self) -> Iterator[Numbers]:
        """Yield the contact points of the last step; SAPIEN reports no friction.

        PhysX looks ahead: a point above the floor has no force yet.
        """
        for pair in self._system.get_contacts():
            sign = 1.0 if pair.bodies[0] == self._body else -1.0
            for point in pair.points:
                normal = sign * np.array(_wide(point.normal))
                force_n = sign * np.array(_wide(point.impulse)) / self._system.timestep
                position_m = np.array(_wide(point.position))
                yield force_of_point(position_m, normal, float(point.separation), force_n)

    def reported(self) -> dict[str, Any]:
        """Return the values that the system holds."""
        body, material = self._body, self._material
        surface = {
            "lateral_friction": float(material.dynamic_friction),
            "restitution": float(material.restitution),
        }
        floor = {f"floor_{name}": value for name, value in surface.items()}
        floor["combined_restitution"] = surface["restitution"]  # their mean
        return (
            surface
            | (floor if self._has_floor else {})
            | {
                "engine_version": version("sapien"),
                "timestep_s": float(self._system.timestep),
                "gravity_m_s2": tuple(_wide(self._system.config.gravity)),
                "solver_iterations": int(body.solver_position_iterations),
                "body_type": "PxRigidDynamic",
                "mass_kg": float(body.mass),
                "inertia_kg_m2": tuple(_wide(body.inertia)),
            }
        )


def _wide(values: Any) -> list[float]:  # noqa: ANN401 - float32 to float64, which is exact
    wide: list[float] = np.asarray(values, dtype=np.float64).tolist()
    return wide


def _settled(orientation: Sequence[float]) -> list[float]:
    """Return the nearest quaternion that PhysX leaves unchanged when it normalises it."""
    unit = _normalised(np.array(orientation, dtype=np.float32))
    for ulps in sorted(itertools.product((0, -1, 1, -2, 2), repeat=4), key=_size):
        near = unit + np.array(ulps, dtype=np.float32) * np.spacing(unit)
        if np.array_equal(_normalised(near), near):
            return _wide(near)
    return _wide(unit)


def _size(ulps: Sequence[int]) -> int:
    return sum(map(abs, ulps))


def _normalised(quaternion: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return a quaternion as PhysX normalises it, in float32."""
    x, y, z, w = quaternion
    norm: np.float32 = np.sqrt(x * x + y * y + z * z + w * w)
    return quaternion * (np.float32(1) / norm)
