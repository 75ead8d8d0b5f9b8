"""Pictures of solved tasks: how they are made, and those that are committed."""

from pathlib import Path

import domain_pages
import numpy as np
import pytest
import solved_pictures

from limberjack import suite
from tests.tools.sizes import size_of


def test_an_episode_is_played_until_the_task_is_solved(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(solved_pictures, "_LAST", 2)
    actions, reward = solved_pictures.play("cartpole", "balance", 0, steps=9)
    assert actions.shape == (2, 1)
    assert 0.9 < reward <= 1.0
    monkeypatch.setattr(solved_pictures, "_SOLVED", 1.1)
    assert len(solved_pictures.play("cartpole", "balance", 0, steps=3)[0]) == 3


@pytest.mark.usefixtures("pictures")
def test_pictures_show_the_episode_from_its_start_to_its_end() -> None:
    actions = np.ones((9, 1))
    picture, seconds = solved_pictures.draw("cartpole", "balance", 0, actions)
    assert seconds == [0.0, 0.03, 0.06, 0.09]
    assert picture.shape == (120, 640, 3)
    env = suite.load("cartpole", "balance", {"random": 0})
    env.reset()
    np.testing.assert_array_equal(picture[:, :160], env.physics.render(120, 160, "fixed"))
    for action in actions:
        env.step(action)
    np.testing.assert_array_equal(picture[:, 480:], env.physics.render(120, 160, "fixed"))


def test_every_task_that_the_planner_plays_has_committed_pictures() -> None:
    played = solved_pictures.episodes()
    planned = solved_pictures._planned(())
    assert played.keys() == {f"{domain}-{task}" for domain, task in planned}
    for domain, task in planned:
        path = solved_pictures.FOLDER / f"{domain}-{task}.png"
        assert size_of(path) == (120, 640)
        assert f"images/solved/{path.name}" in domain_pages.skeleton(domain)


def test_a_folder_without_pictures_lists_none(tmp_path: Path) -> None:
    assert solved_pictures.episodes(tmp_path) == {}
