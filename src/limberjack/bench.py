"""How fast a task steps on this machine: the physics alone, a batch, a Gymnasium environment.

    result = bench.measure("humanoid", "walk", num_envs=256)
    result = bench.measure(my_package.make)         # make(seed) -> Environment
    for speed in (*result.speeds, *result.sweep):
        print(speed.what, speed.num_threads, speed.steps_per_second)
    print(result.recommended_threads)

What is compared does the same steps in turns, a block each within the same fraction of a second, so
that whatever else the machine does slows all of it alike. Steps are an environment's: one action.
Starts of episodes are not part of it: they take at most 2 % of an episode. Where a task ends some
episodes early, starts of those are part of what a batch and a vector environment take.
"""

import dataclasses
import math
import statistics
import time
from collections.abc import Callable, Mapping
from types import TracebackType
from typing import TYPE_CHECKING

import numpy as np
from dm_env import specs

from limberjack.factories import Factory, Make, factory_of
from limberjack.gym.vector import VectorEnv
from limberjack.rl.batch import BatchEnvironment
from limberjack.rl.guards import at_least_one
from limberjack.suite import base
from limberjack.utils import cores

if TYPE_CHECKING:
    from mujoco.batch import Batch

__all__ = ["Contest", "Player", "Result", "Speed", "measure", "player", "take_turns"]

# Takes a block of actions, (steps, num_envs, nu), and returns the seconds that its steps took.
Player = Callable[[np.ndarray], float]

_ROWS_PER_BLOCK = 1024  # steps of a block times rows: about a twentieth of a second
_WARM_UP_STEPS = 20  # not measured: the humanoid falls
_MIN_ROUNDS = 8
_EPISODE = 1_000  # steps that are measured at most; those of an episode of the suite
_SHORTEST = 2 * _MIN_ROUNDS  # steps that an episode must have to be measured
_WARM_UP_SHARE = 0.1  # of an episode, at most
_SEED = 0

_NEARLY_BEST = 0.95  # of the highest speed: threads beyond it are better used elsewhere


@dataclasses.dataclass(frozen=True)
class Speed:
    """How many steps per second, of all rows together, something takes."""

    what: str
    num_envs: int
    num_threads: int
    steps_per_second: float
    # Relative to the first of the same list, which did the same steps in turns with it.
    ratio: float


@dataclasses.dataclass(frozen=True)
class Result:
    """What `measure` found.

    `speeds` are of 'physics', 'batch' and 'vector', at equal threads, relative to the physics;
    `sweep` of 'vector' with more and more threads, relative to one thread.
    """

    facts: Mapping[str, str | None]  # as `factories.Factory` has them
    speeds: tuple[Speed, ...]
    sweep: tuple[Speed, ...]
    recommended_threads: int


def measure(
    domain: str | Make,
    task: str | None = None,
    num_envs: int = 256,
    num_threads: int | None = None,
    seconds: float = 3.0,
) -> Result:
    """Measure how fast a task steps.

    Args:
      domain: such as 'humanoid', or a function `make(seed) -> control.Environment`.
      task: such as 'walk'; None with a function.
      num_envs: number of rows.
      num_threads: the most threads to try, by default the cores that this process may use.
      seconds: how long each of the two comparisons may take, about; preparation comes on top.

    Raises:
      ValueError: there is no such domain or task, it cannot be played in batches, its episodes are
        too short, or a number is out of range.
      TypeError: the function makes something else.
    """
    num_envs = at_least_one("num_envs", num_envs)
    most = cores.usable_cores() if num_threads is None else num_threads
    most = min(at_least_one("num_threads", most), num_envs)
    if not seconds > 0:
        raise ValueError(f"seconds is {seconds!r}; expected a positive number")
    with Contest(domain, task, num_envs, most) as contest:
        players = {"physics": contest.physics, "batch": contest.batch, "vector": contest.vector}
        taken = take_turns(players, contest.actions, seconds, episode=contest.episode)
    speeds = [_speed(what, num_envs, most, taken[what], taken["physics"]) for what in taken]
    sweep = _sweep(factory_of(domain, task), num_envs, most, seconds)
    best = max(speed.ratio for speed in sweep)
    enough = next(s.num_threads for s in sweep if s.ratio >= _NEARLY_BEST * best)
    return Result(factory_of(domain, task).facts, tuple(speeds), tuple(sweep), enough)


