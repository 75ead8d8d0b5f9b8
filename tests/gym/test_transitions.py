"""A batch in Gymnasium's terms: ends, final observations and info, mode by mode."""

import warnings
from typing import Any

import numpy as np
import pytest
from gymnasium import error
from gymnasium.vector import AutoresetMode

from limberjack import gym, suite
from limberjack.rl.batch import BatchEnvironment
from limberjack.rl.batches import batch_of
from limberjack.rl.many import ManyTasks
from limberjack.rl.randomize import shift
from limberjack.rl.rows import RowsEnvironment
from limberjack.suite import humanoid

from .gym_episodes import MODES, assert_same, falling, falling_env, falling_envs

_ROWS, _STEPS = 5, 16  # steps to the time limit; rows fall after 13 to 18


def _end_of_an_episode(mode: AutoresetMode, **kwargs: Any) -> tuple[gym.VectorEnv, tuple]:
    """An environment without torques and its first step in which some row's episode ends."""
    envs = falling_envs(_ROWS, autoreset_mode=mode, **kwargs)
    envs.reset(seed=0)
    for _ in range(_STEPS):
        returned = envs.step(np.zeros((_ROWS, 21)))
        if (returned[2] | returned[3]).any():
            return envs, returned
    raise AssertionError("no episode has ended")


@pytest.mark.parametrize("mode", MODES)
def test_an_episode_is_terminated_or_truncated_and_never_both(mode: AutoresetMode) -> None:
    envs = falling_envs(_ROWS, autoreset_mode=mode)
    envs.reset(seed=0)
    terminations = truncations = 0
    for _ in range(_STEPS):
        _, _, terminated, truncated, _ = envs.step(np.zeros((_ROWS, 21)))
        assert not (terminated & truncated).any()
        terminations += int(terminated.sum())
        truncations += int(truncated.sum())
        ended = terminated | truncated
        if mode is AutoresetMode.DISABLED and ended.any():
            envs.reset(options={"reset_mask": ended})
    assert terminations
    assert truncations


def test_in_same_step_mode_the_info_has_the_old_episode_and_the_observation_the_new_one() -> None:
    envs, (observation, _, terminated, truncated, info) = _end_of_an_episode(
        AutoresetMode.SAME_STEP
    )
    ended = terminated | truncated
    np.testing.assert_array_equal(info["_final_obs"], ended)
    np.testing.assert_array_equal(info["_final_info"], ended)
    terms, final = info["reward_terms"], info["final_info"]["reward_terms"]
    for row in range(_ROWS):
        single = falling_env()
        single.reset(seed=row)
        assert (info["final_obs"][row] is not None) == ended[row]
        # The other rows' terms are in the info itself, those of rows that ended in the final one.
        assert bool(terms["_upright"][row]) is not bool(ended[row])
        assert bool(final["_upright"][row]) is bool(ended[row])
        if ended[row]:
            assert terms["upright"][row] == 0.0
            assert final["upright"][row] > 0.0
            head = info["final_obs"][row]["head_height"]
            assert head != observation["head_height"][row]
            assert terminated[row] == (head < 0.8)
    envs.close()


def test_a_row_whose_episode_begins_has_no_terms_in_the_next_step() -> None:
    envs, (_, _, terminated, truncated, info) = _end_of_an_episode(AutoresetMode.NEXT_STEP)
    ended = terminated | truncated
    assert info["_reward_terms"].all()
    assert info["_diverged"].all()
    assert not info["diverged"].any()  # they fell, or ran out of time
    _, reward, _, _, info = envs.step(np.zeros((_ROWS, 21)))
    np.testing.assert_array_equal(info["_reward_terms"], ~ended)
    assert (reward[ended] == 0.0).all()
    assert (info["reward_terms"]["upright"][ended] == 0.0).all()
    assert (info["reward_terms"]["upright"][~ended] > 0.0).all()
    envs.close()


def test_rows_that_wait_for_a_reset_are_named_by_their_number_in_the_whole_batch() -> None:
    envs = falling_envs(2, 3, autoreset_mode=AutoresetMode.DISABLED)
    envs.reset(seed=0)
    waiting: list[int] = []
    while not any(row >= 2 for row in waiting):
        _, _, terminated, truncated, _ = envs.step(np.zeros((5, 21)))
        ended = terminated | truncated
        waiting = np.flatnonzero(ended).tolist()
        first_half = ended & (np.arange(5) < 2)
        if first_half.any():
            envs.reset(options={"reset_mask": first_half})
            waiting = [row for row in waiting if row >= 2]
        if waiting:
            break
    with pytest.raises(error.ResetNeeded, match=rf"rows \[{', '.join(map(str, waiting))}\]"):
        envs.step(np.zeros((5, 21)))
    envs.close()


def test_a_mask_gives_each_row_its_own_seed() -> None:
    envs = falling_envs(3)
    envs.reset(seed=0)
    mask = np.array([False, True, True])
    observation, _ = envs.reset(seed=[90, 91, 92], options={"reset_mask": mask})
    for row in (1, 2):
        alone, _ = falling_env().reset(seed=90 + row)
        np.testing.assert_array_equal(observation["joint_angles"][row], alone["joint_angles"])
    envs.close()


