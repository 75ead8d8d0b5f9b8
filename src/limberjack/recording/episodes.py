"""Recordings of complete episodes, and their replay without the policy or planner.

    recording = record_episode(env, planner.act, {"domain": "humanoid", "task": "stand"})
    recording.save(Path("episode.npz"))

    recording = Recording.load(Path("episode.npz"))
    difference = replay(recording, env)  # None if bitwise equal

A recording holds the start of the episode (the state and the model fields set by the start), and
for each step the action, the reward, the observation and the full state. It does not hold the
model, which is identified by versions and a fingerprint in `about`.
"""

import dataclasses
import json
from collections.abc import Callable, Mapping
from pathlib import Path

import dm_env
import mujoco
import numpy as np

from limberjack.recording.npz import read_arrays
from limberjack.report import Facts
from limberjack.rl.control import Environment, PhysicsError
from limberjack.rollout import OnStep, Step, run_episode
from limberjack.utils.files import replacing

__all__ = ["Recording", "Transcript", "record_episode", "replay"]

_STATE = mujoco.mjtState.mjSTATE_INTEGRATION.value
_START, _OBSERVATION = "start.", "observation."  # prefixes of array names


@dataclasses.dataclass(frozen=True)
class Recording:
    """An episode of T steps.

    Attributes:
      about: facts about the episode; values that JSON can represent.
      start: the episode's start, by name, as `Environment.snapshot().physics`.
      actions: (T, nu).
      rewards: (T,).
      states: MuJoCo's integration states at the start and after each step, (T + 1, nstate).
      observations: observations at the start and after each step, by name, (T + 1, ...).
    """

    about: Facts
    start: dict[str, np.ndarray]
    actions: np.ndarray
    rewards: np.ndarray
    states: np.ndarray
    observations: dict[str, np.ndarray]

    def save(self, path: Path) -> None:
        """Writes a compressed .npz atomically; on failure an existing file is unchanged."""
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
          ValueError: the file is not a recording.
        """
        try:
            arrays = read_arrays(path)
            about = json.loads(str(arrays.pop("about")))
            plain = {name: arrays.pop(name) for name in ("actions", "rewards", "states")}
            start, observations = _part(arrays, _START), _part(arrays, _OBSERVATION)
            recording = cls(about, start, **plain, observations=observations)
            _check_whole(recording)
        except (KeyError, RecursionError, ValueError) as error:
            raise ValueError(
                f"{path} is no recording of an episode ({error}); expected an episode-*.npz "
                "written by `limberjack solve --out`"
            ) from error
        return recording


class Transcript:
    """Collects the steps of an episode for a `Recording`.

    transcript = Transcript(environment)
    run_episode(environment, policy, seed, on_step=transcript.add)
    recording = transcript.recording({"domain": "humanoid", "task": "stand"})
    """

    def __init__(self, environment: Environment) -> None:
        """Begins a transcript of the environment's next episode."""
        self._environment = environment
        self._start: dict[str, np.ndarray] = {}
        self._actions: list[np.ndarray] = []
        self._rewards: list[float] = []
        self._states: list[np.ndarray] = []
        self._observations: list[dict[str, np.ndarray]] = []

    def add(self, step: Step) -> None:
        """Stores the reset or the step that the environment has just returned."""
        if step.action is None:
            self._start = self._environment.snapshot().physics
        else:
            self._actions.append(np.array(step.action))
            self._rewards.append(step.reward)
        self._states.append(_state(self._environment))
        observation = step.time_step.observation
        self._observations.append({name: np.array(value) for name, value in observation.items()})

    def recording(self, about: Mapping[str, object]) -> Recording:
        """The recording of all added steps, with the facts `about` it."""
        seen = self._observations
        return Recording(
            dict(about),
            self._start,
            np.array(self._actions),
            np.array(self._rewards),
            np.array(self._states),
            {name: np.stack([one[name] for one in seen]) for name in seen[0]},
        )


