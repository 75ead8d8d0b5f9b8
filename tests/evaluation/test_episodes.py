"""Episodes in batches are those of single environments, bit for bit."""

import os
from collections.abc import Iterable
from typing import Any

import evaluated
import numpy as np
import pytest

from limberjack import policies, rollout, suite
from limberjack.evaluation.episodes import play, play_alone
from limberjack.evaluation.statistics import Score
from limberjack.policies import Policy, actors
from limberjack.policies.batched import Batched, EachRow
from limberjack.rl import control
from limberjack.rl.builds import Build
from tests.plain_pictures import draw_plainly

_SEEDS = [5, 0, 3, *range(100, 165)]  # more than there are rows


_STEPS = 12


def _load(domain: str, task: str) -> Any:
    environment = suite.load(domain, task)
    limit = _STEPS * environment.control_timestep()
    environment.close()
    return suite.load(domain, task, {"time_limit": limit})


def _alone(environment: Any, policy: Policy, seeds: list[int]) -> list[Score]:
    """The scores of `run_episode` with each seed."""
    scores = []
    for seed in seeds:
        environment.reseed(seed)
        episode = rollout.run_episode(environment, policy, seed)
        scores.append(Score.of_rewards(seed, episode.rewards))
    return scores


def _listed(ended: Iterable[list[Score]]) -> list[Score]:
    """The scores of all lists."""
    return [score for scores in ended for score in scores]


def _in_order(ended: Iterable[list[Score]], seeds: list[int]) -> list[Score]:
    by_seed = {score.seed: score for score in _listed(ended)}
    assert sorted(by_seed) == sorted(seeds)
    return [by_seed[seed] for seed in seeds]


@pytest.mark.parametrize(
    ("domain", "task"),
    [("humanoid", "walk"), ("manipulator", "insert_peg"), ("stacker", "stack_2")],
)
@pytest.mark.parametrize("name", ["zero", "random"])
def test_each_episode_is_that_of_a_single_environment(domain: str, task: str, name: str) -> None:
    environment, policy = _load(domain, task), policies.find(name)
    scores = _in_order(play(environment, EachRow(policy), _SEEDS, 1), _SEEDS)
    some = _SEEDS[::9]
    assert [scores[_SEEDS.index(seed)] for seed in some] == _alone(environment, policy, some)


def test_random_actions_are_those_of_run_with_that_seed() -> None:
    given: dict[int, list[np.ndarray]] = {}

    def noting(spec: Any, seed: int) -> policies.Act:
        act = policies.random(spec, seed)
        actions = given.setdefault(seed, [])

        def noted(observation: Any) -> np.ndarray:
            actions.append(act(observation))
            return actions[-1]

        return noted

    environment = _load("manipulator", "bring_ball")
    list(play(environment, EachRow(noting), [3, 8], 1))
    spec = environment.action_spec()
    for seed in (3, 8):
        act = policies.random(spec, seed)
        expected = [act({}) for _ in range(_STEPS)]
        np.testing.assert_array_equal(given[seed], expected)


@pytest.mark.parametrize("policy", [evaluated.leaning, evaluated.Leaning])
def test_a_function_of_one_observation_sees_what_a_single_environment_shows(policy: Any) -> None:
    environment = _load("humanoid", "stand")
    found = actors.find(policy, environment)
    assert found.actor is not None
    seeds = [4, 9]
    act = policies.find("evaluated:leaning")
    expected = _alone(_load("humanoid", "stand"), act, seeds)
    assert _in_order(play(environment, found.actor, seeds, 1), seeds) == expected


_Stacks = dict[int, list[np.ndarray]]  # those of an episode, by its seed


def _looking(seen: _Stacks) -> Policy:
    """A policy that acts by what it sees, and keeps it."""

    def begin(spec: Any, seed: int) -> policies.Act:
        stacks = seen.setdefault(seed, [])

        def act(observation: Any) -> np.ndarray:
            stacks.append(observation["pixels"].copy())
            return np.cos(stacks[-1].sum() + np.arange(spec.shape[0]))

        return act

    return begin


