"""Starts Rerun's viewer, reachable from this machine only.

Rerun's telemetry is disabled in all processes started here. The page of the web viewer, however,
sends requests from the browser, which Rerun has no option to prevent.
"""

from __future__ import annotations

import contextlib
import ctypes
import importlib.util
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from drop_physics.errors import DropError, ScenarioError
from drop_physics.recording import schema
from drop_physics.workers import under_load

LOOPBACK = "127.0.0.1"
STARTS_WITHIN_S = 30.0
LOOKS_EVERY_S = 0.1
"""Interval between checks whether a viewer is closed [s]."""
VIEWER_PORT, PAGE_PORT = 9876, 9090
"""Rerun's default ports, used if they are free."""
PR_SET_PDEATHSIG = 1
"""Value of the option's constant in Linux's `sys/prctl.h`."""


class ViewerError(DropError):
    """Raised if a viewer cannot be started or reached."""


def binary() -> Path:
    """Return the path of Rerun's binary; the `rerun` on the PATH is a slower wrapper.

    Raises
    ------
    ViewerError
        If Rerun's viewer is not installed.
    """
    spec = importlib.util.find_spec("rerun_cli")
    if spec is None or spec.origin is None:
        raise ViewerError("rerun-sdk's command line is not installed; try: pip install rerun-sdk")
    return Path(spec.origin).parent / "rerun"


@dataclass(frozen=True)
class Viewer:
    """A command that starts Rerun's viewer, and the addresses where it listens."""

    command: list[str]
    port: int
    page: str | None
    """Address to open in a browser, for the web viewer."""

    @property
    def url(self) -> str:
        """Address to which recordings and commands are sent."""
        return f"rerun+http://{LOOPBACK}:{self.port}/proxy"


def viewer(files: Sequence[Path] = (), *, web: bool = False) -> Viewer:
    """Return the command and addresses of a viewer for files; the last file's layout is used.

    Parameters
    ----------
    files
        Recordings and layers; empty for a viewer that waits for data.
    web
        Whether the viewer runs in the browser.

    Raises
    ------
    ViewerError
        If there is no display for a window, or Rerun is not installed.
    """
    port, page = _free_port(VIEWER_PORT), None
    # With its folder, a name is neither an option, as -x.rrd would be, nor an address.
    names = [os.path.join(os.curdir, file) for file in files]  # noqa: PTH118 - Path drops the dot
    command = [str(binary()), *names, "--bind", LOOPBACK, "--port", str(port)]
    command.append("--hide-welcome-screen")  # it fetches examples from rerun.io
    if web:
        page_port = _free_port(PAGE_PORT)
        command += ["--web-viewer", "--web-viewer-port", str(page_port)]
        page = (
            f"http://{LOOPBACK}:{page_port}?hide_welcome_screen"
            f"&url=rerun%2Bhttp%3A%2F%2F{LOOPBACK}%3A{port}%2Fproxy"
        )
    else:
        _check_display()
        if not files:
            command.append("--expect-data-soon")
    return Viewer(command, port, page)


def start(viewer: Viewer, *, stays: bool) -> subprocess.Popen[bytes]:
    """Start a viewer, and return its process once it accepts connections.

    Parameters
    ----------
    viewer
        The viewer's command and addresses.
    stays
        Whether the viewer stays open when this process ends.

    Raises
    ------
    ViewerError
        If the viewer ends, or does not listen in time.
    """
    # Rerun sends telemetry unless disabled or in CI. Setting CI disables it, and leaves the user's
    # own settings as they are.
    environment = {"RUST_LOG": "error"} | os.environ | {"CI": "true"}
    process = subprocess.Popen(
        viewer.command,
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL if stays else None,
        start_new_session=stays,
        preexec_fn=None if stays or sys.platform != "linux" else _end_with_parent,
    )
    patience_s = under_load(STARTS_WITHIN_S)
    deadline = time.monotonic() + patience_s
    while not _listens(LOOPBACK, viewer.port):
        if process.poll() is not None:
            wait(process)
        if time.monotonic() > deadline:
            process.kill()
            raise ViewerError(
                "the viewer did not listen on port {port} within {patience:g} s; try the "
                "browser's: drop view RUN.rrd --web",
                port=viewer.port,
                patience=patience_s,
            )
        time.sleep(0.05)
    return process


