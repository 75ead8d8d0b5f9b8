"""Pictures of the bundled policies: how they are made, and those that are committed."""

from pathlib import Path

import domain_pages
import learned_pictures
import numpy as np
import pytest
import tiles
from PIL import Image

from limberjack import policies, suite
from tests.tools.sizes import size_of

_BUNDLED = policies.bundled()


def test_the_committed_pictures_are_of_the_bundled_policies() -> None:
    found = {name: one.sha256 for name, one in learned_pictures.episodes().items()}
    expected = {f"{one.domain}-{one.task}": one.sha256 for one in _BUNDLED}
    assert found == expected, "draw them again: python tools/learned_pictures.py"
    for one in _BUNDLED:
        assert one.card.scores is not None
        shown = learned_pictures.episodes()[f"{one.domain}-{one.task}"]
        assert shown.mean == round(one.card.scores.mean, 1)
        assert shown.seed == one.card.scores.seeds[0]


def test_the_committed_film_has_a_tile_for_each_task_and_is_small() -> None:
    columns = tiles.columns_of(len(_BUNDLED))
    rows = -(-len(_BUNDLED) // columns)
    height, width = tiles.TILE
    assert size_of(learned_pictures.FILM) == (rows * height, columns * width)
    assert learned_pictures.FILM.stat().st_size <= tiles.MOST_BYTES <= 4_000_000
    page = learned_pictures.FOLDER.parents[1] / "policies.md"
    assert "](images/learned.gif)" in page.read_text(encoding="utf-8")


@pytest.mark.parametrize("domain", dict.fromkeys(one.domain for one in _BUNDLED))
def test_the_page_of_a_domain_shows_its_bundled_policies(domain: str) -> None:
    page = domain_pages.skeleton(domain)
    assert f"](images/learned/{domain}.png)" in page
    mine = [one for one in _BUNDLED if one.domain == domain]
    height, width = learned_pictures.PICTURE
    path = learned_pictures.FOLDER / f"{domain}.png"
    assert size_of(path) == (len(mine) * height, 4 * width)
    for one in mine:
        assert one.card.scores is not None
        assert f"{one.task} {one.card.scores.mean:.1f}" in page


def test_there_is_no_picture_of_a_domain_without_a_bundled_policy() -> None:
    drawn = {path.stem for path in learned_pictures.FOLDER.glob("*.png")}
    assert drawn == {one.domain for one in _BUNDLED}


@pytest.mark.usefixtures("pictures")
def test_pictures_show_an_episode_of_the_policy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (one,) = (b for b in _BUNDLED if (b.domain, b.task) == ("cartpole", "swingup"))
    monkeypatch.setattr(policies, "bundled", lambda: [one, one, one])
    learned_pictures.main(tmp_path / "learned", seconds=0.4)
    (episode,) = learned_pictures.episodes(tmp_path / "learned").values()
    assert episode.seconds == [0.0, 0.08, 0.24, 0.32]
    height, width = tiles.TILE
    assert size_of(tmp_path / "learned.gif") == (height, 3 * width)
    picture = np.asarray(Image.open(tmp_path / "learned" / "cartpole.png"))
    env = suite.load("cartpole", "swingup", {"random": episode.seed})
    time_step = env.reset()
    act = policies.find("pretrained", env).begin_alone(env, episode.seed)
    for _ in range(32):
        time_step = env.step(act(time_step.observation))
    last = env.physics.render(*learned_pictures.PICTURE, "fixed")
    assert np.array_equal(picture[:120, 480:], last)


def test_a_film_that_would_be_too_large_has_fewer_frames(tmp_path: Path) -> None:
    stream = np.random.RandomState(0)
    noise = [[stream.randint(0, 255, (20, 30, 3)).astype(np.uint8) for _ in range(6)]]
    path = tmp_path / "film.gif"
    sizes = [1_000_000]
    for _ in tiles.STRIDES:
        tiles.write_film(path, noise, sizes[-1] - 1)
        sizes.append(path.stat().st_size)
    assert sizes == sorted(set(sizes), reverse=True)
    with pytest.raises(ValueError, match=r"bytes; expected at most 100"):
        tiles.write_film(path, noise, 100)


def test_a_folder_without_pictures_lists_none(tmp_path: Path) -> None:
    assert learned_pictures.episodes(tmp_path) == {}
