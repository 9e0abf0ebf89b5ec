"""Notes the settings besides the script that its results may depend on: numpy, BLAS, hash seed."""

from __future__ import annotations

import ctypes
import os
from types import ModuleType
from typing import Any

MAPS = "/proc/self/maps"
"""List of the files that this process has mapped into memory, on Linux."""
PREFIXES, SUFFIXES = ("scipy_openblas_", "openblas_"), ("64_", "")
"""Prefixes and suffixes of OpenBLAS's function names in wheels and distributions."""


def hashes() -> str:
    """Return the seed for Python's hashes, which order sets: `random` if none is set."""
    return os.environ.get("PYTHONHASHSEED") or "random"


def of_numpy(module: ModuleType) -> dict[str, Any]:
    """Return numpy's version, and the kernels and threads of its OpenBLAS, if it has one."""
    facts: dict[str, Any] = {"numpy": module.__version__}
    try:
        with open(MAPS) as maps:
            files = {line.split()[-1] for line in maps if "openblas" in line}
        for library in map(ctypes.CDLL, sorted(files)):
            for name in (f"{a}{{}}{b}" for a in PREFIXES for b in SUFFIXES):
                core = getattr(library, name.format("get_corename"), None)
                threads = getattr(library, name.format("get_num_threads"), None)
                if core is not None and threads is not None:
                    core.restype = ctypes.c_char_p
                    facts.update(blas=core().decode(), blas_threads=threads())
                    return facts
    except (OSError, ValueError, AttributeError):
        pass
    return facts
