"""Verification: PyBullet's motion of single bodies is explained sample by sample.

The bodies are thrown about in PyBullet itself (`watched.py`), with none of our code; the law, the
balance and the segments then have its samples and its contact points, as a recording has them.
"""

from __future__ import annotations

import itertools
import random
from collections.abc import Iterator
from dataclasses import astuple, fields, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pybullet as p
import pytest
from conftest import some
from drop_physics.explain.balance import Balance, Pushes, balance_of
from drop_physics.explain.decomposition import VectorTerms, error_and_terms
from drop_physics.explain.segments import (
    CONTACT,
    FLIGHT,
    PUSHED,
    SEGMENTS,
    SET,
    UNEXPLAINED,
    Segments,
    segments_of,
)
from drop_physics.explain.touching import touches_of
from drop_physics.physics.base import Motion
from drop_physics.physics.laws.bullet.law import BulletLaw
from drop_physics.trace import states
from engine import MODES, ROUNDS_ONCE
from iterated import law_of
from watched import Watched, random_throw, thrown

THROWS = 60


def law_behind(watched: Watched) -> BulletLaw:
    names = ("timestep_s", "gravity_m_s2", "coordinates", "linear_damping", "angular_damping")
    return law_of(
        **{name: watched.how[name] for name in names},
        substeps=watched.how["substeps"] or 1,
        mass_kg=watched.mass_kg,
        inertia_kg_m2=watched.inertia_kg_m2,
    )


def motion_of(watched: Watched) -> Motion:
    return Motion(*(getattr(watched, one.name) for one in fields(Motion)))


def contacts_in(watched: Watched) -> states.Rows:
    # flag, a, b, link a, link b, on a, on b, normal, distance, force, friction and direction x 2
    rows = [
        (step, point[1], point[3], point[2], point[4], *point[5:14])
        for step, point in watched.points
    ]
    return np.array(rows, states.CONTACT)


def segments_in(watched: Watched, motion: Motion | None = None, **how: Any) -> Segments:
    motion = motion_of(watched) if motion is None else motion
    touches = touches_of(contacts_in(watched), watched.body)
    return segments_of(motion, law_behind(watched), touches, exact=ROUNDS_ONCE, **how)


def first_unexplained(segments: Segments) -> int | None:
    """Return the first unexplained sample."""
    return next(iter(np.flatnonzero(segments.code == UNEXPLAINED).tolist()), None)


def throws(folder: Path, seed: int, **fixed: Any) -> Iterator[Watched]:
    rng = random.Random(seed)
    for _ in range(THROWS):
        yield random_throw(rng, folder, **fixed)


# -- the law's one step ----------------------------------------------------------------------------


@pytest.mark.parametrize("coordinates", some(MODES, 1))
def test_one_step_from_each_recorded_sample_is_pybullets(coordinates: Any, tmp_path: Path) -> None:
    """Velocities agree to the last bit, or to 8 x 2^-52 where a btMultiBody rotates."""
    worst = 0.0
    for watched in throws(tmp_path, 1, coordinates=coordinates, height_m=50.0, samples=60):
        motion, law = motion_of(watched), law_behind(watched)
        before, after = motion.at(slice(-1)), law.step(motion.at(slice(-1)))
        exact = law.bits(before)
        assert coordinates == "reduced" or exact.all()
        for name, terms in zip(("velocity_m_s", "spin_rad_s"), law.terms(before), strict=True):
            new = getattr(motion, name)[1:]
            off = np.abs(getattr(after, name) - new).max(axis=1)
            scale = terms + np.abs(new).max(axis=1)
            assert ROUNDS_ONCE is False or (off[exact] == 0).all()
            worst = max(worst, float((off / np.maximum(scale, 1e-300)).max()))
        moved = law.moved(before, motion.velocity_m_s[1:], motion.spin_rad_s[1:])
        assert not ROUNDS_ONCE or (moved.position_m == motion.position_m[1:]).all()
        agree = np.abs(np.sum(moved.orientation * motion.orientation[1:], axis=1))
        assert agree == pytest.approx(1, abs=1e-14)
    assert worst <= (8 * 2.0**-52 if ROUNDS_ONCE else 1e-12)


def test_several_samples_are_stepped_as_each_alone(tmp_path: Path) -> None:
    watched = thrown(tmp_path, samples=30, spin_rad_s=(3.0, -2.0, 9.0), height_m=9.0)
    motion, law = motion_of(watched), law_behind(watched)
    many = motion.at(np.arange(9000) % 30)  # more than a block
    together = law.step(many)
    for row in (0, 17, 8999):
        alone = law.step(many.at(slice(row, row + 1)))
        for one in fields(Motion):
            assert (getattr(alone, one.name)[0] == getattr(together, one.name)[row]).all()