def _seen(make: Any, seed: int, repeat: int) -> tuple[list[np.ndarray], Score]:
    """The stacks that an environment shows if it repeats actions, and its control steps' score."""
    seen, actions, rewards = {}, [], []
    environment = make(seed, action_repeat=repeat)
    act = _looking(seen)(environment.action_spec(), seed)
    time_step = environment.reset()
    while not time_step.last():
        actions.append(act(time_step.observation))
        time_step = environment.step(actions[-1])
    plain = make(seed, pixels=None)
    time_step = plain.reset()
    while not time_step.last():
        time_step = plain.step(actions[len(rewards) // repeat])
        rewards.append(time_step.reward)
    return seen[seed], Score.of_rewards(seed, np.array(rewards))


@pytest.mark.skipif(os.environ.get("MUJOCO_GL") == "disable", reason="rendering is turned off")
@pytest.mark.parametrize("kind", [control.Environment, evaluated.OfItsOwn])
@pytest.mark.parametrize("repeat", [1, 3])
@pytest.mark.parametrize("is_alone", [False, True])
def test_repeated_actions_see_the_stacks_of_an_environment_that_repeats_them(
    kind: Any, repeat: int, is_alone: bool
) -> None:
    pixels = {"camera": 0, "height": 8, "width": 8, "frame_stack": 3}

    def make(seed: int, **kwargs: Any) -> control.Environment:
        environment = evaluated.sinking(seed, kind=kind, **{"pixels": pixels, **kwargs})
        draw_plainly(environment.physics.model)
        return environment

    seen: _Stacks = {}
    seeds = [0, 1, 2, 64, 65]  # of which those from 64 begin in the middle of the others
    build = Build.of(make)
    if is_alone:
        ended = play_alone(build.seeded(0), _looking(seen), seeds, action_repeat=repeat)
    else:
        ended = play(build, EachRow(_looking(seen)), seeds, 1, action_repeat=repeat)
    scores = {score.seed: score for score in _listed(ended)}
    for seed in seeds:
        stacks, expected = _seen(make, seed, repeat)
        np.testing.assert_array_equal(seen[seed], stacks)
        assert scores[seed] == expected
    assert len({score.length for score in scores.values()}) > 1  # so rows act at different times


def test_a_row_takes_the_next_seed_when_its_episode_ends() -> None:
    seeds = list(range(90))
    found = actors.find("evaluated:linear", evaluated.sinking())
    assert found.actor is not None
    ended = list(play(evaluated.sinking(), found.actor, seeds, 1))
    scores = _listed(ended)
    expected = _alone(evaluated.sinking(), policies.find("evaluated:linear"), seeds)
    assert _in_order(ended, seeds) == expected
    assert len({score.length for score in scores}) > 2  # so rows went on at different times
    assert [score.seed for score in scores] != seeds


def test_a_policy_for_batches_gives_what_it_gives_row_by_row() -> None:
    seeds = list(range(90))
    policy = evaluated.Linear()
    found = actors.find(policy, evaluated.sinking())
    assert isinstance(found.actor, Batched)
    scores = _in_order(play(evaluated.sinking(), found.actor, seeds, 1), seeds)
    assert scores == _alone(evaluated.sinking(), policies.find("evaluated:linear"), seeds)
    assert sorted(policy.begun) == seeds


def test_a_policy_for_batches_receives_64_rows_even_if_few_are_in_use() -> None:
    found = actors.find(evaluated.Linear, evaluated.sinking())
    assert found.actor is not None
    few = _listed(play(evaluated.sinking(), found.actor, [7, 8, 9], 1))
    assert len(few) == 3  # Linear itself checks the shape


def test_an_episode_of_a_policy_in_float32_does_not_depend_on_the_others() -> None:
    # A product of matrices in float32 rounds by the row.
    found = actors.find(evaluated.Network, evaluated.sinking())
    assert found.actor is not None
    whole = {s.seed: s for s in _listed(play(evaluated.sinking(), found.actor, range(70), 1))}
    for seeds in ([69], [64, 0, 128, 5], list(range(69, 2, -1))):
        scores = _listed(play(evaluated.sinking(), found.actor, seeds, 1))
        assert sorted(score.seed for score in scores) == sorted(seeds)
        assert [whole.get(s.seed, s) for s in scores] == scores


def test_the_number_of_threads_changes_nothing() -> None:
    seeds = list(range(20))
    one, two = (
        list(play(evaluated.sinking(), EachRow(policies.random), seeds, threads))
        for threads in (1, 2)
    )
    assert one == two


def test_an_object_with_a_state_plays_one_episode_at_a_time() -> None:
    environment = _load("humanoid", "stand")
    found = actors.find("evaluated:Remembering", environment)
    assert found.actor is None
    assert found.alone is not None
    seeds = [2, 6]
    make = policies.find("evaluated:Remembering")
    expected = _alone(_load("humanoid", "stand"), make, seeds)
    assert _listed(play_alone(Build.of(environment).seeded(0), found.alone, seeds)) == expected


def test_the_planner_plays_one_episode_at_a_time_as_run_does() -> None:
    environment = suite.load("manipulator", "bring_ball", {"time_limit": 0.03})
    found = actors.find("planner", environment, num_threads=1)
    assert found.alone is not None
    seeds = [1, 2]
    expected = _alone(environment, policies.find("planner"), seeds)
    assert _listed(play_alone(Build.of(environment).seeded(0), found.alone, seeds)) == expected


def test_divergence_ends_an_episode_alike_in_a_batch_and_alone() -> None:
    seeds = list(range(24))
    environment = evaluated.sinking(some_diverge=True)
    batched = _in_order(play(environment, EachRow(policies.zero), seeds, 1), seeds)
    assert _listed(play_alone(Build.of(environment).seeded(0), policies.zero, seeds)) == batched
    assert 0 < sum(score.diverged for score in batched) < 24
