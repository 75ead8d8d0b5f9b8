"""Builds: environments for any seed, from functions and from copies of an instance."""

import functools
import threading
from typing import Any

import numpy as np
import pytest

from limberjack.rl import batch_of, builds
from limberjack.rl.builds import Build, takes_a_seed
from limberjack.rl.rows import RowsEnvironment
from tests import plain_domain

from . import odd_environments as odd


class _Locked(odd.LastAction):
    """Keeps a lock and a generator, and remembers."""

    def __init__(self, random: Any = None) -> None:
        super().__init__(random=random)
        self.lock = threading.Lock()
        self.numbers = iter(range(100))
        self.count = (number for number in range(1000))

    def get_reward(self, physics: Any) -> Any:
        return super().get_reward(physics) + next(self.count)


def test_a_task_that_cannot_be_copied_is_made_again_for_each_seed() -> None:
    make = functools.partial(odd.of_task, _Locked)
    actions = odd.actions_of(5, 1)[:, 0]
    seeded = Build.of(make).seeded(4)
    assert list(odd.steps_of(seeded.environment, actions)) == list(odd.steps_of(make(4), actions))
    for seed in (9, 4):
        seeded.begin(seed)
        assert _episode(seeded.environment, actions) == _episode(make(seed), actions)


def _episode(env: Any, actions: np.ndarray) -> list[odd.Facts]:
    return [odd.facts(env.reset()), *odd.steps_of(env, actions)]


@pytest.mark.parametrize("kind", odd.KINDS)
def test_the_first_episode_of_a_seed_is_that_of_a_new_environment(kind: str) -> None:
    make, actions = odd.KINDS[kind], odd.actions_of(9, 1)[:, 0]
    seeded = Build.of(make).seeded(4)
    for seed in (4, 9, 9, 0, 4):
        seeded.begin(seed)
        assert _episode(seeded.environment, actions) == _episode(make(seed), actions)


@pytest.mark.parametrize("kind", [one for one in odd.KINDS if one not in odd.FROM_BUILD_ONLY])
def test_copies_of_an_instance_begin_any_seed_and_leave_it_alone(kind: str) -> None:
    make, actions = odd.KINDS[kind], odd.actions_of(9, 1)[:, 0]
    original = make(4)
    seeded = Build.of(original).seeded(4)
    for seed in (4, 9, 9, 4):
        seeded.begin(seed)
        assert _episode(seeded.environment, actions) == _episode(make(seed), actions)
    assert list(odd.steps_of(original, actions)) == list(odd.steps_of(make(4), actions))


def test_only_plain_environments_with_one_model_are_stable() -> None:
    for kind, is_expected in {
        "a plain task": True,
        "a last action": True,
        "queues": True,
        "a log": False,
        "scaled actions": False,
        "a walk on a line": False,
        "a model for each seed": False,
    }.items():
        assert builds.is_stable(Build.of(odd.KINDS[kind]), 0) is is_expected


def test_a_plain_environment_is_kept_for_other_seeds_and_others_are_made_again() -> None:
    for kind, is_kept in (("a last action", True), ("a log", False), ("a perturbed model", False)):
        seeded = Build.of(odd.KINDS[kind]).seeded(1)
        before = seeded.environment
        before.reset()
        seeded.begin(2)
        assert (seeded.environment is before) is is_kept


def test_set_attributes_stay_and_make_an_environment_other_than_plain() -> None:
    seeded = Build.of(odd.KINDS["a last action"]).seeded(1)
    assert seeded.is_plain
    seeded.set_attribute("mark", [1])
    assert not seeded.is_plain
    first = seeded.environment
    seeded.begin(2)
    assert seeded.environment is not first
    assert seeded.environment.mark == [1]  # pyright: ignore[reportAttributeAccessIssue]


def test_a_function_of_no_seed_is_not_reproducible() -> None:
    assert builds.is_reproducible(Build.of(odd.KINDS["a log"]), 3)
    assert not builds.is_reproducible(Build.of(_unseeded), 3)


