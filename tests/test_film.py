"""Animations of recorded scripts: their cameras' images, and their poses rendered afterwards."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scenes
from conftest import Drop, some
from drop_physics.engines.pybullet.checkerboard import checkerboard
from drop_physics.engines.pybullet.engine import p
from drop_physics.engines.pybullet.visible_world import view_matrix
from drop_physics.errors import OutputError, RecordingError, ScenarioError
from drop_physics.figures.playback import Animation
from drop_physics.figures.theme import DARK, LIGHT
from drop_physics.recording import rrd
from drop_physics.recording.reader import read
from drop_physics.recording.scene import parts_of
from drop_physics.scenario import STANDARD_CAMERA
from drop_physics.stages.analyze import analyze
from drop_physics.stages.film import AXES
from drop_physics.stages.film.of_drop import FallScene
from drop_physics.stages.render import film_beside, render
from drop_physics.stages.run import Run
from numpy.typing import NDArray
from PIL import Image, ImageColor

FALLS = """
import pybullet as p
import pybullet_data
p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
p.loadURDF("plane.urdf")
box = p.createCollisionShape(p.GEOM_BOX, halfExtents=[.1, .1, .1])
look = p.createVisualShape(p.GEOM_BOX, halfExtents=[.1, .1, .1], rgbaColor=[1, 0, 0, 1])
body = p.createMultiBody(1, box, look, [0, 0, 1])
for step in range(120):
    p.stepSimulation()
"""
PHOTOGRAPHS = (
    FALLS
    + """
    if step % 12 == 0:
        view = p.computeViewMatrix([1, 1, 1], [0, 0, .5], [0, 0, 1])
        lens = p.computeProjectionMatrixFOV(60, 4 / 3, .1, 10)
        p.getCameraImage(64, 48, view, lens, renderer=p.ER_TINY_RENDERER)
"""
)
BALL = FALLS.replace("GEOM_BOX", "GEOM_SPHERE").replace("halfExtents=[.1, .1, .1]", "radius=.5")
BALL = BALL.replace("[0, 0, 1])", "[0, 0, 1.5])")
NOTHING = "import pybullet as p\np.connect(p.DIRECT)\np.stepSimulation()\n"

Record = Callable[[str], Path]


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> Record:
    known: dict[str, Path] = {}

    def recorded(text: str) -> Path:
        if text not in known:
            folder = tmp_path_factory.mktemp("script")
            script = folder / "script.py"
            script.write_text(text)
            known[text] = scenes.record_file(script, folder / "run.rrd").path
        return known[text]

    return recorded


def pictures(path: Path) -> list[NDArray[np.uint8]]:
    with Image.open(path) as film:
        found = []
        for number in range(getattr(film, "n_frames", 1)):
            film.seek(number)
            found.append(np.asarray(film.convert("RGB")))
        return found


def redness(picture: NDArray[np.uint8]) -> NDArray[np.intp]:
    """Return rows and columns of an image's red pixels, which show the box."""
    red, green, blue = np.moveaxis(picture.astype(int), 2, 0)
    return np.argwhere((red > 100) & (green < red / 2) & (blue < red / 2))


@pytest.mark.long
def test_the_frames_that_a_script_took_are_its_animation(record: Record, tmp_path: Path) -> None:
    rendering = render(record(PHOTOGRAPHS), out=tmp_path / "own.gif")
    shown = pictures(tmp_path / "own.gif")
    assert rendering.frames == len(shown) == 10
    assert {one.shape for one in shown} == {(48, 64, 3)}
    assert rendering.speed == pytest.approx(20 * 12 / 240)
    # It falls: down the picture.
    assert redness(shown[0])[:, 0].mean() < redness(shown[-1])[:, 0].mean()


@pytest.mark.long
def test_recorded_poses_are_drawn_where_a_script_took_no_frames(
    record: Record, tmp_path: Path
) -> None:
    rendering = render(record(FALLS), out=tmp_path / "poses.gif")
    shown = pictures(tmp_path / "poses.gif")
    assert rendering.frames == len(shown) == 11
    heights = [redness(one)[:, 0].mean() for one in shown]
    assert heights[:9] == sorted(heights[:9])  # then it meets the floor
    assert heights[-1] > heights[0] + 50