def _end_with_parent() -> None:
    """Make Linux end this process when its parent process ends."""
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)


def wait(process: subprocess.Popen[bytes]) -> None:
    """Wait until the user closes a viewer.

    Raises
    ------
    ViewerError
        If the viewer fails.
    """
    # Once Polars is imported, a blocking wait would go on after Ctrl-C.
    while process.poll() is None:
        time.sleep(LOOKS_EVERY_S)
    if process.returncode != 0:
        raise ViewerError(
            "the viewer ended with exit code {code}; try the browser's: drop view RUN.rrd --web",
            code=process.returncode,
        )


def in_notebook(files: Sequence[Path], height_px: int, at_s: float | None = None) -> Any:  # noqa: ANN401 - its own class
    """Return a notebook widget that shows files, with the time cursor at `at_s` [s].

    Raises
    ------
    ViewerError
        If `rerun-notebook` is not installed.
    """
    if importlib.util.find_spec("rerun_notebook") is None:
        raise ViewerError(
            "a viewer in a notebook needs rerun-notebook; in a clone of drop: "
            "pip install '.[notebook]', or in a terminal: drop view {path}",
            path=files[0],
        )
    from rerun.notebook import Viewer as Widget

    widget = Widget(width="auto", height=height_px, use_global_recording=False)
    for file in files:
        widget._flush_hook(file.read_bytes())
    if at_s is not None:
        widget.set_time_ctrl(duration=at_s, timeline=schema.TIME_TIMELINE)
    return widget


def put_cursor(
    viewer: Viewer,
    time_s: float,
    process: subprocess.Popen[bytes],
    *,
    step: int | None = None,
) -> None:
    """Move a viewer's time cursor once it has loaded, since a layout cannot set it.

    Parameters
    ----------
    viewer, process
        The viewer, and its process.
    time_s
        The cursor's time [s].
    step
        The cursor's step, used instead of the time if given.
    """
    from rerun.experimental import ViewerClient

    deadline = time.monotonic() + under_load(STARTS_WITHIN_S)
    while process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.1)
        # Until it has loaded, or after it was closed, it answers with an error.
        with contextlib.suppress(ConnectionError, RuntimeError, ValueError):
            client = ViewerClient.connect(viewer.url)
            state = client.get_state()
            if state.active_recording and not state.loading:
                if step is None:
                    client.set_time(schema.TIME_TIMELINE, duration=time_s, play_state="paused")
                else:
                    client.set_time(schema.STEP_TIMELINE, sequence=step, play_state="paused")
                return


def check_listens(url: str) -> None:
    """Check that a viewer accepts connections at its URL.

    Raises
    ------
    ScenarioError
        If the URL is not that of a viewer.
    ViewerError
        If no viewer listens at the URL.
    """
    from urllib.parse import urlsplit

    parts = urlsplit(url)
    try:
        host, port = parts.hostname, parts.port
    except ValueError:
        host, port = None, None
    schemes = ("rerun", "rerun+http", "rerun+https")
    if parts.scheme not in schemes or not host or not port or parts.path != "/proxy":
        raise ScenarioError(
            "--connect takes a URL such as rerun+http://127.0.0.1:9876/proxy, got {url!r}", url=url
        )
    if not _listens(host, port):
        raise ViewerError(
            "no viewer listens at {url}; start one with: rerun --bind 127.0.0.1, or use --spawn",
            url=url,
        )


def _listens(host: str, port: int) -> bool:
    try:
        socket.create_connection((host, port), timeout=2).close()
    except OSError:
        return False
    return True


def _free_port(preferred: int) -> int:
    for port in (preferred, 0):
        with socket.socket() as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind((LOOPBACK, port))
            except OSError:
                continue
            return int(probe.getsockname()[1])
    raise ViewerError("no port is free on 127.0.0.1; close a viewer and try again")


def _check_display() -> None:
    if sys.platform == "linux" and not any(
        os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET")
    ):
        raise ViewerError(
            "there is no display for the viewer (neither DISPLAY nor WAYLAND_DISPLAY is set); use "
            "the browser's: drop view RUN.rrd --web"
        )
