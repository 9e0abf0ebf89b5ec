"""What `drop trust` varies, by name, and how far apart it lets runs end."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

from drop_physics.engines.pybullet.watch.arguments import ARGUMENTS, CLIENT
from drop_physics.errors import ScenarioError
from drop_physics.fields import alternatives, shown
from drop_physics.option_types import number
from drop_physics.trace.history import PYBULLET

NUDGE = 1e-9
"""How far bodies and joints are moved before the first step [m, rad]."""
USUAL = (
    *("timestep/2", "timestep/4", "iterations*4", "residual 0"),
    *("solver=CG", "solver=Newton", "cone=pyramidal", "cone=elliptic", "impratio=10"),
    *("nudge", "seed"),
)
"""The usual variations; an engine has some of them, and its model may have others already."""
FACTORS = ("gravity", "friction", "mass")
"""What `--vary` takes besides parameters of the engine."""
PARAMETERS = {*ARGUMENTS["setPhysicsEngineParameter"]} - {CLIENT, "fixedTimeStep", "numSubSteps"}
OPTIONS: dict[str, tuple[str, ...]] = {
    "solver": ("PGS", "CG", "Newton"),
    "cone": ("pyramidal", "elliptic"),
    "integrator": ("Euler", "RK4", "implicit", "implicitfast"),
    **dict.fromkeys(("impratio", "tolerance", "ls_tolerance", "ls_iterations"), ()),
    **dict.fromkeys(("noslip_iterations", "noslip_tolerance", "ccd_iterations"), ()),
}
"""Fields of MuJoCo's `model.opt`; where they are a choice, its names by their numbers."""
MOST_FINER = 1000

UNITS = {
    "m": (1.0, "m"),
    "cm": (1e-2, "m"),
    "mm": (1e-3, "m"),
    "µm": (1e-6, "m"),
    "um": (1e-6, "m"),
    "nm": (1e-9, "m"),
    "rad": (1.0, "rad"),
    "mrad": (1e-3, "rad"),
    "deg": (0.017453292519943295, "rad"),
    "°": (0.017453292519943295, "rad"),
}
LENGTH = re.compile(r"([^\s]*?[\d.])\s*([^\d\s.]+)?")

Variations = dict[str, dict[str, Any]]
"""What is varied, by name: arguments of PyBullet's `Variation`, `options` of MuJoCo's model, and
`draws`, a seed in place of the script's own."""


def variations_of(texts: Sequence[str] | None) -> Variations:
    """Return variations by name, of texts such as `timestep/8`, `nudge` or `mass=0.9,1.1`.

    Raises
    ------
    ScenarioError
        If a text is something else.
    """
    found: Variations = {}
    for text in texts or USUAL:
        found |= _named(text)
    return found


def of_engine(
    variations: Variations, settings: Mapping[str, Any], *, engine: str, usual: bool
) -> Variations:
    """Return the variations that a script's engine has.

    Parameters
    ----------
    variations
        By name.
    settings
        Of the script's own run, by name.
    engine
        That steps it.
    usual
        Whether those of other engines, and what the model has already, are left out silently.

    Raises
    ------
    ScenarioError
        If one is another engine's.
    """
    others = "engine" if engine != PYBULLET else "options"
    found: Variations = {}
    for name, given in variations.items():
        if others in given and not usual:
            raise ScenarioError(
                "--vary {name} is no option of {engine}, which steps the script",
                name=name,
                engine=engine,
            )
        options = given.get("options", {})
        has_it = options and all(settings.get(key) == value for key, value in options.items())
        if others not in given and not (usual and has_it):
            found[name] = given
    return found


def _named(text: str) -> Variations:
    if text == "nudge":
        return {text: {"nudge": NUDGE}}
    if text == "seed":
        return {text: {"draws": None}}
    if text in ("residual 0", "residual=0"):
        return {"residual 0": {"engine": {"solverResidualThreshold": 0.0}}}
    for name, sign, argument in (("timestep", "/", "finer"), ("iterations", "*", "iterations")):
        if text.startswith(name + sign):
            factors = text.removeprefix(name + sign).split(",")
            if not all(each.isdecimal() and 2 <= int(each) <= MOST_FINER for each in factors):
                raise _refused(text)
            return {f"{name}{sign}{int(each)}": {argument: int(each)} for each in factors}
    name, equals, values = text.partition("=")
    if not equals or not name:
        raise _refused(text)
    if OPTIONS.get(name):
        chosen = [each for each in values.split(",") if each in OPTIONS[name]]
        if chosen == values.split(","):
            return {
                f"{name}={each}": {"options": {name: OPTIONS[name].index(each)}} for each in chosen
            }
        raise ScenarioError(
            "--vary {name} takes {choices}, got {text!r}",
            name=name,
            choices=alternatives(OPTIONS[name]),
            text=text,
        )
    if name in ("fixedTimeStep", "numSubSteps", "timestep"):
        raise ScenarioError("--vary takes no {name}; vary it with timestep/2", name=name)
    return {f"{name}={each:g}": _with(name, each, text) for each in _numbers(values, text)}


def _with(name: str, value: float, text: str) -> dict[str, Any]:
    if name == "nudge" and value > 0:
        return {"nudge": value}
    if name == "seed" and value.is_integer():
        return {"draws": int(value)}
    if name in FACTORS and value >= 0:
        return {name: value}
    if name in OPTIONS:
        return {"options": {name: int(value) if value.is_integer() else value}}
    if name in PARAMETERS:
        return {"engine": {name: int(value) if value.is_integer() else value}}
    raise _refused(text)


def _numbers(values: str, text: str) -> list[float]:
    try:
        return [number(each) for each in values.split(",")]
    except ScenarioError:
        raise _refused(text) from None


def _refused(text: str) -> ScenarioError:
    return ScenarioError(
        "--vary must be timestep/K, iterations*K, residual=0, nudge, seed or NAME=V,… with a "
        "parameter of p.setPhysicsEngineParameter or of MuJoCo's model.opt, gravity [m/s2], or "
        "factors of friction or mass, got {text!r}",
        text=text,
    )


def lengths_of(text: str | float | None) -> Mapping[str, float]:
    """Return the largest distances by unit, m or rad, of a text such as `1mm` or `1mm,0.5deg`.

    Raises
    ------
    ScenarioError
        If it is something else.
    """
    if text is None:
        return {}
    found: dict[str, float] = {}
    for part in str(text).split(","):
        match = LENGTH.fullmatch(part.strip())
        try:
            if match is None:
                raise ValueError
            value, (size, unit) = number(match[1]), UNITS[match[2] or "m"]
            if not 0 <= value < float("inf"):
                raise ValueError
        except (ScenarioError, KeyError, ValueError):
            raise ScenarioError(
                "--within must be a length or an angle such as 1mm or 0.5deg, got {text}",
                text=shown(text),
            ) from None
        found[unit] = value * size
    return found
