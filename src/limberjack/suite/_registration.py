"""User domains: registration, discovery of installed ones, and pickling.

    suite.register("swing", "my_package.swing")

`registry` stores the domains, and this module decides what may be registered. A domain's module is
checked with all of its problems in one message; the check creates an environment of each task,
which also gives the episode lengths.
"""

import importlib
import inspect
import math
import sys
from collections.abc import Callable, Iterator, Mapping, MutableMapping
from types import ModuleType
from typing import Any

import dm_env
import numpy as np
from dm_env import specs

from limberjack import registry
from limberjack.registry import Domain, Row
from limberjack.rl import control
from limberjack.rl.copies import control_of
from limberjack.rl.shared_streams import fingerprint, put_back_after
from limberjack.suite import base

__all__ = [
    "Domains",
    "Registration",
    "find",
    "find_installed",
    "register",
    "registration_of",
    "require",
    "rows_of",
    "sizes_of",
    "take_another_mapping",
    "unregister",
]

_KEYWORDS = ("time_limit", "random", "environment_kwargs")  # required of every factory


def register(name: str, module: ModuleType | str) -> None:
    """Adds a domain, which then works wherever a domain's name is accepted.

    The domain can be loaded by `suite.load` and `load_batch`, gets Gymnasium ids, and appears in
    `ALL_TASKS`, `EXTRA`, `TASKS_BY_DOMAIN` and `REWARD_VIZ` (or `NO_REWARD_VIZ`). Registering the
    same module again has no effect. A module may register itself in its last line:

        suite.register("swing", __name__)

    Args:
      name: a Python identifier not used by another domain.
      module: the module, or its dotted name; docs/adding_a_domain.md describes its contents.

    Raises:
      TypeError: `module` is neither a module nor a string.
      ValueError: the name is taken or not an identifier, or the module is incomplete; the message
        lists all problems.
      ImportError: there is no module with this name.
    """
    loaded = importlib.import_module(module) if isinstance(module, str) else module
    if not isinstance(loaded, ModuleType):
        raise TypeError(f"module is {module!r}; expected a module, or its dotted name")
    known = registry.domains().get(name)
    if known is not None:
        if known.module not in (loaded, registry.import_name_of(loaded)):
            raise ValueError(_taken(known, loaded.__name__))
        if known.source in ("suite", "registered"):
            return
    rows = rows_of(name, loaded)
    registry.add(Domain(name, _by_name(loaded), rows, source="registered"))


def unregister(name: str) -> None:
    """Removes a domain that was registered, assigned or discovered; its module stays imported.

    Raises:
      ValueError: there is no such domain, or it belongs to the suite.
    """
    known = registry.domains().get(name)
    if known is None:
        raise ValueError(f"there is no domain {name!r} to unregister")
    if known.source == "suite":
        raise ValueError(f"domain {name!r} belongs to the suite; only other domains can be removed")
    registry.remove(name)


def find(name: str) -> Domain | None:
    """The domain with this name, including those of installed packages; None if there is none.

    Raises:
      ValueError: several installed packages provide it, or its module cannot be imported or is
        incomplete.
    """
    if not isinstance(name, str):
        return None
    known = registry.domains().get(name)
    if known is not None:
        return known
    # Imported lazily: rarely needed, and slow to import.
    from limberjack.suite import _entry_points as entry_points

    module = entry_points.module_of(name)
    if module is None:
        return None
    try:
        loaded = importlib.import_module(module)
    except ImportError as error:
        raise ValueError(
            f"domain {name!r} is provided by {module}, from an installed package, which cannot be "
            f"imported: {error}"
        ) from error
    if name not in registry.domains():  # unless the module has registered itself
        rows = rows_of(name, loaded)
        registry.add(Domain(name, module, rows, source="installed"))
    return registry.domains()[name]


def find_installed() -> dict[str, str]:
    """Discovers the domains of all installed packages; returns problems of failed ones by name."""
    from limberjack.suite import _entry_points as entry_points

    problems = {}
    for name, modules in entry_points.installed().items():
        known = registry.domains().get(name)
        if known is not None and known.source == "suite":
            problems[name] = f"{', '.join(modules)}: the name belongs to the suite"
            continue
        try:
            find(name)
        except Exception as error:  # a user's package may raise anything; continue with the others
            problems[name] = f"{', '.join(modules)}: {' '.join(str(error).split())}"
    return problems


def require(name: str, module: str) -> None:
    """Makes sure that a domain is registered under this name with this module.

    Raises:
      ValueError: the name belongs to another module in this process.
      ImportError: the module cannot be imported in this process.
    """
    known = registry.domains().get(name)
    if known is None:
        loaded = importlib.import_module(module)
        if name not in registry.domains():
            try:
                register(name, loaded)
            except ValueError:  # an assigned domain need not pass the checks, in any process
                Domains()[name] = loaded
        known = registry.domains()[name]
    if known.import_name != module:
        raise ValueError(_taken(known, module))


