"""`Env`: one simulation as a Gymnasium environment."""

import copy
import os
import pickle
from typing import Any

import dm_env
import gymnasium
import numpy as np
import pytest
from dm_env import specs
from gymnasium import error
from gymnasium.utils.env_checker import check_env
from gymnasium.wrappers import TimeLimit

from limberjack import gym, mujoco, suite
from limberjack.rl import control
from limberjack.rl.batch import BatchEnvironment
from limberjack.rl.batches import batch_of
from limberjack.rl.reward_terms import reward_of_terms
from tests import plain_domain
from tests.programs import run

from .gym_episodes import NORMALISED, TASKS, assert_same, bounds, falling_env

_NO_OPENGL = os.environ.get("MUJOCO_GL") == "disable"


def _env(task: tuple[str, str] = ("humanoid", "walk"), **kwargs: Any) -> gym.Env:
    return gym.load(*task, **kwargs)


# Requirements of Gymnasium and its users.


@pytest.mark.parametrize(("domain", "task"), NORMALISED)
@pytest.mark.parametrize("kwargs", [{}, {"flat": True, "dtype": "float32"}], ids=["dict", "flat"])
def test_gymnasiums_checker_finds_nothing_wrong(
    domain: str, task: str, kwargs: dict[str, Any]
) -> None:
    env = gymnasium.make(f"limberjack/{domain}-{task}-v0", **kwargs)
    check_env(env.unwrapped, skip_render_check=_NO_OPENGL)  # warnings are errors
    env.close()


def test_it_runs_within_gymnasiums_wrappers() -> None:
    env: Any = gymnasium.make("limberjack/stacker-stack_2-v0", time_limit=0.05)
    env = gymnasium.wrappers.RecordEpisodeStatistics(gymnasium.wrappers.FlattenObservation(env))
    env.reset(seed=0)
    total, truncated, info = 0.0, False, {}
    while not truncated:
        _, reward, _, truncated, info = env.step(env.action_space.sample())
        total += reward
    assert info["episode"]["l"] == 5
    # It keeps its sum in float32.
    assert info["episode"]["r"] == pytest.approx(total, abs=1e-6)


def _warnings_of_sb3(env: gym.Env) -> list[str]:
    """The conditions under which Stable-Baselines3's `check_env` warns, checked as it does.

    As in version 2.9. `tests/adapters/test_sb3.py` calls the checker itself, where that is
    installed.
    """
    spaces = getattr(env.observation_space, "spaces", {"": env.observation_space})
    found = [name for name, space in spaces.items() if len(space.shape) not in (1, 3)]
    action: Any = env.action_space
    if (action.low != -1).any() or (action.high != 1).any():
        found.append("actions are not from -1 to 1")
    if action.dtype != np.float32:
        found.append("actions are not float32")
    return found


@pytest.mark.parametrize(("domain", "task"), NORMALISED)
def test_flat_observations_give_sb3s_checker_no_reason_to_warn(domain: str, task: str) -> None:
    assert _warnings_of_sb3(_env((domain, task), flat=True)) == []


def test_observations_by_name_give_it_reasons_that_the_docs_name() -> None:
    assert _warnings_of_sb3(_env()) == ["head_height"]
    assert "arm_pos" in _warnings_of_sb3(_env(("manipulator", "bring_ball")))


def test_the_simulation_is_reached_through_wrappers() -> None:
    env: Any = gymnasium.make("limberjack/humanoid-walk-v0")
    env.reset(seed=0)
    physics = env.unwrapped.physics
    assert physics is env.unwrapped.environment.physics
    assert physics.head_height() > 0


def test_actions_are_float32_whatever_the_observations_are() -> None:
    env = _env()
    env.reset(seed=0)
    action = env.action_space.sample()
    assert action.dtype == np.float32
    observation, *_ = env.step(action)
    assert observation["velocity"].dtype == np.float64


