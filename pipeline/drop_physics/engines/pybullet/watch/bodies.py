"""Reads one body of a simulation: its constant properties, and its current state."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import cache
from itertools import chain
from operator import sub
from struct import Struct
from types import SimpleNamespace
from typing import Any

from .links import path_of

FIXED, SPHERICAL = 4, 2
"""Joint types, as in `getJointInfo`."""
RIGID, SOFT = 1, 3
"""Body types, as in `getDynamicsInfo`."""
MESH = 5
"""Shape type, as in `getCollisionShapeData`."""
EMPTY_M = 0.0021
"""Upper bound [m] for the edges of the bounding box that PyBullet reports for a link without
collision shapes: they are 2 mm long."""
FILE = 4
"""Index of a shape's file name in `getVisualShapeData`."""
MOST_CORNERS = 1000
"""Largest number of vertices of a hull that is sent; a larger hull is omitted."""
BASE = 13
"""Format of a base's numbers: position, orientation, linear and angular velocity."""


class Loaded:
    """Properties of a body known only from the call that loaded it, such as flags."""

    def __init__(self) -> None:
        self.file = ""
        """Name of the file from which the body was loaded, without its folder."""
        self.mjcf: str | None = None
        """Path of the body's MJCF file; empty if unknown, None for other bodies."""
        self.flags = 0
        """Load flags of the body, from which alone follows whether it may sleep."""
        self.scale = 1.0
        self.asked: dict[str, Any] | None = None
        """Properties stated in the body's file (see `asked`)."""
        self.lists_shapes = False
        """Whether `getCollisionShapeData` can be called: it crashes for a capsule of an MJCF file
        that is defined by its ends (`fromto`)."""
        self.hulls = False
        """Whether all meshes of the body are convex hulls; otherwise, PyBullet prints a message
        when their vertices are read."""
        self.meshes: dict[int, tuple[str, list[float]]] = {}
        """File and scale of each link's mesh that was created by a call, which
        `getCollisionShapeData` does not report."""
        self.hides_links = False
        """Whether the body is a btRigidBody with several links, of which only the base is reported.
        """
        self.inertial: Any = None
        """The inertial frame of a btRigidBody, position and orientation."""


