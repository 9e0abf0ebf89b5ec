"""Records scripts by other authors, and checks that each runs as without `drop`.

    python tests/public_scripts.py                   # those of PyBullet's wheel
    python tests/public_scripts.py FOLDER …          # those below some folders
    python tests/public_scripts.py --only sleeptest  # those whose names contain a text

Each is recorded twice, and run a third time with its engine unread (`witness`); one that fails is
run without drop too. The table goes to standard output, its rows as JSON lines to `--rows FILE`;
what is there already is not run again.
"""

from __future__ import annotations

import argparse
import ast
import collections
import contextlib
import importlib.util
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from rerun.chunk import RrdReader
from witness import interpreter

PACKAGES = (
    "pybullet_examples",
    "pybullet_envs",
    "pybullet_robots",
    "pybullet_utils",
    "pybullet_data",
)
STEPS, DURATION_S, WALL_S = 300, 2.0, 60.0
"""Limits at which a script is stopped: steps, simulated time [s], and wall time [s]."""
HANGS_S = 20.0
"""Time after Ctrl-C at which a recorder that has not ended counts as hung [s]."""
DEFINITIONS = (ast.FunctionDef, ast.ClassDef)
COMMAND = [sys.executable, "-P", "-c", "from drop_physics.console.running import main; main()"]

BARE = """
import os, runpy, sys
import pybullet
connect = pybullet.connect
def headless(method, *args, **kwargs):
    return -1 if method == pybullet.SHARED_MEMORY else connect(pybullet.DIRECT)
pybullet.connect = headless
target = sys.argv[1]
sys.argv = sys.argv[1:]
if target.endswith(".py"):
    sys.path.insert(0, os.path.dirname(target))
    runpy.run_path(target, run_name="__main__")
else:
    sys.path.insert(0, os.getcwd())
    runpy._run_module_as_main(target)
"""
"""Program that runs a script without drop and without a window, for machines without a display."""


@dataclass
class Tried:
    """The result of recording a script."""

    name: str
    outcome: str
    """`recorded`, `posed only`, `simulates nothing`, `fails`, or the description of a fault in
    drop."""
    ended: str = ""
    error: str = ""
    bare_error: str = ""
    """Error message of a failing script when run without drop; empty if it succeeds then."""
    steps: int = 0
    same_unread: bool | None = None
    """Whether every simulation ends in the same state if nothing reads it; None if it makes no
    steps."""
    first_difference: int | None = None
    """The first difference between the script's two recordings."""
    verified: bool = False
    wall_s: float = 0.0
    notes: tuple[str, ...] = ()


def is_runnable(path: Path) -> bool:
    """Return whether a file is a script: it has a main guard, or calls pybullet when imported."""
    try:
        tree = ast.parse(path.read_text(encoding="utf-8", errors="replace"))
    except (SyntaxError, ValueError, OSError):
        return False
    if path.name == "__init__.py":
        return False
    return any(
        (isinstance(one, ast.If) and "__name__" in ast.dump(one.test))
        or (not isinstance(one, DEFINITIONS) and ".connect(" in ast.unparse(one))
        for one in tree.body
    )


def of_the_wheel() -> Iterator[str]:
    """Yield the runnable modules in PyBullet's wheel."""
    for package in PACKAGES:
        spec = importlib.util.find_spec(package)
        assert spec is not None
        for folder in spec.submodule_search_locations or ():
            for path in sorted(Path(folder).rglob("*.py")):
                if is_runnable(path):
                    inside = path.relative_to(Path(folder).parent).with_suffix("")
                    yield ".".join(inside.parts)


def below(folder: Path) -> Iterator[str]:
    """Yield the scripts below a folder that use pybullet."""
    for path in sorted(folder.rglob("*.py")):
        text = path.read_text(encoding="utf-8", errors="replace")
        if ("pybullet" in text or "BulletEnv" in text) and is_runnable(path):
            yield str(path.resolve())


