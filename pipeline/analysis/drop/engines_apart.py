"""The same drop in two engines: where they part, by how much, and which term of the error it is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pipeline.analysis.drop.case import Case
from pipeline.analysis.general.decomposition import TERMS
from pipeline.analysis.general.flights import taken_apart
from pipeline.fields import decimals
from pipeline.laws.base import Law, Motion
from pipeline.laws.bullet import BulletLaw
from pipeline.scenario import ENGINES

Float64 = NDArray[np.float64]

SHOWN = 1e-3
"""Share of the distance that a term must have to be named."""
REPLAYED = 100_000
"""Most steps of a law that are taken one after the other, to see where it leads."""


def apart(run: Case, golden: Case, *, parts_at: int | None) -> str:
    """Say how two engines differ that were given the same scenario.

    Parameters
    ----------
    run, golden
        The two drops, as many samples of the same timestep.
    parts_at
        The first sample that differs; None where none does.
    """
    names = [ENGINES[case.scenario.engine] for case in (run, golden)]
    touch = min(_first_touch(run), _first_touch(golden))
    if parts_at is None:
        return f"{names[0]} and {names[1]} agree to the bit"
    if parts_at >= touch:
        return (
            f"{names[0]} and {names[1]} agree to the bit until contact (step {touch}); from there "
            "on each has its own"
        )
    last = touch - 1
    said = f"{names[0]} and {names[1]} part at step {parts_at}"
    if last > parts_at and run.is_rigid and golden.is_rigid:
        said += f"; in the air, at {run.time_s[last]:.4g} s, {_distance(run, golden, last)}"
    advice = [_undamped(one, other, last) for one, other in ((run, golden), (golden, run))]
    return "; ".join([said, *filter(None, advice)])


def _first_touch(case: Case) -> int:
    """Return the first sample that a contact has led to; the number of samples without any."""
    steps = case.contacts.step
    return int(steps[0]) if len(steps) else len(case.samples)


def _distance(run: Case, golden: Case, last: int) -> str:
    """Say how far apart they are along z, and by which terms of their errors."""
    heights_m = [float(case.samples.height_m[last]) for case in (run, golden)]
    apart_m = heights_m[0] - heights_m[1]
    said = f"they are {decimals(apart_m * 1e3, 4, '+')} mm apart"
    parts = []
    for case in (run, golden):
        start = case.samples.at(slice(0, 1))
        _, terms = taken_apart(start, case.samples.position_m[last], case.law, steps=last)
        parts.append(terms)
    if None in parts:
        return said
    terms_m = {name: getattr(parts[0], name)[2] - getattr(parts[1], name)[2] for name in TERMS}
    named = [
        f"{name} {decimals(value_m * 1e3, 4, '+')}"
        for name, value_m in terms_m.items()
        if abs(value_m) > SHOWN * abs(apart_m)
    ]
    return f"{said}: {', '.join(named)}" if named else said


def _undamped(case: Case, other: Case, last: int) -> str | None:
    """Say what Bullet would do without its damping, where that is what the other engine does."""
    law = case.law
    if not isinstance(law, BulletLaw) or not (law.linear_damping or law.angular_damping):
        return None
    if last > REPLAYED:
        return None
    undamped = replace(law, linear_damping=0.0, angular_damping=0.0)
    off_m = float(
        np.abs(_path_m(undamped, case, last) - other.samples.position_m[: last + 1]).max()
    )
    options = ["--linear-damping 0"] if law.linear_damping else []
    spins = case.samples.spin_rad_s[: last + 1].any()
    options += ["--angular-damping 0"] if law.angular_damping and spins else []
    told = f"drop it in PyBullet with {' '.join(options)}"
    if off_m == 0:
        return f"{told} and they agree to the bit until contact"
    if off_m < 1e-9:
        return f"{told} and they agree to {off_m:.1g} m until contact"
    return None


def _path_m(law: Law, case: Case, last: int) -> Float64:
    """Return where a law leads from the release, step by step [m], shape (last + 1, 3)."""
    motion: Motion = case.samples.at(slice(0, 1))
    found = [motion.position_m[0]]
    for _ in range(last):
        motion = law.step(motion)
        found.append(motion.position_m[0])
    return np.array(found)
