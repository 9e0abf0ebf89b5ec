"""The engines installed together with `drop`, and how to install PyBullet if it is missing.

PyBullet 3.2.7 has wheels for CPython up to 3.11 on Linux (x86-64); on other systems, pip has to
compile it.
"""

from __future__ import annotations

import platform
import sys
from importlib.util import find_spec

from drop_physics.errors import ScenarioError
from drop_physics.messages import Message

PYBULLET, VERSION = "pybullet", "3.2.7"
"""PyBullet's package name, and the version for which the golden values were made."""
LAST_PYTHON = (3, 11)
"""The newest Python version for which PyBullet has a wheel."""


def is_installed(module: str) -> bool:
    """Return whether a module can be imported here."""
    return find_spec(module) is not None


def next_step() -> Message:
    """Describe how to get PyBullet: by pip, or in a Python version for which it has a wheel."""
    if has_wheel():
        return Message("install it with: pip install pybullet=={version}", version=VERSION)
    return Message(
        "with Python {python} on Linux (x86-64) pip installs it; here pip install "
        "pybullet=={version} compiles it",
        python="{}.{}".format(*LAST_PYTHON),
        version=VERSION,
    )


def has_wheel() -> bool:
    """Return whether PyBullet has a wheel for this Python on this machine."""
    here = sys.platform, platform.machine()
    return here == ("linux", "x86_64") and sys.version_info[:2] <= LAST_PYTHON


def why_missing() -> Message:
    """Return the reason why PyBullet is missing."""
    if has_wheel():
        return Message("PyBullet is not installed")
    return Message(
        "PyBullet has no wheel for Python {python} on {system} ({machine})",
        python="{}.{}".format(*sys.version_info),
        system=platform.system(),
        machine=platform.machine(),
    )


def needs_pybullet(what: str) -> ScenarioError:
    """Return the error for a request that needs PyBullet while it is not installed."""
    return ScenarioError(
        "{what} cannot be used: {why}; {next}", what=what, why=why_missing(), next=next_step()
    )
