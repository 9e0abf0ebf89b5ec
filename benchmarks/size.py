"""Bytes per step in a recording, in flight and at rest."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from benchmarks.harness import DROP, Measured, process


def measure(folder: Path, *, quick: bool) -> Iterator[Measured]:
    """Divide the size of long recordings without frames by their steps."""
    steps = 20_000 if quick else 200_000
    goals_b = {"in flight": 160, "at rest, creeping and turning": 240}
    flight = ("--gravity", "zero", "--linear-damping", "0", "--velocity", "0.1,0.2,1")
    for what, options in (("in flight", flight), ("at rest, creeping and turning", ())):
        process(
            *DROP,
            "simulate",
            "--no-camera",
            "--force",
            "--out",
            "run.rrd",
            "--duration",
            f"{steps}/240",
            *options,
            folder=folder,
        )
        size = (folder / "run.rrd").stat().st_size
        yield Measured(
            f"recording per step, {what}",
            "13 float64 of state: 104 B",
            [size / (steps + 1)],
            goals_b[what],
            unit="B",
        )
