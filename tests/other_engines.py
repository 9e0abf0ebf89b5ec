"""States in the file formats of other programs: made with MuJoCo, and rounded as on a GPU."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

ARM = """
<mujoco>
  <option timestep="{h}" integrator="{integrator}"/>
  <worldbody>
    <geom name="floor" type="plane" size="5 5 .1"/>
    <body name="upper" pos="0 0 {height}">
      <joint name="shoulder" axis="0 1 0" damping="{damping}"/>
      <geom type="capsule" fromto="0 0 0 .3 0 0" size=".03" mass="1"/>
      <body name="fore" pos=".3 0 0">
        <joint name="elbow" axis="0 1 0" damping="{damping}" {elbow}/>
        <geom name="fore" type="capsule" fromto="0 0 0 .2 0 0" size=".02" mass="{mass}"/>
      </body>
    </body>
    {more}
  </worldbody>
  <actuator>{actuators}</actuator>
</mujoco>
"""
SERVOS = (
    '<position name="shoulder" joint="shoulder" kp="50" kv="2"/>'
    '<position name="elbow" joint="elbow" kp="20" kv="1"/>'
)
STIFF = '<position name="shoulder" joint="shoulder" kp="50" kv="2"/>'
MOTORS = '<motor name="shoulder" joint="shoulder"/><motor name="elbow" joint="elbow"/>'
CUBE = (
    '<body name="cube" pos=".7 0 .3" euler="10 20 0"><freejoint/>'
    '<geom name="cube" type="box" size=".05 .05 .05" mass=".5"/></body>'
)
TABLE = '<geom type="box" pos=".45 0 1.02" size=".05 .05 .05" solref="-3e9 -1"/>'
HAMMER = (
    '<body name="hammer" pos="1 0 3"><freejoint name="hammer"/>'
    '<geom type="box" size=".2 .02 .01" mass=".3"/>'
    '<geom type="box" pos=".2 0 0" size=".03 .08 .03" mass=".5"/></body>'
)


def arm(**how: Any) -> str:
    """Return the MJCF of a two-link arm, optionally with further elements."""
    usual = {
        "h": 0.002, "integrator": "Euler", "height": 1, "damping": 0.1, "elbow": "", "mass": 0.3,
        "more": "", "actuators": SERVOS,
    }  # fmt: skip
    return ARM.format(**usual | how)


def held(_: int) -> list[float]:
    return [0.1, 0.5]


@dataclass(frozen=True)
class Dump:
    """A run that ends in non-finite numbers, and the cause."""

    xml: str
    says: str
    """The expected description of the cause."""
    ctrl: Callable[[int], list[float]] = held
    spin: tuple[float, float, float] | None = None


DUMPS = {
    "kp": Dump(
        arm(actuators=STIFF + '<position name="elbow" joint="elbow" kp="20000"/>'),
        "by actuator elbow: kp gear² h²/I = 37.2",
    ),
    "kv": Dump(
        arm(actuators=STIFF + '<velocity name="elbow" joint="elbow" kv="30"/>'),
        "by actuator elbow: kv gear² h/I = 27.9",
    ),
    "gear": Dump(
        arm(
            actuators='<position name="shoulder" joint="shoulder" kp="100" gear="30"/>'
            '<position name="elbow" joint="elbow" kp="20" kv="1"/>'
        ),
        "by actuator shoulder: kp gear² h²/I = 8.85",
    ),
    "mass": Dump(arm(mass=1e-6, damping=0), "in elbow (an inertia of 1.4e-08 kg m²)"),
    "inside": Dump(arm(more=TABLE), "fore and world, which are 20 mm inside each other"),
    "timestep": Dump(
        arm(
            h=0.03,
            actuators='<position name="shoulder" joint="shoulder" kp="300"/>'
            '<position name="elbow" joint="elbow" kp="20"/>',
        ),
        "by actuator shoulder: kp gear² h²/I = 6.6",
    ),
    "action": Dump(
        arm(actuators=MOTORS),
        "actuator elbow is given 1e+09 from state 60 on",
        lambda step: [0.1, 0.0 if step < 60 else 1e9],
    ),
    "spring": Dump(
        arm(elbow='stiffness="20000"', actuators=STIFF),
        "by spring elbow: its stiffness × h²/I = 37.2",
        lambda _: [0.1],
    ),
    "light": Dump(
        arm(
            h=0.004,
            mass=0.01,
            actuators='<motor name="shoulder" joint="shoulder"/>'
            '<position name="elbow" joint="elbow" kp="200" kv="3"/>',
        ),
        "by actuator elbow: kv gear² h/I = 86.8",
    ),
    "spin": Dump(
        arm(h=0.01, actuators=MOTORS, more=HAMMER),
        "in hammer",
        spin=(30.0, 80.0, 60.0),
    ),
}


def dumped(name: str, folder: Path, most: int = 100) -> Path:
    """Save a run in the format of mjlab's NaN guard, and return the file."""
    dump = DUMPS[name]
    m, free = (mujoco.MjModel.from_xml_string(dump.xml) for _ in range(2))
    free.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)  # no GPU has that
    d, spec = mujoco.MjData(free), int(mujoco.mjtState.mjSTATE_PHYSICS)
    if dump.spin is not None:
        d.qvel[-3:] = dump.spin
    states: list[Any] = []
    with np.errstate(over="ignore"):
        while np.isfinite(np.concatenate([d.qpos, d.qvel, d.qacc]).astype(np.float32)).all():
            d.ctrl[:] = dump.ctrl(len(states))
            for part in (d.qpos, d.qvel):
                part[:] = part.astype(np.float32)
            state = np.empty(mujoco.mj_stateSize(free, spec))
            mujoco.mj_getState(free, d, state, spec)
            states.append(state)
            mujoco.mj_step(free, d)
    arrays = {f"states_step_{k:06d}": state[None] for k, state in enumerate(states)}
    kept = dict([*arrays.items()][-most:])
    told = np.array({"nan_env_ids": [0], "model_file": f"model_{name}.mjb"}, dtype=object)
    path = folder / f"nan_dump_{name}.npz"
    np.savez_compressed(path, **kept, _metadata=told)
    mujoco.mj_saveModel(m, str(folder / f"model_{name}.mjb"), None)
    return path


