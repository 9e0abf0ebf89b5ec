"""Interprets what a watched script's process sends: from frames to events.

The other end of `watching`; the stream is described in its `pipe`.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import PurePath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.engines.bullet.watching import pipe
from pipeline.errors import DropError
from pipeline.fields import counted
from pipeline.messages import Message
from pipeline.seen import (
    Appearance,
    At,
    Body,
    Call,
    Constraint,
    Dynamics,
    Event,
    Given,
    Image,
    Joint,
    Joints,
    Motor,
    Push,
    Put,
    Samples,
    Settings,
    Shape,
    Solver,
    counted_s,
)
from pipeline.states import BASE, CONTACT, STATE, Rows

Float64 = NDArray[np.float64]

PART = 13
"""Numbers of the state of a link: position, orientation, velocity, spin."""
POINT = 23
"""Numbers of a contact point: those of `CONTACT` but for the step, in their order."""
POINT_BYTES = 8 * POINT
BATCH = 1024
"""Samples that are yielded together."""
BATCH_BYTES = 1 << 21
"""Or this many bytes of them."""

KINDS = {
    2: "sphere", 3: "box", 4: "cylinder", 5: "mesh", 6: "plane", 7: "capsule", 9: "heightfield",
}  # fmt: skip
PLANES = ("plane.obj", "plane100.obj")
"""Meshes of pybullet_data that represent a plane: up to 200 m wide, white except for a texture."""
JOINT_KINDS = {0: "revolute", 1: "prismatic", 2: "spherical", 3: "planar", 4: "fixed"}
FIXED = 4
ENABLE_SLEEPING = 1 << 11
"""One of the flags that a body is loaded with: URDF_ENABLE_SLEEPING."""
RIGID = 1
"""A btRigidBody, of which `getDynamicsInfo` leaves some numbers uninitialised."""

REPORTED = (
    ("mass_kg", True), ("lateral_friction", True), ("inertia_kg_m2", True),
    ("inertial_position_m", False), ("inertial_orientation", False), ("restitution", False),
    ("rolling_friction", True), ("spinning_friction", True), ("contact_damping", False),
    ("contact_stiffness", False), ("kind", True), ("collision_margin_m", True),
)  # fmt: skip
"""What `getDynamicsInfo` returns, in order, and whether it is valid for a btRigidBody too."""


FRAMES = (pipe.NOTE, pipe.SAMPLE, pipe.CONTACTS, pipe.SET, pipe.IMAGE)


class StreamError(DropError):
    """A stream that our other half did not send."""


class Frames:
    """Splits a stream of bytes into frames; it may arrive in any pieces, and end anywhere."""

    def __init__(self) -> None:
        self._data = bytearray()
        self._begun = False
        self.broken = False
        """Whether somebody else has written into the stream: what follows cannot be read."""

    @property
    def is_cut(self) -> bool:
        """Whether the last frame is incomplete."""
        return bool(self._data)

    def feed(self, data: bytes) -> Iterator[tuple[bytes, bytes]]:
        """Yield kind and payload of each frame that is now complete.

        Raises
        ------
        StreamError
            If the stream does not begin like ours.
        """
        if self.broken:
            return
        self._data += data
        offset = 0
        if not self._begun:
            if len(self._data) < len(pipe.MAGIC):
                return
            if not self._data.startswith(pipe.MAGIC):
                raise StreamError("the script's process runs another version of drop")
            self._begun, offset = True, len(pipe.MAGIC)
        try:
            while len(self._data) - offset >= pipe.HEADER.size:
                kind, length = pipe.HEADER.unpack_from(self._data, offset)
                if kind not in FRAMES or length >= pipe.LONGEST:
                    self.broken = True
                    return
                end = offset + pipe.HEADER.size + length
                if len(self._data) < end:
                    return
                payload = bytes(memoryview(self._data)[offset + pipe.HEADER.size : end])
                offset = end
                yield kind, payload
                if self.broken:
                    return
        finally:
            del self._data[: None if self.broken else offset]


class _World:
    """One simulation, as far as it is known."""

    def __init__(self, client: int, step: int, time_s: float) -> None:
        self.client, self.step = client, step
        self.since_step, self.since_s, self.timestep_s = step, time_s, 0.0
        self.layout: list[_Known] = []
        self.ids: dict[int, _Known] = {}
        self.samples: list[bytes] = []
        self.contacts: list[tuple[int, bytes]] = []
        self.sampled = False
        self.timeless = False
        """Whether a timestep was not finite."""
        self.first = 0
        """Step of the first of these samples."""

    def time_s(self, step: int) -> float:
        return self.since_s + (step - self.since_step) * self.timestep_s


@dataclass
class _Known:
    """A body of the stream, and its body in the recording."""

    body: Body
    world: _World
    dynamics: list[Any]
    note: dict[str, Any]
    """What the stream reported when it was added, and its columns in a sample."""


class Decoder:
    """Interprets a stream of frames as events, in order.

    Samples are gathered: they are yielded when there are enough of them, or before something
    changes which bodies of their simulation move.
    """

    def __init__(self) -> None:
        self.calls = 0
        self.steps = 0
        self.python: dict[str, Any] = {}
        self.stopped = ""
        self.ended: dict[str, Any] | None = None
        self.faults: list[str] = []
        self.cut_off = False
        """Whether the script closed the pipe or wrote into it: the end is missing."""
        self.real_time = False
        self.unseeded: list[str] = []
        self._frames = Frames()
        self._worlds: dict[int, _World] = {}
        self._bodies: dict[int, _Known] = {}
        self._numbers: dict[object, int] = {}
        self._last_call: Call | None = None

    def feed(self, data: bytes) -> Iterator[Event]:
        """Yield the events in the next part of the stream."""
        for kind, payload in self._frames.feed(data):
            if kind == pipe.NOTE:
                try:
                    note = json.loads(payload)
                except ValueError:
                    self._frames.broken = True
                    break
                yield from getattr(self, f"_on_{note.pop('what')}")(**note)
            elif kind == pipe.IMAGE:
                yield from self._on_image(payload)
            else:
                number, step = pipe.HEAD.unpack_from(payload)
                yield from self._on_numbers(kind, number, step, payload[pipe.HEAD.size :])

    def rest(self) -> Iterator[Event]:
        """Yield what is gathered and not yet yielded; the stream is over."""
        for world in self._worlds.values():
            yield from self._gathered(world)
        yield from self._pending_call()
        if self._frames.broken:
            self._is_cut_off(Message("the script wrote into drop's pipe"))
        elif self._frames.is_cut:
            self._is_cut_off(Message("the rest is missing in drop's pipe"))

    def _is_cut_off(self, why: Message) -> None:
        self.cut_off = True
        self.faults.append(
            Message(
                "the recording ends after {samples}: {why}",
                samples=counted(self.steps, "sample"),
                why=why,
            )
        )

    # -- numbers ----------------------------------------------------------------------------------

    def _on_numbers(self, kind: bytes, number: int, step: int, payload: bytes) -> Iterator[Event]:
        if kind == pipe.SET:
            known = self._bodies[number]
            values = np.frombuffer(payload).reshape(1, -1)
            states, joints = _parts(known.body, np.array([step]), values)
            at = self._at(known.world, step)
            yield from self._pending_call()
            yield Put(at, known.body, states, _joints(known.body, states["step"][:1],
                np.array([at.time_s]), joints), known.world.sampled)  # fmt: skip
            return
        world = self._worlds[number]
        if kind == pipe.SAMPLE:
            gathered = len(world.samples)
            if gathered >= BATCH or gathered * len(payload) > BATCH_BYTES:
                yield from self._gathered(world)
            if not world.samples:
                world.first = step
            elif step != world.first + len(world.samples):
                raise StreamError("the script's process sent step {step} out of order", step=step)
            world.samples.append(payload)
            world.step, world.sampled = step, True
            self.steps += 1
        elif kind == pipe.CONTACTS:  # of the sample before
            world.contacts.append((step, payload))

    def _gathered(self, world: _World) -> Iterator[Event]:
        if world.samples:
            samples, contacts = world.samples, world.contacts
            world.samples, world.contacts = [], []
            yield from self._pending_call()
            yield self._samples(world, samples, world.first, contacts)

    def _samples(
        self, world: _World, samples: list[bytes], first: int, contacts: list[tuple[int, bytes]]
    ) -> Samples:
        steps = np.arange(first, first + len(samples), dtype=np.int64)
        times_s = world.since_s + (steps - world.since_step).astype(np.float64) * world.timestep_s
        values = np.frombuffer(b"".join(samples), np.float64).reshape(len(samples), -1)
        column, bases, joints = 0, {}, {}
        moving: list[Rows] = []
        for known in sorted(world.layout, key=lambda known: known.body.number):
            body = known.body
            column = known.note["column"]
            own = values[:, column : column + known.note["width"]]
            states, joint_values = _parts(body, steps, own)
            bases[body.number] = states
            which = states[np.isin(states["link"], body.moving)]
            moving.append(which.reshape(len(steps), len(body.moving)))
            if joint_values.shape[1]:
                joints[body.number] = _joints(body, steps, times_s, joint_values)
        states = np.hstack(moving).reshape(-1) if moving else np.empty(0, STATE)
        return Samples(
            world.client, steps, times_s, self.calls, states, self._contacts(world, contacts),
            bases, joints,
        )  # fmt: skip

    def _contacts(self, world: _World, contacts: list[tuple[int, bytes]]) -> Rows:
        counts = [len(payload) // POINT_BYTES for _, payload in contacts]
        values = np.frombuffer(b"".join(payload for _, payload in contacts)).reshape(-1, POINT)
        rows = np.empty(len(values), CONTACT)
        rows["step"] = np.repeat(np.array([step for step, _ in contacts], np.int64), counts)
        column = 0
        for name in (CONTACT.names or ())[1:]:
            shape = CONTACT[name].shape
            width = math.prod(shape)
            rows[name] = values[:, column : column + width].reshape(-1, *shape)
            column += width
        for name in ("body_a", "body_b"):
            ids, which = np.unique(rows[name], return_inverse=True)
            numbers = [
                world.ids[engine_id].body.number if engine_id in world.ids else engine_id
                for engine_id in ids.tolist()
            ]
            rows[name] = np.array(numbers, np.int64)[which]
        return rows

    # -- notes ------------------------------------------------------------------------------------

    def _on_python(self, **note: Any) -> Iterator[Event]:  # noqa: ANN401
        self.python.update(note)
        yield from ()

    def _on_pybullet(self, version: int, **_: object) -> Iterator[Event]:
        self.python["pybullet_api"] = version
        yield from ()

    def _on_world(
        self, world: int, client: int, first_step: int, first_time_s: float, **_: object
    ) -> Iterator[Event]:
        if not math.isfinite(first_time_s):
            times_s = [known.time_s(known.step) for known in self._worlds.values()]
            first_time_s = max(times_s, default=0.0)
        self._worlds[world] = _World(client, first_step, first_time_s)
        yield from ()

    def _on_solver(self, world: int, **early: Any) -> Iterator[Event]:  # noqa: ANN401
        its = self._worlds[world]
        yield from self._pending_call()
        yield Solver(self._at(its), its.client, **early)

    def _on_over(self, world: int, **_: object) -> Iterator[Event]:
        yield from self._gathered(self._worlds[world])

    def _on_engine(
        self, world: int, step: int, time_s: float, settings: dict[str, Any]
    ) -> Iterator[Event]:
        its = self._worlds[world]
        yield from self._gathered(its)
        its.step = step
        timestep_s = settings["fixedTimeStep"]
        if timestep_s != its.timestep_s:
            # A time that added up a non-finite timestep is useless.
            its.since_s = time_s if math.isfinite(time_s) else its.time_s(step)
            its.since_step, its.timestep_s = step, counted_s(timestep_s)
        if not math.isfinite(timestep_s) and not its.timeless:
            its.timeless = True
            self.faults.append(
                Message(
                    "from step {step} on the timestep is {timestep} s: such steps take no time",
                    step=step,
                    timestep=timestep_s,
                )
            )
        yield from self._pending_call()
        yield Settings(self._at(its, step), its.client, settings)

    def _on_body(self, world: int, body: int, dynamics: list[Any], **note: Any) -> Iterator[Event]:  # noqa: ANN401
        its = self._worlds[world]
        yield from self._gathered(its)
        known = _Known(self._described(its.client, dynamics, note), its, dynamics, note)
        self._bodies[body] = its.ids[note["id"]] = known
        at = self._at(its)
        yield from self._pending_call()
        yield Appearance(at, known.body, there=True, came=True, sampled=its.sampled)
        if not known.body.soft:
            yield Dynamics(at, known.body, _reported(dynamics))

    def _on_look(self, body: int, visual: list[Any]) -> Iterator[Event]:
        known = self._bodies[body]
        known.note["visual"] = visual
        known.body = replace(
            known.body, shapes=_shapes(visual, known.dynamics, known.note["inertial"])
        )
        yield from self._pending_call()
        yield Appearance(self._at(known.world), known.body, there=True)

    def _on_gone(self, body: int) -> Iterator[Event]:
        known = self._bodies.pop(body)
        yield from self._gathered(known.world)
        known.world.layout = [other for other in known.world.layout if other is not known]
        if known.world.ids.get(known.body.engine_id) is known:
            del known.world.ids[known.body.engine_id]
        yield from self._pending_call()
        yield Appearance(self._at(known.world), known.body, there=False)

    def _on_dynamics(self, body: int, dynamics: list[Any]) -> Iterator[Event]:
        known = self._bodies[body]
        yield from self._gathered(known.world)
        known.dynamics = dynamics
        moving = {*known.body.moving, *_moving(dynamics[0][0] != 0, known.note["joints"])}
        known.body = replace(
            known.body,
            moving=tuple(sorted(moving)),
            shapes=_shapes(known.note["visual"], dynamics, known.note["inertial"]),
        )
        yield from self._pending_call()
        yield Dynamics(self._at(known.world), known.body, _reported(dynamics))

    def _on_carried(self, body: int) -> Iterator[Event]:
        known = self._bodies[body]
        yield from self._gathered(known.world)
        known.body = replace(known.body, moving=_moving(True, known.note["joints"]))
        yield from self._pending_call()
        yield Appearance(self._at(known.world), known.body, there=True)

    def _on_given(self, body: int, step: int, values: dict[str, Any]) -> Iterator[Event]:
        known = self._bodies[body]
        yield from self._pending_call()
        yield Given(self._at(known.world, step), known.body, values)

    def _on_layout(self, world: int, bodies: list[int]) -> Iterator[Event]:
        its = self._worlds[world]
        yield from self._gathered(its)
        its.layout = [self._bodies[number] for number in bodies]
        column = 0
        for known in its.layout:
            joints = sum(map(sum, known.note["joint_widths"]))
            known.note["column"] = column
            known.note["width"] = PART * len(known.body.links) + joints
            column += known.note["width"]

    def _on_call(
        self, world: int, step: int, name: str, arguments: str, file: str, line: int
    ) -> Iterator[Event]:
        yield from self._pending_call()
        self.calls += 1
        its = self._worlds[world]
        at = self._at(its, step)
        self._last_call = Call(at, its.client, name, arguments, file, line)

    def _on_raised(self, error: str) -> Iterator[Event]:
        if self._last_call is not None:
            self._last_call = replace(self._last_call, raised=error)
        yield from self._pending_call()

    def _pending_call(self) -> Iterator[Event]:
        """Yield the last call: by now it is known whether it raised."""
        if self._last_call is not None:
            yield self._last_call
            self._last_call = None

    def _on_push(
        self, body: int, step: int, link: int, torque: bool, flags: int,
        vector: list[float] | None, position: list[float] | None,
    ) -> Iterator[Event]:  # fmt: skip
        known = self._bodies[body]
        yield from self._pending_call()
        if vector is not None:
            point = tuple(position) if position and not torque else (math.nan,) * 3
            yield Push(self._at(known.world, step), known.body, link, torque, tuple(vector), point,
                in_world_axes=flags == WORLD_FRAME)  # fmt: skip

    def _on_motor(
        self, body: int, step: int, joint: int, mode: int, force: float | None
    ) -> Iterator[Event]:
        known = self._bodies[body]
        yield from self._pending_call()
        yield Motor(self._at(known.world, step), known.body, joint, mode,
            math.nan if force is None else force)  # fmt: skip

    def _on_held(
        self, world: int, step: int, constraint: int | None, bodies: list[int]
    ) -> Iterator[Event]:
        its = self._worlds[world]
        yield from self._pending_call()
        numbers = tuple(self._bodies[body].body.number for body in bodies)
        if constraint is not None:
            yield Constraint(self._at(its, step), its.client, constraint, numbers, there=True)

    def _on_released(self, world: int, step: int, constraint: int | None) -> Iterator[Event]:
        its = self._worlds[world]
        yield from self._pending_call()
        if constraint is not None:
            yield Constraint(self._at(its, step), its.client, constraint, (), there=False)

    def _on_real_time(self, **_: object) -> Iterator[Event]:
        self.real_time = True
        yield from ()

    def _on_unseeded(self, called: str, file: str, line: int) -> Iterator[Event]:
        self.unseeded.append(f"{called} at {file}:{line}")
        yield from ()

    def _on_fault(self, world: int, step: int, error: str) -> Iterator[Event]:
        self.faults.append(
            Message(
                "from step {step} on the simulation could not be read: {error}",
                step=step,
                error=error,
            )
        )
        yield from self._gathered(self._worlds[world])

    def _on_stop(self, why: str) -> Iterator[Event]:
        self.stopped = why
        yield from ()

    def _on_end(self, **note: Any) -> Iterator[Event]:  # noqa: ANN401
        self.ended = note
        yield from ()

    def _on_cut(self) -> Iterator[Event]:
        self._is_cut_off(Message("the script closed drop's pipe"))
        yield from ()

    def _on_image(self, payload: bytes) -> Iterator[Event]:
        (length,) = pipe.IMAGE_HEAD.unpack_from(payload)
        start = pipe.IMAGE_HEAD.size + length
        note = json.loads(payload[pipe.IMAGE_HEAD.size : start])
        size = note["height"], note["width"], 4
        world = self._worlds[note["world"]]
        yield from self._pending_call()
        yield Image(
            self._at(world, note["step"]), world.client,
            f"{note['file']}:{note['line']} {note['width']}x{note['height']}",
            np.frombuffer(payload, np.uint8, offset=start).reshape(size),
            tuple(note["view"] or ()), tuple(note["projection"] or ()),
        )  # fmt: skip

    # -- bodies -----------------------------------------------------------------------------------

    def _at(self, world: _World, step: int | None = None) -> At:
        step = world.step if step is None else step
        return At(step, world.time_s(step), self.calls)

    def _described(self, client: int, dynamics: list[Any], note: dict[str, Any]) -> Body:
        joints = tuple(
            Joint(
                info[0], info[1], JOINT_KINDS.get(info[2], str(info[2])), info[16],
                (0, 0, 0) if info[2] == FIXED else next(widths), (info[8], info[9]),
            )
            for widths in [iter([tuple(counts) for counts in note["joint_widths"]])]
            for info in note["joints"]
        )  # fmt: skip
        shapes = _shapes(note["visual"], dynamics, note["inertial"])
        kinds = [shape.kind for shape in shapes[:1]]
        name = _name(note["file"], note["name"], *kinds, note["base"])
        links = (note["base"] or "base", *(info[12] for info in note["joints"]))
        # After a reset, the same id, name and make-up mean the same body.
        make_up = (client, note["id"], note["name"], links, joints, note["soft"],
            tuple((shape.link, shape.kind, shape.file) for shape in shapes))  # fmt: skip
        number = self._numbers.get(make_up)
        if number is None:
            taken = self._numbers.values()
            number = note["id"] if note["id"] not in taken else max(taken) + 1
            self._numbers[make_up] = number
        return Body(
            number, f"{number}_{name}", note["file"] or note["name"] or name, note["id"], client,
            links, joints, _moving(dynamics[0][0] != 0, note["joints"]), note["soft"], shapes,
            bool(note["flags"] & ENABLE_SLEEPING), note["hides_links"], tuple(note["bounds"]),
        )  # fmt: skip


WORLD_FRAME = 2
"""The flag of `applyExternalForce`."""


def _name(*candidates: str) -> str:
    """Return the first name that is not empty, as a part of an entity's path."""
    name = next(filter(None, candidates), "body").rpartition("/")[2].partition(".")[0]
    return re.sub(r"[^\w-]+", "_", name, flags=re.ASCII)[:40].strip("_") or "body"


