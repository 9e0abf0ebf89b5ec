"""Makes trial changes in a MuJoCo script's run: to model, inputs or state, at each call.

The model is changed only while a function of MuJoCo runs: the changed values are recorded and
replayed, but the script reads and edits its own values. The changes arrive as data;
`engines/mujoco/interventions.py` defines them.
"""

from __future__ import annotations

import ctypes
import random
import weakref
from bisect import bisect_right
from collections.abc import Callable, Iterator, Mapping, Sequence
from threading import Lock, get_ident
from typing import TYPE_CHECKING, Any

import numpy as np

from ...watching.operators import becoming
from ...watching.single_changes import Change
from ...watching.sites import caller
from ..frames import READS, STEPS
from .derived import DerivedFields
from .seen import SeenInputs
from .single_changes import ENGINE, operations_of, started
from .writes import (
    BALL,
    BY_JOINT,
    FREE,
    Operation,
    Write,
    field_of,
    has_field,
    ids_of,
    set_field,
    sizes,
    writes_of,
)

if TYPE_CHECKING:
    from .hooks import MujocoWatch

SAME = 1e-6
"""Largest coordinate difference at which a pose counts as equal to a keyframe's [m, rad]."""
RESETS = ("mj_resetData", "mj_resetDataKeyframe", "mj_resetDataDebug", "mj_setState")
"""Functions that set the state by a call, unlike the script's own writes."""
LOADS = ("from_xml_path", "from_xml_string", "from_binary_path")
"""Functions that create a model from a file or a text."""


