"""The command `drop`: parse, call a stage, print. No physics and no files here.

Each command imports what it needs when it runs, so that `drop --help` is quick.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from drop_physics import cli_options as given
from drop_physics.cli_options import flag, takes
from drop_physics.console import output
from drop_physics.console.help import BOX, OWN, RECORDINGS, SCRIPT, App, HelpedCommands
from drop_physics.console.progress import progress, sweep_progress
from drop_physics.console.running import main as main
from drop_physics.errors import DropError, ScenarioError
from drop_physics.fields import all_of
from drop_physics.messages import Message
from drop_physics.options import an_integer, takes_options_of, takes_scenario, takes_scenario_lists
from drop_physics.scenario import Camera, Scenario

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
    """Return the recording that is meant."""
    from drop_physics.stages.found import recording_of

    return recording_of(named, output.note)


def _choice(*given: str | None) -> Any:  # noqa: ANN401 - handed on
    """Return which findings are reported, by options as typed and by the project."""
    from drop_physics.stages.settings import settings

    return settings().choice(*given)


def _page(html: Path | None, *inputs: Path, force: bool) -> Callable[..., None]:
    """Return what writes a result as a page; that it can be written is checked before any work."""
    if html is None:
        return lambda *_, **__: None
    from drop_physics.report.page import check_page, write_page

    check_page(html, inputs=inputs, force=force)
    return partial(write_page, page=html, force=force)


def _show(result: Any, **how: Any) -> int:  # noqa: ANN401 - handed on
    """Print a result, and return the exit code."""
    from drop_physics.report.terminal import show

    return show(result, **how)


@app.callback(invoke_without_command=True)
def _drop(
    context: typer.Context,
    version: Annotated[bool, flag("Print the version.", "--version")] = False,
) -> None:
    if version:
        from drop_physics.stages.info import versions

        print(versions())
        raise typer.Exit
    if context.invoked_subcommand is None:
        print(context.get_help())


@app.command(
    rich_help_panel=BOX,
    short_help="Drop the body and record it.",
    epilog="Example: drop simulate --out moon.rrd --gravity moon --duration 2",
)
@takes_scenario
def simulate(
    *,
    out: Annotated[Path, takes("RUN.rrd", "The recording to write.", "--out", "-o")],
    spawn: Annotated[bool, flag("Show the fall live in a viewer.", "--spawn")] = False,
    connect: given.Connect = None,
    force: given.Force = False,
    json: given.Json = False,
    scenario: Scenario,
    camera: Camera | None,
) -> None:
    """Drop the body and record everything that happens."""
    from drop_physics.stages.simulate import simulate

    if spawn and connect is not None:
        raise ScenarioError("--spawn and --connect exclude each other; give one of them")
    viewer = None
    if spawn or connect is not None:
        from drop_physics.stages import view  # with the analysis, which takes half a second

        viewer = view.spawn if connect is None else view.connection(connect)
    with progress() as report:
        simulation = simulate(
            scenario,
            out,
            camera=camera,
            force=force,
            viewer=viewer,
            note=output.note,
            progress=report,
        )
    _show(simulation, as_json=json)


@app.command(
    rich_help_panel=RECORDINGS,
    short_help="Say what happened and why, the worst first.",
    epilog="Example: drop analyze recordings/run.rrd --at 0.1 --at 0.3 --table run.csv",
)
def analyze(
    run: given.RunOrNewest = None,
    *,
    at: given.At = None,
    steps: given.Windows = None,
    whole: Annotated[bool, flag("Explain all steps of a long run of MuJoCo.", "--all")] = False,
    python: given.ExplainsWith = None,
    out: given.Layer = None,
    table: given.Table = None,
    body: given.OfBody = None,
    select: given.Select = None,
    ignore: given.Ignore = None,
    fail_on: given.FailOn = None,
    force: given.Force = False,
    verbose: given.Verbose = False,
    html: given.Page = None,
    output_format: given.OutputFormat = "text",
    json: given.Json = False,
) -> None:
    """Say what happened in a recording, and why.

    Of a script: what went wrong, the worst first, with the call that changes it; then its joints
    and bodies, and with --at the steps at these times, each as a sum of named impulses. Of a drop:
    where each millimetre between simulation and theory comes from.
    """
    from drop_physics.option_types import times

    at_s, recording = times(at or []), _recording(run)
    analyzed = _analyzer(
        recording,
        at_s=at_s,
        steps=steps,
        whole=whole,
        python=python,
        out=out,
        table=table,
        body=body,
        select=select,
        ignore=ignore,
        fail_on=fail_on,
        force=force,
        verbose=verbose,
        html=html,
        output_format="json" if json else output_format,
    )
    analysis, code = analyzed(recording, run)
    if json or output_format == "json":
        output.print_json(analysis.as_json())
    raise typer.Exit(code)


def _analyzer(
    read: Path,
    *,
    at_s: list[float],
    steps: list[str] | None,
    whole: bool,
    select: str | None,
    ignore: str | None,
    fail_on: str | None,
    table: Path | None,
    force: bool,
    verbose: bool,
    html: Path | None,
    output_format: str,
    **how: Any,  # noqa: ANN401 - handed on
) -> Callable[[Path, Path | None], tuple[Any, int]]:
    """Return what analyzes a recording of a script and prints what is found, unless as JSON.

    That all can be done is checked before any work; `read` is the file that is read.
    """
    choice = _choice(select, ignore, fail_on)
    from drop_physics.files.outputs import check_table
    from drop_physics.option_types import checked_windows

    if table is not None:
        check_table(table, force=force)
    write_page = _page(html, read, force=force)
    windows = checked_windows(steps or [])

    def analyzed(recording: Path, script: Path | None) -> tuple[Any, int]:
        from drop_physics.stages.analyze import analyze
        from drop_physics.stages.explaining import WhatToExplain

        with progress() as report:
            analysis = analyze(
                recording,
                at_s=at_s,
                explain=WhatToExplain(windows, whole=whole),
                table=table,
                choice=choice,
                script=script,
                force=force,
                progress=report,
                **how,
            )
        write_page(analysis, film_of=recording, verbose=verbose)
        text = "" if output_format == "json" else None
        if output_format in ("github", "sarif"):
            from drop_physics.report.annotations import FORMATS

            text = FORMATS[output_format](analysis)
        return analysis, _show(analysis, text=text, verbose=verbose, choice=choice)

    return analyzed


@app.command(
    rich_help_panel=RECORDINGS,
    short_help="Make a gif of the frames, and a plot.",
    epilog="Example: drop render recordings/run.rrd --with-plot --out fall.webp",
)
def render(
    run: given.RunOrNewest = None,
    *,
    out: given.Film = None,
    fps: given.Fps = None,
    speed: given.Speed = None,
    caption: given.Caption = False,
    with_plot: given.WithPlot = False,
    dark: given.Dark = False,
    plot: given.Plot = None,
    view: given.Look = None,
    body: given.OfBody = None,
    select: given.Select = None,
    ignore: given.Ignore = None,
    force: given.Force = False,
    json: given.Json = False,
) -> None:
    """Make a gif of the recorded frames, and a plot of heights and errors.

    With --camera, or if a script took no images, the gif shows the recorded poses; the plot of a
    script is about its findings.
    """
    recording = _recording(run)
    choice = _choice(select, ignore)
    from drop_physics.figures.playback import Animation
    from drop_physics.stages.render import render

    animation = Animation(fps=fps, speed=speed, caption=caption, with_plot=with_plot)
    with progress() as report:
        rendering = render(
            recording,
            out=out,
            animation=animation,
            plot=plot,
            dark=dark,
            view=view,
            body=body,
            choice=choice,
            script=run,
            force=force,
            progress=report,
        )
    _show(rendering, as_json=json, recording=recording)


@app.command(
    rich_help_panel=BOX,
    short_help="Simulate, analyze and render: the whole story.",
    epilog="Example: drop run --timestep 1/480",
)
@takes_scenario
def run(
    *,
    out_dir: given.Folder = Path("recordings"),
    at: given.At = None,
    fps: given.Fps = None,
    speed: given.Speed = None,
    caption: given.Caption = False,
    with_plot: given.WithPlot = False,
    dark: given.Dark = False,
    json: given.Json = False,
    scenario: Scenario,
    camera: Camera | None,
) -> None:
    """Simulate, analyze and render: the whole story of one drop."""
    from drop_physics.figures.playback import Animation
    from drop_physics.option_types import times
    from drop_physics.stages.run import run

    animation = Animation(fps=fps, speed=speed, caption=caption, with_plot=with_plot)
    with progress() as report:
        result = run(
            scenario,
            out_dir,
            camera=camera,
            at_s=times(at or []),
            animation=animation,
            dark=dark,
            note=output.note,
            progress=report,
        )
    _show(result, as_json=json)


@app.command(
    rich_help_panel=RECORDINGS,
    short_help="Compare with a golden recording.",
    epilog="Example: drop check run.rrd --against recordings/golden/standard.rrd",
)
def check(
    run: given.Run,
    *,
    against: Annotated[Path, takes("GOLDEN.rrd", "The recording to compare with.")],
    tolerance: given.Tolerance = None,
    update: Annotated[bool, flag("Make RUN.rrd the golden recording.", "--update")] = False,
    summary: given.Summary = None,
    html: given.Page = None,
    force: given.Force = False,
    json: given.Json = False,
) -> None:
    """Compare a recording with a golden one; exit with 3 if the physics differs.

    Both must be of a drop, or both of a script.
    """
    from drop_physics.files.outputs import check_apart, check_target
    from drop_physics.report.check import append_summary
    from drop_physics.stages.check import check
    from drop_physics.stages.settings import settings

    if summary is not None:
        check_target(summary, force=True)
        check_apart([summary], inputs=[run, against])
    write_page = _page(html, run, against, force=force)
    allowed_m = settings().tolerance_m if tolerance is None else tolerance
    checked = check(run, against, tolerance_m=allowed_m, update=update)
    if summary is not None:
        append_summary(checked, summary)
    write_page(checked)
    raise typer.Exit(_show(checked, as_json=json))


@app.command(
    rich_help_panel=BOX,
    short_help="Run many scenarios, or a script with many interventions.",
    epilog="Example: drop sweep --timestep 1/240,1/480,1/960 --out sweep",
    context_settings={"allow_interspersed_args": False},
)
@takes_scenario_lists
def sweep(
    *,
    program: given.Swept = None,
    out: given.SweepFolder,
    tries: given.SweepTries = None,
    at: Annotated[str, takes("SECONDS", "Time at which to break the error down [s].")] = "0.3",
    samples: given.Samples = None,
    seed: Annotated[int, takes("S", "Random seed.", parser=an_integer)] = 0,
    vary: given.Draws = None,
    jobs: given.SweepJobs = None,
    ray: given.Ray = None,
    no_record: Annotated[bool, flag("Keep the numbers, but no recordings.", "--no-record")] = False,
    force: given.Force = False,
    again: given.Again = False,
    json: given.Json = False,
    lists: dict[str, str | bool | None],
    camera: Camera | None,
) -> None:
    """Run many scenarios, or a script with many interventions: a row for each run.

    Every scenario option takes a list A,B,C; vectors are separated by semicolons: "0,0,0;0,0,1".
    The sweep is the product of the lists, in the order of the options below, the last one changing
    fastest. With --try, it is a script that runs, once for each combination; of the options below
    it takes --duration.
    """
    if program or tries:
        others = {
            "samples": samples,
            "vary": vary,
            "no-record": no_record,
            "camera": camera,
            **{
                Scenario.options()[name].name[2:]: None if each is True else each
                for name, each in lists.items()
                if name != "duration_s"
            },
        }
        refused = [f"--{name}" for name, each in others.items() if each]
        _sweep_script(
            program, tries, refused, lists["duration_s"], out, seed, jobs, ray, force, again, json
        )
    from drop_physics.option_types import times
    from drop_physics.stages.sweep import sweep
    from drop_physics.sweeping.plan import plan_of

    plan = plan_of(lists, samples=samples, seed=seed, vary=vary or [])
    with sweep_progress() as report:
        result = sweep(
            plan,
            out,
            at_s=times([at])[0],
            record=not no_record,
            camera=camera,
            jobs=jobs,
            ray=ray,
            force=force,
            progress=report,
        )
    raise typer.Exit(_show(result, as_json=json))


def _sweep_script(
    program: list[str] | None,
    tries: list[str] | None,
    refused: list[str],
    duration: str | bool | None,
    out: Path,
    seed: int,
    jobs: int | None,
    ray: str | None,
    force: bool,
    again: bool,
    json: bool,
) -> None:

    if not program or not tries or refused:
        raise ScenarioError(
            "a sweep of a script takes --try, --out, --duration, --seed, --jobs, --ray, --force, "
            "and the script: drop sweep --try friction=0.2,0.4 --out DIR SCRIPT.py; got {others}",
            others=all_of(refused) if refused else "--try" if tries else "no --try",
        )
    from drop_physics.option_types import number
    from drop_physics.stages.program import digest_of_script
    from drop_physics.stages.sweep_script import sweep_script

    target, *arguments = program
    digest_of_script(target, is_module=False)
    with sweep_progress() as report:
        result = sweep_script(
            target,
            arguments,
            tries=tries,
            out=out,
            duration_s=number(duration) if isinstance(duration, str) else None,
            seed=seed,
            jobs=jobs,
            ray=ray,
            force=force,
            again=again,
            stdout=output.descriptor(sys.stderr),
            note=output.note,
            progress=report,
        )
    raise typer.Exit(_show(result, as_json=json))


@app.command(
    rich_help_panel=OWN,
    short_help="Record a PyBullet or MuJoCo script, unchanged.",
    epilog="Example: drop record --duration 10 my_script.py --its-own option",
    context_settings={"allow_interspersed_args": False},
)
def record(
    context: typer.Context,
    program: given.Program,
    *,
    module: given.Module = False,
    out: given.Recording = None,
    steps: given.Steps = None,
    duration: given.Duration = None,
    seed: given.Seed = None,
    twice: given.Twice = False,
    again: given.Again = False,
    python: given.Python = None,
    keep_sleeping: given.KeepSleeping = False,
    force: given.Force = False,
    keep: given.Keep = False,
    no_explain: given.NoExplain = False,
    json: given.Json = False,
) -> None:
    """Run a script that uses PyBullet or MuJoCo, and record everything that happens.

    It runs until it ends, or until Ctrl-C, which keeps everything up to there. Options of drop
    come before the script; everything after it goes to the script. Standard output is left to the
    script.
    """
    recorded = _recorded(
        context,
        program,
        to_stderr=json,
        module=module,
        out=out,
        steps=steps,
        duration=duration,
        seed=seed,
        twice=twice,
        again=again,
        python=python,
        keep_sleeping=keep_sleeping,
        force=force,
        keep=keep,
        no_explain=no_explain,
        json=json,
    )
    if recorded.never_began:
        from drop_physics.stages.record import forget

        forget(recorded)
        raise DropError(
            "{failure}; it came to no simulation, so nothing is recorded",
            failure=recorded.error if json else recorded.failure,
        )
    raise typer.Exit(_show(recorded, as_json=json, stream=sys.stderr))


@app.command(
    SCRIPT,
    rich_help_panel=OWN,
    short_help="Record and analyze it; options of both come before it.",
    add_help_option=False,
    context_settings={"allow_interspersed_args": False},
)
@takes_options_of(analyze, record)
def script(
    context: typer.Context,
    program: given.Program,
    *,
    of_record: Mapping[str, Any],
    of_analyze: Mapping[str, Any],
) -> None:
    """Record a script as `record` does, and analyze the recording.

    Options of both verbs come before the script; `--out` names the recording.
    """
    verbs = context.find_root().command.commands  # type: ignore[attr-defined]
    if program[0] in verbs:
        raise ScenarioError("options of {verb} come after it: drop {verb} …", verb=program[0])
    from drop_physics.option_types import times
    from drop_physics.stages.program import digest_of_script

    at_s = times(of_analyze["at"] or [])
    digest_of_script(program[0], is_module=of_record["module"])  # before what takes long to load
    as_json = of_analyze["json"] or of_analyze["output_format"] == "json"
    how = {name: value for name, value in of_analyze.items() if name not in ("at", "out", "json")}
    how["steps"] = None  # those of record end the run
    if as_json:
        how["output_format"] = "json"
    script = Path(program[0])
    analyzed = _analyzer(script, at_s=at_s, **how)
    in_text = how["output_format"] == "text"
    recorded = _recorded(context, program, to_stderr=not in_text, **of_record)
    codes = [1 if recorded.never_began else _show(recorded, stream=sys.stderr, analyzed=True)]
    printed = []
    for each in filter(None, (recorded, recorded.beside)):
        analysis, code = analyzed(each.recording, None if of_record["module"] else script)
        codes.append(code)
        printed.append(analysis.as_json())
    if as_json:
        first, *others = printed
        output.print_json(first | ({"beside": others[0]} if others else {}))
    if recorded.never_began:
        from drop_physics.stages.record import forget

        forget(recorded)
    raise typer.Exit(next(filter(None, codes), 0))


def _note_ours(context: typer.Context, program: list[str]) -> None:
    """Say which of a script's arguments are options of ours, too: perhaps they were meant so."""
    target, *arguments = program
    ours = {name for each in context.command.params for name in each.opts}
    names = dict.fromkeys(argument.partition("=")[0] for argument in arguments)
    both = [name for name in names if name.startswith("-") and name in ours]
    if both:
        output.note(
            Message(
                "what comes after {target} goes to the script, {names} too; put drop's options "
                "before the script",
                names=all_of(both),
                target=target,
            )
        )


