"""Pictures of a script's scene, drawn from its recorded poses.

A mesh that Bullet does not understand may crash it: call this only in a process that may end.
"""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drop_physics.engines.bullet.c_output import c_output_moved_aside
from drop_physics.engines.bullet.engine import p
from drop_physics.engines.bullet.visible_world import view_matrix
from drop_physics.scenario import Camera
from drop_physics.seen.events import Model, Pose

PLANE_M = 20.0
"""How wide an infinite plane is drawn."""
PLANE_RGBA = (0.54, 0.58, 0.63, 1.0)
DRAWN_MESHES = (".obj", ".stl", ".dae")
NOWHERE = (0.0, 0.0, -1e4)


def drawn(
    parts: Sequence[Sequence[Model]],
    poses: Sequence[Sequence[Pose | None]],
    cameras: Sequence[Camera],
) -> Iterator[NDArray[np.uint8]]:
    """Yield pictures, RGB of shape (height, width, 3).

    Parameters
    ----------
    parts
        The shapes of each part.
    poses
        For each picture, the pose of each part; None if it is absent.
    cameras
        One for each picture.
    """
    client = p.connect(p.DIRECT)
    try:
        with tempfile.TemporaryDirectory() as folder, c_output_moved_aside():
            bodies = [
                [
                    body
                    for model in models
                    if (body := _body(model, Path(folder), client)) is not None
                ]
                for models in parts
            ]
        shown: list[Pose | None] = [None] * len(parts)
        for placement, camera in zip(poses, cameras, strict=True):
            for number, pose in enumerate(placement):
                if pose != shown[number]:
                    for placed in bodies[number]:
                        _place(*placed, pose, client)
                    shown[number] = pose
            yield _picture(camera, client)
    finally:
        p.disconnect(client)


Placed = tuple[int, Pose]


def _body(model: Model, folder: Path, client: int) -> Placed | None:
    """Return a body that looks like a shape, and its pose on its part; None if not drawable."""
    shape, a, b = model.shape, *(*model.shape.size_m, 0.0, 0.0)[:2]
    rgba = PLANE_RGBA if shape.kind == "plane" else shape.rgba
    look: dict[str, object]
    if shape.kind in ("box", "plane"):
        half = [PLANE_M / 2, PLANE_M / 2, 0.005]
        if shape.kind == "box":
            half = [side / 2 for side in shape.size_m]
        look = {"shapeType": p.GEOM_BOX, "halfExtents": half}
    elif shape.kind == "sphere":
        look = {"shapeType": p.GEOM_SPHERE, "radius": a}
    elif shape.kind in ("cylinder", "capsule"):
        kind = p.GEOM_CYLINDER if shape.kind == "cylinder" else p.GEOM_CAPSULE
        look = {"shapeType": kind, "length": a, "radius": b}
    elif model.mesh and model.suffix in DRAWN_MESHES:
        file = Path(tempfile.mkstemp(model.suffix, dir=folder)[1])
        file.write_bytes(model.mesh)
        look = {"shapeType": p.GEOM_MESH, "fileName": str(file), "meshScale": shape.size_m}
    else:
        return None
    with contextlib.suppress(p.error):
        visual = p.createVisualShape(rgbaColor=rgba, physicsClientId=client, **look)
        body = p.createMultiBody(0, -1, visual, NOWHERE, physicsClientId=client)
        position = shape.position_m
        if shape.kind == "plane":  # its upper side is where the plane is
            position, _ = p.multiplyTransforms(position, shape.orientation, (0, 0, -0.005), NO_TURN)
        return body, (tuple(position), tuple(shape.orientation))
    return None


NO_TURN = (0.0, 0.0, 0.0, 1.0)


def _place(body: int, offset: Pose, pose: Pose | None, client: int) -> None:
    place = (NOWHERE, NO_TURN) if pose is None else p.multiplyTransforms(*pose, *offset)
    p.resetBasePositionAndOrientation(body, *place, physicsClientId=client)


def _picture(camera: Camera, client: int) -> NDArray[np.uint8]:
    width, height = camera.size_px
    _, _, rgba, _, _ = p.getCameraImage(
        width,
        height,
        viewMatrix=view_matrix(camera),
        projectionMatrix=p.computeProjectionMatrixFOV(
            camera.vertical_fov_deg, width / height, camera.near_m, camera.far_m
        ),
        renderer=p.ER_TINY_RENDERER,
        physicsClientId=client,
    )
    pixels = np.asarray(rgba, dtype=np.uint8).reshape(height, width, 4)
    return np.ascontiguousarray(pixels[:, :, :3])
