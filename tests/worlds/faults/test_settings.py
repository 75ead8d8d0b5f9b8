"""Faults as settings: presets, mappings, and what is refused."""

import json
import math
from typing import Any

import numpy as np
import pytest

from limberjack.worlds.faults.settings import (
    PRESETS,
    Delay,
    Fault,
    Faults,
    Losses,
    Noise,
    Perturbation,
)


@pytest.mark.parametrize(
    ("name", "late", "noise", "loss", "repeated", "dummies"),
    [
        # As get_combined_challenge of the Real World RL suite has them.
        ("easy", Delay(3, 3, 10), 0.1, Fault(0.01, 1), 1, 10),
        ("medium", Delay(6, 6, 20), 0.3, Fault(0.05, 5), 2, 20),
        ("hard", Delay(9, 9, 40), 1.0, Fault(0.1, 10), 3, 50),
    ],
)
def test_presets_have_the_published_figures(
    name: str, late: Delay, noise: float, loss: Fault, repeated: int, dummies: int
) -> None:
    losses = Losses(actions=Fault(), observations=loss)
    perturbed = Perturbation(preset=name, schedule="uniform", period=1)
    faults = late, Noise(noise, noise), losses, losses, Fault(1.0, repeated), dummies, perturbed
    assert Faults.of(name) == Faults(*faults, clear_at_reset=True)


@pytest.mark.parametrize("name", PRESETS)
def test_settings_are_read_as_they_were_written(name: str) -> None:
    found = Faults.of({"preset": name, "dropped": {"actions": {"probability": 0.5}}})
    assert Faults.of(json.loads(json.dumps(found.as_json()))) == found
    assert Faults.of(found) is found


def test_numbers_of_numpy_are_taken_as_those_of_python() -> None:
    given = {"dummies": np.int64(3), "dropped": {"actions": {"probability": np.float32(0.5)}}}
    expected = {"dummies": 3, "dropped": {"actions": {"probability": 0.5}}}
    assert Faults.of(given) == Faults.of(expected)
    assert type(Faults.of(given).dummies) is int
    with pytest.raises(ValueError, match="expected a whole number, 1 to 1000000000"):
        Faults.of({"stuck": {"actions": {"steps": 10**30}}})


def test_a_mapping_changes_a_preset_and_keeps_the_rest() -> None:
    found = Faults.of({"preset": "hard", "delay": {"rewards": 0}, "clear_at_reset": False})
    assert found.delay.rewards == 0
    assert found.delay.actions == PRESETS["hard"].delay.actions
    assert found.noise == PRESETS["hard"].noise
    assert not found.clear_at_reset
    assert Faults.of({}) == Faults()
    assert Faults.of({"preset": "easy", "perturbation": None}).perturbation is None
    once = Faults.of({"preset": "easy", "perturbation": {"period": 5}}).perturbation
    assert once == Perturbation(preset="easy", period=5)


@pytest.mark.parametrize(
    ("given", "error", "message"),
    [
        ("eesy", ValueError, "there are no faults 'eesy'.*Did you mean 'easy'"),
        ({"preset": "eesy"}, ValueError, "Did you mean 'easy'"),
        ({"preset": 3}, ValueError, "there are no faults 3"),
        (3, TypeError, "faults is 3; expected one of easy, medium, hard, or a mapping"),
        ({"dealy": {}}, TypeError, "faults has no 'dealy'. Did you mean 'delay'"),
        ({"delay": 3}, TypeError, r"faults\['delay'\] is 3; expected a mapping of actions"),
        ({"delay": {"actoins": 3}}, TypeError, r"faults\['delay'\] has no 'actoins'. Did you"),
        ({"delay": {"actions": 1.5}}, TypeError, r"\['actions'\] is 1.5; expected a whole number"),
        ({"delay": {"actions": -1}}, ValueError, "is -1; expected a whole number, 0 or more"),
        ({"dummies": True}, TypeError, "is True; expected a whole number"),
        ({"noise": {"actions": float("nan")}}, ValueError, "is nan; expected a number, 0.0 or mo"),
        ({"noise": {"actions": float("inf")}}, ValueError, "is inf; expected a number"),
        ({"repetition": {"probability": 1.1}}, ValueError, "is 1.1; expected a number, 0.0 to 1"),
        ({"repetition": {"steps": 0}}, ValueError, "is 0; expected .*, 1 to 1000000000"),
        ({"clear_at_reset": 1}, TypeError, "is 1; expected a bool"),
        ({"perturbation": 3}, TypeError, r"\['perturbation'\] is 3; expected a mapping of parame"),
        ({"perturbation": {"schedule": "sow"}}, ValueError, "schedule of a perturbation is 'sow'"),
        ({"perturbation": {"preset": "eesy"}}, ValueError, "is 'eesy'.*Did you mean 'easy'"),
        ({"perturbation": {"parameter": 1}}, TypeError, "is 1; expected a str"),
        ({"perturbation": {"period": 0}}, ValueError, "is 0; expected a whole number, 1 or more"),
        ({"perturbation": {"std": "1"}}, TypeError, "is '1'; expected a number"),
    ],
)
def test_what_does_not_exist_is_refused_by_name(
    given: Any, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        Faults.of(given)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (Faults(dummies=-2), r"faults\['dummies'\] is -2; expected a whole number, 0 or more"),
        (Faults(delay=Delay(observations=-1)), r"faults\['delay'\]\['observations'\] is -1"),
        (Faults(noise=Noise(observations=math.nan)), r"\['observations'\] is nan; expected"),
        (Faults(perturbation=Perturbation(period=0)), r"\['period'\] is 0; expected .*, 1 or more"),
    ],
)
def test_settings_made_by_hand_are_checked_too(given: Faults, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Faults.of(given)
