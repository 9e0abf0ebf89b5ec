"""Defines the viewer's layout for a recording, with or without an analysis."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun import RecordingStream
from rerun.blueprint import Corner2D

from drop_physics.arrays import Float64
from drop_physics.recording import schema
from drop_physics.scenario import View
from drop_physics.trace.events import Body

SLOW_MOTION = 0.25
"""Playback speed of a drop: a fall from 1 m takes half a second, too fast to watch."""
MOST_CAMERAS = 4
MOST_NAMES = 8
"""Largest number of curves in a view; the names of more would hide them."""
LEAST_REACH_M = 0.1
ASPECT, HALF_VIEW, ROOM = 0.9, 0.52, 1.1
"""Aspect ratio of the 3-D view, tangent of half its angle, and a margin."""
MOST_ROWS, MOST_STATES, MOST_JOINTS = 2, 6, 6
"""Largest numbers of panels in a column, of bodies whose segments are shown, and of joints whose
curves are shown."""
RIGHT_TOP = Corner2D.RightTop
EYE = np.array([1.6, -1.6, 1.0])
"""Position of the viewer's eye relative to the centre of all motion."""


class Eye(NamedTuple):
    """The viewpoint in the 3-D view."""

    position_m: tuple[float, float, float]
    target_m: tuple[float, float, float]


DROP_EYE = Eye((2.9, -0.95, 1.6), (0.4, -0.5, 0.5))
"""Viewpoint beside the drop's camera, which shows the camera's image, the floor and the fall
frontally."""
NEAR_EYE = Eye((1.55, 0.6, 0.9), (0.0, 0.0, 0.45))
"""Viewpoint near the body, from the side, so that the camera's image does not hide the body."""


@dataclass(frozen=True)
class Look:
    """The properties of a recording on which its layout depends."""

    eye: Eye
    entities: frozenset[str]
    """Entities of the recording; may include some that have no panel."""
    series: Mapping[str, int] = field(default_factory=dict)
    """Number of curves of each entity that has more than one."""
    cameras: Mapping[str, str] = field(default_factory=dict)
    """Names of the camera images, by entity."""
    touched: frozenset[str] = frozenset()
    """Labels of the bodies whose collision shapes are shown."""
    order: Mapping[str, int] = field(default_factory=dict)
    """Sort order of entities of the same kind."""
    panels: Sequence[str] = ()
    """Titles of the panels for a script."""
    timeline: str = schema.TIME_TIMELINE
    speed: float = 1.0

    @property
    def analyzed(self) -> bool:
        """True if the layout shows an analysis."""
        return schema.FINDINGS in self.entities


def look_of_drop(height_m: float, camera: View | None, entities: Iterable[str] = ()) -> Look:
    """Return the properties on which a drop's layout depends.

    Parameters
    ----------
    height_m
        Height of the release [m], which determines the distance of the viewpoint.
    camera
        The camera's view; None without frames.
    entities
        Entities that are shown in addition to those of every drop.
    """
    far = max(1.0, height_m)
    position, target = NEAR_EYE if camera in ("close", "follow") else DROP_EYE
    eye = Eye(*(tuple(far * x for x in place) for place in (position, target)))  # type: ignore[arg-type]
    shown = {
        schema.ABOUT,
        schema.TRAIL,
        schema.HEIGHT_SIMULATED,
        schema.HEIGHT_FREE_FALL,
        schema.HEIGHT_DAMPED_FALL,
        *entities,
    }
    shown |= set() if camera is None else {schema.IMAGE}
    return Look(eye, frozenset(shown), speed=SLOW_MOTION)


def eye_around(low_m: Float64, high_m: Float64) -> Eye:
    """Return the viewpoint from which a box, given by two corners, fills the view."""
    centre = (low_m + high_m) / 2
    half = np.maximum((high_m - low_m) / 2, LEAST_REACH_M)
    back = EYE / np.linalg.norm(EYE)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    corners = half * np.array([*itertools.product((-1, 1), repeat=3)])
    across, up, near = (corners @ axis for axis in (right, np.cross(back, right), back))
    distance = (np.maximum(np.abs(across) / ASPECT, np.abs(up)) / HALF_VIEW + near).max()
    return Eye(tuple((centre + ROOM * distance * back).tolist()), tuple(centre.tolist()))


def series_of(bodies: Iterable[Body]) -> dict[str, int]:
    """Return how many curves each joint entity has."""
    return {
        f"{schema.JOINTS}/{body.label}/{name}": sum(joint.widths[place] for joint in body.joints)
        for body in bodies
        for place, name in enumerate(schema.OF_JOINTS)
    }


