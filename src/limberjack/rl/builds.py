"""`Build`: makes environments that begin the first episode of a given seed.

    build = Build.of(environment)           # from copies of an environment, which is not changed
    build = Build.of(make)                  # make(seed), and make(seed, **context) with a context
    seeded = build.seeded(3)
    seeded.environment.reset()              # the first episode of seed 3
    seeded.begin(7)
    seeded.environment.reset()              # the first episode of seed 7

A plain `control.Environment` is given another seed in place: its stream and the model fields that
belong to it are drawn again, and what its task remembers is put back. Any other is made again.
"""

import contextlib
import copy
import functools
import inspect
from collections.abc import Callable, Iterable, Mapping
from typing import Any, cast

import dm_env
import numpy as np

from limberjack.rl.action_specs import bounds_to_try, spec_of
from limberjack.rl.contract import PhysicsError
from limberjack.rl.control import Environment
from limberjack.rl.copies import check_copies, control_of, copied, difference
from limberjack.rl.frozen import Alike
from limberjack.rl.memory import Memory, put_back, remembered
from limberjack.rl.observations import specs_of
from limberjack.rl.references import ATOMS, STREAMS, attributes_of, reachable
from limberjack.utils.seeds import checked_seed

__all__ = [
    "Build",
    "Make",
    "Seeded",
    "holder_of",
    "is_reproducible",
    "is_stable",
    "numbers_of",
    "own_repeat",
    "parts_of",
    "physics_of",
    "settable",
    "takes_a_seed",
    "task_name",
]

# Makes an environment whose first episode belongs to its seed.
Make = Callable[..., dm_env.Environment]

_OTHER_SEED = 1  # added to a seed, to compare what a function makes of two
_STEPS_OF_AN_OPENING = 10
_HAND_ON = (
    "hand its seed on to the task, as in suite.load(domain, task, {'random': seed}), and draw from "
    "task.random"
)


class Build:
    """See the module's docstring."""

    def __init__(self, make: Make, name: str, original: dm_env.Environment | None = None) -> None:
        """Takes the function; `name` is used in messages.

        Args:
          make: called with a seed, and with the context of a row as keywords.
          name: of the function, or of the environment's class.
          original: the environment that is copied, if that is what `make` does.
        """
        self._make = make
        self.name = name
        self.original = original
        self.seeds: tuple[int, ...] = ()  # see `for_seeds`
        # By seed, and the seeds that it is for.
        self._are_stable: dict[tuple[int, tuple[int, ...]], bool] = {}

    @classmethod
    def of(cls, given: object) -> "Build":
        """The build of an environment, by copying it, or of a function of a seed.

        Raises:
          TypeError: it is neither; or copies of the environment would share state with it.
        """
        if isinstance(given, Build):
            return given
        if isinstance(given, dm_env.Environment):
            check_copies(given)
            inner = control_of(given)
            if not isinstance(inner, Environment):
                raise TypeError(
                    f"this {type(given).__name__} contains no control.Environment, so it cannot be "
                    "given a seed; pass a function build(seed) that makes it instead"
                )
            copies = _Copies(copied(given))
            original = given if isinstance(given, Environment) else None
            return cls(copies, type(given).__name__, original)
        if not callable(given):
            raise TypeError(
                f"got {given!r}; expected a dm_env.Environment or a function build(seed) that "
                "makes one"
            )
        make = cast(Make, given)  # `make` checks what it returns
        if not takes_a_seed(make, alone=False):
            raise TypeError(
                f"{given!r} cannot be called with a seed; expected a function build(seed) that "
                "makes an environment"
            )
        return cls(make, getattr(given, "__qualname__", type(given).__name__))

    @classmethod
    def of_instance(cls, environment: dm_env.Environment) -> "Build":
        """The build of an environment that is used itself, by copying it as it is now.

        If copies would share state with it, making one raises the TypeError of `of`.
        """
        try:
            return cls.of(environment)
        except TypeError as error:
            refuse = functools.partial(_refuse, str(error))
            return cls(refuse, type(environment).__name__)

    @property
    def copies(self) -> bool:
        """Whether it copies an environment instead of calling a user's function."""
        return isinstance(self._make, _Copies)

    def make(self, seed: int, context: Mapping[str, object] | None = None) -> dm_env.Environment:
        """A new environment.

        Raises:
          TypeError: the function made something else.
        """
        made = self._make(checked_seed(seed), **(context or {}))
        if not isinstance(made, dm_env.Environment):
            raise TypeError(
                f"{self.name}({seed}) made a {type(made).__name__}; expected a dm_env.Environment, "
                "such as a limberjack.rl.control.Environment"
            )
        return made

    def for_seeds(self, seeds: Iterable[int]) -> "Build":
        """The same, of which `is_stable` compares the environments of these seeds as well."""
        other = copy.copy(self)
        other.seeds = tuple(seeds)
        return other

    def seeded(
        self,
        seed: int,
        context: Mapping[str, object] | None = None,
        stable: bool | None = None,
    ) -> "Seeded":
        """An environment that begins with the first episode of a seed, and can begin another's.

        Args:
          seed: of the first episode.
          context: keywords for the function.
          stable: the result of `is_stable`, which is called by default; if False, it is made again
            for each seed.
        """
        if stable is None:
            stable = not context and is_stable(self, seed)
        return Seeded(self, self.make(seed, context), dict(context or {}), stable)


