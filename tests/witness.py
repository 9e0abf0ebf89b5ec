"""An interpreter for `drop record --python` that also reports every simulation's final state.

`WITNESS` names the file that it tells it to. With `WITNESS_BLIND=1` the recorder's half in the
script's process reads nothing of the engine but its timestep, so that what reading does to a
simulation shows in where it ends.
"""

from __future__ import annotations

import hashlib
import importlib.util
import os
import struct
import sys
from pathlib import Path
from typing import Any

FIXED, SOFT = 4, 3
FOLDER = Path(__file__).resolve().parent


def interpreter(folder: Path) -> Path:
    """Write a wrapper program for this interpreter into a folder, and return its path."""
    path = folder / "python-witness"
    path.write_text(f'#!/bin/sh\nexec "{sys.executable}" "{FOLDER / "witness.py"}" "$@"\n')
    path.chmod(0o755)
    return path


def _numbers(p: Any, client: int) -> list[float]:
    """Return all positions and velocities that the engine reports."""
    values: list[Any] = []
    for index in range(p.getNumBodies(client)):
        body = p.getBodyUniqueId(index, client)
        if p.getDynamicsInfo(body, -1, client)[10] == SOFT:
            continue
        for vector in (
            *p.getBasePositionAndOrientation(body, client),
            *p.getBaseVelocity(body, client),
        ):
            values += vector
        for link in range(p.getNumJoints(body, client)):
            state = p.getLinkState(body, link, computeLinkVelocity=1, physicsClientId=client)
            for vector in (*state[:2], *state[6:8]):
                values += vector
            if p.getJointInfo(body, link, client)[2] != FIXED:
                for vector in p.getJointStateMultiDof(body, link, client)[:2]:
                    values += vector
    return [float(one) for one in values]


class _Witness:
    def __init__(self, path: str) -> None:
        self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)

    def tell(self, world: Any) -> None:
        try:
            values = _numbers(world._p, world.client)
        except Exception as error:  # the recorder would take it for a fault of the engine
            os.write(self._file, f"cannot be read: {error!r}\n".encode())
            raise
        digest = hashlib.sha256(struct.pack(f"<{len(values)}d", *values)).hexdigest()
        os.write(self._file, f"{world.step} {len(values)} {digest}\n".encode())


def _install(handlers: Any, worlds: Any, witness: _Witness, *, blind: bool) -> None:
    end, resetting = worlds.WatchedWorld.end, handlers.resetting

    def told_end(world: Any) -> None:
        witness.tell(world)
        end(world)

    def told_resetting(watch: Any, name: str, original: Any) -> Any:
        def reset(*args: Any, **kwargs: Any) -> Any:
            for world in list(watch.worlds.values()):
                witness.tell(world)
            return original(*args, **kwargs)

        reset.__name__ = name
        return resetting(watch, name, reset)

    worlds.WatchedWorld.end, handlers.resetting = told_end, told_resetting
    if not blind:
        return

    def look_away(world: Any, **_: Any) -> None:
        if world.stale_engine:  # the clock goes by the timestep
            world.sync_engine()
        world.moved = {}

    def count(world: Any, _: Any) -> None:
        world.step += 1
        world._steps_since += 1
        world.time_s = world._since + world._steps_since * world.timestep_s

    worlds.WatchedWorld.sync = worlds.WatchedWorld.before_step = look_away
    worlds.WatchedWorld.after_step = count
    worlds.WatchedWorld.sample = lambda _: None


def main() -> None:
    """Emulate `python WATCHING MODULE …`, and report the simulations' final states."""
    del sys.path[0], sys.argv[0]
    path = Path(sys.argv[0], "__main__.py")
    spec = importlib.util.spec_from_file_location("_drop_watching_main", path)
    assert spec is not None
    assert spec.loader is not None
    watching = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(watching)
    running = watching._module(sys.argv[1])
    witness = _Witness(os.environ["WITNESS"])
    bullet = f"{watching._PACKAGE}.pybullet.watch"
    modules = (importlib.import_module(f"{bullet}.{name}") for name in ("handlers", "worlds"))
    _install(*modules, witness, blind=os.environ.get("WITNESS_BLIND") == "1")
    running.main(*sys.argv[2:])


if __name__ == "__main__":
    main()
