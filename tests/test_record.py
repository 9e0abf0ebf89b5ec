"""`drop record`: a user's script runs as it would without drop, and everything is recorded.

Verification: what a script prints, its final state to the last bit included, is the same with and
without recording; what is in the recording is what the script itself reads from the engine.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import textwrap
import time
import warnings
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import drop_physics.stages.record as stage
import numpy as np
import pyarrow as pa
import pytest
import scenes
import scripts
from command import HANGS_S, drop_here, wait_for
from conftest import some
from drop_physics.engines.frames import FrameStream
from drop_physics.engines.other_processes import OtherProcesses
from drop_physics.engines.watching import pipe
from drop_physics.errors import DropError, OutputError, ScenarioError
from drop_physics.recording import schema, writer
from drop_physics.recording.reader import read
from drop_physics.stages.analyze import analyze
from drop_physics.stages.block import record
from drop_physics.stages.info import info
from drop_physics.stages.record import Recorded, record_script
from rerun.chunk import RrdReader

BANNER = "pybullet build time"


class Bench:
    """A folder with scripts, and methods to run them."""

    came: tuple[Recorded, str]
    """The result of recording a plain script, and the script's output."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        folder.joinpath("show.py").write_text(scripts.SHOW)

    def script(self, text: str, name: str = "script.py") -> str:
        """Write a script, and return its name."""
        self.folder.joinpath(name).write_text(text)
        return name

    def bare(self, name: str, *arguments: str) -> subprocess.CompletedProcess[str]:
        """Run a script without drop."""
        return subprocess.run(
            [sys.executable, name, *arguments],
            cwd=self.folder,
            capture_output=True,
            text=True,
            check=False,
        )

    def drop(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        """Run the command in this process; the script runs in a process of its own."""
        return drop_here(*arguments, folder=self.folder)

    def record(self, name: str, *arguments: str, **how: Any) -> tuple[Recorded, str]:
        """Record a script in this folder; return the result and the standard output."""
        printed = self.folder / "printed.txt"
        back = Path.cwd()
        os.chdir(self.folder)
        try:
            with printed.open("wb") as file:
                recorded = record_script(
                    name, arguments, out="out.rrd", force=True, stdout=file.fileno(), **how
                )
        finally:
            os.chdir(back)
        return recorded, printed.read_text()

    @property
    def out(self) -> Path:
        """The path that `record` writes."""
        return self.folder / "out.rrd"


COMMAND = [sys.executable, "-P", "-c", "from drop_physics.console.running import main; main()"]


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    return Bench(tmp_path)


Plain = Callable[[str], Bench]


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Plain:
    """Return a function that records a plain script by name, and returns its folder."""

    @cache
    def recorded(name: str) -> Bench:
        bench = Bench(tmp_path_factory.mktemp(name))
        for own in ("pipeline", "cli", "tests"):
            bench.folder.joinpath(f"{own}.py").write_text(f"MINE = {own!r}")
        bench.came = bench.record(
            bench.script(scripts.PLAIN[name]), *scripts.ARGUMENTS.get(name, [])
        )
        return bench

    return recorded


def rows(path: Path, entity: str) -> Iterator[dict[str, Any]]:
    """Yield the rows of an entity in the order written, each as lists by column."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # an unfinished recording has no footer
        reader = RrdReader(path)
    for chunk in reader.stream():
        if chunk.entity_path != f"/{entity}" or chunk.is_static:
            continue
        batch = chunk.to_record_batch()
        # Without pandas, Arrow makes no Python object of a duration in nanoseconds.
        plain = [one.cast(pa.int64()) if pa.types.is_duration(one.type) else one for one in batch]
        yield from pa.record_batch(plain, batch.schema.names).to_pylist()


def told(path: Path, entity: str) -> Iterator[dict[str, Any]]:
    """Yield an entity's JSON rows, each with its step."""
    for row in rows(path, entity):
        for text in row["json"]:
            yield json.loads(text) | {"sim_step": row["sim_step"]}


def put_rows(path: Path, body: int) -> Iterator[dict[str, Any]]:
    """Yield the poses that calls have set on bodies."""
    return (row for row in told(path, "set") if row["body"] == body)


def closing(path: Path) -> dict[str, Any]:
    for chunk in RrdReader(path).stream():
        if chunk.entity_path == f"/__properties/{schema.RECORDING_PROPERTY}":
            (row,) = chunk.to_record_batch().to_pylist()
            return {key: value for key, value in row.items() if isinstance(value, list)}
    raise AssertionError("there is no closing property")


def states(path: Path) -> dict[tuple[int, int], list[float]]:
    """Return the 13 state values for each step and body."""
    found = {}
    for row in rows(path, "state"):
        numbers = [np.reshape(row[name], (len(row["body"]), -1)) for name in STATE]
        for place, body in enumerate(row["body"]):
            key = (row["sim_step"], body)
            assert key not in found, "a body has two states at one step"
            found[key] = [float(one) for values in numbers for one in values[place]]
    return found


STATE = ("position_m", "orientation", "velocity_m_s", "spin_rad_s")
CONTACT = (
    "body_a", "link_a", "body_b", "link_b", "position_a_m", "position_b_m", "normal", "distance_m",
    "normal_force_n", "friction_1_n", "friction_1_direction", "friction_2_n",
    "friction_2_direction",
)  # fmt: skip


def contacts(path: Path) -> dict[int, list[list[float]]]:
    """Return the contact points of each step, each as a list of numbers."""
    found = {}
    for row in rows(path, "contacts"):
        count = len(row["body_a"])
        columns = [np.reshape(row[name], (count, -1)) for name in CONTACT]
        found[row["sim_step"]] = np.hstack(columns).tolist()
    return found


# -- it changes nothing ---------------------------------------------------------------------------


@pytest.mark.starts
@pytest.mark.parametrize("name", some(scripts.PLAIN, 1))
def test_a_script_prints_the_same_to_the_last_bit(plain: Plain, name: str) -> None:
    bench = plain(name)
    bare = bench.bare("script.py", *scripts.ARGUMENTS.get(name, []))
    assert bare.returncode == 0, bare.stderr
    recorded, printed = bench.came
    assert printed == bare.stdout
    assert recorded.ended == "finished"
    assert recorded.error == ""
    assert closing(bench.out)["ended"] == ["finished"]
    assert ("notes" in closing(bench.out)) == (name == "soft")  # which is left out


# -- what is recorded is what the engine had ------------------------------------------------------

WITNESS = """
import json
class Witness:
    def __init__(self, p):
        self.p, self.seen, self.steps = p, [], 0
    def look(self, stepped=True):
        p = self.p
        bodies = {}
        for i in range(p.getNumBodies()):
            b = p.getBodyUniqueId(i)
            parts = [[*p.getBasePositionAndOrientation(b), *p.getBaseVelocity(b)]]
            for j in range(p.getNumJoints(b)):
                s = p.getLinkState(b, j, computeLinkVelocity=1)
                parts.append([s[0], s[1], s[6], s[7]])
            bodies[b] = [[x for one in part for x in one] for part in parts]
            free = [j for j in range(p.getNumJoints(b)) if p.getJointInfo(b, j)[2] != 4]
            joints = [p.getJointStateMultiDof(b, j) for j in free]
            bodies[b].append([[x for s in joints for x in s[k]] for k in (0, 1, 3)])
        points = [[c[1], c[3], c[2], c[4], *c[5], *c[6], *c[7], *c[8:11], *c[11], c[12], *c[13]]
            for c in p.getContactPoints()] if stepped else []
        self.seen.append([bodies, points])
    def save(self):
        json.dump(self.seen, open("witness.json", "w"))
"""


@pytest.mark.parametrize(
    "scene",
    some(
        [
            """p.loadURDF("plane.urdf")
b = p.loadURDF("cube_small.urdf", [0, 0, 0.2], [0.1, 0.2, 0, 1])
c = p.loadURDF("cube_small.urdf", [0.02, 0, 0.4], useMaximalCoordinates=True)""",
            """p.loadURDF("plane.urdf")
k = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)
r = p.loadURDF("r2d2.urdf", [2, 0, 0.6])""",
            """p.loadURDF("plane.urdf")
h = p.loadURDF("humanoid/humanoid.urdf", [0, 0, 1])
p.loadURDF("cube_small.urdf", [1, 0, 0.1])""",
        ],
        1,
    ),
)
def test_state_contacts_and_joints_are_what_the_engine_had(bench: Bench, scene: str) -> None:
    bench.folder.joinpath("witness.py").write_text(WITNESS)
    script = bench.script(
        scripts.HEAD
        + scene
        + """
from witness import Witness
w = Witness(p)
w.look(stepped=False)
for i in range(150):
    p.stepSimulation()
    w.look()
w.save()
"""
    )
    bench.record(script)
    seen = json.loads(bench.folder.joinpath("witness.json").read_text())
    found, points = states(bench.out), contacts(bench.out)
    moving = {body for _, body in found}
    assert moving
    assert any(points for _, points in seen)
    for step, (bodies, touching) in enumerate(seen):
        assert points.get(step, []) == touching
        for body in moving:
            assert found[step, body] == bodies[str(body)][0]
    assert len(found) == len(moving) * len(seen)
    for entity in (one for one in entities(bench.out) if one.startswith("joints/")):
        _, label, name = entity.split("/")
        body, which = int(label.split("_")[0]), ("position", "velocity", "effort").index(name)
        found_here = list(rows(bench.out, entity))
        assert [row["sim_step"] for row in found_here] == list(range(len(seen)))
        for row, (bodies, _) in zip(found_here, seen, strict=True):
            assert row["Scalars:scalars"] == bodies[str(body)][-1][which]


def entities(path: Path) -> set[str]:
    return {chunk.entity_path[1:] for chunk in RrdReader(path).stream()}


def test_what_cannot_move_has_no_state_but_where_it_was_put(plain: Plain) -> None:
    bench = plain("box")
    assert {body for _, body in states(bench.out)} == {1}
    (floor,) = put_rows(bench.out, 0)
    assert floor["base"][:3] == [0.0, 0.0, 0.0]


def test_a_body_that_a_call_has_moved_is_recorded_before_time_goes_on(plain: Plain) -> None:
    bench = plain("moved")
    put = [(row["sim_step"], row["base"][:3], row["base"][7:10]) for row in put_rows(bench.out, 0)]
    assert put == [(i, [0.0, 0.0, float(i)], [float(i), 0.0, 0.0]) for i in (10, 30, 50)]
    kinds = [row["reported"]["mass_kg"] for row in told(bench.out, "dynamics")]
    assert kinds == [[0.1], [2.5]]
    seen = read(bench.out).seen
    (given,) = seen.calls.given()
    assert given.values["linearDamping"] == 0.0
    engine = [row["values"] for row in told(bench.out, "engine")]
    assert [row["fixedTimeStep"] for row in engine] == [1 / 240, 1 / 100]
    assert engine[1]["set_erp"] == 0.3
    last = list(rows(bench.out, "state"))[-1]
    assert last["sim_step"] == 80
    # 60 steps of 1/240 s and 20 of 1/100 s, in whole nanoseconds.
    assert last["sim_time"] == pytest.approx(0.45e9, abs=1)


def test_every_pose_of_a_script_that_never_steps_is_there(plain: Plain) -> None:
    bench = plain("posed")
    recorded, _ = bench.came
    assert recorded.samples == 1
    put = [row["base"][0] for row in put_rows(bench.out, 0)]
    final = states(bench.out)[0, 0][0]
    assert [*put, final] == pytest.approx([0.1 * i for i in range(10)])


def test_calls_are_told_in_order_with_file_and_line(bench: Bench) -> None:
    script = bench.script(scripts.PLAIN["moved"])
    bench.record(script)
    calls = [*read(bench.out).seen.calls]
    source = bench.folder.joinpath(script).read_text().splitlines()
    for call in calls:
        assert call.file == "script.py"
        assert call.function in source[call.line - 1]
    assert [call.at.call for call in calls] == list(range(1, len(calls) + 1))
    assert [call.function for call in calls][:4] == [
        "setGravity",
        "loadURDF",
        "resetBasePositionAndOrientation",
        "resetBaseVelocity",
    ]
    assert calls[2].arguments == "0, [0, 0, 10], [0, 0, 0, 1]"
    assert calls[2].at.step == 10


def test_a_call_that_raised_is_told_so(plain: Plain) -> None:
    bench = plain("errors")
    raised = {call.function: call.raised for call in read(bench.out).seen.calls if call.raised}
    assert raised["loadURDF"] == "error: Cannot load URDF file."


def test_forces_from_outside_are_recorded_as_given(plain: Plain) -> None:
    bench = plain("numpy")
    seen = read(bench.out).seen
    (push,) = seen.calls.pushes()
    assert push.vector == (1.0, 0.0, 0.0)
    assert push.in_world_axes
    assert (push.body.number, push.link, push.torque) == (0, -1, False)


def test_step_and_time_go_on_over_a_reset(plain: Plain) -> None:
    bench = plain("reset")
    steps = sorted({step for step, _ in states(bench.out)})
    assert steps == list(range(121))
    # The same body again is the same entity: three episodes are no six bodies.
    assert {body for _, body in states(bench.out)} == {1}
    put = [row["sim_step"] for row in put_rows(bench.out, 1)]
    assert put == [40, 80]


@pytest.mark.parametrize(
    "how", some([{"seed": 2**63 - 1, "steps": 2**63 - 1}, {"seed": 1 - 2**63}], 1)
)
def test_the_largest_numbers_that_are_taken_are_read_back(
    bench: Bench, how: dict[str, int]
) -> None:
    bench.record(bench.script(scripts.PLAIN["box"]), **how)
    origin = read(bench.out).origin
    assert {name: origin[name] for name in how} == how


@pytest.mark.parametrize("timestep", some(["nan", "inf", "-inf", "1e12"], 1))
def test_a_timestep_that_is_no_time_costs_no_recording(bench: Bench, timestep: str) -> None:
    script = bench.script(
        scripts.HEAD
        + f"""
p.setGravity(0, 0, 0)
p.createMultiBody(1, basePosition=[0, 0, 1])
for timestep in [1 / 4, float("{timestep}"), 1 / 2]:
    p.setTimeStep(timestep)
    p.stepSimulation()
    p.stepSimulation()
p.disconnect()
p.connect(p.DIRECT)
p.createMultiBody(1)
p.stepSimulation()
show(p)
"""
    )
    recorded, printed = bench.record(script, steps=100)
    assert (recorded.ended, printed) == ("finished", bench.bare(script).stdout)
    times_s = [row["sim_time"] / 1e9 for row in rows(bench.out, "state")]
    assert times_s[:3] == [0, 0.25, 0.5]
    notes = closing(bench.out).get("notes")
    if timestep == "1e12":
        assert (times_s[3:7], notes) == ([9e9] * 4, None)
        return
    assert times_s[3:8] == [0.5, 0.5, 1.0, 1.5, 1.5]
    assert notes == [f"from step 2 on the timestep is {timestep} s: such steps take no time"]


def test_a_timestep_that_is_no_number_is_analyzed(bench: Bench) -> None:
    script = bench.script(
        scripts.PLAIN["box"] + "p.setTimeStep(float('nan'))\np.stepSimulation()\n"
    )
    bench.record(script)
    done = bench.drop("analyze", "out.rrd")
    assert done.returncode == 0, done.stderr
    assert "99.58 % explained; from 1 s on not all: timestep" in " ".join(done.stdout.split())


def test_a_step_returns_what_it_returns_without_us(bench: Bench) -> None:
    """We request the solver's report; a script gets it only if it requests it itself."""
    script = bench.script(
        scripts.HEAD
        + """
p.loadURDF("cube_small.urdf")
print(p.stepSimulation())
p.setPhysicsEngineParameter(reportSolverAnalytics=1)
print(p.stepSimulation())
p.setPhysicsEngineParameter(reportSolverAnalytics=-1)
print(p.stepSimulation())
p.setPhysicsEngineParameter(reportSolverAnalytics=2)
print(p.stepSimulation())
p.setPhysicsEngineParameter(reportSolverAnalytics=3)
print(p.stepSimulation())
p.setPhysicsEngineParameter(reportSolverAnalytics=0)
print([p.stepSimulation() for _ in range(20)])
p.setPhysicsEngineParameter(reportSolverAnalytics=1)
p.resetSimulation()
p.loadURDF("cube_small.urdf")
print(p.stepSimulation())
if not os.fork():
    print(p.stepSimulation(), flush=True)
    os._exit(0)
os.wait()
p.resetSimulation()
import sys
del sys.modules["pybullet"]
import pybullet as again
again.loadURDF("cube_small.urdf")
print([again.stepSimulation() for _ in range(20)])
"""
    )
    bare = bench.bare(script)
    assert "numIterationsUsed" in bare.stdout
    assert bench.record(script)[1] == bare.stdout


@pytest.mark.long
def test_a_solver_with_more_islands_than_pybullet_reports_is_not_asked(bench: Bench) -> None:
    """PyBullet keeps 64 reports but reads past them, which may crash the process."""
    script = bench.script(
        scripts.HEAD
        + """
p.setPhysicsEngineParameter(minimumSolverIslandSize=1, numSolverIterations=1)
ball = p.createCollisionShape(p.GEOM_SPHERE, radius=0.1)
plate = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.2, 0.2, 0.1])
for i in range(100):
    p.createMultiBody(0, plate, -1, [i, 0, 0])
    p.createMultiBody(1, ball, -1, [i, 0, 0.199])
p.setGravity(0, 0, -10)
for _ in range(64):
    p.stepSimulation()
"""
    )
    bench.record(script)
    assert read(bench.out).seen.solvers == []


@pytest.mark.long
def test_a_block_leaves_what_a_step_returns_as_it_was(bench: Bench) -> None:
    script = bench.script(
        scripts.HEAD
        + """
from drop_physics import record
p.loadURDF("cube_small.urdf")
p.setPhysicsEngineParameter(reportSolverAnalytics=1)
found = [p.stepSimulation()]
with record("out.rrd"):
    found += [p.stepSimulation() for _ in range(9)]
found.append(p.stepSimulation())
print({len(one[0]) for one in found})
"""
    )
    done = bench.bare(script)
    assert done.stdout == "{4}\n", done.stderr


def test_clients_one_after_the_other_go_on(plain: Plain) -> None:
    bench = plain("disconnects")
    steps = [step for step, _ in states(bench.out)]
    assert steps == sorted(set(steps))
    assert len(steps) == 3 * 21


def test_clients_side_by_side_have_bodies_and_steps_of_their_own(plain: Plain) -> None:
    bench = plain("client")
    found = states(bench.out)
    assert {body for _, body in found} == {1, 3}
    assert max(step for step, body in found if body == 1) == 100
    assert max(step for step, body in found if body == 3) == 50


def test_bodies_come_and_go_and_ids_are_used_again(plain: Plain) -> None:
    bench = plain("come_and_go")
    found = states(bench.out)
    came = list(told(bench.out, "bodies"))
    assert [row["body"]["label"] for row in came][:2] == ["0_plane", "1_cube_small"]
    assert came[-1]["body"]["label"].endswith("_sphere_small")
    last = max(step for step, _ in found)
    assert last == 80
    gone = [row["sim_step"] for row in came if not row["there"]]
    assert sorted(gone) == [20, 40, 60]


@pytest.mark.starts
def test_arguments_may_be_long(bench: Bench) -> None:
    text = "import pybullet as p\np.connect(p.DIRECT)\np.stepSimulation()\n"
    given = [str(number) + "," * 5_000 for number in range(20)]  # a program may have 2 MB of them
    bench.record(bench.script(text), *given)
    assert read(bench.out).origin["arguments"] == given


def test_a_constraint_takes_the_entity_of_one_that_is_gone(bench: Bench) -> None:
    text = """
        p.connect(p.DIRECT)
        bodies = [p.createMultiBody(1, -1, -1, [x, 0, 1]) for x in range(3)]
        def hold(body, kind):
            return p.createConstraint(body, -1, -1, -1, kind, [0] * 3, [0, 0, 0], [body, 0, 1])
        lasting = hold(bodies[0], p.JOINT_FIXED)
        for cycle in range(200):
            p.setGravity(0, 0, -cycle)
            kinds = (p.JOINT_FIXED, p.JOINT_POINT2POINT)[cycle % 3 == 0:]
            held = [hold(body, kind) for body, kind in zip(bodies[1:], kinds)]
            p.stepSimulation()
            for each in held:
                print(each, *p.getConstraintState(each))
                p.removeConstraint(each)
    """
    _, printed = bench.record(bench.script("import pybullet as p" + textwrap.dedent(text)))
    forces_n = {int(number): values for number, *values in map(str.split, printed.splitlines())}
    recording = read(bench.out)
    forces = recording.seen.sampled.piece(0, 1000).forces
    lasting = (0, min(forces_n) - 1)
    assert forces.keys() == {lasting, *((0, number) for number in forces_n)}
    assert len(forces[lasting][0]) == 200
    for number, values in forces_n.items():
        _, recorded_n = forces[0, number]
        assert recorded_n.tolist() == [[*map(float, values)]]
    assert sum(entity.startswith("constraints/") for entity in recording.entities) == 3
    assert bench.out.stat().st_size < 200 * 3000  # 5 kB of each as an entity of its own


def test_a_body_that_is_made_and_removed_again_and_again_costs_what_is_new_of_it(
    bench: Bench,
) -> None:
    text = """
        p.connect(p.DIRECT)
        shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.1, 0.1, 0.1])
        look = p.createVisualShape(p.GEOM_BOX, halfExtents=[0.1, 0.1, 0.1])
        for cycle in range(200):
            b = p.createMultiBody(1, shape, look, [0, 0, 1])
            p.resetBaseVelocity(b, [0, 0, cycle])
            p.stepSimulation()
            print(p.getBasePositionAndOrientation(b)[0][2])
            p.removeBody(b)
            if cycle == 150:
                p.stepSimulation()
    """
    recorded, printed = bench.record(bench.script("import pybullet as p" + textwrap.dedent(text)))
    seen = read(bench.out).seen
    assert seen.bases["position_m"][:, 2].tolist() == [1.0, *map(float, printed.split())]
    assert (recorded.samples, len(seen.appearances)) == (202, 400)
    assert bench.out.stat().st_size < 200 * 3000  # 3 MB as a chunk for each of them
    # It is gone where time went on without it, and at the end.
    gone = {
        row["sim_step"] for row in rows(bench.out, "world/0_box") if "Clear:is_recursive" in row
    }
    assert len(gone) == 2


def test_images_are_recorded_as_the_script_got_them(bench: Bench) -> None:
    script = bench.script(
        scripts.PLAIN["camera"].replace("print(total)", "picture[2].tofile('last.bin')")
    )
    recorded, _ = bench.record(script)
    assert recorded.frames == 6
    images = [row for row in rows(bench.out, "camera/0/image") if row.get("EncodedImage:blob")]
    assert [row["sim_step"] for row in images] == [1, 21, 41]
    import io

    from PIL import Image

    blob = images[-1]["EncodedImage:blob"][0]
    pixels = np.asarray(Image.open(io.BytesIO(bytes(blob))))
    theirs = np.fromfile(bench.folder / "last.bin", np.uint8).reshape(48, 64, 4)
    assert np.array_equal(pixels, theirs[:, :, :3])


# -- windows, sleeping, real time -----------------------------------------------------------------


def test_a_window_is_not_opened_and_answers_as_if_nobody_touched_it(bench: Bench) -> None:
    script = bench.script(
        scripts.WINDOW
        + """
slider = p.addUserDebugParameter("gain", 0, 10, 2.5)
button = p.addUserDebugParameter("press", 1, 0, 0)
print(p.readUserDebugParameter(slider), p.readUserDebugParameter(button))
line = p.addUserDebugLine([0, 0, 0], [1, 1, 1])
text = p.addUserDebugText("hello", [0, 0, 0])
same = p.addUserDebugText("again", [0, 0, 0], replaceItemUniqueId=text)
print(line >= 0, text > line, same == text)
p.removeUserDebugItem(line)
p.resetDebugVisualizerCamera(3, 45, -30, [0, 0, 1])
camera = p.getDebugVisualizerCamera()
print(camera[0] > 0, camera[8:12], len(camera[2]), camera[2][15])
print(p.getKeyboardEvents(), p.getMouseEvents(), p.isConnected())
print(p.getConnectionInfo()["connectionMethod"] == p.GUI, p.connect(p.SHARED_MEMORY))
"""
    )
    recorded, printed = bench.record(script)
    assert recorded.ended == "finished", recorded.error
    assert printed.splitlines()[:5] == [
        "2.5 0.0",
        "True True True",
        "True (45, -30, 3, (0, 0, 1)) 16 1.0",
        "{} () 1",
        "True -1",
    ]


@pytest.mark.long
def test_sleeping_passes_at_once(bench: Bench) -> None:
    script = bench.script(
        scripts.WINDOW
        + """
began = time.time()
for i in range(240):
    p.stepSimulation()
    time.sleep(1 / 240)
print(round(time.time() - began, 2))
while time.monotonic() - 0 < 0:
    pass
end = time.perf_counter() + 0.5
while time.perf_counter() < end:
    pass
import os
real = os.times().elapsed
time.sleep(50)
print(os.times().elapsed - real < 50)
"""
    )
    recorded, printed = bench.record(script)
    assert printed.splitlines()[:2] == ["1.0", "True"]
    assert recorded.samples == 241


def test_the_standard_library_keeps_the_real_clock(bench: Bench) -> None:
    script = bench.script(
        scripts.WINDOW
        + """
import queue, threading, subprocess, sys
began = time.process_time()
try:
    queue.Queue().get(timeout=0.2)
except queue.Empty:
    print("empty")
done = threading.Event()
threading.Timer(0.1, done.set).start()
print(done.wait(600))
print(subprocess.run([sys.executable, "-c", "print(1)"], timeout=600, capture_output=True).stdout)
"""
    )
    _, printed = bench.record(script)
    assert printed.splitlines()[:3] == ["empty", "True", "b'1\\n'"]


def test_real_time_is_stepped_by_a_virtual_clock(bench: Bench) -> None:
    notes: list[str] = []
    script = bench.script(
        scripts.WINDOW
        + """
p.setRealTimeSimulation(1)
for i in range(100):
    time.sleep(0.01)
print(p.getBasePositionAndOrientation(b)[0][2] < 0.9)
"""
    )
    recorded, printed = bench.record(script, note=notes.append)
    assert printed.splitlines()[0] == "True"
    assert recorded.samples == 241  # a second, and nothing else
    assert any("real-time" in one for one in notes)


def test_real_time_without_a_window_never_steps_as_it_never_does(bench: Bench) -> None:
    text = (
        scripts.WINDOW.replace("p.GUI", "p.DIRECT")
        + """
p.setRealTimeSimulation(1)
for i in range(10):
    time.sleep(0.01)
show(p)
"""
    )
    script = bench.script(text)
    recorded, printed = bench.record(script)
    assert printed == bench.bare(script).stdout
    assert recorded.samples == 1


@pytest.mark.long
@pytest.mark.parametrize(
    "loop",
    [
        "while True:\n    p.stepSimulation()",
        "while True:\n    p.stepSimulation()\n    time.sleep(1 / 240)",
        "while p.isConnected():\n    time.sleep(1)",
        "while True:\n    p.getKeyboardEvents()",
        "p.setRealTimeSimulation(1)\nwhile 1:\n    p.getBasePositionAndOrientation(b)",
        "began = time.time()\nwhile time.time() < began + 1e9:\n    pass",
        "while True:\n    try:\n        p.stepSimulation()\n    except:\n        pass",
    ],
)
def test_a_loop_without_an_end_is_ended(bench: Bench, loop: str) -> None:
    recorded, _ = bench.record(bench.script(scripts.WINDOW + loop), duration_s=0.1)
    assert recorded.ended == "duration"
    assert closing(bench.out)["ended"] == ["duration"]


def test_reading_the_clock_is_no_waiting(bench: Bench) -> None:
    """An example is numba, which reads the clock while it compiles."""
    text = "def work():\n    for _ in range(100_000):\n        time.perf_counter()\n"
    text += "work()\nfor _ in range(3):\n    p.stepSimulation()\n    work()\n"
    recorded, _ = bench.record(bench.script(scripts.WINDOW + text), duration_s=2.0)
    assert (recorded.ended, recorded.samples) == ("finished", 4)


def test_a_fixed_joint_that_is_commanded_is_no_motor(tmp_path: Path) -> None:
    """It has no columns in its body's rows, in which other joints may have no commands."""
    scene = "r = p.loadURDF('r2d2.urdf')\nassert p.getJointInfo(r, 0)[2] == p.JOINT_FIXED\n"
    call = "p.setJointMotorControl2(r, 0, p.POSITION_CONTROL, 0.5, force=65)\n"
    seen = scenes.record(scene + call + "steps(3)", tmp_path / "fixed.rrd").seen
    assert set(seen.samples.values()) == {4}


@pytest.mark.parametrize(
    ("timing", "told"),
    [
        ("began = time.time()\nrun(9)\nprint(time.time() - began)", True),
        ("began = time.time()\nrun(9)\ntime.sleep(0.1)", False),  # before any step
        ("run(9)\nprint(time.perf_counter_ns())\nrun(9)\ntime.time()", True),
    ],
)
def test_simulated_time_is_said_once_where_a_script_times_itself(
    bench: Bench, timing: str, told: bool
) -> None:
    source = (
        "import time, pybullet as p\np.connect(p.DIRECT)\n"
        "def run(n):\n    for _ in range(n): p.stepSimulation()\n" + timing + "\n"
    )
    script = bench.script(source)
    notes: list[str] = []
    bench.record(script, note=notes.append)
    said = [one for one in notes if "shows simulated time" in one]
    assert len(said) == told
    lines = [n for n, text in enumerate(source.splitlines(), 1) if "print" in text]
    assert not said or f"{Path(script).name}:{lines[0]} shows" in said[0]
    assert not said or "--keep-sleeping" in said[0]


def test_a_script_that_reads_the_clock_until_a_time_gets_there(bench: Bench) -> None:
    script = bench.script(
        scripts.WINDOW
        + """
p.setTimeStep(1)
for _ in range(100):
    p.stepSimulation()
began = time.time()
while time.time() < began + 0.1:
    pass
print(round(time.time() - began, 4))
"""
    )
    recorded, printed = bench.record(script)
    assert (recorded.ended, recorded.samples) == ("finished", 101)
    assert float(printed.splitlines()[0]) == 0.1


@pytest.mark.parametrize(
    "loop", ["while p.isConnected():\n    time.sleep(1)", "while True:\n    p.getKeyboardEvents()"]
)
def test_a_script_that_waits_for_a_user_is_ended_and_says_why(bench: Bench, loop: str) -> None:
    recorded, _ = bench.record(bench.script(scripts.WINDOW + loop))
    assert recorded.ended == "idle"
    assert "stopped after waiting 60 s without a step" in str(recorded)
    assert json.loads(bench.drop("info", "out.rrd", "--json").stdout)["what"].endswith(
        ", stopped after waiting 60 s without a step"
    )
    assert "without a step: 2 bodies" in bench.drop("analyze", "out.rrd").stdout


def test_a_script_has_no_limit_of_its_own(bench: Bench) -> None:
    script = bench.script(
        scripts.WINDOW + "p.setTimeStep(1)\nfor _ in range(100):\n    p.stepSimulation()"
    )
    notes: list[str] = []
    recorded, _ = bench.record(script, note=notes.append)
    assert (recorded.ended, recorded.samples, notes) == ("finished", 101, [])
    assert "duration_s" not in read(bench.out).origin
    again = bench.drop("info", "out.rrd").stdout
    assert "drop record script.py" in again


@pytest.mark.parametrize(
    ("how", "said"), [({}, 1), ({"duration_s": 9.0}, 0), ({"progress": lambda *_: None}, 0)]
)
def test_a_script_that_may_never_end_is_named_once(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, how: dict[str, Any], said: int
) -> None:
    monkeypatch.setattr(stage, "NAMED_AFTER_S", 0.0)
    notes: list[str] = []
    bench.record(bench.script(STEPS), note=notes.append, **how)
    assert len(notes) == said
    for note in notes:
        assert "still running" in note
        assert "Ctrl-C ends the script and keeps the recording" in note


@pytest.mark.long
def test_how_far_it_is_comes_in_seconds_and_steps(bench: Bench) -> None:
    told: list[tuple[float, int]] = []
    script = bench.script(
        scripts.HEAD
        + """
import subprocess
for steps in (240, 12):
    p.createMultiBody(1)
    for _ in range(steps):
        p.stepSimulation()
    p.disconnect()
    p.connect(p.DIRECT)
for _ in range(2):
    subprocess.run(["sleep", "1"])
    p.setGravity(0, 0, 0)  # what was held back for a moment is sent
"""
    )
    bench.record(script, progress=lambda *far: told.append(far))
    assert told == sorted(told)
    assert told[-1] == (pytest.approx(1.05), 252)


@pytest.mark.long
def test_before_the_disk_is_full_the_script_is_ended_and_its_recording_kept(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    room = shutil.disk_usage(bench.folder)._replace(free=writer.ROOM_BYTES + 400_000)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: room)
    script = bench.script(STEPS + "while True:\n    p.stepSimulation()\n    sum(range(10_000))")
    done = bench.drop("record", "--json", "--twice", "-o", "out.rrd", script)
    assert (done.returncode, json.loads(done.stdout)["ended"]) == (0, "disk")
    assert "every state is the same to the bit" in done.stderr
    samples = json.loads(done.stdout)["samples"]
    assert samples > 1000
    assert sorted(step for step, _ in states(bench.out)) == list(range(samples))
    assert 200_000 < bench.out.stat().st_size < 1_500_000
    assert json.loads(bench.drop("info", "out.rrd", "--json").stdout)["what"].endswith(
        ", stopped before the disk was full"
    )
    assert "stopped before the disk was full" in bench.drop("analyze", "out.rrd").stdout


def test_steps_end_it_at_that_step(bench: Bench) -> None:
    loop = "while True:\n    p.stepSimulation()"
    recorded, _ = bench.record(bench.script(scripts.WINDOW + loop), steps=17)
    assert (recorded.ended, recorded.samples) == ("steps", 18)
    assert max(step for step, _ in states(bench.out)) == 17


# -- endings --------------------------------------------------------------------------------------

STEPS = (
    scripts.HEAD
    + """
import os, sys, signal, ctypes
b = p.loadURDF("cube_small.urdf", [0, 0, 1])
for i in range(100):
    p.stepSimulation()
"""
)

ENDINGS = {
    "raise": ("raise ValueError('on purpose')", "failed", "ValueError: on purpose"),
    "exit": ("sys.exit(3)", "failed", "sys.exit(3)"),
    "exit text": ("sys.exit('bad luck')", "failed", "sys.exit('bad luck')"),
    "exit well": ("sys.exit(0)", "finished", ""),
    "exit well by its last byte": ("sys.exit(256)", "finished", ""),
    "_exit": ("os._exit(4)", "failed", "it ended with exit code 4"),
    "_exit well": ("os._exit(0)", "finished", ""),
    "crash": ("ctypes.string_at(0)", "failed", "it was ended by SIGSEGV"),
    "abort": ("os.abort()", "failed", "it was ended by SIGABRT"),
    "kill": ("os.kill(os.getpid(), signal.SIGKILL)", "failed", "it was ended by SIGKILL"),
    "close": ("os.close(1); os.closerange(3, 4096)", "finished", ""),
    "exec": ("os.execv(sys.executable, [sys.executable, '-c', ''])", "finished", ""),
    "fork": (
        "pid = os.fork()\nif pid == 0:\n    p.stepSimulation()\n    os._exit(0)\n"
        "os.waitpid(pid, 0)",
        "finished", "",
    ),
    "orphan": ("if os.fork() == 0:\n    import time\n    p.stepSimulation(); os.close(1)\n"
        "    os.close(2)\n    os.execv('/bin/sleep', ['sleep', '20'])", "finished", ""),
}  # fmt: skip


@pytest.mark.parametrize("name", some(ENDINGS, 5))
def test_whatever_ends_a_script_the_recording_is_whole(bench: Bench, name: str) -> None:
    text, ended, error = ENDINGS[name]
    recorded, _ = bench.record(bench.script(STEPS + text))
    assert (recorded.ended, recorded.error) == (ended, error)
    assert recorded.samples == 101
    assert sorted(step for step, _ in states(bench.out)) == list(range(101))
    assert not bench.folder.joinpath("out.rrd.part").exists()


@pytest.mark.starts
def test_a_script_that_fails_shows_its_own_traceback_and_exits_1(bench: Bench) -> None:
    script = bench.script(STEPS + "def f():\n    raise ValueError('on purpose')\nf()\n")
    bare, mine = bench.bare(script), bench.drop("record", script)
    assert mine.returncode == 1
    assert mine.stdout == bare.stdout
    assert bare.stderr.strip() in mine.stderr
    assert "\ndrop: the script fails; what it did until" in mine.stderr


def test_a_call_that_fails_is_said_with_what_is_behind_it(bench: Bench) -> None:
    mine = bench.drop("record", bench.script(STEPS + "p.getJointState(0, 3)\n"))
    assert mine.returncode == 1
    assert "in p.getJointState(0, 3), and 0_cube_small has no joints; what " in mine.stderr


@pytest.mark.parametrize(
    "text",
    [
        "import json\ndef f():\n    json.loads('{')  # here\nf()\n",
        "p.getJointState(0, 99)  # here\n",
    ],
)
def test_the_line_of_the_scripts_own_that_fails_is_cited(bench: Bench, text: str) -> None:
    script = bench.script(STEPS + text)
    bench.record(script)
    failed = analyze(bench.out).findings[0]
    line = (STEPS + text).partition("# here")[0].count("\n") + 1
    assert (failed.code, failed.site) == ("script-failed", f"{script}:{line}")


@pytest.mark.starts
@pytest.mark.parametrize(
    "text",
    some(
        [
            """
def load():
    p.loadURDF("nothing.urdf")
try:
    p.getBodyInfo(9)
except p.error:
    try:
        load()
    except p.error as error:
        try:
            import time; time.sleep("x")
        except TypeError:
            try:
                raise RuntimeError("on purpose") from error
            except RuntimeError as itself:
                raise itself from itself
""",
            "if:",
        ],
        1,
    ),
    ids=["chain", "syntax"],
)
def test_a_traceback_is_that_of_the_script(bench: Bench, text: str) -> None:
    script = bench.script(STEPS + text)
    bare, mine = bench.bare(script), bench.drop("record", script)
    assert bare.stderr.strip() in mine.stderr


CATCHES = """
import random, signal, sys, threading, time, traceback
def shown(call):
    try:
        call()
    except BaseException:
        traceback.print_exc(file=sys.stdout)
for call in (
    lambda: p.loadURDF("nothing.urdf"), lambda: p.getJointState(0, 99), lambda: p.stepSimulation(7),
    lambda: p.stepSimulation(x=3), lambda: p.setAdditionalSearchPath(3), lambda: p.setGravity("a"),
    lambda: p.changeDynamics(9, -1, mass=1), lambda: p.createMultiBody(foo=3),
    lambda: p.stepSimulation.foo,
    lambda: setattr(p.stepSimulation, "x", 1), lambda: delattr(p.stepSimulation, "__doc__"),
    lambda: time.sleep("x"), lambda: time.sleep(-1), lambda: random.randint(3, 1),
    lambda: random.Random([]), lambda: signal.signal("x", 3), lambda: signal.getsignal(9999),
    lambda: __import__("breaks"),
):
    shown(call)
signal.signal(signal.SIGALRM, lambda *_: 1 / 0)
shown(lambda: signal.raise_signal(signal.SIGALRM))
thread = threading.Thread(target=lambda: shown(lambda: p.getJointState(0, 99)))
thread.start()
thread.join()
"""


@pytest.mark.starts
def test_what_a_script_catches_has_no_frame_of_ours(bench: Bench) -> None:
    """The traceback, which a script may print or log, shows none of our wrappers."""
    bench.folder.joinpath("breaks.py").write_text("import numpy.random\nnumpy.random.rand('x')")
    script = bench.script(STEPS + CATCHES)
    bare = bench.bare(script)
    _, printed = bench.record(script)
    assert printed == bare.stdout
    assert printed.count("Traceback") == 19


@pytest.mark.long
@pytest.mark.parametrize("to_the_group", some([True, False], 1))
def test_ctrl_c_ends_it_with_a_whole_recording(bench: Bench, to_the_group: bool) -> None:
    script = bench.script(
        STEPS + "open('there', 'w').close()\nwhile True:\n    p.stepSimulation()\n"
        "    sum(range(10_000))"  # at 60,000 steps/s it has more to check than it proves
    )
    process = subprocess.Popen(
        [*COMMAND, "record", "--duration", "1e9", "--json", script],
        cwd=bench.folder,
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    wait_for(bench.folder.joinpath("there").exists, "the script did not come so far")
    if to_the_group:
        os.killpg(process.pid, signal.SIGINT)
    else:
        process.send_signal(signal.SIGINT)
    printed, _ = process.communicate()
    assert process.returncode == 0
    said = json.loads(printed)
    assert said["ended"] == "interrupted"
    steps = sorted(step for step, _ in states(bench.folder / said["recording"]))
    assert steps == list(range(said["samples"]))


def test_ctrl_c_that_is_ignored_stays_ignored(bench: Bench) -> None:
    """`nohup` and `&` start a program like this: neither it nor the script is interrupted."""
    script = bench.script(
        STEPS + "import os, signal\nassert signal.getsignal(signal.SIGINT) is signal.SIG_IGN\n"
        "os.kill(os.getppid(), signal.SIGINT)\nos.kill(0, signal.SIGINT)\np.stepSimulation()\n"
    )
    said = subprocess.run(
        [*COMMAND, "record", "--json", script],
        cwd=bench.folder,
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_IGN),
        check=True,
    )
    told = json.loads(said.stdout)
    assert (told["ended"], told["samples"]) == ("finished", 102)


@pytest.mark.long
def test_a_script_that_ignores_ctrl_c_is_killed(bench: Bench) -> None:
    script = bench.script(
        STEPS + "signal.signal(signal.SIGINT, signal.SIG_IGN)\nopen('there', 'w').close()\n"
        "while True:\n    pass"
    )
    process = subprocess.Popen(
        [*COMMAND, "record", "--json", script], cwd=bench.folder, stdout=subprocess.PIPE, text=True
    )
    wait_for(bench.folder.joinpath("there").exists, "the script did not come so far")
    process.send_signal(signal.SIGINT)
    process.send_signal(signal.SIGINT)
    time.sleep(0.3)
    process.send_signal(signal.SIGINT)
    printed, _ = process.communicate()
    assert json.loads(printed)["ended"] == "interrupted"
    assert json.loads(printed)["samples"] == 101


@pytest.mark.long
def test_a_killed_recorder_takes_the_script_with_it_and_leaves_what_was_written(
    bench: Bench,
) -> None:
    script = bench.script(
        STEPS + "open('there', 'w').write(str(os.getpid()))\nn = 0\nwhile True:\n"
        "    p.stepSimulation(); n += 1\n    if n == 20_000: open('far', 'w').close()"
    )
    process = subprocess.Popen(
        [*COMMAND, "record", "--duration", "1e9", "--out", "out.rrd", script], cwd=bench.folder
    )
    wait_for(bench.folder.joinpath("far").exists, "the script did not come so far")
    process.kill()
    process.wait()
    pid = int(bench.folder.joinpath("there").read_text())
    wait_for(lambda: not _runs(pid), "the script outlives the recorder")
    assert not bench.out.exists()
    # Rerun's reader refuses a file that ends within a message; ours takes what is whole.
    assert len(read(bench.folder / "out.rrd.part").seen.bases) > 1000


def _runs(pid: int) -> bool:
    try:
        return "zombie" not in Path(f"/proc/{pid}/status").read_text()
    except OSError:
        return False


@pytest.mark.parametrize("held", [0, 12, 100])
def test_what_was_killed_before_anything_was_written_says_so(
    bench: Bench, plain: Plain, held: int
) -> None:
    bench.folder.joinpath("a.rrd.part").write_bytes(plain("box").out.read_bytes()[:held])
    for verb in ("analyze", "render"):
        done = bench.drop(verb, "a.rrd.part")
        assert done.returncode == 1
        assert done.stderr == (
            "drop: a.rrd.part holds nothing yet: the process that wrote it was stopped before its "
            "first rows were complete; record it again\n"
        )


@pytest.mark.long
def test_a_limit_on_the_size_of_files_is_one_line(bench: Bench) -> None:
    """Below a megabyte there is no room for the memory shared by script and recorder."""
    bench.script(scripts.PLAIN["box"])
    limit = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (1 << 19, 1 << 19)); "
    main = "from drop_physics.console.running import main; main()"
    block = "from drop_physics import record; record('block.rrd').__enter__()"
    for run, *arguments in ((main, "record", "script.py"), (block,)):
        done = subprocess.run(
            [sys.executable, "-P", "-c", limit + run, *arguments],
            cwd=bench.folder,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 1
        said = done.stderr.strip().splitlines()[-1]
        assert "a temporary file of 2.5 MB, which the script's process writes to," in said
        assert f"in {tempfile.gettempdir()}: File too large; make room there" in said
        assert run == block or said == done.stderr.strip()
    assert not list(bench.folder.glob("**/*.rrd*"))


def test_a_full_disk_is_one_line_and_ends_the_script(bench: Bench) -> None:
    script = bench.script(STEPS)
    done = bench.drop("record", "--out", "/dev/full", script)
    assert done.returncode == 1
    assert len(done.stderr.strip().splitlines()) == 1


# -- the command ----------------------------------------------------------------------------------


@pytest.mark.starts
def test_standard_output_is_the_scripts_alone(bench: Bench) -> None:
    script = bench.script(scripts.PLAIN["box"])
    bare, mine = bench.bare(script), bench.drop("record", script)
    assert mine.stdout == bare.stdout
    assert "recorded" in mine.stderr
    other = bench.drop("record", "--json", script)
    said = json.loads(other.stdout)
    assert said["recording"] == "recordings/script.rrd"
    assert list(said) == [
        "recording",
        "recording_id",
        "script",
        "ended",
        "error",
        "samples",
        "bodies",
        "frames",
        "bytes",
        "wall_s",
    ]
    assert bare.stdout.splitlines()[0] in other.stderr


@pytest.mark.starts
def test_a_module_runs_as_python_m_runs_it(bench: Bench) -> None:
    package = bench.folder / "mine"
    package.mkdir()
    package.joinpath("__init__.py").write_text("")
    package.joinpath("other.py").write_text("X = 5")
    package.joinpath("run.py").write_text(
        "import sys\nfrom . import other\nimport pybullet as p\np.connect(p.DIRECT)\n"
        "print(__name__, __package__, __file__, sys.argv, other.X, sys.path[0])"
    )
    bare = subprocess.run(
        [sys.executable, "-m", "mine.run", "-x"],
        cwd=bench.folder,
        capture_output=True,
        text=True,
        check=True,
    )
    mine = bench.drop("record", "-m", "mine.run", "-x")
    assert mine.stdout == bare.stdout
    assert bench.folder.joinpath("recordings/mine.run.rrd").is_file()


@pytest.mark.parametrize("name", ["-m mine", "mine.py"])
def test_options_of_ours_behind_the_script_are_its_own_and_named(bench: Bench, name: str) -> None:
    bench.script("import sys\nprint(sys.argv[1:])", "mine.py")
    own = ["--duration", "2", "--steps=3", "-x", "--mine", "m"]
    done = bench.drop("record", "--seed", "0", *name.split(), *own)
    assert done.stdout == f"{own}\n"
    said = done.stderr.splitlines()[0]
    named = name.split()[-1]
    assert said == (
        f"drop: what comes after {named} goes to the script, --duration and --steps too; put "
        "drop's options before the script"
    )
    assert "drop's options" not in bench.drop("record", *name.split(), "-x", "out").stderr


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("sim.py", "out.rrd"), "name the recording with: out='out.rrd'"),
        (("sim.py", Path("out.rrd")), "name the recording with: out='out.rrd'"),
        ((["sim.py", "--fast"],), 'record_script("sim.py", ['),
    ],
)
def test_python_says_what_to_write_in_place_of_a_wrong_call(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: Any, told: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "sim.py").write_text("raise SystemExit\n")
    with pytest.raises(ScenarioError) as raised:
        record_script(*arguments)
    assert told in str(raised.value)
    assert [each.name for each in tmp_path.iterdir()] == ["sim.py"]


