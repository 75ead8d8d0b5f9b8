"""Repeated actions: one step equals several steps of a plain environment with the same action."""

import collections
import copy
import functools
import math
import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from limberjack import rl, suite
from limberjack.rl import control
from limberjack.rl.contract import PhysicsError
from limberjack.rl.randomize import scale
from limberjack.suite import base
from tests.representatives import REPRESENTATIVES, Task

from . import odd_environments as odd

_KINDS = [pytest.param(True, id="vectorised"), pytest.param(False, id="rows")]
_FIRST, _MID, _LAST = 0, 1, 2


class Ending(odd.Pole):
    """Ends with discount 0.25 where the pole is low; has a goal, and a sum of terms as reward."""

    get_reward = base.Task.get_reward

    GOAL = ("upright",)

    def reward_terms(self, physics: Any) -> Any:
        angle = physics.data.qpos[..., 0]
        return {"upright": np.cos(angle), "speed": 0.1 * np.sin(physics.data.qvel[..., 0])}

    def reward_of(self, terms: Any) -> Any:
        return terms["upright"] + terms["speed"]

    def get_termination(self, physics: Any) -> Any:
        low = np.abs(physics.data.qpos[..., 0]) > 0.9
        return np.where(low & (np.asarray(physics.data.time) > 0.05), 0.25, np.nan)


class Diverging(odd.Pole):
    """Half of the episodes diverge in their fifth control step."""

    def before_step(self, action: Any, physics: Any) -> None:
        super().before_step(action, physics)
        late = np.asarray(physics.data.time) > 0.07
        right = np.asarray(physics.data.qpos[..., 0]) > 0
        speed = physics.data.qvel[..., 0]
        physics.data.qvel[..., 0] = np.where(late & right, np.nan, speed)


class Calls(odd.Pole):
    """Counts the calls of its hooks."""

    def __init__(self, random: Any = None) -> None:
        super().__init__(random=random)
        self.calls: collections.Counter[str] = collections.Counter()

    def before_step(self, action: Any, physics: Any) -> None:
        self.calls["before_step"] += 1
        super().before_step(action, physics)

    def after_step(self, physics: Any) -> None:
        self.calls["after_step"] += 1
        super().after_step(physics)

    def get_observation(self, physics: Any) -> Any:
        self.calls["get_observation"] += 1
        return super().get_observation(physics)

    def get_reward(self, physics: Any) -> Any:
        self.calls["get_reward"] += 1
        return super().get_reward(physics)

    def get_termination(self, physics: Any) -> Any:
        self.calls["get_termination"] += 1
        return 0.0 if self.calls["get_reward"] == 11 else None


class Raising(odd.Pole):
    """Raises in the fifth control step, once, if it is told to."""

    raises = False

    def get_reward(self, physics: Any) -> Any:
        if self.raises and float(np.max(physics.data.time)) > 0.09:
            type(self).raises = False
            raise KeyError("a fault of the task")
        return super().get_reward(physics)


class Termed(Diverging):
    """Its reward is its only term."""

    get_reward = base.Task.get_reward

    def reward_terms(self, physics: Any) -> Any:
        return {"cosine": np.cos(physics.data.qpos[..., 0])}


def of_ending(seed: int) -> control.Environment:
    return odd.environment(Ending, seed, time_limit=20 * 0.02)


def of_diverging(seed: int) -> control.Environment:
    return odd.environment(Diverging, seed)


def of_terms(seed: int) -> control.Environment:
    return odd.environment(Termed, seed)


def of_calls(seed: int) -> control.Environment:
    return odd.environment(Calls, seed, time_limit=0.14)


def of_raising(seed: int) -> control.Environment:
    return odd.environment(Raising, seed)


def _facts(step_type: Any, reward: Any, discount: Any, observation: Any) -> Any:
    is_first = int(step_type) == _FIRST
    shown = {name: np.asarray(value).tobytes() for name, value in observation.items()}
    return int(step_type), 0.0 if is_first else reward, 1.0 if is_first else discount, shown


