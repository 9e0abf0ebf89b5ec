"""Fields drawn at random: `height=uniform:0.5:2`, and a stream of its own for every sample."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from statistics import NormalDist
from typing import Any

import numpy as np

from pipeline.errors import ScenarioError
from pipeline.kinds import INTEGER, TEXT, Vector, number
from pipeline.scenario import Scenario

Stream = np.random.Generator
Numbers = Sequence[float]


@dataclass(frozen=True)
class Distribution:
    """A family of distributions: its parameters by name, how to draw, what must hold for them."""

    parameters: tuple[str, ...]
    draw: Callable[[Stream, Numbers], float]
    holds: Callable[[Numbers], bool] = lambda _: True
    rule: str = ""


def _truncated(stream: Stream, given: Numbers) -> float:
    """Draw by inversion: one random number a sample, however little of the normal is left."""
    mean, spread, low, high = given
    normal = NormalDist(mean, spread)
    share = stream.uniform(normal.cdf(low), normal.cdf(high))
    return min(max(normal.inv_cdf(share), low), high) if 0 < share < 1 else low


def _is_reached(given: Numbers) -> bool:
    mean, spread, low, high = given
    return spread > 0 and NormalDist(mean, spread).cdf(low) < NormalDist(mean, spread).cdf(high)


DISTRIBUTIONS = {
    "uniform": Distribution(
        ("LOW", "HIGH"), lambda s, g: s.uniform(g[0], g[1]), lambda g: g[0] < g[1], "LOW < HIGH"
    ),
    "loguniform": Distribution(
        ("LOW", "HIGH"),
        lambda s, g: math.exp(s.uniform(math.log(g[0]), math.log(g[1]))),
        lambda g: 0 < g[0] < g[1],
        "0 < LOW < HIGH",
    ),
    "normal": Distribution(
        ("MEAN", "SPREAD"), lambda s, g: s.normal(g[0], g[1]), lambda g: g[1] > 0, "SPREAD > 0"
    ),
    "truncnormal": Distribution(
        ("MEAN", "SPREAD", "LOW", "HIGH"),
        _truncated,
        _is_reached,
        "SPREAD > 0, LOW < HIGH, and part of them within 8 SPREAD of MEAN",
    ),
    "lognormal": Distribution(
        ("MEDIAN", "SIGMA"),
        lambda s, g: s.lognormal(math.log(g[0]), g[1]),
        lambda g: g[0] > 0 and g[1] > 0,
        "MEDIAN > 0 and SIGMA > 0",
    ),
    "triangular": Distribution(
        ("LOW", "MODE", "HIGH"),
        lambda s, g: s.triangular(g[0], g[1], g[2]),
        lambda g: g[0] <= g[1] <= g[2] and g[0] < g[2],
        "LOW <= MODE <= HIGH",
    ),
    "exponential": Distribution(
        ("MEAN",), lambda s, g: s.exponential(g[0]), lambda g: g[0] > 0, "MEAN > 0"
    ),
    "integers": Distribution(
        ("LOW", "HIGH"),
        lambda s, g: int(s.integers(int(g[0]), int(g[1]), endpoint=True)),
        lambda g: g[0] < g[1] and all(map(float.is_integer, map(float, g))),
        "LOW < HIGH, both whole numbers and both included",
    ),
}
"""By name; all but `choice`, which takes any values that the option does."""

FORMS = ", ".join(
    [*(":".join((name, *kind.parameters)) for name, kind in DISTRIBUTIONS.items()), "choice:A:B:…"]
)


@dataclass(frozen=True)
class Variation:
    """One field, or one component of a vector, and the distribution it is drawn from."""

    field: str
    axis: int | None
    """0, 1 or 2 for x, y or z of a vector, roll, pitch or yaw; None for a whole field."""
    kind: str
    values: tuple[Any, ...]
    """The distribution's parameters, or what `choice` chooses from."""

    def draw(self, stream: Stream) -> Any:  # noqa: ANN401
        """Return one value."""
        if self.kind == "choice":
            return self.values[int(stream.integers(len(self.values)))]
        return DISTRIBUTIONS[self.kind].draw(stream, self.values)


def stream_of(seed: int, sample: int) -> Stream:
    """Return a sample's own random numbers: the same, whoever draws it and in whichever order.

    Source: numpy, "Parallel random number generation", `SeedSequence` with a spawn key.
    """
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(sample,)))


