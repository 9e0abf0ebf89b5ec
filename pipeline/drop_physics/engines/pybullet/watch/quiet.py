"""Provides the results of GUI functions for scripts that request a window but run without one.

Without a window, PyBullet raises an error in some functions (`readUserDebugParameter`), returns
zeros from others (`getDebugVisualizerCamera`), and returns no ids for drawn items.
"""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

from .functions import DRAWS

WINDOW_PX = (1024, 768)
NEAR_M, FAR_M, FIELD_OF_VIEW_DEG = 0.1, 1000.0, 60.0


class Window:
    """A GUI window that does not exist and whose user does nothing."""

    def __init__(self, p: SimpleNamespace, gui: int) -> None:
        self._p, self._gui = p, gui
        self._items = 0
        self._sliders: dict[int, float] = {}
        self._camera: dict[str, Any] = {
            "cameraDistance": 5.0,
            "cameraYaw": 50.0,
            "cameraPitch": -35.0,
            "cameraTargetPosition": (0.0, 0.0, 0.0),
        }

    def answers(self) -> dict[str, Callable[[dict[str, Any], Any], Any]]:
        """Return the functions that compute the results of PyBullet's GUI functions, by name.

        Their parameters are the call's arguments by name, and PyBullet's own result.
        """
        return {
            **dict.fromkeys(DRAWS, self._draw),
            "addUserDebugParameter": self._add_slider,
            "readUserDebugParameter": self._read_slider,
            "removeUserDebugItem": self._nothing,
            "removeAllUserParameters": self._nothing,
            "getDebugVisualizerCamera": self._camera_data,
            "resetDebugVisualizerCamera": self._move_camera,
            "getConnectionInfo": self._connection,
        }

    def _draw(self, arguments: dict[str, Any], _: object) -> int:
        replaced = arguments.get("replaceItemUniqueId", -1)
        if replaced >= 0:
            return int(replaced)
        self._items += 1
        return self._items - 1

    def _add_slider(self, arguments: dict[str, Any], _: object) -> int:
        number = self._draw({}, None)
        low, high = arguments.get("rangeMin", 0.0), arguments.get("rangeMax", 1.0)
        # A reversed range makes a button, which counts how often it was pressed.
        self._sliders[number] = float(arguments.get("startValue", low if low <= high else 0.0))
        return number

    def _read_slider(self, arguments: dict[str, Any], _: object) -> float:
        return self._sliders.get(arguments.get("itemUniqueId", -1), 0.0)

    def _nothing(self, *_: object) -> None:
        return None

    def _move_camera(self, arguments: dict[str, Any], _: object) -> None:
        self._camera.update({k: v for k, v in arguments.items() if k in self._camera})

    def _camera_data(self, *_: object) -> tuple[Any, ...]:
        p, camera = self._p, self._camera
        target, distance = camera["cameraTargetPosition"], camera["cameraDistance"]
        yaw, pitch = camera["cameraYaw"], camera["cameraPitch"]
        view = p.computeViewMatrixFromYawPitchRoll(target, distance, yaw, pitch, 0, 2)
        width, height = WINDOW_PX
        lens = p.computeProjectionMatrixFOV(FIELD_OF_VIEW_DEG, width / height, NEAR_M, FAR_M)
        right, up, back = view[0:12:4], view[1:12:4], view[2:12:4]
        # The last two axes are half the width and height of the picture at the far plane.
        half = FAR_M / lens[5]
        horizontal = tuple(2 * half * width / height * value for value in right)
        vertical = tuple(2 * half * value for value in up)
        forward = tuple(-value for value in back)
        return (
            width,
            height,
            view,
            lens,
            (0.0, 0.0, 1.0),
            forward,
            horizontal,
            vertical,
            yaw,
            pitch,
            distance,
            tuple(target),
        )

    def _connection(self, _: object, answer: dict[str, Any]) -> dict[str, Any]:
        return {**answer, "connectionMethod": self._gui}
