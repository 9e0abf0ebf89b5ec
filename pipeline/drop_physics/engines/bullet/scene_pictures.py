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
from PIL import Image

from drop_physics.engines.bullet.c_output import c_output_moved_aside
from drop_physics.engines.bullet.engine import p
from drop_physics.engines.bullet.visible_world import picture_of
from drop_physics.scenario import Camera
from drop_physics.seen.events import Model, Pose

SQUARES, SQUARE = 256, 1 / 8
"""Squares along the side of an infinite plane; about the side of one in distances of the camera."""
BEND = 0.02
"""Where nearness bends by more of itself between pixels, there is an edge: a flat face has none."""
SHADES = 8
"""Shades that differ by less are one: a gif has few colours."""
EDGE = 0.35
"""Share of its colour that an edge keeps."""
DRAWN_MESHES = (".obj", ".stl", ".dae")
NOWHERE = (0.0, 0.0, -1e4)


def drawn(
    parts: Sequence[Sequence[Model]],
    poses: NDArray[np.float64],
    cameras: Sequence[Camera],
    page: tuple[int, int, int],
    tiles: tuple[str, str],
) -> Iterator[NDArray[np.uint8]]:
    """Yield pictures, RGB of shape (height, width, 3).

    Parameters
    ----------
    parts
        The shapes of each part.
    poses
        Of each part in each picture, shape (pictures, parts, 7); nan if it is absent.
    cameras
        One for each picture.
    page
        The colour of where there is nothing.
    tiles
        The two colours of an infinite plane, `#rrggbb`.
    """
    client = p.connect(p.DIRECT)
    try:
        square_m = 2.0 ** np.round(np.log2(SQUARE * cameras[0].distance_m))
        with tempfile.TemporaryDirectory() as name, c_output_moved_aside():
            shapes = _Shapes(client, Path(name), float(square_m), tiles)
            bodies = [[body for model in models if (body := shapes.body(model)) is not None]
                for models in parts]  # fmt: skip
            for placed, camera in zip(poses, cameras, strict=True):
                for number, pose in enumerate(placed):
                    for body in bodies[number]:
                        shapes.place(body, pose, camera)
                yield _picture(camera, client, shapes.floors, page)
    finally:
        p.disconnect(client)


Placed = tuple[int, Pose]
"""A body, and its pose on its part."""
NO_TURN = (0.0, 0.0, 0.0, 1.0)


class _Shapes:
    """Bodies of one simulation that only look like something."""

    def __init__(self, client: int, folder: Path, square_m: float, tiles: tuple[str, str]) -> None:
        self._client, self._folder, self._square_m = client, folder, square_m
        self._tiles = tiles
        self.floors: set[int] = set()

    def body(self, model: Model) -> Placed | None:
        """Return a body that looks like a shape; None if it cannot be drawn."""
        shape, a, b = model.shape, *(*model.shape.size_m, 0.0, 0.0)[:2]
        look: dict[str, object]
        if shape.kind == "plane":
            return self._floor(), (tuple(shape.position_m), tuple(shape.orientation))
        if shape.kind == "box":
            half = [side / 2 for side in shape.size_m]
            look = {"shapeType": p.GEOM_BOX, "halfExtents": half}
        elif shape.kind == "sphere":
            look = {"shapeType": p.GEOM_SPHERE, "radius": a}
        elif shape.kind in ("cylinder", "capsule"):
            kind = p.GEOM_CYLINDER if shape.kind == "cylinder" else p.GEOM_CAPSULE
            look = {"shapeType": kind, "length": a, "radius": b}
        elif model.mesh and model.suffix in DRAWN_MESHES:
            file = Path(tempfile.mkstemp(model.suffix, dir=self._folder)[1])
            file.write_bytes(model.mesh)
            look = {"shapeType": p.GEOM_MESH, "fileName": str(file), "meshScale": shape.size_m}
        else:
            return None
        with contextlib.suppress(p.error):
            return self._looking(shape.rgba, look), (
                tuple(shape.position_m), tuple(shape.orientation),
            )  # fmt: skip
        return None

    def _looking(self, rgba: Sequence[float], look: dict[str, object]) -> int:
        visual = p.createVisualShape(rgbaColor=rgba, physicsClientId=self._client, **look)
        made: int = p.createMultiBody(0, -1, visual, NOWHERE, physicsClientId=self._client)
        return made

    def _floor(self) -> int:
        """Return a checkerboard."""
        half_m, mesh, board = SQUARES * self._square_m / 2, *(
            self._folder / name for name in ("floor.obj", "floor.png"))  # fmt: skip
        corners = [(x, y) for x in (-1, 1) for y in (-1, 1)]
        lines = [f"v {x * half_m} {y * half_m} 0" for x, y in corners]
        lines += [f"vt {(x + 1) * SQUARES / 4} {(y + 1) * SQUARES / 4}" for x, y in corners]
        mesh.write_text(
            "\n".join([*lines, "vn 0 0 1", "f 1/1/1 3/3/1 4/4/1", "f 1/1/1 4/4/1 2/2/1"])
        )
        tiles = Image.new("RGB", (64, 64), self._tiles[0])
        for corner in ((0, 0), (32, 32)):
            tiles.paste(self._tiles[1], (*corner, corner[0] + 32, corner[1] + 32))
        tiles.save(board)
        body = self._looking((1, 1, 1, 1), {"shapeType": p.GEOM_MESH, "fileName": str(mesh)})
        texture = p.loadTexture(str(board), physicsClientId=self._client)
        p.changeVisualShape(body, -1, textureUniqueId=texture, physicsClientId=self._client)
        self.floors.add(body)
        return body

    def place(self, placed: Placed, pose: NDArray[np.float64], camera: Camera) -> None:
        """Put a body where its part is; a floor also under the camera."""
        (body, offset), place = placed, (NOWHERE, NO_TURN)
        if not np.isnan(pose).any():
            place = p.multiplyTransforms(pose[:3].tolist(), pose[3:].tolist(), *offset)
            if body in self.floors:
                seen = p.multiplyTransforms(
                    *p.invertTransform(*place), camera.target_m, NO_TURN
                )[0]  # fmt: skip
                period_m = 2 * self._square_m
                moved = [period_m * round(x / period_m) for x in seen[:2]]
                place = p.multiplyTransforms(*place, (*moved, 0.0), NO_TURN)
        p.resetBasePositionAndOrientation(body, *place, physicsClientId=self._client)


def _picture(
    camera: Camera, client: int, floors: set[int], page: tuple[int, int, int]
) -> NDArray[np.uint8]:
    pixels, depth, numbers = picture_of(client, camera, "tiny", lit=True)
    pixels -= pixels % SHADES
    near_m, far_m = camera.near_m, camera.far_m
    nearness = far_m - (far_m - near_m) * depth.astype(np.float64)
    pixels[numbers < 0] = page
    shown = (numbers >= 0) & ~np.isin(numbers, [*floors])
    edges = _edges(np.where(shown, numbers, -1), nearness) & shown
    pixels[edges] = (pixels[edges] * EDGE).astype(np.uint8)
    return pixels


def _edges(numbers: NDArray[np.int64], nearness: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return where bodies and faces end; `nearness` is 1 over the distance, to a factor."""
    edges = np.zeros(numbers.shape, np.bool_)
    for each, near, marks in ((numbers, nearness, edges), (numbers.T, nearness.T, edges.T)):
        ends = each[1:] != each[:-1]
        marks[1:] |= ends
        marks[:-1] |= ends
        marks[1:-1] |= np.abs(np.diff(near, 2, axis=0)) > BEND * near[1:-1]
    return edges
