"""The recording opens in the real viewer, looks right, and is shown while it is written.

The first tests prove what a person sees; the next ones that this proof fails where it must.
"""

from __future__ import annotations

import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import rerun.blueprint as rrb
from command import HANGS_S
from conftest import Drop, Planted
from drop_physics import Scenario, colours, simulate
from drop_physics.explain.decomposition import TERMS
from drop_physics.recording import schema, writer
from drop_physics.recording import viewer as program
from drop_physics.recording.falling import image_chunk
from drop_physics.recording.layout import Eye, layout, look_of_drop
from drop_physics.recording.layout import Look as Described
from drop_physics.recording.reader import read
from drop_physics.stages import view
from drop_physics.stages.analyze import analyze
from drop_physics.stages.run import Run
from numpy.typing import NDArray
from rerun.chunk import Chunk, RrdReader
from rerun.experimental import ViewerClient
from scenes import record
from viewer import (
    PATIENCE_S,
    Look,
    Viewer,
    binary,
    complaints,
    free_port,
    isolated,
    vulkan_driver,
)

pytestmark = pytest.mark.long

ROOT = Path(__file__).parents[1]

ALONE = {
    "World": Look(moves=True),
    "Camera": Look(moves=True),
    "Height of the centre [m]": Look(
        moves=True, colours=(colours.SIMULATED, colours.FREE_FALL, colours.DAMPED_FALL)
    ),
    "About": Look(moves=False),
}
ANALYZED = ALONE | {
    "Simulated minus free fall [mm]": Look(
        moves=True,
        colours=(
            colours.TOTAL_IN_VIEWER,
            colours.TIMESTEP,
            colours.DAMPING,
            colours.INTERACTION,
            colours.ROUNDING,
        ),
    ),
    "Energy [J]": Look(moves=True, colours=(colours.KINETIC, colours.ROTATION, colours.POTENTIAL)),
    "Events": Look(moves=True),
    "Findings": Look(moves=False),
    "About": Look(behind=True),
}


@pytest.fixture
def vulkan() -> None:
    """Skip tests that need a Vulkan driver if there is none."""
    if vulkan_driver() is None:
        pytest.skip("no software Vulkan; try: apt-get install mesa-vulkan-drivers")


needs_vulkan = pytest.mark.usefixtures("vulkan")


# -- what a person sees ---------------------------------------------------------------------------


@needs_vulkan
def test_a_recording_alone_opens_as_an_instrument(standard: Run) -> None:
    with Viewer(standard.simulation.recording) as viewer:
        assert complaints(viewer, views=ALONE) == []


@needs_vulkan
def test_with_its_analysis_it_opens_as_one_recording(standard: Run) -> None:
    assert standard.analysis.layer is not None
    with Viewer(standard.simulation.recording, standard.analysis.layer) as viewer:
        assert complaints(viewer, views=ANALYZED) == []
        program.put_cursor(
            program.Viewer([], int(viewer.url.split(":")[2].split("/")[0]), None),
            view.DEFAULT_AT_S,
            viewer.process,
        )
        wait_until(lambda: _time_in(viewer) == 300_000_000)


def _time_in(viewer: Viewer) -> float | None:
    (recording,) = viewer.client.get_state().recordings
    return recording.current_time


ARM = """
p.setGravity(0, 0, -9.81)
p.loadURDF("plane.urdf")
arm = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)
for joint, angle in enumerate([0, 0.8, 0, -1.2, 0, 0.5, 0]):
    p.resetJointState(arm, joint, angle)
    p.setJointMotorControl2(arm, joint, p.POSITION_CONTROL, angle, force=30)
steps(240)
"""


