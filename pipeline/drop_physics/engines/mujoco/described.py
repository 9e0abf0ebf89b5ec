"""Converts a MuJoCo model into bodies of a recording, and `qpos` and `qvel` into their states.

A body of a recording is a child of MuJoCo's world with all that hangs on it: its base is that child
if the child has a free joint or none, otherwise the world. A body with several joints becomes a row
of links, of which only the last has mass (`physics.tree`). Positions are those of centres of mass,
in the axes of inertia; a joint's position is the script's own number.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drop_physics.engines.mujoco.elastic import elasticity_of
from drop_physics.engines.watching.observed import label_name
from drop_physics.physics.rotations import products, rotate, rotate_inverse
from drop_physics.trace.events import Actuator, Body, Collision, Joint, Keyframe, Shape
from drop_physics.trace.states import BASE

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]
Arrays = Mapping[str, NDArray[Any]]
Pose = tuple[Float64, Float64]
"""Position, shape (3,), and quaternion x, y, z, w."""

FREE, BALL, SLIDE, HINGE = range(4)
"""Joint types (`mjtJoint`)."""
GEOMS = {
    0: "plane",
    1: "heightfield",
    2: "sphere",
    3: "capsule",
    4: "ellipsoid",
    5: "cylinder",
    6: "box",
    7: "mesh",
    8: "sdf",
}
"""Geom types (`mjtGeom`)."""
JOINTS = {BALL: "spherical", SLIDE: "prismatic", HINGE: "revolute"}
WIDTHS = {BALL: (4, 3, 0), SLIDE: (1, 1, 0), HINGE: (1, 1, 0)}
"""A joint's numbers of positions, velocities and efforts; no efforts, since drive forces are among
the impulses."""
SHOWN_GROUPS = 3
"""Geom groups that are drawn: the first ones, as in MuJoCo's viewer."""
UNPAINTED = (0.5, 0.5, 0.5, 1.0)
"""Colour of a geom that takes its material's colour."""
ROUNDED = 1e-12
"""Share of a mass up to which a difference from the mass matrix is no edit."""
MOST_KEYFRAMES = 64
"""Largest number of keyframes of a model that are listed."""
NOWHERE, UPRIGHT = np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0])
SHORTEST = 1e-15
"""Length below which MuJoCo treats a quaternion as no rotation (`mjMINVAL`)."""
TRANSMISSIONS = {0: "joint", 1: "joint", 2: "slider-crank", 3: "tendon", 4: "site", 5: "body"}
"""Actuator transmission types (`mjtTrn`)."""
WRAPS_JOINT, WRAPS_SITE = 1, 3
"""Types of objects around which tendons wrap (`mjtWrap`)."""
NAMED_KINDS = ("body", "jnt", "geom", "mesh", "actuator", "tendon", "eq", "site", "key")
NAMED = {"joint": "jnt", "tendon": "tendon", "site": "site", "body": "body"}


@dataclass(frozen=True)
class LinkOf:
    """A link of a recorded body, and the MuJoCo body and joint that it stands for."""

    of: int
    """Index of MuJoCo's body; -1 for a base that is the world."""
    joint: int
    """Index of the MuJoCo joint above it; -1 if it is welded to its parent."""
    whole: bool
    """Whether the link is its body's last one, which has the mass; otherwise it lies between two
    joints."""


@dataclass(frozen=True)
class DescribedBody:
    """A recorded body, and the indices of its values in a model's arrays."""

    body: Body
    links: tuple[LinkOf, ...]
    """The body's base and links."""
    positions: Int64
    """Indices of the coordinates of its joints in `qpos`."""
    rates: Int64
    """Indices of the velocities of its joints in `qvel`."""
    balls: tuple[tuple[slice, slice, Float64], ...]
    """The ball joints: two slices of a joint's indices, in `positions` and in `rates`, and the
    rotation from its link's frame to the link's inertial axes."""
    free: int
    """MuJoCo's free joint of the base; -1 if there is none."""

    def as_number(self, number: int, client: int) -> DescribedBody:
        """Return a copy of this body with another id, for another simulation of the same model."""
        label = f"{number}_{label_name(self.body.name)}"
        return replace(self, body=replace(self.body, number=number, label=label, client=client))

    @property
    def root(self) -> int:
        """Index of the MuJoCo body that is the base.

        If the base is the world: of the first body attached to the world.
        """
        return self.links[0].of if self.links[0].of >= 0 else self.links[1].of


