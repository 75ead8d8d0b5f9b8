"""`evaluate`: scores of a policy, of zero actions and of random actions, on the same seeds.

evaluation = evaluate("manipulator", "bring_ball", "my_policies:still", range(1000), workers=4)
print(evaluation.summary().mean, evaluation.summary("zero").mean)
"""

import concurrent.futures
import contextlib
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import cast

import dm_env

from limberjack.episodes import player as playing
from limberjack.episodes import statistics
from limberjack.episodes.places import local
from limberjack.episodes.player import Player, Progress
from limberjack.episodes.statistics import Score
from limberjack.evaluation import results
from limberjack.evaluation.results import Evaluation
from limberjack.evaluation.store import Store
from limberjack.utils.facts import Facts
from limberjack.utils.seeds import distinct_seeds
from limberjack.workers import OnProgress, OnState, Scale, Setup, Unit
from limberjack.workers.factories import Make
from limberjack.workers.identity import processor
from limberjack.worlds import World

__all__ = ["FLOORS", "evaluate", "play_unit"]

FLOORS = ("zero", "random")  # baselines, always played on the same seeds as the policy


def evaluate(
    domain: str | Make | dm_env.Environment,
    task: str | None = None,
    policy: object = "zero",
    seeds: Iterable[int] = range(100),
    *,
    out: Path | str | None = None,
    num_threads: int | None = None,
    time_limit: float | None = None,
    action_repeat: int | None = None,
    workers: int | None = None,
    executor: concurrent.futures.Executor | None = None,
    ray: str | None = None,
    shard: tuple[int, int] | None = None,
    any_processor: bool = False,
    vectorised: bool | None = None,
    world: World | None = None,
    on_progress: OnProgress | None = None,
    on_state: OnState | None = None,
    command: str = "",
) -> Evaluation:
    """The scores of a policy, of zero actions and of random ones, on the same seeds.

    Episode k is the first episode of the environment seeded with the k-th seed. Neither threads nor
    workers nor shards change a bit of an episode.

    Args:
      domain: such as 'humanoid', or a function `make(seed) -> dm_env.Environment`, or an
        environment to copy; see `workers.factories`. A task that cannot be vectorised plays in
        complete environments, and an environment of another class than `control.Environment` is
        made again for each seed.
      task: such as 'walk'; None with a function.
      policy: its name, or the function, object or class itself; see `limberjack.policies`.
      seeds: distinct, from 0 to 2**32 - 1.
      out: a folder for the results. Episodes that finished there in an earlier call, which may have
        been killed, are not played again.
      num_threads: number of threads that step the batch, or of each worker; by default the usable
        cores, or each worker's share of them.
      time_limit: seconds per episode; the task's own by default, as with a function.
      action_repeat: control steps per action; None for the environment's own, mostly 1. Returns,
        lengths, limits and success still count control steps.
      workers: number of processes that play; by default one per usable core for the planner, and
        none but this process for other policies. See `limberjack.workers.open_workers`.
      executor: plays the episodes in place of processes made here.
      ray: address of a Ray cluster that plays the episodes, or 'local' to start one.
      shard: (K, N) plays only the K-th of N parts of the seeds, and writes its episodes to a file
        of its own in `out`. A call without it joins the files of all shards.
      any_processor: accept workers, and episodes in the folder, of processors that round
        differently. The result then names the processor of each episode.
      vectorised: None vectorises the task if that changes no number; True raises the reason if it
        would; False plays in complete environments.
      world: options by which the task's world differs from the suite's, such as
        {'faults': 'easy'}; see `limberjack.worlds`. None with a function, which sets it itself.
      on_progress: called before a policy's first step, and after each step and episode, with the
        name of the policy, the number of finished episodes of all policies, and how many episodes'
        worth of steps the running ones have played. With workers, called after each unit of up to
        64 episodes.
      on_state: called with the state of the workers as units begin and end.
      command: the command line as it was typed, for the page; empty if there was none.

    Raises:
      ValueError, TypeError: there is no such task, policy, shard or seed, a number is out of range,
        the episodes have no time limit, the task cannot run in batches, the folder holds other
        results, or workers cannot import what they need. Nothing was played.
      PolicyError: the policy returned no valid action; finished episodes stay in the folder.
      WorkError: a policy failed in a worker, or workers were lost or refused; the same.
      OSError: a file cannot be written.
    """
    directory = None if out is None else local(out)
    if shard is not None and directory is None:
        raise ValueError(
            "a shard needs a folder that all shards write to: give one as out (--out DIR)"
        )
    player = Player(
        domain,
        task,
        policy,
        distinct_seeds(seeds),
        time_limit=time_limit,
        action_repeat=action_repeat,
        scale=Scale(workers, executor, ray, num_threads, any_processor, on_state, vectorised),
        shard=shard,
        is_kept=directory is not None,
        world=world,
    )
    with contextlib.closing(player):
        canary = None if directory is None else player.canary
        identity, mine, name = player.identity, player.seeds, player.actor.name
        store = Store(directory, identity, canary=canary, shard=shard, any_processor=any_processor)
        with contextlib.closing(store):
            floors = [player.with_policy(floor) for floor in FLOORS if floor != name]
            _play_missing(store, [player, *floors], on_progress)
    played = _evaluation(identity, name, store, mine)
    return played if directory is None or shard else results.write(played, directory, command)


