"""Tests of limberjack.suite._locomotion."""

import numpy as np
import pytest

from limberjack import suite
from limberjack.suite import _locomotion as locomotion


@pytest.mark.parametrize(
    ("cosine", "expected"), [(1.0, 1.0), (0.9, 1.0), (-1.0, 0.0), (-0.05, 0.5)]
)
def test_upright_falls_linearly_to_nothing_upside_down(cosine: float, expected: float) -> None:
    assert locomotion.upright(cosine, at_least=0.9) == pytest.approx(expected)
    of_rows = locomotion.upright(np.full(3, cosine), at_least=0.9)
    np.testing.assert_array_equal(of_rows, np.full(3, locomotion.upright(cosine, 0.9)))


@pytest.mark.parametrize(("speed", "expected"), [(12.0, 1.0), (10.0, 1.0), (5.0, 0.5), (-3.0, 0.0)])
def test_speed_is_rewarded_from_standstill(speed: float, expected: float) -> None:
    assert locomotion.speed(speed, at_least=10) == pytest.approx(expected)


def test_speed_may_have_a_margin_of_its_own() -> None:
    speeds = np.array([2.0, 1.0, 0.0, -1.0])
    values = locomotion.speed(speeds, 2, margin=1, value_at_margin=0.5)
    np.testing.assert_allclose(values, [1.0, 0.5, 0.0, 0.0])


def test_full_effort_loses_a_fifth() -> None:
    controls = np.array([[0.0, 0.0], [1.0, -1.0], [1.0, 0.0]])
    np.testing.assert_allclose(locomotion.low_effort(controls), [1.0, 0.8, 0.9])
    np.testing.assert_array_equal(
        locomotion.low_effort(controls), [locomotion.low_effort(row) for row in controls]
    )


@pytest.mark.parametrize(("domain", "task"), [("walker", "walk"), ("cheetah", "run")])
def test_forward_speed_is_a_number_or_one_per_row(domain: str, task: str) -> None:
    env = suite.load(domain, task)
    env.physics.data.qvel[:] = 0.0
    env.physics.named.data.qvel[["rootx", "rootz"]] = 3.0, -2.0
    env.physics.forward()
    speed = locomotion.forward_speed(env.physics)
    assert isinstance(speed, float)
    assert speed == pytest.approx(3.0)
    batch = suite.load_batch(domain, task, 4)
    assert np.shape(locomotion.forward_speed(batch.physics)) == (4,)
