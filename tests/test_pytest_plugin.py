"""The fixture `golden_recording`, in the tests of another project."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator

import pytest
from clients import release_clients
from command import wait_for
from drop_physics import analyze
from drop_physics.recording.other_layer import is_drawn
from drop_physics.recording.reader import read
from drop_physics.stages import block as record_block
from drop_physics.stages import check  # noqa: F401  # what a project's tests import
from drop_physics.stages.block import BlockWriter
from drop_physics.trace.tables import table_of
from test_faults import is_alive

pytest_plugins = ["pytester"]

BOX = """
import pybullet as p
from pybullet import stepSimulation

def drop(height_m, steps=24, step=None):
    p.connect(p.DIRECT)
    p.setGravity(0, 0, -9.81)
    box = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.1] * 3)
    p.createMultiBody(1, box, basePosition=[0, 0, height_m])
    for _ in range(steps):
        (step or p.stepSimulation)()
    p.disconnect()
"""


@pytest.fixture
def project(pytester: pytest.Pytester) -> Iterator[pytest.Pytester]:
    (pytester.mkdir("tests") / "box.py").write_text(BOX)
    release_clients()
    yield pytester
    release_clients()


def run(project: pytest.Pytester, tests: dict[str, str], *options: str) -> tuple[int, str]:
    """Run tests of the project, selected by name; return pytest's exit code and output."""
    written = (f"def test_{name}(golden_recording):\n{test}" for name, test in tests.items())
    (project.path / "tests/test_box.py").write_text("import box\n" + "\n".join(written))
    return run_again(project, *options)


def run_again(project: pytest.Pytester, *options: str) -> tuple[int, str]:
    done = project.runpytest_inprocess("-p", "no:cacheprovider", *options, "tests")
    return int(done.ret), done.stdout.str() + done.stderr.str()


def block(body: str, name: str = "'box'") -> str:
    return f"    with golden_recording({name}):\n        {body}\n"


@pytest.fixture
def writer(monkeypatch: pytest.MonkeyPatch) -> Iterator[BlockWriter]:
    """Return the recording process, shared by all pytest runs in a test to save a second each."""
    kept = BlockWriter()
    monkeypatch.setattr(kept, "close", lambda: None)
    monkeypatch.setattr(record_block, "BlockWriter", lambda: kept)
    yield kept
    BlockWriter.close(kept)


@pytest.mark.long
@pytest.mark.usefixtures("writer")
def test_a_golden_is_made_and_then_holds(
    project: pytest.Pytester, monkeypatch: pytest.MonkeyPatch
) -> None:
    summary = project.path / "summary.md"
    monkeypatch.setenv("GITHUB_STEP_SUMMARY", str(summary))
    monkeypatch.setenv("COLUMNS", "200")
    right, wrong = {"box": block("box.drop(1)")}, {"box": block("box.drop(1.001)")}
    code, text = run(project, right)
    assert code == 1
    assert "make it with: pytest --update-golden" in text
    assert run(project, right, "--update-golden")[0] == 0
    golden = project.path / "tests/golden/box.rrd"
    before = golden.read_bytes()
    beside = golden.with_suffix(".md")
    assert beside.read_text().startswith("# box.rrd\n\nWritten by drop with this golden recording")
    assert "| 0\\_box | 0.000000 | 0.000000 |" in beside.read_text()
    assert run(project, right)[0] == 0
    assert "drop check: same" in summary.read_text()  # of a job that passes, too
    code, text = run(project, wrong)
    assert code == 1
    assert (
        "FAILED tests/test_box.py::test_box - Failed: golden box: step 0, 0_box z_m +0.001" in text
    )
    assert "differs" in text
    assert "1.001" in text
    assert golden.read_bytes() == before
    described = beside.read_text()
    assert run(project, wrong, "--update-golden")[0] == 0
    assert beside.read_text() != described  # the end has changed, and a reviewer sees where
    beside.write_text("notes of someone else")
    assert run(project, right, "--update-golden")[0] == 0
    assert beside.read_text() == "notes of someone else"
    assert "1.001" in summary.read_text()


@pytest.mark.long
def test_one_process_records_all_tests_of_a_run_and_ends_with_it(
    project: pytest.Pytester, monkeypatch: pytest.MonkeyPatch
) -> None:
    """If the process dies, that test says so, and the next one gets a new process."""
    started: list[BlockWriter] = []

    class Counted(BlockWriter):
        def __init__(self) -> None:
            super().__init__()
            started.append(self)

    monkeypatch.setattr(record_block, "BlockWriter", Counted)
    monkeypatch.setattr(record_block, "kill", lambda: started[-1]._process.kill(), raising=False)
    kill = "from drop_physics.stages import block; block.kill(); "
    blocks = ["box.drop(1)", "box.drop(1); 1 / 0", "pass", "box.drop(1)", kill + "box.drop(1)"]
    tests = {f"number_{number}": block(body) for number, body in enumerate([*blocks, blocks[0]])}
    monkeypatch.setenv("COLUMNS", "200")
    code, text = run(project, tests, "--update-golden")
    assert code == 1
    assert ".FF.F." in text
    assert "number_4 - drop_physics.errors.OutputError: " in text
    assert "the process that writes the recording ended" in text
    assert len(started) == 2
    assert all(each._process.poll() is not None for each in started)


