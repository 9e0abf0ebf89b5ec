"""What calls asked of each joint: mode, target, gains, and the force limit that counts.

PyBullet keeps a motor's limit as an impulse: force × the timestep at the call, whatever the
timestep is later. Each revolute and prismatic joint begins with a velocity motor that may give
1 N m s in a step, whatever file it came from (`PhysicsServerCommandProcessor.cpp`,
createJointMotors).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from drop_physics.seen.calls import Call, Meanings
from drop_physics.seen.events import Body, Site, order
from drop_physics.seen.history import Piece, Seen

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]
Flags = NDArray[np.bool_]
Numbers = tuple[float, ...]

DEFAULT, VELOCITY, TORQUE, POSITION, PD = -1, 0, 1, 2, 3
"""How a joint is driven: by the motor that it was loaded with, or `controlMode` of a call."""
NONE = np.nan
DEFAULT_IMPULSES = {1: 1.0, 3: 1000.0}
"""The largest of the motor that a joint begins with, by its degrees of freedom [N s or N m s]."""
TIMESTEP_S = 1 / 240
GAINS = {POSITION: (0.1, 1.0), VELOCITY: (0.1, 1.0), PD: (0.1, 1.0)}
FORCE = 100000.0
"""PyBullet's default."""
ARGUMENTS = {
    "targetPosition": "targetPositions", "targetVelocity": "targetVelocities", "force": "forces",
    "positionGain": "positionGains", "velocityGain": "velocityGains",
    "maxVelocity": "maxVelocities",
}  # fmt: skip
"""Arguments of a call for one joint, and of one for several."""


@dataclass(frozen=True, eq=False)
class Commanded:
    """What was asked of the joints in n steps; shape (n, joint_rates) each."""

    mode: Float64
    """Of the motor: DEFAULT, VELOCITY, POSITION."""
    target: Float64
    """Position [rad] or [m]; nan if there is none."""
    target_velocity: Float64
    kp: Float64
    kd: Float64
    impulse: Float64
    """The largest that the motor may give in a step [N s or N m s]."""
    force: Float64
    """As the call gave it [N or N m]; nan of a motor that no call set."""
    max_velocity: Float64
    """nan if it is not limited."""
    site: Float64
    """Number of the call's site; nan if no call set the motor."""
    began: Float64
    """The step at which the latest call with other numbers set the motor."""
    told: Float64
    """The step at which the latest call of all set the motor."""
    torque_since: Float64
    """The step of the first TORQUE_CONTROL since that of another mode; nan if there is none."""
    torque_site: Float64
    pd: Float64
    """Whether PD_CONTROL acts: 1 or nan."""
    pd_target: Float64
    pd_force: Float64

    def __len__(self) -> int:
        """Return the number of steps."""
        return len(self.mode)


NAMES = [each.name for each in fields(Commanded)]
MOTOR = NAMES[: NAMES.index("torque_since")]
PD_AT = NAMES.index("pd")
TORQUE_AT = NAMES.index("torque_since")


