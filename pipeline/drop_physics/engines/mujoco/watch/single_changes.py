"""Lists the single changes that could be tried on a MuJoCo run, and how to make each.

The rows of the table of changes arrive as data (`interventions`). Elements are identified by index,
since many have no name.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from ...watching.operators import QUATERNION, ROTATED, becoming
from ...watching.single_changes import ORDERS, Change, how_of
from .derived import DERIVED_FROM, DerivedFields
from .seen import SeenInputs
from .writes import BALL, BY_JOINT, FREE, Operation, field_of, has_field, rows_of, sizes, writes_of

ENGINE = "mujoco"
"""Value of `engine` in operations for MuJoCo."""
ELEMENTS = {
    "dof": ("joint", "njnt"),
    "jnt": ("joint", "njnt"),
    "eq": ("equality", "neq"),
    "actuator": ("actuator", "nu"),
    "geom": ("geom", "ngeom"),
    "body": ("body", "nbody"),
    "site": ("site", "nsite"),
    "tendon": ("tendon", "ntendon"),
    "pair": ("pair", "npair"),
}
"""Element type, and name of its count, by field prefix."""
OF_INPUTS = {
    "ctrl": "actuator",
    "qfrc_applied": "joint",
    "xfrc_applied": "body",
    "mocap_pos": "body",
    "qpos": "joint",
    "qvel": "joint",
}
"""The element type to which the numbers of each input belong."""
OF_CONTACT = (
    "geom_friction",
    "geom_condim_friction",
    "geom_condim",
    "geom_solref",
    "geom_solimp",
    "geom_margin",
)
SAME_FRAME = {"geom_pos": "geom_sameframe", "site_pos": "site_sameframe"}
"""Flags of the compiled model that say that a position is that of the body or of its inertia; a
change of the position has to clear them."""
ROLLS = 6
"""The `condim` of contacts with torsional and rolling friction."""
STIFF_SOLIMP = (0.99, 0.999, 0.001, 0.5, 2.0)
AFFINE, MESH = 1, 7
"""An actuator bias type, affine in length and velocity; a geom type."""

ALL_PAIRS = 8
"""Largest number of actuators for which all pairs are exchanged; for more, only adjacent ones."""
BRAKES = ("dof_damping", "dof_frictionloss", "dof_armature", "jnt_stiffness")
"""Fields that resist a joint's motion."""

Group = tuple[Sequence[Any], bool]
"""Elements that are changed together, and whether that removes a part of the scene."""
Written = tuple[str, Any, Sequence[int]]
"""A model field, the operation on it (operator and operand), and the indices of its elements."""


def possible(module: Any, rows: Sequence[Mapping[str, Any]], seen: SeenInputs) -> list[Change]:
    """Return the single changes that could be tried and would have an effect in this run.

    Parameters
    ----------
    module
        The module `mujoco` of the script.
    rows
        Rows with the keys `change`, `tries` (operators), `breaks` (those operators that remove
        something) and `default` (the engine's default).
    seen
        The contacts and inputs of the script's own run.
    """
    found, m = [], seen.model
    for row in rows:
        for op in row["tries"]:
            how, breaks = how_of(op, row["default"]), op in row["breaks"]
            whole = Change(
                row["change"],
                op,
                how,
                breaks=breaks,
                model=tuple(sizes(m)),
                is_geometry=row["is_geometry"],
            )
            elements = _elements(m, whole, seen)
            if elements is None:
                found += [whole] if _does(module, seen, whole) else []
                continue
            kind, ids = elements
            if op in ORDERS:
                groups = _ordered(op, ids)
            else:
                ids = [n for n in ids if _does(module, seen, replace(whole, ids=(n,)))]
                groups = _supports(m, whole, ids)
            for group, supports in groups:
                of = tuple(name_of(module, m, kind, n) for n in group)
                on = [_body_of(m, kind, n) for n in group]
                trees = [name_of(module, m, "body", int(m.body_rootid[n])) for n in on if n >= 0]
                bodies = tuple(dict.fromkeys(trees))
                links = tuple("" if n < 0 else name_of(module, m, "body", n) for n in on)
                its = replace(whole, ids=tuple(group), of=of, bodies=bodies, on=links)
                found.append(replace(its, breaks=breaks or supports))
    return found


