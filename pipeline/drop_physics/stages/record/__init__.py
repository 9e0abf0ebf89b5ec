"""The command `record`: runs a script, and records everything that happens in its simulations.

Loading Rerun takes as long as loading PyBullet, so both happen at the same time: here, and in the
script. A command that analyzes the recording next loads the analysis then, too (`meanwhile`).
"""

from __future__ import annotations

import contextlib
import math
import os
import re
import signal
import sys
import threading
import time
import uuid
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from drop_physics.engines import script as running
from drop_physics.engines.reached import Reached
from drop_physics.engines.script import Program
from drop_physics.errors import DropError
from drop_physics.fields import all_of, counted
from drop_physics.files.outputs import check_apart
from drop_physics.messages import Message, shell_command
from drop_physics.option_types import checked_episodes
from drop_physics.printable import Printable
from drop_physics.recording import schema
from drop_physics.recording.about import about_script
from drop_physics.recording.layer_file import layer_of
from drop_physics.stages import verbs
from drop_physics.stages.found import name_of, path_digest
from drop_physics.stages.interpreter import interpreter_of
from drop_physics.stages.program import (
    SEEDED_CLOCK_S,
    STOPPED,
    checked_limits,
    digest_of_script,
    encodable,
    texts_of,
)
from drop_physics.stages.record.missing_file import missing_file
from drop_physics.stages.record.target import Target, target_of
from drop_physics.stages.rerun.again import Again, again_of
from drop_physics.stages.verbs.taken import takes_those_of
from drop_physics.trace.events import Ending

if TYPE_CHECKING:
    from drop_physics.engines.decoder import Decoder
    from drop_physics.recording.recorder import Recorder

NAMED_AFTER_S = 60.0
"""Run time [s] after which a note says how to stop a script that has no limit, since it may never
end."""
CANNOT_LOAD = "pybullet.error: Cannot load"
NOT_INSTALLED = re.compile(r"ModuleNotFoundError: No module named '(pybullet|mujoco)")


@dataclass(frozen=True)
class ReplayedSteps:
    """How many recorded steps were replayed and explained."""

    steps: int
    """Number of replayed steps."""
    replayed: int
    """Number of replayed steps that led to the recorded state, bit for bit."""
    explained: int
    """Number of replayed steps whose momentum change the named impulses explain completely."""
    remainder: float
    """Largest unexplained remainder of a step, over the largest impulse."""


@dataclass(frozen=True)
class Recorded(Printable, reported_by="drop_physics.report.record"):
    """The recording of a script, and how the script ended."""

    recording: Path
    recording_id: str
    script: str
    """Path of the script, or name of the module."""
    ended: str
    """How the run ended: `finished`, `steps`, `duration`, `idle` (it waited for a user), `disk`
    (disk full), `interrupted` or `failed`."""
    error: str
    """The script's error in one line; empty if none occurred."""
    failure: str
    """Sentence on the call that raised the error, and the reason; for other errors, text that the
    script did not print itself."""
    samples: int
    """Number of samples: in each simulation, one more than the number of steps."""
    bodies: int
    frames: int
    """Number of images that the script took."""
    bytes: int
    wall_s: float
    twice: bool
    """Whether the script was run a second time to compare the states."""
    first_difference: int | None
    """The first step whose state differs in the second run; None if none does."""
    replay: ReplayedSteps | None = None
    """Result of replaying MuJoCo's steps; None for other engines."""
    beside: Recorded | None = None
    """Recording of the other engine, if the script uses two."""
    engine: str = ""
    """The engine whose steps are recorded."""
    answer: tuple[Any, str] | None = None
    """Result of the expression evaluated in the run, or its error; None if none was requested."""
    reached: Reached = Reached()
    """Resources other than the simulation that the script used, if they were observed."""
    never_began: bool = False
    """Whether the script failed before it imported an engine."""
    is_elsewhere: bool = False
    """Whether child processes of the script also use the engine; their steps are not recorded."""


def forget(recorded: Recorded) -> None:
    """Delete an empty recording and its layer."""
    for path in (recorded.recording, layer_of(recorded.recording)):
        path.unlink(missing_ok=True)