def test_what_is_no_script_is_one_line(bench: Bench) -> None:
    done = bench.drop("record", "nothing.py")
    assert (done.returncode, done.stdout) == (2, "")
    assert "nothing.py" in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    script = bench.script("pass")
    with pytest.raises(ScenarioError, match=r"^steps must be at least 1"):
        bench.record(script, steps=0)
    with pytest.raises(ScenarioError, match="steps must be at least 1 and below 2"):
        bench.record(script, steps=2**63)
    for seed in (2**63, -(2**63)):
        with pytest.raises(ScenarioError, match="seed must be between"):
            bench.record(script, seed=seed)
    with pytest.raises(ScenarioError, match="duration_s must be finite and above 0"):
        bench.record(script, duration_s=0.0)
    bench.out.write_text("mine")
    done = bench.drop("record", "--out", "out.rrd", script)
    assert (done.returncode, bench.out.read_text()) == (1, "mine")
    done = bench.drop("record", "--python", "./no-such", script)
    assert "--python" in done.stderr


def test_arguments_and_names_that_are_not_utf_8_reach_the_script(bench: Bench) -> None:
    text = """
import os, sys
print(ascii(sys.argv))
b = p.loadURDF("cube_small.urdf")
p.getCameraImage(8, 8)
p.stepSimulation()
raise ValueError(sys.argv[1])
"""
    name = bench.script(scripts.HEAD + text, name="\udcff.py")
    recorded, printed = bench.record(name, "a\udcff", "\ufffd")
    assert printed.splitlines()[-1] == ascii([name, "a\udcff", "\ufffd"])
    assert (recorded.samples, recorded.frames) == (2, 1)
    assert recorded.error == "ValueError: a?"
    assert info(bench.out).what == "'\ufffd.py' 'a\ufffd' '\ufffd', failed"
    for arguments in (["a\0"], b"text", [1]):
        with pytest.raises(ScenarioError, match=r"^arguments must be a list of texts without null"):
            record_script("script.py", arguments, is_module=True)  # type: ignore[arg-type]
    with pytest.raises(ScenarioError, match=r"the script must be a Python file, got 'a.x00'"):
        record_script("a\0")
    with pytest.raises(DropError, match="cannot be started"):
        bench.record(name, python="\0")


