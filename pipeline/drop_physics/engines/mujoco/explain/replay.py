"""Replays a script's steps with the script's MuJoCo, each from its recorded start state.

A step is replayed if it leads to the recorded state to the last bit. Only replayed steps are
explained: the sum of a step that leads to another state would close, too, but would not explain the
script's step.
"""

from __future__ import annotations

import copy
import struct
from collections import deque
from collections.abc import Callable, Iterator
from typing import Any

import mujoco
import numpy as np

from .. import frames, memory
from ..frames import (
    APART,
    ASLEEP,
    CALLBACKS,
    CLOCK,
    LARGEST,
    NEAR,
    STALE,
    STATE,
    STEPS,
    UNPOSED,
    kind_of,
)
from .asked import Answer, StepsAsked, edits_of
from .batch import WaitingSteps
from .constraints import PairTable
from .flags import IPC, NO_ACTUATION, NO_RESET, SLEEP
from .integrators import EULER, IMPLICIT, IMPLICITFAST, RK4
from .layout import Layout
from .loaded import load
from .reasons import EXPLAINED, OTHER, REASONS, REPLAYED
from .summed import TermTable

CLOSES = 1e-11
"""A remainder up to this share of the largest impulse counts as rounding."""
TESTED = ((3, 3), (4, 0))
"""The first and last MuJoCo version for which steps are summed."""
MIDPOINT = ((3, 7), (3, 10))
"""The versions whose implicit integrators rotate free bodies by the midpoint rule."""
INSTABLE = tuple(
    int(getattr(mujoco.mjtWarning, f"mjWARN_BAD{name}")) for name in ("QPOS", "QVEL", "QACC")
)
"""The warnings upon which MuJoCo resets itself."""
VERSION = tuple(int(part) for part in mujoco.__version__.split(".")[:2])

UNREAD = ("geom_", "pair_", "exclude_", "site_", "hfield_", "body_invweight0", "dof_invweight0")
"""Model fields that no sum uses: an edit of one does not split a batch of steps."""
TAKEN = frames.arrays_bytes("taken", {})
"""The payload that marks the end of the answers to a request."""
CONTROL = CALLBACKS.index("control")
LARGEST_FLOAT32 = float(np.finfo(np.float32).max)
SPARE = 1 << 16
"""After this many steps without an explanation, the results so far are sent."""


class ReplayedModel:
    """A compiled model as loaded from the recording, with the script's edits.

    Parameters
    ----------
    number
        The model's number: how many models were loaded before it.
    path
        The model's file, in MuJoCo's binary format.
    """

    def __init__(self, number: int, path: str) -> None:
        self.number, self.is_edited = number, False
        self.m = mujoco.MjModel.from_binary_path(path)
        self._fields = {field.name: field for field in memory.fields_of(self.m)}
        self.layout = Layout(self.m, mujoco.MjData(self.m))
        self.terms, self.pairs = TermTable(), PairTable()
        self._look()

    def _look(self) -> None:
        """Find the features of the model that change how steps are replayed."""
        m = self.m
        self.timestep = float(m.opt.timestep)
        self.sparse = bool(mujoco.mj_isSparse(m))
        self.resets = not m.opt.disableflags & NO_RESET
        self.sleeps = bool(m.opt.enableflags & SLEEP)
        integrators = [self._integrator(which) for which in range(len(STEPS))]
        self.integrators = [(integrator, self._uncovered(integrator)) for integrator in integrators]
        """The integrator that each step function uses, and the reason why its steps have no sum, or
        ''."""

    def edit(self, name: str, indices: Any, values: Any) -> None:
        """Change elements of a field."""
        field, self.is_edited = self._fields[name], True
        held = np.frombuffer(memory.view_of(field.address, field.size), field.dtype)
        held[indices] = values
        self._look()

    def _integrator(self, which: int) -> int:
        """Return the integrator that a step function uses."""
        chosen = int(self.m.opt.integrator)
        if which == 0:
            return chosen
        if which == 3:
            return chosen if chosen in (IMPLICIT, IMPLICITFAST) else -1
        if which == 1 and chosen in (IMPLICIT, IMPLICITFAST):
            return chosen
        return RK4 if which == 4 else EULER

    def _uncovered(self, integrator: int) -> str:
        """Return why steps of an integrator cannot be explained; empty if they can."""
        m = self.m
        if integrator not in (EULER, RK4, IMPLICIT, IMPLICITFAST):
            return "integrator"
        if not TESTED[0] <= VERSION <= TESTED[1]:
            return "version"
        implicit = integrator in (IMPLICIT, IMPLICITFAST)
        if implicit and MIDPOINT[0] <= VERSION <= MIDPOINT[1] and len(self.layout.alone):
            return "version"
        if not m.nv:
            return "nothing moves"
        if m.nflex or m.opt.enableflags & IPC:
            return "flex"
        if m.nplugin:
            return "plugin"
        if getattr(m, "nplastic", 0):
            return "plastic"
        if getattr(m, "nhistory", 0):
            return "delay"
        if integrator == RK4 and m.opt.disableflags & NO_ACTUATION:
            return "integrator"  # its stages are seen by the callback of actuation
        return ""


