"""`Learner`: CrossQ of SBX on a `sb3.VecEnv`; needs the extra `train`.

    learner = Learner(envs, settings, seed=0, folder=Path("events"))
    learner.learn(before_step)              # calls before_step() between two updates
    state = learner.state()                 # all that its future depends on, besides the rows
    layers = learner.layers()               # of the averaged policy

`layers`, which act in evaluations and are written at the end, are an average of the latest
policies. Rows are explored with the present one.

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
from limberjack.training.demonstrations import Demonstrations
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
            buffers,
            logger,
            noise,
        )
except ImportError as error:
    raise missing_extra("train") from error

__all__ = ["Learner"]

_Tree = Any  # of JAX's arrays, or an object that has them: these packages have no types

_LOSSES = ("train/critic_loss", "train/actor_loss")
# Attributes of SB3's algorithm and of its buffer.
_COUNTERS = ("num_timesteps", "_n_updates", "_episode_num", "_last_obs", "_last_episode_starts")
_TRANSITIONS = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")
_WEIGHTS = ("params", "batch_stats")
# Gradient steps over which policies are averaged. Single policies of cartpole swingup had returns
# between 500 and 780 within 30,000 control steps, and their averages between 798 and 812.
_AVERAGED = 3000
_NOISY = 0.5  # share of a run until whose end the noise falls to 0
# Correlation of the noise with that of the action before: 1 / e after ten actions.
_KEPT = math.exp(-1 / 10)
_EPSILON = 0.001  # that SBX's BatchRenorm adds to a variance


class Learner:
    """The algorithm with its networks, optimisers, random streams and transitions."""

    def __init__(
        self,
        envs: "VecEnv",
        settings: Settings,
        seed: int,
        folder: Path,
        shown: Demonstrations | None = None,
    ) -> None:
        """Makes a learner that has learned nothing.

        Args:
          envs: the rows, whose time limits truncate: the values of states after them count.
          settings: numbers of the algorithm.
          seed: of the networks, the exploration and the batches; the rows are seeded with it too.
          folder: of the events of TensorBoard.
          shown: demonstrations, of which half of each batch is drawn; None for none.
        """
        self._envs = envs
        self._settings = settings
        jax.config.update("jax_platforms", "cpu")
        self._noise = _Noise((envs.num_envs, *envs.action_space.shape))
        noisy = {"action_noise": self._noise} if settings.noise else {}
        self._model: _Tree = sbx.CrossQ(
            "MlpPolicy", envs, seed=seed, **noisy, **_arguments(settings, shown)
        )
        self._average = _weights(self._model.policy.actor_state)
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
        self._take(0)  # begins episodes, unless they go on
        while self.actions_taken < _actions(self._settings):
            before_step()
            self.step()

    def step(self) -> None:
        """Takes one action in each row, and learns from them; begins episodes if none has begun."""
        self._add_to_average()
        done = self.actions_taken / _actions(self._settings)
        self._noise.std = self._settings.noise * max(0.0, 1 - done / _NOISY)
        self._take(self._envs.num_envs)

    def _take(self, actions: int) -> None:
        """Takes so many actions over all rows, and learns from them."""
        self._model.learn(actions, log_interval=None, reset_num_timesteps=False)

    def _add_to_average(self) -> None:
        """Adds the present policy to the average, in which older ones count less and less.

        Until there are enough policies all count the same, and the first one does not remain.
        """
        learned = self.actions_taken - self._settings.random_steps
        if learned > 0:
            steps = self._model.gradient_steps
            share = max(steps / _AVERAGED, self._envs.num_envs / learned)
            present = _weights(self._model.policy.actor_state)
            self._average = _mixed(self._average, present, np.float32(min(share, 1.0)))

    def losses(self) -> dict[str, float]:
        """The last losses by name; empty before the first update."""
        found = self._events.name_to_value
        return {name: found[name] for name in _LOSSES if name in found}

    def write_events(self, control_steps: int, mean: float, processor_seconds: float) -> None:
        """Writes an evaluation for TensorBoard, beside the last values of the algorithm."""
        self._events.record("evaluation/return", mean)
        self._events.record("evaluation/processor_seconds", processor_seconds)
        self._events.dump(control_steps)

    def state(self) -> dict[str, object]:
        """Networks, optimisers, transitions, counters, random streams and last observations."""
        model, buffer = self._model, self._model.replay_buffer
        return {
            "networks": serialization.to_bytes(self._networks()),
            "keys": [np.asarray(key) for key in self._keys()],
            "numpy": np.random.get_state(legacy=True),
            "actions": model.action_space.np_random.bit_generator.state,
            "counters": {name: getattr(model, name) for name in _COUNTERS},
            "transitions": {name: getattr(buffer, name)[: buffer.size()] for name in _TRANSITIONS},
            "place": (buffer.pos, buffer.full),
            "noise": self._noise.values,
        }

    def restore(self, state: Mapping[str, _Tree]) -> None:
        """Continues from a state of a learner with the same settings."""
        model, policy, buffer = self._model, self._model.policy, self._model.replay_buffer
        networks = serialization.from_bytes(self._networks(), state["networks"])
        policy.qf_state, policy.actor_state = networks["critic"], networks["actor"]
        model.ent_coef_state, self._average = networks["entropy"], networks["average"]
        model.key, policy.key, policy.noise_key = map(jax.numpy.asarray, state["keys"])
        np.random.set_state(state["numpy"])
        model.action_space.np_random.bit_generator.state = state["actions"]
        for name, value in state["counters"].items():
            setattr(model, name, value)
        for name, rows in state["transitions"].items():
            getattr(buffer, name)[: len(rows)] = rows
        buffer.pos, buffer.full = state["place"]
        self._noise.values = state["noise"]

    def _networks(self) -> dict[str, object]:
        policy = self._model.policy
        return {
            "critic": policy.qf_state,
            "actor": policy.actor_state,
            "average": self._average,
            "entropy": self._model.ent_coef_state,
        }

    def _keys(self) -> tuple[object, ...]:
        return self._model.key, self._model.policy.key, self._model.policy.noise_key

    def layers(self) -> list[mlp.Layer]:
        """The layers of the averaged policy, with ReLU between them and tanh at the end.

        The batch normalisation before each of them is folded into it.
        """
        learned, measured = (self._average[part] for part in _WEIGHTS)
        layers = []
        for number in range(len(self._settings.actor) + 1):
            dense, name = learned[f"Dense_{number}"], f"BatchRenorm_{number}"
            mean, var = measured[name]["mean"], measured[name]["var"]
            scale, bias = learned[name]["scale"], learned[name]["bias"]
            affine = mlp.affine(mean, var, _EPSILON, scale, bias)
            layers.append(mlp.folded((dense["kernel"].T, dense["bias"]), *affine))
        return layers

    def close(self) -> None:
        """Writes the last events; the rows are not closed."""
        self._events.close()


def _actions(settings: Settings) -> int:
    """The actions of a run, over all rows."""
    return math.ceil(settings.steps / settings.action_repeat)


def _arguments(settings: Settings, shown: Demonstrations | None) -> dict[str, _Tree]:
    """The settings under the names of the algorithm."""
    return {
        "learning_rate": settings.learning_rate,
        "buffer_size": min(settings.memory, _actions(settings) + settings.num_envs),
        "learning_starts": settings.random_steps,
        "batch_size": settings.batch_size,
        "gamma": settings.discount,
        "train_freq": 1,  # steps of all rows between updates
        "gradient_steps": round(settings.num_envs * settings.updates),
        "ent_coef": f"auto_{settings.entropy}",
        "policy_kwargs": {
            "net_arch": {"pi": [*settings.actor], "qf": [*settings.critic]},
            "n_critics": settings.critics,
        },
        "replay_buffer_class": _Transitions,
        "replay_buffer_kwargs": {"settings": settings, "shown": shown},
    }


def _weights(state: _Tree) -> dict[str, _Tree]:
    """The arrays that the actions of a policy depend on."""
    return {part: getattr(state, part) for part in _WEIGHTS}


@jax.jit
def _mixed(one: _Tree, other: _Tree, share: np.floating) -> _Tree:
    """Two trees of arrays, as one."""
    return jax.tree_util.tree_map(lambda x, y: x + share * (y - x), one, other)


class _Transitions(buffers.NStepReplayBuffer):  # pyright: ignore[reportUntypedBaseClass]
    """Transitions with rewards less an offset, and samples with sums of several of them.

    With demonstrations, these are half of each sample.
    """

    def __init__(
        self,
        size: int,
        observations: _Tree,
        actions: _Tree,
        *,
        settings: Settings,
        shown: Demonstrations | None = None,
        **kwargs: _Tree,
    ) -> None:
        steps = {"n_steps": settings.n_steps, "gamma": settings.discount}
        super().__init__(size, observations, actions, **steps, **kwargs)
        self._offset = np.float32(settings.reward_offset * settings.action_repeat)
        self._shown: _Transitions | None = None
        if shown is not None:
            how = {"settings": settings, **kwargs, "n_envs": 1}
            self._shown = _Transitions(len(shown.rewards), observations, actions, **how)
            self._shown._fill(shown)

    def _fill(self, shown: Demonstrations) -> None:
        """Takes demonstrations, as many as have room, in the place of all transitions."""
        low, high = self.action_space.low, self.action_space.high
        self.observations[:, 0] = shown.observations
        self.next_observations[:, 0] = shown.next_observations
        self.actions[:, 0] = 2 * (shown.actions - low) / (high - low) - 1  # as those of the policy
        self.rewards[:, 0] = shown.rewards - self._offset
        self.dones[:, 0], self.timeouts[:, 0] = shown.is_last, shown.is_truncated
        self.full = True

    def sample(self, batch_size: int, env: _Tree = None) -> _Tree:
        if self._shown is None:
            return super().sample(batch_size, env)
        half = batch_size // 2
        both = super().sample(batch_size - half, env), self._shown.sample(half, env)
        order = np.random.permutation(batch_size)  # the batches of a call are parts of the sample
        fields = (np.concatenate([part.numpy() for part in of]) for of in zip(*both, strict=True))
        return type(both[0])(*(self.to_torch(field[order]) for field in fields))

    def add(self, obs: _Tree, next_obs: _Tree, action: _Tree, reward: _Tree, *more: _Tree) -> None:
        super().add(obs, next_obs, action, reward - self._offset, *more)


class _Noise(noise.VectorizedActionNoise):  # pyright: ignore[reportUntypedBaseClass]
    """Noise that is added to actions between -1 and 1, and changes slowly: a process of order 1.

    It draws from NumPy's global stream, as the algorithm does.
    """

    def __init__(self, shape: tuple[int, ...]) -> None:
        self.values = np.zeros(shape)
        self.std = 0.0

    def __call__(self) -> np.ndarray:
        drawn = np.random.normal(0, self.std, self.values.shape)
        self.values = _KEPT * self.values + math.sqrt(1 - _KEPT**2) * drawn
        return self.values

    def reset(self, indices: list[int] | None = None) -> None:
        """Begins again in some rows; not in all, which SB3 asks for whenever learning goes on."""
        if indices is not None:
            self.values[indices] = 0
