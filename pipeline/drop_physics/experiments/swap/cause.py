"""Finds why two runs differ by swapping values and repeating single steps.

A single step cannot be chaotic: repeated with a swapped value, its result equals the first run's
bit for bit, or it does not. Inputs before the first difference are swapped first, then fields of
the compiled models, then the engine's step. Steps that the first run's own engine does not
reproduce prove nothing, and are left out.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drop_physics.arrays import Flags, Int64
from drop_physics.experiments.swap.answer import (
    Class,
    DifferenceCause,
    End,
    First,
    Nudges,
    ProvedDifference,
    SwapProof,
    Value,
)
from drop_physics.experiments.swap.first import (
    FirstInput,
    first_apart,
    first_given,
    first_hidden,
    given_at,
    lateness,
)
from drop_physics.experiments.swap.minimal import minimal
from drop_physics.trace.swaps import FieldApart, OneStep, StageApart

SAMPLED = 60
"""Most steps on which a set of fields is tested."""
ROUNDING, TINY = 3e-7, 1e-15
"""Relative and absolute differences up to which a number differs by rounding: of float32, or of a
sum in another order."""
SMALL = 1e-7
"""Largest first difference that may grow by chaos alone."""
REAL = 1e-9
"""Differences in velocity above this are not rounding alone."""
NUDGES = 3
MOST_CAUSES = 3
"""Most fields of a cause that are described individually."""

PRESENT: Mapping[str, tuple[Value, Value]] = {"a": ("present", None), "b": (None, "present")}
"""Values shown for an element that only one run has."""

Site = Callable[[str, int], tuple[str | None, str | None]]
"""Function that returns the line in each script that set a value before a step."""


@dataclass(frozen=True)
class Alike:
    """Flags for what two runs have in common besides recorded steps: script and engine."""

    script: bool
    """Whether both have the same script text and arguments."""
    engine: bool
    """Whether both have the same engine and version."""


class HaltedError(Exception):
    """Raised to end a search early, with the results so far."""


class CauseSearch:
    """Finds which input, model field or engine makes two runs differ.

    Parameters
    ----------
    one
        Repeats single steps.
    alike
        Flags for a common script and engine.
    tolerance
        The largest difference that counts as none; 0 for the same bits.
    site
        Function that finds the lines of the scripts that set a value.
    halts
        Returns whether to stop the search, and answer with the results so far.
    """

    def __init__(
        self,
        one: OneStep,
        alike: Alike,
        tolerance: float = 0.0,
        site: Site = lambda *_: (None, None),
        halts: Callable[[], bool] = lambda: False,
    ) -> None:
        self._one, self._alike, self._tolerance, self._site = one, alike, tolerance, site
        self._halts = halts
        self._common, self._fields = one.common, one.common.fields
        self._whole = False

    def answer(self) -> ProvedDifference:
        """Find the cause of the difference, and return it."""
        return self._numbered(self._found())

    def _numbered(self, answer: ProvedDifference) -> ProvedDifference:
        """Convert step numbers in the result to those of the first run."""
        number, first = self._common.number, answer.first

        def told(causes: Sequence[DifferenceCause]) -> list[DifferenceCause]:
            return [
                cause if cause.step is None else replace(cause, step=number(cause.step))
                for cause in causes
            ]

        return replace(
            answer,
            same_until=number(answer.same_until),
            first=None if first is None else replace(first, step=number(first.step)),
            because=told(answer.because),
            also=told(answer.also),
        )

    def _found(self) -> ProvedDifference:
        """Find the cause of the first difference between two runs; count the compared steps."""
        common, first = self._common, first_apart(self._common, self._tolerance)
        if first is None and any(common.moves_alone.values()):
            told = alone(common.moves_alone)
            return ProvedDifference(common.lengths, common.steps - 1, 0.0, None, "model", told)
        if first is None:
            cls: Class = "none" if len({*common.lengths}) == 1 else "length"
            until_s = float(common.times_s[0][common.steps - 1]) if common.steps else 0.0
            effects = self._idle() if cls == "none" else []
            return ProvedDifference(
                common.lengths, common.steps - 1, until_s, None, cls, no_effect=effects
            )
        step = first.step
        until_s = float(common.times_s[0][step - 1]) if step else 0.0
        last = common.steps - 1
        end = self._one.apart(last)
        answer = ProvedDifference(
            common.lengths, step - 1, until_s, first, None, end=End(end.value, end.unit, end.body)
        )
        try:
            return self._nudged(self._decided(answer, first))
        except HaltedError:
            return replace(answer, is_halted=True)

    def _idle(self) -> list[str]:
        """Return the names of inputs and fields that differ although the motion is the same."""
        given = [column for column in self._common.columns if column.kind in ("input", "edit")]
        differ = [each.name for each in given if first_given([each], self._common.steps - 1)]
        return [*dict.fromkeys([*self._others(()), *differ, *self._common.other_fields])]

    def _others(self, named: Collection[str | None]) -> list[str]:
        """Return the other fields that differ, without those that the engine derives."""
        others = (each for each in self._fields if not each.is_derived and not each.is_structure)
        return [*dict.fromkeys(each.field for each in others if each.field not in named)]

    # -- what was given ---------------------------------------------------------------------------

    def _decided(self, answer: ProvedDifference, first: First) -> ProvedDifference:
        common, step = self._common, first.step
        given = first_given(common.columns, step)
        redone = self._judged(step)
        crossed = self._one.crossed(self._steps())
        answer = replace(answer, undone=int((~redone).sum()))
        if not redone[step]:
            because = [] if given is None else [self._told(given)]
            return replace(answer, because=because)
        if crossed[step] and given is not None:
            return self._by_given(answer, given, step, crossed, redone)
        if crossed[step]:
            hidden = first_hidden(common, step)
            if hidden is None:
                return answer
            self._whole, step = True, hidden
            redone = self._judged(step)
            crossed = self._one.crossed(self._steps(), whole=True)
            if crossed[step] or not redone[step]:
                return answer
        return self._by_model(answer, given, step, crossed, redone)

    def _judged(self, first: int) -> Flags:
        """Flag the steps that can be tested: those that the first run's engine reproduces.

        Of the steps in which a body falls asleep or wakes, only the step of the first difference is
        flagged.
        """
        settled = self._one.settled()
        settled[first] = True
        return self._one.redone(whole=self._whole) & settled

    def _steps(self) -> Int64:
        return np.arange(self._common.steps)

    def _by_given(
        self, answer: ProvedDifference, given: FirstInput, step: int, crossed: Flags, redone: Flags
    ) -> ProvedDifference:
        """Return the result for a first difference that states and inputs explain."""
        cause = [self._told(each) for each in self._needed(given, step)]
        wrong = np.flatnonzero(~crossed & redone)
        by = {"input": "inputs", "edit": "written"}.get(given.paired.kind, "state")
        proved = SwapProof(
            by, int((crossed & redone).sum()), int(redone.sum()), not self._tolerance
        )
        also = self._second(wrong)
        named = {each.field for each in also}
        effects = self._others(named)
        return replace(
            answer,
            cls=self._class_of(given),
            because=cause[:MOST_CAUSES],
            also=also,
            proved=proved,
            no_effect=effects if not len(wrong) or also else [],
        )

    def _class_of(self, given: FirstInput) -> Class:
        if given.paired.kind == "edit":
            return "settings" if given.paired.is_setting else "model"
        if given.paired.kind != "input":
            return "start"
        if not self._alike.engine or self._fields:
            return "input"
        rounding = given.share < ROUNDING or given.size < TINY
        if self._alike.script or (rounding and given.size < SMALL):
            return "host"
        return "input"

    def _needed(self, given: FirstInput, step: int) -> list[FirstInput]:
        """Return the differing states or inputs before a step that suffice to explain the step."""
        units = [*given_at(self._common.columns, step)]
        of_first = [unit for unit in units if unit.paired is given.paired]
        if len(units) < 2 or not of_first:
            return [given]

        def holds(taken: list[FirstInput]) -> bool:
            kept: dict[str, list[int]] = {}
            for unit in units:
                if unit not in taken:
                    kept.setdefault(unit.paired.name, []).extend(unit.columns)
            return bool(self._one.crossed(np.array([step]), (), kept)[0])

        least = minimal(of_first, holds) if holds(of_first) else minimal(units, holds)
        found: dict[str, FirstInput] = {}
        for each in least:
            earliest = first_given([each.paired], step)
            since = earliest.step if earliest is not None else step
            before = found.get(each.paired.name)
            columns = [*(before.columns if before is not None else []), *each.columns]
            at = [c for c in columns if _is_apart(each, since, c)]
            found[each.paired.name] = FirstInput(each.paired, since, at or columns)
        return sorted(found.values(), key=lambda each: each.step)

    def _told(self, given: FirstInput) -> DifferenceCause:
        a, b = given.values
        sites = self._site(given.paired.name, given.step)
        what = {"input": "input", "edit": "field"}.get(given.paired.kind, "state")
        elements = given.elements
        return DifferenceCause(
            what,  # type: ignore[arg-type]
            given.paired.name,
            ", ".join(elements[:MOST_CAUSES]) or None,
            a,
            b,
            *sites,
            step=given.step,
            detail=lateness(given) if what != "state" else "",
            others=len(elements) - MOST_CAUSES,
        )

    def _second(self, wrong: Int64) -> list[DifferenceCause]:
        """Return further causes, for the steps that swapped states and inputs do not explain."""
        if not len(wrong):
            return []
        sample = _sample(wrong)
        least = self._least(lambda fields: bool(self._crossed(sample, fields).all()))
        told = [self._told_field(word) for word in self._in_words(least)]
        if not least and not self._alike.engine:
            told = [DifferenceCause("step")]
        return [replace(each, step=int(wrong[0]), steps=len(wrong)) for each in told]

    # -- the model, or the step -------------------------------------------------------------------

    def _crossed(self, steps: Int64, fields: Sequence[int]) -> Flags:
        if self._halts():
            raise HaltedError
        return self._one.crossed(steps, fields, whole=self._whole)

    def _least(self, holds: Callable[[list[int]], bool]) -> list[int]:
        """Return a minimal set of fields whose swap reproduces the other run's step.

        Fields that the engine derives from others are left out first.
        """
        every = [*range(len(self._fields))]
        if not every or not holds(every):
            return []
        names = sorted(
            {each.field for each in self._fields},
            key=lambda name: (not any(f.is_derived for f in self._fields if f.field == name), name),
        )
        of = {name: [n for n in every if self._fields[n].field == name] for name in names}
        least = minimal(names, lambda some: holds([n for name in some for n in of[name]]))
        return minimal([n for name in least for n in of[name]], holds)

    def _by_model(
        self,
        answer: ProvedDifference,
        given: FirstInput | None,
        step: int,
        crossed: Flags,
        redone: Flags,
    ) -> ProvedDifference:
        every = [*range(len(self._fields))]
        fixed = self._crossed(self._steps(), every) if every else crossed
        if not every or not fixed[step]:
            return self._by_step(answer, crossed, fixed, redone)
        mended = np.flatnonzero(fixed & redone)
        broken = np.flatnonzero(fixed & redone & ~crossed)
        tried = np.unique(np.concatenate([_sample(broken), _sample(mended), [step]]))
        least = self._least(lambda fields: bool(self._crossed(tried, fields).all()))
        held = self._crossed(self._steps(), least) & redone
        settings = all(self._fields[each].is_setting for each in least)
        told = [self._told_field(word) for word in self._in_words(least)]
        names = {each.field for each in told}
        derived = [self._fields[each] for each in least if self._fields[each].is_derived]
        follows = [*dict.fromkeys(each.field for each in derived if each.field not in names)]
        told[-1] = replace(told[-1], follows=tuple(follows[:MOST_CAUSES]))
        also = []
        if given is not None and self._matters(given, step, least):
            also.append(self._told(given))
        wrong = np.flatnonzero(redone & ~fixed)
        if len(wrong) and not self._alike.engine:
            also.append(DifferenceCause("step", step=int(wrong[0]), steps=len(wrong)))
        named = {self._fields[each].field for each in least}
        effects = self._others(named)
        return replace(
            answer,
            cls="settings" if settings else "model",
            because=told,
            also=also,
            proved=SwapProof("fields", int(held.sum()), int(redone.sum()), not self._tolerance),
            no_effect=effects if held[mended].all() else [],
        )

    def _matters(self, given: FirstInput, step: int, fields: list[int]) -> bool:
        """Return whether differing inputs also affect a step, in addition to fields."""
        kept = {given.paired.name: given.columns}
        return not self._one.crossed(np.array([step]), fields, kept, whole=self._whole)[0]

    def _in_words(self, least: list[int]) -> list[int]:
        """Return the fields to report: those from which others are derived, if possible."""
        order = sorted(least, key=lambda n: (self._fields[n].is_derived, _rank(self._fields[n])))
        sources = [n for n in order if not self._fields[n].is_derived]
        return (sources or order)[:MOST_CAUSES]

    def _told_field(self, number: int) -> DifferenceCause:
        its = self._fields[number]
        if its.is_structure:
            return DifferenceCause("field", its.field)
        a, b = _changed(its)
        return DifferenceCause("field", its.field, its.element or None, a, b, detail=its.of)

    def _by_step(
        self, answer: ProvedDifference, crossed: Flags, fixed: Flags, redone: Flags
    ) -> ProvedDifference:
        """Return the result for a step that neither inputs nor the model explain."""
        every = [*range(len(self._fields))]
        differ = np.flatnonzero(redone & ~fixed)
        sizes = self._one.sizes(differ, every)
        if self._alike.engine:
            return self._by_structure(answer, differ, sizes, int(redone.sum()))
        stages = self._one.stages(differ, every)
        real = [n for n, size in enumerate(sizes) if size > REAL and stages[n][1] is not None]
        which = real[0] if real else 0
        shown: StageApart = stages[which][1] or stages[which][0] if real else stages[0][0]
        features = self._one.features(int(differ[which]), every)
        term = self._one.term(int(differ[which]), every)
        cause = DifferenceCause(
            "step",
            element=", ".join(shown.bodies) or None,
            step=int(differ[which]),
            stage=shown.stage,
            pair=shown.pair,
            feature=", ".join(features) or None,
            detail=shown.what,
            bodies=shown.bodies,
        )
        also = []
        by_model = np.flatnonzero(redone & fixed & ~crossed)
        if len(by_model):
            tried = _sample(by_model)
            least = self._least(lambda fields: bool(self._crossed(tried, fields).all()))
            also = [
                replace(self._told_field(word), step=int(by_model[0]), steps=len(by_model))
                for word in self._in_words(least)
            ]
        named = {each.field for each in also}
        counts = Counter(size > REAL for size in sizes.tolist())
        return replace(
            answer,
            cls="step",
            because=[cause],
            also=also,
            proved=SwapProof(
                "engine",
                len(differ),
                int(redone.sum()),
                not self._tolerance,
                counts[True],
                None if term is None else term.name,
            ),
            no_effect=self._others(named),
        )

    def _by_structure(
        self, answer: ProvedDifference, differ: Int64, sizes: object, of: int
    ) -> ProvedDifference:
        """Return the result if one engine made both runs: differently built models."""
        only = self._common.only
        beyond = int((np.asarray(sizes) > REAL).sum())
        told = alone(only)
        if not told and self._common.is_reordered:
            told = [DifferenceCause("order")]
        if not told and self._common.other_fields:
            told = [DifferenceCause("field", ", ".join(self._common.other_fields[:MOST_CAUSES]))]
        if not told:
            return answer
        return replace(
            answer,
            cls="model",
            because=told,
            proved=SwapProof("structure", len(differ), of, not self._tolerance, beyond),
        )

    # -- the end ----------------------------------------------------------------------------------

    def _nudged(self, answer: ProvedDifference) -> ProvedDifference:
        """Add how far random changes of the first difference's size move the end."""
        first = answer.first
        if first is None or not 0 < first.size <= SMALL or len({*answer.steps}) > 1:
            return answer
        size = max(first.size, TINY)
        again, ends = self._one.nudged(first.step, size, NUDGES)
        return replace(answer, nudges=Nudges(size, ends)) if again else answer


