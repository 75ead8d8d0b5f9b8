"""The planner's options, and those that are refused."""

from typing import Any

import numpy as np
import pytest

from limberjack import suite
from limberjack.planner import MPPI, Planner, Settings


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ({"samples": 1}, "samples is 1; expected a whole number from 2 up"),
        ({"knots": 2, "anchored": True}, "knots is 2; expected a whole number from 3 up"),
        ({"knots": 2.5}, "knots is 2.5; expected a whole number"),
        ({"horizon": float("nan")}, "horizon is nan; expected a positive number"),
        ({"gain": "much"}, "gain is 'much'; expected a positive number"),
        ({"timestep": 0}, "timestep is 0; expected a positive number"),
        ({"armature": -1e-3}, "armature is -0.001; expected a number from 0 up"),
        ({"damping": float("nan")}, "damping is nan; expected a number from 0 up"),
        ({"proposal_interval": 0}, "proposal_interval is 0; expected a whole number from 1 up"),
        (
            {"proposal_interval": 2, "anchored": True},
            "proposal_interval is 2; expected 1, as plans are anchored",
        ),
        ({"optimiser": MPPI}, "optimiser is <class .*MPPI'>; expected one such as MPPI"),
        ({"timestep": 0.004}, "must be an integer multiple"),
    ],
)
def test_a_setting_that_cannot_be_is_named(setting: dict[str, Any], message: str) -> None:
    env = suite.load("humanoid", "stand", {"random": 5})
    with pytest.raises(ValueError, match=message):
        Planner(env, settings=Settings(**setting))


def test_numpys_whole_numbers_are_whole_numbers() -> None:
    assert Settings(samples=np.int64(8), knots=np.int32(4)).samples == 8  # pyright: ignore[reportArgumentType] (as users write it)
