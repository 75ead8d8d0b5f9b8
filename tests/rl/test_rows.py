"""Batches of complete environments: each row equals the single environment, whatever its class."""

import collections
import copy
import functools
import itertools
import multiprocessing
import os
import pickle
import random
import signal
import threading
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from limberjack import suite
from limberjack.rl import control
from limberjack.rl.batch import BatchEnvironment
from limberjack.rl.rows import RowsEnvironment

from . import odd_environments as odd

_SEED = 3


def _singles(kind: str, actions: np.ndarray) -> list[list[odd.Facts]]:
    """The time steps of single environments: a list a step, of rows."""
    rows = range(actions.shape[1])
    played = [odd.steps_of(odd.KINDS[kind](_SEED + row), actions[:, row]) for row in rows]
    return [list(step) for step in zip(*played, strict=True)]


def _in_turn(*choices: Any) -> list[tuple[Any, ...]]:
    """Each kind of environment with one of the choices, in turn."""
    return list(zip(odd.KINDS, itertools.cycle(choices), strict=False))


@pytest.mark.parametrize(("kind", "size"), _in_turn((1, 1), (2, 1), (5, 2)))
def test_each_row_is_the_single_environment(kind: str, size: tuple[int, int]) -> None:
    rows, threads = size
    actions = odd.actions_of(2 * odd.STEPS + 5, rows)
    expected = _singles(kind, actions)
    batch = RowsEnvironment(odd.KINDS[kind], rows, threads, seed=_SEED)
    assert odd.future(batch, actions) == expected
    batch.close()


def _batch(kind: str, rows: int = 3, threads: int = 2, seed: int = _SEED) -> RowsEnvironment:
    return RowsEnvironment(odd.KINDS[kind], rows, threads, seed=seed)


@pytest.mark.parametrize(("kind", "steps"), _in_turn(0, odd.STEPS + 2))
def test_a_snapshot_has_the_same_future_in_its_batch_and_in_others(kind: str, steps: int) -> None:
    actions = odd.actions_of(steps + 12, 3)
    batch = _batch(kind)
    odd.future(batch, actions[:steps])
    snapshot = batch.snapshot()
    twin, pickled = copy.deepcopy(batch), pickle.loads(pickle.dumps(batch))
    expected = odd.future(batch, actions[steps:])
    assert odd.future(twin, actions[steps:]) == expected
    assert odd.future(pickled, actions[steps:]) == expected
    batch.restore(snapshot)
    assert odd.future(batch, actions[steps:]) == expected
    other = _batch(kind, threads=1, seed=77)
    odd.future(other, actions[:2])
    other.restore(pickle.loads(pickle.dumps(snapshot)))
    assert odd.future(other, actions[steps:]) == expected
    other.restore(snapshot)  # which none of the futures has changed
    assert odd.future(other, actions[steps:]) == expected


@pytest.mark.parametrize("kind", odd.KINDS)
def test_a_copied_row_continues_as_its_source_and_others_as_before(kind: str) -> None:
    actions = odd.actions_of(16, 3)
    actions[:, 2] = actions[:, 0]
    batch, reference = _batch(kind), _batch(kind)
    for one in (batch, reference):
        odd.future(one, actions[:3])
    batch.copy_row(0, 2)
    found, expected = odd.future(batch, actions[3:]), odd.future(reference, actions[3:])
    for step, of_rows in enumerate(expected):
        assert found[step] == [of_rows[0], of_rows[1], of_rows[0]]


@pytest.mark.parametrize("kind", odd.KINDS)
def test_rows_restored_by_themselves_leave_the_others(kind: str) -> None:
    actions = odd.actions_of(16, 3)
    batch, reference = _batch(kind), _batch(kind)
    for one in (batch, reference):
        odd.future(one, actions[:3])
    snapshot = batch.snapshot([0, 2])
    odd.future(batch, actions[3:5])
    batch.restore(snapshot, [0, 1])
    actions[:, 1] = actions[:, 2]
    found, expected = odd.future(batch, actions[3:]), odd.future(reference, actions[3:])
    for step, of_rows in enumerate(expected):
        assert found[step][:2] == [of_rows[0], of_rows[2]]


