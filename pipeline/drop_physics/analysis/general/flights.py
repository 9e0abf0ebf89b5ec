"""Every flight of a body is a drop of its own, with a theory that starts at its first sample."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drop_physics.analysis.general.decomposition import TERMS, Decomposition, decompose
from drop_physics.analysis.general.segments import FLIGHT, Segments
from drop_physics.laws.base import Law, Motion
from drop_physics.laws.theory import Fall

Float64 = NDArray[np.float64]
Vector = tuple[float, float, float]


STIFF = 1e3
"""How often drag could stop a throw within its flight: beyond, integrating it never ends."""


@dataclass(frozen=True)
class VectorTerms:
    """The four terms of an error along x, y and z [m]; they add up to it."""

    timestep: Vector
    """Error of semi-implicit Euler without damping."""
    damping: Vector
    """Effect of damping in continuous time."""
    interaction: Vector
    """Interaction of the two."""
    rounding: Vector
    """Rounding of double precision."""


@dataclass(frozen=True)
class Flight:
    """Consecutive samples in which a body touches nothing and follows the law, as after a bounce.

    Its theory starts from the position and the velocity of its first sample, and has no floor.
    """

    first_step: int
    """The sample that it starts from: a release, or the last before the flight."""
    last_step: int
    """The last sample that the law of flight led to."""
    start_s: float
    """Time of the first sample."""
    end_s: float
    """Time of the last sample."""
    error_m: Vector
    """Simulated minus free fall at the last sample: x, y, z."""
    terms_m: VectorTerms | None
    """Its terms; None if a velocity was clamped to the engine's limit, which no theory has."""


def start_of(motion: Motion, sample: int, law: Law) -> Fall:
    """Return the fall that begins at a sample."""
    return Fall(
        position_m=_vector(motion.position_m[sample]),
        velocity_m_s=_vector(motion.velocity_m_s[sample]),
        gravity_m_s2=law.gravity_m_s2[2],
        drag=law.drag,
    )


def decomposed(
    motion: Motion,
    law: Law,
    segments: Segments,
    *,
    release: Fall | None = None,
    at_least: int = 0,
) -> tuple[list[Flight], Decomposition]:
    """Return all flights, and the errors of the first samples broken down as those of a fall.

    That fall begins with `release`, as it was asked for, or with the first sample: an engine in
    single precision rounds the release, and the terms of each sample include that rounding. At
    least `at_least` samples are broken down; where the body begins in flight, all of that flight,
    so that exact arithmetic, which is slow, is done once.
    """
    runs = [(first - 1, last) for first, last in segments.runs(FLIGHT) if first]
    first_sample = start_of(motion, 0, law)
    release = release or first_sample
    begins = bool(runs) and runs[0][0] == 0 and release == first_sample
    samples = max(at_least, runs[0][1] + 1) if begins else at_least
    parts = decompose(law, release, motion.position_m[:samples])
    flights = [
        _flight(
            motion,
            law,
            first,
            last,
            parts=parts if begins and first == 0 else None,
            held=bool(segments.held[first + 1 : last + 1].any()),
        )
        for first, last in runs
    ]
    return flights, parts


def _flight(
    motion: Motion, law: Law, first: int, last: int, *, parts: Decomposition | None, held: bool
) -> Flight:
    if parts is None:
        error_m, terms_m = error_and_terms(
            motion.at(slice(first, first + 1)), motion.position_m[last], law, steps=last - first
        )
    else:
        error_m, terms_m = _row(parts, last)
    return Flight(
        first_step=first,
        last_step=last,
        start_s=first * law.timestep_s,
        end_s=last * law.timestep_s,
        error_m=error_m,
        terms_m=None if held else terms_m,
    )


def error_and_terms(
    start: Motion, position_m: Float64, law: Law, *, steps: int
) -> tuple[Vector, VectorTerms | None]:
    """Return the error of a flight after some steps, and its terms [m].

    Parameters
    ----------
    start
        The sample that it starts from.
    position_m
        Where the body is after these steps, shape (3,).
    law
        Its law. Where gravity is not along z, or the drag of a throw is `STIFF`, there are none.
    steps
        At least 1.
    """
    time_s, velocity_m_s = steps * law.timestep_s, start.velocity_m_s[0]
    stops = law.drag.quadratic_per_m * float(np.linalg.norm(velocity_m_s)) * time_s
    if any(law.gravity_m_s2[:2]) or (velocity_m_s[:2].any() and stops > STIFF):
        g = np.array(law.gravity_m_s2)
        free_fall_m = start.position_m[0] + (start.velocity_m_s[0] + g * time_s / 2) * time_s
        return _vector(position_m - free_fall_m), None
    return _row(decompose(law, start_of(start, 0, law), position_m[None], first=steps), 0)


def _row(parts: Decomposition, row: int) -> tuple[Vector, VectorTerms]:
    terms = (_vector(getattr(parts, f"{name}_m")[row]) for name in TERMS)
    return _vector(parts.total_m[row]), VectorTerms(*terms)


def _vector(values: Float64) -> Vector:
    x, y, z = values.tolist()
    return x, y, z
