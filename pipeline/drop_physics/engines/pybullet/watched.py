"""Interprets what a watched script's process sends: from frames to events.

The other end of `watching`; the stream is described in its `pipe`.
"""

from __future__ import annotations

import json
import math
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from drop_physics.engines.mujoco.frames import STEP
from drop_physics.engines.mujoco.watched import MujocoDecoder
from drop_physics.engines.pybullet.described import Numbering, moving_links, reported_of, shapes_of
from drop_physics.engines.pybullet.frames import Frames, StreamError
from drop_physics.engines.pybullet.gathered import GatheredWorld, Known
from drop_physics.engines.pybullet.reads import Reads
from drop_physics.engines.pybullet.surfaces import surfaces_of
from drop_physics.engines.pybullet.watch import pipe
from drop_physics.errors import DropError
from drop_physics.fields import counted
from drop_physics.messages import Message
from drop_physics.trace.events import (
    Appearance,
    At,
    Dynamics,
    Event,
    Image,
    Put,
    Raised,
    Settings,
    Site,
    SolverStop,
    counted_s,
    located,
)
from drop_physics.trace.history import PYBULLET

Float64 = NDArray[np.float64]

OF_PYBULLET = frozenset(
    (
        *("world", "site", "raised", "solver", "over", "engine", "body", "look", "gone", "reset"),
        *("reading", "read", "dynamics", "carried", "layout", "real_time", "fault"),
    )
)
"""Notes about its simulations."""
TIMESTEPS = ("timeStep", "fixedTimeStep")
"""Arguments of `setTimeStep` and `setPhysicsEngineParameter`."""
MUJOCO = "MuJoCo"


