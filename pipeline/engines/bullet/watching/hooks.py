"""The functions of pybullet, each replaced by one that calls it and tells the recorder.

The script sees no difference: calls return the engine's own answer, except where a window would
have to be open (`quiet`), and where time would have to pass (`clock`).
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable
from pathlib import Path
from types import BuiltinFunctionType, ModuleType, SimpleNamespace
from typing import Any

from . import pipe as protocol
from .clock import CALL_S, Clock
from .links import MODELS, links_in, path_of
from .pipe import Pipe
from .quiet import Window
from .turns import Turn
from .worlds import ALL, World

ARGUMENTS: dict[str, list[str]] = json.loads(
    Path(__file__).with_name("arguments.json").read_text(encoding="utf-8")
)
"""The names of every function's arguments, in order, in PyBullet 3.2.7."""

IDLE_S = 60.0
"""A script that waits this long [s] without a step is waiting for a user who is not there."""

# -- what calls do --------------------------------------------------------------------------------

MAKES_BODIES = {
    "loadURDF", "loadSDF", "loadMJCF", "loadBullet", "loadSoftBody", "createMultiBody",
    "unsupportedChangeScaling",
}  # fmt: skip
REMOVES_BODIES = {"removeBody", "executePluginCommand", "unloadPlugin", "loadPlugin"}
MOVES_BODY = {
    "resetBasePositionAndOrientation", "resetBaseVelocity", "resetJointState",
    "resetJointStateMultiDof", "resetJointStatesMultiDof", "changeDynamics",
}  # fmt: skip
MOVES_ALL = {"restoreState", "executePluginCommand"}
RECOLOURS = {"changeVisualShape", "resetVisualShapeData"}
SETS_ENGINE = {
    "setGravity", "setTimeStep", "setPhysicsEngineParameter", "setDefaultContactERP",
    "setRealTimeSimulation", "setInternalSimFlags", "loadBullet", "loadSDF", "loadMJCF",
}  # fmt: skip
PUSHES = {"applyExternalForce", "applyExternalTorque"}

MERGE_FIXED_LINKS = 1 << 19
"""Of the flags of `loadURDF`."""

POLLS = {
    "getKeyboardEvents", "getMouseEvents", "getVREvents", "readUserDebugParameter", "isConnected",
    "getDebugVisualizerCamera",
}  # fmt: skip
"""Where a script asks whether the user has done something."""
CHANGES_NOTHING = {
    "addUserDebugLine", "addUserDebugPoints", "addUserDebugText", "addUserDebugParameter",
    "removeUserDebugItem", "removeAllUserDebugItems", "removeAllUserParameters",
    "setDebugObjectColor", "configureDebugVisualizer", "resetDebugVisualizerCamera",
    "setVRCameraState", "setAdditionalSearchPath", "setTimeOut", "submitProfileTiming",
    "startStateLogging", "stopStateLogging", "multiplyTransforms", "invertTransform",
    "rotateVector", "vhacd", "syncBodyInfo", "syncUserData", "addUserData", "removeUserData",
    "renderImage", "saveWorld", "saveBullet", "readUserDebugParameter",
}  # fmt: skip
READS = ("get", "is", "compute", "calculate", "rayTest")
"""Prefixes of further functions that change nothing."""

BODY_NAMES = ("bodyUniqueId", "objectUniqueId", "bodyIndex")


class Stop(SystemExit):
    """The script has reached its limit; few scripts catch this, and threads end silently."""


class Hook:
    """A function of pybullet, watched.

    It passes for a builtin function (`inspect.isbuiltin`): only to those do wrappers such as
    `BulletClient` bind the client's number.
    """

    def __init__(self, original: Any) -> None:
        self.__name__ = self.__qualname__ = original.__name__
        self.__doc__ = original.__doc__
        self.__module__ = "pybullet"
        self.__text_signature__ = None

    @property
    def __class__(self) -> Any:
        return BuiltinFunctionType

    @__class__.setter
    def __class__(self, _: Any) -> None:
        raise TypeError("the class of a builtin function cannot be changed")

    def __reduce__(self) -> str:
        return str(self.__name__)

    def __repr__(self) -> str:
        return f"<built-in function {self.__name__}>"


