"""`collect`: a policy's episodes, written to Parquet files of 64 each.

    from limberjack.data import collect, load

    collect("manipulator", "bring_ball", "random", range(1000), out="data")
    dataset = load("data")

Episode k is the first episode of an environment with the k-th seed, as in an evaluation, and a file
has the same bytes whichever process makes it: a unit of work is a function of the recipe and the
seeds. A file is written as soon as it is complete, so that the same call continues where an earlier
one was killed, and a call with other seeds adds to the folder. While one batch simulates, the
episodes of the one before are compressed and written.
"""

import contextlib
import dataclasses
import datetime
import functools
import itertools
import platform
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from pathlib import Path

from limberjack.episodes.episode import Episode, Kept
from limberjack.episodes.folder import Folder, blocks
from limberjack.episodes.parquet import PYARROW, encode
from limberjack.episodes.playing import OnStep, Step, batch_for, play
from limberjack.episodes.recipe import SHARD, Recipe, recipe_of
from limberjack.episodes.starts import Starts
from limberjack.report import Facts
from limberjack.rl.batches import vectorisable
from limberjack.utils.seeds import checked_seed
from limberjack.workers import OnProgress, OnState, Setup, Unit, open_workers, prepare, shard_of
from limberjack.workers.identity import advice_on
from limberjack.workers.scale import Scale

__all__ = ["collect"]

_Make = Callable[[Setup, tuple[int, ...]], "bytes | list[Episode]"]


def collect(
    domain: str,
    task: str,
    policy: object = "zero",
    seeds: Iterable[int] = range(100),
    *,
    out: Path | str,
    kept: Kept | None = None,
    time_limit: float | None = None,
    num_threads: int | None = None,
    workers: int | None = None,
    executor: Executor | None = None,
    ray: str | None = None,
    shard: tuple[int, int] | None = None,
    any_processor: bool = False,
    on_progress: OnProgress | None = None,
    on_state: OnState | None = None,
    command: str = "",
) -> None:
    """Plays the episodes that a folder lacks, and writes them.

    Args:
      domain: such as 'humanoid'.
      task: such as 'walk'.
      policy: its name, or the function, object or class itself; see `limberjack.policies`.
      seeds: increasing, from 0 to 2**32 - 1.
      out: the folder, which is created if needed; episodes that it has are not played again.
      kept: what is kept of each step; by default observations as they are, and no states.
      time_limit: seconds per episode; the task's own by default.
      num_threads, workers, executor, ray: who plays, as for `limberjack.evaluation.evaluate`.
      shard: (K, N) plays only the K-th of N parts of the seeds; they share the folder.
      any_processor: accept workers, and episodes that are here, of processors that round
        differently.
      on_progress: called as episodes are played and saved, as by `evaluate`.
      on_state: called with the state of the workers.
      command: the command line as it was typed, for run.json; empty if there was none.

    Raises:
      ValueError, TypeError: there is no such task, policy or seed, a number is out of range, the
        episodes have no time limit or do not fit onto the disk, or the folder has another dataset.
        Nothing was played.
      PolicyError, WorkError: the policy or a worker failed; complete files stay in the folder.
      OSError: a file cannot be written.
      ImportError: the extra `data` is missing.
    """
    asked, directory = _checked_seeds(seeds, shard), Path(out).absolute()  # a policy may move
    scale = Scale(workers, executor, ray, num_threads, any_processor, on_state)
    scaled = scale.setup(domain, task, policy, time_limit, len(asked))
    setup = scaled or prepare(domain, task, policy, time_limit=time_limit, num_threads=num_threads)
    recipe, processor = _recipe(setup, kept or Kept())
    with Folder(directory, recipe, shard) as folder:
        missing = folder.plan(asked)
        if not missing:
            return
        _check_canary(folder, setup.canary, any_processor)
        call = _call(missing, command, processor, setup.canary, scale)
        folder.log(call)
        saving = _Saving(folder, recipe, len(asked), missing, on_progress)
        with open_workers() if scaled is None else scale.open(len(missing)) as opened, saving:
            made: _Make = functools.partial(_content, recipe)
            if scaled is None:
                made = functools.partial(_episodes, recipe, on_step=saving.on_step)
            units = [Unit(setup, tuple(unit)) for unit in _units(missing, setup.unit_size)]
            for unit, result in opened.results(made, units):
                saving.save(unit.seeds, result)
        folder.log({**call, "ended": _now()})


