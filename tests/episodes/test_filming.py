"""Films of recorded episodes."""

import dataclasses
from pathlib import Path
from typing import Any

import pytest

from limberjack import suite
from limberjack.data import Dataset, collect, film, load
from limberjack.episodes.episode import Kept
from limberjack.episodes.parquet import encode
from limberjack.mujoco.camera import RenderingError

from .collected import ARM, put

_VIEW: dict[str, Any] = {"height": 64, "width": 64, "camera": 0}


@pytest.fixture(autouse=True)
def _draws() -> None:
    pytest.importorskip("imageio_ffmpeg", reason="needs the extra 'video'")
    try:
        suite.load("pendulum", "swingup").physics.render(8, 8)
    except RenderingError as error:
        pytest.skip(f"no pictures can be drawn here: {error}")


def test_states_and_seeds_give_the_same_film(arms: Dataset, tmp_path: Path) -> None:
    domain, task, seconds = ARM
    collect(domain, task, "random", [64], out=tmp_path / "bare", time_limit=seconds, kept=Kept())
    shown: list[tuple[int, int, float]] = []
    from_states = film(
        arms, 64, out=tmp_path / "states.gif", on_progress=lambda *s: shown.append(s), **_VIEW
    )
    from_seed = film(load(tmp_path / "bare"), 64, out=tmp_path / "seed.gif", **_VIEW)
    assert from_states.read_bytes() == from_seed.read_bytes()
    assert shown[-1] == (5, 5, arms.episode(64).total)


def test_a_film_of_other_rewards_than_the_recorded_ones_is_refused(
    pendulums: Dataset, tmp_path: Path
) -> None:
    episode = pendulums.episode(69)
    forged = dataclasses.replace(episode, rewards=episode.rewards + 1)
    name = "seeds-0000000069-0000000070.parquet"
    put(tmp_path, name, encode(pendulums.recipe, [forged]))
    with pytest.raises(ValueError, match=r"seed 69 has return .* here, and .* in the dataset"):
        film(load(tmp_path, allow_gaps=True), 69, out=tmp_path / "film.gif", **_VIEW)
    assert [path.name for path in tmp_path.iterdir()] == ["episodes"]


def test_an_episode_that_is_not_there_is_refused(arms: Dataset, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="there is no episode of seed 3; the first is 63"):
        film(arms, 3, out=tmp_path / "film.gif")
