"""Surfaces of hollow meshes, which an engine replaces by their convex hulls."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from drop_physics.arrays import Float64, Int64
from drop_physics.trace.events import At, Body, Collision, Surface

MOST_BYTES = 1 << 24
"""Largest mesh file that is read [bytes]."""
MOST_TRIANGLES = 1 << 16
"""Largest number of triangles of a mesh that is kept."""
HOLLOW_M = 2e-3
"""Depth below its hull [m] up to which a surface counts as convex."""
OPEN = 0.98
"""Share of its hull's area below which a surface counts as open: the hull closes the opening."""
ALIKE = 1e-2
"""Largest deviation of hull vertices from the file's vertices, as a share of the mesh's size."""
FEW = 64
"""Number of triangles that are examined first, before the others."""
STL = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def surfaces_of(at: At, body: Body, folder: Path | None = None) -> Iterator[Surface]:
    """Yield the surfaces of a body's hollow meshes, in the axes of their links.

    `folder` is given if the mesh files are in this folder, and each mesh is a single hull.
    """
    for number, shape in enumerate(body.collisions):
        if shape.kind != "mesh" or not shape.hull_m:
            continue
        file = shape.file if folder is None else str(folder / shape.file)
        if (found := _mesh(file)) is None:
            continue
        corners_m, triangles = _placed(found[0], shape), found[1]
        if folder is not None:
            if _is_hollow_file(file, shape):
                yield Surface(at, body.number, number, corners_m, triangles)
            continue
        hull_m = np.reshape(shape.hull_m, (-1, 3))
        # SciPy's tree of points takes longer to load than all of them take so.
        squares = np.einsum("ij,ij->i", corners_m, corners_m)
        nearest = [(squares - 2 * corners_m @ corner).min() + corner @ corner for corner in hull_m]
        known = max(nearest) < (ALIKE * np.ptp(hull_m, axis=0).max()) ** 2
        if known and _is_one(hull_m) and _is_hollow(corners_m, triangles, hull_m):
            yield Surface(at, body.number, number, corners_m, triangles)


def _placed(corners_m: Float64, shape: Collision) -> Float64:
    """Return a mesh's vertices in the axes of the link, given the pose of its shape."""
    *axis, w = shape.orientation
    scaled = corners_m * shape.size_m
    turn = 2 * np.cross(axis, scaled)
    return np.asarray(scaled + w * turn + np.cross(axis, turn) + shape.position_m)


@functools.lru_cache(maxsize=1024)
def _is_hollow_file(file: str, shape: Collision) -> bool:
    found, hull_m = _mesh(file), np.reshape(shape.hull_m, (-1, 3))
    return found is not None and _is_hollow(_placed(found[0], shape), found[1], hull_m)


def _is_one(hull_m: Float64) -> bool:
    """Return whether vertices are those of a single convex hull."""
    hull = _hull(hull_m)
    return hull is not None and len(hull.vertices) == len(hull_m)


def _hull(hull_m: Float64) -> Any:  # noqa: ANN401 - scipy's
    from scipy.spatial import ConvexHull, QhullError

    try:
        return ConvexHull(hull_m)
    except (QhullError, ValueError):
        return None


def _is_hollow(corners_m: Float64, triangles: Int64, hull_m: Float64) -> bool:
    """Return whether a surface lies below its convex hull, or is open."""
    hull = _hull(hull_m)
    if hull is None:
        return False
    a, b, c = np.moveaxis(corners_m[triangles], 1, 0)
    if np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2 < OPEN * hull.area:
        return True
    middles_m = (a + b + c) / 3
    for some in (middles_m[:: len(middles_m) // FEW + 1], middles_m):
        depths_m = -(hull.equations[:, :3] @ some.T + hull.equations[:, 3:]).max(axis=0)
        if depths_m.max() > HOLLOW_M:
            return True
    return False


def _mesh(file: str) -> tuple[Float64, Int64] | None:
    """Return the vertices of a mesh file, shape (n, 3), and the vertex indices of each triangle.

    None if the file cannot be read, or has too many triangles.
    """
    try:
        status = Path(file).stat()
    except (OSError, ValueError):
        return None
    return _read(file, status.st_mtime_ns) if status.st_size <= MOST_BYTES else None


@functools.lru_cache(maxsize=64)
def _read(file: str, _: int) -> tuple[Float64, Int64] | None:
    path = Path(file)
    try:
        if path.suffix.lower() == ".stl":
            corners_m, triangles = _of_stl(path.read_bytes())
        elif path.suffix.lower() == ".obj":
            corners_m, triangles = _of_obj(path.read_text(errors="replace"))
        else:
            return None
    except (OSError, ValueError, IndexError):
        return None
    if not 0 < len(triangles) <= MOST_TRIANGLES or not np.isfinite(corners_m).all():
        return None
    return corners_m, triangles


def _of_stl(content: bytes) -> tuple[Float64, Int64]:
    count = int.from_bytes(content[80:84], "little")
    facets = np.frombuffer(content, STL, count, 84)
    corners = np.ascontiguousarray(facets["corners"]).reshape(-1, 3)
    _, firsts, which = np.unique(corners.view("V12"), return_index=True, return_inverse=True)
    return corners[firsts].astype(np.float64), which.reshape(-1, 3).astype(np.int64)


def _of_obj(text: str) -> tuple[Float64, Int64]:
    corners, triangles = [], []
    for line in text.splitlines():
        kind, *words = line.split() or [""]
        if kind == "v":
            corners.append([float(word) for word in words[:3]])
        elif kind == "f":
            numbers = [int(word.partition("/")[0]) for word in words]
            face = [n - 1 if n > 0 else len(corners) + n for n in numbers]
            triangles += [(face[0], *face[k : k + 2]) for k in range(1, len(face) - 1)]
    found = np.array(triangles, np.int64).reshape(-1, 3)
    if len(found) and not 0 <= found.min() <= found.max() < len(corners):
        raise ValueError("a face has corners that the file has not")
    return np.array(corners).reshape(-1, 3), found
