"""`drop analyze` on a long recording, against polars on the same states in Parquet."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from drop_physics.recording.reader import read

from benchmarks.harness import DROP, PYTHON, Measured, paired, process

POLARS = """
import polars as pl
table = pl.read_parquet("state.parquet").with_columns(time_s=pl.col("step") / 240)
free_fall = 1.0 - 9.81 / 2 * pl.col("time_s") ** 2
print(table.with_columns(error_m=pl.col("z_m") - free_fall)["error_m"].abs().max())
"""


def measure(folder: Path, *, quick: bool) -> Iterator[Measured]:
    """Compare whole processes."""
    steps = 100_000 if quick else 1_000_000
    process(*DROP, "simulate", "--no-camera", "--out", "run.rrd", "--duration", f"{steps}/240",
            folder=folder)  # fmt: skip
    read(folder / "run.rrd").states.write_parquet(folder / "state.parquet")
    ratios, detail = paired(
        lambda: process(*DROP, "analyze", "run.rrd", folder=folder),
        lambda: process(*PYTHON, POLARS, folder=folder),
        pairs=3 if quick else 7,
    )
    yield Measured(
        f"`drop analyze`, {steps:.0e} steps", "polars: Parquet, free fall, error", ratios, 4,
        detail=detail,
    )  # fmt: skip
