"""Worker processes that call functions of drop on request, and return the results later.

PyBullet and matplotlib hold Python's global lock while they draw, so threads would not be faster.
Workers are plain subprocesses that communicate through pipes: unlike those of `multiprocessing`,
they do not import the caller's main module, leave nothing in shared memory, and end as soon as
their parent does.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import importlib
import logging
import os
import pickle
import queue
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import IO, Any, Self

from drop_physics.errors import DropError
from drop_physics.loading import load_less
from drop_physics.messages import Message

SAFE = {"PYTHONSAFEPATH": "1", "MUJOCO_GL": "disable", "OPENBLAS_NUM_THREADS": "1"}
"""Environment variables of drop's own processes: libraries import nothing from the working
directory, MuJoCo does not load a window library from there, and numpy starts no threads, which
would spin while its small matrices leave them idle."""

LOUD = ("RUST_LOG", "MALLOC_CONF", "_RJEM_MALLOC_CONF", "POLARS_VERBOSE", "POLARS_PANIC_ON_ERR")
"""Variables, set for other programs, that would make drop's libraries print."""

LEAST_FILES = 64
"""Smallest acceptable limit of open files: twice as many as a sweep on four cores uses."""
FINISHES = "finishes"
"""Command-line argument of a worker that finishes queued requests after its parent has ended."""

ALARM, CPU_USED_UP = (getattr(signal, name, None) for name in ("SIGALRM", "SIGXCPU"))
"""Signals that end a process that takes too long; None on Windows."""

PR_SET_PDEATHSIG = 1
"""Value of the option's constant in Linux's `sys/prctl.h`."""

given: dict[str, str] = {}
"""The environment in which the command was started; empty if `drop` is imported as a library."""


_changed: dict[str, tuple[str | None, str | None]] = {}
"""Environment variables that drop's imports have changed in a user's process: old and new values.
"""


def note_changes(before: Mapping[str, str]) -> None:
    """Note environment variables that imports changed, as Polars does for its allocator."""
    for name in {name for name, _ in before.items() ^ os.environ.items()}:
        _changed[name] = before.get(name), os.environ.get(name)


def users_environment() -> dict[str, str]:
    """Return the environment for the user's programs, without variables that drop has set."""
    if given:
        return given
    theirs = dict(os.environ)
    for name, (before, then) in _changed.items():
        if theirs.get(name) == then:
            theirs.pop(name, None)
            theirs |= {} if before is None else {name: before}
    return theirs


def check_limits() -> None:
    """Check that enough files can be opened, since some libraries abort otherwise.

    Raises
    ------
    DropError
        If the limit of open files of this process is too low.
    """
    try:
        import resource
    except ImportError:  # Windows
        return
    files, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    if files != resource.RLIM_INFINITY and files < LEAST_FILES:
        raise DropError(
            "drop needs {least} open files, and {most} are allowed; raise that with: ulimit -n "
            "{least}",
            least=LEAST_FILES,
            most=files,
        )


def end_with_parent() -> None:
    """Have the system end this process when its parent process dies."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)


def silence() -> None:
    """Silence Matplotlib's warning that its config folder is missing; it uses a temporary one."""
    logging.getLogger("matplotlib").setLevel(logging.ERROR)


def our_environment() -> dict[str, str]:
    """Return the environment for drop's own processes: quiet, and importing only drop's modules."""
    ours = {name: value for name, value in os.environ.items() if name not in LOUD}
    return {**ours, **SAFE, "PYTHONPATH": os.pathsep.join(module_path())}


def cores() -> int:
    """Return the number of processors available to this process."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # only Linux knows
        return os.cpu_count() or 1


def under_load(seconds: float) -> float:
    """Scale a time limit by the machine's load."""
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else 0.0
    return seconds * max(1.0, load / cores())


class Worker:
    """A worker process; use it in a `with` statement.

    The process starts at once, and imports a function's module before the first call. Requests are
    answered in order. Read all answers before sending another large request.

    Parameters
    ----------
    finishes
        Whether the process completes pending requests even after it was closed or its parent has
        ended; otherwise it ends at once.
    pass_fds
        File descriptors that the process inherits, with the same numbers.

    Raises
    ------
    DropError
        If the process cannot be started.
    """

    def __init__(self, *, finishes: bool = False, pass_fds: Sequence[int] = ()) -> None:
        self._finishes, self._answered = finishes, True
        try:
            with _interrupts_blocked():
                self._process = subprocess.Popen(
                    [sys.executable, "-P", "-m", __name__, *[FINISHES] * finishes],
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    pass_fds=pass_fds,
                    env=our_environment(),
                )
        except OSError as error:
            raise DropError(
                "a worker process cannot be started: {reason}; see: ulimit -a",
                reason=error.strerror,
            ) from None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def idle(self) -> bool:
        """True if the process runs and has no pending result (for single-result functions)."""
        return self._answered and self._process.poll() is None

    def close(self) -> None:
        """End the process; a pending `answer` in another thread raises `WorkerDiedError`."""
        if not self._finishes:
            self._process.kill()  # it has nothing to lose
        for pipe in (self._process.stdin, self._process.stdout):
            assert pipe is not None
            with contextlib.suppress(BrokenPipeError):  # something was still buffered
                pipe.close()
        self._process.wait()

    def load(self, *modules: str) -> None:
        """Import modules in the background, so that later calls are faster."""
        self.ask("", *modules)  # no function, and so no answer

    def ask(self, function: str, *arguments: object) -> None:
        """Call a function, named `module:name`, in the process; it need not be imported here.

        If the function returns an iterator, each element is a result.

        Raises
        ------
        WorkerDiedError
            If the process died.
        """
        assert self._process.stdin is not None
        self._answered = self._answered and not function
        try:
            # Pickled separately: they are unpickled once the function's module is imported.
            _send((function, pickle.dumps(arguments)), self._process.stdin)
        except BrokenPipeError:
            raise self._died() from None

    def answer(self) -> Any:  # noqa: ANN401
        """Wait for the next result, and return it or raise the function's exception.

        Raises
        ------
        WorkerDiedError
            If the process died.
        """
        assert self._process.stdout is not None
        if hasattr(signal, "siginterrupt"):
            # Once Polars is imported, a blocking read would continue after Ctrl-C.
            signal.siginterrupt(signal.SIGINT, True)
        try:
            answer = pickle.load(self._process.stdout)
        except (EOFError, pickle.UnpicklingError):
            raise self._died() from None
        self._answered = True
        if isinstance(answer, Exception):
            raise answer
        return answer

    def _died(self) -> WorkerDiedError:
        return WorkerDiedError(self._process.wait())


