"""Makes steps with this MuJoCo from another run's states, with swapped model fields."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np

from .. import frames
from ..frames import STALE, STATE
from .answering import answer
from .asked import StepsAsked, edits_of
from .replay import TAKEN, Replay, ReplayedData, ReplayedModel, by_callback, take, take_stale

FORCES = ("passive", "actuator", "bias", "constraint")
ROWS = ("pos", "aref", "R", "type")
"""Arrays with one entry for each constraint row."""
FEATURES = {
    **{name[7:].lower(): ("disable", int(bit)) for name, bit in vars(mujoco.mjtDisableBit).items()
       if name.startswith("mjDSBL_")},
    **{name[7:].lower(): ("enable", int(bit)) for name, bit in vars(mujoco.mjtEnableBit).items()
       if name.startswith("mjENBL_")},
}  # fmt: skip
"""Optional features of a step, by MuJoCo's names: the kind of their flag, and its bit."""
_NOTHING = np.empty(0)


def main() -> None:
    """Serve requests until the input ends."""
    answer(Swaps())


class SwappedModel(ReplayedModel):
    """A model whose fields can be overwritten, and restored with `restore`."""

    def __init__(self, number: int, path: str) -> None:
        super().__init__(number, path)
        self._before: dict[str, Any] = {}

    def edit(self, name: str, indices: Any, values: Any) -> None:
        """Change elements of a field as the script did."""
        self.put(name, indices, values)

    def put(self, name: str, indices: Any, values: Any) -> None:
        """Set elements of any field."""
        owner, last = owner_of(self.m, name)
        held = getattr(owner, last)
        if isinstance(held, np.ndarray):
            self._before.setdefault(name, held.copy())
            held.reshape(-1)[indices] = values
        else:
            self._before.setdefault(name, held)
            setattr(owner, last, type(held)(values[0]))

    def switch_off(self, name: str) -> None:
        """Disable a feature."""
        kind, bit = FEATURES[name]
        flags = int(getattr(self.m.opt, f"{kind}flags"))
        now = flags | bit if kind == "disable" else flags & ~bit
        self.put(f"opt.{kind}flags", slice(None), [now])

    def restore(self) -> None:
        """Reset all fields to the values with which they were loaded."""
        for name, held in self._before.items():
            owner, last = owner_of(self.m, name)
            if isinstance(held, np.ndarray):
                getattr(owner, last)[:] = held
            else:
                setattr(owner, last, held)
        self._before.clear()


def owner_of(m: Any, name: str) -> tuple[Any, str]:
    """Return the object that has a field (`opt.timestep`, `geom_size`), and its attribute name."""
    first, _, last = name.rpartition(".")
    return (getattr(m, first) if first else m), last


