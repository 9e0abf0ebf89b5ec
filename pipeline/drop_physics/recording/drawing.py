"""Writes the parts of a recording that the viewer shows: shapes, poses, curves, images, calls.

No number is computed from these parts. Poses and curves are thinned to as many as a viewer can
show.
"""

from __future__ import annotations

import itertools
from collections.abc import Hashable, Iterable, Iterator, Mapping

import numpy as np
from rich.filesize import decimal

from drop_physics.arrays import Float64, Int64
from drop_physics.fields import all_of
from drop_physics.messages import Message
from drop_physics.physics.tree import Tree
from drop_physics.recording import pictures, schema, writer
from drop_physics.recording.gathering import Gathering
from drop_physics.recording.writer import Chunk, Times, scalars_chunk
from drop_physics.trace.calls import text_of
from drop_physics.trace.events import (
    Appearance,
    Body,
    Calls,
    Collision,
    ContactRows,
    Dynamics,
    Event,
    Image,
    Put,
    Raised,
    Samples,
    Settings,
    Shape,
    Site,
)
from drop_physics.trace.poses import inertial_frames, links_of, tree_of, within
from drop_physics.trace.states import BASE, Joints

POSES_TOGETHER, IMAGES_TOGETHER, LINES_TOGETHER = 1 << 16, 32, 1024
"""Number of rows that are buffered before they are written as a chunk: poses, images and log lines.
"""
PUT_TOGETHER = 1024
"""Number of states set by calls whose poses are computed at once."""
MOST_TRAILS, TRAIL_PER_S, TRAIL_M = 6, 20, 1e-3
"""Largest number of bodies whose path is drawn; points of a path per second, and smallest distance
between them [m]."""
DEEPEST = 64
"""Largest number of nested links of a chain; a deeper link is attached to the base in the scene."""
LONGEST_PART = 60
"""Largest number of characters of a link's name in an entity path: a path of `DEEPEST` such names
fits in `rrd.LONGEST_NAME`."""
ARROW = 1 / 3
"""Length of an arrow for the weight of the heaviest body, as a share of the scene's diagonal; no
arrow is longer than twice that."""
FARTHEST_M = 10.0
"""Distance from its start position beyond which a body is ignored when the view is chosen [m]."""
SHOWN_PER_S = 60
"""Poses drawn per second of simulated time."""
SLOWER = 4
"""Playback slowdown of a drop: how many times slower than real time."""
MOST_LINES = 20
"""Largest number of calls listed for each call site."""


