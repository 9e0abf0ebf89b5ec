"""Rows for links that touch: pressing, sliding, and spinning without end."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping

import numpy as np

from drop_physics.account.rows import AccountRow
from drop_physics.account.subjects import MeasuredBody, in_weights, turning_rad_s
from drop_physics.account.terms import Term
from drop_physics.account.touches import PairKey, TouchedLinks
from drop_physics.account.words import RowWords
from drop_physics.messages import Message
from drop_physics.quantities import number as number_of
from drop_physics.quantities import quantity
from drop_physics.trace.history import Seen

WEIGHTS, DEEP, SLID = 8.0, 0.03, 0.03
"""Minimum contact force in weights of the lighter body; minimum overlap and slide as shares of the
smaller body's size."""
CARRIES = 1.05
"""Largest ratio of a contact force to the weight of all free bodies at which the contact may just
carry them."""
FRICTIONLESS, SLIDING = 1, 3
"""`dim` of a contact without friction, and of one with sliding friction only."""
PRESSING = 0.8
"""Share of the steps in contact above which two links count as pressing each other all the time."""
UNLIKE = 1e3
"""Ratio of two masses in contact from which rows state it: iterative solvers converge slowly."""
TURNING_RAD_S = 0.05
DEFAULT_FRICTION = 1.0
"""The coefficient of a MuJoCo geom for which a file gives none."""
OUTDONE = 2.0
"""The salience of a friction coefficient that does not act."""
STEADY = 1.5
"""Maximum factor between a steady rotation rate and the rate shortly before."""


def touching_rows(
    links: Mapping[PairKey, TouchedLinks],
    subjects: Mapping[int, MeasuredBody],
    seen: Seen,
    words: RowWords,
) -> Iterator[AccountRow]:
    """Yield the rows for all pairs of links that touched."""
    feet, all_n = _feet_of(links, subjects), defaultdict[int, float](float)
    for subject in subjects.values():
        all_n[subject.body.client] += 0.0 if subject.tree.fixed else subject.weight_n
    stands = {key for keys in feet.values() for key in keys}
    for key, touched in links.items():
        its = [subjects[number] for number in dict.fromkeys(key[:2]) if number in subjects]
        for row in _rows(key, touched, its, all_n, seen, words) if its else ():
            if row.kind != "slips" or key not in stands:
                yield row
    for number, keys in feet.items():
        slips = _slipping_row(subjects[number], {key: links[key] for key in keys}, seen, words)
        if slips is not None:
            yield slips
    for subject in subjects.values():
        turns = _turning_row(links, subject, subjects, seen, words)
        if turns is not None:
            yield turns


