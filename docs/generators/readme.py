"""Draw the README's pictures, for light pages and for dark ones; and one of the viewer.

What is drawn is what the README's commands make, but `--dark` is said on no page.
"""

from __future__ import annotations

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
"""What the README says to type for its first picture."""
COMMANDS = (
    *FILM,
    f"{FILM[1]} --dark --out film-dark.gif --plot film-dark.png",
    "drop run",
    "drop render recordings/run.rrd --dark --out run-dark.gif --plot run-dark.png",
)
DRAWN = ("film.gif", "film-dark.gif", "recordings/run.png", "run-dark.png")
VIEWER = IMAGES / "viewer.png"
TITLE_BAR_PX = 38
"""It tells of the machine, which has no screen."""
AT_S = 0.3
"""Where `drop view` puts the time cursor."""


def made() -> dict[Path, bytes]:
    """Return the pictures as the program draws them now, but that of the viewer.

    Raises
    ------
    RuntimeError
        If a command fails.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        _type(COMMANDS, folder)
        return {IMAGES / Path(one).name: small(folder / one) for one in DRAWN}


def viewer_picture() -> dict[Path, bytes]:
    """Return the picture of the viewer; it takes Mesa's Vulkan driver, and differs by machine.

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
