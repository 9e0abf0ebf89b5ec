"""The simple pendulum of the IFToMM multibody benchmark (A01): PyBullet's against exact motion.

A point mass of 1 kg on a massless rod of 1 m, released level, at rest, with 9.81 m/s²: problem A01
of González, Dopico, Lugrís and Cuadrado, *A benchmarking system for MBS simulation software*,
Multibody System Dynamics 16 (2006). Its motion is an elliptic function. PyBullet's error is split
as that of a fall is:

    error = timestep + damping + interaction + rounding

timestep: the discrete law without damping - exact; damping: the continuous model with Bullet's
damping - exact; interaction: the damped discrete law - exact - both; rounding: PyBullet - its law.
"""

from __future__ import annotations

import math
import tempfile
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import pybullet as p
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.special import ellipj, ellipk

Float64 = NDArray[np.float64]

G, DURATION_S = 9.81, 10.0
RATES_HZ = (240, 1000, 4000)
DAMPING = float(np.float32(0.04))
"""PyBullet's default damping."""
URDF = """<robot name="pendulum">
<link name="base"><inertial><mass value="0"/>
<inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="mass"><inertial><origin xyz="1 0 0"/><mass value="1"/>
<inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="pin" type="continuous"><parent link="base"/><child link="mass"/>
<axis xyz="0 1 0"/></joint></robot>"""
"""The rod is level towards +x at angle 0; positive angles are below the horizontal."""


@dataclass(frozen=True)
class Error:
    """PyBullet's largest error over 10 s with one timestep."""

    rate_hz: int
    damping: float
    largest_m: float
    time_s: float
    terms_m: dict[str, float]
    """Contributions by cause, each projected on the direction of the error; they add up to the
    error."""


@cache
def errors(damping: float) -> list[Error]:
    """Return the error for each timestep."""
    return [error_of(rate_hz, damping) for rate_hz in RATES_HZ]


def observed_orders(found: list[Error]) -> list[float]:
    """Return the observed orders of accuracy between successive timesteps."""
    return [
        math.log(coarse.largest_m / fine.largest_m) / math.log(fine.rate_hz / coarse.rate_hz)
        for coarse, fine in pairwise(found)
    ]


def error_of(rate_hz: int, damping: float) -> Error:
    """Return PyBullet's error with one timestep, split by cause."""
    times = np.arange(round(DURATION_S * rate_hz) + 1) / rate_hz
    true = place(exact(times))
    simulated = place(by_pybullet(rate_hz, damping))
    discrete = place(by_law(rate_hz, damping))
    terms = {
        "timestep": place(by_law(rate_hz, 0.0)) - true,
        "damping": place(damped(times, damping)) - true,
    }
    terms["interaction"] = discrete - true - terms["timestep"] - terms["damping"]
    terms["rounding"] = simulated - discrete
    apart = simulated - true
    sizes = np.linalg.norm(apart, axis=1)
    worst = int(sizes.argmax())
    along = apart[worst] / sizes[worst]
    return Error(
        rate_hz,
        damping,
        float(sizes[worst]),
        float(times[worst]),
        {cause: float(term[worst] @ along) for cause, term in terms.items()},
    )


def place(angle: Float64) -> Float64:
    """Return the position of the mass for each angle [m], shape (n, 2)."""
    return np.stack((np.cos(angle), -np.sin(angle)), axis=1)


def exact(times_s: Float64) -> Float64:
    """Return the exact angle below the horizontal.

    From the vertical it is 2 arcsin(k sn(K - ω t)), k = sin(90°/2), ω = √(g/l).
    """
    m = 0.5
    sine, *_ = ellipj(ellipk(m) - math.sqrt(G) * times_s, m)
    return np.asarray(math.pi / 2 - 2 * np.arcsin(math.sqrt(m) * sine))


def damped(times_s: Float64, damping: float) -> Float64:
    """Return the angle of q'' = g cos q - k q' (1 + |q'|), with Bullet's damping k."""
    if damping == 0:
        return exact(times_s)
    solved = solve_ivp(
        lambda _, y: (y[1], G * math.cos(y[0]) - damping * y[1] * (1 + abs(y[1]))),
        (0, times_s[-1]),
        (0.0, 0.0),
        "DOP853",
        t_eval=times_s,
        rtol=1e-12,
        atol=1e-13,
    )
    return np.asarray(solved.y[0])


def by_law(rate_hz: int, damping: float) -> Float64:
    """Return the angle by the discrete formula: semi-implicit Euler, with explicit damping."""
    dt, q, u = 1 / rate_hz, 0.0, 0.0
    angles = [q]
    for _ in range(round(DURATION_S * rate_hz)):
        u += dt * (G * math.cos(q) - damping * u * (1 + abs(u)))
        q += dt * u
        angles.append(q)
    return np.array(angles)


def by_pybullet(rate_hz: int, damping: float) -> Float64:
    """Return PyBullet's angle before each step and after the last."""
    client = p.connect(p.DIRECT)
    try:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "pendulum.urdf")
            path.write_text(URDF)
            how = {"flags": p.URDF_USE_INERTIA_FROM_FILE, "physicsClientId": client}
            body = p.loadURDF(str(path), useFixedBase=True, **how)
        p.setTimeStep(1 / rate_hz, physicsClientId=client)
        p.setGravity(0, 0, -G, physicsClientId=client)
        p.setJointMotorControl2(body, 0, p.VELOCITY_CONTROL, force=0, physicsClientId=client)
        if damping != DAMPING:
            p.changeDynamics(body, -1, linearDamping=damping, physicsClientId=client)
        angles = [0.0]
        for _ in range(round(DURATION_S * rate_hz)):
            p.stepSimulation(physicsClientId=client)
            angles.append(p.getJointState(body, 0, physicsClientId=client)[0])
        return np.array(angles)
    finally:
        p.disconnect(client)


def rows() -> str:
    """Return the rows of the page's table."""
    lines = []
    for damping, name in ((0.0, "off"), (DAMPING, "default")):
        found = errors(damping)
        orders = ["", *(f"{order:.3f}" for order in observed_orders(found))]
        for one, order in zip(found, orders, strict=True):
            # Rounding, some 1e-14 m, is not the same on every machine.
            split = " | ".join(f"{round(value, 12) + 0:+.3g} m" for value in one.terms_m.values())
            lines.append(
                f"| 1/{one.rate_hz} s | {name} | {one.largest_m:.4g} m | {one.time_s:.3f} s "
                f"| {split} | {order} |"
            )
    return "\n".join(lines)
