"""Say what a recording is, in some ten lines."""

from __future__ import annotations

import shlex
from typing import TYPE_CHECKING

from pipeline.console.output import print_json, print_lines, titled

if TYPE_CHECKING:
    from pipeline.stages.info import Info

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
    analyze = shlex.join(["drop", "analyze", str(info.recording)])
    told = {
        "recording": f"{info.recording}, {info.bytes / 1e3:,.0f} kB, {state}",
        info.kind: info.what,
        "bodies": "; ".join(bodies) or "none",
        "samples": f"{times}, {touching}" if touching else times,
        "frames": f"{info.frames:,}" if info.frames else "none",
        "engine": info.engine,
        "id": info.recording_id,
        "again": info.command,
        "analysis": f"{info.layer}" if info.layer else f"none yet: {analyze}",
    }
    lines = []
    for title, words in told.items():
        if words is not None:
            lines += titled(title, words, column=12, style="dim")
    return lines
