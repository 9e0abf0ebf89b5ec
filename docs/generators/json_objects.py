"""Write JSON Schemas for the output of `--json`, from the types of the printed objects.

A schema describes every key. The required ones are those of the contract, which are stable; more
may be added.
"""

from __future__ import annotations

import ast
import inspect
import json
import re
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from pathlib import Path
from types import UnionType
from typing import Any, Literal, NamedTuple, Union, get_args, get_origin, get_type_hints

import polars as pl
from drop_physics.account import episodes
from drop_physics.account import rows as account
from drop_physics.account.joints import JointRow
from drop_physics.account.touches import Touch
from drop_physics.analysis import results as script
from drop_physics.compare.calls import OtherCall
from drop_physics.compare.comparison import Comparison
from drop_physics.compare.difference import Difference, Largest, Setting
from drop_physics.drop.results import (
    Airborne,
    Conservation,
    DropAnalysis,
    FallAnalysis,
    Impact,
    Moment,
    Rest,
    Terms,
)
from drop_physics.engine_report import EngineReport
from drop_physics.engines.mujoco.importing.gaps import Gap
from drop_physics.experiments import robustness, run_distance
from drop_physics.experiments.shares import Shares
from drop_physics.experiments.swap.answer import (
    Class,
    DifferenceCause,
    End,
    First,
    Nudges,
    SwapProof,
)
from drop_physics.experiments.verdicts import Verdict
from drop_physics.explain.actuators import ActuatorRow
from drop_physics.explain.decomposition import VectorTerms
from drop_physics.report import summary
from drop_physics.rules import answer
from drop_physics.scenario import Scenario
from drop_physics.stages.check import Check
from drop_physics.stages.explain import CodeManual
from drop_physics.stages.export import Export
from drop_physics.stages.importing import Imported
from drop_physics.stages.info import Info
from drop_physics.stages.record import ReplayedSteps
from drop_physics.stages.render import Rendering
from drop_physics.stages.simulate import Simulation
from drop_physics.sweeping.rows import SCHEMA as SWEEP_COLUMNS
from drop_physics.sweeping.rows import TERMS
from drop_physics.trace.calls import Call

from generators.recording import TABLE_SAYS

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
"""JSON types of a column's values, by column type; all other columns are vectors."""
CONTRACT: dict[type, set[str]] = {
    Airborne: {"samples", "max_abs_error_m", "rms_error_m", "max_abs_rounding_m"},
    Conservation: {
        "energy_initial_j", "energy_max_rel_drift", "angular_momentum_max_rel_drift",
    },
    Impact: {
        "time_free_fall_s", "time_damped_s", "time_simulated_s", "step", "lowest_m", "lowest_step",
        "penetration_m",
    },
    Moment: {"time_s", "step", "phase", "simulated_m", "free_fall_m", "error_m", "terms_m"},
    Gap: {field.name for field in fields(Gap)},
    Rendering: {"gif", "frames", "fps", "plot"},
    Rest: {"height_m", "expected_m", "error_m", "settled_step"},
    Scenario: {field.name for field in fields(Scenario)},
    Simulation: {"recording", "recording_id", "samples", "frames", "bytes", "wall_s"},
    Terms: {"timestep", "damping", "interaction", "rounding"},
    VectorTerms: {"timestep", "damping", "interaction", "rounding"},
    script.BodyAnalysis: {
        "name", "label", "id", "soft", "links", "mass_kg", "segments", "flights", "contacts",
        "unexplained", "energy", "momentum", "joints", "actuators", "touches",
    },
    script.BodyContact: {
        "first_step", "last_step", "start_s", "end_s", "impulse_n_s", "energy_j", "by",
    },
    script.BodyFlight: {
        "first_step", "last_step", "start_s", "end_s", "error_m", "terms_m", "at",
    },
    script.Energy: {"start_j", "end_j", "by_cause_j"},
    script.Explained: {field.name for field in fields(script.Explained)},
    script.FlightSample: {"step", "time_s", "error_m", "terms_m"},
    script.Momentum: {"start_kg_m_s", "end_kg_m_s", "by_cause_kg_m_s"},
    script.Pusher: {"body", "id", "link", "impulse_n_s", "energy_j"},
    script.StepSum: {"step", "time_s", "segment", "terms", "remainder"},
    script.Unexplained: {"reason", "samples", "first_step", "remainder"},
    answer.Effect: {"value", "unit"},
    answer.Finding: {
        "reason",
        "cure", "proposed",
        "code", "level", "message", "advice", "body", "bodies", "joint", "with", "effect", "share",
        "steps", "site", "verdict", "tried",
    },
    Shares: {field.name for field in fields(Shares)},
    answer.Span: {"first", "last", "count"},
    answer.Cure: {"name", "target", "value", "call"},
    JointRow: {field.name for field in fields(JointRow)},
    ActuatorRow: {field.name for field in fields(ActuatorRow)},
    ReplayedSteps: {field.name for field in fields(ReplayedSteps)},
    account.AccountRow: {
        field.name for field in fields(account.AccountRow) if field.metadata.get("json", True)
    },
    episodes.AtEnd: {field.name for field in fields(episodes.AtEnd)},
    episodes.EpisodeRow: {field.name for field in fields(episodes.EpisodeRow)},
    episodes.FirstContact: {field.name for field in fields(episodes.FirstContact)},
    account.RowTerm: {field.name for field in fields(account.RowTerm)},
    **{
        kind: {field.name for field in fields(kind)}
        for kind in (summary.ShortFinding, summary.ShortRow, summary.Summary)
    },
    Touch: {"with", *(field.name for field in fields(Touch) if field.name != "other")},
}  # fmt: skip
"""Stable keys by type; `COMMANDS` has the stable keys of each command's whole output."""


