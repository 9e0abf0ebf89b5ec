"""Calls as rows of numbers: what a script's line passes is the same form again and again.

A site is a place that calls a function with arguments of one form. It is described once; from then
on a call from there is its number and the numbers in its arguments.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from struct import Struct
from typing import Any

from .arguments import ARGUMENTS, CLIENT
from .pipe import CALL, CALL_HEAD, HEADER, NOTE, Pipe, encoded, frame

LONGEST = 32
"""Most values of a list that are reported; of a longer one the first, and their number."""
MOST_WHOLE = 1 << 53
"""Whole numbers up to here are the same as doubles."""
MOST_PLANS = 4096
"""Of places; beyond, all are made again."""
OURS = os.path.dirname(os.path.abspath(__file__)) + os.sep

Plan = tuple[
    list[type], list[str], bytes, Callable[..., bytes], int, list[tuple[int, int, Any]], list[type],
]  # fmt: skip
"""How to send a call with arguments of some types and some names: what comes before its numbers,
what packs these, how many bytes that makes, what to do to arguments that are no numbers, and the
types of the numbers."""
MOST_FORMS = 8
"""Of calls from one place, that are planned."""

AS_LIST, SPREAD, VALUE, CONSTANT, LEFT_OUT = range(5)
"""How an argument becomes numbers: an array, a list, a scalar of numpy; or has none."""


class Calls:
    """Sends calls, and describes their sites."""

    def __init__(self, pipe: Pipe) -> None:
        self._pipe = pipe
        self._plans: dict[str, dict[tuple[int, int, int], list[Plan]]] = {}
        self._codes: list[Any] = []
        """The code of places with a plan, so that none is replaced by another at its address."""
        self._sites: dict[tuple[Any, ...], int] = {}
        self._shown: dict[str, str] = {}

    def plans(self, name: str) -> dict[tuple[int, int, int], list[Plan]]:
        """Return how to send calls of a function that are like earlier ones; `tell` adds to it.

        By code, instruction, and number of the simulation.
        """
        return self._plans.setdefault(name, {})

    def tell(
        self, world: int, name: str, args: tuple[Any, ...], kwargs: dict[str, Any], place: Any
    ) -> None:
        """Send a call that is made in a frame, and plan how to send the next one of its form."""
        form, caller = Form(name, args, kwargs), place
        while caller.f_back is not None and caller.f_code.co_filename.startswith(OURS):
            caller = caller.f_back  # another recording within this one
        code = caller.f_code
        described = (
            name, code.co_filename, caller.f_lineno, caller.f_lasti, form.text, *form.names,
            *form.whole,
        )  # fmt: skip
        site = self._sites.get(described)
        if site is None:
            site = self._sites[described] = len(self._sites)
            file, line = self.place(caller)
            note = {
                "what": "site", "number": site, "function": name, "file": file, "line": line,
                "form": form.text, "names": form.names, "whole": form.whole,
            }  # fmt: skip
            self._pipe.write(frame(NOTE, encoded(note)))
        numbers = Struct(f"<{len(form.numbers)}d")
        head = HEADER.pack(CALL, CALL_HEAD.size + numbers.size) + CALL_HEAD.pack(world, site)
        self._pipe.write(head + numbers.pack(*form.numbers))
        fixes = fixes_of(args, kwargs)
        if fixes is None or caller is not place:
            return
        if len(self._codes) >= MOST_PLANS:
            self._codes = []
            for of_function in self._plans.values():
                of_function.clear()
        plans = self.plans(name).setdefault((id(code), place.f_lasti, world), [])
        if len(plans) >= MOST_FORMS:
            plans.clear()
        types = [*map(type, (*args, *kwargs.values()))]
        kinds: list[type] = [int if whole else float for whole in form.whole]
        size = len(head) + numbers.size
        plans.insert(0, (types, [*kwargs], head, numbers.pack, size, fixes, kinds))
        self._codes.append(code)

    def place(self, place: Any) -> tuple[str, int]:
        """Return file and line of a frame, the file without folders of this machine."""
        name = place.f_code.co_filename
        shown = self._shown.get(name)
        if shown is None:
            shown = self._shown[name] = _shown(name)
        return shown, place.f_lineno


def fixes_of(args: tuple[Any, ...], kwargs: dict[str, Any]) -> list[tuple[int, int, Any]] | None:
    """Return what to do to become numbers with arguments that are none, the last first.

    None if it cannot be told from their types.
    """
    fixes: list[tuple[int, int, Any]] = []
    names = [None] * len(args) + list(kwargs)
    for at, value in enumerate((*args, *kwargs.values())):
        kind = type(value)
        if names[at] == CLIENT:
            fixes.append((at, LEFT_OUT, None))
        elif kind is int or kind is float:
            continue
        elif value is None or kind in (bool, str, bytes):
            fixes.append((at, CONSTANT, value))
        elif kind in (list, tuple, range) and len(value) <= LONGEST:
            if not {int, float}.issuperset(map(type, value)):
                return None
            fixes.append((at, SPREAD, len(value)))
        elif _is_numpy(kind) and value.ndim < 2 and value.size <= LONGEST:
            if not {int, float}.issuperset(map(type, value.ravel().tolist())):
                return None
            fixes.append((at, AS_LIST if value.ndim else VALUE, value.size))
        else:
            return None
    return fixes[::-1]


def fixed(values: Any, fixes: list[tuple[int, int, Any]], types: list[type]) -> Any:
    """Return the numbers in the arguments of a call; None if it has another form than planned."""
    values = [*values]
    for at, how, expected in fixes:
        value = values[at]
        if how == LEFT_OUT:
            del values[at]
        elif how == CONSTANT:
            if value is not expected:
                return None
            del values[at]
        elif how == VALUE:
            values[at] = value.tolist()
        else:
            if len(value) != expected or (how == AS_LIST and value.ndim != 1):
                return None
            values[at : at + 1] = value if how == SPREAD else value.tolist()
    return values if [*map(type, values)] == types else None


class Form:
    """The arguments of a call, as a script would write them, apart from the numbers in them."""

    def __init__(self, name: str, args: tuple[Any, ...], kwargs: dict[str, Any]) -> None:
        self.numbers: list[float] = []
        self.whole: list[bool] = []
        self.names: list[str] = []
        """The argument of each number."""
        known = ARGUMENTS.get(name, [])
        texts = []
        for at, value in enumerate(args):
            texts.append(self._text(value))
            self._named(known[at] if at < len(known) else "")
        for key, value in kwargs.items():
            if key != CLIENT:
                texts.append(f"{_escaped(key)}={self._text(value)}")
                self._named(key)
        self.text = ", ".join(texts)

    def _named(self, name: str) -> None:
        self.names += [name] * (len(self.numbers) - len(self.names))

    def _number(self, value: float, *, whole: bool) -> str:
        self.numbers.append(value)
        self.whole.append(whole)
        return "{}"

    def _text(self, value: Any, depth: int = 0) -> str:
        """Return a value's text, without calling any code of the script."""
        kind = type(value)
        if value is None or kind is bool:
            return repr(value)
        if kind in (str, bytes):
            return _escaped(repr(value if len(value) <= 300 else value[:300]))
        if _is_numpy(kind):
            few = value if value.size <= 1024 else value.ravel()[:1024]
            return self._text(few.tolist(), depth)
        if issubclass(kind, int):
            value = int.__pos__(value)
            if abs(value) <= MOST_WHOLE:
                return self._number(value, whole=True)
            return repr(value) if value.bit_length() < 4000 else "<int>"
        if issubclass(kind, float):
            return self._number(float.__pos__(value), whole=False)
        if issubclass(kind, (list, tuple, range)) and depth < 4:
            its: Any = tuple if issubclass(kind, tuple) else range if kind is range else list
            count = its.__len__(value)
            few = its.__getitem__(value, slice(LONGEST))
            texts = [self._text(item, depth + 1) for item in few]
            if count > LONGEST:
                texts.append(f"… {count} values")
            return f"({', '.join(texts)})" if its is tuple else f"[{', '.join(texts)}]"
        return _escaped(f"<{kind.__name__}>")


def _is_numpy(kind: type) -> bool:
    return kind.__module__.partition(".")[0] == "numpy" and hasattr(kind, "tolist")


def _escaped(text: str) -> str:
    """Return a text as it stands in a form: only `{}` is a number."""
    return text.replace("{", "{{").replace("}", "}}")


def _shown(name: str) -> str:
    """Return a file's name, relative to the working directory or the module path."""
    try:
        here = os.getcwd()
    except OSError:  # it was removed
        here = ""
    for folder in (here, *sorted(sys.path, key=len, reverse=True)):
        if folder and name.startswith(os.path.join(folder, "")):
            return os.path.relpath(name, folder)
    return os.path.basename(name) or name
