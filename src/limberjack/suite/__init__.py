"""The suite: every task by domain and name.

from limberjack import suite

env = suite.load("humanoid", "walk", task_kwargs={"random": 0})
for domain, task in suite.ALL_TASKS: ...
"""

import collections
import inspect
from collections.abc import Iterable, Mapping
from types import ModuleType
from typing import Any

from limberjack.rl import control
from limberjack.rl.batch import BatchEnvironment
from limberjack.suite import humanoid, manipulator, stacker
from limberjack.utils.suggest import did_you_mean

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
    "load",
    "load_batch",
]

_Tasks = tuple[tuple[str, str], ...]

_DOMAINS: dict[str, ModuleType] = {
    "humanoid": humanoid,
    "manipulator": manipulator,
    "stacker": stacker,
}


def _get_tasks(tag: str | None) -> _Tasks:
    """The (domain, task) pairs that have a tag; all of them for None."""
    return tuple(
        (domain, task)
        for domain, module in sorted(_DOMAINS.items())
        for task in (module.SUITE if tag is None else module.SUITE.tagged(tag))
    )


def _get_tasks_by_domain(tasks: Iterable[tuple[str, str]]) -> dict[str, tuple[str, ...]]:
    """The names of the tasks of each domain."""
    by_domain = collections.defaultdict(list)
    for domain, task in tasks:
        by_domain[domain].append(task)
    return {domain: tuple(names) for domain, names in by_domain.items()}


ALL_TASKS = _get_tasks(None)
BENCHMARKING = _get_tasks("benchmarking")
EASY = _get_tasks("easy")
HARD = _get_tasks("hard")
EXTRA = tuple(sorted(set(ALL_TASKS) - set(BENCHMARKING)))
NO_REWARD_VIZ = _get_tasks("no_reward_visualization")
REWARD_VIZ = tuple(sorted(set(ALL_TASKS) - set(NO_REWARD_VIZ)))
TASKS_BY_DOMAIN = _get_tasks_by_domain(ALL_TASKS)


def load(
    domain_name: str,
    task_name: str,
    task_kwargs: Mapping[str, Any] | None = None,
    environment_kwargs: Mapping[str, Any] | None = None,
    visualize_reward: bool = False,
) -> control.Environment:
    """An environment of the suite.

    Args:
      domain_name: such as 'humanoid'.
      task_name: such as 'walk'.
      task_kwargs: keyword arguments of the task's factory, such as {'random': 0}.
      environment_kwargs: keyword arguments of `control.Environment`, such as
        {'flat_observation': True}.
      visualize_reward: colour materials by the reward at each step.

    Raises:
      ValueError: there is no such domain or task.
      TypeError: there is no such keyword.
    """
    return build_environment(
        domain_name, task_name, task_kwargs, environment_kwargs, visualize_reward
    )


def load_batch(
    domain_name: str,
    task_name: str,
    num_envs: int,
    num_threads: int | None = None,
    seed: int | None = None,
    task_kwargs: Mapping[str, Any] | None = None,
    environment_kwargs: Mapping[str, Any] | None = None,
    on_divergence: str = "end",
) -> BatchEnvironment:
    """Many environments of the suite in lockstep; see `limberjack.rl.batch`.

    Args:
      domain_name: such as 'humanoid'.
      task_name: such as 'walk'.
      num_envs: number of rows.
      num_threads: threads that step them; by default the cores that this process may use.
      seed: row i is `load` with `{'random': seed + i}`; None for any seed.
      task_kwargs: as for `load`, without 'random'.
      environment_kwargs: as for `load`.
      on_divergence: 'end' ends the episodes of rows that diverge; 'raise' raises `PhysicsError`.

    Raises:
      ValueError: there is no such domain or task, or a number is out of range.
      TypeError: there is no such keyword.
    """
    if "random" in (task_kwargs or {}):
        raise TypeError(
            "load_batch takes no 'random' in task_kwargs: give seed, one per row follows"
        )
    env = load(domain_name, task_name, task_kwargs, environment_kwargs)
    return BatchEnvironment.from_environment(env, num_envs, num_threads, seed, on_divergence)


def build_environment(
    domain_name: str,
    task_name: str,
    task_kwargs: Mapping[str, Any] | None = None,
    environment_kwargs: Mapping[str, Any] | None = None,
    visualize_reward: bool = False,
) -> control.Environment:
    """An environment of the suite: what `load` calls, with the same arguments and errors."""
    _check_choice(domain_name, _DOMAINS, f"Domain {domain_name!r} does not exist.")
    tasks = _DOMAINS[domain_name].SUITE
    _check_choice(
        task_name, tasks, f"Level {task_name!r} does not exist in domain {domain_name!r}."
    )
    kwargs = dict(task_kwargs or {})
    if environment_kwargs is not None:
        kwargs["environment_kwargs"] = dict(environment_kwargs)
    where = f"{domain_name}:{task_name}"
    _check_keywords(where, kwargs, tasks[task_name])
    _check_environment_keywords(where, kwargs.get("environment_kwargs") or {})
    environment = tasks[task_name](**kwargs)
    environment.task.visualize_reward = visualize_reward
    return environment


def _check_choice(name: str, choices: Iterable[str], message: str) -> None:
    if name not in choices:
        raise ValueError(
            f"{message}{did_you_mean(name, choices)} Choose one of: {', '.join(sorted(choices))}."
        )


def _check_environment_keywords(where: str, given: Mapping[str, Any]) -> None:
    """Raises if the environment does not take a keyword, or the task sets it itself."""
    if "time_limit" in given:
        raise TypeError(f"{where}: time_limit is an argument of the task; give it in task_kwargs")
    if "control_timestep" in given and "n_sub_steps" not in given:
        raise TypeError(
            f"{where} sets control_timestep itself; for another one make a "
            "control.Environment(env.physics, env.task, control_timestep=...)"
        )
    _check_keywords(where, given, control.Environment)


def _check_keywords(where: str, given: Mapping[str, Any], factory: Any) -> None:
    """Raises if `factory` does not take a keyword."""
    parameters = inspect.signature(factory).parameters
    if any(p.kind is p.VAR_KEYWORD for p in parameters.values()):
        return
    for name in given:
        if name not in parameters:
            raise TypeError(
                f"{where} got an unexpected keyword argument {name!r}."
                f"{did_you_mean(name, parameters)} It takes: {', '.join(parameters)}."
            )
