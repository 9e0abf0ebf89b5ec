"""Finds shapes that do not fit a body's motion: wheels off their axles, masses outside shapes."""

from __future__ import annotations

import numpy as np

from drop_physics.account.subjects import UNBOUNDED, MeasuredBody
from drop_physics.arrays import Float64
from drop_physics.messages import Message
from drop_physics.physics.columns import rotation
from drop_physics.quantities import quantity
from drop_physics.trace.events import Collision, Joint

ROUND = ("sphere", "cylinder", "capsule")
"""Kinds of shapes that rotate about an axle through their axis without a change of contact."""
ALONG = 0.99
"""Cosine above which the axis of a shape counts as parallel to that of a joint."""
OFF = 0.01
"""Share of the shape's radius, or size, above which an offset is reported."""


def off_axle(subject: MeasuredBody, joint: Joint) -> Message:
    """Describe how far a wheel's centre is from its axis of rotation, or nothing."""
    if joint.kind != "revolute":
        return Message("")
    axis, place = np.array(joint.axis), subject.tree.centres_m[joint.link]
    its = [collision for collision in subject.body.collisions if collision.link == joint.link]
    if len(its) != 1 or its[0].kind not in ROUND or not axis.any():
        return Message("")
    (shape,), along = its, axis / np.linalg.norm(axis)
    radius_m = shape.size_m[0] if shape.kind == "sphere" else shape.size_m[1]
    if shape.kind != "sphere" and abs(_axes(shape)[:, 2] @ along) < ALONG:
        return Message("")
    centre = place + np.array(shape.position_m)
    off_m = float(np.linalg.norm(centre - (centre @ along) * along))
    if not OFF * radius_m < off_m < radius_m:  # farther out, it is no wheel
        return Message("")
    return Message(
        "; its {shape} of radius {radius} is {off} off its axle",
        shape=shape.kind,
        radius=quantity(radius_m, "m"),
        off=quantity(off_m, "m"),
    )


def mass_outside(subject: MeasuredBody) -> Message:
    """Describe how far a centre of mass lies outside all shapes of its body, or nothing."""
    shapes = subject.body.collisions
    if subject.tree.links or not shapes or any(shape.kind in UNBOUNDED for shape in shapes):
        return Message("")
    boxes = [_box(shape) for shape in shapes]
    low = np.min([box[0] for box in boxes], axis=0)
    high = np.max([box[1] for box in boxes], axis=0)
    out_m = float(np.linalg.norm(np.maximum(np.maximum(low, -high), 0.0)))
    if out_m <= OFF * float(np.max(high - low)):
        return Message("")
    return Message("; its centre of mass is {out} outside its shape", out=quantity(out_m, "m"))


def too_inert(subject: MeasuredBody) -> Message:
    """Describe a moment of inertia that no mass inside the body's shape can have, or nothing.

    With all of its mass m at the farthest distance R of its shape from the centre of mass, a body
    has the moment of inertia m R².
    """
    shapes, tree = subject.body.collisions, subject.tree
    if tree.links or not shapes or any(shape.kind in UNBOUNDED for shape in shapes):
        return Message("")
    corners = np.max([np.maximum(-low, high) for low, high in map(_box, shapes)], axis=0)
    most = float(tree.masses_kg[0]) * float(corners @ corners)
    inertia = float(tree.inertias_kg_m2[0].max())
    if not most < inertia < np.inf:
        return Message("")
    return Message(
        "; its moment of inertia is {inertia}, where its mass within its shape has at most {most}",
        inertia=quantity(inertia, "kg m²"),
        most=quantity(most, "kg m²"),
    )


def _axes(shape: Collision) -> Float64:
    return np.asarray(rotation(np.array(shape.orientation)[:, None])[..., 0])


def _box(shape: Collision) -> tuple[Float64, Float64]:
    """Return the corners of a shape's bounding box, relative to the centre of mass [m]."""
    centre, axes = np.array(shape.position_m), _axes(shape)
    if shape.hull_m:
        corners = np.reshape(shape.hull_m, (-1, 3))
        return corners.min(axis=0), corners.max(axis=0)
    size = np.array(shape.size_m)
    if shape.kind == "sphere":
        half = np.full(3, size[0])
    elif shape.kind in ("cylinder", "capsule"):
        half = np.array([size[1], size[1], size[0] / 2 + size[1] * (shape.kind == "capsule")])
    else:
        half = size / 2
    reach = np.abs(axes) @ half
    return centre - reach, centre + reach
