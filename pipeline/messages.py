"""Messages to the reader: English text that remembers its template, so that it can be translated.

JSON and recordings hold the English text, whatever the reader's language; what a terminal shows
goes through `translated`.
"""

from __future__ import annotations

import functools
import gettext
import os
import shlex
from collections.abc import Iterable
from pathlib import Path
from typing import Self

LOCALE = Path(__file__).parent / "locale"
"""Where the translations are: `LANGUAGE/LC_MESSAGES/drop.mo`, compiled from `drop.po`."""


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
        return joined("", [self, other])

    def __radd__(self, other: str) -> Message:
        return joined("", [other, self])


def joined(separator: str, parts: Iterable[str]) -> Message:
    """Return messages and texts as one message, with a separator between them."""
    values = {f"part{number}": part for number, part in enumerate(parts)}
    return Message(separator.join(f"{{{name}}}" for name in values), **values)


def translated(text: str) -> str:
    """Return a message in the reader's language; English where there is no translation."""
    if not isinstance(text, Message):
        return text
    template = _catalog().gettext(text.template)
    if not text.values:
        return template
    return template.format_map(
        {name: translated(v) if isinstance(v, str) else v for name, v in text.values.items()}
    )


def shell_command(*words: str | Path) -> str:
    """Return a command as it can be pasted into a shell, bash or zsh.

    A file whose name begins with a dash is given as `./-NAME`, so that it is no option. What a line
    of ours does not keep, such as a newline or two spaces, is written in the escapes of `$'…'`.
    """
    texts = [
        f"./{word}" if isinstance(word, Path) and str(word).startswith("-") else str(word)
        for word in words
    ]
    return " ".join(map(_quoted, texts))


def _quoted(word: str) -> str:
    if word.isprintable() and "  " not in word:
        return shlex.quote(word)
    pairs = zip(" " + word, word, strict=False)
    escaped = [_escaped(letter, after_space=before == " ") for before, letter in pairs]
    return f"$'{''.join(escaped)}'"


def _escaped(character: str, *, after_space: bool) -> str:
    code = ord(character)
    if character in "\\'":
        return f"\\{character}"
    if character in "\n\t":
        return repr(character)[1:-1]
    if character.isprintable() and not (character == " " and after_space):
        return character
    if 0xDC80 <= code <= 0xDCFF:  # a byte that is not UTF-8
        return f"\\x{code - 0xDC00:02x}"
    if code < 0x80:
        return f"\\x{code:02x}"
    return f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"


@functools.cache
def _catalog() -> gettext.NullTranslations:
    """Return the translations for `DROP_LANG`, else for what the locale's variables name."""
    language = os.environ.get("DROP_LANG")
    languages = [language] if language else None
    return gettext.translation("drop", LOCALE, languages, fallback=True)
