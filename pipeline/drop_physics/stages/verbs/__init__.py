"""Arguments of the verbs: options of the command line, and arguments in Python.

No large library is loaded here, since `drop --help` needs all of these: types of such libraries are
given as strings.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from drop_physics.option_types import checked_episodes, checked_windows, times
from drop_physics.scenario import STANDARD_CAMERA, Camera, Scenario
from drop_physics.scenario import View as CameraView
from drop_physics.stages.verbs.taken import argument, flag, takes

if TYPE_CHECKING:
    from drop_physics.figures.playback import Animation
    from drop_physics.rules.choice import Choice
    from drop_physics.stages.analyze.explaining import WhatToExplain
    from drop_physics.sweeping.plan import Plan
    from drop_physics.workers import Worker


def quiet(*_: Any) -> None:  # noqa: ANN401 - whatever is said
    """Print nothing."""


# -- what several verbs take ----------------------------------------------------------------------

File = Path | str
OUT = "--out", "-o"

Json = Annotated[bool, flag("Print one JSON object, for scripts.")]
Force = Annotated[bool, flag("Replace files that exist.")]
Page = Annotated[
    Path | None, takes("FILE", "Also write the report as one self-contained .html page.")
]
Read = Annotated[
    File,
    argument(
        "RUN.rrd",
        "The recording to read, or the script that it was made from. [default: the newest in "
        "recordings/]",
        default=None,
    ),
]
Body = Annotated[str | None, takes("NAME|ID", "For a script's recording: this body only.")]
At = Annotated[
    Sequence[float],
    takes(
        "SECONDS",
        "Time at which to break the error down [s]; repeatable. [default: 0.3]",
        read=times,
    ),
]
Select = Annotated[str | None, takes("CODE,…", "Report only these findings; all: leave none out.")]
Ignore = Annotated[str | None, takes("CODE,…", "Leave these findings out.")]
Chosen = Annotated["Choice | None", "Which findings are reported; None for all."]
Source = Annotated[
    Path | None, "Where the recorded script is, if known: its comments leave findings out."
]
Fps = Annotated[
    float | None,
    takes("NUMBER", "Pictures per second of the gif, at most 50. [default: 20]"),
]
Speed = Annotated[
    float | None,
    takes("NUMBER", "Simulated seconds per second: 1 is real time, 0.25 slow motion."),
]
Caption = Annotated[bool, flag("Write time, height and error below each frame.")]
WithPlot = Annotated[
    bool, flag("Beside the frames, plot heights and error, or a script's findings.")
]
Played = Annotated[
    "Animation | None", "How the film plays, and what is beside it; None for each frame once."
]
Dark = Annotated[bool, flag("Draw plots for a dark page.")]
Dropped = Annotated[Scenario, "What to drop, and how."]
Seen = Annotated[Camera | None, "How to take frames of the fall; None for no frames."]
Drawer = Annotated["Worker | None", "A worker that draws; more are started where there is much."]
Note = Annotated[
    Callable[[str], None], "Called with a sentence worth knowing that is not an error."
]
Progress = Annotated[Callable[..., None], "Called while it runs."]
Target = Annotated[str, argument("SCRIPT.py …", "The script to run, and its arguments.")]
Arguments = Annotated[Sequence[str], "The script's own arguments."]
Module = Annotated[bool, flag("Run a module by its name, as python -m does.", "-m")]
Steps = Annotated[int | None, takes("N", "Stop it after N steps.")]
Duration = Annotated[float | None, takes("SECONDS", "Stop it after this simulated time [s].")]
SEEDED = takes("N", "Seed random and numpy.random with N.")
Again = Annotated[
    bool,
    flag(
        "Run it again even if it opens sockets or devices, or writes where nothing keeps it from "
        "doing so."
    ),
]
Python = Annotated[str | None, takes("PATH", "The interpreter to run it with; 3.9 or later.")]
Stdout = Annotated[int, "File descriptor of the script's standard output, in its own run."]
Jobs = Annotated[int | None, takes("N", "Worker processes; by default one per core.")]
Ray = Annotated[str | None, takes("ADDRESS", "Run on a Ray cluster: auto, local or its address.")]


@dataclass(frozen=True)
class Printed:
    """Arguments of a verb that prints a result."""

    json: ClassVar[Json] = False


@dataclass(frozen=True)
class OfScript(Printed):
    """Arguments of a verb that runs a script."""

    target: Target
    arguments: Arguments = ()
    _: KW_ONLY
    is_module: Module = False
    steps: Steps = None
    duration_s: Duration = None
    again: Again = False
    python: Python = None
    force: Force = False
    stdout: Stdout = 1
    note: Note = quiet


# -- a script -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class RecordArguments(OfScript):
    """Run a script that uses PyBullet or MuJoCo, and record everything that happens.

    It runs until it ends, or until Ctrl-C, which keeps everything up to there. Options of drop
    come before the script; everything after it goes to the script. Standard output is left to the
    script.
    """

    _: KW_ONLY
    out: Annotated[
        File | None,
        takes(
            "RUN.rrd",
            "The recording to write. [default: recordings/SCRIPT.rrd, in place of the script's "
            "earlier one]",
            *OUT,
        ),
    ] = None
    seed: Annotated[int | None, SEEDED] = None
    twice: Annotated[bool, flag("Run it again, and report the first step that differs.")] = False
    keep_sleeping: Annotated[
        bool, flag("Let its sleeps take real time; by default its clock is virtual.")
    ] = False
    keep: Annotated[bool, flag("Keep earlier recordings of the script, and number this one.")] = (
        False
    )
    episodes: Annotated[
        Literal["failing", "all"] | int | None,
        takes(
            "failing|all|N",
            "Keep the steps of these episodes of MuJoCo's environments, and a line of each other. "
            "[default: all; after half a million steps of a small robot, the last that failed]",
            read=checked_episodes,
        ),
    ] = None
    explain: Annotated[
        bool, flag("Do not replay MuJoCo's steps: record them, unexplained.", "--no-explain")
    ] = True
    listens: Annotated[
        bool, "Whether to note what it reaches: sockets, programs, files elsewhere."
    ] = False
    evaluator: Annotated[
        Mapping[str, Any] | None, "What is evaluated in the run, as `Program` has it."
    ] = None
    progress: Annotated[
        Callable[[float, int], None] | None,
        "Called ten times a second with the simulated time [s] and the number of steps. Without "
        "it, a script without a limit that runs for a minute gets a note that says how to stop it.",
    ] = None
    meanwhile: Annotated[
        Callable[[], object] | None, "Called once, while the script's process starts."
    ] = None


@dataclass(frozen=True)
class ImportArguments(Printed):
    """Record the states that another program has left in a file, and hold them against MuJoCo.

    An npz file with qpos, qvel and perhaps time, ctrl and more, a NaN dump of mjlab's, or an hdf5
    file as robomimic and LIBERO have. MuJoCo takes its own step from each state: within rounding
    it leads to the next one, or the report says by which term it does not.
    """

    file: Annotated[File, argument("FILE", "The file to read: .npz, .hdf5 or .h5.")]
    _: KW_ONLY
    model: Annotated[
        File | None,
        takes(
            "M.xml|.mjb",
            "The model that the states are of. [default: the one in the file, or beside it]",
        ),
    ] = None
    maps: Annotated[
        Sequence[str],
        takes(
            "KEY=ARRAY",
            "Which array of the file is what: time, qpos, qvel, ctrl, act, mocap_pos, mocap_quat, "
            "qfrc_applied, xfrc_applied, eq_active, qacc_warmstart or states; repeatable.",
            "--map",
            default=None,
        ),
    ] = ()
    world: Annotated[
        int | None,
        takes(
            "K",
            "Which of several worlds or demonstrations. [default: the first that becomes no "
            "number, or the one that is apart, or 0]",
        ),
    ] = None
    out: Annotated[
        File | None,
        takes("RUN.rrd", "The recording to write. [default: recordings/FILE.rrd]", *OUT),
    ] = None
    force: Force = False
    progress: Progress = quiet


@dataclass(frozen=True)
class TrustArguments(OfScript):
    """Run a script again with variations, and say how much of its result stands.

    Variations: half and a quarter of the timestep, four times the solver's iterations, everything
    moved by 1e-9 before the first step, and another random seed; of PyBullet also a residual
    threshold of 0, of MuJoCo another solver, the other cone and impratio 10.
    """

    _: KW_ONLY
    vary: Annotated[
        Sequence[str] | None,
        takes(
            "NAME=V,…",
            "Instead of the usual variations: values of an engine parameter or of gravity [m/s²], "
            "factors of friction or mass, timestep/8, iterations*2, nudge, seed; repeatable.",
        ),
    ] = None
    out: Annotated[
        File | None,
        takes("DIR", "Folder for the recordings. [default: recordings/SCRIPT-trust]", *OUT),
    ] = None
    within: ClassVar[
        Annotated[
            str | None,
            takes(
                "LENGTH",
                "Exit with 3 if a variation ends farther away than this: 1mm, 0.5deg, or both, "
                "with a comma; metres where no unit is given.",
            ),
        ]
    ] = None
    seed: Annotated[int, SEEDED] = 0
    jobs: Jobs = None
    ray: Ray = None
    table: Annotated[
        File | None, takes("FILE", "Also write all distances to a .csv or .parquet file.")
    ] = None
    plot: Annotated[File | None, takes("FILE", "Also plot them over time, as .png or .svg.")] = None
    dark: Dark = False
    html: ClassVar[Page] = None
    progress: Progress = quiet


@dataclass(frozen=True)
class WhyArguments(OfScript):
    """Record a script, then run it again with one thing changed at a time.

    It tries what the findings propose: a motor's force, damping, friction, gains. A change that
    removes a symptom, and moves the outcome by more than chance does, undoes its cause.
    """

    _: KW_ONLY
    expect: Annotated[
        str | None,
        takes(
            "EXPRESSION",
            "Say which single change of the run makes this true: z('cube') > 0.3.",
        ),
    ] = None
    about: Annotated[
        str | None,
        takes("CODE|BODY|JOINT", "Try only what findings about this code, body or joint propose."),
    ] = None
    tries: Annotated[
        Sequence[str],
        takes(
            "NAME[=V]",
            "Instead of what findings propose: force=70, default-motor-off, damping, friction=2, "
            "timestep/4, …, or a change that --expect has printed in its JSON; repeatable.",
            "--try",
        ),
    ] = ()
    ablate: Annotated[
        bool,
        flag("Leave out in turn each call or statement that sets something, each argument."),
    ] = False
    budget_s: Annotated[
        float, takes("SECONDS", "Longest time that all of it takes, once the script has run [s].")
    ] = 60.0
    every: ClassVar[
        Annotated[
            bool, flag("Show every trial, and everything that the outcome hangs on.", "--all")
        ]
    ] = False
    out: Annotated[
        File | None,
        takes("DIR", "Folder for the recording and its trials. [default: recordings]", *OUT),
    ] = None
    seed: Annotated[int, SEEDED] = 0
    jobs: Jobs = None
    ray: Ray = None
    html: ClassVar[Page] = None
    film: ClassVar[
        Annotated[
            Path | None,
            takes(
                "FILE", "Film the script's own run and its best trial side by side: .gif, .mp4 …"
            ),
        ]
    ] = None
    drawn: Annotated[bool, "Whether trials hold what is only for looking, too, for a film."] = False
    choice: Chosen = None
    progress: Progress = quiet


@dataclass(frozen=True)
class DiffArguments(Printed):
    """Say until when two runs are the same, what makes them part, and prove it; exit with 3.

    A and B are scripts or recordings; or one script, run in two ways: options that may be given
    twice are for one side each, in order. What is given once is for the second side.
    """

    words: Annotated[
        Sequence[str] | None,
        argument(
            "A B", "Two scripts or recordings; or one script, and its arguments.", default=None
        ),
    ]
    _: KW_ONLY
    packages: Annotated[
        Sequence[str],
        takes(
            "PACKAGE==VERSION",
            "Run one side with this version, fetched once; repeatable.",
            "--with",
        ),
    ] = ()
    arguments: Annotated[
        Sequence[str], takes('"ARG …"', "Arguments of the script; repeatable.", "--args")
    ] = ()
    variables: Annotated[
        Sequence[str], takes("NAME=VALUE", "A variable of one side; repeatable.", "--env")
    ] = ()
    pythons: Annotated[
        Sequence[str], takes("PATH", "The interpreter of one side; repeatable.", "--python")
    ] = ()
    twice: Annotated[bool, flag("Compare the script with itself, run twice.")] = False
    revision: Annotated[
        str | None,
        takes("REV", "Compare the script as committed in Git, as HEAD, with what it is.", "--rev"),
    ] = None
    tolerance: Annotated[
        float,
        takes(
            "NUMBER",
            "Largest difference of a position or velocity that passes [m, rad, m/s, rad/s].",
        ),
    ] = 0.0
    align: Annotated[
        Literal["step", "time"],
        takes("HOW", "Which steps of MuJoCo correspond: those of one number, or of one time."),
    ] = "step"
    steps: Steps = None
    out: Annotated[File | None, takes("DIR", "Keep both recordings in this folder.", *OUT)] = None
    forget: ClassVar[
        Annotated[bool, flag("Delete the versions that --with has fetched, and do nothing else.")]
    ] = False
    force: Force = False
    stdout: Stdout = 1
    note: Note = quiet
    progress: Annotated[
        Callable[[float, int], None],
        "Called with the simulated time [s] and the number of steps of a script.",
    ] = quiet
    tell: Annotated[
        Callable[[int], None], "Called with the number of times that steps were made again."
    ] = quiet


# -- a recording ----------------------------------------------------------------------------------


@dataclass(frozen=True)
class AnalyzeArguments(Printed):
    """Say what happened in a recording, and why.

    Of a script: what went wrong, the worst first, with the call that changes it; then its joints
    and bodies, and with --at the steps at these times, each as a sum of named impulses. Of a drop:
    where each millimetre between simulation and theory comes from.
    """

    recording: Read
    _: KW_ONLY
    at_s: At = ()
    episode: Annotated[
        int | None,
        takes(
            "N",
            "Tell the account and the joints of the end of this episode. [default: the last one "
            "that failed; without one, of the whole run]",
        ),
    ] = None
    windows: ClassVar[
        Annotated[
            Sequence[tuple[int, int]],
            takes(
                "A:B",
                "Steps of a long run of MuJoCo to explain, from A to before B; repeatable.",
                "--steps",
                read=checked_windows,
            ),
        ]
    ] = ()
    whole: ClassVar[
        Annotated[
            bool,
            flag(
                "Explain all steps of a long run of MuJoCo, and tell the whole run; with --json, "
                "all of the analysis also where a script is named first.",
                "--all",
            ),
        ]
    ] = False
    python: Annotated[
        str | None,
        takes("PATH", "An interpreter with the MuJoCo of the recording. [default: the script's]"),
    ] = None
    out: Annotated[
        File | None, takes("LAYER.rrd", "The layer to write. [default: RUN.analysis.rrd]", *OUT)
    ] = None
    table: Annotated[
        File | None, takes("FILE", "Write every sample to a .parquet or .csv file.")
    ] = None
    body: Body = None
    account: ClassVar[
        Annotated[
            int | None,
            takes(
                "N", "Show at most N rows of the account. [default: 6; 12 where nothing is found]"
            ),
        ]
    ] = None
    about: Annotated[
        str | None,
        takes("BODY|JOINT", "Begin the account with the rows about this body, link or joint."),
    ] = None
    select: ClassVar[Select] = None
    ignore: ClassVar[Ignore] = None
    fail_on: ClassVar[
        Annotated[
            str | None,
            takes(
                "LEVEL",
                "Exit with 3 if a finding has this level or a worse one: broken, asked, model, "
                "repeat, note; or never.",
            ),
        ]
    ] = None
    force: Force = False
    verbose: ClassVar[
        Annotated[
            bool,
            flag("Show all: flights, contacts, every joint and finding.", "--verbose", "-v"),
        ]
    ] = False
    html: ClassVar[Page] = None
    output_format: ClassVar[
        Annotated[
            Literal["text", "json", "github", "sarif"],
            takes(
                "FORMAT",
                "How to print it: text, json, github (annotations of GitHub Actions) or sarif "
                "(code scanning).",
            ),
        ]
    ] = "text"
    explain: Annotated[
        "WhatToExplain | None",
        "Which steps are explained, of a run whose engine can take them again and that was too "
        "long to be explained when it was recorded; those around `at_s` in any case.",
    ] = None
    choice: Chosen = None
    script: Source = None
    progress: Progress = quiet


@dataclass(frozen=True)
class RenderArguments(Printed):
    """Make a gif of the recorded frames, and a plot of heights and errors.

    With --camera, or if a script took no images, the gif shows the recorded poses; the plot of a
    script is about its findings.
    """

    recording: Read
    _: KW_ONLY
    out: Annotated[
        File | None,
        takes("FILE", "The .gif, .webp, .apng or .mp4 to write. [default: RUN.gif]", *OUT),
    ] = None
    fps: ClassVar[Fps] = None
    speed: ClassVar[Speed] = None
    caption: ClassVar[Caption] = False
    with_plot: ClassVar[WithPlot] = False
    dark: Dark = False
    plot: Annotated[File | None, takes("FILE", "The plot, .png or .svg. [default: RUN.png]")] = None
    view: Annotated[
        CameraView | None, takes("", "Draw the recorded poses with this camera.", "--camera")
    ] = None
    body: Body = None
    select: ClassVar[Select] = None
    ignore: ClassVar[Ignore] = None
    force: Force = False
    animation: Played = None
    choice: Chosen = None
    script: Source = None
    progress: Progress = quiet
    assistant: Drawer = None
    meanwhile: Annotated[
        Callable[[], None], "Called once other processes draw what there is to draw."
    ] = quiet


@dataclass(frozen=True)
class CheckArguments(Printed):
    """Compare a recording with a golden one; exit with 3 if the physics differs.

    Both must be of a drop, or both of a script.
    """

    recording: Annotated[File, argument("RUN.rrd", "The recording to read.")]
    against: Annotated[File, takes("GOLDEN.rrd", "The recording to compare with.")]
    _: KW_ONLY
    tolerance_m: Annotated[
        float,
        takes(
            "METRES",
            "Largest difference that passes; for a velocity, the distance per step. 0: bit "
            "for bit, but 1e-9 m for a drop in contact. [default: 0]",
            default=None,
        ),
    ] = 0.0
    update: Annotated[bool, flag("Make RUN.rrd the golden recording.")] = False
    summary: ClassVar[
        Annotated[
            Path | None,
            takes("FILE", "Append the verdict to this file, as Markdown for a CI summary."),
        ]
    ] = None
    html: ClassVar[Page] = None
    force: ClassVar[Force] = False


@dataclass(frozen=True)
class InfoArguments(Printed):
    """Describe a recording: what made it, its length, its bodies, and whether it is complete."""

    recording: Read


@dataclass(frozen=True)
class ExplainArguments(Printed):
    """Say what a finding's code means, what is measured, its threshold, an example and the cure."""

    code: Annotated[str | None, argument("CODE", "A finding's code, or its reason.")] = None
    _: KW_ONLY
    every: Annotated[bool, flag("List all codes, a line each.", "--list")] = False


