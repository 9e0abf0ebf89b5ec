"""`slides`: what rests on something, or is held by it, slips."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drop_physics.explain.contact_points import Pairs
from drop_physics.explain.judged import Judged
from drop_physics.messages import Message
from drop_physics.rules.answer import Answer, Effect, Finding, Level, Scene, Span
from drop_physics.rules.asked_of_bodies import size_m
from drop_physics.rules.runs import Runs

Float64 = NDArray[np.float64]
Rows = NDArray[np.intp]
SLIPS_M_S = 1e-3
"""Slower is creep."""
FROM_REST = 0.1
"""It began at rest if its slip began at less than this share of its greatest."""
LEAST_M, LEAST_SHARE = 1e-3, 0.01
"""Of a slip, and of its share of the body's size."""
NONE = 0.01
"""A force below this share of the normal force is none."""
LEAST_STEPS = 10
"""Shorter, it was hit."""
LANDS_M_S = 0.02
"""Along the normal; then it does not rest there."""
GRIPPED = 0.1
"""Share of the normal forces that is left of them as a sum, where they press from both sides."""
SLIDING = 0.8
"""What slips less at the contact than its centre moves rolls or tumbles."""
SUMS = ("slid", "moved", "time", "normal", "available", "used", "against", "turning", "held")
"""Of slip [m], way of the centre [m], time [s]; normal, available, used impulse [N s], and that
against the slip which moving with the support takes; in a grip the moment about the contact of
that, and what friction can give of it [N m s]."""


@dataclass
class Slip:
    """Consecutive steps in which a body slips on another, and nothing else pushes it.

    Sums over them; those of forces in a grip without the steps in which it closes.
    """

    first: int
    last: int
    began_m_s: float
    """How fast it slipped as the first of them began."""
    most_m_s: float
    sums: Float64
    """SUMS, then the impulse that moving with the support takes [N s], and the way, as vectors."""
    rise: Float64
    """The same until it slips fastest: then it is caught, or falls on."""

    def then(self, more: Slip) -> Slip:
        """Return both as one."""
        rise = self.sums + more.rise if more.most_m_s > self.most_m_s else self.rise
        most_m_s = max(self.most_m_s, more.most_m_s)
        return Slip(self.first, more.last, self.began_m_s, most_m_s, self.sums + more.sums, rise)

    @property
    def of(self) -> dict[str, float]:
        """The sums by their names, with the sizes of the vectors: `needed` and `went`."""
        needed, went = np.linalg.norm(self.sums[len(SUMS) :].reshape(2, 3), axis=1).tolist()
        sums = dict(zip(SUMS, self.sums.tolist(), strict=False))
        return {**sums, "needed": needed, "went": went}

    @property
    def at_first(self) -> dict[str, float]:
        """The sums until it slips fastest by their names."""
        return dict(zip(SUMS, self.rise.tolist(), strict=False))


