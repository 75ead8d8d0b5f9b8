"""The types of policies, and the error that they raise.

    actor: Actor = policies.find("random")
    actor.begin(batch, rows, seeds)                     # episodes begin in these rows
    actions = actor.act(observation, rows)              # (num_envs, ...); zeros in other rows

    act: Act = actor.begin_alone(environment, seed)     # the same episode in one environment
    action = act(time_step.observation)

`policies.find` returns an `Actor`, which every command and function plays.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

import dm_env
import numpy as np
from dm_env import specs

from limberjack.rl.batch_contract import Batch
from limberjack.rl.guards import at_least_one
from limberjack.utils.described import place_of

__all__ = ["ROWS", "Act", "Actor", "BeginAlone", "Locating", "Policy", "PolicyError", "repeat_for"]

ROWS = 64  # rows of a batch: enough for all cores, and few enough that a kill loses little

Act = Callable[[Mapping[str, np.ndarray]], np.ndarray]
# Begins an episode: takes the spec of actions and the episode's seed.
Policy = Callable[[specs.BoundedArray, int], Act]
# The same with the environment, which has been reset and must only be read.
BeginAlone = Callable[[dm_env.Environment, int], Act]


class Actor(Protocol):
    """A policy, as batches and single environments play it.

    Attributes:
      name: as results call it.
      sha256: of its source or its file; None if that is not known.
    """

    name: str
    sha256: str | None

    @property
    def plays_alone(self) -> bool:
        """Whether it plays one episode at a time, in a batch of one complete environment."""
        ...

    @property
    def action_repeat(self) -> int | None:
        """Control steps per action that it must be played with; None for any number.

        A batch asks it for an action once in that many steps; what `begin_alone` returns repeats
        actions itself, unless the environment does.
        """
        ...

    def begin(self, batch: Batch, rows: np.ndarray, seeds: Sequence[int]) -> None:
        """Begins the first episodes of these seeds in these rows, which have been reset."""

    def act(self, observation: Mapping[str, np.ndarray], rows: np.ndarray) -> np.ndarray:
        """Actions, (num_envs, ...), of which only those of `rows` are used.

        Raises:
          PolicyError: one of them is not an action; the message has its seed and step.
        """
        ...

    def begin_alone(self, environment: dm_env.Environment, seed: int) -> Act:
        """Begins the episode of an environment that has been reset; equal to that in a batch.

        Raises:
          PolicyError: it cannot act in this environment.
        """
        ...


def repeat_for(actor: Actor, action_repeat: int | None, own: int) -> int:
    """Control steps per action: those that are asked for, the policy's, or the environment's own.

    Args:
      actor: the policy.
      action_repeat: asked for; None to leave it to the policy and the environment.
      own: of the environment.

    Raises:
      ValueError, TypeError: it is not a whole number of at least 1, or not that of a policy which
        demands one, such as the planner, which acts at every control step.
    """
    repeat = own if action_repeat is None else at_least_one("action_repeat", action_repeat)
    demanded = actor.action_repeat
    if demanded is None or repeat == demanded:
        return repeat
    if action_repeat is None and own == 1:
        return demanded
    often = "at every control step" if demanded == 1 else f"every {demanded} control steps"
    advice = "leave it at 1" if demanded == 1 else f"leave it out, or set it to {demanded}"
    raise ValueError(f"action_repeat is {repeat}, but policy {actor.name!r} acts {often}: {advice}")


# Errors that programs and loops take for an end.
_SILENT = (EOFError, StopAsyncIteration, StopIteration)


class PolicyError(ValueError):
    """A policy cannot be found or used, or returned something that is not an action."""


class Locating:
    """A context in which a user's code runs; its errors get a note that says where it was called.

    SystemExit, StopIteration, EOFError and others that would end a program or a loop without a
    message become a `PolicyError`. Ctrl-C passes.
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
