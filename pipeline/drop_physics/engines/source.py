"""Finds single edits of the user's files to try: numbers, attributes, statements.

The files are the script, its own modules, and the models that these name. Candidates are edits that
a user would make: to each number, to each attribute of a model (also of models inside a script),
and to each statement that sets a value. Code that only determines what is measured is not edited:
bounds of outermost loops, indices, and values that are printed, asserted, or compared.
"""

from __future__ import annotations

import ast
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate, zip_longest
from typing import Any, NamedTuple, TypeGuard

from drop_physics.engines.watching.expression import EPISODE, PRINTED, SERIES, TAKEN
from drop_physics.engines.watching.operators import becoming
from drop_physics.engines.watching.single_changes import MOST_NAMES, Change, how_of
from drop_physics.fields import all_of
from drop_physics.messages import Message

SOURCE = "source"
"""Value of `engine` for changes of a script's text."""
NUMBERS = ("*10", "*0.1", "*-1", "=0")
SIZES, PLACES = ("*2", "*0.5"), ("*2", "*0.5", "*-1")
COUNTS = ("*10", "*0.1")
LEFT_OUT = "left-out"
NUMBER, COUNT, INDEX = "number", "range", "index"
"""Names for a number that is not assigned to anything, for the count of an inner loop, and for the
index of an element that is set."""
NEXT = ("+1", "-1")
DEGREES = 0.017453292519943295
"""Factor that converts degrees to radians [rad/degree]."""
LARGEST_RAD, LARGEST_DEGREES = 6.3, 720.0
"""Range of numbers that may be angles in degrees."""
ANGLES = re.compile(r"^(joint\.(range|ref)|limit\.(lower|upper)|origin\.rpy)$")
"""Attributes that may have been given in the wrong unit of angle."""
TO_RADIANS, TO_DEGREES = f"*{DEGREES:.9g}", f"*{1 / DEGREES:.9g}"
"""Operators that convert such an attribute to the other unit."""
TIMESTEP = "option.timestep"
PACED = 10.0
"""Factor on the number of steps that a run may make if a change sets the length of a step."""
MEASURES = re.compile(
    r"^(print|round|range|enumerate|sleep|append|extend|add_argument|format|isclose|allclose|exit|"
    r"savetxt|plot|show|join|disconnect|connect|stepSimulation|mj_step\d?|mj_forward|reset|step|"
    r"render|write_text|write|close|flush|mkdir|mkdtemp|seed|default_rng|parse_args|"
    r"setAdditionalSearchPath|loadURDF|loadMJCF|loadSDF|from_xml_\w+|log|info|debug|warning)$"
)
"""Functions whose calls are never removed: they measure, print, or create the scene."""
ENGINES = re.compile(r"^(set|change|create|load|reset|apply|calculate|enable)[A-Z]\w*$")
"""Functions of PyBullet, whose arguments are changed by interventions instead."""
COLLECTS = re.compile(r"^(join|zip|map|dict|tuple|list|array|asarray|deg2rad|radians)$")
"""Functions whose arguments are named after the variable or argument that gets the result."""
FIELDS = re.compile(
    r"^(friction|mass|damping|stiffness|armature|frictionloss|gravcomp|kp|kv|gear|solref|solimp|"
    r"condim|integrator|cone|iterations|limited|\w+limited|density|impratio|gravity|"
    r"i[xyz][xyz]|diaginertia|fullinertia|value|noslip_iterations|effort|velocity)$"
)
"""Attributes whose values are changed in the compiled model, or by a call, instead."""
SPARED = re.compile(
    r"^(print|round|range|enumerate|sleep|format|isclose|allclose|approx|savetxt|plot|exit|seed|"
    r"default_rng|RandomState|linspace|getenv|get|reshape|astype|zeros|ones|eye|percentile)$"
)
"""Functions whose numbers are not edited: they set how much is measured, shown or created, or draw
random numbers."""
PURE = re.compile(r"^(np|numpy|math|abs|min|max|sum|float|int|list|tuple|len|norm|sorted|array)\b")
"""Functions without side effects."""
ARGUMENTS = ("argv", "environ", "__name__")
MODEL = re.compile(r"\.(xml|mjcf|urdf|sdf)$")
"""Pattern of a model's file name."""
COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)
TAGGED = re.compile(
    r"<(?P<tag>[a-zA-Z]\w*)(?P<given>(?:\s+[\w:]+\s*=\s*\\?(?P<q>[\"']).*?(?P=q))+)\s*(?P<end>/?)>"
)
"""Pattern of a tag with attributes, in text that may be Python."""
ATTRIBUTE = re.compile(r"\s+(?P<name>[\w:]+)\s*=\s*\\?(?P<q>[\"'])(?P<value>.*?)\\?(?P=q)")
NAME = re.compile(r"\bname\s*=\s*\\?([\"'])(?P<name>.*?)\\?\1")
REFERS = re.compile(
    r"^(name|class|childclass|\w*joint\w*|\w*site\w*|\w*body\w*|mesh\w*|link|rgba|\w*file\w*|"
    r"version|model|angle|geom\w*|tendon|target|material|texture|hfield|type|root|xmlns\S*|"
    r"mimic|builtin|rgb\d|group|dclass|compiler|coordinate|eulerseq|\w*dir|texrepeat|reflectance)$"
)
"""Attributes that name an element, or set how the model is written or looks."""
SHOWS = re.compile(
    r"^(visual|material|texture|camera|light|map|headlight|global|quality|scale|rgba|key|statistic|"
    r"color|sensor|limit_display|size|compiler|asset|mujoco|robot|xml)$"
)
"""Tags without influence on the physics."""
SHAPES = re.compile(
    r"^(size|pos|fromto|xyz|rpy|radius|length|quat|euler|axisangle|zaxis|height|halfExtents|"
    r"axis|ref|range|lower|upper)$"
)
"""Attributes and arguments that set positions and sizes."""
POSITIVE = re.compile(
    r"^(size|radius|length|height|halfExtents|meshScale|globalScaling|\w*[mM]ass|"
    r"\w*([fF]riction|[dD]amping|[sS]tiffness|maxForce))$"
)
"""Attributes and arguments whose sign has no meaning."""
NEEDED = re.compile(r"^(size|fromto|radius|length|height|axis)$")
"""Attributes and arguments that can never, or seldom, be removed."""
BEGINS = re.compile(
    r"(^body\.(pos|quat|euler)|basePosition|baseOrientation|posObj|ornObj|\.qpos\b|"
    r"^data\.qpos|resetBasePosition\w*|resetJointState\w*\.?|\.qpos0)"
)
"""Changes of initial positions, which are seldom the mistake, and may be what an expectation is
about."""