def test_a_script_that_replaces_sys_exit_is_asked_once(bench: Bench) -> None:
    text = "import sys\nhow = sys.exit\n\ndef leave(code):\n    print('leaving')\n    how(code)\n\n"
    _, printed = bench.record(bench.script(text + "sys.exit = leave\nsys.exit(7)\n"))
    assert printed.splitlines().count("leaving") == 1


def test_what_is_no_python_leaves_the_recording_that_is_there(bench: Bench) -> None:
    bench.out.write_text("precious")
    for program, code in (("true", 0), ("false", 1)):
        path = shutil.which(program)
        assert path is not None
        with pytest.raises(DropError, match=rf"{program} ended with exit code {code} before"):
            bench.record(bench.script(scripts.HEAD), python=path)
    assert [file.name for file in bench.folder.glob("*.rrd*")] == ["out.rrd"]
    assert bench.out.read_text() == "precious"


def test_limits_are_numbers_of_any_library(bench: Bench) -> None:
    script = bench.script(scripts.HEAD + "while True:\n    p.stepSimulation()")
    recorded, _ = bench.record(
        script, steps=np.int64(3), duration_s=np.float32(1), seed=np.uint8(4)
    )
    assert (recorded.ended, recorded.samples) == ("steps", 4)
    assert " --steps 3 --duration 1 --seed 4 " in str(info(bench.out).command)
    for value in (3.5, 3.0, True, "3", np.float64(3)):
        for name in ("steps", "seed"):
            with pytest.raises(ScenarioError, match=f"^{name} must be a whole number, got "):
                bench.record(script, **{name: value})
            with (
                pytest.raises(ScenarioError, match=f"^{name} must be a whole number, got "),
                record(bench.folder / "block.rrd", **{name: value}),
            ):
                pass
    for duration_s in (True, "1", 1j, 10**400):
        with pytest.raises(ScenarioError, match=r"^duration_s must be a number, got "):
            bench.record(script, duration_s=duration_s)


