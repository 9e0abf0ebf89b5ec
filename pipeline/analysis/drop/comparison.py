"""Are two falls the same physics? If not: what differs first, by how much, and what it looks like.

Before the first contact the law uses only + - × ÷ √, so that two runs of one engine agree to the
last bit; in contact the solver stops at a residual, which is a discrete branch, and a nanometre is
let pass. A tolerance is a length [m]. What it allows in another column follows from it: a velocity
may be wrong by what moves the body so far in one step, an angle by what moves its surface so far.
"""

from __future__ import annotations

import re
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from pipeline.analysis.drop.fitted_law import POSITION, likeness
from pipeline.laws.bullet_air import EXACT_MACHINES, FUSED
from pipeline.report import EngineReport
from pipeline.scenario import Scenario

Float64 = NDArray[np.float64]

IN_CONTACT_M = 1e-9


@dataclass(frozen=True)
class Side:
    """One of the two falls: what was dropped, what the engine reports, and the samples."""

    scenario: Scenario
    engine: EngineReport
    states: pl.DataFrame
    """One row per sample: `step`, and the columns of the recording's state."""


@dataclass(frozen=True)
class Setting:
    """A value of scenario, engine or camera that the two sides do not share."""

    name: str
    """Its name in the recording; that of the engine's begins with `engine.` where both have it."""
    value: Any
    """In the recording that was checked."""
    golden: Any
    """In the golden one."""


@dataclass(frozen=True)
class Place:
    """The first sample and column that differ by more than is allowed."""

    step: int
    """The sample."""
    column: str
    """The column, or `frame`."""
    value: float | None = None
    """What stands there in the recording that was checked."""
    golden: float | None = None
    """None where the difference is not one of numbers, as between frames."""


@dataclass(frozen=True)
class Comparison:
    """What two falls have in common."""

    differences: list[Setting]
    """Settings that make it another experiment."""
    versions: list[Setting]
    """What made them; a version is no difference in physics."""
    first: Place | None
    """What differs first; None where nothing does."""
    largest_difference_m: float | None
    """Between the positions, over all samples; None where they are not those of the same steps."""
    largest_difference_step: int | None
    looks_like: str | None
    """What the difference looks like, in words."""

    @property
    def same(self) -> bool:
        """Whether it is the same physics."""
        return not self.differences and self.first is None


def compare(run: Side, golden: Side, *, tolerance_m: float = 0.0) -> Comparison:
    """Compare a fall with the golden one: settings first, then the samples.

    Parameters
    ----------
    run, golden
        The two falls.
    tolerance_m
        Difference that is let pass [m], in the air and in contact.
    """
    differences = [*_scenario_differences(run, golden), *_engine_differences(run, golden)]
    versions = [one for one in _engine_settings(run, golden) if _is_version(one.name)]
    if (
        run.states.shape != golden.states.shape
        or run.scenario.timestep_s != golden.scenario.timestep_s
    ):
        return Comparison(differences, versions, None, None, None, None)
    distance_m = np.abs(
        run.states.select(POSITION).to_numpy() - golden.states.select(POSITION).to_numpy()
    ).max(axis=1)
    farthest = int(np.argmax(distance_m))
    first = _first_difference(run, golden, tolerance_m)
    return Comparison(
        differences=differences,
        versions=versions,
        first=first,
        largest_difference_m=float(distance_m[farthest]),
        largest_difference_step=farthest,
        looks_like=None
        if first is None or differences
        else likeness(
            run.states,
            golden.states,
            timestep_s=golden.scenario.timestep_s,
            first=first.step,
            airborne=_airborne(run, golden),
        ),
    )


# -- settings -------------------------------------------------------------------------------------


def _scenario_differences(run: Side, golden: Side) -> list[Setting]:
    mine, theirs = asdict(run.scenario), asdict(golden.scenario)
    if run.engine.body_sha256 == golden.engine.body_sha256:
        theirs["body"] = mine["body"]  # the same file under another name
    return [
        Setting(name, value, theirs[name]) for name, value in mine.items() if value != theirs[name]
    ]


