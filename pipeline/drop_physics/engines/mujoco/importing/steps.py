"""Compares recorded states of another program with MuJoCo's step from each of them.

A step is near if MuJoCo reaches the recorded state within rounding: within the spread of steps from
states that differ by one rounding of the stored type. If no controls were recorded, a step uses
those of the previous step, or else the controls that lead closest to the next state. A difference
between engines that resembles an actuator's force then cannot be distinguished from a control.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from drop_physics.engines.mujoco.frames import LARGEST
from drop_physics.engines.mujoco.unlogged import write_no_log
from drop_physics.errors import DropError

Float64 = NDArray[np.float64]
write_no_log()

WIDTHS = {
    "qpos": lambda m: m.nq,
    "qvel": lambda m: m.nv,
    "act": lambda m: m.na,
    "ctrl": lambda m: m.nu,
    "mocap_pos": lambda m: 3 * m.nmocap,
    "mocap_quat": lambda m: 4 * m.nmocap,
    "qfrc_applied": lambda m: m.nv,
    "xfrc_applied": lambda m: 6 * m.nbody,
    "eq_active": lambda m: m.neq,
    "qacc_warmstart": lambda m: m.nv,
}
"""Number of elements of each part of a state in a model."""
INPUTS = ("ctrl", "qfrc_applied", "xfrc_applied", "eq_active", "mocap_pos", "mocap_quat")
NUDGES = 5
MARGIN = 4.0
"""A difference up to this many times the spread of five nudged steps counts as rounding, since five
samples show about half of the possible spread."""
ROUNDS = 8
"""Largest number of least-squares iterations that determine controls; contacts need more than
one."""
NUDGED = 1e-3
"""Relative change of a control that measures its effect."""
ALIGNED = 64
"""Number of steps used to determine whether a control is stored with its step's start or end state.
"""


@dataclass(frozen=True, eq=False)
class ImportedStates:
    """Recorded states of one simulation, n in all."""

    parts: Mapping[str, NDArray[Any]]
    """Parts of the state by MuJoCo's name, shape (n, width) each; inputs act in the step that
    starts at their row."""
    times_s: Float64
    """Time of each state, shape (n,)."""
    rounding: float
    """Largest relative rounding error of the stored type."""
    step_s: float
    """Time between successive states [s]."""

    def __len__(self) -> int:
        """Return the number of states."""
        return len(self.times_s)


class ImportedStep(NamedTuple):
    """MuJoCo's step from a recorded state, compared with the next recorded state."""

    number: int
    near: bool
    """Whether MuJoCo's step reaches the recorded state within rounding."""
    ctrl: Float64
    """The controls with which the step was made, shape (nu,)."""
    given: Float64
    """The controls in `ctrl`; if those do not lead to the next state, the last known controls,
    shape (nu,)."""
    warmstart: Float64
    """Warm start of the next step's solver, shape (nv,)."""
    rates: Float64
    """The recorded velocities after the step, shape (nv,)."""
    gap: Float64
    """The recorded velocities minus MuJoCo's, shape (nv,)."""
    allowed: Float64
    """The part of `gap` that may be rounding, shape (nv,)."""
    moved: bool
    """Whether only the positions differ."""


def loaded(path: Path | None, text: str | None = None) -> Any:  # noqa: ANN401 - an MjModel
    """Load a model from a file in MuJoCo's XML or binary format, or from XML text.

    Raises
    ------
    DropError
        If MuJoCo cannot load it.
    """
    try:
        if path is None:
            return mujoco.MjModel.from_xml_string(text)
        if path.suffix == ".mjb":
            return mujoco.MjModel.from_binary_path(str(path))
        return mujoco.MjModel.from_xml_path(str(path))
    except (ValueError, RuntimeError, mujoco.FatalError) as error:
        reason = " ".join(str(error).split())
        raise DropError(
            "{model} must be a model that MuJoCo {version} loads (.xml, or .mjb of that version), "
            "got: {reason}; --model takes another file",
            model=str(path) if path else "the file's own model",
            version=mujoco.__version__,
            reason=reason,
        ) from None


