"""Make an animation of a script's recording: of the images it took, or of its recorded poses."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import polars as pl
from numpy.typing import NDArray

from drop_physics.analysis.times import Times
from drop_physics.errors import DropError, RecordingError
from drop_physics.figures.animation import MAX_FPS, decoded, write_animation
from drop_physics.figures.playback import Animation, Playback, playback
from drop_physics.files.whole import written_whole
from drop_physics.recording.reader import Recording
from drop_physics.recording.scene import Part, frames_of_cameras, parts_of
from drop_physics.scenario import STANDARD_CAMERA, Camera, View
from drop_physics.seen.history import Seen, body_named
from drop_physics.states import STATE
from drop_physics.workers import Worker, WorkerDiedError

if TYPE_CHECKING:
    from PIL import Image

DRAWN_PER_S = 20.0
"""Pictures drawn from poses per second of simulated time."""
MOST_DRAWN = 2000
"""Pictures in an animation at most; a longer one shows every second, third … of them."""
SHARE_OF_HEIGHT = 1 / 4
"""Share of a picture's height that a body takes up in a close view."""
FAR_M = 10.0
"""Bodies farther than this from the middle may be out of view."""
LEAST_REACH_M = 0.5


def film(
    held: Recording,
    gif: Path,
    *,
    animation: Animation,
    view: View | None,
    body: str | None,
    force: bool,
    ours: bool,
    report: Callable[[int, int], None],
) -> tuple[int, Playback]:
    """Write an animation of a script's recording; return its pictures, and how it plays.

    Parameters
    ----------
    held
        The recording.
    gif
        The `.gif`, `.webp`, `.apng` or `.mp4` to write.
    animation
        How it plays.
    view
        The camera that looks at the recorded poses: `standard` sees everything that moves, `close`
        where a body ends up, `follow` moves along with it. None shows the images that the script
        took, or if it took none, `standard`.
    body
        The body for `close` and `follow`, by name or number; None for the one that moves farthest.
    force, ours
        As for `written_whole`.
    report
        Called with how many pictures are written, and how many there are.

    Raises
    ------
    RecordingError
        If the recording has nothing to show.
    ScenarioError
        If there is no such body.
    OutputError
        If the file cannot be written.
    """
    taken = max(frames_of_cameras(held.path).values(), key=len, default=[])
    most_fps = MAX_FPS[gif.suffix]
    if view is None and taken:
        times_s = [time_s for _, time_s, _ in taken]
        interval_s = float(np.median(np.diff(times_s))) if len(taken) > 1 else 0.0
        played = playback(animation, len(taken), interval_s or 1 / 20, most_fps=most_fps)
        pictures = decoded([taken[number][2] for number in played.frames])
    else:
        parts = parts_of(held.path, held.seen)
        if not parts:
            raise RecordingError(
                "{path} has nothing to show: no body with a shape that drop draws was recorded",
                path=held.path,
            )
        times_s = _drawn_at(parts)
        interval_s = times_s[1] - times_s[0] if len(times_s) > 1 else 1 / DRAWN_PER_S
        played = playback(animation, len(times_s), interval_s, most_fps=most_fps)
        shown_s = [times_s[number] for number in played.frames]
        pictures = _drawn(parts, shown_s, _cameras(held.seen, view or "standard", body, shown_s))
    with written_whole(gif, force=force, ours=ours) as file:
        reported = _reported(pictures, len(played.frames), report)
        count = write_animation(reported, file, suffix=gif.suffix, fps=played.fps)
    return count, played


