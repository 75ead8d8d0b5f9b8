"""Batches on a device: users' own tasks, starts, the rows as numbers, and room in memory."""

from typing import Any

import numpy as np
import pytest
from dm_env import specs

from limberjack import suite
from limberjack.gpu.sizes import Sizes
from limberjack.rl import control, endings
from limberjack.rl.batch import BatchEnvironment
from limberjack.suite import cheetah

from .on_device import as_numpy, torch

pytestmark = pytest.mark.gpu
batches: Any = pytest.importorskip("limberjack.gpu.batch")
vector: Any = pytest.importorskip("limberjack.gpu.vector")


class _Glide(cheetah.Cheetah):
    """Maps one action to all actuators, reads forces, ends episodes, and has a plain reward."""

    lowest = -0.05  # metres; episodes end below it

    def action_spec(self, physics: Any) -> Any:
        return specs.BoundedArray((1,), float, -1.0, 1.0)

    def before_step(self, action: Any, physics: Any) -> None:
        physics.set_control(np.concatenate([action, -action] * 3, axis=-1))

    def get_observation(self, physics: Any) -> Any:
        observation = super().get_observation(physics)
        observation["forces"] = physics.data.qfrc_actuator.copy()
        return observation

    def get_reward(self, physics: Any) -> Any:
        return 2.0 * physics.data.qpos[..., 0]

    def get_termination(self, physics: Any) -> Any:
        ends = physics.data.qpos[..., 1] < self.lowest
        if physics.num_envs is None:
            return 0.0 if ends else None
        return np.where(ends, 0.0, np.nan)


def _environment(task: Any) -> control.Environment:
    physics = suite.load("cheetah", "run").physics
    return control.Environment(physics, task, time_limit=1.0)


def _batch(task: Any, rows: int = 6, repeat: int = 1, begins_next: bool = True) -> Any:
    options = batches.Options(Sizes(32, 96), 0.0, False, begins_next, repeat)
    return batches.DeviceBatch(_environment(task), rows, torch.device("cpu"), 0, options)


class _Lasting(_Glide):
    """The same, with episodes of different lengths: two of six end in the first five steps."""

    lowest = -0.115


class _Termed(_Lasting):
    """The same with terms of the reward."""

    get_reward = cheetah.Cheetah.get_reward


@pytest.mark.parametrize("kind", [_Lasting, _Termed])
@pytest.mark.parametrize("repeat", [2, 3])
def test_a_repeated_action_gives_the_control_steps_until_the_episode_ends(
    kind: Any, repeat: int
) -> None:
    ours = _batch(kind(random=0), repeat=repeat)
    plain = _batch(kind(random=0), begins_next=False)
    ours.reset()
    plain.reset()
    action = torch.from_numpy(np.linspace(-1, 1, 6, dtype=np.float32)[:, None])
    ended, ends_early = np.zeros(6, bool), False
    while not ended.all():
        running = ~ended
        reward, terms = np.zeros(6, np.float32), np.zeros(6, np.float32)
        observation, states = np.zeros((6, 9)), np.zeros((6, ours.starts.width))
        expected: Any = None
        for number in range(repeat):
            expected = plain.step(action)
            reward[~ended] += as_numpy(expected.reward)[~ended]
            for values in expected.terms.values():
                terms[~ended] += as_numpy(values)[~ended]
            observation[~ended] = as_numpy(expected.observation["forces"])[~ended]
            states[~ended] = as_numpy(plain.read_rows())[~ended]
            ends_early |= number < repeat - 1 and bool(
                (as_numpy(expected.ending.last) > ended).any()
            )
            ended = as_numpy(expected.ending.last)
        outcome = ours.step(action)
        for name in ("last", "terminated", "truncated"):
            found = as_numpy(getattr(outcome.ending, name))[running]
            np.testing.assert_array_equal(found, as_numpy(getattr(expected.ending, name))[running])
        np.testing.assert_array_equal(as_numpy(outcome.reward)[running], reward[running])
        for values in outcome.terms.values():
            np.testing.assert_array_equal(as_numpy(values)[running], terms[running])
        forces = as_numpy(outcome.observation["forces"])
        np.testing.assert_array_equal(forces[running], observation[running])
        np.testing.assert_array_equal(as_numpy(ours.read_rows())[running], states[running])
        assert not as_numpy(outcome.reward)[~running & as_numpy(outcome.begun)].any()
        assert not as_numpy(ours.counter.steps)[as_numpy(outcome.begun)].any()
    assert ends_early
    ours.close()
    plain.close()


