"""States that a caller gives: rows equal single environments, and refused states change nothing."""

from typing import Any

import numpy as np
import pytest

from limberjack import suite
from limberjack.rl import control
from limberjack.rl.batch import BatchEnvironment
from limberjack.rl.given_state import (
    check_snapshot,
    checked_state,
    checked_states,
    state_sizes,
)
from tests.representatives import REPRESENTATIVES

_WALK = ("humanoid", "walk")
_SIZES = {"qpos": 3, "qvel": 2}


def _singles(task: tuple[str, str], count: int = 3) -> list[control.Environment]:
    return [suite.load(*task, {"random": seed}) for seed in range(count)]


def _states(physics: Any, count: int) -> dict[str, np.ndarray]:
    """Positions near the model's own, velocities and activations."""
    stream, sizes = np.random.RandomState(1), state_sizes(physics)
    states = {name: stream.uniform(-0.5, 0.5, (count, size)) for name, size in sizes.items()}
    return {**states, "qpos": states["qpos"] + physics.model.qpos0}


def _assert_rows(time_step: Any, expected: list[Any]) -> None:
    for row, single in enumerate(expected):
        assert time_step.step_type[row] == single.step_type
        assert time_step.reward[row] == (single.reward or 0.0)
        for name, values in single.observation.items():
            np.testing.assert_array_equal(time_step.observation[name][row], values, name)


def _step(batch: BatchEnvironment, singles: list[control.Environment], steps: int) -> None:
    actions = np.random.RandomState(2).uniform(-1, 1, (steps, *batch.action_spec().shape))
    for action in actions:
        expected = [single.step(action[row]) for row, single in enumerate(singles)]
        _assert_rows(batch.step(action), expected)


# Laws.


@pytest.mark.parametrize("task", REPRESENTATIVES)
def test_rows_with_given_states_equal_single_environments(task: tuple[str, str]) -> None:
    batch, singles = suite.load_batch(*task, 3, seed=0), _singles(task)
    states = _states(singles[0].physics, 3)
    batch.reset()
    time_step = batch.set_states(states)
    expected = []
    for row, single in enumerate(singles):
        single.reset()
        expected.append(single.set_state({name: values[row] for name, values in states.items()}))
    assert (time_step.step_type == 0).all()
    _assert_rows(time_step, expected)
    np.testing.assert_array_equal(batch.physics.data.qpos, states["qpos"])
    _step(batch, singles, 20)


@pytest.mark.parametrize("task", REPRESENTATIVES)
def test_setting_a_state_is_writing_it_and_recomputing(task: tuple[str, str]) -> None:
    one, other = _singles(task, 1)[0], _singles(task, 1)[0]
    state = {name: values[0] for name, values in _states(one.physics, 1).items()}
    one.reset()
    given = one.set_state(state)
    other.reset()
    for name, values in state.items():
        getattr(other.physics.data, name)[:] = values
    other.physics.after_reset()
    assert given.first()
    assert given.reward is None
    expected = other.task.get_observation(other.physics)
    for name, values in expected.items():
        np.testing.assert_array_equal(given.observation[name], values)
    action = np.zeros(one.action_spec().shape)
    for _ in range(10):
        seen, known = one.step(action), other.step(action)
        assert seen.reward == known.reward
        for name, values in known.observation.items():
            np.testing.assert_array_equal(seen.observation[name], values)


def test_some_rows_and_some_fields_leave_the_others_alone() -> None:
    batch, singles = suite.load_batch(*_WALK, 3, seed=0), _singles(_WALK)
    velocities = _states(singles[0].physics, 3)["qvel"]
    batch.reset()
    for single in singles:
        single.reset()
    expected = [singles[0].set_state({"qvel": velocities[0]})]
    expected += [singles[1].set_state({"qpos": singles[1].physics.data.qpos.copy()})]
    expected += [singles[2].set_state({"qvel": velocities[2]})]
    batch.set_states({"qpos": batch.physics.data.qpos[[1]]}, [1])
    time_step = batch.set_states({"qvel": velocities[[0, 2]]}, np.array([True, False, True]))
    _assert_rows(time_step, expected)
    _step(batch, singles, 10)


def test_a_snapshot_is_restored_with_its_step_count() -> None:
    batch, single = suite.load_batch(*_WALK, 2, seed=5), _singles(_WALK, 1)[0]
    single.reset()
    last = [single.step(np.zeros(21)) for _ in range(3)][-1]
    snapshot = single.snapshot()
    batch.reset()
    time_step = batch.set_states(snapshot, [1])
    assert time_step.step_type.tolist() == [0, 1]
    other = _singles(_WALK, 1)[0]
    other.reset()
    again = other.set_state(snapshot)
    assert again.mid()
    assert again.reward == 0.0
    for name, values in last.observation.items():
        np.testing.assert_array_equal(again.observation[name], values)
        np.testing.assert_array_equal(time_step.observation[name][1], values)
    expected = single.step(np.ones(21))
    assert other.step(np.ones(21)).reward == expected.reward
    assert batch.step(np.ones((2, 21))).reward[1] == expected.reward
    assert batch._counter.steps.tolist() == [1, 4]


