"""`write_card`: the README.md of a dataset, which Hugging Face shows as its page.

    write_card(Path("walk"), manifest, figures)     # of each file, in their order
    seed = median_seed(manifest, figures)
    picture, film = names_of(seed)                  # shown if they are in the folder

The header tells Hugging Face `datasets` where the episodes are. The text depends on the manifest,
and on whether the median episode is drawn, which `illustrating` does. A card without the line
`CARD_LINE` is the user's, and stays.
"""

import itertools
import math
import statistics
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from limberjack.episodes.figures import Figures
from limberjack.episodes.manifest import EPISODES, MANIFEST, Manifest
from limberjack.episodes.places import Place, exists, filling, read
from limberjack.episodes.recipe import Column
from limberjack.utils.facts import title_of
from limberjack.utils.texts import encodable

__all__ = ["CARD", "CARD_LINE", "median_seed", "names_of", "write_card"]

CARD = "README.md"
CARD_LINE = (
    "<!-- `limberjack collect` writes this file again when it adds episodes, unless you remove "
    "this line. -->"
)
_NO_PICTURE = (
    "There is no picture: the command that collected the dataset draws the median episode with "
    "`--film`, where OpenGL is available."
)
_NAMES = ("mean", "std", "min", "max")


def median_seed(manifest: Manifest, figures: Sequence[Figures]) -> int:
    """The seed of the episode with the median return; of two, that with the lower return.

    Args:
      manifest: of the dataset.
      figures: of each of its files, in their order.
    """
    seeds = itertools.chain.from_iterable(file.seeds for file in manifest.files)
    returns = itertools.chain.from_iterable(one.returns for one in figures)
    # A return that is no number, of an episode that diverged, counts as the lowest.
    ordered = sorted(
        (-math.inf if math.isnan(value) else value, seed)
        for value, seed in zip(returns, seeds, strict=True)
    )
    return ordered[(len(ordered) - 1) // 2][1]


def names_of(seed: int) -> tuple[str, str]:
    """The names of the first picture and of the film of an episode, in a dataset's folder."""
    return f"median-{seed:010}.png", f"median-{seed:010}.mp4"


def write_card(directory: Place, manifest: Manifest, figures: Sequence[Figures]) -> None:
    """Writes the card, unless it is the user's.

    Args:
      directory: of the dataset.
      manifest, figures: as for `median_seed`.

    Raises:
      OSError: it cannot be read or written.
    """
    path = directory / CARD
    if exists(path) and CARD_LINE.encode() not in read(path):
        return
    content = encodable(_text(directory, manifest, figures)).encode()
    with filling(path, directory) as partial:
        partial.write_bytes(content)


def _text(directory: Place, manifest: Manifest, figures: Sequence[Figures]) -> str:
    recipe, facts = manifest.recipe, manifest.recipe.facts
    everything = Figures(recipe)
    for one in figures:
        everything.include(one)
    return "\n".join(
        [
            "---",
            "configs:",
            "- config_name: default",
            f"  data_files: {EPISODES}/*.parquet",
            "---",
            "",
            CARD_LINE,
            "",
            f"# {title_of(facts)}, policy `{facts['policy']}`",
            "",
            *_drawn(directory, median_seed(manifest, figures)),
            "",
            _sizes_and_returns(manifest, everything.returns),
            "",
            "`limberjack.data.load(DIR)`, `datasets.load_dataset(DIR)` and each reader of Parquet "
            f"files open it; `limberjack replay DIR` plays it again. `{MANIFEST}` has the recipe, "
            "the returns and the SHA-256 of the files, and the statistics of each number of a "
            "column, of which the table has those of all together.",
            "",
            f"| column | type | shape | {' | '.join(_NAMES)} |",
            "|---|---|---|---|---|---|---|",
            *_rows(recipe.columns, everything.statistics()),
            "",
            f"Collected with {', '.join(f'{n} {v}' for n, v in facts['versions'].items())}.",
            "",
        ]
    )


def _sizes_and_returns(manifest: Manifest, returns: Sequence[float]) -> str:
    seeds = [file.seeds for file in manifest.files]
    episodes = len(returns)
    if any(map(math.isnan, returns)):  # they have no order
        returns = [math.nan] * episodes
    steps = sum(file.rows for file in manifest.files) - episodes
    size = sum(file.nbytes for file in manifest.files) / 1e6
    return (
        f"{episodes} episodes of seeds {seeds[0].start} to {seeds[-1].stop - 1}, {steps:,} "
        f"steps of {manifest.recipe.facts['control_timestep']:g} s; {size:,.1f} MB in "
        f"{len(seeds)} files. The mean return is {sum(returns) / episodes:.1f}, the median "
        f"{statistics.median(returns):.1f}, the least {min(returns):.1f} and the greatest "
        f"{max(returns):.1f}."
    )


def _drawn(directory: Place, seed: int) -> Iterator[str]:
    """The lines with the picture and the film of an episode, as far as they are in the folder."""
    picture, film = names_of(seed)
    has_film = exists(directory / film)
    if not exists(directory / picture):
        yield _NO_PICTURE
        return
    shown = f"![First picture of the episode of seed {seed}]({picture})"
    yield f"[{shown}]({film})" if has_film else shown
    yield ""
    link = f"[The film]({film}) shows" if has_film else "The picture is of"
    yield f"{link} the episode of seed {seed}, which has the median return."


def _rows(
    columns: Sequence[Column], found: Mapping[str, Mapping[str, Sequence[float | None]]]
) -> Iterator[str]:
    """The rows of the table: each column, and the statistics of all of its numbers together."""
    for column in columns:
        has_figures = column.name in found and column.size
        figures = _together(found[column.name]) if has_figures else [""] * len(_NAMES)
        values = (f"`{column.name}`", column.dtype, f"{list(column.shape) or ''}", *figures)
        yield f"| {' | '.join(values)} |"


def _together(of: Mapping[str, Sequence[float | None]]) -> list[str]:
    """Mean, deviation, least and greatest of several numbers, each with as many values."""
    m, s, least, most = (np.array(of[name], float) for name in _NAMES)
    with np.errstate(all="ignore"):  # a simulation that diverges may give any number
        mean = _mean(m)
        # Of each number, the square is that of its deviation and that of its mean's from all.
        deviation = np.sqrt(_mean(s**2 + (m - mean) ** 2))
    return [f"{value:.4g}" for value in (mean, deviation, least.min(), most.max())]


def _mean(values: np.ndarray) -> np.float64:
    """The mean of numbers, (n,), added in their order, so that no processor changes a bit."""
    return np.cumsum(values)[-1] / len(values)
