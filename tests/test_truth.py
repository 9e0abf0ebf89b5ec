"""Every statement of `drop analyze --json`, compared with an oracle independent of our code.

Validation: scenarios are drawn over all options together, dropped and analyzed as a user would, and
each key of the result is confirmed by `tests/oracle.py`, which replays the scenario in PyBullet
itself. A key may be null; a key without a checker fails. By hand, with a table of what was said:

    python tests/test_truth.py 5000 SEED
"""

from __future__ import annotations

import argparse
import functools
import math
import os
import random
import re
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import MISSING, dataclass, field, fields, replace
from decimal import Decimal
from fractions import Fraction
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import oracle
import pybullet as p
import pytest
from conftest import some
from drop_physics import Scenario, analyze, simulate
from drop_physics.engines.pybullet import probe
from drop_physics.engines.pybullet.world import World
from drop_physics.errors import DropError, ScenarioError
from drop_physics.rules.codes import LEVELS
from dropped import analysis_of_world
from oracle import Drop, Rebound, Truth

CASES = 150
SEED = 13
CONVERGED: dict[str, Any] = {"solver_residual": 0.0, "solver_iterations": 1000}
"""Settings that let the contact solver converge."""
SLOP_M = 1e-5
"""Penetration that Bullet leaves uncorrected [m]."""
EDGE_M = 100.0
"""Distance from the origin to the edge of plane.urdf [m]."""
UNTURNED_RAD = 5e-3
"""A body rotated by less than this counts as unrotated, which is accurate to this fraction."""
LYING_RAD = 1e-4
"""A body tilted by more than this is not reported to lie at a height."""


# -- scenarios -------------------------------------------------------------------------------------


def drawn(rng: random.Random, folder: Path) -> Scenario:
    """Return a random scenario that varies all options, with at most about 600 steps."""
    body = _body(rng, folder)
    timestep_s = rng.choice((1 / 240, 1 / 240, 1 / 480, 1 / 60, 1 / 1000, 0.1, 1e-4, 0.02))
    if rng.random() < 0.2:
        timestep_s = 10 ** rng.uniform(-4, -1)
    steps = rng.randint(1, 20) if rng.random() < 0.05 else rng.randint(60, 500)
    duration_s = steps * timestep_s
    values: dict[str, Any] = {
        "body": body,
        "timestep_s": timestep_s,
        "duration_s": duration_s,
        "gravity_m_s2": _often(rng, -9.81, 0.7, (-1.62, -3.71, 0.0, 2.0, -25.0, -0.1)),
        "linear_damping": _often(rng, None, 0.5, (0.0, 0.0, 0.04, 1e-12, 0.3, 1.0)),
        "angular_damping": _often(rng, None, 0.6, (0.0, 0.0, 0.04, 0.5)),
        "velocity_m_s": _velocity(rng),
        "spin_rad_s": _spin(rng),
        "orientation": _orientation(rng),
        "mass_kg": _often(rng, None, 0.75, (10 ** rng.uniform(-3, 4),)),
        "restitution": _often(rng, None, 0.4, (0.0, 0.2, 0.5, 0.8, 0.95, 1.0)),
        "friction": _often(rng, None, 0.75, (0.0, 0.3, 2.0)),
        "restitution_threshold_m_s": _often(rng, None, 0.75, (0.0, 0.05, 1.0)),
        "contact_erp": _often(rng, None, 0.7, (0.0, 0.2, 1.0)),
        "solver_residual": _often(rng, None, 0.65, (0.0, 0.0, 1e-9, 1e-3)),
        "solver_iterations": _often(rng, None, 0.8, (1, 10, 500)),
        "substeps": _often(rng, None, 0.75, (2, 3, 8)),
        "coordinates": _often(rng, "reduced", 0.65, ("maximal",)),
        "stepped": rng.random() > 0.03,
        "gravity_set": rng.random() > 0.03,
        "floor": rng.random() > 0.06,
    }
    values["height_m"] = _height(rng, values, duration_s)
    known = Scenario.options()
    values = {name: value for name, value in values.items() if name in known}
    try:
        return Scenario(**values)
    except ScenarioError:  # of some timesteps the engine does not take so many substeps
        return Scenario(**{**values, "substeps": None})


def _often(rng: random.Random, usual: Any, share: float, others: tuple[Any, ...]) -> Any:
    return usual if rng.random() < share else rng.choice(others)


def _velocity(rng: random.Random) -> oracle.Vector:
    kind = rng.random()
    if kind < 0.55:
        return (0.0, 0.0, 0.0)
    if kind < 0.7:
        return (0.0, 0.0, rng.uniform(-6, 4))
    if kind < 0.93:
        return (rng.uniform(-5, 5), rng.uniform(-5, 5), rng.uniform(-5, 5))
    return rng.choice(((0.0, 0.0, -300.0), (150.0, 0.0, 0.0), (80.0, 60.0, -40.0), (0, 0, 120.0)))


def _spin(rng: random.Random) -> oracle.Vector:
    kind = rng.random()
    if kind < 0.7:
        return (0.0, 0.0, 0.0)
    if kind < 0.8:
        return (0.0, 0.0, rng.uniform(-50, 50))
    if kind < 0.95:
        return (rng.uniform(-9, 9), rng.uniform(-9, 9), rng.uniform(-9, 9))
    return rng.choice(((120.0, 0.0, 0.0), (60.0, -70.0, 80.0)))


def _orientation(rng: random.Random) -> oracle.Vector:
    """Return random roll, pitch and yaw [deg]."""
    kind = rng.random()
    if kind < 0.6:
        return (0.0, 0.0, 0.0)
    if kind < 0.7:
        return rng.choice(((90.0, 0.0, 0.0), (0.0, 90.0, 0.0), (0.0, 0.0, 30.0), (180.0, 0.0, 0.0)))
    reach = 2.0 if kind < 0.8 else 180.0
    return (rng.uniform(-reach, reach), rng.uniform(-reach, reach), rng.uniform(-reach, reach))


def _height(rng: random.Random, values: Mapping[str, Any], duration_s: float) -> float:
    """Return a random height from which the body mostly lands within the duration."""
    if not values["floor"] and rng.random() < 0.3 and Scenario.options()["height_m"].low < 0:
        return rng.uniform(-3, 0)
    probe = replace(_drop(values), height_m=1.0, steps=1)
    touching = oracle.touching_height(probe, probe.orientation)
    if touching is None:
        return rng.uniform(0.05, 2.0)
    if rng.random() < 0.07:
        return max(1e-6, touching * rng.choice((0.3, 0.9, 0.999, 1.0)))
    pull = max(-float(values["gravity_m_s2"]), 0.05)
    reach = min(pull * (duration_s * rng.uniform(0.05, 1.1)) ** 2 / 2, 1e4)
    if rng.random() < 0.6:
        reach = min(reach, 2.0)
    return max(1e-6, touching + reach)


# -- bodies: written as URDF, by a name that says all of it ----------------------------------------

STOCK = (
    "cube_small.urdf", "sphere_small.urdf", "jenga/jenga.urdf", "lego/lego.urdf", "block.urdf",
    "domino/domino.urdf", "teddy_vhacd.urdf", "duck_vhacd.urdf", "sphere8cube.urdf",
    "soccerball.urdf", "objects/mug.urdf", "random_urdfs/001/001.urdf", "r2d2.urdf",
    "TwoJointRobot_w_fixedJoints.urdf",
)  # fmt: skip


def _body(rng: random.Random, folder: Path) -> str:
    if rng.random() < 0.3:
        return rng.choice(("cube_small.urdf", rng.choice(STOCK)))
    size = 10 ** rng.uniform(-1.7, -0.3) if rng.random() < 0.9 else 0.001
    mass = 10 ** rng.uniform(-3, 3.3)
    made = rng.choice(BODIES)
    name = f"{made.__name__[1:].replace('_', '-')}-{size:.3g}m-{mass:.3g}kg.urdf"
    path = folder / name
    if not path.exists():
        path.write_text(made(float(f"{size:.3g}"), float(f"{mass:.3g}")))
    return str(path)


def _link(
    name: str, mass: float, size: float, shapes: str, *, centre: str = "0 0 0", extra: str = ""
) -> str:
    moment = mass * size * size / 6
    tensor = " ".join(
        f'i{axes}="{moment if axes[0] == axes[1] else 0:.6g}"'
        for axes in ("xx", "xy", "xz", "yy", "yz", "zz")
    )
    return (
        f'<link name="{name}"><inertial><origin xyz="{centre}"/><mass value="{mass:.6g}"/>'
        f"<inertia {tensor}/></inertial>{shapes}{extra}</link>"
    )


def _shape(geometry: str, *, at: str = "0 0 0", turned: str = "0 0 0") -> str:
    return (
        f'<collision><origin xyz="{at}" rpy="{turned}"/><geometry>{geometry}</geometry></collision>'
    )


def _robot(*parts: str) -> str:
    return f'<robot name="drawn">{"".join(parts)}</robot>\n'


def _box_of(x: float, y: float, z: float) -> str:
    return f'<box size="{x:.6g} {y:.6g} {z:.6g}"/>'


def _joint(kind: str, at: str) -> str:
    limit = '<limit lower="-1" upper="1" effort="10" velocity="10"/>' if kind == "revolute" else ""
    return (
        f'<joint name="joint" type="{kind}"><parent link="base"/><child link="arm"/>'
        f'<origin xyz="{at}"/><axis xyz="0 1 0"/>{limit}</joint>'
    )


def _cube(a: float, m: float) -> str:
    return _robot(_link("base", m, a, _shape(_box_of(a, a, a))))


def _slab(a: float, m: float) -> str:
    return _robot(_link("base", m, a, _shape(_box_of(a, a * 0.7, a * 0.2))))


def _ball(a: float, m: float) -> str:
    return _robot(_link("base", m, a, _shape(f'<sphere radius="{a / 2:.6g}"/>')))


def _rod(a: float, m: float) -> str:
    return _robot(_link("base", m, a, _shape(f'<cylinder radius="{a / 8:.6g}" length="{a:.6g}"/>')))


def _disc(a: float, m: float) -> str:
    return _robot(
        _link("base", m, a, _shape(f'<cylinder radius="{a / 2:.6g}" length="{a / 5:.6g}"/>'))
    )


def _capsule(a: float, m: float) -> str:
    return _robot(_link("base", m, a, _shape(f'<capsule radius="{a / 6:.6g}" length="{a:.6g}"/>')))


def _stack(a: float, m: float) -> str:
    half = f"{a / 4:.6g}"
    shapes = [_shape(_box_of(a, a, a / 2), at=f"0 0 {sign}{half}") for sign in ("", "-")]
    return _robot(_link("base", m, a, "".join(shapes)))


