"""All rules, and the order in which a reader sees what they found."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator
from dataclasses import replace

from drop_physics import messages
from drop_physics.rules import (  # noqa: F401 - their rules are registered
    asked_and_got,
    asleep,
    bounces,
    collides_as_hull,
    condim,
    control_clamped,
    default_motor,
    filtered_out,
    free_bodies,
    held_by_friction,
    ik_off,
    inactive,
    joined,
    keyframe,
    memory,
    motors,
    no_contact,
    not_finite,
    of_files,
    off_target,
    overwritten,
    penetration,
    pushes,
    reading,
    replays,
    reset_leaves,
    restore_differs,
    script_failed,
    servo_off,
    set_up,
    slides,
    slow_drive,
    soft,
    starts_inside,
    tunnelled,
    turned_around,
    unstable,
    warned,
    wheel_slip,
)
from drop_physics.rules.answer import Finding
from drop_physics.rules.rule import Rules as Rules  # with all of them
from drop_physics.trace.events import Body

SHAKES = frozenset(("unstable", "motor-gain"))
"""Codes that explain why a joint is off its target, whatever its motor's limit is."""
FAST = frozenset(("beyond-urdf",))
"""Codes that say that a joint goes faster than it may."""
BESIDE_NOTHING = frozenset(("beyond-urdf", "default-damping", "inertia-from-shape"))
"""Codes that are true of nearly every run: as notes they are an answer only where no graver one
is."""
MISDIRECTED = frozenset(("ik-index", "joint-index"))
"""Reasons that say that a joint's targets were meant for another."""


def ranked(findings: Iterable[Finding]) -> list[Finding]:
    """Return findings, the gravest first; of equal ones on many bodies only the worst."""
    groups: dict[tuple[str | None, ...], list[Finding]] = {}
    for each in _worst_misses(findings):
        groups.setdefault((each.code, each.reason, *_texts(each)), []).append(each)
    found = sorted((_one_of(group) for group in groups.values()), key=lambda each: each.rank)
    if found and found[0].level != "note":
        found = [e for e in found if e.level != "note" or e.code not in BESIDE_NOTHING]
    # What rings at the clamp is not clamped.
    rings = {each.body for each in found if each.code == "unstable"}
    found = [each for each in found if each.code != "velocity-clamped" or each.body not in rings]
    # More force is no advice for a joint that its gains or its damping turn around, nor are higher
    # gains for one that is too fast already.
    # Nor are other limits for one that got the target of another.
    told = {
        codes: {each.body for each in found if {each.code, each.reason} & codes}
        for codes in (SHAKES, FAST, MISDIRECTED)
    }
    spoils = {
        ("off-target", True): told[FAST],
        ("off-target", False): told[SHAKES],
        ("target-clamped", False): told[MISDIRECTED],
    }
    return [
        replace(each, advice=None, cure=None)
        if each.body in spoils.get((each.code, each.level == "note"), ())
        else each
        for each in found
    ]


def told_apart(findings: Iterable[Finding], bodies: Collection[Body]) -> Iterator[Finding]:
    """Yield findings, with the body before a joint that several differently named bodies have."""
    whose: defaultdict[str, set[str]] = defaultdict(set)
    for body in bodies:
        for joint in body.joints:
            whose[joint.name].add(body.label)
    for each in findings:
        if each.joint is None or each.body is None or len(whose[each.joint]) < 2:
            yield each
        else:
            yield replace(each, message=messages.joined(": ", [each.body, each.message]))


def _texts(finding: Finding) -> tuple[str, ...]:
    """Return the template of what is found, and of a target that is missed that of why."""
    why = (
        getattr(finding.message, "values", {}).get("why") if finding.code == "off-target" else None
    )
    return tuple(getattr(each, "template", str(each)) for each in (finding.message, why))


def _worst_misses(findings: Iterable[Finding]) -> Iterator[Finding]:
    """Yield findings; of the targets that joints of a body miss, only the gravest of each cause."""
    told: set[tuple[object, ...]] = set()
    for each in sorted(findings, key=lambda each: each.rank):
        is_speed = each.effect is not None and each.effect.unit.endswith("/s")
        of = {(each.body, is_speed, what) for what in (each.joint, _texts(each))}
        is_miss = each.code == "off-target" and each.reason is None
        if not is_miss or not of & told:
            yield each
            if is_miss and each.level == "asked":
                told |= of


def _one_of(group: list[Finding]) -> Finding:
    worst = min(group, key=lambda each: each.rank)
    if worst.body is None:
        return worst
    # One that stands for several bodies already counts them.
    counts = {each.body: each.bodies for each in group}
    return replace(worst, bodies=sum(counts.values()))
