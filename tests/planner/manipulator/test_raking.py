"""Raking of a ball or a peg into reach."""

import numpy as np

from limberjack.planner.arm.hand import PLANE, TIP_ASIDE, TIP_REACH, TIPS
from limberjack.planner.arm.kinematics import hand_places
from limberjack.planner.manipulator.props import Ball
from limberjack.planner.manipulator.raking import Rake, Spot, next_spot
from limberjack.planner.manipulator.receptacles import Receptacle

from .scenes import scene

_LEANING = 1047, [2.51, -1.14, 1.62, -0.73], [-0.271, 0.111, 0.331]  # on the slot, handle up
_IN_A_CORNER = 1208, [0.0, 0.0, 0.0, 0.0], [-0.46, 0.1, -0.6]  # on the wall, handle up
_AGAINST_A_WALL = [0.0, 0.0, 0.0, 0.0], [-0.5, 0.15, 0.8]


def test_raking_begins_and_ends_when_the_reach_is_certain() -> None:
    _, physics = scene("bring_ball", 1000, [0.0, 0.7, 0.7, 0.7], [0.55, 0.2, 0.0])
    rake, data = Rake(Ball(["ball_x", "ball_z", "ball_y"])), physics.named.data
    for is_within in (False, False, True, False, False):
        assert not rake.judge(data, is_within)
        assert rake.goal is None
    rake.judge(data, False)
    assert rake.goal == 0.0
    assert rake.at() == Spot("ball", "there")
    rake.judge(data, False)
    assert [rake.judge(data, True) for _ in range(4)] == [False, False, True, False]
    assert rake.goal is None


def test_a_peg_that_does_not_move_is_raked_from_elsewhere_without_a_pause() -> None:
    cost, physics = scene("bring_peg", 1000, *_AGAINST_A_WALL)
    spots = []
    for _ in range(150):
        cost.update(physics)
        spots.append(cost._fetch.rake.spot)
        assert not cost._fetch._withdraws
    assert len(set(spots)) > 2
    assert cost._fetch.rake.goal is not None


def test_a_peg_that_leans_on_the_slot_is_raked_by_an_end_that_a_fingertip_reaches() -> None:
    cost, physics = scene("insert_peg", *_LEANING)
    spots = []
    for _ in range(200):  # the arm stands still, on a path: each planning counts a tenth
        cost.update(physics)
        spots.append(cost._fetch.rake.spot)
    chosen = list(dict.fromkeys(spot for spot in spots if spot is not None))
    # It leans with the handle up, and so may fall; of the others a fingertip reaches the tip first.
    assert chosen == [Spot("peg_grasp", "there"), Spot("peg_tip", "there")]
    assert not cost._fetch._withdraws


def test_a_fingertip_that_comes_nearer_makes_headway() -> None:
    cost, physics = scene("insert_peg", *_LEANING)
    data, rake = physics.named.data, Rake(cost._fetch.prop)
    walls = Receptacle.for_object("peg").walls(physics)
    situation = {"walls": walls, "is_led": False, "moves": False}
    rake.goal = -0.12
    rake.choose_spot(data, **situation)
    first = rake.spot
    assert first is not None
    up = np.array([0.0, 0.0, 1.0])
    for step in range(60):  # 3 cm every four plannings
        data.geom_xpos[TIPS] = first._start(data, -0.12) + (1.0 - 0.009 * step) * up
        rake.choose_spot(data, **situation)
        assert rake.spot == first
    for _ in range(20):
        rake.choose_spot(data, **situation)
    assert rake.spot != first


def test_a_peg_is_raked_after_failed_searches_for_a_path_but_not_while_it_falls() -> None:
    cost, physics = scene("insert_peg", *_LEANING)
    data, fetch = physics.named.data, cost._fetch
    rake = fetch.rake
    fetch._choose_spot(data)
    assert rake.goal is None
    rake.misses = 2
    fetch._choose_spot(data)
    assert rake.goal is not None
    while not fetch._carriage.is_stuck:
        fetch._carriage.watch()
    fetch._choose_spot(data)
    assert rake.goal is rake.spot is None
    assert rake.misses == 0


def test_no_peg_is_pushed_up_a_wall() -> None:
    _, physics = scene("insert_peg", *_IN_A_CORNER)
    data, walls = physics.named.data, Receptacle.for_object("peg").walls(physics)
    spot = next_spot(data, None, 0.12, walls)
    assert spot == Spot("peg_grasp", "there")
    for _ in range(8):
        spot = next_spot(data, spot, 0.12, walls)
        assert spot.kind != "away"


def test_a_spot_is_chosen_where_a_fingertip_gets() -> None:
    _, physics = scene("insert_peg", *_LEANING)
    data, walls = physics.named.data, Receptacle.for_object("peg").walls(physics)
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
