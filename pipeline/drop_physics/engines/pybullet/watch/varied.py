"""Varies a whole run in the engine, unnoticed by the script: a finer timestep, more iterations.

With a finer timestep, k steps of dt/k replace one of dt. Forces that last one step are applied
again before each of them. Motors and constraints keep the product of force and timestep at the time
of their call; the engine's timestep is dt/k during such calls. When the script sets a varied
property, the engine first receives the script's own value, so that errors are the engine's own and
the script reads the value that it has set.
"""

from __future__ import annotations

import copy
import random
from collections.abc import Callable, Sequence
from types import SimpleNamespace
from typing import Any

from ...watching.sites import caller
from .arguments import body_of, client_of, named
from .bodies import RIGID, SPHERICAL, WatchedBody
from .functions import COMMANDS, MAKES_BODIES, PUSHES, SETS_ENGINE

TIMESTEP, ITERATIONS, GRAVITY = "fixedTimeStep", "numSolverIterations", "gravityAcceleration"
MASS, FRICTION, INERTIA = 0, 1, 2
"""Indices of these values in `getDynamicsInfo`."""

Call = Callable[..., Any]


class Variation:
    """A variation of a whole run, such as a finer timestep.

    Parameters
    ----------
    finer
        Number of engine steps per step of the script.
    iterations
        Factor on the number of solver iterations.
    engine
        Arguments of `setPhysicsEngineParameter` that override the script's.
    gravity
        Magnitude that replaces the script's gravity, in the same direction [m/s²]; None keeps the
        script's.
    friction, mass
        Factors on the friction coefficient of each pair of bodies, and on masses and inertias.
    nudge, seed
        Largest random displacement before the first step [m, rad], and the random seed.
    """

    def __init__(
        self,
        *,
        finer: int = 1,
        iterations: int = 1,
        engine: dict[str, float] | None = None,
        gravity: float | None = None,
        friction: float = 1.0,
        mass: float = 1.0,
        nudge: float = 0.0,
        seed: int = 0,
    ) -> None:
        self.finer, self.engine = finer, engine or {}
        self._iterations, self._gravity, self._nudge = iterations, gravity, nudge
        self._friction, self._mass = friction, mass
        self._draw = random.Random(seed).uniform
        self._p = SimpleNamespace()
        self._lasting: dict[int, list[tuple[str, Call, Any, Any, Any]]] = {}
        """Calls since the last step whose effect lasts one step, by client."""
        self._set: dict[int, dict[str, Any]] = {}
        """The script's own values of engine settings, by client."""
        self._links: dict[tuple[int, int | None, int], Any] = {}
        """The values that the engine would report of each link without the variation, by client and
        body."""
        self._unmoved: set[int] = set()
        """Clients that have not made a step yet."""

    def of(self, p: SimpleNamespace, name: str, original: Call) -> Call:
        """Return the wrapper that applies the variation to one function of PyBullet."""
        self._p = p
        if name == "connect":
            return self._connecting(original)
        if name in SETS_ENGINE or name == "resetSimulation":
            return self._setting(name, original)
        if name == "getPhysicsEngineParameters":
            return lambda *args, **kwargs: {
                **original(*args, **kwargs),
                **self._set.get(client_of(name, args, kwargs), {}),
            }
        if name in COMMANDS | PUSHES:
            return self._acting(name, original)
        if self._friction != 1.0 or self._mass != 1.0:
            if name in MAKES_BODIES or name == "changeDynamics":
                return self._of_bodies(name, original)
            if name == "getDynamicsInfo":
                return self._reported(name, original)
        return original

    # -- the engine -------------------------------------------------------------------------------

    def _connecting(self, original: Call) -> Call:
        def connect(*args: Any, **kwargs: Any) -> Any:
            client = original(*args, **kwargs)
            if client >= 0:
                self._begin(client)
            return client

        return connect

    def _begin(self, client: int) -> None:
        self._lasting[client] = []
        self._unmoved.add(client)
        for key in [key for key in self._links if key[0] == client]:
            del self._links[key]
        self._vary(client)

    def _setting(self, name: str, original: Call) -> Call:
        def set_engine(*args: Any, **kwargs: Any) -> Any:
            client = client_of(name, args, kwargs)
            if client not in self._set:
                return original(*args, **kwargs)
            self._give(client, self._set[client])
            try:
                result = original(*args, **kwargs)
            finally:
                if name == "resetSimulation":
                    self._begin(client)
                else:
                    self._vary(client)
            self._change_bodies(name, client, result)
            return result

        return set_engine

    def _vary(self, client: int) -> None:
        """Save the script's engine settings, and replace them by varied ones."""
        reported = self._p.getPhysicsEngineParameters(client)
        ours = {TIMESTEP: reported[TIMESTEP] / self.finer, **self.engine}
        if self._iterations != 1:
            ours[ITERATIONS] = self._iterations * reported[ITERATIONS]
        if self._gravity is not None:
            gravity = {f"{GRAVITY}{axis}": reported[f"{GRAVITY}{axis}"] for axis in "XYZ"}
            size = sum(value * value for value in gravity.values()) ** 0.5
            ours.update(
                {key: value * self._gravity / (size or 1.0) for key, value in gravity.items()}
            )
        self._set[client] = {key: reported[key] for key in ours if key in reported}
        self._give(client, ours)

    def _give(self, client: int, values: dict[str, Any]) -> None:
        gravity = [values[f"{GRAVITY}{axis}"] for axis in "XYZ" if f"{GRAVITY}{axis}" in values]
        if gravity:
            self._p.setGravity(*gravity, physicsClientId=client)
        others = {key: value for key, value in values.items() if not key.startswith(GRAVITY)}
        self._p.setPhysicsEngineParameter(**others, physicsClientId=client)

    # -- what lasts one step ----------------------------------------------------------------------

    def _acting(self, name: str, original: Call) -> Call:
        def act(*args: Any, **kwargs: Any) -> Any:
            lasts = self.finer > 1 and (name in PUSHES or self._is_torque(name, args, kwargs))
            kept = copy.deepcopy((args, kwargs)) if lasts else None
            result = original(*args, **kwargs)
            if kept is not None:
                frame = caller()
                place = SimpleNamespace(
                    f_code=frame.f_code,
                    f_lineno=frame.f_lineno,
                    f_lasti=frame.f_lasti,
                    f_back=None,
                )
                lasting = self._lasting.get(client_of(name, args, kwargs))
                if lasting is not None:
                    lasting.append((name, original, *kept, place))
            return result

        return act

    def _is_torque(self, name: str, args: Any, kwargs: Any) -> bool:
        mode = named(name, args, kwargs).get("controlMode", args[2] if len(args) > 2 else None)
        return bool(mode == self._p.TORQUE_CONTROL)

    def again(self, client: int, tell: Call) -> None:
        """Apply external forces again in each finer step, since PyBullet clears them after one."""
        for name, original, args, kwargs, place in self._lasting.get(client, []):
            tell(name, args, kwargs, place)
            try:
                original(*args, **kwargs)
            except self._p.error:  # its body is gone
                continue

    def stepped(self, client: int) -> None:
        """Note that a step of the script has ended."""
        if client in self._lasting:
            self._lasting[client].clear()

    # -- bodies -----------------------------------------------------------------------------------

    def _of_bodies(self, name: str, original: Call) -> Call:
        def change(*args: Any, **kwargs: Any) -> Any:
            client, body = client_of(name, args, kwargs), body_of(named(name, args, kwargs))
            changes = name == "changeDynamics" and body is not None
            if changes:
                self._each_link(client, body, back=True)
            try:
                result = original(*args, **kwargs)
            finally:
                if changes:
                    self._each_link(client, body)
            self._change_bodies(name, client, result)
            return result

        return change

    def _change_bodies(self, name: str, client: int, result: Any) -> None:
        if name in MAKES_BODIES and (self._friction != 1.0 or self._mass != 1.0):
            for body in result if isinstance(result, tuple) else (result,):
                if isinstance(body, int) and body >= 0:
                    self._each_link(client, body)

    def _each_link(self, client: int, body: int | None, *, back: bool = False) -> None:
        """Change mass and friction of all links, or restore them."""
        p = self._p
        try:
            links = range(-1, p.getNumJoints(body, client))
            reported = [p.getDynamicsInfo(body, link, client) for link in links]
        except p.error:  # there is no such body: the call itself will say so
            return
        for link, info in zip(links, reported):
            key = client, body, link
            if back and key not in self._links:
                continue
            if back:
                info, friction, mass = self._links[key], 1.0, 1.0
            else:
                self._links[key] = info
                friction, mass = self._friction**0.5, self._mass
            changes: dict[str, Any] = {"lateralFriction": info[FRICTION] * friction}
            if self._mass != 1.0 and info[MASS]:
                changes["mass"] = info[MASS] * mass
                if info[10] != RIGID:  # whose inertia PyBullet would take for a mass
                    changes["localInertiaDiagonal"] = [each * mass for each in info[INERTIA]]
            p.changeDynamics(body, link, physicsClientId=client, **changes)

    def _reported(self, name: str, original: Call) -> Call:
        def report(*args: Any, **kwargs: Any) -> Any:
            info = original(*args, **kwargs)
            arguments, client = named(name, args, kwargs), client_of(name, args, kwargs)
            ours = self._links.get((client, body_of(arguments), arguments.get("linkIndex")))  # type: ignore[arg-type]
            return info if ours is None else ours

        return report

    def nudge(self, client: int, bodies: Callable[[], list[WatchedBody]]) -> bool:
        """Displace all bodies and joints before their first step; return True if any was."""
        if not self._nudge or client not in self._unmoved:
            return False
        self._unmoved.discard(client)
        for body in bodies():
            if not body.soft:
                self._displace(client, body)
        return True

    def _displace(self, client: int, body: WatchedBody) -> None:
        p, most = self._p, self._nudge
        if body.base_moves:
            position, orientation = p.getBasePositionAndOrientation(body.id, client)
            velocity, spin = p.getBaseVelocity(body.id, client)
            moved = [each + self._draw(-most, most) for each in position]
            turned = self._turned(orientation)
            p.resetBasePositionAndOrientation(body.id, moved, turned, client)
            p.resetBaseVelocity(body.id, velocity, spin, client)
        for joint in body.joints:
            if body.joint_infos[joint][2] == SPHERICAL:
                turned, rates, *_ = p.getJointStateMultiDof(body.id, joint, client)
                turned = self._turned(turned)
                p.resetJointStateMultiDof(body.id, joint, turned, rates, physicsClientId=client)
            else:
                at, rate, *_ = p.getJointState(body.id, joint, client)
                moved_to = at + self._draw(-most, most)
                p.resetJointState(body.id, joint, moved_to, rate, physicsClientId=client)

    def _turned(self, orientation: Sequence[float]) -> list[float]:
        """Return a slightly turned orientation, as the product of two quaternions.

        PyBullet's `multiplyTransforms` is of single precision, so that it turns by more.
        """
        (x, y, z, w), most = orientation, self._nudge / 2
        a, b, c = (self._draw(-most, most) for _ in "xyz")
        return [
            x + w * a + y * c - z * b,
            y + w * b + z * a - x * c,
            z + w * c + x * b - y * a,
            w - x * a - y * b - z * c,
        ]


def varied_by(given: dict[str, Any] | None) -> Variation | None:
    """Return the variation for the given options; None if none applies to PyBullet."""
    if given is None:
        return None
    return Variation(**{name: value for name, value in given.items() if name != "options"})
