"""Call logs of two PyBullet scripts, with ids matched so that the logs can be compared."""

from __future__ import annotations

import ast
import hashlib
import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from drop_physics.engines.pybullet.watch.arguments import BODY_NAMES, CLIENT, named
from drop_physics.engines.pybullet.watch.functions import (
    COMMANDS,
    DRAWS,
    IK,
    MOVES_ALL,
    MOVES_BODY,
    PUSHES,
)
from drop_physics.trace.calls import Call, text_of
from drop_physics.trace.logs import LoggedCall, Made, Sets

BODY, SHAPE, LOOK, STATE, CONSTRAINT, TEXTURE = (
    *("body", "shape", "look", "state", "constraint", "texture"),
)
"""Kinds of objects that calls create, and that later calls refer to."""
MAKES = {
    "loadURDF": BODY, "loadSoftBody": BODY, "createMultiBody": BODY,
    "createCollisionShape": SHAPE, "createVisualShape": LOOK, "saveState": STATE,
    "createConstraint": CONSTRAINT, "loadTexture": TEXTURE,
}  # fmt: skip
NAMES = {
    **dict.fromkeys(BODY_NAMES, BODY),
    **dict.fromkeys(("bodyUniqueIdA", "bodyUniqueIdB", "bodyIndexA", "bodyIndexB"), BODY),
    **dict.fromkeys(("parentBodyUniqueId", "childBodyUniqueId", "softBodyBodyUniqueId"), BODY),
    **dict.fromkeys(("baseCollisionShapeIndex", "linkCollisionShapeIndices"), SHAPE),
    **dict.fromkeys(("collisionShapeId",), SHAPE),
    **dict.fromkeys(("baseVisualShapeIndex", "linkVisualShapeIndices"), LOOK),
    **dict.fromkeys(("stateId", "stateUniqueId"), STATE),
    "userConstraintUniqueId": CONSTRAINT,
    "textureUniqueId": TEXTURE,
}  # fmt: skip
"""Arguments that refer to a created object, with the object's kind."""
FILES = ("fileName", "sdfFileName", "mjcfFileName")
SETTINGS = ("setPhysicsEngineParameter", "setTimeStep", "setGravity", "setDefaultContactERP")
STATES = MOVES_BODY | MOVES_ALL
IDLE = DRAWS | IK | {"connect", "disconnect", "stepSimulation"}
"""Calls that do not change a simulation, or that the replay makes itself."""

Files = Mapping[str, Sequence[tuple[str, bytes]]]
"""The files named by each call: their paths and contents."""


class LogError(Exception):
    """Raised for a log that cannot be replayed."""


