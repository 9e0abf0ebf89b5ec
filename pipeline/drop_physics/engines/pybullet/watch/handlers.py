"""Wrappers that replace pybullet's functions in a watched script, by the function's role.

The wrapper of the step function makes few Python calls, as it runs most often; all other cases are
looked up by the function's name.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from sys import _getframe
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

from ...watching import pipe as protocol
from ...watching.hidden import hide
from ...watching.sites import caller
from .arguments import ARGUMENTS, client_of, named, number, vector
from .changes import after_change, before_change
from .functions import (
    CHANGES_NOTHING,
    IK,
    MOVES_ALL,
    MOVES_BODY,
    POLLS,
    PUSHES,
    READ_AGAIN,
    READS,
    RETURNS,
    ROLES,
)
from .quiet import Window
from .worlds import ALL, WatchedWorld

if TYPE_CHECKING:
    from .hooks import BulletWatch

Call = Callable[..., Any]

ANSWERED = set(Window(SimpleNamespace(), 0).answers())
"""Functions whose result depends on a window."""


def handler(watch: BulletWatch, name: str, original: Any) -> Call:
    """Return the wrapper for a function of pybullet."""
    special = {
        "connects": connecting,
        "disconnects": disconnecting,
        "steps": stepping,
        "resets": resetting,
        "photographs": photographing,
        "sets a path": searching,
    }
    for role, made in special.items():
        if name == ROLES[role]:
            return made(watch, name, original)
    made = reading if name in READS else passive if name in CHANGES_NOTHING else changing
    return made(watch, name, original)


def stepping(watch: BulletWatch, name: str, original: Any) -> Call:
    """Wrap a step function, to send a sample after each step."""
    host, pipe, worlds = watch.host, watch.pipe, watch.worlds
    lock = host.lock
    acquire, release, kept = lock.acquire, lock.release, lock.kept

    def step(*args: Any, **kwargs: Any) -> Any:
        try:
            if not host.on:
                host.step_apart()
                return original(*args, **kwargs)
            acquire()
            try:
                if host.stopped or pipe.gone:
                    host.check()
                world = worlds.get(client_of(name, args, kwargs) if args or kwargs else 0)
                if world is None:
                    return original(*args, **kwargs)
                return watch.step(world, original, args, kwargs)
            finally:
                release()
                if kept:
                    lock.give_back()
        except BaseException as error:
            hide(error)
            raise

    return step


def changing(watch: BulletWatch, name: str, original: Any) -> Call:
    """Wrap a function that changes a simulation, to send the call and read changed properties.

    `CallWatch.tell` sends a call that resembles no earlier one, and prepares what sends the next.
    """
    host, pipe, worlds, calls = watch.host, watch.pipe, watch.worlds, watch.calls
    lock = host.lock
    acquire, release, kept = lock.acquire, lock.release, lock.kept
    real_time, frame = watch.real_time_since, _getframe
    before, after = _effects(watch, name)
    senders = calls.senders(name, before)

    def change(*args: Any, **kwargs: Any) -> Any:
        try:
            if not host.on:
                return original(*args, **kwargs)
            told = noted = world = None
            acquire()
            try:
                if host.stopped or pipe.gone or real_time:
                    host.check()
                    watch.let_time_pass()
                place = frame(1)
                try:
                    world, send = senders[id(place.f_code), place.f_lasti]
                    noted = send(args, kwargs)
                except Exception:  # noqa: BLE001 - the first of its kind
                    world = None
                if world is None:
                    world = worlds.get(client_of(name, args, kwargs))
                    if world is None:
                        return original(*args, **kwargs)
                    if before is not None:
                        noted = before(world, args, kwargs)
                    watch.guarded(world, calls.tell, world, name, args, kwargs, place)
                told = world
                result = original(*args, **kwargs)
                if after is not None:
                    after(world, noted, result)
                return result
            except Exception as error:
                _raised(watch, told, name, error)
                raise
            finally:
                release()
                if kept:
                    lock.give_back()
        except BaseException as error:
            hide(error)
            raise

    return change


def _effects(watch: BulletWatch, name: str) -> tuple[Call | None, Call | None]:
    """Return further actions before and after a call of a function; None for no action."""
    if name in MOVES_BODY:
        return partial(_before_move, watch, name), None
    if name in PUSHES:
        return partial(_before_push, watch), None
    if name in READ_AGAIN:
        return partial(_before_change, watch, name), partial(_after_change, watch, name)
    if name in IK:
        return None, partial(_after_ik, watch)
    return None, partial(_after_creation, watch) if name in RETURNS else None


def _after_ik(watch: BulletWatch, _: WatchedWorld, __: Any, result: Any) -> None:
    """Send a result of inverse kinematics, so that its later use as a target is recognised."""
    if type(result) is tuple and result:
        watch.pipe.send(protocol.RESULT, protocol.NUMBER.pack(max(result, key=abs)))


def _before_move(
    watch: BulletWatch, name: str, world: WatchedWorld, args: Any, kwargs: Any
) -> None:
    """Note which body a call moves, and which parts of its state the call sets."""
    body = args[0] if args else kwargs.get("bodyUniqueId", kwargs.get("objectUniqueId"))
    if type(body) is not int:
        body = number(body)
    which: Any = name
    if "Joint" in name:
        which = name, number(args[1] if len(args) > 1 else kwargs.get("jointIndex"))
    moved = world.moved
    if body not in moved:
        moved[body] = {which}
    elif which not in moved[body]:
        moved[body].add(which)
    else:  # it was there, if only for a moment
        watch.guarded(world, world.sync)
        world.moved[body] = {which}
    world.touched = True


def _before_push(watch: BulletWatch, world: WatchedWorld, *_: Any) -> None:
    if world.touched:  # it acts at a point and along axes of the body's current pose
        watch.guarded(world, world.sync)


def _before_change(
    watch: BulletWatch, name: str, world: WatchedWorld, args: Any, kwargs: Any
) -> dict[str, Any]:
    arguments = named(name, args, kwargs)
    watch.guarded(world, before_change, world, name, arguments)
    return arguments


def _after_change(
    watch: BulletWatch, name: str, world: WatchedWorld, arguments: dict[str, Any], result: Any
) -> None:
    if name in RETURNS:
        _after_creation(watch, world, arguments, result)
    watch.guarded(world, after_change, world, name, arguments, result)
    if name == "setRealTimeSimulation":
        watch.set_real_time(world, on=bool(arguments.get("enableRealTimeSimulation", 0)))
    watch.pipe.tick()


def _after_creation(watch: BulletWatch, _: WatchedWorld, __: Any, result: Any) -> None:
    if type(result) is int:
        watch.pipe.send(protocol.RESULT, protocol.NUMBER.pack(result))


def _raised(watch: BulletWatch, world: WatchedWorld | None, name: str, error: Exception) -> None:
    if world is None:  # it was not told of
        return
    watch.pipe.note("raised", error=f"{type(error).__name__}: {error}")
    if name in MOVES_ALL:  # it may have moved some bodies before it failed
        world.moved[ALL] = set()
        world.touched = True


def reading(watch: BulletWatch, name: str, original: Any) -> Call:
    """Wrap a function that reads values, to count its calls."""
    host, pipe, readings = watch.host, watch.pipe, watch.readings
    lock, real_time = host.lock, watch.real_time_since
    acquire, release, kept = lock.acquire, lock.release, lock.kept
    passing, frame = readings.passing(name), _getframe

    def read(*args: Any, **kwargs: Any) -> Any:
        try:
            try:
                if frame(1).f_lasti in passing or not host.on:
                    # Without empty keywords it takes a fiftieth of the reading less.
                    return original(*args, **kwargs) if kwargs else original(*args)
                if host.stopped or pipe.gone or real_time:
                    with host.lock:
                        host.check()
                        watch.let_time_pass()
                result = original(*args, **kwargs)
            except Exception as error:
                if host.on:
                    _failed(watch, name, args, kwargs, error, frame(1))
                raise
            acquire()
            try:
                readings.count(name, args, kwargs, frame(1), result)
            except Exception as error:  # noqa: BLE001 - our errors must not reach the script
                readings.fail(error)
            finally:
                release()
                if kept:
                    lock.give_back()
            return result
        except BaseException as error:
            hide(error)
            raise

    return read


def _failed(
    watch: BulletWatch,
    name: str,
    args: tuple[Any, ...],
    kwargs: dict[str, Any],
    error: Exception,
    place: Any,
) -> None:
    """Send a call that raised an error, since its arguments may explain a finding."""
    with watch.host.lock:
        world = watch.worlds.get(client_of(name, args, kwargs))
        if world is not None:
            watch.guarded(world, watch.calls.tell, world, name, args, kwargs, place)
        _raised(watch, world, name, error)


def passive(watch: BulletWatch, name: str, original: Any) -> Call:
    """Wrap a function without effect on the simulation, and replace results that need a window."""
    polls, host, pipe, windows = name in POLLS, watch.host, watch.pipe, watch.windows
    has_answer, real_time = name in ANSWERED, watch.real_time_since

    def call(*args: Any, **kwargs: Any) -> Any:
        try:
            if not host.on:
                return original(*args, **kwargs)
            if host.stopped or pipe.gone or real_time or polls:
                with host.lock:
                    host.check()
                    watch.let_time_pass()
                    if polls:
                        host.clock.ask()
            if has_answer and windows:
                client = client_of(name, args, kwargs)
                if client in windows:
                    return _answer(windows[client], name, original, args, kwargs)
            try:
                return original(*args, **kwargs)
            except Exception as error:
                _failed(watch, name, args, kwargs, error, _getframe(1))
                raise
        except BaseException as error:
            hide(error)
            raise

    return call


def _answer(window: Window, name: str, original: Any, args: Any, kwargs: Any) -> Any:
    arguments = named(name, args, kwargs)
    answer = None
    if name == "getConnectionInfo" or not set(arguments) <= {*ARGUMENTS[name]}:
        answer = original(*args, **kwargs)  # or its own error
    return window.answers()[name](arguments, answer)


def searching(watch: BulletWatch, name: str, original: Any) -> Call:
    """Wrap `setAdditionalSearchPath`, to note the path."""
    call = passive(watch, name, original)

    def search(*args: Any, **kwargs: Any) -> Any:
        result = call(*args, **kwargs)
        path = named(name, args, kwargs).get("path")
        if type(path) is str:
            WatchedWorld.search_path = path
        return result

    return watch.host.standing(call, search)


def connecting(watch: BulletWatch, _: str, original: Any) -> Call:
    """Wrap `connect`, to follow a new simulation, and never to open a window."""
    host = watch.host

    def connect(*args: Any, **kwargs: Any) -> Any:
        with host.lock:
            host.check()
            p = watch.p
            method: Any = args[0] if args else kwargs.get("method")
            windows = {getattr(p, name, None) for name in ("GUI", "GUI_SERVER")}
            if method in windows:
                client = original(p.DIRECT)
                watch.windows[client] = Window(p, method)
                label = "GUI"
            elif method == p.SHARED_MEMORY:
                return -1  # a server there would not be the script's
            else:
                client = original(*args, **kwargs)
                label = "DIRECT" if method == p.DIRECT else f"method {method}"
            if client >= 0:
                watch.begin(client, label)
            return client

    return host.standing(original, connect)


def disconnecting(watch: BulletWatch, name: str, original: Any) -> Call:
    """Wrap `disconnect`, to end a simulation."""

    def disconnect(*args: Any, **kwargs: Any) -> Any:
        with watch.host.lock:  # no check for Stop: scripts clean up with this call
            watch.host.before_end()
            watch.end(client_of(name, args, kwargs))
        return original(*args, **kwargs)

    return watch.host.standing(original, disconnect)


def resetting(watch: BulletWatch, name: str, original: Any) -> Call:
    """Wrap `resetSimulation`, which removes all bodies."""
    host = watch.host

    def reset(*args: Any, **kwargs: Any) -> Any:
        with host.lock:
            host.check()
            world = watch.worlds.get(client_of(name, args, kwargs))
            if world is None:
                return original(*args, **kwargs)
            watch.guarded(world, world.sync)
            watch.guarded(world, watch.calls.tell, world, name, args, kwargs, caller())
            try:
                result = original(*args, **kwargs)
            except Exception as error:
                _raised(watch, world, name, error)
                raise
            world.forget()
            watch.readings.forget()
            return result

    return host.standing(original, reset)


def photographing(watch: BulletWatch, name: str, original: Any) -> Call:
    """Wrap `getCameraImage`, to send the image."""
    host = watch.host

    def photograph(*args: Any, **kwargs: Any) -> Any:
        with host.lock:
            host.check()
            watch.let_time_pass()
            world = watch.worlds.get(client_of(name, args, kwargs))
            result = original(*args, **kwargs)
            if world is not None:
                place = caller()
                watch.guarded(world, watch.readings.count, name, args, kwargs, place)
                arguments, at = named(name, args, kwargs), host.sites.place(place)
                watch.guarded(world, _send_image, watch, world, arguments, result, at)
            return result

    return host.standing(original, photograph)


def _send_image(
    watch: BulletWatch,
    world: WatchedWorld,
    arguments: dict[str, Any],
    result: Any,
    place: tuple[str, int],
) -> None:
    width, height, pixels = result[:3]
    data = pixels.tobytes() if hasattr(pixels, "tobytes") else bytes(pixels)
    if len(data) != 4 * width * height:
        return
    world.before_step()
    file, line = place
    note = {
        "world": world.number,
        "step": world.step,
        "width": width,
        "height": height,
        "view": vector(arguments.get("viewMatrix")),
        "projection": vector(arguments.get("projectionMatrix")),
        "file": file,
        "line": line,
    }
    head = protocol.encoded(note)
    watch.pipe.send(protocol.IMAGE, protocol.IMAGE_HEAD.pack(len(head)) + head + data)
