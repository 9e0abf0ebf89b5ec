"""Tells which fields of a model were changed before its first step, and which others were not.

What the compiler derives from a field is not derived again when a script writes the field. Edits
before the first step are not seen between steps, so that the fields are compared with those of the
compiled model.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable
from functools import wraps
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np

from ...watching.hidden import hiding
from ..frames import note_bytes

if TYPE_CHECKING:
    from .hooks import MujocoWatch

LOADS = ("from_xml_string", "from_xml_path", "from_binary_path")
DERIVED = {
    "geom_size": ("geom_rbound", "body_mass", "body_inertia"),
    "actuator_gainprm": ("actuator_biasprm",),
}
"""Fields that the compiler, or the MJCF file, sets together with another one."""


class CompiledModel:
    """The fields of a model as they were compiled."""

    def __init__(self, m: Any) -> None:
        self.ref = weakref.ref(m)
        names = {*DERIVED, *(name for derived in DERIVED.values() for name in derived)}
        self._fields = {name: getattr(m, name).copy() for name in names}

    def tell_edits(self, watch: MujocoWatch, world: int, site: int) -> None:
        """Report the elements that were changed while something that depends on them was not."""
        m = self.ref()
        for name, derived in DERIVED.items():
            old, new = self._fields[name], getattr(m, name)
            changed = [
                (row, [each for each in derived if self._is_kept(m, each, row)])
                for row in np.flatnonzero((old != new).any(axis=1)).tolist()
                if self._matters(m, name, row)
            ]
            changed = [(row, kept) for row, kept in changed if kept]
            if not changed:
                continue
            row, kept = changed[0]
            at = int(np.flatnonzero(old[row] != new[row])[0])
            told = {"old": float(old[row, at]), "size": float(new[row, at]), "others": kept}
            told["element"] = getattr(m, name.partition("_")[0])(row).name or str(row)
            note = note_bytes(
                "use", world=world, use="edited", name=name, site=site, count=len(changed), **told
            )
            watch.send(note)

    def _is_kept(self, m: Any, derived: str, row: int) -> bool:
        if derived.startswith("body_"):
            row = int(m.geom_bodyid[row])
            if not row:
                return False
        old = self._fields[derived][row]
        return bool(np.any(old)) and bool(np.array_equal(old, getattr(m, derived)[row]))

    def _matters(self, m: Any, name: str, row: int) -> bool:
        """Return whether an element collides, or is a servo whose gain and spring were equal."""
        if name == "geom_size":
            return bool(m.geom_contype[row] or m.geom_conaffinity[row])
        gain, spring = self._fields[name][row, 0], self._fields["actuator_biasprm"][row, 1]
        return bool(gain and gain == -spring)


def install(watch: MujocoWatch, module: ModuleType) -> None:
    """Keep the fields of each model that the script loads."""
    for name in LOADS:
        if hasattr(module.MjModel, name):
            watch.replace_static(module.MjModel, name, lambda load: _keeping(watch, load))


def _keeping(watch: MujocoWatch, load: Callable[..., Any]) -> Any:
    @wraps(load)
    def loaded(*args: Any, **kwargs: Any) -> Any:
        m = load(*args, **kwargs)
        watch.compiled[id(m)] = CompiledModel(m)
        return m

    return hiding(loaded)
