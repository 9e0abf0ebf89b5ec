"""Write JSON Schemas of what `--json` prints, from the types that it is made of, and a page of it.

A schema describes every key. Required are those of the contract, which stay; more may come.
"""

from __future__ import annotations

import ast
import inspect
import json
import re
import textwrap
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple, get_args, get_origin, get_type_hints

import polars as pl

from generators.recording import TABLE_SAYS
from pipeline.analysis.drop.comparison import Comparison, Place, Setting
from pipeline.analysis.drop.convergence import Study
from pipeline.analysis.drop.results import (
    Airborne,
    Analysis,
    Conservation,
    Explained,
    Finding,
    Impact,
    Moment,
    Rest,
    SegmentCounts,
    Terms,
)
from pipeline.analysis.general.flights import Flight, VectorTerms
from pipeline.analysis.general.statistics import Summary
from pipeline.analysis.script import results as script
from pipeline.analysis.script.cause import OtherCall
from pipeline.analysis.script.comparison import ScriptComparison
from pipeline.analysis.script.difference import Difference
from pipeline.fields import UNIONS
from pipeline.report import EngineReport
from pipeline.scenario import Scenario
from pipeline.seen import Call
from pipeline.stages.check import Check
from pipeline.stages.info import Info
from pipeline.stages.render import Rendering
from pipeline.stages.simulate import Simulation
from pipeline.stages.sweep_engines import EngineRun
from pipeline.sweeping.folder import SCHEMA as SWEEP_COLUMNS
from pipeline.sweeping.folder import TERMS

Schema = dict[str, Any]

SCALARS: dict[Any, Schema] = {
    Any: {},
    bool: {"type": "boolean"},
    float: {"type": "number"},
    int: {"type": "integer"},
    Path: {"type": "string"},
    str: {"type": "string"},
}
COLUMNS: dict[Any, Any] = {pl.Boolean: bool, pl.Float64: float, pl.Int64: int, pl.String: str}
"""What a column's values are in JSON; the others are vectors."""
CONTRACT: dict[type, set[str]] = {
    Airborne: {"samples", "max_abs_error_m", "rms_error_m", "max_abs_rounding_m"},
    Conservation: {
        "energy_initial_j", "energy_max_rel_drift", "angular_momentum_max_rel_drift",
    },
    Explained: {"samples", "of", "until_s", "why"},
    Finding: {"code", "message"},
    Flight: {"first_step", "last_step", "start_s", "end_s", "error_m", "terms_m"},
    Impact: {
        "time_free_fall_s", "time_damped_s", "time_simulated_s", "step", "lowest_m", "lowest_step",
        "penetration_m",
    },
    Moment: {"time_s", "step", "phase", "simulated_m", "free_fall_m", "error_m", "terms_m"},
    Place: {"step", "column"},
    Rendering: {"gif", "frames", "fps", "plot"},
    Rest: {"height_m", "expected_m", "error_m", "settled_step"},
    Scenario: {one.name for one in fields(Scenario)},
    SegmentCounts: {one.name for one in fields(SegmentCounts)},
    Simulation: {"recording", "recording_id", "samples", "frames", "bytes", "wall_s"},
    Terms: {"timestep", "damping", "interaction", "rounding"},
    VectorTerms: {"timestep", "damping", "interaction", "rounding"},
    script.BodyAnalysis: {
        "name", "label", "id", "segments", "flights", "contacts", "unexplained", "energy",
    },
    script.Moment: {"step", "time_s", "error_m", "terms_m"},
    script.Pusher: {"body", "id", "link", "impulse_n_s", "energy_j"},
    script.ScriptContact: {
        "first_step", "last_step", "start_s", "end_s", "impulse_n_s", "energy_j", "by",
    },
    script.ScriptFinding: {"code", "message", "body", "step", "site"},
    script.ScriptFlight: {
        "first_step", "last_step", "start_s", "end_s", "error_m", "terms_m", "at",
    },
    script.Unexplained: {"reason", "samples", "first_step", "deviation"},
}  # fmt: skip
"""Keys that stay, by what they are made of; `COMMANDS` has those of a whole command."""