def _by_hand(env: Any, action: np.ndarray, repeat: int) -> Any:
    """The sum of several steps of a plain environment, with its terms, success and truncation."""
    total, time_step = 0.0, None
    sums: dict[str, float] = {}
    for _ in range(repeat):
        time_step = env.step(action.copy())
        if time_step.first():
            return _facts(*time_step), {}, None, False
        total = total + time_step.reward
        for name, value in env.reward_terms.items():
            sums[name] = sums[name] + float(value) if name in sums else float(value)
        if time_step.last():
            break
    assert time_step is not None
    step_type, _, discount, observation = time_step
    facts = _facts(step_type, float(total), float(discount), observation)
    return facts, sums, env.success, env.timed_out


def _of_single(env: Any, action: np.ndarray) -> Any:
    time_step = env.step(action.copy())
    if time_step.first():
        return _facts(*time_step), {}, None, False
    step_type, reward, discount, observation = time_step
    facts = _facts(step_type, float(reward), float(discount), observation)
    terms = {name: float(value) for name, value in env.reward_terms.items()}
    return facts, terms, env.success, env.timed_out


def _of_rows(batch: Any, actions: np.ndarray) -> list[Any]:
    step_type, reward, discount, observation = batch.step(actions)
    seen, success = [], batch.success
    for row in range(batch.num_envs):
        of_row = {name: values[row] for name, values in observation.items()}
        facts = _facts(step_type[row], float(reward[row]), float(discount[row]), of_row)
        if step_type[row] == _FIRST:
            seen.append((facts, {}, None, False))
            continue
        terms = {name: float(values[row]) for name, values in batch.reward_terms.items()}
        goal = None if success is None else bool(success[row])
        seen.append((facts, terms, goal, bool(batch.timed_out[row])))
    return seen


def _law(build: Any, repeat: int, shape: tuple[int, ...], steps: int) -> list[Any]:
    """Compares an environment and both kinds of batch with plain ones; returns their steps."""
    rows = 3
    plain, single = [build(seed) for seed in range(rows)], [build(seed) for seed in range(rows)]
    for env in single:
        env.action_repeat = repeat
    batches = [
        rl.batch_of(build, rows, 1, seed=0, vectorised=vectorised, action_repeat=repeat)
        for vectorised in (True, False)
    ]
    played = []
    for actions in odd.actions_of(steps, rows, shape):
        expected = [_by_hand(env, actions[row], repeat) for row, env in enumerate(plain)]
        assert [_of_single(env, actions[row]) for row, env in enumerate(single)] == expected
        for batch in batches:
            assert _of_rows(batch, actions) == expected
        played.append(expected)
    for one in (*plain, *single, *batches):
        one.close()
    return played


@pytest.mark.parametrize("repeat", [2, 5])
@pytest.mark.parametrize("task", REPRESENTATIVES)
def test_a_step_is_several_steps_of_a_plain_environment(task: Task, repeat: int) -> None:
    step = suite.load(*task).control_timestep()

    def build(seed: int) -> control.Environment:
        return suite.load(*task, {"random": seed, "time_limit": 13 * step})

    shape = suite.load(*task).action_spec().shape
    played = _law(build, repeat, shape, math.ceil(13 / repeat) + 3)
    ends = [facts[0][0] for facts in (row for step in played for row in step)]
    assert ends.count(_LAST) == 3


