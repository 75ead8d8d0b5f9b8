"""Policies that act in all rows of a batch.

    found = find("random")                  # or "MODULE:CALLABLE", "sb3:model.zip", "planner"
    if found.actor is not None:
        found.actor.begin(spec, rows, seeds)             # episodes begin in these rows
        actions = found.actor.act(observation, rows)     # (num_envs, nu); zeros in other rows

A policy that acts on batches is an object, or a class without arguments, with

    act_batch(observations)       a dictionary of arrays of (64, ...) -> actions of (64, nu)
    reset_batch(rows, seeds)      optional: episodes with these seeds begin in these rows

It is always shown 64 rows, and an episode always in row `seed % 64`: how a matrix product rounds
depends on the number of rows, and in float32 on which of them it is. Thus an episode is the same
whichever others are played. Rows that are not in use, or whose episode is over, do not count. All
else is what `limberjack.policies`
takes: a function of one observation is called for row after row; an object with `reset` has a state
of one episode, and plays one at a time.
"""

import dataclasses
import hashlib
import inspect
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Protocol

import numpy as np
from dm_env import specs

from limberjack import policies
from limberjack.policies import Act, Policy, PolicyError
from limberjack.rl.control import Environment
from limberjack.utils.sources import hash_of_files, hash_of_module, hash_of_source

__all__ = ["ROWS", "Actor", "Batched", "EachRow", "Found", "find"]

ROWS = 64  # of a batch: enough for all cores, and few enough that little is lost when killed

_SAVED = "sb3:"
_PLANNER = "planner"


class Actor(Protocol):
    """Acts in the rows of a batch."""

    def begin(self, spec: specs.BoundedArray, rows: np.ndarray, seeds: Sequence[int]) -> None:
        """Episodes with these seeds begin in these rows; `spec` is that of one action."""

    def act(self, observation: Mapping[str, np.ndarray], rows: np.ndarray) -> np.ndarray:
        """The actions, (num_envs, ...), of which those of `rows` count.

        Raises:
          PolicyError: one of them is no action; the message has its seed and step.
        """
        ...


@dataclasses.dataclass(frozen=True)
class Found:
    """A policy."""

    name: str
    sha256: str | None  # of its source or its file; None if that is not known
    actor: Actor | None  # None: it plays one episode at a time,
    alone: Policy | None  # as this


class EachRow:
    """A policy for one episode, begun for every row."""

    def __init__(self, policy: Policy) -> None:
        """Takes a policy whose episodes know nothing of each other."""
        self._policy = policy
        self._acts: dict[int, Act] = {}
        self._shape: tuple[int, ...] = ()

    def begin(self, spec: specs.BoundedArray, rows: np.ndarray, seeds: Sequence[int]) -> None:
        """See `Actor`."""
        self._shape = spec.shape
        for row, seed in zip(rows.tolist(), seeds, strict=True):
            self._acts[row] = self._policy(spec, seed)

    def act(self, observation: Mapping[str, np.ndarray], rows: np.ndarray) -> np.ndarray:
        """See `Actor`."""
        num_envs = len(next(iter(observation.values())))
        actions = np.zeros((num_envs, *self._shape))
        for row in rows.tolist():
            of_row = {name: values[row] for name, values in observation.items()}
            actions[row] = self._acts[row](_like(observation, of_row))
        return actions


class Batched:
    """A policy that acts on 64 rows at once."""

    def __init__(
        self,
        name: str,
        act_batch: Callable[[Mapping[str, np.ndarray]], object],
        reset_batch: Callable[[np.ndarray, np.ndarray], object] | None = None,
    ) -> None:
        """Takes the policy's functions; see the module's docstring."""
        self._name = name
        self._act_batch = act_batch
        self._reset_batch = reset_batch
        # By the environment's rows; those that the policy is shown are others.
        self._shown_in = np.zeros(ROWS, int)
        self._seeds = np.zeros(ROWS, np.int64)
        self._steps = np.zeros(ROWS, int)
        self._shape: tuple[int, ...] = ()

    def begin(self, spec: specs.BoundedArray, rows: np.ndarray, seeds: Sequence[int]) -> None:
        """See `Actor`."""
        self._shape = spec.shape
        self._seeds[rows] = seeds
        self._steps[rows] = 0
        self._shown_in[rows] = self._seeds[rows] % ROWS
        if self._reset_batch is not None:
            self._reset_batch(self._shown_in[rows], self._seeds[rows])

    def act(self, observation: Mapping[str, np.ndarray], rows: np.ndarray) -> np.ndarray:
        """See `Actor`."""
        places = self._shown_in[rows]
        shown = {n: _spread(values[rows], places) for n, values in observation.items()}
        try:
            returned = self._act_batch(_like(observation, shown))
        except Exception as error:
            error.add_note(self._where(rows[0]))
            raise
        returned = self._checked(returned, rows)
        self._steps[rows] += 1
        num_envs = len(next(iter(observation.values())))
        actions = np.zeros((num_envs, *self._shape))
        actions[rows] = returned
        return actions

    def _checked(self, returned: object, rows: np.ndarray) -> np.ndarray:
        """What the policy returned for these rows as an array, or `PolicyError`."""
        expected = (ROWS, *self._shape)
        try:
            actions = np.asarray(returned)
        except (TypeError, ValueError, RuntimeError) as error:  # ragged lists, tensors elsewhere
            raise PolicyError(
                f"{self._where(rows[0])}: returned what is no array of numbers: {error}"
            ) from error
        if actions.dtype.kind not in "iuf" or actions.shape != expected:
            raise PolicyError(
                f"{self._where(rows[0])}: returned {type(returned).__name__} of dtype "
                f"{actions.dtype} and shape {actions.shape}; expected numbers of shape {expected}, "
                f"for all {ROWS} rows"
            )
        actions = actions[self._shown_in[rows]]
        finite = np.isfinite(actions).reshape(len(rows), -1)
        if not finite.all():
            first = int(np.flatnonzero(~finite.all(axis=-1))[0])
            action, is_bad = actions[first].ravel(), ~finite[first]
            raise PolicyError(
                f"{self._where(rows[first])}: returned {action[is_bad][0]} at index "
                f"{np.flatnonzero(is_bad).tolist()}; expected finite numbers"
            )
        return actions

    def _where(self, row: int) -> str:
        step, seed = self._steps[row], self._seeds[row]
        return f"policy {self._name!r}, step {step} of the episode with seed {seed}"


