"""`batch_of`: the kind of batch, its reason, and the numbers of single environments in each."""

import functools
import itertools
import re
from typing import Any

import numpy as np
import pytest

from limberjack import policies, rl, suite
from limberjack.episodes.playing import batch_for, play
from limberjack.episodes.statistics import Score
from limberjack.policies.actors import Alone
from limberjack.rl.batch import BatchEnvironment
from limberjack.rl.batches import batch_of, vectorisable
from limberjack.rl.builds import Build
from limberjack.rl.rows import RowsEnvironment
from tests.rollouts import run_episode

from . import odd_environments as odd

# What the reasons name, by kind.
_REASONS = {
    "a last action": "self.last",
    "a kept array": "before_step",
    "a counter": "self.steps in after_step",
    "queues": "self.means in get_observation",
    "noise": "draws from the task's random stream in get_observation",
    "a perturbed model": "EPISODE_FIELDS",
    "a potential": "self.potential",
    "a curriculum": "self.episodes in initialize_episode",
    "slots": "self.count",
    "constraints": "the reward",
    "delayed observations": "Delaying overrides reset",
    "a reset that writes the model": "ModelWriting overrides reset",
    "a log": "Logging overrides reset",
    "a physics that remembers": "physics.total",
    "a distracting wrapper": "Distracting overrides __getattr__",
    "repeated actions": "it is a Repeating",
    "nested wrappers": "it is a Repeating",
    "scaled actions": "it is a Wrapper",
    "noisy actions": "it is a Wrapper",
    "randomisation": "self.last",
    "a model for each seed": "differ in more than their seed",
    "flat observations": "self.means",
    "a walk on a line": "it is a Catch",
}


@pytest.mark.parametrize("kind", odd.KINDS)
def test_any_environment_becomes_a_batch_with_the_numbers_of_single_ones(kind: str) -> None:
    build, actions = odd.KINDS[kind], odd.actions_of(odd.STEPS + 3, 2)
    singles = [odd.steps_of(build(3 + row), actions[:, row]) for row in range(2)]
    expected = [list(step) for step in zip(*singles, strict=True)]
    given = [build] if kind in odd.FROM_BUILD_ONLY else [build, build(3)]
    for one in given:
        batch = batch_of(one, 2, 1, seed=3)
        assert odd.future(batch, actions) == expected
        if kind in ("a plain task", "no observations"):
            assert isinstance(batch, BatchEnvironment)
            assert batch.why_rows is None
        else:
            assert isinstance(batch, RowsEnvironment)
            assert _REASONS[kind] in str(batch.why_rows)
            assert str(batch.why_rows) in repr(batch)
        batch.close()


@pytest.mark.parametrize("kind", _REASONS)
def test_the_reason_is_raised_where_vectorised_is_asked_for(kind: str) -> None:
    with pytest.raises(ValueError, match=re.escape(_REASONS[kind])):
        batch_of(odd.KINDS[kind], 2, 1, seed=3, vectorised=True)


def _alone(build: Any, policy: Any, seeds: list[int]) -> list[Score]:
    scores = []
    for seed in seeds:
        env = build(seed)
        episode = run_episode(env, policy, seed)
        scores.append(Score.of(episode))
    return scores


@pytest.mark.parametrize("kind", odd.KINDS)
def test_episodes_that_are_played_are_those_of_single_environments(kind: str) -> None:
    build, policy = odd.KINDS[kind], policies.find("random")
    seeds = [5, 0, 3, 69, 133]  # 5, 69 and 133 are played in turn by one row
    expected = _alone(build, policy, seeds)
    for actor in (policy, Alone(policy.name, None, policy.begin_alone)):
        batch = batch_for(Build.of(build), actor, seeds, 1)
        scores = {e.seed: Score.of(e) for ended in play(batch, actor, seeds) for e in ended}
        assert [scores[seed] for seed in seeds] == expected
        batch.close()


