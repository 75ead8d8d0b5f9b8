"""`Env`: one simulation as a `gymnasium.Env`.

    env = load("humanoid", "walk", flat=True, dtype="float32")
    observation, info = env.reset(seed=0)
    observation, reward, terminated, truncated, info = env.step(env.action_space.sample())

`reset(seed=s)` begins the episode that dm_control begins with `random=s`; without a seed the
random stream continues. The time limit truncates; only the task terminates. After an episode the
caller resets; `VectorEnv` resets its rows by itself.
"""

import inspect
import math
from collections.abc import Mapping, Sequence
from typing import Any, cast

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium import error
from gymnasium.envs.registration import EnvSpec
from gymnasium.wrappers import TimeLimit

from limberjack import suite
from limberjack.gym import arguments
from limberjack.gym.observations import Info, Observation, Part, action_space
from limberjack.gym.pixels import observations_of
from limberjack.gym.states import State, state_of_one
from limberjack.rl import control
from limberjack.rl.action_specs import bounded_spec
from limberjack.rl.pixels import render_cameras
from limberjack.rl.represented import of_environment, represented
from limberjack.rl.snapshot import Snapshot
from limberjack.utils.seeds import checked_seed

__all__ = ["Env", "load"]


class Env(gymnasium.Env):
    """One simulation; see the module's docstring.

    `layout` gives the position of each observation in the flat array, as `Part`s of name, slice
    and shape. The info of a step has `reward_terms`, the terms of the reward by name, and
    `success`, whether the goal is reached now, where the task defines them. The info of a reset
    has `randomization`, the fields of the model that were drawn, if any are.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012 (as Gymnasium has it)
        "render_modes": arguments.RENDER_MODES
    }

    @arguments.suggests_names
    def __init__(
        self,
        environment: control.Environment,
        *,
        flat: bool = False,
        dtype: npt.DTypeLike = "float64",
        render_mode: str | None = None,
        render_kwargs: Mapping[str, object] | None = None,
        width: int | None = None,
        height: int | None = None,
        camera_id: int | Sequence[int | str] | None = None,
        camera_name: str | Sequence[str] | None = None,
    ) -> None:
        """Take over an environment, of the suite or your own.

        Args:
          environment: it must not be used elsewhere.
          flat: observations are one array (see `layout`) instead of a dict; beside pixels, that
            array is called 'state'.
          dtype: of observations, 'float64' or 'float32'. Actions are float32.
          render_mode: None or 'rgb_array'.
          render_kwargs: keyword arguments of `Physics.render`, such as {'quality': 'fast'}.
          width, height: of a picture, pixels; 320 and 240 by default.
          camera_id, camera_name: the camera of a picture, or a list of cameras, whose pictures are
            joined side by side; the free camera by default.

        Raises:
          ValueError: the dtype or the render mode is unknown.
          TypeError: an argument is unknown, or given twice; or the environment is of another kind,
            which has no snapshots, seeds and end of time to report.
        """
        if not isinstance(environment, control.Environment):
            raise TypeError(
                f"environment is a {type(environment).__name__}; expected a limberjack.rl.control."
                "Environment or a subclass: make it from the task and its physics, or load it with "
                "limberjack.gym.load"
            )
        self._environment = environment
        spec = environment.observation_spec()
        self._observations = observations_of(spec, flat, dtype, environment.pixels)
        self.layout: tuple[Part, ...] = self._observations.layout
        self.observation_space = self._observations.space
        bounded_spec(environment.task, environment.physics)  # raises if there is none
        self.action_space = action_space(environment.action_spec())
        self.render_mode = arguments.render_mode(render_mode)
        self.metadata = {**self.metadata, "render_fps": round(1 / self.dt)}
        self._render_kwargs = arguments.picture_arguments(
            render_kwargs, width, height, camera_id, camera_name
        )
        # Whether Gymnasium's TimeLimit counts the steps, and its count.
        self._is_counted_outside = False
        self._counted = 0
        # The id's length in control steps, where actions are repeated and no other was asked for.
        self._length: int | None = None
        self._spec: EnvSpec | None = None
        self._closed = False

    # A plain attribute in Gymnasium, which `make` sets.
    @property
    def spec(self) -> EnvSpec | None:
        """The spec of the id, in which Gymnasium's `TimeLimit` notes its number of actions."""
        self._agree_with(_time_limits_calling(self))
        return self._spec

    @spec.setter
    def spec(  # pyright: ignore[reportIncompatibleVariableOverride]
        self, spec: EnvSpec | None
    ) -> None:
        self._spec = spec

    def _agree_with(self, limits: Sequence[TimeLimit]) -> bool:
        """Give limits that have the id's length, in control steps, that number of actions.

        Returns whether there are any.
        """
        if self._length is None:
            return False
        actions = self.actions_of(self._length)
        for limit in limits:
            if limit._max_episode_steps == self._length:
                limit._max_episode_steps = actions
        return any(limit._max_episode_steps == actions for limit in limits)

    @property
    def environment(self) -> control.Environment:
        """The dm_env environment, with its `physics` and `task`."""
        return self._environment

    # Any: of the domain's own class.
    @property
    def physics(self) -> Any:
        """The simulation, also of a wrapped environment as `env.unwrapped.physics`."""
        return self._environment.physics

    @property
    def dt(self) -> float:
        """Time between two actions, seconds."""
        return self._environment.control_timestep() * self._environment.action_repeat

    def actions_of(self, steps: int) -> int:
        """Number of actions that make a number of control steps; each may be repeated."""
        return math.ceil(steps / self._environment.action_repeat)

    def reset(
        self, *, seed: int | None = None, options: Info | None = None
    ) -> tuple[Observation, Info]:
        """Begin an episode; return its first observation and info.

        Args:
          seed: the episode is the first of `RandomState(seed)`; with None the stream continues.
          options: `state` sets the state after the start is drawn: a mapping of some of 'qpos'
            (nq,), 'qvel' (nv,) and 'act' (na,), or a `Snapshot`, which is restored with its step
            count.

        Raises:
          ValueError: the seed is not between 0 and 2**32 - 1, or the state does not fit; nothing
            was reset.
          TypeError: the seed is not a whole number, an option is unknown, or a state is of the
            wrong kind; nothing was reset.
        """
        self._check_open()
        limits = _time_limits_calling(self)
        is_of_the_id = self._agree_with(limits)
        try:
            given = arguments.check_options(options, arguments.STATE).get(arguments.STATE)
            state = state_of_one(given, self._environment)
            number = None if seed is None else checked_seed(seed)
            _check_length(self, state)
        except (TypeError, ValueError):
            # Gymnasium's `TimeLimit` has set its count to 0 already.
            for limit in limits:
                limit._elapsed_steps = self.actions_of(self._counted)
            raise
        if self._length is not None:  # another number of actions takes the place of the id's
            self._environment._step_limit = self._length if is_of_the_id else math.inf
        if number is not None:
            super().reset(seed=number)
            self._environment.reseed(number)
        time_step = self._environment.reset()
        if state is not None:
            time_step = self._environment.set_state(state)
        observation = time_step.observation
        self._counted = self._environment._step_count
        if self._counted:
            for limit in limits:
                limit._elapsed_steps = self.actions_of(self._counted)
        drawn = {name: v.copy() for name, v in self._environment.randomization.items()}
        info = {"randomization": drawn} if drawn else {}
        return self._observations.of_one(observation), info

    def step(self, action: npt.ArrayLike) -> tuple[Observation, float, bool, bool, Info]:
        """Apply the action; return observation, reward, terminated, truncated and info.

        Raises:
          ResetNeeded: no episode has begun, or it has ended.
          ValueError, TypeError: the action is not a finite array of the space's shape; nothing has
            moved.
          PhysicsError: the simulation diverged; `reset` begins another episode.
          RuntimeError: the inner environment was restored or stepped directly, so that Gymnasium's
            count of steps is wrong.
        """
        self._check_open()
        environment = self._environment
        if not environment.is_running:
            raise error.ResetNeeded("no episode is running: call reset() before step()")
        if self._is_counted_outside and environment._step_count != self._counted:
            raise RuntimeError(
                f"the inner environment is at step {environment._step_count}, and Gymnasium's "
                f"TimeLimit at step {self._counted}: restore with limberjack.gym.restore(env, "
                "snapshot), and step the outermost environment only"
            )
        time_step = environment.step(action)
        self._counted = environment._step_count
        is_last = time_step.last()
        truncated = is_last and environment.timed_out
        observation = self._observations.of_one(time_step.observation)
        reward = float(time_step.reward)
        return observation, reward, is_last and not truncated, truncated, self._info()

    def restore(self, snapshot: Snapshot) -> None:
        """Continue from a snapshot; `limberjack.gym.restore` does so for a wrapped environment.

        Raises:
          ValueError: see `control.Environment.restore`.
        """
        self._check_open()
        self._environment.restore(snapshot)
        self._counted = self._environment._step_count

    def render(self) -> np.ndarray | None:  # pyright: ignore[reportIncompatibleMethodOverride]
        """A picture of the present state, (height, width, 3) uint8; None without a render mode.

        The pictures of a list of cameras are side by side, (height, cameras * width, 3).
        """
        self._check_open()
        if self.render_mode is None:
            return None
        return render_cameras(self._environment.physics.render, self._render_kwargs, axis=1)

    def close(self) -> None:
        """Free the simulation; closing twice is fine, using it later is an error."""
        if not self._closed:
            self._closed = True
            self._environment.close()

    def __repr__(self) -> str:
        return represented(self, of_environment(self._environment))

    __str__ = __repr__  # Gymnasium's wrappers show it within their own

    def _info(self) -> Info:
        """The terms of the last step's reward, and whether the goal is reached now."""
        terms, success = self._environment.reward_terms, self._environment.success
        if not terms:
            return {}
        info: Info = {"reward_terms": {name: float(v) for name, v in terms.items()}}
        return info if success is None else {**info, "success": success}

    def _check_open(self) -> None:
        if self._closed:
            raise error.ClosedEnvironmentError("this environment is closed: make a new one")


