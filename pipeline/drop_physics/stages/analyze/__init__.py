"""The command `analyze`: reads a recording back, and explains what happened in it."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from drop_physics import colours
from drop_physics.analysis.results import Analysis
from drop_physics.analysis.story import Story
from drop_physics.engines.cures import call_of
from drop_physics.errors import ScenarioError, check_suffix
from drop_physics.explain.moments import end_of
from drop_physics.explain.step_status import SEGMENTS
from drop_physics.explain.times import StepTimes
from drop_physics.figures.plot import Plot
from drop_physics.files.outputs import check_apart, check_table, check_target, refused
from drop_physics.messages import Message
from drop_physics.recording.contents import is_script
from drop_physics.recording.layer import Line, ShownBody, write_layer
from drop_physics.recording.layer import Shown as LayerShown
from drop_physics.recording.layer_file import is_layer, layer_of
from drop_physics.recording.reader import Recording, listed, read
from drop_physics.recording.writer import Times
from drop_physics.rules.answer import Finding
from drop_physics.rules.choice import EVERY
from drop_physics.stages import verbs
from drop_physics.stages.analyze.events import events
from drop_physics.stages.analyze.explaining import BY_DEFAULT, explained
from drop_physics.stages.analyze.sources import Sources
from drop_physics.stages.panels import plot_of, viewed
from drop_physics.stages.rerun.trials import Trials
from drop_physics.stages.verbs.taken import takes_those_of
from drop_physics.trace.episodes import Episode, episodes_of, looked_at
from drop_physics.trace.history import Seen, body_named, names_of_body

ANALYZING = Message("analyzing")
_PARTS = 3
"""Number of stages in the progress bar: reading the recording, explaining it, writing results."""
MOST_NAMES = 12
"""Largest number of names listed in an error message."""
DEFAULT_AT_S = (0.3,)
"""Default times [s] at which a flight's error is broken down, in addition to its end."""


@takes_those_of(verbs.AnalyzeArguments)
def analyze(asked: verbs.AnalyzeArguments) -> Analysis:
    """Analyze a recording, and write a layer file beside it that shows the analysis.

    Raises
    ------
    RecordingError
        If the recording is missing, damaged, or was not written by drop.
    ScenarioError
        If there is no such body or joint, a time is outside the recording, or a file's suffix is
        not supported.
    OutputError
        If a file cannot be written, or would replace a file that the same command reads or writes.
    """
    path = Path(asked.recording)
    read_only = asked.out is None and not os.access(path.parent, os.W_OK | os.X_OK)
    layer, tables = outputs_of(path, asked.out, asked.table, force=asked.force, read_only=read_only)
    if not is_script(path) and asked.body is not None:
        raise ScenarioError(
            "--body is for recordings of scripts, and a drop has only one body; omit it"
        )
    asked.progress(ANALYZING, 0, _PARTS)
    read_back = read(path)
    _check_about(asked.about, read_back)
    asked.progress(ANALYZING, 1, _PARTS)
    what = asked.explain or BY_DEFAULT
    episode = _episode(read_back, asked.episode, every=what.whole)
    window = None
    if episode is not None:
        window = end_of(episode, StepTimes(read_back.seen, episode.client))
    later = explained(
        read_back,
        replace(what, at_s=asked.at_s, window=window),
        layer=layer or layer_of(path),
        python=asked.python,
    )
    read_back = later.recording
    sources = Sources.of(read_back, asked.script)
    analysis = analysis_of(
        read_back,
        asked.at_s,
        whole=bool(tables),
        episode=episode,
        about=asked.about,
        reports=lambda finding: (asked.choice or EVERY).reports(
            finding, sources.ignored_at(finding.site)
        ),
    )
    trials = Trials(path, read_back.recording_id)
    analysis = replace(analysis, findings=[*map(trials.with_verdict, analysis.findings)])
    asked.progress(ANALYZING, 2, _PARTS)
    _give_memory_back()
    if layer is not None:
        write_layer(
            layer,
            read_back,
            samples=analysis.table if analysis.kind == "drop" else None,
            events=events(analysis),
            findings=analysis.markdown(),
            look=_shown(analysis, read_back.seen),
            sums=later.sums,
            force=asked.force,
            ours=asked.out is None,
        )
    for file in tables:
        from drop_physics.files.table import write_table  # with Polars, which few need

        write_table(file, analysis.table, force=asked.force)
    asked.progress(ANALYZING, _PARTS, _PARTS)
    if asked.body is not None:
        analysis = analysis.of_body(body_named(read_back.seen.bodies.values(), asked.body).number)
    sites = [finding.site.rpartition(":")[0] for finding in analysis.findings if finding.site]
    notes = [*listed((read_back.ended or {}).get("notes"))]
    notes += [later.note] if later.note is not None else []
    if layer is None:
        folder = str(path.parent)
        notes.append(
            Message("{folder} cannot be written to: no layer for the viewer", folder=folder)
        )
    return replace(
        analysis,
        recording=path,
        sources=sources.files([str(read_back.origin_and_end.get("script")), *sites]),
        layer=layer,
        partial=read_back.partial,
        notes=notes,
        lacks=read_back.lacks,
    )


def _episode(read_back: Recording, number: int | None, *, every: bool) -> Episode | None:
    """Return the episode that the account describes; None for the whole run."""
    if read_back.drop is not None:
        if number is not None:
            raise ScenarioError(
                "--episode is for recordings of scripts, and a drop has no episodes"
            )
        return None
    if number is None and every:
        return None
    return looked_at(episodes_of(read_back.seen), number)