def test_rows_can_be_asked_for_and_contexts_need_them() -> None:
    env = odd.environment()
    batch = batch_of(env, 2, seed=0, vectorised=False)
    assert isinstance(batch, RowsEnvironment)
    assert batch.why_rows == "rows were asked for"
    batch: Any = batch_of(_weighed, 2, seed=0, contexts=[{"mass": 1.0}, {"mass": 2.0}])
    assert isinstance(batch, RowsEnvironment)
    environments: Any = batch.environments
    assert [one.physics.model.body_mass[1] for one in environments] == [1.0, 2.0]
    with pytest.raises(ValueError, match="contexts were given"):
        batch_of(_weighed, 2, seed=0, vectorised=True, contexts=[{}, {}])


def _weighed(seed: int, mass: float = 1.0) -> Any:
    env = odd.environment(odd.Pole, seed)
    env.physics.model.body_mass[1] = mass
    return env


@pytest.mark.parametrize(
    ("wrong", "error"),
    [
        ({"num_envs": 0}, ValueError),
        ({"num_threads": 0}, ValueError),
        ({"seed": -1}, ValueError),
        ({"seed": "a"}, TypeError),
        ({"on_divergence": "stop"}, ValueError),
        ({"vectorised": "no"}, ValueError),
    ],
)
@pytest.mark.parametrize("kind", ["a plain task", "a last action"])
def test_wrong_numbers_are_refused_for_both_kinds(
    kind: str, wrong: dict[str, Any], error: type[Exception]
) -> None:
    with pytest.raises(error, match=f"{next(iter(wrong))} is"):
        batch_of(odd.KINDS[kind], **{"num_envs": 2, **wrong})


def test_the_package_has_the_function() -> None:
    assert rl.batch_of is batch_of
    with pytest.raises(TypeError, match=r"expected a dm_env\.Environment or a function"):
        batch_of(None, 2)  # pyright: ignore[reportArgumentType]
    with pytest.raises(MemoryError, match="num_envs is 1000000000"):
        batch_of(odd.KINDS["a log"], 10**9, seed=0)


def test_only_tasks_that_can_be_vectorised_are_for_code_without_rows() -> None:
    plain = odd.environment()
    assert vectorisable(plain) is plain
    with pytest.raises(ValueError, match="Logging overrides"):
        vectorisable(odd.KINDS["a log"](0))
    with pytest.raises(ValueError, match=r"self\.last.*batches play such tasks"):
        vectorisable(odd.KINDS["a last action"](0))


def test_the_suites_own_tasks_are_vectorised() -> None:
    batch = batch_of(functools.partial(_cartpole), 2, seed=0)
    assert batch.why_rows is None
    np.testing.assert_array_equal(
        batch.reset().observation["position"][1], _cartpole(1).reset().observation["position"]
    )


def _cartpole(seed: int) -> Any:
    return suite.load("cartpole", "swingup", {"random": seed})


class _Holding(odd.Pole):
    """Reads what it keeps of the simulation in the place of what the hooks get."""

    def __init__(self, kept: Any, random: Any = None) -> None:
        super().__init__(random=random)
        self.kept = kept

    def get_reward(self, physics: Any) -> Any:
        kept: Any = self.kept() if callable(self.kept) else self.kept
        return float(np.sum(kept if isinstance(kept, np.ndarray) else kept.position()))


_KEPT: dict[str, Any] = {
    "physics": lambda physics: physics,
    "view": lambda physics: physics.data.qpos,
    "method": lambda physics: physics.position,
}


def _holding(seed: int, kind: str) -> Any:
    env = odd.environment(odd.Pole, seed)
    env._task = _Holding(_KEPT[kind](env.physics), random=seed)
    return env


@pytest.mark.parametrize("kind", _KEPT)
def test_a_task_that_keeps_the_simulation_is_played_in_rows(kind: str) -> None:
    build = functools.partial(_holding, kind=kind)
    batch = batch_of(build, 3, seed=0)
    assert "keeps the simulation of its environment in self.kept" in str(batch.why_rows)
    singles = [build(row) for row in range(3)]
    batch.reset()
    for single in singles:
        single.reset()
    for _ in range(odd.STEPS - 1):
        rewards = batch.step(np.ones((3, 1))).reward
        assert rewards.tolist() == [one.step(np.ones(1)).reward for one in singles]


