"""`Contest`: one task stepped in three ways; `take_turns`: what is compared, in short turns.

with Contest("humanoid", "walk", num_envs=256, num_threads=2) as contest:
    players = {"physics": contest.physics, "batch": contest.batch}
    seconds = take_turns(players, contest.actions, 3.0, episode=contest.episode)
"""

import math
import time
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from dm_env import specs

from limberjack.gym.vector import VectorEnv
from limberjack.mujoco import row_fields
from limberjack.rl.action_specs import bounds_to_try
from limberjack.rl.batch import BatchEnvironment
from limberjack.rl.batches import vectorisable
from limberjack.suite import base
from limberjack.workers.factories import Factory, Make, factory_of

if TYPE_CHECKING:
    from mujoco.batch import Batch

__all__ = [
    "SEED",
    "Contest",
    "Player",
    "batch_of_task",
    "player",
    "random_actions",
    "take_turns",
    "vector_env",
]

# Takes a block of actions, (steps, num_envs, nu), and returns the seconds that its steps took.
Player = Callable[[np.ndarray], float]

_Name = TypeVar("_Name")  # of a player

_ROWS_PER_BLOCK = 1024  # steps of a block times rows: about a twentieth of a second
_WARM_UP_STEPS = 20  # not measured, because the humanoid falls
_MIN_ROUNDS = 8
_EPISODE = 1_000  # most steps to measure: those of an episode of the suite
_SHORTEST = 2 * _MIN_ROUNDS  # steps that an episode must have to be measured
_WARM_UP_SHARE = 0.1  # of an episode, at most
SEED = 0  # of the first row


class Contest:
    """One task, stepped by MuJoCo alone, by a batch and by a vector environment.

    All three use equally many threads and begin in the same states, so with the same actions they
    do the same steps. The vector environment is flat and float32. Leaving the context checks that
    the steps were the same, and frees everything.
    """

    def __init__(
        self, domain: str | Make, task: str | None, num_envs: int, num_threads: int
    ) -> None:
        """Makes all three and begins an episode in every row.

        Raises:
          ValueError, TypeError: there is no such domain or task, its episodes are too short, or a
            number is out of range.
        """
        factory = factory_of(domain, task)
        self._subject = factory.title
        self.num_envs = num_envs
        self.environment = batch_of_task(factory, num_envs, num_threads)
        self.episode = _steps_of_episode(self.environment)  # the most steps of an episode
        if self.episode < _SHORTEST:
            raise ValueError(
                f"{self._subject} has episodes of {self.episode} steps; expected at least "
                f"{_SHORTEST}, for a measurement in turns"
            )
        self.vector_env = vector_env(factory, num_envs, num_threads)
        self.batch: Player = player(self.environment.step)
        self.vector: Player = player(self.vector_env.step)
        self._num_substeps = self.environment._n_sub_steps * self.environment._action_repeat
        self._bare: dict[bool, Batch] = {}
        self.environment.reset()
        self.vector_env.reset(seed=SEED)
        self._start: np.ndarray = _state(self.environment).copy()
        # Fields in which the rows' models differ, such as the position of a target.
        fields, of_batch = self.environment._saved_fields, self.environment.physics.simulation
        self._start_fields = {name: of_batch.model_field(name)[0].copy() for name in fields}
        # The latest controls of the physics alone.
        self._controls = np.zeros((num_envs, self.environment.physics.model.nu))

    def physics(self, actions: np.ndarray) -> float:
        """The `Player` of a plain `mujoco.batch.Batch`, with no arrays bound."""
        return self._play_bare(False, actions)

    def persistent_physics(self, actions: np.ndarray) -> float:
        """The `Player` of a `Batch` that keeps an `MjData` for each simulation."""
        return self._play_bare(True, actions)

    def _play_bare(self, persistent: bool, actions: np.ndarray) -> float:
        if persistent not in self._bare:
            self._bare[persistent] = self._make_bare(persistent)
        batch, seconds = self._bare[persistent], 0.0
        for action in actions:
            batch.ctrl = self._controls_of(action)  # not timed
            start = time.perf_counter()
            batch.step(nstep=self._num_substeps)
            seconds += time.perf_counter() - start
        return seconds

    def _controls_of(self, action: np.ndarray) -> np.ndarray:
        """The action as controls; zeros if the task does not have one action per control."""
        if action.shape == self._controls.shape:
            self._controls = action
        return self._controls

    def _make_bare(self, persistent: bool) -> "Batch":
        import mujoco.batch  # here, as `limberjack.mujoco` is to import it first

        like = self.environment.physics
        model, threads = like.model.without_textures()._official, like.simulation.num_threads
        batch = mujoco.batch.Batch(model, self.num_envs, threads, persistent)
        batch.state[...] = self._start
        fields = row_fields.of(batch, model, self.num_envs, self._start_fields)
        for name, values in self._start_fields.items():
            fields.own[name][...] = values
        return batch

    def actions(self, num_steps: int) -> np.ndarray:
        """Random actions, (num_steps, num_envs, nu)."""
        return random_actions(self.environment.action_spec(), num_steps)

    def check_same_steps(self) -> None:
        """Raises RuntimeError unless all three have reached the same states.

        The physics alone is compared only in rows that are still in their first episode, and only
        if the task's actions are the actuators' controls.
        """
        states = [_state(self.environment), _state(self.vector_env.batches[0])]
        count = self.environment._counter.steps
        first = np.flatnonzero(~self.environment.begins & (count == count.max()))
        bare = [batch.state[first] for batch in self._bare.values() if self._acts_directly(first)]
        same = np.array_equal(states[0], states[1]) and all(
            np.array_equal(state, states[0][first]) for state in bare
        )
        if not same:
            raise RuntimeError(
                f"{self._subject}: MuJoCo alone, the batch and the vector environment reached "
                "different states, so their speeds cannot be compared; please report this"
            )

    def _acts_directly(self, rows: np.ndarray) -> bool:
        """Whether the given actions are the actuators' controls, by the task or by these rows."""
        is_plain = type(self.environment.task).before_step is base.Task.before_step
        if is_plain and self.environment._faults is None:
            return True
        found = self.environment.physics.control()[rows]
        return np.array_equal(found, self._controls[rows])

    def __enter__(self) -> "Contest":
        return self

    def __exit__(self, kind: object, *error: object) -> None:
        try:
            if kind is None:
                self.check_same_steps()
        finally:
            self._bare.clear()
            self.environment.close()
            self.vector_env.close()


