"""Notes which contacts and inputs occur in a run, to try only changes that can matter."""

from __future__ import annotations

from typing import Any

import numpy as np

INPUTS = ("ctrl", "qfrc_applied", "xfrc_applied", "mocap_pos", "qpos", "qvel")
"""Parts of the state that a script writes."""


class SeenInputs:
    """The geoms that touched in a run, and the inputs that the script wrote.

    Parameters
    ----------
    m, d
        The MjModel, and the MjData before the first step.
    """

    def __init__(self, m: Any, d: Any) -> None:
        self.model = m
        """The MjModel, kept alive because the script may release it."""
        self.start = {part: getattr(d, part).copy() for part in ("qpos", "qvel")}
        """The state before the first step."""
        self.pairs: set[tuple[int, int]] = set()
        """Pairs of geoms that touched."""
        self.written: dict[str, set[int]] = {part: set() for part in INPUTS}
        """Elements that the script wrote, by state part: they differed from their values after the
        previous step."""
        self._left: dict[tuple[int, str], Any] = {}

    def before(self, d: Any) -> None:
        """Note what the script has written before a step."""
        for part, written in self.written.items():
            now, left = getattr(d, part), self._left.get((id(d), part))
            if left is None:
                left = now if part in ("qpos", "qvel", "mocap_pos") else np.zeros_like(now)
            written.update(np.flatnonzero(now != left).tolist())

    def after(self, d: Any) -> None:
        """Note contacts and inputs after a step."""
        for part in self.written:
            self._left[id(d), part] = getattr(d, part).copy()
        self.pairs.update(map(tuple, np.sort(d.contact.geom[: d.ncon], axis=1).tolist()))
