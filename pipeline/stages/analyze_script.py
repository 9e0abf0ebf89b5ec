"""Read a script's recording back, and explain what each of its bodies did."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.analysis.script.analysis import script_analysis_of
from pipeline.analysis.script.results import ScriptAnalysis
from pipeline.analysis.script.times import Times
from pipeline.errors import ScenarioError
from pipeline.files.table import write_table
from pipeline.recording.contents import check_of_script
from pipeline.recording.script_layer import write_script_layer
from pipeline.recording.script_reader import read_script
from pipeline.seen import Seen, body_named
from pipeline.stages.analyze import ANALYZING, outputs_of
from pipeline.stages.narrative import findings_listed

if TYPE_CHECKING:
    from pipeline.recording.drop import Progress  # its module loads Rerun

DEFAULT_AT_S = (0.3,)
"""When flights are broken down besides at their ends, unless other times are given."""


def analyze_script(
    recording: Path | str,
    *,
    at_s: Sequence[float] = (),
    body: str | None = None,
    out: Path | str | None = None,
    table: Path | str | None = None,
    force: bool = False,
    progress: Progress = lambda *_: None,
) -> ScriptAnalysis:
    """Analyze the recording of a script, and write the layer that shows the analysis beside it.

    Parameters
    ----------
    recording
        The recording to read.
    at_s
        Times [s] at which flights under way are broken down, besides at their ends; by default
        0.3 s.
    body
        The only body to report, by name or number; None for all. The layer shows all.
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
        If the recording is missing, damaged or not that of a script.
    ScenarioError
        If there is no such body, a time is outside the recording, or a file has another suffix.
    OutputError
        If a file cannot be written, or would replace what the same command reads or writes.
    """
    path = Path(recording)
    layer, tables = outputs_of(path, out, table, force=force)
    progress(ANALYZING, 0, 3)
    check_of_script(path, otherwise="analyze")
    read_back = read_script(path)
    progress(ANALYZING, 1, 3)
    ended = read_back.ended or {}
    origin = read_back.origin | {name: ended.get(name) for name in ("ended", "error")}
    analysis = script_analysis_of(read_back.seen, origin, at_s=at_s or DEFAULT_AT_S)
    _check_times(at_s, read_back.seen, analysis)
    reported = analysis
    if body is not None:
        reported = analysis.of_body(body_named(read_back.seen.bodies.values(), body).number)
    progress(ANALYZING, 2, 3)
    write_script_layer(
        layer,
        read_back.recording_id,
        samples=analysis.table,
        linked={body.label for body in analysis.bodies if len(body.links) > 1},
        events=sorted(_events(analysis)),
        findings="\n".join(_findings(analysis)),
        force=force,
        ours=out is None,
    )
    for file in tables:
        write_table(file, analysis.table, force=force)
    progress(ANALYZING, 3, 3)
    return replace(reported, recording=path, layer=layer, partial=read_back.partial)


def _check_times(at_s: Sequence[float], seen: Seen, analysis: ScriptAnalysis) -> None:
    """Raise an error if a given time is not within any simulation."""
    clients = {setting.client for setting in seen.settings}
    ends_s = [Times(seen, client).of(seen.samples.get(client, 1) - 1) for client in clients]
    # Time may go back, where a timestep is below 0.
    end_s = max([0.0, *ends_s, *analysis.table["time_s"].drop_nulls()])
    for time_s in at_s:
        if not 0 <= time_s <= end_s * (1 + 1e-12):
            raise ScenarioError(
                "--at must lie within the recording, 0 to {end:g} s, got {time:g}",
                end=end_s,
                time=time_s,
            )


def _events(analysis: ScriptAnalysis) -> Iterator[tuple[int, float, str]]:
    times_s = dict(analysis.table.select("step", "time_s").unique().iter_rows())
    for finding in analysis.findings:
        step = finding.step
        if step is not None and step in times_s:
            yield step, times_s[step], f"{finding.code}: {finding.message}"
    for body in analysis.bodies:
        for contact in body.contacts:
            others = ", ".join(sorted({partner.body for partner in contact.by}))
            yield contact.first_step, contact.start_s, f"{body.label} meets {others}"


def _findings(analysis: ScriptAnalysis) -> Iterator[str]:
    explained = analysis.explained
    yield (
        f"{explained['samples']:,} of {explained['of']:,} samples of bodies without joints are "
        "explained, step by step."
    )
    yield ""
    yield from findings_listed(analysis.findings)
