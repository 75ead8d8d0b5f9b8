"""`Player`: a policy in a task, checked once, that plays episodes here or with workers.

    player = Player("humanoid", "walk", "random", range(100), scale=Scale(workers=4))
    with contextlib.closing(player):
        for seeds, episodes in player.results(player.units(player.seeds), list):
            print([episode.total for episode in episodes])

`evaluate`, `collect` and `Run` play with it, and differ in what they keep of an episode.
"""

import contextlib
import copy
import dataclasses
import functools
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import TypeVar

import dm_env

from limberjack import policies
from limberjack.episodes.environments import checked_environment, checked_repeat, step_limit_of
from limberjack.episodes.episode import Episode, Kept
from limberjack.episodes.playing import OnStep, Step, batch_for, play
from limberjack.episodes.starts import Starts
from limberjack.policies import ROWS, Actor
from limberjack.rl.builds import Build
from limberjack.utils.facts import Facts
from limberjack.workers import OnProgress, Scale, Setup, Unit, shard_of, units_of
from limberjack.workers.factories import Make, factory_of
from limberjack.workers.identity import canary_of, identity_of
from limberjack.worlds import World

__all__ = ["OnEnded", "Player", "Progress", "play_unit"]

OnEnded = Callable[[Episode], object]

_Result = TypeVar("_Result")


class Player:
    """See the module's docstring.

    Attributes:
      factory: makes the environments.
      environment: one of them.
      actor: the policy.
      action_repeat: control steps per action.
      step_limit: control steps of an episode.
      wanted: the seeds of all shards.
      seeds: those of this shard.
      scale: the workers that were asked for.
      setup: what workers need; None if this process plays.
      identity: everything that an episode depends on except its seed, as values of JSON.
    """

    def __init__(
        self,
        domain: str | Make | dm_env.Environment,
        task: str | None = None,
        policy: object = "zero",
        seeds: Sequence[int] = range(1),
        *,
        time_limit: float | None = None,
        action_repeat: int | None = None,
        scale: Scale | None = None,
        shard: tuple[int, int] | None = None,
        is_kept: bool = False,
        actor: Actor | None = None,
        world: World | None = None,
    ) -> None:
        """Checks all arguments; nothing is played or written.

        Args:
          domain, task, policy, time_limit, action_repeat, world: see
            `limberjack.evaluation.evaluate`.
          seeds: of the episodes, at least one.
          scale: number and kind of workers.
          shard: (K, N) for the K-th of N parts of the seeds.
          is_kept: whether results are kept, which must name the environment.
          actor: acts in this process in the place of the policy that `policy` names.

        Raises:
          ValueError, TypeError: there is no such task, policy or shard, a number is out of range,
            the episodes have no time limit, the task cannot run in batches, or workers cannot
            import what they need.
        """
        self.scale = scale or Scale()
        self.wanted = seeds
        self.seeds = seeds if shard is None else shard_of(seeds, shard)
        self.factory = factory_of(domain, task, time_limit, world)
        how = {"is_kept": is_kept, "vectorised": self.scale.vectorised}
        self.environment = checked_environment(self.factory, seeds, **how)
        try:
            threads = self.scale.num_threads
            self.actor = actor or policies.find(policy, self.environment, num_threads=threads)
            self.action_repeat = checked_repeat(action_repeat, self.environment, self.actor)
            self.setup: Setup | None = None
            if actor is None:
                count, repeat = len(self.seeds), self.action_repeat
                made = self.factory, self.environment, self.actor
                self.setup = self.scale.setup(*made, policy, count, repeat)
        except BaseException:
            self.environment.close()
            raise
        self._build = self.factory.build(self.environment)  # which remembers what it compared
        limit = step_limit_of(self.environment)
        assert limit is not None  # see `checked_environment`
        self.step_limit = limit
        self.identity = self._identified()
        self._starts = Starts.of(self.factory) if self.setup is None else None

    def _identified(self) -> Facts:
        return identity_of(self.factory, self.actor, self.environment, self.action_repeat)

    def with_policy(self, name: str) -> "Player":
        """The same with a built-in policy; both are closed together."""
        other = copy.copy(self)
        other.actor = policies.find(name, self.environment)
        other.identity = other._identified()
        if self.setup is not None:
            other.setup = self.setup.with_policy(name, other.actor, other.identity)
        return other

    @functools.cached_property
    def canary(self) -> str:
        """SHA-256 of a few steps, which another kind of processor may not reproduce."""
        return canary_of(self.factory) if self.setup is None else self.setup.canary

    def close(self) -> None:
        """Frees the environments."""
        self.environment.close()
        if self._starts is not None:
            self._starts.close()

    def add_seeds(self, seeds: Iterable[int]) -> None:
        """Makes more seeds wanted; there must be no shard."""
        self.wanted = self.seeds = sorted({*self.wanted, *seeds})

    def units(self, seeds: Iterable[int]) -> list[tuple[int, ...]]:
        """The seeds in groups that are played together."""
        return units_of(seeds, 1 if self.actor.plays_alone else ROWS)

    def play(
        self, seeds: Sequence[int], kept: Kept | None = None, on_step: OnStep | None = None
    ) -> Iterator[list[Episode]]:
        """Plays seeds in this process: one list for all episodes that end with the same step.

        Args:
          seeds: at least one.
          kept: what is kept of each step besides rewards; None for nothing.
          on_step: called as episodes begin, and after each step.
        """
        how = {
            "num_threads": self.scale.num_threads,
            "action_repeat": self.action_repeat,
            "vectorised": self.scale.vectorised,
            "on_step": on_step,
        }
        assert self._starts is not None, "workers play"
        return _played(self._build, self._starts, self.actor, seeds, kept, **how)

    def results(
        self,
        units: Sequence[Sequence[int]],
        made: Callable[[list[Episode]], _Result],
        kept: Kept | None = None,
        on_step: OnStep | None = None,
        on_ended: OnEnded | None = None,
    ) -> Iterator[tuple[Sequence[int], _Result]]:
        """Units with what was made of their episodes, here or by workers, as they end.

        Args:
          units: seeds that are played together.
          made: of the episodes of a unit, in the order in which they ended. Workers need it at the
            top level of a module, or as a `partial` of such a function.
          kept: as for `play`.
          on_step: called as episodes begin in this process, and after each step.
          on_ended: called with each episode that ends in this process.
        """
        if self.setup is None:
            for unit in units:
                episodes: list[Episode] = []
                for ended in self.play(unit, kept, on_step):
                    episodes += ended
                    if on_ended is not None:
                        for episode in ended:
                            on_ended(episode)
                yield unit, made(episodes)
            return
        with self.scale.open(sum(map(len, units))) as workers:
            work = [Unit(self.setup, tuple(unit)) for unit in units]
            for unit, result in workers.results(functools.partial(_made_of, made, kept), work):
                yield unit.seeds, result


