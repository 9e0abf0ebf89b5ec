"""Parses Rerun's file format, safely even if the file is damaged.

Rerun's own reader trusts a file: a wrong bit can make it abort the whole process, or allocate any
amount of memory, and it rejects a file that ends within a message. This reader checks each length
against the file's size before using it, limits the unpacked size in proportion to the file's size,
and reads a message's content with Arrow's C++ reader, which is made for untrusted input.

    "RRF2", version, options                                            12 bytes
    kind u64, length u64, a protobuf message                            repeated
    offset u64, length u64 and checksum u32 of the footer, "RRF2FOOT", 1 u32

The footer is the last message. Sources: rerun 0.41, `re_log_encoding/src/rrd/` (frames) and
`re_protos/proto/rerun/v1alpha1/log_msg.proto` (messages); apache/arrow, `format/Message.fbs` (what
a message holds: a schema and one batch of rows).
"""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple

import pyarrow as pa

from drop_physics.messages import Message

FOOTER, STORE, CHUNK, ACTIVATION = range(4)
"""Message types in a Rerun file."""
RECORDING_STORE = 1
"""Store kind of recordings; the other kind is a blueprint."""
UNCOMPRESSED, LZ4 = 1, 2
LZ4_RATIO = 255
"""Maximum compression ratio of an LZ4 block."""
LARGEST_CHUNK = 1 << 27
"""Largest size of a chunk [bytes]; drop writes about a hundred kilobytes, and Rerun's tools merge
chunks to a few megabytes."""
LARGEST_HEADER = 1 << 16
"""Largest size of a chunk's schema [bytes]; drop writes up to ten thousand."""
LONGEST_NAME = 4096
"""Largest number of characters of an entity's name or of an id."""
MOST_FIELDS = 64
"""Largest number of fields in a protobuf message; drop writes up to ten."""
RECORD_BATCH = 3
"""Arrow's message type for a batch of rows."""
LEAST_ROW_BYTES = 10
"""Smallest number of bytes per row in a file, since id and time never repeat; a body at rest takes
12."""
LEAST_MESSAGE_BYTES = 512
"""Smallest average number of bytes per chunk; a chunk with a single number takes a thousand."""
MOST_UNPACKED = 32
"""Largest unpacked size, as a multiple of the file's size; states of a body at rest unpack to 4
times their size, equal frames to 24 times."""
FREELY_UNPACKED = 1 << 26
"""Unpacked size that is accepted for any file [bytes]."""

_START = struct.Struct("<4s8s")
_HEAD = struct.Struct("<QQ")
_TRAILER = struct.Struct("<QQI8sI")


class DamagedError(Exception):
    """Raised for a file that is not a complete Rerun file; `what` describes the problem."""

    def __init__(self, what: Message) -> None:
        super().__init__(what)
        self.what = what


class UnfinishedError(DamagedError):
    """Raised for a file that begins like a Rerun file, but is cut off."""


class Chunk(NamedTuple):
    """Rows of one entity, and the id of their recording."""

    application_id: str
    recording_id: str
    entity: str
    batch: pa.RecordBatch
    """Columns, named as in Rerun's `Chunk.to_record_batch`."""
    size: int
    """Unpacked size [bytes]."""
    position: int
    """Position of the chunk's message in the file."""


def chunks(path: Path, *, unfinished: bool = False) -> Iterator[Chunk]:
    """Yield the chunks of the recordings in a file, in the order of writing.

    Parameters
    ----------
    path
        The path of the file.
    unfinished
        Whether the file may be cut off at any point; its complete chunks are then yielded.

    Raises
    ------
    DamagedError
        If the file is not a Rerun file or not finished, or a chunk cannot be decoded.
    """
    unpacked = 0
    with path.open("rb") as file:
        most = FREELY_UNPACKED + MOST_UNPACKED * os.fstat(file.fileno()).st_size
        for kind, message, position in _messages(file, unfinished=unfinished):
            if kind != CHUNK or (chunk := _chunk(message, position)) is None:
                continue
            unpacked += chunk.size
            if unpacked > most:
                raise DamagedError(
                    Message("it unpacks to over {most} times its size", most=MOST_UNPACKED)
                )
            yield chunk