class WorkerDiedError(DropError):
    """Raised when a worker process ends before it has returned a result."""

    def __init__(self, exit_code: int) -> None:
        self.signal = -exit_code
        self.how = how_it_ended(exit_code)
        super().__init__(Message("a worker process died with {how}; run it again", how=self.how))


def how_it_ended(exit_code: int) -> Message:
    """Describe a process's exit code in words; a negative code is a signal's number."""
    if -exit_code in (ALARM, CPU_USED_UP):
        return Message("signal {signal}, which ends what is too slow", signal=-exit_code)
    if exit_code < 0:
        return Message("signal {signal}", signal=-exit_code)
    return Message("exit code {code}", code=exit_code)


def module_path() -> list[str]:
    """Return the module search path, without the working directory.

    The working directory contains data: a file `random.py` in it must not be executed. It is kept
    only if this package itself is in it, as in a checkout. Other folders with modules, such as that
    of the tests under pytest, come last, so that a `random.py` in them does not replace Python's
    own.
    """
    home, library = Path(__file__).parents[1], Path(os.__file__).parent
    ranked = []
    for folder in map(Path, filter(None, sys.path)):
        with contextlib.suppress(OSError):  # a folder that does not exist holds no modules
            is_home = folder.samefile(home)
            if is_home or not folder.samefile(os.curdir):
                is_pythons = folder == library or folder.name == "lib-dynload"
                is_packages = folder.name.endswith("-packages")
                ranked.append((not is_pythons, not is_home, not is_packages, str(folder)))
    return [name for *_, name in sorted(ranked, key=lambda each: each[:3])]


@contextlib.contextmanager
def _interrupts_blocked() -> Iterator[None]:
    """Block Ctrl-C for the processes started within a `with` block."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _send(item: object, sink: IO[bytes]) -> None:
    pickle.dump(item, sink)
    sink.flush()


# -- in the process -------------------------------------------------------------------------------


def _work() -> None:
    """Execute the requests that arrive on standard input, until it is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides
    silence()
    load_less()
    gc.set_threshold(100_000)  # at 700, the default, it takes a fifth of the import time
    sink = os.fdopen(os.dup(1), "wb")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # what C prints is not an answer
    questions: queue.SimpleQueue[tuple[str, bytes] | None] = queue.SimpleQueue()
    threading.Thread(target=_listen, args=(questions,), daemon=True).start()
    loading: list[threading.Thread] = []
    used: set[str] = set()
    while question := questions.get():
        function, packed = question
        module, _, name = function.partition(":")
        if not module:
            loading.append(_load(pickle.loads(packed)))
            continue
        if module not in used:
            # It may import what is being loaded, and so may unpickling its arguments: of two
            # threads that import the same module, one can see it half initialised.
            while loading:
                loading.pop().join()
            used.add(module)
        try:
            arguments = pickle.loads(packed)
            answer = getattr(importlib.import_module(module), name)(*arguments)
            for item in answer if isinstance(answer, Iterator) else (answer,):
                _send(item, sink)
        except BrokenPipeError:
            os._exit(1)
        except Exception as error:  # noqa: BLE001 - raised by the parent
            _send(error, sink)


def _listen(questions: queue.SimpleQueue[tuple[str, bytes] | None]) -> None:
    """Queue incoming requests; if the parent process dies, end at once or after the queue."""
    with contextlib.suppress(EOFError, pickle.UnpicklingError):
        while True:
            questions.put(pickle.load(sys.stdin.buffer))
    if FINISHES not in sys.argv:
        os._exit(1)
    questions.put(None)


def _load(modules: tuple[str, ...]) -> threading.Thread:
    thread = threading.Thread(target=lambda: [*map(importlib.import_module, modules)], daemon=True)
    thread.start()
    return thread


if __name__ == "__main__":
    _work()