def _mixed(a: float, m: float) -> str:
    ball = _shape(f'<sphere radius="{a / 4:.6g}"/>', at=f"0 0 {a / 2:.6g}")
    return _robot(_link("base", m, a, _shape(_box_of(a, a / 2, a / 2)) + ball))


def _offset_centre(a: float, m: float) -> str:
    shape = _shape(_box_of(a, a, a))
    return _robot(_link("base", m, a, shape, centre=f"{a / 10:.6g} 0 {-a / 5:.6g}"))


def _offset_shape(a: float, m: float) -> str:
    return _robot(_link("base", m, a, _shape(_box_of(a, a, a), at=f"0 0 {a * 0.8:.6g}")))


def _offset_ball(a: float, m: float) -> str:
    shape = _shape(f'<sphere radius="{a / 2:.6g}"/>', at=f"0 0 {a / 5:.6g}")
    return _robot(_link("base", m, a, shape))


def _turned_shape(a: float, m: float) -> str:
    return _robot(_link("base", m, a, _shape(_box_of(a, a, a / 2), turned="0 1.5707963 0")))


def _bouncy(a: float, m: float) -> str:
    contact = '<contact><restitution value="0.9"/><lateral_friction value="0.4"/></contact>'
    return _robot(_link("base", m, a, _shape(_box_of(a, a, a)), extra=contact))


def _two_fixed(a: float, m: float) -> str:
    shape = _shape(_box_of(a, a, a / 2))
    links = _link("base", m, a, shape), _link("arm", m, a, shape)
    return _robot(*links, _joint("fixed", f"0 0 {a / 2:.6g}"))


def _hinged(a: float, m: float) -> str:
    links = (
        _link("base", m, a, _shape(_box_of(a, a / 2, a / 2))),
        _link("arm", m / 3, a, _shape(_box_of(a, a / 4, a / 4)), centre=f"{a / 2:.6g} 0 0"),
    )
    return _robot(*links, _joint("continuous", f"{a / 2:.6g} 0 0"))


def _limited(a: float, m: float) -> str:
    links = (
        _link("base", m, a, _shape(_box_of(a, a, a))),
        _link("arm", m / 2, a, _shape(f'<sphere radius="{a / 4:.6g}"/>'), centre=f"0 0 {a:.6g}"),
    )
    return _robot(*links, _joint("revolute", f"0 0 {a / 2:.6g}"))


def _nothing(a: float, m: float) -> str:
    return _robot(_link("base", m, a, ""))


def _mesh(a: float, m: float) -> str:
    mesh = oracle.data_path("duck_vhacd.obj")
    geometry = f'<mesh filename="{mesh}" scale="{a:.6g} {a:.6g} {a:.6g}"/>'
    return _robot(_link("base", m, a, _shape(geometry, turned="1.5707963 0 0")))


BODIES: tuple[Callable[[float, float], str], ...] = (
    _cube, _cube, _cube, _slab, _ball, _rod, _disc, _capsule, _stack, _mixed, _offset_centre,
    _offset_shape, _offset_ball, _turned_shape, _bouncy, _two_fixed, _hinged, _limited, _nothing,
    _mesh,
)  # fmt: skip


# -- the same scenario, as plain values ------------------------------------------------------------


def drop_of(scenario: Scenario) -> Drop:
    """Convert a scenario for the oracle."""
    drop = _drop({name: getattr(scenario, name) for name in Scenario.options()})
    turned = getattr(scenario, "orientation_xyzw", drop.orientation)
    assert oracle.turn_rad(turned, drop.orientation) < 1e-14
    return replace(drop, orientation=turned)  # the same to the last bit, so that the replay is


def _drop(values: Mapping[str, Any]) -> Drop:
    turned = values.get("orientation") or (0.0, 0.0, 0.0)
    if len(turned) == 3:
        turned = p.getQuaternionFromEuler([math.radians(one) for one in turned])
    timestep_s = values["timestep_s"]
    return Drop(
        body=values["body"],
        height_m=values.get("height_m", 1.0),
        timestep_s=timestep_s,
        steps=round(values["duration_s"] / timestep_s),
        gravity_m_s2=values["gravity_m_s2"] if values["gravity_set"] else None,
        orientation=tuple(turned),
        velocity_m_s=values["velocity_m_s"],
        spin_rad_s=values["spin_rad_s"],
        linear_damping=values["linear_damping"],
        angular_damping=values["angular_damping"],
        mass_kg=values["mass_kg"],
        restitution=values["restitution"],
        friction=values.get("friction"),
        restitution_threshold_m_s=values.get("restitution_threshold_m_s"),
        contact_erp=values["contact_erp"],
        solver_residual=values["solver_residual"],
        solver_iterations=values["solver_iterations"],
        substeps=values.get("substeps"),
        maximal=values["coordinates"] == "maximal",
        stepped=values["stepped"],
        floor=values["floor"],
    )


def command(scenario: Scenario) -> str:
    """Return the command that reproduces a scenario."""
    words = ["drop run"]
    for one in fields(scenario):
        value, option = getattr(scenario, one.name), one.metadata["option"]
        default = one.default if one.default is not MISSING else None
        if value == default:
            continue
        if isinstance(value, bool):
            words.append(option.name)
        else:
            text = ",".join(map(repr, value)) if isinstance(value, tuple) else str(value)
            words.append(f"{option.name}={text}")
    return " ".join(words)


# -- checkers: one for each statement --------------------------------------------------------------


class WrongError(AssertionError):
    """The oracle contradicts a statement."""


@dataclass(frozen=True)
class Said:
    """A statement in the JSON output of an analysis, with the drop that it is about."""

    value: Any
    beside: Mapping[str, Any]
    """The JSON object that contains the value."""
    place: int
    """Index of that object if it is in a list."""
    whole: Mapping[str, Any]
    scenario: Scenario
    truth: Truth

    @property
    def run(self) -> oracle.Replay:
        """The oracle's replay of the drop."""
        return self.truth.run

    @property
    def drop(self) -> Drop:
        """The drop as the oracle's plain values."""
        return self.truth.drop


Checker = Callable[[Said], None]
CHECKERS: dict[str, Checker] = {}


def checks(*statements: str) -> Callable[[Checker], Checker]:
    """Register a checker for statements, by their path in the JSON."""

    def register(checker: Checker) -> Checker:
        CHECKERS.update(dict.fromkeys(statements, checker))
        return checker

    return register


def hold(condition: Any, what: str) -> None:
    """Raise an error unless a condition holds for the oracle."""
    if not condition:
        raise WrongError(what)


def near(said: float, true: float | None, tolerance: float, what: str) -> None:
    """Raise an error unless a number is close to the oracle's."""
    hold(true is not None, f"{what}: said {said!r}, and nothing tells")
    assert true is not None
    hold(
        math.isfinite(true) and abs(said - true) <= tolerance,
        f"{what}: said {said!r}, true {true!r}, off by {said - true:.3g} of {tolerance:.2g}",
    )


def _scale_m(said: Said) -> float:
    """Return the length scale for rounding errors: the body's greatest distance from 0."""
    return float(np.abs(said.run.position_m).max()) + abs(said.drop.height_m) + 1e-3


# scenario and engine: what was asked, and what PyBullet says


def _check_scenario(said: Said, name: str) -> None:
    asked = getattr(said.scenario, name)
    hold(said.value == (list(asked) if isinstance(asked, tuple) else asked), f"asked for {asked!r}")


for _name in Scenario.options():
    CHECKERS[f"scenario.{_name}"] = functools.partial(_check_scenario, name=_name)


@checks("engine.timestep_s")
def _engine_timestep(said: Said) -> None:
    hold(said.value == said.drop.timestep_s, "another timestep")


@checks("engine.substeps")
def _engine_substeps(said: Said) -> None:
    hold(said.value == (said.drop.substeps or 0), "other substeps")


@checks("engine.solver_iterations")
def _engine_iterations(said: Said) -> None:
    hold(said.value == (said.drop.solver_iterations or 50), "other iterations")


@checks("engine.gravity_m_s2")
def _engine_gravity(said: Said) -> None:
    hold(said.value == [0.0, 0.0, said.drop.gravity], "another gravity")


@checks("engine.body_name")
def _engine_name(said: Said) -> None:
    hold(said.value == said.truth.facts.name, f"it is called {said.truth.facts.name}")


@checks("engine.body_type")
def _engine_type(said: Said) -> None:
    kind = "btRigidBody" if said.drop.maximal else "btMultiBody"
    hold(said.value == kind, f"it is a {kind}")


@checks("engine.joints")
def _engine_joints(said: Said) -> None:
    hold(said.value == said.truth.facts.joints, f"it has {said.truth.facts.joints}")


@checks("engine.mass_kg")
def _engine_mass(said: Said) -> None:
    true = said.truth.facts.total_mass_kg
    near(said.value, true, 1e-12 * true, "mass of all links")


@checks("engine.inertia_kg_m2")
def _engine_inertia(said: Said) -> None:
    if not said.truth.facts.is_rigid:
        return  # of several links PyBullet says only each one's own
    for one, true in zip(said.value, said.truth.facts.inertia_kg_m2[0], strict=True):
        near(one, true, 1e-9 * max(said.value), "moment of inertia")


@checks("engine.link_masses_kg")
def _engine_link_masses(said: Said) -> None:
    for one, true in zip(said.value, said.truth.facts.mass_kg, strict=True):
        near(one, true, 1e-12 * true, "mass of a link")


@checks("engine.link_inertias_kg_m2")
def _engine_link_inertias(said: Said) -> None:
    true = [one for each in said.truth.facts.inertia_kg_m2 for one in each]
    hold(np.allclose(said.value, true, rtol=1e-9, atol=0), f"they are {true}")


@checks("engine.recorded_links")
def _engine_recorded_links(said: Said) -> None:
    true = 0 if said.drop.maximal else said.truth.facts.joints
    hold(said.value == true, f"PyBullet tells of {true}")


def _check_friction(said: Said, place: int) -> None:
    near(said.value, said.truth.facts.friction[place], 0.0, "the body's friction")


for _place, _kind in enumerate(("lateral", "rolling", "spinning")):
    CHECKERS[f"engine.{_kind}_friction"] = functools.partial(_check_friction, place=_place)


@checks("engine.floor_lateral_friction")
def _engine_floor_friction(said: Said) -> None:
    near(said.value, said.truth.facts.floor_friction, 0.0, "the floor's friction")


@checks("engine.restitution")
def _engine_restitution(said: Said) -> None:
    near(said.value, said.truth.facts.restitution, 0.0, "the body's restitution")


@checks("engine.floor_restitution")
def _engine_floor_restitution(said: Said) -> None:
    hold(said.drop.floor, "there is no floor")
    near(said.value, said.truth.facts.floor_restitution, 0.0, "the floor's restitution")


@checks("engine.collision_margin_m")
def _engine_margin(said: Said) -> None:
    near(said.value, said.truth.facts.margin_m, 1e-12, "margin")


