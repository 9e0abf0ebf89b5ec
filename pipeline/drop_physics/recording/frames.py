"""The pictures in a recording, checked: of a drop's camera, and of those of a script."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from pathlib import Path

from drop_physics.messages import Message
from drop_physics.recording import columns, schema
from drop_physics.recording.checks import damaged
from drop_physics.recording.columns import Properties
from drop_physics.recording.contents import chunks_of, closing_of, gather
from drop_physics.recording.digest import FrameDigest

MOST_HELD = 4
"""Times a file's size, for its frames: PNG is already compressed, and equal ones are held once."""
FREELY_HELD = 1 << 26
"""Bytes of frames that any file may have."""
_CAMERA = re.compile(r"camera/(\d{1,9})/image")


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

    closing, pictures = closing_of(properties, path), dict(sorted(pictures.items()))
    if closing is not None:
        digest = _digest(pictures.items()) if pictures else None
        if closing.get("frames_sha256") != digest:
            raise damaged(path, Message("its frames fail their checksum"))
    yield from pictures.items()


def frames_of_cameras(path: Path) -> dict[int, list[tuple[int, float, bytes]]]:
    """Return the frames of the script's cameras, by camera: step, time [s] and PNG, in order.

    Raises
    ------
    RecordingError
        If the recording is damaged.
    """
    frames: dict[int, list[tuple[int, float, bytes]]] = {}
    properties: dict[str, Properties] = {}
    for chunk in chunks_of(path):
        camera = _CAMERA.fullmatch(chunk.entity)
        if camera is not None:
            images = zip(columns.images(chunk, path), columns.times_s(chunk).tolist(), strict=False)
            taken = [(step, time_s, png) for (step, png), time_s in images]
            frames.setdefault(int(camera[1]), []).extend(taken)
        elif chunk.entity.startswith("__properties/"):
            gather(properties, chunk, path)
    closing = closing_of(properties, path)
    digests = [
        _digest((step, png) for step, _, png in taken) for _, taken in sorted(frames.items())
    ]
    frames_sha256 = digests[0] if len(digests) == 1 else digests or None
    if closing is not None and closing.get("frames_sha256") != frames_sha256:
        raise damaged(path, Message("its frames fail their checksum"))
    return {camera: sorted(taken, key=lambda frame: frame[0]) for camera, taken in frames.items()}


def _digest(pictures: Iterable[tuple[int, bytes]]) -> str:
    digest = FrameDigest()
    for step, picture in pictures:
        digest.update(step, picture)
    return digest.hexdigest()