def _refuse(reason: str, seed: int) -> dm_env.Environment:
    """Raises the reason why an environment has no copies."""
    del seed
    raise TypeError(reason)


class _Copies:
    """Makes copies of an environment, each with another seed."""

    def __init__(self, original: dm_env.Environment) -> None:
        self._original = original

    def __call__(self, seed: int) -> dm_env.Environment:
        made = copied(self._original)
        inner = control_of(made)
        assert isinstance(inner, Environment)
        inner.reseed(seed)
        return made


class Seeded:
    """An environment that can begin the first episode of any seed.

    Attributes:
      environment: the environment; `begin` may replace it.
      is_plain: whether it is a `control.Environment` without methods or attributes of its own.
      attributes: values by name that are set on each environment that is made.
    """

    def __init__(
        self,
        build: Build,
        environment: dm_env.Environment,
        context: dict[str, object],
        is_stable: bool | None,
    ) -> None:
        """Takes an environment before its first episode, and the build of later ones.

        Args:
          build: makes the environments that take its place.
          environment: the environment.
          context: keywords for `build`.
          is_stable: the result of the function `is_stable`; None to call it when it is needed.
        """
        self._build = build
        self._is_stable = is_stable
        self._context = context
        self.attributes: dict[str, object] = {}
        self.environment = environment
        self.is_plain = difference(self.environment) is None
        self._first: Memory = {}
        self._numbers: object = None  # of the model
        plain = self.plain
        if plain is not None and is_stable is not False:
            self._numbers = numbers_of(plain)
            try:
                self._first = remembered(plain.task, plain.physics)
            except TypeError:  # an attribute cannot be copied: made again for each seed
                self._is_stable = False

    @property
    def plain(self) -> Environment | None:
        """The environment if it is plain; None otherwise."""
        env = self.environment
        return env if self.is_plain and isinstance(env, Environment) else None

    def begin(self, seed: int, keeps_model: bool = False) -> None:
        """Makes the next episode the first one of a seed.

        Args:
          seed: of the episode.
          keeps_model: whether a plain environment keeps a model that was edited; by default it is
            made again.

        Raises:
          TypeError: the environment must be made again, and cannot be copied; nothing has changed.
          Exception: any that `build` raises; nothing has changed.
        """
        plain = self.plain
        if plain is not None and self._is_stable is None:
            self._is_stable = is_stable(self._build, seed)
        # A model that has other numbers than at first, except for declared fields, is made again.
        is_kept = plain is not None and self._is_stable
        if plain is not None and is_kept and (keeps_model or numbers_of(plain) == self._numbers):
            put_back(self._first, plain.task, plain.physics)
            plain.reseed(seed)
            return
        made = self._build.make(seed, self._context)
        for name, value in self.attributes.items():
            setattr(holder_of(made, name), name, copy.deepcopy(value))
        self.environment.close()
        self.environment = made

    def replace(self, env: dm_env.Environment) -> None:
        """Takes another environment, such as a saved one."""
        self.environment.close()
        self.environment = env
        self.is_plain = difference(env) is None

    def set_attribute(self, name: str, value: object) -> None:
        """Sets an attribute of the environment or its task, and of those made for later seeds."""
        inner = control_of(self.environment)
        task = getattr(inner, "_task", None)
        before = attributes_of(task)
        setattr(holder_of(self.environment, name), name, value)
        self.attributes[name] = copy.deepcopy(value)  # the task may change its own in place
        if isinstance(inner, Environment):
            inner.keep_as_first(name)
        if "task" in self._first:  # whose values a reset with a seed puts back
            # A property may set attributes of other names.
            is_set = {
                one: copy.deepcopy(kept)
                for one, kept in attributes_of(task).items()
                if one == name or one not in before or before[one] is not kept
            }
            self._first = {**self._first, "task": {**self._first["task"], **is_set}}
        self.is_plain = difference(self.environment) is None