class Registration:
    """The domain of an environment; unpickling imports and registers its module."""

    def __init__(self, name: str, module: str) -> None:
        """Stores the name of the domain and the dotted name of its module."""
        self.name = name
        self.module = module

    def __deepcopy__(self, memo: object) -> "Registration":
        return self

    def __reduce__(self) -> tuple[object, ...]:
        return _registered, (self.name, self.module)


def registration_of(name: str) -> Registration | registry.NotImportable:
    """The registration of a known domain."""
    module = registry.domains()[name].import_name
    return registry.NotImportable(name) if module is None else Registration(name, module)


def _registered(name: str, module: str) -> Registration:
    """Unpickles a `Registration`, and registers its domain."""
    require(name, module)
    return Registration(name, module)


class Domains(MutableMapping[str, ModuleType]):
    """The registry as dm_control's `suite._DOMAINS`: modules by name, imported when read.

    Assigning a module replaces any domain of that name without validation, as in dm_control, and
    does not change the constants.
    """

    def __getitem__(self, name: str) -> ModuleType:
        return registry.domains()[name].load()

    def __setitem__(self, name: str, module: ModuleType) -> None:
        if not hasattr(module, "SUITE"):
            raise TypeError(f"_DOMAINS[{name!r}] is {module!r}; expected a module with a SUITE")
        suite = module.SUITE
        tagged = {str(tag): suite.tagged(tag) for tag in getattr(suite, "tags", list)()}
        rows = tuple(
            Row(name, task, tuple(tag for tag, tasks in tagged.items() if task in tasks), None, 0)
            for task in suite
        )
        registry.add(Domain(name, _by_name(module), rows, source="assigned"))

    def __delitem__(self, name: str) -> None:
        registry.remove(name)

    def copy(self) -> dict[str, ModuleType]:
        """The domains as a dict, all imported."""
        return dict(self)

    def __or__(self, others: Mapping[str, ModuleType]) -> dict[str, ModuleType]:
        return self.copy() | dict(others)

    def __contains__(self, name: object) -> bool:
        return name in registry.domains()

    def __iter__(self) -> Iterator[str]:
        return iter(list(registry.domains()))

    def __len__(self) -> int:
        return len(registry.domains())

    def __repr__(self) -> str:
        return f"{type(self).__name__}({list(self)})"


class _SuiteModule(ModuleType):
    """`limberjack.suite`, in which programs for dm_control put another dict for `_DOMAINS`."""

    _DOMAINS: Domains

    def __setattr__(self, name: str, value: Any) -> None:  # of any program
        if name != "_DOMAINS" or isinstance(value, Domains):
            super().__setattr__(name, value)
            return
        for domain in [one for one in self._DOMAINS if one not in value]:
            del self._DOMAINS[domain]
        for domain, module in value.items():
            if domain not in self._DOMAINS or self._DOMAINS[domain] is not module:
                self._DOMAINS[domain] = module


def take_another_mapping(name: str) -> None:
    """Lets programs put another dict for `_DOMAINS` in a module, whose domains it takes."""
    sys.modules[name].__class__ = _SuiteModule


def _by_name(module: ModuleType) -> ModuleType | str:
    """The dotted name of a module if it can be imported by name, otherwise the module."""
    return registry.import_name_of(module) or module


def _taken(known: Domain, module: str) -> str:
    """Error message for a domain name that is taken, with advice for `module`."""
    owner = known.import_name or known.load().__name__
    advice = f"give {module} another name"
    if known.source == "suite":
        return f"domain name {known.name!r} belongs to the suite, as {owner}; {advice}"
    return (
        f"domain name {known.name!r} is registered already, as {owner}; {advice}, or call "
        f"suite.unregister({known.name!r}) first"
    )


def rows_of(name: str, module: ModuleType) -> tuple[Row, ...]:
    """The registry rows of a domain's tasks.

    Raises:
      ValueError: the name is not an identifier, or the module is incomplete.
    """
    problems: list[str] = []
    rows: list[Row] = []
    if not (isinstance(name, str) and name.isidentifier()):
        problems.append(f"the name {name!r} is not a Python identifier")
    suite = getattr(module, "SUITE", None)
    if not (isinstance(suite, Mapping) and callable(getattr(suite, "tagged", None))):
        problems.append(
            f"SUITE is {'missing' if suite is None else repr(suite)}; expected a "
            "limberjack.utils.containers.TaggedTasks"
        )
    elif not suite:
        problems.append("SUITE has no tasks; decorate each factory with @SUITE.add()")
    else:
        problems += _picture_problems(module, suite)
        for task in suite:
            row = _row(name, task, suite, problems)
            rows += [] if row is None else [row]
    if problems:
        text = "; ".join(f"({number}) {what}" for number, what in enumerate(problems, 1))
        raise ValueError(f"domain {name!r}, module {module.__name__}, cannot be registered: {text}")
    return tuple(rows)


