"""Reads a recording: converts Rerun's chunks to arrays, and checks them.

Samples, inputs and frames must match the digests in the closing property. A recording that fails a
check is damaged; the error gives the reason in one line.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drop_physics.engine_report import EngineReport
from drop_physics.errors import RecordingError
from drop_physics.messages import Message
from drop_physics.recording import columns, json_rows, rrd, schema
from drop_physics.recording.columns import Properties
from drop_physics.recording.contents import chunks_of, closing_of, gather
from drop_physics.recording.damage import damaged
from drop_physics.recording.digest import (
    Digests,
    RowsDigest,
    ToldDigest,
    closing_digest,
    inputs_digest,
)
from drop_physics.recording.inputs import Drop, check_inputs, drop_of
from drop_physics.recording.json_rows import Told
from drop_physics.recording.sampled import RecordedSamples, is_series
from drop_physics.recording.steps import RecordedModel, RecordedSteps
from drop_physics.recording.versions import lacking
from drop_physics.recording.whole_steps import last_whole_step
from drop_physics.scenario import Camera, Scenario
from drop_physics.trace.events import (
    Appearance,
    ArrayUse,
    At,
    Dynamics,
    EngineWarning,
    EpisodeEnd,
    Equality,
    ImpulseCause,
    Joint,
    PairFriction,
    Put,
    Raised,
    Sensor,
    Settings,
    Site,
    SolverStop,
    order,
)
from drop_physics.trace.history import DEFAULT_ENGINE, Seen
from drop_physics.trace.readings import Reading
from drop_physics.trace.states import in_step_order

if TYPE_CHECKING:
    import polars as pl


@dataclass(frozen=True)
class Recording:
    """The contents of a recording that was read and checked."""

    path: Path
    recording_id: str
    origin: Properties
    """The script, the digest of its text and its arguments; empty for a drop."""
    drop: Drop | None
    """Inputs of a drop; None for a script."""
    ended: Properties | None
    """How the run ended, with the versions that made it; None if the recording is unfinished."""
    seen: Seen
    sampled: RecordedSamples
    """Index of samples and images in the file."""
    steps: RecordedSteps
    """Index of models and frames in the file."""
    entities: frozenset[str]

    @property
    def partial(self) -> bool:
        """True if the recording was never finished.

        It then contains only the data written before an interruption.
        """
        return self.ended is None

    @property
    def lacks(self) -> Message | None:
        """Sentence on contents that older recordings lack; None for the current schema."""
        version = (self.ended or {}).get("schema_version", schema.SCHEMA_VERSION)
        replayed = self.seen.engine != DEFAULT_ENGINE
        what = lacking(version, of_drop=self.drop is not None, replayed=replayed)
        if what is None:
            return None
        return Message(
            "{path} is of schema {version}, which lacks {what}",
            path=str(self.path),
            version=version,
            what=what,
        )

    @property
    def origin_and_end(self) -> Properties:
        """Properties that name the script, its arguments, and how it ended."""
        ended = self.ended or {}
        digest = {name: ended[name] for name in ("script_sha256",) if name in ended}
        of_end = {name: ended.get(name) for name in ("ended", "error", "error_site")}
        return digest | self.origin | of_end

    @property
    def scenario(self) -> Scenario:
        """The scenario of a drop."""
        return self._of_drop.scenario

    @property
    def engine(self) -> EngineReport:
        """The engine's report on a drop."""
        return self._of_drop.engine

    @property
    def camera(self) -> Camera | None:
        """The camera of a drop."""
        return self._of_drop.camera

    @property
    def _of_drop(self) -> Drop:
        if self.drop is None:
            raise RecordingError("{path} must be the recording of a drop", path=self.path)
        return self.drop

    @cached_property
    def states(self) -> pl.DataFrame:
        """States as a table: one row per sample and part, sorted by step, body and link."""
        from drop_physics.trace.tables import table_of  # with Polars, which few need

        return table_of(in_step_order(self.seen.states))

    @property
    def contacts(self) -> pl.DataFrame:
        """Contact points as a table, one row per point, sorted by step."""
        from drop_physics.trace.tables import table_of

        return table_of(self.seen.contacts)


def read(path: Path) -> Recording:
    """Read a recording; only a file named `.part` may be unfinished."""
    held = contents(path)
    closing = closing_of(held.properties, path)
    check_inputs(held.properties, path)
    try:
        told = held.told
        if closing is None:
            told = _whole(told, held)
        seen = _seen(told, held.sampled, closing or {}, held.steps.models)
    except (KeyError, ValueError, TypeError, IndexError, AttributeError):
        what = Message("its bodies and calls are not in drop's format")
        raise damaged(path, what) from None
    if closing is not None:
        for name, digest in (digests(held) | {"closing": closing_digest(closing)}).items():
            if closing.get(f"{name}_sha256") != digest:
                raise damaged(path, Message("its section {name} fails its checksum", name=name))
    origin, drop = held.properties.get(schema.ORIGIN_PROPERTY, {}), None
    if not origin:
        drop = drop_of(held.properties, path)
        if schema.STATES.entity not in held.sampled.entities:
            raise damaged(path, Message("it has no state"))
    return Recording(
        path=path,
        recording_id=held.recording_id,
        origin=origin,
        drop=drop,
        ended=closing,
        seen=seen,
        sampled=held.sampled,
        steps=held.steps,
        entities=held.entities,
    )


