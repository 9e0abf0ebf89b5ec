"""Additions to a drop's video: the body in free fall, and a ruler."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from drop_physics import colours
from drop_physics.arrays import Float64
from drop_physics.figures.overlay import Mark, Point
from drop_physics.recording.scene import Part
from drop_physics.scenario import Camera
from drop_physics.trace.events import Model

if TYPE_CHECKING:
    import polars as pl


BESIDE = 2.5
"""Distances of the free-falling body (to the right) and of the ruler (to the left) from the body,
in radii of the body."""
TICKS = 6
"""Approximate number of ticks of the ruler in an image."""
TICK_PX = 6
"""Length of a tick [px]."""
NAMES, BELOW = ("simulated", "free fall"), 1.15
"""Captions of the body and of its copy in free fall, and their distance below the bodies, in radii.
"""


class FallScene:
    """Additions to a drop's video: a copy of the body in free fall, and a ruler.

    Parameters
    ----------
    body
        The drawn parts of the body, of finite size.
    table
        One row per sample: `time_s`, `simulated_m`, `free_fall_m`, and `timestep_m`, which is null
        where no law explains the error.
    axes
        World directions of right, up and back in the images, shape (3, 3).
    floor_m
        The height of the body's centre at which it touches the floor [m]; None without a floor.
    """

    def __init__(
        self, body: Sequence[Part], table: pl.DataFrame, axes: Float64, floor_m: float | None
    ) -> None:
        self._axes, self._floor_m = axes, floor_m
        self._top_m = float(np.nanmax(body[0].poses[:, 2]))
        self._radius_m = max(part.radius_m for part in body)
        self.in_free_fall = [*self._in_free_fall(body, table)]
        """A copy of the body in free fall, drawn to its right as long as the theory applies."""
        self._named = [body[0], *self.in_free_fall[:1]]

    def _in_free_fall(self, body: Sequence[Part], table: pl.DataFrame) -> Iterator[Part]:
        if not table["timestep_m"].is_not_null().any():
            return
        times_s, free_m, own_m = (
            table[name].to_numpy() for name in ("time_s", "free_fall_m", "simulated_m")
        )
        moved = np.zeros((len(times_s), 7))
        moved[:, :3] = BESIDE * self._radius_m * self._axes[0]
        landed = len(times_s)
        if self._floor_m is not None:  # where it lies from then on
            landed = int(np.append(free_m <= self._floor_m, True).argmax()) + 1
            free_m = np.maximum(free_m, self._floor_m)
        moved[:, 2] += free_m - own_m
        for part in body:
            models = tuple(map(_grey, part.models))
            poses = (part.at(times_s) + moved).astype(np.float32)
            yield replace(part, models=models, times_s=times_s[:landed], poses=poses[:landed])

    def marks(self, camera: Camera, time_s: float) -> Iterator[Mark]:
        """Yield the marks in an image: the ruler, and the captions of the bodies."""

        def seen(at_m: ArrayLike) -> Point:
            x, y, z = self._axes @ np.subtract(at_m, camera.target_m)
            scale = camera.focal_length_px / (camera.distance_m - z)
            return camera.size_px[0] / 2 + scale * x, camera.size_px[1] / 2 - scale * y

        places_m = [part.at(np.array([time_s]))[0, :3] for part in self._named]
        if not np.isfinite(places_m).all():
            return
        for place_m, name in zip(places_m, NAMES if self.in_free_fall else ("",), strict=True):
            yield Mark((seen(place_m - BELOW * self._radius_m * self._axes[1]),), name, "mt")
        sees_m = camera.distance_m * camera.size_px[1] / camera.focal_length_px
        step_m, decimals = _step(sees_m / TICKS)
        foot_m = places_m[0] - BESIDE / 2 * self._radius_m * self._axes[0]
        bottom_m = max(foot_m[2] - sees_m, -np.inf if self._floor_m is None else 0.0)
        top_m = min(foot_m[2] + sees_m, self._top_m)
        yield Mark((seen([*foot_m[:2], bottom_m]), seen([*foot_m[:2], top_m])))
        for number in range(math.ceil(bottom_m / step_m), math.floor(top_m / step_m + 1e-6) + 1):
            x, y = seen([*foot_m[:2], number * step_m])
            yield Mark(((x, y), (x - TICK_PX, y)), f"{number * step_m:.{decimals}f} m ")


def _step(about_m: float) -> tuple[float, int]:
    """Return a round tick spacing of at least `about_m`, and the decimals of the labels."""
    exponent = math.floor(math.log10(about_m))
    step = next(step for step in (1, 2, 5, 10) if step * 10.0**exponent >= about_m)
    return step * 10.0**exponent, max(0, -exponent - (step == 10))


def _grey(model: Model) -> Model:
    rgb = (int(colours.FREE_FALL[at : at + 2], 16) / 255 for at in (1, 3, 5))
    return replace(model, shape=replace(model.shape, rgba=(*rgb, 1.0)))
