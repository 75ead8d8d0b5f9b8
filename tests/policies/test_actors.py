"""Policies as actors on batches: how they are found, named and hashed."""

import collections
import contextlib
import functools
import importlib
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from dm_env import specs

from limberjack import policies, suite
from limberjack.episodes.playing import batch_for, play
from limberjack.policies import PolicyError
from limberjack.policies.actors import Batched, Deferred
from limberjack.rl import batch_of, control
from limberjack.suite import base
from tests.rollouts import run_episode

evaluated: Any = importlib.import_module("evaluated")  # as policies are named: MODULE:CALLABLE

_STEPS = 12
_SPEC = specs.BoundedArray((2,), float, -1.0, 1.0)
_ENVIRONMENT: Any = SimpleNamespace(action_spec=lambda: _SPEC)


def _load(domain: str, task: str) -> Any:
    environment = suite.load(domain, task)
    limit = _STEPS * environment.control_timestep()
    environment.close()
    return suite.load(domain, task, {"time_limit": limit})


class _Chosen(base.Task):
    """A task whose action is the number of a force."""

    def action_spec(self, physics: Any) -> specs.DiscreteArray:
        return specs.DiscreteArray(3)

    def before_step(self, action: Any, physics: Any) -> None:
        physics.set_control(np.array([-1.0, 0.0, 1.0])[action][..., None])

    def get_observation(self, physics: Any) -> Any:
        return collections.OrderedDict(position=physics.position().copy())

    def get_reward(self, physics: Any) -> Any:
        return physics.velocity()[..., 0]


@pytest.mark.parametrize("policy", ["zero", "random", lambda observation: 2])
def test_whole_numbers_reach_the_task_as_such(policy: Any) -> None:
    physics: Any = suite.load("cartpole", "balance").physics
    environment = control.Environment(physics, _Chosen(random=0), time_limit=0.1)
    actor = policies.find(policy, environment)
    for vectorised in (True, False):
        batch = batch_for(environment, actor, range(3), 1, vectorised=vectorised)
        played = [one for ended in play(batch, actor, range(3)) for one in ended]
        totals = {one.seed: one.total for one in played}
        environment.reseed(1)
        assert run_episode(environment, actor, 1).total == totals[1]


_HALVES: Any = SimpleNamespace(act_batch=lambda observations: np.full(64, 1.5))


@pytest.mark.parametrize("policy", [lambda observation: 1.5, _HALVES])
def test_actions_between_whole_numbers_are_refused(policy: Any) -> None:
    physics: Any = suite.load("cartpole", "balance").physics
    environment = control.Environment(physics, _Chosen(random=0), time_limit=0.1)
    actor = policies.find(policy, environment)
    observation = environment.reset().observation
    message = r"step 0 of the episode with seed 1: returned 1\.5 at index \[0\]; expected whole"
    with pytest.raises(PolicyError, match=message):
        actor.begin_alone(environment, 1)(observation)
    batch = batch_for(environment, actor, range(1, 3), 1)
    with contextlib.closing(batch), pytest.raises(PolicyError, match=message):
        list(play(batch, actor, range(1, 3)))


def test_a_generator_is_no_policy() -> None:
    with pytest.raises(PolicyError, match="builtins:generator"):
        policies.find(action for action in range(3))


def test_rows_that_a_policy_of_64_cannot_tell_apart_are_refused() -> None:
    build = _load("walker", "walk")
    actor = policies.find("evaluated:Network", build)
    with (
        contextlib.closing(batch_of(build, 65, 1, seed=0)) as batch,
        pytest.raises(PolicyError, match="acts in 64 rows at once, and the batch has 65"),
    ):
        actor.begin(batch, np.arange(65), range(65))
    rows = np.arange(2)
    with contextlib.closing(batch_of(build, 2, 1, seed=0)) as batch:
        actor.begin(batch, rows, [3, 67])
        with pytest.raises(PolicyError, match=r"the same for two of the seeds \[3, 67\]"):
            actor.act(batch.reset().observation, rows)


@pytest.mark.parametrize(
    ("policy", "message"),
    [
        (
            "evaluated:NotANumber",
            "policy 'evaluated:NotANumber', step 3 of the episode with seed 70: returned nan at "
            r"index \[2\]; expected finite numbers",
        ),
        (
            "evaluated:TooShort",
            r"step 0 of the episode with seed 66: .* shape \(21,\); expected numbers of shape "
            r"\(64, 21\)",
        ),
        ("evaluated:WithoutEnd", "returned list of dtype <U4"),
        ("evaluated:too_long", r"step 0 of the episode with seed 66: .* shape \(22,\)"),
    ],
)
def test_what_is_no_action_is_named_with_seed_and_step(policy: str, message: str) -> None:
    environment = _load("humanoid", "stand")
    actor = policies.find(policy, environment)
    with pytest.raises(PolicyError, match=message):
        list(play(batch_for(environment, actor, range(66, 76), 1), actor, range(66, 76)))


@pytest.mark.parametrize(
    ("policy", "message"),
    [
        ("radnom", "Did you mean 'random'?"),
        ("no_module:act", "there is no module 'no_module'"),
        ("evaluated:too_lnog", "Did you mean 'too_long'?"),
        (3, "is of type int; expected a function of an observation, or an object with act"),
        ("evaluated:FALLS_FROM", "policy 'evaluated:FALLS_FROM' is of type float; expected a"),
        ("evaluated:Forgetful", "has act_batch and reset, which a batch never calls: write reset"),
    ],
)
def test_a_policy_that_is_not_there_is_refused(policy: Any, message: str) -> None:
    with pytest.raises(PolicyError, match=message.replace("?", r"\?")):
        policies.find(policy)


