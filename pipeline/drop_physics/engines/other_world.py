"""The world of a drop in an engine other than PyBullet; PyBullet reads the URDF, if installed."""

from __future__ import annotations

import contextlib
import math
import struct
from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from drop_physics.arrays import Float64
from drop_physics.engine_report import EngineReport
from drop_physics.engines.finite import drop_samples
from drop_physics.engines.rigid_body import RigidBody
from drop_physics.engines.urdf import find_urdf, read_urdf
from drop_physics.errors import DropError, ScenarioError
from drop_physics.fields import counted
from drop_physics.installed import PYBULLET, is_installed
from drop_physics.messages import Message
from drop_physics.scenario import ENGINES, ENGINES_WITH, Scenario
from drop_physics.trace.events import Joint, Samples
from drop_physics.trace.states import BASE, BODY, CONTACT, FLOOR

if TYPE_CHECKING:
    from drop_physics.engines.mujoco.world import MujocoSession
    from drop_physics.engines.pybullet.world import World

SHAPES = ("box", "sphere", "cylinder", "capsule")
"""Shape kinds that can be dropped in these engines."""
BULLETS_OWN = (
    "substeps", "rolling_friction", "spinning_friction", "collision_margin_m", "pybullet_api",
    "contact_stiffness_n_m", "contact_damping_n_s_m", "solver_iterations", "restitution",
    "lateral_friction", "floor_restitution", "floor_lateral_friction",
)  # fmt: skip
"""Fields of PyBullet's report that concern only PyBullet."""
_POINT = struct.Struct("<5q19d").pack


class OtherWorld:
    """One body above a floor in the chosen engine; use it in a `with` statement.

    Parameters
    ----------
    scenario
        The body, and how it is dropped.

    Raises
    ------
    ScenarioError
        If the engine is not installed, or does not support the body.
    """

    def __init__(self, scenario: Scenario) -> None:
        self.scenario = scenario
        read = _read_by_bullet if is_installed(PYBULLET) else _read_without
        self._read, self.half_size_m, body = read(scenario)
        if any(shape.kind == "cylinder" for shape in body.shapes):
            # Bullet rounds its edges, by 0.4 mm where it is tilted.
            depths_m = [shape.depth_m(scenario.orientation_xyzw) for shape in body.shapes]
            self._read = replace(self._read, rest_height_m=round(max(depths_m), 14) + 0.0)
        self.rest_height_m = self._read.rest_height_m
        self._steps = 0
        self._session = _session(scenario, body)

    joints: tuple[Joint, ...] = ()
    """The joints of the body: none."""
    inertial_frames = np.array([[0.0] * 6 + [1.0]])
    """The inertial frame in the body's own frame, which is the identity, as a pose of shape (1, 7).
    """

    def dynamics(self, _: int = BODY) -> dict[str, Float64]:
        """Return properties that the engine reports besides mass and inertia: none."""
        return {}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def report(self) -> EngineReport:
        """Return the engine's report on itself and the body; the shape comes from PyBullet."""
        empty: dict[str, Any] = dict.fromkeys(BULLETS_OWN) | {"substeps": 0}
        reported = self._session.reported()
        moments = reported["inertia_kg_m2"]
        return replace(
            self._read,
            **(empty | reported),
            link_masses_kg=(reported["mass_kg"],),
            link_inertias_kg_m2=moments,
        )

    def notes(self) -> Iterator[str]:
        """Yield the parts of the URDF that the engine ignores, as sentences.

        The ignored values are those in the URDF's `<contact>`, or PyBullet's defaults.
        """
        theirs, name = self.report(), ENGINES[self.scenario.engine]
        bullets, value = self._read.lateral_friction, theirs.lateral_friction
        if (
            self.scenario.friction is None
            and bullets is not None
            and value is not None
            and not math.isclose(bullets, value, rel_tol=1e-6, abs_tol=1e-12)
        ):
            yield Message(
                "{engine} has a lateral friction of {value:.4g} for this body, where PyBullet has "
                "{bullets:.4g}; to have the same, set --friction",
                engine=name,
                value=value,
                bullets=bullets,
            )
        for field, quantity in (
            ("rolling_friction", Message("rolling friction")),
            ("spinning_friction", Message("spinning friction")),
            ("contact_stiffness_n_m", Message("contact stiffness")),
        ):
            if getattr(self._read, field):
                yield Message(
                    "{engine} ignores the {quantity} that the URDF's <contact> sets in PyBullet",
                    engine=name,
                    quantity=quantity,
                )

    def _step(self) -> None:
        """Make a step; MuJoCo raises an error if a state becomes non-finite."""
        self._steps += 1
        try:
            self._session.step()
        except RuntimeError:
            raise DropError(
                "the state becomes non-finite at step {step}, or too large for {engine}; try a "
                "shorter --timestep, less --spin or --velocity, or another --body",
                step=self._steps,
                engine=ENGINES[self.scenario.engine],
            ) from None

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
        session, samples = self._session, self.scenario.steps + 1
        for start in range(0, samples, batch):
            steps = np.arange(start, min(start + batch, samples))
            states, contacts = [], bytearray()
            with np.errstate(all="ignore"):  # non-finite numbers are rejected below
                for sample in steps.tolist():
                    if self.scenario.stepped and sample:
                        self._step()
                        for point in session.contacts():
                            contacts += _POINT(sample, BODY, BASE, FLOOR, BASE, *point)
                    states.append(session.state())
                base = session.motions(np.array(states))
            points = np.frombuffer(contacts, CONTACT)
            yield drop_samples(steps, self.scenario.timestep_s, base, points)


