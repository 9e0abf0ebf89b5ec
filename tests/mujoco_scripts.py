"""Run MuJoCo scripts as `drop record` does, and return the sent data and the explained steps."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import forked
import numpy as np
from drop_physics.engines.mujoco.explain.reasons import REASONS
from drop_physics.engines.mujoco.explained import ReplayedPiece
from drop_physics.engines.mujoco.received import Received, ReceivedWrite, StepPiece
from drop_physics.engines.mujoco.stepping import Stepper, StepsWanted
from drop_physics.engines.script import Program, Script
from drop_physics.trace.events import Ending, Event
from drop_physics.trace.frames import Frames, ModelPart

MACHINE = """
<mujoco>
  <option timestep="0.002" density="30" viscosity="0.2" wind="1 0 0"/>
  <default>
    <geom density="800" solref="0.01 1"/>
  </default>
  <worldbody>
    <geom name="floor" type="plane" size="5 5 1" condim="3"/>
    <body name="cart" pos="0 0 0.6">
      <joint name="x" type="slide" axis="1 0 0" damping="0.5" armature="0.1" range="-0.01 0.01"
        limited="true"/>
      <joint name="tilt" axis="0 1 0" pos="0 0 0.02" damping="0.1" stiffness="3" springref="0.1"/>
      <geom name="box" type="box" size="0.1 0.08 0.05" pos="0.02 0 0.01"/>
      <body name="upper" pos="0.12 0 0" euler="0 20 0">
        <joint name="ball" type="ball" damping="0.05" stiffness="0.5" frictionloss="0.01"/>
        <geom name="rod" type="capsule" size="0.03" fromto="0 0 0 0.2 0.02 0"/>
        <body name="lower" pos="0.22 0.02 0">
          <joint name="elbow" axis="0 1 0" range="-40 40" limited="true" actuatorfrcrange="-1 1"
            actuatorfrclimited="true" frictionloss="0.05"/>
          <geom name="fist" type="sphere" size="0.05" pos="0.1 0 0"/>
          <site name="tip" pos="0.1 0 0.03"/>
        </body>
      </body>
    </body>
    <body name="lifted" pos="0 0.5 0.5" gravcomp="0.7">
      <joint name="lift" axis="1 0 0" actuatorgravcomp="true"/>
      <geom type="capsule" size="0.03" fromto="0 0 0 0 0.2 0"/>
      <body name="float" pos="0 0.22 0" gravcomp="1.3">
        <joint name="float" axis="1 0 0" stiffness="1"/>
        <geom type="capsule" size="0.02" fromto="0 0 0 0 0.15 0"/>
        <site name="hook" pos="0 0.15 0"/>
      </body>
    </body>
    <body name="stone" pos="0.5 -0.4 0.12" quat="0.9 0.2 0.3 0.1">
      <freejoint/>
      <geom name="stone" type="box" size="0.08 0.05 0.06" condim="4"/>
      <geom name="knob" type="sphere" size="0.04" pos="0.07 0.03 0.02" condim="6"/>
    </body>
    <body name="ice" pos="-0.5 -0.4 0.06"><freejoint/>
      <geom name="ice" type="box" size="0.05 0.05 0.05" condim="1" friction="0"/></body>
    <body name="hand" mocap="true" pos="0 -0.8 0.5"><geom size="0.02" contype="0" conaffinity="0"/>
    </body>
    <body name="held" pos="0 -0.8 0.5"><freejoint/>
      <geom name="held" size="0.05" contype="0" conaffinity="0"/><site name="eye"/></body>
    <body name="link" pos="1 0.5 1"><joint name="swing" axis="0 1 0"/>
      <geom type="capsule" size="0.02" fromto="0 0 0 0.3 0 0" contype="0" conaffinity="0"/>
      <body pos="0.3 0 0"><joint name="swing2" axis="0 1 0"/>
        <geom type="capsule" size="0.02" fromto="0 0 0 0.3 0 0" contype="0" conaffinity="0"/></body>
    </body>
  </worldbody>
  <equality>
    <weld body1="hand" body2="held"/>
    <joint joint1="swing" joint2="swing2" polycoef="0 -1 0 0 0"/>
    <tendon tendon1="sum" polycoef="0.1 0 0 0 0" solref="0.1 1"/>
  </equality>
  <tendon>
    <fixed name="sum" stiffness="2" damping="0.3" frictionloss="0.02" armature="0.05">
      <joint joint="lift" coef="1"/><joint joint="float" coef="-0.5"/></fixed>
    <spatial name="rope" stiffness="20" damping="1" limited="true" range="0 0.6"
      springlength="0.2 0.3"><site site="hook"/><site site="eye"/></spatial>
  </tendon>
  <actuator>
    <motor name="push" joint="x" gear="2" ctrlrange="-5 5" ctrllimited="true"/>
    <position name="bend" joint="elbow" kp="30" kv="0.5" forcerange="-4 4"/>
    <velocity name="turn" joint="tilt" kv="0.4"/>
    <general name="slow" joint="lift" dyntype="filter" dynprm="0.05" gainprm="3"/>
    <motor name="pull" tendon="rope" gear="-1"/>
    <motor name="roll" joint="ball" gear="0.1 0.2 0.3"/>
    <muscle name="muscle" joint="swing" lengthrange="-1 1"/>
  </actuator>
  <keyframe><key name="home" ctrl="1 0.5 0 0 0 0 0"/></keyframe>
