"""The report of `drop diff`: what two runs have in common, how they differ, and the proof."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any

from drop_physics.experiments.swap.answer import DifferenceCause, End, Value
from drop_physics.explain.jsonable import jsonable
from drop_physics.fields import all_of
from drop_physics.messages import Message, joined, wrapped
from drop_physics.report.blocks import Fact, Facts, Report, Section
from drop_physics.stages.trust.findings import readable
from drop_physics.trace.events import ENDED

if TYPE_CHECKING:
    from drop_physics.stages.diff import Diff

LATE = ("a", "b")
"""Values of a cause's `detail` that name the run in which a value changes later."""
APART = 3
"""Exit code if two runs are not the same."""
COLUMN = 12
"""Width of a title in characters."""
LINES, WIDTH = 12, 80
"""Most lines of the report, in a terminal of this width [characters]."""
MOST = 6
"""Most names listed; the JSON contains all."""
HIDDEN = ("detail", "bodies", "others", "steps", "follows")
"""Fields of a cause that are used only to word the report."""
HOST = {
    "hash_seed": Message("PYTHONHASHSEED"),
    "numpy": Message("numpy"),
    "blas": Message("BLAS kernel"),
    "blas_threads": Message("BLAS threads"),
    "machine": Message("processor"),
    "version": Message("Python"),
}


# -- as JSON --------------------------------------------------------------------------------------


def json_of(diff: Diff) -> dict[str, Any]:
    """Return the JSON object that `--json` prints."""
    answer = diff.answer
    proved, first = answer.proved, answer.first
    return dict(
        jsonable(
            {
                "a": diff.a,
                "b": diff.b,
                "steps": [*answer.steps],
                "same_until": answer.same_until,
                "first": first and asdict(first),
                "class": answer.cls,
                "because": [*map(_json_of_cause, answer.because)],
                "also": [*map(_json_of_cause, answer.also)],
                "proved": proved
                and {
                    "by": proved.by,
                    "steps": proved.steps,
                    "of": proved.of,
                    "exact": proved.exact,
                },
                "end": answer.end and asdict(answer.end),
                "nudges": answer.nudges and asdict(answer.nudges),
                "no_effect": [*answer.no_effect],
                "runs": diff.runs,
                "cause_text": [str(fact.words) for fact in (*_because(diff), *_also(diff))],
            }
        )
    )


def _json_of_cause(cause: DifferenceCause) -> dict[str, Any]:
    return {name: value for name, value in asdict(cause).items() if name not in HIDDEN}


# -- as a report ----------------------------------------------------------------------------------


def report_of(diff: Diff) -> Report:
    """Report what two runs have in common, why they differ, and the proof."""
    code = 0 if diff.answer.cls == "none" else APART
    return Report(sections=[Section([Facts(facts_of(diff), COLUMN)])], code=code)


def facts_of(diff: Diff) -> list[Fact]:
    """Return the lines of the report."""
    because, also = [*_because(diff)], [*_also(diff)]
    rows = [
        *_same(diff),
        *_cut_short(diff),
        *because,
        *_proved(diff),
        *also,
        *_host(diff),
        *_end(diff),
        *_pictures(diff),
        *_no_effect(diff),
    ]
    least = [*also[:0:-1], *because[:0:-1], *reversed(rows)]  # what is needed least comes first
    for each in least:
        if sum(map(_height, rows)) <= LINES:
            break
        if each in rows and each is not rows[0] and each not in (*because[:1], *also[:1]):
            rows.remove(each)
    return rows


def _height(fact: Fact) -> int:
    """Return how many terminal lines a fact takes."""
    return len(wrapped(fact.words, WIDTH - COLUMN))


