"""The results of the analysis of a recording; SI units, world axes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Self

from drop_physics.account.episodes import EpisodeRow
from drop_physics.account.rows import AccountRow
from drop_physics.arrays import Vector
from drop_physics.engine_report import EngineReport
from drop_physics.explain.actuators import ActuatorRow
from drop_physics.explain.curves import CurveTable
from drop_physics.explain.decomposition import VectorTerms
from drop_physics.explain.joints import JointRow
from drop_physics.explain.jsonable import jsonable
from drop_physics.explain.rows import SampleRows, table_of
from drop_physics.explain.touches import Touch
from drop_physics.printable import Printable
from drop_physics.rules.answer import Finding

if TYPE_CHECKING:
    import polars as pl

JSON_NAMES = {"other": "with"}
"""Names of fields that JSON has in place of Python's."""
REPORT = "drop_physics.report.analysis"
"""The module that reports an analysis."""
HIDDEN = ("rows", "table", "by_body", "contact_j", "curves", "sources")
"""Fields that JSON leaves out."""


@dataclass(frozen=True)
class FlightSample:
    """A sample of a flight, and its error."""

    step: int
    """Number of the step."""
    time_s: float
    """Simulated time."""
    error_m: Vector
    """Simulated minus free fall."""
    terms_m: VectorTerms | None
    """Terms of the error; None as for the flight."""


@dataclass(frozen=True)
class BodyFlight:
    """Consecutive samples in which a body touches nothing and follows the law of free flight."""

    first_step: int
    """The step that it starts from: its sample, or the state that a call then set."""
    last_step: int
    """The last sample that the law of flight led to."""
    start_s: float
    """Time of the first."""
    end_s: float
    """Time of the last."""
    error_m: Vector
    """Simulated minus free fall at the last sample, from the state at the first on."""
    terms_m: VectorTerms | None
    """Terms of the error; None if a velocity was clamped to the engine's limit, or gravity is not
    along z."""
    at: list[FlightSample]
    """The samples nearest to `--at`."""


@dataclass(frozen=True)
class Pusher:
    """A link that pushed a body in a contact."""

    body: str
    """Label of the body."""
    id: int
    """Number of the body in the recording."""
    link: int
    """-1 is the base."""
    impulse_n_s: Vector
    """Sum over its forces."""
    energy_j: float
    """Energy that it gave to the body; negative where it took some."""


@dataclass(frozen=True)
class BodyContact:
    """Consecutive samples that contact led to."""

    first_step: int
    """The first of them."""
    last_step: int
    """The last of them."""
    start_s: float
    """Time of the first."""
    end_s: float
    """Time of the last."""
    impulse_n_s: Vector
    """Sum over all contact forces on the body."""
    largest_force_n: float
    """The largest in a step, of all points together."""
    energy_j: float
    """Energy that contact gave to the body; negative where it took some."""
    most_given_j: float
    """The most that it gave in a step; 0 where it only took."""
    most_given_step: int | None
    """The step in which it gave most."""
    by: list[Pusher]
    """The links that pushed it."""


@dataclass(frozen=True)
class Unexplained:
    """Samples to which the law does not lead, for one reason."""

    reason: str
    """Reason: a feature that the law does not cover, or `remainder`."""
    samples: int
    """Number of these samples."""
    first_step: int
    """The first of them."""
    remainder: float | None
    """The largest over the largest term of its step; None where the law has no sum."""


@dataclass(frozen=True)
class Energy:
    """Kinetic and potential energy of a body; heights count from the origin."""

    start_j: float
    """Energy at its first sample [J]."""
    end_j: float
    """Energy at its last sample [J]."""
    by_cause_j: dict[str, float]
    """Changes by cause; they add up to the whole change."""


@dataclass(frozen=True)
class Momentum:
    """Linear momentum of a body whose base can move."""

    start_kg_m_s: Vector
    """Momentum at its first sample [kg m/s]."""
    end_kg_m_s: Vector
    """Momentum at its last sample [kg m/s]."""
    by_cause_kg_m_s: dict[str, Vector]
    """Changes by cause; they add up to the whole change."""


@dataclass(frozen=True)
class StepSum:
    """One step of a body, as the sum of its named impulses."""

    step: int
    """The sample that it led to."""
    time_s: float
    """Simulated time of that sample."""
    segment: str
    """Kind of the sample."""
    terms: dict[str, list[float]] | None
    """Impulse of each term per degree of freedom [N s, N m s]; None where the law has no sum."""
    remainder: list[float] | None
    """Remainder that the terms do not explain."""
    contact_by: list[Pusher] = field(default_factory=list)
    """The links that pushed it in this step: of its contact, what each gave."""


