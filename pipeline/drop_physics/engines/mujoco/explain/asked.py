"""Decodes a request to replay steps, as `stepping` sends it."""

from __future__ import annotations

import struct
from typing import Any, NamedTuple

import numpy as np

from .. import frames
from ..frames import CALLBACKS, CLOCK
from ..memory import StateMemory

Rows = dict[str, Any]
"""One row of each part, by name."""
Answer = tuple[int, Any]
"""Index of a callback, and its return value or the parts that it wrote."""


class Edit(NamedTuple):
    """Model elements that the script changed during its run."""

    step: int
    """The first step that uses the new values."""
    name: str
    indices: Any
    values: Any


class StepsAsked:
    """The start states and inputs of requested steps, counted from the first of their chunk.

    Parameters
    ----------
    arrays
        The columns of the chunk, as `GROUP/NAME`; for a column with values in some steps only,
        these steps as `GROUP@NAME`.
    first
        The number of the chunk's first step in the simulation.
    begin, end
        The steps to take: from `begin` to before `end`.
    edits
        Step, field and count of each edit.
    answers
        The step of each callback message, and the message's bytes.
    """

    def __init__(
        self,
        arrays: dict[str, Any],
        *,
        first: int,
        begin: int,
        end: int,
        edits: list[Any],
        answers: list[tuple[int, int]],
    ) -> None:
        self.first, self.begin, self.end = first, begin, end
        self.functions, self.clock_s = arrays["functions"], arrays["clock_s"]
        self._after = _group(arrays, "after")
        self._before = {name: _by_step(arrays, "before", name) for name in _group(arrays, "before")}
        self._posed = {name: _by_step(arrays, "posed", name) for name in _group(arrays, "posed")}
        inputs = _group(arrays, "inputs")
        self._inputs = [(name, arrays[f"inputs@{name}"], rows) for name, rows in inputs.items()]
        self._changed = {name: _by_step(arrays, "inputs", name) for name in inputs}
        self.edits: dict[int, list[Edit]] = {}
        for edit in edits_of(arrays, edits):
            self.edits.setdefault(edit.step, []).append(edit)
        self._answers, done = {}, 0
        for step, size in answers:
            self._answers[step] = arrays["answers"][done : done + size].tobytes()
            done += size

    def left(self, step: int) -> Rows:
        """Return the state that the previous step left, with the time; for step 0, its start."""
        if not step:
            return {name: rows[0] for name, rows in self._before.items()}
        left = {name: rows[step - 1] for name, rows in self._after.items()}
        return {**left, CLOCK: self.clock_s[step - 1 : step]}

    def written(self, step: int) -> Rows:
        """Return the state arrays that the script wrote before a step; empty without writes."""
        if step not in self._before[CLOCK]:
            return {}
        return {name: rows[step] for name, rows in self._before.items()}

    def given(self, step: int) -> Rows:
        """Return the inputs of a step, such as `ctrl`."""
        return {
            name: rows[np.searchsorted(at, step, side="right") - 1]
            for name, at, rows in self._inputs
        }

    def changed(self, step: int) -> Rows:
        """Return the inputs that differ from those of the previous step."""
        return {name: rows[step] for name, rows in self._changed.items() if step in rows}

    def posed(self, step: int) -> Rows:
        """Return the older state from which a step's derived positions were computed, if any."""
        return {name: rows[step] for name, rows in self._posed.items() if step in rows}

    def reached(self, name: str, step: int) -> Any:
        """Return a state array, such as `qpos`, after a step."""
        return self._after[name][step]

    def cores(self, core: StateMemory) -> Any:
        """Return `qpos`, `qvel` … after each step as they lie in memory, shape (n, bytes)."""
        whole = np.zeros((len(self.clock_s), core.size), np.uint8)
        for part in core.parts:
            rows = np.ascontiguousarray(self._after[part.name])
            whole[:, part.begin : part.end] = rows.view(np.uint8)
        return whole

    def answers(self, step: int, nv: int) -> list[Answer]:
        """Return what callbacks returned or wrote in a step; `nv` is the number of dofs."""
        payload = self._answers.get(step)
        return [] if payload is None else answers_in(payload, nv)


def edits_of(arrays: dict[str, Any], edits: list[Any]) -> list[Edit]:
    """Unpack model edits from step, name and count of each, and their elements as arrays."""
    made, done = [], 0
    for step, name, count in edits:
        its = slice(done, done + count)
        made.append(Edit(step, name, arrays["edits@indices"][its], arrays["edits"][its]))
        done += count
    return made


def _group(arrays: dict[str, Any], group: str) -> Rows:
    return {
        name.partition("/")[2]: rows
        for name, rows in arrays.items()
        if name.startswith(f"{group}/")
    }


def _by_step(arrays: dict[str, Any], group: str, name: str) -> dict[int, Any]:
    return dict(zip(arrays[f"{group}@{name}"].tolist(), arrays[f"{group}/{name}"]))


def answers_in(payload: bytes, nv: int) -> list[Answer]:
    """Unpack what callbacks returned or wrote from a `frames.CALLBACK` message."""
    *_, count = frames.CALLBACK_HEAD.unpack_from(payload)
    at, found = frames.CALLBACK_HEAD.size, list[Answer]()
    for _ in range(count):
        which = payload[at]
        at += 1
        if CALLBACKS[which] not in ("control", "passive", "sensor"):
            found.append((which, struct.unpack_from("<d", payload, at)[0]))
            at += 8
            continue
        parts, many = [], payload[at]
        at += 1
        for _ in range(many):
            *part, at = frames.part_of(payload, at)
            parts.append(part)
        if CALLBACKS[which] == "passive":
            parts.append(["qfrc_passive", None, np.frombuffer(payload, np.float64, nv, at)])
            at += 8 * nv
        found.append((which, parts))
    return found
