"""Tests of limberjack.suite.manipulator, and of the arm that it shares with the stacker."""

import collections
from typing import Any

import numpy as np
import pytest

from limberjack import suite
from limberjack.suite import manipulator

_TASKS = ["bring_ball", "bring_peg", "insert_ball", "insert_peg"]
_ARM = ["arm_root", "arm_shoulder", "arm_elbow", "arm_wrist"]
_ARM += ["finger", "fingertip", "thumb", "thumbtip"]
_EPISODES = 700
_OFF_PLANE = 0.001  # metres; the target is drawn in front of the plane
every_task = pytest.mark.parametrize("task", _TASKS)


class Recorded(np.random.RandomState):
    """A stream that remembers what it chose last."""

    chosen: Any = None

    def choice(self, *args: Any, **kwargs: Any) -> Any:
        self.chosen = super().choice(*args, **kwargs)
        return self.chosen


def load(task: str, random: Any = 0) -> Any:
    return suite.load("manipulator", task, {"random": random})


@every_task
def test_the_kind_of_a_start_is_the_one_that_was_drawn(task: str) -> None:
    stream = Recorded(1)
    env = load(task, stream)
    for _ in range(150):
        env.reset()
        assert env.task.start(env.physics) == stream.chosen


@every_task
def test_starts_are_in_hand_and_in_target_about_once_in_ten(task: str) -> None:
    env = load(task)
    counts: collections.Counter = collections.Counter()
    for _ in range(_EPISODES):
        env.reset()
        counts[env.task.start(env.physics)] += 1
    # Within five standard deviations, and what collisions reject: the peg in the slot often.
    for kind, fewest in (("in_hand", 30), ("in_target", 15)):
        assert fewest < counts[kind] < 120, counts
    assert 520 < counts["uniform"] < 655, counts


@every_task
def test_the_initial_state_of_the_prop_matches_the_kind_of_start(task: str) -> None:
    env = load(task)
    prop = task.split("_")[1]
    for _ in range(100):
        env.reset()
        data, model = env.physics.named.data, env.physics.named.model
        kind = env.task.start(env.physics)
        place = data.qpos[[f"{prop}_x", f"{prop}_z"]]
        speed = data.qvel[[f"{prop}_x", f"{prop}_z", f"{prop}_y"]]
        assert not speed[1:].any()
        if kind == "in_hand":
            np.testing.assert_array_equal(place, data.site_xpos["grasp", ["x", "z"]])
            aligned = data.xmat[prop, "xx"] * data.site_xmat["grasp", "xx"]
            aligned += data.xmat[prop, "zx"] * data.site_xmat["grasp", "zx"]
            assert abs(aligned) == pytest.approx(1.0)
        elif kind == "in_target":
            np.testing.assert_array_equal(place, model.body_pos[f"target_{prop}", ["x", "z"]])
        else:
            assert -0.5 <= place[0] <= 0.5
            assert 0.0 <= place[1] <= 0.7
            assert -5 <= speed[0] <= 5
            assert speed[0] != 0


@every_task
def test_the_target_is_within_reach_and_in_the_receptacle(task: str) -> None:
    env = load(task)
    prop, insert = task.split("_")[1], task.startswith("insert")
    places = []
    for _ in range(40):
        env.reset()
        model = env.physics.named.model
        x, z = model.body_pos[f"target_{prop}", ["x", "z"]]
        assert -0.4 <= x <= 0.4
        assert 0.1 <= z <= 0.4
        places.append((x, z))
        w, y = model.body_quat[f"target_{prop}", ["qw", "qy"]]
        assert w**2 + y**2 == pytest.approx(1.0)
        tilt = 2 * np.arctan2(y, w)
        assert abs(tilt) <= (np.pi / 3 if insert else np.pi) + 1e-9
        if insert:
            receptacle = {"ball": "cup", "peg": "slot"}[prop]
            np.testing.assert_array_equal(model.body_pos[receptacle, ["x", "z"]], [x, z])
            np.testing.assert_array_equal(model.body_quat[receptacle, ["qw", "qy"]], [w, y])
    assert len(set(places)) == len(places)


@every_task
def test_the_hand_is_symmetric_at_the_start(task: str) -> None:
    env = load(task)
    for _ in range(10):
        env.reset()
        qpos = env.physics.named.data.qpos
        assert qpos["finger"] == qpos["thumb"]