def drawn(
    variations: Sequence[Variation], given: dict[str, Any], *, seed: int, sample: int
) -> dict[str, Any]:
    """Return the given fields with the values of one sample in them.

    Parameters
    ----------
    variations
        What to draw, in the order of drawing.
    given
        The fields as they are without drawing: the other components of a vector are kept.
    seed, sample
        Which sample.
    """
    stream, values = stream_of(seed, sample), dict(given)
    for variation in variations:
        value = variation.draw(stream)
        if variation.axis is None:
            values[variation.field] = value
        else:
            whole: Vector = values.get(variation.field, (0.0, 0.0, 0.0))
            values[variation.field] = (
                *whole[: variation.axis],
                value,
                *whole[variation.axis + 1 :],
            )
    return values


# -- reading --------------------------------------------------------------------------------------


def variations_of(texts: Sequence[str]) -> tuple[Variation, ...]:
    """Read `--vary` options; they are drawn in the order of the scenario's options.

    Raises
    ------
    ScenarioError
        If one cannot be read, or two vary the same thing.
    """
    order = list(Scenario.options())
    found = sorted(map(_variation, texts), key=lambda one: (order.index(one.field), one.axis or 0))
    for one, two in itertools.pairwise(found):
        if one.field == two.field and (one.axis == two.axis or None in (one.axis, two.axis)):
            raise ScenarioError(f"--vary must vary a field once, got {one.field} twice")
    return tuple(found)


def _variation(text: str) -> Variation:
    target, equals, form = text.partition("=")
    kind, *parameters = form.strip().split(":")
    if not equals:
        raise ScenarioError(
            f"--vary takes NAME=DISTRIBUTION such as height=uniform:0.5:2, got {text!r}"
        )
    field, axis = _target(target.strip().replace("-", "_"), text)
    option = Scenario.options()[field]
    if kind == "choice" and len(parameters) > 1:
        try:
            values = tuple(map(option.read if axis is None else number, parameters))
            for value in values:
                option.check(value)
        except ScenarioError as error:
            raise ScenarioError(f"--vary {text!r} cannot be drawn: {error.in_options}") from None
        return Variation(field, axis, kind, values)
    if kind not in DISTRIBUTIONS or len(parameters) != len(DISTRIBUTIONS[kind].parameters):
        raise ScenarioError(f"--vary takes one of {FORMS}, got {text!r}")
    if axis is None and (option.kind is TEXT or option.kind.components):
        raise ScenarioError(f"--vary takes choice:A:B:… for {target}, got {text!r}")
    if (option.kind is INTEGER) != (kind == "integers"):
        raise ScenarioError(f"--vary takes integers:LOW:HIGH for whole numbers only, got {text!r}")
    try:
        values = tuple(number(parameter) for parameter in parameters)
    except ScenarioError:
        raise ScenarioError(f"--vary takes numbers after {kind}, got {text!r}") from None
    if not (all(map(math.isfinite, values)) and DISTRIBUTIONS[kind].holds(values)):
        raise ScenarioError(f"--vary must have {DISTRIBUTIONS[kind].rule} for {kind}, got {text!r}")
    try:
        DISTRIBUTIONS[kind].draw(stream_of(0, 0), values)
    except (ValueError, OverflowError) as error:  # a range that is too wide for numpy
        raise ScenarioError(f"--vary {text!r} cannot be drawn: {error}") from None
    return Variation(field, axis, kind, values)


def _target(name: str, text: str) -> tuple[str, int | None]:
    """Return the field that a name means, `height` or `velocity_z`, and which component of it."""
    targets: dict[str, tuple[str, int | None]] = {}
    for field, option in Scenario.options().items():
        short = option.name.removeprefix("--").replace("-", "_")
        if not option.is_flag:
            targets[short] = field, None
        parts = enumerate(option.kind.components)
        targets |= {f"{short}_{part}": (field, place) for place, part in parts}
    if name not in targets:
        near = get_close_matches(name, targets, n=1)
        known = f"did you mean {near[0]}?" if near else f"one of {', '.join(targets)}"
        raise ScenarioError(f"--vary takes the name of a scenario option, got {text!r}; {known}")
    return targets[name]
