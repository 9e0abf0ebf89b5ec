"""The recorded state as arrays."""

from __future__ import annotations

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
    links = sum(name.startswith("link") for name in states.columns) // len(_MOTION)
    base = _rigid(states)
    return Samples(
        position_m=base.position_m,
        orientation=base.orientation,
        velocity_m_s=base.velocity_m_s,
        spin_rad_s=base.spin_rad_s,
        contact_points=states["contact_points"].to_numpy(),
        contact_distance_m=states["contact_distance_m"].to_numpy(),
        contact_force_n=states["contact_force_n"].to_numpy(),
        links=tuple(_rigid(states, f"link{number}_") for number in range(links)),
    )


_POSITION, _ORIENTATION = ("x_m", "y_m", "z_m"), ("qx", "qy", "qz", "qw")
_VELOCITY, _SPIN = ("vx_m_s", "vy_m_s", "vz_m_s"), ("wx_rad_s", "wy_rad_s", "wz_rad_s")
_MOTION = (*_POSITION, *_ORIENTATION, *_VELOCITY, *_SPIN)


def _rigid(states: pl.DataFrame, prefix: str = "") -> Rigid:
    def columns(names: tuple[str, ...]) -> Float64:
        return states.select(prefix + name for name in names).to_numpy()

    return Rigid(columns(_POSITION), columns(_ORIENTATION), columns(_VELOCITY), columns(_SPIN))
