"""How soft a MuJoCo model holds things apart or together: equalities, and contacts of two geoms."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drop_physics.engines.mujoco.described import DescribedModel
from drop_physics.trace.events import At, Equality

Arrays = Mapping[str, NDArray[Any]]
Numbers = tuple[float, ...]

KINDS = {0: "connect", 1: "weld"}
"""Kinds of equalities between bodies (`mjtEq`)."""
BODY, SITE = 1, 6
"""Kinds of things that an equality joins (`mjtObj`)."""
OVERRIDES = 1
"""The bit of `opt.enableflags` by which all contacts are as soft as the options say."""


def equalities_of(described: DescribedModel, client: int) -> Iterator[Equality]:
    """Yield the equalities between bodies."""
    arrays = described.arrays
    for number in range(len(np.atleast_1d(arrays.get("eq_type", ())))):
        kind = KINDS.get(int(arrays["eq_type"][number]))
        of = int(arrays["eq_objtype"][number]) if "eq_objtype" in arrays else BODY
        if kind is None or of not in (BODY, SITE):
            continue
        both = [int(arrays[f"eq_obj{side}id"][number]) for side in (1, 2)]
        if of == SITE:
            both = [int(arrays["site_bodyid"][site]) for site in both]
        if not all(each in described.link_of for each in both):
            continue
        (body_a, link_a), (body_b, link_b) = (described.link_of[each] for each in both)
        yield Equality(
            At(0, 0.0, number),
            client,
            described.names["eq"][number],
            kind,
            body_a,
            link_a,
            body_b,
            link_b,
            _numbers(arrays["eq_solref"][number]),
            active=bool(arrays["eq_active0"][number]),
        )


def softness_of(arrays: Arrays, first: int, second: int) -> tuple[Numbers, Numbers]:
    """Return `solref` and `solimp` of a contact of two geoms (`mj_contactParam`).

    Those of a `<pair>` of both, or of the geom of higher priority, else both weighted by `solmix`;
    of two `solref` of which one is a stiffness, the lower.
    """
    if int(np.ravel(arrays.get("opt.enableflags", 0))[0]) & OVERRIDES:
        return _numbers(arrays["opt.o_solref"]), _numbers(arrays["opt.o_solimp"])
    for pair in _pairs_of(arrays, first, second):
        return _numbers(arrays["pair_solref"][pair]), _numbers(arrays["pair_solimp"][pair])
    both = first, second
    rank = [int(arrays["geom_priority"][geom]) for geom in both]
    refs, imps, mixes = (
        [np.asarray(arrays[f"geom_{name}"][geom], np.float64) for geom in both]
        for name in ("solref", "solimp", "solmix")
    )
    if rank[0] != rank[1]:
        one = int(rank[1] > rank[0])
        return _numbers(refs[one]), _numbers(imps[one])
    total = float(mixes[0] + mixes[1])
    share = float(mixes[0]) / total if total > 0 else 0.5
    ref = share * refs[0] + (1 - share) * refs[1]
    if refs[0][0] <= 0 or refs[1][0] <= 0:
        ref = np.minimum(refs[0], refs[1])
    return _numbers(ref), _numbers(share * imps[0] + (1 - share) * imps[1])


def friction_of(arrays: Arrays, first: int, second: int) -> tuple[int, float]:
    """Return `condim` and the coefficient of rolling friction of two geoms (`mj_contactParam`).

    Those of a `<pair>` of both, or of the geom of higher priority, else the larger of both.
    """
    for pair in _pairs_of(arrays, first, second):
        return int(arrays["pair_dim"][pair]), float(arrays["pair_friction"][pair, 3])
    rank = [int(arrays["geom_priority"][geom]) for geom in (first, second)]
    geoms = [geom for geom in (first, second) if arrays["geom_priority"][geom] == max(rank)]
    condim, friction = (arrays[f"geom_{name}"][geoms] for name in ("condim", "friction"))
    return int(condim.max()), float(friction[:, 2].max())


def _pairs_of(arrays: Arrays, first: int, second: int) -> list[int]:
    """Return the numbers of the `<pair>`s that name two geoms."""
    named = np.sort([arrays.get(f"pair_geom{side}", []) for side in (1, 2)], axis=0)
    meant = np.sort([[first], [second]], axis=0)
    return np.flatnonzero((named == meant).all(axis=0)).tolist()


def _numbers(values: NDArray[Any]) -> Numbers:
    return tuple(np.asarray(values, np.float64).round(12).tolist())
