"""A world reused for one scenario after another: building one costs more than a fall in it.

Reused only if no bit of the result depends on it, which `tests/test_sweep.py` checks.
"""

from __future__ import annotations

import math

from drop_physics.engines.finite import non_finite
from drop_physics.engines.pybullet.engine import p
from drop_physics.engines.pybullet.touching import FAR_M
from drop_physics.engines.pybullet.world import World
from drop_physics.scenario import Scenario

BUILT_IN = ("body", "coordinates", "floor", "gravity_set")
CHANGEABLE = (
    "linear_damping",
    "angular_damping",
    "mass_kg",
    "restitution",
    "restitution_threshold_m_s",
    "friction",
    "contact_erp",
    "solver_residual",
    "solver_iterations",
)


class LastingWorld(World):
    """A world that can return to the release, of its scenario or another."""

    def serves(self, scenario: Scenario) -> bool:
        """Return whether after `restart` this world gives the same bits as a new one.

        It must have the same bodies, without joints, because these keep their pose. A setting can
        be changed, but not returned to the engine's default. A btRigidBody that starts in contact
        remembers how it lay before: maximal coordinates never serve. Nor do substeps: the engine
        keeps the rounding error of the time that it has stepped.
        """
        mine = self.scenario
        return (
            mine.coordinates == "reduced"
            and mine.substeps is scenario.substeps is None
            and all(getattr(mine, name) == getattr(scenario, name) for name in BUILT_IN)
            and all(
                getattr(scenario, name) is not None or getattr(mine, name) is None
                for name in CHANGEABLE
            )
            and p.getNumJoints(self._body, physicsClientId=self._client) == 0
        )

    def restart(self, scenario: Scenario) -> None:
        """Return to the release of a scenario that this world `serves`."""
        self.scenario = scenario
        # Far from the floor the engine forgets the contacts of the fall before, and their impulses.
        self.place((0.0, 0.0, FAR_M), (0.0, 0.0, 0.0, 1.0))
        p.performCollisionDetection(physicsClientId=self._client)
        self._set_dynamics(self._body)
        self._configure()
        self._release()

    def skip(self, steps: int) -> None:
        """Take steps without reading samples."""
        if self.scenario.stepped:
            step, client = p.stepSimulation, self._client
            for _ in range(steps):
                step(client)

    def height_m(self) -> float:
        """Return the height of the centre at the end of the fall [m].

        Raises
        ------
        DropError
            If it is not finite.
        """
        position, _ = p.getBasePositionAndOrientation(self._body, self._client)
        if not all(map(math.isfinite, position)):
            raise non_finite(self.scenario.steps)
        return float(position[2])
