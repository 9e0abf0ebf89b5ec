"""Makes trial changes in a PyBullet script's run: changes, adds or omits calls.

The changes are made before the recording wrappers, so that the recording contains the calls that
the engine really gets, and every call still belongs to a line of the script. The changes arrive as
data; `engines/pybullet/interventions.py` defines them. A script that reads a changed property gets
the value that it has itself set.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from types import SimpleNamespace
from typing import Any

from ...watching.hidden import hiding
from ...watching.operators import becoming
from ...watching.sites import caller, shown_file
from .arguments import BODY_NAMES, CLIENT, UNNAMED, body_of, client_of, named, number
from .functions import MAKES_BODIES, PUSHES, RETURNS

Call = Callable[..., Any]
Operation = Mapping[str, Any]
"""An operation on calls, as data: `do` names methods of `CallInterventions`, `functions` the
functions whose calls they change.

The method `_DO` runs before such a call and returns its new arguments, or None to omit the call;
`_DO_then` runs after it.
"""

JOINTS = "jointIndices"
"""The argument with the joints of a call for several joints."""
WHOLE = ("connect", "resetSimulation", "stepSimulation")
"""Calls that concern no particular body, so that an operation for one body applies to them, too."""
PLURAL = {
    "targetPosition": "targetPositions",
    "targetVelocity": "targetVelocities",
    "force": "forces",
    "positionGain": "positionGains",
    "velocityGain": "velocityGains",
}
"""Names of a motor call's arguments, for one joint and for several."""
GEAR_N, GEAR_ERP = 100.0, 0.5
"""Largest force of a gear constraint [N, N m], and the share of its error that it corrects per
step."""
FORCE_AT = 10
"""Index of the largest force in `getConstraintInfo`."""
UNSAID = {"force": 100000.0, "positionGain": 0.1, "velocityGain": 1.0, "targetVelocity": 0.0}
"""PyBullet's defaults for optional arguments of a motor call."""
DYNAMICS, JOINT, ENGINE = "getDynamicsInfo", "getJointInfo", "getPhysicsEngineParameters"
REPORTED: dict[str, tuple[str, int]] = {
    "mass": (DYNAMICS, 0),
    "lateralFriction": (DYNAMICS, 1),
    "localInertiaDiagonal": (DYNAMICS, 2),
    "restitution": (DYNAMICS, 5),
    "contactDamping": (DYNAMICS, 8),
    "contactStiffness": (DYNAMICS, 9),
    "jointDamping": (JOINT, 6),
    "jointLowerLimit": (JOINT, 8),
    "jointUpperLimit": (JOINT, 9),
}
"""Function, and index in its return value, by which a script reads what `changeDynamics` sets."""
ABOUT = {
    "changeDynamics": ("bodyUniqueId", "linkIndex"),
    "setJointMotorControl2": ("bodyUniqueId", "jointIndex"),
    "setJointMotorControlMultiDof": ("bodyUniqueId", "jointIndex"),
    "resetBasePositionAndOrientation": ("bodyUniqueId",),
    "changeConstraint": ("userConstraintUniqueId",),
    "setCollisionFilterPair": ("bodyUniqueIdA", "bodyUniqueIdB", "linkIndexA", "linkIndexB"),
}
"""Names of the arguments that tell an added call its bodies, links or joints."""
STANDS: dict[str, Callable[..., Mapping[str, Any]]] = {
    "setJointMotorControl2": lambda p, client, body, joint: {
        "targetPosition": p.getJointState(body, joint, client)[0]
    },
    "resetBasePositionAndOrientation": lambda p, client, body: dict(
        zip(("posObj", "ornObj"), p.getBasePositionAndOrientation(body, client))
    ),
}
"""Functions that read the current state of a joint or body, from which an added call starts."""


Element = tuple[int, int | None, int | None]
"""Client id, body id, and link or joint index of a call; None for those that the call lacks."""


