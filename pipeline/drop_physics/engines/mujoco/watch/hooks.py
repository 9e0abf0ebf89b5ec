"""Replaces functions of mujoco that step or set a state by wrappers that report the calls.

The script gets the same numbers as without wrappers, to the last bit. Other functions that step a
model are only reported (`uncaught`), and `viewer` replaces windows.
"""

from __future__ import annotations

import operator
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from sys import _getframe
from threading import active_count, get_ident
from types import ModuleType
from typing import Any

from ...watching.hidden import hide, hiding
from ...watching.host import EngineWatch, ScriptWatch
from ...watching.pipe import MUJOCO, frame
from ...watching.single_changes import Change
from ...watching.sites import caller
from ..frames import CALLBACKS, CAUSES, READS, STEPS, note_bytes
from ..memory import layout_of_options
from . import array_uses, compiled, pictures, uncaught, unfilled
from .array_uses import ArrayUses
from .followed import WatchedData, WatchedModel
from .intervene import ModelChanges
from .observed import ObservedData
from .single_changes import possible
from .viewer import install_viewer

RESETS = (
    "mj_resetData",
    "mj_resetDataKeyframe",
    "mj_resetDataDebug",
    "mj_setState",
    "mj_copyState",
    "mj_copyData",
    "mj_setConst",
)
"""Functions that set the whole state."""
WHICH = {"mj_copyData": (1, 0), "mj_copyState": (0, 2)}
"""Indices of the model and of the changed state among a function's arguments; (0, 1) for functions
not listed."""
POSES = (
    *("mj_forward", "mj_step1", "mj_inverse", "mj_fwdPosition", "mj_kinematics"),
    *("mj_fwdKinematics", "mj_forwardSkip"),
)
"""Functions that recompute derived data from the current state."""
COMPLETE = ("mj_forward", "mj_step1")
"""Functions among these that compute everything that `mj_step2` and the integrators use."""
MANY = 64
"""Number of new simulations after which those released by the script are forgotten."""
MOST_WARNINGS = 100
"""Largest number of different warning texts that are sent."""
WARNS_TO_STDERR = (3, 9)
"""The first MuJoCo version that prints warnings to standard error."""