class Slides(Answer):
    """Needed is what gravity and the support's acceleration ask of friction, not a push."""

    code = "slides"
    level: Level = "asked"
    speeds_m_s = SLIPS_M_S, np.inf
    """Of the slips that it looks at."""
    least_share = LEAST_SHARE

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._runs: Runs[Slip] = Runs(self._size)

    def see(self) -> None:
        """Take a piece."""
        pairs = self.scene.touches.pairs
        low_m_s, high_m_s = self.speeds_m_s
        slips = (pairs.slip_m_s > low_m_s) & (pairs.slip_m_s < high_m_s) & (pairs.normal_n > 0)
        for *both, rows in pairs.by_pair(slips):
            for side, number in enumerate(both):
                judged = self.scene.judged.get(number)
                if judged is None or both[0] == both[1]:
                    continue
                if all(steps.law.tree.size == 6 for steps in judged.stretches):
                    for run in _runs(self.scene, rows, side, judged):
                        self._runs.add((number, both[1 - side]), run)

    def _size(self, both: tuple[int, int], run: Slip) -> float:
        """Return how far a body slips that friction could not stop."""
        least_m = max(LEAST_M, self.least_share * size_m(self.scene.body(both[0])))
        return run.of["slid"] if self.says(run, least_m) else 0.0

    def says(self, run: Slip, least_m: float) -> bool:
        """Whether friction was not enough for what was at rest."""
        of = run.of
        first = run.at_first
        slides = first["against"] > first["available"] and of["slid"] >= SLIDING * of["moved"]
        return bool(
            of["slid"] > least_m
            and run.began_m_s <= FROM_REST * run.most_m_s
            and (slides or of["turning"] > of["held"] > 0)
            and run.last - run.first + 1 >= LEAST_STEPS
            and of["normal"] > NONE * of["needed"]  # else it hardly touches it
        )

    def findings(self) -> Iterator[Finding]:
        """Yield each body that slides, with what it slides on."""
        for body, other, run in self._runs.most():
            labels = {"body": self.scene.body(body).label, "on": self.scene.body(other).label}
            message, advice, effect_m = self.words(run, labels)
            yield Finding(
                code=self.code,
                level=self.level,
                message=message,
                advice=advice,
                body=self.scene.body(body).label,
                other=self.scene.body(other).label,
                effect=Effect(effect_m, "m"),
                share=effect_m / size_m(self.scene.body(body)),
                steps=Span(run.first, run.last, run.last - run.first + 1),
                site=self.scene.asked.of["lateralFriction"].site(body, other),
            )

    def words(self, run: Slip, labels: Mapping[str, object]) -> tuple[Message, Message, float]:
        """Return what is said of a body that slips on another, the cure, and how far it went."""
        of, first, seconds = run.of, run.at_first, run.of["time"]
        values: dict[str, object] = {
            **labels,
            "slid": of["slid"],
            "available": first["available"] / first["time"],
            "given": first["available"] / first["normal"],
            "needed": first["against"] / first["time"],
            "wanted": first["against"] / first["normal"],
            "held": of["held"] / seconds,
            "turning": of["turning"] / seconds,
        }
        if first["against"] <= first["available"]:
            return (
                Message(
                    "{body} turns in the grip of {on}, {slid:.3g} m at the contact: friction there "
                    "gives at most {held:.3g} N m about it, and its weight beside it takes "
                    "{turning:.3g} N m",
                    **values,
                ),
                Message("grip it at its centre of mass, or with more force or friction"),
                of["slid"],
            )
        return (
            Message(
                "{body} slides {slid:.3g} m on {on}: friction there gives at most "
                "{available:.3g} N (coefficient {given:.3g}), staying takes {needed:.3g} N "
                "({wanted:.3g})",
                **values,
            ),
            Message(
                "raise the product of both bodies' coefficients well above {wanted:.3g} with "
                "p.changeDynamics(…, lateralFriction=…), or press them together with more force",
                **values,
            ),
            of["slid"],
        )


