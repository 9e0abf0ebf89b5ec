"""Decodes messages about PyBullet from a script's process into events of a recording.

`watch` sends the messages; `watching.pipe` describes the format of the stream.
"""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from drop_physics.arrays import Float64
from drop_physics.engines.frames import StreamError
from drop_physics.engines.pybullet.described import Numbering, moving_links, reported_of, shapes_of
from drop_physics.engines.pybullet.gathered import GatheredWorld, Known
from drop_physics.engines.pybullet.reads import Reads
from drop_physics.engines.surfaces import surfaces_of
from drop_physics.engines.watching import pipe
from drop_physics.messages import Message
from drop_physics.trace.events import (
    Appearance,
    At,
    Dynamics,
    EpisodeEnd,
    Event,
    Image,
    Put,
    Raised,
    Settings,
    Site,
    SolverStop,
    counted_s,
)

NOTES = frozenset(
    (
        *("world", "site", "raised", "solver", "over", "engine", "body", "look", "gone", "reset"),
        *(
            "reading",
            "read",
            "dynamics",
            "carried",
            "layout",
            "real_time",
            "fault",
            "episode",
            "file",
        ),
    )
)
"""Kinds of messages about PyBullet's simulations."""
TIMESTEPS = ("timeStep", "fixedTimeStep")
"""Arguments of `setTimeStep` and `setPhysicsEngineParameter`."""


