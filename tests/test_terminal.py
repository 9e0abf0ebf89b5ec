"""What people see: a terminal of 80 columns, colours and bars; what a pipe gets instead of them."""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import pty
import re
import shlex
import struct
import subprocess
import sys
import termios
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import pytest
import typer
from conftest import Drop

from cli import app
from pipeline.console import output
from pipeline.console.progress import rate
from pipeline.stages.run import Run

ROOT = Path(__file__).parents[1]
COMMAND: Any = typer.main.get_command(app)
EXAMPLES = {name: one.epilog.removeprefix("Example: ") for name, one in COMMAND.commands.items()}
STYLE = re.compile(r"\x1b\[[\d;]*m")
MOVE = re.compile(r"\x1b\[[\d;?]*[A-Za-ln-z]")


class Seen(NamedTuple):
    """What a terminal was sent."""

    raw: str
    code: int

    @property
    def lines(self) -> list[str]:
        """Everything that ever stood in a line, without colours."""
        plain = MOVE.sub("\r", STYLE.sub("", self.raw))
        return [one for one in re.split(r"[\r\n]+", plain) if one.strip()]


Terminal = Callable[..., Seen]


@pytest.fixture
def terminal(tmp_path: Path) -> Terminal:
    """Return the command line as a process in a terminal of 80 columns."""

    def call(*arguments: object, **environment: str) -> Seen:
        ours, theirs = pty.openpty()
        fcntl.ioctl(ours, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
        inherited = {name: text for name, text in os.environ.items()
                     if name not in ("COLUMNS", "NO_COLOR", "FORCE_COLOR")}  # fmt: skip
        process = subprocess.Popen(
            [sys.executable, "-m", "cli", *map(str, arguments)],
            stdin=theirs, stdout=theirs, stderr=theirs, cwd=tmp_path,
            env=inherited | {"PYTHONPATH": str(ROOT), "TERM": "xterm-256color"} | environment,
        )  # fmt: skip
        os.close(theirs)
        received = b""
        with contextlib.suppress(OSError):  # how Linux says that nobody writes there any more
            while more := os.read(ours, 65536):
                received += more
        os.close(ours)
        return Seen(received.decode(), process.wait(timeout=60))

    return call


# -- width and colours ----------------------------------------------------------------------------


STUDY = "--timestep 1/240,1/480,1/960,1/7 --linear-damping default,0 --gravity earth,moon"
CHANCE = "--samples 5 --vary velocity_z=normal:0:0.1 --no-record"


@pytest.mark.parametrize(
    "command",
    [
        "", "--help", *(f"{name} --help" for name in EXAMPLES),
        "run", "simulate --out new.rrd --no-camera --gravity 9.81",
        "analyze run.rrd --at 0.1 --at 0.9", "render run.rrd", "check run.rrd --against run.rrd",
        "check bounce.rrd --against run.rrd",
        f"sweep --out s --spin 0,0,0;1,2,3 --body cube_small.urdf,sphere_small.urdf {STUDY}",
        f"sweep --out s --duration 1,0.3001 {CHANCE}",
        "foo", "simulate", "simulate --out new.rrd --timestep 1/0", "render no.rrd",
        "sweep --out s --samples 3 --vary zzz=uniform:1:2", "check run.rrd --against no.rrd",
    ],
)  # fmt: skip
def test_no_line_is_wider_than_a_terminal_of_80_columns(
    terminal: Terminal, drop: Drop, tmp_path: Path, standard: Run, command: str
) -> None:
    (tmp_path / "run.rrd").write_bytes(standard.simulation.recording.read_bytes())
    if "bounce" in command:
        drop("simulate", "--out", "bounce.rrd", "--restitution", "0.9", "--size", "32x24")
    seen = terminal(*command.split())
    assert "Traceback" not in seen.raw
    assert "DROP_DEBUG" not in seen.raw
    assert [line for line in seen.lines if len(line) > 80] == []


def test_colours_are_for_terminals_that_want_them(
    terminal: Terminal, drop: Drop, tmp_path: Path, standard: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "run.rrd").write_bytes(standard.simulation.recording.read_bytes())
    for command in (["analyze", "run.rrd"], ["render", "run.rrd"], ["render", "--help"]):
        assert STYLE.search(terminal(*command).raw), command
        assert not STYLE.search(terminal(*command, NO_COLOR="1").raw), command
        assert "\x1b" not in drop(*command).stdout, command
    monkeypatch.setenv("FORCE_COLOR", "1")
    forced = drop("analyze", "run.rrd")
    assert STYLE.search(forced.stdout)
    assert forced.stderr == ""
    monkeypatch.setenv("NO_COLOR", "1")
    assert "\x1b" not in drop("analyze", "run.rrd").stdout


@pytest.mark.parametrize(
    ("options", "titles"),
    [
        ("--timestep 1/240,1/480 --no-record", ("4 runs", "linear damping default")),
        (CHANCE, ("10 runs", "linear damping 0")),
    ],
)
def test_titles_are_bold(terminal: Terminal, options: str, titles: tuple[str, str]) -> None:
    raw = terminal(*f"sweep --out s --linear-damping default,0 {options}".split()).raw
    assert all(f"\x1b[1m{title}\x1b[0m" in raw for title in titles)


# -- what others wrote ----------------------------------------------------------------------------

HOSTILE = "\x1b]0;owned\x07 \x1b[2J \x9b31m \u202egnp \x7f\x00 [red]:bomb:"
SHOWN = r"\u001b]0;owned\u0007 \u001b[2J \u009b31m \u202egnp \u007f\u0000 [red]:bomb:"


def test_what_a_terminal_would_obey_is_shown_and_not_sent(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    output.print_lines(*output.titled("title", HOSTILE, column=8))
    output.print_lines(*output.made("file", Path(HOSTILE), column=8))
    assert [one.count(SHOWN) for one in STYLE.sub("", capsys.readouterr().out).splitlines()] == [
        1, 1,
    ]  # fmt: skip
    output.note(HOSTILE)
    assert capsys.readouterr().err == f"drop: {SHOWN}\n"
    output.print_json({"name": f"Δ\xa0{HOSTILE}\n\ud800\U000e0001"})
    said = capsys.readouterr().out
    assert json.loads(said) == {"name": f"Δ\xa0{HOSTILE}\n\ud800\U000e0001"}
    assert "Δ\xa0" in said
    assert all(one.isprintable() for one in said.replace("\n", "").replace("\xa0", ""))


def test_names_with_control_characters_are_harmless_in_errors(
    drop: Drop, tmp_path: Path, standard: Run
) -> None:
    name = "a\x1b[31m\u202eb.rrd"
    assert drop("analyze", name).stderr.startswith(r"drop: a\u001b[31m\u202eb.rrd")
    (tmp_path / name).write_bytes(standard.simulation.recording.read_bytes())
    told = drop("render", name)
    assert told.returncode == 0
    assert "\x1b" not in told.stdout
    assert "\u202e" not in told.stdout


# -- progress -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("command", "what"),
    [
        ("simulate --out a.rrd --duration 400 --no-camera", "stepping"),
        ("simulate --out a.rrd", "drawing frames"),
        ("render run.rrd", "writing gif"),
        ("analyze run.rrd", "analyzing"),
        (f"sweep --out s {CHANCE}", "runs, 0 failed"),
        ("sweep --out s --duration 1,0.3001,2 --no-record", "runs, 1 failed"),
    ],
)
def test_what_takes_long_has_a_bar_with_count_rate_and_time_left(
    terminal: Terminal, tmp_path: Path, standard: Run, command: str, what: str
) -> None:
    (tmp_path / "run.rrd").write_bytes(standard.simulation.recording.read_bytes())
    seen = terminal(*command.split())
    assert seen.code == 0
    shown = [line for line in seen.lines if line.startswith(what)]
    assert any(
        re.search(r"━ +[\d,]+/[\d,]+ +[\d,.]+/(s|min) +\d:\d\d:\d\d left", line) for line in shown
    ), seen.lines


def test_a_pipe_gets_no_bar(drop: Drop) -> None:
    assert drop("simulate", "--out", "a.rrd").stderr == ""


@pytest.mark.parametrize(
    ("per_second", "said"),
    [(None, ""), (85_123.4, "85,123/s"), (1.0, "1/s"), (0.5, "30.0/min"), (0.01, "0.6/min")],
)
def test_a_rate_is_a_number_above_one_where_it_can(per_second: float | None, said: str) -> None:
    assert rate(per_second) == said


# -- where to start -------------------------------------------------------------------------------


def test_drop_alone_says_what_to_type_first_and_then_lists_the_commands(drop: Drop) -> None:
    alone = drop()
    assert (alone.returncode, alone.stderr) == (0, "")
    assert alone.stdout == drop("--help").stdout
    assert alone.stdout.index("Start with: drop run") < alone.stdout.index("Commands:")
    for name in EXAMPLES:
        assert f"\n  {name} " in alone.stdout


@pytest.mark.parametrize("name", EXAMPLES)
def test_the_example_of_every_command_is_one_that_it_takes(drop: Drop, name: str) -> None:
    assert f"\nExample: {EXAMPLES[name]}\n" in drop(name, "--help").stdout
    program, command, *arguments = shlex.split(EXAMPLES[name])
    assert (program, command) == ("drop", name)
    with COMMAND.make_context("drop", [command, *arguments]) as context:
        COMMAND.commands[name].make_context(name, list(arguments), parent=context)


def test_the_examples_work_one_after_the_other(drop: Drop, tmp_path: Path, standard: Run) -> None:
    """All of them but `view`, which waits for a viewer; the frames of `run` are drawn once."""
    golden = tmp_path / "recordings/golden"
    golden.mkdir(parents=True)
    recording = standard.simulation.recording.read_bytes()
    for path in (golden / "standard.rrd", tmp_path / "recordings/run.rrd", tmp_path / "run.rrd"):
        path.write_bytes(recording)
    for name in ("simulate", "analyze", "render", "check", "sweep"):
        done = drop(*shlex.split(EXAMPLES[name])[1:])
        assert (done.returncode, done.stderr) == (0, ""), name
    assert {"moon.rrd", "run.csv", "fall.webp", "sweep"} <= {one.name for one in tmp_path.iterdir()}


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["foo"], "no such command 'foo'; the commands are simulate, analyze,"),
        (["simulat"], "no such command 'simulat', did you mean 'simulate'? The commands are"),
        (["simulate", "--out", "a.rrd", "--higth", "2"], "--height"),
        (["sweep", "--out", "s", "--samples", "2", "--vary", "hight=uniform:1:2"], "mean height?"),
        (["sweep", "--out", "s", "--samples", "2", "--vary", "zzz=uniform:1:2"], "velocity_z"),
        (["render", "run.rrd", "--fps", "fast"], "--fps takes a number, got 'fast'"),
        (["sweep", "--out", "s", "--jobs", "1.5"], "--jobs takes a whole number, got '1.5'"),
        (["--show-completion", "tcsh"], "takes bash, zsh, fish, got 'tcsh'"),
    ],
)
def test_a_slip_is_answered_with_what_was_meant(
    drop: Drop, arguments: list[str], said: str
) -> None:
    done = drop(*arguments)
    assert (done.returncode, done.stdout, len(done.stderr.splitlines())) == (2, "", 1)
    assert said in done.stderr


