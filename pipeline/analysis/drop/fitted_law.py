"""What a fall that differs looks like: other damping, gravity, integrator or contact.

Each of the two lines of the law of free flight is fitted to the recorded samples:

    v' = v + dt (g - k v (1 + |v|))        accelerations give g and k, by least squares
    x' = x + dt v'                         displacements tell which velocity moved the body
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import polars as pl
from numpy.typing import NDArray

from pipeline.analysis.general.samples import base_of
from pipeline.fields import counted
from pipeline.messages import Message, joined

Float64 = NDArray[np.float64]

POSITION = ["x_m", "y_m", "z_m"]
VELOCITY = ["vx_m_s", "vy_m_s", "vz_m_s"]
ROTATION = {"qx", "qy", "qz", "qw", "wx_rad_s", "wy_rad_s", "wz_rad_s"}

ROUNDING = 1e-12
"""Relative difference after some thousand steps if the same operations run in another order."""
FITS = 1e-7
"""Largest deviation of a fitted acceleration, relative, that still counts as the same law."""
RARE = 0.05
"""Share of the steps that may depart from a law which the others follow."""

TURNING = Message(
    "the same fall, turning differently: other inertia, friction or angular damping, or a torque "
    "or call in only one of them"
)
INTEGRATORS = {
    "after": Message("x += dt v with the end-of-step velocity (semi-implicit Euler)"),
    "before": Message("x += dt v with the start-of-step velocity (explicit Euler)"),
    "mean": Message("x += dt v with the mean of both velocities (trapezoidal)"),
}


@dataclass(frozen=True)
class _Law:
    """The law of a fall, fitted to its airborne samples."""

    gravity_m_s2: float
    damping: float
    moves: bool
    """Whether the body ever moves, which its damping needs to be known."""
    fits: bool
    """Whether all velocities follow it."""
    integrator: str | None
    """What moves the body in most steps; None if it is none of `INTEGRATORS`."""


def likeness(
    states: pl.DataFrame,
    golden: pl.DataFrame,
    *,
    timestep_s: float,
    first: int,
    airborne: int,
    touched: bool,
) -> Message:
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
        Number of samples before the first contact.
    touched
        Whether the first sample that differs has a contact, in either.
    """
    columns, steps = _changed(states, golden)
    if first == 0:
        return Message("another release: the very first sample differs")
    parts, states, golden = (states, golden), base_of(states), base_of(golden)
    everything = POSITION + VELOCITY + sorted(ROTATION)
    if (
        _largest_relative(states, golden, everything) <= ROUNDING
        and _largest_relative(*parts, everything) > ROUNDING
    ):
        return Message("the same fall of the base, whose links move differently")
    if columns and columns <= ROTATION:
        return TURNING
    if first >= airborne:
        if not touched:
            return Message(
                "the same up to a flight after the first contact, and there another law, or a "
                "force or call in only one of them"
            )
        return Message(
            "the same up to a step in contact, and there another restitution, friction, contact "
            "ERP or solver, other gravity, mass or inertia, or a force or call in only one of them"
        )
    if len(steps) == 1 and first < states["step"][-1]:
        return Message("one altered sample: those after it are the same again")
    states, golden = states[:airborne], golden[:airborne]
    if _largest_relative(states, golden, POSITION + VELOCITY) <= ROUNDING:
        if _largest_relative(states, golden, sorted(ROTATION)) > ROUNDING:
            return TURNING
        return Message(
            "the same law, rounded differently: another compiler, fused multiply-add, or a force "
            "or call in only one of them"
        )
    mine, theirs = _law(states, timestep_s), _law(golden, timestep_s)
    if mine is None or theirs is None:
        return Message("another law: too few samples in the air to say which")
    off, golden_off = _departs(states, theirs, timestep_s), _departs(golden, mine, timestep_s)
    rare = range(1, 1 + max(1, int(RARE * len(states))))
    if off is not None and not len(off):
        return Message("the same law, with numbers that differ by less than a millionth")
    if off is not None and len(off) in rare:
        return Message(
            "the same law but for {steps} in the air, the first at sample {sample}: a call or a "
            "force moved it there",
            steps=counted(len(off), "step"),
            sample=int(off[0]) + 1,
        )
    if golden_off is not None and len(golden_off) in rare:
        return Message(
            "the same law, but golden departs from it in {steps} in the air, the first at sample "
            "{sample}: a call or a force moved it there",
            steps=counted(len(golden_off), "step"),
            sample=int(golden_off[0]) + 1,
        )
    return _change(mine, theirs)


