"""Policies on 64 rows, alone in a single environment; tests/evaluation has them on batches."""

from typing import Any

import numpy as np
import pytest
from dm_env import specs

from limberjack import policies, rollout
from limberjack.evaluation.episodes import play
from limberjack.evaluation.statistics import Score
from limberjack.policies import actors, batched
from tests.evaluation import evaluated

_SPEC = specs.BoundedArray((2,), float, -1.0, 1.0)


def _alone(name: str, seed: int) -> Score:
    environment = evaluated.sinking()
    environment.reseed(seed)
    episode = rollout.run_episode(environment, policies.find(name), seed)
    return Score.of_rewards(seed, episode.rewards)


@pytest.mark.parametrize("name", ["evaluated:Network", "evaluated:Linear"])
def test_an_episode_alone_is_that_of_a_batch_bit_for_bit(name: str) -> None:
    # A product of matrices in float32 rounds by the row.
    found = actors.find(name, None)
    assert found.actor is not None
    seeds = [3, 64, 69, 130]
    played = [s for scores in play(evaluated.sinking(), found.actor, seeds, 1) for s in scores]
    assert sorted(played, key=lambda score: score.seed) == [_alone(name, seed) for seed in seeds]


def test_alone_the_row_is_that_of_the_seed_and_the_others_are_copies() -> None:
    shown: list[Any] = []

    def act_batch(observations: Any) -> np.ndarray:
        shown.append(observations["x"])
        return np.repeat(observations["x"], 2, axis=1)

    begun: list[tuple[list[int], list[int]]] = []
    policy = batched.alone(
        "a policy", act_batch, lambda rows, seeds: begun.append((rows.tolist(), seeds.tolist()))
    )
    act = policy(_SPEC, 70)
    np.testing.assert_array_equal(act({"x": np.array([7.0])}), [7.0, 7.0])
    np.testing.assert_array_equal(shown[0], np.full((64, 1), 7.0))
    assert begun == [([70 % 64], [70])]


def test_an_error_before_episodes_names_the_policy_and_the_seeds() -> None:
    def fail(*_: object) -> None:
        raise KeyError("no weights")

    policy = batched.alone("a policy", lambda observations: np.zeros((64, 2)), fail)
    with pytest.raises(KeyError) as caught:
        policy(_SPEC, 70)
    assert caught.value.__notes__ == ["policy 'a policy', before the episodes with seeds [70]"]


def test_episodes_of_one_policy_alone_do_not_mix() -> None:
    policy = batched.alone("a policy", lambda observations: np.zeros((64, 2)) + np.nan)
    first, second = policy(_SPEC, 1), policy(_SPEC, 2)
    with pytest.raises(policies.PolicyError, match="step 0 of the episode with seed 1: returned"):
        first({"x": np.zeros(1)})
    with pytest.raises(policies.PolicyError, match="step 0 of the episode with seed 2: returned"):
        second({"x": np.zeros(1)})