@pytest.mark.long
def test_two_runs_are_seen_side_by_side_by_one_camera(record: Record, tmp_path: Path) -> None:
    """The left box falls by 0.4 m from 1 m, the right one from 2 m: both are in view, at scale."""
    low, high = record(FALLS), record(FALLS.replace("[0, 0, 1])", "[0, 0, 2])"))
    film = tmp_path / "both.gif"
    assert film_beside(low, high, film, titles=("low", "a title " * 20)) == 11
    first, *_, last = pictures(film)
    middle = first.shape[1] // 2
    rows = [
        [_red_rows(picture[:, side]).mean() for side in (np.s_[:middle], np.s_[middle:])]
        for picture in (first, last)
    ]
    (left, right), (left_last, right_last) = rows
    assert right < left < left_last  # the higher box is higher up in the picture
    assert right < right_last
    with pytest.raises(OutputError, match="exists"):
        film_beside(low, high, film, titles=("low", "high"))


def _red_rows(picture: NDArray[np.uint8]) -> NDArray[np.intp]:
    red, green, blue = np.moveaxis(picture.astype(int), 2, 0)
    return np.nonzero((red > 2 * green) & (red > 2 * blue))[0]


@pytest.mark.long
def test_a_body_is_drawn_as_it_looked_at_the_time(record: Record, tmp_path: Path) -> None:
    """The body is blue from 0.2 s on, then invisible, and red again from 0.4 s on."""
    looks = """
    if step in (48, 72, 96):
        rgba = {48: [0, 0, 1, 1], 72: [0, 0, 1, 0], 96: [1, 0, 0, 1]}[step]
        p.changeVisualShape(body, -1, rgbaColor=rgba)
"""
    out = tmp_path / "looks.gif"
    render(record(FALLS + looks), out=out, view="standard")
    shown = pictures(out)
    red = [bool(len(redness(picture))) for picture in shown]
    blue = [bool(len(redness(picture[..., ::-1]))) for picture in shown]
    assert red == [True] * 5 + [False] * 4 + [True] * 2
    assert blue == [False] * 5 + [True] * 2 + [False] * 4


SWINGING = """
p.setGravity(0, 0, -9.81)
p.loadURDF("kuka_iiwa/model.urdf", [0.3, 0, 0], [0, 0, 0.6, 0.8], useFixedBase=True)
for joint in range(7):
    p.resetJointState(0, joint, 0.3)
    p.setJointMotorControl2(0, joint, p.VELOCITY_CONTROL, force=0)
steps(120)
"""


def test_a_link_is_drawn_where_kinematics_has_it(tmp_path: Path) -> None:
    """Each link is recorded in its parent's frame, in float32."""
    recording = scenes.record(SWINGING, tmp_path / "arm.rrd")
    seen, steps = recording.seen, np.array([0, 60, 120])
    (piece,), (body,) = seen.pieces(), seen.bodies.values()
    motions = seen.motions(body, piece.joints[0].steps, None, piece.joints[0])[steps]
    parts = parts_of(recording.path, seen)
    drawn = np.stack([part.at(steps / 240) for part in parts], axis=1)
    assert drawn[..., :3] == pytest.approx(motions[..., :3], abs=1e-6)
    turned = np.abs((drawn[..., 3:] * motions[..., 3:7]).sum(axis=-1))
    assert turned == pytest.approx(1.0, abs=1e-6)
    assert np.ptp(drawn[:, -1, :3], axis=0).max() > 0.1


def test_a_mesh_in_another_colour_is_not_written_again(tmp_path: Path) -> None:
    recolour = "steps(2)\np.changeVisualShape(0, 3, rgbaColor=[1, 0, 0, 1])\nsteps(2)"
    recording = scenes.record(SWINGING.replace("steps(120)", recolour), tmp_path / "arm.rrd")
    columns = Counter(
        (chunk.entity.rpartition("/")[0].rpartition("_")[2], name)
        for chunk in rrd.chunks(recording.path)
        for name in chunk.batch.schema.names
        if name in ("Asset3D:blob", "Asset3D:albedo_factor")
    )
    again = [each for each, count in columns.items() if count > 1]
    assert again == [("4", "Asset3D:albedo_factor")]
    looks = [part.models[0] for part in parts_of(recording.path, recording.seen)]
    assert sum(model.shape.rgba == (1, 0, 0, 1) and model.mesh != b"" for model in looks) == 1


