"""The PyBullet world of a simulated drop: builds it, steps it, and reads its states.

Every setting is made explicitly, in a separate client, so that no earlier run in the process can
affect this one.
"""

from __future__ import annotations

import functools
import hashlib
import math
from collections.abc import Iterator
from dataclasses import replace
from operator import itemgetter
from pathlib import Path
from typing import Any, Self

import numpy as np

from drop_physics.address_space import check_address_space
from drop_physics.arrays import Float64
from drop_physics.engine_report import EngineReport
from drop_physics.engines.finite import drop_samples
from drop_physics.engines.pybullet.c_output import c_output_moved_aside
from drop_physics.engines.pybullet.described import reported_of
from drop_physics.engines.pybullet.engine import data_folder, p
from drop_physics.engines.pybullet.found import find_body
from drop_physics.engines.pybullet.gathered import points_of
from drop_physics.engines.pybullet.jointed import JointStates, joints_of
from drop_physics.engines.pybullet.touching import ROUNDING_M, distances, touching_height
from drop_physics.engines.pybullet.watch.worlds import POINT, POSE, pack_points
from drop_physics.engines.rigid_body import PrimitiveShape
from drop_physics.errors import ScenarioError
from drop_physics.option_types import Quaternion
from drop_physics.scenario import Coordinates, Scenario
from drop_physics.trace.events import GIVEN, Joint, Samples
from drop_physics.trace.states import BASE, BODY, FLOOR

SHAPES = {2: "sphere", 3: "box", 4: "cylinder", 5: "mesh", 6: "plane", 7: "capsule"}
"""pybullet's GEOM_ constants."""
CLIENT_BYTES = 64 << 20
"""Memory needed by a client [bytes]: about 30 MB, plus some for body and floor."""


