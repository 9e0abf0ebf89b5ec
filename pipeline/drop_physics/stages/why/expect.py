"""Searches for single changes that make a run meet an expectation: `drop why --expect`."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from drop_physics.engines.cures import cures_of, follows, intervened, words_of, written_as
from drop_physics.engines.interventions import Operation, done
from drop_physics.engines.script import Program
from drop_physics.engines.source import SOURCE, place_of
from drop_physics.engines.watching.expression import Expression
from drop_physics.engines.watching.forks import FIRST_LINE, FIRST_USE
from drop_physics.engines.watching.single_changes import ORDERS, Change
from drop_physics.errors import ScenarioError
from drop_physics.experiments.ranking import SaidChange, ranked
from drop_physics.experiments.search import (
    NARROWED,
    BranchedTrial,
    ChangeOutcome,
    Search,
    TriedChange,
)
from drop_physics.explain.times import StepTimes
from drop_physics.messages import Message, joined
from drop_physics.recording.layer_file import trials_of
from drop_physics.stages import verbs
from drop_physics.stages.program import SEEDED_CLOCK_S, STOPPED
from drop_physics.stages.rerun.changed import plain
from drop_physics.stages.rerun.evaluated import (
    FINISHED,
    Answer,
    EvaluatedRuns,
    evaluator_of,
    outcome_of,
)
from drop_physics.stages.rerun.proposals import Proposals
from drop_physics.stages.rerun.reruns import Reruns
from drop_physics.stages.rerun.runs import Progress
from drop_physics.stages.rerun.single import SINGLE, named, seen_changes, text_of
from drop_physics.stages.why.lines import line_of
from drop_physics.stages.why.row import RowExpectation, row_of
from drop_physics.trace.episodes import episodes_of, looked_at
from drop_physics.workers import cores

if TYPE_CHECKING:
    from drop_physics.account.rows import AccountRow
    from drop_physics.recording.reader import Recording
    from drop_physics.stages.record import Recorded
    from drop_physics.stages.rerun.again import Again
    from drop_physics.trace.cures import Cure
    from drop_physics.trace.history import Seen

SOON_S = 1.0
"""Changes that meet the expectation are also tried from this long before a failure on [s]."""
CHANCE = 1e-3
"""Threshold, as a share of the gap: if nudges move the quantity by more than this, a change must
meet the expectation in nudged runs, too."""
MOST_STEPS = 2
"""Most steps of a run, as a multiple of those of the script's own run."""
MANY_TIMES, MANY_STEPS = 10, 5000
"""The same limit if the expectation reads episodes: a multiple of the steps of the script's own
run, and an upper bound [steps]. The longer run shows whether a change prevents a failure or only
delays it."""
AT_MOST_STEPS = "steps"
"""Ending of a run that was stopped by this limit."""
PARTS = {"MuJoCo": 0}
"""Number of steps after which forked runs branch off, by engine: a MuJoCo model is loaded once, and
changed before its first step. In PyBullet each run loads its own bodies."""
MOST_MOVERS = 5
"""Most changes listed if none meets the expectation."""

Source = Literal["option", "assert", "row"]
"""Origin of an expectation: `--expect`, a failed `assert` of the script, or the account: the
command to a joint, or a failed episode."""
MOST_ROWS = 6
"""Number of rows of the account, the first ones shown, that changes are related to."""
SAME_GAP = 0.05
"""Largest relative difference of a row's gap in a repeated run at which the search goes on."""


