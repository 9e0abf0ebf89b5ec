"""The world the body falls in.

Build it, step it, read it. Every setting is made explicitly in a client of its own, so that no
earlier run in the process can reach this one.
"""

from __future__ import annotations

import functools
import hashlib
import math
import struct
from collections.abc import Iterator
from dataclasses import replace
from operator import itemgetter
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from pipeline.engines.bullet.c_output import c_output_moved_aside
from pipeline.engines.bullet.engine import data_folder, find_body, p
from pipeline.engines.bullet.touching import ROUNDING_M, touching_height
from pipeline.errors import DropError, ScenarioError
from pipeline.fields import Quaternion
from pipeline.report import LARGEST, EngineReport
from pipeline.scenario import Scenario

Float64 = NDArray[np.float64]

STATE_WIDTH = 16
"""Numbers in one row of state: position 3, orientation 4, velocities 3 + 3, contact 3."""
_CONTACT_POINTS = 13
"""The column with their number; behind it the distance, which is nan without one, and the force."""
LINK_WIDTH = 13
"""Numbers that a further link adds: position 3, orientation 4, velocities 3 + 3."""

FAR_M = 1e3
"""A height from which no body of ours reaches the floor."""

SHAPES = {2: "sphere", 3: "box", 4: "cylinder", 5: "mesh", 6: "plane", 7: "capsule"}
"""pybullet's GEOM_ constants."""