def run(command: Sequence[str], folder: Path, wall_s: float, **environment: str) -> Any:
    """Run a command, send Ctrl-C after a time; return its output, or None if it hangs."""
    with (
        tempfile.TemporaryFile("w+", errors="replace") as out,
        tempfile.TemporaryFile("w+", errors="replace") as err,
    ):
        process = subprocess.Popen(
            command,
            cwd=folder,
            stdout=out,
            stderr=err,
            stdin=subprocess.DEVNULL,
            env=os.environ | environment,
            start_new_session=True,
        )
        try:
            process.wait(wall_s)
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGINT)
            try:
                process.wait(HANGS_S)
            except subprocess.TimeoutExpired:
                return None
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
        out.seek(0)
        err.seek(0)
        return subprocess.CompletedProcess(command, process.returncode, out.read(), err.read())


class Trial:
    """Records scripts in a folder of its own."""

    def __init__(self, folder: Path, *, wall_s: float = WALL_S) -> None:
        self.folder, self._wall_s = folder, wall_s
        self._python = interpreter(folder)

    def tried(self, name: str) -> Tried:
        """Record a script, and return the outcome."""
        began = time.perf_counter()
        is_file = name.endswith(".py")
        where = Path(name).parent if is_file else self.folder / "work"
        where.mkdir(exist_ok=True)
        out, ends = self.folder / "out.rrd", self.folder / "ends.txt"
        program = [Path(name).name] if is_file else ["-m", name]
        limits = ["--steps", str(STEPS), "--duration", str(DURATION_S), "--seed", "0"]
        found = Tried(name, "fails")
        seen: list[str] = []
        interrupted = False
        for blind in (False, True):
            ends.unlink(missing_ok=True)
            twice = [] if blind else ["--twice"]
            # `--twice` tells its ends twice.
            done = run(
                [
                    *COMMAND,
                    "record",
                    *limits,
                    *twice,
                    "--json",
                    "--force",
                    "--out",
                    str(out),
                    "--python",
                    str(self._python),
                    *program,
                ],
                where,
                self._wall_s * (1 if blind else 2),
                WITNESS=str(ends),
                WITNESS_BLIND=str(int(blind)),
            )
            if done is None:
                found.outcome = "drop hangs"
                break
            seen.append(ends.read_text() if ends.exists() else "")
            if blind:
                interrupted |= '"ended": "interrupted"' in done.stdout
            else:
                self._told(found, done, out)
                interrupted = found.ended == "interrupted"
                if not found.steps:
                    break
        if len(seen) == 2 and not interrupted:
            read, unread = seen
            told = bool(unread) and "cannot be read" not in read + unread
            found.same_unread = told and read in (unread, 2 * unread)
        if found.outcome == "fails":
            found.bare_error = self._bare(name, where)
        found.wall_s = time.perf_counter() - began
        return found

    def _told(self, found: Tried, done: Any, out: Path) -> None:
        lines = done.stderr.splitlines()
        found.notes = tuple(one.removeprefix("drop: ") for one in lines if one.startswith("drop: "))
        try:
            told = json.loads(done.stdout)
        except ValueError:
            found.outcome, found.error = "drop fails", " ".join(lines[-1:])
            return
        found.ended, found.first_difference = told["ended"], told.get("first_difference")
        verified = subprocess.run(
            [sys.executable, "-m", "rerun", "rrd", "verify", out], capture_output=True, check=False
        )
        found.verified = verified.returncode == 0
        found.steps, posed = _contents(out)
        if told["ended"] == "failed":
            found.error = told["error"]
            return
        found.outcome = (
            "recorded" if found.steps else "posed only" if posed else "simulates nothing"
        )

    def _bare(self, name: str, where: Path) -> str:
        done = run([sys.executable, "-c", BARE, name], where, self._wall_s)
        if done is None:
            return "ran until it was killed"
        if done.returncode == 0:
            return ""
        last = [one for one in done.stderr.splitlines() if one.strip()][-1:]
        return " ".join(last) or f"exit code {done.returncode}"


