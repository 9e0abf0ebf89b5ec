"""Find the engine's room that words a cure as a call, and makes a run with it."""

from __future__ import annotations

from collections.abc import Callable

from drop_physics.engines.mujoco import interventions as mujoco
from drop_physics.engines.pybullet import interventions as pybullet
from drop_physics.trace.cures import Cure, EngineCures
from drop_physics.trace.history import DEFAULT_ENGINE as PYBULLET

ROOMS: dict[str, EngineCures] = {PYBULLET: pybullet, "MuJoCo": mujoco}
"""The cures of each engine, by the engine's name."""


def cures_of(engine: str) -> EngineCures:
    """Return the cures of the engine of a recording."""
    return ROOMS[engine.partition(" ")[0]]


def call_of(engine: str) -> Callable[[Cure], str]:
    """Return the function that words a cure as a user of an engine would."""
    cures = ROOMS.get(engine.partition(" ")[0])
    return (lambda cure: cure.call) if cures is None else cures.call_of  # of a drop elsewhere
