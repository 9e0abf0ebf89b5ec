"""The analysis of a script's recording: each body by itself, then the findings."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from drop_physics.analysis.general.contacts import Contacts
from drop_physics.analysis.general.flights import error_and_terms
from drop_physics.analysis.general.mechanics import mechanics_of_part
from drop_physics.analysis.general.samples import motion_of
from drop_physics.analysis.general.segments import (
    CONTACT,
    EXPLAINED,
    FLIGHT,
    JOINTED,
    SEGMENTS,
    SET,
    UNEXPLAINED,
)
from drop_physics.analysis.script.evidence import Evidence
from drop_physics.analysis.script.findings import findings_of
from drop_physics.analysis.script.judged import REASONS, Judged, judged
from drop_physics.analysis.script.results import (
    BodyAnalysis,
    BodyEnergy,
    Moment,
    Pusher,
    ScriptAnalysis,
    ScriptContact,
    ScriptFlight,
    Unexplained,
)
from drop_physics.analysis.script.tracks import tracks_of
from drop_physics.analysis.times import Times
from drop_physics.laws.base import Motion
from drop_physics.laws.lookup import RIGID
from drop_physics.seen.calls import Given
from drop_physics.seen.events import Body, Dynamics, order
from drop_physics.seen.history import Seen

Float64 = NDArray[np.float64]


@np.errstate(over="ignore", invalid="ignore")  # of states that are not finite: reported
def script_analysis_of(
    seen: Seen, origin: Mapping[str, Any], *, at_s: Sequence[float] = ()
) -> ScriptAnalysis:
    """Analyze a script's recording.

    Parameters
    ----------
    seen
        What was observed of its simulations.
    origin
        The script, and how it ended: passed on.
    at_s
        Times [s] at which to break down the errors of flights, besides their ends.
    """
    contacts = Contacts(seen.contacts)
    springy = frozenset(
        each.body.number
        for each in seen.dynamics
        if (np.nan_to_num(each.reported["contact_stiffness"], nan=-1.0) >= 0).any()
    )
    maximal = frozenset(
        each.body.number for each in seen.dynamics if each.reported["kind"][0] == RIGID
    )
    rolling = frozenset(
        each.body.number
        for each in seen.dynamics
        if each.reported["rolling_friction"].any() or each.reported["spinning_friction"].any()
    )
    nearest_m = {
        number: min(given)
        for number, record in seen.by_body.items()
        if (given := [*_thresholds_m(record.given)])
    }
    samples = _samples_of_clients(seen)
    tracks = {track.body.number: track for track in tracks_of(seen)}
    verdicts: dict[int, Judged] = {
        number: judged(
            track,
            contacts,
            springy=springy,
            rigid=maximal,
            rolling=rolling,
            nearest_m=nearest_m,
            soft=any(
                body.soft for body in seen.bodies.values() if body.client == track.body.client
            ),
            stepped=samples.get(track.body.client, 0) > 1,
            machine=seen.machine,
        )
        for number, track in tracks.items()
    }
    energies = {
        number: energies_j(seen, verdict.track.body, seen.by_body[number].dynamics, verdict)
        for number, verdict in verdicts.items()
    }
    times = {body.client: Times(seen, body.client) for body in seen.bodies.values()}
    bodies = [
        _body(
            seen,
            body,
            verdicts.get(number),
            energies.get(number),
            times[body.client],
            samples,
            at_s,
        )
        for number, body in sorted(seen.bodies.items())
    ]
    # A distance that is not finite says nothing of how deep they overlap.
    finite = pl.when(pl.col("distance_m").is_finite()).then(pl.col("distance_m")).otherwise(0.0)
    measured = Contacts(seen.contacts.with_columns(finite))
    explained = {number: _explained(verdicts.get(number)) for number in seen.bodies}
    return ScriptAnalysis(
        origin=dict(origin),
        engine=_engine(seen),
        bodies=bodies,
        findings=findings_of(Evidence(seen, verdicts, measured, times, bodies, samples)),
        explained={
            name: sum(each[name] for each in explained.values()) for name in ("samples", "of")
        },
        by_body=explained,
        table=pl.concat(
            [
                pl.DataFrame(schema=_COLUMNS),
                *(_table(verdict, energies[number], times) for number, verdict in verdicts.items()),
            ]
        ),
    )


def _thresholds_m(given: Sequence[Given]) -> Iterator[float]:
    """Yield the contactProcessingThresholds [m] that calls gave a body, but for ignored ones."""
    for each in given:
        value = each.values.get("contactProcessingThreshold", -1)
        if isinstance(value, int | float) and value >= 0:
            yield value


def _samples_of_clients(seen: Seen) -> dict[int, int]:
    """Return the number of samples of each simulation."""
    clients = {number: body.client for number, body in seen.bodies.items()}
    steps = seen.states.select("step", pl.col("body").replace_strict(clients, default=0)).unique()
    counts = steps.group_by("body").len()
    return dict(counts.iter_rows())


def _explained(verdict: Judged | None) -> dict[str, int]:
    """Return the number of samples of a body without joints, and of those explained."""
    if verdict is None or verdict.track.body.joints:
        return {"samples": 0, "of": 0}
    counted = verdict.code != JOINTED
    return {"samples": int(np.isin(verdict.code, EXPLAINED).sum()), "of": int(counted.sum())}


def _there(seen: Seen, body: Body, known: int) -> int:
    """Return at how many samples of its simulation a body without own samples existed.

    `known` is the number of samples of other bodies, for recordings that lack the simulation's.
    """
    samples, came = 0, seen.by_body[body.number].came
    went = [each for each in seen.appearances if each.body.number == body.number and not each.there]
    last = seen.samples.get(body.client, known) - 1
    for appearance in came:
        ends = [each.at.step for each in went if order(each.at) > order(appearance.at)]
        # A body removed at step 0 is gone before the first sample.
        end = min([last, *(step or -1 for step in ends)])
        samples += max(0, end - appearance.at.step - appearance.sampled + 1)
    return samples


def _engine(seen: Seen) -> dict[str, Any]:
    last = {settings.client: settings.values for settings in seen.settings}
    return {
        str(client): {name: np.asarray(value).tolist() for name, value in values.items()}
        for client, values in sorted(last.items())
    }


def _body(
    seen: Seen,
    body: Body,
    verdict: Judged | None,
    energy_j: Float64 | None,
    times: Times,
    samples: Mapping[int, int],
    at_s: Sequence[float],
) -> BodyAnalysis:
    dynamics = seen.by_body[body.number].dynamics
    counts: dict[str, int] = dict.fromkeys(SEGMENTS, 0)
    if verdict is None and not body.soft:
        known = samples.get(body.client, 1)
        last = seen.samples.get(body.client, known) - 1
        moves = {put.at.step for put in seen.by_body[body.number].moves if put.at.step < last}
        there = _there(seen, body, known)
        counts["set"] = min(there, len(moves))
        counts["still"] = there - counts["set"]
    elif verdict is not None:
        held = np.bincount(verdict.code, minlength=len(SEGMENTS)).tolist()
        counts |= zip(SEGMENTS, held, strict=True)
    return BodyAnalysis(
        name=body.name,
        label=body.label,
        id=body.number,
        soft=body.soft,
        links=list(body.links),
        mass_kg=float(np.sum(dynamics[-1].reported["mass_kg"])) if dynamics else 0.0,
        segments=counts,
        flights=[] if verdict is None else _flights(verdict, times, at_s),
        contacts=[] if verdict is None else _contacts(seen, verdict, times),
        unexplained=[] if verdict is None else _unexplained(verdict),
        energy=None if verdict is None or energy_j is None else _energy(verdict, energy_j),
    )


def _flights(verdict: Judged, times: Times, at_s: Sequence[float]) -> list[ScriptFlight]:
    flights = []
    for first, last in verdict.runs(FLIGHT):
        row = _begins(verdict, first)
        began, ends = int(verdict.track.steps[row]) - 1, _moment(verdict, times, row, last)
        asked = (times.nearest(time_s, began + 1, ends.step) for time_s in at_s)
        flights.append(
            ScriptFlight(
                first_step=began,
                last_step=ends.step,
                start_s=times.of(began),
                end_s=ends.time_s,
                error_m=ends.error_m,
                terms_m=ends.terms_m,
                at=[
                    _moment(verdict, times, row, row + step - began - 1)
                    for step in asked
                    if step is not None
                ],
            )
        )
    return flights


def _begins(verdict: Judged, first: int) -> int:
    """Return the first row of a flight, one earlier if it fell from where a call put it."""
    before = first - 1
    follows = first > 0 and verdict.track.steps[before] == verdict.track.steps[first] - 1
    put = follows and verdict.code[before] == SET and bool(verdict.falls[before])
    return before if put and verdict.law_at(before) is verdict.law_at(first) else first


def _moment(verdict: Judged, times: Times, first: int, row: int) -> Moment:
    """Return a sample of a flight whose first step led to the row `first`."""
    law, track = verdict.law_at(row), verdict.track
    assert law is not None
    start = track.before.at(slice(first, first + 1))
    position_m, steps = track.motion.position_m[row], row - first + 1
    error_m, terms_m = error_and_terms(start, position_m, law, steps=steps)
    held = bool(verdict.held[first : row + 1].any())
    step = int(track.steps[row])
    return Moment(step, times.of(step), error_m, None if held else terms_m)


def _contacts(seen: Seen, verdict: Judged, times: Times) -> list[ScriptContact]:
    phases, track, touches = [], verdict.track, verdict.touches
    for first, last in verdict.runs(CONTACT):
        law = verdict.law_at(first)
        assert law is not None
        rows = slice(first, last + 1)
        points = (touches.step >= first) & (touches.step <= last)
        given_j = verdict.energy_j[rows]
        most = int(np.argmax(given_j))
        by = []
        others = pl.DataFrame([touches.other_body[points], touches.other_link[points]]).unique()
        for number, link in sorted(others.iter_rows()):
            its = points & (touches.other_body == number) & (touches.other_link == link)
            impulse = touches.force_n[its].sum(axis=0) * law.step_s
            name = seen.bodies[number].label if number in seen.bodies else str(number)
            to_it_j = float(verdict.point_energy_j[its].sum())
            by.append(Pusher(name, number, link, _vector(impulse), to_it_j))
        impulses = verdict.impulse_n_s[rows]
        phases.append(
            ScriptContact(
                first_step=int(track.steps[first]),
                last_step=int(track.steps[last]),
                start_s=times.of(int(track.steps[first])),
                end_s=times.of(int(track.steps[last])),
                impulse_n_s=_vector(impulses.sum(axis=0)),
                largest_force_n=float(np.linalg.norm(impulses, axis=1).max()) / law.step_s,
                energy_j=float(given_j.sum()),
                most_given_j=max(0.0, float(given_j[most])),
                most_given_step=int(track.steps[first + most]) if given_j[most] > 0 else None,
                by=by,
            )
        )
    return phases


def _unexplained(verdict: Judged) -> list[Unexplained]:
    groups = []
    for number in np.unique(verdict.reason[verdict.code == UNEXPLAINED]).tolist():
        rows = np.flatnonzero((verdict.code == UNEXPLAINED) & (verdict.reason == number))
        first = int(rows[0])
        groups.append(
            Unexplained(
                REASONS[number],
                len(rows),
                int(verdict.track.steps[first]),
                float(verdict.deviation[first]),
            )
        )
    return groups


_COLUMNS = {
    "step": pl.Int64, "time_s": pl.Float64, "body": pl.Int64, "label": pl.String,
    "segment": pl.String, "x_m": pl.Float64, "y_m": pl.Float64, "z_m": pl.Float64,
    "error_x_m": pl.Float64, "error_y_m": pl.Float64, "error_z_m": pl.Float64,
    "energy_j": pl.Float64, "contact_j": pl.Float64,
}  # fmt: skip
"""Of the table of samples; an error is that of the flight with the sample, else null."""


def _table(verdict: Judged, energy_j: Float64 | None, times: Mapping[int, Times]) -> pl.DataFrame:
    track, body = verdict.track, verdict.track.body
    error_m = np.full((len(track), 3), np.nan)
    for first, last in verdict.runs(FLIGHT):
        row, law = _begins(verdict, first), verdict.law_at(first)
        assert law is not None
        start, rows = track.before.at(slice(row, row + 1)), slice(row, last + 1)
        time_s = np.arange(1, last - row + 2)[:, None] * law.timestep_s
        pull = np.array(law.gravity_m_s2) * time_s / 2
        free_fall_m = start.position_m + (start.velocity_m_s + pull) * time_s
        error_m[rows] = track.motion.position_m[rows] - free_fall_m
    named = {
        "step": track.steps,
        "time_s": times[body.client].of_all(track.steps),
        "body": np.full(len(track), body.number),
        "label": pl.repeat(body.label, len(track), eager=True),
        "segment": pl.Series(SEGMENTS).gather(verdict.code),
        **{f"{axis}_m": track.motion.position_m[:, n] for n, axis in enumerate("xyz")},
        **{f"error_{axis}_m": error_m[:, n] for n, axis in enumerate("xyz")},
        "energy_j": np.full(len(track), np.nan) if energy_j is None else energy_j,
        "contact_j": verdict.energy_j,
    }
    return pl.DataFrame(named, schema=_COLUMNS, nan_to_null=True)


def _energy(verdict: Judged, energy_j: Float64) -> BodyEnergy:
    largest, known = int(np.nanargmax(energy_j)), np.flatnonzero(np.isfinite(energy_j))
    return BodyEnergy(
        first_j=float(energy_j[known[0]]),
        last_j=float(energy_j[known[-1]]),
        largest_j=float(energy_j[largest]),
        largest_step=int(verdict.track.steps[largest]),
        contact_j=None if verdict.track.body.joints else float(verdict.energy_j.sum()),
    )


def energies_j(
    seen: Seen, body: Body, dynamics: Sequence[Dynamics], verdict: Judged
) -> Float64 | None:
    """Return kinetic plus potential energy of a body [J], a row per sample of its base.

    None where its parts or their masses changed, or some of them are not reported.
    """
    if body.hides_links:
        return None
    masses = {tuple(each.reported["mass_kg"].tolist()) for each in dynamics}
    inertias = {tuple(each.reported["inertia_kg_m2"].ravel().tolist()) for each in dynamics}
    if len(masses) != 1 or len(inertias) != 1:
        return None
    reported, track = dynamics[-1].reported, verdict.track
    gravity = np.zeros((len(track), 3))
    for epoch in track.epochs:
        values = epoch.settings.values
        gravity[epoch.rows] = [np.ravel(values[f"gravityAcceleration{axis}"])[0] for axis in "XYZ"]
    total_j = np.zeros(len(track))
    for link, mass_kg, inertia in zip(
        range(-1, len(reported["mass_kg"]) - 1),
        reported["mass_kg"].tolist(),
        reported["inertia_kg_m2"],
        strict=True,
    ):
        if not mass_kg or link not in body.moving:
            continue
        rows = seen.parts.get((body.number, link))
        if rows is None or not np.array_equal(rows["step"].to_numpy(), track.steps):
            return None
        part: Motion = motion_of(rows)
        # Velocities are turned into world axes by the orientation that is reported with them.
        of_part = mechanics_of_part(part, mass_kg, inertia, 0.0)
        total_j += of_part.kinetic_linear_j + of_part.kinetic_angular_j
        total_j -= mass_kg * np.sum(gravity * part.position_m, axis=1)
    return total_j if np.isfinite(total_j).any() else None


def _vector(values: Float64) -> tuple[float, float, float]:
    x, y, z = values.tolist()
    return x, y, z