class Progress:
    """Counts episodes and steps in this process, for an `OnProgress`.

    Attributes:
      policy: that plays now.
      finished: number of episodes that have ended, of all policies.
    """

    def __init__(self, on_progress: OnProgress | None, step_limit: int) -> None:
        """Takes the function to call, or None, and the steps of an episode."""
        self.policy = ""
        self.finished = 0
        self._steps = 0  # of unfinished episodes
        self._step_limit = step_limit
        self._on_progress = on_progress

    @property
    def is_watched(self) -> bool:
        """Whether there is a function to call."""
        return self._on_progress is not None

    def report(self) -> None:
        """Calls the function."""
        if self._on_progress is not None:
            self._on_progress(self.policy, self.finished, self._steps / self._step_limit)

    def on_step(self, step: Step) -> None:
        """Counts a step."""
        if step.count:
            self._steps += step.count
            self.report()

    def on_ended(self, episode: Episode) -> None:
        """Counts an episode in the place of its steps, which workers do not count."""
        self.finished += 1
        self._steps = max(0, self._steps - episode.length)
        self.report()


def play_unit(setup: Setup, seeds: Sequence[int], kept: Kept | None = None) -> list[Episode]:
    """The first episodes of seeds, in the order in which they end, in a worker.

    Args:
      setup: the task and the policy.
      seeds: at least one.
      kept: what is kept of each step besides rewards; None for nothing.
    """
    here = setup.opened()
    how = {
        "num_threads": setup.num_threads,
        "action_repeat": setup.action_repeat,
        "vectorised": setup.vectorised,
    }
    with contextlib.closing(Starts.of(here.factory)) as starts:
        played = _played(here.build, starts, here.actor, seeds, kept, **how)
        return [episode for ended in played for episode in ended]


def _made_of(
    made: Callable[[list[Episode]], _Result],
    kept: Kept | None,
    setup: Setup,
    seeds: Sequence[int],
) -> _Result:
    return made(play_unit(setup, seeds, kept))


def _played(
    build: Build,
    starts: Starts,
    actor: Actor,
    seeds: Sequence[int],
    kept: Kept | None,
    *,
    num_threads: int | None,
    action_repeat: int,
    vectorised: bool | None,
    on_step: OnStep | None = None,
) -> Iterator[list[Episode]]:
    """Episodes with the kinds of their starts, in a batch that is closed after them."""
    batch = batch_for(build, actor, seeds, num_threads, vectorised=vectorised)
    with contextlib.closing(batch):
        how = {"action_repeat": action_repeat, "on_step": on_step}
        is_own = build.original is None
        for ended in play(batch, actor, seeds, kept, watches_draws=is_own, **how):
            yield [dataclasses.replace(one, start=starts.kind(one.seed)) for one in ended]
