"""Finds uses of an MjData's arrays that have another effect than they seem to have.

An array that MuJoCo changes in place is kept without a copy; one that is computed from positions is
read after these were written; one that each step computes anew is written; or a force that was
written again and again is left where it is. The attributes of MjData are replaced by properties
that return the same objects. A use is reported only where memory proves it.
"""

from __future__ import annotations

import dis
import linecache
import operator
import re
import weakref
from collections.abc import Callable
from functools import partial
from sys import _getframe, getrefcount
from threading import get_ident
from types import ModuleType
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ...watching.hidden import OURS, hide
from ..frames import note_bytes

if TYPE_CHECKING:
    from .followed import WatchedData
    from .hooks import MujocoWatch

STATES = ("qpos", "qvel", "act", "ctrl", "mocap_pos", "mocap_quat")
FORCES = ("xfrc_applied", "qfrc_applied")
POSED = (
    *("xpos", "xquat", "xmat", "xipos", "ximat", "subtree_com", "sensordata"),
    *("geom_xpos", "geom_xmat", "site_xpos", "site_xmat", "cam_xpos", "cam_xmat"),
)
"""Arrays that are computed from positions."""
POINTS = ("xpos", "xipos", "subtree_com", "geom_xpos", "site_xpos", "cam_xpos")
"""Names of the arrays that have a position in each row."""
COMPUTED = ("qfrc_passive", "qfrc_actuator", "qfrc_constraint", "actuator_force", "qacc")
"""Arrays that each step computes before it uses them."""
VIEWS = {
    "body": ("Body", ("xpos", "xquat", "xmat", "xipos", "ximat", "subtree_com")),
    "geom": ("Geom", ("xpos", "xmat")),
    "site": ("Site", ("xpos", "xmat")),
    "camera": ("Camera", ("xpos", "xmat")),
    "cam": ("Camera", ("xpos", "xmat")),
    "sensor": ("Sensor", ("data",)),
    "joint": ("Joint", ("qpos", "qvel")),
    "jnt": ("Joint", ("qpos", "qvel")),
}
"""The class and the arrays of the views that a method of MjData returns."""
KINDS = {"geom": "geom", "site": "site", "cam": "camera"}
"""The kinds of elements by the prefix of an array; without one, the elements are bodies."""
MANY = 32
"""Number of references to an array, or of steps, from which it counts as kept."""
CHECKS = 8
"""Number of times that a line's array is compared before the line counts as only reading it."""
PAUSE = 10
"""Minimum number of steps for which a force is not written before it counts as left."""
APART = 1e-9
"""Difference from which a read number counts as another one than MuJoCo computes next."""
LOADS = ("LOAD_FAST", "LOAD_NAME", "LOAD_GLOBAL", "LOAD_DEREF", "LOAD_CONST", "LOAD_SMALL_INT")
"""Instructions that load an index; their names may have a suffix."""


class GotArray(NamedTuple):
    """An array as it was when the script got it."""

    name: str
    element: str
    """Name of the element whose view it is; empty for the whole array."""
    array: Any
    before: Any
    """A copy of the array."""
    site: int
    key: tuple[int, int]
    """The code object's `id`, and the instruction."""
    file: str
    line: int
    row: int | None
    """The row that the line reads, if it is known."""


class KeptArray:
    """The references to one array, and the line that got it last."""

    def __init__(self, references: int) -> None:
        self.references = references
        self.site: int | None = None
        self.time = -1.0
        self.steps: dict[int, int] = {}
        """Number of steps in which each line kept the array."""


class LeftForce:
    """The steps before which the script used an array of forces."""

    def __init__(self) -> None:
        self.steps = self.idle = 0
        self.is_used = False
        self.site = 0
        self.is_told = False