@dataclass(frozen=True)
class DescribedModel:
    """The recorded bodies of a MuJoCo model."""

    arrays: Arrays
    bodies: tuple[DescribedBody, ...]
    link_of: Mapping[int, tuple[int, int]]
    """Id of the recorded body, and the link, for each MuJoCo body."""
    dof_of: Mapping[int, tuple[int, int]]
    """Id of the body, and index in its generalised velocity, for each degree of freedom."""
    names: Mapping[str, list[str]]
    """The names of all elements by MuJoCo's element type: `body`, `jnt`, `geom`, `actuator`,
    `tendon`, `eq`."""


def described(
    arrays: Arrays,
    *,
    client: int,
    first: int,
    folder: Path,
    known: Mapping[int, DescribedBody] | None = None,
) -> DescribedModel:
    """Describe a model as bodies of a recording.

    Parameters
    ----------
    arrays
        The model's constants, by MuJoCo's names.
    client
        The number of the simulation.
    first
        The number of the first body in the recording.
    folder
        Where meshes are written, for the recorder to read.
    known
        Bodies that were described before and have not changed, by number.
    """
    names = {kind: _names(arrays, kind) for kind in (*NAMED_KINDS, "sensor", "flex")}
    parents = arrays["body_parentid"].tolist()
    tops = [body for body in range(1, len(parents)) if parents[body] == 0]
    if _geoms_of(arrays, 0):
        tops.insert(0, 0)
    of_top: dict[int, list[int]] = {top: [] for top in tops}
    for body in range(len(parents)):
        if (top := _top(parents, body)) in of_top:
            of_top[top].append(body)
    bodies, link_of, dof_of = [], {0: (first, BASE)}, {}
    for number, top in enumerate(tops, first):
        made = (known or {}).get(number)
        made = made or _described(arrays, names, of_top[top], number, client, folder)
        bodies.append(made)
        for link, each in enumerate(made.links, BASE):
            if each.of >= 0 and each.whole:
                link_of[each.of] = number, link
        begin = 0
        if made.free >= 0:
            at = int(arrays["jnt_dofadr"][made.free])
            # MuJoCo has the velocity before the spin.
            for k in range(6):
                dof_of[at + k] = number, (k + 3) % 6
            begin = 6
        for k, dof in enumerate(made.rates.tolist()):
            dof_of[dof] = number, begin + k
    nodes = _nodes(arrays, names["flex"])
    elastic = {name: elasticity_of(arrays, flex) for flex, name in enumerate(names["flex"])}
    bodies = [
        replace(
            made,
            body=replace(made.body, node_of=nodes[made.root], elastic=elastic[nodes[made.root]]),
        )
        if made.root in nodes
        else made
        for made in bodies
    ]
    apart = _apart(arrays, link_of)
    bodies = [
        replace(made, body=replace(made.body, apart=tuple(apart[made.body.number])))
        if made.body.number in apart
        else made
        for made in bodies
    ]
    return DescribedModel(arrays, tuple(bodies), link_of, dof_of, names)


def _nodes(arrays: Arrays, names: list[str]) -> dict[int, str]:
    """Return the flexible body (flex) to which each of its node bodies belongs, by body id."""
    found: dict[int, str] = {}
    bodies = np.atleast_1d(arrays.get("flex_vertbodyid", ()))
    for flex, name in enumerate(names if len(bodies) else ()):
        first = int(np.atleast_1d(arrays["flex_vertadr"])[flex])
        its = bodies[first : first + int(np.atleast_1d(arrays["flex_vertnum"])[flex])]
        found |= dict.fromkeys((int(each) for each in its if each > 0), name)
    return found