def _parts(body: Body, steps: NDArray[np.int64], values: Float64) -> tuple[Rows, Float64]:
    """Return the states of all links at some steps, and the numbers of the joints after them."""
    links = len(body.links)
    parts = values[:, : PART * links].reshape(len(steps), links, PART)
    rows = np.empty((len(steps), links), STATE)
    rows["step"] = steps[:, None]
    rows["body"] = body.number
    rows["link"] = np.arange(BASE, links - 1)
    rows["position_m"] = parts[..., 0:3]
    rows["orientation"] = parts[..., 3:7]
    rows["velocity_m_s"] = parts[..., 7:10]
    rows["spin_rad_s"] = parts[..., 10:13]
    return rows.reshape(-1), values[:, PART * links :]


def _joints(body: Body, steps: NDArray[np.int64], times_s: Float64, values: Float64) -> Joints:
    widths = [width for joint in body.joints if any(joint.widths) for width in joint.widths]
    bounds = np.cumsum([0, *widths])
    columns: list[list[int]] = [[], [], []]
    for number, (first, last) in enumerate(pairwise(bounds)):
        columns[number % 3] += range(first, last)
    position, velocity, torque = (values[:, which] for which in columns)
    return Joints(steps, times_s, position, velocity, torque)


def _moving(base: bool, joints: Sequence[Any]) -> tuple[int, ...]:
    """Return the links that time can move: the base if it can, and what a joint moves."""
    moving = {BASE} if base else set()
    for info in joints:
        if info[2] != FIXED or info[16] in moving:
            moving.add(info[0])
    return tuple(sorted(moving))


