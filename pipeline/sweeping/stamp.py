"""A stamp in a Parquet file: who wrote it, under which name, and that no bit changed since.

It is a SHA-256 digest of the owner and of every byte but its own, so that a file is vouched for
before it is parsed. It stands in the file's metadata: a program that writes the table anew leaves
it out, or leaves one that is wrong.
"""

from __future__ import annotations

import hashlib
import os
from typing import BinaryIO

_PREFIX, _DIGITS = b"sha256:", 64
_LAST_BYTES = 1 << 16
"""The stamp stands some 300 bytes before a file's end, beside 3 kB of schema that polars adds."""
_BLOCK_BYTES = 1 << 20

UNSTAMPED = {"drop": _PREFIX.decode() + "0" * _DIGITS}
"""The metadata that a file to be stamped is written with."""


def stamp(file: BinaryIO, owner: str) -> None:
    """Put the digest into a whole file, which is open for reading and writing."""
    _, digest, place = _read(file, owner)
    file.seek(place)
    file.write(digest.encode())


def fault_of(file: BinaryIO, owner: str, *, most_bytes: int) -> str | None:
    """Return what a file has instead of its owner's stamp, or None where it has that.

    One of more bytes than its owner writes is not read: it may be of any size.
    """
    if file.seek(0, os.SEEK_END) > most_bytes:
        return f"over {most_bytes:,} bytes"
    told, digest, _ = _read(file, owner)
    if told == digest:
        return None
    return "one of other bytes or of another sweep" if told else "none"


def _read(file: BinaryIO, owner: str) -> tuple[str, str, int]:
    """Return the stamp that is there, the right one, and where it belongs in the file."""
    size = file.seek(0, os.SEEK_END)
    first = file.seek(max(0, size - _LAST_BYTES))
    last = file.read()
    found = last.rfind(_PREFIX)
    start = size if found < 0 else first + found + len(_PREFIX)
    end = start + _DIGITS
    told = last[start - first : end - first].decode("latin-1")
    digest = hashlib.sha256(owner.encode() + b"\0")
    for begin, stop in ((0, start), (end, size)):
        file.seek(begin)
        for position in range(begin, stop, _BLOCK_BYTES):
            digest.update(file.read(min(_BLOCK_BYTES, stop - position)))
    return told, digest.hexdigest(), start
