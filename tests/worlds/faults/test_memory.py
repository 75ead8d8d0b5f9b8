"""Faults of actions, rewards and observations, in single environments and in batches."""

import copy
import pickle
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from dm_env import specs

from limberjack import gym, rl, suite
from limberjack.rl import control
from limberjack.rl.batch_contract import Batch
from limberjack.suite import pendulum
from limberjack.worlds.faults import FaultMemory, Faults
from limberjack.worlds.faults.memory import key_of, normal, uniform

_SPEC = specs.BoundedArray((2,), float, -1.0, 1.0)
_LOST = {"probability": 0.2, "steps": 3}
# Every fault at once, of actions and of observations.
_ALL: dict[str, object] = {
    "delay": {"actions": 2, "observations": 3, "rewards": 4},
    "noise": {"actions": 0.2, "observations": 0.3},
    "dropped": {"actions": _LOST, "observations": _LOST},
    "stuck": {"actions": _LOST, "observations": _LOST},
    "repetition": {"probability": 0.4, "steps": 3},
    "dummies": 3,
}
_ROWS, _SEED = 3, 5
_SHORT = 0.3  # seconds of an episode


def _memory(faults: Mapping[str, object], seed: int = 0) -> FaultMemory:
    memory = FaultMemory(Faults.of(faults), _SPEC, {"x": np.zeros(3), "y": 0.0})
    memory.begin(0, np.random.RandomState(seed))
    return memory


def _seen(memory: FaultMemory, step: int) -> dict[str, Any]:
    """The observation of a step whose true values are its number."""
    return dict(memory.observe({"x": np.full(3, float(step)), "y": float(step)}))


def _taken(memory: FaultMemory, action: np.ndarray) -> np.ndarray:
    taken = memory.act(action)
    memory.accept()
    return taken


def test_observations_and_rewards_are_late_and_the_first_one_stands_for_those_missing() -> None:
    memory = _memory({"delay": {"observations": 2, "rewards": 3}})
    seen = [_seen(memory, step) for step in range(6)]
    assert [one["y"] for one in seen] == [0.0, 0.0, 0.0, 1.0, 2.0, 3.0]
    np.testing.assert_array_equal(seen[4]["x"], np.full(3, 2.0))
    assert [memory.reward(float(step)) for step in range(1, 7)] == [1, 1, 1, 1, 2, 3]


def test_actions_are_late() -> None:
    memory = _memory({"delay": {"actions": 2}})
    taken = [_taken(memory, np.full(2, step / 10)) for step in range(5)]
    np.testing.assert_array_equal(taken, [[step] * 2 for step in (0, 0, 0, 0.1, 0.2)])


def test_an_action_that_the_task_refuses_is_not_remembered() -> None:
    memory = _memory({"delay": {"actions": 1}})
    _taken(memory, np.zeros(2))
    memory.act(np.ones(2))  # and no `accept`
    np.testing.assert_array_equal(_taken(memory, np.full(2, 0.5)), np.zeros(2))
    np.testing.assert_array_equal(_taken(memory, np.zeros(2)), np.full(2, 0.5))


def test_noise_has_its_standard_deviation_and_actions_stay_within_bounds() -> None:
    memory = _memory({"noise": {"actions": 0.3, "observations": 0.5}})
    seen, taken = [], []
    for _ in range(2000):
        seen.append(_seen(memory, 0)["x"])
        taken.append(_taken(memory, np.array([0.0, 1.0])))
    # 5 standard errors of a standard deviation.
    assert np.std(seen) == pytest.approx(0.5, rel=5 / np.sqrt(2 * 6000))
    assert np.std([action[0] for action in taken]) == pytest.approx(0.3, rel=5 / np.sqrt(4000))
    assert np.max(taken) == 1.0
    # Half of the noise is cut off at the bound; 0.06 is more than 5 standard errors of that share.
    assert np.mean([action[1] == 1.0 for action in taken]) == pytest.approx(0.5, abs=0.06)