def layout(look: Look) -> rrb.Blueprint:
    """Make the layout: scene, images, curves and texts, without empty panels."""
    pictures, states = [*_pictures(look)], [*_states(look)]
    shares = [5, *(3 for _ in pictures), *(_share(look) for _ in states)]
    left = _rows([_world(look), *pictures, *states], shares=shares)
    measured = _measured(look)
    if not look.analyzed:
        whole = rrb.Horizontal(left, _rows([*map(_tabs, measured), _texts(look)]))
        return _framed(whole, look)
    panels = [
        rrb.TimeSeriesView(
            origin=f"{schema.PANELS}/{number}", name=title, plot_legend=rrb.PlotLegend(RIGHT_TOP)
        )
        for number, title in enumerate(look.panels)
    ]
    of_drop = schema.HEIGHT_SIMULATED in look.entities
    # A fall begins at the upper left. Its error begins at zero and goes below, and of a drop,
    # where its terms are shown, up as well.
    corner = Corner2D.LeftTop if of_drop else Corner2D.LeftBottom
    errors = _curves(look, schema.ERROR_MM, "Simulated minus free fall [mm]", corner)
    energies = _curves(look, schema.ENERGY, "Energy [J]", RIGHT_TOP)
    heights = [view for views in measured for view in views]
    curves = [*heights, *errors, *energies] if of_drop else [*panels, *errors, *heights]
    middle = [*curves[:MOST_ROWS], *([_tabs(curves[MOST_ROWS:])] if curves[MOST_ROWS:] else [])]
    columns = [left, *([_rows(middle)] if middle else []), _texts(look)]
    return _framed(rrb.Horizontal(*columns, column_shares=[4, 4, 3] if middle else [4, 3]), look)


def _framed(whole: Panel, look: Look) -> rrb.Blueprint:
    return _Small(
        whole,
        # A layout cannot set where the time cursor starts. Alone, the recording is played; with
        # the analysis, it is paused at the start.
        rrb.TimePanel(
            timeline=look.timeline,
            state="collapsed",
            play_state="paused" if look.analyzed else "playing",
            loop_mode="all",
            playback_speed=None if look.speed == 1 else look.speed,
        ),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
    )


class _Small(rrb.Blueprint):
    """A layout without timestamps of its parts, which would take a third of its bytes."""

    def _log_to_stream(self, stream: RecordingStream) -> None:
        stream.set_log_time_enabled(False)
        super()._log_to_stream(stream)


Panel = rrb.View | rrb.Container


def _rows(panels: Sequence[Panel], *, shares: Sequence[float] | None = None) -> Panel:
    return panels[0] if len(panels) == 1 else rrb.Vertical(*panels, row_shares=shares)


def _tabs(panels: Sequence[Panel]) -> Panel:
    return panels[0] if len(panels) == 1 else rrb.Tabs(*panels)


def _world(look: Look) -> rrb.Spatial3DView:
    controls = rrb.EyeControls3D(position=look.eye.position_m, look_target=look.eye.target_m)
    until_now = [
        rrb.VisibleTimeRange(
            timeline,
            start=rrb.TimeRangeBoundary.infinite(),
            end=rrb.TimeRangeBoundary.cursor_relative(),
        )
        for timeline in (schema.TIME_TIMELINE, schema.STEP_TIMELINE)
    ]
    overrides: dict[Any, Any] = {}
    for trail in look.entities:
        if trail.endswith("/trail"):
            overrides[trail] = rrb.VisibleTimeRanges(until_now)
    touched = any(entity.startswith(f"{schema.COLLISIONS}/") for entity in look.entities)
    if touched:
        overrides[schema.COLLISIONS] = rrb.EntityBehavior(visible=False)
    for label in look.touched:
        overrides[f"{schema.COLLISIONS}/{label}"] = rrb.EntityBehavior(visible=True)
    return rrb.Spatial3DView(
        origin=schema.WORLD,
        name="World",
        eye_controls=controls,
        line_grid=rrb.LineGrid3D(visible=False),
        contents=["$origin/**", f"/{schema.COLLISIONS}/**"] if touched else "$origin/**",
        overrides=overrides or None,
    )


