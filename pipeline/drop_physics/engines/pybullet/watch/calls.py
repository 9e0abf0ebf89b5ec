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
from ...watching.pipe import BLOCK, CALL, HEADER, NOTE, encoded, frame
from ...watching.sites import caller_of
from .arguments import CLIENT, CLIENT_AT, MODE_AT, UNNAMED, names_of
from .functions import PUSHES

if TYPE_CHECKING:
    from .worlds import WatchedWorld

    Before = Callable[[WatchedWorld, tuple[Any, ...], dict[str, Any]], Any]
    """A function that prepares a call; it takes the simulation, and arguments by place and by name.
    """
    Send = Callable[[tuple[Any, ...], dict[str, Any]], Any]
    """Sends a call, and returns the result of `Before`, or None."""

LONGEST = 128
"""Largest number of list values that are reported; of a longer list, the first values and the
length are."""
MOST_WHOLE = 1 << 53
"""Largest integer that is exact as a double."""
MOST_PLANS = 4096
"""Largest number of senders that are cached; beyond it, all are rebuilt."""


class CallWatch:
    """Sends calls, and describes the sites from which they are made."""

    def __init__(self, host: ScriptWatch) -> None:
        self._pipe, self._place = host.pipe, host.sites.place
        self._senders: dict[str, dict[tuple[int, int], tuple[WatchedWorld, Send]]] = {}
        self._before: dict[str, Before | None] = {}
        self._codes: list[Any] = []
        """References to the code objects of call sites, so that Python does not reuse their
        addresses."""
        self._sites: dict[tuple[Any, ...], int] = {}

    def senders(
        self, name: str, before: Before | None
    ) -> dict[tuple[int, int], tuple[WatchedWorld, Send]]:
        """Return the cached senders of a function's calls and their simulations, by call site.

        A sender raises an error, and has sent nothing, if a call differs in more than its numbers
        from the one for which the sender was made.
        """
        self._before[name] = before
        return self._senders.setdefault(name, {})

    def forget(self) -> None:
        """Discard all cached senders, because a simulation has ended or there are too many."""
        self._codes = []
        for senders in self._senders.values():
            senders.clear()

    def tell(
        self,
        world: WatchedWorld,
        name: str,
        args: tuple[Any, ...],
        kwargs: dict[str, Any],
        place: Any,
    ) -> None:
        """Send a call, and prepare to send further calls from the same site quickly."""
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
        if caller is not place or name not in self._senders:
            return
        before, given = self._before[name], (*args, *kwargs.values())
        source = _source_of(name, args, kwargs, before, len(form.numbers))
        if source is None:
            return
        if len(self._codes) >= MOST_PLANS:
            self.forget()
        senders, key = self._senders[name], (id(code), place.f_lasti)
        if key not in senders:
            self._codes.append(code)
        senders[key] = world, _compiled(source)(self._pipe, world, before, packed, site, given)


SENDER = """def made(pipe, world, before, packed, site, k):
 pack, size, number = packed.pack_into, packed.size, world.number
 length = size - HEADER
 def send(args, kwargs):
  {arguments}
  if not ({checks}): raise ValueError
  {items}
  noted = {noted}
  end = pipe.end if pipe.end <= pipe.limit else pipe.make_room()
  pack(pipe.memory, end, CALL, length, number, site, {numbers})
  pipe.end = end = end + size
  pipe.counts[1] = end - BLOCK
  return noted
 return send
"""
"""Source text of a function that sends similar calls, without a loop over their numbers."""


def _source_of(
    name: str,
    args: tuple[Any, ...],
    kwargs: dict[str, Any],
    before: Before | None,
    count: int,
) -> str | None:
    """Return the source text of a function that sends calls like this one, of `count` numbers.

    The function raises an error if an argument has another length or text, or refers to another
    simulation. None if the types of the arguments do not determine their structure.
    """
    arguments = [f"[{', '.join(f'a{at}' for at in range(len(args)))}] = args"]
    checks, items, numbers = [f"len(kwargs) == {len(kwargs)}"], list[str](), list[str]()
    for at, (key, value) in enumerate([*enumerate(args), *kwargs.items()]):
        kind, its, several = type(value), f"a{at}", None
        if at >= len(args):
            arguments.append(f"{its} = kwargs[{key!r}]")
        if key in (CLIENT, CLIENT_AT.get(name)) or (name == UNNAMED and key == MODE_AT):
            checks.append(f"{its} == k[{at}]")
        if kind in (list, tuple, range) and len(value) <= LONGEST:
            checks.append(f"len({its}) == {len(value)}")
            several = its
        elif is_numpy(kind) and value.ndim < 2 and value.size <= LONGEST:
            checks.append(f"{its}.shape == {value.shape}")
            its = f"{its}.tolist()"
            several = its if value.ndim else None
        elif value is None or kind in (bool, str, bytes):
            checks.append(f"{its} == k[{at}]")
            continue
        elif kind is not int and kind is not float:
            return None
        if key == CLIENT:
            continue
        each = [its] if several is None else [f"a{at}_{place}" for place in range(len(value))]
        if several is not None:
            items.append(f"[{', '.join(each)}] = {several}")
        numbers += each
    if len(numbers) != count:
        return None
    noted = "None" if before is None else "before(world, args, kwargs)"
    return SENDER.format(
        arguments="; ".join(arguments),
        checks=" and ".join(checks),
        items="; ".join(items) or "pass",
        noted=f"{noted} if world.touched else None" if name in PUSHES else noted,
        numbers=", ".join(numbers),
    )


@cache
def _compiled(source: str) -> Callable[..., Send]:
    names: dict[str, Any] = {"CALL": CALL, "HEADER": HEADER.size, "BLOCK": BLOCK.size}
    exec(source, names)
    made: Callable[..., Send] = names["made"]
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
