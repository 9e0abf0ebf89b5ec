"""Write docs/validation.md: exact results about bodies, compared with PyBullet's.

Each figure is computed from the recording of a short script, made by `drop record`.
"""

from __future__ import annotations

import math
import os
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from drop_physics.drop.mechanics import Drift, mechanics_of_part
from drop_physics.physics.base import Motion
from drop_physics.recording.reader import read
from drop_physics.stages.record import record_script
from drop_physics.trace.history import Seen
from drop_physics.trace.states import BASE, MOTION
from numpy.typing import NDArray

from generators import mujoco_worlds, pendulum

HEAD = """\
import pybullet as p
import pybullet_data
p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
def box(x, y, z, at, mass=1.0, **how):
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[x / 2, y / 2, z / 2])
    body = p.createMultiBody(mass, shape, -1, at, **how)
    p.changeDynamics(body, -1, linearDamping=0, angularDamping=0)
    return body
def ball(radius, at, mass=1.0):
    shape = p.createCollisionShape(p.GEOM_SPHERE, radius=radius)
    body = p.createMultiBody(mass, shape, -1, at)
    p.changeDynamics(body, -1, linearDamping=0, angularDamping=0)
    return body
def steps(count):
    for _ in range(count):
        p.stepSimulation()
"""
G = 9.81
SLIDES = """
p.changeDynamics(p.loadURDF("plane.urdf"), -1, lateralFriction=1)
body = box(.4, .4, .05, [0, 0, .025])
p.changeDynamics(body, -1, lateralFriction=.3)
steps(60)
p.resetBaseVelocity(body, [2, 0, 0])
steps(240)
"""
THROWN = """
p.resetBaseVelocity(box(.1, .1, .1, [0, 0, 0]), [1, 0, 6])
steps(160)
"""
FALLS = """
p.loadURDF("cube_small.urdf", [0, 0, 0])
steps(240 * 20)
"""
ROLLS = """
import math
p.changeDynamics(p.loadURDF("plane.urdf"), -1, lateralFriction=1)
body = ball(.1, [0, 0, .1])
p.changeDynamics(body, -1, lateralFriction=1)
p.setGravity(9.81 * math.sin(.1), 0, -9.81 * math.cos(.1))
steps(480)
"""
COLLIDE = """
p.setGravity(0, 0, 0)
one, other = ball(.1, [0, 0, 0]), ball(.1, [1, .05, 0], mass=3)
for body in (one, other):
    p.changeDynamics(body, -1, restitution=1, lateralFriction=0)
p.resetBaseVelocity(one, [2, 0, 0])
steps(240)
"""
SPINS = """
p.setGravity(0, 0, 0)
p.setTimeStep({timestep})
body = box(.3, .2, .1, [0, 0, 0], useMaximalCoordinates={maximal})
p.resetBaseVelocity(body, [0, 0, 0], [.1, 6, .1])
steps(round(10 / {timestep}))
"""


@dataclass(frozen=True)
class Figure:
    """An exact result about a body, compared with PyBullet's."""

    what: str
    formula: str
    theory: float
    measured: float
    unit: str
    why: str
    """The cause of the difference."""
    within: float
    """The tolerance on the difference, in the result's unit; for a conserved sum, on the drift."""

    @property
    def row(self) -> str:
        """The result as a row of the table."""
        difference = self.measured - self.theory
        unit = f" {self.unit}" if self.unit else ""
        return (
            f"| {self.what} | {self.formula} | {self.theory:.6g}{unit} "
            f"| {self.measured:.6g}{unit} | {difference:+.2g}{unit} | {self.why} |"
        )


def figures() -> list[Figure]:
    """Return all results, each computed from a recording made for the purpose."""
    return [_slide(), _apex(), _range(), _terminal(), _roll(), *_collision(), *_spins()]


def _slide() -> Figure:
    motion = _motion(_seen(SLIDES), 1)
    start = 60
    distance_m = float(motion.position_m[-1, 0] - motion.position_m[start, 0])
    return Figure(
        "a box that slides at v = 2 m/s stops after",
        "v² / 2µg, µ = 0.3",
        4 / (2 * 0.3 * G),
        distance_m,
        "m",
        "timestep: v dt/2 less, since friction acts before the body moves",
        2 / 240,
    )