class Watch:
    """What is known of a running script.

    Parameters
    ----------
    steps
        After how many steps to stop it, or None.
    duration_s
        After how much time on its clock [s] to stop it, or None.
    """

    def __init__(
        self, pipe: Pipe, clock: Clock, *, steps: int | None, duration_s: float | None
    ) -> None:
        self.pipe, self.clock = pipe, clock
        self.on = True
        self.lock = Turn()
        self.stopped: str | None = None
        self._limit_steps, self._limit_s = steps, duration_s
        self._steps = self._worlds_made = 0
        self._worlds: dict[int, World] = {}
        self._windows: dict[int, Window] = {}
        self._real_time_since: dict[int, tuple[float, float]] = {}
        self._last_end = (0, 0.0)
        self._modules: list[tuple[ModuleType, dict[str, Any]]] = []
        self._shown: dict[str, str] = {}
        """Where PyBullet looks for files, in all simulations."""
        self._p = SimpleNamespace()
        self._undo: list[Callable[[], None]] = []
        self._process = os.getpid()
        clock.passed = self._time_has_passed
        if hasattr(os, "register_at_fork"):
            os.register_at_fork(after_in_child=self._forked)

    # -- in place of pybullet's functions ---------------------------------------------------------

    def install(self, module: ModuleType) -> None:
        """Replace the functions of pybullet, in place; those of a reloaded module are already."""
        originals = {
            name: value
            for name, value in vars(module).items()
            if isinstance(value, BuiltinFunctionType) and not issubclass(type(value), Hook)
        }
        if not originals:
            return
        self._p = SimpleNamespace(**{**vars(module), **vars(self._p), **originals})
        self._modules.append((module, originals))
        for name, original in originals.items():
            handler = self._handler(name, original)
            kind = type("Hook", (Hook,), {"__call__": staticmethod(handler)})
            setattr(module, name, kind(original))
        self.pipe.note("pybullet", version=module.getAPIVersion(), file=module.__file__)
        for client in range(MOST_CLIENTS):  # connected before we came
            if client not in self._worlds and self._p.isConnected(client):
                self._begin(client, "before")

    def remove(self) -> None:
        """Put the functions back; those that a script has kept just call the engine."""
        self.on = False
        for module, originals in self._modules:
            vars(module).update(originals)
        while self._undo:
            self._undo.pop()()
        self.clock.remove()
        self.lock.remove()

    def on_removal(self, undo: Callable[[], None]) -> None:
        """Register a function that undoes something when this watch ends."""
        self._undo.append(undo)

    def tell_draw(self, called: str, frame: Any) -> None:
        """Report an unseeded random number."""
        file, line = self._place(frame)
        with self.lock:
            self.pipe.note("unseeded", called=called, file=file, line=line)

    def _handler(self, name: str, original: Any) -> Callable[..., Any]:
        special = {
            "connect": self._connecting, "disconnect": self._disconnecting,
            "stepSimulation": self._stepping, "resetSimulation": self._resetting,
            "getCameraImage": self._photographing, "setAdditionalSearchPath": self._searching,
        }.get(name)  # fmt: skip
        if special is None:
            passive = name in CHANGES_NOTHING or name.startswith(READS)
            special = self._passive if passive else self._changing
        return special(name, original)

    def _passive(self, name: str, original: Any) -> Callable[..., Any]:
        polls, clock = name in POLLS, self.clock
        has_answer = name in _ANSWERED

        def call(*args: Any, **kwargs: Any) -> Any:
            if not self.on:
                return original(*args, **kwargs)
            if self.stopped or self.pipe.gone or self._real_time_since or polls:
                with self.lock:
                    self.check()
                    if self._real_time_since:
                        clock.wait(CALL_S)
                    if polls:
                        clock.ask()
            if has_answer and self._windows:
                client = _client(name, args, kwargs)
                if client in self._windows:
                    return self._answer(client, name, original, args, kwargs)
            return original(*args, **kwargs)

        return call

    def _searching(self, name: str, original: Any) -> Callable[..., Any]:
        passive = self._passive(name, original)

        def search(*args: Any, **kwargs: Any) -> Any:
            result = passive(*args, **kwargs)
            path = _named(name, args, kwargs).get("path")
            if type(path) is str:
                World.search_path = path
            return result

        return search

    def _answer(
        self,
        client: int,
        name: str,
        original: Any,
        args: Any,
        kwargs: Any,
    ) -> Any:
        arguments = _named(name, args, kwargs)
        answer = None
        if name == "getConnectionInfo" or not set(arguments) <= {*ARGUMENTS[name]}:
            answer = original(*args, **kwargs)  # or its own error
        return self._windows[client].answers()[name](arguments, answer)

    def _changing(self, name: str, original: Any) -> Callable[..., Any]:
        def change(*args: Any, **kwargs: Any) -> Any:
            if not self.on:
                return original(*args, **kwargs)
            with self.lock:
                self.check()
                if self._real_time_since:
                    self.clock.wait(CALL_S)
                world = self._worlds.get(_client(name, args, kwargs))
                if world is None:
                    return original(*args, **kwargs)
                arguments = _named(name, args, kwargs)
                self._guarded(world, lambda: self._before_change(world, name, arguments))
                self._tell(world, name, args, kwargs, sys._getframe(1))
                try:
                    result = original(*args, **kwargs)
                except Exception as error:
                    self.pipe.note("raised", error=f"{type(error).__name__}: {error}")
                    if name in MOVES_ALL:  # it may have moved some bodies before it failed
                        world.moved[ALL] = set()
                    raise
                self._after_change(world, name, arguments, result)
                return result

        return change

    def _before_change(self, world: World, name: str, arguments: dict[str, Any]) -> None:
        """Send a body's state before a call changes it again: it had it, if only for a moment."""
        if name in MOVES_BODY and name != "changeDynamics":
            key = (name, _text(arguments.get("jointIndex")))
            if key in world.moved.get(_body(arguments), ()):
                world.sync()
        elif name == "changeDynamics" and arguments.keys() & {"mass", "localInertiaDiagonal"}:
            # Of a btRigidBody the inertia changes the mass, too: PyBullet takes it to be 0 then.
            body = _body(arguments)
            if body is not None:
                world.before_mass(body)
        elif name in PUSHES or (name in MOVES_ALL and world.moved):
            world.sync()  # a push acts at a point and along axes of the body's current pose

    def _after_change(
        self,
        world: World,
        name: str,
        arguments: dict[str, Any],
        result: Any,
    ) -> None:
        body = _body(arguments)
        if name in MAKES_BODIES:
            world.stale_bodies = True
            results = result if isinstance(result, tuple) else (result,)
            ids = [value for value in results if isinstance(value, int) and value >= 0]
            world.fresh.update(ids)
            file = next(iter(arguments.values()), "") if name.startswith("load") else ""
            text = os.path.basename(file) if type(file) is str else ""
            world.files.update(dict.fromkeys(ids, text))
            for each in ids:
                world.mjcf.pop(each, None)
            if name == "loadMJCF":
                path = path_of(file, World.search_path) if text else None
                world.mjcf.update(dict.fromkeys(ids, path and os.path.abspath(path)))
            world.inertial.update(dict.fromkeys(ids))
            if arguments.get("useMaximalCoordinates") and len(ids) == 1:
                # PyBullet takes what is no vector for none.
                given = [_vector(arguments.get(f"base{of}")) for of in ("Position", "Orientation")]
                self._guarded(world, lambda: world.note_inertial(ids[0], *given))
            world.flags.update(dict.fromkeys(ids, _number(arguments.get("flags", 0)) or 0))
            world.hiding.difference_update(ids)
            world.forget_ids(ids)
            world.hiding.update(self._hiding(name, arguments, ids))
            if name == "unsupportedChangeScaling" and body is not None:
                world.fresh.add(body)
        if name in REMOVES_BODIES:
            world.stale_bodies = True
        if name == "removeBody" and body is not None:
            world.fresh.discard(body)
        if name == "createConstraint":
            self._guarded(world, lambda: _tell_constraint(world, arguments, result))
        if name == "removeConstraint":
            self.pipe.note(
                "released", world=world.number, step=world.step,
                constraint=_number(arguments.get("userConstraintUniqueId")),
            )  # fmt: skip
        if name.startswith("setJointMotorControl"):
            _tell_motors(world, arguments)
        if name in MOVES_BODY:
            key = (name, _text(arguments.get("jointIndex")))
            world.moved.setdefault(body, set()).add(key)
        if name in MOVES_ALL:
            world.moved[ALL] = set()
        if name == "changeDynamics":
            world.changed.add(body)
            world.tell_later(body, "given", values=_values(arguments, but=BODY_NAMES))
        if name in RECOLOURS and body is not None:
            world.recoloured.add(body)
        if name in SETS_ENGINE:
            world.stale_engine = True
            if "reportSolverAnalytics" in arguments and name == "setPhysicsEngineParameter":
                value = int(arguments["reportSolverAnalytics"])
                if value >= 0:  # otherwise the engine leaves it unchanged
                    world.returns_analytics = bool(value & 1)
            if name in ("setPhysicsEngineParameter", "setDefaultContactERP"):
                world.given.update(_values(arguments))
        if name == "setRealTimeSimulation":
            self._set_real_time(world, bool(arguments.get("enableRealTimeSimulation", 0)))
        elif name in PUSHES:
            world.tell_later(
                body, "push",
                link=_number(arguments.get("linkIndex", -1)), torque=name.endswith("Torque"),
                vector=_vector(arguments.get("forceObj", arguments.get("torqueObj"))),
                position=_vector(arguments.get("posObj")),
                flags=_number(arguments.get("flags", 0)),
            )  # fmt: skip
            self._guarded(world, world.sync)

    def _hiding(self, name: str, arguments: dict[str, Any], ids: list[int]) -> list[int]:
        """Return which of the bodies that a call created have links that PyBullet does not show."""
        if name == "loadMJCF":
            rigid = not arguments.get("useMultiBody", 1)
        else:
            rigid = bool(arguments.get("useMaximalCoordinates"))
        if not rigid:
            return []
        if name not in MODELS:
            return ids if arguments.get("linkMasses") else []
        file = arguments.get(ARGUMENTS[name][0])
        path = path_of(file, World.search_path) if type(file) is str else None
        if path is None:
            return []
        merged = (_number(arguments.get("flags", 0)) or 0) & MERGE_FIXED_LINKS
        try:
            links = links_in(path, name, merged=bool(merged) and name == "loadURDF")
        except OSError:
            return []
        if len(links) != len(ids):  # which model is which is not known
            links = [max(links, default=1)] * len(ids)
        return [each for each, number in zip(ids, links) if number > 1]

    def _connecting(self, _: str, original: Any) -> Callable[..., Any]:
        def connect(*args: Any, **kwargs: Any) -> Any:
            if not self.on:
                return original(*args, **kwargs)
            with self.lock:
                self.check()
                p = self._p
                method: Any = args[0] if args else kwargs.get("method")
                windows = {getattr(p, name, None) for name in ("GUI", "GUI_SERVER")}
                if method in windows:
                    client = original(p.DIRECT)
                    self._windows[client] = Window(p, method)
                    label = "GUI"
                elif method == p.SHARED_MEMORY:
                    return -1  # a server there would not be the script's
                else:
                    client = original(*args, **kwargs)
                    label = "DIRECT" if method == p.DIRECT else f"method {method}"
                if client >= 0:
                    self._begin(client, label)
                return client

        return connect

    def _begin(self, client: int, method: str) -> None:
        step, time_s = self._last_end
        world = World(self.pipe, self._p, client=client, number=self._worlds_made, method=method,
            first_step=step, first_time_s=time_s)  # fmt: skip
        self._worlds[client] = world
        self._worlds_made += 1

    def _disconnecting(self, name: str, original: Any) -> Callable[..., Any]:
        def disconnect(*args: Any, **kwargs: Any) -> Any:
            if self.on:  # no check for Stop: scripts clean up with this call
                with self.lock:
                    self._end(_client(name, args, kwargs))
            return original(*args, **kwargs)

        return disconnect

    def _end(self, client: int) -> None:
        world = self._worlds.get(client)
        if world is None:
            return
        self._guarded(world, world.end)
        self._last_end = max(self._last_end, (world.step + 1, world.time_s))
        self._worlds.pop(client, None)
        self._windows.pop(client, None)
        self._real_time_since.pop(client, None)

    def _resetting(self, name: str, original: Any) -> Callable[..., Any]:
        def reset(*args: Any, **kwargs: Any) -> Any:
            if not self.on:
                return original(*args, **kwargs)
            with self.lock:
                self.check()
                world = self._worlds.get(_client(name, args, kwargs))
                if world is None:
                    return original(*args, **kwargs)
                self._guarded(world, world.sync)
                self._tell(world, name, args, kwargs, sys._getframe(1))
                result = original(*args, **kwargs)
                world.forget()
                return result

        return reset

    def _photographing(self, name: str, original: Any) -> Callable[..., Any]:
        def photograph(*args: Any, **kwargs: Any) -> Any:
            if not self.on:
                return original(*args, **kwargs)
            with self.lock:
                self.check()
                if self._real_time_since:
                    self.clock.wait(CALL_S)
                world = self._worlds.get(_client(name, args, kwargs))
                result = original(*args, **kwargs)
                if world is not None:
                    frame = sys._getframe(1)
                    self._guarded(world, lambda: self._send_image(
                        world, _named(name, args, kwargs), result, frame))  # fmt: skip
                return result

        return photograph

    def _send_image(
        self,
        world: World,
        arguments: dict[str, Any],
        result: Any,
        frame: Any,
    ) -> None:
        width, height, pixels = result[:3]
        data = pixels.tobytes() if hasattr(pixels, "tobytes") else bytes(pixels)
        if len(data) != 4 * width * height:
            return
        world.before_step()
        file, line = self._place(frame)
        note = {
            "world": world.number, "step": world.step, "width": width, "height": height,
            "view": _vector(arguments.get("viewMatrix")),
            "projection": _vector(arguments.get("projectionMatrix")), "file": file, "line": line,
        }  # fmt: skip
        head = protocol.encoded(note)
        self.pipe.send(protocol.IMAGE, protocol.IMAGE_HEAD.pack(len(head)) + head + data)

    def _stepping(self, name: str, original: Any) -> Callable[..., Any]:
        worlds, lock = self._worlds, self.lock

        def step(*args: Any, **kwargs: Any) -> Any:
            if not self.on:
                return original(*args, **kwargs)
            with lock:
                self.check()
                world = worlds.get(_client(name, args, kwargs))
                if world is None:
                    return original(*args, **kwargs)
                return self._step(world, original, args, kwargs)

        return step

    # -- steps and time ---------------------------------------------------------------------------

    def _step(self, world: World, original: Any, args: Any, kwargs: Any) -> Any:
        self._guarded(world, world.before_step)
        analytics = world.asks_solver()
        try:
            result = original(*args, **kwargs)
        finally:
            if analytics:
                world.report_solver(on=False)
        if self._guarded(world, lambda: world.after_step(result)):
            self._steps += 1
            self.clock.step(world.time_s)
            if self._steps == self._limit_steps:
                self.stop("steps")
            self._check_time()
        return () if analytics else result

    def _set_real_time(self, world: World, on: bool) -> None:
        """Let a simulation run by itself, as it does with a window; without one it never does."""
        self._real_time_since.pop(world.client, None)
        if on and world.client in self._windows:
            self._real_time_since[world.client] = (self.clock.now_s(), world.time_s)
            self.pipe.note("real_time", world=world.number, step=world.step)

    def _time_has_passed(self) -> None:
        if not self.on:
            return
        with self.lock:
            self.check()
            for client, (since_s, from_s) in list(self._real_time_since.items()):
                world = self._worlds[client]
                if world.stale_engine:
                    self._guarded(world, world.before_step)
                while (
                    client in self._worlds
                    and world.time_s + world.timestep_s - from_s <= self.clock.now_s() - since_s
                ):
                    self._step(world, self._p.stepSimulation, (client,), {})
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
        self.pipe.note("stop", why=why)
        self.pipe.flush()
        raise Stop(0)

    def check(self) -> None:
        """Raise again if the script has caught the end; without a recorder it ends too."""
        if self.stopped or self.pipe.gone:
            raise Stop(0)

    def finish(self) -> None:
        """Send what is left of all simulations: the script is over."""
        with self.lock:
            for client in list(self._worlds):
                self._end(client)
            self.on = False

    # -- what is reported -------------------------------------------------------------------------

    def _tell(
        self,
        world: World,
        name: str,
        args: Any,
        kwargs: Any,
        frame: Any,
    ) -> None:
        texts = [_text(arg) for arg in args]
        texts += [f"{key}={_text(arg)}" for key, arg in kwargs.items() if key != "physicsClientId"]
        file, line = self._place(frame)
        self.pipe.note(
            "call", world=world.number, step=world.step, name=name, arguments=", ".join(texts),
            file=file, line=line,
        )  # fmt: skip

    def _place(self, frame: Any) -> tuple[str, int]:
        """Return file and line of a frame, the file without folders of this machine."""
        name = frame.f_code.co_filename
        shown = self._shown.get(name)
        if shown is None:
            shown = self._shown[name] = _shown(name)
        return shown, frame.f_lineno

    def _guarded(self, world: World, read: Callable[[], None]) -> bool:
        """Read something; if it fails, the simulation is dropped, and the script goes on."""
        try:
            read()
        except Exception as error:  # noqa: BLE001 - our errors must not reach the script
            if world.client in self._worlds:
                self.pipe.note("fault", world=world.number, step=world.step,
                    error=f"{type(error).__name__}: {error}")  # fmt: skip
            self._worlds.pop(world.client, None)
            self._real_time_since.pop(world.client, None)
            return False
        return True

    def _forked(self) -> None:
        if self.on and os.getpid() != self._process:
            self.remove()
            self.pipe.leave()


