"""Reports when a script uses functions whose steps cannot be recorded."""

from __future__ import annotations

import functools
from types import ModuleType
from typing import TYPE_CHECKING, Any

from ...watching.hidden import hiding
from ...watching.sites import caller

if TYPE_CHECKING:
    from .hooks import MujocoWatch

IMPORTED = ("mujoco.mjx", "mujoco_warp")
"""Modules that make steps outside MuJoCo's own functions; their import is reported."""
CALLED = {
    "mujoco.rollout": ("rollout", "Rollout.rollout"),
    "mujoco.batch": ("Batch.step", "Batch.forward"),
}
"""Functions that make steps in threads of their own; their first call is reported."""


def install(watch: MujocoWatch, names: tuple[str, ...], module: ModuleType) -> None:
    """Wrap functions whose steps cannot be recorded, so that their use is reported."""
    for name in names:
        owner: Any = module
        *classes, attribute = name.split(".")
        for each in classes:
            owner = getattr(owner, each, None)
        original = vars(owner).get(attribute) if owner is not None else None
        if callable(original) and getattr(original, "drop_watch", None) is not watch:
            hook = _naming(watch, f"{module.__name__}.{name}", original)
            setattr(owner, attribute, hook)
            watch.host.on_removal(functools.partial(setattr, owner, attribute, original))


def _naming(watch: MujocoWatch, name: str, original: Any) -> Any:
    """Return a wrapper that reports a function's first use by the script."""
    named = False

    @functools.wraps(original)
    @hiding
    def call(*args: Any, **kwargs: Any) -> Any:
        nonlocal named
        place = caller()
        ours = str(place.f_globals.get("__name__")).startswith("mujoco.")
        if watch.host.on and not named and not ours:
            named = True
            watch.tell_uncaught(name, place)
        return original(*args, **kwargs)

    call.drop_watch = watch  # type: ignore[attr-defined]
    return call
