"""The report of `drop info`: a recording in about ten lines."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from drop_physics.messages import Message, joined, shell_command
from drop_physics.report.blocks import Fact, Facts, Report, Section
from drop_physics.report.words import NONE, RECORDING, SCRIPT

if TYPE_CHECKING:
    from drop_physics.stages.info import Info
    from drop_physics.trace.readings import Reading

COLUMN = 12
MOST_BODIES, MOST_READINGS = 6, 4
"""Most bodies, and most source lines with readings, listed; the JSON contains all."""


def _readings(info: Info) -> Message:
    """Describe the script line that reads most values: what it reads, and how often."""
    most = sorted(info.readings, key=lambda reading: -reading.count)
    return _first_of([_reading(each) for each in most], MOST_READINGS)


def _first_of(parts: Sequence[str], most: int) -> Message:
    """List the first of several texts, and say how many more there are."""
    shown, more = [*parts[:most]], len(parts) - most
    if more > 0:
        shown.append(Message("and {more:,} more: see --json", more=more))
    values = {f"part{number}": part for number, part in enumerate(shown)}
    # Of parts, not of sentences: `joined` would end each as one where the language does.
    template = "; ".join(f"{{{name}}}" for name in values)
    return Message(template, **values)


def _reading(place: Reading) -> Message:
    flags = ", ".join(f"{name}={value}" for name, value in place.flags.items())
    read = f"{place.function}({flags})" if flags else place.function
    site = f"{place.file}:{place.line}"
    if place.exact:
        return Message("{read} at {site}, {n:,} times", read=read, site=site, n=place.count)
    return Message("{read} at {site}, some {n:,} times", read=read, site=site, n=place.count)


def report_of(info: Info) -> Report:
    """Report the contents of a recording."""
    state = (
        Message("complete; numbers and frames verified, not its layout")
        if info.complete
        else Message("never finished, unverified")
    )
    samples = Message(
        "{samples:,} in {duration:.9g} s", samples=info.samples, duration=info.duration_s
    )
    if info.contact_samples:
        touching = Message("{samples:,} of them in contact", samples=info.contact_samples)
        samples = joined(", ", [samples, touching])
    facts: dict[Message, str] = {
        RECORDING: Message(
            "{recording}, {kilobytes:,.0f} kB, {state}",
            recording=str(info.recording),
            kilobytes=info.bytes / 1e3,
            state=state,
        ),
        Message("drop") if info.kind == "drop" else SCRIPT: info.what,
        Message("bodies"): _first_of(info.bodies, MOST_BODIES) if info.bodies else NONE,
        Message("samples"): samples,
        Message("frames"): f"{info.frames:,}" if info.frames else NONE,
        **({Message("reads"): _readings(info)} if info.readings else {}),
        **({Message("lacks"): joined("; ", info.notes)} if info.notes else {}),
        Message("engine"): info.engine,
        Message("id"): info.recording_id,
    }
    rows = [Fact(title, words, "dim") for title, words in facts.items()]
    if info.command is not None:
        rows.append(Fact(Message("repeat"), info.command, "dim", is_command=True))
        if info.kind == "script" and " -m " not in info.command:
            where = Message("run it in the script's folder, which is not recorded")
            rows.append(Fact("", where, "dim"))
    analyze = shell_command("drop", "analyze", info.recording)
    layer = (
        Message("none yet: {analyze}", analyze=analyze) if info.layer is None else str(info.layer)
    )
    rows.append(Fact(Message("analysis"), layer, "dim", is_command=info.layer is None))
    view = shell_command("drop", "view", info.recording)
    return Report(
        sections=[Section([Facts(rows, COLUMN)])], next=[] if info.layer is None else [view]
    )