def _any_seed() -> int:
    return int(np.random.default_rng().integers(2**31))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda seed: odd.environment(odd.Pole, 0), "the same random stream for seeds 3 and 2"),
        (lambda seed: odd.environment(odd.Pole, _any_seed()), "each time it is called with seed 3"),
    ],
    ids=["constant", "arbitrary"],
)
def test_a_function_that_ignores_its_seed_is_refused(make: Any, message: str) -> None:
    with pytest.raises(ValueError, match=f"{message}: hand its seed on to the task"):
        builds.is_stable(Build.of(make), 3)


def test_a_function_without_an_argument_is_refused() -> None:
    with pytest.raises(TypeError, match=r"cannot be called with a seed; expected a function build"):
        Build.of(lambda: odd.environment(odd.Pole, 0))


def _heavy_from_5(seed: int) -> Any:
    env = odd.environment(odd.Pole, seed)
    if seed >= 5:
        env.physics.model.body_mass[-1] *= 2
    return env


def test_the_environments_of_the_seeds_that_a_build_is_for_are_compared() -> None:
    build = Build.of(_heavy_from_5)
    assert builds.is_stable(build, 0)
    assert builds.is_stable(build.for_seeds([1, 4]), 0)
    assert not builds.is_stable(build.for_seeds([1, 7]), 0)
    modulo = Build.of(lambda seed: odd.environment(odd.Pole, seed % 2))
    assert builds.is_stable(modulo, 0)
    assert not builds.is_stable(modulo.for_seeds([3]), 0)


_drawn = np.random.default_rng(0)


class _Drawing(odd.Pole):
    def get_reward(self, physics: Any) -> Any:
        return _drawn.uniform()


def _heavier_each_time(seed: int) -> Any:
    env = odd.environment(odd.Pole, seed)
    env.physics.model.body_mass[-1] *= _drawn.uniform()
    return env


@pytest.mark.parametrize("make", [functools.partial(odd.of_task, _Drawing), _heavier_each_time])
def test_first_steps_and_the_model_are_compared_too(make: Any) -> None:
    assert not builds.is_reproducible(Build.of(make), 3)


def _defined_inside(seed: int) -> Any:
    class Inside(odd.Pole):
        """A class that is another one each time, and does the same."""

    return odd.environment(Inside, seed)


def test_classes_that_are_defined_as_the_environment_is_made_are_compared_by_name() -> None:
    build = Build.of(_defined_inside)
    assert builds.is_reproducible(build, 3)
    assert not builds.is_stable(build, 3)  # a class may depend on the seed: rows are made


class _Diverging(odd.Pole):
    def after_step(self, physics: Any) -> None:
        physics.named.data.qvel["hinge"] = 1e20


def test_environments_that_diverge_in_their_first_steps_are_compared_up_to_there() -> None:
    assert builds.is_reproducible(Build.of(functools.partial(odd.of_task, _Diverging)), 3)


def _unseeded(seed: int) -> Any:
    return odd.environment(odd.LastAction, np.random.randint(2**31))


@pytest.mark.parametrize("given", [None, 5, "cartpole", object(), odd.Pole])
def test_anything_but_an_environment_or_a_function_that_makes_one_is_refused(given: Any) -> None:
    with pytest.raises(TypeError, match=r"expected a dm_env\.Environment"):
        Build.of(given).make(0)


def test_an_environment_without_a_task_needs_a_function() -> None:
    with pytest.raises(TypeError, match=r"pass a function build\(seed\)"):
        Build.of(_Unseedable())


class _Unseedable(odd.Catch):
    def __init__(self) -> None:
        super().__init__(0)
        del self._stream


class _Tabled(odd.Pole):
    """Begins where a table says, which no comparison of settings sees."""

    table: Any = None

    def initialize_episode(self, physics: Any) -> None:
        super().initialize_episode(physics)
        physics.named.data.qpos["hinge"] = self.table["start"]


