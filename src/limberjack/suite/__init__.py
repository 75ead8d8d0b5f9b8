"""The suite: all tasks by domain and name.

    from limberjack import suite

    env = suite.load("humanoid", "walk", task_kwargs={"random": 0})
    for domain, task in suite.ALL_TASKS: ...

A domain is imported on first use: by `load`, or as `suite.humanoid`. The constants are dm_control's
tuples; `register` appends to all of them except `BENCHMARKING`, `EASY` and `HARD`. `tasks` returns
the current list, including tasks added to a domain's `SUITE` later.
"""

import dataclasses
import importlib
import inspect
from collections.abc import Callable, Iterable, Mapping, Sequence
from types import ModuleType
from typing import Any, Literal, overload

import dm_env

from limberjack import registry
from limberjack.registry.sets import Tasks
from limberjack.rl import control
from limberjack.rl.batch import BatchEnvironment
from limberjack.rl.batch_contract import Batch
from limberjack.rl.batches import batch_of
from limberjack.rl.builds import Build
from limberjack.rl.copies import control_of, difference
from limberjack.rl.many import ManyTasks
from limberjack.rl.rows import RowsEnvironment
from limberjack.rl.streams import set_forgotten_fields
from limberjack.suite import many
from limberjack.suite._registration import (
    Domains,
    find,
    find_installed,
    register,
    registration_of,
    require,
    take_another_mapping,
    unregister,
)
from limberjack.utils.keywords import keywords, with_keywords
from limberjack.utils.suggest import check_names, did_you_mean

__all__ = [
    "ALL_TASKS",
    "BENCHMARKING",
    "EASY",
    "EXTRA",
    "HARD",
    "NO_REWARD_VIZ",
    "REWARD_VIZ",
    "TASKS_BY_DOMAIN",
    "build_environment",
    "build_of",
    "find_installed",
    "load",
    "load_batch",
    "load_halves",
    "module_of",
    "register",
    "require",
    "tasks",
    "unregister",
]

_Tasks = tuple[tuple[str, str], ...]
_Option = str | Mapping[str, object] | None  # of the world

_NO_VISUALIZATION = "no_reward_visualization"  # dm_control's tag
_OF_TASKS = ("physics", "task", "time_limit")  # arguments of an environment that tasks give it

_DOMAINS = Domains()
take_another_mapping(__name__)


def _get_tasks(tag: str | None) -> _Tasks:
    """The (domain, task) pairs with a tag; all for None."""
    return tuple(
        (domain, task)
        for domain, module in sorted(_DOMAINS.items())
        for task in (module.SUITE if tag is None else module.SUITE.tagged(tag))
    )


def _get_tasks_by_domain(tasks: Iterable[tuple[str, str]]) -> dict[str, tuple[str, ...]]:
    """The names of the tasks of each domain."""
    return registry.by_domain(tasks)


def tasks(tag: str | None = None) -> _Tasks:
    """The current (domain, task) pairs with a tag; all for None.

    Imports all known domains: the suite's and the ones registered, assigned to `_DOMAINS` or
    discovered. Call `find_installed` first to discover the domains of installed packages.
    """
    return _get_tasks(tag)


def _rows(*tags: str) -> _Tasks:
    """The suite's own tasks with all of the tags, from the table."""
    return tuple((row.domain, row.task) for row in registry.TASKS if {*tags} <= {*row.tags})


ALL_TASKS = _rows()
BENCHMARKING = _rows("benchmarking")
EASY = _rows("easy")
HARD = _rows("hard")
EXTRA = tuple(sorted(set(ALL_TASKS) - set(BENCHMARKING)))
NO_REWARD_VIZ = _rows(_NO_VISUALIZATION)
REWARD_VIZ = tuple(sorted(set(ALL_TASKS) - set(NO_REWARD_VIZ)))
TASKS_BY_DOMAIN = registry.by_domain(ALL_TASKS)