class ReplayedData:
    """A simulation (MjData) whose recorded steps are replayed.

    Parameters
    ----------
    number
        The number of the simulation.
    model
        The model of the simulation.
    """

    def __init__(self, number: int, model: ReplayedModel) -> None:
        self.number, self.model = number, model
        self.d: Any = mujoco.MjData(model.m)
        self.other: _Elsewhere | None = None
        """A second MjData, in which the stages of a step are evaluated."""
        self.core, self.user = memory.core_of(self.d), memory.user_of(self.d)
        self.qpos, self.qvel = self.d.qpos, self.d.qvel
        self.warned = memory.warnings_of(self.d)
        self.batch: WaitingSteps | None = None
        self.is_applied = self.is_pushed = False
        self.reached = -1
        """The step whose start state the MjData contains, as the previous step has left it; -1 if
        none."""
        self.step = self.first = 0
        """The next step, and the first step since the last result was sent."""
        self.statuses: list[tuple[int, int]] = []
        """Status and reason of each step since the last result was sent."""

    def state(self) -> tuple[float, bytes, bytes]:
        """Return the current state."""
        return self.d.time, bytes(self.core.view), bytes(self.user.view)

    def restore(self, state: tuple[float, bytes, bytes]) -> None:
        """Restore a saved state."""
        self.d.time, core, user = state
        for stretch, held in ((self.core, core), (self.user, user)):
            if held:
                stretch.view[:] = held

    def write(self, name: str, indices: Any, values: Any) -> None:
        """Write elements of a state array."""
        held = getattr(self.d, name).reshape(-1).view(kind_of(name))
        if indices is None:
            held[:] = values
        else:
            held[indices] = values
        if name == "qfrc_applied":
            self.is_applied = bool(held.any())
        elif name == "xfrc_applied":
            self.is_pushed = bool(held.any())

    def load(self, state: dict[str, Any]) -> None:
        """Set the state, including the time, as if the previous steps had been made."""
        (self.d.time,) = state[CLOCK]
        load(self.model.m, self.d, {name: row for name, row in state.items() if name != CLOCK})

    def reach(self, asked: StepsAsked, step: int) -> None:
        """Set the state from which a step starts."""
        if self.reached != asked.first + step:
            self.load(asked.left(step) | asked.given(step))
            given = asked.given(step)
        else:
            given = asked.changed(step)
        written = asked.written(step)
        if written:
            slept = written.get(ASLEEP, ())
            if len(slept) and (slept != self.d.tree_asleep).any():
                self.load(written)
            (self.d.time,) = written.pop(CLOCK)
            for name, row in written.items():
                self.write(name, None, row)
        for name, row in given.items():
            self.write(name, None, row)


