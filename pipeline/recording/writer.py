"""Put a drop into a recording: the only file that turns our arrays into Rerun's chunks.

A recording is a stream of chunks. `record` writes them one by one into `RUN.rrd.part`, adds the
viewer's layout, verifies the whole, and only then gives it its name.
"""

from __future__ import annotations

import functools
import os
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray
from rerun.chunk import Chunk, LazyChunkStream

from pipeline import colours
from pipeline.recording import schema
from pipeline.recording.files import seal, unfinished
from pipeline.scenario import Camera

Float64 = NDArray[np.float64]
Steps = NDArray[np.int64]
__all__ = ["Chunk"]  # for the stages, which hand chunks on and know nothing else of Rerun

PICTURE_DISTANCE = {"standard": 0.225, "close": 0.6, "follow": 0.6}
"""How far before the camera its picture is shown, as a share of the way to what it looks at."""

Value = float | int | str | bool | Sequence[float]


def record(
    path: Path,
    chunks: Iterable[Chunk],
    *,
    recording_id: str,
    blueprint: rrb.Blueprint | None,
    force: bool = False,
    ours: bool = False,
    salvage: bool = True,
    note: Callable[[str], None] = lambda _: None,
) -> None:
    """Write chunks to a recording that has its name only when it is whole and verified.

    Parameters
    ----------
    path
        The recording to write.
    chunks
        What goes into it, in this order; asked for one by one.
    recording_id
        Files of one id open as one recording.
    blueprint
        The viewer's layout; None leaves it out, and the file is verified without another program.
    force, ours, salvage, note
        As for `unfinished`.

    Raises
    ------
    OutputError
        As for `unfinished`; if the file fails verification.
    """
    rows: dict[str, int] = {}
    failures: list[BaseException] = []

    def counted() -> Iterator[Chunk]:
        # Rerun would turn any exception into a RuntimeError. Ending the stream instead leaves a
        # `.part` with a footer, and the exception its type.
        try:
            for chunk in chunks:
                rows[chunk.entity_path] = rows.get(chunk.entity_path, 0) + chunk.num_rows
                yield chunk
        except BaseException as failure:  # noqa: BLE001 - raised again below
            failures.append(failure)

    kept = unfinished(path, force=force, ours=ours, salvage=salvage, note=note)
    with kept as part, _strict():
        LazyChunkStream.from_iter(counted()).write_rrd(
            part, application_id=schema.APPLICATION_ID, recording_id=recording_id
        )
        if failures:
            raise failures[0]
        if blueprint is None:
            seal(part, path, blueprint=None, rows=rows, force=force or ours)
            return
        with tempfile.TemporaryDirectory() as folder:
            layout = Path(folder, "layout.rbl")
            blueprint.save(schema.APPLICATION_ID, str(layout))
            seal(part, path, blueprint=layout, rows=rows, force=force or ours)


@contextmanager
def _strict() -> Iterator[None]:
    """Make a bad call raise, where Rerun only warns and loses the data; overrule `RERUN=off`."""
    strict, switch = rr.strict_mode(), os.environ.get("RERUN")
    rr.set_strict_mode(True)
    os.environ["RERUN"] = "on"
    try:
        yield
    finally:
        rr.set_strict_mode(strict)
        if switch is None:
            del os.environ["RERUN"]
        else:
            os.environ["RERUN"] = switch


# -- chunks ---------------------------------------------------------------------------------------


def property_chunk(name: str, values: Mapping[str, Value | None]) -> Chunk:
    """Return a property of the recording; a value of None is left out."""
    given: dict[str, Any] = {
        key: _typed(value) for key, value in values.items() if value is not None
    }
    return Chunk.from_property(name, rr.AnyValues(**given))


def _typed(value: Value) -> pa.Array:
    # Arrow, because Rerun would guess a type otherwise, and keep to it for the rest of the process.
    return pa.array([value] if isinstance(value, str) else np.atleast_1d(np.asarray(value)))


def scene_chunks(camera: Camera | None, half_size_m: Float64, *, floor: bool) -> Iterator[Chunk]:
    """Yield what does not change in the 3-D view: axes, floor, the box's size, the camera's lens.

    Parameters
    ----------
    camera
        The camera, or None where no frames are taken.
    half_size_m
        Half the body's extent along its own axes [m], shape (3,).
    floor
        Whether there is a floor.
    """
    z_up = rr.ViewCoordinates.RIGHT_HAND_Z_UP
    yield _static(schema.WORLD, rr.ViewCoordinates.columns(xyz=[z_up.coordinates]))
    if floor:
        yield _static(
            schema.FLOOR,
            rr.Boxes3D.columns(
                half_sizes=[[0.75, 0.75, 0.005]],
                centers=[[0.0, 0.0, -0.005]],
                colors=[0x8A93A0FF],
                fill_mode=[rr.components.FillMode.Solid],
            ),
        )
    yield _static(
        schema.BOX,
        rr.Boxes3D.columns(
            half_sizes=[half_size_m],
            colors=[_rgba(colours.SIMULATED)],
            fill_mode=[rr.components.FillMode.Solid],
        ),
    )
    if camera is not None:
        width, height = camera.size_px
        focal = camera.focal_length_px
        image_from_camera = [[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]]
        yield _static(
            schema.CAMERA,
            rr.Pinhole.columns(
                image_from_camera=[np.array(image_from_camera)],
                resolution=[[width, height]],
                camera_xyz=[rr.ViewCoordinates.RUB.coordinates],
                image_plane_distance=[PICTURE_DISTANCE[camera.view] * camera.distance_m],
                color=[0x9AA4AFFF],
            ),
        )


