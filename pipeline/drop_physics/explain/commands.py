"""Determines which joint commands are in effect in each step: motors, torques, PD control.

PyBullet stores a motor's limit as an impulse: the force times the timestep at the time of the call,
even if the timestep changes later. Each revolute and prismatic joint begins with a velocity motor
of at most 1 N m s per step, even if its file states another limit
(`PhysicsServerCommandProcessor.cpp`, createJointMotors). A command in PD_CONTROL stays in effect
until the next one: PyBullet stores it under the body's id, through other modes, `removeBody` and
`resetSimulation` (`pdControlPlugin.cpp`).
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field, fields
from functools import cache
from operator import itemgetter

import numpy as np

from drop_physics.arrays import Float64, Int64
from drop_physics.explain.touching import rows_of
from drop_physics.physics.rowed import Rowed
from drop_physics.physics.servo import pd_effort
from drop_physics.physics.step_law import DampedTree
from drop_physics.physics.tree import States, Tree
from drop_physics.trace.acts import SETS_TIMESTEP
from drop_physics.trace.calls import TIMESTEPS
from drop_physics.trace.events import Appearance, Body, Settings, order
from drop_physics.trace.history import Piece, Seen
from drop_physics.trace.motors import PD, POSITION, TORQUE, VELOCITY, Command

DEFAULT = -1
"""Mode of a joint whose motor no call has set since the body was loaded."""
LOADED, BEFORE = -2, -3
"""Pseudo-modes of rows that are not calls: the body was loaded; the state is carried over from the
previous chunk."""
DEFAULT_IMPULSES = {1: 1.0, 3: 1000.0}
"""Impulse limit of a joint's default motor, by its degrees of freedom [N s or N m s]."""
TIMESTEP_S = 1 / 240


@dataclass(frozen=True, eq=False)
class Commanded(Rowed):
    """The joint commands in effect in n steps; shape (n, joint_rates) each."""

    mode: Float64
    """Mode of the motor: DEFAULT, VELOCITY, POSITION."""
    target: Float64
    """Target position [rad] or [m]; nan if the command has none."""
    target_velocity: Float64
    kp: Float64
    kd: Float64
    impulse: Float64
    """Maximum impulse of the motor in a step [N s or N m s]."""
    force: Float64
    """Force limit given in the call [N or N m]; nan if no call set the motor."""
    max_velocity: Float64
    """Velocity limit of a position motor; nan without a limit."""
    site: Float64
    """Id of the call site; nan if no call set the motor."""
    began: Float64
    """The step at which a call last changed the motor's parameters."""
    told: Float64
    """The step at which a call last set the motor, even to the same parameters."""
    torque_since: Float64
    """The step of the first TORQUE_CONTROL call after the last call in another mode; nan without
    one."""
    torque_site: Float64
    pd: Float64
    """Whether PD_CONTROL acts: 1 or nan."""
    pd_target: Float64
    pd_velocity: Float64
    pd_kp: Float64
    pd_kd: Float64
    pd_force: Float64

    def motors(self, tree: Tree, reported: Float64) -> Float64:
        """Return the efforts that motors exerted, shape (n, joint_rates); 0 if switched off.

        PyBullet keeps reporting the last effort of a motor that was switched off.
        """
        if not tree.joint_rates:
            return reported
        counts = [rates.stop - rates.start for rates in tree.rates]
        return np.where((self.force == 0) & (np.repeat(counts, counts) == 1), 0.0, reported)

    def servos(self, law: DampedTree, before: States) -> Float64:
        """Return the efforts of PyBullet's PD_CONTROL, shape (n, joint_rates)."""
        tree = law.tree
        efforts = np.zeros((len(before), tree.joint_rates))
        for rates, place in zip(tree.rates, tree.coordinates, strict=True):
            k = rates.start - tree.first_rate
            if rates.stop - rates.start != 1 or not (on := self.pd[:, k] == 1).any():
                continue
            lower, upper, target = law.lower[k], law.upper[k], self.pd_target[on, k]
            efforts[on, k] = pd_effort(
                gains=np.stack((self.pd_kp[on, k], self.pd_kd[on, k])),
                target=np.clip(target, lower, upper) if lower <= upper else target,
                target_velocity=self.pd_velocity[on, k],
                limit=self.pd_force[on, k],
                position=before.joints[on, place.start],
                velocity=before.velocity[on, rates.start],
            )
        return efforts


