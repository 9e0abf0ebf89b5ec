"""Watches gymnasium environments, by wrapping `reset` and `step`, to report episodes.

Both methods of all classes of environments are wrapped. If they call each other, as gymnasium's
wrappers do, only the outermost call counts: a time limit around an environment belongs to the same
episode as the environment itself (`unwrapped`).
"""

from __future__ import annotations

import operator
import threading
from contextlib import suppress
from functools import partial, update_wrapper
from types import FunctionType, MethodType, ModuleType
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

from .hidden import hide

if TYPE_CHECKING:
    from .host import EngineWatch, ScriptWatch

MODULES = ("gymnasium", "gym")
RANGES = ("z", "angle", "state")
"""Quantities for which gymnasium's MuJoCo environments define a healthy range."""
LONGEST = 100
"""Largest number of characters of a reason."""


class EpisodeReturns:
    """Rewards and length of an episode so far."""

    def __init__(self) -> None:
        self.length = 0
        """Number of calls of `step`."""
        self.reward = 0.0
        """Sum of the rewards."""
        self.how = ""
        """How the episode ended: `terminated`, `truncated`, `reset` or `run`; empty while it
        continues."""
        self.engine: EngineWatch | None = None
        self.world = -1
        """The simulation stepped by the episode's last step, and its engine."""


class _Inside(threading.local):
    """The stack of wrapped methods that a thread is running, since they call each other."""

    def __init__(self) -> None:
        self.methods: list[Any] = []
        self.resets: list[Any] = []


class Environments:
    """The gymnasium environments of a watched script.

    Parameters
    ----------
    host
        The watch of the script.
    """

    def __init__(self, host: ScriptWatch) -> None:
        self._host = host
        self._inside = _Inside()
        self._now: WeakKeyDictionary[Any, EpisodeReturns] = WeakKeyDictionary()
        """The latest episode of each environment."""
        self.episodes: list[EpisodeReturns] = []
        """All episodes, in the order of their first steps."""

    def listen(self) -> None:
        """Wrap the environments' methods once their module is imported."""
        for name in MODULES:
            self._host.on_import(name, self._install)

    @property
    def running(self) -> int:
        """The index of the current episode, or of the one whose first step is being made."""
        last = len(self.episodes) - 1
        return last + bool(last < 0 or self.episodes[last].how)

    def outcome(self, only: int | None = None) -> dict[str, Any]:
        """Return reward, length and ending of episodes, for use in an expectation.

        If no episode has ended, the values are those of the current one.

        Parameters
        ----------
        only
            The index of the only episode to include; None for all.
        """
        episodes = self.episodes if only is None else self.episodes[only : only + 1]
        ended = [each for each in episodes if each.how not in ("", "run")] or episodes
        if not ended:
            return {}
        return {
            "terminated": any(each.how == "terminated" for each in ended),
            "reward": sum(each.reward for each in ended) / len(ended),
            "length": min(each.length for each in ended),
        }

    def settle(self) -> None:
        """Report episodes that are unfinished when the script ends."""
        for episode in self.episodes:
            if not episode.how:
                self._end(episode, "run")

    def _install(self, module: ModuleType) -> None:
        base, host = module.Env, self._host
        known = [base]
        for each in known:
            self._replace(each)
            known += each.__subclasses__()

        def init_subclass(cls: Any, /, **given: Any) -> None:
            super(base, cls).__init_subclass__(**given)
            if host.on:
                self._replace(cls)

        if "__init_subclass__" not in vars(base):
            base.__init_subclass__ = classmethod(init_subclass)
            host.on_removal(lambda: delattr(base, "__init_subclass__"))

    def _replace(self, cls: type) -> None:
        for name, then in (("step", self._stepped), ("reset", self._reset)):
            original = vars(cls).get(name)
            if isinstance(original, FunctionType):
                setattr(cls, name, _Method(self, original, then))
                self._host.on_removal(partial(setattr, cls, name, original))

    def call(self, original: Any, then: Any, args: Any, kwargs: Any) -> Any:
        """Call an environment's method; if it is the outermost call, report the result."""
        inside = self._inside
        if not self._host.on or not args or then in inside.methods or self._reset in inside.methods:
            return original(*args, **kwargs)
        if inside.methods:  # a reset within a step, which ends the episode first
            result = original(*args, **kwargs)
            inside.resets.append(args[0])
            return result
        inside.methods.append(then)
        try:
            result = original(*args, **kwargs)
        except BaseException as error:
            hide(error)
            raise
        finally:
            inside.methods.pop()
        self._guarded(then, args[0], result)
        while inside.resets:
            self._guarded(self._reset, inside.resets.pop(0), None)
        return result

    def _guarded(self, then: Any, environment: Any, result: Any) -> None:
        try:
            then(environment, result)
        except Exception:  # noqa: BLE001 - one that returns something else is not followed
            self._now.pop(getattr(environment, "unwrapped", None), None)

    def _reset(self, environment: Any, _: Any) -> None:
        inner = environment.unwrapped
        episode = self._now.get(inner)
        if episode is not None and episode.length and not episode.how:
            self._end(episode, "reset")
        begun = EpisodeReturns()
        if episode is not None and episode.engine is not None:
            begun.engine, begun.world = episode.engine, episode.world
            self._tell(begun, how="begins")
        self._now[inner] = begun

    def _stepped(self, environment: Any, result: Any) -> None:
        inner = environment.unwrapped
        episode = self._now.get(inner)
        if episode is None or episode.how:
            return
        reward, info = float(result[1]), result[-1]
        terminated = bool(result[2])
        truncated = bool(result[3]) if len(result) == 5 else False
        if len(result) == 4 and terminated and info.get("TimeLimit.truncated"):  # gym before 0.26
            terminated, truncated = False, True
        if not episode.length:
            self.episodes.append(episode)
        episode.length += 1
        episode.reward += reward
        engine = self._host.engine
        if engine is not None:
            episode.engine, episode.world = engine, engine.stepped
        if terminated or truncated:
            self._end(
                episode,
                "terminated" if terminated else "truncated",
                why=_why(inner, info)[:LONGEST] if terminated else "",
                success=_success(info),
            )

    def _end(
        self, episode: EpisodeReturns, how: str, why: str = "", *, success: bool | None = None
    ) -> None:
        episode.how = how
        self._tell(
            episode,
            how=how,
            why=why,
            length=episode.length,
            reward=episode.reward,
            success=success,
        )

    def _tell(self, episode: EpisodeReturns, **what: Any) -> None:
        if episode.engine is not None and not self._host.pipe.muted:
            episode.engine.tell_episode(world=episode.world, **what)


