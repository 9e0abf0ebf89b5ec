"""What is said of recordings whose engine has taken each step again: of MuJoCo, in its words.

Each is read from what was recorded: why a step has no sum, what an actuator gave and what its pose
takes, what was written once and stays.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from drop_physics.explain.driving import given_to, taken
from drop_physics.explain.joints import Driven, target_of
from drop_physics.explain.judged import WHYS
from drop_physics.explain.steps import BodySteps
from drop_physics.messages import Message
from drop_physics.physics.dynamics import mass_matrix
from drop_physics.physics.kinematics import kinematics
from drop_physics.rules.answer import Answer, Effect, Finding, Scene, Span, so_many
from drop_physics.rules.thresholds import AT_TARGET_M, AT_TARGET_RAD, OTHER_FORCE, STAYS_STEPS
from drop_physics.trace.calls import Call
from drop_physics.trace.events import Actuator, Body
from drop_physics.trace.states import BASE, between

STALE, RESET = WHYS.index("stale"), WHYS.index("auto-reset")
ELSEWHERE = (WHYS.index("unknown"), WHYS.index("not replayed"))
GROWS = 4.0
"""Above this, kp h² over the inertia, an undamped spring gains in each step of semi-implicit Euler
(x'' = -k x is stable for h² k < 4)."""
HELD = 10
"""At its limit for so many last steps, an actuator is held there."""
OVERLAP_M = 1e-4
"""An overlap before the first step that is meant to be none is deeper [m]."""
DERIVED = ("body_invweight0", "dof_invweight0", "mj_setConst")
"""What a script that edits masses in place changes, too, if it knows; and what does so for it."""


class _Without(NamedTuple):
    """Steps without a sum for one reason."""

    first: int
    last: int
    steps: int
    why: str
    """What made it so, in a sentence, if that is known."""


class NotReplayed(Answer):
    """Steps that another state was behind, or that MuJoCo has undone."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._found: dict[tuple[int, str], _Without] = {}
        """By client and code."""

    def see(self) -> None:
        """Keep the steps of one body of each simulation."""
        seen: set[int] = set()
        for judged in self.scene.judged.values():
            client = judged.body.client
            if client in seen or not any(each.law.tree.size for each in judged.stretches):
                continue
            seen.add(client)
            if not self.scene.piece.impulses.get(client):
                continue  # not replayed, as was asked
            for name, numbers in (("stale", (STALE,)), ("reset", (RESET,)), ("other", ELSEWHERE)):
                steps = judged.steps[np.isin(judged.why, numbers)]
                if len(steps):
                    self._add(client, name, steps.tolist())

    def _add(self, client: int, name: str, steps: list[int]) -> None:
        known = self._found.get((client, name))
        if known is not None:
            self._found[client, name] = known._replace(
                last=steps[-1], steps=known.steps + len(steps)
            )
            return
        why = self._gain(client, steps[0]) if name == "reset" else ""
        self._found[client, name] = _Without(steps[0], steps[-1], len(steps), why)

    def _gain(self, client: int, step: int) -> str:
        """Return which actuator's stiffness the timestep is too long for, before a reset."""
        worst, text = GROWS, ""
        for judged, steps in self.scene.stretches():
            if judged.body.client != client:
                continue
            row = int(np.searchsorted(steps.steps, step)) - 1
            if row < 0 or not steps.law.tree.size:
                continue
            for actuator, ratio in _ratios(judged.body, steps, row):
                if ratio > worst:
                    worst = ratio
                    text = Message(
                        "actuator {name} is stiffer than the timestep allows: kp h² over the "
                        "inertia is {ratio:.3g}, and above 4 each step makes its error larger",
                        name=actuator.name,
                        ratio=ratio,
                    )
        return text

    def findings(self) -> Iterator[Finding]:
        """Yield one for each simulation and reason."""
        for (_, name), found in self._found.items():
            span = Span(found.first, found.last, found.steps)
            if name == "reset":
                message = Message(
                    "MuJoCo resets the simulation by itself in step {step}: a number has become "
                    "too large or is none",
                    step=found.first,
                )
                if found.why:
                    message = Message("{what}; {why}", what=message, why=found.why)
                yield Finding(code="auto-reset", level="broken", message=message, steps=span)
            elif name == "stale":
                yield Finding(
                    code="not-replayed",
                    reason="stale",
                    level="asked",
                    message=Message(
                        "{steps}, the first of them step {step}, used positions and contacts of "
                        "another state: what the script had written was not computed before it",
                        steps=so_many(found.steps),
                        step=found.first,
                    ),
                    advice=Message("compute them: {call}", call="mujoco.mj_forward(m, d)"),
                    steps=span,
                )
            else:
                yield Finding(
                    code="not-replayed",
                    level="repeat",
                    message=Message(
                        "{steps}, the first of them step {step}, lead elsewhere when they are "
                        "taken again: something acts that is not recorded",
                        steps=so_many(found.steps),
                        step=found.first,
                    ),
                    steps=span,
                )


