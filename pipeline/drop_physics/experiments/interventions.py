"""A change to try, with its target, as one value.

The table (`engines/…/interventions`) has the code that a user would write for a change, and the
operations that make a run with the change.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field

from drop_physics.trace.cures import Cure

WITHIN = re.compile(r"[\w.]+\(…, (.*)\)")
"""Pattern of the given argument in a call such as `setGravity(…, gravZ=0)`, in which `…` stands for
all other arguments."""


@dataclass(frozen=True)
class Intervention:
    """A suggested or requested change, with the bodies or joints that it applies to."""

    cure: Cure
    bodies: tuple[int, ...] | None = None
    """Ids of the bodies that the change applies to; None for the whole run."""
    joint: str | None = None
    site: str | None = field(default=None, compare=False)
    """File and line of the call that is changed."""
    decides: bool = field(default=False, compare=False)
    """Whether the change switches a cause off completely, so that a trial without effect refutes
    the cause."""

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
