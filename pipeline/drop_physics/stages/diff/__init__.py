"""The command `diff`: finds why two runs differ, by swapping values and repeating single steps."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path

from drop_physics.engines.mujoco.crossed import CrossedRun as CrossedSide
from drop_physics.engines.mujoco.crossed import CrossedRuns
from drop_physics.engines.mujoco.swapping import Swapper
from drop_physics.engines.mujoco.taken import taken
from drop_physics.errors import DropError
from drop_physics.experiments.swap.answer import ProvedDifference
from drop_physics.experiments.swap.cause import Alike, CauseSearch
from drop_physics.experiments.swap.first import first_apart
from drop_physics.files.outputs import check_target, make_folder
from drop_physics.printable import Printable
from drop_physics.recording.reader import Recording
from drop_physics.stages import verbs
from drop_physics.stages.diff.by_calls import answered_by_calls, steps_of
from drop_physics.stages.diff.by_samples import answered_by_samples
from drop_physics.stages.diff.pictures import PicturesApart, pictures_apart
from drop_physics.stages.diff.sides import RunSide, recorded_side, side_of, sides_of
from drop_physics.stages.diff.two_engines import AGREES, answered_by_engines
from drop_physics.stages.record import interrupts
from drop_physics.stages.verbs.taken import takes_those_of
from drop_physics.temporary import temporary_folder
from drop_physics.trace.history import DEFAULT_ENGINE

MOST_SIMULATIONS = 32
"""Largest number of a script's simulations in which the first difference is searched."""


@dataclass(frozen=True)
class Diff(Printable, reported_by="drop_physics.report.diff"):
    """Result of `drop diff`: why two runs differ."""

    a: str
    b: str
    answer: ProvedDifference
    tolerance: float
    engines: tuple[str, str]
    runs: int
    """Number of repetitions: single steps, or whole runs."""
    recordings: tuple[Path, Path] | None
    """Paths of both recordings; None if they were temporary."""
    host: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    """Differences between the machines or environments of the runs, by name."""
    ended: tuple[str, str] = ("finished", "finished")
    """How each run ended."""
    unseeded: Sequence[str] = ()
    """Lines of the scripts that draw unseeded random numbers."""
    pictures: PicturesApart | None = None
    """Number of images that differ although the states are the same, if the engine draws images
    itself."""


@takes_those_of(verbs.DiffArguments)
def diff(asked: verbs.DiffArguments) -> Diff:
    """Run two scripts, or one script in two ways, or read recordings, and explain how they differ.

    Raises
    ------
    ScenarioError
        If the arguments do not define two sides.
    DropError
        If a side cannot be run or read, or has no step.
    """
    a, b = sides_of(
        asked.words or (),
        packages=asked.packages,
        arguments=asked.arguments,
        variables=asked.variables,
        pythons=asked.pythons,
        twice=asked.twice,
        revision=asked.revision,
    )
    names = a.named(b) or Path(a.target).name, b.named(a) or Path(b.target).name
    if names[0] == names[1]:
        names = f"{names[0]} (a)", f"{names[1]} (b)"
    with ExitStack() as stack:
        if asked.out is not None:
            folder = Path(asked.out)
            make_folder(folder)
        else:
            folder = stack.enter_context(temporary_folder())
        paths = folder / "a.rrd", folder / "b.rrd"
        for each, side in zip(paths, (a, b), strict=True):
            if not side.is_recording:
                check_target(each, force=asked.force)
        mine, theirs = (
            recorded_side(side, path, asked, name=name)
            for side, path, name in zip((a, b), paths, names, strict=True)
        )
        found = _compared(mine, theirs, asked.tolerance, asked.tell, asked.align)
    kept = None if asked.out is None else (mine.recording.path, theirs.recording.path)
    return replace(found, recordings=kept)


def why_apart(a: Recording, b: Recording, names: tuple[str, str], tolerance: float) -> Diff | None:
    """Return why two recordings differ; None if that cannot be determined.

    This needs an interpreter with the engine of each recording; no package is downloaded.
    """
    try:
        sides = [side_of(each, name) for each, name in zip((a, b), names, strict=True)]
        return _compared(sides[0], sides[1], tolerance, lambda _: None)
    except DropError:
        return None


def _compared(
    a: RunSide,
    b: RunSide,
    tolerance: float,
    tell: Callable[[int], None],
    align: str = "step",
) -> Diff:
    answer, runs = _answered(a, b, tolerance, tell, by_time=align == "time")
    engines, first = (a.recording.seen.engine, b.recording.seen.engine), answer.first
    two = DEFAULT_ENGINE in engines and engines[0] != engines[1]
    return Diff(
        a.name,
        b.name,
        answer,
        tolerance or (AGREES if two else 0.0),
        engines,
        runs,
        None,
        _host(a.recording, b.recording),
        (_ending(a.recording), _ending(b.recording)),
        [*dict.fromkeys((*a.recording.seen.unseeded, *b.recording.seen.unseeded))],
        pictures_apart(a.recording, b.recording, None if first is None else first.step),
    )


