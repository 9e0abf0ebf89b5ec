"""The results of the analysis of a recording; SI units, world axes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Self

from drop_physics.account.episodes import EpisodeRow
from drop_physics.account.joints import JointRow
from drop_physics.account.rows import AccountRow
from drop_physics.account.touches import Touch
from drop_physics.arrays import Vector
from drop_physics.engine_report import EngineReport
from drop_physics.explain.actuators import ActuatorRow
from drop_physics.explain.curves import CurveTable
from drop_physics.explain.decomposition import VectorTerms
from drop_physics.explain.jsonable import jsonable
from drop_physics.explain.rows import SampleRows, table_of
from drop_physics.printable import Printable
from drop_physics.rules.answer import Finding

if TYPE_CHECKING:
    import polars as pl

JSON_NAMES = {"other": "with"}
"""JSON names of the fields that have another name in Python."""
REPORT = "drop_physics.report.analysis"
"""Name of the module that reports an analysis."""
HIDDEN = ("rows", "table", "by_body", "contact_j", "curves", "sources", "stepped")
"""Names of fields that are not written to JSON."""


@dataclass(frozen=True)
class FlightSample:
    """A sample of a flight, with its error."""

    step: int
    """Number of the step."""
    time_s: float
    """Simulated time."""
    error_m: Vector
    """Simulated minus free-fall position."""
    terms_m: VectorTerms | None
    """Terms of the error; None if a velocity was clamped to the engine's limit, or gravity is not
    along z."""


@dataclass(frozen=True)
class BodyFlight:
    """Consecutive samples in which a body touches nothing and follows the law of free flight."""

    first_step: int
    """The step at which the flight starts, from a sample or from a state that a call set after it.
    """
    last_step: int
    """The last sample predicted by the law of flight."""
    start_s: float
    """Time of the first step."""
    end_s: float
    """Time of the last step."""
    error_m: Vector
    """Simulated minus free-fall position at the last sample [m]; free fall starts from the state at
    the first."""
    terms_m: VectorTerms | None
    """Terms of the error; None if a velocity was clamped to the engine's limit, or gravity is not
    along z."""
    at: list[FlightSample]
    """The samples nearest to the times requested by `--at`."""


@dataclass(frozen=True)
class Pusher:
    """A link that pushed a body in a contact."""

    body: str
    """Label of the body."""
    id: int
    """Id of the body in the recording."""
    link: int
    """Index of the link; -1 is the base."""
    impulse_n_s: Vector
    """Sum of the link's contact impulses."""
    energy_j: float
    """Energy that the link gave to the body; negative if it took energy."""


@dataclass(frozen=True)
class BodyContact:
    """Consecutive samples after steps in contact."""

    first_step: int
    """Index of the first sample."""
    last_step: int
    """Index of the last sample."""
    start_s: float
    """Time of the first sample."""
    end_s: float
    """Time of the last sample."""
    impulse_n_s: Vector
    """Total impulse of all contact forces on the body."""
    largest_force_n: float
    """The largest contact force in a step, summed over all points."""
    energy_j: float
    """Energy that contact gave to the body; negative if it took energy."""
    most_given_j: float
    """The largest energy that contact gave in one step; 0 if it only took energy."""
    most_given_step: int | None
    """The step in which contact gave most energy."""
    by: list[Pusher]
    """The links that pushed the body."""


@dataclass(frozen=True)
class Unexplained:
    """Samples that the law does not explain, for a given reason."""

    reason: str
    """Reason: a feature that the law does not support, or `remainder`."""
    samples: int
    """Number of unexplained samples."""
    first_step: int
    """Index of the first unexplained sample."""
    remainder: float | None
    """The largest ratio of the remainder to the largest term of its step; None if the law has no
    sum."""


@dataclass(frozen=True)
class Energy:
    """Kinetic and potential energy of a body; heights are measured from the origin."""

    start_j: float
    """Energy at the first sample [J]."""
    end_j: float
    """Energy at the last sample [J]."""
    by_cause_j: dict[str, float]
    """Changes by cause; their sum is the total change."""


@dataclass(frozen=True)
class Momentum:
    """Linear momentum of a body whose base can move."""

    start_kg_m_s: Vector
    """Momentum at the first sample [kg m/s]."""
    end_kg_m_s: Vector
    """Momentum at the last sample [kg m/s]."""
    by_cause_kg_m_s: dict[str, Vector]
    """Changes by cause; their sum is the total change."""


@dataclass(frozen=True)
class StepSum:
    """One step of a body, as the sum of its named impulses."""

    step: int
    """The sample after the step."""
    time_s: float
    """Simulated time of the sample after the step."""
    segment: str
    """Segment of the sample."""
    terms: dict[str, list[float]] | None
    """Impulse of each term per degree of freedom [N s, N m s]; None if the law has no sum."""
    remainder: list[float] | None
    """The part of the momentum change that the terms do not explain."""
    contact_by: list[Pusher] = field(default_factory=list)
    """The links that pushed the body in this step, with the contact impulse of each."""


