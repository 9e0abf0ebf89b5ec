"""Open recordings in Rerun's viewer, each with its analysis if there is one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from pipeline.analysis.drop.one_sample import DEFAULT_AT_S
from pipeline.recording import viewer
from pipeline.recording.layer import layer_of
from pipeline.recording.reader import recording_id
from pipeline.recording.viewer import Viewer
from pipeline.shown import Shown


@dataclass(frozen=True)
class View(Shown, lines_of="pipeline.console.show_view:view_lines"):
    """What the viewer shows, and how it is started."""

    recordings: list[Path]
    layers: list[Path]
    stale: list[Path]
    """Layers of another recording that had this name; they are not shown."""
    viewer: Viewer
    golden: Path | None = None
    """The golden recording, shown in grey."""
    same: bool | None = None
    """Whether the two are the same physics; None without a golden recording."""
    first_difference: int | None = None
    """The first step at which a number or a picture differs; None if none does."""
    not_compared: tuple[str, ...] = ()
    """Bodies whose motion is not recorded; with one, the two are not the same physics."""


def view(recordings: Sequence[Path | str], *, web: bool = False, more: Sequence[Path] = ()) -> View:
    """Find the layers of recordings, and the viewer to show them in.

    Parameters
    ----------
    recordings
        The recordings to show.
    web
        Whether to show them in a browser.
    more
        Other layers to show.

    Raises
    ------
    RecordingError
        If one is missing or not one of ours.
    ViewerError
        If there is no screen.
    """
    paths = list(dict.fromkeys(map(Path, recordings)))
    ids = {path: recording_id(path) for path in paths}
    beside = {layer_of(path): path for path in paths if layer_of(path).is_file()}
    beside = {layer: path for layer, path in beside.items() if layer not in paths}
    layers = [layer for layer, path in beside.items() if recording_id(layer) == ids[path]]
    stale = [layer for layer in beside if layer not in layers]
    return View(paths, layers, stale, viewer.viewer([*paths, *layers, *more], web=web))


def show(shown: View) -> None:
    """Open the viewer, and wait until it is closed.

    Raises
    ------
    ViewerError
        If it does not start, or fails.
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


def spawn() -> str:
    """Open a viewer that waits for data and stays open, and return its URL.

    Raises
    ------
    ViewerError
        If there is no screen, or it does not start.
    """
    opened = viewer.viewer()
    viewer.start(opened, stays=True)
    return opened.url


def connection(url: str) -> Callable[[], str]:
    """Return a function that checks that a viewer listens at a URL, and returns the URL."""

    def connected() -> str:
        viewer.check_listens(url)
        return url

    return connected
