"""Judges findings by trial runs: cause proved, no effect, or undecided.

A trial is a run with one intervention. It is compared with the script's own run, and with one whose
bodies were moved by 1e-9 before their first step: a change that is not clearly larger is no result.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from drop_physics.experiments.run_distance import APART, Apart, Distance
from drop_physics.rules.answer import Finding
from drop_physics.rules.codes import LEVELS

Verdict = Literal["cured", "part", "chaotic", "refuted", "void", "untried"]
VERDICTS: tuple[Verdict, ...] = get_args(Verdict)
"""All verdicts, the best first."""

CURED = 0.2
"""Largest remaining share of a symptom that counts as cured."""
REFUTED = 0.8
"""Remaining share of a symptom from which a trial counts as without effect."""
BEYOND = 10.0
"""An outcome, or an expected quantity, counts as moved if it changes by at least this multiple of
the effect of a nudge."""
TRIFLE = 1e-3
"""Least motion of an outcome that counts, as a share of the largest motion."""
GRAVE = LEVELS.index("model")
"""Level of findings above which a new one rules out a cure."""
CHAOTIC = 0.2
"""Largest change of a symptom by a nudge; beyond it, the symptom is chaotic and no trial cures
it."""
WILDER = 2.0
"""A run counts as throwing a body if its largest rate is this many times that in the script's own
run."""
THROWN = {"m": 1.0, "rad": 10.0}
"""Least rates of a body that counts as thrown [m/s, rad/s]."""

GROWS = "unstable"
"""Code of the symptom that even a nudge grows. A trial that removes this symptom is a proof, even
if the nudge moves the outcome as far."""

CAUSES = frozenset(
    (
        "asleep",
        "beyond-urdf",
        "buffer-full",
        "collides-as-hull",
        "default-damping",
        "default-motor",
        "force-off-centre",
        "friction-pyramid",
        "impossible-inertia",
        "inertia-from-shape",
        "inertia-without-mass",
        "joint-damping",
        "armature",
        "massless",
        "mimic-ignored",
        "model-edited",
        "motor-gain",
        "no-gravity",
        "no-inertial",
        "not-replayed",
        "push-lasted-a-step",
        "push-stays",
        "static-parent",
        "substeps-scale-motors",
        "target-clamped",
        "timestep-after-motor",
        "timestep-changed",
        "unseeded",
        "velocity-clamped",
    ),
)
"""Codes that are causes rather than symptoms: a trial removes such a finding by its change alone,
so that only the outcome decides."""


@dataclass(frozen=True)
class Outcome:
    """The result of a trial run."""

    fired: bool
    """Whether the intervention took effect in the run."""
    ended: str
    error: str
    steps: int
    findings: list[Finding]
    apart: Apart
    """Distance from the script's own run."""
    began: Distance | None = None
    """Motion of a body that rests in the script's own run, where its states are not recorded."""

    @property
    def is_same(self) -> bool:
        """True if every position equals that of the unchanged run, bit for bit."""
        return self.apart.same and self.began is None


@dataclass(frozen=True)
class TrialVerdict:
    """What a trial run shows about one finding."""

    verdict: Verdict
    before: float | None
    """The finding's effect in the script's own run; null if it has none."""
    after: float | None
    """The finding's effect in the trial; null if the finding is gone."""
    unit: str | None
    left: float | None
    """Remaining share of the effect; null if the finding's code is itself a cause."""
    new: list[str]
    """Codes of severe findings that only the trial has."""


def moved(trial: Apart, nudge: Apart | None, about: Finding | None = None) -> Distance | None:
    """Return how far a trial moves the result; None if a slight displacement does the same.

    The result is the final distance, if it exceeds `APART` and ten times the nudge's effect;
    otherwise the largest distance at any time that exceeds ten times the nudge's effect until then,
    and the nudge's effect at all times. With a finding, the distance is that of its joint or body,
    if that has moved.
    """
    noise = {} if nudge is None else {each.unit: each.value for each in nudge.end}
    ends = [
        track.distance(track.end, track.end_s)
        for track in trial.tracks
        if track.end > max(APART, BEYOND * noise.get(track.unit, 0.0))
    ]
    if about is not None:
        mine = [end for end in ends if end.body == about.body]
        ends = [each for each in mine if each.joint == about.joint] or mine or ends
    if ends:
        return max(ends, key=lambda end: end.value)
    found = []
    for unit, (times_s, off) in trial.curves.items():
        least, most = np.zeros(len(off)), 0.0
        if nudge is not None and unit in nudge.curves:
            curve = nudge.curves[unit][1]
            count, most = min(len(off), len(curve)), float(curve.max(initial=0.0))
            least[:count] = np.maximum.accumulate(curve[:count])
            least[count:] = least[count - 1] if count else 0.0
        sure = (off > BEYOND * least) & (off > most)
        if sure.any():
            at = int(np.argmax(np.where(sure, off, 0.0)))
            worst = max((each for each in trial.tracks if each.unit == unit), key=lambda t: t.most)
            found.append(worst.distance(float(off[at]), float(times_s[at])))
    return max(found, key=lambda each: each.value, default=None)


