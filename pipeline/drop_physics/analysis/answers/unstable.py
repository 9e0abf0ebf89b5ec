"""Whether what happened is still physics: numbers that are none, rates that ring, the clamp."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drop_physics.analysis.answers.answer import Answer, Effect, Finding, Scene, Span, site_of
from drop_physics.analysis.explained.judged import Judged
from drop_physics.analysis.explained.recording import Explained
from drop_physics.analysis.explained.steps import Steps
from drop_physics.analysis.targets import flips
from drop_physics.laws.tree import Tree
from drop_physics.messages import Message
from drop_physics.seen.calls import BODY_NAMES, Call
from drop_physics.seen.events import Body

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]

OFTEN = 8
"""Changes of sign, from step to step, that are no chance."""
SHARE, LEAST = 0.01, 1e-2
"""Of its greatest, and in rad/s or m/s: a slower rate is noise."""
AXES = ("spin about x", "spin about y", "spin about z", "velocity along x", "velocity along y",
    "velocity along z")  # fmt: skip
ADVICE: Mapping[str, Message] = {
    "joint damping": Message(
        "the joint's damping acts explicitly, on a small inertia: use a smaller timestep, or "
        "p.changeDynamics(body, link, jointDamping=0)"
    ),
    "applied": Message(
        "the script's own forces are too stiff for this timestep: lower its gains, most of all "
        "that of the velocity, or use a smaller timestep"
    ),
    "damping": Message(
        "damping acts explicitly: set less of it, p.changeDynamics(body, link, linearDamping=…, "
        "angularDamping=…), or use a smaller timestep"
    ),
    "motors": Message("lower the motor's positionGain, and keep its velocityGain at 1"),
}


class NotFinite(Answer):
    """States that are no numbers."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._found: dict[int, tuple[int, str, Call | None]] = {}
        """By body: the first step, the term that was first, the call."""

    def see(self, explained: Explained) -> None:
        """Keep the first of each body."""
        for number, judged in explained.bodies.items():
            for steps in judged.stretches:
                if number in self._found:
                    break
                wrong = ~np.isfinite(steps.after.velocity).all(axis=1)
                for name in ("position_m", "orientation", "joints"):
                    wrong |= ~np.isfinite(getattr(steps.after, name)).all(axis=1)
                for impulses in steps.terms.values():  # too large for a sum
                    wrong |= ~np.isfinite(impulses).all(axis=1)
                rows = np.flatnonzero(wrong)
                if not len(rows):
                    continue
                row = int(rows[0])
                step = int(steps.steps[row])
                terms = [n for n, each in steps.terms.items() if not np.isfinite(each[row]).all()]
                call = _without_number(explained.piece.calls, judged.body, step)
                self._found[number] = step, terms[0] if len(terms) == 1 else "", call

    def findings(self) -> Iterator[Finding]:
        """Yield the first body of each simulation, one that a call names before others."""
        by_client: dict[int, list[int]] = {}
        for number in self._found:
            by_client.setdefault(self.scene.body(number).client, []).append(number)
        for numbers in by_client.values():
            first = min(numbers, key=lambda n: (self._found[n][0], self._found[n][2] is None))
            step, term, call = self._found[first]
            body = self.scene.body(first)
            why = Message(", first in the term {term}", term=term) if term else ""
            if call is not None:
                why = Message(
                    ": p.{function}({arguments}) was given it",
                    function=call.function, arguments=call.arguments,
                )  # fmt: skip
            message = Message(
                "{body} has a state that is no number (nan or infinite) from step {step:,} on{why}",
                body=body.label, step=step, why=why,
            )  # fmt: skip
            yield Finding(
                code="not-finite", level="broken", message=message, body=body.label, share=1.0,
                bodies=len(numbers), steps=Span(step, step, 1),
                site=None if call is None else site_of(call),
            )  # fmt: skip


def _without_number(calls: list[Call], body: Body, step: int) -> Call | None:
    """Return the last call for a body, or for all, that was given a number that is none."""
    return next(
        (
            each
            for each in reversed(calls)
            if each.client == body.client and each.at.step < step
            if not np.isfinite(each.numbers).all()
            if next(
                (each.values[name][0] for name in BODY_NAMES if name in each.values), body.number
            )
            == body.number
        ),
        None,
    )