def test_a_dropped_number_is_zero_for_its_steps_and_each_by_itself() -> None:
    memory = _memory({"dropped": {"observations": {"probability": 0.1, "steps": 4}}})
    zero = np.array([_seen(memory, step + 1)["x"] == 0.0 for step in range(400)])
    assert not (zero == zero[:, :1]).all()
    for column in zero.T:
        edges = np.flatnonzero(np.diff(np.concatenate([[0], column, [0]])))
        lengths = (edges[1::2] - edges[::2])[:-1]  # the last one may be cut
        assert lengths.size > 10
        assert set(lengths % 4) == {0}  # one may follow another at once


@pytest.mark.parametrize("what", ["actions", "observations"])
def test_a_stuck_number_keeps_its_last_value_for_its_steps(what: str) -> None:
    memory = _memory({"stuck": {what: {"probability": 0.1, "steps": 4}}})
    found = []
    for step in range(400):
        seen = _seen(memory, step)["y"]
        taken = _taken(memory, np.full(2, step / 512))[0] * 512  # exact
        found.append(seen if what == "observations" else taken)
    stuck = np.array(found) != np.arange(400)
    assert 0.1 < stuck.mean() < 0.5
    for step in np.flatnonzero(stuck):
        assert found[step] == found[step - 1]


def test_repetition_repeats_whole_actions_and_of_one_step_nothing() -> None:
    def taken(steps: int) -> list[float]:
        memory = _memory({"repetition": {"probability": 1.0, "steps": steps}})
        found = []
        for step in range(7):
            found.append(float(_taken(memory, np.full(2, step / 10))[1]))
            _seen(memory, step)
        return found

    # As in the Real World RL suite, whose easy challenge has one step.
    assert taken(1) == [0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6]
    assert taken(3) == [0.0, 0.0, 0.0, 0.3, 0.3, 0.3, 0.6]


def test_dummies_are_noise_of_the_present_step() -> None:
    memory = _memory({"dummies": 3, "delay": {"observations": 5}})
    seen = [_seen(memory, step) for step in range(300)]
    assert list(seen[0]) == ["x", "y", "dummy-0", "dummy-1", "dummy-2"]
    values = np.array([[one[f"dummy-{number}"] for number in range(3)] for one in seen])
    assert len(np.unique(values)) == values.size
    # 5 standard errors of a standard deviation.
    assert np.std(values) == pytest.approx(1.0, rel=5 / np.sqrt(2 * values.size))


def test_a_delayed_observation_has_the_noise_of_its_own_step() -> None:
    late = _memory({"delay": {"observations": 3}, "noise": {"observations": 1.0}})
    present = _memory({"noise": {"observations": 1.0}})
    seen = [(_seen(late, step)["y"], _seen(present, step)["y"]) for step in range(9)]
    assert [one for one, _ in seen[3:]] == [one for _, one in seen[:6]]


def test_observations_keep_their_types() -> None:
    observation = {"a": np.zeros(2, np.float32), "b": np.float64(0), "c": np.zeros((2, 2), int)}
    memory = FaultMemory(Faults.of({"noise": {"observations": 1.0}}), _SPEC, observation)
    memory.begin(0, np.random.RandomState(0))
    seen = memory.observe(observation)
    for name, value in observation.items():
        assert type(seen[name]) is type(value)
        assert np.asarray(seen[name]).dtype == value.dtype
        assert np.shape(seen[name]) == value.shape


@pytest.mark.parametrize(
    ("spec", "observation", "message"),
    [
        ({"arm": _SPEC}, {"x": np.zeros(1)}, "faults need actions in one bounded array"),
        (_SPEC, {"x": "text"}, "faults need observations of numbers; 'x' is 'text'"),
        (_SPEC, {"dummy-0": np.zeros(1)}, "observes 'dummy-0', the name of a dummy"),
    ],
)
def test_a_task_that_cannot_have_faults_is_refused(
    spec: Any, observation: dict[str, Any], message: str
) -> None:
    with pytest.raises(TypeError, match=message):
        FaultMemory(Faults.of("easy"), spec, observation)


# In environments. The tasks have two actuators, one, and a batch of touch sensors.


def _single(task: tuple[str, str], seed: int, **kwargs: Any) -> Any:
    return suite.load(*task, {"random": seed, "time_limit": _SHORT}, **kwargs)


def _batch(task: tuple[str, str], **kwargs: Any) -> Batch:
    return suite.load_batch(*task, _ROWS, 1, _SEED, {"time_limit": _SHORT}, **kwargs)


