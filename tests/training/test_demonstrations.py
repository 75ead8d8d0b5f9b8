"""Datasets as transitions: held actions, sums of rewards, ends; and those that do not fit."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from limberjack import data, suite
from limberjack.policies.networks import layout_of
from limberjack.training.demonstrations import (
    Demonstrations,
    check_of_task,
    demonstrations_of,
    identity_of,
)

pytest.importorskip("pyarrow", reason="needs the extra 'data'")

_LOW, _HIGH = np.array([-0.5], np.float32), np.array([0.5], np.float32)
_LAYOUT = layout_of(suite.load("pendulum", "swingup"))


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> data.Dataset:
    """Two episodes of 25 random actions."""
    folder = tmp_path_factory.mktemp("shown")
    data.collect("pendulum", "swingup", "random", range(2), out=folder, time_limit=0.5)
    return data.load(folder)


@pytest.fixture(scope="module")
def shown(dataset: data.Dataset) -> Demonstrations:
    """Its actions as if each had been held for two steps."""
    return demonstrations_of(dataset, _LAYOUT, 2, _LOW, _HIGH)


def test_an_action_is_the_mean_of_those_of_its_steps_within_the_bounds(
    dataset: data.Dataset, shown: Demonstrations
) -> None:
    assert shown.actions.shape == (26, 1)  # 12 of two steps each, and one of the last step
    first = dataset[0]
    expected = [*first.actions[:24].reshape(12, 2).mean(axis=1), *first.actions[24]]
    assert np.abs(expected).max() > 0.5
    np.testing.assert_array_equal(shown.actions[:13, 0], np.clip(expected, -0.5, 0.5, dtype="f4"))


def test_observations_are_those_before_and_after_the_steps_and_rewards_their_sum(
    dataset: data.Dataset, shown: Demonstrations
) -> None:
    second = dataset[1]
    seen = np.concatenate(
        [second.observations[name].reshape(26, -1) for name, _ in _LAYOUT], axis=1, dtype="f4"
    )
    np.testing.assert_array_equal(shown.observations[13:], seen[0:25:2])
    np.testing.assert_array_equal(shown.next_observations[13:], [*seen[2:25:2], seen[25]])
    rewards = [*(second.rewards[0:24:2] + second.rewards[1:24:2]), second.rewards[24]]
    np.testing.assert_array_equal(shown.rewards[13:], np.array(rewards, "f4"))


def test_episodes_end_by_their_limit_or_by_the_task(
    dataset: data.Dataset, shown: Demonstrations
) -> None:
    np.testing.assert_array_equal(np.flatnonzero(shown.is_last), [12, 25])
    np.testing.assert_array_equal(shown.is_truncated, shown.is_last)
    over = np.zeros(25, bool)
    episode = dataclasses.replace(dataset[0], truncated=over)

    class Ended(data.Dataset):
        def __iter__(self):
            return iter([episode])

    found = demonstrations_of(Ended(dataset.shards), _LAYOUT, 1, _LOW, _HIGH)
    np.testing.assert_array_equal(np.flatnonzero(found.is_last), [24])
    assert not found.is_truncated.any()


@pytest.mark.parametrize(
    ("layout", "low", "message"),
    [
        ((("reach", (3,)),), _LOW, "have no observation 'reach'; expected shape \\(3,\\)"),
        ((("velocity", (4,)),), _LOW, "have shape \\(1,\\) of 'velocity'; expected shape \\(4,\\)"),
        (_LAYOUT, np.zeros(3), "have actions of shape \\(1,\\); expected \\(3,\\)"),
    ],
)
def test_a_dataset_of_another_task_is_refused_by_what_differs(
    dataset: data.Dataset,
    layout: tuple[tuple[str, tuple[int, ...]], ...],
    low: np.ndarray,
    message: str,
) -> None:
    with pytest.raises(ValueError, match=message):
        demonstrations_of(dataset, layout, 2, low, low + 1)


def test_names_of_tasks_are_compared_where_both_have_them(dataset: data.Dataset) -> None:
    check_of_task(dataset, "pendulum", "swingup")
    check_of_task(dataset, None, None)  # a function's
    for domain, task in (("walker", "walk"), ("pendulum", "balance")):
        expected = f"demonstrations are of pendulum swingup; expected those of {domain} {task}"
        with pytest.raises(ValueError, match=expected):
            check_of_task(dataset, domain, task)


def test_other_episodes_or_observations_are_other_demonstrations(
    dataset: data.Dataset, tmp_path: Path
) -> None:
    others = [dataset.part(0, 2), dataset.select(["velocity"])]
    data.collect("pendulum", "swingup", "zero", range(2), out=tmp_path / "a", time_limit=0.5)
    others.append(data.load(tmp_path / "a"))
    again = data.load(str(dataset.shards[0].path).partition("episodes")[0])
    assert identity_of(dataset) == identity_of(again)
    assert all(identity_of(other) != identity_of(dataset) for other in others)
