"""The collision model, beside MuJoCo's own contacts."""

from typing import Any

import numpy as np

from limberjack import suite
from limberjack.planner.arm.collision import (
    NOTHING,
    clearance,
    hand_gap,
    hand_height,
    is_clear,
)
from limberjack.planner.arm.hand import ARM, finger_angle
from limberjack.planner.arm.kinematics import hand_places
from limberjack.planner.manipulator.receptacles import Receptacle

_PARTS = ["upper_arm", "middle_arm", "lower_arm", "hand", "palm1", "palm2"]
_FINGERS = [f"{side}{n}" for side in ("thumb", "finger", "thumbtip", "fingertip") for n in (1, 2)]
_AROUND = ["floor", "wall1", "wall2", "slot_0", "slot_1", "slot_2"]
_TOLERANCE = 0.006  # metres; fingers are modelled as straight, and the slot's corners as round


# Any: the physics of the manipulator, with names of its own.
def _deepest(physics: Any, poses: np.ndarray) -> np.ndarray:
    """The depth of the arm's deepest contact with ground or slot in each pose, metres."""
    model, data = physics.model, physics.data
    arm = {model.name2id(name, "geom") for name in [*_PARTS, *_FINGERS]}
    around = {model.name2id(name, "geom") for name in _AROUND}
    found = np.zeros(len(poses))
    for number, pose in enumerate(poses):
        with physics.reset_context():
            physics.named.data.qpos[ARM] = pose
            physics.named.data.qpos[["thumb", "finger"]] = finger_angle(0.034)
        for contact in data.contact:
            one, other = contact.geom
            if (one in arm and other in around) or (other in arm and one in around):
                found[number] = max(found[number], -contact.dist)
    return found


def test_poses_that_are_clear_have_no_contact_and_others_have() -> None:
    env = suite.load("manipulator", "insert_peg", {"random": 3})
    env.reset()
    physics = env.physics
    random = np.random.default_rng(0)
    poses = random.uniform([-np.pi, -2.7, -2.7, -2.4], [np.pi, 2.7, 2.7, 2.4], (600, 4))
    position = physics.model.body_pos.copy()
    depth = _deepest(physics, poses)
    np.testing.assert_array_equal(physics.model.body_pos, position)
    walls = Receptacle.for_object("peg").walls(physics)
    gap = clearance(poses, 0.098, walls)[:, [0, 2, 3]].min(axis=-1)
    assert (depth > 0).sum() > 50
    assert (gap > 0).sum() > 100
    assert depth[gap > _TOLERANCE].max() == 0.0
    assert gap[depth > _TOLERANCE].max() < 0.0


def test_points_and_capsules_agree_on_floor_and_walls() -> None:
    random = np.random.default_rng(1)
    poses = random.uniform([-np.pi, -2.7, -2.7, -2.3], [np.pi, 2.7, 2.7, 2.3], (3000, 4))
    gaps = clearance(poses, 0.098, NOTHING)
    clear = is_clear(poses, 0.098)
    assert 100 < clear.sum() < 2900
    assert gaps[clear][:, 2].min() > -0.006


def test_the_hands_height_and_its_gap_from_a_line_are_those_of_its_lowest_part() -> None:
    down = np.array([-0.8, -0.8, -0.8, 2.4 - np.pi])  # the hand points down
    heights = []
    for aside in (-0.013, 0.013):
        x, z = hand_places(down, 0.098, aside)
        heights += [z, (z + 0.4 - abs(x)) / np.sqrt(2)]  # from the floor and from a wall
    # Sums of sines and cosines round.
    np.testing.assert_allclose(hand_height(down), min(heights), atol=1e-9)
    beside = hand_places(down, 0.098)
    line = np.array([beside - [0.0, 0.05], beside - [0.0, 0.04]])
    np.testing.assert_allclose(hand_gap(down, line), np.hypot(0.013, 0.04), atol=1e-9)
