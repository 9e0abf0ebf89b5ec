"""What the judge returns: plain typed values, SI units, nothing computed here."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import polars as pl

from pipeline.analysis.drop.energy import EnergyLedger
from pipeline.analysis.drop.phases import Phase
from pipeline.analysis.general.flights import Flight
from pipeline.analysis.general.jsonable import jsonable
from pipeline.report import EngineReport
from pipeline.shown import Shown


@dataclass(frozen=True)
class Terms:
    """The four terms of an error [m]; they add up to it."""

    timestep: float
    """What semi-implicit Euler does, without damping."""
    damping: float
    """What damping does, in continuous time."""
    interaction: float
    """What the two do to each other."""
    rounding: float
    """What double precision leaves."""


@dataclass(frozen=True)
class Moment:
    """One sample, taken apart; without terms where the law of free flight does not cover it."""

    time_s: float
    """Time of the sample."""
    step: int
    """Its number."""
    phase: Phase
    """Whether the body falls, touches the floor, or has come to rest."""
    simulated_m: float
    """Height of the centre in the recording."""
    free_fall_m: float
    """Height by theory, without air; no lower than the floor lets the centre get."""
    error_m: float
    """Simulated minus free fall."""
    terms_m: Terms | None
    """What the error is made of; None where the law of free flight does not cover it."""


@dataclass(frozen=True)
class Airborne:
    """The error over all samples that the law of free flight covers; None where it covers none."""

    samples: int
    """How many these are."""
    max_abs_error_m: float | None
    """Largest absolute error."""
    rms_error_m: float | None
    """Root mean square of the error."""
    max_abs_rounding_m: float | None
    """Largest absolute rounding term."""


@dataclass(frozen=True)
class Coverage:
    """Which samples the law of free flight takes apart, and why no more."""

    samples: int
    """How many samples it takes apart, from the first on."""
    of: int
    """How many there are."""
    why: str
    """What ends it."""


@dataclass(frozen=True)
class Landing:
    """When theory brings the centre down to where the body, as released, touches the floor."""

    time_free_fall_s: float
    """Without air."""
    time_damped_s: float | None
    """With Bullet's damping; None where that stops it on the way."""


@dataclass(frozen=True)
class Impact:
    """When the body meets the floor, in theory and in the simulation.

    The times are those at which the centre comes down to the rest height; None where the body may
    be turned by then, so that it touches earlier.
    """

    time_free_fall_s: float | None
    """By theory without air."""
    time_damped_s: float | None
    """By theory with Bullet's damping."""
    time_simulated_s: float | None
    """In the recording, between two samples."""
    step: int
    """First sample that touches the floor."""
    speed_m_s: float
    """Speed of the last sample before it, in whatever direction."""
    lowest_m: float
    """Lowest height of the centre."""
    lowest_step: int
    """The sample of it."""
    penetration_m: float | None
    """How deep it sinks; None where it is turned, so that its centre does not say so, and with
    `--substeps`, within which it may have been deeper."""


@dataclass(frozen=True)
class Contact:
    """How the recorded contact compares with Bullet's contact law, for a body that lands flat."""

    max_deviation_m: float
    """Largest distance between the recorded heights and the law's, while the body is flat."""
    deviation_step: int
    """The sample of it."""


@dataclass(frozen=True)
class Bounce:
    """One rebound: measured, and explained while the body touches flat."""

    step: int
    """The last sample in free flight before it."""
    approach_m_s: float
    """Speed downwards that the contact met: what the step would have made of it without one."""
    rebound_m_s: float
    """Speed upwards after the last step in which contact pushed."""
    effective_restitution: float | None
    """Rebound over approach; None once the body tumbles."""
    apex_m: float
    """Highest point from the rest height before the next contact, or the recording's end."""
    predicted_apex_m: float | None
    """The same by theory: restitution to the power of twice the bounce's number, times the fall;
    None once the body tumbles, or where the recording ends on the way up."""
    uncorrected_apex_m: float | None
    """The same by the contact law without position correction, i.e. with `--contact-erp 0`."""
    correction_m_s: float | None
    """Speed that the position correction adds to restitution × approach; None where the contact
    law does not give the recorded rebound."""


@dataclass(frozen=True)
class RestTerms:
    """Why a box at rest lies lower than it should [m]; the three add up to the error."""

    slop: float
    """Bullet leaves a penetration of 10 µm uncorrected."""
    solver: float
    """The solver stopped early: recorded minus the contact law."""
    settling: float
    """The law itself has not come to its end."""


@dataclass(frozen=True)
class Rest:
    """Where the body comes to lie."""

    height_m: float
    """Height of the centre in the last sample."""
    expected_m: float | None
    """None where nothing says how high the centre of a body lies that is turned like this."""
    error_m: float | None
    """Height minus what is expected."""
    settled_step: int | None
    """First sample of the rest; None where the body goes on creeping or turning."""
    terms_m: RestTerms | None
    """None where the contact law does not cover the landing."""
    sinks_m: float | None = None
    """How deep the soft contact of MuJoCo or Drake lets a body sink under its weight, by its closed
    form; None where the body lies elsewhere, and in other engines."""