@dataclass(frozen=True)
class TextPart:
    """A piece of a source file that an edit may replace."""

    name: str
    """The variable, argument or attribute to which the piece gives a value: `KP`,
    `changeDynamics.lateralFriction`, `geom.friction`."""
    of: str
    """The element to which the text belongs, such as a body; if there is none, the number itself.
    """
    line: int
    start: int
    end: int
    tries: tuple[str, ...]
    without: str = ""
    """The text that replaces the piece if it is removed."""
    again: bool = False
    """Whether the piece is inside a loop."""
    in_markup: bool = False
    """Whether the piece is an attribute in a model's XML."""
    is_count: bool = False
    """Whether the piece is the count of a loop, which must stay a whole number."""
    paces: bool = False
    """Whether the number of the script's steps depends on it."""

    @property
    def breaks(self) -> bool:
        """True if the piece sets an initial value, before the first step."""
        return not self.again and BEGINS.search(self.name) is not None

    @property
    def is_geometry(self) -> bool:
        """True if the piece sets a position or a size."""
        return SHAPES.match(self.name.rpartition(".")[2]) is not None


class PlacedText(NamedTuple):
    """A piece of a source file, with its location."""

    path: str
    """The file; empty for the script."""
    start: int
    end: int
    was: str
    without: str
    """The text that replaces the piece if it is removed."""
    where: str
    """File and line."""
    is_count: bool
    paces: bool


