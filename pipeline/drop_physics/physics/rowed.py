"""Arrays of equal length that belong together: row i of each array describes item i."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray


class Rowed:
    """A dataclass of equal-length arrays: row i of every array describes item i."""

    __dataclass_fields__: ClassVar[dict[str, Any]]

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self._columns()[0])

    def at(self, rows: slice | NDArray[Any]) -> Self:
        """Return the selected rows."""
        return type(self)(*(column[rows] for column in self._columns()))

    def then(self, more: Self) -> Self:
        """Return these rows followed by further ones."""
        return self.joined((self, more))

    @classmethod
    def joined(cls, parts: Sequence[Self]) -> Self:
        """Concatenate tables of rows; return a single table unchanged."""
        if len(parts) == 1:
            return parts[0]
        columns = zip(*(part._columns() for part in parts), strict=True)
        return cls(*map(np.concatenate, columns))

    def _columns(self) -> list[NDArray[Any]]:
        return [getattr(self, name) for name in self.__dataclass_fields__]
