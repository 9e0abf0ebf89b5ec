"""The frames of a drop's camera, checked."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from pathlib import Path

from drop_physics.fields import counted
from drop_physics.messages import Message
from drop_physics.recording import columns, png, schema
from drop_physics.recording.checks import damaged
from drop_physics.recording.columns import Properties
from drop_physics.recording.contents import chunks_of, closing_of, gather
from drop_physics.recording.digest import FrameDigest
from drop_physics.recording.inputs import inputs_of
from drop_physics.scenario import Camera, Scenario

MOST_HELD = 4
"""Times a file's size, for its frames: PNG is already compressed, and equal ones are held once."""
FREELY_HELD = 1 << 26
"""Bytes of frames that any file may have."""


def frames(path: Path) -> Iterator[tuple[int, bytes]]:
    """Yield the camera frames of a recording in step order: step and PNG.

    Raises
    ------
    RecordingError
        If the recording is missing or damaged.
    """
    pictures: dict[int, bytes] = {}
    properties: dict[str, Properties] = {}
    held, last = 0, b""
    for chunk in chunks_of(path):
        if chunk.entity == schema.IMAGE:
            for step, picture in columns.images(chunk, path):
                if pictures.get(step, picture) != picture:
                    raise damaged(path, Message("it has two frames of step {step}", step=step))
                if picture != last:
                    held, last = held + len(picture), picture
                if held > FREELY_HELD + MOST_HELD * path.stat().st_size:
                    raise damaged(path, Message("its frames take over {size:,} bytes", size=held))
                pictures[step] = last
        elif chunk.entity.startswith("__properties/"):
            gather(properties, chunk, path)

    closing, (scenario, camera) = closing_of(properties, path), inputs_of(properties, path)
    pictures = dict(sorted(pictures.items()))
    _check_frames(pictures, scenario, camera, closing, path)
    yield from pictures.items()


def _check_frames(
    pictures: Mapping[int, bytes],
    scenario: Scenario,
    camera: Camera | None,
    closing: Properties | None,
    path: Path,
) -> None:
    """Check that the frames are those that the camera takes; an unfinished recording has fewer."""
    due = range(0, scenario.steps + 1, camera.capture_every) if camera else range(0)
    expected = due if closing is not None else due[: len(pictures)]
    if list(pictures) != list(itertools.islice(expected, len(pictures) + 1)):
        what = Message(
            "it must hold {frames}, got {count:,}",
            frames=counted(len(due), "frame"),
            count=len(pictures),
        )
        raise damaged(path, what)
    for step, picture in pictures.items():
        # A decoder allocates what the header claims.
        if camera is None or png.size_px(picture) != camera.size_px:
            what = Message("its frame at step {step} is not a PNG of the camera's size", step=step)
            raise damaged(path, what)
    if closing is None:
        return
    digest = FrameDigest()
    for step, picture in pictures.items():
        digest.update(step, picture)
    if (closing.get("frames"), closing.get("frames_sha256")) != (
        len(due),
        digest.hexdigest() if pictures else None,
    ):
        raise damaged(path, Message("its frames fail their checksum"))
