"""The viewer's layout for a script's recording, depending on what it holds."""

from __future__ import annotations

import numpy as np
import rerun.blueprint as rrb
from numpy.typing import NDArray

from pipeline.recording import schema
from pipeline.recording.script import Script

MOST_CAMERAS = 4
LEAST_REACH_M = 0.5
MOST_NAMES = 8
"""Above this, the curves' names would hide them."""
EYE = np.array([1.6, -1.6, 1.0])
"""Position of the eye from the centre of all motion, in units of its reach."""


def layout(script: Script) -> rrb.Blueprint:
    """Return the layout: the scene, its cameras, curves of free and of jointed bodies."""
    world = world_view(script.low_m, script.high_m)
    cameras = [
        rrb.Spatial2DView(origin=f"camera/{number}/image", name=f"Camera {name}")
        for name, number in list(script.cameras.items())[:MOST_CAMERAS]
    ]
    seen = [rrb.Horizontal(*cameras)] if cameras else []
    left = rrb.Vertical(world, *seen, row_shares=[3, 2][: 1 + len(seen)])
    curves: list[rrb.View | rrb.Container] = []
    if script.free:
        curves.append(_curves(schema.HEIGHT, "Heights of free bodies [m]", len(script.free)))
    if script.jointed:
        joints = sum(
            sum(any(joint.widths) for joint in script.bodies[number].joints)
            for number in script.jointed
        )
        curves.append(_curves(schema.JOINT_POSITIONS, "Joint positions [rad, m]", joints))
        curves.append(_curves(schema.JOINT_TORQUES, "Motor torques [Nm, N]", joints))
    acting = []
    if script.touched:
        acting.append(_curves(schema.CONTACT_FORCES, "Contact forces [N]", len(script.touched)))
    if script.energetic:
        acting.append(_curves(schema.ENERGIES, "Energies [J]", len(script.energetic)))
    if acting:
        curves.append(rrb.Tabs(*acting))
    calls = rrb.TextLogView(
        origin=schema.CALLS,
        name="Calls",
        columns=rrb.TextLogColumns(
            timeline_columns=[schema.TIME_TIMELINE], text_log_columns=["body"]
        ),
    )
    about = rrb.TextDocumentView(origin=schema.ABOUT, name="About")
    right = rrb.Vertical(*curves, rrb.Tabs(calls, about))
    timeline = schema.TIME_TIMELINE if script.stepped else schema.CALL_TIMELINE
    return rrb.Blueprint(
        rrb.Horizontal(left, right, column_shares=[3, 2]),
        rrb.TimePanel(timeline=timeline, state="collapsed", loop_mode="all", play_state="playing"),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
    )


def world_view(low_m: NDArray[np.float64], high_m: NDArray[np.float64]) -> rrb.Spatial3DView:
    """Return a view of the scene that the box between two corners fills."""
    centre = (low_m + high_m) / 2
    reach = max(LEAST_REACH_M, float(np.linalg.norm(high_m - low_m)) / 2)
    return rrb.Spatial3DView(
        origin=schema.WORLD,
        name="World",
        line_grid=rrb.LineGrid3D(visible=False),
        eye_controls=rrb.EyeControls3D(
            position=(centre + reach * EYE).tolist(), look_target=centre.tolist()
        ),
    )


def _curves(origin: str, name: str, count: int) -> rrb.TimeSeriesView:
    legend = rrb.PlotLegend(visible=count <= MOST_NAMES)
    return rrb.TimeSeriesView(origin=origin, name=name, plot_legend=legend)
