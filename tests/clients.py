"""Frees PyBullet's client 0, which calls without a client id use."""

from __future__ import annotations

import gc

import oracle
import pybullet as p

MOST = 64
"""Upper limit on the number of clients in a test."""


def release_clients() -> None:
    """Disconnect the clients that earlier tests left connected, for a test that needs client 0."""
    oracle.scratch.cache_clear()
    if any(map(p.isConnected, range(MOST))):
        gc.collect()  # worlds that only wait to be finalized
    for client in filter(p.isConnected, range(MOST)):
        p.disconnect(client)