def _same(diff: Diff) -> Iterator[Fact]:
    answer = diff.answer
    count = min(answer.steps)
    exact = Message("to the bit") if not diff.tolerance else _within(diff.tolerance)
    first = answer.first
    words: str
    if answer.cls == "none":
        words = Message("{exact} in all {count:,} steps", exact=exact, count=count)
    elif answer.cls == "length":
        words = Message(
            "{exact} in the {count:,} steps that both make; {a} makes {mine:,}, {b} {theirs:,}",
            exact=exact,
            count=count,
            a=diff.a,
            b=diff.b,
            mine=answer.steps[0],
            theirs=answer.steps[1],
        )
    elif first is None:
        words = Message("as far as both have the same bodies and joints, which is not all")
    else:
        bodies = ", ".join(first.bodies[:4]) + (" …" if len(first.bodies) > 4 else "")
        words = Message(
            "{exact} until step {step} ({time:.3g} s); then {bodies} apart",
            exact=exact,
            step=answer.same_until,
            time=answer.same_until_s,
            bodies=bodies,
        )
        if answer.same_until < 0:
            words = Message(
                "in no step: {bodies} apart after step 0, by {size:.2g} {unit}",
                bodies=bodies,
                size=first.size,
                unit=first.unit,
            )
    yield Fact(Message("same"), words, "bold")


def _cut_short(diff: Diff) -> Iterator[Fact]:
    """Yield a note if a script was stopped, so that the comparison ends there."""
    cut = [
        Message("{side} {ended}", side=side, ended=ENDED[ended])
        for side, ended in zip((diff.a, diff.b), diff.ended, strict=True)
        if ended in ("failed", "interrupted", "disk")
    ]
    if cut:
        yield Fact(Message("ended"), joined(", ", cut))
    if diff.unseeded and diff.answer.cls != "none":
        draws = Message(
            "unseeded random numbers are drawn by {names}", names=all_of(diff.unseeded[:2])
        )
        yield Fact(Message("draws"), draws)


def _within(tolerance: float) -> Message:
    return Message("within {tolerance:g}", tolerance=tolerance)


# -- why ------------------------------------------------------------------------------------------


def _because(diff: Diff) -> Iterator[Fact]:
    for number, cause in enumerate(diff.answer.because):
        words = _cause(diff, cause)
        if diff.answer.cls == "host" and not number:
            words = Message(
                "your own code gave another number of the same states: {cause}", cause=words
            )
        yield Fact(Message("because") if not number else "", words)


def _also(diff: Diff) -> Iterator[Fact]:
    for number, cause in enumerate(diff.answer.also):
        words = _cause(diff, cause)
        if cause.steps is not None:
            words = Message(
                "{cause}: in {steps:,} steps, first in step {step}",
                cause=words,
                steps=cause.steps,
                step=cause.step,
            )
        yield Fact(Message("also") if not number else "", words)


def _cause(diff: Diff, cause: DifferenceCause) -> Message:
    if cause.what == "step":
        return _step(diff, cause)
    if cause.what == "known":
        return _known(cause)
    if cause.what == "order":
        words = Message("the same elements in another order")
        if cause.element:
            words = Message("the order in which bodies are made: {what}", what=cause.element)
        sites = _sites(cause)
        return joined("", [words, f" ({sites})"]) if sites else words
    if cause.what == "call" and cause.field == cause.a and cause.b is not None:
        return _where(Message("{a} → {b}", a=cause.a, b=cause.b), cause)
    if cause.what == "call" and (cause.a is None or cause.b is None):
        only = diff.a if cause.b is None else diff.b
        value = cause.a if cause.b is None else cause.b
        words = Message("{call}: only in {side}", call=_called(cause, value), side=only)
        return _where(words, cause)
    if cause.what == "element":
        only = diff.a if cause.a else diff.b
        return Message("only {side} has {elements}", side=only, elements=cause.element)
    name = cause.field if cause.element is None else _named(cause)
    if cause.a is None and cause.b is None:
        return Message("{name} differs", name=name)
    a, b = values(cause.a, cause.b)
    words = _where(Message("{name}: {a} → {b}", name=name, a=a, b=b), cause)
    if cause.follows:
        follows = Message("and what follows from it: {fields}", fields=", ".join(cause.follows))
        words = joined(", ", [words, follows])
    if cause.detail in LATE:
        late = diff.a if cause.detail == "a" else diff.b
        words = joined("; ", [words, Message("{side} changes it one step later", side=late)])
    return words


