"""What calls asked of joints: motors, which stay, torques of one step, and PD_CONTROL.

PyBullet keeps a motor's limit as an impulse: force × the timestep at the call, whatever the
timestep is later. Each revolute and prismatic joint begins with a velocity motor that may give
1 N m s in a step, whatever file it came from (`PhysicsServerCommandProcessor.cpp`,
createJointMotors). Nothing but another call of that mode changes PD_CONTROL: PyBullet keeps it by
the body's id, beyond other modes, `removeBody` and `resetSimulation` (`pdControlPlugin.cpp`).
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
"""How a joint is driven that has the motor that it was loaded with."""
LOADED, BEFORE = -2, -3
"""In place of a call's mode: its body was loaded; what was asked before the piece."""
DEFAULT_IMPULSES = {1: 1.0, 3: 1000.0}
"""The largest of the motor that a joint begins with, by its degrees of freedom [N s or N m s]."""
TIMESTEP_S = 1 / 240


@dataclass(frozen=True, eq=False)
class Commanded(Rowed):
    """What was asked of the joints in n steps; shape (n, joint_rates) each."""

    mode: Float64
    """Mode of the motor: DEFAULT, VELOCITY, POSITION."""
    target: Float64
    """Position [rad] or [m]; nan if there is none."""
    target_velocity: Float64
    kp: Float64
    kd: Float64
    impulse: Float64
    """The largest that the motor may give in a step [N s or N m s]."""
    force: Float64
    """Force as the call gave it [N or N m]; nan of a motor that no call set."""
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
    pd_velocity: Float64
    pd_kp: Float64
    pd_kd: Float64
    pd_force: Float64

    def motors(self, tree: Tree, reported: Float64) -> Float64:
        """Return the motors' efforts, of those reported, shape (n, joint_rates).

        Of a motor that was switched off PyBullet goes on to report the last effort.
        """
        if not tree.joint_rates:
            return reported
        counts = [rates.stop - rates.start for rates in tree.rates]
        return np.where((self.force == 0) & (np.repeat(counts, counts) == 1), 0.0, reported)

    def servos(self, law: DampedTree, before: States) -> Float64:
        """Return PD_CONTROL's efforts, shape (n, joint_rates)."""
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
    """What calls ask of one joint of a body; PD_CONTROL, of one joint of an id of the engine."""

    now: Float64
    """Shape (NAMES, width of the joint): at the end of the piece."""
    calls: list[tuple[Float64, Float64]] = field(default_factory=list)
    """Of the piece: when each counts, as step, call and its own number, and its mode, shape (4, m);
    what it asks, shape (m, NAMES, width)."""
    steps: Int64 | None = None
    """Step from which each row of `columns` counts, if there are any."""
    columns: Float64 = field(default_factory=lambda: np.empty(0))
    """What was asked before the piece, and after each call; shape (1 + m, NAMES, width)."""
    torques: list[tuple[Int64, Int64, Float64]] = field(default_factory=list)
    """Of TORQUE_CONTROL: numbers of calls and steps before them, shape (m,), efforts (m, width)."""

    def begin(self, first: int) -> None:
        """Forget what no step to sample `first` or a later one needs."""
        self.steps = None
        self.torques = [each for each in self.torques if each[1][-1] + 1 >= first]

    def take(self) -> None:
        """Put the calls of a piece in order, and fill in what each left as it was."""
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
        """Return columns in the steps to samples, shape (columns, n or 1, width)."""
        if self.steps is None:
            return self.now[which, None]
        rows = np.searchsorted(self.steps, ends - 1, side="right") - 1
        return np.moveaxis(self.columns[rows, which], 0, 1)


