"""Scenes of which a formula says whether they are faulty, with the findings that are due.

    python tests/constructed.py --seeds 20              # each kind 20 times, wrong and right ones
    python tests/constructed.py --kind arm --seeds 200  # one kind
    python tests/constructed.py --kind arm --first 7 --seeds 1 --show

A kind draws its numbers on one side of a limit in closed form: a motor's torque against m g l, an
angle against atan(mu), v dt against a wall's thickness. Its script measures `miss`, how far it is
from what its user wants, by bare PyBullet or MuJoCo: nothing of ours decides what is true. Asked is
whether what is wrong stands among the first two findings, whether anything else is said that is
grave, and whether the script with a finding's cure still misses.
"""

# ruff: noqa: D401 - the docstring of a kind says what is true of it
from __future__ import annotations

import argparse
import contextlib
import math
import random
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from asked import told_whole
from drop_physics.engines.cures import cures_of
from drop_physics.recording.reader import read
from drop_physics.rules.answer import Finding
from drop_physics.stages.record import record_script
from drop_physics.stages.rerun.proposals import Proposals
from drop_physics.trace.cures import ChangedRun
from drop_physics.trace.history import Seen
from forked import fork_scripts
from mujoco_scripts import watched
from scenes import number_of, record

G = 9.81
Draw = random.Random
GRAVE = ("broken", "asked")
"""Severity levels of findings that report a fault."""

PRELUDE = """
import math
p.setGravity(0, 0, -9.81)
def box(mass, at, half, mu=1.0, turned=(0, 0, 0, 1)):
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=half)
    made = p.createMultiBody(mass, shape, -1, at, turned)
    p.changeDynamics(made, -1, lateralFriction=mu)
    return made
def ball(mass, at, radius):
    return p.createMultiBody(mass, p.createCollisionShape(p.GEOM_SPHERE, radius=radius), -1, at)
def chain(mass, length, axis, kind=p.JOINT_REVOLUTE, half=(.02, .02, .02)):
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=half)
    return p.createMultiBody(0, -1, -1, [0, 0, 1], linkMasses=[mass],
        linkCollisionShapeIndices=[shape], linkVisualShapeIndices=[-1], linkPositions=[[0, 0, 0]],
        linkOrientations=[[0, 0, 0, 1]], linkInertialFramePositions=[[length, 0, 0]],
        linkInertialFrameOrientations=[[0, 0, 0, 1]], linkParentIndices=[0],
        linkJointTypes=[kind], linkJointAxis=[axis])
def urdf(text, **how):
    with open("robot.urdf", "w") as file:
        file.write(text)
    return p.loadURDF("robot.urdf", **how)
def hold(body, joint, target, **how):
    p.setJointMotorControl2(body, joint, p.POSITION_CONTROL, targetPosition=target, **how)
def free(body, joint):
    p.setJointMotorControl2(body, joint, p.VELOCITY_CONTROL, force=0)
def place(body):
    return p.getBasePositionAndOrientation(body)[0]
def angle(body, joint=0):
    return p.getJointState(body, joint)[0]
"""
BESIDE = (
    "p.setTimeStep(1 / 240)",
    "p.setRealTimeSimulation(0)",
    "p.setPhysicsEngineParameter(numSolverIterations=120)",
    "p.setPhysicsEngineParameter(deterministicOverlappingPairs=1)",
    "p.setPhysicsEngineParameter(enableConeFriction=1)",
    "far = box(0, [0, 40, 0], [.5] * 3); near = box(1, [0, 40, .6], [.1] * 3)",
    "other = p.connect(p.DIRECT); p.setGravity(0, 0, -1.62, physicsClientId=other)",
    "away = chain(1, .3, [0, 0, 1]); p.setCollisionFilterGroupMask(away, 0, 0, 0)",
)
"""Code put before a scene that does not affect its outcome: settings, and bodies far away."""
LINK = """<link name='{name}'><inertial><origin xyz='{at} 0 0'/><mass value='{mass}'/>
<inertia ixx='{i}' iyy='{i}' izz='{i}' ixy='0' ixz='0' iyz='0'/></inertial></link>"""
BASE = "<robot name='r'>" + LINK.format(name="base", at=0, mass=1, i=0.01)
JOINT = """<joint name='{name}' type='revolute'><parent link='base'/><child link='{child}'/>
<origin xyz='0 {y} 0'/><axis xyz='{axis}'/><limit lower='{low}' upper='{high}' effort='1000'
velocity='100'/>{more}</joint>"""


@dataclass(frozen=True)
class Kind:
    """A kind of scene, with the findings that its faulty versions must produce."""

    name: str
    codes: frozenset[str]
    """Codes or reasons, one of which must be among the first two findings about a faulty scene."""
    also: frozenset[str]
    """Codes of further severe findings that are true of a faulty scene."""
    small: float
    """Largest `miss` of a correct scene; a faulty scene has at least twice this."""
    measured: bool
    """Whether the script's own measurement decides if a scene is faulty, as no formula does."""
    engine: str
    text: Callable[[Draw, bool], str]
    """Returns a script that sets `miss`, from a random generator and whether the scene is
    faulty."""


KINDS: dict[str, Kind] = {}


def kind(
    *codes: str, small: float, also: str = "", measured: bool = False, engine: str = "pybullet"
) -> Callable[[Callable[[Draw, bool], str]], Callable[[Draw, bool], str]]:
    """Return a decorator that registers a kind of scene under its function's name."""

    def add(text: Callable[[Draw, bool], str]) -> Callable[[Draw, bool], str]:
        known = frozenset(codes), frozenset(also.split())
        name = text.__name__
        KINDS[name] = Kind(name, *known, small, measured, engine, text)
        return text

    return add


