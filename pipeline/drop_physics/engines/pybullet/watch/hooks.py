"""The functions of pybullet, each replaced by one that calls it and tells the recorder.

The script sees no difference: calls return the engine's own answer, except where a window would
have to be open (`quiet`), and where time would have to pass (`clock`).
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Sequence
from functools import partial
from os import getpid
from threading import current_thread, get_ident
from types import BuiltinFunctionType, ModuleType, SimpleNamespace
from typing import Any
from weakref import ref

from .bodies import WatchedBody
from .calls import CallWatch, shown_file
from .clock import CALL_S, Clock
from .forks import Forks
from .functions import ROLES
from .handlers import handler
from .hidden import hide
from .intervene import Interventions, Operation
from .outside import Outside
from .pipe import APART, Pipe
from .quiet import Window
from .readings import Readings
from .solver import ASKED_EVERY
from .turns import Turn
from .varied import Variation, varied_by
from .worlds import ALL, WatchedWorld

IDLE_S = 60.0
"""A script that sleeps or asks for input this long [s] without a step waits for a user who is not
there."""
TOLD_EVERY = 8
"""After this many steps it is looked whether what was not sent yet has waited for long."""
MOST_CLIENTS = 64
TYPE = "builtin_function_or_method"


class Stop(SystemExit):
    """The script has reached its limit; few scripts catch this, and threads end silently."""


class Hook:
    """A function of pybullet, watched.

    What a script asks of it, it asks of the function itself; so it passes for a builtin one. Only
    to those do wrappers such as `BulletClient` bind the client's number (`inspect.isbuiltin`).

    Parameters
    ----------
    original
        What it stands before: the function, or the hook of a recording around this one.
    watch
        Whose hook it is.
    """

    __slots__ = ("__weakref__", "drop_plain", "drop_watch")

    drop_plain: Any
    """PyBullet's own function."""
    drop_watch: Watch

    def __init__(self, original: Any, watch: Watch) -> None:
        object.__setattr__(self, "drop_watch", watch)
        object.__setattr__(self, "drop_plain", getattr(original, "drop_plain", original))

    def __getattribute__(self, name: str) -> Any:
        if name in OF_HOOKS:
            return object.__getattribute__(self, name)
        try:
            return getattr(object.__getattribute__(self, "drop_plain"), name)
        except AttributeError as error:
            hide(error)
            raise

    def __setattr__(self, name: str, value: object) -> None:
        try:
            setattr(self.drop_plain, name, value)  # which raises Python's own error
        except Exception as error:
            hide(error)
            raise

    def __delattr__(self, name: str) -> None:
        try:
            delattr(self.drop_plain, name)
        except Exception as error:
            hide(error)
            raise

    def __reduce__(self) -> str:
        return str(self.__name__)

    def __repr__(self) -> str:
        return repr(self.drop_plain)

    def __dir__(self) -> list[str]:
        return dir(self.drop_plain)


OF_HOOKS = frozenset(
    ("drop_plain", "drop_watch", "__call__", "__eq__", "__ne__", "__hash__", "__reduce__",
     "__reduce_ex__", "__setattr__", "__delattr__", "__sizeof__"),
)  # fmt: skip
"""What a hook has of its own."""

LOOKS: dict[str, Any] = {
    "__slots__": (),
    "__module__": "builtins",
    "__doc__": property(lambda hook: hook.drop_plain.__doc__),  # `help` looks past the instance
}
"""How the type of a hook looks; each has its own, because calls go by the type."""


