"""Keeps the last rows of each chunk, for tables whose columns look back to earlier chunks."""

from __future__ import annotations

from dataclasses import dataclass, field

from drop_physics.arrays import Float64


@dataclass
class EarlierRows:
    """The last rows of earlier chunks, by body id; only the tables of the next chunk read them."""

    controls: dict[int, Float64] = field(default_factory=dict)
    """The control of each actuator in the last step, shape (actuators,)."""
    first_controls: dict[int, Float64] = field(default_factory=dict)
    """The control of each actuator in the first step of the episode, shape (actuators,)."""
    rates: dict[int, Float64] = field(default_factory=dict)
    """The highest magnitude of each rate so far, shape (rates,)."""
    joints: dict[int, Float64] = field(default_factory=dict)
    """The position of each joint after the last step, shape (joint_rates,)."""
    put_steps: dict[int, Float64] = field(default_factory=dict)
    """The step before which a call last placed each joint, shape (joint_rates,)."""
    put_joints: dict[int, Float64] = field(default_factory=dict)
    """The position in which a call last placed each joint, shape (joint_rates,)."""
