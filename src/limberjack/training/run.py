"""`train`: one task, one algorithm, one folder; the same call continues what was killed.

    run = train("walker", "walk", out="walker", seed=0)
    run.curve[-1].mean          # the return of the final policy on ten seeds of its own
    run.policy                  # walker/policy.safetensors, for `--policy mlp:PATH`

A run of a finished folder only reports it. Rows, evaluation and users' episodes have seeds of
different blocks: see `_ROWS` and `_EVALUATION`.
"""

import dataclasses
import importlib
import math
import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import cast

import dm_env
import numpy as np

from limberjack import gym
from limberjack.episodes.environments import inside, seconds_without_a_limit, step_limit_of
from limberjack.mujoco.fingerprint import fingerprint, versions
from limberjack.policies import mlp
from limberjack.rl.action_specs import bounds_to_try
from limberjack.rl.batches import batch_of
from limberjack.rl.pixels import PIXELS_KEY
from limberjack.see.report import LearningCurve, write_learning_plot
from limberjack.training.curves import learning_of
from limberjack.training.folder import POLICY, Folder
from limberjack.training.settings import Settings, settings_for
from limberjack.utils.facts import Facts, title_of
from limberjack.utils.seeds import checked_seed
from limberjack.workers import WorkError
from limberjack.workers.factories import Factory, Make, factory_of

__all__ = ["Evaluation", "Run", "TrainingError", "train"]

# Blocks of seeds, which no one else uses by default: `evaluate` begins at 0.
_ROWS = 1_000_000_000  # row i of the run with seed s begins with _ROWS + 1000 * s + i
_ROWS_OF_A_RUN = 1000
_EVALUATION = 2_100_000_000
_EPISODES = 10  # of an evaluation: their mean has a tenth of the variance
_EVALUATIONS = 20  # after the one at the beginning; together they take a few % of the time
_RUNS = 1_000_000  # seeds of runs
_PATIENCE = 60.0  # seconds after which there is another checkpoint
_SHARE = 50  # at least this many times as long as the last one took

_OnProgress = Callable[[int, int, float], object]
_FORMAT = 1  # of the folder
_COLUMNS = (
    *("control_steps", "agent_steps", "processor_seconds", "mean"),
    *(f"return_{number}" for number in range(1, _EPISODES + 1)),
)


class TrainingError(WorkError):
    """A run that cannot go on, such as one whose losses are no numbers."""


@dataclasses.dataclass(frozen=True)
class Evaluation:
    """Returns of the policy without exploration, at one moment of a run.

    Attributes:
      control_steps: of all rows so far; an action counts fully where an episode ends within it.
      agent_steps: actions of all rows so far.
      processor_seconds: of this process and those before it, evaluations included.
      returns: of ten episodes, which are the same in all runs of a task.
    """

    control_steps: int
    agent_steps: int
    processor_seconds: float
    returns: tuple[float, ...]

    @property
    def mean(self) -> float:
        """The mean of the returns."""
        return statistics.fmean(self.returns)


@dataclasses.dataclass(frozen=True)
class Run:
    """A finished run.

    Attributes:
      policy: the file of the final policy.
      curve: the evaluations; the last one is of the final policy.
      settings: the numbers of the run.
      was_finished: whether an earlier call had finished it.
      picture: of the curve, beside those of the runs that the package knows; None without one.
      left_out: the reason why there is no picture.
    """

    policy: Path
    curve: tuple[Evaluation, ...]
    settings: Settings
    was_finished: bool
    picture: Path | None = None
    left_out: str | None = None


