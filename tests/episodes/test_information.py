"""The figures of a dataset."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from limberjack.data import Dataset, inform, load
from limberjack.episodes.information import _score

from .collected import hashes


def test_the_figures_are_those_of_the_episodes_and_files(pendulums: Dataset) -> None:
    information = inform(pendulums)
    totals = [episode.total for episode in pendulums]
    assert information.summary.mean == np.mean(totals)
    assert information.summary.episodes == 70
    assert information.strata == {}
    folder = pendulums.shards[0].path.parent
    assert information.files == hashes(folder)
    assert information.nbytes == sum(path.stat().st_size for path in folder.glob("seeds-*"))
    content = json.loads(json.dumps(information.as_json()))
    assert content["policy"] == "random"
    assert content["sha256"] == information.files
    assert content["steps"] == 700
    assert content["columns"]["action"] == ["float64", 1]


def test_returns_are_reported_by_kind_of_start(arms: Dataset) -> None:
    information = inform(arms)
    starts = {episode.start for episode in arms}
    assert set(information.strata) == starts
    assert sum(part.episodes for part in information.strata.values()) == 2


def test_an_episode_that_diverged_is_no_success(pendulums: Dataset) -> None:
    episode = pendulums.episode(0)
    perfect = dataclasses.replace(episode, rewards=np.ones(10))
    assert _score(perfect).success
    diverged = _score(dataclasses.replace(perfect, diverged=True))
    assert diverged.diverged
    assert not diverged.success


def test_damage_anywhere_is_found(damaged: Path) -> None:
    with pytest.raises(ValueError, match="is damaged"):
        inform(load(damaged))
