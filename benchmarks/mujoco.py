"""Cost of watching a MuJoCo script and of explaining its steps; the cost of recording is excluded.

The script measures the processor time of its own thread, bare and watched, and prints its last
state: both must be the same. The explanation measures that of its process, less that of a short
one.
"""

from __future__ import annotations

import os
import resource
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from drop_physics.engines.mujoco.explained import ReplayedPiece
from drop_physics.engines.mujoco.stepping import Stepper, StepsWanted
from drop_physics.engines.script import Program, Script
from drop_physics.trace.events import Event
from drop_physics.trace.frames import Frames, ModelPart

from benchmarks.harness import Measured

SCRIPT = """
import hashlib, sys, time
import mujoco, numpy as np
m = mujoco.MjModel.from_xml_string('''{model}''')
d = mujoco.MjData(m)
commands = np.random.default_rng(0).uniform(-0.5, 0.5, (64, m.nu))
def run(n):
    for i in range(n):
        if m.nu: d.ctrl[:] = commands[i & 63]
        mujoco.mj_step(m, d)
run({warm})
began = time.thread_time()
run({steps})
took = time.thread_time() - began
print(hashlib.sha256(d.qpos.tobytes() + d.qvel.tobytes()).hexdigest(), took / {steps} * 1e6)
"""
PLANE = '<geom type="plane" size="20 20 1"/>'
LIMB = '<geom type="capsule" size="0.04" fromto="0 0 0 {}" density="900"/>'


def world(inside: str, joints: list[str]) -> str:
    """Return a model of bodies, each of whose named joints a position actuator drives."""
    driven = "".join(f'<position joint="{name}" kp="40"/>' for name in joints)
    return f"<mujoco><worldbody>{PLANE}{inside}</worldbody><actuator>{driven}</actuator></mujoco>"


def box(x: float = 0.0, y: float = 0.0) -> str:
    """Return the MJCF of a box that is about to come to rest."""
    return f'<body pos="{x} {y} 0.101"><freejoint/><geom type="box" size="0.1 0.1 0.1"/></body>'


def arm() -> tuple[str, list[str]]:
    """Return the MJCF of a seven-joint arm with a gripper that holds a box, and its joint names."""
    names = [f"j{k}" for k in range(7)]
    fingers = "".join(
        f'<body pos="0 {y} 0.25"><joint name="f{side}" type="slide" axis="0 {-side} 0" '
        f'range="0 0.1" limited="true" damping="5" armature="0.1"/>'
        f'<geom type="box" size="0.01 0.01 0.05"/></body>'
        for side, y in ((-1, -0.08), (1, 0.08))
    )
    text = fingers
    for name in reversed(names):
        axis = "0 0 1" if int(name[1]) % 2 == 0 else "0 1 0"
        text = (
            f'<body pos="0 0 0.2"><joint name="{name}" axis="{axis}" damping="5" armature="0.1" '
            f'frictionloss="0.1"/>{LIMB.format("0 0 0.2")}{text}</body>'
        )
    return text, [*names, "f-1", "f1"]


def humanoid() -> tuple[str, list[str]]:
    """Return the MJCF of a humanoid with 27 degrees of freedom, and the names of its hinges."""
    names: list[str] = []

    def hinges(*axes: str) -> str:
        made = []
        for axis in axes:
            names.append(f"h{len(names)}")
            made.append(f'<joint name="{names[-1]}" axis="{axis}" damping="1" armature="0.01"/>')
        return "".join(made)

    foot = '<geom type="box" size="0.1 0.04 0.02" pos="0.04 0 -0.02"/>'
    legs = "".join(
        f'<body pos="0 {y} 0">{hinges("1 0 0", "0 1 0", "0 0 1")}{LIMB.format("0 0 -0.35")}'
        f'<body pos="0 0 -0.4">{hinges("0 1 0")}{LIMB.format("0 0 -0.35")}'
        f'<body pos="0 0 -0.4">{hinges("0 1 0", "1 0 0")}{foot}</body></body></body>'
        for y in (-0.12, 0.12)
    )
    arms = "".join(
        f'<body pos="0 {y} 0.4">{hinges("1 0 0", "0 1 0")}{LIMB.format(f"0 {y} -0.2")}'
        f'<body pos="0 {y} -0.25">{hinges("0 1 0")}{LIMB.format("0.25 0 0")}</body></body>'
        for y in (-0.2, 0.2)
    )
    back = f'<body pos="0 0 0.1">{hinges("1 0 0", "0 1 0", "0 0 1")}{LIMB.format("0 0 0.35")}'
    trunk = f'<geom type="capsule" size="0.08" fromto="0 -0.08 0 0 0.08 0"/>{legs}{back}{arms}'
    return f'<body pos="0 0 0.9"><freejoint/>{trunk}</body></body>', names


