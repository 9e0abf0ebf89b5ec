"""Serves replay requests over standard input and output, in length-prefixed messages (uint32)."""

from __future__ import annotations

import os
import sys

from ..frames import LENGTH
from .replay import Replay


def main() -> None:
    """Serve requests to replay and explain steps until the input ends."""
    answer(Replay())


def answer(replay: Replay) -> None:
    """Serve requests until the input ends."""
    requests = sys.stdin.buffer
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what MuJoCo prints must not get into the answer
    while len(head := requests.read(LENGTH.size)) == LENGTH.size:
        for answer in replay.take(requests.read(*LENGTH.unpack(head))):
            out.write(LENGTH.pack(len(answer)) + answer)
        out.flush()