def _picture_problems(module: ModuleType, suite: Mapping[str, object]) -> list[str]:
    """Problems with a module's `PICTURES`."""
    pictures = getattr(module, "PICTURES", {})
    if not isinstance(pictures, Mapping):
        return [f"PICTURES is {pictures!r}; expected a base.Picture for each task, by name"]
    return [
        *(f"PICTURES has a task {task!r}, SUITE has not" for task in pictures if task not in suite),
        *(
            f"PICTURES[{task!r}] is {picture!r}; expected a limberjack.suite.base.Picture"
            for task, picture in pictures.items()
            if not isinstance(picture, base.Picture)
        ),
    ]


# Any: a user's `TaggedTasks`, which may hold anything.
def _row(name: str, task: object, suite: Any, problems: list[str]) -> Row | None:
    """The row of a task; if it has problems, appends them to `problems` and returns None."""
    factory = suite[task]
    if not (isinstance(task, str) and task.isidentifier()):
        problems.append(f"the task name {task!r} is not a Python identifier")
        return None
    missing = _missing_keywords(factory)
    if missing:
        problems.append(f"factory {task} does not accept {', '.join(missing)}")
        return None
    try:
        environment = factory(random=0)
    except Exception as error:  # a user's factory may raise anything; reported with the others
        problems.append(f"factory {task} raises {type(error).__name__}: {error}")
        return None
    if not isinstance(environment, dm_env.Environment):
        what = type(environment).__name__
        problems.append(
            f"factory {task} returns a {what}; expected a control.Environment, or another "
            "dm_env.Environment"
        )
        return None
    inner = control_of(environment)  # of a wrapper; it may have none
    wrong, dof, steps = [], 0, None
    if isinstance(inner, control.Environment):
        wrong = _task_problems(inner)
        dof = getattr(getattr(inner.physics, "model", None), "nv", 0)
        steps = control.Environment.step_limit.of(inner)
    if isinstance(inner, control.Environment) and not wrong:
        wrong = _play_problems(environment, inner, factory)
        problems += [f"the environment of {task} {what}" for what in wrong]
    else:
        problems += [f"the task of {task} has {what}" for what in wrong]
    tags = tuple(str(tag) for tag in suite.tags() if task in suite.tagged(tag))
    row = None if wrong else Row(name, task, tags, steps, int(dof), *sizes_of(environment))
    environment.close()
    return row


# Any: an environment of a user, whose specs may have any form.
def sizes_of(environment: Any) -> tuple[int | None, int | None]:
    """Numbers of an action and of an observation; None for specs of another form."""
    found: list[int | None] = []
    for spec in environment.action_spec(), environment.observation_spec():
        parts = [*spec.values()] if isinstance(spec, Mapping) else [spec]
        arrays = [part for part in parts if isinstance(part, specs.Array)]
        is_known = len(arrays) == len(parts)
        found.append(sum(math.prod(array.shape) for array in arrays) if is_known else None)
    return found[0], found[1]


def _missing_keywords(factory: object) -> list[str]:
    assert callable(factory)
    parameters = inspect.signature(factory).parameters
    if any(p.kind is p.VAR_KEYWORD for p in parameters.values()):
        return []
    return [name for name in _KEYWORDS if name not in parameters]


def _play_problems(
    environment: dm_env.Environment,
    inner: control.Environment,
    factory: Callable[..., dm_env.Environment],
) -> list[str]:
    """Problems that another environment of the same seed shows, and a first step."""
    with put_back_after():
        try:
            other = factory(random=0)
            tasks = [getattr(one, "task", None) for one in (inner, control_of(other))]
            streams = [getattr(task, "random", None) for task in tasks]
            drawn = {fingerprint(one) for one in streams if isinstance(one, np.random.RandomState)}
            other.close()
            if len(drawn) > 1:
                return ["has another stream each time for random=0: give the task `random`"]
            environment.reset()
            environment.observation_spec()
            spec = environment.action_spec()
            if isinstance(spec, specs.BoundedArray):
                zero = np.zeros(spec.shape, spec.dtype)
                environment.step(np.clip(zero, spec.minimum, spec.maximum))
                control.Environment.success.of(inner)
        except Exception as error:  # a user's code may raise anything; reported with the others
            return [f"raises {type(error).__name__} in its first step: {error}"]
    return []


def _task_problems(environment: control.Environment) -> list[str]:
    """Problems with the task attributes that other modules read."""
    task, wrong = environment.task, []
    for attribute in ("EPISODE_FIELDS", "GOAL", "STARTS"):
        names = getattr(task, attribute, ())
        if not isinstance(names, tuple) or not all(isinstance(name, str) for name in names):
            wrong.append(f"{attribute} = {names!r}; expected a tuple of names")
    cost = getattr(task, "planner_cost", None)
    if cost is not None and not (isinstance(cost, str) and cost.count(":") == 1):
        wrong.append(f"planner_cost = {cost!r}; expected 'module:Class', or None")
    return wrong
