"""Converts descriptions of bodies, sent by a script's process, into bodies of the recording."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from pathlib import PurePath
from typing import Any

import numpy as np

from drop_physics.arrays import Float64
from drop_physics.engines.pybullet.watch.naming import KINDS, name_of
from drop_physics.trace.events import (
    Body,
    Collision,
    FileDamping,
    FileLink,
    FileRequests,
    Joint,
    Mimic,
    Shape,
)
from drop_physics.trace.states import BASE

PLANES = ("plane.obj", "plane100.obj")
"""Meshes of pybullet_data that represent a plane, up to 200 m wide, white except for a texture."""
JOINT_KINDS = {0: "revolute", 1: "prismatic", 2: "spherical", 3: "planar", 4: "fixed"}
FIXED = 4
ENABLE_SLEEPING = 1 << 11
"""Load flag that enables sleeping: URDF_ENABLE_SLEEPING."""
RIGID = 1
"""Body type of a btRigidBody, for which `getDynamicsInfo` leaves some numbers uninitialised."""

REPORTED = (
    ("mass_kg", True), ("lateral_friction", True), ("inertia_kg_m2", True),
    ("inertial_position_m", False), ("inertial_orientation", False), ("restitution", False),
    ("rolling_friction", True), ("spinning_friction", True), ("contact_damping", False),
    ("contact_stiffness", False), ("kind", True), ("collision_margin_m", True),
)  # fmt: skip
"""The values of `getDynamicsInfo` in order, and whether each is valid for a btRigidBody."""


class Numbering:
    """Assigns ids to the bodies of a recording; the same body, loaded after a reset, keeps its id.

    After a reset, a body with the same id, name and structure counts as the same body.
    """

    def __init__(self) -> None:
        self._numbers: dict[object, int] = {}

    def described(self, client: int, dynamics: list[Any], note: dict[str, Any]) -> Body:
        """Convert the description of a body that the script has just loaded."""
        joints = _joints(note)
        shapes = shapes_of(note["visual"], dynamics, note["inertial"])
        collisions = _collisions(note["collisions"])
        name = name_of(
            note["file"],
            note["name"],
            *(collision.kind for collision in collisions or shapes),
            note["base"],
        )
        links = (note["base"] or "base", *(info[12] for info in note["joints"]))
        make_up = (
            client,
            note["id"],
            note["name"],
            links,
            note["soft"],
            tuple(
                (joint.name, joint.kind, joint.parent, joint.widths, joint.limits)
                for joint in joints
            ),
            tuple((shape.link, shape.kind, shape.file) for shape in shapes),
        )
        number = self._numbers.get(make_up)
        if number is None:
            taken = self._numbers.values()
            number = note["id"] if note["id"] not in taken else max(taken) + 1
            self._numbers[make_up] = number
        return Body(
            number,
            f"{number}_{name}",
            note["file"] or note["name"] or name,
            note["id"],
            client,
            links,
            joints,
            moving_links(dynamics[0][0] != 0, note["joints"]),
            note["soft"],
            shapes,
            bool(note["flags"] & ENABLE_SLEEPING),
            note["hides_links"],
            tuple(note["bounds"]),
            collisions,
            _asked(note),
            note["flags"],
            note["before"],
        )


def _joints(note: dict[str, Any]) -> tuple[Joint, ...]:
    widths = iter([tuple(counts) for counts in note["joint_widths"]])
    return tuple(
        joint_of(info, info[1], (0, 0, 0) if info[2] == FIXED else next(widths))
        for info in note["joints"]
    )


def joint_of(info: Sequence[Any], name: str, widths: tuple[int, int, int]) -> Joint:
    """Convert a result of `getJointInfo` into a joint of the recording."""
    return Joint(
        info[0],
        name,
        JOINT_KINDS.get(info[2], str(info[2])),
        info[16],
        widths,
        (info[8], info[9]),
        tuple(info[13]),
        tuple(info[14]),
        tuple(info[15]),
        info[6],
        info[7],
        info[10],
        info[11],
    )


def _collisions(listed: Iterable[Sequence[Any]]) -> tuple[Collision, ...]:
    return tuple(
        Collision(
            link,
            KINDS.get(kind, str(kind)),
            tuple(size),
            file,
            tuple(position),
            tuple(orientation),
            tuple(hull),
        )
        for link, kind, size, file, position, orientation, hull in listed
    )


def _asked(note: dict[str, Any]) -> FileRequests:
    links = tuple(
        FileLink(
            name, math.nan if mass is None else mass, tuple(inertia), tuple(position), tuple(angles)
        )
        for name, mass, inertia, position, angles in note["file_links"]
    )
    return FileRequests(
        note["scale"],
        links,
        tuple(Mimic(*mimic) for mimic in note["mimics"]),
        tuple(FileDamping(*each) for each in note.get("dampings", [])),
    )


def moving_links(base: bool, joints: Sequence[Any]) -> tuple[int, ...]:
    """Return the links that can move: the base if it is floating, and links on movable joints."""
    moving = {BASE} if base else set()
    for info in joints:
        if info[2] != FIXED or info[16] in moving:
            moving.add(info[0])
    return tuple(sorted(moving))


def reported_of(dynamics: Sequence[Any]) -> dict[str, Float64]:
    """Return the results of `getDynamicsInfo` for base and links, by name."""
    reported = {}
    for number, (name, of_rigid) in enumerate(REPORTED):
        values = np.array([link[number] for link in dynamics], dtype=np.float64)
        if dynamics[0][10] == RIGID and not of_rigid:
            values[:] = math.nan
        reported[name] = values
    return reported


def shapes_of(
    visual: Sequence[Any], dynamics: Sequence[Any], of_rigid: Pose | None
) -> tuple[Shape, ...]:
    """Convert a result of `getVisualShapeData`, which uses the link frame, to shapes.

    `of_rigid` is the inertial frame of a btRigidBody.
    """
    shapes = []
    for _, link, kind, size, file, position, orientation, rgba in visual:
        info = dynamics[link + 1] if link + 1 < len(dynamics) else dynamics[0]
        rigid = info[10] == RIGID
        known_frame = of_rigid or ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
        inertial = known_frame if rigid else (info[3], info[4])
        placed = _seen_from(inertial, (position, orientation))
        known = "plane" if PurePath(file).name in PLANES else KINDS.get(kind, str(kind))
        shapes.append(Shape(link, known, tuple(size), file, *placed, tuple(rgba)))
    return tuple(shapes)


Pose = tuple[Sequence[float], Sequence[float]]


def _seen_from(frame: Pose, pose: Pose) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return a pose relative to a frame."""
    x, y, z, w = frame[1]
    back = np.array([-x, -y, -z, w])
    offset = np.subtract(pose[0], frame[0])
    twice = 2 * np.cross(back[:3], offset)
    position = offset + back[3] * twice + np.cross(back[:3], twice)
    return tuple(position.tolist()), tuple(_product(back, np.array(pose[1])).tolist())


def _product(a: Float64, b: Float64) -> Float64:
    """Return the product of two quaternions x, y, z, w."""
    vector = a[3] * b[:3] + b[3] * a[:3] + np.cross(a[:3], b[:3])
    return np.append(vector, a[3] * b[3] - a[:3] @ b[:3])