class MujocoWatch(EngineWatch):
    """Watches how a script uses mujoco: its models, states, steps and writes.

    Parameters
    ----------
    host
        The watch of the script, of which this engine's is a part.
    operations, variation
        The differences of a trial run from the script's own run (see `ModelChanges`).
    """

    name = "MuJoCo"

    def __init__(
        self,
        host: ScriptWatch,
        operations: Sequence[Mapping[str, Any]] = (),
        variation: Mapping[str, Any] | None = None,
    ) -> None:
        super().__init__(host)
        self.mujoco: Any = None
        self.originals: dict[str, Any] = {}
        """MuJoCo's own functions."""
        self.data: dict[int, WatchedData] = {}
        """Simulations by the `id` of the MjData, which Python may reuse: compare `ref`."""
        self.models: dict[int, WatchedModel] = {}
        self.digests: set[str] = set()
        """Digests of the models whose binary form was sent."""
        self.latest: tuple[Any, Any] | None = None
        """The MjModel and the MjData stepped last, while an evaluator is active."""
        self._observed: ObservedData | None = None
        self._of_states: dict[int, ObservedData] = {}
        """Observed simulations, by the `id` of the MjData."""
        self.callbacks: dict[str, Any] = {}
        """The script's own callbacks, by name."""
        self.uses: dict[int, ArrayUses] = {}
        """The uses of each MjData's arrays, by its `id`."""
        self.compiled: dict[int, compiled.CompiledModel] = {}
        """The fields of models as they were compiled, by the `id` of the MjModel, until a step."""
        self.owners: dict[int, ArrayUses] = {}
        """The same for the views of elements, by their `id`."""
        self.only_read: dict[tuple[int, int], int] = {}
        """Number of times that an instruction got an array and left it unchanged, by the `id` of
        its code object."""
        self._changes = ModelChanges(self, operations, variation or {}, host.tell_intervention)
        self._stands_before = self._changes.any or host.forks is not None
        self.depth = 3 if self._stands_before else 1
        """Number of stack frames between a hook and the script."""
        self.uncounted: set[int] = set()
        """Threads that are making further steps besides those that the script requests."""
        self.stepping: dict[int, WatchedData | None] = {}
        """The simulation in which a thread is making a step, if callbacks are installed."""
        self.sites: dict[tuple[int, int], int] = {}
        """Call sites outside libraries, by code object and instruction."""
        self._sites: dict[tuple[int, int, int, int], int] = {}
        self._codes: list[Any] = []
        """References to the code objects of sites, so that Python does not reuse their addresses.
        """
        self.sensed = 0
        """Number of values in shared memory that sensors use."""
        self._models = self._worlds = 0
        """Number of models and of simulations that were sent."""
        self._faults: set[tuple[int | None, str]] = set()
        self._warning: Any = None
        """The script's own handler of warnings."""
        self._warned: set[str] = set()

    def become(self, trial: dict[str, Any]) -> None:
        """Continue this process, a new fork, as a trial run with other changes."""
        self._changes.become(trial["interventions"], trial["variation"] or {})

    def can_become(self, trial: dict[str, Any]) -> bool:
        """Return whether a trial run differs from this run only after models are loaded."""
        return not any(each.get("at_load") for each in trial["interventions"])

    def possible(self, rows: Sequence[dict[str, Any]]) -> list[Change]:
        """Return the single changes that the rows of a table allow in this run."""
        seen = self._changes.seen.values()
        return [change for each in seen for change in possible(self.mujoco, rows, each)]

    def observed(self) -> ObservedData | None:
        """Return the state last stepped, for checking an expectation."""
        if self.latest is None:
            return None
        m, d = self.latest
        if self._observed is None or self._observed.ref() is not d:
            self._observed = self._of_states.get(id(d))
            if self._observed is None or self._observed.ref() is not d:
                self._observed = self._of_states[id(d)] = ObservedData(self.mujoco, m, d)
        return self._observed

    def install(self, module: ModuleType) -> None:
        """Replace functions of mujoco by wrappers."""
        again = self.mujoco is not None
        self.mujoco = module
        makers = [(name, _stepping) for name in STEPS]
        makers += [(name, _resetting) for name in RESETS]
        makers += [(name, _posing) for name in (*POSES, *READS)]
        # Another import of the package, under whatever name, takes them from its inner modules.
        inner = [one for key, one in list(sys.modules.items()) if key.startswith("mujoco._")]
        self._owners = [module, *inner]
        for name, maker in makers:
            original = getattr(module, name, None)
            if original is None or getattr(original, "drop_watch", None) is self:
                continue
            self.originals[name] = getattr(original, "drop_plain", original)
            hook = maker(self, name, self.originals[name])
            if self._stands_before:
                hook = self._changes.around(name, hook)
            self._replace(name, hook)
        self._changes.install(module)
        for name in CALLBACKS:
            self._hook_callback(module, f"mjcb_{name}")
        self._hook_warnings(module)
        if hasattr(module, "Renderer"):
            pictures.install(self, module.Renderer)
        if again:
            return
        if self.host.forks is not None:
            with suppress(ImportError, LookupError):
                layout_of_options()  # here once, and not in each trial that forks
        unfilled.install(module, self.host.on_removal)
        array_uses.install(self, module)
        compiled.install(self, module)
        self.tell("mujoco", version=module.__version__, python=sys.version.split()[0])
        self.host.on_import("mujoco.viewer", self._on_viewer)
        for name in uncaught.IMPORTED:
            self.host.on_import(name, partial(self._on_uncaught, name))
        for name, functions in uncaught.CALLED.items():
            self.host.on_import(name, partial(uncaught.install, self, functions))

    def _on_uncaught(self, name: str, _: ModuleType) -> None:
        self.tell_uncaught(name, None)

    def _on_viewer(self, module: ModuleType) -> None:
        install_viewer(self, module)

    def _replace(self, name: str, hook: Any) -> None:
        original = getattr(self.mujoco, name)
        plain = getattr(original, "drop_plain", original)
        hook.__name__ = hook.__qualname__ = name
        hook.__doc__, hook.__module__ = plain.__doc__, "mujoco"  # so that it can be pickled
        hook.drop_plain, hook.drop_watch = plain, self
        for owner in self._owners:
            if vars(owner).get(name) is original:
                setattr(owner, name, hook)
                self.host.on_removal(partial(setattr, owner, name, original))
                if name in STEPS:
                    self.host.steppers.append((owner, name, hook))

    def replace_static(self, owner: Any, name: str, made: Callable[[Any], Any]) -> None:
        """Replace a static method of a mujoco class by the wrapper that `made` returns."""
        original = getattr(owner, name)
        setattr(owner, name, staticmethod(made(original)))
        self.host.on_removal(partial(setattr, owner, name, staticmethod(original)))

    # -- what is sent -----------------------------------------------------------------------------

    def send(self, payload: bytes) -> None:
        """Send packed data; the caller holds the lock."""
        self.pipe.write(frame(MUJOCO, payload))

    def tell(self, what: str, **values: Any) -> None:
        """Send a JSON message."""
        with self.host.lock:
            self.send(note_bytes(what, **values))

    def tell_episode(self, **what: Any) -> None:
        """Report that an environment's episode begins or ends, in simulation `world`."""
        self.tell("episode", **what)

    def tell_uncaught(self, name: str, place: Any) -> None:
        """Report a function that steps models in a way that cannot be recorded."""
        file, line = (
            ("", 0) if place is None else self.host.sites.place(self.host.sites.outside(place))
        )
        self.tell("uncaught", name=name, file=file, line=line)

    def site_of(self, place: Any) -> int:
        """Return the index of the script's line that made a call, given the caller's frame.

        A call within an installed library belongs to the line that called the library.
        """
        code, sites = place.f_code, self.host.sites
        outer = sites.outside(place)
        key = (id(code), place.f_lasti, id(outer.f_code), outer.f_lasti)
        site = self._sites.get(key)
        if site is None:
            site = self._sites[key] = len(self._sites)
            self._codes += [code, outer.f_code]
            file, line = sites.place(outer)
            via, at = ("", 0) if outer is place else sites.place(place)
            self.send(note_bytes("site", number=site, file=file, line=line, via=via, via_line=at))
            if outer is place:
                self.sites[key[:2]] = site
        return site

    def uses_of(self, d: Any) -> ArrayUses:
        """Return the uses of an MjData's arrays."""
        uses = self.uses.get(id(d))
        if uses is None or uses.ref() is not d:
            uses = self.uses[id(d)] = ArrayUses(self, d)
        return uses

    def tell_compiled(self, m: Any, state: WatchedData, site: int) -> None:
        """Report at the first step with a model what was changed in it since it was compiled."""
        found = self.compiled.pop(id(m), None)
        if found is not None and found.ref() is m:
            found.tell_edits(self, state.number, site)

    # -- states -----------------------------------------------------------------------------------

    def seen(self, m: Any, d: Any, place: Any) -> tuple[WatchedData | None, int]:
        """Return the `WatchedData` of an MjData, and the call site; None if it cannot be followed.

        The caller must hold `host.lock`.
        """
        try:
            site = self.site_of(place)
            state = self.state_of(m, d, site)
            return (None if state is None or state.lost else state), site
        except Exception as error:  # noqa: BLE001 - our errors must not reach the script
            self.lose(None, error)
            return None, 0

    def state_of(self, m: Any, d: Any, site: int) -> WatchedData | None:
        """Return the `WatchedData` of an MjData, created if new; None if `d` is no MjData."""
        module = self.mujoco
        if not isinstance(m, module.MjModel) or not isinstance(d, module.MjData):
            return None
        model = self.models.get(id(m))
        if model is None or model.ref() is not m:
            self._forget()
            model = self.models[id(m)] = WatchedModel(self, m, self._models)
            self._models += 1
        state = self.data.get(id(d))
        if state is None or state.ref() is not d:
            if len(self.data) % MANY == MANY - 1:
                self._forget()
            state = self.data[id(d)] = WatchedData(self, model, d, self._worlds, site)
            self._worlds += 1
        elif state.model is not model:
            state.model = model
            self.send(note_bytes("model_of", world=state.number, model=model.number))
        return state

    def _forget(self) -> None:
        """Drop models and states that the script has released."""
        for table in (self.data, self.models, self.uses, self.owners):
            gone = [key for key, held in table.items() if held.ref() is None]
            for key in gone:
                del table[key]

    def lose(self, state: WatchedData | None, error: Exception) -> None:
        """Stop following a simulation after an error, and report that."""
        number, text = None if state is None else state.number, f"{type(error).__name__}: {error}"
        if state is not None:
            state.lost = True
        if (number, text) not in self._faults:
            self._faults.add((number, text))
            self.send(note_bytes("fault", world=number, error=text))

    # -- callbacks --------------------------------------------------------------------------------

    def begin_calling(self, state: WatchedData) -> WatchedData | None:
        """Start noting callbacks during a step; return the simulation of an outer step."""
        outer = self.stepping.get(get_ident())
        state.begin_calling()
        self.stepping[get_ident()] = state
        return outer

    def _hook_callback(self, module: Any, name: str) -> None:
        setter, getter = getattr(module, f"set_{name}", None), getattr(module, f"get_{name}", None)
        if setter is None or getter is None or getattr(setter, "drop_watch", None) is self:
            return
        plain = getattr(setter, "drop_plain", setter)
        which = CALLBACKS.index(name[5:])

        def set_callback(callback: Any) -> None:
            if not self.host.on or not callable(callback):
                plain(callback)
                if self.callbacks.pop(name, None) is not None:
                    self.tell("callback", name=name, on=False)
                if callback is not None and self.host.on:
                    self.tell_uncaught(f"set_{name}", caller())
                return
            plain(_calling(self, which, callback))
            self.callbacks[name] = callback
            self.tell("callback", name=name, on=True)

        def get_callback() -> Any:
            return self.callbacks.get(name) or getter()

        self._replace(f"set_{name}", hiding(set_callback))
        self._replace(f"get_{name}", get_callback)
        self.host.on_removal(lambda: plain(self.callbacks.get(name) or getter()))

    # -- warnings ---------------------------------------------------------------------------------

    def _hook_warnings(self, module: Any) -> None:
        """Print MuJoCo's warnings instead of appending them to its log file."""
        setter, getter = module.set_mju_user_warning, module.get_mju_user_warning
        if getattr(setter, "drop_watch", None) is self:
            return
        plain = getattr(setter, "drop_plain", setter)
        self._warning = getter()
        stream = 2 if _version(module.__version__) >= WARNS_TO_STDERR else 1

        def warn(text: Any) -> None:
            text = text.decode(errors="replace") if isinstance(text, bytes) else str(text)
            if self._warning is not None:
                self._warning(text)
            else:
                (sys.stdout if stream == 1 else sys.stderr).flush()
                os.write(stream, f"WARNING: {text}\n\n".encode(errors="replace"))
            known, warned = text.partition(" Time = ")[0], self._warned
            if self.host.on and known not in warned and len(warned) < MOST_WARNINGS:
                warned.add(known)
                state = self.stepping.get(get_ident())
                self.tell("warning", text=text, world=None if state is None else state.number)

        def set_warning(handler: Any) -> None:
            self._warning = handler

        def get_warning() -> Any:
            return self._warning

        plain(hiding(warn))
        self._replace("set_mju_user_warning", set_warning)
        self._replace("get_mju_user_warning", get_warning)
        self.host.on_removal(lambda: plain(self._warning))


