"""Scenario and camera as command-line options, the same for every command that takes a scenario."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from typing import Annotated, Any

import typer

from drop_physics.console.output import note
from drop_physics.fields import Option
from drop_physics.installed import PYBULLET, is_installed, needs_pybullet, next_step, why_missing
from drop_physics.messages import Message
from drop_physics.option_types import integer, number
from drop_physics.scenario import Camera, Scenario

Texts = dict[str, str | bool | None]
"""The values of options by field, as typed."""
Given = Mapping[str, Any]
"""The values given on the command line, by parameter name."""
LONGEST = 40
"""Characters that the choices of an option may take in its help, on a terminal of 50 columns."""


def a_number(given: Any) -> Any:  # noqa: ANN401
    """Parse a number as every option does; Typer passes a default through, too."""
    return number(given) if isinstance(given, str) else given


def an_integer(given: Any) -> Any:  # noqa: ANN401
    """Parse a whole number as every option does; Typer passes a default through, too."""
    return integer(given) if isinstance(given, str) else given


def takes_scenario(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command the options of `Scenario` and `Camera`.

    The command is called with `scenario: Scenario` and `camera: Camera | None` in their place; its
    own parameters are kept.
    """
    no_camera = _parameter("no_camera", "--no-camera", "Take no frames.", "Camera")
    options = [
        *_parameters(Scenario.options(), "Scenario"),
        *_parameters(Camera.options(), "Camera"),
        no_camera,
    ]

    def inputs(given: Given) -> Given:
        scenario = Scenario.from_text(_dropped_here(_texts(Scenario.options(), given)))
        camera = Camera.from_text(_texts(Camera.options(), given))
        return {"scenario": scenario, "camera": None if given["no_camera"] else camera}

    return _grafted(command, options, inputs, instead_of=("scenario", "camera"))


def takes_scenario_lists(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command the options of `Scenario`, each of which takes a list, and of `Camera`.

    The command is called with `lists`, the given texts by field name, and with
    `camera: Camera | None`, which is None unless `--camera` is given.
    """
    options = [
        *_parameters(Scenario.options(), "Scenario (each option takes a list)"),
        *_parameters(Camera.options(), "Camera (frames are taken if --camera is given)"),
    ]

    def inputs(given: Given) -> Given:
        camera = Camera.from_text(_texts(Camera.options(), given))
        lists = _dropped_here(_texts(Scenario.options(), given))
        return {"lists": lists, "camera": camera if given["view"] else None}

    return _grafted(command, options, inputs, instead_of=("lists", "camera"))


def takes_options_of(*verbs: Callable[..., None]) -> Callable[..., Callable[..., None]]:
    """Give a command the options of other verbs; of equal names those of the last verb.

    The command is called with the values for a verb as `of_VERB`, by parameter name.
    """
    of_verb = {
        verb.__name__: [
            own
            for own in inspect.signature(verb, eval_str=True).parameters.values()
            if own.kind is inspect.Parameter.KEYWORD_ONLY
        ]
        for verb in verbs
    }
    options = {own.name: own for owns in of_verb.values() for own in owns}

    def inputs(given: Given) -> Given:
        return {
            f"of_{verb}": {own.name: given[own.name] for own in owns}
            for verb, owns in of_verb.items()
        }

    def taking(command: Callable[..., None]) -> Callable[..., None]:
        instead = tuple(f"of_{verb}" for verb in of_verb)
        return _grafted(command, [*options.values()], inputs, instead_of=instead)

    return taking


def _grafted(
    command: Callable[..., None],
    options: list[inspect.Parameter],
    inputs: Callable[[Given], Given],
    *,
    instead_of: tuple[str, ...],
) -> Callable[..., None]:
    """Return a command with options in place of the parameters that are made from them."""
    signature = inspect.signature(command, eval_str=True)
    kept = [own for own in signature.parameters.values() if own.name not in instead_of]

    def grafted(**given: Any) -> None:  # noqa: ANN401
        command(**{own.name: given[own.name] for own in kept}, **inputs(given))

    signature = signature.replace(parameters=[*kept, *options])
    grafted.__signature__ = signature  # type: ignore[attr-defined]
    grafted.__name__, grafted.__doc__ = command.__name__, command.__doc__
    return grafted


def _parameters(options: Mapping[str, Option], panel: str) -> list[inspect.Parameter]:
    return [_parameter(name, spec.name, spec.help, panel, spec) for name, spec in options.items()]


def _parameter(
    name: str,
    option: str,
    help: str,  # noqa: A002 - typer's word
    panel: str,
    spec: Option | None = None,
) -> inspect.Parameter:
    """Return one option: a flag unless it takes a value."""
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
    """Return the values for an engine that is installed: MuJoCo where PyBullet is not.

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


def _texts(options: Mapping[str, Option], given: Given) -> Texts:
    """Return the values of these options; a `--no-` flag that is given switches its field off."""
    return {
        name: not given[name] if spec.is_flag else given[name] for name, spec in options.items()
    }
