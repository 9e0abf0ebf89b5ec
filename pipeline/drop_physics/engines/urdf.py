"""Reads a URDF without PyBullet: one link made of boxes, spheres and cylinders.

As in PyBullet by default, moments of inertia are computed from the collision shapes and the link's
mass, and those in the file are ignored. Density is uniform: several shapes share the mass by
volume. Axes are those of the link's inertial frame, as in PyBullet.
"""

from __future__ import annotations

import hashlib
import math
import re
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from drop_physics.arrays import Float64
from drop_physics.engines.rigid_body import PrimitiveShape, RigidBody
from drop_physics.errors import ScenarioError
from drop_physics.fields import counted
from drop_physics.option_types import Quaternion, Vector
from drop_physics.physics.rotations import matrix, quaternions

STANDARD = Path(__file__).with_name("cube_small.urdf")
"""The default body, a copy of `pybullet_data`'s without irrelevant parts."""

DECLARED = re.compile(rb"^\s*<\?xml.*?\?>")
"""XML declaration of a file; many files of Bullet name an XML version that does not exist."""


@dataclass(frozen=True)
class UrdfBody:
    """A body of one link, as described by a URDF."""

    body: RigidBody
    sha256: str
    """Digest of the file."""
    half_size_m: Float64
    """Half of the body's extents along its own axes, shape (3,)."""
    reach_m: float
    """Distance of the bounding box's farthest corner from the centre of mass."""

    def rest_height_m(self, orientation: Quaternion) -> float | None:
        """Return the centre's height at which the turned body touches the floor [m]."""
        depths_m = [shape.depth_m(orientation) for shape in self.body.shapes]
        return round(max(depths_m), 14) + 0.0 if depths_m else None


def find_urdf(body: str) -> Path:
    """Return the file of a body; for the default body, drop's own copy.

    Raises
    ------
    ScenarioError
        If there is no such file.
    """
    if body == STANDARD.name:
        return STANDARD
    path = Path(body)
    if not path.is_file():
        raise ScenarioError(
            "--body must be a URDF file, or cube_small.urdf, got {body!r}; without PyBullet there "
            "is no pybullet_data",
            body=body[:200],
        )
    return path


def read_urdf(path: Path, mass_kg: float | None = None) -> UrdfBody:
    """Read a body; `mass_kg` replaces the mass in the file.

    Raises
    ------
    ScenarioError
        If the file is not a URDF, or the body has joints, no mass, or unsupported shapes.
    """
    content = path.read_bytes()
    try:
        robot = ElementTree.fromstring(DECLARED.sub(b"", content))
        links = robot.findall("link")
        if len(links) != 1 or robot.find("joint") is not None:
            raise ScenarioError(
                "without PyBullet --body takes a body of one link, got {links} in {path!r}",
                links=counted(len(links), "link"),
                path=str(path),
            )
        (link,) = links
        given = link.find("inertial/mass")
        own_kg = 1.0 if given is None else float(given.get("value", "0"))
        frame = _pose(link.find("inertial"))
        shapes = tuple(_shape(each, frame, path) for each in link.findall("collision"))
    except (ElementTree.ParseError, ValueError, KeyError) as error:
        raise ScenarioError(
            "--body must be a URDF, got {path!r} ({error})", path=str(path), error=str(error)
        ) from None
    mass = own_kg if mass_kg is None else mass_kg
    if not mass > 0:
        raise ScenarioError(
            "--body must have a mass, got 0 kg in {path!r}; try --mass 0.1", path=str(path)
        )
    corners_m = [_corners(shape) for shape in shapes] or [np.zeros((1, 3))]
    lowest, highest = (end(np.concatenate(corners_m), axis=0) for end in (np.min, np.max))
    moments = _moments(mass, shapes)
    return UrdfBody(
        RigidBody(robot.get("name", path.stem), mass, moments, shapes),
        hashlib.sha256(content).hexdigest(),
        (highest - lowest) / 2,
        float(np.linalg.norm(np.maximum(-lowest, highest))),
    )


def _pose(element: ElementTree.Element | None) -> tuple[Float64, Float64]:
    """Return the pose in an element's `<origin>`: position, shape (3,), and rotation (3, 3)."""
    origin = None if element is None else element.find("origin")
    given = {} if origin is None else origin.attrib
    position, angles = (
        np.array([float(word) for word in given.get(name, "0 0 0").split()])
        for name in ("xyz", "rpy")
    )
    if len(position) != 3 or len(angles) != 3:
        raise ValueError("an origin has three numbers")
    return position, matrix(_quaternion(angles))