def _ending(held: Recording) -> str:
    return str((held.ended or {}).get("ended", "unfinished"))


HOST = ("hash_seed", "numpy", "blas", "blas_threads", "machine", "version")
"""Properties of a recording, other than the script, on which its numbers may depend."""


def _host(a: Recording, b: Recording) -> dict[str, tuple[str, str]]:
    mine, theirs = (
        {name: str((each.ended or {}).get(f"made_with_{name}", "")) for name in HOST}
        for each in (a, b)
    )
    return {
        name: (mine[name], theirs[name])
        for name in HOST
        if mine[name] != theirs[name] or (name == "hash_seed" and mine[name] == "random")
    }


def _answered(
    a: RunSide, b: RunSide, tolerance: float, tell: Callable[[int], None], *, by_time: bool
) -> tuple[ProvedDifference, int]:
    """Return why the runs differ, and the number of steps repeated to find out."""
    engines = a.recording.seen.engine, b.recording.seen.engine
    for side in (a, b):
        steps_of(side)  # if there are any
    if engines == (DEFAULT_ENGINE, DEFAULT_ENGINE):
        return answered_by_calls(a, b, tolerance, tell)
    if DEFAULT_ENGINE in engines:
        return answered_by_engines(a, b, tolerance, tell)
    if not (a.recording.steps.clients and b.recording.steps.clients):  # of an earlier schema
        return answered_by_samples(a, b, tolerance), 0
    with ExitStack() as stack:
        crossed, swappers = _earliest(stack, a, b, tolerance, by_time=by_time)
        alike = Alike(_is_same_script(a.recording, b.recording), engines[0] == engines[1])
        sites, halted = _sites(a.recording, b.recording), threading.Event()

        def halts() -> bool:
            tell(sum(swapper.jobs for swapper in swappers))
            return halted.is_set()

        with interrupts(halted.set):
            answer = CauseSearch(crossed, alike, tolerance, sites, halts).answer()
        return answer, sum(swapper.jobs for swapper in swappers)


def _earliest(
    stack: ExitStack, a: RunSide, b: RunSide, tolerance: float, *, by_time: bool
) -> tuple[CrossedRuns, Sequence[Swapper]]:
    """Return the pair of simulations that differs first, with processes that repeat steps."""
    both = [*zip(a.recording.steps.clients, b.recording.steps.clients, strict=False)]
    firsts = []
    for number, clients in enumerate(both[:MOST_SIMULATIONS] if len(both) > 1 else ()):
        with ExitStack() as one:
            crossed, _ = _crossed(one, a, b, clients, tolerance, by_time=by_time)
            first = first_apart(crossed.common, tolerance)
            firsts.append((first.time_s if first is not None else math.inf, number))
    chosen = both[min(firsts, default=(0.0, 0))[1]]
    return _crossed(stack, a, b, chosen, tolerance, by_time=by_time)


def _crossed(
    stack: ExitStack,
    a: RunSide,
    b: RunSide,
    clients: tuple[int, int],
    tolerance: float,
    *,
    by_time: bool,
) -> tuple[CrossedRuns, Sequence[Swapper]]:
    """Return one simulation of each run, with the process that repeats its steps."""
    folder = stack.enter_context(temporary_folder())
    sides: list[CrossedSide] = []
    swappers: list[Swapper] = []
    for n, (side, client) in enumerate(zip((a, b), clients, strict=True)):
        steps, engine = side.recording.steps, side.recording.seen.engine
        pieces = [*steps.pieces(client, 0, 1 << 62)]
        model = folder / f"{n}.mjb"
        model.write_bytes(steps.model(pieces[0].model))
        swapper = stack.enter_context(Swapper(side.python, side.environment, model))
        if (has := swapper.engine()) != engine:
            raise DropError(
                "{path} was made with {engine}, and {python} has {has}; give: --with {package}",
                path=side.recording.path,
                engine=engine,
                python=side.python,
                has=has,
                package=engine.lower().replace(" ", "=="),
            )
        fields, features = swapper.fields()
        sides.append(CrossedSide(engine, swapper, fields, features, taken(pieces, fields)))
        swappers.append(swapper)
    return CrossedRuns(sides[0], sides[1], tolerance, by_time=by_time), swappers


def _is_same_script(a: Recording, b: Recording) -> bool:
    """Return whether both runs had the same script text and arguments."""
    names = ("script_sha256", "arguments", "seed")
    mine, theirs = ([each.origin_and_end.get(name) for name in names] for each in (a, b))
    return mine == theirs and mine[0] is not None


def _sites(a: Recording, b: Recording) -> Callable[[str, int], tuple[str | None, str | None]]:
    """Return a function that finds the script lines which set a value before a step."""

    def site(name: str, step: int) -> tuple[str | None, str | None]:
        found: list[str | None] = []
        for each in (a, b):
            calls = [*each.seen.sampled.piece(step, step + 1).calls]
            its = [call for call in calls if call.function == name] or calls
            found.append(its[-1].site.place if its else None)
        return found[0], found[1]

    return site
