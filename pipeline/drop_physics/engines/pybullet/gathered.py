"""Collects decoded samples and calls of one PyBullet simulation, to record many at once."""

from __future__ import annotations

import math
from array import array
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from drop_physics.arrays import Float64, Int64
from drop_physics.engines.pybullet.watch.worlds import POINT
from drop_physics.engines.watching import pipe
from drop_physics.trace.events import At, Body, Calls, Put, Samples
from drop_physics.trace.states import CONTACT, Joints, Rows

BASE_WIDTH = 13
"""Numbers of a base's state: position, orientation, linear and angular velocity."""
BATCH, MOST_SAMPLES = 1 << 10, 1 << 13
"""Number of samples that are yielded together, at first and at most."""
BATCH_BYTES, MOST_BYTES = 1 << 21, 1 << 22
"""Bytes of samples that are yielded together, at first and at most."""
OF_ALL = 16
"""Size of later batches as a share of all samples so far: fewer, larger chunks, since Rerun keeps
an index of all chunks in memory."""
CALLS_TOGETHER = 1 << 14


@dataclass
class Known:
    """A body in the received stream, with the body of the recording that it became."""

    body: Body
    world: GatheredWorld
    dynamics: list[Any]
    visual: list[Any]
    joints: list[Any]
    inertial: Any
    """The body's description in the stream."""

    def __post_init__(self) -> None:
        widths = [joint.widths for joint in self.body.joints]
        self.widths = [sum(each) for each in zip(*widths, strict=True)] or [0, 0, 0]
        """Number of positions, velocities and efforts of each of the body's joints."""

    def joints_of(self, steps: Int64, times_s: Float64, values: Float64) -> Joints:
        """Split rows of joint numbers, one for each step, into a table of joint states."""
        return Joints(steps, times_s, *self._split(values))

    def put(self, at: At, values: Float64) -> Put:
        """Return the state that a script's calls gave the body."""
        position, velocity, effort = self._split(values[BASE_WIDTH:])
        base, sampled = values[:BASE_WIDTH], self.world.sampled
        return Put(at, self.body, base, position, velocity, effort, sampled)

    def _split(self, values: Float64) -> list[Float64]:
        """Split joint numbers into positions, velocities and efforts."""
        ends = np.cumsum(self.widths[:2])
        return [each.copy() for each in np.split(values, ends, axis=-1)]


