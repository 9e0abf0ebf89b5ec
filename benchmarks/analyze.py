"""`drop analyze` of long recordings and of many bodies: time against simulation, and memory."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

from benchmarks.growth import SCENE, boxes
from benchmarks.harness import DROP, Measured, process, worked

BOX = 'p.loadURDF("cube_small.urdf", [0, 0, 0.03])'


def measure(folder: Path, *, quick: bool) -> Iterator[Measured]:
    """Compare the processor time of whole processes, and the memory of short and long runs."""
    script, steps = folder / "scene.py", 100 if quick else 10_000
    script.write_text(SCENE.format(load=boxes(100)), encoding="utf-8")
    process(*DROP, "record", "--out", "boxes.rrd", script, steps, folder=folder)
    ratios, detail = worked(
        lambda: process(*DROP, "analyze", "--force", "boxes.rrd", folder=folder),
        lambda: process(sys.executable, script, steps, folder=folder),
        pairs=1 if quick else 3,
    )
    yield Measured(
        f"`drop analyze`, 100 boxes × {steps:,} steps: processor time",
        "the bare script",
        ratios,
        2.0,
        detail=detail,
    )
    ratios, detail = worked(
        lambda: process(*DROP, "check", "boxes.rrd", "--against", "boxes.rrd", folder=folder),
        lambda: process(*DROP, "info", "boxes.rrd", folder=folder),
        pairs=1 if quick else 3,
    )
    yield Measured(
        f"`drop check`, 100 boxes × {steps:,} steps, twice: processor time",
        "`drop info`, which reads it once",
        ratios,
        2.0,
        detail=detail,
    )
    if quick:
        return
    steps = 1_000_000
    script.write_text(SCENE.format(load=BOX), encoding="utf-8")
    record = (*DROP, "record", "--force", "--out", "box.rrd", script, steps)
    process(*record, folder=folder)
    ratios, detail = worked(
        lambda: process(*DROP, "analyze", "--force", "box.rrd", folder=folder),
        lambda: process(*record, folder=folder),
        pairs=3,
    )
    yield Measured(
        f"`drop analyze`, a box, {steps:.0e} steps: processor time",
        "`drop record` of it",
        ratios,
        0.8,
        detail=detail,
    )
    for what, load, lengths in (
        ("a box", BOX, (10_000, 100_000)),
        ("100 boxes", boxes(100), (2_000, 10_000)),
    ):
        script.write_text(SCENE.format(load=load), encoding="utf-8")
        short, long = (_analyzed_mb(folder, script, steps) for steps in lengths)
        yield Measured(
            f"`drop analyze`, {what}, {lengths[1]:,} steps: peak memory",
            f"{lengths[0]:,} steps",
            [long / short],
            1.1,
            detail=f"{long:.0f} over {short:.0f} MB",
        )


def _analyzed_mb(folder: Path, script: Path, steps: int) -> float:
    """Return the peak memory of analyzing a script that makes this number of steps."""
    process(*DROP, "record", "--force", "--out", "run.rrd", script, steps, folder=folder)
    return process(*DROP, "analyze", "--force", "run.rrd", folder=folder).peak_mb
