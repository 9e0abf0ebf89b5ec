"""An experiment in a script: calls that are made otherwise, added, or left out.

It stands above the hooks, so that what is recorded is what the engine was asked for, and every call
still belongs to a line of the script. What is asked for arrives as data; the words of PyBullet are
in `interventions`, beside this folder. Where a property is set that the script can read, it reads
what it would have read without.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from types import SimpleNamespace
from typing import Any

from ...watching.hidden import hiding
from ...watching.sites import caller, shown_file
from .arguments import BODY_NAMES, CLIENT, UNNAMED, body_of, client_of, named, number
from .functions import MAKES_BODIES, PUSHES

Call = Callable[..., Any]
Operation = Mapping[str, Any]
"""An operation: `do` names a method of `Interventions` below, `functions` the calls it is for."""

WHOLE = ("connect", "resetSimulation", "stepSimulation")
"""Calls that are about no body, and so about every one."""
PLURAL = {
    "targetPosition": "targetPositions",
    "targetVelocity": "targetVelocities",
    "force": "forces",
    "positionGain": "positionGains",
    "velocityGain": "velocityGains",
}
"""Arguments of a motor call for one joint, and of one for several."""
GEAR_N, GEAR_ERP = 100.0, 0.5
"""Largest force of a gear [N, N m], and the share of a gap that it closes in a step."""
FORCE_AT = 10
"""Index of the largest force in `getConstraintInfo`."""
UNSAID = {"force": 100000.0, "positionGain": 0.1, "velocityGain": 1.0, "targetVelocity": 0.0}
"""PyBullet's defaults of the arguments that a motor call may leave out."""
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
"""Function, and index in its answer, by which a script reads what `changeDynamics` sets."""


