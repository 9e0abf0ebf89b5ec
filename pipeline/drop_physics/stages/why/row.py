"""Derives what a script seems to expect from its account: that a joint reaches its target."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from drop_physics.engines.watching.single_changes import Change
from drop_physics.experiments.verdicts import CURED
from drop_physics.messages import joined

if TYPE_CHECKING:
    from drop_physics.account.episodes import EpisodeRow
    from drop_physics.account.rows import AccountRow

FAR = 0.2
"""Least salience of a row for which changes that close its gap are searched."""
CAME = 0.01
"""A command counts as reached if the gap is a smaller share of its value."""
SERIES = {"rad": "joint", "m": "joint", "rad/s": "rate", "m/s": "rate"}
"""The function of an expression that returns a joint's quantity, by the row's unit."""
NAMED = (
    (r"dof_damping|flag\.DAMPER|\w+\.jointDamping", "joint damping"),
    (r"dof_frictionloss|flag\.FRICTIONLOSS", "friction loss"),
    (r"jnt_stiffness|flag\.SPRING", "spring"),
    (r"jnt_limited|jnt_range|flag\.LIMIT", "joint limit|stops|limit"),
    (r"body_gravcomp|option\.gravity|flag\.GRAVITY|setGravity.*", "gravity"),
    (r"actuator_\w+|input\.ctrl|setJointMotorControl.*", r"motors?|actuator .*|gap|rate"),
    (r"geom_\w+|pair\w*|flag\.CONTACT|loadURDF\.flags|setCollision\w+.*", "contact|friction"),
    (r"\w+\.(lateral|rolling|spinning)Friction", "contact|friction"),
    (r"eq_\w+|flag\.EQUALITY|changeConstraint.*", "constraint.*|equality.*"),
    (r"\w+\.(linear|angular)Damping", "damping|drag"),
    (r"input\.(xfrc|qfrc)_applied|applyExternal.*", "applied|push|force"),
    (r"input\.(qpos|qvel)|reset(Base|Joint)\w+.*", "set"),
)
"""Patterns of changes, each with the causes of terms that such changes act on."""
OF_KIND = {
    "asked": ("motors",),
    "given": ("motors",),
    "slips": ("friction",),
    "press": ("contact",),
    "set": ("set",),
}
"""Causes that rows of a kind always concern, besides those of their terms."""


@dataclass(frozen=True)
class RowExpectation:
    """An expectation derived from the account's row, or from a failed episode."""

    text: str
    """The expectation as an expression, such as `abs(at(joint('elbow'), 1.5) - 0.8) < 0.02`."""
    words: str
    """The row as a sentence."""
    gap: float | None = None
    """Distance between the commanded and the reached value; None for an episode."""
    unit: str | None = None
    """Unit of the gap."""
    causes: tuple[str, ...] = ()
    """Causes of the row's terms."""

    def names(self, change: Change) -> bool:
        """Return whether a change acts on something that the row names."""
        return _acts_on(change, self.causes)


def _acts_on(change: Change, causes: Iterable[str]) -> bool:
    return any(
        re.fullmatch(pattern, change.change) and any(re.fullmatch(cause, each) for each in causes)
        for pattern, cause in NAMED
    )


def row_of(change: Change, rows: Sequence[AccountRow]) -> AccountRow | None:
    """Return the account's first row about the target of a change and what it acts on."""
    its = _names(change)
    for row in rows:
        if not row.at_limit and row.asked and abs(row.gap or row.asked) < CAME * abs(row.asked):
            continue  # what was asked for has come
        causes = {*OF_KIND.get(row.kind, ()), *(term.cause for term in row.terms)}
        if _acts_on(change, causes) and (not its or its & _names_of(row)):
            return row
    return None


def _names(change: Change) -> set[str]:
    """Return the names of the model elements that a change edits, and of their links."""
    named = {part for each in change.of for part in re.split(" x | of | body", each)}
    return {*named, *change.on} - {""}


def _names_of(row: AccountRow) -> set[str]:
    """Return the names of bodies, joints and links that a row is about."""
    pair = row.pair or ()
    own = [row.joint, row.constraint, row.actuator, row.link, *row.joints, *pair]
    if not row.joint:
        own += [label.partition("_")[2] or label for label in (row.body, row.other) if label]
    return {each for each in own if each}


def row_expectation(
    rows: Sequence[AccountRow], episodes: Sequence[EpisodeRow]
) -> RowExpectation | None:
    """Return the first failed request in the account: an episode, or a joint's target.

    None if no episode failed, and no joint is far from its target or moved without a command.
    Joints are considered only in a run of one episode.
    """
    failed = [each for each in episodes if each.failed and each.ended == "terminated"]
    if failed:
        return RowExpectation("not terminated", str(failed[0].why or failed[0].ended))
    if len(episodes) > 1:  # whose clocks begin again
        return None
    for row in rows:
        if row.kind not in ("asked", "moved") or row.salience < FAR:
            continue
        series, numbers = SERIES.get(row.unit or ""), (row.asked, row.gap, row.time_s)
        if row.joint is None or series is None or not all(map(_is_finite, numbers)):
            continue
        assert row.asked is not None
        assert row.gap is not None
        text = (
            f"abs(at({series}({row.joint!r}), {row.time_s:.6g}) - {row.asked:.6g}) < "
            f"{CURED * abs(row.gap):.2g}"
        )
        causes = tuple(dict.fromkeys(term.cause for term in row.terms))
        return RowExpectation(
            text, joined(" ", [row.who, row.told]), abs(row.gap), row.unit, causes
        )
    return None


def _is_finite(value: float | None) -> bool:
    return value is not None and math.isfinite(value)
