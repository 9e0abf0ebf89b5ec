"""The command `view`: opens recordings in Rerun's viewer, with their analyses."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any

from drop_physics import colours
from drop_physics.drop.one_sample import DEFAULT_AT_S
from drop_physics.errors import ScenarioError
from drop_physics.explain.times import StepTimes
from drop_physics.printable import Printable
from drop_physics.recording import pictures, schema, viewer, writer
from drop_physics.recording.contents import ForeignError, is_script
from drop_physics.recording.drawing import poses_in_tree
from drop_physics.recording.layer_file import layer_of
from drop_physics.recording.layout import layout, look_of_drop
from drop_physics.recording.other_layer import Style, is_drawn, shapes_in, write_other_layer
from drop_physics.recording.reader import read, recording_id
from drop_physics.recording.viewer import Viewer
from drop_physics.recording.writer import Chunk
from drop_physics.scenario import ENGINES, Engine, Scenario
from drop_physics.stages import verbs
from drop_physics.stages.check import check
from drop_physics.stages.verbs.taken import takes_those_of
from drop_physics.temporary import temporary_folder
from drop_physics.trace.history import Seen


@dataclass(frozen=True)
class View(Printable, reported_by="drop_physics.report.view"):
    """The files that a viewer shows, and the command that starts it."""

    recordings: list[Path]
    layers: list[Path]
    stale: list[Path]
    """Layers with a matching name that belong to another recording, and are not shown."""
    viewer: Viewer
    golden: Path | None = None
    """Path of the golden recording, which is shown in grey."""
    same: bool | None = None
    """Whether both recordings show the same physics; None without a golden recording."""
    first_difference: int | None = None
    """First step at which a number or an image differs; None if none does."""
    settings_differ: bool = False
    """Whether the inputs of the two recordings differ."""
    not_compared: tuple[str, ...] = ()
    """Bodies whose motion is not recorded; if there are any, the recordings do not count as the
    same."""
    is_foreign: bool = False
    """Whether another program made any of the recordings; such recordings are shown unchanged."""


@takes_those_of(verbs.ViewArguments)
@contextmanager
def view(asked: verbs.ViewArguments) -> Iterator[View]:
    """Yield the files to view; temporary files exist until the `with` block ends.

    Recordings of the same drop in different engines are shown as one, with a colour per engine. Of
    two recordings of the same script, the second is shown in grey.

    Raises
    ------
    RecordingError
        If a recording is missing or was not written by drop, or `against` is of another kind.
    ScenarioError
        If several recordings are given together with a golden one.
    ViewerError
        If there is no screen.
    """
    paths = list(dict.fromkeys(map(Path, asked.recordings)))
    if asked.against is not None and len(asked.recordings) > 1:
        raise ScenarioError(
            "--against takes one recording to compare, got {n}", n=len(asked.recordings)
        )
    if asked.against is None and any(map(_is_foreign, paths)):
        yield View(paths, [], [], viewer.viewer(paths, web=asked.web), is_foreign=True)
        return
    with temporary_folder() as folder:
        if asked.against is not None:
            yield _with_golden(paths[0], Path(asked.against), folder, web=asked.web)
        elif _of_one_script(paths):
            yield _with_golden(paths[0], paths[1], folder, web=asked.web)
        elif scenarios := _of_one_drop(paths):
            yield _of_engines(scenarios, folder, web=asked.web)
        else:
            yield _view(paths, web=asked.web)


def _is_foreign(path: Path) -> bool:
    """Return whether another program made a recording, which is then shown unchanged."""
    try:
        recording_id(path)
    except ForeignError:
        return True
    return False


def _view(paths: Sequence[Path], *, web: bool, more: Sequence[Path] = ()) -> View:
    """Return the files to show: recordings, their analysis layers, and further layers `more`."""
    ids = {path: recording_id(path) for path in paths}
    beside = {layer_of(path): path for path in paths if layer_of(path).is_file()}
    beside = {layer: path for layer, path in beside.items() if layer not in paths}
    layers = [layer for layer, path in beside.items() if recording_id(layer) == ids[path]]
    stale = [layer for layer in beside if layer not in layers]
    return View([*paths], layers, stale, viewer.viewer([*paths, *layers, *more], web=web))


# -- beside a golden recording ---------------------------------------------------------------------


def _with_golden(path: Path, golden: Path, folder: Path, *, web: bool) -> View:
    checked = check(path, golden)
    layer = folder / "golden.rrd"
    shown = _view([path], web=web, more=[layer])
    drawn = None if is_drawn(golden) else chain(shapes_in(path), _poses(read(golden).seen))
    write_other_layer(
        layer, golden, recording_id=recording_id(path), labels=_moving(golden), drawn=drawn
    )
    return replace(
        shown,
        golden=golden,
        same=checked.same,
        first_difference=None if checked.first is None else checked.first.step,
        not_compared=tuple(checked.not_compared),
        settings_differ=checked.comparison is not None and bool(checked.comparison.differences),
    )


def _poses(seen: Seen) -> Iterator[Chunk]:
    """Yield poses and heights of a recording that lacks the viewer's data."""
    for number, body in seen.bodies.items():
        times = StepTimes(seen, body.client)
        for piece in seen.pieces():
            base = piece.bases[piece.bases["body"] == number]
            joints = piece.joints.get(number)
            steps = base["step"] if joints is None else joints.steps
            if not len(steps):
                continue
            at = writer.Times(steps, times.of_all(steps))
            motions = seen.motions(body, steps, base, joints)
            for entity, poses in poses_in_tree(body, motions):
                yield pictures.poses(entity, at, [poses])
            if not body.joints:
                yield writer.scalars_chunk(f"{schema.HEIGHT}/{body.label}", at, motions[:, 0, 2:3])