class Controls:
    """The commands of all bodies; calls come piece by piece."""

    def __init__(self, seen: Seen) -> None:
        self._appearances = seen.appearances
        self._timesteps: dict[int, float] = {}
        self._first = {each.client: each for each in reversed(seen.settings)}
        self._now: dict[int, Float64] = {}
        """By body, its state: shape (fields, joint_rates)."""
        self._changes: dict[int, list[tuple[int, Float64]]] = {}
        """By body, the states since steps of this piece."""
        self.sites: dict[int, Site] = {}
        self._came = [each for each in seen.appearances if each.came]

    def take(self, piece: Piece) -> None:
        """Take the calls of a piece."""
        self._changes = {}
        came = [each for each in self._came if each.at.step < piece.end]
        self._came = self._came[len(came) :]
        told = [*self._calls(piece)]
        events: list[tuple[tuple[int, int], Body, Call | None, float]] = [
            (order(each.at), each.body, None, 0.0) for each in came
        ]
        events += told
        for (step, _), body, call, timestep_s in sorted(events, key=lambda event: event[0]):
            state = self._now.get(body.number)
            if call is None or state is None:
                kept = None if state is None else state[PD_AT:]
                self._set(body, step, _fresh(body, kept))
            if call is not None:
                self._command(body, step, call, timestep_s)

    def of(self, body: Body, ends: Int64) -> Commanded:
        """Return what was asked in the steps to samples of the piece, shape (n,)."""
        changes = self._changes.get(body.number, [])
        began = self._now.get(body.number)
        if not changes:
            one = _fresh(body, None) if began is None else began
            return Commanded(*np.broadcast_to(one[:, None], (len(one), len(ends), one.shape[1])))
        which = np.searchsorted([step for step, _ in changes], ends - 1, side="right") - 1
        states = np.array([state for _, state in changes])[np.maximum(which, 0)]
        return Commanded(*np.moveaxis(states, 1, 0))

    def _calls(self, piece: Piece) -> Iterator[tuple[tuple[int, int], Body, Call | None, float]]:
        """Yield the calls that command joints, with the timestep at each."""
        timesteps = {}
        for call in piece.calls:
            timestep_s = self._timesteps.get(call.client, None) or self._began(piece, call.client)
            name = {"setTimeStep": "timeStep", "setPhysicsEngineParameter": "fixedTimeStep"}.get(
                call.function
            )
            if name in call.site.names and not call.raised:
                timestep_s = call.values[name][0]
            self._timesteps[call.client] = timesteps[call.at.call] = timestep_s
        meanings = Meanings(piece.calls, self._appearances)
        for call, at, came in meanings.of_bodies("setJointMotorControl"):
            yield order(at), came.body, call, timesteps[call.at.call]

    def _began(self, piece: Piece, client: int) -> float:
        """Return the timestep of a simulation before its first call."""
        first = self._first.get(client)
        if first is None:
            return TIMESTEP_S
        for call in piece.calls:
            if (
                call.client == client
                and order(call.at) <= order(first.at)
                and {"timeStep", "fixedTimeStep"} & {*call.site.names}
            ):
                return TIMESTEP_S
        return float(np.ravel(first.values["fixedTimeStep"])[0])

    def _set(self, body: Body, step: int, state: Float64) -> None:
        changes = self._changes.setdefault(body.number, [])
        if not changes and body.number in self._now:
            changes.append((-1, self._now[body.number]))
        if changes and changes[-1][0] == step:
            changes[-1] = step, state
        else:
            changes.append((step, state))
        self._now[body.number] = state

    def _command(self, body: Body, step: int, call: Call, timestep_s: float) -> None:
        self.sites[call.site.number] = call.site
        values, state = call.values, self._now[body.number].copy()
        mode = int(values.get("controlMode", (-1.0,))[0])
        joints = values.get("jointIndices", values.get("jointIndex", ()))
        places = places_of(body)
        for number, joint in enumerate(map(int, joints)):
            place = places[joint] if 0 <= joint < len(places) else slice(0, 0)
            if place.stop > place.start:
                self._on(state, place, mode, _numbers(values, number, len(joints)), step, call,
                    timestep_s)  # fmt: skip
        self._set(body, step, state)

    def _on(
        self, state: Float64, place: slice, mode: int, told: dict[str, Numbers], step: int,
        call: Call, timestep_s: float,
    ) -> None:  # fmt: skip
        """Change what is asked of one joint."""

        def one(name: str, default: float) -> float:
            numbers = told.get(name, ())
            return numbers[0] if len(numbers) == 1 else default

        width = place.stop - place.start
        forces = told.get("force", ())
        force = np.array(forces if len(forces) == width else [one("force", FORCE)] * width)
        if mode == TORQUE:
            since = state[TORQUE_AT, place]
            state[TORQUE_AT, place] = np.where(np.isnan(since), step, since)
            state[TORQUE_AT + 1, place] = call.site.number
            return
        if mode == PD:
            state[PD_AT, place], state[PD_AT + 1, place] = 1.0, one("targetPosition", 0.0)
            state[PD_AT + 2, place] = force
            return
        if mode not in (POSITION, VELOCITY):
            return
        kp, kd = (
            one(name, gain)
            for name, gain in zip(("positionGain", "velocityGain"), GAINS[mode], strict=True)
        )
        where = one("targetPosition", 0.0) if mode == POSITION and width == 1 else NONE
        rate = one("targetVelocity", 0.0) if width == 1 else NONE
        top = one("maxVelocity", 0.0)
        motor = np.array(
            [mode, where, rate, kp if mode == POSITION else 0.0, kd, 0.0, 0.0,
             top if top > 0 else NONE, call.site.number, step, step]
        )[:, None].repeat(width, axis=1)  # fmt: skip
        motor[5], motor[6] = force * timestep_s, force
        before = state[: len(MOTOR), place]
        if np.array_equal(before[:-2], motor[:-2], equal_nan=True):
            motor[-2] = before[-2]
        state[: len(MOTOR), place] = motor
        state[TORQUE_AT : TORQUE_AT + 2, place] = NONE


def places_of(body: Body) -> list[slice]:
    """Return where the rates of each joint are among those of all joints."""
    ends = np.cumsum([0, *(joint.widths[1] for joint in body.joints)]).tolist()
    return [slice(first, end) for first, end in pairwise(ends)]


def _fresh(body: Body, kept: Float64 | None) -> Float64:
    """Return what is asked of the joints of a body that was just loaded."""
    widths = [joint.widths[1] for joint in body.joints]
    state = np.full((len(NAMES), sum(widths)), NONE)
    state[0], state[2:5] = DEFAULT, [[0.0], [0.0], [1.0]]
    impulses = [DEFAULT_IMPULSES.get(width, NONE) for width in widths]
    state[5] = np.repeat(impulses, widths) if widths else 0.0
    state[9:11] = 0.0
    if kept is not None and kept.shape[1] == state.shape[1]:
        state[PD_AT:] = kept
    return state


def _numbers(values: dict[str, Numbers], number: int, joints: int) -> dict[str, Numbers]:
    """Return the arguments for one of several joints."""
    found = {}
    for name, plural in ARGUMENTS.items():
        if name in values:
            found[name] = values[name]
        elif plural in values and joints:
            width = max(len(values[plural]) // joints, 1)
            found[name] = values[plural][number * width : (number + 1) * width]
    return found