def _change(mine: _Law, theirs: _Law) -> Message:
    """Say how two laws differ."""
    if not theirs.fits:
        return Message("another law, or a force or call in only one of them")
    if not mine.fits:
        return Message(
            "another law of damping, other gravity, substeps, or a force or call in only one of "
            "them"
        )
    if mine.integrator is None or theirs.integrator is None:
        return Message(
            "another law: its positions do not follow from its velocities at this timestep; "
            "another timestep or integrator, substeps, or calls in only one of them"
        )
    changes = []
    if not _near(mine.gravity_m_s2, theirs.gravity_m_s2):
        changes.append(
            Message(
                "gravity {value:.6g} instead of {golden:.6g} m/s² (or a constant force)",
                value=mine.gravity_m_s2,
                golden=theirs.gravity_m_s2,
            )
        )
    if mine.moves and theirs.moves and not _near(mine.damping, theirs.damping):
        changes.append(
            Message(
                "linear damping {value:.6g} instead of {golden:.6g}",
                value=mine.damping,
                golden=theirs.damping,
            )
        )
    if mine.integrator != theirs.integrator:
        name = INTEGRATORS[mine.integrator]
        changes.append(Message("another integrator: {integrator}", integrator=name))
    if not changes:
        return Message("the same law over most of the fall, with samples that do not follow it")
    return Message("the same law with {changes}", changes=joined(", ", changes))


def _near(value: float, other: float) -> bool:
    return abs(value - other) <= 1e-6 * max(1.0, abs(other))


def _changed(states: pl.DataFrame, golden: pl.DataFrame) -> tuple[set[str], set[int]]:
    """Return in which columns and at which steps anything of the motion differs."""
    names = [name for name in states.columns if name not in ("step", "body", "link")]
    same = states.select(pl.col(name) == golden[name] for name in names)
    steps = golden["step"].filter(~same.select(pl.all_horizontal(names)).to_series())
    return {name for name in names if not same[name].all()}, set(steps)


def _largest_relative(states: pl.DataFrame, golden: pl.DataFrame, names: list[str]) -> float:
    x, y = (side.select(names).to_numpy() for side in (states, golden))
    return float((np.abs(x - y) / np.maximum(1.0, np.abs(y))).max())


def _law(states: pl.DataFrame, timestep_s: float) -> _Law | None:
    if len(states) < 4:
        return None
    x, v = states.select(POSITION).to_numpy(), states.select(VELOCITY).to_numpy()
    acceleration = np.diff(v, axis=0) / timestep_s
    terms = _terms(v[:-1])
    (gravity, damping), *_ = np.linalg.lstsq(terms.reshape(-1, 2), acceleration.ravel(), rcond=None)
    gravity, damping = (
        0.0 if abs(value) < ROUNDING else float(value) for value in (gravity, damping)
    )
    ways = _ways(v, timestep_s)
    misses = {
        name: float(np.median(np.abs(np.diff(x, axis=0) - way).max(axis=1)))
        for name, way in ways.items()
    }
    integrator = min(misses, key=lambda name: misses[name])
    law = _Law(gravity, damping, bool(v[:-1].any()), True, None)
    return replace(
        law,
        fits=not _velocity_departs(states, law, timestep_s).any(),
        integrator=integrator if misses[integrator] <= _placed_within(x) else None,
    )


def _terms(before: Float64) -> Float64:
    """Return what gravity and damping are multiplied by in each step, shape (steps, 3, 2)."""
    drag = -before * (1 + np.linalg.norm(before, axis=1, keepdims=True))
    up = np.broadcast_to([0.0, 0.0, 1.0], drag.shape)
    return np.stack((up, drag), axis=2)


def _ways(v: Float64, timestep_s: float) -> dict[str, Float64]:
    """Return by how much each integrator moves the body in each step [m], shape (steps, 3)."""
    return {
        "after": timestep_s * v[1:],
        "before": timestep_s * v[:-1],
        "mean": timestep_s * (v[:-1] + v[1:]) / 2,
    }


def _velocity_departs(states: pl.DataFrame, law: _Law, timestep_s: float) -> NDArray[np.bool_]:
    """Return after which steps the velocity is not that of a law, shape (steps,)."""
    v = states.select(VELOCITY).to_numpy()
    acceleration = np.diff(v, axis=0) / timestep_s
    residual = np.abs(_terms(v[:-1]) @ (law.gravity_m_s2, law.damping) - acceleration).max(axis=1)
    # Velocities are rounded, which a short step magnifies in the acceleration.
    noise = 1e-15 * np.abs(v).max() / timestep_s
    return np.asarray(residual > FITS * max(1.0, np.abs(acceleration).max()) + 10 * noise)


def _departs(states: pl.DataFrame, law: _Law, timestep_s: float) -> NDArray[np.intp] | None:
    """Return after which steps the sample is not that of a law; None if nothing fits that law."""
    if not law.fits or law.integrator is None:
        return None
    x, v = states.select(POSITION).to_numpy(), states.select(VELOCITY).to_numpy()
    missed = np.abs(np.diff(x, axis=0) - _ways(v, timestep_s)[law.integrator]).max(axis=1)
    return np.flatnonzero(_velocity_departs(states, law, timestep_s) | (missed > _placed_within(x)))


def _placed_within(x: Float64) -> float:
    """Return by how much positions deviate from an integrator by rounding [m]."""
    return ROUNDING * max(1.0, float(np.abs(x).max()))
