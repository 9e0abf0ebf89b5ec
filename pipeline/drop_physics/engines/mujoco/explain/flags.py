"""Bit values of MuJoCo's disable and enable flags, which differ by version."""

from __future__ import annotations

from typing import Any

import mujoco


def _bits(kind: Any, *names: str) -> int:
    """Return the bit of each disable or enable flag that this version has, by name."""
    return sum(int(getattr(kind, name)) for name in names if hasattr(kind, name))


_OFF, _ON = mujoco.mjtDisableBit, mujoco.mjtEnableBit
NO_SPRING = _bits(_OFF, "mjDSBL_SPRING", "mjDSBL_PASSIVE")
NO_DAMPER = _bits(_OFF, "mjDSBL_DAMPER", "mjDSBL_PASSIVE")
NO_EULERDAMP = NO_DAMPER | _bits(_OFF, "mjDSBL_EULERDAMP")
"""Flag with which Euler treats damping like other forces."""
NO_GRAVITY = _bits(_OFF, "mjDSBL_GRAVITY")
NO_ACTUATION = _bits(_OFF, "mjDSBL_ACTUATION")
NO_RESET = _bits(_OFF, "mjDSBL_AUTORESET")
SLEEP, IPC = _bits(_ON, "mjENBL_SLEEP"), _bits(_ON, "mjENBL_IPC")
