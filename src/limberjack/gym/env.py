"""`Env`: one simulation as a `gymnasium.Env`.

    env = load("humanoid", "walk", flat=True, dtype="float32")
    observation, info = env.reset(seed=0)
    observation, reward, terminated, truncated, info = env.step(env.action_space.sample())

`reset(seed=s)` begins the episode that dm_control begins with `random=s`; without a seed the
random stream continues. The time limit truncates; only the task terminates. After an episode the
caller resets; `VectorEnv` resets its rows by itself.

The environment may be of any class: a wrapper, a subclass, any other `dm_env.Environment`. See
`limberjack.gym.single` for its seeds, and its last step.
"""

import inspect
import math
from collections.abc import Mapping, Sequence
from typing import Any, cast

import dm_env
import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium import error
from gymnasium.envs.registration import EnvSpec
from gymnasium.wrappers import TimeLimit

from limberjack import suite
from limberjack.gym import arguments
from limberjack.gym.observations import AnyObservation, Info, Part, action_space, observations_of
from limberjack.gym.single import Single
from limberjack.gym.states import state_of_one
from limberjack.rl import control
from limberjack.rl.action_specs import spec_of
from limberjack.rl.builds import Build, Make, holder_of
from limberjack.rl.copies import difference
from limberjack.rl.memory import is_of_the_suite
from limberjack.rl.pixels import render_cameras
from limberjack.rl.represented import represented
from limberjack.rl.snapshot import Snapshot
from limberjack.utils.keywords import with_keywords
from limberjack.utils.seeds import checked_seed

__all__ = ["Env", "check_steps", "load"]


