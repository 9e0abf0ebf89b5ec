"""The command `drop`: parses arguments, calls a function of `stages`, prints the result.

Each command imports what it needs when it runs, so that `drop --help` is quick.
"""

from __future__ import annotations

import importlib
import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from drop_physics.console import output
from drop_physics.console.help import BOX, OWN, RECORDINGS, SCRIPT, App, HelpedCommands
from drop_physics.console.progress import progress, search_progress, sweep_progress
from drop_physics.console.running import main as main
from drop_physics.errors import DropError, ScenarioError
from drop_physics.fields import all_of, counted
from drop_physics.messages import Message
from drop_physics.options import TypedLine, command_of
from drop_physics.scenario import Scenario
from drop_physics.stages import verbs
from drop_physics.stages.verbs.taken import parameters_of

if TYPE_CHECKING:
    from collections.abc import Callable

    from drop_physics.stages.record import Recorded

app = App(
    cls=HelpedCommands,
    name="drop",
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["--help", "-h"]},
    help="Why did my simulation do that? Record a PyBullet or MuJoCo script, and read what went "
    "wrong, the worst first: the line of the script, and the call that changes it. Or drop a box, "
    "and see where each millimetre of error comes from. Everything is kept in one Rerun recording.",
    epilog="Start with: drop my_script.py, or: drop run",
)


def _recording(named: Path | None) -> Path:
    """Return the path of the recording that the command-line arguments refer to."""
    from drop_physics.stages.found import recording_of

    return recording_of(named, output.note)


def _choice(*given: str | None) -> Any:  # noqa: ANN401 - handed on
    """Return which findings to report, from the command's options and the project's settings."""
    from drop_physics.stages.settings import settings

    return settings().choice(*given)


def _page(given: TypedLine, *inputs: Path) -> Callable[..., None]:
    """Return a function that writes a result as an HTML page; the page's path is checked first."""
    html, force = given["html"], given["force"]
    if html is None:
        return lambda *_, **__: None
    from drop_physics.report.page import check_page, write_page

    check_page(html, inputs=inputs, force=force)
    return partial(write_page, page=html, force=force)


def _show(result: Any, **how: Any) -> int:  # noqa: ANN401 - handed on
    """Print a result, and return the exit code."""
    from drop_physics.report.terminal import show

    return show(result, **how)


def _verb(
    *kinds: type,
    group: str,
    short: str,
    example: str = "",
    name: str | None = None,
    **how: Any,  # noqa: ANN401 - handed on
) -> Callable[[Callable[[TypedLine], None]], Callable[[TypedLine], None]]:
    """Return a decorator that makes a command of the command line from a typed function."""
    if "target" in parameters_of(kinds[-1]):  # all after a script is its own
        how["context_settings"] = {"allow_interspersed_args": False}

    def declared(do: Callable[[TypedLine], None]) -> Callable[[TypedLine], None]:
        epilog = f"Example: {example}" if example else None
        declare = app.command(name, rich_help_panel=group, short_help=short, epilog=epilog, **how)
        declare(command_of(do, *kinds))
        return do

    return declared


@app.callback(invoke_without_command=True)
def _drop(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False,
) -> None:
    if version:
        from drop_physics.stages.info import versions

        print(versions())
        raise typer.Exit
    if context.invoked_subcommand is None:
        print(context.get_help())


@_verb(
    verbs.SimulateArguments,
    group=BOX,
    short="Drop the body and record it.",
    example="drop simulate --out moon.rrd --gravity moon --duration 2",
)
def simulate(given: TypedLine) -> None:
    """Drop the body and record it."""
    from drop_physics.stages.simulate import simulate

    asked, viewer = given.of(verbs.SimulateArguments), None
    if given["spawn"] and given["connect"] is not None:
        raise ScenarioError("--spawn and --connect exclude each other; give one of them")
    if given["spawn"] or given["connect"] is not None:
        from drop_physics.stages import view  # with the analysis, which takes half a second

        viewer = view.spawn if given["spawn"] else view.connection(given["connect"])
    with progress() as report:
        made = simulate(**asked, viewer=viewer, note=output.note, progress=report)
    _show(made, as_json=given["json"])


