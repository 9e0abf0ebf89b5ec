"""Explanations of steps, received as arrays from the process with the script's MuJoCo."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Float64 = NDArray[np.float64]

TOUCH = np.dtype(
    [
        ("step", np.int64),
        ("first", np.int32),
        ("second", np.int32),
        ("friction", np.float64, 5),
        ("distance_m", np.float64),
        ("position_m", np.float64, 3),
        ("normal", np.float64, 3),
        ("force_n", np.float64, 3),
    ]
)
"""A contact point of a step: geoms; friction coefficients (two tangential, torsional, two rolling);
normal from the first to the second; force on the second. World axes."""


class ImpulseTerm(NamedTuple):
    """A named term of a step's momentum balance, such as gravity or one actuator."""

    kind: str
    """`gravity`, `bias`, `spring`, `damper`, `fluid`, `adhesion`, `gravity compensation`,
    `passive callback`, `tendon`, `actuator`, `joint force range`, `applied`, `pushed`, `equality`,
    `friction loss`, `tendon friction`, `limit`, `tendon limit`, `push`, `friction`, `integrator`,
    `solver`."""
    first: int
    """Index of the tendon, actuator, body (for `pushed`), equality, joint or geom; -1 if there is
    none."""
    second: int
    """Index of the other geom in a pair, or -1."""
    dofs: NDArray[np.int64]
    """The degrees of freedom on which it acts."""


@dataclass
class Vocabulary:
    """A model's terms, geom pairs and sets of terms, to which explained chunks refer by index."""

    terms: list[ImpulseTerm] = field(default_factory=list)
    patterns: list[NDArray[np.int64]] = field(default_factory=list)
    pairs: Float64 = field(default_factory=lambda: np.zeros((0, 7)))


@dataclass(frozen=True)
class ReplayedPiece:
    """The explanation of consecutive steps of one simulation, replayed together."""

    world: int
    model: int
    first: int
    """Index of the first step."""
    status: NDArray[np.uint8]
    """Outcome of each step, `EXPLAINED`, `REPLAYED` or `OTHER` of `explain.reasons`, shape (n,)."""
    reason: NDArray[np.uint8]
    """Why a step is not `EXPLAINED`, as an index into `REASONS`, shape (n,)."""
    steps: NDArray[np.int64]
    """The steps that have a sum, shape (k,)."""
    pattern: NDArray[np.int32]
    """Index of each step's list of terms, shape (k,)."""
    values: Float64
    """Impulses [N s or N m s], step by step, then term by term, then by degree of freedom."""
    remainder: NDArray[np.float32]
    """The part of M (u' - u) that no term explains, as a share of the largest impulse, shape
    (k,)."""
    largest: NDArray[np.float32]
    """The largest impulse of each step, shape (k,)."""
    touches: NDArray[Any]
    """The contact points, of dtype `TOUCH`."""
    vocabulary: Vocabulary

    def impulses(self, nv: int) -> dict[tuple[str, int, int], Float64]:
        """Return each cause's impulses on all degrees of freedom, shape (k, nv)."""
        found: dict[tuple[str, int, int], Float64] = {}
        patterns, terms = self.vocabulary.patterns, self.vocabulary.terms
        widths = [sum(len(terms[number].dofs) for number in pattern) for pattern in patterns]
        begins = np.cumsum([0, *(widths[which] for which in self.pattern)])
        for which in np.unique(self.pattern):
            steps = np.flatnonzero(self.pattern == which)
            at = begins[steps]
            for number in patterns[which]:
                kind, first, second, dofs = terms[number]
                full = found.setdefault((kind, first, second), np.zeros((len(self.steps), nv)))
                index = at[:, None] + np.arange(len(dofs))
                full[steps[:, None], dofs] += self.values[index]
                at = at + len(dofs)
        return found


def piece_of(
    said: dict[str, Any], arrays: dict[str, NDArray[Any]], vocabulary: Vocabulary
) -> ReplayedPiece:
    """Decode the explanation of a chunk, and add new terms to the vocabulary."""
    vocabulary.terms += [
        ImpulseTerm(kind, first, second, np.array(dofs, np.int64))
        for kind, first, second, dofs in said.get("terms", [])
    ]
    vocabulary.patterns += [np.array(each, np.int64) for each in said.get("patterns", [])]
    if said.get("pairs"):
        vocabulary.pairs = np.concatenate([vocabulary.pairs, said["pairs"]])
    steps = arrays.get("steps", np.zeros(0, np.int32)).astype(np.int64)
    none = np.zeros(0, np.float32)
    return ReplayedPiece(
        world=said["world"],
        model=said["model"],
        first=said["first"],
        status=arrays["status"],
        reason=arrays["reason"],
        steps=steps,
        pattern=arrays.get("pattern", np.zeros(0, np.int32)),
        values=arrays.get("values", np.zeros(0)),
        remainder=arrays.get("remainder", none),
        largest=arrays.get("largest", none),
        touches=_touches(steps, arrays, vocabulary.pairs),
        vocabulary=vocabulary,
    )


def _touches(
    steps: NDArray[np.int64], arrays: dict[str, NDArray[Any]], pairs: Float64
) -> NDArray[Any]:
    """Return the contact points in a chunk's steps."""
    if "point.count" not in arrays:
        return np.zeros(0, TOUCH)
    found = np.zeros(len(arrays["point.pair"]), TOUCH)
    of_pair = pairs[arrays["point.pair"]]
    found["step"] = np.repeat(steps, arrays["point.count"])
    found["first"], found["second"], found["friction"] = (
        of_pair[:, 0],
        of_pair[:, 1],
        of_pair[:, 2:],
    )
    found["distance_m"], found["position_m"] = arrays["point.distance"], arrays["point.position"]
    found["normal"], found["force_n"] = arrays["point.normal"], arrays["point.force"]
    return found
