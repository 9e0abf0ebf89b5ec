"""Interface for code that evaluates something within a run, such as an expectation.

An evaluator is a class in a module of this folder: it runs in the script's interpreter.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .host import EngineWatch


class Evaluator(ABC):
    """Checks something inside a run; the answer can be written as JSON."""

    @abstractmethod
    def step(self, engine: EngineWatch, frame: Any) -> None:
        """Note an engine step, called from the given frame of the script."""

    def failed(self, error: BaseException) -> None:  # noqa: B027
        """Note an exception that ends the script or one of its tests."""

    def before_end(self) -> None:  # noqa: B027
        """Note that a simulation is about to end, after which it cannot be read any more."""

    @abstractmethod
    def answer(self) -> Any:
        """Return the result, after the script has ended."""


def evaluator_of(given: Mapping[str, Any] | None) -> Evaluator | None:
    """Create an evaluator from a description, or return None if there is no description.

    Parameters
    ----------
    given
        The `module` and `name` of the evaluator's class, and its `arguments`.
    """
    if given is None:
        return None
    module = import_module(f".{given['module']}", __package__)
    evaluator: Evaluator = getattr(module, given["name"])(**given["arguments"])
    return evaluator
