"""What a recording is, in about ten lines."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drop_physics.console.output import pasteable, print_json, print_lines, titled
from drop_physics.console.words import NONE, RECORDING, SCRIPT
from drop_physics.messages import Message, joined, localized, shell_command, translated

if TYPE_CHECKING:
    from drop_physics.stages.info import Info
    from drop_physics.trace.readings import Reading

COLUMN = 12
MOST_BODIES, MOST_READINGS = 6, 4
"""Bodies, and places that read, that are listed; all are in the JSON."""


def show_info(info: Info, *, as_json: bool) -> None:
    """Print what a recording is."""
    if as_json:
        print_json(info.as_json())
    else:
        print_lines(*info_lines(info))


def _readings(info: Info) -> list[str]:
    """Say where the script reads most often, what and how often."""
    most = sorted(info.readings, key=lambda each: -each.count)
    told = [translated(_reading(each)) for each in most[:MOST_READINGS]]
    more = len(most) - MOST_READINGS
    if more > 0:
        told.append(localized("and {more:,} more: see --json", more=more))
    return told


def _reading(place: Reading) -> Message:
    flags = ", ".join(f"{name}={value}" for name, value in place.flags.items())
    read = f"{place.function}({flags})" if flags else place.function
    site = f"{place.file}:{place.line}"
    if place.exact:
        return Message("{read} at {site}, {n:,} times", read=read, site=site, n=place.count)
    return Message("{read} at {site}, some {n:,} times", read=read, site=site, n=place.count)


def info_lines(info: Info) -> list[str]:
    """Say what a recording is."""
    state = (
        Message("complete, verified") if info.complete else Message("never finished, unverified")
    )
    more = len(info.bodies) - MOST_BODIES
    bodies = [*map(translated, info.bodies[:MOST_BODIES])]
    if more > 0:
        bodies.append(localized("and {more:,} more: see --json", more=more))
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
        Message("bodies"): "; ".join(bodies) if bodies else NONE,
        Message("samples"): samples,
        Message("frames"): f"{info.frames:,}" if info.frames else NONE,
        **({Message("reads"): "; ".join(_readings(info))} if info.readings else {}),
        **({Message("lacks"): "; ".join(info.notes)} if info.notes else {}),
        Message("engine"): info.engine,
        Message("id"): info.recording_id,
    }
    lines = [
        line
        for title, words in facts.items()
        for line in titled(title, words, column=COLUMN, style="dim")
    ]
    if info.command is not None:
        lines += pasteable(Message("again"), info.command, column=COLUMN, style="dim")
        if info.kind == "script" and " -m " not in info.command:
            where = localized("where the script is: its folder is not recorded")
            lines += titled("", where, column=COLUMN, style="dim")
    analysis = Message("analysis")
    if info.layer is not None:
        return lines + titled(analysis, str(info.layer), column=COLUMN, style="dim")
    analyze = shell_command("drop", "analyze", info.recording)
    missing = Message("none yet: {analyze}", analyze=analyze)
    return lines + pasteable(analysis, missing, column=COLUMN, style="dim")