def _apart(
    arrays: Arrays, link_of: Mapping[int, tuple[int, int]]
) -> dict[int, list[tuple[int, int, int]]]:
    """Return the contacts that a model excludes (`<exclude>`), by the lower body id."""
    found: dict[int, list[tuple[int, int, int]]] = {}
    for signature in np.atleast_1d(arrays.get("exclude_signature", ())).tolist():
        both = signature >> 16, signature & 0xFFFF
        if all(each in link_of for each in both):
            (body, link), (other, its) = sorted(link_of[each] for each in both)
            found.setdefault(body, []).append((link, other, its))
    return found


def _top(parents: list[int], body: int) -> int:
    """Return the root of a body's kinematic tree: the ancestor attached to the world."""
    while parents[body]:
        body = parents[body]
    return body


def _names(arrays: Arrays, kind: str) -> list[str]:
    """Return the names of all elements of a type; unnamed ones are named by type and index."""
    held = bytes(arrays["names"]) if "names" in arrays else b""
    word = {"jnt": "joint", "eq": "equality", "key": "keyframe"}.get(kind, kind)
    found = []
    for number, at in enumerate(np.atleast_1d(arrays.get(f"name_{kind}adr", ())).tolist()):
        name = held[at : held.index(b"\0", at)].decode("utf-8", "replace")
        found.append(name or f"{word}{number}")
    return found


def _geoms_of(arrays: Arrays, body: int) -> list[int]:
    if "geom_bodyid" not in arrays:
        return []
    return np.flatnonzero(arrays["geom_bodyid"] == body).tolist()


def xyzw(quaternion: NDArray[Any]) -> Float64:
    """Return quaternions with the real part last, shape (…, 4)."""
    return np.roll(np.asarray(quaternion, np.float64), -1, axis=-1)


def normalized(quaternions: Float64) -> Float64:
    """Return quaternions x, y, z, w normalised, shape (…, 4); length 0 becomes no rotation.

    MuJoCo normalises quaternions in the same way when it reads them (`mju_normalize4`).
    """
    length = np.linalg.norm(quaternions, axis=-1, keepdims=True)
    return np.where(length < SHORTEST, UPRIGHT, quaternions / np.maximum(length, SHORTEST))


def _turned(quaternion: Float64, vector: NDArray[Any]) -> Float64:
    return np.asarray(rotate(quaternion[None], np.asarray(vector, np.float64)[None])[0])


def _turned_back(quaternion: Float64, vector: NDArray[Any]) -> Float64:
    return np.asarray(rotate_inverse(quaternion[None], np.asarray(vector, np.float64)[None])[0])


def _product(a: Float64, b: Float64) -> Float64:
    return np.asarray(products(a[None], b[None])[0])


def _inverse(quaternion: Float64) -> Float64:
    return np.asarray(quaternion * [-1.0, -1.0, -1.0, 1.0])


def _inertial(arrays: Arrays, body: int) -> Pose:
    """Return the pose of a body's centre of mass and inertial axes in the body frame."""
    return np.asarray(arrays["body_ipos"][body], np.float64), xyzw(arrays["body_iquat"][body])


def _placed(arrays: Arrays, body: int) -> Pose:
    return np.asarray(arrays["body_pos"][body], np.float64), xyzw(arrays["body_quat"][body])


