"""States that another program has recorded, and MuJoCo's own step from each of them.

A step is near where MuJoCo leads to the recorded state within what the numbers allow: that is how
far steps spread out of states that are nudged by one rounding of the stored type. Where no controls
were recorded, those that the states ask for come from inverse dynamics: an error of another engine
that looks like the force of an actuator cannot be told from one.
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
"""The numbers of a state's parts in a model."""
INPUTS = ("ctrl", "qfrc_applied", "xfrc_applied", "eq_active", "mocap_pos", "mocap_quat")
NUDGES = 5
MARGIN = 4.0
"""A gap of so many spreads is still rounding: five steps show some half of what is possible."""
STILL = 8.0
"""A control that inverse dynamics changes by so many roundings at most has not changed."""
ALIGNED = 64
"""Steps that show to which state the controls belong."""
AFFINE = 1
"""The kind of an actuator's gain, or bias, that is a line over length and velocity; 0 is constant,
or none."""


@dataclass(frozen=True, eq=False)
class ImportedStates:
    """The recorded states of one simulation, n of them."""

    parts: Mapping[str, NDArray[Any]]
    """Parts of the state by MuJoCo's name, shape (n, width) each; inputs act in the step that
    begins in their row."""
    times_s: Float64
    """Shape (n,)."""
    rounding: float
    """Largest relative error of a number of the stored type."""
    step_s: float
    """Time from one to the next [s]."""

    def __len__(self) -> int:
        """Return the number of states."""
        return len(self.times_s)


class ImportedStep(NamedTuple):
    """A step from one recorded state to the next."""

    number: int
    near: bool
    """Whether MuJoCo leads to the recorded state within rounding."""
    ctrl: Float64
    """The controls it was taken with, shape (nu,)."""
    warmstart: Float64
    """What the next step's solver starts from, shape (nv,)."""
    rates: Float64
    """The recorded velocities that it ends with, shape (nv,)."""
    gap: Float64
    """These less MuJoCo's, shape (nv,)."""
    allowed: Float64
    """The part of that which is rounding at most, shape (nv,)."""
    moved: bool
    """Whether the positions alone are another's."""


def loaded(path: Path | None, text: str | None = None) -> Any:  # noqa: ANN401 - an MjModel
    """Return a model, of a file in MuJoCo's XML or binary form, or of XML as text.

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
    """MuJoCo's own steps from recorded states.

    Parameters
    ----------
    m
        The MjModel.
    states
        The states.
    """

    def __init__(self, m: Any, states: ImportedStates) -> None:  # noqa: ANN401
        self.m, self.states = copy.copy(m), states
        self.m.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
        self.d, self._other = mujoco.MjData(m), mujoco.MjData(m)
        # A solver stops where it improves less than by its tolerance, which the inverse has not.
        self.shift, self._rounding = 0, states.rounding
        """How many rows later the controls stand that a step is taken with."""
        self.infers = m.nu > 0 and "ctrl" not in states.parts
        if self.infers:
            self._inverse = _Inverse(m)
            self._rounding = max(states.rounding, float(m.opt.tolerance))
        elif m.nu:
            self.shift = self._aligned()
        self._warm = "qacc_warmstart" in states.parts
        self._judged = ["qpos", "qvel"]
        if "act" in states.parts and not self.infers:
            self._judged.append("act")
        signs = np.random.default_rng(0).integers(0, 2, (64, m.nq + 2 * m.nv + m.na + m.nu))
        self._signs = 2.0 * signs - 1.0

    def __iter__(self) -> Iterator[ImportedStep]:
        """Yield the steps in order."""
        for number in range(len(self.states) - 1):
            yield self._step(number)

    def evaluated(self, step: ImportedStep) -> Any:  # noqa: ANN401 - an MjData
        """Return data in which MuJoCo has computed the state that a step begins in."""
        self._load(self._other, step.number)
        self._other.ctrl[:] = step.ctrl
        mujoco.mj_forward(self.m, self._other)
        return self._other

    def reached(self, step: ImportedStep, force: Float64) -> Float64:
        """Return the velocities that a step leads to with a force more, shape (nv,)."""
        o = self._other
        self._load(o, step.number)
        o.ctrl[:] = step.ctrl
        o.qacc_warmstart[:] = self.d.qacc_warmstart
        o.qfrc_applied[:] += force
        mujoco.mj_step(self.m, o)
        if "qfrc_applied" not in self.states.parts:
            o.qfrc_applied[:] = 0.0
        return np.array(o.qvel, np.float64)

    def _step(self, number: int) -> ImportedStep:
        m, d = self.m, self.d
        ctrl = self._load(d, number)
        if self.infers:
            ctrl = d.ctrl[:] = self._inverse.controls(self, number)
        warm = d.qacc_warmstart.copy()
        mujoco.mj_step(m, d)
        following = self._row("qacc_warmstart", number + 1) if self._warm else d.qacc_warmstart
        if not np.isfinite(following).all():
            following = np.zeros(m.nv)
        gaps, allowed = self._gaps(number)
        within = _within(gaps, allowed)
        if not all(within):
            allowed = self._allowed(number, ctrl, warm, allowed)
            within = _within(gaps, allowed)
        return ImportedStep(
            number,
            near=all(within),
            ctrl=np.array(ctrl),
            warmstart=np.array(following),
            rates=self._row("qvel", number + 1).astype(np.float64),
            gap=gaps[1],
            allowed=allowed[1],
            moved=within[1] and not within[0],
        )

    def _row(self, name: str, number: int) -> Any:  # noqa: ANN401 - an array
        return self.states.parts[name][number]

    def _load(self, d: Any, number: int) -> Any:  # noqa: ANN401
        """Write a state into data; return its controls."""
        d.time = self.states.times_s[number]
        for name, rows in self.states.parts.items():
            at = number
            if name == "ctrl":
                at = min(number + self.shift, len(rows) - 1)
            getattr(d, name).reshape(-1)[:] = rows[at]
        if not np.isfinite(d.qacc_warmstart).all():
            d.qacc_warmstart[:] = 0.0
        return d.ctrl.copy()

    def _gaps(self, number: int) -> tuple[list[Float64], list[Float64]]:
        """Return how far the recorded parts are from MuJoCo's, and what their rounding alone is."""
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
        ctrl: Any,  # noqa: ANN401
        warm: Float64,
        floors: list[Float64],
    ) -> list[Float64]:
        """Return how far a step may be off: by what states nudged by a rounding lead to."""
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
            o.qacc_warmstart[:] = warm
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
        """Return whether the controls of a step stand in the row that it ends in: 1, else 0."""
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
    """Return whether each part is off by rounding at most."""
    both = zip(gaps, allowed, strict=True)
    return [bool((np.abs(gap) <= most).all()) for gap, most in both]


