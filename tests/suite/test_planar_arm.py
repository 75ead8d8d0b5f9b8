"""The planar arm: measurements, random poses and the base class of its tasks."""

import collections
from typing import Any

import numpy as np
import pytest

from limberjack import suite
from limberjack.suite import _planar_arm, common
from limberjack.suite._planar_arm import ArmTask, is_close, model_without

_JOINTS = ["arm_root", "arm_shoulder", "arm_elbow", "arm_wrist", "finger", "thumb"]


@pytest.fixture
def physics() -> Any:
    """The arm after a random start."""
    env = suite.load("manipulator", "bring_peg", {"random": 4})
    env.reset()
    return env.physics


def test_a_body_is_left_out_with_all_that_it_contains() -> None:
    xml, assets = model_without("manipulator.xml", ["ball", "cup"])
    whole, _ = model_without("manipulator.xml", [])
    assert b'name="cup"' in whole
    assert b'name="cup"' not in xml
    assert b'name="peg"' in xml
    assert b'name="upper_arm"' in xml
    assert assets is common.ASSETS
    with pytest.raises(ValueError, match="no_such_body"):
        model_without("manipulator.xml", ["no_such_body"])


@pytest.mark.parametrize(
    ("distance", "expected"), [(0.0, 1.0), (0.01, 1.0), (0.03, 0.1), (0.02, 0.1**0.25)]
)
def test_close_is_1_within_a_centimetre_and_a_tenth_at_three(
    distance: float, expected: float
) -> None:
    assert is_close(distance) == pytest.approx(expected, abs=1e-12)
    np.testing.assert_allclose(is_close(np.array([distance, 9.0])), [expected, 0.0], atol=1e-12)


def test_joint_angles_are_seen_as_sine_then_cosine(physics: Any) -> None:
    seen = physics.bounded_joint_pos(["arm_root", "thumb"])
    angles = physics.named.data.qpos[["arm_root", "thumb"]]
    np.testing.assert_array_equal(seen, np.stack([np.sin(angles), np.cos(angles)], axis=-1))


def test_velocities_are_copies_for_one_name_and_for_several(physics: Any) -> None:
    physics.named.data.qvel["arm_root"] = 3.0
    one, several = physics.joint_vel("arm_root"), physics.joint_vel(["thumb", "arm_root"])
    physics.named.data.qvel["arm_root"] = 0.0
    assert one == 3.0
    assert several[1] == 3.0


def test_a_planar_pose_is_x_z_w_and_y_of_one_body_or_of_several(physics: Any) -> None:
    xpos, xquat = physics.named.data.xpos, physics.named.data.xquat
    for name in ("hand", "peg"):
        expected = [*xpos[name, ["x", "z"]], *xquat[name, ["qw", "qy"]]]
        np.testing.assert_array_equal(physics.body_2d_pose(name), expected)
        np.testing.assert_array_equal(physics.body_2d_pose(name, orientation=False), expected[:2])
    both = physics.body_2d_pose(("hand", "peg"))
    np.testing.assert_array_equal(both[1], physics.body_2d_pose("peg"))
    place = physics.body_2d_pose("peg", orientation=False)
    place[:] = 9
    assert 9 not in xpos["peg"]


def test_random_arms_are_within_the_limits_and_the_hand_is_symmetric(physics: Any) -> None:
    stream = np.random.RandomState(0)
    model, qpos = physics.named.model, physics.named.data.qpos
    seen = []
    for _ in range(200):
        physics.randomize_arm(stream)
        seen.append(qpos[_JOINTS].copy())
        assert qpos["finger"] == qpos["thumb"]
    poses = np.array(seen)
    for column, joint in enumerate(_JOINTS):
        low, high = (-np.pi, np.pi) if not model.jnt_limited[joint] else model.jnt_range[joint]
        values = poses[:, column]
        assert low <= values.min() < values.max() <= high
        # 200 uniform draws come within a twentieth of both ends, but once in 10,000 times.
        assert values.min() < low + (high - low) / 20
        assert values.max() > high - (high - low) / 20


class _Bare(ArmTask):
    """An arm with nothing to do."""

    def initialize_episode(self, physics: Any) -> None:
        physics.randomize_arm(self.random)


def test_without_full_observation_the_scene_is_not_asked_for(physics: Any) -> None:
    seen = _Bare(fully_observable=False, random=0).get_observation(physics)
    assert list(seen) == ["arm_pos", "arm_vel", "touch"]
    assert [value.shape for value in seen.values()] == [(8, 2), (8,), (5,)]
    with pytest.raises(NotImplementedError, match="_Bare does not define observe_scene"):
        _Bare(fully_observable=True, random=0).get_observation(physics)


def test_the_scene_comes_after_the_hand(physics: Any) -> None:
    class Scene(_Bare):
        def observe_scene(self, physics: Any) -> collections.OrderedDict:
            return collections.OrderedDict(something=np.zeros(1))

    seen = Scene(fully_observable=True, random=0).get_observation(physics)
    assert list(seen) == ["arm_pos", "arm_vel", "touch", "hand_pos", "something"]


def test_touch_is_0_without_force_and_grows_with_its_logarithm(physics: Any) -> None:
    sensors = physics.named.data.sensordata
    for name in ("palm_touch", "finger_touch", "thumb_touch", "fingertip_touch", "thumbtip_touch"):
        sensors[name] = 0.0
    sensors["thumb_touch"] = np.e - 1
    np.testing.assert_allclose(physics.touch(), [0, 0, 1, 0, 0], atol=1e-15)


def test_all_tasks_of_the_arm_have_its_times() -> None:
    assert (_planar_arm.TIME_LIMIT, _planar_arm.CONTROL_TIMESTEP) == (10, 0.01)