def _ratios(body: Body, steps: BodySteps, row: int) -> Iterator[tuple[Actuator, float]]:
    """Yield the position actuators of a body's joints, each with kp h² over the joint's inertia."""
    tree, h = steps.law.tree, float(steps.reported.timestep_s[row])
    matrix = mass_matrix(kinematics(tree, steps.before.at(np.array([row]))))[0]
    if not np.isfinite(matrix).all():
        return
    easy = np.diag(np.linalg.pinv(matrix))
    for joint, at in zip(body.joints, body.rates, strict=True):
        for actuator in body.actuators:
            if (
                actuator.kind == "position"
                and actuator.target == joint.name
                and joint.widths[1] == 1
            ):
                k = tree.first_rate + at.start
                inertia = 1.0 / easy[k] + 0.5 * h * (joint.damping + actuator.kv)
                yield actuator, actuator.kp * actuator.gear**2 * h * h / inertia


class ServoOff(Answer):
    """Position actuators whose joint is elsewhere: a spring, a limit of force, or of its input."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._found: dict[tuple[int, str], Finding] = {}

    def see(self) -> None:
        """Look at the last step of the piece; what an earlier one showed no longer counts."""
        for driven in self.scene.driven():
            self._found = {
                key: each for key, each in self._found.items() if key[0] != driven.body.number
            }
            if not len(driven.steps):
                continue
            for joint, at in zip(driven.body.joints, driven.body.rates, strict=True):
                k = at.start
                held = len(driven.steps) >= HELD and driven.at_limit[-HELD:, k].all()
                if joint.widths[1] != 1 or not (driven.resting[-1, k] or held):
                    continue
                servos = [
                    each
                    for each in driven.body.actuators
                    if (each.acts_on, each.target) == ("joint", joint.name)
                ]
                if len(servos) == 1 and servos[0].kind == "position" and servos[0].gear:
                    found = self._of(driven, k, servos[0], joint.kind == "prismatic")
                    if found is not None:
                        self._found[driven.body.number, joint.name] = found

    def _of(self, driven: Driven, k: int, servo: Actuator, slides: bool) -> Finding | None:
        near, unit, of = (AT_TARGET_M, "m", "N") if slides else (AT_TARGET_RAD, "rad", "N m")
        given = given_to(servo, driven.body, self.scene.piece, driven.steps.steps[-1:])
        asked = float(given[0]) / servo.gear
        target, reached = float(target_of(driven)[-1, k]), float(driven.after[-1, k])
        torque, gap = float(driven.torque[-1, k]), abs(reached - asked)
        if not gap > near or driven.at_stop[-1, k]:
            return None
        needs = float(self.scene.joints.holding(driven, len(driven.steps) - 1).needs[k])
        reason = ""
        off = reached - target
        if servo.ctrl_range is not None and float(taken(servo, given)[0]) != float(given[0]):
            reason = "ctrlrange"
            low, high = servo.ctrl_range
            message = Message(
                "{joint} ends {gap:.2g} {unit} off the {given:.3g} that its actuator is given: its "
                "ctrlrange is {low:g} to {high:g}",
                joint=servo.target,
                gap=gap,
                unit=unit,
                given=float(given[0]),
                low=low,
                high=high,
            )
            advice = Message("widen it: {call}", call="ctrlrange")
        elif driven.at_limit[-1, k]:
            reason = "forcerange"
            message = Message(
                "{joint} ends {gap:.2g} {unit} off its target of {target:.2f} {unit}: its actuator "
                "is at its forcerange of {limit:.3g} {of}",
                joint=servo.target,
                gap=gap,
                unit=unit,
                target=target,
                limit=float(driven.limit[-1, k]),
                of=of,
            )
            advice = Message("give it more: {call}", call="forcerange")
        elif max(
            abs(torque + servo.gear**2 * servo.kp * off), abs(torque - needs)
        ) <= OTHER_FORCE * abs(torque):  # else something that it touches holds it
            reason = "spring"
            message = Message(
                "{joint} ends {gap:.2g} {unit} off its target of {target:.2f} {unit}: a position "
                "actuator is a spring, and with kp={kp:g} it gives the {torque:.3g} {of} that the "
                "pose takes only when it is that far off",
                joint=servo.target,
                gap=gap,
                unit=unit,
                target=target,
                kp=servo.kp,
                torque=abs(torque),
                of=of,
            )
            advice = Message(
                "a tenth is left with ten times the kp, or use gravcomp: {call}",
                call=f"kp={10 * servo.kp:g}",
            )
        else:
            return None
        step = int(driven.steps.steps[-1])
        return Finding(
            code="off-target",
            reason=reason,
            level="asked",
            message=message,
            advice=advice,
            body=driven.body.label,
            joint=servo.target,
            effect=Effect(gap, unit),
            share=gap / near,
            steps=Span(step, step, 1),
            site=self._site(),
        )

    def _site(self) -> str | None:
        """Return the line before which actuators are given something, if there is one."""
        places = {
            each.place for each in self.scene.piece.calls.sites.values() if each.function == "ctrl"
        }
        return places.pop() if len(places) == 1 else None

    def findings(self) -> Iterator[Finding]:
        """Yield what holds at the end."""
        yield from self._found.values()


class PushStays(Answer):
    """A force from outside that changes once, and acts in every step that follows."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._calls: dict[int, list[Call]] = {}

    def see(self) -> None:
        """Keep what was written."""
        for call in self.scene.piece.calls.named("xfrc_applied"):
            self._calls.setdefault(call.client, []).append(call)

    def findings(self) -> Iterator[Finding]:
        """Yield one for each simulation in which it changed once."""
        for client, calls in self._calls.items():
            end = self.scene.seen.samples.get(client, 0) - 1
            steps = end - calls[0].at.step
            if len(calls) > 1 or steps < STAYS_STEPS:
                continue
            values = _values(calls[0])
            names = {
                cause.name
                for cause in self.scene.seen.causes.values()
                if cause.client == client and cause.kind == "applied" and cause.name
            }
            size = float(np.linalg.norm(values))
            if len(names) != 1 or not size > 0:
                continue
            first = calls[0].at.step + 1
            yield Finding(
                code="push-stays",
                level="note",
                message=Message(
                    "{body} is pushed in all {steps} since step {step}: xfrc_applied changes "
                    "there, and stays until it is cleared",
                    body=names.pop(),
                    steps=so_many(steps),
                    step=first,
                ),
                advice=Message("clear it: {call}", call="d.xfrc_applied[:] = 0"),
                effect=Effect(size, "N"),
                steps=Span(first, end, steps),
                site=calls[0].site.place,
            )


