"""`measure`: what a batch adds to the physics, and steps per second by number of threads.

    result = measure("walker", "walk", num_threads=[1, 2], columns=["step", "training"])
    for row in result.rows:
        print(row.what, row.num_threads, row.cells["step"].steps_per_second)

A column does the work of the first one and more:

    step        a vector environment steps with random actions
    inference   a policy computes actions at each observation too: the bundled one of the task, or a
                network of random weights. The steps are those of `step`: its actions are not used
    training    the learner of `limberjack train` acts and learns with the settings of the task, but
                does not repeat actions: one action is one control step, as in the other columns

EnvPool steps beside the first column where it is installed and has the task; its episodes are
others.
"""

import contextlib
import dataclasses
import importlib
import importlib.metadata
import importlib.util
import itertools
import math
import os
import statistics
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from dm_env import specs

from limberjack.bench.contest import (
    SEED,
    Contest,
    batch_of_task,
    random_actions,
    take_turns,
    vector_env,
)
from limberjack.policies import bundled, mlp
from limberjack.rl.action_specs import bounds_to_try
from limberjack.rl.batches import vectorisable
from limberjack.rl.guards import at_least_one
from limberjack.rl.observations import FLAT_OBSERVATION_KEY
from limberjack.training.settings import Settings, settings_for
from limberjack.utils import cores
from limberjack.utils.suggest import did_you_mean
from limberjack.workers.factories import Factory, Make, factory_of

__all__ = ["COLUMNS", "NEARLY_BEST", "OURS", "Cell", "Result", "Row", "Speed", "measure"]

COLUMNS = ("step", "inference", "training")
NEARLY_BEST = 0.95  # share of the highest speed; threads beyond it are better used elsewhere
OURS = "Limberjack"

_SHARE = 0.95  # of the steps, whose longest is reported
_STATM = Path("/proc/self/statm")  # Linux's; its second number is that of resident pages
# Of training, whose steps may take seconds: the first one learns, the second one compiles.
_SLOW = {"min_rounds": 3, "warm_up_steps": 2, "rows_per_block": 1}

# Called with what is being measured, and the share of all that is done, from 0 to 1.
_OnProgress = Callable[[str, float], object]
_Step = Callable[[np.ndarray], object]
_Side = tuple[str, int]  # what steps, and its threads


@dataclasses.dataclass(frozen=True)
class Speed:
    """The speed of one contestant."""

    what: str  # 'physics', 'batch' or 'vector'
    num_envs: int
    num_threads: int
    steps_per_second: float  # of all rows together
    ratio: float  # to that of 'physics', which did the same steps in turns with it


@dataclasses.dataclass(frozen=True)
class Cell:
    """A measurement of one column with one number of threads.

    Attributes:
      steps_per_second: of all rows together; the median over turns.
      ratio: speed relative to the fewest threads, which took turns with it.
      seconds_95: the time that 95 % of the steps stay below; one steps all rows.
    """

    steps_per_second: float
    ratio: float
    seconds_95: float


@dataclasses.dataclass(frozen=True)
class Row:
    """The measurements with one number of threads.

    Attributes:
      what: `OURS`, or EnvPool with its version.
      num_threads: that step the rows.
      cells: by column.
      megabytes: by which the process grew for the first column's environments and one step; the
        model does not count. None where the system does not report it.
    """

    what: str
    num_threads: int
    cells: Mapping[str, Cell]
    megabytes: float | None


@dataclasses.dataclass(frozen=True)
class Result:
    """The result of `measure`.

    Attributes:
      facts: what identifies the task; see `workers.factories.Factory`.
      speeds: of 'physics', 'batch' and 'vector' with equally many threads.
      rows: by number of threads; EnvPool's last.
      missing: the reason why a column was not measured, by column.
      recommended_threads: the fewest threads that reach `NEARLY_BEST` of the highest speed, by
        column.
    """

    facts: Mapping[str, str | None]
    speeds: tuple[Speed, ...]
    rows: tuple[Row, ...]
    missing: Mapping[str, str]
    recommended_threads: Mapping[str, int]


