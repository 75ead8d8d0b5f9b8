"""`Shard`: a Parquet file of episodes; `encode` and `join` write one.

    encode(recipe, episodes)                            # bytes; equal episodes, equal bytes
    join(recipe, range(0, 140), parts, path)            # from files of fewer episodes, one by one
    with Shard(path).opened() as read:
        episode = read(seed)

A row is a step: the observation before it, the action, and what followed. A last row has the last
observation, and nulls in the columns of steps. A row group has whole episodes: one, or as many
short ones as have a quarter of a megabyte, so that footers stay small. An array is a list of fixed
size, but the action, whose last one is null, is one of variable size: few versions of pyarrow
read nulls in the other kind. A model field, `field/...`, is a list that is empty but in an
episode's first row. Files of format 1 lack the columns step, time, is_first and is_last, and have
NaN and false in the last row.

The footer has the recipe under 'limberjack', returns and statistics under 'limberjack_figures', and
the steps of each episode under 'limberjack_lengths', without which each row group is an episode.
Reading executes nothing. A file is checked, as anyone may have changed it: its columns and rows
against its recipe, and each page against its checksum.

This is the only module that imports pyarrow.
"""

import bisect
import contextlib
import io
import itertools
import json
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from limberjack.episodes.episode import Episode
from limberjack.episodes.figures import Figures
from limberjack.episodes.manifest import REPAIR, DamagedError, check_recipe
from limberjack.episodes.places import Place, check_file, opened
from limberjack.episodes.recipe import (
    FIELD,
    FORMAT,
    GROUP_NBYTES,
    MOST_NBYTES,
    OBSERVATION,
    PIXELS,
    Column,
    Recipe,
)
from limberjack.policies.entries import entry_of
from limberjack.utils.requirements import missing_extra

try:
    import pyarrow as pa
    import pyarrow.parquet as pq
except ImportError as error:
    raise missing_extra("data") from error

__all__ = [
    "PYARROW",
    "Plain",
    "Shard",
    "Values",
    "columns_of",
    "encode",
    "episode_of",
    "join",
    "write_plain",
]

PYARROW: str = pa.__version__  # the bytes depend on it

# Of a column for other programs: (rows,) or (rows, n), or a text, a list of texts or the content of
# a picture's file in each row.
Plain = np.ndarray | Sequence[str] | Sequence[Sequence[str]] | Sequence[bytes]
Values = np.ndarray | str  # of a column in an episode; the only text is the kind of start

_RECIPE, _FIGURES, _LENGTHS = b"limberjack", b"limberjack_figures", b"limberjack_lengths"
_PLACE = ("seed", "step", "time", "is_first", "is_last")  # columns that follow from seed and row
# Columns that are read whichever observations are.
_OF_EVERY = (*_PLACE, "start", "action", "reward", "terminated", "truncated", "success", "diverged")
_LEVEL = 1  # of zstd: higher ones take longer and save 0.2 % of the humanoid's 616 bytes a step
# Of 84 by 84 pixels, in kB for cartpole and walker: 2.0 and 7.0, with level 1 3.1 and 8.2, and as
# PNG 7.6 and 8.1, because pictures that follow each other are alike.
_LEVEL_OF_PIXELS = 3
_PICTURE = ("bytes", "path")


