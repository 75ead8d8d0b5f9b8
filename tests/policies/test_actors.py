"""Policies as actors on batches: how they are found, named and hashed."""

import functools
import importlib
from typing import Any

import pytest

from limberjack import suite
from limberjack.evaluation.episodes import play
from limberjack.policies import PolicyError, actors
from limberjack.policies.batched import Batched

evaluated: Any = importlib.import_module("evaluated")  # as policies are named: MODULE:CALLABLE

_STEPS = 12


def _load(domain: str, task: str) -> Any:
    environment = suite.load(domain, task)
    limit = _STEPS * environment.control_timestep()
    environment.close()
    return suite.load(domain, task, {"time_limit": limit})


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
            r"\(64, 21\), for all 64 rows",
        ),
        ("evaluated:WithoutEnd", "returned list of dtype <U4"),
        ("evaluated:too_long", r"step 0 of the episode with seed 66: .* shape \(22,\)"),
    ],
)
def test_what_is_no_action_is_named_with_seed_and_step(policy: str, message: str) -> None:
    environment = _load("humanoid", "stand")
    found = actors.find(policy, environment)
    assert found.actor is not None
    with pytest.raises(PolicyError, match=message):
        list(play(environment, found.actor, range(66, 76), 1))


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
        actors.find(policy, None)


def test_a_policy_may_make_its_functions_as_it_is_made() -> None:
    found = actors.find("evaluated:Compiled", None)
    assert isinstance(found.actor, Batched)


def test_a_policys_hash_is_that_of_its_source() -> None:
    functions = [actors.find(name, None).sha256 for name in ("zero", "random")]
    of_module = {actors.find(f"evaluated:{name}", None).sha256 for name in ("linear", "Linear")}
    assert len(of_module) == 1
    assert len({*functions, *of_module, None}) == 4


def test_a_policy_at_hand_has_the_name_and_hash_that_it_would_be_found_by() -> None:
    for name in ("linear", "Linear", "Remembering"):
        at_hand = actors.find(getattr(evaluated, name), None)
        named = actors.find(f"evaluated:{name}", None)
        assert (at_hand.name, at_hand.sha256) == (named.name, named.sha256)


def test_a_partial_is_called_what_its_function_is() -> None:
    at_hand = actors.find(functools.partial(evaluated.linear), None)
    named = actors.find("evaluated:linear", None)
    assert (at_hand.name, at_hand.sha256) == (named.name, named.sha256)