BLOCK = """
import pybullet as p, time
from pybullet import stepSimulation as by_name
from show import show
from drop_physics import record
before = dict(vars(p)), time.sleep, time.time
p.connect(p.DIRECT)
p.setGravity(0, 0, -10)
b = p.createMultiBody(1, p.createCollisionShape(p.GEOM_SPHERE, radius=0.1), basePosition=[0, 0, 9])
p.stepSimulation()
with record("out.rrd") as block:
    for i in range(10):
        p.stepSimulation()
    by_name()  # is not seen: it was taken before
    p.resetBaseVelocity(b, [1, 0, 0])
    kept = p.stepSimulation
    kept()
    {more}
assert (dict(vars(p)), time.sleep, time.time) == before
p.stepSimulation()
kept()
show(p)
print(block.recorded.ended, block.recorded.samples)
with record("second.rrd") as block:
    p.stepSimulation()
print(block.recorded.ended, block.recorded.samples)
"""


@pytest.mark.long
def test_a_block_of_python_is_recorded_and_nothing_outside_of_it(bench: Bench) -> None:
    done = bench.bare(bench.script(BLOCK.replace("{more}", "")))
    assert done.returncode == 0, done.stderr
    said = [one for one in done.stdout.splitlines() if one.startswith("finished")]
    assert said == ["finished 12", "finished 2"]
    plain = BLOCK.replace("{more}", "").replace("from drop_physics import record", "")
    lines = [one for one in plain.splitlines() if "record" not in one]
    same = bench.bare(
        bench.script(
            "\n".join(
                one.removeprefix("    ")
                if "range" not in one and "        " not in one
                else one.replace("    ", "", 1)
                for one in lines
            )
        )
    )
    assert [one for one in done.stdout.splitlines() if one.startswith("0 ")] == [
        one for one in same.stdout.splitlines() if one.startswith("0 ")
    ], same.stderr
    assert len(states(bench.out)) == 12
    put = list(put_rows(bench.out, 0))
    assert [row["base"][7] for row in put] == [1.0]


