"""The pages build to one site, in which links and images resolve and nothing is fetched."""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from html.parser import HTMLParser
from itertools import chain
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

ROOT = Path(__file__).parents[1]
PAGES = [
    path.relative_to(ROOT).with_suffix("")
    for folder in (ROOT, ROOT / "docs", ROOT / "recordings", ROOT / "skills/drop")
    for path in folder.glob("*.md")
]
JAPANESE = {"README.ja", "docs/drop.ja", "docs/walkthrough.ja"}
pytestmark = [
    pytest.mark.long,
    *(pytest.mark.needs(module) for module in ("sphinx", "myst_parser", "furo")),
]


def build(clone: Path, site: Path) -> subprocess.CompletedProcess[str]:
    """Build the site of a clone by the instructions for contributors."""
    page = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    (typed,) = re.findall(r"^sphinx-build (.*) build/site$", page, re.MULTILINE)
    arguments = [sys.executable, "-P", "-m", "sphinx", *shlex.split(typed), site]
    return subprocess.run(
        arguments,
        cwd=clone,
        env=os.environ | {"LC_ALL": "C.UTF-8"},
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    done = build(ROOT, folder)
    assert done.returncode == 0, done.stderr
    assert done.stdout + done.stderr == ""
    return folder


class Links(HTMLParser):
    """A page's links (`href` of an `a`), and its elements."""

    def __init__(self, page: Path) -> None:
        super().__init__()
        self.language = ""
        self.leads_to: list[str] = []
        self.made_of: list[str] = []
        self.feed(page.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Collect the addresses in a tag."""
        given = {name: value or "" for name, value in attrs}
        if tag == "html":
            self.language = given["lang"]
        if tag == "a" and "href" in given:
            self.leads_to.append(given["href"])
        elif tag != "a":
            names = ("href", "src", "srcset", "poster", "data", "action")
            self.made_of += [given[name] for name in names if name in given]


def test_there_is_a_page_of_every_page_in_its_language(site: Path) -> None:
    assert {"README", "docs/json", *JAPANESE} < {page.as_posix() for page in PAGES}
    for page in PAGES:
        language = "ja" if page.as_posix() in JAPANESE else "en"
        assert Links(site / f"{page}.html").language == language
    assert (site / "index.html").read_bytes() == (site / "README.html").read_bytes()


def test_the_page_on_json_has_the_keys_and_the_codes(site: Path) -> None:
    """In a clone the page lacks them; they are in the schemas."""
    shown = (site / "docs/json.html").read_text(encoding="utf-8")
    for name in ("explained.until_s", "bodies[].mass_kg", "table[].…", "off-target", "ik-index"):
        assert f'<span class="pre">{name}</span>' in shown, name


def test_no_space_is_in_a_japanese_sentence_where_its_line_ends(site: Path) -> None:
    end = re.compile(r"[\u3000-\u9fff]\n[\u3000-\u9fff]")
    for page in JAPANESE:
        assert end.search((ROOT / f"{page}.md").read_text(encoding="utf-8"))
        assert not end.search((site / f"{page}.html").read_text(encoding="utf-8"))


def test_every_link_and_every_picture_of_the_site_is_there(site: Path) -> None:
    pictures = set()
    for page in site.rglob("*.html"):
        links = Links(page)
        assert [one for one in links.made_of if urlsplit(one).netloc] == [], page
        for link in [*links.leads_to, *links.made_of]:
            address = urlsplit(link)
            if not address.scheme and address.path:
                assert (page.parent / unquote(address.path)).is_file(), f"{page.name}: {link}"
        pictures |= {Path(urlsplit(one).path).name for one in links.made_of}
    drawn = {path.name for path in (ROOT / "docs/images").rglob("*.*")}
    assert "viewer.png" in drawn
    assert drawn <= pictures


def test_nothing_is_fetched_from_elsewhere(site: Path) -> None:
    """XML namespaces, and addresses in comments, are not fetched."""
    fetched = re.compile(
        r"""(?:@import|url\(|import\(|fetch\(|src=|\.src|importScripts)\W*(?:https?:)?//[\w.]+"""
    )
    for path in site.rglob("*"):
        if path.suffix in (".css", ".js", ".html"):
            assert fetched.findall(path.read_text(encoding="utf-8")) == [], path


def test_the_search_finds_words_of_both_languages(site: Path) -> None:
    text = (site / "searchindex.js").read_text(encoding="utf-8")
    index = json.loads(text.removeprefix("Search.setIndex(").removesuffix(")"))
    assert set(index["docnames"]) == {page.as_posix() for page in PAGES}

    def found(term: str) -> set[str]:
        pages = [index[where].get(term, []) for where in ("terms", "titleterms")]
        numbers = chain(*([one] if isinstance(one, int) else one for one in pages))
        return {index["docnames"][number] for number in numbers}

    assert {"README", "docs/walkthrough"} <= found("damp")
    assert found("減衰") == found("箱") == JAPANESE
    # A query is split as the texts are: `自由落下` is asked for as these three.
    assert found("自由") & found("由落") & found("落下") == JAPANESE
    assert found("砂袋") == {"docs/walkthrough.ja"}
    splitter = (site / "_static/language_data.js").read_text(encoding="utf-8")
    assert r"([\u3005-\u30ff\u3400-\u9fff]+)|[^\p{Letter}\p{Number}_]+" in splitter


def test_a_link_that_leads_nowhere_fails_and_so_does_a_missing_picture(tmp_path: Path) -> None:
    clone = tmp_path / "clone"
    shutil.copytree(ROOT / "docs", clone / "docs", ignore=shutil.ignore_patterns("viewer.png"))
    for page in PAGES:
        if page.parts[0] != "docs":
            (clone / page).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(ROOT / f"{page}.md", clone / f"{page}.md")
    with (clone / "docs/scale.md").open("a", encoding="utf-8") as file:
        file.write("\n[to a page](nowhere.md) [to a folder](schemas/) [to a part](ci.md#nothing)\n")
    (clone / "docs/alone.md").write_text("# Alone\n")
    done = build(clone, tmp_path / "site")
    assert done.returncode == 1
    for said in (
        "docs/scale.md:.*nowhere.md",
        "docs/scale.md:.*schemas/",
        "docs/scale.md:.*nothing",
        "docs/viewing.md:.*images/viewer.png",
        "docs/alone.md: WARNING: document isn't included in any toctree",
    ):
        assert re.search(said, done.stderr), f"{said}\n{done.stderr}"
