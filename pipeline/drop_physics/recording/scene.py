"""The scene of a script's recording, to redraw it: shapes, and the poses of their parts."""

from __future__ import annotations

import bisect
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePath

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from drop_physics.messages import Message
from drop_physics.recording import columns, schema
from drop_physics.recording.checks import damaged, wrong_count
from drop_physics.recording.columns import Properties
from drop_physics.recording.contents import chunks_of, closing_of, gather
from drop_physics.recording.digest import FrameDigest
from drop_physics.recording.drawing import part_path
from drop_physics.recording.rrd import Chunk
from drop_physics.seen.events import Body, Model, Pose
from drop_physics.seen.history import Seen


@dataclass
class Part:
    """A link that is drawn, as it looks for a time, and its poses."""

    number: int
    """The body's."""
    models: tuple[Model, ...] = ()
    times_s: list[float] = field(default_factory=list)
    poses: list[Pose | None] = field(default_factory=list)
    """None where its body is gone or looks different, or a number is not finite."""

    def at(self, time_s: float) -> Pose | None:
        """Return its pose at a time; None where it does not exist."""
        row = bisect.bisect_right(self.times_s, time_s + 1e-9) - 1
        return self.poses[row] if row >= 0 else None

    def in_looks(self, looks: Sequence[tuple[float, tuple[Model, ...]]]) -> Iterator[Part]:
        """Yield the same link once for each look, drawn while it looks like that.

        `looks` are in order, each with the time at which it begins [s]; none while it is gone.
        """
        starts_s = [start_s for start_s, _ in looks]
        times_s = sorted({*self.times_s, *starts_s})
        poses = [self.at(time_s) for time_s in times_s]
        rows = [max(bisect.bisect_right(starts_s, time_s) - 1, 0) for time_s in times_s]
        for models in dict.fromkeys(models for _, models in looks):
            seen = [
                pose if looks[row][1] == models else None
                for pose, row in zip(poses, rows, strict=True)
            ]
            yield Part(self.number, models, times_s, seen)


def parts_of(path: Path, seen: Seen) -> list[Part]:
    """Return the links that can be drawn.

    Raises
    ------
    RecordingError
        If the recording is damaged.
    """
    parts = {
        part_path(body, link): Part(body.number)
        for body in seen.bodies.values()
        for link in range(-1, len(body.links) - 1)
    }
    meshes: dict[str, bytes] = {}
    for chunk in chunks_of(path):
        if chunk.entity in parts:
            _add_poses(parts[chunk.entity], chunk, path)
        elif chunk.batch.schema.get_field_index("Asset3D:blob") >= 0:
            meshes[chunk.entity] = _blob(chunk, path)
    looks: dict[str, list[tuple[float, tuple[Model, ...]]]] = {}
    for appearance in seen.appearances:
        for link in range(-1, len(appearance.body.links) - 1):
            models = _models(appearance.body, link, meshes) if appearance.there else ()
            its = looks.setdefault(part_path(appearance.body, link), [])
            its.append((appearance.at.time_s, models))
    drawn = (
        each for entity, part in parts.items() for each in part.in_looks(looks.get(entity, ()))
    )
    return [part for part in drawn if part.models and part.times_s]


def _models(body: Body, link: int, meshes: Mapping[str, bytes]) -> tuple[Model, ...]:
    """Return what is drawn of a link, without the meshes that were not recorded."""
    shapes = [shape for shape in body.shapes if shape.link == link]
    found = [meshes.get(f"{part_path(body, link)}/{number}", b"") for number in range(len(shapes))]
    return tuple(
        Model(shape, mesh, PurePath(shape.file).suffix.lower())
        for shape, mesh in zip(shapes, found, strict=True)
        if mesh or shape.kind != "mesh"
    )


def frames_of_cameras(path: Path) -> dict[int, list[tuple[int, float, bytes]]]:
    """Return the frames of the script's cameras, by camera: step, time [s] and PNG, in order.

    Raises
    ------
    RecordingError
        If the recording is damaged.
    """
    frames: dict[int, list[tuple[int, float, bytes]]] = {}
    properties: dict[str, Properties] = {}
    for chunk in chunks_of(path):
        camera = _CAMERA.fullmatch(chunk.entity)
        if camera is not None:
            images = zip(columns.images(chunk, path), _times_s(chunk), strict=False)
            taken = [(step, time_s, png) for (step, png), time_s in images]
            frames.setdefault(int(camera[1]), []).extend(taken)
        elif chunk.entity.startswith("__properties/"):
            gather(properties, chunk, path)
    closing = closing_of(properties, path)
    digests = []
    for _, taken in sorted(frames.items()):
        digest = FrameDigest()
        for step, _, png in taken:
            digest.update(step, png)
        digests.append(digest.hexdigest())
    frames_sha256 = digests[0] if len(digests) == 1 else digests or None
    if closing is not None and closing.get("frames_sha256") != frames_sha256:
        raise damaged(path, Message("its frames fail their checksum"))
    return {camera: sorted(taken, key=lambda frame: frame[0]) for camera, taken in frames.items()}


_CAMERA = re.compile(r"camera/(\d{1,9})/image")


def _add_poses(part: Part, chunk: Chunk, path: Path) -> None:
    names = "Transform3D:translation", "Transform3D:quaternion"
    if any(chunk.batch.schema.get_field_index(name) < 0 for name in names):
        return
    positions, orientations = (
        _numbers(chunk, name, width, path) for name, width in zip(names, (3, 4), strict=True)
    )
    for time_s, position, orientation in zip(
        _times_s(chunk), positions.tolist(), orientations.tolist(), strict=True
    ):
        row = bisect.bisect_right(part.times_s, time_s)
        part.times_s.insert(row, time_s)
        is_there = np.isfinite([*position, *orientation]).all()
        part.poses.insert(row, (tuple(position), tuple(orientation)) if is_there else None)


def _times_s(chunk: Chunk) -> list[float]:
    index = chunk.batch.schema.get_field_index(schema.TIME_TIMELINE)
    if index < 0:
        return [0.0] * chunk.batch.num_rows
    times = chunk.batch.column(index).cast(pa.int64()).to_numpy(zero_copy_only=False)
    return [float(value) for value in times / 1e9]


def _numbers(chunk: Chunk, name: str, width: int, path: Path) -> NDArray[np.float64]:
    values = chunk.batch.column(chunk.batch.schema.get_field_index(name)).to_pylist()
    numbers = np.array([row[0] for row in values], dtype=np.float64)
    if numbers.shape != (len(values), width):
        raise damaged(path, wrong_count(chunk.entity, width, name))
    return numbers


def _blob(chunk: Chunk, path: Path) -> bytes:
    cell = chunk.batch.column(chunk.batch.schema.get_field_index("Asset3D:blob"))[0].as_py()
    try:
        return bytes(cell[0])
    except (TypeError, IndexError, ValueError):
        what = Message("{entity} must hold a mesh", entity=chunk.entity)
        raise damaged(path, what) from None
