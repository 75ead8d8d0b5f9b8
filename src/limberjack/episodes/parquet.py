"""`Shard`: a Parquet file of up to 64 episodes; `encode` and `join` make the bytes of one.

    content = encode(recipe, episodes)                  # equal episodes, equal bytes
    with Shard(path).opened() as read:
        episode = read(seed)

A row is a step (see `columns`), and a row group is an episode. An array is a list of fixed size; a
model field is a list that is empty but in an episode's first row. The footer has the recipe under
'limberjack'. Reading executes nothing. A file is checked, as anyone may have changed it: its
columns and rows against its recipe, and each page against its checksum.

This is the only module that imports pyarrow.
"""

import contextlib
import io
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from limberjack.episodes.columns import Values, columns_of, episode_of
from limberjack.episodes.episode import Episode
from limberjack.episodes.recipe import FIELD, Column, Recipe
from limberjack.utils.regular import check_regular
from limberjack.utils.requirements import missing_extra

try:
    import pyarrow as pa
    import pyarrow.parquet as pq
except ImportError as error:
    raise missing_extra("data") from error

__all__ = ["PYARROW", "Shard", "encode", "join"]

PYARROW: str = pa.__version__  # the bytes depend on it

_Untyped = Any  # an object of pyarrow, which has no types

_RECIPE = b"limberjack"
_LEVEL = 1  # of zstd: higher ones take longer and save 0.2 % of the humanoid's 616 bytes a step
_MOST_BYTES = 2**30  # of an episode; an hour of a humanoid's steps with states takes a third of it


class Shard:
    """A file of episodes.

    Attributes:
      path: of the file.
      recipe: everything that its bytes depend on except for the seeds.
      seeds: of its episodes.
      lengths: steps of each episode.
    """

    def __init__(self, path: Path) -> None:
        """Reads the footer.

        Raises:
          OSError: the file cannot be read.
          ValueError: it is not a regular file, or not one of a dataset.
        """
        check_regular(path)
        self.path = path
        with _damage_reported(path), pq.ParquetFile(path) as file:
            text = (file.schema_arrow.metadata or {}).get(_RECIPE)
            if text is None:
                raise ValueError("it has no recipe")
            self.recipe, self.seeds = Recipe.parse(text)
            if not file.schema_arrow.equals(_schema(self.recipe)):
                raise ValueError("its columns are not those of its recipe")
            groups = [file.metadata.row_group(i) for i in range(file.num_row_groups)]
            self.lengths = [group.num_rows - 1 for group in groups]
        if len(groups) != len(self.seeds) or min(self.lengths) < 1:
            raise self._damaged(f"it has {len(groups)} episodes of {self.lengths} steps")
        size = sum(column.nbytes for column in self.recipe.columns)
        if (max(self.lengths) + 1) * size > _MOST_BYTES:
            raise self._damaged(f"an episode takes more than {_MOST_BYTES:,} bytes")

    @contextlib.contextmanager
    def opened(self) -> Iterator[Callable[[int], Episode]]:
        """A function that reads the episode of a seed; it raises ValueError for a damaged one."""
        with _damage_reported(self.path):
            file = self.file()
        with file:
            yield lambda seed: self._read(file, seed)

    def file(self) -> pq.ParquetFile:
        """The open file, whose pages are compared with their checksums when they are read."""
        return pq.ParquetFile(self.path, page_checksum_verification=True)

    def episodes(self) -> Iterator[Episode]:
        """All episodes, in the order of their seeds."""
        with self.opened() as read:
            yield from map(read, self.seeds)

    def _read(self, file: pq.ParquetFile, seed: int) -> Episode:
        with _damage_reported(self.path):
            table = file.read_row_group(seed - self.seeds.start, use_threads=False)
            values = {c.name: _from_arrow(c, table.column(c.name)) for c in self.recipe.columns}
            return episode_of(values, seed)

    def _damaged(self, reason: str) -> ValueError:
        return _damaged(self.path, reason)


def encode(recipe: Recipe, episodes: Sequence[Episode]) -> bytes:
    """The content of the file of some episodes, whose seeds follow each other."""
    first = episodes[0].seed
    schema = _schema(recipe)

    def tables() -> Iterator[pa.Table]:
        for episode in episodes:
            values = columns_of(episode, recipe)
            rows = episode.length + 1
            columns = [_to_arrow(c, values[c.name], rows) for c in recipe.columns]
            yield pa.Table.from_arrays(columns, schema=schema)

    return _written(recipe, range(first, first + len(episodes)), tables())