def _again(
    program: list[str],
    module: bool,
    **options: Any,  # noqa: ANN401 - handed on
) -> Callable[[str], str]:
    """Return the command that does the same with another verb; 0 is a seed that verbs set."""
    from drop_physics.stages.program import command_of

    target, *arguments = program
    script: str | Path = f"-m {target}" if module else Path(target)
    options["seed"] = options["seed"] or None
    return lambda verb: command_of(verb, script, arguments, **options)


def _recorded(
    context: typer.Context,
    program: list[str],
    *,
    to_stderr: bool,
    module: bool,
    duration: float | None,
    no_explain: bool,
    json: bool,  # noqa: ARG001 - an option of the command, which prints
    **how: Any,  # noqa: ANN401 - handed on
) -> Recorded:
    """Record a script, whose standard output goes to ours, or to standard error."""
    from drop_physics.stages.program import digest_of_script

    target, *arguments = program
    digest_of_script(target, is_module=module)  # before what takes a second to load
    _note_ours(context, program)
    from drop_physics.console.progress import script_progress
    from drop_physics.stages.record import record_script

    sys.stdout.flush()
    with script_progress() as (progress, note):
        return record_script(
            target,
            arguments,
            is_module=module,
            duration_s=duration,
            explain=not no_explain,
            stdout=output.descriptor(sys.stderr if to_stderr else sys.stdout),
            note=note,
            progress=progress,
            **how,
        )


