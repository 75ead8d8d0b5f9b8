"""Sets of tasks: those of papers by their names, the suite's tags, and lists.

    from limberjack.registry import sets

    sets.tasks_of("dmc28")      # (('acrobot', 'swingup'), ('ball_in_cup', 'catch'), ...)
    sets.find("dmc28").source   # the code that defines it
    sets.tasks_of(["cheetah:run", "walker:walk"])   # (('cheetah', 'run'), ('walker', 'walk'))
    sets.tasks_of("cheetah:run,walker:walk")        # the same

The sets of papers are fixed. Those of the suite's tags are its constants: `all` and `extra` have
the tasks of registered domains too.
"""

import contextlib
import dataclasses
from collections.abc import Callable, Iterable, Iterator, Sequence

from limberjack.registry import TASKS, domains
from limberjack.utils.suggest import did_you_mean

__all__ = ["SetError", "TaskSet", "Tasks", "find", "names", "refusals_named", "tasks_of"]

_Tasks = tuple[tuple[str, str], ...]
_OnProgress = Callable[[str, int, float], object]  # see `workers.state.OnProgress`


class SetError(ValueError):
    """A task of a set was refused before it was played; the message names it."""


@dataclasses.dataclass(frozen=True)
class TaskSet:
    """Tasks that are evaluated together."""

    name: str
    tasks: _Tasks  # (domain, task) pairs
    source: str  # the code that defines the set


# See `find`.
Tasks = str | TaskSet | Sequence[str] | Sequence[tuple[str, str]]

# Those that DrQ-v2, which learns from pixels, calls hard are the three of the humanoid.
_HARD = (
    ("dog", "stand"),
    ("dog", "walk"),
    ("dog", "trot"),
    ("dog", "run"),
    ("humanoid", "stand"),
    ("humanoid", "walk"),
    ("humanoid", "run"),
)
_SPARSE = (
    ("ball_in_cup", "catch"),
    ("cartpole", "balance_sparse"),
    ("cartpole", "swingup_sparse"),
    ("finger", "spin"),
    ("finger", "turn_easy"),
    ("finger", "turn_hard"),
    ("reacher", "easy"),
    ("reacher", "hard"),
)

# The suite's tasks among the 30 of TD-MPC2, and those that files of its own add to the suite's
# domains: examples/many_tasks.py loads them.
_MT30 = (
    ("walker", "stand"),
    ("walker", "walk"),
    ("walker", "run"),
    ("cheetah", "run"),
    ("reacher", "easy"),
    ("reacher", "hard"),
    ("acrobot", "swingup"),
    ("pendulum", "swingup"),
    ("cartpole", "balance"),
    ("cartpole", "balance_sparse"),
    ("cartpole", "swingup"),
    ("cartpole", "swingup_sparse"),
    ("ball_in_cup", "catch"),
    ("finger", "spin"),
    ("finger", "turn_easy"),
    ("finger", "turn_hard"),
    ("fish", "swim"),
    ("hopper", "stand"),
    ("hopper", "hop"),
)
# The 21 tasks that papers call easy and medium.
_EASY_AND_MEDIUM = (*_MT30, ("quadruped", "walk"), ("quadruped", "run"))
_MORE_OF_MT30 = (
    ("walker", "walk_backwards"),
    ("walker", "run_backwards"),
    ("cheetah", "run_backwards"),
    ("cheetah", "run_front"),
    ("cheetah", "run_back"),
    ("cheetah", "jump"),
    ("hopper", "hop_backwards"),
    ("reacher", "three_easy"),
    ("reacher", "three_hard"),
    ("ball_in_cup", "spin"),
    ("pendulum", "spin"),
)

# Those on which the looks of DMC-GB2 are tested.
_DMCGB2 = (
    ("walker", "walk"),
    ("walker", "stand"),
    ("cheetah", "run"),
    ("finger", "spin"),
    ("cartpole", "swingup"),
    ("ball_in_cup", "catch"),
)

# Those of the combined challenges of the Real World RL suite, which `--faults` adds.
_RWRL = (("cartpole", "swingup"), ("humanoid", "walk"), ("quadruped", "walk"), ("walker", "walk"))

_OF_THE_SUITE = tuple((row.domain, row.task) for row in TASKS)

