"""Repeated runs of a script for a search: forks and runs from the start give the same results."""

from __future__ import annotations

import re
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import pytest
from command import wait_for
from conftest import some
from drop_physics.engines.fork_server import Fork
from drop_physics.engines.reached import Reached
from drop_physics.engines.script import Program, Script
from drop_physics.engines.source import edits_of
from drop_physics.engines.watching.edits import write
from drop_physics.engines.watching.forks import FIRST_LINE, FIRST_USE
from drop_physics.engines.watching.private import Private
from drop_physics.stages.rerun.again import Again, again_of
from drop_physics.stages.rerun.reruns import Reruns
from drop_physics.stages.rerun.single import possible
from drop_physics.stages.why.expect import evaluator_of

pytestmark = pytest.mark.pybullet

SCRIPT = """
import pybullet as p
def main():
    p.connect(p.DIRECT)
    p.setGravity(0, 0, -9.8)
    box = p.createMultiBody(1, p.createCollisionShape(p.GEOM_SPHERE, radius=0.1))
    open("made.txt", "w").write("x")
    for i in range(20):
        p.stepSimulation()
    z = p.getBasePositionAndOrientation(box)[0][2]
    print("ends at", z)
main()
"""


@pytest.fixture
def program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Program:
    monkeypatch.chdir(tmp_path)
    Path("script.py").write_text(SCRIPT)
    evaluator = evaluator_of("z == 0")
    return Program("script.py", (), sys.executable, seed=0, streams=False, evaluator=evaluator)


def again() -> Again:
    return again_of("script.py", Reached(), is_module=False, took_s=60.0, anyway=False)


def outcome(reruns: Reruns, changed: Program) -> tuple[type[Script | Fork], object, str]:
    """Return how a run was made, the evaluated result, and the printed output."""
    with tempfile.TemporaryFile() as printed:
        with reruns.begun(changed, printed=printed.fileno()) as process:
            for _ in process.events():
                pass
        assert process.ending().how == "finished"
        printed.seek(0)
        text = printed.read().decode()
        return type(process), process.decoder.answer, text[text.index("ends at") :]


def test_a_fork_answers_and_prints_what_a_run_from_the_start_does(program: Program) -> None:
    """In free fall z = -g dt² n (n + 1) / 2 by semi-implicit Euler, apart from damping."""
    changes = [{"gravity": g} for g in (9.8, 4.9)]
    changed = [replace(program, variation=change) for change in changes]
    own = Reruns(program, again())
    started = [outcome(own, each) for each in changed]
    with Reruns(program, again()) as reruns:
        forked = [outcome(reruns, each) for each in changed]
    assert {kind for kind, *_ in started} == {Script}
    assert {kind for kind, *_ in forked} == {Fork}
    assert [rest for _, *rest in started] == [rest for _, *rest in forked]
    for (_, answer, printed), g in zip(forked, (9.8, 4.9), strict=True):
        assert isinstance(answer, tuple)
        said, error = answer
        assert error == ""
        z = said["value"]
        assert z == pytest.approx(-g / 240**2 * 20 * 21 / 2, rel=0.01)
        assert printed == f"ends at {z}\n"
    assert not Path("made.txt").exists()


MINE = SCRIPT.replace("-9.8", "G").replace("def main", "G = -9.8\ndef main")[: -len("main()\n")]
MINE = MINE.replace('createMultiBody(1, p.createCollisionShape(p.GEOM_SPHERE, radius=0.1))',
                    'loadURDF("ball.urdf")')  # fmt: skip
BALL = """<robot name="ball"><link name="ball"><inertial><origin xyz="0 0 .5"/><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1"/></inertial></link></robot>"""


