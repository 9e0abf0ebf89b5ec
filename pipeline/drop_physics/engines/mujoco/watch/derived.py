"""Computes the fields of a compiled model that MuJoCo derives from others (`mj_setConst`).

A script that edits a mass in place, and does not call `mj_setConst`, leaves them as they were.
"""

from __future__ import annotations

from typing import Any

import numpy as np

DERIVED_FROM = (
    *("body_mass", "body_inertia", "body_ipos", "body_gravcomp"),
    *("dof_armature", "actuator_gear", "jnt_pos", "site_pos"),
)
"""Fields that trials change, and from which MuJoCo computes derived fields."""
SOURCES = (
    *DERIVED_FROM,
    *("body_pos", "body_quat", "body_iquat", "jnt_axis", "qpos0"),
    *("geom_pos", "geom_quat", "geom_size"),
)
"""Fields from which MuJoCo computes derived fields."""
DERIVED = (
    *("body_subtreemass", "body_invweight0", "dof_M0", "dof_invweight0", "dof_length"),
    *("tendon_length0", "tendon_invweight0", "actuator_acc0", "actuator_length0"),
    *("body_sameframe", "geom_sameframe", "geom_rbound", "geom_aabb", "bvh_aabb"),
)
"""Fields that `mj_setConst` writes, of which older versions leave out some."""
MOST_KEPT = 4
"""Number of models whose derived fields are kept."""


class DerivedFields:
    """The derived fields of a model, computed once for equal sources.

    Parameters
    ----------
    module
        The module `mujoco` of the script.
    set_const
        MuJoCo's own function `mj_setConst`.
    """

    def __init__(self, module: Any, set_const: Any) -> None:
        self._module, self._set_const = module, set_const
        self._kept: dict[bytes, dict[str, Any]] = {}

    def of(self, m: Any) -> dict[str, Any]:
        """Return the fields that follow from a model's current sources; the model is unchanged."""
        key = b"".join(getattr(m, name).tobytes() for name in SOURCES)
        if key not in self._kept:
            if len(self._kept) == MOST_KEPT:
                self._kept.clear()
            before = {name: getattr(m, name).copy() for name in DERIVED if hasattr(m, name)}
            self._set_const(m, self._module.MjData(m))
            self._kept[key] = {name: getattr(m, name).copy() for name in before}
            for name, held in before.items():
                getattr(m, name)[...] = held
        return self._kept[key]

    def are_stale(self, m: Any) -> bool:
        """Return whether a model was edited without `mj_setConst`, so its derived fields differ."""
        return not all(np.array_equal(getattr(m, name), new) for name, new in self.of(m).items())