def _described(
    arrays: Arrays,
    names: Mapping[str, list[str]],
    members: list[int],
    number: int,
    client: int,
    folder: Path,
) -> DescribedBody:
    """Describe a kinematic tree, given by its MuJoCo bodies, as one recorded body."""
    top = members[0]
    name = names["body"][top]
    label = f"{number}_{label_name(name)}"
    first = _joints_of(arrays, top)
    free = first[0] if first and arrays["jnt_type"][first[0]] == FREE else -1
    if first and free < 0:
        links, titles = [LinkOf(-1, -1, whole=True)], ["world"]
        rest = members
    else:
        links, titles = [LinkOf(top, -1, whole=True)], [name]
        rest = members[1:]
    joints: list[Joint] = []
    last: dict[int, int] = {} if rest is members else {top: BASE}
    for body in rest:
        parent = int(arrays["body_parentid"][body])
        its = _joints_of(arrays, body) or [-1]
        for which, joint in enumerate(its):
            whole = joint == its[-1]
            before = last.get(parent, BASE) if which == 0 else len(joints) - 1
            joints.append(
                _joint(arrays, names, links[before + 1], body, joint, whole, which, before, joints)
            )
            links.append(LinkOf(body, joint, whole=whole))
            titles.append(names["body"][body] if whole else f"{names['body'][body]}/{which}")
        last[body] = len(joints) - 1
    positions, rates = list[int](), list[int]()
    balls: list[tuple[slice, slice, Float64]] = []
    for link in links[1:]:
        if link.joint < 0:
            continue
        kind = int(arrays["jnt_type"][link.joint])
        at, dof = int(arrays["jnt_qposadr"][link.joint]), int(arrays["jnt_dofadr"][link.joint])
        width, wide, _ = WIDTHS[kind]
        if kind == BALL:
            axes = _inertial(arrays, link.of)[1] if link.whole else UPRIGHT
            coordinates = slice(len(positions), len(positions) + width)
            balls.append((coordinates, slice(len(rates), len(rates) + wide), axes))
        positions += range(at, at + width)
        rates += range(dof, dof + wide)
    moving = {BASE} if free >= 0 else set[int]()
    for joint_ in joints:
        if any(joint_.widths) or joint_.parent in moving:
            moving.add(joint_.link)
    shapes, collisions = _shapes(arrays, names, links, members, folder)
    mine = {link.joint for link in links if link.joint >= 0} | ({free} - {-1})
    body_ = Body(
        number=number,
        label=label,
        name=name,
        engine_id=top,
        client=client,
        links=tuple(titles),
        joints=tuple(joints),
        moving=tuple(sorted(moving)),
        soft=False,
        shapes=shapes,
        collisions=collisions,
        actuators=tuple(_actuators(arrays, names, mine)),
    )
    made = DescribedBody(
        body_,
        tuple(links),
        np.array(positions, np.int64),
        np.array(rates, np.int64),
        tuple(balls),
        free,
    )
    return replace(made, body=replace(body_, keyframes=tuple(_keyframes(arrays, names, made))))


def _keyframes(
    arrays: Arrays, names: Mapping[str, list[str]], made: DescribedBody
) -> Iterator[Keyframe]:
    """Yield the poses of one jointed body in the model's keyframes."""
    if not len(made.positions) or "key_qpos" not in arrays:
        return
    qpos = np.asarray(arrays["key_qpos"], np.float64)[:MOST_KEYFRAMES]
    held, _ = joints_of(made, qpos, np.zeros((len(qpos), int(arrays["nv"].item()))))
    given = np.asarray(arrays.get("key_ctrl", np.zeros((len(qpos), 0))), np.float64)
    mine = [actuator.number for actuator in made.body.actuators]
    for name, joints, ctrl in zip(names["key"], held, given, strict=False):
        yield Keyframe(name, tuple(joints.tolist()), tuple(ctrl[mine].tolist()))


def _joints_of(arrays: Arrays, body: int) -> list[int]:
    first = int(arrays["body_jntadr"][body])
    return [*range(first, first + int(arrays["body_jntnum"][body]))]