def test_gravity_that_points_up_is_noted_and_recorded(drop: Drop) -> None:
    done = drop("simulate", "--out", "up.rrd", "--no-camera", "--gravity", "9.81")
    assert done.returncode == 0
    assert done.stderr == (
        "drop: gravity points upwards: +9.81 m/s²; the body will rise; try --gravity -9.81 to let "
        "it fall\n"
    )
    switched_off = drop(
        "simulate", "--out", "off.rrd", "--no-camera", "--gravity", "9.81", "--no-gravity"
    )
    assert switched_off.stderr == ""


# -- completion -----------------------------------------------------------------------------------


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_shells_script_is_shown(drop: Drop, shell: str) -> None:
    done = drop("--show-completion", shell)
    assert (done.returncode, done.stderr) == (0, "")
    assert f"complete_{shell}" in done.stdout


WORDS = [
    ("drop si", ["simulate"]),
    ("drop render --f", ["--fps", "--force"]),
    ("drop run --coordinates ", ["reduced", "maximal"]),
    ("drop render r", []),  # a file: left to the shell
]


def completed(shell: str, line: str, action: str = "get-args") -> tuple[list[str], int]:
    """Return what a shell is answered, and the exit code."""
    words = line.split(" ")
    done = subprocess.run(
        [sys.executable, "-c", "import sys, cli; sys.argv = ['drop']; cli.main()"],
        capture_output=True, text=True, cwd=ROOT, check=False,
        env={**os.environ, "_DROP_COMPLETE": f"complete_{shell}", "COMP_WORDS": line,
             "COMP_CWORD": str(len(words) - 1), "_TYPER_COMPLETE_ARGS": line,
             "_TYPER_COMPLETE_FISH_ACTION": action},
    )  # fmt: skip
    assert done.stderr == ""
    return done.stdout.splitlines(), done.returncode


@pytest.mark.parametrize(("line", "expected"), WORDS)
def test_words_are_completed(line: str, expected: list[str]) -> None:
    in_bash, code = completed("bash", line)
    assert (list(filter(None, in_bash)), code) == (expected, 0)
    in_fish, _ = completed("fish", line)
    assert [one.partition("\t")[0] for one in in_fish if one] == expected
    # Whether fish may offer files is told by the exit code.
    assert completed("fish", line, "is-args")[1] == (0 if expected else 1)
    zsh = "\n".join(completed("zsh", line)[0])
    assert all(f'"{word}"' in zsh for word in expected) if expected else zsh == "_files"
