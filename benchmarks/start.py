"""Start-up time of commands, compared with the imports that they need."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from benchmarks.harness import DROP, PYTHON, Measured, paired, process


def measure(folder: Path, *, quick: bool) -> Iterator[Measured]:
    """Compare whole processes."""
    pairs = 1 if quick else 15
    frames = ("--no-camera",) if quick else ()
    process(*DROP, "run", *frames, "--out-dir", ".", folder=folder)
    for question, command, imports in (
        ("`drop analyze`, standard recording", ("analyze", "run.rrd"), "rerun, polars, numpy"),
        ("`drop --help`", ("--help",), "typer"),
    ):
        ratios, detail = paired(
            lambda command=command: process(*DROP, *command, folder=folder),  # type: ignore[misc]
            lambda imports=imports: process(*PYTHON, f"import {imports}", folder=folder),  # type: ignore[misc]
            pairs=pairs,
            warm=not quick,
        )
        yield Measured(question, f"import {imports}", ratios, 1.5, detail=detail)
