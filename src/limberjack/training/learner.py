"""`Learner`: CrossQ of SBX on a `sb3.VecEnv`; needs the extra `train`.

    learner = Learner(envs, settings, seed=0, envs_seed=1000, folder=Path("events"))
    learner.learn(before_step)              # calls before_step() between two updates
    state = learner.state()                 # with `transitions`, all that its future depends on
    layers = learner.layers()               # of the deterministic policy

No other file imports sbx, jax or flax. JAX computes in one thread: networks of this size gain
nothing from more, and the same state then gives the same bits. JAX reads this setting when it is
first imported, so a program that imported it before keeps its own.
"""

import math
import os
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from limberjack.policies import mlp
from limberjack.training.settings import Settings
from limberjack.utils.requirements import missing_extra

if TYPE_CHECKING:
    from limberjack.sb3 import VecEnv

_ONE_THREAD = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"
os.environ.setdefault("XLA_FLAGS", _ONE_THREAD)

try:
    with warnings.catch_warnings():  # of these packages about one another
        warnings.simplefilter("ignore")
        import jax  # pyright: ignore[reportMissingImports]
        import sbx  # pyright: ignore[reportMissingImports]
        import tensorboard  # noqa: F401  # pyright: ignore[reportMissingImports] (used by SB3)
        from flax import serialization  # pyright: ignore[reportMissingImports]
        from stable_baselines3.common import (  # pyright: ignore[reportMissingImports]
            callbacks,
            logger,
        )
except ImportError as error:
    raise missing_extra("train") from error

__all__ = ["ALGORITHM", "Learner"]

ALGORITHM = "CrossQ"
_LOSSES = ("train/critic_loss", "train/actor_loss")
_COUNTERS = ("num_timesteps", "_n_updates", "_episode_num")
_ROWS = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")
_EPSILON = 0.001  # that SBX's BatchRenorm adds to a variance