class Shard:
    """A file of episodes.

    Attributes:
      path: of the file.
      recipe: everything that its bytes depend on except for the seeds.
      seeds: of its episodes.
      lengths: steps of each episode.
    """

    def __init__(self, path: Place) -> None:
        """Reads the footer.

        Raises:
          OSError: the file cannot be read.
          ValueError: it is not a regular file, or not one of a dataset.
        """
        check_file(path)
        self.path: Place = path
        with _damage_reported(path), _parquet_file(path) as file:
            texts = file.metadata.metadata or {}
            if _RECIPE not in texts:
                raise ValueError("it has no recipe")
            self.recipe, self.seeds = Recipe.parse(texts[_RECIPE])
            if not file.schema_arrow.equals(_schema(self.recipe)):
                raise ValueError("its columns are not those of its recipe")
            groups = [file.metadata.row_group(i).num_rows for i in range(file.num_row_groups)]
            text = texts.get(_LENGTHS)
            self.lengths = [rows - 1 for rows in groups]
            if text is not None:
                self.lengths = _lengths(text, len(self.seeds))
        if len(self.lengths) != len(self.seeds) or min(self.lengths) < 1:
            raise self._damaged(f"it has {len(self.lengths)} episodes of {self.lengths} steps")
        self._firsts = _starts(length + 1 for length in self.lengths)  # rows of episodes
        self._groups = _starts(groups)  # rows of groups, and the end
        if not set(self._groups) <= set(self._firsts):
            raise self._damaged("its row groups are not of whole episodes")
        if max(groups) * self.recipe.row_nbytes > MOST_NBYTES:
            raise self._damaged(f"an episode takes more than {MOST_NBYTES:,} bytes")

    @property
    def rows(self) -> int:
        """The number of rows."""
        return sum(self.lengths) + len(self.lengths)

    def figures(self) -> Figures:
        """The returns and statistics in the footer, which format 1 lacks."""
        with _damage_reported(self.path), _parquet_file(self.path) as file:
            text = (file.metadata.metadata or {}).get(_FIGURES, b"")
            return Figures.parse(text, self.recipe, len(self.seeds))

    @contextlib.contextmanager
    def opened(
        self, observations: Sequence[str] | None = None
    ) -> Iterator[Callable[[int], Episode]]:
        """A function that reads the episode of a seed; it raises ValueError for a damaged one.

        Args:
          observations: the names of those that the episodes are to have, which then lack states and
            model fields; None for everything.
        """
        columns = self.recipe.columns
        if observations is not None:
            wanted = {OBSERVATION + name for name in observations}
            some = [c for c in columns if c.name in wanted or c.name in _OF_EVERY]
            columns = columns if len(some) == len(columns) else some
        with _damage_reported(self.path):
            file = self.file()
        names = None if columns is self.recipe.columns else [_leaf(column) for column in columns]
        held: dict[int, pa.Table] = {}  # the row group that was read last

        def read(seed: int) -> Episode:
            number = seed - self.seeds.start
            first, end = self._firsts[number], self._firsts[number + 1]
            group = bisect.bisect_right(self._groups, first) - 1
            with _damage_reported(self.path):
                if group not in held:
                    held.clear()
                    held[group] = file.read_row_group(group, columns=names, use_threads=False)
                table = held[group].slice(first - self._groups[group], end - first)
                return self._episode(table, seed, columns)

        with file:
            yield read

    def file(self) -> pq.ParquetFile:
        """The open file, whose pages are compared with their checksums when they are read."""
        return _parquet_file(self.path, page_checksum_verification=True)

    def episodes(self) -> Iterator[Episode]:
        """All episodes, in the order of their seeds."""
        with self.opened() as read:
            yield from map(read, self.seeds)

    def _episode(self, table: pa.Table, seed: int, columns: Sequence[Column]) -> Episode:
        form = self.recipe.format
        values = {c.name: _from_arrow(c, table.column(c.name), form) for c in columns}
        return episode_of(values, seed, self.recipe)

    def _damaged(self, reason: str) -> ValueError:
        return _damaged(self.path, reason)


def columns_of(episode: Episode, recipe: Recipe) -> dict[str, Values]:
    """The values of each of the recipe's columns: T of a step's, T + 1 of the others."""
    return {column.name: _values(episode, column.name, recipe) for column in recipe.columns}


def _values(episode: Episode, name: str, recipe: Recipe) -> Values:
    if name.startswith(OBSERVATION):
        return episode.observations[name.removeprefix(OBSERVATION)]
    if name.startswith(FIELD):
        return episode.fields[name.removeprefix(FIELD)]
    if name in _PLACE:
        return _place(name, episode, recipe.facts["control_timestep"])
    if name == "diverged":
        found = np.zeros(episode.length, bool)
        found[-1] = episode.diverged
        return found
    found = {
        "start": episode.start,
        "state": episode.states,
        "action": episode.actions,
        "reward": episode.rewards,
        "terminated": episode.terminated,
        "truncated": episode.truncated,
        "success": episode.success,
    }[name]
    assert found is not None, name
    return found


def _place(name: str, episode: Episode, control_timestep: float) -> np.ndarray:
    """The values of a column that says where a row is: in which episode, and in which step."""
    steps = np.arange(episode.length + 1)
    match name:
        case "seed":
            return np.full(len(steps), episode.seed)
        case "step":
            return steps
        case "time":
            return steps * control_timestep
        case "is_first":
            return steps == 0
    return steps == episode.length


