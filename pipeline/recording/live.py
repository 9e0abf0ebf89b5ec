"""Show a recording while it is made: each chunk goes to a viewer too, for as long as one listens.

The file never waits for the viewer but for a moment: whoever closes it, or stops it, loses the
picture and nothing else.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator

import rerun as rr
import rerun.blueprint as rrb
from rerun.chunk import Chunk

from pipeline.recording import schema

FLUSH_EVERY_S = 0.1
PATIENCE_S = 2.0
"""A viewer that takes nothing for so long is taken for gone."""


def shown(
    chunks: Iterable[Chunk],
    *,
    url: str,
    recording_id: str,
    blueprint: rrb.Blueprint,
    note: Callable[[str], None],
) -> Iterator[Chunk]:
    """Yield chunks on, each after it was sent to a viewer.

    Parameters
    ----------
    chunks
        A whole recording.
    url
        Where the viewer listens.
    recording_id
        The recording's id.
    blueprint
        The viewer's layout.
    note
        Told once, in a sentence, if the viewer goes away.
    """
    stream = rr.RecordingStream(
        schema.APPLICATION_ID, recording_id=recording_id, send_properties=False
    )
    listening, flushed = True, time.monotonic()

    def try_to(send: Callable[[], None]) -> bool:
        try:
            send()
        except (RuntimeError, ValueError):
            note("the viewer has gone; the recording goes on without it")
            return False
        return True

    def connect() -> None:
        stream.connect_grpc(url)
        stream.send_blueprint(blueprint)
        stream.flush(timeout_sec=PATIENCE_S)

    listening = try_to(connect)
    for chunk in chunks:
        if listening:
            stream.send_chunks(chunk)
            if time.monotonic() - flushed > FLUSH_EVERY_S:
                listening = try_to(lambda: stream.flush(timeout_sec=PATIENCE_S))
                flushed = time.monotonic()
        yield chunk
    if listening:
        try_to(lambda: stream.flush(timeout_sec=PATIENCE_S))