def _joint(
    arrays: Arrays,
    names: Mapping[str, list[str]],
    parent: LinkOf,
    body: int,
    joint: int,
    whole: bool,
    which: int,
    before: int,
    joints: list[Joint],
) -> Joint:
    """Return the joint between a link and its parent link (`mj_kinematics`)."""
    inertial = _inertial(arrays, body) if whole else (NOWHERE, UPRIGHT)
    if which == 0:
        at, turn = _placed(arrays, body)
        if parent.of >= 0:
            centre, axes = _inertial(arrays, parent.of)
        else:
            centre, axes = NOWHERE, UPRIGHT
    else:  # the link before is the same body, before its next joint
        (at, turn), (centre, axes) = (NOWHERE, UPRIGHT), (NOWHERE, UPRIGHT)
    if joint < 0:
        pivot, axis, kind = at, NOWHERE, "fixed"
    else:
        anchor = np.asarray(arrays["jnt_pos"][joint], np.float64)
        pivot = at + _turned(turn, anchor)
        kind = JOINTS[int(arrays["jnt_type"][joint])]
        axis = np.asarray(arrays["jnt_axis"][joint], np.float64)
        rest = float(arrays["qpos0"][arrays["jnt_qposadr"][joint]])
        if kind == "prismatic":
            pivot = pivot - _turned(turn, axis) * rest
        elif kind == "revolute":
            turn = _product(turn, np.append(np.sin(-rest / 2) * axis, np.cos(rest / 2)))
    limited = joint >= 0 and kind != "fixed" and bool(arrays["jnt_limited"][joint])
    dof = int(arrays["jnt_dofadr"][joint]) if joint >= 0 else 0
    one = joint >= 0 and kind != "spherical"
    low, high = arrays["jnt_range"][joint].tolist() if limited and one else (0.0, -1.0)
    onto = _product(_product(_inverse(axes), turn), inertial[1])
    from_parent = _turned_back(axes, pivot - centre)
    return Joint(
        link=len(joints),
        name=names["jnt"][joint] if joint >= 0 else names["body"][body],
        kind=kind,
        parent=before,
        widths=(0, 0, 0) if joint < 0 else WIDTHS[int(arrays["jnt_type"][joint])],
        limits=(low, high),
        axis=tuple(_turned_back(inertial[1], axis).tolist()),
        parent_position_m=tuple(from_parent.tolist()),
        parent_orientation=tuple(_inverse(onto).tolist()),
        damping=float(arrays["dof_damping"].reshape(-1)[dof]) if joint >= 0 else 0.0,
        friction=float(arrays["dof_frictionloss"][dof]) if joint >= 0 else 0.0,
    )


def reported_of(arrays: Arrays, made: DescribedBody) -> dict[str, Float64]:
    """Return the masses, inertias and inertial frames of base and links.

    Inertias are those in MuJoCo's mass matrix. For simple bodies these come from `dof_M0`, which
    keeps the compiled values until `mj_setConst`. The effect of an edited mass on the matrix is in
    `coupled`.
    """
    count = len(made.links)
    masses, inertias, positions = np.zeros(count), np.zeros((count, 3)), np.zeros((count, 3))
    orientations, friction = np.tile(UPRIGHT, (count, 1)), np.full(count, np.nan)
    armature = np.zeros(count)
    for row, link in enumerate(made.links):
        if link.joint >= 0:
            positions[row] = -np.asarray(arrays["jnt_pos"][link.joint])
            armature[row] = arrays["dof_armature"][arrays["jnt_dofadr"][link.joint]]
        if link.of < 0 or not link.whole:
            continue
        stands = row == 0 and made.free < 0
        centre, axes = _inertial(arrays, link.of)
        positions[row] += centre
        orientations[row] = axes
        if not stands:
            masses[row] = arrays["body_mass"][link.of]
            inertias[row] = arrays["body_inertia"][link.of]
        if geoms := _geoms_of(arrays, link.of):
            friction[row] = max(arrays["geom_friction"][geoms, 0])
    damping = np.full(count, np.nan)
    if made.free >= 0:
        dof = int(arrays["jnt_dofadr"][made.free])
        damping[0] = float(arrays["dof_damping"].reshape(-1)[dof])
        armature[0] = arrays["dof_armature"][dof]
        held = arrays["dof_M0"][dof + 3 : dof + 6] - armature[0]
        if arrays["dof_simplenum"][dof] and not np.allclose(held, inertias[0], ROUNDED, 0.0):
            inertias[0] = held
    coupled = [*_tendons_with_inertia(arrays, made), *_edited_masses(arrays, made)]
    return {
        "mass_kg": masses,
        "inertia_kg_m2": inertias,
        "inertial_position_m": positions,
        "inertial_orientation": orientations,
        "lateral_friction": friction,
        "armature": armature,
        "base_damping": damping,
        **({"coupled": np.array(coupled)} if coupled else {}),
    }


