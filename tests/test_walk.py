"""The walk through the code in `docs/architecture.md` matches the code."""

from __future__ import annotations

import ast
import re
import sys
from pathlib import Path
from types import FrameType

import drop_physics
import pytest
from conftest import Drop

pytestmark = pytest.mark.pybullet

PACKAGE = Path(drop_physics.__file__).parent
ARCHITECTURE = Path(__file__).parents[1] / "docs/architecture.md"
WALK = ARCHITECTURE.read_text(encoding="utf-8").partition("## A walk")[2].partition("\n## ")[0]
STOPS = [
    (file, re.findall(r"`([\w.]+)`", names))
    for file, names in re.findall(r"^\d+\. `([\w/]+\.py)`, ([`\w., ]+): ", WALK, re.MULTILINE)
]
"""Files in the order of the walk, each with the names mentioned; the first is the entry point."""
IN_THE_SCRIPT = ("engines/watching/", "engines/pybullet/watch/")
"""Folders whose code runs in the script's process, which this test cannot observe."""
SCRIPT = """
import pybullet as p, pybullet_data
p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
p.loadURDF("plane.urdf")
p.loadURDF("cube_small.urdf", [0, 0, 0.03])
for _ in range(20):
    p.stepSimulation()
"""


def test_every_stop_of_the_walk_names_a_file_and_what_is_defined_in_it() -> None:
    assert len(STOPS) == len(re.findall(r"^\d+\. ", WALK, re.MULTILINE)) > 15
    for file, names in STOPS:
        tree = ast.parse((PACKAGE / file).read_text(encoding="utf-8"))
        assert names
        assert set(names) <= set(_defined(tree)), file


def _defined(tree: ast.AST, inside: str = "") -> list[str]:
    """Return the functions, classes and methods in a syntax tree, methods as `Class.method`."""
    found = []
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            found += [inside + node.name, *_defined(node, f"{inside}{node.name}.")]
    return found


def test_a_script_goes_the_way_of_the_walk(drop: Drop, tmp_path: Path) -> None:
    (tmp_path / "box.py").write_text(SCRIPT)
    calls: dict[tuple[str, str], int] = {}

    def note(frame: FrameType, event: str, _: object) -> None:
        code = frame.f_code
        if event == "call" and code.co_filename.startswith(f"{PACKAGE}/"):
            calls.setdefault((code.co_filename[len(f"{PACKAGE}/") :], code.co_qualname), len(calls))

    before = sys.getprofile()
    sys.setprofile(note)
    try:
        done = [drop("record", "box.py"), drop("analyze")]
    finally:
        sys.setprofile(before)
    assert [one.returncode for one in done] == [0, 0]
    ours = [stop for stop in STOPS if not stop[0].startswith(IN_THE_SCRIPT)]
    assert [(f, n) for f, names in ours for n in names if (f, n) not in calls] == []
    first = [calls[file, names[0]] for file, names in ours]
    assert first == sorted(first), "the walk is in another order than the calls"
