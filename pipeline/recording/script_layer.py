"""The analysis layer of a script's recording: each sample's kind, as states on the timeline."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from pathlib import Path

import numpy as np
import polars as pl
import rerun as rr
import rerun.blueprint as rrb
from rerun.chunk import Chunk

from pipeline import colours
from pipeline.recording import pictures, schema, writer
from pipeline.recording.script import FARTHEST_M
from pipeline.recording.script_layout import MOST_NAMES, world_view
from pipeline.recording.writer import Times

MOST_STATES = 40
"""Bodies whose states are shown: more are illegible."""
SHOWN_PER_S = 60
_SHOWN = (pl.col("time_s") * SHOWN_PER_S + 1e-9).floor()
DUE = _SHOWN.shift(1, fill_value=-1) != _SHOWN
"""Whether a point of a curve is due."""


def write_script_layer(
    path: Path,
    recording_id: str,
    *,
    samples: pl.DataFrame,
    linked: Collection[str],
    events: Sequence[tuple[int, float, str]],
    findings: str,
    force: bool,
    ours: bool,
) -> None:
    """Write the layer, whole or not at all.

    Parameters
    ----------
    path
        The file to write.
    recording_id
        Of the recording that it belongs to.
    samples
        The analysis table: a row per sample and body.
    linked
        Labels of the bodies with links, whose energies the recording does not show.
    events
        What happened: step, time [s] and a line each, in order.
    findings
        The findings, as Markdown.
    force, ours
        As for `files.replaced`.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    bodies = samples.partition_by("label", maintain_order=True)
    flying = [body for body in bodies if body["error_z_m"].count()]
    writer.record(
        path,
        _chunks(bodies, flying, linked, events, findings),
        recording_id=recording_id,
        blueprint=_layout(_world(samples), flying=len(flying)),
        force=force,
        ours=ours,
        salvage=False,
    )


def _chunks(
    bodies: Sequence[pl.DataFrame],
    flying: Sequence[pl.DataFrame],
    linked: Collection[str],
    events: Sequence[tuple[int, float, str]],
    findings: str,
) -> Iterator[Chunk]:
    for body in bodies[:MOST_STATES]:
        yield from _states(body)
    for body in bodies:
        label = body["label"][0]
        known = body.filter(pl.col("energy_j").is_not_null())
        if label in linked and len(known):
            yield pictures.curve_names(f"{schema.ENERGIES}/{label}", [label])
            shown = known.filter(DUE)
            energies_j = shown["energy_j"].to_numpy()[:, None]
            yield pictures.curves(f"{schema.ENERGIES}/{label}", _times(shown), [energies_j])
    for body in flying:
        entity = f"{schema.ERROR_MM}/{body['label'][0]}"
        yield pictures.curve_names(entity, [f"{body['label'][0]} {axis}" for axis in "xyz"])
        # Also the ends of each flight, and the gap after it.
        in_flight = pl.col("error_z_m").is_not_null()
        shown = body.filter(
            (in_flight & DUE)
            | (in_flight != in_flight.shift(1, fill_value=False))
            | (in_flight != in_flight.shift(-1, fill_value=False))
        )
        errors_mm = shown.select("error_x_m", "error_y_m", "error_z_m").to_numpy() * 1e3
        yield pictures.curves(entity, _times(shown), [errors_mm])
    if events:
        steps, times_s, lines = zip(*events, strict=True)
        at = Times(np.array(steps, np.int64), np.array(times_s))
        yield pictures.log(schema.EVENTS, at, [(line, False) for line in lines])
    yield writer.document_chunk(schema.FINDINGS, findings)


def _states(body: pl.DataFrame) -> Iterator[Chunk]:
    """Yield the states of one body, a row per change."""
    label = body["label"][0]
    entity = f"{schema.SEGMENTS}/{label}"
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
    changes = body.filter(pl.col("segment") != pl.col("segment").shift(1, fill_value=""))
    yield Chunk.from_columns(
        entity,
        writer.times(_times(changes)),
        rr.StateChange.columns(state=changes["segment"].to_list()),
    )


def _times(rows: pl.DataFrame) -> Times:
    return Times(rows["step"].to_numpy(), rows["time_s"].to_numpy())


def _world(samples: pl.DataFrame) -> rrb.Spatial3DView:
    """Return the view of the scene, ignoring what has flown off."""
    positions_m = samples.select("x_m", "y_m", "z_m").to_numpy()
    positions_m = positions_m[np.isfinite(positions_m).all(axis=1)]
    if not len(positions_m):
        return world_view(np.zeros(3), np.zeros(3))
    away_m = np.abs(positions_m - np.median(positions_m, axis=0)).max(axis=1)
    near_m = positions_m[away_m <= max(FARTHEST_M, away_m.min())]
    return world_view(near_m.min(axis=0), near_m.max(axis=0))


def _layout(world: rrb.Spatial3DView, *, flying: int) -> rrb.Blueprint:
    states = rrb.StateTimelineView(origin=schema.SEGMENTS, name="What each body does")
    curves: list[rrb.View] = [states]
    if flying:
        # Errors start at zero, lower left, and grow.
        legend = rrb.PlotLegend(rrb.Corner2D.LeftTop, visible=3 * flying <= MOST_NAMES)
        name = "Simulated minus free fall [mm], from the start of each flight"
        errors = rrb.TimeSeriesView(origin=schema.ERROR_MM, name=name, plot_legend=legend)
        curves.append(errors)
    energies = rrb.TimeSeriesView(origin=schema.ENERGIES, name="Energies [J]")
    heights = rrb.TimeSeriesView(
        origin=schema.HEIGHT,
        name="Heights of free bodies [m]",
        plot_legend=rrb.PlotLegend(rrb.Corner2D.RightTop),
    )
    log = rrb.TextLogColumns(timeline_columns=[schema.TIME_TIMELINE], text_log_columns=["body"])
    texts = rrb.Vertical(
        rrb.TextDocumentView(origin=schema.FINDINGS, name="Findings"),
        rrb.Tabs(
            rrb.TextLogView(origin=schema.EVENTS, name="Events", columns=log),
            rrb.TextLogView(origin=schema.CALLS, name="Calls", columns=log),
            rrb.TextDocumentView(origin=schema.ABOUT, name="About"),
        ),
        row_shares=[3, 2],
    )
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(world, rrb.Tabs(heights, energies), row_shares=[3, 2]),
            rrb.Vertical(*curves),
            texts,
            column_shares=[3, 4, 3],
        ),
        rrb.TimePanel(
            timeline=schema.TIME_TIMELINE, state="collapsed", loop_mode="all", play_state="paused"
        ),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
    )