@pytest.mark.parametrize(
    "make",
    [
        lambda **kwargs: gym.load("humanoid", "walk", **kwargs),
        lambda **kwargs: gym.Env(suite.load("humanoid", "walk"), **kwargs),
        lambda **kwargs: gymnasium.make("limberjack/humanoid-walk-v0", **kwargs),
        lambda **kwargs: gymnasium.make_vec("limberjack/humanoid-walk-v0", num_envs=1, **kwargs),
        lambda **kwargs: gym.VectorEnv(suite.load_batch("humanoid", "walk", 1), **kwargs),
    ],
    ids=["load", "Env", "make", "make_vec", "VectorEnv"],
)
def test_unknown_keywords_are_answered_with_the_nearest_name(make: Any) -> None:
    with pytest.raises(TypeError, match=r"'camera_nam'\. Did you mean 'camera_name'"):
        make(camera_nam="side")
    with pytest.raises(TypeError, match=r"'camra'\. Did you mean 'camera_id'"):
        make(render_kwargs={"camra": 0})


# Seeds, and that the numbers are dm_control's.


@pytest.mark.parametrize(("domain", "task"), TASKS)
def test_a_seed_begins_the_episode_of_random_and_then_the_stream_continues(
    domain: str, task: str
) -> None:
    env: Any = gym.load(domain, task, time_limit=0.1)
    single = suite.load(domain, task, {"random": 7, "time_limit": 0.1})
    actions = np.random.RandomState(0)
    for seed in (7, None, None):
        time_step = single.reset()
        observation, info = env.reset(seed=seed)
        assert info == {}
        while True:
            assert_same(dict(observation), _as_arrays(time_step.observation))
            if time_step.last():
                break
            action = actions.uniform(*bounds(env.action_space))
            time_step = single.step(action)
            observation, reward, terminated, truncated, _ = env.step(action)
            assert reward == time_step.reward
            assert (terminated, truncated) == (False, time_step.last())


def test_the_same_seed_begins_the_same_episode_whatever_came_before() -> None:
    env = _env(flat=True)
    first, _ = env.reset(seed=3)
    for _ in range(5):
        env.step(env.action_space.sample())
    np.testing.assert_array_equal(env.reset(seed=3)[0], first)
    assert not np.array_equal(env.reset()[0], first)


@pytest.mark.parametrize("seed", [-1, 2**32])
def test_a_seed_out_of_range_is_refused(seed: int) -> None:
    with pytest.raises(ValueError, match=rf"seed is {seed}; expected .* from 0 to 2\*\*32 - 1"):
        _env().reset(seed=seed)


def test_a_seed_that_is_not_a_whole_number_is_refused() -> None:
    with pytest.raises(TypeError, match=r"seed is 1\.5"):
        _env().reset(seed=1.5)  # pyright: ignore[reportArgumentType]


# Ends of episodes.


def test_the_time_limit_truncates_and_the_task_terminates() -> None:
    ends = set()
    env = falling_env()
    for seed in range(8):
        env.reset(seed=seed)
        steps = 0
        while True:
            _, _, terminated, truncated, _ = env.step(np.zeros(21))
            steps += 1
            if terminated or truncated:
                break
        assert terminated != truncated
        assert truncated == (steps == 16)
        ends.add(terminated)
    assert ends == {False, True}


def test_a_step_without_an_episode_is_refused() -> None:
    env = _env(time_limit=0.025)
    with pytest.raises(error.ResetNeeded, match="call reset"):
        env.step(np.zeros(21))
    env.reset(seed=0)
    assert env.step(np.zeros(21))[3]
    with pytest.raises(error.ResetNeeded, match="call reset"):
        env.step(np.zeros(21))


@pytest.mark.parametrize("reward", [None, "much", np.ones(1)])
def test_a_reward_that_is_no_number_is_named(reward: Any) -> None:
    class Odd(plain_domain.Push):
        def get_reward(self, physics: Any) -> Any:
            return reward

    inner = plain_domain.push()
    env = gym.Env(control.Environment(inner.physics, Odd(), time_limit=1))
    env.reset()
    with pytest.raises(TypeError, match=r"the reward of Odd is .*; expected a number"):
        env.step(env.action_space.sample())


class _Whole(dm_env.Environment):
    """Takes whole numbers, and remembers the last."""

    def __init__(self, spec: specs.BoundedArray) -> None:
        self.spec, self.taken = spec, None

    def reset(self) -> dm_env.TimeStep:
        return dm_env.restart(np.zeros(1))

    def step(self, action: Any) -> dm_env.TimeStep:
        self.taken = action
        return dm_env.transition(0.0, np.zeros(1))

    def observation_spec(self) -> Any:
        return specs.Array((1,), float)

    def action_spec(self) -> Any:
        return self.spec


