"""`Recipe`: everything that the bytes of a dataset depend on, except for the seeds.

    recipe = recipe_of({"domain": "humanoid", ...}, environment, Kept(states=True))
    text = recipe.text(range(64))           # JSON, for the footer of a file
    recipe, seeds = Recipe.parse(text)
    recipe.block                            # 140: a file has the seeds of [0, 140), [140, 280), ...

A recipe holds no path, host, date or number of workers, so that equal episodes give equal files
wherever they are collected. A text to parse may come from anyone, and is checked. Recipes of
format 1, an earlier version's, are read and not written.
"""

import dataclasses
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, cast

import dm_env
import numpy as np
from dm_env import specs

from limberjack import policies, registry
from limberjack.episodes.environments import inside
from limberjack.episodes.episode import Kept
from limberjack.mujoco.fingerprint import fingerprint, versions
from limberjack.policies.entries import entry_of
from limberjack.rl.action_specs import spec_of
from limberjack.rl.control import shown_by
from limberjack.rl.observations import FLAT_OBSERVATION_KEY
from limberjack.rl.pixels import PIXELS_KEY, Pixels
from limberjack.rl.reward_terms import has_goal
from limberjack.rl.row_step import as_mapping
from limberjack.utils.facts import Facts
from limberjack.utils.seeds import SEEDS
from limberjack.workers.factories import Factory, Make, factory_of
from limberjack.workers.identity import first_difference
from limberjack.worlds import OPTIONS

__all__ = [
    "FIELD",
    "FILE_MB",
    "FORMAT",
    "GROUP_NBYTES",
    "MOST_NBYTES",
    "OBSERVATION",
    "PIXELS",
    "Column",
    "Recipe",
    "environments_of",
    "other_versions",
    "recipe_of",
    "seeds_of",
]

FORMAT = 2  # of new datasets
_UNIT, _UNIT_NBYTES = 64, 2**28  # episodes that are played together: rows of a batch; their bytes
FILE_MB = 100.0  # megabytes of a file before compression
# Bytes before compression from which a row group is complete. It takes 1,500 in the footer with 15
# columns, so that a footer is about 1 % of a file; and reading one episode reads its row group.
GROUP_NBYTES = 2**18
MOST_NBYTES = 2**30  # of a row group; an hour of a humanoid's steps with states takes a third of it
OBSERVATION, FIELD = "observation/", "field/"  # prefixes of columns
PIXELS = OBSERVATION + PIXELS_KEY  # column of pictures

_BLOCK_1 = 64  # seeds of a file of format 1
_MOST_EPISODES = 2**15 - 1  # of a file: the Parquet format numbers row groups in 16 bits
_DTYPES = ("bool", "uint8", "int32", "int64", "float32", "float64")
_LARGEST = 2**28  # numbers in a row; beyond it a forged file would only exhaust the memory
_LONGEST = 1e9  # seconds of an episode
_MOST_MB = 1e6  # of a file: a terabyte
_MOST_STEPS = 2**31  # of an episode
# Bytes of a file besides its numbers: about 100 for each column of a row group, in its page and in
# the footer, and up to 6,000 for the schema and the recipe.
_COLUMN_NBYTES, _FILE_NBYTES = 256, 16_384
_DIGITS = 32  # bytes of a number in the text of a footer
# Facts that name the environments: a task's, or those of a function of the user's.
_WHERE = (
    {"domain": str, "task": str},
    {"environment": str, "environment_sha256": str},
)
_FACTS = {
    "policy": str,
    "policy_sha256": str | None,
    "time_limit": float,
    "control_timestep": float,
    "action_repeat": int,
    "versions": Mapping[str, str],
    "fingerprint": str,
}
_OPTIONAL_FACTS = {"world": Mapping[str, object], "domain_sha256": str}
# Columns of every dataset, those that format 1 lacks, and those that some have, with their types.
_BOTH = {
    "seed": "int64",
    "action": "float64",
    "reward": "float64",
    "terminated": "bool",
    "truncated": "bool",
    "diverged": "bool",
}
_PLACE = {"step": "int64", "time": "float64", "is_first": "bool", "is_last": "bool"}
_SOMETIMES = {"start": "str", "success": "bool", "state": "float64"}
_OF_STEPS = ("action", "reward", "terminated", "truncated", "success", "diverged")