def measure(
    domain: str | Make,
    task: str | None = None,
    num_envs: int = 256,
    num_threads: Sequence[int] | None = None,
    seconds: float = 3.0,
    columns: Sequence[str] = ("step", "inference"),
    on_progress: _OnProgress | None = None,
) -> Result:
    """Measures how fast a task steps.

    Args:
      domain: such as 'humanoid', or a function `make(seed) -> control.Environment`.
      task: such as 'walk'; None with a function.
      num_envs: number of rows.
      num_threads: the numbers to try; None for 1, 2, 4 ... and the cores that this process may use.
      seconds: approximate time of each comparison, without its preparation.
      columns: some of `COLUMNS`.
      on_progress: called between blocks of steps, with what is being measured and the share of all
        that is done.

    Raises:
      ValueError: there is no such domain, task or column, it cannot be played in batches, its
        episodes are too short, or a number is out of range.
      TypeError: the function does not make an environment.
    """
    num_envs = at_least_one("num_envs", num_envs)
    counts, columns = _counts(num_threads, num_envs), _checked_columns(columns)
    if not seconds > 0:
        raise ValueError(f"seconds is {seconds!r}; expected a positive number")
    report = on_progress or (lambda what, share: None)
    report("preparing", 0.0)
    parts = 1 + len(columns)
    factory = factory_of(domain, task)
    with Contest(domain, task, num_envs, counts[-1]) as contest:
        spec = contest.environment.action_spec()
        sweep = _Sweep(factory, num_envs, counts, seconds, spec, contest.episode)
        players = {"physics": contest.physics, "batch": contest.batch, "vector": contest.vector}
        taken = take_turns(
            players,
            contest.actions,
            seconds,
            episode=contest.episode,
            on_round=lambda share: report("comparing with MuJoCo alone", share / parts),
        )
    speeds = [
        Speed(what, num_envs, counts[-1], *_speed(num_envs, taken[what], taken["physics"]))
        for what in taken
    ]
    for part, column in enumerate(columns, start=1):
        report("preparing", part / parts)
        sweep.measure(column, lambda share, part=part: report("measuring", (part + share) / parts))
    rows = sweep.rows()
    return Result(factory.facts, tuple(speeds), rows, sweep.missing, sweep.recommended())


def _counts(num_threads: Sequence[int] | None, num_envs: int) -> list[int]:
    """The numbers of threads in rising order; raises ValueError if one is out of range."""
    if num_threads is None:
        most = min(cores.usable_cores(), num_envs)
        return sorted({most, *(2**i for i in range(most.bit_length()))})
    counts = sorted({at_least_one("num_threads", count) for count in num_threads})
    if not counts or counts[-1] > num_envs:
        raise ValueError(
            f"num_threads is {[*num_threads]}; expected numbers from 1 to {num_envs}, the number "
            "of environments"
        )
    return counts


def _checked_columns(columns: Sequence[str]) -> list[str]:
    """The columns in their order; raises ValueError if one is unknown or there is none."""
    for column in columns:
        if column not in COLUMNS:
            raise ValueError(
                f"there is no column {column!r}; expected some of {', '.join(COLUMNS)}."
                f"{did_you_mean(column, COLUMNS)}"
            )
    if not columns:
        raise ValueError(f"columns is empty; expected some of {', '.join(COLUMNS)}")
    return [column for column in COLUMNS if column in columns]


def _speed(num_envs: int, taken: list[float], first: list[float]) -> tuple[float, float]:
    """Steps per second, and the speed relative to that of the first."""
    ratio = statistics.median(a / b for a, b in zip(first, taken, strict=True))
    return num_envs / statistics.median(taken), ratio


@dataclasses.dataclass
class _Sweep:
    """One task's measurements so far.

    Attributes:
      factory: of the task.
      num_envs: rows of each batch.
      counts: numbers of threads, in rising order.
      seconds: of a column.
      spec: of the actions of all rows.
      episode: the most steps of an episode.
      cells: by side and column.
      megabytes: by side, of the first column.
      missing: reasons why a column was not measured, by column.
    """

    factory: Factory
    num_envs: int
    counts: Sequence[int]
    seconds: float
    spec: specs.BoundedArray
    episode: int
    cells: dict[_Side, dict[str, Cell]] = dataclasses.field(default_factory=dict)
    megabytes: dict[_Side, float | None] = dataclasses.field(default_factory=dict)
    missing: dict[str, str] = dataclasses.field(default_factory=dict)

    def rows(self) -> tuple[Row, ...]:
        """The rows of the result."""
        sides = self.cells.items()
        return tuple(Row(*side, cells, self.megabytes[side]) for side, cells in sides)

    def recommended(self) -> dict[str, int]:
        """The fewest threads that are nearly as fast as any number, by column."""
        ours = [(count, cells) for (what, count), cells in self.cells.items() if what == OURS]
        found = {}
        for column in ours[0][1] if ours else ():
            enough = NEARLY_BEST * max(cells[column].ratio for _, cells in ours)
            found[column] = next(n for n, cells in ours if cells[column].ratio >= enough)
        return found

    def measure(self, column: str, on_round: Callable[[float], object]) -> None:
        """Measures a column, or notes the reason why it cannot be measured."""
        with contextlib.ExitStack() as stack:
            # Batches share its compiled model, which is no memory of theirs.
            stack.callback(vectorisable(self.factory.make(SEED)).close)
            makers = {(OURS, n): partial(_MAKERS[column], self, n, stack) for n in self.counts}
            if column == "step":
                makers |= _makers_of_envpool(self, stack)
            first = random_actions(self.spec, 1)[0]
            try:
                players = {side: _Timed(make, first) for side, make in makers.items()}
            except ImportError as error:
                self.missing[column] = str(error)
                return
            taken = take_turns(
                players,
                partial(random_actions, self.spec),
                self.seconds,
                episode=self.episode - 1,
                on_round=on_round,
                **(_SLOW if column == "training" else {}),
            )
        for side, player in players.items():
            self.megabytes.setdefault(side, player.megabytes)
            speed = _speed(self.num_envs, taken[side], taken[OURS, self.counts[0]])
            self.cells.setdefault(side, {})[column] = Cell(*speed, player.longest())


