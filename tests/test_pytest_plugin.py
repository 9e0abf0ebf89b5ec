"""The fixture `golden_recording`, in the tests of a project that is not ours."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

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


def run(project: Path, test: str, *options: str) -> tuple[int, str]:
    """Run a test of the project, and return pytest's exit code and output."""
    (project / "tests/test_box.py").write_text(
        f"import box\ndef test_box(golden_recording):\n{test}"
    )
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", *options, "tests"],
        cwd=project, capture_output=True, text=True, check=False,
    )  # fmt: skip
    return done.returncode, done.stdout + done.stderr


def block(body: str, name: str = "'box'") -> str:
    return f"    with golden_recording({name}):\n        {body}\n"


def test_a_golden_is_made_and_then_holds(project: Path) -> None:
    code, text = run(project, block("box.drop(1)"))
    assert code == 1
    assert "make it with: pytest --update-golden" in text
    assert run(project, block("box.drop(1)"), "--update-golden")[0] == 0
    golden = project / "tests/golden/box.rrd"
    before = golden.read_bytes()
    assert run(project, block("box.drop(1)"), "-n", "2")[0] == 0
    code, text = run(project, block("box.drop(1.001)"))
    assert code == 1
    assert "differs" in text
    assert "step 0" in text
    assert "1.001" in text
    assert golden.read_bytes() == before


@pytest.mark.parametrize(("allowed", "code"), [("0.01", 0), ("'1e-2'", 0), ("1e-9", 1)])
def test_a_tolerance_passes_what_is_within(project: Path, allowed: str, code: int) -> None:
    assert run(project, block("box.drop(1)"), "--update-golden")[0] == 0
    test = block("box.drop(1.001)", f"'box', tolerance={allowed}")
    assert run(project, test)[0] == code


@pytest.mark.parametrize(
    ("test", "words"),
    [
        (block("box.drop(1, step=box.stepSimulation)"), "recorded no step"),
        (block("box.drop(1, steps=0)"), "recorded no step"),
        (block("box.drop(1)", "'../box'"), "must be that of a file in"),
        (block("box.drop(1)", "'box', tolerance='a bit'"), "must be a number of metres"),
        (block("box.drop(1)", "'box', tolerance=-1"), "must be"),
        (block("raise KeyError('theirs')"), "KeyError: 'theirs'"),
    ],
)
def test_what_cannot_be_a_golden_fails_and_says_why(project: Path, test: str, words: str) -> None:
    code, text = run(project, test, "--update-golden")
    assert code == 1
    assert words in text
    assert not list(project.rglob("*box.rrd")) or not (project / "tests/golden").exists()


def test_the_plugin_loads_nothing_until_it_is_used() -> None:
    code = (
        "import sys, drop_physics.pytest_plugin\n"
        "print({'numpy', 'polars', 'pybullet', 'rerun', 'typer'} & set(sys.modules))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "set()\n"
