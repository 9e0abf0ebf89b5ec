"""What answers about joints share: names, units and numbers as text, and a line per robot."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drop_physics.explain.joints import Driven
from drop_physics.rules.answer import Answer, Finding, Level, Noted, Notes, Scene
from drop_physics.trace.events import Body, Joint

Float64 = NDArray[np.float64]
Flags = NDArray[np.bool_]

OFF = {"rad": 1e-2, "m": 1e-3}
"""Closer than that a joint is at its target."""


class JointAnswer(Answer):
    """A rule of joints: of each robot it tells of the joint where it is largest."""

    code: str
    level: Level

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self.noted: dict[int, Notes[tuple[int, str]]] = {}
        """By the number of a robot, its joints, and what is noted of them."""

    def see(self) -> None:
        """Take a piece."""
        for driven in self.scene.driven():
            self.look(driven)

    @abstractmethod
    def look(self, driven: Driven) -> None:
        """Note the steps of a robot in which the rule holds."""

    def note(
        self, driven: Driven, which: Flags, sizes: Float64, kind: str = "", **numbers: Float64
    ) -> None:
        """Note some steps of joints, and numbers of the worst; shape (n, joint_rates) each."""
        noted = self.noted.setdefault(driven.body.number, Notes())
        numbers["site"] = driven.asked.site
        for k in np.flatnonzero(which.any(axis=0)).tolist():
            rows = np.flatnonzero(which[:, k])
            told = {name: each[rows, k] for name, each in numbers.items()}
            link, units = link_of(driven.body, k), units_of(driven, k)
            noted.add(
                (k, kind),
                driven.steps.steps[rows],
                sizes[rows, k],
                told,
                kind=kind,
                joint=driven.body.joints[link].name,
                link=link,
                units=units,
            )

    def findings(self) -> Iterator[Finding]:
        """Yield a line per robot."""
        for number, joints in self.noted.items():
            said = {key: each for key, each in joints.items() if self.says(each)}
            if said:
                worst = max(said.values(), key=lambda each: (each.most, each.count))
                worst.at["joints"] = len({k for k, _ in said})
                yield Finding(
                    code=self.code,
                    level=self.level,
                    body=self.scene.body(number).label,
                    joint=worst.at["joint"],
                    steps=worst.span,
                    site=self.scene.site(worst.at["site"]),
                    **self.words(worst),
                )

    def says(self, noted: Noted) -> bool:
        """Return whether it is worth saying of a joint."""
        return noted.count > 0

    @abstractmethod
    def words(self, worst: Noted) -> dict[str, Any]:
        """Return message, advice, effect and share; `joints` is how many have it."""


def name_of(driven: Driven, k: int) -> str:
    """Return the name of the joint of a rate."""
    return driven.body.joints[link_of(driven.body, k)].name


def link_of(body: Body, k: int) -> int:
    """Return the joint of a rate, as PyBullet counts joints."""
    return next(link for link, at in enumerate(body.rates) if at.start <= k < at.stop)


def units_of(driven: Driven, k: int) -> tuple[str, str]:
    """Return the units of a joint's position and effort."""
    return units(driven.body.joints[link_of(driven.body, k)])


def units(joint: Joint) -> tuple[str, str]:
    """Return the units of a joint's position and effort."""
    return ("m", "N") if joint.kind == "prismatic" else ("rad", "N m")


def distance(value: float, unit: str) -> str:
    """Return a gap as text."""
    if unit == "m" and abs(value) < 1:
        return f"{abs(value) * 1e3:.3g} mm"
    return f"{abs(value):.3g} {unit}" if abs(value) >= 10 else f"{abs(value):.2g} {unit}"


def place(value: float, unit: str) -> str:
    """Return a position as text."""
    return f"{value:.3f} m" if unit == "m" else f"{value:.2f} {unit}"


def effort(value: float, unit: str) -> str:
    """Return a torque or force as text."""
    return f"{abs(value):.0f} {unit}" if 10 <= abs(value) < 1e6 else f"{abs(value):.2g} {unit}"
