"""Episodes kept whole, and played again without whoever chose the actions.

    recording = record_episode(env, planner.act, {"domain": "humanoid", "task": "stand"})
    recording.save(Path("episode.npz"))

    recording = Recording.load(Path("episode.npz"))
    difference = replay(recording, env)  # None: every bit is the same

A recording holds the episode's start (state and what the start set in the model), and for each step
the action, the reward, the observation and the full state. It does not hold the model: versions and
a fingerprint in `about` say which one it was.
"""

import dataclasses
import json
import zipfile
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from limberjack.rl.control import Environment
from limberjack.utils.files import replacing

__all__ = ["Recording", "record_episode", "replay"]

_STATE = mujoco.mjtState.mjSTATE_INTEGRATION.value
_START, _OBSERVATION = "start.", "observation."  # how the names of arrays begin
# What NumPy says of files that are something else, such as a .npy, besides the errors of zip files.
_UNREADABLE = (AttributeError, EOFError, KeyError, TypeError, ValueError)


@dataclasses.dataclass(frozen=True)
class Recording:
    """An episode of T steps.

    Attributes:
      about: what it is of; plain values that JSON can hold.
      start: what the episode started from, by name, as `Environment.snapshot().physics`.
      actions: (T, nu).
      rewards: (T,).
      states: integration states of MuJoCo, the first and after each step, (T + 1, nstate).
      observations: the first and after each step, by name, (T + 1, ...).
    """

    about: dict[str, Any]
    start: dict[str, np.ndarray]
    actions: np.ndarray
    rewards: np.ndarray
    states: np.ndarray
    observations: dict[str, np.ndarray]

    def save(self, path: Path) -> None:
        """Writes a compressed .npz whole, or leaves the one that is there."""
        arrays = {
            "about": np.array(json.dumps(self.about)),
            "actions": self.actions,
            "rewards": self.rewards,
            "states": self.states,
        }
        arrays |= {_START + name: value for name, value in self.start.items()}
        arrays |= {_OBSERVATION + name: value for name, value in self.observations.items()}
        with replacing(path) as partial:
            np.savez_compressed(partial, allow_pickle=False, **arrays)

    @classmethod
    def load(cls, path: Path) -> "Recording":
        """The recording in a file.

        Raises:
          OSError: the file cannot be read.
          ValueError: it is no recording.
        """
        try:
            with np.load(path, allow_pickle=False) as file:
                arrays = {name: file[name] for name in file.files}
            about = json.loads(str(arrays.pop("about")))
            plain = {name: arrays.pop(name) for name in ("actions", "rewards", "states")}
            start, observations = _part(arrays, _START), _part(arrays, _OBSERVATION)
            recording = cls(about, start, **plain, observations=observations)
            _check_whole(recording)
        except (*_UNREADABLE, zipfile.BadZipFile, zlib.error) as error:
            raise ValueError(
                f"{path} is no recording of an episode ({error}); expected an episode-*.npz that "
                "`limberjack solve --out` wrote"
            ) from error
        return recording


def record_episode(
    env: Environment,
    act: Callable[[], np.ndarray],
    about: Mapping[str, Any],
    on_step: Callable[[int, float], object] | None = None,
) -> Recording:
    """Plays the environment's next episode to its end.

    Args:
      env: it is reset, but not closed.
      act: returns the action for the environment's present state, as `Planner.act`.
      about: what the recording is of.
      on_step: called with the number of steps and the return so far: after the reset and after
        each step.
    """
    time_step = env.reset()
    start = env.snapshot().physics
    actions: list[np.ndarray] = []
    rewards: list[float] = []
    states, observations = [_state(env)], [time_step.observation]
    total = 0.0
    if on_step is not None:
        on_step(0, total)
    while not time_step.last():
        actions.append(np.array(act()))
        time_step = env.step(actions[-1])
        rewards.append(float(time_step.reward))
        states.append(_state(env))
        observations.append(time_step.observation)
        total += rewards[-1]
        if on_step is not None:
            on_step(len(rewards), total)
    seen = {name: np.stack([o[name] for o in observations]) for name in observations[0]}
    return Recording(
        dict(about), start, np.array(actions), np.array(rewards), np.array(states), seen
    )


