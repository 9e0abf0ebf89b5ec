"""Named elements of compiled models (joints, geoms …), matched between two models."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

Arrays = Mapping[str, NDArray[Any]]
Key = tuple[object, ...]

KINDS = (
    *("body", "jnt", "geom", "site", "tendon", "actuator", "eq", "mesh", "hfield", "pair"),
    *("exclude", "sensor"),
)
"""Element types, by the prefix of their field names (`mjtObj`)."""
OF_BODIES = ("jnt", "geom", "site")
"""Element types that belong to bodies."""
WORDS = {"jnt": "joint", "eq": "equality", "hfield": "height field"}
FREE, BALL = 0, 1
"""Joint types with a quaternion (`mjtJoint`)."""


class Elements:
    """The joints, geoms, actuators and other elements of a model.

    Parameters
    ----------
    arrays
        All fields of the model, by MuJoCo's names.
    """

    def __init__(self, arrays: Arrays) -> None:
        self.arrays = arrays
        self._names = {kind: [*self._named(kind)] for kind in KINDS}

    def _named(self, kind: str) -> Iterator[str]:
        held = bytes(self.arrays["names"])
        for address in np.atleast_1d(self.arrays.get(f"name_{kind}adr", ())).tolist():
            yield held[address : held.index(b"\0", address)].decode("utf-8", "replace")

    def count(self, kind: str) -> int:
        """Return the number of elements of a type; for `dof`, the degrees of freedom."""
        return len(self.dof_joints) if kind == "dof" else len(self._names.get(kind, ()))

    @cached_property
    def dof_joints(self) -> list[tuple[int, int]]:
        """The joint of each degree of freedom, and the dof's index within the joint."""
        joints = np.atleast_1d(self.arrays.get("dof_jntid", ())).tolist()
        first = np.atleast_1d(self.arrays.get("jnt_dofadr", ())).tolist()
        return [(joint, dof - first[joint]) for dof, joint in enumerate(joints)]

    def body_of(self, kind: str, index: int) -> int:
        """Return the body to which an element belongs."""
        return int(self.arrays[f"{kind}_bodyid"][index])

    def is_free(self, joint: int) -> bool:
        """Return whether a joint is a free joint."""
        return int(self.arrays["jnt_type"][joint]) == FREE

    # -- keys -------------------------------------------------------------------------------------

    @cached_property
    def keys(self) -> Mapping[str, Sequence[Key]]:
        """Keys by which elements are matched: a name, or the index among unnamed ones."""
        found: dict[str, Sequence[Key]] = {"body": self._body_keys()}
        for kind in KINDS[1:]:
            owners: list[object] = [""] * len(self._names[kind])
            if kind in OF_BODIES:
                owners = [found["body"][self.body_of(kind, each)] for each in range(len(owners))]
            found[kind] = [*_placed(self._names[kind], owners)]
        found["dof"] = [(found["jnt"][joint], number) for joint, number in self.dof_joints]
        return found

    def _body_keys(self) -> list[Key]:
        keys: list[Key] = []
        before = Counter[object]()
        for name, parent in zip(self._names["body"], self.arrays["body_parentid"], strict=True):
            owner = keys[int(parent)] if keys else ()
            keys.append((name,) if name else ("", owner, before[owner]))
            before[owner] += not name
        return keys

    def label(self, kind: str, index: int) -> str:
        """Return an element's name for messages."""
        if kind == "dof":
            return self.label("jnt", self.dof_joints[index][0])
        name = self._names[kind][index]
        if name:
            return name
        if kind == "jnt" and self.is_free(index):
            return self.label("body", self.body_of(kind, index))
        word = WORDS.get(kind, kind)
        if kind in OF_BODIES:
            body = self.body_of(kind, index)
            which = sum(self.body_of(kind, each) == body for each in range(index))
            return f"{word} {which} of {self.label('body', body)}"
        return f"{word} {index}"

    def body_label(self, kind: str, index: int) -> str:
        """Return the name of an element's body; empty for the world, or if it has no body."""
        kind, index = ("jnt", self.dof_joints[index][0]) if kind == "dof" else (kind, index)
        if kind not in OF_BODIES:
            return ""
        body = self.body_of(kind, index)
        return self.label("body", body) if body else ""


def _placed(names: Sequence[str], owners: Sequence[object]) -> Iterator[Key]:
    before = Counter[object]()
    for name, owner in zip(names, owners, strict=True):
        yield (name,) if name else ("", owner, before[owner])
        before[owner] += not name


class Matched:
    """Corresponding elements of two models: matched by name, the rest in order if counts agree."""

    def __init__(self, a: Elements, b: Elements) -> None:
        self.a, self.b = a, b
        self._pairs: dict[str, list[tuple[int, int]]] = {}
        for kind in (*KINDS, "dof"):
            mine, theirs = a.keys[kind], {key: n for n, key in enumerate(b.keys[kind])}
            pairs = [(n, theirs[key]) for n, key in enumerate(mine) if key in theirs]
            lost = _without(len(mine), (n for n, _ in pairs))
            new = _without(len(theirs), (n for _, n in pairs))
            if len(lost) == len(new):
                pairs += zip(lost, new, strict=True)
            self._pairs[kind] = sorted(pair for pair in pairs if self._alike(kind, *pair))

    def _alike(self, kind: str, mine: int, theirs: int) -> bool:
        """Return whether two elements may be matched: joints only if they have the same type."""
        if kind == "dof":
            mine, theirs = self.a.dof_joints[mine][0], self.b.dof_joints[theirs][0]
        if kind not in ("jnt", "dof"):
            return True
        return bool(self.a.arrays["jnt_type"][mine] == self.b.arrays["jnt_type"][theirs])

    def pairs(self, kind: str) -> list[tuple[int, int]]:
        """Return the index pairs of corresponding elements."""
        return self._pairs[kind]

    def only(self, kinds: Sequence[str] = KINDS) -> dict[str, list[str]]:
        """Return the elements of the given types that only one model has: `a` and `b`."""
        return {
            side: [
                elements.label(kind, each)
                for kind in kinds
                for each in _without(elements.count(kind), (p[which] for p in self._pairs[kind]))
            ]
            for which, (side, elements) in enumerate((("a", self.a), ("b", self.b)))
        }

    def is_identity(self, kind: str) -> bool:
        """Return whether both models have the same elements of a type in the same order."""
        count = self.a.count(kind)
        same = count == self.b.count(kind) == len(self._pairs[kind])
        return same and all(mine == theirs for mine, theirs in self._pairs[kind])

    @property
    def is_same_layout(self) -> bool:
        """True if both models have the same elements in the same order."""
        return all(map(self.is_identity, KINDS))

    @property
    def is_reordered(self) -> bool:
        """True if bodies or joints are ordered differently in the two models."""
        return any(
            [theirs for _, theirs in self._pairs[kind]]
            != sorted(theirs for _, theirs in self._pairs[kind])
            for kind in ("body", "jnt", "geom", "actuator", "eq", "tendon")
        )


def _without(count: int, taken: Iterator[int]) -> list[int]:
    left = {*range(count)} - {*taken}
    return sorted(left)
