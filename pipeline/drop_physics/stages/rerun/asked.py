"""Parses the changes that `--try` and `--vary` name, such as `force=35,70`."""

from __future__ import annotations

import difflib
from collections.abc import Sequence

from drop_physics.engines.cures import FACTORS, PARAMETERS, ROWS
from drop_physics.engines.pybullet.interventions import RESIDUAL, TIMESTEPS
from drop_physics.errors import ScenarioError
from drop_physics.fields import all_of, alternatives
from drop_physics.option_types import number
from drop_physics.stages.rerun.single import RESIDUAL_0, SINGLE, is_single
from drop_physics.trace.cures import Cure

SIGNS = {"timestep": "/", "iterations": "*"}
MOST_NEAR = 3
"""Most similar names suggested for an unknown name."""
MOST_TIMES = 1000
"""Largest factor allowed after a `/` or `*` sign."""
UNNAMED = ("without", "parameter")
"""Interventions that cannot be given by name here."""


def cures_of(texts: Sequence[str], option: str, *, whole: bool) -> list[Cure]:
    """Parse changes, one for each value; each keeps its text.

    All single changes get the name `SINGLE`; their text says what they change.

    Parameters
    ----------
    texts
        Texts such as `timestep/8`, `nudge`, `force=35,70` or `contactERP=0.1`.
    option
        Name of the command-line option that the texts belong to, for error messages.
    whole
        Whether the changes apply to the whole run; then an engine parameter takes precedence over
        an intervention of the same name.

    Raises
    ------
    ScenarioError
        If a text names no change.
    """
    return [cure for text in texts for cure in _named(text, option, whole=whole)]


def _named(text: str, option: str, *, whole: bool) -> list[Cure]:
    if is_single(text):
        return [Cure(SINGLE, call=text.strip())]
    names = sorted({*ROWS, *PARAMETERS}.difference(UNNAMED, SIGNS))
    near = difflib.get_close_matches(text.partition("=")[0], names, MOST_NEAR, 0.0)
    refused = ScenarioError(
        "{option} takes an intervention such as friction=0.5, damping, timestep/4 or iterations*4, "
        "or a parameter of the engine such as contactERP=0.1, got {text!r}; near it are {near}",
        option=option,
        near=all_of(near),
        text=text,
    )
    if text in (RESIDUAL_0, "residual=0"):
        return [Cure("parameter", value=0.0, call=RESIDUAL_0, given={"name": RESIDUAL})]
    for name, sign in SIGNS.items():
        if text.startswith(name + sign):
            times = text.removeprefix(name + sign).split(",")
            if not all(each.isdecimal() and 2 <= int(each) <= MOST_TIMES for each in times):
                raise refused
            return [Cure(name, value=float(n), call=f"{name}{sign}{int(n)}") for n in times]
    name, equals, given = text.partition("=")
    if name in TIMESTEPS and equals:
        raise ScenarioError(
            "{option} takes no {name}; vary it with timestep/2", option=option, name=name
        )
    if not equals:
        if name not in ROWS or name in UNNAMED or (whole and name in FACTORS):
            raise refused
        return [Cure(name, call=text)]
    values = given.split(",")
    choices = PARAMETERS.get(name, ())
    if {*values} <= {*choices}:
        parameter = {"name": name}
        return [
            Cure("parameter", None, float(choices.index(n)), f"{name}={n}", given=parameter)
            for n in values
        ]
    is_parameter = not choices and name in PARAMETERS
    if choices and whole:
        raise ScenarioError(
            "{option} {name} takes {choices}, got {text!r}",
            option=option,
            name=name,
            choices=alternatives(choices),
            text=text,
        )
    if not is_parameter and (name not in ROWS or name in UNNAMED):
        raise refused
    is_parameter = is_parameter and (whole or name not in ROWS)
    found = []
    for each in values:
        try:
            value = number(each)
        except ScenarioError:
            raise refused from None
        is_wrong = (name == "seed" and not value.is_integer()) or (name == "nudge" and value <= 0)
        if is_wrong or (whole and name in FACTORS and value < 0):
            raise refused
        cure = Cure(name, value=value, call=f"{name}={value:g}")
        if is_parameter:
            cure = Cure("parameter", value=value, call=cure.call, given={"name": name})
        found.append(cure)
    return found
