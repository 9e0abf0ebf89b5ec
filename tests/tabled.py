"""Records a scene and returns the table of joints."""

from __future__ import annotations

from pathlib import Path

from drop_physics.account.joints import JointRow, JointTable
from drop_physics.explain.joints import DrivenJoints
from drop_physics.explain.recording import Explanation
from scenes import record


def rows(scene: str, path: Path, body: int = 0, *, steps: int = 0) -> dict[str, JointRow]:
    """Record a scene; return a body's joint table by name, spherical joints as NAME.AXIS."""
    seen = record(scene, path).seen
    table, joints = JointTable(), DrivenJoints(seen)
    for explained in Explanation(seen).pieces(steps):
        joints.add(explained)
        table.add(joints)
    return {
        each.name if each.axis is None else f"{each.name}.{each.axis}": each
        for each in table.rows(body)
    }
