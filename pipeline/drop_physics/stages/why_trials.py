"""The trials of `drop why`: which interventions are tried, and a run with each."""

from __future__ import annotations

import hashlib
import os
import re
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from drop_physics.engines.pybullet.script import PartedTrial, Program, Script
from drop_physics.errors import ScenarioError
from drop_physics.experiments.interventions import KINDS, Intervention
from drop_physics.experiments.verdicts import Outcome
from drop_physics.fields import alternatives
from drop_physics.option_types import number
from drop_physics.stages.runs import Ended, RunsUnderWay
from drop_physics.stages.scratch import scratch_copy
from drop_physics.stages.variations import NUDGE
from drop_physics.trace.acts import FILTERS, PUSHES, Act
from drop_physics.trace.cures import ChangedRun, Cure, EngineCures, Scope
from drop_physics.trace.events import located
from drop_physics.trace.history import PYBULLET

if TYPE_CHECKING:
    from drop_physics.experiments.run_distance import Distance
    from drop_physics.recording.reader import Recording
    from drop_physics.rules.answer import Finding
    from drop_physics.trace.history import Seen

READING = "reading"
"""The code of what is about a number that a script reads: no run can show it."""
LONGEST = 10.0
"""A trial that takes so many times the script's own run, and `LEAST_S`, is stopped."""
LEAST_S = 20.0
SETTERS = (
    *PUSHES,
    *FILTERS,
    Act.COMMAND,
    Act.CHANGE_CONSTRAINT,
    Act.SET_PROPERTY,
    Act.SET_GRAVITY,
    Act.SET_TIMESTEP,
    Act.SET_ENGINE,
    Act.SET_REAL_TIME,
    Act.SET_VELOCITY,
)
"""The calls that are left out by `--ablate`."""
NEEDED = re.compile(
    r"^(body\w*|object\w*|link\w*|joint\w*|controlMode|physicsClientId|flags|"
    r"userConstraint\w*|\w*Obj|grav[XYZ]|timeStep|mass)$"
)
"""Arguments that a call cannot do without, or that say what it is about."""
ARGUMENT = re.compile(r"(?:^|, )(\w+)=")


@dataclass
class Candidate:
    """An intervention that is to be tried, and the findings that propose it, by their places."""

    intervention: Intervention
    run: ChangedRun | None
    """None where the engine has no such intervention."""
    findings: list[int] = field(default_factory=list)