@pytest.mark.parametrize("kind", odd.KINDS)
def test_rows_that_must_begin_begin_after_a_restored_snapshot_too(kind: str) -> None:
    actions = odd.actions_of(9, 3)
    batch = _batch(kind)
    odd.future(batch, actions[:2])
    batch.restart()
    snapshot = batch.snapshot()
    expected = odd.future(batch, actions[2:])
    assert all(facts[0] == 0 for facts in expected[0])
    batch.restore(snapshot)
    assert odd.future(batch, actions[2:]) == expected
    twin = _batch(kind, seed=9)
    twin.restore(snapshot)
    assert odd.future(twin, actions[2:]) == expected


@pytest.mark.parametrize("kind", odd.KINDS)
def test_a_reset_with_seeds_begins_their_first_episodes_and_leaves_other_rows(kind: str) -> None:
    actions = odd.actions_of(20, 4)
    batch = _batch(kind, 4)
    expected = _singles(kind, actions)
    assert odd.future(batch, actions[:5]) == expected[:5]
    for step, seeds in ((5, [9, 4]), (7, [2, 9]), (9, [9, 9])):
        batch.reset([1, 3], seeds=seeds)
        singles = [odd.KINDS[kind](seed) for seed in seeds]
        for env in singles:
            env.reset()
        found = odd.future(batch, actions[step : step + 2])
        for i, row in enumerate((1, 3)):
            alone = list(odd.steps_of(singles[i], actions[step : step + 2, row]))
            assert [of_rows[row] for of_rows in found] == alone
        for i, of_rows in enumerate(found):
            assert of_rows[0] == expected[step + i][0]
            assert of_rows[2] == expected[step + i][2]


@pytest.mark.parametrize("kind", odd.KINDS)
def test_a_partial_reset_without_seeds_is_the_reset_of_a_single_environment(kind: str) -> None:
    actions = odd.actions_of(20, 3)
    batch = _batch(kind)
    singles = [odd.KINDS[kind](_SEED + row) for row in range(3)]
    masks = np.random.RandomState(0).uniform(size=(20, 3)) < 0.2
    for action, mask in zip(actions, masks, strict=True):
        shown = batch.reset(mask) if mask.any() else None
        for row in np.flatnonzero(mask).tolist():
            begun = singles[row].reset()
            assert shown is not None
            assert odd.facts(shown, row) == odd.facts(begun)
        found = odd.future(batch, action[None])[0]
        assert found == [next(odd.steps_of(env, action[None, i])) for i, env in enumerate(singles)]


@pytest.mark.parametrize("kind", [one for one in odd.KINDS if one not in odd.FROM_BUILD_ONLY])
def test_copies_of_an_instance_are_rows_of_any_seed(kind: str) -> None:
    actions = odd.actions_of(14, 3)
    env = odd.KINDS[kind](_SEED)
    batch = RowsEnvironment(env, 3, 2, seed=_SEED)
    expected = _singles(kind, actions)
    assert odd.future(batch, actions) == expected
    batch.reset(seeds=[_SEED, _SEED + 1, _SEED + 2])
    singles = [odd.KINDS[kind](_SEED + row) for row in range(3)]
    for one in singles:
        one.reset()
    again = [list(odd.steps_of(one, actions[:, row])) for row, one in enumerate(singles)]
    assert odd.future(batch, actions) == [list(step) for step in zip(*again, strict=True)]
    untouched = list(odd.steps_of(env, actions[:, 0]))  # its own rows have not stepped it
    assert untouched == [of_rows[0] for of_rows in expected]


@pytest.mark.parametrize("kind", odd.FROM_BUILD_ONLY[:2])
def test_an_instance_that_cannot_have_another_seed_is_refused(kind: str) -> None:
    with pytest.raises(TypeError, match=r"build\(seed\)"):
        RowsEnvironment(odd.KINDS[kind](0), 2, 1, seed=0)