def _ordered(op: str, ids: Sequence[int]) -> Iterator[Group]:
    """Yield groups to reorder: all elements, or each pair; in long lists only neighbours."""
    if op == "reversed":
        if len(ids) > 2:
            yield ids, False
        return
    if len(ids) > 3:
        yield ids[: len(ids) // 2 * 2], False
    every = len(ids) <= ALL_PAIRS
    for k, one in enumerate(ids):
        for other in ids[k + 1 :] if every else ids[k + 1 : k + 2]:
            yield (one, other), False


def _supports(m: Any, change: Change, ids: Sequence[Any]) -> Iterator[Group]:
    """Yield elements in two groups; the second are joints that hold a robot's base from outside.

    These are joints of the base that no actuator drives: a real robot has no such brake.
    """
    outside: list[Any] = []
    if change.change in BRAKES and change.op != "=0":
        driven = {int(m.jnt_bodyid[each]) for each in _driven(m)}
        robots = {int(m.body_rootid[each]) for each in driven}
        outside = [
            joint
            for joint in ids
            if (body := int(m.jnt_bodyid[joint])) in robots and body not in driven
        ]
    for group in ([each for each in ids if each not in outside], outside):
        if group:
            yield group, group is outside


def _driven(m: Any) -> list[int]:
    """Return the joints on which actuators act."""
    of_joint = [int(kind) in BY_JOINT for kind in m.actuator_trntype]
    return [int(joint) for joint, is_its in zip(m.actuator_trnid[:, 0], of_joint) if is_its]


def trial_of(change: Change) -> dict[str, Any]:
    """Return the operations and run variation by which a trial run makes a change."""
    if change.change == "option.timestep":
        return {"interventions": [], "variation": {"finer": int(change.how[1])}}
    operation = {"engine": ENGINE, "do": "single", "change": asdict(change)}
    return {"interventions": [operation], "variation": {}}


def _body_of(m: Any, kind: str, which: Any) -> int:
    """Return the body to which an element belongs; -1 if there is none."""
    if kind == "actuator":
        kind, which = "joint", int(m.actuator_trnid[which, 0])
    owner = {"geom": "geom_bodyid", "joint": "jnt_bodyid", "site": "site_bodyid"}.get(kind)
    if kind != "body" and owner is None:
        return -1
    return int(which) if owner is None else int(getattr(m, owner)[which])


def name_of(module: Any, m: Any, kind: str, which: Any) -> str:
    """Return an element's name; an unnamed element is named after the body or joint that owns it.

    If an element is the only one of its type in a body, it gets the body's name, unless another
    element has that name.
    """
    if kind == "contact":
        return " x ".join(name_of(module, m, "geom", geom) for geom in which)
    of = getattr(module.mjtObj, f"mjOBJ_{kind.upper()}")
    name: str = module.mj_id2name(m, of, which)
    if name or (kind == "body" and not which):
        return name or "world"
    owner = {"geom": "geom_bodyid", "joint": "jnt_bodyid", "site": "site_bodyid"}.get(kind)
    if owner is None:
        return f"{kind}{which}"
    bodies = getattr(m, owner)
    body = name_of(module, m, "body", int(bodies[which]))
    if (bodies == bodies[which]).sum() == 1 and module.mj_name2id(m, of, body) < 0:
        return body
    return f"{kind}{which} of {body}"


# -- which elements -------------------------------------------------------------------------------


def _elements(m: Any, change: Change, seen: SeenInputs) -> tuple[str, Sequence[Any]] | None:
    """Return the type and indices of elements that a change may apply to; None for options."""
    name, _, part = change.change.partition(".")
    if name == "input":
        return OF_INPUTS[part], _owners(m, part, sorted(seen.written[part]))
    if part:
        return None
    if name == "pair":
        return "contact", sorted(seen.pairs)
    kind, size = ELEMENTS[name.partition("_")[0]]
    ids: Sequence[int] = range(kind == "body", int(getattr(m, size)))
    touched = {geom for pair in seen.pairs for geom in pair}
    if name == "geom_collides" and change.op == "=0":
        ids = sorted(touched)
    elif name in OF_CONTACT:
        solid = (m.geom_contype | m.geom_conaffinity) != 0
        ids = [geom for geom in ids if touched and (solid[geom] or geom in touched)]
    elif name == "geom_size":
        ids = [geom for geom in ids if m.geom_type[geom] < MESH]
    elif name == "jnt_axis":
        ids = [joint for joint in ids if m.jnt_type[joint] > BALL]
    elif name == "jnt_solref":
        ids = [joint for joint in ids if m.jnt_limited[joint]]
    return kind, ids


def _owners(m: Any, part: str, flat: Sequence[int]) -> list[int]:
    """Return the elements (joints, actuators …) to which an input array's numbers belong."""
    if part in ("qfrc_applied", "qvel"):
        flat = m.dof_jntid[flat].tolist()
    elif part == "qpos":
        flat = (np.searchsorted(m.jnt_qposadr, flat, side="right") - 1).tolist()
    elif part == "xfrc_applied":
        flat = [each // 6 for each in flat]
    elif part == "mocap_pos":
        flat = [int(np.flatnonzero(m.body_mocapid == each // 3)[0]) for each in flat]
    return sorted({*flat})


def _numbers(module: Any, m: Any, part: str, ids: Sequence[int]) -> list[int]:
    """Return the indices in an input array that belong to the given elements."""
    if part in ("qfrc_applied", "qvel"):
        return [int(dof) for dof in rows_of(module, m, "dof", "joint", ids)]
    if part == "qpos":
        ends = [*m.jnt_qposadr.tolist(), m.nq]
        return [at for joint in ids for at in range(ends[joint], ends[joint + 1])]
    width = {"xfrc_applied": 6, "mocap_pos": 3}.get(part, 1)
    rows = m.body_mocapid[[*ids]].tolist() if part == "mocap_pos" else ids
    return [row * width + at for row in rows for at in range(width)]


# -- operations -----------------------------------------------------------------------------------


def _does(module: Any, seen: SeenInputs, change: Change) -> bool:
    """Return whether a change would have any effect, given what occurred in the run."""
    m = seen.model
    operations = [*operations_of(module, m, change)]
    for each in operations:
        if each["do"] == "start":
            before = seen.start[each["part"]]
            if np.any(started(m, before, each["how"]) != before):
                return True
        elif each["do"] == "derive":
            original = getattr(module.mj_setConst, "drop_plain", module.mj_setConst)
            return DerivedFields(module, original).are_stale(m)
        elif each["do"] not in ("write", "collide"):
            return bool(each.get("ids", True))
        for name, where, become in writes_of(module, m, each):
            if name in SAME_FRAME.values():
                continue
            held = field_of(m, name)
            before = held if np.isscalar(held) else np.array(held[where])
            if not np.array_equal(become(before), before):
                return True
    return not operations and change.change == "option.timestep"


def operations_of(module: Any, m: Any, change: Change) -> Iterator[Operation]:
    """Yield the operations that make a change, with elements given by index in this model."""
    if [*change.model] != sizes(m):
        return
    name, _, part = change.change.partition(".")
    ids, how = [*change.ids], change.how
    each: Operation = {"do": "write", "how": how}
    if name == "option":
        if part != "timestep":
            yield {**each, "field": f"opt.{part}"}
    elif name == "flag":
        for field, flags, flag in (
            ("opt.disableflags", module.mjtDisableBit, f"mjDSBL_{part}"),
            ("opt.enableflags", module.mjtEnableBit, f"mjENBL_{part}"),
        ):
            if hasattr(flags, flag):
                yield {**each, "field": field, "how": ("^", flag)}
    elif name == "model":
        yield {**each, "do": "derive"}
    elif name == "start":
        if how[0] == "+":
            free = m.jnt_bodyid[m.jnt_type == FREE].tolist()
            yield {**each, "do": "lift", "ids": free, "by_m": [0.0, 0.0, how[1]]}
        else:
            given = m.qpos0.tolist() if change.op == "=default" else how[1]
            yield {**each, "do": "start", "part": part, "how": (how[0], given)}
    elif name == "input":
        numbers = _numbers(module, m, part, ids)
        do = "leave" if change.op == "undone" else "input"
        yield {**each, "do": do, "part": part, "ids": numbers}
    elif name == "pair":
        yield {**each, "do": "part", "pairs": [((one,), (other,)) for one, other in ids]}
    elif name == "geom_collides":
        yield {**each, "do": "collide", "ids": ids, "bits": int(how[1])}
    elif name == "eq_active":
        yield {**each, "do": "input", "part": name, "ids": ids}
    else:
        kind, _ = ELEMENTS[name.partition("_")[0]]
        for field, becomes, its in _written(module, m, change):
            plain = field.partition("[")[0]
            derived = {"derived": True} if plain in DERIVED_FROM else {}
            if has_field(m, plain) and its:
                yield {**each, "field": field, "how": becomes, "of": kind, "ids": its, **derived}


def started(m: Any, part: Any, how: Sequence[Any]) -> Any:
    """Return a part of the first state with an operator applied to it.

    The order of numbers is that of the quaternions of free joints and balls.
    """
    if how[0] not in ROTATED:
        return np.broadcast_to(becoming(part, how), part.shape)
    new = part.copy()
    for kind, at in ((FREE, 3), (BALL, 0)):
        for first in (m.jnt_qposadr[m.jnt_type == kind] + at).tolist():
            its = part[first : first + QUATERNION]
            if its[0] != 1:  # without a turn, the order is right
                new[first : first + QUATERNION] = becoming(its, how)
    return new


def _written(module: Any, m: Any, change: Change) -> Iterator[Written]:
    """Yield the model fields that a change sets, with indices and new values."""
    name, ids, how = change.change, [*change.ids], change.how
    if name == "body_mass":
        yield from ((field, how, ids) for field in (name, "body_inertia"))
    elif name == "geom_condim_friction":
        yield "geom_condim", ("=", ROLLS), ids
        yield from ((f"geom_friction[{column}]", how, ids) for column in (1, 2))
    elif name in ("actuator_kp", "actuator_kv", "actuator_kp_kv"):
        yield from _servo(m, name, ids, how)
    elif name == "actuator_off":
        yield from ((f"actuator_{field}prm", how, ids) for field in ("gain", "bias"))
    elif name == "actuator_gear" and how[0] == "=":
        gear = m.actuator_gear[ids]
        largest = np.abs(gear).max(axis=1, keepdims=True)
        yield name, ("=", (how[1] * gear / np.where(largest, largest, 1.0)).tolist()), ids
    elif change.op.endswith("M0"):
        dofs = rows_of(module, m, "dof", "joint", ids)
        factor = float(change.op[1:-2] or 1)
        yield name, ("+", (factor * m.dof_M0[dofs]).tolist()), ids
    elif change.op == "stiff":
        stiff = (2 * float(m.opt.timestep), 1.0) if name.endswith("solref") else STIFF_SOLIMP
        yield name, ("=", stiff), ids
    else:
        yield name, how, ids
    if name in SAME_FRAME:
        yield SAME_FRAME[name], ("=", 0), ids


def _servo(m: Any, name: str, ids: Sequence[int], how: Any) -> Iterator[Written]:
    """Yield the writes that set servo gains: kp appears in gain and bias, kv in the bias.

    For a velocity servo, kv is the gain, too.
    """
    _, springs, dampers = (m.actuator_biasprm[:, :3] != 0).T
    springs, dampers = ((m.actuator_biastype == AFFINE) & each for each in (springs, dampers))
    wanted = {"actuator_kp": springs, "actuator_kv": dampers}.get(name, springs & dampers)
    its = [n for n in ids if wanted[n]]
    if name != "actuator_kv":
        yield "actuator_gainprm[0]", how, its
        yield "actuator_biasprm[1]", how, its
    if name != "actuator_kp":
        yield "actuator_biasprm[2]", how, its
    if name == "actuator_kv":
        yield "actuator_gainprm[0]", how, [n for n in its if not springs[n]]
