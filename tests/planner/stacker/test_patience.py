"""Behaviour of the arm when there is no progress."""

import numpy as np

from limberjack import suite
from limberjack.planner.arm.kinematics import GRASP, hand_places
from limberjack.planner.stacker.patience import Patience, refuge, shelter


def _waits(patience: Patience, lacks: list[float], stage: str = "fetch") -> list[bool]:
    return [patience.is_out(stage, lack) for lack in lacks]


def test_patience_ends_when_nothing_has_become_better_and_begins_anew() -> None:
    patience = Patience(plannings=3, part=0.9)
    assert _waits(patience, [1.0, 1.0, 0.95, 0.92]) == [False, False, False, True]
    assert _waits(patience, [0.92] * 4) == [False, False, False, True]


def test_patience_lasts_while_there_is_progress_or_another_stage() -> None:
    patience = Patience(plannings=2, part=0.9)
    assert not any(_waits(patience, [0.8**n for n in range(9)]))
    for stage in ("carry", "fetch", "carry"):
        assert _waits(patience, [1.0, 1.0], stage) == [False, False]


def test_a_refuge_is_the_same_at_the_same_try_with_the_hand_above_the_ground() -> None:
    env = suite.load("stacker", "stack_2", {"random": 1})
    env.reset()
    data = env.physics.named.data
    place = np.array([-0.3, 0.0, 0.022])
    first, again, other = (refuge(data, place, tries) for tries in (0, 0, 1))
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)
    for joints in (first, other):
        hand = hand_places(joints, GRASP)
        # Solved in closed form, whose sines and cosines round.
        np.testing.assert_allclose(hand, [-0.25, 0.25], rtol=0, atol=1e-12)


def test_the_shelter_is_beside_where_boxes_fall() -> None:
    env = suite.load("stacker", "stack_2", {"random": 1})
    env.reset()
    joints = shelter(env.physics.named.data)
    assert joints.shape == (4,)
    for reach in (-0.12, 0.0, GRASP):  # elbow, wrist and hand
        link = joints if reach >= 0 else np.append(joints[:3], 0.0)
        assert hand_places(link, reach)[0] < 0.08
