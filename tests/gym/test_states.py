"""The option `state` of a reset, in one environment and in rows, in every mode."""

import os
import pickle
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from limberjack import gym, rl, suite
from limberjack.gym.states import states_of_rows
from limberjack.rl import control
from limberjack.rl.batch import BatchEnvironment
from limberjack.rl.randomize import scale
from limberjack.suite import humanoid
from limberjack.suite.wrappers import action_scale
from tests.plain_pictures import draw_plainly

from .gym_episodes import MODES, assert_same, falling_env, falling_envs

_NO_OPENGL = os.environ.get("MUJOCO_GL") == "disable"
_draws = pytest.mark.skipif(_NO_OPENGL, reason="MUJOCO_GL turns rendering off")
_WALK = ("humanoid", "walk")
_BALL = ("manipulator", "bring_ball")


def _states(nq: int, nv: int, count: int, seed: int = 1) -> dict[str, np.ndarray]:
    stream = np.random.RandomState(seed)
    return {
        "qpos": stream.uniform(-0.4, 0.4, (count, nq)),
        "qvel": stream.uniform(-1, 1, (count, nv)),
    }


def _row(states: dict[str, np.ndarray], row: int) -> dict[str, np.ndarray]:
    return {name: values[row] for name, values in states.items()}


def _assert_rows(results: Any, singles: list[gym.Env], action: np.ndarray) -> None:
    """Steps the single environments; fails unless the batch's results are theirs."""
    observations, rewards, terminated, truncated, _ = results
    for row, single in enumerate(singles):
        observation, *rest, _ = single.step(action[row])
        one = (
            {name: values[row] for name, values in observations.items()}
            if isinstance(observations, dict)
            else observations[row]
        )
        assert_same(one, observation, f"row {row}")
        assert_same([rewards[row], terminated[row], truncated[row]], rest, f"row {row}")


# Laws.


@pytest.mark.parametrize("task", [_WALK, _BALL, ("quadruped", "walk"), ("dog", "stand")])
@pytest.mark.parametrize("flat", [False, True])
def test_rows_with_given_states_equal_single_environments(
    task: tuple[str, str], flat: bool
) -> None:
    envs: Any = gym.load_vector(*task, 4, num_threads=2, flat=flat, pipelined=True)
    model = envs.batches[0].physics.model
    states = _states(model.nq, model.nv, 4)
    if model.na:
        states["act"] = np.random.RandomState(3).uniform(0, 1, (4, model.na))
    observations, info = envs.reset(seed=5, options={"state": states})
    singles = [gym.load(*task, flat=flat) for _ in range(4)]
    for row, single in enumerate(singles):
        observation, single_info = single.reset(seed=5 + row, options={"state": _row(states, row)})
        one = observations[row] if flat else {n: v[row] for n, v in observations.items()}
        assert_same(one, observation)
        assert single_info == info == {}
    actions = np.random.RandomState(0).uniform(-1, 1, (10, *envs.action_space.shape))
    for action in actions:
        _assert_rows(envs.step(action), singles, action)
    for half, rows in enumerate(envs.halves):
        envs.send(actions[0][rows], half)
    received = [envs.recv() for _ in envs.halves]
    for rows, result in zip(envs.halves, received, strict=True):
        _assert_rows(result, singles[rows], actions[0][rows])
    envs.close()


def test_tasks_with_activations_are_among_these() -> None:
    models = [gym.load(*task).physics.model for task in (("quadruped", "walk"), ("dog", "stand"))]
    assert all(model.na for model in models)


