"""Whether what begins in the same state, restored or set by hand, runs as it did before."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from drop_physics.explain.steps import Steps
from drop_physics.messages import Message
from drop_physics.rules.answer import Answer, Cure, Effect, Finding, Scene, Span
from drop_physics.rules.arguments import given, site_of
from drop_physics.rules.joint import distance
from drop_physics.trace.acts import FILTERS, MAKES, PUSHES, SETS_TIMESTEP, Act
from drop_physics.trace.calls import Call

Float64 = NDArray[np.float64]

STATES = Act.SAVE, Act.RESTORE, Act.CLEAR
"""Each begins an episode,"""
BY_HAND = Act.SET_POSE, Act.SET_VELOCITY, Act.SET_JOINT
"""and so does the first of these in a gap between steps."""
SETTINGS = Act.SET_GRAVITY, Act.SET_TIMESTEP, Act.SET_ENGINE
"""The engine's own settings."""
SETS = (
    *(Act.SET_PROPERTY, Act.CONSTRAIN, Act.CHANGE_CONSTRAINT, Act.RELEASE, Act.COMMAND),
    *SETTINGS,
    *FILTERS,
)
"""What none of these takes back;"""
CLEARED = SETS_TIMESTEP
"""but for what clears a simulation, which leaves only that of these."""
UNREPORTED = frozenset(
    (
        *("linearDamping", "angularDamping", "jointDamping", "maxJointVelocity"),
        *("jointLowerLimit", "jointUpperLimit", "activationState"),
    )
)
"""Properties that the engine never reports, so that a call of them may change something."""
IDS = "Id", "Index", "Indices", "Mode"
"""Ends of the arguments that name what is set."""
MOST_STEPS, LEAST_STEPS = 64, 10
"""Least steps of an episode that is compared; in a shorter one something is moved by resets."""

SORTED = Message(
    "p.setPhysicsEngineParameter(deterministicOverlappingPairs=1) at the start sorts them: then "
    "both runs are equal to the bit"
)
"""Measured: equal to the bit in 9 of 9 scenes that differed without a setter in between."""

Key = tuple[int, str]
"""A body, as its simulation and its reader call it: it may be loaded again."""


@dataclass
class _Episode:
    """What followed a state that was saved or set."""

    begin: Call
    states: dict[tuple[Key, int], Float64] = field(default_factory=dict)
    """By body and steps after it."""
    calls: dict[int, list[Call]] = field(default_factory=dict)
    """By steps after it."""
    sets: dict[tuple[object, ...], tuple[tuple[float, ...] | None, Call]] = field(
        default_factory=dict
    )
    """What was set in it, by what it names: the numbers before it, and the latest call."""
    units: dict[Key, list[str]] = field(default_factory=dict)
    """Of a body's numbers."""
    touched: bool = False
    """Whether there were contacts in its first step."""

    @property
    def kind(self) -> tuple[object, ...]:
        """What it is compared with: episodes of the same saved state, or of the same call."""
        act = self.begin.act
        if act is Act.SAVE:
            return (self.begin.result,)
        if act is Act.RESTORE:
            return given(self.begin, "stateId") or (self.begin.arguments,)
        return (act,) if act is Act.CLEAR else BY_HAND


