"""The results of the analysis: plain typed values in SI units."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import polars as pl

from drop_physics.analysis.results import REPORT, Analysis, BodyFlight
from drop_physics.drop.phases import Phase
from drop_physics.engine_report import EngineReport


@dataclass(frozen=True)
class Terms:
    """The four terms of a position error [m]; they add up to the error."""

    timestep: float
    """Error of semi-implicit Euler without damping."""
    damping: float
    """Effect of the engine's damping in continuous time."""
    interaction: float
    """Interaction between timestep and damping."""
    rounding: float
    """Rounding in double precision."""


@dataclass(frozen=True)
class Moment:
    """One sample and its error, with the error's terms if the free-flight formula covers it."""

    time_s: float
    """Time of the sample."""
    step: int
    """Step of the sample."""
    phase: Phase
    """Whether the body is falling, in contact, or at rest."""
    simulated_m: float
    """Height of the centre in the recording."""
    free_fall_m: float
    """Theoretical height without air; no lower than the floor allows."""
    error_m: float
    """Simulated minus theoretical height."""
    terms_m: Terms | None
    """Terms of the error; None if the free-flight formula does not cover the sample."""


@dataclass(frozen=True)
class Airborne:
    """The error over all samples that the free-flight formula covers; None without any."""

    samples: int
    """Number of covered samples."""
    max_abs_error_m: float | None
    """Largest absolute error."""
    rms_error_m: float | None
    """Root mean square of the error."""
    max_abs_rounding_m: float | None
    """Largest absolute rounding term."""


@dataclass(frozen=True)
class Coverage:
    """Number of samples that the free-flight formula covers, and the reason why it ends."""

    samples: int
    """Number of covered samples, from the first on."""
    of: int
    """Number of all samples."""
    why: str
    """Reason why the coverage ends."""


@dataclass(frozen=True)
class Landing:
    """The time at which the body would reach the floor, in theory."""

    time_free_fall_s: float
    """Theoretical landing time without air."""
    time_damped_s: float | None
    """Theoretical landing time with Bullet's damping; None if the damping stops the body first."""


@dataclass(frozen=True)
class Impact:
    """The impact on the floor, in theory and in the simulation.

    Times are those at which the centre reaches the rest height; None if the body may have turned
    before that, and so may touch earlier.
    """

    time_free_fall_s: float | None
    """Theoretical impact time without air."""
    time_damped_s: float | None
    """Theoretical impact time with Bullet's damping."""
    time_simulated_s: float | None
    """Impact time in the recording, between two samples."""
    step: int
    """First sample with floor contact."""
    speed_m_s: float
    """Speed (magnitude) at the last sample before the impact."""
    lowest_m: float
    """Lowest height of the centre."""
    lowest_step: int
    """The sample at which the centre is lowest."""
    penetration_m: float | None
    """Penetration depth into the floor [m]. None if the body has turned, or an edge was deeper, so
    that the centre's height does not show the depth; or with `--substeps`, as the body may have
    been deeper within a step."""


@dataclass(frozen=True)
class Contact:
    """Comparison of the recorded contact with Bullet's contact law, for a body that lands flat."""

    max_deviation_m: float
    """Largest difference between recorded and predicted heights while the body is flat."""
    deviation_step: int
    """The sample with the largest difference."""


@dataclass(frozen=True)
class Bounce:
    """One rebound, as measured and, as long as the body lands flat, as predicted."""

    step: int
    """The last sample in free flight before the bounce."""
    approach_m_s: float
    """Downward speed at the contact: the speed that the step would lead to without a contact."""
    rebound_m_s: float
    """Upward speed after the last step in which contact pushed."""
    effective_restitution: float | None
    """Ratio of rebound speed to approach speed; None once the body tumbles."""
    apex_m: float
    """Highest point above the rest height before the next contact, or the recording's end."""
    predicted_apex_m: float | None
    """Theoretical apex of the n-th bounce: restitution to the power of 2n, times the height of the
    fall; None once the body tumbles, or if the recording ends on the way up."""
    uncorrected_apex_m: float | None
    """Apex by the contact law without position correction, i.e. with `--contact-erp 0`."""
    correction_m_s: float | None
    """Speed that the position correction adds to restitution × approach speed; None if the contact
    law does not reproduce the recorded rebound."""


