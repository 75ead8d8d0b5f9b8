"""Pictures of a dataset: kept at each step, and drawn again from states."""

import contextlib
import dataclasses
import io
import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from PIL import Image

from limberjack import data, suite
from limberjack.data import Dataset, Kept, Pixels, collect, load, pictures
from limberjack.episodes import recipe as recipes
from limberjack.episodes.recipe import Recipe
from limberjack.episodes.to_lerobot import to_lerobot

from .collected import ARM, folder_of, whole_hashes

# Without shadows, which tests of this folder draw only in fixtures of a module.
_PIXELS = Pixels(camera=0, height=12, width=16, quality="fast")


pytestmark = pytest.mark.usefixtures("pictures")


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """Two episodes of 5 steps with pictures, states and model fields; actions last two steps."""
    folder = tmp_path_factory.mktemp("drawn")
    domain, task, seconds = ARM
    how = {"time_limit": seconds, "num_threads": 1, "action_repeat": 2}
    collect(domain, task, "random", range(2), out=folder, kept=Kept(True, pixels=_PIXELS), **how)
    return load(folder)


def test_each_row_has_the_picture_before_its_step(drawn: Dataset) -> None:
    domain, task, seconds = ARM
    for episode in drawn:
        how = {"random": episode.seed, "time_limit": seconds}
        with contextlib.closing(suite.load(domain, task, how)) as environment:
            environment.reset()
            expected = [environment.physics.render(**_PIXELS.render_kwargs)]
            for action in episode.actions:
                environment.step(action)
                expected.append(environment.physics.render(**_PIXELS.render_kwargs))
        np.testing.assert_array_equal(episode.observations["pixels"], expected)
        assert len({picture.tobytes() for picture in expected}) == 6


def test_pictures_drawn_from_states_are_those_that_were_kept(drawn: Dataset) -> None:
    for episode in drawn:
        again = pictures(drawn, episode.seed)
        assert again.dtype == np.uint8
        np.testing.assert_array_equal(again, episode.observations["pixels"])
    larger = pictures(drawn, 1, Pixels(camera=-1, height=20, width=10))
    assert larger.shape == (6, 20, 10, 3)


def test_pictures_need_states(pendulums: Dataset) -> None:
    with pytest.raises(ValueError, match=r"no states to draw: collect it with states \(--states\)"):
        pictures(pendulums, 0)


def test_replay_compares_pictures(drawn: Dataset, monkeypatch: pytest.MonkeyPatch) -> None:
    assert data.replay(drawn) is None
    read = Dataset.episodes_of

    def changed(self: Dataset, number: int):
        for episode in read(self, number):
            seen = episode.observations["pixels"].copy()
            seen[3, 0, 0, 0] ^= 1
            episode.observations["pixels"] = seen  # pyright: ignore[reportIndexIssue]
            yield episode

    monkeypatch.setattr(Dataset, "episodes_of", changed)
    difference = data.replay(drawn)
    assert difference is not None
    assert "observation/pixels of row 3 differs by up to 1" in difference


def test_readers_give_pictures_of_bytes(drawn: Dataset) -> None:
    seen = np.concatenate([episode.observations["pixels"][:-1] for episode in drawn])
    chosen = drawn.select(float32=True)
    (batch,) = chosen.batches(100)
    assert batch.observations["pixels"].dtype == np.uint8
    np.testing.assert_array_equal(batch.observations["pixels"], seen)
    np.testing.assert_array_equal(batch.next_observations["pixels"][:4], seen[1:5])
    windows = next(chosen.windows(3))
    assert windows.observations["pixels"].dtype == np.uint8
    np.testing.assert_array_equal(windows.observations["pixels"][1], seen[1:5])
    assert list(drawn.select(["pixels"]).transitions([3]).observations) == ["pixels"]
    assert "pixels" not in next(drawn.select(["arm_pos"]).batches(4)).observations


def test_pictures_have_no_statistics(drawn: Dataset) -> None:
    assert "pixels" not in drawn.statistics().observations
    assert "pixels" not in (folder_of(drawn) / "dataset.json").read_text().partition('"files"')[2]
    (column,) = (c for c in drawn.recipe.columns if c.name == "observation/pixels")
    assert (column.dtype, column.shape, column.has_figures) == ("uint8", (12, 16, 3), False)