class WatchedBody:
    """A body of a script's simulation, whose state is read after each step.

    Parameters
    ----------
    number
        The number of the body in the stream; unlike the engine's id, it is never reused.
    """

    def __init__(
        self, number: int, engine_id: int, client: int, p: SimpleNamespace, loaded: Loaded
    ) -> None:
        self.number, self.id, self._client, self._p = number, engine_id, client, p
        self.loaded = loaded
        self.links = list(range(p.getNumJoints(engine_id, client)))
        self.joint_infos = [p.getJointInfo(engine_id, link, client) for link in self.links]
        self.joints = [info[0] for info in self.joint_infos if info[2] != FIXED]
        self.spherical = any(info[2] == SPHERICAL for info in self.joint_infos)
        self.dynamics = self.read_dynamics()
        self.soft = self.dynamics[0][10] == SOFT
        self.base_moves = self.dynamics[0][0] != 0
        """Whether steps may move the base: it has mass, had mass, or was given a velocity."""
        self.widths = self._joint_widths()
        """Numbers of positions, velocities and efforts of each joint that moves."""
        self.jointed = sum(map(sum, self.widths))
        """Number of values of all joints."""
        self.pack_joints = packing(len(self.joints))
        """Function that packs the states of joints that are not spherical."""
        self._pack = Struct(f"<{BASE + self.jointed}d").pack
        self.last = b""
        """The last state that was sent outside a sample; empty if there was none."""
        self.base_at = self.joints_at = -1
        """Offsets of the base and the joints in the last sample; below 0 if the sample lacks them.
        """

    @property
    def moves(self) -> bool:
        """True if steps can move the body; False if only calls can."""
        return not self.soft and (self.base_moves or bool(self.joints))

    def is_carried(self) -> bool:
        """Return whether the base is massless and moves at a velocity set by a call.

        A massless btMultiBody keeps that velocity; a massless btRigidBody does not move at all.
        """
        if self.soft or self.base_moves or self.dynamics[0][10] == RIGID:
            return False
        return any(map(any, self._p.getBaseVelocity(self.id, self._client)))

    def read_dynamics(self) -> list[Any]:
        """Return the engine's dynamics info for base and links, in this order."""
        return [self._p.getDynamicsInfo(self.id, link, self._client) for link in (-1, *self.links)]

    def read(self) -> bytes:
        """Return the state: 13 numbers of the base, then those of the movable joints."""
        p, client = self._p, self._client
        (x, y, z), (a, b, c, d) = p.getBasePositionAndOrientation(self.id, client)
        (vx, vy, vz), (wx, wy, wz) = p.getBaseVelocity(self.id, client)
        if not self.joints:
            return self._pack(x, y, z, a, b, c, d, vx, vy, vz, wx, wy, wz)
        return self._pack(x, y, z, a, b, c, d, vx, vy, vz, wx, wy, wz, *self.read_joints())

    def read_joints(self) -> Iterable[float]:
        """Return the positions, velocities and efforts of all movable joints."""
        p, client = self._p, self._client
        if not self.spherical:
            states = p.getJointStates(self.id, self.joints, client)
            positions, velocities, _, efforts = zip(*states)
            return (*positions, *velocities, *efforts)
        of_each = zip(*p.getJointStatesMultiDof(self.id, self.joints, client))
        return chain.from_iterable(
            value for which, values in enumerate(of_each) if which != 2 for value in values
        )  # without the reaction forces

    def _joint_widths(self) -> list[tuple[int, int, int]]:
        if not self.spherical:
            return [(1, 1, 1)] * len(self.joints)
        states = self._p.getJointStatesMultiDof(self.id, self.joints, self._client)
        return [(len(joint[0]), len(joint[1]), len(joint[3])) for joint in states]

    def described(self, search_path: str) -> dict[str, Any]:
        """Return the constant properties that the recording needs."""
        base, name = self._p.getBodyInfo(self.id, self._client)
        loaded, asked = self.loaded, self.loaded.asked or {}
        return {
            "id": self.id,
            "name": plain(name),
            "base": plain(base),
            "soft": self.soft,
            "file": loaded.file,
            "flags": loaded.flags,
            "hides_links": loaded.hides_links,
            "inertial": plain(loaded.inertial),
            "scale": loaded.scale,
            "file_links": asked.get("links", []),
            "mimics": asked.get("mimics", []),
            "dampings": asked.get("dampings", []),
            "bounds": self.bounds(),
            "joints": plain(self.joint_infos),
            "joint_widths": self.widths,
            "visual": self.looks(search_path),
            "collisions": self.collisions(search_path),
        }

    def bounds(self) -> list[float]:
        """Return the corners of the axis-aligned bounding boxes of base and links.

        For a URDF's link without collision shapes PyBullet reports a box that only consists of
        margins, and that nothing touches: both corners are then returned as its centre.
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
        """Return whether a link has no collision shapes, judging by its bounding box.

        PyBullet does not list the collision shapes of a btRigidBody: a link with so small a box
        counts as empty.
        """
        if max(edges_m) >= EMPTY_M:
            return False
        if self.dynamics[0][10] == RIGID:
            return max(abs(edge_m - 0.002) for edge_m in edges_m) < 1e-9
        if not self.loaded.lists_shapes:
            return False
        return not self._p.getCollisionShapeData(self.id, link, self._client)

    def looks(self, search_path: str) -> list[Any]:
        """Return the visual shapes, with the full paths of their mesh files.

        `getVisualShapeData` returns a file's name as given in the call, not the path that PyBullet
        found.
        """
        if self.soft:
            return []
        shapes: list[Any] = plain(self._p.getVisualShapeData(self.id, 0, self._client))
        for shape in shapes:
            shape[FILE] = path_of(shape[FILE], search_path) or shape[FILE]
        return shapes

    def collisions(self, search_path: str) -> list[Any]:
        """Return the collision shapes of all links, with the vertices of convex hulls."""
        if self.soft or self.dynamics[0][10] == RIGID:  # PyBullet prints that it has none
            return []
        if not self.loaded.lists_shapes:
            return []
        found = []
        for link in (-1, *self.links):
            shapes = self._p.getCollisionShapeData(self.id, link, self._client) or ()
            for at, (_, _, kind, size, file, position, orientation) in enumerate(shapes):
                hull: list[float] = []
                if kind == MESH and self.loaded.hulls:
                    hull = self._hull(link, at if len(shapes) > 1 else -1)
                    file, size = self.loaded.meshes.get(link, (plain(file), size))
                file = path_of(plain(file), search_path) or plain(file)
                found.append([link, kind, plain(size), file, position, orientation, hull])
        return found

    def _hull(self, link: int, shape: int) -> list[float]:
        """Return the vertices of the convex hull that PyBullet uses instead of a mesh."""
        try:
            count, corners = self._p.getMeshData(self.id, link, shape, physicsClientId=self._client)
        except (self._p.error, TypeError):  # TypeError: of an earlier PyBullet
            return []
        return [*chain.from_iterable(corners)] if count <= MOST_CORNERS else []


@cache
def packing(joints: int) -> Callable[[Any, int, Any], None]:
    """Return a function that packs results of `getJointStates` into a buffer quickly.

    The buffer gets all positions, then all velocities, then all efforts. The function's source text
    names each number, since transposing the rows in Python takes three times as long.
    """
    rows = ", ".join(f"(p{joint}, v{joint}, _, e{joint})" for joint in range(joints))
    columns = ", ".join(f"{what}{joint}" for what in "pve" for joint in range(joints))
    names: dict[str, Any] = {"pack": Struct(f"<{3 * joints}d").pack_into}
    exec(f"def of(buffer, at, states):\n [{rows}] = states\n pack(buffer, at, {columns})", names)
    made: Callable[[Any, int, Any], None] = names["of"]
    return made


def plain(value: Any) -> Any:
    """Convert a return value of PyBullet to a JSON value."""
    if isinstance(value, bytes):
        return value.decode(errors="replace")
    if isinstance(value, dict):
        return {name: plain(item) for name, item in value.items()}
    if isinstance(value, Iterable) and not isinstance(value, str):
        return [plain(item) for item in value]
    return value if isinstance(value, (int, float, str, type(None))) else float(value)