def changes_of(text: bytes, file: str, expected: str, path: str = "") -> list[Change]:
    """Return the edits that may be tried in a file; none if it is invalid Python.

    An attribute that many elements of a model have is changed for all of them at once.

    Parameters
    ----------
    text
        The UTF-8 text of a script, a module, or a model in XML.
    file
        The displayed name of the file.
    expected
        The expectation about the script; values with which it compares are not changed.
    path
        The path of the file; empty for the script.
    """
    is_model = MODEL.search(path) is not None
    try:
        tree = ast.parse("" if is_model else text.decode())  # another encoding has other places
    except (SyntaxError, ValueError):
        return []
    found: dict[tuple[str, int | None], list[TextPart]] = {}
    parts = _TextParts(tree, text, _feeding(tree, expected))
    for each in parts.of_model() if is_model else parts.all():
        found.setdefault((each.name, None if each.in_markup else each.line), []).append(each)
    changes: list[Change] = []
    for places in found.values():
        names = [*_told_apart([each.of for each in places])]
        groups = [[*zip(places, names, strict=True)]]
        if not places[0].in_markup or len(places) <= MOST_NAMES:
            groups = [[each] for each in groups[0]]
        for group in groups:
            changes += _of_places(group, text, file, path)
    return changes


def _told_apart(names: Sequence[str]) -> Iterator[str]:
    """Yield names, with numbers appended to repeated ones."""
    alike, seen = Counter(names), Counter[str]()
    for name in names:
        seen[name] += 1
        yield f"{name}#{seen[name]}" if name and alike[name] > 1 else name


def _of_places(
    group: Sequence[tuple[TextPart, str]], text: bytes, file: str, path: str
) -> Iterator[Change]:
    """Yield the changes that edit several places of a file together."""
    first, _ = group[0]
    for op in dict.fromkeys(op for each, _ in group for op in each.tries):
        its = [
            (each, name, was)
            for each, name in group
            for was in (text[each.start : each.end].decode(errors="replace"),)
            if op in each.tries and _does(was, op)
        ]
        if its:
            yield Change(
                first.name,
                op,
                (op, None) if op == LEFT_OUT else how_of(op),
                tuple(
                    PlacedText(
                        path,
                        e.start,
                        e.end,
                        was,
                        e.without,
                        f"{file}:{e.line}",
                        e.is_count,
                        e.paces,
                    )
                    for e, _, was in its
                ),
                tuple(name for _, name, _ in its),
                breaks=first.breaks,
                site=None if first.in_markup else (file, first.line),
                engine=SOURCE,
                is_geometry=first.is_geometry,
            )


def edits_of(change: Change) -> list[list[Any]]:
    """Return the text edits that make a change."""
    return [[each.path, each.start, each.end, _becomes(change, each)] for each in change.ids]


def repeats(change: Change) -> float:
    """Return the factor by which a change may lengthen a run, such as by repeating a loop.

    The factor is 1 for changes of anything but a loop's count.
    """
    if paces(change):
        return PACED
    return max(1.0, change.how[1]) if any(each.is_count for each in change.ids) else 1.0


def paces(change: Change) -> bool:
    """Return whether a change sets the length of a step, and so perhaps the number of steps."""
    return change.engine == SOURCE and any(each.paces for each in change.ids)


def converts_unit(change: Change) -> bool:
    """Return whether a change converts an attribute between degrees and radians."""
    return change.engine == SOURCE and change.op in (TO_RADIANS, TO_DEGREES)


def place_of(change: Change) -> tuple[str, str]:
    """Return the file and line that a change edits, and the source text there, e.g. `KP=5`."""
    first: PlacedText = change.ids[0]
    is_value = change.op != LEFT_OUT and change.change not in (NUMBER, COUNT, INDEX)
    return first.where, f"{change.change}={first.was}" if is_value else _in_a_line(first.was)


