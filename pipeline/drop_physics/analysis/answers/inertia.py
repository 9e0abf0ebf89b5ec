"""Masses and moments of inertia: those of the file, and those that move."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drop_physics.analysis.answers.answer import Answer, Effect, Finding, Scene, site_of
from drop_physics.analysis.answers.arguments import calls_of, given, number
from drop_physics.analysis.answers.inertia_from_shape import OtherInertia, other_inertia
from drop_physics.analysis.explained.recording import Explained
from drop_physics.analysis.explained.steps import Steps
from drop_physics.laws.kinematics import kinematics
from drop_physics.laws.lookup import RIGID
from drop_physics.laws.tree import BASE, RATES, Tree
from drop_physics.messages import Message
from drop_physics.seen.calls import Call
from drop_physics.seen.events import Body, FileLink

Float64 = NDArray[np.float64]

WITHOUT_INERTIAL_KG = 1.0
"""What PyBullet gives a link whose file has no `<inertial>`."""
IMPOSSIBLE = Message(
    "no body has it: the two smaller moments add up to the largest or more; correct <inertia>, or "
    "give p.changeDynamics another localInertiaDiagonal"
)


@dataclass
class _Set:
    """What calls set of a link."""

    inertia: bool = False
    mass: Call | None = None


class Inertia(Answer):
    """Looks at each body as it is in its first step, and at what its inertia does in all."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._set: dict[tuple[int, int], _Set] = {}
        self._loads: dict[tuple[int, int], Call] = {}
        """By client and the engine's id."""
        self._done: set[int] = set()
        self._found: list[Finding] = []
        self._other: dict[int, OtherInertia] = {}
        self._alone: dict[int, tuple[Body, Call]] = {}

    def see(self, explained: Explained) -> None:
        """Look at the bodies that have their first step in this piece."""
        for call in explained.piece.calls:
            if call.function.startswith("load") and np.isfinite(call.result):
                self._loads.setdefault((call.client, int(call.result)), call)
        for call, body in calls_of(explained.piece, self.scene.seen.appearances, "changeDynamics"):
            link = int(number(call, "linkIndex", float(BASE)))
            told = self._set.setdefault((body.number, link), _Set())
            moments, mass = given(call, "localInertiaDiagonal"), given(call, "mass")
            told.inertia |= bool(moments)
            if mass and not moments:
                told.mass = call
            if moments and not mass:
                self._alone.setdefault(body.number, (body, call))
        for number_, judged in explained.bodies.items():
            if number_ not in self._done and judged.stretches and len(judged.stretches[0]):
                self._done.add(number_)
                self._look(judged.body, judged.stretches[0])
            if number_ in self._other:
                for steps in judged.stretches:
                    self._other[number_].weigh(self.scene.joints.latest.get(number_, []), steps)

    def findings(self) -> Iterator[Finding]:
        """Yield what was found of each body."""
        yield from self._found
        yield from filter(None, (each.finding() for each in self._other.values()))
        rigid = {each.body.number for each in self.scene.seen.dynamics
            if int(each.reported["kind"][0]) == RIGID}  # fmt: skip
        for number_, (body, call) in self._alone.items():
            if number_ in rigid:
                message = Message(
                    "{body} is a btRigidBody and gets an inertia without a mass: PyBullet then "
                    "takes as its mass what an earlier command left in memory",
                    body=body.label,
                )  # fmt: skip
                yield Finding(
                    code="inertia-without-mass", level="model", message=message, body=body.label,
                    advice=Message("give p.changeDynamics its mass as well"), site=site_of(call),
                )  # fmt: skip

    def _look(self, body: Body, steps: Steps) -> None:
        tree = steps.law.tree
        if len(body.links) != tree.links + 1:
            return
        moving = _moving(tree)
        self._impossible(body, tree, moving)
        told = {each.name: each for each in body.asked.links}
        of_file = {link: told[body.links[link + 1]] for link in moving
            if body.links[link + 1] in told}  # fmt: skip
        self._without(body, tree, of_file)
        if tree.size and "planar" not in steps.epoch.reasons:
            kin = kinematics(tree, steps.before.at(np.array([0])))
            given_ = [self._set.get((body.number, link), _Set()) for link in of_file]
            left = [link for link, each in zip(of_file, given_, strict=True) if not each.inertia]
            other = other_inertia(self.scene, body, kin, {link: of_file[link] for link in left})
            if other is not None:
                other.changed = next((e.mass for e in given_ if e.mass is not None), None)
                other.loaded = self._loaded(body)
                self._other[body.number] = other

    # -- no-inertial ------------------------------------------------------------------------------

    def _without(self, body: Body, tree: Tree, of_file: dict[int, FileLink]) -> None:
        masses_kg = tree.masses_kg[1 + np.array([*of_file], np.int64)]
        links = [link for (link, each), mass_kg in zip(of_file.items(), masses_kg, strict=True)
            if np.isnan(each.mass_kg) and mass_kg == WITHOUT_INERTIAL_KG]  # fmt: skip
        if not links:
            return
        total_kg = sum(tree.masses_kg[link + 1] for link in _moving(tree))
        more = Message(" (and {n} more)", n=len(links) - 1) if len(links) > 1 else ""
        message = Message(
            "{link}{more} has no <inertial> in the file, so PyBullet gives it 1 kg: {mass:g} of "
            "the {total:.3g} kg that move",
            link=body.links[links[0] + 1], more=more, mass=float(len(links)), total=total_kg,
        )  # fmt: skip
        self._found.append(Finding(
            code="no-inertial", level="asked", message=message, body=body.label,
            advice=Message("give the link an <inertial>, or p.changeDynamics(body, {link}, "
                "mass=…)", link=links[0]),
            effect=Effect(float(len(links)), "kg"), share=len(links) / total_kg,
            site=self._loaded(body),
        ))  # fmt: skip

    def _loaded(self, body: Body) -> str | None:
        call = self._loads.get((body.client, body.engine_id))
        return None if call is None else site_of(call)

    # -- impossible-inertia -----------------------------------------------------------------------

    def _impossible(self, body: Body, tree: Tree, moving: Sequence[int]) -> None:
        for link in moving:
            low, middle, high = sorted(tree.inertias_kg_m2[link + 1].tolist())
            if not tree.masses_kg[link + 1] > 0 or low + middle >= high * (1 - 1e-6) > 0:
                continue
            if high == 0 and not any(each.link == link for each in body.collisions):
                continue  # a point
            message = Message(
                "{link} of {body} has moments of inertia of {low:.3g}, {middle:.3g} and {high:.3g} "
                "kg m² with {mass:.3g} kg",
                link=body.links[link + 1], body=body.label, low=low, middle=middle, high=high,
                mass=tree.masses_kg[link + 1],
            )  # fmt: skip
            self._found.append(Finding(
                code="impossible-inertia", level="model", message=message, advice=IMPOSSIBLE,
                body=body.label, site=self._loaded(body),
            ))  # fmt: skip
            return


def _moving(tree: Tree) -> list[int]:
    """Return the links whose mass a step depends on: those that can move."""
    moves = [not tree.fixed]
    for link, parent in enumerate(tree.parents):
        moves.append(moves[parent + 1] or RATES[tree.joints[link]] > 0)
    return [link for link in range(BASE, tree.links) if moves[link + 1]]