class Proposals:
    """What is to be tried of a script, by its own run.

    Parameters
    ----------
    seen
        The script's own run.
    findings
        What is found in it.
    cures
        What is known of cures for its engine.
    """

    def __init__(self, seen: Seen, findings: Sequence[Finding], cures: EngineCures) -> None:
        self._seen, self._findings, self._cures = seen, findings, cures
        settings = [each.values.get("fixedTimeStep") for each in seen.settings]
        self._timestep_s = float(np.ravel(settings[-1])[0]) if settings else 1 / 240  # type: ignore[arg-type]
        self._commanded: frozenset[tuple[int, int]] | None = None

    def of_findings(self) -> list[Candidate]:
        """Return the cures of the findings, in their order; the same thing is tried once."""
        found: dict[Any, Candidate] = {}
        for place, finding in enumerate(self._findings):
            if finding.cure is None or finding.code == READING:  # not about what the bodies do
                continue
            candidate = self._candidate(replace(finding.cure, call=""), finding)
            places = found.setdefault(candidate.intervention, candidate).findings
            if place not in places:
                places.append(place)
        return [*found.values()]

    def always(self) -> list[Candidate]:
        """Return what is tried of every script, since every outcome may hang on it."""
        return [
            self._whole(Cure("timestep", value=2.0)),
            self._whole(Cure("solver", value=500.0)),
        ]

    def asked(self, texts: Sequence[str], about: Sequence[int]) -> list[Candidate]:
        """Return what `--try` names, made on what the findings about are about.

        Raises
        ------
        ScenarioError
            If there is no such intervention, or its value is none.
        """
        found: list[Candidate] = []
        for text in texts:
            name, equals, value = text.partition("=")
            finer = name.startswith("timestep/")
            if finer:
                name, equals, value = "timestep", "=", name.removeprefix("timestep/")
            if name not in KINDS or name == "without":
                raise ScenarioError(
                    "--try takes {names}, each alone or as NAME=V, got {text!r}",
                    names=alternatives(sorted({*KINDS} - {"without"})),
                    text=text,
                )
            given = number(value) if equals else None
            if finer and (given is None or not given.is_integer() or not 2 <= given <= 1000):
                raise ScenarioError(
                    "--try timestep/K takes a whole number from 2 to 1000, got {text!r}", text=text
                )
            named = [self._findings[place] for place in about]
            proposes = [each for each in named if each.cure is not None and each.cure.name == name]
            of = [] if KINDS[name].whole_run else named
            candidates = [
                self._candidate(Cure(name, one.joint or one.body, given, text), one) for one in of
            ] or [self._whole(Cure(name, value=given, call=text))]
            if given is None and proposes:  # what a finding says itself is meant
                candidates = [self._candidate(each.cure, each) for each in proposes if each.cure]
            for candidate in candidates:
                candidate.findings += about
            # What comes to the same calls is one trial, whatever it was made on.
            found += {repr(each.run): each for each in reversed(candidates)}.values()
        return found

    def left_out(self) -> list[Candidate]:
        """Return each call of a setter, and each of its optional arguments, to be left out."""
        found: dict[tuple[str, str, int, str | None], Candidate] = {}
        for piece in self._seen.pieces():
            for call in piece.calls.of(*(SETTERS if self._seen.engine == PYBULLET else Act)):
                names = ARGUMENT.findall(call.site.form)
                for argument in (None, *(each for each in names if not NEEDED.match(each))):
                    key = call.function, call.file, call.line, argument
                    if key not in found:
                        found[key] = self._without(*key)
        return [each for each in found.values() if each.run is not None]

    def _without(self, function: str, file: str, line: int, argument: str | None) -> Candidate:
        form = "" if argument is None else "argument"
        cure = Cure("without", form=form, given={"function": function, "argument": argument})
        cure = replace(cure, call=self._cures.call_of(cure))
        intervention = Intervention(cure, site=located(file, line))
        return Candidate(intervention, self._cures.left_out(function, file, line, argument))

    def _whole(self, cure: Cure) -> Candidate:
        scope = Scope([*self._seen.bodies.values()], timestep_s=self._timestep_s)
        return self._made(cure, scope, whole=True)

    def _candidate(self, cure: Cure, finding: Finding) -> Candidate:
        labels = {body.label: body for body in self._seen.bodies.values()}
        bodies = [labels[each] for each in cure.bodies or (finding.body,) if each in labels]
        other = labels.get(finding.other or "")
        if not bodies or (finding.bodies > 1 and not cure.bodies):
            bodies = [*labels.values()]
        joint = cure.target if len(bodies) == 1 and cure.target == finding.joint else None
        target = joint or (bodies[0].label if len(bodies) == 1 else None)
        scope = Scope(bodies, joint, finding.site, other, cure.target, timestep_s=self._timestep_s)
        return self._made(replace(cure, target=target), scope, whole=False)

    def _made(self, cure: Cure, scope: Scope, *, whole: bool) -> Candidate:
        if whole or KINDS[cure.name].whole_run:
            whole, scope, cure = True, replace(scope, joint=None), replace(cure, target=None)
        cure = replace(cure, call=cure.call or self._cures.call_of(cure))
        numbers = None if whole else tuple(body.number for body in scope.bodies)
        if cure.name == "default-motor-off":
            scope = replace(scope, commanded=self._motors())
        what = Intervention(cure, numbers, scope.joint, scope.site)
        return Candidate(what, self._cures.applied(cure, scope))

    def _motors(self) -> frozenset[tuple[int, int]]:
        """Return body and link of each joint that a call gives a motor, but no torque."""
        if self._commanded is None:
            found = set()
            for piece in self._seen.pieces():
                for each in piece.calls.commands():
                    modes = np.ravel(each.values["controlMode"])
                    which = modes != 1
                    for engine_id in np.unique(each.bodies[which]).tolist():
                        links = each.joints[which & (each.bodies == engine_id)]
                        bodies = [
                            body.number
                            for body in self._seen.bodies.values()
                            if (body.client, body.engine_id) == (each.client, engine_id)
                        ]
                        found |= {(n, link) for n in bodies for link in np.unique(links).tolist()}
            self._commanded = frozenset(found)
        return self._commanded


@dataclass(frozen=True)
class TrialRun:
    """What a trial came to; None of all where it was not run, or stopped."""

    outcome: Outcome | None
    recording: Path | None