def words_of(change: Change) -> str:
    """Describe a change, with the current source text and its location."""
    first: PlacedText = change.ids[0]
    was, where = first.was, first.where
    of = all_of([each.partition("#")[0] for each in change.of])
    if change.op == LEFT_OUT:
        return Message("without {was} ({where})", was=_in_a_line(was), where=where)
    does = {"becomes": _becomes(change, first).strip("()"), "was": was, "where": where}
    if change.change in (NUMBER, COUNT):
        return Message("{becomes} in place of {was} ({where})", **does)
    if not of or of == was:
        return Message("{name} {becomes} in place of {was} ({where})", name=change.change, **does)
    return Message(
        "{name} of {of} {becomes} in place of {was} ({where})", name=change.change, of=of, **does
    )


MOST_SHOWN = 50
"""Largest number of characters of source text that are shown."""


def _in_a_line(text: str) -> str:
    line = " ".join(text.split())
    return line if len(line) <= MOST_SHOWN else f"{line[:MOST_SHOWN]}…"


def _numbers(text: str) -> list[float] | None:
    """Return the numbers in a text; None if it contains anything else."""
    try:
        return [float(each) for each in text.replace("_", "").split()]
    except ValueError:
        return None


def _does(was: str, op: str) -> bool:
    """Return whether an operator alters a text."""
    if op == LEFT_OUT:
        return True
    numbers = _numbers(was) or []
    return _made(numbers, how_of(op)) != numbers


def _made(numbers: list[float], how: tuple[str, Any]) -> list[float]:
    """Return the numbers after a change."""
    operator, operand = how
    made: list[float] = becoming(numbers, (operator, [operand] * len(numbers)))
    return made


def _becomes(change: Change, place: PlacedText) -> str:
    """Return the text after a change."""
    if change.op == LEFT_OUT:
        return place.without
    made = _made(_numbers(place.was) or [], change.how)
    if place.is_count:
        made = [max(1, round(each)) for each in made]
    whole = not re.search(r"[.eE]", place.was)
    texts = [f"{int(each)}" if whole and each == int(each) else f"{each:.10g}" for each in made]
    if len(texts) == 1 and texts[0].startswith("-") and not place.without:
        return f"({texts[0]})"  # in Python it may follow an operator
    return " ".join(texts)


# -- what only feeds the expectation ---------------------------------------------------------------


def _feeding(tree: ast.AST, expected: str) -> set[str]:
    """Return the names of the script's constants that an expectation refers to.

    A constant is computed from numbers by arithmetic alone.
    """
    try:
        asked = ast.parse(expected.strip(), mode="eval")
    except (SyntaxError, ValueError):
        return set()
    names = {node.id for node in ast.walk(asked) if isinstance(node, ast.Name)}
    names -= {*SERIES, *TAKEN, *EPISODE, PRINTED}
    values: dict[str, list[ast.expr | None]] = {}
    for node in ast.walk(tree):
        for name, value in _assigned(node):
            values.setdefault(name, []).append(value)
    feeding: set[str] = set()
    while new := {name for name in names - feeding if _is_computed(values.get(name, []))}:
        feeding |= new
        names |= {
            node.id
            for name in new
            for value in values[name]
            if value is not None
            for node in ast.walk(value)
            if isinstance(node, ast.Name)
        }
    return feeding


def _assigned(node: ast.AST) -> Iterator[tuple[str, ast.expr | None]]:
    """Yield the names that a statement assigns, each with its value; None if it is unknown."""
    targets: Sequence[ast.expr] = ()
    value: ast.expr | None = None
    if isinstance(node, ast.Assign):
        targets, value = node.targets, node.value
    elif isinstance(node, ast.AnnAssign):
        targets, value = [node.target], node.value
    elif isinstance(node, ast.AugAssign | ast.For):
        targets = [node.target]
    for target in targets:
        if isinstance(target, ast.Tuple | ast.List):
            parts = value.elts if isinstance(value, ast.Tuple | ast.List) else []
            pairs = [*zip_longest(target.elts, parts)]
        else:
            pairs = [(target, value)]
        yield from ((one.id, its) for one, its in pairs if isinstance(one, ast.Name))


