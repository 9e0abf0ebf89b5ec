"""The command `import`: records states from a file, and compares them with MuJoCo's steps.

The state after MuJoCo's step is compared with the next state of the file. If they agree within
rounding, the step is explained; otherwise the engines differ, which is reported once for each kind
of difference.
"""

from __future__ import annotations

import sys
import time
import uuid
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

import mujoco
import numpy as np

from drop_physics.engines.mujoco.importing.archives import NPZ, Archive, archive_of
from drop_physics.engines.mujoco.importing.gaps import Gap, Gaps
from drop_physics.engines.mujoco.importing.growth import growth_of
from drop_physics.engines.mujoco.importing.layouts import (
    TOLERATED,
    FoundStates,
    asked_names,
    states_in,
)
from drop_physics.engines.mujoco.importing.steps import ImportedStep, ImportedSteps, loaded
from drop_physics.engines.mujoco.importing.stream import stream_of
from drop_physics.engines.mujoco.watched import MujocoDecoder
from drop_physics.errors import ScenarioError
from drop_physics.fields import counted
from drop_physics.files.outputs import check_apart
from drop_physics.messages import Message, joined
from drop_physics.printable import Printable
from drop_physics.recording import schema
from drop_physics.recording.about import about_imported
from drop_physics.stages import verbs
from drop_physics.stages.found import name_of, path_digest
from drop_physics.stages.importing.said import said_of_gaps, said_of_growth
from drop_physics.stages.record.target import target_of
from drop_physics.stages.verbs.taken import takes_those_of
from drop_physics.trace.events import Ending, Event

LAST = 100
"""Number of last steps that are searched for the cause if states grow without bound."""
TOLD_EVERY = 512
"""Steps between two progress reports."""
ENGINE = f"MuJoCo {mujoco.__version__}"
DUMP, MODEL = "nan_dump_", "model_"
"""File name prefixes of an mjlab dump, and of its model."""


@dataclass(frozen=True)
class Imported(Printable, reported_by="drop_physics.report.imported"):
    """A recording created from another program's states."""

    recording: Path
    """Path of the recording."""
    recording_id: str
    """Id of the recording in Rerun."""
    file: Path
    """The other program's file."""
    model: str
    """Path of the model; empty if the file of the states contains the model."""
    engine: str
    """Engine and version whose steps are compared with the states."""
    world: int | None
    """Index of the imported world or demonstration; None if the file has only one."""
    worlds: int
    """Number of worlds or demonstrations in the file."""
    states: int
    """Number of recorded states."""
    steps: int
    """Number of steps between the states."""
    explained: int
    """Number of steps that agree with MuJoCo's own steps within rounding."""
    step_s: float
    """Time between two states [s]."""
    timestep_s: float
    """The model's timestep [s]."""
    rounding: float
    """Relative rounding error of the stored numbers."""
    arrays: dict[str, str]
    """Key in the file of each array that was read, by the array's name."""
    gaps: Sequence[Gap]
    """Deviations of the steps that do not agree, the most frequent first."""
    looked_at: int
    """Number of deviating steps whose responsible term was searched for."""
    ended: str
    """How the finite states end, and why; empty if all states are finite."""
    said: Sequence[str]
    """Sentences on the number of explained steps, and on how the others deviate."""
    notes: Sequence[str]
    """Sentences on missing data and its consequences."""
    bodies: int
    """Number of bodies."""
    bytes: int
    """Size of the recording [bytes]."""
    wall_s: float
    """Wall-clock time of the import [s]."""


@takes_those_of(verbs.ImportArguments)
def import_states(asked: verbs.ImportArguments) -> Imported:
    """Record the states in a file of another program.

    Raises
    ------
    ScenarioError
        If there is no such file, array or world.
    DropError
        If the file or the model cannot be read, or the states are not of this model.
    OutputError
        If the recording cannot be written.
    """
    began = time.perf_counter()
    path = Path(asked.file)
    archive = archive_of(path, asked.world)
    model = _model_of(archive, asked.model)
    m = loaded(model, archive.model)
    found = states_in(archive, m, asked_names(asked.maps, archive), asked.world)
    held = HeldAgainst(found, ImportedSteps(m, found.states), asked.progress)
    origin = {
        "kind": schema.IMPORTED,
        "script": name_of(str(path), is_module=False),
        "script_path_sha256": path_digest(str(path)),
        "arguments": None if found.world is None else ["--world", str(found.world)],
        "drop_version": metadata.version("drop-physics"),
    }
    recording_id = uuid.uuid4().hex
    placed = target_of(str(path), asked.out, is_module=False, keep=False, force=asked.force)
    with placed as place:
        check_apart([place.path], inputs=[path, *([model] if model else [])])
        from drop_physics.recording import writer
        from drop_physics.recording.layout import layout
        from drop_physics.recording.recorder import Recorder

        recorder = Recorder({schema.ORIGIN_PROPERTY: origin})
        chunks = recorder.chunks(
            held.events(), held.ending, lambda ended: about_imported(origin, recorder, ended)
        )
        writer.record(
            place.path,
            writer.named(chunks, place.name),
            recording_id=recording_id,
            blueprint=lambda: layout(recorder.look()),
            force=asked.force,
        )
        written = place.settled(stepped=True)
    return Imported(
        recording=written,
        recording_id=recording_id,
        file=path,
        model=str(model or ""),
        engine=ENGINE,
        world=found.world,
        worlds=found.worlds,
        states=len(found.states),
        steps=len(found.states) - 1,
        explained=held.explained,
        step_s=found.states.step_s,
        timestep_s=held.timestep_s,
        rounding=found.states.rounding,
        arrays=dict(found.names),
        gaps=held.gaps.in_order(),
        looked_at=held.gaps.looked_at,
        ended=held.ended,
        said=held.said,
        notes=held.notes,
        bodies=len(recorder.bodies),
        bytes=written.stat().st_size,
        wall_s=time.perf_counter() - began,
    )


