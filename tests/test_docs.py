"""The documents say what the program does."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tomllib
from itertools import chain
from pathlib import Path

import pytest
from conftest import Drop

from pipeline.scenario import Camera, Scenario
from pipeline.stages.run import Run

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
ARCHITECTURE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")


def test_the_readmes_two_commands_are_what_ci_runs() -> None:
    assert "pip install . && drop run" in README
    assert "pip install '.[test]' && pytest" in README
    assert "pip install '.[test]' && pytest" in (ROOT / ".ci" / "run").read_text(encoding="utf-8")


@pytest.mark.parametrize("how", ["@pytest.mark.skipif(True, reason='no')", "@pytest.mark.skip"])
@pytest.mark.parametrize(("ci", "code"), [("", 0), ("true", 1)])
def test_in_ci_nothing_is_skipped(tmp_path: Path, how: str, ci: str, code: int) -> None:
    (tmp_path / "conftest.py").write_bytes((ROOT / "tests" / "conftest.py").read_bytes())
    (tmp_path / "test_it.py").write_text(f"import pytest\n{how}\ndef test_it(): pass\n")
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", tmp_path],
        env=os.environ | {"CI": ci, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == code, done.stdout + done.stderr
    assert ("nothing is skipped" in done.stdout) == bool(ci)


def test_the_story_in_the_readme_is_what_is_printed(
    drop: Drop, tmp_path: Path, standard: Run
) -> None:
    (tmp_path / "run.rrd").write_bytes(standard.simulation.recording.read_bytes())
    printed = drop("analyze", "run.rrd").stdout
    (story,) = re.findall(r"```text\n(.*?)```", README, flags=re.DOTALL)
    assert printed.startswith(story)


def test_the_readme_names_every_option() -> None:
    options = {**Scenario.options(), **Camera.options()}
    for option in options.values():
        assert f"`{option.name}`" in README, option.name


def test_the_readmes_python_runs(tmp_path: Path) -> None:
    (code,) = re.findall(r"```python\n(.*?)```", README, flags=re.DOTALL)
    # Frames take most of the time, and the gif of render needs none of their detail.
    code = code.replace('"fine.rrd"', f'r"{tmp_path / "fine.rrd"}"').replace(
        "timestep_s=1 / 480)", "timestep_s=1 / 480, duration_s=0.5)"
    )
    exec(compile(code, "README.md", "exec"), {})
    assert (tmp_path / "fine.gif").exists()


def test_the_pictures_in_the_readme_are_there_and_small() -> None:
    names = re.findall(r"(?:!\[.*?\]\(|src(?:set)?=\")(.*?)[)\"]", README)
    assert len(names) == 4
    for name in names:
        assert (ROOT / name).stat().st_size < 300_000


def test_every_dependency_has_a_reason() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    wanted = [*project["dependencies"], *chain(*project["optional-dependencies"].values())]
    names = {re.split(r"[\[<>=~! ]", one)[0] for one in wanted} - {"drop"}
    table = ARCHITECTURE.partition("## Dependencies")[2]
    assert [name for name in names if name not in table] == []
