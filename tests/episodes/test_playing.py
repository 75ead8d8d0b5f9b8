"""The loop: episodes in batches are those of single environments, bit for bit."""

import contextlib
import os
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import pytest

from limberjack import policies, suite
from limberjack.episodes.episode import Episode, Kept
from limberjack.episodes.playing import Step, batch_for, play, recorded
from limberjack.mujoco.simulation import STATE
from limberjack.policies import Actor
from limberjack.policies.actors import Alone, Batched, EachRow
from limberjack.rl import control
from limberjack.rl.builds import Build
from limberjack.rl.contract import PhysicsError
from limberjack.see.report import Step as ShownStep
from tests.evaluation import evaluated
from tests.plain_pictures import draw_plainly
from tests.rollouts import run_episode

from .collected import ARM, PENDULUM, assert_equal

_SEEDS = [5, 0, 3, *range(100, 165)]  # more than there are rows
_STEPS = 12


def _load(domain: str, task: str, seconds: float | None = None, seed: int = 0) -> Any:
    if seconds is None:
        environment = suite.load(domain, task)
        seconds = _STEPS * environment.control_timestep()
        environment.close()
    return suite.load(domain, task, {"random": seed, "time_limit": seconds})


def _played(
    environment: Any,
    policy: object,
    seeds: Sequence[int],
    kept: Kept | None = None,
    threads: int = 1,
    **how: Any,
) -> dict[int, Episode]:
    """The episodes by seed, in the order in which they end."""
    actor = policy if isinstance(policy, Alone | Batched | EachRow) else None
    if actor is None:
        actor = policies.find(policy, environment if isinstance(policy, str) else None)
    batch = batch_for(environment, actor, seeds, threads)
    with contextlib.closing(batch):
        ended = [episode for some in play(batch, actor, seeds, kept, **how) for episode in some]
    assert sorted(episode.seed for episode in ended) == sorted(seeds)
    return {episode.seed: episode for episode in ended}


def _alone(environment: Any, policy: object, seed: int) -> np.ndarray:
    """The rewards of a single environment with this seed."""
    environment.reseed(seed)
    actor = policy if not isinstance(policy, str | type) else policies.find(policy)
    return run_episode(environment, actor, seed).rewards  # pyright: ignore[reportArgumentType]


def _assert_alone(
    environment: Any, policy: object, episodes: dict[int, Episode], seeds: Iterable[int]
) -> None:
    for seed in seeds:
        expected = _alone(environment, policy, seed)
        np.testing.assert_array_equal(episodes[seed].rewards, expected)


@pytest.mark.parametrize(
    ("domain", "task"),
    [("humanoid", "walk"), ("manipulator", "insert_peg"), ("stacker", "stack_2")],
)
@pytest.mark.parametrize("name", ["zero", "random"])
def test_each_episode_is_that_of_a_single_environment(domain: str, task: str, name: str) -> None:
    environment = _load(domain, task)
    _assert_alone(environment, name, _played(environment, name, _SEEDS), _SEEDS[::9])


@pytest.mark.parametrize("where", [PENDULUM, ARM, ("reacher", "easy", 0.06)])
@pytest.mark.parametrize("kind", ["vectorised", "rows"])
def test_everything_that_is_kept_is_that_of_a_single_environment(
    where: tuple[str, str, float], kind: str
) -> None:
    random = policies.find("random")
    actor = random if kind == "vectorised" else Alone("random", None, random.begin_alone)
    episodes = _played(_load(*where), actor, range(62, 66), Kept(states=True))
    for episode in episodes.values():
        single, steps = _load(*where, seed=episode.seed), list[ShownStep]()
        states, reached = list[np.ndarray](), list[bool]()

        def on_step(step: ShownStep) -> None:
            steps.append(step)  # noqa: B023 (called in this turn)
            states.append(single.physics.get_state(STATE))  # noqa: B023
            if step.number:
                reached.append(bool(single.task.is_success(single.reward_terms)))  # noqa: B023

        run_episode(single, policies.random, episode.seed, on_step)
        for name, values in episode.observations.items():
            expected = np.array([step.time_step.observation[name] for step in steps])
            np.testing.assert_array_equal(values, expected)
        np.testing.assert_array_equal(episode.actions, [step.action for step in steps[1:]])
        np.testing.assert_array_equal(episode.rewards, [step.reward for step in steps[1:]])
        np.testing.assert_array_equal(episode.states, states)
        np.testing.assert_array_equal(episode.success, reached)
        assert episode.truncated.tolist() == [False] * (episode.length - 1) + [True]
        assert not episode.terminated.any()
        fields = single.snapshot().physics
        assert set(episode.fields) == set(single.task.EPISODE_FIELDS)
        for name, values in episode.fields.items():
            np.testing.assert_array_equal(values, fields[name][0])