def _stepping(watch: MujocoWatch, name: str, original: Any) -> Any:
    """Wrap a step function so that n steps are made and sent one by one."""
    host, states, callbacks, sites = watch.host, watch.data, watch.callbacks, watch.sites
    lock, pipe, now = host.lock, host.pipe, watch.stepping
    acquire, release, kept, frame = lock.acquire, lock.release, lock.kept, _getframe
    uncounted = watch.uncounted
    number, takes_steps = STEPS.index(name), name == "mj_step"

    def step(*args: Any, **kwargs: Any) -> Any:
        try:
            if not host.on:
                host.step_apart()
                return original(*args, **kwargs)
            if len(args) == 2 and not kwargs:
                (m, d), count, rest = args, 1, ()
            else:
                given = _arguments(args, kwargs, takes_steps)
                if given is None:
                    return original(*args, **kwargs)  # which raises MuJoCo's own error
                m, d, count, rest = given
            place, function = frame(watch.depth), number
            site = sites.get((id(place.f_code), place.f_lasti))
            state = states.get(id(d))
            if site is None or state is None or state.ref() is not d or state.model.ref() is not m:
                with lock:
                    state, site = watch.seen(m, d, place)
            if state is None:
                return original(*args, **kwargs)
            outer, alone = None, not callbacks and active_count() == 1
            for made in range(count):
                if state.lost:
                    original(m, d, *rest)
                    continue
                acquire()
                try:
                    if host.stopped or pipe.gone:
                        host.check()
                    # Between the steps of one call, nobody else can have written.
                    if not pipe.muted and not (made and alone):
                        state.before(d, site)
                        if state.uses.got:
                            state.uses.before(computes=not number)
                        if watch.compiled:
                            watch.tell_compiled(m, state, site)
                    if number:
                        function = number | state.staleness(everything=number > 1)
                    if callbacks:
                        outer = watch.begin_calling(state)
                except Exception as error:  # noqa: BLE001 - our errors must not reach the script
                    watch.lose(state, error)
                finally:
                    release()
                    if kept:
                        lock.give_back()
                try:
                    original(m, d, *rest)
                finally:
                    if now:
                        now[get_ident()] = outer
                acquire()
                try:
                    if pipe.muted:
                        state.elapse(d)
                    else:
                        state.after(d, site, function)
                    watch.stepped = state.number
                    if host.evaluator is not None:
                        watch.latest = m, d
                    if not uncounted or get_ident() not in uncounted:
                        host.count(state.elapsed_s, watch)
                except Exception as error:  # noqa: BLE001 - likewise
                    watch.lose(state, error)
                finally:
                    release()
                    if kept:
                        lock.give_back()
            return None
        except BaseException as error:
            hide(error)
            raise

    return step