@pytest.mark.long
@pytest.mark.parametrize("how", some(["p.removeBody(body)", "p.resetSimulation()"], 1))
def test_a_body_is_drawn_while_it_is_there(record: Record, tmp_path: Path, how: str) -> None:
    """The body exists until 0.2 s, and again from 0.4 s on."""
    there = f"""
    if step == 47:
        {how}
    if step == 95:
        box = p.createCollisionShape(p.GEOM_BOX, halfExtents=[.1, .1, .1])
        look = p.createVisualShape(p.GEOM_BOX, halfExtents=[.1, .1, .1], rgbaColor=[1, 0, 0, 1])
        p.createMultiBody(1, box, look, [0, 0, 1])
"""
    out = tmp_path / "there.gif"
    render(record(FALLS + there), out=out, view="standard")
    red = [bool(len(redness(picture))) for picture in pictures(out)]
    assert red == [True] * 4 + [False] * 4 + [True] * 3


def test_what_only_calls_move_is_in_view_and_not_still(
    record: Record, tmp_path: Path, drop: Drop
) -> None:
    path = record(
        FALLS.replace("createMultiBody(1, ", "createMultiBody(0, ")
        + "    p.resetBasePositionAndOrientation(body, [3 + step / 60, 0, 1], [0, 0, 0, 1])\n"
    )
    render(path, out=tmp_path / "put.gif", view="standard")
    columns = [redness(picture)[:, 1].mean() for picture in pictures(tmp_path / "put.gif")]
    assert len(columns) == 11
    assert np.ptp(columns) > 100
    assert "1_box, 0 kg" in drop("info", path).stdout
    (moved,) = (body for body in analyze(path, out=tmp_path / "layer.rrd").bodies if body.id == 1)
    assert (moved.segments["set"], moved.segments["still"]) == (119, 2)


MESH = """
import pybullet as p
import pybullet_data
p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
look = p.createVisualShape(p.GEOM_MESH, fileName="cube.obj", rgbaColor=[1, 0, 0, 1])
for place in (0, 3):
    p.createMultiBody(1, -1, look, [place, 0, 0])
p.stepSimulation()
"""


def test_a_mesh_is_drawn_where_pybullet_finds_it(record: Record, tmp_path: Path) -> None:
    render(record(MESH), out=tmp_path / "mesh.gif", view="standard")
    assert len(redness(pictures(tmp_path / "mesh.gif")[0])) > 100


def test_a_mesh_given_as_numbers_is_said_to_be_missing(drop: Drop, tmp_path: Path) -> None:
    numbers = "vertices=[[-.3, -.3, 0], [.3, -.3, 0], [0, .3, 0]], indices=[0, 1, 2]"
    script = tmp_path / "mesh.py"
    script.write_text(MESH.replace('fileName="cube.obj"', numbers))
    done = drop("record", "mesh.py")
    assert "a shape of 0_mesh and 1_mesh is not drawn: drop draws boxes" in done.stderr
    done = drop("render", "recordings/mesh.rrd")
    assert (done.returncode, "no body with a shape that drop draws" in done.stderr) == (1, True)


@pytest.mark.parametrize("view", some(["close", "follow"], 1))
def test_a_camera_is_near_to_the_body_that_moves(record: Record, tmp_path: Path, view: str) -> None:
    render(record(FALLS), out=tmp_path / "near.gif", view=view)  # type: ignore[arg-type]
    shown = pictures(tmp_path / "near.gif")
    middle = np.array(shown[0].shape[:2]) / 2
    ends = redness(shown[-1])
    assert np.abs(ends.mean(axis=0) - middle).max() < 20
    starts = redness(shown[0])
    if view == "follow":
        assert np.abs(starts.mean(axis=0) - middle).max() < 20
    else:  # it comes into the picture from above
        assert not len(starts) or starts[:, 0].mean() < middle[0] - 50


@pytest.mark.long
def test_the_view_asked_for_is_drawn_even_where_there_are_frames(
    record: Record, tmp_path: Path
) -> None:
    render(record(PHOTOGRAPHS), out=tmp_path / "drawn.gif", view="standard")
    assert pictures(tmp_path / "drawn.gif")[0].shape == (360, 480, 3)


@pytest.mark.long
def test_the_standard_view_sees_the_whole_of_what_moves(record: Record, tmp_path: Path) -> None:
    """A ball of 1 m starts higher than its own width: neither ball nor fall is cropped."""
    render(record(BALL), out=tmp_path / "ball.gif")
    shown = pictures(tmp_path / "ball.gif")
    for picture in (shown[0], shown[-1]):
        red = redness(picture)
        height, width = picture.shape[:2]
        assert len(red) > 100
        assert red.min() > 0
        assert red[:, 0].max() < height - 1
        assert red[:, 1].max() < width - 1


