"""Findings on contact: bodies inside each other, energy gained, masses too different."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from drop_physics.analysis.general.contacts import NORMAL, ON_A, ON_B
from drop_physics.analysis.script.evidence import OVERLAP_M, Evidence, first_steps, start_of
from drop_physics.analysis.script.judged import can_step, has_inverse
from drop_physics.analysis.script.results import ScriptContact, ScriptFinding
from drop_physics.fields import decimals
from drop_physics.laws.bullet_contact import (
    CONTACT_ERP,
    CONTACT_SLOP_M,
    RESTITUTION_THRESHOLD_M_S,
)
from drop_physics.messages import Message

DEEP = 0.1
"""Share of a part's smallest edge that may overlap another before it is worth reporting."""
GAINED = 0.05
"""Share of its kinetic energy that a body may gain from contact before it is worth reporting."""
SLOW_M_S = 0.1
"""A contact gives little energy to a body that leaves it slower than this."""
AGREES = 0.1
"""Share of a speed or a depth by which its explanation may miss it."""
HEAVIER = 100.0
"""Ratio of masses beyond which Bullet's solver does not converge in time."""


def findings(e: Evidence) -> Iterator[ScriptFinding]:
    """Yield them, the gravest first."""
    yield from _starts(e)
    yield from _deep(e)
    yield from _gained(e)
    yield from _mass_ratio(e)


def _starts(e: Evidence) -> Iterator[ScriptFinding]:
    """Yield bodies that overlap something, or themselves, at first; the deepest of each."""
    came = {number: record.came[-1].at.step for number, record in e.seen.by_body.items()}
    contacts = e.contacts
    begins = np.isin(contacts.step, [step + 1 for step in came.values()])
    deep = np.flatnonzero(begins & (contacts.distance_m < -OVERLAP_M))
    for number, step in came.items():
        its = deep[contacts.step[deep] == step + 1]
        its = its[(contacts.body_a[its] == number) | (contacts.body_b[its] == number)]
        for itself in (True, False):
            rows = its[(contacts.body_a[its] == contacts.body_b[its]) == itself].tolist()
            # Of two bodies, the later one was put into the other; nothing moves two fixed ones.
            rows = [row for row in rows if itself or _later(e, came, number, row)]
            rows = [row for row in rows if {side[0] for side in e.sides(row)} & e.judged.keys()]
            if not rows:
                continue
            row = min(rows, key=lambda row: float(contacts.distance_m[row]))
            depth_mm = decimals(-contacts.distance_m[row] * 1e3, 1)
            mine, other = _sides(e, row, number)
            if itself:
                message = Message(
                    "{body} collides with itself at its first step: {mine} and {other} overlap by "
                    "{depth} mm; load it without URDF_USE_SELF_COLLISION, or call "
                    "p.setCollisionFilterPair(…, 0)",
                    body=e.label(number),
                    mine=mine,
                    other=other,
                    depth=depth_mm,
                )
                yield e.finding("self-collision", message, body=number, step=step)
            else:
                message = Message(
                    "{body} is {depth} mm inside {other} at its first step; place it higher, or "
                    "farther away",
                    body=e.label(number),
                    depth=depth_mm,
                    other=other,
                )
                yield e.finding("starts-in-contact", message, body=number, step=step)


def _later(e: Evidence, came: dict[int, int], number: int, row: int) -> bool:
    pair = {int(e.contacts.body_a[row]), int(e.contacts.body_b[row])}
    (other,) = pair - {number} or {number}
    moves = other in e.judged
    return (number in e.judged, came.get(number, 0), number) > (moves, came.get(other, 0), other)


def _sides(e: Evidence, row: int, number: int) -> tuple[str, str]:
    sides = e.sides(row)
    mine, other = sides if sides[0][0] == number else reversed(sides)
    return e.label(*mine), e.label(*other)