BESIDE = {"h": 0.002, "integrator": "implicitfast", "height": 0.8, "damping": 0.3, "more": CUBE}
SWINGS = arm(
    **BESIDE,
    elbow='range="-40 40"',
    actuators='<motor name="shoulder" joint="shoulder" gear="8"/>'
    '<position name="elbow" joint="elbow" kp="15" kv=".5"/>',
).replace("<mujoco>", '<mujoco><compiler autolimits="true"/>')


@dataclass(frozen=True)
class Twin:
    """A single-precision run of an engine that differs from ours in one property."""

    edit: Callable[[Any], None]
    kind: str
    names: tuple[str, ...]
    factor: float | None = None
    begins: int = 0
    """The first step in which the property differs."""


def _set(name: str, place: Any, value: Any) -> Callable[[Any], None]:
    return lambda m: getattr(m, name).__setitem__(place, value)


def _untouched(m: Any) -> None:
    cube = mujoco.mj_name2id(m, mujoco.mjtObj.mjOBJ_GEOM, "cube")
    m.geom_contype[cube] = m.geom_conaffinity[cube] = 0


def _clipped(m: Any) -> None:
    m.actuator_ctrllimited[0], m.actuator_ctrlrange[0] = 1, [-0.7, 0.7]


def _soft(m: Any) -> None:
    m.actuator_gainprm[1, 0], m.actuator_biasprm[1, 1] = 12, -12


TWINS = {
    "gravity": Twin(lambda m: m.opt.gravity.__setitem__(2, -9.7), "gravity", (), 9.7 / 9.81),
    "gain": Twin(_set("actuator_gear", (0, 0), 6.4), "actuator", ("shoulder",), 0.8),
    "damping": Twin(_set("dof_damping", 1, 0.0), "damper", ("elbow",), 0.0),
    "limit": Twin(_set("jnt_range", 1, [-3, 3]), "limit", ("elbow",)),
    "friction": Twin(_set("geom_friction", (slice(None), 0), 0.2), "contacts", ("cube", "world")),
    "untouched": Twin(_untouched, "contacts", ("cube", "world"), begins=150),
    "iterations": Twin(lambda m: setattr(m.opt, "iterations", 1), "contacts", ("cube", "world")),
    "cone": Twin(lambda m: setattr(m.opt, "cone", 1), "contacts", ("cube", "world")),
    "clipped": Twin(_clipped, "actuator", ("shoulder",)),
    "soft": Twin(_soft, "actuator", ("elbow",), begins=100),
}


def twin_of(twin: Twin | None, steps: int = 300) -> tuple[dict[str, Any], int | None]:
    """Return a twin's states, and the first step that differs by more than rounding."""
    ours, theirs = (mujoco.MjModel.from_xml_string(SWINGS) for _ in range(2))
    if twin is not None:
        twin.edit(theirs)
    d, e = mujoco.MjData(ours), mujoco.MjData(ours)
    rows: dict[str, list[Any]] = {"time": [], "qpos": [], "qvel": [], "ctrl": []}
    first = None
    for step in range(steps):
        d.ctrl[:] = np.sin(step / 40), 1.2 * np.sin(step / 25)
        for name in ("qpos", "qvel", "ctrl"):
            part = getattr(d, name)
            part[:] = part.astype(np.float32)
            getattr(e, name)[:] = part
        for name, kept in rows.items():
            kept.append(np.array(getattr(d, name), np.float64 if name == "time" else np.float32))
        e.qacc_warmstart[:] = d.qacc_warmstart
        mujoco.mj_step(ours, e)
        mujoco.mj_step(theirs if twin is not None and step >= twin.begins else ours, d)
        gap = np.abs(d.qvel - e.qvel).max()
        if first is None and gap > 2e-5 * max(1.0, np.abs(d.qvel).max()):
            first = step
    return {name: np.array(kept) for name, kept in rows.items()}, first