def _engine_settings(run: Side, golden: Side) -> list[Setting]:
    """Return what the two engines report differently; what only one reports is no difference."""
    mine, theirs = asdict(run.engine), asdict(golden.engine)
    return [
        Setting(name, value, theirs[name])
        for name, value in mine.items()
        if None not in (value, theirs[name]) and value != theirs[name]
    ]


def _engine_differences(run: Side, golden: Side) -> list[Setting]:
    """Return what else the engines report differently.

    What scenarios that differ say already is not said twice. Where they agree it is said with its
    origin: a default of the engine has changed, or a report was altered.
    """
    settings = [one for one in _engine_settings(run, golden) if not _is_version(one.name)]
    names = asdict(run.scenario).keys()
    if _scenario_differences(run, golden):
        return [one for one in settings if one.name not in names]
    return [
        replace(one, name=f"engine.{one.name}") if one.name in names else one for one in settings
    ]


def _is_version(name: str) -> bool:
    return name.endswith("_version") or name in (
        "pybullet_build", "pybullet_wheel", "pybullet_api", "machine", "gl_renderer",
    )  # fmt: skip


# -- samples --------------------------------------------------------------------------------------


def _first_difference(run: Side, golden: Side, tolerance_m: float) -> Place | None:
    mine, theirs = run.states.drop("step"), golden.states.drop("step")
    x, y = mine.to_numpy(), theirs.to_numpy()
    with np.errstate(invalid="ignore"):
        off = ~(np.abs(x - y) <= _allowed(run, golden, theirs, tolerance_m))
    off &= ~(np.isnan(x) & np.isnan(y))  # no contact, no distance
    steps = np.flatnonzero(off.any(axis=1))
    if not len(steps):
        return None
    step = int(steps[0])
    column = int(np.argmax(off[step]))
    return Place(step, mine.columns[column], _number(x[step, column]), _number(y[step, column]))


def _number(value: float) -> float | None:
    return None if np.isnan(value) else float(value)


def _airborne(run: Side, golden: Side) -> int:
    """Return how many samples there are before the first contact of either."""
    touching = [np.flatnonzero(side.states["contact_points"].to_numpy()) for side in (run, golden)]
    return int(min((steps[0] for steps in touching if len(steps)), default=len(run.states)))


def _allowed(run: Side, golden: Side, states: pl.DataFrame, tolerance_m: float) -> Float64:
    """Return the difference that is let pass in each number, shape (samples, columns)."""
    scale = [_per_metre(golden)[re.sub(r"^link\d+_", "", name)] for name in states.columns]
    contact = np.arange(len(states)) >= _airborne(run, golden)
    length_m = np.where(contact, max(IN_CONTACT_M, tolerance_m), tolerance_m)
    allowed = np.outer(length_m, scale)
    machines = [side.engine.machine for side in (run, golden)]
    if any(machine not in EXACT_MACHINES for machine in machines):
        fused = FUSED * np.maximum(1.0, np.abs(np.nan_to_num(states.to_numpy())))
        allowed = np.where(contact[:, None], allowed, np.maximum(allowed, fused))
    return allowed


def _per_metre(golden: Side) -> dict[str, float]:
    """Return what a metre of tolerance allows in each column, in that column's unit."""
    step_s, length_m = golden.scenario.timestep_s, max(golden.engine.rest_height_m or 0.0, 1e-3)
    return {
        **dict.fromkeys(("x_m", "y_m", "z_m", "contact_distance_m"), 1.0),
        **dict.fromkeys(("qx", "qy", "qz", "qw"), 1 / length_m),
        **dict.fromkeys(("vx_m_s", "vy_m_s", "vz_m_s"), 1 / step_s),
        **dict.fromkeys(("wx_rad_s", "wy_rad_s", "wz_rad_s"), 1 / (length_m * step_s)),
        "contact_points": 0.0,
        "contact_force_n": golden.engine.mass_kg / step_s**2,
    }