NAMES = [each.name for each in fields(Commanded)]
BEGAN_AT, TORQUE_AT, PD_AT = map(NAMES.index, ("began", "torque_since", "pd"))


@dataclass(eq=False)
class _JointCommands:
    """The commands to one joint, in order."""

    now: Float64
    """The commands at the end of the chunk, shape (NAMES, width of the joint)."""
    calls: list[tuple[Float64, Float64]] = field(default_factory=list)
    """The calls of the chunk. First the step and the call index from which each is in effect, the
    call's own index, and its mode, shape (4, m); then its settings, shape (m, NAMES, width)."""
    steps: Int64 | None = None
    """Step from which each row of `columns` is in effect; None if the chunk has no calls."""
    columns: Float64 = field(default_factory=lambda: np.empty(0))
    """The commands before the chunk, and after each call; shape (1 + m, NAMES, width)."""
    torques: list[tuple[Int64, Int64, Float64]] = field(default_factory=list)
    """Calls of TORQUE_CONTROL: their indices and steps, shape (m,), and efforts, (m, width)."""

    def begin(self, first: int) -> None:
        """Forget the torques of steps before sample `first`."""
        self.steps = None
        self.torques = [torque for torque in self.torques if torque[1][-1] + 1 >= first]

    def take(self) -> None:
        """Sort a chunk's calls, and fill in settings that each call leaves unchanged."""
        if not self.calls:
            return
        moments, columns = (
            np.concatenate(each, axis=k)
            for k, each in zip((1, 0), zip(*self.calls, strict=True), strict=True)
        )
        self.calls = []
        order = np.lexsort(moments[2::-1])
        self.steps = np.append(-1, moments[0, order].astype(np.int64))
        self.columns = np.concatenate((self.now[None], columns[order]))
        _fill(self.steps, np.append(BEFORE, moments[3, order]), self.columns)
        self.now = self.columns[-1].copy()

    def at(self, ends: Int64, which: slice) -> Float64:
        """Return settings in effect in the given steps, shape (columns, n or 1, width)."""
        if self.steps is None:
            return self.now[which, None]
        rows = np.searchsorted(self.steps, ends - 1, side="right") - 1
        return np.moveaxis(self.columns[rows, which], 0, 1)


def _fill(steps: Int64, modes: Float64, columns: Float64) -> None:
    """Fill in settings that each call leaves unchanged; row 0 is the state before all calls."""
    number = np.arange(len(modes))
    sets = np.isin(modes, (BEFORE, LOADED, VELOCITY, POSITION))
    at = np.flatnonzero(sets)
    motor = columns[at, :BEGAN_AT]
    same = (motor[1:] == motor[:-1]) | (np.isnan(motor[1:]) & np.isnan(motor[:-1]))
    new = np.ones((len(at), columns.shape[2]), np.bool_)
    new[1:] = ~same.all(axis=1)
    first = np.maximum.accumulate(np.where(new, np.arange(len(at))[:, None], 0), axis=0)
    columns[at, BEGAN_AT] = np.take_along_axis(columns[at, BEGAN_AT], first, axis=0)
    columns[:, :TORQUE_AT] = columns[np.maximum.accumulate(np.where(sets, number, 0)), :TORQUE_AT]

    torques = np.flatnonzero(modes == TORQUE)
    since_motor, since = np.cumsum(sets)[torques], columns[0, TORQUE_AT]
    _, firsts, which = np.unique(since_motor, return_index=True, return_inverse=True)
    going = (since_motor == 1)[:, None] & ~np.isnan(since)
    columns[torques, TORQUE_AT] = np.where(going, since, steps[torques[firsts[which]], None])
    last = np.maximum.accumulate(np.where(sets | (modes == TORQUE), number, 0))
    columns[:, TORQUE_AT:PD_AT] = columns[last, TORQUE_AT:PD_AT]

    last = np.maximum.accumulate(np.where(np.isin(modes, (BEFORE, PD)), number, 0))
    columns[:, PD_AT:] = columns[last, PD_AT:]


