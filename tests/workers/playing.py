"""Policies of the pendulum and functions of units, which worker processes import by name."""

import os
import signal
import threading
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from limberjack.evaluation.experiment import play_unit
from limberjack.rl.control import Environment
from limberjack.workers import Setup
from tests import plain_domain

__all__ = [
    "TASK",
    "BatchedMemory",
    "Deadly",
    "Hungry",
    "Locked",
    "Memory",
    "Unlucky",
    "damped",
    "exit_status",
    "fork_and_end",
    "heavy_plain",
    "interrupted",
    "locked",
    "memory",
    "more_of",
    "pid",
    "plain",
    "print_and_seeds",
    "real_time_signal",
    "scores_slowly",
    "seeds_of",
    "unpicklable",
]

TASK = ("pendulum", "swingup")


def damped(observation: Mapping[str, Any]) -> np.ndarray:
    """Slows the pendulum down."""
    return -np.clip(observation["velocity"], -1, 1)


def interrupted(observation: Mapping[str, Any]) -> np.ndarray:
    """Raises what Ctrl-C does."""
    raise KeyboardInterrupt


class Memory:
    """Acts by the number of the step, so that it must be reset."""

    def reset(self) -> None:
        self.steps = 0

    def act(self, observation: Mapping[str, Any]) -> np.ndarray:
        self.steps += 1
        return np.sin(self.steps) * np.cos(observation["velocity"])


class Locked(Memory):
    """The same with a part that cannot be copied."""

    def __init__(self) -> None:
        self.lock = threading.Lock()


memory, locked = Memory(), Locked()


class BatchedMemory:
    """The same kind of policy on batches, in float32."""

    def __init__(self) -> None:
        self.steps = np.zeros(64, int)

    def reset_batch(self, rows: np.ndarray, seeds: np.ndarray) -> None:
        self.steps[rows] = 0

    def act_batch(self, observations: Mapping[str, np.ndarray]) -> np.ndarray:
        self.steps += 1
        seen = np.concatenate([observations["orientation"], observations["velocity"]], axis=-1)
        weights = np.linspace(-1, 1, 3, dtype=np.float32)[:, None]
        return np.tanh(seen.astype(np.float32) @ weights * self.steps[:, None])


class Deadly(BatchedMemory):
    """Kills its process at seed 70, as many times as the file `DEADLY` has letters.

    Slow enough for tests to interrupt it where `SLOW` says how many seconds a step takes.
    """

    def reset_batch(self, rows: np.ndarray, seeds: np.ndarray) -> None:
        super().reset_batch(rows, seeds)
        deaths = os.environ.get("DEADLY")
        if deaths and 70 in seeds:
            left = Path(deaths).read_text()
            if left:
                Path(deaths).write_text(left[1:])
                self._die()

    def _die(self) -> None:
        os.kill(os.getpid(), signal.SIGKILL)

    def act_batch(self, observations: Mapping[str, np.ndarray]) -> np.ndarray:
        time.sleep(float(os.environ.get("SLOW", "0")))
        return super().act_batch(observations)


class Hungry(Deadly):
    """Asks for more memory than there is, in place of killing its process."""

    def _die(self) -> None:
        np.empty(2**57)  # 2**60 bytes: an error of memory, not of the shape


class Unlucky:
    """Raises an error in the third step of seed 70."""

    def reset_batch(self, rows: np.ndarray, seeds: np.ndarray) -> None:
        self.steps = 0 if 70 in seeds else -(10**6)

    def act_batch(self, observations: Mapping[str, np.ndarray]) -> np.ndarray:
        self.steps += 1
        if self.steps == 3:
            raise KeyError("no such\nthing")
        return np.zeros((64, 1))


def more_of(setup: Setup, seeds: Sequence[int], *more: object) -> tuple[object, ...]:
    """The arguments besides the seeds."""
    return more


def seeds_of(setup: Setup, seeds: tuple[int, ...]) -> tuple[int, ...]:
    """The seeds, without playing them."""
    return seeds


def print_and_seeds(setup: Setup, seeds: tuple[int, ...]) -> tuple[int, ...]:
    """The same after printing, which must not disturb the answer."""
    print("printed by a policy")
    os.write(1, b"written by a library\n")
    # Nor may reading: the messages are not on the standard input of policies.
    assert os.path.samestat(os.fstat(0), os.stat(os.devnull))
    return seeds


def pid(setup: Setup, seeds: tuple[int, ...]) -> int:
    """The number of the process."""
    return os.getpid()


def exit_status(setup: Setup, seeds: tuple[int, ...]) -> None:
    """Ends the process."""
    if seeds[0] == 64:
        os._exit(7)


def fork_and_end(setup: Setup, seeds: tuple[int, ...]) -> None:
    """Ends the process, but not one that it has forked, whose number it prints."""
    child = os.fork()
    if not child:
        time.sleep(600)  # unless the test ends it
        os._exit(0)
    print(child, flush=True)
    os._exit(7)


def real_time_signal(setup: Setup, seeds: tuple[int, ...]) -> None:
    """Ends the process by a signal that has no name in Python."""
    os.kill(os.getpid(), 40)


def unpicklable(setup: Setup, seeds: tuple[int, ...]) -> object:
    """A result that cannot be sent."""
    return lambda: None


def scores_slowly(setup: Setup, seeds: tuple[int, ...]) -> object:
    """Plays, and takes a tenth of a second longer."""
    time.sleep(0.1)
    return play_unit(setup, seeds)


def plain(seed: int) -> Environment:
    """An environment that a function of a module makes."""
    return plain_domain.make(seed)


def heavy_plain(seed: int) -> Environment:
    """Another one."""
    return plain_domain.heavier(seed)


class Unreadable:
    """A function that only its own process can read."""

    def __init__(self) -> None:
        self.pid = os.getpid()

    def __call__(self, setup: Setup, seeds: tuple[int, ...]) -> object:
        return seeds

    def __setstate__(self, state: dict[str, int]) -> None:
        raise ValueError("this is of another process")
