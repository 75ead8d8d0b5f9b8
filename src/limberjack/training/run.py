"""`train`: one task, one algorithm, one folder; the same call continues what was killed.

    run = train("walker", "walk", out="walker", seed=0)
    run.curve[-1].mean          # the return of the final policy on ten seeds of its own
    run.policy                  # walker/policy.safetensors, for `--policy mlp:PATH`

A run of a finished folder only reports it. Rows, evaluation and users' episodes have seeds of
different blocks: see `_ROWS` and `_EVALUATED`.
"""

import contextlib
import dataclasses
import importlib
import math
import pickle
import random
import statistics
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import cast

import dm_env
import numpy as np

from limberjack.episodes.dataset import Dataset
from limberjack.episodes.environments import (
    checked_environment,
    inside,
    seconds_without_a_limit,
)
from limberjack.episodes.places import local
from limberjack.episodes.playing import play
from limberjack.mujoco.fingerprint import fingerprint, versions
from limberjack.policies import LearningCurve, PolicyError, learning_of, mlp
from limberjack.policies.actors import Batched
from limberjack.policies.networks import layout_of
from limberjack.rl.action_specs import spec_of
from limberjack.rl.batches import batch_of
from limberjack.rl.builds import own_repeat
from limberjack.rl.control import shown_by
from limberjack.rl.pixels import PIXELS_KEY
from limberjack.rl.row_step import as_mapping
from limberjack.see.report import write_learning_plot
from limberjack.training.demonstrations import check_of_task, demonstrations_of, identity_of
from limberjack.training.folder import POLICY, Folder, opened
from limberjack.training.settings import MOST_ROWS, Settings, settings_for
from limberjack.utils.facts import Facts, title_of
from limberjack.utils.seeds import checked_seed
from limberjack.utils.turns import Turn
from limberjack.workers import WorkError
from limberjack.workers.factories import Factory, Make, factory_of
from limberjack.worlds import World

__all__ = ["Evaluation", "Run", "TrainingError", "train"]

# Blocks of seeds, which no one else uses by default: `evaluate` begins at 0.
_ROWS = 1_000_000_000  # row i of the run with seed s begins with _ROWS + MOST_ROWS * s + i
# Of an evaluation: the mean of ten episodes has a tenth of the variance.
_EVALUATED = range(2_100_000_000, 2_100_000_010)
_EVALUATIONS = 20  # after the one at the beginning; together they take a few % of the time
_RUNS = 1_000_000  # seeds of runs
_PATIENCE = 60.0  # seconds after which there is another checkpoint
_SHARE = 50  # at least this many times as long as the last one took

_turn = Turn()  # the global random streams belong to the process

_OnProgress = Callable[[int, int, float], object]
_FORMAT = 1  # of the folder
_COLUMNS = (
    *("control_steps", "agent_steps", "processor_seconds", "mean"),
    *(f"return_{number}" for number in range(1, len(_EVALUATED) + 1)),
)


class _Facts(Facts):
    """Of a run: what `_identified` gives, and the command that began it."""

    algorithm: str
    seed: int
    command: str