class _Inverse:
    """The controls that states ask for, by inverse dynamics (`mj_inverse`)."""

    def __init__(self, m: Any) -> None:  # noqa: ANN401
        self._m = m
        self.d = mujoco.MjData(m)
        kinds = m.actuator_gaintype, m.actuator_biastype
        known = (kinds[0] <= AFFINE) & (kinds[1] <= AFFINE) & (m.actuator_dyntype == 0)
        self._free = np.flatnonzero(known)
        self._held = np.zeros(m.nu)
        self._flag = int(mujoco.mjtEnableBit.mjENBL_INVDISCRETE)

    def controls(self, steps: ImportedSteps, number: int) -> Float64:
        """Return the controls with which a step leads to the next state's velocities, (nu,)."""
        m, d = self._m, self.d
        steps._load(d, number)
        h, flags = m.opt.timestep, int(m.opt.enableflags)
        d.ctrl[:] = 0.0
        d.qacc[:] = (steps._row("qvel", number + 1).astype(np.float64) - d.qvel) / h
        m.opt.enableflags = flags | self._flag
        try:
            mujoco.mj_inverse(m, d)
        finally:
            m.opt.enableflags = flags
        moment = moments(m, d)
        force = d.qfrc_inverse - d.qfrc_applied
        for body in np.flatnonzero(d.xfrc_applied.any(axis=1)).tolist():
            push, pushed = d.xfrc_applied[body], np.zeros(m.nv)
            mujoco.mj_applyFT(m, d, push[:3], push[3:], d.xipos[body], body, pushed)
            force = force - pushed
        gain, bias = _lines(m, d)
        held = np.setdiff1d(np.arange(m.nu), self._free)
        acts = np.zeros(m.nu)
        for each in held.tolist():
            if m.actuator_actnum[each]:
                last = m.actuator_actadr[each] + m.actuator_actnum[each] - 1
                acts[each] = gain[each] * d.act[last] + bias[each]
        force = force - moment.T @ acts
        if len(self._free) and np.isfinite(force).all():
            arms = np.linalg.pinv(moment[self._free].T)
            gains = np.where(gain[self._free] == 0.0, np.inf, gain[self._free])
            found = (arms @ force - bias[self._free]) / gains
            # A control that is the one before within what rounding makes of it is that one.
            rates = np.abs(d.qvel) + np.abs(d.qvel + h * d.qacc)
            forces = (
                np.abs(mass_of(m, d)) @ rates / h + np.abs(d.qfrc_bias) + np.abs(d.qfrc_passive)
            )
            noise = steps.states.rounding * (np.abs(arms) @ forces) / np.abs(gains)
            held = self._held[self._free]
            same = np.abs(found - held) <= STILL * noise
            self._held[self._free] = np.where(same, held, found)
        return np.where(np.isfinite(self._held), self._held, 0.0)


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


def _lines(m: Any, d: Any) -> tuple[Float64, Float64]:  # noqa: ANN401
    """Return gain and bias of actuators whose force is gain × control + bias, shape (nu,) each."""
    along = np.stack([np.ones(m.nu), d.actuator_length, d.actuator_velocity], axis=1)
    gain, bias = (
        np.einsum("ui,ui->u", prm[:, :3], along) for prm in (m.actuator_gainprm, m.actuator_biasprm)
    )
    gain = np.where(m.actuator_gaintype == AFFINE, gain, m.actuator_gainprm[:, 0])
    return gain, np.where(m.actuator_biastype == AFFINE, bias, 0.0)