@app.command(
    rich_help_panel=OWN,
    short_help="How far can a script's result be trusted?",
    epilog="Example: drop trust --duration 10 my_script.py --its-own option",
    context_settings={"allow_interspersed_args": False},
)
def trust(
    context: typer.Context,
    program: given.Program,
    *,
    module: given.Module = False,
    vary: given.Variations = None,
    out: given.TrustFolder = None,
    within: given.Within = None,
    steps: given.Steps = None,
    duration: given.Duration = None,
    seed: given.SetSeed = 0,
    jobs: given.Jobs = None,
    ray: given.Ray = None,
    table: given.TrustTable = None,
    plot: given.TrustPlot = None,
    dark: given.Dark = False,
    html: given.Page = None,
    again: given.Again = False,
    python: given.Python = None,
    force: given.Force = False,
    json: given.Json = False,
) -> None:
    """Run a script again with variations, and say how much of its result stands.

    Variations: half and a quarter of the timestep, four times the solver's iterations, everything
    moved by 1e-9 before the first step, and another random seed; of PyBullet also a residual
    threshold of 0, of MuJoCo another solver, the other cone and impratio 10.
    """
    from drop_physics.console.progress import sweep_progress
    from drop_physics.stages.trust import lengths_of, trust

    target, *arguments = program
    lengths = lengths_of(within)
    write_page = _page(html, Path(target), force=force)
    _note_ours(context, program)
    with sweep_progress() as report:
        result = trust(
            target,
            arguments,
            out=out,
            vary=vary,
            is_module=module,
            steps=steps,
            duration_s=duration,
            seed=seed,
            python=python,
            jobs=jobs,
            ray=ray,
            force=force,
            again=again,
            stdout=output.descriptor(sys.stderr),
            table=table,
            plot=plot,
            dark=dark,
            note=output.note,
            progress=report,
        )
    write_page(result)
    outputs = [each for each in (table, plot, html) if each is not None]
    repeat = _again(program, module, steps=steps, duration=duration, seed=seed, python=python)
    raise typer.Exit(_show(result, as_json=json, within=lengths, outputs=outputs, again=repeat))


