"""Finds the force terms that explain how another engine's steps differ from MuJoCo's.

A term explains a velocity difference that its force can cause: one along the term's generalised
force, or along the Jacobian rows of two bodies' contacts. The effect of a force is measured, by
steps with a small additional force, so that it includes the response of contacts. If several terms
explain a difference, the term that explains most steps is reported.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import dataclass
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from drop_physics.engines.mujoco.explain.forces import gravity_of
from drop_physics.engines.mujoco.explain.layout import Layout
from drop_physics.engines.mujoco.importing.steps import (
    ImportedStep,
    ImportedSteps,
    mass_of,
    moments,
)

Float64 = NDArray[np.float64]

LEFT, MOSTLY = 0.02, 0.25
"""Share of a gap's energy that a term may leave in a step that identifies it, and in a step that is
attributed to a term identified by others."""
SAME, AGREE, OFTEN = 0.1, 0.6, 0.8
"""Tolerance for equal factors, as a share of their distance from 1; the share of steps whose
factors must be equal; and how many steps a term must explain, as a share of those that the best
term explains."""
LEAST, FEWEST = 1e-3, 3
"""Smallest change of a factor that counts, and fewest steps that must agree on it."""
MOST_OF_ALL = 0.75
"""Contacts together count as one term only if their Jacobian spans at most this share of the
degrees of freedom."""
HALF, TENTH = 0.5, 0.1
"""Share of the steps that a term must explain to be reported: a force whose factors do not agree,
and a constraint."""
MOST_DOFS = 100
"""Largest number of degrees of freedom of a model whose gaps are attributed to terms."""
FIRST, EVERY = 200, 50
"""All of this many first steps with a gap are examined, and then every so many."""


class GapTerm(NamedTuple):
    """A force term that may differ between the engines."""

    kind: str
    """The kind, as in a `Gap`."""
    names: tuple[str, ...] = ()


class Fit(NamedTuple):
    """How well one force term explains the velocity difference of a step."""

    left: float
    """The share of the gap's energy that remains."""
    factor: float
    """Ratio of the other engine's force to MuJoCo's; nan for a constraint."""


@dataclass(frozen=True)
class Gap:
    """A force term that explains differences, and the steps in which it does."""

    kind: str
    """The term's kind: `contacts`, `limit`, `equality`, `friction loss`, `tendon`, `actuator`,
    `damper`, `gravity`, `spring`, `fluid`, `gravity compensation`, `positions`, `everything`."""
    names: Sequence[str]
    """The two touching bodies, the actuator, or the joint."""
    steps: int
    """Number of examined steps that the term explains."""
    first: int
    """The first step that the term explains, by the state from which it starts."""
    apart: float
    """The largest velocity difference [m/s or rad/s]."""
    factor: float | None
    """Ratio of the other engine's force to MuJoCo's in most steps; None if the steps disagree."""
    depth_m: float
    """Penetration depth of the two bodies in the first explained step [m]."""


class _Looked(NamedTuple):
    """One examined step: each term's fit, and the unexplained remainder."""

    number: int
    apart: float
    fits: Mapping[GapTerm, Fit]
    depths_m: Mapping[GapTerm, float]


EVERYTHING, POSITIONS = GapTerm("everything"), GapTerm("positions")


