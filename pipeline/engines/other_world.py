"""The world of a drop in an engine other than PyBullet, with PyBullet's to read the URDF."""

from __future__ import annotations

import contextlib
import importlib
import math
import struct
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from importlib import metadata
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from pipeline.engines.bullet.world import World, check_numbers, no_number
from pipeline.engines.session import RigidBody, Session
from pipeline.errors import ScenarioError
from pipeline.fields import counted
from pipeline.report import EngineReport
from pipeline.scenario import ENGINES, ENGINES_WITH, Engine, Scenario
from pipeline.states import BASE, BODY, CONTACT, FLOOR, STATE, Batch

Float64 = NDArray[np.float64]
Build = Callable[[Scenario, RigidBody], Session]

SESSIONS: dict[Engine, str] = {
    "mujoco": "pipeline.engines.mujoco:MujocoSession",
    "dart": "pipeline.engines.dart:DartSession",
    "drake": "pipeline.engines.drake:DrakeSession",
    "physx": "pipeline.engines.physx:PhysxSession",
}
"""Where each engine is driven; imported when it is asked for."""
DISTRIBUTIONS: dict[Engine, str] = {
    "mujoco": "mujoco", "dart": "dartpy", "drake": "drake", "physx": "sapien",
}  # fmt: skip
"""What is installed of each."""
SHAPES = ("box", "sphere", "cylinder", "capsule")
"""Those that every engine here has."""
BULLETS_OWN = (
    "substeps", "rolling_friction", "spinning_friction", "collision_margin_m", "pybullet_api",
    "contact_stiffness_n_m", "contact_damping_n_s_m", "solver_iterations", "restitution",
    "lateral_friction", "floor_restitution", "floor_lateral_friction",
)  # fmt: skip
"""What PyBullet's report says of PyBullet."""
_ROW = struct.Struct("<5q19d").pack


