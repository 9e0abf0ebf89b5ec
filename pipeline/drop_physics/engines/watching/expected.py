"""Checks an expectation at the end of a run, and notes the motion of all bodies."""

from __future__ import annotations

import base64
import os
import re
import sys
from array import array
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from .asserted import Assertion, assertion_of
from .evaluating import Evaluator
from .expression import EPISODE, PRINTED, SERIES, Expression
from .observed import LABEL, NUMBERS, Observed, UnknownNameError, nearest
from .sites import is_library

if TYPE_CHECKING:
    from .host import EngineWatch

MOST_ROWS = 160
"""Largest number of states of a simulation's motion that are kept: about as many as a plotted curve
needs."""
MOST_OBSERVED = 8
"""Largest number of simulations that are observed: the ones stepped most recently."""
OURS = __name__.partition(".")[0], "drop_physics"
"""Packages of drop in the script's interpreter."""
NUMBER = re.compile(r"(?<![\w.])[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?(?!\w)")
"""Pattern of a number in a text."""


class ExpectationEvaluator(Evaluator):
    """Evaluates an expectation's expression at the end of a run.

    Parameters
    ----------
    text
        The expression; None for the condition of the script's `assert` that fails.
    asserted
        Whether the expression is the condition of the script's `assert`: it holds if no `assert`
        fails.
    rows
        Rows of the table of changes, by engine, to list the changes that are possible in the run;
        None to list none.
    of_running
        Whether only the episode counts that is running when the evaluation begins.
    """

    def __init__(
        self,
        text: str | None,
        *,
        asserted: bool = False,
        rows: Mapping[str, Sequence[dict[str, Any]]] | None = None,
        of_running: bool = False,
    ) -> None:
        self._of_running = of_running
        self._episode: int | None = None
        """The index of the only episode that counts; None for all."""
        self._expression = None if text is None else Expression(text)
        self._asserted, self._rows = asserted or text is None, rows
        self._reads = [] if self._expression is None else [*self._expression.reads()]
        self._tracks: dict[int, ObservedSeries] = {}
        self._engines: dict[int, EngineWatch] = {}
        self._frame: Any = None
        self._frames: list[Any] = []
        self._before: Any = None
        """Result of the evaluation made before the last simulation ended."""
        self._could: list[Any] | None = None
        """The changes that are possible in the run, as found before a simulation ended."""
        self._assertion: Assertion | None = None
        """The first failed `assert`."""
        reads_prints = self._expression is not None and self._expression.reads_prints
        self._printed = printed() if reads_prints else None

    def step(self, engine: EngineWatch, frame: Any) -> None:
        """Note an engine step, called from the given frame of the script."""
        if frame is not self._frame:
            self._frame, self._frames = frame, _frames_of(frame)
        self._engines[id(engine)] = engine
        if self._of_running and self._episode is None:
            self._episode = engine.host.environments.running
        observed = engine.observed()
        if observed is None:
            return
        track = self._tracks.pop(id(observed), None)
        if track is None:
            track = ObservedSeries(observed, self._reads)
            while len(self._tracks) >= MOST_OBSERVED:
                self._tracks.pop(next(iter(self._tracks)))
        self._tracks[id(observed)] = track  # the last one is the current
        track.step()

    def failed(self, error: BaseException) -> None:
        """Note an exception that ends the script or one of its tests."""
        if self._assertion is None and self._asserted:
            self._assertion = assertion_of(error)

    def before_end(self) -> None:
        """Evaluate the expression before a simulation ends, while its state can still be read."""
        self._before = self._judged()
        if self._rows is not None:
            self._could = self._changes(self._rows)

    def answer(self) -> Any:
        """Return the result of the expectation, after the script has ended."""
        found = self._judged()
        if found["error"] is not None and self._before is not None:
            found = self._before
        if self._asserted:
            found = {**found, "holds": self._assertion is None, "error": None}
        first = [*self._tracks.values()]
        if self._rows is not None and self._could is None:
            self._could = self._changes(self._rows)
        return {
            **found,
            "motion": [track.motion() for track in sorted(first, key=lambda each: each.number)],
            "finite": all(track.is_finite for track in first),
            "changes": self._could,
            "modules": [] if self._rows is None else [*_modules()],
            "assertion": None if self._assertion is None else self._assertion.told(),
        }

    def _changes(self, rows: Mapping[str, Sequence[dict[str, Any]]]) -> list[Any]:
        return [
            {**asdict(each), "engine": engine.name}
            for engine in self._engines.values()
            for each in engine.possible(rows[engine.name])
        ]

    def _judged(self) -> dict[str, Any]:
        expression, frames, failed = self._expression, self._frames, self._assertion
        if failed is not None:
            if expression is not None and expression.text != failed.text:  # another one
                return {"holds": False, "margin": None, "value": None, "error": None}
            expression, frames = Expression(failed.text), _frames_of(failed.frame)
        if expression is None:
            return {"holds": True, "margin": None, "value": None, "error": None}
        script = _names_of(frames)
        try:
            from .series import FUNCTIONS

            ours = {**FUNCTIONS, **{kind: self._reading(kind) for kind in SERIES}}
            for engine in [*self._engines.values()][:1]:  # a loop's own names are of its last step
                ours.update(engine.host.environments.outcome(self._episode))
            script = {
                name: value
                for name, value in script.items()
                if name not in EPISODE or name not in ours
            }
            if self._printed is not None:
                ours[PRINTED] = [float(each) for each in NUMBER.findall("".join(self._printed))]
            holds, margin, value = expression.judged(script, ours)
        except UnknownNameError as error:
            return _failed(error, unknown=error.name, nearest=error.nearest)
        except NameError as error:
            name = getattr(error, "name", None) or str(error).split("'")[1]
            known = {*SERIES, *(each for each in script if not each.startswith("_"))}
            return _failed(error, unknown=name, nearest=nearest(name, known))
        except Exception as error:  # noqa: BLE001 - the script's own names may be anything
            return _failed(error)
        return {"holds": holds, "margin": margin, "value": value, "error": None}

    def _reading(self, kind: str) -> Callable[..., Any]:
        def read(*names: Any) -> Any:
            unknown: UnknownNameError | None = None
            series: dict[object, Any] = {}
            labels = [each for each in names if isinstance(each, str) and LABEL.fullmatch(each)]
            for track in reversed([*self._tracks.values()]):
                try:
                    series.setdefault(track.simulation, track.series(kind, names))
                except UnknownNameError as error:
                    unknown = unknown or error
                if series and not labels:  # a name is one of the last simulation that has it
                    break
            if len(series) > 1:  # the engine's ids do not tell the numbers of reports
                raise UnknownNameError(labels[0], [labels[0].partition("_")[2]])
            if series:
                return series.popitem()[1]
            raise unknown or UnknownNameError(str(names), ())

        return read


