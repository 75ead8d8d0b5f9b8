"""The types of policies, and the error that they raise.

    policy: Policy = policies.random
    act: Act = policy(environment.action_spec(), seed)  # begins an episode
    action = act(time_step.observation)

An `EnvironmentPolicy` is a policy too, but begins with the environment; `policies.begin` begins
either kind.
"""

import dataclasses
from collections.abc import Callable, Mapping

import numpy as np
from dm_env import specs

from limberjack.rl.control import Environment
from limberjack.utils.described import place_of

__all__ = ["Act", "EnvironmentPolicy", "Locating", "Policy", "PolicyError"]

Act = Callable[[Mapping[str, np.ndarray]], np.ndarray]
# Begins an episode: takes the spec of actions and the episode's seed.
Policy = Callable[[specs.BoundedArray, int], Act]


# Errors that programs and loops take for an end.
_SILENT = (EOFError, StopAsyncIteration, StopIteration)


class PolicyError(ValueError):
    """A policy cannot be found or used, or returned something that is not an action."""


class Locating:
    """A context in which a user's code runs; its errors get a note that says where it was called.

    Those that would end a program or a loop without a message, such as that of `sys.exit()` or
    `next()`, become a `PolicyError` instead. Ctrl-C passes.
    """

    __slots__ = ("_where",)

    def __init__(self, where: str) -> None:
        """Takes the note: the policy, and the step and the seed."""
        self._where = where

    def __enter__(self) -> None:
        pass

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        if error is None or isinstance(error, KeyboardInterrupt):
            return
        if not isinstance(error, Exception) or isinstance(error, _SILENT):
            place = place_of(error)
            line = f"{self._where}: raised {error!r}"
            raise PolicyError(line if place is None else f"{line} ({place})") from error
        error.add_note(self._where)


@dataclasses.dataclass(frozen=True)
class EnvironmentPolicy:
    """A policy that needs the environment it acts in, not only its observations.

    Attributes:
      begin_in: begins an episode: takes the environment, which has been reset and must only be
        read, and the episode's seed.
    """

    begin_in: Callable[[Environment, int], Act]

    def __call__(self, spec: specs.BoundedArray, seed: int) -> Act:
        """Refuses, because a spec of actions is not enough.

        Raises:
          PolicyError: always.
        """
        raise PolicyError(
            "this policy needs the environment, not only the spec of its actions: begin it with "
            "policies.begin(policy, environment, seed)"
        )
