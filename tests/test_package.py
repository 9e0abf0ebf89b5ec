"""The wheel is complete: it contains only the program, and runs without a checkout."""

from __future__ import annotations

import os
import subprocess
import sys
import sysconfig
import venv
import zipfile
from collections.abc import Callable
from importlib.metadata import distributions
from pathlib import Path

import pytest
from command import HANGS_S

ROOT = Path(__file__).parents[1]
SOURCES = ROOT / "pipeline"


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a wheel built from this folder, as `pip install .` builds it."""
    folder = tmp_path_factory.mktemp("wheel")
    subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)],
        cwd=ROOT,
        check=True,
        capture_output=True,
    )
    (path,) = folder.glob("*.whl")
    return path


def test_the_wheel_holds_the_program_and_nothing_else(wheel: Path) -> None:
    held = {name for name in zipfile.ZipFile(wheel).namelist() if ".dist-info/" not in name}
    code = {
        path.relative_to(SOURCES).as_posix()
        for kind in ("*.py", "*.json", "*.urdf")
        for path in SOURCES.rglob(kind)
    }
    built = {"drop_physics/locale/ja/LC_MESSAGES/drop.mo", "drop_physics/rules/why.md"}
    assert held == code | built | {"drop_physics/py.typed"}


@pytest.fixture(scope="module")
def environment(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the `bin` of a new environment with the wheel and this environment's libraries."""
    folder = tmp_path_factory.mktemp("environment")
    venv.create(folder, symlinks=True)
    (packages,) = folder.glob("lib/python*/site-packages")
    zipfile.ZipFile(wheel).extractall(packages)  # a wheel without data files: as pip installs it
    libraries = f"import site; site.addsitedir({sysconfig.get_path('purelib')!r})\n"
    packages.joinpath("libraries.pth").write_text(libraries)
    drop = folder / "bin/drop"
    (built,) = distributions(path=[str(packages)])
    (entry,) = built.entry_points.select(group="console_scripts")
    module, function = entry.value.split(":")
    drop.write_text(f"#!{folder}/bin/python\nfrom {module} import {function}\n{function}()\n")
    drop.chmod(0o755)
    return folder / "bin"


Call = Callable[..., str]


@pytest.fixture
def call(environment: Path, tmp_path: Path) -> Call:
    """Return a function that runs an installed program in a folder."""

    def run(folder: Path, program: str, *arguments: str) -> str:
        done = subprocess.run(
            [environment / program, *arguments],
            cwd=folder,
            capture_output=True,
            text=True,
            check=False,
            timeout=HANGS_S,
            env={"HOME": str(tmp_path), "PATH": f"{environment}:{os.environ['PATH']}"},
        )
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    return run


def test_it_takes_one_import_name(call: Call, environment: Path, tmp_path: Path) -> None:
    (packages,) = environment.parent.glob("lib/python*/site-packages")
    for name in ("pipeline", "cli"):
        code = f"import importlib.util as u; print(u.find_spec({name!r}))"
        assert call(tmp_path, "python", "-c", code) == "None\n"
    where = call(tmp_path, "python", "-c", "import drop_physics; print(*drop_physics.__path__)")
    assert where.strip() == str(packages / "drop_physics")


def test_it_explains_in_the_readers_language_with_an_example(call: Call, tmp_path: Path) -> None:
    """It needs files that the build adds: translations, and a page."""
    assert "docs/examples/why/slides.py:14" in call(tmp_path, "drop", "explain", "slides")
    script = "import os; os.environ['DROP_LANG'] = 'ja'\n"
    script += "from drop_physics.messages import localized; print(localized('Contacts'))"
    assert call(tmp_path, "python", "-c", script) == "接触\n"


@pytest.mark.long
def test_installed_it_runs_in_a_clean_folder(call: Call, tmp_path: Path) -> None:
    story = call(tmp_path, "drop", "run", "--size", "64x48")
    assert "recordings/run.rrd" in story
    made = {path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("recordings/*")}
    assert made == {f"recordings/run{end}" for end in (".rrd", ".analysis.rrd", ".gif", ".png")}


@pytest.mark.long
def test_a_project_with_the_same_names_keeps_its_own(call: Call, tmp_path: Path) -> None:
    """Their `pipeline` package, `cli.py`, `tests` and `recordings` are in the same environment."""
    theirs = {
        "pipeline/__init__.py": "MINE = 'pipeline'",
        "cli.py": "MINE = 'cli'",
        "recordings/notes.txt": "not ours",
        "tests/__init__.py": "",
        "tests/test_theirs.py": "import cli, pipeline\n"
        "def test_mine():\n    assert (cli.MINE, pipeline.MINE) == ('cli', 'pipeline')\n",
        "theirs.py": "import cli, pipeline, pybullet as p\n"
        "p.connect(p.DIRECT)\np.setGravity(0, 0, -9.81)\n"
        "p.createMultiBody(1, p.createCollisionShape(p.GEOM_BOX, halfExtents=[.1] * 3))\n"
        "for _ in range(10): p.stepSimulation()\nprint(cli.MINE, pipeline.MINE)\n",
    }
    for name, text in theirs.items():
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
    assert "recordings/run.rrd" in call(tmp_path, "drop", "run", "--no-camera")
    assert call(tmp_path, "drop", "record", "theirs.py").startswith("cli pipeline\n")
    assert "drop 0." in call(tmp_path, "python", "-m", "drop_physics", "--version")
    assert "100 % explained" in call(
        tmp_path, "python", "-m", "drop_physics", "analyze", "recordings/theirs.rrd"
    )
    ran = call(tmp_path, "python", "-m", "pytest", "-p", "no:cacheprovider", "-q")
    assert "1 passed" in ran
    assert {name: (tmp_path / name).read_text() for name in theirs} == theirs
