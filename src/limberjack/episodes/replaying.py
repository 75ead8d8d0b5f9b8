"""`replay`: the episodes of a dataset made again from their seeds and actions, and compared.

    difference = replay(load("data"))       # None if every bit is equal

Everything is compared: observations, rewards, ends, states, model fields and kinds of starts, as
they were kept; and before that, the files' SHA-256 with those in the manifest. Numbers are promised
to be equal for equal versions on one kind of processor.
"""

import contextlib
import dataclasses
import itertools
from collections.abc import Iterator

import numpy as np

from limberjack.episodes.dataset import Dataset
from limberjack.episodes.episode import Episode
from limberjack.episodes.parquet import Values, columns_of
from limberjack.episodes.places import Place
from limberjack.episodes.playing import Step, batch_for, play, recorded
from limberjack.episodes.recipe import Recipe, environments_of, other_versions
from limberjack.episodes.starts import Starts
from limberjack.workers import OnProgress
from limberjack.workers.factories import Make

__all__ = ["replay"]


def replay(
    dataset: Dataset,
    make: Make | None = None,
    *,
    num_threads: int | None = None,
    on_progress: OnProgress | None = None,
) -> str | None:
    """The first difference from the recorded episodes, with file and seed; None if there is none.

    Args:
      dataset: of a domain that is known here, or of environments that `make` makes.
      make: the function that made the environments, if they are not the suite's; the dataset has
        its name and hash for comparison only, and nothing is imported by a name found there.
      num_threads: number of threads that simulate; by default one per usable core.
      on_progress: called after each step of a batch, as by `evaluate`.

    Raises:
      ValueError: there is no such task, its episodes differ in form, `make` is missing or another
        function, or a file is damaged or has another SHA-256 than the manifest lists.
    """
    dataset.verify()
    recipe = dataset.recipe
    compared = 0  # episodes
    steps = 0  # of the running ones

    def on_step(step: Step) -> None:
        nonlocal steps
        steps += step.count
        if on_progress is not None and step.count:
            on_progress("replaying", compared, steps / recipe.step_limit)

    environment, factory = environments_of(recipe, make)
    build, starts = factory.build(environment), Starts.of(factory)
    with contextlib.closing(environment), contextlib.closing(starts):
        for path, kept in _units(dataset):
            seeds = [episode.seed for episode in kept]
            repeat = int(recipe.facts["action_repeat"])
            actor = recorded({one.seed: one.actions for one in kept}, repeat)
            # One step after the longest episode: a forged recipe could make it take days.
            most = max(episode.length for episode in kept) + 1
            with contextlib.closing(batch_for(build, actor, seeds, num_threads)) as batch:
                played = play(
                    batch,
                    actor,
                    seeds,
                    recipe.kept,
                    action_repeat=repeat,
                    most_steps=most,
                    on_step=on_step,
                )
                found = {episode.seed: episode for ended in played for episode in ended}
            for one in kept:
                again = dataclasses.replace(found[one.seed], start=starts.kind(one.seed))
                difference = _difference(one, again, recipe)
                if difference is not None:
                    other = other_versions(recipe, environment)
                    return f"{path}, seed {one.seed}: {difference}.{other}"
            compared += len(kept)
            steps = 0
    return None


def _units(dataset: Dataset) -> Iterator[tuple[Place, list[Episode]]]:
    """The episodes in lists that are played together, each with the file that has them."""
    for number, shard in enumerate(dataset.shards):
        episodes = dataset.episodes_of(number)
        while unit := list(itertools.islice(episodes, dataset.recipe.unit)):
            yield shard.path, unit


def _difference(recorded: Episode, found: Episode, recipe: Recipe) -> str | None:
    """The first column and step in which two episodes differ."""
    if recorded.length != found.length:
        has_ended = found.terminated[-1] or found.truncated[-1]
        now = str(found.length) if has_ended else "more"
        return f"the episode has {recorded.length} steps, and {now} now"
    if recorded.diverged and recipe.format == 1:
        found = _with_last_of(recorded, found)
    ours, theirs = (columns_of(episode, recipe) for episode in (recorded, found))
    for name in ours:
        difference = _differing(name, ours[name], theirs[name])
        if difference is not None:
            return difference
    return None


def _with_last_of(recorded: Episode, found: Episode) -> Episode:
    """The episode with the last observation and state of another one.

    Format 1 kept those after the step that diverged, when nothing is defined.
    """
    observations = {
        name: np.concatenate([values[:-1], recorded.observations[name][-1:]])
        for name, values in found.observations.items()
    }
    states = found.states
    if states is not None and recorded.states is not None:
        states = np.concatenate([states[:-1], recorded.states[-1:]])
    return dataclasses.replace(found, observations=observations, states=states)


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
