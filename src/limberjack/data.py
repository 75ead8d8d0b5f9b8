"""Datasets: episodes of a policy in Parquet files that anyone can make again, byte for byte.

    from limberjack import data

    data.collect("humanoid", "walk", "random", range(640), out="walk")
    dataset = data.load("walk")
    for batch in dataset.batches(256, seed=0):
        learn(batch)
    windows = dataset.windows(16, stride=8)     # and dataset[3], transitions, select, statistics
    data.replay(dataset)        # None: every bit is the same

Finished files are in the subfolder `episodes`, which every reader of Parquet files opens. The
footer of a file has the recipe: task, policy, versions; `dataset.json` lists all files. It needs
the extra `data`. Nothing in a dataset is executed when it is loaded.
"""

from limberjack.episodes.collecting import collect, collect_set
from limberjack.episodes.column_statistics import Spread, Statistics
from limberjack.episodes.dataset import Dataset, Information, inform
from limberjack.episodes.episode import Episode, Kept
from limberjack.episodes.films import film, pictures
from limberjack.episodes.loading import load
from limberjack.episodes.reading import Batch, Windows
from limberjack.episodes.recipe import Recipe
from limberjack.episodes.replaying import replay
from limberjack.rl.pixels import Pixels

__all__ = [
    "Batch",
    "Dataset",
    "Episode",
    "Information",
    "Kept",
    "Pixels",
    "Recipe",
    "Spread",
    "Statistics",
    "Windows",
    "collect",
    "collect_set",
    "film",
    "inform",
    "load",
    "pictures",
    "replay",
]
