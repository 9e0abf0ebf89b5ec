"""The world in which a scenario is dropped, and its body's file, with or without PyBullet."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drop_physics.engines.other_world import OtherWorld
from drop_physics.engines.urdf import find_urdf
from drop_physics.errors import ScenarioError
from drop_physics.installed import PYBULLET, is_installed, needs_pybullet
from drop_physics.scenario import Scenario

if TYPE_CHECKING:
    from drop_physics.engines.pybullet.world import World

Verdicts = Mapping[Path, Any]
"""Results of PyBullet's load tests of bodies, by file path."""


def world_of(scenario: Scenario) -> World | OtherWorld:
    """Return the world of a scenario at the moment of release; use it in `with`.

    Raises
    ------
    ScenarioError
        If the engine is not installed, or the body cannot be found, loaded or dropped by it.
    """
    if scenario.engine != "bullet":
        return OtherWorld(scenario)
    if not is_installed(PYBULLET):
        raise needs_pybullet("--engine bullet")
    from drop_physics.engines.pybullet import world

    return world.World(scenario)


def find_body(body: str) -> Path:
    """Return the URDF file for a body's name.

    Raises
    ------
    ScenarioError
        If there is no such file, or PyBullet cannot load it.
    """
    if not is_installed(PYBULLET):
        return find_urdf(body)
    from drop_physics.engines.pybullet import found

    return found.find_body(body)


def body_digest(body: str) -> str | None:
    """Return the SHA-256 of a body's files, to detect edits; None if it cannot be loaded."""
    if is_installed(PYBULLET):
        from drop_physics.engines.pybullet import found

        return found.body_digest(body)
    try:
        return hashlib.sha256(find_urdf(body).read_bytes()).hexdigest()
    except ScenarioError:
        return None


def engine_versions() -> dict[str, str]:
    """Return PyBullet's versions (it loads every drop's body); empty if not installed."""
    if not is_installed(PYBULLET):
        return {}
    from drop_physics.engines.pybullet import engine

    return engine.engine_versions()


def verdicts() -> Verdicts:
    """Return the results of PyBullet's load tests of bodies, made in separate processes."""
    if not is_installed(PYBULLET):
        return {}
    from drop_physics.engines.pybullet import probe

    return probe.verdicts()


def believe(tried: Verdicts) -> None:
    """Adopt another process's load-test results, so that no body is tested twice."""
    if tried:
        from drop_physics.engines.pybullet import probe

        probe.believe(tried)