def _tabled(seed: int) -> Any:
    env = odd.environment(_Tabled, seed)
    env.task.table = {"start": 0.1 * seed}
    return env


def test_environments_that_begin_elsewhere_for_another_seed_are_not_stable() -> None:
    assert not builds.is_stable(Build.of(_tabled), 0)
    seeded = Build.of(_tabled).seeded(1)
    before = seeded.environment
    seeded.begin(2)
    assert seeded.environment is not before


class _Leaning(odd.LastAction):
    """Rewards come from a setting of the class, which a property sets."""

    lean = 0.0

    def get_reward(self, physics: Any) -> Any:
        return self.lean

    @property
    def doubled(self) -> float:
        return 2 * self.lean

    @doubled.setter
    def doubled(self, value: float) -> None:
        self.lean = value / 2


@pytest.mark.parametrize(("name", "value"), [("lean", 3.0), ("doubled", 6.0)])
def test_a_setting_of_a_class_or_a_property_holds_for_later_seeds(name: str, value: float) -> None:
    seeded = Build.of(functools.partial(odd.of_task, _Leaning)).seeded(0)
    env = seeded.environment
    seeded.set_attribute(name, value)
    for seed in (1, 2):
        seeded.begin(seed)
        assert seeded.environment is env
        env.reset()
        assert env.step(np.zeros(1)).reward == 3.0


def test_whether_a_function_takes_a_seed_is_read_from_its_signature() -> None:
    assert takes_a_seed(plain_domain.make)
    assert takes_a_seed(lambda *arguments: None)
    assert not takes_a_seed(lambda: None)
    assert not takes_a_seed(lambda domain, task: None)


def test_a_setting_that_the_task_changes_in_place_is_put_back_as_it_was_set() -> None:
    seeded = Build.of(odd.KINDS["a last action"]).seeded(1)
    given = [1]
    seeded.set_attribute("mark", given)
    environment: Any = seeded.environment
    assert environment.mark is given
    given.append(2)
    seeded.begin(2)
    environment = seeded.environment
    assert environment.mark == [1]


def _unknown(seed: int) -> Any:
    env = odd.environment(odd.LastAction, seed)
    env.task.scale = float("nan")
    return env


def test_a_setting_that_is_nan_equals_itself() -> None:
    assert builds.is_reproducible(Build.of(_unknown), 0)
    assert builds.is_stable(Build.of(_unknown), 0)


_SETTINGS: dict[str, Any] = {
    "a NumPy number": lambda random: random.integers(1, 10**9),
    "a list": lambda random: [random.uniform(), [random.uniform()]],
    "a tuple of arrays": lambda random: (random.uniform(size=2), random.uniform(size=3)),
    "a mapping": lambda random: {"gain": random.uniform(size=2)},
}


@pytest.mark.parametrize("kind", _SETTINGS)
def test_settings_that_are_drawn_from_the_seed_belong_to_its_rows(kind: str) -> None:
    def make(seed: int) -> Any:
        env = odd.environment(odd.Pole, seed)
        env.task.setting = _SETTINGS[kind](np.random.default_rng(seed))
        return env

    assert not builds.is_stable(Build.of(make), 0)
    batch = batch_of(make, 2, seed=0)
    batch.reset(seeds=[4, 5])
    assert isinstance(batch, RowsEnvironment)
    for row, task in enumerate(batch.get_attr("task")):
        setting = getattr(task, "setting")  # noqa: B009 (of a user's task)
        np.testing.assert_equal(setting, make(4 + row).task.setting)


def test_settings_that_are_alike_are_stable() -> None:
    def make(seed: int) -> Any:
        env = odd.environment(odd.Pole, seed)
        loop: list[Any] = [np.array([np.nan, 1.0]), {"a": (1, None)}, object()]
        loop.append(loop)
        env.task.setting = loop
        return env

    assert builds.is_stable(Build.of(make), 0)