def test_a_given_state_leaves_the_random_stream_alone() -> None:
    one, other = _singles(_WALK, 2)
    other.reseed(0)
    one.reset()
    other.reset()
    one.set_state({"qvel": np.ones(27)})
    for name, values in one.reset().observation.items():
        if name == "velocity":
            np.testing.assert_array_equal(other.reset().observation[name], values)


# Refused.


@pytest.mark.parametrize(
    ("state", "kind", "message"),
    [
        ([1.0], TypeError, r"the state is \[1.0\]; expected a mapping such as"),
        ({}, ValueError, "the state is empty; expected some of: qpos, qvel; nothing was reset"),
        ({"qps": 0}, TypeError, "no field 'qps'. Did you mean 'qpos'.*There are: qpos, qvel"),
        ({"act": []}, TypeError, "no field 'act'"),
        ({3: []}, TypeError, "no field 3"),
        ({"qpos": [1.0, 2.0]}, ValueError, r"'qpos' of the state has shape \(2,\); expected \(3,"),
        ({"qpos": 1.0}, ValueError, r"has shape \(\); expected \(3,\)"),
        ({"qpos": [1, [2], 3]}, ValueError, r"expected an array of shape \(3,\)"),
        ({"qpos": ["a", "b", "c"]}, TypeError, "has dtype <U1; expected numbers"),
        ({"qpos": [None] * 3}, TypeError, "has dtype object; expected numbers"),
        ({"qpos": [True] * 3}, TypeError, "has dtype bool; expected numbers"),
        ({"qpos": [1j] * 3}, TypeError, "has dtype complex128; expected numbers"),
        ({"qpos": [0, np.nan, 0]}, ValueError, "'qpos' of the state is nan at index 1; expected f"),
        ({"qvel": [0, -np.inf]}, ValueError, "is -inf at index 1"),
        ({"qvel": [0, 2e10]}, ValueError, "is 20000000000.0 at index 1; .* from -1e\\+10 to 1e"),
        ({"qvel": np.array([0, "1e400"], np.longdouble)}, ValueError, "is inf at index 1"),
    ],
)
def test_an_invalid_state_is_refused(state: Any, kind: Any, message: str) -> None:
    with pytest.raises(kind, match=message):
        checked_state(state, _SIZES)


def test_checked_arrays_are_copies() -> None:
    given = np.zeros((2, 3))
    one, several = (
        checked_state({"qpos": given[0]}, _SIZES),
        checked_states({"qpos": given}, _SIZES, 2),
    )
    given[:] = 1
    assert not one["qpos"].any()
    assert not several["qpos"].any()


def test_only_rows_that_are_taken_are_checked_and_messages_name_them() -> None:
    given = np.zeros((4, 3))
    given[[1, 2]] = np.nan
    taken = checked_states({"qpos": given}, _SIZES, 4, np.array([0, 3]))
    assert taken["qpos"].shape == (2, 3)
    with pytest.raises(ValueError, match=r"'qpos' of the state is invalid in rows \[1, 2\]; exp"):
        checked_states({"qpos": given}, _SIZES, 4)
    with pytest.raises(ValueError, match=r"in rows \[11, 12\]"):
        checked_states({"qpos": given}, _SIZES, 4, named=np.arange(10, 14))
    with pytest.raises(ValueError, match=r"has shape \(3,\); expected \(4, 3\)"):
        checked_states({"qpos": given[0]}, _SIZES, 4)


def test_a_physics_without_a_model_of_mujoco_has_no_state_to_set() -> None:
    with pytest.raises(TypeError, match="a int has no positions and velocities to set"):
        state_sizes(3)


def test_a_refused_state_changes_nothing() -> None:
    for made in (lambda: _singles(_WALK, 1)[0], lambda: suite.load_batch(*_WALK, 2, seed=0)):
        env, twin = made(), made()
        shape = env.action_spec().shape
        for each in (env, twin):
            each.reset()
        bad = np.full((*shape[:-1], 28), np.nan)
        for state in ({"qpos": bad}, {"qpos": np.zeros(3)}, {"qps": bad}, 5):
            with pytest.raises((ValueError, TypeError)):
                getattr(env, "set_states" if len(shape) == 2 else "set_state")(state)
        seen, known = env.step(np.ones(shape)), twin.step(np.ones(shape))
        np.testing.assert_array_equal(seen.reward, known.reward)


