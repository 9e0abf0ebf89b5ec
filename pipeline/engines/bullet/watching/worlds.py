"""One simulation, as its engine has it: its bodies, and their current state.

Everything is read with PyBullet's own functions, and nothing here changes a number in it:
`tests/test_record.py` checks that over many scripts.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterable
from operator import sub
from types import SimpleNamespace
from typing import Any

from . import pipe as protocol
from .capsules import lay
from .links import path_of
from .pipe import Pipe

FIXED, SPHERICAL = 4, 2
"""Types of joint, as in `getJointInfo`."""
RIGID, SOFT = 1, 3
"""Types of body, as in `getDynamicsInfo`."""
EMPTY_M = 0.0021
"""The box of a link without collision shapes has edges of 2 mm."""
FILE = 4
"""Where `getVisualShapeData` names a shape's file."""
LEAST_CHANGE = 0.01
"""If the last iteration changes a velocity by more, further ones were needed [m/s, rad/s].
"""
ASKED_EVERY = 8
"""One step in this many returns what the solver did: asking takes as long as recording a box."""
MOST_ISLANDS = 64
"""Groups of touching bodies that PyBullet has room for in what a step returns."""
ALL = None
"""In place of a body: a call may have moved any of them."""
PART, JOINT, POINT = struct.Struct("<13d"), struct.Struct("<3d"), struct.Struct("<23d")
"""The numbers of a base or link, of a joint, of a contact point."""
FRAME_HEAD = protocol.HEADER.size + protocol.HEAD.size


class Body:
    """What must be known of a body to read it.

    Parameters
    ----------
    number
        Of this body in this stream: never reused, unlike the engine's id.
    """

    def __init__(self, number: int, engine_id: int, client: int, p: SimpleNamespace) -> None:
        self.number, self.id, self._client, self._p = number, engine_id, client, p
        self.links = list(range(p.getNumJoints(engine_id, client)))
        self.joint_infos = [p.getJointInfo(engine_id, link, client) for link in self.links]
        self.joints = [info[0] for info in self.joint_infos if info[2] != FIXED]
        self.spherical = any(info[2] == SPHERICAL for info in self.joint_infos)
        self.dynamics = self.read_dynamics()
        self.soft = self.dynamics[0][10] == SOFT
        self.base_moves = self.dynamics[0][0] != 0
        """Whether steps may move its base: it has mass, had it, or has got a velocity."""
        self.widths = self._joint_widths()
        """Of each joint that moves: how many positions, velocities and torques it has."""
        self.size = PART.size * (1 + len(self.links)) + 8 * sum(map(sum, self.widths))
        """Bytes of its state."""

    @property
    def moves(self) -> bool:
        """Whether steps move it, and not only calls."""
        return not self.soft and (self.base_moves or bool(self.joints))

    def is_carried(self) -> bool:
        """Whether a call has given a base a velocity that no step moved until now.

        Without mass a btMultiBody moves at that velocity, and a btRigidBody not at all.
        """
        if self.soft or self.base_moves or self.dynamics[0][10] == RIGID:
            return False
        return any(map(any, self._p.getBaseVelocity(self.id, self._client)))

    def read_dynamics(self) -> list[Any]:
        """Return what the engine reports for base and links, in this order."""
        return [self._p.getDynamicsInfo(self.id, link, self._client) for link in (-1, *self.links)]

    def read_into(self, buffer: bytearray, at: int) -> None:
        """Write the state: 13 numbers for base and links, then those of the joints that move.

        Nothing grows on the way: under `MALLOC_PERTURB_` glibc may then fill the whole rest of its
        heap again.
        """
        p, client = self._p, self._client
        position, orientation = p.getBasePositionAndOrientation(self.id, client)
        linear, angular = p.getBaseVelocity(self.id, client)
        PART.pack_into(buffer, at, *position, *orientation, *linear, *angular)
        if self.links:
            states = p.getLinkStates(
                self.id, self.links, computeLinkVelocity=1, physicsClientId=client
            )
            for state in states:
                at += PART.size
                PART.pack_into(buffer, at, *state[0], *state[1], *state[6], *state[7])
        at += PART.size
        if self.spherical:
            for state in p.getJointStatesMultiDof(self.id, self.joints, client):
                values = (*state[0], *state[1], *state[3])
                struct.pack_into(f"<{len(values)}d", buffer, at, *values)
                at += 8 * len(values)
        elif self.joints:
            for state in p.getJointStates(self.id, self.joints, client):
                JOINT.pack_into(buffer, at, state[0], state[1], state[3])
                at += JOINT.size

    def _joint_widths(self) -> list[tuple[int, int, int]]:
        if not self.spherical:
            return [(1, 1, 1)] * len(self.joints)
        states = self._p.getJointStatesMultiDof(self.id, self.joints, self._client)
        return [(len(joint[0]), len(joint[1]), len(joint[3])) for joint in states]

    def bounds(self) -> list[float]:
        """Return the corners of the axis-aligned boxes around base and links.

        PyBullet gives a link of a URDF without collision shapes a box of its margins, which nothing
        touches: here both corners are its centre.
        """
        if self.soft:
            return []
        boxes = []
        for link in (-1, *self.links):
            low, high = self._p.getAABB(self.id, link, self._client)
            if self._is_empty(link, [*map(sub, high, low)]):
                low = high = [(a + b) / 2 for a, b in zip(low, high)]
            boxes += [*low, *high]
        return boxes

    def _is_empty(self, link: int, edges_m: list[float]) -> bool:
        """Whether a link with a box of these edges has no collision shapes.

        PyBullet does not list those of a btRigidBody: one that is this small counts as empty.
        """
        if max(edges_m) >= EMPTY_M:
            return False
        if self.dynamics[0][10] == RIGID:
            return max(abs(edge_m - 0.002) for edge_m in edges_m) < 1e-9
        return not self._p.getCollisionShapeData(self.id, link, self._client)

    def looks(self, search_path: str) -> list[Any]:
        """Return its visual shapes, as `getVisualShapeData` lists them, with paths of their files.

        That function returns the name that a call gave, which PyBullet has searched for.
        """
        if self.soft:
            return []
        shapes: list[Any] = _plain(self._p.getVisualShapeData(self.id, 0, self._client))
        for shape in shapes:
            shape[FILE] = path_of(shape[FILE], search_path) or shape[FILE]
        return shapes