@pytest.mark.parametrize("vectorised", [None, False])
def test_given_states_and_repeated_actions_go_together(vectorised: bool | None) -> None:
    how: dict[str, Any] = {"action_repeat": 3, "time_limit": 0.25}  # 10 control steps
    envs = gym.load_vector(*_WALK, 2, num_threads=1, vectorised=vectorised, **how)
    singles, states = [gym.load(*_WALK, **how) for _ in range(2)], _states(28, 27, 2)
    envs.reset(seed=0, options={"state": states})
    for row, single in enumerate(singles):
        single.reset(seed=row, options={"state": _row(states, row)})
    zeros = np.zeros((2, 21))
    _assert_rows(envs.step(zeros), singles, zeros)
    saved = envs.batches[0].snapshot()
    for _ in range(2):
        envs.reset(options={"state": saved})
        for row, single in enumerate(singles):
            single.reset(options={"state": saved.part(row)})
        for left in (2, 1, 0):
            results = envs.step(zeros)
            _assert_rows(results, singles, zeros)
            assert results[3].all() == (left == 0)


def test_given_states_and_staggered_episodes_go_together() -> None:
    envs, twin = (
        gym.load_vector(*_WALK, 3, num_threads=1, stagger=True, time_limit=0.25) for _ in range(2)
    )
    envs.reset(seed=0, options={"state": _states(28, 27, 3)})
    twin.reset(seed=0)
    zeros = np.zeros((3, 21))
    ends = []
    for _ in range(12):
        truncated = envs.step(zeros)[3]
        assert_same(truncated, twin.step(zeros)[3])
        ends.append(truncated)
    assert np.any(ends[:9])  # before the time limit


@pytest.mark.parametrize("mode", MODES)
def test_every_mode_continues_from_given_states(mode: AutoresetMode) -> None:
    envs = falling_envs(2, 1, autoreset_mode=mode)
    envs.reset(seed=0)
    for _ in range(3):
        envs.step(np.zeros((3, 21)))
    # Two rows of three start again, one of them from a state that falls at once.
    lying = {**_states(28, 27, 3), "qvel": np.zeros((3, 27))}
    lying["qpos"][:, 2:7] = 0.1, 1, 0, 0, 0
    mask = np.array([False, True, True])
    before = envs.batches[0].snapshot([0])
    states = [None, None, _row(lying, 2)]
    envs.reset(seed=7, options={"state": states, "reset_mask": mask})
    singles = [falling_env() for _ in range(3)]
    for row, single in enumerate(singles):
        single.reset(seed=7 + row, options={"state": states[row]})
    singles[0].restore(before)
    results = envs.step(np.zeros((3, 21)))
    assert results[2].tolist() == [False, False, True]
    if mode is AutoresetMode.SAME_STEP:  # the observation is that of the next episode
        assert results[-1]["final_obs"][2]["head_height"] < 0.8
    else:
        _assert_rows(results, singles, np.zeros((3, 21)))


def test_a_list_mixes_mappings_snapshots_and_none() -> None:
    envs, singles = gym.load_vector(*_WALK, 5, num_threads=2, pipelined=True), []
    other = gym.load(*_WALK)
    other.reset(seed=30)
    for _ in range(4):
        other.step(np.zeros(21))
    snapshot = other.environment.snapshot()
    states = _states(28, 27, 5)
    given: list[Any] = [None, {"qvel": states["qvel"][1]}, snapshot, _row(states, 3), snapshot]
    observations, _ = envs.reset(seed=0, options={"state": given})
    for row, state in enumerate(given):
        single = gym.load(*_WALK)
        observation, _ = single.reset(seed=row, options={"state": state})
        assert_same({name: values[row] for name, values in observations.items()}, observation)
        singles.append(single)
    for _ in range(5):
        _assert_rows(envs.step(np.ones((5, 21))), singles, np.ones((5, 21)))
    steps = [step for batch in envs.batches for step in batch._counter.steps.tolist()]
    assert steps == [5, 5, 9, 5, 9]