class _Starting(odd.Pole):
    """Starts where something that belongs to the task says."""

    def __init__(self, random: Any = None) -> None:
        super().__init__(random=random)
        self.turns = itertools.cycle([0.1, 0.2, 0.3])
        self.count = bytearray(1)

    @functools.cached_property
    def cached(self) -> float:
        return self.random.uniform(-1, 1)

    @functools.lru_cache  # noqa: B019
    def memoised(self) -> float:
        return self.random.uniform(-1, 1)

    def counted(self) -> float:
        self.count[0] += 1
        return 0.1 * self.count[0]


_ANGLES: dict[str, Any] = {
    "cached": lambda task: task.cached,
    "memoised": lambda task: task.memoised(),
    "turns": lambda task: next(task.turns),
    "counted": lambda task: task.counted(),
}


@pytest.mark.parametrize("kind", _ANGLES)
def test_a_task_that_remembers_between_starts_is_played_in_rows(kind: str) -> None:
    class Task(_Starting):
        def initialize_episode(self, physics: Any) -> None:
            physics.named.data.qpos["hinge"] = _ANGLES[kind](self)

    batch = batch_of(lambda seed: odd.environment(Task, seed), 3, seed=0)
    words = "another state once it has begun other rows|sets self.(turns|count) in initialize_epi"
    assert re.search(words, str(batch.why_rows))
    found = batch.reset().observation["position"].ravel()
    singles = [odd.environment(Task, row).reset() for row in range(3)]
    assert found.tolist() == [one.observation["position"][0] for one in singles]


def test_what_a_physics_caches_belongs_to_its_row() -> None:
    class Physics(odd.mujoco.Physics):
        @functools.cached_property
        def first(self) -> float:
            return float(self.data.qpos[0])

    class Task(odd.Pole):
        def initialize_episode(self, physics: Any) -> None:
            super().initialize_episode(physics)
            physics.named.data.qvel["hinge"] = physics.first

    batch = batch_of(lambda seed: odd.environment(Task, seed, physics=Physics), 3, seed=0)
    assert isinstance(batch, RowsEnvironment)


class _Sometimes(odd.Pole):
    """Sets a declared field of the model in about half of its starts."""

    EPISODE_FIELDS = ("dof_damping",)

    def initialize_episode(self, physics: Any) -> None:
        super().initialize_episode(physics)
        if self.random.uniform() < 0.5:
            physics.named.model.dof_damping["hinge"] = 3.0


@pytest.mark.parametrize("vectorised", [True, False])
def test_a_seed_begins_with_the_fields_of_a_new_environment(vectorised: bool) -> None:
    build = functools.partial(odd.environment, _Sometimes)
    played = build(0)
    for seed in range(4):  # until one of them has set the field
        played.reseed(seed)
        played.reset()
    seeds = range(4, 12)
    found = []
    batch = batch_of(played, 2, seed=0, vectorised=vectorised)
    for first in seeds[::2]:
        batch.reset(seeds=[first, first + 1])
        found += batch.step(np.ones((2, 1))).observation["position"].ravel().tolist()
    expected, dampings = [], set()
    for seed in seeds:
        single = build(seed)
        single.reset()
        dampings.add(single.physics.model.dof_damping[0])
        expected += single.step(np.ones(1)).observation["position"].tolist()
    assert len(dampings) == 2
    assert found == expected


class _Viewing(odd.Pole):
    def get_reward(self, physics: Any) -> float:
        return float(physics.angle[0])


def _viewing(seed: int) -> Any:
    env = odd.environment(_Viewing, seed)
    env.physics.angle = env.physics.data.qpos
    return env


def test_a_view_that_a_physics_keeps_shows_the_rows_own_simulation() -> None:
    batch = batch_of(_viewing, 2, seed=0)
    assert "keeps a view of its simulation in self.angle" in str(batch.why_rows)
    batch.reset(seeds=[4, 5])
    single = _viewing(5)
    single.reset()
    snapshot = batch.snapshot()
    expected = single.step(np.ones(1)).reward
    assert batch.step(np.ones((2, 1))).reward[1] == expected
    batch.restore(snapshot)
    assert batch.step(np.ones((2, 1))).reward[1] == expected
