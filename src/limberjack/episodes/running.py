"""`Run`: episodes that are played, kept, and shown: a result, a page, a plot and a film.

    run = Run("manipulator", "bring_ball", "planner", range(16), out="solved", scale=Scale(4))
    run.play()
    run.write()
    print([episode.total for episode in run.episodes], run.written)

`limberjack run` and `limberjack solve` are this. Steps are kept as a dataset in the same folder
(`limberjack.data`), if the extra `data` is installed, and the same call continues where an earlier
one was killed. The film is that of the first episode, played again from its seed and actions.
"""

import contextlib
import functools
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

import dm_env
import numpy as np

from limberjack import policies, report
from limberjack.episodes.environments import (
    checked_environment,
    checked_repeat,
    inside,
)
from limberjack.episodes.episode import Episode, Kept
from limberjack.episodes.films import drawable
from limberjack.episodes.manifest import EPISODES
from limberjack.episodes.playing import OnStep, Step, play, recorded
from limberjack.episodes.starts import Starts
from limberjack.episodes.units import OnEnded, play_seeds, play_unit
from limberjack.mujoco.fingerprint import fingerprint
from limberjack.policies import Actor
from limberjack.report.folder import RESULT
from limberjack.rl.rows import RowsEnvironment
from limberjack.utils.facts import Facts
from limberjack.utils.seeds import checked_seeds
from limberjack.video import SIZE
from limberjack.workers import OnProgress, Scale, Unit, shard_of, units_of
from limberjack.workers.factories import Make, factory_of

__all__ = ["Run"]

_KEPT = Kept(states=True)


