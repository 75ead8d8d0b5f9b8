"""Environments that Gymnasium makes: entry points, lengths of episodes and specifications."""

import itertools
import math
from collections.abc import Iterator
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec

from limberjack import gym, registry, suite
from limberjack.gym import made
from limberjack.gym.made import spec_of
from tests import plain_domain
from tests.programs import run

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
    with pytest.raises(
        ValueError, match=r"give gymnasium\.make max_episode_steps=1500 in its place"
    ):
        made.make(*_TASK, time_limit=15.0)
    with pytest.raises(ValueError, match=r"make_vec max_episode_steps=1500 in its place"):
        made.make_vector(*_TASK, 2, max_episode_steps=1000, time_limit=15.0)


@pytest.mark.parametrize(
    ("most", "expected"), [(None, math.inf), (1000, 1000), (7, 7), (2000, 2000), (-1, math.inf)]
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
    with pytest.raises(TypeError, match=r"keyword argument 'flatt'.*'flat'"):
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
    name = "limberjack/cartpole-balance-v0"
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


_ID = "limberjack/manipulator-bring_ball-v0"
_STEP = 0.01  # seconds of its control step
_MODES = ["sync", "vector_entry_point"]


def _length(env: Any, most: int) -> int | None:
    """Steps until the environment truncates, or its first row; None if it has not after `most`."""
    env.reset(seed=0)
    action = np.zeros(env.action_space.shape)
    for number in range(1, most + 1):
        _, _, terminated, truncated, _ = env.step(action)
        assert not np.any(terminated)
        if np.any(truncated):
            return number
    return None


def _make(mode: str, **kwargs: Any) -> Any:
    if mode == "single":
        return gymnasium.make(_ID, disable_env_checker=True, **kwargs)
    return gymnasium.make_vec(_ID, num_envs=2, vectorization_mode=mode, **kwargs)


def test_specs_report_the_lengths_of_episodes() -> None:
    for domain, task in suite.ALL_TASKS:
        environment = suite.load(domain, task)
        spec = gymnasium.spec(f"limberjack/{domain}-{task}-v0")
        assert spec.max_episode_steps == environment.step_limit
        env: Any = gymnasium.make(spec)
        assert env.spec.max_episode_steps == environment.step_limit


@pytest.mark.parametrize("mode", ["single", *_MODES])
def test_the_episode_has_its_own_length_by_default(mode: str) -> None:
    env = _make(mode)
    assert _length(env, 1001) == 1000
    env.close()


@pytest.mark.parametrize("mode", ["single", *_MODES])
@pytest.mark.parametrize("most", [3, 1100])
def test_max_episode_steps_shortens_and_lengthens(mode: str, most: int) -> None:
    env = _make(mode, max_episode_steps=most)
    assert _length(env, most + 1) == most
    env.close()


@pytest.mark.parametrize("mode", ["single", *_MODES])
def test_minus_one_removes_the_limit(mode: str) -> None:
    env = _make(mode, max_episode_steps=-1)
    assert _length(env, 1100) is None
    if mode != "sync":  # SyncVectorEnv knows nothing of the environments inside
        assert env.spec.max_episode_steps is None
    env.close()


@pytest.mark.parametrize("mode", ["single", *_MODES])
@pytest.mark.parametrize(
    "kwargs", [{"time_limit": 3 * _STEP}, {"task_kwargs": {"time_limit": 3 * _STEP}}], ids=str
)
def test_a_shorter_time_limit_is_kept(mode: str, kwargs: dict[str, Any]) -> None:
    env = _make(mode, **kwargs)
    assert _length(env, 5) == 3
    env.close()


@pytest.mark.parametrize("mode", ["single", *_MODES])
@pytest.mark.parametrize(
    ("time_limit", "instead"), [(20.0, 2000), (float("inf"), -1)], ids=["longer", "none"]
)
def test_a_longer_time_limit_is_refused_by_gymnasium_with_the_argument_to_give_instead(
    mode: str, time_limit: float, instead: int
) -> None:
    with pytest.raises(ValueError, match=f"max_episode_steps={instead} in its place"):
        _make(mode, time_limit=time_limit)


def test_the_spec_has_the_length_of_the_time_limit_or_none_as_the_episodes_do() -> None:
    cases: list[tuple[dict[str, Any], int | None]] = [
        ({"time_limit": 0.05}, 5),
        ({"time_limit": 0.05, "action_repeat": 2}, 3),
        ({"time_limit": 0.05, "max_episode_steps": 3}, 3),
        ({"max_episode_steps": -1}, None),
    ]
    for kwargs, expected in cases:
        env = gymnasium.make(_ID, **kwargs)
        envs = gymnasium.make_vec(_ID, num_envs=1, **kwargs)
        assert env.spec is not None
        again = gymnasium.make_vec(env.spec, num_envs=1)
        for spec in (env.spec, envs.spec, again.spec):
            assert spec is not None
            assert spec.max_episode_steps == expected
        if expected is not None:
            env.reset(seed=0)
            ends = [env.step(env.action_space.sample())[3] for _ in range(expected)]
            assert ends == [False] * (expected - 1) + [True]


def test_a_batch_takes_both_and_the_shorter_one_holds() -> None:
    both = {"max_episode_steps": 2000, "time_limit": 12.0}
    envs = _make("vector_entry_point", **both)
    assert _length(envs, 1300) == 1200
    assert envs.spec.max_episode_steps == 1200


@pytest.mark.parametrize(
    ("most", "error"), [(0, ValueError), (-2, ValueError), (2.5, TypeError), (True, TypeError)]
)
def test_a_batch_refuses_an_invalid_number_of_steps(most: Any, error: type[Exception]) -> None:
    with pytest.raises(error, match=f"max_episode_steps is {most}"):
        _make("vector_entry_point", max_episode_steps=most)


def test_outside_gymnasium_the_environment_counts_by_itself() -> None:
    assert _length(gym.load("manipulator", "bring_ball"), 1001) == 1000
    assert _length(gym.load("manipulator", "bring_ball", time_limit=12.0), 1300) == 1200
    envs = gym.load_vector("manipulator", "bring_ball", 2, time_limit=12.0)
    assert _length(envs, 1300) == 1200


def test_arguments_that_change_the_number_of_steps_are_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    load = suite.load

    def load_finer(*args: Any, **kwargs: Any) -> Any:
        environment = load(*args, **kwargs)
        environment._step_limit *= 2  # as a domain whose factory takes another control step
        return environment

    monkeypatch.setattr("limberjack.suite.load", load_finer)
    for mode in ("single", "vector_entry_point"):
        with pytest.raises(ValueError, match="have 2000 steps, and Gymnasium ends them after 1000"):
            _make(mode)


def test_a_spec_rebuilds_the_environment_in_a_fresh_process() -> None:
    env: Any = gymnasium.make(_ID, max_episode_steps=7, flat=True)
    envs: Any = gymnasium.make_vec(_ID, num_envs=3, max_episode_steps=8, flat=True)
    spec = EnvSpec.from_json(env.spec.to_json())
    assert spec.max_episode_steps == 7
    printed = run(
        """
        import sys
        import gymnasium
        from gymnasium.envs.registration import EnvSpec
        env = gymnasium.make(EnvSpec.from_json(sys.argv[1]))
        envs = gymnasium.make_vec(EnvSpec.from_json(sys.argv[2]))
        print(env.spec.max_episode_steps, env.observation_space.shape)
        print(envs.spec.max_episode_steps, envs.num_envs, envs.single_observation_space.shape)
        """,
        env.spec.to_json(),
        envs.spec.to_json(),
    )
    assert printed == "7 (44,)\n8 3 (44,)\n"


# Snapshots.


def _steps(env: Any, count: int) -> list[tuple[float, bool]]:
    action = np.full(env.action_space.shape, 0.2)
    return [(env.step(action)[1], env.step(action)[3]) for _ in range(count)]


def test_a_restored_environment_counts_from_the_step_of_the_snapshot() -> None:
    env: Any = gymnasium.make(_ID, max_episode_steps=20)
    env.reset(seed=1)
    _steps(env, 6)
    snapshot = env.unwrapped.environment.snapshot()
    future = _steps(env, 4)
    assert [truncated for _, truncated in future] == [False] * 3 + [True]
    for twin in (env, gymnasium.make(_ID, max_episode_steps=20)):
        twin.reset(seed=5)
        gym.restore(twin, snapshot)
        assert _steps(twin, 4) == future


def test_restoring_often_does_not_shorten_the_episode() -> None:
    env: Any = gymnasium.make(_ID, max_episode_steps=10)
    env.reset(seed=1)
    snapshot = env.unwrapped.environment.snapshot()
    for _ in range(5):
        gym.restore(env, snapshot)
        assert not any(truncated for _, truncated in _steps(env, 4))


def test_restoring_inside_gymnasiums_wrapper_is_refused_at_the_next_step() -> None:
    env: Any = gymnasium.make(_ID)
    env.reset(seed=1)
    _steps(env, 3)
    snapshot = env.unwrapped.environment.snapshot()
    _steps(env, 1)
    env.unwrapped.environment.restore(snapshot)
    with pytest.raises(RuntimeError, match=r"restore with limberjack\.gym\.restore"):
        _steps(env, 1)
    gym.restore(env, snapshot)
    _steps(env, 1)


def test_an_environment_that_counts_by_itself_may_be_restored_directly() -> None:
    env = gym.load("manipulator", "bring_ball", time_limit=10 * _STEP)
    env.reset(seed=1)
    _steps(env, 2)
    snapshot = env.environment.snapshot()
    first = _steps(env, 3)
    env.environment.restore(snapshot)
    assert _steps(env, 3) == first


def test_a_snapshot_past_the_limit_is_refused_and_nothing_changes() -> None:
    long = suite.load("manipulator", "bring_ball", {"random": 0})
    long.reset()
    for _ in range(30):
        long.step(np.zeros(5))
    snapshot = long.snapshot()
    short = gym.load("manipulator", "bring_ball", time_limit=30 * _STEP)
    counted: Any = gymnasium.make(_ID, max_episode_steps=30)
    batch = suite.load_batch("manipulator", "bring_ball", 2, 1, 0, {"time_limit": 30 * _STEP})
    batch.reset()
    for env in (short, counted):
        env.reset(seed=0)
        with pytest.raises(ValueError, match="the snapshot is of step 30 of an episode, and"):
            gym.restore(env, snapshot)
        assert _length(env, 31) == 30
    with pytest.raises(ValueError, match="end after 30 steps here: restore it where"):
        batch.restore(snapshot, [1])
    fits = suite.load("manipulator", "bring_ball", {"time_limit": 31 * _STEP})
    fits.restore(snapshot)
    assert fits.step(np.zeros(5)).last()


def test_only_environments_of_this_package_can_be_restored() -> None:
    other = gymnasium.make("CartPole-v1")
    snapshot = suite.load("manipulator", "bring_ball").snapshot()
    with pytest.raises(TypeError, match=r"expected an environment of limberjack\.gym"):
        gym.restore(other, snapshot)


def test_a_specification_makes_the_environment_also_from_json() -> None:
    spec = spec_of("pendulum", "swingup", steps=3, flat=True, dtype="float32")
    for one in (spec, EnvSpec.from_json(spec.to_json())):
        env = gymnasium.make(one)
        observation, _ = env.reset(seed=0)
        assert observation.dtype == np.float32
        ends = [env.step(env.action_space.sample())[3] for _ in range(3)]
        assert ends == [False, False, True]
        env.close()


def test_the_registered_specification_is_not_changed() -> None:
    before = gymnasium.spec("limberjack/pendulum-swingup-v0").kwargs
    spec_of("pendulum", "swingup", steps=3, flat=True)
    assert gymnasium.spec("limberjack/pendulum-swingup-v0").kwargs == before
    assert spec_of("pendulum", "swingup").max_episode_steps == 1000


def test_a_task_that_gymnasium_does_not_know_is_an_error() -> None:
    with pytest.raises(gymnasium.error.Error):
        spec_of("pendulum", "walk")