class ArrayUses:
    """The uses of one MjData's arrays."""

    def __init__(self, watch: MujocoWatch, d: Any) -> None:
        self.watch, self.ref = watch, weakref.ref(d)
        self.state: WatchedData | None = None
        """The simulation, once it is followed."""
        self.saved: Any = b""
        """The state after the last step or the last report, and the memory of the current one."""
        self.view: Any = b""
        self.is_reset = True
        """Whether nothing was computed from positions since they were set as a whole."""
        self.read: dict[Any, GotArray] = {}
        """Arrays that were read while out of date, until they are computed."""
        self.got: dict[Any, GotArray] = {}
        """Arrays that the script may have written, until they are computed."""
        self.forces: dict[str, LeftForce] = {}
        self.kept: dict[int, KeptArray] = {}
        self._counts: dict[tuple[str, str, int], int] = {}

    def follow(self, state: WatchedData) -> None:
        """Note that the simulation is followed from now on."""
        self.state, self.saved, self.view = state, state.core.saved, state.core.view

    @property
    def is_stale(self) -> bool:
        """True if positions were set since anything was computed from them.

        Before the first computation the model's own positions count as not set: a loop that reads,
        controls and steps begins with such a reading.
        """
        if self.state is None:
            d = self.ref()
            own = getattr(getattr(d, "model", None), "qpos0", None)
            return own is not None and not np.array_equal(d.qpos, own)  # type: ignore[union-attr]
        if self.is_reset and self.state.elapsed_s:
            return True
        return any(part.saved != part.view for part in self.state.core.parts if part.name == "qpos")

    def keep(self, d: Any, array: Any, name: str, references: int, site: int) -> None:
        """Count a reference to an array for the line that got the array before."""
        kept = self.kept.setdefault(id(array), KeptArray(references))
        if references > kept.references and kept.site is not None and d.time != kept.time:
            kept.time = d.time
            steps = kept.steps[kept.site] = kept.steps.get(kept.site, 0) + 1
            if steps >= MANY and not steps & steps - 1:
                self._tell("kept", name, kept.site, count=steps)
        kept.references, kept.site = references, site

    def before(self, *, computes: bool) -> None:
        """Report the arrays that the script has written, before they are computed."""
        got, self.got = self.got, {}
        for held in got.values():
            if np.array_equal(held.array, held.before, equal_nan=True):
                only_read = self.watch.only_read
                only_read[held.key] = only_read.get(held.key, 0) + 1
            elif computes and _assigns(held.file, held.line, held.name):
                key_of = "overwritten", held.name, held.site
                count = self._counts[key_of] = self._counts.get(key_of, 0) + 1
                if not count & count - 1:
                    self._tell("overwritten", held.name, held.site, count=count)

    def after(self, *, step: bool) -> None:
        """Report arrays that were out of date when read, once they are computed."""
        read, self.read, self.is_reset = self.read, {}, False
        for held in read.values():
            with np.errstate(all="ignore"):
                off = np.abs(held.array - held.before)
            if held.row is not None:
                off = off[held.row : held.row + 1] if held.row >= 0 else off[held.row :][:1]
            elif not held.element and not _differs_in_all(off, held.name):
                continue
            sizes = np.linalg.norm(off.reshape(-1, 3), axis=1) if held.name in POINTS else off
            size = float(np.nan_to_num(sizes).max(initial=0.0))
            if size > APART:
                key = "stale", held.name, held.site
                count = self._counts[key] = self._counts.get(key, 0) + 1
                if not count & count - 1:
                    element = held.element or self._element(held.name, held.row)
                    self._tell(
                        "stale", held.name, held.site, count=count, size=size, element=element
                    )
        if step and self.forces:
            self._leave()

    def _leave(self) -> None:
        for name, force in self.forces.items():
            if force.is_used:
                force.steps, force.idle, force.is_used = force.steps + 1, 0, False
                continue
            force.idle += 1
            if force.idle == max(PAUSE, force.steps) and force.steps > 1 and not force.is_told:
                array = getattr(self.ref(), name)
                rows = np.flatnonzero(array.reshape(len(array), -1).any(axis=1))
                if len(rows):
                    force.is_told = True
                    size = float(np.linalg.norm(array[rows[0]]))
                    told = {"count": force.steps, "size": size, "since": force.idle}
                    element = self._element("xpos", int(rows[0])) if array.ndim > 1 else ""
                    self._tell("left", name, force.site, element=element, **told)

    def _element(self, name: str, row: int | None) -> str:
        if row is None or name == "sensordata" or self.state is None:
            return ""
        m = self.state.model.ref()
        return str(getattr(m, KINDS.get(name.partition("_")[0], "body"))(row).name)

    def _tell(self, use: str, name: str, site: int, **numbers: Any) -> None:
        if self.state is not None and not self.state.lost:
            world = self.state.number
            told = note_bytes("use", world=world, use=use, name=name, site=site, **numbers)
            self.watch.send(told)


def install(watch: MujocoWatch, module: ModuleType) -> None:
    """Replace the array attributes of MjData, and of its views of elements, by properties."""
    owner: Any = module.MjData
    for name in (*STATES, *FORCES, *POSED, *COMPUTED):
        _replace(watch, owner, name, _getting(name, watch.uses, partial(_note, watch, name)))
    structs = getattr(module, "_structs", module)
    for method, (kind, names) in VIEWS.items():
        views = getattr(structs, f"_MjData{kind}Views", None)
        plain = vars(owner).get(method)
        if views is None or plain is None:
            continue
        setattr(owner, method, _viewing(watch, plain))
        watch.host.on_removal(partial(setattr, owner, method, plain))
        if method in ("cam", "jnt"):
            continue
        prefix = "" if kind in ("Body", "Joint") else {"Camera": "cam_"}.get(kind, f"{method}_")
        for name in names:
            whole = "sensordata" if kind == "Sensor" else prefix + name
            note = partial(_note, watch, whole)
            _replace(watch, views, name, _getting(whole, watch.owners, note))


def _replace(watch: MujocoWatch, owner: Any, name: str, getting: Callable[[Any], Any]) -> None:
    plain = vars(owner).get(name)
    if isinstance(plain, property) and plain.fget is not None:
        hook = property(getting(plain.fget), plain.fset, plain.fdel, plain.__doc__)
        setattr(owner, name, hook)
        watch.host.on_removal(partial(setattr, owner, name, plain))


