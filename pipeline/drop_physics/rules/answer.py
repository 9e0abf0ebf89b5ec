"""Findings, and the scene: all data about a recording that rules may read."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any, Literal

from drop_physics.account.rows import AccountRow, RowTerm
from drop_physics.account.touches import TouchTable
from drop_physics.explain.actuators import ActuatorTable
from drop_physics.explain.bodies import Record
from drop_physics.explain.joined import Constraints
from drop_physics.explain.joints import DrivenJoints
from drop_physics.explain.recording import ExplainedPiece
from drop_physics.explain.times import StepTimes
from drop_physics.fields import counted
from drop_physics.messages import Message, joined
from drop_physics.rules.body_properties import AskedOfBodies
from drop_physics.rules.by_name import parameters
from drop_physics.rules.chunk import LastStates, StepChunk
from drop_physics.rules.codes import LEVELS, Level
from drop_physics.rules.inputs import Inputs
from drop_physics.rules.placing import Placing
from drop_physics.rules.target_columns import StandingTargets
from drop_physics.trace.acts import Act
from drop_physics.trace.cures import Cure as Cure  # part of a finding
from drop_physics.trace.episodes import Episode
from drop_physics.trace.events import Site
from drop_physics.trace.history import Seen

Proof = Literal["sum", "call", "trial", "none"]
"""How a finding is proved: by the sum of impulses; by a call or a file that requests one thing
while the engine does another; or by a trial. Advice without a proof is only a proposal."""


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
    """A stable identifier of the problem, for use in scripts."""
    level: Level
    """Level, the gravest first: `broken` is no longer physical; `asked`: the outcome differs from
    the request; `model`: correct for the engine, perhaps not intended; `repeat`: another run may
    differ; `note`."""
    reason: str | None = None
    """The cause, as one word; null where the code has only one cause."""
    message: str
    """A sentence on the observation, with numbers, and its reason."""
    advice: str | None = None
    """The call that fixes the problem."""
    proposed: bool = False
    """Whether the advice is only a proposal: neither the sum of impulses nor a call proves that it
    addresses the cause. `drop why` tries it."""
    proof: Proof = "sum"
    """How the finding is proved: by the `sum` of impulses, by a `call` (or the file that it loads),
    by a `trial`; `none` if the advice is only a proposal."""
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
    """The magnitude of the problem, with its SI unit."""
    share: float = 0.0
    """Ratio of the effect to its normal size; ranks findings of the same level."""
    steps: Span | None = None
    """The steps to which the finding applies."""
    site: str | None = None
    """File and line of the call that caused the problem; in a notebook, cell and line."""
    episode: int | None = None
    """Number of the episode that contains `steps`; None if the steps span several episodes, or the
    run has only one."""
    episodes: int = 1
    """Number of episodes in which the problem was found."""

    terms: tuple[RowTerm, ...] = field(default=(), compare=False)
    """The terms of the sum, taken from the account row that the finding replaces."""
    row: AccountRow | None = field(
        default=None, repr=False, compare=False, metadata={"json": False}
    )
    """The account row that reports the same fact about the same subject."""
    kind: Hashable = field(default=None, repr=False, compare=False, metadata={"json": False})
    """A key that is equal for findings with the same sentence: the rule, and the rule's first row
    with that sentence."""
    verdict: str | None = None
    """The best verdict among the finding's trials, if `drop why` was run on this recording."""
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

        If the finding's code is itself a cause, a trial shows that the outcome depends on that
        cause, but not that the user wants the advice.
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
    """The tables that rules read; a rule's parameters name the tables that it needs (`read_by`).

    The tables are filled chunk by chunk; while rules examine a chunk, that chunk is included.
    """

    seen: Seen
    """The events of the recording: bodies, settings, states set by calls; no samples."""
    origin: Mapping[str, Any]
    """The script, and how its run ended."""
    times: Mapping[int, StepTimes]
    """Times of the steps, by client."""
    telemetry: DrivenJoints
    touches: TouchTable
    episodes: Sequence[Episode] = ()
    actuators: ActuatorTable = field(default_factory=ActuatorTable)
    call_of: Callable[[Cure], str] = lambda cure: cure.call
    """Returns the call or statement that a user of the engine would write to apply a cure."""
    asked: AskedOfBodies = field(init=False)
    placing: Placing = field(init=False)
    inputs: Inputs = field(init=False)
    chunk: StepChunk = field(init=False)
    """The latest chunk, until `forget` is called."""
    records: Mapping[int, Record] = field(init=False, default_factory=dict)
    """The record of each rigid body, by body id."""
    constraints: Constraints = field(init=False)
    last_samples: Mapping[int, int] = field(init=False, default_factory=dict)
    """The last sample of each body, by body id."""
    standing: StandingTargets = field(init=False)
    _last_states: LastStates = field(init=False, default_factory=dict)
    _sites: Mapping[int, Site] = field(init=False, default_factory=dict)

    def __post_init__(self) -> None:
        self.asked, self.placing = AskedOfBodies(self.seen.appearances), Placing(self.seen)
        self.inputs, self.standing = Inputs(self.seen), StandingTargets()

    def see(self, explained: ExplainedPiece) -> None:
        """Add a chunk of explained steps, before any rule is applied to it."""
        self.telemetry.add(explained)
        driven = [each for found in self.telemetry.latest.values() for each in found]
        self.chunk = chunk = StepChunk(explained, self.seen, driven, self._last_states)
        self.records, self.constraints = explained.records, explained.constraints
        ends = {number: int(each.steps[-1]) for number, each in chunk.judged.items()}
        self.last_samples = {**self.last_samples, **ends}
        self._sites = chunk.piece.calls.sites
        self.touches.add(explained, chunk.pairs)
        self.actuators.add(explained)
        self.asked.see(chunk.piece)
        self.placing.see(chunk.piece)
        self.inputs.see(chunk)

    def forget(self) -> None:
        """Free the memory of the latest chunk."""
        self._last_states = self.chunk.last_states()
        del self.chunk
        self.telemetry.forget()

    def read_by(self, function: Callable[..., object], first: int = 0) -> dict[str, Any]:
        """Return the tables that a function's parameters name, from the `first` parameter on."""
        names = parameters(function)[first:]
        return {name: getattr(self, name) for name in names if name in SCENE_TABLES}

    def only_site(self, act: Act) -> str | None:
        """Return the script line of all calls of one kind; None if there are several lines."""
        places = {site.place for site in self._sites.values() if site.act is act}
        return places.pop() if len(places) == 1 else None


SCENE_TABLES = {each.name for each in fields(Scene) if not each.name.startswith("_")}
"""The names of the tables of a scene."""


def and_more(number: int) -> str:
    """Return the suffix to a body's name that counts similar bodies, such as ` and 3 more`."""
    return Message(" (and {n} more)", n=number - 1) if number > 1 else ""


def so_many(steps: int) -> str:
    """Format a number of steps, with the noun."""
    return Message("{n:,} steps", n=steps) if steps != 1 else Message("one step")
