"""Worker processes: their imports, their end, and their return values."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from ctypes.util import find_library
from pathlib import Path

import pytest
from command import HANGS_S, environment
from conftest import Planted
from drop_physics.errors import DropError
from drop_physics.stages.run import Run
from drop_physics.workers import Worker, cores, under_load

SLOW = """
import pathlib, time
while not pathlib.Path({gate!r}).exists():
    time.sleep(0.01)
"""
ASKED = """
import sys
def loaded(*arguments):
    return hasattr(sys.modules.get("slow"), "pathlib"), hasattr(sys.modules.get("slow"), "DONE")
"""


def test_what_is_loading_is_waited_for_where_it_could_be_seen_half_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    gate = tmp_path / "gate"
    (tmp_path / "slow.py").write_text(SLOW.format(gate=str(gate)) + "DONE = True\n")
    (tmp_path / "known.py").write_text(ASKED)
    (tmp_path / "other.py").write_text(ASKED)
    monkeypatch.syspath_prepend(tmp_path)
    with Worker() as worker:
        worker.ask("known:loaded")
        assert worker.answer() == (False, False)
        worker.load("slow")
        for _ in range(1000):
            # Its answers do not wait: it has imported what it needs.
            worker.ask("known:loaded")
            begun, done = worker.answer()
            assert not done
            if begun:
                break
        assert begun
        worker.ask("other:loaded", tmp_path)
        gate.touch()
        assert worker.answer() == (True, True)


def test_what_a_function_raises_is_raised_here_and_the_next_question_answered() -> None:
    with Worker() as worker:
        worker.ask("math:sqrt", -1)
        worker.ask("math:sqrt", 4)
        with pytest.raises(ValueError, match=r"math domain|nonnegative"):
            worker.answer()
        assert worker.answer() == 2


def test_a_worker_that_is_just_starting_does_not_hear_ctrl_c() -> None:
    with Worker() as worker:
        worker._process.send_signal(signal.SIGINT)
        worker.ask("math:sqrt", 4)
        assert worker.answer() == 2


def test_ctrl_c_ends_the_wait_for_an_answer_with_polars_too(tmp_path: Path) -> None:
    """With polars imported, a signal does not interrupt a read: its handler runs afterwards."""
    code = """
import os, signal, threading, polars
from drop_physics.errors import DropError
from drop_physics.stages.run import Run
from drop_physics.workers import Worker
polars.DataFrame(dict(a=[1])).lazy().collect()
with Worker() as worker:
    worker.ask("time:sleep", 10 * {hangs_s})
    threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT)).start()
    worker.answer()
"""
    done = subprocess.run(
        [sys.executable, "-c", code.format(hangs_s=HANGS_S)],
        cwd=tmp_path,
        env=environment(),
        capture_output=True,
        text=True,
        timeout=HANGS_S,
        check=False,
    )
    assert done.stderr.strip().endswith("KeyboardInterrupt")


@pytest.mark.parametrize("name", ["SIGALRM", "SIGXCPU"])
def test_a_worker_that_was_too_slow_says_so(name: str) -> None:
    number = signal.Signals[name]
    with Worker() as worker:
        worker.ask("signal:raise_signal", number)
        with pytest.raises(DropError, match=f"signal {number}, which ends what is too slow"):
            worker.answer()


def test_on_a_busy_machine_everything_may_take_longer(monkeypatch: pytest.MonkeyPatch) -> None:
    for load, factor in ((0.0, 1), (cores(), 1), (12 * cores(), 12)):
        monkeypatch.setattr(os, "getloadavg", lambda load=load: (load, 0.0, 0.0))
        assert under_load(5.0) == 5.0 * factor


def test_where_nobody_says_which_processors_may_be_used_all_are_counted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delattr(os, "sched_getaffinity", raising=False)
    assert cores() == (os.cpu_count() or 1)


@pytest.mark.long
@pytest.mark.parametrize(
    "command",
    [
        "run --size 32x24 --duration 0.1 --at 0.05 --with-plot --caption",
        "analyze run.rrd --table run.parquet",
        "check run.rrd --against run.rrd",
        "view run.rrd",
        "trust ../elsewhere/script.py --out t --jobs 2 --plot t.png",
        "record -o script.rrd ../elsewhere/script.py",
        pytest.param(
            "simulate --size 32x24 --duration 0.1 --renderer egl -o a.rrd",
            marks=pytest.mark.skipif(not find_library("EGL"), reason="no libEGL"),
        ),
        pytest.param("render run.rrd --out film.mp4", marks=pytest.mark.needs("av")),
        "sweep --out s --samples 4 --jobs 2 --vary height=uniform:1:2 --no-record",
        "sweep --out s --engine bullet,mujoco --no-record --duration 0.1 --at 0.05",
        pytest.param(
            "sweep --out s --samples 3 --vary height=uniform:1:2 --no-record --ray local",
            marks=pytest.mark.needs("ray"),
        ),
    ],
)
def test_nothing_in_the_working_directory_is_imported(
    planted: Planted, tmp_path: Path, standard: Run, command: str
) -> None:
    """`record` runs the script with the modules of the script's folder."""
    if "run.rrd" in command:
        shutil.copy(standard.simulation.recording, tmp_path / "here/run.rrd")
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere/script.py").write_text(
        "import ctypes, json, pybullet as p\np.connect(p.DIRECT)\np.stepSimulation()\n"
    )
    ends = int("view" in command)  # there is no screen
    done = planted(*command.split(), ends=ends)
    assert done.returncode == ends, done.stderr
    assert "Error" not in done.stderr


def test_a_worker_finds_no_modules_in_the_working_directory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "lies_here.py").write_text("")
    monkeypatch.chdir(tmp_path)
    for place in ("", ".", str(tmp_path)):
        with monkeypatch.context() as patched:
            patched.syspath_prepend(place)
            with Worker() as worker:
                worker.ask("lies_here:anything")
                with pytest.raises(ModuleNotFoundError):
                    worker.answer()
