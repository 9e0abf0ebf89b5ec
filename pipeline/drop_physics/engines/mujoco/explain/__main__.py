"""Replay and explain a stream: `python PATH-OF-THIS-FOLDER SPOOL` answers on its standard output.

The spool has payloads (`frames`), each after its length (uint32); so has the answer.
"""

from __future__ import annotations

import importlib
import importlib.util
import os
import struct
import sys
from typing import Any

LENGTH = struct.Struct("<I")
_HERE = os.path.dirname(os.path.abspath(__file__))
_PACKAGE = "_drop_mujoco"


def _load() -> Any:
    """Import our own modules under a name that nothing else has."""
    folder = os.path.dirname(_HERE)
    if sys.path and os.path.abspath(sys.path[0]) == _HERE:
        del sys.path[0]
    spec = importlib.util.spec_from_file_location(
        _PACKAGE, os.path.join(folder, "__init__.py"), submodule_search_locations=[folder]
    )
    assert spec is not None
    assert spec.loader is not None
    package = importlib.util.module_from_spec(spec)
    sys.modules[_PACKAGE] = package
    spec.loader.exec_module(package)
    return importlib.import_module(f"{_PACKAGE}.explain.replay")


def main() -> None:
    """Answer what the spool asks."""
    replay = _load().Replay()
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what MuJoCo prints must not get into the answer
    with open(sys.argv[1], "rb") as spool:
        while True:
            head = spool.read(LENGTH.size)
            if len(head) < LENGTH.size:
                break
            payload = spool.read(*LENGTH.unpack(head))
            for answer in replay.take(payload):
                out.write(LENGTH.pack(len(answer)) + answer)
    for answer in replay.rest():
        out.write(LENGTH.pack(len(answer)) + answer)
    out.flush()


if __name__ == "__main__":
    main()
