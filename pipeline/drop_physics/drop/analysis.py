"""The analysis of a fall: all results from its samples, in one object."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np
import polars as pl

from drop_physics.arrays import Float64
from drop_physics.drop.case import DropCase
from drop_physics.drop.course import Course
from drop_physics.drop.energy import Energies
from drop_physics.drop.landing import ContactLaw, find_bounces, find_landing, find_rest
from drop_physics.drop.mechanics import Mechanics, mechanics
from drop_physics.drop.one_sample import DEFAULT_AT_S, moment_of
from drop_physics.drop.phases import Phases
from drop_physics.drop.results import Airborne, FallAnalysis, Moment, Terms
from drop_physics.drop.samples import DropSamples
from drop_physics.errors import ScenarioError
from drop_physics.explain.decomposition import TERMS, Decomposition, decompose
from drop_physics.explain.rows import MOST_ROWS, SHOWN_PER_S


@dataclass(frozen=True)
class Fall:
    """A fall: its scenario, its motion and phases, and its analysis."""

    case: DropCase
    course: Course
    phases: Phases
    analysis: FallAnalysis
    mismatch_step: int | None = None
    """The first covered sample that does not follow from the previous one by the law; None if there
    is none so far."""


class FallAnalyzer:
    """Analyzes a fall as its samples are added in order.

    Parameters
    ----------
    case
        The scenario, the engine's report, and the samples.
    at_s
        Times at which the error is broken down [s]; if empty, 0.3 s, if that is in free flight.
    whole
        Whether the table has all samples, or only those that are shown.

    Raises
    ------
    ScenarioError
        If a time lies outside the recording.
    """

    def __init__(self, case: DropCase, *, at_s: Sequence[float] = (), whole: bool = True) -> None:
        self._case, self._whole = case, whole
        self._asked = _asked(at_s, case)
        self._per_s = min(SHOWN_PER_S, MOST_ROWS / max(case.end_s, 1.0))
        self._course, self._law, self._energies = Course(case), ContactLaw(case), Energies(case)
        self._errors = _Errors(case)
        self._rows: list[pl.DataFrame] = []

    def add(self, part: DropSamples) -> None:
        """Add further samples."""
        if not len(part):
            return
        course = self._course
        before, changes = course.add(part)
        tumbled = course.tumbled_step
        flat = len(part) if tumbled is None else tumbled - part.first
        self._law.add(part, min(max(flat, 0), len(part)))
        energies = mechanics(self._case.engine, part)
        self._energies.add(part, before, energies, course.air.airborne)
        rows = _rows(self._case, part, energies, self._errors.add(part, course.air.covered))
        if not self._whole:
            kept = [0, *self._asked, *changes, self._case.samples - 1]
            due = (pl.col("time_s") * self._per_s + 1e-9).floor()
            flies = pl.col("timestep_m").is_not_null()
            shown = (due != due.shift(1, fill_value=-1)) | (flies != flies.shift(-1))
            rows = rows.filter(shown | pl.col("step").is_in(kept))
        self._rows.append(rows)

    def fall(self) -> Fall:
        """Return the analyzed fall, once all samples are added."""
        case, course = self._case, self._course
        phases, tumbled = course.phases(), course.tumbled_step
        coverage, landing = course.air.coverage(), find_landing(case)
        table = pl.concat(self._rows)
        table.insert_column(2, phases.of(table["step"].to_numpy()).alias("phase"))
        steps, standard = self._asked, round(DEFAULT_AT_S / case.timestep_s)
        if not steps and coverage.samples > 1:  # the release alone has no error
            steps = [standard if standard < coverage.samples else (coverage.samples - 1) // 2]
        analysis = FallAnalysis(
            scenario=asdict(case.scenario),
            engine=case.engine,
            at=[self._moment(table, step) for step in steps],
            coverage=coverage,
            airborne=self._errors.airborne(),
            landing=landing,
            impact=course.impact(landing),
            tumbled_step=tumbled,
            tumbles=course.tumbles,
            contact=self._law.contact(phases, tumbled),
            bounces=find_bounces(case, course.touchdowns.found(), tumbled),
            rest=find_rest(case, phases, tumbled, self._law),
            conservation=self._energies.conservation(),
            contact_j=self._energies.contact_j(),
            table=table,
        )
        return Fall(case, course, phases, analysis)

    def _moment(self, table: pl.DataFrame, step: int) -> Moment:
        found = table.filter(pl.col("step") == step)
        if found.is_empty():  # it was not asked for, and its row is not shown
            case = self._case
            return moment_of(case.law, case.fall, case.sample(step).position_m, step)
        row = found.row(0, named=True)
        explained = row["timestep_m"] is not None
        return Moment(
            time_s=row["time_s"],
            step=step,
            phase=row["phase"],
            simulated_m=row["simulated_m"],
            free_fall_m=row["free_fall_m"],
            error_m=row["error_m"],
            terms_m=Terms(**{name: row[f"{name}_m"] for name in TERMS}) if explained else None,
        )


def fall_of(case: DropCase, *, at_s: Sequence[float] = (), whole: bool = True) -> FallAnalysis:
    """Return the analysis of a fall alone, without impulse explanations: see `FallAnalyzer`."""
    falling = FallAnalyzer(case, at_s=at_s, whole=whole)
    for _ in map(falling.add, case.parts()):  # `map` keeps none while the next are read
        pass
    return falling.fall().analysis


class _Errors:
    """The error of the samples in free flight, broken into terms as samples are added."""

    def __init__(self, case: DropCase) -> None:
        self._case = case
        self._path = case.law.exact_path(case.fall.position_m, case.fall.velocity_m_s)
        self._samples, self._largest_m, self._rounding_m = 0, 0.0, 0.0
        self._squares_m2: list[float] = []

    def add(self, part: DropSamples, covered: int) -> Decomposition:
        """Add further samples; the formula covers the first `covered` of all samples."""
        flown_m = part.position_m[: max(covered - part.first, 0)]
        parts = decompose(
            self._case.law, self._case.fall, flown_m, first=part.first, path=self._path
        )
        if len(flown_m):
            error_m, rounding_m = parts.total_m[:, 2], parts.rounding_m[:, 2]
            self._samples += len(error_m)
            self._largest_m = max(self._largest_m, float(np.abs(error_m).max()))
            self._rounding_m = max(self._rounding_m, float(np.abs(rounding_m).max()))
            self._squares_m2.append(float(np.sum(error_m**2)))
        return parts

    def airborne(self) -> Airborne:
        """Return the error over all covered samples."""
        if not self._samples:
            return Airborne(0, None, None, None)
        rms_m = float(np.sqrt(sum(self._squares_m2) / self._samples))
        return Airborne(self._samples, self._largest_m, rms_m, self._rounding_m)


def _rows(
    case: DropCase, part: DropSamples, energies: Mechanics, parts: Decomposition
) -> pl.DataFrame:
    """Return table rows without the phase; terms are null where free flight is not covered."""
    time_s = part.times_s(case.timestep_s)
    free_fall_m = case.free_fall_m(time_s)

    def explained(values: Float64) -> pl.Series:
        padded = np.pad(values, (0, len(part) - len(values)), constant_values=np.nan)
        return pl.Series(padded, nan_to_null=True)

    return pl.DataFrame(
        {
            "step": part.steps,
            "time_s": time_s,
            "simulated_m": part.height_m,
            "free_fall_m": free_fall_m,
            "damped_fall_m": case.damped_fall_m(time_s),
            "error_m": part.height_m - free_fall_m,
            **{f"{name}_m": explained(getattr(parts, f"{name}_m")[:, 2]) for name in TERMS},
            "kinetic_linear_j": energies.kinetic_linear_j,
            "kinetic_angular_j": energies.kinetic_angular_j,
            "potential_j": energies.potential_j,
            "energy_j": energies.total_j,
        }
    )


def _asked(at_s: Sequence[float], case: DropCase) -> list[int]:
    """Return the samples nearest to the requested times."""
    for time_s in at_s:
        if not 0 <= time_s <= case.end_s * (1 + 1e-12):
            raise ScenarioError(
                "--at must lie within the recording, 0 to {end:g} s, got {time:g}",
                end=case.end_s,
                time=time_s,
            )
    return [min(case.samples - 1, round(time_s / case.timestep_s)) for time_s in at_s]
