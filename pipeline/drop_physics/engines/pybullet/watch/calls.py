"""Sends a script's calls compactly: as rows of numbers, after describing each call site once.

A call site is a script line that calls a function with arguments of one form. Its first call sends
a description; each further call sends only the site's number and the numbers in the arguments.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from struct import Struct
from typing import TYPE_CHECKING, Any

from ...watching.host import ScriptWatch
from ...watching.pipe import CALL, HEADER, NOTE, encoded, frame
from ...watching.sites import caller_of
from .arguments import CLIENT, CLIENT_AT, MODE_AT, UNNAMED, names_of

if TYPE_CHECKING:
    from .worlds import WatchedWorld

    Plan = tuple[
        WatchedWorld,
        int,
        list[str],
        Callable[..., Any] | None,
        Callable[..., None],
        int,
        int,
    ]
    """How to send a call from a place: its simulation; how many arguments it gives by place, and
    which by name; what returns the numbers in them (None if they are numbers); what packs these;
    how many bytes that makes; the site."""

LONGEST = 128
"""Largest number of list values that are reported; of a longer list, the first values and the
length are."""
MOST_WHOLE = 1 << 53
"""Largest integer that is exact as a double."""
MOST_PLANS = 4096
"""Largest number of call plans that are cached; beyond it, all are rebuilt."""


class CallWatch:
    """Sends calls, and describes the sites from which they are made."""

    def __init__(self, host: ScriptWatch) -> None:
        self._pipe, self._place = host.pipe, host.sites.place
        self._plans: dict[str, dict[tuple[int, int], Plan]] = {}
        self._codes: list[Any] = []
        """References to the code objects of call sites, so that Python does not reuse their
        addresses."""
        self._sites: dict[tuple[Any, ...], int] = {}

    def plans(self, name: str) -> dict[tuple[int, int], Plan]:
        """Return the cached plans by which calls of a function are sent, by call site."""
        return self._plans.setdefault(name, {})

    def forget(self) -> None:
        """Discard all cached plans, because a simulation has ended or there are too many plans."""
        self._codes = []
        for plans in self._plans.values():
            plans.clear()

    def tell(
        self,
        world: WatchedWorld,
        name: str,
        args: tuple[Any, ...],
        kwargs: dict[str, Any],
        place: Any,
    ) -> None:
        """Send a call, and prepare a plan to send further calls from the same site quickly."""
        form, caller = Form(name, args, kwargs), caller_of(place)
        code = caller.f_code
        described = (
            name,
            code.co_filename,
            caller.f_lineno,
            caller.f_lasti,
            form.text,
            *form.names,
            *form.whole,
        )
        site = self._sites.get(described)
        if site is None:
            site = self._sites[described] = len(self._sites)
            file, line = self._place(caller)
            note = {
                "what": "site",
                "number": site,
                "function": name,
                "file": file,
                "line": line,
                "form": form.text,
                "names": form.names,
                "whole": form.whole,
            }
            self._pipe.write(frame(NOTE, encoded(note)))
        packed = Struct(f"<cIII{len(form.numbers)}d")
        length = packed.size - HEADER.size
        self._pipe.write(packed.pack(CALL, length, world.number, site, *form.numbers))
        if caller is not place:
            return
        flat, values = None, (*args, *kwargs.values())
        names_client = CLIENT in kwargs or len(args) > CLIENT_AT.get(name, len(args))
        checked = names_client or name == UNNAMED
        if checked or not {int, float}.issuperset(map(type, values)):
            flat = numbers_of(name, args, kwargs)
            if flat is None or len(flat(*values)) != len(form.numbers):
                return
        if len(self._codes) >= MOST_PLANS:
            self.forget()
        plans, key = self.plans(name), (id(code), place.f_lasti)
        if key not in plans:
            self._codes.append(code)
        plans[key] = world, len(args), [*kwargs], flat, packed.pack_into, packed.size, site


def numbers_of(
    name: str, args: tuple[Any, ...], kwargs: dict[str, Any]
) -> Callable[..., Any] | None:
    """Return a function that extracts the numbers from the arguments of similar calls.

    The function raises an error if an argument has another length or text, or refers to another
    simulation. None if the types of the arguments do not determine their structure.
    """
    terms, checks = [], []
    for at, (key, value) in enumerate([*enumerate(args), *kwargs.items()]):
        kind, its = type(value), f"a[{at}]"
        if kind is int or kind is float:
            terms.append(its)
        elif kind in (list, tuple, range) and len(value) <= LONGEST:
            terms.append(f"*{its}")
            checks.append(f"len({its}) == {len(value)}")
        elif is_numpy(kind) and value.ndim < 2 and value.size <= LONGEST:
            terms.append(f"*{its}.tolist()" if value.ndim else f"{its}.tolist()")
            checks.append(f"{its}.shape == {value.shape}")
        elif value is None or kind in (bool, str, bytes):
            checks.append(f"{its} == k[{at}]")
        else:
            return None
        if key == CLIENT:
            del terms[-1:]
        if key in (CLIENT, CLIENT_AT.get(name)) or (name == UNNAMED and key == MODE_AT):
            checks.append(f"{its} == k[{at}]")
    source = f"[{', '.join(terms)}] if {' and '.join(checks) or True} else no_numbers"
    return _compiled(source)((*args, *kwargs.values()))


@cache
def _compiled(source: str) -> Callable[[Any], Callable[..., Any]]:
    made: Callable[[Any], Callable[..., Any]] = eval(f"lambda k: lambda *a: {source}")
    return made


class Form:
    """A call's arguments as source text in which `{}` stands for each number."""

    def __init__(self, name: str, args: tuple[Any, ...], kwargs: dict[str, Any]) -> None:
        self.numbers: list[float] = []
        self.whole: list[bool] = []
        self.names: list[str] = []
        """The argument to which each number belongs."""
        known = names_of(name, args)
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
        """Return a value as text, without calling methods of the script's classes."""
        kind = type(value)
        if value is None or kind is bool:
            return repr(value)
        if kind in (str, bytes):
            return _escaped(repr(value if len(value) <= 300 else value[:300]))
        if is_numpy(kind):
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


def is_numpy(kind: type) -> bool:
    """Return whether a type is a numpy array or number."""
    return kind.__module__.partition(".")[0] == "numpy" and hasattr(kind, "tolist")


def _escaped(text: str) -> str:
    """Escape braces in text for an argument template, where `{}` stands for a number."""
    return text.replace("{", "{{").replace("}", "}}")
