"""Evaluation inside a run, with access to the script's own variables and its engine.

An evaluator is a class of a module beside this one: it runs in the script's interpreter.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .host import EngineWatch


class Evaluator(ABC):
    """Evaluates something inside a run; its `answer` can be written as JSON."""

    @abstractmethod
    def step(self, engine: EngineWatch, frame: Any) -> None:
        """Observe an engine step, called from a frame of the script."""

    def failed(self, error: BaseException) -> None:  # noqa: B027
        """Observe an exception that ends the script or one of its tests."""

    def before_end(self) -> None:  # noqa: B027
        """Observe that a simulation is about to end, after which its names are invalid."""

    @abstractmethod
    def answer(self) -> Any:
        """Return the evaluator's result, after the end of the script."""


def evaluator_of(given: Mapping[str, Any] | None) -> Evaluator | None:
    """Create the evaluator; None if nothing is evaluated.

    Parameters
    ----------
    given
        The `module` and `name` of its class, and its `arguments`.
    """
    if given is None:
        return None
    module = import_module(f".{given['module']}", __package__)
    evaluator: Evaluator = getattr(module, given["name"])(**given["arguments"])
    return evaluator
