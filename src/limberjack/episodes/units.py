"""Episodes of some seeds with the kinds of their starts, in this process or in a worker.

for unit, episodes in workers.results(play_unit, units): ...
"""

import contextlib
import dataclasses
from collections.abc import Callable, Sequence

from limberjack.episodes.episode import Episode, Kept
from limberjack.episodes.playing import OnStep, batch_for, play
from limberjack.episodes.starts import Starts
from limberjack.policies import Actor
from limberjack.rl.builds import Build
from limberjack.workers import Setup

__all__ = ["OnEnded", "play_seeds", "play_unit"]

OnEnded = Callable[[Episode], object]


def play_seeds(
    build: Build,
    starts: Starts,
    actor: Actor,
    seeds: Sequence[int],
    kept: Kept | None = None,
    *,
    num_threads: int | None = None,
    action_repeat: int = 1,
    vectorised: bool | None = None,
    on_step: OnStep | None = None,
    on_ended: OnEnded | None = None,
) -> list[Episode]:
    """The first episodes of seeds, in the order in which they end.

    Args:
      build: makes the environments.
      starts: determines the kinds of starts.
      actor: acts in all rows.
      seeds: at least one.
      kept: what is kept of each step besides rewards; None for nothing.
      num_threads: that step a batch; None for all usable cores.
      action_repeat: control steps per action.
      vectorised: see `rl.batch_of`.
      on_step: called as episodes begin, and after each step.
      on_ended: called with each episode as it ends.
    """
    episodes: list[Episode] = []
    how = {"action_repeat": action_repeat, "on_step": on_step}
    batch = batch_for(build, actor, len(seeds), num_threads, vectorised=vectorised)
    with contextlib.closing(batch):
        for ended in play(batch, actor, seeds, kept, **how):
            for one in ended:
                episode = dataclasses.replace(one, start=starts.kind(one.seed))
                episodes.append(episode)
                if on_ended is not None:
                    on_ended(episode)
    return episodes


def play_unit(setup: Setup, seeds: Sequence[int], kept: Kept | None = None) -> list[Episode]:
    """The first episodes of seeds, in the order in which they end, in a worker.

    Args:
      setup: the task and the policy.
      seeds: at least one.
      kept: what is kept of each step besides rewards; None for nothing.
    """
    here = setup.opened()
    how = {
        "num_threads": here.num_threads,
        "action_repeat": setup.action_repeat,
        "vectorised": setup.vectorised,
    }
    with contextlib.closing(Starts.of(here.factory)) as starts:
        return play_seeds(here.build, starts, here.actor, seeds, kept, **how)
