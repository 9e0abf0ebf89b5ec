"""Expectations from rows of the account: a joint's target that was not reached."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from drop_physics.engines.watching.single_changes import Change
from drop_physics.messages import joined

if TYPE_CHECKING:
    from drop_physics.account.episodes import EpisodeRow
    from drop_physics.account.rows import AccountRow

LEFT = 0.2
"""The share of a row's gap that may be left, as where a trial cures a finding."""
FAR = 0.2
"""The salience of a row from which on it is asked what would close its gap."""
SERIES = {"rad": "joint", "m": "joint", "rad/s": "rate", "m/s": "rate"}
"""The series of an expression by the unit of a joint's row."""
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
    (r"input\.(xfrc|qfrc)_applied|applyExternal.*", "applied"),
)
"""Patterns of changes, and of the causes of a row's terms that each acts on."""


@dataclass(frozen=True)
class RowExpectation:
    """An expectation derived from a row of the account, or from an episode that failed."""

    text: str
    """An expression that its engine's names give a value."""
    words: str
    """The row as a sentence."""
    gap: float | None = None
    """The distance of what came from what was asked; None of an episode."""
    unit: str | None = None
    """The unit of that distance."""
    causes: tuple[str, ...] = ()
    """The causes of its terms."""

    def names(self, change: Change) -> bool:
        """Return whether a change acts on a term of the row."""
        return any(
            re.fullmatch(pattern, change.change)
            and any(re.fullmatch(cause, each) for each in self.causes)
            for pattern, cause in NAMED
        )


def row_expectation(
    rows: Sequence[AccountRow], episodes: Sequence[EpisodeRow]
) -> RowExpectation | None:
    """Return the first shortfall of a run: a failed episode, else the first row of a joint.

    None where no joint is far from its target, or has moved though told to stand.
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
            f"{LEFT * abs(row.gap):.2g}"
        )
        causes = tuple(dict.fromkeys(term.cause for term in row.terms))
        return RowExpectation(
            text, joined(" ", [row.who, row.told]), abs(row.gap), row.unit, causes
        )
    return None


def _is_finite(value: float | None) -> bool:
    return value is not None and math.isfinite(value)
