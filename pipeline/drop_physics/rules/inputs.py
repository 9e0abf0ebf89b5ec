"""Collects the calls of a whole run and their effects, for rules about calls."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from drop_physics.arrays import Float64
from drop_physics.explain.steps import BodySteps
from drop_physics.physics.kinematics import kinematics, motion
from drop_physics.physics.rotations import rotate, rotate_inverse
from drop_physics.physics.tree import States, Tree
from drop_physics.rules.arguments import number as number_of
from drop_physics.rules.chunk import StepChunk
from drop_physics.rules.episodes import Episodes
from drop_physics.rules.ik_answers import SentAnswers
from drop_physics.rules.lasting import Lasting
from drop_physics.rules.thresholds import EACH_STEP
from drop_physics.trace.acts import FILTERS, PUSHES, Act
from drop_physics.trace.calls import BODY_NAMES, Call
from drop_physics.trace.events import At, Body, Dynamics, Site
from drop_physics.trace.history import Seen
from drop_physics.trace.log import Log
from drop_physics.trace.motors import POSITION, TORQUE, VELOCITY
from drop_physics.trace.requests import Request, requests
from drop_physics.trace.states import Rows, between, by_body

Place = tuple[int, int]
"""A body id, and a link of that body."""
ROUNDING = 1e-9
"""Share of a body's weight below which what compensation leaves of it is rounding."""
_NAMES: dict[Act, tuple[Sequence[str], Sequence[str]]] = {
    Act.CONSTRAIN: (("parentBodyUniqueId", "childBodyUniqueId"), ("parent", "child")),
    Act.FILTER_PAIR: (("bodyUniqueIdA", "bodyUniqueIdB"), ("linkIndexA", "linkIndexB")),
    Act.FILTER_GROUP: (BODY_NAMES, ("linkIndexA",)),
}
"""Arguments that identify bodies and their links."""
FOLLOWED = (
    *(Act.SET_POSE, Act.SET_VELOCITY, Act.SET_JOINT, Act.LOAD, Act.SOLVE_IK, Act.SOLVE_SEVERAL_IK),
    *(Act.CHANGE_CONSTRAINT, Act.CONSTRAIN, Act.SET_GRAVITY, Act.SET_TIMESTEP, Act.SET_ENGINE),
    *(Act.SET_REAL_TIME, Act.SET_PROPERTY, Act.CLEAR, *PUSHES, *FILTERS),
)
"""Kinds of calls that are tracked; of joint commands only torques, but all if nothing steps."""
WRITTEN = (
    *(Act.SET_BODY_FORCE, Act.SET_JOINT_FORCE, Act.SET_MASS, Act.SET_DERIVED),
    *(Act.SET_STATE, Act.SET_ACTIVE, Act.RESET_STATE),
)
"""Memory fields whose writes are tracked."""


@dataclass
class Use:
    """All calls of one function from one script line, for one body if the calls name one."""

    first: Call
    body: Body | None
    made: list[At] = field(default_factory=list)
    """Moments at which the calls were made."""
    last: Call = field(init=False)
    low: dict[str, Float64] = field(default_factory=dict)
    """The smallest value of each element of an argument, by argument name."""
    high: dict[str, Float64] = field(default_factory=dict)

    def add(self, call: Call) -> None:
        """Add a call."""
        self.last = call
        self.made.append(call.at)
        for name, numbers in call.values.items():
            values = np.array(numbers)
            if name not in self.low or self.low[name].shape != values.shape:
                self.low[name] = self.high[name] = values
            self.low[name] = np.minimum(self.low[name], values)
            self.high[name] = np.maximum(self.high[name], values)

    @property
    def count(self) -> int:
        """Number of calls."""
        return len(self.made)

    @cached_property
    def steps(self) -> set[int]:
        """The steps before which the calls were made, without duplicates."""
        return {at.step for at in self.made}

    def constant(self, name: str) -> bool:
        """Return whether an argument always had the same values."""
        return name in self.low and bool(np.array_equal(self.low[name], self.high[name]))


