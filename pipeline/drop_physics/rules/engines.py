"""The engines that rules have words for: a rule is about one of them, or about any."""

from __future__ import annotations

from drop_physics.trace.history import DEFAULT_ENGINE as PYBULLET
from drop_physics.trace.history import Seen

MUJOCO = "MuJoCo"
BULLETS, MUJOCOS = (PYBULLET,), (MUJOCO,)
ANY = PYBULLET, MUJOCO


def engine_of(seen: Seen) -> str:
    """Return the name of the engine of a recording, without its version."""
    return seen.engine.partition(" ")[0]


NO_CONTACT, NO_GRAVITY, NO_ACTUATION, NO_AUTO_RESET = 1 << 4, 1 << 7, 1 << 11, 1 << 16
"""Bits of MuJoCo's `disableflags` (`mjtDisableBit`)."""


def is_off(seen: Seen, client: int, flag: int) -> bool:
    """Return whether a flag of the model switches something off at the end of a simulation."""
    held = [each.values.get("disableflags") for each in seen.settings if each.client == client]
    return bool(held) and isinstance(held[-1], float) and bool(int(held[-1]) & flag)
