"""The engines with words in the rules: a rule is about one of them, or about any."""

from __future__ import annotations

from drop_physics.trace.history import DEFAULT_ENGINE as PYBULLET
from drop_physics.trace.history import Seen

MUJOCO = "MuJoCo"
BULLETS, MUJOCOS = (PYBULLET,), (MUJOCO,)
ANY = PYBULLET, MUJOCO


def engine_of(seen: Seen) -> str:
    """Return the name of the engine of a recording, without its version."""
    return seen.engine.partition(" ")[0]
