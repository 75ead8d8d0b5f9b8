"""Entry points of Gymnasium's ids: `gym.load` and `load_vector` with Gymnasium's lengths."""

import itertools
import math
from collections.abc import Iterator
from typing import Any

import gymnasium
import numpy as np
import pytest

from limberjack import gym, registry, suite
from limberjack.gym import made
from tests import plain_domain

_TASK = ("manipulator", "bring_ball")
_NAME = plain_domain.__name__


@pytest.fixture
def push() -> Iterator[str]:
    """The name that a domain outside of the suite has here until the test ends."""
    yield "push_of_these_tests"
    registry.remove("push_of_these_tests")


def test_a_single_environment_is_that_of_load_without_a_length_of_its_own() -> None:
    env, own = made.make(*_TASK, flat=True), gym.load(*_TASK, flat=True)
    assert isinstance(env, gym.Env)
    assert env.environment._step_limit == math.inf
    assert own.environment._step_limit == 1000
    np.testing.assert_array_equal(env.reset(seed=3)[0], own.reset(seed=3)[0])


def test_steps_that_gymnasium_has_not_counted_are_refused() -> None:
    env = made.make(*_TASK)
    env.reset(seed=0)
    action = np.zeros(env.action_space.shape or ())
    env.step(action)
    env.environment.step(action)
    with pytest.raises(
        RuntimeError, match="inner environment is at step 2, and Gymnasium's TimeLimit at s"
    ):
        env.step(action)


@pytest.mark.parametrize("how", [{"time_limit": 0.05}, {"task_kwargs": {"time_limit": 0.05}}])
def test_a_time_limit_that_is_asked_for_is_kept(how: dict[str, Any]) -> None:
    assert made.make(*_TASK, **how).environment._step_limit == 5
    envs = made.make_vector(*_TASK, 2, max_episode_steps=1000, **how)
    assert [batch.step_limit for batch in envs.batches] == [5]
    envs.close()


def test_a_longer_time_limit_is_refused_with_the_argument_to_give_instead() -> None:
    with pytest.raises(ValueError, match=r"=1500 to gymnasium\.make instead"):
        made.make(*_TASK, time_limit=15.0)
    with pytest.raises(ValueError, match=r"=1500 to gymnasium\.make_vec instead"):
        made.make_vector(*_TASK, 2, max_episode_steps=1000, time_limit=15.0)


@pytest.mark.parametrize(
    ("most", "expected"), [(None, 1000), (1000, 1000), (7, 7), (2000, 2000), (-1, math.inf)]
)
def test_each_batch_counts_to_the_steps_that_gymnasium_gives(
    most: int | None, expected: float
) -> None:
    envs = made.make_vector(*_TASK, 2, max_episode_steps=most)
    assert [batch.step_limit for batch in envs.batches] == [expected]
    envs.close()


def test_halves_of_a_batch_have_the_same_length() -> None:
    envs = made.make_vector(*_TASK, 4, max_episode_steps=7, pipelined=True)
    assert [batch.step_limit for batch in envs.batches] == [7, 7]
    envs.close()


def test_misspelt_arguments_are_refused_with_a_suggestion() -> None:
    with pytest.raises(TypeError, match=r"no argument 'flatt'.*'flat'"):
        made.make(*_TASK, flatt=True)
    with pytest.raises(TypeError, match=r"'flatt'"):
        made.make_vector(*_TASK, 2, flatt=True)


@pytest.mark.parametrize("is_vector", [False, True])
def test_the_module_of_another_domain_is_imported_and_registered(
    push: str, is_vector: bool
) -> None:
    assert push not in registry.domains()
    if is_vector:
        made.make_vector(push, "push", 2, module=_NAME, steps=None).close()
    else:
        made.make(push, "push", module=_NAME, steps=None).close()
    assert registry.domains()[push].load() is plain_domain


def test_the_length_of_another_domain_is_that_of_the_id(push: str) -> None:
    length = plain_domain.SUITE["push"]().step_limit
    assert length is not None
    assert made.make(push, "push", module=_NAME, steps=length).environment._step_limit == math.inf
    with pytest.raises(ValueError, match=f"{push}:push have {length} steps, and Gymnasium ends"):
        made.make(push, "push", module=_NAME, steps=length + 1)


def test_an_environment_whose_id_has_no_length_counts_by_itself(push: str) -> None:
    length = plain_domain.SUITE["push"]().step_limit
    env = made.make(push, "push", module=_NAME, steps=None)
    assert env.environment._step_limit == length
    env.reset(seed=0)
    env.environment.step(np.zeros(1))
    assert env.step(np.zeros(1))[0]


def test_another_module_under_the_domains_name_is_refused() -> None:
    refusal = r"'manipulator' belongs to the suite.*give my_package\.manipulator another name"
    with pytest.raises(ValueError, match=refusal):
        made.make(*_TASK, module="my_package.manipulator")
    with pytest.raises(ValueError, match=refusal):
        made.make_vector(*_TASK, 2, module="my_package.manipulator")


