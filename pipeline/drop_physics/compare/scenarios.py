"""Compares two drops: their options, and the engines' reports."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from drop_physics.compare.difference import Difference, DropInputs, Setting
from drop_physics.scenario import ENGINES_WITH

SINGLE = 2.0**-22
OF_EVERY_ENGINE = ("timestep_s", "gravity_m_s2", "mass_kg", "inertia_kg_m2", "body_sha256")
"""Fields of a scenario that must be equal for two engines to be compared."""


def scenario_differences(run: DropInputs, golden: DropInputs) -> list[Difference]:
    """Return the settings that make two drops different experiments.

    A difference between scenarios is not listed again for the engines. If the scenarios agree but
    the engines' reports do not, the name has the prefix `engine.`: a default of the engine has
    changed, or the report was altered.
    """
    found, names = _scenario_differences(run, golden), asdict(run.scenario).keys()
    of_engines = [each for each in _engine_settings(run, golden) if not _is_version(each.column)]
    if found:
        return [*found, *(engine for engine in of_engines if engine.column not in names)]
    return [
        replace(each, column=f"engine.{each.column}") if each.column in names else each
        for each in of_engines
    ]


def engine_versions(run: DropInputs, golden: DropInputs) -> Iterator[Setting]:
    """Yield the software versions that differ between two drops."""
    for each in _engine_settings(run, golden):
        if _is_version(each.column):
            yield Setting(each.column, each.value, each.golden)


def _scenario_differences(run: DropInputs, golden: DropInputs) -> list[Difference]:
    mine, theirs = asdict(run.scenario), asdict(golden.scenario)
    if run.engine.body_sha256 == golden.engine.body_sha256:
        theirs["body"] = mine["body"]  # the same file under another name
    not_shared = _not_shared(run, golden)
    return [
        Difference(None, None, None, name, value, theirs[name])
        for name, value in mine.items()
        if value != theirs[name] and name not in not_shared and not _alike(run, golden, name)
    ]


def _alike(run: DropInputs, golden: DropInputs, name: str) -> bool:
    """Return whether an option at one engine's default agrees with the other drop's value."""
    if run.scenario.engine == golden.scenario.engine:
        return False
    mine, theirs = (_in_effect(side, name) for side in (run, golden))
    if None in (*mine, *theirs):
        return False
    return np.allclose(mine, theirs, rtol=SINGLE, atol=0)


def _in_effect(side: DropInputs, name: str) -> tuple[Any, ...]:
    """Return an engine's effective values for an option; None for unknown values."""
    if name == "friction":
        return (side.engine.lateral_friction, side.engine.floor_lateral_friction)
    return (None,)


def _not_shared(run: DropInputs, golden: DropInputs) -> set[str]:
    """Return the options that only one of the two engines supports."""
    engines = {side.scenario.engine for side in (run, golden)}
    if len(engines) == 1:
        return set()
    return {"integrator"} | {name for name, have in ENGINES_WITH.items() if not engines <= {*have}}


def _engine_settings(run: DropInputs, golden: DropInputs) -> list[Difference]:
    """Return the differences between values that both engines report."""
    mine, theirs = asdict(run.engine), asdict(golden.engine)
    same_engine = run.scenario.engine == golden.scenario.engine
    return [
        Difference(None, None, None, name, value, theirs[name])
        for name, value in mine.items()
        if None not in (value, theirs[name])
        and value != theirs[name]
        and (same_engine or _apart(name, value, theirs[name]))
    ]


def _apart(name: str, value: Any, other: Any) -> bool:  # noqa: ANN401
    """Return whether two values differ by more than float32 rounding."""
    if name not in OF_EVERY_ENGINE:
        return False
    return isinstance(value, str) or not np.allclose(value, other, rtol=SINGLE, atol=0)


def _is_version(name: str) -> bool:
    return name.endswith("_version") or name in (
        "pybullet_build",
        "pybullet_wheel",
        "pybullet_api",
        "machine",
        "gl_renderer",
    )
