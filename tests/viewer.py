"""Open recordings in the real native Rerun viewer without a display, and check its images.

The viewer draws with Mesa's software Vulkan driver and is driven over its own control service, on
loopback, with a home folder of its own and analytics off.
"""

from __future__ import annotations

import io
import os
import signal
import socket
import subprocess
import tempfile
import time
from collections.abc import Collection, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from types import TracebackType
from typing import NamedTuple, Self

import numpy as np
from drop_physics.recording.viewer import binary
from numpy.typing import NDArray
from PIL import Image
from rerun.experimental import ViewerClient

Picture = NDArray[np.int64]

EXPECTED_WARNINGS = ("Software rasterizer detected", "inside a Docker container", "XDG_RUNTIME_DIR")
"""Warnings that the viewer prints on a machine without a display, not about a recording."""

BLANK = 0.002
"""An image counts as blank if a smaller fraction than this differs from its commonest colour."""
SAME = 8
"""Largest difference of a colour channel between two images of the same content."""
PATIENCE_S = 60.0
"""Time limit on a machine under load [s]."""
COLOURED = 20
"""Least number of pixels by which a colour counts as present."""
MOVED = 30
"""Least maximum difference of a colour channel by which a view counts as changed."""


def vulkan_driver() -> Path | None:
    """Return Mesa's software Vulkan driver, or None where it is not installed."""
    return next(Path("/usr/share/vulkan/icd.d").glob("lvp_icd*.json"), None)


def free_port() -> int:
    """Return a free port on loopback."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
    return port


def isolated(home: Path) -> dict[str, str]:
    """Return an environment without this user's Rerun settings, and without analytics."""
    settings = home / ".config/rerun"
    settings.mkdir(parents=True, exist_ok=True)
    environment = os.environ | {
        "HOME": str(home),
        "XDG_CONFIG_HOME": str(home / ".config"),
        "XDG_DATA_HOME": str(home / ".local/share"),
        "XDG_RUNTIME_DIR": str(home),
        "RUST_LOG": "warn",
        "NO_COLOR": "1",
    }
    subprocess.run(
        [binary(), "analytics", "disable"], env=environment, check=True, capture_output=True
    )
    return environment


class Viewer:
    """A viewer without a display, started with files as users do; use it in a `with` statement."""

    def __init__(self, *files: Path, size: str = "1200x750") -> None:
        self._home = tempfile.TemporaryDirectory()
        environment = isolated(Path(self._home.name))
        self.url = f"rerun+http://127.0.0.1:{free_port()}/proxy"
        port = self.url.rsplit(":", 1)[1].removesuffix("/proxy")
        self._log = Path(self._home.name, "viewer.log")
        with self._log.open("w") as log:
            self.process = subprocess.Popen(
                [
                    binary(),
                    *files,
                    "--headless",
                    "--renderer",
                    "vulkan",
                    "--bind",
                    "127.0.0.1",
                    "--port",
                    port,
                    "--window-size",
                    size,
                    "--hide-welcome-screen",
                ],
                env=environment,
                stdout=log,
                stderr=subprocess.STDOUT,
            )
        self.client = self._connected()
        if files:
            self._wait_until_loaded()

    def _connected(self) -> ViewerClient:
        deadline = time.monotonic() + PATIENCE_S
        while True:
            if self.process.poll() is not None:
                raise RuntimeError(f"the viewer died at start: {self._log.read_text()[-800:]}")
            try:
                client = ViewerClient.connect(self.url)
                client.get_state()
            except ConnectionError:
                if time.monotonic() > deadline:
                    self.close()
                    raise
                time.sleep(0.1)
            else:
                return client

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """End the viewer."""
        self.process.send_signal(signal.SIGTERM)
        try:
            self.process.wait(5)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self._home.cleanup()

    # -- what is open -----------------------------------------------------------------------------

    def _wait_until_loaded(self) -> None:
        deadline = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline and not self.warnings():
            state = self.client.get_state()
            if state.active_recording and state.views and not state.loading:
                break
            time.sleep(0.1)

    def warnings(self) -> list[str]:
        """Return the viewer's warnings."""
        return [
            f"{entry.level}: {entry.message}"
            for entry in self.client.get_logs()
            if entry.level in ("WARN", "ERROR")
            and not any(known in entry.message for known in EXPECTED_WARNINGS)
        ]

    def set_time(self, time_s: float) -> None:
        """Move the time cursor, and pause it there."""
        self.client.set_time("sim_time", duration=time_s, play_state="paused")

    # -- pictures ---------------------------------------------------------------------------------

    def view(self, name: str) -> Picture:
        """Return a view's image like `picture`, once the layout contains the view.

        Until then the viewer shows a layout of its own.
        """
        deadline = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline:
            for view in self.client.get_state().views:
                if view.name == name:
                    return self.picture(view.view_id)
            time.sleep(0.05)
        names = [view.name for view in self.client.get_state().views]
        raise AssertionError(f"no view is named {name}, but {names}")

    def shows(self, name: str, *colours: str) -> bool:
        """Whether a view becomes non-blank with these colours within the time limit."""
        deadline = time.monotonic() + PATIENCE_S
        while True:
            picture = self.view(name)
            if not is_blank(picture) and all(has_colour(picture, colour) for colour in colours):
                return True
            if time.monotonic() > deadline:
                return False
            time.sleep(0.2)

    def picture(self, view_id: str | None = None) -> Picture:
        """Return the window or one view as an RGB array, shape (height, width, 3)."""
        return decoded(self.client.take_screenshot(view_id))

    def settled(self) -> bytes:
        """Return a PNG of the window once two in a row are equal: chunks load on demand."""
        deadline = time.monotonic() + PATIENCE_S
        png = self.client.take_screenshot()
        while time.monotonic() < deadline and not self.warnings():
            time.sleep(0.2)
            last, png = png, self.client.take_screenshot()
            before, now = decoded(last), decoded(png)
            if before.shape == now.shape and np.abs(before - now).max() < SAME:
                break
        return png


