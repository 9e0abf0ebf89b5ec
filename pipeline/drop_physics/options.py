"""Converts the dataclasses of commands, scenarios and cameras to command-line options."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import MISSING
from typing import Annotated, Any

import typer

from drop_physics.console.output import note
from drop_physics.fields import Option
from drop_physics.installed import PYBULLET, is_installed, needs_pybullet, next_step, why_missing
from drop_physics.messages import Message
from drop_physics.option_types import integer, number
from drop_physics.scenario import Camera, Scenario
from drop_physics.stages.verbs.taken import VerbParameter, parameters_of

Texts = dict[str, str | bool | None]
"""Option values as typed texts, by field."""
Typed = Mapping[str, Any]
"""Values given on the command line, by parameter name."""
LONGEST = 40
"""Largest length of an option's list of choices in its help [characters], for a terminal of 50
columns."""


def a_number(given: Any) -> Any:  # noqa: ANN401
    """Parse a number as every option does; this also accepts a default, which Typer passes."""
    return number(given) if isinstance(given, str) else given


def an_integer(given: Any) -> Any:  # noqa: ANN401
    """Parse an integer as every option does; this also accepts a default, which Typer passes."""
    return integer(given) if isinstance(given, str) else given


class TypedLine:
    """The parsed values of one command line, which may belong to several commands.

    Parameters
    ----------
    context
        The context of the command.
    values
        The values of all parameters, by name.
    """

    def __init__(self, context: typer.Context, values: Mapping[str, Any]) -> None:
        self.context, self._values = context, values

    def __getitem__(self, name: str) -> Any:  # noqa: ANN401 - of any kind
        return self._values[name]

    def of(self, verb: type) -> dict[str, Any]:
        """Return the arguments of one command, for its function."""
        taken = (name for name, parameter in parameters_of(verb).items() if parameter.in_python)
        return {name: self._values[name] for name in taken if name in self._values}


def command_of(do: Callable[[TypedLine], None], *verbs: type) -> Callable[..., None]:
    """Make a command of the command line from the dataclasses of its arguments.

    If options of several verbs have the same name, the last verb's is used; positional arguments
    are those of the last verb.
    """
    taken = [parameters_of(verb) for verb in verbs]
    *_, last = taken
    names = {name for each in last.values() if each.is_typed for name in each.names}
    all_of = {n: each for verb in taken for n, each in verb.items() if each.is_typed}
    typed = [
        each
        for each in sorted(all_of.values(), key=lambda each: not each.option.is_argument)
        if each in last.values() or not (each.option.is_argument or names & {*each.names})
    ]
    absent = {name: each.default for name, each in all_of.items()}
    parts = [part for name, part in PARTS.items() if any(name in verb for verb in taken)]
    context = inspect.Parameter("context", _KEYWORD, annotation=typer.Context)
    signature = [context, *map(_taken, typed), *(each for part, _ in parts for each in part)]

    def command(context: typer.Context, **given: Any) -> None:  # noqa: ANN401
        values = absent | {each.name: _read(each, given[each.name]) for each in typed}
        if "target" in last:  # the script, and its own arguments
            values["target"], *values["arguments"] = values["target"] or [None]
        for _, made in parts:
            values |= made(given)
        do(TypedLine(context, values))

    command.__signature__ = inspect.Signature(signature)  # type: ignore[attr-defined]
    command.__name__, command.__doc__ = do.__name__, verbs[0].__doc__
    return command


_KEYWORD = inspect.Parameter.KEYWORD_ONLY
PARSERS = {float: a_number, int: an_integer}


def _taken(each: VerbParameter) -> inspect.Parameter:
    """Return a command's parameter as a Typer option."""
    option = each.option
    how: dict[str, Any] = {"help": option.help, "metavar": option.metavar or None}
    several = each.several or each.name == "target"
    default = each.default if option.default is ... else option.default
    kind = str if option.read else each.kind
    hint = list[kind] if several else kind  # type: ignore[valid-type]
    if each.kind is bool:
        default = False
    elif several and default is not MISSING:
        default = None
    if default is None:
        hint = hint | None
    info = (
        typer.Argument(**how)
        if option.is_argument
        else typer.Option(*each.names, parser=None if several else PARSERS.get(kind), **how)
    )
    default = inspect.Parameter.empty if default is MISSING else default
    return inspect.Parameter(each.name, _KEYWORD, default=default, annotation=Annotated[hint, info])


