"""What the recording of a script holds, and in which order.

Numbers go into `state`, `contacts` and the entities beside them, as float64; what is drawn of them
is thinned to what a viewer can show.
"""

from __future__ import annotations

import hashlib
import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import fields
from pathlib import PurePath
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.filesize import decimal

from pipeline.fields import all_of
from pipeline.messages import Message
from pipeline.recording import pictures, schema, writer
from pipeline.recording.digest import (
    FrameDigest,
    RowsDigest,
    ToldDigest,
    closing_digest,
    inputs_digest,
)
from pipeline.recording.gathering import Gathering
from pipeline.recording.writer import Chunk, Times
from pipeline.seen import (
    Appearance,
    At,
    Body,
    Call,
    Constraint,
    Dynamics,
    Ending,
    Event,
    Given,
    Image,
    Joints,
    Motor,
    Push,
    Put,
    Samples,
    Settings,
    Solver,
)
from pipeline.states import Rows

ROWS_TOGETHER, POSES_TOGETHER, IMAGES_TOGETHER = 1024, 1 << 16, 32
"""Rows that are held until they become chunks."""
FARTHEST_M = 10.0
"""The viewer's eye ignores what is farther than this from where it started."""
LONGEST, MOST_NOTES = 1000, 10
"""Characters of a text, and notes, that are kept in a property."""
SHOWN_PER_S = 60
"""Poses drawn per second of simulated time."""