class World:
    """One client's simulation.

    Parameters
    ----------
    number
        Of this simulation in this stream; the engine reuses its client ids.
    first_step, first_time_s
        Where its steps and its time begin.
    """

    bodies_made = 0
    """In all simulations of this process."""
    search_path = ""
    """Where PyBullet looks for files besides; likewise."""

    def __init__(
        self, pipe: Pipe, p: SimpleNamespace, *, client: int, number: int, method: str,
        first_step: int, first_time_s: float,
    ) -> None:  # fmt: skip
        self._pipe, self._p = pipe, p
        self.client, self.number, self.method = client, number, method
        self.step, self.time_s = first_step, first_time_s
        self.given: dict[str, Any] = {}
        """Settings of the engine that it does not report, as calls gave them."""
        self.fresh: set[int] = set()
        """Bodies that a call has created: their ids may have been others' before."""
        self.files: dict[int, str] = {}
        """The files that bodies were loaded from: the names in them mislead."""
        self.mjcf: dict[int, str | None] = {}
        """The path of those that `loadMJCF` loaded; None where it is not known."""
        self.inertial: dict[int, tuple[Any, Any] | None] = {}
        """The inertial frames of btRigidBodies, position and orientation; None of other bodies."""
        self.hiding: set[int] = set()
        """Bodies of several links that became btRigidBodies, of which only the base is reported."""
        self.added: dict[int, list[Any]] = {}
        """What was reported of bodies whose mass a call changed before they were first listed."""
        self.flags: dict[int, int] = {}
        """What they were loaded with: only these tell whether a body may sleep."""
        self.moved: dict[int | None, set[Any]] = {}
        """Bodies that calls may have moved since they were last read, and which calls."""
        self.changed: set[int | None] = set()
        """Bodies whose dynamics calls may have changed."""
        self.recoloured: set[int] = set()
        self.stale_bodies = self.stale_engine = True
        self._later: list[tuple[int | None, str, dict[str, Any]]] = []
        self._motors: dict[tuple[int | None, Any], Any] = {}
        self.returns_analytics: bool | None = None if method == "before" else False
        """Whether the script itself has steps return what the solver did; None if unknown."""
        self._has_analytics = True
        """Whether this PyBullet can return what the solver did."""
        self._early: dict[int, dict[str, Any]] = {}
        """By iteration limit: how often the solver was seen to reach it."""
        self.bodies: dict[int, Body] = {}
        self.timestep_s = 0.0
        self._sampled = False
        self._since, self._steps_since = first_time_s, 0
        self._engine: dict[str, Any] | None = None
        self._moving: list[Body] = []
        self._buffer = bytearray()
        """The last sample, as sent."""
        self._places: dict[int, int] = {}
        """Where in it the states of bodies begin, by the engine's ids."""
        self._last: dict[int, bytes] = {}
        """States sent outside samples, of bodies that no later sample has."""
        pipe.note("world", world=number, client=client, method=method,
            first_step=first_step, first_time_s=first_time_s)  # fmt: skip

    # -- what calls have changed ------------------------------------------------------------------

    def sync(self, *, sample_follows: bool = False) -> None:
        """Send what calls have changed since this was last called.

        What a sample that follows at once will hold is left to it.
        """
        if self.stale_engine:
            self._read_engine()
        if self.stale_bodies or self.fresh:
            self._list_bodies()
        if self.changed:
            self._read_dynamics()
        for body in [self.bodies[key] for key in self.recoloured if key in self.bodies]:
            self._pipe.note("look", body=body.number, visual=self._looks(body))
        self.recoloured = set()
        if self.moved:
            for body in self.bodies.values():
                is_moved = ALL in self.moved or body.id in self.moved
                if is_moved and body.is_carried():
                    body.base_moves = True
                    self._pipe.note("carried", body=body.number)
                    self._lay_out()
                if is_moved and not (sample_follows and body.moves):
                    self._send_if_set(body)
            self.moved = {}
        for engine_id, what, values in self._later:
            if engine_id in self.bodies:
                self._pipe.note(what, body=self.bodies[engine_id].number, step=self.step, **values)
        self._later = []

    def tell_held(self, constraint: int | None, bodies: list[int | None]) -> None:
        """Report a constraint between bodies, by the engine's ids; other ids are the world."""
        self.sync(sample_follows=not self._sampled)  # they may be new
        numbers = [self.bodies[key].number for key in bodies if key in self.bodies]
        self._pipe.note("held", world=self.number, step=self.step, constraint=constraint,
            bodies=numbers)  # fmt: skip

    def tell_motor(self, body: int | None, joint: int, mode: int, force: float | None) -> None:
        """Report how a motor is driven, if that has changed."""
        if self._motors.get((body, joint)) != (mode, force):
            self._motors[body, joint] = mode, force
            self.tell_later(body, "motor", joint=joint, mode=mode, force=force)

    def tell_later(self, engine_id: int | None, what: str, **values: Any) -> None:
        """Report something about a body with the next `sync`, when its number is known."""
        self._later.append((engine_id, what, values))

    def forget(self) -> None:
        """Note that a reset has removed all bodies."""
        for body in self.bodies.values():
            self._pipe.note("gone", body=body.number)
        self.bodies, self._moving, self._last, self._places = {}, [], {}, {}
        self.fresh, self.moved, self.changed, self.recoloured = set(), {}, set(), set()
        self.stale_bodies = self.stale_engine = True
        self.given, self._later, self._motors, self.added = {}, [], {}, {}
        self.returns_analytics = False

    def before_mass(self, engine_id: int) -> None:
        """Keep what is reported of a new body whose mass a call is about to change."""
        if engine_id in self.fresh and engine_id not in self.added:
            try:
                links = range(-1, self._p.getNumJoints(engine_id, self.client))
                self.added[engine_id] = [
                    self._p.getDynamicsInfo(engine_id, link, self.client) for link in links
                ]
            except self._p.error:  # it is gone: the call itself will say so
                return

    def note_inertial(
        self, engine_id: int, position: list[float] | None, orientation: list[float] | None
    ) -> None:
        """Note where the centre of mass of a new btRigidBody is in the frame that it was put at.

        `getDynamicsInfo` returns leftovers as that of a btRigidBody.
        """
        position = position if position and len(position) == 3 else [0, 0, 0]
        orientation = orientation if orientation and len(orientation) == 4 else [0, 0, 0, 1]
        pose = self._p.getBasePositionAndOrientation(engine_id, self.client)
        inverse = self._p.invertTransform(position, orientation)
        self.inertial[engine_id] = self._p.multiplyTransforms(*inverse, *pose)

    def forget_ids(self, ids: list[int]) -> None:
        """Note that new bodies have these ids: what calls did before concerned others."""
        self._later = [each for each in self._later if each[0] not in ids]
        for key in [key for key in self._motors if key[0] in ids]:
            del self._motors[key]
        for each in ids:
            self.added.pop(each, None)

    def _list_bodies(self) -> None:
        p, client = self._p, self.client
        ids = [p.getBodyUniqueId(index, client) for index in range(p.getNumBodies(client))]
        present = set(ids)
        for key in [key for key in self.bodies if key not in present or key in self.fresh]:
            self._pipe.note("gone", body=self.bodies.pop(key).number)
            self._last.pop(key, None)
            self._places.pop(key, None)
        for key in ids:
            if key not in self.bodies:
                self.bodies[key] = self._describe(key)
                if not self.bodies[key].soft:
                    self.moved.setdefault(key, set())
        self.fresh, self.stale_bodies = set(), False
        self._lay_out()

    def _describe(self, engine_id: int) -> Body:
        body = Body(World.bodies_made, engine_id, self.client, self._p)
        World.bodies_made += 1
        base, name = self._p.getBodyInfo(engine_id, self.client)
        added, now = self.added.pop(engine_id, body.dynamics), body.dynamics
        # A body keeps moving without the mass that it had, and a btRigidBody that had none stands.
        stays = bool(added[0][0]) == bool(now[0][0]) or (not added[0][0] and now[0][10] != RIGID)
        added = now if stays else added
        body.base_moves |= added[0][0] != 0
        self._pipe.note(
            "body", world=self.number, body=body.number, id=engine_id, name=_plain(name),
            base=_plain(base), file=self.files.get(engine_id, ""), soft=body.soft,
            flags=self.flags.get(engine_id, 0), hides_links=engine_id in self.hiding,
            bounds=body.bounds(),
            dynamics=_plain(added), joints=_plain(body.joint_infos),
            joint_widths=body.widths, visual=self._looks(body),
            inertial=_plain(self.inertial.get(engine_id)),
        )  # fmt: skip
        if added is not body.dynamics:
            self._pipe.note("dynamics", body=body.number, dynamics=_plain(body.dynamics))
        return body

    def _looks(self, body: Body) -> list[Any]:
        shapes = body.looks(self.search_path)
        if body.id in self.mjcf:
            base = self._p.getBodyInfo(body.id, self.client)[0]
            names = _plain([base, *(info[12] for info in body.joint_infos)])
            lay(shapes, names, self.mjcf[body.id])
        return shapes

    def _read_dynamics(self) -> None:
        all_changed = ALL in self.changed
        for body in [
            body for body in self.bodies.values() if all_changed or body.id in self.changed
        ]:
            dynamics = body.read_dynamics()
            if dynamics != body.dynamics:
                body.dynamics = dynamics
                # A body in motion keeps moving when a call removes its mass.
                body.base_moves |= dynamics[0][0] != 0
                self._pipe.note("dynamics", body=body.number, dynamics=_plain(dynamics))
        self.changed = set()
        self._lay_out()

    def _read_engine(self) -> None:
        reported = self._p.getPhysicsEngineParameters(self.client)
        if reported["fixedTimeStep"] != self.timestep_s:
            self._since, self._steps_since = self.time_s, 0
            self.timestep_s = reported["fixedTimeStep"]
        now = {**reported, **{f"set_{name}": value for name, value in self.given.items()}}
        if now != self._engine:
            self._engine = now
            self._pipe.note("engine", world=self.number, step=self.step, time_s=self.time_s,
                settings=_plain(now))  # fmt: skip
        self.stale_engine = False

    def _lay_out(self) -> None:
        moving = [body for body in self.bodies.values() if body.moves]
        if moving != self._moving:
            self._last.update({key: self._last_of(self.bodies[key]) for key in self._places})
            self._moving, self._places = moving, {}
            self._pipe.note("layout", world=self.number, bodies=[body.number for body in moving])

    def _last_of(self, body: Body) -> bytes:
        """Return the last state of a body that was sent, or b''."""
        place = self._places.get(body.id)
        if place is None:
            return self._last.get(body.id, b"")
        return bytes(self._buffer[place : place + body.size])

    def _send_if_set(self, body: Body) -> None:
        if body.soft:
            return
        values = bytearray(body.size)
        body.read_into(values, 0)
        if values == self._last_of(body):
            return
        place = self._places.get(body.id)
        if place is None:
            self._last[body.id] = bytes(values)
        else:
            self._buffer[place : place + body.size] = values
        self._pipe.send(protocol.SET, protocol.HEAD.pack(body.number, self.step) + values)

    # -- what steps change ------------------------------------------------------------------------

    def sample(self) -> None:
        """Send the current state and contacts: both or, after Ctrl-C, neither."""
        points = ()
        if self._sampled:  # contacts are of a step, and the first sample has none
            points = self._p.getContactPoints(physicsClientId=self.client) or ()
        states = sum([body.size for body in self._moving])
        most = 2 * FRAME_HEAD + states + len(points) * POINT.size
        if len(self._buffer) < most:
            self._buffer, self._places = bytearray(2 * most), {}
        buffer, at = self._buffer, FRAME_HEAD
        protocol.HEADER.pack_into(buffer, 0, protocol.SAMPLE, protocol.HEAD.size + states)
        protocol.HEAD.pack_into(buffer, protocol.HEADER.size, self.number, self.step)
        if not self._places:
            for body in self._moving:
                self._places[body.id] = at
                self._last.pop(body.id, None)
                at += body.size
            at = FRAME_HEAD
        for body in self._moving:
            body.read_into(buffer, at)
            at += body.size
        if points:
            length = protocol.HEAD.size + len(points) * POINT.size
            protocol.HEADER.pack_into(buffer, at, protocol.CONTACTS, length)
            protocol.HEAD.pack_into(buffer, at + protocol.HEADER.size, self.number, self.step)
            at += FRAME_HEAD
            for (
                _, body_a, body_b, link_a, link_b, on_a, on_b, normal, distance,
                force, friction_1, direction_1, friction_2, direction_2,
            ) in points:  # fmt: skip
                # PyBullet lists both bodies, then both links.
                POINT.pack_into(
                    buffer, at, body_a, link_a, body_b, link_b, *on_a, *on_b, *normal, distance,
                    force, friction_1, *direction_1, friction_2, *direction_2,
                )  # fmt: skip
                at += POINT.size
        self._pipe.write(memoryview(buffer)[:at])
        self._sampled = True

    def before_step(self) -> None:
        """Send what calls have changed, and before the first step the first sample."""
        if (
            self.stale_engine or self.stale_bodies or self.fresh or self.changed or self.moved
            or self.recoloured or self._later
        ):  # fmt: skip
            self.sync(sample_follows=not self._sampled)
        if not self._sampled:
            self.sample()

    def asks_solver(self) -> bool:
        """Have the next step return what the solver did, if it is due; return whether it will.

        Only every few steps, since it takes two calls. It changes nothing else, but the engine has
        room for a limited number of islands of bodies, and reads beyond it.
        """
        if (
            self._has_analytics and self.returns_analytics is False and self.step % ASKED_EVERY == 0
            and len(self._moving) <= MOST_ISLANDS
        ):  # fmt: skip
            return self.report_solver(on=True)
        return False

    def report_solver(self, *, on: bool) -> bool:
        """Have steps return what the solver did, or not; return whether this PyBullet can."""
        try:
            self._p.setPhysicsEngineParameter(
                reportSolverAnalytics=int(on), physicsClientId=self.client
            )
        except TypeError:
            self._has_analytics = False
        return self._has_analytics

    def after_step(self, islands: Any) -> None:
        """Send the sample after a step, and note its solver's residual."""
        if islands and self._engine is not None:
            self._note_solver(islands[:MOST_ISLANDS], int(self._engine["numSolverIterations"]))
        self.step += 1
        self._steps_since += 1
        self.time_s = self._since + self._steps_since * self.timestep_s
        self.sample()

    def _note_solver(self, islands: Any, most: int) -> None:
        """Note whether the solver reached its limit, and by how much the last iteration acted.

        That is a change of velocity, non-finite for an island whose body the engine has lost.
        """
        early = self._early.setdefault(most, {"iterations": most, "looked": 0, "steps": 0,
            "first_step": 0, "last_change": 0.0, "worst_step": 0})  # fmt: skip
        early["looked"] += 1
        acted = [
            island["remainingResidual"] for island in islands if island["numIterationsUsed"] >= most
        ]
        last = max((change for change in acted if math.isfinite(change)), default=0.0) ** 0.5
        if last <= LEAST_CHANGE:
            return
        step = self.step + 1
        early["first_step"] = early["first_step"] or step
        early["steps"] += 1
        if last > early["last_change"]:
            early.update(last_change=last, worst_step=step)

    def end(self) -> None:
        """Send what is left of a simulation that is over."""
        self.sync(sample_follows=not self._sampled)
        for early in self._early.values():
            if early["steps"]:
                self._pipe.note("solver", world=self.number, **early)
        if not self._sampled and self.bodies:
            self.sample()
        self._pipe.note("over", world=self.number, step=self.step)


def _plain(value: Any) -> Any:
    """Return something that PyBullet returned as what JSON can hold."""
    if isinstance(value, bytes):
        return value.decode(errors="replace")
    if isinstance(value, dict):
        return {name: _plain(item) for name, item in value.items()}
    if isinstance(value, Iterable) and not isinstance(value, str):
        return [_plain(item) for item in value]
    return value if isinstance(value, (int, float, str, type(None))) else float(value)
