"""The pictures that the cameras of a script took."""

from __future__ import annotations

import re
from pathlib import Path

from drop_physics.messages import Message
from drop_physics.recording import columns
from drop_physics.recording.checks import damaged
from drop_physics.recording.columns import Properties
from drop_physics.recording.contents import chunks_of, closing_of, gather
from drop_physics.recording.digest import FrameDigest

_CAMERA = re.compile(r"camera/(\d{1,9})/image")


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
    digests = []
    for _, taken in sorted(frames.items()):
        digest = FrameDigest()
        for step, _, png in taken:
            digest.update(step, png)
        digests.append(digest.hexdigest())
    frames_sha256 = digests[0] if len(digests) == 1 else digests or None
    if closing is not None and closing.get("frames_sha256") != frames_sha256:
        raise damaged(path, Message("its frames fail their checksum"))
    return {camera: sorted(taken, key=lambda frame: frame[0]) for camera, taken in frames.items()}
