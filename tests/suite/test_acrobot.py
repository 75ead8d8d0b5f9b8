"""Tests of limberjack.suite.acrobot."""

from typing import Any

import numpy as np
import pytest

from limberjack import suite
from limberjack.suite import acrobot

_TASKS = ["swingup", "swingup_sparse"]


def set_angles(physics: Any, shoulder: float, elbow: float) -> None:
    """Turns the joints; both at 0 is upright."""
    with physics.reset_context():
        physics.data.qpos[:] = shoulder, elbow


def test_orientations_are_the_sines_then_the_cosines_of_the_links_in_the_world() -> None:
    env = suite.load("acrobot", "swingup")
    set_angles(env.physics, 0.3, 0.4)
    links = np.array([0.3, 0.7])
    np.testing.assert_allclose(env.physics.horizontal(), np.sin(links))
    np.testing.assert_allclose(env.physics.vertical(), np.cos(links))
    orientations = env.task.get_observation(env.physics)["orientations"]
    np.testing.assert_allclose(orientations, [*np.sin(links), *np.cos(links)])


@pytest.mark.parametrize(
    ("shoulder", "elbow", "distance"),
    [(0, 0, 0), (np.pi, 0, 4), (0, np.pi, 2), (np.pi / 2, 0, np.sqrt(8)), (0.1, -0.2, 0.00999)],
)
def test_the_target_is_where_the_tip_of_the_upright_acrobot_is(
    shoulder: float, elbow: float, distance: float
) -> None:
    physics = suite.load("acrobot", "swingup").physics
    set_angles(physics, shoulder, elbow)
    assert physics.to_target() == pytest.approx(distance, abs=1e-5)


@pytest.mark.parametrize("task", _TASKS)
def test_a_tip_inside_the_target_is_fully_rewarded(task: str) -> None:
    env = suite.load("acrobot", task)
    for angle in (0.0, 0.09, -0.09):  # the distance is 4 sin(angle / 2): 18 cm
        set_angles(env.physics, angle, 0.0)
        assert env.task.get_reward(env.physics) == 1.0
        assert env.task.is_success(env.task.reward_terms(env.physics))


def test_outside_the_target_only_the_smooth_task_is_rewarded() -> None:
    smooth, sparse = (suite.load("acrobot", task) for task in _TASKS)
    distances, rewards = [], []
    for angle in (0.11, 2 * np.arcsin(1.2 / 4), 1.0, np.pi):
        for env in (smooth, sparse):
            set_angles(env.physics, angle, 0.0)
        assert type(sparse.task.get_reward(sparse.physics)) is float
        assert sparse.task.get_reward(sparse.physics) == 0.0
        distances.append(smooth.physics.to_target())
        rewards.append(smooth.task.get_reward(smooth.physics))
    assert distances[1] == pytest.approx(1.2)
    assert rewards[1] == pytest.approx(0.1)  # 1 m from the surface
    # A Gaussian of the distance from the surface.
    np.testing.assert_allclose(rewards, 0.1 ** ((np.array(distances) - 0.2) ** 2))


def test_without_damping_the_energy_is_conserved() -> None:
    env = suite.load("acrobot", "swingup", {"random": 0})
    env.reset()
    env.physics.model.dof_damping[:] = 0.0
    set_angles(env.physics, np.pi / 2, 1.0)
    before = env.physics.data.energy.sum()
    kinetic = []
    for _ in range(500):
        env.step([0.0])
        kinetic.append(env.physics.data.energy[1])
    # 2e-6 with the Runge-Kutta method; Euler's is off by 5e-2.
    assert env.physics.data.energy.sum() == pytest.approx(before, rel=1e-5)
    assert max(kinetic) > 10.0


def test_the_torque_acts_on_the_elbow_alone() -> None:
    env = suite.load("acrobot", "swingup", {"random": 0})
    env.reset()
    env.physics.set_control([1.0])
    env.physics.forward()
    np.testing.assert_array_equal(env.physics.data.qfrc_actuator, [0.0, 2.0])


@pytest.mark.parametrize("task", _TASKS)
def test_a_start_is_any_pair_of_angles_at_rest(task: str) -> None:
    env = suite.load("acrobot", task, {"random": 0})
    angles = []
    for _ in range(400):
        env.reset()
        assert not env.physics.velocity().any()
        angles.append(env.physics.position())
    for joint in np.transpose(angles):
        quarters, _ = np.histogram(joint, 4, range=(-np.pi, np.pi))
        assert quarters.sum() == 400
        assert quarters.min() > 60  # of 100 expected; four standard deviations are 35
    assert abs(np.corrcoef(np.transpose(angles))[0, 1]) < 0.2


def test_the_model_is_given_with_the_files_it_includes() -> None:
    physics = acrobot.Physics.from_xml_string(*acrobot.get_model_and_assets())
    assert physics.model.name == "acrobot"
    assert (physics.model.nq, physics.model.nv, physics.model.nu) == (2, 2, 1)