@app.command(
    rich_help_panel=OWN,
    short_help="Prove causes: change one thing, and run it again.",
    epilog="Example: drop why --about arm my_script.py --its-own option",
    context_settings={"allow_interspersed_args": False},
)
def why(
    context: typer.Context,
    program: given.Program,
    *,
    module: given.Module = False,
    about: given.About = None,
    tries: given.Tries = None,
    ablate: given.Ablate = False,
    again: given.Again = False,
    budget: given.Budget = 60.0,
    every: given.Every = False,
    out: given.WhyFolder = None,
    steps: given.Steps = None,
    duration: given.Duration = None,
    seed: given.SetSeed = 0,
    jobs: given.Jobs = None,
    ray: given.Ray = None,
    html: given.Page = None,
    film: given.WhyFilm = None,
    python: given.Python = None,
    force: given.Force = False,
    json: given.Json = False,
) -> None:
    """Record a script, then run it again with one thing changed at a time.

    It tries what the findings propose: a motor's force, damping, friction, gains. A change that
    removes a symptom, and moves the outcome by more than chance does, undoes its cause.
    """
    from drop_physics.stages.program import digest_of_script

    target, *arguments = program
    digest_of_script(target, is_module=module)
    choice = _choice()
    from drop_physics.console.progress import sweep_progress
    from drop_physics.stages.why import why

    write_page = _page(html, Path(target), force=force)
    if film is not None:
        from drop_physics.stages.render import check_film

        check_film(film, inputs=[Path(target)], force=force)
    _note_ours(context, program)
    with sweep_progress() as report:
        result = why(
            target,
            arguments,
            is_module=module,
            about=about,
            tries=tries or (),
            ablate=ablate,
            again=again,
            budget_s=budget,
            out=out,
            steps=steps,
            duration_s=duration,
            seed=seed,
            python=python,
            jobs=jobs,
            ray=ray,
            force=force,
            drawn=film is not None,
            choice=choice,
            stdout=output.descriptor(sys.stderr),
            note=output.note,
            progress=report,
        )
    write_page(result, film_of=result.recording, every=every)
    if film is not None:
        from drop_physics.stages.why_film import write_film

        with progress() as drawing:
            write_film(result, film, force=force, progress=drawing)
    repeat = _again(program, module, steps=steps, duration=duration, seed=seed, python=python)
    raise typer.Exit(_show(result, as_json=json, every=every, again=repeat))


