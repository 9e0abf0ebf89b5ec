"""Index arrays into MuJoCo's packed matrices, to process many steps at once."""

from __future__ import annotations

from typing import Any

import numpy as np

FREE, BALL, SLIDE, HINGE = 0, 1, 2, 3
"""Joint types (`mjtJoint`)."""
DOFS = (6, 3, 1, 1)
"""Degrees of freedom of each joint type."""
TINY = 1e-15
"""`mjMINVAL`: a lighter subtree uses its own body's centre of mass."""


def either(m: Any, d: Any, name: str) -> Any:
    """Return an array that, depending on the version, belongs to MjModel or MjData."""
    return getattr(m, name) if hasattr(m, name) else getattr(d, name)


class Symmetric:
    """Index arrays for symmetric matrices of which MuJoCo stores one triangle.

    Parameters
    ----------
    rows, columns
        The row and the column of each stored number, in the order of memory.
    n
        The number of rows of the matrix.
    """

    def __init__(self, rows: Any, columns: Any, n: int) -> None:
        self.rows, self.columns, self.n = rows, columns, n
        below = np.flatnonzero(rows != columns)
        entry = np.concatenate([np.arange(len(rows)), below])
        row = np.concatenate([rows, columns[below]])
        column = np.concatenate([columns, rows[below]])
        order = np.argsort(row, kind="stable")
        self._entry, self._column = entry[order], column[order]
        self._starts = np.searchsorted(row[order], np.arange(n))

    def times(self, numbers: Any, vectors: Any) -> Any:
        """Multiply matrices by vectors; numbers (r, entries), vectors (r, n), result (r, n)."""
        if not self.n:
            return np.zeros_like(vectors)
        products = numbers[:, self._entry] * vectors[:, self._column]
        return np.add.reduceat(products, self._starts, axis=1)

    def block(self, numbers: Any, dofs: Any) -> Any:
        """Return a dense block of rows and columns, shape (r, len(dofs), len(dofs))."""
        place = np.full(self.n, -1)
        place[dofs] = np.arange(len(dofs))
        mine = np.flatnonzero((place[self.rows] >= 0) & (place[self.columns] >= 0))
        full = np.zeros((len(numbers), len(dofs), len(dofs)))
        rows, columns = place[self.rows[mine]], place[self.columns[mine]]
        full[:, rows, columns] = numbers[:, mine]
        full[:, columns, rows] = numbers[:, mine]
        return full


class Layout:
    """Index arrays and constants of a model that its steps do not change.

    Parameters
    ----------
    m, d
        The MjModel, and an MjData of it.
    """

    def __init__(self, m: Any, d: Any) -> None:
        self.nv, self.nbody = m.nv, m.nbody
        self.mass_name = "M" if hasattr(d, "M") and hasattr(m, "M_rowadr") else "qM"
        self.mass = self._mass(m)
        counts, starts = either(m, d, "D_rownnz"), either(m, d, "D_rowadr")
        self.d_rows = np.repeat(np.arange(m.nv), counts)
        self.d_columns = np.array(either(m, d, "D_colind"))[: len(self.d_rows)]
        self.d_starts = np.array(starts)
        self.coupled, self.slopes = self._slopes(m)
        bodies = np.array(m.dof_bodyid)
        self.body, self.root = bodies, np.array(m.body_rootid)[bodies]
        self.joint = np.array(m.dof_jntid)
        self.moving = [self._chain(m, body) for body in range(m.nbody)]
        """The degrees of freedom that move each body."""
        self.trees = [np.flatnonzero(m.dof_treeid == tree) for tree in range(m.ntree)]
        free = np.flatnonzero(m.jnt_type == FREE)
        alone = [
            j
            for j in free
            if len(self.trees[m.dof_treeid[m.jnt_dofadr[j]]]) == DOFS[FREE]
            and m.body_subtreemass[m.jnt_bodyid[j]] == m.body_mass[m.jnt_bodyid[j]]
        ]
        self.alone = np.array([m.jnt_dofadr[j] for j in alone], int)
        """The first degree of freedom of each body that moves freely and carries no other."""
        self.alone_at = np.array([m.jnt_qposadr[j] for j in alone], int)
        """Index in `qpos` of the first coordinate of each such body."""

    def _mass(self, m: Any) -> Symmetric:
        if self.mass_name == "M":
            row = np.repeat(np.arange(m.nv), m.M_rownnz)
            return Symmetric(row, np.array(m.M_colind)[: len(row)], m.nv)
        rows: list[int] = []
        columns: list[int] = []
        for dof in range(m.nv):  # each row goes from the diagonal to the root
            other = dof
            while other >= 0:
                rows.append(dof)
                columns.append(other)
                other = m.dof_parentid[other]
        return Symmetric(np.array(rows, int), np.array(columns, int), m.nv)

    def _slopes(self, m: Any) -> tuple[Any, Symmetric]:
        """Return where `implicitfast` keeps its velocity derivatives of forces.

        `implicitfast` keeps the lower half of these derivatives, wherever the mass matrix may have
        entries. For a simple body these lie on the diagonal, the only part of its rows that old
        versions (`qM`) use.
        """
        pairs = {*zip(self.mass.rows.tolist(), self.mass.columns.tolist())}
        if self.mass_name == "qM":
            pairs -= {(i, j) for i, j in pairs if i != j and m.dof_simplenum[i]}
        entries = zip(self.d_rows.tolist(), self.d_columns.tolist())
        kept = np.array([i for i, pair in enumerate(entries) if pair in pairs], int)
        return kept, Symmetric(self.d_rows[kept], self.d_columns[kept], self.nv)

    def _chain(self, m: Any, body: int) -> Any:
        found: list[int] = []
        while body > 0:
            first, count = m.body_dofadr[body], m.body_dofnum[body]
            found += range(first, first + count)
            body = m.body_parentid[body]
        return np.array(sorted(found), int)

    def subtree_masses(self, m: Any) -> Any:
        """Return the mass of each body with its whole subtree [kg], shape (nbody,)."""
        masses = np.array(m.body_mass)
        for body in range(m.nbody - 1, 0, -1):
            masses[m.body_parentid[body]] += masses[body]
        return masses
