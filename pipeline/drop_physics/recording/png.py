"""The header of a PNG, read before anything decodes it. Source: www.w3.org/TR/png-3, section 5."""

from __future__ import annotations

import re

SIGNATURE = b"\x89PNG\r\n\x1a\n"
_OURS = re.compile(rb"IHDR(PLTE)?(IDAT)+IEND")


def size_px(png: bytes) -> tuple[int, int] | None:
    """Return width and height of a PNG with the structure of ours; None of anything else.

    That is a header, perhaps a palette, the pixels and the end: no second header with another size,
    no text or profile that unpacks to more than the picture.
    """
    position, kinds = len(SIGNATURE), bytearray()
    if not png.startswith(SIGNATURE):
        return None
    while position < len(png):
        kinds += png[position + 4 : position + 8]
        position += 12 + int.from_bytes(png[position : position + 4])
    if position != len(png) or not _OURS.fullmatch(kinds):
        return None
    return int.from_bytes(png[16:20]), int.from_bytes(png[20:24])