class ModelChanges:
    """The changes by which a trial run differs from the script's own run.

    Parameters
    ----------
    watch
        The watch that wraps the functions of mujoco.
    operations
        The operations of `interventions`; those for other engines are ignored.
    variation
        The variation of the run: `finer`, the engine's steps per step of the script; `nudge`, the
        largest displacement before the first step [m, rad], and `seed`, the seed of the random
        displacements.
    tell
        A function that is called with the number of an operation when that takes effect.
    """

    def __init__(
        self,
        watch: MujocoWatch,
        operations: Sequence[Operation],
        variation: Mapping[str, Any],
        tell: Callable[[int], None],
    ) -> None:
        self._watch, self._tell = watch, tell
        self._calls: dict[str, Callable[..., Any]] = {}
        self.become(operations, variation)

    def become(self, operations: Sequence[Operation], variation: Mapping[str, Any]) -> None:
        """Switch to other changes; allowed only before any has taken effect."""
        self.finer = int(variation.get("finer", 1))
        self._nudge = float(variation.get("nudge", 0.0))
        self._draw = random.Random(variation.get("seed", 0)).uniform
        self._operations = [
            each for each in enumerate(operations) if each[1].get("engine") == ENGINE
        ]
        """The operations, each with its number."""
        self._models: dict[int, ChangedModel] = {}
        """Changed models, by the `id` of the MjModel, which Python may reuse."""
        self._data: dict[int, ChangedData] = {}
        self.seen: dict[tuple[int, ...], SeenInputs] = {}
        """Contacts and inputs of the run, by model size, if an operation requests them."""
        self._sited = any("site" in each for _, each in self._operations)

    @property
    def any(self) -> bool:
        """True if this run differs in any way from the script's own."""
        return bool(self._operations) or self.finer > 1 or self._nudge > 0

    def fire(self, number: int) -> None:
        """Report that a change has taken effect."""
        if number >= 0:
            self._tell(number)

    def of(self, do: str) -> Iterator[tuple[int, Operation]]:
        """Yield the changes of one kind, such as `write`, with their indices."""
        return ((number, each) for number, each in self._operations if each["do"] == do)

    def on(self, m: Any) -> list[tuple[int, Operation]]:
        """Return the changes to a model and its states, with their indices."""
        found: list[tuple[int, Operation]] = []
        for number, each in self._operations:
            mine: Sequence[Operation] = [each]
            if each["do"] == "single":
                mine = [*operations_of(self._watch.mujoco, m, Change(**each["change"]))]
            found += [(number, one) for one in mine]
        return found

    def seen_of(self, m: Any, d: Any) -> SeenInputs | None:
        """Return the record of a model's contacts and inputs; models of equal size share one."""
        if not any(self.of("see")):
            return None
        return self.seen.setdefault(tuple(sizes(m)), SeenInputs(m, d))

    # -- in place of mujoco's functions -----------------------------------------------------------

    def around(self, name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        """Return a wrapper that applies the changes while one mujoco function runs."""
        self._calls[name] = call
        return self._stepping(name, call) if name in STEPS else self._other(name, call)

    def _other(self, name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        def changed(*args: Any, **kwargs: Any) -> Any:
            self._stop(steps=False)
            found = self._of(args, kwargs)
            if found is None:
                return call(*args, **kwargs)
            model, m, d = found
            site = self._site()
            for number, each in self.of("skip"):
                if (each["function"], each["site"]) == (name, site):
                    self.fire(number)
                    return None
            if name == "mj_step1":
                d.before(site)
            if name in RESETS:
                d.keep()
            if name in READS:
                self._pose(model, d)
            m.enter(model, site)
            try:
                result = call(*args, **kwargs)
            finally:
                m.leave(model)
            d.after(name)
            return result

        return self._watch.host.standing(call, changed)

    def _stepping(self, name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        # The hooks of steps count the calls between them and the script.
        def changed(*args: Any, **kwargs: Any) -> Any:
            self._stop(steps=True)
            found = self._of(args, kwargs)
            if found is None:
                return call(*args, **kwargs)
            model, m, d = found
            given = {**dict(zip(("m", "d", "nstep"), args)), **kwargs}
            repeats = given.pop("nstep", 1) if name == "mj_step" else 1
            site = self._site()
            for _ in range(repeats):
                d.before(site)
                m.enter(model, site)
                try:
                    if name == "mj_step2":
                        self._pose(model, d)
                    uncounted = self._watch.uncounted
                    for left in range(self.finer - 1, -1, -1):
                        if left:
                            uncounted.add(get_ident())
                        else:
                            uncounted.discard(get_ident())
                        if left == self.finer - 1 and name != "mj_step":
                            call(*args, **kwargs)
                        else:
                            self._calls["mj_step"](given["m"], given["d"])
                finally:
                    m.leave(model)
                d.after(name)
            return None

        return self._watch.host.standing(call, changed)

    def _stop(self, *, steps: bool) -> None:
        """Pause before a step at which trial runs are to be forked off."""
        if self._watch.host.forks is not None:
            self._watch.host.forks.stop(steps=steps)

    def _pose(self, m: Any, data: ChangedData) -> None:
        """Update derived data before a function that reads them without recomputing them."""
        for number, _ in self.of("pose"):
            if not data.is_posed:
                self.fire(number)
                self._calls["mj_step1"](m, data.ref())

    def _site(self) -> list[Any] | None:
        """Return the script's calling line, if any change applies to one line only."""
        if not self._sited:
            return None
        sites = self._watch.host.sites
        file, line = sites.place(sites.outside(caller()))
        return [file, line]

    def _of(self, args: Any, kwargs: Any) -> tuple[Any, ChangedModel, ChangedData] | None:
        """Return a call's MjModel, and the changes to it and its MjData; None if one is missing."""
        module, given = self._watch.mujoco, (*args, *kwargs.values())
        m = next((each for each in given if isinstance(each, module.MjModel)), None)
        d = next((each for each in given if isinstance(each, module.MjData)), None)
        if m is None or d is None:
            return None
        model, data = self._models.get(id(m)), self._data.get(id(d))
        if model is None or model.ref() is not m:
            model = self._models[id(m)] = ChangedModel(self, self._watch, m)
        if data is None or data.ref() is not d:
            data = self._data[id(d)] = ChangedData(self, self._watch, m, d)
        return m, model, data

    def displace(self, m: Any, d: Any) -> None:
        """Displace the joints of a simulation slightly, before its first step.

        Free bodies and balls are turned, too; their angular velocity keeps its direction in the
        world.
        """
        most = self._nudge
        if not most:
            return
        for joint in range(m.njnt):
            at, dof, kind = m.jnt_qposadr[joint], m.jnt_dofadr[joint], m.jnt_type[joint]
            if kind == FREE:
                d.qpos[at : at + 3] += self._small(3)
                at, dof = at + 3, dof + 3
            if kind in (FREE, BALL):
                self._turn(d.qpos[at : at + 4], d.qvel[dof : dof + 3])
            else:
                d.qpos[at] += self._draw(-most, most)

    def _small(self, count: int) -> Any:
        return np.array([self._draw(-self._nudge, self._nudge) for _ in range(count)])

    def _turn(self, orientation: Any, velocity: Any) -> None:
        """Turn a body slightly; its angular velocity is in its own axes."""
        module, turn, back = self._watch.mujoco, self._small(3), np.array([1.0, 0.0, 0.0, 0.0])
        module.mju_quatIntegrate(orientation, turn, 1.0)
        module.mju_quatIntegrate(back, -turn, 1.0)
        module.mju_rotVecQuat(velocity, velocity.copy(), back)

    # -- as a model is loaded ---------------------------------------------------------------------

    def install(self, module: Any) -> None:
        """Change models as they are loaded, if a change requires it."""
        for number, each in self.of("arena"):
            for name in LOADS:
                self._watch.replace_static(module.MjModel, name, self._loading(number, each))

    def _loading(self, number: int, operation: Operation) -> Callable[..., Any]:
        def after(original: Callable[..., Any]) -> Callable[..., Any]:
            def load(*args: Any, **kwargs: Any) -> Any:
                m = original(*args, **kwargs)
                held = _number_of(m, "narena")
                if held is not None:
                    held.value = int(held.value * operation["factor"])
                    self.fire(number)
                return m

            return load

        return after


class ChangedModel:
    """A model whose fields are changed only while a function of MuJoCo runs.

    Parameters
    ----------
    changes
        The changes of the trial run.
    watch
        The watch that wraps the functions of mujoco.
    m
        The MjModel; nothing here keeps it alive.
    """

    def __init__(self, changes: ModelChanges, watch: MujocoWatch, m: Any) -> None:
        self._changes, self._watch, self.ref = changes, watch, weakref.ref(m)
        self._lock, self._inside = Lock(), 0
        """A lock, and the number of functions that are running: several threads may use the model.
        """
        self._writes: list[tuple[int, Write]] = []
        operations = changes.on(m)
        for number, each in operations:
            self._writes += [(number, write) for write in writes_of(watch.mujoco, m, each)]
        if changes.finer > 1:
            self._writes.append((-1, ("opt.timestep", None, lambda held: held / changes.finer)))
        self._derives = [number for number, each in operations if each["do"] == "derive"]
        self._follows = [number for number, each in operations if each.get("derived")]
        """The changes that the script's own call of `mj_setConst` would follow."""
        self._keeps = [each for each in changes.of("keep") if has_field(m, each[1]["field"])]
        self._known: dict[str, Any] = {}
        """The script's own values of fields in which writes are undone."""
        self._kept: list[tuple[str, Any, Any]] = []
        """The script's own values, to be restored: field, elements, and their values."""
        self._compensated = _number_of(m, "ngravcomp") if self._derives or self._follows else None
        """The model's number of bodies with gravity compensation, which older versions count only
        as they compile."""
        self._derived = DerivedFields(watch.mujoco, watch.originals["mj_setConst"])

    def enter(self, m: Any, site: list[Any] | None) -> None:
        """Write the trial changes into the model before a call from a script line."""
        with self._lock:
            self._inside += 1
            if self._inside > 1:
                return
            for number, each in self._keeps:
                self._undo(m, number, each["field"], of_site=each["site"] == site)
            derives = [*self._derives]
            if self._follows and not self._derived.are_stale(m):
                derives += self._follows
            for number, (name, where, become) in self._writes:
                held = field_of(m, name)
                before = held if np.isscalar(held) else np.array(held[where])
                new = become(before)
                if not np.array_equal(new, before):
                    self._kept.append((name, where, before))
                    set_field(m, name, where, new)
                    self._changes.fire(number)
            if derives:
                self._derive(m, derives)

    def _undo(self, m: Any, number: int, name: str, *, of_site: bool) -> None:
        """Undo the script's write to a field since the last call, if the given line made it."""
        held = np.array(field_of(m, name))
        known = self._known.setdefault(name, held)
        if np.array_equal(held, known):
            return
        if of_site:
            set_field(m, name, ..., known if known.ndim else known.item())
            self._changes.fire(number)
        else:
            self._known[name] = held

    def leave(self, m: Any) -> None:
        """Restore the script's own values in the model after the call."""
        with self._lock:
            self._inside -= 1
            while self._kept and not self._inside:
                set_field(m, *self._kept.pop())

    def _derive(self, m: Any, numbers: Sequence[int]) -> None:
        """Write the fields that follow from the model's current masses, inertias and the like."""
        fields = self._derived.of(m)
        if self._compensated is not None:
            self._compensated.value = int(np.count_nonzero(m.body_gravcomp))
        for name, new in fields.items():
            held = getattr(m, name)
            if not np.array_equal(held, new):
                self._kept.append((name, ..., held.copy()))
                set_field(m, name, ..., new)
                for number in numbers:
                    self._changes.fire(number)


class ChangedData:
    """A simulation's state, into which trial changes are written around steps.

    After the step, the script's own inputs are restored.

    Parameters
    ----------
    changes
        The changes of the trial run.
    watch
        The watch that wraps the functions of mujoco.
    m, d
        The MjModel and the MjData; nothing here keeps them alive.
    """

    def __init__(self, changes: ModelChanges, watch: MujocoWatch, m: Any, d: Any) -> None:
        self._changes, self._watch = changes, watch
        self._model, self.ref = weakref.ref(m), weakref.ref(d)
        self._operations = changes.on(m)
        self._leaves, self._inputs = [*self._of("leave")], [*self._of("input")]
        self._input: dict[int, Any] = {}
        """The first or the last value of an input, by the operation's number."""
        self._own: list[tuple[int | None, Any, Sequence[int], Any]] = []
        """The script's own inputs during a step: part, elements, values; and the number of the
        operation that delays them by a step, or None."""
        self._seen = changes.seen_of(m, d)
        self._clears = [*self._of("clear")]
        self._held: dict[str, Any] = {}
        """Values of state parts after the last step."""
        if self._leaves:
            fresh = watch.mujoco.MjData(m)
            self._held = {e["part"]: getattr(fresh, e["part"]).copy() for _, e in self._leaves}
        self._holds = [number for number, _ in self._of("hold")]
        self._gives = [number for number, _ in self._of("give")]
        self._last: tuple[Any, Any] | None = None
        """Positions and controls after the last step, or before the last reset."""
        self._cleared: dict[str, bool] = {}
        """Whether a state part was cleared after the last step, by part."""
        self._time_s: float | None = None
        self._posed: bytes | None = None
        """The positions from which derived data were computed."""

    def _of(self, do: str) -> Iterator[tuple[int, Operation]]:
        return ((number, each) for number, each in self._operations if each["do"] == do)

    @property
    def is_posed(self) -> bool:
        """True if derived data, such as body poses, were computed from the current positions."""
        d = self.ref()
        return d is not None and self._posed == d.qpos.tobytes()

    def before(self, site: list[Any] | None) -> None:
        """Write the trial changes into state and inputs before a step from a script line."""
        m, d, fire = self._model(), self.ref(), self._changes.fire
        if m is None or d is None:
            return
        if self._seen is not None:
            self._seen.before(d)
        for number, each in self._leaves:
            if self._time_s is None and "site" not in each:  # how the script begins stays
                continue
            held, part = self._held[each["part"]], getattr(d, each["part"])
            part, its = (part, ...) if "ids" not in each else (part.reshape(-1), each["ids"])
            old = held.reshape(part.shape)[its]
            if each.get("site", site) == site and not np.array_equal(part[its], old):
                part[its] = old
                fire(number)
        for number, each in self._clears:
            if self._cleared.get(each["part"]) and not getattr(d, each["part"]).any():
                fire(number)
        if self._time_s is None:
            self._changes.displace(m, d)
        if self._time_s is None or d.time < self._time_s:
            self._begin(m, d)
        elif self._last is not None and self._holds:
            self._hold(m, d, *self._last)
        self._time_s = d.time
        for number, each in self._inputs:
            self._give(number, getattr(d, each["part"]).reshape(-1), each["ids"], each["how"])

    def _give(self, number: int, part: Any, its: Sequence[int], how: Sequence[Any]) -> None:
        """Replace an input of a step by its first, previous or recorded value, or change it."""
        own = part[its].copy()
        if how[0] == "held":
            new = self._input.setdefault(number, own)
        elif how[0] == "late":
            new = self._input.get(number, own)
        elif how[0] == "reversed":
            new = own[::-1]
        elif how[0] == "exchanged":
            new = np.roll(own, len(own) // 2)
        elif how[0] == "played":
            _, begins, rows = how
            which = bisect_right(begins, self._watch.host.steps_made) - 1
            new = np.array(rows[which]) if which < len(rows) else own
        else:
            new = becoming(own, how)
        self._own.append((number if how[0] == "late" else None, part, its, own))
        part[its] = new
        if not np.array_equal(part[its], own):
            self._changes.fire(number)

    def _begin(self, m: Any, d: Any) -> None:
        """Write changes to the start state at the start of an episode."""
        for number, each in self._of("lift"):
            for body in ids_of(self._watch.mujoco, m, "body", each):
                joint = m.body_jntadr[body]
                if joint >= 0 and m.jnt_type[joint] == FREE:
                    at = m.jnt_qposadr[joint]
                    d.qpos[at : at + 3] += each["by_m"]
                    self._changes.fire(number)
        for number, each in self._of("start"):
            part = getattr(d, each["part"])
            new = started(m, part, each["how"])
            if not np.array_equal(part, new):
                part[:] = new
                self._changes.fire(number)
        for number, _ in self._of("key"):
            for key in range(m.nkey):
                if np.abs(d.qpos - m.key_qpos[key]).max(initial=0.0) > SAME:
                    continue
                if not np.array_equal(d.ctrl, m.key_ctrl[key]):
                    d.ctrl[:] = m.key_ctrl[key]
                    self._changes.fire(number)
                break

    def _hold(self, m: Any, d: Any, qpos: Any, ctrl: Any) -> None:
        """Set the command of each servo to the position to which the script set its joint."""
        moved = d.qpos != qpos
        for actuator in range(m.nu):
            joint = m.actuator_trnid[actuator, 0]
            is_servo = m.actuator_trntype[actuator] in BY_JOINT and m.jnt_type[joint] > BALL
            if not is_servo or not m.actuator_biasprm[actuator, 1] < 0:
                continue
            at = m.jnt_qposadr[joint]
            if moved[at] and d.ctrl[actuator] == ctrl[actuator]:
                d.ctrl[actuator] = m.actuator_gear[actuator, 0] * d.qpos[at]
                for number in self._holds:
                    self._changes.fire(number)

    def keep(self) -> None:
        """Save positions and actuator commands before a function sets the state."""
        d = self.ref()
        if d is not None and self._gives:
            self._last = d.qpos.copy(), d.ctrl.copy()

    def after(self, name: str) -> None:
        """Save the state after a step or reset, to recognise later writes by the script."""
        d = self.ref()
        if d is None:
            return
        while self._own:
            number, part, its, own = self._own.pop()
            part[its] = own
            if number is not None and name in STEPS:
                self._input[number] = own
        if self._seen is not None and name in STEPS:
            self._seen.after(d)
        if name in ("mj_step1", "mj_forward"):
            self._posed = d.qpos.tobytes()
        if name in STEPS:
            for _, each in self._clears:
                part = getattr(d, each["part"])
                self._cleared[each["part"]] = bool(part.any())
                part[...] = 0.0
        if name in RESETS and self._last is not None and not d.ctrl.any() and self._last[1].any():
            for number in self._gives:
                d.ctrl[:] = self._last[1]
                self._changes.fire(number)
        if name in STEPS or name in RESETS:
            for part in self._held:
                self._held[part] = getattr(d, part).copy()
            if self._holds:
                self._last = d.qpos.copy(), d.ctrl.copy()


def _number_of(m: Any, name: str) -> Any:
    """Return an integer field of a model, such as an option; None if it is not found."""
    from mujoco.introspect import structs

    address: Any = getattr(m, "_address", None)
    if address is None:
        return None
    for field in structs.STRUCTS["mjModel"].fields:
        kind = getattr(field.type, "name", "")
        if kind not in ("mjtSize", "int"):
            return None
        number: Any = ctypes.c_int64 if kind == "mjtSize" else ctypes.c_int32
        size = ctypes.sizeof(number)
        address = -(-address // size) * size
        held = number.from_address(address)
        if getattr(m, field.name, held.value) != held.value:
            return None
        if field.name == name:
            return held
        address += size
    return None
