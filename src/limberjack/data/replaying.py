"""`replay`: the episodes of a dataset made again from their seeds and actions, and compared.

    difference = replay(load("data"))       # None if every bit is equal

Everything is compared: observations, rewards, ends, states, model fields and kinds of starts, as
they were kept, and the SHA-256 of the files with those in the manifest. Numbers are promised to be
equal for equal versions on one kind of processor.
"""

import contextlib
import dataclasses
import itertools
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from limberjack import report, suite
from limberjack.data.dataset import Dataset
from limberjack.data.episode import Episode
from limberjack.data.parquet import Values, columns_of
from limberjack.data.playing import Recorded, play
from limberjack.data.recipe import UNIT, Recipe
from limberjack.evaluation.runner import OnProgress
from limberjack.evaluation.starts import kind_of_start
from limberjack.rl.control import Environment

__all__ = ["environment_of", "other_versions", "replay"]


def replay(
    dataset: Dataset, num_threads: int | None = None, on_progress: OnProgress | None = None
) -> str | None:
    """The first difference from the recorded episodes, with file and seed; None if there is none.

    Args:
      dataset: of a domain that is known here.
      num_threads: number of threads that simulate; by default one per usable core.
      on_progress: called after each step of a batch, as by `evaluate`.

    Raises:
      ValueError: there is no such task, its episodes differ in form, or a file is damaged.
    """
    changed = dataset.changed_file()
    if changed is not None:
        return changed
    recipe = dataset.recipe
    facts = recipe.facts
    compared = 0  # episodes
    steps = 0  # of the running ones

    def on_steps(count: int) -> None:
        nonlocal steps
        steps += count
        if on_progress is not None:
            on_progress("replaying", compared, steps / recipe.step_limit)

    environment = environment_of(recipe)
    # The kind of a start may depend on more seconds than the episodes have.
    full_length = suite.load(facts["domain"], facts["task"], {"random": 0})
    with contextlib.closing(environment), contextlib.closing(full_length):
        for path, recorded in _units(dataset):
            seeds = [episode.seed for episode in recorded]
            actor = Recorded({episode.seed: episode.actions for episode in recorded})
            # Not up to the recipe's length, which anyone may have written: it could take days.
            most = max(episode.length for episode in recorded) + 1
            found = play(environment, actor, seeds, recipe.kept, num_threads, on_steps, most)
            for one, again in zip(recorded, found, strict=True):
                start = kind_of_start(full_length, one.seed)
                difference = _difference(one, dataclasses.replace(again, start=start), recipe)
                if difference is not None:
                    other = other_versions(recipe, environment)
                    return f"{path}, seed {one.seed}: {difference}.{other}"
            compared += len(recorded)
            steps = 0
    return None


def _units(dataset: Dataset) -> Iterator[tuple[Path, list[Episode]]]:
    """The episodes in lists of up to 64, as a batch has rows, each with the file that has them."""
    for number, shard in enumerate(dataset.shards):
        episodes = dataset.episodes_of(number)
        while unit := list(itertools.islice(episodes, UNIT)):
            yield shard.path, unit


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
    difference = recipe.difference(recipe.here(environment))
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


def _difference(recorded: Episode, found: Episode, recipe: Recipe) -> str | None:
    """The first column and step in which two episodes differ."""
    if recorded.length != found.length:
        has_ended = found.terminated[-1] or found.truncated[-1]
        now = str(found.length) if has_ended else "more"
        return f"the episode has {recorded.length} steps, and {now} now"
    ours, theirs = (columns_of(episode, recipe) for episode in (recorded, found))
    for name in ours:
        difference = _differing(name, ours[name], theirs[name])
        if difference is not None:
            return difference
    return None


def _differing(name: str, recorded: Values, found: Values) -> str | None:
    if isinstance(recorded, str) or isinstance(found, str):
        return None if recorded == found else f"{name} is {recorded!r}, and {found!r} now"
    same = _bits(recorded) == _bits(found)
    if same.all():
        return None
    row = int(np.flatnonzero(~same.reshape(len(same), -1).all(axis=-1))[0])
    gap = np.abs(recorded[row].astype(float) - found[row].astype(float)).max()
    return f"{name} of row {row} differs by up to {gap:.3g}"


def _bits(values: np.ndarray) -> np.ndarray:
    """The values as whole numbers with the same bits, so that NaN and the sign of zero count."""
    return np.ascontiguousarray(values).view(f"u{values.dtype.itemsize}")
