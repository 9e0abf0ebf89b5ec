"""Playback of an animation: which frames are shown when, and what is added to the images."""

from __future__ import annotations

import math
from dataclasses import dataclass

from drop_physics.errors import ScenarioError

STANDARD_FPS = 20.0


@dataclass(frozen=True, kw_only=True)
class Animation:
    """Options for making frames into an animation.

    Raises
    ------
    ScenarioError
        If the speed is not a number above 0.
    """

    fps: float | None = None
    """Frames per second; None for `STANDARD_FPS`, or the rate that the speed implies."""
    speed: float | None = None
    """Simulated seconds per second, 1 is real time; None to show every frame once."""
    caption: bool = False
    """Whether time, height and error are written below the image."""
    with_plot: bool = False
    """Whether a plot grows beside the image; this implies a caption."""

    def __post_init__(self) -> None:
        if self.speed is not None and not (self.speed > 0 and math.isfinite(self.speed)):
            raise ScenarioError(
                "--speed must be above 0, got {speed:g}; 1 is real time, 0.25 slow motion",
                speed=self.speed,
            )


EVERY_FRAME = Animation()
"""Options that show each recorded frame once, without additions."""


@dataclass(frozen=True)
class Playback:
    """The frames to show, and the playback rate."""

    fps: float
    """Frames per second."""
    speed: float
    """Simulated seconds per second."""
    frames: list[int]
    """Index of the recorded frame that is shown at each time, ascending; a frame may repeat."""


MOST_PICTURES = 100_000
"""Largest number of frames of an animation that repeats frames: over an hour."""


def playback(animation: Animation, count: int, interval_s: float, *, most_fps: float) -> Playback:
    """Choose the frames to show, and the playback rate.

    Parameters
    ----------
    animation
        The playback options.
    count
        The number of recorded frames, at least one.
    interval_s
        Simulated time between consecutive frames [s].
    most_fps
        Largest number of frames per second that the format supports.

    Raises
    ------
    ScenarioError
        If the animation would have more than `MOST_PICTURES` frames.
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
