"""`deep-penetration`, `constraint-lags`: what a model holds apart or together softly."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from drop_physics.messages import Message
from drop_physics.physics.kinematics import kinematics
from drop_physics.rules.answer import Answer, Cure, Effect, Finding, Noted, Notes, Scene
from drop_physics.rules.body_properties import size_m
from drop_physics.rules.engines import MUJOCOS
from drop_physics.rules.joint import effort
from drop_physics.rules.thresholds import LAG_SHARE, LEFT_M, SINKS_M, SINKS_STEPS, STEADY_SHARE
from drop_physics.trace.events import Equality

Float64 = NDArray[np.float64]

USUAL_S, USUAL_SHARE = 0.02, 0.9
"""MuJoCo's own time constant of `solref`, and the share of `solimp` from the first touch on."""
BASE = -1


class SinksIn(Answer):
    """A contact softer than MuJoCo's own lets a body that rests on it sink in."""

    engines = MUJOCOS

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._found: Notes[tuple[int, int]] = Notes()
        """How deep it stays [m], by pair."""

    def see(self) -> None:
        """Take a piece."""
        pairs = self.scene.touches.pairs
        for first, second, rows in pairs.by_pair():
            its = rows[-SINKS_STEPS:]
            if first == second or len(its) < SINKS_STEPS:
                continue
            depth = pairs.depth_m[its]
            lasts = pairs.step[its[-1]] - pairs.step[its[0]] == len(its) - 1
            if not lasts or depth.min() < SINKS_M or np.ptp(depth) > STEADY_SHARE * depth.max():
                continue
            points = pairs.points
            mine = np.flatnonzero(pairs.row == its[-1])
            deepest = mine[np.argmin(points.distance_m[mine])]
            told = {
                "links": points.link[deepest][None],
                "force": pairs.normal_n[its[-1:]],
            }
            self._found.add((first, second), pairs.step[its[-1:]], depth[-1:], told)

    def findings(self) -> Iterator[Finding]:
        """Yield each pair whose contact is softer than usual."""
        for (first, second), noted in self._found.items():
            one, two = noted.at["links"]
            held = self.scene.seen.softness
            soft = held.get((first, one, second, two), held.get((second, two, first, one)))
            if soft is None:
                continue
            solref, solimp = soft
            text = " ".join(f"{each:g}" for each in solref)
            name, usual = "solref", "0.02 1"
            if solimp[1] < USUAL_SHARE or (solimp[0] < USUAL_SHARE and noted.most < solimp[2]):
                text = " ".join(f"{each:g}" for each in solimp[:3])
                name, usual = "solimp", "0.9 0.95 0.001"
            elif not solref[0] > USUAL_S:
                continue
            body, other = self.scene.body(second), self.scene.body(first)
            if not body.moving:
                body, other = other, body
            call = Message('{name}="{usual}" of both <geom>s', name=name, usual=usual)
            yield Finding(
                code="deep-penetration",
                level="model",
                message=Message(
                    "{body} stays {depth:.3g} mm inside {other} under {force}: their contact has "
                    "{name} {text}, which is softer than MuJoCo's own {usual}",
                    body=body.label,
                    depth=noted.most * 1e3,
                    other=other.label,
                    force=effort(noted.at["force"], "N"),
                    name=name,
                    text=text,
                    usual=usual,
                ),
                advice=call,
                cure=Cure("solref", body.label, None, call),
                body=body.label,
                other=other.label,
                effect=Effect(noted.most, "m"),
                share=noted.most / size_m(body),
                steps=noted.span,
            )


class ConstraintLags(Answer):
    """What is held to a body that only calls move follows behind: that body has no velocity."""

    engines = MUJOCOS

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._moved = {each.body.number for each in scene.seen.puts}
        self._held = [each for each in scene.seen.equalities if self._leads(each) is not None]
        self._offsets: dict[int, Float64] = {}
        """How far links were apart at first [m], by the place of their equality."""
        self._found: dict[int, tuple[float, float, Noted]] = {}
        """The longest steady lag [m], its speed [m/s] and steps, by the place of an equality."""

    def _leads(self, equality: Equality) -> tuple[int, int, int] | None:
        """Return the body that calls move, and body and link that follow it."""
        for lead, body, link in (
            (equality.body_a, equality.body_b, equality.link_b),
            (equality.body_b, equality.body_a, equality.link_a),
        ):
            leader = self.scene.body(lead)
            if lead in self._moved and not leader.moving and self.scene.body(body).moving:
                return lead, body, link
        return None

    def see(self) -> None:
        """Take a piece."""
        for place, equality in enumerate(self._held):
            lead, body, link = self._leads(equality) or (0, 0, 0)
            for _, steps in self.scene.stretches(body):
                if link >= steps.law.tree.links:
                    continue
                at_m = kinematics(steps.law.tree, steps.before).position_m(link)
                # Where it is as a step begins: what is written before it counts.
                led_m = self.scene.records[lead].told(steps.steps)[:, :3]
                apart = led_m - at_m
                first = self._offsets.setdefault(place, apart[0])
                dt = steps.reported.timestep_s
                if len(steps) < SINKS_STEPS:
                    continue
                last = slice(len(steps) - SINKS_STEPS, len(steps))
                lag = np.linalg.norm(apart[last] - first, axis=1)
                speed = np.linalg.norm(np.diff(led_m[last], axis=0), axis=1) / dt[last][1:]
                known = self._found.get(place, (0.0,))[0]
                steady = max(
                    np.ptp(lag) - STEADY_SHARE * lag.max(),
                    np.ptp(speed) - STEADY_SHARE * speed.max(),
                )
                if steady <= 0 and lag[-1] > max(known, LEFT_M):
                    noted = Noted(int(steps.steps[last][0]))
                    noted.go_on(steps.steps[last])
                    self._found[place] = float(lag[-1]), float(speed.mean()), noted

    def findings(self) -> Iterator[Finding]:
        """Yield each equality whose lag is what its time constant gives."""
        for place, (lag_m, speed_m_s, noted) in self._found.items():
            equality = self._held[place]
            lead, number, _ = self._leads(equality) or (0, 0, 0)
            constant_s, ratio = (*equality.solref, 1.0)[:2]
            lasts_s = 2 * constant_s * ratio**2
            if not constant_s > 0 or not speed_m_s > 0:
                continue
            if abs(lag_m / speed_m_s - lasts_s) > LAG_SHARE * lasts_s:
                continue
            body = self.scene.body(number)
            settings = self.scene.seen.settings[-1].values
            least_s = 2 * float(np.ravel(settings["fixedTimeStep"])[0])
            call = Message(
                'solref="{least:g} 1" of the <{kind}>, the least for this timestep, leaves '
                "{left:.2g} mm",
                least=least_s,
                kind=equality.kind,
                left=2 * least_s * speed_m_s * 1e3,
            )
            yield Finding(
                code="constraint-lags",
                level="model",
                message=Message(
                    "{body} follows {lead} {lag:.3g} mm behind: {lead} is moved at {speed:.3g} m/s "
                    "and has no velocity for MuJoCo, so what is held to it is 2 × the time "
                    "constant of solref = {lasts:.3g} s late",
                    body=body.label,
                    lead=self.scene.body(lead).label,
                    lag=lag_m * 1e3,
                    speed=speed_m_s,
                    lasts=lasts_s,
                ),
                advice=call,
                cure=Cure("solref", body.label, least_s, call),
                body=body.label,
                other=self.scene.body(lead).label,
                effect=Effect(lag_m, "m"),
                share=lag_m / LEFT_M,
                steps=noted.span,
            )
