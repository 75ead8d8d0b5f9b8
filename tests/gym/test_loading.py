"""`load_vector` of one task and of several."""

from typing import Any

import pytest

from limberjack import gym
from limberjack.gym import ManyVectorEnv, VectorEnv


def test_a_task_and_a_list_give_their_kind() -> None:
    assert type(gym.load_vector("pendulum", "swingup", 2)) is VectorEnv
    assert type(gym.load_vector(["pendulum:swingup"], rows=2)) is ManyVectorEnv
    assert type(gym.load_vector(["pendulum:swingup"], num_envs=2, pipelined=True)) is ManyVectorEnv


_ONE = {"domain": "pendulum", "task": "swingup"}
_LIST = {"domain": ["pendulum:swingup"]}


@pytest.mark.parametrize(
    ("given", "error", "message"),
    [
        (_ONE, TypeError, "num_envs is None"),
        ({**_ONE, "num_envs": 2, "rows": 2}, TypeError, "rows is 2; expected a domain, a task"),
        ({**_ONE, "num_envs": 1, "pipelined": True}, ValueError, "num_envs is 1"),
        ({**_LIST, "task": "swingup", "num_envs": 1}, TypeError, "or a list of tasks and rows"),
        ({"domain": "pendulum", "rows": 2}, ValueError, "no set of tasks 'pendulum'"),
        ({**_LIST, "rows": 2, "row": 3}, TypeError, "Did you mean 'rows'"),
        ({**_LIST, "rows": 2, "pixels": {}}, ValueError, "observes pictures"),
        ({**_LIST, "rows": 1, "pipelined": True}, ValueError, "there is 1 row"),
    ],
)
def test_arguments_that_do_not_fit_are_refused(
    given: dict[str, Any], error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        gym.load_vector(**given)
