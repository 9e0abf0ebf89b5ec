"""Findings, and the scene: all data about a recording that rules may read."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from drop_physics.account.rows import AccountRow, RowTerm
from drop_physics.account.touches import TouchTable
from drop_physics.arrays import Flags, Float64, Int64
from drop_physics.explain.actuators import ActuatorTable
from drop_physics.explain.bodies import Record
from drop_physics.explain.contact_points import Pairs, pairs_of
from drop_physics.explain.joined import Constraints
from drop_physics.explain.joints import DrivenJoints, JointTelemetry
from drop_physics.explain.recording import ExplainedPiece
from drop_physics.explain.step_status import SampleStatus, StepVerdicts
from drop_physics.explain.steps import BodySteps, StepBatch, Steps
from drop_physics.explain.targets import Targets
from drop_physics.explain.times import StepTimes
from drop_physics.explain.touching import STEPS
from drop_physics.fields import counted
from drop_physics.messages import Message, joined
from drop_physics.physics.tree import States
from drop_physics.rules.arguments import site_of
from drop_physics.rules.body_properties import AskedOfBodies
from drop_physics.rules.inputs import Inputs
from drop_physics.rules.kept import KeptRows
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
"""How a finding is proved: by the sum of impulses; by a call or a file that requests one thing
while the engine does another; or by a trial. Advice without a proof is only a proposal."""
Level = Literal["broken", "asked", "model", "repeat", "note"]
LEVELS: tuple[Level, ...] = get_args(Level)
"""The levels, the gravest first: no longer physical; not what the script requested; correct for the
engine, but perhaps not intended; may differ in another run; worth knowing."""


@dataclass(frozen=True)
class Effect:
    """How much a finding explains: a share, distance, or other quantity."""

    value: float
    """The magnitude, at least 0."""
    unit: str
    """The unit, in SI."""


@dataclass(frozen=True)
class Span:
    """The range of steps to which a finding applies."""

    first: int
    """The first step of the range."""
    last: int
    """The last step of the range."""
    count: int
    """Number of these steps in which the finding holds."""


@dataclass(frozen=True, kw_only=True)
class Finding:
    """A finding: the request, the result, the reason, and the suggested change."""

    code: str
    """A stable identifier for use in scripts."""
    level: Level
    """Level, the gravest first: `broken` is no longer physical; `asked`: the outcome differs from
    the request; `model`: correct for the engine, perhaps not intended; `repeat`: another run may
    differ; `note`."""
    reason: str | None = None
    """The cause, as one word; null where the code has only one cause."""
    message: str
    """A sentence that says what was observed, with numbers, and why."""
    advice: str | None = None
    """The call that fixes the problem."""
    proposed: bool = False
    """Whether the advice is only a proposal: neither the sum of impulses nor a call proves that it
    addresses the cause. `drop why` tries it."""
    proof: Proof = "sum"
    """How the finding is proved: by the `sum` of impulses, by a `call` (or the file that it loads),
    by a `trial`; `none` if its advice is only a proposal."""
    cure: Cure | None = None
    """The advice as an intervention that `drop why` can try; null where no call makes the
    change."""
    body: str | None = None
    """Label of the body that the finding is about; with several, the worst one."""
    bodies: int = 1
    """Number of bodies to which the finding applies."""
    joint: str | None = None
    """Name of the joint that the finding is about."""
    other: str | None = None
    """Label of the other body; in JSON, `with`."""
    effect: Effect | None = None
    """The magnitude of the problem."""
    share: float = 0.0
    """Ratio of the effect to its normal size; ranks findings of the same level."""
    steps: Span | None = None
    """The steps to which the finding applies."""
    site: str | None = None
    """File and line of the call that caused it; in a notebook, cell and line."""
    episode: int | None = None
    """Number of the episode that contains these steps; None if they span several, or the run has
    only one."""
    episodes: int = 1
    """Number of episodes in which the problem was found."""

    terms: tuple[RowTerm, ...] = field(default=(), compare=False)
    """The terms of the sum, taken from the account row that the finding replaces."""
    row: AccountRow | None = field(
        default=None, repr=False, compare=False, metadata={"json": False}
    )
    """The account row that reports the same fact about the same subject."""
    kind: Hashable = field(default=None, repr=False, compare=False, metadata={"json": False})
    """The sentence that reports it: its rule, and the first row that has the sentence."""
    verdict: str | None = None
    """The best result among its trials, if `drop why` was run on this recording."""
    tried: tuple[Mapping[str, Any], ...] = ()
    """The trials of this finding."""

    @property
    def said(self) -> str:
        """The finding's message, with the subject's name."""
        if self.body is None or self.joint is not None or self.body in self.message:
            return self.message
        return joined(": ", [self.body, self.message])

    @property
    def told(self) -> str:
        """The finding's message, with the number of further bodies that it also applies to."""
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
        """The advice as shown: marked *to try* until a trial confirms it; None if one refuted it.

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
        """The sort key of findings: the most severe first."""
        return LEVELS.index(self.level), -self.share


@dataclass(kw_only=True)
class Scene:
    """Everything that rules may read besides their tables; filled chunk by chunk.

    The tables grow chunk by chunk, and are complete when the rules are asked.
    """

    seen: Seen
    """The events of the recording: bodies, settings, states set by calls; no samples."""
    origin: Mapping[str, Any]
    """The script, and how its run ended."""
    times: Mapping[int, StepTimes]
    """Times of the steps, by client."""
    joints: DrivenJoints
    touches: TouchTable
    episodes: Sequence[Episode] = ()
    actuators: ActuatorTable = field(default_factory=ActuatorTable)
    call_of: Callable[[Cure], str] = lambda cure: cure.call
    """Returns the source text of a cure, as a user of the engine would write it."""
    asked: AskedOfBodies = field(init=False)
    placing: Placing = field(init=False)
    inputs: Inputs = field(init=False)
    piece: Piece = field(init=False)
    """The latest chunk, and the motion of its bodies, by body id."""
    batches: Sequence[tuple[StepBatch, StepVerdicts]] = field(init=False)
    """The latest chunk, with the steps of equal bodies batched."""
    records: Mapping[int, Record] = field(init=False)
    """The record of each rigid body, by body id."""
    judged: Mapping[int, SampleStatus] = field(init=False)
    pairs: Pairs = field(init=False)
    """The contact points of the latest chunk."""
    constraints: Constraints = field(init=False)
    ends: dict[int, int] = field(init=False, default_factory=dict)
    """The last sample of each body, by body id."""
    targets: dict[int, Targets] = field(init=False, default_factory=dict)
    """Targets of the position motors of each body, by body id."""
    going: dict[tuple[int, int], TargetColumns] = field(init=False, default_factory=dict)
    """The table of the target in effect, by body and rate."""
    kept: KeptRows = field(init=False, default_factory=KeptRows)
    _explained: ExplainedPiece = field(init=False)
    _ends: dict[int, dict[int, tuple[int, States]]] = field(init=False, default_factory=dict)
    """The last step of each body before the latest chunk, and the state after it: by body id, then
    by the index of the body's life, since ids are reused."""
    _sites: Mapping[int, Site] = field(init=False, default_factory=dict)

    def __post_init__(self) -> None:
        self.asked, self.placing = AskedOfBodies(self.seen.appearances), Placing(self.seen)
        self.inputs = Inputs(self)

    def see(self, explained: ExplainedPiece) -> None:
        """Add a chunk of explained steps, before any rule is applied to it."""
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
        self.pairs = pairs_of(explained)
        self.touches.add(explained, self.pairs)
        self.actuators.add(explained)
        self.asked.see(self.piece)
        self.placing.see(self.piece)
        self.inputs.see()

    def came(self, steps: Steps, parts: Iterable[tuple[int, BodySteps]], column: Column) -> Float64:
        """Return a quantity of the bodies' states one step earlier, shape (n, k); nan if unknown.

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
        """Free the memory of the latest chunk."""
        for _, each in self.intervals():
            end = int(each.steps[-1]), each.whole.after.at(np.array([each.rows.stop - 1]))
            self._ends[each.body.number] = {each.config.life: end}
        del self.piece, self.judged, self.batches, self.pairs, self._explained
        self.joints.forget()

    def body_of(self, call: Call) -> Body | None:
        """Return the body that a call in the latest chunk is about."""
        place = next((at for name in BODY_NAMES if (at := call.site.places.get(name))), None)
        if place is None:
            return None
        came = self.piece.calls.body_at(call, int(call.numbers[place.start]))
        return None if came is None else came.body

    def driven(self) -> Iterator[JointTelemetry]:
        """Yield the joints of each body, with their commands, in the latest chunk."""
        for found in self.joints.latest.values():
            yield from found

    def intervals(self, *bodies: int) -> Iterator[tuple[SampleStatus, BodySteps]]:
        """Yield the steps of bodies in the latest chunk: of all, or those with the given ids."""
        for number in bodies or self.judged:
            for steps in self.judged[number].intervals if number in self.judged else ():
                if len(steps):
                    yield self.judged[number], steps

    def touching(self, bodies: Int64, steps: Int64) -> Flags:
        """Flag the bodies that have a contact point in the given step of the latest chunk."""
        pairs = self.pairs
        return np.isin(bodies * STEPS + steps, pairs.body * STEPS + pairs.step[:, None])

    def steps_at(self, bodies: Int64, steps: Int64) -> Iterator[tuple[Steps, Rows, Rows]]:
        """Yield the batches of the latest chunk that contain the given steps of bodies.

        `bodies` and `steps` have the shape (n,).
        """
        for batch, _, its, at in self._explained.steps_at(bodies, steps):
            yield batch.whole, its, at

    def placed(
        self, number: int, link: int, samples: Int64, *, after: bool = True
    ) -> tuple[Float64, Float64]:
        """Return a link's position and axes at samples of the latest chunk."""
        return self._explained.placed(number, link, samples, after=after)

    @cached_property
    def moving(self) -> list[int]:
        """Ids of the bodies that can move."""
        return [number for number, body in self.seen.bodies.items() if body.moving]

    def clients_with(self, setting: str, value: float) -> set[int]:
        """Return the simulations in which an engine setting ever had the given value."""
        return {
            each.client
            for each in self.seen.settings
            if setting in each.values and float(np.ravel(each.values[setting])[0]) == value
        }

    def body(self, number: int) -> Body:
        """Return a body by id."""
        return self.seen.bodies[number]

    def settings(self, client: int) -> Mapping[str, float | Sequence[float]]:
        """Return the settings of a simulation in the latest chunk."""
        told = [each for each in self.seen.settings if each.client == client]
        before = [each for each in told if each.at.step < self.piece.end]
        return (before or told)[-1].values

    def only_site(self, act: Act) -> str | None:
        """Return the script line of all calls of one kind; None if there are several lines."""
        places = {site.place for site in self._sites.values() if site.act is act}
        return places.pop() if len(places) == 1 else None

    def site(self, number: float) -> str | None:
        """Return file and line of a joint command, by the id of its call site."""
        site = self.joints.site(number)
        return None if site is None else site_of(site)


def and_more(number: int) -> str:
    """Return the text after a body's name that says how many similar bodies there are."""
    return Message(" (and {n} more)", n=number - 1) if number > 1 else ""


def so_many(steps: int) -> str:
    """Format a number of steps, with the noun."""
    return Message("{n:,} steps", n=steps) if steps != 1 else Message("one step")