class Gaps:
    """Collects steps that differ from MuJoCo's, and the force terms that explain why.

    Parameters
    ----------
    steps
        MuJoCo's steps from the recorded states.
    """

    def __init__(self, steps: ImportedSteps) -> None:
        self._of, self._m = steps, steps.m
        self._layout = Layout(self._m, mujoco.MjData(self._m))
        self._looked: list[_Looked] = []
        self._cleared: set[GapTerm] = set()
        """Terms that act in a step without a gap, directly before a step with a gap: probably not
        the cause."""
        self._before: ImportedStep | None = None
        self.steps = 0
        self.first = -1
        """The first step with a gap, by its start state; -1 if there is none."""

    @property
    def looked_at(self) -> int:
        """Number of examined steps."""
        return len(self._looked)

    def add(self, step: ImportedStep) -> None:
        """Examine a step in which the other engine's velocities differ from MuJoCo's."""
        if step.near:
            self._before = step
            return
        if self._before is not None and self.steps < FIRST:
            self._cleared |= self._acting(self._before)
        self._before = None
        if not self.steps:
            self.first = step.number
        self.steps += 1
        if self.steps <= FIRST or not self.steps % EVERY:
            fits = self._fits(step)
            apart = float(np.abs(step.gap).max(initial=0.0))
            touching = dict(depths(self._m, self._of.evaluated(step))) if fits else {}
            self._looked.append(_Looked(step.number, apart, fits, touching))

    def in_order(self) -> list[Gap]:
        """Return the explaining terms with their steps, the most frequent term first."""
        left, found = [*self._looked], dict[GapTerm, list[_Looked]]()
        while left:
            term = _named_by_most(left, self._cleared)
            if term is None:
                break
            found[term] = [each for each in left if term in _good(each)]
            left = [each for each in left if term not in _good(each)]
        for each in left:
            near = {term: each.fits[term].left for term in found if term in each.fits}
            best = min(near, key=lambda term: near[term], default=EVERYTHING)
            kept = best if near.get(best, 1.0) <= MOSTLY else EVERYTHING
            found.setdefault(kept, []).append(each)
        gaps = [_gap(term, its) for term, its in found.items()]
        return sorted(gaps, key=lambda gap: (-gap.steps, gap.first))

    def _acting(self, step: ImportedStep) -> set[GapTerm]:
        """Return the terms that act in a step."""
        d = self._of.evaluated(step)
        smooth = {term for term, force in _smooth(self._m, d, self._layout) if force.any()}
        return smooth | _constraints(self._m, d).keys()

    def _fits(self, step: ImportedStep) -> dict[GapTerm, Fit]:
        """Return how well each term explains a step's velocity difference."""
        m, d = self._m, self._of.evaluated(step)
        if step.moved:
            return {POSITIONS: Fit(0.0, np.nan)}
        if m.nv > MOST_DOFS or not np.isfinite(step.gap).all():
            return {}
        try:
            root = np.linalg.cholesky(mass_of(m, d)).T
        except np.linalg.LinAlgError:
            return {}
        gap = root @ step.gap

        def left(rest: Float64) -> float:
            """Return the share of the difference's energy that stays unexplained."""
            rates = np.abs(np.linalg.solve(root, rest))
            return float(rest @ rest) / float(gap @ gap) if (rates > step.allowed).any() else 0.0

        smooth = [
            (term, _at_the_end(force, d.qvel, step) if term.kind == "damper" else force)
            for term, force in _smooth(m, d, self._layout)
        ]
        rows = _constraints(m, d)
        size = max(1e-6, *(float(np.abs(force).max(initial=0.0)) for _, force in smooth))
        answers = root @ self._answer(step, 1e-3 * size, constrained=True)
        found = {}
        for term, force in smooth:
            way = answers @ force
            if way @ way > 0.0:
                more = float(gap @ way) / float(way @ way)
                if abs(more) > LEAST:
                    found[term] = Fit(left(gap - more * way), 1.0 + more)
        free = root @ self._answer(step, 1e-3 * size, constrained=False)
        if len(rows) > 1 and any(term.kind == "contacts" for term in rows):
            rows[GapTerm("contacts")] = np.concatenate(
                [its for term, its in rows.items() if term.kind == "contacts"]
            )
        for term, its in rows.items():
            base, sizes, _ = np.linalg.svd(free @ its.T, full_matrices=False)
            base = base[:, sizes > 1e-9 * sizes.max(initial=0.0)]
            if not term.names and base.shape[1] > MOST_OF_ALL * m.nv:
                continue  # they could do anything
            found[term] = Fit(left(gap - base @ (base.T @ gap)), np.nan)
        return found

    def _answer(self, step: ImportedStep, force: float, *, constrained: bool) -> Float64:
        """Return the velocity change in a step per unit of force on each dof, shape (nv, nv)."""
        m, flags = self._m, int(self._m.opt.disableflags)
        if not constrained:
            m.opt.disableflags = flags | int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
        try:
            base = self._of.reached(step, np.zeros(m.nv))
            columns = [self._of.reached(step, force * unit) - base for unit in np.eye(m.nv)]
        finally:
            m.opt.disableflags = flags
        return np.stack(columns, axis=1) / force


