"""Why torques move a joint less than they should: its file's joint damping takes them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from drop_physics.explain.joints import Driven
from drop_physics.messages import Message
from drop_physics.physics.dynamics import mass_matrix
from drop_physics.physics.kinematics import kinematics
from drop_physics.rules.answer import Answer, Effect, Finding, Noted, Scene
from drop_physics.rules.joint import effort, link_of

ALWAYS, MUCH, MOST = 0.9, 0.1, 0.5
"""Damping matters where it takes MUCH of a torque that keeps its sign in ALWAYS of its sum, and
where it takes MOST of any."""
MOVES = 0.05
"""What would give a joint less speed than that over the run [rad/s or m/s] moves nothing."""
OTHERS = ("contacts", "constraints", "rolling", "stops", "clamp", "motors")
"""Where one of these acts on a joint, it is not damping that decides."""


@dataclass
class _Damped:
    """One joint, in the steps in which only torques and gravity drive it."""

    damping: float
    site: str | None
    noted: Noted
    driven: float = 0.0
    """Σ |torque and gravity| [N s or N m s]."""
    net: float = 0.0
    """The same with its sign."""
    taken: float = 0.0
    """Σ |joint damping|."""
    inertia: float = field(default=np.inf)

    @property
    def share(self) -> float:
        """What damping takes of what drives the joint."""
        return self.taken / self.driven if self.driven > MOVES * self.inertia else 0.0

    @property
    def matters(self) -> bool:
        """Whether the joint would have moved otherwise without it."""
        return self.share > (MUCH if abs(self.net) > ALWAYS * self.driven else MOST)


class JointDamping(Answer):
    """`<dynamics damping>` acts on joints that torques drive, and inverse dynamics omits it."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._joints: dict[int, dict[int, _Damped]] = {}
        """By body and link."""

    def see(self) -> None:
        """Take a piece."""
        for driven in self.scene.driven():
            torqued = np.isfinite(driven.asked.torque_since).any(axis=0)
            for k in np.flatnonzero(torqued).tolist() if driven.steps.covered else ():
                link = link_of(driven.body, k)
                told = driven.body.joints[link].damping
                # One that a call set is meant.
                if 0 < told == driven.steps.law.joint_damping[k]:
                    self._add(self._joints.setdefault(driven.body.number, {}), driven, link, k)

    def _add(self, joints: dict[int, _Damped], driven: Driven, link: int, k: int) -> None:
        """Add what drives a joint, and what damping takes of it."""
        steps, asked = driven.steps, driven.asked
        rate = steps.law.tree.first_rate + k
        terms = {name: each[:, rate] for name, each in steps.terms.items()}
        alone = ~np.any([terms[name] != 0 for name in OTHERS if name in terms], axis=0)
        rows = np.flatnonzero(alone & (terms["applied"] != 0) & ~np.isnan(asked.torque_since[:, k]))
        if not len(rows):
            return
        first, site = (
            Noted(int(steps.steps[rows[0]])),
            self.scene.site(asked.torque_site[rows[0], k]),
        )
        held = joints.setdefault(link, _Damped(float(steps.law.joint_damping[k]), site, first))
        drive = (terms["applied"] + terms["gravity"])[rows]
        held.driven += float(np.abs(drive).sum())
        held.net += float(drive.sum())
        held.taken += float(np.abs(terms["joint damping"][rows]).sum())
        (matrix,) = mass_matrix(kinematics(steps.law.tree, steps.before.at(rows[-1:])))
        held.inertia = float(matrix[rate, rate])
        held.noted.go_on(steps.steps[rows])

    def findings(self) -> Iterator[Finding]:
        """Yield a line per robot."""
        for number, joints in self._joints.items():
            found = {link: each for link, each in joints.items() if each.matters}
            if not found:
                continue
            link = max(found, key=lambda link: found[link].share)
            worst, body = found[link], self.scene.body(number)
            joint = body.joints[link]
            unit = "N s" if joint.kind == "prismatic" else "N m s"
            yield Finding(
                code="joint-damping",
                level="model",
                body=body.label,
                joint=joint.name,
                message=Message(
                    "{joint} is driven by torques: beyond its weight they give it {given}, and the "
                    "joint damping in its file, {damping}, takes {taken} (joints of this robot: "
                    "{count})",
                    joint=joint.name,
                    count=len(found),
                    given=effort(worst.driven, unit),
                    taken=effort(worst.taken, unit),
                    damping=effort(worst.damping, unit + ("/m" if unit == "N s" else "/rad")),
                ),
                advice=Message(
                    "p.changeDynamics(body, {link}, jointDamping=0), or give torques that make up "
                    "for it: p.calculateInverseDynamics leaves it out",
                    link=link,
                ),
                effect=Effect(worst.taken, unit),
                share=min(worst.share, 1.0),
                steps=worst.noted.span,
                site=worst.site,
            )