def test_a_state_is_set_right_after_a_reset_only() -> None:
    single, batch = _singles(_WALK, 1)[0], suite.load_batch(*_WALK, 3, seed=0)
    with pytest.raises(RuntimeError, match=r"no episode has just begun: call reset\(\) before"):
        single.set_state({"qvel": np.zeros(27)})
    batch.first_row = 4
    with pytest.raises(RuntimeError, match=r"just begun in rows \[5, 6\]: call reset\(rows\)"):
        batch.set_states({"qvel": np.zeros((2, 27))}, [1, 2])
    single.reset()
    single.step(np.zeros(21))
    batch.reset()
    batch.step(np.zeros((3, 21)))
    batch.reset([0])
    batch.set_states({"qvel": np.zeros((1, 27))}, [0])
    with pytest.raises(RuntimeError, match="no episode has just begun"):
        single.set_state({"qvel": np.zeros(27)})
    with pytest.raises(RuntimeError, match=r"rows \[5\]"):
        batch.set_states({"qvel": np.zeros((2, 27))}, [0, 1])
    batch.close()
    with pytest.raises(RuntimeError, match="closed"):
        batch.set_states({"qvel": np.zeros((3, 27))})


# Rows that are complete environments.


def test_rows_that_are_environments_take_the_states_of_a_vectorised_batch() -> None:
    rows = suite.load_batch(*_WALK, 3, seed=0, vectorised=False)
    batch = suite.load_batch(*_WALK, 3, seed=0)
    states = _states(batch.single, 3)
    assert rows.state_sizes() == batch.state_sizes() == {"qpos": 28, "qvel": 27}
    for each in (rows, batch):
        each.reset()
        each.set_states({name: values[[2]] for name, values in states.items()}, [2])
    _assert_same(rows.set_states(states), batch.set_states(states))
    for action in np.random.RandomState(0).uniform(-1, 1, (5, 3, 21)):
        _assert_same(rows.step(action), batch.step(action))
    snapshot = batch.snapshot([1])
    expected = batch.set_states(snapshot, [0])
    _assert_same(rows.set_states(snapshot, [0]), expected)
    rows.first_row = 3
    with pytest.raises(RuntimeError, match=r"just begun in rows \[3, 4, 5\]: call reset\(rows\)"):
        rows.set_states(states)
    with pytest.raises(ValueError, match=r"'qvel' of the state is invalid in rows \[4\]"):
        rows.set_states({"qvel": np.full((1, 27), np.nan)}, [1])
    action = np.zeros((3, 21))
    _assert_same(rows.step(action), batch.step(action))
    rows.close()
    with pytest.raises(RuntimeError, match="closed"):
        rows.state_sizes()


def _assert_same(one: Any, other: Any) -> None:
    """Fails unless two batched time steps are equal."""
    for name in ("step_type", "reward", "discount"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), name)
    for name, values in other.observation.items():
        np.testing.assert_array_equal(one.observation[name], values, name)


# Snapshots.


def test_rows_of_a_snapshot_are_a_snapshot() -> None:
    batch, other = (suite.load_batch(*_WALK, 3, seed=s) for s in (0, 10))
    batch.reset()
    batch.step(np.zeros((3, 21)))
    taken = batch.snapshot().part(np.array([2, 0]))
    assert len(taken) == 2
    other.restore(taken, [0, 1])
    seen, known = other.step(np.ones((3, 21))), batch.step(np.ones((3, 21)))
    np.testing.assert_array_equal(seen.reward[:2], known.reward[[2, 0]])


def test_a_snapshot_must_be_of_running_episodes_with_valid_states() -> None:
    batch = suite.load_batch(*_WALK, 3, seed=0)
    batch.reset()
    sizes, limit = batch.state_sizes(), batch.step_limit
    named = np.array([4, 5, 6])
    good = batch.snapshot()
    check_snapshot(good, good, 3, sizes, limit, named)
    with pytest.raises(ValueError, match="holds 3 environments; expected 2"):
        check_snapshot(good, good, 2, sizes, limit)
    batch.restart()
    ended = batch.snapshot()
    with pytest.raises(ValueError, match=r"no running episode in its rows \[4, 5, 6\]: take it"):
        check_snapshot(ended, good, 3, sizes, limit, named)
    with pytest.raises(ValueError, match="no running episode in it: take it"):
        check_snapshot(ended.part(0), good, 1, sizes, limit)
    for bad in (np.nan, 1e11):
        diverged = batch.snapshot()
        diverged.begins[:] = False
        diverged.physics["state"][1, 1 + 28 + 26] = bad  # the last velocity
        with pytest.raises(ValueError, match=r"has diverged in its rows \[5\]"):
            check_snapshot(diverged, good, 3, sizes, limit, named)
    late = batch.snapshot()
    late.begins[:] = False
    late.step_count[:] = 1000
    with pytest.raises(ValueError, match="episodes end after 1000 steps here"):
        check_snapshot(late, good, 3, sizes, limit, named)
