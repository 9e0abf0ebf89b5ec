"""Capsules of MJCF files are drawn where PyBullet has them, which only bounding boxes reveal."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pybullet as p
import pytest
from conftest import Drop
from drop_physics.engines.pybullet.watch.bodies import plain
from drop_physics.engines.pybullet.watch.capsules import CAPSULES, KIND, LINK, UNKNOWN, lay
from engine import DATA
from numpy.typing import NDArray

MARGIN_M = 0.04
"""Margin of capsules given from point to point, which are shapes of two spheres: their bounding box
is that much larger."""


@pytest.mark.parametrize("name", ["ant", "humanoid", "hopper", "walker2d", "swimmer", "reacher"])
def test_a_capsule_lies_where_its_box_is(name: str) -> None:
    client, path = p.connect(p.DIRECT), DATA / f"mjcf/{name}.xml"
    compared = 0
    try:
        for body in p.loadMJCF(str(path), physicsClientId=client):
            joints = range(p.getNumJoints(body, client))
            names = [p.getBodyInfo(body, client)[0]]
            names += [p.getJointInfo(body, joint, client)[12] for joint in joints]
            shapes = plain(p.getVisualShapeData(body, 0, client))
            lay(shapes, plain(names), str(path))
            for link in (-1, *joints):
                its = [shape for shape in shapes if shape[LINK] == link]
                if its and all(shape[KIND] == 7 for shape in its):
                    drawn, real = box_of(its, body, link, client), p.getAABB(body, link, client)
                    assert drawn == pytest.approx(np.array(real), abs=1e-6)
                    compared += 1
    finally:
        p.disconnect(client)
    assert compared >= 2


def box_of(shapes: list[Any], body: int, link: int, client: int) -> NDArray[np.float64]:
    """Return the corners of the bounding box around capsules, (2, 3), as the engine computes it."""
    if link < 0:
        inertial = p.getDynamicsInfo(body, -1, client)[3:5]
        base = p.getBasePositionAndOrientation(body, client)
        position, orientation = p.multiplyTransforms(*base, *p.invertTransform(*inertial))
    else:
        position, orientation = p.getLinkState(body, link, False, True, client)[4:6]
    corners = []
    for shape in shapes:
        length, radius, _ = shape[3]
        along = np.array(p.rotateVector(shape[6], (0, 0, length / 2)))
        wide = np.abs(along) + radius + MARGIN_M
        corners += [np.array(shape[5]) + sign * wide for sign in (-1, 1)]
    low, high = np.min(corners, axis=0), np.max(corners, axis=0)
    turned = np.reshape(p.getMatrixFromQuaternion(orientation), (3, 3))
    middle, half = position + turned @ (low + high) / 2, np.abs(turned) @ (high - low) / 2
    return np.array([middle - half, middle + half])


def test_how_the_capsule_of_a_body_without_a_name_lies_is_not_known(
    drop: Drop, tmp_path: Path
) -> None:
    leg = '<geom type="capsule" size=".1" fromto="0 0 0 1 0 0"/>'
    (tmp_path / "leg.xml").write_text(f"<mujoco><worldbody><body>{leg}</body></worldbody></mujoco>")
    (tmp_path / "leg.py").write_text(
        "import pybullet as p\np.connect(p.DIRECT)\np.loadMJCF('leg.xml')\np.stepSimulation()\n"
    )
    done = drop("record", "leg.py")
    assert "a shape of 0_leg is not drawn" in done.stderr
    (tmp_path / "leg.xml").write_text(
        f'<mujoco><worldbody><body name="leg">{leg}</body></worldbody></mujoco>'
    )
    assert "not drawn" not in drop("record", "--force", "leg.py").stderr


@pytest.mark.parametrize("ends", ["0 0 0", "1 1 1 1 1 1", "0 0 0 1 0 x", ""])
def test_ends_that_are_none_leave_a_capsule_as_it_is(tmp_path: Path, ends: str) -> None:
    path = tmp_path / "leg.xml"
    path.write_text(f'<mujoco><body name="leg"><geom fromto="{ends}"/></body></mujoco>')
    shapes = [[0, -1, 7, [0.0, 0.1, 0.0], "", [0.0] * 3, [0.0, 0.0, 0.0, 1.0]]]
    before = [list(shape) for shape in shapes]
    lay(shapes, ["leg"], str(path))
    assert shapes == before


def test_nothing_is_turned_but_what_stands_in_the_middle() -> None:
    turned = [0.0, 0.0, 0.6, 0.8]
    shapes = [[0, -1, kind, [1.0, 0.1, 0.0], "", [0.0] * 3, turned] for kind in CAPSULES]
    lay(shapes, ["leg"], None)
    assert all(shape[KIND] != UNKNOWN and shape[6] == turned for shape in shapes)
