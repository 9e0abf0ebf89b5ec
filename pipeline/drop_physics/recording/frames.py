"""Reads and checks the images in a recording, from a drop's camera or a script's."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator

from drop_physics.messages import Message
from drop_physics.recording import columns, schema
from drop_physics.recording.damage import damaged
from drop_physics.recording.digest import FrameDigest
from drop_physics.recording.reader import Recording

MOST_HELD = 4
"""Largest total size of frames, as a multiple of the file's size: PNG is compressed already, and
equal frames are stored once."""
FREELY_HELD = 1 << 26
"""Total size of frames that is accepted in any file [bytes]."""
_CAMERA = re.compile(r"camera/(\d{1,9})/image")


def frames(recording: Recording) -> Iterator[tuple[int, bytes]]:
    """Yield the camera frames of a drop in step order, as step and PNG.

    Raises
    ------
    RecordingError
        If the frames are damaged.
    """
    path, sampled = recording.path, recording.sampled
    pictures: dict[int, bytes] = {}
    held, last = 0, b""
    for chunk in sampled.chunks_at(sampled.pictures.get(schema.IMAGE, ())):
        for step, picture in columns.images(chunk, path):
            if pictures.get(step, picture) != picture:
                raise damaged(path, Message("it has two frames of step {step}", step=step))
            if picture != last:
                held, last = held + len(picture), picture
            if held > FREELY_HELD + MOST_HELD * path.stat().st_size:
                raise damaged(path, Message("its frames take over {size:,} bytes", size=held))
            pictures[step] = last
    pictures = dict(sorted(pictures.items()))
    _check(recording, _digest(pictures.items()) if pictures else None)
    yield from pictures.items()


def frames_of_cameras(recording: Recording) -> dict[int, list[tuple[int, float, bytes]]]:
    """Return the frames of the script's cameras, by camera: step, time [s] and PNG, in order.

    Raises
    ------
    RecordingError
        If the frames are damaged.
    """
    frames: dict[int, list[tuple[int, float, bytes]]] = {}
    for entity, positions in recording.sampled.pictures.items():
        if camera := _CAMERA.fullmatch(entity):
            taken = frames.setdefault(int(camera[1]), [])
            for chunk in recording.sampled.chunks_at(positions):
                times_s = columns.times_s(chunk).tolist()
                images = zip(columns.images(chunk, recording.path), times_s, strict=False)
                taken += [(step, time_s, png) for (step, png), time_s in images]
    digests = [
        _digest((step, png) for step, _, png in taken) for _, taken in sorted(frames.items())
    ]
    _check(recording, digests[0] if len(digests) == 1 else digests or None)
    return {camera: sorted(taken, key=lambda frame: frame[0]) for camera, taken in frames.items()}


def _check(recording: Recording, digest: str | list[str] | None) -> None:
    if recording.ended is not None and recording.ended.get("frames_sha256") != digest:
        raise damaged(recording.path, Message("its frames fail their checksum"))


def _digest(pictures: Iterable[tuple[int, bytes]]) -> str:
    digest = FrameDigest()
    for step, picture in pictures:
        digest.update(step, picture)
    return digest.hexdigest()
