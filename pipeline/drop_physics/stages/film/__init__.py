"""Makes the images of a video, from recorded images or drawn from recorded poses."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from drop_physics.arrays import Float64, Int64
from drop_physics.errors import DropError, RecordingError
from drop_physics.explain.times import StepTimes
from drop_physics.figures.animation import decoded
from drop_physics.figures.overlay import beside, draw_clock, draw_marks
from drop_physics.figures.playback import Animation, Playback, playback
from drop_physics.figures.theme import DARK, LIGHT, Theme
from drop_physics.installed import PYBULLET, is_installed, needs_pybullet
from drop_physics.messages import Message, shell_command
from drop_physics.physics.vectors import triple
from drop_physics.recording.frames import frames, frames_of_cameras
from drop_physics.recording.reader import Recording
from drop_physics.recording.scene import Part, parts_of
from drop_physics.scenario import STANDARD_CAMERA, Camera, View
from drop_physics.stages.film.of_drop import FallScene
from drop_physics.trace.history import Seen, body_named
from drop_physics.trace.states import BODY
from drop_physics.workers import Worker, WorkerDiedError

if TYPE_CHECKING:
    import polars as pl
    from PIL import Image


DRAWN_PER_S = 20.0
"""Frames drawn per second of simulated time."""
DRAW = "drop_physics.engines.pybullet.scene_pictures:drawn"
PER_WORKER = 32
"""Number of frames per worker process, about as many as one draws while another process starts."""
MOST_DRAWN = 600
"""Largest number of frames in an animation; of a longer one, every second, third … frame is kept.
"""
SHARE_OF_HEIGHT = 1 / 4
"""Share of the image's height that a body fills in a close view."""
FAR_M = 10.0
"""Distance from the centre beyond which bodies may be out of view."""
LEAST_M = 0.1
"""Smallest distance of the camera."""
ROOM = 1.06
"""Factor by which the camera is farther away than necessary."""
LEAVES, FOLLOWED = 4.5, 3.0
"""The camera moves along if it would have to be LEAVES times farther away to see the whole path; it
is then FOLLOWED times as far away as a single moment requires."""
BETWEEN = 1.1
"""Distance between simulations that are drawn side by side, as a multiple of their size."""
SHARES, INNER = np.linspace(0, 1, 101), 0.9
"""Shares of the path over which the camera may move along; within INNER of the image, bodies still
visibly move."""


def _axes() -> Float64:
    """Return the axes right, up and back of the standard camera, shape (3, 3)."""
    yaw, pitch = (math.radians(a) for a in (STANDARD_CAMERA.yaw_deg, STANDARD_CAMERA.pitch_deg))
    right = np.array([math.cos(yaw), math.sin(yaw), 0.0])
    back = np.array([math.sin(yaw), -math.cos(yaw), -math.tan(pitch)]) * math.cos(pitch)
    return np.stack([right, np.cross(back, right), back])


AXES = _axes()


@dataclass(frozen=True)
class Film:
    """The images of a video, in order, with their playback."""

    pictures: Iterator[Image.Image]
    times_s: Sequence[float]
    """Simulated time of each frame [s]."""
    played: Playback


def frames_film(held: Recording, animation: Animation, most_fps: float) -> Film | None:
    """Return a video of recorded images, from the camera with most of them; None without any.

    Raises
    ------
    RecordingError
        If the recording is damaged.
    ScenarioError
        If the video cannot be played at the requested speed.
    """
    if held.drop is None:
        taken = max(frames_of_cameras(held).values(), key=len, default=[])
        times_s, pngs = [time_s for _, time_s, _ in taken], [png for *_, png in taken]
        interval_s = float(np.median(np.diff(times_s))) if len(times_s) > 1 else 0.0
    elif held.camera is not None:
        timestep_s = held.scenario.timestep_s
        recorded = [*frames(held)]
        times_s, pngs = [step * timestep_s for step, _ in recorded], [png for _, png in recorded]
        interval_s = held.camera.capture_every * timestep_s
    else:
        return None
    if not pngs:
        return None
    played = playback(animation, len(pngs), interval_s or 1 / DRAWN_PER_S, most_fps=most_fps)
    pictures = decoded(pngs[number] for number in played.frames)
    return Film(pictures, [times_s[number] for number in played.frames], played)


