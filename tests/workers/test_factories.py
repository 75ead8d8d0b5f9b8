"""Factories of environments: by name, and by a function of the user's own."""

import functools
import re
import types
from collections.abc import Callable
from typing import Any

import pytest

from limberjack import suite
from limberjack.episodes.environments import step_limit_of
from limberjack.rl.control import Environment
from limberjack.workers.factories import factory_of
from tests import plain_domain

_OF_FUNCTIONS = "environment_sha256"


def test_names_make_the_environment_that_the_suite_loads() -> None:
    factory = factory_of("stacker", "stack_2", time_limit=0.2)
    assert (factory.title, factory.facts) == (
        "stacker stack_2",
        {"domain": "stacker", "task": "stack_2"},
    )
    made, loaded = factory.make(3), suite.load("stacker", "stack_2", {"random": 3})
    assert step_limit_of(made) == 20
    assert (
        made.reset().observation["box_pos"].tolist()
        == loaded.reset().observation["box_pos"].tolist()
    )
    assert factory.is_known


def test_a_domain_that_is_not_the_suites_is_known_by_the_source_of_its_module(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    suite.register("pushing", plain_domain)
    try:
        factory = factory_of("pushing", "push", 0.1)
    finally:
        suite.unregister("pushing")
    assert factory.facts["domain_sha256"] == factory_of(plain_domain.make).facts[_OF_FUNCTIONS]
    assert factory.is_known
    of_that_name = types.ModuleType("tests.plain_domain")
    monkeypatch.setattr(of_that_name, "SUITE", plain_domain.SUITE, raising=False)
    monkeypatch.setitem(suite._DOMAINS, "typed", of_that_name)
    assert factory_of("typed", "push").facts["domain_sha256"] is None
    assert not factory_of("typed", "push").is_known


def test_a_function_is_known_by_its_module_its_name_and_its_source() -> None:
    factory = factory_of(plain_domain.make)
    assert factory.title == factory.facts["environment"] == "tests.plain_domain:make"
    assert re.fullmatch("[0-9a-f]{64}", factory.facts["environment_sha256"] or "")
    assert factory.is_known
    assert step_limit_of(factory.make(3)) == 25


class _Maker:
    def __call__(self, seed: int) -> Environment:
        return plain_domain.make(seed)


def _hidden() -> Callable[[int], Environment]:
    def make(seed: int) -> Environment:
        return plain_domain.make(seed)

    return make


@pytest.mark.parametrize(
    "make",
    [
        lambda seed: plain_domain.make(seed),
        functools.partial(plain_domain.push, 0.5),
        _hidden(),
        _Maker(),
    ],
    ids=["a lambda", "a partial", "a function within a function", "an object"],
)
def test_a_function_that_depends_on_more_than_its_source_has_no_hash(
    make: Callable[[int], Environment],
) -> None:
    factory = factory_of(make)
    assert factory.facts["environment_sha256"] is None
    assert not factory.is_known
    assert step_limit_of(factory.make(3)) == 25


def _broken(seed: int) -> Environment:
    raise ZeroDivisionError(f"seed {seed}")


def test_an_error_of_a_function_says_which_environment_it_made() -> None:
    failing: list[tuple[Any, type[Exception]]] = [
        (_broken, ZeroDivisionError),
        (lambda seed: None, TypeError),
    ]
    for make, error in failing:
        with pytest.raises(error) as caught:
            factory_of(make).make(3)
        (note,) = caught.value.__notes__
        assert note.startswith(f"environment '{__name__}:")
        assert note.endswith("as it is made with seed 3")


@pytest.mark.parametrize("seed", [True, 1.5, -1])
def test_an_invalid_seed_is_refused(seed: Any) -> None:
    for factory in (factory_of(plain_domain.make), factory_of("humanoid", "stand")):
        with pytest.raises((TypeError, ValueError), match=f"seed is {seed}; expected a whole"):
            factory.make(seed)


def test_a_world_is_that_of_every_environment_and_of_another_length() -> None:
    factory = factory_of("reacher", "easy", 0.2, {"faults": {"dummies": 1}})
    for one in (factory, factory.lasting(0.4)):
        assert "dummy-0" in one.make(3).reset().observation
    with pytest.raises(TypeError, match=r"world is \{'faults': 'easy'\}, but .* makes"):
        factory_of(plain_domain.make, world={"faults": "easy"})


def test_a_world_has_no_other_options() -> None:
    with pytest.raises(TypeError, match=r"world has no option 'randomize'\. It takes: "):
        factory_of("cartpole", "balance", world={"randomize": {}})


def test_a_world_that_is_no_mapping_is_refused() -> None:
    with pytest.raises(TypeError, match=r"world is 'easy'; expected a mapping, such as \{'faults'"):
        factory_of("walker", "walk", None, "easy")  # pyright: ignore[reportArgumentType]