def _matters(far: Distance | None, trial: Apart) -> bool:
    """Return whether a result has moved by more than rounding and a trifle.

    A trifle is less than a thousandth of the largest motion in the script's own run.
    """
    if far is None:
        return False
    way = max((track.moved for track in trial.tracks if track.unit == far.unit), default=0.0)
    return far.value > max(APART, TRIFLE * way)


def same_finding(finding: Finding, among: Sequence[Finding]) -> Finding | None:
    """Return the same finding in another run, or the one that replaces it; None if it is gone.

    The same finding has the same code, body and joint. Otherwise the one replacing it has the same
    code, since a finding names only the worst joint, or the worst of several bodies.
    """
    of_code = [each for each in among if each.code == finding.code]
    exact = [each for each in of_code if (each.body, each.joint) == (finding.body, finding.joint)]
    near = [
        each
        for each in of_code
        if each.body == finding.body or max(each.bodies, finding.bodies) > 1
    ]
    return next(iter(exact or near), None)


def grave(before: Sequence[Finding], after: Sequence[Finding]) -> list[str]:
    """Return the codes of severe findings that only the second run has."""
    return [
        each.code
        for each in after
        if LEVELS.index(each.level) < GRAVE and same_finding(each, before) is None
    ]


def judged(
    finding: Finding,
    trial: Outcome,
    *,
    base: Outcome,
    nudge: Outcome | None,
) -> TrialVerdict:
    """Return what a trial run shows about a finding."""
    before = None if finding.effect is None else finding.effect.value
    unit = None if finding.effect is None else finding.effect.unit
    unseen = not trial.apart.tracks and trial.began is None
    if not trial.fired or unseen or trial.ended == "failed" != base.ended:
        return TrialVerdict("void", before, before, unit, None, [])
    other = same_finding(finding, trial.findings)
    after = None if other is None or other.effect is None else other.effect.value
    left = max(_left(finding, other), _still_as_fast(finding, trial.apart))
    new = grave(base.findings, trial.findings)
    far = trial.began or moved(trial.apart, None if nudge is None else nudge.apart)
    own = far or moved(trial.apart, None)
    circular = finding.code in CAUSES
    changed = _matters(own, trial.apart) if circular else left < REFUTED and _goes(finding, trial)
    is_sure = circular or nudge is None or not _is_chaotic(finding, nudge.findings)
    verdict: Verdict
    if trial.is_same or not changed:
        verdict = "refuted"
    elif far is None and not (finding.code == GROWS and is_sure):
        verdict = "chaotic"
    elif far is None or left > CURED or new or not (is_sure and _as_long(trial, base)):
        verdict = "part"
    else:
        verdict = "cured" if circular or not _throws(trial.apart) else "part"
    return TrialVerdict(verdict, before, after, unit, None if circular else left, new)


def _goes(finding: Finding, trial: Outcome) -> bool:
    """Return whether a trial moves the body or joint that a finding is about.

    If the finding states a distance, the subject must move by a share of this distance: a subject
    that stays in place has not improved, even if the finding is gone.
    """
    mine = [
        track
        for track in trial.apart.tracks
        if track.body == finding.body and finding.joint in (None, track.joint)
    ]
    if finding.effect is not None:
        off = [track.most for track in mine if track.unit == finding.effect.unit]
        if off:
            return max(off) > max(APART, (1 - REFUTED) * finding.effect.value)
    return trial.began is not None or any(each.most > APART for each in trial.apart.tracks)


def _still_as_fast(finding: Finding, trial: Apart) -> float:
    """Return the share of an unstable velocity that remains; 0 for other findings."""
    if finding.code != GROWS or finding.effect is None:
        return 0.0
    rates = [
        track.their_fastest
        for track in trial.tracks
        if (track.body, track.joint, f"{track.unit}/s")
        == (finding.body, finding.joint, finding.effect.unit)
    ]
    return max(rates, default=0.0) / finding.effect.value


def _throws(trial: Apart) -> bool:
    """Return whether a body is thrown in a trial but not in the unchanged run."""
    bases = [track for track in trial.tracks if track.joint is None]
    return any(
        max((track.their_fastest for track in bases if track.unit == unit), default=0.0)
        > max(
            least,
            WILDER * max((track.fastest for track in bases if track.unit == unit), default=0.0),
        )
        for unit, least in THROWN.items()
    )


def _left(finding: Finding, other: Finding | None) -> float:
    """Return the share of a finding's effect that remains in a trial."""
    if other is None:
        return 0.0
    if finding.effect is None or other.effect is None or not finding.effect.value:
        return 1.0
    return other.effect.value / finding.effect.value


def _as_long(trial: Outcome, base: Outcome) -> bool:
    """Return whether two runs ended the same way, after the same number of steps.

    A run that ends at a given time may make one step more or less, since finer timesteps are summed
    with rounding.
    """
    return trial.ended == base.ended and abs(trial.steps - base.steps) <= 1


def _is_chaotic(finding: Finding, nudged: Sequence[Finding]) -> bool:
    other = same_finding(finding, nudged)
    return other is None or abs(_left(finding, other) - 1) > CHAOTIC


def best(verdicts: Sequence[Verdict]) -> Verdict:
    """Return the best of several verdicts; `untried` if there is none."""
    return min(verdicts, key=VERDICTS.index, default="untried")