@dataclass(frozen=True)
class MujocoScene:
    """A model, and how much slower its steps may be when they are watched."""

    model: str
    steps: int
    goal: float
    """Limit relative to the bare step; for one box, an absolute limit on the extra time [µs]."""
    explained_us: float
    """Time limit for explaining a step [µs]."""


SCENES = {
    "one box": MujocoScene(world(box(), []), 20_000, 7, 40),
    "an arm with a gripper": MujocoScene(world(*arm()), 10_000, 2.0, 40),
    "a humanoid": MujocoScene(world(*humanoid()), 5_000, 1.4, 100),
    "100 boxes at rest": MujocoScene(
        world("".join(box(k % 10 * 0.3, k // 10 * 0.3) for k in range(100)), []), 500, 1.15, 3000
    ),
}
MOST_BYTES = 3.0
"""Goal for the bytes stored per step, as a multiple of the state's size."""


def measure(folder: Path, *, quick: bool) -> Iterator[Measured]:
    """Compare watched and bare steps within a process, and time their explanation."""
    pairs, share = (1, 100) if quick else (5, 1)
    for name, scene in [*SCENES.items()][: 1 if quick else None]:
        steps = scene.steps // share
        path = folder / "scene.py"
        path.write_text(SCRIPT.format(model=scene.model, warm=steps // 10, steps=steps))
        runs = [(_watched(path), _bare(path)) for _ in range(pairs)]
        assert all(ours.state == theirs.state for ours, theirs in runs), name
        ours = statistics.median(each.step_us for each, _ in runs)
        theirs = statistics.median(each.step_us for _, each in runs)
        detail = f"{ours:.3g} over {theirs:.3g} µs, {runs[0][0].bytes:.0f} bytes a step"
        if name == "one box":
            values = [mine.step_us - other.step_us for mine, other in runs]
            unit, what = "µs", "more per step"
        else:
            values = [mine.step_us / other.step_us for mine, other in runs]
            unit, what = "×", "per step"
        yield Measured(
            f"watching {name} in MuJoCo: {what}",
            "the bare script",
            values,
            scene.goal,
            unit=unit,
            detail=detail,
        )
        path.write_text(SCRIPT.format(model=scene.model, warm=0, steps=1))
        whole, short = runs[-1][0], _watched(path)
        took = [_explained(whole) - _explained(short) for _ in range(pairs)]
        made = steps + steps // 10
        yield Measured(
            f"explaining {name} in MuJoCo, per step",
            "a script of one step",
            [each / made * 1e6 for each in took],
            scene.explained_us,
            unit="µs",
        )
        kept = _bytes(whole) / made
        yield Measured(
            f"bytes of {name} in MuJoCo, explained",
            "its states",
            [1 + kept / runs[0][0].bytes],
            MOST_BYTES,
            detail=f"{kept:.0f} more than {runs[0][0].bytes:.0f} bytes a step",
        )


@dataclass(frozen=True)
class Stepped:
    """A measured run of a script."""

    state: str
    step_us: float
    bytes: float = 0.0
    """Bytes sent per step."""
    wanted: Sequence[StepsWanted] = ()
    """The steps to explain: all of them."""


def _bare(path: Path) -> Stepped:
    done = subprocess.run([sys.executable, path], capture_output=True, text=True, check=True)
    state, took = done.stdout.split()
    return Stepped(state, float(took))


def _watched(path: Path) -> Stepped:
    printed, sent = path.with_name("printed.txt"), 0
    with printed.open("wb") as stdout:
        program = Program(str(path), (), sys.executable)
        with Script(program, stdout=stdout.fileno()) as script:
            take = script.decoder.mujoco.take

            def counted(payload: bytes) -> Iterable[Event]:
                nonlocal sent
                sent += len(payload) * (payload[:1] in b"SW")
                return take(payload)

            script.decoder.mujoco.take = counted
            events = [*script.events()]
            steps = script.decoder.mujoco.steps
    handle, name = tempfile.mkstemp(suffix=".mjb")
    with os.fdopen(handle, "wb") as model:
        model.write(b"".join(event.data for event in events if isinstance(event, ModelPart)))
    wanted = [
        StepsWanted(Path(name), event, 0, len(event))
        for event in events
        if isinstance(event, Frames)
    ]
    state, took = printed.read_text().split()
    return Stepped(state, float(took), sent / steps, wanted)


def _pieces(run: Stepped) -> Iterator[ReplayedPiece]:
    """Yield the explanation of all steps in chunks."""
    with Stepper(sys.executable, None) as stepper:
        yield from (piece for _, piece in stepper.explained(run.wanted))


def _explained(run: Stepped) -> float:
    """Return the processor time of explaining all steps [s]."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    for piece in _pieces(run):
        assert not piece.status.any(), "a step is not explained"
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def _bytes(run: Stepped) -> int:
    """Return the size of an explanation's arrays in bytes."""
    total = 0
    for piece in _pieces(run):
        points = len(piece.touches) * (4 + 4 * 10)
        total += piece.values.nbytes + points + 18 * len(piece.status)
    return total
