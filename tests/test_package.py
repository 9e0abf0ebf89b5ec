"""The wheel is complete: it holds the program and nothing else, and runs where no checkout is."""

from __future__ import annotations

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
DROP = "from importlib.metadata import entry_points as e; [d] = e(name='drop'); d.load()()"


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a wheel built from this folder, as `pip install .` builds one."""
    folder = tmp_path_factory.mktemp("wheel")
    subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)],
        cwd=ROOT, check=True, capture_output=True,
    )  # fmt: skip
    (path,) = folder.glob("*.whl")
    return path


def test_the_wheel_holds_the_program_and_nothing_else(wheel: Path) -> None:
    held = {name for name in zipfile.ZipFile(wheel).namelist() if ".dist-info/" not in name}
    code = {
        path.relative_to(ROOT).as_posix()
        for kind in ("*.py", "*.json", "*.po", "*.mo")
        for path in (ROOT / "pipeline").rglob(kind)
    }
    assert held == code | {"cli.py", "pipeline/py.typed"}


def test_installed_it_runs_in_a_clean_folder(wheel: Path, tmp_path: Path) -> None:
    """A wheel without data files is installed by unpacking it: nothing of the checkout is there."""
    installed, clean = tmp_path / "installed", tmp_path / "clean"
    zipfile.ZipFile(wheel).extractall(installed)
    clean.mkdir()

    def python(code: str, *arguments: str) -> str:
        return subprocess.run(
            [sys.executable, "-P", "-c", code, *arguments],
            cwd=clean, env={**os.environ, "PYTHONPATH": str(installed)},
            check=True, capture_output=True, text=True,
        ).stdout  # fmt: skip

    where = python("import cli, pipeline; print(cli.__file__, *pipeline.__path__, sep='\\n')")
    assert where.splitlines() == [str(installed / "cli.py"), str(installed / "pipeline")]
    story = python(DROP, "run", "--size", "64x48")
    assert "recordings/run.rrd" in story
    made = {path.relative_to(clean).as_posix() for path in clean.rglob("*") if path.is_file()}
    assert made == {f"recordings/run{end}" for end in (".rrd", ".analysis.rrd", ".gif", ".png")}
