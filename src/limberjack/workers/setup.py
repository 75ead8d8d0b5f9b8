"""`Setup`: everything that a worker needs to play seeds, and the proof that it plays the same bits.

    setup = prepare("manipulator", "bring_ball", "planner")     # in the driver
    here = setup.opened()                                       # in a worker; proves itself first
    here.environment.reseed(seed)

A setup is small and can be pickled: it holds names, the policy's source or the bytes of its model,
and the driver's identity and canary, which every worker must reproduce before it plays.
"""

import collections
import contextlib
import dataclasses
import functools
import hashlib
import pickle
import pkgutil
import socket
import threading

import dm_env

from limberjack import policies
from limberjack.policies import ROWS, Actor, PolicyError
from limberjack.policies.kinds import repeat_for
from limberjack.rl.builds import Build, own_repeat
from limberjack.utils.facts import Facts
from limberjack.workers.factories import Factory, Make, factory_of
from limberjack.workers.identity import (
    advice_on,
    canary_of,
    first_difference,
    identity_of,
)
from limberjack.workers.shipping import Shipped, ship, unpack
from limberjack.worlds import World

__all__ = ["Opened", "Refused", "Setup", "prepare", "setup_of"]

_KEPT_OPEN = 4  # setups per thread: a policy, the two baselines and one more


class Refused(ValueError):  # noqa: N818 (an answer, not a fault of the code)
    """A worker does not reproduce the driver's identity or canary; the message names the field."""


@dataclasses.dataclass(frozen=True)
class _Made:
    """Arguments of `factory_of`, as another process can use them."""

    domain: str  # of the suite or registered; or MODULE:FUNCTION
    task: str | None
    time_limit: float | None
    world: World | None
    registration: object  # registers the domain where it is unpickled

    def factory(self) -> Factory:
        if self.task is None:
            return factory_of(pkgutil.resolve_name(self.domain))
        return factory_of(self.domain, self.task, self.time_limit, self.world)


@dataclasses.dataclass(frozen=True)
class Opened:
    """A setup in the process and thread that plays it.

    Attributes:
      environment: of the task; reseed it before each use.
      build: makes environments like `environment`, for any seed.
      factory: made the environment.
      actor: the policy, which no other thread uses.
    """

    environment: dm_env.Environment
    build: Build
    factory: Factory
    actor: Actor


@dataclasses.dataclass(frozen=True, eq=False)
class Setup:
    """See the module's docstring.

    Attributes:
      made: arguments that make the environment again.
      policy: the policy to send to workers.
      identity: everything that an episode depends on except its seed, as values of JSON.
      canary: SHA-256 of a few steps, which another kind of processor may not reproduce.
      unit_size: seeds that are played together: 64, or 1 if the policy plays alone.
      num_threads: threads of each worker; None for as many as the work can occupy.
      any_processor: accept workers with another fingerprint or canary.
      action_repeat: control steps per action.
      vectorised: see `rl.batch_of`; it changes no number.
    """

    made: _Made
    policy: Shipped
    identity: Facts
    canary: str
    unit_size: int
    num_threads: int | None = None
    any_processor: bool = False
    action_repeat: int = 1
    vectorised: bool | None = None

    @functools.cached_property
    def key(self) -> str:
        """SHA-256 of the setup, in hex."""
        return hashlib.sha256(pickle.dumps(self)).hexdigest()

    def __getstate__(self) -> dict[str, object]:
        return {name: value for name, value in self.__dict__.items() if name != "key"}

    def with_policy(self, policy: str, actor: Actor, identity: Facts) -> "Setup":
        """The same task with another policy.

        Args:
          policy: its name.
          actor: the policy.
          identity: see `workers.identity.identity_of`.
        """
        more = {"policy": ship(policy), "unit_size": _unit_size(actor), "identity": identity}
        return dataclasses.replace(self, **more)

    def opened(self) -> Opened:
        """Its environments and its policy, made on first use in each thread and kept.

        Raises:
          Refused: this process does not reproduce the identity or the canary.
          PolicyError: the policy cannot be used here.
        """
        known = _local.opened
        if self.key not in known:
            known[self.key] = self._open()
            while len(known) > _KEPT_OPEN:
                _, oldest = known.popitem(last=False)
                oldest.environment.close()
        known.move_to_end(self.key)
        return known[self.key]

    def _open(self) -> Opened:
        factory = self.made.factory()
        environment = factory.make(0)
        actor = unpack(self.policy, environment, self.num_threads)
        identity = identity_of(factory, actor, environment, self.action_repeat)
        here = {**identity, "canary": canary_of(factory)}
        expected = {**self.identity, "canary": self.canary}
        difference = first_difference(expected, here, self.any_processor)
        if difference is not None:
            name, there, value = difference
            raise Refused(
                f"node {socket.gethostname()} is refused: its {name} is {value!r}, and the "
                f"driver's is {there!r}: use equal versions, files and processors{advice_on(name)}"
            )
        return Opened(environment, factory.build(environment), factory, actor)