SLOW = """
import os, time
import pybullet as p
from drop_physics import record
p.connect(p.DIRECT)
p.createMultiBody(1, p.createCollisionShape(p.GEOM_SPHERE, radius=0.1), basePosition=[0, 0, 9])
with record("out.rrd", steps=1000, keep_sleeping=True) as block:
    for i in range({steps}):
        p.stepSimulation()
        time.sleep({sleep})
        {more}
print(block.recorded.ended, block.recorded.samples)
"""


@pytest.mark.long
@pytest.mark.parametrize(("steps", "sleep"), [(200, 0.01), (4, 0.6)])
def test_a_block_may_take_its_time(bench: Bench, steps: int, sleep: float) -> None:
    """The block's recorder waits for data, however little is sent."""
    slow = SLOW.format(steps=steps, sleep=sleep, more="pass")
    done = bench.bare(bench.script(slow))
    assert (done.stdout, done.stderr) == (f"finished {steps + 1}\n", done.stderr)
    assert len(states(bench.out)) == steps + 1


@pytest.mark.long
def test_before_the_disk_is_full_a_block_is_left_and_its_recording_kept(bench: Bench) -> None:
    recorder = bench.folder / "recorder"
    recorder.write_text(
        f"""#!{sys.executable}
import runpy, shutil, sys
usage = shutil.disk_usage
shutil.disk_usage = lambda path: usage(path)._replace(free={writer.ROOM_BYTES + 150_000})
sys.argv = sys.argv[3:]
runpy.run_module(sys.argv[0], run_name="__main__")
"""
    )
    recorder.chmod(0o755)
    slow = SLOW.format(steps=10**6, sleep=0, more="sum(range(10_000))").replace("steps=1000, ", "")
    done = bench.bare(bench.script(f"import sys\nsys.executable = {str(recorder)!r}\n" + slow))
    ended, samples = done.stdout.split()
    assert (ended, done.stderr.count("Error")) == ("disk", 0)
    assert int(samples) > 1000
    assert sorted(step for step, _ in states(bench.out)) == list(range(int(samples)))


