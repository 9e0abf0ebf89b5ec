"""Run the benchmarks, and print their results as a table."""

from __future__ import annotations

import argparse
import compileall
import importlib
import tempfile
from pathlib import Path

from benchmarks.harness import HEAD, ROOT, machine

SCRIPTS = (
    "look",
    "steps",
    "memory",
    "frames",
    "analyze",
    "arm",
    "hulls",
    "start",
    "gif",
    "golden",
    "egl",
    "watching",
    "mujoco",
    "tree",
    "growth",
    "trust",
    "answers",
    "training",
    "robots",
)


def main() -> None:
    """Run all benchmarks or the chosen ones, each in a folder of its own."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument(
        "--only",
        metavar="NAME",
        action="append",
        choices=SCRIPTS,
        help=f"one of {', '.join(SCRIPTS)}; repeatable",
    )
    parser.add_argument(
        "--quick", action="store_true", help="each kind of measurement once, as a smoke test"
    )
    options = parser.parse_args()
    # An installed package comes with its bytecode; compile a checkout too, whatever
    # PYTHONDONTWRITEBYTECODE says.
    compileall.compile_dir(ROOT / "pipeline", quiet=1)
    print(machine(), end="\n\n")
    print(HEAD)
    for name in options.only or SCRIPTS:
        script = importlib.import_module(f"benchmarks.{name}")
        with tempfile.TemporaryDirectory() as folder:
            for measured in script.measure(Path(folder), quick=options.quick):
                print(measured.row(), flush=True)


if __name__ == "__main__":
    main()