_HEAD = """# JSON

*Made by `python docs/regenerate.py` from the types that the program prints. The folder
`docs/schemas/` says the same in JSON Schema (draft 2020-12); the tests validate real output
against it.*

With `--json` a command prints exactly one JSON object to standard output. Units are in the names.
Keys marked • stay as they are; more keys may come. What does not exist is `null`.
"""


class Object(NamedTuple):
    """A JSON object: its keys with their types, what is said of them, and which of them stay."""

    keys: Mapping[str, Any]
    said: Mapping[str, str] = {}
    stays: frozenset[str] = frozenset()
    more: str = ""
    """What other keys it has, that are not known beforehand."""


def _object(kind: Any, stays: set[str] | None = None, /, **instead: Any) -> Object:  # noqa: ANN401
    """Return what a dataclass is printed as; a key of another type, or of none, is given."""
    hints = {one.name: get_type_hints(kind)[one.name] for one in fields(kind)} | instead
    keys = {name: hint for name, hint in hints.items() if hint is not None}
    return Object(keys, _said(kind), frozenset(CONTRACT.get(kind, ()) if stays is None else stays))


def _said(kind: type) -> dict[str, str]:
    """Return the docstrings below the fields of a class, and what options say of a scenario's."""
    if kind is Scenario:
        return {
            name: f"`{one.name}` was not given." if one.is_flag else one.help
            for name, one in Scenario.options().items()
        }
    if kind is EngineReport:
        return {
            name: says[0].upper() + says[1:] + "." for name, says in EngineReport.says().items()
        }
    (tree,) = ast.parse(textwrap.dedent(inspect.getsource(kind))).body
    assert isinstance(tree, ast.ClassDef)
    said = {}
    for above, below in zip(tree.body, [*tree.body[1:], None], strict=True):
        match above, below:
            case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(value=ast.Constant(value=words)):
                said[name] = str(words)
            case ast.FunctionDef(name=name), _:
                said[name] = ast.get_docstring(above) or ""
    return {
        name: re.sub(r"\bNone\b", "null", " ".join(words.split())) for name, words in said.items()
    }


def _sentences(said: Mapping[str, str]) -> dict[str, str]:
    return {name: f"{words[0].upper()}{words[1:]}." for name, words in said.items()}


# -- the commands ---------------------------------------------------------------------------------

