"""PyBullet's client 0, which calls without a client id reach."""

from __future__ import annotations

import gc

import oracle
import pybullet as p

MOST = 64
"""More clients than any test has."""


def release_clients() -> None:
    """Disconnect what earlier tests of this process left, for one that needs client 0."""
    oracle.scratch.cache_clear()
    if any(map(p.isConnected, range(MOST))):
        gc.collect()  # worlds that only wait to be finalized
    for client in filter(p.isConnected, range(MOST)):
        p.disconnect(client)