def chunk_at(file: BinaryIO, position: int) -> Chunk:
    """Return the chunk whose message begins at a position of an open file.

    Raises
    ------
    DamagedError
        If the file has changed since the position was determined.
    """
    file.seek(position)
    kind, length = _HEAD.unpack(_exactly(file, _HEAD.size))
    changed = DamagedError(Message("it changed while it was read"))
    if kind != CHUNK or length > LARGEST_CHUNK:
        raise changed
    chunk = _chunk(memoryview(_exactly(file, length)), position)
    if chunk is None:
        raise changed
    return chunk


def is_whole(path: Path) -> bool:
    """Return whether a file ends like a finished recording, not cut off by a full disk."""
    with path.open("rb") as file:
        size = file.seek(0, os.SEEK_END)
        if size < _START.size + _TRAILER.size:
            return False
        file.seek(size - _TRAILER.size)
        offset, stated, _, name, _ = _TRAILER.unpack(file.read())
    return bool(name == b"RRF2FOOT" and offset + stated == size - _TRAILER.size)


def _messages(file: BinaryIO, *, unfinished: bool) -> Iterator[tuple[int, memoryview, int]]:
    size = os.fstat(file.fileno()).st_size
    if size < _START.size or not file.read(_START.size).startswith(b"RRF2"):
        raise DamagedError(Message("it does not begin like a Rerun file"))
    position, count = _START.size, 0
    while size - position >= _HEAD.size:
        count += 1
        if count > MOST_FIELDS + size // LEAST_MESSAGE_BYTES:
            what = Message(
                "it has at least {count:,} messages in {size:,} bytes", count=count, size=size
            )
            raise DamagedError(what)
        kind, length = _HEAD.unpack(_exactly(file, _HEAD.size))
        position += _HEAD.size
        if kind > ACTIVATION or length > size - position:
            break
        if kind == FOOTER:
            file.seek(length, os.SEEK_CUR)
            if _is_trailer(file.read(_TRAILER.size + 1), position, length):
                return
            break
        if length > LARGEST_CHUNK:
            raise DamagedError(Message("a message of {size:,} bytes is too large", size=length))
        yield kind, memoryview(_exactly(file, length)), position - _HEAD.size
        position += length
    if not unfinished:
        raise UnfinishedError(Message("it does not end like a finished recording"))


def _is_trailer(data: bytes, position: int, length: int) -> bool:
    if len(data) != _TRAILER.size:
        return False
    offset, stated, _, name, _ = _TRAILER.unpack(data)
    return (offset, stated, name) == (position, length, b"RRF2FOOT")


def _exactly(file: BinaryIO, length: int) -> bytes:
    data = file.read(length)
    if len(data) != length:
        raise DamagedError(Message("it became shorter while it was read"))
    return data


# -- one message ----------------------------------------------------------------------------------


def _chunk(message: memoryview, position: int) -> Chunk | None:
    """Return the chunk in an `ArrowMsg`; None if it belongs to a blueprint."""
    try:
        fields = _fields(message)
        store = _fields(fields[1])
        if store[1] != RECORDING_STORE:
            return None
        application_id = _text(_fields(store[3])[1])
        recording_id = _text(store[2])
        data = _decompressed(fields)
        batch = _batch(data)
        if batch.num_rows * LEAST_ROW_BYTES > len(message):
            what = Message(
                "a chunk of {size:,} bytes claims {rows:,} rows",
                size=len(message),
                rows=batch.num_rows,
            )
            raise DamagedError(what)
        entity = _text(memoryview((batch.schema.metadata or {})[b"rerun:entity_path"]))
    except (DamagedError, MemoryError):
        raise
    except (
        pa.ArrowException,
        ArithmeticError,
        LookupError,
        OSError,
        StopIteration,
        struct.error,
        TypeError,
        ValueError,
    ) as error:
        # The error may quote the file.
        reason = "".join(filter(str.isprintable, str(error).partition("\n")[0]))[:120]
        what = Message(
            "a chunk cannot be decoded ({reason})", reason=reason or type(error).__name__
        )
        raise DamagedError(what) from None
    entity = entity.removeprefix("/")
    return Chunk(application_id, recording_id, entity, batch, data.size, position)