def points_of(points: bytes | bytearray, steps: Int64) -> Rows:
    """Unpack contact points, and add the step of each."""
    values = np.frombuffer(points, np.float64).reshape(-1, POINT.size // 8)
    rows = np.empty(len(steps), CONTACT)
    rows["step"] = steps
    column = 0
    for name in (CONTACT.names or ())[1:]:  # those but for the step, in their order
        shape = CONTACT[name].shape
        width = math.prod(shape)
        rows[name] = values[:, column : column + width].reshape(-1, *shape)
        column += width
    return rows


class GatheredWorld:
    """One PyBullet simulation of a script, while its stream is decoded."""

    def __init__(self, client: int, step: int, time_s: float) -> None:
        self.client, self.step = client, step
        self.since_step, self.since_s, self.timestep_s = step, time_s, 0.0
        self.ids: dict[int, Known] = {}
        self.sampled = False
        self.timeless = False
        """Whether any timestep was not finite."""
        self._layout: list[tuple[Known, bool]] = []
        """The bodies in a sample, and whether the sample contains their bases."""
        self._constraints: list[tuple[int, int]] = []
        """Ids of constraints, and the number of each one's forces."""
        self._size = pipe.HEAD.size
        """Size of a sample without contact points [bytes]."""
        self._room, self._room_bytes = BATCH, BATCH_BYTES
        """Number of samples, and bytes, at which the collected samples are yielded."""
        self._all = self._all_bytes = 0
        """Number and size [bytes] of the samples yielded so far."""
        self._samples: list[bytes] = []
        self._first = self._call = self._bytes = 0
        """First step of the collected samples, number of calls before the last one, and their size
        [bytes]."""
        self._calls: list[bytes] = []
        """Payload of each call that is not yielded yet."""
        self._called_at, self._numbers = array("q"), array("q")
        """Step and number of these calls."""
        self._results: list[tuple[int, float]] = []
        """Index and return value of each collected call with a result."""

    def lay_out(self, layout: list[tuple[Known, bool]], constraints: list[tuple[int, int]]) -> None:
        """Set which bodies and constraints the following samples contain, in which order."""
        self._layout, self._constraints = layout, constraints
        numbers = sum(width for _, width in constraints)
        numbers += sum(sum(known.widths) + BASE_WIDTH * has_base for known, has_base in layout)
        self._size = pipe.HEAD.size + 8 * numbers

    def time_s(self, step: int) -> float:
        """Return the time of a step."""
        return self.since_s + (step - self.since_step) * self.timestep_s

    def times_s(self, steps: Int64) -> Float64:
        """Return the times of the given steps."""
        return self.since_s + (steps - self.since_step).astype(np.float64) * self.timestep_s

    @property
    def is_full(self) -> bool:
        """True if enough samples are collected to be recorded."""
        return (
            len(self._samples) >= self._room
            or self._bytes > self._room_bytes
            or len(self._calls) > CALLS_TOGETHER
        )

    def add_sample(self, step: int, payload: bytes, call: int) -> bool:
        """Add a sample; return whether it directly follows the previous one."""
        if not self._samples:
            self._first = step
        elif step != self._first + len(self._samples):
            return False
        self._samples.append(payload)
        self._bytes += len(payload)
        self._call, self.step, self.sampled = call, step, True
        return True

    def add_call(self, number: int, payload: bytes) -> None:
        """Add a call that the script made."""
        self._calls.append(payload)
        self._called_at.append(self.step)
        self._numbers.append(number)

    def add_result(self, result: float) -> None:
        """Add the return value of the last call."""
        if self._calls:
            self._results.append((len(self._calls) - 1, result))

    def gathered(self) -> Iterator[Calls | Samples]:
        """Yield the collected calls and samples, and remove them from the collection."""
        yield from self.called()
        if self._samples:
            yield self._sampled()

    def called(self) -> Iterator[Calls]:
        """Yield the collected calls, and remove them from the collection."""
        if not self._calls:
            return
        payloads, at_steps, numbers = (
            self._calls,
            np.array(self._called_at),
            np.array(self._numbers),
        )
        results = np.full(len(payloads), math.nan)
        for which, result in self._results:
            results[which] = result
        self._calls, self._results = [], []
        self._called_at, self._numbers = array("q"), array("q")
        held = np.frombuffer(b"".join(payloads), np.float64)
        sizes = np.fromiter(map(len, payloads), np.int64, len(payloads)) // 8
        heads = np.cumsum(sizes) - sizes  # a head takes as many bytes as a number
        sites = held[heads].view(np.uint32)[1::2].astype(np.int64)
        yield Calls(
            self.client,
            at_steps,
            self.times_s(at_steps),
            numbers,
            sites,
            np.delete(held, heads),
            results,
        )

    def _sampled(self) -> Samples:
        samples, size = self._samples, self._size
        self._all, self._all_bytes = self._all + len(samples), self._all_bytes + self._bytes
        self._room = max(BATCH, min(self._all // OF_ALL, MOST_SAMPLES))
        self._room_bytes = max(BATCH_BYTES, min(self._all_bytes // OF_ALL, MOST_BYTES))
        self._samples, self._bytes = [], 0
        steps = np.arange(self._first, self._first + len(samples), dtype=np.int64)
        times_s = self.times_s(steps)
        counts = [len(payload) - size for payload in samples]
        points = b""
        if any(counts):
            points = b"".join([payload[size:] for payload in samples])
            samples = [payload[:size] for payload in samples]
        values = np.frombuffer(b"".join(samples), np.float64).reshape(len(steps), -1)
        column, bases, joints = pipe.HEAD.size // 8, {}, {}
        for known, has_base in self._layout:
            if has_base:
                bases[known.body.number] = values[:, column : column + BASE_WIDTH].copy()
                column += BASE_WIDTH
            width = sum(known.widths)
            if width:
                its = values[:, column : column + width]
                joints[known.body.number] = known.joints_of(steps, times_s, its)
                column += width
        constraints = {}
        for constraint, width in self._constraints:
            constraints[constraint] = values[:, column : column + width].copy()
            column += width
        return Samples(
            self.client,
            steps,
            times_s,
            self._call,
            dict(sorted(bases.items())),
            dict(sorted(joints.items())),
            self._contacts(steps, counts, points),
            constraints,
        )

    def _contacts(self, steps: Int64, counts: list[int], points: bytes) -> Rows:
        rows = points_of(points, np.repeat(steps, np.array(counts, np.int64) // POINT.size))
        for name in ("body_a", "body_b"):
            ids, which = np.unique(rows[name], return_inverse=True)
            numbers = [
                self.ids[engine_id].body.number if engine_id in self.ids else engine_id
                for engine_id in ids.tolist()
            ]
            rows[name] = np.array(numbers, np.int64)[which]
        return rows
