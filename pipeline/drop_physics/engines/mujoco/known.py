"""MuJoCo model features that other engines lack, with the edits that remove them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drop_physics.messages import Message
from drop_physics.trace.frames import ModelEdit
from drop_physics.trace.logs import KnownDifference

FIELDS = {
    "dof_armature": Message("dof_armature in MuJoCo"),
    "dof_damping": Message("joint damping (dof_damping) in MuJoCo"),
    "dof_frictionloss": Message("friction loss (dof_frictionloss) in MuJoCo"),
    "jnt_stiffness": Message("springs of joints (jnt_stiffness) in MuJoCo"),
    "jnt_limited": Message("joint limits (jnt_range) in MuJoCo"),
}


def known_differences(arrays: Mapping[str, NDArray[Any]]) -> Iterator[KnownDifference]:
    """Yield a model's features that other engines lack, each with an edit that sets it to zero."""
    for name, says in FIELDS.items():
        held = np.ravel(arrays.get(name, ()))
        if held.any():
            edit = ModelEdit(0, name, np.arange(len(held)), np.zeros(len(held)))
            yield KnownDifference(says, edits=[edit])