class World:
    """One body above one floor, in its own PyBullet client; use it in a `with` statement.

    Parameters
    ----------
    scenario
        The body, and how it is dropped.
    round_cylinders
        Whether a `<cylinder>` is loaded as a cylinder; by default Bullet replaces it by a convex
        hull, from which it computes the inertia.

    Raises
    ------
    ScenarioError
        If the body cannot be found or loaded, or has no mass.
    MemoryError
        If there is not enough memory for a client.
    """

    def __init__(self, scenario: Scenario, *, round_cylinders: bool = False) -> None:
        self.scenario = scenario
        self._round_cylinders = round_cylinders
        self._urdf = find_body(scenario.body)
        self._own: tuple[float, tuple[float, ...]] | None = None  # the URDF's mass and inertia
        check_address_space(CLIENT_BYTES)  # Bullet would end this process
        self._client: int = p.connect(p.DIRECT)
        try:
            self._body = self._load_body()
            self._links = list(range(p.getNumJoints(self._body, physicsClientId=self._client)))
            self._body_sha256 = hashlib.sha256(self._urdf.read_bytes()).hexdigest()
            self._floor = self._load(data_folder() / "plane.urdf") if scenario.floor else None
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

    def _load(self, urdf: str | Path, **options: Any) -> int:  # noqa: ANN401
        with c_output_moved_aside():
            p.setAdditionalSearchPath(str(data_folder()), physicsClientId=self._client)
            return int(p.loadURDF(str(urdf), physicsClientId=self._client, **options))

    def _load_body(self) -> int:
        maximal = self.scenario.coordinates == "maximal"
        options = {"flags": p.URDF_USE_IMPLICIT_CYLINDER} if self._round_cylinders else {}
        try:
            body = self._load(self._urdf, useMaximalCoordinates=maximal, **options)
        except p.error as error:
            raise ScenarioError(
                "--body must be a URDF that Bullet can load, got {body!r} ({error}); check it with "
                "another tool, or try cube_small.urdf",
                body=self.scenario.body,
                error=str(error),
            ) from None
        if maximal:
            self._refuse_joints()
            if not self._dynamics(body)[0] > 0 and self.scenario.mass_kg is not None:
                raise ScenarioError(
                    "--mass with --coordinates maximal takes a body that has a mass, got 0 kg in "
                    "{body!r}: Bullet holds such a btRigidBody still, whatever mass it is given; "
                    "use --coordinates reduced",
                    body=self.scenario.body,
                )
        self._set_dynamics(body)
        if not p.getDynamicsInfo(body, -1, physicsClientId=self._client)[0] > 0:
            raise ScenarioError(
                "--body must have a mass, got 0 kg in {body!r}: Bullet holds it still; "
                "try --mass 0.1",
                body=self.scenario.body,
            )
        return body

    def _refuse_joints(self) -> None:
        with self._twin() as twin:
            if twin._links:
                raise ScenarioError(
                    "--coordinates maximal takes a body without joints: PyBullet neither places "
                    "nor reports the links of a btRigidBody, and {body!r} has {links}; "
                    "use --coordinates reduced",
                    body=self.scenario.body,
                    links=len(twin._links),
                )

    def _set_dynamics(self, body: int) -> None:
        base = {"bodyUniqueId": body, "linkIndex": -1, "physicsClientId": self._client}
        mass_kg = self.scenario.mass_kg
        if mass_kg is not None:
            # A mass alone would set the inertia of the shape, not the URDF's.
            p.changeDynamics(mass=mass_kg, **self._inertia_of(mass_kg, body), **base)
        if self.scenario.linear_damping is not None:
            p.changeDynamics(linearDamping=self.scenario.linear_damping, **base)
        if self.scenario.angular_damping is not None:
            p.changeDynamics(angularDamping=self.scenario.angular_damping, **base)

    def _inertia_of(self, mass_kg: float, body: int) -> dict[str, tuple[float, ...]]:
        """Return the URDF's inertia, scaled to another mass; empty if the URDF has no mass."""
        if self.scenario.coordinates == "maximal":  # which reports 1 / (1 / m), not always m
            with self._twin() as twin:
                return {"localInertiaDiagonal": twin._dynamics()[2]}
        if self._own is None:
            self._own = itemgetter(0, 2)(self._dynamics(body))
        own_kg, inertia_kg_m2 = self._own
        if own_kg == 0:
            return {}
        return {
            "localInertiaDiagonal": tuple(moment * (mass_kg / own_kg) for moment in inertia_kg_m2)
        }

    def _twin(self) -> World:
        """Return the same world built as a multibody, for which the engine reports more."""
        return World(replace(self.scenario, coordinates="reduced"))

    @property
    def half_size_m(self) -> Float64:
        """Half of the base's extents along its own axes [m], shape (3,)."""
        lowest, highest = self._extent()
        return (highest - lowest) / 2

    @property
    def reach_m(self) -> float:
        """Distance of the farthest bounding-box corner from the base's centre of mass [m]."""
        lowest, highest = self._extent()
        return float(np.linalg.norm(np.maximum(-lowest, highest)))

    def _extent(self) -> tuple[Float64, Float64]:
        body, sha256 = str(self._urdf), self._body_sha256
        return _extent(body, sha256, self.scenario.coordinates, self._round_cylinders)

    def _box_at_origin(self) -> tuple[Float64, Float64]:
        """Measure the bounding box, in a separate world.

        At the origin, the box is exact to the last bit. The world is a separate one because a body
        with joints that was first placed at the origin would land differently.
        """
        self.place((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
        return self._box()

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
        given = {name: value for name, value in surface.items() if value is not None}
        for body, links in ((self._body, self._links), (self._floor, [])):
            if body is not None and given:
                for link in (-1, *links):
                    p.changeDynamics(body, link, physicsClientId=client, **given)

    def _release(self) -> None:
        self.place((0.0, 0.0, self.scenario.height_m), self.scenario.orientation_xyzw)
        p.resetBaseVelocity(
            self._body,
            self.scenario.velocity_m_s,
            self.scenario.spin_rad_s,
            physicsClientId=self._client,
        )

    def place(self, position_m: Any, orientation: Any) -> None:  # noqa: ANN401
        """Move the body to a position [m] and an orientation, a quaternion x, y, z, w."""
        p.resetBasePositionAndOrientation(
            self._body, position_m, orientation, physicsClientId=self._client
        )

    # -- reading ----------------------------------------------------------------------------------

    def report(self) -> EngineReport:
        """Return the engine's report on itself and both bodies, read back after set-up."""
        if self.scenario.coordinates == "reduced":
            return self._report(twin=self)
        # PyBullet reports little of a btRigidBody: ask the same URDF in reduced coordinates.
        with self._twin() as twin:
            return self._report(twin)

    def _report(self, twin: World) -> EngineReport:
        engine = p.getPhysicsEngineParameters(physicsClientId=self._client)
        body, floor = self._dynamics(), None if self._floor is None else self._dynamics(self._floor)
        base, links = twin._dynamics(), [twin._dynamics(twin._body, link) for link in twin._links]
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
            body_name=p.getBodyInfo(twin._body, twin._client)[1].decode(errors="replace"),
            body_sha256=self._body_sha256,
            body_type={1: "btRigidBody", 2: "btMultiBody"}.get(body[10], str(body[10])),
            joints=len(links),
            mass_kg=math.fsum(masses_kg),
            link_masses_kg=tuple(masses_kg),
            inertia_kg_m2=base[2],
            link_inertias_kg_m2=tuple(moment for link in (base, *links) for moment in link[2]),
            lateral_friction=body[1],
            rolling_friction=body[6],
            spinning_friction=body[7],
            restitution=base[5],
            contact_stiffness_n_m=None if base[9] < 0 else base[9],
            contact_damping_n_s_m=None if base[8] < 0 else base[8],
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

    def dynamics(self, number: int = BODY) -> dict[str, Float64]:
        """Return the engine's dynamics info for base and links, and the scenario's damping."""
        floor = number == FLOOR
        body, links = (self._floor, []) if floor else (self._body, self._links)
        reported = reported_of([self._dynamics(body, link) for link in (BASE, *links)])
        if floor:
            return reported
        given = (self.scenario.linear_damping, self.scenario.angular_damping)
        return reported | {
            name: np.array([value])
            for name, value in zip(GIVEN, given, strict=True)
            if value is not None
        }

    def shapes(self) -> tuple[PrimitiveShape, ...]:
        """Return the base's collision shapes."""
        return tuple(
            PrimitiveShape(
                SHAPES.get(kind, "unknown"),
                size_m if kind == p.GEOM_BOX else (size_m[1] or size_m[0], size_m[0], 0.0),
                position_m,
                orientation,
            )
            for _, _, kind, size_m, _, position_m, orientation in p.getCollisionShapeData(
                self._body, -1, physicsClientId=self._client
            )
        )

    def notes(self) -> Iterator[str]:
        """Yield warnings about parts of the URDF that the engine ignores: PyBullet has none."""
        yield from ()

    def _dynamics(self, body: int | None = None, link: int = -1) -> Any:  # noqa: ANN401
        """Return the result of `getDynamicsInfo` for a body, by default this world's own."""
        return p.getDynamicsInfo(
            self._body if body is None else body, link, physicsClientId=self._client
        )

    # -- touching ---------------------------------------------------------------------------------

    @property
    def rest_height_m(self) -> float | None:
        """Height of the centre at which the body, oriented as released, touches the floor [m]."""
        body, sha256 = str(self._urdf), self._body_sha256
        return _rest_height(body, sha256, self.scenario.orientation_xyzw, self._round_cylinders)

    def _touching_height(self) -> float | None:
        """Measure the rest height, in a separate world."""
        turned = self.scenario.orientation_xyzw
        self.place((0.0, 0.0, 0.0), turned)
        by_box_m = -float(self._box()[0][2])
        size_m = 2 * float(np.linalg.norm(self.half_size_m))
        height_m = touching_height(
            *distances(self._body, self._floor, turned, self._client),
            start_m=size_m + 1.0,
            size_m=size_m,
        )
        if height_m is None:
            return None
        # Without a margin, the bounding box has it to the last bit.
        exact = abs(height_m - by_box_m) <= ROUNDING_M * max(1.0, abs(height_m))
        return (by_box_m if exact else round(height_m, 14)) + 0.0  # no -0.0

    def samples(self, batch: int) -> Iterator[Samples]:
        """Let the body fall; yield the states before and after the steps, and the contact points.

        Parameters
        ----------
        batch
            The largest number of samples in a batch.

        Raises
        ------
        DropError
            If a state or a contact becomes non-finite, or too large for a recording.
        """
        pose, velocity, step = p.getBasePositionAndOrientation, p.getBaseVelocity, p.stepSimulation
        touching, body, client, pack = p.getContactPoints, self._body, self._client, POSE.pack_into
        stepped, joints, size = self.scenario.stepped, self._joint_states, POSE.size
        moving = bool(joints.moving)
        timestep_s, samples = self.scenario.timestep_s, self.scenario.steps + 1
        for start in range(0, samples, batch):
            steps = np.arange(start, min(start + batch, samples))
            # New memory for each batch: the recorder keeps it.
            base = np.empty((len(steps), 13))
            driven: list[list[float]] = []
            contacts, counts = bytearray(), list[int]()
            memory, place = base.reshape(-1).view(np.uint8).data, 0
            for sample in range(start, start + len(steps)):
                if stepped and sample:
                    step(client)
                (x, y, z), (a, b, c, d) = pose(body, client)
                (vx, vy, vz), (wx, wy, wz) = velocity(body, client)
                pack(memory, place, x, y, z, a, b, c, d, vx, vy, vz, wx, wy, wz)
                place += size
                if moving:
                    driven.append(joints.now())
                # Of all bodies: asked about two, the engine turns the normal towards the first,
                # but not the directions of friction. By position, which is 0.2 µs faster; -1 is
                # any body, -2 any link.
                touched = touching(-1, -1, -2, -2, client)
                counts.append(len(touched))
                if touched:
                    end = len(contacts)
                    contacts += bytes(len(touched) * POINT.size)
                    pack_points(touched, contacts, end)
            points = points_of(contacts, np.repeat(steps, counts))
            moved = joints.table(steps, timestep_s, np.array(driven)) if moving else None
            yield drop_samples(steps, timestep_s, base, points, moved)

    @functools.cached_property
    def joints(self) -> tuple[Joint, ...]:
        """The joints of the body's links, in order."""
        return joints_of(self._body, self._links, self._client)

    @functools.cached_property
    def _joint_states(self) -> JointStates:
        return JointStates(self._body, self._client, self.joints)

    @functools.cached_property
    def inertial_frames(self) -> Float64:
        """Inertial frames of base and links in their own frames: poses, shape (links + 1, 7)."""
        if self.scenario.coordinates == "maximal":  # of which the engine reports leftovers
            return np.array([[0.0] * 6 + [1.0]])
        dynamics = [self._dynamics(link=link) for link in (-1, *self._links)]
        return np.array([[*each[3], *each[4]] for each in dynamics])


@functools.lru_cache(maxsize=1024)
def _extent(
    body: str, _sha256: str, coordinates: Coordinates, round_cylinders: bool
) -> tuple[Float64, Float64]:
    """Measure the bounding box at the origin, once per digest of a URDF."""
    scenario = Scenario(body=body, mass_kg=1.0, coordinates=coordinates, floor=False)
    with World(scenario, round_cylinders=round_cylinders) as world:
        return world._box_at_origin()


@functools.lru_cache(maxsize=1024)
def _rest_height(
    body: str, _sha256: str, orientation_xyzw: Quaternion, round_cylinders: bool
) -> float | None:
    """Measure the height at rest on the floor, once per digest of a URDF and orientation."""
    scenario = Scenario(body=body, mass_kg=1.0, orientation=orientation_xyzw)
    with World(scenario, round_cylinders=round_cylinders) as world:
        return world._touching_height()