def _contents(path: Path) -> tuple[int, bool]:
    """Return a recording's number of steps, and whether it contains any body."""
    steps, bodies = 0, False
    for chunk in RrdReader(path).stream():
        bodies |= chunk.entity_path == "/bodies"
        if chunk.entity_path == "/state":
            numbers = chunk.to_record_batch().column("sim_step").to_pylist()
            steps = max(steps, *numbers)
    return steps, bodies


def table(rows: Sequence[Tried], folders: Sequence[Path] = ()) -> str:
    """Return the outcomes as a Markdown table, with details of each script that went wrong."""
    groups: dict[str, collections.Counter[str]] = {}
    for row in rows:
        groups.setdefault(_group(row.name, folders), collections.Counter())[row.outcome] += 1
    kinds = ["recorded", "posed only", "simulates nothing", "fails"]
    kinds += sorted({row.outcome for row in rows} - {*kinds})
    lines = [f"| from | scripts | {' | '.join(kinds)} |", "| --- |" + " ---: |" * (len(kinds) + 1)]
    total: collections.Counter[str] = collections.Counter()
    for group, counts in groups.items():
        total += counts
        cells = [group, str(counts.total()), *(str(counts[kind]) for kind in kinds)]
        lines.append(f"| {' | '.join(cells)} |")
    cells = ["all", str(total.total()), *(str(total[kind]) for kind in kinds)]
    lines.append(f"| {' | '.join(cells)} |")
    stepped = [row for row in rows if row.steps]
    compared = [row for row in stepped if row.same_unread is not None]
    lines += [
        "",
        f"recordings that verify: {sum(row.verified for row in rows)}",
        f"end the same read and unread: {sum(row.same_unread is True for row in compared)} of "
        f"{len(compared)}",
        f"twice the same: {sum(row.first_difference is None for row in stepped)} of {len(stepped)}",
        "",
    ]
    for row in rows:
        said = []
        if row.outcome not in ("recorded", "posed only", "simulates nothing"):
            said.append(f"{row.outcome}: {row.error}; bare: {row.bare_error or 'does not fail'}")
        if row.steps and row.first_difference is not None:
            said.append(f"differs from step {row.first_difference} on")
        if row.same_unread is False:
            said.append("ends elsewhere when it is read")
        if row.ended == "interrupted":
            said.append("stopped by the limit of wall time")
        if not row.verified:
            said.append("does not verify")
        if said:
            lines.append(f"- {row.name}: {'; '.join(said)} ({row.steps} steps)")
    return "\n".join(lines)


def _group(name: str, folders: Sequence[Path]) -> str:
    """Return a script's package, or its folder below the given ones."""
    for folder in folders:
        if name.startswith(f"{folder.resolve()}{os.sep}"):
            return Path(name).relative_to(folder.resolve()).parts[0]
    return name.partition(".")[0]


def main() -> None:
    """Record scripts, one after the other, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("folders", nargs="*", type=Path)
    parser.add_argument("--only", default="")
    parser.add_argument("--wall", type=float, default=WALL_S)
    parser.add_argument("--rows", type=Path)
    given = parser.parse_args()
    names = [one for folder in given.folders for one in below(folder)] or list(of_the_wheel())
    rows = []
    if given.rows and given.rows.exists():
        rows = [Tried(**json.loads(line)) for line in given.rows.read_text().splitlines()]
    there = {row.name for row in rows}
    with tempfile.TemporaryDirectory() as folder:
        trial = Trial(Path(folder), wall_s=given.wall)
        for name in [one for one in names if given.only in one and one not in there]:
            rows.append(trial.tried(name))
            told = asdict(rows[-1])
            print(json.dumps(told), file=sys.stderr, flush=True)
            if given.rows:
                with given.rows.open("a") as file:
                    file.write(json.dumps(told) + "\n")
    print(table(rows, given.folders))


if __name__ == "__main__":
    main()