def _sweep(factory: Factory, num_envs: int, most: int, seconds: float) -> list[Speed]:
    """The vector environment with 1, 2, 4... threads, and as many as there may be."""
    counts = sorted({most, *(2**i for i in range(most.bit_length()))})
    envs = {n: _vector(factory, num_envs, n) for n in counts}
    for env in envs.values():
        env.reset(seed=_SEED)
    players = {str(n): player(env.step) for n, env in envs.items()}
    batch = envs[counts[0]].batches[0]
    taken = take_turns(
        players, lambda steps: _actions(batch.action_spec(), steps), seconds, episode=_steps(batch)
    )
    for env in envs.values():
        env.close()
    return [_speed("vector", num_envs, n, taken[str(n)], taken[str(counts[0])]) for n in counts]


def _speed(
    what: str, num_envs: int, num_threads: int, taken: list[float], first: list[float]
) -> Speed:
    per_second = num_envs / statistics.median(taken)
    ratio = statistics.median(a / b for a, b in zip(first, taken, strict=True))
    return Speed(what, num_envs, num_threads, per_second, ratio)


class Contest:
    """One task, stepped by MuJoCo alone, a batch and a vector environment, with equal threads.

    They begin in the same states, so given the same actions they do the same steps. The vector
    environment is flat and float32. Leaving the context frees all and checks that the steps were
    the same.
    """

    def __init__(
        self, domain: str | Make, task: str | None, num_envs: int, num_threads: int
    ) -> None:
        """Make all and begin an episode in every row.

        Raises:
          ValueError, TypeError: there is no such domain or task, its episodes are too short, or a
            number is out of range.
        """
        factory = factory_of(domain, task)
        self._subject = factory.title
        self.num_envs = num_envs
        self.environment = _batch(factory, num_envs, num_threads)
        self.episode = _steps(self.environment)  # steps that an episode has at most
        if self.episode < _SHORTEST:
            raise ValueError(
                f"{self._subject} has episodes of {self.episode} steps; expected at least "
                f"{_SHORTEST}, or there is nothing to measure"
            )
        self.vector_env = _vector(factory, num_envs, num_threads)
        self.batch: Player = player(self.environment.step)
        self.vector: Player = player(self.vector_env.step)
        self._num_substeps = self.environment._n_sub_steps
        self._bare: dict[bool, Batch] = {}
        self.environment.reset()
        self.vector_env.reset(seed=_SEED)
        self._start: np.ndarray = _state(self.environment).copy()
        # What differs among the rows' models: where the target is, in some tasks.
        fields, of_batch = self.environment._saved_fields, self.environment.physics.simulation
        self._start_fields = {name: of_batch.model_field(name)[0].copy() for name in fields}
        # What the physics alone was given last.
        self._controls = np.zeros((num_envs, self.environment.physics.model.nu))

    def physics(self, actions: np.ndarray) -> float:
        """The `Player` of a plain `mujoco.batch.Batch`, nothing bound."""
        return self._play_bare(False, actions)

    def persistent_physics(self, actions: np.ndarray) -> float:
        """The same of one that keeps an `MjData` for each simulation."""
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
        """The action as controls; zeros for a task whose actions are of another number."""
        if action.shape == self._controls.shape:
            self._controls = action
        return self._controls

    def _make_bare(self, persistent: bool) -> "Batch":
        import mujoco.batch  # here, as `limberjack.mujoco` is to import it first

        like = self.environment.physics
        model, threads = like.model._model, like.simulation.num_threads
        batch = mujoco.batch.Batch(model, self.num_envs, threads, persistent)
        batch.state[...] = self._start
        for name, values in self._start_fields.items():
            batch.expand(name)[...] = values
        return batch

    def actions(self, num_steps: int) -> np.ndarray:
        """Random actions, (num_steps, num_envs, nu)."""
        return _actions(self.environment.action_spec(), num_steps)

    def check_same_steps(self) -> None:
        """Raise RuntimeError unless all have come to the same states.

        The physics alone is compared in rows that are still in their first episode, and not where
        the task makes something else of actions than controls.
        """
        states = [_state(self.environment), _state(self.vector_env.batches[0])]
        count = self.environment._counter.steps
        first = np.flatnonzero(~self.environment.begins & (count == count.max()))
        bare = [batch.state[first] for batch in self._bare.values() if self._acts_directly(first)]
        same = np.array_equal(states[0], states[1]) and all(
            np.array_equal(state, states[0][first]) for state in bare
        )
        if not same:
            raise RuntimeError(f"{self._subject}: the contestants did not do the same steps")

    def _acts_directly(self, rows: np.ndarray) -> bool:
        """Whether the task's actions are the actuators' controls, as its class or rows show."""
        if type(self.environment.task).before_step is base.Task.before_step:
            return True
        found = self.environment.physics.control()[rows]
        return np.array_equal(found, self._controls[rows])

    def __enter__(self) -> "Contest":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if kind is None:
            self.check_same_steps()
        self._bare.clear()
        self.environment.close()
        self.vector_env.close()