def _ratio(draw: Draw, wrong: bool, least: float = 1.25, most: float = 2.5) -> float:
    """Return a random ratio of load to capacity: above 1 if the scene is faulty."""
    ratio = draw.uniform(least, most)
    return ratio if wrong else 1 / ratio


# -- motors ---------------------------------------------------------------------------------------


@kind("off-target", small=0.01)
def arm(draw: Draw, wrong: bool) -> str:
    """A motor with a limit of F N m holds an arm up against the torque m g l cos(q)."""
    mass, length, q = draw.uniform(0.3, 5), draw.uniform(0.2, 0.8), draw.uniform(-0.8, 0.8)
    force = mass * G * length * math.cos(q) / _ratio(draw, wrong)
    return f"""
a = chain({mass}, {length}, [0, 1, 0])
p.resetJointState(a, 0, {q})
hold(a, 0, {q}, force={force})
steps(480)
miss = abs(angle(a) - {q})
"""


@kind("off-target", small=0.01)
def hoist(draw: Draw, wrong: bool) -> str:
    """A prismatic motor with a limit of F N lifts a platform and its load."""
    own, load, up = draw.uniform(0.5, 3), draw.uniform(0.5, 5), draw.uniform(0.05, 0.3)
    force = (own + load) * G / _ratio(draw, wrong)
    return f"""
a = chain({own}, 0, [0, 0, 1], p.JOINT_PRISMATIC, [.2, .2, .02])
b = box({load}, [0, 0, 1.07], [.05] * 3)
hold(a, 0, {up}, force={force})
steps(720)
miss = abs(angle(a) - {up})
"""


@kind("motor-gain", "unstable", small=0.003, also="off-target velocity-clamped")
def gains(draw: Draw, wrong: bool) -> str:
    """A PD step is stable while kp + 2 kd < 4 and kd < 2, with gains as fractions per step."""
    kd = draw.uniform(2.1, 3) if wrong else draw.uniform(0.8, 1)
    kp = draw.uniform(0.05, 0.4)
    return f"""
a = chain({draw.uniform(0.3, 3)}, {draw.uniform(0.1, 0.4)}, [0, 1, 0])
hold(a, 0, {draw.uniform(0.2, 1)}, force=200, positionGain={kp}, velocityGain={kd})
steps(360)
seen = []
for _ in range(60):
    p.stepSimulation()
    seen.append(angle(a))
miss = max(seen) - min(seen)
"""


@kind("target-clamped", small=0.01, also="off-target")
def stop(draw: Draw, wrong: bool) -> str:
    """A target position lies beyond its joint's limit, or within it."""
    high = draw.uniform(0.3, 1.2)
    target = high + draw.uniform(0.1, 0.5) * (1 if wrong else -1)
    robot = (
        BASE
        + LINK.format(name="arm", at=0.1, mass=draw.uniform(0.2, 2), i=0.01)
        + JOINT.format(name="j", child="arm", y=0, axis="0 0 1", low=-1, high=high, more="")
        + "</robot>"
    )
    return f"""
a = urdf({robot!r}, useFixedBase=True)
hold(a, 0, {target}, force=100)
steps(240)
miss = abs(angle(a) - {target})
"""


@kind("default-motor", small=0.2)
def pendulum(draw: Draw, wrong: bool) -> str:
    """A pendulum swings through, unless the motor that each joint has by default is left on."""
    q = draw.uniform(0.2, 1.2)
    return f"""
a = chain({draw.uniform(0.2, 3)}, {draw.uniform(0.2, 0.8)}, [0, 1, 0])
p.resetJointState(a, 0, {q})
{"" if wrong else "free(a, 0)"}
seen = []
for _ in range(480):
    p.stepSimulation()
    seen.append(angle(a))
miss = max(0, 1 - (max(seen) - {q}) / (2 * (math.pi / 2 - {q})))
"""


@kind("default-motor", small=0.2)
def torque(draw: Draw, wrong: bool) -> str:
    """A torque turns a free joint by t²τ/2I, unless the default motor stops it."""
    tau = draw.uniform(0.05, 0.5)
    inertia = draw.uniform(0.05, 0.2)
    robot = (
        BASE
        + LINK.format(name="arm", at=0, mass=1, i=inertia)
        + JOINT.format(name="j", child="arm", y=0, axis="0 0 1", low=1, high=-1, more="")
        + "</robot>"
    )
    return f"""
a = urdf({robot!r}, useFixedBase=True, flags=p.URDF_USE_INERTIA_FROM_FILE)
p.changeDynamics(a, -1, linearDamping=0, angularDamping=0)
{"" if wrong else "free(a, 0)"}
for _ in range(120):
    p.setJointMotorControl2(a, 0, p.TORQUE_CONTROL, force={tau})
    p.stepSimulation()
miss = abs(1 - angle(a) / ({tau} / {inertia} * .25 / 2))
"""


@kind("reset-leaves", small=0.01, also="off-target")
def reset(draw: Draw, wrong: bool) -> str:
    """A joint is reset, but its motor keeps its earlier target."""
    away, home = draw.uniform(0.4, 1.2), draw.uniform(-0.8, 0.1)
    return f"""
a = chain({draw.uniform(0.3, 2)}, {draw.uniform(0.1, 0.4)}, [0, 1, 0])
hold(a, 0, {away}, force=200)
steps(240)
p.resetJointState(a, 0, {home})
{"" if wrong else f"hold(a, 0, {home}, force=200)"}
steps(240)
miss = abs(angle(a) - {home})
"""


