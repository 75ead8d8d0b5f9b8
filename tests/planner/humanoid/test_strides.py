"""Strides and postures that are proposed."""

import numpy as np

from limberjack.planner import Settings
from limberjack.planner.humanoid.strides import postures, strides

_NAMES = [
    "abdomen_y",
    *(f"{s}_{j}" for s in ("left", "right") for j in ("hip_y", "knee", "ankle_y")),
]


def test_strides_swing_both_legs_in_turn_and_keep_the_trunk_straight() -> None:
    settings = Settings(horizon=0.6, knots=13)
    plans = strides(_NAMES, settings, np.random.default_rng(0))
    assert plans.shape == (24, 13, len(_NAMES))
    assert not plans[..., 0].any()
    left, right = plans[..., 1], plans[..., 4]
    assert np.mean([np.corrcoef(a, b)[0, 1] for a, b in zip(left, right, strict=True)]) < -0.5
    assert (plans[..., [2, 5]] < 0).all()  # knees bend backwards only


def test_postures_are_held_and_the_same_for_both_sides_or_random() -> None:
    plans = postures(_NAMES, 4, np.random.default_rng(0))
    np.testing.assert_array_equal(plans, np.repeat(plans[:, :1], 4, axis=1))
    np.testing.assert_array_equal(plans[:6, :, 1:4], plans[:6, :, 4:7])
    assert (plans[6:, 0, 1] != plans[6:, 0, 4]).all()