def _update_constants(domain: registry.Domain, is_added: bool) -> None:
    """Updates the constants when a domain is registered or unregistered."""
    global ALL_TASKS, EXTRA, NO_REWARD_VIZ, REWARD_VIZ, TASKS_BY_DOMAIN
    if domain.source != "registered":
        return
    shown = [(row.domain, row.task) for row in domain.rows if _NO_VISUALIZATION not in row.tags]
    all_of_it = tuple((row.domain, row.task) for row in domain.rows)
    change = _appended if is_added else _without
    ALL_TASKS = change(ALL_TASKS, all_of_it)
    EXTRA = change(EXTRA, all_of_it)
    REWARD_VIZ = change(REWARD_VIZ, tuple(shown))
    NO_REWARD_VIZ = change(NO_REWARD_VIZ, tuple(task for task in all_of_it if task not in shown))
    TASKS_BY_DOMAIN = registry.by_domain(ALL_TASKS)


def _appended(known: _Tasks, new: _Tasks) -> _Tasks:
    return (*known, *(task for task in new if task not in known))


def _without(known: _Tasks, old: _Tasks) -> _Tasks:
    return tuple(task for task in known if task not in old)


registry.listen(_update_constants)


def __getattr__(name: str) -> ModuleType:
    """Imports a domain of the suite when it is first accessed as an attribute."""
    if any(row.domain == name for row in registry.TASKS):
        return importlib.import_module(registry.suite_module(name))
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *(row.domain for row in registry.TASKS)})


def load(
    domain_name: str,
    task_name: str,
    task_kwargs: Mapping[str, object] | None = None,
    environment_kwargs: Mapping[str, object] | None = None,
    visualize_reward: bool = False,
    *,
    action_repeat: int | None = None,
    faults: _Option = None,
    appearance: _Option = None,
) -> control.Environment:
    """An environment of the suite.

    Args:
      domain_name: such as 'humanoid'.
      task_name: such as 'walk'.
      task_kwargs: keyword arguments of the task's factory, such as {'random': 0}.
      environment_kwargs: keyword arguments of `control.Environment`, such as
        {'flat_observation': True}.
      visualize_reward: whether to colour materials by the reward at each step.
      action_repeat: control steps per action; see `control.Environment.step`. None leaves it to
        the factory of the task.
      faults: of the real world, such as 'easy' or {'delay': {'actions': 3}}; see
        `limberjack.worlds.faults`.
      appearance: of pictures, such as 'color_hard' or {'background': 'noise'}; see
        `limberjack.worlds.appearance`.

    Raises:
      ValueError: there is no such domain or task, or no such faults or appearance; or actions
        cannot be repeated in an environment of another class than `control.Environment`.
      TypeError: there is no such keyword.
    """
    of_environment = with_keywords(
        "environment_kwargs", environment_kwargs, faults=faults, appearance=appearance
    )
    environment = build_environment(
        domain_name, task_name, task_kwargs, of_environment or None, visualize_reward
    )
    if action_repeat is not None:
        why = difference(environment)
        if why is not None:
            raise ValueError(
                f"action_repeat is {action_repeat}, but {domain_name}:{task_name} makes an "
                f"environment of its own kind: {why}; use load_batch, or call step repeatedly"
            )
        control.set_action_repeat(environment, action_repeat)
    return environment


@overload
def load_batch(
    domain_name: str,
    task_name: str,
    num_envs: int,
    num_threads: int | None = None,
    seed: int | None = None,
    task_kwargs: Mapping[str, object] | None = None,
    environment_kwargs: Mapping[str, object] | None = None,
    on_divergence: str = "end",
    *,
    vectorised: Literal[False],
    action_repeat: int | None = None,
    stagger: bool = False,
    faults: _Option = None,
    appearance: _Option = None,
) -> RowsEnvironment: ...


# Of a task that cannot be vectorised it returns a RowsEnvironment; all of the suite's can be.
@overload
def load_batch(
    domain_name: str,
    task_name: str,
    num_envs: int,
    num_threads: int | None = None,
    seed: int | None = None,
    task_kwargs: Mapping[str, object] | None = None,
    environment_kwargs: Mapping[str, object] | None = None,
    on_divergence: str = "end",
    *,
    vectorised: Literal[True] | None = None,
    action_repeat: int | None = None,
    stagger: bool = False,
    faults: _Option = None,
    appearance: _Option = None,
) -> BatchEnvironment: ...


@overload
def load_batch(
    domain_name: Tasks,
    *,
    num_envs: int | None = None,
    num_threads: int | None = None,
    seed: int | None = None,
    task_kwargs: Mapping[str, object] | None = None,
    environment_kwargs: Mapping[str, object] | None = None,
    on_divergence: str = "end",
    rows: int | Sequence[int] | None = None,
    vectorised: bool | None = None,
    action_repeat: int | None = None,
    stagger: bool = False,
    faults: _Option = None,
    appearance: _Option = None,
) -> ManyTasks: ...


