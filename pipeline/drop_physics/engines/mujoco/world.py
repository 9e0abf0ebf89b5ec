"""The world of a simulated drop in MuJoCo: builds the scenario's model, and reads its states.

`described` provides bodies and states, `held` the softness of contacts. Contact forces are MuJoCo's
own, to the last bit, for each point and tangent; the replay of a script provides only sums over
each pair of geoms.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from drop_physics.arrays import Float64
from drop_physics.engines.mujoco.described import base_of, described, reported_of
from drop_physics.engines.mujoco.held import softness_of
from drop_physics.engines.mujoco.memory import constants_of
from drop_physics.engines.mujoco.unlogged import write_no_log
from drop_physics.engines.rigid_body import PrimitiveShape, RigidBody
from drop_physics.physics.rotations import rotate_inverse
from drop_physics.scenario import Scenario

Numbers = tuple[float, ...]

write_no_log()


class MujocoSession:
    """One free body above a plane in MuJoCo."""

    def __init__(self, scenario: Scenario, body: RigidBody) -> None:
        spec = mujoco.MjSpec()
        spec.option.timestep = scenario.timestep_s
        spec.option.gravity = (0.0, 0.0, scenario.effective_gravity_m_s2)
        spec.option.integrator = getattr(
            mujoco.mjtIntegrator, f"mjINT_{str(scenario.effective_integrator).upper()}"
        )
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
        self._arrays = constants_of(self._model)
        self._bodies = described(self._arrays, client=0, first=0, folder=Path()).bodies
        self._data = data = mujoco.MjData(self._model)
        turned = np.array([scenario.orientation_xyzw])
        spin = rotate_inverse(turned, np.array([scenario.spin_rad_s]))[0]
        x, y, z, w = scenario.orientation_xyzw
        data.qpos[:] = 0.0, 0.0, scenario.height_m, w, x, y, z
        data.qvel[:] = *scenario.velocity_m_s, *spin
        bad = mujoco.mjtWarning
        self._unstable = data.warning.number[bad.mjWARN_BADQPOS : bad.mjWARN_BADQACC + 1]

    def step(self) -> None:
        """Make one timestep.

        Raises
        ------
        RuntimeError
            If a coordinate is not finite, or above 1e10: MuJoCo then resets the state to 0 and
            continues.
        """
        mujoco.mj_step(self._model, self._data)
        if any(self._unstable.tolist()):
            raise RuntimeError("MuJoCo has started again from 0")

    def state(self) -> Numbers:
        """Return positions and velocities in the order of MuJoCo's `qpos` and `qvel`."""
        return (*self._data.qpos.tolist(), *self._data.qvel.tolist())

    def motions(self, states: Float64) -> Float64:
        """Return the motions of the centre of mass, in world axes, shape (n, 13).

        A motion is position, orientation x y z w, velocity and spin. They are exactly the engine's,
        except for the spin: it is rotated from MuJoCo's body axes, which rounds it.
        """
        qpos, qvel = np.hsplit(states, [self._model.nq])
        return base_of(self._arrays, self._bodies[-1], qpos, qvel, unit=True)

    def contacts(self) -> Iterator[Numbers]:
        """Yield the contact points of the last step; MuJoCo's normal points from geom 1 to 2.

        Each point has the fields of `states.CONTACT` from `position_a_m` on. The body is side a, on
        which the forces act.
        """
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
        """Return the compiled model's mass, inertia and other fields of an `EngineReport`."""
        arrays, contact = self._arrays, {}
        told = reported_of(arrays, self._bodies[-1])
        if self._model.ngeom:
            friction = arrays["geom_friction"][:, 0].tolist()
            solref, solimp = softness_of(arrays, 0, len(friction) - 1)
            contact = {"lateral_friction": friction[-1], "solref": solref, "solimp": solimp}
            contact |= {"floor_lateral_friction": friction[0]} if self._bodies[1:] else {}
        return contact | {
            "engine_version": mujoco.__version__,
            "timestep_s": float(arrays["opt.timestep"]),
            "gravity_m_s2": tuple(arrays["opt.gravity"].tolist()),
            "solver_iterations": int(arrays["opt.iterations"]),
            "body_type": "free joint",
            "mass_kg": float(told["mass_kg"][0]),
            "inertia_kg_m2": tuple(told["inertia_kg_m2"][0].tolist()),
        }


def _geom(shape: PrimitiveShape) -> dict[str, Any]:
    """Return a shape as MuJoCo's geom attributes: half a box's edges, half a cylinder's length."""
    a, b, c = shape.size_m
    x, y, z, w = shape.orientation
    return {
        "type": getattr(mujoco.mjtGeom, f"mjGEOM_{shape.kind.upper()}"),
        "size": (a / 2, b / 2, c / 2) if shape.kind == "box" else (a, b / 2, 0.0),
        "pos": shape.position_m,
        "quat": (w, x, y, z),
        "mass": 0.0,
    }