_SIMBAV2 = "scale_rl/envs/dmc.py in https://github.com/DAVIAN-Robotics/SimbaV2, commit 86899c2"
_SETS_OF_PAPERS = (
    TaskSet(
        "dmc28",
        tuple(sorted((*_EASY_AND_MEDIUM, *_HARD), key=_OF_THE_SUITE.index)),
        f"DMC_EASY_MEDIUM and DMC_HARD of {_SIMBAV2}; the list dmc in MRQ/utils.py of "
        "https://github.com/facebookresearch/MRQ, commit 8a44a7d, has the same tasks",
    ),
    TaskSet("dmc-hard", _HARD, f"DMC_HARD of {_SIMBAV2}"),
    TaskSet("dmc-sparse", _SPARSE, f"DMC_SPARSE of {_SIMBAV2}"),
    TaskSet(
        "mt30",
        (*_MT30, *_MORE_OF_MT30),
        "TASK_SET in tdmpc2/common/__init__.py of https://github.com/nicklashansen/tdmpc2, commit "
        "e9f5932; its files in tdmpc2/envs/tasks add the last eleven to the domains",
    ),
    TaskSet(
        "rwrl",
        _RWRL,
        "https://arxiv.org/abs/2003.11881, and realworldrl_suite/environments of "
        "https://github.com/google-research/realworldrl_suite, commit be7a51c; its combined "
        "challenges are presets of --faults",
    ),
    TaskSet(
        "dmcgb2",
        _DMCGB2,
        "the tasks in README.md of https://github.com/aalmuzairee/dmcgb2, commit 5fd8fd7; its "
        "modes are presets of --appearance",
    ),
)


def names() -> tuple[str, ...]:
    """The names of all sets."""
    return tuple(one.name for one in _sets())


def find(tasks: Tasks) -> TaskSet:
    """The set of a name, or of a list.

    Args:
      tasks: such as 'dmc28'; or a list of tasks such as 'walker:walk' or ('walker', 'walk'); or one
        text with commas, 'cheetah:run,walker:walk'; or a set.

    Raises:
      ValueError: there is no such set, the list is empty, or something is no name of a task.
      TypeError: it is none of these.
    """
    if isinstance(tasks, TaskSet):
        return tasks
    if isinstance(tasks, str):
        for one in _sets():
            if one.name == tasks:
                return one
        if ":" not in tasks:
            raise ValueError(
                f"no set of tasks {tasks!r}; expected one of {', '.join(names())}, or tasks such "
                f"as walker:walk,fish:swim.{did_you_mean(tasks, names())}"
            )
        tasks = tasks.split(",")
    if not isinstance(tasks, Iterable):
        raise TypeError(f"tasks are {tasks!r}; expected a list such as ['walker:walk']")
    pairs = tuple(map(_pair, tasks))
    twice = [":".join(pair) for pair in dict.fromkeys(pairs) if pairs.count(pair) > 1]
    if twice:
        raise ValueError(f"the list of tasks has {', '.join(twice)} twice; expected each task once")
    if not pairs:
        raise ValueError("the list of tasks is empty; expected names such as 'walker:walk'")
    return TaskSet(",".join(map(":".join, pairs)), pairs, "a list")


def _pair(task: object) -> tuple[str, str]:
    """Domain and task."""
    pair = tuple(task.split(":")) if isinstance(task, str) else task
    match pair:
        case [str(domain), str(name)]:
            return domain.strip(), name.strip()
    raise ValueError(f"a task is {task!r}; expected a name such as 'walker:walk'")


def tasks_of(tasks: Tasks) -> _Tasks:
    """The (domain, task) pairs of a set or list; see `find`."""
    return find(tasks).tasks


@contextlib.contextmanager
def refusals_named(domain: str, task: str, on_progress: _OnProgress) -> Iterator[_OnProgress]:
    """Yields `on_progress` for a task of a set, and names the task if it is refused.

    Raises:
      SetError: a ValueError was raised before the task's first step, at which the function that is
        yielded is called. Subclasses of ValueError stay.
    """
    has_begun = False

    def show(what: str, finished: int, part: float = 0.0) -> None:
        nonlocal has_begun
        has_begun = True
        on_progress(what, finished, part)

    try:
        yield show
    except ValueError as error:
        if has_begun or type(error) is not ValueError:
            raise
        raise SetError(f"{domain} {task}: {error}") from error


def _sets() -> tuple[TaskSet, ...]:
    """The sets of papers, and those of the suite's tags as they are now."""
    registered = tuple(
        (row.domain, row.task)
        for domain in domains().values()
        if domain.source == "registered"
        for row in domain.rows
    )
    tags = {
        tag: tuple((row.domain, row.task) for row in TASKS if tag in row.tags)
        for tag in ("benchmarking", "easy", "hard")
    }
    rest = sorted({*_OF_THE_SUITE} - {*tags["benchmarking"]})
    tasks = {"all": _OF_THE_SUITE + registered, "extra": (*rest, *registered), **tags}
    constants = {name: f"dm_control's suite.{name.upper()}" for name in tasks}
    constants["all"] = "dm_control's suite.ALL_TASKS"
    tagged = (TaskSet(name, of_tag, constants[name]) for name, of_tag in tasks.items())
    return (*_SETS_OF_PAPERS, *tagged)