def assert_equal(batch: Any, singles: list[Any]) -> None:
    """A time step of a batch has the numbers of those of single environments."""
    for row, one in enumerate(singles):
        assert batch.step_type[row] == one.step_type
        assert batch.reward[row] == (one.reward or 0.0)
        assert list(batch.observation) == list(one.observation)
        for name, values in batch.observation.items():
            np.testing.assert_array_equal(values[row], one.observation[name], name)


def _actions(batch: Batch, count: int) -> np.ndarray:
    shape = (count, *batch.action_spec().shape)
    return np.random.RandomState(0).uniform(-1, 1, shape)


@pytest.mark.parametrize("vectorised", [None, False], ids=["vectorised", "rows"])
@pytest.mark.parametrize("repeat", [1, 3])
@pytest.mark.parametrize(
    ("task", "clears"), [(("reacher", "easy"), True), (("cartpole", "swingup"), False)]
)
def test_rows_equal_single_environments(
    task: tuple[str, str], clears: bool, repeat: int, vectorised: bool | None
) -> None:
    how = {"faults": {**_ALL, "clear_at_reset": clears}, "action_repeat": repeat}
    batch = _batch(task, vectorised=vectorised, **how)
    assert (batch.why_rows is None) is (vectorised is None)
    singles = [_single(task, _SEED + row, **how) for row in range(_ROWS)]
    assert_equal(batch.reset(), [one.reset() for one in singles])
    for actions in _actions(batch, 40):  # of which an episode has 15 or 30, or a third
        steps = [one.step(action) for one, action in zip(singles, actions, strict=True)]
        assert_equal(batch.step(actions), steps)


@pytest.mark.parametrize("vectorised", [None, False], ids=["vectorised", "rows"])
def test_a_partial_reset_leaves_the_faults_of_other_rows_alone(vectorised: bool | None) -> None:
    task = ("reacher", "easy")
    batch = _batch(task, faults=_ALL, vectorised=vectorised)
    singles = [_single(task, _SEED + row, faults=_ALL) for row in range(_ROWS)]
    steps = [one.reset() for one in singles]
    batch.reset()
    actions = _actions(batch, 12)
    for number, action in enumerate(actions):
        if number == 6:
            found = batch.reset([1])
            steps = [one._replace(reward=0.0) for one in steps]
            steps[1] = singles[1].reset()
            assert_equal(found, steps)
        steps = [one.step(each) for one, each in zip(singles, action, strict=True)]
        assert_equal(batch.step(action), steps)


@pytest.mark.parametrize("vectorised", [None, False], ids=["vectorised", "rows"])
@pytest.mark.parametrize("clears", [True, False])
def test_snapshots_copies_and_pickles_have_the_faults(
    vectorised: bool | None, clears: bool
) -> None:
    task, faults = ("reacher", "easy"), {**_ALL, "clear_at_reset": clears}
    batch = _batch(task, faults=faults, vectorised=vectorised)
    batch.reset()
    actions = _actions(batch, 30)
    for action in actions[:9]:
        batch.step(action)
    saved = batch.snapshot()
    twins: list[Any] = [copy.deepcopy(batch), pickle.loads(pickle.dumps(batch))]
    other = _batch(task, faults=faults, vectorised=False if vectorised is None else None)
    other.restore(saved)
    single = _single(task, 0, faults=faults)
    single.restore(saved.part(2))
    following = [batch.step(action) for action in actions[9:]]
    batch.restore(saved)
    for one in (*twins, other, batch):
        for action, before in zip(actions[9:], following, strict=True):
            found = one.step(action)
            np.testing.assert_array_equal(found.reward, before.reward)
            for name, values in before.observation.items():
                np.testing.assert_array_equal(found.observation[name], values)
    for action, before in zip(actions[9:], following, strict=True):
        np.testing.assert_array_equal(
            single.step(action[2]).observation["position"], before.observation["position"][2]
        )


def test_a_copied_row_has_the_faults_of_its_source() -> None:
    batch = _batch(("reacher", "easy"), faults=_ALL)
    batch.reset()
    for action in _actions(batch, 9):
        batch.step(action)
    batch.copy_row(0, 2)
    found = batch.step(np.zeros((_ROWS, 2)))
    np.testing.assert_array_equal(
        found.observation["position"][2], found.observation["position"][0]
    )


