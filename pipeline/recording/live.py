"""Show a recording while it is made: each chunk goes to a viewer too, for as long as one listens.

A process of its own talks to the viewer, because a stream to one that hangs cannot be given up from
within: Rerun's client waits for it when the stream is closed, and when Python ends. So whoever
closes the viewer, or stops it, loses the picture and nothing else.
"""

from __future__ import annotations

import contextlib
import faulthandler
import os
import pickle
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator
from functools import partial

import pyarrow as pa
import rerun as rr
from rerun.chunk import Chunk

from pipeline.recording import schema
from pipeline.recording.blueprint import Look, layout

PATIENCE_S = 3.0
"""A viewer that takes nothing for so long is taken for gone."""
STARTS_WITHIN_S = 15.0
"""But one that has just been opened may be slow to answer for the first time."""


def shown(
    chunks: Iterable[Chunk],
    *,
    url: str,
    recording_id: str,
    look: Look,
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
    look
        What `layout` is to be told.
    note
        Told once, in a sentence, if the viewer goes away.
    """
    relay = _Relay()
    listens = relay.send((url, recording_id, look))
    try:
        for chunk in chunks:
            if listens and not relay.send(_packed(chunk)):
                listens = False
                note("the viewer has gone; the recording goes on without it")
            yield chunk
    finally:
        if not relay.ended_well() and listens:
            note("the viewer has gone before it was shown everything")


class _Relay:
    """The process that talks to the viewer, fed through its pipe."""

    def __init__(self) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", "pipeline.recording.live"],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
            start_new_session=True,  # whoever interrupts us has not closed the viewer
        )

    def send(self, message: object) -> bool:
        """Pass something on, and return whether there still is a viewer."""
        assert self._process.stdin is not None
        try:
            pickle.dump(message, self._process.stdin)
            self._process.stdin.flush()
        except BrokenPipeError:
            return False
        return True

    def ended_well(self) -> bool:
        """Wait until all has been shown, but not for ever, and return whether it was."""
        try:
            self._process.communicate(timeout=STARTS_WITHIN_S + 2 * PATIENCE_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.communicate()
        return self._process.returncode == 0


def _packed(chunk: Chunk) -> bytes:
    # As Arrow's own stream: a pickled batch forgets which of its values cannot be null.
    batch, sink = chunk.to_record_batch(), pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, batch.schema) as stream:
        stream.write_batch(batch)
    packed: bytes = sink.getvalue().to_pybytes()
    return packed


def _work() -> None:
    """Send what comes through standard input to a viewer, until it ends or the viewer does."""
    url, recording_id, look = pickle.load(sys.stdin.buffer)
    stream = rr.RecordingStream(
        schema.APPLICATION_ID, recording_id=recording_id, send_properties=False
    )

    def connect() -> None:
        stream.connect_grpc(url)
        stream.send_blueprint(layout(**look))
        stream.flush(timeout_sec=STARTS_WITHIN_S)

    _impatiently(connect, patience_s=STARTS_WITHIN_S)
    with contextlib.suppress(EOFError):
        while True:
            (batch,) = pa.ipc.open_stream(pickle.load(sys.stdin.buffer))
            _impatiently(partial(stream.send_chunks, Chunk.from_record_batch(batch)))
            _impatiently(lambda: stream.flush(timeout_sec=PATIENCE_S))
    _impatiently(stream.disconnect)
    os._exit(0)  # whatever Python would still do for the stream at its end, it does not wait for


def _impatiently(act: Callable[[], None], *, patience_s: float = PATIENCE_S) -> None:
    """Act, but end the process where that takes too long or fails."""
    # A thread of C ends it, which needs nothing from Python's lock.
    faulthandler.dump_traceback_later(patience_s, exit=True, file=sys.stderr)
    try:
        act()
    except (RuntimeError, ValueError, ConnectionError):
        os._exit(1)
    faulthandler.cancel_dump_traceback_later()


if __name__ == "__main__":
    _work()
