"""A log of the calls that build and drive a simulation, which an engine can repeat."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal
from xml.etree import ElementTree as Xml

from drop_physics.messages import Message
from drop_physics.trace.frames import ModelEdit

Sets = Literal["setting", "state", "input", "model"]
"""Target of a call: an engine option; positions and velocities; external inputs; or body
properties."""
Made = tuple[str, int]
"""An object that a call creates: its kind, and an index that means the same in both logs."""


@dataclass(frozen=True)
class LoggedCall:
    """A call that changes a simulation."""

    function: str
    given: Mapping[str, Any]
    """Arguments by name; an object that an earlier call created is given as a `Made`."""
    step: int
    """Number of steps before the call."""
    sets: Sets
    makes: Made | None = None
    site: str | None = None
    """File and line."""
    about: str = ""
    """Description of the body that the call concerns."""
    raises: bool = False
    content: bytes | None = None
    """Bytes of the file that the call names."""
    key: object = None
    """A key that is equal for calls with the same effect, whatever the names of the loaded files.
    """


# -- files that calls name ------------------------------------------------------------------------


def attributes_apart(a: bytes, b: bytes) -> Iterator[tuple[str, str | None, str | None]]:
    """Yield the attributes that differ between two XML files with the same elements.

    An attribute is described by its element and the enclosing element with a name, such as `mass
    value of arm`. Nothing is yielded if the elements differ, or a file is not XML.
    """
    try:
        both = [[*_elements(Xml.fromstring(each), "")] for each in (a, b)]
    except Xml.ParseError:
        return
    if [tag for tag, _, _ in both[0]] != [tag for tag, _, _ in both[1]]:
        return
    for (tag, of, mine), (_, _, theirs) in zip(*both, strict=True):
        for name in dict.fromkeys((*mine, *theirs)):
            if mine.get(name) != theirs.get(name):
                what = f"{tag} {name} of {of}" if of else f"{tag} {name}"
                yield what, mine.get(name), theirs.get(name)


def _elements(element: Xml.Element, of: str) -> Iterator[tuple[str, str, dict[str, str]]]:
    for child in element:
        name = child.get("name") or of
        yield child.tag, name, dict(child.attrib)
        yield from _elements(child, name)


# -- two engines ----------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class KnownDifference:
    """A difference between two engines' defaults, and the calls or edits that remove it."""

    name: Message
    is_setting: bool = False
    """Whether the difference is in an engine option, not in a property of the model."""
    calls: Sequence[LoggedCall] = ()
    """Calls that remove the difference in one engine."""
    edits: Sequence[ModelEdit] = ()
    """Model edits that remove the difference in the other engine."""
    value: float | None = None
    """Value in the engine whose calls remove the difference, if it is a number."""
    other: float | None = None
    """Value in the other engine."""
