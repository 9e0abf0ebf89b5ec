"""Writes recordings: converts arrays to Rerun's chunks, and chunks to a file.

A recording is a stream of chunks. `record` writes them one by one to `RUN.rrd.part`, adds the
viewer's layout, verifies the file, and only then renames it.
"""

from __future__ import annotations

import functools
import json
import os
import shutil
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import rerun as rr
import rerun.blueprint as rrb
import rerun_bindings
from numpy.typing import NDArray
from rerun.chunk import Chunk, LazyChunkStream

from drop_physics.arrays import Flags, Float64, Int64
from drop_physics.errors import check_signals
from drop_physics.files.outputs import output_errors
from drop_physics.recording import schema
from drop_physics.recording.sealing import seal, unfinished
from drop_physics.recording.step_frames import PackedFrames
from drop_physics.scenario import Camera
from drop_physics.temporary import temporary_folder
from drop_physics.trace.events import At, Calls, Impulses
from drop_physics.trace.frames import ModelPart
from drop_physics.trace.states import Rows

__all__ = ["Chunk"]  # for the stages, which pass chunks on and use nothing else of Rerun

CURVE_WIDTH = 2.0
"""Line width of a curve in the viewer [points]."""
PICTURE_DISTANCE = {"standard": 0.225, "close": 0.6, "follow": 0.6}
"""Distance of a camera's image from the camera in the view, as a share of the target's distance."""

ROOM_BYTES = 1 << 25
"""Free disk space needed [bytes], in addition to the size of the recording written so far:
finishing makes a copy, and data in memory are smaller than the file or than this."""

Value = float | int | str | bool | Sequence[float]
_SAVING = threading.Lock()


@np.errstate(all="ignore")  # what is not finite, or too large for a picture, is recorded as it is
def record(
    path: Path,
    chunks: Iterable[Chunk],
    *,
    recording_id: str,
    blueprint: rrb.Blueprint | Callable[[], rrb.Blueprint] | None,
    on_top: bool = False,
    force: bool = False,
    ours: bool = False,
    salvage: bool = True,
    verified: bool = True,
    note: Callable[[str], None] = lambda _: None,
    full: Callable[[], None] | None = None,
) -> None:
    """Write chunks to a recording, and rename it once it is complete and verified.

    Parameters
    ----------
    path
        The recording to write.
    chunks
        The chunks in order, requested one by one.
    recording_id
        The recording's id; the viewer shows files with the same id as one recording.
    blueprint
        The viewer's layout, or a function that returns it after the last chunk; None for no layout.
    on_top
        Whether the file will be opened together with a recording, to replace the recording's
        layout.
    force, ours, salvage, note
        Passed on to `sealing.unfinished`.
    verified
        Whether the file is read back before it gets its final name; otherwise, damage is noticed
        when the file is read later.
    full
        A function that is called after each chunk once the disk has little more space than
        finishing the file takes; it should end the source of the chunks.

    Raises
    ------
    OutputError
        For the reasons of `unfinished`, or if the verification fails.
    """
    rows: dict[str, int] = {}
    due = rows if verified else None
    kept = unfinished(path, force=force, ours=ours, salvage=salvage, note=note)
    with kept as part, strict():
        _stream(part, chunks, rows, recording_id, full)
        if blueprint is None:
            seal(part, path, blueprint=None, rows=due, force=force or ours)
            return
        with temporary_folder() as folder:
            layout = folder / "layout.rbl"
            layout_of = blueprint if isinstance(blueprint, rrb.Blueprint) else blueprint()
            # Rerun keeps the stream that it saved with, and two threads that never sleep for long.
            # If one thread cleans up while another saves, both wait forever.
            with output_errors(layout), _SAVING:
                layout_of.save(schema.APPLICATION_ID, str(layout))
                rerun_bindings.flush_and_cleanup_orphaned_recordings()
            seal(part, path, blueprint=layout, on_top=on_top, rows=due, force=force or ours)


