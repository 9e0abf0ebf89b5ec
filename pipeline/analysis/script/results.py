"""What the analysis of a script's recording finds; SI units, world axes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import polars as pl

from pipeline.analysis.general.flights import VectorTerms
from pipeline.analysis.general.jsonable import jsonable
from pipeline.shown import Shown

Vector = tuple[float, float, float]

UNTOLD = ("table", "by_body")
"""Of a script's analysis, what its JSON object leaves out."""


@dataclass(frozen=True)
class Moment:
    """A sample of a flight, taken apart."""

    step: int
    """Its number."""
    time_s: float
    """Simulated time."""
    error_m: Vector
    """Simulated minus free fall."""
    terms_m: VectorTerms | None
    """What that is made of; None as for the flight."""


@dataclass(frozen=True)
class ScriptFlight:
    """From a sample on a body meets nothing, and follows the law of free flight."""

    first_step: int
    """What it starts from: a sample, or what a call has made of it."""
    last_step: int
    """The last sample that the law of flight led to."""
    start_s: float
    """Time of the first."""
    end_s: float
    """Time of the last."""
    error_m: Vector
    """Simulated minus free fall at the last sample, from the state at the first on."""
    terms_m: VectorTerms | None
    """What that is made of; None where a velocity was held at the engine's limit, or where gravity
    is not along z."""
    at: list[Moment]
    """The samples nearest to `--at`."""


@dataclass(frozen=True)
class Pusher:
    """What pushed a body in a contact."""

    body: str
    """Its label."""
    id: int
    """Its number in the recording."""
    link: int
    """-1 is the base."""
    impulse_n_s: Vector
    """Of its forces together."""
    energy_j: float
    """What it gave to the body's energy of motion."""


@dataclass(frozen=True)
class ScriptContact:
    """An unbroken run of samples that contact led to."""

    first_step: int
    """The first of them."""
    last_step: int
    """The last of them."""
    start_s: float
    """Time of the first."""
    end_s: float
    """Time of the last."""
    impulse_n_s: Vector
    """Of all contact forces on the body together."""
    largest_force_n: float
    """The greatest of a step, all points together."""
    energy_j: float
    """What contact gave to the body's energy of motion, or took from it."""
    most_given_j: float
    """The most that it gave in a step; 0 where it only took."""
    most_given_step: int | None
    """In which that was."""
    by: list[Pusher]
    """What pushed it, link by link."""


@dataclass(frozen=True)
class Unexplained:
    """Samples that neither the law nor contact leads to, of one reason."""

    reason: str
    """What is known of why."""
    samples: int
    """How many there are."""
    first_step: int
    """The first of them."""
    deviation: float
    """How far the first of them is off, in the worst of its numbers [m, m/s, rad/s, 1]."""


@dataclass(frozen=True)
class BodyEnergy:
    """Energy of motion and in gravity, of all links together; z = 0 is where the latter is 0."""

    first_j: float
    """At its first sample."""
    last_j: float
    """At its last sample."""
    largest_j: float
    """The most that it had."""
    largest_step: int
    """In which sample."""
    contact_j: float | None
    """What all contacts gave to its energy of motion, or took; None of a body with joints."""


@dataclass(frozen=True)
class BodyAnalysis:
    """What one body did."""

    name: str
    """The file that it was loaded from, or what it is called."""
    label: str
    """Number and name: what findings and the recording's entities call it."""
    id: int
    """In the recording: the engine's own id, unless another body had it before."""
    links: list[str]
    """Base and links."""
    mass_kg: float
    """Of all of them; as it was last."""
    segments: dict[str, int]
    """How many samples are what: flight, contact, pushed, set, jointed, still, unexplained."""
    flights: list[ScriptFlight]
    """Each way through the air, taken apart."""
    contacts: list[ScriptContact]
    """What touched it."""
    unexplained: list[Unexplained]
    """Its samples that are not explained, by reason."""
    energy: BodyEnergy | None
    """None of what has no samples, or no mass."""


@dataclass(frozen=True)
class ScriptFinding:
    """Something a recording gives away: what was seen, why, and what changes it."""

    code: str
    """A name that stays: what scripts look for."""
    message: str
    """What was seen, why it is so, and what changes it."""
    body: str | None
    """Of which it speaks."""
    step: int | None
    """When it was seen first, or where it was worst; its message says which."""
    site: str | None
    """File and line of the call that caused it."""


@dataclass(frozen=True)
class ScriptAnalysis(Shown, lines_of="pipeline.console.show_script:analysis_lines"):
    """Everything that a script's recording tells."""

    origin: dict[str, Any]
    """The script, its arguments, and how it ended."""
    engine: dict[str, Any]
    """Timestep, gravity … as the engine had them last, by client."""
    bodies: list[BodyAnalysis]
    """All that were ever there, or the one of `--body`."""
    findings: list[ScriptFinding]
    """What is worth a second look, the gravest first."""
    explained: dict[str, int]
    """Samples of bodies without joints, and how many of them are explained."""
    by_body: dict[int, dict[str, int]]
    """The same of each body that was ever there, by number."""
    table: pl.DataFrame
    """One row per sample and body: step, time, segment, error in flight, energy."""
    recording: Path | None = None
    """The recording that was analyzed."""
    layer: Path | None = None
    """What shows the analysis beside it."""
    partial: bool = False
    """Whether the recording was never finished: this is the analysis of what there is of it."""

    def as_json(self) -> dict[str, Any]:
        """Return the contract's JSON object; what does not exist is null."""
        return {name: jsonable(value) for name, value in vars(self).items() if name not in UNTOLD}

    def of_body(self, number: int) -> ScriptAnalysis:
        """Return what is told of one body, and its findings."""
        (body,) = (one for one in self.bodies if one.id == number)
        findings = [one for one in self.findings if one.body in (None, body.label)]
        explained = self.by_body[number]
        return replace(self, bodies=[body], findings=findings, explained=explained)
