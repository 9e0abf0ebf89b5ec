"""Constraint forces: equalities, friction losses, limits, each contact pair's push and friction.

MuJoCo has a row of the Jacobian J and a force f for each constraint, in any order. Rows with one
cause are a group; its force is the sum of J f over its rows. A contact's rows are the edges of a
pyramid, whose normal is the mean of the first two, or the normal and two tangents of a cone.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

EQUALITY, FRICTION_DOF, FRICTION_TENDON, LIMIT_JOINT, LIMIT_TENDON = range(5)
FRICTIONLESS, PYRAMIDAL, ELLIPTIC = 5, 6, 7
"""Contact types (`mjtConstraint`)."""
KINDS = ("equality", "friction loss", "tendon friction", "limit", "tendon limit")
PUSH, FRICTION = "push", "friction"
MOST_FORCES = 6
"""Largest number of forces in a contact: normal, two tangential, torsional, two rolling."""

POINT = np.dtype(
    [
        ("row", np.int32),
        ("pair", np.int32),
        ("distance", np.float32),
        ("position", np.float32, 3),
        ("normal", np.float32, 3),
        ("force", np.float32, 3),
    ]
)
"""A contact: indices of the evaluation and of its geom pair in the `PairTable`; distance [m],
position [m], normal from the first geom to the second, force on the second [N]. Vectors are in
world axes and single precision; impulses are more precise."""


class PairTable:
    """The geom pairs met so far, with their friction coefficients, by index."""

    def __init__(self) -> None:
        self._known: dict[bytes, int] = {}
        self.made: list[list[float]] = []
        """The two geoms of each pair, and its five friction coefficients."""
        self.told = 0
        """Number of pairs that were sent."""

    def numbers(self, geoms: Any, frictions: Any) -> Any:
        """Return the index of each pair; shapes (c, 2) and (c, 5)."""
        rows = np.column_stack([geoms, frictions])
        mixed = (rows.view(np.uint64) * _MIXED).sum(axis=1, dtype=np.uint64)
        _, first, which = np.unique(mixed, return_index=True, return_inverse=True)
        found = []
        for row in rows[first]:
            key = row.tobytes()
            if key not in self._known:
                self._known[key] = len(self.made)
                self.made.append(row.tolist())
            found.append(self._known[key])
        return np.array(found, np.int32)[which.ravel()]


_MIXED = np.array([2 * (0x9E3779B97F4A7C15 * k % 2**63) + 1 for k in range(1, 8)], np.uint64)
"""Odd factors that give different rows different hash sums."""


class Groups(NamedTuple):
    """Constraint forces summed by cause, in each evaluation."""

    rows: Any
    """Index of each group's evaluation, shape (g,)."""
    kinds: Any
    """Types, as indices into `KINDS`; 5 is a push and 6 friction, shape (g,)."""
    first: Any
    second: Any
    """Indices of the constrained objects, shape (g,)."""
    dofs: Any
    """The degrees of freedom of all groups, concatenated."""
    values: Any
    """The force on each of these degrees of freedom."""
    starts: Any
    """Offset of each group's first element, shape (g + 1,)."""


class Constrained(NamedTuple):
    """All constraint forces in a batch of evaluations, with the contact points."""

    groups: Groups | None
    points: Any