class ObservedSeries:
    """Time series of the quantities that an expectation reads, one value per step.

    Parameters
    ----------
    observed
        The observed simulation.
    reads
        The series to read: a function, and names of bodies or joints; None for all of them.
    """

    made = 0
    """Number of series objects created in this process."""

    def __init__(
        self, observed: Observed, reads: Sequence[tuple[str, tuple[Any, ...] | None]]
    ) -> None:
        self.number, ObservedSeries.made = ObservedSeries.made, ObservedSeries.made + 1
        self._observed = observed
        self._waiting = [(kind, names) for kind, names in reads if names is not None]
        """Series whose names are not known yet: a body may be loaded later."""
        self._reads: dict[tuple[str, tuple[Any, ...]], tuple[Callable[[], Any], list[Any]]] = {}
        self._times = array("d")
        self._since: dict[tuple[str, tuple[Any, ...]], int] = {}
        self._steps, self._stride, self._seen = 0, 1, 0
        self._rows: list[list[float]] = []
        self._astray: dict[str, float] = {}
        """Sum over steps of the squared distance from the target, by motor command."""
        self.is_finite = True

    @property
    def simulation(self) -> object:
        """The engine's id of the simulation."""
        return self._observed.simulation

    def step(self) -> None:
        """Read the quantities after a step."""
        if self._waiting:
            self._find()
        self._times.append(self._observed.time_s)
        for read, values in self._reads.values():
            values.append(read())
        if not self._steps % self._stride:
            self._rows.append(self._observed.positions())
            self.is_finite &= self._observed.is_finite()
            for name, far in self._observed.astray().items():
                self._astray[name] = self._astray.get(name, 0.0) + far * far
            self._seen += 1
            if len(self._rows) > MOST_ROWS:
                del self._rows[1::2]
                self._stride *= 2
        self._steps += 1

    def series(self, kind: str, names: tuple[Any, ...]) -> Any:
        """Return a time series, given its function (`z`, `joint` …) and its arguments."""
        from .series import series_of

        key = kind, names
        if key not in self._reads:  # of a number that was not known before: what it is now
            return series_of([self._observed.reader(kind, *names)()], self._times[-1:])
        return series_of(self._reads[key][1], self._times[self._since[key] :])

    def motion(self) -> dict[str, Any]:
        """Return the motion of all bodies: positions [m] after every `stride` steps, by body."""
        bodies = self._observed.bodies()
        width = NUMBERS * len(bodies)
        flat = array("d")
        for row in self._rows:
            flat.extend([*row, *[float("nan")] * (width - len(row))])
        return {
            "stride": self._stride,
            "steps": self._steps,
            "bodies": [*bodies],
            "astray": {name: (far / self._seen) ** 0.5 for name, far in self._astray.items()},
            "positions": base64.b64encode(flat.tobytes()).decode(),
            "step_s": self._step_s(),
        }

    def _step_s(self) -> float:
        """Return the mean timestep [s]; 0 if the clock began again, as for a new episode."""
        passed = [now - then for then, now in zip(self._times, self._times[1:])]
        return sum(passed) / len(passed) if passed and min(passed) >= 0 else 0.0

    def _find(self) -> None:
        for key in [*self._waiting]:
            try:
                self._reads[key] = self._observed.reader(key[0], *key[1]), []
            except UnknownNameError:
                continue
            self._since[key] = len(self._times)
            self._waiting.remove(key)


