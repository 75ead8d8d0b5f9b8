"""`Solving`: one call of `limberjack solve`, in this process or with workers.

    solving = Solving("manipulator", "bring_ball", range(16), Scale(workers=4), Path("solved"))
    status = solving.finish()

Recordings are written as their episodes end, and those that are there are not played again. The
film shows the first episode; if that was played elsewhere or earlier, it is replayed.
"""

import contextlib
import dataclasses
import functools
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from limberjack.cli.explaining import explained
from limberjack.cli.output import complain
from limberjack.cli.playing import Playing
from limberjack.cli.progress import Episodes, show_units

if TYPE_CHECKING:
    from limberjack.recording.episodes import Recording
    from limberjack.report import Facts
    from limberjack.rl.control import Environment
    from limberjack.rollout import Episode, OnStep, Step
    from limberjack.workers import Scale

__all__ = ["Solving"]

_PLANNER = "planner"


class Solving(Playing):
    """See the module's docstring."""

    def __init__(
        self,
        domain: str,
        task: str,
        seeds: Sequence[int],
        scale: "Scale",
        out: Path | None = None,
        *,
        time_limit: float | None = None,
        shard: tuple[int, int] | None = None,
        explain: bool = False,
    ) -> None:
        """Checks all arguments.

        Args:
          domain, task: of the episodes.
          seeds: of all shards; that of this call has one at least.
          scale: the workers.
          out: folder of the results.
          time_limit: seconds per episode; the task's own by default.
          shard: number of the part of the seeds that is played, and that of all parts. It writes
            recordings only.
          explain: print the terms of the plans' cost, and chart them on the page; this process
            then plays all episodes.

        Raises:
          ValueError: an argument is invalid, or the folder holds other results.
          OSError: the folder cannot be written.
        """
        from limberjack.workers import WorkError, shard_of

        self.expected = (OSError, WorkError)  # a recording that cannot be written, a lost worker
        mine = seeds if shard is None else shard_of(seeds, *shard)
        self._out = out
        self._scale = scale
        self._shard = shard
        self._explain = explain
        self._names = {seed: f"episode-{seed}.npz" for seed in seeds}
        self._facts: Facts = {}
        self._ended: dict[int, Episode] = {}  # in earlier calls or other processes
        super().__init__(domain, task, mine, _PLANNER, time_limit, None if shard else out)
        self._facts["time_limit"] = self._about["time_limit"]
        self._holding = contextlib.ExitStack()
        try:
            self._check_folder()
            missing = len(mine) - len(self._ended)
            if explain:
                self._setup = None
            else:
                self._setup = scale.setup(domain, task, _PLANNER, time_limit, missing)
        except BaseException:
            self.close()
            raise

    def finish(self) -> int:
        """Plays, writes and prints; returns the exit status and raises unexpected errors."""
        with self._holding:
            return super().finish()

    def close(self) -> None:
        """Lets other processes write to the folder."""
        self._holding.close()
        if self._recorder is not None:
            self._recorder.close()

    def report(self, failure: BaseException | None) -> int | None:
        """Writes and prints the episodes; returns the exit status, None for unknown failures."""
        if self._out is not None:
            ended = [episode.seed for episode in self._episodes]
            self._recordings = [self._out / self._names[seed] for seed in ended]
        status = super().report(failure)
        if self._shard is not None:
            typer.echo(
                f"shard {self._shard[0]}/{self._shard[1]}: {len(self._episodes)} recordings are in "
                f"{self._out}; the same command without --shard joins all shards"
            )
        return status

    def play(self) -> BaseException | None:
        """Runs the episodes; returns the error or interrupt that ended them early, if any."""
        failure = None if self._setup is None else self._play_elsewhere()
        if failure is None:
            return super().play()
        self._episodes = [self._ended[seed] for seed in self._seeds if seed in self._ended]
        return failure

    def _play_elsewhere(self) -> BaseException | None:
        """Workers play what is missing; this process writes it."""
        from limberjack.recording.solving import recordings
        from limberjack.rollout import Episode

        assert self._setup is not None
        missing = [seed for seed in self._seeds if seed not in self._ended]
        try:
            with show_units() as progress:
                progress.begin(len(self._seeds))
                progress.show(_PLANNER, len(self._ended))
                scale = dataclasses.replace(self._scale, on_state=progress.show_state)
                with scale.open(len(missing)) as workers:
                    for seed, recording in recordings(workers, self._setup, missing):
                        self._save(seed, recording)
                        start = recording.about["start"]
                        self._ended[seed] = Episode(seed, start, recording.rewards)
                        progress.show(_PLANNER, len(self._ended))
        except BaseException as failure:  # Ctrl-C too: finished episodes are kept
            return failure
        return None

    def _play_episode(self, seed: int, progress: Episodes) -> "Episode":
        if seed not in self._ended:
            return super()._play_episode(seed, progress)
        if self._recorder is not None and seed == self._seeds[0]:
            self._film_again(seed, progress)
        return self._ended[seed]

    def _play_in(self, environment: "Environment", seed: int, on_step: "OnStep") -> "Episode":
        from limberjack import policies, rollout
        from limberjack.recording.episodes import Transcript
        from limberjack.workers.identity import processor

        transcript = Transcript(environment)

        def add(step: "Step") -> None:
            transcript.add(step)
            on_step(step)

        threads = self._scale.num_threads
        if self._explain:
            planner = explained(threads, functools.partial(self._add_plan, seed))
        else:
            planner = policies.planner_with(threads)
        episode = rollout.run_episode(environment, planner, seed, on_step=add)
        about: Facts = {"seed": seed, "start": episode.start}
        if self._scale.any_processor:
            about["processor"] = processor()
        self._save(seed, transcript.recording(about))
        return episode

    def _add_plan(self, seed: int, stage: str, terms: "Mapping[str, float]") -> None:
        """Charts a plan of the episode that the page shows."""
        if self._recorder is not None and seed == self._seeds[0]:
            self._recorder.add_plan(stage, terms)

    def _save(self, seed: int, recording: "Recording") -> None:
        if self._out is None:
            return
        about = {**recording.about, **self._facts}
        dataclasses.replace(recording, about=about).save(self._out / self._names[seed])

    def _film_again(self, seed: int, progress: Episodes) -> None:
        """Replays the recording of the first episode for the film and the page."""
        from limberjack.recording.episodes import Recording, replay

        assert self._out is not None
        assert self._recorder is not None
        recording = Recording.load(self._out / self._names[seed])
        with contextlib.closing(self._load(seed)) as environment:
            environment.reset()
            self._recorder.begin(environment)
            difference = replay(recording, environment, self._shown(seed, progress))
            if difference is not None:  # another processor has played it
                complain(f"the film is not that of {self._names[seed]}: {difference}")
                self._recorder.drop_film()
            self._recorder.finish_film()

    def _prepare(self, environment: "Environment") -> None:
        from limberjack.factories import factory_of
        from limberjack.planner import cost_for
        from limberjack.policies import actors
        from limberjack.workers.identity import canary_of, identity_of

        cost_for(environment.task)
        factory = factory_of(*self._where, self._time_limit)
        found = actors.find(_PLANNER, environment)
        self._facts = {
            **identity_of(factory, found, environment),
            "canary": canary_of(factory),
        }

    def _names_of_recordings(self) -> list[str]:
        return list(self._names.values())

    def _check_folder(self) -> None:
        """Takes over the recordings that are there; raises ValueError if others are."""
        from limberjack.recording.episodes import Recording
        from limberjack.report.folder import check_folder
        from limberjack.rollout import Episode
        from limberjack.utils.files import Hold

        if self._out is None:
            return
        if self._shard is not None:  # without one, the recorder holds the whole folder
            self._out.mkdir(parents=True, exist_ok=True)
            check_folder(self._out, self._about, self._names_of_recordings())
            name = "episodes-{}-of-{}".format(*self._shard)
            self._holding.enter_context(Hold(self._out / name))
        for seed in self._seeds:
            path = self._out / self._names[seed]
            if os.path.lexists(path):
                recording = Recording.load(path)
                self._check_facts(path, recording.about, seed)
                self._ended[seed] = Episode(seed, recording.about.get("start"), recording.rewards)

    def _check_facts(self, path: Path, about: "Facts", seed: int) -> None:
        """Raises ValueError unless a recording is that of the seed's episode in this call."""
        from limberjack.workers.identity import advice_on, first_mismatch

        if not isinstance(about.get("start"), str | None):
            raise ValueError(f"{path} was recorded with start {about['start']!r}: remove that file")
        expected = {**self._facts, "seed": seed}
        mismatch = first_mismatch(expected, about, self._scale.any_processor)
        if mismatch is not None:
            name, expected, found = mismatch
            raise ValueError(
                f"{path} was recorded with {name} {found!r}, and this call has {expected!r}: "
                f"choose another folder, or remove that file{advice_on(name)}"
            )
