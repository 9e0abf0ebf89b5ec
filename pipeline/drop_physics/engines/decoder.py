"""Decodes the byte stream of a watched script into events, for any engine.

`watching` sends the stream, and `watching.pipe` describes its format. Frames of an engine are
passed to the decoder in the engine's folder.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterator, Sequence
from typing import IO, Any

import numpy as np

from drop_physics.engines.frames import FrameStream
from drop_physics.engines.mujoco.frames import STEP
from drop_physics.engines.mujoco.watched import MujocoDecoder
from drop_physics.engines.pybullet.watched import NOTES, BulletDecoder
from drop_physics.engines.watching import pipe
from drop_physics.engines.whole_episodes import Episodes, WholeEpisodes
from drop_physics.errors import DropError
from drop_physics.fields import counted
from drop_physics.messages import Message
from drop_physics.trace.events import Event, located
from drop_physics.trace.history import DEFAULT_ENGINE as PYBULLET

MUJOCO = "MuJoCo"


class Decoder:
    """Decodes a stream of frames into events, in order.

    A script may step both PyBullet and MuJoCo, but a recording has one engine: the first that makes
    a step. Frames of the other engine are stored for a second decoder (`other`); until the first
    step, the frames of both are stored.

    Parameters
    ----------
    finer
        Number of engine steps per step of the script.
    episodes
        The episodes of MuJoCo environments that are recorded step by step.
    """

    def __init__(self, finer: int = 1, episodes: Episodes = "all") -> None:
        self._finer = finer
        self.whole = WholeEpisodes(episodes)
        self.engine = ""
        """The engine whose frames become events: the first that makes a step; empty until then."""
        self._kept: IO[bytes] | None = None
        """The stored frames of a second engine; None without any."""
        self.also_steps = ""
        """The other engine, if it also makes steps; otherwise empty."""
        self.python: dict[str, Any] = {}
        self.main_sha256: str | None = None
        """Digest of the file that runs as `__main__`, from its first call on."""
        self.stopped = ""
        self.ended: dict[str, Any] | None = None
        self.faults: list[str] = []
        self.cut_off = False
        """Whether the end of the stream is missing, since the script closed the pipe or wrote into
        it."""
        self.waits = False
        """Whether the script is waiting for user input."""
        self.unseeded: list[str] = []
        self.outside: list[tuple[str, str]] = []
        """Actions of the script outside its simulation, as named by `watching.outside`, with file
        or other names."""
        self.processor_s = 0.0
        """Processor time of the script [s]."""
        self.intervened: set[int] = set()
        """Numbers of the interventions that have had an effect."""
        self.serving: str | None = None
        """Reason that forbids forks, or an empty text, once the run pauses for trials; None before
        that.
        """
        self.forked: dict[int, tuple[int, int]] = {}
        """The process id of each requested trial, 0 if it was not forked, and the number of bytes
        of the stream before the fork."""
        self.statuses: dict[int, int] = {}
        """Exit status of each trial that has ended, as `os.wait` returns it."""
        self.answer: tuple[Any, str] | None = None
        """Result of the evaluator in the run, and an error text if it could not be evaluated."""
        self.timing = ""
        """File and line that first read the clock after a step."""
        self.bullet = BulletDecoder(finer, self.faults)
        self.mujoco = MujocoDecoder(self.whole)
        self._frames = FrameStream()
        self.counters: Sequence[int] = ()
        """Number of readings of each script line, in the memory shared with the process."""

    @property
    def steps(self) -> int:
        """The number of steps of all simulations."""
        return self.bullet.steps or self.mujoco.steps

    @property
    def time_s(self) -> float:
        """The simulated time of the most advanced simulation."""
        return self.bullet.time_s or self.mujoco.time_s

    @property
    def engines(self) -> list[str]:
        """Names of the engines that the script has imported."""
        known = {PYBULLET: "pybullet_api" in self.python, MUJOCO: bool(self.mujoco.version)}
        return [name for name, is_there in known.items() if is_there]

    def close(self) -> None:
        """Delete the temporary files."""
        self.mujoco.close()
        if self._kept is not None:
            self._kept.close()

    def other(self) -> tuple[Decoder, Iterator[Event]] | None:
        """Return the decoder of the other engine that was stepped, with its events.

        None if only one engine made steps.
        """
        if not self.also_steps:
            return None
        other = Decoder(self._finer)
        other.engine = self.also_steps
        other.python, other.main_sha256 = self.python, self.main_sha256
        other.counters = self.counters

        def events() -> Iterator[Event]:
            for kind, payload in _frames_in(self._kept):
                yield from other._on_frame(kind, payload)
            yield from other.rest()

        return other, events()

    def _begin(self, engine: str) -> Iterator[Event]:
        """Yield the events stored for an engine; from then on, store only the other's frames."""
        self.engine = engine
        kept, self._kept = self._kept, None
        for kind, payload in _frames_in(kept):
            yield from self._on_frame(kind, payload)
        if kept is not None:
            kept.close()

    def feed(self, data: bytes) -> Iterator[Event]:
        """Yield the events in the next bytes of the stream."""
        for kind, payload in self._frames.feed(data):
            if kind == pipe.CALL and self.engine == PYBULLET:  # as most are, or one of the next two
                self.bullet.on_call(payload)
            elif kind == pipe.SAMPLE and self.engine == PYBULLET:
                yield from self.bullet.on_sample(payload)
            elif kind == pipe.MUJOCO and self.engine == MUJOCO:
                yield from self.mujoco.take(payload)
            else:
                yield from self._on_frame(kind, payload)

    def _on_frame(self, kind: bytes, payload: bytes) -> Iterator[Event]:
        """Yield the events in a frame, or keep the frame for later."""
        of, note = MUJOCO if kind == pipe.MUJOCO else PYBULLET, {}
        if kind == pipe.NOTE:
            try:
                note = json.loads(payload)
            except ValueError:
                self._frames.broken = True
                return
            of = PYBULLET if note["what"] in NOTES else ""
        if of and of != self.engine:
            steps = kind == pipe.SAMPLE or (kind == pipe.MUJOCO and payload[:1] == STEP)
            if not steps or self.engine:
                if self._kept is None:
                    self._kept = tempfile.TemporaryFile()  # noqa: SIM115 - until it is closed
                self._kept.write(pipe.frame(kind, payload))
                if steps:
                    self.also_steps = of
                return
            yield from self._begin(of)
        if kind == pipe.MUJOCO:
            yield from self.mujoco.take(payload)
        elif kind != pipe.NOTE:
            yield from self.bullet.take(kind, payload)
        elif of:
            yield from self.bullet.note(**note)
        else:
            getattr(self, f"_on_{note.pop('what')}")(**note)

    def explained(self, python: str) -> Iterator[Event]:
        """Yield MuJoCo's replayed and explained steps, computed in the given interpreter."""
        try:
            yield from self.mujoco.explained(python)
        except DropError as error:  # the recording is whole without it
            self.faults.append(Message("its steps are not explained: {why}", why=str(error)))

    def rest(self) -> Iterator[Event]:
        """Yield the remaining events after the end of the stream."""
        if not self.engine:
            yield from self._begin(PYBULLET)
        if self.engine == PYBULLET and not self.also_steps:  # it says what of MuJoCo is not caught
            for _, payload in _frames_in(self._kept):
                yield from self.mujoco.take(payload)
        answers = np.array(self.counters[pipe.ANSWERED :], np.uint64).view(np.float64)
        yield from self.bullet.rest(self.counters, answers)
        if not self.bullet.is_used:
            yield from self.mujoco.rest(answers)
        self.faults += self.mujoco.notes()
        if self.also_steps:
            self.faults.append(
                Message(
                    "the script steps {first} and {other}: {other} has a recording of its own",
                    first=self.engine,
                    other=self.also_steps,
                )
            )
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
                samples=counted(self.bullet.samples, "sample"),
                why=why,
            )
        )

    # -- notes ------------------------------------------------------------------------------------

    def _on_python(self, **note: Any) -> None:  # noqa: ANN401
        self.python.update(note)

    def _on_main(self, sha256: str, **_: object) -> None:
        self.main_sha256 = sha256

    def _on_pybullet(self, version: int, release: str) -> None:
        self.python |= {"pybullet_api": version, "pybullet": release or None}

    def _on_waits(self, *, begins: bool) -> None:
        self.waits = begins

    def _on_again(self) -> None:
        """Discard a program without steps, since another program replaced it (`exec`)."""
        if self._kept is not None:
            self._kept.close()
        self.mujoco.close()
        self.python, self.main_sha256, self._kept = {}, None, None
        self.timing, self.unseeded = "", []
        self.bullet = BulletDecoder(self._finer, self.faults)
        self.mujoco = MujocoDecoder(self.whole)

    def _on_replaced(self, program: str) -> None:
        self.faults.append(
            Message(
                "the script becomes another program, {program}: what that steps is not recorded",
                program=program,
            )
        )

    def _on_timing(self, file: str, line: int) -> None:
        self.timing = located(file, line)

    def _on_unseeded(self, called: str, file: str, line: int) -> None:
        self.unseeded.append(f"{called} at {located(file, line)}")

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

    def _on_took(self, processor_s: float) -> None:
        self.processor_s = processor_s

    def _on_intervened(self, number: int) -> None:
        self.intervened.add(number)

    def _on_forked(self, trial: int, process: int, after: int) -> None:
        self.forked[trial] = process, after

    def _on_serving(self, shared: str) -> None:
        self.serving = shared

    def _on_ended(self, trial: int, status: int, processor_s: float) -> None:
        del processor_s
        self.statuses[trial] = status

    def _on_answer(self, value: Any, error: str) -> None:  # noqa: ANN401
        self.answer = value, error

    def _on_stop(self, why: str) -> None:
        self.stopped = why

    def _on_end(self, **note: Any) -> None:  # noqa: ANN401
        self.ended = note

    def _on_cut(self) -> None:
        self._is_cut_off(Message("the script closed drop's pipe"))

    def _on_unread(self, error: str) -> None:
        self.faults.append(Message("not all is known that the script read: {error}", error=error))


def _frames_in(kept: IO[bytes] | None) -> Iterator[tuple[bytes, bytes]]:
    """Yield kind and payload of each frame in a file."""
    if kept is None:
        return
    kept.seek(0)
    while head := kept.read(pipe.HEADER.size):
        kind, length = pipe.HEADER.unpack(head)
        yield kind, kept.read(length)
