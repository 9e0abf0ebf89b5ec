"""Processes that call functions of ours: ask now, and take the answers when they are needed.

PyBullet and matplotlib hold Python's lock while they draw, so threads gain nothing. These are plain
subprocesses fed through their pipes: unlike `multiprocessing` they ask nothing of a caller's main
module, leave nothing behind in shared memory, and one whose parent is gone ends at once.
"""

from __future__ import annotations

import contextlib
import gc
import importlib
import os
import pickle
import queue
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any, Self

from pipeline.errors import DropError


def cores() -> int:
    """Return how many processors this process may use."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # only Linux knows
        return os.cpu_count() or 1


class Worker:
    """One process; use it in a `with` statement.

    It starts at once, and loads what the functions need when they are asked for. Questions are
    answered in their order. Take all answers before the next question that is large.

    Raises
    ------
    DropError
        If the process cannot be started.
    """

    def __init__(self) -> None:
        try:
            with _deaf_to_interrupts():
                self._process = subprocess.Popen(
                    [sys.executable, "-P", "-m", __name__],
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    # One thread each: there are as many of us as there are cores.
                    env={
                        **os.environ,
                        "PYTHONPATH": os.pathsep.join(module_path()),
                        "OPENBLAS_NUM_THREADS": "1",
                    },
                )
        except OSError as error:
            raise DropError(
                f"a process that helps cannot be started: {error.strerror}; see: ulimit -a"
            ) from None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the process; whoever waits for an answer in another thread is told that it died."""
        self._process.kill()  # it holds nothing that could be lost
        self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            assert pipe is not None
            with contextlib.suppress(BrokenPipeError):  # it was still to be told something
                pipe.close()

    def load(self, *modules: str) -> None:
        """Have modules imported beside the answers, so that a later one comes sooner."""
        self.ask("", *modules)  # no function, and so no answer

    def ask(self, function: str, *arguments: object) -> None:
        """Have a function called, `module:name`, whose module need not be loaded here.

        If it returns an iterator, each of its elements is an answer.

        Raises
        ------
        WorkerDiedError
            If the process died.
        """
        assert self._process.stdin is not None
        try:
            # Packed on their own: they are unpacked where the function's module has been imported.
            _send((function, pickle.dumps(arguments)), self._process.stdin)
        except BrokenPipeError:
            raise self._died() from None

    def answer(self) -> Any:  # noqa: ANN401
        """Return the next answer, or raise what the function raised.

        Raises
        ------
        WorkerDiedError
            If the process died.
        """
        assert self._process.stdout is not None
        if hasattr(signal, "siginterrupt"):
            # Polars has what waits go on waiting after Ctrl-C, once it is imported.
            signal.siginterrupt(signal.SIGINT, True)
        try:
            answer = pickle.load(self._process.stdout)
        except (EOFError, pickle.UnpicklingError):
            raise self._died() from None
        if isinstance(answer, Exception):
            raise answer
        return answer

    def _died(self) -> WorkerDiedError:
        code = self._process.wait()
        how = f"signal {-code}" if code < 0 else f"code {code}"
        return WorkerDiedError(how, -code)


class WorkerDiedError(DropError):
    """A process of ours is gone before it answered."""

    def __init__(self, how: str, signal: int) -> None:
        super().__init__(f"a process that draws died with {how}; run it again")
        self.how, self.signal = how, signal


def module_path() -> Iterator[str]:
    """Yield where modules are found here, but for the working directory.

    What lies there is data: a `random.py` among it is not to be run. Only where this package itself
    lies there, as in a checkout, is it a place of modules.
    """
    home = Path(__file__).parents[1]
    for place in map(Path, filter(None, sys.path)):
        with contextlib.suppress(OSError):  # a place that is not there holds no modules
            if not place.samefile(os.curdir) or place.samefile(home):
                yield str(place)


@contextlib.contextmanager
def _deaf_to_interrupts() -> Iterator[None]:
    """Let Ctrl-C, which a terminal sends to every process, not reach one that is started here."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _send(what: object, sink: IO[bytes]) -> None:
    pickle.dump(what, sink)
    sink.flush()


# -- in the process -------------------------------------------------------------------------------


def _work() -> None:
    """Answer what standard input asks, until it ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides
    gc.set_threshold(100_000)  # at 700, its default, it takes a fifth of the time of imports
    sink = os.fdopen(os.dup(1), "wb")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # what C prints is no answer
    questions: queue.SimpleQueue[tuple[str, bytes]] = queue.SimpleQueue()
    threading.Thread(target=_listen, args=(questions,), daemon=True).start()
    loading: list[threading.Thread] = []
    used: set[str] = set()
    while True:
        function, packed = questions.get()
        module, _, name = function.partition(":")
        if not module:
            loading.append(_load(pickle.loads(packed)))
            continue
        if module not in used:
            # It may import what is being loaded, and so may its arguments, which are unpacked
            # only then: of two threads that import the same, one can see it half made.
            while loading:
                loading.pop().join()
            used.add(module)
        try:
            arguments = pickle.loads(packed)
            answer = getattr(importlib.import_module(module), name)(*arguments)
            for one in answer if isinstance(answer, Iterator) else (answer,):
                _send(one, sink)
        except BrokenPipeError:
            os._exit(1)
        except Exception as error:  # noqa: BLE001 - raised by the parent
            _send(error, sink)


def _listen(questions: queue.SimpleQueue[tuple[str, bytes]]) -> None:
    """Hand on what is asked; whatever is being done ends with whoever asks, however that ends."""
    with contextlib.suppress(EOFError, pickle.UnpicklingError):
        while True:
            questions.put(pickle.load(sys.stdin.buffer))
    os._exit(1)


def _load(modules: tuple[str, ...]) -> threading.Thread:
    thread = threading.Thread(target=lambda: [*map(importlib.import_module, modules)], daemon=True)
    thread.start()
    return thread


if __name__ == "__main__":
    _work()