SHAPES = {2: "sphere", 3: "box", 4: "cylinder", 5: "mesh", 6: "plane", 7: "capsule"}


@checks("engine.shape")
def _engine_shape(said: Said) -> None:
    shapes = said.truth.facts.shapes
    true = SHAPES[shapes[0][0]] if len(shapes) == 1 else "compound" if shapes else "none"
    hold(said.value == true, f"it is {true}")


@checks("engine.shape_position_m")
def _engine_shape_position(said: Said) -> None:
    (where, _) = oracle.shape_pose(said.drop)
    hold(tuple(said.value) == where, f"it is at {where}")


@checks("engine.shape_orientation")
def _engine_shape_orientation(said: Said) -> None:
    (_, turned) = oracle.shape_pose(said.drop)
    hold(tuple(said.value) == turned, f"it is turned by {turned}")


@checks("engine.shape_dimensions_m")
def _engine_shape_numbers(said: Said) -> None:
    shapes = said.truth.facts.shapes
    hold(not said.value or len(shapes) == 1, "one shape's dimensions where there are several")
    if said.value is said.beside.get("shape_dimensions_m") and said.value:
        hold(tuple(said.value) == shapes[0][1], f"it is {shapes[0][1]}")


@checks("engine.reach_m")
def _engine_reach(said: Said) -> None:
    facts = said.truth.facts
    if not (facts.is_rigid and facts.has_shape):  # of links it is that of the base
        return
    upright = oracle.extent_m(said.drop, (0.0, 0.0, 0.0, 1.0))
    hold(said.value >= float(upright.max()) / 2, "half an edge is longer")
    true = said.truth.release_height_m
    hold(true is None or said.value >= abs(true) - 1e-9, "it touches from farther away")
    if said.whole["scenario"]["body"] == "cube_small.urdf":  # centred, without a margin
        near(said.value, float(np.linalg.norm(upright)) / 2, 1e-9, "half the diagonal")


@checks("engine.rest_height_m")
def _engine_rest_height(said: Said) -> None:
    near(said.value, said.truth.release_height_m, 1e-8, "height of touching as released")


@checks(
    "engine.body_sha256",
    "engine.drop_version",
    "engine.machine",
    "engine.numpy_version",
    "engine.pybullet_api",
    "engine.pybullet_build",
    "engine.pybullet_version",
    "engine.pybullet_wheel",
    "engine.python_version",
    "engine.rerun_version",
    "engine.gl_renderer",
    "recording",
    "layer",
    "partial",
)
def _not_of_the_drop(said: Said) -> None:
    """Ignore file and versions, which other tests cover, and which the oracle cannot know."""
    hold(said.value is not True, "a whole recording is said to be partial")


# the air


@checks("at[].time_s")
def _at_time(said: Said) -> None:
    near(said.value, said.beside["step"] * said.drop.timestep_s, 1e-12 * said.value, "time")


@checks("at[].step")
def _at_step(said: Said) -> None:
    hold(0 <= said.value <= said.drop.steps, "no such sample")
    hold(said.value == round(said.beside["time_s"] / said.drop.timestep_s), "of another time")


@checks("at[].phase")
def _at_phase(said: Said) -> None:
    step = said.beside["step"]
    touched = said.truth.touched_steps
    before = not len(touched) or step < touched[0]
    hold((said.value == "falling") == before, f"first contact {touched[:1]}")
    if said.value == "rest":
        _lies_still(said.truth, step)


@checks("at[].simulated_m")
def _at_simulated(said: Said) -> None:
    step = said.beside["step"]
    near(said.value, float(said.run.height_m[step]), 0.0, f"height at {step}")


def _theory_m(said: Said, step: int) -> float:
    """Return the height in free fall, which ends where the body touches the floor."""
    fallen = oracle.free_fall_m(said.drop, step * said.drop.timestep_s)
    held = said.truth.release_height_m if said.drop.floor else None
    return fallen if held is None else max(fallen, held)


@checks("at[].free_fall_m")
def _at_free_fall(said: Said) -> None:
    near(said.value, _theory_m(said, said.beside["step"]), 1e-8 + 1e-14 * _far(said), "free fall")


def _far(said: Said) -> float:
    """Return the distance travelled in free fall [m]."""
    return abs(oracle.free_fall_m(said.drop, said.drop.steps * said.drop.timestep_s)) + 1


@checks("at[].error_m")
def _at_error(said: Said) -> None:
    step = said.beside["step"]
    true = float(said.run.height_m[step]) - _theory_m(said, step)
    near(said.value, true, 1e-8 + 1e-14 * _far(said), "error")


def _covers(said: Said, step: int) -> None:
    """Fail unless a sample is explained by gravity and air damping alone."""
    truth = said.truth
    hold(said.drop.stepped, "nothing was stepped")
    hold(truth.facts.is_rigid, "the body has joints")
    hold(truth.acted_step is None or step < truth.acted_step, f"touched at {truth.acted_step}")
    clamped = truth.clamped_steps
    hold(not len(clamped) or step < clamped[0], f"a velocity was clamped at step {clamped[:1]}")
    held = truth.release_height_m if said.drop.floor else None
    fallen = oracle.free_fall_m(said.drop, step * said.drop.timestep_s)
    hold(step == 0 or held is None or fallen > held - 1e-9, "theory has landed")


@checks("at[].terms_m.timestep")
def _term_timestep(said: Said) -> None:
    moment = said.whole["at"][said.place]
    _covers(said, moment["step"])
    undamped = said.truth.again(linear_damping=0.0, floor=False)
    step = moment["step"]
    if not said.drop.maximal and np.abs(undamped.velocity_m_s[:step]).max(initial=0) > 99:
        return  # without damping it runs into the limit of 100 m/s
    true = float(undamped.height_m[step]) - oracle.free_fall_m(said.drop, moment["time_s"])
    near(
        said.value, true, 1e-13 * _far(said) + 4e-16 * step * max(1.0, said.drop.height_m), "replay"
    )


@checks("at[].terms_m.damping")
def _term_damping(said: Said) -> None:
    moment = said.whole["at"][said.place]
    true = float(oracle.damping_m(said.drop, moment["time_s"])[2])
    near(said.value, true, 1e-9 * abs(true) + 1e-18, "ODE of the drag")


@checks("at[].terms_m.interaction")
def _term_interaction(said: Said) -> None:
    moment, terms = said.whole["at"][said.place], said.beside
    law, clamped = oracle.exact_law_m(said.drop, moment["step"])
    hold(not clamped, "it includes a clamp of the velocity")
    free = oracle.free_fall_m(said.drop, moment["time_s"])
    true = float(law[-1][2]) - free - terms["timestep"] - terms["damping"]
    rounded = 4e-16 * max(1.0, said.drop.height_m)
    slack = 1e-14 * _far(said) + rounded + 1e-9 * abs(terms["damping"])
    near(said.value, true, slack, "what is left")


@checks("at[].terms_m.rounding")
def _term_rounding(said: Said) -> None:
    moment = said.whole["at"][said.place]
    law, _ = oracle.exact_law_m(said.drop, moment["step"])
    true = float(Decimal(moment["simulated_m"]) - law[-1][2])
    near(said.value, true, 1e-3 * abs(true) + 1e-19 * _far(said), "simulated - exact law")
    total = math.fsum(said.beside.values())
    # The error is a difference of two heights, each rounded as a double of its size; free fall is a
    # sum of three parts, in five operations of 2^-53 each. It may end near 0, from kilometres up.
    fallen = abs(said.drop.gravity) * moment["time_s"] / 2 + abs(said.drop.velocity_m_s[2])
    parts_m = abs(said.drop.height_m) + fallen * moment["time_s"] + abs(moment["simulated_m"])
    hold(abs(total - moment["error_m"]) <= 6 * 2**-53 * parts_m, "the terms do not add up")


@checks("coverage.samples")
def _coverage_samples(said: Said) -> None:
    if said.value:
        _covers(said, said.value - 1)


@checks("coverage.of")
def _coverage_of(said: Said) -> None:
    hold(said.value == said.drop.steps + 1, "another number of samples")


@checks("coverage.why")
def _coverage_why(said: Said) -> None:
    why, truth, covered = said.value, said.truth, said.beside["samples"]
    hold(why.isprintable() and "?" not in why, "not a sentence")
    if "step was taken" in why:
        hold(not said.drop.stepped, "it was stepped")
    elif "joint" in why:
        hold(not truth.facts.is_rigid, "it has no joints")
    elif "contact" in why or "touch" in why:
        hold(list(truth.touched_steps[:1]) == [covered], f"{truth.touched_steps[:1]}")
    elif "clamp" in why or "limit" in why:
        hold(list(truth.clamped_steps[:1]) == [covered], f"{truth.clamped_steps[:1]}")
    elif "land" in why or "free fall" in why:
        held = truth.release_height_m
        hold(held is not None, "it has no shape that could land")
        fallen = oracle.free_fall_m(said.drop, covered * said.drop.timestep_s)
        hold(held is not None and fallen <= held + 1e-9, f"free fall is at {fallen}")
    elif "does not follow" in why:
        raise WrongError("this engine made it")
    elif "whole recording" in why:
        hold(covered == said.drop.steps + 1 and truth.acted_step is None, "it is not")
    else:
        raise WrongError(f"no checker for {why!r}")


@checks("airborne.samples")
def _airborne_samples(said: Said) -> None:
    hold(said.value == said.whole["coverage"]["samples"], "not those that are covered")


def _errors_m(said: Said) -> oracle.Float64:
    samples = said.beside["samples"]
    theory = [oracle.free_fall_m(said.drop, n * said.drop.timestep_s) for n in range(samples)]
    return np.asarray(said.run.height_m[:samples] - theory)


@checks("airborne.max_abs_error_m")
def _airborne_max(said: Said) -> None:
    near(said.value, float(np.abs(_errors_m(said)).max()), 1e-13 * _far(said), "largest error")


@checks("airborne.rms_error_m")
def _airborne_rms(said: Said) -> None:
    true = math.sqrt(float(np.mean(_errors_m(said) ** 2)))
    near(said.value, true, 1e-13 * _far(said), "rms error")


@checks("airborne.max_abs_rounding_m")
def _airborne_rounding(said: Said) -> None:
    samples = said.beside["samples"]
    law, _ = oracle.exact_law_m(said.drop, samples - 1)
    heights = map(float, said.run.height_m[:samples])
    true = max(abs(float(Decimal(z) - x[2])) for z, x in zip(heights, law, strict=True))
    near(said.value, true, 1e-3 * true + 1e-19 * _far(said), "largest rounding")


# landing and impact


def _lands_as_released(said: Said) -> float:
    """Return the theoretical landing height; fail if theory does not predict it."""
    truth = said.truth
    held = truth.release_height_m
    hold(said.drop.floor and held is not None, "there is nothing to land on, or with")
    hold(truth.facts.is_rigid, "its links move")
    hold(truth.is_ball or not any(said.drop.spin_rad_s), "it turns on its way")
    assert held is not None
    return held