MOST_CLIENTS = 64

_ANSWERED = set(Window(SimpleNamespace(), 0).answers())

_CLIENT_AT = {
    name: names.index("physicsClientId") if "physicsClientId" in names else None
    for name, names in ARGUMENTS.items()
}


def _client(name: str, args: tuple[Any, ...], kwargs: dict[str, Any]) -> int:
    """Return the client that a call is for: the last argument, or 0."""
    if kwargs:
        client = kwargs.get("physicsClientId")
        if client is not None:
            return _number(client) or 0
    at = _CLIENT_AT.get(name)
    return _number(args[at]) or 0 if at is not None and len(args) > at else 0


def _tell_constraint(world: World, arguments: dict[str, Any], result: Any) -> None:
    """Report which bodies a new constraint connects; the world is not one."""
    bodies = [_number(arguments.get(f"{role}BodyUniqueId")) for role in ("parent", "child")]
    world.tell_held(_number(result), bodies)


def _tell_motors(world: World, arguments: dict[str, Any]) -> None:
    """Report which joints are driven, how, and with which maximum force."""
    body, mode = _body(arguments), _number(arguments.get("controlMode"))
    if mode is None:
        return
    if "jointIndices" in arguments:
        joints = _vector(arguments["jointIndices"]) or []
        forces = _vector(arguments.get("forces"))
    else:
        joints = _vector([arguments.get("jointIndex")]) or []
        forces = _vector([arguments.get("force")])
    for number, joint in enumerate(joints):
        force = forces[number] if forces and number < len(forces) else None
        world.tell_motor(body, int(joint), mode, force)


