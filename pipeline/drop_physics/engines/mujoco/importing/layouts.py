"""Finds `qpos`, `qvel` … among a file's arrays, by common names or by `--map`."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drop_physics.engines.mujoco.frames import LARGEST
from drop_physics.engines.mujoco.importing.archives import Archive
from drop_physics.engines.mujoco.importing.steps import INPUTS, WIDTHS, ImportedStates
from drop_physics.errors import DropError, ScenarioError
from drop_physics.fields import all_of
from drop_physics.messages import Message, joined

NAMES = {
    "time": ("time", "t", "times", "time_s"),
    "qpos": ("qpos", "q", "positions"),
    "qvel": ("qvel", "v", "qd", "velocities"),
    "ctrl": ("ctrl", "control", "controls"),
    "act": ("act", "activation", "activations"),
    "mocap_pos": ("mocap_pos",),
    "mocap_quat": ("mocap_quat",),
    "qfrc_applied": ("qfrc_applied",),
    "xfrc_applied": ("xfrc_applied", "xfrc"),
    "eq_active": ("eq_active",),
    "qacc_warmstart": ("qacc_warmstart", "warmstart"),
    "states": ("states", "state"),
}
"""Common names of the arrays that are read, in lower case; an array `states` holds whole states,
one per row."""
STEP_OF = re.compile(r"states_step_(\d+)")
"""Names of arrays with the states of all worlds in one step, as mjlab's NaN guard saves them."""
APART = 10.0
"""A world is an outlier if its final state is this many times farther from the other worlds' states
than they are from each other."""
TOLERATED = 0.02
"""Share of a timestep by which the time between two states may deviate from it."""


@dataclass(frozen=True, eq=False)
class FoundStates:
    """The states of one of a file's parallel worlds."""

    states: ImportedStates
    names: Mapping[str, str]
    """The key in the file for each array read."""
    world: int | None
    """Index of the chosen world; None if there is only one."""
    worlds: int
    notes: list[Message] = field(default_factory=list)
    """Remarks on missing data and their consequences."""
    ended: Message | None = None
    """Remark on the first state that is not finite; None if all are finite."""
    is_beyond: bool = False
    """Whether the state that is not finite directly follows the last recorded state."""


def asked_names(maps: Sequence[str], archive: Archive) -> dict[str, str]:
    """Parse `--map` options: return the file's array names, by state array.

    Raises
    ------
    ScenarioError
        If one is not of the form KEY=ARRAY, or there is no such array.
    """
    found = {}
    for each in maps:
        what, _, key = each.partition("=")
        if what not in NAMES or not key:
            raise ScenarioError(
                "--map takes KEY=ARRAY, KEY one of {keys}; got {given!r}",
                keys=", ".join(NAMES),
                given=each,
            )
        if key not in archive.arrays:
            raise ScenarioError(
                "--map {given}: {path} has no array {key!r}; it has {keys}",
                given=each,
                path=str(archive.path),
                key=key,
                keys=_listed(archive),
            )
        found[what] = key
    return found