@checks("landing.time_free_fall_s", "impact.time_free_fall_s")
def _time_free(said: Said) -> None:
    floor_m = _lands_as_released(said)
    true = oracle.falls_to_s(said.drop, floor_m, damped=False, latest_s=2 * said.value + 1)
    near(said.value, true, 1e-7 * (1 + said.value) + _root(said), "free fall")


def _root(said: Said) -> float:
    """Return the time tolerance for a body that starts at the height to reach: √(2 δ / g)."""
    close = abs(said.drop.height_m - (said.truth.release_height_m or 0.0)) < 1e-6
    return 1e-4 if close else 0.0


@checks("landing.time_damped_s", "impact.time_damped_s")
def _time_damped(said: Said) -> None:
    floor_m = _lands_as_released(said)
    true = oracle.falls_to_s(said.drop, floor_m, damped=True, latest_s=2 * said.value + 1)
    near(said.value, true, 1e-6 * (1 + said.value) + _root(said), "ODE of the drag")


@checks("impact.time_simulated_s")
def _time_simulated(said: Said) -> None:
    held = said.truth.release_height_m
    hold(held is not None, "it has no shape")
    assert held is not None
    z, dt = said.run.height_m, said.drop.timestep_s
    crossings = np.flatnonzero((z[:-1] > held) & (z[1:] <= held))
    hold(len(crossings), "it never comes down so far")
    step = int(crossings[0])
    slope = float(z[step] - z[step + 1]) / dt
    near(said.value, step * dt + float(z[step] - held) / slope, 1e-8 / slope + 1e-9, "crossing")
    touched = said.truth.touched_steps
    hold(len(touched), "it never touches")
    if max(1, said.drop.substeps or 1) == 1:
        turned = said.truth.is_ball or said.truth.tilted_rad(step) <= UNTURNED_RAD
        hold(turned, f"it is turned by {said.truth.tilted_rad(step):.3g} rad")


@checks("impact.step")
def _impact_step(said: Said) -> None:
    touched = said.truth.touched_steps
    hold(list(touched[:1]) == [said.value], f"first contact at {touched[:1]}")
    acted = said.truth.acted_step
    hold(acted is None or acted >= said.value, f"the floor acts at {acted}")


@checks("impact.speed_m_s")
def _impact_speed(said: Said) -> None:
    before = max(said.beside["step"] - 1, 0)
    true = float(np.linalg.norm(said.run.velocity_m_s[before]))
    near(said.value, true, 1e-12 * true, "|v| of the sample before")


@checks("tumbles")
def _tumbles(said: Said) -> None:
    since = said.whole["tumbled_step"]
    if since is None:
        hold(not said.value, "it never is tilted")
        return
    how = said.truth.lean_rad if said.whole["engine"]["shape"] == "box" else said.truth.tilted_rad
    tilts = [how(step) for step in range(since, said.drop.steps + 1)]
    hold(said.value == (max(tilts) - min(tilts) > UNTURNED_RAD), "its tilt says otherwise")


@checks("tumbled_step")
def _tumbled_step(said: Said) -> None:
    hold(said.truth.facts.is_rigid, "its links touch too")
    hold(said.value >= said.truth.touching_steps[0], "it has not touched yet")
    # A tilt that grows slowly is near the bound for some samples.
    earliest, latest = (said.truth.tumbles_at(x * UNTURNED_RAD) for x in (0.999, 1.001))
    hold(earliest <= said.value <= latest, f"true {earliest} to {latest}")


@checks("impact.lowest_m")
def _impact_lowest(said: Said) -> None:
    near(said.value, float(said.run.height_m.min()), 0.0, "lowest")


@checks("impact.lowest_step")
def _impact_lowest_step(said: Said) -> None:
    hold(said.value == int(said.run.height_m.argmin()), f"it is {said.run.height_m.argmin()}")


@checks("impact.penetration_m")
def _impact_penetration(said: Said) -> None:
    step = said.beside["lowest_step"]
    depth = said.truth.depth_m(step)
    hold(depth is not None, "links move, or there is no shape")
    assert depth is not None
    beside = float(np.abs(said.run.position_m[step, :2]).max()) > EDGE_M
    hold(not beside, "it is beside the floor")
    near(said.value, max(0.0, depth), _tilt_m(said, step), "depth of its lowest point")


def _tilt_m(said: Said, step: int) -> float:
    """Return how far a tilt that counts as none raises the centre [m], plus rounding."""
    if said.truth.is_ball:
        return 1e-8
    # A turn by θ moves a point by θ times its distance from the centre, which is not in the middle.
    tilt_rad = min(said.truth.tilted_rad(step), UNTURNED_RAD)
    return oracle.reach_m(said.drop) * tilt_rad + 1e-8


# contact and bounces


@checks("contact.max_deviation_m")
def _contact_deviation(said: Said) -> None:
    converged = said.truth.converged().height_m
    step = said.beside["deviation_step"]
    apart = np.abs(said.run.height_m - converged)
    scale = 1e-9 + 1e-5 * float(apart.max())
    near(said.value, float(apart[step]), scale, f"converged replay at {step}")
    until = said.truth.tumbles_at(0.999 * UNTURNED_RAD)
    hold(float(apart[:until].max()) <= said.value + scale, f"{apart[:until].max()} elsewhere")


@checks("contact.deviation_step")
def _contact_step(said: Said) -> None:
    hold(0 <= said.value < _tumbles_at(said.truth), "it tumbles by then")
    converged = float(said.truth.converged().height_m[said.value])
    apart = abs(float(said.run.height_m[said.value]) - converged)
    near(apart, said.beside["max_deviation_m"], 1e-9 + 1e-5 * apart, "converged replay there")


def _tumbles_at(truth: Truth) -> int:
    return truth.tumbles_at(1.001 * UNTURNED_RAD)


def _rebound(said: Said) -> Rebound:
    """Return the oracle's contact for a bounce."""
    step = said.beside["step"]
    hold(said.truth.facts.is_rigid, "its links touch too")
    found = said.truth.contact_after(step)
    hold(found is not None, f"no contact begins after sample {step}, or it does not end")
    assert found is not None
    return found


@checks("bounces[].step")
def _bounce_step(said: Said) -> None:
    found = _rebound(said)
    depth = said.truth.depth_m(0)
    hold(found.step > 0 or (depth is not None and depth <= 0), "it was released inside the floor")
    hold(said.run.velocity_m_s[found.end - 1, 2] > 0, "it does not rise after it")


@checks("bounces[].approach_m_s")
def _bounce_approach(said: Said) -> None:
    step = _rebound(said).step
    alone = said.truth.from_sample(step, 1, floor=False, maximal=said.drop.maximal)
    down = sorted((-float(alone.velocity_m_s[0, 2]), -float(alone.velocity_m_s[1, 2])))
    slack = 1e-9 * (1 + abs(down[1]))
    # In maximal coordinates restitution sees the damping of this step, and not its gravity.
    down[0] *= 1 - said.drop.damping * said.drop.timestep_s * (1 + abs(down[0]))
    hold(down[0] - slack <= said.value <= down[1] + slack, f"said {said.value}, true {down}")


@checks("bounces[].rebound_m_s")
def _bounce_rebound(said: Said) -> None:
    found = _rebound(said)
    true = said.run.velocity_m_s[found.step + 1 : found.end, 2]
    hold(any(abs(said.value - one) <= 1e-12 * (1 + abs(one)) for one in true), f"{true[-3:]}")
    hold(said.value >= true[-1] - 1e-12, f"it leaves at {true[-1]}")


@checks("bounces[].effective_restitution")
def _bounce_restitution(said: Said) -> None:
    true = said.beside["rebound_m_s"] / said.beside["approach_m_s"]
    near(said.value, true, 1e-12 * true, "rebound over approach")
    hold(0 <= said.value <= 30, "no restitution of a flat contact")
    hold(said.beside["step"] < _tumbles_at(said.truth), "it tumbles")


@checks("bounces[].apex_m")
def _bounce_apex(said: Said) -> None:
    found, held = _rebound(said), said.truth.release_height_m
    hold(held is not None, "it has no shape")
    true = said.truth.apex_m(found) - (held or 0.0)
    near(said.value, true, 1e-8, "highest until the next contact")


@checks("bounces[].predicted_apex_m")
def _bounce_predicted(said: Said) -> None:
    drop, held = said.drop, said.truth.release_height_m
    assert held is not None
    asked = said.truth.facts.pair_restitution
    fallen = drop.height_m - held + drop.velocity_m_s[2] ** 2 / (-2 * drop.gravity)
    near(said.value, asked ** (2 * said.place + 2) * fallen, 1e-7 * (1 + fallen), "e^2k h")
    hold(said.beside["step"] < _tumbles_at(said.truth), "it tumbles")
    earlier = [one["step"] for one in said.whole["bounces"][: said.place + 1]]
    hold(earlier == sorted(set(earlier)), "not in order")


@checks("bounces[].uncorrected_apex_m")
def _bounce_uncorrected(said: Said) -> None:
    plain = Truth(
        replace(said.drop, contact_erp=0.0, solver_residual=0.0, solver_iterations=oracle.CONVERGED)
    )
    held = said.truth.release_height_m
    hold(len(plain.rebounds) > said.place and held is not None, "the replay has fewer bounces")
    assert held is not None
    true = plain.apex_m(plain.rebounds[said.place]) - held
    near(said.value, true, 1e-6 * (1 + said.value), "replay without ERP")


@checks("bounces[].correction_m_s")
def _bounce_correction(said: Said) -> None:
    found = _rebound(said)
    hold(found.step < _tumbles_at(said.truth), "it tumbles")
    steps = found.end - found.step
    same, plain = (
        float(said.truth.from_sample(found.step, steps, **how).velocity_m_s[1:, 2].max())
        for how in (CONVERGED, CONVERGED | {"contact_erp": 0.0})
    )
    # The contact law gave the rebounds of 500 bounces to 1.2e-4 (`tests/test_contact_law.py`).
    slack = 2e-4 * said.beside["approach_m_s"]
    near(said.value, same - plain, slack, "replay of the contact without ERP")


# rest


def _lies_still(truth: Truth, since: int) -> None:
    """Fail unless position and orientation are constant from a sample on, and stay so."""
    hold(len(truth.run.touches[-1]) > 0, "it does not touch at the end")
    hold(truth.stays(since, 3e-5, 3e-3), "position or orientation go on changing")


@checks("rest.height_m")
def _rest_height(said: Said) -> None:
    near(said.value, float(said.run.height_m[-1]), 0.0, "last height")


