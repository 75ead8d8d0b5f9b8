"""Builds: environments for any seed, from functions and from copies of an instance."""

import functools
import threading
from typing import Any

import numpy as np
import pytest

from limberjack.rl import builds
from limberjack.rl.builds import Build

from . import odd_environments as odd


class _Locked(odd.LastAction):
    """Keeps a lock and a generator, and remembers."""

    def __init__(self, random: Any = None) -> None:
        super().__init__(random=random)
        self.lock = threading.Lock()
        self.numbers = iter(range(100))
        self.count = (number for number in range(1000))

    def get_reward(self, physics: Any) -> Any:
        return super().get_reward(physics) + next(self.count)


def test_a_task_that_cannot_be_copied_is_made_again_for_each_seed() -> None:
    make = functools.partial(odd.of_task, _Locked)
    actions = odd.actions_of(5, 1)[:, 0]
    seeded = Build.of(make).seeded(4)
    assert list(odd.steps_of(seeded.environment, actions)) == list(odd.steps_of(make(4), actions))
    for seed in (9, 4):
        seeded.begin(seed)
        expected = list(odd.steps_of(make(seed), actions))
        assert list(odd.steps_of(seeded.environment, actions)) == expected
