"""Plans a sweep: derives each run from its number, by value lists and random samples.

The runs are the product of all lists, in the order of `drop simulate --help`: the last option that
has a list changes fastest, and the samples of a scenario are adjacent. No run is computed in
advance: run 999,999,999 takes no longer to derive than run 0.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from drop_physics.errors import ScenarioError
from drop_physics.fields import exact, outside
from drop_physics.messages import Message, shell_command
from drop_physics.scenario import Engine, Scenario
from drop_physics.sweeping.sampling import RandomField, drawn, variations_of

MOST_RUNS = 100_000
"""Largest number of runs in a sweep, since each has a row in memory."""


@dataclass(frozen=True)
class Plan:
    """The runs of a sweep of scenarios, numbered from 0."""

    lists: tuple[tuple[str, tuple[Any, ...]], ...] = ()
    """Values of each field that has a list, in the order of the scenario's options."""
    variations: tuple[RandomField, ...] = ()
    samples: int | None = None
    """Number of sampled runs per scenario; None for one run each, with no random values."""
    seed: int = 0

    @property
    def runs(self) -> int:
        """The number of runs."""
        return math.prod(len(values) for _, values in self.lists) * (self.samples or 1)

    @property
    def axes(self) -> tuple[str, ...]:
        """Fields that have several values."""
        return tuple(name for name, values in self.lists if len(values) > 1)

    @property
    def bodies(self) -> list[str]:
        """Return all bodies that occur in the runs."""
        listed = dict(self.lists).get("body", ())
        choices = [
            value
            for variation in self.variations
            if variation.field == "body"
            for value in variation.values
        ]
        return sorted({*listed, *choices} or {Scenario().body})

    @property
    def engines(self) -> list[Engine]:
        """Return all engines that occur in the runs."""
        return sorted(set(dict(self.lists).get("engine", ())) or {Scenario().engine})

    def sample_of(self, run: int) -> int | None:
        """Return the sample number of a run; None without sampling."""
        return None if self.samples is None else run % self.samples

    def values(self, run: int) -> dict[str, Any]:
        """Return the fields of one run that differ from their defaults."""
        given, sample = self.listed(run // (self.samples or 1)), self.sample_of(run)
        if sample is None:
            return given
        return drawn(self.variations, given, seed=self.seed, sample=sample)

    def listed(self, combination: int) -> dict[str, Any]:
        """Return one combination of a sweep's listed values, before random values are drawn."""
        given = {}
        for name, values in reversed(self.lists):
            combination, index = divmod(combination, len(values))
            given[name] = values[index]
        return {name: given[name] for name, _ in self.lists}


def plan_of(
    given: Mapping[str, Any],
    *,
    samples: int | None = None,
    seed: int = 0,
    vary: Sequence[str] = (),
) -> Plan:
    """Return the plan of a sweep.

    Parameters
    ----------
    given
        The values of each field of `Scenario` that is not at its default: a list, a single value,
        or text as on the command line.
    samples, seed
        The number of runs for each scenario, and the seed of their random values.
    vary
        The fields to draw at random, such as `height=uniform:0.5:2`.

    Raises
    ------
    ScenarioError
        If a value is unreadable or outside its domain, or if options contradict each other.
    """
    lists = _lists_of(given)
    variations = variations_of(vary)
    _check_sampling(samples, seed, variations)
    _check_variations(lists, variations)
    if "floor" not in lists:
        chosen = (
            value
            for variation in variations
            if variation.kind == "choice"
            for value in variation.values
            if variation.field == "height_m"
        )
        for height_m in (*lists.get("height_m", ()), *chosen):
            Scenario(height_m=height_m)
    plan = Plan(tuple(lists.items()), variations, samples, seed)
    if plan.runs > MOST_RUNS:
        raise ScenarioError(
            "a sweep has at most {most:,} runs, got {runs:,}; give fewer values, or --samples",
            most=MOST_RUNS,
            runs=plan.runs,
        )
    return plan


def _lists_of(given: Mapping[str, Any]) -> dict[str, tuple[Any, ...]]:
    """Parse the lists of values by field, in the order of the scenario's options."""
    for name in given.keys() - Scenario.options().keys():
        raise ScenarioError(
            "a sweep takes fields of Scenario, got {name!r}; they are: {fields}",
            name=name,
            fields=", ".join(Scenario.options()),
        )
    lists: dict[str, tuple[Any, ...]] = {}
    for name, spec in Scenario.options().items():
        raw = given.get(name)
        if isinstance(raw, bool):
            lists |= {} if raw else {name: (False,)}
        elif raw is not None:
            lists[name] = Scenario.listed(name, raw)
            if len(set(lists[name])) < len(lists[name]):
                raise ScenarioError(
                    "{option} must list each value once, got {given!r}", option=spec.name, given=raw
                )
    return lists


def _check_sampling(samples: int | None, seed: int, variations: Sequence[RandomField]) -> None:
    if samples is not None and samples < 1:
        raise outside("--samples", Message("at least {low}", low=1), samples)
    if seed < 0:
        raise outside("--seed", Message("at least {low}", low=0), seed)
    if samples is not None and not variations:
        raise ScenarioError(
            "--samples draws nothing without --vary; add --vary height=uniform:0.5:2, or omit it"
        )
    if variations and samples is None:
        raise ScenarioError("--vary needs the number of samples; add --samples 1000")


def _check_variations(
    lists: Mapping[str, tuple[Any, ...]], variations: Sequence[RandomField]
) -> None:
    """Check that no field is both listed and random, and no quaternion has random angles."""
    for variation in variations:
        if variation.axis is None and variation.field in lists:
            option = Scenario.options()[variation.field].name
            raise ScenarioError(
                "{option} is given and drawn by --vary; leave one of them out", option=option
            )
        if variation.field == "orientation" and any(
            len(q) == 4 for q in lists.get(variation.field, ())
        ):
            raise ScenarioError(
                "--orientation must be angles R,P,Y where --vary draws one of them, got a "
                "quaternion; give R,P,Y"
            )


def label_of(values: Mapping[str, Any]) -> str:
    """Name a scenario by its values: `linear damping default, height 2, no floor`."""
    options = Scenario.options()
    return ", ".join(
        name_of(field)
        if options[field].is_flag
        else f"{name_of(field)} {options[field].written(value)}"
        for field, value in values.items()
    )


def name_of(field: str) -> str:
    """Return a field's display name: its option in words."""
    return Scenario.options()[field].name.removeprefix("--").replace("-", " ")


def replay_command(values: Mapping[str, Any], *, out: str) -> str:
    """Return the command that repeats a run, bit for bit.

    Parameters
    ----------
    values
        The fields of the run that are not at their defaults.
    out
        Name of the recording that the command writes.
    """
    words = ["drop", "simulate", "--out", out, "--no-camera"]
    for name, value in values.items():
        spec = Scenario.options()[name]
        if spec.is_flag:
            words += [] if value else [spec.name]
        elif value is not None:
            words += [spec.name, exact(value)]
    return shell_command(*words)
