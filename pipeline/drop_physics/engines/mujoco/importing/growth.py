"""Why states grow without bound: the step multiplies what is off, by which term.

The derivative of a step by its state (`mjd_transitionFD`) has an eigenvalue of more than 1 where a
small difference grows. Its mode says in which joint, and the change of each term's force along the
mode says by which: the one that pushes most of it.
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
"""An eigenvalue above this is no motion that falls over: in ten steps it is sixfold."""
NUDGE = 1e-6
LOUD = 1e3
"""A force of so many times the largest one before is no motion of the same run."""
MOST_DOFS = 100


class GrowingStates(NamedTuple):
    """Why states grow from one on."""

    state: int
    term: GapTerm
    factor: float
    """What a step multiplies a small difference by; of a loud force, the force over the largest
    before."""
    joint: str = ""
    unit: str = ""
    """Unit of the joint's position."""
    inertia: float = 0.0
    """What the mode moves [kg or kg m²]."""
    stiffness: float = 0.0
    """The term's, times h² over the inertia."""
    damping: float = 0.0
    """The term's, times h over the inertia."""
    depth_m: float = 0.0
    """How deep two bodies are in each other, where the term is their contact [m]."""
    loud: float = 0.0
    """The force [N or N m], where it is large of itself; else 0."""


def growth_of(steps: ImportedSteps, last: Sequence[ImportedStep]) -> GrowingStates | None:
    """Return why the states grow in the last steps of a run; None where that is not seen."""
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
    for at, step in enumerate(last[: first + 1]):
        force = np.abs(steps.evaluated(step).actuator_force)
        if at >= max(first - 1, 1) and force.size and force.max() > LOUD * loudest:
            which = int(np.argmax(force))
            term = GapTerm("actuator", (actuator_name(m, which),))
            most = float(force[which])
            return GrowingStates(step.number, term, most / loudest, loud=most)
        loudest = max(loudest, float(force.max(initial=0.0)))
    return found


def _mode(steps: ImportedSteps, step: ImportedStep) -> GrowingStates | None:
    """Return the mode in which a step multiplies what is off most; None if it grows little."""
    m, d = steps.m, steps.evaluated(step)
    size = 2 * m.nv + m.na
    slope = np.zeros((size, size))
    mujoco.mjd_transitionFD(m, d, NUDGE, 1, slope, None, None, None)
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
    term = max(both["both"], key=lambda each: abs(both["both"][each]))
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
        depth_m=dict(depths(m, d)).get(term, 0.0),
    )


def _forces(m: Any, d: Any) -> Iterator[tuple[GapTerm, Float64]]:  # noqa: ANN401
    """Yield forces by their term, shape (nv,)."""
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