class _Failing(odd.LastAction):
    """Raises in a hook, once, when it is told to."""

    def __init__(self, random: Any = None) -> None:
        super().__init__(random=random)
        self.at, self.error = "", Exception()
        self.reward: Any = None
        self.change: Callable[[Any], object] | None = None

    def _fail(self, hook: str) -> None:
        if self.at == hook:
            self.at = ""
            raise self.error

    def initialize_episode(self, physics: Any) -> None:
        super().initialize_episode(physics)
        self._fail("initialize_episode")

    def before_step(self, action: Any, physics: Any) -> None:
        self._fail("before_step")
        super().before_step(action, physics)

    def get_reward(self, physics: Any) -> Any:
        self._fail("get_reward")
        return super().get_reward(physics) if self.reward is None else self.reward

    def get_observation(self, physics: Any) -> collections.OrderedDict:
        found = super().get_observation(physics)
        if self.change is not None:
            self.change(found)
        return found


_failing = functools.partial(odd.of_task, _Failing)


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("hook", ["initialize_episode", "before_step", "get_reward"])
@pytest.mark.parametrize("error", [ValueError, StopIteration, KeyboardInterrupt, SystemExit])
def test_an_error_names_its_row_and_every_row_begins_afterwards(
    error: type[BaseException], hook: str, threads: int
) -> None:
    actions = odd.actions_of(6, 4)
    batch: Any = RowsEnvironment(_failing, 4, threads, seed=0)
    odd.future(batch, actions[:2])
    batch.environments[2].task.at, batch.environments[2].task.error = hook, error("mine")
    with pytest.raises(error, match="mine") as raised:
        batch.reset([2]) if hook == "initialize_episode" else batch.step(actions[2])
    assert "row 2" in raised.value.__notes__[0]
    assert batch.begins.all()
    assert (batch.step(actions[3]).step_type == 0).all()
    assert (batch.step(actions[4]).step_type == 1).all()


def _two(build: Any) -> tuple[Any, Any]:
    batch, reference = (RowsEnvironment(build, 3, 2, seed=0) for _ in range(2))
    return batch, reference


def test_a_row_that_diverges_ends_and_others_continue() -> None:
    actions = odd.actions_of(9, 3)
    batch, reference = _two(_failing)
    for one in (batch, reference):
        odd.future(one, actions[:2])
    shown = batch.step(actions[2]).observation
    reference.step(actions[2])
    task = batch.environments[1].task
    task.at, task.error = "get_reward", control.PhysicsError("mine")
    time_step, expected = batch.step(actions[3]), reference.step(actions[3])
    assert time_step.step_type.tolist() == [1, 2, 1]
    assert (time_step.reward[1], time_step.discount[1]) == (0.0, 0.0)
    assert batch.diverged.tolist() == [False, True, False]
    assert not batch.timed_out.any()
    for name, values in time_step.observation.items():
        np.testing.assert_array_equal(values[1], shown[name][1])
        np.testing.assert_array_equal(values[[0, 2]], expected.observation[name][[0, 2]])
    found, others = odd.future(batch, actions[4:]), odd.future(reference, actions[4:])
    assert [(row[0], row[2]) for row in found] == [(row[0], row[2]) for row in others]
    assert [row[1][0] for row in found] == [0, 1, 1, 1, 1]


def test_divergence_is_raised_with_its_rows_where_that_was_asked_for() -> None:
    batch: Any = RowsEnvironment(_failing, 3, 2, seed=0, on_divergence="raise")
    batch.reset()
    task = batch.environments[1].task
    task.at, task.error = "get_reward", control.PhysicsError("mine")
    with pytest.raises(control.PhysicsError, match=r"rows \[1\]"):
        batch.step(np.zeros((3, 1)))
    assert batch.begins.all()


@pytest.mark.parametrize("reward", ["1.0", np.ones(1), np.ones(2), 1j, [1.0], object()])
def test_a_reward_that_is_no_number_is_refused_with_its_row(reward: Any) -> None:
    batch: Any = RowsEnvironment(_failing, 2, 1, seed=0)
    batch.reset()
    batch.environments[1].task.reward = reward
    with pytest.raises(TypeError, match="the reward of a step is") as raised:
        batch.step(np.zeros((2, 1)))
    assert "row 1" in raised.value.__notes__[0]


