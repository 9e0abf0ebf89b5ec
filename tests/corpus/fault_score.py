"""How many faults of controllers are named in the analysis of a failed episode.

    python tests/corpus/fault_score.py                # all, and robots without a fault
    python tests/corpus/fault_score.py hopper-sign …  # these

A fault is named if what `truth.toml` says of it, or a line of the script that makes it, is in one
of the first two rows of the account, or of the first three outcomes of `drop why --expect`, which
is asked only where the account does not name it. Of a robot without a fault nothing may be found.
"""

from __future__ import annotations

import contextlib
import os
import re
import sys
import tempfile
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from drop_physics.analysis.results import Analysis
from drop_physics.report.account import NEGLIGIBLE, facts_of
from drop_physics.report.bodies import one_screen
from drop_physics.stages.analyze import analyze
from drop_physics.stages.record import record_script
from drop_physics.stages.rerun.single import text_of
from drop_physics.stages.why import why

FOLDER = Path(__file__).parent / "controllers"
SCRIPT = FOLDER / "scripts" / "controllers.py"
ROWS, OUTCOMES = 2, 3
"""Number of rows of the account, and of search outcomes, that a reader is assumed to look at."""
BUDGET_S = 600.0


@dataclass(frozen=True)
class Case:
    """A controller with a fault."""

    robot: str
    fault: str
    expect: str
    """The expectation that the controller fails."""
    names: Sequence[str]
    """Regular expressions, one of which must match text that names the fault."""

    def named_by(self, told: Sequence[str]) -> str | None:
        """Return the first text that names the fault."""
        patterns = [*self.names, *(rf"{SCRIPT.name}:{line}\b" for line in _lines_of(self.fault))]
        return next((text for text in told if any(re.search(n, text) for n in patterns)), None)


def _lines_of(fault: str) -> Iterator[int]:
    """Yield the source lines that introduce a fault."""
    depth: int | None = None
    for number, line in enumerate(SCRIPT.read_text(encoding="utf-8").splitlines(), 1):
        indent = len(line) - len(line.lstrip())
        if f'fault == "{fault}"' in line:
            depth = indent
            yield number
        elif depth is not None and indent > depth:
            yield number
        else:
            depth = None


def cases() -> dict[str, Case]:
    """Return all cases, by `ROBOT-FAULT`."""
    told = tomllib.loads((FOLDER / "truth.toml").read_text(encoding="utf-8"))
    return {
        f"{robot}-{fault}": Case(
            robot, fault, its.get("instead", {}).get(fault, its["expect"]), names
        )
        for robot, its in told.items()
        for fault, names in its["faults"].items()
    }


def analyzed(robot: str, *fault: str) -> Analysis:
    """Return the analysis of a controller's episode."""
    with _quiet() as folder:
        recorded = record_script(str(SCRIPT), [robot, *fault], out=folder / "run.rrd", stdout=2)
        return analyze(recorded.recording)


def rows_of(analysis: Analysis) -> list[str]:
    """Return the rows of the account as texts, as a reader sees them."""
    return [" ".join(str(fact.words) for fact in facts_of(row)) for row in analysis.account]


def said_of(analysis: Analysis) -> list[str]:
    """Return the findings and the rows of the account that the report shows."""
    screen = one_screen(analysis)
    rows = [row for row in screen.rows[: screen.most_rows] if row.salience >= NEGLIGIBLE]
    shown = screen.findings[: screen.most_findings]
    return [each.code for each in shown] + [str(row.told) for row in rows]


def outcomes_of(case: Case, budget_s: float = BUDGET_S) -> list[str]:
    """Return the outcomes of the search as texts, each including the equivalent changes."""
    with _quiet() as folder:
        found = why(
            str(SCRIPT),
            [case.robot, case.fault],
            expect=case.expect,
            budget_s=budget_s,
            out=folder,
            stdout=2,
        ).expected
    assert found is not None
    assert not found.base.holds, case
    return [
        "; ".join(
            f"{text_of(one.change)} ({found.words(one.change)})"
            for one in (each.tried, *each.alike, *each.also)
        )
        for each in found.makes_true
    ]


def named(case: Case) -> str | None:
    """Return the line that names the fault; None if none does."""
    rows = rows_of(analyzed(case.robot, case.fault))[:ROWS]
    return case.named_by(rows) or case.named_by(outcomes_of(case)[:OUTCOMES])


@contextlib.contextmanager
def _quiet() -> Iterator[Path]:
    """Yield a temporary folder, as the working directory."""
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        yield Path(folder)


def main(chosen: Sequence[str]) -> None:
    """Print which faults are named."""
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    known = cases()
    wanted = chosen or [*known]
    hits = 0
    for name in wanted:
        line = named(known[name])
        hits += line is not None
        print(f"{name:24} {line or '-'}", flush=True)
    print(f"{hits} of {len(wanted)} named")
    for robot in () if chosen else dict.fromkeys(each.robot for each in known.values()):
        analysis = analyzed(robot)
        print(f"{robot:24} {said_of(analysis) or 'its end, and no more'}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