@dataclass(frozen=True)
class RestTerms:
    """Terms of the height error of a box at rest [m]; the three add up to the error."""

    slop: float
    """Penetration of 10 µm that Bullet leaves uncorrected."""
    solver: float
    """Error from the solver's early stop: recorded height minus the contact law's."""
    settling: float
    """Distance that the path predicted by the contact law, which has not come to rest completely,
    still has to move [m]: predicted minus expected height."""


@dataclass(frozen=True)
class Rest:
    """The resting position of the body."""

    height_m: float
    """Height of the centre in the last sample."""
    expected_m: float | None
    """Height expected from the shape; None if it is unknown for a body in this orientation."""
    error_m: float | None
    """Height minus expected height."""
    settled_step: int | None
    """First sample at rest; None if the body keeps creeping or turning."""
    terms_m: RestTerms | None
    """Terms of the error; None if the contact law does not cover the landing."""
    sinks_m: float | None = None
    """Depth to which the body's weight presses it into MuJoCo's soft contact, in closed form; None
    if the body rests at another height, and in other engines."""


@dataclass(frozen=True)
class Conservation:
    """Drift of energy and angular momentum before the first contact."""

    energy_initial_j: float
    """Kinetic and potential energy of the first sample."""
    energy_max_rel_drift: float | None
    """Largest change of the energy, relative to the initial energy; None if the initial energy is
    0."""
    angular_momentum_max_rel_drift: float | None
    """Largest change of the angular momentum about the centre of mass, relative to its initial
    value; None if that is 0."""


@dataclass(frozen=True, kw_only=True)
class FallAnalysis:
    """Results of a drop that need its scenario: comparison with theory, landing and rest."""

    scenario: dict[str, Any]
    """The scenario's options, by field."""
    engine: EngineReport
    """The engine's report: see recording.md."""
    at: list[Moment]
    """The samples nearest to `--at`."""
    coverage: Coverage
    """The samples that the free-flight formula covers."""
    airborne: Airborne
    """The error over all covered samples."""
    landing: Landing | None
    """Theoretical landing; None if the body does not reach the floor, or the landing is unknown."""
    impact: Impact | None
    """Impact on the floor; None if there is none, or it is unknown: with several substeps PyBullet
    reports only the contacts of the last one, and there is no formula for joints."""
    tumbled_step: int | None
    """First sample that touches the floor tilted by more than 0.29° (a box relative to its faces,
    other bodies relative to the release). From this sample on, bounces, contact and rest are
    measured, not predicted."""
    tumbles: bool
    """Whether the tilt changes by more than 0.29° again after the tilted touch."""
    contact: Contact | None
    """Comparison of the contact with Bullet's contact law; None if the law does not cover the drop.
    """
    bounces: list[Bounce]
    """The rebounds of a rigid body, in order; none with `--substeps`, since PyBullet reports only
    the contacts of the last substep."""
    rest: Rest | None
    """Rest position of the body; None if the body does not come to rest."""
    conservation: Conservation
    """Conservation before the first contact."""
    contact_j: float | None
    """Energy that contact gave to the body [J]; None if no formula applies. Not part of the JSON.
    """
    table: pl.DataFrame
    """One row per sample: step, time, phase, heights, error and terms, energies; for a long
    recording only the rows that are shown, unless all were requested."""


@dataclass(frozen=True, kw_only=True)
class DropAnalysis(FallAnalysis, Analysis, reported_by=REPORT):
    """All results of the analysis of a drop recording."""

    segments: dict[str, int]
    """Number of samples of each kind, as in `bodies`."""
    flights: list[BodyFlight]
    """Flights, each as a drop of its own: the fall, and one after each bounce; as in `bodies`."""
