"""The walkthrough is true: its commands print what it shows, and draw its pictures."""

from __future__ import annotations

import platform
import re
from pathlib import Path

import pytest
from generators import walkthrough
from generators.walkthrough import DOCS, PAGES, alike, blocks, pictures
from regenerate import is_current

from pipeline import Scenario, render, simulate
from pipeline.physics.bullet_law import EXACT_MACHINES

AGAIN = "a document has become old; make it again with: python docs/regenerate.py"


@pytest.fixture(scope="module")
def made() -> dict[Path, bytes]:
    return walkthrough.made()


@pytest.mark.skipif(
    platform.machine() not in EXACT_MACHINES, reason="the rounding shown is that of x86-64"
)
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_what_a_block_shows_is_what_its_commands_print(page: Path, made: dict[Path, bytes]) -> None:
    assert page.read_text(encoding="utf-8") == made[page].decode(), AGAIN


def test_the_pictures_are_those_that_the_commands_draw(made: dict[Path, bytes]) -> None:
    drawn = [path for path in made if path not in PAGES]
    assert len(drawn) == 6
    for path in drawn:
        assert is_current(path, made[path]), f"{path.name}: {AGAIN}"
        assert path.stat().st_size < (300_000 if path.suffix == ".webp" else 60_000)


def test_every_page_has_the_same_commands_and_pictures() -> None:
    first, *others = (page.read_text(encoding="utf-8") for page in PAGES)
    assert len(blocks(first)) > 10
    for other in others:
        assert blocks(other) == blocks(first)
        assert pictures(other) == pictures(first)


def test_no_picture_is_left_behind() -> None:
    wanted = {Path(one).name for one in pictures(PAGES[0].read_text(encoding="utf-8"))}
    assert {path.name for path in (DOCS / "images/walkthrough").iterdir()} <= wanted


def test_a_page_leads_on_to_pages_that_exist() -> None:
    for page in [*PAGES, DOCS.parent / "README.md", DOCS.parent / "README.ja.md"]:
        for link in re.findall(r"\]\((?!https?:)([^)#]+)\)", page.read_text(encoding="utf-8")):
            assert (page.parent / link).exists(), f"{page.name}: {link}"


# -- the check itself -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("shown", "expected"),
    [
        (["a 1", "b 2", "c 3"], ["a 1", "b 2", "c 4"]),
        (["a 1", "…"], ["a 1", "…"]),
        (["…", "b 2", "…"], ["…", "b 2", "…"]),
        (["…", "c 3"], ["…", "c 4"]),
        (["a 1"], ["a 1", "b 2", "c 4"]),
        (["wrong", "…"], ["a 1", "…"]),
        ([], ["a 1", "b 2", "c 4"]),
    ],
    ids=["whole", "beginning", "middle", "end", "cut without saying so", "wrong", "new"],
)
def test_what_is_shown_is_cut_where_it_was_but_never_kept_where_it_is_wrong(
    shown: list[str], expected: list[str]
) -> None:
    assert walkthrough.cut_alike(shown, ["a 1", "b 2", "c 4"]) == expected


def test_only_size_and_time_of_a_recording_may_be_others() -> None:
    line = "recording        run.rrd   241 samples, 41 frames, 394 kB, 1.2 s"
    slower = line.replace("394 kB, 1.2 s", "1,401 kB, 10.0 s")
    assert walkthrough.cut_alike([line], [slower]) == [line]
    more = line.replace("241", "242")
    assert walkthrough.cut_alike([line], [more]) == [more]


def test_a_lower_bounce_is_another_picture(tmp_path: Path) -> None:
    drawn = []
    for erp in (None, 0.0):
        path = tmp_path / f"{erp}.rrd"
        scenario = Scenario(restitution=0.8, duration_s=2, contact_erp=erp)
        simulate(scenario, path, camera=None)
        drawn.append(render(path).plot.read_bytes())
    assert not alike(*drawn)
    assert not alike(drawn[0], (DOCS / "images/run.gif").read_bytes())


# -- the Japanese README --------------------------------------------------------------------------


def test_the_japanese_readme_shows_the_same_commands_options_and_pictures() -> None:
    english, japanese = (
        (DOCS.parent / name).read_text(encoding="utf-8") for name in ("README.md", "README.ja.md")
    )
    for found in (
        r"^```.*?^```$",  # what is typed and printed
        r"^\| (.*?) \|",  # the options
        r"!\[.*?\]\((.*?)\)",  # the pictures
        r"src(?:set)?=\"(.*?)\"",
    ):
        assert _without_words(found, japanese) == _without_words(found, english)


def _without_words(pattern: str, text: str) -> list[str]:
    """Return what a pattern finds, without comments and the words at the head of a table."""
    found = re.findall(pattern, text, re.DOTALL | re.MULTILINE)
    return [re.sub(r" +# .*| *オプション|^option$", "", one) for one in found]