def _reported(dynamics: Sequence[Any]) -> dict[str, Float64]:
    reported = {}
    for number, (name, of_rigid) in enumerate(REPORTED):
        values = np.array([link[number] for link in dynamics], dtype=np.float64)
        if dynamics[0][10] == RIGID and not of_rigid:
            values[:] = math.nan
        reported[name] = values
    return reported


def _shapes(
    visual: Sequence[Any], dynamics: Sequence[Any], of_rigid: Pose | None
) -> tuple[Shape, ...]:
    """Return shapes from `getVisualShapeData`, which places them in the link's frame.

    `of_rigid` is the inertial frame of a btRigidBody.
    """
    shapes = []
    for _, link, kind, size, file, position, orientation, rgba in visual:
        info = dynamics[link + 1] if link + 1 < len(dynamics) else dynamics[0]
        rigid = info[10] == RIGID
        known_frame = of_rigid or ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
        inertial = known_frame if rigid else (info[3], info[4])
        placed = _seen_from(inertial, (position, orientation))
        known = "plane" if PurePath(file).name in PLANES else KINDS.get(kind, str(kind))
        shapes.append(Shape(link, known, tuple(size), file, *placed,
            tuple(rgba)))  # fmt: skip
    return tuple(shapes)


Pose = tuple[Sequence[float], Sequence[float]]


def _seen_from(frame: Pose, pose: Pose) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return a pose in the axes of a frame, both given in the same axes."""
    x, y, z, w = frame[1]
    back = np.array([-x, -y, -z, w])
    offset = np.subtract(pose[0], frame[0])
    twice = 2 * np.cross(back[:3], offset)
    position = offset + back[3] * twice + np.cross(back[:3], twice)
    return tuple(position.tolist()), tuple(_product(back, np.array(pose[1])).tolist())


def _product(a: Float64, b: Float64) -> Float64:
    """Return the product of two quaternions x, y, z, w."""
    vector = a[3] * b[:3] + b[3] * a[:3] + np.cross(a[:3], b[:3])
    return np.append(vector, a[3] * b[3] - a[:3] @ b[:3])