def _of_one_script(paths: Sequence[Path]) -> bool:
    """Return whether two recordings are of the same script."""
    if len(paths) != 2 or not all(map(is_script, paths)):
        return False
    first, other = (Path(str(read(path).origin.get("script", path))).name for path in paths)
    return first == other


def _moving(golden: Path) -> Collection[str] | None:
    """Return the names of bodies that can move; immovable ones would just cover the golden ones."""
    recording = read(golden)
    if recording.drop is not None:
        return None
    return [body.label for body in recording.seen.bodies.values() if body.moving]


# -- of one drop in several engines ----------------------------------------------------------------


def _of_engines(scenarios: dict[Path, Scenario], folder: Path, *, web: bool) -> View:
    first, *others = scenarios
    layers = {path: folder / f"{number}.rrd" for number, path in enumerate(others)}
    shown = _view([first], web=web, more=[*layers.values()])
    for path, layer in layers.items():
        engine = scenarios[path].engine
        write_other_layer(
            layer,
            path,
            recording_id=recording_id(first),
            style=Style(ENGINES[engine], colours.ENGINES[engine]),
            blueprint=layout(look_of_drop(scenarios[first].height_m, None)),
        )
    return replace(shown, recordings=[*scenarios])


def _of_one_drop(paths: Sequence[Path]) -> dict[Path, Scenario] | None:
    """Return the scenarios of drops that differ only in the engine; None for other drops."""
    if len(paths) < 2 or any(map(is_script, paths)):
        return None
    scenarios = {path: read(path).scenario for path in paths}
    engines: set[Engine] = {scenario.engine for scenario in scenarios.values()}
    first, *others = (
        {k: v for k, v in asdict(scenario).items() if k not in ("engine", "integrator")}
        for scenario in scenarios.values()
    )
    alike = all(settings == first for settings in others)
    return scenarios if alike and len(engines) == len(paths) else None


# -- the viewer ------------------------------------------------------------------------------------


def show(shown: View) -> None:
    """Open the viewer, and wait until the user closes it.

    Raises
    ------
    ViewerError
        If the viewer does not start, or fails.
    """
    process = viewer.start(shown.viewer, stays=False)
    step = shown.first_difference
    try:
        if (shown.layers or step is not None) and shown.viewer.page is None:
            viewer.put_cursor(shown.viewer, DEFAULT_AT_S, process, step=step)
        viewer.wait(process)
    finally:
        if process.poll() is None:
            process.terminate()
            process.wait()


def recording_of(result: Any) -> Path:  # noqa: ANN401
    """Return the path of a result's recording.

    Raises
    ------
    ScenarioError
        If the result has none.
    """
    recording: Path | None = getattr(getattr(result, "simulation", result), "recording", None)
    if recording is None:
        raise ScenarioError(
            "only a result that has a recording can be viewed, such as that of analyze"
        )
    return recording


def in_notebook(
    result: Any,  # noqa: ANN401 - a widget of Rerun's
    height_px: int,
    at_s: float | None = None,
) -> Any:  # noqa: ANN401
    """Return a notebook widget of Rerun's viewer, with a result's recording at a time [s].

    Raises
    ------
    ViewerError
        If `rerun-notebook` is not installed.
    ScenarioError
        If the result has no recording.
    """
    recording = recording_of(result)
    layer = getattr(result, "layer", None) or layer_of(recording)
    return viewer.in_notebook([recording, *([layer] if layer.is_file() else [])], height_px, at_s)


def spawn() -> str:
    """Open a viewer that stays open and waits for data, and return its URL.

    Raises
    ------
    ViewerError
        If there is no screen, or the viewer does not start.
    """
    opened = viewer.viewer()
    viewer.start(opened, stays=True)
    return opened.url


def connection(url: str) -> Callable[[], str]:
    """Return a function that checks a viewer's URL, and returns it if the viewer answers."""

    def connected() -> str:
        viewer.check_listens(url)
        return url

    return connected