class Learner:
    """The algorithm with its networks, optimisers, random streams and transitions."""

    def __init__(
        self, envs: "VecEnv", settings: Settings, seed: int, envs_seed: int, folder: Path
    ) -> None:
        """Makes a learner that has learned nothing.

        Args:
          envs: the rows, whose time limits truncate: the values of states after them count.
          settings: numbers of the algorithm.
          seed: of the networks, the exploration and the batches.
          envs_seed: of the first row.
          folder: of the events of TensorBoard.
        """
        self._envs = envs
        self._settings = settings
        jax.config.update("jax_platforms", "cpu")
        # Any: of a package without types.
        self._model: Any = sbx.CrossQ("MlpPolicy", envs, seed=seed, **_arguments(settings))
        envs.seed(envs_seed)  # the algorithm has given the rows its own seed
        self._events = logger.configure(str(folder), ["tensorboard"])
        self._model.set_logger(self._events)

    @property
    def actions_taken(self) -> int:
        """The actions so far, over all rows."""
        return self._model.num_timesteps

    def learn(self, before_step: Callable[[], None]) -> None:
        """Takes the actions of the run that are left, and learns from them.

        Args:
          before_step: called before all rows take a step, when the state is complete.
        """
        left = _actions(self._settings) - self.actions_taken
        if left > 0:
            self._model.learn(
                left, _Before(before_step), log_interval=None, reset_num_timesteps=False
            )

    def act(self, observations: np.ndarray) -> np.ndarray:
        """The actions without exploration, (N, ...), at observations, (N, size)."""
        actions, _ = self._model.predict(observations, deterministic=True)
        return actions

    def losses(self) -> dict[str, float]:
        """The last losses by name; empty before the first update."""
        found = self._events.name_to_value
        return {name: found[name] for name in _LOSSES if name in found}

    def record(self, name: str, value: float) -> None:
        """Keeps a value for TensorBoard, beside those of the algorithm."""
        self._events.record(name, value)

    def write_events(self, control_steps: int) -> None:
        """Writes the values since the last call, for TensorBoard."""
        self._events.dump(control_steps)

    def state(self) -> dict[str, object]:
        """Networks, optimisers, counters, random streams and the last observations."""
        model = self._model
        return {
            "networks": serialization.to_bytes(self._networks()),
            "keys": [np.asarray(key) for key in (model.key, *self._policy_keys())],
            "numpy": np.random.get_state(legacy=True),
            "actions": model.action_space.np_random.bit_generator.state,
            "counters": {name: getattr(model, name) for name in _COUNTERS},
            "observations": model._last_obs,
        }

    def restore(self, state: Mapping[str, Any]) -> None:  # Any: as `state` returns it
        """Continues from a state of a learner with the same settings."""
        model, policy = self._model, self._model.policy
        networks = serialization.from_bytes(self._networks(), state["networks"])
        policy.qf_state, policy.actor_state = networks["critic"], networks["actor"]
        model.ent_coef_state = networks["entropy"]
        model.key, policy.key, policy.noise_key = map(jax.numpy.asarray, state["keys"])
        np.random.set_state(state["numpy"])
        model.action_space.np_random.bit_generator.state = state["actions"]
        for name, value in state["counters"].items():
            setattr(model, name, value)
        model._last_obs = state["observations"]
        model._last_episode_starts = np.zeros(len(model._last_obs), bool)  # off-policy: unused

    def _networks(self) -> dict[str, object]:
        policy = self._model.policy
        entropy = self._model.ent_coef_state
        return {"critic": policy.qf_state, "actor": policy.actor_state, "entropy": entropy}

    def _policy_keys(self) -> tuple[object, object]:
        return self._model.policy.key, self._model.policy.noise_key

    @property
    def steps_kept(self) -> int:
        """The steps of all rows whose transitions were kept so far, overwritten ones included."""
        return self.actions_taken // self._envs.num_envs

    @property
    def capacity(self) -> int:
        """The steps of all rows that are kept at the same time."""
        return self._model.replay_buffer.buffer_size

    def transitions(self, first: int) -> dict[str, np.ndarray]:
        """The transitions of the steps from `first` on, (steps, num_envs, ...) by name."""
        at = np.arange(first, self.steps_kept) % self.capacity
        return {name: getattr(self._model.replay_buffer, name)[at] for name in _ROWS}

    def put_transitions(self, first: int, rows: Mapping[str, np.ndarray]) -> None:
        """Puts transitions back; `first` is the number of their first step."""
        kept = self._model.replay_buffer
        end = first + len(rows[_ROWS[0]])
        at = np.arange(first, end) % self.capacity
        for name in _ROWS:
            getattr(kept, name)[at] = rows[name]
        kept.pos, kept.full = end % self.capacity, end >= self.capacity

    def layers(self) -> list[mlp.Layer]:
        """The layers of the deterministic policy, with ReLU between them and tanh at the end.

        The batch normalisation before each of them is folded into it.
        """
        state = self._model.policy.actor_state
        return [
            mlp.folded(_dense(state, number), *_normalisation(state, number))
            for number in range(len(self._settings.actor) + 1)
        ]

    def close(self) -> None:
        """Writes the last events; the rows are not closed."""
        self._events.close()


def _actions(settings: Settings) -> int:
    """The actions of a run, over all rows."""
    return math.ceil(settings.steps / settings.action_repeat)


def _arguments(settings: Settings) -> dict[str, object]:
    """The settings under the names of the algorithm."""
    return {
        "learning_rate": settings.learning_rate,
        "buffer_size": min(settings.memory, _actions(settings) + settings.num_envs),
        "learning_starts": settings.random_steps,
        "batch_size": settings.batch_size,
        "gamma": settings.discount,
        "train_freq": 1,  # steps of all rows between updates
        "gradient_steps": max(1, round(settings.num_envs * settings.updates)),
        "policy_kwargs": {"net_arch": {"pi": [*settings.actor], "qf": [*settings.critic]}},
    }


# Any, here and below: a train state of flax.
def _dense(state: Any, number: int) -> mlp.Layer:
    """The weight, (out, in), and the bias of a layer."""
    layer = state.params[f"Dense_{number}"]
    return np.asarray(layer["kernel"]).T, np.asarray(layer["bias"])


def _normalisation(state: Any, number: int) -> tuple[np.ndarray, np.ndarray]:
    """The gain and the offset of the batch normalisation before a layer."""
    name = f"BatchRenorm_{number}"
    learned, measured = state.params[name], state.batch_stats[name]
    gain = np.asarray(learned["scale"], float)
    gain = gain / np.sqrt(np.asarray(measured["var"], float) + _EPSILON)
    return gain, np.asarray(learned["bias"], float) - np.asarray(measured["mean"], float) * gain


class _Before(callbacks.BaseCallback):
    """Calls a function before each step."""

    def __init__(self, function: Callable[[], None]) -> None:
        super().__init__()
        self._function = function

    def _on_rollout_start(self) -> None:
        self._function()

    def _on_step(self) -> bool:
        return True