def test_a_row_that_diverges_ends_before_its_action_is_repeated() -> None:
    batch = _batch(_Termed(random=0), repeat=3)
    batch.reset()
    action = torch.zeros(6, 1)
    action[2] = torch.nan
    outcome = batch.step(action)
    np.testing.assert_array_equal(as_numpy(outcome.diverged), np.arange(6) == 2)
    np.testing.assert_array_equal(as_numpy(batch.counter.steps), [3, 3, 1, 3, 3, 3])
    assert as_numpy(outcome.reward)[2] == 0
    assert as_numpy(outcome.ending.terminated)[2]
    following = batch.step(torch.zeros(6, 1))
    np.testing.assert_array_equal(as_numpy(following.begun), np.arange(6) == 2)
    np.testing.assert_array_equal(as_numpy(batch.counter.steps), [6, 6, 0, 6, 6, 6])
    batch.close()


def test_a_task_of_ones_own_runs_as_it_is() -> None:
    ours = _batch(_Glide(random=0))
    theirs = BatchEnvironment.from_environment(_environment(_Glide(random=0)), 6, 1, seed=0)
    found, expected = ours.reset(), theirs.reset()
    np.testing.assert_allclose(as_numpy(found["forces"]), expected.observation["forces"], atol=1e-5)
    action = np.linspace(-1, 1, 6, dtype=np.float32)[:, None]
    ended = 0
    for step in range(25):
        outcome, expected = ours.step(torch.from_numpy(action)), theirs.step(action)
        np.testing.assert_array_equal(as_numpy(outcome.ending.last), expected.step_type == 2)
        ended += int(as_numpy(outcome.ending.terminated).sum())
        assert outcome.terms == {}
        assert outcome.success is None
        if step < 5:
            np.testing.assert_allclose(as_numpy(outcome.reward), expected.reward, atol=1e-4)
            forces = expected.observation["forces"]
            np.testing.assert_allclose(
                as_numpy(outcome.observation["forces"]), forces, rtol=1e-3, atol=1e-3
            )
        if ended:
            break
    assert ended
    ours.close()


@pytest.mark.parametrize(
    ("code", "message"),
    [
        (lambda physics: float(physics.data.qpos[0, 0]), r"float\(\) would take"),
        (lambda physics: np.asarray(physics.data.qpos)[:, 0], r"np\.asarray\(\) would take"),
        (lambda physics: np.median(physics.data.qpos, axis=-1), r"np\.median is not available"),
        (lambda physics: physics.data.ncon * 1.0, "has no 'ncon'"),
        (lambda physics: physics.data.qpos @ np.ones(7), "size mismatch|shapes|must match"),
    ],
)
def test_code_that_leaves_the_protocols_is_refused_with_the_tasks_name(
    code: Any, message: str
) -> None:
    class Wrong(_Glide):
        def get_reward(self, physics: Any) -> Any:
            return code(physics)

    with pytest.raises(TypeError, match=f"task Wrong cannot run on a device: .*{message}"):
        _batch(Wrong(random=0))


def test_a_lack_of_memory_is_not_the_codes_fault() -> None:
    class Greedy(_Glide):
        def get_reward(self, physics: Any) -> Any:
            raise torch.cuda.OutOfMemoryError("no room")

    with pytest.raises(torch.cuda.OutOfMemoryError, match="no room"):
        _batch(Greedy(random=0))


def test_sizes_of_sites_that_sensors_measure_within_cannot_differ() -> None:
    environment = suite.load("finger", "turn_easy")
    initialize = type(environment.task).initialize_episode

    class Grown(type(environment.task)):
        def initialize_episode(self, physics: Any) -> None:
            initialize(self, physics)
            physics.named.model.site_size["touchtop", 0] *= 2

    environment._task = Grown(0.07, random=0)
    options = batches.Options(Sizes(32, 64), 0.0, False, True)
    batch = batches.DeviceBatch(environment, 2, torch.device("cpu"), 0, options)
    with pytest.raises(ValueError, match="episodes set site_size of sites that sensors measure"):
        batch.reset()


def _ring() -> Any:
    return batches._Ring(torch.arange(5.0)[:, None])


def test_rows_of_a_mask_take_the_next_starts_in_order() -> None:
    starts = _ring()
    for mask, expected in (
        ([0, 1, 0, 1], [0, 1]),
        ([1, 1, 1, 0], [2, 3, 4]),
        ([0, 0, 1, 1], [0, 1]),
    ):
        chosen = torch.tensor(mask, dtype=torch.bool)
        np.testing.assert_array_equal(as_numpy(starts.take(chosen)[chosen][:, 0]), expected)


def test_an_empty_mask_takes_none() -> None:
    starts = _ring()
    starts.take(torch.zeros(4, dtype=torch.bool))
    assert starts.head == 0