@dataclass
class LogOf:
    """The log of the calls that one script made.

    Parameters
    ----------
    calls
        The recorded calls.
    files
        The files that each call names.
    """

    calls: Iterable[Call]
    files: Files
    made: list[tuple[Made, Call]] = field(default_factory=list)
    """Objects created by calls, in order."""
    _now: dict[tuple[str, int], int] = field(default_factory=dict)
    """The object that each engine id currently denotes, by kind."""
    keys: dict[Made, object] = field(default_factory=dict)
    """Full descriptions of created objects."""
    _digests: dict[str, str] = field(default_factory=dict)
    _seen: dict[str, int] = field(default_factory=dict)
    contents: dict[str, bytes] = field(default_factory=dict)
    """Contents of the named files, by path."""

    def logged(self) -> list[LoggedCall]:
        """Return the calls as log entries, with the objects that they create numbered in order.

        Raises
        ------
        LogError
            If an argument is not a number, a text, or a list of these.
        """
        return [each for call in self.calls if (each := self._logged(call)) is not None]

    def _logged(self, call: Call) -> LoggedCall | None:
        if call.function in IDLE:
            return None
        given = _arguments(call)
        given.pop(CLIENT, None)
        for name, value in given.items():
            if name in NAMES:
                given[name] = self._named(NAMES[name], value)
            elif name in FILES and isinstance(value, str):
                given[name] = self._file(value)
        whole = {name: self._whole(value) for name, value in given.items()}
        makes = None
        if call.function in MAKES and not call.raised and math.isfinite(call.result):
            kind = MAKES[call.function]
            makes = kind, sum(each[0][0] == kind for each in self.made)
            self._now[kind, int(call.result)] = makes[1]
            self.keys[makes] = self.key(call.function, whole)
            self.made.append((makes, call))
        return LoggedCall(
            call.function,
            given,
            call.at.step,
            _sets(call),
            makes,
            call.site.place,
            raises=bool(call.raised),
            content=next(
                (self.contents[v] for n, v in given.items() if n in FILES and v in self.contents),
                None,
            ),
            key=self.key(call.function, given),
        )

    def _named(self, kind: str, value: Any) -> Any:  # noqa: ANN401 - an argument
        if isinstance(value, list | tuple):
            return [self._named(kind, each) for each in value]
        number = self._now.get((kind, int(value))) if isinstance(value, int | float) else None
        return value if number is None else [kind, number]

    def _whole(self, value: Any) -> Any:  # noqa: ANN401 - an argument
        """Replace ids of collision and visual shapes in an argument by the shapes' descriptions."""
        if isinstance(value, list):
            if len(value) == 2 and isinstance(value[0], str):
                return self.keys.get((value[0], value[1])) if value[0] == SHAPE else value
            return [self._whole(each) for each in value]
        return value

    def key(self, function: str, given: Mapping[str, Any]) -> tuple[str, str]:
        """Return a key that is equal for calls with the same effect, whatever files are named."""
        told = {
            name: self._digests.get(value, value) if name in FILES else value
            for name, value in given.items()
        }
        return function, json.dumps(told, sort_keys=True, default=list)

    def _file(self, name: str) -> str:
        """Return a unique path for a file that a call loads, since its content may change."""
        times = self._seen.get(name, 0)
        self._seen[name] = times + 1
        kept = self.files.get(name, ())
        if times >= len(kept):
            return name
        path, content = kept[times]
        digest = hashlib.sha256(content).hexdigest()
        if self._digests.get(path, digest) != digest:  # it was written anew
            path = f"{path}#{times}"
        self._digests[path], self.contents[path] = digest, content
        return path


def _arguments(call: Call) -> dict[str, Any]:
    """Return the arguments of a recorded call by name."""
    text = text_of(call.site, call.numbers)
    try:
        tree = ast.parse(f"f({text})", mode="eval").body
        assert isinstance(tree, ast.Call)
        args = tuple(ast.literal_eval(each) for each in tree.args)
        kwargs = {str(keyword.arg): ast.literal_eval(keyword.value) for keyword in tree.keywords}
    except (SyntaxError, ValueError, AssertionError):
        raise LogError(f"{call.function}({text})"[:80]) from None
    return named(call.function, args, kwargs)


def _sets(call: Call) -> Sets:
    if call.function in SETTINGS:
        return "setting"
    if call.function in STATES:
        return "state"
    commands = call.function in PUSHES or (call.function in COMMANDS and call.at.step > 0)
    return "input" if commands else "model"


def renumbered(
    mine: LogOf, theirs: LogOf, log: Sequence[LoggedCall]
) -> tuple[list[LoggedCall], dict[Made, Made]]:
    """Return the second log with the ids of the first for the same objects, and the id mapping.

    Objects created by equal calls are the same object; the remaining ones are matched in order.
    """
    twin = dict(_twins(mine, theirs))
    unused = max((number for (_, number), _ in (*mine.made, *theirs.made)), default=-1) + 1
    for made, _ in theirs.made:
        if made not in twin:
            twin[made] = made[0], unused
            unused += 1

    def renamed(value: Any) -> Any:  # noqa: ANN401 - an argument
        if isinstance(value, list):
            if len(value) == 2 and isinstance(value[0], str):
                return [*twin.get((value[0], value[1]), value)]
            return [renamed(each) for each in value]
        return value

    found = []
    for each in log:
        given = {n: renamed(value) if n in NAMES else value for n, value in each.given.items()}
        makes = None if each.makes is None else twin[each.makes]
        key = theirs.key(each.function, given)
        found.append(replace(each, given=given, makes=makes, key=key))
    return found, twin


def _twins(mine: LogOf, theirs: LogOf) -> Iterator[tuple[Made, Made]]:
    for kind in dict.fromkeys(MAKES.values()):
        left = [made for made, _ in mine.made if made[0] == kind]
        over = []
        for made, _ in theirs.made:
            if made[0] != kind:
                continue
            same = [each for each in left if mine.keys[each] == theirs.keys[made]]
            if same:
                left.remove(same[0])
                yield made, same[0]
            else:
                over.append(made)
        yield from zip(over, left, strict=False)