def load_batch(
    domain_name: Tasks,
    task_name: str | None = None,
    num_envs: int | None = None,
    num_threads: int | None = None,
    seed: int | None = None,
    task_kwargs: Mapping[str, object] | None = None,
    environment_kwargs: Mapping[str, object] | None = None,
    on_divergence: str = "end",
    *,
    rows: int | Sequence[int] | None = None,
    vectorised: bool | None = None,
    action_repeat: int | None = None,
    stagger: bool = False,
    faults: _Option = None,
    appearance: _Option = None,
) -> Batch:
    """Many environments of the suite, stepped in lockstep; see `limberjack.rl.batch`.

    The suite's own tasks are vectorised. A registered one that cannot be is played in complete
    environments; see `limberjack.rl.batches`. Several tasks are one batch of padded arrays; see
    `limberjack.rl.many`.

    Args:
      domain_name: such as 'humanoid'; or several tasks: a list such as ['cheetah:run',
        'walker:walk'], or the name of a set such as 'dmc28', see `limberjack.registry.sets`.
      task_name: such as 'walk'; None with several tasks.
      num_envs: number of rows; of several tasks together, or give `rows`.
      num_threads: number of threads; by default as many of the available cores as the work of a
        step can occupy.
      seed: row i equals `load` with `{'random': seed + i}`; None for an arbitrary seed.
      task_kwargs: as for `load`, without 'random'.
      environment_kwargs: as for `load`.
      on_divergence: 'end' ends the episodes of rows that diverge; 'raise' raises `PhysicsError`.
      vectorised: None vectorises the task if that changes no number; True raises the reason if it
        would; False makes complete environments.
      action_repeat: control steps per action; see `control.Environment.step`. None leaves it to
        the factory of the task.
      rows: of each of several tasks: a number for all, or a list with one for each.
      stagger: end the first episode of each row after a random number of steps, so that rows do not
        end together; see `limberjack.rl.streams`.
      faults: as for `load`, of each row.
      appearance: as for `load`, of each row.

    Raises:
      ValueError: there is no such domain, task or set, or a number is out of range; or `vectorised`
        is True and the task cannot be vectorised.
      TypeError: there is no such keyword, or `rows` is given for one task.
    """
    of_environment = with_keywords(
        "environment_kwargs", environment_kwargs, faults=faults, appearance=appearance
    )
    how: dict[str, Any] = {  # Any: of `batch_of`
        "num_threads": num_threads,
        "seed": seed,
        "on_divergence": on_divergence,
        "vectorised": vectorised,
        "action_repeat": action_repeat,
        "stagger": stagger,
    }
    if task_name is None:
        how |= {"task_kwargs": task_kwargs, "environment_kwargs": of_environment}
        return many.load(load_batch, 1, domain_name, rows, num_envs, **how)[0]
    if not isinstance(domain_name, str):
        raise TypeError(f"task_name is {task_name!r}; expected None with a list of tasks")
    if num_envs is None or rows is not None:
        raise TypeError(
            f"num_envs is {num_envs} and rows is {rows}; expected num_envs for one task, and rows "
            "only for a list of tasks"
        )
    if "random" in keywords("task_kwargs", task_kwargs):
        raise TypeError(
            "load_batch does not accept 'random' in task_kwargs: pass seed instead, from which "
            "each row gets its own"
        )
    build = build_of(domain_name, task_name, task_kwargs, of_environment or None)
    batch = batch_of(build, num_envs, **how)
    batch.registration = getattr(control_of(build.original), "registration", None)
    return batch


def load_halves(
    tasks: Tasks,
    rows: int | Sequence[int] | None = None,
    num_envs: int | None = None,
    **kwargs: Any,  # of `load_batch`, which checks them
) -> tuple[ManyTasks, ManyTasks]:
    """The two halves of the batch of several tasks, for `gym.VectorEnv`; see `load_batch`.

    Raises:
      ValueError, TypeError: see `load_batch`; or there is only one row.
    """
    first, second = many.load(load_batch, 2, tasks, rows, num_envs, **kwargs)
    return first, second


