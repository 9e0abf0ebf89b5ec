"""Start Python programs by forking, 50 times faster, in tests that are not about process start.

The first one starts a process that has imported what scripts and we import, and forks for each
program: what runs there is the same code. Programs with the seed of hashes that `drop` sets are
forked from a process of their own. A program whose environment counts when Python starts (other
seeds, other leftovers in memory), or that has another interpreter, is really started.
"""

from __future__ import annotations

import atexit
import contextlib
import ctypes
import functools
import gc
import json
import os
import runpy
import select
import signal
import socket
import struct
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryFile
from types import SimpleNamespace
from typing import Any, BinaryIO

STARTS = ("MALLOC_PERTURB_", "PYTHONHASHSEED", "LD_PRELOAD")
"""Environment variables that take effect when Python starts; `PYTHONPATH` is emulated instead."""
PERTURB = "85"
"""The value of the first of these variables that `Script` sets."""
STATUS = struct.Struct("i")
ASKS = threading.Lock()
"""Serializes requests of parallel trials, each of which must be sent in one piece."""
SEED = "0"
"""The value of `PYTHONHASHSEED` for scripts that are run more than once."""
BEGAN = dict(os.environ)
"""The environment before any test, as command lines run in this process add to it."""
IMPORTED = (
    *("argparse", "logging", "pathlib", "tempfile", "traceback", "numpy", "pybullet"),
    *("pybullet_data", "drop_physics.engines.watching.start"),
    "drop_physics.engines.watching.running",
)
M_PERTURB = -6
"""Parameter of glibc's `mallopt` that `MALLOC_PERTURB_` sets."""


class Forked:
    """A forked program, with the interface of `subprocess.Popen` that `Script` uses."""

    def __init__(
        self,
        command: Sequence[str],
        *,
        stdin: int | None = None,
        stdout: int | None = None,
        stderr: int | None = None,
        process_group: int | None = None,
        pass_fds: Sequence[int] = (),
        env: Mapping[str, str] | None = None,
        also: str = "",
        seed: str | None = None,
    ) -> None:
        self.args, self.returncode, self.stdin, self.stdout = command, None, None, None
        reading, writing = os.pipe()
        self._status = reading
        numbers = {0: 0, 1: 1 if stdout is None else stdout, 2: 2 if stderr is None else stderr}
        if stdout == subprocess.PIPE:
            from_it, numbers[1] = os.pipe()
            self.stdout: BinaryIO | None = os.fdopen(from_it, "rb")
        null = os.open(os.devnull, os.O_RDWR)
        if stdin == subprocess.DEVNULL:
            numbers[0] = null
        elif stdin == subprocess.PIPE:
            numbers[0], to_it = os.pipe()
            self.stdin: BinaryIO | None = os.fdopen(to_it, "wb")
        if stderr == subprocess.DEVNULL:
            numbers[2] = null
        numbers |= {number: number for number in pass_fds}
        request = {
            "arguments": [*command[1:]],
            "env": {**(os.environ if env is None else env)},
            "folder": str(Path.cwd()),
            "leads": process_group == 0,
            "numbers": [*numbers],
        }
        _ask(_server(also, seed), request, [writing, *numbers.values()])
        os.close(writing)
        os.close(null)
        if stdin == subprocess.PIPE:
            os.close(numbers[0])
        if stdout == subprocess.PIPE:
            os.close(numbers[1])
        self.pid = self._read()

    def _read(self) -> int:
        (number,) = STATUS.unpack(os.read(self._status, STATUS.size))
        return int(number)

    def __enter__(self) -> Forked:
        return self

    def __exit__(self, *_: object) -> None:
        for pipe in filter(None, (self.stdin, self.stdout)):
            pipe.close()
        self.wait()

    def poll(self) -> int | None:
        """Return the program's exit code, or None while it runs."""
        if self.returncode is None and select.select([self._status], [], [], 0)[0]:
            self.wait()
        return self.returncode

    def wait(self) -> int:
        """Wait for the program's end, and return its exit code."""
        if self.returncode is None:
            self.returncode = self._read()
            os.close(self._status)
        return self.returncode

    def send_signal(self, number: int) -> None:
        """Send the program a signal."""
        if self.poll() is None:
            with contextlib.suppress(ProcessLookupError):
                os.kill(self.pid, number)

    def kill(self) -> None:
        """Kill the program."""
        self.send_signal(signal.SIGKILL)


def fork_scripts() -> None:
    """Make this process start scripts and replay processes by forking."""
    from drop_physics.engines import script
    from drop_physics.engines.mujoco import stepping
    from drop_physics.engines.pybullet import replayed

    for module in (script, stepping, replayed):
        vars(module)["subprocess"] = SimpleNamespace(**vars(subprocess) | {"Popen": popen})


def popen(command: Sequence[str], **how: Any) -> Any:
    """Start a program, by forking if the effect is the same."""
    same = command[0] == sys.executable and not command[1].startswith("-")
    env = {"MALLOC_PERTURB_": PERTURB, **how["env"]}
    seed = SEED if env.get("PYTHONHASHSEED") == SEED else None
    then = _started_with(seed)
    if not same or any(env.get(name) != then.get(name) for name in STARTS) or _customized(env):
        return subprocess.Popen(command, **how)
    scripts = [path for path in map(Path, command[4:]) if path.is_file()]
    mujoco = command[2].startswith("mujoco.") or any(
        b"mujoco" in each.read_bytes() for each in scripts
    )
    return Forked(command, also="mujoco" if mujoco else "", seed=seed, **how)