@dataclass(frozen=True)
class BodyAnalysis:
    """Motion of one body, with the terms that explain it."""

    name: str
    """Name of the file from which the body was loaded, or the body's own name."""
    label: str
    """Id and name, as in findings and in the recording's entities."""
    id: int
    """Id in the recording: the engine's own id, unless another body had that id before."""
    soft: bool
    """Whether the body is a soft body, whose motion is not recorded, so that it has no samples."""
    links: list[str]
    """Names of the base and the links."""
    mass_kg: float
    """Total mass at the end; for a btRigidBody, the mass of the base alone."""
    segments: dict[str, int]
    """Number of samples by segment: set, unexplained, still, pushed, constrained, contact, driven,
    flight."""
    flights: list[BodyFlight]
    """Flights of a single-link body, with their errors."""
    contacts: list[BodyContact]
    """Contact phases of the body."""
    unexplained: list[Unexplained]
    """Unexplained samples, by reason."""
    energy: Energy | None
    """Energy balance; None for a body without samples, and if the law has no sum."""
    momentum: Momentum | None
    """Momentum balance; None for a body without samples, without a sum, or with a fixed base."""
    joints: Sequence[JointRow]
    """Joint states, one entry per degree of freedom."""
    actuators: Sequence[ActuatorRow]
    """Actuators with a control law of their own, if the engine has any."""
    touches: Sequence[Touch]
    """The bodies that this body touched."""
    at: list[StepSum]
    """The steps nearest to the times requested by `--at`."""


@dataclass(frozen=True)
class Explained:
    """The explained share of a recording, or of a body."""

    samples: int
    """Number of explained samples."""
    of: int
    """Total number of samples."""
    remainder: float
    """The largest ratio of the remainder to the largest term of its step, over explained
    samples."""
    until_s: float | None
    """Time of the first unexplained sample, None if all are explained; for a drop, of the last
    sample before it."""
    why: str | None
    """Reason why the first unexplained sample is not explained."""


@dataclass(frozen=True, kw_only=True)
class Analysis(Printable, reported_by=REPORT):
    """All results of the analysis of a recording."""

    origin: dict[str, Any] | None
    """The script, its arguments, and how it ended; None for a drop."""
    engine: dict[str, Any] | EngineReport
    """The engine's last timestep, gravity, etc., by client; for a drop, what the engine
    reported."""
    samples: int
    """Number of samples of the longest simulation: its steps plus one."""
    explained: Explained
    """Explained share of all bodies, or of the body selected by `--body`."""
    bodies: list[BodyAnalysis]
    """All bodies that ever existed, or the one selected by `--body`."""
    findings: list[Finding]
    """Findings: what was requested, what happened instead, and why; the gravest first."""
    account: Sequence[AccountRow] = ()
    """Account rows on what was requested, applied, moved and held, with the terms of the sum; the
    most salient first."""
    episodes: Sequence[EpisodeRow] = ()
    """The episodes of all simulations, in the order in which they ended."""
    episode: int | None = None
    """Number of the episode whose last two seconds the account, the joints and the touching bodies
    cover; None if they cover the whole run."""
    left_out: int = 0
    """Number of further findings that the command, the script or the project suppressed."""
    by_body: dict[int, Explained]
    """Explained share of each body, by body id."""
    rows: Sequence[SampleRows]
    """The samples of each body; for long recordings only those shown, unless all were requested."""
    stepped: Sequence[int] = ()
    """Number of steps of each simulation that was stepped."""
    curves: CurveTable | None = None
    """Curves of joints, friction and energy for plots and the viewer; None if there is no sum."""
    kind: Literal["drop", "script"] = "script"
    """Type of the recording; the analysis of a drop has more fields (`DropAnalysis`)."""
    recording: Path | None = None
    """The recording that was analyzed."""
    sources: dict[str, Path] = field(default_factory=dict)
    """The files that findings cite, by cited name, if their text is the recorded one."""
    layer: Path | None = None
    """The layer file that shows the analysis."""
    partial: bool = False
    """Whether the recording was never finished, so that only its first part was analyzed."""
    notes: list[str] = field(default_factory=list)
    """Notes on missing parts of the recording: steps of other processes, for example."""
    lacks: str | None = None
    """Contents that the recording lacks because of an older schema; None for the current schema."""

    @cached_property
    def table(self) -> pl.DataFrame:
        """The rows as a table: one row per sample and body."""
        return table_of(self.rows)

    def as_json(self) -> dict[str, Any]:
        """Return the analysis as the documented JSON object; missing values are null."""
        values = {name: value for name, value in vars(self).items() if name not in HIDDEN}
        return dict(renamed(jsonable(values)))

    def of_body(self, number: int) -> Self:
        """Return the analysis restricted to one body, with its findings."""
        (body,) = (body for body in self.bodies if body.id == number)
        findings = [finding for finding in self.findings if finding.body in (None, body.label)]
        account = [row for row in self.account if row.body == body.label]
        return replace(
            self,
            bodies=[body],
            findings=findings,
            account=account,
            explained=self.by_body[number],
        )


def renamed(value: Any) -> Any:  # noqa: ANN401
    """Convert a value to JSON, with the documented field names."""
    if isinstance(value, dict):
        return {JSON_NAMES.get(name, name): renamed(item) for name, item in value.items()}
    return [*map(renamed, value)] if isinstance(value, list) else value