def test_a_snapshot_of_other_faults_is_refused() -> None:
    env, other = (_single(("reacher", "easy"), 0, faults=name) for name in ("easy", "hard"))
    env.reset()
    with pytest.raises(ValueError, match="the snapshot is of world"):
        other.restore(env.snapshot())
    plain = _single(("reacher", "easy"), 0)
    with pytest.raises(ValueError, match=r"the snapshot is of world .*; expected None"):
        plain.restore(env.snapshot())


def test_the_physics_and_the_starts_of_a_task_change_in_no_bit() -> None:
    late = {"delay": {"observations": 3}, "noise": {"observations": 1.0}, "dummies": 2}
    plain, faulty = _single(("reacher", "easy"), 3), _single(("reacher", "easy"), 3, faults=late)
    for _ in range(2):
        plain.reset()
        faulty.reset()
        for action in np.random.RandomState(0).uniform(-1, 1, (9, 2)):
            assert plain.step(action).reward == faulty.step(action).reward
            np.testing.assert_array_equal(plain.physics.state(), faulty.physics.state())


def test_episodes_have_other_noise_and_a_seed_the_same() -> None:
    env = _single(("reacher", "easy"), 3, faults={"dummies": 4})
    first, second = env.reset().observation, env.reset().observation
    assert first["dummy-0"] != second["dummy-0"]
    env.reseed(3)
    assert env.reset().observation["dummy-0"] == first["dummy-0"]
    assert _single(("reacher", "easy"), 4, faults={"dummies": 4}).reset().observation[
        "dummy-0"
    ] not in (first["dummy-0"], second["dummy-0"])


@pytest.mark.parametrize("clears", [True, False])
def test_an_episode_begins_with_the_values_of_the_last_one_only_if_they_are_kept(
    clears: bool,
) -> None:
    faults = {"delay": {"observations": 2}, "clear_at_reset": clears}
    env = _single(("reacher", "easy"), 3, faults=faults)
    env.reset()
    env.step(np.ones(2))
    env.step(np.ones(2))
    last = env.step(np.ones(2))
    begun = env.reset()
    true = env.task.get_observation(env.physics)["velocity"]
    assert np.array_equal(begun.observation["velocity"], true) is clears
    assert not np.array_equal(last.observation["velocity"], true)
    env.reseed(3)  # a seed begins without any memory
    np.testing.assert_array_equal(env.reset().observation["velocity"], np.zeros(2))


def test_a_given_state_is_observed_as_a_start() -> None:
    faults = {"delay": {"observations": 2}, "dummies": 1}
    env, batch = (
        _single(("reacher", "easy"), _SEED, faults=faults),
        _batch(("reacher", "easy"), faults=faults),
    )
    env.reset()
    batch.reset()
    state = {"qpos": np.array([0.3, 0.4])}
    one = env.set_state(state)
    many = batch.set_states({"qpos": np.tile(state["qpos"], (_ROWS, 1))})
    np.testing.assert_array_equal(one.observation["position"], [0.3, 0.4])
    assert many.observation["dummy-0"][0] == one.observation["dummy-0"]
    again = env.present_observation()
    assert again["dummy-0"] == one.observation["dummy-0"]


@pytest.mark.parametrize("flat", [False, True])
def test_specs_are_those_of_the_observations(flat: bool) -> None:
    kwargs = {"faults": _ALL, "environment_kwargs": {"flat_observation": flat}}
    env, batch = _single(("reacher", "easy"), 0, **kwargs), _batch(("reacher", "easy"), **kwargs)
    for one in (env, batch):
        spec, observation = one.observation_spec(), one.reset().observation
        assert list(spec) == list(observation)
        for name, each in spec.items():
            each.validate(observation[name])
    assert env.physics.time() == 0.0


def test_an_action_that_is_refused_changes_nothing() -> None:
    env, twin = (_single(("reacher", "easy"), 0, faults=_ALL) for _ in range(2))
    for one in (env, twin):
        one.reset()
    for wrong in (np.zeros(3), np.zeros((1, 2)), np.array([np.nan, 0.0])):
        with pytest.raises(ValueError, match="action"):
            env.step(wrong)
    for action in np.random.RandomState(0).uniform(-1, 1, (6, 2)):
        found, expected = env.step(action), twin.step(action)
        for name, values in expected.observation.items():
            np.testing.assert_array_equal(found.observation[name], values)


