"""Lists the single changes that could be tried on a PyBullet run, and how to make each.

The rows of the table of changes arrive as data (`interventions`). A row is either a call to add
before the first step, or a pattern of functions and arguments with operators that change the
script's own calls.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

from ...watching.operators import ROTATED, becoming
from ...watching.single_changes import Change, how_of
from .intervene import Element, SeenCalls, SeenCallSites, there

STEP, TIMESTEP = "stepSimulation", "timestep"
NOT_SAID = {"loadURDF": {"useFixedBase": 0, "flags": 0}}
"""Optional arguments that can be changed even if a call omits them, with PyBullet's defaults."""
ALWAYS = ("left-out", "each-step")
"""Operators on calls whose arguments need not vary."""
OF_CALLS = (*ALWAYS, "held", "late")

Row = Mapping[str, Any]


def possible(p: Any, rows: Sequence[Row], seen: SeenCallSites) -> list[Change]:
    """Return the single changes that could be tried and would have an effect in this run.

    Parameters
    ----------
    p
        PyBullet's own functions, while the run's simulations still exist.
    rows
        The rows of the table of interventions.
    seen
        The calls and contacts of the script's own run.
    """
    names = BodyNames(
        p, {at: of for calls in seen.calls.values() for at, of in calls.files.items()}
    )
    patterns = [row for row in rows if "call" not in row and row["change"] != TIMESTEP]
    of_calls = [
        change
        for site, calls in seen.calls.items()
        for change in _of_calls(names, site, calls, patterns)
    ]
    found = [*of_calls, *_together(of_calls)]
    clients = sorted({element[0] for calls in seen.calls.values() for element in calls.elements})
    for row in rows:
        for op in row["tries"]:
            change = Change(row["change"], op, how_of(op), breaks=op in row["breaks"])
            if row["change"] == TIMESTEP:
                found.append(change)
            elif "call" in row:
                change = replace(change, how=(op, _once(row, op)))
                ids = [each for n in clients for each in there(p, n, row["each"], seen.pairs)]
                of = tuple(names.of(row["each"], each) for each in ids) if row["each"] else ()
                bodies = _bodies(names, ids) if row["each"] in ("links", "joints") else ()
                lines = {seen.first_steps.get(n) for n in clients}
                site = lines.pop() if len(lines) == 1 else None
                change = replace(change, is_geometry=row["is_geometry"], bodies=bodies, site=site)
                found += [replace(change, ids=tuple(ids), of=of)] if ids else []
    return found


def trial_of(change: Change) -> dict[str, Any]:
    """Return the operations and run variation by which a trial run makes a change."""
    if change.change == TIMESTEP:
        return {"interventions": [], "variation": {"finer": int(change.how[1])}}
    function, _, argument = change.change.partition(".")
    operator, value = change.how
    elements = [[*each] for each in change.ids]
    operation: dict[str, Any] = {"functions": [function], "elements": elements}
    if isinstance(value, dict):
        operation = {"do": "once", "functions": [STEP], "ids": elements, **value}
    elif operator in ("held", "late"):
        operation["do"] = operator
    elif operator == "each-step":
        return {"interventions": [_repeated(change)], "variation": {}}
    elif operator in ("left-out", "default"):
        operation.update(do="leave", arguments=[argument] if argument else [])
    else:
        sets = {argument: (operator, _whole(value))}
        operation.update(do="set", sets=sets, given=operator != "^")
    if change.site is not None and operation["do"] != "once":
        operation["site"] = [*change.site]
    return {"interventions": [operation], "variation": {}}


def _repeated(change: Change) -> dict[str, Any]:
    """Return the operation that repeats pushes before each step, though none is called there."""
    pushes = {"ids": [[*each] for each in change.ids], "line": change.site}
    return {"do": "again", "functions": [change.change, STEP], **pushes}


class BodyNames:
    """The names of bodies, links and joints at the end of a run.

    If several bodies have the same name, their ids are added: panda body2.

    Parameters
    ----------
    p
        PyBullet's own functions.
    files
        The names of loaded files, by the body loaded from each.
    """

    def __init__(self, p: Any, files: Mapping[Element, str]) -> None:
        self._p = p
        self._names: dict[int, dict[int | None, str]] = {}
        self._files = {
            at: name
            for client in {client for client, *_ in files}
            for at, name in _told_apart({e: n for e, n in files.items() if e[0] == client})
        }

    def of_call(self, element: Element) -> str:
        """Return the name of a call's object: a body or joint, or the file of a body."""
        return self._files.get(element) or self.of("links", element)

    def of(self, each: str, element: Sequence[Any]) -> str:
        """Return the name of a changed object: a body, a link or joint, or two bodies."""
        client, *about = element
        if each == "constraints":
            return f"constraint{about[0]}"
        if each == "pairs":
            one, other, *links = about
            sides = ((client, one, links[0]), (client, other, links[1]))
            return " x ".join(self.of("links", side) for side in sides)
        body, link = (*about, None)[:2]
        if body is None:
            return ""
        name = self._of(client).get(body)
        if name is None:  # it is gone
            return f"body{body}"
        if link is None or link < 0:
            return name
        joint = self._p.getJointInfo(body, link, client)[1].decode(errors="replace")
        return f"{joint} of {name}"

    def _of(self, client: int) -> dict[int | None, str]:
        if client not in self._names:
            p = self._p
            ids = [p.getBodyUniqueId(n, client) for n in range(p.getNumBodies(client))]
            names = {n: p.getBodyInfo(n, client)[1].decode(errors="replace") for n in ids}
            told_apart = _told_apart({(client, n, None): name for n, name in names.items()})
            self._names[client] = {body: name for (_, body, _), name in told_apart}
        return self._names[client]


