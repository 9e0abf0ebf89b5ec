"""Renders images of a script's scene from its recorded poses.

Bullet may crash on an invalid mesh: call this only in a process that may end.
"""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import ImageColor

from drop_physics.arrays import Flags, Float64, Int64
from drop_physics.engines.pybullet.c_output import c_output_moved_aside
from drop_physics.engines.pybullet.checkerboard import checkerboard
from drop_physics.engines.pybullet.engine import p
from drop_physics.engines.pybullet.visible_world import picture_of
from drop_physics.scenario import Camera
from drop_physics.temporary import temporary_folder
from drop_physics.trace.events import Model, Pose

SQUARE = 1 / 4
"""Approximate side of a plane's squares, relative to the camera's distance."""
BEND = 0.02
"""Curvature of the inverse depth between pixels above which an edge is drawn; on a flat face it is
0."""
SHADES = 8
"""Brightness levels (of 255) per shade: colours are rounded to these, because a gif has few
colours."""
EDGE = 0.35
"""Factor by which an edge darkens the colour of a pixel."""
OUTLINE = 40
"""Lowest brightness (of 255) of an edge on a dark background, so that black bodies are visible."""
DRAWN_MESHES = (".obj", ".stl", ".dae")
NOWHERE: Pose = (0.0, 0.0, -1e4), (0.0, 0.0, 0.0, 1.0)
Float32 = NDArray[np.float32]


def drawn(
    parts: Sequence[Sequence[Model]],
    poses: Float64,
    cameras: Sequence[Camera],
    colours: Sequence[str],
) -> Iterator[NDArray[np.uint8]]:
    """Render images of a scene, RGB of shape (height, width, 3).

    Parameters
    ----------
    parts
        The shapes of each part of the scene.
    poses
        The pose of each part in each picture, shape (pictures, parts, 7); nan if the part is
        absent.
    cameras
        The camera of each picture.
    colours
        The two colours of an infinite plane's squares, and the background colour, as `#rrggbb`.
    """
    side_m = 2.0 ** float(np.round(np.log2(SQUARE * cameras[0].distance_m)))
    planes = [
        (number, _placed(model))
        for number, models in enumerate(parts)
        for model in models
        if model.shape.kind == "plane"
    ]
    rgb = np.array([ImageColor.getrgb(colour) for colour in colours], np.uint8)
    client = p.connect(p.DIRECT)
    try:
        with temporary_folder() as folder, c_output_moved_aside():
            bodies = [
                [made for model in models if (made := _body(client, folder, model))]
                for models in parts
            ]
            for placed, camera in zip(poses, cameras, strict=True):
                for pose, its in zip(placed, bodies, strict=True):
                    for body, offset in its:
                        place = _after(pose, offset) or NOWHERE
                        p.resetBasePositionAndOrientation(body, *place, physicsClientId=client)
                there = (_after(placed[number], offset) for number, offset in planes)
                floors = [checkerboard(camera, place, side_m, rgb) for place in there if place]
                yield _picture(camera, client, floors, rgb[2])
    finally:
        p.disconnect(client)


def _placed(model: Model) -> Pose:
    """Return the pose of a shape relative to the body or link that it belongs to."""
    return model.shape.position_m, model.shape.orientation


def _after(pose: Float64, offset: Pose) -> Pose | None:
    """Return a shape's world pose, given its part's pose; None if the part is absent."""
    if np.isnan(pose).any():
        return None
    place: Pose = p.multiplyTransforms(pose[:3].tolist(), pose[3:].tolist(), *offset)
    return place