def test_episodes_do_not_depend_on_those_beside_them() -> None:
    kept = Kept(states=True)
    together = _played(_load(*ARM), "random", range(70), kept, threads=2)
    alone = _played(_load(*ARM), "random", [3, 69], kept)
    for seed in (3, 69):
        assert_equal(alone[seed], together[seed])


def test_an_episode_ends_where_its_task_or_its_simulation_ends_it() -> None:
    environment = evaluated.sinking(0, some_diverge=True)
    episodes = _played(environment, "zero", range(40), Kept()).values()
    diverged = [episode for episode in episodes if episode.diverged]
    sunk = [e for e in episodes if e.terminated[-1] and not e.diverged]
    assert diverged
    assert sunk
    assert len({episode.length for episode in sunk}) > 1
    for episode in episodes:
        assert (episode.terminated | episode.truncated).tolist()[-1]
        assert not (episode.terminated | episode.truncated)[:-1].any()
    assert all(episode.rewards[-1] == 0.0 for episode in diverged)


def test_divergence_ends_an_episode_alike_in_a_batch_and_alone() -> None:
    environment, zero = evaluated.sinking(some_diverge=True), policies.find("zero")
    batched = _played(environment, zero, range(24), Kept())
    alone = _played(environment, Alone("zero", None, zero.begin_alone), range(24), Kept())
    for seed in range(24):
        assert_equal(batched[seed], alone[seed])
    assert 0 < sum(episode.diverged for episode in batched.values()) < 24
    batch = batch_for(environment, zero, range(24), 1, "raise")
    with contextlib.closing(batch), pytest.raises(PhysicsError):
        list(play(batch, zero, range(24)))


def test_recorded_actions_give_the_same_episodes() -> None:
    kept = Kept(states=True)
    episodes = _played(_load(*ARM), "random", range(3), kept)
    actor = recorded({seed: episode.actions for seed, episode in episodes.items()})
    again = _played(_load(*ARM), actor, range(3), kept)
    for seed in range(3):
        assert_equal(again[seed], episodes[seed])
    environment = _load(*ARM, seed=2)
    np.testing.assert_array_equal(run_episode(environment, actor, 2).rewards, again[2].rewards)


def test_an_episode_can_be_cut_off() -> None:
    whole = _played(_load(*ARM), "random", range(66), Kept(states=True))
    part = _played(_load(*ARM), "random", range(66), Kept(states=True), most_steps=3)
    for seed in range(66):
        assert part[seed].length == 3
        kept = whole[seed].states
        assert kept is not None
        np.testing.assert_array_equal(part[seed].states, kept[:4])
        assert not (part[seed].terminated | part[seed].truncated).any()


def test_longer_episodes_than_there_was_room_for_are_kept_whole() -> None:
    environment = suite.load("pendulum", "swingup", {"time_limit": float("inf")})
    actor = policies.find("random")
    with contextlib.closing(batch_for(environment, actor, range(2), 1)) as batch:
        ended = list(play(batch, actor, [3, 4], Kept(states=True), most_steps=2100))
    environment.reseed(4)
    rewards = run_episode(environment, policies.random, 4, max_steps=2100).rewards
    (episode,) = (episode for episode in ended[0] if episode.seed == 4)
    np.testing.assert_array_equal(episode.rewards, rewards)
    assert episode.states is not None
    assert len(episode.states) == 2101
    assert episode.states[1000:].any(axis=-1).all()


def test_steps_are_reported_as_they_are_taken() -> None:
    seen: list[Step] = []
    episodes = _played(_load(*PENDULUM), "random", range(2), on_step=seen.append)
    assert [step.count for step in seen] == [0] + [2] * 10
    single: list[ShownStep] = []
    run_episode(_load(*PENDULUM, seed=1), policies.random, 1, single.append)
    for step, expected in zip(seen, single, strict=True):
        shown = step.of_row(1)
        assert (shown.number, shown.total) == (expected.number, expected.total)
        assert shown.reward == expected.reward
        assert shown.time_step.step_type == expected.time_step.step_type
        np.testing.assert_array_equal(shown.action, expected.action)
        for name, value in expected.time_step.observation.items():
            np.testing.assert_array_equal(shown.time_step.observation[name], value)
    assert seen[-1].totals.tolist() == [episodes[0].total, episodes[1].total]


def test_random_actions_are_those_of_the_policy_with_that_seed() -> None:
    environment = _load("manipulator", "bring_ball")
    episodes = _played(environment, "random", [3, 8], Kept())
    for seed in (3, 8):
        act = policies.random(environment.action_spec(), seed)
        expected = [act({}) for _ in range(_STEPS)]
        np.testing.assert_array_equal(episodes[seed].actions, expected)