class Script:
    """A script's recording while it is made.

    Parameters
    ----------
    origin
        What was run; see `schema.ORIGIN_PROPERTY`.
    compared
        Whether another run is compared: only then a digest of each state is kept.
    """

    def __init__(self, origin: Mapping[str, Any], *, compared: bool = False) -> None:
        self.origin, self._compared = origin, compared
        self.samples = self.frames = 0
        self._ends: dict[int, int] = {}
        """The last step of which each simulation has a sample, by client."""
        self.bodies: dict[int, Body] = {}
        """All that ever existed, by number."""
        self.cameras: dict[str, int] = {}
        self.free: set[int] = set()
        self.jointed: set[int] = set()
        self.stepped = False
        self.touched: set[int] = set()
        self.energetic: set[int] = set()
        """In these four: bodies with a curve of their height, joints, contact force, energy."""
        self.low_m = self.high_m = np.zeros(3)
        """Corners of the box that all motion stayed in, without what flew off."""
        self._first_m: NDArray[np.float64] | None = None
        self._masses: dict[int, Mapping[str, NDArray[np.float64]]] = {}
        self._gravity: dict[int, NDArray[np.float64]] = {}
        self._states, self._contacts = RowsDigest(), RowsDigest()
        self._joints: dict[str, RowsDigest] = {}
        self._pictures: dict[int, FrameDigest] = {}
        self._told_rows = ToldDigest()
        self._rows = Gathering(writer.table_chunk, most=ROWS_TOGETHER)
        self._poses = Gathering(pictures.poses, most=POSES_TOGETHER)
        self._curves = Gathering(pictures.curves, most=POSES_TOGETHER)
        self._images = Gathering(pictures.images, most=IMAGES_TOGETHER)
        self._log = Gathering(pictures.log, most=ROWS_TOGETHER)
        self._lenses: dict[int, object] = {}
        self._shown_at: dict[tuple[int, int], int] = {}
        self._digests: dict[int, list[tuple[int, bytes]]] = {}
        self._drawn: dict[int, tuple[Any, ...]] = {}
        self._undrawn: dict[int, str] = {}
        """Labels of bodies with a shape that cannot be drawn, by number."""

    def chunks(self, events: Iterable[Event], ending: Callable[[], Ending]) -> Iterator[Chunk]:
        """Yield the whole recording; `ending` is called after the last event."""
        yield writer.property_chunk(schema.ORIGIN_PROPERTY, self.origin)
        yield from pictures.scene()
        for event in events:
            yield from self._on(event)
        for gathered in (self._rows, self._log, self._poses, self._curves, self._images):
            yield from gathered.flush()
        ended = ending()
        ended.notes += [
            Message(
                "the soft body {body} is left out: PyBullet does not report its position",
                body=body.label,
            )
            for body in self.bodies.values()
            if body.soft
        ]
        if self._undrawn:
            labels, more = [*self._undrawn.values()][:3], len(self._undrawn) - 3
            if more > 0:
                labels.append(Message("{count} more", count=more))
            ended.notes.append(
                Message(
                    "a shape of {bodies} is not drawn: drop draws boxes, spheres, cylinders, "
                    "capsules whose direction is known, planes, and meshes from files of up to "
                    "{size}",
                    bodies=all_of(labels),
                    size=decimal(pictures.LARGEST_MESH_BYTES),
                )
            )
        yield writer.document_chunk(schema.ABOUT, about(self, ended))
        yield writer.property_chunk(schema.RECORDING_PROPERTY, self._closing(ended))

    def _closing(self, ending: Ending) -> dict[str, Any]:
        closing = {
            "schema_version": schema.SCHEMA_VERSION,
            "samples": self.samples,
            "samples_of_clients": [
                self._ends.get(client, -1) + 1 for client in range(max(self._ends, default=-1) + 1)
            ]
            or None,
            "bodies": len(self.bodies),
            "frames": self.frames,
            "ended": ending.how,
            "error": ending.error[:LONGEST] or None,
            "notes": [note[:LONGEST] for note in ending.notes[:MOST_NOTES]] or None,
            "state_sha256": self._states.hexdigest(),
            "contacts_sha256": self._contacts.hexdigest(),
            "frames_sha256": [digest.hexdigest() for _, digest in sorted(self._pictures.items())]
            or None,
            "joints_sha256": [self._joints[label].hexdigest() for label in sorted(self._joints)]
            or None,
            "told_sha256": self._told_rows.hexdigest(),
            "inputs_sha256": inputs_digest({schema.ORIGIN_PROPERTY: self.origin}),
            **{f"made_with_{name}": value for name, value in ending.made_with.items()},
        }
        return closing | {"closing_sha256": closing_digest(closing)}

    def _on(self, event: Event) -> Iterator[Chunk]:
        match event:
            case Samples():
                yield from self._on_samples(event)
            case Put():
                yield from self._on_put(event)
            case Appearance():
                yield from self._on_appearance(event)
            case Call(at):
                yield from self._on_call(event)
            case Dynamics(at, body, reported):
                self._masses[body.number] = reported
                yield from self._told(schema.DYNAMICS, at, {"body": body.number, **reported})
            case Given(at, body, values):
                yield from self._told(schema.GIVEN, at, {"body": body.number, **_floats(values)})
            case Settings(at, client, values):
                settings = _floats(values)
                self._gravity[client] = np.concatenate(
                    [settings[f"gravityAcceleration{axis}"] for axis in "XYZ"]
                )
                # The viewer's times are rounded; later times are computed from this one.
                first = {"client": client, "time_s": at.time_s}
                yield from self._told(schema.SETTINGS, at, first | settings)
            case Motor(at, body, joint, mode, force):
                driven = {"body": body.number, "joint": joint, "mode": mode, "force": force}
                yield from self._told(schema.MOTORS, at, driven)
            case Solver(at):
                values = {field.name: getattr(event, field.name) for field in fields(event)}
                del values["at"]
                yield from self._told(schema.SOLVER, at, values)
            case Constraint(at, client, number, bodies, there):
                holds = np.array(bodies, np.int64)
                held = {"client": client, "number": number, "bodies": holds, "there": there}
                yield from self._told(schema.CONSTRAINTS, at, held)
            case Push(at, body):
                values = {field.name: getattr(event, field.name) for field in fields(event)}
                del values["at"]
                yield from self._told(schema.PUSHES, at, values | {"body": body.number})
            case Image():
                yield from self._on_image(event)

    def _told(self, entity: str, at: At, values: Mapping[str, Any]) -> Iterator[Chunk]:
        """Add a row of numbers and texts; yield rows when there are enough."""
        held = {name: writer.flat(value).to_pylist() for name, value in values.items()}
        self._told_rows.update(entity, at.step, at.call, held)
        yield from self._rows.add(entity, _at(at), values)

    def take_in(self, event: Event) -> None:
        """Remember a digest of each state, to compare with another run."""
        if isinstance(event, Samples) and len(event.steps):
            # Bodies are numbered in the order in which threads add them.
            states = event.states.copy()
            states["body"] = 0
            digests = self._digests.setdefault(event.client, [])
            for step, rows in zip(
                event.steps.tolist(), states.reshape(len(event.steps), -1), strict=True
            ):
                digest = hashlib.blake2b(rows.tobytes(), digest_size=8).digest()
                digests.append((step, digest))

    def first_difference(self, other: Script) -> int | None:
        """Return the first step at which another run has another state, an extra one, or none."""
        mine, theirs = self._digests, other._digests
        if sorted(mine.values()) == sorted(theirs.values()):  # however threads took turns
            return None
        steps = [
            (one or another)[0]
            for client in mine.keys() | theirs.keys()
            for one, another in itertools.zip_longest(mine.get(client, ()), theirs.get(client, ()))
            if one != another
        ]
        return int(min(steps))

    def _on_samples(self, seen: Samples) -> Iterator[Chunk]:
        if self._compared:
            self.take_in(seen)
        self._states.update(seen.states)
        self._contacts.update(seen.contacts)
        self._reach(seen.states["position_m"])
        self.samples += len(seen.steps)
        if len(seen.steps):
            self._ends[seen.client] = int(seen.steps[-1])
        self.stepped |= bool(len(seen.steps)) and bool(seen.steps[-1] > 0)
        if len(seen.contacts):
            steps = np.unique(seen.contacts["step"])
            times = dict(zip(seen.steps.tolist(), seen.times_s.tolist(), strict=True))
            at = Times(steps, np.array([times[step] for step in steps.tolist()]))
            yield writer.rows_chunk(schema.CONTACTS, seen.contacts, at)
        if len(seen.states):
            at = Times(seen.steps, seen.times_s)
            yield writer.rows_chunk(schema.STATES, seen.states, at)
        for number, joints in seen.joints.items():
            label = self.bodies[number].label
            self._joints.setdefault(label, RowsDigest()).update(joint_rows(joints))
            at = Times(joints.steps, joints.times_s)
            yield writer.numbers_of_steps_chunk(
                f"{schema.STATES.entity}/{label}/{schema.JOINTS}", at,
                {"position": joints.position, "velocity": joints.velocity,
                    "torque": joints.torque},
            )  # fmt: skip
        yield from self._drawn_poses(seen)

    def _reach(self, positions_m: NDArray[np.float64]) -> None:
        """Extend the box by positions, shape (n, 3), except of what has flown off."""
        positions_m = positions_m[np.isfinite(positions_m).all(axis=1)]
        if not len(positions_m):
            return
        if self._first_m is None:
            self._first_m = self.low_m = self.high_m = np.median(positions_m, axis=0)
        near_m = positions_m[np.abs(positions_m - self._first_m).max(axis=1) < FARTHEST_M]
        if len(near_m):
            self.low_m = np.minimum(self.low_m, near_m.min(axis=0))
            self.high_m = np.maximum(self.high_m, near_m.max(axis=0))

    def _drawn_poses(self, seen: Samples) -> Iterator[Chunk]:
        """Yield poses to draw, at most `SHOWN_PER_S` of them, and the last."""
        if not len(seen.steps):
            return
        due = np.floor(seen.times_s * SHOWN_PER_S + 1e-9).astype(np.int64)
        for number, states in seen.bases.items():
            body = self.bodies[number]
            parts = states.reshape(len(seen.steps), -1)
            for column in range(parts.shape[1]):
                link, rows = column - 1, parts[:, column]
                before = self._shown_at.get((number, link), -1)
                shown = np.diff(due, prepend=before) > 0
                shown[-1] = True
                self._shown_at[number, link] = int(due[-1])
                at = Times(seen.steps[shown], seen.times_s[shown], np.full(shown.sum(), seen.call))
                yield from self._poses.add(part_path(body, link), at, rows[shown])
            yield from self._plotted(body, seen, parts)
            yield from self._energy(body, seen, parts)
        yield from self._forces(seen)

    def _plotted(self, body: Body, seen: Samples, parts: Rows) -> Iterator[Chunk]:
        """Yield curves: the height of a body without joints, else its joints."""
        shown = _shown(seen)
        at = Times(seen.steps[shown], seen.times_s[shown])
        if not body.joints:
            if body.number not in self.free:
                self.free.add(body.number)
                yield pictures.curve_names(f"{schema.HEIGHT}/{body.label}", [body.label])
            heights = parts["position_m"][shown, 0, 2]
            yield from self._curves.add(f"{schema.HEIGHT}/{body.label}", at, heights[:, None])
        elif body.number in seen.joints:
            joints = seen.joints[body.number]
            curves = {
                f"{schema.JOINT_POSITIONS}/{body.label}": joints.position,
                f"{schema.JOINT_TORQUES}/{body.label}": joints.torque,
            }
            for entity, values in curves.items():
                if body.number not in self.jointed:
                    yield pictures.curve_names(entity, _joint_names(body, values.shape[1]))
                yield from self._curves.add(entity, at, values[shown])
            self.jointed.add(body.number)

    def _forces(self, seen: Samples) -> Iterator[Chunk]:
        """Yield the total normal force on each body that has been touched [N]."""
        points, shown = seen.contacts, _shown(seen)
        bodies = [body for body in self.bodies.values() if body.number in seen.bases]
        at = Times(seen.steps[shown], seen.times_s[shown])
        numbers = np.array(sorted(body.number for body in bodies), np.int64)
        # A row per sample, a column per body; both sides of a point feel the same force.
        totals_n = np.zeros((len(seen.steps), len(numbers)))
        rows = np.searchsorted(seen.steps, points["step"])
        for side in ("body_a", "body_b"):
            columns = np.searchsorted(numbers, points[side])
            its = np.isin(points[side], numbers)
            np.add.at(totals_n, (rows[its], columns[its]), points["normal_force_n"][its])
        for body in bodies:
            forces_n = totals_n[:, np.searchsorted(numbers, body.number)]
            entity = f"{schema.CONTACT_FORCES}/{body.label}"
            if body.number not in self.touched:
                if not forces_n.any():
                    continue
                self.touched.add(body.number)
                yield pictures.curve_names(entity, [body.label])
            yield from self._curves.add(entity, at, forces_n[shown, None])

    def _energy(self, body: Body, seen: Samples, parts: Rows) -> Iterator[Chunk]:
        """Yield the kinetic and potential energy of a body [J].

        Where links are is known a step later only: theirs is in the layer.
        """
        dynamics, gravity = self._masses.get(body.number), self._gravity.get(seen.client)
        if dynamics is None or gravity is None or body.hides_links:
            return
        if parts.shape[1] > 1 or len(dynamics["mass_kg"]) > 1:
            return
        shown = _shown(seen)
        mass_kg, inertia_kg_m2 = dynamics["mass_kg"][0], np.ravel(dynamics["inertia_kg_m2"])
        energies_j = energy_j(parts[shown, 0], mass_kg, inertia_kg_m2, gravity)
        if not np.isfinite(energies_j).all():
            return
        entity = f"{schema.ENERGIES}/{body.label}"
        if body.number not in self.energetic:
            self.energetic.add(body.number)
            yield pictures.curve_names(entity, [body.label])
        at = Times(seen.steps[shown], seen.times_s[shown])
        yield from self._curves.add(entity, at, energies_j[:, None])

    def _on_put(self, put: Put) -> Iterator[Chunk]:
        body, at = put.body, put.at
        values: dict[str, Any] = {name: put.states[name] for name in schema.STATES.columns}
        values |= {
            "joint_position": put.joints.position, "joint_velocity": put.joints.velocity,
            "joint_torque": put.joints.torque, "counts": put.counts,
        }  # fmt: skip
        yield from self._told(schema.SET, at, values)
        for number in range(len(put.states)):
            row = put.states[number : number + 1]
            yield from self._poses.add(part_path(body, number - 1), _at(at), row)

    def _on_appearance(self, seen: Appearance) -> Iterator[Chunk]:
        at, body = seen.at, seen.body
        self.bodies[body.number] = body
        values: dict[str, Any] = {
            "body": body.number, "there": seen.there, "came": seen.came,
            "sampled": seen.sampled,
            "engine_id": body.engine_id, "client": body.client,
            "name": body.name, "label": body.label,
            "links": list(body.links), "joints": [joint.name for joint in body.joints],
            "joint_kinds": [joint.kind for joint in body.joints],
            "joint_parents": np.array([joint.parent for joint in body.joints], np.int64),
            "joint_limits": np.array([joint.limits for joint in body.joints], np.float64),
            "joint_widths": np.array([joint.widths for joint in body.joints], np.int64),
            "joint_links": np.array([joint.link for joint in body.joints], np.int64),
            "moving": np.array(body.moving, np.int64), "soft": body.soft,
            "can_sleep": body.can_sleep, "hides_links": body.hides_links,
            "bounds_m": np.array(body.bounds_m, np.float64),
            "shape_kinds": [shape.kind for shape in body.shapes],
            "shape_files": [PurePath(shape.file).name for shape in body.shapes],
            "shape_links": np.array([shape.link for shape in body.shapes], np.int64),
            **{
                f"shape_{name}": np.array(
                    [getattr(shape, name) for shape in body.shapes], np.float64
                )
                for name in schema.SHAPE_NUMBERS
            },
        }  # fmt: skip
        yield from self._told(schema.BODIES, at, values)
        if not seen.there:
            # Of rows at the same time the last counts, so its last pose must come before this.
            yield from self._poses.flush()
            yield pictures.cleared(f"{schema.WORLD}/{body.label}", _at(at))
            self._drawn.pop(body.number, None)
            for key in [key for key in self._shown_at if key[0] == body.number]:
                del self._shown_at[key]
        elif self._drawn.get(body.number) != body.shapes:
            self._drawn[body.number] = body.shapes
            counts: dict[int, int] = {}
            for shape in body.shapes:
                number = counts[shape.link] = counts.get(shape.link, -1) + 1
                entity = f"{part_path(body, shape.link)}/{number}"
                drawn = [*pictures.shape(entity, _at(at), shape)]
                if not drawn:
                    self._undrawn[body.number] = body.label
                yield from drawn

    def _on_image(self, image: Image) -> Iterator[Chunk]:
        number = self.cameras.setdefault(image.camera, len(self.cameras))
        png = pictures.png(image.rgba)
        self._pictures.setdefault(number, FrameDigest()).update(image.at.step, png)
        self.frames += 1
        lens = (image.view, image.projection, image.rgba.shape)
        if self._lenses.get(number) != lens:
            self._lenses[number] = lens
            yield from pictures.camera(f"camera/{number}", _at(image.at), image)
        yield from self._images.add(f"camera/{number}/image", _at(image.at), png)

    def _on_call(self, call: Call) -> Iterator[Chunk]:
        values = {field.name: getattr(call, field.name) for field in fields(call)}
        del values["at"]
        yield from self._told(schema.CALLS, call.at, values)
        line = f"{call.function}({call.arguments})"
        if call.raised:
            line += f" raised {call.raised}"
        yield from self._log.add(
            schema.CALLS, _at(call.at), (f"{line}   {call.file}:{call.line}", bool(call.raised))
        )