def _like(
    observation: Mapping[str, np.ndarray], values: dict[str, np.ndarray]
) -> Mapping[str, np.ndarray]:
    """The values in a mapping of the observation's type, an OrderedDict in the suite."""
    return type(observation)(values)  # pyright: ignore[reportCallIssue] (mappings take mappings)


def _spread(values: np.ndarray, places: np.ndarray) -> np.ndarray:
    """64 rows with the values at their places, and copies of the first elsewhere."""
    shown = np.repeat(values[:1], ROWS, axis=0)
    shown[places] = values
    return shown


def find(policy: object, environment: Environment | None, num_threads: int | None = None) -> Found:
    """The policy of that name, or an object that MODULE:CALLABLE might name.

    Args:
      policy: 'zero', 'random', 'planner', 'MODULE:CALLABLE', 'sb3:PATH'; or the function, object
        or class itself.
      environment: that it is to act in; None where neither the planner nor a model is asked for.
      num_threads: that the planner simulates with; by default the cores that it may use.

    Raises:
      PolicyError: there is none, or it cannot be used here.
    """
    if not isinstance(policy, str):
        return _of_object(policies.name_of(policy), policy)
    if policy.startswith(_SAVED):
        return _of_saved_model(policy, environment)
    if policy == _PLANNER:
        return _of_planner(environment, num_threads)
    if ":" not in policy:
        found = policies.find(policy)
        return Found(policy, _hash(inspect.getsource(found).encode()), EachRow(found), None)
    found = _of_object(policy, policies._named(policy))
    return dataclasses.replace(found, sha256=hash_of_module(policy.partition(":")[0]))


def _of_object(name: str, target: object) -> Found:
    """A policy that is at hand."""
    sha256 = hash_of_source(target)
    if inspect.isclass(target):
        target = policies._make(name, target)
    act, reset = getattr(target, "act", target), getattr(target, "reset", None)
    act_batch = getattr(target, "act_batch", None)
    if act_batch is not None:
        reset_batch = getattr(target, "reset_batch", None)
        if reset is not None and reset_batch is None:
            raise PolicyError(
                f"policy {name!r} has act_batch and reset, which a batch never calls: write "
                "reset_batch(rows, seeds), called where episodes begin in some of the rows"
            )
        return Found(name, sha256, Batched(name, act_batch, reset_batch), None)
    if not callable(act):
        raise PolicyError(
            f"policy {name!r} is of type {type(target).__name__}; expected a function of an "
            "observation, or an object with act(observation) or act_batch(observations)"
        )
    policy = policies._user_policy(name, act, reset)
    if reset is not None:
        return Found(name, sha256, None, policy)
    return Found(name, sha256, EachRow(policy), None)


def _of_planner(environment: Environment | None, num_threads: int | None) -> Found:
    from limberjack.planner.library import sources_for

    assert environment is not None
    try:
        sources = sources_for(environment.task)
    except ValueError as error:
        raise PolicyError(f"policy {_PLANNER!r}: {error}") from error
    return Found(_PLANNER, hash_of_files(sources), None, policies.planner_with(num_threads))


def _of_saved_model(name: str, environment: Environment | None) -> Found:
    """The policy of a model that Stable-Baselines3 has saved."""
    assert environment is not None
    path = Path(name.removeprefix(_SAVED))
    try:
        from limberjack import sb3
    except ImportError as error:
        raise PolicyError(f"policy {name!r}: {error}") from None
    try:
        model = sb3.SavedPolicy(path, environment)
    except (OSError, ValueError) as error:
        raise PolicyError(f"policy {name!r}: {error}") from error
    sha256 = _hash(b"".join(file.read_bytes() for file in model.files))
    return Found(name, sha256, Batched(name, model.act_batch), None)


def _hash(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
