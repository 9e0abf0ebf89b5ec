"""Starts modules of drop in a script's interpreter: `python PATH-OF-THIS-FOLDER MODULE ARGUMENT …`.

The interpreter may be old, and need not have drop installed. The parent folder is imported as a
package with a name that no script uses, and `main` of the given module is called with the
arguments.
"""

from __future__ import annotations

import importlib
import importlib.util
import os
import sys
from types import ModuleType

_HERE = os.path.dirname(os.path.abspath(__file__))
_PACKAGE = "_drop_engines"


def _module(name: str) -> ModuleType:
    """Import a module of this package by name, and remove this folder from the module path."""
    if sys.path and os.path.abspath(sys.path[0]) == _HERE:
        del sys.path[0]
    folder = os.path.dirname(_HERE)
    spec = importlib.util.spec_from_file_location(
        _PACKAGE, os.path.join(folder, "__init__.py"), submodule_search_locations=[folder]
    )
    assert spec is not None
    assert spec.loader is not None
    package = importlib.util.module_from_spec(spec)
    sys.modules[_PACKAGE] = package
    spec.loader.exec_module(package)
    return importlib.import_module(f"{_PACKAGE}.{name}")


if __name__ == "__main__":
    _module(sys.argv[1]).main(*sys.argv[2:])