class SeenCallSites:
    """The calls that a run made, by script line, and the contacts that occurred."""

    def __init__(self) -> None:
        self.calls: dict[tuple[str, int, str], SeenCalls] = {}
        """Observed calls, by file, line and function."""
        self.pairs: set[tuple[int, ...]] = set()
        """Client, bodies and links of pairs that touched."""
        self.first_steps: dict[int, tuple[str, int]] = {}
        """File and line of the first step, by client."""

    def step(self, client: int, points: Iterable[Sequence[Any]]) -> None:
        """Note what touches before a step, and the line of the first step."""
        if client not in self.first_steps:
            self.first_steps[client] = _line_of(caller())
        for point in points:
            self.pairs.add((client, *point[1:5]))

    def call(
        self,
        function: str,
        arguments: Mapping[str, Any],
        elements: Iterable[Element],
        keywords: Iterable[str],
    ) -> None:
        """Note a call, the bodies or joints that it is about, and its keyword arguments."""
        calls = self.calls.setdefault((*_line_of(caller()), function), SeenCalls())
        calls.keywords.update(keywords)
        for element in elements:
            calls.note(element, arguments)


class SeenCalls:
    """The calls of one function from one script line."""

    def __init__(self) -> None:
        self.arguments: dict[str, Any] = {}
        """Arguments by name, each from the first call that gives it."""
        self.elements: dict[Element, dict[str, Any]] = {}
        """Arguments of the last call for each body, link or joint."""
        self.keywords: set[str] = set()
        """Names of the arguments that are given by keyword."""
        self.varies = False
        """Whether the arguments of calls for the same body or joint differ."""
        self.files: dict[Element, str] = {}
        """Names, without suffix, of the files that the calls load."""

    def note(self, element: Any, arguments: Mapping[str, Any]) -> None:
        """Note the arguments of a call for one body or joint."""
        now = _copied(arguments)
        path = arguments.get("fileName")
        if isinstance(path, str):
            self.files[element] = os.path.splitext(os.path.basename(path))[0]
        self.arguments = {**now, **self.arguments}
        self.varies |= _differ(now, self.elements.setdefault(element, now))
        self.elements[element] = now


