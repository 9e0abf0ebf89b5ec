"""Direct access to MuJoCo's memory, to find quickly what a script or a step has changed.

Comparing or copying a `memoryview` takes tens of nanoseconds, MuJoCo's own function for copying a
state a microsecond. The addresses are those of the arrays that MuJoCo's Python package returns.
"""

from __future__ import annotations

import ctypes
import functools
import re
from typing import Any

import numpy as np

from .frames import ASLEEP, CORE, LONG, PART_HEAD, PARTS, USER, kind_of, part_bytes

ALIGNED = 64
"""Alignment of MuJoCo's arrays in bytes; adjacent state arrays have no other gaps."""
NEAR = 1024
"""Arrays of a model with gaps of at most this many bytes are compared together."""
MOST_HFIELD = 1 << 16
"""Largest size of height fields that are compared at each step and included in the analysis
[bytes]."""
EDITABLE = re.compile(
    r"qpos0|qpos_spring"
    r"|body_(pos|quat|ipos|iquat|mass|subtreemass|inertia|invweight0|gravcomp|margin)"
    r"|jnt_(limited|actfrclimited|actgravcomp|solref|solimp|pos|axis|stiffness\w*|springyield|range"
    r"|actfrcrange|margin)"
    r"|dof_(solref|solimp|frictionloss|armature|damping\w*|invweight0|M0)"
    r"|geom_(type|contype|conaffinity|condim|priority|solmix|solref|solimp|size|rbound|pos|quat"
    r"|friction|margin|gap|surfacevel|adhesion|fluid)"
    r"|site_(pos|quat)"
    r"|(pair|exclude|eq|wrap|hfield)_(?!\w*adr$)\w+"
    r"|tendon_(?!type|adr|num|\w*id|group|width|user|rgba|treenum)\w+"
    r"|actuator_(?!group|user|plugin|historyadr)\w+"
)
"""Arrays of a model that a step reads and that a script may want to edit."""


LOOKS = re.compile(
    r"tex_\w+|light_\w+|vis\w*|bvh_\w+|oct_\w+|\w+_user|mesh_(normal|texcoord|facenormal"
    r"|facetexcoord|poly\w*|pathadr|bvh\w*|oct\w*)|skin_\w+|flex(?!_(vert(bodyid|adr|num)?|elem(num|dataadr)?|stiffness(adr)?|damping|dim|interp)$)\w*|efm\w*|plugin_attr\w*"
    r"|mat_tex\w+|paths|text_\w+|map\w+|[BM]_\w+|D_\w+|cam_(mat0|pos0|poscom0)|names_map"
)
"""Arrays of a model that no analysis needs: appearance, and acceleration structures."""


def view_of(address: int, size: int) -> memoryview:
    """Return memory of this process as bytes; the caller must keep its owner alive."""
    return memoryview((ctypes.c_char * size).from_address(address)).cast("B")


class StatePart:
    """A state array, such as `qpos`, in MuJoCo's memory, with the values last compared.

    Parameters
    ----------
    name
        The array's name.
    begin, size
        Offset and size of the array within the memory of its `StateMemory` [bytes].
    view, saved
        The memory of the `StateMemory`, and a copy of it from the last comparison.
    """

    __slots__ = ("_head", "begin", "end", "name", "number", "saved", "size", "view")

    def __init__(
        self, name: str, begin: int, size: int, view: memoryview, saved: bytearray
    ) -> None:
        self.name, self.begin, self.size, self.end = name, begin, size, begin + size
        self.number = PARTS.index(name)
        self.view, self.saved = view[begin : self.end], memoryview(saved)[begin : self.end]
        count = size // kind_of(name).itemsize
        self._head = PART_HEAD.pack(self.number, 0, 0, count) if count <= LONG else b""

    def frame(self) -> bytes:
        """Pack the elements that changed since the last comparison."""
        if self._head:
            return self._head + self.view.tobytes()
        return part_bytes(self.number, self.saved, self.view)


class StateMemory:
    """State arrays that are adjacent in MuJoCo's memory and compared together."""

    def __init__(self, arrays: dict[str, Any]) -> None:
        held = {name: array for name, array in arrays.items() if array.nbytes}
        places = {name: array.ctypes.data for name, array in held.items()}
        names = sorted(held, key=places.__getitem__)
        begin = min(places.values(), default=0)
        self.size = places[names[-1]] + held[names[-1]].nbytes - begin if names else 0
        for after, before in zip(names[1:], names):
            if not 0 <= places[after] - places[before] - held[before].nbytes < ALIGNED:
                raise LookupError(f"{after} does not lie behind {before}")
        self.view = view_of(begin, self.size) if names else memoryview(b"")
        self.saved = bytearray(self.size)
        """A copy of the memory when last compared; `kept` is a writable view of it."""
        self.kept = memoryview(self.saved)
        self.parts = [
            StatePart(name, places[name] - begin, held[name].nbytes, self.view, self.saved)
            for name in names
        ]

    def changed(self) -> tuple[int, bytes]:
        """Return how many arrays changed since the last call, and their packed changes."""
        found = []
        for part in self.parts:
            if part.saved.tobytes() != part.view.tobytes():
                found.append(part.frame())
                part.saved[:] = part.view
                if self.saved == self.view:  # most often only one has
                    break
        self.kept[:] = self.view
        return len(found), b"".join(found)


