"""Writes the analysis layer: the results that `analyze` adds, in a file beside the recording.

The layer has the same recording id, so that the viewer shows both files as one recording.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import rerun as rr
from rerun.chunk import Chunk

from drop_physics import colours
from drop_physics.arrays import Float64, Int64
from drop_physics.recording import pictures, schema, writer
from drop_physics.recording.drawing import SHOWN_PER_S
from drop_physics.recording.layer_sums import sums_chunks
from drop_physics.recording.layout import Look, eye_around, layout, look_of_drop, series_of
from drop_physics.recording.reader import Recording
from drop_physics.recording.scene import parts_of, reach_of
from drop_physics.recording.writer import Times
from drop_physics.trace.sums import LaterSums

if TYPE_CHECKING:
    import polars as pl


ERROR_CURVES = {
    "error_m": ("total", colours.TOTAL_IN_VIEWER),
    **{f"{name}_m": (name, colour) for name, colour in colours.TERMS.items()},
}
"""Name under `error/` and colour of the curve for each column of a drop's table."""

ENERGY_CURVES = {
    "kinetic_linear_j": ("kinetic", colours.KINETIC),
    "kinetic_angular_j": ("rotation", colours.ROTATION),
    "potential_j": ("potential", colours.POTENTIAL),
    "energy_j": ("total", colours.TOTAL_IN_VIEWER),
}
"""Name under `energy/` and colour of the curve for each column of a drop's table."""

WIDE = 3.0
"""Line width of a total, which is the sum of the other curves [points]."""

MOST_STATES = 40
"""Largest number of bodies whose states are shown; more would be illegible."""


class Line(NamedTuple):
    """A curve in a panel."""

    name: str
    colour: str
    """Colour as `#rrggbb`."""
    width: float
    steps: Int64
    """Step of each value, shape (n,), as `times_s` [s] and `values`."""
    times_s: Float64
    values: Float64


class ShownBody(NamedTuple):
    """A body's results at its n samples, as the viewer shows them."""

    label: str
    at: Times
    segments: Sequence[str]
    """Segment of each sample, such as flight."""
    errors_m: Float64
    """Deviation from free fall, shape (n, 3); nan outside flight."""


class Shown(NamedTuple):
    """A script's analysis, as the viewer shows it."""

    samples: Sequence[ShownBody] = ()
    """The results of each body at its samples."""

    panels: Sequence[tuple[str, Sequence[Line]]] = ()
    """Titles and curves of the panels, in order."""
    bodies: Sequence[str] = ()
    """Labels of the relevant bodies, in order."""
    touched: frozenset[str] = frozenset()
    """Labels of the bodies whose collision shapes are shown."""