NAMES = ("calendar", "queue", "random", "statistics", "types")
LIGHT = """
import box, sys
def test_first(golden_recording):
    with golden_recording("first"):
        box.drop(1)
def test_second(golden_recording):
    with golden_recording("second"):
        box.drop(1)
    assert not {"polars", "pyarrow", "rerun", "PIL"} & set(sys.modules)
"""


@pytest.mark.long
def test_with_xdist_beside_modules_called_as_pythons_and_without_ours(
    project: pytest.Pytester,
) -> None:
    """The recording process does not import modules that lie beside the tests."""
    (project.path / "tests/test_box.py").write_text(LIGHT)
    for name in NAMES:
        (project.path / f"tests/{name}.py").write_text("raise SystemError")
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-n", "2", "tests"]
    for more in ("--update-golden", "-v"):
        done = subprocess.run(
            [*command, more], cwd=project.path, capture_output=True, text=True, check=False
        )
        assert "2 passed" in done.stdout, done.stdout + done.stderr


@pytest.mark.long
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_an_interrupted_run_leaves_a_whole_recording_and_no_process(
    project: pytest.Pytester, number: signal.Signals
) -> None:
    body = "box.drop(1); open('there', 'w').close(); [box.drop(1) for _ in iter(int, 1)]"
    (project.path / "tests/test_box.py").write_text(
        f"import box\ndef test_box(golden_recording):\n{block(body)}"
    )
    process = subprocess.Popen(
        [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "--basetemp=new", "tests"],
        cwd=project.path,
        stdout=subprocess.PIPE,
        start_new_session=True,
    )
    wait_for((project.path / "there").exists, "the test did not come so far")
    os.killpg(process.pid, signal.SIGINT) if number == signal.SIGINT else process.kill()
    process.communicate()
    assert process.returncode == (2 if number == signal.SIGINT else -signal.SIGKILL)
    wait_for(lambda: not is_alive(process.pid), "a process was left behind")
    recording = project.path / "new/test_box0/golden_recording.rrd"
    assert len(read(recording).states) >= 25


@pytest.mark.long
def test_a_tolerance_passes_what_is_within(project: pytest.Pytester) -> None:
    assert run(project, {"box": block("box.drop(1)")}, "--update-golden")[0] == 0
    allowed = {"wide": "'1e-2'", "narrow": "1e-9"}
    tests = {
        name: block("box.drop(1.001)", f"'box', tolerance={value}")
        for name, value in allowed.items()
    }
    _, text = run(project, tests)
    assert "1 failed, 1 passed" in text
    assert "FAILED tests/test_box.py::test_narrow" in text


SET_UP = """
import pybullet as p, pytest
@pytest.fixture
def box(golden_recording):
    p.connect(p.DIRECT)
    p.setGravity(0, 0, -9.81)
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.1] * 3)
    body = p.createMultiBody(1, shape, basePosition=[0, 0, 1])
    p.changeDynamics(body, -1, linearDamping=0)
    p.stepSimulation()
    yield
    p.disconnect()
def test_box(golden_recording, box):
    with golden_recording("box"):
        STEPS
"""


@pytest.mark.long
def test_set_up_after_the_fixture_is_seen(project: pytest.Pytester) -> None:
    tests = project.path / "tests/test_box.py"
    tests.write_text(SET_UP.replace("STEPS", "p.stepSimulation()"))
    assert run_again(project, "--update-golden")[0] == 0
    (golden,) = project.path.rglob("golden/box.rrd")
    seen = read(golden).seen
    # As the law says: without damping, which the engine does not report, for two steps.
    assert table_of(seen.bases)["z_m"][-1] == pytest.approx(1 - 3 * 9.81 / 240**2, abs=1e-15)
    assert {call.function for piece in seen.pieces() for call in piece.calls} >= {"changeDynamics"}
    assert analyze(golden).explained.samples == 3
    assert not is_drawn(golden)
    tests.write_text(SET_UP.replace("STEPS", "pass"))
    assert "recorded no step" in run_again(project)[1]


@pytest.mark.long
def test_what_cannot_be_a_golden_fails_and_says_why(
    project: pytest.Pytester, monkeypatch: pytest.MonkeyPatch
) -> None:
    cases = {
        "another_step": (block("box.drop(1, step=box.stepSimulation)"), "recorded no step"),
        "outside": (block("box.drop(1)", "'../box'"), "must be that of a file in"),
        "words": (block("box.drop(1)", "'box', tolerance='a bit'"), "must be a number of metres"),
        "theirs": (block("raise KeyError('theirs')"), "KeyError: 'theirs'"),
    }
    tests = {name: test for name, (test, _) in cases.items()}
    monkeypatch.setenv("COLUMNS", "200")
    _, text = run(project, tests, "--update-golden", "--tb=line")
    assert "4 failed" in text
    summary = [line for line in text.splitlines() if line.startswith("FAILED")]
    for line, (name, (_, words)) in zip(summary, cases.items(), strict=True):
        assert f"test_{name} " in line
        assert words in line
    assert not list(project.path.rglob("*box.rrd"))


def test_the_plugin_loads_nothing_until_it_is_used() -> None:
    code = (
        "import sys, drop_physics.pytest_plugin\n"
        "print({'numpy', 'polars', 'pybullet', 'rerun', 'typer'} & set(sys.modules))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "set()\n"