def _runs(scene: Scene, rows: Rows, side: int, judged: Judged) -> Iterator[Slip]:
    """Yield runs of consecutive steps of a pair."""
    pairs = scene.touches.pairs
    set_ = scene.placing.moved(pairs.body[rows, 1 - side], pairs.step[rows])
    needed, others, pushed, pressed, way, turning = _forces(pairs, rows, side, judged, set_)
    normal = pairs.normal_n[rows]
    # What is held from both sides hangs back, whoever else carries it; elsewhere that is a push.
    gripped = np.linalg.norm(pairs.pressed_n[rows], axis=1) < GRIPPED * normal
    alone = (pushed <= NONE * normal) & (gripped | (others <= NONE * normal))
    alone &= pairs.one_line[rows] & pairs.explained[rows, side]
    rows, needed, way, gripped = rows[alone], needed[alone], way[alone], gripped[alone]
    if not len(rows):
        return
    step, dt, slip = pairs.step[rows], pairs.timestep_s[rows], pairs.slip_m_s[rows]
    # What lies on one side presses with what it needs, on average: step by step it chatters.
    normal = np.where(gripped, pairs.normal_n[rows], pressed[alone])
    available = pairs.available_n[rows] / pairs.normal_n[rows] * normal
    steady = ~gripped | (np.abs(pairs.approach_m_s[rows]) < LANDS_M_S)
    size = np.linalg.norm(needed, axis=1)
    towards = np.divide(needed, size[:, None], out=np.zeros_like(needed), where=size[:, None] > 0)
    used = np.einsum("ni,ni->n", pairs.tangential_n[rows], towards) * (-1.0 if side else 1.0)
    turned = turning[alone] * gripped[:, None]
    moved = np.linalg.norm(way, axis=1)
    against = -np.einsum("ni,ni->n", needed, way) / moved.clip(1e-300)
    forces = np.column_stack([np.ones(len(rows)), normal, available, used, against, turned, needed])
    ways = slip, moved
    numbers = np.column_stack([*ways, forces * steady[:, None], way]) * dt[:, None]
    starts = np.flatnonzero(np.diff(step, prepend=step[0] - 2) != 1)
    began, ends = pairs.began_slip_m_s[rows], np.append(starts[1:], len(rows))
    for start, end in zip(starts.tolist(), ends.tolist(), strict=True):
        fastest = start + int(np.argmax(slip[start:end]))
        yield Slip(
            int(step[start]),
            int(step[end - 1]),
            float(began[start]),
            float(slip[fastest]),
            numbers[start:end].sum(axis=0),
            numbers[start : fastest + 1].sum(axis=0),
        )


def _forces(
    pairs: Pairs, rows: Rows, side: int, judged: Judged, set_: NDArray[np.bool_]
) -> tuple[Float64, Float64, Float64, Float64, Float64, Float64]:
    """Return what of a body's weight and inertia friction has to carry, shape (n, 3) [N].

    Then what other bodies do to it, what pushes and constraints do, what of its weight and inertia
    presses it on [N], shape (n,) each, how its centre moves along the contact [m/s], shape (n, 3),
    and the moment about the contact of the first, and what friction can give of that [N m], shape
    (n, 2). NaN where the sum says nothing. `set_`: for which steps calls set the support.
    """
    needed, moved = np.full((2, len(rows), 3), np.nan)
    other, pushed, pressed = np.full((3, len(rows)), np.nan)
    began, ended = pairs.began_m_s[rows, 1 - side], pairs.carried_m_s[rows, 1 - side]
    support = ended - began
    # Between steps calls may give it another velocity.
    given = np.flatnonzero(set_[1:] & (np.diff(pairs.step[rows]) == 1)) + 1
    support[given] += began[given] - ended[given - 1]
    goes, centre = pairs.ended_m_s[rows, 1 - side], pairs.centre_m[rows, side]
    sign, line, dt = (-1.0 if side else 1.0), pairs.line[rows], pairs.timestep_s[rows, None]
    turning = np.full((len(rows), 2), np.nan)
    turning[:, 1] = pairs.held_n_m[rows, side]
    for steps in judged.stretches:
        its = np.flatnonzero(np.isin(pairs.step[rows], steps.steps))
        if not len(its) or not steps.terms:
            continue
        at = np.searchsorted(steps.steps, pairs.step[rows][its])
        mass_kg = float(steps.law.tree.masses_kg[0])
        asked = mass_kg * (support[its] / dt[its] - steps.reported.gravity_m_s2[at])
        along = np.einsum("ni,ni->n", asked, line[its])
        needed[its], pressed[its] = asked - along[:, None] * line[its], np.abs(along)
        others = steps.terms["contacts"][at, 3:6] / dt[its] - sign * pairs.force_n[rows][its]
        more = (steps.terms["constraints"] + steps.terms["applied"])[at, 3:6] / dt[its]
        other[its], pushed[its] = (np.linalg.norm(each, axis=1) for each in (others, more))
        way = steps.after.velocity[at, 3:6] - goes[its]
        moved[its] = way - np.einsum("ni,ni->n", way, line[its])[:, None] * line[its]
        moment = np.cross(steps.before.position_m[at] - centre[its], asked)
        turning[its, 0] = np.abs(np.einsum("ni,ni->n", moment, line[its]))
    return needed, other, pushed, pressed, moved, turning
