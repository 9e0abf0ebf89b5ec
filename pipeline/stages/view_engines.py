"""Show recordings; those of one drop in several engines are shown as one."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, replace
from pathlib import Path

from pipeline import colours
from pipeline.recording.blueprint import layout
from pipeline.recording.contents import is_script
from pipeline.recording.other_layer import Style, write_other_layer
from pipeline.recording.reader import read, recording_id
from pipeline.scenario import ENGINES, Engine, Scenario
from pipeline.stages.view import View, view


@contextmanager
def opened(recordings: Sequence[Path | str], *, web: bool = False) -> Iterator[View]:
    """Yield the view of some recordings; its files exist until the block ends.

    Recordings of the same drop in different engines are shown as one, with a colour per engine.

    Parameters
    ----------
    recordings
        The recordings to show.
    web
        Whether to show them in a browser.

    Raises
    ------
    RecordingError
        If one is missing or not one of ours.
    ViewerError
        If there is no screen.
    """
    paths = list(dict.fromkeys(map(Path, recordings)))
    scenarios = _of_one_drop(paths)
    if scenarios is None:
        yield view(paths, web=web)
        return
    first, *others = paths
    with tempfile.TemporaryDirectory(prefix="drop-") as folder:
        layers = {path: Path(folder, f"{number}.rrd") for number, path in enumerate(others)}
        shown = view([first], web=web, more=list(layers.values()))
        for path, layer in layers.items():
            engine = scenarios[path].engine
            write_other_layer(
                layer,
                path,
                recording_id=recording_id(first),
                style=Style(ENGINES[engine], colours.ENGINES[engine]),
                blueprint=layout(height_m=scenarios[first].height_m, camera=None),
            )
        yield replace(shown, recordings=paths)


def _of_one_drop(paths: Sequence[Path]) -> dict[Path, Scenario] | None:
    """Return the scenarios of recordings that differ only in the engine; None for others."""
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