@pytest.mark.parametrize(
    "change",
    [
        lambda seen: seen.update(position=np.zeros(2)),
        lambda seen: seen.update(position=np.zeros(1, np.float32)),
        lambda seen: seen.update(position=None),
        lambda seen: seen.update(position="text"),
        lambda seen: seen.update(more=np.zeros(1)),
        lambda seen: seen.pop("position"),
    ],
)
def test_an_observation_of_another_form_is_refused_with_its_row(change: Any) -> None:
    batch: Any = RowsEnvironment(_failing, 2, 1, seed=0)
    batch.reset()
    batch.environments[1].task.change = change
    with pytest.raises(ValueError, match="observation") as raised:
        batch.step(np.zeros((2, 1)))
    assert "row 1" in raised.value.__notes__[0]
    assert batch.begins.all()


@pytest.mark.parametrize("build", [_failing, odd.Catch])
def test_rows_that_do_not_fit_are_refused_before_memory_is_taken(build: Any) -> None:
    with pytest.raises(MemoryError, match="num_envs is 1000000000, which takes"):
        RowsEnvironment(build, 10**9, seed=0)


def _heavy(seed: int, mass: float = 1.0, length: int = 1) -> Any:
    env = odd.environment(odd.LastAction, seed)
    env.physics.model.body_mass[1] = mass * (1 + seed)
    env.task.length = length
    env.task.get_observation = functools.partial(_observed, env.task)
    return env


def _observed(task: Any, physics: Any) -> Any:
    return {**type(task).get_observation(task, physics), "zeros": np.zeros(task.length)}


def test_contexts_reach_the_function_and_stay_with_their_rows() -> None:
    contexts = [{}, {"mass": 2.0}, {"mass": 3.0}]
    batch: Any = RowsEnvironment(_heavy, 3, 2, seed=0, contexts=contexts)
    masses = [env.physics.model.body_mass[1] for env in batch.environments]
    assert masses == [1.0, 4.0, 9.0]
    batch.reset([1, 2], seeds=[5, 0])
    masses = [env.physics.model.body_mass[1] for env in batch.environments]
    assert masses == [1.0, 12.0, 3.0]


def test_wrong_contexts_are_refused_with_the_row() -> None:
    with pytest.raises(ValueError, match=r"row 1, made with {'length': 2}, has observation"):
        RowsEnvironment(_heavy, 2, seed=0, contexts=[{}, {"length": 2}])
    with pytest.raises(TypeError, match="keyword") as raised:
        RowsEnvironment(_heavy, 2, seed=0, contexts=[{}, {"weight": 2}])
    assert "row 1" in raised.value.__notes__[0]
    with pytest.raises(ValueError, match="there are 1 contexts; expected 2"):
        RowsEnvironment(_heavy, 2, seed=0, contexts=[{}])
    for wrong in ({}, "ab", 5, [1, 2], (one for one in ({}, {}))):
        with pytest.raises(TypeError, match="expected a"):
            RowsEnvironment(_heavy, 2, seed=0, contexts=wrong)  # pyright: ignore
    with pytest.raises(TypeError, match="an environment was given"):
        RowsEnvironment(odd.environment(), 2, seed=0, contexts=[{}, {}])


def test_values_that_were_set_stay_when_a_row_is_made_again() -> None:
    batch = _batch("a log")
    batch.set_attr("limit", [1, 2, 3])
    batch.reset(seeds=[7, 7, 7])
    assert batch.get_attr("limit") == [1, 2, 3]
    assert batch.call("control_timestep") == [0.02] * 3
    with pytest.raises(ValueError, match="there are 2 values of 'limit'; expected 3"):
        batch.set_attr("limit", [1, 2])


