"""Draw the README's images for light and dark themes, and a screenshot of the viewer.

The README's commands draw them; the dark ones add `--dark`, which no page shows.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
import textwrap
from pathlib import Path

import numpy as np
from drop_physics.figures.theme import DARK
from matplotlib import get_data_path
from PIL import Image, ImageDraw, ImageFont

from generators.pictures import small
from generators.typed import ROOT, run_command

IMAGES = ROOT / "docs/images"
FILM = (
    "drop simulate --out film.rrd --capture-every 8 --size 400x300",
    "drop render film.rrd --camera standard --with-plot --speed 0.25",
)
"""Commands for the README's first image."""
ARM = (
    "drop record docs/examples/arm.py",
    "drop render recordings/arm.rrd --with-plot --speed 1 --fps 10 --out arm.gif",
    "drop render recordings/arm.rrd --with-plot --speed 1 --fps 10 --out arm-dark.gif --dark",
)
"""Commands for the image of a robot."""
HEAP = (
    "drop record docs/examples/heap.py",
    "drop render recordings/heap.rrd --out heap.gif",
    "drop trust --vary nudge --plot heap-trust.png docs/examples/heap.py",
    "drop trust --vary nudge --plot heap-trust-dark.png --dark --force docs/examples/heap.py",
)
"""Commands for the images of a script."""
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
CI = "ci.png"
TEST = """import pybullet as p, pybullet_data

def run_my_simulation():
    p.connect(p.DIRECT)
    p.setAdditionalSearchPath(pybullet_data.getDataPath())
    p.setGravity(0, 0, -9.81)
    p.loadURDF("plane.urdf")
    p.loadURDF("cube_small.urdf", [0, 0, 0.5])
    for _ in range(240):
        p.stepSimulation()

def test_pick(golden_recording):
    with golden_recording("pick"):
        run_my_simulation()
"""
FAILS = (
    "python -m pytest -q --update-golden --basetemp=new",
    "sed -i 's/0.5]/0.51]/' test_pick.py",
    "unset CI; python -m pytest -q --basetemp=new || true",
)
"""Commands whose last one is shown in the image of a failing test; pytest's lines are longer in
CI."""
LETTERS_PX, MARGIN_PX = 15, 18
VIEWER = IMAGES / "viewer.png"
TITLE_BAR_PX = 38
"""Height of the title bar, which is cropped: it shows details of the machine."""
AT_S = 0.3
"""Time of `drop view`'s cursor [s]."""


def made() -> dict[Path, bytes]:
    """Return the current images, except the screenshot of the viewer.

    Raises
    ------
    RuntimeError
        If a command fails.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        shutil.copytree(ROOT / "docs/examples", folder / "docs/examples")
        _type(COMMANDS, folder)
        (folder / "test_pick.py").write_text(TEST)
        _terminal(_type(FAILS, folder).replace(f"{folder.resolve()}/", ""), folder / CI)
        return {IMAGES / Path(file).name: small(folder / file) for file in (*DRAWN, CI)}


def _terminal(printed: str, path: Path) -> None:
    """Draw printed output as a terminal window."""
    lines = [part for line in printed.splitlines() for part in textwrap.wrap(line, 80) or [""]]
    font = ImageFont.truetype(f"{get_data_path()}/fonts/ttf/DejaVuSansMono.ttf", LETTERS_PX)
    size = round(80 * font.getlength("x")), round(1.4 * LETTERS_PX * len(lines))
    picture = Image.new("RGB", (size[0] + 2 * MARGIN_PX, size[1] + 2 * MARGIN_PX), DARK.page)
    for number, line in enumerate(lines):
        fails = line.startswith(("FAILED", "F ", "___", "differs")) or " failed" in line
        at = MARGIN_PX, round(MARGIN_PX + 1.4 * LETTERS_PX * number)
        ImageDraw.Draw(picture).text(at, line, "#ff7b72" if fails else DARK.text, font)
    picture.save(path)


def viewer_picture() -> dict[Path, bytes]:
    """Return a screenshot of the viewer; needs Mesa's Vulkan driver, and differs by machine.

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


def _type(commands: tuple[str, ...] | list[str], folder: Path) -> str:
    """Run commands, and return the last one's output."""
    printed = ""
    for command in commands:
        code, printed = run_command(command, folder)
        if code:
            raise RuntimeError(f"`{command}` exits with {code}: {printed}")
    return printed
