"""Say which single change of a script makes true what was expected of it: `drop why --expect`."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drop_physics.engines.cures import TABLES
from drop_physics.engines.script import Program
from drop_physics.engines.watching.expression import Expression
from drop_physics.engines.watching.forks import FIRST_USE
from drop_physics.engines.watching.single_changes import Change, change_of
from drop_physics.errors import DropError, ScenarioError
from drop_physics.experiments.motion import motion_of
from drop_physics.experiments.ranking import Said, ranked
from drop_physics.experiments.search import NARROWED, Outcome, Search, Tried
from drop_physics.messages import Message
from drop_physics.printable import Printable
from drop_physics.stages import verbs
from drop_physics.stages.interpreter import interpreter_of
from drop_physics.stages.program import SEEDED_CLOCK_S, STOPPED
from drop_physics.stages.record import record_script
from drop_physics.stages.rerun.again import again_of
from drop_physics.stages.rerun.reruns import Reruns
from drop_physics.stages.rerun.runs import only_of
from drop_physics.stages.why.asked import checked_bounds, place_of
from drop_physics.sweeping.engines import in_threads
from drop_physics.trace.cures import NUDGE
from drop_physics.workers import cores

if TYPE_CHECKING:
    from drop_physics.engines.fork_server import Fork
    from drop_physics.engines.script import Script

NUDGES = 5
"""Runs whose bodies are moved by 1e-9 before the first step: if one of them comes out as expected,
chance does it."""
CHANCE = 1e-3
"""Where nudges move the quantity by more than this share of what it is short of, a change has to
make it true in nudged runs, too."""
CONFIRMS = 2
"""The number of these."""
PARTS = {"MuJoCo": 0}
"""After how many steps runs part from one another, by engine: a model of MuJoCo is loaded once, and
is changed before its first step. In PyBullet each run loads its own bodies."""
MOST_MOVERS = 5
"""Changes that are named where none makes it true."""
FINISHED = "finished"

Answer = Mapping[str, Any]


@dataclass(frozen=True)
class Expected(Printable, reported_by="drop_physics.report.why_expect"):
    """What was expected of a script, what came, and which changes make it true."""

    script: str
    recording: Path
    """The recording of its own run."""
    ended: str
    runs: int
    """How many were made besides its own."""
    seconds: float
    """Time that all of them took [s]."""
    text: str
    """What was expected."""
    source: str
    """Where that is from: `option`."""
    base: Outcome
    """The outcome of its own run."""
    tried: int = 0
    """The number of changes that were tried."""
    noise: float | None = None
    """How far nudges move the quantity; None where none was made."""
    chaotic: bool = False
    """Whether a nudge makes it true."""
    complete: bool = True
    """Whether no change was left out for want of time."""
    makes_true: Sequence[Said] = ()
    least: Sequence[float | None] = ()
    """The least factor of each of the first that makes it true; None where it is no factor."""
    moves: Sequence[Tried] = ()
    """What moves the quantity most towards what is expected, if nothing makes it true."""

    def filmed(self) -> tuple[Path, str] | None:
        """Return the recording to see beside the script's own run, and its title: none so far."""
        return None

    def words(self, change: Change) -> str:
        """Return a change in words, as its user would say it: friction of left, right ×10."""
        return TABLES[change.engine].words_of(change)


def parsed(text: str) -> Expression:
    """Return an expectation as an expression.

    Raises
    ------
    ScenarioError
        If it is none.
    """
    try:
        return Expression(text)
    except (SyntaxError, ValueError) as error:  # ValueError: it has a null character
        raise ScenarioError(
            "--expect takes a Python expression such as {example}; got {value!r}: {reason}",
            example="z('cube') > 0.3",
            value=text,
            reason=getattr(error, "msg", None) or str(error),
        ) from None


