"""The film of README: the committed one, and how it is made."""

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import playing_film
import pytest
import tiles

from limberjack import suite
from tests.tools.sizes import size_of


def test_the_committed_film_has_a_tile_for_each_task_and_is_small() -> None:
    assert set(playing_film.TASKS) <= set(suite.ALL_TASKS)
    columns = tiles.columns_of(len(playing_film.TASKS))
    rows = -(-len(playing_film.TASKS) // columns)
    height, width = tiles.TILE
    assert size_of(playing_film.FILM) == (rows * height, columns * width)
    assert playing_film.FILM.stat().st_size <= tiles.MOST_BYTES


def test_the_pages_that_show_the_film_count_its_tasks() -> None:
    repository = Path(__file__).parents[2]
    for page, folder in ((repository / "README.md", "docs/"), (repository / "docs/index.md", "")):
        text = page.read_text(encoding="utf-8")
        assert f"![A film of {len(playing_film.TASKS)} tasks" in text, page
        assert f"]({folder}images/playing.gif)" in text, page


@pytest.mark.usefixtures("pictures")
def test_a_film_has_its_players_and_tiles_that_are_kept_are_not_played_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(playing_film, "TASKS", (("cartpole", "swingup"), ("acrobot", "swingup")))
    players: list[tuple[str, str, int]] = []
    plain = tiles.play

    def play(
        domain: str, task: str, policy: str, seed: int, seconds: float
    ) -> Iterator[Callable[[int, int], np.ndarray]]:
        players.append((domain, policy, seed))
        return plain(domain, task, "zero", seed, seconds)

    monkeypatch.setattr(tiles, "play", play)
    for _ in range(2):
        playing_film.main(tmp_path / "film.gif", tmp_path / "work", seconds=0.4)
    assert players == [("cartpole", "pretrained", 40_000), ("acrobot", "planner", 1003)]
    assert size_of(tmp_path / "film.gif") == (tiles.TILE[0], 2 * tiles.TILE[1])