def episode_of(values: Mapping[str, Values], seed: int, recipe: Recipe) -> Episode:
    """The episode of a seed, in views of the columns' values.

    Raises:
      ValueError: the values are not those of one whole episode with this seed.
    """
    arrays = {name: value for name, value in values.items() if isinstance(value, np.ndarray)}
    ends = arrays["terminated"] | arrays["truncated"]
    if not ends[-1] or ends[:-1].any():
        raise ValueError(f"the episode of seed {seed} does not end with its last step")
    start = values.get("start")
    episode = Episode(
        seed,
        start if isinstance(start, str) else None,
        arrays["reward"],
        bool(arrays["diverged"].any()),
        actions=arrays["action"],
        terminated=arrays["terminated"],
        truncated=arrays["truncated"],
        success=arrays.get("success"),
        observations=_part(arrays, OBSERVATION),
        states=arrays.get("state"),
        fields=_part(arrays, FIELD),
    )
    for name in _PLACE:
        if name in arrays and (arrays[name] != _values(episode, name, recipe)).any():
            wrong = np.unique(arrays[name])[:3].tolist()
            raise ValueError(f"the episode of seed {seed} has rows of {name} {wrong}")
    return episode


def _part(arrays: Mapping[str, np.ndarray], prefix: str) -> dict[str, np.ndarray]:
    """The arrays whose names begin with a prefix, by the rest of their names."""
    return {n.removeprefix(prefix): v for n, v in arrays.items() if n.startswith(prefix)}


def encode(recipe: Recipe, episodes: Sequence[Episode]) -> bytes:
    """The content of the file of some episodes, whose seeds follow each other."""
    first = episodes[0].seed
    file = io.BytesIO()
    _write(recipe, range(first, first + len(episodes)), episodes, file)
    return file.getvalue()


def join(recipe: Recipe, seeds: range, parts: Iterable[Shard], file: Path) -> None:
    """Joins the episodes of seeds from several files into one.

    Args:
      recipe: of the file.
      seeds: follow each other.
      parts: the files that have the episodes, in the order of their seeds; an episode that two have
        is read from the first. One row group is in memory at a time.
      file: to be written.

    Raises:
      ValueError: a part is damaged or of another dataset, or an episode is missing.
    """

    def episodes() -> Iterator[Episode]:
        following = seeds.start
        for part in parts:
            check_recipe(part.path, part.recipe, recipe)
            if following not in part.seeds:
                break
            with part.opened() as read:
                for seed in range(following, min(part.seeds.stop, seeds.stop)):
                    yield read(seed)
            following = part.seeds.stop
        if following < seeds.stop:
            raise ValueError(f"no part has the episode of seed {following}: collect it again")

    with file.open("wb") as opened:
        _write(recipe, seeds, episodes(), opened)


def write_plain(
    path: Path, tables: Iterable[Mapping[str, Plain]], metadata: Mapping[str, str] | None = None
) -> None:
    """Writes a file of plain columns, for other programs.

    Args:
      path: of the file, which is replaced.
      tables: columns by name, at least one of them and all of one form; each is a row group.
      metadata: of the file.
    """
    with contextlib.ExitStack() as stack:
        writer: pq.ParquetWriter | None = None
        for columns in tables:
            table = pa.table({name: _plain(values) for name, values in columns.items()})
            if writer is None:
                schema = table.schema.with_metadata(metadata)
                writer = stack.enter_context(pq.ParquetWriter(path, schema, compression="zstd"))
            writer.write_table(table)


def _plain(values: Plain) -> pa.Array:
    """The values of a column as an array of pyarrow."""
    if not isinstance(values, np.ndarray):
        array = pa.array(values)
        if array.type != pa.binary():
            return array
        # As Hugging Face keeps pictures: their content, or a path.
        return pa.StructArray.from_arrays([array, pa.nulls(len(array), pa.string())], _PICTURE)
    numbers = _array(np.ascontiguousarray(values).reshape(-1))
    if values.ndim == 1:
        return numbers
    return pa.FixedSizeListArray.from_arrays(numbers, values.shape[1])


def _parquet_file(path: Place, **how: bool) -> pq.ParquetFile:
    """An open file, whose name need not be a text."""
    file = pa.OSFile(os.fsencode(path)) if isinstance(path, Path) else opened(path)
    return pq.ParquetFile(file, **how)