# -- every sample is explained ---------------------------------------------------------------------


def test_every_sample_of_a_thrown_body_is_explained(tmp_path: Path) -> None:
    seen = dict.fromkeys(SEGMENTS, 0)
    sides = set()
    for watched in throws(tmp_path, 2):
        segments = segments_in(watched)
        sides |= {point[1] == watched.body for _, point in watched.points}
        assert first_unexplained(segments) is None, watched.how
        assert segments.code[0] == SET
        for code, count in zip(*np.unique(segments.code, return_counts=True), strict=True):
            seen[SEGMENTS[code]] += count
        forced = {step for step, point in watched.points if point[9] or point[10] or point[12]}
        assert set(np.flatnonzero(segments.code == CONTACT)) == forced
    assert sides == {True, False}  # it is the one body of a pair, and the other
    assert seen["flight"] > 2000
    assert seen["contact"] > 1000
    assert sum(seen.values()) == seen["flight"] + seen["contact"] + THROWS


def test_velocities_that_are_held_in_contact_are_explained_too(tmp_path: Path) -> None:
    held = 0
    for watched in throws(
        tmp_path, 3, coordinates="reduced", velocity_m_s=(60.0, 0.0, -50.0), gravity_m_s2=-9.81
    ):
        segments = segments_in(watched)
        assert first_unexplained(segments) is None, watched.how
        fastest = np.abs(np.hstack((watched.velocity_m_s, watched.spin_rad_s))).max(axis=1)
        held += int(((fastest == 100) & (segments.code == CONTACT)).sum())
    assert held > 10


@pytest.mark.parametrize("name", some([one.name for one in fields(Motion)], 1))
def test_an_altered_sample_is_unexplained(name: str, tmp_path: Path) -> None:
    rng = random.Random(4)
    for watched in itertools.islice(throws(tmp_path, 5, gravity_m_s2=-9.81), 20):
        motion = motion_of(watched)
        for sample in rng.sample(range(1, len(motion)), 3):
            values = getattr(motion, name).copy()
            column = rng.randrange(values.shape[1])
            turns = name == "orientation"
            values[sample, column] += 1e-10 * (1 + abs(values[sample]).max())
            code = segments_in(watched, replace(motion, **{name: values})).code
            assert code[sample] == UNEXPLAINED, (watched.how, sample, column)
            # The next sample rests on the altered one; those after it do not.
            later = slice(sample + 2, None)
            assert (code[:sample] != UNEXPLAINED).all()
            assert turns or (code[later] != UNEXPLAINED).all()


def test_one_bit_of_a_fall_without_spin_is_seen(tmp_path: Path) -> None:
    watched = thrown(tmp_path, samples=30, velocity_m_s=(0.3, 0.0, 1.0))
    motion = motion_of(watched)
    for name in ("position_m", "velocity_m_s"):
        values = getattr(motion, name).copy()
        values[20, 2] = np.nextafter(values[20, 2], 9)
        segments = segments_in(watched, replace(motion, **{name: values}))
        assert first_unexplained(segments) == (20 if ROUNDS_ONCE else None)


def test_an_altered_force_is_unexplained(tmp_path: Path) -> None:
    watched = thrown(tmp_path, spin_rad_s=(2.0, 3.0, 1.0))
    step = next(step for step, point in watched.points if point[9] > 0)
    changed = [
        (at, (*point[:9], point[9] * (1 + 1e-9), *point[10:])) if at == step else (at, point)
        for at, point in watched.points
    ]
    assert first_unexplained(segments_in(replace(watched, points=changed))) == step
    gone = [(at, point) for at, point in watched.points if at != step]
    assert first_unexplained(segments_in(replace(watched, points=gone))) == step


def test_another_law_is_unexplained_from_the_first_step_on(tmp_path: Path) -> None:
    watched = thrown(tmp_path, samples=50, height_m=5.0, velocity_m_s=(0.0, 0.0, 1.0))
    told = watched.how | {"linear_damping": 0.04}  # the default is double(0.04f)
    code = segments_in(replace(watched, how=told)).code
    assert (code[1:] == UNEXPLAINED).sum() > 40  # a slow sample may round to the same


# -- what is not covered ---------------------------------------------------------------------------


