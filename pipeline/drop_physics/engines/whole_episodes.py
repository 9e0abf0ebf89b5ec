"""The choice of the episodes that a recording holds step by step: of the others it has a line."""

from __future__ import annotations

from typing import Any, Literal

from drop_physics.trace.events import has_failed

Episodes = Literal["failing", "all"] | int | None
"""Episodes whose steps are recorded: those that failed, all, or that of a number; None for all
until `MANY_BYTES` of steps, and from then on the last that failed."""
Decision = Literal["whole", "latest", "line"]
"""`latest`: whole, until another takes its place."""

MANY_BYTES = 1 << 27
"""Once the steps that are kept take so many bytes in the stream, only the latest failure is kept: a
recording takes one and a half times as many."""
LONGEST_BYTES = 1 << 26
"""An episode of more bytes is kept, as nobody knows when it ends."""


class WholeEpisodes:
    """Decides, as each episode ends, whether its steps are recorded.

    Parameters
    ----------
    which
        Those that are.
    """

    def __init__(self, which: Episodes = "all") -> None:
        self._which = which
        self.ended = self.left_out = 0
        """Number of episodes that have ended, and of those without their steps."""
        self.kept_bytes = 0
        """Bytes of the steps that are kept."""

    @property
    def leaves_out(self) -> bool:
        """True if episodes were asked for, so that others are left out."""
        return self._which not in ("all", None)

    @property
    def all_so_far(self) -> bool:
        """True if current steps are recorded, however their episode ends."""
        return self._which == "all" or (self._which is None and self.kept_bytes < MANY_BYTES)

    def decide(self, how: str, *, success: bool | None, **_: Any) -> Decision:  # noqa: ANN401
        """Return the treatment of an episode, given its environment's report."""
        self.ended += 1
        if self.all_so_far or self._which == self.ended:
            return "whole"
        if isinstance(self._which, int):
            return "line"
        if how == "run":  # the script may have failed in it
            return "whole"
        if not has_failed(how, success):
            return "line"
        return "whole" if self.kept_bytes < MANY_BYTES else "latest"