def _write(
    recipe: Recipe,
    seeds: range,
    episodes: Iterable[Episode],
    file: io.BytesIO | io.BufferedWriter,
) -> None:
    schema = _schema(recipe).with_metadata({_RECIPE: recipe.text(seeds)})
    leaves = {c.name: _leaf(c) for c in recipe.columns}
    # pyarrow's annotations lack the lists that these take.
    options: dict[str, Any] = {
        "use_dictionary": [leaf for name, leaf in leaves.items() if name in ("seed", "start")],
        "use_byte_stream_split": [leaves[c.name] for c in recipe.columns if "float" in c.dtype],
        "write_statistics": ["seed"],  # so that other readers find an episode
        "write_page_checksum": True,
    }
    # A level for each column, by the names of all of them.
    levels = {leaf: _LEVEL_OF_PIXELS if n == PIXELS else _LEVEL for n, leaf in leaves.items()}
    figures, lengths = Figures(recipe), list[int]()
    with pq.ParquetWriter(
        file, schema, compression="zstd", compression_level=levels, **options
    ) as writer:
        for group in _groups(recipe, episodes):
            table = pa.concat_tables([_table(recipe, episode) for episode in group])
            # As one chunk, so that kinds of starts share a dictionary.
            writer.write_table(table.combine_chunks(), row_group_size=table.num_rows)
            for episode in group:
                figures.add(episode)
                lengths.append(episode.length)
        texts = {_FIGURES: figures.text(), _LENGTHS: _lengths_text(lengths)}
        writer.add_key_value_metadata(texts)


def _groups(recipe: Recipe, episodes: Iterable[Episode]) -> Iterator[list[Episode]]:
    """The episodes of each row group, which depend on their lengths alone."""
    row = recipe.row_nbytes
    group: list[Episode] = []
    for episode in episodes:
        group.append(episode)
        if sum(one.length + 1 for one in group) * row >= GROUP_NBYTES:
            yield group
            group = []
    if group:
        yield group


def _table(recipe: Recipe, episode: Episode) -> pa.Table:
    """The rows of an episode."""
    values = columns_of(episode, recipe)
    columns = [_to_arrow(c, values[c.name], episode.length + 1) for c in recipe.columns]
    return pa.Table.from_arrays(columns, schema=_schema(recipe))


def _lengths_text(lengths: Sequence[int]) -> str:
    """The steps of episodes as JSON: [[steps, episodes that follow each other], ...]."""
    runs = [[steps, sum(1 for _ in same)] for steps, same in itertools.groupby(lengths)]
    return json.dumps(runs, separators=(",", ":"))


def _lengths(text: bytes, episodes: int) -> list[int]:
    """The steps of so many episodes; raises ValueError if it is no such text."""
    try:
        runs = entry_of(tuple[tuple[int, int], ...], json.loads(text))
    except (RecursionError, ValueError) as error:
        raise ValueError(f"its lengths are damaged: {error}") from error
    if not all(number for run in runs for number in run):
        raise ValueError("its lengths are no positive numbers")
    if sum(count for _, count in runs) != episodes:
        raise ValueError(f"its lengths are not those of {episodes} episodes")
    return [steps for steps, count in runs for _ in range(count)]


def _starts(counts: Iterable[int]) -> list[int]:
    """The number of rows before each of some parts of a file, and of all rows."""
    return [0, *itertools.accumulate(counts)]


def _schema(recipe: Recipe) -> pa.Schema:
    form = recipe.format
    return pa.schema(
        [
            pa.field(c.name, _type(c, form), nullable=c.is_of_step and form > 1)
            for c in recipe.columns
        ]
    )


def _type(column: Column, form: int = FORMAT) -> pa.DataType:
    """The type of a column in files of a format."""
    if column.dtype == "str":  # some versions of pyarrow read each index as one of 32 bits
        return pa.dictionary(pa.int8() if form == 1 else pa.int32(), pa.string())
    number = pa.from_numpy_dtype(np.dtype(column.dtype))
    element = pa.field("element", number, nullable=False)
    is_of_any_size = column.name.startswith(FIELD) or column.size == 0  # pyarrow divides by sizes
    if is_of_any_size or (column.shape and column.is_of_step and form > 1):
        return pa.list_(element)
    return pa.list_(element, column.size) if column.shape else number