class _Timed:
    """A `Player` that keeps the time of each step, and the memory that making it took."""

    def __init__(self, make: Callable[[], _Step], first: np.ndarray) -> None:
        before = _resident()
        self._step = make()
        self._step(first)
        after = _resident()
        self.megabytes = None if before is None or after is None else max(0.0, after - before)
        self._calls: list[list[float]] = []

    def __call__(self, actions: np.ndarray) -> float:
        seconds = []
        for action in actions:
            start = time.perf_counter()
            self._step(action)
            seconds.append(time.perf_counter() - start)
        self._calls.append(seconds)
        return sum(seconds)

    def longest(self) -> float:
        """The seconds that most steps stay below; those of the warm-up do not count."""
        return float(np.quantile([*itertools.chain(*self._calls[1:])], _SHARE))


def _resident() -> float | None:
    """Megabytes of this process; None where the system does not report them."""
    try:
        pages = int(_STATM.read_text(encoding="ascii").split()[1])
    except OSError:
        return None
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def _stepping(sweep: _Sweep, num_threads: int, stack: contextlib.ExitStack) -> _Step:
    env = vector_env(sweep.factory, sweep.num_envs, num_threads)
    stack.callback(env.close)
    env.reset(seed=SEED)
    return env.step


def _inferring(sweep: _Sweep, num_threads: int, stack: contextlib.ExitStack) -> _Step:
    env = vector_env(sweep.factory, sweep.num_envs, num_threads)
    stack.callback(env.close)
    observations, _ = env.reset(seed=SEED)
    policy = _policy(sweep.factory.facts, observations.shape[-1], sweep.spec)

    def step(action: np.ndarray) -> None:
        nonlocal observations
        policy.actions(observations)
        observations, *_ = env.step(action)

    return step


def _policy(
    facts: Mapping[str, str | None], num_observations: int, spec: specs.BoundedArray
) -> mlp.Mlp:
    """The bundled policy of a task, or a network of random weights, as wide as those."""
    for one in bundled():
        if (one.domain, one.task) == (facts.get("domain"), facts.get("task")):
            return mlp.load(one.path)
    if not num_observations:
        raise ValueError(
            "the task observes nothing that a policy could act on: measure the column 'step' alone"
        )
    low, high = (bound[0].ravel() for bound in bounds_to_try(spec))
    sizes = [num_observations, *Settings.actor, len(low)]
    random = np.random.RandomState(SEED)
    layers = [
        (random.normal(0, 1 / math.sqrt(inputs), (outputs, inputs)), np.zeros(outputs))
        for inputs, outputs in itertools.pairwise(sizes)
    ]
    layout = ((FLAT_OBSERVATION_KEY, (num_observations,)),)
    return mlp.Mlp(layers, mlp.Card(layout, tuple(low.tolist()), tuple(high.tolist())))


def _training(sweep: _Sweep, num_threads: int, stack: contextlib.ExitStack) -> _Step:
    # NumPy's global stream, which these packages draw from.
    stack.callback(np.random.set_state, np.random.get_state())
    learner = importlib.import_module("limberjack.training.learner")
    from limberjack import sb3

    facts, num_envs = sweep.factory.facts, sweep.num_envs
    settings = dataclasses.replace(
        settings_for(facts.get("domain") or "", facts.get("task")),
        action_repeat=1,
        num_envs=num_envs,
        random_steps=num_envs,  # of the first step, which learns nothing
        steps=num_envs * sweep.episode,
    )
    batch = batch_of_task(sweep.factory, num_envs, num_threads)
    envs = sb3.VecEnv(batch, action_bound=settings.action_bound)
    stack.callback(envs.close)
    events = Path(stack.enter_context(tempfile.TemporaryDirectory()))
    one = learner.Learner(envs, settings, SEED, events)
    stack.callback(one.close)
    return lambda action: one.step()  # it chooses actions itself


_MAKERS = {"step": _stepping, "inference": _inferring, "training": _training}


def _makers_of_envpool(
    sweep: _Sweep, stack: contextlib.ExitStack
) -> dict[_Side, Callable[[], _Step]]:
    """Those of EnvPool's environments; none where it is not installed or lacks the task."""
    facts = sweep.factory.facts
    if importlib.util.find_spec("envpool") is None or "domain" not in facts:
        return {}
    import envpool  # pyright: ignore[reportMissingImports]

    words = f"{facts['domain']}_{facts['task']}".split("_")
    name = "".join(word[:1].upper() + word[1:] for word in words) + "-v1"
    if name not in envpool.list_all_envs():
        return {}
    title = f"EnvPool {importlib.metadata.version('envpool')}"

    def make(num_threads: int) -> _Step:
        how = {"num_envs": sweep.num_envs, "num_threads": num_threads, "seed": SEED}
        env = envpool.make_gymnasium(name, **how)
        stack.callback(env.close)
        env.reset()
        return env.step

    return {(title, count): partial(make, count) for count in sweep.counts}
