"""Forces other than constraint forces, by cause, on each degree of freedom.

A `Force` is MuJoCo's own result, or a part of it by the formula that is cited.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from .flags import NO_DAMPER, NO_GRAVITY, NO_SPRING
from .layout import TINY, Layout

JOINTS = (0, 1)
"""Transmission types for a joint (`mjTRN_JOINT`, `mjTRN_JOINTINPARENT`), and for a tendon."""
TENDON = 3


class Force(NamedTuple):
    """The generalised force of one cause, in each of many evaluations."""

    kind: str
    first: int
    """Index of the actuator, joint, body, geom …; -1 if the cause has none."""
    second: int
    """Index of the other geom in a pair, or -1."""
    dofs: Any
    """The degrees of freedom on which it acts; None for all."""
    values: Any
    """The forces, shape (r, dofs)."""


def term(kind: str, values: Any, first: int = -1, dofs: Any = None) -> Force:
    """Make the force of a cause that is not a contact pair."""
    return Force(kind, first, -1, dofs, values)


def smooth(m: Any, layout: Layout, held: dict[str, Any], qfrc: Any, xfrc: Any) -> list[Force]:
    """Return all forces except constraint forces, in each of many evaluations.

    Parameters
    ----------
    m, layout
        The model and its layout, the same in all evaluations.
    held
        The copied arrays, by name, shape (r, elements).
    qfrc, xfrc
        Applied forces, shapes (r, nv) and (r, nbody, 6), or None if nothing was applied.
    """
    gravity = gravity_of(m, layout, held)
    found = [term("gravity", gravity), term("bias", -held["qfrc_bias"] - gravity)]
    found += _passive(m, layout, held)
    found += _actuators(m, layout, held)
    if qfrc is not None:
        found.append(term("applied", qfrc))
    if xfrc is not None:
        found += _pushes(m, layout, held, xfrc)
    return found


def gravity_of(m: Any, layout: Layout, held: dict[str, Any]) -> Any:
    """Return the generalised gravity force, shape (r, nv).

    A dof moves its body's subtree, of mass M and centre of mass c. By `cdof`, one unit of it gives
    c the velocity v = lin + rot × (c - o), where o is the centre of mass of the whole tree. The
    force on the dof is M g · v. `mj_rne` at rest gives the same (`tests/test_mujoco_explain.py`).
    """
    r = len(held["cdof"])
    gravity = np.array(m.opt.gravity)
    if m.opt.disableflags & NO_GRAVITY or not gravity.any():
        return np.zeros((r, layout.nv))
    motions = held["cdof"].reshape(r, -1, 6)
    centres = held["subtree_com"].reshape(r, -1, 3)
    carried = layout.subtree_masses(m)[layout.body][:, None]
    divided_by = np.maximum(np.array(m.body_subtreemass)[layout.body], TINY)[:, None]
    moments = centres[:, layout.body] * divided_by - carried * centres[:, layout.root]
    turned = np.cross(motions[..., :3], moments)
    return (carried * motions[..., 3:] + turned) @ gravity


def _passive(m: Any, layout: Layout, held: dict[str, Any]) -> list[Force]:
    """Return forces of springs, dampers, fluid, gravity compensation, adhesion, and callbacks."""
    rest, found = held["qfrc_passive"], []
    springs, dampers = held["qfrc_spring"], held["qfrc_damper"]
    for tendon in _tendons(m, held):
        found.append(tendon.whole)
        springs = _less(springs, tendon.dofs, tendon.spring)
        dampers = _less(dampers, tendon.dofs, tendon.damper)
        rest = _less(rest, tendon.dofs, tendon.spring + tendon.damper)
    named = [("spring", springs), ("damper", dampers), ("fluid", held["qfrc_fluid"])]
    if "qfrc_adhesion" in held:
        named.append(("adhesion", held["qfrc_adhesion"]))
    by_actuator = np.array(m.jnt_actgravcomp, bool)[layout.joint]
    named.append(("gravity compensation", np.where(by_actuator, 0.0, held["qfrc_gravcomp"])))
    for kind, values in named:
        if values.any():
            found.append(term(kind, values))
            rest = rest - values
    largest = np.abs(held["qfrc_passive"]).max(initial=0.0)
    if np.abs(rest).max(initial=0.0) > ROUNDING * largest:
        found.append(term("passive callback", rest))
    return found


class Stretched(NamedTuple):
    """The spring and damper forces of one tendon."""

    whole: Force
    dofs: Any
    spring: Any
    damper: Any


def _tendons(m: Any, held: dict[str, Any]) -> list[Stretched]:
    """Return the spring and damper forces of tendons (`mj_springdamper`)."""
    found: list[Stretched] = []
    if not m.ntendon:
        return found
    no_spring = bool(m.opt.disableflags & NO_SPRING)
    no_damper = bool(m.opt.disableflags & NO_DAMPER)
    all_stiffness = _coefficients(m, "tendon_stiffness") * (not no_spring)
    all_damping = _coefficients(m, "tendon_damping")
    for tendon, coefficients in _of_actuators(m, (TENDON,)):
        all_damping[tendon] += coefficients
    all_damping *= not no_damper
    for i in np.flatnonzero(all_stiffness.any(axis=1) | all_damping.any(axis=1)).tolist():
        stiffness, damping = all_stiffness[i], all_damping[i]
        length, rate = held["ten_length"][:, i], held["ten_velocity"][:, i]
        lower, upper = m.tendon_lengthspring[i]
        beyond = np.where(length > upper, length - upper, np.minimum(length - lower, 0.0))
        spring = -beyond * polynomial(stiffness, beyond)
        damper = -rate * polynomial(damping, np.abs(rate))
        dofs, arms = _sparse_row(held, m, "ten_J", i)
        parts = arms * spring[:, None], arms * damper[:, None]
        found.append(Stretched(term("tendon", sum(parts), i, dofs), dofs, *parts))
    return found


def _actuators(m: Any, layout: Layout, held: dict[str, Any]) -> list[Force]:
    """Return actuator forces, and as separate causes how much joint force limits reduce forces."""
    found: list[Force] = []
    if not m.nu:
        return found
    total = held["qfrc_actuator"]
    left, forces = total, held["actuator_force"]
    for i in np.flatnonzero(forces.any(axis=0)).tolist():
        dofs, arms = _sparse_row(held, m, "moment", i, "actuator_moment")
        values = arms * forces[:, i, None]
        found.append(term("actuator", values, i, dofs))
        left = _less(left, dofs, values)
    by_actuator = np.array(m.jnt_actgravcomp, bool)[layout.joint]
    if by_actuator.any():
        values = np.where(by_actuator, held["qfrc_gravcomp"], 0.0)
        found.append(term("gravity compensation", values))
        left = left - values
    scale = np.abs(total).max(initial=0.0) + np.abs(left).max(initial=0.0)
    if np.abs(left).max(initial=0.0) > ROUNDING * scale:
        found.append(term("joint force range", left))
    return found


def _pushes(m: Any, layout: Layout, held: dict[str, Any], xfrc: Any) -> list[Force]:
    """Return the effect of `xfrc_applied`, external forces on bodies (`mj_xfrcAccumulate`)."""
    r, found = len(xfrc), []
    motions = held["cdof"].reshape(r, -1, 6)
    origins = held["subtree_com"].reshape(r, -1, 3)
    for body in np.flatnonzero(xfrc.any(axis=(0, 2))):
        dofs = layout.moving[body]
        if not len(dofs):
            continue
        motion = motions[:, dofs]
        arm = held["xipos"].reshape(r, -1, 3)[:, body] - origins[:, m.body_rootid[body]]
        moved = motion[..., 3:] + np.cross(motion[..., :3], arm[:, None])
        push, turn = xfrc[:, body, :3], xfrc[:, body, 3:]
        values = moved @ push[..., None] + motion[..., :3] @ turn[..., None]
        found.append(term("pushed", values[..., 0], int(body), dofs))
    return found


ROUNDING = 1e-13
"""A remainder below this share of a force is rounding, and is not reported as a force of its own.
"""


def polynomial(coefficients: Any, x: Any) -> Any:
    """Return c0 + c1 x + c2 x² … (`mju_polyForce`)."""
    return sum(c * x**power for power, c in enumerate(coefficients))


def _coefficients(m: Any, name: str) -> Any:
    """Return polynomial coefficients: linear, and of higher powers if this version has them."""
    higher = getattr(m, f"{name}poly", np.zeros((len(getattr(m, name)), 0)))
    return np.column_stack([getattr(m, name), higher])


def _of_actuators(m: Any, types: tuple[int, ...]) -> list[tuple[int, Any]]:
    """Return the damping that actuators add to joints or tendons (`mj_actuatorDamping`).

    Pairs of the number of a joint or tendon, and coefficients.
    """
    if not hasattr(m, "actuator_damping"):
        return []
    damped = (m.actuator_damping != 0.0) | (m.actuator_dampingpoly != 0.0).any(axis=1)
    found = []
    for actuator in np.flatnonzero(damped & np.isin(m.actuator_trntype, types)):
        out = m.actuator_outadr[actuator] if hasattr(m, "actuator_outadr") else actuator
        gear = m.actuator_gear[out, 0] ** 2
        coefficients = gear * _coefficients(m, "actuator_damping")[actuator]
        found.append((int(m.actuator_trnid[actuator, 0]), coefficients))
    return found


def damping_of(m: Any) -> Any:
    """Return each dof's damping coefficients, linear first, shape (nv, powers)."""
    damping = _coefficients(m, "dof_damping")
    for joint, coefficients in _of_actuators(m, JOINTS):
        damping[m.dof_jntid == joint] += coefficients
    return damping


