"""`creeps`: what rests on something, or is held by it, slips slowly, though friction is enough."""

from __future__ import annotations

import numpy as np

from drop_physics.analysis.answers.answer import Effect, Finding, Span
from drop_physics.analysis.answers.asked_of_bodies import size_m
from drop_physics.analysis.answers.slides import LEAST_M, LEAST_SHARE, Run, Slides
from drop_physics.messages import Message

AT_LIMIT = 0.9
LASTS = 100
"""Steps: shorter, it comes to rest."""
STEADY = 10
"""Times its mean, up to which it is at its fastest: faster, it settled."""
STRAIGHT = 0.5
"""Of the ways, what is left where they are added up: what trembles gets nowhere, and what rolls
slips less than it goes."""


class Creeps(Slides):
    """The solver ends before contacts are at rest: once it changes little, or has no iterations."""

    speeds_m_s = 1e-7, 0.02

    def says(self, run: Run, body_m: float) -> bool:
        """Whether it went somewhere that friction could have kept it from."""
        slid, moved, _, _, available, used = run.sums[:6]
        went = float(np.linalg.norm(run.sums[9:]))
        return bool(
            run.last - run.first >= LASTS
            and went > max(LEAST_M, LEAST_SHARE * body_m)
            and min(slid, went) > STRAIGHT * max(slid, moved)
            and run.most_m_s * float(run.sums[2]) < STEADY * went
            and run.needed_n_s < AT_LIMIT * available
            and abs(used) < AT_LIMIT * available
        )

    def finding(self, body: int, other: int, run: Run) -> Finding:
        """Return what is said of a body and what it creeps on."""
        went, (seconds, _, available) = float(np.linalg.norm(run.sums[9:])), run.sums[2:5].tolist()
        on = self.scene.body(other).label
        return Finding(
            code="creeps",
            level="model",
            message=Message(
                "creeps {moved:.3g} mm on {on} in {time:.3g} s: friction there could give "
                "{available:.3g} N and staying takes {needed:.3g} N, but the solver ends before "
                "the contact is at rest",
                moved=went * 1e3, on=on, time=seconds, available=available / seconds,
                needed=run.needed_n_s / seconds,
            ),
            advice=Message(
                "call p.setPhysicsEngineParameter(solverResidualThreshold=0, "
                "numSolverIterations=500)"
            ),
            body=self.scene.body(body).label,
            other=on,
            effect=Effect(went, "m"),
            share=went / size_m(self.scene.body(body)),
            steps=Span(run.first, run.last, run.last - run.first + 1),
        )  # fmt: skip
