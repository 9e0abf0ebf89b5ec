"""The command `why`: runs a script again with one change at a time, to prove causes by trials."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from rich.filesize import decimal

from drop_physics.engines.cures import cures_of, intervened
from drop_physics.engines.script import Program
from drop_physics.errors import DropError, ScenarioError
from drop_physics.experiments.interventions import Intervention
from drop_physics.files.whole import written_whole
from drop_physics.messages import Message
from drop_physics.printable import Printable
from drop_physics.recording.layer_file import VERDICTS, forget_trials, trials_of
from drop_physics.stages import verbs
from drop_physics.stages.interpreter import interpreter_of
from drop_physics.stages.program import SEEDED_CLOCK_S, STOPPED
from drop_physics.stages.record import record_script
from drop_physics.stages.rerun.again import LONGEST, again_of
from drop_physics.stages.rerun.asked import cures_of as cures_asked
from drop_physics.stages.rerun.changed import run_changed
from drop_physics.stages.rerun.evaluated import evaluator_of
from drop_physics.stages.rerun.no_step import no_step
from drop_physics.stages.rerun.proposals import Candidate, Proposals
from drop_physics.stages.rerun.runs import only_of
from drop_physics.stages.rerun.single import possible
from drop_physics.stages.verbs.taken import takes_those_of
from drop_physics.stages.why.asked import checked_bounds, place_of
from drop_physics.stages.why.expect import Expected, of_row, own_of, parsed, searched
from drop_physics.stages.why.row import row_expectation
from drop_physics.stages.why.shares import shares
from drop_physics.stages.why.trials import RunTrial, TrialRun, first_tried
from drop_physics.workers import cores

if TYPE_CHECKING:
    from drop_physics.experiments.run_distance import Distance
    from drop_physics.experiments.shares import Shares
    from drop_physics.experiments.verdicts import Outcome, TrialVerdict, Verdict
    from drop_physics.recording.reader import Recording
    from drop_physics.rules.answer import Finding
    from drop_physics.stages.record import Recorded

MOST = 8
"""Most results reported for a script."""
MOST_KEPT = 12
"""Number of trials, the best ones, whose recordings are kept: a trial's recording is as large as
that of the script's own run."""
LARGE_BYTES = 10_000_000
"""Total size of trial recordings above which a note states the size [bytes]."""
TAKES = 2.0
"""Time limit of a trial and its comparison, as a multiple of the duration of the script's own
run."""


@dataclass(frozen=True)
class Tried:
    """One trial run: a change, and its effect."""

    intervention: Intervention
    shown: TrialVerdict | None
    """Effect on the finding; None for a trial without a finding, or one that was not run."""
    verdict: Verdict
    moved: Distance | None
    """How far the trial moves the outcome; None if a nudge moves the outcome as much, or nothing
    moved."""
    same: bool
    """Whether all positions are the same, bit for bit."""
    recording: Path | None


@dataclass(frozen=True)
class Proved:
    """A finding, and the trial runs that test its cause."""

    finding: Finding
    verdict: Verdict
    """The best verdict of the trials; `untried` without trials."""
    tried: list[Tried]


@dataclass(frozen=True)
class Why(Printable, reported_by="drop_physics.report.why"):
    """Result of `drop why`: the trial runs of a script."""

    script: str
    recording: Path
    """Path of the recording of the script's own run."""
    ended: str
    steps: int
    runs: int
    """Number of runs made besides the script's own."""
    seconds: float
    """Total duration of these runs [s]."""
    noise: Distance | None
    """How far a nudge of 1e-9 moves the outcome; None if no nudged run was made."""
    findings: list[Proved]
    hangs_on: list[Tried]
    """Trials sorted by how far they move the outcome, whatever they show about findings."""
    no_effect: list[Intervention]
    """Calls and arguments that can be left out without any change, bit for bit."""
    shares: Shares | None
    """One number of the outcome as a sum over its causes; None with fewer than two causes."""
    sources: Mapping[str, Path] = field(default_factory=dict)
    """Paths of the source files that findings cite, where they are found."""
    expected: Expected | None = None
    """The expectation, with the changes that meet it; None without an expectation."""

    def filmed(self) -> tuple[Path, str] | None:
        """Return the recording to show beside the unchanged run, with a caption.

        The recording shows the cure that moves the outcome most, otherwise the trial that moves the
        outcome most; None without trials.
        """
        if self.expected is not None and self.expected.filmed is not None:
            return self.expected.filmed
        tried = [each for proved in self.findings for each in proved.tried if each.recording]
        cures = [each for each in tried if each.verdict == "cured"]
        most = max(cures or tried, key=lambda e: e.moved.value if e.moved else 0.0, default=None)
        if most is None or most.recording is None:
            return None
        return most.recording, most.intervention.call