def _sparse_row(held: dict[str, Any], m: Any, name: str, i: int, numbers: str = "") -> Any:
    """Return column indices and values, shape (r, columns), of a row of a sparse matrix."""
    numbers = numbers or name
    values = held[numbers]
    counts, starts, columns = (
        held[f"{name}_{part}"]
        if f"{name}_{part}" in held
        else np.array([getattr(m, f"{name}_{part}").ravel()])
        for part in ("rownnz", "rowadr", "colind")
    )
    if not counts.any():  # older versions keep the Jacobian of tendons in full
        return np.arange(m.nv), values[:, i * m.nv : (i + 1) * m.nv]
    count, start = counts[0, i], starts[0, i]
    if (counts[:, i] == count).all() and (starts[:, i] == start).all():
        its = columns[:, start : start + count]
        if (its == its[0]).all():
            return its[0].copy(), values[:, start : start + count]
    # A path that has changed: all columns.
    full = np.zeros((len(values), m.nv))
    for row in range(len(values)):
        which = min(row, len(counts) - 1)
        start, count = starts[which, i], counts[which, i]
        full[row, columns[which, start : start + count]] = values[row, start : start + count]
    return np.arange(m.nv), full


def _less(values: Any, dofs: Any, part: Any) -> Any:
    """Subtract a force on some degrees of freedom from the values on all of them."""
    values = values.copy()
    values[:, dofs] -= part
    return values
