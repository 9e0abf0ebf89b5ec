"""Softness (`solref`, `solimp`) and friction of a model's equality constraints and contacts."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drop_physics.engines.mujoco.described import WRAPS_JOINT, WRAPS_SITE, DescribedModel, xyzw
from drop_physics.physics.rotations import products, rotate_inverse
from drop_physics.physics.tree import BASE
from drop_physics.trace.events import At, Equality

Arrays = Mapping[str, NDArray[Any]]
Numbers = tuple[float, ...]

KINDS = {0: "connect", 1: "weld", 2: "joint", 3: "tendon"}
"""Types of equalities between bodies, joints and tendons (`mjtEq`)."""
WELD, OF_JOINTS, OF_TENDONS = 1, 2, 3
RELATIVE, TORQUE_SCALE = slice(6, 10), 10
"""Indices in a weld's data of the second body's orientation relative to the first, and of the
torque scale, which is 0 if the weld leaves rotation free."""
IDENTITY = (0.0, 0.0, 0.0, 1.0)
OF_BODY, OF_SITE = 1, 6
"""Types of objects that an equality joins (`mjtObj`)."""
OVERRIDES = 1
"""The bit of `opt.enableflags` that makes the options' softness apply to all contacts."""


def equalities_of(described: DescribedModel, client: int) -> Iterator[Equality]:
    """Yield the equality constraints between bodies, between joints, and between tendons."""
    arrays = described.arrays
    for number in range(len(np.atleast_1d(arrays.get("eq_type", ())))):
        which = int(arrays["eq_type"][number])
        of = int(arrays["eq_objtype"][number]) if "eq_objtype" in arrays else OF_BODY
        ids = [int(arrays[f"eq_obj{side}id"][number]) for side in (1, 2)]
        if which == OF_JOINTS:
            found = _of_joints(described, number, ids)
        elif which == OF_TENDONS:
            found = _of_tendons(described, number, ids)
        elif which in KINDS and of in (OF_BODY, OF_SITE):
            found = _of_bodies(described, number, ids, which, sites=of == OF_SITE)
        else:
            continue
        if found is not None:
            yield Equality(
                At(0, 0.0, number),
                client,
                described.names["eq"][number],
                KINDS[which],
                solref=_numbers(arrays["eq_solref"][number]),
                active=bool(arrays["eq_active0"][number]),
                **found,
            )


def _of_bodies(
    described: DescribedModel, number: int, ids: list[int], which: int, *, sites: bool
) -> dict[str, Any] | None:
    """Return the equality constraint between two bodies or sites (`mj_instantiateEquality`)."""
    arrays, data = described.arrays, described.arrays["eq_data"][number]
    bodies = [int(arrays["site_bodyid"][each]) for each in ids] if sites else ids
    if not all(each in described.link_of for each in bodies):
        return None
    (body_a, link_a), (body_b, link_b) = (described.link_of[each] for each in bodies)
    anchors = []
    for side, (body, of) in enumerate(zip(bodies, ids, strict=True)):
        if sites:
            point = arrays["site_pos"][of]
        else:  # a weld has the second body's anchor first
            at = 3 * (1 - side if which == WELD else side)
            point = data[at : at + 3]
        anchors.append(_from_centre(arrays, body, point))
    turned: list[NDArray[Any]] = []
    if which == WELD and data[TORQUE_SCALE] and sites:
        turned = [xyzw(arrays["site_quat"][of]) for of in ids]
    elif which == WELD and data[TORQUE_SCALE]:  # one is to stand in the first body as the second
        turned = [xyzw(data[RELATIVE]), np.array(IDENTITY)]
    return {
        "body_a": body_a,
        "link_a": link_a,
        "body_b": body_b,
        "link_b": link_b,
        "anchors_m": tuple(anchors),
        "orientations": tuple(
            _in_inertial_axes(arrays, *each) for each in zip(bodies, turned, strict=False)
        ),
        "of_world": (bodies[0] == 0, bodies[1] == 0),
    }


def _of_joints(described: DescribedModel, number: int, ids: list[int]) -> dict[str, Any] | None:
    """Return the equality constraint between two joints; None if a joint is not recorded."""
    arrays = described.arrays
    ids, coefficients = _coupled(arrays, number, ids)
    places = {
        link.joint: (made.body.number, index)
        for made in described.bodies
        for index, link in enumerate(made.links, BASE)
        if link.joint >= 0
    }
    if not all(each in places for each in ids):
        return None
    (body_a, link_a), (body_b, link_b) = (places[each] for each in ids)
    starts = [int(arrays["jnt_qposadr"][each]) for each in ids]
    return {
        "body_a": body_a,
        "link_a": link_a,
        "body_b": body_b,
        "link_b": link_b,
        "coefficients": coefficients,
        "rest": _numbers(np.asarray(arrays["qpos0"])[starts]),
    }