def take_turns(
    players: Mapping[str, Player],
    actions: Callable[[int], np.ndarray],
    seconds: float,
    min_rounds: int = _MIN_ROUNDS,
    warm_up_steps: int = _WARM_UP_STEPS,
    episode: int = _EPISODE,
) -> dict[str, list[float]]:
    """Seconds per step of each player in each round, within one episode.

    Args:
      players: by name; all play the same block in a round, in an order that rotates.
      actions: makes the actions of so many steps, (steps, num_envs, nu).
      seconds: how long it may take, about, after the warm-up; or more, for `min_rounds`.
      min_rounds: that are played at least.
      warm_up_steps: before the first round; fewer where episodes are short.
      episode: steps in an episode; the last one is not played.
    """
    warm_up_steps = min(warm_up_steps, int(_WARM_UP_SHARE * episode))
    left = episode - 1 - warm_up_steps
    warm_up = actions(warm_up_steps)
    for play in players.values():
        play(warm_up)
    # Blocks of few rows would be longer than an episode.
    block = max(1, min(_ROWS_PER_BLOCK // warm_up.shape[1], left // min_rounds))
    taken: dict[str, list[float]] = {name: [] for name in players}
    order = list(players)
    start = time.perf_counter()
    for number in range(left // block):
        if number >= min_rounds and time.perf_counter() - start > seconds:
            break
        given = actions(block)
        for name in order:
            taken[name].append(players[name](given) / block)
        order.append(order.pop(0))
    return taken


def _batch(factory: Factory, num_envs: int, num_threads: int) -> BatchEnvironment:
    environment = factory.make(_SEED)
    return BatchEnvironment.from_environment(environment, num_envs, num_threads, _SEED)


def _vector(factory: Factory, num_envs: int, num_threads: int) -> VectorEnv:
    return VectorEnv(_batch(factory, num_envs, num_threads), flat=True, dtype="float32")


def _steps(batch: BatchEnvironment) -> int:
    """Steps that an episode has at most, as far as they are measured."""
    limit = batch.step_limit
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
    """What a batch's steps depend on, (num_envs, nstate), live."""
    return environment.physics.simulation.state


_random = np.random.RandomState(_SEED)


def _actions(spec: specs.BoundedArray, num_steps: int) -> np.ndarray:
    """Random actions within the bounds, or between -1 and 1 where there are none."""
    low = np.where(np.isfinite(spec.minimum), spec.minimum, -1.0)
    high = np.where(np.isfinite(spec.maximum), spec.maximum, 1.0)
    # Numbers that float32 has, too: the vector environment's own type.
    drawn = _random.uniform(low, high, (num_steps, *spec.shape)).astype(np.float32)
    return drawn.astype(np.float64)
