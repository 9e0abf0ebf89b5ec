"""What can be changed in a run: the one table of interventions, and what each of them decides.

An intervention is a value. A finding proposes it as its cure; how that is written, and how a run
with it is made, is the engine's part (`engines/…/interventions`).
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field

from drop_physics.trace.cures import Cure

WITHIN = re.compile(r"[\w.]+\(…, (.*)\)")
"""What a call is given, of one whose other arguments are left open."""


@dataclass(frozen=True)
class Kind:
    """What is known of an intervention, whatever the run."""

    decides: bool = False
    """Whether it switches its cause off entirely, so that a trial without effect refutes it."""
    whole_run: bool = False
    """Whether it is made on the whole run, not on a body or joint."""


KINDS: dict[str, Kind] = {
    "force": Kind(),
    "default-motor-off": Kind(),
    "gains": Kind(),
    "substeps": Kind(whole_run=True),
    "timestep-first": Kind(decides=True, whole_run=True),
    "timestep": Kind(whole_run=True),
    "iterations": Kind(whole_run=True),
    "parameter": Kind(whole_run=True),
    "nudge": Kind(whole_run=True),
    "seed": Kind(whole_run=True),
    "damping": Kind(decides=True),
    "joint-damping": Kind(decides=True),
    "inertia-from-file": Kind(decides=True),
    "mimic": Kind(),
    "targets-held": Kind(),
    "friction": Kind(),
    "restitution": Kind(),
    "solver": Kind(whole_run=True),
    "cone": Kind(decides=True, whole_run=True),
    "pairs-sorted": Kind(decides=True, whole_run=True),
    "constraint-force": Kind(whole_run=True),
    "constraint-frames": Kind(decides=True, whole_run=True),
    "collision-off": Kind(decides=True),
    "push-repeated": Kind(whole_run=True),
    "push-at-centre": Kind(decides=True),
    "ik": Kind(whole_run=True),
    "limits": Kind(),
    "urdf-limits": Kind(decides=True),
    "concave": Kind(decides=True, whole_run=True),
    "gravity": Kind(decides=True, whole_run=True),
    "right-link": Kind(decides=True),
    "inertial": Kind(),
    "right-client": Kind(decides=True, whole_run=True),
    "lifted": Kind(),
    "support-velocity": Kind(),
    "mass": Kind(),
    "impratio": Kind(whole_run=True),
    "noslip": Kind(whole_run=True),
    "solref": Kind(),
    "armature": Kind(),
    "gravcomp": Kind(),
    "ctrlrange": Kind(),
    "forcerange": Kind(),
    "exclude": Kind(decides=True),
    "contype": Kind(decides=True),
    "filterparent": Kind(decides=True, whole_run=True),
    "keyframe-ctrl": Kind(decides=True, whole_run=True),
    "set-const": Kind(decides=True, whole_run=True),
    "memory": Kind(whole_run=True),
    "forward": Kind(decides=True, whole_run=True),
    "without": Kind(),
}
"""All interventions by name, as `--try` and `--vary` take them; a `parameter` by its own name."""


@dataclass(frozen=True)
class Intervention:
    """One thing that is changed in a run: a cure, and what it is made on."""

    cure: Cure
    bodies: tuple[int, ...] | None = None
    """Numbers of the bodies that it is made on; None for the whole run."""
    joint: str | None = None
    site: str | None = field(default=None, compare=False)
    """File and line of the call that it changes."""

    @property
    def name(self) -> str:
        """Its name, as `--try` takes it."""
        return self.cure.name

    @property
    def value(self) -> float | None:
        """What is given; None where it has no number."""
        return self.cure.value

    @property
    def target(self) -> str | None:
        """The body or joint, as findings name it; None if on the whole run."""
        return self.cure.target

    @property
    def call(self) -> str:
        """What its user would write."""
        return self.cure.call

    @property
    def kind(self) -> Kind:
        """What is known of it, whatever the run."""
        return KINDS[self.name]

    @property
    def short(self) -> str:
        """Its call for a table: `force=70`, `timestep/2`."""
        if self.name == "timestep":
            return f"timestep/{self.value:g}"
        return short(self.call)


def short(call: str) -> str:
    """Return what a call is given, where its other arguments are left open: `force=70`."""
    within = WITHIN.fullmatch(call)
    return call if within is None else within[1]
