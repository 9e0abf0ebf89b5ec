"""`reset-leaves` at the beginning: the pose of a keyframe, without what it gives actuators."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from drop_physics.explain.driving import given_to
from drop_physics.explain.joints import Driven
from drop_physics.messages import Message
from drop_physics.rules.answer import Answer, Cure, Effect, Finding, Scene, Span
from drop_physics.rules.engines import MUJOCOS
from drop_physics.rules.joint import OFF, distance, name_of, units_of
from drop_physics.rules.reset_leaves import SAME, WATCHED
from drop_physics.trace.events import Keyframe


class KeyframeWithoutControl(Answer):
    """Writing a keyframe's `qpos` sets its pose, and not its `ctrl`."""

    engines = MUJOCOS

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._found: list[Finding] = []

    def see(self) -> None:
        """Look at the first steps of each body."""
        for driven in self.scene.driven():
            if driven.steps.steps[0] == 1 and driven.body.keyframes:
                self._look(driven)

    def _look(self, driven: Driven) -> None:
        body, begins = driven.body, driven.steps.before.joints[0]
        keys = [each for each in body.keyframes if np.abs(begins - each.joints).max() < SAME]
        given = [
            given_to(each, body, self.scene.piece, driven.steps.steps) for each in body.actuators
        ]
        constant = all(np.ptp(each[:WATCHED]) == 0 for each in given)
        if not keys or not given or not constant or len(driven.steps) < WATCHED:
            return
        now = np.array([each[0] for each in given])
        if any(np.abs(now - key.given).max() < SAME for key in keys):
            return  # one of the poses that look the same has what it gives
        key = keys[0]
        servos = {each.target for each in body.actuators if each.kind == "position"}
        off = np.abs(driven.after[WATCHED - 1] - driven.before[0])
        off[[name_of(driven, k) not in servos for k in range(len(off))]] = 0.0
        k = int(np.argmax(np.nan_to_num(off)))
        unit = units_of(driven, k)[0]
        if off[k] > OFF[unit]:
            self._found.append(self._finding(driven, key, now.tolist(), k, float(off[k])))

    def _finding(
        self, driven: Driven, key: Keyframe, now: list[float], k: int, off: float
    ) -> Finding:
        body, unit = driven.body, units_of(driven, k)[0]
        call = Message(
            "mujoco.mj_resetDataKeyframe(model, data, …) sets both, or write data.ctrl from "
            "model.key_ctrl"
        )
        return Finding(
            code="reset-leaves",
            level="asked",
            message=Message(
                "{body} begins in the pose of keyframe {key} and {joint} is driven off by {off}: "
                "ctrl is {now}, and that of the keyframe is {given}",
                body=body.label,
                key=key.name,
                joint=name_of(driven, k),
                off=distance(off, unit),
                now=" ".join(f"{each:g}" for each in now),
                given=" ".join(f"{each:g}" for each in key.given),
            ),
            advice=call,
            cure=Cure("keyframe-ctrl", body.label, None, call),
            body=body.label,
            joint=name_of(driven, k),
            effect=Effect(off, unit),
            share=off,
            steps=Span(1, WATCHED, WATCHED),
        )

    def findings(self) -> Iterator[Finding]:
        """Yield what was found."""
        yield from self._found
