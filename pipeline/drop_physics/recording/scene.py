"""Reads the data needed to draw a script's scene: its shapes, and the poses of all parts."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePath

import numpy as np
from numpy.typing import NDArray

from drop_physics.arrays import Float64
from drop_physics.messages import Message
from drop_physics.recording import columns
from drop_physics.recording.contents import chunks_of
from drop_physics.recording.damage import damaged, wrong_count
from drop_physics.recording.drawing import FARTHEST_M, part_path
from drop_physics.recording.rrd import Chunk
from drop_physics.trace.events import Body, Model, Shape
from drop_physics.trace.history import Seen
from drop_physics.trace.poses import placed

Float32 = NDArray[np.float32]


ORIGIN = np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]], np.float32)
"""Pose of the origin."""


@dataclass(frozen=True, eq=False)
class Part:
    """A drawn body or link with one appearance, and its poses over time."""

    number: int
    """Id of the body."""
    models: tuple[Model, ...]
    radius_m: float
    """Radius of a ball around the part; infinite for a plane."""
    times_s: Float64
    """Times of the poses, ascending, shape (n,)."""
    poses: Float32
    """Position and orientation, shape (n, 7); nan while the body is absent or looks different."""

    def at(self, times_s: Float64) -> Float64:
        """Return the part's poses at given times, shape (n, 7); nan while it does not exist."""
        rows = np.searchsorted(self.times_s, times_s + 1e-9, side="right") - 1
        found = np.full((len(times_s), 7), np.nan)
        found[rows >= 0] = self.poses[rows[rows >= 0]]
        return found

    def on(self, parent: Part) -> Part:
        """Convert poses relative to another part into world poses."""
        times_s = np.unique(np.concatenate([parent.times_s, self.times_s]))
        poses = placed(parent.at(times_s), self.at(times_s))
        return replace(self, times_s=times_s, poses=poses.astype(np.float32))

    def in_looks(self, looks: Sequence[tuple[float, tuple[Model, ...]]]) -> Iterator[Part]:
        """Yield one part for each appearance, limited to the time of that appearance.

        `looks` are the shapes in order, with the time from which they are drawn [s]; an empty tuple
        means that the part does not exist.
        """
        starts_s = np.array([start_s for start_s, _ in looks])
        times_s = np.unique(np.concatenate([self.times_s, starts_s]))
        poses = self.at(times_s).astype(np.float32)
        rows = np.clip(np.searchsorted(starts_s, times_s, side="right") - 1, 0, None)
        for models in dict.fromkeys(models for _, models in looks):
            looks_so = np.array([each == models for _, each in looks])[rows, None]
            its = np.where(looks_so, poses, np.float32(np.nan))
            yield replace(self, models=models, times_s=times_s, poses=its)


def parts_of(path: Path, seen: Seen) -> list[Part]:
    """Return the bodies and links of a recording that can be drawn.

    Raises
    ------
    RecordingError
        If the recording is damaged.
    """
    links = {
        part_path(body, link): (body, link)
        for body in seen.bodies.values()
        for link in range(-1, len(body.links) - 1)
    }
    poses: dict[str, list[tuple[Float64, Float32]]] = {}
    meshes: dict[str, bytes] = {}
    for chunk in chunks_of(path):
        if chunk.entity in links:
            poses.setdefault(chunk.entity, []).extend(_poses(chunk, path))
        elif chunk.batch.schema.get_field_index("Asset3D:blob") >= 0:
            meshes[chunk.entity] = _blob(chunk, path)
    looks: dict[str, list[tuple[float, tuple[Model, ...]]]] = {}
    for appearance in seen.appearances:
        for link in range(-1, len(appearance.body.links) - 1):
            models = _models(appearance.body, link, meshes) if appearance.there else ()
            its = looks.setdefault(part_path(appearance.body, link), [])
            its.append((appearance.at.time_s, models))
    found: list[Part] = []
    whole: dict[tuple[int, int], Part] = {}
    for entity, (body, link) in links.items():
        # A body that is never placed, as a drop's floor, is where its parent is, as in the viewer.
        read = poses.get(entity, [(np.zeros(1), ORIGIN)] if link < 0 else [])
        if read:
            times_s = np.concatenate([times_s for times_s, _ in read])
            order = np.argsort(times_s, kind="stable")
            rows = np.concatenate([rows for _, rows in read])[order]
            part = Part(body.number, (), _radius_m(body, link), times_s[order], rows)
            if link >= 0 and (parent := whole.get((body.number, body.joints[link].parent))):
                part = part.on(parent)
            whole[body.number, link] = part
            found += part.in_looks(looks.get(entity, ()))
    return [part for part in found if part.models]


