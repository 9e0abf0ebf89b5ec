"""A drop in MuJoCo."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np

from drop_physics.engines.session import Numbers, PrimitiveShape, RigidBody
from drop_physics.physics.rotations import rotate, rotate_inverse
from drop_physics.scenario import Scenario

INTEGRATORS = {
    "euler": mujoco.mjtIntegrator.mjINT_EULER,
    "rk4": mujoco.mjtIntegrator.mjINT_RK4,
    "implicit": mujoco.mjtIntegrator.mjINT_IMPLICIT,
    "implicitfast": mujoco.mjtIntegrator.mjINT_IMPLICITFAST,
}
GEOMS = {
    "box": mujoco.mjtGeom.mjGEOM_BOX,
    "sphere": mujoco.mjtGeom.mjGEOM_SPHERE,
    "cylinder": mujoco.mjtGeom.mjGEOM_CYLINDER,
    "capsule": mujoco.mjtGeom.mjGEOM_CAPSULE,
}

if mujoco.get_mju_user_warning() is None:
    # MuJoCo would append its warnings to MUJOCO_LOG.TXT, in whatever folder this is.
    mujoco.set_mju_user_warning(lambda _: None)


class MujocoSession:
    """One free body above a plane."""

    def __init__(self, scenario: Scenario, body: RigidBody) -> None:
        spec = mujoco.MjSpec()
        spec.option.timestep = scenario.timestep_s
        spec.option.gravity = (0.0, 0.0, scenario.effective_gravity_m_s2)
        spec.option.integrator = INTEGRATORS[scenario.effective_integrator or "euler"]
        if scenario.solver_iterations is not None:
            spec.option.iterations = scenario.solver_iterations
        if scenario.solver_residual is not None:
            spec.option.tolerance = scenario.solver_residual
        free = spec.worldbody.add_body(name=body.name)
        free.add_freejoint()
        free.explicitinertial, free.mass, free.inertia = True, body.mass_kg, body.inertia_kg_m2
        surfaces = [free.add_geom(**_geom(shape)) for shape in body.shapes]
        if scenario.floor:
            plane = mujoco.mjtGeom.mjGEOM_PLANE
            surfaces.append(spec.worldbody.add_geom(type=plane, size=(0, 0, 1)))
        if scenario.friction is not None:
            for surface in surfaces:
                surface.friction[0] = scenario.friction
        self._model = spec.compile()
        self._data = data = mujoco.MjData(self._model)
        turned = np.array([scenario.orientation_xyzw])
        spin = rotate_inverse(turned, np.array([scenario.spin_rad_s]))[0]
        x, y, z, w = scenario.orientation_xyzw
        data.qpos[:] = 0.0, 0.0, scenario.height_m, w, x, y, z
        data.qvel[:] = *scenario.velocity_m_s, *spin
        bad = mujoco.mjtWarning
        self._unstable = data.warning.number[bad.mjWARN_BADQPOS : bad.mjWARN_BADQACC + 1]

    def step(self) -> None:
        """Take one timestep.

        Raises
        ------
        RuntimeError
            If a number is not finite, or over 1e10: MuJoCo has set all of them to 0, and goes on.
        """
        mujoco.mj_step(self._model, self._data)
        if any(self._unstable.tolist()):
            raise RuntimeError("MuJoCo has started again from 0")

    def state(self) -> Numbers:
        """Return position, orientation, velocity and spin, which the joint has in body axes."""
        px, py, pz, w, x, y, z = self._data.qpos.tolist()
        spin = rotate(np.array([[x, y, z, w]]), self._data.qvel[None, 3:])[0].tolist()
        return (px, py, pz, x, y, z, w, *self._data.qvel[:3].tolist(), *spin)

    def contacts(self) -> Iterator[Numbers]:
        """Yield the contact points of the last step; MuJoCo's normal points from geom 1 to 2."""
        force = np.zeros(6)
        for index in range(self._data.ncon):
            point = self._data.contact[index]
            mujoco.mj_contactForce(self._model, self._data, index, force)
            normal, first, second = point.frame.reshape(3, 3)
            sign = 1.0 if self._model.geom_bodyid[point.geom[1]] else -1.0
            yield (
                *point.pos,
                *point.pos,
                *(sign * normal),
                point.dist,
                force[0],
                force[1],
                *(sign * first),
                force[2],
                *(sign * second),
            )

    def reported(self) -> dict[str, Any]:
        """Return the values that the model holds."""
        model = self._model
        surface = model.geom_friction[:, 0]
        contact = {}
        if model.ngeom:
            contact = {
                "lateral_friction": float(surface[-1]),
                "solref": tuple(model.geom_solref[-1].tolist()),
                "solimp": tuple(model.geom_solimp[-1].tolist()),
            }
        floor = model.ngeom and not model.geom_bodyid[0]
        return contact | {
            "engine_version": mujoco.__version__,
            "timestep_s": float(model.opt.timestep),
            "gravity_m_s2": tuple(model.opt.gravity.tolist()),
            "solver_iterations": int(model.opt.iterations),
            "body_type": "free joint",
            "mass_kg": float(model.body_mass[1]),
            "inertia_kg_m2": tuple(model.body_inertia[1].tolist()),
            "floor_lateral_friction": float(surface[0]) if floor else None,
        }


def _geom(shape: PrimitiveShape) -> dict[str, Any]:
    """Return a shape in MuJoCo's terms: half a box's edges, half a cylinder's length."""
    a, b, c = shape.size_m
    x, y, z, w = shape.orientation
    size = (a / 2, b / 2, c / 2) if shape.kind == "box" else (a, b / 2, 0.0)
    return {
        "type": GEOMS[shape.kind],
        "size": size,
        "pos": shape.position_m,
        "quat": (w, x, y, z),
        "mass": 0.0,
    }