def train(
    domain: str | Make,
    task: str | None = None,
    *,
    out: Path | str,
    steps: int | None = None,
    seed: int = 0,
    settings: Settings | None = None,
    on_progress: _OnProgress | None = None,
    command: str = "",
) -> Run:
    """Trains a policy with CrossQ, or continues a run that was killed, or reports a finished one.

    A run that was killed continues from its last checkpoint and gives the same policy, bit for bit,
    on one kind of processor with the same packages.

    Args:
      domain: such as 'walker', or a function `make(seed) -> dm_env.Environment`.
      task: such as 'walk'; None with a function.
      out: the folder of the run, which is made if there is none.
      steps: control steps of the run; None for those of the settings.
      seed: below 1,000,000, of the networks, the exploration and the rows.
      settings: None for the table's row of the domain; see `limberjack.training.settings`.
      on_progress: called before each step with the control steps so far, those of the run, and the
        mean of the last evaluation.
      command: that trains, for the policy's card.

    Raises:
      ImportError: a package of the extra `train` is missing.
      ValueError: there is no such task, or it cannot be trained, or a number is out of range; or
        the folder has another run, other settings or other files, or another process writes there.
      TrainingError: the losses are no numbers; the last checkpoint is kept.
      OSError: a file cannot be written; the last checkpoint is kept.
    """
    if checked_seed(seed) >= _RUNS:
        raise ValueError(f"seed is {seed}; expected a whole number below {_RUNS}")
    settings = settings or settings_for(domain if isinstance(domain, str) else "")
    if steps is not None:
        settings = dataclasses.replace(settings, steps=steps)
    if callable(domain) and settings.time_limit is not None:
        raise ValueError(
            f"time_limit is {settings.time_limit}, but a function makes the environment: set it "
            "there"
        )
    began = time.process_time()
    if not (Path(out) / POLICY).exists():  # a finished run is reported without the packages
        importlib.import_module("limberjack.training.learner")
    factory = factory_of(domain, task, settings.time_limit)
    environment = _checked(factory, settings)
    identity, more = _facts(factory, environment, settings, seed), {"command": command}
    folder = Folder(Path(out), identity, {**more, "versions": versions()})
    stream = np.random.get_state()  # NumPy's global one, which the algorithm draws from
    try:
        if folder.is_finished:
            folder.finish()
            run = Run(folder.policy, _read_curve(folder.curve), settings, True)
            return _with_picture(run, folder, identity)
        training = _Training(folder, factory, settings, seed, began)
        try:
            training.run(on_progress)
            mlp.save(folder.policy, training.learner.layers(), training.card(identity, command))
        finally:
            training.close()
        folder.finish()
        run = Run(folder.policy, tuple(training.curve), settings, False)
        return _with_picture(run, folder, identity)
    finally:
        np.random.set_state(stream)
        folder.close()


def _with_picture(run: Run, folder: Folder, identity: Facts) -> Run:
    """The run with a picture of its curve, which is drawn unless there is one."""
    if not folder.picture.exists():
        known = learning_of(identity.get("domain", ""), identity.get("task", ""))
        own = LearningCurve(
            f"this run, seed {identity['seed']}",
            np.array([one.control_steps for one in run.curve]),
            np.array([one.processor_seconds for one in run.curve]),
            np.array([one.mean for one in run.curve]),
        )
        drawn = known._replace(title=title_of(identity), own=own)
        try:
            write_learning_plot(folder.picture, [drawn])
        except ImportError as error:
            return dataclasses.replace(run, left_out=f"no {folder.picture.name}: {error}")
    return dataclasses.replace(run, picture=folder.picture)


def _checked(factory: Factory, settings: Settings) -> dm_env.Environment:
    """An environment of the factory; raises ValueError if it cannot be trained."""
    if not factory.is_known:
        raise ValueError(
            f"{factory.title} cannot be distinguished from other functions of that name, so a run "
            "cannot be continued: define make(seed) at the top level of a module"
        )
    environment = factory.make(0)
    if inside(environment).step_limit is None:
        raise ValueError(
            f"{factory.title} has no time limit, so an episode might never end: give it one, or a "
            "task named by its domain time_limit = SECONDS in its settings"
        )
    if PIXELS_KEY in cast(Mapping[str, object], environment.observation_spec()):
        raise ValueError(f"{factory.title} observes pictures; expected numbers only")
    if settings.num_envs > _ROWS_OF_A_RUN:
        raise ValueError(f"num_envs is {settings.num_envs}; expected at most {_ROWS_OF_A_RUN}")
    return environment


def _facts(
    factory: Factory, environment: dm_env.Environment, settings: Settings, seed: int
) -> Facts:
    """Facts that identify a run, as values of JSON."""
    return {
        "format": _FORMAT,
        **factory.facts,
        "fingerprint": fingerprint(inside(environment).physics.model._model),
        "algorithm": "CrossQ",
        "seed": seed,
        "settings": dataclasses.asdict(settings),
    }


def _of_evaluations(factory: Factory) -> Factory:
    """The factory of episodes that are as long as the task's, whatever was trained."""
    whole = factory.lasting()
    environment = whole.make(0)
    if step_limit_of(environment) is not None:
        return whole
    return factory.lasting(seconds_without_a_limit(environment))


