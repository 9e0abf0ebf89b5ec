"""The viewer's layout for a drop's recording, alone or with its analysis."""

from __future__ import annotations

from typing import TypedDict

import rerun.blueprint as rrb

from pipeline.recording import schema
from pipeline.scenario import View

PLAYBACK_SPEED = 0.25
"""A fall from 1 m takes half a second: too fast to watch."""

EYE_M, TARGET_M = (2.9, -0.95, 1.6), (0.4, -0.5, 0.5)
"""Beside the camera, so that its picture, the floor and the fall are seen from the front."""

NEAR_EYE_M, NEAR_TARGET_M = (1.55, 0.6, 0.9), (0.0, 0.0, 0.45)
"""Near the body: from the side, so that the camera's picture does not hide it."""


class Look(TypedDict):
    """What the layout depends on: arguments of `layout`."""

    height_m: float
    camera: View | None


def layout(*, height_m: float, camera: View | None, analysis: bool = False) -> rrb.Blueprint:
    """Return the layout of a recording.

    Parameters
    ----------
    height_m
        Height of the release [m]; the higher, the farther away is the eye.
    camera
        The camera's view, or None where there are no frames.
    analysis
        Whether it is for the recording with its analysis layer.
    """
    world = _world(far=max(1.0, height_m), near=camera in ("close", "follow"))
    left = world if camera is None else rrb.Vertical(world, _camera(), row_shares=[4, 3])
    about = rrb.TextDocumentView(origin=schema.ABOUT, name="About")
    if analysis:
        curves = rrb.Vertical(
            _heights(rrb.Corner2D.RightTop), _errors(), _energy(), row_shares=[3, 4, 3]
        )
        texts = rrb.Vertical(
            rrb.TextDocumentView(origin=schema.FINDINGS, name="Findings"),
            _events(),
            about,
            row_shares=[6, 3, 2],
        )
        columns = rrb.Horizontal(left, curves, texts, column_shares=[3, 4, 3])
    else:
        right = rrb.Vertical(_heights(rrb.Corner2D.LeftBottom), about, row_shares=[1, 1])
        columns = rrb.Horizontal(left, right, column_shares=[1, 1])
    return rrb.Blueprint(
        columns,
        # A layout cannot set where the time cursor starts. Alone, the fall is played; with the
        # analysis, it is paused at the release.
        rrb.TimePanel(
            timeline=schema.TIME_TIMELINE,
            state="collapsed",
            play_state="paused" if analysis else "playing",
            loop_mode="all",
            playback_speed=PLAYBACK_SPEED,
        ),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
    )


def _world(*, far: float, near: bool) -> rrb.Spatial3DView:
    until_now = [
        rrb.VisibleTimeRange(
            timeline,
            start=rrb.TimeRangeBoundary.infinite(),
            end=rrb.TimeRangeBoundary.cursor_relative(),
        )
        for timeline in (schema.TIME_TIMELINE, schema.STEP_TIMELINE)
    ]
    eye_m, target_m = (NEAR_EYE_M, NEAR_TARGET_M) if near else (EYE_M, TARGET_M)
    return rrb.Spatial3DView(
        origin=schema.WORLD,
        name="World",
        eye_controls=rrb.EyeControls3D(
            position=[far * x for x in eye_m], look_target=[far * x for x in target_m]
        ),
        line_grid=rrb.LineGrid3D(visible=False),
        overrides={schema.TRAIL: rrb.VisibleTimeRanges(until_now)},
    )


def _camera() -> rrb.Spatial2DView:
    return rrb.Spatial2DView(origin=schema.CAMERA, name="Camera")


def _heights(legend: rrb.Corner2D) -> rrb.TimeSeriesView:
    return _curves(schema.HEIGHT, "Height of the centre [m]", legend)


def _errors() -> rrb.TimeSeriesView:
    return _curves(schema.ERROR_MM, "Simulated minus free fall [mm]", rrb.Corner2D.LeftTop)


def _energy() -> rrb.TimeSeriesView:
    return _curves(schema.ENERGY, "Energy [J]", rrb.Corner2D.RightTop)


def _curves(origin: str, name: str, legend: rrb.Corner2D) -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(origin=origin, name=name, plot_legend=rrb.PlotLegend(legend))


def _events() -> rrb.TextLogView:
    return rrb.TextLogView(
        origin=schema.EVENTS,
        name="Events",
        columns=rrb.TextLogColumns(
            timeline_columns=[schema.TIME_TIMELINE], text_log_columns=["body"]
        ),
    )
