"""`collect`: a policy's episodes, written to Parquet files.

    from limberjack.data import collect, load

    collect("manipulator", "bring_ball", "random", range(1000), out="data")
    dataset = load("data")

Episode k is the first episode of an environment with the k-th seed, as in an evaluation, and a file
has the same bytes whichever process makes it: it is a function of the recipe and the seeds. Up to
64 episodes are played together; where a file has more, they are kept until it is complete. The same
call continues where an earlier one was killed, and a call with other seeds adds to the folder.
While one batch simulates, the episodes of the one before are compressed and written.
"""

import contextlib
import datetime
import functools
import platform
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import dm_env

from limberjack import policies
from limberjack.episodes.environments import checked_environment
from limberjack.episodes.episode import Episode, Kept
from limberjack.episodes.folder import Folder, blocks, discard_other
from limberjack.episodes.illustrating import illustrate
from limberjack.episodes.parquet import PYARROW, encode
from limberjack.episodes.places import Place, absolute
from limberjack.episodes.player import OnEnded, Player
from limberjack.episodes.playing import OnStep, Step
from limberjack.episodes.recipe import FILE_MB, Recipe, recipe_of
from limberjack.episodes.repairing import set_aside
from limberjack.episodes.writing import FILE, LIST, PART, Order, Unseen, work
from limberjack.policies import PolicyError
from limberjack.registry.sets import Tasks, refusals_named, tasks_of
from limberjack.utils.seeds import checked_seeds
from limberjack.workers import OnProgress, OnState, Scale, State, Unit, counted_from
from limberjack.workers.factories import Make, factory_of
from limberjack.workers.identity import advice_on, processor
from limberjack.worlds import World

__all__ = ["collect", "collect_set", "collect_with"]


def collect(
    domain: str | Make | dm_env.Environment,
    task: str | None = None,
    policy: object = "zero",
    seeds: Iterable[int] = range(100),
    *,
    out: Path | str,
    kept: Kept | None = None,
    file_mb: float = FILE_MB,
    repair: bool = False,
    film: bool = False,
    time_limit: float | None = None,
    action_repeat: int | None = None,
    num_threads: int | None = None,
    workers: int | None = None,
    executor: Executor | None = None,
    ray: str | None = None,
    shard: tuple[int, int] | None = None,
    any_processor: bool = False,
    vectorised: bool | None = None,
    world: World | None = None,
    on_progress: OnProgress | None = None,
    on_state: OnState | None = None,
    command: str = "",
) -> None:
    """Plays the episodes that a folder lacks, and writes them.

    Args:
      domain, task, time_limit, action_repeat, world: as for `limberjack.evaluation.evaluate`. Of a
        function that makes environments, a dataset has the name and the hash, for comparison only.
      policy: its name, or the function, object or class itself; see `limberjack.policies`.
      seeds: increasing, from 0 to 2**32 - 1.
      out: the folder, which is created if needed, or a URL of fsspec, such as s3://bucket/walk;
        episodes that it has are not played again.
      kept: what is kept of each step; by default observations as they are, and no states.
      file_mb: megabytes of a file before compression, by which its number of seeds is chosen: as
        many as have room if all episodes have full length, and at least one.
      repair: first move damaged files into the folder `damaged`, and collect their episodes again,
        too; not with a shard.
      film: draw the median episode for the card of the dataset, after all else; with a shard it is
        left to the call without one.
      num_threads, workers, executor, ray: the workers, as for `limberjack.evaluation.evaluate`.
      shard: (K, N) plays only the K-th of N parts of the seeds; they share the folder, which a call
        without `shard` completes.
      any_processor: accept workers, and episodes that are here, of processors that round
        differently.
      on_progress: called as episodes are played and saved, as by `evaluate`.
      on_state: called with the state of the workers.
      vectorised: as for `evaluate`.
      command: the command line as it was typed, for run.json; empty if there was none.

    Raises:
      ValueError, TypeError: there is no such task, policy or seed, a number is out of range, the
        episodes have no time limit or do not fit onto the disk, or the folder has another dataset.
        Nothing was played.
      PolicyError, WorkError: the policy or a worker failed; complete files stay in the folder.
      OSError: a file cannot be written.
      ImportError: the extra `data` is missing.
    """
    if repair and shard is not None:
        raise ValueError("repair and shard are both given: repair the dataset without a shard")
    player = Player(
        domain,
        task,
        policy,
        checked_seeds(seeds),
        time_limit=time_limit,
        action_repeat=action_repeat,
        scale=Scale(workers, executor, ray, num_threads, any_processor, on_state, vectorised),
        shard=shard,
        is_kept=True,
        world=world,
    )
    directory = absolute(out)
    make = domain if callable(domain) else None
    with contextlib.closing(player):
        collect_with(
            player,
            directory,
            kept,
            file_mb,
            shard=shard,
            repair=repair,
            on_progress=on_progress,
            on_complete=functools.partial(illustrate, make=make) if film and not shard else None,
            command=command,
        )