def _recipe(setup: Setup, kept: Kept) -> tuple[Recipe, str]:
    """The recipe of a setup's episodes, which must end, and the processor here."""
    facts = setup.identity
    if facts["time_limit"] is None:
        raise ValueError(
            f"{facts['domain']} {facts['task']} has no time limit, so an episode might never end: "
            "give it a time_limit (--time-limit SECONDS)"
        )
    here = setup.opened()
    facts = {**facts, "versions": {**facts["versions"], "pyarrow": PYARROW}}
    return recipe_of(facts, vectorisable(here.environment), kept), here.processor


def _call(missing: Sequence[int], command: str, processor: str, canary: str, scale: Scale) -> Facts:
    """An entry of run.json, for everything that the files do not depend on."""
    return {
        "began": _now(),
        "ended": None,
        "command": command,
        "episodes": len(missing),
        "first_seed": missing[0],
        "host": platform.node(),
        "processor": processor,
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
    """The episodes that are saved, in a thread beside the simulation, and those that are played."""

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
        self._waiting = 0  # the same before its end

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

    def save(self, seeds: Sequence[int], made: "bytes | list[Episode]") -> None:
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

    def _save(self, seeds: Sequence[int], made: "bytes | list[Episode]") -> int:
        content = made if isinstance(made, bytes) else encode(self._recipe, made)
        self._folder.add(range(seeds[0], seeds[-1] + 1), content)
        return len(seeds)

    def _report(self) -> None:
        if self._on_progress is not None:
            part = self._waiting + self._steps / self._recipe.step_limit
            self._on_progress(self._recipe.facts["policy"], self._saved, part)


def _content(recipe: Recipe, setup: Setup, seeds: Sequence[int]) -> bytes:
    """The content of the file of some seeds, as a worker makes it."""
    if recipe.facts["versions"]["pyarrow"] != PYARROW:
        raise ValueError(
            f"pyarrow is {PYARROW} in a worker, and {recipe.facts['versions']['pyarrow']} where "
            "the files are written: install the same version, so that the bytes are equal"
        )
    return encode(recipe, _episodes(recipe, setup, seeds))


def _episodes(
    recipe: Recipe, setup: Setup, seeds: Sequence[int], on_step: OnStep | None = None
) -> list[Episode]:
    """The episodes of some seeds, in their order."""
    here = setup.opened()
    starts = Starts(here.full_build)
    batch = batch_for(here.build, here.actor, len(seeds), here.num_threads)
    with contextlib.closing(batch), contextlib.closing(starts):
        played = [
            dataclasses.replace(episode, start=starts.kind(episode.seed))
            for ended in play(batch, here.actor, seeds, recipe.kept, on_step=on_step)
            for episode in ended
        ]
    return sorted(played, key=lambda episode: episode.seed)


def _units(seeds: Sequence[int], size: int) -> Iterator[range]:
    """Blocks of the seeds, or each seed by itself where the policy plays one at a time."""
    if size == SHARD:
        return blocks(seeds)
    return (range(seed, seed + 1) for seed in seeds)


def _checked_seeds(seeds: Iterable[int], shard: tuple[int, int] | None) -> list[int]:
    """The seeds, or those of a shard; raises ValueError or TypeError if they are not increasing."""
    checked = [checked_seed(seed) for seed in seeds]
    if not checked:
        raise ValueError("there are no seeds; expected at least one, such as range(100)")
    for one, following in itertools.pairwise(checked):
        if following <= one:
            raise ValueError(f"seed {following} follows {one}; expected increasing seeds")
    return checked if shard is None else shard_of(checked, *shard)


def _now() -> str:
    return datetime.datetime.now(datetime.UTC).isoformat()