class Object(NamedTuple):
    """A JSON object: its keys with their types and descriptions, and which of them are stable."""

    keys: Mapping[str, Any]
    descriptions: Mapping[str, str] = {}
    required: frozenset[str] = frozenset()
    more: str = ""
    """Description of its further keys, whose names are not known beforehand."""


TRIAL_KEYS: dict[str, Any] = {
    "name": str,
    "target": str | None,
    "value": float | None,
    "call": str,
    "site": str | None,
}
TRIAL_SAYS = {
    "name": "Of the intervention, as `--try` takes it.",
    "target": "The body or joint that it is made on; null if on the whole run.",
    "value": "What is given; null where the intervention has no number, or several.",
    "call": "What its user would write.",
    "site": "File and line of the call that it is about.",
    "moved": "How far the outcome moves: at the end, else on the way; null where a nudge of 1e-9 "
    "moves it a tenth as much or more, or nothing moves.",
}
MOVED = Object(
    {"value": float | None, "unit": Literal["m", "rad"], "body": str, "joint": str | None},
    {
        "value": "The distance; null where a state is not finite.",
        "unit": "`m`, of positions; `rad`, of orientations and joints that turn.",
        "body": "Its label.",
        "joint": "Its name; null of a base.",
    },
    frozenset({"value", "unit", "body", "joint"}),
)
TRIED = Object(
    {
        **TRIAL_KEYS,
        "verdict": Verdict,
        "before": float | None,
        "after": float | None,
        "unit": str | None,
        "left": float | None,
        "moved": (MOVED,),
        "new": list[str],
        "recording": Path | None,
    },
    {
        **TRIAL_SAYS,
        "verdict": "`cured`: at most a fifth of the effect is left, the outcome moves by more than "
        "ten times what a nudge moves, nothing grave is new, no body is thrown, and the run ends "
        "as before; `part`: some of this; `chaotic`: the nudge moves the outcome as far; "
        "`refuted`: it is as before, or nothing has moved; `void`: no call was changed, nothing "
        "can be compared, or the script fails with it; `untried`: there was no time, or the engine "
        "has no such intervention.",
        "before": "The finding's effect in the script's own run; null where it has none.",
        "after": "The same in the trial; null where the finding is gone.",
        "unit": "Of both.",
        "left": "Share of the effect that is left; null where the finding's code is itself a "
        "cause, which the trial takes away whether or not it matters: there the outcome decides.",
        "new": "Codes of grave findings that only the trial has.",
        "recording": "Of the trial; null where it was not run.",
    },
    frozenset(
        {*TRIAL_KEYS, "verdict", "before", "after", "unit", "left", "moved", "new", "recording"}
    ),
)


