"""A process with the script's MuJoCo that replays recorded steps and explains them.

Each step starts from its own frame, so steps can be requested in any order; consecutive steps are
fastest.
"""

from __future__ import annotations

import contextlib
import subprocess
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from drop_physics.engines.channel import WATCHING
from drop_physics.engines.mujoco import frames
from drop_physics.engines.mujoco.explained import ReplayedPiece, Vocabulary, piece_of
from drop_physics.errors import DropError
from drop_physics.trace.frames import Frames, ModelEdit
from drop_physics.workers import SAFE, how_it_ended, users_environment

MODULE = "mujoco.explain.answering"
"""The module that the script's interpreter runs."""
Arrays = dict[str, NDArray[Any]]
Answer = tuple[dict[str, Any], Arrays]


@dataclass(frozen=True, eq=False)
class StepsWanted:
    """A request to replay steps of a simulation."""

    model: Path
    """The file of the simulation's compiled model."""
    frames: Frames
    begin: int
    """The first step, counted from the first of the frames."""
    end: int
    """Index after the last step."""
    edits: Sequence[ModelEdit] = ()
    """Model edits before the frames begin."""


class Stepper:
    """A process that replays steps; use it in a `with` statement.

    Parameters
    ----------
    python
        The process's interpreter.
    version
        The version of MuJoCo that recorded the frames, which the process must have, too. None
        accepts any version, for a step of one version from a state of another.
    environment
        Environment variables of the process, in addition to the user's.

    Raises
    ------
    DropError
        While steps are replayed and at the end of the block, if the process ended early.
    """

    module = MODULE
    """Module that the process runs."""
    group: int | None = None
    """0 if Ctrl-C must not reach the process."""

    def __init__(
        self, python: str, version: str | None, environment: Mapping[str, str] | None = None
    ) -> None:
        self._python, self._version = python, version
        self._environment = environment or {}
        self._known: dict[int, Vocabulary] = {}
        self._next: tuple[Path, int, int] | None = None
        """Model, simulation and step that follow directly, so that the process need not load a
        state."""

    def __enter__(self) -> Self:
        command = [self._python, str(WATCHING), self.module]
        pipe = subprocess.PIPE
        environment = {**users_environment(), **SAFE, **self._environment}
        try:
            self._process = subprocess.Popen(
                command, stdin=pipe, stdout=pipe, env=environment, process_group=self.group
            )
        except (OSError, ValueError) as error:
            raise DropError(
                "{python} cannot be started: {reason}; --python takes the path of a Python "
                "interpreter",
                python=self._python,
                reason=getattr(error, "strerror", None) or str(error),
            ) from None
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None
    ) -> None:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        if error is not None:
            self._process.kill()
        with contextlib.suppress(BrokenPipeError):
            self._process.stdin.close()
        self._process.stdout.close()
        self._process.wait()
        if error is None:
            self._check_ended()

    def explained(
        self, wanted: Iterable[StepsWanted]
    ) -> Iterator[tuple[StepsWanted, ReplayedPiece]]:
        """Replay steps; yield whether they agree with the recording, and their impulses."""
        before: list[tuple[StepsWanted, Answer]] = []
        for each in wanted:
            self._send_steps("steps", each)
            yield from ((its, self._piece(answer)) for its, answer in before)  # meanwhile
            before = [(each, answer) for answer in self._answers()]
        yield from ((its, self._piece(answer)) for its, answer in before)

    def states(self, wanted: StepsWanted) -> dict[str, NDArray[np.float64]]:
        """Replay steps from their recorded starts; return the states after them, (n, width) each.

        The states include MuJoCo's clock, as `clock_s`.
        """
        self._send_steps("states", wanted)
        ((_, arrays),) = self._answers()
        return arrays

    def constants(self, model: Path) -> Arrays:
        """Return the constants of a compiled model that the analysis needs, by MuJoCo's names."""
        self._send(frames.arrays_bytes("constants", {}, path=str(model)))
        ((_, arrays),) = self._answers()
        return arrays

    def _piece(self, answer: Answer) -> ReplayedPiece:
        said, arrays = answer
        return piece_of(said, arrays, self._known.setdefault(said["model"], Vocabulary()))

    # -- the process ------------------------------------------------------------------------------

    def _send_steps(self, what: str, wanted: StepsWanted) -> None:
        its = wanted.frames
        first = its.first + wanted.begin
        if self._next != (wanted.model, its.client, first):
            earlier = [*wanted.edits, *(edit for edit in its.edits if edit.step < wanted.begin)]
            arrays, listed = packed_edits(earlier)
            simulation = {"world": its.client, "path": str(wanted.model), "edits": listed}
            self._send(
                frames.arrays_bytes("simulation", arrays, version=self._version, **simulation)
            )
        self._send(request_of(what, wanted))
        self._next = wanted.model, its.client, its.first + wanted.end

    def _send(self, payload: bytes) -> None:
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(frames.LENGTH.pack(len(payload)) + payload)
            self._process.stdin.flush()
        except BrokenPipeError:
            self._process.wait()
            self._check_ended()
            raise

    def _answers(self) -> Iterator[Answer]:
        """Yield the process's answers to a request."""
        out = self._process.stdout
        assert out is not None
        while len(head := out.read(frames.LENGTH.size)) == frames.LENGTH.size:
            said, arrays = frames.arrays_of(out.read(*frames.LENGTH.unpack(head)))
            if said["what"] == "taken":
                return
            yield said, arrays
        self._process.wait()
        self._check_ended()
        raise DropError("{python} ended while it took steps again", python=self._python)

    def _check_ended(self) -> None:
        if self._process.returncode:
            raise DropError(
                "{python} ended with {how} while it replayed the script's steps; --no-explain "
                "records without that",
                python=self._python,
                how=how_it_ended(self._process.returncode),
            )


def request_of(what: str, wanted: StepsWanted, more: Mapping[str, NDArray[Any]] = {}) -> bytes:
    """Encode a request for steps, as `explain.asked` decodes it; `more` are further arrays."""
    its = wanted.frames
    arrays: Arrays = {"functions": its.functions, "clock_s": its.clock_s}
    arrays |= {f"after/{name}": rows for name, rows in its.after.items()}
    groups: dict[str, Any] = {"before": its.before, "inputs": its.inputs, "posed": its.posed}
    for group, columns in groups.items():
        for name, column in columns.items():
            arrays[f"{group}/{name}"], arrays[f"{group}@{name}"] = column.rows, column.at
    answers = b"".join(payload for _, payload in its.answers)
    arrays["answers"] = np.frombuffer(answers, np.uint8)
    changed, edits = packed_edits(its.edits)
    return frames.arrays_bytes(
        what,
        {**arrays, **changed, **more},
        first=its.first,
        begin=wanted.begin,
        end=wanted.end,
        edits=edits,
        answers=[[step, len(payload)] for step, payload in its.answers],
    )


def packed_edits(edits: Sequence[ModelEdit]) -> tuple[Arrays, list[list[Any]]]:
    """Return the elements of model edits as arrays, and step, field and count of each edit."""
    none = np.empty(0)
    arrays = {
        "edits@indices": np.concatenate([none.astype(np.int64), *(e.indices for e in edits)]),
        "edits": np.concatenate([none, *(e.values for e in edits)]),
    }
    return arrays, [[edit.step, edit.name, len(edit.values)] for edit in edits]