@kind("mimic-ignored", small=0.02)
def mimic(draw: Draw, wrong: bool) -> str:
    """A joint that its URDF declares as a mimic joint does not follow the other joint."""
    target = draw.uniform(0.2, 0.8)
    how = "<mimic joint='a' multiplier='1'/>" if wrong else ""
    robot = (
        BASE
        + LINK.format(name="one", at=0.05, mass=0.2, i=0.001)
        + LINK.format(name="two", at=0.05, mass=0.2, i=0.001)
        + JOINT.format(name="a", child="one", y=0.1, axis="0 0 1", low=-1, high=1, more="")
        + JOINT.format(name="b", child="two", y=-0.1, axis="0 0 1", low=-1, high=1, more=how)
        + "</robot>"
    )
    return f"""
a = urdf({robot!r}, useFixedBase=True)
hold(a, 0, {target}, force=20)
{"" if wrong else f"hold(a, 1, {target}, force=20)"}
steps(240)
miss = abs(angle(a) - angle(a, 1))
"""


@kind("timestep-after-motor", small=0.01, also="off-target")
def timestep_late(draw: Draw, wrong: bool) -> str:
    """A motor keeps its call's impulse limit F dt, so a longer timestep afterwards reduces F."""
    mass, length, factor = draw.uniform(0.5, 4), draw.uniform(0.2, 0.6), draw.choice((2, 4))
    force = mass * G * length * draw.uniform(1.1, 0.8 * factor)
    first, then = "p.setTimeStep(1 / 240)", f"p.setTimeStep({factor} / 240)"
    if not wrong:
        first, then = then, ""
    return f"""
{first}
a = chain({mass}, {length}, [0, 1, 0])
hold(a, 0, 0, force={force})
{then}
steps(240)
miss = abs(angle(a))
"""


@kind("substeps-scale-motors", "off-target", small=0.01)
def substeps(draw: Draw, wrong: bool) -> str:
    """With n substeps a motor's limit applies n times; with one, the motor is too weak."""
    mass, length, n = draw.uniform(0.5, 4), draw.uniform(0.2, 0.6), draw.choice((2, 4))
    force = mass * G * length * (1 / draw.uniform(1.2, 0.85 * n) if wrong else 1.5)
    return f"""
p.setPhysicsEngineParameter(numSubSteps={n})
a = chain({mass}, {length}, [0, 1, 0])
hold(a, 0, 0, force={force})
steps(240)
miss = {"" if wrong else "1 - "}(abs(angle(a)) < .01)
"""


@kind("joint-damping", small=0.05)
def joint_damping(draw: Draw, wrong: bool) -> str:
    """A URDF's damping c takes the torque c ω, so that a joint turns at τ/c instead of τ t/I."""
    tau, inertia = draw.uniform(0.2, 1), draw.uniform(0.05, 0.2)
    damping = inertia * draw.uniform(2, 8) if wrong else 0
    robot = (
        BASE
        + LINK.format(name="arm", at=0, mass=1, i=inertia)
        + JOINT.format(
            name="j",
            child="arm",
            y=0,
            axis="0 0 1",
            low=1,
            high=-1,
            more=f"<dynamics damping='{damping}'/>",
        )
        + "</robot>"
    )
    return f"""
a = urdf({robot!r}, useFixedBase=True, flags=p.URDF_USE_INERTIA_FROM_FILE)
p.changeDynamics(a, -1, linearDamping=0, angularDamping=0)
free(a, 0)
for _ in range(120):
    p.setJointMotorControl2(a, 0, p.TORQUE_CONTROL, force={tau})
    p.stepSimulation()
miss = abs(1 - p.getJointState(a, 0)[1] / ({tau} / {inertia} * .5))
"""


# -- friction -------------------------------------------------------------------------------------


@kind("slides", small=0.005)
def ramp(draw: Draw, wrong: bool) -> str:
    """A box rests on a ramp while tan(angle) is below the product of both friction coefficients."""
    slope = draw.uniform(0.1, 0.5)
    mu, own = math.tan(slope) / _ratio(draw, wrong), draw.uniform(0.5, 2)
    half = draw.uniform(0.03, 0.15)
    up = half + 0.05
    return f"""
q = p.getQuaternionFromEuler([0, {slope}, 0])
box(0, [0, 0, 0], [20, 2, .05], {mu / own}, q)
b = box({draw.uniform(0.1, 10)}, [{up} * math.sin({slope}), 0, {up} * math.cos({slope})],
    [{half}] * 3, {own}, q)
at = place(b)
steps(240)
miss = math.dist(at, place(b))
"""


@kind("slides", small=0.005)
def grip(draw: Draw, wrong: bool) -> str:
    """Two fingers hold a box while 2 mu F exceeds its weight."""
    mass, mu = draw.uniform(0.1, 1), draw.uniform(0.3, 1)
    force = mass * G / (2 * mu) / _ratio(draw, wrong)
    return f"""
pad = p.createCollisionShape(p.GEOM_BOX, halfExtents=[.02, .01, .02])
h = p.createMultiBody(0, -1, -1, [0, 0, 1], linkMasses=[.2] * 2,
    linkCollisionShapeIndices=[pad] * 2, linkVisualShapeIndices=[-1] * 2,
    linkPositions=[[0, -.045, 0], [0, .045, 0]], linkOrientations=[[0, 0, 0, 1]] * 2,
    linkInertialFramePositions=[[0, 0, 0]] * 2, linkInertialFrameOrientations=[[0, 0, 0, 1]] * 2,
    linkParentIndices=[0] * 2, linkJointTypes=[p.JOINT_PRISMATIC] * 2,
    linkJointAxis=[[0, 1, 0], [0, -1, 0]])
for j in (0, 1):
    p.changeDynamics(h, j, lateralFriction=1)
    p.setJointMotorControl2(h, j, p.VELOCITY_CONTROL, targetVelocity=.05, force={force})
b = box({mass}, [0, 0, 1], [.03] * 3, {mu})
t = box(0, [0, 0, .92], [.2, .2, .05])
steps(120)
p.removeBody(t)
steps(120)
miss = 1 - place(b)[2]
"""


