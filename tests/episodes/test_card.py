"""The card of a dataset: what it says, and when it is written again."""

import dataclasses
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from limberjack import mujoco
from limberjack.data import Dataset, collect, load
from limberjack.episodes.card import CARD_LINE, median_seed, names_of, write_card
from limberjack.episodes.figures import Figures
from limberjack.episodes.manifest import Manifest
from limberjack.rl import control
from tests.rl import odd_environments as odd

from .collected import PENDULUM, folder_of

_MODEL = '<mujoco><worldbody><body><joint/><geom size=".1"/></body></worldbody></mujoco>'


class _Pair(odd.Pole):
    """Observes an array without numbers."""

    def initialize_episode(self, physics: Any) -> None:
        physics.data.qpos[:] = self.random.uniform(-1, 1)

    def get_observation(self, physics: Any) -> Any:
        position = physics.position()
        return {"position": position.copy(), "nothing": position[..., :0].copy()}


def _without_motors(seed: int) -> control.Environment:
    physics = mujoco.Physics.from_xml_string(_MODEL)
    return control.Environment(physics, _Pair(seed), time_limit=0.1, control_timestep=0.02)


def _huge(observation: object) -> np.ndarray:
    return np.array([1e300, 0.0])


def _rows(folder: Path) -> dict[str, str]:
    """The figures of each column in a card."""
    card = (folder / "README.md").read_text()
    return dict(re.findall(r"^\| `(.*?)` \|.*?\|.*?\| (.*) \|$", card, re.MULTILINE))


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
    rows = _rows(folder_of(arms))
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


def test_a_column_without_numbers_has_no_statistics(tmp_path: Path) -> None:
    collect(_without_motors, None, "zero", range(2), out=tmp_path, num_threads=1)
    rows = _rows(tmp_path)
    for name in ("action", "observation/nothing"):
        assert rows[name].split() == ["|"] * 3
    assert len(rows["observation/position"].split()) == 7
    assert len(load(tmp_path)) == 2


def test_numbers_that_are_too_large_for_a_deviation_have_none(tmp_path: Path) -> None:
    collect("reacher", "easy", _huge, range(2), out=tmp_path, time_limit=0.1, num_threads=1)
    assert _rows(tmp_path)["action"] == "5e+299 | inf | 0 | 1e+300"


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


def test_a_return_that_is_no_number_leaves_no_order(pendulums: Dataset, tmp_path: Path) -> None:
    manifest, figures = _parts(pendulums)
    figures[0].returns[0] = math.nan
    write_card(tmp_path, manifest, figures)
    text = (tmp_path / "README.md").read_text()
    assert "mean return is nan, the median nan, the least nan and the greatest nan." in text


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
