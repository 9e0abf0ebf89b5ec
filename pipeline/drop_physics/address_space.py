"""Address space is asked for before a library that would end the process where it gets none."""

from __future__ import annotations

import mmap


def check_address_space(size: int) -> None:
    """Raise MemoryError unless so many bytes could be allocated now."""
    try:
        mmap.mmap(-1, size).close()
    except OSError:
        raise MemoryError from None