@dataclass(frozen=True)
class RunTrial:
    """Runs one candidate, called with its number; the one after the last is the nudge."""

    program: Program
    candidates: Sequence[Candidate]
    folder: Path
    recording: Path
    """The recording of the script's own run."""
    base: Recording | None
    """The same; None where it is to be read."""
    until: float
    """The budget ends then, by the time of day [s]."""
    took_s: float
    """Time that the script's own run took [s]."""
    drawn: bool = False
    """Whether what is only for looking is recorded, too."""
    written: Sequence[Path] = ()
    """Files of the working directory that the script writes: it then runs in a copy of that."""
    runs: RunsUnderWay = field(default_factory=RunsUnderWay)

    @property
    def nudge(self) -> int:
        """The number of the nudge."""
        return len(self.candidates)

    @property
    def patience_s(self) -> float:
        """How long a run may take, of one step for each of the script's [s]."""
        return LEAST_S + LONGEST * self.took_s

    def is_late(self, number: int) -> bool:
        """Return whether there is no time left for a candidate."""
        return number != self.nudge and time.time() > self.until

    def run_of(self, number: int) -> ChangedRun | None:
        """Return what a run does otherwise; None if the engine has no such run."""
        return ChangedRun([]) if number == self.nudge else self.candidates[number].run

    def program_of(self, number: int) -> Program:
        """Return what runs, of a candidate that the engine has."""
        run = self.run_of(number)
        assert run is not None
        finer = {"finer": run.finer} if run.finer > 1 else None
        variation = {"nudge": NUDGE} if number == self.nudge else finer
        return replace(self.program, variation=variation, interventions=run.operations)

    def __call__(self, number: int) -> TrialRun:
        """Run a candidate, record it, and compare it with the script's own run."""
        run = self.run_of(number)
        if run is None or self.is_late(number):
            return TrialRun(None, None)
        program, path = self.program_of(number), self._path(number)
        until = time.time() + LEAST_S + LONGEST * self.took_s * run.finer
        with ExitStack() as stack:
            if self.written:
                copy = stack.enter_context(scratch_copy(Path.cwd().resolve(), self.written))
                program = replace(program, scratch=str(copy), target=_from_home(program))
            null = stack.enter_context(Path(os.devnull).open("wb")).fileno()

            def tell(_: float, __: int) -> None:
                if time.time() > until:
                    process.stop("interrupted")

            process = stack.enter_context(Script(program, stdout=null, stderr=null, tell=tell))
            ended = self.recorded(process, path, path.stem)
        return self._made(number, ended)

    def stop(self) -> None:
        """End what runs now."""
        self.runs.stop()

    def of_part(self, number: int, part: PartedTrial) -> TrialRun:
        """Record a candidate that has parted from another run, and compare it."""
        path, run = self._path(number), self.run_of(number)
        finer = 1 if run is None else run.finer
        until = time.time() + LEAST_S + LONGEST * self.took_s * finer
        part.tell = lambda: part.stop("interrupted") if time.time() > until else None
        return self._made(number, self.recorded(part, path, path.stem))

    def recorded(self, process: Script | PartedTrial, path: Path, name: str) -> Ended:
        """Record a run that has begun, as a variation of the script's own."""
        base = self._base
        return self.runs.recorded(
            process,
            path,
            origin={**base.origin, "variation": name},
            recording_id=hashlib.sha256(f"{base.recording_id} {name}".encode()).hexdigest()[:32],
            drawn=self.drawn,
        )

    @property
    def _base(self) -> Recording:
        from drop_physics.recording.reader import read

        return self.base or read(self.recording)

    def _made(self, number: int, ended: Ended) -> TrialRun:
        """Return what a run came to, by its recording."""
        from drop_physics.experiments.run_distance import apart
        from drop_physics.recording.reader import read

        path, base, run = self._path(number), self._base, self.run_of(number)
        if ended.how == "interrupted":
            path.unlink(missing_ok=True)
            return TrialRun(None, None)
        finer, other = 1 if run is None else run.finer, read(path)
        with np.errstate(all="ignore"):  # of states that are not finite
            far = apart(base.seen, other.seen, finer=finer)
        findings = self._findings(number, other)
        steps = sum(samples - 1 for samples in other.seen.samples.values()) // finer
        fired = number == self.nudge or finer > 1 or bool(ended.intervened)
        error = str((other.ended or {}).get("error") or "")
        began = _began(base, other)
        return TrialRun(Outcome(fired, ended.how, error, steps, findings, far, began), path)

    def _findings(self, number: int, other: Recording) -> list[Finding]:
        """Return the findings of a trial that belongs to one, or of the nudge."""
        from drop_physics.analysis.story import Story

        if number != self.nudge and not self.candidates[number].findings:
            return []
        return Story(other.seen, other.origin_and_end).analysis().findings

    def _path(self, number: int) -> Path:
        name = "nudge"
        if number != self.nudge:
            each = self.candidates[number].intervention
            text = f"{number + 1}-{each.name}" + ("" if each.value is None else f"={each.value:g}")
            name = "".join(c if c.isalnum() or c in "=.-+" else "_" for c in text)
        return self.folder / f"{name}.rrd"


def _from_home(program: Program) -> str:
    """Return a script as it is named from anywhere."""
    return program.target if program.is_module else str(Path(program.target).absolute())


def _began(base: Recording, other: Recording) -> Distance | None:
    """Return how far a body moves in a trial that stands still in the script's own run."""
    from drop_physics.experiments.run_distance import apart

    still = {number for number, body in base.seen.bodies.items() if not body.moving}
    there = other.seen.bodies
    moves = {number for number in still if number in there and there[number].moving}
    if not moves:
        return None
    tracks = (each for each in apart(other.seen, other.seen).tracks if each.number in moves)
    ways = (each.distance(each.moved, each.end_s) for each in tracks if each.moved)
    return max(ways, key=lambda each: each.value, default=None)


def first_tried(candidates: Sequence[Candidate]) -> Iterator[int]:
    """Yield the numbers of candidates in the order in which they are tried.

    Of each finding its first proposal comes before any's second.
    """
    turns: dict[int, int] = {}
    keys = []
    for which, candidate in enumerate(candidates):
        turn = min((turns.get(place, 0) for place in candidate.findings), default=1)
        for place in candidate.findings:
            turns[place] = turns.get(place, 0) + 1
        keys.append((turn, which))
    yield from (which for _, which in sorted(keys))
