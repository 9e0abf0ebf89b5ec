"""Reads one simulation of a watched script: its bodies, states and contacts.

Everything is read with PyBullet's own functions, and nothing here changes a number in it:
`tests/test_watching.py` checks that over many scripts.
"""

from __future__ import annotations

import base64
import os
import struct
from collections.abc import Mapping
from types import MappingProxyType, SimpleNamespace
from typing import Any

from ...watching import pipe as protocol
from ...watching.pipe import BLOCK, BLOCK_BYTES, Pipe
from .bodies import BASE, RIGID, Loaded, WatchedBody, plain
from .capsules import lay
from .solver import Solver

MOST_KEPT = 1 << 22
"""Largest size of a file whose content is sent [bytes]."""
GEAR = 6
"""Constraint type, as in `getConstraintInfo`."""
ALL = None
"""Key that stands for all bodies, for calls that may have moved any body."""
SAMPLE_HEAD = SET_HEAD = struct.Struct("<cIqq")
"""Frame header and sample header, for samples and for states set by calls."""
SET_BASE = struct.Struct(SET_HEAD.format + "13d")
POSE, POINT = struct.Struct("<13d"), struct.Struct("<23d")
"""Formats of the numbers of a base, and of a contact point."""


class WatchedWorld:
    """The simulation of one physics client, read after each step.

    Parameters
    ----------
    number
        The number of the simulation in the stream; unlike the engine's client ids, it is never
        reused.
    first_step, first_time_s
        Step number and time [s] at which the simulation begins.
    """

    bodies_made = 0
    """Number of bodies in all simulations of this process."""
    search_path = ""
    """Additional folder in which PyBullet looks for files, for all simulations of this process."""
    keeps_files = False
    """Whether the contents of loaded files are sent."""
    varied: Mapping[str, Any] = MappingProxyType({})
    """Engine settings of the run's variation, which the engine does not report and which override
    the script's."""

    def __init__(
        self,
        pipe: Pipe,
        p: SimpleNamespace,
        *,
        client: int,
        number: int,
        method: str,
        first_step: int,
        first_time_s: float,
    ) -> None:
        self._pipe, self._p = pipe, p
        self.client, self.number = client, number
        self.step, self.time_s = first_step, first_time_s
        self.touched = True
        """Whether changes must be sent before the next step."""
        self.given: dict[str, Any] = {}
        """Engine settings made by calls that the engine does not report."""
        self.fresh: set[int] = set()
        """Bodies that calls have created, whose ids may have belonged to others before."""
        self.loaded: dict[int, Loaded] = {}
        """Properties of bodies that are known only from the calls that created them."""
        self.hulls: dict[int, tuple[str, list[float]]] = {}
        """Mesh shapes that calls created as convex hulls, by id, with file and scale of the mesh.
        """
        self.fields: set[int] = set()
        """Bodies that are height fields, for which PyBullet lists no shapes and prints a message
        instead."""
        self.added: dict[int, list[Any]] = {}
        """Dynamics info of bodies whose mass a call changed before they were first listed."""
        self.moved: dict[int | None, set[Any]] = {}
        """Bodies that calls may have moved since they were last read, with the names of the calls.
        """
        self.changed: set[int | None] = set()
        """Bodies whose dynamics properties calls may have changed."""
        self.recoloured: set[int] = set()
        self.stale_bodies = self.stale_engine = self.stale_constraints = True
        self.may_sleep = False
        self.held: set[int] = set()
        """Constraints that calls have created."""
        self.solver = Solver(p, client, returns=None if method == "before" else False)
        self.bodies: dict[int, WatchedBody] = {}
        self.timestep_s = 0.0
        self.sampled = False
        """Whether a sample has been sent."""
        self._since, self._steps_since = first_time_s, 0
        self._engine: dict[str, Any] | None = None
        self._moving: list[WatchedBody] = []
        self._bases: list[tuple[int, int]] = []
        self._jointed: list[WatchedBody] = []
        self._constraints: list[tuple[int, int]] = []
        """Ids of constraints, and the number of each one's forces."""
        self._buffer = bytearray(SAMPLE_HEAD.size)
        """The last sample, as sent; without contact points."""
        self._before: set[int] = set()
        if method == "before":
            bodies, constraints = p.getNumBodies(client), p.getNumConstraints(client)
            self._before = {p.getBodyUniqueId(index, client) for index in range(bodies)}
            self.held = {p.getConstraintUniqueId(index, client) for index in range(constraints)}
        pipe.note(
            "world",
            world=number,
            client=client,
            method=method,
            first_step=first_step,
            first_time_s=first_time_s,
        )

    # -- what calls have changed ------------------------------------------------------------------

    def sync(self, *, sample_follows: bool = False) -> None:
        """Send the properties and states that calls have changed since the last message.

        With `sample_follows`, states that the next sample will contain are not sent.
        """
        if self.stale_engine:
            self.sync_engine()
        if self.stale_bodies or self.fresh:
            self._list_bodies()
        if self.changed:
            self._read_dynamics()
        if self.recoloured:
            for body in [self.bodies[key] for key in self.recoloured if key in self.bodies]:
                self._pipe.note("look", body=body.number, visual=self._looks(body))
            self.recoloured = set()
        if self.moved:
            moved, self.moved = self.moved, {}
            for key in self.bodies if ALL in moved else moved:
                if key in self.bodies:
                    self._sync_state(self.bodies[key], sample_follows=sample_follows)
        self.touched = not self.sampled

    def forget(self) -> None:
        """Note a reset, which has removed all bodies."""
        for body in self.bodies.values():
            self._pipe.note("gone", body=body.number)
        self._pipe.note("reset", world=self.number)
        self.bodies, self.loaded, self.hulls, self._before = {}, {}, {}, set()
        self.fields = set()
        self.fresh, self.moved, self.changed, self.recoloured = set(), {}, set(), set()
        self.stale_bodies = self.stale_engine = self.stale_constraints = self.touched = True
        self.given, self.added, self._constraints, self.held = {}, {}, [], set()
        self.solver.returns = self.may_sleep = False
        self._lay_out()

    def before_mass(self, engine_id: int) -> None:
        """Save a new body's dynamics info before a call changes its mass."""
        if engine_id in self.fresh and engine_id not in self.added:
            try:
                links = range(-1, self._p.getNumJoints(engine_id, self.client))
                self.added[engine_id] = [
                    self._p.getDynamicsInfo(engine_id, link, self.client) for link in links
                ]
            except self._p.error:  # it is gone: the call itself will say so
                return

    def inertial_of(
        self, engine_id: int, position: list[float] | None, orientation: list[float] | None
    ) -> Any:
        """Return the centre of mass of a new rigid body, in the frame that placed it.

        For a btRigidBody, `getDynamicsInfo` returns uninitialised numbers as its centre of mass.
        """
        position = position if position and len(position) == 3 else [0, 0, 0]
        orientation = orientation if orientation and len(orientation) == 4 else [0, 0, 0, 1]
        pose = self._p.getBasePositionAndOrientation(engine_id, self.client)
        inverse = self._p.invertTransform(position, orientation)
        return self._p.multiplyTransforms(*inverse, *pose)

    def _list_bodies(self) -> None:
        p, client = self._p, self.client
        ids = [p.getBodyUniqueId(index, client) for index in range(p.getNumBodies(client))]
        present = set(ids)
        for key in [key for key in self.bodies if key not in present or key in self.fresh]:
            self._pipe.note("gone", body=self.bodies.pop(key).number)
            self._before.discard(key)
        for key in ids:
            if key not in self.bodies:
                self.bodies[key] = self._describe(key)
                if not self.bodies[key].soft:
                    self.moved.setdefault(key, set())
        self.fresh, self.stale_bodies = set(), False
        self._lay_out()

    def _describe(self, engine_id: int) -> WatchedBody:
        loaded = self.loaded.get(engine_id) or Loaded()
        body = WatchedBody(WatchedWorld.bodies_made, engine_id, self.client, self._p, loaded)
        WatchedWorld.bodies_made += 1
        added, now = self.added.pop(engine_id, body.dynamics), body.dynamics
        # A body keeps moving without the mass that it had, and a btRigidBody that had none stands.
        stays = bool(added[0][0]) == bool(now[0][0]) or (not added[0][0] and now[0][10] != RIGID)
        added = now if stays else added
        body.base_moves |= added[0][0] != 0
        described = body.described(self.search_path)
        self._lay(body, described["visual"])
        self._pipe.note(
            "body",
            world=self.number,
            body=body.number,
            dynamics=plain(added),
            **described,
            before=engine_id in self._before and engine_id not in self.fresh,
        )
        if added is not body.dynamics:
            self._pipe.note("dynamics", body=body.number, dynamics=plain(body.dynamics))
        return body

    def _looks(self, body: WatchedBody) -> list[Any]:
        shapes = body.looks(self.search_path)
        self._lay(body, shapes)
        return shapes

    def _lay(self, body: WatchedBody, shapes: list[Any]) -> None:
        if body.loaded.mjcf is not None:
            base = self._p.getBodyInfo(body.id, self.client)[0]
            names = plain([base, *(info[12] for info in body.joint_infos)])
            lay(shapes, names, body.loaded.mjcf or None)

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
                self._pipe.note("dynamics", body=body.number, dynamics=plain(dynamics))
        self.changed = set()
        self._lay_out()

    def sync_engine(self) -> None:
        """Send the engine's settings if they have changed."""
        reported = self._p.getPhysicsEngineParameters(self.client)
        if reported["fixedTimeStep"] != self.timestep_s:
            self._since, self._steps_since = self.time_s, 0
            self.timestep_s = reported["fixedTimeStep"]
        now = {
            **reported,
            **{f"set_{name}": value for name, value in {**self.given, **self.varied}.items()},
        }
        if now != self._engine:
            self._engine = now
            self._pipe.note(
                "engine", world=self.number, step=self.step, time_s=self.time_s, settings=plain(now)
            )
        self.stale_engine = False

    def _read_constraints(self) -> None:
        """List the constraints, after a step: before one, PyBullet crashes on a gear's state."""
        p, client = self._p, self.client
        count, found = p.getNumConstraints(client), []
        self.held &= {p.getConstraintUniqueId(index, client) for index in range(count)}
        for constraint in sorted(self.held):
            # Nor has a gear that sleeps been through a step.
            is_gear = p.getConstraintInfo(constraint, client)[4] == GEAR
            if not (is_gear and self.may_sleep):
                found.append((constraint, len(p.getConstraintState(constraint, client))))
        self.stale_constraints = False
        if found != self._constraints:
            self._constraints = found
            self._lay_out(always=True)

    # -- where in a sample everything is ----------------------------------------------------------

    def _lay_out(self, *, always: bool = False) -> None:
        moving = [body for body in self.bodies.values() if body.moves]
        laid = [(body.number, body.base_moves) for body in moving]
        if not always and laid == [(body.number, body.base_at >= 0) for body in self._moving]:
            return
        for body in self._moving:
            body.last = self._last_of(body)
            body.base_at = body.joints_at = -1
        self._moving, at = moving, SAMPLE_HEAD.size
        for body in moving:
            if body.base_moves:
                body.base_at, at = at, at + POSE.size
            if body.joints:
                body.joints_at, at = at, at + 8 * body.jointed
        self._bases = [(body.id, body.base_at) for body in moving if body.base_moves]
        self._jointed = [body for body in moving if body.joints]
        self._buffer = bytearray(at + 8 * sum(width for _, width in self._constraints))
        for body in moving:
            self._keep(body, body.last or bytes(8 * (BASE + body.jointed)))
        self._pipe.note(
            "layout",
            world=self.number,
            constraints=self._constraints,
            bodies=[[body.number, body.base_moves] for body in moving],
        )

    def _last_of(self, body: WatchedBody) -> bytes:
        """Return a body's state as last sent, or b'' if no state was sent."""
        base, joints = body.last[: POSE.size], body.last[POSE.size :]
        if body.base_at >= 0:
            base = bytes(self._buffer[body.base_at : body.base_at + POSE.size])
        if body.joints_at >= 0:
            joints = bytes(self._buffer[body.joints_at : body.joints_at + 8 * body.jointed])
        return base + joints if base else b""

    def _keep(self, body: WatchedBody, state: bytes) -> None:
        """Remember a body's state as last sent."""
        body.last = state
        if body.base_at >= 0:
            self._buffer[body.base_at : body.base_at + POSE.size] = state[: POSE.size]
        if body.joints_at >= 0:
            its = slice(body.joints_at, body.joints_at + 8 * body.jointed)
            self._buffer[its] = state[POSE.size :]

    def _sync_state(self, body: WatchedBody, *, sample_follows: bool) -> None:
        """Send the state of a body if calls have moved it."""
        at = body.base_at
        if at >= 0 and not body.jointed:  # all of its state is in one place
            if not sample_follows:
                self._sync_base(body.id, body.number, at)
            return
        if body.soft:
            return
        if not body.base_moves and body.is_carried():
            body.base_moves = True
            self._pipe.note("carried", body=body.number)
            self._lay_out()
        if sample_follows and body.base_moves:
            return
        state = body.read()
        if state != self._last_of(body):
            self._keep(body, state)
            size = protocol.HEAD.size + len(state)
            self._pipe.write(SET_HEAD.pack(protocol.SET, size, body.number, self.step) + state)

    def _sync_base(self, body: int, number: int, at: int) -> None:
        """Send the state of a jointless body if it differs from the one last sent."""
        (x, y, z), (a, b, c, d) = self._p.getBasePositionAndOrientation(body, self.client)
        (vx, vy, vz), (wx, wy, wz) = self._p.getBaseVelocity(body, self.client)
        sent = SET_BASE.pack(
            protocol.SET,
            SET_BASE.size - protocol.HEADER.size,
            number,
            self.step,
            x,
            y,
            z,
            a,
            b,
            c,
            d,
            vx,
            vy,
            vz,
            wx,
            wy,
            wz,
        )
        buffer, state = self._buffer, sent[SET_HEAD.size :]
        if buffer[at : at + POSE.size] != state:
            buffer[at : at + POSE.size] = state
            self._pipe.write(sent)

    # -- what steps change ------------------------------------------------------------------------

    def sample(self) -> None:
        """Send the current state and contacts as one message, even if Ctrl-C interrupts."""
        p, client, buffer, pipe = self._p, self.client, self._buffer, self._pipe
        if pipe.muted:
            self.sampled = True
            return
        points = ()
        if self.sampled:  # contacts are of a step, and the first sample has none
            points = p.getContactPoints(-1, -1, -2, -2, client) or ()  # between any links
        pose_of, velocity_of, pack = (
            p.getBasePositionAndOrientation,
            p.getBaseVelocity,
            POSE.pack_into,
        )
        for body, place in self._bases:
            (x, y, z), (a, b, c, d) = pose_of(body, client)
            (vx, vy, vz), (wx, wy, wz) = velocity_of(body, client)
            pack(buffer, place, x, y, z, a, b, c, d, vx, vy, vz, wx, wy, wz)
        for jointed in self._jointed:
            if jointed.spherical:
                numbers = jointed.read_joints()
                struct.pack_into(f"<{jointed.jointed}d", buffer, jointed.joints_at, *numbers)
            else:
                states = p.getJointStates(jointed.id, jointed.joints, client)
                jointed.pack_joints(buffer, jointed.joints_at, states)
        if self._constraints:
            forces: list[float] = []
            for constraint, _ in self._constraints:
                forces += p.getConstraintState(constraint, client)
            struct.pack_into(f"<{len(forces)}d", buffer, len(buffer) - 8 * len(forces), *forces)
        size = len(buffer) + len(points) * POINT.size
        head = protocol.SAMPLE, size - protocol.HEADER.size, self.number, self.step
        SAMPLE_HEAD.pack_into(buffer, 0, *head)
        at = pipe.end
        if at > pipe.limit or at + size > BLOCK_BYTES:
            at = pipe.make_room(size)
        if at + size > BLOCK_BYTES:
            apart = buffer + bytes(size - len(buffer))
            pack_points(points, apart, len(buffer))
            pipe.write(bytes(apart))
        else:
            memory, end = pipe.memory, at + size
            memory[at : at + len(buffer)] = buffer
            if points:
                pack_points(points, memory, at + len(buffer))
            pipe.end, pipe.counts[1] = end, end - BLOCK.size
        self.sampled = True

    def before_step(self) -> None:
        """Send changes made by calls and, before the first step, the initial state."""
        self.sync(sample_follows=not self.sampled)
        if not self.sampled:
            self.sample()
        self.touched = False

    def asks_solver(self) -> bool:
        """Request a solver report from the next step; return whether there will be one."""
        return self.solver.ask(len(self._moving))

    def after_step(self, islands: Any) -> None:
        """Send the state after a step, and note the solver's report."""
        if islands and self._engine is not None:
            most = int(self._engine["numSolverIterations"])
            self.solver.note(islands, most, self.step + 1)
        self.step += 1
        self._steps_since += 1
        self.time_s = self._since + self._steps_since * self.timestep_s
        if self.stale_constraints:
            self._read_constraints()
        self.sample()

    def tell_file(self, name: str, path: str) -> None:
        """Send the content of a file that a call names, since the script may delete it."""
        try:
            if os.path.getsize(path) > MOST_KEPT:
                return
            with open(path, "rb") as file:
                content = base64.b64encode(file.read()).decode()
        except OSError:
            return
        self._pipe.note("file", name=name, path=os.path.abspath(path), content=content)

    def end(self) -> None:
        """Send the remaining data of a simulation that has ended."""
        self.sync(sample_follows=not self.sampled)
        for early in self.solver.noted():
            self._pipe.note("solver", world=self.number, **early)
        if not self.sampled and self.bodies:
            self.sample()
        self._pipe.note("over", world=self.number, step=self.step)


def pack_points(points: Any, memory: Any, at: int) -> None:
    """Write contact points into a buffer.

    PyBullet lists both bodies, then both links. The code names each number, since concatenating
    tuples takes twice as long.
    """
    pack, size = POINT.pack_into, POINT.size
    for (
        _,
        body_a,
        body_b,
        link_a,
        link_b,
        (ax, ay, az),
        (bx, by, bz),
        (nx, ny, nz),
        distance,
        force,
        friction_1,
        (fx, fy, fz),
        friction_2,
        (gx, gy, gz),
    ) in points:
        pack(
            memory,
            at,
            body_a,
            link_a,
            body_b,
            link_b,
            ax,
            ay,
            az,
            bx,
            by,
            bz,
            nx,
            ny,
            nz,
            distance,
            force,
            friction_1,
            fx,
            fy,
            fz,
            friction_2,
            gx,
            gy,
            gz,
        )
        at += size