def constrained(
    copies: Any, pairs: PairTable, joint_of: Any, nv: int, *, sparse: bool
) -> Constrained:
    """Return all constraint forces in a batch of copied evaluations.

    Parameters
    ----------
    copies
        The copied evaluations.
    pairs
        The geom pairs of the model so far; new pairs are added.
    joint_of
        The joint of each degree of freedom.
    nv
        The number of degrees of freedom.
    sparse
        Whether MuJoCo stored the Jacobian as a sparse matrix.
    """
    nefc, ncon = np.array(copies.nefc), np.array(copies.ncon)
    total = int(nefc.sum())
    if not total:
        return Constrained(None, np.empty(0, POINT))
    row_of = np.repeat(np.arange(len(nefc)), nefc)
    base = np.cumsum(nefc) - nefc
    types = copies.columns("efc_type", np.int32)
    ids = copies.columns("efc_id", np.int32)
    forces = copies.columns("efc_force", np.float64)
    others = np.flatnonzero(types < FRICTIONLESS)
    named = np.where(types == FRICTION_DOF, joint_of[np.minimum(ids, len(joint_of) - 1)], ids)
    points, of_contacts = _points(copies, pairs, ncon, base, types, forces)
    # Rows and their weights: what is not a contact's, then pushes, then friction.
    rows = np.concatenate([others, of_contacts.rows, of_contacts.rows])
    weights = np.concatenate([forces[others], of_contacts.pushes, of_contacts.frictions])
    count = len(of_contacts.rows)
    kinds = np.concatenate([types[others], np.full(count, 5), np.full(count, 6)])
    first = np.concatenate([named[others], of_contacts.first, of_contacts.first])
    second = np.concatenate([np.full(len(others), -1), of_contacts.second, of_contacts.second])
    acting = weights != 0.0
    rows, weights, kinds = rows[acting], weights[acting], kinds[acting]
    first, second = first[acting], second[acting]
    evaluation = row_of[rows]
    order = np.lexsort((second, first, kinds, evaluation))
    rows, weights, kinds = rows[order], weights[order], kinds[order]
    first, second, evaluation = first[order], second[order], evaluation[order]
    new = np.ones(len(rows), bool)
    if len(rows):
        new[1:] = (
            (np.diff(evaluation) != 0)
            | (np.diff(kinds) != 0)
            | (np.diff(first) != 0)
            | (np.diff(second) != 0)
        )
    begins = np.flatnonzero(new)
    if sparse:
        dofs, values, starts = _sparse_sums(copies, row_of, base, rows, weights, new)
    else:
        dofs, values, starts = _dense_sums(copies, nv, rows, weights, begins)
    groups = Groups(
        evaluation[begins], kinds[begins], first[begins], second[begins], dofs, values, starts
    )
    return Constrained(groups, points)


class _OfContacts(NamedTuple):
    """The Jacobian rows of contacts, and the shares of push and friction in them."""

    rows: Any
    pushes: Any
    frictions: Any
    first: Any
    second: Any


