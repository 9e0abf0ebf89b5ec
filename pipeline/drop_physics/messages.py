"""Messages to the user: English text that keeps its template, so that it can be translated.

JSON and recordings contain the English text, whatever the reader's language; terminals show the
result of `translated`.
"""

from __future__ import annotations

import functools
import gettext
import itertools
import os
import re
import shlex
import textwrap
import unicodedata
from collections.abc import Iterable
from pathlib import Path
from typing import Self

LOCALE = Path(__file__).parent / "locale"
"""Folder of the translations: `LANGUAGE/LC_MESSAGES/drop.mo`, compiled from `drop.po`."""
VARIABLES = ("DROP_LANG", "LANGUAGE", "LC_ALL", "LC_MESSAGES", "LANG")
"""Environment variables that name the user's language; the first one set is used."""

_NOTHING = ""  # not written below, where it would be taken for a message


class Message(str):
    """English text, made from a template and named values, as by `str.format`.

    A template without values is the text itself, including braces. Values may be messages, too.
    Adding text before or after a message gives a longer message.
    """

    __slots__ = ("template", "values")
    template: str
    values: dict[str, object]

    def __new__(cls, template: str, /, **values: object) -> Self:
        """Format the template with the values."""
        message = super().__new__(cls, template.format_map(values) if values else template)
        message.template, message.values = template, values
        return message

    def __reduce__(self) -> tuple[object, ...]:
        return _restored, (str(self), self.template, self.values)

    def __add__(self, other: str) -> Message:
        return joined(_NOTHING, [self, other])

    def __radd__(self, other: str) -> Message:
        return joined(_NOTHING, [other, self])


def _restored(text: str, template: str, values: dict[str, object]) -> Message:
    """Rebuild a copied or unpickled message; the template of a plural is its singular."""
    message = str.__new__(Message, text)
    message.template, message.values = template, values
    return message


def joined(separator: str, parts: Iterable[str]) -> Message:
    """Join messages and texts into one message, with a separator between them."""
    values: dict[str, str] = {f"part{number}": part for number, part in enumerate(parts)}
    template = "{separator}".join(f"{{{name}}}" for name in values)
    return Message(template, separator=Message(separator), **values)


def translated(text: str) -> str:
    """Translate a message into the user's language; without a translation it stays English."""
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
    """Format and translate a message at once, for text that is only displayed."""
    return translated(Message(template, **values))


def columns_of(text: str) -> int:
    """Return a text's display width in columns: Chinese and Japanese characters take two."""
    if text.isascii():
        return len(text)
    from rich.cells import cell_len  # takes a tenth of the time of `drop --help`

    return cell_len(text)


_JAPANESE = re.compile("[\u3040-\u30ff\u4e00-\u9fff]")
_WIDE, _KANJI, _UNIT = "\u2e80-\ua4cf\uff01-\uff60", "\u3005\u4e00-\u9fff", "A-Za-zµ°%²³/"
_KANA = "[ぁ-ゖ]+(?:込[ぁ-ゖ]+)?"  # めり込み is one word
_NUMBER = rf"[-+±]?\d[^\s{_WIDE}]* (?:[{_UNIT}]+(?: m[{_UNIT}]*)?|[ァ-ヺー]+|[{_KANJI}]+)"
_UNBROKEN = (
    rf"\s+|[「『（(]*(?:{_NUMBER}|[ァ-ヺー]+|[{_KANJI}]+|[^\s{_WIDE}]+(?<!\()|{_KANA}|.)"
    rf"(?: ?{_KANA})?[、。」』）)・ー…:]*"
)
"""Pattern of a Japanese phrase, a word and its particles, after which a line may break.

No line begins with `、` or ends with `「`, and a number stays with its unit.
"""


class _Part(str):
    __slots__ = ()

    def __len__(self) -> int:
        return columns_of(str(self))


class _Wrapper(textwrap.TextWrapper):
    """A text wrapper that breaks at spaces and between Japanese phrases, never inside a name."""

    def _split(self, text: str) -> list[str]:
        japanese = _JAPANESE.search(text) is not None
        parts = re.findall(_UNBROKEN, text) if japanese else super()._split(text)
        return [*map(_Part, parts)]


def wrapped(words: str, columns: int, indent: str = "") -> list[str]:
    """Wrap text to a display width in columns; all lines but the first are indented."""
    wrapper = _Wrapper(
        columns, subsequent_indent=indent, break_on_hyphens=False, break_long_words=False
    )
    return wrapper.wrap(words)


def harmless(text: str) -> str:
    """Escape, as in JSON, the characters that a terminal would interpret or hide.

    Names and texts may come from someone else's recording, and contain control characters, escape
    sequences, or marks that reverse the reading direction.
    """
    if text.isprintable():
        return text
    return "".join(
        letter if letter.isprintable() or unicodedata.category(letter) == "Zs" else _units(letter)
        for letter in text
    )


def _units(character: str) -> str:
    units = character.encode("utf-16-be", "surrogatepass").hex()
    return "".join(f"\\u{units[first : first + 4]}" for first in range(0, len(units), 4))


def shell_command(*words: str | Path) -> str:
    """Quote a command so that it can be pasted into a shell, bash or zsh.

    A file whose name begins with a dash is given as `./-NAME`, so that it does not look like an
    option. Characters that a printed line would not preserve, such as a newline or two spaces, are
    written as escapes in `$'…'`.
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
def _catalog(*variables: str | None) -> gettext.NullTranslations:
    """Return gettext's translations for the first of the given variables that is set."""
    languages = next(filter(None, variables), "").split(":")
    # English needs no file: what a reader understands less comes after it.
    wanted = itertools.takewhile(lambda language: not language.startswith("en"), languages)
    try:
        return gettext.translation("drop", LOCALE, list(wanted), fallback=True)
    except (MemoryError, OSError):  # which may be what there is to say
        return gettext.NullTranslations()