def _object(kind: Any, required: set[str] | None = None, /, **instead: Any) -> Object:  # noqa: ANN401
    """Return a dataclass as printed; `instead` overrides the types of keys, None omits a key."""
    if kind is answer.Finding:
        instead = {"verdict": Verdict | None, "tried": [TRIED]} | instead
    printed = [field.name for field in fields(kind) if field.metadata.get("json", True)]
    hints = {name: get_type_hints(kind)[name] for name in printed} | instead
    names = {name: script.JSON_NAMES.get(name, name) for name in hints}
    keys = {names[name]: hint for name, hint in hints.items() if hint is not None}
    return Object(
        keys,
        {names.get(name, name): words for name, words in _descriptions(kind).items()},
        frozenset(CONTRACT.get(kind, ()) if required is None else required),
    )


def _descriptions(kind: type) -> dict[str, str]:
    """Return the docstrings below a class's fields; for a scenario, the help of its options."""
    if kind is Scenario:
        return {
            name: f"`{option.name}` was not given." if option.is_flag else option.help
            for name, option in Scenario.options().items()
        }
    if kind is EngineReport:
        return {
            name: says[0].upper() + says[1:] + "." for name, says in EngineReport.says().items()
        }
    (tree,) = ast.parse(textwrap.dedent(inspect.getsource(kind))).body
    assert isinstance(tree, ast.ClassDef)
    descriptions = {}
    for above, below in zip(tree.body, [*tree.body[1:], None], strict=True):
        match above, below:
            case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(value=ast.Constant(value=words)):
                descriptions[name] = str(words)
            case ast.FunctionDef(name=name), _:
                descriptions[name] = ast.get_docstring(above) or ""
    return {
        name: re.sub(r"\bNone\b", "null", " ".join(words.split()))
        for name, words in descriptions.items()
    }


def _sentences(phrases: Mapping[str, str]) -> dict[str, str]:
    return {name: f"{words[0].upper()}{words[1:]}." for name, words in phrases.items()}


# -- the commands ---------------------------------------------------------------------------------

