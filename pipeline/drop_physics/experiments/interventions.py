"""A change to try, with its target, as one value.

The table (`engines/…/interventions`) says how it is written, and how a run with it is made.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field

from drop_physics.trace.cures import Cure

WITHIN = re.compile(r"[\w.]+\(…, (.*)\)")
"""Pattern of a given argument in a call whose other arguments are left open."""


@dataclass(frozen=True)
class Intervention:
    """A suggested or requested change, with the bodies or joints that it applies to."""

    cure: Cure
    bodies: tuple[int, ...] | None = None
    """Ids of the bodies that it applies to; None for the whole run."""
    joint: str | None = None
    site: str | None = field(default=None, compare=False)
    """File and line of the call that it changes."""
    decides: bool = field(default=False, compare=False)
    """Whether it switches its cause off completely, so that a trial without effect refutes the
    cause."""

    @property
    def name(self) -> str:
        """Name of the change, as `--try` expects it."""
        return self.cure.name

    @property
    def value(self) -> float | None:
        """The change's number; None if it has none."""
        return self.cure.value

    @property
    def target(self) -> str | None:
        """The body or joint that the change applies to; None for the whole run."""
        return self.cure.target

    @property
    def call(self) -> str:
        """The call that a user would write to make the change."""
        return self.cure.call

    @property
    def short(self) -> str:
        """The call, shortened for a table: `force=70`, `timestep/2`."""
        if self.name == "timestep":
            return f"timestep/{self.value:g}"
        return short(self.call)


def short(call: str) -> str:
    """Shorten a call to its given arguments: `force=70`."""
    within = WITHIN.fullmatch(call)
    return call if within is None else within[1]
