"""What a fall that differs looks like: other damping, gravity, integrator or contact.

The law of free flight is taken apart into its two lines, each fitted to the recorded samples:

    v' = v + dt (g - k v (1 + |v|))        accelerations give g and k, by least squares
    x' = x + dt v'                         the way of a step tells which velocity moved the body
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import polars as pl
from numpy.typing import NDArray

from pipeline.analysis.general.samples import base_of

Float64 = NDArray[np.float64]

POSITION = ["x_m", "y_m", "z_m"]
VELOCITY = ["vx_m_s", "vy_m_s", "vz_m_s"]
ROTATION = {"qx", "qy", "qz", "qw", "wx_rad_s", "wy_rad_s", "wz_rad_s"}

ROUNDING = 1e-12
"""Relative difference that other orders of the same operations reach in some thousand steps."""
FITS = 1e-7
"""Largest deviation of a fitted acceleration, relative, that still counts as the same law."""

INTEGRATORS = {
    "after": "x += dt v with the velocity after the step (semi-implicit Euler)",
    "before": "x += dt v with the velocity before the step (explicit Euler)",
    "mean": "x += dt times the mean of the velocities before and after the step (trapezoidal)",
}


@dataclass(frozen=True)
class _Law:
    """What the airborne samples of a fall say of its law."""

    gravity_m_s2: float
    damping: float
    moves: bool
    """Whether the body ever moves, so that its damping can be told."""
    fits: bool
    integrator: str


def likeness(
    states: pl.DataFrame, golden: pl.DataFrame, *, timestep_s: float, first: int, airborne: int
) -> str:
    """Say in a few words what a difference looks like.

    Parameters
    ----------
    states, golden
        The tables of both falls: the same parts at the same steps.
    timestep_s
        Timestep [s].
    first
        The first sample that differs.
    airborne
        How many samples there are before the first contact.
    """
    columns, steps = _changed(states, golden)
    states, golden = base_of(states), base_of(golden)
    if first == 0:
        return "another release: the very first sample differs"
    if columns and columns <= ROTATION:
        return "the same fall, turning differently: other inertia or angular damping"
    if first >= airborne:
        return (
            "the same fall up to the impact, then other contact: restitution, contact ERP, the "
            "solver's residual or iterations, or the solver itself"
        )
    if len(steps) == 1:
        return "one altered sample: those after it are the same again"
    if _largest_relative(states, golden, airborne) <= ROUNDING:
        return "the same law, rounded differently: another compiler, or fused multiply-add"
    mine, theirs = _law(states[:airborne], timestep_s), _law(golden[:airborne], timestep_s)
    if mine is None or theirs is None:
        return "another law: too few samples in the air to say which"
    return _said(mine, theirs)


def _said(mine: _Law, theirs: _Law) -> str:
    parts = []
    if not _near(mine.gravity_m_s2, theirs.gravity_m_s2):
        parts.append(f"gravity {mine.gravity_m_s2:.6g} instead of {theirs.gravity_m_s2:.6g} m/s²")
    if mine.moves and theirs.moves and not _near(mine.damping, theirs.damping):
        parts.append(f"linear damping {mine.damping:.6g} instead of {theirs.damping:.6g}")
    if mine.integrator != theirs.integrator:
        parts.append(f"another integrator: {INTEGRATORS[mine.integrator]}")
    if not mine.fits:
        return "another law of damping, or a force that was not there before"
    if not parts:
        return "the same law over most of the fall, with samples that do not follow it"
    return "the same law with " + " and ".join(parts)


def _near(value: float, other: float) -> bool:
    return abs(value - other) <= 1e-6 * max(1.0, abs(other))


def _changed(states: pl.DataFrame, golden: pl.DataFrame) -> tuple[set[str], set[int]]:
    """Return in which columns and at which steps anything of the motion differs."""
    names = [name for name in states.columns if name not in ("step", "body", "link")]
    same = states.select(pl.col(name) == golden[name] for name in names)
    steps = golden["step"].filter(~same.select(pl.all_horizontal(names)).to_series())
    return {name for name in names if not same[name].all()}, set(steps)


def _largest_relative(states: pl.DataFrame, golden: pl.DataFrame, samples: int) -> float:
    x, y = (side.select(POSITION + VELOCITY).to_numpy()[:samples] for side in (states, golden))
    return float((np.abs(x - y) / np.maximum(1.0, np.abs(y))).max())


def _law(states: pl.DataFrame, timestep_s: float) -> _Law | None:
    if len(states) < 4:
        return None
    x, v = states.select(POSITION).to_numpy(), states.select(VELOCITY).to_numpy()
    acceleration = np.diff(v, axis=0) / timestep_s
    before = v[:-1]
    drag = -before * (1 + np.linalg.norm(before, axis=1, keepdims=True))
    up = np.broadcast_to([0.0, 0.0, 1.0], drag.shape)
    terms = np.stack((up.ravel(), drag.ravel()), axis=1)
    (gravity, damping), *_ = np.linalg.lstsq(terms, acceleration.ravel(), rcond=None)
    residual = np.abs(terms @ (gravity, damping) - acceleration.ravel()).max()
    # Recorded velocities are rounded, which a short step makes large in the acceleration.
    noise = 1e-15 * np.abs(v).max() / timestep_s
    ways = {"after": v[1:], "before": v[:-1], "mean": (v[:-1] + v[1:]) / 2}
    misses = {
        name: float(np.median(np.abs(np.diff(x, axis=0) - timestep_s * way).max(axis=1)))
        for name, way in ways.items()
    }
    return _Law(
        gravity_m_s2=float(gravity),
        damping=float(damping),
        moves=bool(before.any()),
        fits=bool(residual <= FITS * max(1.0, np.abs(acceleration).max()) + 10 * noise),
        integrator=min(misses, key=lambda name: misses[name]),
    )
