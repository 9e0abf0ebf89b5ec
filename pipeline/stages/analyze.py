"""Read a recording back and explain each millimetre of its error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.analysis.drop.analysis import analysis_of
from pipeline.analysis.drop.results import Analysis
from pipeline.errors import check_suffix
from pipeline.files.outputs import check_apart, check_target, refused
from pipeline.files.table import check_table, write_table
from pipeline.messages import Message
from pipeline.recording.contents import check_of_drop, is_script
from pipeline.recording.layer import is_layer, layer_of, write_layer
from pipeline.recording.reader import read
from pipeline.stages.narrative import events, findings_markdown

if TYPE_CHECKING:
    from pipeline.recording.drop import Progress  # its module loads Rerun

__all__ = ["analyze", "is_script"]

ANALYZING = Message("analyzing")
_PARTS = 3
"""Reading the recording, breaking the error down, writing the results."""


def analyze(
    recording: Path | str,
    *,
    at_s: Sequence[float] = (),
    out: Path | str | None = None,
    table: Path | str | None = None,
    force: bool = False,
    progress: Progress = lambda *_: None,
) -> Analysis:
    """Analyze a recording, and write the layer that shows the analysis beside it.

    Parameters
    ----------
    recording
        The recording to read.
    at_s
        Times at which to break the error down [s]; by default 0.3 s, if that is in the air.
    out
        The layer recording to write; None puts it beside the recording.
    table
        A `.parquet` or `.csv` file for the table of all samples, or None.
    force
        Whether existing files may be replaced; a layer under its default name always is.
    progress
        Called while it runs.

    Raises
    ------
    RecordingError
        If the recording is missing, damaged or not one of ours.
    ScenarioError
        If a time is outside the recording, or a file has another suffix.
    OutputError
        If a file cannot be written, or would replace what the same command reads or writes.
    """
    path = Path(recording)
    layer, tables = outputs_of(path, out, table, force=force)
    progress(ANALYZING, 0, _PARTS)
    check_of_drop(path, otherwise="analyze_script")
    read_back = read(path)
    progress(ANALYZING, 1, _PARTS)
    analysis = analysis_of(
        read_back.scenario, read_back.engine, read_back.states, read_back.contacts, at_s=at_s
    )
    progress(ANALYZING, 2, _PARTS)
    write_layer(
        layer,
        read_back,
        samples=analysis.table,
        events=events(analysis),
        findings=findings_markdown(analysis),
        force=force,
        ours=out is None,
    )
    for file in tables:
        write_table(file, analysis.table, force=force)
    progress(ANALYZING, _PARTS, _PARTS)
    return replace(analysis, recording=path, layer=layer, partial=read_back.partial)


def outputs_of(
    recording: Path, out: Path | str | None, table: Path | str | None, *, force: bool
) -> tuple[Path, list[Path]]:
    """Return the layer and the tables to write, once it is checked that they can be.

    Raises
    ------
    ScenarioError
        If a file has another suffix.
    OutputError
        If a file cannot be written, or would replace what the same command reads or writes.
    """
    layer = layer_of(recording) if out is None else Path(out)
    tables = [] if table is None else [Path(table)]
    check_apart([layer, *tables], inputs=[recording])
    check_target(layer, force=force or out is None)
    check_suffix("--out", layer, (".rrd",))
    if out is None and not force and layer.is_file() and not is_layer(layer):
        raise refused(layer)
    for file in tables:
        check_table(file, force=force)
    return layer, tables