def test_an_unknown_fault_is_refused_where_an_environment_is_loaded() -> None:
    with pytest.raises(ValueError, match="there are no faults 'eesy'"):
        suite.load("reacher", "easy", faults="eesy")
    with pytest.raises(ValueError, match="there are no faults 'eesy'"):
        suite.load_batch("reacher", "easy", 2, faults="eesy")
    with pytest.raises(TypeError, match="faults is given twice"):
        suite.load("reacher", "easy", environment_kwargs={"faults": "easy"}, faults="easy")


def test_tasks_of_many_have_their_faults() -> None:
    tasks = [("reacher", "easy"), ("cartpole", "swingup")]
    many = suite.load_batch(tasks, rows=2, seed=_SEED, faults=_ALL)
    alone = [
        suite.load_batch(*task, 2, seed=_SEED + 2 * number, faults=_ALL)
        for number, task in enumerate(tasks)
    ]
    found, apart = many.reset(), [one.reset() for one in alone]
    for _ in range(5):
        for number, step in enumerate(apart):
            rows = slice(2 * number, 2 * number + 2)
            np.testing.assert_array_equal(found.reward[rows], step.reward)
        actions = np.random.RandomState(0).uniform(-1, 1, many.action_spec().shape)
        found = many.step(actions)
        apart = [one.step(actions[2 * n : 2 * n + 2, : 2 - n]) for n, one in enumerate(alone)]


@pytest.mark.parametrize("mode", ["NextStep", "SameStep", "Disabled"])
def test_rows_of_both_kinds_are_equal_in_each_autoreset_mode(mode: str) -> None:
    how: dict[str, Any] = {"faults": _ALL, "time_limit": _SHORT, "autoreset_mode": mode}
    first, second = (
        gym.load_vector("reacher", "easy", _ROWS, vectorised=vectorised, **how)
        for vectorised in (True, False)
    )
    begun = [envs.reset(seed=_SEED)[0] for envs in (first, second)]
    ended = np.zeros(_ROWS, bool)
    for action in np.random.RandomState(0).uniform(-1, 1, (40, _ROWS, 2)):
        if mode == "Disabled" and ended.any():
            options = {"reset_mask": ended}
            begun = [envs.reset(options=options)[0] for envs in (first, second)]
        for name, values in begun[0].items():
            np.testing.assert_array_equal(values, begun[1][name], name)
        (one, *rest, _), (other, *others, _) = first.step(action), second.step(action)
        begun = [one, other]
        for left, right in zip(rest, others, strict=True):
            np.testing.assert_array_equal(left, right)
        ended = rest[1] | rest[2]


def test_noise_leaves_integers_whole_and_flags_alone_unless_it_is_large() -> None:
    given = {
        "count": np.full(4, 5),
        "flag": np.array([False, True]),
        "level": np.array([0, 255], np.uint8),
        "most": np.array([np.iinfo(np.int64).max, np.iinfo(np.int64).min]),
    }
    for scale, is_same in ((0.05, True), (3.0, False)):
        memory = FaultMemory(Faults.of({"noise": {"observations": scale}}), _SPEC, given)
        memory.begin(0, np.random.RandomState(0))
        seen = memory.observe(given)
        for name, values in given.items():
            found = np.asarray(seen[name])
            assert found.dtype == values.dtype
            if name == "most":  # which float64 has to about 1,000
                assert (np.sign(found) == np.sign(values)).all()
            elif is_same:
                np.testing.assert_array_equal(found, values)
        assert is_same or (np.asarray(seen["count"]) != 5).any()


def test_a_task_without_observations_can_have_faults() -> None:
    memory = FaultMemory(Faults.of({"delay": {"actions": 1}, "dummies": 1}), _SPEC, {})
    memory.begin(0, np.random.RandomState(0))
    assert list(memory.observe({})) == ["dummy-0"]


