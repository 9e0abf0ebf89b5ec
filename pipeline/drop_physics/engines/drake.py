"""A drop in Drake.

Contact is compliant (hydroelastic) against a rigid half space: with point contact, Drake has one
point per pair of shapes, and a box sinks in. Spheres use point contact.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterator
from importlib.metadata import version
from typing import Any

import numpy as np
from pydrake.geometry import (
    AddCompliantHydroelasticProperties,
    AddContactMaterial,
    AddRigidHydroelasticProperties,
    Box,
    Capsule,
    Cylinder,
    HalfSpace,
    ProximityProperties,
    Sphere,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import AddMultibodyPlant, CoulombFriction, MultibodyPlantConfig
from pydrake.multibody.tree import QuaternionFloatingJoint, RotationalInertia, SpatialInertia
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import DiagramBuilder

from drop_physics.engines.session import (
    Numbers,
    PrimitiveShape,
    RigidBody,
    Session,
    force_of_point,
)
from drop_physics.physics.rotations import matrix
from drop_physics.scenario import Scenario

MODULUS_PA = 1e7
"""Hydroelastic modulus of a compliant shape: Drake's default."""
FRICTION = 1.0
"""Friction of a compliant surface, for which Drake has no default; for rigid ones it is 1."""
SHAPES: dict[str, Callable[..., Any]] = {
    "box": Box,
    "sphere": lambda radius, *_: Sphere(radius),
    "cylinder": lambda radius, length, _: Cylinder(radius, length),
    "capsule": lambda radius, length, _: Capsule(radius, length),
}
UP = np.array([0.0, 0.0, 1.0])


class DrakeSession(Session):
    """One free body above a half space."""

    def __init__(self, scenario: Scenario, body: RigidBody) -> None:
        logging.getLogger("drake").setLevel(logging.ERROR)
        self._timestep_s, self._steps = scenario.timestep_s, 0
        discrete = scenario.effective_integrator == "discrete"
        builder = DiagramBuilder()
        self._plant, self._scene = AddMultibodyPlant(
            MultibodyPlantConfig(
                time_step=scenario.timestep_s if discrete else 0.0,
                contact_model="hydroelastic_with_fallback",
            ),
            builder,
        )
        plant = self._plant
        plant.mutable_gravity_field().set_gravity_vector(
            (0.0, 0.0, scenario.effective_gravity_m_s2)
        )
        moments = RotationalInertia(*body.inertia_kg_m2)
        inertia = SpatialInertia.MakeFromCentralInertia(body.mass_kg, np.zeros(3), moments)
        self._body = plant.AddRigidBody("body", inertia)
        drag = body.mass_kg * (scenario.linear_damping or 0.0)  # force per speed
        frames = plant.world_frame(), self._body.body_frame()
        plant.AddJoint(QuaternionFloatingJoint("free", *frames, 0.0, drag))
        self._friction = FRICTION if scenario.friction is None else scenario.friction
        for number, shape in enumerate(body.shapes):
            pose = RigidTransform(RotationMatrix(matrix(shape.orientation)), shape.position_m)
            plant.RegisterCollisionGeometry(
                self._body,
                pose,
                SHAPES[shape.kind](*shape.size_m),
                f"shape{number}",
                self._surface(shape),
            )
        if scenario.floor:
            plant.RegisterCollisionGeometry(
                plant.world_body(), RigidTransform(), HalfSpace(), "floor", self._surface(None)
            )
        plant.Finalize()
        self._simulator = Simulator(builder.Build())
        if not discrete:
            config = SimulatorConfig(max_step_size=scenario.timestep_s)
            ApplySimulatorConfig(config, self._simulator)
        self._context = plant.GetMyContextFromRoot(self._simulator.get_mutable_context())
        x, y, z, w = scenario.orientation_xyzw
        plant.SetPositions(self._context, [w, x, y, z, 0.0, 0.0, scenario.height_m])
        plant.SetVelocities(self._context, [*scenario.spin_rad_s, *scenario.velocity_m_s])
        self._simulator.Initialize()

    def _surface(self, shape: PrimitiveShape | None) -> ProximityProperties:
        """Return the contact properties of a shape, or of the floor."""
        surface = ProximityProperties()
        friction = CoulombFriction(self._friction, self._friction)
        AddContactMaterial(friction=friction, properties=surface)
        if shape is None:
            AddRigidHydroelasticProperties(properties=surface)
        elif shape.kind != "sphere":  # a sphere's mesh would be coarse
            finest_m = min(size for size in shape.size_m if size > 0) / 4
            AddCompliantHydroelasticProperties(finest_m, MODULUS_PA, surface)
        return surface

    def step(self) -> None:
        """Take one timestep: to exactly this product, or Drake takes one too many or too few."""
        self._steps += 1
        self._simulator.AdvanceTo(self._steps * self._timestep_s)

    def state(self) -> Numbers:
        """Return position, orientation, velocity and spin.

        Drake's discrete step lets the quaternion grow; it is normalised here.
        """
        at = self._plant.GetPositions(self._context)
        moving = self._plant.GetVelocities(self._context).tolist()
        w, x, y, z = (at[:4] / math.hypot(*at[:4])).tolist()
        return (*at[4:].tolist(), x, y, z, w, *moving[3:], *moving[:3])

    def contacts(self) -> Iterator[Numbers]:
        """Yield the contact points of the last step.

        A contact patch is one point, its centre, with depth 0: Drake reports none.
        """
        results = self._plant.get_contact_results_output_port().Eval(self._context)
        for index in range(results.num_point_pair_contacts()):
            info = results.point_pair_contact_info(index)
            pair = info.point_pair()
            sign = 1.0 if info.bodyB_index() == self._body.index() else -1.0
            yield force_of_point(
                info.contact_point(),
                -sign * pair.nhat_BA_W,
                -pair.depth,
                sign * info.contact_force(),
            )
        for index in range(results.num_hydroelastic_contacts()):
            info = results.hydroelastic_contact_info(index)
            surface = info.contact_surface()
            frame = self._scene.model_inspector().GetFrameId(surface.id_M())
            first = self._plant.GetBodyFromFrameId(frame).index() == self._body.index()
            force_n = (1.0 if first else -1.0) * info.F_Ac_W().translational()
            yield force_of_point(surface.centroid(), UP, 0.0, force_n)

    def reported(self) -> dict[str, Any]:
        """Return the values that the plant holds."""
        plant = self._plant
        inertia = self._body.CalcSpatialInertiaInBodyFrame(self._context)
        return {
            "engine_version": version("drake"),
            "timestep_s": plant.time_step() or self._timestep_s,
            "gravity_m_s2": tuple(plant.gravity_field().gravity_vector().tolist()),
            "body_type": "QuaternionFloatingJoint",
            "mass_kg": inertia.get_mass(),
            "inertia_kg_m2": tuple(inertia.CalcRotationalInertia().get_moments().tolist()),
            "modulus_pa": MODULUS_PA,
            "lateral_friction": self._friction,
            "floor_lateral_friction": self._friction,
        }
