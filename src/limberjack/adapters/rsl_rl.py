"""`RslRlVecEnv`: a batch on a device with the interface of rsl_rl; needs the extra `rsl-rl`.

    from rsl_rl.runners import OnPolicyRunner

    envs = RslRlVecEnv(gpu.load_vector("humanoid", "walk", 4096, autoreset_mode="SameStep"))
    OnPolicyRunner(envs, settings, device="cuda:0").learn(1000)

A row whose episode has ended returns the first observation of its next one. `extras["time_outs"]`
marks those that the time limit ended, and `extras["log"]` has the means of the reward's terms.

No other file imports rsl_rl or tensordict.
"""

import math

from limberjack.gpu.backend import torch
from limberjack.gpu.vector import VectorEnv
from limberjack.utils.requirements import missing_extra

try:
    from rsl_rl.env import VecEnv  # pyright: ignore[reportMissingImports]
    from tensordict import TensorDict  # pyright: ignore[reportMissingImports]
except ImportError as error:
    raise missing_extra("rsl-rl") from error

__all__ = ["RslRlVecEnv"]

_GROUP = "policy"  # the name under which rsl_rl finds the observations


class RslRlVecEnv(VecEnv):
    """A vector environment with the interface of rsl_rl; see the module's docstring."""

    def __init__(self, envs: VectorEnv, clip_actions: float | None = 1.0) -> None:
        """Takes over a vector environment and begins its first episodes.

        Args:
          envs: flat, with `autoreset_mode="SameStep"`, and with a time limit.
          clip_actions: largest absolute value of an action; None for no limit. rsl_rl's policies
            draw from normal distributions.

        Raises:
          ValueError: its autoreset mode is another, its observations are not flat, or its episodes
            have no time limit.
        """
        if envs.metadata["autoreset_mode"].value != "SameStep" or not hasattr(
            envs.single_observation_space, "low"
        ):
            raise ValueError(
                f"{envs!r} does not fit rsl_rl: load it with autoreset_mode='SameStep', flat=True"
            )
        if envs.step_limit == float("inf"):
            raise ValueError(f"{envs!r} has no time limit, which rsl_rl needs: give time_limit")
        self.vector_env = envs
        self.num_envs = envs.num_envs
        self.num_actions = envs.action_shape[-1]
        self._repeat = envs.batch.options.action_repeat
        self.max_episode_length = math.ceil(envs.step_limit / self._repeat)
        self.device = envs.device
        self.cfg = {"task": repr(envs)}
        self._clip = clip_actions
        self._observations, _ = envs.reset()

    @property
    def episode_length_buf(self) -> torch.Tensor:
        """Actions since each row's episode began, (num_envs,)."""
        steps = self.vector_env.batch.counter.steps
        return steps if self._repeat == 1 else steps // self._repeat

    @episode_length_buf.setter
    def episode_length_buf(self, steps: torch.Tensor) -> None:
        self.vector_env.batch.counter.steps.copy_(steps * self._repeat)

    def get_observations(self) -> TensorDict:
        """The current observations, a `TensorDict`."""
        return TensorDict({_GROUP: self._observations}, batch_size=[self.num_envs])

    def step(
        self, actions: torch.Tensor
    ) -> tuple[TensorDict, torch.Tensor, torch.Tensor, dict[str, object]]:
        """Steps every row; returns observations, rewards, which episodes ended, and extras."""
        if self._clip is not None:
            actions = torch.clamp(actions, -self._clip, self._clip)
        self._observations, rewards, terminated, truncated, info = self.vector_env.step(actions)
        terms = info.get("reward_terms", {})
        log = {f"/{name}": each.mean() for name, each in terms.items() if name[0] != "_"}
        extras = {"time_outs": truncated, "log": log}
        return self.get_observations(), rewards, terminated | truncated, extras
