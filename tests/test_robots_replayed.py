"""Oracle: random arms and walkers under random commands, read with PyBullet's calls as they run.

The scene itself reads link poses, velocities and motor torques; energies and work are computed from
these here, by textbook formulas, and nothing of the analysis is used for them. They are of the run
that is recorded, since another is not always the same: of 120 runs of one ant by PyBullet alone, 60
in each of two processes, 8 moved otherwise from step 104 or 106 on.
"""

from __future__ import annotations

import json
import random
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import some
from numpy.typing import NDArray
from scenes import explanation, record

CLOSES = 1e-9
"""Tolerance relative to the largest energy: sums over a hundred steps in double precision."""
ARMS = ("kuka_iiwa/model.urdf", "franka_panda/panda.urdf", "xarm/xarm6_robot.urdf")
WALKERS = ("mjcf/ant.xml", "quadruped/minitaur.urdf", "laikago/laikago_toes_zup_lores.urdf")
SCENE = """
import json
p.setGravity(0, 0, {gravity})
p.loadURDF("plane.urdf")
r = {load}
links = range(p.getNumJoints(r))
moving = [j for j in links if p.getJointInfo(r, j)[2] in (0, 1)]
ways = {{"position": (p.POSITION_CONTROL, "targetPosition"),
    "velocity": (p.VELOCITY_CONTROL, "targetVelocity"), "torque": (p.TORQUE_CONTROL, "force")}}
off, joints, parts = set(), [], []
def look():
    states = zip(moving, p.getJointStates(r, moving))
    # Of a motor that was switched off PyBullet goes on to report the last effort.
    joints.append([(state[1], 0.0 if j in off else state[3]) for j, state in states])
    here = [(*p.getBasePositionAndOrientation(r), *p.getBaseVelocity(r))]
    here += [(each[0], each[1], each[6], each[7])
        for each in p.getLinkStates(r, links, computeLinkVelocity=1, computeForwardKinematics=1)]
    parts.append([[*where, *turned, *velocity, *spin] for where, turned, velocity, spin in here])
look()
for given in {commands}:
    for share, way, value, force in given:
        j = moving[int(share * len(moving))]
        mode, name = ways[way]
        off.discard(j)
        if way == "torque":
            off.add(j)
            p.setJointMotorControl2(r, j, p.VELOCITY_CONTROL, force=0)
        p.setJointMotorControl2(r, j, mode, **{{"force": force, name: value}})
    p.stepSimulation()
    look()
bodies = [p.getDynamicsInfo(r, j) for j in (-1, *links)]
with open({out!r}, "w") as file:
    json.dump([joints, parts, [(each[0], *each[2]) for each in bodies], {gravity}], file)
"""


def scene_of(seed: int, out: Path) -> str:
    """Return a robot scene in which a few joints get a new command every few steps; writes `out`.

    Before a torque a joint's motor is switched off; a target switches it on again.
    """
    rng = random.Random(seed)
    file = (ARMS, WALKERS)[seed % 2][seed // 2 % 3]
    if file.endswith("xml"):
        load = f"p.loadMJCF({file!r})[0]"
    else:
        where = f"[0, 0, {rng.uniform(0.4, 0.7)}]" if seed % 2 else "useFixedBase=True"
        load = f"p.loadURDF({file!r}, {where})"
    ways = ("position", "velocity", "torque")
    commands = [
        [
            (rng.random(), rng.choice(ways), rng.uniform(-1, 1), rng.uniform(1, 80))
            for _ in range(rng.choice((0, 1, 2, 4)))
        ]
        for _ in range(120)
    ]
    return SCENE.format(gravity=rng.uniform(-10, -1), load=load, commands=commands, out=str(out))


def energies_of(parts: NDArray[np.float64], bodies: NDArray[np.float64], gravity: float) -> Any:
    """Return Σ m v²/2 + ω·Iω/2 - m g z of samples [J]; each part has shape (links, 13)."""
    x, y, z, w = np.moveaxis(parts[..., 3:7], -1, 0)
    axes = np.stack(
        [  # the columns of the rotation matrix
            [1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)],
            [2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)],
            [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    own = np.einsum("cast,sta->stc", axes, parts[..., 10:13])
    mass, inertia = bodies[:, 0], bodies[:, 1:]
    moving = mass * (parts[..., 7:10] ** 2).sum(axis=-1) + (inertia * own**2).sum(axis=-1)
    return (moving / 2 - mass * gravity * parts[..., 2]).sum(axis=-1)


@pytest.mark.parametrize("seed", some(range(24), 6))
def test_a_random_robot_is_explained_as_pybullet_says_it_moves(seed: int, tmp_path: Path) -> None:
    seen = record(scene_of(seed, tmp_path / "read.json"), tmp_path / "robot.rrd").seen
    read = json.loads((tmp_path / "read.json").read_text())
    motion, parts, bodies, gravity = map(np.array, read)
    energies = energies_of(parts, bodies, gravity)
    totals = explanation(seen).totals[1]
    rates, efforts = motion[..., 0], motion[1:, ..., 1]
    work_j = (efforts * (rates[1:] + rates[:-1]) / 2).sum() / 240
    largest = max(map(abs, totals.energy_j.values()))
    assert totals.changed_j == pytest.approx(energies[-1] - energies[0], abs=CLOSES * largest)
    assert sum(totals.energy_j.values()) == pytest.approx(totals.changed_j, abs=CLOSES * largest)
    assert totals.energy_j["motors"] == pytest.approx(work_j, abs=CLOSES * largest)
    assert totals.explained == totals.samples == 121
