"""Are two falls the same physics? If not: what differs first, by how much, and what it looks like.

Before the first contact the law uses only + - × ÷ √, so that two runs of one engine agree to the
last bit; in contact the solver stops at a residual, which is a discrete branch, and a nanometre is
let pass. A tolerance is a length [m]. What it allows in another column follows from it: a velocity
may be wrong by what moves the body so far in one step, an angle by what moves its surface so far.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from pipeline.analysis.drop.case import case_of
from pipeline.analysis.drop.engines_apart import apart
from pipeline.analysis.drop.fitted_law import POSITION, likeness
from pipeline.analysis.general.samples import base_of
from pipeline.laws.base import EXACT_MACHINES, FUSED
from pipeline.report import EngineReport
from pipeline.scenario import ENGINES_WITH, Scenario

Float64 = NDArray[np.float64]

IN_CONTACT_M = 1e-9
SINGLE = 2.0**-22
OF_EVERY_ENGINE = ("timestep_s", "gravity_m_s2", "mass_kg", "inertia_kg_m2", "body_sha256")
"""What two different engines must have in common to be compared."""


@dataclass(frozen=True)
class Side:
    """One of the two falls: what was dropped, what the engine reports, and the samples."""

    scenario: Scenario
    engine: EngineReport
    states: pl.DataFrame
    """The recording's table: one row per sample and part."""
    contacts: pl.DataFrame
    """The recording's table: one row per contact point."""


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
    """The column, or `frame`; of a further link it begins with `link0_`, of a contact point with
    `contact_`, and `contact_points` is how many there are."""
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

    @property
    def same_experiment(self) -> bool:
        """Whether at most the engine is another one."""
        return all(setting.name == "engine" for setting in self.differences)


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
    versions = [setting for setting in _engine_settings(run, golden) if _is_version(setting.name)]
    if (
        run.states.shape != golden.states.shape
        or run.scenario.timestep_s != golden.scenario.timestep_s
    ):
        return Comparison(differences, versions, None, None, None, None)
    mine_m, theirs_m = (base_of(side.states).select(POSITION).to_numpy() for side in (run, golden))
    distance_m = np.abs(mine_m - theirs_m).max(axis=1)
    farthest = int(np.argmax(distance_m))
    first = _first_difference(run, golden, tolerance_m)
    looks_like = None
    if not differences and first is not None:
        looks_like = likeness(
            run.states,
            golden.states,
            timestep_s=golden.scenario.timestep_s,
            first=first.step,
            airborne=_airborne(run, golden),
        )
    elif [setting.name for setting in differences] == ["engine"]:
        cases = [
            case_of(one.scenario, one.engine, one.states, one.contacts) for one in (run, golden)
        ]
        looks_like = apart(*cases, parts_at=None if first is None else first.step)
    return Comparison(
        differences=differences,
        versions=versions,
        first=first,
        largest_difference_m=float(distance_m[farthest]),
        largest_difference_step=farthest,
        looks_like=looks_like,
    )


# -- settings -------------------------------------------------------------------------------------


def _scenario_differences(run: Side, golden: Side) -> list[Setting]:
    mine, theirs = asdict(run.scenario), asdict(golden.scenario)
    if run.engine.body_sha256 == golden.engine.body_sha256:
        theirs["body"] = mine["body"]  # the same file under another name
    not_shared = _not_shared(run, golden)
    return [
        Setting(name, value, theirs[name])
        for name, value in mine.items()
        if value != theirs[name] and name not in not_shared
    ]


def _not_shared(run: Side, golden: Side) -> set[str]:
    """Return the options that one of two different engines does not have."""
    engines = {side.scenario.engine for side in (run, golden)}
    if len(engines) == 1:
        return set()
    return {"integrator"} | {name for name, have in ENGINES_WITH.items() if not engines <= {*have}}


def _engine_settings(run: Side, golden: Side) -> list[Setting]:
    """Return what the two engines report differently; what only one reports is no difference."""
    mine, theirs = asdict(run.engine), asdict(golden.engine)
    same_engine = run.scenario.engine == golden.scenario.engine
    return [
        Setting(name, value, theirs[name])
        for name, value in mine.items()
        if None not in (value, theirs[name])
        and value != theirs[name]
        and (same_engine or _apart(name, value, theirs[name]))
    ]


def _apart(name: str, value: Any, other: Any) -> bool:  # noqa: ANN401
    """Whether two engines report another experiment; one of them may round to float32."""
    if name not in OF_EVERY_ENGINE:
        return False
    return isinstance(value, str) or not np.allclose(value, other, rtol=SINGLE, atol=0)


def _engine_differences(run: Side, golden: Side) -> list[Setting]:
    """Return what else the engines report differently.

    What scenarios that differ say already is not said twice. Where they agree it is said with its
    origin: a default of the engine has changed, or a report was altered.
    """
    settings = [
        setting for setting in _engine_settings(run, golden) if not _is_version(setting.name)
    ]
    names = asdict(run.scenario).keys()
    if _scenario_differences(run, golden):
        return [setting for setting in settings if setting.name not in names]
    return [
        replace(setting, name=f"engine.{setting.name}") if setting.name in names else setting
        for setting in settings
    ]


def _is_version(name: str) -> bool:
    return name.endswith("_version") or name in (
        "pybullet_build", "pybullet_wheel", "pybullet_api", "machine", "gl_renderer",
    )  # fmt: skip


# -- samples --------------------------------------------------------------------------------------


