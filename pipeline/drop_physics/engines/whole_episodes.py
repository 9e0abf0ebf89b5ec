"""Decides which episodes are recorded step by step; the others get one summary line each."""

from __future__ import annotations

from typing import Any, Literal

from drop_physics.trace.events import has_failed

Episodes = Literal["failing", "all"] | int | None
"""The episodes that are recorded step by step: those that failed, all, or the one with a number;
None for all until their steps take `MANY_BYTES`, and from then on the last that failed."""
Decision = Literal["whole", "latest", "line"]
"""What happens to an episode; `latest` means kept until a later one replaces it."""

MANY_BYTES = 1 << 27
"""Size of the recorded steps in the stream from which on only the latest failure is kept; the
recording is one and a half times as large."""
LONGEST_BYTES = 1 << 26
"""A longer episode is recorded anyway, since nobody knows when it will end."""


class WholeEpisodes:
    """Decides at the end of each episode whether its steps are recorded.

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
        """True if only certain episodes are recorded step by step."""
        return self._which not in ("all", None)

    @property
    def all_so_far(self) -> bool:
        """True if the current steps are recorded, however their episode ends."""
        return self._which == "all" or (self._which is None and self.kept_bytes < MANY_BYTES)

    def decide(self, how: str, *, success: bool | None, **_: Any) -> Decision:  # noqa: ANN401
        """Return whether to record an episode's steps, given its environment's report."""
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