@app.command(
    rich_help_panel=RECORDINGS,
    short_help="Describe a recording.",
    epilog="Example: drop info recordings/run.rrd",
)
def info(run: given.RunOrNewest = None, *, json: given.Json = False) -> None:
    """Describe a recording: what made it, its length, its bodies, and whether it is complete."""
    recording = _recording(run)
    from drop_physics.stages.info import info

    _show(info(recording), as_json=json)


@app.command(
    rich_help_panel=OWN,
    short_help="Say what a finding's code means.",
    epilog="Example: drop explain off-target",
)
def explain(
    code: Annotated[
        str | None, typer.Argument(metavar="CODE", help="A finding's code, or its reason.")
    ] = None,
    *,
    every: Annotated[bool, flag("List all codes, a line each.", "--list")] = False,
    json: given.Json = False,
) -> None:
    """Say what a finding's code means, what is measured, its threshold, an example and the cure."""
    from drop_physics.stages.explain import explain

    _show(explain(code, every=every), as_json=json)


@app.command(
    rich_help_panel=RECORDINGS,
    short_help="Write states, joints, contacts for other tools.",
    epilog="Example: drop export recordings/run.rrd --out run.mcap",
)
def export(
    run: given.RunOrNewest = None,
    *,
    out: given.Exported = None,
    force: given.Force = False,
    json: given.Json = False,
) -> None:
    """Write states, joints and contact points of a recording for other tools.

    As tables, or as MCAP for Foxglove and PlotJuggler: joints as /joint_states, poses of centres of
    mass as transforms on /tf, contact points on /contacts.
    """
    recording = _recording(run)
    from drop_physics.stages.export import export

    _show(export(recording, out, force=force), as_json=json)


@app.command(
    rich_help_panel=RECORDINGS,
    short_help="Open recordings in the Rerun viewer.",
    epilog="Example: drop view recordings/run.rrd",
)
def view(
    runs: given.RunsOrNewest = None,
    *,
    web: Annotated[bool, flag("Open them in a browser.", "--web")] = False,
    against: given.Beside = None,
    json: given.Json = False,
) -> None:
    """Open recordings and their analyses in the Rerun viewer; ends when that is closed."""
    named: list[Path | None] = [*runs] if runs else [None]
    recordings = [_recording(each) for each in named]
    from drop_physics.stages import view

    with view.view(recordings, against=against, web=web) as shown:
        _show(shown, as_json=json)
        view.show(shown)
