"""Which pairs of bodies touched: friction used and needed, what slid, what it gave."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from drop_physics.analysis.explained.recording import Explained
from drop_physics.seen.history import Seen


@dataclass(frozen=True, kw_only=True)
class Touch:
    """What happened between a body and another that it touched."""

    other: str
    """Label of the other body, in JSON `with`."""
    steps: int
    """In how many steps a force acted."""
    friction: float | None
    """Coefficient: the product of both; None where several parts with different ones touched."""
    used: float | None
    """Largest share of Σ μN that the pair used."""
    available_n: float | None
    """Σ μN at the step that needs most."""
    needed_n: float | None
    friction_needed: float | None
    """Coefficient that would be enough; None where the normals share no line."""
    slid_m: float
    deepest_m: float
    impulse_n_s: tuple[float, float, float]
    energy_j: float
    """Given to this body."""
    energy_of_pair_j: float
    """Given to both."""


class TouchTable:
    """Grows piece by piece."""

    def __init__(self, seen: Seen) -> None:
        self._seen = seen

    def add(self, explained: Explained) -> None:
        """Take a piece."""

    def rows(self, body: int) -> Sequence[Touch]:
        """Return the pairs of a body, by its number."""
        return []
