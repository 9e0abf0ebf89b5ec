"""Writes the description that a recording contains, for readers who do not have `drop`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from drop_physics.engine_report import EngineReport
from drop_physics.fields import counted, fraction
from drop_physics.scenario import ENGINES, Camera, Scenario
from drop_physics.trace.events import Ending

if TYPE_CHECKING:
    from drop_physics.recording.recorder import Recorder  # its module loads Rerun


def about_drop(scenario: Scenario, camera: Camera | None, engine: EngineReport) -> str:
    """Return the description of a drop's recording as Markdown."""
    gravity = "never set" if not scenario.gravity_set else f"{scenario.gravity_m_s2:g} m/s²"
    floor = "`plane.urdf`, its surface at z = 0" if scenario.floor else "none"
    steps = f"{scenario.steps} of {fraction(scenario.timestep_s)} s"
    if not scenario.stepped:
        steps += "; **`stepSimulation` was never called**"
    damping, turned = scenario.linear_damping, scenario.orientation_xyzw[:3]
    if scenario.substeps is not None:
        steps += f"; the engine splits each into {scenario.substeps}"
    rows = {
        "body": f"`{scenario.body}`, {engine.mass_kg:g} kg",
        "release": f"centre {scenario.height_m:g} m above the floor",
        **({"orientation": _orientation(scenario.orientation)} if any(turned) else {}),
        "velocity": _vector(scenario.velocity_m_s, "m/s"),
        "spin": _vector(scenario.spin_rad_s, "rad/s"),
        "gravity": gravity,
        "steps": steps,
        "linear damping": "the engine's own" if damping is None else f"{damping:g}",
        "coordinates": f"{scenario.coordinates} (`{engine.body_type}`)",
        "floor": floor,
        "frames": "none"
        if camera is None
        else f"every {_every(camera.capture_every)}, {camera.view} camera",
        "engine": engine_in_words(scenario, engine),
    }
    table = "\n".join(f"| {name} | {value} |" for name, value in rows.items())
    return f"""# A body dropped in {ENGINES[scenario.engine]}

Everything that happened in one simulated fall. Each sample is the state **before** a step;
sample 0 is the release.

| | |
| --- | --- |
{table}

## How to read it

- **World**: the body, its trail, the floor and the camera; z up, metres.
- **Height of the centre**: simulated, beside free fall (no air) and damped fall (the engine's
  damping in continuous time). Theory stops where the body would rest on the floor.
- `state`: position, orientation and velocities of each part as float64; `contacts`: every contact
  point, with its forces. Every number is computed from these; the 3-D view is rounded to float32.
- `sim_step` is the key; `sim_time` is step × timestep, in whole nanoseconds.

`drop analyze` says where each millimetre between the curves comes from.
"""


def _every(steps: int) -> str:
    return "step" if steps == 1 else counted(steps, "step")


def engine_in_words(scenario: Scenario, engine: EngineReport) -> str:
    """Describe an engine: name, version, and the chosen integrator."""
    if scenario.engine == "bullet":
        return f"pybullet {engine.pybullet_version}, {engine.pybullet_build}"
    integrator = scenario.effective_integrator
    name = f"{ENGINES[scenario.engine]} {engine.engine_version}"
    return f"{name}, {integrator}" if integrator else name


def _orientation(orientation: tuple[float, ...]) -> str:
    numbers = ", ".join(f"{number:g}" for number in orientation)
    return f"roll, pitch, yaw ({numbers})°" if len(orientation) == 3 else f"quaternion ({numbers})"


def _vector(vector: tuple[float, float, float], unit: str) -> str:
    if not any(vector):
        return "none"
    return f"({', '.join(f'{number:g}' for number in vector)}) {unit}"


def _made_with(made: Mapping[str, Any]) -> str:
    """Describe the software versions and the machine on which the numbers may depend."""
    named = {
        "Python": made.get("version"),
        "PyBullet": made.get("pybullet"),
        "MuJoCo": made.get("mujoco"),
        "numpy": made.get("numpy"),
        "OpenBLAS": made.get("blas"),
        "threads": made.get("blas_threads"),
        "PYTHONHASHSEED": made.get("hash_seed"),
    }
    return ", ".join(f"{name} {value}" for name, value in named.items() if value is not None)


def about_imported(origin: Mapping[str, Any], recorder: Recorder, ending: Ending) -> str:
    """Return the description of a recording of imported states as Markdown."""
    notes = "".join(f"\n- {note}" for note in ending.notes)
    return f"""# States of another program

`{origin["script"]}`, imported by drop: {recorder.samples:,} states, each held against the step that
MuJoCo {ending.made_with["mujoco"]} takes from the one before.
{notes}

## How to read it

- **World**: bodies at the states of the file; z up, metres.
- `state` and `joints/BODY`: the states of the file. `contacts`: the contact points of MuJoCo's own
  step from the state before the sample.
- `impulses`: MuJoCo's own; `another engine` is what the file's velocities have beyond these.
- `sim_step` is the number of the state; `sim_time` is the sum of the timesteps.
"""


def about_script(origin: Mapping[str, Any], recorder: Recorder, ending: Ending) -> str:
    """Return the description of a script's recording as Markdown."""
    call = " ".join([origin["script"], *(origin.get("arguments") or [])])
    rows = {
        "ended": f"{ending.how}{f': {ending.error}' if ending.error else ''}",
        "samples": f"{recorder.samples:,}",
        "bodies": ", ".join(body.label for body in list(recorder.bodies.values())[:30]) or "none",
        "camera frames": f"{recorder.frames:,}",
        "made with": _made_with(ending.made_with),
        "time": "virtual: sleeping passed at once"
        if ending.made_with.get("virtual_time")
        else "the script's own",
    }
    table = "\n".join(f"| {name} | {value} |" for name, value in rows.items())
    notes = "".join(f"\n- {note}" for note in ending.notes)
    engine = "MuJoCo" if ending.made_with.get("mujoco") else "PyBullet"
    return f"""# A script that uses {engine}

`{call}`, recorded by drop: everything that happened in its simulations.

| | |
| --- | --- |
{table}
{notes}

## How to read it

- **World**: bodies as they were drawn; z up, metres.
- `state`: position, orientation and velocities of every base that can move, before each step and
  after the last, float64. `joints/BODY`: position, velocity and effort of its joints. `contacts`:
  the contact points of the step that led to the sample.
- `set`: where calls placed bodies between two steps. `calls`: what the script did to the world, by
  its place in the script (`sites`) and the numbers of its arguments.
- `sim_step` is the key; `sim_time` is the sum of the timesteps; `call` counts calls.
"""
