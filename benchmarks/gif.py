"""Writing a GIF of many frames, compared with Pillow's writer, which gets all frames at once."""

from __future__ import annotations

import pickle
from collections.abc import Iterator
from pathlib import Path

from drop_physics import Camera
from drop_physics.engines.pybullet.camera_frames import Photographer

from benchmarks.harness import PYTHON, Measured, Ran, paired, process, slow_fall

OURS = """
import pickle
from drop_physics.figures.animation import decoded
from drop_physics.figures.gif import write_gif
def pngs():
    with open("pngs", "rb") as file:
        for _ in range({count}):
            yield pickle.load(file)
with open("ours.gif", "wb") as file:
    write_gif(decoded(pngs()), file, fps=50)
"""
PILLOW = """
import io, pickle
from PIL import Image
with open("pngs", "rb") as file:
    images = [Image.open(io.BytesIO(pickle.load(file))).convert("RGB") for _ in range({count})]
images[0].save("theirs.gif", save_all=True, append_images=images[1:], duration=20, loop=0)
"""


def measure(folder: Path, *, quick: bool) -> Iterator[Measured]:
    """Compare whole processes that read the same PNGs."""
    few, many = (5, 20) if quick else (200, 1000)
    _draw(folder / "pngs", many)

    def ours(count: int) -> Ran:
        return process(*PYTHON, OURS.format(count=count), folder=folder)

    ratios, detail = paired(
        lambda: ours(many),
        lambda: process(*PYTHON, PILLOW.format(count=many), folder=folder),
        pairs=1 if quick else 3,
        warm=not quick,
    )
    yield Measured(f"gif of {many} frames", "Pillow's save_all", ratios, 0.5, detail=detail)
    yield Measured(
        f"gif: peak memory of {many} frames over {few}",
        "",
        [ours(many).peak_mb / ours(few).peak_mb],
        1.1,
        detail=f"{ours(many).peak_mb:.0f} MB",
    )


def _draw(path: Path, count: int) -> None:
    scenario, poses = slow_fall(count)
    with Photographer(scenario, Camera(), frames=count) as photographer, path.open("wb") as file:
        for png in photographer.draw(poses):
            pickle.dump(png, file)