def _pictures(look: Look) -> Iterator[Panel]:
    """Yield a panel of a drop's camera, or of a script's cameras side by side."""
    if schema.IMAGE in look.entities:
        yield rrb.Spatial2DView(origin=schema.CAMERA, name="Camera")
    views = [
        rrb.Spatial2DView(origin=entity, name=f"Camera {look.cameras.get(entity, number)}")
        for number in range(MOST_CAMERAS)
        if (entity := f"camera/{number}/image") in look.entities
    ]
    if views:
        yield views[0] if len(views) == 1 else rrb.Horizontal(*views)


def _measured(look: Look) -> list[list[rrb.View]]:
    """Return the views of curves that were recorded, not analysed, grouped by kind."""
    of_drop = schema.HEIGHT_SIMULATED in look.entities
    heights = "Height of the centre [m]" if of_drop else "Heights of free bodies [m]"
    positions = ("/position", f"/{schema.TARGET}")
    kinds = [
        _curves(look, schema.HEIGHT, heights, RIGHT_TOP if look.analyzed else None),
        _curves(look, schema.JOINTS, "Joint positions [rad, m]", RIGHT_TOP, of=positions),
        _curves(look, schema.JOINTS, "Motors [N m, N]", RIGHT_TOP, of=("/effort",)),
    ]
    return [views for kind in kinds if (views := [*kind])]


def _states(look: Look) -> Iterator[rrb.View]:
    shown = [entity for entity in look.entities if entity.startswith(f"{schema.SEGMENTS}/")]
    if shown:
        first = sorted(shown, key=lambda each: look.order.get(each, 0))[:MOST_STATES]
        contents = "$origin/**" if len(first) == len(shown) else [f"+ /{each}" for each in first]
        yield rrb.StateTimelineView(
            origin=schema.SEGMENTS, name="What each body does", contents=contents
        )


def _share(look: Look) -> float:
    bodies = sum(entity.startswith(f"{schema.SEGMENTS}/") for entity in look.entities)
    return 0.8 + 0.5 * min(bodies, MOST_STATES)


def _curves(
    look: Look,
    origin: str,
    name: str,
    corner: Corner2D | None = None,
    *,
    of: tuple[str, ...] = ("",),
) -> Iterator[rrb.View]:
    """Yield a view of the curves below an entity, if there are any; `of` is appended to names."""
    shown = sorted(
        entity
        for entity in look.entities
        if entity.startswith(f"{origin}/") and entity.endswith(of)
    )
    if not shown:
        return
    first = _first_joints(look, shown) if origin == schema.JOINTS else {}
    shown = [each for each in shown if any(first.get(each, [True]))]
    few = sum(sum(first[each]) if first else look.series.get(each, 1) for each in shown)
    few = few <= 2 * MOST_JOINTS if first else few <= MOST_NAMES
    legend = rrb.PlotLegend(corner, visible=None if few else False)
    yield rrb.TimeSeriesView(
        origin=origin,
        contents="$origin/**" if of == ("",) else [f"+ /{each}" for each in shown],
        name=name,
        plot_legend=legend if corner or not few else None,
        # Without this, also the numbers beside the targets would be drawn.
        overrides={each: rr.SeriesLines(visible_series=first[each]) for each in shown if first}
        or None,
    )


def _first_joints(look: Look, entities: Sequence[str]) -> dict[str, list[bool]]:
    """Flag the curves of joint entities that are shown: those of the first `MOST_JOINTS`."""
    shown: dict[str, list[bool]] = {}
    left: dict[str, int] = {}
    for entity in entities:
        body, _, what = entity.rpartition("/")
        like = "position" if what == schema.TARGET else what
        count = look.series.get(f"{body}/{like}", 1)
        some = min(count, left.get(what, MOST_JOINTS))
        left[what] = left.get(what, MOST_JOINTS) - some
        shown[entity] = [place < some for place in range(count)]
    return shown


def _texts(look: Look) -> Panel:
    """Return the text panels: findings first, if there are any."""
    about = rrb.TextDocumentView(origin=schema.ABOUT, name="About")
    logs = [*_log(look, schema.EVENTS, "Events"), *_log(look, schema.LOG, "Calls")]
    if not look.analyzed:
        return _tabs([*logs, about])
    findings = rrb.TextDocumentView(origin=schema.FINDINGS, name="Findings")
    return _rows([findings, _tabs([*logs, about])], shares=[5, 3])


def _log(look: Look, entity: str, name: str) -> Iterator[rrb.View]:
    if entity in look.entities:
        columns = rrb.TextLogColumns(timeline_columns=[look.timeline], text_log_columns=["body"])
        yield rrb.TextLogView(origin=entity, name=name, columns=columns)