def run(
    command: Sequence[str], folder: Path, *, also: str = ""
) -> subprocess.CompletedProcess[str]:
    """Run a program in a folder, and return its output."""
    with contextlib.chdir(folder), TemporaryFile() as out, TemporaryFile() as err:
        code = Forked(command, stdout=out.fileno(), stderr=err.fileno(), also=also).wait()
        for file in (out, err):
            file.seek(0)
        return subprocess.CompletedProcess(command, code, out.read().decode(), err.read().decode())


def _paths(environment: Mapping[str, str] = os.environ) -> list[str]:
    """Return the folders of `PYTHONPATH`, in the order in which Python searches them."""
    named = environment.get("PYTHONPATH", "").split(os.pathsep)
    return [*dict.fromkeys(map(os.path.abspath, filter(None, named)))]


def _customized(environment: Mapping[str, str]) -> bool:
    """Return whether Python would run a customization module of the user's at start-up."""
    names = ("sitecustomize.py", "usercustomize.py")
    return any(Path(folder, name).exists() for folder in _paths(environment) for name in names)


def _started_with(seed: str | None) -> dict[str, str]:
    """Return the start-up variables with which a forking process is started."""
    kept = {name: BEGAN[name] for name in STARTS if name in BEGAN}
    return kept | {"MALLOC_PERTURB_": PERTURB} | ({"PYTHONHASHSEED": seed} if seed else {})


def _ask(asking: socket.socket, request: dict[str, Any], files: list[int]) -> None:
    text = json.dumps(request).encode()
    with ASKS:
        socket.send_fds(asking, [STATUS.pack(len(text))], files)
        asking.sendall(text)


@functools.cache
def _server(also: str, seed: str | None) -> socket.socket:
    asking, serving = socket.socketpair()
    process = subprocess.Popen(
        [sys.executable, __file__, str(serving.fileno()), *[also] * bool(also)],
        pass_fds=[serving.fileno()],
        stdin=subprocess.DEVNULL,  # which may be a test's terminal: it would never be closed
        stderr=subprocess.DEVNULL,  # PyBullet greets
        stdout=subprocess.DEVNULL,
        env={**BEGAN, **_started_with(seed)},
    )
    serving.close()

    def end() -> None:
        asking.close()
        process.wait()

    atexit.register(end)
    return asking


# -- in the process that forks --------------------------------------------------------------------


def _serve(serving: socket.socket) -> Callable[[], None]:
    """Fork a child for each request; in the child, return a function that runs the program."""
    woken, wakes = os.pipe()
    for end in (woken, wakes):
        os.set_blocking(end, False)
    signal.set_wakeup_fd(wakes)
    signal.signal(signal.SIGCHLD, lambda *_: None)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    running: dict[int, int] = {}
    while True:
        ready, _, _ = select.select([serving, woken], [], [])
        if woken in ready:
            os.read(woken, 1 << 10)
            _reap(running)
            continue
        head, files, _, _ = socket.recv_fds(serving, STATUS.size, 64)
        if not head:
            raise SystemExit
        text = b""
        while len(text) < STATUS.unpack(head)[0]:
            text += serving.recv(STATUS.unpack(head)[0] - len(text))
        pid = os.fork()
        if not pid:
            signal.set_wakeup_fd(-1)
            for number in (signal.SIGCHLD, signal.SIGINT):
                signal.signal(number, signal.SIG_DFL)
            signal.signal(signal.SIGINT, signal.default_int_handler)
            for number in (woken, wakes, serving.detach(), *running.values()):
                os.close(number)
            return functools.partial(_become, json.loads(text), files)
        running[pid] = files[0]
        os.write(files[0], STATUS.pack(pid))
        for number in files[1:]:
            os.close(number)


def _reap(running: dict[int, int]) -> None:
    for pid in [*running]:
        done, status = os.waitpid(pid, os.WNOHANG)
        if done:
            told = running.pop(pid)
            with contextlib.suppress(OSError):  # nobody asks any more
                os.write(told, STATUS.pack(os.waitstatus_to_exitcode(status)))
            os.close(told)


def _become(request: dict[str, Any], files: list[int]) -> None:
    """Turn this process into the requested program, with its files, arguments and environment."""
    told, *theirs = files
    os.close(told)
    numbers = request["numbers"]
    above = [os.dup2(their, 200 + at) for at, their in enumerate(theirs)]  # out of each other's way
    for their in theirs:
        os.close(their)
    for each, number in zip(above, numbers, strict=True):
        os.dup2(each, number)
        os.close(each)
    if request["leads"]:
        os.setpgid(0, 0)
    os.chdir(request["folder"])
    if "MALLOC_PERTURB_" not in request["env"]:
        ctypes.CDLL(None).mallopt(M_PERTURB, 0)
    atexit.register(_keep, dict(sys.modules))
    ours = _paths()
    os.environ.clear()
    os.environ.update(request["env"])
    sys.argv = request["arguments"]
    sys.path[:] = [sys.argv[0], *_paths(), *sys.path[1 + len(ours) :]]
    runpy.run_path(sys.argv[0], run_name="__main__")


def _keep(modules: dict[str, Any]) -> None:
    """Exempt modules from the end of the interpreter, as it takes 40 ms to take them apart.

    Called after all other `atexit` functions. The modules of the program itself do end.
    """
    ctypes.pythonapi.Py_IncRef(ctypes.py_object(modules))
    for name in modules.keys() - {"__main__", "builtins", "sys"}:
        sys.modules.pop(name, None)


if __name__ == "__main__":
    for name in (*IMPORTED, *sys.argv[2:]):
        with contextlib.suppress(ModuleNotFoundError):  # an engine that is not installed
            __import__(name)
    for name in [name for name in sys.modules if name.partition(".")[0] == "drop_physics"]:
        del sys.modules[name]  # what runs loads them under a name of its own, or not at all
    gc.freeze()
    _serve(socket.socket(fileno=int(sys.argv[1])))()