class TrainingError(WorkError):
    """A run that cannot go on, such as one whose losses are no numbers."""

    would_recur = True


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
    world: World | None = None,
    demonstrations: Dataset | None = None,
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
      settings: None for the table's row of the task or domain; see `limberjack.training.settings`.
      on_progress: called before each step with the control steps so far, those of the run, and the
        mean of the last evaluation.
      command: that trains, for the policy's card.
      world: options such as {'faults': 'easy'}, in which episodes of training and of evaluations
        are played; None with a function, which sets them itself.
      demonstrations: episodes of the task, of which half of each batch is drawn from the beginning
        on (Ball et al., 2023, https://arxiv.org/abs/2302.02948); see `limberjack.data.load`.

    Raises:
      ImportError: a package of the extra `train` is missing.
      ValueError: there is no such task, or it cannot be trained, or a number is out of range, or
        the demonstrations are of another task; or the folder has another run, other settings or
        other files, or another process writes there.
      RuntimeError: another thread of this process trains.
      TrainingError: the losses are no numbers; the last checkpoint is kept. Or the environment
        cannot be saved in one.
      OSError: a file cannot be written; the last checkpoint is kept.
    """
    seed = checked_seed(seed)
    if seed >= _RUNS:
        raise ValueError(f"seed is {seed}; expected a whole number below {_RUNS}")
    settings = settings or settings_for(domain if isinstance(domain, str) else "", task)
    if steps is not None:
        settings = dataclasses.replace(settings, steps=steps)
    if callable(domain) and settings.time_limit is not None:
        raise ValueError(
            f"time_limit is {settings.time_limit}, but a function makes the environment: set it "
            "there"
        )
    directory = local(out)
    began = time.process_time()
    with contextlib.ExitStack() as stack:
        if not (directory / POLICY).exists():  # a finished run is reported without the packages
            _check_learns(settings)
            _take_streams(stack)
        factory = factory_of(domain, task, settings.time_limit, world)
        identity = _identified(factory, settings, seed, demonstrations)
        more: dict[str, object] = {"command": command, "versions": versions()}
        folder = stack.enter_context(opened(directory, identity, more))
        was_finished = folder.policy.exists()
        if not was_finished:
            facts = cast(_Facts, {**identity, **more})
            run = _Training(folder, factory, settings, facts, demonstrations, began, stack)
            run.run(on_progress)
        folder.finish()
        run = Run(folder.policy, _read_curve(folder.curve), settings, was_finished)
        return _with_picture(run, folder, identity)


def _take_streams(stack: contextlib.ExitStack) -> None:
    """Imports the algorithm, and keeps the global random streams for it until `stack` closes.

    Afterwards they go on as before. Raises RuntimeError if a run of another thread has them.
    """
    if not _turn.lock.acquire(blocking=False):
        raise RuntimeError(
            "another thread of this process trains, and both would draw from NumPy's global "
            "stream: wait for it, or train in a process of its own"
        )
    stack.callback(_turn.lock.release)
    stack.callback(np.random.set_state, np.random.get_state())
    stack.callback(random.setstate, random.getstate())
    importlib.import_module("limberjack.training.learner")  # draws, and brings PyTorch
    if (torch := sys.modules.get("torch")) is not None:
        stack.callback(torch.set_rng_state, torch.get_rng_state())


def _with_picture(run: Run, folder: Folder, identity: Mapping[str, object]) -> Run:
    """The run with a picture of its curve, which is drawn unless there is one."""
    if not folder.picture.exists():
        steps, _, seconds, means, *_ = _numbers(run.curve).T
        world = cast(Mapping[str, object], identity["world"] or {})
        name = ", ".join([f"this run, seed {identity['seed']}", *(f"with {one}" for one in world)])
        own = LearningCurve(name, steps, seconds, means)
        domain, task = (str(identity.get(name, "")) for name in ("domain", "task"))
        known = learning_of(domain, task)
        drawn = known._replace(title=title_of(identity), own=own)
        try:
            write_learning_plot(folder.picture, [drawn])
        except ImportError as error:
            return dataclasses.replace(run, left_out=f"no {folder.picture.name}: {error}")
    return dataclasses.replace(run, picture=folder.picture)


def _identified(
    factory: Factory, settings: Settings, seed: int, demonstrations: Dataset | None
) -> dict[str, object]:
    """Facts that identify a run, as values of JSON; raises ValueError if it cannot be trained."""
    limit = "time_limit, or a task named by its domain time_limit = SECONDS in its settings"
    environment = checked_environment(factory, [0], is_kept=True, limit=limit)
    _check_learnable(factory.title, environment, settings)
    if demonstrations is not None:
        check_of_task(demonstrations, factory.facts.get("domain"), factory.facts.get("task"))
    return {
        "format": _FORMAT,
        **factory.facts,
        "fingerprint": fingerprint(inside(environment).physics.model._official),
        "algorithm": "CrossQ" if demonstrations is None else "CrossQ with demonstrations",
        "seed": seed,
        "world": shown_by(inside(environment), "world"),
        "settings": dataclasses.asdict(settings),
        "demonstrations": None if demonstrations is None else identity_of(demonstrations),
    }


def _check_learns(settings: Settings) -> None:
    """Raises ValueError unless there are actions after those that are drawn at random."""
    actions = math.ceil(settings.steps / settings.action_repeat)
    if actions <= settings.random_steps:
        raise ValueError(
            f"steps is {settings.steps}, which are {actions} actions, and random_steps = "
            f"{settings.random_steps} come before learning begins: expected more steps, or fewer "
            "random_steps in the settings"
        )


def _check_learnable(title: str, environment: dm_env.Environment, settings: Settings) -> None:
    """Raises ValueError unless a network can be trained in an environment with these settings."""
    if PIXELS_KEY in as_mapping(environment.observation_spec()):
        raise ValueError(f"{title} observes pictures; expected numbers only")
    if not any(math.prod(shape) for _, shape in layout_of(environment)):
        raise ValueError(f"{title} observes nothing; expected at least one number")
    spec = spec_of(environment)
    if len(spec.shape) != 1 or spec.dtype.kind != "f":
        raise ValueError(
            f"{title} has actions of shape {spec.shape} and type {spec.dtype}; expected one axis, "
            "such as (2,), of floating-point numbers"
        )
    own = own_repeat(environment)
    if own not in (1, settings.action_repeat):
        raise ValueError(
            f"{title} repeats each action for {own} control steps, and the settings for "
            f"{settings.action_repeat}: set action_repeat = {own} in the settings"
        )


class _Training:
    """A run in memory: the learner, its rows, the batch of evaluations, and the curve."""

    def __init__(
        self,
        folder: Folder,
        factory: Factory,
        settings: Settings,
        facts: _Facts,
        demonstrations: Dataset | None,
        began: float,
        stack: contextlib.ExitStack,
    ) -> None:
        """Begins a run or continues it; `stack` closes what was opened for it."""
        from limberjack import sb3
        from limberjack.training.learner import Learner

        self._folder, self._settings, self._facts = folder, settings, facts
        self._began = began  # processor time of this process when it began
        seed, repeat = facts["seed"], settings.action_repeat
        first = _ROWS + MOST_ROWS * seed
        build = factory.build(factory.make(0))
        # One thread, for a few percent of the time.
        rows = batch_of(build, settings.num_envs, 1, seed=first, action_repeat=repeat, stagger=True)
        self._envs = sb3.VecEnv(rows, action_bound=settings.action_bound)
        stack.callback(self._envs.close)
        shown = None
        if demonstrations is not None:
            bounds = self._envs.action_space.low, self._envs.action_space.high
            shown = demonstrations_of(demonstrations, self._layout, repeat, *bounds)
        self._learner = Learner(self._envs, settings, seed, folder.events, shown)
        stack.callback(self._learner.close)
        self._envs.seed(first)  # the algorithm has given the rows its own seed
        # As long as the task's episodes, whatever is trained.
        whole = factory.lasting(seconds_without_a_limit(factory.lasting().make(0)))
        build = whole.build(whole.make(0))
        self._tested = batch_of(build, len(_EVALUATED), 1, seed=0, action_repeat=1)
        stack.callback(self._tested.close)
        self._curve: list[Evaluation] = []
        self._save_at = time.monotonic() + _PATIENCE
        self._restore()

    def run(self, on_progress: _OnProgress | None) -> None:
        """Learns until the steps are taken; evaluates and writes the final policy."""

        def before_step() -> None:
            self._check_losses()
            if self._is_evaluation_due():
                self._evaluate()
            elif time.monotonic() > self._save_at:
                self._save()
            if on_progress is not None:
                on_progress(self._control_steps, self._settings.steps, self._curve[-1].mean)

        self._learner.learn(before_step)
        self._check_losses()
        if self._curve[-1].control_steps < self._control_steps:
            self._evaluate()
        policy = self._policy()
        mlp.save(self._folder.policy, policy.layers, policy.card)

    def _is_evaluation_due(self) -> bool:
        """Whether a twentieth of the run is over, and its end was not evaluated before a kill."""
        if self._curve and self._curve[-1].control_steps == self._control_steps:
            return False
        return self._control_steps * _EVALUATIONS >= self._settings.steps * len(self._curve)

    def _policy(self) -> mlp.Mlp:
        """The policy so far, as it would be written."""
        actions = self._envs.action_space
        card = mlp.Card(
            layout=self._layout,
            low=tuple(actions.low.tolist()),
            high=tuple(actions.high.tolist()),
            action_repeat=self._settings.action_repeat,
            domain=self._facts.get("domain", ""),
            task=self._facts.get("task", ""),
            algorithm=self._facts["algorithm"],
            command=self._facts["command"],
            seeds=(self._facts["seed"],),
            steps=self._control_steps,
            versions=self._facts["versions"],
            fingerprint=self._facts["fingerprint"],
            world=self._facts["world"],
        )
        try:
            return mlp.Mlp(self._learner.layers(), card)
        except ValueError as error:
            raise self._failed(f"there is no policy to be written ({error})") from error

    @property
    def _layout(self) -> mlp.Layout:
        return tuple((part.name, tuple(part.shape)) for part in self._envs.vector_env.layout)

    @property
    def _control_steps(self) -> int:
        return self._learner.actions_taken * self._settings.action_repeat

    @property
    def _processor_seconds(self) -> float:
        return time.process_time() - self._began

    def _check_losses(self) -> None:
        for name, value in self._learner.losses().items():
            if not math.isfinite(value):
                raise self._failed(f"{name} is {value}")

    def _failed(self, why: str) -> TrainingError:
        return TrainingError(
            f"{why} after {self._control_steps} control steps; the last checkpoint is kept, but "
            "would get there again: train in another folder with another seed or other settings"
        )

    def _evaluate(self) -> None:
        """Plays the episodes of evaluations, adds their returns to the curve, and saves."""
        actor = Batched("learned", None, self._policy().act_batch)
        played = play(self._tested, actor, _EVALUATED, action_repeat=self._settings.action_repeat)
        try:
            totals = {episode.seed: episode.total for ended in played for episode in ended}
        except PolicyError as error:
            why = f"an observation or a weight is too large or no number ({error})"
            raise self._failed(why) from error
        for seed, total in totals.items():
            if not math.isfinite(total):
                raise TrainingError(
                    f"the return of the evaluated episode with seed {seed} is {total} after "
                    f"{self._control_steps} control steps; expected a task whose rewards are "
                    "finite numbers"
                )
        last = Evaluation(
            self._control_steps,
            self._learner.actions_taken,
            round(self._processor_seconds, 2),
            tuple(totals[seed] for seed in _EVALUATED),
        )
        self._curve.append(last)
        self._folder.write_curve(_COLUMNS, _numbers(self._curve))
        self._learner.write_events(last.control_steps, last.mean, last.processor_seconds)
        self._save()

    def _save(self) -> None:
        """Writes a checkpoint; a longer one, of more transitions, is written less often."""
        began = time.monotonic()
        learner = self._learner.state()
        try:
            self._folder.save(
                {
                    "learner": learner,
                    "rows": self._envs.vector_env.batches[0].snapshot(),
                    "curve": self._curve,
                    "processor_seconds": self._processor_seconds,
                }
            )
        except (AttributeError, TypeError, pickle.PicklingError) as error:
            raise TrainingError(
                f"the environment cannot be saved in a checkpoint ({error}); expected one that "
                "pickle and copy.deepcopy take: define its functions and classes at the top level "
                "of a module"
            ) from error
        now = time.monotonic()
        self._save_at = now + max(_PATIENCE, _SHARE * (now - began))

    def _restore(self) -> None:
        """Continues from the checkpoint, if there is one."""
        state = self._folder.load()
        if state is None:
            return
        self._envs.reset()
        try:
            self._envs.vector_env.batches[0].restore(state["rows"])
            self._learner.restore(state["learner"])
            self._curve = state["curve"]
            self._began -= state["processor_seconds"]
        except (KeyError, TypeError, ValueError) as error:  # of another program
            raise self._folder.damaged(error) from error


def _numbers(curve: Sequence[Evaluation]) -> np.ndarray:
    """The lines of curve.csv."""
    lines = [[*dataclasses.astuple(one)[:-1], one.mean, *one.returns] for one in curve]
    return np.array(lines, float)


def _read_curve(path: Path) -> tuple[Evaluation, ...]:
    """The evaluations in curve.csv; raises ValueError if it is damaged."""
    try:
        lines = np.array([line.split(",") for line in path.read_text().splitlines()[1:]], float)
        if not len(lines):
            raise ValueError("it has no evaluations")
        if lines.shape[1:] != (len(_COLUMNS),) or not np.isfinite(lines).all():
            raise ValueError(f"expected {len(_COLUMNS)} finite numbers in each line")
        return tuple(Evaluation(int(a), int(b), c, tuple(x)) for a, b, c, _, *x in lines.tolist())
    except ValueError as error:
        raise ValueError(f"{path} is damaged ({error})") from error