class Replay:
    """Serves requests to replay steps; keeps one simulation at a time."""

    def __init__(self) -> None:
        self._loaded = 0
        """Number of models loaded so far."""
        self._path = ""
        self._model: ReplayedModel | None = None
        self._data: ReplayedData | None = None
        self._set: frozenset[int] = frozenset()
        """The callbacks that are installed."""
        self._calls: dict[int, deque[Any]] = {}
        """Results of the script's callbacks that are still to be repeated in this step."""
        self._stages: list[bytes] | None = None
        """The states at RK4's stages, while a step is made."""
        self._now: ReplayedData | _Elsewhere | None = None
        mujoco.set_mju_user_warning(lambda _: None)  # they were said when the script ran

    def take(self, payload: bytes) -> Iterator[bytes]:
        """Handle a request."""
        head, arrays = frames.arrays_of(payload)
        do: Callable[..., Iterator[bytes]] = getattr(self, f"_on_{head.pop('what')}")
        yield from do(arrays, **head)

    # -- requests ---------------------------------------------------------------------------------

    def _on_constants(self, _: dict[str, Any], path: str) -> Iterator[bytes]:
        """Reply with the constants that the analysis needs from a model file."""
        m = mujoco.MjModel.from_binary_path(path)
        yield frames.arrays_bytes("constants", memory.constants_of(m))
        yield TAKEN

    def _on_simulation(
        self, arrays: dict[str, Any], world: int, version: str | None, path: str, edits: list[Any]
    ) -> Iterator[bytes]:
        """Load a model file, with the script's edits so far, to replay a simulation."""
        if version not in (None, mujoco.__version__):
            raise SystemExit(f"the script ran with mujoco {version}, this is {mujoco.__version__}")
        if self._model is None or path != self._path or self._model.is_edited:
            self._data = self._model = None  # before another one takes as much memory
            self._model, self._path = ReplayedModel(self._loaded, path), path
            self._loaded += 1
        for edit in edits_of(arrays, edits):
            self._model.edit(edit.name, edit.indices, edit.values)
        self._data = ReplayedData(world, self._model)
        yield from ()

    def _on_steps(self, arrays: dict[str, Any], **head: Any) -> Iterator[bytes]:
        """Replay and explain the steps of a chunk."""
        state, asked = self._data, StepsAsked(arrays, **head)
        assert state is not None
        cores = asked.cores(state.core)
        begin = asked.begin
        if begin and asked.functions[begin] & UNPOSED and state.reached != asked.first + begin:
            state.reach(asked, begin - 1)  # positions are those of the step before
            take(state.model.m, state, int(asked.functions[begin - 1]) & 15)
            state.reached = asked.first + begin
        state.step = state.first = asked.first + begin
        for step in range(begin, asked.end):
            for edit in asked.edits.get(step, ()):
                if not edit.name.startswith(UNREAD):
                    yield from self._finish(state)
                state.model.edit(edit.name, edit.indices, edit.values)
            state.reach(asked, step)
            yield from self._step(state, asked, step, cores[step].tobytes())
        yield from self._finish(state)
        yield TAKEN

    def _on_states(self, arrays: dict[str, Any], **head: Any) -> Iterator[bytes]:
        """Replay steps from their recorded starts; reply with the resulting states."""
        state, asked = self._data, StepsAsked(arrays, **head)
        assert state is not None
        m, d = state.model.m, state.d
        rows: dict[str, list[Any]] = {}
        for step in range(asked.begin, asked.end):
            for edit in asked.edits.get(step, ()):
                state.model.edit(edit.name, edit.indices, edit.values)
            state.reached = -1
            state.reach(asked, step)
            answers = asked.answers(step, m.nv)
            self._set_callbacks(frozenset(which for which, _ in answers))
            self._now, self._calls = state, by_callback(answers)
            function = int(asked.functions[step])
            if function & STALE:
                take_stale(state, state.state(), asked.posed(step), function & 15)
            else:
                take(m, state, function & 15)
            self._now = None
            rows.setdefault(CLOCK, []).append(d.time)
            for name in STATE:
                if getattr(d, name, _NOTHING).size:
                    row = getattr(d, name).reshape(-1).view(kind_of(name))
                    rows.setdefault(name, []).append(row.astype(np.float64))
        yield frames.arrays_bytes("states", {name: np.array(each) for name, each in rows.items()})
        yield TAKEN

    # -- callbacks --------------------------------------------------------------------------------

    def _set_callbacks(self, which: frozenset[int]) -> None:
        """Install callbacks that repeat what the script's callbacks returned or wrote."""
        for number in which ^ self._set:
            answer = (lambda *_, number=number: self._answer(number)) if number in which else None
            getattr(mujoco, f"set_mjcb_{CALLBACKS[number]}")(answer)
        self._set = which

    def _answer(self, which: int) -> Any:
        """Repeat what a callback of the script returned or wrote when it was called here."""
        state = self._now
        if state is None:
            return 0.0
        if self._stages is not None and which == CONTROL:
            self._stages.append(bytes(state.core.view) + struct.pack("<d", state.d.time))
        left = self._calls.get(which)
        if not left:
            return 0.0
        answer = left.popleft()
        if isinstance(answer, list):
            for name, indices, values in answer:
                state.write(name, indices, values)
            return None
        return int(answer) if CALLBACKS[which] == "contactfilter" else answer

    # -- steps ------------------------------------------------------------------------------------

    def _step(
        self, state: ReplayedData, asked: StepsAsked, step: int, core: bytes
    ) -> Iterator[bytes]:
        """Replay a step, compare the result with the recording, and copy forces to explain it."""
        model, d = state.model, state.d
        m, time_s = model.m, float(asked.clock_s[step])
        function, answers = int(asked.functions[step]), asked.answers(step, model.m.nv)
        which, flags = function & 15, function & (STALE | UNPOSED)
        integrator, reason = model.integrators[which]
        if model.sleeps and (d.tree_asleep >= 0).any():
            reason = reason or "sleep"
        batch = None
        if not reason:
            batch = state.batch
            if batch is None or batch.integrator != integrator or batch.is_full:
                yield from self._finish(state)
                batch = state.batch = self._batch(state, integrator)
            batch.before(state.qpos, state.qvel)
        stepping = integrator == RK4 and batch is not None
        before = state.state() if flags or stepping else None
        spare = copy.copy(d) if flags & UNPOSED else None
        warned = state.warned.tobytes() if model.resets else b""
        next_s = d.time + model.timestep
        stages: list[bytes] | None = [] if stepping else None
        # The stages of a step are seen by a callback.
        self._set_callbacks(
            frozenset(which for which, _ in answers) | ({CONTROL} if stepping else set())
        )
        foreign = function & (NEAR | APART)
        self._now, self._calls, self._stages = state, by_callback(answers), stages
        flags_before = int(m.opt.disableflags)
        if foreign:  # it went on with numbers at which MuJoCo starts again
            m.opt.disableflags = flags_before | NO_RESET
        take(m, state, which)
        m.opt.disableflags = flags_before
        self._now = self._stages = None
        equal = d.time == time_s and _equal(state.core, core)
        same = bool(foreign) or equal
        state.reached = asked.first + step + 1 if equal else -1
        status = EXPLAINED
        if not same:
            status, reason = OTHER, "unknown"
            if before is not None and flags & STALE:
                self._now, self._calls = state, by_callback(answers)
                take_stale(state, before, asked.posed(step), which)
                self._now = None
                if d.time == time_s and _equal(state.core, core):
                    reason = "stale"
            elif spare is not None:
                _finish_step(m, spare, which)
                reached = memory.core_of(spare)
                if spare.time == time_s and _equal(reached, core):
                    reason = "stale"
        elif warned and not foreign and (time_s != next_s or _has_warned(warned, state.warned)):
            status, reason = REPLAYED, "auto-reset"
        elif model.sleeps and (d.tree_asleep >= 0).any():
            status, reason = REPLAYED, reason or "sleep"  # what falls asleep is stopped
        elif batch is None:
            status = REPLAYED
        elif stages is not None and before is not None:
            if len(stages) != 4:
                status, reason = REPLAYED, "integrator"
            else:
                self._evaluate(state, batch, before, stages, answers)
        else:
            batch.evaluated(model.sparse, state.is_applied, state.is_pushed)
        if status == EXPLAINED and batch is not None:
            gap = asked.reached("qvel", step) - state.qvel if foreign else None
            batch.after(state.step, state.qpos, state.qvel, model.timestep, gap)
            if foreign & APART:
                status, reason = REPLAYED, "another engine"
            elif foreign and not _goes_on(asked, step):
                status, reason = REPLAYED, "auto-reset"
        state.statuses.append((status, REASONS.index(reason)))
        state.step += 1
        if len(state.statuses) >= SPARE:
            yield from self._finish(state)

    def _batch(self, state: ReplayedData, integrator: int) -> WaitingSteps:
        model, d = state.model, state.d
        if integrator == RK4:
            state.other = state.other or _Elsewhere(mujoco.MjData(model.m))
            d = state.other.d
        return WaitingSteps(model.m, d, model.layout, model.terms, model.pairs, integrator, VERSION)

    def _evaluate(
        self,
        state: ReplayedData,
        batch: WaitingSteps,
        before: tuple[float, bytes, bytes],
        stages: list[bytes],
        answers: list[Answer],
    ) -> None:
        """Evaluate RK4's stages once more, to copy the forces of each."""
        m, other = state.model.m, state.other
        assert other is not None
        sparse = state.model.sparse
        calls = by_callback(answers)
        if other.user.size:
            other.user.view[:] = before[2]
        for stage in stages:
            other.core.view[:] = stage[:-8]
            (other.d.time,) = struct.unpack("<d", stage[-8:])
            self._now, self._calls = other, calls
            mujoco.mj_forward(m, other.d)
            self._now = None
            batch.evaluated(sparse, state.is_applied, state.is_pushed)

    def _finish(self, state: ReplayedData) -> Iterator[bytes]:
        """Explain the waiting steps, and send explanations and outcomes not yet sent."""
        arrays: dict[str, Any] = {}
        said: dict[str, Any] = {}
        if state.statuses:
            statuses = np.array(state.statuses, np.uint8)
            if state.batch is not None and state.batch.steps:
                answer = state.batch.explain(sparse=state.model.sparse)
                arrays = self._packed(state, answer, statuses)
                said = self._said(state.model)
            arrays["status"], arrays["reason"] = statuses.T
            yield frames.arrays_bytes(
                "explained",
                arrays,
                world=state.number,
                model=state.model.number,
                first=state.first,
                **said,
            )
        state.first, state.statuses = state.step, []

    def _packed(self, state: ReplayedData, answer: Any, statuses: Any) -> dict[str, Any]:
        """Pack explanations and outcomes; steps whose sums leave a remainder are unexplained."""
        summed = answer.summed
        open_ = answer.steps[~(summed.remainder <= CLOSES)] - state.first
        statuses[open_, 0], statuses[open_, 1] = REPLAYED, REASONS.index("remainder")
        arrays = {
            "steps": answer.steps.astype(np.int32),
            "pattern": summed.patterns.astype(np.int32),
            "values": summed.values,
            "remainder": summed.remainder.astype(np.float32),
            "largest": np.minimum(summed.largest, LARGEST_FLOAT32).astype(np.float32),
        }
        points = answer.points
        if len(points):
            counts = np.searchsorted(points["row"], answer.steps, "right")
            arrays["point.count"] = np.diff(counts, prepend=0).astype(np.int32)
            arrays |= {f"point.{name}": points[name] for name in points.dtype.names[1:]}
        return arrays

    def _said(self, model: ReplayedModel) -> dict[str, Any]:
        """Return the force terms, sets of terms and geom pairs that were not sent before."""
        terms, pairs = model.terms, model.pairs
        new = [
            [kind, first, second, dofs.tolist()]
            for kind, first, second, dofs in terms.made[terms.told :]
        ]
        patterns = [pattern.tolist() for pattern in terms.patterns[terms.patterns_told :]]
        met = pairs.made[pairs.told :]
        terms.told, terms.patterns_told = len(terms.made), len(terms.patterns)
        pairs.told = len(pairs.made)
        return {"terms": new, "patterns": patterns, "pairs": met}


