"""Fixtures shared by the tests: one standard drop per session, and the command as users have it."""

from __future__ import annotations

import contextlib
import fcntl
import gc
import importlib
import os
import pickle
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from importlib.metadata import packages_distributions
from pathlib import Path
from typing import Any

import drop_physics
import polars as pl
import pytest
from command import HANGS_S, drop_alone, drop_here
from drop_physics import DropAnalysis, Scenario, simulate
from drop_physics.drop.story import drop_analysis_of
from drop_physics.engines import script
from drop_physics.recording.reader import Recording, read
from drop_physics.recording.viewer import binary
from drop_physics.rules.answer import Finding
from drop_physics.stages.run import Run, run
from dropped import seen_with
from generators.translations import compiled
from hypothesis import HealthCheck, settings
from skipping import pytest_runtest_makereport as pytest_runtest_makereport
from skipping import pytest_runtest_setup as pytest_runtest_setup
from without_pybullet import pytest_collection_modifyitems as without_pybullet
from without_pybullet import pytest_ignore_collect as pytest_ignore_collect

# Processes that tests start load what others have compiled, as a user's do.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False
os.environ["DROP_LANG"] = "en"  # in which the tests expect what is printed, wherever they run
# The same examples every time: a test that fails is a change, and no bad luck.
settings.register_profile(
    "drop", derandomize=True, deadline=None, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("drop")

FOLDER = Path(__file__).parent
Drop = Callable[..., subprocess.CompletedProcess[str]]


LONGEST = (
    "::test_the_whole_is_answered_no_worse",
    "::test_every_statement_is_confirmed",
    "::test_what_a_page_says_to_type",
    "::test_the_pictures_of_the_readme",
    "/test_site.py",
    "/test_viewer.py",
)
"""Tests that take at least half a minute, or wait."""


@pytest.hookimpl(tryfirst=True)
def pytest_collection(session: pytest.Session) -> None:
    """Compile different modules in each process, so that the other processes can read the result.

    Compiling all tests, with assertions that show their values, takes 10 s.
    """
    given = getattr(session.config, "workerinput", None)
    if given is None or [Path(each).resolve() for each in session.config.args] != [FOLDER]:
        return
    names = sorted(path.stem for path in FOLDER.glob("test_*.py"))
    first = len(names) * int(given["workerid"].removeprefix("gw")) // given["workercount"]
    for name in names[first:] + names[:first]:
        with contextlib.suppress(Exception):  # pytest imports it again, and reports that
            importlib.import_module(name)


def pytest_configure(config: pytest.Config) -> None:
    """Compile the translations of a clone, once for all processes."""
    if not hasattr(config, "workerinput"):
        compiled()


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Print the messages that passing tests left for the terminal summary."""
    for report in terminalreporter.stats.get("passed", ()):
        for name, text in report.user_properties:
            if name == "say":
                terminalreporter.write_line(text)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Start the longest tests first, so that no process is idle at the end."""
    without_pybullet(config, items)
    items.sort(key=lambda item: not any(name in item.nodeid for name in LONGEST))


def pytest_collection_finish() -> None:
    """Exclude the objects that exist after collection from garbage collection: they stay alive."""
    gc.freeze()


def some(values: Iterable[Any], first: int) -> list[Any]:
    """Return values for `parametrize`; all but the first few are marked `long`."""
    sets = [value if hasattr(value, "marks") else pytest.param(*_parts(value)) for value in values]
    return [
        *sets[:first],
        *(
            pytest.param(*one.values, id=one.id, marks=[*one.marks, pytest.mark.long])
            for one in sets[first:]
        ),
    ]


def _parts(value: Any) -> tuple[Any, ...]:
    return value if isinstance(value, tuple) else (value,)


@pytest.fixture(scope="session")
def standard(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Return the standard experiment, simulated, analyzed and rendered once for all tests.

    The first of pytest's processes that needs it makes it, and the others wait for that.
    """
    folder = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        folder = folder.parent
    kept = folder / "standard.pickle"
    with (folder / "standard.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not kept.exists():
            (folder / "standard").mkdir()
            kept.write_bytes(pickle.dumps(run(Scenario(), folder / "standard")))
    made: Run = pickle.loads(kept.read_bytes())
    return made


@dataclass(frozen=True)
class Recorder:
    """Records scenarios without frames, each once per session."""

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
    """Return a function that records a scenario given by its fields."""
    return Recorder(tmp_path_factory.mktemp("recorded"))


def judge(
    recording: Recording,
    states: pl.DataFrame | None = None,
    contacts: pl.DataFrame | None = None,
    *,
    at_s: Sequence[float] = (),
) -> DropAnalysis:
    """Analyze a recorded drop as `analyze` does, optionally with altered states or contacts."""
    seen = seen_with(recording.seen, states, contacts)
    return drop_analysis_of(recording.scenario, recording.engine, seen, at_s=at_s)


def said(finding: Finding) -> str:
    """Return a finding's message and advice as one text."""
    return f"{finding.message}: {finding.advice or ''}"


def rerun_rrd(*arguments: object) -> str:
    """Run `rerun rrd`, assert that it succeeds, and return its output."""
    command = [binary(), "rrd", *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout + done.stderr


def descendants_of(pid: int | str) -> list[str]:
    """Return the process ids of all descendants of a process."""
    children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    return children + [grandchild for child in children for grandchild in descendants_of(child)]


@pytest.fixture(autouse=True)
def starts(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Use real process starts instead of forks, in tests marked `starts`."""
    if request.node.get_closest_marker("starts") is not None:
        monkeypatch.setattr(script, "subprocess", subprocess)


@pytest.fixture
def drop(tmp_path: Path) -> Drop:
    """Return a function that runs the command line in this process."""
    return partial(drop_here, folder=tmp_path)


@pytest.fixture
def drop_process(tmp_path: Path) -> Drop:
    """Return a function that runs the command line as a separate process, like `subprocess.run`."""
    return partial(drop_alone, folder=tmp_path)


PACKAGE = Path(drop_physics.__file__).parent
LISTENING = """import atexit, os, sys
class Listen:
    def find_spec(name, *_):
        os.write(heard, name.encode() + b"\\n")
heard = os.open({heard!r}, os.O_WRONLY | os.O_APPEND)
os.write(heard, "\\n".join([*sys.modules, ""]).encode())
sys.meta_path.insert(0, Listen)
"""
"""A `sitecustomize` that logs every module name that any Python process tries to import."""

LOOKED_FOR = {
    *("__main__", "_drop_engines", "cython", "drop_physics", "sitecustomize", "usercustomize"),
    *("_polars_runtime_64", "_polars_runtime_compat", "_sysconfigdata__linux_x86_64-linux-gnu"),
    *("altair", "backports", "boto3", "brotli", "brotlicffi", "chardet", "deltalake"),
    *("fsspec", "gevent", "great_tables", "org", "pinocchio", "polars_cloud", "polars_nanook"),
    *("pyiceberg", "pytz", "simplejson", "socks", "torch"),
}
"""Modules that commands look for and that no environment has; the runs find further ones."""

Planted = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture
def planted(tmp_path: Path) -> Iterator[Planted]:
    """Return the installed command, run in a folder full of modules that it must not import.

    They have the names of all that Python and its environment have, and of all else that the
    command looks for, whether it finds that or not: it is run again until there is nothing more.
    """
    folder, listening = tmp_path / "here", tmp_path / "listening"
    program, ran, heard = tmp_path / "bin/drop", tmp_path / "ran", tmp_path / "heard"
    for each in (folder, listening, program.parent, folder / "drop_physics"):
        each.mkdir()
    heard.touch()
    (listening / "sitecustomize.py").write_text(LISTENING.format(heard=str(heard)))
    program.write_text(
        "from drop_physics.console.running import main\nmain()\n"
    )  # as pip writes it
    set_up: set[str] = set()

    def set_traps(names: set[str]) -> None:
        for trap in [
            *(folder / f"{name}.py" for name in names),
            folder / "drop_physics/__init__.py",
        ]:
            trap.write_text(f"open({str(ran)!r}, 'a').write({str(trap)!r} + '\\n')")
        set_up.update(names)

    def call(*arguments: object, ends: int = 0) -> subprocess.CompletedProcess[str]:
        missing = {*sys.stdlib_module_names, *packages_distributions(), *LOOKED_FOR}
        while missing:
            set_traps(missing)
            before = {*folder.iterdir()}
            done = subprocess.run(
                [sys.executable, program, *map(str, arguments)],
                capture_output=True,
                text=True,
                cwd=folder,
                timeout=HANGS_S,
                check=False,
                env={
                    **os.environ,
                    "PYTHONPATH": os.pathsep.join(map(str, (listening, PACKAGE.parent))),
                    "DISPLAY": "",
                    "WAYLAND_DISPLAY": "",
                },
            )
            assert done.returncode == ends, done.stderr
            names = {name.partition(".")[0] for name in heard.read_text().split("\n")}
            assert {"drop_physics", "json", "numpy", "sitecustomize"} <= names
            missing = names - set_up - {""}
            LOOKED_FOR.update(missing)
            for made in {*folder.iterdir()} - before if missing else ():
                shutil.rmtree(made) if made.is_dir() else made.unlink()
        return done

    yield call
    assert not ran.exists(), ran.read_text()