def test_how_many_episodes_are_played_together_changes_no_byte(
    drawn: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert drawn.recipe.unit == 64
    monkeypatch.setattr(recipes, "_UNIT_NBYTES", drawn.recipe.episode_nbytes)
    assert drawn.recipe.unit == 1
    domain, task, seconds = ARM
    how = {"time_limit": seconds, "num_threads": 1, "action_repeat": 2}
    collect(domain, task, "random", range(2), out=tmp_path, kept=drawn.recipe.kept, **how)
    assert whole_hashes(tmp_path) == whole_hashes(folder_of(drawn))


def _blind(observation: Mapping[str, np.ndarray]) -> np.ndarray:
    assert sorted(observation) == ["orientation", "velocity"]
    return np.zeros(1)


def test_a_policy_does_not_see_the_pictures(tmp_path: Path) -> None:
    where = {"out": tmp_path, "time_limit": 0.04, "kept": Kept(pixels=_PIXELS, flat=True)}
    collect("pendulum", "swingup", _blind, range(1), **where)
    assert sorted(load(tmp_path)[0].observations) == ["observations", "pixels"]


def test_a_recipe_has_the_pictures_and_is_checked(drawn: Dataset) -> None:
    text = drawn.recipe.text(range(2))
    assert Recipe.parse(text) == (drawn.recipe, range(2))
    content = json.loads(text)
    assert content["pixels"]["width"] == 16
    assert "pixels" not in Kept().as_json()
    wider = Kept(True, pixels=Pixels(0, 12, 18, quality="fast"))
    other = dataclasses.replace(drawn.recipe, kept=wider)
    assert drawn.recipe.difference(other) == "pixels.width is 16 and 18"
    for entry in (
        3,
        {"width": 17},
        {"height": -12},
        {"height": 12.5},
        {"size": 3},
        {"camera": [0, 1]},
    ):
        forged = entry if entry == 3 else {**content["pixels"], **entry}
        with pytest.raises(
            ValueError, match=r"its recipe is damaged|its pictures|other forms|one cam"
        ):
            Recipe.parse(json.dumps({**content, "pixels": forged}))
    without = [one for one in content["columns"] if one[0] != "observation/pixels"]
    with pytest.raises(ValueError, match="observation/pixels"):
        Recipe.parse(json.dumps({**content, "columns": without}))


def test_lerobot_gets_pictures_as_png(drawn: Dataset, tmp_path: Path) -> None:
    to_lerobot(drawn, tmp_path / "out")
    (path,) = (tmp_path / "out" / "data").rglob("*.parquet")
    rows = pq.read_table(path).to_pylist()
    contents = [row["observation.images.pixels"] for row in rows]
    found = [np.asarray(Image.open(io.BytesIO(one["bytes"]))) for one in contents]
    seen = np.concatenate([episode.observations["pixels"][:-1] for episode in drawn])
    np.testing.assert_array_equal(found, seen)
    features = json.loads((tmp_path / "out" / "meta" / "info.json").read_text())["features"]
    assert features["observation.images.pixels"]["shape"] == [12, 16, 3]
    numbers = sum(v[0].size for n, v in drawn[0].observations.items() if n != "pixels")
    assert features["observation.state"]["shape"] == [numbers]
    assert {len(row["observation.state"]) for row in rows} == {numbers}


@pytest.mark.parametrize(
    "pixels", [Pixels(frame_stack=3), Pixels(only=True), Pixels(camera=[0, 1])]
)
def test_stacks_and_several_cameras_are_refused(pixels: Pixels) -> None:
    with pytest.raises(ValueError, match=r"expected one camera, frame_stack 1 and only=False"):
        Kept(pixels=pixels)


def test_an_unknown_camera_is_refused_before_anything_is_played(tmp_path: Path) -> None:
    kept = Kept(pixels=Pixels(camera="sid"))
    with pytest.raises(ValueError, match="sid"):
        collect("cartpole", "balance", "zero", range(1), out=tmp_path / "out", kept=kept)
    assert not (tmp_path / "out").exists()