def _read_by_bullet(scenario: Scenario) -> tuple[EngineReport, Float64, RigidBody]:
    """Return the body as PyBullet reads it: its report, half its size, and the rigid body."""
    from drop_physics.engines.pybullet import world

    # Without the other engine's options: PyBullet only reads the body.
    plain: dict[str, Any] = {name: None for name in ENGINES_WITH if name != "coordinates"}
    bullets = replace(scenario, engine="bullet", integrator=None, **plain)
    with contextlib.ExitStack() as stack:
        read = stack.enter_context(world.World(bullets))
        report = read.report()
        if any(shape.kind == "mesh" for shape in read.shapes()):
            # It may be the hull that Bullet makes of a cylinder; the inertia stays the hull's.
            inertia_kg_m2 = report.inertia_kg_m2
            read = stack.enter_context(world.World(bullets, round_cylinders=True))
            report = replace(read.report(), inertia_kg_m2=inertia_kg_m2)
        return report, read.half_size_m, rigid_body(read, report)


def _read_without(scenario: Scenario) -> tuple[EngineReport, Float64, RigidBody]:
    """Return the body of a scenario, read without PyBullet."""
    read = read_urdf(find_urdf(scenario.body), scenario.mass_kg)
    body = read.body
    single = body.shapes[0] if len(body.shapes) == 1 else None
    report = EngineReport(
        timestep_s=scenario.timestep_s,
        substeps=0,
        gravity_m_s2=(0.0, 0.0, scenario.effective_gravity_m_s2),
        body_name=body.name,
        body_sha256=read.sha256,
        body_type="",
        joints=0,
        mass_kg=body.mass_kg,
        link_masses_kg=(body.mass_kg,),
        inertia_kg_m2=body.inertia_kg_m2,
        link_inertias_kg_m2=body.inertia_kg_m2,
        shape=single.kind if single else "compound" if body.shapes else "none",
        shape_dimensions_m=single.size_m if single else (),
        shape_position_m=single.position_m if single else None,
        shape_orientation=single.orientation if single else None,
        reach_m=read.reach_m,
        rest_height_m=read.rest_height_m(scenario.orientation_xyzw),
    )
    return report, read.half_size_m, body


def rigid_body(world: World, report: EngineReport) -> RigidBody:
    """Return the rigid body that PyBullet read from a URDF.

    Raises
    ------
    ScenarioError
        If the body has joints, or a shape of an unsupported kind.
    """
    body, shapes = world.scenario.body, world.shapes()
    if report.joints:
        raise ScenarioError(
            "--engine other than bullet takes a body of one link, got {joints} in {body!r}; "
            "drop it with --engine bullet",
            joints=counted(report.joints, "joint"),
            body=body,
        )
    for shape in shapes:
        if shape.kind not in SHAPES:
            raise ScenarioError(
                "--engine other than bullet takes a body made of {shapes}, got a shape of kind "
                "{kind} in {body!r}; drop it with --engine bullet",
                shapes=", ".join(SHAPES),
                kind=shape.kind,
                body=body,
            )
    return RigidBody(report.body_name, report.mass_kg, report.inertia_kg_m2, shapes)


def _session(scenario: Scenario, body: RigidBody) -> MujocoSession:
    """Return a session of the scenario's engine, with the body above a floor."""
    from drop_physics.engines.mujoco.world import MujocoSession

    return MujocoSession(scenario, body)
