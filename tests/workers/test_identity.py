"""The identity of an episode's setup, and the canary."""

import re
from typing import Any

import pytest

from limberjack import policies, suite
from limberjack.workers.factories import factory_of
from limberjack.workers.identity import (
    advice_on,
    canary_of,
    first_difference,
    first_mismatch,
    identity_of,
    processor,
)
from limberjack.worlds.faults import Faults

from .playing import TASK

_FACTS = {"task": "walk", "versions": {"mujoco": "4.0.0", "numpy": "2.4.1"}, "canary": "a"}


def test_the_canary_is_the_same_each_time_and_differs_between_tasks() -> None:
    first = canary_of(factory_of(*TASK))
    assert re.fullmatch("[0-9a-f]{64}", first)
    assert canary_of(factory_of(*TASK)) == first
    assert canary_of(factory_of("cartpole", "swingup")) != first


def test_the_canary_notices_a_change_of_one_bit(monkeypatch: pytest.MonkeyPatch) -> None:
    before = canary_of(factory_of(*TASK))
    reward = suite.pendulum.SwingUp.get_reward
    monkeypatch.setattr(
        suite.pendulum.SwingUp, "get_reward", lambda task, physics: reward(task, physics) + 1e-300
    )
    monkeypatch.setattr(
        suite.pendulum.Physics, "pole_vertical", lambda physics: physics.named.data.qpos[0] + 1e-16
    )
    assert canary_of(factory_of(*TASK)) != before


def test_the_canary_of_a_short_episode_ends_with_it() -> None:
    assert canary_of(factory_of(*TASK, time_limit=0.1)) != canary_of(factory_of(*TASK))


def test_identities_of_policies_differ_in_their_names_and_hashes() -> None:
    factory = factory_of(*TASK)
    environment = factory.make(0)
    one, other = (
        identity_of(factory, policies.find(name, environment), environment)
        for name in ("zero", "random")
    )
    assert {name for name in one if one[name] != other[name]} == {"policy", "policy_sha256"}


def test_a_difference_is_named_down_to_the_package() -> None:
    other = {**_FACTS, "versions": {"mujoco": "4.0.0", "numpy": "2.4.2"}}
    assert first_difference(_FACTS, other) == ("versions.numpy", "2.4.1", "2.4.2")
    assert first_difference(_FACTS, dict(_FACTS)) is None
    assert first_difference(_FACTS, {**_FACTS, "more": 1}) == ("more", None, 1)


def test_any_processor_waives_the_canary_and_the_fingerprint_only() -> None:
    other = {**_FACTS, "canary": "b", "fingerprint": "c"}
    assert first_difference(_FACTS, other) == ("canary", "a", "b")
    assert first_difference(_FACTS, other, any_processor=True) is None
    assert first_difference(_FACTS, {**other, "task": "run"}, any_processor=True) is not None


def test_kept_episodes_may_differ_in_patch_numbers() -> None:
    patched = {**_FACTS, "versions": {"mujoco": "4.0.9", "numpy": "2.4.1"}, "seed": 3}
    assert first_mismatch(_FACTS, patched) is None
    newer = {**_FACTS, "versions": {"mujoco": "4.1.0", "numpy": "2.4.1"}}
    assert first_mismatch(_FACTS, newer) == ("versions", {"mujoco": "4.0.0"}, {"mujoco": "4.1.0"})
    assert first_mismatch(_FACTS, {**_FACTS, "canary": "b"}) == ("canary", "a", "b")
    assert first_mismatch(_FACTS, {**_FACTS, "canary": "b"}, any_processor=True) is None


def test_only_what_a_processor_changes_comes_with_that_advice() -> None:
    assert "--any-processor" in advice_on("canary")
    assert advice_on("task") == ""


def test_the_processor_is_named_with_its_c_library() -> None:
    assert processor()
    assert processor() == processor()


def test_a_world_is_part_of_the_identity() -> None:
    def identity(world: dict[str, object] | None) -> Any:
        factory = factory_of("reacher", "easy", world=world)
        environment = factory.make(0)
        return identity_of(factory, policies.find("zero", environment), environment)

    plain, easy = identity(None), identity({"faults": "easy"})
    assert plain["world"] is None
    # The challenges perturb no parameter of this task.
    settings = {**Faults.of("easy").as_json(), "perturbation": None}
    assert easy["world"] == {"faults": settings}
    assert first_difference(plain, easy) == ("world", None, easy["world"])
    hard = identity({"faults": "hard"})
    assert first_difference(easy, hard) == ("world.faults.delay.actions", 3, 9)
    # Results of earlier versions have no such entry.
    before = {name: fact for name, fact in plain.items() if name != "world"}
    assert first_mismatch(plain, before) is None
    assert first_mismatch(plain, easy) == ("world", None, easy["world"])
