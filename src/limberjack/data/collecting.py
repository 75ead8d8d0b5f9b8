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
import dataclasses
import datetime
import functools
import itertools
import platform
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from pathlib import Path

from limberjack.data.episode import Episode
from limberjack.data.folder import Folder, blocks
from limberjack.data.parquet import PYARROW, encode
from limberjack.data.playing import Recorded, actions_of, play
from limberjack.data.recipe import FILE_MB, UNIT, Kept, Recipe, recipe_of
from limberjack.evaluation.runner import OnProgress
from limberjack.evaluation.starts import kind_of_start
from limberjack.report import Facts
from limberjack.rl.batches import vectorisable
from limberjack.utils.seeds import checked_seed
from limberjack.workers import OnState, Setup, Unit, open_workers, prepare, shard_of
from limberjack.workers.identity import advice_on
from limberjack.workers.scale import Scale

__all__ = ["collect"]

_OnSteps = Callable[[int], object]
_Make = Callable[[Setup, tuple[int, ...]], "bytes | list[Episode]"]


def collect(
    domain: str,
    task: str,
    policy: object = "zero",
    seeds: Iterable[int] = range(100),
    *,
    out: Path | str,
    kept: Kept | None = None,
    file_mb: float = FILE_MB,
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
      file_mb: megabytes of a file before compression, by which its number of seeds is chosen: as
        many as have room if all episodes have full length, and at least one.
      time_limit: seconds per episode; the task's own by default.
      num_threads, workers, executor, ray: who plays, as for `limberjack.evaluation.evaluate`.
      shard: (K, N) plays only the K-th of N parts of the seeds; they share the folder, which a call
        without `shard` completes.
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
    wanted, directory = _checked_seeds(seeds), Path(out).absolute()  # a policy may move
    asked = wanted if shard is None else shard_of(wanted, *shard)
    scale = Scale(workers, executor, ray, num_threads, any_processor, on_state)
    scaled = scale.setup(domain, task, policy, time_limit, len(asked))
    setup = scaled or prepare(domain, task, policy, time_limit=time_limit, num_threads=num_threads)
    recipe, processor = _recipe(setup, kept or Kept(), file_mb)
    with Folder(directory, recipe, shard) as folder:
        missing = folder.plan(wanted, asked)
        if not missing:
            folder.finish()
            return
        _check_canary(folder, setup.canary, any_processor)
        call = _call(missing, command, processor, setup.canary, scale)
        folder.log(call)
        saving = _Saving(folder, recipe, len(asked), missing, on_progress)
        with open_workers() if scaled is None else scale.open(len(missing)) as opened, saving:
            made: _Make = functools.partial(_content, recipe)
            if scaled is None:
                made = functools.partial(_episodes, recipe, on_steps=saving.on_steps)
            units = [Unit(setup, tuple(unit)) for unit in _units(missing, setup.unit_size, recipe)]
            for unit, result in opened.results(made, units):
                saving.save(unit.seeds, result)
        folder.finish()
        folder.log({**call, "ended": _now()})


def _recipe(setup: Setup, kept: Kept, file_mb: float) -> tuple[Recipe, str]:
    """The recipe of a setup's episodes, which must end, and the processor here."""
    facts = setup.identity
    if facts["time_limit"] is None:
        raise ValueError(
            f"{facts['domain']} {facts['task']} has no time limit, so an episode might never end: "
            "give it a time_limit (--time-limit SECONDS)"
        )
    here = setup.opened()
    facts = {**facts, "versions": {**facts["versions"], "pyarrow": PYARROW}}
    return recipe_of(facts, vectorisable(here.environment), kept, file_mb), here.processor


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

    def on_steps(self, count: int) -> None:
        """Counts steps of episodes that are not saved yet."""
        self._steps += count
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
    recipe: Recipe, setup: Setup, seeds: Sequence[int], on_steps: _OnSteps | None = None
) -> list[Episode]:
    """The episodes of some seeds, in their order."""
    here = setup.opened()
    environment = vectorisable(here.environment)
    found, threads = here.found, here.num_threads
    if found.actor is not None:
        episodes = play(environment, found.actor, seeds, recipe.kept, threads, on_steps)
    else:
        assert found.alone is not None
        actions = {s: actions_of(environment, found.alone, s, on_steps) for s in seeds}
        episodes = play(environment, Recorded(actions), seeds, recipe.kept, threads)
    full_length = vectorisable(here.full_length)
    return [
        dataclasses.replace(one, start=kind_of_start(full_length, one.seed)) for one in episodes
    ]


def _units(seeds: Sequence[int], size: int, recipe: Recipe) -> Iterator[range]:
    """The seeds of each file in ranges of up to 64, or of one if the policy plays one at a time."""
    size = min(size, UNIT)
    for block in blocks(seeds, recipe.block):
        for first in range(block.start, block.stop, size):
            yield range(first, min(first + size, block.stop))


def _checked_seeds(seeds: Iterable[int]) -> list[int]:
    """The seeds; raises ValueError or TypeError if they are not increasing."""
    checked = [checked_seed(seed) for seed in seeds]
    if not checked:
        raise ValueError("there are no seeds; expected at least one, such as range(100)")
    for one, following in itertools.pairwise(checked):
        if following <= one:
            raise ValueError(f"seed {following} follows {one}; expected increasing seeds")
    return checked


def _now() -> str:
    return datetime.datetime.now(datetime.UTC).isoformat()