def printed() -> list[str]:
    """Return the list to which the script's printed texts are added from now on."""
    write = sys.stdout.write
    kept: list[str] | None = getattr(write, "drop_kept", None)
    if kept is not None:
        return kept
    texts: list[str] = []

    def kept_and_written(text: str) -> int:
        texts.append(text)
        return write(text)

    kept_and_written.drop_kept = texts  # type: ignore[attr-defined]
    sys.stdout.write = kept_and_written  # type: ignore[method-assign]
    return texts


def _modules() -> Iterator[str]:
    """Yield the files of the script's own modules, and of the script itself."""
    for name, module in [*sys.modules.items()]:
        file = getattr(module, "__file__", None)
        if not isinstance(file, str) or not file.endswith(".py") or is_library(file):
            continue
        if name.partition(".")[0] not in OURS:
            yield os.path.realpath(file)


def _frames_of(frame: Any) -> list[Any]:
    """Return the script's frames that led to a call, the innermost first."""
    frames = []
    while frame is not None:
        if not is_library(frame.f_code.co_filename):
            frames.append(frame)
        if frame.f_globals.get("__name__") == "__main__" and frame.f_code.co_name == "<module>":
            break
        frame = frame.f_back
    return frames


def _names_of(frames: Sequence[Any]) -> dict[str, Any]:
    """Return the variables that are visible in frames of the script."""
    names: dict[str, Any] = {}
    for frame in reversed(frames):
        names.update(frame.f_globals)
    for frame in reversed(frames):
        names.update(frame.f_locals)
    return names


def _failed(
    error: Exception, unknown: str | None = None, nearest: Sequence[str] = ()
) -> dict[str, Any]:
    said = {
        "kind": type(error).__name__,
        "text": str(error),
        "unknown": unknown,
        "nearest": [*nearest],
    }
    return {"holds": False, "margin": None, "value": None, "error": said}
