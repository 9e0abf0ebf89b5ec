"""The results of the analysis of a script's recording; SI units, world axes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import polars as pl

from drop_physics.analysis.general.flights import VectorTerms
from drop_physics.analysis.general.jsonable import jsonable
from drop_physics.shown import Shown

Vector = tuple[float, float, float]

NOT_IN_JSON = ("table", "by_body")
"""Of a script's analysis."""


@dataclass(frozen=True)
class Moment:
    """A sample of a flight, and its error."""

    step: int
    """Its number."""
    time_s: float
    """Simulated time."""
    error_m: Vector
    """Simulated minus free fall."""
    terms_m: VectorTerms | None
    """Its terms; None as for the flight."""


@dataclass(frozen=True)
class ScriptFlight:
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
    """Its terms; None if a velocity was clamped to the engine's limit, or gravity is not along
    z."""
    at: list[Moment]
    """The samples nearest to `--at`."""


@dataclass(frozen=True)
class Pusher:
    """A link that pushed a body in a contact."""

    body: str
    """Its label."""
    id: int
    """Its number in the recording."""
    link: int
    """-1 is the base."""
    impulse_n_s: Vector
    """Sum over its forces."""
    energy_j: float
    """Kinetic energy that it gave to the body; negative where it took some."""


@dataclass(frozen=True)
class ScriptContact:
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
    """Kinetic energy that contact gave to the body; negative where it took some."""
    most_given_j: float
    """The most that it gave in a step; 0 where it only took."""
    most_given_step: int | None
    """The step in which it gave most."""
    by: list[Pusher]
    """The links that pushed it."""


@dataclass(frozen=True)
class Unexplained:
    """Samples that neither the law nor contact leads to, for one reason."""

    reason: str
    """The reason, as far as it is known."""
    samples: int
    """Number of these samples."""
    first_step: int
    """The first of them."""
    deviation: float
    """How far the first of them deviates, in its worst number [m, m/s, rad/s, 1]."""


@dataclass(frozen=True)
class BodyEnergy:
    """Kinetic and potential energy of all links that time can move; the latter is 0 at z = 0."""

    first_j: float
    """At the first sample at which it is known."""
    last_j: float
    """At the last sample at which it is known."""
    largest_j: float
    """The most that it had, at the samples at which it is known."""
    largest_step: int
    """The sample at which it had most."""
    contact_j: float | None
    """Kinetic energy that all contacts gave, negative if they took some; None for a body with
    joints."""


@dataclass(frozen=True)
class BodyAnalysis:
    """What one body did."""

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
    """Number of samples by kind: flight, contact, pushed, set, jointed, still, unexplained."""
    flights: list[ScriptFlight]
    """Its flights, with their errors."""
    contacts: list[ScriptContact]
    """Its contacts."""
    unexplained: list[Unexplained]
    """Its samples that are not explained, by reason."""
    energy: BodyEnergy | None
    """None for a body without samples or mass, with a mass that changes, and with links that are
    not reported or move in substeps."""


@dataclass(frozen=True)
class ScriptFinding:
    """A mistake or surprise that a recording reveals: what was seen, why, and what changes it."""

    code: str
    """A stable name, for scripts."""
    message: str
    """What was seen, why it is so, and what changes it."""
    body: str | None
    """Label of the body that it is about."""
    step: int | None
    """When it was first seen, or when it was worst; the message says which."""
    site: str | None
    """File and line of the call that caused it."""


@dataclass(frozen=True)
class ScriptAnalysis(Shown, lines_of="drop_physics.console.show_analysis:analysis_lines"):
    """Everything that the analysis of a script's recording found."""

    origin: dict[str, Any]
    """The script, its arguments, and how it ended."""
    engine: dict[str, Any]
    """The last timestep, gravity … of the engine, by client."""
    bodies: list[BodyAnalysis]
    """All bodies that ever existed, or that of `--body`."""
    findings: list[ScriptFinding]
    """The mistakes and surprises that the recording reveals, the gravest first."""
    explained: dict[str, int]
    """Number of samples of bodies without joints (`of`), and of explained ones (`samples`)."""
    by_body: dict[int, dict[str, int]]
    """The same for each body, by number."""
    table: pl.DataFrame
    """One row per sample and body: step, time, segment, error in flight, energy."""
    recording: Path | None = None
    """The recording that was analyzed."""
    layer: Path | None = None
    """The layer that shows the analysis."""
    partial: bool = False
    """Whether the recording was never finished, so that only its beginning was analyzed."""

    def as_json(self) -> dict[str, Any]:
        """Return the documented JSON object; what does not exist is null."""
        return {
            name: jsonable(value) for name, value in vars(self).items() if name not in NOT_IN_JSON
        }

    def of_body(self, number: int) -> ScriptAnalysis:
        """Return the analysis of one body, with its findings."""
        (body,) = (body for body in self.bodies if body.id == number)
        findings = [finding for finding in self.findings if finding.body in (None, body.label)]
        explained = self.by_body[number]
        return replace(self, bodies=[body], findings=findings, explained=explained)