@kind("dragged-by-nothing", small=0.02)
def platform(draw: Draw, wrong: bool) -> str:
    """A platform moved by setting its pose has no velocity, and carries nothing along."""
    way = draw.uniform(0.1, 0.3)
    velocity = f"p.resetBaseVelocity(t, [{way} * math.pi / 2 * math.sin(math.pi * i / 240), 0, 0])"
    return f"""
t = box(0, [0, 0, .5], [.5, .5, .05])
b = box({draw.uniform(0.2, 5)}, [0, 0, .6], [.05] * 3)
steps(30)
for i in range(240):
    x = {way} / 2 * (1 - math.cos(math.pi * i / 240))
    p.resetBasePositionAndOrientation(t, [x, 0, .5], [0, 0, 0, 1])
    {"" if wrong else velocity}
    p.stepSimulation()
miss = abs(place(b)[0] - {way})
"""


@kind("wheel-slip", small=0.08)
def wheels(draw: Draw, wrong: bool) -> str:
    """Wheels set to ω at once slip until v = mu g t: for a fraction ω r / (2 mu g T) of the run."""
    mu, radius, seconds = draw.uniform(0.1, 0.4), draw.uniform(0.05, 0.1), 2.0
    share = draw.uniform(0.2, 0.4) if wrong else 0.15
    rate = share * 2 * mu * G * seconds / radius
    seen = f"{rate}" if wrong else f"{rate} * min(1, i / 400)"
    return f"""
p.loadURDF("plane.urdf")
body = p.createCollisionShape(p.GEOM_BOX, halfExtents=[.2, .1, .03])
wheel = p.createCollisionShape(p.GEOM_CYLINDER, radius={radius}, height=.04)
side = p.getQuaternionFromEuler([math.pi / 2, 0, 0])
c = p.createMultiBody({draw.uniform(2, 10)}, body, -1, [0, 0, {radius}], linkMasses=[.3] * 4,
    linkCollisionShapeIndices=[wheel] * 4, linkVisualShapeIndices=[-1] * 4,
    linkPositions=[[x, y, 0] for x in (-.15, .15) for y in (-.15, .15)],
    linkOrientations=[side] * 4, linkInertialFramePositions=[[0, 0, 0]] * 4,
    linkInertialFrameOrientations=[[0, 0, 0, 1]] * 4, linkParentIndices=[0] * 4,
    linkJointTypes=[p.JOINT_REVOLUTE] * 4, linkJointAxis=[[0, 0, -1]] * 4)
p.changeDynamics(c, -1, linearDamping=0, angularDamping=0)
for j in range(4):
    p.changeDynamics(c, j, lateralFriction={mu})
for i in range({int(seconds * 240)}):
    for j in range(4):
        p.setJointMotorControl2(c, j, p.VELOCITY_CONTROL, targetVelocity={seen}, force=50)
    p.stepSimulation()
rolled = sum(abs(angle(c, j)) for j in range(4)) / 4 * {radius}
miss = abs(1 - abs(place(c)[0]) / rolled)
"""


# -- contacts -------------------------------------------------------------------------------------


@kind("no-restitution", small=0.1)
def bounce(draw: Draw, wrong: bool) -> str:
    """A ball rises to e²h; e is the product of both restitutions, and a floor's default is 0."""
    e, height = draw.uniform(0.5, 0.95), draw.uniform(0.3, 1.5)
    return f"""
f = p.loadURDF("plane.urdf")
b = ball({draw.uniform(0.1, 3)}, [0, 0, {height + 0.1}], .1)
p.changeDynamics(b, -1, restitution={e}, linearDamping=0, angularDamping=0)
{"" if wrong else "p.changeDynamics(f, -1, restitution=1)"}
seen = []
for _ in range({int(480 * math.sqrt(height / 2) + 240)}):
    p.stepSimulation()
    seen.append(place(b)[2])
lowest = seen.index(min(seen[:{int(240 * math.sqrt(2 * height / G)) + 8}]))
miss = max(0, 1 - (max(seen[lowest:]) - .1) / ({e} ** 2 * {height}))
"""


@kind("tunnelled", small=0.1)
def wall(draw: Draw, wrong: bool) -> str:
    """Return a scenario: a ball that may move farther in a step than it and a wall are thick."""
    radius, thick = draw.uniform(0.01, 0.03), draw.uniform(0.01, 0.03)
    step_m = (thick + 2 * radius) * draw.uniform(1.3, 3) if wrong else thick * 0.3
    speed = min(step_m * 240, 95)
    steps = 4 + math.ceil((radius + thick) / step_m)
    return f"""
p.setGravity(0, 0, 0)
box(0, [1, 0, 0], [{thick / 2}, 1, 1])
b = ball(.1, [1 - {speed} / 240 * ({steps} - .5), 0, 0], {radius})
p.changeDynamics(b, -1, linearDamping=0)
p.resetBaseVelocity(b, [{speed}, 0, 0])
steps({2 * steps})
miss = max(0, place(b)[0] - 1)
"""


@kind("starts-in-contact", small=0.05, also="deep-penetration")
def overlap(draw: Draw, wrong: bool) -> str:
    """A box that is placed inside another is ejected."""
    half = draw.uniform(0.05, 0.2)
    deep = half * draw.uniform(0.3, 0.8) if wrong else 0
    return f"""
p.loadURDF("plane.urdf")
b = box({draw.uniform(0.2, 5)}, [0, 0, {half - deep}], [{half}] * 3)
seen = []
for _ in range(120):
    p.stepSimulation()
    seen.append(p.getBaseVelocity(b)[0][2])
miss = max(seen)
"""