def _at_the_end(force: Float64, before: Float64, step: ImportedStep) -> Float64:
    """Return damper forces at a step's end velocity, where MuJoCo's integrators take them."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = force * (step.rates / before)
    return np.where(np.isfinite(ends), ends, 0.0)


def _good(looked: _Looked) -> set[GapTerm]:
    """Return the terms that explain a step's velocity difference."""
    return {term for term, fit in looked.fits.items() if fit.left <= LEFT}


def _named_by_most(left: list[_Looked], cleared: Set[GapTerm]) -> GapTerm | None:
    """Return the term that explains the most steps; of similar ones, the most plausible.

    A term that also acts in steps without a gap is chosen only if there is no other.
    """
    terms = {term for each in left for term in _good(each)}
    named = {term: [each for each in left if term in _good(each)] for term in terms}
    named = {term: its for term, its in named.items() if _is_meant(term, its, len(left))}
    most = max(map(len, named.values()), default=0)
    if not most:
        return None

    def rank(term: GapTerm) -> tuple[bool, bool, bool, bool, int, int]:
        its = named[term]
        factor, share = _factor(term, its)
        rare = len(its) < OFTEN * most
        agree = len(its) >= FEWEST and share >= AGREE
        # Solvers differ most in contacts; and a single pair is named before all pairs.
        names = -len(term.names)
        return rare, term in cleared, not agree, np.isfinite(factor), names, -len(its)

    return min(sorted(named), key=rank)


def _is_meant(term: GapTerm, its: list[_Looked], left: int) -> bool:
    """Return whether a term explains enough steps not to do so by chance."""
    factor, share = _factor(term, its)
    if np.isfinite(factor):  # along one force: any push on one joint may look like it
        return (len(its) >= FEWEST and share >= AGREE) or len(its) >= HALF * left
    return len(its) >= TENTH * left


def _factor(term: GapTerm, its: list[_Looked]) -> tuple[float, float]:
    """Return the median ratio of the other engine's term to MuJoCo's, and how many steps agree."""
    factors = np.array([each.fits[term].factor for each in its if term in each.fits])
    if not len(factors) or not np.isfinite(factors).all():
        return np.nan, 0.0
    middle = float(np.median(factors))
    return middle, float((np.abs(factors - middle) <= SAME * abs(middle - 1.0)).mean())


def _gap(term: GapTerm, its: list[_Looked]) -> Gap:
    factor, share = _factor(term, its)
    return Gap(
        *term,
        len(its),
        its[0].number,
        max(each.apart for each in its),
        factor if share >= AGREE else None,
        its[0].depths_m.get(term, max(its[0].depths_m.values(), default=0.0)),
    )


