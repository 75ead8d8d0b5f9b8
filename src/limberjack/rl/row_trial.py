"""`Trial`: an environment that is examined before the rows of a batch are made.

    trial = Trial(build, seed=0, context={}, num_envs=16)
    trial.form.observation_spec, trial.form.action_spec, trial.draws_globally
    trial.compare(env, row=3, context={})       # raises unless the row has the same specs
    trial.close()

It takes a few steps, to see whether the environment draws from a random stream that all
environments share. The environment is not one of the rows.
"""

import collections
import contextlib
import dataclasses
import math
import random
from collections.abc import Callable, Iterator, Mapping
from typing import Self, cast

import dm_env
import numpy as np
from dm_env import specs

from limberjack.rl import guards
from limberjack.rl.action_specs import bounds_to_try, spec_of
from limberjack.rl.builds import Build, own_repeat, parts_of
from limberjack.rl.control import Environment
from limberjack.rl.copies import control_of, difference
from limberjack.rl.observations import FLAT_OBSERVATION_KEY
from limberjack.rl.shared_streams import GLOBAL_STREAMS, drawn_from
from limberjack.utils.log import log

__all__ = [
    "Form",
    "Trial",
    "control_timestep_of",
    "draws_globally",
    "model_of",
    "noted",
]

_TRIAL_STEPS = 3


@dataclasses.dataclass(frozen=True)
class Form:
    """The properties of an environment of any class that rows must have in common.

    Attributes:
      action_spec: see `action_specs.spec_of`.
      observation_spec: of each observation, by name.
      control_timestep: time between two control steps, seconds; NaN if it is not reported.
      action_repeat: control steps per action.
    """

    action_spec: specs.BoundedArray
    observation_spec: Mapping[str, specs.Array]
    control_timestep: float
    action_repeat: int

    @classmethod
    def of(cls, env: dm_env.Environment, name: str) -> Self:
        """The form of an environment; `name` is that of its class, or of what makes it.

        Raises:
          TypeError, ValueError: its actions or observations are of another kind than arrays.
        """
        observed = _named(env.observation_spec())
        if not all(isinstance(one, specs.Array) for one in observed.values()):
            raise TypeError(
                f"observation_spec of {name} is {observed!r}; expected a dm_env.specs.Array, or a "
                "mapping of them by name"
            )
        ordered = collections.OrderedDict(observed)
        return cls(spec_of(env), ordered, control_timestep_of(env), own_repeat(env))


class Trial:
    """An environment that is examined before the rows are made: specs and global streams."""

    def __init__(
        self, build: Build, seed: int, context: Mapping[str, object], num_envs: int
    ) -> None:
        with noted(0, context):
            env = build.make(seed, context)
        self._name = build.name
        self._env = env
        self._parts = {id(one): one for one in parts_of(env).values()}
        try:
            self.form = Form.of(env, build.name)
            self._check_memory(env, num_envs)
            before = model_of(env)
            self.draws_globally = draws_globally(env, self.form.action_spec)
            self.edits_model = model_of(env) != before
            # Again: an environment that has edited its model keeps a copy, textures included.
            self._check_memory(env, num_envs)
        except BaseException:
            env.close()
            raise

    def close(self) -> None:
        """Closes the environment."""
        self._env.close()

    def compare(self, env: dm_env.Environment, row: int, context: Mapping[str, object]) -> None:
        """Raises ValueError if a row has other specs or another control step, or shares a part."""
        for what, one in parts_of(env).items():
            if id(one) in self._parts:
                raise ValueError(
                    f"row {row} has the {what} of another environment that {self._name} made: "
                    "make a new one in each call, since rows are stepped independently"
                )
            self._parts[id(one)] = one  # kept, so that no id is used twice
        named = _named(env.observation_spec())
        action = env.action_spec()
        here, there = str(control_timestep_of(env)), str(self.form.control_timestep)  # of NaN, too
        found: list[tuple[str, object, object]] = [("control step", here, there)]
        found += [("actions", _form(action), _form(self.form.action_spec))]
        names = list(dict.fromkeys([*self.form.observation_spec, *named]))
        for name in names:
            pair = (_form(named.get(name)), _form(self.form.observation_spec.get(name)))
            found.append((f"observation {name!r}", *pair))
        for what, here, expected in found:
            if here != expected:
                given = f", made with {dict(context)}," if context else ""
                raise ValueError(
                    f"row {row}{given} has {what} of {here}; expected {expected}, as in row 0: the "
                    "rows of a batch must agree in their specs and control step"
                )

    def _check_memory(self, env: dm_env.Environment, num_envs: int) -> None:
        physics = getattr(control_of(env), "_physics", None)
        simulation = getattr(physics, "simulation", None)
        if simulation is None:
            seen = self.form.observation_spec.values()
            observed = [np.empty(spec.shape, spec.dtype) for spec in seen]
            guards.check_memory(num_envs, observed)
            return
        official = simulation.model._official
        shared = simulation.model._shared is not None
        more = 0 if shared else official.nbuffer
        guards.check_memory(num_envs, simulation.save(None, ()).values(), more)


