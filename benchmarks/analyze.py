"""`drop analyze` of a long recording and of many bodies, against the simulation itself."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

from benchmarks.growth import SCENE, boxes
from benchmarks.harness import DROP, Measured, process, worked

BOX = 'p.loadURDF("cube_small.urdf", [0, 0, 0.03])'


def measure(folder: Path, *, quick: bool) -> Iterator[Measured]:
    """Compare the processor time of whole processes."""
    script, share = folder / "scene.py", 10 if quick else 1
    steps = 10_000 // share
    script.write_text(SCENE.format(load=boxes(100)), encoding="utf-8")
    process(*DROP, "record", "--out", "boxes.rrd", script, steps, folder=folder)
    ratios, detail = worked(
        lambda: process(*DROP, "analyze", "--force", "boxes.rrd", folder=folder),
        lambda: process(sys.executable, script, steps, folder=folder),
        pairs=3,
    )
    yield Measured(
        f"`drop analyze`, 100 boxes × {steps:,} steps: processor time",
        "the bare script",
        ratios,
        1.5,
        detail=detail,
    )
    ratios, detail = worked(
        lambda: process(*DROP, "check", "boxes.rrd", "--against", "boxes.rrd", folder=folder),
        lambda: process(*DROP, "info", "boxes.rrd", folder=folder),
        pairs=3,
    )
    yield Measured(
        f"`drop check`, 100 boxes × {steps:,} steps, twice: processor time",
        "`drop info`, which reads it once",
        ratios,
        2.0,
        detail=detail,
    )
    steps = 1_000_000 // share
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
