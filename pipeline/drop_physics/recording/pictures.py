"""Makes chunks for the viewer: shapes, poses, cameras, curves and logs."""

from __future__ import annotations

import functools
import io
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
from numpy.typing import NDArray
from rerun.chunk import Chunk

from drop_physics.arrays import Float64, Int64
from drop_physics.recording import schema
from drop_physics.recording.writer import Times, times
from drop_physics.trace.events import Collision, Image, Shape

PLANE_M, PLANE_COLOUR = 20.0, 0x8A93A0FF
"""Drawn width and grey of an infinite plane; on white, objects would be hard to see."""
COLLISION_COLOUR = 0xFF8C00FF
BEYOND_M = 1e-3
"""Margin by which a collision hull is enlarged [m], so that it does not flicker where it coincides
with the mesh."""
MESH_SUFFIXES = (".obj", ".stl", ".dae", ".gltf", ".glb")
LARGEST_MESH_BYTES = 1 << 26
ROUND_OR_BOX = "box", "sphere", "cylinder", "ellipsoid"
"""Kinds of shapes that are drawn as primitives, whether they are visible or collision shapes."""
BRIGHTEST = 217
"""Brightness of a white body, out of 255: PyBullet's default would vanish on a light page."""
TRAIL_RADIUS, TRAIL_COLOUR = -1.5, 0x56B4E9FF
"""Radius and colour of a path's points; a negative radius is in screen points."""
CONTACT_COLOUR = 0xE69F00FF


@functools.cache
def scene() -> Chunk:
    """Return the chunk that sets the scene's up axis."""
    z_up = rr.ViewCoordinates.RIGHT_HAND_Z_UP
    return Chunk.from_columns(schema.WORLD, [], rr.ViewCoordinates.columns(xyz=[z_up.coordinates]))


def poses(entity: str, at: Times, parts: Sequence[Float64]) -> Chunk:
    """Return the poses of a body or link over time: position and orientation, shape (n, 7)."""
    rows = np.concatenate(parts)
    return Chunk.from_columns(
        entity,
        times(at),
        rr.Transform3D.columns(translation=rows[:, :3], quaternion=rows[:, 3:]),
    )


def trail(entity: str, at: Times, places: Sequence[Float64]) -> Chunk:
    """Return points along a body's path [m], shape (n, 3), at regular times."""
    return Chunk.from_columns(
        entity, times(at), rr.Points3D.columns(positions=np.concatenate(places))
    )


@functools.cache
def trail_style(entity: str, colour: int = TRAIL_COLOUR) -> Chunk:
    """Return the style of the points along a path."""
    look = rr.Points3D.columns(radii=[TRAIL_RADIUS], colors=np.array([colour], np.uint32))
    return Chunk.from_columns(entity, [], look)


def contact_points(
    entity: str, at: Times, places_m: Float64, arrows_m: Float64, counts: Int64
) -> Chunk:
    """Return contact points and force arrows, shape (points, 3), with `counts` points per row."""
    points = rr.Points3D.columns(positions=places_m).partition(counts)
    arrows = rr.Arrows3D.columns(origins=places_m, vectors=arrows_m).partition(counts)
    return Chunk.from_columns(entity, times(at), [*points, *arrows])


def contact_style(entity: str) -> Chunk:
    """Return the style of contact points."""
    colour = np.array([CONTACT_COLOUR], np.uint32)
    points = rr.Points3D.columns(radii=[-3.0], colors=colour)
    return Chunk.from_columns(
        entity, [], [*points, *rr.Arrows3D.columns(radii=[-1.5], colors=colour)]
    )


def cleared(entity: str, at: Times) -> Chunk:
    """Return a chunk that removes an entity from the view."""
    return Chunk.from_columns(entity, times(at), rr.Clear.columns(is_recursive=[True]))


def shape(entity: str, at: Times, seen: Shape, before: Shape | None = None) -> Iterator[Chunk]:
    """Yield a shape and its pose relative to its link, if it can be drawn.

    If only the colour of a drawn mesh has changed since `before`, only the colour is yielded.
    """
    if seen.kind == "mesh" and before is not None and replace(before, rgba=seen.rgba) == seen:
        recoloured = rr.Asset3D.columns(albedo_factor=[_colour(seen)])
        yield Chunk.from_columns(entity, times(at), recoloured)
    elif (drawn := _mesh_drawn(seen) if seen.kind == "mesh" else _drawn(seen)) is not None:
        yield Chunk.from_columns(entity, times(at), drawn)


