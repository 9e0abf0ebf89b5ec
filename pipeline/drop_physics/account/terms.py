"""The terms of a body's sum by partner: the links that press, and the parts of servos."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from drop_physics.arrays import Float64
from drop_physics.explain.steps import BodySteps
from drop_physics.physics.impulses import impulses_of
from drop_physics.physics.kinematics import kinematics
from drop_physics.physics.vectors import distinct, distinct_rows
from drop_physics.trace.events import Body

CONTACT, FRICTION, DRAG, GIVEN, GAP, RATE = "contact", "friction", "drag", "given", "gap", "rate"
"""Causes that the sum of a step has as parts of others: the normal and the tangential force of a
contact; the inertia that couples a rate to another one's acceleration; the torque of a call; the
two parts of a position servo, its stiffness times the gap and its damping times the rate."""
HELD = "constraints"
"""Cause of what constraints and equalities pull with, by name where these are known apart."""
ROUNDED = 1e-9
"""A part of a term below this share of it is rounding."""
SINGLE = 1e-6
"""The same of contacts, whose points an engine may report in single precision."""
MOST_PARTNERS = 24
"""Most pairs of links whose contacts are told apart in one piece; the weakest others are summed."""


@dataclass(frozen=True)
class Term:
    """A cause that acts on a body, with its partner if it has one."""

    cause: str
    """A cause of the sum, or one of the parts above."""
    name: str = ""
    """The actuator, for the parts of its force."""
    link: int | None = None
    """The body's own link, in a contact."""
    other: int | None = None
    """The number of the other body, in a contact."""
    other_link: int | None = None
    rate: int | None = None
    """The rate whose acceleration drags, as an index into the generalised velocity."""


Impulses = dict[Term, Float64]
"""Generalised impulses by term [N s, N m s], shape (n, size) each."""


def impulses_by_term(
    steps: BodySteps, normals: Float64, servos: Mapping[str, tuple[int, float]]
) -> Impulses:
    """Return the impulses on a body in its steps, contacts by partner and servos by part.

    `normals` are those of the contact points of the piece, shape (points, 3). `servos` has, for
    each actuator that is a position servo, the rate that it drives and its damping
    [N m s/rad] or [N s/m] there.
    """
    found: Impulses = {}
    for cause, impulse in steps.terms.items():
        if not impulse.any():
            continue
        if cause == "contacts":
            found |= _contacts(steps, normals, impulse)
        elif (servo := servos.get(cause)) is not None:
            found |= _servo(steps, cause, impulse, *servo)
        elif cause == "applied":
            found |= _applied(steps, impulse)
        elif cause == HELD and steps.pulls:
            found |= _pulls(steps, impulse)
        else:
            found[Term(cause)] = impulse
    return found


def servos_of(body: Body) -> dict[str, tuple[int, float]]:
    """Return the rate and the damping of each position servo, by the name of its term."""
    return {
        f"actuator {each.name}": (rate, each.kv * each.gear**2)
        for each in body.actuators
        if each.kind == "position" and each.kv and (rate := body.rate_of(each)) is not None
    }


def _servo(
    steps: BodySteps, cause: str, impulse: Float64, joint_rate: int, damping: float
) -> Impulses:
    """Return the impulse of a servo, kp × gap apart from kv × rate."""
    rate = steps.law.tree.first_rate + joint_rate
    damped = np.zeros_like(impulse)
    damped[:, rate] = -damping * steps.before.velocity[:, rate] * steps.reported.timestep_s
    _, _, name = cause.partition(" ")
    parts = {Term(GAP, name): impulse - damped, Term(RATE, name): damped}
    return {term: part for term, part in parts.items() if part.any()}


def _applied(steps: BodySteps, impulse: Float64) -> Impulses:
    """Return the impulses applied by calls, joint torques of commands apart from pushes."""
    commanded = np.zeros_like(impulse)
    first = steps.law.tree.first_rate
    commanded[:, first:] = steps.reported.commanded * steps.reported.timestep_s[:, None]
    pushed = impulse - commanded
    pushed[np.abs(pushed) <= ROUNDED * np.abs(commanded)] = 0.0
    parts = {Term(GIVEN): commanded, Term("applied"): pushed}
    return {term: part for term, part in parts.items() if part.any()}


def _pulls(steps: BodySteps, impulse: Float64) -> Impulses:
    """Return the impulses of constraints by what pulls; what gears give apart."""
    found = {
        Term(HELD, pull.name, other=pull.other, other_link=pull.other_link): part
        for pull, part in steps.pulls.items()
        if part.any()
    }
    left = impulse - sum(found.values())
    if np.abs(left).max() > ROUNDED * np.abs(impulse).max():
        found[Term(HELD)] = left
    return found


def _contacts(steps: BodySteps, normals: Float64, impulse: Float64) -> Impulses:
    """Return the impulses of contacts by partner, normal forces apart from friction."""
    contacts, sides = steps.reported.contacts, steps.sides
    if not len(contacts) or len(contacts) != len(sides.other_body):
        return {Term("contacts"): impulse}
    used, rows = distinct(contacts.step)
    kin = kinematics(steps.law.tree, steps.before.at(used))
    timestep_s = steps.reported.timestep_s[used]
    here = replace(contacts, step=rows)
    whole = impulses_of(kin, here, timestep_s)
    normal = normals[sides.point]
    along = np.einsum("ki,ki->k", contacts.force_n, normal)[:, None] * normal
    pressed = replace(here, force_n=along, torque_n_m=np.zeros_like(contacts.torque_n_m))
    normal_only = impulses_of(kin, pressed, timestep_s)
    links = np.stack([contacts.link, sides.other_link], axis=1)
    own = sides.other_body == steps.body.number
    links[own] = np.sort(links[own], axis=1)  # both sides of a contact between own links are one
    partners = np.stack([links[:, 0], sides.other_body, links[:, 1]], axis=1)
    kinds, _, which = distinct_rows(partners)
    strength = np.bincount(which, np.abs(whole).sum(axis=1), minlength=len(kinds))
    found, left = {}, impulse.copy()
    for kind in np.argsort(-strength, kind="stable")[:MOST_PARTNERS].tolist():
        its = which == kind
        link, other, other_link = kinds[kind].tolist()
        least = SINGLE * float(np.abs(whole[its]).max())
        for cause, values in ((CONTACT, normal_only), (FRICTION, whole - normal_only)):
            part = np.zeros_like(impulse)
            np.add.at(part, contacts.step[its], values[its])
            if np.abs(part).max() > least:
                found[Term(cause, link=link, other=other, other_link=other_link)] = part
            left -= part
    if np.abs(left).max() > SINGLE * np.abs(impulse).max():
        found[Term("contacts")] = left
    return found
