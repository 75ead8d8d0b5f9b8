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
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

import dm_env
import numpy as np

from limberjack.episodes.environments import inside
from limberjack.episodes.episode import Episode, Kept
from limberjack.episodes.films import drawable
from limberjack.episodes.manifest import EPISODES
from limberjack.episodes.places import local
from limberjack.episodes.player import Player, Progress
from limberjack.episodes.playing import Step, play, recorded
from limberjack.policies import Actor
from limberjack.rl.rows import RowsEnvironment
from limberjack.see import report
from limberjack.see.report.result import RESULT
from limberjack.see.video import SIZE
from limberjack.utils.facts import Facts
from limberjack.utils.seeds import checked_seeds
from limberjack.workers import OnProgress, Scale
from limberjack.workers.factories import Make
from limberjack.worlds import World

__all__ = ["Run"]

_KEPT = Kept(states=True)


class Run:
    """See the module's docstring.

    Attributes:
      keeps: whether steps are kept, so that the same call continues.
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
        world: World | None = None,
        command: str = "",
    ) -> None:
        """Checks all arguments; nothing is played or written yet.

        Args:
          domain, task, policy, time_limit, world: as `limberjack.evaluation.evaluate` takes them.
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
        self._out = None if out is None else local(out)
        self._shard = shard
        self._replaces = replaces
        self._command = command
        self._ended: dict[int, Episode] = {}
        self._plans: dict[int, list[tuple[str, dict[str, float]]]] = {}
        self.written: list[Path] = []
        self.left_out: list[str] = []
        self._player = Player(
            domain,
            task,
            policy,
            checked_seeds(seeds),
            time_limit=time_limit,
            action_repeat=action_repeat,
            scale=scale,
            shard=shard,
            is_kept=out is not None,
            actor=actor,
            world=world,
        )
        try:
            self._seeds = self._player.seeds
            self._now = self._player.wanted[0]  # seed of the episode that began last
            self._facts = self._facts_of(self._player.identity)
            self.keeps = self._out is not None and self._can_keep()
            if self._out is not None and shard is None:
                # Fails now, not after the last episode.
                report.Recorder(self._out, self._facts, command).close()
        except BaseException:
            self._player.close()
            raise

    def _facts_of(self, identity: Facts) -> dict[str, object]:
        """The facts of the result."""
        names = [*self._player.factory.facts, "policy", "time_limit", "control_timestep"]
        if self._player.action_repeat != 1:
            names.append("action_repeat")
        if identity["world"] is not None:
            names.append("world")
        return {name: identity[name] for name in names}

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
        with contextlib.closing(self._player):
            if self.keeps:
                self._collect(on_progress)
            else:
                self._play(on_progress)

    def _collect(self, on_progress: OnProgress | None) -> None:
        """Plays and keeps, and reads what is there in the end."""
        from limberjack.episodes.collecting import collect_with
        from limberjack.episodes.loading import episodes_so_far, load

        assert self._out is not None
        is_ours = False  # the folder, of which it is certain once there is progress

        def report(what: str, finished: int, part: float = 0.0) -> None:
            nonlocal is_ours
            is_ours = True
            if on_progress is not None:
                on_progress(what, finished, part)

        try:
            collect_with(
                self._player,
                self._out,
                _KEPT,
                shard=self._shard,
                replaces=self._replaces and (self._out / RESULT).exists(),
                on_progress=report,
                on_step=self._watch,
                on_ended=self._end,
                command=self._command,
            )
        except BaseException:  # Ctrl-C too: episodes of earlier calls are shown as well
            if is_ours and self._shard is None:
                for episode in episodes_so_far(self._out):
                    self._end(episode)
            raise
        if self._shard is None:
            dataset = load(self._out)
            for seed in self._seeds:
                self._end(dataset.episode(seed))

    def _play(self, on_progress: OnProgress | None) -> None:
        """Plays without keeping steps on the disk."""
        player = self._player
        progress = Progress(on_progress, player.step_limit)
        progress.policy = player.actor.name

        def watch(step: Step) -> None:
            self._watch(step)
            progress.on_step(step)

        def end(episode: Episode) -> None:
            if episode.seed not in self._ended:
                self._end(episode)
                progress.on_ended(episode)

        progress.report()
        kept = None if self._out is None else Kept()  # for the film
        for _, episodes in player.results(player.units(player.seeds), list, kept, watch, end):
            for episode in episodes:
                end(episode)

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
                    recorder.write(run, self.episodes, self._player.identity["fingerprint"])
                finally:
                    self.written = [*recorder.written]
                    self.left_out += recorder.left_out
        if self.keeps and (self._out / EPISODES).exists():
            self.written.append(self._out / EPISODES)

    def _show(
        self,
        recorder: report.Recorder,
        episode: Episode,
        on_drawn: Callable[[int, int], object] | None,
    ) -> None:
        """Plays an episode again, for the film and the page."""
        plans = self._plans.get(episode.seed, [])
        make = drawable(self._player.factory.make, *SIZE)
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
        # Another processor has played it.
        if not np.array_equal(again.rewards, episode.rewards, equal_nan=True):
            gap = abs(again.total - episode.total)
            self.left_out.append(
                f"the film is not that of seed {episode.seed}: its return differs by {gap:.3g} here"
            )
            recorder.drop_film()