class Decoder:
    """Interprets a stream of frames as events, in order.

    Samples and calls are gathered: they are yielded when there are enough of them, or before
    something else is told of their simulation. Only a `Put` does not wait for calls before it.

    A script may step PyBullet and MuJoCo, but a recording has one engine: the first that steps. The
    frames of the other are kept for a decoder of its own (`other`), and until one steps all are.

    Parameters
    ----------
    finer
        Steps of the engine for each of the script's: what it sets as timestep is divided by that.
    """

    def __init__(self, finer: int = 1) -> None:
        self._finer = finer
        self.engine = ""
        """The engine whose frames are events: the first that steps; empty until then."""
        self._kept: IO[bytes] | None = None
        """The frames that are kept; None while there are none."""
        self._both = False
        """Whether the other engine steps, too."""
        self._timesteps: dict[int, int] = {}
        """The number of each site that is a timestep and is divided, by site."""
        self.calls = 0
        self._called = self.raised = -1
        """The sites of the latest call, and of the latest that raised."""
        self.samples = 0
        self.python: dict[str, Any] = {}
        self.main_sha256: str | None = None
        """Digest of the file that runs as `__main__`, once it has made a call."""
        self.stopped = ""
        self.ended: dict[str, Any] | None = None
        self.faults: list[str] = []
        self.cut_off = False
        """Whether the script closed the pipe or wrote into it: the end is missing."""
        self.real_time = False
        self.unseeded: list[str] = []
        self.outside: list[tuple[str, str]] = []
        """What it reached beside its simulation: `connects`, `starts`, `writes`, `removes`, `keeps`
        or `keeps there`, and a name."""
        self.intervened: set[int] = set()
        """The interventions that have changed something, by number."""
        self.forked: dict[int, tuple[int, int]] = {}
        """Process of each trial that parted from it, and after how many bytes of the stream."""
        self.timing = ""
        """Where the script first read a time after a step: file and line."""
        self.mujoco = MujocoDecoder()
        """What takes the payloads of `engines/mujoco/frames`."""
        self._frames = Frames()
        self._worlds: dict[int, GatheredWorld] = {}
        self._bodies: dict[int, Known] = {}
        self._numbering = Numbering()
        self._solvers: dict[tuple[int, int], SolverStop] = {}
        self._reads = Reads()
        self.counters: Sequence[int] = ()
        """How often places have read, as counted in the memory shared with the process."""
        self._caller: GatheredWorld | None = None
        """The simulation that the last call was for."""

    @property
    def steps(self) -> int:
        """How many steps all simulations have made: a sample each, after their first."""
        made = self.samples - sum(world.sampled for world in self._worlds.values())
        return made or self.mujoco.steps

    @property
    def time_s(self) -> float:
        """Simulated time [s], of the simulation that is furthest."""
        its = max((world.time_s(world.step) for world in self._worlds.values()), default=0.0)
        return its or self.mujoco.time_s

    def close(self) -> None:
        """Free what was kept."""
        self.mujoco.close()
        if self._kept is not None:
            self._kept.close()

    def other(self) -> tuple[Decoder, Iterator[Event]] | None:
        """Return what decodes the other engine that was stepped, and its events, after all others.

        None if only one engine was stepped.
        """
        if not self._both:
            return None
        other = Decoder(self._finer)
        other.engine = PYBULLET if self.engine == MUJOCO else MUJOCO
        other.python, other.main_sha256 = self.python, self.main_sha256
        other.counters = self.counters

        def events() -> Iterator[Event]:
            for kind, payload in _frames_in(self._kept):
                yield from other._on_frame(kind, payload)
            yield from other.rest()

        return other, events()

    def _begin(self, engine: str) -> Iterator[Event]:
        """Yield the events of an engine that were kept, and keep only the other's from now on."""
        self.engine = engine
        kept, self._kept = self._kept, None
        for kind, payload in _frames_in(kept):
            yield from self._on_frame(kind, payload)
        if kept is not None:
            kept.close()

    def feed(self, data: bytes) -> Iterator[Event]:
        """Yield the events in the next part of the stream."""
        for kind, payload in self._frames.feed(data):
            if kind == pipe.SAMPLE and self.engine == PYBULLET:
                yield from self._add_sample(payload)
            elif kind == pipe.CALL and self.engine == PYBULLET:  # as many: without a generator
                self._on_call(payload)
            else:
                yield from self._on_frame(kind, payload)

    def _on_frame(self, kind: bytes, payload: bytes) -> Iterator[Event]:
        """Yield the events in a frame, or keep it."""
        of, note = MUJOCO if kind == pipe.MUJOCO else PYBULLET, {}
        if kind == pipe.NOTE:
            try:
                note = json.loads(payload)
            except ValueError:
                self._frames.broken = True
                return
            of = PYBULLET if note["what"] in OF_PYBULLET else ""
        if of and of != self.engine:
            steps = kind == pipe.SAMPLE or (kind == pipe.MUJOCO and payload[:1] == STEP)
            if not steps or self.engine:
                if self._kept is None:
                    self._kept = tempfile.TemporaryFile()  # noqa: SIM115 - until it is closed
                self._kept.write(pipe.frame(kind, payload))
                self._both |= steps
                return
            yield from self._begin(of)
        if kind == pipe.SAMPLE:
            yield from self._add_sample(payload)
        elif kind == pipe.MUJOCO:
            yield from self.mujoco.take(payload)
        elif kind == pipe.CALL:
            self._on_call(payload)
        elif kind == pipe.NOTE:
            yield from getattr(self, f"_on_{note.pop('what')}")(**note) or ()
        elif kind == pipe.SET:
            yield self._put(payload)
        elif kind == pipe.RESULT:
            if self._caller is not None:
                self._caller.add_result(*pipe.NUMBER.unpack(payload))
        else:
            yield from self._on_image(payload)

    def explained(self, python: str) -> Iterator[Event]:
        """Yield what the steps of MuJoCo are, replayed and explained in an interpreter."""
        try:
            yield from self.mujoco.explained(python)
        except DropError as error:  # the recording is whole without it
            self.faults.append(Message("its steps are not explained: {why}", why=str(error)))

    def rest(self) -> Iterator[Event]:
        """Yield what is gathered and not yet yielded; the stream is over."""
        if not self.engine:
            yield from self._begin(PYBULLET)
        if self.engine == PYBULLET and not self._both:  # it says what of MuJoCo is not caught
            for _, payload in _frames_in(self._kept):
                yield from self.mujoco.take(payload)
        for world in self._worlds.values():
            yield from world.gathered()
        if not self._worlds:
            yield from self.mujoco.rest()
        self.faults += self.mujoco.notes()
        if self._both:
            engines = PYBULLET, MUJOCO
            self.faults.append(
                Message(
                    "the script steps {first} and {other}: {other} has a recording of its own",
                    first=self.engine,
                    other=engines[self.engine == PYBULLET],
                )
            )
        yield from self._solvers.values()
        if self.counters:
            yield from self._reads.counted(self.counters)
        if self._frames.broken:
            self._is_cut_off(Message("the script wrote into drop's pipe"))
        elif self._frames.is_cut and self.stopped != "disk":
            self._is_cut_off(Message("the rest is missing in drop's pipe"))

    def _is_cut_off(self, why: Message) -> None:
        self.cut_off = True
        self._ends_early(why)

    def _ends_early(self, why: Message) -> None:
        self.faults.append(
            Message(
                "the recording ends after {samples}: {why}",
                samples=counted(self.samples, "sample"),
                why=why,
            )
        )

    # -- numbers ----------------------------------------------------------------------------------

    def _add_sample(self, payload: bytes) -> Iterable[Event]:
        """Take a sample, as most frames are; return what is gathered before it, if that is much."""
        number, step = pipe.HEAD.unpack_from(payload)
        world = self._worlds[number]
        gathered = [*world.gathered()] if world.is_full else ()
        if not world.add_sample(step, payload, self.calls):
            raise StreamError("the script's process sent step {step} out of order", step=step)
        self.samples += 1
        return gathered

    def _on_call(self, payload: bytes) -> None:
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

    def _on_python(self, **note: Any) -> None:  # noqa: ANN401
        self.python.update(note)

    def _on_main(self, sha256: str, **_: object) -> None:
        self.main_sha256 = sha256

    def _on_pybullet(self, version: int, **_: object) -> None:
        self.python["pybullet_api"] = version

    def _on_world(
        self, world: int, client: int, first_step: int, first_time_s: float, **_: object
    ) -> None:
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
            self.faults.append(
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

    def _on_unread(self, error: str) -> None:
        self.faults.append(Message("not all is known that the script read: {error}", error=error))

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
        """Yield what was gathered before something about a body changes."""
        yield from known.world.gathered()
        known.body = replace(known.body, **what)

    def _on_layout(
        self, world: int, bodies: list[tuple[int, bool]], constraints: list[tuple[int, int]]
    ) -> Iterator[Event]:
        its = self._worlds[world]
        yield from its.gathered()
        layout = [(self._bodies[number], has_base) for number, has_base in bodies]
        its.lay_out(layout, constraints)

    def _on_real_time(self, **_: object) -> None:
        self.real_time = True

    def _on_timing(self, file: str, line: int) -> None:
        self.timing = located(file, line)

    def _on_unseeded(self, called: str, file: str, line: int) -> None:
        self.unseeded.append(f"{called} at {located(file, line)}")

    def _on_fault(self, world: int, step: int, error: str) -> Iterator[Event]:
        self.faults.append(
            Message(
                "from step {step} on the simulation could not be read: {error}",
                step=step,
                error=error,
            )
        )
        yield from self._worlds[world].gathered()

    def _on_copy(self, file: str) -> None:
        self.faults.append(
            Message(
                "{file} is a second copy of PyBullet, with simulations of its own: they are not "
                "recorded",
                file=file,
            )
        )

    def _on_running(self) -> None:
        self._ends_early(Message("threads that step the simulation outlive the block"))

    def _on_outside(self, how: str, name: str) -> None:
        self.outside.append((how, name))

    def _on_intervened(self, number: int) -> None:
        self.intervened.add(number)

    def _on_forked(self, trial: int, process: int, after: int) -> None:
        self.forked[trial] = process, after

    def _on_stop(self, why: str) -> None:
        self.stopped = why

    def _on_end(self, **note: Any) -> None:  # noqa: ANN401
        self.ended = note

    def _on_cut(self) -> None:
        self._is_cut_off(Message("the script closed drop's pipe"))

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


def _frames_in(kept: IO[bytes] | None) -> Iterator[tuple[bytes, bytes]]:
    """Yield kind and payload of the frames in a file."""
    if kept is None:
        return
    kept.seek(0)
    while head := kept.read(pipe.HEADER.size):
        kind, length = pipe.HEADER.unpack(head)
        yield kind, kept.read(length)