@pytest.mark.parametrize(
    ("wrong", "error"),
    [
        ({"num_envs": 0}, ValueError),
        ({"num_envs": True}, ValueError),
        ({"num_threads": 0}, ValueError),
        ({"seed": -1}, ValueError),
        ({"seed": 2**32 - 1}, ValueError),
        ({"seed": "a"}, TypeError),
        ({"on_divergence": "stop"}, ValueError),
    ],
)
def test_wrong_numbers_are_refused_by_name(wrong: dict[str, Any], error: type[Exception]) -> None:
    with pytest.raises(error, match=f"{next(iter(wrong))} is"):
        RowsEnvironment(_failing, **{"num_envs": 2, **wrong})


def test_a_closed_batch_says_so() -> None:
    batch = _batch("a log")
    snapshot = batch.snapshot()
    batch.close()
    batch.close()
    for use in (
        lambda: batch.step(np.zeros((3, 1))),
        batch.reset,
        batch.snapshot,
        lambda: batch.restore(snapshot),
        batch.render,
    ):
        with pytest.raises(RuntimeError, match="closed"):
            use()


def test_two_threads_at_once_are_refused() -> None:
    batch: Any = RowsEnvironment(_Waiting, 2, 1, seed=0)
    batch.reset()
    began, go_on = threading.Event(), threading.Event()
    for env in batch.environments:
        env.began, env.go_on = began, go_on
    other = threading.Thread(target=batch.step, args=(np.zeros((2, 1)),))
    other.start()
    began.wait()
    with pytest.raises(RuntimeError, match="two threads at once"):
        batch.step(np.zeros((2, 1)))
    go_on.set()
    other.join()
    assert (batch.step(np.zeros((2, 1))).step_type == 1).all()


class _Waiting(odd.Catch):
    began: Any = None
    go_on: Any = None

    def step(self, action: Any) -> Any:
        if self.began is not None:
            self.began.set()
            self.go_on.wait()
        return super().step(action)


class _Signalling(odd.Catch):
    """Interrupts the process in the third step of the second row."""

    def __init__(self, seed: int) -> None:
        super().__init__(seed)
        self.is_last = seed == 1

    def step(self, action: Any) -> Any:
        if self.is_last and self._steps == 2:
            signal.raise_signal(signal.SIGINT)
        return super().step(action)


@pytest.mark.parametrize("threads", [1, 2])
def test_ctrl_c_during_a_step_leaves_all_rows_whole(threads: int) -> None:
    batch = RowsEnvironment(_Signalling, 4, threads, seed=0)
    batch.reset()
    with pytest.raises(KeyboardInterrupt):
        odd.future(batch, odd.actions_of(4, 4))
    assert batch.begins.all()
    assert (batch.step(np.zeros((4, 1))).step_type == 0).all()


class _Global(odd.Catch):
    def step(self, action: Any) -> Any:
        return super().step([float(action[0]) + np.random.normal()])


class _Shared(odd.Catch):
    stream = np.random.RandomState(0)

    def step(self, action: Any) -> Any:
        return super().step([float(action[0]) + self.stream.normal()])


class _Python(odd.Catch):
    def reset(self) -> Any:
        self._bias = random.random()
        return super().reset()


@pytest.mark.parametrize(
    ("build", "name"),
    [
        (_Global, "NumPy's global stream"),
        (_Python, "the stream of random"),
        (_Shared, "_Shared.stream"),
    ],
)
def test_rows_that_draw_from_a_shared_stream_are_stepped_on_one_thread_in_order(
    build: Any, name: str
) -> None:
    np.random.seed(0)
    random.seed(0)
    before = np.random.get_state()[1][:3].tolist(), random.getstate()  # pyright: ignore
    batch = RowsEnvironment(build, 4, 2, seed=0)
    assert batch.draws_globally == name
    assert (np.random.get_state()[1][:3].tolist(), random.getstate()) == before  # pyright: ignore
    assert batch._threads.num_threads == 1
    _Shared.stream.seed(0)
    found = odd.future(batch, odd.actions_of(4, 4))
    np.random.seed(0)
    random.seed(0)
    _Shared.stream.seed(0)
    singles = [build(row) for row in range(4)]
    for step, actions in enumerate(odd.actions_of(4, 4)):
        time_steps = [env.step(action) for env, action in zip(singles, actions, strict=True)]
        assert found[step] == [odd.facts(one) for one in time_steps]


