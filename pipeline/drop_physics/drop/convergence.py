"""How an error shrinks with the timestep, and its limit: plain functions of both.

Timesteps are always ordered coarse to fine, with the values of a run for each. The observed order
shows whether errors shrink as the method promises; Richardson's extrapolation and the grid
convergence index need no exact solution, only a sequence that converges.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

SAFETY_FACTOR = 1.25
"""Roache's for three grids or more, and an observed order near the formal one."""
LEAST_ORDER, MOST_ORDER = 1e-6, 64.0
"""Bounds of an order: outside them solutions do not converge."""
NEGLIGIBLE = 1e-4
"""Share of the finest error below which damping changes no shown digit of an order."""
ROUNDED = 0.01
"""Share of an error that may be rounding where an order is given: it is then off by up to 0.03."""
CANCELS = 0.01
"""Share of the damping's error that may remain where it and the timestep's cancel."""
GROWS = 1.01
"""Factor by which an error grows that counts as growing."""
NEAR = 10.0
"""Factor beyond the coarsest or finest timestep up to which a timestep is near those tried."""


def observed_orders(timesteps_s: Sequence[float], errors: Sequence[float]) -> list[float | None]:
    """Return ln|e1/e2| / ln(h1/h2) for each pair of neighbours; None where an error is 0.

    Source: W. L. Oberkampf and C. J. Roy, *Verification and Validation in Scientific Computing*,
    Cambridge 2010, section 5.3.1. It is meaningful only where e goes to 0 with h.
    """
    return [
        math.log(abs(e1 / e2)) / math.log(h1 / h2) if e1 and e2 else None
        for h1, h2, e1, e2 in zip(timesteps_s, timesteps_s[1:], errors, errors[1:], strict=False)
    ]


def solution_order(timesteps_s: Sequence[float], solutions: Sequence[float]) -> float | None:
    """Return the order p at which three solutions, coarse to fine, approach their common limit.

    For f = f0 + c h^p it is the root of (f3 - f2)/(f2 - f1) = r21^p (r32^p - 1)/(r21^p - 1), whose
    right side grows with p; with one ratio r it is ln[(f3 - f2)/(f2 - f1)] / ln r. None where they
    do not approach a limit from one side.

    Source: I. B. Celik et al., "Procedure for estimation and reporting of uncertainty due to
    discretization in CFD applications", *J. Fluids Eng.* 130, 078001 (2008), step 3, whose
    fixed-point iteration need not converge where the ratios differ.
    """
    (h3, h2, h1), (f3, f2, f1) = timesteps_s, solutions
    if f2 == f1 or (f3 - f2) / (f2 - f1) <= 0:
        return None
    coarse, fine, quotient = math.log(h3 / h2), math.log(h2 / h1), (f3 - f2) / (f2 - f1)
    low, high = 0.0, MOST_ORDER
    while max(low, LEAST_ORDER) < (order := (low + high) / 2) < high:
        grown = -math.expm1(order * coarse) / math.expm1(-order * fine)
        low, high = (order, high) if grown < quotient else (low, order)
    return order if LEAST_ORDER < order < MOST_ORDER - LEAST_ORDER else None


def richardson(coarse: float, fine: float, *, ratio: float, order: float) -> float:
    """Return the limit f1 + (f1 - f2)/(r^p - 1) of two solutions of order p.

    Source: L. F. Richardson, *Phil. Trans. R. Soc. A* 210, 307 (1911); Oberkampf and Roy, 8.3.
    """
    return fine + (fine - coarse) / (math.pow(ratio, order) - 1)


def grid_convergence_index(coarse: float, fine: float, *, ratio: float, order: float) -> float:
    """Return Fs |(f2 - f1)/f1| / (r^p - 1): a safe bound of the finer solution's relative error.

    Source: P. J. Roache, "Perspective: a method for uniform reporting of grid refinement studies",
    *J. Fluids Eng.* 116, 405 (1994).
    """
    return SAFETY_FACTOR * abs((coarse - fine) / fine) / (math.pow(ratio, order) - 1)


def cancelling_timestep(
    timestep_s: float, *, timestep_m: float, damping_m: float, interaction_m: float
) -> float | None:
    """Return the timestep at which its share, proportional to it, cancels the damping's [s].

    For a fall from rest dt* = 2 damping/(g t). None where they have the same sign, or one is 0, or
    where the interaction, which is proportional to it as well, leaves more than `CANCELS` of it.
    """
    if timestep_m * damping_m >= 0:
        return None
    cancelling_s = -timestep_s * damping_m / timestep_m
    left_m = interaction_m * cancelling_s / timestep_s
    return cancelling_s if abs(left_m) <= CANCELS * abs(damping_m) else None


