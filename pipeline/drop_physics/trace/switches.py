"""Model flags that disable parts of the physics."""

from __future__ import annotations

from drop_physics.trace.history import Seen

NO_CONTACT, NO_GRAVITY, NO_ACTUATION, NO_AUTO_RESET = 1 << 4, 1 << 7, 1 << 11, 1 << 16
"""Bits of the setting `disableflags` (`mjtDisableBit`)."""


def is_off(seen: Seen, client: int, flag: int) -> bool:
    """Return whether a model flag disables its feature at the end of a simulation."""
    held = [each.values.get("disableflags") for each in seen.settings if each.client == client]
    return bool(held) and isinstance(held[-1], float) and bool(int(held[-1]) & flag)