def _constraints(m: Any, d: Any) -> dict[GapTerm, Float64]:  # noqa: ANN401
    """Return the Jacobian rows of all active constraints, by term."""
    of, found = mujoco.mjtConstraint, dict[GapTerm, list[int]]()
    for row, (kind, number) in enumerate(zip(d.efc_type.tolist(), d.efc_id.tolist(), strict=True)):
        if kind == of.mjCNSTR_EQUALITY:
            term = GapTerm("equality", (m.equality(number).name or f"equality{number}",))
        elif kind == of.mjCNSTR_FRICTION_DOF:
            term = GapTerm("friction loss", (joint_name(m, int(m.dof_jntid[number])),))
        elif kind == of.mjCNSTR_LIMIT_JOINT:
            term = GapTerm("limit", (joint_name(m, number),))
        elif kind in (of.mjCNSTR_FRICTION_TENDON, of.mjCNSTR_LIMIT_TENDON):
            term = GapTerm("tendon", (m.tendon(number).name or f"tendon{number}",))
        else:
            term = GapTerm("contacts", names_of(m, d.contact[number].geom))
        found.setdefault(term, []).append(row)
    if not found:
        return {}
    dense = np.zeros((d.nefc, m.nv))
    if mujoco.mj_isSparse(m):
        columns = d.efc_J_colind.ravel()
        mujoco.mju_sparse2dense(dense, d.efc_J.ravel(), d.efc_J_rownnz, d.efc_J_rowadr, columns)
    else:
        dense[:] = d.efc_J.reshape(d.nefc, m.nv)
    return {term: dense[rows] for term, rows in found.items()}


def depths(m: Any, d: Any) -> Iterator[tuple[GapTerm, float]]:  # noqa: ANN401
    """Yield the penetration depth of each pair of bodies [m]."""
    deepest: dict[GapTerm, float] = {}
    for contact in d.contact:
        term = GapTerm("contacts", names_of(m, contact.geom))
        deepest[term] = max(deepest.get(term, 0.0), -float(contact.dist))
    yield from deepest.items()


def names_of(m: Any, geoms: Any) -> tuple[str, ...]:  # noqa: ANN401
    """Return the names of the bodies to which two geoms belong."""
    bodies = [int(m.geom_bodyid[geom]) for geom in geoms if geom >= 0]
    return tuple(sorted(m.body(each).name or f"body{each}" for each in bodies))


def joint_name(m: Any, joint: int) -> str:  # noqa: ANN401
    """Return the name of a joint, or its index."""
    return str(m.joint(joint).name or f"joint{joint}")


def actuator_name(m: Any, actuator: int) -> str:  # noqa: ANN401
    """Return the name of an actuator, or its index."""
    return str(m.actuator(actuator).name or f"actuator{actuator}")


def forces_of(m: Any, d: Any) -> Iterator[tuple[GapTerm, Float64]]:  # noqa: ANN401
    """Yield the forces of actuators, springs, dampers and fluids, shape (nv,) each."""
    arms = moments(m, d)
    for number in range(m.nu):
        yield (
            GapTerm("actuator", (actuator_name(m, number),)),
            arms[number] * d.actuator_force[number],
        )
    for kind in ("spring", "damper"):
        held = np.array(getattr(d, f"qfrc_{kind}"))
        if m.ntendon and held.any():  # which tendon's, or the joints' own, is not told apart
            yield GapTerm(f"joint and tendon {kind}s"), held
            continue
        for dof in np.flatnonzero(held).tolist():
            one = np.zeros(m.nv)
            one[dof] = held[dof]
            yield GapTerm(kind, (joint_name(m, int(m.dof_jntid[dof])),)), one
    yield GapTerm("fluid"), np.array(d.qfrc_fluid)


def _smooth(m: Any, d: Any, layout: Layout) -> Iterator[tuple[GapTerm, Float64]]:  # noqa: ANN401
    """Yield candidate smooth forces, shape (nv,): first each alone, then each kind together."""
    together: dict[str, list[Float64]] = {}
    for term, force in forces_of(m, d):
        together.setdefault(term.kind, []).append(force)
        yield term, force
    for kind, forces in together.items():
        if len(forces) > 1:
            yield GapTerm(kind), np.sum(forces, axis=0)
    held = {"cdof": d.cdof[None], "subtree_com": d.subtree_com[None]}
    yield GapTerm("gravity"), gravity_of(m, layout, held)[0]
    yield GapTerm("gravity compensation"), np.array(d.qfrc_gravcomp)