def _getting(name: str, table: dict[int, ArrayUses], note: Callable[..., None]) -> Any:
    """Return a function that wraps an attribute's getter; what needs no note costs little."""

    def of_states(get: Callable[[Any], Any]) -> Any:
        def state(self: Any) -> Any:
            array = get(self)
            if getrefcount(array) > MANY:
                note(table.get(id(self)), self, array)
            return array

        return state

    def of_poses(get: Callable[[Any], Any]) -> Any:
        def posed(self: Any) -> Any:
            array, uses = get(self), table.get(id(self))
            if (
                uses is None
                or uses.is_reset
                or uses.saved != uses.view
                or getrefcount(array) > MANY
            ):
                note(uses, self, array)
            return array

        return posed

    def of_others(get: Callable[[Any], Any]) -> Any:
        def other(self: Any) -> Any:
            array = get(self)
            note(table.get(id(self)), self, array)
            return array

        return other

    return of_states if name in STATES else of_poses if name in POSED else of_others


def _viewing(watch: MujocoWatch, plain: Any) -> Any:
    """Wrap a method that returns a view of an element, so that the view's MjData is known."""
    owners, table, uses_of = watch.owners, watch.uses, watch.uses_of

    def view(self: Any, *args: Any, **kwargs: Any) -> Any:
        try:
            made = plain(self, *args, **kwargs)
        except BaseException as error:
            hide(error)
            raise
        uses = table.get(id(self))
        if uses is None or uses.ref() is not self:
            uses = uses_of(self)
        owners[id(made)] = uses
        return made

    view.__name__, view.__doc__ = plain.__name__, plain.__doc__
    return view


def _note(watch: MujocoWatch, name: str, uses: ArrayUses | None, owner: Any, array: Any) -> None:
    """Note that the script got an array, of an MjData or of the view of an element."""
    place = _getframe(2)
    key = id(place.f_code), place.f_lasti
    checked = name in COMPUTED and watch.only_read.get(key, 0) <= CHECKS
    if name in COMPUTED and not checked and getrefcount(array) <= MANY:
        return
    if not watch.host.on or watch.pipe.muted or place.f_code.co_filename.startswith(OURS):
        return
    if watch.callbacks and watch.stepping.get(get_ident()) is not None:
        return  # within a step, what a callback writes has an effect
    try:
        view = None if isinstance(owner, watch.mujoco.MjData) else owner
        if view is None and (uses is None or uses.ref() is not owner):
            uses = watch.uses_of(owner)
        if uses is None:
            return
        references, is_stale = getrefcount(array), name in POSED and uses.is_stale
        if not (checked or is_stale or name in FORCES or references > MANY):
            return
        with watch.host.lock:
            site = watch.site_of(place)
            if references > MANY:
                uses.keep(uses.ref(), array, name, references, site)
            if name in FORCES:
                force = uses.forces.setdefault(name, LeftForce())
                force.is_used, force.site = True, site
            which = name, id(array), site
            for held, wanted in ((uses.got, checked), (uses.read, is_stale)):
                if wanted and which not in held:
                    row = None if view else _row_of(place)
                    element = view.name if view else ""
                    held[which] = GotArray(
                        name,
                        element,
                        array,
                        array.copy(),
                        site,
                        key,
                        place.f_code.co_filename,
                        place.f_lineno,
                        row,
                    )
    except Exception as error:  # noqa: BLE001 - our errors must not reach the script
        with watch.host.lock:
            watch.lose(None, error)


def _row_of(place: Any) -> int | None:
    """Return the row that an expression reads of the array it has just got; None if unknown."""
    made = [each for each in dis.get_instructions(place.f_code) if each.opname != "CACHE"]
    at = next((n for n, each in enumerate(made) if each.offset == place.f_lasti), None)
    if at is None or at + 2 >= len(made) or not made[at + 1].opname.startswith(LOADS):
        return None
    rest = made[at + 2 : at + 10]
    ends = next((n for n, each in enumerate(rest) if _subscribes(each)), None)
    if ends is None or (ends and rest[ends - 1].opname != "BUILD_TUPLE"):
        return None
    index = made[at + 1]
    value = index.argval
    if not index.opname.startswith(("LOAD_CONST", "LOAD_SMALL_INT")):
        value = place.f_locals.get(value, place.f_globals.get(value))
    try:
        return operator.index(value)
    except TypeError:
        return None


def _subscribes(instruction: Any) -> bool:
    name: str = instruction.opname
    return name == "BINARY_SUBSCR" or (name, instruction.argrepr) == ("BINARY_OP", "[]")


def _differs_in_all(off: Any, name: str) -> bool:
    """Return whether all rows of an array are out of date; a body's first row is the world's."""
    rows = off.reshape(len(off), -1).max(axis=1, initial=0.0) > APART
    first = int("_" not in name and name != "sensordata")
    return len(rows) > first and bool(np.all(rows[first:]))


def _assigns(file: str, line: int, name: str) -> bool:
    """Return whether a line of code assigns to an array of this name."""
    text = linecache.getline(file, line)
    name = name.rpartition("_x")[2] if "_x" in name else name
    return re.search(rf"\.{name}\s*(\[[^=]*\])?\s*[-+*/]?=(?!=)", text) is not None