def _drawn_at(parts: Sequence[Part]) -> list[float]:
    """Return the times at which pictures are drawn: evenly spaced, at most `MOST_DRAWN`."""
    last_s = max(part.times_s[-1] for part in parts)
    count = int(last_s * DRAWN_PER_S + 1e-9) + 1
    every = -(-count // MOST_DRAWN)
    return [number * every / DRAWN_PER_S for number in range(-(-count // every))]


def _cameras(seen: Seen, view: View, body: str | None, times_s: Sequence[float]) -> list[Camera]:
    """Return the camera of each picture."""
    number = _body_of(seen, body)
    # What steps move is sampled; what only calls move, they put somewhere.
    puts = [
        seen.placed(put) for record in seen.by_body.values() if record.moves for put in record.puts
    ]
    put = np.concatenate([np.empty(0, STATE), *puts])
    positions_m = np.concatenate(
        [seen.states.select("x_m", "y_m", "z_m").to_numpy(), put["position_m"]]
    )
    radii_m = {each: _radius_m(body.bounds_m) for each, body in seen.bodies.items()}
    moved = [*seen.states["body"].to_list(), *put["body"].tolist()]
    round_m = np.array([radii_m.get(each, 0.0) for each in moved])
    low_m, high_m = _near(positions_m, round_m)
    if view == "standard" or number is None:
        reach_m = max(LEAST_REACH_M, float(np.linalg.norm(high_m - low_m)) / 2)
        centre_m = (low_m + high_m) / 2
        return [_looking(centre_m, 2 * reach_m, view)] * len(times_s)
    its = seen.states.filter(pl.col("body") == number)
    first = its.filter(pl.col("link") == its["link"].min()).sort("step")
    first = first.filter(pl.all_horizontal(pl.col("x_m", "y_m", "z_m").is_finite()))
    if first.is_empty():
        raise RecordingError(
            "no position of {body} is finite: the camera cannot be aimed at it; try --camera "
            "standard",
            body=seen.bodies[number].label,
        )
    way_m = first.select("x_m", "y_m", "z_m").to_numpy()
    times = Times(seen, seen.bodies[number].client)
    at_s = np.array([times.of(step) for step in first["step"].to_list()])
    edges = np.reshape(seen.bodies[number].bounds_m, (-1, 6))
    extent_m = float(np.linalg.norm(edges[:, 3:].max(axis=0) - edges[:, :3].min(axis=0)))
    share = SHARE_OF_HEIGHT * STANDARD_CAMERA.size_px[1]
    distance_m = STANDARD_CAMERA.focal_length_px * extent_m / share
    rows = np.clip(np.searchsorted(at_s, np.array(times_s) + 1e-9, side="right") - 1, 0, None)
    targets_m = way_m[rows] if view == "follow" else np.repeat(way_m[-1:], len(times_s), axis=0)
    return [_looking(target_m, distance_m, view) for target_m in targets_m]


def _near(
    positions_m: NDArray[np.float64], round_m: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return low and high corners of a box around bodies at positions, (n, 3), without far ones.

    `round_m` is the radius around each position, shape (n,).
    """
    finite = np.isfinite(positions_m).all(axis=1)
    positions_m, around_m = positions_m[finite], round_m[finite, None]
    if not len(positions_m):
        return np.zeros(3), np.zeros(3)
    away_m = np.abs(positions_m - np.median(positions_m, axis=0)).max(axis=1)
    # Between two distant groups nothing is near the median.
    near = away_m <= max(FAR_M, away_m.min())
    low_m, high_m = positions_m - around_m, positions_m + around_m
    return low_m[near].min(axis=0), high_m[near].max(axis=0)


def _radius_m(bounds_m: Sequence[float]) -> float:
    """Return the radius of a body's largest part [m]; 0 for a body without bounds."""
    edges_m = np.reshape(bounds_m, (-1, 6))
    radius_m = float((edges_m[:, 3:] - edges_m[:, :3]).max(initial=0.0)) / 2
    return radius_m if radius_m < FAR_M else 0.0  # as wide as a floor, which is never seen whole


def _looking(target_m: NDArray[np.float64], distance_m: float, view: View) -> Camera:
    x, y, z = target_m.tolist()
    return replace(
        STANDARD_CAMERA,
        view=view,
        target_m=(x, y, z),
        distance_m=distance_m,
        near_m=min(0.1, distance_m / 4),
        far_m=max(10.0, 6 * distance_m),
    )


def _body_of(seen: Seen, which: str | None) -> int | None:
    """Return the number of the given body, or of the one that moves farthest."""
    if which is not None:
        return body_named(seen.bodies.values(), which).number
    moved = seen.states.group_by("body").agg(
        *((pl.col(name).max() - pl.col(name).min()).alias(name) for name in ("x_m", "y_m", "z_m"))
    )
    if moved.is_empty():
        return None
    way_m = np.linalg.norm(moved.select("x_m", "y_m", "z_m").to_numpy(), axis=1)
    return int(moved["body"][int(np.argmax(np.where(way_m < FAR_M, way_m, 0.0)))])


def _drawn(
    parts: Sequence[Part], times_s: Sequence[float], cameras: Sequence[Camera]
) -> Iterator[Image.Image]:
    from PIL import Image

    poses = [[part.at(time_s) for part in parts] for time_s in times_s]
    with Worker() as worker:
        models = [part.models for part in parts]
        worker.ask("drop_physics.engines.bullet.scene_pictures:drawn", models, poses, cameras)
        for _ in times_s:
            try:
                yield Image.fromarray(worker.answer())
            except WorkerDiedError as died:
                raise DropError(
                    "drawing the recorded shapes ended with {how}: a mesh is more than Bullet's "
                    "renderer can take; without --camera the images that the script took are shown",
                    how=died.how,
                ) from None


def _reported(
    pictures: Iterator[Image.Image], count: int, report: Callable[[int, int], None]
) -> Iterator[Image.Image]:
    for done, picture in enumerate(pictures, start=1):
        yield picture
        report(done, count)
