"""Messages to the reader: English text that remembers its template, so that it can be translated.

JSON and recordings hold the English text, whatever the reader's language; what a terminal shows
goes through `translated`.
"""

from __future__ import annotations

import functools
import gettext
import itertools
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Self

LOCALE = Path(__file__).parent / "locale"
"""Where the translations are: `LANGUAGE/LC_MESSAGES/drop.mo`, compiled from `drop.po`."""
VARIABLES = ("DROP_LANG", "LANGUAGE", "LC_ALL", "LC_MESSAGES", "LANG")
"""The environment's, which name the reader's language; the first that is set counts."""

_NOTHING = ""  # not written below, where it would be taken for a message


class Message(str):
    """English text, made of a template and the values it names, as `str.format` does.

    Without values a template is the text itself, braces and all. Values may be messages too.
    Whatever is added to a message, before or after it, makes a longer message.
    """

    __slots__ = ("template", "values")
    template: str
    values: dict[str, object]

    def __new__(cls, template: str, /, **values: object) -> Self:
        """Fill the values into the template."""
        message = super().__new__(cls, template.format_map(values) if values else template)
        message.template, message.values = template, values
        return message

    def __getnewargs_ex__(self) -> tuple[tuple[str], dict[str, object]]:
        return (self.template,), self.values

    def __add__(self, other: str) -> Message:
        return joined(_NOTHING, [self, other])

    def __radd__(self, other: str) -> Message:
        return joined(_NOTHING, [other, self])


def joined(separator: str, parts: Iterable[str]) -> Message:
    """Return messages and texts as one message, with a separator between them."""
    values: dict[str, str] = {f"part{number}": part for number, part in enumerate(parts)}
    template = "{separator}".join(f"{{{name}}}" for name in values)
    return Message(template, separator=Message(separator), **values)


def translated(text: str) -> str:
    """Return a message in the reader's language; English where there is no translation."""
    catalog = _catalog(*map(os.environ.get, VARIABLES))
    if not isinstance(text, Message) or type(catalog) is gettext.NullTranslations:
        return text
    # Of no template at all gettext returns the head of its file.
    template = catalog.gettext(text.template) if text.template else ""
    if not text.values:
        return template if template != text.template else str(text)
    return template.format_map(
        {name: translated(v) if isinstance(v, str) else v for name, v in text.values.items()}
    )


def localized(template: str, /, **values: object) -> str:
    """Return a message in the reader's language at once, for what is only ever shown."""
    return translated(Message(template, **values))


@functools.cache
def _catalog(*variables: str | None) -> gettext.NullTranslations:
    """Return the translations for the first of some variables that is set, as gettext reads it."""
    languages = next(filter(None, variables), "").split(":")
    # English needs no file: what a reader understands less comes after it.
    wanted = itertools.takewhile(lambda language: not language.startswith("en"), languages)
    return gettext.translation("drop", LOCALE, list(wanted), fallback=True)
