"""`VectorEnv`: rows equal `Env` bit for bit, in each autoreset mode."""

import copy
import gc
import logging
import os
import pickle
import sys
import threading
import time
import traceback
from pathlib import Path
from typing import Any

import dm_env
import gymnasium
import mujoco.batch
import numpy as np
import pytest
from dm_env import specs
from gymnasium import error
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers import vector as wrappers

import limberjack
from limberjack import gym, rl, suite
from limberjack.gym.vector import Workers, joined
from limberjack.rl import control
from limberjack.rl.batch_contract import Batch
from tests.programs import run
from tests.representatives import Task, in_turn

from .gym_episodes import (
    MODES,
    TASKS,
    assert_same,
    bounds,
    falling_env,
    falling_envs,
    told_alike,
)

_NO_OPENGL = os.environ.get("MUJOCO_GL") == "disable"
_WALK = ("humanoid", "walk")
_PACKAGE = Path(limberjack.__file__).parent


def _envs(num_envs: int = 3, task: tuple[str, str] = _WALK, **kwargs: Any) -> gym.VectorEnv:
    return gym.load_vector(*task, num_envs, num_threads=2, **kwargs)


def _assert_lockstep(envs: Any, reference: Any, steps: int, mode: AutoresetMode) -> None:
    """Steps both with the same actions; where rows must be reset by hand it does that."""
    returned, expected = wrappers.DictInfoToList(envs), wrappers.DictInfoToList(reference)

    def compare(one: Any, other: Any, where: str) -> None:
        (*values, infos), (*others, expected_infos) = one, other
        assert_same(values, others, where)
        assert_same(told_alike(infos), expected_infos, where)

    compare(returned.reset(seed=3), expected.reset(seed=3), "reset")
    actions = np.random.RandomState(0)
    low, high = bounds(envs.action_space)
    for step in range(steps):
        action = actions.uniform(low, high) * (step % 3 == 0)
        result = returned.step(action)
        compare(result, expected.step(action), f"step {step}")
        ended = result[2] | result[3]
        if mode is AutoresetMode.DISABLED and ended.any():
            compare(
                returned.reset(options={"reset_mask": ended}),
                expected.reset(options={"reset_mask": ended.copy()}),
                f"reset after step {step}",
            )


# Laws.


@pytest.mark.parametrize("mode", AutoresetMode)
def test_the_mode_is_an_attribute_as_in_gymnasiums_own(mode: AutoresetMode) -> None:
    envs = gym.load_vector("cartpole", "balance", 1, autoreset_mode=mode.value)
    assert envs.autoreset_mode is mode


@pytest.mark.parametrize(("mode", "task"), in_turn(AutoresetMode))
def test_rows_equal_single_environments(mode: AutoresetMode, task: Task) -> None:
    makers = [lambda: gym.load(*task, time_limit=0.1)] * 3
    envs = _envs(3, task, time_limit=0.1, autoreset_mode=mode)
    reference = SyncVectorEnv(makers, autoreset_mode=mode)
    assert envs.observation_space == reference.observation_space
    assert envs.action_space == reference.action_space
    assert envs.single_observation_space == reference.single_observation_space
    assert envs.single_action_space == reference.single_action_space
    assert envs.metadata == reference.metadata
    _assert_lockstep(envs, reference, 33, mode)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize(("num_envs", "flat"), [(1, True), (7, False)])
def test_rows_that_end_at_different_times_equal_single_environments(
    num_envs: int, mode: AutoresetMode, flat: bool
) -> None:
    envs = falling_envs(num_envs, flat=flat, dtype="float32", autoreset_mode=mode)
    makers = [lambda: falling_env(flat=flat, dtype="float32")] * num_envs
    _assert_lockstep(envs, SyncVectorEnv(makers, autoreset_mode=mode), 60, mode)


def test_the_modes_have_the_same_transitions() -> None:
    def transitions(mode: AutoresetMode) -> list[list[Any]]:
        """Of each row: (observation, action, reward, next observation, terminated, truncated)."""
        envs = falling_envs(4, flat=True, autoreset_mode=mode)
        seen: list[list[Any]] = [[] for _ in range(4)]
        observation, _ = envs.reset(seed=0)
        begins = np.zeros(4, bool)
        counts = np.zeros(4, int)
        for _ in range(60):
            # A policy of the row and how far it is, so that all modes are given the same.
            action = np.sin(np.arange(4)[:, None] + counts[:, None] + np.arange(21))
            after, reward, terminated, truncated, info = envs.step(action)
            ended = terminated | truncated
            for row in np.flatnonzero(~begins):
                at_the_end = mode is AutoresetMode.SAME_STEP and ended[row]
                final = info["final_obs"][row] if at_the_end else after[row]
                parts = observation[row], action[row], reward[row], final
                seen[row].append((*parts, terminated[row], truncated[row]))
                counts[row] += 1
            begins = ended & (mode is AutoresetMode.NEXT_STEP)
            if mode is AutoresetMode.DISABLED and ended.any():
                after, _ = envs.reset(options={"reset_mask": ended})
            observation = after
        return seen

    seen = {mode: transitions(mode) for mode in AutoresetMode}
    for row in range(4):
        shortest = min(len(rows[row]) for rows in seen.values())
        assert shortest > 45  # three episodes
        for rows in seen.values():
            assert_same(rows[row][:shortest], seen[AutoresetMode.NEXT_STEP][row][:shortest])


def test_both_kinds_of_ends_occur_in_these_tests() -> None:
    envs = falling_envs(7)
    envs.reset(seed=0)
    flags = [envs.step(np.zeros((7, 21)))[2:4] for _ in range(18)]
    terminated, truncated = (np.array(kind) for kind in zip(*flags, strict=True))
    assert terminated.any()
    assert truncated.any()
    assert not (terminated & truncated).any()