@pytest.mark.parametrize("counts", [(1,) * 13, (3, 4, 5), (5, 5), (7, 6), (13,)])
def test_the_oldest_starts_are_replaced_first(counts: tuple[int, ...]) -> None:
    starts, expected, tail, number = _ring(), np.arange(5.0), 0, 10.0
    for count in counts:
        new = np.arange(number, number + count, dtype=np.float32)
        starts.replace(new[:, None])
        for value in new:
            expected[tail] = value
            tail, number = (tail + 1) % 5, number + 1
    np.testing.assert_array_equal(as_numpy(starts.values[:, 0]), expected)
    assert starts.tail == tail


def test_rows_of_a_mask_are_written_and_the_others_left_alone() -> None:
    envs = vector.load_vector("manipulator", "bring_ball", 3, device="cpu", seed=0)
    envs.reset()
    rows, batch = envs.batch._rows, envs.batch
    before = as_numpy(rows.read()).copy()
    assert before.shape == (3, batch.starts.width)
    drawn = batch.starts.draw([0, 1, 2])
    for part in batch.starts.parts:
        if part.kind != "static":  # the others move, and are computed on the device
            columns = part.columns
            np.testing.assert_array_equal(before[:, columns], drawn[:, columns], part.name)
    new = batch.starts.draw([7, 8, 9])
    rows.write(torch.tensor([False, True, False]), torch.from_numpy(new))
    after = as_numpy(rows.read())
    np.testing.assert_array_equal(after[1], new[1])
    np.testing.assert_array_equal(after[[0, 2]], before[[0, 2]])
    rows.write_state(torch.tensor([True, False, False]), torch.from_numpy(batch.starts.default()))
    after = batch.starts.of_rows(as_numpy(rows.read()))
    assert not after["qpos"][0, :8].any()
    kept = batch.starts.of_rows(before)
    for name in ("body_pos", "geom_xpos"):  # the model's fields, and poses that follow from them
        np.testing.assert_array_equal(after[name][0], kept[name][0])
    envs.close()


def test_what_fits_passes_and_what_does_not_is_refused_with_the_number_that_would(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    device = torch.device("cpu")
    assert batches._free_memory(device) > 0
    monkeypatch.setattr(batches, "_free_memory", lambda _: 1e9)
    batches._check_memory(100, 9_000_000, device)
    with pytest.raises(MemoryError, match=r"takes 9\.0 GB on cpu, where 1\.0 GB are free: at most"):
        batches._check_memory(1000, 9_000_000, device)


_ROWS, _LIMIT, _STEPS = 64, 7, 60  # of the counter


def test_the_counter_counts_as_that_on_the_cpu() -> None:
    random = np.random.RandomState(0)
    ours = batches.Counter(_ROWS, _LIMIT, "cpu")
    theirs = endings.Counter(_ROWS, _LIMIT)
    begins = np.zeros(_ROWS, bool)
    for _ in range(_STEPS):
        reward = random.uniform(size=_ROWS).astype(np.float32)
        diverged = (random.uniform(size=_ROWS) < 0.05) & ~begins
        termination = np.where(random.uniform(size=_ROWS) < 0.1, 0.0, np.nan)
        begun = ours.ended.clone()
        shown, ending = ours.count(
            begun, *map(torch.from_numpy, (diverged, reward.copy(), termination))
        )
        expected, last = theirs.count(begins, diverged, reward, termination, {})
        np.testing.assert_array_equal(as_numpy(begun), begins)
        np.testing.assert_array_equal(as_numpy(shown), expected.reward)
        np.testing.assert_array_equal(as_numpy(ending.last), expected.step_type == 2)
        truncated = last & theirs.at_limit & ~diverged
        np.testing.assert_array_equal(as_numpy(ending.truncated), truncated)
        np.testing.assert_array_equal(as_numpy(ending.terminated), last & ~truncated)
        np.testing.assert_array_equal(as_numpy(ours.steps), theirs.steps)
        begins = last


def test_a_row_that_waits_keeps_how_it_ended_and_earns_nothing() -> None:
    counter = batches.Counter(2, 3, "cpu")
    none, ones = torch.zeros(2, dtype=torch.bool), torch.ones(2)
    for _ in range(4):
        counter.count(none, torch.tensor([False, True]), ones, None)
    reward, ending = counter.count(none, torch.tensor([False, True]), ones, None)
    np.testing.assert_array_equal(as_numpy(ending.truncated), [True, False])
    np.testing.assert_array_equal(as_numpy(ending.terminated), [False, True])
    np.testing.assert_array_equal(as_numpy(reward), [0, 0])
    np.testing.assert_array_equal(as_numpy(counter.steps), [3, 1])
    counter.begin(torch.tensor([True, False]))
    reward, ending = counter.count(none, none, ones, None)
    np.testing.assert_array_equal(as_numpy(ending.last), [False, True])
    np.testing.assert_array_equal(as_numpy(reward), [1, 0])
