"""Converts an operation into writes to a compiled model: field, indices and new values."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from ...watching.operators import becoming

Operation = Mapping[str, Any]
"""An operation on a run, as data; the key `do` says which kind."""
Write = tuple[str, Any, Callable[[Any], Any]]
"""A write to a model: the field, named as scripts write it (`geom_friction`, `opt.timestep`); the
indices of its elements, None for all; and a function from old values to new ones."""

FREE, BALL = 0, 1
"""Joint types (`mjtJoint`); types with higher numbers have one coordinate."""
LEAST_KG = 1e-15
"""The mass of a massless body (`mjMINVAL`)."""
SIZES = ("nq", "nv", "nu", "nbody", "ngeom", "nsite", "neq", "ntendon")
"""Names of a model's element counts."""
BITS = 31
"""Number of bits of `contype` and `conaffinity` that are used."""
NOT_A_PAIR = 0
"""A body-pair signature that no pair of bodies has: the world paired with itself."""
BY_JOINT = (0, 1)
"""Transmission types of actuators that act on joints (`mjtTrn`)."""


def writes_of(module: Any, m: Any, operation: Operation) -> Iterator[Write]:
    """Yield the writes by which an operation changes a model: field, indices, new values."""
    do, (field, _, column) = operation["do"], operation.get("field", "").partition("[")
    if field and not has_field(m, field):
        return  # of another version
    if do == "write":
        where: Any = ...
        if "of" in operation:
            kind, of = field.partition("_")[0], operation["of"]
            where = rows_of(module, m, kind, of, ids_of(module, m, of, operation))
            if "limited" in operation:
                where = where[getattr(m, operation["limited"])[where].astype(bool)]
            if not len(where):
                return
        yield field, (where, int(column[:-1])) if column else where, _becoming(module, operation)
    elif do == "weigh":
        ids = ids_of(module, m, "body", operation)
        given, masses = operation["mass"], m.body_mass[ids].clip(LEAST_KG)
        factor = np.full(len(ids), operation["factor"]) if given is None else given / masses
        yield "body_mass", ids, lambda held: held * factor
        yield "body_inertia", ids, lambda held: held * factor[:, None]
    elif do == "meet":
        yield from _meeting(m, *(_geoms(module, m, names) for names in operation["names"]))
    elif do == "part":
        yield from _parting(m, operation.get("pairs") or _sides(module, m, *operation["names"]))
    elif do == "collide":
        types, affinities = m.geom_contype.copy(), m.geom_conaffinity.copy()
        types[operation["ids"]] = affinities[operation["ids"]] = operation["bits"]
        yield from _bits(m, types, affinities)
    elif do == "unexclude":
        first, second = (named(module, m, "body", names) for names in operation["names"])
        pairs = {(int(min(a, b)) << 16) + int(max(a, b)) for a in first for b in second}
        pairs |= {(int(max(a, b)) << 16) + int(min(a, b)) for a in first for b in second}
        rows = [n for n, each in enumerate(m.exclude_signature.tolist()) if each in pairs]
        if rows:
            yield "exclude_signature", rows, lambda held: np.full_like(held, NOT_A_PAIR)


def _becoming(module: Any, operation: Operation) -> Callable[[Any], Any]:
    """Return the function that computes an element's new values from its old ones."""
    name, given = operation["how"]
    if name == "size":
        return lambda held: held * (given / (np.linalg.norm(held) or 1.0))
    if isinstance(given, str):
        flags = module.mjtDisableBit if given.startswith("mjDSBL") else module.mjtEnableBit
        given = int(getattr(flags, given))

    def become(held: Any) -> Any:
        new = becoming(held, (name, given))
        return type(held)(new) if np.isscalar(held) else np.broadcast_to(new, held.shape)

    return become


def rows_of(module: Any, m: Any, kind: str, of: str, ids: Sequence[int]) -> Any:
    """Return the indices of elements of one type that belong to given objects, such as bodies."""
    if kind == "actuator" and of == "joint":
        by_joint = np.isin(m.actuator_trntype, BY_JOINT)
        return np.flatnonzero(by_joint & np.isin(m.actuator_trnid[:, 0], ids))
    if kind == "dof":
        return np.flatnonzero(np.isin(m.dof_jntid if of == "joint" else m.dof_bodyid, ids))
    if kind == "geom" and of == "body":
        return np.flatnonzero(np.isin(m.geom_bodyid, ids))
    if kind == "pair":
        pairs = m.geom_bodyid[np.stack([m.pair_geom1, m.pair_geom2])]
        return np.flatnonzero(np.isin(pairs, ids).any(axis=0))
    if kind == "jnt" and of == "body":
        return np.flatnonzero(np.isin(m.jnt_bodyid, ids))
    if kind == "eq" and of == "body":
        return np.flatnonzero(
            [bool({*_bodies_of_equality(module, m, n)} & {*ids}) for n in range(m.neq)]
        )
    return np.array(ids, np.int64)


def _bodies_of_equality(module: Any, m: Any, number: int) -> Iterator[int]:
    for other in (int(m.eq_obj1id[number]), int(m.eq_obj2id[number])):
        if m.eq_objtype[number] == int(module.mjtObj.mjOBJ_BODY):
            yield other
        elif m.eq_objtype[number] == int(module.mjtObj.mjOBJ_SITE):
            yield int(m.site_bodyid[other])