@dataclass
class BaseMotion:
    """The first and last pose of a body's base, and the steps in between."""

    samples: int = 0
    first_m: Float64 | None = None
    last_m: Float64 | None = None

    @property
    def moved_m(self) -> float:
        """Distance between the base's first and last position [m]."""
        if self.first_m is None or self.last_m is None:
            return 0.0
        return float(np.linalg.norm(self.last_m - self.first_m))


@dataclass(frozen=True, eq=False)
class FileInertia:
    """The inertia that a body's file states, beside the one that the engine used."""

    added: Float64
    """The diagonal of the mass matrix M by the file's inertia minus that by the inertia used [kg
    m²], shape (size,); 0 if both are equal, or the file's is unknown."""
    used: Float64
    """The diagonal of M by the inertia that the engine used [kg m²], shape (size,)."""
    changed: Call | None
    """The call that set a mass, which made the engine recompute the inertia."""


@dataclass
class BodyLife:
    """The steps from a body's loading to its removal."""

    first: int
    """The sample after its first step."""
    before: States
    """The initial state of its first step."""
    tree: Tree
    last: int = 0
    count: int = 0
    fastest: float = 0.0
    """The highest rate of any of the body's joints [rad/s] or [m/s]."""
    pushed_m_s: Float64 | None = None
    """The velocity change of a free base by the first force from a call [m/s], shape (3,)."""
    opposed: float = 0.0
    """The share of that velocity change that forces other than gravity cancelled in the same
    step."""
    falls: bool = False
    """Whether gravity acted, beyond what compensation takes off."""
    lifted: bool = False
    """Whether compensation took some of it off."""
    held: bool = False
    """Whether a constraint acted on the body."""
    tilt_rad: float = 0.0
    """The final tilt angle of the base [rad]."""
    of_file: FileInertia | None = None
    """The inertia from its file, computed when a rule first needs it."""

    def add(self, steps: BodySteps) -> None:
        """Count one or more steps."""
        up = rotate_inverse(self.before.orientation, np.array([[0.0, 0.0, 1.0]]))
        upright = rotate(steps.after.orientation[-1:], up)[0, 2]
        self.tilt_rad = float(np.arccos(np.clip(upright, -1, 1)))
        self.last, self.count = int(steps.steps[-1]), self.count + len(steps)
        self.fastest = max(self.fastest, float(np.abs(steps.after.velocity).max(initial=0.0)))
        pulled = steps.whole.reported.gravity_m_s2[steps.rows].any(axis=1)
        if (lift := steps.terms.get("gravity compensation")) is not None:
            weight, self.lifted = steps.terms["gravity"], self.lifted or bool(lift.any())
            pulled &= (np.abs(weight + lift) > ROUNDING * np.abs(weight)).any(axis=1)
        self.falls = self.falls or bool(pulled.any())
        self.held = self.held or bool(np.any(steps.terms.get("constraints", 0)))
        if steps.terms and not self.tree.fixed and self.pushed_m_s is None:
            pushes = steps.terms["applied"][:, 3:6] / self.tree.masses_kg.sum()
            for row in np.flatnonzero(pushes.any(axis=1))[:1]:
                self.pushed_m_s = pushes[row].copy()
                left = (steps.after.velocity - steps.before.velocity)[row, 3:6]
                left = left - steps.reported.gravity_m_s2[row] * steps.reported.timestep_s[row]
                largest = np.abs(self.pushed_m_s).max()  # its square may be no number
                along = self.pushed_m_s / largest
                self.opposed = 1 - float(left @ along / largest / (along @ along))


@dataclass
class Drive:
    """The targets that calls set for a constraint between a body and the world."""

    body: Body
    call: Call
    targets_m: list[tuple[float, ...]] = field(default_factory=list)
    places_m: list[Float64] = field(default_factory=list)
    """Positions of the body at the time of these calls [m], shape (3,) each."""