@needs_vulkan
def test_a_robot_opens_with_its_joints_its_energy_and_its_contacts(tmp_path: Path) -> None:
    path = tmp_path / "arm.rrd"
    layer = analyze(record(ARM, path, for_viewer=True).path).layer
    assert layer is not None
    energy = "energy of 1_model since the start, by cause [J]"
    shown: dict[str, tuple[str, ...]] = {
        "World": (),
        "Joint positions, thin: targets and stops [rad]": (colours.JOINTS[0],),
        "Motors, thin: limits [N m]": (colours.JOINTS[0],),
        energy: (colours.CAUSES["motors"], colours.CAUSES["contacts"]),
        "What each body does": (),
        "Findings": (),
        "Events": (),
    }
    with Viewer(path, layer) as viewer:
        viewer.set_time(0.8)
        assert [name for name, wanted in shown.items() if not viewer.shows(name, *wanted)] == []
        views = viewer.client.get_state().views
        assert [view.reports for view in views if view.reports] == []
        assert viewer.warnings() == []
    entities = {chunk.entity_path for chunk in RrdReader(path).stream()}
    assert {"/world/contacts", "/world/1_model/trail"} <= entities


@needs_vulkan
def test_several_recordings_open_at_once(tmp_path: Path, standard: Run) -> None:
    other = tmp_path / "other.rrd"
    simulate(Scenario(linear_damping=0.0), other)
    with Viewer(standard.simulation.recording, other) as viewer:
        wait_until(lambda: len(viewer.client.get_state().recordings) == 2)
        assert viewer.warnings() == []


def test_the_curves_in_millimetres_are_the_numbers_in_metres(standard: Run) -> None:
    assert standard.analysis.layer is not None
    values: dict[str, NDArray[np.float64]] = {}
    for chunk in RrdReader(standard.analysis.layer).stream():
        if not chunk.is_static and chunk.entity_path.startswith("/error"):
            column = chunk.to_record_batch().column("Scalars:scalars")
            values[chunk.entity_path] = column.flatten().to_numpy()
    for term in ("total", *TERMS):
        numbers_m, curve_mm = values[f"/error/{term}"], values[f"/error_mm/{term}"]
        assert len(numbers_m) == 108
        assert np.array_equal(curve_mm, numbers_m * 1e3)


# -- the proof fails where it must ----------------------------------------------------------------


def altered(source: Path, path: Path, change: Callable[[Chunk], Chunk | None]) -> Path:
    """Write a recording with our layout, each chunk changed or left out."""
    chunks = (one for chunk in RrdReader(source).stream() if (one := change(chunk)) is not None)
    look = layout(look_of_drop(1.0, "standard", [f"{schema.HEIGHT}/curve"]))
    writer.record(path, chunks, recording_id="altered", blueprint=look)
    return path


def with_broken_images(chunk: Chunk) -> Chunk:
    if chunk.entity_path != f"/{schema.IMAGE}":
        return chunk
    batch = chunk.to_record_batch()
    png = batch.column("EncodedImage:blob")[0].values[0].values.to_numpy().tobytes()
    return image_chunk(batch.column("sim_step")[0].as_py(), 1 / 240, png[:200])


def with_one_timeline(chunk: Chunk) -> Chunk:
    if chunk.is_static:
        return chunk
    batch = chunk.to_record_batch()
    kept = batch.drop_columns([schema.STEP_TIMELINE])
    (one,) = Chunk.from_record_batch(kept)
    return one


@needs_vulkan
@pytest.mark.parametrize(
    ("change", "said"),
    [
        (with_broken_images, "Camera"),
        (with_one_timeline, "timelines ['call', 'sim_time']"),
    ],
)
def test_a_broken_recording_is_noticed(
    tmp_path: Path, standard: Run, change: Callable[[Chunk], Chunk | None], said: str
) -> None:
    path = altered(standard.simulation.recording, tmp_path / "broken.rrd", change)
    with Viewer(path) as viewer:
        assert said in "; ".join(complaints(viewer, views=ALONE, times_s=(0.0, 0.3), patience_s=0))


