"""Reads the inputs of a recorded drop: scenario, engine report and camera."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from drop_physics.engine_report import EngineReport
from drop_physics.errors import ScenarioError
from drop_physics.messages import Message
from drop_physics.recording import schema
from drop_physics.recording.columns import Properties
from drop_physics.recording.damage import damaged
from drop_physics.scenario import Camera, Scenario


@dataclass(frozen=True)
class Drop:
    """The inputs of a recorded drop."""

    scenario: Scenario
    engine: EngineReport
    camera: Camera | None


def check_inputs(properties: Mapping[str, Properties], path: Path) -> None:
    """Check that a recording states its inputs: those of a drop, or those of a script."""
    if schema.ORIGIN_PROPERTY not in properties:
        for name in (schema.SCENARIO_PROPERTY, schema.ENGINE_PROPERTY):
            if name not in properties:
                raise damaged(path, Message("it lacks its {name} property", name=name))


def drop_of(properties: Mapping[str, Properties], path: Path) -> Drop:
    """Parse the inputs of a recorded drop.

    Raises
    ------
    RecordingError
        If this version of drop does not support these inputs.
    """
    camera = properties.get(schema.CAMERA_PROPERTY)
    try:
        return Drop(
            Scenario(**_with_tuples(properties[schema.SCENARIO_PROPERTY])),
            EngineReport.from_properties(properties[schema.ENGINE_PROPERTY]),
            None if camera is None else Camera(**_with_tuples(camera)),
        )
    except (TypeError, ScenarioError) as error:
        what = Message("its scenario, engine or camera is invalid ({error})", error=str(error))
        raise damaged(path, what) from None


def _with_tuples(values: Properties) -> Properties:
    return {key: tuple(each) if isinstance(each, list) else each for key, each in values.items()}