def _arguments(args: Any, kwargs: Any, takes_steps: bool) -> Any:
    """Return model, data, number of steps and further arguments of a step function's call.

    None if the function does not accept these arguments.
    """
    names = ("m", "d", "nstep" if takes_steps else "N")
    given = {**dict(zip(names, args)), **kwargs}
    if len(given) != len(args) + len(kwargs) or not {"m", "d"} <= {*given} <= {*names}:
        return None
    last = given.get(names[2], 1)
    if not hasattr(type(last), "__index__"):
        return None
    if takes_steps:
        return given["m"], given["d"], operator.index(last), ()
    return given["m"], given["d"], 1, (last,) if names[2] in given else ()


def _resetting(watch: MujocoWatch, name: str, original: Any) -> Any:
    """Wrap a function that sets the state, such as `mj_resetData`, so that its effect is sent."""
    host, cause = watch.host, CAUSES.index(name)
    of_model, of_data = WHICH.get(name, (0, 1))

    def reset(*args: Any, **kwargs: Any) -> Any:
        given, state, d = [*args, *kwargs.values()], None, None
        with host.lock:
            host.check()
            if len(given) > max(of_model, of_data):
                d = given[of_data]
                state, site = watch.seen(given[of_model], d, caller())
            if state is not None:  # what the script wrote may stay, or be lost
                watch.guarded(state, state.before, d, site)
        result = original(*args, **kwargs)
        if state is not None and not state.lost:
            argument = given[2] if name == "mj_resetDataKeyframe" else 0
            with host.lock:
                watch.guarded(state, state.set_by, d, site, cause, argument)
        return result

    return host.standing(original, reset)