@dataclass(frozen=True)
class ExportArguments(Printed):
    """Write states, joints and contact points of a recording for other tools.

    As tables, or as MCAP for Foxglove and PlotJuggler: joints as /joint_states, poses of centres of
    mass as transforms on /tf, contact points on /contacts.
    """

    recording: Read
    out: Annotated[
        File | None,
        takes(
            "FILE",
            "An .mcap file, or tables: NAME.csv (or .parquet) stands for NAME.states.csv, "
            "NAME.joints.csv and NAME.contacts.csv. [default: RUN.csv]",
            *OUT,
        ),
    ] = None
    _: KW_ONLY
    force: Force = False


@dataclass(frozen=True)
class ViewArguments(Printed):
    """Open recordings and their analyses in the Rerun viewer; ends when that is closed."""

    recordings: Annotated[
        Sequence[File],
        argument(
            "RUN.rrd",
            "The recordings to open, or scripts that they were made from. [default: the newest in "
            "recordings/]",
            default=None,
        ),
    ]
    _: KW_ONLY
    web: Annotated[bool, flag("Open them in a browser.")] = False
    against: Annotated[
        File | None,
        takes("GOLDEN.rrd", "Show this recording in grey beside it, at the first difference."),
    ] = None


# -- the falling box ------------------------------------------------------------------------------


