"""The results of the analysis: plain typed values, SI units, nothing computed here."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import polars as pl

from drop_physics.analysis.results import REPORT, Analysis, BodyFlight
from drop_physics.drop.phases import Phase
from drop_physics.engine_report import EngineReport


@dataclass(frozen=True)
class Terms:
    """The four terms of an error [m]; they add up to it."""

    timestep: float
    """Error of semi-implicit Euler without damping."""
    damping: float
    """Effect of damping in continuous time."""
    interaction: float
    """Interaction of the two."""
    rounding: float
    """Rounding of double precision."""


@dataclass(frozen=True)
class Moment:
    """One sample and its error; without terms where the law of free flight does not cover it."""

    time_s: float
    """Time of the sample."""
    step: int
    """Number of the step."""
    phase: Phase
    """Whether the body is falling, in contact, or at rest."""
    simulated_m: float
    """Height of the centre in the recording."""
    free_fall_m: float
    """Height by theory, without air; no lower than the floor allows."""
    error_m: float
    """Simulated minus free fall."""
    terms_m: Terms | None
    """Terms of the error; None where the law of free flight does not cover it."""


@dataclass(frozen=True)
class Airborne:
    """The error over all samples that the law of free flight covers; None where it covers none."""

    samples: int
    """Number of these samples."""
    max_abs_error_m: float | None
    """Largest absolute error."""
    rms_error_m: float | None
    """Root mean square of the error."""
    max_abs_rounding_m: float | None
    """Largest absolute rounding term."""


@dataclass(frozen=True)
class Coverage:
    """The number of samples covered by the law of free flight, and the reason for no more."""

    samples: int
    """Number of samples that it covers, from the first on."""
    of: int
    """Number of all samples."""
    why: str
    """Reason for the end of the coverage."""


@dataclass(frozen=True)
class Landing:
    """Time at which the body, oriented as released, reaches the floor by theory."""

    time_free_fall_s: float
    """Time of landing without air."""
    time_damped_s: float | None
    """Time of landing with Bullet's damping; None if that stops the body on the way."""


@dataclass(frozen=True)
class Impact:
    """Impact on the floor, in theory and in the simulation.

    The times are those at which the centre reaches the rest height; None where the body may have
    turned by then, so that it touches earlier.
    """

    time_free_fall_s: float | None
    """Time of touching by theory without air."""
    time_damped_s: float | None
    """Time of touching by theory with Bullet's damping."""
    time_simulated_s: float | None
    """Time of touching in the recording, between two samples."""
    step: int
    """First sample that touches the floor."""
    speed_m_s: float
    """Speed of the last sample before it, in any direction."""
    lowest_m: float
    """Lowest height of the centre."""
    lowest_step: int
    """The sample at which it is lowest."""
    penetration_m: float | None
    """Depth in the floor; None where the body has turned, or an edge was deeper, so that its centre
    does not show it, and with `--substeps`, within which it may have been deeper."""


@dataclass(frozen=True)
class Contact:
    """Comparison of the recorded contact with Bullet's law, for a body that lands flat."""

    max_deviation_m: float
    """Largest distance between the recorded heights and the law's, while the body is flat."""
    deviation_step: int
    """The sample with that distance."""


@dataclass(frozen=True)
class Bounce:
    """One rebound: measured, and explained while the body touches flat."""

    step: int
    """The last sample in free flight before it."""
    approach_m_s: float
    """Downward speed that the contact met: the speed after that step if there were no contact."""
    rebound_m_s: float
    """Upward speed after the last step in which contact pushed."""
    effective_restitution: float | None
    """Rebound over approach; None once the body tumbles."""
    apex_m: float
    """Highest point above the rest height before the next contact, or the recording's end."""
    predicted_apex_m: float | None
    """The same by theory: restitution to the power of twice the bounce's number, times the fall;
    None once the body tumbles, or where the recording ends on the way up."""
    uncorrected_apex_m: float | None
    """The same by the contact law without position correction, i.e. with `--contact-erp 0`."""
    correction_m_s: float | None
    """Speed that the position correction adds to restitution × approach; None where the contact
    law does not reproduce the recorded rebound."""


@dataclass(frozen=True)
class RestTerms:
    """Terms of the error of a box at rest [m]; the three add up to it."""

    slop: float
    """Bullet leaves a penetration of 10 µm uncorrected."""
    solver: float
    """The solver stopped early: recorded minus the contact law."""
    settling: float
    """The law itself has not settled completely."""


@dataclass(frozen=True)
class Rest:
    """The position of the body at rest."""

    height_m: float
    """Height of the centre in the last sample."""
    expected_m: float | None
    """Height by the shape; None where it is unknown for a body oriented like this."""
    error_m: float | None
    """Height minus expected height."""
    settled_step: int | None
    """First sample at rest; None where the body keeps creeping or turning."""
    terms_m: RestTerms | None
    """None where the contact law does not cover the landing."""
    sinks_m: float | None = None
    """Depth of the body in MuJoCo's soft contact by its weight, in closed form; None where it lies
    elsewhere, and in other engines."""


@dataclass(frozen=True)
class Conservation:
    """Drift of energy and angular momentum before the first contact."""

    energy_initial_j: float
    """Kinetic and potential energy of the first sample."""
    energy_max_rel_drift: float | None
    """Largest change of the energy, over its initial value; None where that is 0."""
    angular_momentum_max_rel_drift: float | None
    """The same for the angular momentum about the centre of mass."""


@dataclass(frozen=True, kw_only=True)
class FallAnalysis:
    """The additions of a scenario to a recording: the fall against its theory, landing and rest."""

    scenario: dict[str, Any]
    """The scenario: the options, by field."""
    engine: EngineReport
    """Report of the engine: see recording.md."""
    at: list[Moment]
    """The samples nearest to `--at`."""
    coverage: Coverage
    """The samples that the law of free flight covers."""
    airborne: Airborne
    """The error over all of these."""
    landing: Landing | None
    """Landing by theory; None where the body does not reach the floor, or that is unknown."""
    impact: Impact | None
    """Impact on the floor; None where there is none, or that is unknown: of several substeps
    PyBullet reports only the contacts of the last, and there is no law for joints."""
    tumbled_step: int | None
    """First sample that touches the floor tilted by more than 0.29° (a box from its faces, others
    from their release): from there on bounces, contact and rest are measured, not predicted."""
    tumbles: bool
    """Whether its tilt changes by as much again from there on."""
    contact: Contact | None
    """The contact compared with Bullet's law; None where that does not cover it."""
    bounces: list[Bounce]
    """The rebounds of a rigid body, in order; none with `--substeps`, of which PyBullet reports
    only the contacts of the last."""
    rest: Rest | None
    """Rest of the body; None where it does not come to rest."""
    conservation: Conservation
    """Conservation until the first contact."""
    contact_j: float | None
    """Energy that contact gave to the body; None without a law. Not in the JSON."""
    table: pl.DataFrame
    """One row per sample: step, time, phase, heights, error and terms, energies; of long recordings
    only what is shown, unless it was asked for."""


@dataclass(frozen=True, kw_only=True)
class DropAnalysis(FallAnalysis, Analysis, reported_by=REPORT):
    """All results of the analysis of a drop's recording."""

    segments: dict[str, int]
    """Number of samples by kind, as in `bodies`."""
    flights: list[BodyFlight]
    """Flights as drops of their own: the fall, and one after each bounce; as in `bodies`."""