def _apex() -> Figure:
    motion = _motion(_seen(THROWN), 0)
    return Figure(
        "a body thrown up at v = 6 m/s rises",
        "v² / 2g",
        36 / (2 * G),
        float(motion.position_m[:, 2].max()),
        "m",
        "timestep: v dt/2 less, since gravity acts before the body moves",
        6 / 240 / 2 * 1.01,
    )


def _range() -> Figure:
    motion = _motion(_seen(THROWN), 0)
    time_s = 0.5
    row = round(time_s * 240)
    height_m = float(motion.position_m[row, 2])
    return Figure(
        "and is after t = 0.5 s at",
        "v t − g t²/2",
        6 * time_s - G * time_s**2 / 2,
        height_m,
        "m",
        "timestep: −g t dt/2, exactly",
        G * time_s / 480 * 1.000001,
    )


def _terminal() -> Figure:
    motion = _motion(_seen(FALLS), 0)
    k = float(np.float32(0.04))
    return Figure(
        "a body falls at last, damped by PyBullet's default k = 0.04, at",
        "v (1 + v) k = g: v = √(1/4 + g/k) − 1/2",
        math.sqrt(0.25 + G / k) - 0.5,
        -float(motion.velocity_m_s[-1, 2]),
        "m/s",
        "none: the step has the same fixed point",
        1e-9,
    )


def _roll() -> Figure:
    motion = _motion(_seen(ROLLS), 1)
    slope, time_s = 0.1, 2.0
    rate = 2 * float(motion.position_m[-1, 0]) / time_s**2
    theory = 5 / 7 * G * math.sin(slope)
    return Figure(
        "a ball rolls down a slope of 0.1 rad with",
        "5/7 g sin θ",
        theory,
        rate,
        "m/s²",
        "timestep: dt/t = 0.21 % more",
        theory * 0.0022,
    )


def _collision() -> list[Figure]:
    seen = _seen(COLLIDE)
    light, heavy = (_motion(seen, body).velocity_m_s for body in (0, 1))
    momentum = light + 3 * heavy
    energy_j = (np.sum(light**2, axis=1) + 3 * np.sum(heavy**2, axis=1)) / 2
    return [
        Figure(
            "two balls collide: drift of their momentum",
            "Σ m v is conserved",
            0.0,
            _drift(momentum),
            "",
            "rounding",
            1e-12,
        ),
        Figure(
            "share of the energy that the heavier ball gets",
            "restitution 1, no friction: 3/4 cos²θ",
            _struck(),
            float(1.5 * np.sum(heavy[-1] ** 2) / energy_j[0]),
            "",
            "where the balls meet in the step",
            0.02,
        ),
    ]


def _struck() -> float:
    """Return the share of energy transferred: 4 m M / (m + M)² along the line of centres."""
    along = 1 - (0.05 / 0.2) ** 2
    return 4 * 1 * 3 / (1 + 3) ** 2 * along


def _drift(values: NDArray[np.float64]) -> float:
    drift = Drift()
    drift.add(values)
    return drift.relative or 0.0


def _spins() -> list[Figure]:
    figures = []
    for maximal, kind in ((0, "btMultiBody"), (1, "btRigidBody")):
        for rate in (240, 480):
            seen = _seen(SPINS.format(timestep=f"(1 / {rate})", maximal=maximal))
            motion = _motion(seen, 0)
            inertia = np.array([0.2**2 + 0.1**2, 0.3**2 + 0.1**2, 0.3**2 + 0.2**2]) / 12
            state = mechanics_of_part(motion, 1.0, inertia, 0.0)
            drifts = {"energy": state.total_j, "angular momentum": state.angular_momentum_kg_m2_s}
            figures += [
                Figure(
                    f"{name} of a box that tumbles freely for 10 s, drift with 1/{rate} s, {kind}",
                    "conserved",
                    0.0,
                    _drift(values),
                    "",
                    "timestep",
                    0.06,
                )
                for name, values in drifts.items()
            ]
    return figures


