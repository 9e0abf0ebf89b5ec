"""Are two falls the same physics? If not: what differs first, by how much, and what it looks like.

Before the first contact the law uses only + - × ÷ √, so two runs of one engine agree to the last
bit; in contact the solver stops at a residual, which is a discrete branch, and a nanometre is
allowed. A tolerance is a length [m], from which those of other columns follow: a velocity may be
off by what moves the body that far in one step, an angle by what moves its surface that far.
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
from pipeline.analysis.general.differences import off, states_off
from pipeline.analysis.general.samples import base_of
from pipeline.laws.base import EXACT_MACHINES, FUSED
from pipeline.laws.lookup import law_for
from pipeline.laws.rotations import same_way
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
    """A value of scenario, engine or camera that differs between the two sides."""

    name: str
    """Its name in the recording; `engine.` comes first where the scenario has it too."""
    value: Any
    """The value in the checked recording."""
    golden: Any
    """The value in the golden recording."""


@dataclass(frozen=True)
class Place:
    """The first sample and column that differ by more than is allowed."""

    step: int
    """The sample."""
    column: str
    """The column, or `frame`; it begins with `link0_` for a further link and with `contact_` for a
    contact point; `contact_points` is how many there are."""
    value: float | None = None
    """The value in the checked recording."""
    golden: float | None = None
    """The same in the golden recording; None where the values are not numbers, as for frames."""


@dataclass(frozen=True)
class Comparison:
    """What two falls have in common."""

    differences: list[Setting]
    """Settings that make it another experiment."""
    versions: list[Setting]
    """The versions that made them, where these differ: not a difference in physics."""
    first: Place | None
    """The first difference; None where there is none."""
    largest_difference_m: float | None
    """Between positions of all parts, over all samples; None where those are not of the same steps.
    """
    largest_difference_step: int | None
    looks_like: str | None
    """What the difference looks like, in words."""

    @property
    def same(self) -> bool:
        """Whether it is the same physics."""
        return not self.differences and self.first is None

    @property
    def same_experiment(self) -> bool:
        """Whether no setting but the engine differs."""
        return all(setting.name == "engine" for setting in self.differences)


def compare(run: Side, golden: Side, *, tolerance_m: float = 0.0) -> Comparison:
    """Compare a fall with the golden one: settings first, then the samples.

    Parameters
    ----------
    run, golden
        The two falls.
    tolerance_m
        Allowed difference [m], in the air and in contact.
    """
    differences = [*_scenario_differences(run, golden), *_engine_differences(run, golden)]
    versions = [setting for setting in _engine_settings(run, golden) if _is_version(setting.name)]
    if (
        run.states.shape != golden.states.shape
        or run.scenario.timestep_s != golden.scenario.timestep_s
    ):
        return Comparison(differences, versions, None, None, None, None)
    mine_m, theirs_m = (side.states.select(POSITION).to_numpy() for side in (run, golden))
    distance_m = np.linalg.norm(mine_m - theirs_m, axis=1)
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
            touched=any((side.contacts["step"] == first.step).any() for side in (run, golden)),
        )
    elif [setting.name for setting in differences] == ["engine"]:
        cases = [
            case_of(side.scenario, side.engine, side.states, side.contacts)
            for side in (run, golden)
        ]
        looks_like = apart(*cases, parts_at=None if first is None else first.step)
    return Comparison(
        differences=differences,
        versions=versions,
        first=first,
        largest_difference_m=float(distance_m[farthest]),
        largest_difference_step=int(golden.states["step"][farthest]),
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
        if value != theirs[name] and name not in not_shared and not _alike(run, golden, name)
    ]


def _alike(run: Side, golden: Side, name: str) -> bool:
    """Whether the default of one engine is what the other was told."""
    if run.scenario.engine == golden.scenario.engine:
        return False
    mine, theirs = (_in_effect(side, name) for side in (run, golden))
    if None in (*mine, *theirs):
        return False
    return np.allclose(mine, theirs, rtol=SINGLE, atol=0)


def _in_effect(side: Side, name: str) -> tuple[Any, ...]:
    """Return what an engine makes of an option, numbers or, where that is not known, None."""
    if name in ("linear_damping", "angular_damping"):
        return (getattr(law_for(side.scenario, side.engine), name, None),)
    if name == "friction":
        return (side.engine.lateral_friction, side.engine.floor_lateral_friction)
    if name == "restitution":
        return (side.engine.restitution, side.engine.floor_restitution)
    return (None,)


def _not_shared(run: Side, golden: Side) -> set[str]:
    """Return the options that one of two different engines does not have."""
    engines = {side.scenario.engine for side in (run, golden)}
    if len(engines) == 1:
        return set()
    return {"integrator"} | {name for name, have in ENGINES_WITH.items() if not engines <= {*have}}


def _engine_settings(run: Side, golden: Side) -> list[Setting]:
    """Return what the two engines report differently, of what both report."""
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
    """Whether a value makes it another experiment; one engine may round to float32."""
    if name not in OF_EVERY_ENGINE:
        return False
    return isinstance(value, str) or not np.allclose(value, other, rtol=SINGLE, atol=0)


def _engine_differences(run: Side, golden: Side) -> list[Setting]:
    """Return what else the engines report differently.

    What differing scenarios say already is not repeated. Where they agree, the name says that it is
    the engine's: a default of the engine has changed, or a report was altered.
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
    """Return the first difference; within a step the states come before the contacts."""
    places = [
        _first_state(run, golden, tolerance_m),
        _first_count(run, golden),
        _first_contact(run, golden, max(IN_CONTACT_M, tolerance_m)),
    ]
    return min(filter(None, places), key=lambda place: place.step, default=None)


