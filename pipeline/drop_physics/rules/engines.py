"""The engines that rules are written for: one engine, or any."""

from __future__ import annotations

from drop_physics.trace.history import DEFAULT_ENGINE as PYBULLET
from drop_physics.trace.history import Seen

MUJOCO = "MuJoCo"
BULLETS, MUJOCOS = (PYBULLET,), (MUJOCO,)
ANY = PYBULLET, MUJOCO


def engine_of(seen: Seen) -> str:
    """Return the name of the engine that made a recording, without its version."""
    return seen.engine.partition(" ")[0]