def _goes_on(asked: StepsAsked, step: int) -> bool:
    """Return whether positions and velocities after a step are within MuJoCo's limits."""
    moving = (asked.reached(name, step) for name in ("qpos", "qvel"))
    return all(bool((np.abs(rows) <= LARGEST).all()) for rows in moving)


class _Elsewhere:
    """Another MjData, to which a callback's writes are directed."""

    def __init__(self, d: Any) -> None:
        self.d, self.core, self.user = d, memory.core_of(d), memory.user_of(d)

    def write(self, name: str, indices: Any, values: Any) -> None:
        """Write elements of a state array."""
        held = getattr(self.d, name).reshape(-1).view(kind_of(name))
        held[slice(None) if indices is None else indices] = values


_NOTHING = np.empty(0)


def by_callback(answers: list[tuple[int, Any]]) -> dict[int, deque[Any]]:
    """Return what each callback returned or wrote, in order of its calls."""
    found: dict[int, deque[Any]] = {}
    for which, answer in answers:
        found.setdefault(which, deque()).append(answer)
    return found


def take(m: Any, state: ReplayedData, which: int) -> None:
    """Make one step with the MuJoCo function that the script called, by its index in `STEPS`."""
    d = state.d
    if which == 0:
        mujoco.mj_step(m, d)
        return
    user = bytes(state.user.view)
    (mujoco.mj_step1 if which == 1 else mujoco.mj_forward)(m, d)
    state.user.view[:] = user
    _finish_step(m, d, which)


