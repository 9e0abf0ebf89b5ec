"""Decides which properties must be read again after a call that changes a simulation."""

from __future__ import annotations

import os
from typing import Any

from .arguments import ARGUMENTS, body_of, number, values, vector
from .asked import asked_of, dampings_in
from .bodies import Loaded
from .functions import (
    CONSTRAINS,
    MAKES_BODIES,
    MOVES_ALL,
    RECOLOURS,
    REMOVES_BODIES,
    SETS_ENGINE,
    SHAPES,
)
from .links import MODELS, links_in, path_of
from .worlds import ALL, WatchedWorld

FIELD = 9
"""Shape type `GEOM_HEIGHTFIELD`."""
MERGE_FIXED_LINKS, ENABLE_SLEEPING = 1 << 19, 1 << 11
"""Flag bits of `loadURDF`."""


def before_change(world: WatchedWorld, name: str, arguments: dict[str, Any]) -> None:
    """Read the properties that a call is about to change, before they change."""
    if name == "changeDynamics" and arguments.keys() & {"mass", "localInertiaDiagonal"}:
        # Of a btRigidBody the inertia changes the mass, too: PyBullet takes it to be 0 then.
        body = body_of(arguments)
        if body is not None:
            world.before_mass(body)
    elif name in MOVES_ALL and world.moved:
        world.sync()


def after_change(world: WatchedWorld, name: str, arguments: dict[str, Any], result: Any) -> None:
    """Note which properties of a simulation must be read again after a call."""
    world.touched = True
    if name in MAKES_BODIES:
        _made_bodies(world, name, arguments, result)
    if name in REMOVES_BODIES:
        world.stale_bodies = True
    body = body_of(arguments)
    if name == "removeBody" and body is not None:
        world.fresh.discard(body)
    if name in CONSTRAINS or name in MAKES_BODIES or name in REMOVES_BODIES or name in MOVES_ALL:
        world.stale_constraints = True
    if name == "createConstraint":
        world.held.update([result] if isinstance(result, int) else [])
        world.sync(sample_follows=not world.sampled)  # it may hold new bodies
    if name in MOVES_ALL:
        world.moved[ALL] = set()
    if name == "changeDynamics":
        world.moved.setdefault(body, set())
        world.changed.add(body)
        world.may_sleep |= bool(arguments.keys() & {"activationState", "sleepThreshold"})
    if name in RECOLOURS and body is not None:
        world.recoloured.add(body)
    is_hull = not arguments.get("indices") and not _any(arguments.get("flags"))
    if name in SHAPES and isinstance(result, int) and is_hull:
        file, scale = arguments.get("fileName"), vector(arguments.get("meshScale"))
        if world.keeps_files and type(file) is str:
            path = path_of(file, world.search_path)
            if path is not None:
                world.tell_file(file, path)
        world.hulls[result] = file if type(file) is str else "", scale or [1.0] * 3
        world.fields.update([result] if number(arguments.get("shapeType", 0)) == FIELD else [])
    if name in SETS_ENGINE:
        _set_engine(world, name, arguments)


def _made_bodies(world: WatchedWorld, name: str, arguments: dict[str, Any], result: Any) -> None:
    world.stale_bodies = True
    body = body_of(arguments)
    if name == "unsupportedChangeScaling" and body is not None:
        world.fresh.add(body)
        return
    results = result if isinstance(result, tuple) else (result,)
    ids = [value for value in results if isinstance(value, int) and value >= 0]
    world.fresh.update(ids)
    hiding = _hiding(world, name, arguments, ids)
    for each in ids:
        loaded = world.loaded[each] = _loaded(name, arguments, world)
        loaded.hides_links = each in hiding
        world.may_sleep |= bool(loaded.flags & ENABLE_SLEEPING)
        world.added.pop(each, None)
    if arguments.get("useMaximalCoordinates") and len(ids) == 1:
        # PyBullet takes what is no vector for none.
        given = [vector(arguments.get(f"base{of}")) for of in ("Position", "Orientation")]
        world.loaded[ids[0]].inertial = world.inertial_of(ids[0], *given)


def _loaded(name: str, arguments: dict[str, Any], world: WatchedWorld) -> Loaded:
    loaded = Loaded()
    loaded.lists_shapes = name not in ("loadMJCF", "loadBullet")
    loaded.flags = number(arguments.get("flags", 0)) or 0
    scale = vector([arguments.get("globalScaling", 1.0)])
    loaded.scale = scale[0] if scale else 1.0
    if name == "createMultiBody":
        shapes = [number(arguments.get("baseCollisionShapeIndex", -1)) or 0]
        shapes += map(int, vector(arguments.get("linkCollisionShapeIndices")) or [])
        loaded.lists_shapes = world.fields.isdisjoint(shapes)
        loaded.hulls = all(shape < 0 or shape in world.hulls for shape in shapes)
        loaded.meshes = {
            link: world.hulls[shape]
            for link, shape in enumerate(shapes, -1)
            if shape in world.hulls
        }
    file = arguments.get(ARGUMENTS[name][0]) if name.startswith("load") else ""
    if type(file) is not str:
        return loaded
    loaded.file = os.path.basename(file)
    path = path_of(file, world.search_path) if file else None
    if world.keeps_files and path is not None:
        world.tell_file(file, path)
    if name == "loadMJCF":
        loaded.mjcf = os.path.abspath(path) if path else ""
        loaded.asked = {"dampings": dampings_in(path)} if path else None
    elif name == "loadURDF" and path:
        loaded.asked = asked_of(path)
        loaded.hulls = loaded.asked is not None and not loaded.asked["concave"]
    return loaded


def _hiding(world: WatchedWorld, name: str, arguments: dict[str, Any], ids: list[int]) -> list[int]:
    """Return those of the bodies created by a call whose links PyBullet does not list."""
    if name == "loadMJCF":
        rigid = not arguments.get("useMultiBody", 1)
    else:
        rigid = bool(arguments.get("useMaximalCoordinates"))
    if not rigid:
        return []
    if name not in MODELS:
        return ids if arguments.get("linkMasses") else []
    file = arguments.get(ARGUMENTS[name][0])
    path = path_of(file, world.search_path) if type(file) is str else None
    if path is None:
        return []
    merged = (number(arguments.get("flags", 0)) or 0) & MERGE_FIXED_LINKS
    try:
        links = links_in(path, name, merged=bool(merged) and name == "loadURDF")
    except OSError:
        return []
    if len(links) != len(ids):  # which model is which is not known
        links = [max(links, default=1)] * len(ids)
    return [each for each, count in zip(ids, links) if count > 1]


def _set_engine(world: WatchedWorld, name: str, arguments: dict[str, Any]) -> None:
    world.stale_engine = True
    if "reportSolverAnalytics" in arguments and name == "setPhysicsEngineParameter":
        value = int(arguments["reportSolverAnalytics"])
        if value >= 0:  # otherwise the engine leaves it unchanged
            world.solver.returns = bool(value & 1)
    if name in ("setPhysicsEngineParameter", "setDefaultContactERP"):
        world.given.update(values(arguments))


def _any(flags: Any) -> bool:
    """Return whether a flag, or any of several flags, is set."""
    several = vector(flags)
    return any(several) if several is not None else bool(number(flags))
