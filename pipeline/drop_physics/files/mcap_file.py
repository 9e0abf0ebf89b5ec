"""Write MCAP files, for Foxglove and PlotJuggler: JSON messages, with a schema per topic.

Poses and joints use schemas that Foxglove defines (docs.foxglove.dev, "Message schemas"): frame
transforms and joint states.
"""

from __future__ import annotations

import contextlib
import importlib
import json
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from drop_physics.errors import DropError
from drop_physics.files.whole import written_whole

NANOSECONDS = 1_000_000_000
Write = Callable[[str, float, Any], None]
"""Function that writes a message, given its topic, time [s] and content."""


def _object(**properties: object) -> dict[str, object]:
    return {"type": "object", "properties": properties}


def _list(items: object) -> dict[str, object]:
    return {"type": "array", "items": items}


_NUMBER, _TEXT, _WHOLE = {"type": "number"}, {"type": "string"}, {"type": "integer"}
_TIME = _object(sec=_WHOLE, nsec=_WHOLE)
_VECTOR = _list(_NUMBER)
SCHEMAS = {
    "/tf": (
        "foxglove.FrameTransforms",
        _object(
            transforms=_list(
                _object(
                    timestamp=_TIME,
                    parent_frame_id=_TEXT,
                    child_frame_id=_TEXT,
                    translation=_object(x=_NUMBER, y=_NUMBER, z=_NUMBER),
                    rotation=_object(x=_NUMBER, y=_NUMBER, z=_NUMBER, w=_NUMBER),
                )
            )
        ),
    ),
    "/joint_states": (
        "foxglove.JointStates",
        _object(
            timestamp=_TIME,
            joints=_list(_object(name=_TEXT, position=_NUMBER, velocity=_NUMBER, effort=_NUMBER)),
        ),
    ),
    "/contacts": (
        "drop.Contacts",
        _object(
            timestamp=_TIME,
            contacts=_list(
                _object(
                    label_a=_TEXT,
                    body_a=_WHOLE,
                    link_a=_WHOLE,
                    label_b=_TEXT,
                    body_b=_WHOLE,
                    link_b=_WHOLE,
                    position_a_m=_VECTOR,
                    position_b_m=_VECTOR,
                    normal=_VECTOR,
                    distance_m=_NUMBER,
                    normal_force_n=_NUMBER,
                    friction_1_n=_NUMBER,
                    friction_1_direction=_VECTOR,
                    friction_2_n=_NUMBER,
                    friction_2_direction=_VECTOR,
                )
            ),
        ),
    ),
}
"""Name and content of the schema of each topic."""


def nanoseconds(time_s: float) -> int:
    """Convert a time to MCAP's nanoseconds; negative times become 0."""
    return max(0, round(time_s * NANOSECONDS))


def stamp(time_s: float) -> dict[str, int]:
    """Convert a time to the form in Foxglove's schemas."""
    seconds, rest = divmod(nanoseconds(time_s), NANOSECONDS)
    return {"sec": seconds, "nsec": rest}


@contextlib.contextmanager
def written_mcap(path: Path, *, force: bool) -> Iterator[Write]:
    """Yield a function that writes a message; the file gets its final name at the end.

    Raises
    ------
    DropError
        If the package mcap is not installed.
    OutputError
        For the reasons of `written_whole`.
    """
    try:
        writer_of = importlib.import_module("mcap.writer").Writer
    except ModuleNotFoundError:
        raise DropError("an .mcap needs the package mcap; try: pip install mcap") from None
    with written_whole(path, force=force) as file:
        writer, channels = writer_of(file), dict[str, int]()
        writer.start(profile="", library="drop")

        def write(topic: str, time_s: float, content: Any) -> None:  # noqa: ANN401 - JSON
            if topic not in channels:
                name, schema = SCHEMAS[topic]
                data = json.dumps({"title": name, **schema}).encode()
                number = writer.register_schema(name, "jsonschema", data)
                channels[topic] = writer.register_channel(topic, "json", number)
            at = nanoseconds(time_s)
            data = json.dumps(_finite(content), separators=(",", ":")).encode()
            writer.add_message(channels[topic], log_time=at, data=data, publish_time=at)

        yield write
        writer.finish()


def _finite(value: Any) -> Any:  # noqa: ANN401 - JSON
    """Replace nan and infinity, which JSON lacks, by null."""
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
