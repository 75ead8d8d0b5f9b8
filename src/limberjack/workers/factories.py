"""`factory_of`: makes an environment by its names in the suite, or with a function of your own.

    factory = factory_of("humanoid", "walk", time_limit=2.0)
    factory = factory_of(my_package.make)       # make(seed) -> dm_env.Environment
    environment = factory.make(seed=0)
    factory.facts       # {"environment": "my_package:make", "environment_sha256": "..."}

`evaluate`, `record` and `bench.measure` take either. A function is identified by its module, its
name and the hash of its package, and a domain that is not the suite's by its name and the hash of
its module's package. A lambda, a function within a function, a partial or an object
with `__call__` depends on more than its source: it has no hash, so its results cannot be kept.
"""

import dataclasses
import sys
from collections.abc import Callable, Mapping

import dm_env

from limberjack import registry, suite
from limberjack.policies import name_of
from limberjack.policies.kinds import Locating
from limberjack.rl.builds import Build, takes_a_seed
from limberjack.utils.seeds import checked_seed
from limberjack.utils.sources import defined_in, hash_of_module, hash_of_source, imported
from limberjack.utils.suggest import check_names
from limberjack.worlds import OPTIONS, World

__all__ = ["Factory", "Make", "factory_of"]

# Makes an environment whose first episode belongs to the seed.
Make = Callable[[int], dm_env.Environment]


@dataclasses.dataclass(frozen=True)
class Factory:
    """Makes environments of one task.

    Attributes:
      title: its name in pictures and messages.
      facts: its identity in results: `domain` and `task`, with `domain_sha256` unless the domain is
        the suite's; or `environment` and `environment_sha256`.
      make: makes an environment whose first episode belongs to the seed; raises ValueError if there
        is no such domain, task or time limit, and TypeError if the function makes something else.
      time_limit: seconds per episode; None for the task's own.
      world: options of the world; see `limberjack.worlds`.
    """

    title: str
    facts: dict[str, str | None]
    make: Make
    time_limit: float | None = None
    world: World | None = None

    def build(self, environment: dm_env.Environment) -> Build:
        """The build of the rows of a batch.

        Args:
          environment: one that the factory made; a task of the suite is vectorised with it.
        """
        is_named = "domain" in self.facts
        return Build(self.make, self.title, environment if is_named else None)

    def lasting(self, time_limit: float | None = None) -> "Factory":
        """The same factory with another time limit, the task's own if None; a function stays."""
        domain, task = self.facts.get("domain"), self.facts.get("task")
        if domain is None or task is None:
            return self
        return _of_the_suite(domain, task, time_limit, self.world)

    @property
    def is_known(self) -> bool:
        """Whether its facts distinguish it from every other factory."""
        return None not in self.facts.values()


def factory_of(
    domain: str | Make | dm_env.Environment,
    task: str | None = None,
    time_limit: float | None = None,
    world: World | None = None,
) -> Factory:
    """The factory of a task of the suite, or of a function `make(seed) -> dm_env.Environment`.

    Args:
      domain: a name such as 'humanoid', the function, or an environment to copy.
      task: such as 'walk'; None with a function or an environment.
      time_limit: seconds per episode; None for the task's own, as it must be with a function.
      world: options such as {'faults': 'easy'}, see `limberjack.worlds`; None with a function.

    Raises:
      TypeError: arguments are missing or too many, or the function takes no seed.
      ValueError: there is no such domain, or its module cannot be imported.
    """
    if isinstance(domain, dm_env.Environment):
        _refuse_beside(type(domain).__name__, task, time_limit, world)
        name = type(domain).__name__
        facts: dict[str, str | None] = {"environment": name, "environment_sha256": None}
        return Factory(name, facts, Build.of(domain).make)
    if not callable(domain):
        if task is None:
            raise TypeError(f"domain is {domain!r} and task is None; expected the name of a task")
        return _of_the_suite(domain, task, time_limit, world)
    name = name_of(domain)
    _refuse_beside(name, task, time_limit, world)
    if not takes_a_seed(domain):
        raise TypeError(f"{name} cannot be called with a seed; expected make(seed) -> Environment")
    is_named = defined_in(domain) is domain and imported(name) is domain
    sha256 = hash_of_source(domain) if is_named else None
    facts = {"environment": name, "environment_sha256": sha256}

    def make(seed: int) -> dm_env.Environment:
        first = checked_seed(seed)
        with Locating(f"environment {name!r}, as it is made with seed {first}"):
            return Build(domain, name).make(first)

    return Factory(name, facts, make)


def _refuse_beside(
    name: str, task: str | None, time_limit: float | None, world: World | None
) -> None:
    for argument, value in (("task", task), ("time_limit", time_limit), ("world", world)):
        if value is not None:
            raise TypeError(
                f"{argument} is {value!r}, but {name} makes the environment: leave it out, and set "
                "it there"
            )


def _of_the_suite(domain: str, task: str, time_limit: float | None, world: World | None) -> Factory:
    more = {} if time_limit is None else {"time_limit": time_limit}
    if world is not None and not isinstance(world, Mapping):
        raise TypeError(f"world is {world!r}; expected a mapping, such as {{'faults': 'easy'}}")
    check_names("world has no option", world or {}, OPTIONS)
    of_environment = dict(world) if world else None

    def make(seed: int) -> dm_env.Environment:
        return suite.load(domain, task, {"random": checked_seed(seed), **more}, of_environment)

    facts = {"domain": domain, "task": task, **_source_of(domain)}
    return Factory(f"{domain} {task}", facts, make, time_limit, world)


def _source_of(domain: str) -> dict[str, str | None]:
    """The hash of a domain's module, by name; empty for the suite's, which versions identify."""
    known = registry.domains().get(domain)
    if known is not None and known.source == "suite":
        return {}
    module = suite.module_of(domain)
    is_imported = sys.modules.get(module.__name__) is module
    return {"domain_sha256": hash_of_module(module.__name__) if is_imported else None}