@_verb(
    verbs.AnalyzeArguments,
    group=RECORDINGS,
    short="Say what happened and why, the worst first.",
    example="drop analyze recordings/run.rrd --at 0.1 --at 0.3 --table run.csv",
)
def analyze(given: TypedLine) -> None:
    """Analyze a recording, and print what happened."""
    recording = _recording(given["recording"])
    analysis, code = _analyzer(given, recording)(recording, given["recording"])
    if _as_json(given):
        output.print_json(analysis.as_json())
    raise typer.Exit(code)


def _as_json(given: TypedLine) -> bool:
    return bool(given["json"] or given["output_format"] == "json")


def _analyzer(
    given: TypedLine,
    read: Path,
    **instead: Any,  # noqa: ANN401 - handed on
) -> Callable[[Path, Path | None], tuple[Any, int]]:
    """Return a function that analyzes a script's recording and prints the result, unless as JSON.

    All outputs are checked before any work. `read` is the file that will be read; `instead`
    replaces values that were not typed.
    """
    choice = _choice(given["select"], given["ignore"], given["fail_on"])
    from drop_physics.files.outputs import check_table

    asked = given.of(verbs.AnalyzeArguments) | instead
    if asked["table"] is not None:
        check_table(asked["table"], force=asked["force"])
    if given["account"] is not None and given["account"] < 0:
        raise ScenarioError("--account must be 0 or more, got {n}", n=given["account"])
    how = {"verbose": given["verbose"], "most_rows": given["account"]}
    write_page = _page(given, read)

    def analyzed(recording: Path, script: Path | None) -> tuple[Any, int]:
        from drop_physics.stages.analyze import analyze
        from drop_physics.stages.analyze.explaining import WhatToExplain

        explain = WhatToExplain(given["windows"], whole=given["whole"])
        of = {"recording": recording, "choice": choice, "script": script, "explain": explain}
        with progress() as report:
            analysis = analyze(**asked | of, progress=report)
        write_page(analysis, film_of=recording, **how)
        text = "" if _as_json(given) else None
        if given["output_format"] in ("github", "sarif"):
            from drop_physics.report.annotations import FORMATS

            text = FORMATS[given["output_format"]](analysis)
        return analysis, _show(analysis, text=text, choice=choice, **how)

    return analyzed


@_verb(
    verbs.RenderArguments,
    group=RECORDINGS,
    short="Make a gif of the frames, and a plot.",
    example="drop render recordings/run.rrd --with-plot --out fall.webp",
)
def render(given: TypedLine) -> None:
    """Render a recording."""
    recording = _recording(given["recording"])
    choice = _choice(given["select"], given["ignore"])
    from drop_physics.stages.render import render

    of = {"recording": recording, "animation": _animation(given), "choice": choice}
    with progress() as report:
        made = render(
            **given.of(verbs.RenderArguments) | of, script=given["recording"], progress=report
        )
    _show(made, as_json=given["json"], recording=recording)


def _animation(given: TypedLine) -> Any:  # noqa: ANN401 - handed on
    from drop_physics.figures.playback import Animation

    return Animation(**{name: given[name] for name in ("fps", "speed", "caption", "with_plot")})


@_verb(
    verbs.RunArguments,
    group=BOX,
    short="Simulate, analyze and render: the whole story.",
    example="drop run --timestep 1/480",
)
def run(given: TypedLine) -> None:
    """Simulate, analyze and render a drop."""
    animation = _animation(given)
    from drop_physics.stages.run import run

    with progress() as report:
        made = run(
            **given.of(verbs.RunArguments), animation=animation, note=output.note, progress=report
        )
    _show(made, as_json=given["json"])