class Drawing:
    """Writes the viewer's data for all bodies of a recording."""

    def __init__(self, bodies: Mapping[int, Body], *, of_drop: bool = False) -> None:
        self._bodies, self._of_drop = bodies, of_drop
        self.low_m = self.high_m = np.zeros(3)
        """Corners of the bounding box of all motion, without bodies that flew away."""
        self._first_m: Float64 | None = None
        self._bases: dict[int, Float64] = {}
        """States of bases that have no samples because no step moves them, by body id."""
        self._put: dict[int, list[Put]] = {}
        """States set by calls whose poses are not drawn yet, by body id."""
        self._trees: dict[int, Tree] = {}
        self._masses: dict[int, Mapping[str, Float64]] = {}
        self._gravity: dict[int, Float64] = {}
        self._poses = Gathering(pictures.poses, most=POSES_TOGETHER)
        self._curves = Gathering(
            lambda entity, at, parts: scalars_chunk(entity, at, np.concatenate(parts)),
            most=POSES_TOGETHER,
        )
        self._trails = Gathering(pictures.trail, most=POSES_TOGETHER)
        self._ways: dict[int, tuple[int, Float64]] = {}
        """Last point of each body's path, by body id: step, and position [m]."""
        self._touching = False
        self._images = Gathering(pictures.images, most=IMAGES_TOGETHER)
        self._log = Gathering(pictures.log, most=LINES_TOGETHER)
        self._lenses: dict[int, object] = {}
        self._shown_at: dict[int, int] = {}
        self._placed: dict[str, Float64] = {}
        """Last pose of each link, by entity, in units of `POSE_RESOLUTION`."""
        self._drawn: dict[int, tuple[Shape, ...]] = {}
        self._gone: dict[int, tuple[Times, Body]] = {}
        """Bodies removed since the last sample, with the time of removal, by body id."""
        self._undrawn: dict[int, str] = {}
        """Labels of bodies that have a shape which cannot be drawn, by body id."""
        self._listed: dict[int, int] = {}
        """Number of calls listed so far, by call site."""

    def scene(self) -> Iterator[Chunk]:
        """Yield the parts of the 3-D scene that never change."""
        yield pictures.scene()

    def flush(self) -> Iterator[Chunk]:
        """Yield all buffered rows as chunks."""
        yield from self._draw_put()
        yield from self._clear()
        for gathered in (self._log, self._poses, self._trails, self._curves, self._images):
            yield from gathered.flush()

    def notes(self) -> Iterator[Message]:
        """Yield warnings about bodies and paths that are not drawn."""
        for body in self._bodies.values():
            if body.soft:
                yield Message(
                    "the soft body {body} is left out: PyBullet does not report its position",
                    body=body.label,
                )
        if self._undrawn:
            labels, more = [*self._undrawn.values()][:3], len(self._undrawn) - 3
            if more > 0:
                labels.append(Message("{count} more", count=more))
            yield Message(
                "a shape of {bodies} is not drawn: drop draws boxes, spheres, cylinders, "
                "capsules whose direction is known, planes, and meshes from files of up to "
                "{size}",
                bodies=all_of(labels),
                size=decimal(pictures.LARGEST_MESH_BYTES),
            )

    def on(self, event: Event) -> Iterator[Chunk]:
        """Yield the viewer's chunks for an event other than samples, calls and images."""
        match event:
            case Appearance():
                yield from self._draw_put()
                yield from self.on_appearance(event)
            case Put():
                yield from self.on_put(event)
            case Raised():
                yield from self.on_raised(event)
            case Dynamics(_, body, reported):
                yield from self._draw_put()
                self._masses[body.number] = reported
                self._trees[body.number] = tree_of(body.joints, inertial_frames(reported))
            case Settings(_, client, values):
                axes = [values[f"gravityAcceleration{axis}"] for axis in "XYZ"]
                self._gravity[client] = np.concatenate([np.atleast_1d(axis) for axis in axes])

    # -- bodies -----------------------------------------------------------------------------------

    def on_appearance(self, seen: Appearance) -> Iterator[Chunk]:
        """Yield the shapes of a new body, or the removal of a deleted one."""
        at, body = writer.times_of(seen.at), seen.body
        if not seen.there:
            self._gone[body.number] = at, body
            return
        if (gone := self._gone.get(body.number)) is not None:
            if _same_shapes(gone[1], body):  # another takes its place before time goes on
                del self._gone[body.number]
            else:
                yield from self._clear()
        if body.number not in self._drawn:
            for number, touched in enumerate(body.collisions):
                if any(_looks_alike(shape, touched) for shape in body.shapes):
                    continue
                link = part_path(body, touched.link)
                entity = f"{schema.COLLISIONS}{link.removeprefix(schema.WORLD)}/{number}"
                yield from pictures.collision(entity, at, link, touched)
        before, counts = self._drawn.get(body.number, ()), dict[int, int]()
        self._drawn[body.number] = body.shapes
        for shape, was in itertools.zip_longest(body.shapes, before[: len(body.shapes)]):
            number = counts[shape.link] = counts.get(shape.link, -1) + 1
            if shape == was:
                continue
            entity = f"{part_path(body, shape.link)}/{number}"
            drawn = [*pictures.shape(entity, at, shape, was)]
            if not drawn:
                self._undrawn[body.number] = body.label
            yield from drawn

    def _clear(self) -> Iterator[Chunk]:
        """Yield chunks that remove bodies from the view once they no longer exist."""
        gone, self._gone = self._gone, {}
        if gone:
            # Of rows at the same time the last counts, so their last poses must come before this.
            yield from self._poses.flush()
        for at, body in gone.values():
            yield pictures.cleared(f"{schema.WORLD}/{body.label}", at)
            if body.collisions:
                yield pictures.cleared(f"{schema.COLLISIONS}/{body.label}", at)
            self._drawn.pop(body.number, None)
            self._shown_at.pop(body.number, None)
            for link in range(-1, len(body.joints)):
                self._placed.pop(part_path(body, link), None)

    def on_put(self, put: Put) -> Iterator[Chunk]:
        """Keep a state that a call has set; yield the poses once there are many."""
        number = put.body.number
        self._bases[number] = put.base
        if number in self._trees:
            self._put.setdefault(number, []).append(put)
            if len(self._put[number]) >= PUT_TOGETHER:
                yield from self._draw_put()

    def _draw_put(self) -> Iterator[Chunk]:
        """Yield the poses of the bodies that calls have placed since they were last drawn."""
        held, self._put = self._put, {}
        for number, puts in held.items():
            at = Times(
                np.array([put.at.step for put in puts]),
                np.array([put.at.time_s for put in puts]),
                np.array([put.at.call for put in puts]),
            )
            joints = Joints(
                at.steps,
                at.times_s,
                np.array([put.position for put in puts]),
                np.array([put.velocity for put in puts]),
                np.array([put.effort for put in puts]),
            )
            bases = np.array([put.base for put in puts])
            parts = links_of(self._trees[number], bases, joints)
            yield from self._place(at, poses_in_tree(puts[0].body, parts))

    # -- samples ----------------------------------------------------------------------------------

    def on_samples(self, seen: Samples) -> Iterator[Chunk]:
        """Yield poses and curves, at most `SHOWN_PER_S` per second, and the last."""
        yield from self._draw_put()
        yield from self._clear()
        per_s = SHOWN_PER_S * (SLOWER if self._of_drop else 1)
        due = np.floor(seen.times_s * per_s + 1e-9).astype(np.int64)
        alike: dict[Hashable, list[int]] = {}
        for number in sorted({*seen.bases, *seen.joints}):
            alone = number if self._bodies[number].joints else None
            alike.setdefault((self._shown_at.get(number, -1), alone), []).append(number)
        for numbers in alike.values():
            yield from self._on_states(seen, numbers, due)
        if not self._of_drop:
            yield from self._points(seen)

    def _on_states(self, seen: Samples, numbers: list[int], due: Int64) -> Iterator[Chunk]:
        """Yield poses and curves of a body, or of jointless bodies drawn at the same times."""
        bodies = [self._bodies[number] for number in numbers]
        first = numbers[0]
        shown = np.diff(due, prepend=self._shown_at.get(first, -1)) > 0
        shown[-1] = True
        at = Times(seen.steps[shown], seen.times_s[shown], np.full(shown.sum(), seen.call))
        if first in seen.bases:
            drawn = np.array([seen.bases[number][shown] for number in numbers])
        elif first in self._bases:
            drawn = np.tile(self._bases[first], (1, len(at.steps), 1))
        else:
            return
        self._shown_at.update(dict.fromkeys(numbers, int(due[-1])))
        if bodies[0].joints:
            joints = seen.joints.get(first)
            parts = links_of(self._trees[first], drawn[0], joints and joints.at(shown))[None]
        else:
            parts = drawn[:, :, None]
        poses = [poses_in_tree(*each) for each in zip(bodies, parts, strict=True)]
        yield from self._place(at, itertools.chain(*poses))
        for some in (parts[:1], parts):  # from the first, it is measured what has flown off
            self._reach(some[..., :3].reshape(-1, 3))
        if self._of_drop:
            return
        if len(self._bodies) <= MOST_TRAILS + 1:
            for body, its in zip(bodies, parts, strict=True):
                yield from self._trail(body, at, its[:, _end_of(body), :3])
        if not bodies[0].joints:
            heights_m = drawn[:, :, 2:3]
            kept = writer.noticed(heights_m, schema.POSE_RESOLUTION)
            for body, its, rows in zip(bodies, heights_m, kept, strict=True):
                entity = f"{schema.HEIGHT}/{body.label}"
                yield from self._curves.add(entity, at.only(rows), its[rows])

    def _place(self, at: Times, placed: Iterable[tuple[str, Float64]]) -> Iterator[Chunk]:
        """Yield the poses of bodies and links that have changed, by entity path."""
        entities, poses = zip(*placed, strict=True)
        rows = np.array(poses)
        shown = np.round(rows / schema.POSE_RESOLUTION)
        before = np.array([self._placed.get(entity, np.full(7, np.nan)) for entity in entities])
        changed = (np.concatenate((before[:, None], shown[:, :-1]), axis=1) != shown).any(axis=2)
        self._placed.update(zip(entities, shown[:, -1].copy(), strict=True))
        for number in np.flatnonzero(changed.any(axis=1)).tolist():
            its = changed[number]
            yield from self._poses.add(entities[number], at.only(its), rows[number, its])

    def _reach(self, positions_m: Float64) -> None:
        """Extend the scene's bounding box by positions, shape (n, 3), unless a body flew away."""
        positions_m = positions_m[np.isfinite(positions_m).all(axis=1)]
        if not len(positions_m):
            return
        if self._first_m is None:
            self._first_m = self.low_m = self.high_m = np.median(positions_m, axis=0)
        near_m = positions_m[np.abs(positions_m - self._first_m).max(axis=1) < FARTHEST_M]
        if len(near_m):
            self.low_m = np.minimum(self.low_m, near_m.min(axis=0))
            self.high_m = np.maximum(self.high_m, near_m.max(axis=0))

    def _trail(self, body: Body, at: Times, places_m: Float64) -> Iterator[Chunk]:
        """Yield the path of a body's base or, if the base is fixed, of its last link."""
        entity = f"{schema.WORLD}/{body.label}/trail"
        if body.number not in self._ways:
            yield pictures.trail_style(entity)
        last, there_m = self._ways.get(body.number, (-1, np.full(3, np.inf)))
        due = np.floor(at.times_s * TRAIL_PER_S + 1e-9).astype(np.int64)
        shown = np.flatnonzero(np.diff(due, prepend=last) > 0)
        before_m = np.vstack([there_m, places_m[shown]])[:-1]
        shown = shown[~(np.abs(places_m[shown] - before_m).max(axis=1) < TRAIL_M)]
        if len(shown):
            self._ways[body.number] = int(due[shown[-1]]), places_m[shown[-1]]
            yield from self._trails.add(entity, at.only(shown), places_m[shown])

    def _points(self, seen: Samples) -> Iterator[Chunk]:
        """Yield contact points, and the contact forces as arrows."""
        due = np.diff(np.floor(seen.times_s * SHOWN_PER_S + 1e-9), prepend=-1.0) > 0
        due[-1] = True
        points = seen.contacts
        points = points[due[np.searchsorted(seen.steps, points["step"])]]
        if len(points) and not self._touching:
            yield pictures.contact_style(schema.CONTACT_POINTS)
        if len(points) or self._touching:
            moves = np.array(
                [body.number for body in self._bodies.values() if body.base_moves or body.moving],
                np.int64,
            )
            on_a = np.isin(points["body_a"], moves)
            forces_n = points["normal_force_n"][:, None] * points["normal"]
            for name in ("friction_1", "friction_2"):
                forces_n = forces_n + points[f"{name}_n"][:, None] * points[f"{name}_direction"]
            forces_n = np.where(on_a[:, None], forces_n, -forces_n)
            places_m = np.where(on_a[:, None], points["position_a_m"], points["position_b_m"])
            longest_m, m_per_n = self._arrows(seen.client)
            arrows_m = forces_n * m_per_n
            lengths_m = np.linalg.norm(arrows_m, axis=1, keepdims=True)
            arrows_m *= np.minimum(1.0, longest_m / np.maximum(lengths_m, longest_m))
            at = Times(seen.steps[due], seen.times_s[due], np.full(due.sum(), seen.call))
            counts = np.diff(np.searchsorted(points["step"], [*at.steps, at.steps[-1] + 1]))
            if len(set(counts.tolist())) == 1:  # the same points, perhaps at rest
                seen_as = np.hstack((places_m, arrows_m)).reshape(len(counts), -1)
                kept = writer.noticed(seen_as, schema.POSE_RESOLUTION)
                its = np.repeat(kept, counts)
                at, counts, places_m, arrows_m = (
                    at.only(kept),
                    counts[kept],
                    places_m[its],
                    arrows_m[its],
                )
            yield pictures.contact_points(schema.CONTACT_POINTS, at, places_m, arrows_m, counts)
            self._touching = True

    def on_touching(self, seen: ContactRows) -> Iterator[Chunk]:
        """Yield the contact points of samples whose poses have been drawn."""
        if len(seen.steps):
            empty: dict[int, Float64] = {}
            samples = Samples(
                seen.client, seen.steps, seen.times_s, 0, empty, {}, seen.contacts, {}
            )
            yield from self._points(samples)

    def _arrows(self, client: int) -> tuple[float, float]:
        """Return the length of the longest arrow [m], and the scale in metres per newton."""
        masses_kg = {
            number: float(np.nansum(self._masses[number]["mass_kg"]))
            for number, body in self._bodies.items()
            if body.moving and number in self._masses
        }
        heaviest = max(masses_kg, key=lambda number: masses_kg[number], default=None)
        gravity = float(np.linalg.norm(self._gravity.get(client, np.zeros(3)))) or 9.81
        if heaviest is None or not masses_kg[heaviest]:
            return 1.0, 1.0
        boxes_m = np.reshape(self._bodies[heaviest].bounds_m, (-1, 6))
        size_m = ARROW * float(
            np.linalg.norm(
                boxes_m[:, 3:].max(axis=0, initial=0.1) - boxes_m[:, :3].min(axis=0, initial=-0.1)
            )
        )
        return 2 * size_m, size_m / (masses_kg[heaviest] * gravity)

    # -- pictures and calls -----------------------------------------------------------------------

    def on_image(self, number: int, image: Image, png: bytes) -> Iterator[Chunk]:
        """Yield a camera's image, and the camera's pose if it has changed."""
        lens = (image.view, image.projection, image.rgba.shape)
        if self._lenses.get(number) != lens:
            self._lenses[number] = lens
            yield from pictures.camera(f"camera/{number}", writer.times_of(image.at), image)
        yield from self._images.add(f"camera/{number}/image", writer.times_of(image.at), png)

    def on_calls(self, seen: Calls, sites: Mapping[int, Site], widths: Int64) -> Iterator[Chunk]:
        """Yield the first calls from each script line as text."""
        ends = np.cumsum([0, *widths]).tolist()
        full = [number for number, count in self._listed.items() if count >= MOST_LINES]
        for place in np.flatnonzero(~np.isin(seen.sites, full)).tolist():
            number = int(seen.sites[place])
            count = self._listed[number] = self._listed.get(number, 0) + 1
            if count > MOST_LINES:
                continue
            site = sites[number]
            numbers = seen.numbers[ends[place] : ends[place + 1]].tolist()
            line = f"{site.function}({text_of(site, numbers)})   {site.place}"
            if count == MOST_LINES:
                line += "   (later calls from here are not listed)"
            rows = slice(place, place + 1)
            at = Times(seen.steps[rows], seen.times_s[rows], seen.calls[rows])
            yield from self._log.add(schema.LOG, at, (line, False))

    def on_raised(self, seen: Raised) -> Iterator[Chunk]:
        """Yield the error that a call raised."""
        yield from self._log.add(
            schema.LOG, writer.times_of(seen.at), (f"raised {seen.error}", True)
        )