class CallInterventions:
    """Carries out the changes by which a trial run differs from the script's own.

    Parameters
    ----------
    operations
        The operations of `interventions`; those for other engines are ignored.
    tell
        A function that is called with the number of an operation when that takes effect.
    """

    def __init__(self, operations: Sequence[Operation], tell: Callable[[int], None]) -> None:
        self._operations = [each for each in enumerate(operations) if "functions" in each[1]]
        self._tell = tell
        self._calls: dict[str, Call] = {}
        self._p = SimpleNamespace()
        self.next_body: dict[int, int] = {}
        """The id that the next body gets, by client."""
        self._told: dict[tuple[Any, ...], Any] = {}
        """Values that the script must read, by client, body, link and argument."""
        self._ours: dict[tuple[Any, ...], Any] = {}
        """Values that trial changes have set instead, by the same keys."""
        self._steps: dict[int, int] = {}
        self._made = False
        """Whether an operation has made a call of its own."""
        self._keywords: Mapping[str, Any] = {}
        """The keyword arguments of the script's current call."""
        self.seen = SeenCallSites()
        """Calls and contacts of the run, if an operation requests them."""
        self._kept: dict[Any, Any] = {}
        """Values that operations remember, such as the last push from a line, or the last command
        to a joint."""

    def of(self, name: str, calls: dict[str, Call], p: SimpleNamespace) -> Call:
        """Return the wrapper that applies the changes to one function of PyBullet."""
        self._calls, self._p = calls, p
        call = calls[name]
        if not self._operations:
            return call
        if name in (DYNAMICS, JOINT, ENGINE):
            return hiding(self._reading(name, call))
        mine = [each for each in self._operations if name in each[1]["functions"]]
        if not mine and name not in MAKES_BODIES | {"resetSimulation", "connect"}:
            return call

        def intervened(*args: Any, **kwargs: Any) -> Any:
            arguments, client = named(name, args, kwargs), client_of(name, args, kwargs)
            changed = arguments
            self._keywords = kwargs
            for which, operation in mine:
                make = getattr(self, f"_{operation['do']}", None)
                if make is not None and self.is_about(operation, name, changed, client):
                    self._made = False
                    made = make(operation, changed, client)
                    if operation.get("elements") and JOINTS in changed:
                        made = _of_joints(changed, made, elements_of(client, changed), operation)
                    if self._made or _differ(made, changed):
                        self._tell(which)
                        if made is None:
                            return -1 if name in RETURNS else None
                        changed = made
            # As the script wrote it where nothing is changed: its form is recorded.
            same = changed is arguments
            result = call(*args, **kwargs) if same else self._called(name, call, changed)
            client = result if name == "connect" else client
            self.came(name, client, result)
            for which, operation in mine:
                then = getattr(self, f"_{operation['do']}_then", None)
                if then is not None and self.is_about(operation, name, arguments, client, result):
                    self._made = False
                    then(operation, arguments, client)
                    if self._made:
                        self._tell(which)
            return result

        return hiding(intervened)

    def _make(self, client: int, name: str, *args: Any, **kwargs: Any) -> Any:
        """Make a call that a change adds to the script's calls."""
        self._made = True
        return self._calls[name](*args, **{**kwargs, CLIENT: client})

    def _called(self, name: str, call: Call, arguments: Mapping[str, Any]) -> Any:
        """Make a call with keyword arguments, or positional ones where PyBullet has no keywords."""
        if name == UNNAMED:
            call = self._calls["setJointMotorControl2"]
            arguments = {each: value for each, value in arguments.items() if each}
        return call(**arguments)

    def came(self, name: str, client: Any, result: Any) -> None:
        """Note the bodies that a call created."""
        if name in ("connect", "resetSimulation"):
            self.next_body[client] = 0
            for held in (self._told, self._ours):
                for key in [key for key in held if key[0] == client]:
                    del held[key]
        for body in _bodies(name, result):
            self.next_body[client] = max(self.next_body.get(client, 0), body + 1)

    def is_about(
        self,
        operation: Operation,
        name: str,
        arguments: Mapping[str, Any],
        client: Any,
        result: Any = None,
    ) -> bool:
        """Return whether an operation applies to a call; after the call, `result` is given."""
        place = operation.get("site")
        if place is not None and _line_of(caller()) != (*place,):
            return False
        if operation.get("client", client) != client and name != "connect":
            return False
        body = operation.get("body")
        if body is not None:
            here = [body_of({**arguments})]
            if name in MAKES_BODIES:
                here = [*_bodies(name, result)] or [self.next_body.get(client, 0)]
            if name not in WHOLE and body not in here:
                return False
        elements = operation.get("elements")
        if elements is not None:
            its = [[*element] for element in self._elements_of(name, client, arguments)]
            if not any(each in elements for each in its):
                return False
        modes = operation.get("modes")
        return modes is None or arguments.get("controlMode") in modes

    def _elements_of(
        self, name: str, client: int, arguments: Mapping[str, Any]
    ) -> Sequence[Element]:
        """Return the bodies or joints that a call is about, or the body that it will create."""
        if name in MAKES_BODIES:
            return [(client, self.next_body.get(client, 0), None)]
        return elements_of(client, arguments)

    # -- calls made otherwise ---------------------------------------------------------------------

    def _leave(self, operation: Operation, arguments: Any, _: int) -> Any:
        """Omit a call, or some of its arguments."""
        left = operation["arguments"]
        return {n: v for n, v in arguments.items() if n not in left} if left else None

    def _held(self, operation: Operation, arguments: Any, client: int) -> Any:
        """Repeat the arguments of the line's first call for the same body or joint."""
        return self._kept.setdefault(_of_line(operation, arguments, client), _copied(arguments))

    def _late(self, operation: Operation, arguments: Any, client: int) -> Any:
        """Repeat the arguments of the line's previous call: a delay of one call."""
        key = _of_line(operation, arguments, client)
        before, self._kept[key] = self._kept.get(key, arguments), _copied(arguments)
        return before

    def _play(self, operation: Operation, arguments: Any, client: int) -> Any:
        """Give a motor call the values recorded for the same joints and step.

        A call without recorded values is omitted: the motor keeps its last command.
        """
        at, key = ("step", id(operation)), ("recorded", id(operation))
        self._kept.setdefault(at, operation["first"])
        step = int(self._kept[at])
        if "controlMode" not in arguments:
            self._kept[at] = step + 1
            return arguments
        if step >= operation["last"]:
            return arguments
        if key not in self._kept:
            self._kept[key] = {}
            for *where, values in operation["commands"]:
                self._kept[key].setdefault(tuple(where), []).append(values)
        waiting = self._kept[key]
        recorded = [
            waiting[step, body, joint].pop(0)
            for _, body, joint in elements_of(client, arguments)
            if waiting.get((step, body, joint))
        ]
        if len(recorded) < len(elements_of(client, arguments)):
            return None
        if JOINTS in arguments:
            names = {one: several for one, several in PLURAL.items() if several in arguments}
            played = {to: [each[name][0] for each in recorded] for name, to in names.items()}
        else:
            played = {
                name: numbers
                if isinstance(own := _plain(arguments[name]), list)
                else _becoming(own, ("=", numbers[0]))
                for name, numbers in recorded[0].items()
                if name in arguments
            }
        return {**arguments, **played}

    def _see(self, operation: Operation, arguments: Any, client: int) -> Any:
        """Note a call, or the contacts before a step, to find changes with an effect."""
        (function,) = operation["functions"]
        if function == "stepSimulation":
            self.seen.step(client, self._p.getContactPoints(physicsClientId=client))
        else:
            elements = self._elements_of(function, client, arguments)
            self.seen.call(function, arguments, elements, self._keywords)
        return arguments

    def _once(self, operation: Operation, arguments: Any, client: int) -> Any:
        """Make added calls once, before the next step, for each existing body or joint."""
        key = "once", client, id(operation)
        if key not in self._kept:
            self._kept[key] = True
            ids = operation["ids"]
            for element in there(self._p, client, operation["each"], ids):
                if not ids or [*element] in ids:
                    self._give(operation, client, *element[1:])
        return arguments

    def _apart(self, operation: Operation, arguments: Any, client: int) -> Any:
        """Pass some arguments of a call in a separate call, for the same link."""
        own = {n: v for n, v in arguments.items() if n in operation["arguments"]}
        about = {n: v for n, v in arguments.items() if n in (*BODY_NAMES, "linkIndex", CLIENT)}
        if own:
            self._make(client, "changeDynamics", **about, **own)
        return {n: v for n, v in arguments.items() if n not in own}

    def _set(self, operation: Operation, arguments: Any, client: int) -> Any:
        """Set or change arguments of a call; with `given`, only those that the script passes."""
        made = {**arguments}
        for name, how in operation["sets"].items():
            if name in arguments or not operation.get("given"):
                made[name] = _becoming(arguments.get(name), how)
        if "setPhysicsEngineParameter" in operation["functions"]:
            for name in operation["sets"].keys() & arguments.keys():
                self._told[client, None, None, name] = arguments[name]
        return made

    def _motor(self, operation: Operation, arguments: Any, _: int) -> Any:
        """Change the arguments of motor calls for some joints; for all if `links` is None."""
        links, made = operation.get("links"), {**arguments}
        if JOINTS not in arguments:
            if links is None or number(arguments.get("jointIndex")) in links:
                for name, how in operation["sets"].items():
                    if name in arguments or how[0] != "*":
                        made[name] = _becoming(arguments.get(name), how)
            return made
        joints = [number(each) for each in arguments[JOINTS]]
        for name, how in operation["sets"].items():
            plural = PLURAL.get(name)
            given = arguments.get(plural)
            if plural is None or (given is None and how[0] == "*"):
                continue  # there is none of it for several joints
            of = [UNSAID.get(name, 0.0)] * len(joints) if given is None else [*given]
            made[plural] = [
                _becoming(each, how) if links is None or joint in links else each
                for joint, each in zip(joints, of)
            ]
        return made

    def _redirect(self, operation: Operation, arguments: Any, _: int) -> Any:
        """Send motor commands to other joints than the script names."""
        to = dict(operation["links"])
        made = dict(arguments)
        if JOINTS in arguments:
            joints = [number(each) for each in arguments[JOINTS]]
            made[JOINTS] = [to.get(each, each) for each in joints]
        else:
            joint = number(arguments.get("jointIndex"))
            made["jointIndex"] = to.get(joint, joint)
        return made

    def _centre(self, _: Operation, arguments: Any, client: int) -> Any:
        """Move a force's point of application to the centre of mass."""
        link, body = number(arguments.get("linkIndex")), body_of(arguments)
        at = [0.0, 0.0, 0.0]
        if arguments.get("flags") == self._p.WORLD_FRAME:
            at = (
                self._p.getBasePositionAndOrientation(body, client)[0]
                if link is None or link < 0
                else self._p.getLinkState(body, link, 0, 1, client)[0]
            )
        return {**arguments, "posObj": [*at]}

    def _frames(self, _: Operation, arguments: Any, client: int) -> Any:
        """Set the child's frame of a constraint so that the bodies stay where they are."""
        p = self._p
        if arguments.get("jointType") not in (p.JOINT_FIXED, p.JOINT_POINT2POINT):
            return arguments
        one = self._pose(arguments["parentBodyUniqueId"], arguments["parentLinkIndex"], client)
        other = self._pose(arguments["childBodyUniqueId"], arguments["childLinkIndex"], client)
        none = [0.0, 0.0, 0.0, 1.0]
        turned = arguments.get("parentFrameOrientation", none)
        point = p.multiplyTransforms(*one, arguments["parentFramePosition"], turned)
        point = p.multiplyTransforms(*p.invertTransform(*other), *point)
        return {
            **arguments,
            "childFramePosition": [*point[0]],
            "childFrameOrientation": [*point[1]],
        }

    def _frame(self, _: Operation, arguments: Any, client: int) -> Any:
        """Move a body so that its frame, not its centre of mass, is at the position in the call."""
        info = self._p.getDynamicsInfo(body_of(arguments), -1, client)
        pose = arguments["posObj"], arguments["ornObj"]
        at, turned = self._p.multiplyTransforms(*pose, info[3], info[4])
        return {**arguments, "posObj": [*at], "ornObj": [*turned]}

    def _fall(self, _: Operation, arguments: Any, client: int) -> Any:
        """Keep a body's vertical velocity in calls that set its velocity, so that it can fall."""
        if "linearVelocity" not in arguments:
            return arguments
        vertical = self._p.getBaseVelocity(body_of(arguments), client)[0][2]
        return {**arguments, "linearVelocity": [*[*arguments["linearVelocity"]][:2], vertical]}

    def _drive(self, _: Operation, arguments: Any, client: int) -> Any:
        """Drive joints by motors instead of setting their positions, after the first step."""
        if "jointIndex" not in arguments:
            self._steps[client] = self._steps.get(client, 0) + 1
            return arguments
        if not self._steps.get(client):
            return arguments
        self._drive_to(client, arguments)
        return None

    def _drive_to(self, client: int, arguments: Any, **force: Any) -> None:
        """Set a joint's motor target to the position that a call would set."""
        joint, mode = arguments["jointIndex"], self._p.POSITION_CONTROL
        to = {"targetPosition": arguments["targetValue"], **force}
        self._make(client, "setJointMotorControl2", body_of(arguments), joint, mode, **to)

    def _pose(self, body: Any, link: Any, client: int) -> Any:
        if number(body) is None or number(body) < 0:  # type: ignore[operator]
            return [0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]
        if number(link) is None or number(link) < 0:  # type: ignore[operator]
            return self._p.getBasePositionAndOrientation(body, client)
        return self._p.getLinkState(body, link, 0, 1, client)[:2]

    # -- calls added ------------------------------------------------------------------------------

    def _add_then(self, operation: Operation, arguments: Any, client: int) -> None:
        """Add calls after a call; if the call sets link properties, only if needed."""
        if operation.get("only_after") and not operation["sets"].keys() & arguments.keys():
            return
        body = operation.get("body")
        joints = 0 if body is None else self._p.getNumJoints(body, client)
        for link in operation.get("links", [None]):
            if link is None or link < joints:  # another body has its id: PyBullet would crash
                self._give(operation, client, body, link)

    def _give(self, operation: Operation, client: int, *about: Any) -> None:
        """Make an added call for the given objects: body and link, other ids, or none."""
        name, sets = operation["call"], operation["sets"]
        named_as = {key: each for key, each in zip(ABOUT.get(name, ()), about) if each is not None}
        body, link = (*about, None, None)[:2]
        noted: Mapping[str, Any] = {}
        if name in ("changeDynamics", "setPhysicsEngineParameter"):
            noted = self._noted(client, body, link, sets)
        elif name in STANDS:
            noted = STANDS[name](self._p, client, *about)
        made = {key: _becoming(noted.get(key), how) for key, how in sets.items()}
        self._make(client, name, **named_as, **made)
        for key in sets:
            self._ours[client, body, link, key] = self._reported(client, body, link, key)

    def _noted(self, client: int, body: Any, link: Any, names: Iterable[str]) -> dict[str, Any]:
        """Return the link properties that the script has set, unaffected by the trial's changes."""
        for name in names:
            key = client, body, link, name
            now = self._reported(*key)
            if now is not None and (key not in self._ours or self._ours[key] != now):
                self._told[key] = now
        return {name: self._told.get((client, body, link, name)) for name in names}

    def _reported(self, client: int, body: Any, link: Any, name: str) -> Any:
        try:
            if body is None:
                return self._p.getPhysicsEngineParameters(client).get(name)
            getter, at = REPORTED[name]
            return getattr(self._p, getter)(body, link, client)[at]
        except (KeyError, IndexError, self._p.error):
            return None

    def _lift(self, operation: Operation, arguments: Any, _: int) -> Any:
        """Move a body away from the position that a call sets."""
        if "posObj" not in arguments:
            return arguments
        moved = [each + by for each, by in zip(arguments["posObj"], operation["by_m"])]
        return {**arguments, "posObj": moved}

    def _lift_then(self, operation: Operation, arguments: Any, client: int) -> None:
        """Move a body just after loading, away from the bodies that it overlaps."""
        body = operation["body"]
        if "posObj" in arguments:
            return
        at, turned = self._p.getBasePositionAndOrientation(body, client)
        at = [each + by for each, by in zip(at, operation["by_m"])]
        self._make(client, "resetBasePositionAndOrientation", body, at, [*turned])

    def _pull_then(self, operation: Operation, _: Any, client: int) -> None:
        """Change the maximum force of a constraint that was just created."""
        p = self._p
        made = p.getConstraintUniqueId(p.getNumConstraints(client) - 1, client)
        force_n = p.getConstraintInfo(made, client)[FORCE_AT]
        most_n = _becoming(force_n, operation["sets"]["maxForce"])
        self._make(client, "changeConstraint", made, maxForce=most_n)

    def _gear_then(self, operation: Operation, _: Any, client: int) -> None:
        """Connect two joints of a loaded body by a gear, without a motor on the follower."""
        p, body, (leads, follows) = self._p, operation["body"], operation["links"]
        if max(leads, follows) >= p.getNumJoints(body, client):
            return
        self._make(client, "setJointMotorControl2", body, follows, p.VELOCITY_CONTROL, force=0)
        none = [0.0, 0.0, 0.0]
        joint = body, leads, body, follows, p.JOINT_GEAR, [1.0, 0.0, 0.0], none, none
        gear = self._make(client, "createConstraint", *joint)
        how = {"gearRatio": operation["ratio"], "maxForce": GEAR_N, "erp": GEAR_ERP}
        self._make(client, "changeConstraint", gear, **how)

    def _also_then(self, operation: Operation, arguments: Any, client: int) -> None:
        """Repeat a call in another simulation (client)."""
        other, name = operation["of"], operation["functions"][0]
        if client != other and self._p.isConnected(other):
            self._make(other, name, **arguments)

    def _carry_then(self, _: Operation, arguments: Any, client: int) -> None:
        """Set a body's velocity to match the poses that calls set one after another."""
        body, at = body_of(arguments), [*arguments["posObj"]]
        key = "carried", client, body
        before, self._kept[key] = self._kept.get(key), at
        if before is None:
            return
        timestep_s = self._p.getPhysicsEngineParameters(client)["fixedTimeStep"]
        velocity = [(now - then) / timestep_s for now, then in zip(at, before)]
        self._make(client, "resetBaseVelocity", body, velocity)

    def _hold_then(self, _: Operation, arguments: Any, client: int) -> None:
        """Set a joint's motor target to the position to which a call has reset the joint."""
        p, body, joint = self._p, body_of(arguments), number(arguments.get("jointIndex"))
        if "controlMode" in arguments:
            force = arguments.get("force")
            if arguments["controlMode"] == p.POSITION_CONTROL and joint is not None:
                self._kept["motor", client, body, joint] = {} if force is None else {"force": force}
            return
        kept = self._kept.get(("motor", client, body, joint))
        if kept is not None:
            self._drive_to(client, arguments, **kept)

    def _again(self, _: Operation, arguments: Any, client: int) -> Any:
        """Repeat each line's last external force before steps for which the line applies none."""
        if "forceObj" in arguments or "torqueObj" in arguments:
            return arguments
        step = self._steps.get(client, 0)
        for (what, of, name, *_), (at, push) in [*self._kept.items()]:
            if what == "push" and of == client and at < step:
                self._make(client, name, **push)
        self._steps[client] = step + 1
        return arguments

    def _again_then(self, operation: Operation, arguments: Any, client: int) -> None:
        frame, ids = caller(), operation.get("ids")
        line = operation.get("line") or _line_of(frame)
        if _line_of(frame) != (*line,) or (ids and [*element_of(client, arguments)] not in ids):
            return
        for name in PUSHES:
            vector = "forceObj" if name == "applyExternalForce" else "torqueObj"
            if vector in arguments:
                key = "push", client, name, id(frame.f_code), frame.f_lineno, body_of(arguments)
                kept = {**arguments, vector: [*arguments[vector]]}
                self._kept[key] = self._steps.get(client, 0), kept

    # -- what the script reads --------------------------------------------------------------------

    def _reading(self, name: str, call: Call) -> Call:
        def read(*args: Any, **kwargs: Any) -> Any:
            result = call(*args, **kwargs)
            if not self._told:
                return result
            client, arguments = client_of(name, args, kwargs), named(name, args, kwargs)
            body = None if name == ENGINE else body_of(arguments)
            link = number(arguments.get("linkIndex", arguments.get("jointIndex")))
            return self._as_told(name, result, client, body, None if body is None else link)

        return read

    def _as_told(self, name: str, result: Any, client: int, body: Any, link: Any) -> Any:
        for (of, which, where, argument), value in self._told.items():
            if (of, which, where) != (client, body, link):
                continue
            # What the script has set since is the engine's own.
            key = of, which, where, argument
            if key in self._ours and self._reported(*key) != self._ours[key]:
                continue
            if body is None:
                result = {**result, argument: value}
            elif argument in REPORTED and REPORTED[argument][0] == name:
                at = REPORTED[argument][1]
                result = (*result[:at], value, *result[at + 1 :])
        return result