def test_threads_make_no_difference() -> None:
    results = []
    for threads in (1, 2, 4):
        envs = falling_envs(7, num_threads=threads, flat=True)
        envs.reset(seed=0)
        results.append([envs.step(np.full((7, 21), 0.3)) for _ in range(30)])
    assert_same(results[0], results[1])
    assert_same(results[0], results[2])


# Resets.


def test_a_sequence_of_seeds_gives_one_to_each_row_and_with_none_the_stream_continues() -> None:
    envs = _envs(3, flat=True)
    env = gym.load(*_WALK, flat=True)
    observation, _ = envs.reset(seed=[5, None, np.int64(9)])
    assert_same(observation[0], env.reset(seed=5)[0])
    assert_same(observation[2], env.reset(seed=9)[0])
    again, _ = envs.reset(seed=(5, None, None))
    assert_same(again[0], observation[0])
    assert not np.array_equal(again[1], observation[1])
    assert_same(again[2], env.reset()[0])


@pytest.mark.parametrize("mode", MODES)
def test_a_mask_resets_its_rows_and_leaves_the_others_alone(mode: AutoresetMode) -> None:
    envs, twin = _envs(3, autoreset_mode=mode), _envs(3, autoreset_mode=mode)
    single = gym.load(*_WALK)
    for each in (envs, twin):
        each.reset(seed=0)
    before, *_ = envs.step(np.ones((3, 21)))
    twin.step(np.ones((3, 21)))
    returned, _ = envs.reset(seed=20, options={"reset_mask": np.array([False, True, False])})
    begun, _ = single.reset(seed=21)
    for name, values in returned.items():
        assert_same(values[[0, 2]], before[name][[0, 2]])
        assert_same(values[1], begun[name])
    one, other = envs.step(np.ones((3, 21))), twin.step(np.ones((3, 21)))
    for name, values in one[0].items():
        assert_same(values[[0, 2]], other[0][name][[0, 2]])
    assert_same(one[1][1], np.float64(single.step(np.ones(21))[1]))


def test_the_callers_options_and_mask_stay_as_they_were() -> None:
    mask = np.array([True, False, False])
    options = {"reset_mask": mask, "state": None}
    envs = _envs(3, autoreset_mode="SameStep")
    envs.reset(seed=0)
    envs.reset(options=options)
    assert options == {"reset_mask": mask, "state": None}
    assert mask.tolist() == [True, False, False]


@pytest.mark.parametrize(
    ("mask", "kind", "message"),
    [
        ([True, False, False], TypeError, "expected an array of booleans"),
        (np.array([1, 0, 0]), TypeError, "expected an array of booleans"),
        (np.array([True]), ValueError, r"shape \(1,\); expected \(3,\)"),
        (np.zeros(3, bool), ValueError, "selects no row"),
    ],
)
def test_a_bad_mask_is_refused_and_nothing_is_reset(
    mask: Any, kind: type[Exception], message: str
) -> None:
    envs, twin = _envs(3), _envs(3)
    for each in (envs, twin):
        each.reset(seed=0)
    with pytest.raises(kind, match=message):
        envs.reset(seed=1, options={"reset_mask": mask})
    assert_same(envs.reset(), twin.reset())


@pytest.mark.parametrize(
    ("seed", "kind", "message"),
    [
        (-1, ValueError, "seed is -1"),
        (2**32 - 2, ValueError, "last of 3 rows would have seed 4294967296"),
        ([1, 2], ValueError, "there are 2 seeds; expected 3"),
        ([1, 2, 3.5], TypeError, r"seed is 3\.5"),
        (0.5, TypeError, r"seed is 0\.5"),
    ],
)
def test_a_bad_seed_is_refused_and_nothing_is_reset(
    seed: Any, kind: type[Exception], message: str
) -> None:
    envs, twin = _envs(3), _envs(3)
    for each in (envs, twin):
        each.reset(seed=0)
    with pytest.raises(kind, match=message):
        envs.reset(seed=seed)
    assert_same(envs.reset(), twin.reset())


@pytest.mark.parametrize("pipelined", [False, True])
def test_the_first_reset_is_of_all_rows(pipelined: bool) -> None:
    envs = _envs(4, pipelined=pipelined)
    mask = np.array([True, False, True, False])
    with pytest.raises(ValueError, match=r"leaves out rows \[1, 3\], which have begun no episode"):
        envs.reset(seed=0, options={"reset_mask": mask})
    with pytest.raises(error.ResetNeeded):
        envs.step(np.zeros((4, 21)))
    envs.reset(seed=0)
    envs.reset(seed=0, options={"reset_mask": mask})


@pytest.mark.parametrize("half", [1.0, True, 2, "0"])
def test_a_half_is_0_or_1(half: Any) -> None:
    envs = _envs(4, pipelined=True)
    envs.reset(seed=0)
    with pytest.raises(ValueError, match="expected 0 or 1"):
        envs.send(np.zeros((2, 21)), half)


@pytest.mark.parametrize("mode", MODES)
def test_a_step_before_the_first_reset_is_refused(mode: AutoresetMode) -> None:
    with pytest.raises(error.ResetNeeded, match="call reset"):
        _envs(2, autoreset_mode=mode).step(np.zeros((2, 21)))


def test_a_row_that_ended_must_be_reset_where_autoreset_is_disabled() -> None:
    envs = _envs(2, time_limit=0.025, autoreset_mode="Disabled", flat=True)
    envs.reset(seed=0)
    last, *_ = envs.step(np.zeros((2, 21)))
    with pytest.raises(error.ResetNeeded, match=r"rows \[0, 1\].*nothing was stepped"):
        envs.step(np.zeros((2, 21)))
    returned, _ = envs.reset(options={"reset_mask": np.array([True, False])})
    assert_same(returned[1], last[1])
    with pytest.raises(error.ResetNeeded, match=r"rows \[1\]"):
        envs.step(np.zeros((2, 21)))


