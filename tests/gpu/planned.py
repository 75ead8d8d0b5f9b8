"""Actions of the planner, in planned.npz: one task of each family with many contacts.

    python -m tests.gpu.planned     # lets the planner play again, and writes the file

They are rounded to float32, as on a device, before the planner's own environment takes them.
"""

from pathlib import Path

import numpy as np

from limberjack import suite
from limberjack.planner import Planner

__all__ = ["PLANNED", "actions_of"]

_FILE = Path(__file__).with_name("planned.npz")

# Seeds, and numbers of control steps: long enough to get up or walk, and to grasp an object.
PLANNED = {
    ("humanoid", "walk"): (1003, 160),
    ("manipulator", "bring_ball"): (1003, 200),
    ("quadruped", "walk"): (1003, 160),
    ("stacker", "stack_4"): (1003, 300),
}


def actions_of(domain: str, task: str) -> np.ndarray:
    """The actions of an episode's first steps, (T, nu) float32."""
    with np.load(_FILE) as recorded:
        return recorded[f"{domain}-{task}"]


def _played(domain: str, task: str, seed: int, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """The planner's actions, (T, nu), and their rewards, (T,)."""
    environment = suite.load(domain, task, {"random": seed})
    planner = Planner(environment, seed=seed)
    environment.reset()
    actions, rewards = [], []
    for _ in range(steps):
        actions.append(planner.act().astype(np.float32))
        rewards.append(environment.step(actions[-1]).reward)
    return np.array(actions), np.array(rewards)


def _main() -> None:
    recorded = {}
    for (domain, task), (seed, steps) in PLANNED.items():
        recorded[f"{domain}-{task}"], rewards = _played(domain, task, seed, steps)
        at_last = rewards[-steps // 10 :].mean()
        print(f"{domain}:{task}: reward {rewards.mean():.2f}, at last {at_last:.2f}", flush=True)
        np.savez_compressed(_FILE, **recorded)


if __name__ == "__main__":
    _main()