def join(shards: Sequence[Shard]) -> bytes:
    """The content of the file with all episodes of files whose seeds follow each other."""
    recipe = shards[0].recipe

    def tables() -> Iterator[pa.Table]:
        for shard in shards:
            with _damage_reported(shard.path), shard.file() as file:
                for group in range(file.num_row_groups):
                    yield file.read_row_group(group, use_threads=False)

    return _written(recipe, range(shards[0].seeds.start, shards[-1].seeds.stop), tables())


def _written(recipe: Recipe, seeds: range, tables: Iterator[pa.Table]) -> bytes:
    file = io.BytesIO()
    schema = _schema(recipe).with_metadata({_RECIPE: recipe.text(seeds)})
    leaves = {c.name: _leaf(c) for c in recipe.columns}
    # pyarrow's annotations lack the lists that these take.
    options: dict[str, _Untyped] = {
        "use_dictionary": [leaf for name, leaf in leaves.items() if name in ("seed", "start")],
        "use_byte_stream_split": [leaves[c.name] for c in recipe.columns if "float" in c.dtype],
        "write_statistics": ["seed"],  # so that other readers find an episode
        "write_page_checksum": True,
    }
    with pq.ParquetWriter(
        file, schema, compression="zstd", compression_level=_LEVEL, **options
    ) as writer:
        for table in tables:
            writer.write_table(table, row_group_size=table.num_rows)
    return file.getvalue()


def _schema(recipe: Recipe) -> _Untyped:
    return pa.schema([pa.field(c.name, _type(c), nullable=False) for c in recipe.columns])


def _type(column: Column) -> _Untyped:
    """The type of a column in the file."""
    if column.dtype == "str":
        return pa.dictionary(pa.int8(), pa.string())
    number = pa.from_numpy_dtype(np.dtype(column.dtype))
    element = pa.field("element", number, nullable=False)
    if column.name.startswith(FIELD):
        return pa.list_(element)
    return pa.list_(element, column.size) if column.shape else number


def _leaf(column: Column) -> str:
    """The path of a column's numbers in the file."""
    is_list = column.shape or column.name.startswith(FIELD)
    return f"{column.name}.list.element" if is_list else column.name


def _to_arrow(column: Column, values: Values, rows: int) -> _Untyped:
    """A column's values of an episode of so many rows, as an array of pyarrow."""
    if isinstance(values, str):
        return pa.DictionaryArray.from_arrays(pa.array(np.zeros(rows, np.int8)), pa.array([values]))
    kind = _type(column)
    numbers = pa.array(np.ascontiguousarray(values).reshape(-1))
    if column.name.startswith(FIELD):
        ends = np.full(rows + 1, len(numbers), np.int32)
        ends[0] = 0
        return pa.ListArray.from_arrays(pa.array(ends), numbers, type=kind)
    return pa.FixedSizeListArray.from_arrays(numbers, type=kind) if column.shape else numbers


def _from_arrow(column: Column, found: _Untyped) -> Values:
    """The values of `_to_arrow`, without a copy where that is possible.

    Raises:
      ValueError: they are of another form.
    """
    array = found.chunk(0) if found.num_chunks == 1 else found.combine_chunks()
    if column.dtype == "str":
        kinds = array.unique().to_pylist()
        if len(kinds) != 1:
            raise ValueError(f"the column {column.name!r} has the values {kinds} in one episode")
        return kinds[0]
    rows = len(array)
    if column.name.startswith(FIELD):
        if len(array[0]) != column.size or len(array.flatten()) != column.size:
            raise ValueError(f"the column {column.name!r} has no {column.size} numbers in a row")
        return array.flatten().to_numpy(zero_copy_only=False).reshape(column.shape)
    numbers = array.flatten() if column.shape else array
    return numbers.to_numpy(zero_copy_only=False).reshape(rows, *column.shape)


@contextlib.contextmanager
def _damage_reported(path: Path) -> Iterator[None]:
    """Turns the errors of a damaged file, of which there are many kinds, into ValueError."""
    try:
        yield
    except OSError as error:
        if error.errno is not None:  # of the system; pyarrow's own have no number
            raise
        raise _damaged(path, error) from error
    except (pa.ArrowException, MemoryError, OverflowError, ValueError) as error:
        raise _damaged(path, error) from error


def _damaged(path: Path, reason: object) -> ValueError:
    return ValueError(
        f"{path} is damaged or no file of a dataset ({reason}); remove it, and collect its seeds "
        "again"
    )
