"""The pictures in a recording, checked: of a drop's camera, and of those of a script."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

from drop_physics.fields import counted
from drop_physics.messages import Message
from drop_physics.recording import columns, schema
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
_CAMERA = re.compile(r"camera/(\d{1,9})/image")
SIGNATURE = b"\x89PNG\r\n\x1a\n"
_OURS = re.compile(rb"IHDR(PLTE)?(IDAT)+IEND")
"""The parts of our PNGs."""


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
        if camera is None or _size_px(picture) != camera.size_px:
            what = Message("its frame at step {step} is not a PNG of the camera's size", step=step)
            raise damaged(path, what)
    if closing is None:
        return
    if (closing.get("frames"), closing.get("frames_sha256")) != (
        len(due),
        _digest(pictures.items()) if pictures else None,
    ):
        raise damaged(path, Message("its frames fail their checksum"))


def _size_px(png: bytes) -> tuple[int, int] | None:
    """Return width and height of a PNG with the structure of ours; None of anything else.

    That is a header, perhaps a palette, the pixels and the end: no second header with another size,
    no text or profile that unpacks to more than the picture. Source: www.w3.org/TR/png-3, section
    5.
    """
    position, kinds = len(SIGNATURE), bytearray()
    if not png.startswith(SIGNATURE):
        return None
    while position < len(png):
        kinds += png[position + 4 : position + 8]
        position += 12 + int.from_bytes(png[position : position + 4])
    if position != len(png) or not _OURS.fullmatch(kinds):
        return None
    return int.from_bytes(png[16:20]), int.from_bytes(png[20:24])


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