@dataclasses.dataclass(frozen=True)
class Column:
    """A column of the files: numbers of some type, in an array per row."""

    name: str
    dtype: str
    shape: tuple[int, ...] = ()

    @property
    def is_of_step(self) -> bool:
        """Whether a value belongs to a step: the row of the last observation has none."""
        return self.name in _OF_STEPS

    @property
    def has_figures(self) -> bool:
        """Whether a file has statistics of the column."""
        is_number = self.name.startswith(OBSERVATION) and self.name != PIXELS
        return self.name in ("action", "reward") or is_number

    @property
    def size(self) -> int:
        """Numbers in a row."""
        return math.prod(self.shape)

    @property
    def nbytes(self) -> int:
        """Bytes of a row before compression; texts take next to nothing."""
        return 0 if self.dtype == "str" else self.size * np.dtype(self.dtype).itemsize


@dataclasses.dataclass(frozen=True)
class Recipe:
    """The task, the policy, what is kept of a step, and the versions.

    Attributes:
      facts: `domain` and `task`, with `domain_sha256` if the domain is not the suite's; or
        `environment` and `environment_sha256`. Then `policy`, `policy_sha256`, `time_limit` and
        `control_timestep` in seconds, `action_repeat`, `versions` (pyarrow's too) and
        `fingerprint`; and `world` if that is not the suite's.
      kept: what is kept of each step.
      columns: of the files, in order.
      file_mb: megabytes of a file before compression; None for format 1.
    """

    facts: Facts
    kept: Kept
    columns: tuple[Column, ...]
    file_mb: float | None = FILE_MB

    @property
    def format(self) -> int:
        """The number of the files' format."""
        return 1 if self.file_mb is None else FORMAT

    @property
    def block(self) -> int:
        """The number of seeds, aligned at its multiples, whose episodes share a file."""
        if self.file_mb is None:
            return _BLOCK_1
        return max(1, min(int(self.file_mb * 1e6 // self._most_each), _MOST_EPISODES))

    def as_json(self) -> dict[str, object]:
        """The recipe as values of JSON."""
        sized = {} if self.file_mb is None else {"file_mb": self.file_mb}
        return {
            "format": self.format,
            **self.facts,
            **self.kept.as_json(),
            **sized,
            "columns": [[c.name, c.dtype, list(c.shape)] for c in self.columns],
        }

    def text(self, seeds: range) -> str:
        """The recipe of the episodes with these seeds, as JSON; equal recipes give equal texts."""
        content = {**self.as_json(), "seeds": [seeds.start, seeds.stop]}
        return json.dumps(content, sort_keys=True, separators=(",", ":"))

    @classmethod
    def parse(cls, text: str | bytes) -> "tuple[Recipe, range]":
        """The recipe in a footer, and the seeds of its file.

        Raises:
          ValueError: it is no such text.
        """
        try:
            content = json.loads(text)
        except RecursionError as error:
            raise ValueError("its recipe is nested too deeply") from error
        entry = content.pop("seeds", None) if isinstance(content, dict) else None
        recipe = cls.of_json(content)
        return recipe, _seeds(entry, recipe.block)

    @classmethod
    def of_json(cls, content: object) -> "Recipe":
        """The recipe that `as_json` gave.

        Raises:
          ValueError: it is none.
        """
        found = content.get("format") if isinstance(content, dict) else None
        if not isinstance(content, dict) or type(found) is not int or found not in (1, FORMAT):
            raise ValueError(f"its recipe is not of format {FORMAT} or 1")
        rest = {name: value for name, value in content.items() if name != "format"}
        try:
            file_mb = None if found == 1 else _file_mb(rest.pop("file_mb"))
            columns = tuple(_column(entry) for entry in rest.pop("columns"))
            names = "states", "float32", "flat"
            flags = {name: entry_of(bool, rest.pop(name), name) for name in names}
            kept = Kept(**flags, pixels=_pixels(rest.pop("pixels", None)))
        except (KeyError, TypeError, ValueError) as error:
            raise ValueError(f"its recipe is damaged: {error}") from error
        _check_columns(columns, kept, _BOTH if file_mb is None else {**_BOTH, **_PLACE})
        return cls(_checked_facts(rest), kept, columns, file_mb)

    def difference(self, other: "Recipe") -> str | None:
        """The first entry that differs, as 'policy is 'zero' and 'random''; None if none does.

        Versions are compared one by one: 'versions.mujoco is '4.0.0' and '4.1.0''.
        """
        difference = first_difference(self.as_json(), other.as_json())
        if difference is None:
            return None
        name, one, another = difference
        return f"{name} is {one!r} and {another!r}"

    def here(self, environment: dm_env.Environment) -> "Recipe":
        """The recipe with the columns of an environment's episodes."""
        columns = _columns(environment, self.kept)
        if self.file_mb is None:
            columns = tuple(column for column in columns if column.name not in _PLACE)
        return dataclasses.replace(self, columns=columns)

    @property
    def step_limit(self) -> int:
        """Steps of the longest episode."""
        seconds = self.facts["time_limit"]
        assert seconds is not None  # see `_checked_facts`
        return round(seconds / self.facts["control_timestep"])

    @property
    def row_nbytes(self) -> int:
        """Bytes of a row before compression, if each row has the model fields."""
        return sum(column.nbytes for column in self.columns)

    @property
    def episode_nbytes(self) -> int:
        """Bytes of the longest episode before compression."""
        once = sum(c.nbytes for c in self.columns if c.name.startswith(FIELD))
        return once + (self.row_nbytes - once) * (self.step_limit + 1)

    @property
    def unit(self) -> int:
        """The number of episodes that are played together: fewer if they have pictures."""
        return max(1, min(_UNIT, _UNIT_NBYTES // self.episode_nbytes))

    def most_nbytes(self, episodes: int, files: int) -> int:
        """Upper bound of the bytes of files with this number of episodes of full length."""
        numbers = sum(column.size for column in self.columns if column.has_figures)
        # Four figures of each number, and a row group that is not complete.
        per_file = _FILE_NBYTES + 4 * numbers * _DIGITS + _COLUMN_NBYTES * len(self.columns)
        return int(self._most_each * episodes) + per_file * files

    @property
    def _most_each(self) -> float:
        """Bytes that an episode takes at most: its numbers, its part of the pages, its return."""
        groups = min(1.0, self.episode_nbytes / GROUP_NBYTES)
        return self.episode_nbytes + groups * _COLUMN_NBYTES * len(self.columns) + _DIGITS


def recipe_of(
    facts: Facts, environment: dm_env.Environment, kept: Kept, file_mb: float = FILE_MB
) -> Recipe:
    """The recipe of an environment's episodes.

    Args:
      facts: those that `Recipe` lists. Of a policy in a file, only the file's name is kept.
      environment: the task's, with a time limit.
      kept: what is kept of each step.
      file_mb: megabytes of a file before compression.

    Raises:
      ValueError, TypeError: `file_mb` is not a positive number, or the longest episode would be
        larger than any reader accepts.
    """
    # Without an entry for the suite's own world, as before there were others.
    present = {name: fact for name, fact in facts.items() if name != "world" or fact is not None}
    policy = facts["policy"]
    if policies.is_saved_model(policy):
        prefix, _, path = policy.partition(":")
        policy = f"{prefix}:{Path(path).name}"
    columns = _columns(environment, kept)
    named = cast(Facts, {**present, "policy": policy})
    recipe = Recipe(named, kept, columns, _file_mb(file_mb))
    _check_size(recipe)
    return recipe


def _check_size(recipe: Recipe) -> None:
    """Raises ValueError if a row group that ends with the longest episode is too large."""
    steps, row, most = recipe.step_limit, recipe.row_nbytes, MOST_NBYTES - GROUP_NBYTES
    size = (steps + 1) * row
    if size <= most:
        return
    seconds = (most // row - 1) * recipe.facts["control_timestep"]
    pictures = [column for column in recipe.columns if column.name == PIXELS]
    shown = "".join(
        f", {column.nbytes:,} of them for pictures of {' by '.join(map(str, column.shape[:2]))}"
        for column in pictures
    )
    raise ValueError(
        f"an episode of {steps:,} steps may take {size / 1e9:.3g} GB, {row:,} bytes a row{shown}; "
        f"expected at most {most / 1e9:.3g} GB: give a time_limit of at most {seconds:g} s, "
        f"{'smaller pictures, ' if pictures else ''}or keep less of each step"
    )


def environments_of(recipe: Recipe, make: Make | None = None) -> tuple[dm_env.Environment, Factory]:
    """An environment whose episodes are those of a recipe, and the factory that made it.

    Args:
      recipe: of the episodes.
      make: the function that made the environments, if they are not the suite's.

    Raises:
      ValueError: there is no such task here, `make` is missing or another function, or observations
        or actions are of another form.
    """
    facts = recipe.facts
    factory = _factory(recipe, make)
    environment = factory.make(0)
    difference = recipe.difference(recipe.here(environment))
    world = shown_by(inside(environment), "world")
    if world != facts.get("world"):
        difference = f"world is {facts.get('world')} and here {world}"
    timestep = inside(environment).control_timestep()
    if timestep != facts["control_timestep"]:
        difference = f"control_timestep is {facts['control_timestep']} and here {timestep}"
    if difference is not None:
        environment.close()
        raise ValueError(
            f"{factory.title} has other episodes here than in the dataset, whose {difference}."
            f"{other_versions(recipe, None)}"
        )
    return environment, factory


def _factory(recipe: Recipe, make: Make | None) -> Factory:
    """The factory of a recipe's environments; raises ValueError if `make` is not the right one."""
    facts = recipe.facts
    if make is None:
        if "domain" not in facts:
            raise ValueError(
                f"the episodes are those of environments that {facts['environment']} makes: give "
                f"that function (--env {facts['environment']})"
            )
        # Half a step less, so that rounding does not add one.
        seconds = (recipe.step_limit - 0.5) * facts["control_timestep"]
        try:
            return factory_of(facts["domain"], facts["task"], seconds, facts.get("world"))
        except ValueError as error:
            if "domain_sha256" not in facts or facts["domain"] in registry.domains():
                raise
            raise ValueError(
                f"the episodes are those of {facts['domain']!r}, which is no domain of the suite: "
                "import the module that registers it (limberjack --import MODULE)"
            ) from error
    factory = factory_of(make)
    for name, value in factory.facts.items():
        if facts.get(name) != value:
            raise ValueError(
                f"{factory.title} is not the function that made the episodes' environments: their "
                f"{name} is {facts.get(name)!r}, and its is {value!r}"
            )
    return factory


def other_versions(recipe: Recipe, environment: dm_env.Environment | None) -> str:
    """A sentence on versions, and a model, that differ from the recorded ones; empty if none do."""
    recorded, here = recipe.facts["versions"], versions()
    other = [f"{n} {recorded.get(n)}, here {v}" for n, v in here.items() if recorded.get(n) != v]
    if environment is not None:
        model = inside(environment).physics.model._official
        if fingerprint(model) != recipe.facts["fingerprint"]:
            other.append("a model with another fingerprint")
    return f" It was collected with {'; '.join(other)}." if other else ""


def _columns(environment: dm_env.Environment, kept: Kept) -> tuple[Column, ...]:
    """The columns of an environment's episodes, in files of format 2."""
    inner = inside(environment)
    task = inner.task
    columns = [Column("seed", "int64"), *(Column(name, dtype) for name, dtype in _PLACE.items())]
    if getattr(task, "STARTS", ()):
        columns.append(Column("start", "str"))
    columns += _observed(environment, kept)
    columns.append(Column("action", "float64", tuple(spec_of(environment).shape)))
    columns += [Column(name, _BOTH[name]) for name in ("reward", "terminated", "truncated")]
    if has_goal(task) and hasattr(environment, "success"):  # not in all wrappers
        columns.append(Column("success", "bool"))
    columns.append(Column("diverged", "bool"))
    names = inner._saved_fields()
    saved = inner.physics.simulation.save(None, names)  # arrays of one row
    if kept.states:
        columns.append(Column("state", "float64", saved["state"].shape[1:]))
    for name in names:
        columns.append(Column(FIELD + name, saved[name].dtype.name, saved[name].shape[1:]))
    return tuple(columns)


def _observed(environment: dm_env.Environment, kept: Kept) -> list[Column]:
    """The columns of the observations."""
    spec = cast(Mapping[str, specs.Array], as_mapping(environment.observation_spec()))
    of_names = {name: (np.dtype(one.dtype), tuple(one.shape)) for name, one in spec.items()}
    if kept.flat:
        if not of_names:
            raise ValueError("the task observes nothing that could be joined: leave out flat")
        dtype = np.result_type(*(dtype for dtype, _ in of_names.values()))
        size = sum(math.prod(shape) for _, shape in of_names.values())
        of_names = {FLAT_OBSERVATION_KEY: (dtype, (size,))}
    columns = [
        Column(OBSERVATION + name, kept.observed_type(dtype).name, shape)
        for name, (dtype, shape) in of_names.items()
    ]
    for column in columns:
        if column.dtype not in _DTYPES:
            raise ValueError(
                f"{column.name} has type {column.dtype}, which datasets do not keep; expected one "
                f"of {', '.join(_DTYPES)}: let the task return it as one of these"
            )
    if kept.pixels is None:
        return columns
    if PIXELS_KEY in spec:
        raise ValueError("pictures are among the observations already: leave out pixels")
    shape, dtype = inside(environment).physics.picture_spec(**kept.pixels.render_kwargs)
    return [*columns, Column(PIXELS, dtype.name, shape)]


def seeds_of(entry: object) -> range:
    """The seeds that a list [first, end] of JSON stands for.

    Raises:
      ValueError: it is no such list.
    """
    first, end = entry_of(tuple[int, int], entry, "its range of seeds")
    if not first < end <= SEEDS:
        raise ValueError(f"its seeds are {first} to {end}; expected increasing ones")
    return range(first, end)


def _seeds(entry: object, block: int) -> range:
    seeds = seeds_of(entry)
    if seeds[0] // block != seeds[-1] // block:
        raise ValueError(
            f"its seeds are {seeds.start} to {seeds.stop}; expected some within one block of "
            f"{block}"
        )
    return seeds


def _file_mb(value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise TypeError(f"file_mb is {value!r}; expected a number of megabytes")
    if not 0 < value <= _MOST_MB:
        raise ValueError(f"file_mb is {value}; expected a positive number of megabytes")
    return float(value)


def _column(entry: object) -> Column:
    column = Column(*entry_of(tuple[str, str, tuple[int, ...]], entry, "a column"))
    if column.dtype not in (*_DTYPES, "str") or column.size > _LARGEST:
        raise ValueError(f"a column is {entry}; expected one of {_DTYPES}, and a shape")
    return column


def _check_columns(columns: Sequence[Column], kept: Kept, always: Mapping[str, str]) -> None:
    """Raises ValueError unless these are columns that `recipe_of` gives, some of them always."""
    found = {column.name: column for column in columns}
    needed = {*always, *["state"] * kept.states, *[PIXELS] * (kept.pixels is not None)}
    wrong = [c.name for c in columns if not _is_known(c, kept, {**always, **_SOMETIMES})]
    wrong += sorted(needed - found.keys())
    if wrong or len(found) < len(columns) or ("state" in found and not kept.states):
        raise ValueError(f"its columns {wrong or list(found)} are missing, twice or of other forms")


def _is_known(column: Column, kept: Kept, types: Mapping[str, str]) -> bool:
    """Whether a column of this form may be in the files."""
    name = column.name
    if name == PIXELS and kept.pixels is not None:
        return column == Column(PIXELS, "uint8", (kept.pixels.height, kept.pixels.width, 3))
    if name.startswith((OBSERVATION, FIELD)):
        return column.dtype != "str"
    return column.dtype == types.get(name) and (not column.shape or name in ("action", "state"))


# Any: values of JSON, whose kinds are compared here.
def _checked_facts(content: dict[str, Any]) -> Facts:
    """The facts; raises ValueError if one is missing, unknown or of another kind."""
    where = _WHERE[0] if "domain" in content else _WHERE[1]
    kinds: dict[str, object] = {**where, **_FACTS}
    kinds |= {name: kind for name, kind in _OPTIONAL_FACTS.items() if name in content}
    if content.keys() != kinds.keys():
        raise ValueError(f"its facts are {sorted(content)}; expected {sorted(kinds)}")
    for name, kind in kinds.items():
        entry_of(kind, content[name], f"its {name}")
    unknown = sorted(content.get("world", {}).keys() - OPTIONS)
    if unknown:
        raise ValueError(f"its world has {unknown}; expected some of {', '.join(sorted(OPTIONS))}")
    limit, timestep = content["time_limit"], content["control_timestep"]
    if not (0 < timestep <= limit < _LONGEST and limit / timestep < _MOST_STEPS):
        raise ValueError(f"its time_limit is {limit} and its control_timestep {timestep} seconds")
    return cast(Facts, content)


def _pixels(value: object) -> Pixels | None:
    if value is None:
        return None
    pixels = Pixels.of(entry_of(dict, value, "pixels"))
    sizes = entry_of(tuple[int, int], [pixels.height, pixels.width], "the size of its pictures")
    if not all(0 < size <= _LARGEST for size in sizes):
        raise ValueError(f"its pictures have {pixels.height} by {pixels.width} pixels")
    return pixels