class Swaps(Replay):
    """Serves requests for steps with swapped fields; keeps one model at a time."""

    _swapped: SwappedModel | None = None

    def _on_version(self, _: dict[str, Any]) -> Iterator[bytes]:
        """Reply with the version of this MuJoCo."""
        yield frames.arrays_bytes("version", {}, version=mujoco.__version__)
        yield TAKEN

    def _on_fields(self, _: dict[str, Any], path: str) -> Iterator[bytes]:
        """Reply with all fields of a model file, and the features that this version can disable."""
        m, found = mujoco.MjModel.from_binary_path(path), dict[str, Any]()
        for name in dir(m):
            value = None if name.startswith("_") else getattr(m, name)
            if isinstance(value, (np.ndarray, int, float)):
                found[name] = np.array(value)
        found["names"] = np.frombuffer(m.names, np.uint8)
        found["stat.meaninertia"] = np.array(m.stat.meaninertia)
        for name in dir(m.opt):
            value = getattr(m.opt, name)
            if not name.startswith("_") and isinstance(value, (int, float, np.ndarray)):
                found[f"opt.{name}"] = np.array(value)
        yield frames.arrays_bytes("fields", found, features=[*FEATURES])
        yield TAKEN

    def _on_put(
        self, arrays: dict[str, Any], path: str, edits: list[Any], off: list[str]
    ) -> Iterator[bytes]:
        """Load a model file, overwrite elements of its fields, and disable features."""
        model = self._swapped
        if model is None or self._path != path:
            self._data = self._model = self._swapped = None
            model = self._swapped = SwappedModel(0, path)
            self._path, self._data = path, ReplayedData(0, model)
        model.restore()
        for edit in edits_of(arrays, edits):
            model.put(edit.name, edit.indices, edit.values)
        for name in off:
            model.switch_off(name)
        yield from ()

    def _on_stages(self, arrays: dict[str, Any], **head: Any) -> Iterator[bytes]:
        """Make steps from recorded starts; reply with the results of their computation stages."""
        asked = StepsAsked(arrays, **head)
        rows: dict[str, list[Any]] = {}
        for step in range(asked.begin, asked.end):
            self._cross(asked, step)
            for name, row in self._computed().items():
                rows.setdefault(name, []).append(np.array(row, np.float64))  # MuJoCo's own memory
        yield frames.arrays_bytes("stages", {name: _gathered(each) for name, each in rows.items()})
        yield TAKEN

    def _on_swapped(self, arrays: dict[str, Any], **head: Any) -> Iterator[bytes]:
        """Make steps from recorded starts; reply with the states after them."""
        asked = StepsAsked(arrays, **head)
        rows: dict[str, list[Any]] = {}
        for step in range(asked.begin, asked.end):
            d = self._cross(asked, step)
            for name in STATE:
                row = np.ravel(getattr(d, name, _NOTHING)).astype(np.float64)
                rows.setdefault(name, []).append(row)
        yield frames.arrays_bytes("states", {name: np.array(each) for name, each in rows.items()})
        yield TAKEN

    def _on_rolled(self, arrays: dict[str, Any], **head: Any) -> Iterator[bytes]:
        """Repeat the run once for each velocity change; reply with the last positions."""
        nudges, asked, state = arrays.pop("nudges"), StepsAsked(arrays, **head), self._data
        assert state is not None
        ends = []
        for nudge in nudges:
            for step in range(asked.begin, asked.end):
                for edit in asked.edits.get(step, ()):
                    state.model.edit(edit.name, edit.indices, edit.values)
                state.reached = -1 if step == asked.begin else asked.first + step
                state.reach(asked, step)
                if step == asked.begin:
                    state.d.qvel[:] += nudge
                self._take(state, asked, step)
            ends.append(state.d.qpos.copy())
        yield frames.arrays_bytes("ends", {"qpos": np.array(ends)})
        yield TAKEN

    def _on_trail(self, arrays: dict[str, Any], **head: Any) -> Iterator[bytes]:
        """Repeat the run from its first step; reply with all positions and velocities."""
        asked, state = StepsAsked(arrays, **head), self._data
        assert state is not None
        rows: dict[str, list[Any]] = {"qpos": [], "qvel": []}
        for step in range(asked.begin, asked.end):
            for edit in asked.edits.get(step, ()):
                state.model.edit(edit.name, edit.indices, edit.values)
            state.reached = -1 if step == asked.begin else asked.first + step
            state.reach(asked, step)
            self._take(state, asked, step)
            for name, held in rows.items():
                held.append(getattr(state.d, name).copy())
        yield frames.arrays_bytes("trail", {name: np.array(held) for name, held in rows.items()})
        yield TAKEN

    def _cross(self, asked: StepsAsked, step: int) -> Any:
        """Make a step from its recorded start; return the MjData."""
        state = self._data
        assert state is not None
        for edit in asked.edits.get(step, ()):
            state.model.edit(edit.name, edit.indices, edit.values)
        state.reached = -1
        state.reach(asked, step)
        self._take(state, asked, step)
        return state.d

    def _take(self, state: ReplayedData, asked: StepsAsked, step: int) -> None:
        """Make a step from the current state."""
        answers = asked.answers(step, state.model.m.nv)
        self._set_callbacks(frozenset(which for which, _ in answers))
        self._now, self._calls = state, by_callback(answers)
        function = int(asked.functions[step])
        if function & STALE:
            take_stale(state, state.state(), asked.posed(step), function & 15)
        else:
            take(state.model.m, state, function & 15)
        self._now = None

    def _computed(self) -> dict[str, Any]:
        """Return what each stage of the last step computed: positions, contacts and forces."""
        assert self._data is not None
        d = self._data.d
        contact = d.contact
        found = {
            "xpos": d.xpos.ravel(),
            "geoms": np.asarray(contact.geom, np.float64).reshape(-1, 2),
            "dist": np.asarray(contact.dist).reshape(-1, 1),
            "pos": np.asarray(contact.pos).reshape(-1, 3),
            "frame": np.asarray(contact.frame).reshape(-1, 9)[:, :3],
        }
        found |= {f"qfrc_{name}": getattr(d, f"qfrc_{name}") for name in FORCES}
        return found | {f"efc_{name}": getattr(d, f"efc_{name}").reshape(-1, 1) for name in ROWS}


def _gathered(rows: list[Any]) -> Any:
    """Join rows of different lengths into one array: row count, row lengths, then the numbers."""
    lengths = [len(row) for row in rows]
    numbers = [row.ravel() for row in rows]
    return np.concatenate([np.array([len(rows), *lengths], np.float64), *numbers])