def ids_of(module: Any, m: Any, kind: str, operation: Operation) -> Sequence[int]:
    """Return the indices of the objects that an operation names, by index or by name."""
    ids: Sequence[int] | None = operation.get("ids")
    return named(module, m, kind, operation["names"]) if ids is None else ids


def named(module: Any, m: Any, kind: str, names: Sequence[str]) -> list[int]:
    """Return the indices of objects by name; unnamed ones are named by type and index."""
    object_type = getattr(module.mjtObj, f"mjOBJ_{kind.upper()}")
    found = []
    for name in names:
        number = module.mj_name2id(m, object_type, name)
        match = re.fullmatch(rf"{kind}(\d+)", name) if number < 0 else None
        number = int(match[1]) if match else number
        if number >= 0:
            found.append(int(number))
    return found


def sizes(m: Any) -> list[int]:
    """Return a key that is equal for models with the same element counts."""
    return [int(getattr(m, name)) for name in SIZES]


# -- which geometries meet ------------------------------------------------------------------------


def _geoms(module: Any, m: Any, names: Sequence[str]) -> list[int]:
    """Return the geoms of bodies that can collide; all their geoms if none can."""
    mine = rows_of(module, m, "geom", "body", named(module, m, "body", names))
    solid = mine[(m.geom_contype[mine] | m.geom_conaffinity[mine]) != 0]
    return [int(each) for each in (solid if len(solid) else mine)]


def _sides(
    module: Any, m: Any, first: Sequence[str], second: Sequence[str] | None
) -> list[tuple[list[int], list[int]]]:
    """Return pairs of geom lists: geoms of the named bodies, and their collision partners.

    Without partners (`second`), these are the geoms of the parent bodies.
    """
    if second is not None:
        return [(_geoms(module, m, first), _geoms(module, m, second))]
    parents = {int(m.body_parentid[each]) for each in named(module, m, "body", first)}
    theirs = [geom for geom in range(m.ngeom) if int(m.geom_bodyid[geom]) in parents]
    return [(_geoms(module, m, first), theirs)]


def _free_bits(types: Any, affinities: Any) -> list[int]:
    used = int(np.bitwise_or.reduce(types | affinities, initial=0))
    return [1 << each for each in range(BITS) if not used >> each & 1]


def _meeting(m: Any, first: Sequence[int], second: Sequence[int]) -> Iterator[Write]:
    """Yield writes that enable collisions between two groups of geoms, and no others."""
    types, affinities = m.geom_contype.copy(), m.geom_conaffinity.copy()
    free = _free_bits(types, affinities)
    if free:
        types[first] |= free[0]
        affinities[second] |= free[0]
        yield from _bits(m, types, affinities)


def _parting(m: Any, sides: Sequence[tuple[Sequence[int], Sequence[int]]]) -> Iterator[Write]:
    """Yield writes that stop collisions between two groups of geoms.

    The first side's geoms exchange their bits for new ones, one for each combination of old bits.
    All former partners that do not belong to the second side get the matching new bit.
    """
    types, affinities = m.geom_contype.copy(), m.geom_conaffinity.copy()
    for mine, theirs in sides:
        kinds = sorted({(int(types[geom]), int(affinities[geom])) for geom in mine})
        free = _free_bits(types, affinities)
        if len(kinds) > len(free):
            return
        old = types.copy(), affinities.copy()
        for (kind, affinity), bit in zip(kinds, free):
            its = [geom for geom in mine if (old[0][geom], old[1][geom]) == (kind, affinity)]
            meets = np.flatnonzero((old[0] & affinity) | (old[1] & kind))
            others = [geom for geom in meets.tolist() if geom not in theirs and geom not in mine]
            affinities[others] |= bit
            types[its], affinities[its] = bit, 0
    yield from _bits(m, types, affinities)


def _bits(m: Any, types: Any, affinities: Any) -> Iterator[Write]:
    """Yield writes of the collision bits of all geoms and, combined, of bodies."""
    for name, bits in (("contype", types), ("conaffinity", affinities)):
        of_bodies = np.zeros_like(getattr(m, f"body_{name}"))
        np.bitwise_or.at(of_bodies, m.geom_bodyid, bits)
        yield f"geom_{name}", ..., partial(_always, bits)
        yield f"body_{name}", ..., partial(_always, of_bodies)


def _always(value: Any, _: Any) -> Any:
    return value


# -- fields ---------------------------------------------------------------------------------------


def has_field(m: Any, name: str) -> bool:
    """Return whether a model of this version has a field."""
    return hasattr(m.opt if name.startswith("opt.") else m, name.removeprefix("opt."))


def field_of(m: Any, name: str) -> Any:
    """Return the value of a model field, including those of `opt`."""
    return getattr(m.opt, name[4:]) if name.startswith("opt.") else getattr(m, name)


def set_field(m: Any, name: str, where: Any, value: Any) -> None:
    """Write elements of a field."""
    held = field_of(m, name)
    if np.isscalar(held):
        setattr(m.opt, name[4:], value)
    else:
        held[where] = value
