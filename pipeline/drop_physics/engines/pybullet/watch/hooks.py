"""Replaces functions of pybullet by wrappers that report each call to the recorder.

Calls return the engine's own results, so the script behaves as without wrappers. The exceptions are
functions that need a window (`quiet`), and those that wait for time to pass (`clock`).
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Sequence
from functools import partial
from operator import attrgetter
from types import BuiltinFunctionType, ModuleType, SimpleNamespace
from typing import Any

from ...watching.clock import CALL_S
from ...watching.hidden import hide, hiding
from ...watching.host import EngineWatch, ScriptWatch
from ...watching.single_changes import Change
from ...watching.sites import shown_file
from .arguments import client_of, named
from .bodies import WatchedBody
from .calls import CallWatch
from .functions import COMMANDS, MAKES_BODIES, ROLES
from .handlers import handler
from .intervene import CallInterventions, Operation
from .observed import ObservedWorld
from .quiet import Window
from .readings import Readings
from .single_changes import possible
from .solver import ASKED_EVERY
from .varied import Variation, varied_by
from .worlds import ALL, WatchedWorld

MOST_CLIENTS = 64
TYPE = "builtin_function_or_method"


RELEASE = re.compile(r"pybullet-([\w.+!]+)\.(?:dist|egg)-info")
"""Pattern of an installed package's version: PyBullet itself knows only its API version."""


def release_of(file: str | None) -> str:
    """Return the version of the package that owns a module's file; empty if unknown."""
    try:
        names = os.listdir(os.path.dirname(file or ""))
    except OSError:
        return ""
    return next((found[1] for found in map(RELEASE.fullmatch, names) if found), "")


class Hook:
    """A wrapper that replaces a function of pybullet, and looks like that function.

    Attribute access is passed on to the function, so that the wrapper counts as a builtin
    (`inspect.isbuiltin`). Only to builtins does `BulletClient` add the client's number.

    Parameters
    ----------
    original
        The replaced function, or its hook if another recording is running around this one.
    watch
        The watch to which the hook belongs.
    """

    __slots__ = ("__weakref__", "drop_plain", "drop_watch")

    drop_plain: Any
    """PyBullet's own function."""
    drop_watch: BulletWatch

    def __init__(self, original: Any, watch: BulletWatch) -> None:
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

    @hiding
    def __setattr__(self, name: str, value: object) -> None:
        setattr(self.drop_plain, name, value)  # which raises Python's own error

    @hiding
    def __delattr__(self, name: str) -> None:
        delattr(self.drop_plain, name)

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
"""Attributes that are the hook's own; all others are the function's."""

LOOKS: dict[str, Any] = {
    "__slots__": (),
    "__module__": "builtins",
    "__doc__": property(lambda hook: hook.drop_plain.__doc__),  # `help` looks past the instance
}
"""Class attributes of a hook's type; each hook has its own type, because special methods are looked
up on the type."""