def test_substeps_are_explained_in_flight_and_not_in_contact(tmp_path: Path) -> None:
    for watched in list(throws(tmp_path, 6, substeps=4, gravity_m_s2=-9.81))[:20]:
        segments = segments_in(watched)
        near = np.flatnonzero(watched.position_m[:, 2] < 0.4)  # it reaches 0.25 m, and is fast
        first = int(near[0]) if len(near) else len(watched.position_m)
        assert (segments.code[1:first] == FLIGHT).all(), watched.how
        assert CONTACT not in segments.code


def test_rolling_friction_is_not_reported_so_not_explained(tmp_path: Path) -> None:
    watched = thrown(
        tmp_path, body="sphere", height_m=0.05, velocity_m_s=(2.0, 0.0, 0.0), rolling_friction=0.01
    )
    segments = segments_in(watched)
    assert (segments.code == UNEXPLAINED).sum() > 100
    balance = balance_in(watched)
    linear = np.abs(watched.velocity_m_s - balance.velocity_m_s).max(axis=1)
    assert (linear[1:] <= 1e-12 * balance.velocity_scale_m_s[1:]).all()


# -- pushes and calls ------------------------------------------------------------------------------


@pytest.mark.parametrize("coordinates", MODES)
def test_recorded_forces_are_balanced(coordinates: Any, tmp_path: Path) -> None:
    samples, rng = 200, np.random.default_rng(7)
    forces_n, torques_n_m = np.zeros((2, samples, 3))
    for step in range(20, samples, 3):
        forces_n[step], torques_n_m[step] = rng.normal(size=(2, 3)) * [[4.0], [0.1]]

    def push(client: int, body: int, step: int) -> None:
        if forces_n[step].any():
            at, _ = p.getBasePositionAndOrientation(body, physicsClientId=client)
            p.applyExternalForce(body, -1, forces_n[step], at, p.WORLD_FRAME, client)
            p.applyExternalTorque(body, -1, torques_n_m[step], p.WORLD_FRAME, client)

    watched = thrown(
        tmp_path,
        samples=samples,
        coordinates=coordinates,
        spin_rad_s=(3.0, 1.0, 2.0),
        before_step=push,
    )
    segments = segments_in(
        watched,
        pushes=Pushes(
            forces_n,
            torques_n_m,
            np.linalg.norm(forces_n, axis=1),
            np.linalg.norm(torques_n_m, axis=1),
        ),
    )
    pushed = forces_n.any(axis=1)
    assert first_unexplained(segments) is None
    assert (segments.code[pushed] == PUSHED).all()
    assert PUSHED not in segments.code[~pushed]
    assert (segments_in(watched).code[pushed] == UNEXPLAINED).all()


def test_a_call_begins_anew(tmp_path: Path) -> None:
    def throw(client: int, body: int, step: int) -> None:
        if step == 40:
            p.resetBaseVelocity(body, (0, 0, 3), (0, 0, 0), physicsClientId=client)

    watched = thrown(tmp_path, samples=80, height_m=5.0, before_step=throw)
    assert first_unexplained(segments_in(watched)) == 40
    placed = np.isin(np.arange(80), (0, 40))
    assert first_unexplained(segments_in(watched, placed=placed)) is None


# -- momentum --------------------------------------------------------------------------------------


def test_the_impulse_of_a_drop_is_what_it_takes(tmp_path: Path) -> None:
    """A box that ends at rest has received its weight's impulse, in total and per direction."""
    watched = thrown(tmp_path, samples=1200, restitution=0.3, linear_damping=0.0)
    balance = balance_in(watched)
    time_s = 1199 / 240
    assert balance.impulse_n_s[:, 2].sum() == pytest.approx(0.7 * 9.81 * time_s, rel=1e-4)
    # Lying, each step takes the weight of a step.
    assert balance.impulse_n_s[-1] == pytest.approx([0, 0, 0.7 * 9.81 / 240], rel=1e-3, abs=1e-6)


def balance_in(watched: Watched) -> Balance:
    return balance_of(
        motion_of(watched), law_behind(watched), touches_of(contacts_in(watched), watched.body)
    )


def test_the_part_that_pushes_has_the_opposite_force(tmp_path: Path) -> None:
    watched = thrown(tmp_path, spin_rad_s=(2.0, 0.0, 1.0))
    contacts = contacts_in(watched)
    on_body, on_floor = touches_of(contacts, watched.body), touches_of(contacts, 0)
    assert len(on_body.step) == len(on_floor.step) > 0
    assert (on_body.force_n == -on_floor.force_n).all()
    assert on_body.force_n[:, 2].max() > 0
    assert not len(touches_of(contacts, watched.body, link=3).step)


