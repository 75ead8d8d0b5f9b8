"""`Single`: every kind of environment equals a new one of each seed, and a row of a batch."""

import copy
import itertools
import pickle
import threading
from typing import Any

import dm_env
import numpy as np
import pytest

from limberjack import rl, suite
from limberjack.gym.single import Single
from limberjack.rl import control
from limberjack.suite.wrappers import action_scale
from tests.rl import odd_environments as odd

_COPYABLE = [kind for kind in odd.KINDS if kind not in odd.FROM_BUILD_ONLY]


def _episode(env: Any, actions: np.ndarray) -> list[odd.Facts]:
    """An episode until it ends, or the actions do."""
    found = [odd.facts(env.reset())]
    for action in actions:
        found.append(odd.facts(env.step(action.copy())))
        if found[-1][0] == int(dm_env.StepType.LAST):
            break
    return found


@pytest.mark.parametrize("kind", odd.KINDS)
def test_the_episodes_of_a_seed_are_those_of_a_new_environment(kind: str) -> None:
    make, actions = odd.KINDS[kind], odd.actions_of(9, 1)[:, 0]
    single = Single(make)
    for seed in (4, 9, 9, 0, 4):
        single.reseed(seed)
        new = make(seed)
        for _ in range(3):
            assert _episode(single, actions) == _episode(new, actions)


@pytest.mark.parametrize("kind", _COPYABLE)
def test_an_instance_is_taken_over_and_begins_any_seed(kind: str) -> None:
    make, actions = odd.KINDS[kind], odd.actions_of(9, 1)[:, 0]
    single = Single(make(4))
    for seed in (9, 9, 4):
        single.reseed(seed)
        new = make(seed)
        for _ in range(2):
            assert _episode(single, actions) == _episode(new, actions)


@pytest.mark.parametrize("kind", odd.KINDS)
@pytest.mark.parametrize("repeat", [None, 2])
def test_it_equals_a_row(kind: str, repeat: int | None) -> None:
    make = odd.KINDS[kind]
    batch = rl.batch_of(make, 1, 1, seed=3, vectorised=False, action_repeat=repeat)
    single = Single(make, repeat)
    batch.reset(None, [3])
    single.reseed(3)
    single.reset()
    for number, action in enumerate(odd.actions_of(20, 1)):
        if not single.is_running:
            batch.reset()
            single.reset()
        row, alone = batch.step(action.copy()), single.step(action[0])
        assert odd.facts(row, 0) == odd.facts(alone), number
        assert single.timed_out == batch.timed_out[0]
        terms = {name: np.asarray(value)[0] for name, value in batch.reward_terms.items()}
        assert terms == dict(single.reward_terms)
    batch.close()


@pytest.mark.parametrize("kind", _COPYABLE)
def test_a_snapshot_continues_bit_for_bit_also_in_another_environment(kind: str) -> None:
    make, actions = odd.KINDS[kind], odd.actions_of(12, 1)[:, 0]
    single = Single(make)
    single.reseed(5)
    single.reset()
    single.step(actions[0])
    snapshot = pickle.loads(pickle.dumps(single.snapshot()))
    expected = _rest(single, actions)
    for other in (single, Single(make), copy.deepcopy(single)):
        other.reset()
        other.restore(snapshot)
        assert _rest(other, actions) == expected
        other.reset()
        assert odd.facts(other.set_state(snapshot))[3] == odd.facts(_seen(snapshot, make))[3]
        assert _rest(other, actions) == expected


def _seen(snapshot: Any, make: Any) -> dm_env.TimeStep:
    other = Single(make)
    other.reset()
    return other.set_state(snapshot)


def _rest(single: Single, actions: np.ndarray) -> list[odd.Facts]:
    """The rest of an episode, and the next one."""
    found = []
    for action in actions:
        if not single.is_running:
            break
        found.append(odd.facts(single.step(action)))
    return [*found, *_episode(single, actions)]


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda one: pickle.loads(pickle.dumps(one))])
@pytest.mark.parametrize("kind", _COPYABLE)
def test_a_copy_continues_as_the_original_does(kind: str, copied: Any) -> None:
    actions = odd.actions_of(9, 1)[:, 0]
    single = Single(odd.KINDS[kind])
    single.reseed(2)
    single.reset()
    single.step(actions[0])
    twin = copied(single)
    assert _rest(single, actions) == _rest(twin, actions)
    single.reseed(7)
    twin.reseed(7)
    assert _episode(single, actions) == _episode(twin, actions)