class World:
    """One body above one floor, in a PyBullet client of its own; use it in a `with` statement.

    Raises
    ------
    ScenarioError
        If the body cannot be found or loaded, or has no mass.
    """

    def __init__(self, scenario: Scenario) -> None:
        self.scenario = scenario
        self._urdf = find_body(scenario.body)
        self._own: tuple[float, tuple[float, ...]] | None = None  # mass, inertia: the URDF's
        self._client: int = p.connect(p.DIRECT)
        try:
            self._body = self._load_body()
            self._links = list(range(p.getNumJoints(self._body, physicsClientId=self._client)))
            self._body_sha256 = hashlib.sha256(self._urdf.read_bytes()).hexdigest()
            self.half_size_m, self.reach_m = self._size()
            self._floor = self._load("plane.urdf") if scenario.floor else None
            self._configure()
            self._release()
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Disconnect from the engine."""
        if p.isConnected(self._client):
            p.disconnect(self._client)

    # -- building ---------------------------------------------------------------------------------

    def _load(self, urdf: str | Path, **how: Any) -> int:  # noqa: ANN401
        with c_output_moved_aside():
            p.setAdditionalSearchPath(str(data_folder()), physicsClientId=self._client)
            return int(p.loadURDF(str(urdf), physicsClientId=self._client, **how))

    def _load_body(self) -> int:
        maximal = self.scenario.coordinates == "maximal"
        try:
            body = self._load(self._urdf, useMaximalCoordinates=maximal)
        except p.error as error:
            raise ScenarioError(
                f"--body must be a URDF that Bullet can load, got {self.scenario.body!r} "
                f"({error}); check it with another tool, or try cube_small.urdf"
            ) from None
        if maximal:
            self._refuse_joints()
        self._set_dynamics(body)
        if not p.getDynamicsInfo(body, -1, physicsClientId=self._client)[0] > 0:
            raise ScenarioError(
                f"--body must have a mass, got 0 kg in {self.scenario.body!r}: "
                "Bullet holds it still; try --mass 0.1"
            )
        return body

    def _refuse_joints(self) -> None:
        with self._twin() as twin:
            if twin._links:
                raise ScenarioError(
                    "--coordinates maximal takes a body without joints: PyBullet neither places "
                    f"nor reports the links of a btRigidBody, and {self.scenario.body!r} has "
                    f"{len(twin._links)}; use --coordinates reduced"
                )

    def _set_dynamics(self, body: int) -> None:
        how = {"bodyUniqueId": body, "linkIndex": -1, "physicsClientId": self._client}
        mass_kg = self.scenario.mass_kg
        if mass_kg is not None:
            # A mass alone would bring the inertia of the shape, whatever the URDF says.
            p.changeDynamics(mass=mass_kg, **self._inertia_of(mass_kg, body), **how)
        if self.scenario.linear_damping is not None:
            p.changeDynamics(linearDamping=self.scenario.linear_damping, **how)
        if self.scenario.angular_damping is not None:
            p.changeDynamics(angularDamping=self.scenario.angular_damping, **how)

    def _inertia_of(self, mass_kg: float, body: int) -> dict[str, tuple[float, ...]]:
        """Return the URDF's inertia, scaled as its mass is; nothing where it has no mass."""
        if self.scenario.coordinates == "maximal":  # which reports 1 / (1 / m), not always m
            with self._twin() as twin:
                return {"localInertiaDiagonal": twin._dynamics()[2]}
        if self._own is None:
            self._own = itemgetter(0, 2)(self._dynamics(body))
        own_kg, inertia_kg_m2 = self._own
        if own_kg == 0:
            return {}
        return {"localInertiaDiagonal": tuple(one * (mass_kg / own_kg) for one in inertia_kg_m2)}

    def _twin(self) -> World:
        """Return the same world in reduced coordinates, of which the engine reports more."""
        return World(replace(self.scenario, coordinates="reduced"))

    def _size(self) -> tuple[Float64, float]:
        """Return half the extent of the base along its own axes, and its farthest reach [m].

        Measured at the origin, where the bounding box is exact to the last bit.
        """
        self.place((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
        lowest, highest = self._box()
        return (highest - lowest) / 2, float(np.linalg.norm(np.maximum(-lowest, highest)))

    def _box(self) -> tuple[Float64, Float64]:
        lowest, highest = map(np.array, p.getAABB(self._body, -1, physicsClientId=self._client))
        return lowest, highest

    def _configure(self) -> None:
        scenario, client = self.scenario, self._client
        p.setTimeStep(scenario.timestep_s, physicsClientId=client)
        if scenario.gravity_set:
            p.setGravity(0.0, 0.0, scenario.gravity_m_s2, physicsClientId=client)
        settings = {
            "contactERP": scenario.contact_erp,
            "restitutionVelocityThreshold": scenario.restitution_threshold_m_s,
            "solverResidualThreshold": scenario.solver_residual,
            "numSolverIterations": scenario.solver_iterations,
        }
        chosen = {name: value for name, value in settings.items() if value is not None}
        p.setPhysicsEngineParameter(
            numSubSteps=scenario.substeps or 0, physicsClientId=client, **chosen
        )
        surface = {"restitution": scenario.restitution, "lateralFriction": scenario.friction}
        told = {name: value for name, value in surface.items() if value is not None}
        for body, links in ((self._body, self._links), (self._floor, [])):
            if body is not None and told:
                for link in (-1, *links):
                    p.changeDynamics(body, link, physicsClientId=client, **told)

    def _release(self) -> None:
        self.place((0.0, 0.0, self.scenario.height_m), self.scenario.orientation_xyzw)
        p.resetBaseVelocity(
            self._body,
            self.scenario.velocity_m_s,
            self.scenario.spin_rad_s,
            physicsClientId=self._client,
        )

    def place(self, position_m: Any, orientation: Any) -> None:  # noqa: ANN401
        """Put the body at a position [m], with an orientation as a quaternion x, y, z, w."""
        p.resetBasePositionAndOrientation(
            self._body, position_m, orientation, physicsClientId=self._client
        )

    # -- reading ----------------------------------------------------------------------------------

    def report(self) -> EngineReport:
        """Return what the engine says of itself and of both bodies, read back after set-up."""
        if self.scenario.coordinates == "reduced":
            return self._report(twin=self)
        # Much of a btRigidBody PyBullet does not report: ask the same URDF in reduced coordinates.
        with self._twin() as twin:
            return self._report(twin)

    def _report(self, twin: World) -> EngineReport:
        engine = p.getPhysicsEngineParameters(physicsClientId=self._client)
        body, floor = self._dynamics(), None if self._floor is None else self._dynamics(self._floor)
        base, links = twin._dynamics(), [twin._dynamics(twin._body, one) for one in twin._links]
        masses_kg = [link[0] for link in (base, *links)]
        shapes = [
            shape
            for link in (-1, *twin._links)
            for shape in p.getCollisionShapeData(twin._body, link, twin._client)
        ]
        single = shapes[0] if len(shapes) == 1 and shapes[0][1] == -1 else None
        return EngineReport(
            timestep_s=engine["fixedTimeStep"],
            substeps=engine["numSubSteps"],
            solver_iterations=engine["numSolverIterations"],
            gravity_m_s2=tuple(engine[f"gravityAcceleration{axis}"] for axis in "XYZ"),
            body_name=_name(twin._body, twin._client),
            body_sha256=self._body_sha256,
            body_type={1: "btRigidBody", 2: "btMultiBody"}.get(body[10], str(body[10])),
            joints=len(links),
            mass_kg=math.fsum(masses_kg),
            link_masses_kg=tuple(masses_kg),
            inertia_kg_m2=base[2],
            link_inertias_kg_m2=tuple(one for link in (base, *links) for one in link[2]),
            lateral_friction=body[1],
            rolling_friction=body[6],
            spinning_friction=body[7],
            restitution=base[5],
            collision_margin_m=body[11],
            shape=SHAPES.get(single[2], "unknown") if single else "compound" if shapes else "none",
            shape_dimensions_m=single[3] if single else (),
            shape_position_m=single and single[5],
            shape_orientation=single and single[6],
            reach_m=self.reach_m,
            rest_height_m=self.rest_height_m,
            floor_lateral_friction=floor and floor[1],
            floor_restitution=floor and floor[5],
            pybullet_api=p.getAPIVersion(),
        )

    def _dynamics(self, body: int | None = None, link: int = -1) -> Any:  # noqa: ANN401
        """Return what `getDynamicsInfo` says of a body, this world's own by default."""
        return p.getDynamicsInfo(
            self._body if body is None else body, link, physicsClientId=self._client
        )

    # -- touching ---------------------------------------------------------------------------------

    @property
    def rest_height_m(self) -> float | None:
        """Height of the centre at which the body, turned as released, touches the floor [m]."""
        body, sha256 = str(self._urdf), self._body_sha256
        return _rest_height(body, sha256, self.scenario.orientation_xyzw)

    def _touching_height(self) -> float | None:
        """Measure that height, in a world that nobody falls in."""
        turned = self.scenario.orientation_xyzw
        self.place((0.0, 0.0, 0.0), turned)
        by_box_m = -float(self._box()[0][2])
        size_m = 2 * float(np.linalg.norm(self.half_size_m))

        def apart(height_m: float) -> float | None:
            self.place((0.0, 0.0, height_m), turned)
            points = p.getClosestPoints(
                self._body, self._floor, FAR_M, physicsClientId=self._client
            )
            return min(map(_DISTANCE, points), default=None)

        def touching(height_m: float) -> float | None:
            # Far from the floor the engine forgets the contacts of the height before.
            for height in (FAR_M, height_m):
                self.place((0.0, 0.0, height), turned)
                p.performCollisionDetection(physicsClientId=self._client)
            return min(
                map(_DISTANCE, p.getContactPoints(self._body, self._floor, -2, -2, self._client)),
                default=None,
            )

        found_m = touching_height(apart, touching, start_m=size_m + 1.0, size_m=size_m)
        if found_m is None:
            return None
        # The bounding box knows it to the last bit, where it has no margin.
        exact = abs(found_m - by_box_m) <= ROUNDING_M * max(1.0, abs(found_m))
        return (by_box_m if exact else round(found_m, 14)) + 0.0  # no -0.0

    def samples(self, batch: int) -> Iterator[Float64]:
        """Fall: yield the state before each step and after the last, in batches.

        Parameters
        ----------
        batch
            Most rows in one batch.

        Yields
        ------
        Arrays of shape (n, 16), float64: position [m], orientation (x, y, z, w), linear [m/s] and
        angular [rad/s] velocity in world axes; then number of contact points, smallest distance
        [m] (nan without contact) and total normal force [N] of the step that led here. A body with
        joints has 13 columns more for each link: position, orientation and velocities of its own
        centre of mass.

        Raises
        ------
        DropError
            If they are no numbers any more that a recording holds.
        """
        pose, velocity, step = p.getBasePositionAndOrientation, p.getBaseVelocity, p.stepSimulation
        body, client, contact = self._body, self._client, self._contact
        stepped = self.scenario.stepped
        samples = self.scenario.steps + 1
        for start in range(0, samples, batch):
            rows = np.empty((min(batch, samples - start), STATE_WIDTH))
            links = np.empty((len(rows), LINK_WIDTH * len(self._links)))
            memory = rows.data
            for row in range(len(rows)):
                if stepped and (start or row):
                    step(client)
                position, orientation = pose(body, client)
                linear, angular = velocity(body, client)
                _put_row(
                    memory, row * _ROW_BYTES, *position, *orientation, *linear, *angular, *contact()
                )
                if self._links:
                    links[row] = self._link_states()
            check_numbers(_without_gaps(rows), start)
            check_numbers(links, start)
            yield np.hstack((rows, links)) if self._links else rows

    def _link_states(self) -> list[float]:
        """Return the state of each link, as it is now and not as it was before the step."""
        states = p.getLinkStates(
            self._body,
            self._links,
            computeLinkVelocity=1,
            computeForwardKinematics=1,
            physicsClientId=self._client,
        )
        return [x for state in states for place in (0, 1, 6, 7) for x in state[place]]

    def _contact(self) -> tuple[float, float, float]:
        if self._floor is None:
            return 0.0, math.nan, 0.0
        # By position, which is 0.2 µs quicker than by name; -2 is any link.
        points = p.getContactPoints(self._body, self._floor, -2, -2, self._client)
        if not points:
            return 0.0, math.nan, 0.0
        return len(points), min(map(_DISTANCE, points)), math.fsum(map(_NORMAL_FORCE, points))


def check_numbers(rows: Float64, first: int) -> None:
    """Make sure that the engine still computes: what it was given may be too much for it.

    `rows` holds numbers of consecutive samples, the first of which is number `first`.

    Raises
    ------
    DropError
        If one of them is nan, or larger than what a recording holds.
    """
    lost = np.flatnonzero(~(np.abs(rows) <= LARGEST).all(axis=1))
    if len(lost):
        raise DropError(
            f"the engine's state is no number any more from step {first + lost[0]} on (or over "
            f"{LARGEST:g}); try a shorter --timestep, less --spin or --velocity, or another --body"
        )


def _without_gaps(rows: Float64) -> Float64:
    """Return samples with 0 for the distance to the floor where no contact has one."""
    filled = rows.copy()
    filled[rows[:, _CONTACT_POINTS] == 0, _CONTACT_POINTS + 1] = 0.0
    return filled


_ROW = struct.Struct(f"={STATE_WIDTH}d")
_put_row, _ROW_BYTES = _ROW.pack_into, _ROW.size
"""Fills a row of an array three times faster than a list of floats becomes one."""
_DISTANCE, _NORMAL_FORCE = itemgetter(8), itemgetter(9)
"""Of what `getContactPoints` says of a point."""


@functools.lru_cache(maxsize=1024)
def _rest_height(body: str, _sha256: str, orientation_xyzw: Quaternion) -> float | None:
    """Return `World.rest_height_m`, measured once for a URDF of this digest turned like this."""
    with World(Scenario(body=body, mass_kg=1.0, orientation=orientation_xyzw)) as world:
        return world._touching_height()


def _name(body: int, client: int) -> str:
    name: bytes = p.getBodyInfo(body, physicsClientId=client)[1]
    return name.decode(errors="replace")