@dataclass
class Contents:
    """Data of a recording from which results are computed."""

    recording_id: str
    texts: dict[str, list[tuple[At, str]]]
    """Rows of JSON by entity, in the order of steps and calls."""
    sampled: RecordedSamples
    steps: RecordedSteps
    made: Digests
    """Digests of the samples, in file order."""
    properties: dict[str, Properties]
    entities: frozenset[str]

    @cached_property
    def told(self) -> Told:
        """Parsed rows of JSON, by entity."""
        return {
            entity: [(at, json.loads(text)) for at, text in held]
            for entity, held in self.texts.items()
        }


def contents(path: Path) -> Contents:
    """Read a recording's chunks once: keep rows of JSON, and index the samples on disk.

    Raises
    ------
    RecordingError
        If the file is missing, damaged, or was not written by drop.
    """
    texts: dict[str, list[tuple[At, str]]] = {entity: [] for entity in schema.TOLD}
    properties: dict[str, Properties] = {}
    sampled, made = RecordedSamples(path), Digests()
    steps = RecordedSteps(sampled)
    recording_id = ""
    entities: set[str] = set()
    for chunk in chunks_of(path):
        recording_id, entity = chunk.recording_id, chunk.entity
        entities.add(entity)
        if entity in schema.TABLES:
            table = columns.rows(chunk, schema.TABLES[entity], path)
            sampled.add(chunk, table["step"])
            made.tables[entity].update(in_step_order(table))
        elif entity in texts:
            texts[entity] += columns.told(chunk, path)
        elif entity == schema.CALLS:
            sampled.add(chunk, columns.calls(chunk, path).steps)
        elif entity.startswith(f"{schema.IMPULSES}/"):
            acted = columns.impulses(chunk, path)
            sampled.add(chunk, acted.steps)
            made.add_impulses(acted)
        elif entity == schema.MODELS:
            for part in columns.model_parts(chunk, path):
                made.add_model(part.number, part.at, part.data)
                steps.add_model(chunk, part)
        elif entity == schema.STEPS:
            for number, row in enumerate(columns.steps(chunk, path)):
                made.add_steps(row)
                steps.add_frames(chunk, row, number)
        elif is_series(entity):
            if (read := columns.series(chunk, path)) is not None:
                sampled.add(chunk, read[0])
                made.add_series(entity, *read)
                if entity.startswith(f"{schema.CONSTRAINTS}/"):
                    made.add_holders(entity, read[0], columns.holders(chunk, path))
        elif entity == schema.IMAGE or entity.startswith("camera/"):
            sampled.add_picture(chunk)
        elif entity.startswith("__properties/"):
            gather(properties, chunk, path)
    for entity, held in texts.items():
        texts[entity] = sorted(dict.fromkeys(held), key=lambda row: order(row[0]))
    return Contents(recording_id, texts, sampled, steps, made, properties, frozenset(entities))


def digests(held: Contents) -> dict[str, Any]:
    """Return the digests of the data read, in the form in which the recording stores them."""
    inputs = {name: held.properties.get(name) for name in schema.INPUT_PROPERTIES}
    tables = {entity: digest.hexdigest() for entity, digest in held.made.tables.items()}
    if schema.ORIGIN_PROPERTY not in held.properties:
        # Of one simulation: its rows have one order, whatever a tool made of it.
        for entity in schema.TABLES:
            found = held.sampled.entities.get(entity)
            if found is not None and not found.in_order:
                whole = RowsDigest()
                whole.update(held.sampled.table(entity, held.sampled.first, held.sampled.last + 1))
                tables[entity] = whole.hexdigest()
    return {
        **tables,
        "told": _told_digest(held.texts),
        "series": _listed(held.made.series),
        "calls": _calls_digests(held),
        "impulses": _listed(held.made.impulses),
        "models": held.made.models,
        "steps": held.made.steps,
        "inputs": inputs_digest({name: held for name, held in inputs.items() if held is not None}),
    }


