"""Insertion of a peg that is hard to reach because of the slot or the arm."""

import numpy as np

from limberjack.planner.arm.collision import clearance
from limberjack.planner.arm.hand import ARM, PLANE, TIP_ASIDE, TIP_REACH
from limberjack.planner.arm.kinematics import hand_places
from limberjack.planner.arm.proposals import plans_of
from limberjack.planner.arm.roadmap import find_path
from limberjack.planner.manipulator.insert_peg import pushing_in
from limberjack.planner.manipulator.props import HAND
from limberjack.planner.manipulator.receptacles import Receptacle

from .scenes import scene

# The peg leans on the slot, so that neither its middle nor its handle can be reached from outside.
_LEANING = 1047, [2.51, -1.14, 1.62, -0.73], [-0.271, 0.111, 0.331]  # on the slot, handle up
_UNDER = 1070, [2.76, -1.48, 0.56, 1.95], [0.047, 0.032, 4.95]  # the slot, which the arm is behind
_ON_ARM = 1056, [2.72, -1.57, 0.34, 2.17], [-0.177, 0.336, -0.90]


def test_an_arm_that_rakes_is_led_there_even_straight() -> None:
    cost, physics = scene("insert_peg", *_LEANING)
    for _ in range(6):
        cost.update(physics)
    goal, spot = cost._fetch.rake.goal, cost._fetch.rake.spot
    assert goal is not None
    end = cost._fetch.path.next_points(1)[-1]
    tips = [hand_places(end, TIP_REACH, aside) for aside in (TIP_ASIDE, -TIP_ASIDE)]
    start = spot._start(physics.named.data, goal)[PLANE]
    assert min(np.hypot(*(tip - start)) for tip in tips) < 0.07


def test_a_path_through_the_slot_is_not_taken() -> None:
    cost, physics = scene("insert_peg", *_UNDER)
    for _ in range(3):
        cost.update(physics)
    assert cost._fetch.is_blocked
    poses = np.array(cost._fetch.path.next_points(1))
    assert (clearance(poses, HAND, cost._fetch.approach.walls)[:, 0] > -0.005).all()


def test_the_arm_stretches_under_a_peg_that_lies_on_it() -> None:
    cost, physics = scene("insert_peg", *_ON_ARM)
    for _ in range(40):
        cost.update(physics)
    end = cost._fetch.path.next_points(1)[-1]
    assert np.abs(end[1:]).max() < 0.6 < np.abs(physics.named.data.qpos[ARM][1:]).max()


def test_an_arm_in_a_corner_finds_a_path_out_of_it() -> None:
    _, physics = scene("insert_peg", 1051, [-2.71, -1.5, -0.02, 0.38], [-0.406, 0.032, -1.33])
    walls = Receptacle.for_object("peg").walls(physics)
    goal = np.array([[1.93, 0.69, -0.43, 1.02]])  # on the other side of the slot
    assert find_path(physics.named.data.qpos[ARM], goal, HAND, walls, close=True) is not None


def test_a_peg_that_is_all_the_way_in_is_pushed_no_further() -> None:
    cost, physics = scene("insert_peg", *_LEANING)
    data, slot = physics.named.data, cost._receptacle
    axis, across = slot.axes(data)
    up, beside = slot.offset(data, slot.sites[0])
    # 2 mm deeper than it need be.
    data.qpos[cost.task.object_joints[:2]] -= (up + 0.002) * axis + beside * across
    physics.forward()
    now = data.qpos[ARM]
    proposals = pushing_in(slot, data, np.random.default_rng(0), 5)
    assert len(proposals) > 0
    for path in plans_of(now, proposals, 5):
        np.testing.assert_array_equal(path[:, :4], np.repeat(now[None], 5, axis=0))