@pytest.mark.parametrize("is_module", [False, True])
def test_an_own_module_and_a_model_are_edited_in_layers_of_their_runs(
    program: Program, is_module: bool
) -> None:
    """Free fall over 20 steps from the height that the model has; the user's files stay."""
    fall = -9.8 / 240**2 * 20 * 21 / 2
    for name, text in {
        "mine.py": MINE,
        "ball.urdf": BALL,
        "script.py": "import mine\nmine.main()",
    }.items():
        Path(name).write_text(text)
    program = replace(program, target="script" if is_module else "script.py", is_module=is_module)
    how = again_of(program.target, Reached(), is_module=is_module, took_s=60.0, anyway=False)
    found = {(each.change, each.op): each for each in possible(program, how, "PyBullet")}
    lighter, higher = found["G", "*0.1"], found["origin.xyz", "*2"]
    assert lighter.site == ("mine.py", 3)
    for change, z in ((lighter, 0.5 + 0.1 * fall), (higher, 1 + fall)):
        changed = replace(program, edits=edits_of(change))
        with Reruns(program, how, at=FIRST_LINE) as reruns:
            forked, answer, _ = outcome(reruns, changed)
        assert forked is Fork
        assert isinstance(answer, tuple)
        assert answer[0]["value"] == pytest.approx(z, abs=1e-3)
        started, again, _ = outcome(Reruns(program, how), changed)
        assert (started, again) == (Script, answer)
    assert (Path("mine.py").read_text(), Path("ball.urdf").read_text()) == (MINE, BALL)


def test_a_file_outside_of_the_layers_is_never_edited(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text("N = 4")
    private = Private(str(tmp_path), [], [], network=False)
    for layers in (None, private):
        with pytest.raises(OSError, match="layer"):
            write([[str(file), 4, 5, "7"]], layers)
    assert file.read_text() == "N = 4"


@pytest.mark.parametrize("at", some([FIRST_USE, 0, 7], 1))
def test_a_run_that_parts_later_goes_on_from_there(program: Program, at: int) -> None:
    with Reruns(program, again(), at=at) as reruns:
        kind, answer, _ = outcome(reruns, program)
    assert kind is Fork
    assert isinstance(answer, tuple)
    _, whole, _ = outcome(Reruns(program, again()), program)
    assert isinstance(whole, tuple)
    assert answer[0]["value"] == whole[0]["value"]


@pytest.mark.parametrize(
    "opens",
    some(["import socket; s = socket.socketpair()", "import sqlite3; s = sqlite3.connect('d.db')",
     "import threading; threading.Thread(target=threading.Event().wait, daemon=True).start()",
     "import mmap; s = mmap.mmap(-1, 100)", "import os; s = os.pipe()"], 1),
)  # fmt: skip
def test_what_cannot_be_copied_forbids_a_fork(program: Program, opens: str) -> None:
    Path("script.py").write_text(f"{opens}\n{SCRIPT}")
    with Reruns(program, again()) as reruns:
        kind, answer, _ = outcome(reruns, program)
    assert kind is Script
    assert isinstance(answer, tuple)
    assert answer[1] == ""


def test_threads_of_a_numerical_library_do_not_forbid_a_fork(program: Program) -> None:
    Path("script.py").write_text(
        f"import numpy as np\nnp.ones((300, 300)) @ np.ones(300)\n{SCRIPT}"
    )
    with Reruns(program, again()) as reruns:
        kind, *_ = outcome(reruns, program)
    assert kind is Fork


@pytest.mark.long
def test_a_run_that_takes_too_long_is_stopped(program: Program) -> None:
    """The limit of one second of processor time is reached long before the test would hang."""
    text = SCRIPT.replace("        p.stepSimulation()", "        while True: pass")
    Path("script.py").write_text(text)
    limited = replace(again(), took_s=float("inf"), processor_s=0.0)
    for reruns in (Reruns(program, limited), Reruns(program, limited).__enter__()):
        with reruns.begun(program) as process:
            assert not [*process.events()][1:]
        assert process.ending().how == "interrupted"
        reruns.__exit__(None, None, None)


def test_what_a_run_has_started_ends_with_it(program: Program) -> None:
    sleeps = "import time; time.sleep(9999)"
    Path("script.py").write_text(
        "import subprocess, sys\n"
        f"child = subprocess.Popen([sys.executable, '-c', {sleeps!r}])\n"
        f"print('child', child.pid, flush=True)\n{SCRIPT}"
    )
    with tempfile.TemporaryFile() as printed:
        with Reruns(program, again()).begun(program, printed=printed.fileno()) as process:
            for _ in process.events():
                pass
        printed.seek(0)
        child = int(re.search(rb"child (\d+)", printed.read())[1])  # type: ignore[index]
    wait_for(lambda: has_ended(child), "what the run has started goes on")


def has_ended(process: int) -> bool:
    try:
        return Path(f"/proc/{process}/stat").read_text().split()[2] == "Z"
    except FileNotFoundError:
        return True