def test_a_policy_may_make_its_functions_as_it_is_made() -> None:
    assert isinstance(policies.find("evaluated:Compiled"), Batched)


def test_a_policys_hash_is_that_of_its_source() -> None:
    functions = [policies.find(name).sha256 for name in ("zero", "random")]
    of_module = {policies.find(f"evaluated:{name}").sha256 for name in ("linear", "Linear")}
    assert len(of_module) == 1
    assert len({*functions, *of_module, None}) == 4


def test_a_policy_at_hand_has_the_name_and_hash_that_it_would_be_found_by() -> None:
    for name in ("linear", "Linear", "Remembering"):
        at_hand = policies.find(getattr(evaluated, name))
        named = policies.find(f"evaluated:{name}")
        assert (at_hand.name, at_hand.sha256) == (named.name, named.sha256)


def test_a_partial_is_called_what_its_function_is() -> None:
    at_hand = policies.find(functools.partial(evaluated.linear))
    named = policies.find("evaluated:linear")
    assert (at_hand.name, at_hand.sha256) == (named.name, named.sha256)


@pytest.mark.parametrize("name", ["evaluated:Network", "evaluated:Linear"])
def test_an_episode_alone_is_that_of_a_batch_bit_for_bit(name: str) -> None:
    # A product of matrices in float32 rounds by the row.
    actor, seeds = policies.find(name), [3, 64, 69, 130]
    batch = batch_for(evaluated.sinking(), actor, range(4), 1)
    played = [episode for ended in play(batch, actor, seeds) for episode in ended]
    for episode in played:
        environment = evaluated.sinking()
        environment.reseed(episode.seed)
        alone = run_episode(environment, policies.find(name), episode.seed)
        np.testing.assert_array_equal(episode.rewards, alone.rewards)
    assert sorted(episode.seed for episode in played) == seeds


class _Blind(base.Task):
    """A task that observes nothing."""

    def get_observation(self, physics: Any) -> Any:
        return collections.OrderedDict()

    def get_reward(self, physics: Any) -> float:
        return 1.0


class _Still:
    """Acts with zeros in all rows."""

    def act_batch(self, observations: Any) -> np.ndarray:
        assert observations == {}
        return np.zeros((64, 1))


@pytest.mark.parametrize("policy", ["random", _Still])
def test_a_task_that_observes_nothing_is_played(policy: Any) -> None:
    physics = _load("pendulum", "swingup").physics
    environment = control.Environment(physics, _Blind(random=0), time_limit=0.1)
    actor, seeds = policies.find(policy, environment), range(3)
    played = play(batch_for(environment, actor, seeds, 1), actor, seeds)
    assert [one.seed for ended in played for one in ended] == [*seeds]


def test_alone_the_row_is_that_of_the_seed_and_the_others_are_copies() -> None:
    shown: list[Any] = []

    def act_batch(observations: Any) -> np.ndarray:
        shown.append(observations["x"])
        return np.repeat(observations["x"], 2, axis=1)

    begun: list[tuple[list[int], list[int]]] = []

    def reset_batch(rows: np.ndarray, seeds: np.ndarray) -> None:
        begun.append((rows.tolist(), seeds.tolist()))

    act = Batched("a policy", None, act_batch, reset_batch).begin_alone(_ENVIRONMENT, 70)
    np.testing.assert_array_equal(act({"x": np.array([7.0])}), [7.0, 7.0])
    np.testing.assert_array_equal(shown[0], np.full((64, 1), 7.0))
    assert begun == [([70 % 64], [70])]


def test_an_error_before_episodes_names_the_policy_and_the_seeds() -> None:
    def fail(*_: object) -> None:
        raise KeyError("no weights")

    policy = Batched("a policy", None, lambda observations: np.zeros((64, 2)), fail)
    with pytest.raises(KeyError) as caught:
        policy.begin_alone(_ENVIRONMENT, 70)
    assert caught.value.__notes__ == ["policy 'a policy', before the episodes with seeds [70]"]


def test_a_row_counts_the_steps_of_its_latest_episode() -> None:
    build, rows, fails = _load("walker", "walk"), np.arange(1), [False, False, True]
    actor = Batched("a policy", None, lambda seen: np.full((64, 6), np.nan if fails.pop(0) else 0))
    with contextlib.closing(batch_of(build, 1, 1, seed=0)) as batch:
        observation = batch.reset().observation
        for seed in (3, 4):
            actor.begin(batch, rows, [seed])
            if seed == 4:
                break
            for _ in range(2):
                actor.act(observation, rows)
        with pytest.raises(PolicyError, match="step 0 of the episode with seed 4: returned nan"):
            actor.act(observation, rows)


def test_a_policy_that_is_found_late_is_found_for_each_environment() -> None:
    def find(environment: Any) -> Any:
        def act_batch(seen: object) -> np.ndarray:
            return np.full((64, 2), environment.number)

        return Batched("late", None, act_batch)

    actor, numbers = Deferred("late", find), []
    for number in (1.0, 2.0):
        environment: Any = SimpleNamespace(action_spec=lambda: _SPEC, number=number)
        numbers.append(actor.begin_alone(environment, 0)({"x": np.zeros(1)})[0])
    assert numbers == [1.0, 2.0]


def test_episodes_of_one_policy_alone_do_not_mix() -> None:
    policy = Batched("a policy", None, lambda observations: np.zeros((64, 2)) + np.nan)
    first, second = (policy.begin_alone(_ENVIRONMENT, seed) for seed in (1, 2))
    with pytest.raises(policies.PolicyError, match="step 0 of the episode with seed 1: returned"):
        first({"x": np.zeros(1)})
    with pytest.raises(policies.PolicyError, match="step 0 of the episode with seed 2: returned"):
        second({"x": np.zeros(1)})
