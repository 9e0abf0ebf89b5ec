"""What a watched script's process sent, understood: from frames to what was seen.

The other end of `watching`; what it sends is described there in `pipe`.
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
"""Samples that are handed on together."""
BATCH_BYTES = 1 << 21
"""Or so many bytes of them."""

KINDS = {
    2: "sphere", 3: "box", 4: "cylinder", 5: "mesh", 6: "plane", 7: "capsule", 9: "heightfield",
}  # fmt: skip
PLANES = ("plane.obj", "plane100.obj")
"""Meshes of pybullet_data that stand for a plane: up to 200 m wide, white but for a texture."""
JOINT_KINDS = {0: "revolute", 1: "prismatic", 2: "spherical", 3: "planar", 4: "fixed"}
FIXED = 4
ENABLE_SLEEPING = 1 << 11
"""Of the flags that a body is loaded with: URDF_ENABLE_SLEEPING."""
RIGID = 1
"""A btRigidBody, of which `getDynamicsInfo` leaves some numbers as they lie in memory."""

REPORTED = (
    ("mass_kg", True), ("lateral_friction", True), ("inertia_kg_m2", True),
    ("inertial_position_m", False), ("inertial_orientation", False), ("restitution", False),
    ("rolling_friction", True), ("spinning_friction", True), ("contact_damping", False),
    ("contact_stiffness", False), ("kind", True), ("collision_margin_m", True),
)  # fmt: skip
"""What `getDynamicsInfo` returns, in order, and whether it does so of a btRigidBody too."""


class StreamError(DropError):
    """A stream that is not what our other half sends."""


class Frames:
    """Cuts a stream of bytes into frames; it may come in any pieces, and end anywhere."""

    def __init__(self) -> None:
        self._data = bytearray()
        self._begun = False

    def feed(self, data: bytes) -> Iterator[tuple[bytes, bytes]]:
        """Yield kind and payload of each frame that is complete now.

        Raises
        ------
        StreamError
            If the stream does not begin as ours do.
        """
        self._data += data
        at = 0
        if not self._begun:
            if len(self._data) < len(pipe.MAGIC):
                return
            if not self._data.startswith(pipe.MAGIC):
                raise StreamError("what the script's process sent is of another version of drop")
            self._begun, at = True, len(pipe.MAGIC)
        try:
            while len(self._data) - at >= pipe.HEADER.size:
                kind, length = pipe.HEADER.unpack_from(self._data, at)
                end = at + pipe.HEADER.size + length
                if len(self._data) < end:
                    return
                payload = bytes(memoryview(self._data)[at + pipe.HEADER.size : end])
                at = end
                yield kind, payload
        finally:
            del self._data[:at]


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
    """A body of the stream, and what it is in the recording."""

    body: Body
    world: _World
    dynamics: list[Any]
    told: dict[str, Any]


class Decoder:
    """Understands a stream of frames, and says what was seen, in order.

    Samples are gathered: they are handed on when there are enough of them, or when something else
    happens to their simulation that changes which bodies move.
    """

    def __init__(self) -> None:
        self.calls = 0
        self.steps = 0
        self.python: dict[str, Any] = {}
        self.stopped = ""
        self.ended: dict[str, Any] | None = None
        self.faults: list[str] = []
        self.real_time = False
        self.unseeded: list[str] = []
        self._frames = Frames()
        self._worlds: dict[int, _World] = {}
        self._bodies: dict[int, _Known] = {}
        self._numbers: dict[object, int] = {}
        self._last_call: Call | None = None

    def feed(self, data: bytes) -> Iterator[Event]:
        """Yield what was seen according to more of the stream."""
        for kind, payload in self._frames.feed(data):
            if kind == pipe.NOTE:
                note = json.loads(payload)
                yield from getattr(self, f"_on_{note.pop('what')}")(**note)
            elif kind == pipe.IMAGE:
                yield from self._on_image(payload)
            else:
                number, step = pipe.HEAD.unpack_from(payload)
                yield from self._on_numbers(kind, number, step, payload[pipe.HEAD.size :])

    def rest(self) -> Iterator[Event]:
        """Yield what has been gathered and not handed on; the stream is over."""
        for world in self._worlds.values():
            yield from self._gathered(world)
        yield from self._tell_call()

    # -- numbers ----------------------------------------------------------------------------------

    def _on_numbers(self, kind: bytes, number: int, step: int, payload: bytes) -> Iterator[Event]:
        if kind == pipe.SET:
            known = self._bodies[number]
            values = np.frombuffer(payload).reshape(1, -1)
            states, joints = _parts(known.body, np.array([step]), values)
            at = self._at(known.world, step)
            yield from self._tell_call()
            yield Put(at, known.body, states, _joints(known.body, states["step"][:1],
                np.array([at.time_s]), joints), known.world.sampled)  # fmt: skip
            return
        world = self._worlds[number]
        if kind == pipe.SAMPLE:
            held = len(world.samples)
            if held >= BATCH or held * len(payload) > BATCH_BYTES:
                yield from self._gathered(world)
            if not world.samples:
                world.first = step
            elif step != world.first + len(world.samples):
                raise StreamError(f"the script's process sent step {step} out of order")
            world.samples.append(payload)
            world.step, world.sampled = step, True
            self.steps += 1
        elif kind == pipe.CONTACTS:  # of the sample before
            world.contacts.append((step, payload))

    def _gathered(self, world: _World) -> Iterator[Event]:
        if world.samples:
            samples, contacts = world.samples, world.contacts
            world.samples, world.contacts = [], []
            yield from self._tell_call()
            yield self._samples(world, samples, world.first, contacts)

    def _samples(
        self, world: _World, samples: list[bytes], first: int, contacts: list[tuple[int, bytes]]
    ) -> Samples:
        steps = np.arange(first, first + len(samples), dtype=np.int64)
        times_s = world.since_s + (steps - world.since_step).astype(np.float64) * world.timestep_s
        values = np.frombuffer(b"".join(samples), np.float64).reshape(len(samples), -1)
        column, bases, joints = 0, {}, {}
        moving: list[Rows] = []
        for known in sorted(world.layout, key=lambda one: one.body.number):
            body = known.body
            column = known.told["column"]
            theirs = values[:, column : column + known.told["width"]]
            states, of_joints = _parts(body, steps, theirs)
            bases[body.number] = states
            which = states[np.isin(states["link"], body.moving)]
            moving.append(which.reshape(len(steps), len(body.moving)))
            if of_joints.shape[1]:
                joints[body.number] = _joints(body, steps, times_s, of_joints)
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

    def _on_python(self, **told: Any) -> Iterator[Event]:  # noqa: ANN401
        self.python.update(told)
        yield from ()

    def _on_pybullet(self, version: int, **_: object) -> Iterator[Event]:
        self.python["pybullet_api"] = version
        yield from ()

    def _on_world(
        self, world: int, client: int, first_step: int, first_time_s: float, **_: object
    ) -> Iterator[Event]:
        if not math.isfinite(first_time_s):
            first_time_s = max((one.time_s(one.step) for one in self._worlds.values()), default=0.0)
        self._worlds[world] = _World(client, first_step, first_time_s)
        yield from ()

    def _on_solver(self, world: int, **early: Any) -> Iterator[Event]:  # noqa: ANN401
        its = self._worlds[world]
        yield from self._tell_call()
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
            # What has added up a timestep that is no number tells no time any more.
            its.since_s = time_s if math.isfinite(time_s) else its.time_s(step)
            its.since_step, its.timestep_s = step, counted_s(timestep_s)
        if not math.isfinite(timestep_s) and not its.timeless:
            its.timeless = True
            self.faults.append(
                f"from step {step} on its timestep is {timestep_s} s: such a step counts as no time"
            )
        yield from self._tell_call()
        yield Settings(self._at(its, step), its.client, settings)

    def _on_body(self, world: int, body: int, dynamics: list[Any], **told: Any) -> Iterator[Event]:  # noqa: ANN401
        its = self._worlds[world]
        yield from self._gathered(its)
        known = _Known(self._described(its.client, dynamics, told), its, dynamics, told)
        self._bodies[body] = its.ids[told["id"]] = known
        at = self._at(its)
        yield from self._tell_call()
        yield Appearance(at, known.body, there=True, came=True, sampled=its.sampled)
        if not known.body.soft:
            yield Dynamics(at, known.body, _reported(dynamics))

    def _on_look(self, body: int, visual: list[Any]) -> Iterator[Event]:
        known = self._bodies[body]
        known.told["visual"] = visual
        known.body = replace(known.body, shapes=_shapes(visual, known.dynamics))
        yield from self._tell_call()
        yield Appearance(self._at(known.world), known.body, there=True)

    def _on_gone(self, body: int) -> Iterator[Event]:
        known = self._bodies.pop(body)
        yield from self._gathered(known.world)
        known.world.layout = [one for one in known.world.layout if one is not known]
        if known.world.ids.get(known.body.engine_id) is known:
            del known.world.ids[known.body.engine_id]
        yield from self._tell_call()
        yield Appearance(self._at(known.world), known.body, there=False)

    def _on_dynamics(self, body: int, dynamics: list[Any]) -> Iterator[Event]:
        known = self._bodies[body]
        yield from self._gathered(known.world)
        known.dynamics = dynamics
        moving = {*known.body.moving, *_moving(dynamics, known.told["joints"])}
        known.body = replace(
            known.body, moving=tuple(sorted(moving)), shapes=_shapes(known.told["visual"], dynamics)
        )
        yield from self._tell_call()
        yield Dynamics(self._at(known.world), known.body, _reported(dynamics))

    def _on_given(self, body: int, step: int, values: dict[str, Any]) -> Iterator[Event]:
        known = self._bodies[body]
        yield from self._tell_call()
        yield Given(self._at(known.world, step), known.body, values)

    def _on_layout(self, world: int, bodies: list[int]) -> Iterator[Event]:
        its = self._worlds[world]
        yield from self._gathered(its)
        its.layout = [self._bodies[one] for one in bodies]
        column = 0
        for known in its.layout:
            joints = sum(map(sum, known.told["joint_widths"]))
            known.told["column"] = column
            known.told["width"] = PART * len(known.body.links) + joints
            column += known.told["width"]

    def _on_call(
        self, world: int, step: int, name: str, arguments: str, file: str, line: int
    ) -> Iterator[Event]:
        yield from self._tell_call()
        self.calls += 1
        its = self._worlds[world]
        at = self._at(its, step)
        self._last_call = Call(at, its.client, name, arguments, file, line)

    def _on_raised(self, error: str) -> Iterator[Event]:
        if self._last_call is not None:
            self._last_call = replace(self._last_call, raised=error)
        yield from self._tell_call()

    def _tell_call(self) -> Iterator[Event]:
        """Yield the last call, of which it is known by now whether it raised something."""
        if self._last_call is not None:
            yield self._last_call
            self._last_call = None

    def _on_push(
        self, body: int, step: int, link: int, torque: bool, flags: int,
        vector: list[float] | None, position: list[float] | None,
    ) -> Iterator[Event]:  # fmt: skip
        known = self._bodies[body]
        yield from self._tell_call()
        if vector is not None:
            where = tuple(position) if position and not torque else (math.nan,) * 3
            yield Push(self._at(known.world, step), known.body, link, torque, tuple(vector), where,
                in_world_axes=flags == WORLD_FRAME)  # fmt: skip

    def _on_motor(
        self, body: int, step: int, joint: int, mode: int, force: float | None
    ) -> Iterator[Event]:
        known = self._bodies[body]
        yield from self._tell_call()
        yield Motor(self._at(known.world, step), known.body, joint, mode,
            math.nan if force is None else force)  # fmt: skip

    def _on_held(
        self, world: int, step: int, constraint: int | None, bodies: list[int]
    ) -> Iterator[Event]:
        its = self._worlds[world]
        yield from self._tell_call()
        numbers = tuple(self._bodies[one].body.number for one in bodies)
        if constraint is not None:
            yield Constraint(self._at(its, step), its.client, constraint, numbers, there=True)

    def _on_released(self, world: int, step: int, constraint: int | None) -> Iterator[Event]:
        its = self._worlds[world]
        yield from self._tell_call()
        if constraint is not None:
            yield Constraint(self._at(its, step), its.client, constraint, (), there=False)

    def _on_real_time(self, **_: object) -> Iterator[Event]:
        self.real_time = True
        yield from ()

    def _on_unseeded(self, called: str, file: str, line: int) -> Iterator[Event]:
        self.unseeded.append(f"{called} at {file}:{line}")
        yield from ()

    def _on_fault(self, world: int, step: int, error: str) -> Iterator[Event]:
        self.faults.append(f"from step {step} on its simulation could not be read: {error}")
        yield from self._gathered(self._worlds[world])

    def _on_stop(self, why: str) -> Iterator[Event]:
        self.stopped = why
        yield from ()

    def _on_end(self, **told: Any) -> Iterator[Event]:  # noqa: ANN401
        self.ended = told
        yield from ()

    def _on_image(self, payload: bytes) -> Iterator[Event]:
        (length,) = pipe.IMAGE_HEAD.unpack_from(payload)
        start = pipe.IMAGE_HEAD.size + length
        told = json.loads(payload[pipe.IMAGE_HEAD.size : start])
        size = told["height"], told["width"], 4
        world = self._worlds[told["world"]]
        yield from self._tell_call()
        yield Image(
            self._at(world, told["step"]), world.client,
            f"{told['file']}:{told['line']} {told['width']}x{told['height']}",
            np.frombuffer(payload, np.uint8, offset=start).reshape(size),
            tuple(told["view"] or ()), tuple(told["projection"] or ()),
        )  # fmt: skip

    # -- bodies -----------------------------------------------------------------------------------

    def _at(self, world: _World, step: int | None = None) -> At:
        step = world.step if step is None else step
        return At(step, world.time_s(step), self.calls)

    def _described(self, client: int, dynamics: list[Any], told: dict[str, Any]) -> Body:
        joints = tuple(
            Joint(
                info[0], info[1], JOINT_KINDS.get(info[2], str(info[2])), info[16],
                (0, 0, 0) if info[2] == FIXED else next(widths), (info[8], info[9]),
            )
            for widths in [iter([tuple(one) for one in told["joint_widths"]])]
            for info in told["joints"]
        )  # fmt: skip
        shapes = _shapes(told["visual"], dynamics)
        name = _name(told["file"], told["name"], *(one.kind for one in shapes[:1]), told["base"])
        links = (told["base"] or "base", *(info[12] for info in told["joints"]))
        # What has the same id, name and make-up after a reset is the same body again.
        make_up = (client, told["id"], told["name"], links, joints, told["soft"],
            tuple((one.link, one.kind, one.file) for one in shapes))  # fmt: skip
        number = self._numbers.get(make_up)
        if number is None:
            taken = self._numbers.values()
            number = told["id"] if told["id"] not in taken else max(taken) + 1
            self._numbers[make_up] = number
        return Body(
            number, f"{number}_{name}", told["file"] or told["name"] or name, told["id"], client,
            links, joints, _moving(dynamics, told["joints"]), told["soft"], shapes,
            bool(told["flags"] & ENABLE_SLEEPING), told["hides_links"], tuple(told["bounds"]),
        )  # fmt: skip


WORLD_FRAME = 2
"""Of `applyExternalForce`."""


def _name(*told: str) -> str:
    """Return the first name that there is as a part of an entity's path."""
    name = next(filter(None, told), "body").rpartition("/")[2].partition(".")[0]
    return re.sub(r"[^\w-]+", "_", name, flags=re.ASCII)[:40].strip("_") or "body"