def _same_shapes(gone: Body, came: Body) -> bool:
    """Return whether two bodies have the same drawn shapes in the same pose."""
    return (gone.label, gone.shapes, gone.collisions) == (
        came.label,
        came.shapes,
        came.collisions,
    ) and gone.joints == came.joints


def _looks_alike(shape: Shape, touched: Collision) -> bool:
    """Return whether a collision shape looks the same as the visible shape."""
    if (shape.link, shape.kind) != (touched.link, touched.kind) or shape.kind == "mesh":
        return False
    return all(
        np.allclose(getattr(shape, name), getattr(touched, name), atol=1e-6)
        for name in ("size_m", "position_m", "orientation")
    )


def part_path(body: Body, link: int) -> str:
    """Return a link's entity path in the scene: below its parent's, since poses are relative.

    The paths of the link's shapes are below this path, by number.
    """
    names = [_plain(f"{each}_{body.links[each + 1]}") for each in _line_to(body, link)]
    return "/".join([schema.WORLD, body.label, "base", *names])


def _line_to(body: Body, link: int) -> list[int]:
    """Return the chain of links from the base to a link, including it; empty for the base.

    A link with more than `DEEPEST` ancestors is drawn as a child of the base, since Rerun limits
    the length of a name.
    """
    line = list[int]()
    while link >= 0:
        line.append(link)
        link = body.joints[link].parent
    return line[::-1] if len(line) <= DEEPEST else line[:1]


def _plain(name: str) -> str:
    return "".join(
        letter if letter.isascii() and (letter.isalnum() or letter in "_-") else "_"
        for letter in name[:LONGEST_PART]
    )


def poses_in_tree(body: Body, parts: Float64) -> Iterator[tuple[str, Float64]]:
    """Yield the entities of base and links, with poses relative to their parents, shape (n, 7).

    `parts` are poses in the world, shape (n, links + 1, 7 or more).
    """
    for column in range(parts.shape[1]):
        poses = parts[:, column, :7]
        if column:
            above = (BASE, *_line_to(body, column - 1))[-2]
            poses = within(parts[:, above + 1, :7], poses)
        yield part_path(body, column - 1), poses


def _end_of(body: Body) -> int:
    """Return the link whose path is drawn: 0 for the base, or a fixed body's last link."""
    depths = [0]
    for joint in body.joints:
        depths.append(depths[joint.parent + 1] + 1)
    return 0 if body.base_moves else int(np.argmax(depths))