def _of_tendons(described: DescribedModel, number: int, ids: list[int]) -> dict[str, Any] | None:
    """Return the coupling between two tendons; None if one begins at an unknown body."""
    arrays = described.arrays
    ids, coefficients = _coupled(arrays, number, ids)
    begins = [_begins(arrays, tendon) for tendon in ids]
    if not all(body in described.link_of for body in begins):
        return None
    (body_a, link_a), (body_b, link_b) = (described.link_of[body] for body in begins)
    return {
        "body_a": body_a,
        "link_a": link_a,
        "body_b": body_b,
        "link_b": link_b,
        "coefficients": coefficients,
        "rest": _numbers(np.ravel(arrays["tendon_length0"])[ids]),
        "tendons": tuple(described.names["tendon"][tendon] for tendon in ids),
    }


def _coupled(arrays: Arrays, number: int, ids: list[int]) -> tuple[list[int], Numbers]:
    """Return both joints or tendons of a coupling, and its coefficients.

    An equality of a single joint or tendon holds its value constant: it is returned as both.
    """
    coefficients = _numbers(arrays["eq_data"][number][:5])
    return (ids, coefficients) if ids[1] >= 0 else ([ids[0]] * 2, coefficients[:1])


def _begins(arrays: Arrays, tendon: int) -> int:
    """Return the body of a tendon's first joint or site; -1 if it begins at neither."""
    first = int(np.ravel(arrays["tendon_adr"])[tendon])
    kind, of = (int(np.ravel(arrays[f"wrap_{each}"])[first]) for each in ("type", "objid"))
    on = {WRAPS_JOINT: "jnt_bodyid", WRAPS_SITE: "site_bodyid"}.get(kind)
    return -1 if on is None else int(np.ravel(arrays[on])[of])


def _in_inertial_axes(arrays: Arrays, body: int, turned: NDArray[Any]) -> Numbers:
    """Return an orientation of a body's frame relative to its inertial axes."""
    axes = np.array(IDENTITY) if body == 0 else xyzw(arrays["body_iquat"][body])
    return _numbers(products(axes[None] * [-1, -1, -1, 1], turned[None])[0])


def _from_centre(arrays: Arrays, body: int, point_m: NDArray[Any]) -> Numbers:
    """Return a point of a body relative to its centre of mass, in its inertial axes."""
    if body == 0:
        return _numbers(point_m)
    axes = xyzw(arrays["body_iquat"][body])
    arm = np.asarray(point_m, np.float64) - arrays["body_ipos"][body]
    return _numbers(rotate_inverse(axes[None], arm[None])[0])


def softness_of(arrays: Arrays, first: int, second: int) -> tuple[Numbers, Numbers]:
    """Return `solref` and `solimp` for a contact between two geoms (`mj_contactParam`).

    A `<pair>` of both comes first, then the geom of higher priority, else both are weighted by
    `solmix`; of two `solref` of which one is a stiffness, the lower counts.
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
    """Return `condim` and the rolling friction coefficient for two geoms (`mj_contactParam`).

    A `<pair>` of both comes first, then the geom of higher priority, else the larger value.
    """
    for pair in _pairs_of(arrays, first, second):
        return int(arrays["pair_dim"][pair]), float(arrays["pair_friction"][pair, 3])
    rank = [int(arrays["geom_priority"][geom]) for geom in (first, second)]
    geoms = [geom for geom in (first, second) if arrays["geom_priority"][geom] == max(rank)]
    condim, friction = (arrays[f"geom_{name}"][geoms] for name in ("condim", "friction"))
    return int(condim.max()), float(friction[:, 2].max())


def _pairs_of(arrays: Arrays, first: int, second: int) -> list[int]:
    """Return the indices of the `<pair>`s that name two geoms."""
    named = np.sort([arrays.get(f"pair_geom{side}", []) for side in (1, 2)], axis=0)
    meant = np.sort([[first], [second]], axis=0)
    return np.flatnonzero((named == meant).all(axis=0)).tolist()


def _numbers(values: NDArray[Any]) -> Numbers:
    return tuple(np.asarray(values, np.float64).round(12).tolist())
