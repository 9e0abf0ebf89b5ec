"""Reads numbers from a running PyBullet simulation, to check an expectation."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from ...watching.observed import NUMBERS, Observed, UnknownNameError, found
from .arguments import number, vector
from .bodies import RIGID, SOFT
from .naming import KINDS, name_of

AXES = "xyz"
NORMAL_N, ALONG_N, ACROSS_N = 9, 10, 12
"""Indices in a contact point of `getContactPoints` of the normal force and of both friction forces;
each friction force is followed by its direction."""
NORMAL = 7
"""Index in a contact point of the contact normal, which points towards the first body."""


class ObservedWorld(Observed):
    """A running simulation, from which expectations read times, positions and forces.

    Parameters
    ----------
    p
        PyBullet's own functions.
    client
        The id of the physics client.
    time
        A function that returns the simulated time [s].
    """

    def __init__(self, p: Any, client: int, time: Callable[[], float]) -> None:
        self._p, self._client, self._time = p, client, time
        self._places: dict[tuple[int, int], tuple[int, float]] = {}
        """Index of each body and link in the list of positions, and its radius of gyration [m]."""
        self._named: list[str] = []
        self._files: dict[int, str] = {}
        """The files from which bodies were loaded, by body id."""
        self._shorts: dict[int, str] = {}
        """The names of bodies in reports, without their ids, by body id."""
        self._targets: dict[tuple[int, int], tuple[int, float]] = {}
        """Commands to joints: whether of a velocity, and the target value."""

    @property
    def simulation(self) -> object:
        """The id of the physics client."""
        return self._client

    @property
    def time_s(self) -> float:
        """The simulated time [s]."""
        return self._time()

    def reader(self, kind: str, *names: Any) -> Callable[[], Any]:
        """Return a function that reads a quantity's current value, a number or a vector."""
        if kind in AXES or kind == "up":
            pose = self._pose(*self._link(*names))
            if kind == "up":
                return lambda: self._upward(pose()[1])
            axis = AXES.index(kind)
            return lambda: float(pose()[0][axis])
        if kind in ("joint", "rate"):
            body, joint = self._joint(*names)
            at, state, client = int(kind == "rate"), self._p.getJointState, self._client
            return lambda: float(state(body, joint, client)[at])
        if kind == "force":
            return self._force([self._link(name) for name in names])
        raise UnknownNameError(str(names[0]), ())

    def positions(self) -> list[float]:
        """Return positions of three points on each link, which also show its rotation [m]."""
        p, client = self._p, self._client
        found = [math.nan] * (NUMBERS * len(self._places))
        for body in self._bodies():
            try:
                poses = [p.getBasePositionAndOrientation(body, client)]
                joints = p.getNumJoints(body, client)
                if joints:
                    states = p.getLinkStates(body, range(joints), physicsClientId=client)
                    poses += [state[:2] for state in states]
            except p.error:  # a soft body
                continue
            for link, (centre, turned) in enumerate(poses, -1):
                known = self._places.get((body, link))
                if known is None:
                    known = self._places[body, link] = len(self._places), self._radius(body, link)
                    self._named.append(self._name(body, link))
                    found += [math.nan] * NUMBERS
                place, radius = known
                found[NUMBERS * place : NUMBERS * (place + 1)] = _points(centre, turned, radius)
        return found

    def _radius(self, body: int, link: int) -> float:
        """Return a link's largest radius of gyration, as its size [m]."""
        mass, _, inertia = self._p.getDynamicsInfo(body, link, self._client)[:3]
        return math.sqrt(max(*inertia, 0.0) / mass) if mass > 0 else 0.0

    def bodies(self) -> list[str]:
        """Return the names of bodies and links, in the order of `positions`."""
        return self._named

    def astray(self) -> dict[str, float]:
        """Return how far joints are from their motors' targets."""
        p, client, found = self._p, self._client, {}
        for (body, joint), (at, target) in self._targets.items():
            try:
                is_at = p.getJointState(body, joint, client)[at]
                name = p.getJointInfo(body, joint, client)[1].decode(errors="replace")
            except p.error:  # its body is gone
                continue
            alone = name not in found
            found[name if alone else f"{name} of {self._name(body, -1)}"] = target - is_at
        return found

    def made(self, result: Any, file: str) -> None:
        """Note the bodies that a call has made, and the file that it loads; empty if none."""
        for body in result if isinstance(result, tuple) else (result,):
            if type(body) is int:
                self._files[body] = file
                self._shorts.pop(body, None)

    def command(self, arguments: Mapping[str, Any]) -> None:
        """Note the target of a motor command, given its arguments by name."""
        body, mode = number(arguments.get("bodyUniqueId")), arguments.get("controlMode")
        names = {
            self._p.POSITION_CONTROL: ("targetPosition", 0),
            self._p.VELOCITY_CONTROL: ("targetVelocity", 1),
        }
        if body is None or mode not in names:
            return
        name, at = names[mode]
        joints, targets = [arguments.get("jointIndex")], [arguments.get(name)]
        if joints[0] is None:
            joints, targets = arguments.get("jointIndices", ()), arguments.get(f"{name}s", ())
            joints = [*joints]
        for joint, target in zip(joints, targets):
            which, to = number(joint), vector([target])
            if which is not None and to is not None:
                self._targets[body, which] = at, to[0]

    def is_finite(self) -> bool:
        """Return whether all positions are finite."""
        seen = self.positions()
        return not seen or any(map(math.isfinite, seen))

    # -- names ------------------------------------------------------------------------------------

    def _bodies(self) -> list[int]:
        p, client = self._p, self._client
        return [p.getBodyUniqueId(n, client) for n in range(p.getNumBodies(client))]

    def _name(self, body: int, link: int) -> str:
        if link < 0:  # bodies that the script makes have one name for all their bases
            name = self._p.getBodyInfo(body, self._client)[1].decode(errors="replace")
            return name or f"body{body}"
        return str(self._p.getJointInfo(body, link, self._client)[12].decode(errors="replace"))

    def _links(self) -> Iterator[tuple[str, tuple[int, int]]]:
        """Yield the names of bodies and links, with their ids."""
        p, client = self._p, self._client
        for body in self._bodies():
            root, *names = self._names(body)
            for each in (*names, root):
                if each:
                    yield each, (body, -1)
            for link in range(p.getNumJoints(body, client)):
                own = p.getJointInfo(body, link, client)[12].decode(errors="replace")
                yield own, (body, link)
                yield from ((f"{each}.{own}", (body, link)) for each in names if each)

    def _names(self, body: int) -> tuple[str, ...]:
        """Return the name of a body's root link, then the names of the body itself."""
        root, name = (
            each.decode(errors="replace") for each in self._p.getBodyInfo(body, self._client)
        )
        short = self._shorts.get(body) or self._short(body, name, root)
        self._shorts[body] = short
        return root, name, f"body{body}", short, f"{body}_{short}"

    def _short(self, body: int, name: str, root: str) -> str:
        """Return the name of a body in reports, without its id."""
        p, client, file, kinds = self._p, self._client, self._files.get(body, ""), list[str]()
        if not file and not name:
            if p.getDynamicsInfo(body, -1, client)[10] not in (RIGID, SOFT):
                for link in range(-1, p.getNumJoints(body, client)):
                    shapes = p.getCollisionShapeData(body, link, client) or ()
                    kinds += [KINDS.get(shape[2], str(shape[2])) for shape in shapes]
            visual = () if kinds else p.getVisualShapeData(body, 0, client) or ()
            kinds += [KINDS.get(shape[2], str(shape[2])) for shape in visual]
        return name_of(file, name, *kinds, root)

    def _link(self, name: Any, link: Any = None) -> tuple[int, int]:
        """Return body id and link index for a name, or for the engine's own ids."""
        if not isinstance(name, str):
            return int(name), -1 if link is None else int(link)
        known: dict[str, tuple[int, int]] = {}
        for each, what in self._links():
            known.setdefault(each, what)
        return found(name, known)

    def _joint(self, name: Any, joint: Any = None) -> tuple[int, int]:
        """Return body id and joint index for a name, or for the engine's own ids."""
        if joint is not None:
            return int(name), int(joint)
        p, client = self._p, self._client
        known: dict[str, tuple[int, int]] = {}
        for body in self._bodies():
            for which in range(p.getNumJoints(body, client)):
                own = p.getJointInfo(body, which, client)[1].decode(errors="replace")
                known.setdefault(own, (body, which))
                for each in self._names(body)[1:]:
                    known.setdefault(f"{each}.{own}", (body, which))
        return found(str(name), known)

    # -- readings ---------------------------------------------------------------------------------

    def _pose(self, body: int, link: int) -> Callable[[], Any]:
        """Return a function that reads the pose of a body's base, or of a link's frame."""
        p, client = self._p, self._client
        if link < 0:
            return lambda: p.getBasePositionAndOrientation(body, client)
        return lambda: p.getLinkState(body, link, 0, 1, client)[4:6]

    def _upward(self, orientation: Any) -> float:
        return float(self._p.getMatrixFromQuaternion(orientation)[8])

    def _force(self, sides: list[tuple[int, int]]) -> Callable[[], float]:
        """Return a function that reads the contact force between two bodies, or on one."""
        p, client = self._p, self._client
        (body, link), other = sides[0], dict(zip(("bodyB", "linkIndexB"), (*sides[1:], ())[0]))
        if other.get("linkIndexB") == -1:
            del other["linkIndexB"]
        one = {"bodyA": body, **({} if link < 0 else {"linkIndexA": link})}

        def force() -> float:
            total = [0.0] * 3
            for point in p.getContactPoints(**one, **other, physicsClientId=client) or ():
                for size, along in (
                    (point[NORMAL_N], point[NORMAL]),
                    *((point[at], point[at + 1]) for at in (ALONG_N, ACROSS_N)),
                ):
                    total = [held + size * each for held, each in zip(total, along)]
            return math.hypot(*total)

        return force


def _points(centre: Any, turned: Any, radius_m: float) -> list[float]:
    """Return a centre, and points at a radius from it along the rotated x and z axes."""
    x, y, z, w = turned
    along_x = 1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)
    along_z = 2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)
    arms = (at + radius_m * part for each in (along_x, along_z) for at, part in zip(centre, each))
    return [*centre, *arms]