class _Method:
    """A wrapper for an environment's method, which pickles as the original method."""

    def __init__(self, environments: Environments, original: Any, then: Any) -> None:
        update_wrapper(self, original)
        self._environments, self._original, self._then = environments, original, then

    def __get__(self, instance: Any, owner: Any = None) -> Any:
        return self if instance is None else MethodType(self, instance)

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        return self._environments.call(self._original, self._then, args, kwargs)

    def __reduce__(self) -> Any:
        return operator.itemgetter(0), ((self._original,),)


def _success(info: Any) -> bool | None:
    """Return whether an environment reports that its goal is reached; None without a report."""
    for name in ("is_success", "success"):
        if name in info:
            return bool(info[name])
    return None


def _why(environment: Any, info: Any) -> str:
    """Return why an episode ended, if the environment's state and `info` show the reason."""
    said = [name for name, value in info.items() if _is_true(value)]
    with suppress(Exception):  # another kind of environment
        said += _unhealthy(environment)
    return ", ".join(said)


def _is_true(value: Any) -> bool:
    return type(value).__name__ in ("bool", "bool_") and bool(value)


def _unhealthy(environment: Any) -> list[str]:
    """Return the quantities outside the ranges that a gymnasium environment calls healthy."""
    model, data = environment.model, environment.data
    rooted = int(model.jnt_type[0]) == 0  # mjJNT_FREE: x, y and z; else x, z and the pitch
    values = {
        "z": [data.qpos[2 if rooted else 1]],
        "angle": [] if rooted else [data.qpos[2]],
        "state": [*data.qpos[2:], *data.qvel],
    }
    said = []
    for name in RANGES:
        bounds: Any = getattr(environment, f"_healthy_{name}_range", None)
        for number in map(float, values[name] if bounds else ()):
            low, high = bounds
            if not low < number < high:
                below = number <= low or number != number
                bound, sign = (low, "<") if below else (high, ">")
                said.append(f"{name} {_beyond(number, float(bound), sign)}")
    return said[:3]


def _beyond(number: float, bound: float, sign: str) -> str:
    """Describe a number beyond a bound, with enough digits to distinguish the two."""
    digits = next((n for n in range(3, 18) if f"{number:.{n}g}" != f"{bound:.{n}g}"), 3)
    return f"{number:.{digits}g} {sign if number != bound else sign + '='} {bound:.{digits}g}"