def record_episode(
    env: Environment,
    act: Callable[[], np.ndarray],
    about: Mapping[str, object],
    on_step: OnStep | None = None,
) -> Recording:
    """Runs the environment's next episode to its end and records it.

    Args:
      env: the environment, which is reset but not closed.
      act: returns the action for the environment's current state, like `Planner.act`.
      about: facts about the episode.
      on_step: called after the reset and after each step.
    """
    transcript = Transcript(env)

    def add(step: Step) -> None:
        transcript.add(step)
        if on_step is not None:
            on_step(step)

    # The seed is for policies that draw random numbers; `act` needs none.
    run_episode(env, lambda spec, seed: lambda observation: act(), seed=0, on_step=add)
    return transcript.recording(about)


def replay(recording: Recording, env: Environment, on_step: OnStep | None = None) -> str | None:
    """Replays a recording's actions from its start; returns the first difference, None if equal.

    Args:
      recording: a recording of the environment's task and model.
      env: the environment, whose state is replaced.
      on_step: called after the start and after each step.

    Raises:
      ValueError: the recording is of another task or model than the environment, or MuJoCo cannot
        simulate its start.
    """
    first = _begin(recording, env)
    total = 0.0
    if on_step is not None:
        on_step(Step(0, total, dm_env.restart(first), None))
    difference = _difference(
        recording.states[0], _state(env), "the start's state"
    ) or _observed_otherwise(recording, 0, first)
    for number, action in enumerate(recording.actions):
        if difference is not None:
            return difference
        where = f"step {number}: the"
        try:
            time_step = env.step(action)
        except PhysicsError as error:
            return f"{where} simulation diverges, and the recorded one does not: {error}"
        total += float(time_step.reward)
        if on_step is not None:
            on_step(Step(number + 1, total, time_step, action))
        difference = (
            _difference(recording.states[number + 1], _state(env), f"{where} state")
            or _difference(recording.rewards[number], time_step.reward, f"{where} reward")
            or _observed_otherwise(recording, number + 1, time_step.observation)
            or _ends_otherwise(recording, number, time_step.last())
        )
    return difference


def _begin(recording: Recording, env: Environment) -> Mapping[str, np.ndarray]:
    """Put the environment at the recording's start; what it observes there, without pictures."""
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
    try:
        env.restore(dataclasses.replace(own, physics=start))
    except PhysicsError as error:
        raise ValueError(f"the recording's start cannot be simulated: {error}") from error
    observed = env._observe(draws=False)
    return {name: np.asarray(value) for name, value in observed.items()}


def _observed_otherwise(
    recording: Recording, index: int, observation: Mapping[str, np.ndarray]
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


def _difference(recorded: np.ndarray, found: np.ndarray | float, what: str) -> str | None:
    if np.array_equal(recorded, found, equal_nan=True):
        return None
    if np.shape(recorded) != np.shape(found):
        return f"{what} has shape {np.shape(found)}; the recorded one has {np.shape(recorded)}"
    # As floats, which booleans and unsigned numbers can be subtracted as.
    gap = np.abs(np.asarray(recorded, float) - np.asarray(found, float)).max()
    return f"{what} differs from the recorded one by up to {gap:.3g}"


def _check_whole(recording: Recording) -> None:
    """Raise ValueError unless there are numbers of each kind for every step."""
    if not isinstance(recording.about, dict):
        raise ValueError(f"'about' is a {type(recording.about).__name__}; expected a dictionary")
    of_steps = {"actions": recording.actions, "rewards": recording.rewards}
    of_states = {"states": recording.states}
    of_states |= {_OBSERVATION + name: value for name, value in recording.observations.items()}
    starts = {_START + name: value for name, value in recording.start.items()}
    for name, value in {**of_steps, **of_states, **starts}.items():
        # Only observations may be true or false.
        kinds = "biuf" if name.startswith(_OBSERVATION) else "iuf"
        if value.dtype.kind not in kinds or not value.ndim:
            raise ValueError(
                f"{name!r} has dtype {value.dtype} and shape {value.shape}; expected numbers"
            )
    for name, value in {**starts, "actions": recording.actions, "states": recording.states}.items():
        if not np.isfinite(value).all():
            raise ValueError(f"{name!r} has infinities or NaN; expected finite numbers")
    if recording.rewards.ndim != 1:
        raise ValueError(f"'rewards' has shape {recording.rewards.shape}; expected one per step")
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
