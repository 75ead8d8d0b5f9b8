"""Plays a unit of work in its worker; errors are returned as values, which no pool retries.

answer = attempt(function, setup, seeds)     # a module-level function: pools and Ray pickle it
"""

import dataclasses
import socket
from collections.abc import Callable, Sequence
from typing import Generic, TypeVar

from limberjack.policies import PolicyError
from limberjack.utils import described as errors
from limberjack.workers.setup import Refused, Setup

__all__ = ["Answer", "Failed", "Function", "WorkError", "attempt", "described", "value_of"]

_Result = TypeVar("_Result")
_Other = TypeVar("_Other")

# Takes a setup, seeds and what else a unit has. Its result depends on these alone, and so does what
# it writes to files: a unit may be played twice.
Function = Callable[..., _Result]


class WorkError(RuntimeError):
    """Units could not be played: a policy failed, or workers were lost or refused.

    The message is one line that names the cause, and the node where there is one. Results that
    arrived before it are complete, and the other units can be played later.

    Attributes:
      would_recur: whether the same call fails again, so that the message has other advice.
    """

    would_recur = False


@dataclasses.dataclass(frozen=True)
class Answer(Generic[_Result]):
    """The result of a unit."""

    value: _Result


@dataclasses.dataclass(frozen=True)
class Failed:
    """The reason why a unit cannot be played here, on one line."""

    message: str


def attempt(
    function: Function[_Other], setup: Setup, seeds: Sequence[int], *more: object
) -> "Answer[_Other] | Failed":
    """The function's result, or the reason why there is none.

    Raises:
      MemoryError: another attempt, with fewer units on the machine, may succeed.
    """
    try:
        setup.opened()
        return Answer(function(setup, seeds, *more))
    except MemoryError:
        raise
    except Refused as refusal:
        return Failed(str(refusal))
    except (Exception, SystemExit) as error:  # the latter would end the driver
        return Failed(described(error))


def value_of(answer: "Answer[_Other] | Failed") -> _Other:
    """The result of a unit.

    Raises:
      WorkError: the unit could not be played.
    """
    if isinstance(answer, Failed):
        raise WorkError(answer.message)
    return answer.value


def described(error: BaseException) -> str:
    """An error on one line, with the policy, step and seed of its notes, its place and the node.

    The message of a PolicyError has all of these but the node.
    """
    is_complete = isinstance(error, PolicyError)
    text = " ".join(str(error).split()) if is_complete else errors.described(error)
    return f"{text}; on node {socket.gethostname()}"
