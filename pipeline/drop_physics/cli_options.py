"""What the verbs take on the command line, but for scenario and camera, which are in `options`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from drop_physics.options import a_number, an_integer
from drop_physics.scenario import View


def takes(metavar: str, text: str, *names: str, **how: Any) -> Any:  # noqa: ANN401
    """Return an option that takes a value."""
    return typer.Option(*names, metavar=metavar, help=text, **how)


def flag(text: str, *names: str) -> Any:  # noqa: ANN401
    """Return an option without one."""
    return typer.Option(*names, help=text)


Run = Annotated[Path, typer.Argument(metavar="RUN.rrd", help="The recording to read.")]
RunOrNewest = Annotated[
    Path | None,
    typer.Argument(
        metavar="RUN.rrd",
        help="The recording to read, or the script that it was made from. [default: the newest "
        "in recordings/]",
    ),
]
OutputFormat = Annotated[
    Literal["text", "json", "github", "sarif"],
    takes(
        "FORMAT",
        "How to print it: text, json, github (annotations of GitHub Actions) or sarif (code "
        "scanning).",
    ),
]
Page = Annotated[
    Path | None,
    takes("FILE", "Also write the report as one self-contained .html page."),
]
Json = Annotated[bool, flag("Print one JSON object, for scripts.", "--json")]
Force = Annotated[bool, flag("Replace files that exist.", "--force")]
Verbose = Annotated[
    bool, flag("Show all: flights, contacts, every joint and finding.", "--verbose", "-v")
]
OfBody = Annotated[
    str | None, takes("NAME|ID", "For a script's recording: this body only.", "--body")
]
At = Annotated[
    list[str] | None,
    takes("SECONDS", "Time at which to break the error down [s]; repeatable. [default: 0.3]"),
]
Windows = Annotated[
    list[str] | None,
    takes("A:B", "Steps of a long run of MuJoCo to explain, from A to before B; repeatable."),
]
ExplainsWith = Annotated[
    str | None,
    takes("PATH", "An interpreter with the MuJoCo of the recording. [default: the script's]"),
]
Select = Annotated[str | None, takes("CODE,…", "Report only these findings; all: leave none out.")]
Ignore = Annotated[str | None, takes("CODE,…", "Leave these findings out.")]
FailOn = Annotated[
    str | None,
    takes(
        "LEVEL",
        "Exit with 3 if a finding has this level or a worse one: broken, asked, model, repeat, "
        "note; or never.",
    ),
]
Fps = Annotated[
    float | None,
    takes("NUMBER", "Pictures per second of the gif, at most 50. [default: 20]", parser=a_number),
]
Speed = Annotated[
    float | None,
    takes(
        "NUMBER", "Simulated seconds per second: 1 is real time, 0.25 slow motion.", parser=a_number
    ),
]
Caption = Annotated[bool, flag("Write time, height and error below each frame.", "--caption")]
Dark = Annotated[bool, flag("Draw plots for a dark page.", "--dark")]
Ray = Annotated[str | None, takes("ADDRESS", "Run on a Ray cluster: auto, local or its address.")]
Python = Annotated[str | None, takes("PATH", "The interpreter to run it with; 3.9 or later.")]
Steps = Annotated[int | None, takes("N", "Stop it after N steps.", parser=an_integer)]
Duration = Annotated[
    float | None, takes("SECONDS", "Stop it after this simulated time [s].", parser=a_number)
]
WithPlot = Annotated[
    bool,
    flag("Beside the frames, plot heights and error, or a script's findings.", "--with-plot"),
]
Program = Annotated[
    list[str],
    typer.Argument(metavar="SCRIPT.py …", help="The script to run, and its arguments."),
]
Swept = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="SCRIPT.py …", help="With --try: a script to run instead, and its arguments."
    ),
]
SweepTries = Annotated[
    list[str] | None,
    takes(
        "NAME=V,…",
        "Values of an intervention in a script, such as friction=0.2,0.4 or timestep/2,4; "
        "repeatable: the sweep is the product.",
        "--try",
    ),
]
Module = Annotated[bool, flag("Run a module by its name, as python -m does.", "-m")]
Connect = Annotated[str | None, takes("URL", "Show it live in a viewer that is already open.")]
Layer = Annotated[
    Path | None,
    takes("LAYER.rrd", "The layer to write. [default: RUN.analysis.rrd]", "--out", "-o"),
]
Table = Annotated[Path | None, takes("FILE", "Write every sample to a .parquet or .csv file.")]
Exported = Annotated[
    Path | None,
    takes(
        "FILE",
        "An .mcap file, or tables: NAME.csv (or .parquet) stands for NAME.states.csv, "
        "NAME.joints.csv and NAME.contacts.csv. [default: RUN.csv]",
        "--out",
        "-o",
    ),
]
Film = Annotated[
    Path | None,
    takes("FILE", "The .gif, .webp, .apng or .mp4 to write. [default: RUN.gif]", "--out", "-o"),
]
Plot = Annotated[Path | None, takes("FILE", "The plot, .png or .svg. [default: RUN.png]")]
Look = Annotated[
    View | None,
    typer.Option("--camera", help="Draw the recorded poses with this camera."),
]
Folder = Annotated[
    Path, takes("DIR", "Folder for the files; created if missing.", "--out-dir", "-o")
]
Tolerance = Annotated[
    float | None,
    takes(
        "METRES",
        "Largest difference that passes; for a velocity, the distance per step. 0: bit "
        "for bit, but 1e-9 m for a drop in contact. [default: 0]",
        parser=a_number,
    ),
]
Summary = Annotated[
    Path | None,
    takes("FILE", "Append the verdict to this file, as Markdown for a CI summary."),
]
SweepFolder = Annotated[
    Path,
    takes(
        "DIR",
        "Folder for results and recordings; run the command again to resume.",
        "--out",
        "-o",
    ),
]
Samples = Annotated[
    int | None, takes("N", "Runs per scenario, drawn with --vary.", parser=an_integer)
]
Draws = Annotated[
    list[str] | None,
    takes(
        "NAME=DISTRIBUTION",
        "Draw an option at random, such as height=uniform:0.5:2 or velocity_z=normal:0:1; "
        "repeatable. Also loguniform, truncnormal, lognormal, triangular, exponential, "
        "integers and choice.",
    ),
]
SweepJobs = Annotated[
    int | None,
    takes("N", "Worker processes; by default one per core where that pays off.", parser=an_integer),
]
Recording = Annotated[
    Path | None,
    takes(
        "RUN.rrd",
        "The recording to write. [default: recordings/SCRIPT.rrd, in place of the script's "
        "earlier one]",
        "--out",
        "-o",
    ),
]
Keep = Annotated[
    bool, flag("Keep earlier recordings of the script, and number this one.", "--keep")
]
Seed = Annotated[int | None, takes("N", "Seed random and numpy.random with N.", parser=an_integer)]
SetSeed = Annotated[int, takes("N", "Seed random and numpy.random with N.", parser=an_integer)]
Twice = Annotated[bool, flag("Run it again, and report the first step that differs.", "--twice")]
KeepSleeping = Annotated[
    bool, flag("Let its sleeps take real time; by default its clock is virtual.", "--keep-sleeping")
]
NoExplain = Annotated[
    bool,
    flag("Do not replay MuJoCo's steps: record them, unexplained.", "--no-explain"),
]
Variations = Annotated[
    list[str] | None,
    takes(
        "NAME=V,…",
        "Instead of the usual variations: values of an engine parameter or of gravity [m/s²], "
        "factors of friction or mass, timestep/8, iterations*2, nudge, seed; repeatable.",
    ),
]
TrustFolder = Annotated[
    Path | None,
    takes("DIR", "Folder for the recordings. [default: recordings/SCRIPT-trust]", "--out", "-o"),
]
About = Annotated[
    str | None,
    takes("CODE|BODY|JOINT", "Try only what findings about this code, body or joint propose."),
]
Tries = Annotated[
    list[str] | None,
    takes(
        "NAME[=V]",
        "Instead of what findings propose: force=70, default-motor-off, damping, friction=2, "
        "timestep/4, …; repeatable.",
        "--try",
    ),
]
Ablate = Annotated[
    bool,
    flag(
        "Leave out in turn each call that sets something, and each optional argument.", "--ablate"
    ),
]
Again = Annotated[
    bool,
    flag(
        "Run it again even if it opens sockets or devices, or writes where nothing keeps it from "
        "doing so.",
        "--again",
    ),
]
Budget = Annotated[
    float,
    takes("SECONDS", "Begin no trial so long after the script's own run [s].", parser=a_number),
]
Every = Annotated[
    bool, flag("Show every trial, and everything that the outcome hangs on.", "--all")
]
WhyFolder = Annotated[
    Path | None,
    takes("DIR", "Folder for the recording and its trials. [default: recordings]", "--out", "-o"),
]
WhyFilm = Annotated[
    Path | None,
    takes("FILE", "Film the script's own run and its best trial side by side: .gif, .mp4 …"),
]
Within = Annotated[
    str | None,
    takes(
        "LENGTH",
        "Exit with 3 if a variation ends farther away than this: 1mm, 0.5deg, or both, with a "
        "comma; metres where no unit is given.",
    ),
]
Jobs = Annotated[
    int | None, takes("N", "Worker processes; by default one per core.", parser=an_integer)
]
TrustTable = Annotated[
    Path | None, takes("FILE", "Also write all distances to a .csv or .parquet file.")
]
TrustPlot = Annotated[Path | None, takes("FILE", "Also plot them over time, as .png or .svg.")]
RunsOrNewest = Annotated[
    list[Path] | None,
    typer.Argument(
        metavar="RUN.rrd",
        help="The recordings to open, or scripts that they were made from. [default: the newest in "
        "recordings/]",
    ),
]
Beside = Annotated[
    Path | None,
    takes("GOLDEN.rrd", "Show this recording in grey beside it, at the first difference."),
]