def collect_set(
    tasks: Tasks,
    policy: object = "zero",
    seeds: Iterable[int] = range(100),
    *,
    out: Path | str,
    on_progress: OnProgress | None = None,
    **kwargs: Any,  # of `collect`, which checks them
) -> dict[tuple[str, str], Place]:
    """Collects a dataset of each of several tasks; returns their folders, DIR/DOMAIN-TASK.

    Args:
      tasks: the name of a set, such as 'dmc28', or a list; see `limberjack.registry.sets.find`.
      policy: for all tasks; in a name {domain} and {task} stand for those of each. A mapping has
        one for each (domain, task).
      seeds: of each task.
      out: the folder of the datasets.
      on_progress: called as by `collect`, with the number of episodes of all tasks.
      kwargs: of `collect`.

    Raises:
      ValueError, PolicyError: there is no such set or task, or a task has no policy or no time
        limit. Nothing was played.
      SetError: the folder of a task holds something else, or its episodes cannot be collected.
      Exception: any that `collect` raises. The datasets of tasks before are complete.
    """
    pairs, wanted, place = tasks_of(tasks), checked_seeds(seeds), absolute(out)
    how = kwargs.get("time_limit"), kwargs.get("world")
    chosen = {pair: policies.policy_for(policy, *pair) for pair in pairs}
    for (domain, task), of_task in chosen.items():
        checked = checked_environment(factory_of(domain, task, *how), wanted, is_kept=True)
        with contextlib.closing(checked) as environment:
            if of_task is None:
                raise PolicyError(f"there is no policy for {domain} {task}")
            policies.find(of_task, environment, num_threads=1)
    folders = {}
    for number, ((domain, task), of_task) in enumerate(chosen.items()):
        show = counted_from(number * len(wanted), on_progress)
        folder = place / f"{domain}-{task}"
        with refusals_named(domain, task, show) as shown:
            collect(domain, task, of_task, wanted, out=str(folder), on_progress=shown, **kwargs)
        folders[domain, task] = folder
    return folders


def collect_with(
    player: Player,
    directory: Place,
    kept: Kept | None = None,
    file_mb: float = FILE_MB,
    *,
    shard: tuple[int, int] | None = None,
    replaces: bool = False,
    repair: bool = False,
    on_progress: OnProgress | None = None,
    on_step: OnStep | None = None,
    on_ended: OnEnded | None = None,
    on_complete: Callable[[Place], object] | None = None,
    command: str = "",
) -> None:
    """Plays with a player, and writes; arguments and errors are those of `collect`.

    Args:
      player: its results are kept.
      directory: an absolute path, or the place of a URL.
      kept, file_mb, shard, repair, on_progress, command: as for `collect`.
      replaces: discard a dataset of another recipe that is here; by default it is an error.
      on_step: called as episodes begin in this process, and after each step.
      on_ended: called with each episode that ends in this process.
      on_complete: called with the folder when all else is done, before another process may write.
    """
    if player.actor.sha256 is None:
        raise PolicyError(
            f"policy {player.actor.name!r} has no source file, so nothing would prove later that "
            "episodes are its own: define it in a file"
        )
    facts = player.identity.copy()
    facts["versions"] = {**facts["versions"], "pyarrow": PYARROW}
    recipe = recipe_of(facts, player.environment, kept or Kept(), file_mb)
    if replaces:
        assert isinstance(directory, Path)  # of `run` and `solve`, which also write films there
        discard_other(directory, recipe)
    if repair:
        player.add_seeds(set_aside(directory, recipe))
    canary = player.canary
    with Folder(directory, recipe, shard) as folder:
        missing = folder.plan(player.wanted, player.seeds)
        call = None
        if missing:
            _check_canary(folder, canary, player.scale.any_processor)
            call = _call(missing, command, canary, player.scale)
            folder.log(call)
        units = [*_units(missing, 1 if player.actor.plays_alone else recipe.unit, recipe)]
        with _Saving(folder, recipe, len(player.seeds), missing, on_progress) as saving:
            if player.setup is not None:
                _play_with_workers(player, folder, units, saving)
            else:

                def watch(step: Step) -> None:
                    saving.on_step(step)
                    if on_step is not None:
                        on_step(step)

                saving.join(folder.ready())
                for unit, made in player.results(units, _in_order, recipe.kept, watch, on_ended):
                    saving.save(unit, made)
        folder.finish()
        if call is not None:
            folder.log({**call, "ended": _now()})
        if on_complete is not None:
            on_complete(directory)


