"""Restores a recorded state in an MjData, including sleep states that earlier steps left.

A step recomputes all derived data except those of sleeping bodies: their poses are from the step in
which they fell asleep, and the lists of awake bodies are from the end of the previous step
(`mj_updateSleep` in MuJoCo's `engine_sleep.c`). This module recreates both.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np

from ..frames import ASLEEP, kind_of


def load(m: Any, d: Any, state: Mapping[str, Any]) -> None:
    """Write state arrays into an MjData, by name, except for the time."""
    asleep = state.get(ASLEEP, ())
    if not len(asleep):
        _write(d, state)
        return
    if (np.asarray(asleep) >= 0).any():
        _write(d, {name: values for name, values in state.items() if name != ASLEEP})
        d.tree_asleep[:] = -1
        _tell_awake(m, d)
        mujoco.mj_forward(m, d)  # all of it is awake, and computed
    _write(d, state)
    if ((d.tree_asleep < 0) != d.tree_awake).any():
        _tell_awake(m, d)


def _write(d: Any, state: Mapping[str, Any]) -> None:
    for name, values in state.items():
        getattr(d, name).reshape(-1).view(kind_of(name))[:] = values


def _tell_awake(m: Any, d: Any) -> None:
    """Rebuild the lists of awake trees from `tree_asleep`."""
    trees = d.tree_asleep < 0
    tree_of = m.body_treeid
    moves = tree_of >= 0
    awake = np.full(m.nbody, -1)  # static
    awake[m.body_mocapid[m.body_rootid] >= 0] = 1
    awake[moves] = trees[tree_of[moves]]
    bodies = np.flatnonzero(awake != 0)
    children = 1 + np.flatnonzero(awake[m.body_parentid[1:]] != 0)
    dofs = np.flatnonzero((awake == 1)[m.dof_bodyid] & moves[m.dof_bodyid])
    d.tree_awake[:], d.body_awake[:] = trees, awake
    for name, found in (("body", bodies), ("parent", children), ("dof", dofs)):
        getattr(d, f"{name}_awake_ind")[: len(found)] = found
    d.ntree_awake, d.nbody_awake = int(trees.sum()), len(bodies)
    d.nparent_awake, d.nv_awake = len(children), len(dofs)
