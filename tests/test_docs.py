"""The documents agree with the program."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tomllib
from itertools import chain
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from conftest import some
from drop_physics import analyze, simulate
from drop_physics.installed import PYBULLET, VERSION
from drop_physics.scenario import Camera, Scenario
from drop_physics.stages.run import Run
from packaging.markers import Marker
from PIL import Image

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
BOX, BOX_JA = (
    (ROOT / "docs" / page).read_text(encoding="utf-8") for page in ("drop.md", "drop.ja.md")
)
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
TEXTS = (".md", ".py", ".json")
ARCHITECTURE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")


def test_the_readmes_two_commands_are_what_ci_runs() -> None:
    assert "pip install . && drop run" in README
    assert "pip install '.[test]' && pytest" in README
    ci = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    assert re.findall(r"^pip.*|^pytest.*|pip\" install '\S+'", ci, re.MULTILINE) == [
        "pip\" install '.[dev]'",
        "pip install '.[test]' && pytest",
        'pytest -m "needs or long"',
    ]
    assert "-m build" in ci
    assert 'twine" check --strict' in ci


SKIPPING = """
import pytest
@pytest.mark.skip
def test_skip(): pass
@pytest.mark.skipif(True, reason="no")
def test_skipif(): pass
@pytest.mark.needs("not_there")
def test_without(): pass
@pytest.mark.needs("json")
def test_with(): pass
"""


@pytest.mark.long
@pytest.mark.parametrize(
    ("ci", "options", "failed", "passed"),
    [
        ("", [], set(), {"with"}),
        ("true", [], {"skip", "skipif"}, {"with"}),  # CI runs once more, with the extras:
        ("true", ["-m", "needs or long"], {"without"}, {"with"}),
    ],
)
def test_in_ci_nothing_is_skipped(
    tmp_path: Path, ci: str, options: list[str], failed: set[str], passed: set[str]
) -> None:
    (tmp_path / "conftest.py").write_bytes((ROOT / "tests" / "skipping.py").read_bytes())
    (tmp_path / "test_it.py").write_text(SKIPPING)
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-rA", "-p", "no:cacheprovider", *options, tmp_path],
        env=os.environ | {"CI": ci, "PYTHONPATH": f"{ROOT}{os.pathsep}{ROOT / 'tests'}"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == bool(failed), done.stdout + done.stderr
    ended = re.findall(r"^(ERROR|PASSED) .*::test_(\w+)", done.stdout, re.MULTILINE)
    assert {name for how, name in ended if how == "ERROR"} == failed
    assert {name for how, name in ended if how == "PASSED"} == passed
    assert ("nothing is skipped" in done.stdout) == bool(failed)


def test_the_readme_is_short_and_asks_first_what_readers_ask() -> None:
    for page in ("README.md", "README.ja.md"):
        assert len((ROOT / page).read_text(encoding="utf-8").splitlines()) <= 180
    assert README.splitlines()[2] == "*Why did my simulation do that?*"
    shown = {
        section.partition("\n")[0]: re.search(r"^(?:\$ )?(drop [\w/.]+)", section, re.MULTILINE)
        for section in README.split("\n## ")[1:4]
    }
    assert {question: found and found[1] for question, found in shown.items()} == {
        "Why did it do that?": "drop docs/examples/arm.py",
        "Why did it not do what I wanted?": "drop why",
        "Why is it not the same?": "drop diff",
    }
    assert len(README.split()) <= 900


def test_every_option_of_the_box_is_told_in_japanese_too() -> None:
    """Help texts are in English only, and `docs/commands.md` with them."""
    options = {**Scenario.options(), **Camera.options()}
    for option in options.values():
        assert f"`{option.name}`" in BOX_JA, option.name


def test_the_pictures_in_the_readme_exist_and_are_small() -> None:
    names = re.findall(r"(?:!\[.*?\]\(|src(?:set)?=\")(.*?)[)\"]", README)
    assert len(names) == 8
    for name in names:
        assert (ROOT / name).stat().st_size < 400_000


def test_pybullet_is_required_where_it_has_a_wheel_and_an_extra_elsewhere() -> None:
    (required,) = (one for one in PROJECT["dependencies"] if "pybullet" in one)
    pinned, marker = required.split("; ")
    assert PROJECT["optional-dependencies"]["pybullet"] == [pinned]
    assert pinned == f"{PYBULLET}=={VERSION}"
    where = Marker(marker)
    linux = {"sys_platform": "linux", "platform_machine": "x86_64", "python_version": "3.11"}
    assert where.evaluate(linux)
    for other in (
        {"python_version": "3.12"},
        {"sys_platform": "darwin"},
        {"platform_machine": "aarch64"},
    ):
        assert not where.evaluate(linux | other)
    for page in ("README.md", "README.ja.md", "docs/install.md"):
        assert VERSION in (ROOT / page).read_text(encoding="utf-8")


def test_every_dependency_has_a_reason() -> None:
    wanted = [*PROJECT["dependencies"], *chain(*PROJECT["optional-dependencies"].values())]
    names = {re.split(r"[\[<>=~! ]", requirement)[0] for requirement in wanted} - {"drop-physics"}
    table = ARCHITECTURE.partition("## Dependencies")[2]
    assert [name for name in names if name not in table] == []


def test_nobody_is_told_to_install_somebody_elses_package() -> None:
    """The package index has an unrelated `drop`; ours is `drop-physics`."""
    assert PROJECT["name"] == "drop-physics"
    assert list(PROJECT["scripts"]) == ["drop"]
    others = re.compile(
        r"install (-\S+ )*['\"]?drop\b(?!-physics)|['\"]drop\[|version(_of)?\(.drop.\)"
    )
    folders = [ROOT / name for name in ("docs", "pipeline", "tests", "benchmarks", "recordings")]
    files = [ROOT / "cli.py", ROOT / "pyproject.toml", ROOT / ".ci/run", *ROOT.glob("*.md")]
    files += [file for folder in folders for file in folder.rglob("*") if file.suffix in TEXTS]
    assert len(files) > 150
    wrong = [file for file in files if others.search(file.read_text(encoding="utf-8"))]
    assert wrong == []


@pytest.mark.long
def test_the_pipeline_to_copy_is_50_lines_and_comes_to_what_we_say(
    tmp_path: Path, standard: Run
) -> None:
    """Its damping is a difference of two runs, which contains part of what we call interaction."""
    page = (ROOT / "docs/pipeline.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    lines = [line for line in code.splitlines() if line.strip() and line.lstrip()[0] != "#"]
    assert len(lines) == 50
    assert max(map(len, lines)) <= 100
    assert "drop" not in "".join(line for line in lines if "import" in line)
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code],
        cwd=tmp_path,
        env=os.environ | {"MPLBACKEND": "agg"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    printed = re.findall(r"^(\w+) +([-+][\d.]+) mm$", done.stdout, re.MULTILINE)
    (moment,) = standard.analysis.at
    terms = moment.terms_m
    expected_m = {
        "timestep": terms.timestep,
        "damping": terms.damping + terms.interaction,
        "total": moment.error_m,
    }
    assert printed == [(name, f"{value_m * 1e3:+.4f}") for name, value_m in expected_m.items()]
    with Image.open(tmp_path / "falls.gif") as film:
        assert film.n_frames == 13
    assert {path.name for path in tmp_path.iterdir()} == {"falls.rrd", "falls.png", "falls.gif"}


NAMED_ON = ("architecture",)
"""Pages that name source files of ours."""


@pytest.mark.parametrize("page", NAMED_ON)
def test_the_files_that_a_page_names_exist(page: str) -> None:
    text = (ROOT / f"docs/{page}.md").read_text(encoding="utf-8")
    named = {one for one in re.findall(r"`([\w./]+\.py)`", text) if "NAME" not in one}
    places = [ROOT / "pipeline/drop_physics", ROOT]
    assert named
    assert [name for name in named if not any((place / name).exists() for place in places)] == []


EPSILON = 2.0**-52


@pytest.mark.pybullet
@pytest.mark.parametrize(
    "scenario",
    some(
        [
            Scenario(),
            Scenario(height_m=1000, duration_s=2, timestep_s=1 / 4000, linear_damping=0.0),
            Scenario(height_m=1e4, timestep_s=0.02, duration_s=20),
            Scenario(height_m=0.03, velocity_m_s=(3, 0, 9), duration_s=1.5),
            Scenario(floor=False, duration_s=30, linear_damping=0.0),
            Scenario(coordinates="maximal", linear_damping=0.3, height_m=50, duration_s=3),
            Scenario(height_m=1000, duration_s=10),
        ],
        2,
    ),
    ids=["standard", "small steps", "large steps", "thrown", "no floor", "maximal", "high"],
)
def test_rounding_is_as_small_as_the_page_says(scenario: Scenario, tmp_path: Path) -> None:
    """The bound is steps × 2⁻⁵² × the greatest height; in 35 scenarios at most 0.36 of it occurs.

    A position rounds by at most half of 2⁻⁵² of itself in each step. So do velocities, and the more
    steps there are, the more of these roundings cancel.
    """
    simulate(scenario, tmp_path / "run.rrd", camera=None)
    analyze(tmp_path / "run.rrd", table=tmp_path / "run.parquet")
    rows = pl.read_parquet(tmp_path / "run.parquet").filter(pl.col("rounding_m").is_not_null())
    steps, height_m, rounding_m = (
        rows[name].to_numpy() for name in ("step", "simulated_m", "rounding_m")
    )
    assert len(steps) > 5
    bound_m = EPSILON * steps * np.maximum.accumulate(np.abs(height_m))
    assert (np.abs(rounding_m) <= bound_m).all()
    if scenario == Scenario():
        assert f"{abs(rounding_m[72]) * 1e16:.1f} × 10⁻¹⁶ m at 0.3 s" in BOX
    if scenario == Scenario(height_m=1000, duration_s=10):
        assert f"{abs(rounding_m[-1]) * 1e12:.1f} × 10⁻¹² m after 10 s" in BOX


def test_the_reference_says_what_every_exit_code_means() -> None:
    commands = " ".join((ROOT / "docs/commands.md").read_text(encoding="utf-8").split())
    assert (
        "Exit codes: 0 done, 1 failed, 2 wrong usage, 3 a check did not pass, 130 stopped by "
        "Ctrl-C (143 by SIGTERM)" in commands
    )
