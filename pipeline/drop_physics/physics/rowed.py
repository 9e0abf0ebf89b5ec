"""Arrays that belong together: a row of each is one thing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from typing import TYPE_CHECKING, Any, Self, cast

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


class Rowed:
    """A dataclass of arrays with one row each."""

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self._columns()[0])

    def at(self, rows: slice | NDArray[Any]) -> Self:
        """Return some of the rows."""
        return type(self)(*(column[rows] for column in self._columns()))

    def then(self, more: Self) -> Self:
        """Return these rows and more."""
        return self.joined((self, more))

    @classmethod
    def joined(cls, parts: Sequence[Self]) -> Self:
        """Return the rows of several, one after the other; of one, itself."""
        if len(parts) == 1:
            return parts[0]
        columns = zip(*(part._columns() for part in parts), strict=True)
        return cls(*map(np.concatenate, columns))

    def _columns(self) -> list[NDArray[Any]]:
        return [getattr(self, each.name) for each in fields(cast("DataclassInstance", self))]
