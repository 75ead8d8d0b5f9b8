"""`replay`: the episodes of a dataset made again from their seeds and actions, and compared.

    difference = replay(load("data"))       # None if every bit is equal

Everything is compared: observations, rewards, ends, states, model fields and kinds of starts, as
they were kept. Numbers are promised to be equal for equal versions on one kind of processor.
"""

import contextlib
import dataclasses

import numpy as np

from limberjack.episodes.columns import Values, columns_of
from limberjack.episodes.dataset import Dataset
from limberjack.episodes.episode import Episode
from limberjack.episodes.playing import Recorded, Step, batch_for, play
from limberjack.episodes.recipe import Recipe, environment_of, other_versions
from limberjack.episodes.starts import Starts
from limberjack.workers import OnProgress
from limberjack.workers.factories import factory_of

__all__ = ["replay"]


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
    recipe = dataset.recipe
    facts = recipe.facts
    compared = 0  # episodes
    steps = 0  # of the running ones

    def on_step(step: Step) -> None:
        nonlocal steps
        steps += step.count
        if on_progress is not None:
            on_progress("replaying", compared, steps / recipe.step_limit)

    environment = environment_of(recipe)
    # The kind of a start may depend on more seconds than the episodes have.
    full_length = factory_of(facts["domain"], facts["task"])
    starts = Starts(full_length.build(full_length.make(0)))
    with contextlib.closing(environment), contextlib.closing(starts):
        for shard in dataset.shards:
            recorded = list(shard.episodes())
            actor = Recorded({episode.seed: episode.actions for episode in recorded})
            # Not up to the recipe's length, which anyone may have written: it could take days.
            most = max(shard.lengths) + 1
            with contextlib.closing(
                batch_for(environment, actor, len(recorded), num_threads)
            ) as batch:
                how = {"most_steps": most, "on_step": on_step}
                played = play(batch, actor, shard.seeds, recipe.kept, **how)
                found = {episode.seed: episode for ended in played for episode in ended}
            for one in recorded:
                again = dataclasses.replace(found[one.seed], start=starts.kind(one.seed))
                difference = _difference(one, again, recipe)
                if difference is not None:
                    other = other_versions(recipe, environment)
                    return f"{shard.path}, seed {one.seed}: {difference}.{other}"
            compared += len(recorded)
            steps = 0
    return None


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