def _leaf(column: Column) -> str:
    """The path of a column's numbers in the file."""
    is_list = column.shape or column.name.startswith(FIELD)
    return f"{column.name}.list.element" if is_list else column.name


def _to_arrow(column: Column, values: Values, rows: int) -> pa.Array:
    """A column's values of an episode of so many rows, as an array of pyarrow."""
    if isinstance(values, str):
        return pa.DictionaryArray.from_arrays(_array(np.zeros(rows, np.int32)), _text(values))
    kind = _type(column)
    numbers = _array(np.ascontiguousarray(values).reshape(-1))
    if column.name.startswith(FIELD):
        ends = np.full(rows + 1, len(numbers), np.int32)
        ends[0] = 0
        return pa.ListArray.from_arrays(_array(ends), numbers, type=kind)
    if not column.is_of_step and column.size:  # as in `_type`
        return pa.FixedSizeListArray.from_arrays(numbers, type=kind) if column.shape else numbers
    if not column.shape:
        return pa.concat_arrays([numbers, pa.nulls(1, kind)])
    ends = np.minimum(np.arange(rows + 1, dtype=np.int32) * column.size, len(numbers))
    mask = _array(np.arange(rows) == rows - 1) if column.is_of_step else None
    return pa.ListArray.from_arrays(_array(ends.astype(np.int32)), numbers, type=kind, mask=mask)


def _array(numbers: np.ndarray) -> pa.Array:
    """Numbers, (n,), as an array of pyarrow.

    `pyarrow.array` and `to_numpy` import pandas where it is installed, which takes 0.2 s.
    """
    is_bits = numbers.dtype == bool
    memory = np.packbits(numbers, bitorder="little") if is_bits else numbers
    kind = pa.from_numpy_dtype(numbers.dtype)
    return pa.Array.from_buffers(kind, len(numbers), [None, pa.py_buffer(memory)])


def _text(text: str) -> pa.Array:
    """An array of one text."""
    memory = text.encode()
    ends = np.array([0, len(memory)], np.int32)
    return pa.Array.from_buffers(pa.string(), 1, [None, pa.py_buffer(ends), pa.py_buffer(memory)])


def _numbers(array: pa.Array) -> np.ndarray:
    """The numbers of an array without nulls, in its own memory if they are no bits; read-only."""
    dtype = np.dtype(array.type.to_pandas_dtype())
    if not len(array):
        return np.empty(0, dtype)
    memory = memoryview(array.buffers()[1]).toreadonly()
    if dtype.kind != "b":
        return np.frombuffer(memory, dtype, len(array), array.offset * dtype.itemsize)
    bits = np.frombuffer(memory, np.uint8)
    end = array.offset + len(array)
    return np.unpackbits(bits, count=end, bitorder="little")[array.offset :].view(bool)


def _from_arrow(column: Column, found: pa.ChunkedArray, form: int) -> Values:
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
    if column.is_of_step:
        array = array[:-1] if form == 1 else _of_steps(column, array)
    rows = len(array)
    if column.name.startswith(FIELD):
        if len(array[0]) != column.size or len(array.flatten()) != column.size:
            raise ValueError(f"the column {column.name!r} has no {column.size} numbers in a row")
        return _numbers(array.flatten()).reshape(column.shape)
    numbers = array.flatten() if column.shape else array
    return _numbers(numbers).reshape(rows, *column.shape)


def _of_steps(column: Column, array: pa.Array) -> pa.Array:
    """The values of the steps, without the last row, which has none."""
    if array.null_count != 1 or array[-1].is_valid:
        raise ValueError(f"the column {column.name!r} is null elsewhere than in the last row")
    array = array[:-1]
    if column.shape and (_numbers(array.value_lengths()) != column.size).any():
        raise ValueError(f"the column {column.name!r} has no {column.size} numbers in a row")
    return array


@contextlib.contextmanager
def _damage_reported(path: Place) -> Iterator[None]:
    """Turns the errors of a damaged file, of which there are many kinds, into DamagedError."""
    try:
        yield
    except OSError as error:
        if error.errno is not None:  # of the system; pyarrow's own have no number
            raise
        raise _damaged(path, error) from error
    except (pa.ArrowException, MemoryError, OverflowError, ValueError) as error:
        raise _damaged(path, error) from error


def _damaged(path: Place, reason: object) -> DamagedError:
    return DamagedError(f"{path} is damaged or no file of a dataset ({reason}); {REPAIR}")
