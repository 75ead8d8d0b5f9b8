"""How fast a task steps on this machine: the physics alone, a batch, a Gymnasium environment.

    result = bench.measure("humanoid", "walk", num_envs=256)
    for speed in (*result.speeds, *result.sweep):
        print(speed.what, speed.num_threads, speed.steps_per_second)
    print(result.recommended_threads)

What is compared does the same steps in turns, a block each within the same fraction of a second, so
that whatever else the machine does slows all of it alike. Steps are an environment's: one action.
Starts of episodes are not part of it: they take at most 2 % of an episode.
"""

import dataclasses
import math
import statistics
import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from limberjack import suite
from limberjack.gym.vector import VectorEnv, load_vector
from limberjack.rl.batch import BatchEnvironment
from limberjack.rl.guards import at_least_one
from limberjack.utils import cores

__all__ = ["Contest", "Player", "Result", "Speed", "measure", "player", "take_turns"]

# Takes a block of actions, (steps, num_envs, nu), and returns the seconds that its steps took.
Player = Callable[[np.ndarray], float]

_ROWS_PER_BLOCK = 1024  # steps of a block times rows: about a twentieth of a second
_WARM_UP_STEPS = 20  # not measured: the humanoid falls
_MIN_ROUNDS = 8
_EPISODE = 1_000  # steps at most, of one episode: environments are made without a time limit
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

    domain: str
    task: str
    speeds: tuple[Speed, ...]
    sweep: tuple[Speed, ...]
    recommended_threads: int


def measure(
    domain: str,
    task: str,
    num_envs: int = 256,
    num_threads: int | None = None,
    seconds: float = 3.0,
) -> Result:
    """Measures a task of the suite.

    Args:
      domain: such as 'humanoid'.
      task: such as 'walk'.
      num_envs: number of rows.
      num_threads: the most threads to try, by default the cores that this process may use.
      seconds: how long each of the two comparisons may take, about; preparation comes on top.

    Raises:
      ValueError: there is no such domain or task, or a number is out of range.
    """
    num_envs = at_least_one("num_envs", num_envs)
    most = cores.usable_cores() if num_threads is None else num_threads
    most = min(at_least_one("num_threads", most), num_envs)
    if not seconds > 0:
        raise ValueError(f"seconds is {seconds!r}; expected a positive number")
    with Contest(domain, task, num_envs, most) as contest:
        players = {"physics": contest.physics, "batch": contest.batch, "vector": contest.vector}
        taken = take_turns(players, contest.actions, seconds)
    speeds = [_speed(what, num_envs, most, taken[what], taken["physics"]) for what in taken]
    sweep = _sweep(domain, task, num_envs, most, seconds)
    best = max(speed.ratio for speed in sweep)
    enough = next(s.num_threads for s in sweep if s.ratio >= _NEARLY_BEST * best)
    return Result(domain, task, tuple(speeds), tuple(sweep), enough)