def camera_chunk(steps: Steps | None, timestep_s: float, world_from_camera: Float64) -> Chunk:
    """Return where the camera stands at these steps, or always; its poses, shape (n, 4, 4)."""
    return Chunk.from_columns(
        schema.CAMERA,
        [] if steps is None else _times(steps, timestep_s),
        rr.Transform3D.columns(
            translation=world_from_camera[:, :3, 3], mat3x3=world_from_camera[:, :3, :3]
        ),
    )


def document_chunk(entity: str, markdown: str) -> Chunk:
    """Return a text document."""
    return _static(entity, rr.TextDocument.columns(text=[markdown], media_type=["text/markdown"]))


@functools.cache
def curve_style_chunk(entity: str, name: str, colour: str, *, width: float = 2.0) -> Chunk:
    """Return how a curve is drawn: its name with unit, its colour as `#rrggbb`, its width."""
    return _static(
        entity, rr.SeriesLines.columns(names=[name], colors=[_rgba(colour)], widths=[width])
    )


def _rgba(colour: str) -> int:
    return int(colour.removeprefix("#") + "ff", 16)


def state_chunks(steps: Steps, timestep_s: float, rows: Float64) -> Iterator[Chunk]:
    """Yield samples of state: float64 scalars to measure by, and the box's pose to look at.

    Parameters
    ----------
    steps
        Step numbers, shape (n,).
    timestep_s
        Timestep [s].
    rows
        State, shape (n, 16 + 13 for each further link), in the order of `schema.state_columns`.
    """
    times = _times(steps, timestep_s)
    first = 0
    links = (rows.shape[1] - len(schema.state_columns(0))) // len(schema.LINK_STATE)
    for entity, columns in schema.state_entities(links).items():
        width = len(columns)
        values = rows[:, first : first + width]
        yield Chunk.from_columns(
            entity,
            times,
            rr.Scalars.columns(scalars=values.ravel()).partition([width] * len(steps)),
        )
        first += width
    seen = _noticed(rows[:, :7], schema.POSE_RESOLUTION)
    yield Chunk.from_columns(
        schema.BOX,
        _times(steps[seen], timestep_s),
        rr.Transform3D.columns(translation=rows[seen, 0:3], quaternion=rows[seen, 3:7]),
    )


def numbers_chunk(entity: str, steps: Steps, timestep_s: float, values: Float64) -> Chunk:
    """Return one scalar per step, shape (n,), float64."""
    return Chunk.from_columns(entity, _times(steps, timestep_s), rr.Scalars.columns(scalars=values))


def curve_chunk(
    entity: str, steps: Steps, timestep_s: float, values: Float64, *, resolution: float
) -> Chunk:
    """Return the points of a curve, float64, of which there are `values` of shape (n,).

    Where it is level to within `resolution`, the ends say it all: the viewer draws straight lines.
    """
    seen = _noticed(values.reshape(-1, 1), resolution)
    return numbers_chunk(entity, steps[seen], timestep_s, values[seen])


def _noticed(values: Float64, resolution: float) -> NDArray[np.bool_]:
    """Return which rows of values, shape (n, k), begin or end a change; the first and last do."""
    marks = np.round(values / resolution)
    changes = (marks[1:] != marks[:-1]).any(axis=1)
    return np.concatenate(([True], changes)) | np.concatenate((changes, [True]))


def trail_chunk(steps: Steps, timestep_s: float, positions_m: Float64) -> Chunk:
    """Return points that the body leaves behind [m], shape (n, 3): a stroboscope's picture."""
    n, radius = len(steps), -1.5  # negative: in points of the screen, seen from any distance
    return Chunk.from_columns(
        schema.TRAIL,
        _times(steps, timestep_s),
        rr.Points3D.columns(
            positions=positions_m,
            radii=[radius] * n,
            # As plain numbers three or four colours would be taken for the parts of one.
            colors=np.full(n, _rgba(colours.SIMULATED), dtype=np.uint32),
        ),
    )


def image_chunk(step: int, timestep_s: float, png: bytes) -> Chunk:
    """Return one camera frame."""
    return Chunk.from_columns(
        schema.IMAGE,
        _times(np.array([step]), timestep_s),
        rr.EncodedImage.columns(blob=[png], media_type=["image/png"]),
    )


def event_chunk(
    entity: str, steps: Sequence[int], timestep_s: float, texts: Sequence[str]
) -> Chunk:
    """Return log lines, one per event."""
    return Chunk.from_columns(
        entity,
        _times(np.array(steps), timestep_s),
        rr.TextLog.columns(text=list(texts), level=["INFO"] * len(texts)),
    )


def _static(entity: str, columns: rr.ComponentColumnList) -> Chunk:
    return Chunk.from_columns(entity, [], columns)


def _times(steps: Steps, timestep_s: float) -> list[rr.TimeColumn]:
    return [
        rr.TimeColumn(schema.STEP_TIMELINE, sequence=steps),
        rr.TimeColumn(schema.TIME_TIMELINE, duration=steps * timestep_s),
    ]