class Env(gymnasium.Env):
    """One simulation; see the module's docstring.

    `layout` gives the position of each observation in the flat array, as `Part`s of name, slice
    and shape. The info of a step has `reward_terms`, the terms of the reward by name, and
    `success`, whether the goal is reached now, where the task defines them. The info of a reset
    has `randomization`, the fields of the model that were drawn, if any are.
    """

    metadata = {"render_modes": arguments.RENDER_MODES}  # noqa: RUF012 (as Gymnasium has it)

    @arguments.suggests_names
    def __init__(
        self,
        environment: dm_env.Environment | Make | Build,
        *,
        action_repeat: int | None = None,
        flat: bool = False,
        dtype: npt.DTypeLike = "float64",
        render_mode: str | None = None,
        render_kwargs: Mapping[str, object] | None = None,
        width: int | None = None,
        height: int | None = None,
        camera_id: int | Sequence[int | str] | None = None,
        camera_name: str | Sequence[str] | None = None,
    ) -> None:
        """Take over an environment, of the suite or your own, of any class.

        Args:
          environment: it must not be used elsewhere; or a function `build(seed)` that makes one.
            An environment that is not a plain `control.Environment` is made again for each seed,
            by that function or else as a copy.
          action_repeat: control steps per action, whose rewards are summed; None for the
            environment's own.
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
          TypeError: an argument is unknown, or given twice; it is no environment; or it has no
            arrays to observe, no single array of actions, or no physics to draw.
        """
        self.render_mode = arguments.render_mode(render_mode)
        self._render_kwargs = arguments.picture_arguments(
            render_kwargs, width, height, camera_id, camera_name
        )
        self._played = played = _played(environment, action_repeat)
        self._observations = observations_of(played.observation_spec(), flat, dtype, played.pixels)
        self.layout: tuple[Part, ...] = self._observations.layout
        self.observation_space = self._observations.space
        self.action_space = action_space(played.action_spec())
        if self.render_mode is not None and not hasattr(self, "physics"):
            raise TypeError(
                f"render_mode is {render_mode!r}, but a {type(self.environment).__name__} has no "
                "physics to draw; expected None"
            )
        if not math.isnan(self.dt):
            self.metadata = {**self.metadata, "render_fps": round(1 / self.dt)}
        # Whether a TimeLimit of Gymnasium counts the steps, and the count that it has.
        self._is_counted_outside = False
        self._counted = 0
        # The id's length in control steps, if actions are repeated and no other length is given.
        self._length: int | None = None
        self._most: float = math.inf  # actions of an episode, by the caller's time limit
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
        """Give limits the actions of a time limit that ends sooner, and of the id's control steps.

        Returns whether any has the length of the id.
        """
        for limit in limits:
            limit._max_episode_steps = int(min(limit._max_episode_steps, self._most))
        if self._length is None:
            return False
        actions = self.actions_of(self._length)
        for limit in limits:
            if limit._max_episode_steps == self._length:
                limit._max_episode_steps = actions
        return any(limit._max_episode_steps == actions for limit in limits)

    # Any: of the caller's own class, such as a `control.Environment` with `physics` and `task`.
    @property
    def environment(self) -> Any:
        """The dm_env environment; unless it is plain, a reset with a seed makes another one."""
        played = self._played
        return played.environment if isinstance(played, Single) else played

    # Any: of the domain's own class.
    @property
    def physics(self) -> Any:
        """The simulation, also of a wrapped environment as `env.unwrapped.physics`."""
        return self._played.physics

    @property
    def dt(self) -> float:
        """Time between two actions, seconds; NaN for an environment that does not report it."""
        return self._played.control_timestep() * self._played.action_repeat

    def actions_of(self, steps: int) -> int:
        """Number of actions that make a number of control steps; each may be repeated."""
        return math.ceil(steps / self._played.action_repeat)

    def has_wrapper_attr(self, name: str) -> bool:
        """Whether this environment, the dm_env environment or its task has an attribute."""
        return hasattr(self, name) or hasattr(holder_of(self.environment, name), name)

    def get_wrapper_attr(self, name: str) -> object:
        """An attribute of this environment, or else of the dm_env environment or its task.

        Raises:
          AttributeError: none of them has it.
        """
        if hasattr(self, name) or not self.has_wrapper_attr(name):
            return getattr(self, name)
        return getattr(holder_of(self.environment, name), name)

    def set_wrapper_attr(self, name: str, value: object, *, force: bool = True) -> bool:
        """Set an attribute where there is one of this name, for later seeds too.

        Args:
          name: such as '_move_speed', of the task.
          value: its new value.
          force: set it here if there is none.

        Returns:
          Whether it was set.
        """
        if hasattr(self, name) or not self.has_wrapper_attr(name):
            return super().set_wrapper_attr(name, value, force=force)
        if isinstance(self._played, Single):
            self._played.set_attribute(name, value)
        else:
            setattr(holder_of(self._played, name), name, value)
        return True

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, object] | None = None
    ) -> tuple[AnyObservation, Info]:
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
            wrong kind; or the environment cannot be copied for another seed, see
            `limberjack.gym.single`; nothing was reset.
        """
        self._check_open()
        played = self._played
        limits = _time_limits_calling(self)
        is_of_the_id = self._agree_with(limits)
        try:
            given = arguments.check_options(options, arguments.STATE).get(arguments.STATE)
            state = state_of_one(given, played)
            number = None if seed is None else checked_seed(seed)
            if isinstance(state, Snapshot):
                check_steps(self.actions_of(int(state.step_count[0])), limits)
            if number is not None:  # which may call the user's code, to make the environment
                played.reseed(number)
        except BaseException:  # Ctrl-C too
            # Gymnasium's `TimeLimit` has set its count to 0 already.
            for limit in limits:
                limit._elapsed_steps = self.actions_of(self._counted)
            raise
        if self._length is not None:  # another number of actions takes the place of the id's
            played._step_limit = self._length if is_of_the_id else math.inf
        if number is not None:
            super().reset(seed=number)
        time_step = played.reset()
        if state is not None:
            time_step = played.set_state(state)
        observation = time_step.observation
        self._counted = played._step_count
        if self._counted:
            for limit in limits:
                limit._elapsed_steps = self.actions_of(self._counted)
        drawn = {name: v.copy() for name, v in played.randomization.items()}
        info = {"randomization": drawn} if drawn else {}
        return self._observations.of_one(observation), info

    def step(self, action: npt.ArrayLike) -> tuple[AnyObservation, float, bool, bool, Info]:
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
        played = self._played
        if not played.is_running:
            raise error.ResetNeeded("no episode is running: call reset() before step()")
        if self._is_counted_outside and played._step_count != self._counted:
            raise RuntimeError(
                f"the inner environment is at step {played._step_count}, and Gymnasium's "
                f"TimeLimit at step {self._counted}: restore with limberjack.gym.restore(env, "
                "snapshot), and step the outermost environment only"
            )
        time_step = played.step(action)
        self._counted = played._step_count
        is_last = time_step.last()
        truncated = is_last and played.timed_out
        observation = self._observations.of_one(time_step.observation)
        reward = self._number(time_step.reward)
        return observation, reward, is_last and not truncated, truncated, self._info()

    def snapshot(self) -> Snapshot:
        """Everything that the environment's future depends on, to `restore`.

        Raises:
          TypeError: the environment or its task keeps something that cannot be copied.
        """
        self._check_open()
        return self._played.snapshot()

    def restore(self, snapshot: Snapshot) -> None:
        """Continue from a snapshot; `limberjack.gym.restore` does so for a wrapped environment.

        Raises:
          ValueError: see `control.Environment.restore`.
        """
        self._check_open()
        self._played.restore(snapshot)
        self._counted = self._played._step_count

    def render(self) -> np.ndarray | None:
        """A picture of the present state, (height, width, 3) uint8; None without a render mode.

        The pictures of a list of cameras are side by side, (height, cameras * width, 3).
        """
        self._check_open()
        if self.render_mode is None:
            return None
        return render_cameras(self.physics.render, self._render_kwargs, axis=1)

    def close(self) -> None:
        """Free the simulation; closing twice is fine, using it later is an error."""
        if not self._closed:
            self._closed = True
            self._played.close()

    def __repr__(self) -> str:
        return represented(self, self._played.description())

    __str__ = __repr__  # Gymnasium's wrappers show it within their own

    def _number(self, reward: Any) -> float:  # whatever the task returned
        try:
            return float(reward)
        except (TypeError, ValueError) as error:
            raise TypeError(
                f"the reward of {self._played.description().task} is {reward!r}; expected a number"
            ) from error

    def _info(self) -> dict[str, object]:
        """The terms of the last step's reward, and whether the goal is reached now."""
        terms, success = self._played.reward_terms, self._played.success
        if not terms:
            return {}
        shown = {name: float(value) for name, value in terms.items()}
        return {"reward_terms": shown, **({} if success is None else {"success": success})}

    def _check_open(self) -> None:
        if self._closed:
            raise error.ClosedEnvironmentError("this environment is closed: make a new one")