@_verb(
    verbs.CheckArguments,
    group=RECORDINGS,
    short="Compare with a golden recording.",
    example="drop check run.rrd --against recordings/golden/standard.rrd",
)
def check(given: TypedLine) -> None:
    """Compare a recording with a golden one."""
    from drop_physics.files.outputs import check_apart, check_target
    from drop_physics.report.check import append_summary
    from drop_physics.stages.check import check
    from drop_physics.stages.settings import settings

    asked, summary = given.of(verbs.CheckArguments), given["summary"]
    inputs = asked["recording"], asked["against"]
    if summary is not None:
        check_target(summary, force=True)
        check_apart([summary], inputs=inputs)
    write_page = _page(given, *inputs)
    if asked["tolerance_m"] is None:
        asked["tolerance_m"] = settings().tolerance_m
    checked = check(**asked)
    if summary is not None:
        append_summary(checked, summary)
    write_page(checked)
    raise typer.Exit(_show(checked, as_json=given["json"]))


@_verb(
    verbs.SweepArguments,
    verbs.SweepScriptArguments,
    group=BOX,
    short="Run many scenarios, or a script with many interventions.",
    example="drop sweep --timestep 1/240,1/480,1/960 --out sweep",
)
def sweep(given: TypedLine) -> None:
    """Run many scenarios, or a script with many interventions."""
    if given["target"] or given["tries"]:
        _sweep_script(given)
    from drop_physics.stages.sweep import sweep
    from drop_physics.sweeping.plan import plan_of

    drawn = {"samples": given["samples"], "seed": given["seed"], "vary": given["vary"] or []}
    plan = plan_of(given["lists"], **drawn)
    with sweep_progress() as report:
        result = sweep(plan, **given.of(verbs.SweepArguments), progress=report)
    raise typer.Exit(_show(result, as_json=given["json"]))


def _sweep_script(given: TypedLine) -> None:
    lists = {
        Scenario.options()[name].name: None if each is True else each
        for name, each in given["lists"].items()
        if name != "duration_s"
    }
    others = {
        "--samples": given["samples"],
        "--vary": given["vary"],
        "--no-record": not given["record"],
        "--camera": given["camera"],
        **lists,
    }
    refused = [name for name, each in others.items() if each]
    if not given["target"] or not given["tries"] or refused:
        raise ScenarioError(
            "a sweep of a script takes --try, --out, --duration, --seed, --jobs, --ray, --force, "
            "and the script: drop sweep --try friction=0.2,0.4 --out DIR SCRIPT.py; got {others}",
            others=all_of(refused) if refused else "--try" if given["tries"] else "no --try",
        )
    from drop_physics.option_types import number
    from drop_physics.stages.program import digest_of_script
    from drop_physics.stages.sweep.script import sweep_script

    digest_of_script(given["target"], is_module=False)
    duration = given["lists"]["duration_s"]
    with sweep_progress() as report:
        result = sweep_script(
            **given.of(verbs.SweepScriptArguments),
            duration_s=number(duration) if isinstance(duration, str) else None,
            **_told(),
            progress=report,
        )
    raise typer.Exit(_show(result, as_json=given["json"]))


@_verb(
    verbs.RecordArguments,
    group=OWN,
    short="Record a PyBullet or MuJoCo script, unchanged.",
    example="drop record --duration 10 my_script.py --its-own option",
)
def record(given: TypedLine) -> None:
    """Record a script."""
    recorded = _recorded(given, to_stderr=given["json"])
    if recorded.never_began:
        from drop_physics.stages.record import forget

        forget(recorded)
        raise DropError(
            "{failure}; it came to no simulation, so nothing is recorded",
            failure=recorded.error if given["json"] else recorded.failure,
        )
    raise typer.Exit(_show(recorded, as_json=given["json"], stream=sys.stderr))


@_verb(
    verbs.ImportArguments,
    group=OWN,
    short="Record the states that another program has left on disk.",
    example="drop import nan_dump_20260102_030405.npz",
    name="import",
)
def import_(given: TypedLine) -> None:
    """Record the states in a file of another program."""
    from drop_physics.stages.importing import import_states

    asked = given.of(verbs.ImportArguments)
    with progress() as report:
        told = Message("taking steps")
        made = import_states(
            **asked | {"maps": asked["maps"] or ()},
            progress=lambda done, steps: report(told, done, steps),
        )
    _show(made, as_json=given["json"])