def _named(name: str, args: tuple[Any, ...], kwargs: dict[str, Any]) -> dict[str, Any]:
    return {**dict(zip(ARGUMENTS.get(name, ()), args)), **kwargs}


def _body(arguments: dict[str, Any]) -> int | None:
    for name in BODY_NAMES:
        if name in arguments:
            return _number(arguments[name])
    return None


def _number(value: Any) -> int | None:
    try:
        return int(value)
    except (TypeError, ValueError):
        return None


def _vector(value: Any) -> list[float] | None:
    try:
        return [float(item) for item in value]
    except (TypeError, ValueError):
        return None


def _values(arguments: dict[str, Any], but: tuple[str, ...] = ()) -> dict[str, Any]:
    """Return the arguments that are numbers or vectors of numbers."""
    values: dict[str, Any] = {}
    for name, value in arguments.items():
        if name in but or name == "physicsClientId":
            continue
        if isinstance(value, int):
            values[name] = int(value)
        else:
            try:
                values[name] = float(value)
            except (TypeError, ValueError):
                vector = _vector(value)
                if vector is not None:
                    values[name] = vector
    return values


LONGEST = 32
"""Most values of a list that are reported; of a longer one the first, and their number."""


def _text(value: Any, depth: int = 0) -> str:
    """Return a value as a script would write it, without calling any code of the script."""
    kind = type(value)
    if kind in (int, float, bool, type(None)):
        return repr(value)
    if kind in (str, bytes):
        return repr(value if len(value) <= 300 else value[:300])
    if kind in (list, tuple) and depth < 4:
        texts = [_text(item, depth + 1) for item in value[:LONGEST]]
        if len(value) > LONGEST:
            texts.append(f"… {len(value)} values")
        return f"({', '.join(texts)})" if kind is tuple else f"[{', '.join(texts)}]"
    if kind.__module__.partition(".")[0] == "numpy" and hasattr(value, "tolist"):
        return _text(value.tolist() if value.size <= 1024 else value.ravel()[:1024].tolist(), depth)
    return f"<{kind.__name__}>"


def _shown(name: str) -> str:
    """Return a file's name, relative to the working directory or the module path."""
    for folder in (os.getcwd(), *sorted(sys.path, key=len, reverse=True)):
        if folder and name.startswith(os.path.join(folder, "")):
            return os.path.relpath(name, folder)
    return os.path.basename(name) or name
