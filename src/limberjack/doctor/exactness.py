"""`compare`: whether all tasks return the same bits here as on machines whose bits are stored.

    result = exactness.compare()
    print(result.is_equal, result.departures, result.unequal_batches)

Each task is played for 60 control steps from two seeds, in single environments and in a batch on
two threads, with the same actions. Rewards and observations are compared with a stored run: an
equal one, or else that of the nearest kind of machine. The batch is also compared with the single
environments of this machine. Actions are sixteenths of the range between their bounds, which no
processor rounds.

It measures this machine's arithmetic: `make test-exactness` compares with dm_control.
"""

import dataclasses
from collections.abc import Callable, Mapping, Sequence

import dm_env
import numpy as np
from dm_env import specs

from limberjack import suite
from limberjack.doctor.stored_bits import KEPT, Field, Kind, Run, StoredBits, field_of
from limberjack.rl.action_specs import bounds_to_try
from limberjack.rl.batch import BatchEnvironment
from limberjack.utils.suggest import did_you_mean

__all__ = ["Amount", "Comparison", "Departure", "Played", "compare", "departure", "played"]

_STEPS = max(KEPT)
_ROWS = 2  # with the seeds 0 and 1
_THREADS = 2
_PARTS = 16  # of the range of an action: a power of two, so that actions are not rounded

_Values = Mapping[str, np.ndarray]  # by field: (steps + 1, rows, ...), of a task
# Called with a task, the number of those that have been played and that of all.
_OnProgress = Callable[[str, int, int], object]


@dataclasses.dataclass(frozen=True)
class Played:
    """Results of a task on this machine."""

    single: _Values
    batch: _Values


@dataclasses.dataclass(frozen=True)
class Amount:
    """The largest absolute difference of a field's values at a step."""

    step: int
    difference: float


@dataclasses.dataclass(frozen=True)
class Departure:
    """The first step of a task whose bits differ.

    Attributes:
      task: such as 'walker:walk'.
      how: 'single', or 'batch' where only the batch differs.
      step: control steps since the start, which is step 0.
      field: the first that differs at that step: 'reward', or the name of an observation.
      amounts: of that field, at that step and later ones whose values are stored.
      largest: the largest difference of any field at those steps.
    """

    task: str
    how: str
    step: int
    field: str
    amounts: tuple[Amount, ...]
    largest: float


@dataclasses.dataclass(frozen=True)
class Comparison:
    """The result of `compare`.

    Attributes:
      here: the kind of this machine.
      stored: that of the stored run.
      tasks: number of tasks that were compared.
      departures: of tasks that differ from the stored run, in the order of the suite.
      unequal_batches: of batches that differ from single environments of this machine, which
        limberjack promises not to happen anywhere.
    """

    here: Kind
    stored: Kind
    tasks: int
    departures: tuple[Departure, ...]
    unequal_batches: tuple[Departure, ...]

    @property
    def is_equal(self) -> bool:
        """Whether every bit is the stored one."""
        return not self.departures


def compare(
    stored: StoredBits | None = None,
    tasks: Sequence[str] | None = None,
    on_progress: _OnProgress = lambda *_: None,
) -> Comparison:
    """Plays the tasks and compares their bits; all of the suite's take about 8 seconds.

    Args:
      stored: the package's by default.
      tasks: names such as 'walker:walk'; by default all that are stored, which are the suite's.
      on_progress: called before each task.

    Raises:
      ValueError: one of the tasks is not stored.
    """
    stored = StoredBits.read() if stored is None else stored
    here = Kind.here()
    results: dict[str, Played] = {}
    known = stored.runs[0].tasks
    names = list(known) if tasks is None else tasks
    for name in names:
        if name not in known:
            raise ValueError(
                f"no bits of {name!r} are stored; expected names of the suite's tasks, such as "
                f"'walker:walk'.{did_you_mean(name, known)}"
            )
    for number, name in enumerate(names):
        on_progress(name, number, len(names))
        results[name] = played(*name.split(":"))
    run = _nearest(here, stored, results)
    return Comparison(
        here,
        run.kind,
        len(results),
        tuple(
            filter(None, (departure(name, run.tasks[name], one) for name, one in results.items()))
        ),
        tuple(filter(None, (_unequal_batch(name, one) for name, one in results.items()))),
    )


