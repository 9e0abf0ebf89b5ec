"""Golden recordings on another processor: the tolerances that docs/ci.md states.

The GNU C library's sines and cosines round otherwise where a processor cannot multiply and add in
one step. It can be told that ours cannot, so that one machine stands for both. Elsewhere than on
Linux with that library nothing changes, and these tests say nothing.
"""

from __future__ import annotations

from pathlib import Path

import pytest
from drop_physics.stages.check import Check, check
from drop_physics.stages.record import record_script

pytestmark = pytest.mark.long

WITHOUT_FMA = "glibc.cpu.hwcaps=-AVX2,-FMA,-AVX512F,-FMA4"
HEAD = """
import pybullet as p, pybullet_data
p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
def steps(count):
    for _ in range(count):
        p.stepSimulation()
"""
ALONE = {
    "in the air": """
b = p.loadURDF("cube_small.urdf", [0, 0, 50])
p.resetBaseVelocity(b, [1, 0, 3], [3, 4, 5])
steps(480)
""",
    "on the floor": """
p.loadURDF("plane.urdf")
b = p.loadURDF("cube_small.urdf", [0, 0, 0.5], [0.1, 0.2, 0.3, 0.9])
p.resetBaseVelocity(b, [1, 0, 0], [3, 4, 5])
steps(480)
""",
}
COUPLED = {
    "a pile": """
p.loadURDF("plane.urdf")
for i in range(4):
    p.loadURDF("cube_small.urdf", [0.01 * i, 0, 0.03 + 0.06 * i])
steps(480)
""",
    "an arm": """
a = p.loadURDF("franka_panda/panda.urdf", useFixedBase=True)
for i in range(240):
    for j in range(7):
        p.setJointMotorControl2(a, j, p.POSITION_CONTROL, i / 480, force=87)
    p.stepSimulation()
""",
}


def both(tmp_path: Path, scene: str, monkeypatch: pytest.MonkeyPatch, **how: float) -> Check:
    """Return the check of a scene run without fused multiply-add against the same run with it."""
    script = tmp_path / "scene.py"
    script.write_text(HEAD + scene)
    record_script(str(script), out=tmp_path / "with.rrd")
    with monkeypatch.context() as patched:
        patched.setenv("GLIBC_TUNABLES", WITHOUT_FMA)
        record_script(str(script), out=tmp_path / "without.rrd")
    return check(tmp_path / "without.rrd", tmp_path / "with.rrd", **how)


@pytest.mark.parametrize("name", ALONE)
def test_a_body_alone_moves_the_same_to_the_bit(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert both(tmp_path, ALONE[name], monkeypatch).same


@pytest.mark.parametrize("name", COUPLED)
def test_bodies_in_contact_and_robots_differ_by_rounding(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = both(tmp_path, COUPLED[name], monkeypatch, tolerance_m=1e-12)
    assert found.same