@checks("rest.expected_m")
def _rest_expected(said: Said) -> None:
    hold(said.truth.facts.is_rigid, "its links touch too")
    last = said.run.orientation[-1]
    true = oracle.touching_height(said.drop, last)
    near(said.value, true, _rest_tilt_m(said), "height at which it touches as it lies")


def _rest_tilt_m(said: Said) -> float:
    """Return how far a tilt that still counts as lying flat raises the centre [m]."""
    if said.truth.is_ball:
        return 1e-8
    lean = said.truth.lean_rad(said.truth.last)
    lean = min(lean, said.truth.tilted_rad(said.truth.last), LYING_RAD)
    return oracle.reach_m(said.drop) * lean + 1e-8


@checks("rest.error_m")
def _rest_error(said: Said) -> None:
    true = said.beside["height_m"] - said.beside["expected_m"]
    near(said.value, true, 1e-12, "height - expected")


@checks("rest.settled_step")
def _rest_settled(said: Said) -> None:
    hold(0 <= said.value <= said.drop.steps, "no such sample")
    _lies_still(said.truth, said.value)
    if said.value > 0 and said.value - 1 in said.truth.touched_steps:
        state = said.run.state
        moved = float(np.linalg.norm(state[said.value - 1, :3] - state[-1, :3]))
        turned = oracle.turn_rad(state[said.value - 1, 3:7], state[-1, 3:7])
        hold(moved > 0.99e-5 or turned > 0.99e-3, "it rests already before")


@checks("rest.terms_m.slop")
def _rest_slop(said: Said) -> None:
    near(said.value, -SLOP_M, 0.0, "Bullet's slop")
    settled = oracle.replay(_settled(said))
    # Twice the slop, not none: a body that rests on the floor to the last bit is above it by
    # rounding now and then, and then it falls for a whole step.
    twice = oracle.replay(replace(_settled(said), contact_slop_m=2 * SLOP_M))
    true = float(twice.height_m[-1] - settled.height_m[-1])
    near(said.value, true, 2e-7, "replay with twice the slop")


def _settled(said: Said) -> Drop:
    """Return the drop with a converging solver, extended until it has settled."""
    return replace(
        said.drop,
        solver_residual=0.0,
        solver_iterations=oracle.CONVERGED,
        steps=said.drop.steps + 400,
    )


@checks("rest.terms_m.solver")
def _rest_solver(said: Said) -> None:
    converged = float(said.truth.converged().height_m[-1])
    near(said.value, said.whole["rest"]["height_m"] - converged, 1e-9, "converged replay")


@checks("rest.terms_m.settling")
def _rest_settling(said: Said) -> None:
    now = float(said.truth.converged().height_m[-1])
    settled = float(oracle.replay(_settled(said)).height_m[-1])
    near(said.value, now - settled, 2e-7, "replay for longer")
    rest = said.whole["rest"]
    total = math.fsum(said.beside.values())
    hold(abs(total - rest["error_m"]) <= 1e-12, "the terms do not add up")


# energy


@checks("conservation.energy_initial_j")
def _energy_initial(said: Said) -> None:
    energies = said.run.energy_j
    near(said.value, float(energies[0]), 1e-9 * _joules(said), "energy of all links")


def _joules(said: Said) -> float:
    run = said.run
    parts = (run.kinetic_linear_j, run.kinetic_angular_j, np.abs(run.potential_j))
    return float(max(one.max() for one in parts)) + 1e-300


@checks("conservation.energy_max_rel_drift")
def _energy_drift(said: Said) -> None:
    energies = said.run.energy_j
    free = energies[_untouched(said)]
    true = float(np.abs(free - free[0]).max() / abs(free[0]))
    near(said.value, true, 1e-6 * true + 1e-9 * _joules(said) / abs(free[0]), "energy drift")


def _untouched(said: Said) -> Any:
    """Return whether a sample is before the first contact."""
    touched = said.truth.touched_steps
    return np.arange(said.drop.steps + 1) < (touched[0] if len(touched) else math.inf)


@checks("conservation.angular_momentum_max_rel_drift")
def _momentum_drift(said: Said) -> None:
    free = said.run.angular_momentum_kg_m2_s[_untouched(said)]
    start = float(np.linalg.norm(free[0]))
    fastest = float(np.linalg.norm(said.run.links[0, :, 7:10], axis=1).max())
    noise = 1e-13 * said.truth.facts.total_mass_kg * fastest  # per metre that links are apart
    hold(start > noise, "it has none to begin with")
    true = float(np.linalg.norm(free - free[0], axis=1).max()) / start
    near(said.value, true, 1e-6 * true + 1e-9, "angular momentum drift")


@checks("left_out")
def _left_out(said: Said) -> None:
    hold(said.value == 0, "findings that nobody chose to leave out")


@checks("bodies")
def _bodies(said: Said) -> None:
    """Check the falling body's energy and momentum, and that their causes add up."""
    body, run = said.value[0], said.run
    hold(body["segments"] == said.whole["segments"], "other segments than the drop's")
    hold(body["energy"] is not None or not (said.drop.stepped and _has_sum(said)), "no energy")
    if body["energy"] is None:
        return
    energy, momentum, slack = body["energy"], body["momentum"], 1e-9 * _joules(said)
    near(energy["start_j"], float(run.energy_j[0]), slack, "energy of all links")
    # Contacts of links are not the same to the bit in every process: PyBullet reads memory there.
    last = slack if said.truth.facts.is_rigid else 1e-2 * _joules(said)
    near(energy["end_j"], float(run.energy_j[-1]), last, "energy of all links")
    causes, change_j = energy["by_cause_j"], energy["end_j"] - energy["start_j"]
    near(math.fsum(causes.values()), change_j, slack, "all causes together")
    if body["segments"]["unexplained"] == 0:
        hold(abs(causes["remainder"]) <= slack, "there is a remainder")
    if not len(said.truth.touched_steps):
        hold(causes["contacts"] == 0, "contact took energy, and there was none")
    if not len(said.truth.clamped_steps):
        hold(abs(causes["clamp"]) <= slack, "a limit took energy, and nothing was clamped")
    changes = np.subtract(momentum["end_kg_m_s"], momentum["start_kg_m_s"])
    booked = np.sum([*momentum["by_cause_kg_m_s"].values()], axis=0)
    size = float(np.abs([*momentum["by_cause_kg_m_s"].values()]).max())
    rounded = 1e-9 * size + 1e-15 * float(np.abs(momentum["start_kg_m_s"]).max())
    hold(float(np.abs(booked - changes).max()) <= rounded, "momentum is not all booked")
    if said.truth.facts.is_rigid and said.drop.stepped:
        fell = said.truth.facts.mass_kg[0] * said.drop.gravity * said.drop.timestep_s
        near(
            momentum["by_cause_kg_m_s"]["gravity"][2], fell * said.drop.steps, 1e-9 * size, "m g t"
        )


def _has_sum(said: Said) -> bool:
    return not said.drop.maximal and max(1, said.drop.substeps or 1) == 1


# findings: each by what it means


def message_numbers(message: str) -> list[float]:
    """Return the numbers in a message, in order."""
    return [float(one.replace("\u2212", "-")) for one in re.findall(NUMBER, message)]


NUMBER = r"(?<![\w.])[-+\u2212]?\d+(?:\.\d+)?(?:e[-+]?\d+)?"

FINDINGS: dict[str, Callable[[Said, str], None]] = {}


def finds(code: str) -> Callable[[Callable[[Said, str], None]], Callable[[Said, str], None]]:
    """Register the checker of a finding."""

    def register(checker: Callable[[Said, str], None]) -> Callable[[Said, str], None]:
        FINDINGS[code] = checker
        return checker

    return register


def read(pattern: str, message: str) -> list[float]:
    """Parse the numbers in a message that match a pattern's groups."""
    found = re.search(pattern, message)
    hold(found, f"no checker for the message {message!r}")
    assert found is not None
    return [float(one) for one in found.groups()]


F = r"([-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?)"


@finds("no-gravity")
def _find_no_gravity(said: Said, message: str) -> None:
    hold(not said.scenario.gravity_set, "gravity was set")
    (end_m,) = read(f"at {F} m at the end", message)
    near(end_m, float(said.run.height_m[-1]), 6e-5, "height at the end")


@finds("not-stepped")
def _find_not_stepped(said: Said, _: str) -> None:
    hold(not said.drop.stepped and not np.ptp(said.run.state, axis=0).any(), "it was")


@finds("no-floor")
def _find_no_floor(said: Said, message: str) -> None:
    hold(not said.drop.floor, "there is a floor")
    held = said.truth.release_height_m
    hold(held is not None, "without a shape a floor would not hold it")
    lowest = float(said.run.height_m.min())
    if said.truth.is_ball or not said.run.spin_rad_s.any():
        hold(lowest < (held or 0.0), "it never came down so far")
    (said_m,) = read(f"to {F} m", message)
    near(said_m, lowest, 6e-5, "lowest")


@finds("tunnelled")
def _find_tunnelled(said: Said, message: str) -> None:
    touched = len(said.truth.touched_steps) > 0
    hold(said.drop.floor and not (touched and said.run.height_m[-1] >= 0), "it came back")
    (step,) = read(f"step {F}", message)
    hold(not (said.truth.touched_steps <= step).any(), "it touched before")
    if said.truth.facts.has_shape:
        top_m = float(np.linalg.norm(oracle.extent_m(said.drop, said.drop.orientation)))
        depth_m = said.truth.depth_m(int(step))
        hold(depth_m is None or depth_m > top_m / 2, "it is not below the floor")


@finds("law-mismatch")
def _find_mismatch(_: Said, message: str) -> None:
    raise WrongError(f"this engine made it: {message}")


@finds("default-damping")
def _find_default_damping(said: Said, message: str) -> None:
    moved_mm, time_s = read(f"by {F} mm at {F} s", message)
    step = round(time_s / said.drop.timestep_s)
    hold(said.truth.acted_step is None or step < said.truth.acted_step, "it touched before")
    other = said.truth.again(linear_damping=0.0, floor=False)
    true_mm = 1e3 * float(said.run.height_m[step] - other.height_m[step])
    # Two decimals, or six digits of a large one.
    near(moved_mm, true_mm, 0.0051 + 1e-5 * abs(true_mm), "replay without damping")
    if "hides" in message:
        error_mm, limit_mm = read(f"lead from {F} to {F} mm", message)
        exact_s = step * said.drop.timestep_s
        error = 1e3 * float(said.run.height_m[step] - oracle.free_fall_m(said.drop, exact_s))
        limit = 1e3 * float(oracle.damping_m(said.drop, exact_s)[2])
        near(error_mm, error, 0.0051 + 1e-5 * abs(error), "error")
        near(limit_mm, limit, 0.0051 + 1e-5 * abs(limit), "its limit")