@pytest.mark.parametrize(
    ("spec", "space"),
    [
        (specs.DiscreteArray(3), gymnasium.spaces.Discrete(3)),
        (
            specs.BoundedArray((2,), np.int32, 0, [4, 5]),
            gymnasium.spaces.Box(np.zeros(2, np.int32), np.array([4, 5]), (2,), np.int32),
        ),
        (
            specs.BoundedArray((2,), np.int32, 0, 3),
            gymnasium.spaces.Box(0, 3, (2,), np.int32),
        ),
    ],
    ids=["discrete", "integers", "integers in one range"],
)
def test_actions_that_are_whole_numbers_stay_whole(spec: Any, space: gymnasium.Space) -> None:
    env = gym.Env(lambda seed: _Whole(spec))
    envs = gym.VectorEnv(batch_of(lambda seed: _Whole(spec), 2))
    assert env.action_space == envs.single_action_space == space
    env.reset(seed=0)
    envs.reset(seed=0)
    action, actions = env.action_space.sample(), envs.action_space.sample()
    env.step(action)
    envs.step(actions)
    assert env.environment.taken == pytest.approx(action, abs=0)
    for row, one in enumerate(envs.batches[0].environments):
        np.testing.assert_array_equal(one.taken, actions[row])
        assert one.taken.dtype.kind == "i"


def test_divergence_raises_and_a_reset_begins_another_episode() -> None:
    env = _env()
    env.reset(seed=0)
    env.environment.physics.data.qpos[0] = np.nan
    with pytest.raises(control.PhysicsError):
        env.step(np.zeros(21))
    with pytest.raises(error.ResetNeeded):
        env.step(np.zeros(21))
    assert_same(env.reset(seed=0), _env().reset(seed=0))


@pytest.mark.parametrize("bad", [np.zeros(20), np.full(21, np.nan), np.zeros((1, 21))])
def test_a_refused_action_changes_nothing(bad: np.ndarray) -> None:
    env, twin = _env(), _env()
    env.reset(seed=0)
    twin.reset(seed=0)
    with pytest.raises(ValueError, match="action"):
        env.step(bad)
    assert_same(env.step(np.ones(21)), twin.step(np.ones(21)))


# Observations.


@pytest.mark.parametrize(("domain", "task"), TASKS)
def test_the_layout_gives_the_position_of_each_observation(domain: str, task: str) -> None:
    flat = gym.load(domain, task, flat=True)
    parts: Any = gym.load(domain, task)
    array, _ = flat.reset(seed=0)
    observation, _ = parts.reset(seed=0)
    assert flat.layout == parts.layout
    assert list(observation) == [part.name for part in flat.layout] == list(parts.observation_space)
    for name, where, shape in flat.layout:
        assert_same(array[where].reshape(shape), observation[name])
    assert flat.layout[-1].slice.stop == array.size


def test_the_flat_order_is_that_of_a_flat_dm_env_observation() -> None:
    single = suite.load("stacker", "stack_4", {"random": 0}, {"flat_observation": True})
    expected = single.reset().observation["observations"]
    assert_same(gym.load("stacker", "stack_4", flat=True).reset(seed=0)[0], expected)


@pytest.mark.parametrize("flat", [False, True])
def test_float32_is_the_float64_observation_rounded(flat: bool) -> None:
    doubles, floats = _env(flat=flat), _env(flat=flat, dtype=np.float32)
    action = np.full(21, 0.5)
    for one, other in zip(
        (doubles.reset(seed=0)[0], doubles.step(action)[0]),
        (floats.reset(seed=0)[0], floats.step(action)[0]),
        strict=True,
    ):
        rounded = one.astype("f4") if flat else {k: v.astype("f4") for k, v in one.items()}
        assert_same(rounded, other)
    assert floats.action_space.dtype == np.float32


@pytest.mark.parametrize("dtype", ["float16", int, "nonsense", None])
def test_other_number_types_are_refused(dtype: Any) -> None:
    with pytest.raises(ValueError, match="expected 'float64' or 'float32'"):
        _env(dtype=dtype)


# Info.


