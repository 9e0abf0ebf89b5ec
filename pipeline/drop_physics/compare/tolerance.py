"""Allowed differences: none, or those that move a body by less than a given length.

Before the first contact, a drop's law uses only + - × ÷ √, so two runs of the same engine agree to
the last bit. In contact, the solver stops when a residual is small, which makes the result jump,
and a nanometre is allowed. Tolerances of other columns follow from a length: a velocity may differ
by the amount that moves the body so far in one step, an angle by the amount that moves its surface
so far.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from drop_physics.arrays import Float64, Int64
from drop_physics.compare.difference import Side
from drop_physics.physics.base import EXACT_MACHINES, FUSED
from drop_physics.trace.events import Body

IN_CONTACT_M = 1e-9
UNKNOWN_LENGTH_M = 1.0
"""Assumed length of a link without a shape [m]: an angle may then differ by as many rad as a
position by m."""


@dataclass(frozen=True)
class Tolerance:
    """The allowed differences between two recordings."""

    air_m: float
    contact_m: float
    """Allowed difference of positions after a drop's first contact [m]; for a script, the same as
    before."""
    fused: bool
    """Whether a processor may have fused multiplication and addition in a drop's run."""
    timesteps_s: Mapping[int, float]
    """Timestep of each simulation, by its id in the golden recording."""
    length_m: float | None
    """Distance from a drop's centre to its surface; None to use each link's bounding box."""
    mass_kg: float | None
    """Mass of the dropped body."""

    def of_parts(
        self, body: Body, client: int, steps: Int64, touched: int | None, parts: Float64
    ) -> Float64:
        """Return the tolerances for the states of base and links.

        Parameters
        ----------
        body, client
            The body, and the golden recording's id of the body's client.
        steps
            The steps of the states, shape (n,).
        touched
            The first step with a contact; None if there is none yet.
        parts
            The golden recording's states, shape (n, links, 13).
        """
        contact = steps >= touched if touched is not None else np.zeros(len(steps), np.bool_)
        metres = np.where(contact, self.contact_m, self.air_m)
        links = [self._per_metre(body, link, client) for link in range(parts.shape[1])]
        allowed: Float64 = metres[:, None, None] * np.array(links)
        if self.fused:
            fused = FUSED * np.maximum(1.0, np.abs(parts))
            allowed = np.where(contact[:, None, None], allowed, np.maximum(allowed, fused))
        return allowed

    def of_contacts(self) -> Mapping[str, float] | None:
        """Return the tolerances for columns of contact points; None if these are not compared.

        Columns that are not in the mapping must agree exactly. For a script, contact points are
        compared only without a tolerance: otherwise, only their effect on the motion counts.
        """
        if self.mass_kg is None or self.length_m is None:
            return None if self.air_m else {}
        step_s = min(self.timesteps_s.values())
        lengths = ["distance_m", *(f"{side}{axis}_m" for side in "ab" for axis in "xyz")]
        forces = ["normal_force_n", *(f"friction_{axis}_n" for axis in "xyz")]
        allowed = dict.fromkeys(lengths, self.contact_m)
        allowed |= dict.fromkeys(("nx", "ny", "nz"), self.contact_m / self.length_m)
        return allowed | dict.fromkeys(forces, self.contact_m * self.mass_kg / step_s**2)

    def _per_metre(self, body: Body, part: int, client: int) -> Float64:
        """Return how much a link's state may differ per metre of tolerance, by column."""
        step_s, length_m = self.timesteps_s[client], self.length_m
        if length_m is None:
            length_m = _half_diagonal_m(body, part)
        # A quaternion has half the angle.
        per_metre = [1.0, 1 / (2 * length_m), 1 / step_s, 1 / (length_m * step_s)]
        return np.repeat(per_metre, (3, 4, 3, 3))


def tolerance_of(run: Side, golden: Side, tolerance_m: float) -> Tolerance:
    """Return the tolerances if positions may differ by up to a length [m]."""
    timesteps_s = {
        each.client: float(np.max(each.values["fixedTimeStep"])) for each in golden.seen.settings
    }
    if run.drop is None or golden.drop is None:
        return Tolerance(tolerance_m, tolerance_m, False, timesteps_s, None, None)
    engine = golden.drop.engine
    machines = [side.engine.machine for side in (run.drop, golden.drop)]
    return Tolerance(
        air_m=tolerance_m,
        contact_m=max(IN_CONTACT_M, tolerance_m),
        fused=any(machine not in EXACT_MACHINES for machine in machines),
        timesteps_s=dict.fromkeys(timesteps_s, golden.drop.scenario.timestep_s),
        length_m=max(engine.rest_height_m or 0.0, 1e-3),
        mass_kg=engine.mass_kg,
    )


def _half_diagonal_m(body: Body, part: int) -> float:
    corners = np.reshape(body.bounds_m, (-1, 2, 3))
    if part >= len(corners):
        return UNKNOWN_LENGTH_M
    length_m = float(np.linalg.norm(corners[part, 1] - corners[part, 0])) / 2
    return length_m if np.isfinite(length_m) and length_m > 0 else UNKNOWN_LENGTH_M