@_verb(
    verbs.AnalyzeArguments,
    verbs.RecordArguments,
    group=OWN,
    short="Record and analyze it; options of both come before it.",
    name=SCRIPT,
    add_help_option=False,
)
def script(given: TypedLine) -> None:
    """Record a script, and analyze the recording; `--out` names the recording."""
    target = given["target"]
    commands = given.context.find_root().command.commands  # type: ignore[attr-defined]
    if target in commands:
        raise ScenarioError("options of {verb} come after it: drop {verb} …", verb=target)
    from drop_physics.stages.program import digest_of_script

    digest_of_script(target, is_module=given["is_module"])  # before what takes long to load
    analyzed = _analyzer(given, Path(target), out=None)
    in_text = given["output_format"] == "text" and not given["json"]
    recorded = _recorded(given, to_stderr=not in_text, meanwhile=_load_analysis)
    codes = [1 if recorded.never_began else _show(recorded, stream=sys.stderr, analyzed=True)]
    printed = []
    for each in filter(None, (recorded, recorded.beside)):
        analysis, code = analyzed(each.recording, None if given["is_module"] else Path(target))
        codes.append(code)
        if _as_json(given):
            from drop_physics.report.summary import json_of_summary

            printed.append(analysis.as_json() if given["whole"] else json_of_summary(analysis))
    if printed:
        first, *others = printed
        output.print_json(first | ({"beside": others[0]} if others else {}))
    if recorded.never_began:
        from drop_physics.stages.record import forget

        forget(recorded)
    raise typer.Exit(next(filter(None, codes), 0))


def _note_ours(given: TypedLine) -> None:
    """Print a note if `drop` also has an option that stands after the script."""
    ours = {name for param in given.context.command.params for name in param.opts}
    names = dict.fromkeys(argument.partition("=")[0] for argument in given["arguments"])
    both = [name for name in names if name.startswith("-") and name in ours]
    if both:
        output.note(
            Message(
                "what comes after {target} goes to the script, {names} too; put drop's options "
                "before the script",
                names=all_of(both),
                target=given["target"],
            )
        )


def _again(given: TypedLine) -> Callable[[str], str]:
    """Return a function that returns this command line with another command of drop."""
    from drop_physics.stages.program import command_of

    options = {name: given[name] for name in ("steps", "python")}
    options |= {"duration": given["duration_s"], "seed": given["seed"] or None}
    target = given["target"]
    script: str | Path = f"-m {target}" if given["is_module"] else Path(target)
    return lambda verb: command_of(verb, script, given["arguments"], **options)


def _load_analysis() -> None:
    """Load what analyzes and reports, while the script's process loads its engine."""
    for module in ("stages.analyze", "report.analysis", "report.terminal"):
        importlib.import_module(f"drop_physics.{module}")


def _recorded(
    given: TypedLine, *, to_stderr: bool, meanwhile: Callable[[], None] | None = None
) -> Recorded:
    """Record a script; its standard output goes to drop's own, or to standard error."""
    from drop_physics.stages.program import digest_of_script

    digest_of_script(given["target"], is_module=given["is_module"])  # before what takes a second
    _note_ours(given)
    from drop_physics.console.progress import script_progress
    from drop_physics.stages.record import record_script

    sys.stdout.flush()
    stdout = output.descriptor(sys.stderr if to_stderr else sys.stdout)
    with script_progress() as (progress, note):
        return record_script(
            **given.of(verbs.RecordArguments),
            stdout=stdout,
            note=note,
            progress=progress,
            meanwhile=meanwhile,
        )


@_verb(
    verbs.TrustArguments,
    group=OWN,
    short="How far can a script's result be trusted?",
    example="drop trust --duration 10 my_script.py --its-own option",
)
def trust(given: TypedLine) -> None:
    """Run a script again with variations."""
    from drop_physics.stages.trust import lengths_of, trust

    lengths = lengths_of(given["within"])
    write_page = _page(given, Path(given["target"]))
    _note_ours(given)
    with sweep_progress() as report:
        result = trust(**given.of(verbs.TrustArguments), **_told(), progress=report)
    write_page(result)
    outputs = [each for name in ("table", "plot", "html") if (each := given[name]) is not None]
    shown = {"within": lengths, "outputs": outputs, "again": _again(given)}
    raise typer.Exit(_show(result, as_json=given["json"], **shown))


