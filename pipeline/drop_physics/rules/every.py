"""Lists all rules, and sorts their findings for presentation."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Hashable, Iterable, Iterator
from dataclasses import dataclass, replace

from drop_physics import messages
from drop_physics.rules import (  # noqa: F401 - their rules are registered
    asleep,
    bounces,
    collides_as_hull,
    default_motor,
    free_bodies,
    held_by_friction,
    ik_off,
    joined,
    joint_damping,
    memory,
    motors,
    no_contact,
    no_gravity,
    not_finite,
    not_replayed,
    not_taken,
    of_files,
    off_target,
    overwritten,
    penetration,
    pushes,
    reading,
    reset_leaves,
    restore_differs,
    script_failed,
    servo_off,
    set_up,
    slides,
    soft,
    starts_inside,
    taken_elsewhere,
    target_clamped,
    tunnelled,
    turned_around,
    unstable,
    warned,
    wheel_slip,
)
from drop_physics.rules.answer import Finding
from drop_physics.rules.rule import RULES as RULES  # with all of them
from drop_physics.rules.rule import Rules as Rules
from drop_physics.trace.events import Body


@dataclass(frozen=True)
class Spoiled:
    """An exclusion: findings of some codes make a finding of another code, or its advice, void."""

    code: str
    by: frozenset[str] | None
    """Codes and reasons of findings about the same body that void this finding; None for any
    finding graver than a note, about any body."""
    is_note: bool | None = None
    """Whether only notes can be void, or only findings that are not notes; None for both."""
    void: bool = False
    """Whether the whole finding is dropped, or only its advice."""

    def holds(self, one: Finding, told: Collection[Finding]) -> bool:
        """Return whether a finding is made void by another one."""
        if one.code != self.code or self.is_note not in (None, one.level == "note"):
            return False
        if self.by is None:
            return any(each.level != "note" for each in told)
        return any({each.code, each.reason} & self.by and each.body == one.body for each in told)


SPOILED = (
    # True of nearly every run: as notes they are an answer only where no graver one is.
    *(
        Spoiled(code, None, is_note=True, void=True)
        for code in ("beyond-urdf", "default-damping", "inertia-from-shape")
    ),
    # What rings at the clamp is not clamped.
    Spoiled("velocity-clamped", frozenset(("unstable",)), void=True),
    # A wheel that its own law drives ever faster slips on any ground.
    Spoiled("wheel-slip", frozenset(("unstable",)), void=True),
    # A joint that is too fast already needs no higher gains.
    Spoiled("off-target", frozenset(("beyond-urdf",)), is_note=True),
    # More force is no advice for a joint that its gains or its damping turn around.
    Spoiled("off-target", frozenset(("unstable", "motor-gain")), is_note=False),
    # Other limits are none for a joint that got the target of another.
    Spoiled("target-clamped", frozenset(("ik-index", "joint-index")), is_note=False),
)
"""Exclusions among findings, applied in this order: a void finding excludes no other one."""


def ranked(findings: Iterable[Finding]) -> list[Finding]:
    """Sort findings, the most severe first; of equal findings about many bodies, keep the worst."""
    groups: dict[tuple[Hashable, ...], list[Finding]] = {}
    for miss in _worst_misses(findings):
        groups.setdefault((miss.code, miss.reason, miss.kind), []).append(miss)
    found = sorted((_one_of(group) for group in groups.values()), key=lambda each: each.rank)
    for kind in SPOILED:
        told = found
        if kind.void:
            found = [each for each in told if not kind.holds(each, told)]
        else:
            found = [
                replace(each, advice=None, cure=None) if kind.holds(each, told) else each
                for each in told
            ]
    return found


def told_apart(findings: Iterable[Finding], bodies: Collection[Body]) -> Iterator[Finding]:
    """Yield findings; add the body's name if several bodies have a joint of that name."""
    whose: defaultdict[str, set[str]] = defaultdict(set)
    for body in bodies:
        for joint in body.joints:
            whose[joint.name].add(body.label)
    for finding in findings:
        if finding.joint is None or finding.body is None or len(whose[finding.joint]) < 2:
            yield finding
        else:
            yield replace(finding, message=messages.joined(": ", [finding.body, finding.message]))


def _worst_misses(findings: Iterable[Finding]) -> Iterator[Finding]:
    """Yield findings, but only the worst missed target of each body and kind of cause."""
    told: set[tuple[object, ...]] = set()
    for each in sorted(findings, key=lambda finding: finding.rank):
        is_speed = each.effect is not None and each.effect.unit.endswith("/s")
        of = {(each.body, is_speed, what) for what in (each.joint, each.kind)}
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
