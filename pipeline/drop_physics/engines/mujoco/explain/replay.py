"""A script's steps, taken again from what its process has sent.

A step is replayed if it leads to the recorded state to the last bit. Only such a step is explained:
the sum of one that leads elsewhere would close, too, and say nothing of the script's.
"""

from __future__ import annotations

import copy
import json
import struct
from collections import deque
from collections.abc import Callable, Iterator
from typing import Any

import mujoco
import numpy as np

from .. import frames, memory
from ..frames import CALLBACKS, CAUSES, STALE, STEPS, UNPOSED, kind_of
from .batch import WaitingSteps
from .constraints import PairTable
from .flags import IPC, NO_ACTUATION, NO_RESET, SLEEP
from .integrators import EULER, IMPLICIT, IMPLICITFAST, RK4
from .layout import Layout
from .reasons import EXPLAINED, OTHER, REASONS, REPLAYED
from .summed import TermTable

CLOSES = 1e-11
"""A remainder up to this share of the largest impulse is rounding."""
TESTED = ((3, 3), (4, 0))
"""The first and last version whose steps have a sum."""
MIDPOINT = ((3, 7), (3, 10))
"""The versions whose implicit integrators turn bodies that move freely by a rule of their own."""
INSTABLE = tuple(
    int(getattr(mujoco.mjtWarning, f"mjWARN_BAD{name}")) for name in ("QPOS", "QVEL", "QACC")
)
"""The warnings with which MuJoCo resets itself."""
VERSION = tuple(int(part) for part in mujoco.__version__.split(".")[:2])

UNREAD = ("geom_", "pair_", "exclude_", "site_", "hfield_", "body_invweight0", "dof_invweight0")
"""Fields of a model that no sum is made of: an edit does not part the steps that it is between."""
SPARE = 1 << 16
"""Results of so many unexplained steps are sent at once."""


class ReplayedModel:
    """A model as the script had it.

    Parameters
    ----------
    number
        Its number in the stream.
    binary
        It in MuJoCo's binary form.
    names
        What may be edited in it, as the stream numbers it.
    """

    def __init__(self, number: int, binary: bytes, names: list[str]) -> None:
        self.number, self.names = number, names
        self.m = mujoco.MjModel.from_binary_path("model.mjb", {"model.mjb": binary})
        places = {field.name: field for field in memory.fields_of(self.m)}
        self.fields = [places[name] for name in names]
        self.layout = Layout(self.m, mujoco.MjData(self.m))
        self.terms, self.pairs = TermTable(), PairTable()
        self._look()

    def _look(self) -> None:
        """Read what each step asks of the model."""
        m = self.m
        self.timestep = float(m.opt.timestep)
        self.sparse = bool(mujoco.mj_isSparse(m))
        self.resets = not m.opt.disableflags & NO_RESET
        self.sleeps = bool(m.opt.enableflags & SLEEP)
        integrators = [self._integrator(which) for which in range(len(STEPS))]
        self.integrators = [(each, self._uncovered(each)) for each in integrators]
        """The integrator that each function uses, and why its steps have no sum."""

    def edit(self, number: int, indices: Any, values: Any) -> None:
        """Change elements of a field."""
        field = self.fields[number]
        held = np.frombuffer(memory.view_of(field.address, field.size), field.dtype)
        held[indices] = values
        self._look()

    def _integrator(self, which: int) -> int:
        """Return the integrator that a function uses."""
        chosen = int(self.m.opt.integrator)
        if which == 0:
            return chosen
        if which == 3:
            return chosen if chosen in (IMPLICIT, IMPLICITFAST) else -1
        if which == 1 and chosen in (IMPLICIT, IMPLICITFAST):
            return chosen
        return RK4 if which == 4 else EULER

    def _uncovered(self, integrator: int) -> str:
        """Return why steps with an integrator have no sum, or nothing."""
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
    """A simulation that is replayed.

    Parameters
    ----------
    number
        Its number in the stream.
    model
        Its model.
    size
        Bytes of the core of its state.
    """

    def __init__(self, number: int, model: ReplayedModel, size: int) -> None:
        self.number = number
        self.step = 0
        self.posed: list[tuple[str, Any, Any]] = []
        """What data are of another state in the next step."""
        self.answers: list[tuple[int, Any]] = []
        """What callbacks do within the next step."""
        self.statuses: list[tuple[int, int]] = []
        """Status and reason of the steps since the last result."""
        self.first = 0
        """The first of these."""
        self.use(model)
        if self.core.size != size:
            raise LookupError(f"a state has {self.core.size} bytes here, and {size} in the script")

    def use(self, model: ReplayedModel) -> None:
        """Go on with a model."""
        before = None if not hasattr(self, "d") else self.state()
        self.model, m = model, model.m
        self.d: Any = mujoco.MjData(m)
        self.other: Any = None
        """Data in which the stages of a step are evaluated."""
        self.core, self.user = memory.core_of(self.d), memory.user_of(self.d)
        for part in (*self.core.parts, *self.user.parts, *memory.asleep_of(self.d).parts):
            part.view[:] = bytes(part.size)
        self.d.time = 0.0
        if before is not None:
            self.load(self.d, before)
        self.qpos, self.qvel = self.d.qpos, self.d.qvel
        self.warned = memory.warnings_of(self.d)
        self.batch: WaitingSteps | None = None
        self.is_applied = bool(self.d.qfrc_applied.any())
        self.is_pushed = bool(self.d.xfrc_applied.any())

    def state(self) -> tuple[float, bytes, bytes]:
        """Return the state as it is."""
        return self.d.time, bytes(self.core.view), bytes(self.user.view)

    def load(self, d: Any, state: tuple[float, bytes, bytes]) -> None:
        """Set the state of these data."""
        d.time, core, user = state
        for stretch, held in ((self.core, core), (self.user, user)):
            if held:
                stretch.view[:] = held

    def write(self, name: str, indices: Any, values: Any) -> None:
        """Write elements of a part of the state."""
        held = getattr(self.d, name).reshape(-1).view(kind_of(name))
        if indices is None:
            held[:] = values
        else:
            held[indices] = values
        if name == "qfrc_applied":
            self.is_applied = bool(held.any())
        elif name == "xfrc_applied":
            self.is_pushed = bool(held.any())


