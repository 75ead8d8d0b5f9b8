"""`Recipe`: everything that the bytes of a dataset depend on, except for the seeds.

    recipe = recipe_of({"domain": "humanoid", ...}, environment, Kept(states=True))
    text = recipe.text(range(64))           # JSON, for the footer of a file
    recipe, seeds = Recipe.parse(text)

A recipe holds no path, host, date or number of workers, so that equal episodes give equal files
wherever they are collected. A text to parse may come from anyone, and is checked.
"""

import dataclasses
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from dm_env import specs

from limberjack import policies, report, suite
from limberjack.episodes.episode import Kept
from limberjack.report import Facts
from limberjack.rl.control import Environment
from limberjack.rl.observations import FLAT_OBSERVATION_KEY
from limberjack.utils.seeds import SEEDS
from limberjack.workers.identity import first_difference

__all__ = [
    "FIELD",
    "OBSERVATION",
    "SHARD",
    "Column",
    "Recipe",
    "columns_here",
    "environment_of",
    "other_versions",
    "recipe_of",
]

SHARD = 64  # episodes of a file: the rows of a batch
OBSERVATION, FIELD = "observation/", "field/"  # prefixes of columns

_FORMAT = 1
_DTYPES = ("bool", "uint8", "int32", "int64", "float32", "float64")
_LARGEST = 2**28  # numbers in a row; beyond it a forged file would only exhaust the memory
_LONGEST = 1e9  # seconds of an episode
_MOST_STEPS = 2**31  # of an episode
# Bytes of a file besides its numbers: about 100 for each column of an episode, in its page and in
# the footer, and up to 6,000 for the schema and the recipe.
_COLUMN_NBYTES, _FILE_NBYTES = 256, 16_384
_FACTS: dict[str, type | tuple[type, ...]] = {
    "domain": str,
    "task": str,
    "policy": str,
    "policy_sha256": (str, type(None)),
    "time_limit": (int, float),
    "control_timestep": (int, float),
    "action_repeat": int,
    "versions": dict,
    "fingerprint": str,
}
# Columns of every dataset, and those that some have, with their types.
_ALWAYS = {
    "seed": "int64",
    "action": "float64",
    "reward": "float64",
    "terminated": "bool",
    "truncated": "bool",
    "diverged": "bool",
}
_SOMETIMES = {"start": "str", "success": "bool", "state": "float64"}