@kind("deep-penetration", small=0.3, also="starts-in-contact", measured=True)
def press(draw: Draw, wrong: bool) -> str:
    """A heavy box on a light one sinks in, because the solver stops after 50 iterations."""
    light = draw.uniform(0.05, 0.2)
    heavy = light * (draw.uniform(200, 600) if wrong else draw.uniform(0.5, 3))
    return f"""
p.loadURDF("plane.urdf")
a = box({light}, [0, 0, .05], [.05] * 3)
b = box({heavy}, [0, 0, .2], [.1] * 3)
deepest = 0
for _ in range(240):
    p.stepSimulation()
    points = p.getContactPoints()
    deepest = max([deepest, *(-c[8] for c in points)])
miss = deepest / .1
"""


@kind("filter", "no-contact", small=0.1, also="no-floor")
def mask(draw: Draw, wrong: bool) -> str:
    """A body whose collision mask excludes another body's group falls through it."""
    half = draw.uniform(0.05, 0.2)
    group = 2
    return f"""
t = box(0, [0, 0, .5], [.5, .5, .1])
b = box({draw.uniform(0.2, 5)}, [0, 0, {0.6 + half} + {draw.uniform(0, 0.1)}], [{half}] * 3)
p.setCollisionFilterGroupMask(b, -1, {group}, {4 if wrong else 7})
steps(120)
miss = max(0, {0.55 + half} - place(b)[2])
"""


@kind("no-shape", "no-contact", "tunnelled", small=0.1, also="no-floor")
def shapeless(draw: Draw, wrong: bool) -> str:
    """A body without a collision shape falls through the floor."""
    shape = "-1" if wrong else "p.createCollisionShape(p.GEOM_SPHERE, radius=.1)"
    height = draw.uniform(0.15, 0.5)
    return f"""
p.loadURDF("plane.urdf")
b = p.createMultiBody({draw.uniform(0.2, 5)}, {shape}, -1, [0, 0, {height}])
steps(200)
miss = max(0, -place(b)[2])
"""


# -- bodies ---------------------------------------------------------------------------------------


@kind("massless", small=0.02)
def massless(draw: Draw, wrong: bool) -> str:
    """A body without a mass stays in the air."""
    height = draw.uniform(0.5, 2)
    mass = "" if wrong else f"baseMass={draw.uniform(0.1, 3)}, "
    return f"""
p.loadURDF("plane.urdf")
s = p.createCollisionShape(p.GEOM_SPHERE, radius=.1)
b = p.createMultiBody({mass}baseCollisionShapeIndex=s, basePosition=[0, 0, {height + 0.1}])
steps({int(240 * math.sqrt(2 * height / G)) + 120})
miss = max(0, place(b)[2] - .1) / {height}
"""


@kind("wrong-body", small=0.05, also="no-floor")
def mass_for_all(draw: Draw, wrong: bool) -> str:
    """A static table to which a loop over all bodies gives a mass falls."""
    bodies = "(t, b)" if wrong else "(b,)"
    return f"""
t = box(0, [0, 0, .5], [.5, .5, .1])
b = box(1, [0, 0, .75], [.1] * 3)
for each in {bodies}:
    p.changeDynamics(each, -1, mass={draw.uniform(0.2, 5)})
steps(120)
miss = .5 - place(t)[2]
"""


@kind(small=0.05)
def release(draw: Draw, wrong: bool) -> str:
    """A body held by a mass of 0, and then released, falls as it should: never faulty."""
    mass = draw.uniform(0.2, 5)
    held, made = "p.changeDynamics(b, -1, mass=0)\nsteps(30)", f"{mass}"
    if wrong:
        held, made = "", "0"
    return f"""
p.loadURDF("plane.urdf")
b = box({made}, [0, 0, 1], [.1] * 3)
{held}
p.changeDynamics(b, -1, mass={mass})
steps(240)
miss = max(0, place(b)[2] - .1)
"""


@kind("no-gravity", small=0.05)
def weightless(draw: Draw, wrong: bool) -> str:
    """`resetSimulation` removes gravity, so nothing falls."""
    height = draw.uniform(0.5, 2)
    return f"""
{"p.resetSimulation()" if wrong else ""}
p.loadURDF("plane.urdf")
b = ball({draw.uniform(0.1, 3)}, [0, 0, {height + 0.1}], .1)
steps({int(240 * math.sqrt(2 * height / G)) + 120})
miss = max(0, place(b)[2] - .1) / {height}
"""


@kind("default-damping", small=0.01)
def flight(draw: Draw, wrong: bool) -> str:
    """PyBullet's damping of 0.04 (1 + v) v takes more than 8 % of a fast throw's energy."""
    speed, seconds = draw.uniform(3, 9), draw.uniform(0.4, 0.8)
    none = "" if wrong else "p.changeDynamics(b, -1, linearDamping=0, angularDamping=0)"
    return f"""
b = ball({draw.uniform(0.1, 3)}, [0, 0, 50], .1)
{none}
p.resetBaseVelocity(b, [{speed}, 0, 0])
steps({int(240 * seconds)})
miss = 1 - p.getBaseVelocity(b)[0][0] / {speed}
"""


@kind("inertia-from-shape", small=0.1)
def inertia(draw: Draw, wrong: bool) -> str:
    """A URDF's moments of inertia are used only with a flag; otherwise they come from the shape."""
    mass, half = draw.uniform(0.5, 3), draw.uniform(0.05, 0.2)
    own = mass * 4 * half**2 / 6 * draw.choice((0.3, 3))
    turn = draw.uniform(4, 20) * own
    robot = (
        f"<robot name='r'><link name='base'><inertial><mass value='{mass}'/><inertia ixx='{own}' "
        f"iyy='{own}' izz='{own}' ixy='0' ixz='0' iyz='0'/></inertial><collision><geometry>"
        f"<box size='{2 * half} {2 * half} {2 * half}'/></geometry></collision></link></robot>"
    )
    return f"""
p.setGravity(0, 0, 0)
a = urdf({robot!r}{"" if wrong else ", flags=p.URDF_USE_INERTIA_FROM_FILE"})
p.changeDynamics(a, -1, linearDamping=0, angularDamping=0)
for _ in range(60):
    p.applyExternalTorque(a, -1, [0, 0, {turn}], p.WORLD_FRAME)
    p.stepSimulation()
miss = abs(1 - p.getBaseVelocity(a)[1][2] / ({turn / own} * 60 / 240))
"""