def _colour(seen: Shape) -> int:
    rgba = [min(1.0, max(0.0, value)) for value in seen.rgba] or [1.0] * 4
    shades = [round(BRIGHTEST * value) for value in rgba[:3]]
    return int.from_bytes(bytes([*shades, round(255 * rgba[3])]), "big")


@functools.lru_cache(maxsize=1024)
def _drawn(seen: Shape) -> list[rr.ComponentColumn] | None:
    """Return a primitive shape and its pose on the link; None if it cannot be drawn."""
    colour, solid = _colour(seen), [rr.components.FillMode.Solid]
    a, b, *_ = (*seen.size_m, 0.0, 0.0)
    offset = (0.0, 0.0, 0.0)
    if seen.kind in ROUND_OR_BOX:
        drawn = _solid(seen, colors=[colour], fill_mode=solid)
    elif seen.kind == "capsule":
        drawn = rr.Capsules3D.columns(lengths=[a], radii=[b], colors=[colour], fill_mode=solid)
        offset = (0.0, 0.0, -a / 2)  # Rerun's begins at the origin
    elif seen.kind == "plane":
        side_m = a if len(seen.size_m) == 2 else PLANE_M
        half, offset = [[side_m / 2, side_m / 2, 0.005]], (0.0, 0.0, -0.005)
        drawn = rr.Boxes3D.columns(half_sizes=half, colors=[PLANE_COLOUR], fill_mode=solid)
    else:
        return None
    return [*drawn, *_placed(seen, offset)]


def _mesh_drawn(seen: Shape) -> list[rr.ComponentColumn] | None:
    mesh = _mesh(seen.file)
    if mesh is None:
        return None
    blob, media_type = mesh
    colour = _colour(seen)
    drawn = rr.Asset3D.columns(blob=[blob], media_type=[media_type], albedo_factor=[colour])
    return [*drawn, *_placed(seen, scale=[seen.size_m])]


def _placed(
    seen: Shape,
    offset: Sequence[float] = (0.0, 0.0, 0.0),
    scale: Sequence[Sequence[float]] | None = None,
) -> rr.ComponentColumnList:
    moved = [_moved(seen, offset)]
    return rr.Transform3D.columns(translation=moved, quaternion=[seen.orientation], scale=scale)


def _solid(seen: Shape | Collision, **look: Any) -> Iterable[rr.ComponentColumn]:  # noqa: ANN401
    """Return a box, sphere, ellipsoid or cylinder in Rerun's types."""
    a, b, *_ = (*seen.size_m, 0.0, 0.0)
    if seen.kind == "box":
        return rr.Boxes3D.columns(half_sizes=[[side / 2 for side in seen.size_m]], **look)
    if seen.kind == "sphere":
        return rr.Ellipsoids3D.columns(half_sizes=[[a, a, a]], **look)
    if seen.kind == "ellipsoid":
        return rr.Ellipsoids3D.columns(half_sizes=[[side / 2 for side in seen.size_m]], **look)
    return rr.Cylinders3D.columns(lengths=[a], radii=[b], **look)


def collision(entity: str, at: Times, link: str, seen: Collision) -> Iterator[Chunk]:
    """Yield a link's collision shape in the frame of the entity `link`, if it can be drawn."""
    if max(seen.size_m, default=0.0) > PLANE_M:
        return  # a floor, which would hide all else
    if seen.kind in ROUND_OR_BOX:
        see_through = [rr.components.FillMode.TransparentFillMajorWireframe]
        turned = {} if seen.kind == "sphere" else {"quaternions": [seen.orientation]}
        drawn = _solid(
            seen,
            centers=[seen.position_m],
            colors=[COLLISION_COLOUR],
            fill_mode=see_through,
            **turned,
        )
    elif seen.kind == "mesh" and (hull := hull_of(seen.hull_m)) is not None:
        corners_m, normals = hull
        mesh = rr.Mesh3D.columns(vertex_positions=corners_m, vertex_normals=normals)
        colour = rr.Mesh3D.columns(albedo_factor=[COLLISION_COLOUR])
        drawn = [*mesh.partition([len(corners_m)]), *colour]
    else:
        return
    frame = rr.CoordinateFrame.columns(frame=[f"tf#/{link}"])
    yield Chunk.from_columns(entity, times(at), [*drawn, *frame])


