"""The documentation's commands work, and print what the pages show."""

from __future__ import annotations

import platform
import re
import tomllib
from itertools import chain
from pathlib import Path

import numpy as np
import pytest
from drop_physics import Scenario, render, simulate
from drop_physics.physics.base import EXACT_MACHINES
from generators import pages, readme
from generators.pages import (
    DOCS,
    PIPELINE,
    ROOT,
    WALKTHROUGH,
    Block,
    PageError,
    blocks,
    pictures,
)
from generators.pictures import alike
from generators.typed import INSTEAD, PROGRAMS
from PIL import Image
from regenerate import is_current

pytestmark = pytest.mark.long
README, DROP = ROOT / "README.md", DOCS / "drop.md"
AGAIN = "a page is stale; make it again with: python docs/regenerate.py"
PAGES = pages.pages()
TRANSLATED = [page for page in PAGES if pages.translations(page)]


def text_of(page: Path) -> str:
    return page.read_text(encoding="utf-8")


def prose_of(page: Path) -> str:
    """Return a page's text without its code blocks."""
    return re.sub(r"^```.*?^```$", "", text_of(page), flags=re.DOTALL | re.MULTILINE)


@pytest.mark.parametrize(
    "page",
    [pytest.param(page, id=page.relative_to(ROOT).as_posix()) for page in PAGES],
)
def test_what_a_page_says_to_type_works_prints_what_it_shows_and_draws_its_pictures(
    page: Path,
) -> None:
    made = pages.played(page)
    drawn = [path for path in made if path.suffix != ".md"]
    assert len(drawn) == {WALKTHROUGH: 5, PIPELINE: 2}.get(page, 0)
    for path in drawn:
        assert is_current(path, made[path]), f"{path.name}: {AGAIN}"
        assert path.stat().st_size < {".webp": 300_000, ".gif": 450_000}.get(path.suffix, 60_000)
    # The last digits shown are those of x86-64; elsewhere words, commands and layout are compared.
    compared = str if platform.machine() in EXACT_MACHINES else without_numbers
    for path in [page, *pages.translations(page)]:
        assert compared(text_of(path)) == compared(made[path].decode()), AGAIN


def without_numbers(text: str) -> str:
    """Replace numbers in a text by `#`, and join its lines."""
    return " ".join(re.sub(r"[+−-]?\d[\d.,]*(?:e[+-]?\d+)?", "#", text).split())


def test_pages_are_compared_without_numbers_where_these_differ() -> None:
    assert without_numbers("ends  0.89 rad off,\n1.2e-05 m") == without_numbers(
        "ends 0.9 rad off, 1e-5 m"
    )
    assert without_numbers("ends 0.89 rad off") != without_numbers("ends 0.89 m off")


def test_the_pictures_of_the_readme_are_what_its_commands_draw() -> None:
    made = readme.made()
    for path, picture in made.items():
        assert is_current(path, picture), f"{path.name}: {AGAIN}"
        assert path.stat().st_size < 500_000
    for both in ((README, DROP), *zip(*map(pages.translations, (README, DROP)), strict=True)):
        mine, film = (text_of(page).replace("docs/images/", "images/") for page in both)
        # Of a light picture and a dark one, which a browser takes, the dark one comes first.
        assert pictures(mine)[0] == "images/arm-dark.gif"
        assert pictures(film) == ["images/film-dark.gif", "images/film.gif"]
        shown = {Path(one).name for one in pictures(mine) + pictures(film)}
        assert shown == {path.name for path in made}
        assert all(command in film for command in readme.FILM)


def test_the_box_of_a_film_is_large_and_seen_to_fall() -> None:
    """The box is the only dark blue object: its position and width are measured."""
    with Image.open(DOCS / "images/film.gif") as film:
        rows = []
        for number in range(film.n_frames):
            film.seek(number)
            rgb = np.asarray(film.convert("RGB"), dtype=int)[:300, :400]
            box = np.argwhere(rgb[..., 2] - rgb[..., 0] > 80)
            assert np.ptp(box[:, 1]) > 45
            rows.append(float(box[:, 0].mean()))
    assert len(rows) > 20
    fall = np.diff(rows[:14])  # up to 0.43 s
    assert (fall > 0).all()
    assert fall.sum() > 120


def test_a_translation_has_the_blocks_and_pictures_of_its_page() -> None:
    assert {page.name for page in TRANSLATED} == {"README.md", "drop.md", "walkthrough.md"}
    for page in TRANSLATED:
        mine = text_of(page)
        for theirs in map(text_of, pages.translations(page)):
            assert [_typed(one) for one in blocks(theirs)] == [_typed(one) for one in blocks(mine)]
            for pattern in (
                r"!\[.*?\]\((.*?)\)",  # the pictures
                r"src(?:set)?=\"(.*?)\"",
            ):
                found = re.compile(pattern, re.MULTILINE).findall
                assert found(theirs) == found(mine)


def _typed(block: Block) -> tuple[str, str]:
    """Return a block's kind and its input, without comments."""
    return block.kind, re.sub(r" +# .*", "", pages.typed(block))


def test_a_translation_shows_what_is_printed_in_its_language() -> None:
    for page in TRANSLATED:
        for other in pages.translations(page):
            shown = [block.text for block in blocks(text_of(other)) if block.quotes]
            assert shown
            # A block may quote nothing but what no language changes, as a name of a file.
            assert len([one for one in shown if re.search("[ぁ-ヺ一-龥]", one)]) > len(shown) / 2