@takes_those_of(verbs.WhyArguments)
def why(asked: verbs.WhyArguments) -> Why:
    """Record a script, make a trial run with each change that findings suggest, and compare.

    With an expectation, generic changes are tried after the fixes that findings suggest.

    Raises
    ------
    ScenarioError
        If a limit is out of range, or `about` or `tries` match no finding or change.
    OutputError
        If a recording cannot be written.
    DropError
        If the interpreter cannot be started, or the script makes no step or cannot be run again.
    """
    began = time.monotonic()
    checked_bounds(asked)
    if asked.expect is not None:
        parsed(asked.expect)
    cures = cures_asked(asked.tries, "--try", whole=False)
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
        explain=asked.expect is None,
        evaluator=evaluator_of(asked.expect),
        episodes="all",
        stdout=asked.stdout,
        note=asked.note,
    )
    made_steps = recorded.samples - 1
    if recorded.ended == "interrupted":
        raise KeyboardInterrupt
    if made_steps < 1:
        raise no_step(asked.target, recorded.ended)
    if recorded.answer is None and asked.expect is not None:
        raise DropError("{script} has ended before --expect was evaluated", script=asked.target)
    expected = None
    if recorded.answer is not None and recorded.answer[0] is not None:
        expected = own_of(recorded.answer[0], asked)
    if expected is not None and expected.base.holds:
        return _only(expected, recorded, time.monotonic() - began)
    from drop_physics.recording.reader import read
    from drop_physics.rules.choice import EVERY
    from drop_physics.stages.analyze import analyze

    base = read(recorded.recording)
    if recorded.beside is not None:
        asked.note(only_of(base.seen.engine))
    rerun = again_of(
        asked.target,
        recorded.reached,
        is_module=asked.is_module,
        took_s=recorded.wall_s,
        anyway=asked.again,
    )
    until = time.time() - (time.monotonic() - began) + asked.budget_s
    folder = trials_of(recorded.recording)
    forget_trials(recorded.recording)
    folder.mkdir(exist_ok=True)

    analysis = analyze(recorded.recording, choice=asked.choice or EVERY, script=Path(asked.target))
    findings = analysis.findings
    all_steps = sum(samples - 1 for samples in base.seen.samples.values())
    program = Program(
        asked.target,
        tuple(map(str, asked.arguments)),
        python,
        asked.is_module,
        all_steps + 2 * (recorded.ended not in STOPPED),  # may make one more, and end by itself
        seed=asked.seed,
        of_first=True,
        begins_s=SEEDED_CLOCK_S,
        explain=True,
    )
    proposals = Proposals(
        base.seen,
        findings,
        cures_of(base.seen.engine),
        lambda: possible(program, rerun, base.seen.engine.partition(" ")[0]),
    )
    if expected is not None:
        expected = searched(
            expected,
            asked,
            recorded,
            rerun,
            cures=cures,
            python=python,
            until=until,
            base=base,
            account=analysis.account,
            remedies=[
                intervened(made.name, made.value, made.call, each.run)
                for each in proposals.of_findings()
                for made in (each.intervention,)
                if each.run is not None
            ],
        )
        if asked.expect is not None:
            result = _only(expected, recorded, time.monotonic() - began)
            _keep(folder, result, base.recording_id)
            return result
    chosen = _about(findings, asked.about)
    candidates_found = False
    if asked.tries:
        candidates = proposals.asked(cures, chosen)
    else:
        candidates = [each for each in proposals.of_findings() if {*each.findings} & {*chosen}]
        candidates_found = bool(candidates)
        known = {each.intervention for each in candidates}
        damped = any(
            flight.terms_m is not None and any(flight.terms_m.damping)
            for body in analysis.bodies
            for flight in body.flights
        )
        usual = proposals.always(damped=damped)
        if any(each.cure.name == "damping" for each in known):
            usual = [each for each in usual if each.intervention.name != "damping"]
        candidates += [each for each in usual if each.intervention not in known]
    ablated = proposals.left_out() if asked.ablate else []
    order = [*first_tried([*candidates, *ablated])]
    spent_s = time.monotonic() - began
    work = RunTrial(
        program,
        [*candidates, *ablated],
        folder,
        recorded.recording,
        base,
        rerun,
        asked.drawn,
        until=until,
    )

    def run(which: RunTrial, numbers: Sequence[int]) -> dict[int, TrialRun]:
        """Return the results of trials; those not made before Ctrl-C are missing."""
        made: dict[int, TrialRun] = {}
        try:
            if not interrupted:
                run_changed(
                    which,
                    numbers,
                    jobs=asked.jobs or cores(),
                    ray=asked.ray,
                    progress=asked.progress,
                    entered=made.__setitem__,
                )
        except KeyboardInterrupt:
            interrupted.append(True)
        return {number: made.get(number) or which.not_made(number) for number in numbers}

    own, interrupted = _own(base, findings), list[bool]()
    try:
        done = run(work, [*order[:1], work.nudge, work.unchanged, *order[1:]])
        summed = shares(work, done, run, own)
    except BaseException:  # half a trial is none
        forget_trials(recorded.recording)
        raise
    if interrupted:
        asked.note(Message("interrupted: this is what was found until then"))
    second = done[work.unchanged].outcome
    if second is not None and second.apart.differ:
        asked.note(
            Message(
                "two runs of {script} differ though nothing is changed and its random numbers are "
                "seeded: what trials show may be chance; drop record --twice says from which step "
                "on",
                script=asked.target,
            )
        )
    result = _why(
        asked.target,
        base.path,
        recorded.ended,
        own,
        work,
        done,
        chosen,
        summed,
        time.monotonic() - began,
    )
    if expected is None and not interrupted and not _asks_else(asked):
        row = None if candidates_found else row_expectation(analysis.account, analysis.episodes)
        if row is not None and time.time() < until:
            found = searched(
                of_row(row),
                asked,
                recorded,
                rerun,
                python=python,
                until=until,
                base=base,
                account=analysis.account,
            )
            expected = found if found.tried or found.chaotic else None
    result = replace(result, expected=expected)
    _keep(folder, result, base.recording_id)
    lacking = {
        work.candidates[n].intervention.short: made.stopped
        for n, made in done.items()
        if n < work.nudge and made.outcome is None and work.run_of(n) is not None
    }
    stopped = [name for name, slow in lacking.items() if slow]
    if stopped:
        asked.note(
            Message(
                "stopped, as a run took over {times:g} times the script's own: {names}",
                times=LONGEST,
                names=", ".join(stopped),
            )
        )
    untried = [name for name in lacking if name not in stopped]
    if untried and not interrupted:
        enough_s = spent_s + TAKES * max(spent_s, 1.0) * (len(order) + 2)
        asked.note(
            Message(
                "not tried within {budget:g} s: {names}; for all: drop why --budget {enough:.0f} "
                "{script}",
                budget=asked.budget_s,
                names=", ".join(untried),
                enough=enough_s,
                script=asked.target,
            )
        )
    held = sum(path.stat().st_size for path in folder.glob("*.rrd"))
    if held > LARGE_BYTES:
        asked.note(
            Message(
                "the recordings of trials in {folder} take {size}",
                folder=folder,
                size=decimal(held),
            )
        )
    return replace(result, sources=analysis.sources)