def replay(
    recording: Recording, env: Environment, on_step: Callable[[], object] | None = None
) -> str | None:
    """Plays a recording's actions from its start; says where the episode differs, None if nowhere.

    Args:
      recording: of a task and model that are the environment's.
      env: its state becomes that of the recording.
      on_step: called after the start and after each step.

    Raises:
      ValueError: the recording is of another task or model than the environment.
    """
    first = _begin(recording, env)
    if on_step is not None:
        on_step()
    difference = _difference(
        recording.states[0], _state(env), "the start's state"
    ) or _observed_otherwise(recording, 0, first)
    for step, action in enumerate(recording.actions):
        if difference is not None:
            return difference
        time_step = env.step(action)
        if on_step is not None:
            on_step()
        where = f"step {step}: the"
        difference = (
            _difference(recording.states[step + 1], _state(env), f"{where} state")
            or _difference(recording.rewards[step], time_step.reward, f"{where} reward")
            or _observed_otherwise(recording, step + 1, time_step.observation)
            or _ends_otherwise(recording, step, time_step.last())
        )
    return difference


def _begin(recording: Recording, env: Environment) -> Mapping[str, Any]:
    """Puts the environment at the recording's start; returns what it observes, without pictures."""
    env.reset()
    own = env.snapshot()
    for name, value in own.physics.items():
        recorded = recording.start.get(name)
        if recorded is None or recorded.shape != value.shape:
            shape = None if recorded is None else recorded.shape
            raise ValueError(
                f"the recording's {name!r} has shape {shape}; expected {value.shape}: it is of "
                "another task or model than the environment"
            )
    start = {name: recording.start[name] for name in own.physics}
    expected = set(env.observation_spec())
    if recording.observations.keys() != expected:
        raise ValueError(
            f"the recording's observations are {sorted(recording.observations)}; expected "
            f"{sorted(expected)}: it is of another task or model than the environment"
        )
    env.restore(dataclasses.replace(own, physics=start))
    return env._observe(draws=False)


def _observed_otherwise(
    recording: Recording, index: int, observation: Mapping[str, Any]
) -> str | None:
    where = f"step {index - 1}: the" if index else "the start's"
    for name, found in observation.items():
        recorded = recording.observations[name][index]
        difference = _difference(recorded, found, f"{where} observation {name!r}")
        if difference is not None:
            return difference
    return None


def _ends_otherwise(recording: Recording, step: int, last: bool) -> str | None:
    """Whether only one of the two episodes ends with this step."""
    recorded = len(recording.actions)
    if last == (step + 1 == recorded):
        return None
    here = "ends here" if last else "goes on"
    return f"step {step}: the episode {here}; the recorded one has {recorded} steps"


def _difference(recorded: Any, found: Any, what: str) -> str | None:
    if np.array_equal(recorded, found, equal_nan=True):
        return None
    if np.shape(recorded) != np.shape(found):
        return f"{what} has shape {np.shape(found)}; the recorded one has {np.shape(recorded)}"
    gap = np.abs(np.asarray(recorded) - np.asarray(found)).max()
    return f"{what} differs from the recorded one by up to {gap:.3g}"


def _check_whole(recording: Recording) -> None:
    """Raises ValueError unless there are numbers of each kind for every step."""
    if not isinstance(recording.about, dict):
        raise ValueError(f"'about' is a {type(recording.about).__name__}; expected a dictionary")
    of_steps = {"actions": recording.actions, "rewards": recording.rewards}
    of_states = {"states": recording.states}
    of_states |= {_OBSERVATION + name: value for name, value in recording.observations.items()}
    starts = {_START + name: value for name, value in recording.start.items()}
    for name, value in {**of_steps, **of_states, **starts}.items():
        if value.dtype.kind not in "biuf" or not value.ndim:
            raise ValueError(
                f"{name!r} has dtype {value.dtype} and shape {value.shape}; expected numbers"
            )
    steps = len(recording.actions)
    if not steps:
        raise ValueError("it has no step")
    for arrays, expected in ((of_steps, steps), (of_states, steps + 1)):
        for name, value in arrays.items():
            if len(value) != expected:
                raise ValueError(
                    f"{name!r} has length {len(value)}; expected {expected}, for {steps} steps"
                )


def _state(env: Environment) -> np.ndarray:
    return env.physics.get_state(_STATE)


def _part(arrays: Mapping[str, np.ndarray], prefix: str) -> dict[str, np.ndarray]:
    """The arrays whose names begin so, by the rest of their names."""
    return {n.removeprefix(prefix): v for n, v in arrays.items() if n.startswith(prefix)}