def take_stale(
    state: ReplayedData, before: tuple[float, bytes, bytes], posed: dict[str, Any], which: int
) -> None:
    """Make a step's second half with derived positions that belong to an older state."""
    m, d = state.model.m, state.d
    state.restore(before)
    for name, row in posed.items():
        state.write(name, None, row)
    (mujoco.mj_step1 if which == 1 else mujoco.mj_forward)(m, d)
    state.restore(before)
    _finish_step(m, d, which)


def _finish_step(m: Any, d: Any, which: int) -> None:
    """Make the second half of a step, after positions were computed."""
    if which == 4:
        mujoco.mj_RungeKutta(m, d, 4)
    else:
        (mujoco.mj_step2, mujoco.mj_Euler, mujoco.mj_implicit)[which - 1](m, d)


def _equal(reached: memory.StateMemory, core: bytes) -> bool:
    """Return whether a step led to the recorded state bit for bit, ignoring padding bytes."""
    if reached.view.tobytes() == core:
        return True
    return all(part.view.tobytes() == core[part.begin : part.end] for part in reached.parts)


def _has_warned(before: bytes, now: memoryview) -> bool:
    """Return whether MuJoCo gave a warning with which it resets the simulation.

    If MuJoCo has reset itself before, the counter stays, but the time goes back.
    """
    if before == now:
        return False
    was = np.frombuffer(before, np.int32).reshape(-1, 2)[:, 1]
    is_ = np.frombuffer(now, np.int32).reshape(-1, 2)[:, 1]
    return bool((is_[list(INSTABLE)] > was[list(INSTABLE)]).any())