def alone(only: Mapping[str, Sequence[str]]) -> list[DifferenceCause]:
    """Return the elements that only one run has, `a` or `b`, as causes."""
    return [
        DifferenceCause(
            "element", None, ", ".join([*dict.fromkeys(names)][:MOST_CAUSES]), *PRESENT[side]
        )
        for side, names in only.items()
        if names
    ]


def _is_apart(given: FirstInput, step: int, column: int) -> bool:
    a, b = given.paired.before_a[step, column], given.paired.before_b[step, column]
    return bool(a.tobytes() != b.tobytes())


def _rank(told: FieldApart) -> float:
    """Return a sort key for fields: the largest relative change first."""
    a, b = np.array(told.a), np.array(told.b)
    if a.shape != b.shape or not a.size:
        return 0.0
    scale = max(float(np.abs(np.concatenate((a, b))).max()), 1e-300)
    return -float(np.abs(a - b).max()) / scale


def _changed(told: FieldApart) -> tuple[float | tuple[float, ...], float | tuple[float, ...]]:
    """Return the differing numbers of an element, in both models."""
    if len(told.a) != len(told.b):
        return told.a, told.b
    which = [n for n, (x, y) in enumerate(zip(told.a, told.b, strict=True)) if x != y]
    a, b = (tuple(values[n] for n in which) for values in (told.a, told.b))
    return (a[0], b[0]) if len(which) == 1 else (a, b)


def _sample(steps: Int64) -> Int64:
    """Return evenly spaced steps, including the first."""
    return steps[:: max(1, len(steps) // SAMPLED)]