@dataclasses.dataclass(frozen=True)
class Column:
    """A column of the files: numbers of some type, in an array per row."""

    name: str
    dtype: str
    shape: tuple[int, ...] = ()

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
      facts: `domain`, `task`, `policy`, `policy_sha256`, `time_limit` and `control_timestep` in
        seconds, `action_repeat`, `versions` (pyarrow's too) and `fingerprint`.
      kept: what is kept of each step.
      columns: of the files, in order.
    """

    facts: Facts
    kept: Kept
    columns: tuple[Column, ...]

    def text(self, seeds: range) -> str:
        """The recipe of the episodes with these seeds, as JSON; equal recipes give equal texts."""
        content = {
            "format": _FORMAT,
            **self.facts,
            **dataclasses.asdict(self.kept),
            "columns": [dataclasses.astuple(column) for column in self.columns],
            "seeds": [seeds.start, seeds.stop],
        }
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
        if not isinstance(content, dict) or content.pop("format", None) != _FORMAT:
            raise ValueError(f"its recipe is not of format {_FORMAT}")
        try:
            seeds = _seeds(content.pop("seeds"))
            columns = tuple(_column(entry) for entry in content.pop("columns"))
            kept = Kept(**{f.name: _flag(content.pop(f.name)) for f in dataclasses.fields(Kept)})
        except (KeyError, TypeError) as error:
            raise ValueError(f"its recipe is damaged: {error}") from error
        _check_columns(columns, kept)
        return cls(_checked_facts(content), kept, columns), seeds

    def difference(self, other: "Recipe") -> str | None:
        """The first entry that differs, as 'policy is 'zero' and 'random''; None if none does.

        Versions are compared one by one: 'versions.mujoco is '4.0.0' and '4.1.0''.
        """
        ours, theirs = (
            {**r.facts, **dataclasses.asdict(r.kept), "columns": r.columns} for r in (self, other)
        )
        difference = first_difference(ours, theirs)
        if difference is None:
            return None
        name, one, another = difference
        return f"{name} is {one!r} and {another!r}"

    @property
    def step_limit(self) -> int:
        """Steps of the longest episode."""
        return round(self.facts["time_limit"] / self.facts["control_timestep"])

    @property
    def episode_nbytes(self) -> int:
        """Bytes of the longest episode before compression."""
        once = sum(c.nbytes for c in self.columns if c.name.startswith(FIELD))
        row = sum(column.nbytes for column in self.columns) - once
        return once + row * (self.step_limit + 1)

    def most_nbytes(self, episodes: int, files: int) -> int:
        """Bytes that files with so many of the longest episodes do not exceed."""
        per_episode = self.episode_nbytes + _COLUMN_NBYTES * len(self.columns)
        return per_episode * episodes + _FILE_NBYTES * files


def recipe_of(facts: Facts, environment: Environment, kept: Kept) -> Recipe:
    """The recipe of an environment's episodes.

    Args:
      facts: those that `Recipe` lists. Of a policy in a file, only the file's name is kept.
      environment: the task's, with a time limit.
      kept: what is kept of each step.
    """
    policy = facts["policy"]
    if policies.is_saved_model(policy):
        prefix, _, path = policy.partition(":")
        policy = f"{prefix}:{Path(path).name}"
    return Recipe({**facts, "policy": policy}, kept, columns_here(environment, kept))


def columns_here(environment: Environment, kept: Kept) -> tuple[Column, ...]:
    """The columns of an environment's episodes."""
    task = environment.task
    columns = [Column("seed", "int64")]
    if getattr(task, "STARTS", ()):
        columns.append(Column("start", "str"))
    columns += _observed(environment, kept)
    columns.append(Column("action", "float64", tuple(environment.action_spec().shape)))
    columns += [Column(name, _ALWAYS[name]) for name in ("reward", "terminated", "truncated")]
    if getattr(task, "GOAL", ()):
        columns.append(Column("success", "bool"))
    columns.append(Column("diverged", "bool"))
    saved = environment.snapshot().physics  # arrays of one row
    if kept.states:
        columns.append(Column("state", "float64", saved["state"].shape[1:]))
    for name in environment._saved_fields():
        columns.append(Column(FIELD + name, saved[name].dtype.name, saved[name].shape[1:]))
    return tuple(columns)


def environment_of(recipe: Recipe) -> Environment:
    """An environment of a recipe's task, with episodes of its length.

    Raises:
      ValueError: there is no such task here, or its observations or actions are of another form.
    """
    facts = recipe.facts
    # Half a step less, so that rounding does not add one.
    seconds = (recipe.step_limit - 0.5) * facts["control_timestep"]
    kwargs = {"random": 0, "time_limit": seconds}
    environment = suite.load(facts["domain"], facts["task"], task_kwargs=kwargs)
    found = dataclasses.replace(recipe, columns=columns_here(environment, recipe.kept))
    difference = recipe.difference(found)
    if environment.control_timestep() != facts["control_timestep"]:
        difference = f"control_timestep is {facts['control_timestep']} and here"
        difference += f" {environment.control_timestep()}"
    if difference is not None:
        environment.close()
        raise ValueError(
            f"{facts['domain']} {facts['task']} has other episodes here than in the dataset, "
            f"whose {difference}.{other_versions(recipe, None)}"
        )
    return environment


def other_versions(recipe: Recipe, environment: Environment | None) -> str:
    """A sentence on versions, and a model, that differ from the recorded ones; empty if none do."""
    recorded, here = recipe.facts["versions"], report.versions()
    other = [f"{n} {recorded.get(n)}, here {v}" for n, v in here.items() if recorded.get(n) != v]
    if environment is not None:
        model = environment.physics.model._model
        if report.fingerprint(model) != recipe.facts["fingerprint"]:
            other.append("a model with another fingerprint")
    return f" It was collected with {'; '.join(other)}." if other else ""


def _observed(environment: Environment, kept: Kept) -> list[Column]:
    """The columns of the observations."""
    spec: Mapping[str, specs.Array] = environment.observation_spec()
    of_names = {name: (np.dtype(one.dtype), tuple(one.shape)) for name, one in spec.items()}
    if kept.flat:
        dtype = np.result_type(*(dtype for dtype, _ in of_names.values()))
        size = sum(math.prod(shape) for _, shape in of_names.values())
        of_names = {FLAT_OBSERVATION_KEY: (dtype, (size,))}
    return [
        Column(OBSERVATION + name, kept.observed_type(dtype).name, shape)
        for name, (dtype, shape) in of_names.items()
    ]


def _seeds(entry: object) -> range:
    if not (isinstance(entry, list) and len(entry) == 2 and all(map(_is_whole, entry))):
        raise ValueError(f"its seeds are {entry!r}; expected the first and the one after the last")
    first, end = entry
    if not 0 <= first < end <= SEEDS or first // SHARD != (end - 1) // SHARD:
        raise ValueError(f"its seeds are {first} to {end}; expected some within one block of 64")
    return range(first, end)


def _column(entry: object) -> Column:
    if not (isinstance(entry, list) and len(entry) == 3 and isinstance(entry[2], list)):
        raise ValueError(f"a column is {entry!r}; expected a name, a type and a shape")
    name, dtype, shape = entry
    if not isinstance(name, str) or dtype not in (*_DTYPES, "str"):
        raise ValueError(f"the column {name!r} has type {dtype!r}; expected one of {_DTYPES}")
    if not all(_is_whole(size) and size >= 0 for size in shape) or math.prod(shape) > _LARGEST:
        raise ValueError(f"the column {name!r} has shape {shape!r}")
    return Column(name, dtype, tuple(shape))


def _check_columns(columns: Sequence[Column], kept: Kept) -> None:
    """Raises ValueError unless these are columns that `recipe_of` gives."""
    found = {column.name: column for column in columns}
    if len(found) < len(columns):
        raise ValueError("a column occurs twice")
    for name in _ALWAYS:
        if name not in found:
            raise ValueError(f"the column {name!r} is missing")
    for name, column in found.items():
        dtype = {**_ALWAYS, **_SOMETIMES}.get(name)
        is_array = name in ("action", "state") or name.startswith((OBSERVATION, FIELD))
        if dtype is None and not is_array:
            raise ValueError(f"the column {name!r} is unknown")
        if column.dtype != (dtype or column.dtype) or (dtype is None and column.dtype == "str"):
            raise ValueError(f"the column {name!r} has type {column.dtype!r}")
        if column.shape and not is_array:
            raise ValueError(f"the column {name!r} has shape {column.shape}; expected one number")
    if ("state" in found) != kept.states:
        raise ValueError("the column 'state' is there exactly if states were recorded")


def _checked_facts(content: Facts) -> Facts:
    """The facts; raises ValueError if one is missing, unknown or of another kind."""
    if content.keys() != _FACTS.keys():
        raise ValueError(f"its facts are {sorted(content)}; expected {sorted(_FACTS)}")
    for name, kind in _FACTS.items():
        if not isinstance(content[name], kind) or isinstance(content[name], bool):
            raise ValueError(f"its {name} is {content[name]!r}")
    if not all(isinstance(value, str) for value in content["versions"].values()):
        raise ValueError(f"its versions are {content['versions']!r}")
    limit, timestep = content["time_limit"], content["control_timestep"]
    if not (0 < timestep <= limit < _LONGEST and limit / timestep < _MOST_STEPS):
        raise ValueError(f"its time_limit is {limit} and its control_timestep {timestep} seconds")
    return content


def _flag(value: object) -> bool:
    if not isinstance(value, bool):
        raise TypeError(f"{value!r} is neither true nor false")
    return value


def _is_whole(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)