class Watch:
    """What is known of a running script.

    Parameters
    ----------
    steps
        After how many steps to stop it, or None.
    duration_s
        After how much time on its clock [s] to stop it, or None.
    variation
        What differs from the script's own run, or None.
    interventions
        What its calls do otherwise.
    trials
        Runs that part from this one, as `forks` takes them.
    """

    def __init__(
        self,
        pipe: Pipe,
        clock: Clock,
        *,
        steps: int | None,
        duration_s: float | None,
        variation: Variation | None = None,
        interventions: Sequence[Operation] = (),
        trials: Sequence[dict[str, Any]] = (),
    ) -> None:
        self.pipe, self.clock, self._variation = pipe, clock, variation
        WatchedWorld.varied = {} if variation is None else variation.engine
        self._interventions = Interventions(interventions, self.tell_intervention)
        self.is_parting = False
        """Whether a trial forks: its child is watched, too."""
        self.forks: Forks | None = Forks(self, trials) if trials else None
        self.becoming: list[Callable[[dict[str, Any]], None]] = []
        """What else is told when this process goes on as a trial."""
        self._calls: dict[str, Callable[..., Any]] = {}
        """What stands for each function of PyBullet, by name, of this run without its trials."""
        self.on = True
        self.lock = Turn()
        self.calls, self.readings = CallWatch(pipe), Readings(self)
        self.stopped: str | None = None
        self.worlds: dict[int, WatchedWorld] = {}
        self.windows: dict[int, Window] = {}
        self.real_time_since: dict[int, tuple[float, float]] = {}
        self.p = SimpleNamespace()
        """PyBullet's own functions."""
        self._limit_steps, self._limit_s = steps, duration_s
        self.steps_made = self._worlds_made = 0
        self._last_end = (0, 0.0)
        self._library: object = None
        """The file of the PyBullet that is watched."""
        self._modules: list[tuple[ModuleType, dict[str, Any]]] = []
        self._undo: list[Callable[[], None]] = []
        self.steppers: list[tuple[Any, str, Any]] = []
        """What stands for functions that make steps: where it stands, and the name."""
        self._is_plain = variation is None and not interventions and not trials
        self._left: Any = None
        """The counters that were shared, in a forked child."""
        self._process, self._thread = getpid(), get_ident()
        self._threads: set[threading.Thread] = set()
        """Other threads that have made steps."""
        clock.passed = self._time_has_passed
        clock.timing = self._tell_timing
        if hasattr(os, "register_at_fork"):
            # What is registered is kept as long as the process lives.
            os.register_at_fork(after_in_child=partial(_leave, ref(self)))

    # -- in place of pybullet's functions ---------------------------------------------------------

    def install(self, module: ModuleType) -> None:
        """Replace the functions of pybullet, in place; those of a reloaded module are already.

        A copy of its file is another PyBullet, whose numbers of simulations are the same: it is
        named.
        """
        library = _library(module)
        if self._library not in (None, library):  # it has simulations of its own
            self.pipe.note("copy", file=shown_file(str(module.__file__)))
            return
        self._library = library
        originals = {
            name: value
            for name, value in vars(module).items()
            if isinstance(value, BuiltinFunctionType)
            and getattr(value, "drop_watch", None) is not self
        }
        if not originals:
            return
        plain = {name: getattr(value, "drop_plain", value) for name, value in originals.items()}
        self.p = SimpleNamespace(**{**vars(module), **vars(self.p), **plain})
        self._modules.append((module, originals))
        self._stand_before(originals)
        for name, original in originals.items():
            call = self._calls[name]
            if self.forks is not None:
                call = self.forks.of(name, call)
            kind = type(TYPE, (Hook,), {**LOOKS, "__call__": staticmethod(call)})
            hook = kind(original, self)
            setattr(module, name, hook)
            if name == ROLES["steps"]:
                self.steppers.append((module, name, hook))
        self.pipe.note("pybullet", version=module.getAPIVersion(), file=module.__file__)
        for client in range(MOST_CLIENTS):  # connected before we came
            if client not in self.worlds and self.p.isConnected(client):
                self.begin(client, "before")

    def _stand_before(self, originals: dict[str, Any]) -> None:
        """Make what stands for functions of PyBullet."""
        calls = {}
        for name, original in originals.items():
            varied = self._variation and self._variation.of(self.p, name, original)
            calls[name] = handler(self, name, varied or original)
        self._calls |= {name: self._interventions.of(name, calls, self.p) for name in originals}

    def calls_of(self, name: str) -> Callable[..., Any]:
        """Return what stands for a function."""
        return self._calls[name]

    def become(self, trial: dict[str, Any], next_body: dict[int, int]) -> None:
        """Go on as a trial, in a process that has just been forked.

        Parameters
        ----------
        trial
            As `forks` takes it.
        next_body
            The id that the next body gets, by client.
        """
        self._process, self.is_parting = getpid(), False
        self.pipe.become(trial["pipe"], trial["block"])
        self._limit_steps = trial["steps"]
        self._variation = varied_by(trial["variation"])
        WatchedWorld.varied = {} if self._variation is None else self._variation.engine
        self._interventions = Interventions(trial["interventions"], self.tell_intervention)
        self._interventions.next_body.update(next_body)
        for module, originals in self._modules:
            self._stand_before(originals)
            for name in originals:
                type(getattr(module, name)).__call__ = staticmethod(self._calls[name])
        for become in self.becoming:
            become(trial)

    def remove(self) -> None:
        """Put the functions back; those that a script has kept just call the engine."""
        self.on = False
        for module, originals in self._modules:
            vars(module).update(originals)
        while self._undo:
            self._undo.pop()()
        self.clock.remove()
        self.lock.remove()

    def leave(self) -> None:
        """Watch no further, in a forked child; only that it makes a step is noted."""
        self.remove()
        self._left = self.pipe.counters
        self.pipe.leave()
        for owner, name, hook in self.steppers if self._is_plain else ():
            setattr(owner, name, hook)

    def step_apart(self) -> None:
        """Note that a step is not watched, where it is a forked child's."""
        if self._left is not None:
            self._left[APART] = 1

    hide = staticmethod(hide)
    """Takes wrappers' frames off an error's traceback; for those that are not in this folder."""

    def on_removal(self, undo: Callable[[], None]) -> None:
        """Register a function that undoes something when this watch ends."""
        self._undo.append(undo)

    def tell_draw(self, called: str, frame: Any) -> None:
        """Report an unseeded random number."""
        file, line = self.calls.place(frame)
        with self.lock:
            self.pipe.note("unseeded", called=called, file=file, line=line)

    def listen_outside(self) -> None:
        """Tell what the script reaches beside its simulation; for good, in this interpreter."""
        Outside(self._tell_outside).listen()

    def _tell_outside(self, what: str, name: str) -> None:
        if self.on:
            with self.lock:
                self.pipe.note("outside", how=what, name=name)

    def tell_intervention(self, number: int) -> None:
        """Report that an intervention has changed something for the first time."""
        with self.lock:
            self.pipe.note("intervened", number=number)

    def _tell_timing(self, frame: Any) -> None:
        """Report where the script reads a time between steps."""
        file, line = self.calls.place(frame)
        with self.lock:
            self.pipe.note("timing", file=file, line=line)

    # -- simulations ------------------------------------------------------------------------------

    def begin(self, client: int, method: str) -> None:
        """Follow a new simulation."""
        step, time_s = self._last_end
        world = WatchedWorld(
            self.pipe,
            self.p,
            client=client,
            number=self._worlds_made,
            method=method,
            first_step=step,
            first_time_s=time_s,
        )
        self.worlds[client] = world
        self._worlds_made += 1

    def end(self, client: int) -> None:
        """Send what is left of a simulation that is disconnected."""
        world = self.worlds.get(client)
        if world is None:
            return
        self.guarded(world, world.end)
        self._last_end = max(self._last_end, (world.step + 1, world.time_s))
        self.worlds.pop(client, None)
        self.calls.forget()
        self.readings.forget()
        self.windows.pop(client, None)
        self.real_time_since.pop(client, None)

    def guarded(self, world: WatchedWorld, read: Callable[..., None], *arguments: Any) -> None:
        """Read something; if it fails, the simulation is dropped, and the script goes on."""
        try:
            read(*arguments)
        except Exception as error:  # noqa: BLE001 - our errors must not reach the script
            self._lose(world, error)

    def _lose(self, world: WatchedWorld, error: Exception) -> None:
        if world.client in self.worlds:
            self.pipe.note(
                "fault",
                world=world.number,
                step=world.step,
                error=f"{type(error).__name__}: {error}",
            )
        self.worlds.pop(world.client, None)
        self.calls.forget()
        self.readings.forget()
        self.real_time_since.pop(world.client, None)

    # -- steps and time ---------------------------------------------------------------------------

    def step(self, world: WatchedWorld, original: Any, args: Any, kwargs: Any) -> Any:
        """Make a step of the script, and count it."""
        varied = self._variation
        if varied is None:
            result = self._step(world, original, args, kwargs)
        else:
            result = self._varied_step(varied, world, original, args, kwargs)
        self.count(world.time_s)
        return result

    def count(self, time_s: float) -> None:
        """Count a step that leads to a time [s]; end the script where that is its limit."""
        self.steps_made += 1
        if self.steps_made == self.readings.next_turn:
            self.readings.turn(self.steps_made)
        if get_ident() != self._thread:
            self._threads.add(current_thread())
        self.clock.step(time_s)
        if self.steps_made == self._limit_steps:
            self.stop("steps")
        if self._limit_s is not None:
            self._check_time()
        if not self.steps_made % TOLD_EVERY:
            self.pipe.tick()

    def _varied_step(
        self, varied: Variation, world: WatchedWorld, original: Any, args: Any, kwargs: Any
    ) -> Any:
        """Make several steps of the engine where the script makes one."""
        client = world.client
        if varied.nudge(client, lambda: self._bodies(world)):
            world.moved[ALL], world.touched = set(), True
        result = self._step(world, original, args, kwargs)
        for _ in range(varied.finer - 1):
            varied.again(client, lambda *call: self.guarded(world, self.calls.tell, world, *call))
            result = self._step(world, original, args, kwargs)
        varied.stepped(client)
        return result

    def _bodies(self, world: WatchedWorld) -> list[WatchedBody]:
        self.guarded(world, world.sync)
        return list(world.bodies.values())

    def _step(self, world: WatchedWorld, original: Any, args: Any, kwargs: Any) -> Any:
        """Make a step of the engine, and send what it changes."""
        asks = False
        try:
            if world.touched:
                world.before_step()
            if not world.step % ASKED_EVERY:
                asks = world.asks_solver()
        except Exception as error:  # noqa: BLE001 - our errors must not reach the script
            self._lose(world, error)
            return original(*args, **kwargs)
        try:
            result = original(*args, **kwargs)
        finally:
            if asks:
                world.solver.report(on=False)
        try:
            world.after_step(result)
        except Exception as error:  # noqa: BLE001 - likewise
            self._lose(world, error)
        return () if asks else result

    def set_real_time(self, world: WatchedWorld, *, on: bool) -> None:
        """Let a simulation run by itself, as it does with a window; without one it never does."""
        self.real_time_since.pop(world.client, None)
        if on and world.client in self.windows:
            self.real_time_since[world.client] = (self.clock.now_s(), world.time_s)
            self.readings.look()
            self.pipe.note("real_time", world=world.number, step=world.step)

    def let_time_pass(self) -> None:
        """Let pass the time that a call takes, where a simulation runs by itself."""
        if self.real_time_since:
            self.clock.wait(CALL_S)

    def _time_has_passed(self) -> None:
        if not self.on:
            return
        with self.lock:
            self.check()
            for client, (since_s, from_s) in list(self.real_time_since.items()):
                world = self.worlds[client]
                if world.stale_engine:
                    self.guarded(world, world.before_step)
                finer = 1 if self._variation is None else self._variation.finer
                while (
                    client in self.worlds
                    and world.time_s + finer * world.timestep_s - from_s
                    <= self.clock.now_s() - since_s
                ):
                    self.step(world, self.p.stepSimulation, (client,), {})
            self._check_time()

    def _check_time(self) -> None:
        now_s = max(self.clock.simulated_s, self.clock.waited_s)
        if self._limit_s is not None and now_s >= self._limit_s * (1 - 1e-12):
            self.stop("duration")
        elif self.clock.idle_s >= IDLE_S:
            self.stop("idle")

    def stop(self, why: str) -> None:
        """End the script: here, and at any further call of pybullet."""
        self.stopped = why
        self.readings.look()
        self.pipe.note("stop", why=why)
        self.pipe.flush()
        raise Stop(0)

    def check(self) -> None:
        """Raise again if the script has caught the end; without a recorder it ends too."""
        if self.stopped or self.pipe.gone:
            raise Stop(0)

    # -- the end ----------------------------------------------------------------------------------

    def settle(self) -> None:
        """Send what is left of all simulations, as far as the script has come."""
        with self.lock:
            for world in list(self.worlds.values()):
                self.guarded(world, world.end)
            self.pipe.flush()

    def finish(self) -> None:
        """Send what is left, and watch no further: what follows is not recorded."""
        with self.lock:
            self.settle()
            here = current_thread()
            if any(thread.is_alive() for thread in self._threads if thread is not here):
                self.pipe.note("running")
            self.worlds.clear()
            self.on = False


def _library(module: ModuleType) -> object:
    """Return which file a module was loaded from, whatever its path."""
    try:
        status = os.stat(str(module.__file__))
    except OSError:  # it was removed, or is no file
        return module.__file__
    return status.st_dev, status.st_ino


def _leave(kept: ref[Watch]) -> None:
    """Watch no further, in a forked child: its parent is watched."""
    watch = kept()
    if watch is None or watch.is_parting:
        return
    if watch.on and getpid() != watch._process:
        watch.leave()
