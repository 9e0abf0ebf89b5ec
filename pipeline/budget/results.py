"""What the judge returns: plain typed values, SI units, nothing computed here."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, is_dataclass
from pathlib import Path
from typing import Any

import polars as pl

from pipeline.budget.energy import EnergyLedger
from pipeline.budget.phases import Phase


@dataclass(frozen=True)
class Terms:
    """The four terms of an error [m]; they add up to it."""

    timestep: float
    damping: float
    interaction: float
    rounding: float


@dataclass(frozen=True)
class Moment:
    """One sample, taken apart; without terms where the law of the air does not hold."""

    time_s: float
    step: int
    phase: Phase
    simulated_m: float
    free_fall_m: float
    error_m: float
    terms_m: Terms | None


@dataclass(frozen=True)
class Airborne:
    """The error over all samples that the law of the air covers; None where it covers none."""

    samples: int
    max_abs_error_m: float | None
    rms_error_m: float | None
    max_abs_rounding_m: float | None


@dataclass(frozen=True)
class Coverage:
    """Which samples the law of the air takes apart, and why no more."""

    samples: int
    of: int
    why: str


@dataclass(frozen=True)
class Impact:
    """When the body meets the floor, in theory and in the simulation.

    The times are those at which the centre comes down to the rest height; None where the body may
    be turned by then, so that it touches earlier.
    """

    time_free_fall_s: float | None
    time_damped_s: float | None
    time_simulated_s: float | None
    step: int
    """First sample that a contact has acted on."""
    speed_m_s: float
    """Speed of the last sample before it."""
    lowest_m: float
    lowest_step: int
    penetration_m: float | None
    """None where the body is turned, so that its centre does not tell how deep its corner is."""


@dataclass(frozen=True)
class Contact:
    """How the recorded contact compares with Bullet's contact law, for a body that lands flat."""

    max_deviation_m: float
    """Largest distance between the recorded heights and the law's."""
    deviation_step: int


@dataclass(frozen=True)
class Bounce:
    """One rebound, recorded and predicted."""

    step: int
    """The last sample in free fall before it."""
    approach_m_s: float
    rebound_m_s: float
    effective_restitution: float
    apex_m: float
    """Highest point above the rest height before the next contact, or the recording's end."""
    predicted_apex_m: float
    """The same by theory: restitution to the power of twice the bounce's number, times the fall."""
    uncorrected_apex_m: float | None
    """The same by the contact law without position correction, that is with `--contact-erp 0`."""
    correction_m_s: float
    """Speed that the position correction added to restitution × approach."""


@dataclass(frozen=True)
class RestTerms:
    """Why a body at rest lies lower than it should [m]; the three add up to the error."""

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
    expected_m: float | None
    """None where nothing says how high the centre of such a body lies."""
    error_m: float | None
    settled_step: int
    terms_m: RestTerms | None
    """None where the body did not land flat, so that the contact law does not cover it."""


@dataclass(frozen=True)
class Finding:
    """Something a recording gives away: what was seen, why, and what changes it."""

    code: str
    message: str


@dataclass(frozen=True)
class Conservation:
    """How well the samples without contact keep energy and angular momentum."""

    energy_initial_j: float
    energy_max_rel_drift: float | None
    angular_momentum_max_rel_drift: float | None


@dataclass(frozen=True)
class Analysis:
    """Everything that a recording tells."""

    scenario: dict[str, Any]
    engine: dict[str, Any]
    at: list[Moment]
    coverage: Coverage
    airborne: Airborne
    impact: Impact | None
    contact: Contact | None
    bounces: list[Bounce]
    rest: Rest | None
    conservation: Conservation
    energy: EnergyLedger
    findings: list[Finding]
    table: pl.DataFrame
    """One row per sample: step, time, phase, heights, error and terms, energies."""
    recording: Path | None = None
    layer: Path | None = None
    """The recording that was analyzed and the layer that shows it, where they are files."""
    partial: bool = False
    """Whether the recording was never finished: this is the analysis of what there is of it."""

    def as_json(self) -> dict[str, Any]:
        """Return all but the table as the contract's JSON object; what does not exist is null."""
        values = {name: value for name, value in vars(self).items() if name != "table"}
        return {name: _jsonable(value) for name, value in values.items()}


def _jsonable(value: Any) -> Any:  # noqa: ANN401
    """Replace what JSON has no word for: nan and infinities become null."""
    if is_dataclass(value) and not isinstance(value, type):
        return _jsonable(asdict(value))
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, dict):
        return {key: _jsonable(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_jsonable(one) for one in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