def _is_computed(values: Sequence[ast.expr | None]) -> bool:
    """Return whether values are numbers, or are computed from numbers."""
    return bool(values) and all(
        value is not None
        and all(
            PURE.match(ast.unparse(node.func))
            for node in ast.walk(value)
            if isinstance(node, ast.Call)
        )
        and not any(isinstance(node, ast.Lambda) for node in ast.walk(value))
        for value in values
    )


# -- which parts ----------------------------------------------------------------------------------


class _TextParts:
    """Finds the pieces of a source file that an edit may replace."""

    def __init__(self, tree: ast.Module, text: bytes, feeding: set[str]) -> None:
        self._tree, self._text, self._feeding = tree, text, feeding
        self._lines = [0, *accumulate(len(each) + 1 for each in text.split(b"\n"))]
        self._loops = 0
        """Number of loops around the current part."""
        self._repeated = {*_called_in_loops(tree)}
        self._counts = {*_counting(tree)}
        self._paces = {*_pacing(tree)}

    def all(self) -> Iterator[TextPart]:
        """Yield the replaceable pieces in the order of the file."""
        for each in self._tree.body:
            yield from self._of(each, "", "")

    def of_model(self) -> Iterator[TextPart]:
        """Yield the replaceable pieces of a text that contains a model."""
        return self._of_markup(0, len(self._text))

    def _of_loop(self, node: ast.For | ast.While) -> Iterator[TextPart]:
        """Yield the pieces of a loop, without the numbers that it iterates over.

        The count of an inner loop is one of the pieces, since the outer loop continues after it: it
        may be the number of steps per command.
        """
        if isinstance(node, ast.For) and not _are_whole(node.iter):
            yield from self._of(node.iter, "", "")
            if self._loops and _counts(node.iter):
                for bound in filter(_is_number, node.iter.args):
                    yield from self._of_constant(bound, COUNT)
        self._loops += 1
        for each in (*node.body, *node.orelse):
            yield from (replace(place, again=True) for place in self._of(each, "", ""))
        self._loops -= 1

    def _at(self, node: ast.expr | ast.stmt) -> tuple[int, int]:
        start = self._lines[node.lineno - 1] + node.col_offset
        assert node.end_lineno is not None
        assert node.end_col_offset is not None
        return start, self._lines[node.end_lineno - 1] + node.end_col_offset

    def _of(self, node: ast.AST, name: str, function: str) -> Iterator[TextPart]:
        """Yield the pieces below a syntax node, given the assigned name and the called function."""
        if isinstance(node, ast.Assert | ast.Import | ast.ImportFrom | ast.FormattedValue):
            return
        if isinstance(node, ast.Compare) and _asks_for_arguments(node):
            return
        if isinstance(node, ast.Subscript):  # an index is where something is, not how much
            yield from self._of(node.value, name, function)
        elif isinstance(node, ast.For | ast.While):
            yield from self._of_loop(node)
        elif isinstance(node, ast.comprehension) and _are_whole(node.iter):
            return
        elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield from self._of_function(node)
        elif isinstance(node, ast.JoinedStr):
            yield from self._of_markup(*self._at(node))
        elif isinstance(node, ast.Constant | ast.UnaryOp) and (
            _is_number(node) or isinstance(node, ast.Constant)
        ):
            yield from self._of_constant(node, name)
        elif isinstance(node, ast.Call):
            yield from self._of_call(node, name)
        elif isinstance(node, ast.Expr | ast.Assign | ast.AugAssign | ast.AnnAssign):
            yield from self._of_statement(node, function)
        elif isinstance(node, ast.If | ast.While | ast.IfExp) and _asks_for_arguments(node.test):
            for each in (each for each in ast.iter_child_nodes(node) if each is not node.test):
                yield from self._of(each, name, function)
        else:
            for each in ast.iter_child_nodes(node):
                yield from self._of(each, name, function)

    def _of_function(self, node: ast.FunctionDef | ast.AsyncFunctionDef) -> Iterator[TextPart]:
        given = [*node.args.posonlyargs, *node.args.args]
        defaults = [*zip(given[::-1], node.args.defaults[::-1], strict=False)]
        for argument, value in [*defaults, *zip(node.args.kwonlyargs, node.args.kw_defaults)]:  # noqa: B905
            if value is not None:
                yield from self._of(value, f"{node.name}.{argument.arg}", node.name)
        self._loops += node.name in self._repeated
        for each in node.body:
            yield from self._of(each, node.name, node.name)
        self._loops -= node.name in self._repeated

    def _of_call(self, node: ast.Call, name: str) -> Iterator[TextPart]:
        function = _last(node.func)
        if isinstance(node.func, ast.Attribute):
            yield from self._of(node.func.value, name, function)
        if SPARED.match(function) or _asks_for_arguments(node):
            return
        of_engine = ENGINES.match(function) is not None
        passes = COLLECTS.match(function) or PURE.match(ast.unparse(node.func))
        for each in node.args:
            if not (of_engine and (_is_number(each) or _are_whole(each))):
                yield from self._of(each, name if passes and name else function, function)
        for keyword in node.keywords:
            if not (of_engine and _is_number(keyword.value)):
                yield from self._of(keyword.value, f"{function}.{keyword.arg}", function)

    def _of_statement(
        self, node: ast.Expr | ast.Assign | ast.AugAssign | ast.AnnAssign, function: str
    ) -> Iterator[TextPart]:
        if isinstance(node, ast.Expr):
            name, sets = "", isinstance(node.value, ast.Call)
            function = _last(node.value.func) if isinstance(node.value, ast.Call) else function
            if sets and (MEASURES.match(function) or ENGINES.match(function)):
                sets = False
        else:
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            name = ast.unparse(targets[0]).replace(" ", "")
            sets = all(isinstance(each, ast.Attribute | ast.Subscript) for each in targets)
            sets = sets and not name.startswith(("self.", "os.", "sys."))
            if {ast.unparse(each) for each in targets} & self._feeding:
                return
            for each in targets:
                yield from self._of_index(each)
        if sets:
            start, end = self._at(node)
            lines = (node.end_lineno or node.lineno) - node.lineno
            what, without = name or function, "pass" + "\n" * lines
            yield TextPart(what, "", node.lineno, start, end, (LEFT_OUT,), without=without)
        if node.value is not None:
            yield from self._of(node.value, name, function)

    def _of_index(self, target: ast.expr) -> Iterator[TextPart]:
        """Yield the integers that select the element of an array to set."""
        if not isinstance(target, ast.Subscript):
            return
        of = ast.unparse(target).replace(" ", "")
        places = target.slice.elts if isinstance(target.slice, ast.Tuple) else [target.slice]
        for each in places:
            if isinstance(each, ast.Constant) and type(each.value) is int:
                tries = NEXT if each.value else NEXT[:1]  # the last one is not the one before 0
                yield TextPart(INDEX, of, each.lineno, *self._at(each), tries, without=" ")

    def _of_constant(self, node: ast.expr, name: str) -> Iterator[TextPart]:
        start, end = self._at(node)
        was = self._text[start:end].decode(errors="replace")
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield from self._of_markup(start, end)
        elif _is_number(node) and (numbers := _numbers(was)) and numbers[0]:  # decimal, and not 0
            tries: tuple[str, ...] = NUMBERS
            is_count = name == COUNT or name in self._counts
            if is_count:
                tries = tuple(op for op in COUNTS if round(numbers[0] * float(op[1:])) >= 1)
            elif POSITIVE.match(name.rpartition(".")[2]):
                tries = tuple(op for op in tries if op != "*-1")
            elif LARGEST_RAD < abs(numbers[0]) <= LARGEST_DEGREES:
                tries = (*tries, f"*{DEGREES}")
            part = TextPart(name or NUMBER, was, node.lineno, start, end, tries)
            yield replace(part, is_count=is_count, paces=name in self._paces)

    def _of_markup(self, start: int, end: int) -> Iterator[TextPart]:
        """Yield attributes of model XML within the text, and elements without children."""
        text = self._text[start:end].decode("latin-1")  # a character for each byte
        text = COMMENT.sub(lambda found: " " * len(found[0]), text)
        near = ""
        for found in TAGGED.finditer(text):
            named, tag = NAME.search(found["given"]), found["tag"]
            of = named["name"] if named else near
            near = of if named and not found["end"] else near
            if SHOWS.match(tag):
                continue
            for each in ATTRIBUTE.finditer(found[0]):
                at = start + found.start() + each.start()
                value = start + found.start() + each.start("value")
                yield from self._of_attribute(tag, of, each, at, value)

    def _of_attribute(
        self, tag: str, near: str, found: re.Match[str], at: int, value: int
    ) -> Iterator[TextPart]:
        name, numbers = found["name"], _numbers(found["value"])
        if REFERS.match(name) or FIELDS.match(name) or "{" in found["value"]:
            return
        if BEGINS.search(f"{tag}.{name}"):
            return
        if numbers is not None and not any(numbers):
            return
        line = self._text.count(b"\n", 0, value) + 1
        of, own = near.encode("latin-1").decode(errors="replace"), f"{tag}.{name}"
        if numbers:
            tries: tuple[str, ...] = PLACES if SHAPES.match(name) else NUMBERS
            tries = SIZES if POSITIVE.match(name) else tries
            tries = PLACES[-1:] if name == "axis" else tries
            tries = COUNTS if own == TIMESTEP else tries
            if ANGLES.match(own):
                is_large = max(map(abs, numbers)) > LARGEST_RAD
                tries = (*tries, TO_RADIANS if is_large else TO_DEGREES)
            end = value + len(found["value"])
            part = TextPart(own, of, line, value, end, tries, " ", in_markup=True)
            yield replace(part, paces=own == TIMESTEP)
        if not NEEDED.match(name):
            end = at + len(found[0])
            part = TextPart(own, of, line, at, end, (LEFT_OUT,), " ", in_markup=True)
            yield replace(part, paces=own == TIMESTEP)