def _asks_else(asked: verbs.WhyArguments) -> bool:
    """Return whether the user named changes to try: `--try`, `--ablate` or `--about`."""
    return bool(asked.tries or asked.ablate or asked.about)


def _only(expected: Expected, recorded: Recorded, seconds: float) -> Why:
    """Return a result with an expectation, but without trials of findings."""
    return Why(
        expected=expected,
        script=recorded.script,
        recording=recorded.recording,
        ended=recorded.ended,
        steps=recorded.samples - 1,
        runs=expected.runs,
        seconds=seconds,
        noise=None,
        findings=[],
        hangs_on=[],
        no_effect=[],
        shares=None,
    )


def _about(findings: Sequence[Finding], about: str | None) -> list[int]:
    """Return the indices of the findings that match `about`.

    Raises
    ------
    ScenarioError
        If no finding matches.
    """
    places = [
        place
        for place, each in enumerate(findings)
        if about in (None, each.code, each.reason, each.body, each.joint)
        or (each.body or "").partition("_")[2] == about
    ]
    if about is not None and not places:
        known = dict.fromkeys(
            name
            for each in findings
            for name in (each.code, each.body, each.joint)
            if name is not None
        )
        raise ScenarioError(
            "--about takes the code, body or joint of a finding: {known}; got {about!r}",
            known=", ".join(known) or "there is none",
            about=about,
        )
    return places


