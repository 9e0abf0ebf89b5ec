"""The engines that there are words for: a rule speaks of one, or of any."""

from __future__ import annotations

from drop_physics.trace.history import PYBULLET, Seen

MUJOCO = "MuJoCo"
BULLETS, MUJOCOS = (PYBULLET,), (MUJOCO,)
ANY = PYBULLET, MUJOCO


def engine_of(seen: Seen) -> str:
    """Return the name of the engine of a recording, without its version."""
    return seen.engine.partition(" ")[0]