def take_turns(
    players: Mapping[_Name, Player],
    actions: Callable[[int], np.ndarray],
    seconds: float,
    min_rounds: int = _MIN_ROUNDS,
    warm_up_steps: int = _WARM_UP_STEPS,
    episode: int = _EPISODE,
    rows_per_block: int = _ROWS_PER_BLOCK,
    on_round: Callable[[float], object] | None = None,
) -> dict[_Name, list[float]]:
    """Seconds per step of each player in each round, within one episode.

    Args:
      players: by name; all play the same block in a round, in an order that rotates.
      actions: returns the actions of a number of steps, (steps, num_envs, nu).
      seconds: approximate duration after the warm-up; longer if `min_rounds` take longer.
      min_rounds: the fewest rounds to play.
      warm_up_steps: before the first round; fewer if episodes are short.
      episode: steps in an episode; the last one is not played.
      rows_per_block: steps of a block times rows.
      on_round: called before each round, outside the measured time, with the share that is done.
    """
    warm_up_steps = min(warm_up_steps, int(_WARM_UP_SHARE * episode))
    left = episode - 1 - warm_up_steps
    warm_up = actions(warm_up_steps)
    for play in players.values():
        play(warm_up)
    # Blocks of few rows would be longer than an episode.
    block = max(1, min(rows_per_block // warm_up.shape[1], left // min_rounds))
    taken: dict[_Name, list[float]] = {name: [] for name in players}
    order = list(players)
    start = time.perf_counter()
    for number in range(left // block):
        elapsed = time.perf_counter() - start
        if number >= min_rounds and elapsed > seconds:
            break
        if on_round is not None:
            on_round(min(1.0, number / min_rounds, elapsed / seconds if seconds else 1.0))
        given = actions(block)
        for name in order:
            taken[name].append(players[name](given) / block)
        order.append(order.pop(0))
    return taken


def batch_of_task(factory: Factory, num_envs: int, num_threads: int) -> BatchEnvironment:
    """A vectorised batch whose row i has the seed SEED + i.

    Raises:
      ValueError, TypeError: there is no such task, it is not vectorised, or a number is out of
        range.
    """
    environment = vectorisable(factory.make(SEED))
    return BatchEnvironment.from_environment(environment, num_envs, num_threads, SEED)


def vector_env(factory: Factory, num_envs: int, num_threads: int) -> VectorEnv:
    """The same batch for Gymnasium, flat and in float32."""
    return VectorEnv(batch_of_task(factory, num_envs, num_threads), flat=True, dtype="float32")


def _steps_of_episode(batch: BatchEnvironment) -> int:
    """The most actions of an episode, or the most to measure if that is less."""
    limit = batch.step_limit / batch._action_repeat
    return _EPISODE if limit >= _EPISODE else math.ceil(limit)


def player(step: Callable[[np.ndarray], object]) -> Player:
    """A player of an environment with this `step`."""

    def play(actions: np.ndarray) -> float:
        start = time.perf_counter()
        for action in actions:
            step(action)
        return time.perf_counter() - start

    return play


def _state(environment: BatchEnvironment) -> np.ndarray:
    """The state that a batch's steps depend on, (num_envs, nstate), live."""
    return environment.physics.simulation.state


_random = np.random.RandomState(SEED)


def random_actions(spec: specs.BoundedArray, num_steps: int) -> np.ndarray:
    """Random actions within the bounds, or between -1 and 1 where there are none."""
    low, high = bounds_to_try(spec)
    # Rounded to float32, the vector environment's own type.
    drawn = _random.uniform(low, high, (num_steps, *spec.shape)).astype(np.float32)
    return drawn.astype(np.float64)