@dataclass(frozen=True)
class Expected:
    """An expectation, whether the run met it, and changes that make a run meet it."""

    text: str
    """The expectation as an expression."""
    source: Source
    """Where the expectation comes from."""
    base: ChangeOutcome
    """Outcome of the script's own run."""
    site: str | None = None
    """File and line of the `assert`."""
    row: RowExpectation | None = None
    """The row of the account that the expectation comes from."""
    runs: int = 0
    """Number of runs made."""
    seconds: float = 0.0
    """Total duration of these runs [s]."""
    tried: int = 0
    """Number of changes tried."""
    noise: float | None = None
    """How far nudges move the quantity; None if no nudged run was made."""
    chaotic: bool = False
    """Whether a nudge alone meets the expectation, or moves the quantity past it."""
    complete: bool = True
    """Whether all changes were tried before the time was up."""
    makes_true: Sequence[SaidChange] = ()
    lines: Sequence[tuple[str, str] | None] = ()
    """File and line of each change that meets the expectation, and the attribute's current text
    there; None if unknown."""
    least: Sequence[float | None] = ()
    """Least factor that meets the expectation, for each of the first changes; None if a change is
    not a factor."""
    recordings: Sequence[Path] = ()
    """Recordings of the first changes that meet the expectation."""
    latest: Sequence[int | None] = ()
    """Latest start from which each of the first changes still meets the expectation [steps]; None
    if it must begin with the run."""
    branched: Sequence[BranchedTrial] = ()
    """Outcomes of the first changes if they are made a second before the end of a failed
    episode."""
    second_before: int | None = None
    """The step after which the changes in `branched` are made; None without a failed episode."""
    steps: int = 0
    """Number of steps of the script's own run."""
    moves: Sequence[TriedChange] = ()
    """Changes that move the quantity most in the expected direction, if none meets the
    expectation."""

    @property
    def unit(self) -> str | None:
        """The unit of the quantity in the expectation; None if unknown."""
        if self.row is not None:
            return self.row.unit
        return Expression(self.text).unit

    @property
    def filmed(self) -> tuple[Path, str] | None:
        """The recording and description of the first change that meets the expectation, if any."""
        if not self.recordings:
            return None
        return self.recordings[0], self.words(self.makes_true[0].tried.change)

    def repeats(self, change: Change) -> str:
        """Return the text by which `--try` makes a change again."""
        return text_of(change)

    def does(self, change: Change) -> str:
        """Describe what a change does to its value: ×10, left out."""
        return done(change.op)

    def follows(self, change: Change) -> str:
        """Return the call that must follow a change made between two steps; empty if none."""
        return follows(change)

    def words(self, change: Change) -> str:
        """Describe a change for the user: friction of left, right ×10."""
        return words_of(change)


