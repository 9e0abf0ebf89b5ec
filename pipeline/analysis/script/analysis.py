"""The analysis of a script's recording: every body by itself, then what is worth a second look."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from pipeline.analysis.general.contacts import contacts_of
from pipeline.analysis.general.flights import taken_apart
from pipeline.analysis.general.mechanics import mechanics_of_part
from pipeline.analysis.general.samples import motion_of
from pipeline.analysis.general.segments import (
    CONTACT,
    EXPLAINED,
    FLIGHT,
    JOINTED,
    SEGMENTS,
    SET,
    UNEXPLAINED,
)
from pipeline.analysis.script.evidence import Evidence
from pipeline.analysis.script.findings import findings_of
from pipeline.analysis.script.judged import REASONS, Judged, judged
from pipeline.analysis.script.results import (
    BodyAnalysis,
    BodyEnergy,
    Moment,
    Pusher,
    ScriptAnalysis,
    ScriptContact,
    ScriptFlight,
    Unexplained,
)
from pipeline.analysis.script.times import Times
from pipeline.analysis.script.tracks import order, tracks_of
from pipeline.laws.base import Motion
from pipeline.laws.lookup import RIGID
from pipeline.seen import Body, Dynamics, Seen

Float64 = NDArray[np.float64]


@np.errstate(over="ignore", invalid="ignore")  # of states that are not finite, which are named
def script_analysis_of(
    seen: Seen, origin: Mapping[str, Any], *, at_s: Sequence[float] = ()
) -> ScriptAnalysis:
    """Return what a script's recording tells.

    Parameters
    ----------
    seen
        What was seen of its simulations.
    origin
        The script, and how it ended: handed on.
    at_s
        Times [s] at which the flights that are under way are taken apart, beside their ends.
    """
    contacts = contacts_of(seen.contacts)
    springy = frozenset(
        one.body.number
        for one in seen.dynamics
        if (np.nan_to_num(one.reported["contact_stiffness"], nan=-1.0) >= 0).any()
    )
    maximal = frozenset(
        one.body.number for one in seen.dynamics if one.reported["kind"][0] == RIGID
    )
    rolling = frozenset(
        one.body.number
        for one in seen.dynamics
        if one.reported["rolling_friction"].any() or one.reported["spinning_friction"].any()
    )
    samples = _samples_of_clients(seen)
    tracks = {track.body.number: track for track in tracks_of(seen)}
    found: dict[int, Judged] = {
        number: judged(
            track,
            contacts,
            springy=springy,
            rigid=maximal,
            rolling=rolling,
            soft=any(one.soft for one in seen.bodies.values() if one.client == track.body.client),
            stepped=samples.get(track.body.client, 0) > 1,
            machine=seen.machine,
        )
        for number, track in tracks.items()
    }
    energies = {
        number: energies_j(seen, one.track.body, seen.by_body[number].dynamics, one)
        for number, one in found.items()
    }
    times = {body.client: Times(seen, body.client) for body in seen.bodies.values()}
    bodies = [
        _body(
            seen, body, found.get(number), energies.get(number), times[body.client], samples, at_s
        )
        for number, body in sorted(seen.bodies.items())
    ]
    explained = {number: _explained(found.get(number)) for number in seen.bodies}
    return ScriptAnalysis(
        origin=dict(origin),
        engine=_engine(seen),
        bodies=bodies,
        findings=findings_of(Evidence(seen, found, contacts, times, bodies, samples)),
        explained={
            name: sum(one[name] for one in explained.values()) for name in ("samples", "of")
        },
        by_body=explained,
        table=pl.concat(
            [_empty(), *(_table(one, energies[number], times) for number, one in found.items())]
        ),
    )


def _samples_of_clients(seen: Seen) -> dict[int, int]:
    """Return how many samples each simulation has."""
    clients = {number: body.client for number, body in seen.bodies.items()}
    steps = seen.states.select("step", pl.col("body").replace_strict(clients, default=0)).unique()
    counts = steps.group_by("body").len()
    return dict(counts.iter_rows())


def _explained(found: Judged | None) -> dict[str, int]:
    """Return how many samples a body without joints has, and how many of them are explained."""
    if found is None or found.track.body.joints:
        return {"samples": 0, "of": 0}
    counted = found.code != JOINTED
    return {"samples": int(np.isin(found.code, EXPLAINED).sum()), "of": int(counted.sum())}


def _there(seen: Seen, body: Body, known: int) -> int:
    """Return at how many samples of its simulation a body without any of its own was there.

    `known` is how many those who have some have, for recordings that do not say.
    """
    found, came = 0, seen.by_body[body.number].came
    went = [one for one in seen.appearances if one.body.number == body.number and not one.there]
    last = seen.samples.get(body.client, known) - 1
    for one in came:
        ends = [each.at.step for each in went if order(each.at) > order(one.at)]
        # What goes at step 0 does so before there is a sample.
        end = min([last, *(step or -1 for step in ends)])
        found += max(0, end - one.at.step - one.sampled + 1)
    return found


def _engine(seen: Seen) -> dict[str, Any]:
    last = {one.client: one.values for one in seen.settings}
    return {
        str(client): {name: np.asarray(value).tolist() for name, value in values.items()}
        for client, values in sorted(last.items())
    }


def _body(
    seen: Seen,
    body: Body,
    found: Judged | None,
    energy_j: Float64 | None,
    times: Times,
    samples: Mapping[int, int],
    at_s: Sequence[float],
) -> BodyAnalysis:
    dynamics = seen.by_body[body.number].dynamics
    counts: dict[str, int] = dict.fromkeys(SEGMENTS, 0)
    if found is None:
        counts["still"] = _there(seen, body, samples.get(body.client, 1))
    else:
        held = np.bincount(found.code, minlength=len(SEGMENTS)).tolist()
        counts |= zip(SEGMENTS, held, strict=True)
    return BodyAnalysis(
        name=body.name,
        label=body.label,
        id=body.number,
        links=list(body.links),
        mass_kg=float(np.sum(dynamics[-1].reported["mass_kg"])) if dynamics else 0.0,
        segments=counts,
        flights=[] if found is None else _flights(found, times, at_s),
        contacts=[] if found is None else _contacts(seen, found, times),
        unexplained=[] if found is None else _unexplained(found),
        energy=None if found is None or energy_j is None else _energy(found, energy_j),
    )


def _flights(found: Judged, times: Times, at_s: Sequence[float]) -> list[ScriptFlight]:
    flights = []
    for first, last in found.runs(FLIGHT):
        row = _begins(found, first)
        began, ends = int(found.track.steps[row]) - 1, _moment(found, times, row, last)
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
                    _moment(found, times, row, row + step - began - 1)
                    for step in asked
                    if step is not None
                ],
            )
        )
    return flights


def _begins(found: Judged, first: int) -> int:
    """Return the first row of a flight, one more where it fell from where a call put it."""
    before = first - 1
    follows = first > 0 and found.track.steps[before] == found.track.steps[first] - 1
    put = follows and found.code[before] == SET and bool(found.falls[before])
    return before if put and found.law_at(before) is found.law_at(first) else first


def _moment(found: Judged, times: Times, first: int, row: int) -> Moment:
    """Return a sample of a flight whose first step led to the row `first`."""
    law, track = found.law_at(row), found.track
    assert law is not None
    start = track.before.at(slice(first, first + 1))
    position_m, steps = track.motion.position_m[row], row - first + 1
    error_m, terms_m = taken_apart(start, position_m, law, steps=steps)
    held = bool(found.held[first : row + 1].any())
    step = int(track.steps[row])
    return Moment(step, times.of(step), error_m, None if held else terms_m)


def _contacts(seen: Seen, found: Judged, times: Times) -> list[ScriptContact]:
    phases, track, touches = [], found.track, found.touches
    for first, last in found.runs(CONTACT):
        law = found.law_at(first)
        assert law is not None
        rows = slice(first, last + 1)
        points = (touches.step >= first) & (touches.step <= last)
        given_j = found.energy_j[rows]
        most = int(np.argmax(given_j))
        by = []
        pairs = np.stack((touches.other_body[points], touches.other_link[points]), axis=1)
        for number, link in np.unique(pairs, axis=0).tolist():
            its = points & (touches.other_body == number) & (touches.other_link == link)
            impulse = touches.force_n[its].sum(axis=0) * law.step_s
            name = seen.bodies[number].label if number in seen.bodies else str(number)
            to_it_j = float(found.point_energy_j[its].sum())
            by.append(Pusher(name, number, link, _vector(impulse), to_it_j))
        impulses = found.impulse_n_s[rows]
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


def _unexplained(found: Judged) -> list[Unexplained]:
    held = []
    for number in np.unique(found.reason[found.code == UNEXPLAINED]).tolist():
        rows = np.flatnonzero((found.code == UNEXPLAINED) & (found.reason == number))
        first = int(rows[0])
        held.append(
            Unexplained(
                REASONS[number],
                len(rows),
                int(found.track.steps[first]),
                float(found.deviation[first]),
            )
        )
    return held


_COLUMNS = {
    "step": pl.Int64, "time_s": pl.Float64, "body": pl.Int64, "label": pl.String,
    "segment": pl.String, "x_m": pl.Float64, "y_m": pl.Float64, "z_m": pl.Float64,
    "error_x_m": pl.Float64, "error_y_m": pl.Float64, "error_z_m": pl.Float64,
    "energy_j": pl.Float64, "contact_j": pl.Float64,
}  # fmt: skip
"""Of the table of samples; an error is that of the flight that a sample belongs to, else null."""


def _empty() -> pl.DataFrame:
    return pl.DataFrame(schema=_COLUMNS)


def _table(found: Judged, energy_j: Float64 | None, times: Mapping[int, Times]) -> pl.DataFrame:
    track, body = found.track, found.track.body
    error_m = np.full((len(track), 3), np.nan)
    for first, last in found.runs(FLIGHT):
        row, law = _begins(found, first), found.law_at(first)
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
        "label": [body.label] * len(track),
        "segment": np.array(SEGMENTS, dtype=object)[found.code].tolist(),
        **{f"{axis}_m": track.motion.position_m[:, n] for n, axis in enumerate("xyz")},
        **{f"error_{axis}_m": error_m[:, n] for n, axis in enumerate("xyz")},
        "energy_j": np.full(len(track), np.nan) if energy_j is None else energy_j,
        "contact_j": found.energy_j,
    }
    return pl.DataFrame(named, schema=_COLUMNS, nan_to_null=True)


def _energy(found: Judged, energy_j: Float64) -> BodyEnergy:
    largest = int(np.argmax(energy_j))
    return BodyEnergy(
        first_j=float(energy_j[0]),
        last_j=float(energy_j[-1]),
        largest_j=float(energy_j[largest]),
        largest_step=int(found.track.steps[largest]),
        contact_j=None if found.track.body.joints else float(found.energy_j.sum()),
    )


def energies_j(
    seen: Seen, body: Body, dynamics: Sequence[Dynamics], found: Judged
) -> Float64 | None:
    """Return the energy of motion and in gravity of a body [J], a row per sample of its base.

    None where its parts or their masses were not the same all the time.
    """
    masses = {tuple(one.reported["mass_kg"].tolist()) for one in dynamics}
    inertias = {tuple(one.reported["inertia_kg_m2"].ravel().tolist()) for one in dynamics}
    if len(masses) != 1 or len(inertias) != 1:
        return None
    reported, track = dynamics[-1].reported, found.track
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
        of_part = mechanics_of_part(part, mass_kg, inertia, 0.0)
        total_j += of_part.kinetic_linear_j + of_part.kinetic_angular_j
        total_j -= mass_kg * np.sum(gravity * part.position_m, axis=1)
    return total_j


def _vector(values: Float64) -> tuple[float, float, float]:
    x, y, z = values.tolist()
    return x, y, z