def core_of(d: Any) -> StateMemory:
    """Return the memory of the arrays that a step itself changes, such as `qpos` and `qvel`."""
    return StateMemory({name: getattr(d, name) for name in CORE if hasattr(d, name)})


def user_of(d: Any) -> StateMemory:
    """Return the memory of the arrays that only the script changes, such as `ctrl`."""
    return StateMemory({name: getattr(d, name) for name in USER})


def asleep_of(d: Any) -> StateMemory:
    """Return the memory of the sleep state of trees; nothing before MuJoCo 3.4."""
    return StateMemory({ASLEEP: getattr(d, ASLEEP, np.empty(0, np.int32))})


def warnings_of(d: Any) -> memoryview:
    """Return the memory of an MjData's warning counters: pairs of int32, last info and count."""
    numbers = d.warning.number
    return view_of(numbers.ctypes.data - 4, len(numbers) * numbers.strides[0])


class Field:
    """A model field that a script may edit, in MuJoCo's memory.

    Parameters
    ----------
    name
        The field as scripts write it: `geom_friction`, `opt.timestep`.
    address, dtype, shape
        The address, type and shape of the field's array.
    """

    def __init__(self, name: str, address: int, dtype: Any, shape: tuple[int, ...]) -> None:
        self.name, self.address, self.dtype, self.shape = name, address, np.dtype(dtype), shape
        self.size = self.dtype.itemsize * int(np.prod(shape, dtype=np.int64))


def fields_of(m: Any) -> list[Field]:
    """Return the editable fields of a model, in memory order."""
    found = options_of(m)
    for name in dir(m):
        if not EDITABLE.fullmatch(name):
            continue
        array = getattr(m, name)
        if not isinstance(array, np.ndarray) or not array.nbytes or not array.flags.c_contiguous:
            continue
        if _is_large_hfield(name, array):
            continue
        found.append(Field(name, array.ctypes.data, array.dtype, array.shape))
    return sorted(found, key=lambda field: field.address)


def _is_large_hfield(name: str, array: Any) -> bool:
    return name == "hfield_data" and array.nbytes > MOST_HFIELD


@functools.cache
def layout_of_options() -> list[tuple[str, int, Any, tuple[int, ...]]]:
    """Return name, offset in bytes, type and shape of the members of MuJoCo's struct of options."""
    from mujoco.introspect import ast_nodes, structs

    at = 0
    members: list[tuple[str, int, Any, tuple[int, ...]]] = []
    for field in structs.STRUCTS["mjOption"].fields:
        kind, shape = field.type, ()
        if isinstance(kind, ast_nodes.ArrayType):
            kind, shape = kind.inner_type, tuple(kind.extents)
        dtype = np.dtype({"mjtNum": np.float64, "int": np.int32}[kind.name])
        at = -(-at // dtype.itemsize) * dtype.itemsize
        members.append((field.name, at, dtype, shape))
        at += dtype.itemsize * int(np.prod(shape, dtype=np.int64))
    return members


def options_of(m: Any) -> list[Field]:
    """Return the fields of a model's options, in the layout of the C struct.

    Raises
    ------
    LookupError
        If the struct in memory does not match MuJoCo's own description.
    """
    layout = layout_of_options()
    (gravity,) = [at for name, at, _, _ in layout if name == "gravity"]
    begin = m.opt.gravity.ctypes.data - gravity
    fields = [Field(f"opt.{name}", begin + at, dtype, shape) for name, at, dtype, shape in layout]
    for field in fields:
        held = np.frombuffer(view_of(field.address, field.size), field.dtype).reshape(field.shape)
        if not np.array_equal(held, getattr(m.opt, field.name[4:]), equal_nan=True):
            raise LookupError(f"{field.name} is not where it should be")
    return fields


def stretches_of(fields: list[Field]) -> list[tuple[bytearray, memoryview, int]]:
    """Return current values, memory and address of fields, merged into few contiguous ranges."""
    found: list[list[int]] = []
    for field in fields:
        end = field.address + field.size
        if found and field.address - found[-1][1] <= NEAR:
            found[-1][1] = max(end, found[-1][1])
        else:
            found.append([field.address, end])
    views = [(view_of(begin, end - begin), begin) for begin, end in found]
    return [(bytearray(view), view, begin) for view, begin in views]


def constants_of(m: Any) -> dict[str, Any]:
    """Return the model constants that the analysis needs: arrays, sizes, options, all names."""
    found: dict[str, Any] = {}
    for name in dir(m):
        if name.startswith("_") or LOOKS.fullmatch(name):
            continue
        value = getattr(m, name)
        if isinstance(value, np.ndarray):
            if value.size and not _is_large_hfield(name, value):
                found[name] = value
        elif isinstance(value, (int, float)):
            found[name] = np.array(value)
        elif isinstance(value, bytes):
            found[name] = np.frombuffer(value, np.uint8)
    for name in dir(m.opt):
        value = getattr(m.opt, name)
        if not name.startswith("_") and isinstance(value, (int, float, np.ndarray)):
            found[f"opt.{name}"] = np.array(value)
    return found
