"""Replaces `launch_passive` by a viewer without a window, for scripts that run unattended."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Callable, Iterator
from functools import partial
from types import ModuleType
from typing import TYPE_CHECKING, Any

from ...watching.hidden import hiding

if TYPE_CHECKING:
    from .hooks import MujocoWatch

SHOWN = (
    *("sync", "update_hfield", "update_mesh", "update_texture"),
    *("set_texts", "clear_texts", "set_figures", "clear_figures", "set_images", "clear_images"),
)
"""Viewer methods that have no effect on the run."""
STEPS_IN_A_WINDOW = ("launch", "launch_repl", "launch_from_path")
DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY")
MOST_GEOMS = 10_000
"""Largest number of geoms that a script may draw, as in MuJoCo's own viewer."""


class QuietViewer:
    """A passive viewer's handle without a window.

    Parameters
    ----------
    watch
        The watch, which ends a script that waits for a user's input.
    m, d
        The MjModel and MjData that the viewer would show.
    """

    def __init__(self, watch: MujocoWatch, m: Any, d: Any) -> None:
        module, self._watch = watch.mujoco, watch
        self.m, self.d, self.viewport = m, d, None
        self.cam, self.opt, self.perturb = (
            module.MjvCamera(),
            module.MjvOption(),
            module.MjvPerturb(),
        )
        self.user_scn = module.MjvScene(m, MOST_GEOMS)
        self._open = True
        for name in SHOWN:
            setattr(self, name, _nothing)

    def is_running(self) -> bool:
        """Return whether the window counts as open; each call advances the script's clock."""
        if self._open and self._watch.host.on:
            with self._watch.host.lock:
                self._watch.host.check()
                self._watch.host.clock.ask()
        return self._open

    def close(self) -> None:
        """Count the window as closed."""
        self._open = False

    @contextlib.contextmanager
    def lock(self) -> Iterator[None]:
        """Return a context that locks nothing, since no viewer thread runs."""
        yield

    def __enter__(self) -> QuietViewer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _nothing(*_: Any, **__: Any) -> None:
    pass


def install_viewer(watch: MujocoWatch, module: ModuleType) -> None:
    """Replace mujoco's passive viewer by one without a window."""
    original: Callable[..., Any] = module.launch_passive

    def launch_passive(model: Any, data: Any, **_: Any) -> QuietViewer:
        if not watch.host.on:
            return original(model, data, **_)  # type: ignore[no-any-return]
        watch.tell("viewer")
        return QuietViewer(watch, model, data)

    setattr(module, "launch_passive", launch_passive)  # noqa: B010
    _refuse_without_display(watch, module)
    watch.host.on_removal(lambda: setattr(module, "launch_passive", original))


def _refuse_without_display(watch: MujocoWatch, module: ModuleType) -> None:
    """Make functions that step in a window raise an error if there is no display."""
    for name in STEPS_IN_A_WINDOW:
        original = getattr(module, name, None)
        if original is not None:
            setattr(module, name, hiding(partial(_launched, name, original)))
            watch.host.on_removal(partial(setattr, module, name, original))


def _launched(name: str, original: Callable[..., Any], *args: Any, **kwargs: Any) -> Any:
    if sys.platform == "linux" and not any(map(os.environ.get, DISPLAYS)):
        raise RuntimeError(
            f"mujoco.viewer.{name} steps in a window, and there is no display; to record a run "
            "without one, step in the script: mujoco.mj_step(model, data) in a loop"
        )
    return original(*args, **kwargs)
