"""Conversion of results to plain JSON values."""

from __future__ import annotations

import math
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any


def jsonable(value: Any) -> Any:  # noqa: ANN401
    """Convert a value to plain objects and lists; nan and infinities become null.

    Dataclass fields with the metadata `json=False` are left out.
    """
    if is_dataclass(value) and not isinstance(value, type):
        shown = [each.name for each in fields(value) if each.metadata.get("json", True)]
        return {name: jsonable(getattr(value, name)) for name in shown}
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, dict):
        return {key: jsonable(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [jsonable(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
