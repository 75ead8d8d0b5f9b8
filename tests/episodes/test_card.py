"""The card of a dataset: what it says, and when it is written again."""

import dataclasses
import math
import re
from pathlib import Path

import numpy as np
import pytest

from limberjack.data import Dataset, collect
from limberjack.episodes.card import CARD_LINE, median_seed, names_of, write_card
from limberjack.episodes.figures import Figures
from limberjack.episodes.manifest import Manifest

from .collected import PENDULUM, folder_of


def _parts(dataset: Dataset) -> tuple[Manifest, list[Figures]]:
    manifest = Manifest.read(folder_of(dataset) / "dataset.json")
    assert manifest is not None
    return manifest, [shard.figures() for shard in dataset.shards]


def test_a_card_that_the_user_has_changed_stays(tmp_path: Path) -> None:
    domain, task, seconds = PENDULUM

    def gather(seeds: range) -> str:
        collect(domain, task, "zero", seeds, out=tmp_path, time_limit=seconds, num_threads=1)
        return (tmp_path / "README.md").read_text()

    first = gather(range(2))
    header = ["configs:", "- config_name: default", "  data_files: episodes/*.parquet", "---"]
    assert first.splitlines()[:5] == ["---", *header]
    assert "2 episodes of seeds 0 to 1, 20 steps" in first
    assert "4 episodes of seeds 0 to 3, 40 steps" in gather(range(2, 4))
    mine = first.replace(CARD_LINE, "Mine.")
    (tmp_path / "README.md").write_text(mine)
    assert gather(range(4, 6)) == mine


def test_the_statistics_of_a_column_are_those_of_all_of_its_numbers(arms: Dataset) -> None:
    card = (folder_of(arms) / "README.md").read_text()
    rows = dict(re.findall(r"^\| `(.*?)` \|.*?\|.*?\| (.*) \|$", card, re.MULTILINE))
    assert list(rows) == [column.name for column in arms.recipe.columns]
    for name, parts in {
        "observation/arm_pos": [episode.observations["arm_pos"] for episode in arms],
        "action": [episode.actions for episode in arms],
        "reward": [episode.rewards for episode in arms],
    }.items():
        values = np.concatenate(parts)
        expected = [values.mean(), values.std(), values.min(), values.max()]
        # The card has four digits.
        np.testing.assert_allclose(
            [float(text) for text in rows[name].split(" | ")], expected, rtol=6e-4, atol=1e-9
        )
    assert rows["seed"].split() == ["|"] * 3


@pytest.mark.parametrize(
    ("returns", "expected"),
    [
        ([3.0, 1.0, 2.0], 9),
        ([4.0, 1.0, 3.0, 2.0], 10),
        ([2.0, 2.0, 2.0], 6),
        ([1.0, math.nan, 3.0], 5),
        ([math.nan, math.nan, math.nan], 6),
    ],
)
def test_the_median_episode_has_the_lower_of_two_returns(
    returns: list[float], expected: int, pendulums: Dataset
) -> None:
    manifest, figures = _parts(pendulums)
    files = [range(5, 7), range(9, 7 + len(returns))]
    manifest.files[:] = [dataclasses.replace(manifest.files[0], seeds=seeds) for seeds in files]
    for one, part in zip(figures, (returns[:2], returns[2:]), strict=True):
        one.returns = part
    assert median_seed(manifest, figures) == expected


def test_the_picture_and_the_film_are_shown_if_they_are_in_the_folder(
    pendulums: Dataset, tmp_path: Path
) -> None:
    manifest, figures = _parts(pendulums)
    seed = median_seed(manifest, figures)
    assert [one.total for one in pendulums][seed] == sorted(one.total for one in pendulums)[34]
    picture, film = names_of(seed)

    def card() -> str:
        write_card(tmp_path, manifest, figures)
        return (tmp_path / "README.md").read_text()

    assert "There is no picture: the command that collected the dataset draws" in card()
    assert picture not in card()
    (tmp_path / picture).touch()
    shown = f"![First picture of the episode of seed {seed}]({picture})"
    assert f"\n{shown}\n" in card()
    assert f"The picture is of the episode of seed {seed}, which has the median" in card()
    (tmp_path / film).touch()
    assert f"\n[{shown}]({film})\n" in card()
    assert "no picture" not in card()
