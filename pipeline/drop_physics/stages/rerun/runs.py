"""Makes several runs of a script at once and records them, for `trust` and `why`.

Rerun and polars are imported where they are used: the script starts while they load.
"""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from drop_physics.engines import script as running
from drop_physics.engines.fork_server import Fork
from drop_physics.engines.reached import Reached
from drop_physics.messages import Message
from drop_physics.sweeping import engines

if TYPE_CHECKING:
    from drop_physics.engines.script import Program
    from drop_physics.recording.reader import Recording

T = TypeVar("T")

Progress = Callable[[int, int, int], None]
"""Progress callback: called with the numbers of finished, failed and all runs."""


def only_of(engine: str) -> Message:
    """Return a note that only one engine is considered, if a script uses two."""
    return Message(
        "the script steps two engines: only {engine}'s steps are compared", engine=engine
    )


@dataclass(frozen=True)
class Ended:
    """The end of a run: how, and after how many steps."""

    how: str
    """Ending as in a recording; `interrupted` if `drop` stopped it."""
    steps: int
    """Total number of steps of the run's simulations."""
    intervened: frozenset[int]
    """Numbers of the interventions that took effect."""
    also_steps: str
    """The second engine, if the script uses two; else empty."""
    reached: Reached
    """Resources beside the simulation that the script accessed, if that was observed."""


def id_of(own: Recording, name: str) -> str:
    """Return the recording id of a changed run, derived from the unchanged run's id and a name."""
    return hashlib.sha256(f"{own.recording_id} {name}".encode()).hexdigest()[:32]


@dataclass(frozen=True)
class RunsUnderWay:
    """The runs that this process has in progress; picklable while there are none."""

    under_way: set[running.Script | Fork] = field(default_factory=set, compare=False)

    def record(
        self,
        program: Program,
        path: Path,
        *,
        origin: Mapping[str, Any],
        recording_id: str,
        stdout: int,
        drawn: bool = False,
    ) -> Ended:
        """Run and record a program.

        Parameters
        ----------
        program
            The script to run, with its settings.
        path
            The recording to write, or to replace.
        origin
            Content of the recording's origin property, which describes the script.
        recording_id
            The recording's id.
        stdout
            File descriptor of the script's standard output.
        drawn
            Whether to record also the data that only the viewer needs.

        Raises
        ------
        DropError
            If the script cannot be started.
        """
        with running.Script(program, stdout=stdout) as process:
            return self.recorded(
                process, path, origin=origin, recording_id=recording_id, drawn=drawn
            )

    def varied(
        self,
        process: running.Script | Fork,
        path: Path,
        own: Recording,
        name: str,
        *,
        drawn: bool,
    ) -> Ended:
        """Record a started run that is a variation of the unchanged run."""
        return self.recorded(
            process,
            path,
            origin={**own.origin, "variation": name},
            recording_id=id_of(own, name),
            drawn=drawn,
        )

    def recorded(
        self,
        process: running.Script | Fork,
        path: Path,
        *,
        origin: Mapping[str, Any],
        recording_id: str,
        drawn: bool = False,
    ) -> Ended:
        """Record a run that has started."""
        from drop_physics.recording import schema
        from drop_physics.recording.recorder import Recorder
        from drop_physics.stages.record import written

        self.under_way.add(process)
        recorder = Recorder({schema.ORIGIN_PROPERTY: origin}, drawn=drawn)
        try:
            ended = written(process, recorder, path, recording_id=recording_id, force=True)
        finally:
            self.under_way.discard(process)
        decoder = process.decoder
        return Ended(
            ended.how,
            decoder.steps,
            frozenset(decoder.intervened),
            decoder.also_steps,
            process.reached() if isinstance(process, running.Script) else Reached(),
        )

    def stop(self) -> None:
        """Stop the runs in progress."""
        for process in [*self.under_way]:
            process.stop("interrupted")


def run_all(
    work: Callable[[int], T],
    numbers: Sequence[int],
    *,
    stop: Callable[[], None],
    has_failed: Callable[[T], bool],
    jobs: int,
    progress: Progress,
    ray: tuple[Callable[[int], T], str] | None = None,
    entered: Callable[[int, T], object] = lambda *_: None,
) -> dict[int, T]:
    """Do numbered jobs, several at once, and return the results by number.

    On this machine each job is a process, recorded by a thread of the calling process.

    Parameters
    ----------
    work
        Called with the number of a job.
    numbers
        The numbers of the jobs.
    stop
        Called to end the jobs in progress.
    has_failed
        Whether a result counts as a failure.
    jobs
        Number of jobs that run at once.
    progress
        Called with the numbers of finished, failed and all jobs.
    ray
        The same work as a picklable function, and the address of a Ray cluster to run it on
        instead.
    entered
        Called with each result, as it arrives.
    """
    from drop_physics.recording.writer import strict

    runs = (
        engines.in_threads(work, numbers, jobs=max(1, min(jobs, len(numbers))), stop=stop)
        if ray is None
        else engines.on_ray(ray[0], numbers, address=ray[1])
    )
    done, failed = dict[int, T](), 0
    progress(0, 0, len(numbers))
    with strict(), contextlib.closing(runs) as finished:
        for number, result in finished:
            done[number] = result
            entered(number, result)
            failed += has_failed(result)
            progress(len(done), failed, len(numbers))
    return done