@finds("velocity-clamped")
def _find_clamped(said: Said, message: str) -> None:
    clamped = said.truth.clamped_steps
    hold(len(clamped), "nothing was clamped")
    (time_s,) = read(f"at {F} s", message)
    near(time_s, float(clamped[0]) * said.drop.timestep_s, 1e-3 * time_s + 1e-9, "first clamp")


@finds("deep-penetration")
def _find_deep(said: Said, message: str) -> None:
    depth_mm, percent = read(f"sinks {F} mm into the floor, {F}%", message)
    depths = [said.truth.depth_m(step) for step in (int(said.run.height_m.argmin()),)]
    hold(depths[0] is not None, "nothing tells how deep")
    assert depths[0] is not None
    slack = 0.051 + 1e3 * _tilt_m(said, int(said.run.height_m.argmin()))
    near(depth_mm, 1e3 * depths[0], slack, "depth")
    height_mm = 1e3 * float(oracle.extent_m(said.drop, said.drop.orientation)[2])
    if height_mm < 10:  # of so small a body the bounding box is mostly margin
        return
    engine = said.whole["engine"]
    centred = engine["shape_position_m"] == (0.0, 0.0, 0.0)
    margin_mm = 1e-6 if centred and engine["shape"] in ("box", "sphere") else 4.0
    share = 100 * depths[0] * 1e3 / np.array((height_mm, height_mm - margin_mm))
    hold(min(share) - 1.0 <= percent <= max(share) + 1.0, f"{share} % of its height")


@finds("restitution-inflated")
def _find_inflated(said: Said, message: str) -> None:
    number, found, asked = read(f"bounce {F} has a restitution of {F} where {F}", message)
    (added,) = read(f"adds {F} m/s", message)
    near(asked, said.truth.facts.pair_restitution, 1e-5, "restitution asked for")
    bounce = said.whole["bounces"][int(number) - 1]
    near(found, bounce["effective_restitution"], 6e-5, "effective restitution")
    hold(found > asked, "it is not inflated")
    near(added, bounce["correction_m_s"], 6e-4, "what the bounce says")
    of_bounce = replace(said, beside=bounce, value=bounce["correction_m_s"])
    CHECKERS["bounces[].correction_m_s"](of_bounce)


@finds("bounce-swallowed")
def _find_swallowed(said: Said, message: str) -> None:
    hold(said.truth.facts.pair_restitution > 0, "no restitution was asked for")
    arrives = next((float(one) for one in re.findall(rf"{F} m/s and stays", message)), math.nan)
    given = said.drop.restitution_threshold_m_s
    threshold = 0.2 if given is None else given
    hold(arrives < threshold + 1e-3, f"{arrives} m/s is no swallowed bounce, at {threshold} m/s")
    touched = said.truth.touched_steps
    starts = [int(one) for one in touched if one - 1 not in touched]
    hold(starts and touched[-1] == said.drop.steps, "it is in the air at the end")
    before = max(0, starts[-1] - 1)
    alone = said.truth.from_sample(before, 1, floor=False)
    speeds = [-float(one) for one in alone.velocity_m_s[:2, 2]]
    hold(
        min(speeds) - 6e-4 <= arrives <= max(speeds) + 6e-4,
        f"said {arrives} m/s, arrives last at {speeds} m/s",
    )
    lower = said.truth.from_sample(
        before, said.drop.steps - before + 50, restitution_threshold_m_s=0.0, contact_erp=0.0
    )
    same = said.truth.from_sample(before, said.drop.steps - before + 50, contact_erp=0.0)
    hold(
        lower.velocity_m_s[:, 2].max() > same.velocity_m_s[:, 2].max() + 1e-6,
        "with a lower threshold it does not bounce either",
    )


@finds("rest-below-expected")
def _find_rest_below(said: Said, message: str) -> None:
    low_um, expected_m = read(f"lies {F} µm lower than {F} m", message)
    true = oracle.touching_height(said.drop, said.run.orientation[-1])
    hold(true is not None, "nothing tells")
    assert true is not None
    printed_m = 5e-6 * abs(true)  # six digits; a shape above its centre is touched at z < 0
    near(expected_m, true, printed_m + _rest_tilt_m(said), "height at which it touches")
    slack = 0.0051 + 1e6 * _rest_tilt_m(said)
    near(low_um, 1e6 * (true - float(said.run.height_m[-1])), slack, "how much lower")
    residual = said.drop.solver_residual
    if (residual is None or residual > 0) and "solver" in message and said.drop.contact_erp != 0:
        settled = float(oracle.replay(_settled(said)).height_m[-1])
        near(settled, true - SLOP_M, 1e-6 + _rest_tilt_m(said), "a converged solver's rest")


@finds("still-airborne")
def _find_airborne(said: Said, message: str) -> None:
    hold(said.drop.floor and said.drop.gravity < 0, "nothing pulls it to a floor")
    hold(not len(said.truth.touched_steps), "it touched")
    hold(said.truth.facts.has_shape, "nothing of it can land")
    depth = said.truth.depth_m(said.drop.steps)
    hold(depth is None or depth <= 0, f"its lowest point is {depth} m below the floor")
    hold(depth is not None or said.run.height_m[-1] > 0, "its centre is below the floor")
    hold(float(np.abs(said.run.position_m[-1, :2]).max()) < EDGE_M, "it is beside the floor")
    (end_m,) = read(f"at {F} m: ", message)
    near(end_m, float(said.run.height_m[-1]), 6e-5, "height at the end")


@finds("starts-in-contact")
def _find_starts(said: Said, _: str) -> None:
    held = said.truth.release_height_m
    hold(held is not None and said.drop.height_m <= held + 1e-9, "it starts above the floor")


@finds("tumbled")
def _find_tumbled(said: Said, message: str) -> None:
    hold(said.truth.facts.is_rigid, "its links touch too")
    first = said.whole["tumbled_step"]
    hold(first <= said.drop.steps, "it is flat whenever it touches")
    times = [one for one in message_numbers(message) if one >= 0]
    true_s = first * said.drop.timestep_s
    hold(any(abs(one - true_s) <= 1e-3 * true_s + 1e-6 for one in times), f"from {true_s} s on")


@checks("findings[].code")
def _finding(said: Said) -> None:
    checker = FINDINGS.get(said.value)
    hold(checker is not None, f"no checker for the finding {said.value}")
    assert checker is not None
    checker(said, said.beside["message"])


@checks("findings[].level", "findings[].bodies", "findings[].share", "findings[].effect")
def _finding_ranks(said: Said) -> None:
    finding = said.beside
    hold(finding["level"] in LEVELS and finding["bodies"] == 1, "no level, or several bodies")
    effect, reach_m = finding["effect"], said.whole["engine"]["reach_m"]
    true = 0.0 if effect is None else effect["value"] / reach_m
    near(finding["share"], true, 1e-9 * true, "the effect over the body's size")


@checks("findings[].steps")
def _finding_steps(said: Said) -> None:
    hold(0 <= said.value["first"] <= said.value["last"] <= said.drop.steps, "beyond the recording")


@checks("findings[].message", "findings[].advice")
def _finding_message(said: Said) -> None:
    """Check that the text is not empty; its content is checked by the finding's code."""
    hold(said.value.strip() and "nan" not in said.value.split(), "an empty message")


@checks("findings[].proposed")
def _finding_proposed(said: Said) -> None:
    """Check that the cause is certain: a drop's findings follow from theory and the scenario."""
    hold(said.value is False, "a proposal")


@checks("findings[].episodes")
def _finding_episodes(said: Said) -> None:
    """Check that a drop is a single episode."""
    hold(said.value == 1, "another number of episodes")


@checks("findings[].proof")
def _finding_proof(said: Said) -> None:
    """Check that a drop's findings are proved: by theory, or by the scenario."""
    hold(said.value in ("sum", "call"), "another proof")


@checks(*(f"findings[].cure.{name}" for name in ("name", "target", "value", "call")))
def _finding_cure(said: Said) -> None:
    """Check that the cure is an option of the scenario, with the cure's value."""
    cure = said.beside
    if cure["name"] == "timestep":
        option, given = cure["call"].split()
        hold((option, cure["target"]) == ("--timestep", None), "another option")
        true = said.drop.timestep_s / cure["value"]
        per_s = 1 / float(Fraction(given))  # the next whole number of steps a second
        hold(-1e-5 < per_s - 1 / true < 1, "a timestep so many times shorter")
        return
    true = {
        "damping": ("box", 0.0, "--linear-damping 0"),
        "gravity": (None, said.scenario.gravity_m_s2, "omit --no-gravity"),
    }[cure["name"]]
    hold((cure["target"], cure["value"], cure["call"]) == true, "another option")


# segments: what the step was that led to each sample; flights: each as a drop of its own


def _uncovered(said: Said, step: int) -> str | None:
    """Return the reason why a contact step is not fully reported; None if it is."""
    if not said.truth.facts.is_rigid:
        return "joint"
    if max(1, said.drop.substeps or 1) > 1:
        acted = said.truth.acted_step
        return "substeps" if acted is not None and step >= acted else None
    if step not in said.truth.pushed_steps:
        return None
    if any(said.truth.facts.friction[1:]):
        return "rolling"
    # Until its first step a btRigidBody is pushed with the inertia that it was loaded with.
    stale = said.drop.orientation != oracle.AS_LOADED or said.drop.mass_kg is not None
    return "first step" if said.drop.maximal and step == 1 and stale else None


@checks("segments.flight")
def _segment_flight(said: Said) -> None:
    steps, truth = said.drop.steps, said.truth
    value = said.value + said.beside["still"]  # without gravity a body may hang there
    if not said.drop.stepped:
        hold(said.value == 0, "nothing flies")
    elif not truth.facts.is_rigid:
        hold(said.value <= steps, "more than there are")
    elif max(1, said.drop.substeps or 1) == 1:
        pushed = len(truth.pushed_steps)
        hold(said.value <= steps - pushed, f"{pushed} pushed")
        # A contact may hold it still, too; unreported friction acts where no force is reported.
        hold(value >= steps - pushed or any(truth.facts.friction[1:]), f"{pushed} pushed")
    else:
        alone = steps if truth.acted_step is None else truth.acted_step - 1
        hold(alone <= value <= steps - len(truth.pushed_steps), f"{alone} before a contact")


@checks("segments.contact")
def _segment_contact(said: Said) -> None:
    truth = said.truth
    covered = [] if not said.drop.stepped else truth.pushed_steps
    known = [one for one in covered if _uncovered(said, int(one)) is None]
    # Where friction that is not reported does nothing in a step, that one balances all the same.
    most = len(covered)
    if len(known) < most:  # points that exert nothing but unreported friction count, too
        most = max(most, len(truth.touched_steps))
    if truth.facts.is_rigid:
        least = len(known) - said.beside["still"]
        hold(least <= said.value <= most, f"{said.value}: {least} of {most}")