def decoded(png: bytes) -> Picture:
    """Return a PNG as an RGB array, shape (height, width, 3)."""
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB")).astype(np.int64)


def is_blank(picture: Picture) -> bool:
    """Whether an image is one colour, apart from a negligible fraction."""
    colours = (picture // 8) @ (1 << 16, 1 << 8, 1)
    _, counts = np.unique(colours, return_counts=True)
    return bool(1 - counts.max() / counts.sum() < BLANK)


class Look(NamedTuple):
    """Requirements on a view's image."""

    moves: bool = False
    """Whether the image must change with time."""
    colours: Collection[str] = ()
    """Colours that the image must contain, as `#rrggbb`."""
    behind: bool = False
    """Whether the view is in a tab behind another."""


def has_colour(picture: Picture, colour: str) -> bool:
    """Whether an image has enough pixels of a colour: a curve, or its dot in the legend."""
    rgb = [int(colour[i : i + 2], 16) for i in (1, 3, 5)]
    return int((np.abs(picture - rgb).max(axis=2) < SAME).sum()) > COLOURED


def complaints(
    viewer: Viewer,
    *,
    views: Mapping[str, Look],
    times_s: Sequence[float] = (0.0, 0.3, 0.8),
    patience_s: float = PATIENCE_S,
) -> list[str]:
    """Check every view of the open recording at several times; return the unmet requirements.

    Again and again, until nothing is or the patience ends: of several files the layout of one may
    be there before the others are, and chunks load when needed.

    Parameters
    ----------
    viewer
        The viewer, started with a recording and perhaps its layers.
    views
        The name of every view that there must be, and how it must look.
    times_s
        Times to look at [s].
    patience_s
        For how long something may still be wrong [s].
    """
    deadline = time.monotonic() + patience_s
    while found := _complaints(viewer, views, times_s):
        if time.monotonic() > deadline or viewer.process.poll() is not None or viewer.warnings():
            break
    return found


def _complaints(viewer: Viewer, views: Mapping[str, Look], times_s: Sequence[float]) -> list[str]:
    state = viewer.client.get_state()
    found: list[str] = []
    if len(state.recordings) != 1:
        return [f"{len(state.recordings)} recordings", *viewer.warnings()]
    recording = state.recordings[0]
    if {timeline.name for timeline in recording.timelines} != {"call", "sim_step", "sim_time"}:
        found.append(f"timelines {[timeline.name for timeline in recording.timelines]}")
    if recording.current_timeline != "sim_time":
        found.append(f"opens on timeline {recording.current_timeline}")
    if sorted(view.name for view in state.views) != sorted(views):
        found.append(f"views {sorted(view.name for view in state.views)}")
    known = viewer.client.get_recording_schema(recording.store_id, paths_only=True).entities
    for view in state.views:
        origin = f"/{view.origin.strip('/')}"
        if not any(f"{one.entity_path}/".startswith(f"{origin}/") for one in known):
            found.append(f"{view.name} looks at {view.origin}, where nothing is")
    seen = [view for view in state.views if not views.get(view.name, Look()).behind]
    shots: dict[str, list[Picture]] = {view.name: [] for view in seen}
    for time_s in times_s:
        viewer.set_time(time_s)
        viewer.settled()
        for view in seen:
            picture = viewer.picture(view.view_id)
            shots[view.name].append(picture)
            if is_blank(picture):
                found.append(f"{view.name} is blank at {time_s:g} s")
    for name in shots.keys() & views.keys():
        look, pictures = views[name], shots[name]
        if look.moves and any(np.abs(a - b).max() < MOVED for a, b in pairwise(pictures)):
            found.append(f"{name} does not change with time")
        # In the last picture: words that fade in take on every grey in the first.
        found += [
            f"{name} shows nothing in {colour}"
            for colour in look.colours
            if not has_colour(pictures[-1], colour)
        ]
    for view in viewer.client.get_state().views:
        if not view.visible:
            found.append(f"{view.name} is not visible")
        found += [f"{view.name} reports {one.severity}: {one.summary}" for one in view.reports]
    if viewer.process.poll() is not None:
        found.append(f"the viewer died with {viewer.process.returncode}")
    return [*dict.fromkeys(found), *viewer.warnings()]
