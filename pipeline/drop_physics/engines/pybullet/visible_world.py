"""A world that can be rendered to images, by TinyRenderer or the EGL plugin of PyBullet's wheel."""

from __future__ import annotations

from dataclasses import replace
from importlib.util import find_spec
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from drop_physics.arrays import Float64, Int64
from drop_physics.engines.pybullet.c_output import c_output_moved_aside
from drop_physics.engines.pybullet.engine import p
from drop_physics.engines.pybullet.world import World
from drop_physics.errors import DropError
from drop_physics.physics.laws.lookup import fall_of
from drop_physics.physics.theory import impact_time_free
from drop_physics.scenario import Camera, Renderer, Scenario

LIGHT = (0.5, -1.2, 2.0)
"""Direction of the light in all views but the standard one: no two faces of a box get the same
shade. The standard view, as in the original experiment, has PyBullet's default light."""


class Picture(NamedTuple):
    """A rendered image, in arrays of shape (height, width)."""

    pixels: NDArray[np.uint8]
    """RGB, shape (height, width, 3)."""
    depth: NDArray[np.float32]
    """Depth: 0 at the near plane, 1 at the far plane and for the background."""
    bodies: Int64
    """Id of the body at each pixel; negative for the background."""


class VisibleWorld(World):
    """A world in front of a camera; use it in a `with` statement.

    Parameters
    ----------
    scenario
        The simulated drop.
    renderer
        The renderer. If `egl` finds no graphics driver, its plugin ends the whole process: use it
        only in a process that may end.

    Raises
    ------
    ScenarioError
        If the body cannot be found or loaded, or has no mass.
    DropError
        If the renderer is unavailable.
    """

    def __init__(self, scenario: Scenario, renderer: Renderer) -> None:
        self._renderer = renderer
        self.gl_renderer = ""
        """The renderer of EGL, as its driver reports it."""
        super().__init__(scenario)

    def _load_body(self) -> int:
        if self._renderer == "egl":  # a renderer draws only bodies loaded after it
            self._load_egl()
        return super()._load_body()

    def _load_egl(self) -> None:
        plugin = find_spec("eglRenderer")
        if plugin is None:
            raise DropError("this build of pybullet has no EGL renderer; use --renderer tiny")
        with c_output_moved_aside() as printed:
            number = p.loadPlugin(plugin.origin, "_eglRendererPlugin", physicsClientId=self._client)
        if number < 0:
            raise DropError("PyBullet's EGL renderer cannot be loaded; use --renderer tiny")
        self.gl_renderer = printed[0].partition("GL_RENDERER=")[2].partition("\n")[0]

    def photograph(self, camera: Camera) -> Picture:
        """Render an image of the world's current state."""
        return picture_of(self._client, camera, self._renderer, lit=camera.view != "standard")


def picture_of(client: int, camera: Camera, renderer: Renderer, *, lit: bool) -> Picture:
    """Render a simulation's current state, with the light `LIGHT` (`lit`) or PyBullet's default."""
    width, height = camera.size_px
    _, _, rgba, depth, bodies = p.getCameraImage(
        width,
        height,
        viewMatrix=view_matrix(camera),
        projectionMatrix=p.computeProjectionMatrixFOV(
            camera.vertical_fov_deg, width / height, camera.near_m, camera.far_m
        ),
        **({"lightDirection": LIGHT} if lit else {}),
        renderer={"tiny": p.ER_TINY_RENDERER, "egl": p.ER_BULLET_HARDWARE_OPENGL}[renderer],
        physicsClientId=client,
    )
    # Built without numpy, PyBullet returns flat tuples instead of arrays.
    pixels = np.asarray(rgba, dtype=np.uint8).reshape(height, width, 4)
    return Picture(
        np.ascontiguousarray(pixels[:, :, :3]),
        np.asarray(depth, dtype=np.float32).reshape(height, width),
        np.asarray(bodies).reshape(height, width),
    )


SHARE_OF_HEIGHT = {"close": 1 / 6, "follow": 1 / 4}
"""The share of an image's height that the body takes up."""


def framed(camera: Camera, scenario: Scenario) -> Camera:
    """Return a camera positioned for its view of a scenario.

    The standard view is fixed. `close` looks at the place where the body lands or, if it never
    lands, of the release; `follow` looks at the body's current position. Framing a camera again
    changes nothing.

    Raises
    ------
    ScenarioError
        If the body cannot be found or loaded, or has no mass.
    """
    if camera.view == "standard":
        return camera
    with World(scenario) as world:
        extent_m = 2 * float(np.linalg.norm(world.half_size_m))
        rest_m = world.rest_height_m
    share = SHARE_OF_HEIGHT[camera.view] * camera.size_px[1]
    distance_m = camera.focal_length_px * extent_m / share
    return replace(
        camera,
        target_m=_landing_m(scenario, rest_m) if camera.view == "close" else (0.0, 0.0, 0.0),
        distance_m=distance_m,
        near_m=min(0.1, distance_m / 4),
        # A camera above the floor may be far from it.
        far_m=max(10.0, 4 * (scenario.height_m + distance_m)),
    )


def _landing_m(scenario: Scenario, rest_m: float | None) -> tuple[float, float, float]:
    fall = fall_of(scenario)
    if rest_m is None or not (scenario.floor and scenario.stepped):
        return (0.0, 0.0, scenario.height_m)
    landing_s = impact_time_free(fall, rest_m)
    if landing_s is None:
        return (0.0, 0.0, scenario.height_m)
    vx, vy, _ = scenario.velocity_m_s
    return (vx * landing_s, vy * landing_s, rest_m)


def view_matrix(camera: Camera) -> list[float]:
    """Return a camera's view matrix, from world to camera, column by column."""
    up_axis_z = 2
    return list(
        p.computeViewMatrixFromYawPitchRoll(
            camera.target_m,
            camera.distance_m,
            camera.yaw_deg,
            camera.pitch_deg,
            camera.roll_deg,
            up_axis_z,
        )
    )


def world_from_camera(camera: Camera) -> Float64:
    """Return the camera's pose, shape (4, 4): x right, y up, z backwards, as in OpenGL."""
    camera_from_world = np.array(view_matrix(camera)).reshape(4, 4).T
    return np.linalg.inv(camera_from_world)