@checks("segments.unexplained")
def _segment_unexplained(said: Said) -> None:
    hold(sum(said.beside.values()) == said.drop.steps + 1, "they are not all samples")
    if said.value:
        steps = range(1, said.drop.steps + 1)
        hold(sum(_uncovered(said, one) is not None for one in steps) >= said.value, "covered")


@checks("segments.pushed")
def _segment_pushed(said: Said) -> None:
    hold(said.value == 0, "nobody pushes")


@checks("segments.set")
def _segment_set(said: Said) -> None:
    hold(said.value == said.drop.stepped, "it is released once")


@checks("segments.driven", "segments.constrained")
def _segment_of_joints(said: Said) -> None:
    hold(said.value == 0 or not said.truth.facts.is_rigid, "it has no joints")


@checks("segments.still")
def _segment_still(said: Said) -> None:
    if not said.drop.stepped:
        hold(said.value == said.drop.steps + 1, "no step was taken")
        return
    links = said.run.links.reshape(said.drop.steps + 1, -1)
    same = int((links[1:] == links[:-1]).all(axis=1).sum())
    hold(said.value <= same, f"{same} steps change nothing")


@checks("kind")
def _of_drop(said: Said) -> None:
    hold(said.value == "drop", "it is a drop")


@checks("samples")
def _samples(said: Said) -> None:
    hold(said.value == said.drop.steps + 1, "one more than steps")


@checks("explained.remainder")
def _explained_remainder(said: Said) -> None:
    # Of several substeps the engine reports the last one's forces: as if all had them, to 1e-6.
    most = 1e-9 if max(1, said.drop.substeps or 1) == 1 else 1e-6
    hold(0 <= said.value < most, "a remainder that is no rounding is explained")


@checks("explained.samples")
def _explained_samples(said: Said) -> None:
    counts = said.whole["segments"]
    named = sum(counts.values()) - counts["unexplained"]
    hold(said.value == named, "not those of the segments")


@checks("explained.of")
def _explained_of(said: Said) -> None:
    hold(said.value == said.drop.steps + 1, "another number of samples")


@checks("explained.until_s")
def _explained_until(said: Said) -> None:
    until = round(said.value / said.drop.timestep_s)
    near(said.value, until * said.drop.timestep_s, 1e-12 * said.value, "no sample's time")
    if said.beside["why"] is None:
        hold(until == said.drop.steps, "it does not last")
    else:
        hold(_uncovered(said, until + 1) is not None, "the next sample is covered")
        steps = range(1, until + 1)
        # Of several substeps a tree may be explained, where they are known.
        never = ("first step",) if max(1, said.drop.substeps or 1) > 1 else ("joint", "first step")
        surely = [one for one in steps if _uncovered(said, one) in never]
        hold(not surely, f"sample {surely[:1]} is not")


@checks("explained.why")
def _explained_why(said: Said) -> None:
    step = round(said.beside["until_s"] / said.drop.timestep_s) + 1
    hold(read(r"at sample (\d+) ", said.value) == [step], f"it ends at {step}")
    why = _uncovered(said, step)
    hold(why is not None, "it is covered")
    hold(("substeps" if why == "substeps" else "does not add up") in said.value, f"{why}")


def _flight_of(said: Said) -> tuple[Mapping[str, Any], Drop]:
    """Return a flight, and the drop that starts from its first state."""
    flight = said.whole["flights"][said.place]
    first, run = flight["first_step"], said.run
    begins = {"height_m": float(run.height_m[first]), "velocity_m_s": _of(run.velocity_m_s[first])}
    return flight, replace(said.drop, **begins)


def _of(values: oracle.Float64) -> oracle.Vector:
    x, y, z = values.tolist()
    return x, y, z


@checks("flights[].first_step", "flights[].last_step")
def _flight_steps(said: Said) -> None:
    first, last = said.beside["first_step"], said.beside["last_step"]
    hold(0 <= first < last <= said.drop.steps, "no way in time")
    pushed = {*map(int, said.truth.pushed_steps)}
    hold(not pushed & set(range(first + 1, last + 1)), "it was pushed on the way")
    if max(1, said.drop.substeps or 1) == 1:
        hold(first == 0 or first in pushed or _hangs(said, first), "it flew before")
        on = last < said.drop.steps and last + 1 not in pushed
        hold(not on or _hangs(said, last + 1), "it flies on")


def _hangs(said: Said, step: int) -> bool:
    """Return whether a step changed nothing: without gravity a body may hang in the air."""
    links = said.run.links
    return bool((links[step] == links[step - 1]).all())


@checks("flights[].start_s")
def _flight_start(said: Said) -> None:
    near(said.value, said.beside["first_step"] * said.drop.timestep_s, 1e-12 * said.value, "time")


@checks("flights[].end_s")
def _flight_end(said: Said) -> None:
    near(said.value, said.beside["last_step"] * said.drop.timestep_s, 1e-12 * said.value, "time")


@checks("flights[].error_m")
def _flight_error(said: Said) -> None:
    flight, drop = _flight_of(said)
    first, last = flight["first_step"], flight["last_step"]
    time_s = (last - first) * drop.timestep_s
    free_m = said.run.position_m[first] + np.array(drop.velocity_m_s) * time_s
    free_m[2] = oracle.free_fall_m(drop, time_s)
    for value, true in zip(said.value, said.run.position_m[last] - free_m, strict=True):
        near(value, float(true), 1e-14 * _flown_m(said), "error")


def _flown_m(said: Said) -> float:
    """Return the length scale for rounding errors in a flight, including theory's."""
    flight, drop = _flight_of(said)
    time_s = flight["end_s"] - flight["start_s"]
    speed = float(np.linalg.norm(drop.velocity_m_s)) + abs(drop.gravity) * time_s
    return _scale_m(said) + speed * time_s


def _exact_end(said: Said) -> tuple[Decimal, ...]:
    flight, drop = _flight_of(said)
    first, last = flight["first_step"], flight["last_step"]
    x, y, _ = said.run.position_m[first].tolist()
    law, clamped = oracle.exact_law_m(drop, last - first, (x, y))
    hold(not clamped, "it includes a clamp of the velocity")
    return law[-1]


@checks("flights[].terms_m.timestep")
def _flight_timestep(said: Said) -> None:
    flight, drop = _flight_of(said)
    time_s = (flight["last_step"] - flight["first_step"]) * drop.timestep_s
    for value, g in zip(said.value, (0.0, 0.0, drop.gravity), strict=True):
        near(value, g * time_s * drop.step_s / 2, 1e-14 * abs(value), "g t dt/2")


@checks("flights[].terms_m.damping")
def _flight_damping(said: Said) -> None:
    flight, drop = _flight_of(said)
    if said.place > 3 and flight["last_step"] - flight["first_step"] > 3:
        return  # an ODE takes long; the interaction is what is left of it
    time_s = (flight["last_step"] - flight["first_step"]) * drop.timestep_s
    true = oracle.damping_m(drop, time_s)
    size = float(np.abs(true).max())
    for value, one in zip(said.value, true.tolist(), strict=True):
        # What is next to nothing beside the fall, `theory.STRAIGHT`, is not integrated on.
        near(value, one, 1e-9 * abs(one) + 1e-10 * size + 1e-18, "ODE of the drag")


@checks("flights[].terms_m.interaction")
def _flight_interaction(said: Said) -> None:
    flight, drop = _flight_of(said)
    time_s = (flight["last_step"] - flight["first_step"]) * drop.timestep_s
    start = said.run.position_m[flight["first_step"]].tolist()
    for axis, exact in enumerate(_exact_end(said)):
        g = Decimal(drop.gravity) if axis == 2 else Decimal(0)
        t = Decimal(time_s)
        free = Decimal(start[axis]) + (Decimal(drop.velocity_m_s[axis]) + g * t / 2) * t
        terms = (said.beside["timestep"][axis], said.beside["damping"][axis])
        true = float(exact - free - sum(map(Decimal, terms)))
        near(said.value[axis], true, 1e-14 * _flown_m(said), "what is left")


@checks("flights[].terms_m.rounding")
def _flight_rounding(said: Said) -> None:
    flight, _ = _flight_of(said)
    end = said.run.position_m[flight["last_step"]].tolist()
    for axis, exact in enumerate(_exact_end(said)):
        true = float(Decimal(end[axis]) - exact)
        near(said.value[axis], true, 1e-3 * abs(true) + 1e-19 * _flown_m(said), "rounding")
        total = math.fsum(part[axis] for part in said.beside.values())
        off = abs(total - flight["error_m"][axis])
        hold(off <= 1e-14 * _flown_m(said), "the terms do not add up")


# -- holding a whole analysis ----------------------------------------------------------------------


@dataclass
class Tally:
    """Counts of a statement's confirmations, nulls and errors; and its first error."""

    confirmed: Counter[str] = field(default_factory=Counter)
    null: Counter[str] = field(default_factory=Counter)
    wrong: Counter[str] = field(default_factory=Counter)
    offenders: dict[str, tuple[str, str]] = field(default_factory=dict)
    """Statement -> the error, and the command that reproduces it."""
    refused: Counter[str] = field(default_factory=Counter)

    def book(self, scenario: Scenario, statement: str, wrong: str | None) -> None:
        """Count the outcome of a statement."""
        if wrong is None:
            self.confirmed[statement] += 1
        else:
            self.wrong[statement] += 1
            self.offenders.setdefault(statement, (wrong, command(scenario)))

    @property
    def statements(self) -> list[str]:
        """All kinds of statements that occurred so far."""
        return sorted({*self.confirmed, *self.null, *self.wrong})

    def table(self) -> str:
        """Return a table with a line for each statement."""
        width = max(map(len, self.statements), default=9)
        lines = [f"{'statement':{width}} {'confirmed':>9} {'null':>6} {'wrong':>6}"]
        lines += [
            f"{one:{width}} {self.confirmed[one]:9d} {self.null[one]:6d} {self.wrong[one]:6d}"
            for one in self.statements
        ]
        for one, (why, how) in sorted(self.offenders.items()):
            lines += ["", f"{one}: {why}", f"    {how}"]
        if self.refused:
            lines += ["", *(f"refused {count}: {why}" for why, count in self.refused.items())]
        return "\n".join(lines)


def walk(
    value: Any, path: str = "", beside: Any = None, place: int = 0
) -> Iterator[tuple[str, Any, Any, int]]:
    """Yield the statements in a JSON object: path, value, containing object and its index."""
    if path in CHECKERS or not isinstance(value, dict | list):
        yield path, value, beside, place
    elif isinstance(value, dict):
        for key, one in value.items():
            yield from walk(one, f"{path}.{key}" if path else key, value, place)
    else:
        for number, one in enumerate(value):
            yield from walk(one, f"{path}[]", value, number)


def judge(scenario: Scenario) -> dict[str, Any]:
    """Return the analysis of a drop, computed in memory."""
    with World(scenario) as world:
        return analysis_of_world(world).as_json()


