"""What a recording gives away: the mistakes and surprises that people ask about.

Each finding says what was seen, with the number, why it is so, and the one call or option that
changes it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.budget.convergence import cancelling_timestep
from pipeline.budget.landing import pair_restitution
from pipeline.budget.phases import Phases
from pipeline.budget.results import Bounce, Finding, Impact, Moment, Rest
from pipeline.budget.samples import Samples
from pipeline.physics.bullet_law import MAX_COORDINATE_VELOCITY_M_S
from pipeline.physics.contact_law import RESTITUTION_THRESHOLD_M_S
from pipeline.physics.theory import Fall
from pipeline.scenario import Scenario

Float64 = NDArray[np.float64]

DEEP_PENETRATION = 0.1
"""Share of the body's height that it may sink into the floor before it is worth a word."""
REST_BELOW_M = 1e-6
"""A body that lies lower than this below its rest height is worth a word."""
INFLATED = 0.01
"""Relative excess of a rebound over the restitution asked for that is worth a word."""


@dataclass(frozen=True)
class Evidence:
    """What the findings are drawn from: the samples, and what the analysis made of them."""

    scenario: Scenario
    engine: Mapping[str, Any]
    fall: Fall
    time_s: Float64
    samples: Samples
    phases: Phases
    mismatch: tuple[int, float] | None
    """First sample in the air that does not follow the law, and by how much [m or m/s]."""
    moment: Moment | None
    """The sample that the analysis takes apart first."""
    impact: Impact | None
    bounces: list[Bounce]
    rest: Rest | None

    @property
    def height_m(self) -> Float64:
        """Height of the centre [m], shape (samples,)."""
        return self.samples.height_m

    @property
    def stands_still(self) -> bool:
        """Whether no sample differs from the release although something should move it."""
        state, velocity, spin = self.samples, self.samples.velocity_m_s, self.samples.spin_rad_s
        moved = self.fall.gravity_m_s2 != 0 or bool(velocity[0].any() or spin[0].any())
        still = all(
            bool((part == part[0]).all())
            for part in (state.position_m, state.orientation, velocity, spin)
        )
        return moved and still and len(velocity) > 1 and self.phases.contact_step is None


def findings(evidence: Evidence) -> list[Finding]:
    """Return what a recording gives away, the gravest first."""
    return [
        *_never_moved(evidence),
        *_no_floor(evidence),
        *_law_mismatch(evidence),
        *_damping(evidence),
        *_velocity_clamped(evidence),
        *_refining_hurts(evidence),
        *_deep_penetration(evidence),
        *_bounces(evidence),
        *_rest_below_expected(evidence),
        *_still_airborne(evidence),
    ]


def _never_moved(e: Evidence) -> Iterator[Finding]:
    if e.engine["gravity_m_s2"][2] == 0:
        yield Finding(
            "no-gravity",
            f"the engine's gravity is 0 m/s² and the centre is at {e.height_m[-1]:.4f} m at the "
            "end: PyBullet starts without gravity; call p.setGravity(0, 0, -9.81)"
            + ("" if e.scenario.gravity_set else ", that is leave out --no-gravity"),
        )
    if e.stands_still:
        yield Finding(
            "not-stepped",
            f"all {len(e.time_s)} samples are the same to the last bit, at {e.height_m[0]:.4f} m: "
            "time passes only in p.stepSimulation(); call it once per sample, that is leave out "
            "--no-step",
        )


def _no_floor(e: Evidence) -> Iterator[Finding]:
    lowest_m = float(e.height_m.min())
    if not e.scenario.floor and lowest_m < e.engine["rest_height_m"]:
        yield Finding(
            "no-floor",
            f"the centre went down to {lowest_m:.4f} m without a contact: there is nothing to land "
            'on; call p.loadURDF("plane.urdf"), that is leave out --no-floor',
        )


def _law_mismatch(e: Evidence) -> Iterator[Finding]:
    if e.mismatch is not None:
        step, deviation = e.mismatch
        yield Finding(
            "law-mismatch",
            f"sample {step} is {deviation:.2g} (m or m/s) away from what pybullet "
            f"{e.engine['pybullet_version']} makes of the samples before it: the state "
            "was altered, or another engine made it; record it again with drop simulate",
        )


def _damping(e: Evidence) -> Iterator[Finding]:
    if e.scenario.linear_damping is not None or e.stands_still:
        return
    if e.scenario.coordinates == "maximal":
        yield Finding(
            "no-damping-in-maximal-coordinates",
            "linear damping is 0: a btRigidBody (useMaximalCoordinates=True) has none by default, "
            "where a btMultiBody has 0.04; to have the same, set --linear-damping",
        )
    elif e.moment is not None and e.moment.terms_m is not None and e.moment.terms_m.damping:
        yield Finding(
            "default-damping",
            f"damping moves the body by {e.moment.terms_m.damping * 1e3:+.2f} mm at "
            f"{e.moment.time_s:.4g} s: PyBullet damps every body with 0.04 unless told otherwise; "
            "call p.changeDynamics(body, -1, linearDamping=0), that is --linear-damping 0",
        )


