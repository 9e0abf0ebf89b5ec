"""`--html`: one self-contained file, which a browser opens without further requests."""

from __future__ import annotations

import base64
import io
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from command import ROOT, drop_here
from drop_physics.report.blocks import Column, DataTable, Fact, Facts, Report, Section, Words
from drop_physics.report.html import html_of
from PIL import Image

pytestmark = pytest.mark.pybullet

CURVES = {"1": (0, 114, 178), "0": (216, 239, 253)}
"""Colours of a simulated curve in the light and the dark theme."""


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the HTML page about an arm whose motor is too weak."""
    folder = tmp_path_factory.mktemp("page")
    shutil.copy(ROOT / "docs/examples/arm.py", folder)
    assert drop_here("record", "arm.py", folder=folder).returncode == 0
    done = drop_here("analyze", "arm.py", "--html", "arm.html", folder=folder)
    assert done.returncode == 0, done.stderr
    return folder / "arm.html"


@pytest.mark.long
def test_a_page_has_verdict_finding_and_its_line(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert "<h1>arm.py finished: 1 body, 720 steps" in text
    assert "lbr_iiwa_joint_2 ends 1.3 rad off its target" in text
    (marked,) = re.findall("<mark>(.*?)</mark>", text)
    call = "p.setJointMotorControl2(arm, joint, p.POSITION_CONTROL, angle, force=30)"
    assert marked.split() == ["13", *call.split()]
    light, dark, strip = re.findall('(?:src|srcset)="data:image/gif;base64,([^"]+)', text)
    assert len({light, dark, strip}) == 3
    drawn = re.findall('(?:src|srcset)="data:image/svg[+]xml;base64,([^"]+)', text)
    pictures = [base64.b64decode(each).decode() for each in drawn]  # of all, then of the row
    for svg, ground in zip(pictures, ("#0d1117", "#ffffff") * 2, strict=True):
        assert f"fill: {ground}" in svg
        assert "lbr_iiwa_joint_2" in svg
    assert text.count('<source media="(prefers-color-scheme: dark)" srcset=') >= 4


def test_a_page_shows_a_row_with_its_curve_and_the_frame_of_its_moment(page: Path) -> None:
    """The finding replaces the row: the joint is 1.29 rad off at the end, after 3 s."""
    text = page.read_text(encoding="utf-8")
    (row,) = re.findall('<div class="moment">(.*?)</div>', text, re.DOTALL)
    svg = base64.b64decode(re.findall('src="data:image/svg[+]xml;base64,([^"]+)', row)[0]).decode()
    assert "0.8 rad, got 2.09 rad" in svg
    (frame,) = re.findall('src="data:image/png;base64,([^"]+)', row)
    (film, _) = re.findall('src="data:image/gif;base64,([^"]+)', text)
    shown = np.asarray(Image.open(io.BytesIO(base64.b64decode(frame))).convert("RGB"))
    with Image.open(io.BytesIO(base64.b64decode(film))) as frames:
        frames.seek(frames.n_frames - 1)
        assert (shown == np.asarray(frames.convert("RGB"))).all()
        frames.seek(0)
        assert (shown != np.asarray(frames.convert("RGB"))).any()


def test_each_row_of_a_page_leads_to_a_frame_of_its_moment(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    links = re.findall('<td class="when"><a href="#(.*?)">(.*?) s</a>', text)
    frames = dict(re.findall('<figure id="(.*?)">.*?<figcaption>(.*?) s</figcaption>', text))
    assert links
    assert {place for place, _ in links} == frames.keys()
    for place, time_s in links:
        assert float(frames[place]) == pytest.approx(float(time_s), abs=3 / 31)  # of 32 in 3 s


def test_a_page_asks_nobody_for_anything(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert len(text) < 5e6
    assert '<meta http-equiv="Content-Security-Policy" content="default-src \'none\'' in text
    assert "<script" not in text
    assert not re.findall(r"<(?:img|iframe|link)[^>]+(?:src|href)=[\"'](?!data:)", text)


def test_a_page_replaces_nothing_unasked(page: Path) -> None:
    before = page.read_bytes()
    done = drop_here("analyze", "--html", "arm.html", folder=page.parent)
    assert done.returncode == 1
    assert "--force" in done.stderr
    assert page.read_bytes() == before
    done = drop_here("analyze", "--html", "arm.pdf", folder=page.parent)
    assert "--html must end in .html, got 'arm.pdf'" in done.stderr


def test_a_check_has_a_page_too(page: Path) -> None:
    recording = "recordings/arm.rrd"
    command = ("check", recording, "--against", recording, "--html", "check.html")
    assert drop_here(*command, folder=page.parent).returncode == 0
    text = (page.parent / "check.html").read_text()
    assert "<h1>drop check: same</h1>" in text
    assert "<script" not in text  # nothing to draw


def test_names_of_a_recording_are_text() -> None:
    hostile = "<script>alert(1)</script>\x1b[2J"
    blocks = [
        Words(hostile),
        Facts([Fact(hostile, hostile, is_command=True)], 8),
        DataTable([Column(hostile, [hostile])], title=hostile),
    ]
    text = "".join(html_of(Report(verdict=Words(hostile), sections=[Section(blocks)])))
    assert "<script" not in text
    assert "\x1b" not in text
    assert text.count("&lt;script&gt;") == 6


@pytest.fixture
def chromium() -> str:
    path = shutil.which("chromium")
    if path is None:
        pytest.skip("no Chromium; try: apt-get install chromium")
    return path


@pytest.mark.long
@pytest.mark.parametrize(("scheme", "background"), [("1", (255, 255, 255)), ("0", (13, 17, 23))])
def test_a_browser_draws_it_light_and_dark(
    chromium: str, page: Path, tmp_path: Path, scheme: str, background: tuple[int, int, int]
) -> None:
    shot = tmp_path / "page.png"
    done = subprocess.run(
        [
            *(chromium, "--headless", "--no-sandbox", "--disable-gpu", "--enable-logging=stderr"),
            *("--virtual-time-budget=8000", "--window-size=1000,2000"),
            f"--blink-settings=preferredColorScheme={scheme}",
            f"--user-data-dir={tmp_path / 'profile'}",
            *(f"--screenshot={shot}", page.as_uri()),
        ],
        capture_output=True,
        text=True,
        check=False,
    )
    said = [line for line in done.stderr.splitlines() if "CONSOLE" in line]
    assert said == []  # what the page's policy refuses
    pixels = np.asarray(Image.open(shot).convert("RGB")).astype(int)
    assert tuple(pixels[1990, 5]) == background
    drawn = (np.abs(pixels - CURVES[scheme]).max(axis=2) < 8).sum()
    assert drawn > 500  # the curve of joint 2, over most of the page's width
