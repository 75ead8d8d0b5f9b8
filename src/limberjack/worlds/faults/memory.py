"""`FaultMemory`: applies faults to the actions, rewards and observations of rows.

    faults = FaultMemory(settings, action_spec, observation, num_envs=64)
    faults.begin(3, stream)                     # row 3 begins an episode
    observation = faults.observe(observation, rows)
    action = faults.act(actions)
    faults.accept(rows)     # the task has taken them; rows: a mask of the rows that step
    rewards = faults.reward(rewards, rows)

Faults are applied at each control step, in the order of the Real World RL suite: to actions delay,
noise, dropped, stuck and repeated values; to observations noise, dropped and stuck values, delay,
dummies. So a delayed observation is late, and its dummies are not. The first action, observation
or reward of an episode stands for the ones that are missing before it.

A single environment has one row, and its arrays no axis for it. All memory is in `values`, arrays
with an axis of rows, which snapshots hold.

Random numbers are functions of a row's key, which belongs to its episode, of the step, and of the
place: see `uniform` and `normal`. So a batch draws the numbers that single environments draw; a
generator with a state, such as NumPy's, would be called once for each row and step, and a snapshot
would hold each one's state. The key is mixed with the position by the output function of SplitMix64
(Steele, Lea and Flood, 2014, https://doi.org/10.1145/2660193.2660195).
"""

import collections
import copy
import dataclasses
import hashlib
import math
from collections.abc import Mapping, MutableMapping
from typing import Any, Self

import numpy as np
from dm_env import specs

from limberjack.utils.arrays import Quantity
from limberjack.worlds.faults.perturbing import Perturber
from limberjack.worlds.faults.settings import Fault, Faults

__all__ = ["FaultMemory", "key_of", "normal", "uniform"]

# Kinds of draws.
_ACTION_NOISE, _DROPPED_ACTIONS, _STUCK_ACTIONS, _REPETITION = range(4)
_NOISE, _DROPPED, _STUCK, _DUMMIES = range(4, 8)
_PERTURBATION = 8
# The memory that belongs to the seed, or to the episode whatever `clear_at_reset` is.
_KEPT = ("key", "episodes", "parameter", "falls")

# Of SplitMix64: the increment of its state, and the two multipliers of its output function.
_INCREMENT = np.uint64(0x9E3779B97F4A7C15)
_FIRST, _SECOND = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
_SHIFTS = tuple(np.uint64(shift) for shift in (30, 27, 31))
_UNUSED = np.uint64(11)  # bits of a 64-bit number beyond the 53 of a float's fraction
_SPACING = 2.0**-53  # of the floats in [0.5, 1)
_KINDS = 16  # more than there are kinds of draws


@dataclasses.dataclass(frozen=True)
class _Form:
    """The form of an observation of one row."""

    shape: tuple[int, ...]
    dtype: np.dtype
    is_array: bool

    @property
    def size(self) -> int:
        return math.prod(self.shape)