def test_what_cannot_be_shown_is_said_in_a_line(record: Record, tmp_path: Path, drop: Drop) -> None:
    path = record(FALLS)
    with pytest.raises(ScenarioError, match="needs a theory, which only a drop has"):
        render(path, out=tmp_path / "a.gif", animation=Animation(caption=True))
    with pytest.raises(ScenarioError, match="'duck', which is none; it has: 0"):
        render(path, out=tmp_path / "a.gif", view="follow", body="duck")
    with pytest.raises(RecordingError, match="has nothing to show"):
        render(record(NOTHING), out=tmp_path / "a.gif")
    assert not list(tmp_path.iterdir())
    done = drop("render", str(path), "--out", "a.gif", "--caption")
    assert done.returncode != 0
    assert "which only a drop has" in done.stderr


NOT_FINITE = """
p.createMultiBody(1, p.createCollisionShape(p.GEOM_SPHERE, radius=.1), -1, [0, 0, float("nan")])
p.applyExternalForce(body, -1, [float("inf"), 0, 0], [0, 0, 0], p.LINK_FRAME)
for step in range(24):
    p.stepSimulation()
"""


@pytest.mark.long
@pytest.mark.parametrize("view", some(["standard", "follow"], 1))
def test_a_body_whose_position_is_not_finite_is_not_drawn_there(
    record: Record, tmp_path: Path, view: str
) -> None:
    path = record(FALLS + NOT_FINITE)
    render(path, out=tmp_path / "gone.gif", view=view)  # type: ignore[arg-type]
    shown = [len(redness(one)) for one in pictures(tmp_path / "gone.gif")]
    assert len(shown) == 13
    assert shown[10] > 0
    assert shown[11:] == [0, 0]


def test_a_body_whose_position_was_never_finite_is_not_looked_at(
    record: Record, tmp_path: Path
) -> None:
    path = record(FALLS + NOT_FINITE)
    with pytest.raises(
        RecordingError, match="no position of 2_sphere is finite: the camera cannot"
    ):
        render(path, out=tmp_path / "a.gif", view="follow", body="2")
    assert not list(tmp_path.iterdir())


def test_bodies_far_apart_are_seen_though_nothing_is_in_their_middle(
    record: Record, tmp_path: Path
) -> None:
    ball = "p.createMultiBody(1, p.createCollisionShape(p.GEOM_SPHERE, radius=.1), -1, [{}, 0, 0])"
    apart = "\n".join(["import pybullet as p", "p.connect(p.DIRECT)", *map(ball.format, (0, 90))])
    path = record(apart + "\np.stepSimulation()\n")
    assert render(path, out=tmp_path / "far.gif", view="standard").frames == 1


@pytest.mark.long
@pytest.mark.parametrize("view", some(["standard", "follow"], 1))
def test_the_poses_of_a_drop_are_drawn_near_where_a_camera_is_named(
    drop: Drop, tmp_path: Path, view: str
) -> None:
    """The floor is tiled; frames have their usual rate, up to the end, at which the body rests."""
    drop("simulate", "--height", "0.5", "--duration", "0.7", "--out", "run.rrd")
    assert drop("render", "run.rrd", "--camera", view).returncode == 0
    shown = pictures(tmp_path / "run.gif")
    assert len(shown) == 29
    for picture in shown:
        blue = np.argwhere(picture[..., 2].astype(int) - picture[..., 0] > 60)
        assert np.ptp(blue, axis=0).min() > 40
    assert len(np.unique(shown[0][300, :, 0])) > 1
    # It lands at 0.31 s, after 12 pictures.
    rows = np.array(
        [np.argwhere(each[..., 2].astype(int) - each[..., 0] > 60)[:, 0].mean() for each in shown]
    )
    if view == "follow":
        assert np.ptp(rows) < 20
    else:  # it is seen to fall, and to lie
        assert (np.diff(rows[:12]) > 0).all()
        assert np.ptp(rows) > 120
        assert np.ptp(rows[14:]) < 3
    done = drop("render", "run.rrd", "--body", "box", "--force")
    assert (done.returncode, "a drop has only one body" in done.stderr) == (2, True)


