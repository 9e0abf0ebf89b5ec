"""The site of these pages: `sphinx-build -nW --keep-going -q -c docs . build/site`.

The clone itself is built, so that a link leads to the same page on the site as in the clone.
README.md, the first page of the newcomer's path, is the home page.
"""

from __future__ import annotations

import re
import shutil
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

sys.path.insert(0, str(Path(__file__).parent))

from docutils import nodes
from generators.schema_tables import filled
from pygments.lexers.special import TextLexer
from sphinx.search.en import SearchEnglish

if TYPE_CHECKING:
    from sphinx.application import Sphinx

project = html_title = "drop"
extensions = ["myst_parser"]
root_doc = "README"
include_patterns = ["*.md", "docs/*.md", "recordings/*.md", "skills/*/*.md"]
exclude_patterns = [".*", "build", "dist"]
myst_enable_extensions = ["attrs_inline"]
myst_heading_anchors = 3  # links to parts of pages, by the names that they have in a clone
smartquotes = False
html_theme = "furo"
html_copy_source = False
html_show_copyright = False
html_use_index = False
html_search_language = "en-ja"

_MENU = {
    "The path": ["docs/prove", "docs/diff", "docs/viewing", "docs/ci"],
    "Training, assistants": ["docs/training", "skills/drop/SKILL"],
    "Reference": [
        "docs/install", "docs/record", "docs/importing", "docs/why", "docs/mujoco",
        "docs/from_pybullet", "docs/trust", "docs/scale", "docs/commands", "docs/recording",
        "docs/json", "recordings/README", "docs/pipeline",
    ],
    "The falling box": ["docs/walkthrough", "docs/drop", "docs/engines"],
    "日本語": ["はじめに <README.ja>", "docs/walkthrough.ja", "docs/drop.ja"],
    "Reasons to believe it": ["docs/validation", "docs/reliability", "docs/performance"],
    "How it is built": ["docs/architecture", "CONTRIBUTING", "CHANGELOG"],
}  # fmt: skip

_TWO_THEMES = re.compile(
    r'<picture>\s*<source media="\(prefers-color-scheme: dark\)" srcset="(?P<dark>.*?)">\s*'
    r'<img alt="(?P<alt>.*?)" src="(?P<light>.*?)">\s*</picture>'
)
_JAPANESE = r"[\u3005-\u30ff\u3400-\u9fff]+"
_IS_JAPANESE = re.compile(r"[\u3000-\u9fff\uff00-\uffef]").match


class Search(SearchEnglish):
    """English by words; Japanese, which has no spaces, by one and two characters in a row."""

    lang = "en-ja"
    js_splitter_code = f"""
function splitQuery(query) {{
  return query
    .split(/({_JAPANESE})|[^\\p{{Letter}}\\p{{Number}}_]+/u)
    .filter((part) => part)
    .flatMap((part) => /{_JAPANESE}/u.test(part) && part.length > 1
      ? [...part].slice(1).map((character, at) => part[at] + character)
      : [part]);
}}
"""

    def split(self, input: str) -> list[str]:  # noqa: A002
        """Return what a text is found by; a query is split alike, into two in a row."""
        pieces = [
            run[at : at + length]
            for run in re.findall(_JAPANESE, input)
            for length in (1, 2)
            for at in range(len(run) - length + 1)
        ]
        return super().split(re.sub(_JAPANESE, " ", input)) + pieces


def read(_: Sphinx, page: str, text: list[str]) -> None:
    """Let a picture follow the site's theme; fill in the tables, and the home page's menu."""
    text[0] = _TWO_THEMES.sub(
        r"![\g<alt>](\g<light>){.only-light} ![\g<alt>](\g<dark>){.only-dark}", text[0]
    )
    if page == "docs/json":
        text[0] = filled(text[0], Path(__file__).with_name("schemas"))
    if page == root_doc:
        for caption, pages in _MENU.items():
            head = f"```{{toctree}}\n:hidden:\n:caption: {caption}\n"
            text[0] += "\n".join(["", head, *pages, "```", ""])


def join(_: Sphinx, page: nodes.document) -> None:
    """Let a Japanese sentence go on in its next line without a space, to read and to search."""
    for part in page.findall(nodes.TextElement):
        for at in range(1, len(part) - 1):
            before, between, after = (one.astext() for one in part[at - 1 : at + 2])
            if between == "\n" and _IS_JAPANESE(before[-1:]) and _IS_JAPANESE(after[:1]):
                part[at] = nodes.Text("")


def speak(_: Sphinx, page: str, _template: str, context: dict[str, Any], *_rest: object) -> None:
    """Say in which language a page is, for the browser and for those who are read to."""
    context["language"] = "ja" if page.endswith(".ja") else "en"


def open_at_home(app: Sphinx, error: Exception | None) -> None:
    """Let the site begin where a server and a reader look for it."""
    home = Path(app.outdir, f"{root_doc}.html")
    if error is None and home.exists():
        shutil.copyfile(home, home.with_name("index.html"))


def setup(app: Sphinx) -> None:
    """Tell Sphinx of all this."""
    app.add_search_language(Search)
    app.add_lexer("mermaid", TextLexer)
    app.connect("source-read", read)
    app.connect("doctree-read", join)
    app.connect("html-page-context", speak)
    app.connect("build-finished", open_at_home)