def _velocity_clamped(e: Evidence) -> Iterator[Finding]:
    fastest = np.abs(np.hstack((e.samples.velocity_m_s, e.samples.spin_rad_s))).max(axis=1)
    clamped = np.flatnonzero(fastest >= MAX_COORDINATE_VELOCITY_M_S)
    if e.scenario.coordinates == "reduced" and len(clamped) and not e.stands_still:
        step = int(clamped[0])
        yield Finding(
            "velocity-clamped",
            f"a velocity reaches {fastest[step]:.6g} (m/s or rad/s) at {e.time_s[step]:.4g} s: a "
            "btMultiBody holds every coordinate within ±100; use --coordinates maximal",
        )


def _refining_hurts(e: Evidence) -> Iterator[Finding]:
    if e.moment is None or e.moment.terms_m is None:
        return
    terms = e.moment.terms_m
    cancel_s = cancelling_timestep(
        e.scenario.timestep_s, timestep_m=terms.timestep, damping_m=terms.damping
    )
    if cancel_s is not None and abs(e.moment.error_m) < abs(terms.damping):
        yield Finding(
            "refining-hurts",
            f"at {e.moment.time_s:.4g} s the error is {e.moment.error_m * 1e3:+.2f} mm and goes to "
            f"{terms.damping * 1e3:+.2f} mm as the timestep shrinks: the timestep's share and the "
            f"damping's cancel at 1/{1 / cancel_s:.0f} s; take the error apart before refining, or "
            "switch the damping off with --linear-damping 0",
        )


def _deep_penetration(e: Evidence) -> Iterator[Finding]:
    released_inside = e.phases.airborne < 2
    if e.impact is None or e.impact.penetration_m is None or released_inside:
        return
    depth_m, height_m = e.impact.penetration_m, 2 * e.engine["rest_height_m"]
    if depth_m > DEEP_PENETRATION * height_m:
        per_step_m = e.impact.speed_m_s * e.scenario.timestep_s
        yield Finding(
            "deep-penetration",
            f"the body sinks {depth_m * 1e3:.1f} mm into the floor, {depth_m / height_m:.0%} of "
            "its height: contact acts only once it is inside, and it moves "
            f"{per_step_m * 1e3:.1f} mm in a step; shorten the step with p.setTimeStep, that is "
            "--timestep",
        )


def _bounces(e: Evidence) -> Iterator[Finding]:
    asked = pair_restitution(e.engine)
    if asked == 0 or e.impact is None:
        return
    for number, bounce in enumerate(e.bounces, start=1):
        excess = bounce.effective_restitution - asked
        if excess > INFLATED * asked:
            yield Finding(
                "restitution-inflated",
                f"bounce {number} has a restitution of {bounce.effective_restitution:.4f} where "
                f"{asked:g} (body × floor) was asked for: the position correction adds "
                f"{bounce.correction_m_s:.3f} m/s to the rebound; call "
                "p.setPhysicsEngineParameter(contactERP=0), that is --contact-erp 0",
            )
            break
    last_m_s = e.bounces[-1].rebound_m_s if e.bounces else e.impact.speed_m_s
    if e.rest is not None or last_m_s < RESTITUTION_THRESHOLD_M_S:
        yield Finding(
            "bounce-swallowed",
            f"after {len(e.bounces)} bounces the body arrives at {last_m_s:.3f} m/s and stays: "
            f"restitution acts only from {RESTITUTION_THRESHOLD_M_S:g} m/s on; call "
            "p.setPhysicsEngineParameter(restitutionVelocityThreshold=…) to lower it",
        )


def _rest_below_expected(e: Evidence) -> Iterator[Finding]:
    if e.rest is not None and e.rest.error_m is not None and e.rest.error_m < -REST_BELOW_M:
        yield Finding(
            "rest-below-expected",
            f"the body lies {-e.rest.error_m * 1e6:.2f} µm lower than {e.rest.expected_m:g} m: "
            "Bullet leaves a slop of 10 µm uncorrected and its solver stops early; "
            "--solver-residual 0 takes the solver's part away, the slop stays",
        )


def _still_airborne(e: Evidence) -> Iterator[Finding]:
    falling = e.fall.gravity_m_s2 < 0 and e.scenario.floor and not e.stands_still
    if falling and e.phases.contact_step is None:
        yield Finding(
            "still-airborne",
            f"after {e.time_s[-1]:.4g} s the centre is still at {e.height_m[-1]:.4f} m: the "
            "recording ends before the impact; let it go on with --duration",
        )