@pytest.mark.long
def test_beside_a_drop_its_free_fall_lands_and_a_ruler_says_how_high_it_is(standard: Run) -> None:
    """Free fall is drawn in the image plane, and the ruler's ticks at PyBullet's projection."""
    held = read(standard.simulation.recording)
    parts, table = parts_of(held.path, held.seen)[:1], standard.analysis.table
    scene = FallScene(parts, table, AXES, held.engine.rest_height_m)
    (free,), times_s = scene.in_free_fall, np.array([0, 72, 105, 110, 240]) / 240
    fallen_m = np.maximum(1 - 9.81 * times_s**2 / 2, 0.025)
    places_m = free.at(times_s)[:, :3]
    assert places_m[:, 2] == pytest.approx(fallen_m, abs=1e-6)
    beside_m = places_m - parts[0].at(times_s)[:, :3]
    assert beside_m[:, :2] @ AXES[0, :2] == pytest.approx(2.5 * parts[0].radius_m, rel=1e-3)
    assert beside_m[:, :2] @ AXES[2, :2] == pytest.approx(0.0, abs=1e-5)
    camera = replace(STANDARD_CAMERA, target_m=(0.0, 0.0, 0.5), distance_m=0.5)
    marks = {mark.text.strip(): mark.line for mark in scene.marks(camera, 0.3)}
    assert {"simulated", "free fall", "0.4 m", "0.5 m", "0.6 m"} < marks.keys()
    view = np.reshape(view_matrix(camera), (4, 4)).T
    foot_m = parts[0].at(np.array([0.3]))[0, :3] - 1.25 * parts[0].radius_m * AXES[0]
    for height_m in (0.4, 0.5, 0.6):
        right, up, back, _ = view @ [*foot_m[:2], height_m, 1]
        column, row = 240 - 311.77 * right / back, 180 + 311.77 * up / back
        assert marks[f"{height_m} m"][0] == pytest.approx((column, row), abs=0.01)
    assert not any(text.startswith("-") for text in marks)
    assert not FallScene(parts, table.with_columns(timestep_m=None), AXES, None).in_free_fall


@pytest.mark.long
def test_a_drop_without_frames_has_no_gif_unless_a_camera_is_named(drop: Drop) -> None:
    drop("simulate", "--no-camera", "--duration", "0.1", "--out", "run.rrd")
    assert "gif" not in drop("render", "run.rrd").stdout
    assert "run.gif   3 frames" in drop("render", "run.rrd", "--camera", "follow").stdout


RIGID = """
import sys
import pybullet as p
import pybullet_data
p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
box = p.createCollisionShape(p.GEOM_BOX, halfExtents=[.1, .2, .05])
look = p.createVisualShape(p.GEOM_BOX, halfExtents=[.1, .2, .05], rgbaColor=[1, 0, 0, 1])
p.createMultiBody(
    1, box, look, [0, 0, 1], [.5, .5, .5, .5], baseInertialFramePosition=[.3, 0, .1],
    baseInertialFrameOrientation=[0, .6, 0, .8], useMaximalCoordinates={rigid},
)
p.loadURDF("teddy_vhacd.urdf", [1, 0, 1], [.5, .5, .5, .5], useMaximalCoordinates={rigid})
p.stepSimulation()
"""


LEAVES = (
    FALLS + "p.resetBaseVelocity(body, [6, 0, 3])\nfor step in range(240): p.stepSimulation()\n"
)


@pytest.mark.long
def test_what_leaves_is_followed(record: Record, tmp_path: Path) -> None:
    render(record(LEAVES), out=tmp_path / "leaves.gif")
    shown = [redness(picture) for picture in pictures(tmp_path / "leaves.gif")]
    assert min(map(len, shown)) > 1000
    middles = np.array([red.mean(axis=0) for red in shown])
    assert (np.abs(middles - (180, 240)) < (150, 200)).all()


@pytest.mark.long
@pytest.mark.parametrize("dark", some([False, True], 1))
def test_a_film_has_a_floor_of_tiles_edges_and_a_clock(
    record: Record, tmp_path: Path, dark: bool
) -> None:
    render(record(FALLS), out=tmp_path / "film.gif", dark=dark)
    first, last = (pictures(tmp_path / "film.gif")[place].astype(int) for place in (0, -1))
    floor = np.sort(last[300:, :120].reshape(-1, 3).mean(axis=1))
    assert floor[-1] - floor[0] > 8
    assert np.ptp(np.unique(np.round(floor, 1))) < 60  # two greys, little apart
    assert (first[-40:, -120:] != last[-40:, -120:]).any()
    # Above the horizon there is the page, into which the floor fades.
    page = (np.array(ImageColor.getrgb((DARK if dark else LIGHT).page)),)
    assert (last[0] == page).all()
    steps = np.abs(np.diff(last[:200, 0].mean(axis=1)))
    assert steps[np.flatnonzero(steps)[0]] < 5
    assert steps.sum() > 16
    red = redness(last)
    top, left = red.min(axis=0) - 2
    around = last[top : top + 3, left : left + 80]
    if dark:  # an edge, not so dark as the page
        assert (around[..., 1:].max(axis=2) == page[0][2] + 40).any()
    else:  # darker than box, tiles and page
        assert around.min() < 90
    shades = {tuple(last[row, column]) for row, column in red.tolist()}
    assert len(shades) >= 3  # of top and two sides