def _play_missing(store: Store, players: Sequence[Player], on_progress: OnProgress | None) -> None:
    """Plays the seeds of the players, one for each policy, that the store lacks."""
    if players[0].setup is not None:
        _play_with_workers(store, players, on_progress)
        return
    progress = Progress(on_progress, players[0].step_limit)
    for player in players:
        missing = _missing(store, player)
        progress.policy = player.actor.name
        progress.finished += len(player.seeds) - len(missing)
        if missing:
            progress.report()
            _play_here(store, player, missing, progress)


def _play_here(store: Store, player: Player, missing: Sequence[int], progress: Progress) -> None:
    watch = progress.on_step if progress.is_watched else None  # a step is copied for it
    for ended in player.play(missing, on_step=watch):
        scores = [Score.of(episode, processor=store.processor) for episode in ended]
        store.add(player.actor.name, scores)
        for episode in ended:
            progress.on_ended(episode)


def _play_with_workers(
    store: Store, players: Sequence[Player], on_progress: OnProgress | None
) -> None:
    waiting = [
        Unit(player.setup, block)
        for player in players
        if player.setup is not None
        for block in player.units(_missing(store, player))
    ]
    if not waiting:
        return
    seeds, scale = players[0].seeds, players[0].scale
    finished = len(seeds) * len(players) - sum(len(unit.seeds) for unit in waiting)

    def report(policy: str) -> None:
        if on_progress is not None:
            on_progress(policy, finished, 0.0)

    report(waiting[0].policy)
    with scale.open(len(seeds)) as workers:
        for unit, scores in workers.results(play_unit, waiting):
            store.add(unit.policy, scores)
            finished += len(scores)
            report(unit.policy)


def _missing(store: Store, player: Player) -> list[int]:
    known = store.scores[player.actor.name]
    return [seed for seed in player.seeds if seed not in known]


def play_unit(setup: Setup, seeds: Sequence[int]) -> list[Score]:
    """The scores of the first episodes of these seeds, with their kinds of starts, in a worker."""
    played_by = processor() if setup.any_processor else None
    return [Score.of(one, processor=played_by) for one in playing.play_unit(setup, seeds)]


def _evaluation(identity: Facts, policy: str, store: Store, seeds: Sequence[int]) -> Evaluation:
    """The evaluation whose episodes are all in the store."""
    facts: dict[str, object] = {
        **identity,
        **_asked_for(seeds),
        **_played_with(store, identity),
    }
    names = dict.fromkeys((policy, *FLOORS))
    return Evaluation(
        cast(Facts, facts), {n: [store.scores[n][seed] for seed in seeds] for n in names}
    )


def _played_with(store: Store, identity: Facts) -> dict[str, object]:
    """The versions that played the episodes, if others than the present ones did."""
    present = [identity["versions"]]
    return {} if store.versions == present else {"versions_of_episodes": store.versions}


def _asked_for(seeds: Sequence[int]) -> dict[str, object]:
    """The seeds, and the definitions of success and of the interval."""
    first, end = (seeds[0], seeds[-1] + 1) if seeds else (0, 0)
    is_range = len(seeds) == end - first and seeds == list(range(first, end))
    return {
        "seeds": f"{first}:{end}" if is_range else seeds,
        "episodes_asked_for": len(seeds),
        "success": {
            "last_steps": statistics.LAST_STEPS,
            "mean_reward_at_least": statistics.SUCCESS_REWARD,
        },
        "interval": {
            "of": "mean",
            "confidence": statistics.CONFIDENCE,
            "method": "percentile bootstrap",
            "resamples": statistics.RESAMPLES,
        },
    }