# Bad input.


@pytest.mark.parametrize(
    ("actions", "kind", "message"),
    [
        (np.zeros((2, 21)), ValueError, r"shape \(2, 21\); expected 3 rows"),
        (np.zeros(21), ValueError, r"shape \(21,\); expected 3 rows"),
        (0.0, ValueError, r"shape \(\); expected 3 rows"),
        (np.full((3, 21), "a"), TypeError, "expected numbers"),
        (np.outer([0, np.nan, np.inf], np.ones(21)), ValueError, r"rows \[0, 1, 2\]|not fin"),
    ],
)
def test_refused_actions_change_nothing(actions: Any, kind: type[Exception], message: str) -> None:
    envs, twin = _envs(3), _envs(3)
    for each in (envs, twin):
        each.reset(seed=0)
    with pytest.raises(kind, match=message):
        envs.step(actions)
    assert_same(envs.step(np.ones((3, 21))), twin.step(np.ones((3, 21))))


def test_actions_that_are_not_finite_are_refused_naming_their_rows() -> None:
    envs = _envs(3)
    envs.reset(seed=0)
    actions = np.zeros((3, 21))
    actions[1, 4], actions[2, 0] = np.nan, np.inf
    with pytest.raises(ValueError, match=r"rows \[1, 2\]; nothing was stepped"):
        envs.step(actions)