@pytest.mark.parametrize("sizes", [(3,), (1, 2)])
def test_a_snapshot_of_all_rows_is_restored_with_its_step_counts(sizes: tuple[int, ...]) -> None:
    source, envs = falling_envs(3), falling_envs(*sizes)
    source.reset(seed=0)
    for _ in range(4):
        source.step(np.zeros((3, 21)))
    snapshot = pickle.loads(pickle.dumps(source.batches[0].snapshot()))
    known = source.step(np.zeros((3, 21)))
    envs.reset(seed=50)
    envs.step(np.ones((3, 21)))
    mask = np.array([True, False, True])
    twin = falling_envs(*sizes)
    twin.reset(seed=50)
    twin.step(np.ones((3, 21)))
    envs.reset(options={"state": snapshot, "reset_mask": mask})
    seen, others = envs.step(np.zeros((3, 21))), twin.step(np.zeros((3, 21)))
    for name, values in known[0].items():
        assert_same(seen[0][name][mask], values[mask])
        assert_same(seen[0][name][~mask], others[0][name][~mask])
    envs.reset(options={"state": snapshot})
    assert_same(envs.step(np.zeros((3, 21)))[0], known[0])


def test_a_state_continues_the_streams_as_without_it() -> None:
    envs, twin = (gym.load_vector(*_BALL, 2, num_threads=1) for _ in range(2))
    for each, options in ((envs, {"state": _states(11, 11, 2)}), (twin, None)):
        each.reset(seed=3, options=options)
    assert_same(envs.reset()[0], twin.reset()[0])


def test_the_info_has_what_was_drawn_for_the_start_or_saved_in_the_snapshot() -> None:
    kwargs: Any = {"randomize": {"body_mass": scale(0.5, 2.0)}, "num_threads": 1}
    envs, twin = (gym.load_vector(*_WALK, 2, **kwargs) for _ in range(2))
    _, known = twin.reset(seed=3)
    _, info = envs.reset(seed=3, options={"state": _states(28, 27, 2)})
    assert_same(info, known)
    _, info = envs.reset(seed=9, options={"state": twin.batches[0].snapshot()})
    assert_same(info, known)


@_draws
def test_pictures_show_the_given_state_and_fill_the_stack() -> None:
    pixels = {"camera": 0, "height": 12, "width": 16, "frame_stack": 3}
    single = gym.load(*_BALL, pixels=pixels)
    draw_plainly(single.physics.model)
    envs = gym.VectorEnv(BatchEnvironment.from_environment(single.environment, 3, 1))
    states = _states(11, 11, 3)
    drawn, _ = envs.reset(seed=0)
    seen, _ = envs.reset(seed=0, options={"state": states})
    assert (drawn["pixels"] != seen["pixels"]).any()
    for row in range(3):
        observation, _ = single.reset(seed=row, options={"state": _row(states, row)})
        assert_same(seen["pixels"][row], observation["pixels"])
        first, second, third = np.split(observation["pixels"], 3, axis=-1)
        assert_same([first, second], [third, third])
    envs.step(np.zeros((3, 5)))
    now = envs.step(np.ones((3, 5)))[0]["pixels"]
    snapshot = envs.batches[0].snapshot()
    envs.step(np.zeros((3, 5)))
    assert_same(envs.reset(options={"state": snapshot})[0]["pixels"], now)
    observation, _ = single.reset(options={"state": envs.batches[0].snapshot([1])})
    assert_same(observation["pixels"], now[1])


# Rows that are complete environments.