def test_64_rows_are_their_single_environments() -> None:
    for kind in ("a last action", "a log"):
        actions = odd.actions_of(odd.STEPS + 3, 64)
        assert odd.future(_batch(kind, 64, 2), actions) == _singles(kind, actions)


def test_snapshots_pass_between_rows_and_single_environments() -> None:
    for kind in ("a plain task", "a last action", "queues", "a log"):
        actions = odd.actions_of(14, 3)
        batch = _batch(kind)
        odd.future(batch, actions[:3])
        snapshot = batch.snapshot([1])
        expected = [of_rows[1] for of_rows in odd.future(batch, actions[3:])]
        single = odd.KINDS[kind](99)
        single.restore(snapshot)
        back = single.snapshot()
        assert list(odd.steps_of(single, actions[3:, 1])) == expected
        batch.restore(back, [2])
        actions[:, 2] = actions[:, 1]
        assert [of_rows[2] for of_rows in odd.future(batch, actions[3:])] == expected


def test_rows_and_a_vectorised_batch_exchange_snapshots_of_a_plain_task() -> None:
    env = odd.environment(odd.Pole, 0)
    rows = RowsEnvironment(env, 3, 2, seed=0)
    vectorised = BatchEnvironment.from_environment(env, 3, seed=50)
    actions = odd.actions_of(16, 3)
    odd.future(rows, actions[:4])
    vectorised.restore(rows.snapshot())
    back = vectorised.snapshot()
    expected = odd.future(rows, actions[4:])
    assert odd.future(vectorised, actions[4:]) == expected
    rows.restore(back)
    assert odd.future(rows, actions[4:]) == expected


def test_rows_have_what_a_vectorised_batch_of_the_suite_has() -> None:
    env = suite.load("humanoid", "walk", task_kwargs={"random": 0, "time_limit": 0.1})
    rows = RowsEnvironment(env, 3, 2, seed=4)
    vectorised = BatchEnvironment.from_environment(env, 3, seed=4)
    actions = np.random.RandomState(0).uniform(-1, 1, (9, *rows.action_spec().shape))
    for action in actions:
        assert odd.future(rows, action[None]) == odd.future(vectorised, action[None])
        is_mid = rows._steps > 0
        assert not is_mid.any() or rows.reward_terms.keys() == vectorised.reward_terms.keys()
        for name, values in rows.reward_terms.items():
            found, expected = (
                np.array(values)[is_mid],
                np.array(vectorised.reward_terms[name])[is_mid],
            )
            np.testing.assert_array_equal(found, expected)
        np.testing.assert_array_equal(rows.timed_out, vectorised.timed_out)
        np.testing.assert_array_equal(rows.begins, vectorised.begins)
    assert rows.step_limit == vectorised.step_limit
    assert rows.control_timestep() == vectorised.control_timestep()
    assert rows.name == vectorised.name


def test_rows_with_pictures_are_single_environments_with_pictures() -> None:
    pixels = {"camera": "side", "height": 8, "width": 8, "frame_stack": 3}
    build = functools.partial(_pictured, pixels)
    actions = odd.actions_of(odd.STEPS + 3, 2)
    batch = RowsEnvironment(build, 2, 1, seed=0)
    singles = [build(row) for row in range(2)]
    for action in actions:
        found = odd.future(batch, action[None])[0]
        assert found == [next(odd.steps_of(env, action[None, i])) for i, env in enumerate(singles)]
    snapshot = batch.snapshot()
    expected = odd.future(batch, actions[:4])
    batch.restore(snapshot)
    assert odd.future(batch, actions[:4]) == expected


def _pictured(pixels: Any, seed: int) -> Any:
    return odd.environment(odd.LastAction, seed, pixels=pixels)