def _first_state(run: Side, golden: Side, tolerance_m: float) -> Place | None:
    names = list(_per_metre(golden))
    mine, theirs = (side.states.select(names).to_numpy(writable=True) for side in (run, golden))
    steps, links = golden.states["step"].to_numpy(), golden.states["link"].to_numpy()
    allowed = _allowed(run, golden, steps, theirs, tolerance_m)
    # Within a tolerance, a quaternion of the other sign is the same orientation.
    turns = slice(names.index("qx"), names.index("qw") + 1)
    exact = allowed[:, turns] == 0
    theirs[:, turns] = np.where(exact, theirs[:, turns], same_way(theirs[:, turns], mine[:, turns]))
    place = _first(states_off(mine, theirs, allowed))
    if place is None:
        return None
    row, column = place
    prefix = "" if links[row] < 0 else f"link{links[row]}_"
    return Place(int(steps[row]), prefix + names[column], float(mine[place]), float(theirs[place]))


def _first_count(run: Side, golden: Side) -> Place | None:
    """Return the first step in which the numbers of contact points differ."""
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
    """Return the first contact point that differs, among those that both have."""
    mine, theirs = (_points(side.contacts) for side in (run, golden))
    both = min(len(mine), len(theirs))
    # From the first step on in which the numbers of points differ, rows no longer correspond.
    same_step = mine["step"].head(both) == theirs["step"].head(both)
    rows = both if same_step.all() else same_step.arg_min() or 0
    names = [name for name in theirs.columns if name != "step"]
    x, y = (side.head(rows).select(names).to_numpy() for side in (mine, theirs))
    allowed = tolerance_m * np.array([_per_metre_of_contact(golden, name) for name in names])
    place = _first(off(x, y, allowed))
    if place is None:
        return None
    row, column = place
    return Place(
        int(theirs["step"][row]), f"contact_{names[column]}", float(x[place]), float(y[place])
    )


def _points(contacts: pl.DataFrame) -> pl.DataFrame:
    """Return contact points, friction added up to one force: a small one may have large parts."""
    friction = {
        f"friction_{axis}_n": pl.col("friction_1_n") * pl.col(f"f1{axis}")
        + pl.col("friction_2_n") * pl.col(f"f2{axis}")
        for axis in "xyz"
    }
    parts = pl.exclude("friction_1_n", "f1x", "f1y", "f1z", "friction_2_n", "f2x", "f2y", "f2z")
    return contacts.select(parts, **friction)


def _first(differ: NDArray[np.bool_]) -> tuple[int, int] | None:
    """Return row and column of the first number that differs by more than is allowed."""
    rows = np.flatnonzero(differ.any(axis=1))
    return None if not len(rows) else (int(rows[0]), int(np.argmax(differ[rows[0]])))


def _airborne(run: Side, golden: Side) -> int:
    """Return the number of samples before the first contact of either."""
    touching = [side.contacts["step"][0] for side in (run, golden) if len(side.contacts)]
    return min(touching, default=len(base_of(golden.states)))


def _allowed(
    run: Side, golden: Side, steps: NDArray[np.int64], numbers: Float64, tolerance_m: float
) -> Float64:
    """Return the allowed difference in each number of the states."""
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
        **dict.fromkeys(("qx", "qy", "qz", "qw"), 1 / (2 * length_m)),  # of half the angle
        **dict.fromkeys(("vx_m_s", "vy_m_s", "vz_m_s"), 1 / step_s),
        **dict.fromkeys(("wx_rad_s", "wy_rad_s", "wz_rad_s"), 1 / (length_m * step_s)),
    }


def _per_metre_of_contact(golden: Side, column: str) -> float:
    """Return the same for a column of the contact points; 0 for the numbers of their parts."""
    if column.endswith("_n"):
        return golden.engine.mass_kg / golden.scenario.timestep_s**2
    if column.endswith("_m"):
        return 1.0
    return 1 / _length_m(golden) if column in ("nx", "ny", "nz") else 0.0


def _length_m(golden: Side) -> float:
    return max(golden.engine.rest_height_m or 0.0, 1e-3)
