"""Poses, momentum and weight of MuJoCo's kinematic trees, computed independently of MuJoCo.

Verification: with the model's constants alone, everything is as MuJoCo computes it, to rounding.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from drop_physics.engines.mujoco.memory import constants_of
from mujoco_scripts import MACHINE
from mujoco_trees import MujocoTrees, product, turned

SHIPPED = Path(mujoco.__file__).parent / "testdata/model.xml"
"""A model that ships with mujoco, from a certain version on."""
ROUNDING = 1e-13
STEPS = 40

CRATES = "".join(
    f"""<body pos="{i} 0 1" euler="{10 * i} 5 0"><freejoint/>
    <inertial pos="0.01 0.02 {0.01 * i}" mass="{1 + i}" fullinertia="2 3 4 0.1 0.2 0.3"/>
    <body pos="0 0 0.2"><joint type="slide" axis="1 1 0" armature="0.1"/>
    <joint axis="0 1 0" pos="0 0.1 0" ref="0.3"/><geom size="0.1"/></body></body>"""
    for i in range(5)
)
"""Five kinematic trees of one structure, with two joints on one body."""
SPATIAL = """<mujoco><worldbody><site name="a"/><body pos="0 0 -1"><joint/><geom size="0.1"/>
<site name="b" pos="0.1 0 0"/></body></worldbody><tendon><spatial armature="1"><site site="a"/>
<site site="b"/></spatial></tendon></mujoco>"""
MODELS = {
    "machine": MACHINE,
    "crates": f"<mujoco><worldbody>{CRATES}</worldbody></mujoco>",
    "carried": """<mujoco><worldbody><body pos="1 0 0" euler="0 30 0"><geom size="0.1"/>
    <body pos="0 0 1"><joint axis="0 1 0"/><geom size="0.1" pos="0.2 0 0"/></body></body>
    <body mocap="true" pos="0 1 1" euler="20 0 0"><geom size="0.1"/></body></worldbody></mujoco>""",
}


def model_of(name: str) -> Any:
    """Return a model by name."""
    if name == "shipped":
        return mujoco.MjModel.from_xml_path(str(SHIPPED))
    return mujoco.MjModel.from_xml_string(MODELS[name])


@pytest.mark.parametrize("name", [*MODELS, *(["shipped"] if SHIPPED.exists() else [])])
def test_all_is_as_mujoco_computes_it(name: str) -> None:
    m = model_of(name)
    d = mujoco.MjData(m)
    m.opt.gravity[:] = 1.0, -2.0, -9.81
    m.opt.density = m.opt.viscosity = 0.0
    trees, rng = MujocoTrees(constants_of(m)), np.random.default_rng(0)
    qpos = np.zeros((STEPS, m.nq))
    velocity = rng.standard_normal((STEPS, m.nv))
    momentum, weight = np.zeros((2, STEPS, m.nv))
    positions, orientations = np.zeros((STEPS, m.nbody, 3)), np.zeros((STEPS, m.nbody, 4))
    mocap = rng.standard_normal((STEPS, m.nmocap, 3)), rng.standard_normal((STEPS, m.nmocap, 4))
    for step in range(STEPS):
        mujoco.mj_resetData(m, d)
        mujoco.mj_integratePos(m, d.qpos, 3 * rng.standard_normal(m.nv), 1.0)
        d.mocap_pos[:], d.mocap_quat[:] = mocap[0][step], mocap[1][step]
        mujoco.mj_forward(m, d)
        qpos[step], positions[step], orientations[step] = d.qpos, d.xpos, d.xquat
        mujoco.mj_mulM(m, d, momentum[step], velocity[step])
        weight[step] = -d.qfrc_bias  # nothing moves
    assert trees.is_complete
    found, turns = trees.poses(qpos, mocap)
    np.testing.assert_allclose(found, positions, atol=ROUNDING)
    turns = turns * np.sign((turns * orientations).sum(axis=2, keepdims=True))
    np.testing.assert_allclose(turns, orientations, atol=ROUNDING)
    np.testing.assert_allclose(
        trees.momentum(qpos, velocity, mocap), momentum, atol=ROUNDING * np.abs(momentum).max()
    )
    np.testing.assert_allclose(
        trees.weight(qpos, m.opt.gravity, mocap), weight, atol=ROUNDING * np.abs(weight).max()
    )


def test_trees_of_one_structure_are_one_batch() -> None:
    trees = MujocoTrees(constants_of(model_of("crates")))
    assert [len(kind.bodies) for kind in trees._kinds] == [5]


def test_inertia_of_a_tendon_through_space_is_not_known() -> None:
    assert not MujocoTrees(constants_of(mujoco.MjModel.from_xml_string(SPATIAL))).is_complete


def test_quaternions_multiply_and_turn() -> None:
    """A quarter turn about x, then one about z: y becomes z and stays, z becomes -y, then x."""
    half = np.sqrt(0.5)
    about_x, about_z = np.array([half, half, 0, 0]), np.array([half, 0, 0, half])
    both = product(about_z, about_x)
    np.testing.assert_allclose(turned(both, np.array([0.0, 1, 0])), [0, 0, 1], atol=1e-15)
    np.testing.assert_allclose(turned(both, np.array([0.0, 0, 1])), [1, 0, 0], atol=1e-15)