@takes_those_of(verbs.RecordArguments)
def record_script(asked: verbs.RecordArguments) -> Recorded:
    """Run an unchanged script without a window, and record it.

    Raises
    ------
    ScenarioError
        If there is no such script, or a limit is out of range.
    OutputError
        If the recording cannot be written.
    DropError
        If the interpreter cannot be started.
    """
    arguments, duration_s, seed, steps = asked.arguments, asked.duration_s, asked.seed, asked.steps
    began = time.perf_counter()
    digest, arguments = (
        digest_of_script(asked.target, is_module=asked.is_module),
        texts_of(arguments),
    )
    steps, duration_s, seed = checked_limits(steps, duration_s, seed)
    interpreter = interpreter_of(
        asked.target, is_module=asked.is_module, given=asked.python, note=asked.note
    )
    # A script may compute with the time of day: a second run must see the same.
    begins_s = time.time() if seed is None else SEEDED_CLOCK_S
    program = Program(
        asked.target,
        arguments,
        interpreter,
        asked.is_module,
        steps,
        duration_s,
        asked.keep_sleeping,
        seed,
        begins_s,
        explain=asked.explain,
        listens=asked.listens or asked.twice,
        evaluator=asked.evaluator,
        episodes=checked_episodes(asked.episodes),
    )
    recording_id = uuid.uuid4().hex
    placed = target_of(
        asked.target, asked.out, is_module=asked.is_module, keep=asked.keep, force=asked.force
    )
    with placed as place:
        if not asked.is_module:
            check_apart([place.path], inputs=[Path(asked.target)])
        endless = steps is None and duration_s is None
        tell = asked.progress or (_named_later(asked.note) if endless else _silent)
        with (
            running.Script(program, stdout=asked.stdout, progress=tell) as process,
            interrupts(process.interrupt),
        ):
            from drop_physics.recording.recorder import Recorder

            if asked.meanwhile is not None:
                asked.meanwhile()
            recorder = Recorder(
                {schema.ORIGIN_PROPERTY: origin_of(program, digest)}, compared=asked.twice
            )
            ended = written(
                process,
                recorder,
                place.path,
                name=place.name,
                recording_id=recording_id,
                force=asked.force,
                note=asked.note,
                full=lambda: process.stop("disk"),
            )
            placed_beside = partial(
                target_of,
                asked.target,
                asked.out,
                is_module=asked.is_module,
                keep=asked.keep,
                force=asked.force,
            )
            beside = recorded_beside(process, recorder, asked.target, placed_beside)
        path = place.settled(stepped=process.decoder.steps > 0)
        path.touch()  # the newest of the script
    for sentence in _worth_knowing(process, recorder, ended, keep_sleeping=asked.keep_sleeping):
        asked.note(sentence)
    compared, differs = False, None
    if asked.twice:
        first = {process.decoder.engine: recorder}
        last = process.decoder.steps, ended.how
        if beside is not None:
            first[beside.engine] = beside.recorder
            last = process.decoder.steps + beside.steps, ended.how
        try:
            rerun = again_of(
                asked.target,
                process.reached(),
                is_module=asked.is_module,
                took_s=time.perf_counter() - began,
                anyway=asked.again,
            )
        except DropError as error:  # the recording is whole
            asked.note(error.in_options)
        else:
            compared, differs = _again(
                program, rerun, last, first, asked.note, asked.progress or _silent
            )
    recorded = recorded_of(recorder, ended, path, recording_id=recording_id, name=asked.target)
    return replace(
        recorded,
        replay=_replay(process.decoder) if asked.explain else None,
        wall_s=time.perf_counter() - began,
        beside=None if beside is None else beside.recorded,
        twice=compared,
        first_difference=differs,
        never_began=ended.how == "failed" and not process.decoder.engines,
        is_elsewhere=process.steps_elsewhere() or bool(process.decoder.mujoco.lost),
        engine=process.decoder.engine,
        answer=process.decoder.answer,
        reached=process.reached(),
    )


class Beside(NamedTuple):
    """The recording of the second engine, for a script that uses two."""

    engine: str
    recorded: Recorded
    recorder: Recorder
    steps: int


def recorded_beside(
    process: running.Listener,
    recorder: Recorder,
    name: str,
    placed: Callable[..., contextlib.AbstractContextManager[Target]],
) -> Beside | None:
    """Record the second engine of a script that uses two; return None if it uses only one.

    Parameters
    ----------
    process
        The script's process, after all events of the first engine were read.
    recorder
        The recorder of the first engine.
    name
        The script's name.
    placed
        A function that returns the recording to write, given the engine as `engine`.
    """
    other = process.other()
    if other is None:
        return None
    from drop_physics.recording.recorder import Recorder

    began = time.perf_counter()
    second = Recorder(recorder.inputs, drawn=recorder.drawn, compared=recorder.compared)
    recording_id = uuid.uuid4().hex
    with contextlib.closing(other.decoder), placed(engine=other.decoder.engine) as place:
        ended = written(
            other, second, place.path, name=place.name, recording_id=recording_id, force=False
        )
        path = place.settled(stepped=True)
    recorded = replace(
        recorded_of(second, ended, path, recording_id=recording_id, name=name),
        replay=None if other.explains_with is None else _replay(other.decoder),
        wall_s=time.perf_counter() - began,
    )
    return Beside(other.decoder.engine, recorded, second, other.decoder.steps)