ANALYSIS = _object(
    DropAnalysis,
    {
        "kind",
        "recording",
        "layer",
        "partial",
        "origin",
        "samples",
        "explained",
        "bodies",
        "scenario",
        "engine",
        "at",
        "airborne",
        "impact",
        "rest",
        "conservation",
        "findings",
        "segments",
        "flights",
    },
    scenario=Scenario,
    engine=EngineReport,
    origin=None,
    rows=None,
    table=None,
    by_body=None,
    contact_j=None,
    curves=None,
    stepped=None,
    sources=None,
)
ANALYSIS = ANALYSIS._replace(
    keys={"origin": (dict[str, Any], None), **ANALYSIS.keys},
    descriptions=_descriptions(script.Analysis)
    | _descriptions(FallAnalysis)
    | _descriptions(DropAnalysis),
)
SCRIPT_ANALYSIS = _object(
    script.Analysis,
    {
        "kind",
        "recording",
        "layer",
        "partial",
        "origin",
        "engine",
        "samples",
        "explained",
        "bodies",
        "findings",
        "account",
        "episodes",
        "episode",
    },
    origin=dict[str, Any],
    engine=dict[str, Any],
    rows=None,
    by_body=None,
    curves=None,
    stepped=None,
    sources=None,
)
SUMMARY = _object(summary.Summary)
SUMMARY = SUMMARY._replace(
    keys={**SUMMARY.keys, "beside": SUMMARY},
    descriptions={
        **SUMMARY.descriptions,
        "beside": "The same of the other engine, where a script steps both.",
    },
)
RENDERING = _object(Rendering, plot=Path | None, speed=None)
ROW = Object(
    {name: COLUMNS.get(kind, list[float]) | None for name, kind in SWEEP_COLUMNS.items()},
    {
        **_descriptions(Scenario),
        **_sentences(TABLE_SAYS),
        "run": "Number of the run, from 0.",
        "sample": "Number of the sample, with `--samples`.",
        "error": "Why a run failed.",
        "command": "Repeats this run.",
        "recording": "The run's recording, in the folder.",
        "end_m": "Height in the last sample.",
    },
    frozenset({*Scenario.options(), *TERMS}),
)
PLACE = _object(
    Difference,
    {"step", "column"},
    value=float | str | None,
    golden=float | str | None,
    difference=float | None,
    unit=None,
)
INPUT = _object(Difference, set(), column=None, unit=None)
INPUT = INPUT._replace(
    keys={"name": str, **INPUT.keys, "value": Any, "golden": Any},
    descriptions=PLACE.descriptions
    | {
        "name": "A column, as of `first_difference`. Of a drop's settings its name in the "
        "recording, without the other keys; `engine.` comes first where only the engine's differs.",
    },
)
CALL = _object(
    Call,
    set(),
    site=None,
    numbers=None,
    result=None,
    function=str,
    arguments=str,
    file=str,
    line=int,
)
OTHER_CALL = Object({"value": (CALL, None), "golden": (CALL, None)}, _descriptions(OtherCall))
CHECK = _object(
    Check,
    {"same", "largest_difference_m", "first_difference"},
    comparison=None,
    why=None,
    same=bool,
    largest_difference_m=float | None,
    first_difference=None,
    differences=None,
    largest=list[Largest],
    call_before=None,
    other_call=None,
    not_compared=list[str],
    script=list[Setting],
    versions=list[Setting],
    unseeded=list[str],
    real_time=bool,
)
CHECK = CHECK._replace(
    keys={
        **CHECK.keys,
        "first_difference": (PLACE, None),
        "differences": [INPUT],
        "call_before": (CALL, None),
        "other_call": (OTHER_CALL, None),
    },
    descriptions=CHECK.descriptions
    | _descriptions(Comparison)
    | {
        "first_difference": "The first difference at a step, of a sample or a picture; null where "
        "there is none.",
        "same": CHECK.descriptions["same"],
    },
)
SWEEP = Object(
    {
        "runs": int,
        "failed": int,
        "results": Path,
        "table": [ROW],
        "at_s": float,
    },
    {
        "runs": "Number of runs.",
        "failed": "Number of failed runs.",
        "results": "The Parquet file with the table.",
        "at_s": "The time whose error is broken down.",
        "table": "A row for each run.",
    },
    frozenset({"runs", "failed", "results", "table"}),
)
SCRIPT_SWEEP = Object(
    {
        "script": str,
        "recording": Path,
        "runs": int,
        "failed": int,
        "results": Path,
        "table": [
            Object(
                {
                    "run": int,
                    "ended": str,
                    "error": str | None,
                    "steps": int,
                    "same": bool,
                    "end_m": float | None,
                    "end_rad": float | None,
                    "findings": list[str],
                    "recording": str,
                },
                {
                    "run": "Its number.",
                    "ended": "How it ended, as of `drop record`.",
                    "error": "The error that it failed with.",
                    "steps": "Steps that the script made.",
                    "same": "Whether no position differs from the script's own run, to the bit.",
                    "end_m": "How far from its own run a body ends.",
                    "end_rad": "Likewise a joint, or an orientation.",
                    "findings": "Codes of its findings.",
                    "recording": "Its file.",
                },
                frozenset({"run", "ended", "steps", "same", "findings", "recording"}),
                "What is tried, by name: a number, a name, or true where nothing is given; and "
                "where each body and joint ends, such as `1_box z_m`.",
            )
        ],
    },
    {
        "script": "The script.",
        "recording": "The recording of its own run.",
        "runs": "Number of runs, without its own.",
        "failed": "Number of failed runs.",
        "results": "The Parquet file with the table.",
        "table": "A row for each run.",
    },
    frozenset({"script", "recording", "runs", "failed", "results", "table"}),
)
RECORD = Object(
    {"recording": Path, "recording_id": str, "script": str,
     "ended": Literal["finished", "steps", "duration", "idle", "disk", "interrupted", "failed"],
     "error": str | None, "samples": int,
     "bodies": int, "frames": int, "bytes": int, "wall_s": float,
     "replay": ReplayedSteps, "beside": dict[str, Any], "first_difference": int | None},
    {"recording": "The file.", "recording_id": "Its id.", "script": "The script, or the module.",
     "ended": "How it ended; `steps` and `duration` mean that it was stopped there, `idle` that it "
     "waited 60 s without a step, `disk` that no room was left.",
     "samples": "States of all its simulations.", "bodies": "Bodies that ever existed.",
     "frames": "Images that it took.", "bytes": "The file's size.",
     "wall_s": "How long it took [s].", "error": "The error that the script failed with.",
     "replay": "What became of the steps of MuJoCo; not of PyBullet.",
     "beside": "Of a script that steps PyBullet and MuJoCo: the recording of the one that came "
     "second, with the same keys.",
     "first_difference": "With `--twice`: the first step whose state differs; null if none "
     "does."},
    frozenset({"recording", "recording_id", "script", "ended", "samples", "bodies", "frames",
               "bytes", "wall_s"}),
)  # fmt: skip
DISTANCE = _object(
    run_distance.Distance,
    {"value", "unit", "body", "joint", "time_s"},
    value=float | None,
    unit=Literal["m", "rad"],
)
VARIATION = Object(
    {
        "name": str,
        "recording": Path,
        "ended": Literal["finished", "steps", "duration", "idle", "disk", "failed"],
        "error": str | None,
        "steps": int,
        "most": [DISTANCE],
        "end": [DISTANCE],
        "from_s": float | None,
        "term": str | None,
    },
    {
        "name": "`timestep/2`, `iterations*4`, `residual 0`, `nudge`, `seed`, or NAME=V.",
        "recording": "Its recording.",
        "ended": "How it ended, as of `drop record`.",
        "error": "The error that the script failed with.",
        "steps": "How many steps the script made: with timestep/K, each is K of the engine.",
        "most": "The farthest from the script's own run at any time, for each unit.",
        "end": "The farthest at the end.",
        "from_s": "When first more than 1e-6 m or rad apart; null if never.",
        "term": "The term of the sum that has done most of it by then: gravity, bias, damping, "
        "joint damping, applied, motors, contacts, rolling, constraints, stops, clamp; "
        "integrator, where it is how a step moves at its velocity; set, where calls put it "
        "elsewhere; null where "
        "nothing is apart, it is not explained, or no single one.",
    },
    frozenset({"name", "recording", "most", "end", "from_s", "term"}),
)
STANDING = _object(
    robustness.Standing, set(), end=float | None, most=float | None, moved=float | None
)
TRUST = Object(
    {
        "script": str,
        "recording": Path,
        "variations": [VARIATION],
        "standing": [STANDING],
        "growth": robustness.Growth | None,
        "converging": list[robustness.Converging],
        "findings": list[answer.Finding],
    },
    {
        "script": "The script, or the module.",
        "recording": "The recording of its own run.",
        "variations": "The runs with variations.",
        "standing": "What stands of each position that matters, the least first.",
        "growth": "How the displacement of `nudge` grows; null where it does not, a hundredfold.",
        "converging": "Each end position that depends on the timestep, the one that depends most "
        "first; empty without three timesteps of one ratio.",
        "findings": "The same as sentences.",
    },
    frozenset({"script", "recording", "variations", "findings"}),
)
EXPECTATION = Object(
    {
        "text": str,
        "source": Literal["option", "assert", "row"],
        "site": str | None,
        "holds": bool,
        "value": float | None,
        "margin": float | None,
        "unit": str | None,
    },
    {
        "text": "The expression.",
        "source": "Where it is from: `option`, of `--expect`; `assert`, of the script; `row`, of "
        "the account: what was asked of a joint, or an episode that failed.",
        "site": "File and line, of an `assert`.",
        "holds": "Whether it holds in the script's own run.",
        "value": "The first quantity that it compares, as the script has it.",
        "margin": "By how much it holds; below 0 where it does not.",
        "unit": "That of the quantity, where it is known.",
    },
    frozenset({"text", "source", "site", "holds", "value", "margin", "unit"}),
)
TIE = {
    "change": str,
    "target": list[str],
    "op": str,
    "site": str | None,
    "try": str,
}
TIE_SAYS = {
    "change": "The compiled field, `option.timestep`, `flag.NAME`, `pair`, `input.ctrl`; or "
    "`function.argument`, `function` of a call that is left out or added; or of the script's own "
    "text the name of what a number is the value of, `tag.attribute` of a model, or what a "
    "statement sets.",
    "target": "The names of elements, bodies or joints; none if it is the whole run.",
    "op": "What is done: `*10`, `=0`, `=default`, `stiff`, `^` (switched), `held`, `late`, "
    "`undone`, `left-out`, `each-step`, `w-first`.",
    "site": "File and line of the call, of the first step before which one is added, or of what "
    "stands in the text; null for all, or if no line is known.",
    "try": "What `--try` takes to repeat it, and `--vary` of `drop trust`.",
}
MAKES_TRUE = Object(
    {
        **TIE,
        "value": float | None,
        "least": float | None,
        "call": str,
        "result": float | None,
        "side": float | None,
        "breaks": bool,
        "worse": list[str],
        "thrown": (
            Object(
                {"body": str, "value": float},
                {"body": "The fastest body.", "value": "Its speed between two samples [m/s]."},
                frozenset({"body", "value"}),
            ),
        ),
        "ties": [Object(TIE, TIE_SAYS, frozenset(TIE))],
        "also": [
            Object(
                {**TIE, "result": float | None},
                {**TIE_SAYS, "result": "The quantity in that run."},
                frozenset({*TIE, "result"}),
            )
        ],
        "place": int | None,
        "row": str | None,
        "from_step": int | None,
        "second_before": (
            Object(
                {"from_step": int, "open_loop": bool | None, "closed_loop": bool | None},
                {
                    "from_step": "The step, a second before the failure.",
                    "open_loop": "Whether it makes it true with the recorded commands in place of "
                    "the script's; null where a run without a change is not the same to the bit "
                    "with these, or the change does nothing that late.",
                    "closed_loop": "The same with the script's own commands, which answer to it.",
                },
                frozenset({"from_step", "open_loop", "closed_loop"}),
            ),
        ),
        "alone": bool,
        "recording": Path | None,
    },
    {
        **TIE_SAYS,
        "value": "The operand: the factor, or the new value.",
        "least": "The least factor that makes it true, of the first three that are factors.",
        "call": "The change in words.",
        "result": "The quantity in that run.",
        "side": "The RMS change of all other motion [m].",
        "breaks": "Whether it takes a part of the scene or of the command away.",
        "worse": "The commands that are followed worse than in the script's own run.",
        "thrown": "The body that is fastest, if above 1 m/s and twice as fast as all in the "
        "script's own run: thrown, or falling; else null.",
        "ties": "Other changes with the same result, and as much motion of all else.",
        "also": "Other operators on the same elements that make it true, with another motion.",
        "place": "Its place; outcomes that are alike share one.",
        "row": "The row of the account that names what it acts on, if there is one.",
        "from_step": "The latest step, of the quarters of the run and a second before an episode's "
        "failure, from which on it still makes it true; null where it does so from the beginning "
        "alone, or that was not tried.",
        "second_before": "Whether it keeps a failed episode from failing if it is made a second "
        "before, of the first three; null where that was not tried.",
        "alone": "Whether it is a factor of which neither 5 % more nor 5 % less makes it true, "
        "of the first three: a coincidence.",
        "recording": "The recording of that run, if it was recorded.",
    },
    frozenset({*TIE, "value", "least", "call", "result", "side", "breaks", "worse", "thrown",
               "ties", "also", "place", "row", "from_step", "second_before", "alone", "recording"}),
)  # fmt: skip
WHY = Object(
    {
        "script": str,
        "recording": Path,
        "ended": RECORD.keys["ended"],
        "runs": int,
        "seconds": float,
        "noise": (
            Object(
                {"value": float | None, "unit": Literal["m", "rad"] | None},
                {"value": "The distance.", "unit": "As of `moved`; null of what is expected."},
                frozenset({"value", "unit"}),
            ),
        ),
        "findings": [answer.Finding],
        "hangs_on": [
            Object(
                {**TRIAL_KEYS, "moved": (MOVED,)},
                TRIAL_SAYS,
                frozenset({*TRIAL_KEYS, "moved"}),
            )
        ],
        "shares": (_object(Shares),),
        "no_effect": [
            Object(
                {"call": str, "site": str},
                {"call": "What was left out.", "site": "File and line."},
                frozenset({"call", "site"}),
            )
        ],
        "expectation": (EXPECTATION,),
        "chaotic": bool,
        "complete": bool,
        "makes_true": [MAKES_TRUE],
        "moves": [MAKES_TRUE],
    },
    {
        "script": "The script, or the module.",
        "recording": "The recording of its own run; its trials are in the folder beside it.",
        "ended": "How its own run ended, as of `drop record`.",
        "runs": "How many things were tried.",
        "seconds": "That all took [s].",
        "noise": "How far a nudge of 1e-9 moves the outcome at the end, or what is "
        "expected; null where there was none.",
        "findings": "As of `drop analyze`, and what trials show of each.",
        "hangs_on": "Trials by how far they move the outcome; no cause is meant.",
        "shares": "One number of the outcome as a sum over its causes: what deciding trials switch "
        "off, alone and together; null where there are not two, or one stands for another.",
        "no_effect": "With `--ablate`: calls and arguments whose absence changes nothing, to the "
        "bit.",
        "expectation": "What was expected, with `--expect` or by an `assert` that fails, and what "
        "came; null if nothing was.",
        "chaotic": "Whether moving everything by 1e-9 makes it true: then no change was tried.",
        "complete": "Whether no change was left out for want of time.",
        "makes_true": "What makes it true, each outcome once: what takes nothing away first, then "
        "what changes least of all other motion.",
        "moves": "What moves the quantity most towards what is expected, if nothing makes it true.",
    },
    frozenset({"script", "recording", "ended", "runs", "seconds", "noise", "findings", "hangs_on",
               "no_effect", "shares", "expectation", "chaotic", "complete", "makes_true",
               "moves"}),
)  # fmt: skip
DIFF_CAUSE = _object(
    DifferenceCause,
    {"what", "field", "element", "a", "b", "site_a", "site_b", "step", "stage", "pair", "feature"},
    a=Any,
    b=Any,
    pair=list[str] | None,
)
DIFF = Object(
    {
        "a": str,
        "b": str,
        "steps": list[int],
        "same_until": int,
        "first": (_object(First, {"step", "time_s", "bodies", "size", "unit"}),),
        "class": Class | None,
        "because": [DIFF_CAUSE],
        "also": [DIFF_CAUSE],
        "proved": (_object(SwapProof, {"by", "steps", "of", "exact"}),),
        "end": (_object(End, {"value", "unit", "body"}),),
        "nudges": (_object(Nudges, {"size", "ends"}),),
        "no_effect": list[str],
        "runs": int,
        "cause_text": list[str],
    },
    {
        "a": "What tells the first run from the second: the script, a version, arguments.",
        "b": "Likewise, of the second.",
        "steps": "The number of steps of each.",
        "same_until": "The last step, from 0, after which every position and velocity is the same; "
        "-1 where they are apart from the first step on.",
        "first": "The first difference; null where there is none.",
        "class": "The kind of cause: `none` where they are the same, `length` where one only ends "
        "earlier, the state at the `start` or as the script set it, an `input`, one that the "
        "same script computed otherwise (`host`), the compiled `model`, `settings` of the engine, "
        "the engine's `step`, or two `engines`; null where nothing is proved.",
        "because": "What makes them part, at the first difference.",
        "also": "What makes them part in other steps.",
        "proved": "Which swap proves it; null where none does.",
        "end": "How far apart they are in the last step that both make; null where they are the "
        "same.",
        "nudges": "How far three other nudges of the first difference's size go; null where that "
        "is no rounding.",
        "no_effect": "What differs besides, and changes no step of this run.",
        "runs": "How often steps were made again.",
        "cause_text": "The printed lines of `because` and `also`, without their labels.",
    },
    frozenset(
        {"a", "b", "steps", "same_until", "first", "class", "because", "also", "proved", "end",
         "nudges", "no_effect", "runs", "cause_text"}
    ),
)  # fmt: skip
CHECK = CHECK._replace(
    keys={**CHECK.keys, "why": (DIFF, None)},
    descriptions=CHECK.descriptions
    | {
        "why": "As of `drop diff`, of the golden recording and this one: why they are not the "
        "same; null where they are, where nothing tells it, and of a drop."
    },
)
VIEW = Object(
    {
        "recordings": list[Path],
        "layers": list[Path],
        "golden": Path | None,
        "same": bool | None,
        "first_difference": int | None,
        "command": list[str],
        "url": str,
        "page": str | None,
    },
    {
        "recordings": "The recordings shown.",
        "layers": "Their analyses, shown with them.",
        "golden": "The recording it is compared with, with `--against`.",
        "same": "Whether the two are the same physics; null without `--against`.",
        "first_difference": "The first step at which anything differs; null if nothing does.",
        "command": "The command that starts the viewer.",
        "url": "Where the viewer takes data.",
        "page": "The address to open in a browser, with `--web`.",
    },
)
COMMANDS: dict[str, Object] = {
    "simulate": _object(Simulation),
    "analyze": ANALYSIS,
    "analyze_script": SCRIPT_ANALYSIS,
    "script": SUMMARY,
    "render": RENDERING,
    "run": Object(
        {"simulate": _object(Simulation), "analyze": ANALYSIS, "render": RENDERING},
        {name: f"What `drop {name} --json` prints." for name in ("simulate", "analyze", "render")},
        frozenset({"simulate", "analyze", "render"}),
    ),
    "check": CHECK,
    "sweep": SWEEP,
    "sweep_script": SCRIPT_SWEEP,
    "record": RECORD,
    "import": _object(Imported, {
        "recording", "recording_id", "file", "engine", "world", "worlds", "states", "steps",
        "explained", "step_s", "timestep_s", "rounding", "arrays", "gaps", "looked_at", "ended",
        "said", "notes", "bodies", "bytes", "wall_s",
    }),
    "trust": TRUST,
    "why": WHY,
    "diff": DIFF,
    "info": _object(Info, {"recording", "recording_id", "kind", "complete", "samples", "bodies",
                           "frames", "bytes"}),
    "explain": _object(CodeManual, {"codes"}),
    "export": _object(Export, {"recording", "files"}),
    "view": VIEW,
}  # fmt: skip


