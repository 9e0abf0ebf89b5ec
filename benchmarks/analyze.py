"""`drop analyze` of a long recording and of many bodies, against polars on the same numbers."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from drop_physics.recording.reader import read

from benchmarks.growth import SCENE, boxes
from benchmarks.harness import DROP, PYTHON, Measured, paired, process

POLARS = """
import polars as pl
table = pl.read_parquet("state.parquet").with_columns(time_s=pl.col("step") / 240)
free_fall = 1.0 - 9.81 / 2 * pl.col("time_s") ** 2
print(table.with_columns(error_m=pl.col("z_m") - free_fall)["error_m"].abs().max())
"""
SUMS = """
import polars as pl
for name in ("states.parquet", "contacts.parquet"):
    print(pl.read_parquet(name).sum())
"""


def measure(folder: Path, *, quick: bool) -> Iterator[Measured]:
    """Compare whole processes."""
    steps = 100_000 if quick else 1_000_000
    process(
        *DROP,
        "simulate",
        "--no-camera",
        "--out",
        "run.rrd",
        "--duration",
        f"{steps}/240",
        folder=folder,
    )
    read(folder / "run.rrd").states.write_parquet(folder / "state.parquet")
    ratios, detail = paired(
        lambda: process(*DROP, "analyze", "run.rrd", folder=folder),
        lambda: process(*PYTHON, POLARS, folder=folder),
        pairs=3 if quick else 7,
    )
    yield Measured(
        f"`drop analyze`, {steps:.0e} steps",
        "polars: Parquet, free fall, error",
        ratios,
        6,
        detail=detail,
    )
    steps = 1_000 if quick else 10_000
    (folder / "scene.py").write_text(SCENE.format(load=boxes(100)), encoding="utf-8")
    process(*DROP, "record", "--out", "boxes.rrd", "scene.py", steps, folder=folder)
    seen = read(folder / "boxes.rrd").seen
    seen.states.write_parquet(folder / "states.parquet")
    seen.contacts.write_parquet(folder / "contacts.parquet")
    ratios, detail = paired(
        lambda: process(*DROP, "analyze", "--force", "boxes.rrd", folder=folder),
        lambda: process(*PYTHON, SUMS, folder=folder),
        pairs=3,
    )
    yield Measured(
        f"`drop analyze`, 100 bodies × {steps:,} steps",
        "polars: the same numbers from Parquet",
        ratios,
        5,
        detail=detail,
    )
