"""`creeps`: what rests on something slips slowly, though friction would hold it."""

from __future__ import annotations

from collections.abc import Mapping

from drop_physics.messages import Message
from drop_physics.rules.answer import Level
from drop_physics.rules.slides import Slides, Slip

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

    code = "creeps"
    level: Level = "model"
    speeds_m_s = 1e-7, 0.02
    least_share = 0.0  # what is to stay is asked about by the millimetre

    def says(self, run: Slip, least_m: float) -> bool:
        """Whether it went somewhere that friction could have kept it from."""
        of = run.of
        return bool(
            run.last - run.first >= LASTS
            and of["went"] > least_m
            and min(of["slid"], of["went"]) > STRAIGHT * max(of["slid"], of["moved"])
            and run.most_m_s * of["time"] < STEADY * of["went"]
            and max(of["needed"], abs(of["used"])) < AT_LIMIT * of["available"]
        )

    def words(self, run: Slip, labels: Mapping[str, object]) -> tuple[Message, Message, float]:
        """Return what is said of a body and what it creeps on."""
        of, seconds = run.of, run.of["time"]
        message = Message(
            "{body} creeps {moved:.3g} mm on {on} in {time:.3g} s: friction there could give "
            "{available:.3g} N and staying takes {needed:.3g} N, but the solver ends before the "
            "contact is at rest",
            **labels,
            moved=of["went"] * 1e3,
            time=seconds,
            available=of["available"] / seconds,
            needed=of["needed"] / seconds,
        )
        return (
            message,
            Message(
                "call p.setPhysicsEngineParameter(solverResidualThreshold=0, "
                "numSolverIterations=500)"
            ),
            of["went"],
        )