def test_a_block_whose_recorder_is_gone_ends_with_an_error(bench: Bench) -> None:
    kill = "i == 9 and started[0].kill()"
    script = SLOW.format(steps=10**6, sleep=0.01, more=kill).replace("steps=1000, ", "")
    script = script.replace("print(", "print('not reached', ")
    around = """import subprocess
started = []
class Popen(subprocess.Popen):
    def __init__(self, *arguments, **options):
        super().__init__(*arguments, **options)
        started.append(self)
subprocess.Popen = Popen
"""
    around += "try:\n" + "".join(f"    {line}\n" for line in script.splitlines())
    around += "except Exception as error:\n    print(type(error).__name__, error)\n"
    done = bench.bare(bench.script(around))
    assert (done.returncode, done.stdout) == (
        0,
        "OutputError out.rrd was not written: the process that writes the recording ended; is "
        "there enough memory? Record it again\n",
    ), done.stderr


@pytest.mark.long
def test_a_block_that_crashes_or_raises_leaves_a_whole_recording(bench: Bench) -> None:
    crash = bench.script(BLOCK.replace("{more}", "import os; os.kill(os.getpid(), 11)"))
    assert bench.bare(crash).returncode == -signal.SIGSEGV
    wait_for(bench.out.exists, "no recording, although the recorder outlives the script")
    assert len(states(bench.out)) == 12
    assert closing(bench.out)["ended"] == ["failed"]
    bench.out.unlink()
    fails = bench.script(BLOCK.replace("{more}", "1 / 0"))
    assert "ZeroDivisionError" in bench.bare(fails).stderr
    assert closing(bench.out)["error"] == ["ZeroDivisionError: division by zero"]


FORKS = """
import os, sys
import pybullet as p
from drop_physics import record
p.connect(p.DIRECT)
p.createMultiBody(1, p.createCollisionShape(p.GEOM_SPHERE, radius=0.1), basePosition=[0, 0, 9])
with record("out.rrd") as block:
    p.stepSimulation()
    for does in ("exits", "ends", "raises", "leaves"):
        if not (child := os.fork()):
            break
        print(does, os.waitpid(child, 0)[1] >> 8)
    p.stepSimulation()
    if not child:
        if does == "exits":
            sys.exit(3)
        elif does == "ends":
            os._exit(4)
        elif does == "raises":
            1 / 0
if child:
    print(block.recorded.ended, block.recorded.samples)
else:
    print("after", block.recorded)
"""


@pytest.mark.long
def test_a_forked_child_of_a_block_ends_as_it_would(bench: Bench) -> None:
    """The parent's recording continues without the child."""
    done = subprocess.run(
        [sys.executable, bench.script(FORKS)],
        cwd=bench.folder,
        capture_output=True,
        text=True,
        check=False,
        timeout=HANGS_S,
    )
    assert [one for one in done.stdout.splitlines() if not one.startswith(BANNER)] == [
        "exits 3",
        "ends 4",
        "raises 1",
        "after None",
        "leaves 0",
        "finished 3",
    ], done.stderr
    assert done.stderr.count("ZeroDivisionError") == 1
    assert len(states(bench.out)) == 3


@pytest.mark.long
def test_a_block_that_is_killed_leaves_a_whole_recording_and_no_traceback(bench: Bench) -> None:
    script = bench.script(BLOCK.replace("{more}", "import os; os.kill(os.getpid(), 9)"))
    # Its standard error ends when the recorder has ended too.
    done = bench.bare(script)
    assert (done.returncode, done.stderr.partition("\n")[2]) == (-signal.SIGKILL, "")
    assert len(states(bench.out)) == 12


@pytest.mark.long
def test_seeded_it_is_the_same_and_unseeded_it_says_so(bench: Bench) -> None:
    script = bench.script(
        scripts.HEAD
        + """
import random
import numpy as np
at = [random.random(), np.random.rand(), np.random.default_rng().random()]
random.seed()
at[0] += random.Random().random() + random.random()
for name in {"a", "b", "c", "d", "e"}:
    at[1] = 2 * at[1] + ord(name)
b = p.loadURDF("cube_small.urdf", at)
p.stepSimulation()
print(at)
"""
    )
    notes: list[str] = []
    recorded, first = bench.record(script, note=notes.append, twice=True)
    assert recorded.first_difference == 0
    for drawn in ("random.random at script.py:10", "numpy.random.rand at script.py:10"):
        assert any(drawn in one for one in notes)
    assert any("numpy.random.SeedSequence at script.py:10" in one for one in notes)
    again = [bench.record(script, note=notes.append, seed=7, twice=True) for _ in range(2)]
    assert again[0][1] == again[1][1] != first
    assert [one.first_difference for one, _ in again] == [None, None]
    assert closing(bench.out).get("made_with_unseeded") is None