def states_in(
    archive: Archive,
    m: Any,  # noqa: ANN401
    maps: Mapping[str, str],
    world: int | None,
) -> FoundStates:
    """Return the states of one of a file's parallel worlds.

    Parameters
    ----------
    archive
        The file.
    m
        The MjModel.
    maps
        The file's array names that the user gave, by state array.
    world
        Index of the world; None for the first world whose state becomes non-finite, or else the
        outlier.

    Raises
    ------
    ScenarioError
        If there is no such world.
    DropError
        If the states are missing, or are not of this model.
    """
    names = {**_names(archive), **maps}
    arrays = {what: archive.arrays[key] for what, key in names.items()}
    captured = sorted(
        (int(found[1]), key) for key in archive.arrays if (found := STEP_OF.fullmatch(key))
    )
    if captured and "qpos" not in arrays:
        names |= {"states": f"{captured[0][1]} …"}
        arrays["states"] = np.stack([np.atleast_2d(archive.arrays[key]) for _, key in captured], 1)
    if "states" in arrays and "qpos" not in arrays:
        arrays |= _divided(m, arrays["states"], archive, is_physics=bool(captured))
    arrays.pop("states", None)
    for needed in ("qpos", "qvel"):
        if needed not in arrays:
            raise DropError(
                "{path} has no {needed}; name the array with --map {needed}=ARRAY: it has {keys}",
                path=str(archive.path),
                needed=needed,
                keys=_listed(archive),
            )
    arrays = {what: _shaped(what, held, m, archive) for what, held in arrays.items()}
    worlds = max(len(held) for held in arrays.values())
    counts = {len(held) for held in arrays.values()} | {1, worlds}
    if counts != {1, worlds}:
        raise DropError(
            "{path} must have as many worlds in each array, got {counts}",
            path=str(archive.path),
            counts=", ".join(f"{what}: {len(held)}" for what, held in arrays.items()),
        )
    several = worlds if not archive.demonstrations else len(archive.demonstrations)
    chosen = world or 0
    if worlds > 1:
        if world is not None and not 0 <= world < worlds:
            raise ScenarioError(
                "--world must be between 0 and {last}, got {world}", last=worlds - 1, world=world
            )
        chosen = _chosen(arrays) if world is None else world
    elif world and not archive.demonstrations:
        raise ScenarioError("--world must be 0, got {world}: there is one world", world=world)
    of_world = {
        what: held[min(chosen, len(held) - 1)] if not archive.demonstrations else held[0]
        for what, held in arrays.items()
    }
    return _found(of_world, names, m, archive, chosen if several > 1 else None, several, captured)


def _names(archive: Archive) -> dict[str, str]:
    """Return the file's array names, by the common name that each stands for."""
    found: dict[str, str] = {}
    by_name: dict[str, str] = {}
    for key in archive.arrays:
        by_name.setdefault(key.rpartition("/")[2].lower(), key)
    for what, common in NAMES.items():
        for name in reversed(common):  # the first counts
            if name in by_name:
                found[what] = by_name[name]
    return found


def _divided(
    m: Any,  # noqa: ANN401
    states: NDArray[Any],
    archive: Archive,
    *,
    is_physics: bool,
) -> dict[str, NDArray[Any]]:
    """Split concatenated states into `qpos`, `qvel` …, by their number of columns."""
    width = states.shape[-1] if states.ndim else 0
    moving = [("qpos", m.nq), ("qvel", m.nv)]
    act, mocap = [("act", m.na)], [("mocap_pos", 3 * m.nmocap), ("mocap_quat", 4 * m.nmocap)]
    time = [("time", 1)]
    layouts = [
        *([moving + act + mocap, moving + act] if is_physics else []),
        time + moving,
        time + moving + act,
        moving,
        moving + act,
    ]
    for parts in layouts:
        if width == sum(count for _, count in parts):
            ends = np.cumsum([count for _, count in parts])[:-1]
            pieces = np.split(states, ends, axis=-1)
            return {
                what: piece for (what, count), piece in zip(parts, pieces, strict=True) if count
            }
    raise DropError(
        "{path} has states of {width} numbers, and the model has {nq} positions and {nv} "
        "velocities: another model? --model takes the one of this run",
        path=str(archive.path),
        width=width,
        nq=m.nq,
        nv=m.nv,
    )


def _shaped(what: str, held: NDArray[Any], m: Any, archive: Archive) -> NDArray[Any]:  # noqa: ANN401
    """Return an array in the shape worlds × steps × numbers, checked against the model."""
    if what == "time":
        held = held[..., 0] if held.ndim > 1 and held.shape[-1] == 1 else held
        return held.reshape(-1, held.shape[-1]) if held.ndim else held.reshape(1, 1)
    width = WIDTHS[what](m)
    if what in ("mocap_pos", "mocap_quat", "xfrc_applied") and held.ndim >= 3:
        last = {"mocap_pos": 3, "mocap_quat": 4, "xfrc_applied": 6}[what]
        if held.shape[-1] == last and held.shape[-2] * last == width:
            held = held.reshape(*held.shape[:-2], width)
    if held.ndim == 1 and width == 1:
        held = held[:, None]
    if held.ndim not in (2, 3) or held.shape[-1] != width:
        raise DropError(
            "{what} must have {width} numbers in each state of this model, got an array of shape "
            "{shape} in {path}; --model takes another model, --map {what}=ARRAY another array",
            what=what,
            width=width,
            shape=str(held.shape),
            path=str(archive.path),
        )
    return held if held.ndim == 3 else held[None]


