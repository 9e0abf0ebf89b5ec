"""The house: which rooms may know which, and what the command line may load."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import pipeline

PACKAGE = Path(pipeline.__file__).parent

# Room -> the rooms it may import from. Nothing else: arrows point down only.
MAY_IMPORT: dict[str, set[str]] = {
    "errors": set(),
    "colours": set(),
    "fields": {"errors"},
    "scenario": {"errors", "fields"},
    "options": {"fields", "scenario"},
    "workers": {"errors"},
    "physics": {"errors", "scenario", "workers"},
    "budget": {"errors", "scenario", "physics"},
    "recording": {"errors", "fields", "scenario", "colours"},
    "figures": {"errors", "colours"},
    "sweeping": {"errors", "fields", "scenario", "recording"},
    "stages": {
        "errors",
        "workers",
        "sweeping",
        "fields",
        "scenario",
        "physics",
        "budget",
        "recording",
        "figures",
        "colours",
    },
    "console": {"errors", "fields", "scenario", "budget", "stages"},
}
# Library -> the only files that may import it.
ONLY_IN = {
    "pybullet": {"physics/world.py"},
    "pybullet_data": {"physics/world.py"},
    "rerun": {"recording/"},
    "matplotlib": {"figures/"},
    "typer": {"options.py", "console/running.py", "console/help.py"},
}
# The judge never knows what it judges.
JUDGE = (
    "physics/theory.py",
    "physics/bullet_law.py",
    "physics/contact_law.py",
    "physics/spin_law.py",
    "budget/",
)


def imports_of(path: Path) -> set[str]:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    found: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
    return found


FILES = {str(path.relative_to(PACKAGE)): path for path in sorted(PACKAGE.rglob("*.py"))}


@pytest.mark.parametrize("name", FILES)
def test_rooms_import_downwards_only(name: str) -> None:
    room = Path(name).parts[0].removesuffix(".py")
    if room == "__init__":
        return
    ours = {one.split(".")[1] for one in imports_of(FILES[name]) if one.startswith("pipeline.")}
    assert ours - {room} <= MAY_IMPORT[room]


@pytest.mark.parametrize("name", FILES)
def test_libraries_stay_in_their_rooms(name: str) -> None:
    libraries = {one.split(".")[0] for one in imports_of(FILES[name])}
    for library, homes in ONLY_IN.items():
        if library in libraries:
            assert any(name.startswith(home) for home in homes), f"{name} imports {library}"


@pytest.mark.parametrize("name", [name for name in FILES if name.startswith(JUDGE)])
def test_the_judge_knows_neither_engine_nor_recorder(name: str) -> None:
    known = imports_of(FILES[name])
    assert not any(one.startswith(("pybullet", "rerun", "pipeline.recording")) for one in known)
    assert "pipeline.physics.world" not in known


@pytest.mark.parametrize("name", FILES)
def test_no_file_is_longer_than_one_idea(name: str) -> None:
    assert len(FILES[name].read_text(encoding="utf-8").splitlines()) <= 330


def test_help_loads_no_heavy_library() -> None:
    code = (
        "import sys; sys.argv = ['drop', '--help']\n"
        "import cli\n"
        "try: cli.main()\n"
        "except SystemExit: pass\n"
        "heavy = {'numpy', 'polars', 'pybullet', 'rerun', 'matplotlib', 'scipy', 'PIL'}\n"
        "print(sorted(heavy & set(sys.modules)), file=sys.stderr)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "Usage: drop" in done.stdout
    assert done.stderr.strip() == "[]"