@dataclass
class _Rates:
    """Of the degrees of freedom of one body, shape (size,) each."""

    body: Body
    tree: Tree
    greatest: Float64
    run: Int64
    """Changes of sign in a row, until now."""
    strongest: Float64
    """The largest rate in a run that is long enough."""
    first: Int64
    last: Int64
    count: Int64
    turned: dict[str, Float64]
    """By each term, the sum of its impulses against the rate in such runs [N s] or [N m s]."""
    energy_j: dict[str, Float64]
    """Put in by each term there."""
    clamped: Int64
    """Steps in which the clamp took something."""
    taken: Float64
    """The sum of what it took [N s] or [N m s]."""
    bounds: Int64
    """First and last step of that, shape (2, size)."""
    limit: float = 0.0
    steps: int = 0

    @staticmethod
    def of(body: Body, steps: Steps) -> _Rates:
        zeros = np.zeros(steps.law.tree.size)
        none = zeros.astype(np.int64)
        return _Rates(body=body, tree=steps.law.tree, greatest=zeros, run=none, strongest=zeros,
            first=none - 1, last=none - 1, count=none.copy(), turned={}, energy_j={},
            clamped=none.copy(), taken=zeros, bounds=np.full((2, len(none)), -1))  # fmt: skip


class Unstable(Answer):
    """Rates that change their sign with every step, and what the clamp of rates takes."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._rates: dict[int, _Rates] = {}

    def see(self, explained: Explained) -> None:
        """Follow each rate."""
        for number, judged in explained.bodies.items():
            for steps in judged.stretches:
                if not len(steps) or not steps.terms:
                    continue
                known = self._rates.get(number)
                if known is None or known.greatest.shape != (steps.law.tree.size,):
                    known = self._rates[number] = _Rates.of(judged.body, steps)
                gained = self._gained(number, steps)
                with np.errstate(invalid="ignore", over="ignore"):
                    _ring(known, steps, ~gained)
                    _clamp(known, steps, judged, ~gained)

    def _gained(self, number: int, steps: Steps) -> NDArray[np.bool_]:
        """Return the steps in which gains of a motor turn rates around: that is motor-gain's."""
        found = np.zeros(len(steps), np.bool_)
        for driven in self.scene.joints.latest.get(number, []):
            if driven.steps is steps:
                found |= (flips(driven) & (driven.asked.impulse > 0)).any(axis=1)
        return found

    def findings(self) -> Iterator[Finding]:
        """Yield the worst degree of freedom of each body."""
        for each in self._rates.values():
            rings = each.strongest > np.maximum(SHARE * each.greatest, LEAST)
            if rings.any():
                yield _unstable(each, np.flatnonzero(rings))
            elif each.clamped.any():
                yield _clamped(each)


def _ring(known: _Rates, steps: Steps, own: NDArray[np.bool_]) -> None:
    """Note runs of changes of sign, and the energy that each term puts in there."""
    before, after = steps.before.velocity, steps.after.velocity
    size = np.minimum(np.abs(before), np.abs(after))
    greatest = np.maximum.accumulate(np.abs(after), axis=0)
    greatest = np.maximum(greatest, known.greatest)
    turns = (before * after < 0) & (size > np.maximum(SHARE * greatest, LEAST))
    turns &= (own & ~steps.put)[:, None]
    known.greatest, known.steps = greatest[-1], known.steps + len(steps)
    if not (turns.any() or known.run.any()):
        return
    rows = np.arange(len(steps))[:, None]
    broken = np.maximum.accumulate(np.where(turns, -1, rows), axis=0)
    run = np.where(broken < 0, rows + 1 + known.run, rows - broken)
    known.run = run[-1]
    rings = run >= OFTEN
    if not rings.any():
        return
    ends = np.where(rings, steps.steps[:, None], -1)
    some = rings.any(axis=0)
    known.first = np.where(some & (known.first < 0), steps.steps[rings.argmax(axis=0)], known.first)
    known.last = np.maximum(known.last, ends.max(axis=0))
    known.count += rings.sum(axis=0)
    known.strongest = np.maximum(known.strongest, np.where(rings, size, 0.0).max(axis=0))
    mean, against = (
        np.where(rings, 0.5 * (before + after), 0.0),
        np.where(rings, -np.sign(before), 0),
    )
    for name, term in steps.terms.items():
        for sums, factor in ((known.energy_j, mean), (known.turned, against)):
            sums[name] = sums.get(name, 0.0) + (factor * term).sum(axis=0)


