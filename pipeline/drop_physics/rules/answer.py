"""Findings, and the scene from which rules read."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from drop_physics.account.rows import AccountRow, RowTerm
from drop_physics.arrays import Flags, Float64, Int64
from drop_physics.explain.actuators import ActuatorTable
from drop_physics.explain.bodies import Record
from drop_physics.explain.joined import Constraints
from drop_physics.explain.joints import JointTable, JointTelemetry
from drop_physics.explain.recording import ExplainedPiece
from drop_physics.explain.step_status import SampleStatus, StepVerdicts
from drop_physics.explain.steps import BodySteps, StepBatch, Steps
from drop_physics.explain.targets import Targets
from drop_physics.explain.times import StepTimes
from drop_physics.explain.touches import TouchTable
from drop_physics.explain.touching import STEPS
from drop_physics.fields import counted
from drop_physics.messages import Message, joined
from drop_physics.physics.tree import States
from drop_physics.rules.arguments import site_of
from drop_physics.rules.body_properties import AskedOfBodies
from drop_physics.rules.filtered_pairs import FilteredPairs
from drop_physics.rules.inputs import Inputs, Place
from drop_physics.rules.placing import Placing
from drop_physics.trace.acts import Act
from drop_physics.trace.calls import BODY_NAMES, Call
from drop_physics.trace.cures import Cure as Cure  # part of a finding
from drop_physics.trace.episodes import Episode
from drop_physics.trace.events import Body, Site
from drop_physics.trace.history import Piece, Seen

if TYPE_CHECKING:
    from drop_physics.rules.target_columns import TargetColumns

Rows = NDArray[np.intp]
Column = Callable[[States], Float64]
"""A column of states."""
Proof = Literal["sum", "call", "trial", "none"]
"""Proof of a finding: by the sum of impulses, by a call or a file that asks for one thing and an
engine that does another, or by a trial; advice without a proof is only to be tried."""
Level = Literal["broken", "asked", "model", "repeat", "note"]
LEVELS: tuple[Level, ...] = get_args(Level)
"""The levels, the gravest first: no longer physics; not what the script asked for; what the engine
does, though perhaps not what was meant; may differ in another run; worth knowing."""


@dataclass(frozen=True)
class Effect:
    """The magnitude of a finding."""

    value: float
    """The magnitude, at least 0."""
    unit: str
    """The unit, in SI."""


@dataclass(frozen=True)
class Span:
    """The steps of a finding."""

    first: int
    """The first of these steps."""
    last: int
    """The last of these steps."""
    count: int
    """Number of these steps in which the finding holds."""


@dataclass(frozen=True, kw_only=True)
class Finding:
    """A finding: the request, its outcome, the reason, and the change that mends it."""

    code: str
    """A stable name for use in scripts."""
    level: Level
    """Level, the gravest first: `broken` is no physics any more; `asked`: one thing was asked,
    another happened; `model`: true to the engine, perhaps not to you; `repeat`: another run may
    differ; `note`."""
    reason: str | None = None
    """The cause, in a word; null where the code has one cause only."""
    message: str
    """Sentence on what was seen, with numbers, and why."""
    advice: str | None = None
    """The call that changes it."""
    proposed: bool = False
    """Whether the advice is only to be tried: neither the sum of impulses nor a call proves that
    what it changes is the cause. `drop why` tries it."""
    proof: Proof = "sum"
    """Proof: by the `sum` of impulses, by a `call` (or the file that it loads), by a `trial`;
    `none` if its advice is only to be tried."""
    cure: Cure | None = None
    """The advice as an intervention that can be tried; null where no call changes it."""
    body: str | None = None
    """Label of the body that the finding is about: the worst, where there are several."""
    bodies: int = 1
    """Number of bodies for which the finding stands."""
    joint: str | None = None
    """Name of the joint that the finding is about."""
    other: str | None = None
    """Label of the other body, in JSON `with`."""
    effect: Effect | None = None
    """The magnitude of what was found."""
    share: float = 0.0
    """The ratio of the effect to what is normal for it; ranks findings of one level."""
    steps: Span | None = None
    """The steps that it covers."""
    site: str | None = None
    """File and line of the call that caused it; of a notebook, cell and line."""
    episode: int | None = None
    """Number of the episode that these steps are of; None where they are of several, or all are of
    one."""
    episodes: int = 1
    """Number of episodes in which it was found."""

    terms: tuple[RowTerm, ...] = field(default=(), compare=False)
    """The terms of the sum in the row of the account whose place it takes."""
    row: AccountRow | None = field(
        default=None, repr=False, compare=False, metadata={"json": False}
    )
    """The row of the account that tells the same of the same subject."""
    verdict: str | None = None
    """The best result of its trials, where `drop why` was run on this recording."""
    tried: tuple[Mapping[str, Any], ...] = ()
    """The trials of this finding."""

    @property
    def said(self) -> str:
        """The message, which names its subject."""
        if self.body is None or self.joint is not None or self.body in self.message:
            return self.message
        return joined(": ", [self.body, self.message])

    @property
    def told(self) -> str:
        """The message, with the number of further bodies for which it holds."""
        said = self.said
        if self.episodes > 1:
            said = Message("{text}; so in {n} episodes", text=said, n=self.episodes)
        elif self.episode is not None:
            said = Message("{text}; in episode {number}", text=said, number=self.episode)
        if self.bodies < 2:
            return said
        others = counted(self.bodies - 1, "other body", "other bodies")
        return Message("{text}; the same holds for {others}", text=said, others=others)

    @property
    def advised(self) -> str | None:
        """The advice as shown: *to try* unless a trial cured it; None if its trial refuted it.

        For a finding that names a cause itself, a trial shows that the outcome hangs on that cause,
        and not that anyone wants the advice.
        """
        same = self.cure and (self.cure.name, self.cure.value)
        own = [each for each in self.tried if (each["name"], each.get("value")) == same]
        if self.advice is None or {each["verdict"] for each in own} == {"refuted"}:
            return None
        cured = any(each["verdict"] == "cured" and each["left"] is not None for each in own)
        if cured or not self.proposed:
            return self.advice
        return Message("to try: {advice}", advice=self.advice)

    @property
    def rank(self) -> tuple[int, float]:
        """The key by which findings are sorted, the gravest first."""
        return LEVELS.index(self.level), -self.share


@dataclass(kw_only=True)
class Scene:
    """Facts that rules may read besides the pieces of a recording.

    The tables grow piece by piece, and are complete when the rules are asked.
    """

    seen: Seen
    """The events of the recording: bodies, settings, states set by calls; no samples."""
    origin: Mapping[str, Any]
    """The script, and how it ended."""
    times: Mapping[int, StepTimes]
    """Times of steps by client."""
    joints: JointTable
    touches: TouchTable
    episodes: Sequence[Episode] = ()
    actuators: ActuatorTable = field(default_factory=ActuatorTable)
    call_of: Callable[[Cure], str] = lambda cure: cure.call
    """Returns a cure as a user of the engine would write it."""
    asked: AskedOfBodies = field(init=False)
    placing: Placing = field(init=False)
    inputs: Inputs = field(init=False)
    filtered: FilteredPairs = field(init=False)
    apart: set[tuple[Place, Place]] = field(init=False, default_factory=set)
    """Pairs of links without contacts that have been apart."""
    piece: Piece = field(init=False)
    """The latest piece, and what its bodies did in it, by their numbers."""
    batches: Sequence[tuple[StepBatch, StepVerdicts]] = field(init=False)
    """The latest piece, with the steps of equal bodies together."""
    records: Mapping[int, Record] = field(init=False)
    """The record of each body that is not soft, by its number."""
    judged: Mapping[int, SampleStatus] = field(init=False)
    constraints: Constraints = field(init=False)
    ends: dict[int, int] = field(init=False, default_factory=dict)
    """The last sample of each body, by its number."""
    targets: dict[int, Targets] = field(init=False, default_factory=dict)
    """Targets of the position motors of each body, by its number."""
    going: dict[tuple[int, int], TargetColumns] = field(init=False, default_factory=dict)
    """The table of the target in effect, by body and rate."""
    carried: dict[tuple[str, int], NDArray[Any]] = field(init=False, default_factory=dict)
    """Values that columns keep from piece to piece, by name and the number of a body."""
    _explained: ExplainedPiece = field(init=False)
    _ends: dict[int, dict[int, tuple[int, States]]] = field(init=False, default_factory=dict)
    """The last step of each body before the latest piece, and the state after it: by its number
    and which of those that had it is meant."""
    _sites: Mapping[int, Site] = field(init=False, default_factory=dict)

    def __post_init__(self) -> None:
        self.asked, self.placing = AskedOfBodies(self.seen.appearances), Placing(self.seen)
        self.inputs, self.filtered = Inputs(self), FilteredPairs(self.seen)

    def see(self, explained: ExplainedPiece) -> None:
        """Add a piece, before any rule is asked."""
        self.piece, self.judged = explained.piece, explained.bodies
        self._explained, self.batches, self.records = (
            explained,
            explained.batches,
            explained.records,
        )
        self.constraints = explained.constraints
        self.ends |= {number: int(each.steps[-1]) for number, each in self.judged.items()}
        self._sites = self.piece.calls.sites
        self.joints.add(explained)
        self.touches.add(explained)
        self.actuators.add(explained)
        self.asked.see(self.piece)
        self.placing.see(self.piece)
        self.inputs.see()

    def came(self, steps: Steps, parts: Iterable[tuple[int, BodySteps]], column: Column) -> Float64:
        """Return a column of the states after the previous steps of bodies.

        nan where there was none, or where the body was loaded since; shape (n, k). `parts`: the
        steps of each body, and their first row, in order.
        """
        values = np.array(column(steps.after))
        came, before = np.vstack([values[:1], values[:-1]]), np.append(-1, steps.steps[:-1])
        for row, part in parts:
            number, ends = part.body.number, dict(self._ends.get(part.body.number, ()))
            for _, each in self.intervals(number):
                if each is part:
                    break
                ends[each.config.life] = int(each.steps[-1]), each.after.at(np.array([-1]))
            before[row], end = ends.get(part.config.life, (-1, None))
            if end is not None and column(end).shape[1:] == values.shape[1:]:
                came[row] = column(end)[0]
            else:
                came[row] = values[row]
        came[steps.steps - before != 1] = np.nan
        return came

    def forget(self) -> None:
        """Free the latest piece."""
        for _, each in self.intervals():
            end = int(each.steps[-1]), each.whole.after.at(np.array([each.rows.stop - 1]))
            self._ends[each.body.number] = {each.config.life: end}
        del self.piece, self.judged, self.batches, self._explained
        self.joints.forget()
        self.touches.forget()

    def body_of(self, call: Call) -> Body | None:
        """Return the body that a call of the latest piece names, directly or by its constraint."""
        place = next((at for name in BODY_NAMES if (at := call.site.places.get(name))), None)
        if place is None:
            return None
        came = self.piece.calls.body_at(call, int(call.numbers[place.start]))
        return None if came is None else came.body

    def driven(self) -> Iterator[JointTelemetry]:
        """Yield the joints of each body in the steps of the latest piece."""
        for found in self.joints.latest.values():
            yield from found

    def intervals(self, *bodies: int) -> Iterator[tuple[SampleStatus, BodySteps]]:
        """Yield bodies of the latest piece, all or those of some numbers, with their steps."""
        for number in bodies or self.judged:
            for steps in self.judged[number].intervals if number in self.judged else ():
                if len(steps):
                    yield self.judged[number], steps

    def touching(self, bodies: Int64, steps: Int64) -> Flags:
        """Flag the bodies with a contact point in their step of the latest piece."""
        pairs = self.touches.pairs
        return np.isin(bodies * STEPS + steps, pairs.body * STEPS + pairs.step[:, None])

    def steps_at(self, bodies: Int64, steps: Int64) -> Iterator[tuple[Steps, Rows, Rows]]:
        """Yield steps of the latest piece, with their places among some bodies and steps.

        `bodies` and `steps` have the shape (n,).
        """
        for batch, _, its, at in self._explained.steps_at(bodies, steps):
            yield batch.whole, its, at

    def placed(
        self, number: int, link: int, samples: Int64, *, after: bool = True
    ) -> tuple[Float64, Float64]:
        """Return the pose of a link of the latest piece at samples: `ExplainedPiece.placed`."""
        return self._explained.placed(number, link, samples, after=after)

    @cached_property
    def moving(self) -> list[int]:
        """Numbers of the bodies with a movable part."""
        return [number for number, body in self.seen.bodies.items() if body.moving]

    def clients_with(self, setting: str, value: float) -> set[int]:
        """Return the clients in which a setting ever had a value."""
        return {
            each.client
            for each in self.seen.settings
            if setting in each.values and float(np.ravel(each.values[setting])[0]) == value
        }

    def body(self, number: int) -> Body:
        """Return a body by its number."""
        return self.seen.bodies[number]

    def settings(self, client: int) -> Mapping[str, float | Sequence[float]]:
        """Return the settings of a simulation in the latest piece."""
        told = [each for each in self.seen.settings if each.client == client]
        before = [each for each in told if each.at.step < self.piece.end]
        return (before or told)[-1].values

    def only_site(self, act: Act) -> str | None:
        """Return the only place with calls of this meaning; None if there are several."""
        places = {site.place for site in self._sites.values() if site.act is act}
        return places.pop() if len(places) == 1 else None

    def site(self, number: float) -> str | None:
        """Return file and line of a call that commanded joints, by the number of its site."""
        site = self.joints.site(number)
        return None if site is None else site_of(site)


def and_more(number: int) -> str:
    """Return the words after the name of one of several bodies."""
    return Message(" (and {n} more)", n=number - 1) if number > 1 else ""


def so_many(steps: int) -> str:
    """Return a number of steps as text."""
    return Message("{n:,} steps", n=steps) if steps != 1 else Message("one step")
