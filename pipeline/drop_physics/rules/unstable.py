"""Whether what happened is still physics: rates that ring, and what the clamp takes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drop_physics.explain.step_status import Judged
from drop_physics.explain.steps import Steps
from drop_physics.explain.targets import flips
from drop_physics.messages import Message
from drop_physics.physics.tree import Tree
from drop_physics.rules.answer import (
    Answer,
    Cure,
    Effect,
    Finding,
    Noted,
    Notes,
    Scene,
    and_more,
    so_many,
)
from drop_physics.trace.events import Body

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]
OFTEN = 8
"""Changes of sign, from step to step, that are no chance."""
TOO = 0.1
"""Share of what a term turns around, of which a motor that turns around more may be the cause."""
FULL = 1 - 1e-9
"""Share of the clamp's limit at which a rate is there."""
SAME = 1e-6
"""Forces that differ by less than this share are the same."""
SHARE, LEAST = 0.01, 1e-2
"""Of its greatest, and in rad/s or m/s: a slower rate is noise."""
AXES = (
    "spin about x",
    "spin about y",
    "spin about z",
    "velocity along x",
    "velocity along y",
    "velocity along z",
)
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
}
"""Terms that answer to rates and act at once. The solver's react to others: what lies on something
trembles so, and what a motor's own gains turn around is `motor-gain`."""
CURES = {"joint damping": "joint-damping", "damping": "damping"}
"""What takes such a term away."""


@dataclass
class _Rates:
    """Of the degrees of freedom of one body, shape (size,) each."""

    body: Body
    tree: Tree
    greatest: Float64
    run: Int64
    """Changes of sign in a row, until now."""
    turned: dict[str, Float64]
    """By each term, the sum of its impulses against the rate in such runs [N s] or [N m s]."""
    rings: Notes[int]
    """By degree of freedom, the steps in runs that are long enough: the rate there."""
    clamped: Notes[int]
    """Those in which the clamp took something: how much [N s] or [N m s]."""
    taken: Float64
    forces: Float64
    """Of the script's forces in such runs the least, the greatest, and the least magnitude, shape
    (3, size)."""
    limit: float = 0.0
    steps: int = 0

    def is_switch(self, row: int) -> bool:
        """Whether they only change their sign there, whatever the rate: no gain is too large."""
        low, high, least = self.forces[:, row].tolist()
        most = max(abs(low), abs(high))
        return bool(most - least <= SAME * most and high - low > most)


