"""Postures, strides, and repetition of a humanoid's gait."""

from typing import Any

import numpy as np

from limberjack import suite
from limberjack.planner import Settings, cost_for
from limberjack.planner.humanoid.gait import Gait, postures, strides
from limberjack.planner.humanoid.locomotion import actuators

_NAMES = [
    "abdomen_y",
    *(f"{s}_{j}" for s in ("left", "right") for j in ("hip_y", "knee", "ankle_y")),
]


def _humanoid() -> tuple[Any, Any]:
    """A running task and its physics, upright and at rest."""
    env = suite.load("humanoid", "run", task_kwargs={"random": 7})
    env.reset()
    physics = env.physics
    with physics.reset_context():
        physics.data.qpos[:] = physics.model.qpos0
    return env.task, physics


def test_a_mirrored_posture_has_its_limbs_on_the_other_side() -> None:
    _, physics = _humanoid()
    names = actuators(physics)
    posture = np.random.default_rng(0).uniform(-0.3, 0.3, len(names))
    limbs = []
    for targets in (posture, Gait(names).mirrored(posture)):
        with physics.reset_context():
            for name, angle in zip(names, targets, strict=True):
                physics.named.data.qpos[name] = angle
        limbs.append(physics.extremities().reshape(2, 2, 3))  # sides, hand and foot
    # The model's two sides differ by rounding only.
    np.testing.assert_allclose(limbs[1][::-1] * [1.0, -1.0, 1.0], limbs[0], atol=1e-9)


def test_a_steady_gait_goes_on() -> None:
    names = ["left_knee", "right_knee", "abdomen_x"]
    gait = Gait(names)

    def at(time: np.ndarray) -> np.ndarray:
        phase = np.pi * time / 10
        return np.stack([np.sin(phase), -np.sin(phase), 0.3 * np.cos(phase)], axis=-1)

    for time in range(35):
        gait.add(at(np.array(time)))
    assert gait.is_known
    # Sines of multiples of pi, and their sums, round.
    np.testing.assert_allclose(gait.middle(10), 0.0, atol=1e-12)
    times = np.array([-2.0, -1.0, 0.0, 4.0, 9.0, 14.0])
    np.testing.assert_allclose(gait.repeated(times, 10), at(35 + times), atol=1e-12)
    # Between control steps it is a line.
    np.testing.assert_allclose(gait.repeated(times + 0.5, 10), at(35.5 + times), atol=0.02)


def test_a_runner_goes_on_with_the_other_side() -> None:
    task, physics = _humanoid()
    cost = cost_for(task)
    plan = np.tile(np.random.default_rng(0).uniform(-0.3, 0.3, physics.model.nu), (7, 1))
    np.testing.assert_array_equal(cost.continued(plan), plan[-1])  # not going yet
    cost.update(physics)
    other = cost.continued(plan)
    assert (other != plan[-1]).sum() == len(other) - 1  # the abdomen bends forward as before
    np.testing.assert_array_equal(cost.continued(np.tile(other, (7, 1))), plan[-1])


def test_a_runner_proposes_what_it_did() -> None:
    task, physics = _humanoid()
    cost = cost_for(task)
    cost.update(physics)
    targets = np.arange(physics.model.nu) / 100
    for _ in range(40):
        cost.followed(Gait(actuators(physics)).mirrored(targets) + targets)
    found = cost.proposals(physics, np.random.default_rng(0))
    assert found is not None
    assert found.shape[1:] == (cost.settings.knots, physics.model.nu)
    # A mean of two values weighted by parts of 1 rounds, and so does a distance from the middle.
    np.testing.assert_allclose(found, np.broadcast_to(found[0, 0], found.shape), atol=1e-12)


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
