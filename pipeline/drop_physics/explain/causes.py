"""Sums up one body over a recording: explained samples, energy and momentum by cause."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from drop_physics.arrays import Float64, Int64
from drop_physics.explain.changes import energy_of
from drop_physics.explain.step_status import SEGMENTS, UNEXPLAINED, WHYS, SampleStatus, Why
from drop_physics.explain.steps import BodySteps
from drop_physics.physics.step_law import DampedTree
from drop_physics.physics.tree import States
from drop_physics.trace.events import Body

CAUSES = (
    "gravity", "damping", "joint damping", "motors", "applied", "contacts", "rolling",
    "constraints", "stops", "set", "clamp", "integrator", "remainder",
)  # fmt: skip
"""Causes of changes of momentum. Those of energy are the same except for gravity, which only
converts potential energy into kinetic energy and back."""

OF_REPLAYS = (
    *("spring", "fluid", "friction loss", "gravity compensation", "tendon", "adhesion"),
    *("passive callback", "joint force range", "solver", "another engine"),
)
"""Additional causes, in engines that report every impulse of a step."""


TENDON_LIMIT = "tendon limit "
"""Prefix of the name of a cause: the limit of a tendon's length. Without the word `limit`, it is
the prefix of the tendon's spring and damper."""


def family(cause: str) -> str:
    """Return the group to which a cause is added: `motors`, `tendon`, or the cause itself."""
    kind, _, name = cause.partition(" ")
    return {"actuator": "motors", "tendon": "tendon"}.get(kind, cause) if name else cause


@dataclass
class UnexplainedSamples:
    """Number and times of samples that are unexplained for the same reason."""

    samples: int = 0
    first_step: int = -1
    remainder: float = 0.0
    """The largest ratio of the remainder to the largest term of its step; infinite if the law has
    no sum."""


def _no_energy() -> dict[str, float]:
    return {cause: 0.0 for cause in CAUSES if cause != "gravity"}


def _no_momentum() -> dict[str, Float64]:
    return {cause: np.zeros(3) for cause in CAUSES}


@dataclass
class Totals:
    """Energy and momentum of one body over a whole recording, by cause; filled chunk by chunk."""

    body: Body
    samples: int = 0
    segments: Int64 = field(default_factory=lambda: np.zeros(len(SEGMENTS), np.int64))
    """Number of samples of each segment, in the order of SEGMENTS."""
    unexplained: dict[Why, UnexplainedSamples] = field(default_factory=dict)
    remainder: float = 0.0
    """The largest ratio of the remainder to the largest term of its step, over explained
    samples."""
    start_j: float = 0.0
    """Kinetic and potential energy at the start; heights are measured from the origin."""
    changed_j: float = 0.0
    energy_j: dict[str, float] = field(default_factory=_no_energy)
    """Changes of energy by cause; their sum is `changed_j`."""
    start_kg_m_s: Float64 = field(default_factory=lambda: np.zeros(3))
    moved_kg_m_s: Float64 = field(default_factory=lambda: np.zeros(3))
    momentum_kg_m_s: dict[str, Float64] = field(default_factory=_no_momentum)
    """Changes of linear momentum by cause, (3,) each; 0 if the base cannot move."""
    covered: bool = True
    """Whether the law has a sum for all steps; otherwise the causes are unknown."""
    _last: _End | None = None

    @property
    def end_j(self) -> float:
        """Kinetic and potential energy at the end."""
        return self.start_j + self.changed_j

    @property
    def end_kg_m_s(self) -> Float64:
        """Linear momentum at the end."""
        return self.start_kg_m_s + self.moved_kg_m_s

    @property
    def explained(self) -> int:
        """The number of explained samples."""
        return self.samples - int(self.segments[UNEXPLAINED])

    def add(self, judged: SampleStatus) -> None:
        """Add a chunk of explained steps."""
        self.samples += len(judged.steps)
        self.segments += np.bincount(judged.segment, minlength=len(SEGMENTS))
        kept = judged.unexplained[judged.explained]
        self.remainder = max(self.remainder, float(kept.max(initial=0.0)))
        left = judged.why >= 0
        for number in np.unique(judged.why[left]).tolist() if left.any() else ():
            rows = np.flatnonzero(judged.why == number)
            why = self.unexplained.setdefault(WHYS[number], UnexplainedSamples())
            if not why.samples:
                why.first_step = int(judged.steps[rows[0]])
            why.samples += len(rows)
            why.remainder = max(why.remainder, float(judged.unexplained[rows].max()))
        for steps in judged.intervals:
            self._jump_to(steps)
            self._add(steps)

    def _jump_to(self, steps: BodySteps) -> None:
        """Add the change between two chunks, made by calls or by a new body with the same id."""
        begin, last = _End.first(steps), self._last
        if last is not None and last.same(begin):
            return
        energy, momentum = begin.energy()
        if last is None:
            self.start_j, self.start_kg_m_s = energy, momentum
            return
        end_j, end_kg_m_s = last.energy()
        self._set(energy - end_j, momentum - end_kg_m_s)

    def _set(self, energy_j: float, momentum_kg_m_s: Float64) -> None:
        self.changed_j += energy_j
        self.energy_j["set"] += energy_j
        self.moved_kg_m_s = self.moved_kg_m_s + momentum_kg_m_s
        self.momentum_kg_m_s["set"] = self.momentum_kg_m_s["set"] + momentum_kg_m_s

    def _add(self, steps: BodySteps) -> None:
        changes = steps.changes
        self.covered &= steps.covered or not steps.law.tree.size
        self._set(changes.set_j, changes.set_kg_m_s)
        self.changed_j += changes.changed_j - changes.set_j
        self.moved_kg_m_s = self.moved_kg_m_s + (changes.moved_kg_m_s - changes.set_kg_m_s)
        for name, given_j in changes.given_j.items():
            self.energy_j[name] = self.energy_j.get(name, 0.0) + given_j
        for name, impulse in changes.given_kg_m_s.items():
            before = self.momentum_kg_m_s.get(name, np.zeros(3))
            self.momentum_kg_m_s[name] = before + impulse
        self._last = _End.last(steps)


@dataclass(frozen=True, eq=False)
class _End:
    """State, energy and momentum at the start or the end of a chunk's steps."""

    law: DampedTree
    state: States
    gravity_m_s2: Float64
    """Gravity [m/s²], shape (1, 3)."""

    @staticmethod
    def first(steps: BodySteps) -> _End:
        """Return the state at the start of the first step."""
        one, whole = np.array([steps.rows.start]), steps.whole
        return _End(steps.law, whole.before.at(one), whole.reported.gravity_m_s2[one])

    @staticmethod
    def last(steps: BodySteps) -> _End:
        """Return the state at the end of the last step."""
        one, whole = np.array([steps.rows.stop - 1]), steps.whole  # copies, so the batch is freed
        return _End(steps.law, whole.after.at(one), whole.reported.gravity_m_s2[one])

    def energy(self) -> tuple[float, Float64]:
        """Return the energy [J] and the linear momentum, shape (3,)."""
        energy, momentum = energy_of(self.law, self.state, self.gravity_m_s2)
        return float(energy[0]), momentum[0]

    def same(self, other: _End) -> bool:
        """Return whether two states are bitwise equal."""
        names = "position_m", "orientation", "joints", "velocity"
        return (
            self.law is other.law
            and np.array_equal(self.gravity_m_s2, other.gravity_m_s2)
            and all(np.array_equal(getattr(self.state, x), getattr(other.state, x)) for x in names)
        )