def prepare(
    domain: str | Make | dm_env.Environment,
    task: str | None = None,
    policy: object = "zero",
    *,
    time_limit: float | None = None,
    action_repeat: int | None = None,
    num_threads: int | None = None,
    any_processor: bool = False,
    vectorised: bool | None = None,
    world: World | None = None,
) -> Setup:
    """The setup of a task and a policy, for workers.

    Args:
      domain: such as 'humanoid', or a function `make(seed) -> dm_env.Environment`.
      task: such as 'walk'; None with a function.
      policy: its name, or a function or class; see `limberjack.policies`.
      time_limit: seconds per episode; the task's own by default.
      action_repeat: control steps per action; None for those that the policy demands, or else the
        environment's own.
      num_threads, any_processor, vectorised: see `Setup`.
      world: options by which the world differs from the suite's, see `limberjack.worlds`; None with
        a function.

    Raises:
      ValueError, TypeError: there is no such task or policy, other processes cannot import the
        policy, the domain or the function, or the policy demands another action repeat.
    """
    factory = factory_of(domain, task, time_limit, world)
    with contextlib.closing(factory.make(0)) as environment:
        actor = policies.find(policy, environment)
        return setup_of(
            factory,
            environment,
            actor,
            policy,
            action_repeat=repeat_for(actor, action_repeat, own_repeat(environment)),
            num_threads=num_threads,
            any_processor=any_processor,
            vectorised=vectorised,
        )


def setup_of(
    factory: Factory,
    environment: dm_env.Environment,
    actor: Actor,
    policy: object,
    *,
    action_repeat: int = 1,
    num_threads: int | None = None,
    any_processor: bool = False,
    vectorised: bool | None = None,
) -> Setup:
    """The setup of a policy that has been found.

    Args:
      factory: makes the environments.
      environment: one of them.
      actor: the policy.
      policy: its name, function or class.
      action_repeat, num_threads, any_processor, vectorised: see `Setup`.

    Raises:
      ValueError: other processes cannot import the policy, the domain or the function.
    """
    made = _made(factory, environment)
    if actor.sha256 is None:
        raise PolicyError(
            f"policy {actor.name!r} has no source file, so other processes cannot prove that "
            "theirs is the same: define it in a file"
        )
    setup = Setup(
        made,
        ship(policy),
        identity_of(factory, actor, environment, action_repeat),
        canary_of(factory),
        _unit_size(actor),
        num_threads,
        any_processor,
        action_repeat,
        vectorised,
    )
    try:
        pickle.dumps(setup)
    except pickle.PicklingError as error:  # a domain that only this process has
        raise ValueError(str(error)) from error
    return setup


def _unit_size(actor: Actor) -> int:
    return 1 if actor.plays_alone else ROWS


def _made(factory: Factory, environment: dm_env.Environment) -> _Made:
    """Raises ValueError if other processes cannot make the environment."""
    domain, task = factory.facts.get("domain"), factory.facts.get("task")
    if domain is not None:
        registration = getattr(environment, "registration", None)
        return _Made(domain, task, factory.time_limit, factory.world, registration)
    if not factory.is_known or factory.title.startswith("__main__:"):
        raise ValueError(
            f"{factory.title} cannot be imported by other processes: define make(seed) at the top "
            "level of a module other than the main program"
        )
    return _Made(factory.title, None, None, None, None)


class _Local(threading.local):
    """Setups that a thread has opened, the latest last."""

    def __init__(self) -> None:
        self.opened: collections.OrderedDict[str, Opened] = collections.OrderedDict()


_local = _Local()