def _chosen(arrays: Mapping[str, NDArray[Any]]) -> int:
    """Return the world to import: the first with non-finite numbers, an outlier, or 0."""
    bad = ~(_is_number(arrays["qpos"]) & _is_number(arrays["qvel"])).all(axis=1)
    if bad.any():
        return int(np.argmax(bad))
    ends = np.concatenate([arrays["qpos"][:, -1], arrays["qvel"][:, -1]], axis=1).astype(np.float64)
    off = np.abs(ends - np.median(ends, axis=0)).max(axis=1)
    usual = float(np.median(off))
    return int(np.argmax(off)) if off.max() > APART * usual and off.max() > 0.0 else 0


def _is_number(rows: NDArray[Any]) -> NDArray[np.bool_]:
    """Flag the states whose numbers are all finite and within MuJoCo's limit."""
    with np.errstate(invalid="ignore"):
        return np.asarray((np.abs(rows.astype(np.float64)) <= LARGEST).all(axis=-1))


def _found(
    parts: dict[str, NDArray[Any]],
    names: Mapping[str, str],
    m: Any,  # noqa: ANN401
    archive: Archive,
    world: int | None,
    worlds: int,
    captured: Sequence[Any],
) -> FoundStates:
    path, notes = str(archive.path), list[Message]()
    times = parts.pop("time", None)
    count = min(len(parts["qpos"]), len(parts["qvel"]))
    if len(parts["qpos"]) != len(parts["qvel"]):
        raise DropError(
            "{path} must have as many qvel as qpos, got {qvel} and {qpos}",
            path=path,
            qvel=len(parts["qvel"]),
            qpos=len(parts["qpos"]),
        )
    for what, held in parts.items():
        if len(held) not in (count, count - 1) and len(held) != 1:
            raise DropError(
                "{what} must have a row for each of {count} states, got {rows} in {path}; "
                "--map {what}=ARRAY takes another array",
                what=what,
                count=count,
                rows=len(held),
                path=path,
            )
    finite = _is_number(parts["qpos"]) & _is_number(parts["qvel"])
    ended, beyond = None, False
    if not finite.all():
        count = int(np.argmin(finite))
        ended = _no_number(parts, count, m)
        # The first state that is too large is shown, if that can be.
        count += all(np.isfinite(parts[name][count]).all() for name in ("qpos", "qvel"))
        if count < 2:
            raise DropError(
                "{path} must begin with two states of finite numbers; {why}", path=path, why=ended
            )
    elif captured:
        beyond = True
        ended = Message(
            "the step from the last state, {number}, led to a number that is not finite",
            number=captured[-1][0],
        )
    if (bad := _bad_input(parts, count, m)) is not None:
        count, why = bad
        ended = why if ended is None else joined("; ", [why, ended])
    if count < 2:
        raise DropError("{path} must have at least two states, got {count}", path=path, count=count)
    rounding = _rounding(parts)
    h = float(m.opt.timestep)
    step_s = h
    if times is None or len(times) < count:
        notes.append(
            Message(
                "no time in the file: its states are taken to be {step:g} s apart, the model's "
                "timestep",
                step=h,
            )
        )
        times = h * np.arange(count)
    else:
        times = times[:count].astype(np.float64)
        step_s = float(np.median(np.diff(times)))
        if not np.isfinite(times).all() or step_s <= 0.0:
            raise DropError(
                "time must rise from state to state, got {step:g} s between most in {path}; "
                "--map time=ARRAY takes another array",
                step=step_s,
                path=path,
            )
    parts = {
        what: held[:count] if len(held) > 1 else np.repeat(held, count, axis=0)
        for what, held in parts.items()
    }
    notes += _missing(parts, m, archive)
    states = ImportedStates(parts, np.asarray(times, np.float64), rounding, step_s)
    return FoundStates(states, dict(names), world, worlds, notes, ended, beyond)