def _seen(script: str) -> Seen:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "script.py")
        path.write_text(HEAD + script)
        null = os.open(os.devnull, os.O_WRONLY)
        try:
            recorded = record_script(str(path), out=Path(folder, "run.rrd"), stdout=null)
        finally:
            os.close(null)
        seen = read(recorded.recording).seen
        assert len(seen.states)  # read while the file is there
        return seen


def _motion(seen: Seen, body: int) -> Motion:
    states = seen.states
    base = states[(states["body"] == body) & (states["link"] == BASE)]
    return Motion(*(base[name] for name in MOTION))


def made(known: list[Figure] | None = None) -> dict[str, str]:
    """Return the generated page."""
    rows = "\n".join(figure.row for figure in (figures() if known is None else known))
    return {
        "validation.md": PAGE.format(
            rows=rows, pendulum=pendulum.rows(), worlds=mujoco_worlds.rows()
        )
    }


PAGE = """\
# Validation

Exact results for thrown, sliding, rolling and spinning bodies, compared with PyBullet's. Each
figure is computed from a recording that `drop record` makes of a short script; the scripts are in
`docs/generators/validation.py`, and `tests/test_validation.py` checks every row.

| what | formula | theory | PyBullet | difference | from |
| --- | --- | ---: | ---: | ---: | --- |
{rows}

A freely tumbling body conserves neither its energy nor its angular momentum exactly: half the
timestep halves the drift, so both kinds of coordinates integrate rotation with a first-order
error. The error of the fall, term by term, is in [the walkthrough](walkthrough.md).

## A published pendulum

Problem A01 of the IFToMM multibody benchmark (González, Dopico, Lugrís, Cuadrado: *A benchmarking
system for MBS simulation software*, Multibody System Dynamics 16, 2006): a point mass of 1 kg on a
massless rod of 1 m, released level. Compared are the positions of the mass over the first 10 s:
PyBullet's (`URDF_USE_INERTIA_FROM_FILE`, the joint's default motor off) with the exact ones, which
are elliptic functions. Per timestep, the largest distance, when it occurs, and its causes, which
add up to it: *timestep*, the discrete law without damping against the exact motion; *damping*, the
continuous model with PyBullet's damping against the one without; *interaction*, what both have
together; *rounding*, PyBullet against its law (below 1e-12 m). `docs/generators/pendulum.py` makes
the rows, `tests/test_pendulum_benchmark.py` checks them.

| timestep | damping | error | at | timestep | damping | interaction | rounding | observed order |
| --- | --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: |
{pendulum}

Without damping the error comes from the timestep, and is of first order. With PyBullet's default
of 0.04 it comes from the damping, and no smaller timestep reduces it: the model is different.

## Every step of a tree of links

The [sum of impulses](record.md#what-its-bodies-did-and-why) of a step is computed from the state
before it and what PyBullet reports after it (`physics/laws/bullet/tree`). Stops, the velocity
clamp after the solver and rolling and spinning friction are never reported: the part of the
remainder in the only directions in which they can act is attributed to them. For a tree with few
degrees of freedom these directions may span everything.

The table has the largest remainder of any step, relative to the largest term or single force of
that step; in brackets relative to the largest entry of a term alone, for steps in which one
exceeds 1e-6 N s or N m s. `python tests/tree_figures.py` prints the table;
`tests/test_tree_law.py` asserts 1e-11 for every scene, and that the sum would not close without
any one of the terms.

| scene | robots | median | largest | of |
| --- | ---: | ---: | ---: | --- |
| free fall, spinning, motors off | 68 | 5e-15 | 6e-13 (2e-13) | a differential |
| on a floor, may touch itself: default motors | 68 | 5e-15 | 1e-13 (5e-13) | kuka, gripper |
| the same, motors off | 68 | 6e-15 | 2e-13 (1e-12) | kuka |
| POSITION_CONTROL | 68 | 9e-15 | 2e-13 (3e-13) | kuka, free base |
| VELOCITY_CONTROL | 68 | 7e-15 | 2e-13 (5e-13) | kuka, free base |
| TORQUE_CONTROL | 68 | 7e-15 | 3e-13 (9e-13) | kuka, gripper |
| PD_CONTROL, which reports no torque | 68 | 6e-15 | 1e-12 (1e-12) | kuka, gripper |
| pushed and turned at its last link, in both frames | 68 | 3e-15 | 6e-14 (6e-14) | kuka, gripper |
| the same, forward kinematics asked for before | 68 | 4e-15 | 6e-14 (6e-14) | kuka, gripper |
| rolling and spinning friction of every link | 68 | 7e-15 | 2e-13 (5e-13) | swimmer |
| timestep set after the motors' calls | 68 | 5e-15 | 5e-14 (5e-14) | swimmer |
| a cube held by a fixed constraint, both bodies | 68 | 5e-15 | 2e-13 (2e-13) | kuka, free base |
| by a point-to-point constraint, both bodies | 68 | 8e-15 | 1e-13 (1e-13) | kuka, free base |
| energy by cause over 1,000 steps, of the largest cause | 68 | 1e-16 | 2e-15 | swimmer |
| momentum by cause over 1,000 steps, of the largest cause | 38 | 6e-15 | 3e-14 | minitaur |

For a push on a link PyBullet uses the link's pose of one step earlier, unless forward kinematics
were requested since. `tests/test_tree_law.py` has further scenes: a constraint to the world, a
gear, a motor that is cut off at 100 rad/s, a ball that rolls and spins, a cube in a gripper.
There, link positions agree with `getLinkState` to 1e-14 m, and M with `calculateMassMatrix` to
1e-14 of its largest entry.

**Robots.** All of `pybullet_data` that have joints and that PyBullet loads, and a cube. It does
not load `kuka_iiwa/model_for_sdf.urdf`, `kuka_iiwa/model2.sdf` and `kuka_iiwa/kuka_world.sdf`;
loading `gripper/wsg50_one_motor_gripper_free_base.sdf` ends the process. None of those that load
is left out.

**Where the sum need not hold**, a step [says why](record.md#what-its-bodies-did-and-why).

**Substeps.** With `numSubSteps=N`, PyBullet reports motors and contacts of the last substep alone.
`physics/laws/bullet/substeps` assumes the same in all substeps, and tests whether that leads to
the velocities and pose at the end of the step (`tests/test_substeps.py`):

| with N = 2 and 4 | largest remainder | so |
| --- | ---: | --- |
| no motors, torques, PD_CONTROL, a pushed base: 67 robots, 3,092 steps | 2e-13 | explained |
| a cube that flies without being pushed | to the bit | explained |
| motors at their force limit in the whole step | 1e-14 | explained |
| an arm whose motors hold a pose | 1e-15 in the end | explained up to 1e-6 |
| a cube at rest; with `solverResidualThreshold=0` | 1e-8; 2e-15 | explained up to 1e-6 |
| a robot on four feet, whose points push in turn | 1e-3 | `substeps` |
| motors that move, bounces, slides, stops, rolling friction | not known | `substeps` |
| a push on a link, unless a call has refreshed its pose | 1e-6 | `substeps` |

## Worlds of MuJoCo that others ship

Environments of gymnasium's MuJoCo set and dm_control's suite (all but quadruped/escape, which
needs OpenGL), and some of gymnasium-robotics and robosuite, run in a script with zero actions and
then with random ones, at least 250 steps each. Each runs a second time without drop: *same* counts
those whose final states are bitwise equal. *Replayed* steps lead to the recorded state again, bit
for bit; in *explained* ones the named impulses close the sum up to *remainder* of the largest;
*bytes* are those of the recording, per step. `python docs/generators/mujoco_worlds.py` runs them;
`mujoco_worlds.jsonl` beside it keeps the results of each, with all sentences.

Nothing is wrong with these worlds, so each finding of the levels `broken` and `asked` (*grave*)
was read and compared with the model. The remaining ones are true: resets put bodies inside others
(HalfCheetah, HumanoidStandup, dog/fetch, the Fetch tasks; PickPlace parks objects that it does not
need in one place, out of sight), fingers are sent beyond their range, servos of the Shadow hand
give way to its weight, and two steps of dm_control's cheetah use what was computed for the pose
before its own reset.

| suite | MuJoCo | date | worlds | same | steps | replayed | explained | remainder | bytes | grave |
| --- | --- | --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |
{worlds}
"""