def test_drawn_fields_are_reported_where_episodes_begin_and_do_not_change_later() -> None:
    physics = humanoid.Physics.from_shared_xml(*humanoid.get_model_and_assets())
    task = humanoid.Humanoid(move_speed=0, pure_state=False, random=0)
    from limberjack.rl import control

    single = control.Environment(
        physics,
        task,
        time_limit=2 * 0.025,
        control_timestep=0.025,
        randomize={"body_mass": shift(0, 1)},
    )
    envs = gym.VectorEnv(BatchEnvironment.from_environment(single, 2, 1))
    _, info = envs.reset(seed=0)
    drawn = info["randomization"]["body_mass"]
    kept = drawn.copy()
    assert info["_randomization"].all()
    for begun in (False, False, True):  # an episode of two steps, then the next one begins
        *_, info = envs.step(np.zeros((2, 21)))
        assert ("randomization" in info) == begun
    np.testing.assert_array_equal(drawn, kept)
    assert not np.array_equal(info["randomization"]["body_mass"], kept)
    envs.close()


def test_a_row_that_diverges_has_no_terms_and_is_flagged_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    envs = falling_envs(3)
    envs.reset(seed=0)
    batch = envs.batches[0]
    replicas = batch._replicas
    plain = replicas.step

    def diverging(rows: Any, nstep: int) -> np.ndarray:
        plain(rows, nstep)
        return np.array([False, True, False])

    with monkeypatch.context() as patched:
        patched.setattr(replicas, "step", diverging)
        _, reward, terminated, truncated, info = envs.step(np.zeros((3, 21)))
    assert info["diverged"].tolist() == [False, True, False]
    assert terminated.tolist() == [False, True, False]
    assert not truncated.any()
    assert reward[1] == 0.0
    assert info["_reward_terms"].tolist() == [True, False, True]
    assert info["reward_terms"]["upright"][1] == 0.0
    envs.close()


@pytest.mark.parametrize("vectorised", [True, False])
@pytest.mark.parametrize("mode", MODES)
def test_repeated_actions_are_those_of_env_in_every_mode(
    mode: AutoresetMode, vectorised: bool
) -> None:
    rows, repeat = 4, 3
    batch = batch_of(falling(), rows, 1, seed=0, vectorised=vectorised, action_repeat=repeat)
    envs = gym.VectorEnv(batch, autoreset_mode=mode)
    singles = [falling_env() for _ in range(rows)]
    observations, _ = envs.reset(seed=0)
    for row, single in enumerate(singles):
        single.environment.action_repeat = repeat
        single.reset(seed=row)
    assert envs.dt == singles[0].dt == repeat * 0.025
    assert envs.metadata["render_fps"] == round(40 / repeat)
    begun, ends = np.zeros(rows, bool), 0
    actions = np.random.RandomState(0).uniform(-1, 1, (14, rows, 21))
    for action in actions:
        observations, rewards, terminated, truncated, info = envs.step(action)
        for row, single in enumerate(singles):
            of_row = {name: values[row] for name, values in observations.items()}
            if begun[row]:
                assert_same(of_row, single.reset()[0])
                assert (rewards[row], terminated[row], truncated[row]) == (0.0, False, False)
                continue
            seen, reward, ended, late, of_env = single.step(action[row])
            assert (rewards[row], terminated[row], truncated[row]) == (reward, ended, late)
            done = ended or late
            ends += done
            shown = info["final_info"] if done and mode is AutoresetMode.SAME_STEP else info
            for name, value in of_env["reward_terms"].items():
                assert shown["reward_terms"][name][row] == value
            assert shown["success"][row] == of_env["success"]
            if done and mode is AutoresetMode.SAME_STEP:
                assert_same(info["final_obs"][row], seen)
                seen = single.reset()[0]
            assert_same(of_row, seen)
        done = terminated | truncated
        begun = done if mode is AutoresetMode.NEXT_STEP else np.zeros(rows, bool)
        if mode is AutoresetMode.DISABLED and done.any():
            observations, _ = envs.reset(options={"reset_mask": done})
            for row in np.flatnonzero(done):
                of_row = {name: values[row] for name, values in observations.items()}
                assert_same(of_row, singles[row].reset()[0])
    assert ends >= rows
    envs.close()


@pytest.mark.parametrize("kind", ["vectorised", "rows", "many"])
def test_in_same_step_mode_too_the_info_says_which_rows_diverged(kind: str) -> None:
    how: dict[str, Any] = {"autoreset_mode": AutoresetMode.SAME_STEP}
    if kind == "many":
        envs = gym.load_vector(["pendulum:swingup", "cartpole:balance"], rows=1, **how)
    else:
        batch = batch_of(
            suite.load("pendulum", "swingup"), 2, 1, seed=0, vectorised=kind == "vectorised"
        )
        envs = gym.VectorEnv(batch, **how)
    envs.reset(seed=0)
    first: Any = envs.batches[0]
    if isinstance(first, ManyTasks):
        first = first.parts[0]
    if isinstance(first, RowsEnvironment):
        of_row: Any = first.environments[0]
        of_row.physics.data.qvel[:] = 1e12
    else:
        first.physics.data.qvel[0] = 1e12
    with warnings.catch_warnings(action="ignore"):  # MuJoCo's
        *_, terminated, _, info = envs.step(np.zeros((2, 1)))
    assert info["diverged"].tolist() == terminated.tolist() == [True, False]
    envs.close()


def test_values_drawn_for_some_tasks_are_masked_in_the_rows_of_others() -> None:
    envs = gym.load_vector(["cartpole:swingup", "walker:walk"], rows=1, faults="easy")
    _, info = envs.reset(seed=0)
    drawn = info["randomization"]
    names = [name for name in drawn if not name.startswith("_")]
    assert names
    for name in names:
        has = [value is not None for value in drawn[name]]
        assert drawn[f"_{name}"].tolist() == has
        assert sum(has) == 1
    envs.close()
