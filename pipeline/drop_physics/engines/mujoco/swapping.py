"""A process with a run's MuJoCo that makes single steps with swapped model fields."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drop_physics.engines.mujoco import frames
from drop_physics.engines.mujoco.described import DescribedModel, base_of, joints_of
from drop_physics.engines.mujoco.stepping import Stepper, StepsWanted, packed_edits, request_of
from drop_physics.trace.frames import Frames, ModelEdit

Float64 = NDArray[np.float64]
Arrays = Mapping[str, NDArray[Any]]


class Swapper(Stepper):
    """A process that makes single steps with a changed model; use it in a `with` statement.

    Parameters
    ----------
    python
        The process's interpreter.
    environment
        Environment variables of the process, in addition to the user's.
    model
        The file of the compiled model.
    """

    module = "mujoco.explain.swapped"
    group = 0

    def __init__(self, python: str, environment: Mapping[str, str], model: Path) -> None:
        super().__init__(python, None, environment)
        self._model = model
        self.jobs = self.steps = 0
        """Number of requests, and number of steps that they made."""

    def fields(self) -> tuple[Arrays, list[str]]:
        """Return all fields of the model, and the features that this MuJoCo version can disable."""
        self._send(frames.arrays_bytes("fields", {}, path=str(self._model)))
        ((said, arrays),) = self._answers()
        return arrays, said["features"]

    def engine(self) -> str:
        """Return name and version of the process's engine; empty if MuJoCo is not installed."""
        self._send(frames.arrays_bytes("version", {}))
        ((said, _),) = self._answers()
        return f"MuJoCo {said['version']}"

    def states(
        self, wanted: StepsWanted | Frames, edits: Sequence[ModelEdit] = (), off: Sequence[str] = ()
    ) -> dict[str, Float64]:
        """Make steps from their recorded starts; return the states after them, (n, width) each.

        Parameters
        ----------
        wanted
            The steps.
        edits
            Model fields with other values, in effect for all steps.
        off
            The features that are disabled.
        """
        if isinstance(wanted, StepsWanted):
            return super().states(wanted)
        return self._asked("swapped", wanted, edits, off)

    def stages(self, wanted: Frames, edits: Sequence[ModelEdit] = ()) -> dict[str, list[Float64]]:
        """Return the results of each step's computation stages: a flat array for each name."""
        answer = self._asked("stages", wanted, edits)
        return {name: _apart(numbers) for name, numbers in answer.items()}

    def rolled(self, wanted: Frames, begin: int, nudges: Float64) -> Float64:
        """Repeat a run from a step to its end, once for each change of the start velocities.

        Returns the last positions, shape (nudges, width).
        """
        ends: Float64 = self._asked("rolled", wanted, begin=begin, nudges=nudges)["qpos"]
        return ends

    def trail(self, wanted: Frames, edits: Sequence[ModelEdit]) -> dict[str, Float64]:
        """Repeat a run with other field values; return `qpos` and `qvel` after each step."""
        return self._asked("trail", wanted, edits)

    def _asked(
        self,
        what: str,
        wanted: Frames,
        edits: Sequence[ModelEdit] = (),
        off: Sequence[str] = (),
        begin: int = 0,
        **more: NDArray[Any],
    ) -> dict[str, Any]:
        arrays, listed = packed_edits(edits)
        put = {"path": str(self._model), "edits": listed, "off": [*off]}
        self._send(frames.arrays_bytes("put", arrays, **put))
        self._send(request_of(what, StepsWanted(self._model, wanted, begin, len(wanted)), more))
        self.jobs, self.steps = self.jobs + 1, self.steps + len(wanted) - begin
        ((_, answer),) = self._answers()
        return answer


def _apart(numbers: Float64) -> list[Float64]:
    """Split a flat array that `explain.swapped` joined into its rows."""
    count = int(numbers[0])
    lengths, flat = numbers[1 : count + 1].astype(np.int64), numbers[count + 1 :]
    width = len(flat) // max(int(lengths.sum()), 1)
    return np.split(flat, np.cumsum(lengths)[:-1] * width)


def numbers_of(model: DescribedModel, trail: Mapping[str, Float64]) -> dict[int, Float64]:
    """Return each body's coordinates after each step of a repeated run, (n, k), by body id.

    The coordinates are those of a floating base, if there is one, then the positions of all joints,
    then their velocities.
    """
    qpos, qvel = trail["qpos"], trail["qvel"]
    found = {}
    for made in model.bodies:
        parts = [] if made.free < 0 else [base_of(model.arrays, made, qpos, qvel)]
        if len(made.rates):
            parts += joints_of(made, qpos, qvel)
        if parts:
            found[made.body.number] = np.hstack(parts)
    return found