def _points(
    copies: Any, pairs: PairTable, ncon: Any, base: Any, types: Any, forces: Any
) -> tuple[Any, _OfContacts]:
    """Return the contact points, and each Jacobian row's shares of push and friction."""
    empty = np.empty(0, np.int64)
    none = _OfContacts(empty, np.empty(0), np.empty(0), empty, empty)
    if not ncon.any():
        return np.empty(0, POINT), none
    raw = copies.columns("contact", copies.contacts.dtype)
    row_of = np.repeat(np.arange(len(ncon)), ncon)
    acting = np.flatnonzero(raw["efc_address"] >= 0)
    raw, row_of = raw[acting], row_of[acting]
    if not len(raw):
        return np.empty(0, POINT), none
    begin = base[row_of] + raw["efc_address"]
    kind, dim = types[begin], raw["dim"].astype(np.int64)
    width = np.where(kind == PYRAMIDAL, 2 * (dim - 1), np.where(kind == ELLIPTIC, dim, 1))
    # All rows of all contacts, one behind the other.
    contact = np.repeat(np.arange(len(raw)), width)
    place = np.arange(int(width.sum())) - np.repeat(np.cumsum(width) - width, width)
    rows = begin[contact] + place
    f, pyramidal = forces[rows], kind[contact] == PYRAMIDAL
    sums = np.add.reduceat(f, np.cumsum(width) - width)
    pushes = np.where(
        pyramidal, np.where(place < 2, sums[contact] / 2, 0.0), np.where(place == 0, f, 0.0)
    )
    # The edges of a pyramid come in pairs, along a tangent and against it.
    tangent = np.where(pyramidal, place // 2 + 1, place)
    sign = np.where(pyramidal & (place % 2 == 1), -1.0, 1.0)
    scale = np.where(pyramidal, raw["friction"][contact, np.minimum(tangent, 5) - 1], 1.0)
    along = np.flatnonzero(tangent > 0)
    local = np.zeros((len(raw), MOST_FORCES))
    local[:, 0] = np.where(kind == PYRAMIDAL, sums, forces[begin])
    np.add.at(local, (contact[along], tangent[along]), (sign * scale * f)[along])
    frame = raw["frame"].reshape(-1, 3, 3)
    points = np.zeros(len(raw), POINT)
    points["row"], points["pair"] = row_of, pairs.numbers(raw["geom"], raw["friction"])
    points["distance"], points["position"], points["normal"] = raw["dist"], raw["pos"], frame[:, 0]
    points["force"] = np.einsum("cf,cfx->cx", local[:, :3], frame)
    first, second = raw["geom"][contact].T
    return points, _OfContacts(rows, pushes, f - pushes, first, second)


def _dense_sums(copies: Any, nv: int, rows: Any, weights: Any, begins: Any) -> tuple[Any, ...]:
    """Sum the rows of a dense Jacobian by group: return dofs, values and group starts."""
    if not len(rows):
        return np.empty(0, int), np.empty(0), np.zeros(1, int)
    jacobian = copies.columns("efc_J", np.float64).reshape(-1, nv)
    sums = np.add.reduceat(jacobian[rows] * weights[:, None], begins, axis=0)
    group, dofs = np.nonzero(sums)
    starts = np.searchsorted(group, np.arange(len(begins) + 1))
    return dofs, sums[group, dofs], starts


def _sparse_sums(
    copies: Any, row_of: Any, base: Any, rows: Any, weights: Any, new: Any
) -> tuple[Any, ...]:
    """Sum the rows of a sparse Jacobian by group: return dofs, values and group starts.

    The rows of a group usually have the same columns, since they concern the same bodies. A group
    with a row that has other columns is summed column by column.
    """
    jacobian = copies.columns("efc_J", np.float64)
    columns = copies.columns("efc_J_colind", np.int32)
    counts = copies.columns("efc_J_rownnz", np.int32).astype(np.int64)
    lengths = np.array([len(piece) // 8 for piece in copies.rows["efc_J"]])
    filled = np.zeros(len(base), np.int64)
    with_rows = np.flatnonzero(np.array(copies.nefc))
    filled[with_rows] = np.cumsum(lengths) - lengths
    starts = copies.columns("efc_J_rowadr", np.int32) + filled[row_of]
    width = counts[rows]
    total = int(width.sum())
    place = np.arange(total) - np.repeat(np.cumsum(width) - width, width)
    entry = np.repeat(starts[rows], width) + place
    values = jacobian[entry] * np.repeat(weights, width)
    group = np.cumsum(new) - 1
    widest = np.maximum.reduceat(width, np.flatnonzero(new)) if len(rows) else np.empty(0, int)
    begin = np.concatenate([[0], np.cumsum(widest)])
    target = np.repeat(begin[group], width) + place
    summed = np.bincount(target, values, minlength=int(begin[-1]))
    dofs = np.full(int(begin[-1]), -1)
    dofs[target] = columns[entry]
    if (dofs[target] == columns[entry]).all():
        return dofs, summed, begin
    key = np.repeat(group, width) * (int(columns.max()) + 1) + columns[entry]
    unique, which = np.unique(key, return_inverse=True)
    summed = np.bincount(which, values, minlength=len(unique))
    per = int(columns.max()) + 1
    return unique % per, summed, np.searchsorted(unique // per, np.arange(int(new.sum()) + 1))
