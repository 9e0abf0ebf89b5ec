"""The joints of a recording: how each was driven, where it got, and what that takes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from drop_physics.analysis.explained.recording import Explained
from drop_physics.seen.history import Seen

Control = Literal["position", "velocity", "torque", "pd", "default", "off", "unknown"]


@dataclass(frozen=True, kw_only=True)
class JointRow:
    """One degree of freedom at the last sample; torques [N m] or [N] have the joint's sign."""

    name: str
    index: int
    """Of its link, as PyBullet counts joints."""
    axis: int | None
    """Of a spherical joint, 0 to 2; else None."""
    kind: str
    control: Control
    target: float | None
    """[rad] or [m]; of a velocity motor [rad/s] or [m/s]."""
    reached: float | None
    off: float | None
    """Reached minus target."""
    torque: float | None
    """Its motor's in the last step."""
    force_limit: float | None
    """Its motor's largest in the last step."""
    needs: float | None
    """What holding the last pose takes; None where that is not defined."""
    needs_at_target: float | None
    at_force_limit_steps: int
    at_stop_steps: int


class JointTable:
    """Grows piece by piece."""

    def __init__(self, seen: Seen) -> None:
        self._seen = seen

    def add(self, explained: Explained) -> None:
        """Take a piece."""

    def rows(self, body: int) -> Sequence[JointRow]:
        """Return the joints of a body, by its number."""
        return []