def _played(
    given: dm_env.Environment | Make | Build, action_repeat: int | None
) -> control.Environment | Single:
    """The environment itself if it is plain and its task the suite's; otherwise a `Single`."""
    env = given.original if isinstance(given, Build) else given
    if not isinstance(env, control.Environment) or difference(env) is not None:
        return Single(given, action_repeat)
    if not is_of_the_suite(env.task, env.physics):
        return Single(given, action_repeat)
    spec_of(env)  # raises if it is not one array
    if action_repeat is not None:
        control.set_action_repeat(env, action_repeat)
    return env


def check_steps(steps: int, limits: Sequence[TimeLimit]) -> None:
    """Raise ValueError if Gymnasium would have ended the episode that a snapshot continues."""
    least = min((limit._max_episode_steps for limit in limits), default=math.inf)
    if steps >= least:
        raise ValueError(
            f"the snapshot is of step {steps} of an episode, and Gymnasium ends episodes after "
            f"{least} steps here: make the environment with a larger max_episode_steps; nothing "
            "has changed"
        )


def _time_limits_calling(env: Env) -> list[TimeLimit]:
    """The `TimeLimit`s around an environment that reset it, or read its spec, in this thread.

    An environment has no reference to its wrappers, which call it in turn.
    """
    reads_spec = cast(property, inspect.getattr_static(TimeLimit, "spec")).fget
    codes = [TimeLimit.reset.__code__, getattr(reads_spec, "__code__", None)]
    found, frame = [], inspect.currentframe()
    while frame is not None:
        if frame.f_code in codes:
            limit = frame.f_locals["self"]
            if limit.unwrapped is env:
                found.append(limit)
        frame = frame.f_back
    return found


def load(
    domain: str,
    task: str,
    *,
    time_limit: float | None = None,
    task_kwargs: Mapping[str, object] | None = None,
    environment_kwargs: Mapping[str, object] | None = None,
    randomize: Mapping[str, object] | None = None,
    pixels: Mapping[str, object] | None = None,
    faults: str | Mapping[str, object] | None = None,
    appearance: str | Mapping[str, object] | None = None,
    **kwargs: Any,  # of `Env`
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
      faults: of the real world, such as 'easy'; see `limberjack.worlds.faults`.
      appearance: of pictures, such as 'color_hard'; see `limberjack.worlds.appearance`.
      kwargs: action_repeat, flat, dtype, render_mode, render_kwargs, width, height, camera_id,
        camera_name: see `Env`.

    Raises:
      TypeError: an argument is unknown; the message suggests the nearest name.
      ValueError: the domain or the task is unknown, or an argument is out of range.
    """
    arguments.refuse_unknown(kwargs, Env, load)
    of_task = with_keywords("task_kwargs", task_kwargs, time_limit=time_limit)
    own = {"randomize": randomize, "pixels": pixels, "faults": faults, "appearance": appearance}
    of_environment = with_keywords("environment_kwargs", environment_kwargs, **own)
    return Env(suite.build_of(domain, task, of_task, of_environment), **kwargs)