def test_attributes_that_are_set_hold_for_later_seeds() -> None:
    class Leaning(odd.Pole):
        lean = 0.0

        def get_reward(self, physics: Any) -> Any:
            return self.lean

    def plain(seed: int) -> Any:
        return odd.environment(Leaning, seed)

    def wrapped(seed: int) -> Any:
        return action_scale.Wrapper(plain(seed), minimum=-2.0, maximum=2.0)

    for make in (plain, wrapped):
        for single in (Single(make), Single(make(0))):
            single.set_attribute("lean", 3.0)
            for seed in (None, 1, 2):
                if seed is not None:
                    single.reseed(seed)
                single.reset()
                assert single.step(np.zeros(1)).reward == 3.0


def test_a_model_edited_by_hand_stays_and_one_edited_by_the_task_is_made_again() -> None:
    for task, is_kept in ((odd.LastAction, True), (odd.Perturbed, False)):
        single = Single(odd.environment(task, 0))
        physics: Any = single.physics
        single.reset()
        physics.model.body_mass[1] = 7.0
        single.reseed(1)
        played: Any = single.physics
        assert (played.model.body_mass[1] == 7.0) == is_kept
        assert (played is physics) == is_kept


class _Locked(odd.Counting):
    """Keeps a lock, which cannot be copied."""

    def __init__(self, random: Any = None) -> None:
        super().__init__(random=random)
        self.lock = threading.Lock()


def test_an_instance_that_cannot_be_copied_takes_one_seed_before_its_first_episode() -> None:
    actions = odd.actions_of(3, 1)[:, 0]
    single = Single(odd.environment(_Locked, 0))
    single.reseed(5)
    expected = odd.environment(_Locked, 5)
    assert _episode(single, actions) == _episode(expected, actions)
    with pytest.raises(TypeError, match=r"lock .*cannot be copied.* pass a function build\(seed\)"):
        single.reseed(6)
    assert odd.facts(single.step(actions[0])) == odd.facts(expected.step(actions[0]))


def test_a_wrapper_with_a_stream_of_its_own_asks_for_a_function_once_a_seed_is_given() -> None:
    single = Single(odd.distracting(0))
    single.reset()
    with pytest.raises(TypeError, match=r"_random_state .* pass a function build\(seed\)"):
        single.reseed(1)
    assert not single.step(np.zeros(1)).last()


def test_a_function_that_raises_leaves_the_episode_alone() -> None:
    made = itertools.count()

    def make(seed: int) -> Any:
        if next(made):
            raise OSError("no such file")
        return odd.scaled(seed)

    single, other = Single(make), Single(odd.scaled)
    for each in (single, other):
        each.reset()
    with pytest.raises(OSError, match="no such file"):
        single.reseed(1)
    assert single.is_running
    single.step(np.zeros(1))


@pytest.mark.parametrize(
    ("bad", "kind", "message"),
    [
        (np.zeros(2), ValueError, r"shape \(2,\); expected \(1,\)"),
        (np.array([np.nan]), ValueError, "not finite"),
        (["a"], TypeError, "expected numbers"),
    ],
)
def test_a_refused_action_changes_nothing(bad: Any, kind: Any, message: str) -> None:
    single, twin = Single(odd.Catch), Single(odd.Catch)
    for each in (single, twin):
        each.reseed(3)
        each.reset()
    with pytest.raises(kind, match=message):
        single.step(bad)
    assert odd.facts(single.step([0.5])) == odd.facts(twin.step(np.array([0.5])))


def test_after_an_error_in_a_step_an_episode_must_begin() -> None:
    class Failing(odd.Catch):
        def step(self, action: Any) -> dm_env.TimeStep:
            raise KeyError("wrong")

    single = Single(Failing)
    single.reset()
    with pytest.raises(KeyError):
        single.step([0.0])
    assert not single.is_running


def test_a_divergence_ends_the_episode_of_a_wrapper() -> None:
    single = Single(odd.scaled)
    single.reset()
    physics: Any = single.physics
    physics.data.qpos[0] = np.nan
    with pytest.raises(control.PhysicsError):
        single.step(np.zeros(1))
    assert not single.is_running
    single.reset()
    single.step(np.zeros(1))


def test_an_observation_that_differs_from_its_spec_is_refused() -> None:
    class Growing(odd.Catch):
        def _seen(self) -> np.ndarray:
            return np.zeros(2 + self._steps, np.float32)

    single = Single(Growing)
    single.reset()
    with pytest.raises(ValueError, match=r"'observations' has shape \(3,\)"):
        single.step([0.0])