def _why(
    target: str,
    recording: Path,
    ended: str,
    own: Outcome,
    work: RunTrial,
    done: dict[int, TrialRun],
    chosen: Sequence[int],
    summed: Shares | None,
    seconds: float,
) -> Why:
    from drop_physics.experiments.verdicts import best, judged, moved

    findings = own.findings
    nudge = done[work.nudge].outcome
    noise = None if nudge is None else max(nudge.apart.end, key=lambda e: e.value, default=None)
    tried: dict[int, list[Tried]] = {place: [] for place in range(len(findings))}
    also: dict[int, list[Tried]] = {}
    hangs_on, no_effect = [], []
    for number, candidate in enumerate(work.candidates):
        made = done[number]
        if made.outcome is None:
            each = _tried(candidate, made, None, "untried", None)
            for place in candidate.findings:
                tried[place].append(each)
            continue
        began = made.outcome.began
        far = began or moved(made.outcome.apart, None if nudge is None else nudge.apart)
        for place in candidate.findings:
            verdict = judged(findings[place], made.outcome, base=own, nudge=nudge)
            its = began or moved(
                made.outcome.apart, None if nudge is None else nudge.apart, findings[place]
            )
            tried[place].append(_tried(candidate, made, verdict, verdict.verdict, its))
        for place in _others_cured(findings, candidate, made.outcome, own, nudge):
            verdict = judged(findings[place], made.outcome, base=own, nudge=nudge)
            also.setdefault(place, []).append(_tried(candidate, made, verdict, "cured", far))
        if candidate.intervention.name == "without" and _is_idle(made.outcome, own):
            no_effect.append(candidate.intervention)
        elif made.outcome.fired:
            hangs_on.append(_tried(candidate, made, None, "untried", far))
    for place, cures in also.items():  # that no trial of its own has cured
        if best([each.verdict for each in tried[place]]) != "cured":
            tried[place] += cures[:1]
    hangs_on.sort(key=lambda each: -(each.moved.value if each.moved is not None else 0.0))
    proved = [
        Proved(finding, best([each.verdict for each in tried[place]]), tried[place])
        for place, finding in enumerate(findings)
        if place in chosen
    ]
    proved = _bounded(proved)
    runs = sum(each.outcome is not None for n, each in done.items() if n < work.nudge)
    return Why(
        target,
        recording,
        ended,
        own.steps,
        runs,
        seconds,
        noise,
        proved,
        hangs_on,
        no_effect,
        summed,
    )


def _bounded(proved: Sequence[Proved]) -> list[Proved]:
    """Return findings in which only the best trials keep their recordings."""
    from drop_physics.experiments.verdicts import VERDICTS

    recorded = {each.recording: each for one in proved for each in one.tried if each.recording}
    ranked = sorted(
        recorded.values(),
        key=lambda e: (VERDICTS.index(e.verdict), -(e.moved.value if e.moved else 0.0)),
    )
    kept = {each.recording for each in ranked[:MOST_KEPT]}
    return [
        replace(
            one,
            tried=[
                each if each.recording in kept else replace(each, recording=None)
                for each in one.tried
            ],
        )
        for one in proved
    ]


def _others_cured(
    findings: Sequence[Finding],
    candidate: Candidate,
    outcome: Outcome,
    own: Outcome,
    nudge: Outcome | None,
) -> Iterator[int]:
    """Yield the indices of other findings that a trial removes, too."""
    from drop_physics.experiments.verdicts import CAUSES, judged

    for place, finding in enumerate(findings):
        if not candidate.findings or place in candidate.findings or finding.code in CAUSES:
            continue
        if judged(finding, outcome, base=own, nudge=nudge).verdict == "cured":
            yield place


def _own(base: Recording, findings: Sequence[Finding]) -> Outcome:
    """Return the outcome of the unchanged run."""
    from drop_physics.experiments.run_distance import Apart
    from drop_physics.experiments.verdicts import Outcome

    steps = sum(samples - 1 for samples in base.seen.samples.values())
    ended = str((base.ended or {}).get("ended"))
    ended = "steps" if ended in STOPPED else ended  # trials are stopped by their steps
    return Outcome(True, ended, "", steps, [*findings], Apart([], {}))


def _is_idle(outcome: Outcome, base: Outcome) -> bool:
    """Return whether omitting something changed nothing, bit for bit."""
    same = outcome.is_same and (outcome.ended, outcome.steps) == (base.ended, base.steps)
    return outcome.fired and same


def _tried(
    candidate: Candidate,
    made: TrialRun,
    shown: TrialVerdict | None,
    verdict: Verdict,
    far: Distance | None,
) -> Tried:
    same = made.outcome is not None and made.outcome.is_same
    return Tried(candidate.intervention, shown, verdict, far, same, made.recording)


def _keep(folder: Path, result: Why, recording_id: str) -> None:
    """Store the results beside the recording, and delete trial recordings that no result names."""
    named = {each.recording for proved in result.findings for each in proved.tried}
    named |= set() if result.expected is None else {*result.expected.recordings}
    for path in folder.glob("*.rrd"):
        if path not in named:
            path.unlink()
    held = {"recording_id": recording_id, **result.as_json()}
    with written_whole(folder / VERDICTS, force=True, ours=True) as file:
        file.write(json.dumps(held, indent=1).encode())
