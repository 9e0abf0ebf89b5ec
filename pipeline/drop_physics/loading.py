"""Lazy imports of libraries in drop's own processes, which halve the start-up time.

A package's `__init__` loads all modules from which it imports names, although a command needs only
some: 80 of Rerun's 500 modules, and for a convex hull 15 of SciPy's 180. Here, such a package
imports a name from its module when the name is first used. Other programs, such as a notebook or a
recorded script, import whole packages as usual.
"""

from __future__ import annotations

import ast
import importlib
import importlib.util
import sys
from collections.abc import Mapping, Sequence
from importlib.machinery import PathFinder, SourceFileLoader
from types import ModuleType
from typing import Any

from drop_physics.address_space import check_address_space

_BLUEPRINT = ("archetypes", "components", "encodings", "views", "visualizers")
_RERUN = (
    *("archetypes", "blueprint", "catalog", "chunk", "components", "encodings", "experimental"),
    *(f"blueprint.{name}" for name in _BLUEPRINT),
)
LAZY: Mapping[str, Mapping[str, str]] = {
    "rerun": {},
    **{f"rerun.{name}": {} for name in _RERUN},
    "scipy.spatial": {"ConvexHull": "._qhull", "QhullError": "._qhull"},
    "scipy.linalg": {},
}
"""Packages that are loaded lazily, with those modules from which `__init__` imports all names
(`*`)."""
POLARS_BYTES = 1 << 30
"""Address space that must be free before Polars is loaded [bytes]. With its first tables on two
processors, Polars reserves 1.6 GB, and aborts if it gets none."""


class LazyLoader(SourceFileLoader):
    """Loads a package, but defers the imports that its `__init__` makes from its own modules."""

    def exec_module(self, package: ModuleType) -> None:
        """Run the rest of the package's `__init__`; a submodule's name is imported on first use."""
        tree, name = ast.parse(self.get_data(self.path)), package.__name__
        own = [each for each in tree.body if isinstance(each, ast.ImportFrom) and each.level]
        homes = {each: (home, each) for each, home in LAZY[name].items()}
        homes |= {
            alias.asname or alias.name: ("." * each.level + (each.module or ""), alias.name)
            for each in own
            for alias in each.names
        }

        def found(asked: str) -> Any:  # noqa: ANN401 - what the package has
            home, its = homes.get(asked, (".", asked))
            if home.strip("."):
                package.__dict__[asked] = getattr(importlib.import_module(home, name), its)
            elif not asked.startswith("__") and importlib.util.find_spec(home + its, name):
                package.__dict__[asked] = importlib.import_module(home + its, name)
            elif "*" in homes and not asked.startswith("__"):
                del package.__dict__["__getattr__"]
                super(LazyLoader, self).exec_module(package)
            else:
                raise AttributeError(f"module {name!r} has no attribute {asked!r}")
            return getattr(package, asked)

        if "*" not in homes:  # else the rest may need what comes with it
            tree.body = [each for each in tree.body if each not in own]
            exec(compile(tree, self.path, "exec", dont_inherit=True), package.__dict__)
        package.__dict__["__getattr__"] = found


class LazyFinder:
    """Finder for `sys.meta_path` that loads the packages in `LAZY` lazily, and hides pandas.

    It raises MemoryError if there is too little memory for a library that would then abort the
    process.
    """

    def find_spec(self, name: str, path: Sequence[str] | None = None, *_: object) -> Any:  # noqa: ANN401
        """Return the import spec of a lazily loaded package; None for any other."""
        if name == "pandas":
            raise ModuleNotFoundError(name, name=name)
        if name == "polars":
            check_address_space(POLARS_BYTES)
        spec = PathFinder.find_spec(name, path) if name in LAZY else None
        if spec is not None and isinstance(spec.loader, SourceFileLoader):
            spec.loader = LazyLoader(name, spec.loader.path)
        return spec


def load_less() -> None:
    """Make libraries load only the modules that are used, in a process of drop's own.

    pandas is hidden, since pyarrow would otherwise import it with its first list, and drop does not
    need it.
    """
    finders: list[Any] = sys.meta_path
    finders.insert(0, LazyFinder())