def _no_number(parts: Mapping[str, NDArray[Any]], at: int, m: Any) -> Message:  # noqa: ANN401
    """Describe the first non-finite number of a state."""
    for what, adr in (("qvel", m.jnt_dofadr), ("qpos", m.jnt_qposadr)):
        bad = np.flatnonzero(~(np.abs(parts[what][at]) <= LARGEST))
        if len(bad):
            joint = int(np.searchsorted(adr, bad[0], side="right")) - 1
            return Message(
                "it ends at state {number}, where {what} of joint {joint} is {value:.3g}: over "
                "{most:.0e} MuJoCo starts again",
                number=at,
                what=what,
                joint=m.joint(joint).name or f"{joint}",
                value=float(parts[what][at][bad[0]]),
                most=LARGEST,
            )
    raise AssertionError(at)


def _bad_input(
    parts: Mapping[str, NDArray[Any]],
    count: int,
    m: Any,  # noqa: ANN401
) -> tuple[int, Message] | None:
    """Return the number of states before a non-finite input, with its description."""
    found: list[tuple[int, Message]] = []
    for what in (*INPUTS, "act"):
        held = parts.get(what, np.zeros((1, 0)))[:count]
        rows = np.flatnonzero(~np.isfinite(held).all(axis=1))
        if len(rows):
            row = int(rows[0])
            which = int(np.flatnonzero(~np.isfinite(held[row]))[0])
            of = m.actuator(which).name if what == "ctrl" else ""
            name = Message("actuator {name}", name=of) if of else f"{what}[{which}]"
            why = Message(
                "{what} of {name} is {value} from state {row} on",
                what=what,
                name=name,
                value=str(held[row][which]),
                row=row,
            )
            found.append((row + 1, why))
    return min(found, key=lambda each: each[0], default=None)


def _rounding(parts: Mapping[str, NDArray[Any]]) -> float:
    """Return the relative rounding error of the least precise type among the arrays.

    A file may hold single precision as doubles, which then have no more digits.
    """
    coarsest = 0.0
    with np.errstate(over="ignore"):
        for what in ("qpos", "qvel"):
            held = parts[what]
            kind = held.dtype if held.dtype.kind == "f" else np.dtype(np.float64)
            rounded = held.astype(np.float32)
            if kind == np.float64 and held.any() and (rounded == held)[np.isfinite(held)].all():
                kind = rounded.dtype
            coarsest = max(coarsest, float(np.finfo(kind).eps))
    return coarsest


def _missing(parts: Mapping[str, Any], m: Any, archive: Archive) -> list[Message]:  # noqa: ANN401
    """Describe which state arrays the file lacks, and the consequences."""
    notes = []
    if m.nu and "ctrl" not in parts:
        notes.append(
            Message(
                "no ctrl in the file: what {actuators} were given is undecided, and taken from the "
                "states, as what leads closest to the next",
                actuators=Message("its actuators"),
            )
        )
        actions = [
            key for key in archive.arrays if key.rpartition("/")[2].lower().startswith("action")
        ]
        if actions:
            notes.append(
                Message(
                    "{actions} is not taken for ctrl: most environments make one of the other; "
                    "if it is: --map ctrl={actions}",
                    actions=actions[0],
                )
            )
    if m.na and "act" not in parts:
        notes.append(Message("no act in the file: activations are taken to be 0"))
    if m.nmocap and "mocap_pos" not in parts:
        notes.append(
            Message("no mocap_pos in the file: mocap bodies stay where the model has them")
        )
    if "qacc_warmstart" not in parts:
        notes.append(
            Message("no warm start in the file: each step's solver starts from MuJoCo's own")
        )
    if archive.objects:
        notes.append(
            Message("{keys} is no array of numbers, and is not read", keys=all_of(archive.objects))
        )
    return notes


def _listed(archive: Archive) -> str:
    keys = [*archive.arrays]
    return ", ".join(keys[:12]) + (", …" if keys[12:] else "") or "none"