def test_a_domain_without_a_module_is_made_in_its_own_process() -> None:
    suite._DOMAINS["pushing"] = plain_domain
    try:
        here = registry.NotImportable("pushing")
        env = made.make("pushing", "push", module=here, steps=None)
        assert env.reset(seed=0)[0]
    finally:
        del suite._DOMAINS["pushing"]


def test_gymnasium_knows_the_render_modes_of_single_environments() -> None:
    metadata = getattr(made.make, "metadata", None)
    assert metadata is gym.Env.metadata
    env = gymnasium.make("limberjack/manipulator-bring_ball-v0", render_mode="rgb_array_list")
    assert env.render_mode == "rgb_array_list"
    env.close()


@pytest.mark.parametrize("repeat", [2, 3])
def test_repeated_actions_leave_fewer_steps_in_an_episode(repeat: int) -> None:
    name = "limberjack/humanoid-walk-v0"
    env: Any = gymnasium.make(name, action_repeat=repeat, time_limit=0.3)  # 12 control steps
    envs: Any = gymnasium.make_vec(name, 2, action_repeat=repeat, time_limit=0.3)
    plain = gym.load("humanoid", "walk", time_limit=0.3)
    assert env.unwrapped.dt == envs.dt == repeat * plain.dt
    assert env.unwrapped.metadata["render_fps"] == round(40 / repeat)
    assert envs.spec.max_episode_steps == 12 // repeat
    for each in (env, envs, plain):
        each.reset(seed=0)
    snapshot: Any = None
    for step in range(12 // repeat):
        one, rows = env.step(np.zeros(21)), envs.step(np.zeros((2, 21)))
        rewards = [plain.step(np.zeros(21))[1] for _ in range(repeat)]
        assert one[1] == rows[1][0] == pytest.approx(sum(rewards))
        assert one[3] == rows[3][0] == (step == 12 // repeat - 1)
        if step == 1:
            snapshot = env.unwrapped.environment.snapshot()
    for start in (
        lambda: gym.restore(env, snapshot),
        lambda: env.reset(options={"state": snapshot}),
    ):
        start()
        rest = [env.step(np.zeros(21))[3] for _ in range(12 // repeat - 2)]
        assert rest == [False] * (len(rest) - 1) + [True]


def test_repeated_actions_keep_the_length_of_the_task_unless_another_is_given() -> None:
    name = "limberjack/humanoid-walk-v0"
    found = []
    given: list[dict[str, Any]] = [{}, {"max_episode_steps": 4}]
    for kwargs in given:
        env: Any = gymnasium.make(name, action_repeat=100, **kwargs)
        envs: Any = gymnasium.make_vec(name, 2, action_repeat=100, **kwargs)
        again: Any = gymnasium.make_vec(envs.spec)
        for each in (env, envs, again):
            each.reset(seed=0)
            zeros = np.zeros(each.action_space.shape)
            found.append(next(n for n in itertools.count(1) if np.any(each.step(zeros)[3])))
            each.close()
    assert found == [10, 10, 10, 4, 4, 4]


@pytest.mark.parametrize(
    ("given", "actions"),
    [({}, 334), ({"max_episode_steps": 400}, 400), ({"max_episode_steps": 7}, 7)],
)
def test_the_spec_and_the_episodes_have_the_same_number_of_repeated_actions(
    given: dict[str, Any], actions: int
) -> None:
    name = "limberjack/cartpole-swingup-v0"
    env: Any = gymnasium.make(name, action_repeat=3, **given)
    envs: Any = gymnasium.make_vec(name, 2, action_repeat=3, **given)
    assert env.spec.max_episode_steps == envs.spec.max_episode_steps == actions
    assert gymnasium.spec(name).max_episode_steps == 1000
    envs.reset(seed=0)
    for _ in range(2):  # episodes
        env.reset(seed=0)
        ended = [env.step([0.0])[2:4] for _ in range(actions)]
        assert ended == [(False, False)] * (actions - 1) + [(False, True)]
        rows = [envs.step(np.zeros((2, 1)))[3].tolist() for _ in range(actions)]
        assert rows == [[False] * 2] * (actions - 1) + [[True] * 2]
        envs.step(np.zeros((2, 1)))  # which begins the next episode
    last = 1000 if not given else 3 * actions
    assert env.unwrapped.environment._step_count == last
    again: Any = gymnasium.make(env.spec)
    assert again.spec.max_episode_steps == actions
    again.reset(seed=0)
    assert again.unwrapped.environment.step_limit == env.unwrapped.environment.step_limit
    env.close()
    envs.close()
    again.close()


def test_no_limit_of_gymnasium_leaves_no_limit_to_repeated_actions() -> None:
    name = "limberjack/cartpole-swingup-v0"
    env: Any = gymnasium.make(name, action_repeat=500, max_episode_steps=-1)
    env.reset(seed=0)
    assert not any(env.step([0.0])[3] for _ in range(3))
    env.close()
