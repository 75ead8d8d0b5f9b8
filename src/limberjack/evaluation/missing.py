"""Plays the episodes that a store lacks, in this process or with workers, which never write."""

from collections.abc import Sequence

from limberjack.episodes import player as playing
from limberjack.episodes.player import Player, Progress
from limberjack.episodes.statistics import Score
from limberjack.evaluation.store import Store
from limberjack.workers import OnProgress, Setup, Unit

__all__ = ["play_missing", "play_unit"]


def play_missing(store: Store, players: Sequence[Player], on_progress: OnProgress | None) -> None:
    """Plays the seeds of players that the store lacks.

    Args:
      store: holds the finished episodes, and receives the new ones.
      players: one for each policy, of the same task and seeds.
      on_progress: called before a policy's first step, and after each step and episode; with
        workers, before the first unit and after each one.

    Raises:
      PolicyError, WorkError: a policy or a worker failed; finished episodes are in the store.
      OSError: the store cannot be written.
    """
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
    processor = setup.opened().processor if setup.any_processor else None
    played = playing.play_unit(setup, seeds)
    return [Score.of(episode, processor=processor) for episode in played]
