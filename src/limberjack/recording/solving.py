"""`solve`: recordings of episodes that the planner plays, one per core.

    for seed, recording in solve("manipulator", "bring_ball", range(16), workers=4):
        recording.save(Path(f"episode-{seed}.npz"))

Recordings come in the order in which their episodes end. They depend on the seed alone, not on the
number of workers or threads.
"""

import concurrent.futures
import dataclasses
from collections.abc import Iterable, Iterator

from limberjack.recording.episodes import Recording, Transcript
from limberjack.report import Facts
from limberjack.rl.batches import vectorisable
from limberjack.rollout import run_episode
from limberjack.utils.seeds import checked_seed
from limberjack.workers import OnState, Scale, Setup, Unit, Workers

__all__ = ["record_unit", "recordings", "solve"]


def solve(
    domain: str,
    task: str,
    seeds: Iterable[int],
    *,
    time_limit: float | None = None,
    num_threads: int | None = None,
    workers: int | None = None,
    executor: concurrent.futures.Executor | None = None,
    ray: str | None = None,
    any_processor: bool = False,
    on_state: OnState | None = None,
) -> Iterator[tuple[int, Recording]]:
    """Seeds and recordings of their episodes, as the episodes end.

    Args:
      domain: such as 'manipulator'.
      task: such as 'bring_ball'.
      seeds: of the episodes; each is the first one of an environment with that seed.
      time_limit: seconds per episode; the task's own by default.
      num_threads: threads of each worker; by default its share of the usable cores.
      workers: number of processes; by default one per usable core, at most one per seed.
      executor: plays the episodes in place of processes made here.
      ray: address of a Ray cluster that plays the episodes, or 'local' to start one.
      any_processor: accept workers whose processors round differently.
      on_state: called with the state of the workers as episodes begin and end.

    Raises:
      ValueError, TypeError: there is no such task or seed, or no cost for the planner.
      WorkError: an episode failed, or workers were lost or refused.
    """
    checked = [checked_seed(seed) for seed in seeds]
    scale = Scale(workers, executor, ray, num_threads, any_processor, on_state)
    setup = scale.prepared(domain, task, "planner", time_limit, len(checked))
    about = {**setup.identity, "canary": setup.canary}
    with scale.open(len(checked)) as opened:
        for seed, recording in recordings(opened, setup, checked):
            yield seed, dataclasses.replace(recording, about={**recording.about, **about})


def recordings(
    workers: Workers, setup: Setup, seeds: Iterable[int]
) -> Iterator[tuple[int, Recording]]:
    """The same with workers that are open; `Recording.about` lacks the setup's identity."""
    units = [Unit(setup, (seed,)) for seed in seeds]
    for unit, recording in workers.results(record_unit, units):
        yield unit.seeds[0], recording


def record_unit(setup: Setup, seeds: tuple[int, ...]) -> Recording:
    """The recording of one seed's episode, in a worker."""
    (seed,), here = seeds, setup.opened()
    assert here.found.alone is not None
    environment = vectorisable(here.environment)
    environment.reseed(seed)
    transcript = Transcript(environment)
    episode = run_episode(environment, here.found.alone, seed, on_step=transcript.add)
    about: Facts = {"seed": seed, "start": episode.start}
    if setup.any_processor:
        about["processor"] = here.processor
    return transcript.recording(about)
