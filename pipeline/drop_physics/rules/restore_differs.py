"""The rule `restore-differs`: episodes that start alike with the same calls but run differently."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator

import numpy as np

from drop_physics.arrays import Float64, Int64
from drop_physics.messages import Message
from drop_physics.quantities import gap as distance
from drop_physics.rules.answer import Span
from drop_physics.rules.arguments import given
from drop_physics.rules.episodes import AfterRestore, Key, Named
from drop_physics.rules.inputs import Inputs
from drop_physics.rules.joint import units
from drop_physics.rules.rows import Case, Remedy, SayingRow
from drop_physics.rules.rule import input_rule
from drop_physics.rules.thresholds import EPISODE_STEPS, EPISODES_MOST
from drop_physics.trace.acts import MAKES, SETS_TIMESTEP, Act
from drop_physics.trace.calls import Call
from drop_physics.trace.history import PIECE, Seen
from drop_physics.trace.states import by_body


@input_rule("restore-differs", "asked")
def restore_differs(inputs: Inputs, seen: Seen) -> Iterator[Case]:
    """Episodes with the same initial state and the same calls run differently."""
    kinds: defaultdict[tuple[object, ...], list[AfterRestore]] = defaultdict(list)
    for each in inputs.episodes.all():
        if each.end - each.begin.at.step >= EPISODE_STEPS:  # else something is moved by resets
            kinds[each.kind].append(each)
    for episodes in kinds.values():
        for at, second in enumerate(episodes[1:EPISODES_MOST], 1):
            # Of those before it, the latest of those whose calls are the same for longest.
            first = max(
                episodes[:at], key=lambda episode: (_alike(episode, second), episode.begin.at.call)
            )
            found = _compared(inputs, first, second, seen)
            if found is not None:
                yield found
                break


def _alike(first: AfterRestore, second: AfterRestore) -> int:
    """Return the number of steps up to which two episodes have the same calls."""
    asked = first.calls.items() ^ second.calls.items()
    lengths = (each.end - each.begin.at.step for each in (first, second))
    return min(*lengths, *(since for since, _ in asked), 1 << 40)


def _compared(inputs: Inputs, first: AfterRestore, second: AfterRestore, seen: Seen) -> Case | None:
    same = first.starts.keys() == second.starts.keys() and all(
        np.array_equal(start, second.starts[key], equal_nan=True)
        for key, start in first.starts.items()
    )
    if not same or not first.starts:
        return None
    begins = first.begin.at.step, second.begin.at.step
    apart = _apart(seen, begins, _alike(first, second), first.begin.client)
    if not apart:
        return None
    # Of those that differ first the one that goes farthest apart.
    key = min(apart, key=lambda each: (apart[each][0], -apart[each][2], each))
    since, last, gap, unit = apart[key]
    cause = _cause(inputs, first, second, key[0])
    if cause is None:
        return None
    why, call = cause
    numbers = seen.bodies.values()
    body = next(number for number in numbers if (number.engine_id, number.label) == key)
    return Case(
        call=call or second.begin,
        subject=body,
        span=Span(begins[1] + since, begins[1] + last, last - since + 1),
        values={
            "by_call": call is not None,
            "ordered": call is None and _other_order(inputs, first, second, seen),
            "step": begins[1] + since,
            "size": gap,
            "unit": unit,
            "gap": distance(gap, unit),
            "last": last,
            "why": why,
            "function": second.begin.function,
            "left": None if call is None else call.function,
            "part": min(gap, 1.0),
        },
    )


RUNS_DIFFERENTLY = SayingRow(
    says=Message(
        "{body} runs differently after p.{function}(…) although the calls are the same: from step "
        "{step:,} on, and by {gap} after {last:,} steps; {why}"
    )
)
restore_differs.rows(
    SayingRow(
        when=lambda by_call: by_call, cure=Remedy("without", given={"function": "left"})
    ).like(RUNS_DIFFERENTLY),
    SayingRow(
        when=lambda ordered: ordered,
        advice=Message("{call} at the start sorts them: then both runs are equal to the bit"),
        cure=Remedy("pairs-sorted", value=1.0),
    ).like(RUNS_DIFFERENTLY),
    SayingRow(
        says=Message(
            "{body} runs differently after p.{function}(…) although the calls are the same: from "
            "step {step:,} on, and by {gap} after {last:,} steps"
        )
    ),
    like=SayingRow(effect="size", unit="{unit}", share="part"),
)


def _other_order(inputs: Inputs, first: AfterRestore, second: AfterRestore, seen: Seen) -> bool:
    """Return whether the episodes' first contacts differ only in their order.

    A state saved before the first step of touching bodies has no contacts to restore.
    """
    client = first.begin.client
    sorts = [use for use in inputs.of(Act.SET_ENGINE) if "deterministicOverlappingPairs" in use.low]
    saved = [
        each.begin.at
        for each in inputs.episodes.all()
        if each.begin.act is Act.SAVE and each.kind == second.kind
    ]
    if not saved or sorts or len(first.touched | second.touched) < 2:
        return False
    at, changed = saved[-1], (seen.puts, seen.appearances)
    placed = [(each.body.client, each.at) for its in changed for each in its]
    return at.step > 0 and not any(
        (number, made.step) == (client, at.step) and made.call < at.call for number, made in placed
    )


Apart = tuple[int, int, float, str]
"""Step after which a body first differs, step of the largest difference, that difference, and its
unit."""


def _apart(seen: Seen, begins: tuple[int, int], until: int, client: int) -> dict[Key, Apart]:
    """Return the bodies that differ in the first steps of two episodes."""
    found: dict[Key, Apart] = {}
    for start in range(1, until + 1, PIECE):
        end = min(start + PIECE, until + 1)
        one, other = (_places(seen, begin + start, begin + end, client) for begin in begins)
        for key in one.keys() & other.keys():
            (steps, mine, its_units), (others, its, _) = one[key], other[key]
            if mine.shape != its.shape or (steps - begins[0] != others - begins[1]).any():
                continue
            based = mine.shape[1] - len(its_units) + 1  # the columns of a base that moves
            base_m = np.linalg.norm(mine[:, :based] - its[:, :based], axis=1, keepdims=True)
            gaps = np.hstack((base_m, np.abs(mine - its)[:, based:]))
            differs = np.flatnonzero(gaps.any(axis=1))
            if not len(differs):
                continue
            row, axis = np.unravel_index(int(np.argmax(gaps)), gaps.shape)
            gap, at = float(gaps[row, axis]), steps - begins[0]
            since = found[key][0] if key in found else int(at[differs[0]])
            if key not in found or gap > found[key][2]:
                found[key] = since, int(at[row]), gap, its_units[int(axis)]
    return found


def _places(
    seen: Seen, first: int, end: int, client: int
) -> dict[Key, tuple[Int64, Float64, list[str]]]:
    """Return steps, base and joint positions, and units, for bodies that can move."""
    piece = seen.sampled.piece(first, end)
    bases, found = by_body(piece.bases), {}
    for number in seen.moving:
        body, base, joints = seen.bodies[number], bases.get(number), piece.joints.get(number)
        if body.client != client or (base is None and joints is None):
            continue
        columns, its_units, steps = [], ["m"], np.empty(0, np.int64)
        if base is not None:
            columns, steps = [base["position_m"]], base["step"]
        if joints is not None:
            columns, steps = [*columns, joints.position], joints.steps
            for joint in body.joints:
                its_units += [units(joint)[0]] * joint.widths[0]
        if all(len(column) == len(steps) for column in columns):
            found[body.engine_id, body.label] = steps, np.hstack(columns), its_units
    return found


def _cause(
    inputs: Inputs, first: AfterRestore, second: AfterRestore, engine_id: int
) -> tuple[Message, Call | None] | None:
    """Return why a body's second episode differs, and the call that is responsible."""
    function, cleared = second.begin.function, second.begin.act is Act.CLEAR
    sets: dict[Named, tuple[tuple[float, ...] | None, Call]] = {}
    for each in inputs.episodes.between(first, second):
        for what, (before, call) in each.sets.items():
            sets[what] = sets.get(what, (before,))[0], call
    left = [
        call
        for what, (before, call) in sets.items()
        if before != call.numbers
        and what not in second.again
        and (not cleared or call.act in SETS_TIMESTEP)
    ]
    if left:
        # What names another body may change nothing here; what names none, or this one, does.
        call = min(left, key=lambda each: given(each, "bodyUniqueId") not in ((), (engine_id,)))
        values = {"function": call.function, "arguments": call.arguments, "reset": function}
        if call.act in MAKES:
            return Message(
                "p.{function}({arguments}) made a body in between, and p.{reset} leaves it there",
                **values,
            ), call
        return Message(
            "p.{function}({arguments}) came in between, and p.{reset} does not take it back",
            **values,
        ), call
    if (first.touched or second.touched) and not cleared:
        return Message(
            "pairs that touch are solved in another order, which p.{reset} does not bring back",
            reset=function,
        ), None
    return None
