"""What our own processes leave out of libraries: half of the time to start was theirs.

A package's `__init__` loads all modules that it takes names from, and a command needs some of them:
of Rerun 80 of 500, of SciPy's 180 for a convex hull 15. Here such a package gets a name from its
module when the name is first asked for. Other programs, as a notebook or a script that is recorded,
import whole packages.
"""

from __future__ import annotations

import ast
import importlib
import importlib.util
import sys
from collections.abc import Mapping, Sequence
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from types import ModuleType
from typing import Any

_BLUEPRINT = ("archetypes", "components", "encodings", "views", "visualizers")
_RERUN = (
    *("archetypes", "blueprint", "catalog", "chunk", "components", "encodings", "experimental"),
    *(f"blueprint.{name}" for name in _BLUEPRINT),
)
LAZY: Mapping[str, Mapping[str, str]] = {
    "rerun": {},
    **{f"rerun.{name}": {} for name in _RERUN},
    "scipy.spatial": {"ConvexHull": "_qhull", "QhullError": "_qhull"},
    "scipy.linalg": {},
}
"""Packages, and modules of theirs that define names which their `__init__` takes with a star."""


class Lazy(ModuleType):
    """A package that imports its modules one by one, when a name of theirs is asked for."""

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 - what the package has
        held = self.__dict__
        if name in held.get("_homes", {}):
            home, its = held["_homes"][name]
            module = importlib.import_module(home, self.__name__)
            held[name] = module if its is None else getattr(module, its)
        elif name.startswith("__"):
            raise AttributeError(f"module {self.__name__!r} has no attribute {name!r}")
        elif importlib.util.find_spec(f".{name}", self.__name__) is not None:
            importlib.import_module(f".{name}", self.__name__)
        elif "_whole" in held:
            held.pop("_whole").exec_module(self)
        else:
            raise AttributeError(f"module {self.__name__!r} has no attribute {name!r}")
        return getattr(self, name)


class LazyLoader:
    """Runs the `__init__` of a package without its imports from its own modules."""

    def __init__(self, loader: SourceFileLoader) -> None:
        self._loader = loader

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        """Return the package, still empty."""
        return Lazy(spec.name)

    def exec_module(self, module: ModuleType) -> None:
        """Fill the package: where names are, and what else its `__init__` does."""
        name, loader = module.__name__, self._loader
        tree = ast.parse(loader.get_data(loader.path))
        homes: dict[str, tuple[str, str | None]] = {}
        homes |= {each: (f".{home}", each) for each, home in LAZY[name].items()}
        own = [each for each in tree.body if isinstance(each, ast.ImportFrom) and each.level]
        for each in own:
            home = "." * each.level + (each.module or "")
            for alias in each.names:
                its = (home, alias.name) if each.module else (home + alias.name, None)
                homes.setdefault(alias.asname or alias.name, its)
        module._homes = homes  # type: ignore[attr-defined]
        if "*" in homes:  # what else it has is not known
            module._whole = loader  # type: ignore[attr-defined]
            return
        tree.body = [each for each in tree.body if each not in own]
        exec(compile(tree, loader.path, "exec", dont_inherit=True), module.__dict__)


class LazyFinder:
    """Finds these packages, and pandas nowhere, as a finder (`sys.meta_path`)."""

    def find_spec(self, name: str, path: Sequence[str] | None = None, *_: object) -> Any:  # noqa: ANN401
        """Return how a package is loaded; None where it is loaded as any other."""
        if name == "pandas":
            raise ModuleNotFoundError(name, name=name)
        spec = PathFinder.find_spec(name, path) if name in LAZY else None
        if spec is not None and isinstance(spec.loader, SourceFileLoader):
            spec.loader = LazyLoader(spec.loader)  # type: ignore[assignment]
        return spec


def load_less() -> None:
    """Let libraries of this process, which is ours, load what is used.

    Nothing here needs pandas, which pyarrow else imports for its first list, if it is installed.
    """
    finders: list[Any] = sys.meta_path
    finders.insert(0, LazyFinder())