def _replay(decoder: Decoder) -> ReplayedSteps | None:
    """Return how many MuJoCo steps were replayed and explained."""
    mujoco = decoder.mujoco
    if not mujoco.kept_steps or not mujoco.samples or mujoco.is_long:
        return None
    return ReplayedSteps(mujoco.kept_steps, mujoco.replayed, mujoco.explains, mujoco.remainder)


def origin_of(program: Program, digest: str | None) -> dict[str, Any]:
    """Return the recording properties that identify the script and its arguments."""
    target = program.target
    return {
        "kind": "script",
        "script": name_of(target, is_module=program.is_module),
        "script_path_sha256": None if program.is_module else path_digest(target),
        "script_sha256": digest,
        "arguments": [*map(encodable, program.arguments)] or None,
        "seed": program.seed,
        "steps": program.steps,
        "duration_s": program.duration_s,
        "python": None if program.python == sys.executable else program.python,
        "drop_version": metadata.version("drop-physics"),
    }


def _worth_knowing(
    process: running.Script, recorder: Recorder, ended: Ending, *, keep_sleeping: bool
) -> Iterator[str]:
    """Yield notes for the user after a script has ended."""
    decoder = process.decoder
    if not recorder.samples and not decoder.cut_off and not decoder.mujoco.version:
        nothing = Message(
            "nothing was simulated: the script did not connect to PyBullet, or loaded nothing"
        )
        early = Message("nothing was simulated: the script ended before its first step")
        if ended.how == "failed":
            yield early
        elif not ended.notes and ended.how not in STOPPED:  # notes say what was not seen
            yield nothing
    if decoder.bullet.real_time:
        virtual = Message(
            "the script asked for real-time simulation, which needs a window: it was stepped by a "
            "virtual clock"
        )
        real = Message(
            "the script asked for real-time simulation, which needs a window: it was stepped by "
            "the machine's clock"
        )
        yield real if keep_sleeping else virtual
    elif decoder.timing:
        yield Message(
            "the clock that the script reads at {place} shows simulated time; with "
            "--keep-sleeping it shows the machine's",
            place=decoder.timing,
        )
    yield from ended.notes
    if decoder.whole.leaves_out and not decoder.whole.ended:
        yield Message(
            "--episodes is about those that environments of gymnasium tell in MuJoCo; there is "
            "none, so every step is recorded"
        )
    if decoder.whole.left_out:
        yield Message(
            "{some} of {count} are one line each; --episodes all keeps their steps, "
            "--episodes N those of one",
            some=f"{decoder.whole.left_out:,}",
            count=counted(decoder.whole.ended, "episode"),
        )
    if decoder.unseeded:
        yield Message(
            "unseeded random numbers are drawn by {names}; --seed 0 makes them the same in "
            "every run",
            names=all_of(decoder.unseeded),
        )


def written(
    process: running.Listener,
    recorder: Recorder,
    path: Path,
    *,
    name: str | None = None,
    recording_id: str,
    **how: Any,  # noqa: ANN401 - as `writer.record` takes it
) -> Ending:
    """Write the recording of a running script or block, and return how it ended.

    `name` is the recording's name in Rerun's viewer; by default, its file name.
    """
    from drop_physics.recording import writer
    from drop_physics.recording.layout import layout

    endings: list[Ending] = []

    def ending() -> Ending:
        ended = process.ending()
        if ended.how == "failed" and CANNOT_LOAD in ended.error:
            site = recorder.sites.get(process.decoder.bullet.raised)
            why = missing_file(site.form, process.target) if site is not None else None
            ended.error = f"{ended.error} {why}" if why else ended.error
        if missing := NOT_INSTALLED.match(ended.error):
            ended.error = f"{ended.error}; {_how_to_install(missing[1], process)}"
        endings.append(ended)
        return ended

    origin = recorder.inputs[schema.ORIGIN_PROPERTY]
    chunks = recorder.chunks(
        process.events(), ending, lambda ended: about_script(origin, recorder, ended)
    )
    writer.record(
        path,
        writer.named(chunks, name or path.stem),
        recording_id=recording_id,
        blueprint=(lambda: layout(recorder.look())) if recorder.drawn else None,
        **how,
    )
    return endings[0]


def _how_to_install(module: str, process: running.Listener) -> str:
    """Return the command that installs an engine into a script's interpreter."""
    how = shell_command(process.python, "-m", "pip", "install", module)
    if module == "mujoco":
        return Message("try: {how}", how=how)
    return Message(
        "this needs pybullet: {how} takes seconds with Python 3.11 on Linux (x86-64), and compiles "
        "it elsewhere; --python names another interpreter",
        how=how,
    )