def _check_about(about: str | None, read_back: Recording) -> None:
    """Raise an error unless a body or joint has the name given by `--about`."""
    if about is None:
        return
    if read_back.drop is not None:
        raise ScenarioError(
            "--about is for recordings of scripts, and a drop has one body; omit it"
        )
    names = dict.fromkeys(
        name for body in read_back.seen.bodies.values() for name in names_of_body(body)
    )
    if about not in names:
        raise ScenarioError(
            "--about takes the name of a body, a link, a joint or an actuator, such as {names}; "
            "got {about!r}",
            names=", ".join([*names][:MOST_NAMES]),
            about=about,
        )


def _give_memory_back() -> None:
    """Return freed memory to the operating system before the next part of the analysis."""
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)  # glibc's
    if trim is not None:
        trim(0)


def _hulls(analysis: Analysis) -> frozenset[str]:
    """Return the labels of bodies of which the viewer shows collision hulls."""
    found = (finding.body for finding in analysis.findings if finding.code == "collides-as-hull")
    return frozenset(label for label in found if label is not None)


def analysis_of(
    read_back: Recording,
    at_s: Sequence[float] = (),
    *,
    whole: bool = False,
    episode: Episode | None = None,
    about: str | None = None,
    reports: Callable[[Finding], bool] = lambda _: True,
) -> Analysis:
    """Analyze a recording that has been read, without writing files.

    Parameters
    ----------
    read_back
        The recording.
    at_s
        Times [s] at which errors are broken down, and whose steps are reported as sums.
    whole
        Whether the table has all rows even of a long recording, and columns for joints and terms.
    episode
        The episode whose end the account and the joint tables describe; None for the whole run.
    about
        Name of the body, link, joint or actuator whose rows begin the account; None for no
        preference.
    reports
        A function that returns whether a finding is reported.
    """
    seen = explained(read_back).recording.seen
    if read_back.drop is not None:
        from drop_physics.drop.story import drop_analysis_of  # of drops alone

        of_drop = drop_analysis_of(
            read_back.scenario, read_back.engine, seen, at_s=at_s, whole=whole
        )
        reported = [*filter(reports, of_drop.findings)]
        return replace(of_drop, findings=reported, left_out=len(of_drop.findings) - len(reported))
    _check_times(at_s, seen)
    return Story(
        seen,
        read_back.origin_and_end,
        at_s=at_s or DEFAULT_AT_S,
        sums_at_s=at_s,
        whole=whole,
        episode=episode,
        about=about,
        call_of=call_of(seen.engine),
        reports=reports,
    ).analysis()


def plot_of_recording(recording: Path) -> Plot:
    """Read and analyze a recording, and return its plot."""
    return plot_of(analysis_of(read(recording)))


def _shown(analysis: Analysis, seen: Seen) -> LayerShown:
    """Return what the viewer shows of a script's analysis."""
    if analysis.kind == "drop":
        return LayerShown()
    widths = {"line": 2.0, "broad": 3.0, "wide": 4.0, "dashed": 1.0}
    panels, bodies = viewed(analysis, seen.bodies)
    lines = [
        [
            Line(
                str(curve.name),
                curve.colour or colours.TOTAL_IN_VIEWER,
                widths[curve.look],
                curve.steps,
                curve.times_s,
                curve.values,
            )
            for curve in panel.curves
            if len(curve.steps)
        ]
        for panel in panels
    ]
    titles = [f"{panel.title} [{panel.unit}]" for panel in panels]
    samples = [
        ShownBody(
            row.body.label,
            Times(row.columns["step"], row.columns["time_s"]),
            [SEGMENTS[segment] for segment in row.columns["segment"].tolist()],
            np.stack([row.columns[f"error_{axis}_m"] for axis in "xyz"], axis=1),
        )
        for row in analysis.rows
    ]
    return LayerShown(samples, [*zip(titles, lines, strict=True)], bodies, _hulls(analysis))


def outputs_of(
    recording: Path,
    out: Path | str | None,
    table: Path | str | None,
    *,
    force: bool,
    read_only: bool = False,
) -> tuple[Path | None, list[Path]]:
    """Return the paths of the layer and of the tables, after checking that they are writable.

    If the recording's folder is read-only, no layer is written.

    Raises
    ------
    ScenarioError
        If a file's suffix is not supported.
    OutputError
        If a file cannot be written, or would replace a file that the same command reads or writes.
    """
    layer = layer_of(recording) if out is None else Path(out)
    tables = [] if table is None else [Path(table)]
    check_apart([layer, *tables], inputs=[recording])
    if not read_only:
        check_target(layer, force=force or out is None)
    check_suffix("--out", layer, (".rrd",))
    if out is None and not force and layer.is_file() and not is_layer(layer):
        raise refused(layer)
    for file in tables:
        check_table(file, force=force)
    return None if read_only else layer, tables


def _check_times(at_s: Sequence[float], seen: Seen) -> None:
    """Raise an error if a given time is outside the range of every simulation."""
    clients = {setting.client for setting in seen.settings}
    ends_s = [StepTimes(seen, client).of(seen.steps_of(client)) for client in clients]
    # Time may go back, where a timestep is below 0.
    told_s = [each.at.time_s for each in seen.settings]
    end_s = max([0.0, *ends_s, *told_s])
    for time_s in at_s:
        if not 0 <= time_s <= end_s * (1 + 1e-12):
            raise ScenarioError(
                "--at must lie within the recording, 0 to {end:g} s, got {time:g}",
                end=end_s,
                time=time_s,
            )
