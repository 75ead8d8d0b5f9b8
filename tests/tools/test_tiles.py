"""Tiles of a film: which control steps are played before each frame."""

import tiles

from limberjack import suite


def test_a_frame_shows_the_first_control_step_at_or_after_its_time() -> None:
    environment = suite.load("walker", "walk", {"random": 0})
    assert environment.control_timestep() == 0.025
    # Frames at 0, 0.08, 0.16, 0.24 and 0.32 s, so after 0, 4, 7, 10 and 13 steps.
    assert list(tiles._steps(environment, 5 / tiles.FRAME_RATE)) == [0, 4, 3, 3, 3]
