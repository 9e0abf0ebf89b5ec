"""Finds inverse-kinematics solutions that the script sends to motors, by bitwise equality."""

from __future__ import annotations

from dataclasses import dataclass, field

from drop_physics.rules.arguments import given, number
from drop_physics.trace.acts import Act
from drop_physics.trace.calls import Call
from drop_physics.trace.log import Log
from drop_physics.trace.motors import POSITION

IK_LISTS = ("lowerLimits", "upperLimits", "jointRanges", "restPoses")
"""The arguments that pull solutions towards a pose, if they have a value for each movable joint."""


@dataclass(frozen=True)
class SentAnswer:
    """An inverse-kinematics solution that a script sent to a body's motors."""

    call: Call
    link: int
    point_m: tuple[float, ...]
    place: int
    """Index of the requested point among the body's points that the script requests in turn."""
    times: int
    """Number of earlier solutions for this point."""


@dataclass
class SentAnswers:
    """All inverse-kinematics solutions that a script sent to motors; filled chunk by chunk."""

    latest: dict[int, list[SentAnswer]] = field(default_factory=dict)
    """Solutions by body: those of the latest chunk, and the last one before it."""
    _asked: dict[int, Call] = field(default_factory=dict)
    """The latest request, by body."""

    def see(self, calls: Log) -> None:
        """Add the calls of a chunk."""
        self.latest = {body: sent[-1:] for body, sent in self.latest.items()}
        if not self.latest and not calls.of(Act.SOLVE_IK):
            return
        for call, _, came in calls.of_bodies(Act.SOLVE_IK, Act.COMMAND):
            body, asked = came.body.number, self._asked.get(came.body.number)
            if call.act is Act.SOLVE_IK:
                self._asked[body] = call
            elif asked is not None and number(call, "controlMode") == POSITION:
                self._send(call, asked, body)

    def _send(self, call: Call, asked: Call, body: int) -> None:
        """Note that a solution was sent, if a motor's target equals one of its numbers."""
        targets = given(call, "targetPositions") or given(call, "targetPosition")
        point = given(asked, "targetPosition")
        link = int(number(asked, "endEffectorLinkIndex", -1.0))
        if asked.at.step != call.at.step or asked.result not in targets or len(point) != 3:
            return
        del self._asked[body]
        sent = self.latest.setdefault(body, [])
        place = times = 0
        if sent and (sent[-1].link, sent[-1].point_m) == (link, point):
            place, times = sent[-1].place, sent[-1].times
        elif sent:
            place = sent[-1].place + 1
        sent.append(SentAnswer(asked, link, point, place, times + 1))
