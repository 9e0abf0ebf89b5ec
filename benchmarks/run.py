"""`drop run` with all its outputs, against a plain script that does what the article's does."""

from __future__ import annotations

import itertools
import sys
from collections.abc import Iterator
from pathlib import Path

from benchmarks.harness import DROP, Measured, paired, process


def measure(folder: Path, *, quick: bool) -> Iterator[Measured]:
    """Compare whole processes."""
    number = itertools.count()
    script = Path(__file__).with_name("plain_script.py")
    ratios, detail = paired(
        lambda: process(*DROP, "run", "--out-dir", f"out{next(number)}", folder=folder),
        lambda: process(sys.executable, script, folder=folder),
        pairs=3 if quick else 9,
    )
    yield Measured(
        "`drop run`: recording, analysis, gif, plot",
        "plain script: gif",
        ratios,
        0.45,
        detail=detail,
    )
