"""Names bodies as recordings and reports do."""

from __future__ import annotations

from ...watching.observed import label_name

KINDS = {
    2: "sphere",
    3: "box",
    4: "cylinder",
    5: "mesh",
    6: "plane",
    7: "capsule",
    9: "heightfield",
}
"""Names of PyBullet's shape types."""


def name_of(*candidates: str) -> str:
    """Return the first non-empty name, as part of an entity's path."""
    return label_name(next(filter(None, candidates), "").rpartition("/")[2].partition(".")[0])