@pytest.mark.parametrize(
    ("kwargs", "message"),
    [
        ({"num_envs": 0}, "num_envs is 0"),
        ({"num_envs": -1}, "num_envs is -1"),
        ({"num_threads": -1}, "num_threads is -1"),
        ({"num_threads": 0}, "num_threads is 0"),
        ({"autoreset_mode": "SameSte"}, "Did you mean 'SameStep'"),
        ({"on_divergence": "ignore"}, "expected 'end' or 'raise'"),
        ({"dtype": "int32"}, "expected 'float64' or 'float32'"),
        ({"render_mode": "human"}, "expected None or one of"),
        ({"time_limit": 0}, "time_limit is 0"),
        ({"num_envs": 1, "pipelined": True}, "expected at least 2"),
    ],
)
def test_a_bad_argument_is_refused_by_its_name(kwargs: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        gym.load_vector(*_WALK, **{"num_envs": 2, **kwargs})


def test_a_seed_in_task_kwargs_is_refused() -> None:
    with pytest.raises(TypeError, match="seed"):
        _envs(task_kwargs={"random": 0})


# Observations.


@pytest.mark.parametrize("flat", [False, True])
@pytest.mark.parametrize("mode", MODES)
def test_returned_arrays_never_change(flat: bool, mode: AutoresetMode) -> None:
    envs = _envs(2, flat=flat, time_limit=0.05, autoreset_mode=mode)
    envs.reset(seed=0)
    results = []
    for _ in range(2):
        result = envs.step(np.zeros((2, 21)))
        results.append((result, copy.deepcopy(result)))
    if mode is AutoresetMode.DISABLED:
        envs.reset(options={"reset_mask": np.ones(2, bool)})
    for _ in range(2):
        envs.step(np.ones((2, 21)))
    for result, as_it_was in results:
        for one, other in zip(result[:4], as_it_was[:4], strict=True):
            assert_same(one, other)
        for name in ("final_obs", "reward_terms", "success"):
            if name in result[4] and name != "final_obs":
                assert_same(result[4][name], as_it_was[4][name])
            elif name in result[4]:
                assert_same(list(result[4][name]), list(as_it_was[4][name]))


def test_without_copies_the_flat_array_is_one_and_its_values_are_the_same() -> None:
    reused = _envs(3, flat=True, copy=False, autoreset_mode="SameStep", time_limit=0.05)
    fresh = _envs(3, flat=True, autoreset_mode="SameStep", time_limit=0.05)
    buffer, _ = reused.reset(seed=0)
    assert_same(buffer, fresh.reset(seed=0)[0])
    for _ in range(5):
        one, other = reused.step(np.ones((3, 21))), fresh.step(np.ones((3, 21)))
        assert one[0] is buffer
        assert_same(one[0], other[0])
        if "final_obs" in one[4]:
            assert_same(list(one[4]["final_obs"]), list(other[4]["final_obs"]))


@pytest.mark.parametrize(("domain", "task"), TASKS)
def test_the_layout_gives_the_position_of_each_observation(domain: str, task: str) -> None:
    flat, parts = _envs(2, (domain, task), flat=True), _envs(2, (domain, task))
    array, _ = flat.reset(seed=0)
    observation, _ = parts.reset(seed=0)
    assert flat.layout == parts.layout == gym.load(domain, task).layout
    for name, where, shape in flat.layout:
        assert_same(array[:, where].reshape(2, *shape), observation[name])


# Info.


def test_the_info_has_the_terms_of_the_reward_and_success_of_each_row() -> None:
    envs = _envs(4, ("humanoid", "stand"))
    envs.reset(seed=0)
    _, rewards, _, _, info = envs.step(np.ones((4, 21)))
    terms = info["reward_terms"]
    product = np.prod([terms[name] for name in terms if name[0] != "_"], axis=0)
    np.testing.assert_allclose(product, rewards, rtol=1e-12)  # another order of factors
    assert info["success"].shape == (4,)
    assert info["success"].dtype == bool
    assert not info["diverged"].any()


def test_a_row_whose_episode_begins_has_no_terms() -> None:
    envs = _envs(2, time_limit=0.025)
    envs.reset(seed=0)
    envs.step(np.ones((2, 21)))
    _, rewards, _, _, info = envs.step(np.ones((2, 21)))
    assert rewards.tolist() == [0, 0]
    assert not info["_reward_terms"].any()
    assert not info["_success"].any()


@pytest.mark.parametrize("mode", MODES)
def test_randomised_fields_are_reported_where_an_episode_begins(mode: AutoresetMode) -> None:
    from limberjack.rl.randomize import scale

    randomize = {"body_mass": scale(0.5, 2.0)}
    envs = falling_envs(1, autoreset_mode=mode)  # another task, not randomised
    assert "randomization" not in envs.reset(seed=0)[1]
    envs = _envs(3, randomize=randomize, time_limit=0.05, autoreset_mode=mode)
    makers = [lambda: gym.load(*_WALK, randomize=randomize, time_limit=0.05)] * 3
    _assert_lockstep(envs, SyncVectorEnv(makers, autoreset_mode=mode), 7, mode)


# Divergence.


@pytest.mark.parametrize("mode", MODES)
def test_a_row_that_diverges_terminates_alone(
    mode: AutoresetMode, caplog: pytest.LogCaptureFixture
) -> None:
    envs, twin = (_envs(3, flat=True, autoreset_mode=mode) for _ in range(2))
    for each in (envs, twin):
        each.reset(seed=0)
    envs.batches[0].physics.data.qpos[1, 2] = np.nan
    with caplog.at_level(logging.CRITICAL, "limberjack"):
        observation, rewards, terminated, truncated, info = envs.step(np.zeros((3, 21)))
    expected = twin.step(np.zeros((3, 21)))
    assert terminated.tolist() == info["diverged"].tolist() == [False, True, False]
    assert not truncated.any()
    assert rewards[1] == 0
    assert np.isfinite(observation).all()
    assert_same(observation[[0, 2]], expected[0][[0, 2]])
    assert_same(rewards[[0, 2]], expected[1][[0, 2]])
    assert ("final_obs" in info) == (mode is AutoresetMode.SAME_STEP)


@pytest.mark.parametrize("mode", MODES)
def test_divergence_raises_if_so_configured(mode: AutoresetMode) -> None:
    envs = _envs(3, on_divergence="raise", autoreset_mode=mode)
    envs.reset(seed=0)
    envs.batches[0].physics.data.qpos[1, 2] = np.nan
    with pytest.raises(control.PhysicsError, match=r"rows \[1\]"):
        envs.step(np.zeros((3, 21)))
    envs.reset(seed=0)
    envs.step(np.zeros((3, 21)))


# Wrappers of Gymnasium.


@pytest.mark.parametrize("mode", MODES)
def test_gymnasiums_statistics_are_those_of_single_environments(mode: AutoresetMode) -> None:
    def stream(envs: Any) -> list[Any]:
        recorded = wrappers.RecordEpisodeStatistics(envs)
        recorded.reset(seed=0)
        returned = []
        for _ in range(36):
            _, _, terminated, truncated, info = recorded.step(np.zeros((3, 21)))
            if "episode" in info:
                returned.append((info["episode"]["r"], info["episode"]["l"], info["_episode"]))
            ended = terminated | truncated
            if mode is AutoresetMode.DISABLED and ended.any():
                recorded.reset(options={"reset_mask": ended})
        return returned

    makers = [falling_env] * 3
    expected = SyncVectorEnv(makers, autoreset_mode=mode)
    ours = stream(falling_envs(3, autoreset_mode=mode))
    assert ours
    if mode is not AutoresetMode.DISABLED:  # where SyncVectorEnv hides the mask from the wrapper
        assert_same(ours, stream(expected))


def test_gymnasiums_other_wrappers_run() -> None:
    envs: Any = _envs(2, time_limit=0.1)
    envs = wrappers.NormalizeObservation(wrappers.FlattenObservation(envs))
    envs = wrappers.ClipAction(wrappers.NormalizeReward(envs))
    observation, _ = envs.reset(seed=0)
    for _ in range(9):
        observation, *_ = envs.step(envs.action_space.sample())
    assert observation.shape == (2, 67)


# Pictures, closing, copies, snapshots.


@pytest.mark.skipif(_NO_OPENGL, reason="MUJOCO_GL turns rendering off")
@pytest.mark.parametrize("sizes", [(3,), (2, 1)], ids=["batch", "halves"])
def test_pictures_of_rows_are_those_of_single_environments_and_change_nothing(
    sizes: tuple[int, ...],
) -> None:
    kwargs: Any = {"height": 24, "width": 32, "camera_id": "side"}
    envs = falling_envs(*sizes, render_mode="rgb_array", render_kwargs=kwargs)
    twin = falling_envs(*sizes)
    env = falling_env(render_mode="rgb_array", render_kwargs=kwargs)
    for each in (envs, twin):
        each.reset(seed=4)
        each.step(np.ones((3, 21)))
    pictures = envs.render()
    assert pictures is not None
    for row in range(3):
        env.reset(seed=4 + row)
        env.step(np.ones(21))
        np.testing.assert_array_equal(pictures[row], env.render())
    for _ in range(20):
        assert_same(envs.step(np.zeros((3, 21))), twin.step(np.zeros((3, 21))))


def test_there_are_no_pictures_without_a_render_mode() -> None:
    envs = _envs(2)
    envs.reset(seed=0)
    assert envs.render() is None


@pytest.mark.parametrize("pipelined", [False, True])
def test_closing_twice_is_fine_and_later_use_is_refused(pipelined: bool) -> None:
    envs = _envs(2, pipelined=pipelined)
    envs.reset(seed=0)
    envs.close()
    envs.close()
    uses = (envs.reset, envs.render, envs.recv, lambda: envs.step(np.zeros((2, 21))))
    for use in (*uses, lambda: envs.send(np.zeros((1, 21)), 0)):
        with pytest.raises(error.ClosedEnvironmentError, match="closed"):
            use()


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda envs: pickle.loads(pickle.dumps(envs))])
@pytest.mark.parametrize("pipelined", [False, True])
def test_a_copy_continues_as_the_original_does(copied: Any, pipelined: bool) -> None:
    envs = _envs(3, pipelined=pipelined, time_limit=0.1, flat=True)
    envs.reset(seed=0)
    envs.step(np.ones((3, 21)))
    twin = copied(envs)
    for _ in range(6):
        assert_same(envs.step(np.ones((3, 21))), twin.step(np.ones((3, 21))))