def _deep(e: Evidence) -> Iterator[ScriptFinding]:
    """Yield the deepest contact of all, except those that were deep from their first step on."""
    contacts, (pair_of, pairs) = e.contacts, e.pairs
    began = set().union(*map(first_steps, e.seen.by_body.values()))
    deep_m = np.maximum(-contacts.distance_m, 0.0)
    starts = np.isin(contacts.step, list(began)) & (deep_m > OVERLAP_M)
    known = {e.sides(pairs[pair]) for pair in np.unique(pair_of[starts])}
    thin_m = np.array(
        [math.inf if e.sides(point) in known else _thinner_m(e, point) for point in pairs]
    )
    share = deep_m / thin_m[pair_of]
    if not len(share) or share.max() <= DEEP:
        return
    row = int(np.argmax(share))
    step = int(contacts.step[row])
    mine, other = _sides(e, row, int(contacts.body_a[row]))
    message = Message(
        "{mine} and {other} overlap by {depth} mm at step {step}, {share:.0%} of the thinner one",
        mine=mine,
        other=other,
        depth=decimals(deep_m[row] * 1e3, 2),
        step=step,
        share=share[row],
    )
    yield e.finding("deep-penetration", _because(message, _cause_of_depth(e, row)), step=step)


def _because(seen: Message, cause: Message | None) -> Message:
    """Return what was seen, and its cause where what was recorded implies one."""
    return seen if cause is None else Message("{seen}: {cause}", seen=seen, cause=cause)


def _cause_of_depth(e: Evidence, row: int) -> Message | None:
    """Return the cause of a deep contact: both came that far in a step, or a spring gave way."""
    contacts, (pair_of, pairs), springs = e.contacts, e.pairs, _springs(e, row)
    same = [number for number, point in enumerate(pairs) if e.sides(point) == e.sides(row)]
    parting = _parting(e, row)
    if parting is None:
        return None
    depth_m, step = -contacts.distance_m[row], contacts.step[row]
    overlaps = np.isin(pair_of, same) & (contacts.distance_m < 0)
    steps = np.unique(contacts.step[overlaps & (contacts.step <= step)])
    steps = steps[np.flatnonzero(np.diff(steps, prepend=-2) > 1)[-1] :]
    way_m = -parting.before_m_s * parting.step_s
    if len(steps) == 1 and way_m >= (1 - AGREES) * depth_m:
        cause = Message(
            "they approach each other by {way:.4g} mm in a step, and contact within a step is "
            "detected only once they overlap",
            way=way_m * 1e3,
        )
        # A spring may let them as deep in smaller steps, and a constraint pull them together.
        joined = any(e.seen.by_body[body].constraints for body, _ in e.sides(row))
        advice = Message("{cause}; use a smaller timestep with p.setTimeStep", cause=cause)
        return cause if springs or joined else advice
    resisted = np.isin(steps, contacts.step[overlaps & (contacts.normal_force_n > 0)])
    began_m = -contacts.distance_m[overlaps & (contacts.step == steps[0])].min()
    slow = abs(way_m) <= AGREES * depth_m
    if springs and resisted.all() and slow and began_m <= depth_m / 2:
        return Message("their contact is a spring; give p.changeDynamics more contactStiffness")
    return None


def _springs(e: Evidence, row: int) -> bool:
    """Whether one side of a contact was given a stiffness."""
    at = start_of(int(e.contacts.step[row]))
    return any(
        e.reported("contact_stiffness", *part, at) >= 0
        or e.given(("contactStiffness", "contactDamping"), *part, at)
        for part in e.sides(row)
    )


def _thinner_m(e: Evidence, row: int) -> float:
    """Return the smallest edge of two touching parts that can move [m]; the ground may be thin.

    Infinity where one is unknown.
    """
    if any(body not in e.seen.bodies for body, _ in e.sides(row)):
        return math.inf
    at = start_of(int(e.contacts.step[row]))
    edges = [e.extents_m(*part, at) for part in e.sides(row) if e.mass_kg(*part, at) > 0]
    return min(
        (math.inf if edge is None else float(edge.min()) for edge in edges), default=math.inf
    )


class Parting(NamedTuple):
    """How fast the sides of a contact point part along its normal in a step; negative: approach."""

    before_m_s: float
    """As the step began."""
    free_m_s: float
    """As the step would have left them without contact."""
    after_m_s: float
    step_s: float
    """Timestep of the integrator."""
    settings: Mapping[str, Any]
    """Of the engine."""


