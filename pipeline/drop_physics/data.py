"""The standard library's data classes, made four times as quickly: there are three hundred.

It compiles six methods for each, and someone waits for a command to start. Here a class gets its
`__init__` from there, and shares all other methods. That nobody changes what is frozen is for the
type checker to see.
"""

from __future__ import annotations

import dataclasses
from operator import attrgetter
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dataclasses import dataclass as dataclass
else:

    def dataclass(
        cls: type | None = None, /, *, frozen: bool = False, eq: bool = True, kw_only: bool = False
    ) -> Any:  # noqa: ANN401
        """Make a class a data class, as `dataclasses.dataclass` does."""

        def made(cls: type) -> type:
            own = vars(cls)
            if eq and "__eq__" not in own:
                cls.__eq__ = _equal
                cls.__hash__ = own.get("__hash__") or (_hash if frozen else None)
            if "__repr__" not in own:
                cls.__repr__ = _text
            dataclasses.dataclass(cls, eq=False, repr=False, kw_only=kw_only)
            compared = [each for each in dataclasses.fields(cls) if each.compare]
            cls._compared = tuple(each.name for each in compared)
            hashed = [each.name for each in compared if each.hash is not False]
            # Of a single name the getter returns no tuple.
            one = staticmethod(lambda self: tuple(getattr(self, name) for name in hashed))
            cls._hashed = attrgetter(*hashed) if hashed[1:] else one
            return cls

        return made if cls is None else made(cls)


def _equal(self: Any, other: Any) -> Any:  # noqa: ANN401 - any data class
    if other.__class__ is not self.__class__:
        return NotImplemented
    for name in self._compared:
        mine, its = getattr(self, name), getattr(other, name)
        if not (mine is its or mine == its):
            return False
    return True


def _hash(self: Any) -> int:  # noqa: ANN401
    return hash(self._hashed(self))


def _text(self: Any) -> str:  # noqa: ANN401
    shown = [each.name for each in dataclasses.fields(self) if each.repr]
    values = ", ".join(f"{name}={getattr(self, name)!r}" for name in shown)
    return f"{type(self).__qualname__}({values})"
