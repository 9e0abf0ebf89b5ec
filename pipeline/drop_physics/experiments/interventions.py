"""An intervention as a value: a cure, and its target.

The table (`engines/…/interventions`) says how it is written, and how a run with it is made.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field

from drop_physics.trace.cures import Cure

WITHIN = re.compile(r"[\w.]+\(…, (.*)\)")
"""The given argument of a call whose other arguments are left open."""


@dataclass(frozen=True)
class Intervention:
    """One change of a run: a cure, and its target."""

    cure: Cure
    bodies: tuple[int, ...] | None = None
    """Numbers of the bodies that it is made on; None for the whole run."""
    joint: str | None = None
    site: str | None = field(default=None, compare=False)
    """File and line of the call that it changes."""
    decides: bool = field(default=False, compare=False)
    """Whether it switches its cause off entirely, so that a trial without effect refutes it."""

    @property
    def name(self) -> str:
        """Name of the intervention, as `--try` takes it."""
        return self.cure.name

    @property
    def value(self) -> float | None:
        """The given value; None if it has no number."""
        return self.cure.value

    @property
    def target(self) -> str | None:
        """The body or joint, as findings name it; None if on the whole run."""
        return self.cure.target

    @property
    def call(self) -> str:
        """Call that a user would write."""
        return self.cure.call

    @property
    def short(self) -> str:
        """The call, shortened for a table: `force=70`, `timestep/2`."""
        if self.name == "timestep":
            return f"timestep/{self.value:g}"
        return short(self.call)


def short(call: str) -> str:
    """Return the given arguments of a call, leaving out the open ones: `force=70`."""
    within = WITHIN.fullmatch(call)
    return call if within is None else within[1]