def test_the_info_has_the_terms_of_the_reward_and_success() -> None:
    env = _env(("humanoid", "stand"))
    env.reset(seed=0)
    _, reward, _, _, info = env.step(np.ones(21))
    assert set(info) == {"reward_terms", "success"}
    assert np.prod(list(info["reward_terms"].values())) == pytest.approx(reward, rel=1e-12)
    assert info["success"] is False


def test_a_ball_that_starts_at_the_target_is_a_success() -> None:
    env = _env(("manipulator", "bring_ball"))
    for seed in range(100):
        env.reset(seed=seed)
        if env.environment.task.start(env.environment.physics) == "in_target":
            break
    assert env.step(np.zeros(5))[4]["success"] is True


def test_the_info_of_a_task_without_terms_is_empty() -> None:
    class Plain(suite.humanoid.Humanoid):
        def get_reward(self, physics: Any) -> Any:
            return physics.head_height()

    physics = suite.humanoid.Physics.from_shared_xml(*suite.humanoid.get_model_and_assets())
    env = gym.Env(control.Environment(physics, Plain(0, False), time_limit=1))
    env.reset(seed=0)
    assert env.step(np.zeros(21))[4] == {}


def test_randomised_fields_are_in_the_info_of_a_reset() -> None:
    from limberjack.rl.randomize import scale

    env = _env(randomize={"geom_friction": scale(0.5, 2.0)})
    _, info = env.reset(seed=0)
    drawn = info["randomization"]["geom_friction"]
    np.testing.assert_array_equal(drawn, env.environment.physics.model.geom_friction)
    assert not np.array_equal(env.reset()[1]["randomization"]["geom_friction"], drawn)


# Pictures, closing, copies.


@pytest.mark.skipif(_NO_OPENGL, reason="MUJOCO_GL turns rendering off")
def test_a_picture_is_that_of_the_physics() -> None:
    env = _env(render_mode="rgb_array", render_kwargs={"height": 24, "width": 32, "camera_id": 0})
    env.reset(seed=0)
    picture = env.render()
    expected = env.environment.physics.render(24, 32, camera_id=0)
    np.testing.assert_array_equal(picture, expected)
    assert env.metadata["render_fps"] == 40


@pytest.mark.skipif(_NO_OPENGL, reason="MUJOCO_GL=disable: there are no pictures")
def test_size_and_camera_are_given_as_in_gymnasiums_own_environments() -> None:
    shown: dict[str, Any] = {"render_mode": "rgb_array", "width": 48, "height": 32}
    cameras: list[dict[str, Any]] = [{"camera_id": 1}, {"camera_name": "side"}]
    pictures = []
    for camera in cameras:
        env: Any = gymnasium.make("limberjack/humanoid-walk-v0", **shown, **camera)
        env.reset(seed=0)
        pictures.append(env.render())
        expected = env.unwrapped.physics.render(32, 48, camera_id=next(iter(camera.values())))
        np.testing.assert_array_equal(pictures[-1], expected)
        env.close()
    envs: Any = gymnasium.make_vec("limberjack/humanoid-walk-v0", num_envs=2, **shown, camera_id=1)
    envs.reset(seed=0)
    first, second = envs.render()
    np.testing.assert_array_equal(first, pictures[0])
    assert (first != second).any()
    envs.close()


def test_there_is_no_picture_without_a_render_mode() -> None:
    env = _env()
    env.reset(seed=0)
    assert env.render() is None


def test_an_unknown_render_mode_is_refused() -> None:
    with pytest.raises(ValueError, match="render_mode is 'human'; expected None or one of"):
        _env(render_mode="human")


def test_closing_twice_is_fine_and_later_use_is_refused() -> None:
    env = _env()
    env.reset(seed=0)
    env.close()
    env.close()
    for use in (env.reset, env.render, lambda: env.step(np.zeros(21))):
        with pytest.raises(error.ClosedEnvironmentError, match="closed"):
            use()


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_a_copy_continues_as_the_original_does(copied: Any) -> None:
    env = _env()
    env.reset(seed=0)
    env.step(np.ones(21))
    twin = copied(env)
    for _ in range(3):
        assert_same(env.step(np.ones(21)), twin.step(np.ones(21)))
    assert_same(env.reset(), twin.reset())


def test_a_time_limit_given_twice_is_refused() -> None:
    with pytest.raises(TypeError, match="time_limit is given twice"):
        _env(time_limit=1, task_kwargs={"time_limit": 2})


# Processes.