@pytest.mark.parametrize(
    ("draws", "unseeded"),
    [
        (
            "np.random.seed(0); np.random.rand(); random.seed(0); random.random()\n"
            "np.random.RandomState(3).rand(); np.random.default_rng(3).random()\n"
            "random.setstate(random.Random(1).getstate()); random.random()\n"
            "np.random.set_state(np.random.RandomState(1).get_state()); np.random.rand()\n"
            "import copy; copy.deepcopy(np.random.default_rng(3)).random()",
            "",
        ),
        ("np.random.RandomState().rand()", "numpy.random.SeedSequence"),
        ("np.random.seed(0); np.random.seed(); np.random.ranf()", "by numpy.random.ranf at script"),
    ],
)
def test_numbers_are_unseeded_only_where_they_are(bench: Bench, draws: str, unseeded: str) -> None:
    script = bench.script(
        f"{scripts.HEAD}\nimport random, numpy as np\n{draws}\np.stepSimulation()\n"
    )
    notes: list[str] = []
    bench.record(script, note=notes.append)
    said = [one for one in notes if "unseeded" in one]
    assert len(said) == bool(unseeded)
    assert unseeded in "".join(said)


@pytest.mark.parametrize(
    ("folder", "line", "unseeded"),
    some(
        [
            ("site-packages", "import drawing", ""),
            ("site-packages", "import drawing\ndrawing.draw()", "at script.py:11"),
            # What it makes may be seeded before it draws.
            ("site-packages", "import drawing\ndrawing.Deck().shuffle(1)", ""),
            ("site-packages", "import drawing\ndrawing.Deck().shuffle(None)", "at script.py:11"),
            (
                "site-packages",
                "import drawing\nrandom.random()",
                "by random.random at script.py:11",
            ),
            ("mine", "import drawing", "/drawing.py:4"),
        ],
        1,
    ),
)
def test_what_a_library_draws_while_it_is_imported_is_its_own(
    bench: Bench, folder: str, line: str, unseeded: str
) -> None:
    bench.folder.joinpath(folder).mkdir()
    bench.script(
        "import random, numpy as np\n\ndef draw():\n    random.random()\n"
        "    np.random.rand()\n    np.random.default_rng().random()\n\n"
        "exec('draw()')\n\nclass Deck:\n"
        "    def __init__(self):\n        self.drawn = np.random.default_rng()\n\n"
        "    def shuffle(self, seed):\n        np.random.default_rng(seed)\n",
        f"{folder}/drawing.py",
    )
    script = bench.script(
        f"{scripts.HEAD}\nimport random, sys\nsys.path.insert(0, '{folder}')\n{line}\n"
        "p.stepSimulation()\n"
    )
    notes: list[str] = []
    bench.record(script, note=notes.append)
    said = [one for one in notes if "unseeded" in one]
    assert len(said) == bool(unseeded)
    assert unseeded in "".join(said)


@pytest.mark.parametrize("off", ["False", "enableRealTimeSimulation=0, physicsClientId=0"])
def test_the_call_that_turned_real_time_on_is_cited(bench: Bench, off: str) -> None:
    script = bench.script(
        f"{scripts.WINDOW}p.setRealTimeSimulation({off})\np.setRealTimeSimulation(1)\n"
        "time.sleep(0.1)\n"
    )
    bench.record(script)
    (said,) = (one.site for one in analyze(bench.out).findings if one.code == "real-time")
    line = (
        bench.folder.joinpath(script).read_text().splitlines().index("p.setRealTimeSimulation(1)")
    )
    assert said == f"script.py:{line + 1}"


def test_a_pipe_is_no_script(bench: Bench) -> None:
    """The script's text would be read before it runs, so the script would be empty."""
    os.mkfifo(bench.folder / "pipe.py")
    with pytest.raises(ScenarioError, match="read only once"):
        bench.record(bench.folder / "pipe.py")


def test_a_script_that_dies_before_its_first_step_says_so(bench: Bench) -> None:
    """The script did connect, and loaded a body."""
    script = bench.script(
        f'{scripts.HEAD}\np.loadURDF("cube_small.urdf")\nimport os\nos.kill(os.getpid(), 9)\n'
    )
    notes: list[str] = []
    recorded, _ = bench.record(script, note=notes.append)
    assert (recorded.samples, recorded.error) == (0, "it was ended by SIGKILL")
    assert notes == ["nothing was simulated: the script ended before its first step"]


def test_a_run_that_draws_unseeded_may_be_the_same(bench: Bench) -> None:
    """The random numbers need not affect any body."""
    script = bench.script(f"{scripts.HEAD}\nimport random\nrandom.random()\np.stepSimulation()\n")
    recorded, _ = bench.record(script, twice=True)
    assert recorded.first_difference is None
    (said,) = (one for one in analyze(bench.out).findings if one.code == "unseeded")
    assert said.level == "repeat"


def test_uninitialised_memory_shows_in_two_recordings(bench: Bench) -> None:
    script = bench.script(
        scripts.HEAD
        + """
p.loadMJCF("mjcf/humanoid.xml")
for i in range(200):
    p.stepSimulation()
"""
    )
    notes: list[str] = []
    recorded, _ = bench.record(script, note=notes.append, twice=True)
    assert recorded.first_difference is not None
    assert "MALLOC_PERTURB_" in notes[-1]


@pytest.mark.parametrize("cut", [0, 1, 7, 8, 9, 12, 13, 400, 2000, 2001])
def test_a_stream_that_ends_at_any_byte_is_understood_up_to_there(cut: int) -> None:
    sent = pipe.MAGIC
    for number in range(100):
        payload = bytes([number]) * number
        sent += pipe.HEADER.pack(pipe.SAMPLE, len(payload)) + payload
    for pieces in (1, 3, 4096):
        frames, found = FrameStream(), []
        for start in range(0, cut, pieces):
            found += list(frames.feed(sent[start : min(cut, start + pieces)]))
        assert [payload for _, payload in found] == [bytes([n]) * n for n in range(len(found))]
        whole = len(pipe.MAGIC) + sum(pipe.HEADER.size + n for n in range(len(found)))
        assert whole <= max(cut, len(pipe.MAGIC)) < whole + pipe.HEADER.size + len(found) + 9


@pytest.mark.parametrize(
    "garbage",
    [b"garbage" * 9, b"Some text of its own", b"\0" * 90],
    ids=["no kind", "too long", "zeros"],
)
def test_frames_end_where_somebody_else_has_written_into_the_stream(garbage: bytes) -> None:
    frames = FrameStream()
    sent = [pipe.frame(pipe.SAMPLE, b"12345"), garbage, pipe.frame(pipe.SAMPLE, b"67890")]
    found = list(frames.feed(pipe.MAGIC)) + [one for data in sent for one in frames.feed(data)]
    assert found == [(pipe.SAMPLE, b"12345")]
    assert frames.broken


OVERWRITES = """
for fd in range(3, 30):
    try:
        os.write(fd, b'garbage' * 9)
    except OSError:
        pass
"""
CLOSES = "os.closerange(3, 4096)\n"
FILLS = "for i in range(4):\n    p.getCameraImage(300, 300)\n"


@pytest.mark.parametrize(
    ("does", "samples", "why"),
    [
        (OVERWRITES, None, "wrote into"),
        (CLOSES + FILLS, 101, "closed"),
        (CLOSES, 201, ""),  # the block of shared memory holds as much
    ],
    ids=["writes", "closes", "closes and does little"],
)
def test_a_recording_ends_where_the_script_takes_the_pipe_and_says_so(
    bench: Bench, does: str, samples: int | None, why: str
) -> None:
    rest = "for i in range(100):\n    p.stepSimulation()\n"
    notes: list[str] = []
    recorded, _ = bench.record(bench.script(STEPS + does + rest), note=notes.append)
    assert recorded.ended == "finished"
    assert samples is None or recorded.samples == samples
    counted = f"{recorded.samples} sample{'s' * (recorded.samples != 1)}"
    told = f"the recording ends after {counted}: the script {why} drop's pipe"
    assert notes == ([told] if why else [])
    assert len(states(bench.out)) == recorded.samples
    assert info(bench.out).notes == notes


TAKES_PART = {
    "over it": 'open(part, "wb").write(b"mine")',
    "into it": 'file = open(part, "r+b")\nfile.seek(300)\nfile.write(b"mine")',
    "instead": 'os.remove(part)\nopen(part, "wb").write(b"mine")',
}


@pytest.mark.parametrize("how", TAKES_PART)
def test_a_script_that_writes_to_our_unfinished_file_is_one_line(bench: Bench, how: str) -> None:
    text = "import os\np.stepSimulation()\npart = 'out.rrd.part'\nassert os.path.isfile(part)\n"
    text += TAKES_PART[how] + "\nfor _ in range(300):\n    p.stepSimulation()\n"
    done = bench.drop("record", "--out", "out.rrd", bench.script(scripts.WINDOW + text))
    said = [one for one in done.stderr.splitlines() if not one.startswith(BANNER)]
    assert (done.returncode, said) == (
        1,
        [
            "drop: what was written for out.rrd does not verify; run it again, under another name "
            "if something else writes to out.rrd.part"
        ],
    )
    left = {path.name for path in bench.folder.iterdir()} - {"script.py", "show.py", "__pycache__"}
    assert left == ({"out.rrd.part"} if how == "instead" else set())  # which is the script's own


def test_a_working_directory_that_is_gone_does_not_reach_the_script(bench: Bench) -> None:
    bench.folder.joinpath("mine.py").write_text("def push(p):\n    p.setGravity(0, 0, -1)\n")
    text = "import os, tempfile, mine\nfolder = tempfile.mkdtemp()\nos.chdir(folder)\n"
    text += "os.rmdir(folder)\nmine.push(p)\np.stepSimulation()\n"
    recorded, _ = bench.record(bench.script(scripts.WINDOW + text))
    assert (recorded.ended, recorded.samples) == ("finished", 2)


@pytest.mark.starts
@pytest.mark.long
def test_pybullet_that_is_imported_again_is_recorded_too(bench: Bench) -> None:
    again = """
import importlib, sys
first = p.stepSimulation
importlib.reload(p)
p.stepSimulation()
del sys.modules["pybullet"]
import pybullet as q
assert q is not p
for step in (q.stepSimulation, p.stepSimulation, first):
    step()
show(q)
"""
    script = bench.script(STEPS + again)
    bare = bench.bare(script)
    recorded, printed = bench.record(script)
    assert printed == bare.stdout
    assert recorded.error == ""
    assert recorded.samples == 105
    block = (
        "import sys\nfrom drop_physics import record\n"
        "with record('out.rrd', force=True) as block:\n"
        "    del sys.modules['pybullet']\n    import pybullet as q\n"
        "    q.stepSimulation()\n    kept = q.stepSimulation\nkept()\nq.stepSimulation()\n"
        "assert type(q.stepSimulation) is type(len)\nprint(block.recorded.samples)\n"
    )
    done = bench.bare(bench.script(STEPS + block))
    assert done.stdout.splitlines()[-1] == "2", done.stderr


