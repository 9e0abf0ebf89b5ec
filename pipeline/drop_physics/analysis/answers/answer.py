"""What an answer is, and what it is read from."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal, get_args

from drop_physics.analysis.explained.recording import Explained
from drop_physics.analysis.joints import JointTable
from drop_physics.analysis.times import Times
from drop_physics.analysis.touches import TouchTable
from drop_physics.messages import joined
from drop_physics.seen.calls import Call
from drop_physics.seen.events import Body, Site
from drop_physics.seen.history import Seen

Level = Literal["broken", "asked", "model", "repeat", "note"]
LEVELS: tuple[Level, ...] = get_args(Level)
"""Not physics any more; asked for one thing and got another; true to the engine, perhaps not to
you; another run may differ; worth knowing. The gravest first."""


@dataclass(frozen=True)
class Effect:
    """How much it is: a magnitude."""

    value: float
    """Not negative."""
    unit: str
    """SI."""


@dataclass(frozen=True)
class Span:
    """The steps that it covers."""

    first: int
    """The first of them."""
    last: int
    """The last of them."""
    count: int
    """Of these, how many it holds in."""


@dataclass(frozen=True, kw_only=True)
class Finding:
    """What was asked and what happened instead, why, and what changes it."""

    code: str
    """A stable name, for scripts."""
    level: Level
    """How grave it is, the gravest first: `broken` is no physics any more; `asked`: one thing was
    asked, another happened; `model`: true to the engine, perhaps not to you; `repeat`: another run
    may differ; `note`."""
    message: str
    """What was seen, with numbers, and why."""
    advice: str | None = None
    """The call that changes it."""
    body: str | None = None
    """Label of the body that it is about; of the worst, where it is about several."""
    bodies: int = 1
    """How many it stands for."""
    joint: str | None = None
    """Name of the joint that it is about."""
    other: str | None = None
    """Label of the other body, in JSON `with`."""
    effect: Effect | None = None
    """How much it is."""
    share: float = 0.0
    """The effect over what is normal for it: ranks findings of one level."""
    steps: Span | None = None
    """The steps that it covers."""
    site: str | None = None
    """File and line of the call that caused it."""

    @property
    def said(self) -> str:
        """The message, which names what it is about."""
        if self.body is None or self.joint is not None or self.body in self.message:
            return self.message
        return joined(": ", [self.body, self.message])

    @property
    def rank(self) -> tuple[int, float]:
        """Where it stands among others: the gravest first."""
        return LEVELS.index(self.level), -self.share


@dataclass(frozen=True, kw_only=True)
class Scene:
    """What answers may read besides the pieces of a recording.

    The tables grow piece by piece, and are complete when answers are asked for.
    """

    seen: Seen
    """Bodies, settings, puts: nothing that has to be read from the samples."""
    origin: Mapping[str, Any]
    """The script, and how it ended."""
    times: Mapping[int, Times]
    """By client."""
    joints: JointTable
    touches: TouchTable

    def body(self, number: int) -> Body:
        """Return a body by its number."""
        return self.seen.bodies[number]


class Answer(ABC):
    """One question. It sees each piece of a recording once, in order, and then speaks."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene

    def see(self, explained: Explained) -> None:  # noqa: B027
        """Take a piece; by default nothing of it is needed."""

    @abstractmethod
    def findings(self) -> Iterator[Finding]:
        """Yield what is sure, after the last piece."""


def site_of(where: Call | Site) -> str:
    """Return file and line of a call, as findings cite it."""
    return f"{where.file}:{where.line}"