def what_is_wrong(path: str, said: Said) -> str | None:
    """Return the oracle's objection to a statement; None if it confirms it."""
    checker = CHECKERS.get(path)
    if checker is None:
        return "it has no checker"
    try:
        checker(said)
    except WrongError as error:
        return str(error)
    except Exception as error:  # noqa: BLE001 - said in the table, and the rest goes on
        return f"its checker fails: {type(error).__name__}: {error}"
    return None


def hold_case(scenario: Scenario, folder: Path, tally: Tally, *, through_file: bool = True) -> None:
    """Drop a scenario, analyze it, and check every statement with the oracle."""
    try:
        if through_file:
            simulate(scenario, folder / "run.rrd", camera=None, force=True)
            said = analyze(folder / "run.rrd").as_json()
        else:
            said = judge(scenario)
    except DropError as error:
        tally.refused[re.sub(r"[\d.e+-]+", "#", str(error))[:90]] += 1
        return
    except Exception as error:  # noqa: BLE001 - whatever it is, a user would see a traceback
        tally.book(scenario, "a result at all", f"{type(error).__name__}: {error}")
        return
    truth = Truth(drop_of(scenario))
    for path, value, beside, place in walk(said):
        statement = path
        if path == "findings[].code":
            statement = f"findings[]: {value}"
        if value is None:
            tally.null[statement] += 1
            continue
        wrong = what_is_wrong(path, Said(value, beside, place, said, scenario, truth))
        tally.book(scenario, statement, wrong)


def hold_many(cases: int, seed: int, folder: Path, *, bodies: Path | None = None) -> Tally:
    """Check a number of random scenarios; every tenth is analyzed by the command itself."""
    rng, tally = random.Random(seed), Tally()
    with patch.object(probe, "problem_of", lambda _: ("", [])):  # none of ours ends Bullet
        for number in range(cases):
            scenario = drawn(random.Random(rng.random()), bodies or folder)
            try:
                hold_case(scenario, folder, tally, through_file=number % 10 == 0)
            except Exception as error:
                error.add_note(f"case {number}: {command(scenario)}")
                raise
    return tally


@pytest.mark.long
def test_every_statement_is_confirmed(tmp_path: Path) -> None:
    tally = hold_many(CASES, SEED, tmp_path)
    assert not tally.wrong, tally.table()
    never = [one for one in CHECKERS if not tally.confirmed[one] and tally.null[one]]
    assert set(never) <= {"engine.gl_renderer", "scenario.integrator"}, (
        "these are null in every case"
    )


FOUND: dict[str, tuple[str, dict[str, Any]]] = {
    "the terms' sum, from kilometres up": (
        "cube_small.urdf",
        {"height_m": 7788.7, "timestep_s": 0.1, "duration_s": 39.8},
    ),
    "a correction where only the slop acts": (
        "cube_small.urdf",
        {
            "height_m": 0.0271790609, "timestep_s": 1e-4, "duration_s": 0.0428,
            "gravity_m_s2": -3.71, "linear_damping": 0.0, "restitution": 0.95,
            "restitution_threshold_m_s": 0.0,
        },
    ),
    "errors that cancel, with substeps": (
        "cube_small.urdf",
        {
            "height_m": 2.0, "timestep_s": 1 / 60, "duration_s": 0.5, "linear_damping": 0.04,
            "velocity_m_s": (0.0, 0.0, -2.38), "substeps": 3, "coordinates": "maximal",
        },
    ),
    "rest of a shape above its centre": (
        "offset-shape-0.0508m-34.2kg.urdf",
        {
            "height_m": 1.98476, "timestep_s": 0.02, "duration_s": 4.98,
            "velocity_m_s": (0.0, 0.0, -5.774276080182187), "orientation": (0.0, 0.0, 30.0),
            "contact_erp": 1.0, "solver_iterations": 500, "substeps": 8, "coordinates": "maximal",
        },
    ),
    "a release 10 nm above the floor": ("cube_small.urdf", {"height_m": 0.025 + 9.5e-9}),
    "a clamp after a contact that nobody reports": (
        "cube_small.urdf",
        {
            "height_m": 179.4, "timestep_s": 0.1, "duration_s": 17.2, "linear_damping": 0.0,
            "restitution": 0.8, "solver_residual": 0.0, "substeps": 3,
        },
    ),
    "the lowest point of a body with joints": (
        "r2d2.urdf",
        {
            "height_m": 0.4751294208822098, "duration_s": 19 / 240, "mass_kg": 43.35376612679412,
            "restitution": 1.0, "contact_erp": 1.0,
        },
    ),
    "the depth of a mesh beside its centre": (
        "mesh-0.188m-5.13kg.urdf",
        {
            "height_m": 0.19683599135978816, "duration_s": 1 / 240,
            "orientation": (113.85425083533488, -84.08007917485834, 110.27566388282582),
        },
    ),
    "the rest of a box that lies tilted": (
        "cube_small.urdf",
        {
            "height_m": 0.1173697, "timestep_s": 1 / 60, "duration_s": 2.5, "contact_erp": 0.0,
            "orientation": (-0.2, 0.12, 0.0), "coordinates": "maximal",
        },
    ),
    "a rest that restitution holds": (
        "cube_small.urdf",
        {
            "height_m": 2.025, "duration_s": 485 / 240, "linear_damping": 0.0, "restitution": 0.2,
            "restitution_threshold_m_s": 0.0, "solver_iterations": 10, "substeps": 2,
        },
    ),
    "the slop at a long timestep": (
        "cube_small.urdf",
        {
            "height_m": 2.025, "timestep_s": 0.1, "duration_s": 42.9, "gravity_m_s2": -25.0,
            "linear_damping": 0.0, "solver_iterations": 500, "mass_kg": 0.4082036735634641,
        },
    ),
    "a flight through points that pushed and took it back": (
        "objects/mug.urdf",
        {
            "height_m": 0.2534281707317744, "duration_s": 0.8541666666666666,
            "spin_rad_s": (60.0, -70.0, 80.0), "orientation": (90.0, 0.0, 0.0), "friction": 2.0,
            "solver_residual": 1e-9, "coordinates": "maximal",
        },
    ),
    "a first push with the inertia of another mass": (
        "cube_small.urdf",
        {
            "height_m": 0.024975, "timestep_s": 0.1, "duration_s": 2.0, "gravity_m_s2": -25.0,
            "velocity_m_s": (-3.22, 0.1, 0.6), "mass_kg": 0.0034, "restitution": 0.5,
            "coordinates": "maximal",
        },
    ),
    "a box whose centre of mass is beside its base": (
        "offset-shape-0.415m-5.78kg.urdf",
        {
            "height_m": 0.2084339834850086, "timestep_s": 1e-4, "duration_s": 0.0267,
            "linear_damping": 0.04, "orientation": (0.0, 90.0, 0.0), "restitution": 0.8,
            "solver_iterations": 500, "substeps": 2,
        },
    ),
    "the drag of a speed that Bullet takes for none": (
        "cube_small.urdf",
        {
            "height_m": 4.86, "timestep_s": 0.1, "duration_s": 21.6, "gravity_m_s2": 0.0,
            "linear_damping": 1.0, "velocity_m_s": (3.218907, -4.520119, 0.416789), "substeps": 8,
        },
    ),
    "a body that a contact holds still to the bit": (
        "offset-ball-0.027m-316kg.urdf",
        {
            "height_m": 0.008235355975811806, "timestep_s": 1e-4, "duration_s": 0.0145,
            "velocity_m_s": (0.0, 0.0, -3.156), "restitution": 0.0, "contact_erp": 0.0,
            "coordinates": "maximal",
        },
    ),
    "the momentum of what nothing acts on": (
        "hinged-0.429m-0.599kg.urdf",
        {
            "height_m": 0.195, "timestep_s": 0.001, "duration_s": 0.181, "gravity_m_s2": 0.0,
            "linear_damping": 1e-12, "velocity_m_s": (2.63, 4.27, 3.58), "mass_kg": 193.8,
            "orientation": (22.2, 163.5, -175.8),
        },
    ),
}  # fmt: skip
"""Random scenarios that once revealed an error in a statement or in the oracle, reduced."""


@pytest.mark.parametrize("found", some(FOUND, 3))
def test_what_was_found_once_is_confirmed(tmp_path: Path, found: str) -> None:
    body, values = FOUND[found]
    made = {one.__name__[1:].replace("_", "-"): one for one in BODIES}
    kind, _, sizes = body.removesuffix("kg.urdf").partition("m-") if "kg." in body else ("",) * 3
    if kind:
        kind, _, size = kind.rpartition("-")
        (tmp_path / body).write_text(made[kind](float(size), float(sizes)))
        body = str(tmp_path / body)
    tally = Tally()
    hold_case(Scenario(body=body, **values), tmp_path, tally, through_file=False)
    assert tally.confirmed
    assert not tally.wrong, tally.table()


def test_a_key_without_a_checker_fails(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delitem(CHECKERS, "impact.speed_m_s")
    tally = Tally()
    hold_case(Scenario(), tmp_path, tally)
    assert tally.offenders["impact.speed_m_s"][0] == "it has no checker"


def test_no_checker_confirms_another_value() -> None:
    scenario = Scenario(restitution=0.5)
    said, truth = judge(scenario), Truth(drop_of(scenario))
    passed = []
    for path, value, beside, place in list(walk(said)):
        if value is None or CHECKERS.get(path) in (_not_of_the_drop, _finding, _finding_message):
            continue
        key = path.rpartition(".")[2]
        keep, beside[key] = value, _another(value)
        statement = Said(beside[key], beside, place, said, scenario, truth)
        if what_is_wrong(path, statement) is None:
            passed.append(f"{path}: {beside[key]} for {keep}")
        beside[key] = keep
    assert not passed, passed


def _another(value: Any) -> Any:
    """Return a different value of the same type; a number is increased by a tenth."""
    match value:
        case bool():
            return not value
        case int():
            return value + 1
        case float():
            return value + max(abs(value) / 10, 1e-6)
        case str():
            return f"{value}?"
        case _:
            return [_another(one) for one in value]


def main() -> None:
    """Check many scenarios, when started by hand, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("cases", type=int, nargs="?", default=CASES)
    parser.add_argument("seed", type=int, nargs="?", default=SEED)
    given = parser.parse_args()
    bodies = Path(tempfile.gettempdir()) / "drop-truth"  # they stay, for the commands printed
    bodies.mkdir(exist_ok=True)
    out = os.dup(1)
    with Path(os.devnull).open("w") as quiet:  # Bullet prints warnings on standard output
        os.dup2(quiet.fileno(), 1)
    with tempfile.TemporaryDirectory() as folder:
        tally = hold_many(given.cases, given.seed, Path(folder), bodies=bodies)
    os.write(out, f"{tally.table()}\n".encode())


if __name__ == "__main__":
    main()
