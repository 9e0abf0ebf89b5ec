"""Choose the world that a scenario is dropped in: PyBullet's own, or that of another engine."""

from __future__ import annotations

from typing import Self

from drop_physics.engines.other_world import OtherWorld
from drop_physics.engines.pybullet.lasting_world import LastingWorld
from drop_physics.scenario import Scenario


class Worlds:
    """Provides a world for each scenario, the previous one if that serves; use it in `with`."""

    def __init__(self) -> None:
        self._kept: LastingWorld | None = None

    def world_of(self, scenario: Scenario) -> LastingWorld | OtherWorld:
        """Return a world at its release; the one returned before is no longer valid.

        Raises
        ------
        ScenarioError
            If the engine is not installed, or the body cannot be found, loaded or dropped by it.
        """
        if scenario.engine != "bullet":
            return OtherWorld(scenario)
        kept, self._kept = self._kept, None  # not kept if anything fails from here on
        if kept is not None and kept.serves(scenario):
            kept.restart(scenario)
        else:
            if kept is not None:
                kept.close()
            kept = LastingWorld(scenario)
        self._kept = kept
        return kept

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the world that is kept, if any."""
        kept, self._kept = self._kept, None
        if kept is not None:
            kept.close()
