"""Oracle: random arms and walkers under random commands, replayed in PyBullet alone.

The replay reads link poses, velocities and motor torques itself; energies and work are computed
from these here, by textbook formulas, and nothing of the analysis is used for them.
"""

from __future__ import annotations

import random
from pathlib import Path
from typing import Any

import numpy as np
import pybullet as p
import pytest
from clients import release_clients
from conftest import some
from drop_physics.analysis.explained.recording import explanation
from scenes import HEAD, record

CLOSES = 1e-9
"""Of the largest energy: sums of a hundred steps in double precision."""
ARMS = ("kuka_iiwa/model.urdf", "franka_panda/panda.urdf", "xarm/xarm6_robot.urdf")
WALKERS = ("mjcf/ant.xml", "quadruped/minitaur.urdf", "laikago/laikago_toes_zup_lores.urdf")
SCENE = """
look = globals().get("look", lambda: None)
p.setGravity(0, 0, {gravity})
p.loadURDF("plane.urdf")
r = {load}
moving = [j for j in range(p.getNumJoints(r)) if p.getJointInfo(r, j)[2] in (0, 1)]
ways = {{"position": (p.POSITION_CONTROL, "targetPosition"),
    "velocity": (p.VELOCITY_CONTROL, "targetVelocity"), "torque": (p.TORQUE_CONTROL, "force")}}
off = set()
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
"""


def scene_of(seed: int) -> str:
    """Return a robot and its commands: some steps a few joints get another one.

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
        [(rng.random(), rng.choice(ways), rng.uniform(-1, 1), rng.uniform(1, 80))
         for _ in range(rng.choice((0, 1, 2, 4)))]
        for _ in range(120)
    ]  # fmt: skip
    return SCENE.format(gravity=rng.uniform(-10, -1), load=load, commands=commands)


def replayed(scene: str) -> tuple[list[Any], list[float]]:
    """Run a scene in PyBullet alone; return all rates and efforts, and the robot's energy [J]."""
    joints: list[Any] = []
    energies: list[float] = []
    names: dict[str, Any] = {}

    def look() -> None:
        body = names["r"]
        links = range(p.getNumJoints(body))
        joints.append([])
        for j in names["moving"]:
            _, rate, _, effort = p.getJointState(body, j)
            # Of a motor that was switched off PyBullet goes on to report the last effort.
            joints[-1].append((rate, 0.0 if j in names["off"] else effort))
        parts = [(-1, *p.getBasePositionAndOrientation(body), *p.getBaseVelocity(body))]
        for j in links:
            state = p.getLinkState(body, j, computeLinkVelocity=1, computeForwardKinematics=1)
            parts.append((j, state[0], state[1], state[6], state[7]))
        total = 0.0
        for number, where, turned, velocity, spin in parts:
            mass, _, inertia, *_ = p.getDynamicsInfo(body, number)
            own = np.reshape(p.getMatrixFromQuaternion(turned), (3, 3)).T @ spin
            total += mass * np.dot(velocity, velocity) / 2 + np.dot(inertia, own**2) / 2
            total -= mass * names["gravity"] * where[2]
        energies.append(float(total))

    gravity = float(scene.split("setGravity(0, 0, ")[1].split(")")[0])
    names |= {"look": look, "gravity": gravity}
    release_clients()
    exec(HEAD + scene, names)
    p.disconnect()
    return joints, energies


@pytest.mark.parametrize("seed", some(range(24), 6))
def test_a_random_robot_is_explained_as_its_replay_moves(seed: int, tmp_path: Path) -> None:
    scene = scene_of(seed)
    seen = record(scene, tmp_path / "robot.rrd").seen
    joints, energies = replayed(scene)
    totals = explanation(seen).totals[1]
    motion = np.array(joints)
    rates, efforts = motion[..., 0], motion[1:, ..., 1]
    work_j = (efforts * (rates[1:] + rates[:-1]) / 2).sum() / 240
    largest = max(map(abs, totals.energy_j.values()))
    assert totals.changed_j == pytest.approx(energies[-1] - energies[0], abs=CLOSES * largest)
    assert sum(totals.energy_j.values()) == pytest.approx(totals.changed_j, abs=CLOSES * largest)
    assert totals.energy_j["motors"] == pytest.approx(work_j, abs=CLOSES * largest)
    assert totals.explained == totals.samples == 121
