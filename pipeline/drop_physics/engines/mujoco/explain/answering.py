"""Replay and explain a stream: what `main` is given the path of is answered on standard output.

That file has payloads (`frames`), each after its length (uint32); so has the answer.
"""

from __future__ import annotations

import os
import struct

from .replay import Replay

LENGTH = struct.Struct("<I")


def main(path: str) -> None:
    """Answer the request in a file that holds a stream."""
    replay = Replay()
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what MuJoCo prints must not get into the answer
    with open(path, "rb") as spool:
        while True:
            head = spool.read(LENGTH.size)
            if len(head) < LENGTH.size:
                break
            payload = spool.read(*LENGTH.unpack(head))
            for answer in replay.take(payload):
                out.write(LENGTH.pack(len(answer)) + answer)
    for answer in replay.rest():
        out.write(LENGTH.pack(len(answer)) + answer)
    out.flush()