def _where(words: Message, cause: DifferenceCause) -> Message:
    """Add step and source lines of a cause to a text."""
    if cause.step is not None and cause.steps is None:
        words = joined("", [words, Message(" before step {step}", step=cause.step)])
    sites = _sites(cause)
    return joined("", [words, f" ({sites})"]) if sites else words


def _known(cause: DifferenceCause) -> Message:
    """Describe a known difference between two engines."""
    if cause.step is not None:
        return Message(
            "contacts: both touch by step {step}, and none of the known differences takes it away",
            step=cause.step,
        )
    if cause.a is None or cause.b is None:
        return Message("{name}", name=cause.field)
    a, b = values(cause.a, cause.b)
    return Message("{name}: {a} → {b}", name=cause.field, a=a, b=b)


def _called(cause: DifferenceCause, value: Value) -> str:
    """Describe a call, with the argument that differs or, if none does, all arguments."""
    call = str(cause.field)
    call = f"{call[:-1]}={value})" if call.endswith(")") else str(value)
    return _named(replace(cause, field=call)) if cause.element else call


def _named(cause: DifferenceCause) -> Message:
    name = Message("{field} of {element}", field=cause.field, element=cause.element)
    if cause.others > 0:
        name = joined("", [name, Message(" and {n} more", n=cause.others)])
    if cause.what == "field" and cause.detail and cause.detail not in LATE:
        return joined("", [name, f" ({cause.detail})"])
    return name


def _sites(cause: DifferenceCause) -> str:
    return ", ".join(dict.fromkeys(filter(None, (cause.site_a, cause.site_b))))


def _step(diff: Diff, cause: DifferenceCause) -> Message:
    words = Message("{engine} makes another step of the same state", engine=diff.engines[1])
    if cause.stage is None:
        return words
    where: str = cause.stage
    if cause.pair is not None:
        where = Message("{stage} of {pair}", stage=cause.stage, pair=" – ".join(cause.pair))
        if cause.bodies:
            where = joined("", [where, f" ({', '.join(dict.fromkeys(cause.bodies))})"])
    return joined(": ", [words, where, cause.detail])


def values(a: Value, b: Value) -> tuple[str, str]:
    """Format two values with enough digits to tell them apart."""
    if isinstance(a, tuple) or isinstance(b, tuple):
        both = [each if isinstance(each, tuple) else (each,) for each in (a, b)]
        few = len(both[0]) == len(both[1]) <= 4
        if not few:
            return f"{len(both[0])} numbers", f"{len(both[1])} others"
        pairs = [values(x, y) for x, y in zip(*both, strict=True)]
        return tuple(" ".join(each) for each in zip(*pairs, strict=True))  # type: ignore[return-value]
    if not isinstance(a, float | int) or not isinstance(b, float | int):
        return str(a), str(b)
    if a == b:
        return f"{a:.4g}", f"{b:.4g}"
    for digits in (4, 6, 9):
        short = f"{a:.{digits}g}", f"{b:.{digits}g}"
        if short[0] != short[1] and abs(float(short[0]) - float(short[1])) > 0.5 * abs(a - b):
            return short
    return repr(float(a)), repr(float(b))


def _proved(diff: Diff) -> Iterator[Fact]:
    answer, proved = diff.answer, diff.answer.proved
    if answer.cls in ("none", "length") or answer.first is None:
        return
    if any(cause.what == "known" and cause.step is not None for cause in answer.because):
        return
    if proved is None and answer.is_halted:
        yield Fact(Message("proved"), Message("nothing yet: it was stopped"))
        return
    if proved is None and not diff.runs:
        what = Message("nothing: not all that a step starts from is recorded")
        yield Fact(Message("proved"), what)
        return
    if proved is None:
        words = Message("nothing: no swap that was tried gives a step of {a}", a=diff.a)
        if answer.undone:
            words = Message(
                "nothing: {undone:,} steps of {a} do not follow to the bit from their recorded "
                "states; --tolerance allows rounding",
                undone=answer.undone,
                a=diff.a,
            )
        yield Fact(Message("proved"), words)
        return
    exact = Message("to the bit") if proved.exact else _within(diff.tolerance)
    how = {"n": proved.steps, "of": proved.of, "a": diff.a, "b": diff.b, "exact": exact}
    if proved.by in ("engine", "structure"):
        words = Message("from the states of {a}, {n:,} of {of:,} single steps differ", **how)
        if proved.beyond_rounding is not None and proved.beyond_rounding < proved.steps:
            more = Message("{n:,} by more than rounding", n=proved.beyond_rounding)
            words = joined(", ", [words, more])
        if proved.by == "engine":
            alike = Message("inputs and compiled values are the same")
            words = joined("; ", [words, alike])
        feature = next((each.feature for each in answer.because if each.feature), None)
        if feature is not None:
            without = Message("without {feature} both make the same step", feature=feature)
            words = joined("; ", [words, without])
        if proved.term is not None:
            put = Message(
                "the {term} forces of {a}, applied in {b}, give its step", term=proved.term, **how
            )
            words = joined("; ", [words, put])
        yield Fact(Message("proved"), words)
        return
    template = SWAPPED[proved.by]
    yield Fact(Message("proved"), Message(template, **how))