class Interventions:
    """What is done to a run.

    Parameters
    ----------
    operations
        As `interventions` makes them, those of other engines among them.
    tell
        Called with the number of an operation when it does something.
    """

    def __init__(self, operations: Sequence[Operation], tell: Callable[[int], None]) -> None:
        self._operations = [each for each in enumerate(operations) if "functions" in each[1]]
        self._tell = tell
        self._calls: dict[str, Call] = {}
        self._p = SimpleNamespace()
        self.next_body: dict[int, int] = {}
        """The id that the next body gets, by client."""
        self._told: dict[tuple[Any, ...], Any] = {}
        """The values that the script is to read, by client, body, link and argument."""
        self._ours: dict[tuple[Any, ...], Any] = {}
        """The values that were set in their place, by the same keys."""
        self._steps: dict[int, int] = {}
        self._kept: dict[Any, Any] = {}
        """The state of an operation: the last push of a place, the last motor of a joint."""

    def of(self, name: str, calls: dict[str, Call], p: SimpleNamespace) -> Call:
        """Return what stands before a watched function, of all of them and PyBullet's own."""
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
            for which, operation in mine:
                if self.is_about(operation, name, changed, client):
                    made = getattr(self, f"_{operation['do']}")(which, operation, changed, client)
                    if made is None:
                        return None
                    changed = made
            # As the script wrote it where nothing is changed: its form is recorded.
            same = changed is arguments
            result = call(*args, **kwargs) if same else self._called(name, call, changed)
            client = result if name == "connect" else client
            self.came(name, client, result)
            for which, operation in mine:
                then = getattr(self, f"_{operation['do']}_then", None)
                if then is not None and self.is_about(operation, name, arguments, client, result):
                    then(which, operation, arguments, client)
            return result

        return hiding(intervened)

    def _called(self, name: str, call: Call, arguments: Mapping[str, Any]) -> Any:
        """Make a call by the names of its arguments; the older motor call takes none by name."""
        if name == UNNAMED:
            call = self._calls["setJointMotorControl2"]
            arguments = {each: value for each, value in arguments.items() if each}
        return call(**arguments)

    def came(self, name: str, client: Any, result: Any) -> None:
        """Note the bodies that a call has made, of a client."""
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
        """Return whether an operation is about a call, before it or, with its result, after."""
        place = operation.get("site")
        if place is not None:
            frame = caller()
            if [shown_file(frame.f_code.co_filename), frame.f_lineno] != place:
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
        modes = operation.get("modes")
        return modes is None or arguments.get("controlMode") in modes

    # -- calls made otherwise: each returns the arguments of the call, or None to leave it out ----

    def _leave(self, which: int, operation: Operation, arguments: Any, _: int) -> Any:
        """Leave a call out, or one of its arguments."""
        left = operation["arguments"]
        if not left:
            self._tell(which)
            return None
        made = {name: value for name, value in arguments.items() if name not in left}
        if made == arguments:
            return arguments
        self._tell(which)
        return made

    def _apart(self, which: int, operation: Operation, arguments: Any, _: int) -> Any:
        """Give some arguments of a call in a call of their own, for the same link."""
        own = {n: v for n, v in arguments.items() if n in operation["arguments"]}
        about = {n: v for n, v in arguments.items() if n in (*BODY_NAMES, "linkIndex", CLIENT)}
        if own:
            self._tell(which)
            self._calls["changeDynamics"](**about, **own)
        return {n: v for n, v in arguments.items() if n not in own}

    def _set(self, which: int, operation: Operation, arguments: Any, client: int) -> Any:
        """Give arguments other values: all of them, or with `given` only where they are given."""
        values, given = operation.get("values", {}), operation.get("given")
        made = {**arguments, **{k: v for k, v in values.items() if not given or k in arguments}}
        for name, factor in operation.get("factors", {}).items():
            if name in arguments:
                made[name] = arguments[name] * factor
        for name, bits in operation.get("flags", {}).items():
            made[name] = (number(arguments.get(name)) or 0) & ~operation.get("clear", 0) | bits
        if made == arguments:
            return arguments
        self._tell(which)
        if "setPhysicsEngineParameter" in operation["functions"]:
            for name in operation.get("values", {}).keys() & arguments.keys():
                self._told[client, None, None, name] = arguments[name]
        return made

    def _motor(self, which: int, operation: Operation, arguments: Any, _: int) -> Any:
        """Give the motors of joints other values; links None for all that a call is for."""
        links, values = operation.get("links"), operation["values"]
        factors, least = operation.get("factors", {}), operation.get("least", False)

        def other(name: str, given: Any) -> Any:
            """Return a number that a motor is given in place of another, or of none."""
            if name in factors:
                return None if given is None else given * factors[name]
            return max(given, values[name]) if least and given is not None else values[name]

        if "jointIndices" not in arguments:
            if links is not None and number(arguments.get("jointIndex")) not in links:
                return arguments
            found = {name: other(name, arguments.get(name)) for name in (*values, *factors)}
            made = {**arguments, **{k: v for k, v in found.items() if v is not None}}
        else:
            joints = [number(each) for each in arguments["jointIndices"]]
            made = dict(arguments)
            for name in (*values, *factors):
                plural = PLURAL.get(name)
                given = arguments.get(plural)
                if plural is None or (given is None and name in factors):
                    continue  # there is none of it for several joints
                of = [UNSAID.get(name, 0.0)] * len(joints) if given is None else [*given]
                made[plural] = [
                    other(name, each) if links is None or joint in links else each
                    for joint, each in zip(joints, of)
                ]
        if made != arguments:
            self._tell(which)
        return made

    def _redirect(self, which: int, operation: Operation, arguments: Any, _: int) -> Any:
        """Send the motor calls of joints to others."""
        to = dict(operation["links"])
        made = dict(arguments)
        if "jointIndices" in arguments:
            joints = [number(each) for each in arguments["jointIndices"]]
            made["jointIndices"] = [to.get(each, each) for each in joints]
        else:
            joint = number(arguments.get("jointIndex"))
            made["jointIndex"] = to.get(joint, joint)
        self._tell(which)
        return made

    def _centre(self, which: int, _: Operation, arguments: Any, client: int) -> Any:
        """Let a force act at the centre of mass."""
        link, body = number(arguments.get("linkIndex")), body_of(arguments)
        at = [0.0, 0.0, 0.0]
        if arguments.get("flags") == self._p.WORLD_FRAME:
            at = (
                self._p.getBasePositionAndOrientation(body, client)[0]
                if link is None or link < 0
                else self._p.getLinkState(body, link, 0, 1, client)[0]
            )
        self._tell(which)
        return {**arguments, "posObj": [*at]}

    def _frames(self, which: int, _: Operation, arguments: Any, client: int) -> Any:
        """Let a constraint join bodies where they are: its frame on the child is the parent's."""
        p = self._p
        if arguments.get("jointType") not in (p.JOINT_FIXED, p.JOINT_POINT2POINT):
            return arguments
        one = self._pose(arguments["parentBodyUniqueId"], arguments["parentLinkIndex"], client)
        other = self._pose(arguments["childBodyUniqueId"], arguments["childLinkIndex"], client)
        none = [0.0, 0.0, 0.0, 1.0]
        turned = arguments.get("parentFrameOrientation", none)
        point = p.multiplyTransforms(*one, arguments["parentFramePosition"], turned)
        point = p.multiplyTransforms(*p.invertTransform(*other), *point)
        self._tell(which)
        return {
            **arguments,
            "childFramePosition": [*point[0]],
            "childFrameOrientation": [*point[1]],
        }

    def _frame(self, which: int, _: Operation, arguments: Any, client: int) -> Any:
        """Place a body's frame where its centre of mass is set."""
        info = self._p.getDynamicsInfo(body_of(arguments), -1, client)
        pose = arguments["posObj"], arguments["ornObj"]
        at, turned = self._p.multiplyTransforms(*pose, info[3], info[4])
        self._tell(which)
        return {**arguments, "posObj": [*at], "ornObj": [*turned]}

    def _fall(self, which: int, _: Operation, arguments: Any, client: int) -> Any:
        """Leave a body its vertical velocity."""
        if "linearVelocity" not in arguments:
            return arguments
        vertical = self._p.getBaseVelocity(body_of(arguments), client)[0][2]
        self._tell(which)
        return {**arguments, "linearVelocity": [*[*arguments["linearVelocity"]][:2], vertical]}

    def _drive(self, which: int, _: Operation, arguments: Any, client: int) -> Any:
        """Drive joints by motors to where they are set, once the first step is made."""
        if "jointIndex" not in arguments:
            self._steps[client] = self._steps.get(client, 0) + 1
            return arguments
        if not self._steps.get(client):
            return arguments
        self._tell(which)
        self._calls["setJointMotorControl2"](
            body_of(arguments),
            arguments["jointIndex"],
            self._p.POSITION_CONTROL,
            targetPosition=arguments["targetValue"],
            physicsClientId=client,
        )
        return None

    def _pose(self, body: Any, link: Any, client: int) -> Any:
        if number(body) is None or number(body) < 0:  # type: ignore[operator]
            return [0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]
        if number(link) is None or number(link) < 0:  # type: ignore[operator]
            return self._p.getBasePositionAndOrientation(body, client)
        return self._p.getLinkState(body, link, 0, 1, client)[:2]

    # -- calls added ------------------------------------------------------------------------------

    def _add(self, _: int, __: Operation, arguments: Any, ___: int) -> Any:
        return arguments

    def _add_then(self, which: int, operation: Operation, arguments: Any, client: int) -> None:
        """Add calls after this one; after one that sets the same only if it does."""
        name = operation["call"]
        values, factors = operation.get("values", {}), operation.get("factors", {})
        again = {*values, *factors}
        if operation.get("only_after") and not again & arguments.keys():
            return
        body = operation.get("body")
        joints = 0 if body is None else self._p.getNumJoints(body, client)
        for link in operation.get("links", [None]):
            if link is not None and link >= joints:  # another body has its id: PyBullet would crash
                continue
            made: dict[str, Any] = dict(operation.get("fixed", {}))
            made.update(values)
            if body is not None:
                made["bodyUniqueId"] = body
            if link is not None:
                made[operation["link_name"]] = link
            if name in ("changeDynamics", "setPhysicsEngineParameter"):
                before = self._noted(client, body, link, again)
                made.update({key: before[key] * factor for key, factor in factors.items()})
            self._tell(which)
            self._calls[name](**made, **{CLIENT: client})
            for key in again:
                reported = self._reported(client, body, link, key)
                self._ours[client, body, link, key] = reported

    def _noted(self, client: int, body: Any, link: Any, names: set[str]) -> dict[str, Any]:
        """Note what the script is to read of a link, and return it."""
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

    def _lift(self, which: int, operation: Operation, arguments: Any, _: int) -> Any:
        """Place a body elsewhere than where it is set."""
        if "posObj" not in arguments:
            return arguments
        self._tell(which)
        moved = [each + by for each, by in zip(arguments["posObj"], operation["by_m"])]
        return {**arguments, "posObj": moved}

    def _lift_then(self, which: int, operation: Operation, arguments: Any, client: int) -> None:
        """Place a body elsewhere than where it was made."""
        body = operation["body"]
        if "posObj" in arguments:
            return
        at, turned = self._p.getBasePositionAndOrientation(body, client)
        at = [each + by for each, by in zip(at, operation["by_m"])]
        self._tell(which)
        self._calls["resetBasePositionAndOrientation"](body, at, [*turned], physicsClientId=client)

    def _pull(self, _: int, __: Operation, arguments: Any, ___: int) -> Any:
        return arguments

    def _pull_then(self, which: int, operation: Operation, _: Any, client: int) -> None:
        """Give a constraint that was made another largest force."""
        p = self._p
        made = p.getConstraintUniqueId(p.getNumConstraints(client) - 1, client)
        force_n = p.getConstraintInfo(made, client)[FORCE_AT]
        most_n = operation["values"].get("maxForce", force_n)
        most_n *= operation["factors"].get("maxForce", 1.0)
        self._tell(which)
        self._calls["changeConstraint"](made, maxForce=most_n, physicsClientId=client)

    def _gear(self, _: int, __: Operation, arguments: Any, ___: int) -> Any:
        return arguments

    def _gear_then(self, which: int, operation: Operation, _: Any, client: int) -> None:
        """Join two joints of a body that was made by a gear, the follower's motor off."""
        p, body, (leads, follows) = self._p, operation["body"], operation["links"]
        if max(leads, follows) >= p.getNumJoints(body, client):
            return
        self._tell(which)
        self._calls["setJointMotorControl2"](
            body, follows, p.VELOCITY_CONTROL, force=0, physicsClientId=client
        )
        none = [0.0, 0.0, 0.0]
        gear = self._calls["createConstraint"](
            body,
            leads,
            body,
            follows,
            p.JOINT_GEAR,
            [1.0, 0.0, 0.0],
            none,
            none,
            physicsClientId=client,
        )
        self._calls["changeConstraint"](
            gear,
            gearRatio=operation["ratio"],
            maxForce=GEAR_N,
            erp=GEAR_ERP,
            physicsClientId=client,
        )

    def _also(self, _: int, __: Operation, arguments: Any, ___: int) -> Any:
        return arguments

    def _also_then(self, which: int, operation: Operation, arguments: Any, client: int) -> None:
        """Make a call for another simulation, too."""
        other, name = operation["of"], operation["functions"][0]
        if client != other and self._p.isConnected(other):
            self._tell(which)
            self._calls[name](**{**arguments, CLIENT: other})

    def _carry(self, _: int, __: Operation, arguments: Any, ___: int) -> Any:
        return arguments

    def _carry_then(self, which: int, _: Operation, arguments: Any, client: int) -> None:
        """Give a body that is set to poses the velocity that takes it there."""
        body, at = body_of(arguments), [*arguments["posObj"]]
        key = "carried", client, body
        before, self._kept[key] = self._kept.get(key), at
        if before is None:
            return
        timestep_s = self._p.getPhysicsEngineParameters(client)["fixedTimeStep"]
        velocity = [(now - then) / timestep_s for now, then in zip(at, before)]
        self._tell(which)
        self._calls["resetBaseVelocity"](body, velocity, physicsClientId=client)

    def _hold(self, _: int, __: Operation, arguments: Any, ___: int) -> Any:
        return arguments

    def _hold_then(self, which: int, _: Operation, arguments: Any, client: int) -> None:
        """Give the motor of a joint that is reset its new position as the target."""
        p, body, joint = self._p, body_of(arguments), number(arguments.get("jointIndex"))
        if "controlMode" in arguments:
            force = arguments.get("force")
            if arguments["controlMode"] == p.POSITION_CONTROL and joint is not None:
                self._kept["motor", client, body, joint] = {} if force is None else {"force": force}
            return
        kept = self._kept.get(("motor", client, body, joint))
        if kept is not None:
            self._tell(which)
            self._calls["setJointMotorControl2"](
                body,
                joint,
                p.POSITION_CONTROL,
                targetPosition=arguments["targetValue"],
                physicsClientId=client,
                **kept,
            )

    def _again(self, which: int, _: Operation, arguments: Any, client: int) -> Any:
        """Give the last push of each place again, before each step in which it is not given."""
        if "forceObj" in arguments or "torqueObj" in arguments:
            return arguments
        step = self._steps.get(client, 0)
        for (what, of, name, *_), (at, push) in [*self._kept.items()]:
            if what == "push" and of == client and at < step:
                self._tell(which)
                self._calls[name](**push)
        self._steps[client] = step + 1
        return arguments

    def _again_then(self, _: int, __: Operation, arguments: Any, client: int) -> None:
        frame = caller()
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


def _bodies(name: str, result: Any) -> Iterator[int]:
    """Yield the bodies that a call has made."""
    if name in MAKES_BODIES:
        for body in result if isinstance(result, (tuple, list)) else (result,):
            if isinstance(body, int) and body >= 0:
                yield body