def _decompressed(fields: dict[int, int | memoryview]) -> pa.Buffer:
    payload, size = pa.py_buffer(fields[5]), fields.get(3, 0)
    if fields[2] == UNCOMPRESSED:
        return payload
    if fields[2] != LZ4 or not isinstance(size, int):
        raise DamagedError(Message("a chunk has an unknown compression"))
    if size > min(LARGEST_CHUNK, LZ4_RATIO * payload.size):
        what = Message(
            "a chunk of {size:,} bytes claims to unpack to {unpacked:,}",
            size=payload.size,
            unpacked=size,
        )
        raise DamagedError(what)
    return pa.Codec("lz4_raw").decompress(payload, decompressed_size=size)


def _batch(data: pa.Buffer) -> pa.RecordBatch:
    _check_stream(data)
    batch = pa.ipc.open_stream(data).read_next_batch()
    batch.validate(full=True)
    batch.schema.names  # noqa: B018 - raises where one is not text
    return batch


def _check_stream(data: pa.Buffer) -> None:
    """Check that a short schema is followed by one uncompressed batch of rows.

    Arrow would unpack a compressed column to any size that the column claims.
    """
    stream = memoryview(data)
    schema = _header(stream, 0)
    rows = _header(stream, 8 + len(schema))
    body_length = _field(schema, _pointed(schema, 0), 3)
    kind, batch = (_field(rows, _pointed(rows, 0), number) for number in (1, 2))
    if body_length and any(schema[body_length : body_length + 8]):
        raise DamagedError(Message("a chunk has something between its schema and its rows"))
    if not kind or rows[kind] != RECORD_BATCH or _field(rows, _pointed(rows, batch), 3):
        raise DamagedError(Message("a chunk's rows have an unknown encoding"))


def _header(stream: memoryview, position: int) -> memoryview:
    """Return the flatbuffer header of an Arrow message."""
    marker, length = struct.unpack_from("<II", stream, position)
    if marker != 0xFFFFFFFF or length > LARGEST_HEADER:
        raise DamagedError(Message("a chunk has an unknown header"))
    return stream[position + 8 : position + 8 + length]


def _pointed(buffer: memoryview, position: int) -> int:
    """Return the target of an offset in a flatbuffer. Source: flatbuffers.dev/internals."""
    return position + int(struct.unpack_from("<I", buffer, position)[0])


def _field(buffer: memoryview, table: int, number: int) -> int:
    """Return the position of a field in a flatbuffer's table; 0 if the table lacks it."""
    fields = table - int(struct.unpack_from("<i", buffer, table)[0])
    entry, (length,) = 4 + 2 * number, struct.unpack_from("<H", buffer, fields)
    offset = struct.unpack_from("<H", buffer, fields + entry)[0] if entry + 2 <= length else 0
    return table + int(offset) if offset else 0


def _fields(message: int | memoryview) -> dict[int, int | memoryview]:
    """Return the fields of a protobuf message by number; the last one if a field is repeated.

    Source: protobuf.dev/programming-guides/encoding. Only the types that Rerun's files use are
    supported: varints, fixed 64-bit numbers and length-delimited bytes.
    """
    if isinstance(message, int):
        raise DamagedError(Message("a chunk's header is unreadable"))
    fields: dict[int, int | memoryview] = {}
    position = count = 0
    while position < len(message):
        count += 1
        if count > MOST_FIELDS:
            raise DamagedError(Message("a chunk's header is unreadable"))
        key, position = _varint(message, position)
        number, wire_type = key >> 3, key & 7
        if wire_type == 0:
            fields[number], position = _varint(message, position)
            continue
        length, position = (8, position) if wire_type == 1 else _varint(message, position)
        if wire_type not in (1, 2) or length > len(message) - position:
            raise DamagedError(Message("a chunk's header is unreadable"))
        fields[number] = message[position : position + length]
        position += length
    return fields


def _varint(message: memoryview, position: int) -> tuple[int, int]:
    value = 0
    for shift in range(0, 64, 7):
        byte = message[position]
        position += 1
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            return value, position
    raise DamagedError(Message("a chunk's header is unreadable"))


def _text(field: int | memoryview) -> str:
    if not isinstance(field, memoryview):
        return ""
    if len(field) > LONGEST_NAME:
        raise DamagedError(Message("it has a name of {count:,} characters", count=len(field)))
    return bytes(field).decode()