# -- pushes, constraints, states ------------------------------------------------------------------


@kind("push-lasted-a-step", small=0.1)
def push(draw: Draw, wrong: bool) -> str:
    """A thrust of m g, applied once every few steps, carries only a fraction of the weight."""
    mass, often = draw.uniform(0.2, 3), draw.choice((2, 4, 8))
    inner = often if wrong else 1
    return f"""
b = box({mass}, [0, 0, 5], [.1] * 3)
for _ in range({240 // inner}):
    p.applyExternalForce(b, -1, [0, 0, {mass * G}], [0, 0, 0], p.LINK_FRAME)
    steps({inner})
miss = 5 - place(b)[2]
"""


@kind("force-off-centre", small=0.05, also="velocity-clamped")
def off_centre(draw: Draw, wrong: bool) -> str:
    """A force at the body's own origin turns it if it is given in the world frame."""
    x, mass = draw.uniform(0.3, 2), draw.uniform(0.5, 3)
    frame = "WORLD" if wrong else "LINK"
    return f"""
b = box({mass}, [{x}, 0, 2], [.1] * 3)
for _ in range(60):
    p.applyExternalForce(b, -1, [0, 0, {mass * G}], [0, 0, 0], p.{frame}_FRAME)
    p.stepSimulation()
miss = math.hypot(*p.getBaseVelocity(b)[1])
"""


@kind("velocity-set-each-step", "overwritten", small=0.05)
def walker(draw: Draw, wrong: bool) -> str:
    """A velocity that is set before each step leaves only one step's gravity."""
    speed = draw.uniform(0.2, 1)
    fall = "0" if wrong else "p.getBaseVelocity(b)[0][2]"
    return f"""
b = ball({draw.uniform(0.2, 3)}, [0, 0, 5], .1)
p.changeDynamics(b, -1, linearDamping=0)
for _ in range(120):
    p.resetBaseVelocity(b, [{speed}, 0, {fall}])
    p.stepSimulation()
miss = 1 - (5 - place(b)[2]) / (9.81 / 2 * .25)
"""


@kind("asleep", small=0.004)
def asleep(draw: Draw, wrong: bool) -> str:
    """A cube that may sleep does so after 2 s at rest, and a push does not wake it."""
    push = draw.uniform(1.2, 3)
    flags = ", flags=p.URDF_ENABLE_SLEEPING" if wrong else ""
    return f"""
p.loadURDF("plane.urdf")
b = p.loadURDF("cube_small.urdf", [0, 0, .025]{flags})
steps(800)
x = place(b)[0]
for _ in range(60):
    p.applyExternalForce(b, -1, [{push}, 0, 0], [0, 0, 0], p.LINK_FRAME)
    p.stepSimulation()
miss = max(0, .01 - (place(b)[0] - x))
"""


@kind("weak-constraint", small=0.01)
def rope(draw: Draw, wrong: bool) -> str:
    """A constraint with maxForce carries a weight that hangs from it."""
    mass = draw.uniform(0.5, 20)
    force = mass * G / _ratio(draw, wrong)
    return f"""
b = box({mass}, [0, 0, 2], [.1] * 3)
c = p.createConstraint(b, -1, -1, -1, p.JOINT_FIXED, [0, 0, 0], [0, 0, 0], [0, 0, 2])
p.changeConstraint(c, maxForce={force})
steps(240)
miss = 2 - place(b)[2]
"""


@kind("constraint-apart", small=0.05, also="weak-constraint")
def frames(draw: Draw, wrong: bool) -> str:
    """Constraint frames that do not coincide are pulled together."""
    gap = draw.uniform(0.05, 0.3) if wrong else 0
    return f"""
a = box(0, [0, 0, 2], [.1] * 3)
b = box({draw.uniform(0.2, 3)}, [{0.4 + gap}, 0, 2], [.1] * 3)
p.createConstraint(a, -1, b, -1, p.JOINT_FIXED, [0, 0, 0], [.2, 0, 0], [-.2, 0, 0])
seen = []
for _ in range(120):
    p.stepSimulation()
    seen.append(math.hypot(*p.getBaseVelocity(b)[0]))
miss = max(seen)
"""


@kind("restore-differs", small=1e-9, measured=True)
def restore(draw: Draw, wrong: bool) -> str:
    """A pile restored from a saved state evolves differently, unless its pairs are sorted."""
    ordered = "" if wrong else "p.setPhysicsEngineParameter(deterministicOverlappingPairs=1)"
    shift = draw.uniform(0.005, 0.03)
    return f"""
{ordered}
p.loadURDF("plane.urdf")
bs = [p.loadURDF("cube_small.urdf", [0, {shift} * n, .1 * n + .2]) for n in range(5)]
steps(100)
state = p.saveState()
steps(100)
first = [place(b) for b in bs]
p.restoreState(state)
steps(100)
miss = max(math.dist(a, place(b)) for a, b in zip(first, bs))
"""


