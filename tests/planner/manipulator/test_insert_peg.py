"""The cost of inserting a peg that is hard to reach because of the slot or the arm."""

import numpy as np

from limberjack.planner.arm.collision import clearance
from limberjack.planner.arm.hand import ARM, PLANE, TIP_ASIDE, TIP_REACH, TIPS
from limberjack.planner.arm.kinematics import GRASP, hand_places
from limberjack.planner.arm.proposals import plans_of
from limberjack.planner.arm.roadmap import find_path
from limberjack.planner.manipulator.pushes import pushes
from limberjack.planner.manipulator.receptacles import Receptacle
from limberjack.planner.manipulator.spots import Spot, Spots, next_spot

from .peg_scenes import peg_scene

# The peg leans on the slot, so that neither its middle nor its handle can be got at from outside.
_LEANING = 1047, [2.51, -1.14, 1.62, -0.73], [-0.271, 0.111, 0.331]
_IN_A_CORNER = 1208, [0.0, 0.0, 0.0, 0.0], [-0.46, 0.1, -0.6]  # on the wall, handle up
_UNDER = 1070, [2.76, -1.48, 0.56, 1.95], [0.047, 0.032, 4.95]  # the slot, which the arm is behind
_ON_ARM = 1056, [2.72, -1.57, 0.34, 2.17], [-0.177, 0.336, -0.90]


def test_a_peg_that_does_not_move_is_raked_from_elsewhere() -> None:
    cost, physics = peg_scene("insert_peg", *_LEANING)
    spots = []
    for _ in range(200):  # the arm stands still, on a path: each look counts a tenth
        cost.update(physics)
        spots.append(cost._spots.now)
    chosen = list(dict.fromkeys(spot for spot in spots if spot is not None))
    # It leans with the handle up, and so may fall; of the others a fingertip gets to the tip first.
    assert chosen == [Spot("peg_grasp", "there"), Spot("peg_tip", "there")]
    assert not cost._withdraws


def test_an_arm_that_rakes_is_led_there_even_straight() -> None:
    cost, physics = peg_scene("insert_peg", *_LEANING)
    for _ in range(6):
        cost.update(physics)
    assert cost._rake_to is not None
    spot, goal = cost._spots.now, cost._rake_to
    end = cost._path.next_points(1)[-1]
    tips = [hand_places(end, TIP_REACH, aside) for aside in (TIP_ASIDE, -TIP_ASIDE)]
    start = spot._start(physics.named.data, goal)[PLANE]
    assert min(np.hypot(*(tip - start)) for tip in tips) < 0.07


def test_a_fingertip_that_comes_nearer_is_not_in_vain() -> None:
    _, physics = peg_scene("insert_peg", *_LEANING)
    data, spots = physics.named.data, Spots()
    walls = Receptacle.for_object("peg").walls(physics)
    first = spots.choose(data, -0.12, walls, False, False)
    assert first is not None
    up = np.array([0.0, 0.0, 1.0])
    for step in range(60):  # 3 cm each four looks
        data.geom_xpos[TIPS] = first._start(data, -0.12) + (1.0 - 0.009 * step) * up
        assert spots.choose(data, -0.12, walls, False, False) == first
    later = [spots.choose(data, -0.12, walls, False, False) for _ in range(20)]
    assert later[-1] != first


def test_no_peg_is_pushed_up_a_wall() -> None:
    cost, physics = peg_scene("insert_peg", *_IN_A_CORNER)
    data, walls = physics.named.data, cost._receptacle.walls(physics)
    spot = next_spot(data, None, 0.12, walls)
    assert spot == Spot("peg_grasp", "there")
    for _ in range(8):
        spot = next_spot(data, spot, 0.12, walls)
        assert spot.kind != "away"


def test_a_spot_is_chosen_where_a_fingertip_gets() -> None:
    cost, physics = peg_scene("insert_peg", *_LEANING)
    data, walls = physics.named.data, cost._receptacle.walls(physics)
    spot = next_spot(data, None, -0.12, walls)
    for _ in range(8):
        spot = next_spot(data, spot, -0.12, walls)
        goal = spot.goal(data, -0.12)
        poses = spot.poses(data, goal, walls)
        assert len(poses)
        place = data.site_xpos[spot.site][PLANE]
        tips = [hand_places(poses, TIP_REACH, aside) for aside in (TIP_ASIDE, -TIP_ASIDE)]
        near = np.min([np.hypot(*(tip - place).T) for tip in tips], axis=0)
        assert (near < 0.04).all()
        if spot.kind == "away":
            assert (goal - place[0]) * (-0.12 - place[0]) < 0


def test_a_way_through_the_slot_is_not_taken() -> None:
    cost, physics = peg_scene("insert_peg", *_UNDER)
    for _ in range(3):
        cost.update(physics)
    assert cost._is_blocked
    poses = np.array(cost._path.next_points(1))
    assert (clearance(poses, GRASP + 0.02, cost._walls)[:, 0] > -0.005).all()


def test_the_arm_stretches_under_a_peg_that_lies_on_it() -> None:
    cost, physics = peg_scene("insert_peg", *_ON_ARM)
    for _ in range(40):
        cost.update(physics)
    end = cost._path.next_points(1)[-1]
    assert np.abs(end[1:]).max() < 0.6 < np.abs(physics.named.data.qpos[ARM][1:]).max()


def test_an_arm_in_a_corner_finds_a_way_out_of_it() -> None:
    _, physics = peg_scene("insert_peg", 1051, [-2.71, -1.5, -0.02, 0.38], [-0.406, 0.032, -1.33])
    walls = Receptacle.for_object("peg").walls(physics)
    goal = np.array([[1.93, 0.69, -0.43, 1.02]])  # on the other side of the slot
    assert (
        find_path(physics.named.data.qpos[ARM], goal, GRASP + 0.02, walls, close=True) is not None
    )


def test_a_peg_that_is_all_the_way_in_is_pushed_no_further() -> None:
    cost, physics = peg_scene("insert_peg", *_LEANING)
    data, slot = physics.named.data, cost._receptacle
    axis, across = slot.axes(data)
    up, beside = slot.offset(data, slot.sites[0])
    # 2 mm deeper than it need be.
    data.qpos[cost.task.object_joints[:2]] -= (up + 0.002) * axis + beside * across
    physics.forward()
    now = data.qpos[ARM]
    proposals = pushes(np.random.default_rng(0), data, slot, now, 5, 0.3)
    assert len(proposals) > 0
    for path in plans_of(now, proposals, 5):
        np.testing.assert_array_equal(path[:, :4], np.repeat(now[None], 5, axis=0))