def joint_rows(joints: Joints) -> NDArray[np.float64]:
    """Return all numbers of joints, a row per step, as they are digested."""
    steps = joints.steps[:, None].astype(np.float64)
    return np.hstack((steps, joints.position, joints.velocity, joints.torque))


def _shown(seen: Samples) -> NDArray[np.bool_]:
    """Return which samples are drawn in curves: at most `SHOWN_PER_S`, and the last."""
    due = np.floor(seen.times_s * SHOWN_PER_S + 1e-9).astype(np.int64)
    shown: NDArray[np.bool_] = np.diff(due, prepend=-1) > 0
    shown[-1] = True
    return shown


@np.errstate(over="ignore", invalid="ignore")  # of states that are not finite
def energy_j(
    states: Rows,
    mass_kg: float,
    inertia_kg_m2: NDArray[np.float64],
    gravity_m_s2: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the kinetic energy of a body without links, and its potential energy above the origin.

    In joules, shape (n,).

    Parameters
    ----------
    states
        Its states, of dtype `STATE`, shape (n,).
    mass_kg
        Its mass.
    inertia_kg_m2
        Its moments of inertia about the axes of the state, shape (3,).
    gravity_m_s2
        Shape (3,).
    """
    x, y, z, w = np.moveaxis(states["orientation"], -1, 0)
    axis = np.stack((x, y, z), axis=-1)
    spin = states["spin_rad_s"]
    # In the body's own axes: rotated by the inverse quaternion.
    twice = 2 * np.cross(spin, axis)
    own = spin + w[..., None] * twice + np.cross(twice, axis)
    moving_j = mass_kg * (states["velocity_m_s"] ** 2).sum(-1) / 2
    turning_j = (inertia_kg_m2 * own**2).sum(-1) / 2
    potential_j = -mass_kg * (states["position_m"] @ gravity_m_s2)
    total: NDArray[np.float64] = moving_j + turning_j + potential_j
    return total


def _at(at: At) -> Times:
    return Times(np.array([at.step]), np.array([at.time_s]), np.array([at.call]))


def _floats(values: Mapping[str, float | Sequence[float]]) -> dict[str, NDArray[np.float64]]:
    return {name: np.atleast_1d(np.asarray(value, np.float64)) for name, value in values.items()}


def part_path(body: Body, link: int) -> str:
    """Return the entity of a link in the scene; its shapes are below it, by number."""
    name = "base" if link < 0 else f"{link}_{body.links[link + 1]}"
    plain = "".join(
        letter if letter.isascii() and (letter.isalnum() or letter in "_-") else "_"
        for letter in name
    )
    return f"{schema.WORLD}/{body.label}/{plain}"


def _joint_names(body: Body, count: int) -> list[str]:
    names = [joint.name for joint in body.joints if any(joint.widths)]
    return names if len(names) == count else [f"{number}" for number in range(count)]


def about(script: Script, ending: Ending) -> str:
    """Return the recording's description as Markdown."""
    origin = script.origin
    call = " ".join([origin["script"], *(origin.get("arguments") or [])])
    rows = {
        "ended": f"{ending.how}{f': {ending.error}' if ending.error else ''}",
        "samples": f"{script.samples:,}",
        "bodies": ", ".join(body.label for body in list(script.bodies.values())[:30]) or "none",
        "camera frames": f"{script.frames:,}",
        "time": "virtual: sleeping passed at once" if ending.made_with.get("virtual_time")
        else "the script's own",
    }  # fmt: skip
    table = "\n".join(f"| {name} | {value} |" for name, value in rows.items())
    notes = "".join(f"\n- {note}" for note in ending.notes)
    return f"""# A script that uses PyBullet

`{call}`, recorded by drop: everything that happened in its simulations.

| | |
| --- | --- |
{table}
{notes}

## How to read it

- **World**: bodies as they were drawn; z up, metres.
- `state`: position, orientation and velocities of every part that can move, before each step and
  after the last, float64. `contacts`: the contact points of the step that led to the sample.
- `set/BODY`: where a call placed a body between two steps. `calls`: what the script did to the
  world, in order, with file and line.
- `sim_step` is the key; `sim_time` is the sum of the timesteps; `call` counts calls.
"""