class OtherWorld:
    """One body above one floor in an engine; use it in a `with` statement.

    Parameters
    ----------
    scenario
        What to drop, and how.
    build
        From scenario and body to the session that drops it; None for that of the scenario's engine.

    Raises
    ------
    ScenarioError
        If the engine is not installed, or the body is not one that it takes.
    """

    def __init__(self, scenario: Scenario, build: Build | None = None) -> None:
        self.scenario = scenario
        # What the others take is not for PyBullet, which only looks at the body.
        plain: dict[str, Any] = {name: None for name in ENGINES_WITH if name != "coordinates"}
        with World(replace(scenario, engine="bullet", integrator=None, **plain)) as read:
            self.half_size_m: Float64 = read.half_size_m
            self.rest_height_m = read.rest_height_m
            self._read = read.report()
            body = rigid_body(read, self._read)
        self._session = (build or _installed(scenario.engine))(scenario, body)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    watch: Callable[[Batch], object] = staticmethod(lambda _: None)

    def report(self) -> EngineReport:
        """Return what the engine says of itself and of the body; its shape is as PyBullet read."""
        empty: dict[str, Any] = dict.fromkeys(BULLETS_OWN) | {"substeps": 0}
        reported = self._session.reported()
        moments = reported["inertia_kg_m2"]
        return replace(
            self._read, **(empty | reported),
            link_masses_kg=(reported["mass_kg"],), link_inertias_kg_m2=moments,
        )  # fmt: skip

    def notes(self) -> Iterator[str]:
        """Yield what the engine does not take from the URDF, each in a sentence.

        A value of PyBullet's is that of the URDF's `<contact>`, or its own default.
        """
        theirs, name = self.report(), ENGINES[self.scenario.engine]
        for field, option in (("lateral_friction", "friction"), ("restitution", "restitution")):
            mine, other = getattr(self._read, field), getattr(theirs, field)
            asked = getattr(self.scenario, option) is not None
            if not asked and mine is not None and other is not None and not _near(mine, other):
                yield (
                    f"{name} has a {field.replace('_', ' ')} of {other:.4g} for this body, where "
                    f"PyBullet has {mine:.4g}; to have the same, set --{option}"
                )
        for field in ("rolling_friction", "spinning_friction", "contact_stiffness_n_m"):
            if getattr(self._read, field):
                what = field.removesuffix("_n_m").replace("_", " ")
                yield f"{name} leaves out the {what} that the URDF's <contact> gives to PyBullet"

    def skip(self, steps: int) -> None:
        """Take steps whose samples nobody reads."""
        for step in range(steps if self.scenario.stepped else 0):
            self._step(step)

    def _step(self, step: int) -> None:
        """Take a step; some engines raise where others go on with nan."""
        try:
            self._session.step()
        except RuntimeError:
            raise no_number(step) from None

    def height_m(self) -> float:
        """Return the height of the centre at the end of the fall [m].

        Raises
        ------
        DropError
            If it is no number.
        """
        state = self._session.state()
        if not all(map(math.isfinite, state)):
            raise no_number(self.scenario.steps)
        return state[2]

    def samples(self, batch: int) -> Iterator[Batch]:
        """Fall: yield the state before each step and after the last, and what touched meanwhile.

        Each batch goes to `watch` too.

        Parameters
        ----------
        batch
            Most samples in one batch.

        Raises
        ------
        DropError
            If a state or a contact becomes a number that no recording holds.
        """
        session, samples = self._session, self.scenario.steps + 1
        for start in range(0, samples, batch):
            states, contacts = np.zeros(min(batch, samples - start), STATE), bytearray()
            for row, sample in enumerate(range(start, min(start + batch, samples))):
                if self.scenario.stepped and sample:
                    self._step(sample)
                    for point in session.contacts():
                        contacts += _ROW(sample, BODY, BASE, FLOOR, BASE, *point)
                with np.errstate(all="ignore"):  # what is no number is refused below
                    state = session.state()
                states[row] = (
                    sample, BODY, BASE, state[:3], state[3:7], state[7:10], state[10:],
                )  # fmt: skip
            found = Batch(states, np.frombuffer(contacts, CONTACT))
            for rows in found:
                check_numbers(rows)
            self.watch(found)
            yield found


def other_versions(engines: Iterable[Engine]) -> dict[str, str]:
    """Return the versions of those engines that are installed, but for PyBullet's."""
    found = {}
    for engine in engines:
        with contextlib.suppress(KeyError, metadata.PackageNotFoundError):
            found[f"{engine}_version"] = metadata.version(DISTRIBUTIONS[engine])
    return found


def rigid_body(world: World, report: EngineReport) -> RigidBody:
    """Return the body that PyBullet has read from a URDF.

    Raises
    ------
    ScenarioError
        If it has joints, or shapes that not every engine has.
    """
    body, shapes = world.scenario.body, world.shapes()
    has = counted(report.joints, "joint") if report.joints else ""
    for shape in shapes:
        if shape.kind not in SHAPES:
            has = has or f"a shape that is a {shape.kind}"
    if has:
        raise ScenarioError(
            f"--engine other than bullet takes a body of one link, made of {', '.join(SHAPES)}, "
            f"got {has} in {body!r}; drop it with --engine bullet"
        )
    return RigidBody(report.body_name, report.mass_kg, report.inertia_kg_m2, shapes)


def _near(one: float, other: float) -> bool:
    """Whether two engines have the same number; one may round to float32."""
    return math.isclose(one, other, rel_tol=1e-6, abs_tol=1e-12)


def _installed(engine: Engine) -> Build:
    """Return what builds the session of an engine."""
    module, name = SESSIONS[engine].split(":")
    try:
        build: Build = getattr(importlib.import_module(module), name)
    except ModuleNotFoundError as error:
        if (error.name or "").startswith("pipeline"):
            raise
        raise ScenarioError(
            f"--engine {engine} needs {ENGINES[engine]}, which is not installed; "
            f"try: pip install 'drop-physics[{engine}]'"
        ) from None
    return build
