"""`slides` and `creeps` of what friction alone has to hold: what lies on something, or is gripped.

MuJoCo's friction below its limit is a damper: with a load it gives way at a speed that the
regularisation of the contact sets (impratio, the cone), however much of it there is. At its limit
it slides.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from drop_physics.explain.contact_points import COMMON
from drop_physics.explain.step_status import Judged
from drop_physics.messages import Message
from drop_physics.rules.answer import Answer, Cure, Effect, Finding, Level, Scene, Span
from drop_physics.rules.body_properties import size_m
from drop_physics.rules.engines import MUJOCOS
from drop_physics.rules.thresholds import (
    AT_LIMIT_SHARE,
    CREEPS_M_S,
    CREEPS_STEPS,
    EACH_STEP,
    GRIPPED,
    HOPS_STEPS,
    LOADED,
    SLIDES_SHARE,
    SLIPS_M,
    STRAIGHT,
)

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]
SUMS = ("time", "touching", "normal", "available", "used", "needed", "weight", "slid", "slower")
"""Of time, and time of contact [s]; impulses of normal forces, what friction could give, what it
gave, what the weight takes of it, and what it presses with where it lies [N s]; way at the contact
[m]; steps that slip as slowly as what creeps."""
LEVEL_OF: dict[str, Level] = {"slides": "asked", "creeps": "model"}
"""How grave each code is."""
VECTORS = 2
"""Way at the contact, and of the centre against what touches it: vectors that follow the sums."""


@dataclass
class FrictionRun:
    """Steps of a body, without a longer gap, in which friction alone has to hold it."""

    first: int
    last: int
    count: int
    """The number of them in which it was touched."""
    sums: Float64
    fastest_m_s: float
    others: set[int]

    def then(self, more: FrictionRun) -> None:
        """Add what follows."""
        self.last, self.count = more.last, self.count + more.count
        self.sums = self.sums + more.sums
        self.fastest_m_s = max(self.fastest_m_s, more.fastest_m_s)
        self.others |= more.others

    @property
    def of(self) -> dict[str, float]:
        """The sums by their names, with the sizes of the vectors: `went`, `moved`."""
        named = dict(zip(SUMS, self.sums.tolist(), strict=False))
        ways = self.sums[len(SUMS) :].reshape(VECTORS, 3)
        went, moved = np.linalg.norm(ways, axis=1).tolist()
        return {**named, "went": went, "moved": moved}


class HeldByFriction(Answer):
    """A body without joints that lies on something, or is pressed from two sides."""

    engines = MUJOCOS

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._open: dict[int, FrictionRun] = {}
        self._found: dict[tuple[str, int], tuple[float, FrictionRun]] = {}
        """The longest way [m] and its run, by code and body."""

    def see(self) -> None:
        """Take a piece."""
        for number, judged in self.scene.judged.items():
            if judged.body.base_moves and len(judged.body.links) == 1:
                for run in self._runs(number, judged):
                    known = self._open.get(number)
                    if known is not None and run.first - known.last <= HOPS_STEPS:
                        known.then(run)
                        continue
                    self._close(number)
                    self._open[number] = run

    def _runs(self, number: int, judged: Judged) -> Iterator[FrictionRun]:
        """Yield the runs of a piece, each without a step between its steps that is not touched."""
        points = self.scene.touches.pairs.points
        side = np.where(points.body[:, 0] == number, 0, 1)
        its = np.flatnonzero((points.body == number).any(axis=1) & (points.normal_n > 0))
        its = its[points.body[its, 0] != points.body[its, 1]]
        if not len(its):
            return
        mine, sign = side[its], np.where(side[its] == 0, 1.0, -1.0)[:, None]
        step, row = np.unique(points.step[its], return_inverse=True)
        other, weight = points.body[its, 1 - mine], points.normal_n[its]

        def summed(values: Float64) -> Float64:
            found = np.zeros((len(step), *values.shape[1:]))
            np.add.at(found, row, values)
            return found

        total = summed(weight)
        pressed = summed(sign * points.normal[its] * weight[:, None])
        order = np.lexsort((weight, row))
        line = points.normal[its][order[np.append(np.flatnonzero(np.diff(row[order])), -1)]]
        askew = np.abs(np.einsum("ki,ki->k", points.normal[its], line[row])) < COMMON
        both = np.array([np.inf, -np.inf])[:, None] * np.ones(len(step))
        np.minimum.at(both[0], row, other)
        np.maximum.at(both[1], row, other)
        gripped = np.linalg.norm(pressed, axis=1) < GRIPPED * total
        holds = (summed(askew.astype(float)) == 0) & (gripped | (both[0] == both[1]))
        holds &= summed((~points.explained[its].all(axis=1)).astype(float)) == 0
        slip = summed(sign * points.slip_m_s[its] * weight[:, None]) / total[:, None]
        carried = summed(points.ended_m_s[its, 1 - mine] * weight[:, None]) / total[:, None]
        used = np.linalg.norm(summed(sign * points.tangential_n[its]), axis=1)
        available = summed(points.friction[its] * weight)
        for steps in judged.stretches:
            if not len(steps) or steps.law.tree.size != 6:
                continue
            at = np.searchsorted(step, steps.steps)
            at = np.minimum(at, len(step) - 1)
            rows = np.flatnonzero(
                (step[at] == steps.steps) & holds[at] & np.isfinite(available[at])
            )
            if not len(rows):
                continue
            at, dt = at[rows], steps.reported.timestep_s[rows]
            weigh = float(steps.law.tree.masses_kg[0]) * steps.reported.gravity_m_s2[rows]
            along = np.einsum("ni,ni->n", weigh, line[at])
            needed = np.linalg.norm(weigh - along[:, None] * line[at], axis=1)
            lies = np.where(gripped[at], 0.0, np.abs(along))
            way = steps.after.velocity[rows, 3:6] - carried[at]
            way -= np.einsum("ni,ni->n", way, line[at])[:, None] * line[at]
            speed = np.linalg.norm(slip[at], axis=1)
            gaps = np.diff(steps.steps[rows], prepend=steps.steps[rows[0]] - 1)
            time = np.where(gaps <= HOPS_STEPS, gaps, 1) * dt
            ones = np.ones(len(rows))
            forces = np.column_stack([ones, total[at], available[at], used[at]]) * dt[:, None]
            numbers = np.column_stack(
                [
                    *(time, forces, needed * time, lies * time, speed * time, speed < CREEPS_M_S),
                    *(slip[at] * time[:, None], way * time[:, None]),
                ]
            )
            cuts = [0, *np.flatnonzero(gaps > HOPS_STEPS).tolist(), len(rows)]
            for begin, end in pairwise(cuts):
                if end > begin:
                    yield FrictionRun(
                        first=int(steps.steps[rows[begin]]),
                        last=int(steps.steps[rows[end - 1]]),
                        count=end - begin,
                        sums=numbers[begin:end].sum(axis=0),
                        fastest_m_s=float(speed[begin:end].max()),
                        others={int(each) for each in np.unique(both[:, at[begin:end]])},
                    )

    def _close(self, number: int) -> None:
        """Judge a run that has ended."""
        run = self._open.pop(number, None)
        if run is None:
            return
        code = _code(run)
        key = code, number
        if code and run.of["went"] > self._found.get(key, (0.0,))[0]:
            self._found[key] = run.of["went"], run

    def findings(self) -> Iterator[Finding]:
        """Yield each body that slides or creeps."""
        for number in [*self._open]:
            self._close(number)
        for (code, number), (_, run) in self._found.items():
            body = self.scene.body(number)
            others = sorted(run.others, key=lambda each: self.scene.body(each).label)
            words = self._slides if code == "slides" else self._creeps
            message, cure = words(run, body.label, self.scene.body(others[0]).label)
            yield Finding(
                code=code,
                level=LEVEL_OF[code],
                message=message,
                advice=cure.call,
                cure=cure,
                body=body.label,
                other=self.scene.body(others[0]).label,
                effect=Effect(run.of["went"], "m"),
                share=run.of["went"] / size_m(body),
                steps=Span(run.first, run.last, run.count),
            )

    def _slides(self, run: FrictionRun, body: str, on: str) -> tuple[Message, Cure]:
        of = run.of
        wanted = of["needed"] / (of["weight"] or of["normal"])
        message = Message(
            "{body} slides {slid:.3g} m on {on}: friction there gives at most {available:.3g} N "
            "(coefficient {given:.3g}), and its weight takes {needed:.3g} N of it ({wanted:.3g})",
            body=body,
            on=on,
            slid=of["went"],
            available=of["available"] / of["time"],
            given=of["available"] / of["normal"],
            needed=of["needed"] / of["time"],
            wanted=wanted,
        )
        call = Message(
            "a friction well above {wanted:.2g} of one <geom> of the pair (the larger counts), or "
            "press them together with more force",
            wanted=wanted,
        )
        return message, Cure("friction", body, wanted, call)

    def _creeps(self, run: FrictionRun, body: str, on: str) -> tuple[Message, Cure]:
        of, settings = run.of, self.scene.seen.settings[-1].values
        message = Message(
            "{body} creeps {moved:.3g} mm on {on} in {time:.3g} s, {speed:.3g} mm/s, with "
            "{share:.2g} % of the friction that it could have: below its limit friction is a "
            "damper (impratio {impratio:g}, {cone} cone)",
            body=body,
            on=on,
            moved=of["went"] * 1e3,
            time=of["time"],
            speed=of["went"] * 1e3 / of["time"],
            share=1e2 * of["used"] / of["available"],
            impratio=settings.get("impratio", 1.0),
            cone=Message("elliptic") if settings.get("cone") else Message("pyramidal"),
        )
        call = Message(
            '<option cone="elliptic" impratio="10"/> slows it some ten times, '
            'noslip_iterations="5" stops it'
        )
        return message, Cure("impratio", None, 10.0, call)


def _code(run: FrictionRun) -> str:
    """Return what a run is: `slides`, `creeps` or nothing."""
    of = run.of
    straight = min(of["slid"], of["went"]) > STRAIGHT * max(of["slid"], of["moved"])
    if of["went"] < SLIPS_M or not straight:
        return ""
    if of["needed"] > of["available"] > LOADED * of["needed"]:
        return "slides" if of["went"] >= SLIDES_SHARE * of["moved"] else ""
    slow = of["slower"] >= max(EACH_STEP * run.count, CREEPS_STEPS)
    loaded = of["needed"] > LOADED * of["available"]
    return "creeps" if slow and loaded and of["used"] < AT_LIMIT_SHARE * of["available"] else ""
