"""Finds the force term that makes the states of an unstable run grow without bound.

Small differences grow if the derivative of a step with respect to its start state has an eigenvalue
above 1. The eigenvector shows the joint that moves; the cause is the term whose force, changed
along the eigenvector, drives that motion most.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from drop_physics.engines.mujoco.importing.gaps import (
    GapTerm,
    actuator_name,
    depths,
    forces_of,
    joint_name,
    names_of,
)
from drop_physics.engines.mujoco.importing.steps import ImportedStep, ImportedSteps, mass_of

Float64 = NDArray[np.float64]

GROWS = 1.2
"""Smallest eigenvalue that counts as unstable: a growth by a factor of six in ten steps, faster
than a body that falls over."""
NUDGE = 1e-6
LOUD = 1e3
"""A control above this many times the largest earlier control, or 1 if that is larger, is itself
the cause of the growth."""
MOST, MOST_BY_STAGES = (4.0, 2.0), (8.0, 2.79)
"""Stability limits of a spring, h² k/I, and of a damper, h b/I: for semi-implicit Euler with forces
from the beginning of the step, and for fourth-order Runge-Kutta (Hairer and Wanner II, IV.2)."""
MOST_DOFS = 100


class GrowingStates(NamedTuple):
    """The cause of unbounded growth from a certain state on."""

    state: int
    term: GapTerm
    factor: float
    """Factor by which a step amplifies a small difference; if a control is too large, its ratio to
    the largest earlier control."""
    joint: str = ""
    unit: str = ""
    """Unit of the joint's position."""
    inertia: float = 0.0
    """Inertia of the unstable mode [kg or kg m²]."""
    stiffness: float = 0.0
    """The term's stiffness, times h² over the inertia."""
    damping: float = 0.0
    """The term's damping, times h over the inertia."""
    most: tuple[float, float] = MOST
    """The largest such stiffness without damping, and the largest such damping, that are stable."""
    depth_m: float = 0.0
    """Penetration depth of two bodies, if the term is their contact [m]."""
    loud: float = 0.0
    """The control of an actuator, if that control alone is too large; otherwise 0."""


def growth_of(steps: ImportedSteps, last: Sequence[ImportedStep]) -> GrowingStates | None:
    """Return why states grow in the last steps of a run; None if they do not grow."""
    m = steps.m
    if not last or not 0 < m.nv <= MOST_DOFS:
        return None
    found, first = None, len(last)
    for first in range(len(last) - 1, -1, -1):
        its = _mode(steps, last[first])
        if its is None:
            first += 1
            break
        found = its
    loudest = 1.0
    for at, step in enumerate(last[: first + 2]):
        if not step.near:  # whose controls may be anything
            continue
        given = np.abs(step.ctrl)
        if at >= max(first - 1, 1) and given.size and given.max() > LOUD * loudest:
            which = int(np.argmax(given))
            term = GapTerm("actuator", (actuator_name(m, which),))
            most = float(given[which])
            return GrowingStates(step.number, term, most / loudest, loud=most)
        loudest = max(loudest, float(given.max(initial=0.0)))
    return found


