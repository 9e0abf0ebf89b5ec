"""Findings of contact: what is inside what, what gains energy, what is too light for its load."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from pipeline.analysis.script.evidence import Evidence
from pipeline.analysis.script.results import ScriptContact, ScriptFinding
from pipeline.fields import decimals

DEEP = 0.1
"""Share of a part's smallest edge that another may be inside it before it is worth reporting."""
OVERLAP_M = 1e-3
"""What is deeper than that in something else when it comes does not just touch it."""
GAINED = 0.05
"""Share of its energy of motion that contact may give to a body before it is worth reporting."""
SLOW_M_S = 0.1
"""What leaves a body slower has not given it much."""
HEAVIER = 100.0
"""Ratio of masses beyond which Bullet's solver gives way."""


def findings(e: Evidence) -> Iterator[ScriptFinding]:
    """Yield them, the gravest first."""
    yield from _starts(e)
    yield from _deep(e)
    yield from _gained(e)
    yield from _mass_ratio(e)


def _starts(e: Evidence) -> Iterator[ScriptFinding]:
    """Yield what was in something else, or in itself, when it came; the deepest of each body."""
    came = {number: told.came[-1].at.step for number, told in e.seen.by_body.items()}
    contacts = e.contacts
    for number, step in came.items():
        its = (contacts.body_a == number) | (contacts.body_b == number)
        its &= (contacts.step == step + 1) & (contacts.distance_m < -OVERLAP_M)
        for itself in (True, False):
            rows = np.flatnonzero(its & ((contacts.body_a == contacts.body_b) == itself)).tolist()
            # What came last of two is what was put into the other.
            rows = [row for row in rows if itself or _later(e, came, number, row)]
            if not rows:
                continue
            row = min(rows, key=lambda one: float(contacts.distance_m[one]))
            depth_mm = -contacts.distance_m[row] * 1e3
            mine, other = _sides(e, row, number)
            if itself:
                yield e.finding(
                    "self-collision",
                    f"is in collision with itself when it comes: {mine} and {other} are "
                    f"{decimals(depth_mm, 1)} mm in each other, and are pushed apart; load it "
                    "without URDF_USE_SELF_COLLISION, or p.setCollisionFilterPair(…, 0)",
                    body=number,
                    step=step,
                )
            else:
                yield e.finding(
                    "starts-in-contact",
                    f"is {decimals(depth_mm, 1)} mm inside {other} when it comes, and is pushed "
                    "out; place it higher, or farther away",
                    body=number,
                    step=step,
                )


def _later(e: Evidence, came: dict[int, int], number: int, row: int) -> bool:
    pair = {int(e.contacts.body_a[row]), int(e.contacts.body_b[row])}
    (other,) = pair - {number} or {number}
    moves = other in e.judged
    return (number in e.judged, came.get(number, 0), number) > (moves, came.get(other, 0), other)


def _sides(e: Evidence, row: int, number: int) -> tuple[str, str]:
    contacts = e.contacts
    sides = [
        (int(contacts.body_a[row]), int(contacts.link_a[row])),
        (int(contacts.body_b[row]), int(contacts.link_b[row])),
    ]
    mine, other = sides if sides[0][0] == number else reversed(sides)
    return e.label(*mine), e.label(*other)


def _deep(e: Evidence) -> Iterator[ScriptFinding]:
    """Yield the deepest contact of all, but for what was deep from its first step on."""
    contacts, (pair_of, pairs) = e.contacts, e.pairs
    told = e.seen.by_body.values()
    began = {came.at.step + 1 for one in told for came in one.came}
    began |= {put.at.step + 1 for one in told for put in one.puts}
    deep_m = np.maximum(-contacts.distance_m, 0.0)
    starts = np.isin(contacts.step, list(began)) & (deep_m > OVERLAP_M)
    thin_m = np.array([_thinner_m(e, pair) for pair in pairs])
    thin_m[np.unique(pair_of[starts])] = np.inf
    share = deep_m / thin_m[pair_of]
    if not len(share) or share.max() <= DEEP:
        return
    row = int(np.argmax(share))
    step = int(contacts.step[row])
    mine, other = _sides(e, row, int(contacts.body_a[row]))
    way_m = _approach_m(e, row)
    cause = (
        "Bullet takes out only a part of the depth in each step; use a smaller timestep with "
        "p.setTimeStep"
    )
    if _springs(e, row):
        cause = "their contact gives way like a spring; give p.changeDynamics more contactStiffness"
    elif way_m >= deep_m[row] / 2:
        cause = (
            f"they approach each other by {way_m * 1e3:.4g} mm in a step, and what meets within "
            "one is found when it is inside; use a smaller timestep with p.setTimeStep"
        )
    yield e.finding(
        "deep-penetration",
        f"{mine} and {other} are {decimals(deep_m[row] * 1e3, 2)} mm in each other at step {step}, "
        f"{share[row]:.0%} of the thinner one: {cause}",
        step=step,
    )


def _springs(e: Evidence, row: int) -> bool:
    """Whether one side of a contact was given a stiffness."""
    sides = int(e.contacts.body_a[row]), int(e.contacts.body_b[row])
    return any(
        (np.nan_to_num(told.reported["contact_stiffness"], nan=-1.0) >= 0).any()
        for body in sides
        for told in e.dynamics_of(body)
    )