@dataclass(frozen=True)
class SimulateArguments(Printed):
    """Drop the body and record everything that happens."""

    scenario: Dropped
    out: Annotated[File, takes("RUN.rrd", "The recording to write.", *OUT)]
    _: KW_ONLY
    spawn: ClassVar[Annotated[bool, flag("Show the fall live in a viewer.")]] = False
    connect: ClassVar[
        Annotated[str | None, takes("URL", "Show it live in a viewer that is already open.")]
    ] = None
    force: Force = False
    camera: Seen = STANDARD_CAMERA
    viewer: Annotated[
        Callable[[], str] | None,
        "Called before the fall, to return the URL of a viewer to show it live.",
    ] = None
    note: Note = quiet
    progress: Progress = quiet
    assistant: Drawer = None


@dataclass(frozen=True)
class RunArguments(Printed):
    """Simulate, analyze and render: the whole story of one drop."""

    scenario: Dropped
    out_dir: Annotated[
        File, takes("DIR", "Folder for the files; created if missing.", "--out-dir", "-o")
    ] = Path("recordings")
    _: KW_ONLY
    at_s: At = ()
    fps: ClassVar[Fps] = None
    speed: ClassVar[Speed] = None
    caption: ClassVar[Caption] = False
    with_plot: ClassVar[WithPlot] = False
    dark: Dark = False
    camera: Seen = STANDARD_CAMERA
    animation: Played = None
    note: Note = quiet
    progress: Progress = quiet