def _seen(
    told: Told,
    sampled: RecordedSamples,
    closing: Properties,
    models: Mapping[int, RecordedModel],
) -> Seen:
    appearances = json_rows.events(told, Appearance)
    bodies = json_rows.bodies_of(appearances)
    sampled.sites = _sites(told)
    sampled.raised = json_rows.events(told, Raised)
    sampled.appearances = appearances
    sampled.numbers = {
        body.label: number for number, body in bodies.items() if any(map(_moves, body.joints))
    }
    pairs = {
        (event.body_a, event.link_a, event.body_b, event.link_b): event
        for event in json_rows.events(told, PairFriction)
    }
    causes = {event.number: event for event in json_rows.events(told, ImpulseCause)}
    sampled.causes = causes
    return Seen(
        bodies=bodies,
        appearances=appearances,
        surfaces=json_rows.surfaces(told),
        dynamics=json_rows.events(told, Dynamics, bodies),
        settings=json_rows.events(told, Settings),
        solvers=json_rows.events(told, SolverStop),
        readings=json_rows.events(told, Reading),
        puts=json_rows.events(told, Put, bodies),
        samples=dict(enumerate(listed(closing.get("samples_of_clients")))),
        sampled=sampled,
        real_time=bool(closing.get("made_with_real_time", False)),
        unseeded=tuple(listed(closing.get("made_with_unseeded"))),
        machine=str(closing.get("made_with_machine", "")),
        causes=causes,
        frictions={key: pair.friction for key, pair in pairs.items()},
        softness={key: (pair.solref, pair.solimp) for key, pair in pairs.items() if pair.solref},
        condims={key: (pair.condim, pair.rolling) for key, pair in pairs.items()},
        can_replay=bool(models),
        warnings=json_rows.events(told, EngineWarning),
        equalities=json_rows.events(told, Equality),
        episode_ends=json_rows.events(told, EpisodeEnd),
        sensors=json_rows.events(told, Sensor),
        array_uses=json_rows.events(told, ArrayUse),
    )


def _whole(told: Told, held: Contents) -> Told:
    """Drop the rows of an unfinished recording's last, incomplete step."""
    held.sampled.sites = _sites(told)
    engines = [event.engine for event in json_rows.events(told, Settings)]
    last = last_whole_step(
        held.sampled,
        held.steps,
        json_rows.events(told, Appearance),
        efforts=not any(engines),  # PyBullet, which is not named, reports them
    )
    held.sampled.whole = last
    return {
        entity: [(at, values) for at, values in rows if at.step <= max(last, 0)]
        for entity, rows in told.items()
    }


def _sites(told: Told) -> dict[int, Site]:
    """Return the script lines that call the engine, by index."""
    return {site.number: site for site in json_rows.events(told, Site)}


def _moves(joint: Joint) -> bool:
    return any(joint.widths)


def listed(value: Any) -> list[Any]:  # noqa: ANN401 - a list of one is read as its element
    """Return a property's value as a list."""
    return [] if value is None else value if isinstance(value, list) else [value]


def _listed(values: list[str] | None) -> str | list[str] | None:
    """Return texts as a property stores them: a single text instead of a list with one."""
    return values[0] if values is not None and len(values) == 1 else values


def _told_digest(texts: Mapping[str, list[tuple[At, str]]]) -> str:
    digest = ToldDigest()
    for entity, held in texts.items():
        for at, text in held:
            digest.update(entity, at.step, at.call, text)
    return digest.hexdigest()


def _calls_digests(held: Contents) -> str | list[str] | None:
    sites = _sites(held.told)
    sampled, made = held.sampled, Digests()
    for chunk in sampled.chunks(schema.CALLS, 0, sampled.last + 1):
        made.add_calls(columns.calls(chunk, sampled.path), sites)
    return _listed(made.calls)


def recording_id(path: Path) -> str:
    """Return the recording id of a recording or layer.

    Raises
    ------
    RecordingError
        If the file is missing, damaged, or was not written by drop.
    """
    for chunk in chunks_of(path):
        return chunk.recording_id
    raise damaged(path, Message("it is empty"))


def is_recording(path: Path, *, of_script: bool = False) -> bool:
    """Return whether a file is one recording made by `drop`, of a drop or of a script.

    Unfinished recordings and those of an older schema count, too.
    """
    kind = schema.ORIGIN_PROPERTY if of_script else schema.SCENARIO_PROPERTY
    is_kind, ids = False, set()
    try:
        for chunk in rrd.chunks(path, unfinished=True):
            if chunk.application_id != schema.APPLICATION_ID:
                return False
            ids.add(chunk.recording_id)
            is_kind |= chunk.entity == f"__properties/{kind}"
    except (rrd.DamagedError, OSError):
        return False
    return is_kind and len(ids) == 1


def entities(path: Path) -> Iterator[str]:
    """Yield the entity of each chunk in a recording or layer.

    Raises
    ------
    RecordingError
        If the file is missing, damaged, or was not written by drop.
    """
    return (chunk.entity for chunk in chunks_of(path))