def _edited_masses(arrays: Arrays, made: DescribedBody) -> Iterator[list[float]]:
    """Yield corrections of the mass matrix where an edited mass had no effect on it.

    MuJoCo's matrix keeps the compiled mass of simple bodies. Each correction is a mass [kg],
    followed by the motion that it takes part in per unit velocity of each dof.
    """
    moves: list[tuple[int, int]] = []
    if made.free >= 0:
        first = int(arrays["jnt_dofadr"][made.free])
        moves = [(first + axis, made.root) for axis in range(3)]
    moves += [
        (int(arrays["jnt_dofadr"][link.joint]), link.of)
        for link in made.links
        if link.joint >= 0 and arrays["jnt_type"][link.joint] == SLIDE
    ]
    begin = 6 * (made.free >= 0)
    rates = made.rates.tolist()
    for dof, body in moves:
        held = float(arrays["dof_M0"][dof] - arrays["dof_armature"][dof])
        lacks = held - float(arrays["body_mass"][body])
        if not arrays["dof_simplenum"][dof] or abs(lacks) <= ROUNDED * held:
            continue
        moved = [0.0] * (begin + len(rates))
        moved[begin + rates.index(dof) if dof in rates else dof - first + 3] = 1.0
        yield [lacks, *moved]


def _tendons_with_inertia(arrays: Arrays, made: DescribedBody) -> Iterator[list[float]]:
    """Yield each tendon's armature and velocity per dof, for tendons over one body's joints."""
    first = 6 * (made.free >= 0)
    places = {dof: first + k for k, dof in enumerate(made.rates.tolist())}
    for tendon in np.flatnonzero(arrays.get("tendon_armature", np.zeros(0))).tolist():
        moved = [0.0] * (first + len(places))
        begin = int(arrays["tendon_adr"][tendon])
        wraps = range(begin, begin + int(arrays["tendon_num"][tendon]))
        if all(arrays["wrap_type"][wrap] == WRAPS_JOINT for wrap in wraps):
            dofs = [int(arrays["jnt_dofadr"][arrays["wrap_objid"][wrap]]) for wrap in wraps]
            if {*dofs} <= places.keys():
                for dof, wrap in zip(dofs, wraps, strict=True):
                    moved[places[dof]] += float(arrays["wrap_prm"][wrap])
                yield [float(arrays["tendon_armature"][tendon]), *moved]


# -- states ---------------------------------------------------------------------------------------


def base_of(
    arrays: Arrays, made: DescribedBody, qpos: Float64, qvel: Float64, *, unit: bool = False
) -> Float64:
    """Return pose and velocities of a floating base from `qpos` and `qvel`, shape (n, 13).

    `qpos` and `qvel` describe the body's frame: its velocity in world axes, its spin in body axes.
    `unit` means that only MuJoCo wrote the quaternions: they are then copied to the bit, not
    normalised.
    """
    at, dof = (int(arrays[f"jnt_{name}adr"][made.free]) for name in ("qpos", "dof"))
    turn = xyzw(qpos[:, at + 3 : at + 7])
    turn = turn if unit else normalized(turn)
    centre, axes = _inertial(arrays, made.root)
    n = len(qpos)
    arm = rotate(turn, np.tile(centre, (n, 1)))
    spin = rotate(turn, qvel[:, dof + 3 : dof + 6])
    return np.hstack(
        (
            qpos[:, at : at + 3] + arm,
            products(turn, np.tile(axes, (n, 1))),
            qvel[:, dof : dof + 3] + np.cross(spin, arm),
            spin,
        )
    )


def joints_of(made: DescribedBody, qpos: Float64, qvel: Float64) -> tuple[Float64, Float64]:
    """Return positions and velocities of a body's joints, shapes (n, positions), (n, dofs)."""
    positions, rates = qpos[:, made.positions], qvel[:, made.rates]
    for coordinates, of_rates, axes in made.balls:
        # From the body's axes to those of its inertia.
        many = np.tile(axes, (len(qpos), 1))
        turn = normalized(xyzw(positions[:, coordinates]))
        positions[:, coordinates] = products(products(many * [-1, -1, -1, 1], turn), many)
        rates[:, of_rates] = rotate_inverse(many, rates[:, of_rates])
    return positions, rates


def standing_base(arrays: Arrays, made: DescribedBody, mocap: Pose | None) -> Float64:
    """Return the pose and zero velocities of a base without a free joint, shape (13,)."""
    state = np.zeros(13)
    state[6] = 1.0
    if made.links[0].of < 0 or made.links[0].of == 0:
        return state
    at, turn = _placed(arrays, made.links[0].of) if mocap is None else mocap
    centre, axes = _inertial(arrays, made.links[0].of)
    state[:3], state[3:7] = at + _turned(turn, centre), _product(turn, axes)
    return state


