"""Processes that call functions of ours: ask now, and take the answers when they are needed.

PyBullet and matplotlib hold Python's lock while they draw, so threads gain nothing. These are plain
subprocesses fed through their pipes: unlike `multiprocessing` they ask nothing of a caller's main
module, and one whose parent is gone reads the end of its input and ends.
"""

from __future__ import annotations

import contextlib
import gc
import importlib
import os
import pickle
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from typing import IO, Any, Self

from pipeline.errors import DropError


class Worker:
    """One process; use it in a `with` statement.

    It starts at once, and loads what the functions need when they are asked for. Questions are
    answered in their order. Take all answers before the next question that is large.
    """

    def __init__(self) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", __name__],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            # One thread each: there are as many of us as there are cores.
            env={
                **os.environ,
                "PYTHONPATH": os.pathsep.join(filter(None, sys.path)),
                "OPENBLAS_NUM_THREADS": "1",
            },
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()  # it holds nothing that could be lost
        self._process.communicate()

    def load(self, *modules: str) -> None:
        """Have modules imported beside the answers, so that a later one comes sooner."""
        self.ask("", *modules)  # no function, and so no answer

    def ask(self, function: str, *arguments: object) -> None:
        """Have a function called, `module:name`, whose module need not be loaded here.

        If it returns an iterator, each of its elements is an answer.

        Raises
        ------
        DropError
            If the process died.
        """
        assert self._process.stdin is not None
        try:
            _send(function, self._process.stdin)
            _send(arguments, self._process.stdin)
        except BrokenPipeError:
            raise self._died() from None

    def answer(self) -> Any:  # noqa: ANN401
        """Return the next answer, or raise what the function raised.

        Raises
        ------
        DropError
            If the process died.
        """
        assert self._process.stdout is not None
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


def _load(modules: tuple[str, ...]) -> threading.Thread:
    thread = threading.Thread(target=lambda: [*map(importlib.import_module, modules)], daemon=True)
    thread.start()
    return thread


def _send(what: object, sink: IO[bytes]) -> None:
    pickle.dump(what, sink)
    sink.flush()


def _work() -> None:
    """Answer what standard input asks, until it ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides
    gc.disable()  # a fifth of the time that imports take, and we make no cycles to speak of
    source, sink = sys.stdin.buffer, os.fdopen(os.dup(1), "wb")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # what C prints is no answer
    loading: list[threading.Thread] = []
    used: set[str] = set()
    with contextlib.suppress(EOFError, BrokenPipeError):
        while True:
            module, _, name = pickle.load(source).partition(":")
            if not module:
                loading.append(_load(pickle.load(source)))
                continue
            if module not in used:
                # It may import what is being loaded, and so may its arguments, which are read
                # only then: of two threads that import the same, one can see it half made.
                while loading:
                    loading.pop().join()
                used.add(module)
            arguments = pickle.load(source)
            try:
                answer = getattr(importlib.import_module(module), name)(*arguments)
                for one in answer if isinstance(answer, Iterator) else (answer,):
                    _send(one, sink)
            except BrokenPipeError:
                raise
            except Exception as error:  # noqa: BLE001 - raised by the parent
                _send(error, sink)


if __name__ == "__main__":
    _work()