@dataclass(frozen=True)
class Finding:
    """Something a recording gives away: what was seen, why, and what changes it."""

    code: str
    """A name that stays: what scripts look for."""
    message: str
    """What was seen, why, and the call or option that changes it."""


@dataclass(frozen=True)
class Conservation:
    """How well the samples before the first contact keep energy and angular momentum."""

    energy_initial_j: float
    """Kinetic and potential energy of the first sample."""
    energy_max_rel_drift: float | None
    """Largest change of the energy, over its initial value; None where that is 0."""
    angular_momentum_max_rel_drift: float | None
    """The same of the angular momentum about the centre of mass."""


@dataclass(frozen=True)
class SegmentCounts:
    """How many samples there are of each kind; that of a sample is that of the step before it."""

    flight: int
    """Position and velocities are the law's, and nothing touches."""
    contact: int
    """They are the law's and the reported contact forces', to 1e-12 of what is added up."""
    pushed: int
    """The same with recorded external forces; a drop has none."""
    set: int
    """Put there by a call: the release."""
    jointed: int
    """Of a body with joints, which the laws here do not cover."""
    still: int
    """Nothing changes, as no step is taken."""
    unexplained: int
    """Not explained: see `explained.why`."""


@dataclass(frozen=True)
class Explained:
    """How much of the recording is explained, step by step, also while the body tumbles."""

    samples: int
    """How many samples are, anywhere in the recording."""
    of: int
    """How many there are."""
    until_s: float | None
    """Time of the last sample before the first that is not; None where the release is not."""
    why: str | None
    """What ends it; None where all are explained."""


@dataclass(frozen=True)
class ContactPhase:
    """An unbroken run of samples that contact led to: what it gave to the body."""

    first_step: int
    """The first of these samples."""
    last_step: int
    """The last of them."""
    impulse_n_s: tuple[float, float, float]
    """Of all contact forces on the body together: x, y, z."""
    largest_force_n: float
    """The greatest force of a step, all its contact points together."""
    kinetic_j: float
    """What contact gave to the body's kinetic energy, or took from it. The ledger's contact is
    that and what Euler's step loses to the weight of a body that does not fall freely."""


@dataclass(frozen=True)
class Analysis(Shown, lines_of="pipeline.console.show_drop:analysis_lines"):
    """Everything that a recording tells."""

    scenario: dict[str, Any]
    """What was dropped, and how: the options, by field."""
    engine: EngineReport
    """What the engine reported: see recording.md."""
    at: list[Moment]
    """The samples nearest to `--at`."""
    coverage: Coverage
    """Which samples the law of free flight takes apart."""
    airborne: Airborne
    """The error over all of these."""
    landing: Landing | None
    """When theory brings the body down to the floor; None where it does not, or cannot say."""
    impact: Impact | None
    """When the body meets the floor; None where it never does, or nobody knows when: of several
    substeps PyBullet reports the last one's contact, and for joints there is no law."""
    tumbled_step: int | None
    """First sample that touches the floor tilted by more than 0.29° (a box from its faces, others
    from their release): from there on bounces, contact and rest are measured, not predicted."""
    tumbles: bool
    """Whether its tilt changes from there on by as much again."""
    contact: Contact | None
    """The contact beside Bullet's law; None where that does not cover it."""
    bounces: list[Bounce]
    """The rebounds, in order; of a rigid body without `--substeps`, of which PyBullet reports the
    last one's contact only."""
    rest: Rest | None
    """Where the body comes to lie; None where it does not."""
    conservation: Conservation
    """What is kept until the first contact."""
    energy: EnergyLedger
    """Where the energy went."""
    segments: SegmentCounts
    """What the samples are: what the step was that led to each."""
    flights: list[Flight]
    """Each flight as a drop of its own: the fall, and one after each bounce."""
    explained: Explained
    """How much of the recording is explained."""
    contact_phases: list[ContactPhase]
    """What each contact gave; not in the JSON."""
    findings: list[Finding]
    """What the recording gives away."""
    table: pl.DataFrame
    """One row per sample: step, time, phase, heights, error and terms, energies."""
    recording: Path | None = None
    """The recording that was analyzed; None where it is no file."""
    layer: Path | None = None
    """The recording that was analyzed and the layer that shows it, where they are files."""
    partial: bool = False
    """Whether the recording was never finished: this is the analysis of what there is of it."""

    def as_json(self) -> dict[str, Any]:
        """Return the contract's JSON object; what does not exist is null."""
        left_out = ("table", "contact_phases")
        values = {name: value for name, value in vars(self).items() if name not in left_out}
        return {name: jsonable(value) for name, value in values.items()}