def _stream(
    part: Path,
    chunks: Iterable[Chunk],
    rows: dict[str, int],
    recording_id: str,
    full: Callable[[], None] | None,
) -> None:
    """Write chunks to a file one by one, and count the `rows` of each entity."""
    failures: list[BaseException] = []

    def counted() -> Iterator[Chunk]:
        # Rerun would turn any exception into a RuntimeError. Ending the stream instead gives the
        # `.part` its footer, and keeps the exception's type.
        try:
            for chunk in chunks:
                check_signals()
                if full is not None and _is_short_of_room(part):
                    full()
                rows[chunk.entity_path] = rows.get(chunk.entity_path, 0) + chunk.num_rows
                yield chunk
        except BaseException as failure:  # noqa: BLE001 - raised again below
            failures.append(failure)

    try:
        LazyChunkStream.from_iter(counted()).write_rrd(
            part, application_id=schema.APPLICATION_ID, recording_id=recording_id
        )
    except RuntimeError as failure:  # also from a signal that comes between two chunks
        check_signals()
        if str(failure).startswith("KeyboardInterrupt"):
            raise KeyboardInterrupt from None
        raise
    if failures:
        raise failures[0]


def _is_short_of_room(part: Path) -> bool:
    """Return whether the disk has too little space to finish a growing file."""
    return shutil.disk_usage(part.parent).free < 2 * part.stat().st_size + ROOM_BYTES


@contextmanager
def strict() -> Iterator[None]:
    """Make invalid calls of Rerun raise errors instead of losing data with a warning.

    The context affects the whole process: if several threads record, enter it around all of them.
    """
    strict, switch = rr.strict_mode(), os.environ.get("RERUN")
    rr.set_strict_mode(True)
    os.environ["RERUN"] = "on"
    try:
        yield
    finally:
        rr.set_strict_mode(strict)
        if switch is None:
            os.environ.pop("RERUN", None)  # another thread may have removed it
        else:
            os.environ["RERUN"] = switch


# -- chunks ---------------------------------------------------------------------------------------


def named(chunks: Iterable[Chunk], name: str) -> Iterator[Chunk]:
    """Yield chunks; insert the recording's name and start time after the first.

    Both are stored in the same place as by Rerun's `send_recording_name` and
    `send_recording_start_time_nanos`.
    """
    info = rr.archetypes.RecordingInfo.columns(name=[name], start_time=[time.time_ns()])
    for number, chunk in enumerate(chunks):
        yield chunk
        if number == 0:
            yield _static("__properties", info)


def property_chunk(name: str, values: Mapping[str, Value | None]) -> Chunk:
    """Return a chunk with a property of the recording; values of None are left out."""
    given: dict[str, Any] = {
        key: _typed(value) for key, value in values.items() if value is not None
    }
    return Chunk.from_property(name, rr.AnyValues(**given))


def _typed(value: Value) -> pa.Array:
    # Arrow, because Rerun would guess a type, and keep it for the rest of the process.
    return pa.array([value] if isinstance(value, str) else np.atleast_1d(np.asarray(value)))


def lens_chunk(camera: Camera) -> Chunk:
    """Return a chunk with a camera's lens."""
    width, height = camera.size_px
    focal = camera.focal_length_px
    image_from_camera = [[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]]
    return _static(
        schema.CAMERA,
        rr.Pinhole.columns(
            image_from_camera=[np.array(image_from_camera)],
            resolution=[[width, height]],
            camera_xyz=[rr.ViewCoordinates.RUB.coordinates],
            image_plane_distance=[PICTURE_DISTANCE[camera.view] * camera.distance_m],
            color=[0x9AA4AFFF],
        ),
    )


def camera_chunk(steps: Int64 | None, timestep_s: float, world_from_camera: Float64) -> Chunk:
    """Return a chunk of camera poses, shape (n, 4, 4), at the given steps, or of a static pose."""
    return Chunk.from_columns(
        schema.CAMERA,
        [] if steps is None else times(at(steps, timestep_s)),
        rr.Transform3D.columns(
            translation=world_from_camera[:, :3, 3], mat3x3=world_from_camera[:, :3, :3]
        ),
    )


def document_chunk(entity: str, markdown: str) -> Chunk:
    """Return a chunk with a text document."""
    return _static(entity, rr.TextDocument.columns(text=[markdown], media_type=["text/markdown"]))


@functools.cache
def curve_style_chunk(entity: str, name: str, colour: str, *, width: float = CURVE_WIDTH) -> Chunk:
    """Return a chunk with a curve's style: name with unit, colour as `#rrggbb`, and width."""
    return _static(
        entity, rr.SeriesLines.columns(names=[name], colors=[rgba(colour)], widths=[width])
    )


def rgba(colour: str) -> int:
    """Convert a colour given as `#rrggbb` to Rerun's integer for it, fully opaque."""
    return int(colour.removeprefix("#") + "ff", 16)