class _Training:
    """A run in memory: the learner, its rows, the rows of evaluations, and the curve."""

    def __init__(
        self,
        folder: Folder,
        factory: Factory,
        settings: Settings,
        seed: int,
        began: float,
    ) -> None:
        from limberjack import sb3
        from limberjack.training.learner import Learner

        def rows(factory: Factory, count: int, first: int, stagger: bool) -> sb3.VecEnv:
            batch = batch_of(
                factory.build(factory.make(0)),
                count,
                1,  # thread, for a few percent of the time
                seed=first,
                action_repeat=settings.action_repeat,
                stagger=stagger,
            )
            envs = gym.VectorEnv(batch, autoreset_mode="SameStep", flat=True, dtype="float32")
            return sb3.VecEnv(envs, first, settings.action_bound)

        self._folder, self._settings, self._seed = folder, settings, seed
        self._began = began  # processor time of this process when it began
        first = _ROWS + _ROWS_OF_A_RUN * seed
        self._envs = rows(factory, settings.num_envs, first, True)
        self._tested = rows(_of_evaluations(factory), _EPISODES, _EVALUATION, False)
        self.learner = Learner(self._envs, settings, seed, first, folder.events)
        self.curve: list[Evaluation] = []
        self._save_at = time.monotonic() + _PATIENCE
        self._restore()

    def run(self, on_progress: _OnProgress | None) -> None:
        """Learns until the steps are taken, and evaluates the final policy."""

        def before_step() -> None:
            self._check_losses()
            if self._control_steps * _EVALUATIONS >= self._settings.steps * len(self.curve):
                self._evaluate()
                self._save()
            elif time.monotonic() > self._save_at:
                self._save()
            if on_progress is not None:
                on_progress(self._control_steps, self._settings.steps, self.curve[-1].mean)

        self.learner.learn(before_step)
        self._check_losses()
        if self.curve[-1].control_steps < self._control_steps:
            self._evaluate()
            self._save()

    def card(self, identity: Facts, command: str) -> mlp.Card:
        """The card of the final policy."""
        spec = self._envs.vector_env.batches[0].single_action_spec()
        low, high = bounds_to_try(spec, self._settings.action_bound)
        return mlp.Card(
            layout=tuple((part.name, tuple(part.shape)) for part in self._envs.vector_env.layout),
            low=tuple(np.broadcast_to(low, spec.shape).ravel().tolist()),
            high=tuple(np.broadcast_to(high, spec.shape).ravel().tolist()),
            activation="relu",
            end="tanh",
            action_repeat=self._settings.action_repeat,
            domain=identity.get("domain", ""),
            task=identity.get("task", ""),
            algorithm=identity["algorithm"],
            command=command,
            seeds=(self._seed,),
            steps=self._control_steps,
            versions=versions(),
            fingerprint=identity["fingerprint"],
        )

    def close(self) -> None:
        """Frees the rows and closes the file of events."""
        self.learner.close()
        self._envs.close()
        self._tested.close()

    @property
    def _control_steps(self) -> int:
        return self.learner.actions_taken * self._settings.action_repeat

    @property
    def _processor_seconds(self) -> float:
        return time.process_time() - self._began

    def _check_losses(self) -> None:
        bad = {name: x for name, x in self.learner.losses().items() if not math.isfinite(x)}
        for name, value in bad.items():
            raise TrainingError(
                f"{name} is {value} after {self._control_steps} control steps; the last checkpoint "
                "is kept, but would get there again: train in another folder with another seed or "
                "other settings"
            )

    def _evaluate(self) -> None:
        """Plays the episodes of evaluations, and adds their returns to the curve."""
        envs = self._tested
        envs.seed(_EVALUATION)
        observations = envs.reset()
        returns, running = np.zeros(_EPISODES), np.ones(_EPISODES, bool)
        while running.any():
            observations, rewards, dones, _ = envs.step(self.learner.act(np.asarray(observations)))
            returns += np.where(running, rewards, 0.0)
            running &= ~dones
        self.curve.append(
            Evaluation(
                self._control_steps,
                self.learner.actions_taken,
                round(self._processor_seconds, 2),
                tuple(returns.tolist()),
            )
        )
        self._folder.write_curve(_COLUMNS, _numbers(self.curve))
        values = {"return": self.curve[-1].mean, "processor_seconds": self._processor_seconds}
        events = {f"evaluation/{name}": value for name, value in values.items()}
        self.learner.write_events(self._control_steps, events)

    def _save(self) -> None:
        """Writes a checkpoint; a longer one, of more transitions, is written less often."""
        began = time.monotonic()
        self._folder.save(
            {
                "learner": self.learner.state(),
                "rows": self._envs.vector_env.batches[0].snapshot(),
                "curve": self.curve,
                "processor_seconds": self._processor_seconds,
            }
        )
        now = time.monotonic()
        self._save_at = now + max(_PATIENCE, _SHARE * (now - began))

    def _restore(self) -> None:
        """Continues from the checkpoint, if there is one."""
        state = self._folder.load()
        if state is None:
            return
        self._envs.reset()
        self._envs.vector_env.batches[0].restore(state["rows"])
        self.learner.restore(state["learner"])
        self.curve = state["curve"]
        self._began -= state["processor_seconds"]


def _numbers(curve: Sequence[Evaluation]) -> np.ndarray:
    """The lines of curve.csv."""
    return np.array([[*dataclasses.astuple(one)[:-1], one.mean, *one.returns] for one in curve])


def _read_curve(path: Path) -> tuple[Evaluation, ...]:
    """The evaluations in curve.csv; raises ValueError if it is damaged."""
    try:
        lines = np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2).tolist()
        return tuple(Evaluation(int(a), int(b), c, tuple(x)) for a, b, c, _, *x in lines)
    except ValueError as error:
        raise ValueError(f"{path} is damaged ({error})") from error
