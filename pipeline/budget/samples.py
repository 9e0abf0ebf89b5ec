"""The recorded state as arrays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import polars as pl
from numpy.typing import NDArray

Float64 = NDArray[np.float64]


@dataclass(frozen=True)
class Samples:
    """The recorded state as arrays, one row per sample; vectors in world axes, (samples, 3)."""

    position_m: Float64
    """Of the centre."""
    orientation: Float64
    """World from the body's axes: unit quaternions x, y, z, w, shape (samples, 4)."""
    velocity_m_s: Float64
    spin_rad_s: Float64
    contact_points: Float64
    """How many there are, shape (samples,); 0 where there is no contact."""
    contact_distance_m: Float64
    """Smallest distance to the floor at which they were found [m], (samples,); nan without any."""
    contact_force_n: Float64
    """Normal forces together [N], shape (samples,)."""

    @property
    def height_m(self) -> Float64:
        """Height of the centre [m], shape (samples,)."""
        return self.position_m[:, 2]


def samples_of(states: pl.DataFrame) -> Samples:
    """Return the columns of a recording's state as arrays."""
    return Samples(
        position_m=states.select("x_m", "y_m", "z_m").to_numpy(),
        orientation=states.select("qx", "qy", "qz", "qw").to_numpy(),
        velocity_m_s=states.select("vx_m_s", "vy_m_s", "vz_m_s").to_numpy(),
        spin_rad_s=states.select("wx_rad_s", "wy_rad_s", "wz_rad_s").to_numpy(),
        contact_points=states["contact_points"].to_numpy(),
        contact_distance_m=states["contact_distance_m"].to_numpy(),
        contact_force_n=states["contact_force_n"].to_numpy(),
    )