</mujoco>
"""
"""A model with every element that the sum of impulses has a term for."""


@dataclass(frozen=True)
class Run:
    """A watched run of a script."""

    received: Received
    pieces: list[StepPiece]
    ending: Ending
    printed: str
    said: str
    """The script's standard error."""
    frames: list[Frames]
    """The recorded frames of each simulation."""
    models: Path
    """The folder with the simulations' models, by model number."""
    sent: list[bytes]
    """The payloads sent to the recorder."""

    def steps(self, world: int = 0) -> int:
        """Return the number of steps in a simulation."""
        return sum(len(piece.times_s) for piece in self.pieces if piece.world == world)

    def column(self, name: str, world: int = 0) -> np.ndarray:
        """Return one component of the state after each step."""
        found = [piece.parts[name] for piece in self.pieces if piece.world == world]
        return np.concatenate(found)

    def written(self, world: int = 0) -> list[ReceivedWrite]:
        """Return the writes to the state that the script made before steps."""
        return [each for piece in self.pieces if piece.world == world for each in piece.written]

    def line(self, site: int) -> int:
        """Return the script's line number for a call site."""
        return self.received.sites[site].line

    def explained(self) -> list[ReplayedPiece]:
        """Replay and explain the steps, and return the result in chunks."""
        with Stepper(sys.executable, self.received.version) as stepper:
            wanted = (
                StepsWanted(self.models / f"{each.model}.mjb", each, 0, len(each))
                for each in self.frames
            )
            return [piece for _, piece in stepper.explained(wanted)]


def bare(folder: Path, text: str, *, alone: bool = False) -> subprocess.CompletedProcess[str]:
    """Run a script unwatched in a folder; if `alone`, in a fresh interpreter instead of a fork."""
    folder.mkdir(exist_ok=True)
    folder.joinpath("script.py").write_text(text)
    command = [sys.executable, "script.py"]
    if not alone:
        return forked.run(command, folder, also="mujoco")
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


def watched(folder: Path, text: str, **how: Any) -> Run:
    """Run a script in a folder, and return the data that its process sent."""
    folder.mkdir(exist_ok=True)
    folder.joinpath("script.py").write_text(text)
    back, pieces, sent = Path.cwd(), [], []
    os.chdir(folder)
    try:
        with (
            Path("printed.txt").open("wb") as printed,
            Path("said.txt").open("wb") as said,
        ):
            program = Program("script.py", [], sys.executable, **how)
            with Script(program, stdout=printed.fileno(), stderr=said.fileno()) as script:
                decoder = script.decoder.mujoco
                take, on_piece = decoder.take, decoder._on_piece

                def taken(payload: bytes) -> Iterable[Event]:
                    sent.append(payload)
                    return take(payload)

                def seen(piece: StepPiece) -> Iterator[Event]:
                    pieces.append(piece)
                    return on_piece(piece)

                decoder.take, decoder._on_piece = taken, seen
                events = [*script.events()]
                received, ending = decoder._received, script.ending()
    finally:
        os.chdir(back)
    for event in events:
        if isinstance(event, ModelPart):
            with folder.joinpath(f"{event.number}.mjb").open("ab") as file:
                file.write(event.data)
    frames = sorted((each for each in events if isinstance(each, Frames)), key=lambda e: e.client)
    texts = [folder.joinpath(name).read_text() for name in ("printed.txt", "said.txt")]
    return Run(received, pieces, ending, *texts, frames, folder, sent)


def of_world(pieces: list[ReplayedPiece], world: int) -> Iterator[ReplayedPiece]:
    """Yield the chunks of one simulation."""
    yield from (piece for piece in pieces if piece.world == world)


def statuses(pieces: list[ReplayedPiece], world: int = 0) -> list[tuple[int, str]]:
    """Return the status and reason of each step of a simulation."""
    return [
        (status, REASONS[reason])
        for piece in of_world(pieces, world)
        for status, reason in zip(piece.status.tolist(), piece.reason.tolist(), strict=True)
    ]