def _quaternion(angles: Float64) -> Quaternion:
    """Return the rotation for roll, pitch and yaw, about the world's x, then y, then z."""
    (sx, sy, sz), (cx, cy, cz) = np.sin(angles / 2), np.cos(angles / 2)
    return (
        float(sx * cy * cz - cx * sy * sz),
        float(cx * sy * cz + sx * cy * sz),
        float(cx * cy * sz - sx * sy * cz),
        float(cx * cy * cz + sx * sy * sz),
    )


def _shape(
    collision: ElementTree.Element, frame: tuple[Float64, Float64], path: Path
) -> PrimitiveShape:
    """Return a collision shape, placed in the inertial frame."""
    geometry = collision.find("geometry")
    each = None if geometry is None else next(iter(geometry), None)
    kind = "none" if each is None else each.tag
    sizes: Vector
    if each is not None and kind == "box":
        x, y, z = (float(word) for word in each.attrib["size"].split())
        sizes = (x, y, z)
    elif each is not None and kind == "sphere":
        sizes = (float(each.attrib["radius"]), 0.0, 0.0)
    elif each is not None and kind in ("cylinder", "capsule"):
        sizes = (float(each.attrib["radius"]), float(each.attrib["length"]), 0.0)
    else:
        raise ScenarioError(
            "without PyBullet --body takes boxes, spheres, cylinders and capsules, got a shape of "
            "kind {kind} in {path!r}",
            kind=kind,
            path=str(path),
        )
    position, turned = _pose(collision)
    centre, axes = frame
    x, y, z = (axes.T @ (position - centre)).tolist()
    a, b, c, w = quaternions((axes.T @ turned)[..., None])[0].tolist()
    return PrimitiveShape(kind, sizes, (x, y, z), (a, b, c, w))


def _half_m(shape: PrimitiveShape) -> Float64:
    """Return half of a shape's extents along its own axes, shape (3,)."""
    a, b, c = shape.size_m
    if shape.kind == "box":
        return np.array([a, b, c]) / 2
    along = {"sphere": a, "cylinder": b / 2, "capsule": b / 2 + a}[shape.kind]
    return np.array([a, a, along])


def _corners(shape: PrimitiveShape) -> Float64:
    """Return the corners of a shape's bounding box, in the body's axes, shape (8, 3)."""
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    return np.asarray(signs * _half_m(shape) @ matrix(shape.orientation).T + shape.position_m)


def _moments(mass_kg: float, shapes: tuple[PrimitiveShape, ...]) -> Vector:
    """Return the moments of inertia about the body's axes [kg m²]."""
    volumes = [_volume_m3(shape) for shape in shapes]
    total = np.zeros((3, 3))
    for shape, volume in zip(shapes, volumes, strict=True):
        share_kg = mass_kg * volume / math.fsum(volumes)
        axes, away = matrix(shape.orientation), np.array(shape.position_m)
        total += axes @ np.diag(_of_shape(share_kg, shape)) @ axes.T
        total += share_kg * (away @ away * np.eye(3) - np.outer(away, away))
    x, y, z = np.diag(total).tolist() if shapes else (mass_kg, mass_kg, mass_kg)
    return x, y, z


def _volume_m3(shape: PrimitiveShape) -> float:
    a, b, c = shape.size_m
    return {
        "box": a * b * c,
        "sphere": 4 / 3 * math.pi * a**3,
        "cylinder": math.pi * a**2 * b,
        "capsule": math.pi * a**2 * (b + 4 / 3 * a),
    }[shape.kind]


def _of_shape(mass_kg: float, shape: PrimitiveShape) -> Float64:
    """Return the principal moments of a uniform shape [kg m²], shape (3,)."""
    a, b, c = shape.size_m
    if shape.kind == "box":
        return mass_kg / 12 * np.array([b * b + c * c, a * a + c * c, a * a + b * b])
    if shape.kind == "sphere":
        return np.full(3, 2 / 5 * mass_kg * a * a)
    ends_kg = mass_kg * (4 / 3 * a) / (b + 4 / 3 * a) if shape.kind == "capsule" else 0.0
    rod_kg = mass_kg - ends_kg
    # Two half balls, whose centres are 3/8 of their radius beyond the ends of the rod.
    across = rod_kg * (a * a / 4 + b * b / 12)
    across += ends_kg * (2 / 5 * a * a + b * b / 4 + 3 / 8 * a * b)
    along = rod_kg * a * a / 2 + ends_kg * 2 / 5 * a * a
    return np.array([across, across, along])