def poses_film(
    held: Recording,
    animation: Animation,
    most_fps: float,
    *,
    view: View,
    body: str | None,
    table: pl.DataFrame | None,
    most: int = MOST_DRAWN,
    dark: bool,
    clock: bool,
    hire: Callable[[int], Sequence[Worker]],
) -> Film:
    """Return a video of the recorded poses, which worker processes begin to draw at once.

    Parameters
    ----------
    held
        The recording.
    animation, most_fps
        The playback options, and the largest number of frames per second of the format.
    view
        The camera: `standard` shows everything that moves, `close` the place where a body ends up,
        and `follow` moves along with the body.
    body
        The body for `close` and `follow`, by name or id; None for the body that moves farthest.
    table
        For a drop, the table of the fall and its theory (see `FallScene`); None to show the body
        alone.
    most
        The largest number of frames; of a longer video, every second, third … frame is drawn.
    dark
        Whether colours suit a dark page.
    clock
        Whether the time is shown.
    hire
        A function that provides the given number of workers, or fewer.

    Raises
    ------
    RecordingError
        If the recording has no poses to show.
    ScenarioError
        If there is no such body, or the video cannot be played at the requested speed.
    """
    parts = _parts(held)
    taken = held.camera if held.drop is not None else None
    dropped = [part for part in parts if part.number == BODY and math.isfinite(part.radius_m)]
    scene = None
    if table is not None and held.drop is not None and dropped:
        floor_m = held.engine.rest_height_m if held.scenario.floor else None
        scene = FallScene(dropped, table, AXES, floor_m)
    every_s = taken.capture_every * held.scenario.timestep_s if taken else 1 / DRAWN_PER_S
    played, shown_s = _played(animation, most_fps, _end_s(held.seen, parts), every_s, most)
    poses = _poses(parts, shown_s)
    poses = _side_by_side(parts, poses, _places(held.seen, parts, poses))
    size_px = (taken or STANDARD_CAMERA).size_px
    cameras = [
        replace(camera, size_px=size_px) for camera in _cameras(held.seen, parts, poses, view, body)
    ]
    for part in scene.in_free_fall if scene else ():
        parts.append(part)
        poses = np.concatenate([poses, part.at(shown_s)[:, None]], axis=1)
    theme = DARK if dark else LIGHT
    pictures = _drawn(parts, poses, cameras, theme, hire)
    moments = zip(pictures, cameras, shown_s.tolist(), strict=True)
    drawn = (_marked(*moment, scene, theme, clock=clock) for moment in moments)
    return Film(drawn, shown_s.tolist(), played)


def beside_film(
    held: Recording,
    other: Recording,
    titles: tuple[str, str],
    animation: Animation,
    most_fps: float,
    *,
    most: int = MOST_DRAWN,
    dark: bool,
    hire: Callable[[int], Sequence[Worker]],
) -> Film:
    """Return a video of two runs of a script side by side, seen by one camera.

    Parameters
    ----------
    held, other
        The recordings: left and right.
    titles
        The titles above the two images.
    animation, most_fps, most, dark, hire
        The same as in `poses_film`.

    Raises
    ------
    RecordingError
        If a recording has no poses to show.
    ScenarioError
        If the video cannot be played at the requested speed.
    """
    both = [_parts(held), _parts(other)]
    ends_s = (_end_s(each.seen, parts) for each, parts in zip((held, other), both, strict=True))
    played, shown_s = _played(animation, most_fps, max(ends_s), 1 / DRAWN_PER_S, most)
    poses = [_poses(parts, shown_s) for parts in both]
    places = _places(held.seen, both[0], poses[0])
    poses = [_side_by_side(*each, places) for each in zip(both, poses, strict=True)]
    together = [*both[0], *both[1]]
    numbers = np.array([part.number for part in together])
    targets_m, distance_m = _framed(together, numbers, np.concatenate(poses, axis=1))
    cameras = [_looking(target_m, distance_m, "standard") for target_m in targets_m]
    theme = DARK if dark else LIGHT
    sides = [_drawn(*each, cameras, theme, hire) for each in zip(both, poses, strict=True)]
    pictures = (
        beside(pair, titles, time_s, theme)
        for *pair, time_s in zip(*sides, shown_s.tolist(), strict=True)
    )
    return Film(pictures, shown_s.tolist(), played)


def _parts(held: Recording) -> list[Part]:
    """Return the visible parts of a recording (links as drawn); raise an error without any."""
    parts = parts_of(held.path, held.seen)
    if not parts:
        raise RecordingError(
            "{path} has nothing to show: no body with a shape that drop draws was recorded; "
            "what was: {command}",
            path=held.path,
            command=shell_command("drop", "info", held.path),
        )
    return parts


def _poses(parts: Sequence[Part], times_s: Float64) -> Float64:
    """Return the poses of all drawn parts, shape (times, parts, 7)."""
    return np.stack([part.at(times_s) for part in parts], axis=1)