def _first_difference(run: Side, golden: Side, tolerance_m: float) -> Place | None:
    """Return what differs first; in one step the states come before the contacts."""
    found = [
        _first_state(run, golden, tolerance_m),
        _first_count(run, golden),
        _first_contact(run, golden, max(IN_CONTACT_M, tolerance_m)),
    ]
    return min((one for one in found if one is not None), key=lambda one: one.step, default=None)


def _first_state(run: Side, golden: Side, tolerance_m: float) -> Place | None:
    names = list(_per_metre(golden))
    mine, theirs = (side.states.select(names).to_numpy() for side in (run, golden))
    steps, links = golden.states["step"].to_numpy(), golden.states["link"].to_numpy()
    allowed = _allowed(run, golden, steps, theirs, tolerance_m)
    place = _first_off(mine, theirs, allowed)
    if place is None:
        return None
    row, column = place
    prefix = "" if links[row] < 0 else f"link{links[row]}_"
    return Place(int(steps[row]), prefix + names[column], float(mine[place]), float(theirs[place]))


def _first_count(run: Side, golden: Side) -> Place | None:
    """Return the first step with another number of contact points."""
    samples = len(base_of(golden.states))
    mine, theirs = (
        np.bincount(side.contacts["step"].to_numpy(), minlength=samples) for side in (run, golden)
    )
    differing = np.flatnonzero(mine != theirs)
    if not len(differing):
        return None
    step = int(differing[0])
    return Place(step, "contact_points", float(mine[step]), float(theirs[step]))


def _first_contact(run: Side, golden: Side, tolerance_m: float) -> Place | None:
    """Return the first contact point that is another one, among those that both have."""
    mine, theirs = (_points(side.contacts) for side in (run, golden))
    both = min(len(mine), len(theirs))
    # From the first step on that has more points here or there, rows do not face each other.
    facing = mine["step"].head(both) == theirs["step"].head(both)
    rows = both if facing.all() else facing.arg_min() or 0
    names = [name for name in theirs.columns if name != "step"]
    x, y = (side.head(rows).select(names).to_numpy() for side in (mine, theirs))
    place = _first_off(
        x, y, tolerance_m * np.array([_per_metre_of_contact(golden, n) for n in names])
    )
    if place is None:
        return None
    row, column = place
    return Place(
        int(theirs["step"][row]), f"contact_{names[column]}", float(x[place]), float(y[place])
    )


def _points(contacts: pl.DataFrame) -> pl.DataFrame:
    """Return contact points, with friction as one force: where it is small, its parts are not."""
    friction = {
        f"friction_{axis}_n": pl.col("friction_1_n") * pl.col(f"f1{axis}")
        + pl.col("friction_2_n") * pl.col(f"f2{axis}")
        for axis in "xyz"
    }
    parts = pl.exclude("friction_1_n", "f1x", "f1y", "f1z", "friction_2_n", "f2x", "f2y", "f2z")
    return contacts.select(parts, **friction)


def _first_off(mine: Float64, theirs: Float64, allowed: Float64) -> tuple[int, int] | None:
    """Return row and column of the first number that differs by more than is allowed."""
    off = ~(np.abs(mine - theirs) <= allowed)
    rows = np.flatnonzero(off.any(axis=1))
    return None if not len(rows) else (int(rows[0]), int(np.argmax(off[rows[0]])))


def _airborne(run: Side, golden: Side) -> int:
    """Return how many samples there are before the first contact of either."""
    touching = [side.contacts["step"][0] for side in (run, golden) if len(side.contacts)]
    return min(touching, default=len(base_of(golden.states)))


def _allowed(
    run: Side, golden: Side, steps: NDArray[np.int64], numbers: Float64, tolerance_m: float
) -> Float64:
    """Return the difference that is let pass in each number of the states."""
    contact = steps >= _airborne(run, golden)
    length_m = np.where(contact, max(IN_CONTACT_M, tolerance_m), tolerance_m)
    allowed = np.outer(length_m, list(_per_metre(golden).values()))
    machines = [side.engine.machine for side in (run, golden)]
    if any(machine not in EXACT_MACHINES for machine in machines):
        fused = FUSED * np.maximum(1.0, np.abs(numbers))
        allowed = np.where(contact[:, None], allowed, np.maximum(allowed, fused))
    return allowed


def _per_metre(golden: Side) -> dict[str, float]:
    """Return what a metre of tolerance allows in each column of a state, in that column's unit."""
    step_s, length_m = golden.scenario.timestep_s, _length_m(golden)
    return {
        **dict.fromkeys(("x_m", "y_m", "z_m"), 1.0),
        **dict.fromkeys(("qx", "qy", "qz", "qw"), 1 / length_m),
        **dict.fromkeys(("vx_m_s", "vy_m_s", "vz_m_s"), 1 / step_s),
        **dict.fromkeys(("wx_rad_s", "wy_rad_s", "wz_rad_s"), 1 / (length_m * step_s)),
    }


def _per_metre_of_contact(golden: Side, column: str) -> float:
    """Return the same of a column of the contact points; nothing of which parts they are."""
    if column.endswith("_n"):
        return golden.engine.mass_kg / golden.scenario.timestep_s**2
    if column.endswith("_m"):
        return 1.0
    return 1 / _length_m(golden) if column in ("nx", "ny", "nz") else 0.0


def _length_m(golden: Side) -> float:
    return max(golden.engine.rest_height_m or 0.0, 1e-3)