def _values(call: Call) -> list[float]:
    """Return what a call has written: a value for each index, or all of a part."""
    indexed = "index" in call.site.names
    return [*(call.numbers[1::2] if indexed else call.numbers)]


class ModelEdited(Answer):
    """Masses that are edited in place, and not what MuJoCo derives from them."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._first: Call | None = None
        self._functions: set[str] = set()

    def see(self) -> None:
        """Keep the first edit."""
        self._functions |= {site.function for site in self.scene.piece.calls.sites.values()}
        if self._first is None:
            self._first = next(iter(self.scene.piece.calls.named("body_mass")), None)

    def findings(self) -> Iterator[Finding]:
        """Yield it, unless what follows from a mass was changed, too."""
        call = self._first
        if call is None or len(call.numbers) < 3:
            return
        if self._functions & {*DERIVED}:
            return
        index, new, old = call.numbers[:3]
        step = call.at.step + 1
        yield Finding(
            code="model-edited",
            level="model",
            message=Message(
                "body_mass[{index}] is changed in place from {old:.4g} to {new:.4g} before step "
                "{step}; body_invweight0 and body_subtreemass, which MuJoCo derives from it, are "
                "not",
                index=int(index),
                old=old,
                new=new,
                step=step,
            ),
            advice=Message("after it: {call}", call="mujoco.mj_setConst(m, d)"),
            effect=Effect(abs(new - old), "kg"),
            steps=Span(step, step, 1),
            site=call.site.place,
        )


class StaticParent(Answer):
    """A link that overlaps the base that it hangs on, which stands: both collide."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._found: list[Finding] = []

    def see(self) -> None:
        """Look at the contacts of the first step."""
        points = between(self.scene.piece.contacts, 1, 2)
        for row in points[points["body_a"] == points["body_b"]]:
            body = self.scene.seen.bodies.get(int(row["body_a"]))
            links = sorted((int(row["link_a"]), int(row["link_b"])))
            depth = -float(row["distance_m"])
            if body is None or depth < OVERLAP_M or body.base_moves or links[0] != BASE:
                continue
            if links[1] < 0 or body.joints[links[1]].parent != BASE:
                continue
            base, link = body.links[0], body.links[links[1] + 1]
            if any(each.body == body.label and each.joint == link for each in self._found):
                continue
            self._found.append(
                Finding(
                    code="static-parent",
                    level="asked",
                    message=Message(
                        "{base} is {depth:.2g} mm inside {link} before the first step, and pushes "
                        "it: parent and child collide where the parent cannot move, as here",
                        base=base,
                        depth=1e3 * depth,
                        link=link,
                    ),
                    advice=Message(
                        "exclude them: {call}",
                        call=f'<exclude body1="{base}" body2="{link}"/>',
                    ),
                    body=body.label,
                    joint=link,
                    effect=Effect(depth, "m"),
                    share=depth / OVERLAP_M,
                    steps=Span(1, 1, 1),
                )
            )

    def findings(self) -> Iterator[Finding]:
        """Yield what was found."""
        yield from self._found