def parsed(text: str) -> Expression:
    """Parse the text of an expectation.

    Raises
    ------
    ScenarioError
        If the text is not a valid expectation.
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


def own_of(answer: Answer, asked: verbs.WhyArguments) -> Expected | None:
    """Return a script's expectation with its outcome in the unchanged run; None without one.

    Parameters
    ----------
    answer
        The expectation as evaluated in the script's own run.
    asked
        The arguments of `drop why`.

    Raises
    ------
    ScenarioError
        If the expectation cannot be evaluated at the end of the run.
    """
    assertion = answer["assertion"]
    base = replace(outcome_of(answer, ended_well=True), holds=bool(answer["holds"]))
    if asked.expect is not None:
        _check(answer["error"], asked.target)
        return Expected(asked.expect, "option", base)
    if assertion is None:
        return None
    site = f"{assertion['file']}:{assertion['line']}"
    return Expected(assertion["text"], "assert", base, site)


def of_row(row: RowExpectation) -> Expected:
    """Return the expectation that a row of the account suggests: that the request be fulfilled."""
    gap = math.nan if row.gap is None else row.gap
    return Expected(row.text, "row", ChangeOutcome(False, -gap, gap), row=row)


def _check(error: Mapping[str, Any] | None, target: str) -> None:
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


def searched(
    own: Expected,
    asked: verbs.WhyArguments,
    recorded: Recorded,
    again: Again,
    *,
    python: str,
    until: float,
    base: Recording,
    account: Sequence[AccountRow],
    remedies: Sequence[Change] = (),
    cures: Sequence[Cure] = (),
) -> Expected:
    """Search for changes that make a failed expectation pass; return the expectation with them.

    Parameters
    ----------
    own
        The expectation, and its outcome in the script's own run.
    asked
        The arguments of `drop why`.
    recorded, again
        The script's own run, and the way to repeat it.
    python
        Path of the Python interpreter that runs the script.
    until
        Time after which no further run is started, in Unix time [s].
    base
        The recording of the script's own run. Runs with the first changes that meet the expectation
        are recorded beside it.
    account
        The account of the script's own run.
    remedies
        The fixes that findings suggest, which are tried first.
    cures
        The changes to try; if empty, all possible changes.

    Raises
    ------
    DropError
        If the script cannot be run again.
    """
    began = time.monotonic()
    made_steps = recorded.samples - 1
    evaluator = evaluator_of(own.text, asserted=own.source == "assert")
    program = Program(
        asked.target,
        tuple(map(str, asked.arguments)),
        python,
        asked.is_module,
        made_steps if recorded.ended in STOPPED else _most_steps(own, made_steps),
        seed=asked.seed,
        of_first=True,
        begins_s=SEEDED_CLOCK_S,
        streams=False,
        evaluator=evaluator,
    )
    at = PARTS.get(recorded.engine, FIRST_USE)
    of_text = Reruns(program, again, at=FIRST_LINE)
    with Reruns(program, again, at=at) as reruns, ExitStack() as later:
        at_once = 1 if again.alone else asked.jobs or cores()
        trials = EvaluatedRuns(program, reruns, of_text, _ends(own, recorded), until, at_once)
        asked_for = partial(_asked_for, cures, base) if cures else None
        found = _searched(
            trials, recorded.engine, own.row, later, account, remedies, asked_for, asked.progress
        )
        first = [each.tried.change for each in found.get("makes_true", ())[:NARROWED]]
        failure = _failure_of(base.seen)
        if failure is not None and not Expression(own.text).reads_whole_episodes:
            begins, ends, played = failure
            found["branched"] = trials.branched_of(first, begins, ends, played)
            found["second_before"] = begins
        latest = trials.latest_of(first, made_steps, [] if failure is None else failure[:1])
        found |= {"latest": latest, "steps": made_steps}
        recordings = _recorded(trials, found.get("makes_true", ()), base, drawn=asked.drawn)
    found |= {"recordings": recordings}
    return replace(own, **found, runs=trials.made, seconds=time.monotonic() - began)


def _failure_of(seen: Seen) -> tuple[int, int, list[Operation]] | None:
    """Return the last second of a failed episode, and operations that repeat its commands.

    The second is given by its first and last step. The result is None without a failed episode, and
    for a script with several simulations, whose steps are counted together.
    """
    episode = looked_at(episodes_of(seen), None)
    if episode is None or len(seen.samples) > 1:
        return None
    times = StepTimes(seen, episode.client)
    step = times.nearest(times.of(episode.last) - SOON_S, episode.first, episode.last)
    first = episode.first if step is None else step
    played = cures_of(seen.engine).played(seen, episode.client, first, episode.last)
    return first, episode.last, played


def _most_steps(own: Expected, made: int) -> int:
    """Return the step at which changed runs are stopped; the unchanged run made `made` steps."""
    many = min(MANY_TIMES * made, MANY_STEPS) if Expression(own.text).reads_episodes else 0
    return max(MOST_STEPS * made, many)


def _ends(own: Expected, recorded: Recorded) -> frozenset[str]:
    """Return the ways in which a run may end so that its expectation counts as checked."""
    if own.source == "assert":  # where an assert fails, the script does: a change lets it end
        return frozenset({FINISHED})
    ends = frozenset({FINISHED, recorded.ended})
    # An episode that goes on where it ended before takes more steps than the script's own run.
    return ends | {AT_MOST_STEPS} if Expression(own.text).reads_episodes else ends


def _searched(
    trials: EvaluatedRuns,
    engine: str,
    row: RowExpectation | None,
    later: ExitStack,
    account: Sequence[AccountRow],
    remedies: Sequence[Change],
    asked_for: Callable[[Sequence[Change]], list[Change]] | None,
    progress: Progress,
) -> dict[str, Any]:
    """Return the changes found; nothing if a repeated run does not reproduce the failure."""
    seen_run = seen_changes(trials, engine)
    seen, base = seen_run.answer, outcome_of(seen_run.answer, ended_well=True)
    if row is not None:
        short = row.gap is None or math.isclose(base.value, row.gap, rel_tol=SAME_GAP)
        if base.holds or seen["error"] is not None or not short:
            return {"complete": False}
    nudged = trials.nudges()
    noise = max(map(base.off, nudged), default=0.0)
    if any(each.holds or base.is_across(each) for each in nudged):
        return {"noise": noise, "chaotic": True}
    search = Search(base, trials.all_of, noise)
    changes, its_text = (
        sorted(each, key=likely) for each in (seen_run.of_engine, seen_run.of_text)
    )
    if row is not None:  # what acts on a term of it first
        changes.sort(key=lambda each: not row.names(each))
    if asked_for is not None:
        changes, its_text = asked_for([*changes, *its_text]), []
    else:
        changes = [*remedies, *changes]
    search.told = lambda made, true: progress(made, true, len(changes) + len(its_text))
    search.all_of(changes)
    if its_text and search.complete:
        later.enter_context(trials.of_text)
        search.all_of(its_text)
    said = ranked(search.tried, row_of=partial(_row_of, row, account))
    if noise > CHANCE * abs(base.margin):  # what it does may be chance
        said = _standing(trials, said)
    said = _coincidences_last(search, said)
    texts = {each.shown: each.text.decode(errors="replace") for each in seen_run.texts}
    return {
        "noise": noise,
        "tried": len(search.tried),
        "complete": search.complete,
        "makes_true": said,
        "least": [
            None if each.is_alone else search.least_of(each.tried) for each in said[:NARROWED]
        ],
        "moves": [] if said else search.movers()[:MOST_MOVERS],
        "lines": [_line_of(each, texts) for each in said],
    }


def _asked_for(cures: Sequence[Cure], base: Recording, changes: Sequence[Change]) -> list[Change]:
    """Return the changes that `--try` names: single changes, and changes from the table.

    Raises
    ------
    ScenarioError
        If a name matches no change.
    """
    proposals = Proposals(base.seen, [], cures_of(base.seen.engine))
    return [
        named(cure.call, changes)
        if cure.name == SINGLE
        else intervened(cure.call, None, cure.call, proposals.required(cure, "--try"))
        for cure in cures
    ]


def _row_of(row: RowExpectation | None, rows: Sequence[AccountRow], change: Change) -> str | None:
    """Describe the account's row that a change acts on; the expectation's row if it is that one."""
    if row is not None and row.names(change):
        return row.words
    found = row_of(change, rows[:MOST_ROWS])
    return None if found is None else joined(" ", [found.who, found.told])


def _line_of(said: SaidChange, texts: Mapping[str, str]) -> tuple[str, str] | None:
    """Return where a user would edit the source to make a change, and the current text there."""
    change = said.tried.change
    if change.site is not None:
        return f"{change.site[0]}:{change.site[1]}", ""
    written = written_as(change)
    found = None if written is None else line_of(texts, change.of, *written)
    of_text = (each.change for each in said.alike if each.change.engine == SOURCE)
    return next(map(place_of, of_text), None) if found is None else found


def _recorded(
    runs: EvaluatedRuns, said: Sequence[SaidChange], base: Recording, *, drawn: bool
) -> list[Path]:
    """Record runs with the first changes that pass; return the paths of the recordings."""
    folder, paths = trials_of(base.path), []
    for number, each in enumerate(said[:NARROWED], 1):
        change = each.tried.change
        name = f"{number}-{change.change}{change.op}"
        path = folder / f"{plain(name)}.rrd"
        runs.recorded(change, path, base, name, drawn=drawn)
        paths.append(path)
    return paths


def _standing(trials: EvaluatedRuns, said: Sequence[SaidChange]) -> list[SaidChange]:
    """Remove those of the first changes that fail if the start is slightly displaced."""
    standing: list[SaidChange] = []
    for number, each in enumerate(said):
        if len(standing) == NARROWED:
            return [*standing, *said[number:]]
        if trials.stands(each.tried.change):
            standing.append(replace(each, also=()))
    return standing


def _coincidences_last(search: Search, said: Sequence[SaidChange]) -> list[SaidChange]:
    """Move those of the first changes that fail with a slightly different factor to the end."""
    standing: list[SaidChange] = []
    alone: list[SaidChange] = []
    for number, each in enumerate(said):
        if len(standing) == NARROWED:
            return [*standing, *said[number:], *alone]
        if search.is_alone(each.tried):
            alone.append(replace(each, is_alone=True))
        else:
            standing.append(each)
    return [*standing, *alone]


def likely(change: Change) -> int:
    """Return a sort key for changes: values that are most often the cause come first."""
    op = change.op
    if isinstance(change.how[1], Mapping):  # a call that is added, because it is often left out
        return 0
    if change.change.startswith("flag."):  # of an engine's inner workings, and seldom to blame
        return 3
    if op in ("left-out", "default", "=default", "undone", "each-step") or op[0] == "^":
        return 1
    if op in ("*10", "*0.1"):
        return 2
    return {"*-1": 4, **dict.fromkeys(("held", "late", *ORDERS), 5)}.get(op, 3)