def _read(each: VerbParameter, given: Any) -> Any:  # noqa: ANN401
    """Convert a parsed option to the value of its field."""
    if each.is_inverse:
        return not given
    if each.option.read is not None:
        return each.option.read(given or [])
    return each.default if each.several and not given and each.default is not MISSING else given


# -- scenario and camera --------------------------------------------------------------------------


def _of_scenario(given: Typed) -> Typed:
    """Build the scenario and the camera from the given texts of their options."""
    scenario = Scenario.from_text(_dropped_here(_texts(Scenario.options(), given)))
    camera = Camera.from_text(_texts(Camera.options(), given))
    return {"scenario": scenario, "camera": None if given["no_camera"] else camera}


def _of_lists(given: Typed) -> Typed:
    """Collect value lists (texts by field name), and the camera, which is None unless given."""
    camera = Camera.from_text(_texts(Camera.options(), given))
    lists = _dropped_here(_texts(Scenario.options(), given))
    return {"lists": lists, "camera": camera if given["view"] else None}


def _parameters(options: Mapping[str, Option], panel: str) -> list[inspect.Parameter]:
    return [_parameter(name, spec.name, spec.help, panel, spec) for name, spec in options.items()]


def _parameter(
    name: str,
    option: str,
    help: str,  # noqa: A002 - typer's word
    panel: str,
    spec: Option | None = None,
) -> inspect.Parameter:
    """Return the Typer parameter of one option: a flag, unless the option takes a value."""
    if spec is None or spec.is_flag:
        flag = typer.Option(option, help=help, rich_help_panel=panel, show_default=False)
        annotation: Any = Annotated[bool, flag]
        absent: bool | None = False
    else:
        default = spec.left_to if spec.is_left else spec.default
        metavar = "|".join(spec.choices) or spec.kind.metavar
        if len(metavar) > LONGEST:
            metavar = "NAME"
        valued = typer.Option(
            option,
            help=f"{help} [default: {default}]",
            rich_help_panel=panel,
            show_default=False,
            metavar=metavar,
            autocompletion=lambda: spec.choices,
        )
        annotation, absent = Annotated[str | None, valued], None
    return inspect.Parameter(
        name, inspect.Parameter.KEYWORD_ONLY, default=absent, annotation=annotation
    )


def _dropped_here(texts: Texts) -> Texts:
    """Choose MuJoCo if PyBullet is not installed and the user chose no engine.

    Raises
    ------
    ScenarioError
        If PyBullet is asked for, and is not installed.
    """
    if is_installed(PYBULLET):
        return texts
    if texts["engine"] is None:
        note(Message("{why}: this is MuJoCo's fall; {next}", why=why_missing(), next=next_step()))
        return texts | {"engine": "mujoco"}
    if "bullet" in str(texts["engine"]).split(","):
        raise needs_pybullet("--engine bullet")
    return texts


def _texts(options: Mapping[str, Option], given: Typed) -> Texts:
    """Return the given texts of scenario options; a `--no-` flag switches its field off."""
    return {
        name: not given[name] if spec.is_flag else given[name] for name, spec in options.items()
    }


PARTS: dict[str, tuple[list[inspect.Parameter], Callable[[Typed], Typed]]] = {
    "scenario": (
        [
            *_parameters(Scenario.options(), "Scenario"),
            *_parameters(Camera.options(), "Camera"),
            _parameter("no_camera", "--no-camera", "Take no frames.", "Camera"),
        ],
        _of_scenario,
    ),
    "plan": (
        [
            *_parameters(Scenario.options(), "Scenario (each option takes a list)"),
            *_parameters(Camera.options(), "Camera (frames are taken if --camera is given)"),
        ],
        _of_lists,
    ),
}
"""Parameters that consist of several options, with the function that builds their value."""