@dataclass(frozen=True)
class StudiedRun:
    """What a refinement study needs from a run [m]; the terms are those of the error budget."""

    timestep_s: float
    """Its timestep."""
    simulated_m: float
    """Height of the sample at that time."""
    error_m: float
    """Simulated minus free fall."""
    timestep_m: float
    """The timestep's share of the error."""
    damping_m: float
    """The damping's share."""
    interaction_m: float
    """The interaction of the two."""
    rounding_m: float
    """What double precision leaves."""

    @property
    def discretisation_m(self) -> float:
        """Simulated minus damped fall: what is left of the error against the engine's own model."""
        return self.timestep_m + self.interaction_m + self.rounding_m


@dataclass(frozen=True)
class Study:
    """Runs that differ only in the timestep, coarse to fine, and their convergence.

    What needs three runs, or a sequence that converges, is None without.
    """

    runs: tuple[StudiedRun, ...]
    """The runs, coarse to fine."""
    orders_free_fall: list[float | None]
    """Observed orders against free fall: meaningless unless damping is off."""
    orders_damped_fall: list[float | None]
    """Observed orders against damped fall, in continuous time."""
    order: float | None
    """Observed order of the three finest solutions, which needs no theory."""
    extrapolated_m: float | None
    """Richardson's extrapolation of the height."""
    damped_fall_m: float
    """Height that the extrapolation should find."""
    grid_convergence_index: float | None
    """Relative error of the finest height, estimated."""
    relative_error: float | None
    """The same, by theory; None at a height of 0."""
    cancelling_timestep_s: float | None
    """Timestep at which the timestep's share and the damping's cancel."""
    limit_m: float
    """Limit of the error against free fall as the timestep shrinks: the damping's share."""

    @property
    def refining_hurts(self) -> bool:
        """Whether any refinement increased the error against free fall, by 1 % or more."""
        errors = [abs(run.error_m) for run in self.runs]
        return any(fine > GROWS * coarse for coarse, fine in itertools.pairwise(errors))

    @property
    def damping_matters(self) -> bool:
        """Whether the damping's share, which no refinement removes, is not negligible."""
        return abs(self.limit_m) > NEGLIGIBLE * abs(self.runs[-1].error_m)

    def cancels_near(self, time_s: float) -> bool:
        """Return whether the timestep at which errors cancel is near those of the runs.

        A timestep longer than the fall up to the time of the errors [s] does not count.
        """
        if self.cancelling_timestep_s is None or self.cancelling_timestep_s > time_s:
            return False
        coarsest_s, finest_s = self.runs[0].timestep_s, self.runs[-1].timestep_s
        return finest_s / NEAR <= self.cancelling_timestep_s <= coarsest_s * NEAR


def study_of(runs: Sequence[StudiedRun]) -> Study:
    """Return the study of runs with different timesteps; at least two, in any order."""
    ordered = tuple(sorted(runs, key=lambda run: -run.timestep_s))
    steps, heights = [run.timestep_s for run in ordered], [run.simulated_m for run in ordered]
    finest = ordered[-1]
    damped_fall_m = finest.simulated_m - finest.discretisation_m
    changes_m = [abs(fine - coarse) for coarse, fine in itertools.pairwise(heights[-3:])]
    rounding_m = max(abs(run.rounding_m) for run in ordered[-3:])
    known = len(ordered) > 2 and rounding_m <= ROUNDED * min(changes_m)
    order = solution_order(steps[-3:], heights[-3:]) if known else None
    extrapolated_m = index = None
    if order is not None:
        ratio = steps[-2] / steps[-1]
        extrapolated_m = richardson(*heights[-2:], ratio=ratio, order=order)
        if finest.simulated_m:
            index = grid_convergence_index(*heights[-2:], ratio=ratio, order=order)
    return Study(
        runs=ordered,
        orders_free_fall=observed_orders(steps, [_known(run, run.error_m) for run in ordered]),
        orders_damped_fall=observed_orders(
            steps, [_known(run, run.discretisation_m) for run in ordered]
        ),
        order=order,
        extrapolated_m=extrapolated_m,
        damped_fall_m=damped_fall_m,
        grid_convergence_index=index,
        relative_error=(
            abs(finest.discretisation_m / finest.simulated_m) if finest.simulated_m else None
        ),
        cancelling_timestep_s=cancelling_timestep(
            finest.timestep_s,
            timestep_m=finest.timestep_m,
            damping_m=finest.damping_m,
            interaction_m=finest.interaction_m,
        ),
        limit_m=finest.damping_m,
    )


def _known(run: StudiedRun, error_m: float) -> float:
    """Return an error, or 0 where it may be rounding, of which no order is known."""
    return error_m if abs(run.rounding_m) <= ROUNDED * abs(error_m) else 0.0