SWAPPED = {
    "inputs": Message(
        "with the inputs of {a}, {b} makes its step in {n:,} of {of:,} steps, {exact}"
    ),
    "state": Message(
        "with the states of {a}, {b} makes its step in {n:,} of {of:,} steps, {exact}"
    ),
    "written": Message(
        "with what {a} writes, {b} makes its step in {n:,} of {of:,} steps, {exact}"
    ),
    "fields": Message(
        "with these values of {a}, {b} makes its step in {n:,} of {of:,} steps, {exact}"
    ),
    "known": Message("without it both are the same in {n:,} of {of:,} steps, {exact}"),
    "calls": Message(
        "{a} with these calls of {b} alone is {b} in the first {n:,} of {of:,} steps, {exact}"
    ),
}
"""Sentences that state the proof of a cause, by what was swapped between the runs."""


def _host(diff: Diff) -> Iterator[Fact]:
    if diff.answer.cls == "host" and diff.host:
        differ = [
            Message("{name} {a} → {b}", name=HOST[name], a=a, b=b)
            for name, (a, b) in diff.host.items()
        ]
        yield Fact(Message("differ"), joined(", ", differ))


def _end(diff: Diff) -> Iterator[Fact]:
    end, nudges = diff.answer.end, diff.answer.nudges
    if end is None:
        return
    words = Message("{far} apart ({body})", far=_far(end), body=end.body)
    if nudges is not None:
        low, high = nudges.ends[0], nudges.ends[-1]
        if end.value > 100 * nudges.size and high > end.value / 10:
            other = Message(
                "three other nudges of {size:.0e} end {low:.1e} to {high:.1e} apart: the end says "
                "nothing of the cause",
                size=nudges.size,
                low=low,
                high=high,
            )
            words = joined("; ", [words, other])
        elif end.value <= 100 * nudges.size:
            words = joined("; ", [words, Message("it does not grow")])
    if diff.answer.steps[0] != diff.answer.steps[1]:
        lengths = Message(
            "{a} makes {mine:,} steps, {b} {theirs:,}",
            a=diff.a,
            b=diff.b,
            mine=diff.answer.steps[0],
            theirs=diff.answer.steps[1],
        )
        words = joined("; ", [words, lengths])
    yield Fact(Message("in the end"), words)


def _far(end: End) -> str:
    return readable(end.value, end.unit) if end.value > 1e-7 else f"{end.value:.1e} {end.unit}"


def _pictures(diff: Diff) -> Iterator[Fact]:
    apart = diff.pictures
    if apart is not None:
        words = Message(
            "{differing:,} of {of:,} differ though states are the same, first after step {step} "
            "({site})",
            differing=apart.differing,
            of=apart.of,
            step=apart.first_step - 1,
            site=apart.site,
        )
        yield Fact(Message("pictures"), words)


def _no_effect(diff: Diff) -> Iterator[Fact]:
    names: Sequence[str] = diff.answer.no_effect
    if names:
        shown = ", ".join(names[:MOST])
        words = shown if len(names) <= MOST else f"{shown} …"
        yield Fact(Message("no effect"), words)