@kind("pose-set-each-step", "overwritten", small=0.2, also="deep-penetration tunnelled")
def driven(draw: Draw, wrong: bool) -> str:
    """A joint whose position is set each step passes through stops and overrides motors."""
    to, reach = draw.uniform(0.5, 1) if wrong else draw.uniform(0.05, 0.15), 0.4
    drive = f"p.resetJointState(a, 0, {to} * i / 240)"
    if not wrong:
        drive = f"hold(a, 0, {to} * i / 240, force=50)"
    return f"""
s = p.createCollisionShape(p.GEOM_BOX, halfExtents=[.2, .02, .02],
    collisionFramePosition=[.2, 0, 0])
a = p.createMultiBody(0, -1, -1, [0, 0, 1], linkMasses=[1], linkCollisionShapeIndices=[s],
    linkVisualShapeIndices=[-1], linkPositions=[[0, 0, 0]], linkOrientations=[[0, 0, 0, 1]],
    linkInertialFramePositions=[[.2, 0, 0]], linkInertialFrameOrientations=[[0, 0, 0, 1]],
    linkParentIndices=[0], linkJointTypes=[p.JOINT_REVOLUTE], linkJointAxis=[[0, 0, 1]])
box(0, [{reach} * math.cos(.3), {reach} * math.sin(.3) + .07, 1], [.05] * 3)
deepest = 0
for i in range(240):
    {drive}
    p.stepSimulation()
    deepest = max([deepest, *(-c[8] for c in p.getContactPoints())])
miss = deepest / .04
"""


# -- MuJoCo ---------------------------------------------------------------------------------------

MUJOCO = """
import math
import mujoco
m = mujoco.MjModel.from_xml_string('''<mujoco><option timestep="0.002"{option}/><worldbody>
{bodies}</worldbody>{more}</mujoco>''')
d = mujoco.MjData(m)
"""
HINGE = """<body name="arm" pos="0 0 1"><joint name="j" axis="0 1 0" damping="{damping}" {joint}/>
<geom type="sphere" pos="{length} 0 0" size=".02" mass="{mass}" contype="0" conaffinity="0"/></body>
"""
SERVO = '<actuator><position name="s" joint="j" kp="{kp}" {more}/></actuator>'


def _hinge(
    mass: float, length: float, kp: float, more: str = "", *, damping: float = 1.0, option: str = ""
) -> str:
    return MUJOCO.format(
        option=option,
        bodies=HINGE.format(mass=mass, length=length, damping=damping, joint=""),
        more=SERVO.format(kp=kp, more=more),
    )


@kind("forcerange", "off-target", small=0.05, engine="mujoco")
def mj_force(draw: Draw, wrong: bool) -> str:
    """An actuator with a forcerange of F N m holds the load m g l."""
    mass, length = draw.uniform(0.3, 3), draw.uniform(0.2, 0.6)
    load = mass * G * length
    force = load / _ratio(draw, wrong)
    return f"""{_hinge(mass, length, load * 300, f'forcerange="-{force} {force}"')}
for _ in range(1500):
    mujoco.mj_step(m, d)
miss = abs(d.qpos[0])
"""


@kind("spring", "off-target", small=0.02, engine="mujoco")
def mj_spring(draw: Draw, wrong: bool) -> str:
    """A servo of gain kp ends off its target by m g l / kp."""
    mass, length = draw.uniform(0.3, 3), draw.uniform(0.2, 0.6)
    load = mass * G * length
    off = draw.uniform(0.06, 0.2) if wrong else 0.005
    return f"""{_hinge(mass, length, load / off, damping=load / off / 10)}
for _ in range(2000):
    mujoco.mj_step(m, d)
miss = abs(d.qpos[0])
"""


@kind("ctrlrange", "target-clamped", small=0.05, engine="mujoco", also="off-target")
def mj_clamp(draw: Draw, wrong: bool) -> str:
    """A target beyond ctrlrange is clamped to its limit."""
    high = draw.uniform(0.2, 0.6)
    target = high + 0.2 if wrong else high - 0.1
    return f"""{_hinge(0.2, 0.1, 50, f'ctrlrange="-1 {high}"')}
for _ in range(1000):
    d.ctrl[0] = {target}
    mujoco.mj_step(m, d)
miss = abs(d.qpos[0] - {target})
"""


@kind("unstable", "motor-gain", "auto-reset", small=0.05, engine="mujoco", also="off-target")
def mj_gain(draw: Draw, wrong: bool) -> str:
    """A spring of stiffness kp is stable while kp h²/I < 4 in semi-implicit Euler."""
    mass, length = draw.uniform(0.1, 0.5), draw.uniform(0.05, 0.1)
    moment = mass * length**2 + 0.4 * mass * 0.02**2
    kp = moment / 0.002**2 * (draw.uniform(5, 12) if wrong else 0.05)
    damping = 0 if wrong else 2 * math.sqrt(kp * moment)
    return f"""{_hinge(mass, length, kp, damping=damping, option=' gravity="0 0 0"')}
d.ctrl[0] = .1
seen = []
for _ in range(400):
    mujoco.mj_step(m, d)
    seen.append(abs(d.qpos[0]))
miss = float(max(seen) > 1)
"""


@kind("slides", small=0.01, engine="mujoco")
def mj_ramp(draw: Draw, wrong: bool) -> str:
    """A box rests while tan(angle) is below the larger of the two friction coefficients."""
    slope = draw.uniform(0.1, 0.5)
    mu = math.tan(slope) / _ratio(draw, wrong)
    tilt = f'euler="0 {math.degrees(slope)} 0"'
    rough = f'friction="{mu}"'
    up = 0.05
    return f"""{
        MUJOCO.format(
            option=' impratio="10" cone="elliptic"',
            bodies=f'''<geom type="plane" size="9 9 1" {tilt} {rough}/>
<body pos="{up * math.sin(slope)} 0 {up * math.cos(slope)}" {tilt}><freejoint/>
<geom type="box" size=".05 .05 .05" mass="{draw.uniform(0.2, 3)}" {rough}/></body>''',
            more="",
        )
    }
at = d.qpos[:3].copy()
for _ in range(500):
    mujoco.mj_step(m, d)
miss = math.dist(at, d.qpos[:3])
"""


