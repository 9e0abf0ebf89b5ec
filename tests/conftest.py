"""What the tests share: one standard drop for the session, and the command as a user has it."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from pathlib import Path

import pytest
from command import drop_alone, drop_here
from hypothesis import settings

from pipeline import Analysis, Scenario, simulate
from pipeline.analysis.drop.analysis import analysis_of
from pipeline.recording.reader import Recording, read
from pipeline.recording.viewer import binary
from pipeline.stages.run import Run, run

os.environ["DROP_LANG"] = "en"  # in which the tests expect what is printed, wherever they run
# The same examples every time: a test that fails is a change, and no bad luck.
settings.register_profile("drop", derandomize=True, deadline=None)
settings.load_profile("drop")

Drop = Callable[..., subprocess.CompletedProcess[str]]


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip a test that needs what only `[dev]` brings, where that is not installed."""
    for mark in item.iter_markers("needs"):
        (module,) = mark.args
        if find_spec(module) is None:
            pytest.skip(f"{module} is not installed; try: pip install '.[dev]'")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item,
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Let a test that skips fail in CI, whatever its reason: what it needs is there.

    But CI runs `pytest` with `[test]` first, and then, with `[dev]`, `pytest -m "needs or long"`.
    """
    report = yield
    first = "needs" not in item.config.option.markexpr
    later = item.get_closest_marker("needs") is not None and first
    if report.skipped and os.environ.get("CI") and not later:
        report.outcome = "failed"
        report.longrepr = f"in CI nothing is skipped: {report.longrepr}"
    return report


@pytest.fixture(scope="session")
def standard(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Return the experiment itself, simulated, analyzed and rendered once for all tests."""
    return run(Scenario(), tmp_path_factory.mktemp("standard"))


@dataclass(frozen=True)
class Recorder:
    """Record scenarios, each once in a session, without frames."""

    folder: Path

    def __call__(self, **scenario: object) -> Recording:
        """Return the recording of a scenario."""
        name = "-".join(f"{key}={value}" for key, value in sorted(scenario.items()))
        path = self.folder / f"{name.replace('/', '_')[:120] or 'standard'}-{hash(name):x}.rrd"
        if not path.exists():
            simulate(Scenario(**scenario), path, camera=None)  # type: ignore[arg-type]
        return read(path)


@pytest.fixture(scope="session")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Recorder:
    """Return a function from scenario fields to their recording."""
    return Recorder(tmp_path_factory.mktemp("recorded"))


def judge(recording: Recording, at_s: Sequence[float] = ()) -> Analysis:
    """Analyze a recording that was read."""
    return analysis_of(
        recording.scenario, recording.engine, recording.states, recording.contacts, at_s=at_s
    )


def rerun_rrd(*arguments: object) -> str:
    """Run `rerun rrd`, which must not fail, and return what it says."""
    command = [binary(), "rrd", *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout + done.stderr


def descendants_of(pid: int | str) -> list[str]:
    """Return the numbers of the processes that a process started, and those that they did."""
    children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    return children + [grandchild for child in children for grandchild in descendants_of(child)]


@pytest.fixture
def drop(tmp_path: Path) -> Drop:
    """Return the command line, run in this process."""
    return partial(drop_here, folder=tmp_path)


@pytest.fixture
def drop_process(tmp_path: Path) -> Drop:
    """Return the command line as a process of its own; takes what `subprocess.run` does."""
    return partial(drop_alone, folder=tmp_path)


PLANTED = (
    "cli", "decimal", "json", "matplotlib", "numpy", "pickle", "polars", "pybullet", "queue",
    "random", "rerun", "scipy", "sitecustomize", "types", "typer",
)  # fmt: skip
"""Modules that are imported from where `drop` is typed, wherever that is trusted."""

Planted = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture
def planted(tmp_path: Path) -> Iterator[Planted]:
    """Return the installed command, typed in a folder full of modules; none of them may be run."""
    folder, program = tmp_path / "here", tmp_path / "bin/drop"
    ran = tmp_path / "ran"
    (folder / "pipeline").mkdir(parents=True)
    for path in (*(folder / f"{name}.py" for name in PLANTED), folder / "pipeline/__init__.py"):
        path.write_text(f"open({str(ran)!r}, 'a').write({str(path)!r} + '\\n')")
    program.parent.mkdir()
    program.write_text("from pipeline.console.running import main\nmain()\n")  # as pip writes it

    def call(*arguments: object) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, program, *map(str, arguments)],
            capture_output=True, text=True, cwd=folder, timeout=120, check=False,
            env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[1])},
        )  # fmt: skip

    yield call
    assert not ran.exists(), ran.read_text()