ANALYSIS = _object(
    Analysis,
    {"recording", "scenario", "engine", "at", "airborne", "impact", "rest", "conservation",
     "findings", "segments", "flights", "explained"},
    scenario=Scenario, table=None, contact_phases=None,
)  # fmt: skip
SCRIPT_ANALYSIS = _object(
    script.ScriptAnalysis, {"recording", "origin", "bodies", "findings", "explained"},
    table=None, by_body=None,
)  # fmt: skip
RENDERING = _object(Rendering, plot=Path | None, speed=None)
ROW = Object(
    {name: COLUMNS.get(kind, list[float]) | None
     for name, kind in SWEEP_COLUMNS.items()},
    {
        **_said(Scenario), **_sentences(TABLE_SAYS),
        "run": "Number of the run, from 0.", "sample": "Number of the sample, with `--samples`.",
        "error": "Why a run failed.", "command": "Makes this run again.",
        "recording": "The run's recording, in the folder.", "end_m": "Height in the last sample.",
    },
    frozenset({*Scenario.options(), *TERMS}),
)  # fmt: skip
OF_SCRIPT = "Of scripts: "
PLACE = _object(
    Difference, {"step", "column"}, body=str | None, link=int | None, difference=float | None
)  # fmt: skip
PLACE = PLACE._replace(
    said=PLACE.said | _said(Place) | {
        name: OF_SCRIPT + PLACE.said[name] for name in ("body", "link", "difference")
    } | {"column": f"{_said(Place)['column']} {OF_SCRIPT}{PLACE.said['column']}"}
)  # fmt: skip
SETTING = Object(
    {"name": str, "value": Any, "golden": Any, "step": int, "body": str | None,
     "link": int | None},
    _said(Setting) | {
        "name": f"{_said(Setting)['name']} {OF_SCRIPT}a column, as of `first_difference`.",
        **{name: OF_SCRIPT + PLACE.said[name].removeprefix(OF_SCRIPT)
           for name in ("step", "body", "link")},
    },
)  # fmt: skip
CHECK = _object(
    Check,
    {"same", "largest_difference_m", "first_difference"},
    comparison=None,
    same=bool,
    largest_difference_m=float | None,
    first_difference=None,
    looks_like=str | None,
    differences=None,
    versions=list[Setting],
    cause=str | None,
    call_before=Call | None,
    other_call=OtherCall | None,
)
OF_BOTH = _said(Comparison)
CHECK = CHECK._replace(
    keys={**CHECK.keys, "first_difference": (PLACE, None), "differences": [SETTING]},
    said=OF_BOTH | CHECK.said | {"first_difference": OF_BOTH["first"]} | {
        name: OF_SCRIPT + _said(ScriptComparison)[name]
        for name in ("cause", "call_before", "other_call")
    },
)  # fmt: skip
SHARED = "A value of the scenario that these runs share and others do not."
STUDY = Object(
    {"study": _object(Study, refining_hurts=bool)}, {"study": "What they tell."}, more=SHARED
)
STATISTICS = Object(
    {"summaries": list[Summary]}, {"summaries": "One for each quantity."}, more=SHARED
)
SWEEP = Object(
    {"runs": int, "failed": int, "results": Path, "table": [ROW], "at_s": float,
     "plot": Path | None, "convergence": [STUDY],
     "statistics": [STATISTICS], "engines": list[EngineRun], "narrow_enough": bool | None},
    {"runs": "How many runs there are.", "failed": "How many of them failed.",
     "results": "The Parquet file with the table.", "at_s": "The time that was taken apart.",
     "plot": "The plot; null where none was asked for.", "table": "A row for each run.",
     "convergence": "One for each set of runs that differ in the timestep only.",
     "statistics": "One for each scenario that is sampled.",
     "engines": "One for each run, where engines are compared or the body spins.",
     "narrow_enough": "Whether `--until-ci` was reached."},
    frozenset({"runs", "failed", "results", "table"}),
)  # fmt: skip
RECORD = Object(
    {"recording": Path, "recording_id": str, "script": str,
     "ended": Literal["finished", "steps", "duration", "interrupted", "failed"],
     "error": str | None, "samples": int,
     "bodies": int, "frames": int, "bytes": int, "wall_s": float,
     "first_difference": int | None},
    {"recording": "The file.", "recording_id": "Its id.", "script": "The script, or the module.",
     "ended": "How it ended; `steps` and `duration`: it was stopped.",
     "samples": "States of its simulations, together.", "bodies": "Bodies that were ever there.",
     "frames": "Images that it took.", "bytes": "The file's size.",
     "wall_s": "How long it took [s].", "error": "What the script failed with.",
     "first_difference": "With `--twice`: the first step whose state differs; null where none "
     "does."},
    frozenset({"recording", "recording_id", "script", "ended", "samples", "bodies", "frames",
               "bytes", "wall_s"}),
)  # fmt: skip
VIEW = Object(
    {"recordings": list[Path], "layers": list[Path], "golden": Path | None,
     "same": bool | None, "first_difference": int | None, "command": list[str], "url": str,
     "page": str | None},
    {"recordings": "What is shown.", "layers": "Their analyses, which are shown with them.",
     "golden": "What is shown with it, with `--against`.",
     "same": "Whether the two are the same physics; null without `--against`.",
     "first_difference": "The first step of which anything differs; null where nothing does.",
     "command": "What starts the viewer.", "url": "Where the viewer takes data.",
     "page": "What to open in a browser, with `--web`."},
)  # fmt: skip
COMMANDS: dict[str, Object] = {
    "simulate": _object(Simulation),
    "analyze": ANALYSIS,
    "analyze_script": SCRIPT_ANALYSIS,
    "render": RENDERING,
    "run": Object(
        {"simulate": _object(Simulation), "analyze": ANALYSIS, "render": RENDERING},
        {name: f"What `drop {name} --json` prints." for name in ("simulate", "analyze", "render")},
        frozenset({"simulate", "analyze", "render"}),
    ),
    "check": CHECK,
    "sweep": SWEEP,
    "record": RECORD,
    "info": _object(Info, {"recording", "recording_id", "kind", "complete", "samples", "bodies",
                           "frames", "bytes"}),
    "view": VIEW,
}  # fmt: skip