class Replay:
    """Takes a stream's payloads, and yields payloads that answer."""

    def __init__(self) -> None:
        self._models: dict[int, ReplayedModel] = {}
        self._binaries: dict[str, bytearray] = {}
        self._waiting: dict[int, dict[str, Any]] = {}
        """Models that were named and are not complete."""
        self._data: dict[int, ReplayedData] = {}
        self._calls: dict[int, deque[Any]] = {}
        """What is left of the answers of each callback."""
        self._stages: list[bytes] | None = None
        """The states that a step of RK4 goes through, while it is taken."""
        self._now: ReplayedData | _Elsewhere | None = None
        mujoco.set_mju_user_warning(lambda _: None)  # they were said when the script ran

    def take(self, payload: bytes) -> Iterator[bytes]:
        """Take a payload."""
        kind = payload[:1]
        if kind == frames.STEP:
            _, function, _, number, _, time_s = frames.STEP_HEAD.unpack_from(payload)
            state = self._data[number]
            yield from self._step(state, function, time_s, payload[frames.STEP_HEAD.size :])
        elif kind == frames.WRITTEN:
            self._written(payload)
        elif kind == frames.EDITED:
            yield from self._edited(payload)
        elif kind == frames.CALLBACK:
            self._called(payload)
        elif kind == frames.ARRAYS:
            head, arrays = frames.arrays_of(payload)
            if head["what"] == "binary":
                self._binaries[head["digest"]][head["at"] :] = arrays["bytes"].tobytes()
        elif kind == frames.NOTE:
            note = json.loads(payload[1:])
            do: Callable[..., Any] | None = getattr(self, f"_on_{note.pop('what')}", None)
            if do is not None:
                yield from do(**note) or ()

    def rest(self) -> Iterator[bytes]:
        """Explain what is left; the stream is over."""
        for state in self._data.values():
            yield from self._finish(state)

    # -- notes ------------------------------------------------------------------------------------

    def _on_mujoco(self, version: str, **_: Any) -> None:
        if version != mujoco.__version__:
            raise SystemExit(f"the script ran with mujoco {version}, this is {mujoco.__version__}")

    def _on_model(self, number: int, digest: str, fields: list[Any], **_: Any) -> None:
        self._binaries.setdefault(digest, bytearray())
        self._waiting[number] = {"digest": digest, "names": [name for name, *_ in fields]}

    def _on_world(self, number: int, model: int, core_bytes: int, **_: Any) -> None:
        self._data[number] = ReplayedData(number, self._model(model), core_bytes)

    def _on_model_of(self, world: int, model: int) -> Iterator[bytes]:
        state = self._data[world]
        yield from self._finish(state)
        state.use(self._model(model))

    def _on_callback(self, name: str, on: bool) -> None:
        which = CALLBACKS.index(name[5:])
        callback = (lambda *_: self._answer(which)) if on else None
        getattr(mujoco, f"set_{name}")(callback)

    def _model(self, number: int) -> ReplayedModel:
        waiting = self._waiting.pop(number, None)
        if waiting is not None:
            binary = bytes(self._binaries[waiting["digest"]])
            self._models[number] = ReplayedModel(number, binary, waiting["names"])
        return self._models[number]

    # -- what the script did ----------------------------------------------------------------------

    def _written(self, payload: bytes) -> None:
        _, cause, count, number, _, _, time_s = frames.WRITTEN_HEAD.unpack_from(payload)
        at, state = frames.WRITTEN_HEAD.size, self._data[number]
        posed = CAUSES[cause] == "posed"
        for _ in range(count):
            name, indices, values, at = frames.part_of(payload, at)
            if posed:
                state.posed.append((name, indices, values))
            else:
                state.write(name, indices, values)
        if not posed:
            state.d.time = time_s

    def _edited(self, payload: bytes) -> Iterator[bytes]:
        _, _, field, number, _, _, count = frames.EDITED_HEAD.unpack_from(payload)
        model = self._models[number]
        for state in self._data.values():
            if state.model is model and not model.names[field].startswith(UNREAD):
                yield from self._finish(state)
        at = frames.EDITED_HEAD.size
        indices = np.frombuffer(payload, np.uint32, count, at)
        values = np.frombuffer(payload, model.fields[field].dtype, count, at + 4 * count)
        model.edit(field, indices, values)

    def _called(self, payload: bytes) -> None:
        *_, number, count = frames.CALLBACK_HEAD.unpack_from(payload)
        at, state = frames.CALLBACK_HEAD.size, self._data[number]
        for _ in range(count):
            which = payload[at]
            at += 1
            if CALLBACKS[which] not in ("control", "passive", "sensor"):
                state.answers.append((which, struct.unpack_from("<d", payload, at)[0]))
                at += 8
                continue
            parts, many = [], payload[at]
            at += 1
            for _ in range(many):
                *part, at = frames.part_of(payload, at)
                parts.append(part)
            if CALLBACKS[which] == "passive":
                nv = state.model.m.nv
                parts.append(["qfrc_passive", None, np.frombuffer(payload, np.float64, nv, at)])
                at += 8 * nv
            state.answers.append((which, parts))

    def _answer(self, which: int) -> Any:
        """Do again what a callback of the script did."""
        state = self._now
        if state is None:
            return 0.0
        if self._stages is not None and which == 0:
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
        self, state: ReplayedData, function: int, time_s: float, core: bytes
    ) -> Iterator[bytes]:
        """Take a step, compare, and keep what it takes to explain it."""
        model, d = state.model, state.d
        m = model.m
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
        self._now, self._calls = state, _by_callback(state.answers)
        stages: list[bytes] | None = [] if stepping else None
        self._stages = stages
        if stepping:  # its stages are seen by a callback
            mujoco.set_mjcb_control(lambda *_: self._answer(0))
        _take(m, state, which)
        self._now = self._stages = None
        same = d.time == time_s and _equal(state.core, core)
        status = EXPLAINED
        if not same:
            status, reason = OTHER, "unknown"
            if before is not None and flags & STALE:
                reason = self._stale(state, before, which, time_s, core)
            elif spare is not None:
                _finish_step(m, spare, which)
                reached = memory.core_of(spare)
                if spare.time == time_s and _equal(reached, core):
                    reason = "stale"
            d.time, state.core.view[:] = time_s, core
        elif warned and (time_s != next_s or _has_warned(warned, state.warned)):
            status, reason = REPLAYED, "auto-reset"
        elif model.sleeps and (d.tree_asleep >= 0).any():
            status, reason = REPLAYED, reason or "sleep"  # what falls asleep is stopped
        elif batch is None:
            status = REPLAYED
        elif stages is not None and before is not None:
            if len(stages) != 4:
                status, reason = REPLAYED, "integrator"
            else:
                self._evaluate(state, batch, before, stages)
        else:
            batch.evaluated(model.sparse, state.is_applied, state.is_pushed)
        if status == EXPLAINED and batch is not None:
            batch.after(state.step, state.qpos, state.qvel, model.timestep)
        state.answers, state.posed = [], []
        state.statuses.append((status, REASONS.index(reason)))
        state.step += 1
        if len(state.statuses) >= SPARE:
            yield from self._finish(state)

    def _batch(self, state: ReplayedData, integrator: int) -> WaitingSteps:
        model, d = state.model, state.d
        if integrator == RK4:
            state.other = d = state.other or mujoco.MjData(model.m)
        return WaitingSteps(model.m, d, model.layout, model.terms, model.pairs, integrator, VERSION)

    def _evaluate(
        self,
        state: ReplayedData,
        batch: WaitingSteps,
        before: tuple[float, bytes, bytes],
        stages: list[bytes],
    ) -> None:
        """Compute again what a step of RK4 has computed in its stages."""
        m, other = state.model.m, state.other
        core, user = memory.core_of(other), memory.user_of(other)
        sparse = state.model.sparse
        calls = _by_callback(state.answers)
        if user.size:
            user.view[:] = before[2]
        for stage in stages:
            core.view[:] = stage[:-8]
            (other.time,) = struct.unpack("<d", stage[-8:])
            self._now, self._calls = _Elsewhere(other), calls
            mujoco.mj_forward(m, other)
            self._now = None
            batch.evaluated(sparse, state.is_applied, state.is_pushed)

    def _stale(
        self,
        state: ReplayedData,
        before: tuple[float, bytes, bytes],
        which: int,
        time_s: float,
        core: bytes,
    ) -> str:
        """Return whether a step with data of the state that was sent leads to the recorded one."""
        m, d = state.model.m, state.d
        state.load(d, before)
        for name, indices, values in state.posed:
            state.write(name, indices, values)
        self._now, self._calls = state, _by_callback(state.answers)
        (mujoco.mj_step1 if which == 1 else mujoco.mj_forward)(m, d)
        state.load(d, before)
        _finish_step(m, d, which)
        self._now = None
        return "stale" if d.time == time_s and _equal(state.core, core) else "unknown"

    def _finish(self, state: ReplayedData) -> Iterator[bytes]:
        """Explain what waits, and send it with what became of the steps since."""
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
        """Return an answer's arrays; steps whose sum leaves something are not explained."""
        summed = answer.summed
        open_ = answer.steps[~(summed.remainder <= CLOSES)] - state.first
        statuses[open_, 0], statuses[open_, 1] = REPLAYED, REASONS.index("remainder")
        arrays = {
            "steps": answer.steps.astype(np.int32),
            "pattern": summed.patterns.astype(np.int32),
            "values": summed.values,
            "remainder": summed.remainder.astype(np.float32),
            "largest": summed.largest.astype(np.float32),
        }
        points = answer.points
        if len(points):
            counts = np.searchsorted(points["row"], answer.steps, "right")
            arrays["point.count"] = np.diff(counts, prepend=0).astype(np.int32)
            arrays |= {f"point.{name}": points[name] for name in points.dtype.names[1:]}
        return arrays

    def _said(self, model: ReplayedModel) -> dict[str, Any]:
        """Return the terms, patterns and pairs that were not sent yet."""
        terms, pairs = model.terms, model.pairs
        new = [
            [kind, first, second, dofs.tolist()]
            for kind, first, second, dofs in terms.made[terms.told :]
        ]
        patterns = [each.tolist() for each in terms.patterns[terms.patterns_told :]]
        met = pairs.made[pairs.told :]
        terms.told, terms.patterns_told = len(terms.made), len(terms.patterns)
        pairs.told = len(pairs.made)
        return {"terms": new, "patterns": patterns, "pairs": met}


