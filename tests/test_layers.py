"""Imports between the package's folders match `docs/architecture.md`, and only point downwards."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import drop_physics
import pybullet
from drop_physics.trace.acts import ACTS

PACKAGE = Path(drop_physics.__file__).parent
ARCHITECTURE = (Path(__file__).parents[1] / "docs/architecture.md").read_text(encoding="utf-8")
ROOMS = ARCHITECTURE.partition("## The rooms")[2].partition("\n## Decisions")[0]
ROW = re.compile(r"^\| `(\w+)(?:\.py|/)`(.*?) \| (.*) \| (.*) \|$", re.MULTILINE)
# Room -> its description, and the rooms that it may import, from the top to the bottom.
SAID = {
    room: (more + what, set() if knows == "nothing" else set(knows.split(", ")))
    for room, more, what, knows in ROW.findall(ROOMS)
}
# Library -> the only files that may import it.
ONLY_IN = {
    "pybullet": {"engines/pybullet/engine.py", "engines/pybullet/replay/"},
    "pybullet_data": {"engines/pybullet/engine.py"},
    "rerun": {"recording/"},
    "matplotlib": {"figures/"},
    "typer": {"cli.py", "options.py", "console/running.py", "console/help.py"},
}
CAMEL = re.compile(r"[a-z]+[A-Z]\w*")
OF_MUJOCO = re.compile(r"mj[a-z]?_\w+")
ENGINE = re.compile("(py)?bullet|mujoco|mj", re.IGNORECASE)
LAWS = "drop_physics.physics.laws."
# The judge never imports what it judges.
JUDGE = ("physics/", "explain/", "account/", "rules/", "analysis/", "compare/", "drop/")


@cache
def parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def statements(of: ast.AST) -> Iterator[ast.AST]:
    """Yield the statements within a statement or a module, which are all that can import."""
    for part in ("body", "orelse", "finalbody", "handlers", "cases"):
        for each in getattr(of, part, ()):
            yield each
            yield from statements(each)


@cache
def imports_of(path: Path) -> set[str]:
    modules: set[str] = set()
    for node in statements(parsed(path)):
        if isinstance(node, ast.Import):
            modules |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            modules |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
    return modules


FILES = {str(path.relative_to(PACKAGE)): path for path in sorted(PACKAGE.rglob("*.py"))}


def room_of(*parts: str) -> str:
    """Return the folder of the package (the room) to which a module belongs."""
    first = parts[0].removesuffix(".py")
    parts_of = {"scenario": ("fields", "option_types")}
    parts_of["workers"] = ("loading", "installed", "temporary", "address_space")
    return next((room for room, files in parts_of.items() if first in files), first)


@cache
def knows(room: str) -> set[str]:
    """Return the folders of the package that a folder imports from."""
    paths = [path for name, path in FILES.items() if room_of(*Path(name).parts) == room]
    modules = [
        module
        for path in paths
        for module in imports_of(path)
        if module.startswith("drop_physics.")
    ]
    return {room_of(*module.split(".")[1:]) for module in modules} - {
        room,
        "arrays",
        "errors",
        "messages",
    }


def test_a_room_knows_what_the_architecture_says_and_nothing_else() -> None:
    for room, (_, known) in SAID.items():
        assert knows(room) == known, room


def test_imports_point_down_only() -> None:
    from_the_top = list(SAID)
    for number, room in enumerate(from_the_top):
        assert knows(room) <= set(from_the_top[number + 1 :]), room


def test_the_picture_shows_every_import_that_does_not_follow_from_others() -> None:
    reached: dict[str, set[str]] = {}
    arrows: set[tuple[str, str]] = set()
    for room in reversed(SAID):
        known = knows(room)
        beyond = set().union(*(reached[other] for other in known))
        reached[room] = known | beyond
        arrows |= {(room, other) for other in known - beyond}
    drawn = re.findall(r"^ +(\w+) --> (.+)$", ROOMS, re.MULTILINE)
    assert {(room, target) for room, to in drawn for target in to.split(" & ")} == arrows


def test_every_file_is_in_a_room_and_says_what_it_is_for() -> None:
    for name, path in FILES.items():
        assert path.stem in ("__init__", "__main__") or room_of(*Path(name).parts) in SAID, name
        first, *_ = (ast.get_docstring(parsed(path)) or "").split("\n")
        assert first.endswith("."), name


def test_libraries_stay_in_their_rooms() -> None:
    for name, path in FILES.items():
        libraries = {module.split(".")[0] for module in imports_of(path)}
        for library in libraries & set(ONLY_IN):
            assert name.startswith(tuple(ONLY_IN[library])), f"{name} imports {library}"


def test_the_judge_knows_neither_engine_nor_recorder() -> None:
    unknown = (
        "pybullet",
        "rerun",
        "drop_physics.recording",
        "drop_physics.engines.pybullet.world",
        "drop_physics.engines.pybullet.engine",
    )
    for name in (name for name in FILES if name.startswith(JUDGE)):
        assert not any(module.startswith(unknown) for module in imports_of(FILES[name])), name


def names_in(path: Path) -> set[str]:
    """Return all names that a file defines or uses, including its own and its folders' names."""
    found = {*path.relative_to(PACKAGE).with_suffix("").parts}
    for node in ast.walk(parsed(path)):
        for name in ("id", "attr", "arg", "name", "asname"):
            found.add(getattr(node, name, None) or "")
    return found