@pytest.mark.parametrize("repeat", [1, 3, 4, 40])
def test_tasks_that_end_early_end_with_their_discount_and_their_last_steps_success(
    repeat: int,
) -> None:
    played = _law(of_ending, repeat, (1,), 80 // repeat + 4)
    last = [row for step in played for row in step if row[0][0] == _LAST]
    assert {row[0][2] for row in last} == {0.25, 1.0}


@pytest.mark.parametrize("repeat", [2, 3])
def test_flat_observations_and_randomisation_are_those_of_the_last_step(repeat: int) -> None:
    def build(seed: int) -> control.Environment:
        draws = {"body_mass": scale(0.5, 2.0)}
        kwargs = {"flat_observation": True, "randomize": draws}
        return suite.load("cartpole", "swingup", {"random": seed, "time_limit": 0.07}, kwargs)

    _law(build, repeat, (1,), 12)


@pytest.mark.parametrize("kind", ["delayed observations", "a log", "nested wrappers"])
def test_rows_of_other_classes_are_stepped_repeatedly(kind: str) -> None:
    batch = rl.batch_of(odd.KINDS[kind], 3, 1, seed=0, action_repeat=4)
    plain = [odd.KINDS[kind](seed) for seed in range(3)]
    for actions in odd.actions_of(9, 3):
        time_step = batch.step(actions)
        for row, env in enumerate(plain):
            total, expected = 0.0, env.step(actions[row].copy())
            for number in range(4):
                if expected.first():
                    break
                total = total + expected.reward
                if expected.last() or number == 3:
                    break
                expected = env.step(actions[row].copy())
            here = odd.facts(time_step, row)
            there = odd.facts(expected)
            reward = 0.0 if expected.first() else float(total)
            assert here == (there[0], reward, there[2], there[3])


@pytest.mark.parametrize("vectorised", _KINDS)
@pytest.mark.parametrize("repeat", [3, 4, 7])
def test_a_row_that_diverges_in_mid_action_keeps_the_rewards_before(
    vectorised: bool, repeat: int
) -> None:
    actions = odd.actions_of(4, 6)
    how: dict[str, Any] = {"seed": 0, "vectorised": vectorised}
    batch = rl.batch_of(of_diverging, 6, 1, action_repeat=repeat, **how)
    plain = rl.batch_of(of_diverging, 6, 1, **how)
    batch.reset()
    plain.reset()
    ended, diverged = np.zeros(6, bool), np.zeros(6, bool)
    for action in actions[: math.ceil(odd.STEPS / repeat)]:
        totals = np.zeros(6)
        for _ in range(repeat):
            if ended.all():
                break
            rewards, last = (plain_step := plain.step(action)).reward, plain_step.step_type == _LAST
            totals = np.where(ended, totals, totals + rewards)
            diverged |= plain.diverged & ~ended
            ended |= last
        time_step = batch.step(action)
        assert time_step.reward.tolist() == totals.tolist()
        assert (time_step.step_type == _LAST).tolist() == ended.tolist()
        assert batch.diverged.tolist() == diverged.tolist()
        assert time_step.discount.tolist() == np.where(diverged, 0.0, 1.0).tolist()
        assert batch.begins.tolist() == ended.tolist()
        assert batch.timed_out.tolist() == (ended & ~diverged).tolist()
    assert diverged.any()
    assert not diverged.all()
    assert (batch.step(actions[0]).step_type == _FIRST).all()


def test_a_single_environment_that_diverges_in_mid_action_begins_again() -> None:
    env = next(
        env for env in map(of_diverging, range(9)) if env.reset().observation["position"] > 0
    )
    env.action_repeat = 40
    with pytest.raises(PhysicsError):
        env.step([0.0])
    assert env.step([0.0]).first()


def test_terms_of_a_row_that_diverges_add_up_to_its_reward() -> None:
    found = []
    for vectorised in (True, False):
        batch = rl.batch_of(of_terms, 6, 1, seed=0, vectorised=vectorised, action_repeat=7)
        batch.reset()
        time_step = batch.step(np.zeros((6, 1)))
        assert batch.diverged.any()
        assert np.asarray(batch.reward_terms["cosine"]).tolist() == time_step.reward.tolist()
        found.append(time_step.reward.tolist())
    assert found[0] == found[1]


@pytest.mark.parametrize("repeat", [1, 3])
def test_each_hook_is_called_once_for_each_control_step(repeat: int) -> None:
    batch = rl.batch_of(of_calls, 2, 1, seed=0, vectorised=False, action_repeat=repeat)
    singles = [of_calls(seed) for seed in range(2)]
    for env in singles:
        env.action_repeat = repeat
    control_steps = [0, 0]
    for actions in odd.actions_of(9, 2):
        batch.step(actions)
        for row, env in enumerate(singles):
            before = env._step_count
            first = env.step(actions[row]).first()
            control_steps[row] += 0 if first else env._step_count - before
    for row, env in enumerate(singles):
        calls = env.task.calls
        assert calls["before_step"] == calls["after_step"] == calls["get_reward"]
        assert calls["get_reward"] == control_steps[row]
        assert calls == batch.environments[row].task.calls  # pyright: ignore[reportAttributeAccessIssue]


@pytest.mark.parametrize("vectorised", _KINDS)
def test_partial_resets_and_restarts_leave_other_rows_alone(vectorised: bool) -> None:
    def build(seed: int) -> control.Environment:
        return odd.environment(Ending, seed, time_limit=0.22)

    batch = rl.batch_of(build, 3, 1, seed=0, vectorised=vectorised, action_repeat=3)
    singles = [build(seed) for seed in range(3)]
    for env in singles:
        env.action_repeat = 3
    for number, actions in enumerate(odd.actions_of(16, 3)):
        if number in (2, 4, 9):
            rows = [number % 3]
            seeds = [77] if number == 4 else None
            batch.reset(rows, seeds=seeds)
            if seeds:
                singles[rows[0]].reseed(77)
            singles[rows[0]].reset()
        if number == 12:
            batch.restart()
            for env in singles:
                env._reset_next_step = True
        expected = [_of_single(env, actions[row]) for row, env in enumerate(singles)]
        assert _of_rows(batch, actions) == expected


@pytest.mark.parametrize("steps", [0, 2, 3])
@pytest.mark.parametrize("vectorised", _KINDS)
def test_snapshots_copies_and_pickles_continue_in_either_kind(vectorised: bool, steps: int) -> None:
    how: dict[str, Any] = {"seed": 0, "action_repeat": 3}
    batch = rl.batch_of(of_ending, 3, 1, vectorised=vectorised, **how)
    actions = odd.actions_of(steps + 9, 3)
    for action in actions[:steps]:
        batch.step(action)
    snapshot = batch.snapshot()
    others = [copy.deepcopy(batch), pickle.loads(pickle.dumps(batch))]
    others.append(rl.batch_of(of_ending, 3, 1, vectorised=not vectorised, **how))
    others[-1].restore(pickle.loads(pickle.dumps(snapshot)))
    single = of_ending(9)
    single.action_repeat = 3
    single.restore(batch.snapshot([1]))
    expected = [_of_rows(batch, action) for action in actions[steps:]]
    batch.restore(snapshot)
    for one in (batch, *others):
        assert one.action_repeat == 3
        assert [_of_rows(one, action) for action in actions[steps:]] == expected
    assert [_of_single(single, action[1]) for action in actions[steps:]] == [
        step[1] for step in expected
    ]
    batch.copy_row(2, 0)
    same = actions[0][[2, 1, 2]]
    found = _of_rows(batch, same)
    assert found[0] == found[2]


@pytest.mark.parametrize("vectorised", _KINDS)
def test_after_an_error_of_a_hook_every_row_begins_again(
    vectorised: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    batch = rl.batch_of(of_raising, 3, 1, seed=0, vectorised=vectorised, action_repeat=3)
    batch.reset()
    batch.step(np.zeros((3, 1)))
    monkeypatch.setattr(Raising, "raises", True)
    with pytest.raises(KeyError):
        batch.step(np.zeros((3, 1)))
    assert (batch.step(np.zeros((3, 1))).step_type == _FIRST).all()
    assert (batch.step(np.zeros((3, 1))).step_type == _MID).all()


@pytest.mark.parametrize("vectorised", _KINDS)
def test_a_refused_action_moves_nothing(vectorised: bool) -> None:
    batch = rl.batch_of(of_ending, 2, 1, seed=0, vectorised=vectorised, action_repeat=3)
    batch.reset()
    batch.step(np.zeros((2, 1)))
    twin = copy.deepcopy(batch)
    for wrong in (np.full((2, 1), np.nan), np.zeros((2, 2)), np.zeros((3, 1))):
        with pytest.raises(ValueError, match="action"):
            batch.step(wrong)
    assert _of_rows(batch, np.ones((2, 1))) == _of_rows(twin, np.ones((2, 1)))


@pytest.mark.parametrize("vectorised", _KINDS)
def test_arrays_of_a_step_never_change_later(vectorised: bool) -> None:
    batch = rl.batch_of(of_ending, 3, 1, seed=0, vectorised=vectorised, action_repeat=3)
    kept = []
    for actions in odd.actions_of(10, 3):
        time_step = batch.step(actions)
        arrays = [*time_step[:3], *time_step.observation.values(), *batch.reward_terms.values()]
        kept.append((arrays, [array.copy() for array in arrays]))
    for arrays, copies in kept:
        for array, expected in zip(arrays, copies, strict=True):
            np.testing.assert_array_equal(array, expected)


def test_one_picture_is_taken_and_stacked_for_each_action() -> None:
    pixels = {"camera": "side", "height": 16, "width": 16, "frame_stack": 3}

    def build(seed: int) -> control.Environment:
        return odd.environment(Ending, seed, pixels=pixels, time_limit=0.16)

    single, plain = build(0), build(0)
    single.action_repeat = 3
    assert plain.pixels is not None
    batches = [
        rl.batch_of(build, 2, 1, seed=0, vectorised=vectorised, action_repeat=3)
        for vectorised in (True, False)
    ]
    drawn: list[np.ndarray] = []
    for actions in odd.actions_of(8, 2):
        time_step, expected = single.step(actions[0]), plain.step(actions[0])
        for _ in range(2):
            if expected.mid():
                expected = plain.step(actions[0])
        frame = expected.observation["pixels"][..., -3:]
        drawn = [frame] * 3 if expected.first() else [*drawn[1:], frame]
        np.testing.assert_array_equal(time_step.observation["pixels"], np.concatenate(drawn, -1))
        for batch in batches:
            shown = batch.step(actions).observation["pixels"][0]
            np.testing.assert_array_equal(shown, time_step.observation["pixels"])


@pytest.mark.parametrize("repeat", [0, -1, 1.5, True, "2", [2], float("nan")])
def test_anything_but_a_whole_number_from_1_is_refused_by_name(repeat: Any) -> None:
    names = "cartpole", "swingup"
    kwargs: list[dict[str, Any]] = [{"vectorised": one} for one in (None, True, False)]
    makers: list[Callable[[], object]] = [
        lambda: suite.load(*names, action_repeat=repeat),
        lambda: suite.load(*names, environment_kwargs={"action_repeat": repeat}),
        lambda: setattr(suite.load(*names), "action_repeat", repeat),
        *(
            functools.partial(suite.load_batch, *names, 2, action_repeat=repeat, **k)
            for k in kwargs
        ),
    ]
    for make in makers:
        with pytest.raises(ValueError, match=r"action_repeat is .*; expected a whole number"):
            make()


class Coarse(odd.Pole):
    """Its rewards have the precision of float32."""

    def get_reward(self, physics: Any) -> Any:
        return np.cos(physics.data.qpos[..., 0]).astype(np.float32)


@pytest.mark.parametrize("vectorised", _KINDS)
def test_rewards_of_less_precision_are_added_in_float64(vectorised: bool) -> None:
    build = functools.partial(odd.environment, Coarse, time_limit=1.0)
    single = build(0)
    control.set_action_repeat(single, 3)
    batch = rl.batch_of(build, 1, seed=0, action_repeat=3, vectorised=vectorised)
    single.reset()
    batch.reset()
    by_hand = build(0)
    by_hand.reset()
    for _ in range(3):
        rewards = [np.float64(by_hand.step([0.5]).reward) for _ in range(3)]
        reward = single.step([0.5]).reward
        assert reward == batch.step([[0.5]]).reward[0] == sum(rewards)


def test_success_is_that_of_the_last_step_after_another_repeat_was_set() -> None:
    env = suite.load("acrobot", "swingup", {"random": 1})
    env.reset()
    env.action_repeat = 4
    env.step(np.zeros(1))
    before = env.success
    env.action_repeat = 1
    assert env.success == before
