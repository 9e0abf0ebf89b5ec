"""Why torques move a joint less than they should: its file's joint damping takes them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from drop_physics.analysis.answers.answer import Answer, Effect, Finding, Scene, Span, site_of
from drop_physics.analysis.answers.held_off import effort
from drop_physics.analysis.controls import places_of
from drop_physics.analysis.explained.recording import Explained
from drop_physics.analysis.joints import Driven
from drop_physics.laws.dynamics import mass_matrix
from drop_physics.laws.kinematics import kinematics
from drop_physics.messages import Message

ALWAYS, MUCH, MOST = 0.9, 0.1, 0.5
"""Damping matters where it takes MUCH of a torque that keeps its sign in ALWAYS of its sum, and
where it takes MOST of any."""
MOVES = 0.05
"""What would give a joint less speed than that over the run [rad/s or m/s] moves nothing."""
OTHERS = ("contacts", "constraints", "rolling", "stops", "clamp", "motors")
"""Where one of these acts on a joint, it is not damping that decides."""


@dataclass(eq=False)
class _Damped:
    """One joint, in the steps in which only torques and gravity drive it."""

    damping: float
    site: float
    first: int
    driven: float = 0.0
    """Σ |torque and gravity| [N s or N m s]."""
    net: float = 0.0
    """The same with its sign."""
    taken: float = 0.0
    """Σ |joint damping|."""
    inertia: float = np.inf
    last: int = 0
    count: int = 0

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
        """By body and joint."""

    def see(self, explained: Explained) -> None:
        """Take a piece."""
        for number in explained.bodies:
            for driven in self.scene.joints.latest.get(number, []):
                torqued = np.asarray(np.isfinite(driven.asked.torque_since).any(axis=0))
                if not driven.steps.covered or not torqued.any():
                    continue
                joints = self._joints.setdefault(number, {})
                for link, place in enumerate(places_of(driven.body)):
                    told = driven.body.joints[link].damping
                    for k in range(place.start, place.stop):
                        # One that a call set is meant.
                        if torqued[k] and 0 < told == driven.steps.law.joint_damping[k]:
                            _add(joints, driven, link, k)

    def findings(self) -> Iterator[Finding]:
        """Yield a line per robot."""
        for number, joints in self._joints.items():
            found = {link: each for link, each in joints.items() if each.matters}
            if not found:
                continue
            link = max(found, key=lambda link: found[link].share)
            worst, body = found[link], self.scene.body(number)
            joint, site = body.joints[link], self.scene.joints.site(worst.site)
            unit = "N s" if joint.kind == "prismatic" else "N m s"
            yield Finding(
                code="joint-damping", level="model", body=body.label, joint=joint.name,
                message=Message(
                    "{joint} is driven by torques: beyond its weight they give it {given}, and the "
                    "joint damping in its file, {damping}, takes {taken} (joints of this robot: "
                    "{count})",
                    joint=joint.name, count=len(found), given=effort(worst.driven, unit),
                    taken=effort(worst.taken, unit),
                    damping=effort(worst.damping, unit + ("/m" if unit == "N s" else "/rad")),
                ),
                advice=Message(
                    "p.changeDynamics(body, {link}, jointDamping=0), or give torques that make up "
                    "for it: p.calculateInverseDynamics leaves it out", link=link,
                ),
                effect=Effect(worst.taken, unit), share=min(worst.share, 1.0),
                steps=Span(worst.first, worst.last, worst.count),
                site=None if site is None else site_of(site),
            )  # fmt: skip


def _add(joints: dict[int, _Damped], driven: Driven, link: int, k: int) -> None:
    """Add what drives a joint, and what damping takes of it."""
    steps, asked = driven.steps, driven.asked
    tree = steps.law.tree
    rate = tree.first_rate + k
    terms = {name: each[:, rate] for name, each in steps.terms.items()}
    alone = ~np.any([terms[name] != 0 for name in OTHERS if name in terms], axis=0)
    rows = np.flatnonzero(alone & (terms["applied"] != 0) & ~np.isnan(asked.torque_since[:, k]))
    if not len(rows):
        return
    site, first = float(asked.torque_site[rows[0], k]), int(steps.steps[rows[0]])
    held = joints.setdefault(link, _Damped(float(steps.law.joint_damping[k]), site, first))
    drive = (terms["applied"] + terms["gravity"])[rows]
    held.driven += float(np.abs(drive).sum())
    held.net += float(drive.sum())
    held.taken += float(np.abs(terms["joint damping"][rows]).sum())
    (matrix,) = mass_matrix(kinematics(tree, steps.before.at(rows[-1:])))
    held.inertia = float(matrix[rate, rate])
    held.last, held.count = int(steps.steps[rows[-1]]), held.count + len(rows)