class Times(NamedTuple):
    """The steps and simulated times of a chunk's rows."""

    steps: Int64
    """Steps, shape (n,)."""
    times_s: Float64
    """Simulated times, shape (n,)."""
    calls: Int64 | None = None
    """Number of calls that the script had made, for the timeline of calls."""

    def only(self, which: Flags | Int64) -> Times:
        """Return the times of the selected rows."""
        calls = None if self.calls is None else self.calls[which]
        return Times(self.steps[which], self.times_s[which], calls)


def times_of(at: At) -> Times:
    """Return a moment as the times of a single row."""
    return Times(np.array([at.step]), np.array([at.time_s]), np.array([at.call]))


def times(at: Times) -> list[rr.TimeColumn]:
    """Return the timelines of rows: step and simulated time."""
    columns = [
        rr.TimeColumn(schema.STEP_TIMELINE, sequence=at.steps),
        rr.TimeColumn(
            schema.TIME_TIMELINE, duration=np.clip(at.times_s, -schema.LONGEST_S, schema.LONGEST_S)
        ),
    ]
    if at.calls is not None:
        columns.append(rr.TimeColumn(schema.CALL_TIMELINE, sequence=at.calls))
    return columns


def scalars_chunk(
    entity: str, at: Times, values: Float64, beside: Mapping[str, NDArray[Any]] | None = None
) -> Chunk:
    """Return a chunk of values, shape (n, k), as k curves, with further numbers `beside`."""
    count, width = values.shape
    columns = rr.Scalars.columns(scalars=np.ascontiguousarray(values).reshape(-1))
    more = [_list_column(name, each, np.arange(count + 1)) for name, each in (beside or {}).items()]
    return Chunk.from_columns(entity, times(at), [*columns.partition([width] * count), *more])


def series_chunk(entity: str, names: Sequence[str], *, stepped: bool = False) -> Chunk:
    """Return a chunk that names curves; `stepped` if a value lasts until the next."""
    named = rr.SeriesLines.columns(names=list(names)).partition([len(names)])
    if not stepped:
        return _static(entity, named)
    lines = rr.SeriesLines.columns(
        widths=[CURVE_WIDTH / 2], interpolation_mode=[rr.components.InterpolationMode.StepAfter]
    )
    return Chunk.from_columns(entity, [], [*named, *lines])


def calls_chunk(seen: Calls, widths: Int64) -> Chunk:
    """Return a chunk of calls, one row per step: call sites, and all numbers concatenated.

    `widths` contains how many numbers each call has.
    """
    first = np.unique(seen.steps, return_index=True)[1]
    bounds, ends = np.append(first, len(seen.steps)), np.cumsum([0, *widths])
    starts = seen.calls[first]
    at = Times(seen.steps[first], seen.times_s[first], starts)
    within = seen.calls - np.repeat(starts, np.diff(bounds))  # small numbers, which pack well
    columns = [
        _list_column(name, values, bounds)
        for name, values in (("site", seen.sites), ("after", within), ("result", seen.results))
    ]
    numbers = _Arrow(pa.array(np.ascontiguousarray(seen.numbers)))
    columns.append(rr.ComponentColumn("numbers", numbers, offsets=ends[bounds].astype(np.int32)))
    columns.append(
        rr.ComponentColumn(
            "client",
            _Arrow(pa.array(np.full(len(first), seen.client, np.int64))),
            offsets=np.arange(len(first) + 1, dtype=np.int32),
        )
    )
    return Chunk.from_columns(schema.CALLS, times(at), columns)


def impulses_chunk(seen: Impulses) -> Chunk:
    """Return a chunk of impulses, one row per step: causes and impulses."""
    ends = np.cumsum([0, *seen.counts.tolist()])
    widths = np.cumsum([0, *seen.widths.tolist()])
    one = np.arange(len(seen.steps) + 1)
    columns = [
        _list_column("status", seen.status, one),
        _list_column("remainder", seen.remainder, one),
        rr.ComponentColumn(
            "cause",
            _Arrow(pa.array(np.ascontiguousarray(seen.causes))),
            offsets=ends.astype(np.int32),
        ),
        rr.ComponentColumn(
            "impulse",
            _Arrow(pa.array(np.ascontiguousarray(seen.values))),
            offsets=widths.astype(np.int32),
        ),
    ]
    entity = f"{schema.IMPULSES}/{seen.client}"
    return Chunk.from_columns(entity, times(Times(seen.steps, seen.times_s)), columns)