def _asks_for_arguments(node: ast.AST) -> bool:
    """Return whether an expression depends on command-line arguments."""
    return any(
        getattr(each, "attr", getattr(each, "id", None)) in ARGUMENTS for each in ast.walk(node)
    )


def _called_in_loops(tree: ast.AST) -> Iterator[str]:
    """Yield the names of the functions that a text calls within loops."""
    loops = (each for each in ast.walk(tree) if isinstance(each, ast.For | ast.While))
    inside = (each for loop in loops for each in ast.walk(loop))
    return (_last(each.func) for each in inside if isinstance(each, ast.Call))


def _counts(node: ast.AST) -> TypeGuard[ast.Call]:
    """Return whether an expression is a call of `range`."""
    return isinstance(node, ast.Call) and _last(node.func) == COUNT


def _counting(tree: ast.AST) -> Iterator[str]:
    """Yield the variables that set how often loops are repeated."""
    for call in filter(_counts, ast.walk(tree)):
        yield from (each.id for each in call.args if isinstance(each, ast.Name))


def _pacing(tree: ast.AST) -> Iterator[str]:
    """Yield the variables by which the number of a loop's repetitions is divided: timesteps."""
    for call in filter(_counts, ast.walk(tree)):
        for each in ast.walk(call):
            match each:
                case ast.BinOp(op=ast.Div() | ast.FloorDiv(), right=ast.Name(id=name)):
                    yield name


def _is_number(node: ast.AST) -> bool:
    """Return whether a node is a number literal, with its sign."""
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        node = node.operand
    value = node.value if isinstance(node, ast.Constant) else None
    return isinstance(value, int | float) and not isinstance(value, bool)


def _are_whole(node: ast.AST) -> bool:
    """Return whether a node is a list of integers, such as joint indices."""
    return isinstance(node, ast.Tuple | ast.List) and all(
        isinstance(each, ast.Constant) and isinstance(each.value, int) for each in node.elts
    )


def _last(function: ast.expr) -> str:
    """Return the name of a function without the object or module before the dot."""
    return ast.unparse(function).rpartition(".")[2] if not isinstance(function, ast.Call) else ""
