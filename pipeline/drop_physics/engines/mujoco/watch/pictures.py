"""Sends digests of the images that a script renders with mujoco, to compare two runs."""

from __future__ import annotations

import functools
import zlib
from typing import TYPE_CHECKING, Any

import numpy as np

from ...watching.hidden import hiding
from ...watching.sites import caller
from ..frames import CAUSES

if TYPE_CHECKING:
    from .hooks import MujocoWatch

PICTURE = CAUSES.index("picture")
SIGNED = 1 << 31
"""Offset that converts a 32-bit digest to a signed number."""


def install(watch: MujocoWatch, renderer: Any) -> None:
    """Wrap the methods of mujoco's renderer so that they send a digest of each image.

    Parameters
    ----------
    watch
        The watch that sends the digests.
    renderer
        The class `mujoco.Renderer`.
    """
    shown: dict[int, int] = {}
    """The `id` of the MjData that each renderer shows, by the renderer's `id`."""
    drawn, shows = renderer.render, renderer.update_scene
    if getattr(drawn, "drop_watch", None) is watch:
        return

    @functools.wraps(shows)
    @hiding
    def update_scene(self: Any, data: Any, *args: Any, **kwargs: Any) -> Any:
        shown[id(self)] = id(data)
        return shows(self, data, *args, **kwargs)

    @functools.wraps(drawn)
    @hiding
    def render(self: Any, *args: Any, **kwargs: Any) -> Any:
        pixels = drawn(self, *args, **kwargs)
        state = watch.data.get(shown.get(id(self), 0))
        held = pixels if pixels is not None else kwargs.get("out", args[0] if args else None)
        if state is not None and not state.lost and watch.host.on and held is not None:
            digest = zlib.crc32(np.ascontiguousarray(held).tobytes())
            with watch.host.lock:
                site = watch.site_of(caller())
                watch.guarded(state, state.drawn, site, PICTURE, digest - SIGNED)
        return pixels

    render.drop_watch = watch  # type: ignore[attr-defined]
    for name, hook, original in (("render", render, drawn), ("update_scene", update_scene, shows)):
        setattr(renderer, name, hook)
        watch.host.on_removal(functools.partial(setattr, renderer, name, original))
