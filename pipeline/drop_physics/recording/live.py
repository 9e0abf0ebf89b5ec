"""Shows a recording while it is made, by also sending its chunks to a running viewer.

A separate process talks to the viewer, because Rerun's client waits for a viewer that hangs when a
stream is closed and when Python ends. A viewer that is closed or hangs therefore does not affect
the recording.
"""

from __future__ import annotations

import faulthandler
import functools
import os
import sys
from collections.abc import Callable, Iterable, Iterator
from typing import Any

import pyarrow as pa
import rerun as rr
from rerun.chunk import Chunk

from drop_physics.messages import Message
from drop_physics.recording import schema
from drop_physics.recording.layout import Look, layout
from drop_physics.workers import Worker, WorkerDiedError, under_load

PATIENCE_S = 3.0
"""Time after which a viewer that accepts no data counts as closed [s]."""
STARTS_WITHIN_S = 15.0
"""Longest wait for a viewer to start [s]."""


def shown(
    chunks: Iterable[Chunk],
    *,
    url: str,
    recording_id: str,
    look: Look,
    note: Callable[[str], None],
) -> Iterator[Chunk]:
    """Yield chunks unchanged, after sending each to a viewer.

    Parameters
    ----------
    chunks
        All chunks of a recording.
    url
        The address at which the viewer listens.
    recording_id
        The recording's id.
    look
        The properties of the recording that determine the viewer's layout.
    note
        A function that is called with a sentence, once, if the viewer is closed.
    """
    with Worker() as relay:
        relay.ask(f"{__name__}:_connect", recording_id, url, look)
        listens = True
        for chunk in chunks:
            if listens and not _passed_on(relay, f"{__name__}:_show", recording_id, _packed(chunk)):
                listens = False
                note(Message("the viewer does not respond; the recording continues without it"))
            yield chunk
        if listens and not (
            _passed_on(relay, f"{__name__}:_disconnect", recording_id) and _passed_on(relay)
        ):
            note(Message("the viewer stopped responding before it had shown everything"))


def _passed_on(relay: Worker, *request: Any) -> bool:  # noqa: ANN401
    """Send a chunk after the viewer has accepted the last one; return whether it still responds."""
    try:
        relay.answer()
        if request:
            relay.ask(*request)
    except WorkerDiedError:
        return False
    return True


def _packed(chunk: Chunk) -> bytes:
    # As an Arrow stream: a pickled batch forgets which of its values cannot be null.
    batch, sink = chunk.to_record_batch(), pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, batch.schema) as stream:
        stream.write_batch(batch)
    packed: bytes = sink.getvalue().to_pybytes()
    return packed


# -- in the process that talks to the viewer ------------------------------------------------------


@functools.cache
def _stream(recording_id: str) -> rr.RecordingStream:
    return rr.RecordingStream(
        schema.APPLICATION_ID, recording_id=recording_id, send_properties=False
    )


def _connect(recording_id: str, url: str, look: Look) -> None:
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # Rerun logs a lot about a viewer that goes away
    stream = _stream(recording_id)

    def connect() -> None:
        stream.connect_grpc(url)
        stream.send_blueprint(layout(look))
        stream.flush(timeout_sec=under_load(STARTS_WITHIN_S))

    _impatiently(connect, patience_s=STARTS_WITHIN_S)


def _show(recording_id: str, packed: bytes) -> None:
    stream = _stream(recording_id)

    def show() -> None:
        (batch,) = pa.ipc.open_stream(packed)
        stream.send_chunks(Chunk.from_record_batch(batch))

    _impatiently(show)
    _impatiently(lambda: stream.flush(timeout_sec=under_load(PATIENCE_S)))


def _disconnect(recording_id: str) -> None:
    _impatiently(_stream(recording_id).disconnect)


def _impatiently(act: Callable[[], None], *, patience_s: float = PATIENCE_S) -> None:
    """Call a function; end this process if it fails or takes too long."""
    # A C thread ends it, without needing Python's lock.
    faulthandler.dump_traceback_later(under_load(patience_s), exit=True, file=sys.stderr)
    try:
        act()
    except Exception:  # noqa: BLE001 - any failure loses only the picture
        os._exit(1)
    faulthandler.cancel_dump_traceback_later()
