"""A stamp in a Parquet file: which sweep wrote it, under which name, and that no bit has changed.

It is a SHA-256 digest of the owner and of every byte but its own, so that a file is verified before
it is parsed. It is kept in the file's metadata: a program that rewrites the table omits it, or
copies one that no longer matches.
"""

from __future__ import annotations

import hashlib
import os
from typing import BinaryIO

from drop_physics.messages import Message

_PREFIX, _DIGITS = b"sha256:", 64
_LAST_BYTES = 1 << 16
"""The stamp is about 300 bytes before a file's end, beside 3 kB of schema that polars adds."""
_BLOCK_BYTES = 1 << 20

UNSTAMPED = {"drop": _PREFIX.decode() + "0" * _DIGITS}
"""The metadata of a file that is to be stamped."""


def stamp(file: BinaryIO, owner: str) -> None:
    """Write the digest into a finished file, which is open for reading and writing."""
    _, digest, position = _read(file, owner)
    file.seek(position)
    file.write(digest.encode())


def fault_of(file: BinaryIO, owner: str, *, most_bytes: int) -> Message | None:
    """Return what is wrong with a file, or None if it has its owner's stamp.

    A file of more than `most_bytes` is not read, because it may have any size.
    """
    if file.seek(0, os.SEEK_END) > most_bytes:
        return Message("it has over {bytes:,} bytes", bytes=most_bytes)
    stamped, digest, _ = _read(file, owner)
    if stamped == digest:
        return None
    if stamped:
        return Message("its stamp is that of other data or of another sweep")
    return Message("it has no stamp")


def _read(file: BinaryIO, owner: str) -> tuple[str, str, int]:
    """Return the stamp in the file, the right one, and its position in the file."""
    size = file.seek(0, os.SEEK_END)
    first = file.seek(max(0, size - _LAST_BYTES))
    last = file.read()
    prefix = last.rfind(_PREFIX)
    start = size if prefix < 0 else first + prefix + len(_PREFIX)
    end = start + _DIGITS
    stamped = last[start - first : end - first].decode("latin-1")
    digest = hashlib.sha256(owner.encode() + b"\0")
    for begin, stop in ((0, start), (end, size)):
        file.seek(begin)
        for position in range(begin, stop, _BLOCK_BYTES):
            digest.update(file.read(min(_BLOCK_BYTES, stop - position)))
    return stamped, digest.hexdigest(), start
