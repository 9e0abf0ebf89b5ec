"""`watch`: record environments of gymnasium during training or evaluation."""

from __future__ import annotations

import atexit
import multiprocessing
import os
import re
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from drop_physics.errors import DropError, ScenarioError, check_suffix
from drop_physics.files.outputs import check_target
from drop_physics.stages.block import Block, record


def watch(env: Any, out: Path | str | None = None, *, force: bool = False) -> Any:  # noqa: ANN401
    """Record a gymnasium environment from its first reset until it is closed.

    An environment that is never closed is recorded until the program ends. A process has one
    recording at a time: further environments that are watched while it is open are included. A
    worker of `AsyncVectorEnv`, which is a process of its own, writes its own recording, with its
    number in the file's name: `run-0.rrd`.

    Parameters
    ----------
    env
        The environment, or a vector environment that is stepped in this process.
    out
        The recording to write; None to record nothing and return the environment itself.
    force
        Whether an existing recording may be replaced.

    Returns
    -------
    Any
        A wrapper around the environment, whose attribute `recorded` is the result after closing.

    Raises
    ------
    ScenarioError
        If the environments step in other processes.
    OutputError
        If the recording cannot be written.
    DropError
        If gymnasium is not installed.
    """
    if out is None:
        return env
    try:
        from gymnasium import Wrapper
        from gymnasium.vector import AsyncVectorEnv, VectorEnv, VectorWrapper
    except ModuleNotFoundError:
        raise DropError("watch needs gymnasium: pip install gymnasium") from None
    if isinstance(env.unwrapped, AsyncVectorEnv):
        raise ScenarioError(
            "watch must be in the workers of AsyncVectorEnv, which step in processes of their own: "
            "AsyncVectorEnv([lambda: drop_physics.watch(gymnasium.make(…), {out!r})] * n)",
            out=str(out),
        )
    path = _named_for_worker(Path(out))
    check_target(path, force=force)
    check_suffix("out", path, (".rrd",))
    base: Any = VectorWrapper if isinstance(env, VectorEnv) else Wrapper

    class Watched(base):  # type: ignore[misc]
        """An environment whose steps are recorded."""

        recorded = None
        recording: _Recording | None = None

        # A vector of environments makes one in its own process, too, only to ask for its spaces.
        def reset(self, **how: Any) -> Any:  # noqa: ANN401 - as its environment takes it
            if self.recording is None:
                self.recording = _Recording.of_process(path, force=force)
            return super().reset(**how)

        def close(self, **how: Any) -> None:  # noqa: ANN401 - likewise
            super().close(**how)
            if self.recording is not None:
                self.recorded, self.recording = self.recording.leave(), None

    return Watched(env)


class _Recording:
    """The recording of this process, which ends when its last watched environment is closed."""

    opened: _Recording | None = None

    def __init__(self, path: Path, *, force: bool) -> None:
        self._stack, self._process, self._watched = ExitStack(), os.getpid(), 0
        self._block: Block = self._stack.enter_context(
            record(path, keep_sleeping=True, force=force)
        )
        atexit.register(self.end)

    @classmethod
    def of_process(cls, path: Path, *, force: bool) -> _Recording:
        """Return this process's open recording, or begin one."""
        found = cls.opened
        if found is None or found._process != os.getpid():
            found = cls.opened = cls(path, force=force)
        found._watched += 1
        return found

    def leave(self) -> Any:  # noqa: ANN401 - a `Recorded`, or None while others are watched
        """Note that an environment was closed; after the last one, return the result."""
        self._watched -= 1
        if self._watched <= 0:
            self.end()
        return self._block.recorded

    def end(self) -> None:
        """End the recording, but only in the process that began it."""
        if self._process == os.getpid() and _Recording.opened is self:
            _Recording.opened = None
            atexit.unregister(self.end)
            self._stack.close()


def _named_for_worker(path: Path) -> Path:
    """Add the worker's number to a recording's file name, in a worker process."""
    if multiprocessing.parent_process() is None:
        return path
    number = re.search(r"\d+$", multiprocessing.current_process().name)
    return path.with_stem(f"{path.stem}-{number[0] if number else os.getpid()}")