def _told_apart(names: Mapping[Element, str]) -> Iterator[tuple[Element, str]]:
    """Yield bodies with unique names: bodies of the same name get their ids added."""
    often = Counter(names.values())
    for at, name in names.items():
        alone = name and often[name] == 1
        yield at, name if alone else f"{name} body{at[1]}".strip()


# -- calls that the script makes ------------------------------------------------------------------


def _of_calls(
    named: BodyNames, site: tuple[str, int, str], calls: SeenCalls, patterns: Sequence[Row]
) -> Iterator[Change]:
    """Yield the possible changes to one function's calls from one script line."""
    file, line, function = site
    ids, bodies = tuple(calls.elements), _bodies(named, calls.elements)
    names = tuple(map(named.of_call, ids))
    change = Change(function, "", ("", None), ids, names, site=(file, line), bodies=bodies)
    # Without an argument whose absence breaks, such as a mass, a call breaks, too.
    breaking = any(
        op == "default" and breaks
        for argument in calls.arguments
        for op, breaks in _tried(_row_of(f"{function}.{argument}", patterns))
    )
    for op, breaks in _tried(_row_of(function, patterns)):
        if op in OF_CALLS and (op in ALWAYS or calls.varies):
            broken = breaks or (op == "left-out" and breaking)
            yield replace(change, op=op, how=how_of(op), breaks=broken)
    for argument, value in {**NOT_SAID.get(function, {}), **calls.arguments}.items():
        of_argument = f"{function}.{argument}"
        row = _row_of(of_argument, patterns)
        # The first and the last value of each element: one alone may be 0.
        given = [value, *(element.get(argument) for element in calls.elements.values())]
        bits = [f"^{1 << n}" for n in range(24) if argument == "flags" and value & (1 << n)]
        tried = dict(_tried(row))
        for op, breaks in {**(dict.fromkeys(bits, False) if tried else {}), **tried}.items():
            how = how_of(op, [*row["default"]] if row and op == "=default" else 0.0)
            is_geometry = bool(row and row["is_geometry"])
            if argument in calls.keywords if op == "default" else any(_does(v, how) for v in given):
                one = replace(change, change=of_argument, op=op, how=how, breaks=breaks)
                yield replace(one, is_geometry=is_geometry)


def _bodies(names: BodyNames, elements: Iterable[Sequence[Any]]) -> tuple[str, ...]:
    """Return the names of the bodies in a list of call subjects."""
    found = (names.of("links", element[:2]) for element in elements)
    return tuple(dict.fromkeys(each for each in found if each))


def _row_of(named: str, patterns: Sequence[Row]) -> Row | None:
    """Return the first row that matches a function, or one of its arguments."""
    return next((row for row in patterns if re.fullmatch(row["change"], named)), None)


def _tried(row: Row | None) -> list[tuple[str, bool]]:
    """Return the operators of a row, with flags that are True if an operator removes something."""
    return [] if row is None else [(op, op in row["breaks"]) for op in row["tries"]]


def _does(value: Any, how: tuple[str, Any]) -> bool:
    """Return whether an operator would change a number or a list of numbers."""
    numbers = value if isinstance(value, list) else [value]
    if not numbers or not all(isinstance(number, (int, float)) for number in numbers):
        return False
    if how[0] == "^":
        return True
    if how[0] in ROTATED:
        return isinstance(value, list) and bool(becoming(value, how) != value)
    if isinstance(how[1], list):
        return bool(value != how[1])
    return not isinstance(value, bool) and any(
        becoming(number, how) != number for number in numbers
    )


def _together(changes: Sequence[Change]) -> Iterator[Change]:
    """Yield changes that apply to a function's calls from all lines, if there are several."""
    alike: dict[tuple[str, str], list[Change]] = {}
    for change in changes:
        if change.op not in ("held", "late"):
            alike.setdefault((change.change, change.op), []).append(change)
    for each in alike.values():
        if len(each) > 1:
            named = {id_: of for one in each for id_, of in zip(one.ids, one.of)}
            lines: dict[Any, set[Any]] = {}
            for one in each:
                for id_ in one.ids:
                    lines.setdefault(id_, set()).add(one.site)
            sites = tuple(next(iter(its)) if len(its) == 1 else None for its in lines.values())
            bodies = tuple(dict.fromkeys(body for one in each for body in one.bodies))
            its = replace(each[0], ids=tuple(named), of=tuple(named.values()), bodies=bodies)
            yield replace(its, site=None, sites=sites)


# -- calls that are added -------------------------------------------------------------------------


def _once(row: Row, op: str) -> dict[str, Any]:
    """Return the operation that adds a row's call once for each body, joint or contact."""
    operator, value = how_of(op)
    sets = {**row["fixed"], **dict.fromkeys(row["takes"], (operator, _whole(value)))}
    return {"call": row["call"], "each": row["each"], "sets": sets}


def _whole(value: Any) -> Any:
    return int(value) if isinstance(value, float) and value.is_integer() else value
