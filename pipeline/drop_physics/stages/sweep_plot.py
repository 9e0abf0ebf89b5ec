"""The plot of a sweep: the error over the timestep, or the heights that engines give."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from drop_physics import colours
from drop_physics.errors import DropError
from drop_physics.figures import convergence_plot, engines_plot, style
from drop_physics.figures.convergence_plot import Refinement
from drop_physics.figures.engines_plot import EngineFall
from drop_physics.figures.style import Build
from drop_physics.files.whole import written_whole
from drop_physics.messages import Message
from drop_physics.scenario import ENGINES
from drop_physics.stages.sweep_engines import MOST_RUNS, EngineTrajectory
from drop_physics.stages.sweep_groups import Group
from drop_physics.sweeping.folder import TERMS
from drop_physics.sweeping.plan import Plan, label_of


def plot_sweep(
    path: Path,
    plan: Plan,
    studies: Sequence[Group],
    falls: Sequence[EngineTrajectory],
    *,
    at_s: float,
    at_samples: bool,
    dark: bool,
    force: bool,
) -> None:
    """Plot the errors over the timestep, or where that does not vary, the engines' heights.

    Parameters
    ----------
    path
        The `.png` or `.svg` file.
    plan
        Which scenarios there are.
    studies, falls
        What they show together, by timestep and by engine.
    at_s, at_samples
        The time of the errors [s], and whether every run has a sample at it.
    dark, force
        As for `sweep`.

    Raises
    ------
    DropError
        If there is nothing to show.
    """
    if "timestep_s" not in plan.axes:
        build = _build_engines(plan, falls)
    else:
        title = Message("The error after {at:g} s, by timestep", at=at_s)
        if not at_samples:
            title = Message("The error at the samples nearest to {at:g} s, by timestep", at=at_s)
        build = _build_refinements(studies, title)
    with written_whole(path, force=force) as file:
        file.write(style.rendered(build, path.suffix[1:], dark=dark))


def _build_engines(plan: Plan, falls: Sequence[EngineTrajectory]) -> Build:
    if not falls:
        raise DropError(
            "--plot has nothing to show: engines are compared in sweeps of up to {most} runs "
            "without --samples; list fewer values, or omit --plot",
            most=MOST_RUNS,
        )
    drawn = [
        EngineFall(
            label=_short_label(plan, fall.run.run),
            colour=colours.ENGINES[fall.run.engine],
            time_s=np.arange(len(fall.height_m)) * np.float64(fall.run.timestep_s),
            height_m=fall.height_m,
            floor_height_m=fall.floor_height_m,
        )
        for fall in falls
    ]
    return functools.partial(engines_plot.build_figure, drawn)


def _short_label(plan: Plan, run: int) -> str:
    """Return an engine's name, and the other values that differ."""
    values = plan.values(run)
    others = {name: values[name] for name in plan.axes if name != "engine"}
    name = ENGINES[values["engine"]]
    return f"{name}, {label_of(others)}" if others else name


def _build_refinements(studies: Sequence[Group], title: str) -> Build:
    if not studies:
        raise DropError(
            "--plot has nothing to show: the error is broken down for fewer than two timesteps at "
            "one time; try another --at",
        )
    refinements = [
        Refinement(
            title=group.label or Message("all else at its default"),
            timesteps_s=np.array([run.timestep_s for run in group.study.runs]),
            errors_m={
                name.removesuffix("_m").replace("error", "total"): np.array(
                    [getattr(run, name) for run in group.study.runs]
                )
                for name in TERMS
            },
            cancelling_timestep_s=group.study.cancelling_timestep_s,
        )
        for group in studies
        if group.study is not None
    ]
    return functools.partial(convergence_plot.build_figure, refinements, title)