def _becoming(held: Any, how: Sequence[Any]) -> Any:
    """Apply an operator to a call's argument.

    A missing argument counts as 0 for operators on flags; the operator `>` (at least) sets it.
    """
    if how[0] in ("|", "~", "^"):
        held = number(held) or 0
    elif held is None and how[0] == ">":
        return how[1]
    new = becoming(held, how)
    # What PyBullet takes as a whole number stays one.
    is_whole = isinstance(held, int) and isinstance(new, float) and new.is_integer()
    return int(new) if is_whole else new


def element_of(client: int, arguments: Mapping[str, Any]) -> Element:
    """Return the client id, body id, and joint or link index named in a call."""
    link = arguments.get("jointIndex", arguments.get("linkIndex"))
    return client, body_of({**arguments}), number(link)


def elements_of(client: int, arguments: Mapping[str, Any]) -> list[Element]:
    """Return client id, body id, and joint or link index of all objects named in a call."""
    if JOINTS not in arguments:
        return [element_of(client, arguments)]
    return [(client, body_of({**arguments}), number(each)) for each in arguments[JOINTS]]


def _of_joints(
    arguments: Mapping[str, Any],
    made: Mapping[str, Any] | None,
    elements: Sequence[Any],
    operation: Operation,
) -> Mapping[str, Any] | None:
    """Combine a call for several joints with its changed form, for the chosen joints only."""
    changed = [[*element] in operation["elements"] for element in elements]
    if all(changed):
        return made
    merged = {}
    for name, value in arguments.items():
        own = _plain(value)
        if not isinstance(own, list) or len(own) != len(changed):
            merged[name] = value
        elif made is None:  # left out
            merged[name] = [each for each, out in zip(own, changed) if not out]
        else:
            new = _plain(made.get(name, own))
            merged[name] = [b if taken else a for a, b, taken in zip(own, new, changed)]
    return merged