def test_a_batch_continues_from_its_snapshot() -> None:
    envs = falling_envs(3, autoreset_mode="SameStep", flat=True)
    envs.reset(seed=0)
    envs.step(np.ones((3, 21)))
    (batch,) = envs.batches
    snapshot = batch.snapshot()
    once = [envs.step(np.zeros((3, 21))) for _ in range(20)]
    batch.restore(snapshot)
    again = [envs.step(np.zeros((3, 21))) for _ in range(20)]
    for one, other in zip(once, again, strict=True):
        assert_same(one[:4], other[:4])


def test_an_environment_that_was_never_reset_continues_from_a_snapshot() -> None:
    envs, other = (_envs(3, flat=True) for _ in range(2))
    envs.reset(seed=0)
    envs.step(np.ones((3, 21)))
    other.batches[0].restore(envs.batches[0].snapshot())
    assert_same(other.step(np.ones((3, 21))), envs.step(np.ones((3, 21))))


def test_there_are_one_or_two_batches() -> None:
    with pytest.raises(ValueError, match="there are 0 batches; expected one, or two halves"):
        gym.VectorEnv()


def test_halves_are_two_batches_of_the_same_kind() -> None:
    walk = suite.load_batch(*_WALK, 2, 1)
    with pytest.raises(ValueError, match="both halves are the same batch; load another one"):
        gym.VectorEnv(walk, walk)
    with pytest.raises(ValueError, match="differ in their task: humanoid:walk and manip"):
        gym.VectorEnv(walk, suite.load_batch("manipulator", "bring_ball", 2, 1))
    flat = suite.load_batch(*_WALK, 2, 1, environment_kwargs={"flat_observation": True})
    with pytest.raises(ValueError, match=r"halves differ in their observations: .*'observations'"):
        gym.VectorEnv(walk, flat)
    gym.VectorEnv(walk, suite.load_batch(*_WALK, 3, 1)).close()


def test_anything_but_a_batch_is_refused() -> None:
    single: Any = suite.load(*_WALK)
    for given in ([single], [suite.load_batch(*_WALK, 2, 1), single]):
        with pytest.raises(TypeError, match="got Environment; expected a batch, from suite"):
            gym.VectorEnv(*given)


def test_a_batch_of_another_kind_needs_only_the_interface_of_batches() -> None:
    class Plain:
        """The interface of a batch, and nothing else of the one behind it."""

        def __init__(self, batch: Any) -> None:
            self._batch = batch

        def __getattr__(self, name: str) -> Any:
            if name == "_batch" or name not in {**vars(Batch), **Batch.__annotations__}:
                raise AttributeError(name)
            return getattr(self._batch, name)

        def __setattr__(self, name: str, value: Any) -> None:
            if name == "_batch":
                super().__setattr__(name, value)
            else:
                setattr(self._batch, name, value)

    ball = ("manipulator", "bring_ball")
    plain: Any = [Plain(suite.load_batch(*ball, n, 1)) for n in (1, 2)]
    envs, twin = gym.VectorEnv(*plain), _envs(3, ball, pipelined=True)
    twin_halves = gym.VectorEnv(*(suite.load_batch(*ball, n, 1) for n in (1, 2)))
    assert repr(envs).startswith("<VectorEnv manipulator:bring_ball, 3 rows")
    state = {"qvel": np.ones((3, 11))}
    for each in (envs, twin, twin_halves):
        each.reset(seed=0, options={"state": state})
    for action in np.random.RandomState(0).uniform(-1, 1, (5, 3, 5)):
        stepped = envs.step(action)
        assert_same(stepped[0], twin.step(action)[0])
        assert_same(stepped, twin_halves.step(action))
    assert envs.get_attr("dt") == (0.01,) * 3


def test_rows_that_are_environments_make_a_vector_environment_too() -> None:
    for mode in ("NextStep", "SameStep"):
        kwargs: dict[str, Any] = {"autoreset_mode": mode, "time_limit": 0.1, "flat": True}
        rows = gymnasium.make_vec(
            "limberjack/humanoid-walk-v0", 3, vectorised=False, pipelined=True, **kwargs
        )
        twin = _envs(3, **kwargs)
        assert rows.metadata == twin.metadata
        assert "not vectorised" in repr(rows.unwrapped.batches[0])  # pyright: ignore
        assert repr(rows).startswith("<VectorEnv humanoid:walk, 3 rows")
        assert_same(rows.reset(seed=0), twin.reset(seed=0))
        for action in np.random.RandomState(0).uniform(-1, 1, (7, 3, 21)):
            one, other = rows.step(action), twin.step(action)
            assert_same(one[:4], other[:4])
            assert one[4].keys() == other[4].keys()
            assert {"diverged", "reward_terms"} <= one[4].keys()
            for name, value in one[4].items():
                parts = [list(v) if name == "final_obs" else v for v in (value, other[4][name])]
                assert_same(parts[0], parts[1], name)
        rows.close()