# -- looks ----------------------------------------------------------------------------------------


def _shapes(
    arrays: Arrays,
    names: Mapping[str, list[str]],
    links: list[LinkOf],
    members: list[int],
    folder: Path,
) -> tuple[tuple[Shape, ...], tuple[Collision, ...]]:
    """Return the drawn shapes of a body, and its collision shapes."""
    whole = {each.of: link for link, each in enumerate(links, BASE) if each.whole and each.of >= 0}
    shapes: list[Shape] = []
    collisions: list[Collision] = []
    geoms = [(geom, body) for body in members for geom in _geoms_of(arrays, body)]
    shown = [each for each in geoms if arrays["geom_group"][each[0]] < SHOWN_GROUPS] or geoms
    for geom, body in geoms:
        link = whole[body]
        kind = GEOMS.get(int(arrays["geom_type"][geom]), str(arrays["geom_type"][geom]))
        centre, axes = _inertial(arrays, body)
        position = _turned_back(axes, arrays["geom_pos"][geom] - centre)
        orientation = _product(_inverse(axes), xyzw(arrays["geom_quat"][geom]))
        pose = tuple(position.tolist()), tuple(orientation.tolist())
        size, file = size_of(kind, arrays["geom_size"][geom]), ""
        if kind == "mesh":
            mesh = int(arrays["geom_dataid"][geom])
            size, file = (1.0, 1.0, 1.0), str(_mesh(arrays, names["mesh"], mesh, folder))
        if (geom, body) in shown:
            shapes.append(Shape(link, kind, size, file, *pose, _colour(arrays, geom)))
        if arrays["geom_contype"][geom] or arrays["geom_conaffinity"][geom]:
            hull = _hull(arrays, geom, position, orientation) if kind == "mesh" else ()
            bits = int(arrays["geom_contype"][geom]), int(arrays["geom_conaffinity"][geom])
            collisions.append(Collision(link, kind, size, Path(file).name, *pose, hull, bits))
    return tuple(shapes), tuple(collisions)


def size_of(kind: str, size: NDArray[Any]) -> tuple[float, ...]:
    """Return a geom's size in the format of a `Shape`, from MuJoCo's half sizes."""
    x, y, z = size.tolist()
    return {
        "plane": (2 * x, 2 * y) if x and y else (),
        "sphere": (x,),
        "capsule": (2 * y, x),
        "cylinder": (2 * y, x),
        "box": (2 * x, 2 * y, 2 * z),
        "ellipsoid": (2 * x, 2 * y, 2 * z),
    }.get(kind, (x, y, z))


def _colour(arrays: Arrays, geom: int) -> tuple[float, ...]:
    rgba = tuple(np.asarray(arrays["geom_rgba"][geom], np.float64).round(6).tolist())
    material = int(arrays["geom_matid"][geom])
    if material >= 0 and rgba == UNPAINTED and "mat_rgba" in arrays:
        rgba = tuple(np.asarray(arrays["mat_rgba"][material], np.float64).round(6).tolist())
    return rgba


def _mesh(arrays: Arrays, names: list[str], mesh: int, folder: Path) -> Path:
    """Write a MuJoCo mesh as a file for the recorder to read."""
    path = folder / f"{label_name(names[mesh])}_{mesh}.obj"
    if not path.exists():
        corner, face = (int(arrays[f"mesh_{name}adr"][mesh]) for name in ("vert", "face"))
        corners = arrays["mesh_vert"][corner : corner + int(arrays["mesh_vertnum"][mesh])]
        faces = arrays["mesh_face"][face : face + int(arrays["mesh_facenum"][mesh])] + 1
        lines = [*("v {:.7g} {:.7g} {:.7g}".format(*each) for each in corners.tolist())]
        lines += ["f {} {} {}".format(*each) for each in faces.tolist()]
        path.write_text("\n".join(lines) + "\n", encoding="ascii")
    return path


