"""Spots at which a peg is raked."""

import numpy as np

from limberjack.planner.arm.hand import PLANE, TIP_ASIDE, TIP_REACH, TIPS
from limberjack.planner.arm.kinematics import hand_places
from limberjack.planner.manipulator.receptacles import Receptacle
from limberjack.planner.manipulator.spots import Spot, next_spot

from .scenes import scene

_LEANING = 1047, [2.51, -1.14, 1.62, -0.73], [-0.271, 0.111, 0.331]  # on the slot, handle up
_IN_A_CORNER = 1208, [0.0, 0.0, 0.0, 0.0], [-0.46, 0.1, -0.6]  # on the wall, handle up
_SLOT = Receptacle.for_object("peg")


def test_no_peg_is_pushed_up_a_wall() -> None:
    _, physics = scene("insert_peg", *_IN_A_CORNER)
    data, walls = physics.named.data, _SLOT.walls(physics)
    spot = next_spot(data, None, 0.12, walls)
    assert spot == Spot("peg_grasp", "there")
    for _ in range(8):
        spot = next_spot(data, spot, 0.12, walls)
        assert spot.kind != "away"


def test_a_spot_is_chosen_where_a_fingertip_gets() -> None:
    _, physics = scene("insert_peg", *_LEANING)
    data, walls = physics.named.data, _SLOT.walls(physics)
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


def test_raking_costs_least_with_a_fingertip_behind_the_object_and_the_object_at_the_goal() -> None:
    _, physics = scene("bring_ball", 1000, [0.0, 0.7, 0.7, 0.7], [0.55, 0.2, 0.0])
    data, spot = physics.named.data, Spot("ball", "there")
    place = data.site_xpos["ball"].copy()
    data.geom_xpos[TIPS] = place + np.array([0.03, 0.0, 0.02])  # further out than the ball
    assert spot.missing(data, 0.0) == 0.0
    assert spot.cost(data, 0.0) == 10.0 * abs(place[0])
    data.geom_xpos[TIPS] = place - np.array([0.03, 0.0, -0.02])
    assert spot.cost(data, 0.0) > 10.0 * abs(place[0])


def test_a_fingertip_goes_behind_the_object_and_then_turns_inwards() -> None:
    _, physics = scene("bring_ball", 1000, [0.0, 0.7, 0.7, 0.7], [0.3, 0.022, 0.0])
    data, spot = physics.named.data, Spot("ball", "there")
    pairs = spot.proposals(np.random.default_rng(0), data, 0.0)
    assert pairs
    for proposal in pairs[1::2]:
        behind, pulled = proposal.waypoints
        tip = hand_places(behind, TIP_REACH, TIP_ASIDE)
        # Inverse kinematics and back, by sines and cosines: they round.
        np.testing.assert_allclose(tip, data.site_xpos["ball"][PLANE] + [0.03, 0.02], atol=1e-9)
        assert hand_places(pulled, TIP_REACH, TIP_ASIDE)[0] < tip[0]