class _Elsewhere:
    """Writes what a callback wrote into other data."""

    def __init__(self, d: Any) -> None:
        self.d, self.core = d, memory.core_of(d)

    def write(self, name: str, indices: Any, values: Any) -> None:
        """Write elements of a part of the state."""
        held = getattr(self.d, name).reshape(-1).view(kind_of(name))
        held[slice(None) if indices is None else indices] = values


def _by_callback(answers: list[tuple[int, Any]]) -> dict[int, deque[Any]]:
    """Return the answers of each callback, in order."""
    found: dict[int, deque[Any]] = {}
    for which, answer in answers:
        found.setdefault(which, deque()).append(answer)
    return found


def _take(m: Any, state: ReplayedData, which: int) -> None:
    """Take a step as the script did."""
    d = state.d
    if which == 0:
        mujoco.mj_step(m, d)
        return
    user = bytes(state.user.view)
    (mujoco.mj_step1 if which == 1 else mujoco.mj_forward)(m, d)
    state.user.view[:] = user
    _finish_step(m, d, which)


def _finish_step(m: Any, d: Any, which: int) -> None:
    """Take the second half of a step."""
    if which == 4:
        mujoco.mj_RungeKutta(m, d, 4)
    else:
        (mujoco.mj_step2, mujoco.mj_Euler, mujoco.mj_implicit)[which - 1](m, d)


def _equal(reached: memory.StateMemory, core: bytes) -> bool:
    """Return whether a step led to a recorded core; what lies between its parts does not count."""
    if reached.view.tobytes() == core:
        return True
    return all(part.view.tobytes() == core[part.begin : part.end] for part in reached.parts)


def _has_warned(before: bytes, now: memoryview) -> bool:
    """Return whether a warning with which MuJoCo resets itself has become more frequent.

    Where it has reset itself before, it has not, but the time has gone back.
    """
    if before == now:
        return False
    was = np.frombuffer(before, np.int32).reshape(-1, 2)[:, 1]
    is_ = np.frombuffer(now, np.int32).reshape(-1, 2)[:, 1]
    return bool((is_[list(INSTABLE)] > was[list(INSTABLE)]).any())
