"""Tasks on a device beside the CPU: the figures that the tests bound and docs/gpu.md shows.

    python -m tests.gpu.compared [DOMAIN:TASK ...]      # prints a table, row by row

Long runs are never compared: chaos separates them. Each control step begins from equal states.
"""

import dataclasses
import sys
from typing import Any

import numpy as np

from limberjack import gpu, suite
from limberjack.gpu.starts import Part
from limberjack.rl.action_specs import bounds_to_try
from limberjack.rl.batch import BatchEnvironment

__all__ = ["ROWS", "STEPS", "SUPPORTED", "Figures", "compared", "copy_to_device", "loaded"]

ROWS, STEPS = 64, 16  # 1,024 control steps
# Figures in the table of docs/gpu.md, with the headings of its columns.
_SHOWN = {
    "first": "observation after a step from the start, median",
    "median": "observation along the episode, median",
    "p90": "the same, 90th percentile",
    "reward": "reward, 99th percentile",
}
SUPPORTED = [task for task in suite.tasks() if task not in gpu.REFUSED]


@dataclasses.dataclass(frozen=True)
class Figures:
    """Differences between a device and the CPU.

    Attributes:
      start: the largest excess of an observation's difference at the starts over 1e-6 + 1e-5 of its
        value.
      first: the median difference of an observation after a control step from the starts.
      first_reward: the median difference of the reward after it.
      median, p90: of an observation's difference after a control step, along an episode.
      reward: the 99th percentile of the reward's difference along an episode.
      flips: the share of rewards that differ by more than a half.
      overflows: steps of rows whose contacts or constraints had no room.
      endings: the number of rows whose episode ended on one of the two alone.
    """

    start: float
    first: float
    first_reward: float
    median: float
    p90: float
    reward: float
    flips: float
    overflows: int
    endings: int


def loaded(domain: str, task: str, num_envs: int = ROWS, **kwargs: Any) -> Any:
    """The vector environment on Warp's CPU device, with a dict of observations."""
    return gpu.load_vector(domain, task, num_envs, device="cpu", seed=0, flat=False, **kwargs)


def compared(domain: str, task: str) -> Figures:
    """Plays an episode on the CPU, and each of its steps on the device too."""
    envs = loaded(domain, task)
    batch = suite.load_batch(domain, task, ROWS, 1, seed=0)
    expected = batch.reset()
    found, _ = envs.reset()
    start = _excess(found, expected.observation)
    spec, random = batch.action_spec(), np.random.RandomState(1)
    observations, rewards, endings = [], [], 0
    for step in range(STEPS):
        if step:
            copy_to_device(batch, envs)
        action = random.uniform(*bounds_to_try(spec)).astype(np.float32)
        expected = batch.step(action)
        found, reward, terminated, truncated, _ = envs.step(_tensor(action))
        observations.append(_differences(found, expected.observation))
        rewards.append(abs(reward.numpy() - expected.reward))
        ended = (terminated | truncated).numpy()
        endings += int((ended != (expected.step_type == 2)).sum())
    errors, of_rewards = np.concatenate(observations), np.concatenate(rewards)
    figures = Figures(
        start,
        float(np.median(observations[0])),
        float(np.median(rewards[0])),
        float(np.median(errors)),
        float(np.percentile(errors, 90)),
        float(np.percentile(of_rewards, 99)),
        float((of_rewards > 0.5).mean()),
        envs.overflows,
        endings,
    )
    envs.close()
    batch.close()
    return figures


def copy_to_device(batch: BatchEnvironment, envs: Any) -> None:
    """Writes the states of a batch on the CPU into the rows of a vector environment."""
    on_device = envs.batch
    rows = np.zeros((envs.num_envs, on_device.starts.width), np.float32)
    for part in on_device.starts.parts:
        rows[:, part.columns] = _field(batch, part).reshape(envs.num_envs, -1)
    state = envs.state_dict()
    state["rows"] = _tensor(rows)
    state["steps"] = _tensor(batch._counter.steps)
    envs.load_state_dict(state)


def _field(batch: BatchEnvironment, part: Part) -> np.ndarray:
    simulation = batch.physics.simulation
    if part.kind != "model":
        return np.asarray(simulation.data_field(part.name)[0])
    own = simulation.own_fields
    return np.asarray(
        own[part.name][:] if part.name in own else simulation.model_field(part.name)[0]
    )


def _tensor(values: np.ndarray) -> Any:
    from limberjack.gpu.backend import torch

    return torch.from_numpy(np.ascontiguousarray(values))


def _differences(found: Any, expected: Any) -> np.ndarray:
    """Absolute differences of all observations, one after the other."""
    parts = [abs(found[name].numpy() - expected[name]).ravel() for name in expected]
    return np.concatenate(parts)


def _excess(found: Any, expected: Any) -> float:
    """The largest excess of a difference over 1e-6 + 1e-5 of the value; 0 if there is none."""
    excess = [0.0]
    for name, values in expected.items():
        excess.append(float((abs(found[name].numpy() - values) - 1e-6 - 1e-5 * abs(values)).max()))
    return max(excess)


def _main(names: list[str]) -> None:
    """Prints the table of docs/gpu.md, row by row, and at last the largest of all figures."""
    chosen = [tuple(name.split(":")) for name in names] or SUPPORTED
    print("|", " | ".join(("task", *_SHOWN.values())), "|")
    print("|---" * (1 + len(_SHOWN)) + "|")
    most = dict.fromkeys((field.name for field in dataclasses.fields(Figures)), 0.0)
    for domain, task in chosen:
        figures = dataclasses.asdict(compared(domain, task))
        shown = (_short(figures[name]) for name in _SHOWN)
        print("|", " | ".join((f"{domain} {task}", *shown)), "|", flush=True)
        most = {name: max(value, figures[name]) for name, value in most.items()}
    print("\nat most:", ", ".join(f"{name} {_short(value)}" for name, value in most.items()))


def _short(value: float) -> str:
    return f"{value:.1e}".replace("e-0", "e-") if value else "0"


if __name__ == "__main__":
    _main(sys.argv[1:])
