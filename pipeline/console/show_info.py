"""Say what a recording is, in some ten lines."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pipeline.console.output import pasteable, print_json, print_lines, titled
from pipeline.messages import shell_command

if TYPE_CHECKING:
    from pipeline.stages.info import Info

COLUMN = 12
MOST_BODIES = 6
"""Bodies that are told; all are in the JSON."""


def show_info(info: Info, *, as_json: bool) -> None:
    """Print what a recording is."""
    if as_json:
        print_json(info.as_json())
    else:
        print_lines(*info_lines(info))


def info_lines(info: Info) -> list[str]:
    """Say what a recording is."""
    state = "whole, as it was written" if info.complete else "never finished, unverified"
    more = len(info.bodies) - MOST_BODIES
    bodies = [*info.bodies[:MOST_BODIES], *([f"and {more:,} more: see --json"] if more > 0 else [])]
    touching = f"{info.contact_samples:,} of them in contact" if info.contact_samples else ""
    times = f"{info.samples:,} in {info.duration_s:.9g} s"
    told = {
        "recording": f"{info.recording}, {info.bytes / 1e3:,.0f} kB, {state}",
        info.kind: info.what,
        "bodies": "; ".join(bodies) or "none",
        "samples": f"{times}, {touching}" if touching else times,
        "frames": f"{info.frames:,}" if info.frames else "none",
        "engine": info.engine,
        "id": info.recording_id,
    }
    lines = []
    for title, words in told.items():
        lines += titled(title, words, column=COLUMN, style="dim")
    if info.command is not None:
        lines += pasteable("again", info.command, column=COLUMN, style="dim")
    if info.layer is not None:
        return lines + titled("analysis", str(info.layer), column=COLUMN, style="dim")
    analyze = f"none yet: {shell_command('drop', 'analyze', info.recording)}"
    return lines + pasteable("analysis", analyze, column=COLUMN, style="dim")