def holder_of(env: dm_env.Environment, name: str) -> object:
    """The environment, or its task if only that has the attribute."""
    task = getattr(control_of(env), "_task", None)
    return task if hasattr(task, name) and not hasattr(env, name) else env


def task_name(env: dm_env.Environment) -> str:
    """The name of an environment's task, such as 'humanoid:walk', or else its class."""
    inner = control_of(env)
    name = inner._ours.name if isinstance(inner, Environment) else ""
    return name or type(getattr(inner, "_task", env)).__name__


def own_repeat(env: dm_env.Environment) -> int:
    """Control steps per action that an environment makes by itself."""
    inner = control_of(env)
    return inner._ours.action_repeat if isinstance(inner, Environment) else 1


def physics_of(env: dm_env.Environment) -> Any:  # of the domain's own class
    """The physics of an environment, or of the `control.Environment` within it.

    Raises:
      TypeError: it has none.
    """
    for one in (env, control_of(env)):
        physics = getattr(one, "physics", None)
        if physics is not None:
            return physics
    raise TypeError(f"a {type(env).__name__} has no physics to draw: use the environment itself")


def settable(env: dm_env.Environment) -> Environment:
    """The environment, if its state can be set.

    Raises:
      TypeError: it cannot.
    """
    if isinstance(env, Environment):
        return env
    raise TypeError(
        f"a {type(env).__name__} cannot begin in a given state; expected a "
        "limberjack.rl.control.Environment or a subclass, or a Snapshot; nothing was reset"
    )


def is_stable(build: Build, seed: int) -> bool:
    """Whether an environment that is given another seed equals one that is made with it.

    The model, the attributes of the task, the time limit, the control step and the stream of the
    environment of this seed are compared with those of a seed beside it, and of the seeds that the
    build is for. False for environments that are not plain.

    Raises:
      ValueError: the function hands the seed on to no random stream.
    """
    if build.copies:
        return True
    key = seed, build.seeds
    if key not in build._are_stable:
        build._are_stable[key] = _is_stable(build, seed)
    return build._are_stable[key]


def _is_stable(build: Build, seed: int) -> bool:
    another = seed - _OTHER_SEED if seed else seed + _OTHER_SEED
    one, other = build.make(seed), build.make(another)
    ids = [{id(part) for part in parts_of(env).values()} for env in (one, other)]
    if ids[0] & ids[1]:  # neither can be closed without the other
        return False
    with contextlib.closing(one), contextlib.closing(other):
        stream = _stream(one)
        if stream is not None and stream == _stream(other):
            raise ValueError(
                f"{build.name} makes environments with the same random stream for seeds {seed} and "
                f"{another}: {_HAND_ON}"
            )
        first = _settings(one)
        is_alike = _is_alike(one, other, another, first) and _start(one) == _start(other)
    if not is_alike:
        with contextlib.closing(build.make(seed)) as again:
            if _stream(again) != stream:
                raise ValueError(
                    f"{build.name} makes an environment that differs each time it is called with "
                    f"seed {seed}: {_HAND_ON}"
                )
        return False
    others = sorted({*build.seeds} - {seed, another})
    if not others:
        return True
    with contextlib.closing(build.make(seed)) as one:
        for another in others:
            with contextlib.closing(build.make(another)) as other:
                if not _is_alike(one, other, another, first):
                    return False
    return True


def _is_alike(
    one: dm_env.Environment, other: dm_env.Environment, seed: int, settings: object
) -> bool:
    """Whether an environment is another one with these settings, once it is given its seed."""
    if difference(one) is not None or difference(other) is not None:
        return False
    assert isinstance(one, Environment)
    if _has_other_streams(one) or settings != _settings(other):
        return False
    one.reseed(seed)
    return _stream(one) == _stream(other)