def test_environments_that_do_not_report_a_control_step_have_no_frame_rate() -> None:
    class Silent(dm_env.Environment):
        """Has what dm_env asks for, and nothing else."""

        def reset(self) -> dm_env.TimeStep:
            return dm_env.restart({"x": np.zeros(1)})

        def step(self, action: Any) -> dm_env.TimeStep:
            return dm_env.transition(1.0, {"x": np.asarray(action, float)})

        def action_spec(self) -> Any:
            return specs.BoundedArray((1,), float, -1, 1)

        def observation_spec(self) -> Any:
            return {"x": specs.Array((1,), float)}

    batches = [rl.batch_of(lambda seed: Silent(), n, 1) for n in (1, 2)]
    envs = gym.VectorEnv(*batches)
    assert np.isnan(envs.dt)
    assert "render_fps" not in envs.metadata
    envs.reset(seed=0)
    observations, rewards, *_ = envs.step([[0.5], [1.0], [-1.0]])
    assert observations["x"].tolist() == [[0.5], [1.0], [-1.0]]
    assert rewards.tolist() == [1.0] * 3
    with pytest.raises(TypeError, match="a Silent cannot begin in a given state"):
        envs.reset(options={"state": {"qpos": np.zeros((3, 1))}})
    env = gym.Env(Silent())
    assert np.isnan(env.dt)
    assert "render_fps" not in env.metadata
    assert env.reset()[0] == {"x": [0.0]}
    assert env.step([0.5])[1] == 1.0
    with pytest.raises(TypeError, match=r"contains no control\.Environment, .* pass a function"):
        env.reset(seed=0)


def test_an_environment_that_could_not_be_made_leaves_its_batch_open() -> None:
    batch = suite.load_batch(*_WALK, 2, 1)
    with pytest.raises(ValueError, match="dtype"):
        gym.VectorEnv(batch, dtype="int8")
    gc.collect()
    batch.reset()


def test_make_vec_and_gymnasiums_own_vector_environments_agree() -> None:
    name = "limberjack/stacker-stack_4-v0"
    ours = gymnasium.make_vec(name, num_envs=2, num_threads=1)
    theirs = gymnasium.make_vec(name, num_envs=2, vectorization_mode="sync")
    assert_same(ours.reset(seed=0)[0], theirs.reset(seed=0)[0])
    for envs in (ours, theirs):
        envs.close()


def test_a_misspelt_argument_is_answered_with_the_right_one() -> None:
    # Programs such as TorchRL look for these words to leave out an argument that is not known.
    words = r"got an unexpected keyword argument 'time_limt'\. Did you mean 'time_limit'\?"
    with pytest.raises(TypeError, match=words):
        gym.load_vector("humanoid", "walk", 2, time_limt=1)


_MOST_FRAMES = 7  # of ours, from a step of a vector environment to MuJoCo's