def reach_of(parts: Sequence[Part]) -> tuple[Float64, Float64]:
    """Return the bounding box of all motion, without bodies that fly away."""
    boxes = [(part, np.fmin.reduce(part.poses), np.fmax.reduce(part.poses)) for part in parts]
    moves = {part.number for part, low, high in boxes if (high - low > 1e-4).any()}
    shown = [
        (part.radius_m, low[:3], high[:3])
        for part, low, high in boxes
        if part.radius_m < FARTHEST_M
        and np.isfinite(low[:3]).all()
        and (part.number in moves or not moves)
    ]
    if not shown:
        return np.zeros(3), np.zeros(3)
    radii_m, lows_m, highs_m = (np.array(each, np.float64) for each in zip(*shown, strict=True))
    middle_m = np.median(lows_m, axis=0)
    lows_m, highs_m = (
        each.clip(middle_m - FARTHEST_M, middle_m + FARTHEST_M)
        for each in (lows_m - radii_m[:, None], highs_m + radii_m[:, None])
    )
    return lows_m.min(axis=0), highs_m.max(axis=0)


def _radius_m(body: Body, link: int) -> float:
    """Return the radius of a ball that encloses a link [m]."""
    if any(shape.kind == "plane" and shape.link == link for shape in body.shapes):
        return np.inf
    shapes = [shape for shape in body.shapes if shape.link == link]
    box = np.array(body.bounds_m[6 * (link + 1) : 6 * (link + 2)])
    half_m = float(np.linalg.norm(box[3:] - box[:3])) / 2 if len(box) else 0.0
    # Around the centre of mass, which a head on a torso, or a mesh, may be far from.
    return max(
        (float(np.linalg.norm(each.position_m)) + _size_m(each, half_m) for each in shapes),
        default=half_m,
    )


def _size_m(shape: Shape, half_m: float) -> float:
    """Return the radius of a ball that encloses a shape [m], at most that of its bounding box."""
    match shape.kind:
        case "mesh":
            return half_m
        case "sphere":
            size_m = shape.size_m[0]
        case "cylinder" | "capsule":
            length_m, radius_m = shape.size_m[:2]
            size_m = length_m / 2 + radius_m
        case _:
            size_m = float(np.linalg.norm(shape.size_m)) / 2
    return min(size_m, half_m) if half_m else size_m


def _models(body: Body, link: int, meshes: Mapping[str, bytes]) -> tuple[Model, ...]:
    """Return a link's drawn shapes, without meshes that were not recorded."""
    shapes = [shape for shape in body.shapes if shape.link == link]
    found = [meshes.get(f"{part_path(body, link)}/{number}", b"") for number in range(len(shapes))]
    return tuple(
        Model(shape, mesh, PurePath(shape.file).suffix.lower())
        for shape, mesh in zip(shapes, found, strict=True)
        if mesh or shape.kind != "mesh"
    )


def _poses(chunk: Chunk, path: Path) -> Iterator[tuple[Float64, Float32]]:
    """Yield a chunk's times and poses, if it has any; nan for non-finite numbers."""
    names = "Transform3D:translation", "Transform3D:quaternion"
    if all(chunk.batch.schema.get_field_index(name) >= 0 for name in names):
        poses = np.hstack(
            [_numbers(chunk, name, width, path) for name, width in zip(names, (3, 4), strict=True)]
        )
        poses[~np.isfinite(poses).all(axis=1)] = np.nan
        yield columns.times_s(chunk), poses


def _numbers(chunk: Chunk, name: str, width: int, path: Path) -> Float32:
    column = chunk.batch.column(chunk.batch.schema.get_field_index(name))
    try:
        lists = columns.between(column)
        if lists.null_count:
            raise ValueError(name)
        flat = lists.values.slice(lists.offset * width, len(lists) * width)
        numbers = np.asarray(flat.to_numpy(zero_copy_only=False), np.float32)
        return numbers.reshape(chunk.batch.num_rows, width)
    except (AttributeError, ValueError):
        raise damaged(path, wrong_count(chunk.entity, width, name)) from None


def _blob(chunk: Chunk, path: Path) -> bytes:
    cell = chunk.batch.column(chunk.batch.schema.get_field_index("Asset3D:blob"))[0]
    try:
        return bytes(cell.values[0].values.to_numpy().tobytes())
    except (AttributeError, TypeError, IndexError, ValueError):
        what = Message("{entity} must hold a mesh", entity=chunk.entity)
        raise damaged(path, what) from None