def there(p: Any, client: int, each: str, pairs: Iterable[Sequence[int]]) -> Iterator[Any]:
    """Yield a simulation's objects of one kind: bodies, links, joints, constraints or contacts."""
    if each in ("bodies", "links", "joints"):
        for body in [p.getBodyUniqueId(n, client) for n in range(p.getNumBodies(client))]:
            joints = range(p.getNumJoints(body, client))
            if each == "bodies":
                yield client, body
            elif each == "links":
                yield from ((client, body, link) for link in (-1, *joints))
            else:
                moving = (p.JOINT_REVOLUTE, p.JOINT_PRISMATIC)
                kinds = ((n, p.getJointInfo(body, n, client)[2]) for n in joints)
                yield from ((client, body, joint) for joint, kind in kinds if kind in moving)
    elif each == "constraints":
        for which in range(p.getNumConstraints(client)):
            yield client, p.getConstraintUniqueId(which, client)
    elif each == "pairs":
        yield from (pair for pair in sorted(map(tuple, pairs)) if pair[0] == client)
    else:
        yield (client,)


def _line_of(frame: Any) -> tuple[str, int]:
    return shown_file(frame.f_code.co_filename), frame.f_lineno


def _of_line(operation: Operation, arguments: Any, client: int) -> tuple[Any, ...]:
    frame = caller()
    line = frame.f_code.co_filename, frame.f_lineno
    return (operation["do"], id(operation), line, element_of(client, arguments))


def _copied(arguments: Mapping[str, Any]) -> dict[str, Any]:
    return {name: _plain(value) for name, value in arguments.items()}


def _differ(made: Any, arguments: Any) -> bool:
    """Return whether two sets of arguments differ; some may be arrays."""
    if made is arguments:
        return False
    return made is None or _copied(made) != _copied(arguments)


def _plain(value: Any) -> Any:
    value = value.tolist() if hasattr(value, "tolist") else value
    return [*value] if isinstance(value, (list, tuple)) else value


def _bodies(name: str, result: Any) -> Iterator[int]:
    """Yield the engine ids of the bodies that a call created."""
    if name in MAKES_BODIES:
        for body in result if isinstance(result, (tuple, list)) else (result,):
            if isinstance(body, int) and body >= 0:
                yield body
