"""`Counter`: the steps of each row's episode on a device, and how its episode ends.

    counter = Counter(num_envs=4096, step_limit=1000, device="cuda:0")
    reward, ending = counter.count(begun, diverged, reward, termination)

The rules are those of `limberjack.rl.endings`, written without waiting for the device.
"""

import dataclasses

from limberjack.gpu.backend import torch

__all__ = ["Counter", "Ending"]

# Tensors in this module are of (num_envs,).


@dataclasses.dataclass(frozen=True)
class Ending:
    """Masks of the rows whose episode ends.

    Attributes:
      last: for any reason.
      terminated: because of the task or divergence.
      truncated: because of the time limit.
    """

    last: torch.Tensor
    terminated: torch.Tensor
    truncated: torch.Tensor


class Counter:
    """See the module's docstring.

    Attributes:
      steps: control steps of each row's episode so far.
      terminated, truncated: masks of the rows whose last episode ended so; False again once a row
        begins another one.
    """

    def __init__(self, num_envs: int, step_limit: float, device: torch.device | str) -> None:
        self.step_limit = step_limit
        self.steps = torch.zeros(num_envs, dtype=torch.int64, device=device)
        self.terminated = torch.zeros(num_envs, dtype=torch.bool, device=device)
        self.truncated = self.terminated.clone()

    @property
    def ended(self) -> torch.Tensor:
        """Mask of the rows whose episode has ended and that have not begun another one."""
        return self.terminated | self.truncated

    def begin(self, rows: torch.Tensor) -> None:
        """Begins an episode in the rows of a mask."""
        self.steps.masked_fill_(rows, 0)
        self.terminated.logical_and_(~rows)
        self.truncated.logical_and_(~rows)

    def count(
        self,
        begun: torch.Tensor,
        diverged: torch.Tensor,
        reward: torch.Tensor,
        termination: torch.Tensor | None,
    ) -> tuple[torch.Tensor, Ending]:
        """Counts a step; returns the reward to report, and which episodes end.

        A row whose episode ended in an earlier step reports the same ending in every step until it
        begins another episode.

        Args:
          begun: rows that began an episode in this step.
          diverged: rows that diverged.
          reward: the task's reward.
          termination: the task's termination, NaN where an episode continues; None for no rows.
        """
        self.begin(begun)
        waits = self.ended
        runs = ~begun & ~waits
        self.steps.add_(runs)
        at_limit = (self.steps >= self.step_limit) & runs & ~diverged
        ends = diverged & runs
        if termination is not None:
            ends = ends | (~torch.isnan(termination) & runs & ~at_limit)
        self.truncated.logical_or_(at_limit)
        self.terminated.logical_or_(ends)
        silent = begun | waits | diverged
        reward = torch.where(silent, torch.zeros_like(reward), reward)
        return reward, Ending(self.ended, self.terminated.clone(), self.truncated.clone())
