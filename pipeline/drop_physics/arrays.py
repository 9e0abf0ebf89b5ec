"""Types of the arrays and vectors that the package computes with."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]
Int8 = NDArray[np.int8]
Flags = NDArray[np.bool_]
Vector = tuple[float, float, float]
"""Three numbers: the x, y and z components."""