def _stream(env: dm_env.Environment) -> object:
    """The state of the task's random stream; None without one."""
    stream = _of_task(env)
    if stream is None:
        return None
    _, key, *others = stream.get_state()
    return np.asarray(key).tobytes(), *others


def is_reproducible(build: Build, seed: int) -> bool:
    """Whether two environments that are made with one seed are the same, and play the same."""
    openings = []
    for _ in range(2):
        with contextlib.closing(build.make(seed)) as env:
            # A class that is defined as the environment is made is another object each time.
            openings.append((_settings(env, _name_of), _start(env), _opening(env)))
    return openings[0] == openings[1]


def _opening(env: dm_env.Environment) -> object:
    """The rewards and observations of a few steps after a reset, until the simulation diverges."""
    spec, stream = spec_of(env), np.random.RandomState(0)
    low, high = bounds_to_try(spec)
    found: list[tuple[bytes, dict[object, bytes]]] = []
    with contextlib.suppress(PhysicsError):
        for _ in range(_STEPS_OF_AN_OPENING):
            step = env.step(stream.uniform(low, high, spec.shape).astype(spec.dtype))
            found.append((np.asarray(step.reward).tobytes(), _bytes_of(step.observation)))
    return found


def parts_of(env: dm_env.Environment) -> dict[str, object]:
    """The parts of an environment that no other one may share, by name."""
    inner = control_of(env)
    parts = {name: getattr(inner, f"_{name}", None) for name in ("task", "physics")}
    parts |= {"environment": inner or env}
    return {name: one for name, one in parts.items() if one is not None}


def _settings(env: dm_env.Environment, kind: Callable[[object], object] = type) -> object:
    """The parts of an environment; `kind` gives what stands for the class of an object."""
    if difference(env) is not None:
        return None
    assert isinstance(env, Environment)
    task, physics, ours = env.task, env.physics, env._ours
    own = [env, ours, task, physics, _of_task(env), *vars(physics).values()]
    alike = Alike(kind, {id(one) for one in own if not isinstance(one, (*ATOMS, tuple))})
    parts = attributes_of(task), attributes_of(physics), ours.randomizer, Environment.world.of(env)
    numbers = env._step_limit, env.control_timestep(), ours.action_repeat, env._flat_observation
    legacy = getattr(physics, "legacy_step", None)
    return kind(task), kind(physics), *map(alike, parts), numbers, legacy, numbers_of(env)


def _name_of(value: object) -> tuple[str, str]:
    return type(value).__module__, type(value).__qualname__


def _of_task(env: dm_env.Environment) -> np.random.RandomState | None:
    """The task's random stream; None without one."""
    stream = getattr(getattr(control_of(env), "_task", None), "random", None)
    return stream if isinstance(stream, np.random.RandomState) else None


def _has_other_streams(env: Environment) -> bool:
    """Whether a task or its physics keeps a stream besides the task's, which has another seed."""
    stream = _of_task(env)
    known = {id(one) for one in (stream, getattr(stream, "_bit_generator", None))}
    kept = (
        part for owner in (env.task, env.physics) for _, part in reachable(attributes_of(owner))
    )
    return any(isinstance(one, STREAMS) and id(one) not in known for one in kept)


def numbers_of(env: Environment) -> object:
    """The identity of a model, without the fields that are set per episode."""
    return env.physics.identity(env._saved_fields()) if hasattr(env.physics, "identity") else None


def _start(env: dm_env.Environment) -> object:
    observed = _bytes_of(env.reset().observation)
    get_state = getattr(getattr(control_of(env), "physics", None), "get_state", None)
    state = b"" if get_state is None else get_state().tobytes()
    return state, observed


def _bytes_of(observation: object) -> dict[object, bytes]:
    named = observation if isinstance(observation, Mapping) else {"": observation}
    _ = specs_of(named)  # the bytes of what is nested would be addresses
    return {name: np.asarray(value).tobytes() for name, value in named.items()}


def takes_a_seed(make: Callable[..., object], alone: bool = True) -> bool:
    """Whether a function can be called with one argument, alone or with keywords."""
    try:
        signature = inspect.signature(make)
        _ = signature.bind(0) if alone else signature.bind_partial(0)
    except TypeError:
        return False
    except ValueError:  # a built-in function without a readable signature: a call may still work
        return True
    return True