def test_nothing_of_the_judge_is_named_after_an_engine() -> None:
    """Outside `physics/laws`, the judge imports nothing that is named after an engine."""
    neutral = [
        name
        for name in FILES
        if name.startswith(("trace/", "physics/", "explain/", "analysis/"))
        and not name.startswith("physics/laws/")
    ]
    for name in neutral:
        words = {each for each in names_in(FILES[name]) if ENGINE.search(each)}
        assert not words, f"{name}: {words}"
        laws = {each for each in imports_of(FILES[name]) if each.startswith(LAWS)}
        assert laws <= {f"{LAWS}lookup", f"{LAWS}lookup.RIGID", f"{LAWS}lookup.step_law"}, name
    own = {name.removeprefix("physics/laws/") for name in FILES if name.startswith("physics/laws/")}
    assert all(ENGINE.match(each) for each in own - {"__init__.py", "lookup.py"})


def test_help_loads_no_heavy_library() -> None:
    code = (
        "import sys; sys.argv = ['drop', '--help']\n"
        "from drop_physics import cli\n"
        "try: cli.main()\n"
        "except SystemExit: pass\n"
        "heavy = {'numpy', 'polars', 'pybullet', 'rerun', 'matplotlib', 'scipy', 'PIL'}\n"
        "print(sorted(heavy & set(sys.modules)), file=sys.stderr)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "Usage: drop" in done.stdout
    assert done.stderr.strip() == "[]"


def test_every_public_name_exists_and_is_known_to_type_checkers() -> None:
    tree = ast.parse((PACKAGE / "__init__.py").read_text(encoding="utf-8"))
    (typed,) = [node for node in tree.body if isinstance(node, ast.If)]
    declared = [
        alias.asname
        for node in typed.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    ]
    assert sorted(declared) == sorted(drop_physics.__all__)
    for name in drop_physics.__all__:
        assert getattr(drop_physics, name).__name__ == name


def test_an_analysis_loads_no_library_that_few_need() -> None:
    """Each takes as long to import as everything else together, so it is imported when needed."""
    command = "import sys, drop_physics.drop.analysis; print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", command],
        capture_output=True,
        text=True,
        check=True,
        cwd=PACKAGE.parent,
    )
    assert not {"scipy", "matplotlib", "pybullet", "rerun", "mujoco"} & {*done.stdout.split()}


def test_only_the_trace_and_engines_know_the_name_of_a_call() -> None:
    """These are functions of PyBullet and MuJoCo, and memory writes that count as calls."""
    functions = [name for name in dir(pybullet) if callable(getattr(pybullet, name))]

    def is_call(word: str) -> bool:
        named = CAMEL.fullmatch(word) and any(function.startswith(word) for function in functions)
        return bool(named or OF_MUJOCO.fullmatch(word) or word in ACTS)

    found = {
        f"{name}:{node.lineno}: {node.value}"
        for name, path in FILES.items()
        if room_of(*Path(name).parts) not in ("trace", "engines")
        for node in ast.walk(parsed(path))
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and is_call(node.value)
    }
    assert found == set()
