"""The fixture `golden_recording`, in the tests of a project that is not ours."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from drop_physics import analyze
from drop_physics.recording.other_layer import is_drawn
from drop_physics.recording.reader import read

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
def project(tmp_path: Path) -> Path:
    (tmp_path / "tests").mkdir()
    (tmp_path / "tests/box.py").write_text(BOX)
    return tmp_path


def run(project: Path, tests: dict[str, str], *options: str) -> tuple[int, str]:
    """Run tests of the project, by name, and return pytest's exit code and output."""
    written = (f"def test_{name}(golden_recording):\n{test}" for name, test in tests.items())
    (project / "tests/test_box.py").write_text("import box\n" + "\n".join(written))
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", *options, "tests"],
        cwd=project, capture_output=True, text=True, check=False,
        env={**os.environ, "COLUMNS": "200"},
    )  # fmt: skip
    return done.returncode, done.stdout + done.stderr


def block(body: str, name: str = "'box'") -> str:
    return f"    with golden_recording({name}):\n        {body}\n"


def test_a_golden_is_made_and_then_holds(project: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    summary = project / "summary.md"
    monkeypatch.setenv("GITHUB_STEP_SUMMARY", str(summary))
    right, wrong = {"box": block("box.drop(1)")}, {"box": block("box.drop(1.001)")}
    code, text = run(project, right)
    assert code == 1
    assert "make it with: pytest --update-golden" in text
    assert run(project, right, "--update-golden")[0] == 0
    golden = project / "tests/golden/box.rrd"
    before = golden.read_bytes()
    assert run(project, right, "-n", "2")[0] == 0
    assert not summary.exists()
    code, text = run(project, wrong)
    assert code == 1
    assert "differs" in text
    assert "step 0" in text
    assert "1.001" in text
    assert golden.read_bytes() == before
    assert "1.001" in summary.read_text()


@pytest.mark.long
def test_a_tolerance_passes_what_is_within(project: Path) -> None:
    assert run(project, {"box": block("box.drop(1)")}, "--update-golden")[0] == 0
    allowed = {"wide": "0.01", "text": "'1e-2'", "narrow": "1e-9"}
    tests = {
        name: block("box.drop(1.001)", f"'box', tolerance={value}")
        for name, value in allowed.items()
    }
    _, text = run(project, tests)
    assert "1 failed, 2 passed" in text
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
def test_set_up_after_the_fixture_is_seen(project: Path) -> None:
    (project / "tests/test_box.py").write_text(SET_UP.replace("STEPS", "p.stepSimulation()"))
    call = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "tests"]
    subprocess.run([*call, "--update-golden"], cwd=project, check=True)
    (golden,) = project.rglob("golden/box.rrd")
    seen = read(golden).seen
    # As the law says: without damping, which the engine does not report, for two steps.
    assert seen.bases["z_m"][-1] == pytest.approx(1 - 3 * 9.81 / 240**2, abs=1e-15)
    assert {call.function for piece in seen.pieces() for call in piece.calls} >= {"changeDynamics"}
    assert analyze(golden).explained.samples == 3
    assert not is_drawn(golden)
    (project / "tests/test_box.py").write_text(SET_UP.replace("STEPS", "pass"))
    done = subprocess.run(call, cwd=project, capture_output=True, text=True, check=False)
    assert "recorded no step" in done.stdout


@pytest.mark.long
def test_what_cannot_be_a_golden_fails_and_says_why(project: Path) -> None:
    cases = {
        "another_step": (block("box.drop(1, step=box.stepSimulation)"), "recorded no step"),
        "no_step": (block("box.drop(1, steps=0)"), "recorded no step"),
        "outside": (block("box.drop(1)", "'../box'"), "must be that of a file in"),
        "words": (block("box.drop(1)", "'box', tolerance='a bit'"), "must be a number of metres"),
        "negative": (block("box.drop(1)", "'box', tolerance=-1"), "must be"),
        "theirs": (block("raise KeyError('theirs')"), "KeyError: 'theirs'"),
    }
    tests = {name: test for name, (test, _) in cases.items()}
    _, text = run(project, tests, "--update-golden", "--tb=line")
    assert "6 failed" in text
    summary = [line for line in text.splitlines() if line.startswith("FAILED")]
    for line, (name, (_, words)) in zip(summary, cases.items(), strict=True):
        assert f"test_{name} " in line
        assert words in line
    assert not list(project.rglob("*box.rrd"))


def test_the_plugin_loads_nothing_until_it_is_used() -> None:
    code = (
        "import sys, drop_physics.pytest_plugin\n"
        "print({'numpy', 'polars', 'pybullet', 'rerun', 'typer'} & set(sys.modules))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "set()\n"