# -- flights ---------------------------------------------------------------------------------------


class Flight(NamedTuple):
    """Consecutive samples in flight, and the last sample's deviation from free fall."""

    first_step: int
    last_step: int
    error_m: Any
    terms_m: VectorTerms | None


def flights_in(watched: Watched) -> Iterator[Flight]:
    motion, law, segments = motion_of(watched), law_behind(watched), segments_in(watched)
    edges = np.diff(np.concatenate(([False], segments.code == FLIGHT, [False])).astype(int))
    starts, ends = np.flatnonzero(edges == 1) - 1, np.flatnonzero(edges == -1) - 1
    for first, last in zip(starts.tolist(), ends.tolist(), strict=True):
        start = motion.at(slice(first, first + 1))
        position_m = motion.position_m[last]
        error_m, terms_m = error_and_terms(start, position_m, law, steps=last - first)
        held = segments.held[first + 1 : last + 1].any()
        yield Flight(first, last, error_m, None if held else terms_m)


@pytest.mark.long
def test_every_flight_is_taken_apart_along_three_axes(tmp_path: Path) -> None:
    number = 0
    for watched in throws(tmp_path, 9, gravity_m_s2=-9.81):
        motion, dt = motion_of(watched), watched.how["timestep_s"]
        for flight in flights_in(watched):
            first, last = flight.first_step, flight.last_step
            t = (last - first) * dt
            free_m = motion.position_m[first] + motion.velocity_m_s[first] * t
            free_m[2] += -9.81 * t * t / 2
            error_m = motion.position_m[last] - free_m
            assert flight.error_m == pytest.approx(error_m, abs=1e-14 * (1 + abs(free_m).max()))
            terms = flight.terms_m
            if terms is None:
                flown = np.hstack((motion.velocity_m_s, motion.spin_rad_s))[first + 1 : last + 1]
                assert np.abs(flown).max() == 100
                continue
            parts = np.array(astuple(terms))
            left = np.abs(parts.sum(axis=0) - flight.error_m)
            largest = np.maximum(np.abs(parts).max(axis=0), np.abs(motion.position_m[last]))
            assert (left <= 4 * np.spacing(largest)).all()
            assert terms.timestep == pytest.approx((0, 0, -9.81 * t * dt / 2), rel=1e-14)
            assert np.abs(terms.rounding).max() < 1e-13 * (1 + abs(free_m).max())
            if law_behind(watched).linear_damping == 0:
                assert not np.any(terms.damping)
            number += 1
    assert number > THROWS


def test_the_damping_of_a_flight_is_that_of_ever_smaller_steps(tmp_path: Path) -> None:
    """The reference is the drag's displacement in PyBullet alone, extrapolated to zero timestep."""
    how: Any = {"velocity_m_s": (2.0, -1.0, 3.0), "height_m": 5.0, "gravity_m_s2": -9.81}
    ends = {
        (rate, damping): thrown(
            tmp_path, samples=rate // 4 + 1, timestep_s=1 / rate, linear_damping=damping, **how
        ).position_m[-1]
        for rate in (2000, 4000, 8000)
        for damping in (0.5, 0.0)
    }
    moved = [ends[rate, 0.5] - ends[rate, 0.0] for rate in (2000, 4000, 8000)]
    once = [2 * fine - coarse for coarse, fine in itertools.pairwise(moved)]
    limit = (4 * once[1] - once[0]) / 3
    watched = thrown(tmp_path, samples=61, linear_damping=0.5, **how)
    (flight,) = flights_in(watched)
    assert flight.terms_m is not None
    assert flight.terms_m.damping == pytest.approx(limit, rel=1e-8)


def test_a_flight_whose_velocity_is_held_has_no_terms(tmp_path: Path) -> None:
    watched = thrown(tmp_path, samples=60, height_m=90.0, velocity_m_s=(0.0, 0.0, -99.0))
    (flight,) = flights_in(watched)
    assert flight.terms_m is not None  # the drag wins, 4 m/s in a second
    watched = thrown(
        tmp_path, samples=60, height_m=90.0, velocity_m_s=(0.0, 0.0, -99.0), linear_damping=0.0
    )
    (flight,) = flights_in(watched)
    assert flight.terms_m is None
    assert flight.last_step == 59