def _fill(steps: Int64, modes: Float64, columns: Float64) -> None:
    """Fill in what each call left as it was; rows in order, the first is that before them."""
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
    """What calls ask of the joints of all bodies; they come piece by piece."""

    def __init__(self, seen: Seen) -> None:
        self._came = [each for each in seen.appearances if each.came]
        self._first = {each.client: each for each in reversed(seen.settings)}
        self._timesteps: dict[int, float] = {}
        """By client."""
        self._reports = list(seen.settings)
        """What the engine reports of itself, in order, as far as no piece came to it."""
        self._joints: dict[tuple[int, int], _JointCommands] = {}
        """By body and link."""
        self._servos: dict[tuple[int, int, int], _JointCommands] = {}
        """PD_CONTROL, by client, the engine's id and link."""

    def take(self, piece: Piece) -> None:
        """Take the calls of a piece."""
        joints = [*self._joints.values(), *self._servos.values()]
        for joint in joints:
            joint.begin(piece.first)
        timesteps = self._timesteps_at(piece)
        for told in piece.calls.commands():
            changes, values = timesteps[told.client]
            timestep_s = values[np.searchsorted(changes, told.calls)]
            for number, link in np.unique((told.bodies, told.joints), axis=1).T.tolist():
                its = (told.bodies == number) & (told.joints == link)
                came, which = piece.calls.bodies_at(told.client, number, told.calls)
                for k in np.unique(which[its & (which >= 0)]).tolist():
                    rows = its & (which == k)
                    self._command(came[k], link, told.only(rows), timestep_s[rows])
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
        """Return what was asked in the steps to samples of the piece, shape (n,)."""
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
        """Return the sum of TORQUE_CONTROL's efforts in the steps to samples, (n, joint_rates)."""
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

    def _command(self, came: Appearance, link: int, told: Command, timestep_s: Float64) -> None:
        """Note calls for one joint."""
        body, widths = came.body, _widths(came.body)
        if not 0 <= link < len(widths) or not widths[link]:
            return
        width, modes = widths[link], told.values["controlMode"][:, 0]
        # What calls did to a body before it was listed is dated to that moment.
        early = (told.steps < came.at.step) | (
            (told.steps == came.at.step) & (told.calls < came.at.call)
        )
        steps = np.where(early, came.at.step, told.steps)
        moments = np.stack((steps, np.where(early, came.at.call, told.calls), told.calls, modes))
        columns = _columns(told, steps, width, timestep_s)
        key = body.number, link
        motor, servo = np.isin(modes, (VELOCITY, POSITION, TORQUE)), modes == PD
        if motor.any():
            joint = self._joints.setdefault(key, _JointCommands(_fresh((width,))))
            joint.calls.append((moments[:, motor], columns[motor]))
            torque, efforts = modes == TORQUE, told.torques
            if torque.any() and efforts is not None and efforts.shape[1] == width:
                joint.torques.append((told.calls[torque], steps[torque], efforts[torque]))
        if servo.any():
            joint = self._servos.setdefault(
                (body.client, body.engine_id, link), _JointCommands(_fresh((width,)))
            )
            joint.calls.append((moments[:, servo], columns[servo]))

    def _timesteps_at(self, piece: Piece) -> dict[int, tuple[Int64, Float64]]:
        """Return, by client, which calls changed the timestep; and those before and after each [s].

        A call sets it, and so does a simulation that begins under a client's number that an earlier
        one had: the engine's report is what tells of that.
        """
        told: dict[int, list[tuple[int, float]]] = {}
        for call in piece.calls.of(*SETS_TIMESTEP):
            if (timestep_s := call.timestep_s) is not None:
                told.setdefault(call.client, []).append((call.at.call, timestep_s))
        reports = [each for each in self._reports if each.at.step < piece.end]
        self._reports = self._reports[len(reports) :]
        for report in reports:
            told.setdefault(report.client, []).append((report.at.call - 1, _timestep_s(report)))
        found: defaultdict[int, tuple[Int64, Float64]] = defaultdict(
            lambda: (np.empty(0, np.int64), np.array([TIMESTEP_S]))
        )
        for client in self._first.keys() | told.keys():
            if (timestep_s := self._timesteps.get(client)) is None:
                timestep_s = self._initially(piece, client)
            changes = sorted(told.get(client, []), key=itemgetter(0))
            values = np.array([timestep_s, *(value for _, value in changes)])
            found[client] = np.array([number for number, _ in changes], np.int64), values
            self._timesteps[client] = float(values[-1])
        return found

    def _initially(self, piece: Piece, client: int) -> float:
        """Return the timestep of a simulation before its first call."""
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


def _columns(told: Command, steps: Int64, width: int, timestep_s: Float64) -> Float64:
    """Return what calls of motors ask of a joint, shape (n, NAMES, width); the rest is nan."""
    mode, single = told.values["controlMode"], width == 1
    position, torque = mode == POSITION, mode == TORQUE
    force, target, rate = (
        told.given("force", width),
        told.given("targetPosition"),
        told.given("targetVelocity"),
    )
    turning = told.values.get("targetVelocity", np.full((len(steps), width), np.nan))
    turning = turning if turning.shape[1] == width else np.full((len(steps), width), np.nan)
    kp, kd, top = map(told.given, ("positionGain", "velocityGain", "maxVelocity"))
    site = float(told.site.number)
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
    """Return what is asked of the rates of a body that was just loaded, shape (NAMES, rates)."""
    motor = (DEFAULT, np.nan, 0.0, 0.0, 1.0, np.nan, np.nan, np.nan, np.nan, 0.0, 0.0)
    fresh = np.full((len(NAMES), sum(widths)), np.nan)
    fresh[: len(motor)] = np.array(motor)[:, None]
    impulses = [DEFAULT_IMPULSES.get(width, np.nan) for width in widths]
    fresh[NAMES.index("impulse")] = np.repeat(impulses, widths)
    return fresh


def _widths(body: Body) -> tuple[int, ...]:
    return tuple(joint.widths[1] for joint in body.joints)
