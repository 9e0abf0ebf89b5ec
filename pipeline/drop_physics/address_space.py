"""Checks that enough memory can be reserved for a library that would abort without it."""

from __future__ import annotations

import mmap


def check_address_space(size: int) -> None:
    """Raise MemoryError unless `size` bytes could be allocated now."""
    try:
        mmap.mmap(-1, size).close()
    except OSError:
        raise MemoryError from None
