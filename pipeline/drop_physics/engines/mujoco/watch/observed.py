"""Reads numbers from a running MuJoCo script's model and state, to check an expectation."""

from __future__ import annotations

import weakref
from collections.abc import Callable
from typing import Any

import numpy as np

from ...watching.observed import Observed, found, label_name
from .single_changes import AFFINE
from .writes import FREE

UNSTABLE = ("mjWARN_BADQPOS", "mjWARN_BADQVEL", "mjWARN_BADQACC")
"""Warnings that a state is not finite, or too large; MuJoCo may then reset it."""
AXES = "xyz"
UP = 8
"""Index, in a body's rotation matrix, of the upward component of its z axis."""


class ObservedData(Observed):
    """A running simulation, from which expectations read times, positions and forces.

    Parameters
    ----------
    module
        The script's mujoco.
    m, d
        The MjModel and the MjData.
    """

    def __init__(self, module: Any, m: Any, d: Any) -> None:
        self._module, self._model, self.ref = module, m, weakref.ref(d)
        self._names: dict[str, dict[str, int]] = {}
        mass = np.where(m.body_mass > 0, m.body_mass, np.inf)
        self._radius = np.sqrt(m.body_inertia.max(axis=1) / mass)[:, None]
        self._owner = d
        self._servos = [
            (n, m.actuator(n).name or f"actuator{n}", gain, spring, damper)
            for n in np.flatnonzero(m.actuator_biastype == AFFINE).tolist()
            for gain, spring, damper in [(m.actuator_gainprm[n, 0], *-m.actuator_biasprm[n, 1:3])]
            if spring > 0 or damper > 0
        ]
        """Number, name, gain, stiffness and damping of actuators that are servos."""
        self._body_names = [m.body(body).name or f"body{body}" for body in range(m.nbody)]

    @property
    def time_s(self) -> float:
        """The simulated time [s]."""
        return float(self._owner.time)

    def reader(self, kind: str, *names: Any) -> Callable[[], Any]:
        """Return a function that reads a quantity's current value, a number or a vector."""
        d, m = self._owner, self._model
        if kind in AXES:
            row, axis = d.xpos[self._number("body", *names)], AXES.index(kind)
            return lambda: float(row[axis])
        if kind == "up":
            turned = d.xmat[self._number("body", *names)]
            return lambda: float(turned[UP])
        if kind in ("joint", "rate"):
            joint = self._number("joint", *names)
            held = d.qpos if kind == "joint" else d.qvel
            at = int((m.jnt_qposadr if kind == "joint" else m.jnt_dofadr)[joint])
            if m.jnt_type[joint] == FREE:
                return lambda: held[at : at + 3].copy()
            return lambda: float(held[at])
        if kind == "sensor":
            sensor = self._number("sensor", *names)
            at, size = int(m.sensor_adr[sensor]), int(m.sensor_dim[sensor])
            if size == 1:
                return lambda: float(d.sensordata[at])
            return lambda: d.sensordata[at : at + size].copy()
        return self._force(m, d, [self._number("body", name) for name in names])

    def positions(self) -> list[float]:
        """Return the positions of three points on each body, which also show its rotation [m]."""
        centre, turned = self._owner.xipos, self._owner.xmat.reshape(-1, 3, 3)
        arms = (centre + self._radius * turned[:, :, axis] for axis in (0, 2))
        numbers: list[float] = np.concatenate([centre, *arms], axis=1).reshape(-1).tolist()
        return numbers

    def bodies(self) -> list[str]:
        """Return the names of the bodies, in the order of `positions`."""
        return self._body_names

    def astray(self) -> dict[str, float]:
        """Return how far servo-driven joints or tendons are from their commands in `ctrl`."""
        d, found = self._owner, {}
        for number, name, gain, spring, damper in self._servos:
            asked = gain * d.ctrl[number]
            if spring:
                found[name] = float(asked / spring - d.actuator_length[number])
            else:
                found[name] = float(asked / damper - d.actuator_velocity[number])
        return found

    def is_finite(self) -> bool:
        """Return whether the state is finite and MuJoCo has not reset it as unstable."""
        d, warnings = self._owner, self._module.mjtWarning
        warned = any(d.warning[int(getattr(warnings, name))].number for name in UNSTABLE)
        return not warned and bool(np.isfinite(d.qpos).all() and np.isfinite(d.qvel).all())

    def _number(self, kind: str, name: Any) -> int:
        """Return the index of an element by name."""
        if isinstance(name, (int, np.integer)) and not isinstance(name, bool):
            return int(name)
        if kind not in self._names:
            m, of = self._model, getattr(self._module.mjtObj, f"mjOBJ_{kind.upper()}")
            counts = {"body": "nbody", "joint": "njnt", "sensor": "nsensor"}
            count = getattr(m, counts[kind])
            named = [self._module.mj_id2name(m, of, n) for n in range(count)]
            # Reports call an unnamed element by its number, and a body by its name in labels.
            shown = {label_name(each or f"{kind}{n}"): n for n, each in enumerate(named)}
            self._names[kind] = shown | {each: n for n, each in enumerate(named) if each}
        return found(str(name), self._names[kind])

    def _force(self, m: Any, d: Any, bodies: list[int]) -> Callable[[], float]:
        """Return a function that reads the contact force between two bodies, or on one."""
        one, others = bodies[0], bodies[1:]
        of, wrench = m.geom_bodyid, np.zeros(6)

        def force() -> float:
            total = np.zeros(3)
            for number in range(d.ncon):
                contact = d.contact[number]
                first, second = (int(of[geom]) if geom >= 0 else -1 for geom in contact.geom)
                if one not in (first, second) or first == second:
                    continue
                other = second if first == one else first
                if others and other not in others:
                    continue
                self._module.mj_contactForce(m, d, number, wrench)
                on_second = contact.frame.reshape(3, 3).T @ wrench[:3]
                total += on_second if other == first else -on_second
            return float(np.linalg.norm(total))

        return force