def _nearest(here: Kind, stored: StoredBits, results: Mapping[str, Played]) -> Run:
    """The stored run that is equal, or that of the nearest kind if none is."""
    runs = sorted(stored.runs, key=lambda run: run.kind.nearness(here), reverse=True)
    for run in runs:
        if not any(departure(name, run.tasks[name], one) for name, one in results.items()):
            return run
    return runs[0]


def played(domain: str, task: str) -> Played:
    """The rewards and observations of a task, from single environments and a batch.

    Every array has a leading axis of steps, the first of which is the start, and one of rows.
    """
    environments = [suite.load(domain, task, task_kwargs={"random": seed}) for seed in range(_ROWS)]
    actions = _actions(environments[0].action_spec())
    rows = [_steps(one, actions[:, seed]) for seed, one in enumerate(environments)]
    single = {name: np.stack([row[name] for row in rows], axis=1) for name in rows[0]}
    batch = suite.load_batch(domain, task, _ROWS, num_threads=_THREADS, seed=0)
    return Played(single, _steps(batch, actions))


def _actions(spec: specs.BoundedArray) -> np.ndarray:
    """Random actions, (steps, rows, ...)."""
    low, high = bounds_to_try(spec)
    parts = np.random.RandomState(0).randint(_PARTS + 1, size=(_STEPS, _ROWS, *spec.shape))
    return low + (high - low) * parts / _PARTS


def _steps(
    environment: dm_env.Environment | BatchEnvironment, actions: np.ndarray
) -> dict[str, np.ndarray]:
    """Each observation and the reward, (steps + 1, ...), of an environment or a batch."""
    time_steps = [environment.reset(), *map(environment.step, actions)]
    fields = {
        name: np.array([time_step.observation[name] for time_step in time_steps], float)
        for name in time_steps[0].observation
    }
    # A single environment has no reward at its start, a batch zeros.
    rewards = [np.asarray(time_step.reward, float) for time_step in time_steps[1:]]
    return {**fields, "reward": np.stack([np.zeros_like(rewards[0]), *rewards])}


def departure(name: str, stored: Mapping[str, Field], found: Played) -> Departure | None:
    """The first departure of a task from the stored run; None if all bits are equal.

    Args:
      name: of the task.
      stored: its fields.
      found: what it returned here.
    """
    for how, values in (("single", found.single), ("batch", found.batch)):
        first = _first_departure(name, how, stored, values)
        if first is not None:
            return first
    return None


def _unequal_batch(name: str, found: Played) -> Departure | None:
    """The first step at which the batch differs from the single environments."""
    fields = {field: field_of(values) for field, values in found.single.items()}
    return _first_departure(name, "batch", fields, found.batch)


def _first_departure(
    name: str, how: str, stored: Mapping[str, Field], values: _Values
) -> Departure | None:
    found = {field: field_of(array) for field, array in values.items()}
    steps = {
        field: int(np.argmax(unequal))
        for field, one in found.items()
        if (unequal := one.checksums != stored[field].checksums).any()
    }
    if not steps:
        return None
    field = min(steps, key=steps.__getitem__)  # of several the first
    amounts = {one: _amounts(found[one], stored[one], steps[field]) for one in found}
    largest = max(amount.difference for some in amounts.values() for amount in some)
    return Departure(name, how, steps[field], field, amounts[field], largest)


def _amounts(found: Field, stored: Field, first: int) -> tuple[Amount, ...]:
    """Differences of a field at the stored steps from the first on."""
    differences = np.abs(found.values - stored.values).max(axis=-1)
    return tuple(
        Amount(step, float(difference))
        for step, difference in zip(KEPT, differences, strict=True)
        if step >= first
    )