def _clamp(known: _Rates, steps: Steps, judged: Judged, own: NDArray[np.bool_]) -> None:
    """Note what the clamp took, in steps that are explained."""
    taken = np.abs(steps.terms["clamp"])
    if not taken.any():
        return
    where = np.searchsorted(judged.steps, steps.steps)
    # What rounding leaves is none.
    held = (taken > 1e-9 * steps.largest[:, None]) & (own & judged.explained[where])[:, None]
    taken, some = np.where(held, taken, 0.0), held.any(axis=0)
    known.clamped += held.sum(axis=0)
    known.taken = known.taken + taken.sum(axis=0)
    known.limit = steps.law.velocity_limit
    first = steps.steps[held.argmax(axis=0)]
    last = steps.steps[len(steps) - 1 - held[::-1].argmax(axis=0)]
    known.bounds[0] = np.where(some & (known.bounds[0] < 0), first, known.bounds[0])
    known.bounds[1] = np.where(some, last, known.bounds[1])


def _place(known: _Rates, row: int) -> tuple[str | None, str, str]:
    """Return the joint of a degree of freedom, what it is called, and the unit of its rate."""
    tree = known.tree
    if row < tree.first_rate:
        return None, AXES[row], "rad/s" if row < 3 else "m/s"
    link = next(k for k, rate in enumerate(tree.rates) if rate.start <= row < rate.stop)
    joint = known.body.joints[link]
    return joint.name, joint.name, "m/s" if joint.kind == "prismatic" else "rad/s"


def _unstable(known: _Rates, rows: Int64) -> Finding:
    row = int(rows[np.argmax(known.strongest[rows])])
    joint, name, unit = _place(known, row)
    # The clamp ends what others feed.
    turned = {term: float(each[row]) for term, each in known.turned.items() if term != "clamp"}
    most = max(turned, key=turned.__getitem__)
    fed = turned[most] > 0.5 * sum(each for each in turned.values() if each > 0)
    energy_j = float(known.energy_j[most][row])
    more = Message(" (and {n} more)", n=len(rows) - 1) if len(rows) > 1 else ""
    message = Message(
        "{name}{more} changes its sign with every step, at up to {rate:.3g} {unit}, in {count:,} "
        "steps{why}",
        name=name, more=more, rate=known.strongest[row], unit=unit,
        count=int(known.count[row]) + OFTEN - 1,
        why=_why(most, energy_j) if fed else "",
    )  # fmt: skip
    advice = ADVICE.get(most, Message("use a smaller timestep")) if fed else None
    rattles = fed and most == "contacts"  # where they feed it, energy-gained says so
    return Finding(
        code="unstable", level="model" if rattles else "broken", message=message, advice=advice,
        body=known.body.label, joint=joint, effect=Effect(float(known.strongest[row]), unit),
        share=float(known.strongest[row] / known.greatest[row]),
        steps=Span(int(known.first[row]), int(known.last[row]), int(known.count[row])),
    )  # fmt: skip


def _why(term: str, energy_j: float) -> Message:
    turns = Message(": the term {term} turns it around", term=term)
    if energy_j <= 0:  # what it put in at first, it takes from a rate that has stopped to grow
        return turns
    return Message("{turns}, and puts in {energy:.3g} J", turns=turns, energy=energy_j)


def _clamped(known: _Rates) -> Finding:
    row = int(np.argmax(known.clamped))
    joint, name, unit = _place(known, row)
    message = Message(
        "{name} reaches {limit:g} {unit}, where PyBullet clamps every rate: in {count:,} steps it "
        "takes {taken:.3g} {of} away",
        name=name, limit=known.limit, unit=unit, count=int(known.clamped[row]),
        taken=known.taken[row], of="N m s" if unit == "rad/s" else "N s",
    )  # fmt: skip
    advice = Message("p.changeDynamics(body, -1, maxJointVelocity=…) raises the limit")
    first, last = known.bounds[:, row].tolist()
    count = int(known.clamped[row])
    return Finding(
        code="velocity-clamped", level="asked", message=message, advice=advice,
        body=known.body.label, joint=joint, share=count / known.steps,
        effect=Effect(float(known.taken[row]), "N m s" if unit == "rad/s" else "N s"),
        steps=Span(first, last, count),
    )  # fmt: skip