def _parts(body: Body, steps: NDArray[np.int64], values: Float64) -> tuple[Rows, Float64]:
    """Return the states of all links at some steps, and the numbers of the joints behind them."""
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
    widths = [one for joint in body.joints if any(joint.widths) for one in joint.widths]
    bounds = np.cumsum([0, *widths])
    columns: list[list[int]] = [[], [], []]
    for number, (first, last) in enumerate(pairwise(bounds)):
        columns[number % 3] += range(first, last)
    position, velocity, torque = (values[:, which] for which in columns)
    return Joints(steps, times_s, position, velocity, torque)


def _moving(dynamics: Sequence[Any], joints: Sequence[Any]) -> tuple[int, ...]:
    """Return the links that time can move: the base if it has mass, and what a joint moves."""
    moving = {BASE} if dynamics[0][0] != 0 else set()
    for info in joints:
        if info[2] != FIXED or info[16] in moving:
            moving.add(info[0])
    return tuple(sorted(moving))


def _reported(dynamics: Sequence[Any]) -> dict[str, Float64]:
    found = {}
    for number, (name, of_rigid) in enumerate(REPORTED):
        values = np.array([link[number] for link in dynamics], dtype=np.float64)
        if dynamics[0][10] == RIGID and not of_rigid:
            values[:] = math.nan
        found[name] = values
    return found


def _shapes(visual: Sequence[Any], dynamics: Sequence[Any]) -> tuple[Shape, ...]:
    """Return shapes from what `getVisualShapeData` says, which places them in the link's frame."""
    shapes = []
    for _, link, kind, size, file, position, orientation, rgba in visual:
        info = dynamics[link + 1] if link + 1 < len(dynamics) else dynamics[0]
        rigid = info[10] == RIGID
        inertial = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)) if rigid else (info[3], info[4])
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


def _product(one: Float64, other: Float64) -> Float64:
    """Return the product of two quaternions x, y, z, w."""
    vector = one[3] * other[:3] + other[3] * one[:3] + np.cross(one[:3], other[:3])
    return np.append(vector, one[3] * other[3] - one[:3] @ other[:3])