def _posing(watch: MujocoWatch, name: str, original: Any) -> Any:
    """Wrap a function that reads the current state, so that the script's writes are sent first."""
    host, cause, reads = watch.host, CAUSES.index(name), name in READS
    complete, callbacks, now = name in COMPLETE, watch.callbacks, watch.stepping

    def pose(*args: Any, **kwargs: Any) -> Any:
        given = [*args, *kwargs.values()]
        if len(given) < 2:
            return original(*args, **kwargs)
        m, d = given[:2]
        outer = now.get(get_ident())
        with host.lock:
            host.check()
            state, site = watch.seen(m, d, caller())
            if state is not None and reads:
                watch.guarded(state, state.read, d, site, cause)
            elif state is not None:
                watch.guarded(state, state.pose, d, site, cause, complete)
                if state.uses.got:
                    watch.guarded(state, partial(state.uses.before, computes=complete))
                if callbacks and name == "mj_step1":
                    watch.begin_calling(state)
        try:
            return original(*args, **kwargs)
        finally:
            if now:
                now[get_ident()] = outer
            if state is not None and not reads:
                with host.lock:
                    watch.guarded(state, partial(state.uses.after, step=False))

    return host.standing(original, pose)


def _calling(watch: MujocoWatch, which: int, callback: Any) -> Any:
    """Wrap a script's callback so that its return value or writes during a step are noted."""
    now = watch.stepping

    def call(*args: Any) -> Any:
        answer = callback(*args)
        state = now.get(get_ident())
        # A callback may step other data, which call it, too.
        if state is not None and not state.lost and state.ref() is args[1]:
            with watch.host.lock:
                watch.guarded(state, state.called, which, answer)
        return answer

    return hiding(call)


def _version(text: str) -> tuple[int, ...]:
    """Return the numbers in a version string."""
    return tuple(int(part) for part in text.split(".")[:2])