class BulletDecoder:
    """Decodes a script's messages about PyBullet into events, in order.

    Samples and calls are collected: they are yielded when there are enough of them, or before
    another event of the same simulation. Only a `Put` is yielded at once, even before earlier
    calls.

    Parameters
    ----------
    finer
        Number of engine steps per step of the script, by which the timesteps that the script sets
        are divided.
    faults
        A list to which problems of the recording are added.
    """

    def __init__(self, finer: int, faults: list[str]) -> None:
        self._finer, self._faults = finer, faults
        self._timesteps: dict[int, int] = {}
        """Index of the timestep among a call's numbers, by site, if timesteps are divided."""
        self.calls = 0
        self._called = self.raised = -1
        """The call sites of the latest call, and of the latest call that raised an error."""
        self.samples = 0
        self.files: dict[str, list[tuple[str, bytes]]] = {}
        """Paths and contents of files named by calls, once for each load, if contents are sent."""
        self.real_time = False
        self._worlds: dict[int, GatheredWorld] = {}
        self._bodies: dict[int, Known] = {}
        self._numbering = Numbering()
        self._solvers: dict[tuple[int, int], SolverStop] = {}
        self._episodes: dict[int, int] = {}
        """Number of steps of each simulation before its current episode."""
        self._reads = Reads()
        self._caller: GatheredWorld | None = None
        """The simulation of the last call."""

    @property
    def steps(self) -> int:
        """Number of steps in all simulations together."""
        return self.samples - sum(world.sampled for world in self._worlds.values())

    @property
    def is_used(self) -> bool:
        """True if the script has a simulation in PyBullet."""
        return bool(self._worlds)

    @property
    def time_s(self) -> float:
        """The simulated time of the most advanced simulation [s]."""
        return max((world.time_s(world.step) for world in self._worlds.values()), default=0.0)

    def take(self, kind: bytes, payload: bytes) -> Iterable[Event]:
        """Return the events that a binary message completes."""
        if kind == pipe.SAMPLE:
            return self.on_sample(payload)
        if kind == pipe.CALL:
            self.on_call(payload)
        elif kind == pipe.SET:
            return (self._put(payload),)
        elif kind == pipe.IMAGE:
            return self._on_image(payload)
        elif self._caller is not None:
            self._caller.add_result(*pipe.NUMBER.unpack(payload))
        return ()

    def note(self, what: str, **values: Any) -> Iterable[Event]:  # noqa: ANN401
        """Return the events that a JSON message (one of `NOTES`) completes."""
        return getattr(self, f"_on_{what}")(**values) or ()

    def rest(self, counters: Sequence[int], answers: Float64) -> Iterator[Event]:
        """Yield the remaining events after the last message.

        `counters` and `answers` are arrays in shared memory: counts and results of readings.
        """
        for world in self._worlds.values():
            yield from world.gathered()
        yield from self._solvers.values()
        if counters:
            yield from self._reads.counted(counters, answers)

    # -- numbers ----------------------------------------------------------------------------------

    def on_sample(self, payload: bytes) -> Iterable[Event]:
        """Add a sample; if enough samples are collected, first return those as events."""
        number, step = pipe.HEAD.unpack_from(payload)
        world = self._worlds[number]
        gathered = [*world.gathered()] if world.is_full else ()
        if not world.add_sample(step, payload, self.calls):
            raise StreamError("the script's process sent step {step} out of order", step=step)
        self.samples += 1
        return gathered

    def on_call(self, payload: bytes) -> None:
        """Add a call to those collected."""
        number, site = pipe.CALL_HEAD.unpack_from(payload)
        self.calls += 1
        self._caller = self._worlds[number]
        if site in self._timesteps:
            head, numbers = payload[: pipe.CALL_HEAD.size], payload[pipe.CALL_HEAD.size :]
            values = np.frombuffer(numbers).copy()
            values[self._timesteps[site]] /= self._finer
            payload = head + values.tobytes()
        self._called = site
        self._caller.add_call(self.calls, payload)

    def _put(self, payload: bytes) -> Put:
        number, step = pipe.HEAD.unpack_from(payload)
        known = self._bodies[number]
        values = np.frombuffer(payload, np.float64, offset=pipe.HEAD.size)
        return known.put(self._at(known.world, step), values)

    # -- notes ------------------------------------------------------------------------------------

    def _on_world(
        self, world: int, client: int, first_step: int, first_time_s: float, **_: object
    ) -> Iterator[Event]:
        # A client's number is used again after `disconnect`: its bodies went with that simulation.
        for body in [key for key, known in self._bodies.items() if known.world.client == client]:
            yield from self._on_gone(body)
        if not math.isfinite(first_time_s):
            times_s = [known.time_s(known.step) for known in self._worlds.values()]
            first_time_s = max(times_s, default=0.0)
        self._worlds[world] = GatheredWorld(client, first_step, first_time_s)

    def _on_site(self, names: list[str], whole: list[bool], **note: Any) -> Iterator[Event]:  # noqa: ANN401
        at = next((names.index(name) for name in TIMESTEPS if name in names), None)
        if self._finer > 1 and at is not None:
            self._timesteps[note["number"]] = at
            whole = [each and number != at for number, each in enumerate(whole)]
        yield Site(names=tuple(names), whole=tuple(whole), **note)

    def _on_raised(self, error: str) -> Iterator[Event]:
        world = self._caller
        if world is not None:
            at = self._at(world)
            yield from world.called()
            self.raised = self._called
            yield Raised(at, error)

    def _on_solver(self, world: int, **early: Any) -> None:  # noqa: ANN401
        its = self._worlds[world]
        self._solvers[world, early["iterations"]] = SolverStop(self._at(its), its.client, **early)

    def _on_over(self, world: int, **_: object) -> Iterator[Event]:
        yield from self._worlds[world].gathered()

    def _on_engine(
        self, world: int, step: int, time_s: float, settings: dict[str, Any]
    ) -> Iterator[Event]:
        its = self._worlds[world]
        yield from its.gathered()
        its.step = step
        timestep_s = settings["fixedTimeStep"]
        if timestep_s != its.timestep_s:
            # A time that added up a non-finite timestep is useless.
            its.since_s = time_s if math.isfinite(time_s) else its.time_s(step)
            its.since_step, its.timestep_s = step, counted_s(timestep_s)
        if not math.isfinite(timestep_s) and not its.timeless:
            its.timeless = True
            self._faults.append(
                Message(
                    "from step {step} on the timestep is {timestep} s: such steps take no time",
                    step=step,
                    timestep=timestep_s,
                )
            )
        yield Settings(self._at(its, step), its.client, settings)

    def _on_body(self, world: int, body: int, dynamics: list[Any], **note: Any) -> Iterator[Event]:  # noqa: ANN401
        its = self._worlds[world]
        yield from its.gathered()
        described = self._numbering.described(its.client, dynamics, note)
        known = Known(described, its, dynamics, note["visual"], note["joints"], note["inertial"])
        self._bodies[body] = its.ids[note["id"]] = known
        self._reads.bodies_came()
        at = self._at(its)
        yield Appearance(at, known.body, there=True, came=True, sampled=its.sampled)
        yield from surfaces_of(at, known.body)
        if not known.body.soft:
            yield Dynamics(at, known.body, reported_of(dynamics))

    def _on_look(self, body: int, visual: list[Any]) -> Iterator[Event]:
        known = self._bodies[body]
        known.visual = visual
        yield from self._changed(known, shapes=shapes_of(visual, known.dynamics, known.inertial))
        yield Appearance(self._at(known.world), known.body, there=True)

    def _on_gone(self, body: int) -> Iterator[Event]:
        known = self._bodies.pop(body)
        world = known.world
        yield from world.gathered()
        if world.ids.get(known.body.engine_id) is known:
            del world.ids[known.body.engine_id]
        yield Appearance(self._at(world), known.body, there=False)

    def _on_reset(self, world: int) -> None:
        self._reads.forget(self._worlds[world])

    def _on_reading(self, world: int, **note: Any) -> None:  # noqa: ANN401
        self._reads.describe(client=self._worlds[world].client, **note)

    def _on_read(self, world: int, **note: Any) -> None:  # noqa: ANN401
        self._reads.read(self._worlds[world], **note)

    def _on_dynamics(self, body: int, dynamics: list[Any]) -> Iterator[Event]:
        known = self._bodies[body]
        known.dynamics = dynamics
        moving = {*known.body.moving, *moving_links(dynamics[0][0] != 0, known.joints)}
        yield from self._changed(
            known,
            moving=tuple(sorted(moving)),
            shapes=shapes_of(known.visual, dynamics, known.inertial),
        )
        yield Dynamics(self._at(known.world), known.body, reported_of(dynamics))

    def _on_carried(self, body: int) -> Iterator[Event]:
        known = self._bodies[body]
        yield from self._changed(known, moving=moving_links(True, known.joints))
        yield Appearance(self._at(known.world), known.body, there=True)

    def _changed(self, known: Known, **what: Any) -> Iterator[Event]:  # noqa: ANN401
        """Yield the collected events before a body's properties change."""
        yield from known.world.gathered()
        known.body = replace(known.body, **what)

    def _on_layout(
        self, world: int, bodies: list[tuple[int, bool]], constraints: list[tuple[int, int]]
    ) -> Iterator[Event]:
        its = self._worlds[world]
        yield from its.gathered()
        layout = [(self._bodies[number], has_base) for number, has_base in bodies]
        its.lay_out(layout, constraints)

    def _on_episode(self, world: int, how: str, **told: Any) -> Iterator[Event]:  # noqa: ANN401
        its = self._worlds[world]
        first, self._episodes[world] = self._episodes.get(world, 0), its.step
        if how != "begins":
            yield from its.gathered()
            yield EpisodeEnd(self._at(its), its.client, first, how, **told)

    def _on_file(self, name: str, path: str, content: str) -> None:
        self.files.setdefault(name, []).append((path, base64.b64decode(content)))

    def _on_real_time(self, **_: object) -> None:
        self.real_time = True

    def _on_fault(self, world: int, step: int, error: str) -> Iterator[Event]:
        self._faults.append(
            Message(
                "from step {step} on the simulation could not be read: {error}",
                step=step,
                error=error,
            )
        )
        yield from self._worlds[world].gathered()

    def _on_image(self, payload: bytes) -> Iterator[Event]:
        (length,) = pipe.IMAGE_HEAD.unpack_from(payload)
        start = pipe.IMAGE_HEAD.size + length
        note = json.loads(payload[pipe.IMAGE_HEAD.size : start])
        size = note["height"], note["width"], 4
        world = self._worlds[note["world"]]
        yield from world.called()
        yield Image(
            self._at(world, note["step"]),
            world.client,
            f"{note['file']}:{note['line']} {note['width']}x{note['height']}",
            np.frombuffer(payload, np.uint8, offset=start).reshape(size),
            tuple(note["view"] or ()),
            tuple(note["projection"] or ()),
        )

    def _at(self, world: GatheredWorld, step: int | None = None) -> At:
        step = world.step if step is None else step
        return At(step, world.time_s(step), self.calls)
