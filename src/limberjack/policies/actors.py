"""The kinds of actors: a policy for each row, one for 64 rows at once, one that plays alone.

    actor = Batched("my_package:Damped", sha256, act_batch)
    actor.begin(batch, rows, seeds)            # episodes begin in these rows
    actions = actor.act(observation, rows)     # (num_envs, nu); zeros in other rows

A policy that acts on batches is an object, or a class without arguments, with

    act_batch(observations)       a dictionary of arrays of (64, ...) -> actions of (64, nu)
    reset_batch(rows, seeds)      optional: episodes with these seeds begin in these rows

It always receives 64 rows, and an episode is always in row `seed % 64`: rounding in a matrix
product depends on the number of rows and, in float32, on the row. An episode is therefore the same
whichever others are played beside it, and the same alone. Rows that are not in use, or whose
episode is over, are ignored.

A policy that acts on one observation is called for row after row (`EachRow`). An object that keeps
the state of an episode, and the planner, which needs the environment, play one episode at a time
(`Alone`).
"""

from collections.abc import Callable, Mapping, Sequence

import dm_env
import numpy as np
from dm_env import specs

from limberjack.policies.kinds import ROWS, Act, Actor, BeginAlone, Locating, Policy, PolicyError
from limberjack.rl.action_specs import spec_of
from limberjack.rl.batch_contract import Batch
from limberjack.rl.rows import RowsEnvironment

__all__ = [
    "ActBatch",
    "Alone",
    "Batched",
    "Deferred",
    "EachRow",
    "ResetBatch",
    "as_numbers",
    "check_numbers",
]

ActBatch = Callable[[Mapping[str, np.ndarray]], object]
ResetBatch = Callable[[np.ndarray, np.ndarray], object]


class EachRow:
    """A policy for one episode, begun separately in every row."""

    plays_alone = False
    action_repeat: int | None = None

    def __init__(self, name: str, sha256: str | None, policy: Policy) -> None:
        """Takes a policy whose episodes are independent of each other."""
        self.name = name
        self.sha256 = sha256
        self._policy = policy
        self._acts: dict[int, Act] = {}
        self._actions = np.zeros(0)  # of all rows

    def begin(self, batch: Batch, rows: np.ndarray, seeds: Sequence[int]) -> None:
        """See `Actor`."""
        spec = batch.single_action_spec()
        self._actions = _no_actions(spec, batch.num_envs)
        for row, seed in zip(rows.tolist(), seeds, strict=True):
            self._acts[row] = self._policy(spec, seed)

    def act(self, observation: Mapping[str, np.ndarray], rows: np.ndarray) -> np.ndarray:
        """See `Actor`."""
        actions = np.zeros_like(self._actions)
        for row in rows.tolist():
            actions[row] = self._acts[row](_of_row(observation, row))
        return actions

    def begin_alone(self, environment: dm_env.Environment, seed: int) -> Act:
        """See `Actor`."""
        return self._policy(_spec_of(environment, self.name), seed)


class Alone:
    """A policy that plays one episode at a time.

    It acts in the environment itself, a batch's only row.
    """

    plays_alone = True

    def __init__(
        self,
        name: str,
        sha256: str | None,
        begin_alone: BeginAlone,
        action_repeat: int | None = None,
    ) -> None:
        """Takes the function that begins an episode in an environment; see `Actor`."""
        self.name = name
        self.sha256 = sha256
        self.action_repeat = action_repeat
        self._begin_alone = begin_alone
        self._act: Act | None = None

    def begin(self, batch: Batch, rows: np.ndarray, seeds: Sequence[int]) -> None:
        """See `Actor`.

        Raises:
          PolicyError: the batch has more than one row, or is vectorised.
        """
        if not isinstance(batch, RowsEnvironment) or batch.num_envs != 1:
            raise PolicyError(
                f"policy {self.name!r} plays one episode at a time; expected a batch of one row "
                "that is not vectorised"
            )
        self._act = self.begin_alone(batch.environments[0], seeds[0])

    def act(self, observation: Mapping[str, np.ndarray], rows: np.ndarray) -> np.ndarray:
        """See `Actor`."""
        assert self._act is not None  # `begin` comes first
        return np.asarray(self._act(_of_row(observation, 0)))[None]

    def begin_alone(self, environment: dm_env.Environment, seed: int) -> Act:
        """See `Actor`."""
        return self._begin_alone(environment, seed)


class Deferred(Alone):
    """A policy that is found as an episode begins, because it depends on the environment."""

    def __init__(self, name: str, find: Callable[[dm_env.Environment], Actor]) -> None:
        """Takes the function that finds the policy for an environment."""
        super().__init__(name, None, self._begin_found)
        self._find = find
        self._found: tuple[dm_env.Environment, Actor] | None = None

    def found(self, environment: dm_env.Environment) -> Actor:
        """The policy for an environment."""
        if self._found is None or self._found[0] is not environment:
            self._found = environment, self._find(environment)
        return self._found[1]

    def _begin_found(self, environment: dm_env.Environment, seed: int) -> Act:
        return self.found(environment).begin_alone(environment, seed)


