"""Writes each step of a batch as a sum of named impulses and a remainder."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from .constraints import FRICTION, KINDS, PUSH, Groups
from .forces import Force

OF_GROUPS = (*KINDS, PUSH, FRICTION)
UNSEEN = 1e-16
"""A term of at most this share of a step's largest impulse is omitted: it is less than half of that
impulse's last bit."""
ROUNDED = 1e-4
"""The last bits of a momentum, about 1e-16 of it, may remain unexplained: they are 1e-12 of a scale
of this share of the momentum."""


class Named(NamedTuple):
    """A force term with its index in the model's table."""

    number: int
    dofs: Any
    """The degrees of freedom on which it has acted so far."""


class TermTable:
    """The force terms of a model that have occurred so far, with indices."""

    def __init__(self) -> None:
        self._known: dict[tuple[str, int, int], Named] = {}
        self.made: list[tuple[str, int, int, Any]] = []
        """Kind, first and second index, and dofs of each term."""
        self.told = 0
        """Number of terms that were sent."""
        self._patterns: dict[bytes, int] = {}
        self.patterns: list[Any] = []
        """Lists of term indices; each step has one of these lists, in the order of its values."""
        self.patterns_told = 0

    def of(self, kind: str, first: int, second: int, dofs: Any) -> Named:
        """Return the indexed term of a cause, extended to the given degrees of freedom."""
        key = kind, first, second
        known = self._known.get(key)
        if known is not None:
            dofs = np.union1d(known.dofs, dofs)
            if len(dofs) == len(known.dofs):
                return known
        known = self._known[key] = Named(len(self.made), dofs)
        self.made.append((*key, dofs))
        return known

    def pattern(self, numbers: Any) -> int:
        """Return the index of a set of terms; equal sets share an index."""
        key = numbers.tobytes()
        found = self._patterns.get(key)
        if found is None:
            found = self._patterns[key] = len(self.patterns)
            self.patterns.append(numbers)
        return found


class TermSums(NamedTuple):
    """The sums of a batch of steps: which terms act in each step, and their impulses."""

    patterns: Any
    """Index of each step's list of terms, shape (n,)."""
    values: Any
    """The impulses of all steps, concatenated; within a step, term by term."""
    starts: Any
    """Offset of each step's first value, shape (n + 1,)."""
    remainder: Any
    """The largest unexplained component of M (u' - u), as a share of the largest impulse, (n,)."""
    largest: Any
    """The largest impulse [N s or N m s], shape (n,)."""


class _Block(NamedTuple):
    """The impulses of one term in the steps in which it acts."""

    number: int
    steps: Any
    values: Any


def summed(
    terms: TermTable,
    change: Any,
    dense: list[Force],
    groups: Groups | None,
    h: Any,
    added: list[Force],
    after: Any,
) -> TermSums:
    """Return each step's momentum change as a sum of impulses and a remainder.

    Parameters
    ----------
    terms
        The model's terms; new ones are added.
    change
        M (u' - u), shape (n, nv).
    dense, groups
        The forces as arrays over all steps, and the constraint forces in groups, whose row is the
        step.
    h
        The timestep of each step [s], shape (n,); a force times h is its impulse.
    added
        Further terms that are impulses already.
    after
        M u', shape (n, nv); where hardly any impulse acts, the remainder is the rounding of this
        momentum.
    """
    n, nv = change.shape
    total = np.zeros((n, nv))
    largest = np.zeros(n)
    found: list[tuple[Force, Any, Any]] = []
    forces = [each._replace(values=each.values * h[:, None]) for each in dense]
    for each in (*forces, *added):
        dofs = np.arange(nv) if each.dofs is None else each.dofs
        values = each.values
        total[:, dofs] += values
        size = np.abs(values)
        largest = np.maximum(largest, size.max(axis=1, initial=0.0))
        found.append((each, dofs, size))
    row = impulses = np.empty(0, np.int64)
    if groups is not None:
        row = np.repeat(groups.rows, np.diff(groups.starts))
        impulses = groups.values * h[row]
        total += np.bincount(row * nv + groups.dofs, impulses, minlength=n * nv).reshape(n, nv)
        np.maximum.at(largest, row, np.abs(impulses))
    least = UNSEEN * largest
    blocks = [
        block
        for each, dofs, size in found
        for block in _block(terms, each, dofs, size > least[:, None], nv)
    ]
    flat = None
    if groups is not None:
        flat = _flat(terms, groups, impulses, np.abs(impulses) > least[row])
    left = np.abs(change - total).max(axis=1, initial=0.0)
    scale = np.maximum(largest, ROUNDED * np.abs(after).max(axis=1, initial=0.0))
    remainder = np.divide(left, scale, out=np.zeros(n), where=scale > 0.0)
    remainder[(scale == 0.0) & (left > 0.0)] = np.inf
    remainder[~np.isfinite(left)] = np.inf
    return _laid_out(terms, n, blocks, flat, remainder, largest)