@contextlib.contextmanager
def noted(row: int, context: Mapping[str, object]) -> Iterator[None]:
    """Adds the row and its context to an error of the function that makes environments."""
    try:
        yield
    except Exception as error:  # of any class: it is the user's code
        given = f", with the context {dict(context)}" if context else ""
        error.add_note(f"raised while the environment of row {row} was made{given}")
        raise


def draws_globally(env: dm_env.Environment, spec: specs.BoundedArray) -> str | None:
    """The global random stream that a few steps of an environment draw from, if there is one.

    A stream in a class attribute counts too. The streams are put back. An error of the
    environment is not raised here, but by the row.
    """
    stream = np.random.RandomState(0)
    low, high = bounds_to_try(spec)

    def play() -> None:
        try:
            env.reset()
            for _ in range(_TRIAL_STEPS):
                env.step(stream.uniform(low, high, spec.shape).astype(spec.dtype))
        except Exception as error:  # of any class: it is the user's code
            log.debug("the trial of %s ended early: %r", type(env).__name__, error)

    return drawn_from(_shared_streams(env), play)


def _shared_streams(env: dm_env.Environment) -> dict[str, object]:
    """The streams that environments of one class share, by name; modules stand for global ones."""
    found = dict(GLOBAL_STREAMS)
    inner = control_of(env)
    for one in (env, inner, getattr(inner, "_task", None), getattr(inner, "_physics", None)):
        for cls in type(one).__mro__:
            for name, value in vars(cls).items():
                if isinstance(value, np.random.RandomState | random.Random | np.random.Generator):
                    found[f"{cls.__name__}.{name}"] = value
    return found


def model_of(env: dm_env.Environment) -> object:
    """The identity of a plain environment's model, with its numbers; None for any other."""
    return env._origin() if difference(env) is None and isinstance(env, Environment) else None


def control_timestep_of(env: dm_env.Environment) -> float:
    """Time between two actions, seconds; NaN for an environment that does not report it."""
    of_env: Callable[[], float] | None = getattr(env, "control_timestep", None)
    if of_env is None:
        of_env = getattr(control_of(env), "control_timestep", None)
    return math.nan if of_env is None else float(of_env())


def _named(spec: object) -> Mapping[str, specs.Array]:
    """The specs of observations by name; a single one has the name of a flat observation."""
    named = spec if isinstance(spec, Mapping) else {FLAT_OBSERVATION_KEY: spec}
    return cast(Mapping[str, specs.Array], named)


def _form(spec: object) -> object:
    """Shape and dtype of a spec; None for no spec."""
    return None if spec is None else (getattr(spec, "shape", None), str(getattr(spec, "dtype", "")))