@dataclass(frozen=True)
class SweepArguments(Printed):
    """Run many scenarios, or a script with many interventions: a row for each run.

    Every scenario option takes a list A,B,C; vectors are separated by semicolons: "0,0,0;0,0,1".
    The sweep is the product of the lists, in the order of the options below, the last one changing
    fastest. With --try, it is a script that runs, once for each combination; of the options below
    it takes --duration.
    """

    plan: Annotated[
        "Plan | Mapping[str, Any]",
        "Which scenarios: lists of values by field of `Scenario`, as {'timestep_s': [1/240]}, or a "
        "plan, which `plan_of` makes of lists and of what is drawn.",
    ]
    out: Annotated[
        File,
        takes("DIR", "Folder for results and recordings; run the command again to resume.", *OUT),
    ]
    _: KW_ONLY
    at_s: Annotated[float, takes("SECONDS", "Time at which to break the error down [s].")] = 0.3
    samples: ClassVar[
        Annotated[int | None, takes("N", "Runs per scenario, drawn with --vary.")]
    ] = None
    seed: ClassVar[Annotated[int, takes("S", "Random seed.")]] = 0
    vary: ClassVar[
        Annotated[
            Sequence[str] | None,
            takes(
                "NAME=DISTRIBUTION",
                "Draw an option at random, such as height=uniform:0.5:2 or velocity_z=normal:0:1; "
                "repeatable. Also loguniform, truncnormal, lognormal, triangular, exponential, "
                "integers and choice.",
            ),
        ]
    ] = None
    jobs: Annotated[
        int | None,
        takes("N", "Worker processes; by default one per core where that pays off."),
    ] = None
    ray: Ray = None
    record: Annotated[bool, flag("Keep the numbers, but no recordings.", "--no-record")] = True
    force: Force = False
    camera: Seen = None
    progress: Progress = quiet


@dataclass(frozen=True)
class SweepScriptArguments:
    """Run a script as it is, and with each combination of interventions."""

    target: Annotated[
        str,
        argument(
            "SCRIPT.py …",
            "With --try: a script to run instead, and its arguments.",
            default=None,
        ),
    ]
    arguments: Arguments = ()
    _: KW_ONLY
    tries: Annotated[
        Sequence[str],
        takes(
            "NAME=V,…",
            "Values of an intervention in a script, such as friction=0.2,0.4 or timestep/2,4; "
            "repeatable: the sweep is the product.",
            "--try",
            default=None,
        ),
    ]
    out: Annotated[File, "The folder for the table and the recordings."]
    duration_s: Annotated[float | None, "Simulated time after which each run is stopped [s]."] = (
        None
    )
    seed: Annotated[int, "As of `record_script`, for all runs."] = 0
    jobs: Annotated[int | None, "Processes on this machine; None for one per core."] = None
    ray: Annotated[str | None, "A Ray cluster's address."] = None
    force: Annotated[bool, "Whether all is run again, and what is there is replaced."] = False
    again: Again = False
    stdout: Stdout = 1
    note: Note = quiet
    progress: Progress = quiet