class _Delayed(humanoid.Humanoid):
    """Observes the velocity of one step ago."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self._last = np.zeros(27)

    def initialize_episode(self, physics: Any) -> None:
        super().initialize_episode(physics)
        self._last = np.zeros(27)

    def get_observation(self, physics: Any) -> Any:
        observation = super().get_observation(physics)
        observation["delayed"], self._last = self._last, physics.velocity().copy()
        return observation


class _Doubled(control.Environment):
    """Applies each action twice."""

    def step(self, action: Any) -> Any:
        super().step(action)
        return super().step(action)


def _delayed(seed: int) -> control.Environment:
    task = _Delayed(move_speed=1, pure_state=False, random=seed)
    return control.Environment(suite.load(*_WALK).physics, task, n_sub_steps=5)


def _doubled(seed: int) -> control.Environment:
    plain = suite.load(*_WALK, {"random": seed})
    return _Doubled(plain.physics, plain.task, n_sub_steps=5)


def _plain(seed: int) -> control.Environment:
    return suite.load(*_WALK, {"random": seed})


@pytest.mark.parametrize("build", [_plain, _delayed, _doubled])
@pytest.mark.parametrize("sizes", [(4,), (1, 3)])
def test_rows_that_are_environments_begin_in_given_states(
    build: Any, sizes: tuple[int, ...]
) -> None:
    batches = [rl.batch_of(build, size, 1, vectorised=False) for size in sizes]
    envs, states = gym.VectorEnv(*batches), _states(28, 27, 4)
    source = gym.Env(build(20))
    source.reset()
    for _ in range(3):
        source.step(np.ones(21))
    snapshot = source.environment.snapshot()
    given: list[Any] = [None, _row(states, 1), {"qvel": states["qvel"][2]}, snapshot]
    envs.reset(seed=0, options={"state": given})
    singles = [gym.Env(build(row)) for row in range(4)]
    for row, single in enumerate(singles):
        single.reset(seed=row, options={"state": given[row]})
    for _ in range(3):
        _assert_rows(envs.step(np.ones((4, 21))), singles, np.ones((4, 21)))
    mask = np.array([False, True, True, False])
    observations, _ = envs.reset(seed=5, options={"state": states, "reset_mask": mask})
    for row in (1, 2):
        observation, _ = singles[row].reset(seed=5 + row, options={"state": _row(states, row)})
        assert_same({n: v[row] for n, v in observations.items()}, observation)
    _assert_rows(envs.step(np.ones((4, 21))), singles, np.ones((4, 21)))
    envs.close()


def test_a_refused_state_changes_nothing_in_rows_that_are_environments() -> None:
    envs, twin = (
        gym.VectorEnv(*(rl.batch_of(_delayed, n, 1, seed=n, vectorised=False) for n in (1, 2)))
        for _ in range(2)
    )
    for each in (envs, twin):
        each.reset(seed=0)
        each.step(np.ones((3, 21)))
    for state, message in (
        ({"qvel": np.full((3, 27), np.inf)}, r"invalid in rows \[0, 1, 2\]"),
        ([None, None, {"qvel": np.zeros(3)}], r"state of row 2 has shape \(3,\)"),
        (twin.batches[1].snapshot(), "holds 2 environments; expected 3"),
    ):
        with pytest.raises(ValueError, match=message):
            envs.reset(seed=9, options={"state": state})
    assert_same(envs.step(np.ones((3, 21))), twin.step(np.ones((3, 21))))


def test_environments_of_other_kinds_have_no_state_to_set() -> None:
    def build(seed: int) -> Any:
        return action_scale.Wrapper(_plain(seed), minimum=-2, maximum=2)

    envs = gym.VectorEnv(rl.batch_of(build, 2, 1, vectorised=False))
    envs.reset(seed=0)
    with pytest.raises(TypeError, match="a Wrapper cannot begin in a given state; expected a"):
        envs.reset(options={"state": {"qvel": np.zeros((2, 27))}})


# The count of Gymnasium's `TimeLimit`.


def test_a_snapshot_sets_the_count_of_gymnasiums_time_limit() -> None:
    env: Any = gymnasium.make("limberjack/humanoid-walk-v0", max_episode_steps=6)
    env.reset(seed=0)
    for _ in range(4):
        env.step(np.zeros(21))
    snapshot = env.unwrapped.environment.snapshot()
    known = [env.step(np.zeros(21)) for _ in range(2)]
    for _ in range(2):
        env.reset(seed=1, options={"state": snapshot})
        assert_same([env.step(np.zeros(21)) for _ in range(2)], known)
        assert known[-1][3]
        env.reset()
        assert [env.step(np.zeros(21))[3] for _ in range(6)] == [False] * 5 + [True]
    short: Any = gymnasium.make("limberjack/humanoid-walk-v0", max_episode_steps=4)
    short.reset(seed=0)
    with pytest.raises(ValueError, match=r"step 4 of an episode, and Gymnasium ends .* after 4"):
        short.reset(options={"state": snapshot})


def test_a_refused_reset_leaves_the_count_of_gymnasiums_time_limit_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    env: Any = gymnasium.make("limberjack/humanoid-walk-v0", max_episode_steps=4)
    env.reset(seed=0)
    env.step(np.zeros(21))
    env.step(np.zeros(21))
    for options, seed in (({"stat": 1}, None), ({"state": {"qps": 1}}, None), (None, -1)):
        with pytest.raises((TypeError, ValueError)):
            env.reset(seed=seed, options=options)

    def interrupted(seed: int) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(env.unwrapped._played, "reseed", interrupted)
        with pytest.raises(KeyboardInterrupt):
            env.reset(seed=1)
    assert [env.step(np.zeros(21))[3] for _ in range(2)] == [False, True]


# Refused.


def _wide(value: Any) -> np.ndarray:
    states = np.zeros((5, 28))
    states[[1, 4]] = value
    return states


@pytest.mark.parametrize(
    ("options", "kind", "message"),
    [
        ({"reset_msk": 1}, TypeError, "has 'reset_msk', .* Did you mean 'reset_mask'"),
        ({"qpos": 1}, TypeError, "options has 'qpos', which reset does not take. There are: reset"),
        ({"state": {"qps": 1}}, TypeError, "no field 'qps'. Did you mean 'qpos'"),
        ({"state": {}}, ValueError, "the state is empty"),
        ({"state": 7}, TypeError, "the state is 7; expected a mapping such as"),
        ({"state": np.zeros((5, 28))}, TypeError, "expected a mapping such as"),
        ({"state": {"qpos": np.zeros(28)}}, ValueError, r"shape \(28,\); expected \(5, 28\)"),
        ({"state": {"qpos": _wide(np.nan)}}, ValueError, r"'qpos' .* invalid in rows \[1, 4\]"),
        ({"state": [None] * 4}, ValueError, "there are 4 states; expected 5: one for each row"),
        ({"state": [None] * 4 + [3]}, TypeError, "the state of row 4 is 3; expected a mapping"),
        ({"state": [None] * 4 + [{"qpos": [0]}]}, ValueError, r"state of row 4 has shape \(1,\)"),
        ({"state": [None] * 3 + [{"qvl": []}, None]}, TypeError, "the state of row 3 has no field"),
        ({"state": [{}] + [None] * 4}, ValueError, "the state of row 0 is empty"),
    ],
)
def test_an_invalid_state_is_refused_and_nothing_is_reset(
    options: Any, kind: Any, message: str
) -> None:
    envs, twin = (gym.load_vector(*_WALK, 5, num_threads=1, pipelined=True) for _ in range(2))
    for each in (envs, twin):
        each.reset(seed=0)
        each.step(np.ones((5, 21)))
    with pytest.raises(kind, match=message):
        envs.reset(seed=9, options=options)
    assert_same(envs.step(np.zeros((5, 21))), twin.step(np.zeros((5, 21))))
    assert_same(envs.reset(), twin.reset())


@pytest.mark.parametrize(
    ("options", "kind", "message"),
    [
        ({"qpos": [0.3]}, TypeError, "options has 'qpos', .* There are: state"),
        ({"stat": {}}, TypeError, "Did you mean 'state'"),
        ({"state": {"qpos": np.zeros((1, 28))}}, ValueError, r"shape \(1, 28\); expected \(28,\)"),
        ({"state": [None]}, TypeError, r"the state is \[None\]; expected a mapping"),
        ({"state": {"qvel": np.full(27, np.inf)}}, ValueError, "'qvel' of the state is inf at in"),
    ],
)
def test_a_single_environment_refuses_states_of_rows(options: Any, kind: Any, message: str) -> None:
    env, twin = gym.load(*_WALK), gym.load(*_WALK)
    for each in (env, twin):
        each.reset(seed=0)
    with pytest.raises(kind, match=message):
        env.reset(seed=9, options=options)
    assert_same(env.step(np.zeros(21)), twin.step(np.zeros(21)))
    assert_same(env.reset(), twin.reset())


def test_snapshots_that_do_not_fit_are_refused_and_name_the_row_of_the_whole_batch() -> None:
    envs, twin = (gym.load_vector(*_WALK, 3, num_threads=1, pipelined=True) for _ in range(2))
    for each in (envs, twin):
        each.reset(seed=0)
    single = suite.load(*_WALK, {"random": 0})
    ended = single.snapshot()  # no episode has begun
    single.reset()
    ball = suite.load(*_BALL)
    ball.reset()
    diverged = single.snapshot()
    diverged.physics["state"][0, 3] = np.nan
    batch = suite.load_batch(*_WALK, 3, seed=0)
    batch.reset()
    some_bad = batch.snapshot()
    some_bad.physics["state"][2, 3] = np.nan
    damaged = batch.snapshot()
    damaged.physics.pop("state")
    for state, message in (
        (single.snapshot(), "holds 1 environments; expected 3"),
        ([None, None, ended], "the state of row 2: the snapshot holds no running episode"),
        ([None, None, diverged], "the state of row 2: the state of the snapshot has diverged"),
        ([None, ball.snapshot(), None], "the state of row 1: the snapshot is of"),
        ([batch.snapshot(), None, None], "row 0: the snapshot holds 3 environments; expected 1"),
        (some_bad, r"has diverged in its rows \[2\]"),
        (damaged, "the snapshot holds"),
    ):
        with pytest.raises(ValueError, match=message):
            envs.reset(seed=4, options={"state": state})
    assert_same(envs.step(np.zeros((3, 21))), twin.step(np.zeros((3, 21))))


def test_states_of_rows_that_are_not_reset_are_ignored() -> None:
    envs = gym.load_vector(*_WALK, 3, num_threads=1)
    envs.reset(seed=0)
    mask = np.array([False, True, False])
    states = {"qvel": np.full((3, 27), np.nan)}
    states["qvel"][1] = 0.5
    seen, _ = envs.reset(options={"state": states, "reset_mask": mask})
    np.testing.assert_array_equal(seen["velocity"][1], np.full(27, 0.5))
    envs.reset(options={"state": [5, None, "x"], "reset_mask": mask})


def test_the_callers_arrays_stay_as_they_were_and_are_not_kept() -> None:
    envs = gym.load_vector(*_WALK, 2, num_threads=1)
    states = _states(28, 27, 2)
    kept = {name: values.copy() for name, values in states.items()}
    options = {"state": states}
    envs.reset(seed=0, options=options)
    states["qpos"][:] = 0.0
    envs.step(np.zeros((2, 21)))
    assert list(options) == ["state"]
    np.testing.assert_array_equal(states["qvel"], kept["qvel"])


def test_without_a_state_there_is_nothing_to_set() -> None:
    batches = [suite.load_batch(*_WALK, n, 1) for n in (1, 2)]
    begun = [np.ones(1, bool), np.ones(2, bool)]
    assert states_of_rows(None, batches, begun) == [[], []]
    assert states_of_rows([None] * 3, batches, begun) == [[], []]
    velocities = np.arange(81.0).reshape(3, 27)
    states: Any = states_of_rows({"qvel": velocities}, batches, begun)
    ((_, first),), ((rows, second),) = states
    assert rows.tolist() == [0, 1]
    assert (first["qvel"][0, 0], second["qvel"][1, 0]) == (0.0, 54.0)