class Unstable(Answer):
    """Rates that change their sign with every step, and what the clamp of rates takes."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._rates: dict[int, _Rates] = {}

    def see(self) -> None:
        """Follow each rate."""
        for judged, steps in self.scene.stretches():
            number = judged.body.number
            if not len(steps) or not steps.terms:
                continue
            known, tree = self._rates.get(number), steps.law.tree
            if known is None or known.greatest.shape != (tree.size,):
                none = np.zeros(tree.size)
                forces = np.stack([none + np.inf, none - np.inf, none + np.inf])
                known = _Rates(
                    judged.body,
                    tree,
                    none,
                    none.astype(np.int64),
                    {},
                    Notes(),
                    Notes(),
                    none,
                    forces,
                )
                self._rates[number] = known
            # What a motor's gains turn around is motor-gain's.
            own = np.ones(len(steps), np.bool_)
            for driven in self.scene.joints.latest.get(number, []):
                if driven.steps is steps:
                    own &= ~(flips(driven) & (driven.asked.impulse > 0)).any(axis=1)
            with np.errstate(invalid="ignore", over="ignore"):
                _ring(known, steps, own)
                _clamp(known, steps, judged, own)

    def findings(self) -> Iterator[Finding]:
        """Yield the worst degree of freedom of each body."""
        for each in self._rates.values():
            rings = {
                row: noted
                for row, noted in each.rings.items()
                if not each.is_switch(row) and noted.most > max(SHARE * each.greatest[row], LEAST)
            }
            found = _unstable(each, rings) if rings else None
            if found is None and each.clamped:
                found = _clamped(each)
            if found is not None:
                yield found


def _ring(known: _Rates, steps: Steps, own: NDArray[np.bool_]) -> None:
    """Note runs of changes of sign, and what turns the rates around there."""
    before, after = steps.before.velocity, steps.after.velocity
    size = np.minimum(np.abs(before), np.abs(after))
    greatest = np.maximum(np.maximum.accumulate(np.abs(after), axis=0), known.greatest)
    turns = (before * after < 0) & (size > np.maximum(SHARE * greatest, LEAST))
    turns &= (own & ~steps.put)[:, None]
    known.greatest, known.steps = greatest[-1], known.steps + len(steps)
    rows = np.arange(len(steps))[:, None]
    broken = np.maximum.accumulate(np.where(turns, -1, rows), axis=0)
    run = np.where(broken < 0, rows + 1 + known.run, rows - broken)
    known.run, rings = run[-1], run >= OFTEN
    for row in np.flatnonzero(rings.any(axis=0)).tolist():
        known.rings.add(row, steps.steps[rings[:, row]], size[rings[:, row], row])
    low, high, least = known.forces
    forces = steps.terms["applied"]
    known.forces = np.stack(
        [
            np.where(rings, forces, np.inf).min(axis=0, initial=np.inf).clip(max=low),
            np.where(rings, forces, -np.inf).max(axis=0, initial=-np.inf).clip(min=high),
            np.where(rings, np.abs(forces), np.inf).min(axis=0, initial=np.inf).clip(max=least),
        ]
    )
    against = np.where(rings, -np.sign(before), 0)
    for name, term in steps.terms.items() if rings.any() else ():
        known.turned[name] = known.turned.get(name, 0.0) + (against * term).sum(axis=0)


def _clamp(known: _Rates, steps: Steps, judged: Judged, own: NDArray[np.bool_]) -> None:
    """Note what the clamp took, in steps that are explained."""
    taken = np.abs(steps.terms["clamp"])
    explained = judged.explained[np.searchsorted(judged.steps, steps.steps)]
    # What rounding leaves is none, and what one rate's clamp takes of others is not theirs.
    fastest = np.maximum(np.abs(steps.before.velocity), np.abs(steps.after.velocity))
    held = (fastest >= FULL * steps.law.velocity_limit) & (taken > 1e-9 * steps.largest[:, None])
    held &= (own & explained)[:, None]
    for row in np.flatnonzero(held.any(axis=0)).tolist():
        known.clamped.add(row, steps.steps[held[:, row]], taken[held[:, row], row])
    known.taken = known.taken + np.where(held, taken, 0.0).sum(axis=0)
    known.limit = steps.law.velocity_limit


def _place(known: _Rates, row: int) -> tuple[str | None, str, str]:
    """Return the joint of a degree of freedom, what it is called, and the unit of its rate."""
    tree = known.tree
    if row < tree.first_rate:
        return None, AXES[row], "rad/s" if row < 3 else "m/s"
    link = next(k for k, rate in enumerate(tree.rates) if rate.start <= row < rate.stop)
    joint = known.body.joints[link]
    return joint.name, joint.name, "m/s" if joint.kind == "prismatic" else "rad/s"


def _unstable(known: _Rates, rings: dict[int, Noted]) -> Finding | None:
    row, worst = max(rings.items(), key=lambda pair: pair[1].most)
    joint, name, unit = _place(known, row)
    # The clamp ends what others feed.
    turned = {term: float(each[row]) for term, each in known.turned.items() if term != "clamp"}
    most = max(turned, key=turned.__getitem__)
    if most not in ADVICE or turned[most] <= 0.5 * sum(t for t in turned.values() if t > 0):
        return None
    if turned.get("motors", 0.0) > TOO * turned[most]:
        return None  # its gains may be the cause, and less damping would leave them more
    message = Message(
        "{name}{more} changes its sign with every step, at up to {rate:.3g} {unit}, in {count:,} "
        "steps: the term {term} turns it around",
        name=name,
        more=and_more(len(rings)),
        rate=worst.most,
        unit=unit,
        count=worst.count + OFTEN - 1,
        term=most,
    )
    return Finding(
        code="unstable",
        level="broken",
        message=message,
        body=known.body.label,
        joint=joint,
        advice=ADVICE[most],
        cure=Cure(CURES[most], known.body.label, 0.0) if most in CURES else None,
        effect=Effect(worst.most, unit),
        share=worst.most / float(known.greatest[row]),
        steps=worst.span,
    )


def _clamped(known: _Rates) -> Finding:
    row, worst = max(known.clamped.items(), key=lambda pair: pair[1].count)
    joint, name, unit = _place(known, row)
    taken = Effect(float(known.taken[row]), "N m s" if unit == "rad/s" else "N s")
    message = Message(
        "{name} reaches {limit:g} {unit}, where PyBullet clamps every rate: in {steps} it takes "
        "{taken:.3g} {of} away",
        name=name,
        limit=known.limit,
        unit=unit,
        steps=so_many(worst.count),
        taken=taken.value,
        of=taken.unit,
    )
    return Finding(
        code="velocity-clamped",
        level="asked" if worst.count >= OFTEN else "note",
        message=message,
        body=known.body.label,
        joint=joint,
        advice=Message("p.changeDynamics(body, -1, maxJointVelocity=…) raises the limit"),
        cure=Cure("limits", known.body.label, given={"maxJointVelocity": 1e5}),
        share=worst.count / known.steps,
        effect=taken,
        steps=worst.span,
    )