class ImportedSteps:
    """MuJoCo's steps from all recorded states, one at a time.

    Parameters
    ----------
    m
        The MjModel.
    states
        The recorded states.
    """

    def __init__(self, m: Any, states: ImportedStates) -> None:  # noqa: ANN401
        self.m, self.states = copy.copy(m), states
        self.m.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
        self.d, self._other = mujoco.MjData(m), mujoco.MjData(m)
        self.infers = m.nu > 0 and "ctrl" not in states.parts
        # A solver stops where it improves less than by its tolerance; so may the controls be off.
        least = float(m.opt.tolerance) if self.infers else 0.0
        self._rounding = max(states.rounding, least)
        self._held = np.zeros(m.nu)
        """The controls of the latest step for which they could be estimated, if they were not
        recorded."""
        self._chain = np.zeros(m.nv)
        """Warm start of the next step's solver."""
        self.shift = 0 if self.infers or not m.nu else self._aligned()
        """1 if the file stores a step's controls with its end state, else 0."""
        self._warm = "qacc_warmstart" in states.parts
        self._judged = ["qpos", "qvel", *(["act"] if "act" in states.parts else [])]
        signs = np.random.default_rng(0).integers(0, 2, (64, m.nq + 2 * m.nv + m.na + m.nu))
        self._signs = 2.0 * signs - 1.0

    def __iter__(self) -> Iterator[ImportedStep]:
        """Yield the steps in order."""
        for number in range(len(self.states) - 1):
            yield self._step(number)

    def goes_on(self) -> bool:
        """Return whether MuJoCo's step from the last state leads to a valid state.

        If the file has no controls, the step uses those of the previous step.
        """
        d = self._other
        self._load(d, len(self.states) - 1)
        if self.infers:
            d.ctrl[:] = self._held
        mujoco.mj_step(self.m, d)
        reached = np.concatenate([d.qpos, d.qvel])
        return bool((np.abs(reached) <= LARGEST).all())

    def evaluated(self, step: ImportedStep) -> Any:  # noqa: ANN401 - an MjData
        """Return an MjData with MuJoCo's results for the state before a step."""
        self._load(self._other, step.number)
        self._other.ctrl[:] = step.ctrl
        mujoco.mj_forward(self.m, self._other)
        return self._other

    def reached(self, step: ImportedStep, force: Float64) -> Float64:
        """Return the velocities after a step with an additional force, shape (nv,)."""
        o = self._other
        self._load(o, step.number)
        o.ctrl[:] = step.ctrl
        o.qfrc_applied[:] += force
        mujoco.mj_step(self.m, o)
        if "qfrc_applied" not in self.states.parts:
            o.qfrc_applied[:] = 0.0
        return np.array(o.qvel, np.float64)

    def _step(self, number: int) -> ImportedStep:
        row = self._row("ctrl", self._row_of_ctrl(number)) if not self.infers else self._held
        step = self._tried(number, np.array(row, np.float64))
        if self.infers:
            if not step.near:
                step = self._tried(number, self._asked(number))
            if step.near:
                self._held = step.ctrl
            step = step._replace(given=self._held)
        self._chain = step.warmstart
        return step

    def _tried(self, number: int, ctrl: Float64) -> ImportedStep:
        """Make a step with the given controls, and compare the result."""
        self._load(self.d, number)
        self.d.ctrl[:] = ctrl
        mujoco.mj_step(self.m, self.d)
        following = np.array(self.d.qacc_warmstart)
        if self._warm:
            following = self._row("qacc_warmstart", number + 1).astype(np.float64)
        gaps, allowed = self._gaps(number)
        within = _within(gaps, allowed)
        if not all(within):
            allowed = self._allowed(number, ctrl, allowed)
            within = _within(gaps, allowed)
        return ImportedStep(
            number,
            near=all(within),
            ctrl=ctrl,
            given=ctrl,
            warmstart=np.where(np.isfinite(following), following, 0.0),
            rates=self._row("qvel", number + 1).astype(np.float64),
            gap=gaps[1],
            allowed=allowed[1],
            moved=within[1] and not within[0],
        )

    def _asked(self, number: int) -> Float64:
        """Estimate unrecorded controls: those that lead closest to the next state, shape (nu,)."""
        m, o = self.m, self._other
        names = [name for name in self._judged if name != "qpos"]
        target = np.concatenate([self._row(name, number + 1) for name in names]).astype(np.float64)

        def reached(ctrl: Float64) -> Float64:
            self._load(o, number)
            o.ctrl[:] = ctrl
            mujoco.mj_step(m, o)
            return np.concatenate([getattr(o, name) for name in names])

        self._load(o, number)
        mujoco.mj_forward(m, o)
        weights = np.ones(len(target))
        weights[: m.nv] = np.sqrt([mass_of(m, o)[dof, dof] for dof in range(m.nv)])
        limited, (low, high) = m.actuator_ctrllimited == 1, m.actuator_ctrlrange.T
        # From where contacts are as they were, least squares take away what rounding did to that.
        ctrl = self._inverse(number)
        for _ in range(ROUNDS):
            left = (target - reached(ctrl)) * weights
            by = NUDGED * np.where(limited, high - low, np.maximum(np.abs(ctrl), 1.0))
            columns = [(reached(ctrl + each) - reached(ctrl)) * weights for each in np.diag(by)]
            slope = np.stack(columns, axis=1) / by
            if not (np.isfinite(left).all() and np.isfinite(slope).all()):
                break
            more = np.linalg.lstsq(slope, left, rcond=1e-9)[0]
            ctrl = np.where(limited, np.clip(ctrl + more, low, high), ctrl + more)
            if (np.abs(slope @ more) <= self._rounding * np.abs(target * weights)).all():
                break
        return ctrl

    def _inverse(self, number: int) -> Float64:
        """Estimate unrecorded controls of a step by inverse dynamics, shape (nu,)."""
        m, o, flags = self.m, self._other, int(self.m.opt.enableflags)
        if m.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4:
            return self._held
        self._load(o, number)
        o.qacc[:] = (self._row("qvel", number + 1).astype(np.float64) - o.qvel) / m.opt.timestep
        m.opt.enableflags = flags | int(mujoco.mjtEnableBit.mjENBL_INVDISCRETE)
        try:
            mujoco.mj_inverse(m, o)
        finally:
            m.opt.enableflags = flags
        need = o.qfrc_inverse - o.qfrc_applied
        for body in np.flatnonzero(o.xfrc_applied.any(axis=1)).tolist():
            push, pushed = o.xfrc_applied[body], np.zeros(m.nv)
            mujoco.mj_applyFT(m, o, push[:3], push[3:], o.xipos[body], body, pushed)
            need = need - pushed
        forces = []
        for ctrl in (np.zeros(m.nu), *np.eye(m.nu)):
            o.ctrl[:] = ctrl
            mujoco.mj_fwdActuation(m, o)
            forces.append(o.qfrc_actuator.copy())
        columns = np.stack(forces[1:], axis=1) - forces[0][:, None]
        if not (np.isfinite(need).all() and np.isfinite(columns).all()):
            return self._held
        return np.asarray(np.linalg.lstsq(columns, need - forces[0], rcond=1e-9)[0])

    def _row_of_ctrl(self, number: int) -> int:
        return min(number + self.shift, len(self.states.parts["ctrl"]) - 1)

    def _row(self, name: str, number: int) -> Any:  # noqa: ANN401 - an array
        return self.states.parts[name][number]

    def _load(self, d: Any, number: int) -> None:  # noqa: ANN401
        """Write a state into an MjData, with its controls if they are known."""
        d.time = self.states.times_s[number]
        for name, rows in self.states.parts.items():
            at = self._row_of_ctrl(number) if name == "ctrl" else number
            getattr(d, name).reshape(-1)[:] = rows[at]
        if "qacc_warmstart" not in self.states.parts or not np.isfinite(d.qacc_warmstart).all():
            d.qacc_warmstart[:] = self._chain

    def _gaps(self, number: int) -> tuple[list[Float64], list[Float64]]:
        """Return the differences of recorded and computed state arrays, and allowed rounding."""
        gaps, floors = [], []
        for name in self._judged:
            before, after = (self._row(name, at).astype(np.float64) for at in (number, number + 1))
            gaps.append(after - getattr(self.d, name))
            size = np.abs(after) + np.abs(before) + np.abs(after - before)
            floors.append(self._rounding * size)
        return gaps, floors

    def _allowed(
        self,
        number: int,
        ctrl: Float64,
        floors: list[Float64],
    ) -> list[Float64]:
        """Return the tolerance of a step: how far one rounding of the start state moves its end."""
        m, d, o = self.m, self.d, self._other
        spreads = [np.zeros_like(floor) for floor in floors]
        for which in range(NUDGES):
            self._load(o, number)
            signs = self._signs[(number * NUDGES + which) % len(self._signs)]
            by, at = self.states.rounding, 0
            o.ctrl[:] = ctrl
            for held in (o.qpos, o.qvel, o.act, o.ctrl):
                held *= 1.0 + by * signs[at : at + len(held)]
                at += len(held)
            if not self._warm and which < 2:
                o.qacc_warmstart[:] = d.qacc_warmstart if which else 0.0
            mujoco.mj_step(m, o)
            for spread, name in zip(spreads, self._judged, strict=True):
                np.maximum(spread, np.abs(getattr(o, name) - getattr(d, name)), out=spread)
        return [
            MARGIN * (np.where(np.isfinite(spread), spread, 0.0) + floor)
            for spread, floor in zip(spreads, floors, strict=True)
        ]

    def _aligned(self) -> int:
        """Return 1 if the file stores a step's controls with its end state, else 0."""
        last = len(self.states) - 1
        if len(self.states.parts["ctrl"]) <= last:
            return 0
        sample = np.unique(np.linspace(0, last - 1, min(ALIGNED, last)).astype(np.int64))
        off = []
        for self.shift in (0, 1):
            total = 0.0
            for number in sample.tolist():
                self._load(self.d, number)
                mujoco.mj_step(self.m, self.d)
                gap = np.abs(self._row("qvel", number + 1) - self.d.qvel).max(initial=0.0)
                total += float(np.log(gap + 1e-12))
            off.append(total)
        mujoco.mj_resetData(self.m, self.d)
        return int(off[1] < off[0] - len(sample))


def _within(gaps: list[Float64], allowed: list[Float64]) -> list[bool]:
    """Return whether all differences are within the tolerances."""
    both = zip(gaps, allowed, strict=True)
    return [bool((np.abs(gap) <= most).all()) for gap, most in both]


def mass_of(m: Any, d: Any) -> Float64:  # noqa: ANN401
    """Return the mass matrix, shape (nv, nv)."""
    mass, column = np.empty((m.nv, m.nv)), np.empty(m.nv)
    for dof, unit in enumerate(np.eye(m.nv)):
        mujoco.mj_mulM(m, d, column, unit)
        mass[:, dof] = column
    return mass


def moments(m: Any, d: Any) -> Float64:  # noqa: ANN401
    """Return the moment arms of actuators, shape (nu, nv)."""
    dense = np.zeros((m.nu, m.nv))
    if m.nu:
        held = np.ascontiguousarray(d.actuator_moment).ravel()
        mujoco.mju_sparse2dense(dense, held, d.moment_rownnz, d.moment_rowadr, d.moment_colind)
    return dense
