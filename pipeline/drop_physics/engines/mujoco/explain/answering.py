"""Answers requests from standard input on standard output, each preceded by its length (uint32)."""

from __future__ import annotations

import os
import sys

from ..frames import LENGTH
from .replay import Replay


def main() -> None:
    """Replay and explain steps until there are no more requests."""
    answer(Replay())


def answer(replay: Replay) -> None:
    """Answer requests until there are no more."""
    requests = sys.stdin.buffer
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what MuJoCo prints must not get into the answer
    while len(head := requests.read(LENGTH.size)) == LENGTH.size:
        for answer in replay.take(requests.read(*LENGTH.unpack(head))):
            out.write(LENGTH.pack(len(answer)) + answer)
        out.flush()
