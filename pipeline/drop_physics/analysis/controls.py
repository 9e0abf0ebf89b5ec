"""What calls asked of each joint: mode, target, gains, and the force limit that counts.

PyBullet keeps a motor's limit as an impulse: force × the timestep at the call, whatever the
timestep is later. Each revolute and prismatic joint begins with a velocity motor that may give
1 N m s in a step, whatever file it came from (`PhysicsServerCommandProcessor.cpp`,
createJointMotors).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from heapq import merge
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from drop_physics.analysis.called import called
from drop_physics.seen.calls import (
    FORCE,
    MOTORS,
    PD,
    POSITION,
    TORQUE,
    VELOCITY,
    Call,
    of_joint,
)
from drop_physics.seen.events import Appearance, Body, Site, order
from drop_physics.seen.history import Piece, Seen

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]
Flags = NDArray[np.bool_]
Told = Mapping[str, Sequence[float]]
"""The numbers of each argument."""

DEFAULT = -1
"""How a joint is driven that has the motor that it was loaded with."""
NONE = np.nan
DEFAULT_IMPULSES = {1: 1.0, 3: 1000.0}
"""The largest of the motor that a joint begins with, by its degrees of freedom [N s or N m s]."""
TIMESTEP_S = 1 / 240
TIMESTEPS = {"setTimeStep": "timeStep", "setPhysicsEngineParameter": "fixedTimeStep"}
"""Functions that set the timestep, and the argument."""


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


Column = tuple[float, ...]
"""What is asked of one rate, in the order of NAMES."""


class Controls:
    """The commands of all bodies; calls come piece by piece."""

    def __init__(self, seen: Seen) -> None:
        self._appearances = seen.appearances
        self._timesteps: dict[int, float] = {}
        self._first = {each.client: each for each in reversed(seen.settings)}
        self._now: dict[int, list[Column]] = {}
        """By body, what is asked of each of its rates."""
        self._began: dict[int, list[Column]] = {}
        """The same before the piece."""
        self._changes: dict[int, list[tuple[int, int, Column]]] = {}
        """By body, what this piece changes: since which step, of which rate."""
        self._places: dict[int, list[slice]] = {}
        self.sites: dict[int, Site] = {}
        self._came = [each for each in seen.appearances if each.came]

    def take(self, piece: Piece) -> None:
        """Take the calls of a piece."""
        self._changes = {}
        self._began = {number: [*columns] for number, columns in self._now.items()}
        came = [each for each in self._came if each.at.step < piece.end]
        self._came = self._came[len(came) :]
        events: list[tuple[tuple[int, int], Body, Call | None, float]] = [
            (order(each.at), each.body, None, 0.0) for each in came
        ]
        events += self._calls(piece)
        for (step, _), body, call, timestep_s in sorted(events, key=lambda event: event[0]):
            if call is None or body.number not in self._now:
                self._begin(body, step)
            if call is not None:
                self._command(body, step, call, timestep_s)

    def of(self, body: Body, ends: Int64) -> Commanded:
        """Return what was asked in the steps to samples of the piece, shape (n,)."""
        began = self._began.get(body.number) or self._now.get(body.number) or _fresh(body)
        found = np.empty((len(NAMES), len(ends), len(began)))
        found[:] = np.array(began).reshape(len(began), len(NAMES)).T[:, None]
        changes = self._changes.get(body.number, [])
        if changes:
            steps, rates, columns = zip(*changes, strict=True)
            told, which, numbers = np.array(steps), np.array(rates), np.array(columns)
            for k in np.unique(which):
                its = np.flatnonzero(which == k)
                at = np.searchsorted(told[its], ends - 1, side="right") - 1
                rows = np.flatnonzero(at >= 0)
                found[:, rows, k] = numbers[its[at[rows]]].T
        return Commanded(*found)

    def _calls(self, piece: Piece) -> Iterator[tuple[tuple[int, int], Body, Call, float]]:
        """Yield the calls that command joints, with the timestep at each."""
        changed = [call for call in piece.calls
            if not call.raised and (name := TIMESTEPS.get(call.site.function))
            and name in call.site.places]  # fmt: skip
        functions = called(piece, self._appearances).items()
        commands = [its for function, its in functions if function.startswith(MOTORS)]
        told: list[tuple[int, Call, Appearance | None]] = [
            (call.at.call, call, None) for call in changed
        ]
        for _, call, came in merge(
            told,
            *([(c.at.call, c, came) for c, came in its] for its in commands),
            key=lambda each: each[0],
        ):
            timestep_s = self._timesteps.get(call.client)
            if timestep_s is None:
                timestep_s = self._timesteps[call.client] = self._initial(piece, call.client)
            if came is None:
                place = call.site.places[TIMESTEPS[call.site.function]].start
                self._timesteps[call.client] = call.numbers[place]
            else:
                yield max(order(call.at), order(came.at)), came.body, call, timestep_s

    def _initial(self, piece: Piece, client: int) -> float:
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

    def _begin(self, body: Body, step: int) -> None:
        """Note a body that was just loaded; PD_CONTROL outlives what had its number before."""
        before, fresh = self._now.get(body.number, []), _fresh(body)
        if len(before) == len(fresh):
            fresh = [new[:PD_AT] + old[PD_AT:] for new, old in zip(fresh, before, strict=True)]
        self._now[body.number], self._places[body.number] = fresh, places_of(body)
        told = self._changes.setdefault(body.number, [])
        told += [(step, k, column) for k, column in enumerate(fresh)]

    def _command(self, body: Body, step: int, call: Call, timestep_s: float) -> None:
        site = call.site
        self.sites[site.number] = site
        numbers = call.values
        mode = int(numbers.get("controlMode", (-1.0,))[0])
        joints = numbers.get("jointIndices", numbers.get("jointIndex", ()))
        for number, joint in enumerate(map(int, joints)):
            told = numbers if "jointIndex" in numbers else of_joint(numbers, number, len(joints))
            self._on(body, joint, mode, told, step, site, timestep_s)

    def _on(
        self, body: Body, joint: int, mode: int, told: Told, step: int,
        site: Site, timestep_s: float,
    ) -> None:  # fmt: skip
        """Change what is asked of one joint."""
        places, columns = self._places[body.number], self._now[body.number]
        place = places[joint] if 0 <= joint < len(places) else slice(0, 0)
        width = place.stop - place.start
        forces = told.get("force", ())
        if len(forces) != width:
            forces = (forces[0] if len(forces) == 1 else FORCE,) * width
        for force, k in zip(forces, range(place.start, place.stop), strict=True):
            column = _changed(columns[k], mode, told, force, width, step, site, timestep_s)
            columns[k] = column
            self._changes.setdefault(body.number, []).append((step, k, column))


def _changed(
    column: Column, mode: int, told: Told, force: float, width: int, step: int,
    site: Site, timestep_s: float,
) -> Column:  # fmt: skip
    """Return what is asked of a rate after a call."""

    def one(name: str, default: float) -> float:
        numbers = told.get(name, ())
        return numbers[0] if len(numbers) == 1 else default

    if mode == TORQUE:
        since = column[TORQUE_AT]
        since = step if since != since else since
        return (*column[:TORQUE_AT], since, site.number, *column[PD_AT:])
    if mode == PD:
        return (*column[:PD_AT], 1.0, one("targetPosition", 0.0), force)
    if mode not in (POSITION, VELOCITY):
        return column
    position, top = mode == POSITION, one("maxVelocity", 0.0)
    motor = (
        float(mode),
        one("targetPosition", 0.0) if position and width == 1 else NONE,
        one("targetVelocity", 0.0) if width == 1 else NONE,
        one("positionGain", 0.1) if position else 0.0,
        one("velocityGain", 1.0),
        force * timestep_s,
        force,
        top if top > 0 else NONE,
        site.number,
    )
    # nan, the same object, is in a tuple equal to itself.
    began = column[len(motor)] if motor == column[: len(motor)] else step
    return (*motor, began, step, NONE, NONE, *column[PD_AT:])


def places_of(body: Body) -> list[slice]:
    """Return where the rates of each joint are among those of all joints."""
    ends = np.cumsum([0, *(joint.widths[1] for joint in body.joints)]).tolist()
    return [slice(first, end) for first, end in pairwise(ends)]


def _fresh(body: Body) -> list[Column]:
    """Return what is asked of the rates of a body that was just loaded."""
    none = (NONE,) * (len(NAMES) - len(MOTOR))
    return [
        (DEFAULT, NONE, 0.0, 0.0, 1.0, DEFAULT_IMPULSES.get(joint.widths[1], NONE),
         NONE, NONE, NONE, 0.0, 0.0, *none)
        for joint in body.joints for _ in range(joint.widths[1])
    ]  # fmt: skip