def _told() -> dict[str, Any]:
    """Return the progress callbacks for commands that run a script repeatedly."""
    return {"stdout": output.descriptor(sys.stderr), "note": output.note}


@_verb(
    verbs.WhyArguments,
    group=OWN,
    short="Prove causes: change one thing, and run it again.",
    example="drop why --about arm my_script.py --its-own option",
)
def why(given: TypedLine) -> None:
    """Run a script again with one change at a time."""
    from drop_physics.stages.program import digest_of_script

    target, film, force = Path(given["target"]), given["film"], given["force"]
    digest_of_script(given["target"], is_module=given["is_module"])
    choice = _choice()
    from drop_physics.stages.why import why

    write_page = _page(given, target)
    if film is not None:
        from drop_physics.stages.render import check_film

        check_film(film, inputs=[target], force=force)
    _note_ours(given)
    asked = given.of(verbs.WhyArguments) | {"drawn": film is not None, "choice": choice}
    with (sweep_progress if given["expect"] is None else search_progress)() as report:
        result = why(**asked, **_told(), progress=report)
    write_page(result, film_of=result.recording, every=given["every"])
    if film is not None:
        from drop_physics.stages.why.film import write_film

        with progress() as drawing:
            write_film(result, film, force=force, progress=drawing)
    shown = {"every": given["every"], "again": _again(given)}
    raise typer.Exit(_show(result, as_json=given["json"], **shown))


@_verb(
    verbs.DiffArguments,
    group=OWN,
    short="Why is one run not the same as another?",
    example="drop diff --with mujoco==3.3.7 --with mujoco==4.0.0 my_script.py",
    context_settings={"ignore_unknown_options": True},  # of the script
)
def diff(given: TypedLine) -> None:
    """Explain why two runs differ."""
    if given["forget"]:
        from drop_physics.stages.diff import wheels

        output.note(Message("forgotten: {count}", count=counted(wheels.forget(), "version")))
        return
    from drop_physics.console.progress import script_progress, swap_progress
    from drop_physics.stages.diff import diff

    with script_progress() as (shown, note), swap_progress() as tell:
        stdout, shows = output.descriptor(sys.stderr), shown or verbs.quiet
        asked = given.of(verbs.DiffArguments)
        result = diff(**asked, note=note, stdout=stdout, tell=tell, progress=shows)
    raise typer.Exit(_show(result, as_json=given["json"]))


@_verb(
    verbs.InfoArguments,
    group=RECORDINGS,
    short="Describe a recording.",
    example="drop info recordings/run.rrd",
)
def info(given: TypedLine) -> None:
    """Describe a recording."""
    recording = _recording(given["recording"])
    from drop_physics.stages.info import info

    _show(info(recording), as_json=given["json"])


@_verb(
    verbs.ExplainArguments,
    group=OWN,
    short="Say what a finding's code means.",
    example="drop explain off-target",
)
def explain(given: TypedLine) -> None:
    """Print the meaning of a finding's code."""
    from drop_physics.stages.explain import explain

    _show(explain(**given.of(verbs.ExplainArguments)), as_json=given["json"])


@_verb(
    verbs.ExportArguments,
    group=RECORDINGS,
    short="Write states, joints, contacts for other tools.",
    example="drop export recordings/run.rrd --out run.mcap",
)
def export(given: TypedLine) -> None:
    """Export a recording to files for other tools."""
    recording = _recording(given["recording"])
    from drop_physics.stages.export import export

    asked = given.of(verbs.ExportArguments) | {"recording": recording}
    _show(export(**asked), as_json=given["json"])


@_verb(
    verbs.ViewArguments,
    group=RECORDINGS,
    short="Open recordings in the Rerun viewer.",
    example="drop view recordings/run.rrd",
)
def view(given: TypedLine) -> None:
    """Open recordings in the viewer."""
    recordings = [_recording(each) for each in given["recordings"] or [None]]
    from drop_physics.stages import view

    with view.view(**given.of(verbs.ViewArguments) | {"recordings": recordings}) as shown:
        _show(shown, as_json=given["json"])
        view.show(shown)