@needs_vulkan
def test_a_wrong_path_in_the_layout_is_noticed(
    tmp_path: Path, standard: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(schema, "HEIGHT", "hight")
    path = altered(standard.simulation.recording, tmp_path / "wrong.rrd", lambda chunk: chunk)
    with Viewer(path) as viewer:
        found = complaints(viewer, views=ALONE, times_s=[0.3], patience_s=0)
    name = "Height of the centre [m]"
    # The grey of free fall may be that of words that fade in on a slow machine.
    assert [one for one in found if not one.endswith(colours.FREE_FALL)] == [
        f"{name} looks at /hight, where nothing is",
        *(
            f"{name} shows nothing in {colour}"
            for colour in ALONE[name].colours
            if colour != colours.FREE_FALL
        ),
    ]


@needs_vulkan
def test_a_viewer_that_dies_is_noticed(standard: Run) -> None:
    with Viewer(standard.simulation.recording) as viewer:
        viewer.process.kill()
        viewer.process.wait()
        with pytest.raises(ConnectionError):
            complaints(viewer, views=ALONE)


# -- drop view ------------------------------------------------------------------------------------


@pytest.fixture
def here(tmp_path: Path, standard: Run) -> Path:
    """Return a folder with `run.rrd` and its analysis."""
    assert standard.analysis.layer is not None
    (tmp_path / "run.rrd").write_bytes(standard.simulation.recording.read_bytes())
    (tmp_path / "run.analysis.rrd").write_bytes(standard.analysis.layer.read_bytes())
    return tmp_path


def test_view_finds_the_layers_and_names_them_last(
    here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DISPLAY", ":0")
    bare = here / "bare.rrd"
    simulate(Scenario(), bare, camera=None)
    with view.view([here / "run.rrd", bare, here / "run.rrd"]) as shown:
        pass
    assert shown.recordings == [here / "run.rrd", bare]
    assert shown.layers == [here / "run.analysis.rrd"]
    assert shown.viewer.command[:6] == [
        str(binary()),
        *map(str, [here / "run.rrd", bare, here / "run.analysis.rrd"]),
        "--bind",
        "127.0.0.1",
    ]


def test_a_layer_of_an_earlier_recording_is_not_shown(
    here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DISPLAY", ":0")
    simulate(Scenario(), here / "run.rrd", camera=None, force=True)
    with view.view([here / "run.rrd"]) as shown:
        pass
    assert (shown.layers, shown.stale) == ([], [here / "run.analysis.rrd"])


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux says where its screen is")
def test_without_a_screen_it_says_what_to_do(
    drop: Drop, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"):
        monkeypatch.delenv(name, raising=False)
    for arguments in (["view", "run.rrd"], ["simulate", "--spawn", "--out", "new.rrd"]):
        done = drop(*arguments)
        assert (done.returncode, done.stdout) == (1, "")
        assert len(done.stderr.splitlines()) == 1
        assert "--web" in done.stderr
    assert not list(here.glob("new.rrd*"))


def test_on_a_screen_that_is_not_there_the_viewers_failure_is_ours(
    drop: Drop, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert here.exists()
    monkeypatch.setenv("DISPLAY", ":59999")
    done = drop("view", "run.rrd", "--json")
    assert done.returncode == 1
    assert "the viewer ended with exit code 1; try the browser's" in done.stderr.splitlines()[-1]


def test_web_is_served_on_loopback_only_and_nobody_is_counted(here: Path) -> None:
    home = here / "home"
    environment = os.environ | {
        "HOME": str(home),
        "XDG_CONFIG_HOME": str(home / ".config"),
        "XDG_DATA_HOME": str(home / ".local"),
        "BROWSER": "true",
        "PYTHONPATH": str(Path(__file__).parents[1]),
    }
    environment.pop("CI", None)
    process = subprocess.Popen(
        [sys.executable, "-m", "drop_physics", "view", "run.rrd", "--web", "--json"],
        cwd=here,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stdout is not None
        answer = json.loads("".join(iter(process.stdout.readline, "}\n")) + "}")
        assert answer["layers"] == ["run.analysis.rrd"]
        ports = [int(answer[key].split(":")[2].split("?")[0].split("/")[0]) for key in KEYS]
        wait_until(lambda: all(map(listens, ports)))
        with urllib.request.urlopen(answer["page"], timeout=HANGS_S) as page:
            assert b"<html" in page.read()
        assert all(address == "127.0.0.1" for port in ports for address in listening_on(port))
    finally:
        process.send_signal(signal.SIGTERM)
        process.communicate(timeout=HANGS_S)
    assert process.returncode == 128 + signal.SIGTERM
    assert not any(map(listens, ports))
    assert not list(home.rglob("analytics*"))


def test_the_names_of_a_scripts_curves_stand_where_no_flight_is() -> None:
    """The legend is where the curves of a fall are not: they start at the upper left."""
    entities = {schema.FINDINGS, f"{schema.ERROR_MM}/1_box", f"{schema.HEIGHT}/1_box"}
    eye = Eye((1.0, 1.0, 1.0), (0.0, 0.0, 0.0))
    shown = _views(layout(Described(eye, frozenset(entities))).root_container)
    corners = {
        one.name.split(" [")[0]: one.properties["PlotLegend"].corner
        for one in shown
        if one.name and one.properties.get("PlotLegend")
    }
    wanted = {
        "Simulated minus free fall": rrb.Corner2D.LeftBottom,
        "Heights of free bodies": rrb.Corner2D.RightTop,
    }
    found = {name: corner.as_arrow_array().to_pylist() for name, corner in corners.items()}
    assert found == {name: [corner.value] for name, corner in wanted.items()}


def _views(container: rrb.Container | rrb.View) -> Iterator[rrb.View]:
    if isinstance(container, rrb.View):
        yield container
        return
    for one in container.contents:
        yield from _views(one)


@needs_vulkan
def test_no_address_that_a_page_may_open_has_a_time_yet(standard: Run) -> None:
    """Once one has, `drop view --web` can start where the window does: see `docs/viewing.md`."""
    files = (standard.simulation.recording, standard.analysis.layer)
    served = program.viewer(files, web=True)
    process = subprocess.Popen(
        served.command,
        env=os.environ | {"CI": "true", "BROWSER": "true", "RUST_LOG": "error"},
    )
    try:
        wait_until(lambda: listens(served.port))
        with pytest.raises((ConnectionError, RuntimeError)):  # nor does it take orders
            ViewerClient.connect(served.url).set_time("sim_time", duration=0.3)
        with Viewer() as viewer:
            viewer.client.open(f"{served.url}#when=sim_time@0.3s")
            wait_until(
                lambda: any(
                    one.current_time is not None for one in viewer.client.get_state().recordings
                )
            )
            viewer.settled()
            (shown,) = viewer.client.get_state().recordings
            # Played for a moment perhaps, before the layout that pauses it is there.
            assert shown.current_timeline == "sim_time"
            assert shown.current_time != 300_000_000
            with pytest.raises((ConnectionError, RuntimeError), match="not loaded"):
                viewer.client.open(f"{shown.location}#when=sim_time@0.3s")
    finally:
        process.terminate()
        process.wait()


@pytest.mark.parametrize(("number", "code"), [(signal.SIGKILL, -9), (signal.SIGINT, 130)])
def test_the_web_viewer_ends_with_a_command_that_is_ended(
    here: Path, number: int, code: int
) -> None:
    """Ctrl-C reaches the viewer too; another program's signal reaches only us."""
    process = subprocess.Popen(
        [sys.executable, "-m", "drop_physics", "view", "run.rrd", "--web", "--json"],
        cwd=here,
        env=isolated(here / "home") | {"BROWSER": "true", "PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    answer = json.loads("".join(iter(process.stdout.readline, "}\n")) + "}")
    ports = [int(answer[key].split(":")[2].split("?")[0].split("/")[0]) for key in KEYS]
    wait_until(lambda: all(map(listens, ports)))
    time.sleep(1)  # it waits for the viewer by now
    process.send_signal(number)
    process.communicate(timeout=HANGS_S)
    assert process.returncode == code
    wait_until(lambda: not any(map(listens, ports)))


def test_every_host_that_the_web_viewers_page_asks_is_in_the_documents(tmp_path: Path) -> None:
    """No option disables these requests, so the page lists them."""
    found = program.viewer(web=True)
    environment = isolated(tmp_path / "home") | {"BROWSER": "true"}
    process = subprocess.Popen(found.command, env=environment, stderr=subprocess.DEVNULL)
    try:
        assert found.page is not None
        wait_until(lambda: listens(int(str(found.page).split(":")[2].split("?")[0])))
        with urllib.request.urlopen(found.page, timeout=HANGS_S) as page:
            text = page.read().decode()
        assert "hide_welcome_screen: query.has" in text
    finally:
        process.terminate()
        process.wait()
    loaded = re.findall(r"<link[^>]*href=\"https://([^/\"]+)", text)
    assert "fonts.googleapis.com" in loaded
    told = (ROOT / "docs/viewing.md").read_text(encoding="utf-8")
    assert [host for host in loaded if f"`{host}`" not in told] == []


def test_a_name_is_no_option_and_no_address_for_the_viewer() -> None:
    files = [Path("-x.rrd"), Path("rerun+http:/here"), Path("/tmp/run.rrd")]
    assert program.viewer(files, web=True).command[1:4] == [
        "./-x.rrd",
        "./rerun+http:/here",
        "/tmp/run.rrd",
    ]


KEYS = ("url", "page")


def listens(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


def listening_on(port: int) -> set[str]:
    """Return this machine's addresses on which a port is open."""
    rows = [
        row.split()
        for name in ("tcp", "tcp6")
        for row in Path(f"/proc/net/{name}").read_text().splitlines()[1:]
    ]
    found = {
        row[1].split(":")[0]
        for row in rows
        if row[3] == "0A" and int(row[1].split(":")[1], 16) == port
    }
    return {"127.0.0.1" if address == "0100007F" else address for address in found}


def wait_until(ready: Callable[[], object]) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not ready():
        assert time.monotonic() < deadline
        time.sleep(0.05)


# -- live -----------------------------------------------------------------------------------------


@dataclass
class Receiver:
    """Rerun's own server, which receives a recording as a viewer does."""

    process: subprocess.Popen[bytes]
    url: str
    saved: Path


@pytest.fixture
def receiver(tmp_path: Path) -> Iterator[Receiver]:
    """Return a receiver that writes the data sent to it to a file."""
    port, saved = free_port(), tmp_path / "received.rrd"
    process = subprocess.Popen(
        [binary(), "--save", saved, "--bind", "127.0.0.1", "--port", str(port)],
        env=isolated(tmp_path / "home"),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        wait_until(lambda: listens(port))
        yield Receiver(process, f"rerun+http://127.0.0.1:{port}/proxy", saved)
    finally:
        process.kill()
        process.wait()


def test_nothing_in_the_working_directory_is_imported_to_show_it_live(
    planted: Planted, receiver: Receiver
) -> None:
    done = planted("simulate", "--out", "a.rrd", "--no-camera", "--connect", receiver.url)
    assert (done.returncode, done.stderr) == (0, "")


@needs_vulkan
def test_a_viewer_shows_what_is_being_recorded(drop: Drop, tmp_path: Path, standard: Run) -> None:
    with Viewer() as viewer:
        done = drop("simulate", "--out", "live.rrd", "--connect", viewer.url)
        assert (done.returncode, done.stderr) == (0, "")
        wait_until(lambda: viewer.client.get_state().views)
        assert complaints(viewer, views=ALONE, times_s=(0.0, 0.8)) == []
    assert read(tmp_path / "live.rrd").states.equals(read(standard.simulation.recording).states)


@needs_vulkan
def test_spawn_opens_a_viewer_that_stays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    started: list[tuple[program.Viewer, subprocess.Popen[bytes]]] = []
    start = program.start

    def start_without_screen(found: program.Viewer, *, stays: bool) -> subprocess.Popen[bytes]:
        found = replace(found, command=[*found.command, "--headless", "--renderer", "vulkan"])
        started.append((found, start(found, stays=stays)))
        return started[0][1]

    monkeypatch.setattr(program, "start", start_without_screen)
    for name, value in (isolated(tmp_path / "home") | {"DISPLAY": ":0"}).items():
        monkeypatch.setenv(name, value)
    simulate(Scenario(), tmp_path / "run.rrd", camera=None, viewer=view.spawn)
    ((found, process),) = started
    try:
        client = ViewerClient.connect(found.url)
        wait_until(lambda: client.get_state().active_recording)
        assert process.poll() is None
    finally:
        process.terminate()
        process.wait()


def test_what_is_sent_is_what_is_written(tmp_path: Path, receiver: Receiver) -> None:
    notes: list[str] = []
    path = tmp_path / "run.rrd"
    simulate(Scenario(), path, camera=None, viewer=view.connection(receiver.url), note=notes.append)
    assert notes == []
    receiver.process.terminate()
    receiver.process.wait()
    # Ended like this it writes no footer, as a recording that was never finished.
    received = read(receiver.saved.rename(tmp_path / "received.rrd.part"))
    assert received.states.equals(read(path).states)
    assert received.recording_id == read(path).recording_id


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_a_viewer_that_goes_away_or_hangs_costs_the_recording_nothing(
    tmp_path: Path, receiver: Receiver, number: signal.Signals
) -> None:
    notes: list[str] = []

    def lose(_: str, done: int, total: int) -> None:
        if done > total / 3 and number not in sent:
            receiver.process.send_signal(number)
            sent.append(number)

    sent: list[int] = []
    path, long = tmp_path / "run.rrd", Scenario(duration_s=4.0)
    simulate(
        long,
        path,
        camera=None,
        viewer=view.connection(receiver.url),
        note=notes.append,
        progress=lose,
    )
    assert len(notes) == 1
    # Which of both depends on where in the fall it happens.
    assert re.search("viewer (does not respond|stopped responding)", notes[0])
    assert len(read(path).states) == long.steps + 1


def test_a_hanging_viewer_does_not_keep_the_command_from_ending(
    drop_process: Drop, tmp_path: Path, receiver: Receiver
) -> None:
    receiver.process.send_signal(signal.SIGSTOP)
    began = time.monotonic()
    done = drop_process(
        "simulate", "--out", "run.rrd", "--no-camera", "--connect", receiver.url, "--json"
    )
    assert done.returncode == 0
    assert len(done.stderr.splitlines()) == 1
    assert "the viewer does not respond" in done.stderr
    assert json.loads(done.stdout)["samples"] == 241
    assert time.monotonic() - began < 60, "it waits for the viewer for ever"
    assert not read(tmp_path / "run.rrd").partial


@pytest.mark.parametrize(
    ("url", "code", "said"),
    [
        ("9876", 2, "rerun+http://127.0.0.1:9876/proxy"),
        ("http://127.0.0.1:9876/proxy", 2, "'http://"),
        ("rerun+http://127.0.0.1:99999/proxy", 2, "99999"),
        ("rerun+http://127.0.0.1:1/proxy", 1, "--spawn"),
    ],
)
def test_without_a_viewer_nothing_is_begun(
    drop: Drop, tmp_path: Path, url: str, code: int, said: str
) -> None:
    done = drop("simulate", "--out", "run.rrd", "--connect", url)
    assert (done.returncode, done.stdout) == (code, "")
    assert len(done.stderr.splitlines()) == 1
    assert said in done.stderr
    assert list(tmp_path.iterdir()) == []
