"""The fixture `golden_recording`, in the tests of a project that is not ours."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator

import pytest
from clients import release_clients
from drop_physics import analyze
from drop_physics.recording.other_layer import is_drawn
from drop_physics.recording.reader import read
from drop_physics.stages import check, record_block  # noqa: F401  # what a project's tests import
from drop_physics.trace.tables import table_of

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
    """Run tests of the project, by name, and return pytest's exit code and output."""
    written = (f"def test_{name}(golden_recording):\n{test}" for name, test in tests.items())
    (project.path / "tests/test_box.py").write_text("import box\n" + "\n".join(written))
    return run_again(project, *options)


def run_again(project: pytest.Pytester, *options: str) -> tuple[int, str]:
    done = project.runpytest_inprocess("-p", "no:cacheprovider", *options, "tests")
    return int(done.ret), done.stdout.str() + done.stderr.str()


def block(body: str, name: str = "'box'") -> str:
    return f"    with golden_recording({name}):\n        {body}\n"


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
    assert run(project, right)[0] == 0
    assert not summary.exists()
    code, text = run(project, wrong)
    assert code == 1
    assert "differs" in text
    assert "step 0" in text
    assert "1.001" in text
    assert golden.read_bytes() == before
    assert "1.001" in summary.read_text()


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
