"""The analysis layer: what `analyze` adds to a recording, in a file beside it.

It carries the recording's own id, so that the viewer shows both files as one recording.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import polars as pl
from rerun.chunk import Chunk

from pipeline import colours
from pipeline.errors import RecordingError
from pipeline.recording import schema, writer
from pipeline.recording.blueprint import layout
from pipeline.recording.reader import Recording, entities

ERROR_CURVES = {
    "error_m": ("total", colours.TOTAL_IN_VIEWER),
    **{f"{name}_m": (name, colour) for name, colour in colours.TERMS.items()},
}
"""Column of the analysis table -> its name under `error/`, and its colour."""

ENERGY_CURVES = {
    "kinetic_linear_j": ("kinetic", colours.KINETIC),
    "kinetic_angular_j": ("rotation", colours.ROTATION),
    "potential_j": ("potential", colours.POTENTIAL),
    "energy_j": ("total", colours.TOTAL_IN_VIEWER),
}
"""Column of the analysis table -> its name under `energy/`, and its colour."""

WIDE = 3.0
"""Width of a total, the sum of the others [points]."""

_TOP = {
    schema.ERROR, schema.ERROR_MM, schema.ENERGY, schema.ENERGIES, schema.EVENTS, schema.FINDINGS,
    schema.SEGMENTS,
}  # fmt: skip
"""First parts of a layer's entity paths."""


def layer_of(recording: Path) -> Path:
    """Return the layer's name beside a recording: `run.rrd` has `run.analysis.rrd`."""
    return recording.with_name(recording.name.removesuffix(".rrd") + ".analysis.rrd")


def is_layer(path: Path) -> bool:
    """Whether a file is an analysis layer and nothing else."""
    try:
        return all(entity.split("/")[0] in _TOP for entity in entities(path))
    except RecordingError:
        return False


def write_layer(
    path: Path,
    recording: Recording,
    *,
    samples: pl.DataFrame,
    events: Sequence[tuple[int, str]],
    findings: str,
    force: bool,
    ours: bool,
) -> None:
    """Write the layer, whole or not at all: error terms, energies, events and findings.

    Parameters
    ----------
    path
        The file to write.
    recording
        The recording it belongs to.
    samples
        The analysis table, one row per sample; null where there is no number to show.
    events
        What happened: steps in order, with a line each.
    findings
        The findings, as Markdown.
    force, ours
        As for `files.replaced`.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    scenario, camera = recording.scenario, recording.camera
    writer.record(
        path,
        _chunks(scenario.timestep_s, samples, events, findings),
        recording_id=recording.recording_id,
        blueprint=layout(
            height_m=scenario.height_m, camera=camera.view if camera else None, analysis=True
        ),
        force=force,
        ours=ours,
        salvage=False,
    )


def _chunks(
    timestep_s: float, samples: pl.DataFrame, events: Sequence[tuple[int, str]], findings: str
) -> Iterator[Chunk]:
    explained = samples.filter(pl.col("timestep_m").is_not_null())
    steps = explained["step"].to_numpy()
    for column, (name, colour) in ERROR_CURVES.items():
        number, curve = f"{schema.ERROR}/{name}", f"{schema.ERROR_MM}/{name}"
        values_m = explained[column].to_numpy()
        width = WIDE if name == "total" else writer.CURVE_WIDTH
        yield writer.curve_style_chunk(number, f"{name} [m]", colour, width=width)
        yield writer.curve_style_chunk(curve, f"{name} [mm]", colour, width=width)
        if len(steps):
            yield writer.numbers_chunk(number, steps, timestep_s, values_m)
            yield writer.numbers_chunk(curve, steps, timestep_s, values_m * 1e3)
    steps = samples["step"].to_numpy()
    largest_j = samples.select(pl.max_horizontal(pl.col(*ENERGY_CURVES).abs().max())).item()
    resolution_j = schema.ENERGY_RESOLUTION * (largest_j or 1.0)
    for column, (name, colour) in ENERGY_CURVES.items():
        entity = f"{schema.ENERGY}/{name}"
        width = WIDE if name == "total" else writer.CURVE_WIDTH
        yield writer.curve_style_chunk(entity, f"{name} [J]", colour, width=width)
        yield writer.curve_chunk(
            entity,
            steps,
            timestep_s,
            samples[column].to_numpy(),
            resolution=resolution_j,
        )
    if events:
        event_steps, lines = zip(*events, strict=True)
        yield writer.event_chunk(schema.EVENTS, event_steps, timestep_s, lines)
    yield writer.document_chunk(schema.FINDINGS, findings)
