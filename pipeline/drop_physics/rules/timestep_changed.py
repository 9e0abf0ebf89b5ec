"""Steps of different length in the life of what has motors or constraints."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from drop_physics.fields import fraction
from drop_physics.messages import Message
from drop_physics.rules.answer import Answer, Cure, Effect, Finding, Notes, Scene
from drop_physics.rules.arguments import site_of
from drop_physics.trace.acts import SETS_TIMESTEP


class TimestepChanged(Answer):
    """What keeps force × timestep of its call, in steps of different length; a new scene may."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._last: dict[int, tuple[int, float]] = {}
        """By body, life and timestep of its last step."""
        self._changes: Notes[int] = Notes()
        """By client."""

    def see(self) -> None:
        """Compare each step's timestep with that of the step before."""
        found: dict[int, dict[int, tuple[float, float]]] = {}
        for judged, steps in self.scene.stretches():
            if not steps.law.tree.joint_rates and not np.any(steps.terms.get("constraints", 0)):
                continue
            timestep_s, life = steps.reported.timestep_s, steps.epoch.life
            lived, last_s = self._last.get(judged.body.number, (life, timestep_s[0]))
            before_s = np.append(last_s if lived == life else timestep_s[0], timestep_s[:-1])
            for row in np.flatnonzero(timestep_s != before_s).tolist():
                change = float(before_s[row]), float(timestep_s[row])
                found.setdefault(judged.body.client, {})[int(steps.steps[row]) - 1] = change
            self._last[judged.body.number] = life, float(timestep_s[-1])
        for client, changes in found.items():
            first, at = min(changes), np.array(sorted(changes))
            sites = [
                site_of(each)
                for each in self.scene.piece.calls.of(*SETS_TIMESTEP)
                if each.client == client and each.at.step == first
            ]
            # Of all the first is told.
            self._changes.add(
                client,
                at,
                np.full(len(at), -float(first)),
                change=changes[first],
                site=sites[-1] if sites else None,
            )

    def findings(self) -> Iterator[Finding]:
        """Yield the first change of each simulation."""
        for each in self._changes.values():
            (before_s, after_s), site = each.at["change"], each.at["site"]
            more = Message(" (the first of {n:,} changes)", n=each.count) if each.count > 1 else ""
            message = Message(
                "the timestep changes from {before} s to {after} s at step {step:,}{more}: motors "
                "and constraints keep force × timestep of their call, and a position motor closes "
                "a share of its gap per step",
                before=fraction(before_s),
                after=fraction(after_s),
                step=each.first,
                more=more,
            )
            low_s, high_s = sorted((before_s, after_s))
            ratio = high_s / low_s if low_s > 0 else 0.0
            yield Finding(
                code="timestep-changed",
                level="model",
                message=message,
                advice=Message("call p.setTimeStep once, before the first motor"),
                cure=Cure("timestep-first"),
                effect=Effect(ratio, "1"),
                share=ratio,
                steps=each.span,
                site=site,
            )