def write_layer(
    path: Path,
    recording: Recording,
    *,
    samples: pl.DataFrame | None,
    events: Sequence[tuple[int, float, str]],
    findings: str,
    look: Shown,
    sums: LaterSums | None = None,
    force: bool,
    ours: bool,
) -> None:
    """Write the analysis layer: kinds of samples, errors, energies, findings.

    Parameters
    ----------
    path
        The file to write.
    recording
        The analysed recording.
    samples
        The analysis table of a drop, with null for values that are not shown; None for a script.
    events
        Events in order, each as step, time [s] and a line of text.
    findings
        The findings, as Markdown.
    look
        The results of a script that are shown.
    sums
        Impulses computed after recording, in this analysis or an earlier one.
    force, ours
        Passed on to `files.whole.replaced`.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    if samples is not None:
        chunks = [*_of_drop(recording.scenario.timestep_s, samples)]
    else:
        chunks = [*_of_bodies(look), *_of_panels(look)]
    if events:
        steps, times_s, lines = zip(*events, strict=True)
        at = Times(np.array(steps, np.int64), np.array(times_s))
        chunks.append(pictures.log(schema.EVENTS, at, [(line, False) for line in lines]))
    chunks.append(writer.document_chunk(schema.FINDINGS, findings))
    shown = recording.entities | {chunk.entity_path.removeprefix("/") for chunk in chunks}
    writer.record(
        path,
        chunks if sums is None else itertools.chain(chunks, sums_chunks(sums)),
        recording_id=recording.recording_id,
        blueprint=layout(_look(recording, shown, look)),
        on_top=True,
        force=force,
        ours=ours,
        salvage=False,
    )


def _look(recording: Recording, entities: frozenset[str], shown: Shown) -> Look:
    if recording.drop is not None:
        camera = recording.camera
        return look_of_drop(recording.scenario.height_m, camera.view if camera else None, entities)
    errors = {entity: 3 for entity in entities if entity.startswith(f"{schema.ERROR_MM}/")}
    return Look(
        eye_around(*reach_of(parts_of(recording.path, recording.seen))),
        entities,
        series=series_of(recording.seen.bodies.values()) | errors,
        order={
            f"{schema.SEGMENTS}/{label}": at - len(shown.bodies)
            for at, label in enumerate(shown.bodies)
        },
        panels=[title for title, _ in shown.panels],
        touched=shown.touched,
    )


# -- of a drop: the terms of its error, and its energies ------------------------------------------


def _of_drop(timestep_s: float, samples: pl.DataFrame) -> Iterator[Chunk]:
    import polars as pl

    explained = samples.filter(pl.col("timestep_m").is_not_null())
    steps = explained["step"].to_numpy()
    at = writer.at(steps, timestep_s)
    for column, (name, colour) in ERROR_CURVES.items():
        number, curve = f"{schema.ERROR}/{name}", f"{schema.ERROR_MM}/{name}"
        values_m = explained[column].to_numpy()
        width = WIDE if name == "total" else writer.CURVE_WIDTH
        yield writer.curve_style_chunk(number, f"{name} [m]", colour, width=width)
        yield writer.curve_style_chunk(curve, f"{name} [mm]", colour, width=width)
        if len(steps):
            yield writer.scalars_chunk(number, at, values_m[:, None])
            yield writer.scalars_chunk(curve, at, values_m[:, None] * 1e3)
    steps = samples["step"].to_numpy()
    largest_j = samples.select(pl.max_horizontal(pl.col(*ENERGY_CURVES).abs().max())).item()
    resolution_j = schema.ENERGY_RESOLUTION * (largest_j or 1.0)
    for column, (name, colour) in ENERGY_CURVES.items():
        entity, values_j = f"{schema.ENERGY}/{name}", samples[column].to_numpy()
        width = WIDE if name == "total" else writer.CURVE_WIDTH
        yield writer.curve_style_chunk(entity, f"{name} [J]", colour, width=width)
        yield writer.curve_chunk(entity, steps, timestep_s, values_j, resolution=resolution_j)


# -- of a script's bodies: kinds of samples, errors of flights ------------------------------------


def _of_bodies(shown: Shown) -> Iterator[Chunk]:
    order = {label: at - len(shown.bodies) for at, label in enumerate(shown.bodies)}
    ordered = sorted(shown.samples, key=lambda body: order.get(body.label, 0))
    for body in ordered[:MOST_STATES]:
        yield from _states(body)
    for body in shown.samples:
        if not np.isnan(body.errors_m[:, 2]).all():
            yield from _errors(body)


def _of_panels(shown: Shown) -> Iterator[Chunk]:
    """Yield the curves of all panels; curves with the same samples share an entity."""
    for number, (_, drawn) in enumerate(shown.panels):
        together = groupby(drawn, key=lambda line: line.steps.tobytes())
        for part, (_, group) in enumerate(together):
            lines, entity = [*group], f"{schema.PANELS}/{number}/{part}"
            named = rr.SeriesLines.columns(
                names=[line.name for line in lines],
                colors=np.array([writer.rgba(line.colour) for line in lines], np.uint32),
                widths=[line.width for line in lines],
            )
            yield Chunk.from_columns(entity, [], named.partition([len(lines)]))
            values = np.stack([line.values for line in lines], axis=1)
            yield writer.scalars_chunk(entity, Times(lines[0].steps, lines[0].times_s), values)


def _errors(body: ShownBody) -> Iterator[Chunk]:
    """Yield curves of a body's deviation from free fall, interrupted between flights."""
    entity = f"{schema.ERROR_MM}/{body.label}"
    yield writer.series_chunk(entity, [f"{body.label} {axis}" for axis in "xyz"])
    flies = ~np.isnan(body.errors_m[:, 2])
    due = np.floor(body.at.times_s * SHOWN_PER_S + 1e-9)
    turns = np.diff(np.concatenate(([False], flies, [False])))
    shown = (flies & (np.diff(due, prepend=-1) != 0)) | turns[1:] | turns[:-1]
    yield writer.scalars_chunk(entity, body.at.only(shown), body.errors_m[shown] * 1e3)


def _states(body: ShownBody) -> Iterator[Chunk]:
    """Yield the states of one body, one row per change."""
    entity = f"{schema.SEGMENTS}/{body.label}"
    names = list(colours.SEGMENTS)
    yield Chunk.from_columns(
        entity,
        [],
        rr.StateConfiguration.columns(
            values=names,
            labels=names,
            colors=[writer.rgba(colour) for colour in colours.SEGMENTS.values()],
        ).partition([len(names)]),
    )
    segments = np.array(body.segments)
    changes = np.flatnonzero(np.append(True, segments[1:] != segments[:-1]))
    yield Chunk.from_columns(
        entity,
        writer.times(body.at.only(changes)),
        rr.StateChange.columns(state=segments[changes].tolist()),
    )
