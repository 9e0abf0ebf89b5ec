"""Decides which episodes are recorded step by step; the others get one summary line each."""

from __future__ import annotations

from typing import Any, Literal

from drop_physics.trace.events import has_failed

Episodes = Literal["failing", "all"] | int | None
"""The episodes that are recorded step by step: failed ones, all, or the one with the given number.
None records all until their steps take `MANY_BYTES`; from then on, only the latest failed episode
is kept."""
Decision = Literal["whole", "latest", "line"]
"""The decision about an episode: record its steps, keep them until a later episode replaces them
(`latest`), or record only a summary line."""

MANY_BYTES = 1 << 27
"""Size of the recorded steps in the stream [bytes] above which only the latest failure is kept; the
recording is one and a half times as large."""
LONGEST_BYTES = 1 << 26
"""Size [bytes] above which an episode is recorded before it ends, since its end cannot be foreseen.
"""


class WholeEpisodes:
    """Decides at the end of each episode whether its steps are recorded.

    Parameters
    ----------
    which
        The episodes whose steps are recorded.
    """

    def __init__(self, which: Episodes = "all") -> None:
        self._which = which
        self.ended = self.left_out = 0
        """Number of episodes that have ended, and number of those whose steps are not recorded."""
        self.kept_bytes = 0
        """Size of the steps that are kept [bytes]."""

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