def _parting(e: Evidence, row: int) -> Parting | None:
    """Return how the sides of a contact point part; None if one has joints or was not recorded."""
    contacts, speeds_m_s, sides = e.contacts, np.zeros(3), e.sides(row)
    if not {body for body, _ in sides} <= e.seen.bodies.keys():
        return None
    points_m = contacts.vector(ON_A, row), contacts.vector(ON_B, row)
    step_s = math.nan
    settings: Mapping[str, Any] = {}
    for (body, _), point_m, sign in zip(sides, points_m, (1, -1), strict=True):
        judged = e.judged.get(body)
        if judged is None:
            continue
        track, at = judged.track, int(np.searchsorted(judged.track.steps, contacts.step[row]))
        epoch, law = next((each for each in judged.laws if at < each[0].rows.stop), (None, None))
        if epoch is None or law is None or not track.led[at] or not can_step(law.timestep_s):
            return None
        motions = [each.at(slice(at, at + 1)) for each in (track.before, track.motion)]
        # What has no mass is carried along.
        motions.insert(1, law.step(motions[0]) if has_inverse(law.mass_kg) else motions[0])
        arm_m = point_m - motions[0].position_m[0]
        for number, motion in enumerate(motions):
            velocity_m_s = motion.velocity_m_s[0] + np.cross(motion.spin_rad_s[0], arm_m)
            speeds_m_s[number] += sign * velocity_m_s @ contacts.vector(NORMAL, row)
        step_s, settings = law.step_s, epoch.settings.values
    before_m_s, free_m_s, after_m_s = speeds_m_s.tolist()
    return Parting(before_m_s, free_m_s, after_m_s, step_s, settings)


def _given(settings: Mapping[str, Any], name: str, default: float) -> float:
    """Return a setting of the engine that calls may have given; it takes none below 0."""
    value = float(np.ravel(settings.get(f"set_{name}", -1))[0])
    return value if value >= 0 else default


def _gained(e: Evidence) -> Iterator[ScriptFinding]:
    for body in e.bodies:
        judged = e.judged.get(body.id)
        if judged is None or judged.track.body.joints:
            continue
        track = judged.track
        for contact in body.contacts:
            gave = contact.most_given_step is not None
            if not gave or not all(_stands(e, pusher.id) for pusher in contact.by):
                continue
            first = int(np.searchsorted(track.steps, contact.first_step))
            law = judged.law_at(first)
            if law is None:
                continue
            before_j = judged.kinetic_j(first, before=True)
            least_j = max(GAINED * before_j, law.mass_kg * SLOW_M_S**2 / 2)
            if contact.energy_j > least_j:
                yield _gain(e, body.id, contact, before_j)
                break


def _gain(e: Evidence, body: int, contact: ScriptContact, before_j: float) -> ScriptFinding:
    message = Message(
        "{body} gains {gained:.3g} J from contact with {others} between {start:.4g} s and "
        "{end:.4g} s, on top of {before:.3g} J of kinetic energy, and nothing pushed it",
        body=e.label(body),
        gained=contact.energy_j,
        others=", ".join(sorted({pusher.body for pusher in contact.by})),
        start=contact.start_s,
        end=contact.end_s,
        before=before_j,
    )
    message = _because(message, _cause_of_gain(e, body, contact))
    return e.finding("energy-gained", message, body=body, step=contact.first_step)