def _check_length(env: Env, state: State | None) -> None:
    """Raise ValueError for a snapshot of a step at which Gymnasium would have ended the episode."""
    if not isinstance(state, Snapshot):
        return
    steps = env.actions_of(int(state.step_count[0]))
    limits = [limit._max_episode_steps for limit in _time_limits_calling(env)]
    if limits and steps >= min(limits):
        raise ValueError(
            f"the snapshot is of step {steps} of an episode, and Gymnasium ends episodes after "
            f"{min(limits)} steps here: make the environment with a larger max_episode_steps; "
            "nothing was reset"
        )


def _time_limits_calling(env: Env) -> list[TimeLimit]:
    """The `TimeLimit`s around an environment that reset it, or read its spec, in this thread.

    An environment has no reference to its wrappers, which call it in turn.
    """
    reads_spec = cast(property, vars(TimeLimit)["spec"]).fget
    codes = [TimeLimit.reset.__code__, getattr(reads_spec, "__code__", None)]
    found, frame = [], inspect.currentframe()
    while frame is not None:
        if frame.f_code in codes:
            limit = frame.f_locals["self"]
            if limit.unwrapped is env:
                found.append(limit)
        frame = frame.f_back
    return found


@arguments.suggests_names
def load(
    domain: str,
    task: str,
    *,
    time_limit: float | None = None,
    task_kwargs: Mapping[str, object] | None = None,
    environment_kwargs: Mapping[str, object] | None = None,
    randomize: Mapping[str, object] | None = None,
    pixels: Mapping[str, object] | None = None,
    action_repeat: int | None = None,
    flat: bool = False,
    dtype: npt.DTypeLike = "float64",
    render_mode: str | None = None,
    render_kwargs: Mapping[str, object] | None = None,
    width: int | None = None,
    height: int | None = None,
    camera_id: int | Sequence[int | str] | None = None,
    camera_name: str | Sequence[str] | None = None,
) -> Env:
    """An environment of a task, which counts the steps of its episodes itself.

    Args:
      domain: such as 'humanoid'.
      task: such as 'walk'.
      time_limit: length of an episode, seconds; None for the task's own.
      task_kwargs: see `suite.load`.
      environment_kwargs: see `suite.load`.
      randomize: fields of the model to draw for each episode; see `limberjack.rl.randomize`.
      pixels: pictures to observe, such as {'camera': 0, 'frame_stack': 3}; see
        `limberjack.rl.pixels`.
      action_repeat: control steps per action, whose rewards are summed; see `suite.load`.
      flat, dtype, render_mode, render_kwargs, width, height, camera_id, camera_name: see `Env`.

    Raises:
      TypeError: an argument is unknown; the message suggests the nearest name.
      ValueError: the domain or the task is unknown, or an argument is out of range.
    """
    of_task = arguments.task_arguments(task_kwargs, time_limit)
    of_environment = arguments.environment_arguments(environment_kwargs, randomize, pixels)
    return Env(
        suite.load(domain, task, of_task, of_environment, action_repeat=action_repeat),
        flat=flat,
        dtype=dtype,
        render_mode=render_mode,
        render_kwargs=render_kwargs,
        width=width,
        height=height,
        camera_id=camera_id,
        camera_name=camera_name,
    )