class HeldAgainst:
    """Records states of a file, and compares each with MuJoCo's step from the previous state.

    Parameters
    ----------
    found
        The states in the file.
    steps
        MuJoCo's steps from these states.
    progress
        A function that is called with the number of steps made so far, and of all steps.
    """

    def __init__(
        self, found: FoundStates, steps: ImportedSteps, progress: Callable[[int, int], object]
    ) -> None:
        self._found, self._steps, self._progress = found, steps, progress
        self.timestep_s = float(steps.m.opt.timestep)
        self.stepped = abs(found.states.step_s / self.timestep_s - 1.0) <= TOLERATED
        """Whether the interval between states is one timestep of the model."""
        self.gaps, self.explained = Gaps(steps), 0
        self._last: deque[ImportedStep] = deque(maxlen=LAST)
        self.ended = ""
        self.said: list[Message] = []
        self.notes = [*found.notes, *self._of_steps()]

    def events(self) -> Iterator[Event]:
        """Yield the events of the recording, state by state."""
        with closing(MujocoDecoder()) as decoder:
            for payload in stream_of(self._steps, self._tell, stepped=self.stepped):
                yield from decoder.take(payload)
            yield from decoder.rest(np.empty(0))
            yield from decoder.explained(sys.executable)

    def ending(self) -> Ending:
        """Return how the states end; call it after the last event."""
        ending = Ending("finished", made_with={"mujoco": mujoco.__version__})
        if self._found.ended is not None:
            growth = growth_of(self._steps, [*self._last])
            why = [] if growth is None else [said_of_growth(growth)]
            if growth is None and self._found.is_beyond and self._steps.goes_on():
                why = [Message("MuJoCo's own step from the last state stays finite")]
            self.ended = joined("; ", [*why, self._found.ended])
            ending.how, ending.error = "failed", self.ended
        if self.stepped and self._steps.infers and self.explained < len(self._found.states) - 1:
            self.said.append(
                Message(
                    "{off:,} of {steps} are undecided: no controls are found that lead from their "
                    "state to the next",
                    off=len(self._found.states) - 1 - self.explained,
                    steps=counted(len(self._found.states) - 1, "step"),
                )
            )
        elif self.stepped:
            counts, rounding = (self.explained, len(self._found.states) - 1), self._rounding
            self.said += said_of_gaps(*counts, self.gaps, engine=ENGINE, rounding=rounding)
        ending.notes = [*self.said, *self.notes]
        return ending

    @property
    def _rounding(self) -> float:
        return self._found.states.rounding

    def _tell(self, step: ImportedStep) -> None:
        """Count a compared step, and report progress."""
        self.explained += step.near
        if not self._steps.infers:
            self.gaps.add(step)
        self._last.append(step)
        if step.number % TOLD_EVERY == 0:
            self._progress(step.number, len(self._found.states) - 1)

    def _of_steps(self) -> Iterator[Message]:
        """Yield notes on how the file's times and controls are used."""
        step_s = self._found.states.step_s
        if not self.stepped:
            yield Message(
                "states are {step:.4g} s apart, {count:.4g} timesteps of the model: no step leads "
                "from one to the next, so none is explained",
                step=step_s,
                count=step_s / self.timestep_s,
            )
        elif self._steps.shift:
            yield Message(
                "the controls of a step stand in the row that it ends in: they are taken from there"
            )


def _model_of(archive: Archive, given: Path | str | None) -> Path | None:
    """Return the path of the model file; None if the states' own file contains the model.

    Raises
    ------
    ScenarioError
        If the model is unknown.
    """
    if given is not None:
        path = Path(given)
        if path.suffix not in (".xml", ".mjb") or not path.is_file():
            raise ScenarioError(
                "--model must be a file that ends in .xml or .mjb, got {path!r}", path=str(path)
            )
        return path
    if archive.model is not None:
        return None
    path = archive.path
    names = [path.stem]
    if path.suffix in NPZ and path.name.startswith(DUMP):
        names.insert(0, MODEL + path.stem.removeprefix(DUMP))
    for name in names:
        for suffix in (".mjb", ".xml"):
            beside = path.with_name(name + suffix)
            if beside.is_file():
                return beside
    raise ScenarioError(
        "{path} does not say which model its states are of; name it: --model M.xml, or .mjb",
        path=str(path),
    )