def _cause_of_gain(e: Evidence, body: int, contact: ScriptContact) -> Message | None:
    """Return what gave a body energy: what it was put into, or the step that gave most of it.

    With a hard contact a step leaves the sides parting at e u + erp d / dt, for restitution e,
    speed of approach u (0 below a threshold) and overlap d: `drop_physics.laws.bullet_contact`.
    """
    contacts, its = e.contacts, (e.contacts.body_a == body) | (e.contacts.body_b == body)
    rows = np.flatnonzero(its & (contacts.step == contact.most_given_step))
    row = int(rows[np.argmax(contacts.normal_force_n[rows])])
    parting = _parting(e, row)
    if parting is None:
        return None
    met_m_s = max(0.0, -parting.free_m_s)
    bounces = met_m_s >= _given(
        parting.settings, "restitutionVelocityThreshold", RESTITUTION_THRESHOLD_M_S
    )
    bounced_m_s = _restitution(e, row) * met_m_s if bounces else 0.0
    first = its & (contacts.step == contact.first_step)
    inside = contact.first_step in first_steps(e.seen.by_body[body])
    inside &= bool(contacts.distance_m[first].min() < -OVERLAP_M)
    if _springs(e, row):
        if inside and bounced_m_s <= met_m_s:
            return Message(
                "their contact is a spring, which pushes overlapping bodies apart; place it outside"
            )
        return None
    depth_m = -contacts.distance_m[row] - CONTACT_SLOP_M
    share = _given(parting.settings, "contactERP", CONTACT_ERP) if depth_m > 0 else 1.0
    pushed_m_s = share * depth_m / parting.step_s
    off_m_s = abs(bounced_m_s + pushed_m_s - parting.after_m_s)
    if off_m_s > AGREES * parting.after_m_s or contact.most_given_j < contact.energy_j / 2:
        return None
    # Slower along the normal, the energy came from friction, which may give some with restitution.
    if bounced_m_s + pushed_m_s <= met_m_s:
        return None
    if bounced_m_s - met_m_s > max(0.0, pushed_m_s):
        return Message("their restitutions multiply to more than 1; lower one of them")
    if bounced_m_s > met_m_s:
        return Message(
            "their restitutions multiply to more than 1, and the engine pushes overlapping bodies "
            "apart; lower one of them, and call p.setPhysicsEngineParameter(contactERP=0)"
        )
    if pushed_m_s <= 0:
        return None
    # A smaller timestep does not help: out of the same depth it pushes faster.
    if inside and contact.most_given_step == contact.first_step:
        return Message(
            "the engine pushes overlapping bodies apart, and that leaves them faster; place it "
            "outside, or call p.setPhysicsEngineParameter(contactERP=0)"
        )
    return Message(
        "the engine pushes overlapping bodies apart, and that leaves them faster; call "
        "p.setPhysicsEngineParameter(contactERP=0)"
    )


def _restitution(e: Evidence, row: int) -> float:
    """Return the restitution of a contact point: the product of those of both sides."""
    at, product = start_of(int(e.contacts.step[row])), 1.0
    for part in e.sides(row):
        reported = e.reported("restitution", *part, at)
        # Of a btRigidBody it is not reported.
        given = e.given(("restitution",), *part, at) if math.isnan(reported) else [reported]
        product *= given[0] if given else 0.0
    return product


def _stands(e: Evidence, body: int) -> bool:
    """Whether a body neither moves nor was moved: it has no energy to give."""
    return body in e.seen.bodies and body not in e.judged and body not in e.set_bodies


def _mass_ratio(e: Evidence) -> Iterator[ScriptFinding]:
    """Yield the most different masses that touch where the solver is known to stop early."""
    contacts, (pair_of, pairs) = e.contacts, e.pairs
    ratios = np.array([_ratio(e, point) for point in pairs])
    ratio = np.where(contacts.normal_force_n > 0, ratios[pair_of] if len(pairs) else 0.0, 0.0)
    if not len(ratio) or ratio.max() <= HEAVIER:
        return
    row = int(np.argmax(ratio))
    mine, other = _sides(e, row, int(contacts.body_a[row]))
    message = Message(
        "{mine} and {other} touch, and one is {ratio:.4g} times as heavy as the other: for such "
        "pairs Bullet's solver needs many iterations, and in this simulation it often stops before "
        "it converges; to see whether they are why, keep within 1:100, or try more "
        "numSolverIterations",
        mine=mine,
        other=other,
        ratio=ratio[row],
    )
    yield e.finding("mass-ratio", message, step=int(contacts.step[row]))


def _ratio(e: Evidence, row: int) -> float:
    """Return how many times heavier one touching part is than the other.

    0 if one cannot move, if the solver of their simulation mostly converges, or contacts there may
    contradict each other, and if the lighter one, a body without joints, touches nothing else: what
    only lies on a heavy body is solved at once.
    """
    at, sides = start_of(int(e.contacts.step[row])), e.sides(row)
    masses = [e.mass_kg(*part, at) for part in sides]
    if min(masses) <= 0 or sides[0][0] == sides[1][0]:
        return 0.0
    light = e.seen.bodies[sides[int(np.argmin(masses))][0]]
    if light.client not in e.unconverged or not (light.joints or light.number in e.pressed):
        return 0.0
    return max(masses) / min(masses)
