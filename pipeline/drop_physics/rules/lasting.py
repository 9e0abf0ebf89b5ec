"""Collects a MuJoCo script's writes that stay in effect: forces, masses, states.

The collection is filled chunk by chunk, as part of `inputs`.
"""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import dataclass, field

import numpy as np

from drop_physics.arrays import Float64
from drop_physics.trace.acts import Act
from drop_physics.trace.calls import Call
from drop_physics.trace.writes import WrittenElements, computed_by, read_by, written_by

WIDTHS = {Act.SET_BODY_FORCE: 6, Act.SET_JOINT_FORCE: 1, Act.SET_ACTIVE: 1}
"""Number of elements that belong together in a field: force and torque of a body, one value for a
joint or for an equality's switch."""
HUGE = 1e10
"""The magnitude from which MuJoCo treats a number as a sign of a broken state (`mjMAXVAL`)."""
UNIT = 1e-3
"""Largest deviation from 1 of a quaternion's squared length."""


@dataclass
class LastingForce:
    """A written force, or an enabled equality, that acts until written again."""

    client: int
    place: int
    """The engine's index of the body, or of the joint's rate."""
    call: Call
    """The first call that wrote the value after a step."""
    now: Float64
    """The current value, shape (width,)."""
    since: int
    """The number of steps made before the value was set."""
    most: Float64
    """The largest value that stayed in effect after it was written between steps."""
    writes: int = 0
    """The number of calls that changed the value to something other than zero."""
    acts: int = 0
    """The number of steps in which the force acted, until it was last written."""
    was_cleared: bool = False
    """Whether a call reset the value to zero."""
    from_start: bool = False
    """Whether the value was set before the first step of a run or an episode."""

    def until(self, step: int) -> int:
        """Return the number of steps in which the force has acted before the given step."""
        return self.acts + (step - self.since if self.now.any() else 0)

    def become(self, now: Float64, step: int) -> None:
        """Set the value from the given step on."""
        self.acts, self.since, self.now = self.until(step), step, now
        if math.hypot(*now) > math.hypot(*self.most):
            self.most = now


@dataclass(frozen=True)
class LastingEdit:
    """A script's write to a model field."""

    call: Call
    elements: WrittenElements


@dataclass
class PositionWrites:
    """A script's writes to a simulation's positions."""

    first: Call
    steps: set[int] = field(default_factory=set)
    """The number of steps before each write."""
    is_computed: bool = False
    """Whether the script called a function that recomputes derived data after a write."""


@dataclass
class Lasting:
    """The writes that are in effect, by simulation."""

    forces: dict[tuple[int, Act, int], LastingForce] = field(default_factory=dict)
    """Written forces, by client, field and index."""
    edits: defaultdict[Act, list[LastingEdit]] = field(default_factory=lambda: defaultdict(list))
    episodes: defaultdict[int, set[int]] = field(default_factory=lambda: defaultdict(lambda: {0}))
    """The steps before which the state was reset, by client; 0 is the beginning of the run."""

    positions: dict[int, PositionWrites] = field(default_factory=dict)
    """Writes of positions, by client."""
    turned: dict[tuple[int, int], tuple[Call, tuple[float, ...]]] = field(default_factory=dict)
    """The first write of a position that is a rotation about z with w last, by client and index."""
    huge: dict[tuple[int, int], Call] = field(default_factory=dict)
    """Writes of a non-finite or huge number, by client and the number of steps before."""
    stale: dict[tuple[int, str], list[Call]] = field(default_factory=dict)
    """Writes of positions made before a function read outdated values, by client and
    function name."""

    def see(self, calls: list[Call]) -> None:
        """Add the calls between two steps, in order."""
        for call in calls:
            if not all(abs(each) < HUGE for each in call.numbers):
                self.huge.setdefault((call.client, call.at.step), call)
            if call.act is Act.SET_STATE:
                self._turn(call)
            if call.act is Act.RESET_STATE:
                self._reset(call)
            elif call.act in WIDTHS:
                self._force(call)
            elif call.act is Act.SET_STATE and (reader := read_by(call)):
                self.stale.setdefault((call.client, reader), []).append(call)
            elif call.act is Act.SET_STATE and call.at.step:
                writes = self.positions.setdefault(call.client, PositionWrites(call))
                writes.steps.add(call.at.step)
                writes.is_computed |= bool(computed_by(call))
            elif call.act in (Act.SET_MASS, Act.SET_DERIVED):
                self.edits[call.act].append(LastingEdit(call, written_by(call)))

    def _turn(self, call: Call) -> None:
        """Note a quaternion that seems to have w last: a turn about z, as (0, 0, s, c)."""
        written = written_by(call)
        values = dict(zip(written.indices.tolist(), written.values.tolist(), strict=True))
        for place, w in values.items():
            x, s, c = (values.get(place + k, 0.0) for k in (1, 2, 3))
            if w == x == 0 < c and abs(s * s + c * c - 1) < UNIT:
                self.turned.setdefault((call.client, place), (call, (w, x, s, c)))

    def _reset(self, call: Call) -> None:
        self.episodes[call.client].add(call.at.step)
        for (client, *_), force in self.forces.items():
            if client == call.client:
                force.become(np.zeros_like(force.now), call.at.step)

    def _force(self, call: Call) -> None:
        written, width, step = written_by(call), WIDTHS[call.act], call.at.step
        for place in np.unique(written.indices // width).tolist():
            its = written.indices // width == place
            key = call.client, call.act, place
            force = self.forces.get(key)
            now = np.zeros(width) if force is None else force.now.copy()
            now[written.indices[its] % width] = written.values[its]
            if force is None:
                if not now.any():
                    continue
                force = LastingForce(call.client, place, call, np.zeros(width), step, now)
                self.forces[key] = force
            if now.any():
                force.writes += 1
                force.from_start |= step in self.episodes[call.client]
            elif force.now.any():
                force.was_cleared = True
            force.become(now, step)