class RestoreDiffers(Answer):
    """Compares each episode with the one before that began in the same state, to the bit."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._now: dict[int, _Episode] = {}
        self._before: dict[tuple[object, ...], _Episode] = {}
        self._set: dict[tuple[object, ...], tuple[float, ...]] = {}
        """The numbers of the latest call of each setter."""
        self._found: dict[tuple[object, ...], Finding] = {}

    def see(self) -> None:
        """Follow the episodes of each simulation."""
        piece = self.scene.piece
        if not any(site.act in (*STATES, *BY_HAND) for site in piece.calls.sites.values()):
            return  # in the whole recording nothing begins an episode
        calls = piece.calls.of()
        for client in {each.client for each in self.scene.seen.bodies.values()}:
            own: list[Call] = []
            for call in calls:
                if call.client != client:
                    continue
                if self._begins(client, call):
                    self._follow(client, own, call.at.step)
                    self._close(client)
                    self._now[client], own = _Episode(call), []
                else:
                    own.append(call)
            self._follow(client, own, piece.end)

    def findings(self) -> Iterator[Finding]:
        """Yield the first episodes of each kind that differ."""
        for client in [*self._now]:
            self._close(client)
        yield from self._found.values()

    def _begins(self, client: int, call: Call) -> bool:
        if call.act in STATES:
            return True
        now = self._now.get(client)
        first = now is None or now.begin.at.step != call.at.step
        return first and call.act in BY_HAND

    def _changes(self, call: Call) -> bool:
        """Return whether a setter's first call changed what the engine reports, if it does."""
        seen, body = self.scene.seen, given(call, "bodyUniqueId")
        if call.act is Act.SET_PROPERTY:
            if UNREPORTED & call.site.places.keys():
                return True
            ends = [
                each.at
                for each in seen.dynamics
                if (each.body.client, each.body.engine_id) == (call.client, *body)
            ]
        elif call.act in SETTINGS:
            ends = [each.at for each in seen.settings if each.client == call.client]
        else:
            return True
        # A row is written where one changed, before the next step.
        return any(at.step == call.at.step and at.call >= call.at.call for at in ends)

    def _close(self, client: int) -> None:
        """Compare an episode that has ended with the one before."""
        episode = self._now.pop(client, None)
        if episode is None or max((step for _, step in episode.states), default=0) < LEAST_STEPS:
            return
        key = client, *episode.kind
        before = self._before.get(key)
        if before is not None and key not in self._found:
            finding = self._compared(before, episode)
            if finding is not None:
                self._found[key] = finding
        self._before[key] = episode

    def _compared(self, first: _Episode, second: _Episode) -> Finding | None:
        same = next(
            (
                n
                for n in range(MOST_STEPS)
                if _said(first.calls.get(n, [])) != _said(second.calls.get(n, []))
            ),
            MOST_STEPS,
        )
        common = first.states.keys() & second.states.keys()
        apart = {
            key: float(np.abs(first.states[key] - second.states[key]).max(initial=0.0))
            for key in common
            if first.states[key].shape == second.states[key].shape
        }
        begun = [{body for body, n in each.states if n == 0} for each in (first, second)]
        differ = [key for key, gap in apart.items() if gap > 0 and key[1] <= same]
        began = begun[0] == begun[1] and not any(apart.get((body, 0), 1.0) for body in begun[0])
        if not differ or not began:
            return None
        last = max(step for _, step in apart if step <= same)
        # Of those that differ first the one that ends farthest apart: sets have no order.
        body, step = min(differ, key=lambda key: (key[1], -apart.get((key[0], last), 0.0), key))
        cause = _cause(first, second, body[0])
        if cause is None:
            return None
        why, call = cause
        at = (body, last) if (body, last) in apart else (body, step)
        gap, axis = apart[at], int(np.abs(first.states[at] - second.states[at]).argmax())
        unit = second.units[body][axis]
        begin = second.begin.at.step
        message = Message(
            "{body} runs differently after p.{function}(…) although the calls are the same: from "
            "step {step:,} on, and by {gap} after {last:,} steps; {why}",
            body=body[1],
            step=begin + step,
            gap=distance(gap, unit),
            last=last,
            why=why,
            function=second.begin.function,
        )
        return Finding(
            code="restore-differs",
            level="asked",
            message=message,
            advice=None if call is not None else SORTED,
            cure=Cure("pairs-sorted", value=1.0)
            if call is None
            else Cure("without", given={"function": call.function}),
            body=body[1],
            effect=Effect(gap, unit),
            share=min(gap, 1.0),
            site=site_of(call or second.begin),
            steps=Span(begin + step, begin + last, last - step + 1),
        )

    def _follow(self, client: int, calls: list[Call], last: int) -> None:
        """Take the states and calls of an episode in a piece, up to sample `last`."""
        episode = self._now.get(client)
        start = 0 if episode is None else episode.begin.at.step
        for call in calls:
            # A force that no step has used yet waits for the next.
            waits = call.act in PUSHES and call.at.step == last
            if waits or call.act in (*SETS, *MAKES):
                named = _named(call)
                if episode is not None and (named in self._set or self._changes(call)):
                    before, _ = episode.sets.get(named, (self._set.get(named), call))
                    episode.sets[named] = before, call
                if not waits:
                    self._set[named] = call.numbers
            if episode is not None and call.at.step - start < MOST_STEPS:
                episode.calls.setdefault(call.at.step - start, []).append(call)
        if episode is None or (last < self.scene.piece.end and last - start < LEAST_STEPS):
            return
        for judged in self.scene.judged.values():
            if judged.body.client == client:
                for steps in judged.stretches:
                    _keep(episode, (judged.body.engine_id, judged.body.label), steps, last)


def _keep(episode: _Episode, key: Key, steps: Steps, last: int) -> None:
    """Note the states of a body in the first steps of an episode."""
    start = episode.begin.at.step
    begin = int(np.searchsorted(steps.steps, start, side="right"))
    end = int(np.searchsorted(steps.steps, min(last, start + MOST_STEPS), side="right"))
    for row in range(begin, end):
        step, after = int(steps.steps[row]) - start, steps.after
        if step == 1:
            first = steps.before.at(slice(row, row + 1))
            episode.states[key, 0] = np.hstack(
                (first.position_m, first.orientation, first.joints, first.velocity)
            )[0]
            tree, slides = steps.law.tree, ["m"] * 3
            for joint, at in zip(tree.joints, tree.coordinates, strict=True):
                slides += ["m" if joint == "prismatic" else "rad"] * (at.stop - at.start)
            episode.units[key] = slides
            episode.touched |= bool((steps.sides.step == start + 1).any())
        episode.states[key, step] = np.concatenate((after.position_m[row], after.joints[row]))


def _said(calls: list[Call]) -> list[tuple[object, ...]]:
    return [(each.function, each.numbers) for each in calls]


def _named(call: Call) -> tuple[object, ...]:
    """Return what a call sets: its function and arguments, and the body and joint that it names."""
    site = call.site
    ids = tuple([call.numbers[at] for name, at in site.places.items() if name.endswith(IDS)])
    return call.client, site.function, site.names, ids


def _cause(first: _Episode, second: _Episode, engine_id: int) -> tuple[Message, Call | None] | None:
    """Return why a body's episode differs from the one before, and the call to blame."""
    again, function = {_named(each) for each in second.calls.get(0, [])}, second.begin.function
    cleared = second.begin.act is Act.CLEAR
    left = [
        call
        for named, (before, call) in first.sets.items()
        if before != call.numbers and named not in again and (not cleared or call.act in CLEARED)
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
