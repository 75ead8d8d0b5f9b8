"""Datasets as episodes, as batches of transitions, and as figures."""

import dataclasses
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from dm_env import specs

from limberjack import data, suite
from limberjack.data import Batch, Dataset, inform, load, replay
from limberjack.episodes.parquet import Shard
from limberjack.episodes.places import Place
from limberjack.rl import control
from limberjack.suite import pendulum

from .collected import assert_equal, copy, folder_of, hashes, path_of

_FORMAT_1 = Path(__file__).parent / "format1"


def test_episodes_come_in_the_order_of_their_seeds(pendulums: Dataset) -> None:
    assert len(pendulums) == 70
    assert pendulums.steps == 700
    assert pendulums.seeds == list(range(70)) == [episode.seed for episode in pendulums]
    assert_equal(pendulums.episode(66), list(pendulums)[66])
    with pytest.raises(KeyError, match="no episode of seed 70; the first one has seed 0"):
        pendulums.episode(70)


def _all(batches: list[Batch], name: str) -> np.ndarray:
    parts = [getattr(batch, name) for batch in batches]
    return np.concatenate([p["velocity"] if isinstance(p, dict) else p for p in parts])


@pytest.mark.parametrize("size", [1, 37, 640, 700, 1000])
def test_batches_in_order_have_every_transition_once(size: int, pendulums: Dataset) -> None:
    batches = list(pendulums.batches(size))
    assert [len(batch) for batch in batches[:-1]] == [size] * (len(batches) - 1)
    assert sum(map(len, batches)) == 700
    episodes = list(pendulums)
    observed = [episode.observations["velocity"] for episode in episodes]
    np.testing.assert_array_equal(
        _all(batches, "observations"), np.concatenate([v[:-1] for v in observed])
    )
    np.testing.assert_array_equal(
        _all(batches, "next_observations"), np.concatenate([v[1:] for v in observed])
    )
    for name in ("actions", "rewards", "terminated", "truncated"):
        expected = np.concatenate([getattr(episode, name) for episode in episodes])
        np.testing.assert_array_equal(_all(batches, name), expected)


def test_shuffled_batches_have_the_same_transitions_in_another_order(pendulums: Dataset) -> None:
    ordered = _all(list(pendulums.batches(50)), "actions")
    once, again, other = (
        _all(list(pendulums.batches(50, seed=seed)), "actions") for seed in (0, 0, 1)
    )
    np.testing.assert_array_equal(once, again)
    assert (once != other).any()
    assert (once != ordered).any()
    np.testing.assert_array_equal(np.sort(once, axis=0), np.sort(ordered, axis=0))


def test_a_batch_may_be_changed_and_an_episode_may_not(pendulums: Dataset) -> None:
    batch = next(pendulums.batches(10))
    batch.observations["velocity"][:] = 0
    batch.actions[:] = 0
    with pytest.raises(ValueError, match="read-only"):
        pendulums.episode(0).rewards[:] = 0