def _play_with_workers(
    player: Player, folder: Folder, units: Sequence[range], saving: "_Saving"
) -> None:
    """Has workers play, write and join; the bytes of one that does not see the folder come here."""
    assert player.setup is not None
    setup, scale = player.setup, player.scale
    orders = [*folder.ready(), *((unit, folder.order(unit)) for unit in units), *folder.unlisted()]
    if not orders:
        return
    waiting = deque(Unit(setup, seeds, (order,)) for seeds, order in orders)
    nodes: set[str] = set()  # of workers that do not see the folder
    episodes = sum(map(len, units)) or len(orders)
    with folder.probed() as writing, scale.open(episodes) as workers:
        for unit, result in workers.results(functools.partial(work, writing), waiting):
            seeds, order = range(unit.seeds[0], unit.seeds[-1] + 1), unit.more[0]
            assert isinstance(order, Order)
            if isinstance(result, Unseen):
                if result.node not in nodes:
                    nodes.add(result.node)
                    _report_unseen(folder, result.node, scale)
                ready = _written_here(folder, seeds, order, result)
            else:
                ready = folder.took(seeds, result)
            waiting.extendleft(Unit(setup, file, (joining,)) for file, joining in ready)
            if order in (FILE, PART):
                saving.count(len(seeds))


def _written_here(
    folder: Folder, seeds: range, order: Order, result: Unseen
) -> list[tuple[range, Order]]:
    """Does what a worker could not do; returns a file that can be joined now, if any."""
    if result.content is not None:
        return folder.add(seeds, result.content)
    if order != LIST:  # which `finish` does
        folder.join(seeds, order)
    return []


def _report_unseen(folder: Folder, node: str, scale: Scale) -> None:
    if scale.on_state is not None:
        note = (
            f"a worker on node {node} does not see {folder.directory}, or may not write to it: "
            "this process writes its files"
        )
        scale.on_state(State(scale.workers or 1, 0, note=note))


def _in_order(episodes: Iterable[Episode]) -> list[Episode]:
    return sorted(episodes, key=lambda episode: episode.seed)


def _call(missing: Sequence[int], command: str, canary: str, scale: Scale) -> dict[str, object]:
    """An entry of run.json, for everything that the files do not depend on."""
    return {
        "began": _now(),
        "ended": None,
        "command": command,
        "episodes": len(missing),
        "first_seed": missing[0],
        "host": platform.node(),
        "processor": processor(),
        "canary": canary,
        "workers": scale.workers,
        "threads": scale.num_threads,
    }


def _check_canary(folder: Folder, canary: str, any_processor: bool) -> None:
    """Raises ValueError if a processor that rounds differently has collected episodes here."""
    for call in folder.calls():
        kept = call.get("canary", canary)
        if kept != canary and not any_processor:
            raise ValueError(
                f"{folder.directory} has episodes that were collected with canary {kept!r}, and "
                f"this call has {canary!r}: choose another folder{advice_on('canary')}"
            )


class _Saving:
    """Saves finished episodes in a thread while the next ones are simulated, and counts both."""

    def __init__(
        self,
        folder: Folder,
        recipe: Recipe,
        asked: int,
        missing: Sequence[int],
        on_progress: OnProgress | None,
    ) -> None:
        self._folder, self._recipe = folder, recipe
        self._saved = asked - len(missing)
        self._steps = 0  # of the running episodes
        self._on_progress = on_progress
        self._beside = ThreadPoolExecutor(1)
        self._pending: Future[int] | None = None  # the number of episodes that are being saved
        self._waiting = 0  # episodes that are being saved and not yet counted

    def __enter__(self) -> "_Saving":
        self._report()
        return self

    def __exit__(self, kind: object, *error: object) -> None:
        self._beside.shutdown()  # what was played is saved, whatever follows
        if kind is None:
            self._wait()
        else:
            with contextlib.suppress(Exception):  # the error of the body is reported instead
                self._wait()
        self._report()

    def count(self, episodes: int) -> None:
        """Counts episodes that a worker has saved."""
        self._saved += episodes
        self._report()

    def join(self, files: Sequence[tuple[range, Order]]) -> None:
        """Joins files in this thread."""
        for seeds, order in files:
            self._folder.join(seeds, order)

    def save(self, seeds: Sequence[int], made: "list[Episode]") -> None:
        """Saves episodes, once those before them are saved."""
        self._wait()
        self._waiting, self._steps = len(seeds), 0
        self._pending = self._beside.submit(self._save, seeds, made)
        self._report()

    def on_step(self, step: Step) -> None:
        """Counts steps of episodes that are not saved yet."""
        self._steps += step.count
        self._report()

    def _wait(self) -> None:
        """Counts what was saved last; raises its error, if any."""
        pending, self._pending = self._pending, None
        if pending is not None:
            self._waiting = 0
            self._saved += pending.result()

    def _save(self, seeds: Sequence[int], made: "list[Episode]") -> int:
        content = encode(self._recipe, made)
        self.join(self._folder.add(range(seeds[0], seeds[-1] + 1), content))
        return len(seeds)

    def _report(self) -> None:
        if self._on_progress is not None:
            part = self._waiting + self._steps / self._recipe.step_limit
            self._on_progress(self._recipe.facts["policy"], self._saved, part)


def _units(seeds: Sequence[int], size: int, recipe: Recipe) -> Iterator[range]:
    """The seeds of each file in ranges of up to 64, or of one if the policy plays one at a time."""
    for block in blocks(seeds, recipe.block):
        for first in range(block.start, block.stop, size):
            yield range(first, min(first + size, block.stop))


def _now() -> str:
    return datetime.datetime.now(datetime.UTC).isoformat()