class Run:
    """See the module's docstring.

    Attributes:
      step_limit: steps of an episode.
      written: the files that `write` has written.
      left_out: one line for each reason for leaving out files.
    """

    def __init__(
        self,
        domain: str | Make | dm_env.Environment,
        task: str | None = None,
        policy: object = "zero",
        seeds: Iterable[int] = range(1),
        *,
        out: Path | str | None = None,
        time_limit: float | None = None,
        action_repeat: int | None = None,
        scale: Scale | None = None,
        shard: tuple[int, int] | None = None,
        replaces: bool = False,
        actor: Actor | None = None,
        command: str = "",
    ) -> None:
        """Checks all arguments; nothing is played or written yet.

        Args:
          domain, task, policy, time_limit: as `limberjack.evaluation.evaluate` takes them.
          seeds: increasing.
          out: a folder for the results; None for none.
          action_repeat: control steps per action; None for the environment's own.
          scale: number and kind of workers.
          shard: (K, N) plays only the K-th of N parts of the seeds, and keeps their steps; a run
            without it writes the result.
          replaces: replace the steps of an earlier run of the same task and policy, which may have
            changed; by default it is an error if they are of another one.
          actor: acts in this process in the place of the policy that `policy` names.
          command: the command line as it was typed; empty if there was none.

        Raises:
          ValueError, TypeError: there is no such task or policy, a number is out of range, the
            episodes have no time limit, or the folder holds other results.
          OSError: the folder cannot be written.
        """
        self._where = domain, task
        self._policy = policy
        wanted = checked_seeds(seeds)
        self._seeds = wanted if shard is None else shard_of(wanted, *shard)
        self._wanted = wanted
        self._out = None if out is None else Path(out).absolute()  # a policy may move
        self._time_limit = time_limit
        self._scale = scale or Scale()
        self._shard = shard
        self._replaces = replaces
        self._actor = actor
        self._command = command
        self._ended: dict[int, Episode] = {}
        self._plans: dict[int, list[tuple[str, dict[str, float]]]] = {}
        self._now = wanted[0]  # seed of the episode that began last
        self.written: list[Path] = []
        self.left_out: list[str] = []
        self._factory = factory_of(domain, task, time_limit)
        how = {"is_kept": out is not None, "vectorised": self._scale.vectorised}
        with contextlib.closing(checked_environment(self._factory, wanted, **how)) as one:
            self._facts = self._facts_of(one, action_repeat)
        self._keeps = self._out is not None and self._can_keep()
        if self._out is not None and shard is None:
            # Fails now, not after the last episode.
            report.Recorder(self._out, self._facts, command).close()

    def _facts_of(self, environment: dm_env.Environment, action_repeat: int | None) -> Facts:
        """The facts of the result; raises ValueError if the policy cannot act."""
        inner = inside(environment)
        assert inner.step_limit is not None  # see `checked_environment`
        actor = self._actor or policies.find(self._policy, environment)
        self._action_repeat = checked_repeat(action_repeat, environment, actor)
        self.step_limit = inner.step_limit
        self._fingerprint = fingerprint(inner.physics.model._model)
        seconds = inner.step_limit * inner.control_timestep()
        facts = {
            **self._factory.facts,
            "policy": actor.name,
            "time_limit": seconds if self._time_limit is None else self._time_limit,
            "control_timestep": inner.control_timestep(),
        }
        repeat = {} if self._action_repeat == 1 else {"action_repeat": self._action_repeat}
        return {**facts, **repeat}

    def _can_keep(self) -> bool:
        """Whether steps can be kept; the reason is left out otherwise."""
        try:
            from limberjack.episodes import parquet  # noqa: F401 (whether its extra is there)
        except ImportError as error:
            if self._shard is not None:
                raise ValueError(f"a shard keeps steps, which {error}") from None
            self.left_out.append(f"no episodes: {error}")
            return False
        return True

    @property
    def count(self) -> int:
        """The number of episodes to play."""
        return len(self._seeds)

    @property
    def keeps(self) -> bool:
        """Whether steps are kept, so that the same call continues."""
        return self._keeps

    @property
    def episodes(self) -> list[Episode]:
        """Those that have ended, in the order of their seeds."""
        return [self._ended[seed] for seed in self._seeds if seed in self._ended]

    def add_plan(self, time: float, stage: str, terms: Mapping[str, float]) -> None:
        """Charts a plan of the episode that is running; see `policies.planner`."""
        self._plans.setdefault(self._now, []).append((stage, dict(terms)))

    def play(self, on_progress: OnProgress | None = None) -> None:
        """Plays the episodes that the folder lacks.

        Args:
          on_progress: called as episodes are played, as by `evaluate`.

        Raises:
          PolicyError, PhysicsError, WorkError: one failed; those that ended are kept.
          OSError: a file cannot be written.
        """
        if self._keeps:
            self._collect(on_progress)
        else:
            self._play(on_progress)

    def _collect(self, on_progress: OnProgress | None) -> None:
        """Plays and keeps, and reads what is there in the end."""
        from limberjack.episodes.collecting import collect
        from limberjack.episodes.dataset import load

        assert self._out is not None
        scale = self._scale
        collect(
            *self._where,
            self._policy,
            self._wanted,
            out=self._out,
            kept=_KEPT,
            time_limit=self._time_limit,
            action_repeat=self._action_repeat,
            num_threads=scale.num_threads,
            workers=scale.workers,
            executor=scale.executor,
            ray=scale.ray,
            shard=self._shard,
            any_processor=scale.any_processor,
            vectorised=scale.vectorised,
            replaces=self._replaces and (self._out / RESULT).exists(),
            on_progress=on_progress,
            on_state=scale.on_state,
            on_step=self._watch,
            on_ended=self._end,
            actor=self._actor,
            command=self._command,
        )
        if self._shard is None:
            dataset = load(self._out)
            for seed in self._seeds:
                self._end(dataset.episode(seed))

    def _play(self, on_progress: OnProgress | None) -> None:
        """Plays without keeping steps on the disk."""
        kept = None if self._out is None else Kept()  # for the film
        count, steps = len(self._seeds), 0

        def report_progress() -> None:
            if on_progress is not None:
                on_progress(self._facts["policy"], len(self._ended), steps / self.step_limit)

        def on_step(step: Step) -> None:
            nonlocal steps
            steps += step.count
            self._watch(step)
            report_progress()

        def on_ended(episode: Episode) -> None:
            nonlocal steps
            steps -= episode.length
            self._end(episode)
            report_progress()

        setup = None
        if self._actor is None:
            how = self._time_limit, count, self._action_repeat
            setup = self._scale.setup(*self._where, self._policy, *how)
        report_progress()
        if setup is None:
            self._play_here(kept, on_step, on_ended)
            return
        with self._scale.open(count) as workers:
            units = [Unit(setup, block) for block in units_of(self._seeds, setup.unit_size)]
            function = functools.partial(play_unit, kept=kept)
            for _, ended in workers.results(function, units):
                for episode in ended:
                    on_ended(episode)

    def _play_here(self, kept: Kept | None, on_step: OnStep, on_ended: OnEnded) -> None:
        """Plays in this process."""
        factory, threads = self._factory, self._scale.num_threads
        environment = factory.make(self._seeds[0])
        starts = Starts.of(factory)
        with contextlib.closing(environment), contextlib.closing(starts):
            actor = self._actor
            if actor is None:
                actor = policies.find(self._policy, environment, num_threads=threads)
            blocks = units_of(self._seeds, 1 if actor.plays_alone else policies.ROWS)
            for block in blocks:
                play_seeds(
                    factory.build(environment),
                    starts,
                    actor,
                    block,
                    kept,
                    num_threads=threads,
                    action_repeat=self._action_repeat,
                    vectorised=self._scale.vectorised,
                    on_step=on_step,
                    on_ended=on_ended,
                )

    def _watch(self, step: Step) -> None:
        """Notes which episode is running; one that a planner plays runs by itself."""
        if step.actions is None:
            self._now = int(step.seeds[step.rows[-1]])

    def _end(self, episode: Episode) -> None:
        self._ended[episode.seed] = episode

    def write(self, on_drawn: Callable[[int, int], object] | None = None) -> None:
        """Writes result.json, return.png, video.mp4 and report.html of the episodes that ended.

        Args:
          on_drawn: called with the steps of the film so far, and those in all.

        Raises:
          OSError: a file cannot be written.
        """
        if self._out is None or self._shard is not None:
            return
        run = {**self._facts, "episodes_asked_for": len(self._seeds)}
        with report.Recorder(self._out, self._facts, self._command) as recorder:
            try:
                if self._seeds[0] in self._ended:
                    self._show(recorder, self._ended[self._seeds[0]], on_drawn)
            except BaseException:  # Ctrl-C too: the other files are written
                recorder.drop_episode()
                raise
            finally:
                try:
                    recorder.write(run, self.episodes, self._fingerprint)
                finally:
                    self.written = [*recorder.written]
                    self.left_out += recorder.left_out
        if self._keeps:
            self.written.append(self._out / EPISODES)

    def _show(
        self,
        recorder: report.Recorder,
        episode: Episode,
        on_drawn: Callable[[int, int], object] | None,
    ) -> None:
        """Plays an episode again, for the film and the page."""
        plans = self._plans.get(episode.seed, [])
        make = drawable(self._factory.make, *SIZE)
        batch = RowsEnvironment(make, 1, 1, episode.seed, action_repeat=1)

        def on_step(step: Step) -> None:
            number = int(step.numbers[0])
            if step.actions is None:
                recorder.begin(inside(batch.environments[0]))
            elif number <= len(plans):
                recorder.add_plan(*plans[number - 1])
            recorder.add_step(step.of_row(0))
            if on_drawn is not None:
                on_drawn(number, episode.length)

        actor = recorded({episode.seed: episode.actions})
        how = {"most_steps": episode.length, "on_step": on_step}
        with contextlib.closing(batch):
            ((again,),) = play(batch, actor, [episode.seed], **how)
        recorder.finish_film()
        if not np.array_equal(again.rewards, episode.rewards):  # another processor has played it
            gap = abs(again.total - episode.total)
            self.left_out.append(
                f"the film is not that of seed {episode.seed}: its return differs by {gap:.3g} here"
            )
            recorder.drop_film()
