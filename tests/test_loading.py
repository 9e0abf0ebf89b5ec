"""What a process of ours leaves out of libraries, and that nothing is missing for it."""

from __future__ import annotations

import dataclasses
import subprocess
import sys
from collections.abc import Mapping
from typing import Any

import pytest
from drop_physics.data import dataclass

LAZILY = """
import importlib, sys
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
    for name in {*package._homes} - {"*"}:
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


def made_by(maker: Any) -> tuple[type[Any], type[Any], type[Any]]:
    @maker(frozen=True)
    class Pair:
        a: int
        b: str = dataclasses.field(default="x", compare=False)
        more: Mapping[str, int] = dataclasses.field(default_factory=dict, hash=False)

    @maker(frozen=True, kw_only=True)
    class More(Pair):
        c: tuple[int, ...] = ()

    @maker
    class Loose:
        a: int

    return Pair, More, Loose


def test_a_data_class_is_that_of_the_standard_library() -> None:
    pair, more, loose = made_by(dataclass)
    theirs, their_more, _ = made_by(dataclasses.dataclass)
    assert repr(pair(1)) == repr(theirs(1))
    assert pair(1) == pair(1, "y") != pair(2)
    assert {pair(1): 3}[pair(1, "y")] == 3
    assert pair(1, more={"z": 1}) != pair(1)
    assert pair(1) != more(a=1, c=()) != theirs(1)
    assert more(a=1, c=(2,)) != more(a=1)
    assert dataclasses.asdict(more(a=1, c=(2,))) == dataclasses.asdict(their_more(a=1, c=(2,)))
    assert repr(dataclasses.replace(more(a=1), b="z")) == repr(their_more(a=1, b="z"))
    with pytest.raises(TypeError, match="unhashable"):
        hash(loose(1))