TITLES = {"analyze_script": "drop analyze, of a script's recording"}
"""Of objects that are not those of a command alone."""


def made() -> dict[str, str]:
    """Return the schemas and the page."""
    titles = {name: TITLES.get(name, f"drop {name}") for name in COMMANDS}
    schemas = {name: _schema(one) for name, one in COMMANDS.items()}
    files = {
        f"schemas/{name}.json": _text({"$schema": "https://json-schema.org/draft/2020-12/schema",
                                       "title": f"{titles[name]} --json", **one})
        for name, one in schemas.items()
    }  # fmt: skip
    parts = [_HEAD]
    for name, one in schemas.items():
        parts.append(f"## {titles[name]}\n\nSchema: [{name}.json](schemas/{name}.json)\n")
        if name == "run":
            words = " and ".join(f"`{key}`" for key in one["properties"])
            parts.append(f"The objects of the three commands, under {words}.\n")
        else:
            parts += ["| key | | type | what it is |\n| --- | --- | --- | --- |", *_rows(one), ""]
    return files | {"json.md": "\n".join(parts)}


def _text(schema: Schema) -> str:
    return json.dumps(schema, indent=2, ensure_ascii=False) + "\n"


# -- schemas --------------------------------------------------------------------------------------


def _schema(hint: Any) -> Schema:  # noqa: ANN401
    """Return the schema of a type, of a list that holds an example, or of an example or null."""
    arguments = get_args(hint)
    if is_dataclass(hint):
        hint = _object(hint)
    if isinstance(hint, Object):
        return _object_schema(hint)
    if isinstance(hint, list):
        return {"type": "array", "items": _schema(hint[0])}
    if isinstance(hint, tuple):
        return _nullable(_schema(hint[0]))
    if get_origin(hint) in UNIONS:  # of one type and None, or of several scalars
        kinds = [SCALARS[one]["type"] for one in arguments if one in SCALARS]
        if len(kinds) > 1:
            return {"type": [*kinds, "null"]}
        return _nullable(_schema(arguments[0]))
    kind = get_origin(hint)
    if kind is Literal:
        return {"enum": [*arguments]}
    if kind is dict:
        return {"type": "object", "additionalProperties": _schema(arguments[1])}
    if kind is tuple and arguments[-1] is not ...:
        size = len(arguments)
        items = _schema(arguments[0])
        return {"type": "array", "items": items, "minItems": size, "maxItems": size}
    if kind in (list, tuple):
        return {"type": "array", "items": _schema(arguments[0])}
    return SCALARS[hint]


def _object_schema(made_of: Object) -> Schema:
    properties = {}
    for name, hint in made_of.keys.items():
        said = made_of.said.get(name)
        properties[name] = _schema(hint) | ({"description": said} if said else {})
    required = [name for name in properties if name in made_of.stays]
    schema: Schema = {"type": "object", "properties": properties}
    if required:
        schema["required"] = required
    if made_of.more:
        schema["additionalProperties"] = {"description": made_of.more}
    return schema


def _nullable(schema: Schema) -> Schema:
    if "enum" in schema:
        return schema | {"enum": [*schema["enum"], None]}
    return schema | {"type": [schema["type"], "null"]}


# -- the page -------------------------------------------------------------------------------------


def _rows(schema: Schema, before: str = "") -> Iterator[str]:
    """Yield a row for each key, those of the objects in it below it."""
    for name, one in schema["properties"].items():
        path = f"{before}{name}"
        inner, words, mark = one, _words(one), "•" if name in schema.get("required", ()) else ""
        if "items" in one:
            inner, path = one["items"], f"{path}[]"
            words = words.replace("array", _words(inner))
        yield f"| `{path}` | {mark} | {words} | {one.get('description', '')} |"
        if "properties" in inner:
            yield from _rows(inner, f"{path}.")
    if "additionalProperties" in schema:
        yield f"| `{before}…` | | any | {schema['additionalProperties']['description']} |"


def _words(schema: Schema) -> str:
    if "enum" in schema:
        return " or ".join(f"`{json.dumps(one)}`" for one in schema["enum"])
    kinds = schema.get("type", "any")
    return " or ".join(kinds) if isinstance(kinds, list) else str(kinds)
