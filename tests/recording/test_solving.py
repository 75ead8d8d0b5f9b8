"""Recordings of episodes that the planner plays, from Python."""

import concurrent.futures

import numpy as np

from limberjack import suite
from limberjack.recording.episodes import replay
from limberjack.recording.solving import solve

_TASK = ("manipulator", "bring_ball")


def test_recordings_are_the_same_with_an_executor_and_replay() -> None:
    alone = dict(solve(*_TASK, [3], time_limit=0.05))
    with concurrent.futures.ThreadPoolExecutor(2) as executor:
        several = dict(solve(*_TASK, [3, 4], time_limit=0.05, executor=executor))
    assert set(several) == {3, 4}
    np.testing.assert_array_equal(several[3].actions, alone[3].actions)
    np.testing.assert_array_equal(several[3].states, alone[3].states)
    assert several[3].about == alone[3].about
    assert several[4].about["seed"] == 4
    for recording in several.values():
        assert replay(recording, suite.load(*_TASK, {"time_limit": 0.05})) is None