def _block(terms: TermTable, force: Force, dofs: Any, acting: Any, nv: int) -> Iterator[_Block]:
    """Yield a force's impulses over the steps in which it acts; nothing if it never acts."""
    where = acting.any(axis=0)
    if not where.any():
        return
    known = terms.of(force.kind, force.first, force.second, dofs[where])
    values, steps = force.values, np.flatnonzero(acting.any(axis=1))
    if len(known.dofs) != len(dofs) or (known.dofs != dofs).any():
        full = np.zeros((len(values), nv))
        full[:, dofs] = values
        values = full[:, known.dofs]
    yield _Block(known.number, steps, values[steps])


class _Flat(NamedTuple):
    """Constraint impulses of all steps in one array, with the index of each one's term."""

    numbers: Any
    """Index of each group's term, shape (g,)."""
    rows: Any
    group: Any
    """Index of each value's group."""
    places: Any
    """Index of each value within its term."""
    values: Any


def _flat(terms: TermTable, groups: Groups, impulses: Any, acting: Any) -> _Flat | None:
    """Look up the terms of constraint forces, and return their non-zero impulses.

    None if no impulse acts.
    """
    width = np.diff(groups.starts)
    group = np.repeat(np.arange(len(groups.rows)), width)[acting]
    kept, group = np.unique(group, return_inverse=True)
    if not len(kept):
        return None
    dofs = groups.dofs[acting]
    cause = np.stack([groups.kinds, groups.first, groups.second], axis=1)[kept]
    firsts, which = _distinct((cause - cause.min(axis=0)).astype(">i8"))  # in their order
    causes = cause[firsts]
    of_value = which[group]
    order = np.argsort(of_value, kind="stable")
    ends = np.searchsorted(of_value[order], np.arange(len(causes) + 1))
    numbers = np.empty(len(causes), np.int64)
    places = np.empty(len(of_value), np.int64)
    for each, (kind, first, second) in enumerate(causes.tolist()):
        mine = order[ends[each] : ends[each + 1]]
        its = dofs[mine]
        known = terms.of(OF_GROUPS[kind], first, second, _distinct_indices(its))
        numbers[each] = known.number
        places[mine] = np.searchsorted(known.dofs, its)
    return _Flat(numbers[which], groups.rows[kept], group, places, impulses[acting])


def _distinct_indices(indices: Any) -> Any:
    """Return the distinct values of indices, in order.

    `np.unique` would load `numpy.ma`, which takes a tenth of the time of a short run's replay.
    """
    return np.flatnonzero(np.bincount(indices))


def _laid_out(
    terms: TermTable, n: int, blocks: list[_Block], flat: _Flat | None, remainder: Any, largest: Any
) -> TermSums:
    """Sort impulses by step, and within a step by term index."""
    numbers = [block.number for block in blocks]
    if flat is not None:
        numbers += _distinct_indices(flat.numbers).tolist()
    active = np.array(sorted(set(numbers)), np.int64)
    widths = np.array([len(terms.made[number][3]) for number in active], np.int64)
    present = np.zeros((n, len(active)), bool)
    for block in blocks:
        present[block.steps, np.searchsorted(active, block.number)] = True
    if flat is not None:
        column = np.searchsorted(active, flat.numbers)
        present[flat.rows, column] = True
    size = np.where(present, widths, 0)
    ends = np.cumsum(size, axis=1)
    starts = np.concatenate([[0], np.cumsum(ends[:, -1])]) if len(active) else np.zeros(n + 1, int)
    values = np.zeros(int(starts[-1]))
    begins = ends - size + starts[:-1, None] if len(active) else size
    for block in blocks:
        at = begins[block.steps, np.searchsorted(active, block.number)]
        values[at[:, None] + np.arange(block.values.shape[1])] += block.values
    if flat is not None:
        at = begins[flat.rows, column]
        np.add.at(values, at[flat.group] + flat.places, flat.values)
    packed = np.packbits(present, axis=1)
    first, which = _distinct(packed)
    known = np.array([terms.pattern(active[present[step]]) for step in first.tolist()], np.int64)
    return TermSums(known[which], values, starts, remainder, largest)


def _distinct(rows: Any) -> tuple[Any, Any]:
    """Return the index of the first row of each distinct value, and each row's index among these.

    NumPy's `unique` of rows compares them number by number, which takes ten times as long. The
    package's own `distinct_bytes` cannot be imported in the script's interpreter.
    """
    size = rows.shape[1] * rows.itemsize
    if not size:
        return np.arange(min(len(rows), 1)), np.zeros(len(rows), np.intp)
    whole = np.ascontiguousarray(rows).view(f"V{size}")[:, 0]
    _, first, which = np.unique(whole, return_index=True, return_inverse=True)
    return first, which
