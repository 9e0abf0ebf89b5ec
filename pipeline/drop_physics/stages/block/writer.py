"""A process that writes recordings of `with` blocks: of one block, or of all in a pytest run."""

from __future__ import annotations

import os
import socket
import sys
import time
import uuid
from functools import partial
from importlib import metadata
from pathlib import Path
from typing import Any

from drop_physics.engines.script import BlockListener
from drop_physics.errors import NO_MEMORY, DropError
from drop_physics.recording import schema
from drop_physics.recording.recorder import Recorder
from drop_physics.stages.record import recorded_beside, recorded_of, written
from drop_physics.stages.record.target import target_of


def write(
    place: int, path: Path, process: int, drawn: bool, verified: bool, force: bool
) -> dict[str, Any]:
    """Write the recording of one block, as its data arrive; return the fields of the result.

    `place` is the file descriptor of a socket, through which the descriptors of the pipe and of the
    shared memory arrive; `process` is the process id of the block.
    """
    began = time.perf_counter()
    with socket.socket(fileno=os.dup(place)) as taking:
        _, (reading, memory), _, _ = socket.recv_fds(taking, 1, 2)
    recording_id = uuid.uuid4().hex
    origin = {
        "kind": "script",
        "script": schema.BLOCK,
        "drop_version": metadata.version("drop-physics"),
    }
    recorder = Recorder({schema.ORIGIN_PROPERTY: origin}, drawn=drawn)
    listener = BlockListener(reading, memory, process=process)
    listener.explains_with = sys.executable
    try:
        ended = written(
            listener,
            recorder,
            path,
            recording_id=recording_id,
            force=force,
            verified=verified,
            full=lambda: listener.stop("disk"),
        )
        placed = partial(target_of, schema.BLOCK, path, is_module=False, keep=False, force=force)
        beside = recorded_beside(listener, recorder, schema.BLOCK, placed)
    except MemoryError:
        raise DropError(NO_MEMORY) from None
    finally:
        listener.close()
        os.close(memory)
    recorded = recorded_of(recorder, ended, path, recording_id=recording_id, name=schema.BLOCK)
    return vars(recorded) | {
        "wall_s": time.perf_counter() - began,
        "beside": beside and beside.recorded,
    }