def model_chunk(part: ModelPart) -> Chunk:
    """Return a chunk with a part of a compiled model."""
    said = {name: value for name, value in vars(part).items() if name != "data"}
    columns = [
        _lists_column(schema.JSON, [[json.dumps(said)]]),
        _lists_column("data", [np.frombuffer(part.data, np.uint8)]),
    ]
    at = Times(np.array([part.number]), np.zeros(1), np.array([part.at]))
    return Chunk.from_columns(schema.MODELS, times(at), columns)


def steps_chunk(entity: str, at: Times, rows: Sequence[PackedFrames]) -> Chunk:
    """Return a chunk with the replay frames of batches of steps, one row each."""
    columns = [
        _lists_column(schema.JSON, [[row.layout] for row in rows]),
        _lists_column("numbers", [row.numbers for row in rows]),
        _lists_column("at", [row.at for row in rows]),
        _lists_column("answers", [np.frombuffer(row.answers, np.uint8) for row in rows]),
    ]
    return Chunk.from_columns(entity, times(at), columns)


def _lists_column(component: str, rows: Sequence[Any]) -> rr.ComponentColumn:
    """Return a column that has a list in each row."""
    offsets = np.cumsum([0, *map(len, rows)]).astype(np.int32)
    values = _Arrow(pa.array(np.concatenate(rows)))
    return rr.ComponentColumn(component, values, offsets=offsets)


def texts_chunk(entity: str, at: Times, texts: Sequence[str]) -> Chunk:
    """Return a chunk with rows of JSON, one per time."""
    offsets = np.arange(len(texts) + 1, dtype=np.int32)
    column = rr.ComponentColumn(schema.JSON, _Arrow(pa.array(texts)), offsets=offsets)
    return Chunk.from_columns(entity, times(at), [column])


def at(steps: Int64, timestep_s: float) -> Times:
    """Return the times of a drop's steps."""
    return Times(steps, np.asarray(steps * timestep_s, dtype=np.float64))


def rows_chunk(table: schema.Table, rows: Rows, at: Times) -> Chunk:
    """Return a chunk of rows as lists, one per step and component; `at` has each step once."""
    bounds = np.append(first_of_steps(rows), len(rows))
    columns = [_list_column(name, rows[name], bounds) for name in table.components]
    return Chunk.from_columns(table.entity, times(at), columns)


def first_of_steps(rows: Rows) -> Int64:
    """Return the index of each step's first row, for rows sorted by step."""
    steps = rows["step"]
    return np.flatnonzero(np.concatenate(([True], steps[1:] != steps[:-1])))


def _list_column(component: str, values: NDArray[Any], bounds: Int64) -> rr.ComponentColumn:
    """Return a column of values, shape (n,) or (n, k), as the lists between `bounds`."""
    # Arrow keeps the array alive, so it must not be part of a larger one.
    flat = pa.array(np.ascontiguousarray(values).reshape(-1))
    offsets = (bounds * (values.size // len(values))).astype(np.int32)
    return rr.ComponentColumn(component, _Arrow(flat), offsets=offsets)


class _Arrow:
    """A component with a type of its own, for each entity.

    Rerun's own types would be the same in every entity.
    """

    def __init__(self, values: pa.Array) -> None:
        self._values = values

    def as_arrow_array(self) -> pa.Array:
        return self._values


def curve_chunk(
    entity: str, steps: Int64, timestep_s: float, values: Float64, *, resolution: float
) -> Chunk:
    """Return a chunk with a curve's points, float64, from `values` of shape (n,).

    Of parts that are constant within `resolution`, only the end points are kept, which the viewer
    connects by a straight line.
    """
    kept = noticed(values.reshape(-1, 1), resolution)
    return scalars_chunk(entity, at(steps[kept], timestep_s), values[kept, None])


def noticed(values: Float64, resolution: float) -> Flags:
    """Flag the values at the start and end of changes, and the first and the last value.

    `values` has the shape (n, k), or (m, n, k) for m curves at the same times.
    """
    marks = np.round(values / resolution)
    changes = (marks[..., 1:, :] != marks[..., :-1, :]).any(axis=-1)
    edge = np.ones((*changes.shape[:-1], 1), np.bool_)
    begins, ends = ((edge, changes), (changes, edge))
    kept: Flags = np.concatenate(begins, axis=-1) | np.concatenate(ends, axis=-1)
    return kept


def _static(entity: str, columns: rr.ComponentColumnList) -> Chunk:
    return Chunk.from_columns(entity, [], columns)
