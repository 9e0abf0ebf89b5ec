"""Draw the README's pictures, for light and dark pages, and one of the viewer.

The README's commands draw them; the dark ones add `--dark`, which no page shows.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image

from generators.pictures import small
from generators.typed import ROOT, run_command

IMAGES = ROOT / "docs/images"
FILM = (
    "drop simulate --out film.rrd --camera follow --capture-every 8 --size 400x300",
    "drop render film.rrd --with-plot --speed 0.25",
)
"""The README's commands for its first picture."""
ARM = (
    "drop record docs/examples/arm.py",
    "drop render recordings/arm.rrd --with-plot --speed 1 --fps 10 --out arm.gif",
    "drop render recordings/arm.rrd --with-plot --speed 1 --fps 10 --out arm-dark.gif --dark",
)
"""Those for the picture of a robot."""
HEAP = (
    "drop record docs/examples/heap.py",
    "drop render recordings/heap.rrd --out heap.gif",
    "drop trust --vary nudge --plot heap-trust.png docs/examples/heap.py",
    "drop trust --vary nudge --plot heap-trust-dark.png --dark --force docs/examples/heap.py",
)
"""Those for the pictures of a script."""
COMMANDS = (
    *ARM,
    *HEAP,
    *FILM,
    f"{FILM[1]} --dark --out film-dark.gif --plot film-dark.png",
    "drop run",
    "drop render recordings/run.rrd --dark --out run-dark.gif --plot run-dark.png",
)
DRAWN = (
    "arm.gif",
    "arm-dark.gif",
    "heap.gif",
    "heap-trust.png",
    "heap-trust-dark.png",
    "film.gif",
    "film-dark.gif",
    "recordings/run.png",
    "run-dark.png",
)
VIEWER = IMAGES / "viewer.png"
TITLE_BAR_PX = 38
"""Left out: it shows details of the machine, which has no display."""
AT_S = 0.3
"""Time of `drop view`'s cursor."""


def made() -> dict[Path, bytes]:
    """Return the pictures as drawn now, except that of the viewer.

    Raises
    ------
    RuntimeError
        If a command fails.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        shutil.copytree(ROOT / "docs/examples", folder / "docs/examples")
        _type(COMMANDS, folder)
        return {IMAGES / Path(file).name: small(folder / file) for file in DRAWN}


def viewer_picture() -> dict[Path, bytes]:
    """Return the picture of the viewer; it needs Mesa's Vulkan driver, and differs by machine.

    Raises
    ------
    RuntimeError
        If a command fails.
    """
    sys.path.append(str(ROOT / "tests"))
    from viewer import Viewer, decoded

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        _type(["drop run"], folder)
        files = (folder / "recordings/run.rrd", folder / "recordings/run.analysis.rrd")
        with Viewer(*files, size="1500x938") as viewer:
            viewer.set_time(AT_S)
            window = decoded(viewer.settled())[TITLE_BAR_PX:]
        Image.fromarray(window.astype(np.uint8)).save(folder / "viewer.png")
        return {VIEWER: small(folder / "viewer.png")}


def _type(commands: tuple[str, ...] | list[str], folder: Path) -> None:
    for command in commands:
        code, printed = run_command(command, folder)
        if code:
            raise RuntimeError(f"`{command}` exits with {code}: {printed}")
