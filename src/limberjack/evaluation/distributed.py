"""Plays the episodes that a store lacks with workers; this process alone writes them down.

play_with(workers, store, [setup, setup.with_policy("zero")], seeds, on_progress=None)
"""

import dataclasses
from collections.abc import Sequence

from limberjack.evaluation.episodes import play, play_alone
from limberjack.evaluation.runner import OnProgress
from limberjack.evaluation.starts import kind_of_first_start
from limberjack.evaluation.statistics import Score
from limberjack.evaluation.store import Store
from limberjack.workers import Setup, Unit, Workers, units_of

__all__ = ["play_unit", "play_with"]


def play_with(
    workers: Workers,
    store: Store,
    setups: Sequence[Setup],
    seeds: Sequence[int],
    on_progress: OnProgress | None,
) -> None:
    """Plays the seeds that the policies of the setups have not played yet.

    Args:
      workers: play them.
      store: holds the finished episodes, and receives the new ones.
      setups: one for each policy.
      seeds: of the episodes.
      on_progress: called before the first unit and after each one.

    Raises:
      WorkError: see `limberjack.workers`; finished episodes are in the store.
      OSError: the store cannot be written.
    """
    units: list[Unit] = []
    for setup in setups:
        known = store.scores[setup.identity["policy"]]
        missing = [seed for seed in seeds if seed not in known]
        units += [Unit(setup, block) for block in units_of(missing, setup.unit_size)]
    if not units:
        return
    finished = len(seeds) * len(setups) - sum(len(unit.seeds) for unit in units)
    if on_progress is not None:
        on_progress(units[0].setup.identity["policy"], finished, 0.0)
    for unit, scores in workers.results(play_unit, units):
        policy = unit.setup.identity["policy"]
        store.add(policy, scores)
        finished += len(scores)
        if on_progress is not None:
            on_progress(policy, finished, 0.0)


def play_unit(setup: Setup, seeds: tuple[int, ...]) -> list[Score]:
    """The scores of the first episodes of these seeds, with their kinds of starts, in a worker."""
    here, repeat = setup.opened(), setup.action_repeat
    if here.found.actor is not None:
        ended = play(here.build, here.found.actor, seeds, here.num_threads, None, repeat)
    else:
        assert here.found.alone is not None
        ended = play_alone(here.build.seeded(seeds[0]), here.found.alone, seeds, None, repeat)
    full_length = here.full_build.seeded(seeds[0])
    processor = here.processor if setup.any_processor else None
    return [
        dataclasses.replace(
            score, start=kind_of_first_start(full_length, score.seed), processor=processor
        )
        for scores in ended
        for score in scores
    ]