@pytest.mark.parametrize(("use_peg", "insert"), [(0, 0), (0, 1), (1, 0), (1, 1)])
def test_a_model_has_the_bodies_of_its_task_only(use_peg: bool, insert: bool) -> None:
    xml, assets = manipulator.make_model(use_peg, insert)
    physics = manipulator.Physics.from_xml_string(xml, assets)
    names = set(physics.named.data.xpos.axes.row.names)
    used = {"peg", "target_peg"} if use_peg else {"ball", "target_ball"}
    used |= ({"slot"} if use_peg else {"cup"}) if insert else set()
    props = {"ball", "target_ball", "cup", "peg", "target_peg", "slot"}
    assert names & props == used
    assert {"hand", "thumb", "fingertip"} <= names


def test_the_arm_is_measured_by_sines_and_cosines() -> None:
    env = load("bring_ball")
    env.reset()
    physics = env.physics
    pairs = physics.bounded_joint_pos(_ARM)
    angles = physics.named.data.qpos[_ARM]
    np.testing.assert_array_equal(pairs[:, 0], np.sin(angles))
    np.testing.assert_array_equal(pairs[:, 1], np.cos(angles))
    physics.data.qvel[:] = np.arange(physics.model.nv)
    np.testing.assert_array_equal(physics.joint_vel(_ARM), physics.named.data.qvel[_ARM])
    np.testing.assert_array_equal(physics.joint_vel(_ARM[::-1]), physics.joint_vel(_ARM)[::-1])


def test_planar_poses_are_x_z_and_the_quaternions_w_and_y() -> None:
    env = load("bring_peg")
    env.reset()
    physics, data = env.physics, env.physics.named.data
    pose = physics.body_2d_pose("hand")
    expected = [*data.xpos["hand", ["x", "z"]], *data.xquat["hand", ["qw", "qy"]]]
    np.testing.assert_array_equal(pose, expected)
    np.testing.assert_array_equal(physics.body_2d_pose("hand", orientation=False), expected[:2])
    for names in (["hand", "peg"], ("hand", "peg"), np.array(["hand", "peg"])):
        poses = physics.body_2d_pose(names)
        np.testing.assert_array_equal(poses, [pose, physics.body_2d_pose("peg")])


def test_touch_is_the_logarithm_of_one_plus_the_force() -> None:
    env = load("bring_ball")
    env.reset()
    names = [f"{part}_touch" for part in ("palm", "finger", "thumb", "fingertip", "thumbtip")]
    forces = [0.0, 0.5, 1.0, 20.0, 300.0]
    for name, force in zip(names, forces, strict=True):
        env.physics.named.data.sensordata[name] = force
    np.testing.assert_array_equal(env.physics.touch(), np.log1p(forces))


def test_distances_between_sites() -> None:
    env = load("bring_ball")
    env.reset()
    sites = env.physics.named.data.site_xpos
    expected = np.linalg.norm(sites["ball"] - sites["target_ball"])
    assert env.physics.site_distance("ball", "target_ball") == expected
    assert env.physics.site_distance("target_ball", "ball") == expected
    assert env.physics.site_distance("ball", "ball") == 0.0


@every_task
def test_the_reward_is_1_at_the_target_and_falls_with_the_distance(task: str) -> None:
    env = load(task)
    prop = task.split("_")[1]
    env.reset()
    physics, model = env.physics, env.physics.named.model
    qpos, target = physics.named.data.qpos, f"target_{prop}"
    w, y = model.body_quat[target, ["qw", "qy"]]
    for distance in (0.0, 0.009, 0.02, 0.03, 0.05, 0.2):
        qpos[[f"{prop}_x", f"{prop}_z"]] = model.body_pos[target, ["x", "z"]] + [distance, 0.0]
        qpos[f"{prop}_y"] = 2 * np.arctan2(y, w)
        physics.forward()
        apart = np.hypot(distance, _OFF_PLANE)
        expected = 1.0 if apart <= 0.01 else 0.1 ** (((apart - 0.01) / 0.02) ** 2)
        assert env.task.get_reward(physics) == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("task", ["bring_peg", "insert_peg"])
def test_grasping_the_peg_far_away_earns_at_most_a_third(task: str) -> None:
    env = load(task)
    rewards = []
    for _ in range(300):
        env.reset()
        if env.task.start(env.physics) == "in_hand":
            terms = env.task.reward_terms(env.physics)
            assert terms["grasping"] > 0.4
            expected = max(terms["bringing"], terms["grasping"] / 3)
            assert env.task.get_reward(env.physics) == expected
            rewards.append(expected)
    assert rewards
    assert min(rewards) <= 1 / 3