def test_files_are_read_when_they_are_needed(
    pendulums: Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[Place] = []
    read = Shard.opened

    def counting(shard: Shard, *of: Sequence[str]) -> object:
        opened.append(shard.path)
        return read(shard, *of)

    monkeypatch.setattr(Shard, "opened", counting)
    dataset = load(folder_of(pendulums))
    assert opened == []
    next(iter(dataset))
    next(dataset.batches(10))
    assert opened == [dataset.shards[0].path] * 2


@pytest.mark.parametrize("n", [1, 2, 3, 7, 69, 70])
def test_parts_have_every_episode_once(n: int, pendulums: Dataset) -> None:
    parts = [pendulums.part(k, n) for k in range(n)]
    assert [seed for part in parts for seed in part.seeds] == pendulums.seeds
    assert {len(part) for part in parts} <= {70 // n, 70 // n + 1}
    assert sum(part.steps for part in parts) == 700


def test_a_part_is_a_dataset(pendulums: Dataset) -> None:
    part = pendulums.part(1, 4)  # of one of the files
    assert (len(part), len(part.shards)) == (18, 1)
    assert [episode.seed for episode in part] == part.seeds == list(range(17, 35))
    assert sum(map(len, part.batches(50, seed=0))) == 180
    assert part.episode(20).seed == 20
    with pytest.raises(KeyError, match="no episode of seed 16"):
        part.episode(16)
    assert len(pendulums.part(3, 4).shards) == 2
    assert part.part(0, 18).seeds == [17]
    assert replay(part, num_threads=1) is None


@pytest.mark.parametrize(("k", "n"), [(2, 2), (-1, 2), (0, 71), (0, 0)])
def test_a_part_without_episodes_is_refused(k: int, n: int, pendulums: Dataset) -> None:
    with pytest.raises(ValueError, match=f"there is no part {k} of {n} in 70 episodes"):
        pendulums.part(k, n)


@pytest.mark.parametrize("size", [0, -1, 2.5])
def test_a_batch_has_at_least_one_transition(size: int, pendulums: Dataset) -> None:
    with pytest.raises(ValueError, match="size is"):
        next(pendulums.batches(size))


def test_an_episode_is_found_by_its_number(pendulums: Dataset) -> None:
    assert_equal(pendulums[3], pendulums.episode(3))
    assert_equal(pendulums[-1], pendulums.episode(69))
    part = pendulums.part(1, 4)
    assert_equal(part[0], pendulums.episode(17))
    for index in (70, -71):
        with pytest.raises(IndexError, match=f"index {index} is out of range; there are 70 epi"):
            pendulums[index]


def test_transitions_are_found_by_their_numbers(
    pendulums: Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    dataset = pendulums.select(discount=0.9, n_step=3)
    whole = next(dataset.batches(700))
    order = np.random.default_rng(0).permutation(700)[:200]
    order = np.concatenate([order, order[:5], [699, 0]])
    for indices in (order, order - 700, order.astype(np.uint16), order.astype(np.uint64)):
        found = dataset.transitions(indices)
        for field in dataclasses.fields(Batch):
            ours, theirs = getattr(found, field.name), getattr(whole, field.name)
            if isinstance(ours, dict):
                for name in ours:
                    np.testing.assert_array_equal(ours[name], theirs[name][order])
            else:
                np.testing.assert_array_equal(ours, theirs[order])
    for few in (np.array([0, 5, 100], np.uint8), np.array([0, -1, -128], np.int8)):
        chosen = whole.actions[few.astype(int)]
        np.testing.assert_array_equal(dataset.transitions(few).actions, chosen)
    part = pendulums.part(1, 4)
    np.testing.assert_array_equal(part.transitions([0, -1]).actions, whole.actions[[170, 349]])
    monkeypatch.setattr(Shard, "opened", None)  # they are in memory now
    assert len(dataset.transitions(list(order[:3]))) == 3


@pytest.mark.parametrize(
    ("indices", "error", "message"),
    [
        ([0, 700], IndexError, "index 700 is out of range; there are 700 transitions"),
        ([-701], IndexError, "index -701 is out of range; there are 700 transitions"),
        ([0.5], TypeError, "indices are float64; expected whole numbers"),
        ([True], TypeError, "indices are bool; expected whole numbers"),
        ([], ValueError, r"indices have shape \(0,\); expected \(N,\), at least one"),
        (5, ValueError, r"indices have shape \(\); expected \(N,\), at least one"),
    ],
)
def test_other_numbers_of_transitions_are_refused(
    indices: list[int], error: type[Exception], message: str, pendulums: Dataset
) -> None:
    with pytest.raises(error, match=message):
        pendulums.transitions(indices)


def test_windows_have_the_steps_of_their_episodes(pendulums: Dataset) -> None:
    episodes = list(pendulums)
    for windows in pendulums.windows(4, stride=2, pad=(1, 2), size=30):
        for number, (seed, first) in enumerate(zip(windows.seeds, windows.steps, strict=True)):
            episode = episodes[seed]
            steps = np.arange(first, first + 4)[windows.mask[number]]
            actions = windows.actions[number][windows.mask[number]]
            np.testing.assert_array_equal(actions, episode.actions[steps])


@pytest.mark.parametrize("seed", [None, 0])
@pytest.mark.parametrize(
    ("form", "each"),
    [((10,), 1), ((3,), 8), ((3, 3), 3), ((4, 1, (3, 3)), 13), ((12, 1, (1, 1)), 1)],
)
def test_every_window_comes_once(
    form: tuple[Any, ...], each: int, seed: int | None, pendulums: Dataset
) -> None:
    assert pendulums.count_windows(*form) == 70 * each
    found = list(pendulums.windows(*form, size=64, seed=seed, buffer=0 if seed is None else 100))
    assert [len(windows) for windows in found[:-1]] == [64] * (len(found) - 1)
    keys = [key for windows in found for key in zip(windows.seeds, windows.steps, strict=True)]
    assert len(set(keys)) == len(keys) == 70 * each
    assert (keys == sorted(keys)) is (seed is None)


def test_chosen_observations_alone_are_read(arms: Dataset) -> None:
    name = next(iter(arms[0].observations))
    chosen = arms.select([name], float32=True)
    batch = next(chosen.batches(10))
    assert list(batch.observations) == list(batch.next_observations) == [name]
    assert batch.observations[name].dtype == batch.actions.dtype == np.float32
    assert list(next(chosen.windows(2)).observations) == [name]
    assert list(chosen.transitions([0]).observations) == [name]
    assert list(chosen.statistics().observations) == [name]
    assert list(chosen.part(0, 2).transitions([0]).observations) == [name]
    assert chosen.seeds == arms.seeds
    assert_equal(chosen[0], arms[0])  # episodes are whole
    assert list(arms.observed) == list(arms[0].observations)


def test_a_choice_that_is_left_out_stays_as_it_was(pendulums: Dataset) -> None:
    chosen = pendulums.select(["velocity"], discount=0.9).select(float32=True).select(n_step=3)
    batch = next(chosen.select().batches(10))
    expected = pendulums.select(["velocity"], float32=True, discount=0.9, n_step=3)
    for field in dataclasses.fields(Batch):
        ours, theirs = (getattr(one, field.name) for one in (batch, next(expected.batches(10))))
        np.testing.assert_equal(ours, theirs)
    assert batch.rewards.dtype == np.float32
    assert next(chosen.select(float32=False).batches(10)).rewards.dtype == np.float64
    with pytest.raises(ValueError, match="'orientation'; the observations are velocity"):
        chosen.select(["orientation"])
    with pytest.raises(ValueError, match="unknown column 'v'; the observations are"):
        pendulums.select("velocity")


def test_statistics_are_computed_once(pendulums: Dataset, monkeypatch: pytest.MonkeyPatch) -> None:
    part = pendulums.part(0, 2)
    found = part.statistics()
    assert found.rewards.count == 350
    monkeypatch.setattr(Shard, "opened", None)
    assert part.statistics() is found


def _select(**choices: object) -> Callable[[Dataset], object]:
    return lambda dataset: dataset.select(**choices)  # pyright: ignore[reportArgumentType]


def _windows(*form: object) -> Callable[[Dataset], object]:
    return lambda dataset: dataset.windows(*form)  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (_select(observations=["velocitie"]), "column 'velocitie'; .* Did you mean 'velocity'?"),
        (_select(observations=[]), "observations is empty; choose from orientation, velocity"),
        (_select(discount=1.5), "discount is 1.5; expected a number from 0 to 1"),
        (_select(n_step=0, discount=1.0), "n_step is 0; expected a whole number of at least 1"),
        (_select(n_step=3), "n_step is 3, and there is no discount; give 1.0 for sums"),
        (_windows(11), "length is 11; expected at most 10, the steps of the longest episode$"),
        (_windows(14, 1, (1, 2)), "expected at most 13, the .* longest episode and its padding$"),
        (_windows(0), "length is 0; expected a whole number of at least 1"),
        (_windows(3, -1), "stride is -1; expected a whole number of at least 1"),
        (_windows(3, 1, (0, 3)), r"pad is \(0, 3\); .* whole numbers from 0 to 2, less than the"),
        (_windows(3, 1, (-1, 0)), r"pad is \(-1, 0\); expected steps before and after"),
        (_windows(3, 1, 2), "pad is 2; expected steps before and after"),
        (_windows(3, 1, (1, 1, 1)), r"pad is \(1, 1, 1\); expected steps before and after"),
        (lambda dataset: dataset.windows(3, size=0), "size is 0; expected a whole number"),
        (lambda dataset: dataset.batches(3, buffer=5), "buffer is 5, and there is no seed"),
        (lambda dataset: dataset.batches(3, seed=0, buffer=-1), "buffer is -1; expected a whole"),
    ],
)
def test_bad_arguments_are_refused_at_once(
    call: Callable[[Dataset], object], message: str, pendulums: Dataset
) -> None:
    with pytest.raises(ValueError, match=message):
        call(pendulums)


def test_damaged_data_is_an_error_that_names_the_file(damaged: Path) -> None:
    with pytest.raises(ValueError, match=r"seeds-0000000000-0000000064.parquet is damaged"):
        list(load(damaged))


def test_the_figures_are_those_of_the_episodes_and_files(pendulums: Dataset) -> None:
    information = inform(pendulums)
    totals = [episode.total for episode in pendulums]
    assert information.summary.mean == np.mean(totals)
    assert information.summary.episodes == 70
    assert information.strata == {}
    folder = folder_of(pendulums)
    assert information.files == hashes(folder)
    assert information.nbytes == sum(path.stat().st_size for path in folder.glob("episodes/*"))
    content = json.loads(json.dumps(information.as_json()))
    assert content["policy"] == "random"
    assert content["sha256"] == information.files
    assert content["steps"] == 700
    assert content["columns"]["action"] == ["float64", 1]


def test_returns_are_reported_by_kind_of_start(arms: Dataset) -> None:
    information = inform(arms)
    starts = {episode.start for episode in arms}
    assert set(information.strata) == starts
    assert sum(part.episodes for part in information.strata.values()) == 2


def test_damage_anywhere_is_found(damaged: Path) -> None:
    with pytest.raises(ValueError, match="is damaged"):
        inform(load(damaged))


def test_another_file_of_the_same_size_is_found_by_its_hash(
    pendulums: Dataset, tmp_path: Path
) -> None:
    path = path_of(pendulums.shards[0])
    folder = copy(path.parents[1], tmp_path / "changed")
    (folder / "dataset.json").write_text(
        (folder / "dataset.json").read_text().replace(hashes(folder)[path.name], "0" * 64)
    )
    dataset = load(folder)
    assert inform(dataset).files[path.name] == "0" * 64
    with pytest.raises(ValueError, match=rf"{path.name} has another SHA-256 than in dataset.json"):
        inform(dataset, verify=True)
    assert inform(pendulums, verify=True).steps == 700


# A policy that learns from it.


def test_the_card_of_a_policy_is_that_of_the_task_and_the_statistics(pendulums: Dataset) -> None:
    card = pendulums.policy_card("cloning")
    environment = suite.load("pendulum", "swingup")
    spec, observed = environment.action_spec(), pendulums.statistics().observations
    assert (card.domain, card.task, card.algorithm) == ("pendulum", "swingup", "cloning")
    assert card.action_repeat == pendulums.recipe.facts["action_repeat"]
    assert (card.low, card.high) == (tuple(spec.minimum), tuple(spec.maximum))
    assert card.layout == (("orientation", (2,)), ("velocity", (1,)))
    mean = [*observed["orientation"].mean, *observed["velocity"].mean]
    np.testing.assert_array_equal(card.mean, mean)
    np.testing.assert_array_equal(
        card.scale, [*observed["orientation"].std + 1e-3, *observed["velocity"].std + 1e-3]
    )
    assert pendulums.policy_card("cloning", environment) == card


def test_unlimited_actions_have_the_bound_of_the_caller(tmp_path: Path) -> None:
    data.collect("lqr", "lqr_2_1", "random", range(2), out=tmp_path, time_limit=0.2, num_threads=1)
    dataset = load(tmp_path)
    for card, bound in (
        (dataset.policy_card("cloning"), 1.0),
        (dataset.policy_card("cloning", action_bound=4.0), 4.0),
    ):
        assert (card.low, card.high) == ((-bound,), (bound,))
    for wrong in (0, -1.0, np.inf, np.nan):
        with pytest.raises(ValueError, match=f"action_bound is {wrong}; expected a positive"):
            dataset.policy_card("cloning", action_bound=wrong)


def test_a_card_for_an_environment_with_other_observations_is_refused(pendulums: Dataset) -> None:
    with pytest.raises(ValueError, match=r"no observation 'position'.*orientation, velocity"):
        pendulums.policy_card("cloning", suite.load("cartpole", "swingup"))


class _Square(pendulum.SwingUp):
    """Has actions of two axes."""

    def action_spec(self, physics: Any) -> specs.BoundedArray:
        return specs.BoundedArray((1, 1), float, -1.0, 1.0)

    def before_step(self, action: Any, physics: Any) -> None:
        super().before_step(action[..., 0], physics)


def test_a_card_that_no_policy_file_can_have_is_refused(pendulums: Dataset) -> None:
    def environment(task: type[pendulum.SwingUp], **kwargs: Any) -> control.Environment:
        physics = pendulum.Physics.from_xml_string(*pendulum.get_model_and_assets())
        return control.Environment(physics, task(random=0), control_timestep=0.02, **kwargs)

    with pytest.raises(ValueError, match=r"actions have shape \(1, 1\); expected one axis"):
        pendulums.policy_card("cloning", environment(_Square))
    with pytest.raises(ValueError, match="the environment observes no numbers, which a policy"):
        pendulums.policy_card("cloning", environment(pendulum.SwingUp, pixels={"only": True}))


class _Two(pendulum.SwingUp):
    """Has two actions, whose bounds are one number each."""

    def action_spec(self, physics: Any) -> specs.BoundedArray:
        return specs.BoundedArray((2,), float, -1.0, 1.0)

    def before_step(self, action: Any, physics: Any) -> None:
        super().before_step(action[..., :1], physics)


def test_a_card_has_the_bounds_of_each_action_and_the_world(
    pendulums: Dataset, tmp_path: Path
) -> None:
    physics = pendulum.Physics.from_xml_string(*pendulum.get_model_and_assets())
    environment = control.Environment(physics, _Two(random=0), control_timestep=0.02)
    card = pendulums.policy_card("cloning", environment)
    assert (card.low, card.high, card.world) == ((-1.0, -1.0), (1.0, 1.0), None)
    world = {"faults": {"dummies": 2, "noise": {"observations": 0.1}}}
    data.collect("pendulum", "swingup", "zero", range(2), out=tmp_path, time_limit=0.1, world=world)
    card = load(tmp_path).policy_card("cloning")
    assert [name for name, _ in card.layout][-2:] == ["dummy-0", "dummy-1"]
    assert card.world == load(tmp_path).recipe.facts["world"]
