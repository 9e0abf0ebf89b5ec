"""Detects contact solvers that stop before they converge."""

from __future__ import annotations

import math
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

LEAST_CHANGE = 0.01
"""Largest velocity change in a last iteration at which the solver counts as converged [m/s,
rad/s]."""
ASKED_EVERY = 8
"""Number of steps per requested solver report: a request takes as long as recording a box."""
MOST_ISLANDS = 64
"""Number of groups of touching bodies for which PyBullet has room in a step's return value."""


class Solver:
    """Collects the reports of one client's contact solver."""

    def __init__(self, p: SimpleNamespace, client: int, *, returns: bool | None) -> None:
        self._p, self._client = p, client
        self.returns = returns
        """Whether the script itself has enabled solver reports; None if unknown."""
        self._can = True
        """Whether this PyBullet supports solver reports."""
        self._early: dict[int, dict[str, Any]] = {}
        """Observed steps in which the solver reached its iteration limit, by limit."""

    def ask(self, moving: int) -> bool:
        """Request a solver report from the next step; return whether there will be one.

        Reports are requested only every few steps, since each takes two calls. They do not affect
        the step. But the engine has memory for a limited number of islands of bodies, and reads
        beyond it if there are more: none is requested if too many bodies (`moving`) move.
        """
        if self._can and self.returns is False and moving <= MOST_ISLANDS:
            return self.report(on=True)
        return False

    def report(self, *, on: bool) -> bool:
        """Switch the solver's reports on or off; return whether this PyBullet supports them."""
        try:
            self._p.setPhysicsEngineParameter(
                reportSolverAnalytics=int(on), physicsClientId=self._client
            )
        except TypeError:
            self._can = False
        return self._can

    def note(self, islands: Any, most: int, step: int) -> None:
        """Note from a report whether the solver reached its iteration limit unconverged.

        The reported residual is the square of a change of velocity; non-finite ones are ignored.
        """
        early = self._early.setdefault(
            most,
            {
                "iterations": most,
                "looked": 0,
                "steps": 0,
                "first_step": 0,
                "last_change": 0.0,
                "worst_step": 0,
            },
        )
        early["looked"] += 1
        acted = [
            island["remainingResidual"]
            for island in islands[:MOST_ISLANDS]
            if island["numIterationsUsed"] >= most
        ]
        last = max((change for change in acted if math.isfinite(change)), default=0.0) ** 0.5
        if last <= LEAST_CHANGE:
            return
        early["first_step"] = early["first_step"] or step
        early["steps"] += 1
        if last > early["last_change"]:
            early.update(last_change=last, worst_step=step)

    def noted(self) -> Iterator[dict[str, Any]]:
        """Yield how often each iteration limit was too low; then reset the counts."""
        early, self._early = self._early, {}
        return (each for each in early.values() if each["steps"])