@pytest.mark.long
def test_a_plot_of_what_is_found_grows_beside_a_film(record: Record, tmp_path: Path) -> None:
    render(record(FALLS), out=tmp_path / "both.gif", animation=Animation(with_plot=True))
    shown = pictures(tmp_path / "both.gif")
    assert {one.shape for one in shown} == {(360, 960, 3)}
    plots = [picture[:, 480:].astype(int) for picture in shown]
    left = slice(60, 200)  # the first third of the time axis
    assert (plots[0][:, left] != plots[5][:, left]).any()
    assert (plots[5][:, left] == plots[10][:, left]).all()


@pytest.mark.long
def test_a_btrigidbody_is_drawn_round_its_centre_of_mass(record: Record, tmp_path: Path) -> None:
    """PyBullet does not report its centre of mass in the body frame; a btMultiBody looks alike."""
    shown = []
    for rigid in (False, True):
        render(record(RIGID.format(rigid=rigid)), out=tmp_path / f"{rigid}.gif")
        shown.append(pictures(tmp_path / f"{rigid}.gif")[0].astype(int))
    assert len(redness(shown[0])) > 1000
    assert np.abs(shown[0] - shown[1]).max() <= 2


def test_a_plane_is_a_checkerboard_from_any_side_of_it() -> None:
    """Compared with PyBullet's own matrices: each pixel's ray is intersected with the plane."""
    camera = replace(STANDARD_CAMERA, size_px=(640, 480), target_m=(0.3, -0.2, 0.4), distance_m=1.5)
    place = (0.1, 0.2, -0.3), p.getQuaternionFromEuler((0.3, -0.2, 0.7))
    tiles = np.array([[200] * 3, [100] * 3, [255] * 3], np.uint8)
    client = p.connect(p.DIRECT)
    colours, nearness = checkerboard(camera, place, 0.25, tiles)
    view = np.reshape(view_matrix(camera), (4, 4)).T
    lens = np.reshape(p.computeProjectionMatrixFOV(60, 4 / 3, 0.1, 10), (4, 4)).T
    to_world, axes = (
        np.linalg.inv(lens @ view),
        np.reshape(p.getMatrixFromQuaternion(place[1]), (3, 3)),
    )
    certain = 0
    for row in range(0, 480, 43):
        for column in range(0, 640, 43):
            on_screen = 2 * (column + 0.5) / 640 - 1, 1 - 2 * (row + 0.5) / 480
            ends = [to_world @ [*on_screen, depth, 1] for depth in (-1, 1)]
            near, far = (((end[:3] / end[3]) - place[0]) @ axes for end in ends)
            met = near + (far - near) * near[2] / (near[2] - far[2])
            away_m = -(view @ [*(axes @ met + place[0]), 1])[2]
            assert nearness[row, column] == pytest.approx(max(1 / away_m, 0), rel=1e-4, abs=1e-5)
            in_square = met[:2] / 0.25 % 1
            if away_m > 0 and away_m < 4 and (abs(in_square - 0.5) < 0.49).all():
                certain += 1
                tile = tiles[int(np.floor(met[:2] / 0.25).sum()) % 2].astype(int)
                # Within a slope of 0.3 towards the horizon it fades into the page, in 12 steps.
                share = min((near[2] - far[2]) / (10 - 0.1) / 0.3, 1)
                fades = np.abs(tile - tiles[2]) / 12 / 2 + 1 if share < 1 else 0
                assert (
                    np.abs(colours[row, column] - (tiles[2] + share * (tile - tiles[2]))) <= fades
                ).all()
    assert certain > 60
    below = replace(camera, pitch_deg=60.0)
    assert not checkerboard(below, place, 0.25, tiles)[1].any()
    p.disconnect(client)
