"""Impulses that MuJoCo's integrators add to those of the forces, and the solver's residual.

Each integrator solves for the acceleration a = (u' - u)/h:

    Euler, without dampers        a is the solver's qacc, so M a - forces is what the solver left
    Euler, with dampers           (M + h D) a = forces, D the slope of the dampers (`mj_EulerSkip`)
    implicit                      (M - h J) a = forces, J their slope (`mj_implicitSkip`)
    implicitfast                  the same, without the slope of the bias, and J symmetric; bodies
                                  that move freely have both (since 3.11)
    RK4                           a = sum of b_i a_i over four stages (`added_by_stages`)
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .flags import NO_EULERDAMP
from .forces import Force, damping_of, polynomial, term
from .layout import BALL, FREE, Layout

EULER, RK4, IMPLICIT, IMPLICITFAST = 0, 1, 2, 3
"""`mjtIntegrator`."""
INTEGRATOR, SOLVER = "integrator", "solver"
STAGES = 4
WEIGHTS = (1 / 6, 1 / 3, 1 / 3, 1 / 6)
"""The weights of RK4's stages."""
MUNTHE_KAAS = (4, 0)
"""The first version whose RK4 rotates bodies by the Munthe-Kaas method; earlier ones rotate by the
mean angular velocity."""
MOVED_BY = 1e-12
"""Largest distance between a recorded pose and the pose that the velocities lead to, up to which it
counts as rounding [m, rad]; 2e-15 was measured."""
GYROSCOPIC_SINCE = (3, 11)
"""The first version whose implicitfast includes the bias derivative of free bodies."""


def left_by_solver(layout: Layout, held: dict[str, Any]) -> Any:
    """Return M qacc minus all forces, shape (r, nv): the solver's residual."""
    forces = held["qfrc_smooth"] + held["qfrc_constraint"]
    return layout.mass.times(held[layout.mass_name], held["qacc"]) - forces


def added(
    m: Any,
    layout: Layout,
    held: dict[str, Any],
    integrator: int,
    h: Any,
    before: dict[str, Any],
    change: Any,
    version: tuple[int, ...],
) -> Force:
    """Return the impulse by which an integrator's step differs from h times the forces.

    Parameters
    ----------
    m, layout, held
        The model, its layout, and the copied arrays by name.
    integrator
        The integrator, as MuJoCo numbers it (`mjtIntegrator`).
    h
        Timesteps [s], shape (n,).
    before
        `qpos` and `qvel` before each step.
    change
        u' - u, shape (n, nv).
    version
        The version of MuJoCo.
    """
    if integrator == EULER:
        damping = damping_of(m)
        if m.opt.disableflags & NO_EULERDAMP or not damping.any():
            return term(SOLVER, h[:, None] * left_by_solver(layout, held))
        powers = np.arange(1, damping.shape[1] + 1)
        slope = polynomial((damping * powers).T, np.abs(before["qvel"]))
        return term(INTEGRATOR, -h[:, None] * slope * change)
    slopes, n = held["qDeriv"], len(change)
    if integrator == IMPLICITFAST:
        values = layout.slopes.times(slopes[:, layout.coupled], change)
        if version >= GYROSCOPIC_SINCE:
            for at, dof in zip(layout.alone_at, layout.alone):
                its = slice(dof, dof + 6)
                block = _rows(layout, slopes, dof) - _bias_slope(m, layout, held, before, at, dof)
                values[:, its] = (block @ change[:, its, None])[..., 0]
    else:
        products = slopes * change[:, layout.d_columns]
        values = np.add.reduceat(products, layout.d_starts, axis=1) if n else products
    return term(INTEGRATOR, h[:, None] * values)