@pytest.mark.parametrize("context", ["fork", "spawn"])
def test_gymnasiums_processes_give_the_numbers_of_one_process(context: str) -> None:
    # The batch is there so that a fork takes its threads along.
    program = f"""
        import functools
        import gymnasium
        import numpy as np
        from limberjack import gym

        if __name__ == "__main__":
            batch = gym.load_vector("humanoid", "walk", 4, num_threads=2)
            batch.reset(seed=0)
            batch.step(np.zeros((4, 21)))
            makers = [functools.partial(gym.load, "humanoid", "walk", time_limit=0.1)] * 2
            here = gymnasium.vector.SyncVectorEnv(makers)
            there = gymnasium.vector.AsyncVectorEnv(makers, context={context!r})
            here.action_space.seed(0)
            results = [[envs.reset(seed=5)[0]] for envs in (here, there)]
            for _ in range(6):
                actions = here.action_space.sample()
                for envs, returned in zip((here, there), results, strict=True):
                    observation, *rest, info = envs.step(actions)
                    returned += [observation, *rest]
            for one, other in zip(*results, strict=True):
                one, other = (x if isinstance(x, dict) else {{"": x}} for x in (one, other))
                for name in one:
                    np.testing.assert_array_equal(one[name], other[name])
            there.close()
            print("same")
        """
    # Newer Pythons warn of any fork of a process with threads.
    assert run(program, warnings="ignore") == "same\n"


def _as_arrays(observation: Any) -> dict[str, np.ndarray]:
    return {name: np.asarray(value) for name, value in observation.items()}


@pytest.mark.parametrize("make", [gym.load, lambda *task: gym.load_vector(*task, num_envs=2)])
def test_options_that_are_not_a_mapping_are_refused_and_nothing_is_reset(make: Any) -> None:
    env = make("stacker", "stack_2")
    before = env.reset(seed=0)[0]
    for options in ("x", [("reset_mask", None)], 7):
        with pytest.raises(TypeError, match="expected a mapping"):
            env.reset(seed=1, options=options)
    after = env.reset(seed=0)[0]
    for name, value in before.items():
        np.testing.assert_array_equal(after[name], value)


def _two_rows(domain: str, task: str) -> gym.VectorEnv:
    return gym.load_vector(domain, task, 2)


@pytest.mark.parametrize(
    ("make", "options", "message"),
    [
        (gym.load, {"stat": None}, r"has 'stat', .*Did you mean 'state'\? There are: state"),
        (gym.load, {"reset_mask": np.ones(1, bool)}, "has 'reset_mask', which reset does not take"),
        (gym.load, {"seed": 3}, "has 'seed'"),
        (gym.load, {3: 1}, "has 3, which"),
        (_two_rows, {"reset_msk": 0}, "Did you mean 'reset_mask'"),
        (_two_rows, {"qpos": 0}, "There are: reset_mask, state"),
    ],
)
def test_unknown_options_are_refused_with_the_nearest_name_and_nothing_is_reset(
    make: Any, options: Any, message: str
) -> None:
    env, twin = make("stacker", "stack_2"), make("stacker", "stack_2")
    action = np.zeros(env.action_space.shape)
    for each in (env, twin):
        each.reset(seed=0)
        each.step(action)
    with pytest.raises(TypeError, match=message):
        env.reset(seed=1, options=options)
    assert_same(env.step(action), twin.step(action))
    assert_same(env.reset(), twin.reset(options={}))


@pytest.mark.parametrize("task", [("humanoid", "walk"), ("manipulator", "bring_ball")])
def test_the_time_between_two_actions_is_that_of_the_dm_env_environment(
    task: tuple[str, str],
) -> None:
    env: Any = gymnasium.make("limberjack/{}-{}-v0".format(*task))
    expected = suite.load(*task).control_timestep()
    assert env.unwrapped.dt == gym.load_vector(*task, 2).dt == expected


def test_a_subclass_is_taken_over_as_it_is() -> None:
    class Own(control.Environment):
        """A subclass of ours."""

    one = suite.load("humanoid", "walk")
    own = Own(one.physics, one.task)
    env = gym.Env(own)
    assert env.dt == 0.005
    assert env.environment is own