def _body(client: int, folder: Path, model: Model) -> tuple[int, Pose] | None:
    """Create a PyBullet body that looks like a shape; return it with its relative pose, or None."""
    shape, a, b = model.shape, *(*model.shape.size_m, 0.0, 0.0)[:2]
    look: dict[str, object]
    if shape.kind == "box":
        half = [side / 2 for side in shape.size_m]
        look = {"shapeType": p.GEOM_BOX, "halfExtents": half}
    elif shape.kind == "sphere":
        look = {"shapeType": p.GEOM_SPHERE, "radius": a}
    elif shape.kind in ("cylinder", "capsule"):
        kind = p.GEOM_CYLINDER if shape.kind == "cylinder" else p.GEOM_CAPSULE
        look = {"shapeType": kind, "length": a, "radius": b}
    elif shape.kind == "ellipsoid":
        half = [side / 2 for side in shape.size_m]
        look = {"shapeType": p.GEOM_MESH, "fileName": str(_ball(folder)), "meshScale": half}
    elif model.mesh and model.suffix in DRAWN_MESHES:
        file = Path(tempfile.mkstemp(model.suffix, dir=folder)[1])
        file.write_bytes(model.mesh)
        look = {"shapeType": p.GEOM_MESH, "fileName": str(file), "meshScale": shape.size_m}
    else:
        return None
    with contextlib.suppress(p.error):
        visual = p.createVisualShape(rgbaColor=shape.rgba, physicsClientId=client, **look)
        body: int = p.createMultiBody(0, -1, visual, *NOWHERE, physicsClientId=client)
        return body, _placed(model)
    return None


def _ball(folder: Path) -> Path:
    """Write a mesh of a ball with radius 1; return its file."""
    file = folder / "ball.obj"
    if not file.exists():
        rings, sides = np.linspace(0, np.pi, 13), np.linspace(0, 2 * np.pi, 24, endpoint=False)
        around, along = np.meshgrid(sides, rings)
        corners = np.stack(
            (np.sin(along) * np.cos(around), np.sin(along) * np.sin(around), np.cos(along)), axis=-1
        ).reshape(-1, 3)
        lines = ["v {:.6f} {:.6f} {:.6f}".format(*corner) for corner in corners]
        lines += ["vn {:.6f} {:.6f} {:.6f}".format(*corner) for corner in corners]
        for ring in range(len(rings) - 1):
            for side in range(len(sides)):
                a, b = ring * 24 + side, ring * 24 + (side + 1) % 24
                for face in ((a, a + 24, b), (b, a + 24, b + 24)):
                    lines.append("f " + " ".join(f"{each + 1}//{each + 1}" for each in face))
        file.write_text("\n".join(lines) + "\n", encoding="ascii")
    return file


def _picture(
    camera: Camera,
    client: int,
    floors: Sequence[tuple[NDArray[np.uint8], Float32]],
    page: NDArray[np.uint8],
) -> NDArray[np.uint8]:
    seen = picture_of(client, camera, "tiny", lit=True)
    whole, nearest = np.tile(page, (*seen.depth.shape, 1)), np.zeros_like(seen.depth)
    for colours, its in floors:
        np.copyto(whole, colours, where=(its > nearest)[..., None])
        nearest = np.maximum(nearest, its)
    # Bodies are in a small part of most pictures.
    part = _around(seen.bodies >= 0)
    pixels, numbers, floor = seen.pixels[part], seen.bodies[part], nearest[part]
    near_m, far_m = camera.near_m, camera.far_m
    nearness = (1 / near_m - (1 / near_m - 1 / far_m) * seen.depth[part]) * (numbers >= 0)
    hidden = (floor > nearness) | (numbers < 0)
    numbers, nearness = np.where(hidden, -1, numbers), np.maximum(nearness, floor)
    pixels = np.where(hidden[..., None], whole[part], pixels & (256 - SHADES))
    edges = _edges(numbers, nearness) & (numbers >= 0)
    pixels[edges] = np.maximum(pixels[edges] * EDGE, (page + OUTLINE) * (page < 128)).astype(
        np.uint8
    )
    whole[part] = pixels
    return whole


def _around(there: Flags) -> tuple[slice, slice]:
    """Return the rows and columns around the non-empty pixels, with a margin of two."""
    rows, columns = (np.flatnonzero(there.any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        return slice(0), slice(0)
    return tuple(slice(max(0, each[0] - 2), each[-1] + 3) for each in (rows, columns))  # type: ignore[return-value]


def _edges(numbers: Int64, nearness: Float32) -> Flags:
    """Flag the pixels at edges of bodies and faces; `nearness` is the inverse distance."""
    edges = np.zeros(numbers.shape, np.bool_)
    for each, near, marks in ((numbers, nearness, edges), (numbers.T, nearness.T, edges.T)):
        ends = each[1:] != each[:-1]
        marks[1:] |= ends
        marks[:-1] |= ends
        marks[1:-1] |= np.abs(np.diff(near, 2, axis=0)) > BEND * near[1:-1]
    return edges