@pytest.mark.parametrize("policy", [evaluated.leaning, evaluated.Leaning])
def test_a_function_of_one_observation_sees_what_a_single_environment_shows(policy: Any) -> None:
    episodes = _played(_load("humanoid", "stand"), policy, [4, 9])
    _assert_alone(_load("humanoid", "stand"), "evaluated:leaning", episodes, [4, 9])


_Stacks = dict[int, list[np.ndarray]]  # those of an episode, by its seed


def _looking(seen: _Stacks) -> policies.Policy:
    """A policy that acts by what it sees, and keeps it."""

    def begin(spec: Any, seed: int) -> policies.Act:
        stacks = seen.setdefault(seed, [])

        def act(observation: Any) -> np.ndarray:
            stacks.append(observation["pixels"].copy())
            return np.cos(stacks[-1].sum() + np.arange(spec.shape[0]))

        return act

    return begin


def _seen(make: Any, seed: int, repeat: int) -> tuple[list[np.ndarray], list[float]]:
    """The stacks that an environment shows if it repeats actions, and its rewards per step."""
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
    return seen[seed], rewards


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
    seeds = [4, 5, 6, 68, 71]  # of which those from 64 begin in the middle of the others
    actor: Actor = EachRow("looking", None, _looking(seen))
    if is_alone:
        actor = Alone("looking", None, actor.begin_alone)
    episodes = _played(Build.of(make), actor, seeds, action_repeat=repeat)
    for seed in seeds:
        stacks, expected = _seen(make, seed, repeat)
        np.testing.assert_array_equal(seen[seed], stacks)
        np.testing.assert_array_equal(episodes[seed].rewards, expected)
    # Rows act at different times.
    assert len({episode.length for episode in episodes.values()}) > 1


def test_a_row_takes_the_next_seed_when_its_episode_ends() -> None:
    seeds = list(range(81))  # more than there are rows
    episodes = _played(evaluated.sinking(), "evaluated:linear", seeds)
    _assert_alone(evaluated.sinking(), "evaluated:linear", episodes, seeds[::5])
    # Rows went on at different times.
    assert len({episode.length for episode in episodes.values()}) > 2
    assert list(episodes) != seeds


def test_a_policy_for_batches_gives_what_it_gives_row_by_row() -> None:
    seeds = list(range(81))  # more than there are rows
    policy = evaluated.Linear()
    episodes = _played(evaluated.sinking(), policy, seeds)
    _assert_alone(evaluated.sinking(), "evaluated:linear", episodes, seeds[::5])
    assert sorted(policy.begun) == seeds


def test_a_policy_for_batches_receives_64_rows_even_if_few_are_in_use() -> None:
    # Linear itself checks the shape.
    assert len(_played(evaluated.sinking(), evaluated.Linear, [7, 8, 9])) == 3


def test_an_episode_of_a_policy_in_float32_does_not_depend_on_the_others() -> None:
    # A product of matrices in float32 rounds by the row.
    whole = _played(evaluated.sinking(), evaluated.Network, range(70))
    for seeds in ([69], [64, 0, 5], list(range(69, 2, -1))):
        for seed, episode in _played(evaluated.sinking(), evaluated.Network, seeds).items():
            assert_equal(episode, whole[seed])


def test_the_number_of_threads_changes_nothing() -> None:
    one, two = (
        _played(evaluated.sinking(), "random", range(20), Kept(states=True), threads)
        for threads in (1, 2)
    )
    assert list(one) == list(two)
    for seed in range(20):
        assert_equal(one[seed], two[seed])


@pytest.mark.parametrize(
    ("policy", "where"),
    [
        ("evaluated:Remembering", ("humanoid", "stand", 0.3)),
        ("planner", ("manipulator", "bring_ball", 0.03)),
    ],
)
def test_what_plays_alone_plays_what_it_plays_in_a_single_environment(
    policy: str, where: tuple[str, str, float]
) -> None:
    environment = _load(*where)
    actor = policies.find(policy, environment, num_threads=1)
    assert actor.plays_alone
    _assert_alone(environment, policy, _played(environment, actor, [1, 2]), [1, 2])


def test_what_plays_alone_is_refused_more_rows_and_vectorised_ones() -> None:
    actor, batches = policies.find("evaluated:Remembering"), policies.find("zero")
    for rows in (1, 2):
        batch = batch_for(evaluated.sinking(), batches, range(rows))
        refused = pytest.raises(
            policies.PolicyError, match="one episode at a time; expected a batch"
        )
        with contextlib.closing(batch), refused:
            list(play(batch, actor, [0]))
