"""Scenario and camera as command-line options, the same wherever a scenario is taken."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Annotated, Any

import typer

from pipeline.fields import Option
from pipeline.scenario import Camera, Scenario


def takes_scenario(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command the options of `Scenario` and `Camera`.

    The command is called with `scenario: Scenario` and `camera: Camera | None` in their place, and
    with its own parameters as they are.
    """
    own = inspect.signature(command, eval_str=True)
    kept = [one for one in own.parameters.values() if one.name not in ("scenario", "camera")]
    grafted = _parameters(Scenario.options(), "Scenario")
    photographed = _parameters(Camera.options(), "Camera")
    no_camera = _parameter("no_camera", bool, False, "--no-camera", "Take no frames.", "Camera")

    def with_scenario(**given: Any) -> None:  # noqa: ANN401
        mine = {one.name: given[one.name] for one in kept}
        scenario = Scenario.from_text(_given(Scenario.options(), given))
        camera = Camera.from_text(_given(Camera.options(), given))
        command(**mine, scenario=scenario, camera=None if given["no_camera"] else camera)

    with_scenario.__signature__ = own.replace(  # type: ignore[attr-defined]
        parameters=[*kept, *grafted, *photographed, no_camera]
    )
    with_scenario.__name__, with_scenario.__doc__ = command.__name__, command.__doc__
    return with_scenario


def _parameters(options: dict[str, Option], panel: str) -> list[inspect.Parameter]:
    return [
        _parameter(name, bool, False, spec.name, spec.help, panel)
        if spec.is_flag
        else _parameter(name, str | None, None, spec.name, spec.help, panel, spec.default)
        for name, spec in options.items()
    ]


def _parameter(
    name: str,
    kind: Any,  # noqa: ANN401
    default: object,
    option: str,
    help: str,  # noqa: A002
    panel: str,
    shown: str | bool = False,
) -> inspect.Parameter:
    declared = typer.Option(
        option, help=help, rich_help_panel=panel, show_default=shown, metavar=None
    )
    return inspect.Parameter(
        name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=Annotated[kind, declared]
    )


def _given(options: dict[str, Option], values: dict[str, Any]) -> dict[str, str | bool | None]:
    """Return the values of these options; a `--no-` flag that was given switches its field off."""
    return {
        name: not values[name] if spec.is_flag else values[name] for name, spec in options.items()
    }
