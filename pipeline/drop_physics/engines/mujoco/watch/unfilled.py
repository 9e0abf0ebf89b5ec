"""Creates MjModel and MjData in memory that is not filled with a test pattern, to save memory.

A watched script's process fills new memory with a fixed value (glibc's `MALLOC_PERTURB_`), so that
values read before they are set are the same in each run. MuJoCo allocates the arena of a state at
its largest possible size, 530 MB for 500 boxes, and uses hardly any of it. Filling it would turn
all of it into real memory. It need not be filled: MuJoCo writes to its arena before it reads from
it.

glibc fills freed memory, too, 14 MB for a state of one body, unless it returns the memory to the
system at once. It does so for large blocks, but raises the size limit once such a block was freed,
unless the limit was set explicitly.
"""

from __future__ import annotations

import ctypes
import os
from collections.abc import Callable
from functools import partial, wraps
from types import ModuleType
from typing import Any

from ...watching.hidden import hiding

VARIABLE = "MALLOC_PERTURB_"
M_PERTURB, M_MMAP_THRESHOLD, M_TRIM_THRESHOLD = -6, -3, -1
"""Option numbers from glibc's `malloc.h`."""
OWN_BYTES, LARGEST_BYTES = 1 << 17, 1 << 25
"""Block sizes above which glibc returns freed memory to the system at once: its initial limit, and
the highest, up to which it raises the limit when a script frees large arrays."""
MAKES = {
    "MjData": ("__init__", "__copy__", "__deepcopy__"),
    "MjSpec": ("compile", "recompile"),
}
LOADS = {"MjModel": ("from_xml_string", "from_xml_path", "from_binary_path")}
"""Methods and static methods that allocate an arena; compiling an MjSpec creates an MjData, too."""


def install(module: ModuleType, on_removal: Callable[[Callable[[], None]], None]) -> None:
    """Make MjModel and MjData be created in unfilled memory."""
    fill = os.environ.get(VARIABLE, "")
    allocator = getattr(ctypes.PyDLL(None), "mallopt", None)
    if not fill.isdecimal() or allocator is None:
        return
    for kind, made in ((_plain, MAKES), (staticmethod, LOADS)):
        for owner, names in made.items():
            its = getattr(module, owner)
            for name in names:
                original = getattr(its, name, None)
                if original is not None:
                    setattr(its, name, kind(_unfilled(original, allocator, int(fill))))
                    on_removal(partial(setattr, its, name, kind(original)))


def _plain(function: Any) -> Any:
    return function


def _unfilled(original: Any, allocator: Any, fill: int) -> Any:
    def made(*args: Any, **kwargs: Any) -> Any:
        allocator(M_PERTURB, 0)
        allocator(M_MMAP_THRESHOLD, OWN_BYTES)
        try:
            return original(*args, **kwargs)
        finally:
            allocator(M_PERTURB, fill)
            allocator(M_MMAP_THRESHOLD, LARGEST_BYTES)
            allocator(M_TRIM_THRESHOLD, 2 * LARGEST_BYTES)

    return wraps(original)(hiding(made))