def _turning_row(
    links: Mapping[PairKey, TouchedLinks],
    subject: MeasuredBody,
    subjects: Mapping[int, MeasuredBody],
    seen: Seen,
    words: RowWords,
) -> AccountRow | None:
    """Return the row for a body that spins forever on its support, without torsional friction."""
    number, ledger = subject.body.number, subject.ledger
    late = ledger.last - max(1, (ledger.last - ledger.first) // 10)
    keys = [key for key in links if number in key[:2] and links[key].last_step > late]
    mean = turning_rad_s(subject)
    spin = float(np.linalg.norm(mean))
    if subject.tree.links or spin <= TURNING_RAD_S or not keys:
        return None
    earlier = float(np.linalg.norm(turning_rad_s(subject, before=True)))
    if not earlier / STEADY < spin < earlier * STEADY:  # it is slowed down, or sped up
        return None
    if any(_resists_turning(key, seen) for key in keys):
        return None
    if any(other in subjects for key in keys for other in key[:2] if other != number):
        return None  # what moves may turn it
    # A body that trembles turns to and fro, and stays where it is.
    end = float(ledger.ends.velocity[np.flatnonzero(ledger.counts)[-1], :3] @ mean) / spin
    told = Message(
        "it still turns at {spin} rad/s at the end; their contact has no torsional and no "
        "rolling friction",
        spin=number_of(end),
    )
    damping = ledger.impulse.get(Term("damping"))
    if damping is not None and damping[:, :3].any():
        told = told + Message(", and only damping and sliding brake it")
    else:
        told = told + Message(", and only sliding would brake it")
    key = keys[0]
    return AccountRow(
        kind="idle",
        pair=words.names.pair(key),
        told=told,
        got=end,
        unit="rad/s",
        step=ledger.last,
        salience=0.6,
        subject=subject.body,
        group=("turning", subject.kind),
    )


def _feet_of(
    links: Mapping[PairKey, TouchedLinks], subjects: Mapping[int, MeasuredBody]
) -> dict[int, list[PairKey]]:
    """Return the contacts of each standing robot with its ground: pairs of links that slide."""
    found: dict[int, list[PairKey]] = {}
    for key, touched in links.items():
        its = [number for number in {*key[:2]} if number in subjects]
        if len(its) == 1 and key[0] != key[1] and touched.rubs and _stands(subjects[its[0]]):
            found.setdefault(its[0], []).append(key)
    return found


def _stands(subject: MeasuredBody) -> bool:
    """Return whether contacts alone support a robot."""
    body, driven = subject.body, {each.target for each in subject.body.actuators}
    first = next(iter(body.joints), None)
    slides = first is not None and first.kind == "prismatic" and first.name not in driven
    return bool(subject.tree.links) and (not subject.tree.fixed or (slides and bool(driven)))


def _slipping_row(
    subject: MeasuredBody, feet: Mapping[PairKey, TouchedLinks], seen: Seen, words: RowWords
) -> AccountRow | None:
    """Return the row for a robot whose feet slip, about the foot that slides farthest.

    The row's salience is that of all feet together.
    """
    slid_m = sum(each.slid_m for each in feet.values())
    steps = sum(each.steps for each in feet.values())
    at_limit = sum(each.at_limit for each in feet.values())
    if slid_m < SLID * subject.size_m or not at_limit:
        return None
    key = max(feet, key=lambda each: feet[each].slid_m)
    number = subject.body.number
    told = _slid(key, feet[key], seen)
    if len(feet) > 1:
        told = told + Message(
            "; its {links} links slid {all} together", links=len(feet), all=quantity(slid_m, "m")
        )
    return AccountRow(
        kind="slips",
        pair=words.names.pair(key),
        told=told,
        got=feet[key].slid_m,
        unit="m",
        other=words.names.label(key[0] if key[0] != number else key[1]),
        step=feet[key].last_step,
        salience=at_limit / max(steps - at_limit, 1),
        alike=len(feet) - 1,
        subject=subject.body,
    )


def _slid(key: PairKey, touched: TouchedLinks, seen: Seen) -> Message:
    """Describe how far two links slid on each other, and how often friction was at its limit."""
    return Message(
        "slid {slid} in {steps:,} steps{apart}; friction at its limit, coefficient "
        "{friction}{origin}, in {share:.0%} of them",
        slid=quantity(touched.slid_m, "m"),
        steps=touched.steps,
        apart=_apart(touched),
        friction=number_of(touched.friction),
        origin=_origin(key, touched, seen),
        share=touched.at_limit / touched.steps,
    )


def _apart(touched: TouchedLinks) -> Message:
    """Describe that two links press each other in a part of the steps only, or nothing."""
    spell = touched.last_step - touched.first_step + 1
    if touched.steps > PRESSING * spell:
        return Message("")
    return Message(", those of {spell:,} in which they press each other", spell=spell)


def _origin(key: PairKey, touched: TouchedLinks, seen: Seen) -> Message:
    """Describe how two friction coefficients make a contact's; nothing if that is obvious."""
    a, b = (_friction(seen, body, link) for body, link in (key[::2], key[1::2]))
    if a is None or b is None or not touched.friction:
        return Message("")
    if np.isclose(touched.friction, a * b):  # of a factor 1 it says nothing new
        if np.isclose((a, b), touched.friction).any():
            return Message("")
        return Message(" as the product of {a} and {b}", a=number_of(a), b=number_of(b))
    if np.isclose(touched.friction, max(a, b)) and not np.isclose(a, b):
        return Message(" as the greater of {a} and {b}", a=number_of(a), b=number_of(b))
    return Message("")


def _outdone_row(
    key: PairKey, touched: TouchedLinks, subject: MeasuredBody, seen: Seen, words: RowWords
) -> AccountRow | None:
    """Return the row for a link's friction coefficient that the other's, a greater one, replaces.

    There is none where both coefficients hold the links, where neither does, or where the lesser
    one is the default.
    """
    sides = key[::2], key[1::2]
    both = [_friction(seen, body, link) for body, link in sides]
    if both[0] is None or both[1] is None or not touched.rubs:
        return None
    lesser = int(both[1] < both[0])
    least, most, reached = both[lesser], both[1 - lesser], touched.used * touched.friction
    assert least is not None
    assert most is not None
    if not np.isclose(touched.friction, most) or least == DEFAULT_FRICTION:
        return None
    if reached <= least or np.isclose(reached, (least, most)).any():
        return None
    return AccountRow(
        kind="idle",
        pair=words.names.pair(key),
        told=Message(
            "the friction {least} of {link} does not act: the contact has the greater of both, "
            "{most}; friction reaches {reached} of the normal force",
            least=number_of(least),
            link=words.names.link(*sides[lesser]),
            most=number_of(most),
            reached=number_of(reached),
        ),
        asked=least,
        got=touched.friction,
        step=touched.last_step,
        salience=OUTDONE,
        group=("outdone", subject.kind, least, most),
        subject=subject.body,
    )


def _friction(seen: Seen, body: int, link: int) -> float | None:
    """Return the last reported coefficient of friction of a link; None if it is not known."""
    reported = [
        float(each.reported["lateral_friction"][link + 1])
        for each in seen.dynamics
        if each.body.number == body and "lateral_friction" in each.reported
    ]
    return reported[-1] if reported and np.isfinite(reported[-1]) else None


def _unlike(its: list[MeasuredBody], words: RowWords) -> Message:
    """Describe the mass ratio of two bodies if it is extreme; else nothing."""
    if len(its) < 2:
        return Message("")
    light, heavy = sorted(its, key=lambda subject: subject.mass_kg)
    if heavy.mass_kg < UNLIKE * light.mass_kg or not light.mass_kg:
        return Message("")
    return Message(
        "; {heavy} is {ratio} times as heavy as {light}",
        heavy=words.names.body(heavy.body.number),
        ratio=number_of(heavy.mass_kg / light.mass_kg),
        light=words.names.body(light.body.number),
    )


def _carried(normal_n: float, lighter: MeasuredBody, all_n: float) -> Message:
    """Describe the weight of all free bodies if a contact may carry them; else nothing."""
    if lighter.is_weightless or not WEIGHTS * lighter.weight_n < normal_n <= CARRIES * all_n:
        return Message("")
    return Message(" (all free bodies weigh {weight})", weight=quantity(all_n, "N"))


def _resists_turning(key: PairKey, seen: Seen) -> bool:
    """Return whether a contact of two links has torsional or rolling friction."""
    if seen.condim(key[:2], key[2:])[0] > SLIDING:
        return True
    return any(
        each.reported[name][link + 1] > 0
        for body, link in (key[::2], key[1::2])
        for each in seen.dynamics
        for name in ("rolling_friction", "spinning_friction")
        if each.body.number == body and name in each.reported
    )


def _rows(
    key: PairKey,
    touched: TouchedLinks,
    its: list[MeasuredBody],
    all_n: Mapping[int, float],
    seen: Seen,
    words: RowWords,
) -> Iterator[AccountRow]:
    """Yield the rows for a pair of links: their normal force, and how far they slid.

    `all_n` has the weight of all bodies with a free base in each simulation [N], by client.
    """
    pair = words.names.pair(key)
    weight_n = min(subject.weight_n for subject in its)
    size_m = min(subject.size_m for subject in its)
    lighter = min(its, key=lambda subject: subject.weight_n)
    normal_n = touched.normal_n
    weights, depth = normal_n / weight_n, touched.deepest_m / size_m
    kinds = tuple(str(subject.kind) for subject in its)
    other = words.names.label(key[0] if key[0] != lighter.body.number else key[1])
    deep = touched.deepest_step if touched.deepest_step >= 0 else touched.first_step
    if (weights > WEIGHTS and touched.steps >= 5) or depth > DEEP:
        told = Message(
            "{force} in the median, {weights}{carried}, in {steps:,} steps",
            force=quantity(normal_n, "N"),
            weights=in_weights(normal_n, lighter, words.names.body(lighter.body.number)),
            carried=_carried(normal_n, lighter, all_n[lighter.body.client]),
            steps=touched.steps,
        )
        if not touched.steps:
            told = Message("no force acts between them in any step")
        if depth > 1e-3:
            told = told + Message(", {depth} deep", depth=quantity(touched.deepest_m, "m"))
        told = told + _unlike(its, words)
        if origin := touched.rubs and _origin(key, touched, seen):
            told = told + Message(
                "; coefficient of friction {friction}{origin}",
                friction=number_of(touched.friction),
                origin=origin,
            )
        heavy = np.log10(max(weights, 1e-9)) / 2.5 if weights > WEIGHTS else 0.0
        yield AccountRow(
            kind="press",
            pair=pair,
            told=told,
            got=normal_n,
            unit="N",
            besides=((touched.deepest_m, "m"),),
            other=other,
            step=deep,
            salience=max(float(heavy), 3.0 * depth if depth > DEEP else 0.0),
            group=("press", kinds, round(float(np.log10(max(weights, 1e-9))))),
            subject=lighter.body,
        )
    outdone = _outdone_row(key, touched, lighter, seen, words)
    if outdone is not None:
        yield outdone
    slid = touched.slid_m / size_m
    if slid > SLID and normal_n > 0:
        if not touched.rubs:
            only_normal = seen.condim(key[:2], key[2:])[0] == FRICTIONLESS
            told = Message(
                "slid {slid} in {steps:,} steps{apart}; no friction acts: {why}",
                slid=quantity(touched.slid_m, "m"),
                steps=touched.steps,
                apart=_apart(touched),
                why=Message("their contact has a normal force only")
                if only_normal
                else Message("the coefficient is {mu}", mu=number_of(touched.friction)),
            )
            salience = 0.8
        else:
            told = _slid(key, touched, seen)
            salience = 0.35 * min(slid, 1.0) * max(touched.at_limit / touched.steps, 0.3)
        yield AccountRow(
            kind="slips",
            pair=pair,
            told=told,
            got=touched.slid_m,
            unit="m",
            other=other,
            step=touched.last_step,
            salience=salience,
            group=("slips", kinds, round(slid, 1)),
            subject=lighter.body,
        )
