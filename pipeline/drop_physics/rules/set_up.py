"""Rules about the setup of a simulation: timestep, stepping, randomness."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from drop_physics.account.touches import TouchTable
from drop_physics.explain.times import StepTimes
from drop_physics.fields import fraction
from drop_physics.messages import Message
from drop_physics.physics.laws.lookup import RIGID
from drop_physics.physics.tree import RATES
from drop_physics.rules.answer import Span
from drop_physics.rules.body_properties import AskedOfBodies
from drop_physics.rules.engines import ANY, MUJOCO, MUJOCOS, engine_of
from drop_physics.rules.inputs import Inputs
from drop_physics.rules.rows import Case, Remedy, SayingRow
from drop_physics.rules.rule import input_rule
from drop_physics.rules.thresholds import TIPS_RAD
from drop_physics.trace.acts import PUSHES, SETS_TIMESTEP, Act
from drop_physics.trace.history import Seen

WAITS = Act.COMMAND, Act.CONSTRAIN, *PUSHES
"""Functions that take effect only in a step."""


@input_rule("not-stepped", "asked", engines=ANY)
def not_stepped(inputs: Inputs, seen: Seen, origin: Mapping[str, Any]) -> Iterator[Case]:
    """A script commands a simulation or recomputes its data, but makes no step."""
    if origin.get("ended") == "failed":
        return
    if engine_of(seen) == MUJOCO and not seen.samples:
        yield Case()
    stepped = any(samples > 1 for samples in seen.samples.values())
    uses = [*inputs.of(*WAITS)], [*inputs.of(Act.SET_GRAVITY)]
    placed = {use.first.client for use in inputs.of(Act.SET_POSE, Act.SET_JOINT)}
    for client, samples in seen.samples.items():
        waits, falls = (
            next((use.first for use in its if use.first.client == client), None) for its in uses
        )
        call = waits or (None if stepped and client in placed else falls)
        there = any(body.moving for body in seen.bodies.values() if body.client == client)
        if samples == 1 and call is not None and there:
            told = {"client": client, "stepped": stepped, "waits": waits is not None}
            yield Case(call=call, values=told)


NEVER = Message(
    "simulation {client} is never stepped, so nothing in it moves by itself: time passes only in "
    "p.stepSimulation()"
)
IN_A_LOOP = Message("call p.stepSimulation(physicsClientId={client}) in a loop")
not_stepped.rows(
    SayingRow(
        engines=MUJOCOS,
        says=Message(
            "nothing is ever stepped, so nothing moves by itself: mj_forward and mj_step1 only "
            "compute what depends on the state, and time passes in mj_step, or mj_step2"
        ),
        advice=Message("call mujoco.mj_step(model, data) in a loop"),
        share=1.0,
    ),
    SayingRow(
        when=lambda stepped: not stepped, advice=Message("call p.stepSimulation() in a loop")
    ),
    SayingRow(when=lambda waits: waits, advice=IN_A_LOOP),
    # Beside one that is stepped, poses may only be looked at in one with gravity, most of all where
    # calls place what is in it.
    SayingRow(advice=IN_A_LOOP, level="note"),
    like=SayingRow(says=NEVER),
)


@input_rule("free-base", "model", proposes=True)
def free_base(inputs: Inputs, seen: Seen, asked: AskedOfBodies) -> Iterator[Case]:
    """An arm loaded without `useFixedBase` stands on its base, and tips over."""
    for number, life in inputs.first_lives.items():
        body, tree = seen.bodies[number], life.tree
        load, commanded = asked.load(body), inputs.commanded.get(number)
        movable = {link for link, joint in enumerate(tree.joints) if RATES[joint]}
        # What moves first, from the base on: an arm has one such joint, wheels and legs several.
        roots = [link for link in movable if {*tree.branch(link)} & movable == {link}]
        arm = len(roots) == 1 and len(movable) > 1 and not tree.fixed and not life.held
        stands = any(number in pair for pair in inputs.touched)
        loaded = load is not None and load.act is Act.LOAD
        if loaded and commanded and arm and stands and life.tilt_rad > TIPS_RAD:
            yield Case(call=load, subject=body, values={"tilt": life.tilt_rad})


free_base.rows(
    SayingRow(
        says=Message(
            "{body} tips over by {tilt:.2g} rad: it stands on its base, which is free to move"
        ),
        advice=Message("load it with p.loadURDF(…, useFixedBase=True)"),
        effect="tilt",
        unit="rad",
        share="tilt",
    )
)


@input_rule("timestep-changed", "model", engines=ANY)
def timestep_changed(inputs: Inputs, seen: Seen, times: Mapping[int, StepTimes]) -> Iterator[Case]:
    """The timestep changes while motors, constraints or gains depend on it."""
    is_mujoco = engine_of(seen) == MUJOCO
    for client, its in times.items():
        keeps = [
            life
            for (number, _), life in inputs.lives.items()
            if (body := seen.bodies[number]).client == client
            if is_mujoco or life.held or any(joint.widths[1] for joint in body.joints)
        ]
        changes = [
            change
            for change in its.changes
            if any(life.first <= change[0] < life.last for life in keeps)
        ]
        constants_s = [
            solref[0]
            for bodies, (solref, _) in seen.softness.items()
            if seen.bodies[bodies[0]].client == client
        ]
        if is_mujoco:  # whose contacts alone go by it, where it is too long for them
            changes = [
                each for each in changes if any(0 < s < 2 * max(each[1:]) for s in constants_s)
            ]
        if not changes:
            continue
        (step, *around_s), count = changes[0], len(changes)
        uses = [use for at, use in inputs.made(client, *SETS_TIMESTEP) if at.step == step]
        ratio = max(around_s) / max(min(around_s), 1e-300)
        yield Case(
            call=uses[-1].first if uses else None,
            span=Span(step, changes[-1][0], count),
            values={
                "function": Act.SET_TIMESTEP.value[-1],
                "before": fraction(around_s[0]),
                "after": fraction(around_s[1]),
                "step": step,
                "more": Message(" (the first of {n:,} changes)", n=count) if count > 1 else "",
                "least": 2 * max(around_s),
                "constant": min((each for each in constants_s if each > 0), default=0.0),
                "ratio": ratio,
            },
        )


timestep_changed.rows(
    SayingRow(
        engines=MUJOCOS,
        says=Message(
            "the timestep changes from {before} s to {after} s at step {step:,}{more}: MuJoCo "
            "makes no contact stiffer than a time constant of 2 steps, {least:g} s with the "
            "longer, and solref gives one {constant:g} s"
        ),
        advice=Message("one timestep for the whole run, at most half of that time constant"),
        cure=Remedy("without", given={"function": "function"}),
    ),
    SayingRow(
        says=Message(
            "the timestep changes from {before} s to {after} s at step {step:,}{more}: motors "
            "and constraints keep force × timestep of their call, and a position motor closes "
            "a share of its gap per step"
        ),
        cure=Remedy("timestep-first"),
    ),
    like=SayingRow(effect="ratio", unit="1", share="ratio"),
)


@input_rule("real-time", "repeat")
def real_time(inputs: Inputs, seen: Seen) -> Iterator[Case]:
    """The number of steps depends on the speed of the machine."""
    for use in inputs.of(Act.SET_REAL_TIME) if seen.real_time else ():
        told = use.high.get("enableRealTimeSimulation", ("True" in use.first.arguments,))
        if told[0]:
            yield Case(call=use.first)
            return


real_time.rows(
    SayingRow(
        says=Message(
            "the script asks for real-time simulation, in which the number of steps depends on how "
            "fast the machine is; here its own clock decides it"
        ),
        advice=Message("call p.stepSimulation() instead, as often as there are steps"),
    )
)


@input_rule("unseeded", "repeat", engines=ANY)
def unseeded(seen: Seen) -> Iterator[Case]:
    """Another run draws different random numbers, since the script sets no seed."""
    places = seen.unseeded
    for place in places[:1]:
        where: str = place
        if len(places) > 1:
            where = Message(
                "{place} (the first of {places} places)", place=place, places=len(places)
            )
        yield Case(site=place.rpartition(" at ")[2] or None, values={"where": where})


unseeded.rows(
    SayingRow(
        says=Message("unseeded random numbers are drawn by {where}"),
        advice=Message("seed them in the script, or record it with --seed 0"),
    )
)


@input_rule("massless", "asked")
def massless(
    inputs: Inputs,
    seen: Seen,
    asked: AskedOfBodies,
    times: Mapping[int, StepTimes],
    touches: TouchTable,
) -> Iterator[Case]:
    """A body without mass hangs in the air, or does not move when pushed."""
    pushed = {use.body.number for use in inputs.of(*PUSHES) if use.body}
    for number, body in seen.bodies.items():
        call = asked.load(body)
        if body.joints or body.base_moves or not body.collisions or call is None:
            continue
        hangs = times[body.client].falls and not touches.rows(number)
        if call.act is not Act.MAKE or "baseMass" in call.values or not (hangs or number in pushed):
            continue
        yield Case(call=call, subject=body, values={"pushed": number in pushed})


massless.rows(
    SayingRow(when=lambda pushed: pushed, says=Message("{body} has no mass, so no force moves it")),
    SayingRow(says=Message("{body} has no mass, so it does not fall"), level="note"),
    like=SayingRow(
        advice=Message("{call}: without it a body is static"),
        cure=Remedy("mass", "body", 1.0, form="made"),
    ),
)


@input_rule("inertia-without-mass", "model")
def inertia_without_mass(inputs: Inputs, seen: Seen) -> Iterator[Case]:
    """A call for the inertia of a btRigidBody also sets its mass, to an uninitialised number."""
    dynamics = seen.dynamics
    rigid = {each.body.number for each in dynamics if int(each.reported["kind"][0]) == RIGID}
    alone = {
        use.body.number: (use.first, use.body)
        for use in reversed([*inputs.of(Act.SET_PROPERTY)])
        if use.body and "localInertiaDiagonal" in use.low and "mass" not in use.low
    }
    for number in sorted(rigid & alone.keys()):
        call, body = alone[number]
        yield Case(call=call, subject=body)


inertia_without_mass.rows(
    SayingRow(
        says=Message(
            "{body} is a btRigidBody and gets an inertia without a mass: PyBullet then takes as "
            "its mass what an earlier command left in memory"
        ),
        advice=Message("give p.changeDynamics its mass as well"),
    )
)