@kind("filter", "no-contact", small=0.05, engine="mujoco", also="no-floor")
def mj_contype(draw: Draw, wrong: bool) -> str:
    """Geoms whose contype and conaffinity do not match pass through each other."""
    half = draw.uniform(0.03, 0.1)
    kinds = 'contype="2" conaffinity="2"' if wrong else 'contype="3" conaffinity="1"'
    return f"""{
        MUJOCO.format(
            option="",
            bodies=f'''<geom type="plane" size="9 9 1"/><body pos="0 0 {half + 0.05}"><freejoint/>
<geom type="box" size="{half} {half} {half}" mass="1" {kinds}/></body>''',
            more="",
        )
    }
for _ in range(300):
    mujoco.mj_step(m, d)
miss = max(0, {half} - d.qpos[2])
"""


# -- what is said of a scene, and whether its cures cure ------------------------------------------


@dataclass
class Judged:
    """The findings about one scene, and the results of trying their cures."""

    kind: Kind
    wrong: bool
    miss: float
    findings: Sequence[Finding]
    cures: list[tuple[Finding, str, float | None]]
    """Findings with a cure, the cure's call, and the `miss` with it; None if that run failed."""

    def faults(self) -> Iterator[str]:
        """Yield the errors in the findings, or in the scene itself."""
        small, codes = self.kind.small, self.kind.codes
        if self.kind.measured and small < self.miss <= 2 * small:
            return
        if self.wrong != (self.miss > 2 * small) or (not self.wrong and self.miss > small):
            yield f"scene: wrong is {self.wrong}, and it misses by {self.miss:.3g}"
        if self.wrong and not any(names(finding) & codes for finding in self.findings[:2]):
            yield f"missed: {', '.join(sorted(codes))} is not among the first two"
        true = codes | self.kind.also if self.wrong else frozenset()
        for each in self.findings:
            if each.level in GRAVE and not names(each) & true:
                yield f"false: {each.level} {each.code}: {each.told}"
        for each, call, left in self.cures:
            if left is None or not left <= max(0.2 * self.miss, small):
                yield f"not cured: {each.code}: {call}: {self.miss:.3g} -> {left}; {each.told}"


def names(finding: Finding) -> set[str]:
    """Return a finding's code and reason."""
    return {finding.code, finding.reason or ""}


def judged(name: str, seed: int, folder: Path, *, cures: bool = True) -> Judged:
    """Record a scene, analyze it, and try the cures that its findings propose."""
    one, draw = KINDS[name], random.Random(f"{name} {seed}")
    wrong = seed % 3 != 2  # two of three
    text = one.text(draw, wrong)
    wrong = wrong and bool(one.codes)
    if one.engine == "pybullet":
        path = folder / f"{name}_{seed}.rrd"
        beside = "\n".join(draw.sample(BESIDE, draw.randrange(3)))
        script = PRELUDE + beside + text
        miss, seen = number_of(script, "miss", folder), record(script, path, folder=folder).seen

        def again(changed: ChangedRun) -> float:
            return number_of(script, "miss", folder, changed)
    else:
        told_of = folder / f"{name}_{seed}"
        script = text + "print(miss)\n"
        seen, miss = recorded_mujoco(told_of, script)
        path = told_of / "run.rrd"

        def again(changed: ChangedRun) -> float:
            variation = {"finer": changed.finer} if changed.finer > 1 else None
            run = watched(told_of, script, interventions=changed.operations, variation=variation)
            return float(run.printed)

    findings = told_whole(seen)
    if one.measured:
        wrong = miss > 2 * one.small
    found = Judged(one, wrong, miss, findings, [])
    if wrong and cures:
        for candidate in Proposals(seen, findings, cures_of(seen.engine)).of_findings():
            for place in candidate.findings:
                if names(findings[place]) & one.codes:
                    call, left = candidate.intervention.call, None
                    if candidate.run is not None:
                        with contextlib.suppress(Exception):
                            left = again(candidate.run)
                    found.cures.append((findings[place], call, left))
    path.unlink()
    return found


def recorded_mujoco(folder: Path, script: str) -> tuple[Seen, float]:
    """Record a MuJoCo script, and return the recording and the number that the script prints."""
    folder.mkdir()
    path = folder / "script.py"
    path.write_text(script)
    with contextlib.chdir(folder), Path("printed.txt").open("wb") as printed:
        made = record_script("script.py", out=folder / "run.rrd", stdout=printed.fileno())
        return read(made.recording).seen, float(Path("printed.txt").read_text())


def main() -> int:
    """Search random scenes for wrong findings, and print each."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--kind", nargs="*", default=[*KINDS])
    parser.add_argument("--show", action="store_true", help="print all that is said")
    asked = parser.parse_args()
    faults = tried = failed = 0
    fork_scripts()
    with tempfile.TemporaryDirectory() as folder:
        for name in asked.kind:
            for seed in range(asked.first, asked.first + asked.seeds):
                one = judged(name, seed, Path(folder))
                said = [*one.faults()]
                faults += bool(said)
                tried += len(one.cures)
                failed += sum(each.startswith("not cured") for each in said)
                if asked.show:
                    print(name, seed, f"wrong={one.wrong} miss={one.miss:.4g}")
                    print(
                        *(
                            f"  {f.level} {f.code}: {f.told} | {f.advice} | {f.cure}"
                            for f in one.findings
                        ),
                        sep="\n",
                    )
                    print(*(f"  tried {call}: {left}" for _, call, left in one.cures), sep="\n")
                for each in said:
                    print(f"{name} {seed}: {each}", flush=True)
    print(f"{faults} scenes at fault; {tried - failed} of {tried} cures cure")
    return int(faults > 0)


if __name__ == "__main__":
    sys.exit(main())