def test_whole_numbers_as_actions_stay_whole() -> None:
    spec = specs.BoundedArray((1,), np.int64, 0, 4)
    faults = Faults.of({"noise": {"actions": 0.4}, "delay": {"observations": 1}})
    memory = FaultMemory(faults, spec, {"x": 0.0})
    memory.begin(0, np.random.RandomState(0))
    for _ in range(20):
        action = memory.act(np.array([2]))
        memory.accept()
        assert action.dtype == np.int64
        assert 0 <= action[0] <= 4


class _Views(pendulum.SwingUp):
    def get_observation(self, physics: Any) -> Any:
        return {"qpos": physics.data.qpos[...]}


def test_a_task_that_observes_views_of_its_simulation_can_be_copied_with_faults() -> None:
    physics = pendulum.Physics.from_xml_string(*pendulum.get_model_and_assets())
    how: dict[str, Any] = {"control_timestep": 0.02, "faults": {"delay": {"observations": 1}}}
    environment = control.Environment(physics, _Views(random=0), **how)
    batch = rl.batch_of(environment, 2, 1, seed=0, vectorised=False)
    first = batch.reset().observation["qpos"]
    np.testing.assert_array_equal(batch.step(np.ones((2, 1))).observation["qpos"], first)


_MANY = 20_000  # random numbers


def _keys(count: int) -> np.ndarray:
    return np.random.RandomState(0).randint(0, 2**63, count, np.int64).astype(np.uint64)


@pytest.mark.parametrize("count", [1, 2, 3, 7, 16, 33])
@pytest.mark.parametrize("draw", [uniform, normal])
def test_a_row_draws_alone_what_it_draws_among_others(draw: type, count: int) -> None:
    keys, steps = _keys(9), np.arange(9)
    among = draw(keys, steps, 3, count)
    for row in range(9):
        np.testing.assert_array_equal(among[[row]], draw(keys[[row]], steps[[row]], 3, count))


def test_more_numbers_begin_with_the_same_ones() -> None:
    keys, steps = _keys(4), np.zeros(4, int)
    more = uniform(keys, steps, 0, 9)
    np.testing.assert_array_equal(more[:, :5], uniform(keys, steps, 0, 5))


def test_keys_steps_kinds_and_indices_give_different_numbers() -> None:
    keys, steps = np.arange(40, dtype=np.uint64).repeat(40), np.tile(np.arange(40), 40)
    found = np.concatenate([uniform(keys, steps, kind, 4) for kind in range(3)])
    assert len(np.unique(found)) == found.size


def test_uniform_numbers_are_spread_evenly() -> None:
    found = uniform(np.zeros(_MANY, np.uint64), np.arange(_MANY), 0, 1).ravel()
    assert 0.0 <= found.min() < found.max() < 1.0
    counts, _ = np.histogram(found, 20, (0.0, 1.0))
    # 5 standard deviations of a count, which is binomial.
    assert np.abs(counts - _MANY / 20).max() < 5 * np.sqrt(_MANY / 20)
    assert abs(np.corrcoef(found[:-1], found[1:])[0, 1]) < 5 / np.sqrt(_MANY)


def test_normal_numbers_have_the_moments_of_their_distribution() -> None:
    found = normal(_keys(_MANY // 10), np.zeros(_MANY // 10, int), 1, 10)
    assert np.isfinite(found).all()
    # 5 standard errors of each moment.
    error = 5 / np.sqrt(found.size)
    assert abs(found.mean()) < error
    assert abs(found.var() - 1) < error * np.sqrt(2)
    assert abs((found**4).mean() - 3) < error * np.sqrt(96)
    assert abs(np.corrcoef(found[:, 0], found[:, 5])[0, 1]) < 5 / np.sqrt(len(found))


def test_a_key_belongs_to_the_state_of_a_stream_and_does_not_advance_it() -> None:
    stream = np.random.RandomState(3)
    first = key_of(stream, 0)
    assert key_of(np.random.RandomState(3), 0) == first
    assert key_of(np.random.RandomState(4), 0) != first
    assert stream.uniform() == np.random.RandomState(3).uniform()
    assert key_of(stream, 0) != first


def test_a_key_differs_for_each_episode_of_a_stream_that_nothing_draws_from() -> None:
    stream = np.random.RandomState(3)
    assert len({int(key_of(stream, episode)) for episode in range(5)}) == 5
