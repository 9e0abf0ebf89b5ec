"""Parts of libraries that our processes skip at import, without missing anything."""

from __future__ import annotations

import subprocess
import sys

LAZILY = """
import ast, importlib, sys
from pathlib import Path
from drop_physics.loading import LAZY, load_less
load_less()
import numpy as np
import rerun as rr
from scipy.spatial import ConvexHull
assert ConvexHull(np.eye(3, 2)).area and rr.components.FillMode.Solid
rr.Scalars.columns(scalars=[1.0])
loaded = [name for name in sys.modules if name.startswith(("rerun", "scipy"))]
assert len(loaded) < 80, loaded
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.spatial import KDTree, distance
for package in map(importlib.import_module, LAZY):
    tree = ast.parse(Path(package.__file__).read_text())
    own = [each for each in tree.body if isinstance(each, ast.ImportFrom) and each.level]
    for name in {alias.asname or alias.name for each in own for alias in each.names} - {"*"}:
        getattr(package, name)
assert rr.__version__ and rr.Scalars is importlib.import_module("rerun.archetypes.scalars").Scalars
try:
    import pandas
except ModuleNotFoundError:
    print("whole")
"""


def test_a_lazy_package_loads_what_is_used_and_has_every_name() -> None:
    done = subprocess.run([sys.executable, "-c", LAZILY], capture_output=True, text=True)
    assert done.stdout == "whole\n", done.stderr


def test_where_there_is_no_room_for_a_library_that_aborts_it_is_not_loaded() -> None:
    """Polars aborts the process if an allocation fails."""
    code = """
import resource
from drop_physics import loading
loading.load_less()
resource.setrlimit(resource.RLIMIT_AS, (1 << 30, 1 << 30))
try:
    import polars
except MemoryError:
    print("one line")
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stdout == "one line\n", done.stderr
