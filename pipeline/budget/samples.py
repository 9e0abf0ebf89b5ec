"""The recorded state as arrays."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import polars as pl
from numpy.typing import NDArray

Float64 = NDArray[np.float64]


@dataclass(frozen=True)
class Rigid:
    """The motion of one rigid part, one row per sample; vectors in world axes, (samples, 3)."""

    position_m: Float64
    """Of its centre of mass."""
    orientation: Float64
    """World from its own axes: unit quaternions x, y, z, w, shape (samples, 4)."""
    velocity_m_s: Float64
    spin_rad_s: Float64


@dataclass(frozen=True)
class Samples(Rigid):
    """The recorded state: the motion of the body, or of its base, and what touches it."""

    contact_points: Float64
    """How many there are, shape (samples,); 0 where there is no contact."""
    contact_distance_m: Float64
    """Smallest distance to the floor at which they were found [m], (samples,); nan without any."""
    contact_force_n: Float64
    """Normal forces together [N], shape (samples,)."""
    links: tuple[Rigid, ...] = ()
    """The further links of a body with joints, as far as they are recorded."""

    @property
    def height_m(self) -> Float64:
        """Height of the centre [m], shape (samples,)."""
        return self.position_m[:, 2]


def samples_of(states: pl.DataFrame) -> Samples:
    """Return the columns of a recording's state as arrays."""
    return Samples(
        *_motion(states),
        contact_points=states["contact_points"].to_numpy(),
        contact_distance_m=states["contact_distance_m"].to_numpy(),
        contact_force_n=states["contact_force_n"].to_numpy(),
        links=tuple(
            Rigid(*_motion(states, f"link{n}_"))
            for n in range(sum(name.startswith("link") for name in states.columns) // 13)
        ),
    )


def _motion(states: pl.DataFrame, prefix: str = "") -> Iterator[Float64]:
    """Yield position, orientation, velocity and spin of a rigid part."""
    for names in (
        ("x_m", "y_m", "z_m"),
        ("qx", "qy", "qz", "qw"),
        ("vx_m_s", "vy_m_s", "vz_m_s"),
        ("wx_rad_s", "wy_rad_s", "wz_rad_s"),
    ):
        yield states.select(prefix + name for name in names).to_numpy()
