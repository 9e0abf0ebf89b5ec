"""Fields that differ between two compiled models, by element, and edits that swap their values."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drop_physics.engines.mujoco.elements import Elements, Matched
from drop_physics.trace.frames import ModelEdit
from drop_physics.trace.swaps import FieldApart

Arrays = Mapping[str, NDArray[Any]]
Int64 = NDArray[np.int64]

LOOKS = re.compile(
    r"cam_\w+|light_\w+|mat_\w+|tex_?\w*|skin\w*|vis\w*|text_\w+|tuple_\w+|numeric_\w+|key_\w+"
    r"|n\w+|\w+_(rgba|user|matid|pathadr)|geom_group|site_(?!pos|quat|bodyid)\w+|paths|buffer|signature"
    r"|sensor_(?!delay|interval|history)\w+|mesh_(texcoord|normal|facenormal|facetexcoord)\w*"
)
"""Fields that do not affect steps."""
NUMBERING = re.compile(
    r"\w*(adr|num|id|Id|treeid|parentid|rootid|sameframe|simple\w*)|[BMD]_\w+|map\w+|\w+_row\w+"
)
"""Fields that describe how elements are connected, or where their numbers are stored."""
DERIVED = re.compile(
    r"body_(subtreemass|invweight0|margin|inertia|iquat|ipos)|dof_(invweight0|M0)"
    r"|geom_(rbound|aabb)|bvh_\w+|oct_\w+|stat\.\w+|tendon_(invweight0|length0)|efm?\w*"
    r"|actuator_(acc0|length0|lengthrange)|qpos0|jnt_margin"
)
"""Fields that the compiler may have computed from others."""
ROW_KINDS = re.compile(
    r"(body|jnt|dof|geom|site|tendon|actuator|eq|mesh|hfield|pair|exclude|sensor)_"
)


@dataclass(frozen=True, eq=False)
class Swappable:
    """An element whose values can be swapped between two models."""

    told: FieldApart
    edits: tuple[ModelEdit, ...]
    """Edits that give the second model the first model's values."""


class FieldsApart:
    """The differences between two compiled models.

    Parameters
    ----------
    a, b
        All fields of the first and the second model, by name.
    matched
        The elements of both models that correspond.
    """

    def __init__(self, a: Arrays, b: Arrays, matched: Matched) -> None:
        self._a, self._b, self._matched = a, b, matched
        self.swappable: list[Swappable] = []
        self.others: list[str] = []
        """Names of fields that differ in shape or type."""
        structure: list[ModelEdit] = []
        for name in sorted(a.keys() & b.keys()):
            if LOOKS.fullmatch(name) or not a[name].size + b[name].size:
                continue
            if NUMBERING.fullmatch(name):
                structure += self._numbered(name)
            else:
                self.swappable += self._found(name)
        if structure and matched.is_same_layout and self._is_same_size():
            names = ", ".join(each.name for each in structure)
            told = FieldApart(names, "", "", (), (), is_structure=True)
            self.swappable.append(Swappable(told, tuple(structure)))
        elif structure:
            self.others += [each.name for each in structure]

    def _is_same_size(self) -> bool:
        numbers = {name for name, value in self._a.items() if not np.ndim(value)}
        sizes = {name for name in numbers if re.fullmatch(r"n[A-Za-z]+", name)} - {"nnames"}
        return all(
            self._a[name] == self._b[name]
            for name in sizes & self._b.keys()
            if not name.startswith(("nname", "narena", "nbuffer", "ntext", "ntex", "nuser"))
        )

    def _numbered(self, name: str) -> Iterator[ModelEdit]:
        mine, theirs = np.asarray(self._a[name]), np.asarray(self._b[name])
        if not self._matched.is_same_layout or np.array_equal(mine, theirs):
            return
        if mine.shape == theirs.shape:
            yield _edit(name, np.arange(mine.size), mine.ravel())
        else:
            self.others.append(name)

    def _found(self, name: str) -> Iterator[Swappable]:
        mine, theirs = np.asarray(self._a[name]), np.asarray(self._b[name])
        kind = ROW_KINDS.match(name)
        if kind is None or not self._has_rows(kind[1], mine, theirs):
            if mine.shape != theirs.shape:
                self.others.append(name)
            elif not _same(mine, theirs):
                yield self._whole(name, mine, theirs)
            return
        if mine.shape[1:] != theirs.shape[1:]:
            self.others.append(name)
            return
        elements, width = self._matched.a, mine[0].size if len(mine) else 0
        for i, j in self._matched.pairs(kind[1]):
            if not _same(mine[i], theirs[j]):
                places = j * width + np.arange(width)
                label, of = elements.label(kind[1], i), elements.body_label(kind[1], i)
                told = self._told(
                    name, label, "" if of in label.split() else of, mine[i], theirs[j]
                )
                yield Swappable(told, (_edit(name, places, mine[i].ravel()),))

    def _has_rows(self, kind: str, mine: NDArray[Any], theirs: NDArray[Any]) -> bool:
        """Return whether a field has one row for each element of a type."""
        a, b = self._matched.a.count(kind), self._matched.b.count(kind)
        return mine.ndim > 0 and theirs.ndim > 0 and (len(mine), len(theirs)) == (a, b)

    def _whole(self, name: str, mine: NDArray[Any], theirs: NDArray[Any]) -> Swappable:
        told = self._told(name, "", "", mine, theirs)
        return Swappable(told, (_edit(name, np.arange(max(mine.size, 1)), mine.ravel()),))

    def _told(
        self, name: str, label: str, of: str, mine: NDArray[Any], theirs: NDArray[Any]
    ) -> FieldApart:
        a, b = (tuple(np.ravel(each).astype(np.float64).tolist()) for each in (mine, theirs))
        derived, setting = bool(DERIVED.fullmatch(name)), name.startswith("opt.")
        return FieldApart(name, label, of, a, b, is_derived=derived, is_setting=setting)


def _same(mine: NDArray[Any], theirs: NDArray[Any]) -> bool:
    """Return whether values are bitwise equal; integer widths may differ by version."""
    both = [np.ascontiguousarray(each, np.float64).tobytes() for each in (mine, theirs)]
    return both[0] == both[1]


def _edit(name: str, indices: Int64, values: NDArray[Any]) -> ModelEdit:
    return ModelEdit(0, name, indices.astype(np.int64), values.astype(np.float64))


def elements_of_indices(
    elements: Elements, name: str, field: NDArray[Any], indices: Int64
) -> list[str]:
    """Return the label of the element at each index of a flattened field."""
    kind = ROW_KINDS.match(name)
    if kind is None or not np.ndim(field) or len(field) != elements.count(kind[1]):
        return ["" for _ in indices]
    width = max(np.size(field) // max(len(field), 1), 1)
    return [elements.label(kind[1], int(index) // width) for index in indices]