def _mode(steps: ImportedSteps, step: ImportedStep) -> GrowingStates | None:
    """Return the deviation that a step amplifies most; None if no step amplifies much."""
    m, d = steps.m, steps.evaluated(step)
    slope = _slope(steps, step)
    if not np.isfinite(slope).all():
        return None
    values, modes = np.linalg.eig(slope)
    at = int(np.argmax(np.abs(values)))
    if np.abs(values[at]) < GROWS:
        return None
    mode = np.real(modes[:, at])
    way, rate = mode[: m.nv], mode[m.nv : 2 * m.nv]
    mass = mass_of(m, d)
    dof = int(np.argmax(rate * (mass @ rate)))
    joint = int(m.dof_jntid[dof])
    # The change of each term along the mode, by its part along the rates that grow.
    d = steps.evaluated(step)
    base = dict(_forces(m, d))
    size = NUDGE / max(float(np.abs(mode).max()), 1e-12)
    both = {}
    for what, (by_way, by_rate) in {"both": (1, 1), "way": (1, 0), "rate": (0, 1)}.items():
        other = steps.evaluated(step)
        mujoco.mj_integratePos(m, other.qpos, size * way * by_way, 1.0)
        other.qvel[:] += size * rate * by_rate
        mujoco.mj_forward(m, other)
        forces = dict(_forces(m, other))
        both[what] = {
            term: float(rate @ (forces.get(term, 0.0) - base.get(term, 0.0))) / size
            for term in {*forces, *base}
        }
    # What drives the mode pushes where the step takes it; what only answers pushes back. The stages
    # of Runge and Kutta push to and fro.
    drives = 1.0 if np.real(values[at]) > 1.0 else -1.0
    pushes = {each: drives * push for each, push in both["both"].items()}
    if m.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4:
        pushes = {each: abs(push) for each, push in pushes.items()}
    term = max(pushes, key=lambda each: pushes[each])
    inertia, h = float(rate @ mass @ rate), float(m.opt.timestep)
    along, against = float(rate @ rate), float(way @ rate)
    stiffness = -both["way"].get(term, 0.0) * along / against if against else 0.0
    slides = int(m.jnt_type[joint]) in (0, 2) and dof - int(m.jnt_dofadr[joint]) < 3
    return GrowingStates(
        step.number,
        term,
        float(np.abs(values[at])),
        joint_name(m, joint),
        "m" if slides else "rad",
        inertia / float(rate[dof] ** 2),
        stiffness * h * h / inertia,
        -both["rate"].get(term, 0.0) * h / inertia,
        most=MOST_BY_STAGES if m.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4 else MOST,
        depth_m=dict(depths(m, d)).get(term, 0.0),
    )


def _slope(steps: ImportedSteps, step: ImportedStep) -> Float64:
    """Return the derivative of a step with respect to its start state, shape (2n, 2n)."""
    m = steps.m
    way, base, ends = np.zeros(m.nv), np.zeros(m.nq), []
    for number in range(-1, 2 * m.nv):
        d = steps.evaluated(step)
        if 0 <= number < m.nv:
            mujoco.mj_integratePos(m, d.qpos, np.eye(m.nv)[number], NUDGE)
        elif number >= m.nv:
            d.qvel[number - m.nv] += NUDGE
        mujoco.mj_step(m, d)
        if number < 0:
            base[:] = d.qpos
        mujoco.mj_differentiatePos(m, way, NUDGE, base, d.qpos)
        ends.append(np.concatenate([way, d.qvel / NUDGE]))
    ways = np.stack(ends[1:], axis=1)
    ways[m.nv :] -= ends[0][m.nv :, None]
    return np.asarray(ways, np.float64)


def _forces(m: Any, d: Any) -> Iterator[tuple[GapTerm, Float64]]:  # noqa: ANN401
    """Yield each force term's name and generalised force, shape (nv,)."""
    yield from forces_of(m, d)
    yield GapTerm("Coriolis and gyroscopic forces"), -np.array(d.qfrc_bias)
    pairs: dict[GapTerm, Float64] = {}
    wrench = np.zeros(6)
    for number in range(d.ncon):
        contact = d.contact[number]
        mujoco.mj_contactForce(m, d, number, wrench)
        force = contact.frame.reshape(3, 3).T @ wrench[:3]
        total = pairs.setdefault(GapTerm("contacts", names_of(m, contact.geom)), np.zeros(m.nv))
        for geom, sign in zip(contact.geom, (-1.0, 1.0), strict=True):
            if geom >= 0:
                body = int(m.geom_bodyid[geom])
                mujoco.mj_applyFT(m, d, sign * force, np.zeros(3), contact.pos, body, total)
    yield from pairs.items()
