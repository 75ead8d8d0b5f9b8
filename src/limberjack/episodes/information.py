"""`inform`: the returns of a dataset, its size, and the hashes of its files.

    information = inform(load("data"))
    print(information.summary.mean, information.strata)
    print(information.as_json())        # with the recipe, for a card

Every page of every file is read, and compared with its checksum.
"""

import dataclasses
import hashlib
from pathlib import Path

from limberjack.episodes.dataset import Dataset
from limberjack.episodes.recipe import Recipe
from limberjack.episodes.statistics import Score, Summary, strata, summarise
from limberjack.report import Facts
from limberjack.utils.regular import open_regular

__all__ = ["Information", "inform"]


@dataclasses.dataclass(frozen=True)
class Information:
    """Figures of a dataset.

    Attributes:
      recipe: everything that the episodes depend on except for the seeds.
      seeds: of the episodes.
      steps: of all episodes together.
      nbytes: of all files together.
      summary: of all returns.
      strata: of the returns of each kind of start, by name.
      files: the SHA-256 of each file, by name, in hex.
    """

    recipe: Recipe
    seeds: list[int]
    steps: int
    nbytes: int
    summary: Summary
    strata: dict[str, Summary]
    files: dict[str, str]

    def as_json(self) -> Facts:
        """All of it by name, as values of JSON."""
        return {
            **self.recipe.facts,
            **dataclasses.asdict(self.recipe.kept),
            "columns": {c.name: [c.dtype, *c.shape] for c in self.recipe.columns},
            "seeds": self.seeds,
            "steps": self.steps,
            "bytes": self.nbytes,
            "returns": self.summary.as_json(),
            "strata": {name: part.as_json() for name, part in self.strata.items()},
            "sha256": self.files,
        }


def inform(dataset: Dataset) -> Information:
    """The figures of a dataset.

    Raises:
      ValueError: a file is damaged.
    """
    scores = [Score.of(episode) for episode in dataset]
    paths = [shard.path for shard in dataset.shards]
    return Information(
        dataset.recipe,
        dataset.seeds,
        dataset.steps,
        sum(path.stat().st_size for path in paths),
        summarise(scores),
        strata(scores),
        {path.name: _hash(path) for path in paths},
    )


def _hash(path: Path) -> str:
    with open_regular(path) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