class BulletWatch(EngineWatch):
    """Watches how a script uses pybullet: its simulations, calls and steps.

    Parameters
    ----------
    host
        The watch of the script, of which this engine's is a part.
    variation
        The variation of the run; None in the script's own run.
    interventions
        The operations that change calls in a trial run.
    """

    name = "PyBullet"

    def __init__(
        self,
        host: ScriptWatch,
        *,
        variation: Variation | None = None,
        interventions: Sequence[Operation] = (),
    ) -> None:
        super().__init__(host)
        WatchedWorld.keeps_files = host.keeps_files
        self._differ(variation, interventions)
        self._calls: dict[str, Callable[..., Any]] = {}
        """The wrapper of each PyBullet function, by name, without the changes of trials forked
        later."""
        self.calls, self.readings = CallWatch(host), Readings(self)
        self.worlds: dict[int, WatchedWorld] = {}
        self.windows: dict[int, Window] = {}
        self.real_time_since: dict[int, tuple[float, float]] = {}
        self.p = SimpleNamespace()
        """PyBullet's own functions."""
        self._stepped: WatchedWorld | None = None
        """The simulation that was stepped last."""
        self._observed: dict[int, ObservedWorld] = {}
        """Observed simulations, by number."""
        self._worlds_made = 0
        self._last_end = (0, 0.0)
        self._ended: set[int] = set()
        """Ids of disconnected clients, which PyBullet may reuse."""
        self._library: object = None
        """Identity of the file of the watched PyBullet."""
        self._modules: list[tuple[ModuleType, dict[str, Any]]] = []

    def _differ(self, variation: Variation | None, interventions: Sequence[Operation]) -> None:
        self._variation = variation
        WatchedWorld.varied = {} if variation is None else variation.engine
        self._interventions = CallInterventions(interventions, self.host.tell_intervention)

    # -- in place of pybullet's functions ---------------------------------------------------------

    def install(self, module: ModuleType) -> None:
        """Replace pybullet's functions by wrappers, unless they are replaced already.

        A module loaded from a copy of pybullet's file has simulations of its own with the same
        numbers: it is not watched, but reported.
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
        self.host.on_removal(lambda: vars(module).update(originals))
        self._stand_before(originals)
        for name, original in originals.items():
            call = self._calls[name]
            if self.host.forks is not None and name in (ROLES["connects"], ROLES["steps"]):
                call = self._stopping(name, call)
            kind = type(TYPE, (Hook,), {**LOOKS, "__call__": staticmethod(call)})
            hook = kind(original, self)
            setattr(module, name, hook)
            if name == ROLES["steps"]:
                self.host.steppers.append((module, name, hook))
        version, release = module.getAPIVersion(), release_of(module.__file__)
        self.pipe.note("pybullet", version=version, release=release)
        for client in range(MOST_CLIENTS):  # connected before we came
            if client not in self.worlds and self.p.isConnected(client):
                self.begin(client, "before")

    def _stand_before(self, originals: dict[str, Any]) -> None:
        """Create the wrappers of PyBullet's functions."""
        calls = {}
        for name, original in originals.items():
            varied = self._variation and self._variation.of(self.p, name, original)
            calls[name] = handler(self, name, varied or original)
        for name in originals:
            made, plain = self._interventions.of(name, calls, self.p), calls[name]
            made = made if made is plain else self.host.standing(plain, made)
            if self.host.evaluator is not None:
                if name in MAKES_BODIES:
                    made = self._making(name, made)
                elif name in COMMANDS and self.pipe.muted:
                    made = self._commanding(name, made)
            self._calls[name] = made

    def _making(self, name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        """Wrap a function that makes bodies, to note the file from which they are loaded."""

        def make(*args: Any, **kwargs: Any) -> Any:
            result = call(*args, **kwargs)
            world = self.worlds.get(client_of(name, args, kwargs))
            if world is not None and self.host.on:
                file = next(iter(named(name, args, kwargs).values()), None)
                loaded = name.startswith("load") and isinstance(file, str)
                self.guarded(
                    world, self._observed_of(world).made, result, str(file) if loaded else ""
                )
            return result

        return hiding(make)

    def _commanding(self, name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        """Wrap a motor command, to note the target that the script gives."""

        def command(*args: Any, **kwargs: Any) -> Any:
            world = self.worlds.get(client_of(name, args, kwargs))
            if world is not None and self.host.on:
                self.guarded(world, self._observed_of(world).command, named(name, args, kwargs))
            return call(*args, **kwargs)

        return hiding(command)

    def _stopping(self, name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        """Wrap a function before which trial runs are forked off."""

        def stop(*args: Any, **kwargs: Any) -> Any:
            forks = self.host.forks
            if forks is not None and forks.stop(steps=name == ROLES["steps"]):
                return self._calls[name](*args, **kwargs)
            return call(*args, **kwargs)

        return hiding(stop)

    def possible(self, rows: Sequence[dict[str, Any]]) -> list[Change]:
        """Return the single changes that the rows of a table allow in this run."""
        return possible(self.p, rows, self._interventions.seen)

    def become(self, trial: dict[str, Any]) -> None:
        """Continue this process, a new fork, as a trial run with other changes."""
        self._differ(varied_by(trial["variation"]), trial["interventions"])
        for module, originals in self._modules:
            self._stand_before(originals)
            for name in originals:
                type(getattr(module, name)).__call__ = staticmethod(self._calls[name])

    # -- simulations ------------------------------------------------------------------------------

    def observed(self) -> ObservedWorld | None:
        """Return the simulation last stepped, for checking an expectation."""
        return None if self._stepped is None else self._observed_of(self._stepped)

    def _observed_of(self, world: WatchedWorld) -> ObservedWorld:
        if world.number not in self._observed:
            time_s = attrgetter("time_s")
            self._observed[world.number] = ObservedWorld(
                self.p, world.client, partial(time_s, world)
            )
        return self._observed[world.number]

    def begin(self, client: int, method: str) -> None:
        """Start following a new simulation."""
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
        if client in self._ended:  # what it was set to went with the earlier simulation
            self.guarded(world, world.sync_engine)

    def end(self, client: int) -> None:
        """Send the remaining data of a simulation that is disconnected."""
        world = self.worlds.get(client)
        if world is None:
            return
        self.guarded(world, world.end)
        self._last_end = max(self._last_end, (world.step + 1, world.time_s))
        self.worlds.pop(client, None)
        self._ended.add(client)
        self.calls.forget()
        self.readings.forget()
        self.windows.pop(client, None)
        self.real_time_since.pop(client, None)

    def lose(self, world: WatchedWorld, error: Exception) -> None:
        """Stop following a simulation after an error, and report that."""
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
        varied, self._stepped = self._variation, world
        if varied is None:
            result = self._step(world, original, args, kwargs)
        else:
            result = self._varied_step(varied, world, original, args, kwargs)
        made = self.host.steps_made + 1
        if made >= self.readings.next_turn:
            self.readings.turn(made)
        self.stepped = world.number
        self.host.count(world.time_s, self)
        return result

    def _varied_step(
        self, varied: Variation, world: WatchedWorld, original: Any, args: Any, kwargs: Any
    ) -> Any:
        """Make several shorter engine steps for one step of the script."""
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
        """Make an engine step, and send the state after it."""
        asks = False
        try:
            if world.touched:
                world.before_step()
            if not world.step % ASKED_EVERY and not self.pipe.muted:
                asks = world.asks_solver()
        except Exception as error:  # noqa: BLE001 - our errors must not reach the script
            self.lose(world, error)
            return original(*args, **kwargs)
        try:
            result = original(*args, **kwargs)
        finally:
            if asks:
                world.solver.report(on=False)
        try:
            world.after_step(result)
        except Exception as error:  # noqa: BLE001 - likewise
            self.lose(world, error)
        return () if asks else result

    def set_real_time(self, world: WatchedWorld, *, on: bool) -> None:
        """Note real-time mode: the virtual clock then makes the steps, not PyBullet's thread."""
        self.real_time_since.pop(world.client, None)
        if on and world.client in self.windows:
            self.real_time_since[world.client] = (self.host.clock.now_s(), world.time_s)
            self.readings.look()
            self.pipe.note("real_time", world=world.number, step=world.step)

    def let_time_pass(self) -> None:
        """Advance the simulated clock by a call's duration, in real-time mode."""
        if self.real_time_since:
            self.host.clock.wait(CALL_S)

    def catch_up(self) -> None:
        """Make the steps that are due in real-time mode."""
        now_s = self.host.clock.now_s
        for client, (since_s, from_s) in list(self.real_time_since.items()):
            world = self.worlds[client]
            if world.stale_engine:
                self.guarded(world, world.before_step)
            finer = 1 if self._variation is None else self._variation.finer
            while (
                client in self.worlds
                and world.time_s + finer * world.timestep_s - from_s <= now_s() - since_s
            ):
                self.step(world, self.p.stepSimulation, (client,), {})

    def stop(self) -> None:
        """Make the script end at its next call."""
        self.readings.look()

    # -- the end ----------------------------------------------------------------------------------

    def settle(self) -> None:
        """Send the remaining data of all simulations."""
        for world in list(self.worlds.values()):
            self.guarded(world, world.end)

    def finish(self) -> None:
        """Stop following all simulations."""
        self.worlds.clear()


def _library(module: ModuleType) -> object:
    """Return the identity of the file that a module was loaded from, whatever its path."""
    try:
        status = os.stat(str(module.__file__))
    except OSError:  # it was removed, or is no file
        return module.__file__
    return status.st_dev, status.st_ino