@pytest.mark.parametrize(
    "how", [{}, {"pipelined": True}, {"action_repeat": 2}, {"autoreset_mode": "Disabled"}], ids=str
)
def test_a_step_passes_few_functions_before_it_reaches_mujoco(
    how: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    envs = _envs(4, **how)
    envs.reset(seed=0)
    official, frames = mujoco.batch.Batch.step, []

    def step(*args: Any, **kwargs: Any) -> Any:
        stack = traceback.extract_stack(sys._getframe(1))
        names = [frame.name for frame in stack if Path(frame.filename).is_relative_to(_PACKAGE)]
        frames.append(names)
        return official(*args, **kwargs)

    monkeypatch.setattr(mujoco.batch.Batch, "step", step)
    envs.step(np.zeros((4, 21)))
    assert len(frames) == (2 if how.keys() & {"pipelined", "action_repeat"} else 1)
    for names in frames:
        assert 1 < len(names) <= _MOST_FRAMES, names


def _pair(**kwargs: Any) -> tuple[gym.VectorEnv, gym.VectorEnv]:
    """The same rows in one batch and in two halves, begun."""
    pair = falling_envs(5, flat=True, **kwargs), falling_envs(3, 2, flat=True, **kwargs)
    for envs in pair:
        envs.reset(seed=0)
    return pair


def _actions(envs: gym.VectorEnv, step: int) -> np.ndarray:
    return np.sin(step + np.arange(envs.num_envs)[:, None] + np.arange(21))


def _pipelined(envs: gym.VectorEnv, steps: int) -> list[list[Any]]:
    """The results of both halves, in the plain order."""
    returned: list[list[Any]] = [[] for _ in range(steps)]
    for half, rows in enumerate(envs.halves):
        envs.send(_actions(envs, 0)[rows], half)
    for step in range(steps):
        for half, rows in enumerate(envs.halves):
            result = envs.recv()
            assert result[4].pop("env_id").tolist() == list(range(5))[rows]
            returned[step].append(result)
            if step + 1 < steps:
                envs.send(_actions(envs, step + 1)[rows], half)
    return returned


@pytest.mark.parametrize("copied", [True, False])
@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_halves_sent_in_turn_give_the_numbers_of_the_plain_order(
    mode: AutoresetMode, copied: bool
) -> None:
    plain, halves = _pair(autoreset_mode=mode)
    for step, parts in enumerate(_pipelined(halves, 40)):
        observation, reward, terminated, truncated, info = plain.step(_actions(plain, step))
        for rows, part in zip(halves.halves, parts, strict=True):
            assert_same(part[:4], (observation[rows], reward[rows], terminated[rows],
                                   truncated[rows]))  # fmt: skip
            for name, term in part[4]["reward_terms"].items():
                assert_same(term, info["reward_terms"][name][rows])
            if "final_obs" in part[4]:
                assert_same(list(part[4]["final_obs"]), list(info["final_obs"][rows]))
    halves.close()


@pytest.mark.parametrize("mode", MODES)
def test_a_plain_step_of_halves_is_that_of_one_batch(mode: AutoresetMode) -> None:
    plain, halves = _pair(autoreset_mode=mode)
    for step in range(40):
        one, other = (envs.step(_actions(envs, step)) for envs in (plain, halves))
        for name in {*one[4], *other[4]} & {"final_obs"}:
            assert_same(list(one[4].pop(name)), list(other[4].pop(name)))
        assert_same(one, other)
        ended = one[2] | one[3]
        if mode is AutoresetMode.DISABLED and ended.any():
            options = {"reset_mask": ended}
            assert_same(plain.reset(options=options), halves.reset(options=options))


def test_a_mask_of_one_half_leaves_the_other_alone() -> None:
    plain, halves = _pair()
    mask = np.array([False, False, False, True, True])
    for seed in (None, 7):
        options = {"reset_mask": mask}
        one = plain.reset(seed=seed, options=options)
        assert_same(one, halves.reset(seed=seed, options=options))


def test_an_odd_number_of_rows_has_the_larger_half_first() -> None:
    envs = gym.load_vector("humanoid", "walk", 5, num_threads=1, pipelined=True)
    assert envs.halves == (slice(0, 3), slice(3, 5))
    assert [batch.num_envs for batch in envs.batches] == [3, 2]


def test_the_caller_continues_while_a_half_is_stepped() -> None:
    _, envs = _pair()
    part, entered, leave = envs._parts[0], threading.Event(), threading.Event()
    step = part.step

    def slow_step(actions: Any) -> Any:
        entered.set()
        assert leave.wait(60)
        return step(actions)

    part.step = slow_step  # pyright: ignore[reportAttributeAccessIssue]
    envs.send(np.zeros((3, 21)), 0)
    assert entered.wait(60)
    envs.send(np.zeros((2, 21)), 1)  # returns although half 0 is under way
    leave.set()
    assert [envs.recv()[4]["env_id"].size for _ in range(2)] == [3, 2]
    envs.close()


def test_the_actions_are_copied_when_they_are_sent() -> None:
    plain, halves = _pair()
    actions = np.ones((5, 21))
    expected = plain.step(actions)
    given = actions[:3].copy()
    halves.send(given, 0)
    given[...] = np.nan
    assert_same(halves.recv()[1], expected[1][:3])
    halves.close()


# Refused input.


def test_errors_of_a_half_number_rows_within_the_whole_batch() -> None:
    _, halves = _pair()
    second = halves.batches[1]
    with pytest.raises(ValueError, match=r"not finite in rows \[4\]"):
        second.step([np.zeros(21), np.full(21, np.nan)])
    second.physics.data.qvel[0] = 1e12
    second._raises = True
    halves.send(np.zeros((2, 21)), 1)
    with pytest.raises(control.PhysicsError, match=r"rows \[3\] diverged"):
        halves.recv()
    halves.close()


def test_a_restored_or_given_state_and_the_log_number_rows_within_the_whole_batch(
    caplog: pytest.LogCaptureFixture,
) -> None:
    _, halves = _pair()
    second = halves.batches[1]
    snapshot = second.snapshot()
    snapshot.physics["state"][1, 3] = np.nan
    with caplog.at_level(logging.WARNING, "limberjack"):
        second.restore(snapshot)
        second.step(np.zeros((2, 21)))
    assert "rows [4] diverged" in caplog.text
    with pytest.raises(RuntimeError, match=r"just begun in rows \[3, 4\]: call reset"):
        second.set_states({"qvel": np.zeros((2, 27))})
    halves.reset()
    with pytest.raises(ValueError, match=r"'qvel' of the state is invalid in rows \[3, 4\]"):
        second.set_states({"qvel": np.full((2, 27), np.nan)})
    states = {"qvel": np.zeros((5, 27))}
    states["qvel"][3] = np.inf
    with pytest.raises(ValueError, match=r"'qvel' of the state is invalid in rows \[3\]"):
        halves.reset(options={"state": states})
    second._raises = True
    second.restore(snapshot)
    with pytest.raises(control.PhysicsError, match=r"rows \[4\] diverged"):
        second.step(np.zeros((2, 21)))
    halves.close()


def test_bad_actions_are_refused_when_they_are_sent_and_nothing_is_stepped() -> None:
    plain, halves = _pair()
    bad = np.zeros((3, 21))
    bad[1] = np.nan
    refused = (
        (bad, 0, r"not finite in rows \[1\]"),
        (bad[:2], 1, r"not finite in rows \[4\]"),  # of the whole batch
        (np.zeros((5, 21)), 0, "expected 3 rows"),
        (np.zeros((3, 20)), 0, r"shape \(3, 20\); expected \(3, 21\)"),
    )
    for actions, half, message in refused:
        with pytest.raises(ValueError, match=message):
            halves.send(actions, half)
    whole = np.zeros((5, 21))
    whole[4] = np.inf
    with pytest.raises(ValueError, match=r"not finite in rows \[4\]"):
        halves.step(whole)  # the first half must not have moved
    with pytest.raises(ValueError, match=r"shape \(4, 21\); expected \(5, 21\)"):
        halves.step(np.zeros((4, 21)))
    assert_same(plain.step(np.ones((5, 21)))[:4], halves.step(np.ones((5, 21)))[:4])


def test_use_out_of_turn_is_refused() -> None:
    plain, envs = _pair()
    with pytest.raises(RuntimeError, match="nothing was sent"):
        envs.recv()
    with pytest.raises(ValueError, match="half is 2; expected 0 or 1"):
        envs.send(np.zeros((3, 21)), 2)
    with pytest.raises(RuntimeError, match="pipelined=True"):
        plain.send(np.zeros((5, 21)), 0)
    envs.send(np.zeros((3, 21)), 0)
    uses = (envs.reset, envs.render, lambda: envs.step(np.zeros((5, 21))))
    for use in (*uses, lambda: envs.send(np.zeros((3, 21)), 0), lambda: pickle.dumps(envs)):
        with pytest.raises(RuntimeError, match=r"sent.*recv\(\)"):
            use()
    envs.recv()
    envs.reset(seed=0)
    envs.close()


def test_sending_before_the_first_reset_is_refused() -> None:
    with pytest.raises(error.ResetNeeded):
        falling_envs(2, 2).send(np.zeros((2, 21)), 0)


def test_divergence_is_raised_where_it_is_received() -> None:
    envs = gym.load_vector(
        "humanoid", "walk", 4, num_threads=1, pipelined=True, on_divergence="raise"
    )
    envs.reset(seed=0)
    envs.batches[1].physics.data.qpos[0, 2] = np.nan
    for half in (0, 1):
        envs.send(np.zeros((2, 21)), half)
    envs.recv()
    with pytest.raises(control.PhysicsError, match=r"rows \[2\]"):
        envs.recv()
    with pytest.raises(RuntimeError, match="nothing was sent"):
        envs.recv()
    envs.reset()
    envs.close()


def test_a_plain_step_names_the_rows_of_both_halves_and_leaves_neither_behind() -> None:
    envs = gym.load_vector("humanoid", "walk", 4, pipelined=True, on_divergence="raise")
    envs.reset(seed=0)
    actions = np.zeros((4, 21))
    actions[3, 0] = np.nan
    with pytest.raises(ValueError, match=r"rows \[3\]"):
        envs.step(actions)
    envs.batches[1].physics.data.qpos[0, 2] = np.nan
    with pytest.raises(control.PhysicsError, match=r"rows \[2\]"):
        envs.step(np.zeros((4, 21)))
    assert all(batch.begins.all() for batch in envs.batches)
    envs.close()


# Threads.


def _threads_of_halves() -> int:
    return sum(thread.name.startswith("limberjack-half") for thread in threading.enumerate())


def test_closing_waits_for_running_steps_and_ends_the_threads() -> None:
    _, envs = _pair()
    for half, rows in enumerate(envs.halves):
        envs.send(np.zeros((5, 21))[rows], half)
    assert _threads_of_halves() == 2
    envs.close()
    assert _threads_of_halves() == 0


def test_the_threads_of_an_environment_that_is_dropped_end() -> None:
    _, envs = _pair()
    envs.send(np.zeros((3, 21)), 0)
    envs.recv()
    del envs
    for _ in range(600):
        if not _threads_of_halves():
            break
        time.sleep(0.1)
    assert _threads_of_halves() == 0


_BEGIN = """
    import os
    import signal
    import sys
    import threading
    import time
    import numpy as np
    from limberjack import gym

    envs = gym.load_vector("stacker", "stack_4", 64, num_threads=2, pipelined=True)
    envs.reset(seed=0)

    def send_both():
        for half in (0, 1):
            envs.send(np.ones((32, 5)), half)
    """


def test_exit_in_the_middle_of_a_step_is_silent() -> None:
    for end in ("", "sys.exit()"):
        assert run(f"{_BEGIN}\n    send_both()\n    {end}\n") == ""


def test_an_interrupt_while_receiving_loses_nothing() -> None:
    program = f"""{_BEGIN}
    def interrupt():
        time.sleep(0.5)
        os.kill(os.getpid(), signal.SIGINT)

    step = envs._parts[0].step
    def slow_step(actions):
        time.sleep(2)
        return step(actions)
    envs._parts[0].step = slow_step
    send_both()
    threading.Thread(target=interrupt).start()
    try:
        envs.recv()
    except KeyboardInterrupt:
        print("interrupted")
    first, second = (envs.recv() for _ in range(2))
    twin = gym.load_vector("stacker", "stack_4", 64, num_threads=2)
    twin.reset(seed=0)
    reward = twin.step(np.ones((64, 5)))[1]
    assert np.array_equal(reward, np.concatenate([first[1], second[1]]))
    envs.close()
    print("whole")
    """
    assert run(program) == "interrupted\nwhole\n"


def test_a_forked_child_has_threads_of_its_own() -> None:
    program = f"""{_BEGIN}
    send_both()
    envs.recv(), envs.recv()
    sys.stdout.flush()
    child = os.fork()
    send_both()
    total = sum(float(envs.recv()[1].sum()) for _ in range(2))
    envs.close()
    if child == 0:
        print(total, flush=True)
        sys.exit()
    assert os.waitpid(child, 0)[1] == 0
    print(total)
    """
    # Newer Pythons warn of any fork of a process with threads.
    one, other = run(program, warnings="ignore").split()
    assert one == other


def test_parts_are_joined_by_name_and_a_missing_one_counts_as_zeros() -> None:
    first, second = np.array([1.0, 2.0]), np.array([[3, 4]], np.uint8)
    both = joined([{"a": first}, {"a": np.array([5.0]), "b": second}], [2, 1])
    assert both["a"].tolist() == [1.0, 2.0, 5.0]
    assert both["b"].tolist() == [[0, 0], [0, 0], [3, 4]]
    assert both["b"].dtype == np.uint8
    assert joined([None, {"b": second}], [2, 1])["b"].shape == (3, 2)


def test_a_missing_part_of_objects_counts_as_none() -> None:
    given = np.array([{"x": 1}], object)
    assert joined([None, given], [2, 1]).tolist() == [None, None, {"x": 1}]


def test_the_half_that_was_sent_first_is_received_first() -> None:
    workers = Workers(2)
    go_on = threading.Event()

    def first() -> str:
        go_on.wait(60)
        return "first"

    workers.send(1, first)
    workers.send(0, lambda: "second")
    assert workers.busy == [1, 0]
    go_on.set()
    assert [workers.receive(), workers.receive()] == [(1, "first"), (0, "second")]
    with pytest.raises(RuntimeError, match="nothing was sent"):
        workers.receive()
    workers.close()
