"""What calls told the joints of a body to do: torques of one step, and PD_CONTROL, which stays."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from drop_physics.analysis.explained.touching import rows_of
from drop_physics.laws.bullet_reports import pd_effort
from drop_physics.laws.bullet_tree import BulletTree
from drop_physics.laws.tree import States, Tree
from drop_physics.seen.calls import Call
from drop_physics.seen.events import At

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]

VELOCITY, TORQUE, POSITION, PD = 0, 1, 2, 3
"""`controlMode` of `setJointMotorControl2` and its like."""
GAINS = {"positionGain": 0.1, "velocityGain": 1.0, "targetPosition": 0.0, "targetVelocity": 0.0,
    "force": 100000.0}  # fmt: skip
"""What PD_CONTROL takes, with the defaults of PyBullet."""


class Torque(NamedTuple):
    """A torque or force on a joint, for one step."""

    step: int
    """After which it was asked for."""
    link: int
    efforts: tuple[float, ...]
    """One per rate of the joint."""


class Servo(NamedTuple):
    """A joint under PD_CONTROL from now on.

    Nothing but another call of that mode changes it: PyBullet keeps it by the body's id, beyond
    other modes, `removeBody` and `resetSimulation` (`pdControlPlugin.cpp`).
    """

    step: int
    link: int
    numbers: tuple[float, ...]
    """Those of GAINS."""


class Motor(NamedTuple):
    """Whether a joint has a motor from now on: none where its force is 0.

    Of a motor that was switched off PyBullet goes on to report the last effort.
    """

    step: int
    body: int
    link: int
    is_off: bool


class Commands:
    """The commands of the bodies with one id of the engine; their calls come piece by piece."""

    def __init__(self) -> None:
        self._torques: list[Torque] = []
        self._servos: list[Servo] = []
        self._motors: list[Motor] = []

    def begin(self, first: int) -> None:
        """Forget what no step to sample `first` or a later one needs."""
        self._torques = [each for each in self._torques if each.step + 1 >= first]
        self._servos = [*{each.link: each for each in self._servos}.values()]
        self._motors = [*{each[1:3]: each for each in self._motors}.values()]

    def add(self, call: Call, at: At, body: int) -> None:
        """Note a call of `setJointMotorControl2` or one of its like."""
        mode = call.values.get("controlMode", (-1.0,))[0]
        if mode == TORQUE:
            self._torques += [Torque(at.step, *each) for each in _torques(call)]
        elif mode == PD:
            self._servos += [Servo(at.step, *each) for each in _servos(call)]
        elif mode in (VELOCITY, POSITION):
            self._motors += [
                Motor(at.step, body, joint, _of(call, "force", number, GAINS["force"]) == 0)
                for number, joint in enumerate(_joints(call))
            ]

    def commanded(self, tree: Tree, ends: Int64) -> Float64:
        """Return the sum of TORQUE_CONTROL's efforts in the steps to samples, (n, joint_rates)."""
        efforts = np.zeros((len(ends), tree.joint_rates))
        found, rows = rows_of([each.step + 1 for each in self._torques], ends)
        for number, row in zip(found.tolist(), rows.tolist(), strict=True):
            torque = self._torques[number]
            place = _place(tree, torque.link)
            if len(torque.efforts) == place.stop - place.start:
                efforts[row, place] += torque.efforts
        return efforts

    def motors(self, body: int, tree: Tree, ends: Int64, reported: Float64) -> Float64:
        """Return the motors' efforts in the steps to samples, (n, joint_rates): 0 of those off."""
        efforts = reported.copy()
        for link in {each.link for each in self._motors if each.body == body}:
            place = _place(tree, link)
            told = [each for each in self._motors if each[1:3] == (body, link)]
            if place.stop - place.start == 1:
                which = np.searchsorted([each.step for each in told], ends - 1, side="right") - 1
                off = np.array([*(each.is_off for each in told), False])[which]
                efforts[off, place.start] = 0.0
        return efforts

    def pd(self, law: BulletTree, ends: Int64, before: States) -> Float64:
        """Return PD_CONTROL's efforts in the steps to samples, shape (n, joint_rates)."""
        tree = law.tree
        efforts = np.zeros((len(ends), tree.joint_rates))
        for link in {each.link for each in self._servos}:
            place, told = _place(tree, link), [each for each in self._servos if each.link == link]
            if place.stop - place.start != 1:
                continue
            which = np.searchsorted([each.step for each in told], ends - 1, side="right") - 1
            rows = np.flatnonzero(which >= 0)
            numbers = np.array([each.numbers for each in told]).T[:, which[rows]]
            target, lower, upper = numbers[2], law.lower[place.start], law.upper[place.start]
            efforts[rows, place.start] = pd_effort(
                gains=numbers[:2],
                target=np.clip(target, lower, upper) if lower <= upper else target,
                target_velocity=numbers[3],
                limit=numbers[4], position=before.joints[rows, tree.coordinates[link].start],
                velocity=before.velocity[rows, tree.rates[link].start],
            )  # fmt: skip
        return efforts


def _place(tree: Tree, link: int) -> slice:
    """Return where the rates of a joint are among those of all joints; nowhere if it has none."""
    if not 0 <= link < tree.links:
        return slice(0, 0)
    rates = tree.rates[link]
    return slice(rates.start - tree.first_rate, rates.stop - tree.first_rate)


def _torques(call: Call) -> Iterator[tuple[int, tuple[float, ...]]]:
    joints = _joints(call)
    forces = call.values.get("forces", call.values.get("force", ()))
    width = len(forces) // len(joints) if joints else 0
    for number, joint in enumerate(joints):
        if width:
            yield joint, forces[number * width : (number + 1) * width]


def _servos(call: Call) -> Iterator[tuple[int, tuple[float, ...]]]:
    for number, joint in enumerate(_joints(call)):
        yield joint, tuple(_of(call, name, number, default) for name, default in GAINS.items())


def _joints(call: Call) -> Sequence[int]:
    return [*map(int, call.values.get("jointIndices", call.values.get("jointIndex", ())))]


def _of(call: Call, name: str, number: int, default: float) -> float:
    """Return the argument for one of several joints, whose names are in the plural."""
    plural = {"targetVelocity": "targetVelocities"}.get(name, f"{name}s")
    given = call.values.get(name, call.values.get(plural, ()))
    return given[number] if number < len(given) else default