OTHER_MODULES = """
import importlib.util, os, shutil, sys
import pybullet as p
def loaded(name, path):
    spec = importlib.util.spec_from_file_location(name, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
def beside(how):
    os.mkdir("vendored")
    how(p.__file__, "vendored/pybullet.so")
    from vendored import pybullet
    return pybullet
q = {load}
q.connect(q.DIRECT)
q.createMultiBody(1, q.createCollisionShape(q.GEOM_SPHERE, radius=0.1))
for _ in range(7):
    q.stepSimulation()
"""


@pytest.mark.starts
@pytest.mark.parametrize(
    "load",
    some(
        [
            "loaded('pybullet', p.__file__)",
            "loaded('mine.pybullet', p.__file__)",
            "beside(os.symlink)",
        ],
        1,
    ),
)
def test_pybullet_as_another_module_is_recorded(bench: Bench, load: str) -> None:
    recorded, _ = bench.record(bench.script(OTHER_MODULES.replace("{load}", load)))
    assert (recorded.ended, recorded.samples) == ("finished", 8)


@pytest.mark.long
@pytest.mark.starts
def test_a_copy_of_pybullet_is_recorded_alone_and_named_beside_another(bench: Bench) -> None:
    """The copy has its own simulations, with the same ids."""
    notes: list[str] = []
    text = OTHER_MODULES.replace("{load}", "beside(shutil.copy)")
    recorded, _ = bench.record(bench.script(text), note=notes.append)
    assert recorded.samples == 0
    assert notes == [
        "vendored/pybullet.so is a second copy of PyBullet, with simulations of its own: they are "
        "not recorded"
    ]
    alone = "import vendored.pybullet as q\n" + text.partition("q = ")[2].partition("\n")[2]
    recorded, _ = bench.record(bench.script(alone))
    assert recorded.samples == 8


@pytest.mark.parametrize(
    ("method", "does", "noted"),
    [
        ("fork", "p.stepSimulation()", 1),
        ("fork", "p.getNumBodies()", 0),
        ("spawn", "while not os.path.exists('seen'): time.sleep(0.01)", 1),
    ],
)
def test_what_other_processes_step_is_said_not_to_be_recorded(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, method: str, does: str, noted: int
) -> None:
    """A newly started process has loaded the engine by itself; a forked one makes steps."""
    look = OtherProcesses.look

    def looked(others: OtherProcesses) -> None:
        look(others)
        if others.found:
            bench.folder.joinpath("seen").touch()

    monkeypatch.setattr(OtherProcesses, "look", looked)
    text = (
        "import multiprocessing, os, time\nimport pybullet as p\n"
        f"def work():\n    {does}\n"
        "if __name__ == '__main__':\n    p.connect(p.DIRECT)\n    p.stepSimulation()\n"
        f"    other = multiprocessing.get_context({method!r}).Process(target=work)\n"
        "    other.start()\n    other.join()\n    print(other.exitcode)\n"
    )
    notes: list[str] = []
    _, printed = bench.record(bench.script(text), note=notes.append)
    assert printed.splitlines()[-1] == "0"
    assert len([note for note in notes if "other processes" in note]) == noted


def test_a_stream_of_another_version_is_refused() -> None:
    with pytest.raises(DropError, match="another version of drop"):
        list(FrameStream().feed(b"DROPREC\x01" + b"x" * 20))


def test_a_script_may_not_be_overwritten_by_its_recording(bench: Bench) -> None:
    script = bench.script("pass", "mine.rrd")
    with pytest.raises(OutputError, match="would replace"):
        record_script(str(bench.folder / script), out=bench.folder / "mine.rrd", force=True)


@pytest.mark.starts
def test_a_module_beside_the_script_is_its_own_though_the_recorder_has_the_librarys(
    bench: Bench,
) -> None:
    names = ["bisect", "json", "random", "signal", "tempfile", "threading", "pathlib", "runpy"]
    for name in names:
        bench.folder.joinpath(f"{name}.py").write_text(f"mine = '{name}'")
    text = "import importlib, sys\n"
    text += f"for name in {names}:\n"
    text += "    print(name, getattr(importlib.import_module(name), 'mine', None))\n"
    script = bench.script(text)
    bare, mine = bench.bare(script), bench.drop("record", script)
    assert bare.stdout.count("None") <= 1  # what Python has frozen is the library's
    assert mine.stdout == bare.stdout


@pytest.mark.long
def test_a_script_that_is_interrupted_is_run_again_up_to_there(bench: Bench) -> None:
    script = bench.script(
        STEPS + "open('there', 'a').write('x')\nwhile True:\n    p.getNumBodies()"
    )
    process = subprocess.Popen(
        [*COMMAND, "record", "--twice", "--json", script],
        cwd=bench.folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    wait_for(bench.folder.joinpath("there").exists, "the script did not come so far")
    process.send_signal(signal.SIGINT)
    printed, said = process.communicate(timeout=HANGS_S)
    assert json.loads(printed)["ended"] == "interrupted"
    assert json.loads(printed)["first_difference"] is None
    assert "recorded twice: every state is the same" in said
    assert bench.folder.joinpath("there").read_text() == "x"


@pytest.mark.long
def test_a_script_that_is_interrupted_before_its_first_step_is_not_run_again(bench: Bench) -> None:
    script = bench.script("open('there', 'a').write('x')\nwhile True:\n    pass")
    process = subprocess.Popen(
        [*COMMAND, "record", "--twice", "--json", script],
        cwd=bench.folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    wait_for(bench.folder.joinpath("there").exists, "the script did not come so far")
    process.send_signal(signal.SIGINT)
    printed, said = process.communicate(timeout=HANGS_S)
    assert "first_difference" not in json.loads(printed)
    assert "not run again: the first run was stopped before its first step" in said
    assert bench.folder.joinpath("there").read_text() == "x"


def test_a_second_run_that_goes_on_is_ended_and_differs(bench: Bench) -> None:
    # Hidden from the second run is only what the first has made, not what it has changed.
    bench.out.with_name("which").write_text("first")
    script = bench.script(
        STEPS + "if open('which').read() == 'first':\n    open('which', 'w').write('second')\n"
        "    raise SystemExit\nelse:\n    while True:\n        p.stepSimulation()\n"
    )
    recorded, _ = bench.record(script, twice=True)
    assert (recorded.ended, recorded.samples) == ("finished", 101)
    assert recorded.first_difference == 101


FREE = """import pybullet as p
p.connect(p.DIRECT)
p.setGravity(0, 0, -9.81)
p.setTimeStep(1 / 4000)
shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.1, 0.2, 0.3])
"""


def curve(path: Path, entity: str) -> np.ndarray[Any, Any]:
    """Return the points of an entity's only curve."""
    return np.array([row["Scalars:scalars"][0] for row in rows(path, entity)])


SOFT = """
import pybullet as p, pybullet_data
p.connect(p.DIRECT)
p.resetSimulation(p.RESET_USE_DEFORMABLE_WORLD)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.loadURDF("plane.urdf")
p.loadSoftBody("cloth_z_up.obj", basePosition=[0, 0, 1], scale=0.5, mass=1, useMassSpring=1)
"""


def test_soft_bodies_are_named_and_said_to_be_left_out(bench: Bench) -> None:
    script = bench.script(
        SOFT + "p.loadURDF('cube_small.urdf', [0, 0, 2])\n"
        "for _ in range(20):\n    p.stepSimulation()\n"
    )
    said: list[str] = []
    recorded, _ = bench.record(script, note=said.append)
    assert recorded.error == ""
    expected = "the soft body 1_cloth_z_up is left out: PyBullet does not report its position"
    assert expected in said
    assert closing(bench.out)["notes"] == [expected]
    assert {body for _, body in states(bench.out)} == {2}


def test_a_soft_body_alone_is_not_still_and_its_simulation_has_a_duration(bench: Bench) -> None:
    script = bench.script(SOFT + "for _ in range(24):\n    p.stepSimulation()\n")
    bench.record(script)
    described = info(bench.out)
    assert described.bodies == ["0_plane, held still", "1_cloth_z_up, soft"]
    assert (described.samples, described.duration_s) == (25, pytest.approx(0.1))
    analysis = analyze(bench.out)
    assert [sum(body.segments.values()) for body in analysis.bodies] == [25, 0]
    assert "the soft body 1_cloth_z_up is left out" in str(analysis)


@pytest.mark.parametrize("seed", some([None, 3], 1))
def test_a_script_that_computes_with_the_time_of_day_is_the_same_twice(
    bench: Bench, seed: int | None
) -> None:
    script = bench.script(
        "import time\n" + STEPS + "for _ in range(5):\n"
        "    p.resetBaseVelocity(b, [time.time() % 7, 0, 0])\n"
        "    p.stepSimulation()\nprint(time.time())\n"
    )
    recorded, printed = bench.record(script, twice=True, seed=seed)
    assert recorded.first_difference is None
    assert (float(printed.split()[-1]) < 1.1e9) == (seed is not None)


@pytest.mark.long
def test_a_second_run_that_is_interrupted_tells_no_difference(bench: Bench) -> None:
    """The script interrupts `drop` itself, so nobody sees the second run's messages."""
    script = bench.script(
        STEPS + "open('there', 'a').write('x')\n"
        "if os.path.getsize('there') > 1:\n    os.kill(int(os.environ['DROP']), signal.SIGINT)\n"
        "while os.path.getsize('there') > 1:\n    p.getNumBodies()"
    )
    (bench.folder / "there").touch()  # a second run has what the first has changed
    process = subprocess.Popen(
        ["sh", "-c", 'DROP=$$ exec "$@"', "sh", *COMMAND, "record", "--twice", "--json", script],
        cwd=bench.folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    printed, said = process.communicate(timeout=HANGS_S)
    assert "first_difference" not in json.loads(printed)
    assert "the second run was interrupted" in said