def _thinner_m(e: Evidence, pair: list[int]) -> float:
    """Return the smallest edge of two parts that can move [m]; the ground may be a thin sheet."""
    parts = [part for part in (pair[:2], pair[2:]) if e.mass_kg(*part) > 0]
    edges = [e.extents_m(*part) for part in parts]
    return min((float(one.min()) for one in edges if one is not None), default=math.inf)


def _approach_m(e: Evidence, row: int) -> float:
    """Return how far two bodies came closer in the step before a contact, or the step of it [m].

    0 where one has joints: which of its links moved how is not asked here.
    """
    contacts, ways_m = e.contacts, np.zeros((2, 3))
    for body, sign in ((int(contacts.body_a[row]), -1), (int(contacts.body_b[row]), 1)):
        judged = e.judged.get(body)
        if judged is None:
            continue
        if judged.track.body.joints:
            return 0.0
        steps = judged.track.steps
        for number in range(2):
            at = int(np.searchsorted(steps, contacts.step[row] - number))
            if at < len(steps) and judged.track.led[at]:
                track = judged.track
                ways_m[number] += sign * (track.motion.position_m[at] - track.before.position_m[at])
    return float((ways_m @ contacts.normal[row]).max())


def _gained(e: Evidence) -> Iterator[ScriptFinding]:
    for body in e.bodies:
        judged = e.judged.get(body.id)
        if judged is None or judged.track.body.joints:
            continue
        track = judged.track
        for contact in body.contacts:
            if not all(_stands(e, one.id) for one in contact.by):
                continue
            first = int(np.searchsorted(track.steps, contact.first_step))
            last = int(np.searchsorted(track.steps, contact.last_step))
            law = judged.law_at(first)
            if law is None:
                continue
            # With what the weight does on the way: what is left is what contact has given.
            height_m = track.motion.position_m[last] - track.before.position_m[first]
            weight_j = law.mass_kg * float(np.dot(law.gravity_m_s2, height_m))
            before_j = judged.kinetic_j(first, before=True)
            after_j = judged.kinetic_j(last, before=False)
            gained_j = after_j - before_j - weight_j
            least_j = max(GAINED * before_j, law.mass_kg * SLOW_M_S**2 / 2)
            if gained_j > least_j and after_j > before_j + least_j:
                yield _gain(e, body.id, contact, gained_j, before_j)
                break


def _gain(
    e: Evidence, body: int, contact: ScriptContact, gained_j: float, before_j: float
) -> ScriptFinding:
    others = ", ".join(sorted({one.body for one in contact.by}))
    restitutions = [_restitution(e, body), *(_restitution(e, one.id) for one in contact.by)]
    told = e.seen.by_body[body]
    began = {at.step + 1 for at in [one.at for one in told.came] + [one.at for one in told.puts]}
    placed = "place it outside, or " if contact.first_step in began else ""
    # A smaller timestep is no help: out of the same depth it pushes faster.
    cause = (
        "the engine pushes what is inside something out of it again, and that leaves it faster; "
        f"{placed}call p.setPhysicsEngineParameter(contactERP=0)"
    )
    if restitutions[0] * max(restitutions[1:]) > 1:
        cause = "their restitutions multiply to more than 1; give one of them a smaller one"
    return e.finding(
        "energy-gained",
        f"gains {gained_j:.3g} J from contact with {others} between {contact.start_s:.4g} s and "
        f"{contact.end_s:.4g} s, having {before_j:.3g} J of motion before, and nothing pushed it: "
        f"{cause}",
        body=body,
        step=contact.first_step,
    )


def _restitution(e: Evidence, body: int) -> float:
    told = e.dynamics_of(body)
    return float(np.nan_to_num(told[-1].reported["restitution"][0])) if told else 0.0


def _stands(e: Evidence, body: int) -> bool:
    """Whether a body neither moves nor was moved: it has no energy to give."""
    return body in e.seen.bodies and body not in e.judged and body not in e.set_bodies


def _mass_ratio(e: Evidence) -> Iterator[ScriptFinding]:
    contacts, (pair_of, pairs) = e.contacts, e.pairs
    ratios = np.array([_ratio(e, pair) for pair in pairs])
    found = np.where(contacts.normal_force_n > 0, ratios[pair_of] if len(pairs) else 0.0, 0.0)
    if not len(found) or found.max() <= HEAVIER:
        return
    row = int(np.argmax(found))
    mine, other = _sides(e, row, int(contacts.body_a[row]))
    yield e.finding(
        "mass-ratio",
        f"{mine} and {other} touch, and one is {found[row]:.4g} times as heavy as the other: "
        "Bullet's solver takes many iterations to agree on their forces; keep within 1:100, or "
        "raise numSolverIterations",
        step=int(contacts.step[row]),
    )


def _ratio(e: Evidence, pair: list[int]) -> float:
    """Return how many times one part is as heavy as the other; 0 where one does not move."""
    masses = e.mass_kg(pair[0], pair[1]), e.mass_kg(pair[2], pair[3])
    return max(masses) / min(masses) if min(masses) > 0 and pair[0] != pair[2] else 0.0
