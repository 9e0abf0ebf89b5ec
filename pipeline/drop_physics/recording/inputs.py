"""What a recording says was run: its properties, as scenario, engine and camera."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from drop_physics.errors import RecordingError, ScenarioError
from drop_physics.fields import shown
from drop_physics.messages import Message
from drop_physics.recording import schema
from drop_physics.recording.checks import check_camera, damaged
from drop_physics.recording.columns import Properties
from drop_physics.report import EngineReport
from drop_physics.scenario import Camera, Scenario

T = TypeVar("T")


@dataclass(frozen=True)
class Drop:
    """What the recording of a drop holds besides."""

    scenario: Scenario
    engine: EngineReport
    camera: Camera | None


def check_inputs(properties: Mapping[str, Properties], path: Path) -> None:
    """Check that a recording says what was recorded."""
    if schema.ORIGIN_PROPERTY not in properties:
        for name in (schema.SCENARIO_PROPERTY, schema.ENGINE_PROPERTY):
            if name not in properties:
                raise damaged(path, Message("it lacks its {name} property", name=name))


def drop_of(properties: Mapping[str, Properties], path: Path) -> Drop:
    """Return what was dropped, checked."""
    scenario, camera = inputs_of(properties, path)
    return Drop(scenario, _engine(properties[schema.ENGINE_PROPERTY], path), camera)


def inputs_of(properties: Mapping[str, Properties], path: Path) -> tuple[Scenario, Camera | None]:
    """Return scenario and camera, checked."""
    camera = properties.get(schema.CAMERA_PROPERTY)
    try:
        scenario = _dataclass(Scenario, properties[schema.SCENARIO_PROPERTY])
        if camera is None:
            return scenario, None
        taken = _dataclass(Camera, camera)
    except (TypeError, ScenarioError) as error:
        what = Message("its scenario or camera is invalid ({error})", error=str(error))
        raise damaged(path, what) from None
    check_camera(taken, path)
    return scenario, taken


def _engine(values: Properties, path: Path) -> EngineReport:
    try:
        return EngineReport.from_properties(values)
    except RecordingError as error:
        raise damaged(path, error.in_options) from None


def _dataclass(kind: type[T], values: Mapping[str, Any]) -> T:
    """Return the dataclass that a property holds; an unknown name is a ScenarioError."""
    unknown = values.keys() - {f.name for f in dataclasses.fields(kind)}  # type: ignore[arg-type]
    if unknown:
        raise ScenarioError("this drop does not know {name}", name=shown(min(unknown)))
    return kind(**{key: tuple(v) if isinstance(v, list) else v for key, v in values.items()})
