"""Finds the source line where a user would change a model element: the XML tag by name."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence


def line_of(
    texts: Mapping[str, str], names: Sequence[str], attribute: str, tags: str
) -> tuple[str, str] | None:
    """Return file and line of the first XML tag with one of the names, and the attribute's text.

    The text is empty if the tag does not have the attribute. None if no tag matches.

    Parameters
    ----------
    texts
        Texts of the model files, by file name.
    names
        Names of model elements, in order of preference.
    attribute
        Name of the XML attribute to look for.
    tags
        Regular expression of the tag names that such elements can have.
    """
    for name in names:
        for path, at, tag in _tags(texts, name, tags):
            given = re.search(rf"""\b{attribute}\s*=\s*(["'])(.*?)\1""", tag)
            place = at if given is None else at + tag[: given.start()].count("\n")
            return f"{path}:{place}", "" if given is None else f'{attribute}="{given[2]}"'
    return None


def _tags(texts: Mapping[str, str], name: str, tags: str) -> Iterator[tuple[str, int, str]]:
    """Yield the XML tags with a name: file, line number, and text of the tag."""
    named = re.compile(rf"""<(?:{tags})\s[^<>]*?\bname\s*=\s*(["']){re.escape(name)}\1[^<>]*>""")
    for file, text in texts.items():
        for found in named.finditer(text):
            yield file, text.count("\n", 0, found.start()) + 1, found[0]