class FaultMemory:
    """See the module's docstring.

    Attributes:
      settings: the faults.
      values: the memory of all rows by name, (n, ...) each.
    """

    def __init__(
        self,
        settings: Faults,
        action_spec: object,
        observation: Mapping[str, Quantity],
        num_envs: int | None = None,
        perturber: Perturber | None = None,
    ) -> None:
        """Remembers nothing yet.

        Args:
          settings: the faults.
          action_spec: of one row's actions.
          observation: of one row, as the task returns it.
          num_envs: number of rows; None for a single environment.
          perturber: of the model; None without perturbations.

        Raises:
          TypeError: actions or observations are not numbers, or dummies have their names.
        """
        if not isinstance(action_spec, specs.BoundedArray):
            raise TypeError(f"faults need actions in one bounded array; the spec is {action_spec}")
        self.settings = settings
        self._perturber = perturber
        self._spec = action_spec
        # Copies: they may be views of the simulation.
        self._first = {name: copy.copy(value) for name, value in observation.items()}
        self._forms = {name: _form(name, value) for name, value in observation.items()}
        self._is_single = num_envs is None
        self._dummies = [f"dummy-{number}" for number in range(settings.dummies)]
        taken = [name for name in self._dummies if name in self._forms]
        if taken:
            raise TypeError(
                f"the task observes {taken[0]!r}, the name of a dummy: set dummies to 0"
            )
        self.values = self._cleared(num_envs or 1)
        self._pending: dict[str, np.ndarray] = {}  # the memory after an action that was not taken

    def of_rows(self, num_envs: int) -> Self:
        """The same faults for a batch."""
        return type(self)(self.settings, self._spec, self._first, num_envs, self._perturber)

    @property
    def fields(self) -> tuple[str, ...]:
        """The model fields that a perturbation sets for each episode."""
        return () if self._perturber is None else self._perturber.fields

    def _cleared(self, rows: int) -> dict[str, np.ndarray]:
        delay, actions = self.settings.delay, math.prod(self._spec.shape)
        observed = sum(form.size for form in self._forms.values())
        return {
            "key": np.zeros(rows, np.uint64),
            "episodes": np.zeros(rows, int),
            "parameter": np.zeros(rows),
            "falls": np.zeros(rows, bool),
            "step": np.zeros(rows, int),
            "has_acted": np.zeros(rows, bool),
            "actions": np.zeros((rows, delay.actions + 1, actions)),
            "dropped_actions": np.zeros((rows, actions), int),
            "stuck_actions": np.zeros((rows, actions), int),
            "last_action": np.zeros((rows, actions)),
            "repetitions": np.zeros(rows, int),
            "repeated_action": np.zeros((rows, actions)),
            "has_reward": np.zeros(rows, bool),
            "rewards": np.zeros((rows, delay.rewards + 1)),
            "has_observed": np.zeros(rows, bool),
            "observations": np.zeros((rows, delay.observations + 1, observed)),
            "dropped": np.zeros((rows, observed), int),
            "stuck": np.zeros((rows, observed), int),
            "last_observation": np.zeros((rows, observed)),
            "shown": np.zeros((rows, observed + len(self._dummies))),
        }

    # The life of an episode.

    def begin(self, row: int, stream: np.random.RandomState) -> dict[str, np.ndarray]:
        """Begins an episode in a row; it will be drawn from the stream, which is not advanced.

        Returns:
          The model fields of the episode, by name.
        """
        values, perturber = self.values, self._perturber
        episodes = int(values["episodes"][row])
        values["key"][row] = key_of(stream, episodes)
        values["episodes"][row] += 1
        values["step"][row] = 0
        self.forget(row)
        if perturber is None:
            return {}
        if episodes % perturber.perturbation.period == 0:
            one = values["key"][[row]], np.zeros(1, int), _PERTURBATION, 1
            value, falls = perturber.next(
                float(values["parameter"][row]) if episodes else None,
                bool(values["falls"][row]),
                normal(*one).item(),
                uniform(*one).item(),
            )
            values["parameter"][row], values["falls"][row] = value, falls
        return perturber.fields_of(float(values["parameter"][row]))

    @property
    def nominal(self) -> dict[str, np.ndarray]:
        """The model fields that a perturbation sets, as the task's own model has them, by name."""
        return {} if self._perturber is None else self._perturber.nominal

    def unperturbed(self, fields: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Model fields of row 0's episode without the perturbation; what the start has set stays.

        Args:
          fields: of the episode, by name; those that no perturbation sets are returned unchanged.
        """
        nominal = {name: self.nominal[name] for name in fields if name in self.nominal}
        if self._perturber is None or not nominal:
            return dict(fields)
        perturbed = self._perturber.fields_of(float(self.values["parameter"][0]))
        own = {
            name: np.where(fields[name] == perturbed[name], value, fields[name])
            for name, value in nominal.items()
        }
        return {**fields, **own}

    def drawn(self, rows: int | np.ndarray) -> dict[str, np.ndarray]:
        """The values of the perturbed parameter, by its name."""
        if self._perturber is None:
            return {}
        return {self._perturber.perturbation.parameter: np.array(self.values["parameter"][rows])}

    def forget(self, rows: int | np.ndarray) -> None:
        """Clears what rows remember of their episode, if the settings say so."""
        if self.settings.clear_at_reset:
            self._clear(rows, [name for name in self.values if name not in _KEPT])

    def begin_again(self, rows: int | list[int]) -> None:
        """Clears everything that rows remember, as for a new seed."""
        self._clear(rows, list(self.values))

    def _clear(self, rows: int | np.ndarray | list[int], names: list[str]) -> None:
        for name in names:
            self.values[name][rows] = 0

    # The parts of a step.

    def act(self, given: object) -> np.ndarray:
        """The actions that reach the task; nothing is remembered until `accept`.

        Args:
          given: the actions, (n, ...), or of a single environment; one of another shape than the
            spec's is returned unchanged, for the task to refuse.
        """
        self._pending = {}
        shape = (
            self._spec.shape if self._is_single else (len(self.values["key"]), *self._spec.shape)
        )
        numbers = np.asarray(given)
        is_one_each = numbers.size == len(self.values["key"]) == math.prod(shape)
        if numbers.shape != shape and not is_one_each:
            return numbers
        flat = np.asarray(numbers, float).reshape(len(self.values["key"]), -1)
        acted = self._acted(flat).reshape(numbers.shape)
        return _in_dtype(acted, self._spec.dtype) if self._spec.dtype.kind in "iub" else acted

    def _acted(self, given: np.ndarray) -> np.ndarray:
        values, settings, new = self.values, self.settings, self._pending
        new["actions"] = _pushed(values["actions"], given, values["has_acted"])
        action = new["actions"][:, 0].copy()
        if settings.noise.actions:
            noise = self._normal(_ACTION_NOISE, action.shape[1])
            low, high = (np.ravel(bound) for bound in (self._spec.minimum, self._spec.maximum))
            action = np.clip(action + settings.noise.actions * noise, low, high)
        lost = self._lost("dropped_actions", settings.dropped.actions, _DROPPED_ACTIONS, new)
        action[lost] = 0.0
        lost = self._lost("stuck_actions", settings.stuck.actions, _STUCK_ACTIONS, new)
        lost &= values["has_acted"][:, None]  # before, nothing is there to keep
        action[lost] = values["last_action"][lost]
        new["last_action"] = action.copy()
        return self._repeated(action)

    def _repeated(self, action: np.ndarray) -> np.ndarray:
        """The action, or the last one where that is repeated."""
        values, fault, new = self.values, self.settings.repetition, self._pending
        goes_on = values["repetitions"] > 0
        action[goes_on] = values["repeated_action"][goes_on]
        hit = self._uniform(_REPETITION, 1)[:, 0] < fault.probability
        left = np.where(goes_on, values["repetitions"] - 1, np.where(hit, fault.steps - 1, 0))
        new["repetitions"], new["repeated_action"] = left, action.copy()
        new["has_acted"] = np.ones(len(action), bool)
        return action

    def accept(self, rows: np.ndarray | None = None) -> None:
        """Remembers the actions of the last `act`, which the task has taken, in a mask of rows."""
        self._keep(self._pending, rows)
        self._pending = {}

    def reward(self, given: Quantity, rows: np.ndarray | None = None) -> Quantity:
        """The rewards that are received.

        Args:
          given: the rewards, (n,), or one number.
          rows: mask of rows that stepped; others get their rewards unchanged.
        """
        if not self.settings.delay.rewards:
            return given
        values = self.values
        flat = np.broadcast_to(np.asarray(given, float), values["has_reward"].shape)
        queue = _pushed(values["rewards"], flat, values["has_reward"])
        self._keep({"rewards": queue, "has_reward": np.ones(len(flat), bool)}, rows)
        if self._is_single:
            return float(queue[0, 0])
        return queue[:, 0] if rows is None else np.where(rows, queue[:, 0], flat)

    def observe(
        self, given: Mapping[str, Quantity], rows: np.ndarray | None = None
    ) -> MutableMapping[str, Quantity]:
        """The observation that is received, of the type of the given one.

        Args:
          given: the task's observation.
          rows: mask of rows that observe, (n,); others show their last observation again.
        """
        values, settings = self.values, self.settings
        count = len(values["key"])
        flat = [np.asarray(given[name], float).reshape(count, -1) for name in self._forms]
        seen = np.concatenate([np.zeros((count, 0)), *flat], axis=1)
        new: dict[str, np.ndarray] = {}
        if settings.noise.observations:
            seen = seen + settings.noise.observations * self._normal(_NOISE, seen.shape[1])
        lost = self._lost("dropped", settings.dropped.observations, _DROPPED, new)
        seen[lost] = 0.0
        lost = self._lost("stuck", settings.stuck.observations, _STUCK, new)
        lost &= values["has_observed"][:, None]
        seen[lost] = values["last_observation"][lost]
        new["last_observation"], new["has_observed"] = seen, np.ones(count, bool)
        new["observations"] = _pushed(values["observations"], seen, values["has_observed"])
        dummies = self._normal(_DUMMIES, len(self._dummies))
        new["shown"] = np.concatenate([new["observations"][:, 0], dummies], axis=1)
        new["step"] = values["step"] + 1
        self._keep(new, rows)
        return self.shown(given)

    def shown(self, like: Mapping[str, Quantity]) -> MutableMapping[str, Quantity]:
        """The last observation of all rows, of the type of a given one."""
        make: Any = type(like)  # the type of a user's mapping
        shown, count, found = self.values["shown"], len(self.values["key"]), []
        start = 0
        for name, form in self._all_forms().items():
            stop = start + form.size
            part = _in_dtype(shown[:, start:stop], form.dtype).reshape(count, *form.shape)
            if self._is_single:
                part = part[0] if form.is_array else part[0][()]
            found.append((name, part))
            start = stop
        return make(found)

    def specs_with(self, known: Mapping[str, specs.Array]) -> Mapping[str, specs.Array]:
        """Specs of the observations of one row, given those of the task's."""
        dummies = [(name, specs.Array((), float, name=name)) for name in self._dummies]
        return collections.OrderedDict([*known.items(), *dummies])

    def _all_forms(self) -> dict[str, _Form]:
        dummy = _Form((), np.dtype(float), is_array=False)
        return {**self._forms, **dict.fromkeys(self._dummies, dummy)}

    # Snapshots.

    def save(self, rows: np.ndarray | None) -> dict[str, np.ndarray]:
        """Copies of the memory of rows, None for all: (n, ...) by name."""
        index = slice(None) if rows is None else rows
        return {name: values[index].copy() for name, values in self.values.items()}

    def load(self, saved: Mapping[str, np.ndarray], rows: np.ndarray | None) -> None:
        """Restores the result of `save`."""
        index = slice(None) if rows is None else rows
        for name, values in self.values.items():
            values[index] = saved[name]

    def _keep(self, new: Mapping[str, np.ndarray], rows: np.ndarray | None) -> None:
        for name, values in new.items():
            if rows is None:
                self.values[name] = values
            else:
                self.values[name][rows] = values[rows]

    def _lost(self, name: str, fault: Fault, kind: int, new: dict[str, np.ndarray]) -> np.ndarray:
        """Mask of the numbers that have a fault in this step; adds what is left of it to `new`."""
        left = self.values[name]
        if not fault.probability:
            return np.zeros(left.shape, bool)
        hit = self._uniform(kind, left.shape[1]) < fault.probability
        left = np.where((left == 0) & hit, fault.steps, left)
        new[name] = np.maximum(left - 1, 0)
        return left > 0

    def _uniform(self, kind: int, count: int) -> np.ndarray:
        return uniform(self.values["key"], self.values["step"], kind, count)

    def _normal(self, kind: int, count: int) -> np.ndarray:
        return normal(self.values["key"], self.values["step"], kind, count)


def _form(name: str, value: object) -> _Form:
    """The form of an observation; raises TypeError if it is not made of numbers."""
    array = np.asarray(value)
    if array.dtype.kind not in "fiub":
        raise TypeError(f"faults need observations of numbers; {name!r} is {value!r}")
    return _Form(array.shape, array.dtype, isinstance(value, np.ndarray))


def _in_dtype(numbers: np.ndarray, dtype: np.dtype) -> np.ndarray:
    """Numbers in a dtype: the nearest integers that it has, or whether they are over a half."""
    if dtype.kind == "b":
        return numbers > 0.5
    if dtype.kind in "iu":
        limits = np.iinfo(dtype)
        most = np.nextafter(float(limits.max) + 1.0, 0.0)  # which is cut to the largest integer
        numbers = np.clip(np.rint(numbers), limits.min, most)
    return numbers.astype(dtype)


def _pushed(queue: np.ndarray, new: np.ndarray, are_filled: np.ndarray) -> np.ndarray:
    """Queues with a value added at the end and the first one removed; a new one is filled with it.

    Args:
      queue: (n, length, ...).
      new: (n, ...).
      are_filled: mask of the queues that have values already, (n,).
    """
    pushed = np.concatenate([queue[:, 1:], new[:, None]], axis=1)
    pushed[~are_filled] = new[~are_filled][:, None]
    return pushed


def key_of(stream: np.random.RandomState, episodes: int) -> np.uint64:
    """The key of an episode.

    Args:
      stream: from which the episode is going to be drawn; it is not advanced.
      episodes: number of earlier episodes of the stream, for a task that draws nothing.
    """
    _, key, *rest = stream.get_state(legacy=True)
    text = np.asarray(key, np.uint32).tobytes() + repr((*rest, episodes)).encode()
    digest = hashlib.blake2b(text, digest_size=8, person=b"faults").digest()
    return np.uint64(int.from_bytes(digest, "little"))


def uniform(keys: np.ndarray, steps: np.ndarray, kind: int, count: int) -> np.ndarray:
    """Numbers from [0, 1), (n, count).

    Args:
      keys: of the rows, (n,) uint64.
      steps: of the rows, (n,).
      kind: of draw, from 0 to 15; draws of different kinds are independent.
      count: numbers in a row.
    """
    places = steps.astype(np.uint64) * np.uint64(_KINDS) + np.uint64(kind)
    starts = _mixed(keys ^ _mixed(places * _INCREMENT))
    numbers = starts[:, None] + np.arange(1, count + 1, dtype=np.uint64) * _INCREMENT
    return (_mixed(numbers) >> _UNUSED) * _SPACING


def normal(keys: np.ndarray, steps: np.ndarray, kind: int, count: int) -> np.ndarray:
    """Numbers of the standard normal distribution, (n, count), by the method of Box and Muller."""
    both = uniform(keys, steps, kind, 2 * count)
    # Of 1 - u, which is never 0. Contiguous, since NumPy's routines for strided arrays may round
    # differently.
    first, second = 1.0 - both[:, :count], np.ascontiguousarray(both[:, count:])
    return np.sqrt(-2.0 * np.log(first)) * np.cos(2.0 * math.pi * second)


def _mixed(numbers: np.ndarray) -> np.ndarray:
    """The output function of SplitMix64, modulo 2**64."""
    numbers = (numbers ^ (numbers >> _SHIFTS[0])) * _FIRST
    numbers = (numbers ^ (numbers >> _SHIFTS[1])) * _SECOND
    return numbers ^ (numbers >> _SHIFTS[2])