@dataclass
class Inputs:
    """The calls of a run, with their effects; filled chunk by chunk."""

    seen: Seen
    uses: dict[tuple[int, int, int | None, float], Use] = field(default_factory=dict)
    """Uses by the id of a call site, its client, the body id that its calls name, and the joint
    that they set."""
    requests: list[Request] = field(default_factory=list)
    commanded: defaultdict[int, dict[int, Call | None]] = field(
        default_factory=lambda: defaultdict(dict)
    )
    """The joints that calls command, by body id."""
    motions: defaultdict[int, BaseMotion] = field(default_factory=lambda: defaultdict(BaseMotion))
    lives: dict[tuple[int, int], BodyLife] = field(default_factory=dict)
    """Lives of bodies by body id, and index of the life, since ids are reused."""
    first_lives: dict[int, BodyLife] = field(default_factory=dict)
    """The first life of each body, by body id."""
    drives: dict[tuple[int, int], Drive] = field(default_factory=dict)
    """The constraints whose target calls change, by client and the engine's id."""
    link_way_m: dict[tuple[int, int, int], float] = field(default_factory=dict)
    """The largest displacement of a link in one step while a script reads it [m], by reading, body
    and link."""
    torque_alone: set[tuple[int, int]] = field(default_factory=set)
    """Bodies and joints driven by TORQUE_CONTROL alone, whose motors exerted no torque."""
    touched: dict[tuple[int, int], int] = field(default_factory=dict)
    """Number of steps in which two bodies pressed on each other, by pair, the lower id first."""
    passes: dict[frozenset[Place], Call] = field(default_factory=dict)
    """Pairs of links for which a call disabled collisions."""
    joined: set[frozenset[int]] = field(default_factory=set)
    """Bodies attached by a constraint."""
    filtered: set[int] = field(default_factory=set)
    """Simulations in which calls set collision groups, or re-enable collisions between bodies."""
    lasting: Lasting = field(default_factory=Lasting)
    overridden: dict[tuple[int, int, int], tuple[Site, Site, set[int]]] = field(
        default_factory=dict
    )
    """Call sites that command the same motor before one step, and those steps: by body, joint,
    later site."""
    raised: tuple[Call | None, Log] = (None, Log())
    """The last call that raised an exception, and the calls around it."""
    ik: SentAnswers = field(default_factory=SentAnswers)
    episodes: Episodes = field(default_factory=Episodes)

    def see(self, chunk: StepChunk) -> None:
        """Add the calls and states of a chunk."""
        calls = chunk.piece.calls
        bases = by_body(chunk.piece.bases)
        for call in calls.of(*FOLLOWED):
            self._use(call, chunk)
            self._drive(call, bases, chunk)
            self._pair(call, chunk)
        waits = {client for client, samples in self.seen.samples.items() if samples == 1}
        torque = any((each.values["controlMode"] == TORQUE).any() for each in calls.commands())
        for call in calls.of(Act.COMMAND) if waits or torque else ():
            if call.client in waits or number_of(call, "controlMode") == TORQUE:
                self._use(call, chunk)
        for call in calls.failed()[-1:]:
            self.raised = call, calls
        self.lasting.see(calls.of(*WRITTEN))
        self.ik.see(calls)
        self.episodes.see(chunk, self.seen)
        self.requests += requests(calls, self.seen.dynamics, self.seen.settings)
        self._override(calls)
        for command in calls.commands():
            ids = np.unique(command.bodies).tolist()
            for number in ids:
                came, which = calls.bodies_at(command.client, number, command.calls)
                for k in np.unique(which[which >= 0]).tolist():
                    joints = np.unique(command.joints[(command.bodies == number) & (which == k)])
                    self.commanded[came[k].body.number] |= dict.fromkeys(joints.tolist())
        for number, judged in chunk.judged.items():
            motion = self.motions[number]
            motion.samples += len(judged.steps)
            for steps in judged.intervals:
                if len(steps):
                    key = number, steps.config.life
                    if key not in self.lives:
                        began, tree = steps.before.at(np.array([0])), steps.law.tree
                        self.lives[key] = BodyLife(int(steps.steps[0]), began, tree)
                        self.first_lives.setdefault(number, self.lives[key])
                    self.lives[key].add(steps)
                    begin, end = steps.before.position_m[0], steps.after.position_m[-1]
                    motion.first_m = begin.copy() if motion.first_m is None else motion.first_m
                    motion.last_m = end.copy()
        self._links(chunk)
        self._torques(chunk)
        pairs = chunk.pairs
        for first, second, rows in pairs.by_pair(pairs.normal_n > 0):
            key = first, second
            self.touched[key] = self.touched.get(key, 0) + len(rows)

    def _override(self, calls: Log) -> None:
        """Note the motors that get two different commands before the same step.

        Different targets from one script line count, too.
        """
        told = [
            np.column_stack(
                [
                    np.full(len(command.calls), command.client),
                    *(command.bodies, command.joints, command.steps, command.calls),
                    *(command.given("controlMode")[:, 0], command.given("force")[:, 0]),
                    np.full(len(command.calls), command.site.number),
                    *(command.given(name)[:, 0] for name in ("targetPosition", "targetVelocity")),
                ]
            )
            for command in calls.commands()
        ]
        rows = np.concatenate([*told, np.empty((0, 10))])
        rows = rows[np.isin(rows[:, 5], (POSITION, VELOCITY))]
        rows = rows[np.lexsort(rows.T[4::-1])]
        changes = np.diff(rows, axis=0) != 0
        again = changes[:, 5] | (changes[:, 8:].any(axis=1) & ~changes[:, 7])
        again &= ~changes[:, :4].any(axis=1)
        again &= rows[:-1, 6] != 0  # that turns a motor off
        for one, two in zip(rows[:-1][again], rows[1:][again], strict=True):
            client, engine_id, joint, step, call = two[:5].astype(int).tolist()
            came, (which,) = calls.bodies_at(client, engine_id, np.array([call]))
            sites = calls.sites[int(one[7])], calls.sites[int(two[7])]
            key = came[which].body.number, joint, int(two[7])
            self.overridden.setdefault(key, (*sites, set()))[2].add(step)

    def _links(self, chunk: StepChunk) -> None:
        """Note how far the links whose poses the script reads move per step."""
        read = [
            (reading, subject.body, subject.link)
            for reading in self.seen.readings
            if reading.act is Act.READ_LINK
            for subject in reading.targets
            if subject.link is not None
        ]
        for number in {body for _, body, _ in read} & chunk.judged.keys():
            for steps in chunk.judged[number].intervals:
                tree = steps.law.tree
                if not len(steps) or not tree.size:
                    continue
                moved = motion(kinematics(tree, steps.after), steps.after.velocity).velocities
                for each, body, link in read:
                    while_read = np.isin(steps.steps, (each.first_step, each.last_step))
                    if each.count >= EACH_STEP * (each.last_step - each.first_step + 1):
                        while_read |= steps.steps >= each.first_step
                        while_read &= (steps.steps <= each.last_step) | (not each.exact)
                    if body != number or link >= tree.links or not while_read.any():
                        continue
                    speed = np.linalg.norm(moved[link + 1], axis=0)
                    way_m = float((speed * steps.reported.timestep_s)[while_read].max())
                    key = each.number, number, link
                    self.link_way_m[key] = max(way_m, self.link_way_m.get(key, 0.0))

    def _torques(self, chunk: StepChunk) -> None:
        """Note the joints that are driven by torque control only."""
        for driven in chunk.driven:
            acts = (driven.steps.reported.commanded != 0).any(axis=0)
            motor = (driven.torque != 0).any(axis=0)
            for joint, place in zip(driven.body.joints, driven.body.rates, strict=True):
                key = driven.body.number, joint.link
                if acts[place].any() and not motor[place].any():
                    self.torque_alone.add(key)
                elif motor[place].any():
                    self.torque_alone.discard(key)

    def _drive(self, call: Call, bases: Mapping[int, Rows], chunk: StepChunk) -> None:
        """Note a constraint with the world, or a new target of one."""
        if call.act is Act.CONSTRAIN and call.values["childBodyUniqueId"][0] < 0:
            came = chunk.piece.calls.body_at(call, int(call.values["parentBodyUniqueId"][0]))
            if came is not None and np.isfinite(call.result):
                self.drives[call.client, int(call.result)] = Drive(came.body, call)
        target = call.values.get("jointChildPivot", ())
        if call.act is not Act.CHANGE_CONSTRAINT or len(target) != 3:
            return
        drive = self.drives.get((call.client, int(call.values["userConstraintUniqueId"][0])))
        base = None if drive is None else bases.get(drive.body.number)
        if drive is None or base is None:
            return
        here = between(base, call.at.step, call.at.step + 1)["position_m"]
        if len(here):
            drive.call = call
            drive.targets_m.append(target)
            drive.places_m.append(here[0].copy())

    def _pair(self, call: Call, chunk: StepChunk) -> None:
        """Note which links calls join, exclude from contact, or assign to a collision group."""
        bodies, sides = _NAMES.get(call.act, ((), ()))
        came = [
            chunk.piece.calls.body_at(call, int(number_of(call, body, -1.0)))
            for body in bodies
            if body in call.site.places
        ]
        links = [int(number_of(call, side, -1.0)) for side in sides]
        pair = [(each.body.number, link) for each, link in zip(came, links, strict=False) if each]
        if call.act is Act.CONSTRAIN:
            self.joined.add(frozenset(number for number, _ in pair))
        elif call.act is Act.FILTER_PAIR and number_of(call, "enableCollision", 1.0) == 0:
            self.passes[frozenset(pair)] = call
        elif call.act in FILTERS:
            self.filtered.add(call.client)
            self.passes.pop(frozenset(pair), None)

    def _use(self, call: Call, chunk: StepChunk) -> None:
        came = chunk.body_of(call)
        joint = number_of(call, "jointIndex", -1.0) if call.act is Act.SET_JOINT else -1.0
        key = call.site.number, call.client, None if came is None else came.number, joint
        self.uses.setdefault(key, Use(call, came)).add(call)

    def of(self, *acts: Act) -> Iterator[Use]:
        """Yield all uses of functions of the given kinds."""
        for use in self.uses.values():
            if use.first.act in acts:
                yield use

    def made(self, client: int, *acts: Act) -> Iterator[tuple[At, Use]]:
        """Yield a simulation's calls of the given kinds, each with its time; unordered."""
        for use in self.of(*acts):
            if use.first.client == client:
                yield from ((at, use) for at in use.made)

    def first_dynamics(self, body: Body) -> Dynamics | None:
        """Return the engine's first dynamics report for a body; None for a soft body."""
        its = (each for each in self.seen.dynamics if each.body.number == body.number)
        return next(its, None)

    def left_out(self, act: Act) -> tuple[list[Use], list[int]]:
        """Return uses of a setter for client 0 only, and the simulations that lack it.

        The second list is empty if any call names a client, or if there are fewer calls than
        simulations.
        """
        uses = [*self.of(act)]
        mine = [use for use in uses if use.first.client == 0]
        named = any("physicsClientId" in use.first.site.places for use in mine)
        clients = self.clients()
        if named or sum(use.count for use in mine) < len(clients):
            return mine, []
        return mine, [c for c in clients if c and all(use.first.client != c for use in uses)]

    def clients(self) -> list[int]:
        """Return the simulations that had a body when they were stepped."""
        bodies = self.seen.bodies
        return sorted({bodies[n].client for n, motion in self.motions.items() if motion.samples})
