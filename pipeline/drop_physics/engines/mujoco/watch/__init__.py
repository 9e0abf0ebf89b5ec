"""Watches a MuJoCo script from within its own interpreter, and sends its steps to `drop record`.

It needs Python 3.9 or later, numpy, and the script's own mujoco (3.3 or later). Functions of mujoco
are replaced by wrappers (`hooks`); writes that the script makes without a call are found by
comparing memory (`memory`, `followed`). No number is changed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import ModuleType
from typing import TYPE_CHECKING, Any

from ...watching.host import ScriptWatch

if TYPE_CHECKING:
    from .hooks import MujocoWatch


def begin(
    host: ScriptWatch, operations: Sequence[Mapping[str, Any]], variation: dict[str, Any] | None
) -> None:
    """Start watching MuJoCo as soon as the script imports it."""
    watches: list[MujocoWatch] = []

    def install(module: ModuleType) -> None:
        if not watches:
            from .hooks import MujocoWatch

            watches.append(MujocoWatch(host, operations, variation))
        watches[0].install(module)

    host.on_import("mujoco", install, once=False)
