"""The length of episodes: every way to change it works, or is refused with one sentence."""

from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec

from limberjack import gym, suite
from tests.programs import run

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
def test_a_longer_time_limit_is_refused_with_the_argument_to_give_instead(
    mode: str, time_limit: float, instead: int
) -> None:
    with pytest.raises(ValueError, match=f"give max_episode_steps={instead} to gymnasium.make"):
        _make(mode, time_limit=time_limit)


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