class MotorCommands:
    """The commands to all joints of all bodies, filled chunk by chunk."""

    def __init__(self, seen: Seen) -> None:
        self._came = [appearance for appearance in seen.appearances if appearance.came]
        self._first = {each.client: each for each in reversed(seen.settings)}
        self._timesteps: dict[int, float] = {}
        """Current timestep of each client [s]."""
        self._reports = list(seen.settings)
        """The reports of settings that come after the chunks so far, in order."""
        self._joints: dict[tuple[int, int], _JointCommands] = {}
        """Commands of motors and torques, by body and link."""
        self._servos: dict[tuple[int, int, int], _JointCommands] = {}
        """Commands of PD_CONTROL, by client, the engine's id and link."""

    def take(self, piece: Piece) -> None:
        """Add the calls in a chunk."""
        joints = [*self._joints.values(), *self._servos.values()]
        for joint in joints:
            joint.begin(piece.first)
        timesteps = self._timesteps_at(piece)
        for command in piece.calls.commands():
            changes, values = timesteps[command.client]
            timestep_s = values[np.searchsorted(changes, command.calls)]
            for number, link in np.unique((command.bodies, command.joints), axis=1).T.tolist():
                its = (command.bodies == number) & (command.joints == link)
                came, which = piece.calls.bodies_at(command.client, number, command.calls)
                for k in np.unique(which[its & (which >= 0)]).tolist():
                    rows = its & (which == k)
                    self._command(came[k], link, command.only(rows), timestep_s[rows])
        loaded = [each for each in self._came if each.at.step < piece.end]
        self._came = self._came[len(loaded) :]
        for each in loaded:
            moment = np.array([[each.at.step], [each.at.call], [-1], [LOADED]])
            for link, width in enumerate(_widths(each.body)):
                key = each.body.number, link
                if key in self._joints:
                    self._joints[key].calls.append((moment, _fresh((width,))[None]))
        for joint in (*self._joints.values(), *self._servos.values()):
            joint.take()

    def asked(self, body: Body, ends: Int64) -> Commanded:
        """Return the commands in effect in the chunk's steps that lead to samples, shape (n,)."""
        fresh, key = _fresh(_widths(body)), (body.client, body.engine_id)
        found = np.empty((len(NAMES), len(ends), fresh.shape[1]))
        found[:] = fresh[:, None]
        for link, place in enumerate(body.rates):
            for joint, which in (
                (self._joints.get((body.number, link)), slice(PD_AT)),
                (self._servos.get((*key, link)), slice(PD_AT, None)),
            ):
                if joint is not None and joint.now.shape[1] == place.stop - place.start:
                    found[which, :, place] = joint.at(ends, which)
        return Commanded(*found)

    def torques(self, body: Body, tree: Tree, ends: Int64) -> Float64:
        """Return the torques commanded for joints in the given steps, shape (n, joint_rates)."""
        efforts = np.zeros((len(ends), tree.joint_rates))
        for link, rates in enumerate(tree.rates):
            joint = self._joints.get((body.number, link))
            if joint is None or not joint.torques:
                continue
            calls, steps, given = map(np.concatenate, zip(*joint.torques, strict=True))
            if given.shape[1] == rates.stop - rates.start:
                order = np.argsort(calls)
                found, rows = rows_of(steps[order] + 1, ends)
                place = slice(rates.start - tree.first_rate, rates.stop - tree.first_rate)
                np.add.at(efforts[:, place], rows, given[order[found]])
        return efforts

    def _command(self, came: Appearance, link: int, command: Command, timestep_s: Float64) -> None:
        """Add calls for one joint."""
        body, widths = came.body, _widths(came.body)
        if not 0 <= link < len(widths) or not widths[link]:
            return
        width, modes = widths[link], command.values["controlMode"][:, 0]
        # A call on a body that was not listed yet counts from the moment it was.
        early = (command.steps < came.at.step) | (
            (command.steps == came.at.step) & (command.calls < came.at.call)
        )
        steps = np.where(early, came.at.step, command.steps)
        moments = np.stack(
            (steps, np.where(early, came.at.call, command.calls), command.calls, modes)
        )
        columns = _columns(command, steps, width, timestep_s)
        key = body.number, link
        motor, servo = np.isin(modes, (VELOCITY, POSITION, TORQUE)), modes == PD
        if motor.any():
            joint = self._joints.setdefault(key, _JointCommands(_fresh((width,))))
            joint.calls.append((moments[:, motor], columns[motor]))
            torque, efforts = modes == TORQUE, command.torques
            if torque.any() and efforts is not None and efforts.shape[1] == width:
                joint.torques.append((command.calls[torque], steps[torque], efforts[torque]))
        if servo.any():
            joint = self._servos.setdefault(
                (body.client, body.engine_id, link), _JointCommands(_fresh((width,)))
            )
            joint.calls.append((moments[:, servo], columns[servo]))

    def _timesteps_at(self, piece: Piece) -> dict[int, tuple[Int64, Float64]]:
        """Return the timesteps in effect before and after each call that sets it [s], by client.

        A timestep is set by a call, or by a new simulation that reuses a client number, as the
        engine's report shows.
        """
        reported: dict[int, list[tuple[int, float]]] = {}
        for call in piece.calls.of(*SETS_TIMESTEP):
            if (timestep_s := call.timestep_s) is not None:
                reported.setdefault(call.client, []).append((call.at.call, timestep_s))
        reports = [each for each in self._reports if each.at.step < piece.end]
        self._reports = self._reports[len(reports) :]
        for report in reports:
            reported.setdefault(report.client, []).append((report.at.call - 1, _timestep_s(report)))
        found: defaultdict[int, tuple[Int64, Float64]] = defaultdict(
            lambda: (np.empty(0, np.int64), np.array([TIMESTEP_S]))
        )
        for client in self._first.keys() | reported.keys():
            if (timestep_s := self._timesteps.get(client)) is None:
                timestep_s = self._initially(piece, client)
            changes = sorted(reported.get(client, []), key=itemgetter(0))
            values = np.array([timestep_s, *(value for _, value in changes)])
            found[client] = np.array([number for number, _ in changes], np.int64), values
            self._timesteps[client] = float(values[-1])
        return found

    def _initially(self, piece: Piece, client: int) -> float:
        """Return the initial timestep of a simulation, before any call sets it [s]."""
        first = self._first.get(client)
        if first is None or any(
            call.client == client and order(call.at) <= order(first.at)
            for call in piece.calls.with_argument(*TIMESTEPS.values())
        ):
            return TIMESTEP_S
        return _timestep_s(first)