def averaged(values: Any) -> Any:
    """Return the mean over four stages with RK4's weights, from shape (4 n, k) to (n, k)."""
    stages = values.reshape(len(values) // STAGES, STAGES, *values.shape[1:])
    return np.tensordot(np.array(WEIGHTS), stages, (0, 1))


def added_by_stages(layout: Layout, held: dict[str, Any]) -> list[Force]:
    """Return RK4's deviation from the mean of its stages' forces, as a force, shape (n, nv).

    u' - u = h sum of b_i a_i, and M_i a_i = forces + the solver's residual. So with the mass matrix
    of the first stage, M_1 (u' - u) is h sum of b_i (forces + solver + (M_1 - M_i) a_i).
    """
    numbers, accelerations = held[layout.mass_name], held["qacc"]
    first = np.repeat(numbers[::STAGES], STAGES, axis=0)
    return [
        term(SOLVER, averaged(left_by_solver(layout, held))),
        term(INTEGRATOR, averaged(layout.mass.times(first - numbers, accelerations))),
    ]


def strays_by_stages(
    m: Any, rates: Any, h: Any, before: Any, after: Any, version: tuple[int, ...]
) -> Any:
    """Return how far poses are from where RK4's stage velocities lead [m, rad], shape (n,).

    `rates` has the shape (n, 4, nv), poses (n, nq). From version `MUNTHE_KAAS` on, each stage's
    rotation is first transformed back to the axes of the first stage, as MuJoCo does.
    """
    h = h[:, None]
    moves = np.tensordot(np.array(WEIGHTS), rates, (0, 1)) * h
    off = np.zeros(len(rates))
    for kind, at, dof in zip(m.jnt_type, m.jnt_qposadr, m.jnt_dofadr):
        straight = {FREE: 3, BALL: 0}.get(int(kind), 1)
        way = after[:, at : at + straight] - before[:, at : at + straight]
        differs = np.abs(way - moves[:, dof : dof + straight]) / (
            1.0 + np.abs(after[:, at : at + straight])
        )
        off = np.maximum(off, differs.max(axis=1, initial=0.0))
        if kind not in (FREE, BALL):
            continue
        at, dof = at + straight, dof + straight
        turn = moves[:, dof : dof + 3]
        if version >= MUNTHE_KAAS:
            a, b, c, d = np.moveaxis(rates[:, :, dof : dof + 3], 1, 0)
            b = _taken_back(h / 2 * a, b)
            c = _taken_back(h / 2 * b, c)
            turn = h * (a + 2 * b + 2 * c + _taken_back(h * c, d)) / 6
        reached = _matrices(before[:, at : at + 4]) @ _matrices(_turn(turn))
        differs = np.abs(reached - _matrices(after[:, at : at + 4]))
        off = np.maximum(off, differs.max(axis=(1, 2), initial=0.0))
    return off


def _turn(vectors: Any) -> Any:
    """Convert rotation vectors [rad] to quaternions, real part first, shape (n, 4)."""
    half = np.linalg.norm(vectors, axis=1, keepdims=True) / 2
    return np.hstack([np.cos(half), np.sinc(half / np.pi) * vectors / 2])


def _taken_back(turn: Any, spin: Any) -> Any:
    """Return the inverse derivative of the exponential map at a rotation vector, shape (n, 3).

    k + u × k / 2 + (1 - θ/2 cot θ/2)/θ² u × (u × k), with θ = |u| (Munthe-Kaas).
    """
    angle = np.linalg.norm(turn, axis=1, keepdims=True)
    small = angle < 1e-3
    half = np.where(small, 1.0, angle) / 2
    share = np.where(small, 1 / 12 + angle**2 / 720, (1 - half / np.tan(half)) / (4 * half**2))
    once = np.cross(turn, spin)
    return spin + once / 2 + share * np.cross(turn, once)


def _rows(layout: Layout, slopes: Any, dof: int) -> Any:
    """Return a free body's 6 × 6 block of the slopes, shape (n, 6, 6)."""
    mine = np.flatnonzero((layout.d_rows >= dof) & (layout.d_rows < dof + 6))
    block = np.zeros((len(slopes), 6, 6))
    block[:, layout.d_rows[mine] - dof, layout.d_columns[mine] - dof] = slopes[:, mine]
    return block


def _bias_slope(
    m: Any, layout: Layout, held: dict[str, Any], before: dict[str, Any], at: int, dof: int
) -> Any:
    """Return the velocity derivative of a free body's bias force, shape (n, 6, 6).

    With mass m, centre of mass c and inertia I about the joint, all in the body's axes R, the bias
    force is m R (ω × (ω × c)), and its torque ω × I ω. The blocks of the mass matrix are m, -m R
    c×, and I plus the armature.
    """
    mass = layout.mass.block(held[layout.mass_name], np.arange(dof, dof + 6))
    spin = before["qvel"][:, dof + 3 : dof + 6]
    turn = _matrices(before["qpos"][:, at + 3 : at + 7])
    inertia = mass[:, 3:, 3:] - np.diag(m.dof_armature[dof + 3 : dof + 6])
    offset = -np.swapaxes(turn, 1, 2) @ mass[:, :3, 3:]  # m c×
    centre = np.stack([offset[:, 2, 1], offset[:, 0, 2], offset[:, 1, 0]], axis=1)
    w = _cross(spin)
    block = np.zeros((len(spin), 6, 6))
    block[:, :3, 3:] = turn @ -(_cross(np.cross(spin, centre)) + w @ _cross(centre))
    block[:, 3:, 3:] = w @ inertia - _cross((inertia @ spin[..., None])[..., 0])
    return block


def _cross(vectors: Any) -> Any:
    """Return the matrices that map b to a × b, shape (n, 3, 3)."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    zero = np.zeros_like(x)
    rows = np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]])
    return np.moveaxis(rows, -1, 0)


def _matrices(quaternions: Any) -> Any:
    """Convert quaternions, real part first, to rotation matrices, shape (n, 3, 3).

    MuJoCo takes a quaternion of length 0 (`mjMINVAL`) for no rotation.
    """
    length = np.linalg.norm(quaternions, axis=1, keepdims=True)
    q = np.where(length < 1e-15, [1.0, 0.0, 0.0, 0.0], quaternions / np.maximum(length, 1e-15))
    w, x, y, z = q.T
    rows = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    return np.moveaxis(rows, -1, 0)
