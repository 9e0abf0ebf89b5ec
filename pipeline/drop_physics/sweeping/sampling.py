"""Draws fields at random: `height=uniform:0.5:2`, from a random stream for each sample."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from statistics import NormalDist
from typing import Any

import numpy as np

from drop_physics.errors import ScenarioError
from drop_physics.messages import Message
from drop_physics.option_types import INTEGER, TEXT, Vector, number
from drop_physics.scenario import Scenario

Stream = np.random.Generator
Numbers = Sequence[float]


@dataclass(frozen=True)
class Distribution:
    """A family of distributions: parameter names, how to draw, and a check of the parameters."""

    parameters: tuple[str, ...]
    draw: Callable[[Stream, Numbers], float]
    is_valid: Callable[[Numbers], bool] = lambda _: True
    rule: str = ""


def _truncated(stream: Stream, given: Numbers) -> float:
    """Draw by inversion: one random number per sample, even for a narrow range."""
    mean, spread, low, high = given
    normal = NormalDist(mean, spread)
    share = stream.uniform(normal.cdf(low), normal.cdf(high))
    return min(max(normal.inv_cdf(share), low), high) if 0 < share < 1 else low


def _can_truncate(given: Numbers) -> bool:
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
        _can_truncate,
        Message("SPREAD > 0, LOW < HIGH, and part of them within 8 SPREAD of MEAN"),
    ),
    "lognormal": Distribution(
        ("MEDIAN", "SIGMA"),
        lambda s, g: s.lognormal(math.log(g[0]), g[1]),
        lambda g: g[0] > 0 and g[1] > 0,
        Message("MEDIAN > 0 and SIGMA > 0"),
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
        Message("LOW < HIGH, both whole numbers and both included"),
    ),
}
"""Distributions by name; in addition, `choice` chooses from any values of the option."""

FORMS = ", ".join(
    [*(":".join((name, *kind.parameters)) for name, kind in DISTRIBUTIONS.items()), "choice:A:B:…"]
)


@dataclass(frozen=True)
class RandomField:
    """A field, or one component of a vector, and the distribution from which it is drawn."""

    field: str
    axis: int | None
    """Index of the component: 0, 1 or 2 for x, y or z, or for roll, pitch or yaw; None for a whole
    field."""
    kind: str
    values: tuple[Any, ...]
    """Parameters of the distribution; for `choice`, the possible values."""

    def draw(self, stream: Stream) -> Any:  # noqa: ANN401
        """Draw one value."""
        if self.kind == "choice":
            return self.values[int(stream.integers(len(self.values)))]
        return DISTRIBUTIONS[self.kind].draw(stream, self.values)


def stream_of(seed: int, sample: int) -> Stream:
    """Return a sample's random stream, which depends only on seed and sample.

    Source: numpy, "Parallel random number generation", `SeedSequence` with a spawn key.
    """
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(sample,)))


def drawn(
    variations: Sequence[RandomField], given: dict[str, Any], *, seed: int, sample: int
) -> dict[str, Any]:
    """Add the values drawn for one sample to the given fields.

    Parameters
    ----------
    variations
        The fields to draw, in this order.
    given
        The fields with fixed values; of a vector, components that are not drawn are kept.
    seed, sample
        The seed of the sweep, and the index of the sample.
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


def variations_of(texts: Sequence[str]) -> tuple[RandomField, ...]:
    """Parse `--vary` options; values are drawn in the order of the scenario's options.

    Raises
    ------
    ScenarioError
        If an option cannot be read, or two options vary the same field.
    """
    order = list(Scenario.options())
    variations = sorted(
        map(_variation, texts), key=lambda varied: (order.index(varied.field), varied.axis or 0)
    )
    for first, second in itertools.pairwise(variations):
        axes = (first.axis, second.axis)
        if first.field == second.field and (first.axis == second.axis or None in axes):
            raise ScenarioError(
                "--vary must vary a field once, got {field} twice", field=first.field
            )
    return tuple(variations)


def _variation(text: str) -> RandomField:
    try:
        return _read(text)
    except (ScenarioError, ValueError, OverflowError) as error:  # numpy's: of too wide a range
        reason = error.in_options if isinstance(error, ScenarioError) else str(error)
        raise ScenarioError(
            "--vary {text!r} cannot be drawn: {reason}", text=text, reason=reason
        ) from None


def _read(text: str) -> RandomField:
    """Parse NAME=DISTRIBUTION, and test it by drawing once; an error states the expected form."""
    target, equals, form = text.partition("=")
    kind, *parameters = form.strip().split(":")
    if not equals:
        raise ScenarioError("it must be NAME=DISTRIBUTION, such as height=uniform:0.5:2")
    field, axis = _target(target.strip().replace("-", "_"))
    option = Scenario.options()[field]
    if kind == "choice" and len(parameters) > 1:
        chosen = tuple(map(option.read if axis is None else number, parameters))
        for value in chosen:
            option.check(value)
        return RandomField(field, axis, kind, chosen)
    distribution = DISTRIBUTIONS.get(kind)
    if distribution is None or len(parameters) != len(distribution.parameters):
        raise ScenarioError("it must be one of {forms}", forms=FORMS)
    if axis is None and (option.kind is TEXT or option.kind.components):
        raise ScenarioError("{field} takes choice:A:B:…", field=target)
    if (option.kind is INTEGER) != (kind == "integers"):
        raise ScenarioError("integers:LOW:HIGH is for whole numbers, and for these only")
    try:
        values = tuple(map(number, parameters))
    except ScenarioError:
        raise ScenarioError("{kind} takes numbers", kind=kind) from None
    if not (all(map(math.isfinite, values)) and distribution.is_valid(values)):
        raise ScenarioError("{kind} must have {rule}", kind=kind, rule=distribution.rule)
    distribution.draw(stream_of(0, 0), values)
    return RandomField(field, axis, kind, values)


def _target(name: str) -> tuple[str, int | None]:
    """Split a name such as `height` or `velocity_z` into the field and its component."""
    targets: dict[str, tuple[str, int | None]] = {}
    for field, option in Scenario.options().items():
        short = option.name.removeprefix("--").replace("-", "_")
        if not option.is_flag:
            targets[short] = field, None
        parts = enumerate(option.kind.components)
        targets |= {f"{short}_{part}": (field, axis) for axis, part in parts}
    if name not in targets:
        near = get_close_matches(name, targets, n=3, cutoff=0.0)
        raise ScenarioError(
            "it must name a scenario option, such as {names}", names=", ".join(near)
        )
    return targets[name]