@functools.lru_cache(maxsize=64)
def hull_of(corners: tuple[float, ...]) -> tuple[Float64, Float64] | None:
    """Return the triangles of a convex hull: three corners each, and their normals, shape (n, 3).

    `corners` has three coordinates per corner [m]. None if they are not the corners of a single
    convex hull: a file may have several parts.
    """
    from scipy.spatial import ConvexHull, QhullError  # slow to import, and few bodies have meshes

    corners_m = np.reshape(corners, (-1, 3))
    try:
        hull = ConvexHull(corners_m)
    except (QhullError, ValueError):
        return None
    if len(hull.vertices) < len(corners_m):
        return None
    outwards = np.repeat(hull.equations[:, :3], 3, axis=0)
    ways = corners_m - corners_m.mean(axis=0)
    corners_m = corners_m + BEYOND_M * ways / np.linalg.norm(ways, axis=1, keepdims=True)
    return corners_m[hull.simplices.ravel()], outwards


def _moved(shape: Shape, offset: Sequence[float]) -> list[float]:
    """Return a shape's position after an offset along its own axes."""
    x, y, z, w = shape.orientation
    vector, axis = np.asarray(offset), np.array([x, y, z])
    turned = vector + 2 * np.cross(axis, np.cross(axis, vector) + w * vector)
    return list(np.asarray(shape.position_m) + turned)


@functools.lru_cache(maxsize=64)
def _mesh(file: str) -> tuple[bytes, str] | None:
    """Return a mesh file's content and media type; None if it cannot be shown."""
    path = Path(file)
    suffix = path.suffix.lower()
    try:
        if suffix not in MESH_SUFFIXES or path.stat().st_size > LARGEST_MESH_BYTES:
            return None
        blob = path.read_bytes()
    except OSError:
        return None
    kinds = {
        ".obj": "model/obj",
        ".stl": "model/stl",
        ".dae": "model/vnd.collada+xml",
        ".gltf": "model/gltf+json",
        ".glb": "model/gltf-binary",
    }
    return blob, kinds[suffix]


def png(rgba: NDArray[np.uint8]) -> bytes:
    """Encode pixels, shape (height, width, 4), as PNG without alpha, which is always 255."""
    from PIL import Image as Pillow

    buffer = io.BytesIO()
    Pillow.fromarray(np.ascontiguousarray(rgba[:, :, :3])).save(
        buffer, format="png", compress_level=1
    )
    return buffer.getvalue()


def images(entity: str, at: Times, blobs: Sequence[bytes]) -> Chunk:
    """Return a chunk with a camera's frames, one PNG per time."""
    kinds = ["image/png"] * len(blobs)
    return Chunk.from_columns(
        entity, times(at), rr.EncodedImage.columns(blob=list(blobs), media_type=kinds)
    )


def camera(entity: str, at: Times, seen: Image) -> Iterator[Chunk]:
    """Yield a camera's pose and lens, if the script has set them."""
    if len(seen.view) != 16 or len(seen.projection) != 16:
        return
    height, width = seen.rgba.shape[:2]
    camera_from_world = np.array(seen.view).reshape(4, 4).T
    lens = np.array(seen.projection).reshape(4, 4).T
    try:
        world_from_camera = np.linalg.inv(camera_from_world)
    except np.linalg.LinAlgError:
        return
    focal = [lens[0, 0] * width / 2, lens[1, 1] * height / 2]
    if lens[3, 2] != -1 or not np.isfinite([*focal, *world_from_camera.ravel()]).all():
        return  # a camera without perspective
    image_from_camera = [[focal[0], 0, width / 2], [0, focal[1], height / 2], [0, 0, 1]]
    yield Chunk.from_columns(
        entity,
        times(at),
        rr.Transform3D.columns(
            translation=[world_from_camera[:3, 3]], mat3x3=[world_from_camera[:3, :3]]
        ),
    )
    yield Chunk.from_columns(
        f"{entity}/image",
        times(at),
        rr.Pinhole.columns(
            image_from_camera=[np.array(image_from_camera)],
            resolution=[[width, height]],
            camera_xyz=[rr.ViewCoordinates.RUB.coordinates],
        ),
    )


def log(entity: str, at: Times, lines: Sequence[tuple[str, bool]]) -> Chunk:
    """Return a chunk of log lines, each with a flag that is True for errors."""
    texts = [text for text, _ in lines]
    levels = ["ERROR" if is_error else "INFO" for _, is_error in lines]
    columns = rr.TextLog.columns(text=texts, level=levels if "ERROR" in levels else None)
    return Chunk.from_columns(entity, times(at), columns)
