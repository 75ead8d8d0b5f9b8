"""`ManyVectorEnv`: several tasks as one `gymnasium.vector.VectorEnv`.

    envs = gym.load_vector(["cheetah:run", "walker:walk"], rows=8)
    observations, info = envs.reset(seed=0)         # (16, 24): zeros after a task's own numbers
    actions = policy(observations, envs.task_ids)   # (16, 6)
    observations, rewards, terminated, truncated, info = envs.step(actions)
    envs.tasks[1].instruction                       # 'Walk forward at 1 m/s or more.'
    envs.statistics()["walker:walk"].mean_return

Rows, arrays and masks are those of `limberjack.rl.many`. With `flat=False` an observation is a dict
with the masks and the task's number beside the padded array, for policies that take them as inputs.
The entries of an info have masks of the rows whose task has them.
"""

import numpy as np

from limberjack.gym.vector import VectorEnv, joined
from limberjack.rl.many import ManyTasks, TaskOfMany, TaskStatistics

__all__ = ["ManyVectorEnv"]


class ManyVectorEnv(VectorEnv):
    """Several tasks; see the module's docstring and `VectorEnv`."""

    batches: tuple[ManyTasks, ...]

    @property
    def tasks(self) -> tuple[TaskOfMany, ...]:
        """The facts of each task, with its rows."""
        return self.batches[0].tasks

    @property
    def task_ids(self) -> np.ndarray:
        """The number in `tasks` of each row's task, (num_envs,)."""
        return self._of_rows([batch.task_ids for batch in self.batches])

    @property
    def observation_mask(self) -> np.ndarray:
        """Which numbers of the padded array belong to a row's task, (num_envs, D)."""
        return self._of_rows([batch.observation_mask for batch in self.batches])

    @property
    def action_mask(self) -> np.ndarray:
        """Which numbers of actions the row's task takes, (num_envs, A)."""
        return self._of_rows([batch.action_mask for batch in self.batches])

    def statistics(self) -> dict[str, TaskStatistics]:
        """The statistics of the finished episodes, by task; see `TaskStatistics`."""
        self._check_idle()
        first, *others = (batch.statistics() for batch in self.batches)
        for more in others:
            for name, of_task in more.items():
                first[name] = of_task + first[name] if name in first else of_task
        return first

    def clear_statistics(self) -> None:
        """Begins new statistics; episodes that are running are not among them."""
        self._check_idle()
        for batch in self.batches:
            batch.clear_statistics()

    def _of_rows(self, parts: list[np.ndarray]) -> np.ndarray:
        return joined(parts, [batch.num_envs for batch in self.batches])
