"""The tables of `json.md` on the site: a row per key of each schema, and a row per finding code."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

LINK = re.compile(r"^Schema: \[(\w+)\.json\]\(.*\)$", re.MULTILINE)
"""A line of the page that a schema's table is inserted below."""
CODES = "`drop explain --list` prints them.\n"
"""The line of the page that the table of codes is inserted below."""


def filled(page: str, schemas: Path) -> str:
    """Return the page with a table below each link to a schema, and a table of all codes."""
    from drop_physics.drop.findings import ALL_RULES
    from drop_physics.rules.reference import references

    def with_table(link: re.Match[str]) -> str:
        schema = json.loads((schemas / f"{link[1]}.json").read_text(encoding="utf-8"))
        head = "| key | | type | what it is |\n| --- | --- | --- | --- |"
        return "\n".join([link[0], "", head, *_rows(schema)])

    codes = "".join(
        f"| `{each.code}` | {each.reason_of or ''} | {each.level or ''} | {each.meaning} |\n"
        for each in references(ALL_RULES).values()
    )
    head = "| code | reason of | level | what it means |\n| --- | --- | --- | --- |"
    return LINK.sub(with_table, page).replace(CODES, f"{CODES}\n{head}\n{codes}")


def _rows(schema: dict[str, Any], before: str = "") -> Iterator[str]:
    """Yield a table row for each key of an object, followed by the keys of nested objects."""
    for name, value in schema["properties"].items():
        path = f"{before}{name}"
        inner, words, mark = value, _words(value), "•" if name in schema.get("required", ()) else ""
        if "items" in value:
            inner, path = value["items"], f"{path}[]"
            words = words.replace("array", _words(inner))
        yield f"| `{path}` | {mark} | {words} | {value.get('description', '')} |"
        if "properties" in inner:
            yield from _rows(inner, f"{path}.")
    if isinstance(more := schema.get("additionalProperties"), dict):
        yield f"| `{before}…` | | any | {more['description']} |"


def _words(schema: dict[str, Any]) -> str:
    if "enum" in schema:
        return " or ".join(f"`{json.dumps(value)}`" for value in schema["enum"])
    kinds = schema.get("type", "any")
    return " or ".join(kinds) if isinstance(kinds, list) else str(kinds)