@pytest.mark.skipif(_NO_OPENGL, reason="MUJOCO_GL turns rendering off")
def test_pictures_of_a_list_of_cameras_are_side_by_side() -> None:
    shown: dict[str, Any] = {"render_mode": "rgb_array", "width": 32, "height": 24}
    one = [_env(camera_name=camera, **shown) for camera in ("back", "side")]
    several: list[dict[str, Any]] = [
        {"camera_name": ["back", "side"]},
        {"camera_id": [0, 1]},
        {"camera_id": ("back", 1)},
        {"render_kwargs": {"camera_id": ["back", "side"]}},
        {"render_kwargs": {"camera": [0, "side"]}},
    ]
    names = [one[0].physics.model.id2name(i, "camera") for i in (0, 1)]
    assert names == ["back", "side"]
    for env in one:
        env.reset(seed=0)
    expected = np.concatenate([np.asarray(env.render()) for env in one], axis=1)
    assert expected.shape == (24, 64, 3)
    for kwargs in several:
        env = _env(**shown, **kwargs)
        env.reset(seed=0)
        np.testing.assert_array_equal(env.render(), expected)
        envs = gym.load_vector("humanoid", "walk", 2, num_threads=1, **shown, **kwargs)
        envs.reset(seed=0)
        pictures = envs.render()
        assert pictures is not None
        assert [picture.shape for picture in pictures] == [(24, 64, 3)] * 2
        np.testing.assert_array_equal(pictures[0], expected)
        envs.close()


def test_no_cameras_are_refused_where_the_environment_is_made() -> None:
    none: list[dict[str, Any]] = [{"camera_id": []}, {"camera_name": ()}]
    for kwargs in (*none, {"render_kwargs": {"camera": []}}):
        with pytest.raises(ValueError, match="expected at least one camera"):
            _env(render_mode="rgb_array", **kwargs)
    with pytest.raises(TypeError, match="expected the name or number of a camera, or a list"):
        _env(render_mode="rgb_array", camera_id=[[0, 1]])


@pytest.mark.parametrize("make", [gym.load, lambda *task: gym.load_vector(*task, num_envs=2)])
def test_true_is_not_a_seed(make: Any) -> None:
    env = make("stacker", "stack_2")
    for seed in (True, False):
        with pytest.raises(TypeError, match=f"seed is {seed}; expected a whole number"):
            env.reset(seed=seed)


class _Bare(control.Task):
    """A task with terms, which is no `base.Task` and so has no goal."""

    get_reward = reward_of_terms  # pyright: ignore[reportAssignmentType]

    def initialize_episode(self, physics: Any) -> None:
        physics.data.qvel[0] = 1.0

    def before_step(self, action: Any, physics: Any) -> None:
        physics.set_control(action)

    def action_spec(self, physics: Any) -> Any:
        return mujoco.action_spec(physics)

    def get_observation(self, physics: Any) -> Any:
        return {"velocity": physics.velocity()}

    def reward_terms(self, physics: Any) -> Any:
        return {"speed": physics.velocity()[..., 0]}

    def reward_of(self, terms: Any) -> Any:
        return terms["speed"]


def test_a_task_that_is_not_of_the_suite_needs_no_goal() -> None:
    physics = suite.load("pendulum", "swingup").physics
    env = control.Environment(physics, _Bare(), time_limit=1)
    envs = gym.VectorEnv(BatchEnvironment.from_environment(env, 2, 1))
    single = gym.Env(env)
    single.reset(seed=0), envs.reset(seed=0)
    *_, info = single.step([0.0])
    *_, infos = envs.step([[0.0], [0.0]])
    assert list(info) == ["reward_terms"]
    assert infos["reward_terms"]["speed"].tolist() == [info["reward_terms"]["speed"]] * 2
    assert "success" not in infos


class _Replaced(TimeLimit):
    """A time limit as RL-Zoo puts in the place of Gymnasium's: without a `spec` of its own."""


def test_a_time_limit_that_a_library_has_replaced_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gym.env, "TimeLimit", _Replaced)
    monkeypatch.setattr("gymnasium.envs.registration.TimeLimit", _Replaced, raising=False)
    made = gymnasium.make("limberjack/cartpole-balance-v0", max_episode_steps=2, flat=True)
    assert made.spec is not None
    assert made.spec.max_episode_steps == 2
    made.reset(seed=0)
    assert [made.step(made.action_space.sample())[3] for _ in range(2)] == [False, True]