@dataclass(frozen=True)
class BodyAnalysis:
    """Motion of one body, with its terms."""

    name: str
    """The file that it was loaded from, or its name."""
    label: str
    """Number and name, as in findings and in the recording's entities."""
    id: int
    """Number in the recording: the engine's own id, unless another body had it before."""
    soft: bool
    """Whether it is a soft body, whose motion is not recorded: it has no samples."""
    links: list[str]
    """Base and links."""
    mass_kg: float
    """Their total mass at the end; of a btRigidBody, the base's alone."""
    segments: dict[str, int]
    """Number of samples by kind: set, unexplained, still, pushed, constrained, contact, driven,
    flight."""
    flights: list[BodyFlight]
    """Flights of a body without links, with their errors."""
    contacts: list[BodyContact]
    """Contacts of the body."""
    unexplained: list[Unexplained]
    """Unexplained samples, by reason."""
    energy: Energy | None
    """None for a body without samples, and where the law has no sum."""
    momentum: Momentum | None
    """None for a body without samples, without a sum, or whose base cannot move."""
    joints: Sequence[JointRow]
    """Degrees of freedom of the joints."""
    actuators: Sequence[ActuatorRow]
    """Actuators with a law of their own, if the engine has any."""
    touches: Sequence[Touch]
    """The bodies that it touched."""
    at: list[StepSum]
    """The steps nearest to `--at`."""


@dataclass(frozen=True)
class Explained:
    """Share of a recording, or of a body, that is explained."""

    samples: int
    """Explained ones."""
    of: int
    """All of them."""
    remainder: float
    """The largest of an explained sample, over the largest term of its step."""
    until_s: float | None
    """Time of the first sample that is not explained, None if all are; of a drop, of the last one
    before that."""
    why: str | None
    """Reason why that one is not."""


@dataclass(frozen=True, kw_only=True)
class Analysis(Printable, reported_by=REPORT):
    """All results of the analysis of a recording."""

    origin: dict[str, Any] | None
    """The script, its arguments, and how it ended; None of a drop."""
    engine: dict[str, Any] | EngineReport
    """The last timestep, gravity … of the engine, by client; of a drop what the engine reported."""
    samples: int
    """Steps of the longest simulation, and one."""
    explained: Explained
    """Explained share of all bodies, or of that of `--body`."""
    bodies: list[BodyAnalysis]
    """All bodies that ever existed, or that of `--body`."""
    findings: list[Finding]
    """Findings: what was asked and what happened instead, and why; the gravest first."""
    account: Sequence[AccountRow] = ()
    """Rows on what was asked, given, moved and held, with the terms of the sum; the most salient
    first."""
    episodes: Sequence[EpisodeRow] = ()
    """The episodes of all simulations, in the order in which they ended."""
    episode: int | None = None
    """Number of the episode whose last two seconds the account and the joints are of; None if they
    are of the whole run."""
    left_out: int = 0
    """Number of further findings left out by the command, the script or the project."""
    by_body: dict[int, Explained]
    """Explained share of the bodies, by number."""
    rows: Sequence[SampleRows]
    """The samples of each body; of long recordings what is shown, unless all were asked for."""
    curves: CurveTable | None = None
    """Curves of joints, friction and energy for plots and the viewer; None where there is no sum.
    """
    kind: Literal["drop", "script"] = "script"
    """Whose recording it is; the analysis of a drop has more (`DropAnalysis`)."""
    recording: Path | None = None
    """The recording that was analyzed."""
    sources: dict[str, Path] = field(default_factory=dict)
    """The files that findings cite, by the name that they cite, where their text is the recorded
    one."""
    layer: Path | None = None
    """The layer that shows the analysis."""
    partial: bool = False
    """Whether the recording was never finished, so that only its beginning was analyzed."""
    notes: list[str] = field(default_factory=list)
    """Sentences on missing parts of the recording: steps of other processes, for example."""
    lacks: str | None = None
    """Contents that the recording lacks because of an earlier schema; None if it lacks none."""

    @cached_property
    def table(self) -> pl.DataFrame:
        """A row per sample and body, those of `rows`."""
        return table_of(self.rows)

    def as_json(self) -> dict[str, Any]:
        """Return the documented JSON object; missing values are null."""
        values = {name: value for name, value in vars(self).items() if name not in HIDDEN}
        return dict(renamed(jsonable(values)))

    def of_body(self, number: int) -> Self:
        """Return the analysis of one body, with its findings."""
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
    """Return a JSON value with its documented names."""
    if isinstance(value, dict):
        return {JSON_NAMES.get(name, name): renamed(item) for name, item in value.items()}
    return [*map(renamed, value)] if isinstance(value, list) else value