def test_no_picture_is_left_behind() -> None:
    wanted = {Path(one).name for one in pictures(text_of(WALKTHROUGH))}
    assert {path.name for path in (DOCS / "images/walkthrough").iterdir()} <= wanted


def test_a_page_leads_on_to_pages_that_exist() -> None:
    for page in [*PAGES, *chain(*map(pages.translations, TRANSLATED))]:
        for link in re.findall(r"\]\((?!https?:)([^)#]+)\)", prose_of(page)):
            assert (page.parent / link).exists(), f"{page.name}: {link}"


# -- what is not run as it stands -----------------------------------------------------------------


def typed() -> str:
    """Return all input of the pages for which no output is quoted."""
    every = (block for page in PAGES for block in blocks(text_of(page)))
    return "".join(block.text for block in every if not block.quotes)


def test_every_page_is_looked_at_and_every_block_is_fenced() -> None:
    assert {"README.md", "ci.md", "walkthrough.md"} <= {page.name for page in PAGES}
    for page in PAGES:
        assert re.findall(r"\n\n    \S.*", prose_of(page)) == [], page.name


@pytest.mark.parametrize("program", PROGRAMS)
def test_every_program_that_is_replaced_is_on_a_page(program: str) -> None:
    assert re.search(rf"(^|[ (]){re.escape(program)}\b", typed(), re.MULTILINE)


@pytest.mark.parametrize("pattern", [pattern for pattern, *_ in INSTEAD])
def test_every_replacement_is_needed_by_a_page(pattern: str) -> None:
    assert re.search(pattern, typed(), re.MULTILINE)


def test_every_extra_that_a_page_names_exists() -> None:
    extras = tomllib.loads(text_of(ROOT / "pyproject.toml"))["project"]["optional-dependencies"]
    texts = [text_of(page) for page in [*PAGES, *DOCS.rglob("*.ja.md"), ROOT / "README.ja.md"]]
    named = {
        extra
        for text in texts
        for found in re.findall(r"'(?:\.|drop-physics)\[(.*?)\]'|--extra (\w+)", text)
        for extra in ",".join(found).split(",")
        if extra
    }
    assert named == {"ray", "docs", "test", "dev", "notebook", "mp4", "pybullet"}
    assert named <= set(extras)


def test_the_tests_that_the_table_of_promises_names_exist() -> None:
    """A row that gives only `-k` refers to the last file named before it."""
    file, checked = "", 0
    for row in re.findall(r"^\| .* \|$", text_of(DOCS / "reliability.md"), re.MULTILINE):
        for named, *words in re.findall(r"pytest (tests/\w+\.py)|-k (?:\"([\w ]+)\"|(\w+))", row):
            file = named or file
            tests = re.findall(r"^def (test_\w+)", text_of(ROOT / file), re.MULTILINE)
            for word in filter(None, "".join(words).split(" or ")):
                assert any(word in test for test in tests), f"{file} -k {word}"
                checked += 1
    assert checked > 15


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
    assert pages.cut_alike(shown, ["a 1", "b 2", "c 4"]) == expected


def test_only_size_and_time_of_a_recording_may_be_others() -> None:
    line = "recording        run.rrd   241 samples, 41 frames, 394 kB, 1.2 s"
    slower = line.replace("394 kB, 1.2 s", "1.40 MB, 10.0 s")
    assert pages.cut_alike([line], [slower]) == [line]
    assert pages.cut_alike(["記録 394 kB、1.2 s"], ["記録 401 kB、3.0 s"]) == ["記録 394 kB、1.2 s"]
    more = line.replace("241", "242")
    assert pages.cut_alike([line], [more]) == [more]


def test_a_lower_bounce_is_another_picture(tmp_path: Path) -> None:
    drawn = []
    for erp in (None, 0.0):
        path = tmp_path / f"{erp}.rrd"
        scenario = Scenario(restitution=0.8, duration_s=2, contact_erp=erp)
        simulate(scenario, path, camera=None)
        drawn.append(render(path).plot.read_bytes())
    assert not alike(*drawn)
    assert not alike(drawn[0], (DOCS / "images/run.gif").read_bytes())


@pytest.mark.parametrize(
    ("block", "said"),
    [
        (Block("sh", "drop analyze missing.rrd\n"), "`drop analyze missing.rrd` exits with 1"),
        (Block("sh", "true\nfalse # really\n"), "`false # really` exits with 1"),
        (Block("console", "$ drop simulate --out a.rrd --higth 2\n"), "exits with 2"),
        (Block("yaml", "    - run: drop check a.rrd --against b.rrd\n"), "exits with 1"),
        (Block("json", "{}\n"), "a block cannot be of kind 'json'"),
    ],
    ids=lambda given: given.kind if isinstance(given, Block) else "",
)
def test_a_page_that_does_not_work_is_noticed(block: Block, said: str, tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(f"# A page\n\n```{block.kind}\n{block.text}```\n")
    with pytest.raises(PageError, match=re.escape(said)):
        pages.played(page)


def test_what_a_program_prints_is_put_where_it_is_quoted(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("```python\nprint(1)\nprint(2)\n```\nprints\n\n```text\n0\n…\n```\n")
    made = pages.played(page)
    assert made[page].decode().endswith("```text\n1\n…\n```\n")


def test_lines_that_belong_together_are_one_command() -> None:
    loop = "for one in 1 2; do\n  echo $one\ndone"
    assert pages.commands(f"{loop}\necho a \\\n    b\n\ntrue # c\n") == [
        loop,
        "echo a \\\n    b",
        "true # c",
    ]
