"""Drive MuJoCo directly, with none of our code, as a reference for the tests."""

from __future__ import annotations

import mujoco
import numpy as np

XML = """
<mujoco>
  <option timestep="{timestep_s}" gravity="0 0 {gravity_m_s2}" integrator="{integrator}"/>
  <worldbody>
    <geom type="plane" size="0 0 1" solref="{solref} 1"/>
    <body pos="0 0 {height_m}">
      <freejoint/>
      <inertial pos="0 0 0" mass="{mass_kg}" diaginertia="{inertia}"/>
      <geom type="box" size="{half}" mass="0" solref="{solref} 1"/>
    </body>
  </worldbody>
</mujoco>
"""


def drive(
    *,
    steps: int,
    timestep_s: float = 1 / 240,
    gravity_m_s2: float = -9.81,
    height_m: float = 1.0,
    velocity_m_s: tuple[float, float, float] = (0.0, 0.0, 0.0),
    spin_rad_s: tuple[float, float, float] = (0.0, 0.0, 0.0),
    mass_kg: float = 0.1,
    inertia_kg_m2: tuple[float, float, float] = (1.25e-4, 1.25e-4, 1.25e-4),
    edges_m: tuple[float, float, float] = (0.05, 0.05, 0.05),
    integrator: str = "Euler",
    solref: float = 0.02,
) -> np.ndarray:
    """Return position, orientation x y z w, velocity and spin in body axes, shape (steps + 1, 13).

    From a release that is not turned.
    """
    xml = XML.format(
        timestep_s=repr(timestep_s),
        gravity_m_s2=repr(gravity_m_s2),
        height_m=repr(height_m),
        mass_kg=repr(mass_kg),
        inertia=" ".join(map(repr, inertia_kg_m2)),
        integrator=integrator,
        half=" ".join(repr(edge / 2) for edge in edges_m),
        solref=repr(solref),
    )
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    data.qvel[:3], data.qvel[3:] = velocity_m_s, spin_rad_s
    rows = []
    for step in range(steps + 1):
        if step:
            mujoco.mj_step(model, data)
        rows.append(np.concatenate((data.qpos[[0, 1, 2, 4, 5, 6, 3]], data.qvel)))
    return np.array(rows)