class Batched:
    """A policy that acts on 64 rows at once."""

    plays_alone = False
    action_repeat: int | None = None

    def __init__(
        self,
        name: str,
        sha256: str | None,
        act_batch: ActBatch,
        reset_batch: ResetBatch | None = None,
    ) -> None:
        """Takes the policy's functions; see the module's docstring."""
        self.name = name
        self.sha256 = sha256
        self._act_batch = act_batch
        self._reset_batch = reset_batch
        # Indexed by the environment's rows, which are not those that the policy receives.
        self._shown_in = np.zeros(ROWS, int)
        self._seeds = np.zeros(ROWS, np.int64)
        self._steps = np.zeros(ROWS, int)
        self._actions = np.zeros(0)  # of all rows

    def begin(self, batch: Batch, rows: np.ndarray, seeds: Sequence[int]) -> None:
        """See `Actor`.

        Raises:
          PolicyError: the batch has more than 64 rows.
        """
        self._begin(_no_actions(batch.single_action_spec(), batch.num_envs), rows, seeds)

    def _begin(self, actions: np.ndarray, rows: np.ndarray, seeds: Sequence[int]) -> None:
        if len(actions) > ROWS:
            raise PolicyError(
                f"policy {self.name!r} acts in {ROWS} rows at once, and the batch has "
                f"{len(actions)}: play it with `evaluation.evaluate`, or in smaller batches"
            )
        self._actions = actions
        self._seeds[rows] = seeds
        self._steps[rows] = 0
        self._shown_in[rows] = self._seeds[rows] % ROWS
        if self._reset_batch is not None:
            with Locating(f"policy {self.name!r}, before the episodes with seeds {list(seeds)}"):
                self._reset_batch(self._shown_in[rows], self._seeds[rows])

    def act(self, observation: Mapping[str, np.ndarray], rows: np.ndarray) -> np.ndarray:
        """See `Actor`.

        Raises:
          PolicyError: also where two of the rows have seeds that are equal modulo 64.
        """
        places = self._shown_in[rows]
        if len(np.unique(places)) < len(places):
            raise PolicyError(
                f"policy {self.name!r} shows an episode in row `seed % {ROWS}`, which is the same "
                f"for two of the seeds {self._seeds[rows].tolist()}: play them in other batches"
            )
        shown = {n: _spread(values[rows], places) for n, values in observation.items()}
        with Locating(self._where(rows[0])):
            returned = self._act_batch(_like(observation, shown))
        returned = self._checked(returned, rows)
        self._steps[rows] += 1
        actions = np.zeros_like(self._actions)
        actions[rows] = returned
        return actions

    def begin_alone(self, environment: dm_env.Environment, seed: int) -> Act:
        """See `Actor`."""
        own = Batched(self.name, self.sha256, self._act_batch, self._reset_batch)
        row = np.zeros(1, int)
        own._begin(_no_actions(_spec_of(environment, self.name), 1), row, [seed])

        def act(observation: Mapping[str, np.ndarray]) -> np.ndarray:
            of_batch = {name: np.asarray(value)[None] for name, value in observation.items()}
            return own.act(_like(observation, of_batch), row)[0]

        return act

    def _checked(self, returned: object, rows: np.ndarray) -> np.ndarray:
        """The policy's actions for these rows; raises PolicyError if they are invalid."""
        expected = (ROWS, *self._actions.shape[1:])
        actions = as_numbers(self._where(rows[0]), returned, expected)[self._shown_in[rows]]
        dtype = self._actions.dtype
        is_bad = ~_are_valid(actions, dtype).reshape(len(rows), -1).all(axis=-1)
        for row, action in zip(rows[is_bad], actions[is_bad], strict=True):
            check_numbers(self._where(row), action, dtype)
        return actions

    def _where(self, row: int) -> str:
        step, seed = self._steps[row], self._seeds[row]
        return f"policy {self.name!r}, step {step} of the episode with seed {seed}"


def _no_actions(spec: specs.Array, num_envs: int) -> np.ndarray:
    """Zeros for the actions of all rows, in whole numbers where the spec has them."""
    whole = np.issubdtype(spec.dtype, np.integer)
    return np.zeros((num_envs, *spec.shape), spec.dtype if whole else np.float64)


def _spec_of(environment: dm_env.Environment, policy: str) -> specs.BoundedArray:
    try:
        return spec_of(environment)
    except (TypeError, ValueError) as error:
        raise PolicyError(f"policy {policy!r}: {error}") from error


def _of_row(observation: Mapping[str, np.ndarray], row: int) -> Mapping[str, np.ndarray]:
    return _like(observation, {name: values[row] for name, values in observation.items()})


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


def as_numbers(where: str, returned: object, shape: tuple[int, ...]) -> np.ndarray:
    """The numbers that a policy returned; raises a PolicyError that begins with `where`."""
    try:
        array = np.asarray(returned)
    except (TypeError, ValueError, RuntimeError) as error:  # ragged lists, tensors elsewhere
        raise PolicyError(
            f"{where}: returned something other than an array of numbers: {error}"
        ) from error
    if array.dtype.kind not in "iuf" or array.shape != shape:
        raise PolicyError(
            f"{where}: returned {type(returned).__name__} of dtype {array.dtype} and shape "
            f"{array.shape}; expected numbers of shape {shape}"
        )
    return array


def check_numbers(where: str, action: np.ndarray, dtype: np.dtype) -> None:
    """Raises a PolicyError that begins with `where` unless an action has numbers of its spec.

    They are finite, and whole where the spec's type is.
    """
    is_bad = ~_are_valid(action, dtype)
    if is_bad.any():
        expected = "whole" if np.issubdtype(dtype, np.integer) else "finite"
        raise PolicyError(
            f"{where}: returned {action[is_bad][0]} at index {np.flatnonzero(is_bad).tolist()}; "
            f"expected {expected} numbers"
        )


def _are_valid(actions: np.ndarray, dtype: np.dtype) -> np.ndarray:
    """Whether each number is finite, and whole if `dtype` is."""
    is_finite = np.isfinite(actions)
    if not np.issubdtype(dtype, np.integer):
        return is_finite
    return is_finite & (actions == np.floor(actions))