def build_of(
    domain_name: str,
    task_name: str,
    task_kwargs: Mapping[str, object] | None = None,
    environment_kwargs: Mapping[str, object] | None = None,
) -> Build:
    """Loads the environment of a task, as `original`, and makes others of it for any seed.

    It has the arguments and errors of `load`; another seed takes the place of 'random'.
    """
    env = load(domain_name, task_name, task_kwargs, environment_kwargs)
    loaded = _Loaded(domain_name, task_name, task_kwargs, environment_kwargs)
    return Build(loaded, f"{domain_name}:{task_name}", env)


@dataclasses.dataclass(frozen=True)
class _Loaded:
    """Loads a task with a seed, also in a copy or another process."""

    domain_name: str
    task_name: str
    task_kwargs: Mapping[str, object] | None
    environment_kwargs: Mapping[str, object] | None

    def __call__(self, seed: int) -> dm_env.Environment:
        kwargs = {**(self.task_kwargs or {}), "random": seed}
        return load(self.domain_name, self.task_name, kwargs, self.environment_kwargs)


def module_of(domain_name: str) -> ModuleType:
    """The module of a domain, imported if necessary; includes domains of installed packages.

    Raises:
      ValueError: there is no such domain.
    """
    domain = find(domain_name)
    if domain is None:
        message = f"Domain {domain_name!r} does not exist."
        raise ValueError(
            f"{_no_choice(domain_name, _DOMAINS, message)} Register one of your own first: "
            "suite.register(name, module), or --import MODULE before a command"
        )
    return domain.load()


def build_environment(
    domain_name: str,
    task_name: str,
    task_kwargs: Mapping[str, object] | None = None,
    environment_kwargs: Mapping[str, object] | None = None,
    visualize_reward: bool = False,
) -> control.Environment:
    """The implementation of `load`, with the same arguments and errors."""
    factories = module_of(domain_name).SUITE
    if task_name not in factories:
        message = f"Task {task_name!r} does not exist in domain {domain_name!r}."
        raise ValueError(_no_choice(task_name, factories, message))
    kwargs = keywords("task_kwargs", task_kwargs)
    if environment_kwargs is not None:
        given = kwargs.get("environment_kwargs")
        kwargs["environment_kwargs"] = {
            **(given if isinstance(given, Mapping) else {}),
            **keywords("environment_kwargs", environment_kwargs),
        }
    of_environment = kwargs.get("environment_kwargs")
    where = f"{domain_name}:{task_name}"
    _check_keywords(where, kwargs, factories[task_name])
    if isinstance(of_environment, Mapping):
        _check_environment_keywords(where, of_environment)
    try:
        environment = factories[task_name](**kwargs)
    except (TypeError, KeyError) as error:  # a KeyError within an `except`, in CPython 3.11
        if not str(error).endswith("'control_timestep'"):
            raise
        raise TypeError(
            f"{where} sets control_timestep itself; for another value create a "
            "control.Environment(env.physics, env.task, control_timestep=...)"
        ) from None
    inner = control_of(environment)  # a registered factory may return a wrapper
    if isinstance(inner, control.Environment):
        inner._ours.registration = registration_of(domain_name)
        inner._ours.name = where
        set_forgotten_fields(inner.task, inner.physics.simulation)
        inner._ours.seeded = getattr(inner.task, "random", None), kwargs.get("random")
        inner.task.visualize_reward = visualize_reward
    return environment


def _no_choice(name: str, choices: Iterable[str], message: str) -> str:
    """The message, followed by a suggestion and the choices."""
    return f"{message}{did_you_mean(name, choices)} Choose one of: {', '.join(sorted(choices))}."


def _check_environment_keywords(where: str, given: Mapping[str, object]) -> None:
    """Raises TypeError if the environment does not accept a keyword."""
    if "time_limit" in given:
        raise TypeError(f"{where}: time_limit is an argument of the task; pass it in task_kwargs")
    known = [n for n in inspect.signature(control.Environment).parameters if n not in _OF_TASKS]
    check_names(f"{where} got an unexpected keyword argument in environment_kwargs", given, known)


def _check_keywords(
    where: str, given: Mapping[str, object], factory: Callable[..., object]
) -> None:
    """Raises TypeError if `factory` does not accept a keyword."""
    parameters = inspect.signature(factory).parameters
    if any(p.kind is p.VAR_KEYWORD for p in parameters.values()):
        return
    check_names(f"{where} got an unexpected keyword argument", given, parameters)
