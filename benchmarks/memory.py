"""Peak memory of `drop simulate --no-camera`, by the number of steps."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from benchmarks.harness import DROP, Measured, process


def measure(folder: Path, *, quick: bool) -> Iterator[Measured]:
    """Measure the peak resident memory."""
    for steps in (5_000,) if quick else (100_000, 1_000_000, 10_000_000):
        ran = process(
            *DROP,
            "simulate",
            "--no-camera",
            "--force",
            "--out",
            "run.rrd",
            "--duration",
            f"{steps}/240",
            folder=folder,
        )
        yield Measured(
            f"`drop simulate --no-camera`, {steps:.0e} steps: peak memory",
            "",
            [ran.peak_mb],
            300,
            unit="MB",
            detail=f"{ran.wall_s:.1f} s",
        )
