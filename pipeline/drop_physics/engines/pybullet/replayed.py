"""Starts a process with the script's PyBullet that repeats recorded calls."""

from __future__ import annotations

import contextlib
import json
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from drop_physics.engines.channel import WATCHING
from drop_physics.errors import DropError
from drop_physics.trace.logs import LoggedCall
from drop_physics.workers import how_it_ended, users_environment

Float64 = NDArray[np.float64]
MODULE = "pybullet.replay.answering"
DATA = "import pybullet_data; print(pybullet_data.getDataPath())"
"""Python code that prints the folder of PyBullet's own models."""


class Replayer:
    """A process that repeats recorded calls; use it in a `with` statement.

    Parameters
    ----------
    python
        The process's interpreter.
    environment
        Environment variables of the process, in addition to the user's.
    folders
        Folders in which files are searched, the last folder first.

    Raises
    ------
    DropError
        While calls are repeated, if the process ended early.
    """

    def __init__(
        self, python: str, environment: Mapping[str, str], folders: Sequence[Path]
    ) -> None:
        self._python, self._folders = python, [*map(str, folders)]
        self._environment = {**users_environment(), **environment}
        self.jobs = 0
        """Number of replays."""

    def __enter__(self) -> Self:
        data = subprocess.run(
            [self._python, "-c", DATA],
            capture_output=True,
            text=True,
            env=self._environment,
            check=False,
        )
        self._folders += data.stdout.split("\n")[-2:-1]
        self._process = subprocess.Popen(
            [self._python, str(WATCHING), MODULE],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=self._environment,
            process_group=0,
        )
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None
    ) -> None:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        with contextlib.suppress(BrokenPipeError):
            self._process.stdin.close()
        self._process.stdout.close()
        self._process.kill()
        self._process.wait()

    def states(self, calls: Sequence[LoggedCall], steps: int) -> dict[int, Float64] | None:
        """Repeat calls; return the states of bodies after each step, by body id.

        A body's states have 13 numbers of the base, then position and velocity of each joint, shape
        (n, k); nan while the body does not exist. None if a call fails.
        """
        request = {
            "steps": steps,
            "folders": self._folders,
            "calls": [
                [call.step, call.function, dict(call.given), call.makes, call.raises]
                for call in calls
                if call.step < steps
            ],
        }
        self.jobs += 1
        stdin, stdout = self._process.stdin, self._process.stdout
        assert stdin is not None
        assert stdout is not None
        try:
            stdin.write(json.dumps(request, default=list).encode() + b"\n")
            stdin.flush()
            answer = json.loads(stdout.readline() or b"null")
        except (BrokenPipeError, ValueError):
            answer = None
        if answer is None:
            raise DropError(
                "{python} ended with {how} while it made the script's calls again",
                python=self._python,
                how=how_it_ended(self._process.wait()),
            )
        numbers = np.frombuffer(stdout.read(8 * answer["count"]), np.float64)
        return None if answer["error"] else _by_body(answer["rows"], numbers)


def _by_body(rows: list[list[tuple[int, int]]], numbers: Float64) -> dict[int, Float64]:
    found: dict[int, Float64] = {}
    at = 0
    for step, row in enumerate(rows):
        for body, width in row:
            if body not in found or found[body].shape[1] < width:
                found[body] = np.full((len(rows), width), np.nan)
            found[body][step, :width] = numbers[at : at + width]
            at += width
    return found
