"""The input of the analysis of a drop: scenario, engine report, and samples."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from drop_physics.arrays import Float64
from drop_physics.drop.samples import DropSamples, samples_seen
from drop_physics.engine_report import EngineReport
from drop_physics.physics import theory
from drop_physics.physics.base import EXACT_MACHINES, ORIENTED, Law, Motion
from drop_physics.physics.laws.lookup import fall_of, law_for
from drop_physics.physics.rotations import same_way
from drop_physics.physics.theory import TheoreticalFall
from drop_physics.scenario import ENGINES, EXACT_INTEGRATORS, Scenario
from drop_physics.trace.history import PIECE, Seen
from drop_physics.trace.states import BODY

TOUCHING_M = 5e-10
"""Distance from the floor below which a body counts as touching it [m]: the accuracy of the
engine's distances. For 136 bodies drawn as in `tests/test_truth.py`, a bisection with the engine's
own collision detection found the rest height to 5e-15 m, for a mesh to 1e-10 m."""
FLOOR_REACH_M = 100.0
"""Distance of the floor's edge from the origin in x and in y [m], in plane.urdf."""


@dataclass(frozen=True)
class DropCase:
    """One drop: scenario, engine report, and recorded samples."""

    scenario: Scenario
    engine: EngineReport
    seen: Seen
    """The recording, whose samples are read chunk by chunk."""

    @cached_property
    def samples(self) -> int:
        """Number of samples of the body; in a recording that was cut off, joints may have more."""
        sampled, end = self.seen.sampled, self.seen.sampled.last + 1
        while end > 0:
            bases = sampled.piece(max(end - PIECE, 0), end).bases
            steps = bases["step"][bases["body"] == BODY]
            if len(steps):
                return int(steps[-1]) + 1
            end -= PIECE
        return 0

    def sample(self, step: int) -> DropSamples:
        """Return one sample."""
        return samples_seen(self.seen, self.seen.sampled.piece(step, step + 1))

    def parts(self) -> Iterator[DropSamples]:
        """Yield all samples in order, chunk by chunk."""
        for piece in self.seen.pieces():
            yield samples_seen(self.seen, piece)

    @cached_property
    def start(self) -> DropSamples:
        """The first sample."""
        return self.sample(0)

    @cached_property
    def end(self) -> DropSamples:
        """The last sample."""
        return self.sample(self.samples - 1)

    @cached_property
    def fall(self) -> TheoreticalFall:
        """The theoretical fall from the release, with the drag that the engine has."""
        return fall_of(self.scenario)

    @cached_property
    def law(self) -> Law:
        """The integration rule for one rigid body in free flight."""
        return law_for(self.scenario, self.engine)

    @property
    def exact(self) -> bool:
        """True if the machine rounds each operation once."""
        return self.engine.machine in EXACT_MACHINES

    @property
    def released(self) -> bool:
        """True if the first sample equals the requested release state, rounded as by the engine."""
        scenario, mine = self.scenario, self.start
        asked = (
            self.fall.position_m,
            scenario.orientation_xyzw,
            scenario.velocity_m_s,
            scenario.spin_rad_s,
        )
        start = self.law.released(Motion(*(np.array([each]) for each in asked)))
        turned = same_way(mine.orientation, start.orientation) - start.orientation
        return bool(np.abs(turned).max() <= ORIENTED) and all(
            np.array_equal(getattr(mine, name), getattr(start, name))
            for name in ("position_m", "velocity_m_s", "spin_rad_s")
        )

    @property
    def timestep_s(self) -> float:
        """Time between two samples [s]."""
        return self.scenario.timestep_s

    @property
    def substeps(self) -> int:
        """Number of engine steps per timestep."""
        return self.scenario.substeps or 1

    @property
    def hides_contacts(self) -> bool:
        """True if contact may act within a timestep without being reported.

        Engines report only the contacts of the last substep, or of the last stage of a step.
        """
        return self.substeps > 1 or self.scenario.effective_integrator in EXACT_INTEGRATORS

    @property
    def substep_s(self) -> float:
        """Timestep of the integrator [s]: with `--substeps`, several make a sample."""
        return self.scenario.timestep_s / self.substeps

    @property
    def end_s(self) -> float:
        """Time of the last sample [s]."""
        return (self.samples - 1) * self.timestep_s

    @property
    def floor_height_m(self) -> float | None:
        """Height of the centre at which the body as released touches the floor [m]; None if never.

        In tables, curves and plots, the theory ends at this height.
        """
        return self.engine.rest_height_m if self.scenario.floor else None

    def free_fall_m(self, time_s: Float64) -> Float64:
        """Return theoretical heights without air [m], no lower than the floor allows."""
        heights_m = theory.free_fall_height(self.fall, time_s)
        return theory.stopped_by_floor(heights_m, self.floor_height_m)

    def damped_fall_m(self, time_s: Float64) -> Float64:
        """Return theoretical heights with the engine's damping, in continuous time [m]."""
        heights_m = theory.damped_fall_height(self.fall, time_s)
        return theory.stopped_by_floor(heights_m, self.floor_height_m)

    @property
    def starts_above(self) -> bool:
        """True if the body is released clear of the floor."""
        floor_m = self.floor_height_m
        return floor_m is None or self.fall.height_m > floor_m + TOUCHING_M

    @property
    def engine_name(self) -> str:
        """The name under which the engine's formulas are selected."""
        return "Bullet" if self.is_bullet else ENGINES[self.scenario.engine]

    @property
    def is_bullet(self) -> bool:
        """True if PyBullet dropped the body: calls and contact law are implemented only for it."""
        return self.scenario.engine == "bullet"

    @property
    def is_rigid(self) -> bool:
        """True if the body is one rigid link, which the formulas here assume."""
        return self.engine.joints == 0

    @property
    def is_springy(self) -> bool:
        """True if contact is a spring, which the contact law does not cover."""
        return self.engine.contact_stiffness_n_m is not None

    @property
    def is_soft(self) -> bool:
        """True if contact is compliant, however short the timestep."""
        return self.is_springy or self.engine.solref is not None

    @property
    def is_ball(self) -> bool:
        """True if the body is a sphere with a central centre of mass, unaffected by rotation."""
        centred = self.engine.shape_position_m == (0.0, 0.0, 0.0)
        return self.is_rigid and self.engine.shape == "sphere" and centred

    @property
    def is_box(self) -> bool:
        """True if the body is one rigid box."""
        return self.is_rigid and self.engine.shape == "box"

    def over_floor(self, position_m: Float64) -> bool:
        """Return whether all positions [m], shape (n, 3), are above the floor's area.

        In other engines the floor has no edge.
        """
        return not self.is_bullet or bool((np.abs(position_m[:, :2]) < FLOOR_REACH_M).all())