def _places(seen: Seen, parts: Sequence[Part], poses: Float64) -> dict[int, Float64]:
    """Return the displacement with which each body is drawn [m], by body id, shape (3,).

    Several simulations, each with a world of its own, are drawn side by side in rows.
    """
    clients = sorted({seen.bodies[part.number].client for part in parts})
    radii_m = np.array([part.radius_m for part in parts])
    near = radii_m < FAR_M
    if len(clients) < 2 or not near.any():
        return {}
    places_m, around_m = poses[:, near, :3], radii_m[near, None]
    size_m = np.nanmax(places_m + around_m, axis=(0, 1)) - np.nanmin(
        places_m - around_m, axis=(0, 1)
    )
    apart_m, columns = BETWEEN * float(np.hypot(*size_m[:2])), math.ceil(math.sqrt(len(clients)))
    away = np.cross((0.0, 0.0, 1.0), AXES[0])
    offsets = {
        client: apart_m * (number % columns * AXES[0] + number // columns * away)
        for number, client in enumerate(clients)
    }
    return {number: offsets[seen.bodies[number].client] for number in {p.number for p in parts}}


def _side_by_side(parts: Sequence[Part], poses: Float64, places: Mapping[int, Float64]) -> Float64:
    """Displace poses so that parallel simulations appear side by side."""
    moved = poses.copy()
    for at, part in enumerate(parts):
        moved[:, at, :3] += places.get(part.number, 0.0)
    return moved


def _drawn(
    parts: Sequence[Part],
    poses: Float64,
    cameras: Sequence[Camera],
    theme: Theme,
    hire: Callable[[int], Sequence[Worker]],
) -> Iterator[Image.Image]:
    """Yield images of poses, shape (images, parts, 7); the workers begin to draw at once."""
    if not is_installed(PYBULLET):
        raise needs_pybullet(Message("a film of poses"))
    workers = hire(max(1, len(poses) // PER_WORKER))
    for first, worker in enumerate(workers):
        shared = poses[first :: len(workers)], cameras[first :: len(workers)]
        worker.ask(DRAW, [part.models for part in parts], *shared, (*theme.tiles, theme.page))
    return _answers(workers, len(poses))


def _end_s(seen: Seen, parts: Sequence[Part]) -> float:
    """Return the time of the last sample, or of the last call that placed a drawn body [s]."""
    sampled_s = [StepTimes(seen, client).of(count - 1) for client, count in seen.samples.items()]
    return max(*sampled_s, *(float(part.times_s[-1]) for part in parts), 0.0)


def _played(
    animation: Animation, most_fps: float, end_s: float, interval_s: float, most: int
) -> tuple[Playback, Float64]:
    """Return a video's playback, and the time of each frame: evenly spaced, at most `most`."""
    count = int(end_s / interval_s + 1e-9) + 1
    times_s = interval_s * np.arange(0, count, -(-count // most), dtype=np.float64)
    apart_s = float(times_s[1]) if len(times_s) > 1 else 1 / DRAWN_PER_S
    played = playback(animation, len(times_s), apart_s, most_fps=most_fps)
    return played, times_s[played.frames]


def _cameras(
    seen: Seen, parts: Sequence[Part], poses: Float64, view: View, body: str | None
) -> list[Camera]:
    """Return the camera for each image; `poses` has shape (images, parts, 7)."""
    numbers = np.array([part.number for part in parts])
    number = _body_of(seen, numbers, poses, body)
    if view == "standard" or number is None:
        targets_m, distance_m = _framed(parts, numbers, poses)
        return [_looking(target_m, distance_m, view) for target_m in targets_m]
    its = poses[:, numbers == number, :3]
    finite = np.isfinite(its).all(axis=2)
    if not finite.any():
        raise RecordingError(
            "no position of {body} is finite: the camera cannot be aimed at it; try --camera "
            "standard",
            body=seen.bodies[number].label,
        )
    first = int(finite.any(axis=0).argmax())
    way_m = _held(its[:, first : first + 1])[:, 0]
    extent_m = 2 * max(part.radius_m for part in parts if part.number == number)
    if seen.bodies[number].bounds_m:
        edges = np.reshape(seen.bodies[number].bounds_m, (-1, 6))
        extent_m = float(np.linalg.norm(edges[:, 3:].max(axis=0) - edges[:, :3].min(axis=0)))
    share = SHARE_OF_HEIGHT * STANDARD_CAMERA.size_px[1]
    distance_m = STANDARD_CAMERA.focal_length_px * extent_m / share
    targets_m = way_m if view == "follow" else np.repeat(way_m[-1:], len(way_m), axis=0)
    return [_looking(target_m, distance_m, view) for target_m in targets_m]


def _framed(parts: Sequence[Part], numbers: Int64, poses: Float64) -> tuple[Float64, float]:
    """Return the point at which a standard camera looks in each image, (n, 3), and its distance.

    The camera stands still. If bodies leave the view, it moves along, but only as far as necessary,
    so that the bodies' motion stays visible.
    """
    radii_m = np.array([part.radius_m for part in parts])
    moves = (np.fmax.reduce(poses) - np.fmin.reduce(poses) > 1e-4).any(axis=1)
    shown = np.isin(numbers, numbers[moves]) & (radii_m < FAR_M)
    if not shown.any():
        shown = radii_m < FAR_M if (radii_m < FAR_M).any() else radii_m > 0
    places_m, around_m = _held(poses[:, shown, :3]), np.minimum(radii_m[shown], FAR_M)[:, None]
    away_m = np.abs(places_m - np.nanmedian(places_m, axis=1, keepdims=True)).max(axis=2)
    # Between two distant groups nothing is near the median.
    far = away_m > np.maximum(FAR_M, np.nanmin(away_m, axis=1, keepdims=True))
    places_m = np.where(far[..., None], np.nan, places_m)
    seen_m = places_m @ AXES.T
    low_m = np.nanmin(seen_m - around_m, axis=1)
    high_m = np.nanmax(seen_m + around_m, axis=1)
    whole_m = (low_m.min(axis=0) + high_m.max(axis=0)) / 2
    far_m = _distance_m(seen_m - whole_m, around_m)
    near_m = _distance_m(seen_m - (low_m + high_m)[:, None] / 2, around_m)
    if far_m <= LEAVES * near_m:
        return np.tile(whole_m @ AXES, (len(poses), 1)), far_m
    ways_m = np.nanmean(seen_m, axis=1)
    middle_m = (ways_m.min(axis=0) + ways_m.max(axis=0)) / 2
    distance_m = max(FOLLOWED * near_m, _distance_m(seen_m - ways_m[:, None], around_m))
    for share in SHARES:
        targets_m = middle_m + share * (ways_m - middle_m)
        if _distance_m(seen_m - targets_m[:, None], around_m) <= INNER * distance_m:
            break
    return targets_m @ AXES, distance_m


def _distance_m(places_m: Float64, around_m: Float64) -> float:
    """Return the distance at which all bodies, as balls, fit into a standard camera's view.

    A ball is inside the image if its centre is at least a radius away from the planes that bound
    the view: for a plane of slope s, and a depth z, |x| + r √(1 + s²) ≤ s (distance − z).
    """
    half = math.tan(math.radians(STANDARD_CAMERA.vertical_fov_deg) / 2)
    width, height = STANDARD_CAMERA.size_px
    slopes = np.array([half * width / height, half])
    spread_m = (np.abs(places_m[..., :2]) + around_m * np.hypot(1, slopes)) / slopes
    return ROOM * float(np.nanmax(spread_m + places_m[..., 2:], initial=LEAST_M))


def _held(places_m: Float64) -> Float64:
    """Replace unknown positions, shape (images, parts, 3), by the last known ones."""
    there = np.any(np.isfinite(places_m[..., 0]), axis=1)
    if not there.any():
        return np.zeros_like(places_m)
    return places_m[np.maximum.accumulate(np.where(there, np.arange(len(there)), there.argmax()))]


def _looking(target_m: Float64, distance_m: float, view: View) -> Camera:
    return replace(
        STANDARD_CAMERA,
        view=view,
        target_m=triple(target_m),
        distance_m=distance_m,
        near_m=min(0.1, distance_m / 4),
        far_m=max(10.0, 6 * distance_m),
    )


def _body_of(seen: Seen, numbers: Int64, poses: Float64, which: str | None) -> int | None:
    """Return the id of the body to follow: the given body, or the one that moves farthest."""
    if which is None:
        reach_m = np.fmax.reduce(poses) - np.fmin.reduce(poses)
        way_m = np.linalg.norm(reach_m[:, :3], axis=1)
        way_m = np.where(way_m < FAR_M, way_m, 0.0)
        return int(numbers[way_m.argmax()]) if way_m.any() else None
    body = body_named(seen.bodies.values(), which)
    if body.number not in numbers:
        raise RecordingError(
            "{body} has no shape that drop draws: the camera cannot be aimed at it; try --camera "
            "standard",
            body=body.label,
        )
    return body.number


def _marked(
    picture: Image.Image,
    camera: Camera,
    time_s: float,
    scene: FallScene | None,
    theme: Theme,
    *,
    clock: bool,
) -> Image.Image:
    """Draw a scene's marks, and the clock, over an image."""
    if scene is not None:
        draw_marks(picture, [*scene.marks(camera, time_s)], theme)
    if clock:
        draw_clock(picture, time_s, theme)
    return picture


def _answers(workers: Sequence[Worker], count: int) -> Iterator[Image.Image]:
    from PIL import Image

    for number in range(count):
        try:
            yield Image.fromarray(workers[number % len(workers)].answer())
        except WorkerDiedError as died:
            raise DropError(
                "drawing the recorded shapes ended with {how}: a mesh is more than Bullet's "
                "renderer can take; without --camera the images that the script took are shown",
                how=died.how,
            ) from None
