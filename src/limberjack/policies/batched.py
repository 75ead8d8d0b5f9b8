"""Policies that act in the rows of a batch, and their use in a single environment.

    actor = Batched("my_package:Damped", act_batch)
    actor.begin(spec, rows, seeds)             # episodes begin in these rows
    actions = actor.act(observation, rows)     # (num_envs, nu); zeros in other rows

A policy that acts on batches is an object, or a class without arguments, with

    act_batch(observations)       a dictionary of arrays of (64, ...) -> actions of (64, nu)
    reset_batch(rows, seeds)      optional: episodes with these seeds begin in these rows

It always receives 64 rows, and an episode is always in row `seed % 64`: rounding in a matrix
product depends on the number of rows and, in float32, on the row. An episode is therefore the same
whichever others are played beside it, and the same alone. Rows that are not in use, or whose
episode is over, are ignored.

A policy that acts on one observation is called for row after row, by `EachRow`.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

import numpy as np
from dm_env import specs

from limberjack.policies.kinds import Act, Locating, Policy, PolicyError

__all__ = ["ROWS", "Actor", "Batched", "EachRow", "alone"]

ROWS = 64  # rows of a batch: enough for all cores, and few enough that a kill loses little


class Actor(Protocol):
    """Acts in the rows of a batch."""

    def begin(self, spec: specs.BoundedArray, rows: np.ndarray, seeds: Sequence[int]) -> None:
        """Begins episodes with these seeds in these rows; `spec` is that of one action."""

    def act(self, observation: Mapping[str, np.ndarray], rows: np.ndarray) -> np.ndarray:
        """Actions, (num_envs, ...), of which only those of `rows` are used.

        Raises:
          PolicyError: one of them is not an action; the message has its seed and step.
        """
        ...


class EachRow:
    """A policy for one episode, begun separately in every row."""

    def __init__(self, policy: Policy) -> None:
        """Takes a policy whose episodes are independent of each other."""
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
        # Indexed by the environment's rows, which are not those that the policy receives.
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
            with Locating(f"policy {self._name!r}, before the episodes with seeds {list(seeds)}"):
                self._reset_batch(self._shown_in[rows], self._seeds[rows])

    def act(self, observation: Mapping[str, np.ndarray], rows: np.ndarray) -> np.ndarray:
        """See `Actor`."""
        places = self._shown_in[rows]
        shown = {n: _spread(values[rows], places) for n, values in observation.items()}
        with Locating(self._where(rows[0])):
            returned = self._act_batch(_like(observation, shown))
        returned = self._checked(returned, rows)
        self._steps[rows] += 1
        num_envs = len(next(iter(observation.values())))
        actions = np.zeros((num_envs, *self._shape))
        actions[rows] = returned
        return actions

    def _checked(self, returned: object, rows: np.ndarray) -> np.ndarray:
        """The policy's actions for these rows; raises PolicyError if they are invalid."""
        expected = (ROWS, *self._shape)
        try:
            actions = np.asarray(returned)
        except (TypeError, ValueError, RuntimeError) as error:  # ragged lists, tensors elsewhere
            raise PolicyError(
                f"{self._where(rows[0])}: returned something other than an array of numbers: "
                f"{error}"
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


def alone(
    name: str,
    act_batch: Callable[[Mapping[str, np.ndarray]], object],
    reset_batch: Callable[[np.ndarray, np.ndarray], object] | None = None,
) -> Policy:
    """A policy that acts on batches, in a single environment, with the same actions bit for bit."""

    def begin(spec: specs.BoundedArray, seed: int) -> Act:
        batched, row = Batched(name, act_batch, reset_batch), np.zeros(1, int)
        batched.begin(spec, row, [seed])

        def act(observation: Mapping[str, np.ndarray]) -> np.ndarray:
            of_batch = {name: np.asarray(value)[None] for name, value in observation.items()}
            return batched.act(_like(observation, of_batch), row)[0]

        return act

    return begin


def _like(
    observation: Mapping[str, np.ndarray], values: dict[str, np.ndarray]
) -> Mapping[str, np.ndarray]:
    """The values in a mapping of the observation's type, an OrderedDict in the suite."""
    return type(observation)(values)  # pyright: ignore[reportCallIssue] (mappings take mappings)


def _spread(values: np.ndarray, places: np.ndarray) -> np.ndarray:
    """64 rows with the values at their places, and copies of the first one in all others."""
    shown = np.repeat(values[:1], ROWS, axis=0)
    shown[places] = values
    return shown