def evaluator_of(text: str, rows: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Return what evaluates an expectation in a run, as a program takes it."""
    return {"module": "expected", "name": "Expected", "arguments": {"text": text, "rows": rows}}


def outcome_of(answer: Answer, *, ended_well: bool) -> Outcome:
    """Return the outcome of a run from what it answers."""
    margin, value = answer["margin"], answer["value"]
    return Outcome(
        holds=bool(answer["holds"] and answer["finite"] and ended_well),
        margin=-math.inf if margin is None else margin,
        value=math.nan if value is None else value,
        motion=[motion_of(each) for each in answer["motion"]],
    )


NOT_MADE = Outcome(holds=False, margin=-math.inf, value=math.nan)
"""The outcome of a run that was stopped, or has died."""


@dataclass
class Trials:
    """Runs of a script in which an expectation is evaluated, and nothing is recorded.

    Parameters
    ----------
    program
        The script, as it is run again.
    reruns
        What makes the runs.
    ended
        How its own run ended.
    until
        When no run begins any more, by the time of day [s].
    jobs
        How many are made at once.
    """

    program: Program
    reruns: Reruns
    ended: str
    until: float
    jobs: int
    made: int = 0
    """How many were made."""
    _under_way: set[Script | Fork] = field(default_factory=set)

    def answered(self, **changed: object) -> tuple[Answer | None, str]:
        """Make a run with something changed; return what it answers, and how it ended."""
        program = replace(self.program, **changed)  # type: ignore[arg-type]
        with self.reruns.begun(program) as process:
            self._under_way.add(process)
            for _ in process.events():
                pass
            self._under_way.discard(process)
            ended = process.ending().how
        self.made += 1
        answer, error = process.decoder.answer or (None, "")
        return answer, error or ended

    def changed(self, change: Change) -> Outcome | None:
        """Return the outcome of a run with a change; None where no time is left."""
        if time.time() > self.until:
            return None
        return self._outcome(**self._trial_of(change))

    def nudged(self, number: int, change: Change | None = None) -> Outcome | None:
        """Return the outcome of a run, or one with a change, moved by next to nothing."""
        if time.time() > self.until:
            return None
        trial = {} if change is None else self._trial_of(change)
        nudge = {"nudge": NUDGE, "seed": number}
        return self._outcome(**{**trial, "variation": {**(trial.get("variation") or {}), **nudge}})

    def _trial_of(self, change: Change) -> dict[str, Any]:
        trial = TABLES[change.engine].trial_of(change)
        return {"interventions": trial["interventions"], "variation": trial["variation"] or None}

    def _outcome(self, **changed: object) -> Outcome:
        answer, ended = self.answered(**changed)
        if answer is None:
            return NOT_MADE
        return outcome_of(answer, ended_well=ended in (FINISHED, self.ended, *STOPPED))

    def all_of(self, changes: Iterator[Change]) -> Iterable[tuple[Change, Outcome | None]]:
        """Make runs with changes, and yield their outcomes as they come."""
        return in_threads(self.changed, changes, jobs=self.jobs, stop=self.stop)

    def nudges(self, change: Change | None = None, number: int = NUDGES) -> list[Outcome]:
        """Return the outcomes of nudged runs, of the script or with a change."""
        work = partial(self.nudged, change=change)
        made = in_threads(work, range(number), jobs=self.jobs, stop=self.stop)
        return [outcome for _, outcome in made if outcome is not None]

    def stands(self, change: Change) -> bool:
        """Return whether a change makes it true, too, where everything is nudged."""
        return all(each.holds for each in self.nudges(change, CONFIRMS))

    def stop(self) -> None:
        """Stop the runs under way."""
        for process in [*self._under_way]:
            process.stop("interrupted")


def expect(asked: verbs.WhyArguments, text: str) -> Expected:
    """Record a script, and find single changes that make true what was expected of it.

    Parameters
    ----------
    asked
        As of `why`.
    text
        What is expected, as a Python expression.

    Raises
    ------
    ScenarioError
        If the expectation is no expression, or names what the script does not have.
    DropError
        If the script makes no step, or cannot be run again.
    """
    began = time.monotonic()
    checked_bounds(asked)
    parsed(text)
    placed, force = place_of(asked)
    python = interpreter_of(
        asked.target, is_module=asked.is_module, given=asked.python, note=asked.note
    )
    recorded = record_script(
        asked.target,
        asked.arguments,
        is_module=asked.is_module,
        out=placed,
        steps=asked.steps,
        duration_s=asked.duration_s,
        seed=asked.seed,
        python=python,
        force=force,
        listens=True,
        explain=False,
        evaluator=evaluator_of(text),
        stdout=asked.stdout,
        note=asked.note,
    )
    if recorded.ended == "interrupted":
        raise KeyboardInterrupt
    made_steps = recorded.samples - 1
    if made_steps < 1:
        raise DropError(
            "{script} makes no step, so there is nothing to expect of it; give it the arguments "
            "with which it steps",
            script=asked.target,
        )
    answer = _answered(recorded.answer, asked.target)
    own = Expected(
        asked.target,
        recorded.recording,
        recorded.ended,
        runs=0,
        seconds=time.monotonic() - began,
        text=text,
        source="option",
        base=replace(outcome_of(answer, ended_well=True), holds=bool(answer["holds"])),
    )
    if own.base.holds:
        return own
    if recorded.beside is not None:
        asked.note(only_of(recorded.engine))
    rerun = again_of(
        asked.target,
        recorded.reached,
        is_module=asked.is_module,
        took_s=recorded.wall_s,
        anyway=asked.again,
    )
    program = Program(
        asked.target,
        tuple(map(str, asked.arguments)),
        python,
        asked.is_module,
        made_steps if recorded.ended in STOPPED else 2 * made_steps,
        seed=asked.seed,
        of_first=True,
        begins_s=SEEDED_CLOCK_S,
        streams=False,
        evaluator=evaluator_of(text),
    )
    until = time.time() + asked.budget_s
    at = PARTS.get(recorded.engine, FIRST_USE)
    with Reruns(program, rerun, at=at) as reruns:
        at_once = 1 if rerun.alone else asked.jobs or cores()
        trials = Trials(program, reruns, recorded.ended, until, at_once)
        found = _searched(trials, text, recorded.engine, asked.progress)
    return replace(own, **found, runs=trials.made, seconds=time.monotonic() - began)


def _answered(told: tuple[Any, str] | None, target: str) -> Answer:
    """Return what a script's own run answers.

    Raises
    ------
    ScenarioError
        If the expectation cannot be evaluated at its end.
    """
    answer, why = told or (None, "")
    if answer is None:
        raise DropError(
            "{script} has ended before --expect was evaluated: {reason}",
            script=target,
            reason=why or Message("its process ended"),
        )
    error = answer["error"]
    if error is not None and error["unknown"] is not None:
        raise ScenarioError(
            "--expect names {name}, which {script} does not have at its end; the nearest names: "
            "{nearest}",
            name=error["unknown"],
            script=target,
            nearest=", ".join(error["nearest"]) or Message("there is none"),
        )
    if error is not None:
        raise ScenarioError(
            "--expect cannot be evaluated at the end of {script}: {kind}: {reason}",
            script=target,
            kind=error["kind"],
            reason=error["text"],
        )
    checked: Answer = answer
    return checked


def _searched(
    trials: Trials, text: str, engine: str, progress: Callable[..., None]
) -> dict[str, Any]:
    """Return what a search has found."""
    rows = {name: each.tried for name, each in TABLES.items()}
    seen, ended = trials.answered(
        interventions=TABLES[engine].sees, evaluator=evaluator_of(text, rows)
    )
    if seen is None or seen["changes"] is None:
        raise DropError(
            "{script} cannot be run again as it was: {reason}",
            script=trials.program.target,
            reason=ended,
        )
    base = outcome_of(seen, ended_well=True)
    nudged = trials.nudges()
    far = [abs(each.margin - base.margin) for each in nudged]
    noise = max((each for each in far if math.isfinite(each)), default=0.0)
    if any(each.holds for each in nudged):
        return {"noise": noise, "chaotic": True}
    search = Search(base, trials.all_of, noise)
    changes = sorted(map(change_of, seen["changes"]), key=_likely)
    search.told = lambda tried, true: progress(tried, true, len(changes))
    search.all_of(changes)
    said = ranked(search.tried)
    if noise > CHANCE * abs(base.margin):  # what it does may be chance
        said = _standing(trials, said)
    return {
        "noise": noise,
        "tried": len(search.tried),
        "complete": search.complete,
        "makes_true": said,
        "least": [search.least_of(each.tried) for each in said[:NARROWED]],
        "moves": [] if said else search.movers()[:MOST_MOVERS],
    }


def _standing(trials: Trials, said: Sequence[Said]) -> list[Said]:
    """Return outcomes without those, among the first ones, that a nudge undoes."""
    standing: list[Said] = []
    for number, each in enumerate(said):
        if len(standing) == NARROWED:
            return [*standing, *said[number:]]
        if trials.stands(each.tried.change):
            standing.append(each)
    return standing


def _likely(change: Change) -> int:
    """Order changes by how often what they change is the cause: the likely ones first."""
    op = change.op
    if isinstance(change.how[1], Mapping):  # a call that is added, because it is often left out
        return 0
    if op in ("left-out", "default", "=default", "undone") or op[0] == "^":
        return 1
    if op in ("*10", "*0.1"):
        return 2
    return {"*-1": 4, "held": 5, "late": 5}.get(op, 3)