def _sweep(domain: str, task: str, num_envs: int, most: int, seconds: float) -> list[Speed]:
    """The vector environment with 1, 2, 4... threads, and as many as there may be."""
    counts = sorted({most, *(2**i for i in range(most.bit_length()))})
    envs = {n: _vector(domain, task, num_envs, n) for n in counts}
    for env in envs.values():
        env.reset(seed=_SEED)
    players = {str(n): player(env.step) for n, env in envs.items()}
    shape = envs[counts[0]].batches[0].action_spec().shape
    taken = take_turns(players, lambda num_steps: _actions(shape, num_steps), seconds)
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

    def __init__(self, domain: str, task: str, num_envs: int, num_threads: int) -> None:
        """Makes all and begins an episode in every row.

        Raises:
          ValueError: there is no such domain or task, or a number is out of range.
        """
        self._subject = f"{domain}:{task}"
        self.num_envs = num_envs
        self.environment = suite.load_batch(
            domain, task, num_envs, num_threads, _SEED, task_kwargs={"time_limit": math.inf}
        )
        self.vector_env = _vector(domain, task, num_envs, num_threads)
        self.batch: Player = player(self.environment.step)
        self.vector: Player = player(self.vector_env.step)
        self._num_substeps = self.environment._n_sub_steps
        self._bare: dict[bool, Any] = {}
        self.environment.reset()
        self.vector_env.reset(seed=_SEED)
        self._start: np.ndarray = _state(self.environment).copy()
        # What differs among the rows' models: where the target is, in some tasks.
        fields, of_batch = self.environment._saved_fields, self.environment.physics._simulation
        self._start_fields = {name: of_batch.model_field(name)[0].copy() for name in fields}

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
            batch.ctrl = action  # not timed
            start = time.perf_counter()
            batch.step(nstep=self._num_substeps)
            seconds += time.perf_counter() - start
        return seconds

    def _make_bare(self, persistent: bool) -> Any:
        import mujoco.batch  # here, as `limberjack.mujoco` is to import it first

        like: Any = self.environment.physics
        model, threads = like.single.model._model, like._simulation.num_threads
        batch = mujoco.batch.Batch(model, self.num_envs, threads, persistent)
        batch.state[...] = self._start
        for name, values in self._start_fields.items():
            batch.expand(name)[...] = values
        return batch

    def actions(self, num_steps: int) -> np.ndarray:
        """Random actions, (num_steps, num_envs, nu)."""
        return _actions(self.environment.action_spec().shape, num_steps)

    def check_same_steps(self) -> None:
        """Raises RuntimeError unless all have come to the same states."""
        states = [_state(self.environment), _state(self.vector_env.batches[0])]
        states += [batch.state for batch in self._bare.values()]
        if not all(np.array_equal(state, states[0]) for state in states):
            raise RuntimeError(f"{self._subject}: the contestants did not do the same steps")

    def __enter__(self) -> "Contest":
        return self

    def __exit__(self, kind: Any, *error: object) -> None:
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
) -> dict[str, list[float]]:
    """Seconds per step of each player in each round, within one episode.

    Args:
      players: by name; all play the same block in a round, in an order that rotates.
      actions: makes the actions of so many steps, (steps, num_envs, nu).
      seconds: how long it may take, about, after the warm-up; or more, for `min_rounds`.
      min_rounds: that are played at least.
      warm_up_steps: before the first round.
    """
    warm_up = actions(warm_up_steps)
    for play in players.values():
        play(warm_up)
    block = max(1, _ROWS_PER_BLOCK // warm_up.shape[1])
    taken: dict[str, list[float]] = {name: [] for name in players}
    order = list(players)
    start, most = time.perf_counter(), (_EPISODE - 1 - warm_up_steps) // block
    for number in range(most):
        if number >= min_rounds and time.perf_counter() - start > seconds:
            break
        given = actions(block)
        for name in order:
            taken[name].append(players[name](given) / block)
        order.append(order.pop(0))
    return taken


def _vector(domain: str, task: str, num_envs: int, num_threads: int) -> VectorEnv:
    return load_vector(
        domain,
        task,
        num_envs,
        time_limit=math.inf,
        num_threads=num_threads,
        flat=True,
        dtype="float32",
    )


def player(step: Callable[[np.ndarray], Any]) -> Player:
    """A player of an environment with this `step`."""

    def play(actions: np.ndarray) -> float:
        start = time.perf_counter()
        for action in actions:
            step(action)
        return time.perf_counter() - start

    return play


def _state(environment: BatchEnvironment) -> np.ndarray:
    """What a batch's steps depend on, (num_envs, nstate), live."""
    return environment.physics._simulation.state


_random = np.random.RandomState(_SEED)


def _actions(shape: tuple[int, ...], num_steps: int) -> np.ndarray:
    # Numbers that float32 has, too: the vector environment's own type.
    drawn = _random.uniform(-1, 1, (num_steps, *shape)).astype(np.float32)
    return drawn.astype(np.float64)