def _timestep_s(report: Settings) -> float:
    """Return the timestep that the engine reports [s]."""
    return float(np.ravel(report.values["fixedTimeStep"])[0])


def _columns(command: Command, steps: Int64, width: int, timestep_s: Float64) -> Float64:
    """Return the settings of calls for a joint, shape (n, NAMES, width); nan if unchanged."""
    mode, single = command.values["controlMode"], width == 1
    position, torque = mode == POSITION, mode == TORQUE
    force, target, rate = (
        command.given("force", width),
        command.given("targetPosition"),
        command.given("targetVelocity"),
    )
    turning = command.values.get("targetVelocity", np.full((len(steps), width), np.nan))
    turning = turning if turning.shape[1] == width else np.full((len(steps), width), np.nan)
    kp, kd, top = map(command.given, ("positionGain", "velocityGain", "maxVelocity"))
    site = float(command.site.number)
    columns = np.empty((len(steps), len(NAMES), width))
    for k, numbers in enumerate(
        (
            mode,
            np.where(position & single, target, np.nan),
            rate if single else turning,
            np.where(position, kp, 0.0),
            kd,
            force * timestep_s[:, None],
            force,
            np.where(position & (top > 0), top, np.nan),
            site,
            steps[:, None],
            steps[:, None],
            np.nan,
            np.where(torque, site, np.nan),
            1.0,
            target,
            rate,
            kp,
            kd,
            force,
        )
    ):
        columns[:, k] = numbers
    return columns


@cache
def _fresh(widths: tuple[int, ...]) -> Float64:
    """Return the commands to a newly loaded body: its default motors, shape (NAMES, rates)."""
    motor = (DEFAULT, np.nan, 0.0, 0.0, 1.0, np.nan, np.nan, np.nan, np.nan, 0.0, 0.0)
    fresh = np.full((len(NAMES), sum(widths)), np.nan)
    fresh[: len(motor)] = np.array(motor)[:, None]
    impulses = [DEFAULT_IMPULSES.get(width, np.nan) for width in widths]
    fresh[NAMES.index("impulse")] = np.repeat(impulses, widths)
    return fresh


def _widths(body: Body) -> tuple[int, ...]:
    return tuple(joint.widths[1] for joint in body.joints)