def recorded_of(
    recorder: Recorder, ended: Ending, path: Path, *, recording_id: str, name: str
) -> Recorded:
    """Return the result of one run of a script, without its duration."""
    return Recorded(
        recording=path,
        recording_id=recording_id,
        script=name,
        ended=ended.how,
        error=ended.error,
        failure=_failure(path, ended.printed) if ended.how == "failed" else "",
        samples=recorder.samples,
        bodies=len(recorder.bodies),
        frames=recorder.frames,
        bytes=path.stat().st_size,
        wall_s=0.0,
        twice=False,
        first_difference=None,
    )


def _failure(path: Path, printed: str) -> str:
    """Return a script's error as the analysis shows it, without what the script printed."""
    from drop_physics.recording.reader import read
    from drop_physics.rules.script_failed import failure

    held = read(path)
    last = held.seen.sampled.last
    calls = held.seen.sampled.piece(last, last + 1).calls
    raised = next(reversed(calls.failed()), None)
    found = failure(held.origin_and_end, raised, calls, printed=printed)
    return Message("the script fails") if found is None else found[0]


def _silent(*_: object) -> None:
    pass


def _named_later(note: Callable[[str], None]) -> Callable[[float, int], None]:
    """Return a progress function that mentions after a minute how to stop a script."""
    at = time.monotonic() + NAMED_AFTER_S

    def tell(_: float, steps: int) -> None:
        nonlocal at
        if time.monotonic() > at:
            at = math.inf
            note(
                Message(
                    "still running after {seconds:g} s, at step {steps:,}: Ctrl-C ends the script "
                    "and keeps the recording; --duration or --steps, before the script, limits it",
                    seconds=NAMED_AFTER_S,
                    steps=steps,
                )
            )

    return tell


@np.errstate(all="ignore")
def _again(
    program: Program,
    rerun: Again,
    last: tuple[int, str],
    recorders: Mapping[str, Recorder],
    note: Callable[[str], None],
    tell: Callable[[float, int], None],
) -> tuple[bool, int | None]:
    """Run a program again; return whether the runs were compared, and the first differing step.

    `last` contains the number of steps of the first run, and how it ended; `recorders` are the
    first run's recorders, by engine.
    """
    made, how = last
    if not made and how in ("disk", "interrupted"):
        note(Message("not run again: the first run was stopped before its first step"))
        return False, None
    # One more would be a difference, where the script ended by itself.
    most = made if made and how in STOPPED else made + 1
    from drop_physics.recording.recorder import Recorder

    again_of, null = (
        {engine: Recorder({}) for engine in recorders},
        os.open(os.devnull, os.O_WRONLY),
    )

    def take_in(listener: running.Listener) -> None:
        taken = Recorder({})
        for event in listener.events():
            taken.take_in(event)
        again_of[listener.decoder.engine] = taken

    try:
        again = replace(
            program, steps=most, perturb=running.OTHER_PERTURB, explain=False, listens=False
        )
        with (
            rerun.ready(again) as ready,
            running.Script(ready, stdout=null, stderr=null, progress=tell) as process,
            interrupts(process.interrupt),
        ):
            take_in(process)
            beside = process.other()
            if beside is not None:
                with contextlib.closing(beside.decoder):
                    take_in(beside)
    finally:
        os.close(null)
    if process.ending().how == "interrupted":
        note(Message("the second run was interrupted: it cannot be compared"))
        return False, None
    differ = {e: one.first_difference(again_of[e]) for e, one in recorders.items()}
    engine, first = next((each for each in differ.items() if each[1] is not None), ("", None))
    if len(differ) > 1 and first is not None:
        note(Message("the states that differ are those of {engine}", engine=engine))
    if first is None:
        note(Message("recorded twice: every state is the same to the bit"))
    elif process.decoder.unseeded:
        note(
            Message(
                "recorded twice: the states differ from step {step} on; the script draws unseeded "
                "random numbers: --seed 0 shows whether that is why",
                step=first,
            )
        )
    else:
        note(
            Message(
                "recorded twice: the states differ from step {step} on; the script depends on what "
                "is not the same in every run, such as a clock, threads, files, the order of a set "
                "or the system's random numbers, or PyBullet on fresh memory, where the second run "
                "had other leftovers (MALLOC_PERTURB_)",
                step=first,
            )
        )
    return True, first


@contextlib.contextmanager
def interrupts(then: Callable[[], None]) -> Iterator[None]:
    """Let Ctrl-C end the script, but not this process, which completes the recording.

    If Ctrl-C is ignored, as with `nohup` and `&`, it stays ignored, in the script as well.
    """
    ignored = signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    if ignored or threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, lambda *_: then())
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