def test_other_things_than_environments_are_refused() -> None:
    other: Any = 3
    with pytest.raises(TypeError, match=r"expected a dm_env\.Environment or a function build"):
        Single(other)
    with pytest.raises(TypeError, match=r"made a int; expected a dm_env\.Environment"):
        Single(lambda seed: other)

    class Unbounded(odd.Catch):
        def action_spec(self) -> Any:
            return {"move": super().action_spec()}

    with pytest.raises(TypeError, match="action_spec of Unbounded is"):
        Single(Unbounded)


def test_what_an_environment_lacks_is_named() -> None:
    single = Single(odd.Catch)
    with pytest.raises(AttributeError, match="a Catch has no physics"):
        _ = single.physics
    with pytest.raises(TypeError, match="a Catch cannot begin in a given state"):
        single.state_sizes()
    assert np.isnan(single.control_timestep())
    assert single.step_limit is None


def test_a_snapshot_of_a_plain_environment_is_not_one_of_its_wrapper() -> None:
    single = Single(odd.scaled)
    single.reset()
    plain = odd.environment(odd.LastAction, 0)
    plain.reset()
    with pytest.raises(ValueError, match=r"expected copies of environments .*action_scale"):
        single.restore(plain.snapshot())


def test_the_limit_that_is_set_holds_for_later_seeds_and_snapshots() -> None:
    def length(single: Single) -> int:
        single.reset()
        return next(n for n in itertools.count(1) if single.step(np.zeros(1)).last())

    single, other = Single(odd.scaled), Single(odd.scaled)
    single._step_limit = 3
    other.reset()
    for change in (
        lambda: None,
        lambda: single.reseed(1),
        lambda: single.restore(other.snapshot()),
    ):
        change()
        assert length(single) == 3
        assert single.timed_out


def test_its_description_has_the_task_the_seed_and_the_step() -> None:
    single = Single(lambda seed: action_scale.Wrapper(suite.load("pendulum", "swingup"), -2, 2))
    single.reseed(4)
    single.reset()
    single.step([0.0])
    described = single.description()
    assert (described.task, described.seeds, described.steps) == ("pendulum:swingup", [4], [1])


class _Margin(odd.LastAction):
    """Has a setting, and a memory that is not declared."""

    def __init__(self, random: Any = None) -> None:
        super().__init__(random=random)
        self.margin = 0.5
        self.limits = [1.0]
        self.calls = 0

    def get_reward(self, physics: Any) -> Any:
        self.calls += 1
        return self.margin + self.limits[0] + 0.001 * self.calls


def test_settings_that_a_program_changes_stay_and_memory_is_put_back() -> None:
    single = Single(odd.environment(_Margin, 0))
    task: Any = single.environment.task  # pyright: ignore[reportAttributeAccessIssue]
    single.reseed(1)
    for _ in range(2):
        single.reset()
        assert single.step([0.1]).reward == pytest.approx(1.5 + 0.001 * task.calls)
    assert task.calls == 2
    task.margin = 0.25
    task.limits[0] = 2.0
    single.reseed(2)
    assert (task.calls, task.margin, task.limits) == (0, 0.25, [2.0])
    single.reset()
    single.reseed(2)
    assert (task.calls, task.margin, task.limits) == (0, 0.25, [2.0])


def test_settings_that_are_changed_before_the_first_episode_stay() -> None:
    single = Single(odd.environment(_Margin, 0))
    task: Any = single.environment.task  # pyright: ignore[reportAttributeAccessIssue]
    task.margin = 0.25
    single.reset()
    single.step([0.1])
    single.reseed(2)
    assert (task.calls, task.margin) == (0, 0.25)


class _Counting(odd.Pole):
    """Counts its steps, without declaring it, and fails at a large action."""

    def __init__(self, random: Any = None) -> None:
        super().__init__(random=random)
        self.steps_seen = 0

    def before_step(self, action: Any, physics: Any) -> None:
        self.steps_seen += 1
        if action[0] > 0.9:
            raise ZeroDivisionError("by a bug")
        super().before_step(action, physics)


def test_memory_of_a_failed_step_and_of_a_restored_episode_is_put_back() -> None:
    single = Single(odd.environment(_Counting, 0))
    task: Any = single.environment.task  # pyright: ignore[reportAttributeAccessIssue]
    single.reset()
    single.step([0.1])
    with pytest.raises(ZeroDivisionError):
        single.step([1.0])
    assert task.steps_seen == 2
    single.reseed(1)
    assert task.steps_seen == 0
    single.reset()
    for _ in range(3):
        single.step([0.1])
    third = single.snapshot()
    single.step([0.1])
    single.restore(third)
    assert task.steps_seen == 3
    single.reseed(2)
    assert task.steps_seen == 0
    single.reset()
    single.set_state({"qpos": np.zeros(1)})
    single.reseed(3)
    assert task.steps_seen == 0