TITLES = {
    "analyze_script": "drop analyze, of a script's recording",
    "script": "drop, of a script",
    "sweep_script": "drop sweep, of a script",
}
"""Titles that differ from the command's name."""


def made() -> dict[str, str]:
    """Return the schemas by file name."""
    return {
        f"schemas/{name}.json": _text(
            {
                "$schema": "https://json-schema.org/draft/2020-12/schema",
                "title": f"{TITLES.get(name, f'drop {name}')} --json",
                **_schema(printed),
            }
        )
        for name, printed in COMMANDS.items()
    }


def _text(schema: Schema) -> str:
    return json.dumps(schema, indent=2, ensure_ascii=False) + "\n"


# -- schemas --------------------------------------------------------------------------------------


def _schema(hint: Any) -> Schema:  # noqa: ANN401
    """Return the JSON Schema for a type, for a list given by an example, or for a nullable."""
    arguments = get_args(hint)
    if is_dataclass(hint):
        hint = _object(hint)
    if isinstance(hint, Object):
        return _object_schema(hint)
    if isinstance(hint, list):
        return {"type": "array", "items": _schema(hint[0])}
    if isinstance(hint, tuple):
        return _nullable(_schema(hint[0]))
    if get_origin(hint) in (Union, UnionType):  # of one type and None, or of several scalars
        kinds = [SCALARS[kind]["type"] for kind in arguments if kind in SCALARS]
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
    if kind in (list, tuple, Sequence):
        return {"type": "array", "items": _schema(arguments[0])}
    return SCALARS[hint]


def _object_schema(described: Object) -> Schema:
    properties = {}
    for name, hint in described.keys.items():
        description = described.descriptions.get(name)
        properties[name] = _schema(hint) | ({"description": description} if description else {})
    required = [name for name in properties if name in described.required]
    schema: Schema = {"type": "object", "properties": properties}
    if required:
        schema["required"] = required
    if described.more:
        schema["additionalProperties"] = {"description": described.more}
    return schema


def _nullable(schema: Schema) -> Schema:
    if "enum" in schema:
        return schema | {"enum": [*schema["enum"], None]}
    return schema | {"type": [schema["type"], "null"]}