def test_a_batch_goes_on_after_a_fork() -> None:
    batch = _batch("a log", threads=2)
    actions = odd.actions_of(12, 3)
    odd.future(batch, actions[:3])
    twin = copy.deepcopy(batch)
    expected = odd.future(twin, actions[3:])
    reader, writer = os.pipe()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of forking with threads
        child = os.fork()
    if not child:  # pragma: no cover (another process)
        is_equal = odd.future(batch, actions[3:]) == expected
        os.write(writer, b"1" if is_equal else b"0")
        os._exit(0)
    assert os.read(reader, 1) == b"1"
    os.waitpid(child, 0)
    os.close(reader)
    os.close(writer)
    assert odd.future(batch, actions[3:]) == expected


def test_a_pickle_goes_on_in_another_process() -> None:
    kinds = ["a last action", "a log", "queues", "a distracting wrapper", "scaled actions"]
    kinds += ["a perturbed model", "a walk on a line"]
    actions = odd.actions_of(12, 3)
    saved, expected = [], []
    for kind in kinds:
        batch = _batch(kind)
        odd.future(batch, actions[:3])
        saved.append(pickle.dumps(batch))
        expected.append(odd.future(batch, actions[3:]))
    context = multiprocessing.get_context("spawn")
    with context.Pool(1) as pool:
        assert pool.map(_continued, [(one, actions[3:]) for one in saved]) == expected


def _continued(given: tuple[bytes, np.ndarray]) -> list[list[odd.Facts]]:
    batch = pickle.loads(given[0])
    return odd.future(batch, given[1])


def test_environments_that_share_a_part_are_refused() -> None:
    env = odd.environment(odd.LastAction)
    task, catch = odd.LastAction(random=0), odd.Catch(0)
    made: Any = functools.partial(_given, task)
    for build, what in (
        (lambda seed: env, "task"),
        (lambda seed: odd.environment(made), "task"),
        (lambda seed: odd.Repeating(env), "task"),
        (lambda seed: catch, "environment"),
    ):
        with pytest.raises(ValueError, match=f"row 0 has the {what} of another environment"):
            RowsEnvironment(build, 2, seed=0)


def _given(task: Any, random: Any) -> Any:
    return task


@pytest.mark.parametrize("kind", ["scaled actions", "noisy actions", "a last action"])
def test_rows_that_begin_take_any_action(kind: str) -> None:
    batch = _batch(kind)
    actions = odd.actions_of(odd.STEPS + 1, 3)
    odd.future(batch, actions)
    assert batch.begins.all()
    assert (batch.step(np.full((3, 1), np.nan)).step_type == 0).all()
    with pytest.raises(ValueError, match=r"not finite in rows \[0, 1, 2\]"):
        batch.step(np.full((3, 1), np.nan))


def test_a_row_that_is_cut_off_at_the_limit_is_reset_although_its_environment_goes_on() -> None:
    batch = RowsEnvironment(odd.Catch, 2, 1, seed=0)
    batch.step_limit = 3
    kinds = [batch.step(np.zeros((2, 1))).step_type.tolist() for _ in range(9)]
    assert kinds == [[0, 0], [1, 1], [1, 1], [2, 2]] * 2 + [[0, 0]]


def test_seeds_may_be_an_array() -> None:
    build = functools.partial(odd.of_task, odd.Queues)
    for count in (1, 3):
        batch = RowsEnvironment(build, count, 1, seed=9)
        seeds: Any = np.arange(count)
        found = batch.reset(seeds=seeds).observation["position"]
        singles = [build(seed).reset().observation["position"] for seed in range(count)]
        np.testing.assert_array_equal(found, singles)


def test_a_row_with_attributes_of_its_own_is_noticed_before_any_is_restored() -> None:
    batch = RowsEnvironment(functools.partial(odd.of_task, odd.Pole), 2, 1, seed=0)
    batch.reset()
    snapshot = batch.snapshot()
    for _ in range(2):
        batch.step(np.ones((2, 1)))
    vars(batch.environments[1])["tag"] = 1
    with pytest.raises(ValueError, match=r"expected copies .*; nothing was restored"):
        batch.restore(snapshot)
    assert batch.snapshot().step_count.tolist() == [2, 2]