def _hull(arrays: Arrays, geom: int, position: Float64, orientation: Float64) -> tuple[float, ...]:
    """Return the vertices of MuJoCo's convex hull of a mesh (`mesh_graph`), placed on its link."""
    mesh = int(arrays["geom_dataid"][geom])
    at = int(arrays["mesh_graphadr"][mesh])
    if at < 0 or "mesh_graph" not in arrays:
        return ()
    graph = arrays["mesh_graph"]
    count = int(graph[at])
    which = graph[at + 2 + count : at + 2 + 2 * count]
    corners = arrays["mesh_vert"][int(arrays["mesh_vertadr"][mesh]) + which]
    turns = np.broadcast_to(orientation, (len(corners), 4))
    return tuple((position + rotate(turns, corners)).round(6).ravel().tolist())


# -- actuators ------------------------------------------------------------------------------------


def _actuators(
    arrays: Arrays, names: Mapping[str, list[str]], mine: set[int]
) -> Iterator[Actuator]:
    """Yield the actuators that act on a body's joints or other elements, and on no other body's."""
    for number in range(len(names["actuator"])):
        kind = TRANSMISSIONS.get(int(arrays["actuator_trntype"][number]), "other")
        target = int(arrays["actuator_trnid"][number, 0])
        if kind == "joint":
            is_mine = target in mine
        elif kind in ("site", "slider-crank"):
            is_mine = bool(mine & _joints_above(arrays, int(arrays["site_bodyid"][target])))
        elif kind == "body":
            is_mine = bool(mine & _joints_above(arrays, target))
        elif kind == "tendon":
            is_mine = bool(mine & _joints_of_tendon(arrays, target))
        else:
            is_mine = False
        if not is_mine:
            continue
        named = NAMED.get("site" if kind == "slider-crank" else kind, "jnt")
        gains, biases = arrays["actuator_gainprm"][number], arrays["actuator_biasprm"][number]
        yield Actuator(
            name=names["actuator"][number],
            number=number,
            kind=_kind(arrays, number),
            acts_on=kind,
            target=names[named][target] if target < len(names[named]) else "",
            gear=float(arrays["actuator_gear"][number, 0]),
            kp=float(gains[0]),
            kv=float(-biases[2]),
            ctrl_range=_range(arrays, "ctrl", number),
            force_range=_range(arrays, "force", number),
        )


def _range(arrays: Arrays, what: str, number: int) -> tuple[float, float] | None:
    if not arrays[f"actuator_{what}limited"][number]:
        return None
    low, high = arrays[f"actuator_{what}range"][number].tolist()
    return low, high


def _kind(arrays: Arrays, number: int) -> str:
    """Return the MJCF tag for an actuator, derived from its gain and bias types (`mjtGain`)."""
    gain, bias = int(arrays["actuator_gaintype"][number]), int(arrays["actuator_biastype"][number])
    kp, biases = arrays["actuator_gainprm"][number][0], arrays["actuator_biasprm"][number]
    if int(arrays["actuator_dyntype"][number]) != 0 or gain != 0:
        return "muscle" if gain == 2 else "general"  # `mjGAIN_MUSCLE`
    if bias == 0:
        return "motor"
    if bias == 1 and kp and biases[1] == -kp and not biases[0]:
        return "position"
    if bias == 1 and kp and not biases[1] and biases[2] == -kp and not biases[0]:
        return "velocity"
    return "general"


def _joints_above(arrays: Arrays, body: int) -> set[int]:
    found: set[int] = set()
    while body > 0:
        found |= {*_joints_of(arrays, body)}
        body = int(arrays["body_parentid"][body])
    return found


def _joints_of_tendon(arrays: Arrays, tendon: int) -> set[int]:
    """Return the joints that a tendon moves."""
    first = int(arrays["tendon_adr"][tendon])
    found: set[int] = set()
    for wrap in range(first, first + int(arrays["tendon_num"][tendon])):
        kind, number = int(arrays["wrap_type"][wrap]), int(arrays["wrap_objid"][wrap])
        if kind == WRAPS_JOINT:
            found.add(number)
        elif kind == WRAPS_SITE:
            found |= _joints_above(arrays, int(arrays["site_bodyid"][number]))
    return found
