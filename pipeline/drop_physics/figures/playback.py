"""Playback of an animation: its frames, their times, and its additions."""

from __future__ import annotations

import math
from dataclasses import dataclass

from drop_physics.errors import ScenarioError

STANDARD_FPS = 20.0


@dataclass(frozen=True, kw_only=True)
class Animation:
    """Options by which frames become an animation.

    Raises
    ------
    ScenarioError
        If the speed is not a number above 0.
    """

    fps: float | None = None
    """Pictures per second; None for `STANDARD_FPS`, or the rate that the speed gives."""
    speed: float | None = None
    """Simulated seconds per second, 1 is real time; None shows every frame once."""
    caption: bool = False
    """Whether time, height and error are written below."""
    with_plot: bool = False
    """Whether a plot grows beside it; then there is a caption too."""

    def __post_init__(self) -> None:
        if self.speed is not None and not (self.speed > 0 and math.isfinite(self.speed)):
            raise ScenarioError(
                "--speed must be above 0, got {speed:g}; 1 is real time, 0.25 slow motion",
                speed=self.speed,
            )


EVERY_FRAME = Animation()
"""The recorded frames as they are, each once."""


@dataclass(frozen=True)
class Playback:
    """The frames that are played, and their times."""

    fps: float
    """Pictures per second."""
    speed: float
    """Simulated seconds per second."""
    frames: list[int]
    """Number of the recorded frame in each picture, ascending; a frame may repeat."""


MOST_PICTURES = 100_000
"""Most pictures of an animation that shows frames more than once: over an hour of them."""


def playback(animation: Animation, count: int, interval_s: float, *, most_fps: float) -> Playback:
    """Return the frames that are shown, and their times.

    Parameters
    ----------
    animation
        What is wanted.
    count
        How many frames were recorded, at least one.
    interval_s
        Simulated time from one to the next [s].
    most_fps
        Most pictures per second that the format can show.

    Raises
    ------
    ScenarioError
        If that would be more than `MOST_PICTURES`.
    """
    fps, speed = animation.fps, animation.speed
    if speed is None:
        fps = STANDARD_FPS if fps is None else fps
        return Playback(fps, fps * interval_s, list(range(count)))
    own_fps = speed / interval_s
    if fps is None:
        fps = min(own_fps, most_fps)
    if (count - 1) * interval_s * fps > max(count, MOST_PICTURES) * speed:
        raise ScenarioError(
            "--speed and --fps must make at most {most:,} pictures, got {speed:g} and {fps:g} for "
            "{duration:g} s; give a lower --fps",
            most=MOST_PICTURES,
            speed=speed,
            fps=fps,
            duration=(count - 1) * interval_s,
        )
    # The nearest recorded frame to each picture's time. 1e-9: the last one is not lost to rounding.
    pictures = math.floor((count - 1) * fps / own_fps * (1 + 1e-9)) + 1
    frames = [min(round(number * own_fps / fps), count - 1) for number in range(pictures)]
    return Playback(fps, speed, frames)
