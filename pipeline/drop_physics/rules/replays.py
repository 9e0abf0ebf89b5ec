"""`not-replayed`, `no-gravity`: what the engine's own replay says of the steps, and of gravity."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from drop_physics.explain.step_status import WHYS
from drop_physics.messages import Message
from drop_physics.rules.answer import Answer, Cure, Effect, Finding, Level, Noted, Scene, so_many
from drop_physics.rules.engines import MUJOCOS
from drop_physics.rules.thresholds import FALLS_STEPS
from drop_physics.trace.acts import Act

STALE, ELSEWHERE = WHYS.index("stale"), WHYS.index("not replayed")


class NotReplayed(Answer):
    """A step that leads elsewhere than its state does: it was taken with data of another state."""

    engines = MUJOCOS

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._found: dict[tuple[int, int], Noted] = {}
        """The steps, by client and why."""
        self._written: set[tuple[int, int]] = set()
        """Clients, and steps before which a call wrote positions."""

    def see(self) -> None:
        """Take a piece."""
        seen: set[tuple[int, int]] = set()
        for call in self.scene.piece.calls.of(Act.SET_STATE):
            self._written.add((call.client, call.at.step + 1))
        for judged in self.scene.judged.values():
            for why in (STALE, ELSEWHERE):
                steps = judged.steps[judged.why == why]
                key = judged.body.client, why
                replayed = self.scene.piece.impulses.get(judged.body.client)
                if (
                    replayed and len(steps) and key not in seen
                ):  # one of its bodies speaks for a simulation
                    seen.add(key)
                    self._found.setdefault(key, Noted(int(steps[0]))).go_on(steps)

    def findings(self) -> Iterator[Finding]:
        """Yield why, per simulation."""
        for (client, why), noted in self._found.items():
            level: Level = "asked"
            message = Message(
                "{steps} from step {first:,} on used what had been computed for another state: "
                "mj_step2 takes positions, contacts and forces as mj_step1 left them",
                steps=so_many(noted.count),
                first=noted.first,
            )
            if (client, noted.first) in self._written:
                message = Message(
                    "{steps} from step {first:,} on used what had been computed for the state "
                    "before qpos was written: mj_step2 takes positions, contacts and forces as "
                    "mj_step1 left them",
                    steps=so_many(noted.count),
                    first=noted.first,
                )
            advice: Message | None = Message(
                "mujoco.mj_step1(model, data) after qpos is written and before mj_step2, or mj_step"
            )
            if why == ELSEWHERE:
                level, advice = "note", None
                message = Message(
                    "{steps} from step {first:,} on lead elsewhere than the recorded state and "
                    "model do when they are taken again: what acted in them is not known",
                    steps=so_many(noted.count),
                    first=noted.first,
                )
            yield Finding(
                code="not-replayed",
                level=level,
                reason="stale" if why == STALE else None,
                message=message,
                advice=advice,
                effect=Effect(float(noted.count), "steps"),
                share=float(noted.count),
                steps=noted.span,
                site=self.scene.only_site(Act.SET_STATE) if why == STALE else None,
            )


class FloatsWithoutGravity(Answer):
    """A free body that nothing holds, and that does not fall: the model's gravity is zero."""

    engines = MUJOCOS

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._stands: dict[int, Noted] = {}
        self._moves: set[int] = set()

    def see(self) -> None:
        """Take a piece."""
        for judged, steps in self.scene.stretches():
            number = judged.body.number
            if not judged.body.base_moves or number in self._moves:
                continue
            pulled = steps.reported.gravity_m_s2.any() or steps.reported.contacts.step.size
            moved = np.abs(steps.after.velocity).any()
            acted = any(np.any(term) for term in steps.terms.values())
            if pulled or moved or acted:
                self._moves.add(number)
                continue
            self._stands.setdefault(number, Noted(int(steps.steps[0]))).go_on(steps.steps)

    def findings(self) -> Iterator[Finding]:
        """Yield the first body of each simulation."""
        told: set[int] = set()
        for number, noted in self._stands.items():
            body = self.scene.body(number)
            if number in self._moves or body.client in told or noted.count < FALLS_STEPS:
                continue
            told.add(body.client)
            call = Message('<option gravity="0 0 -9.81"/>, or model.opt.gravity[2] = -9.81')
            yield Finding(
                code="no-gravity",
                level="model",
                message=Message(
                    "the model's gravity is 0, so {body} does not fall", body=body.label
                ),
                advice=call,
                cure=Cure("gravity", None, -9.81, call),
                body=body.label,
                share=1.0,
                steps=noted.span,
            )
