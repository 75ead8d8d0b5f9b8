"""The speed of a task on a device: of the vector environment, and of MuJoCo Warp alone.

    speed = measure("humanoid", "walk", num_envs=4096, device="cuda:0")
    print(speed.steps_per_second, speed.ratio)

Both take turns, with equally many time steps. A step is one action of one environment. The first
steps, in which kernels are compiled, are not measured.
"""

import dataclasses
import statistics
import time
from collections.abc import Callable, Mapping

import numpy as np

from limberjack.gpu.backend import torch
from limberjack.gpu.vector import VectorEnv, load_vector
from limberjack.gpu.warp_simulation import bytes_per_row
from limberjack.rl.action_specs import bounds_to_try

__all__ = ["Speed", "measure"]

_WARM_UP_STEPS = 5  # not measured: kernels are compiled, and then recorded
_BLOCK = 10  # steps between two readings of the clock
_MIN_BLOCKS = 3


@dataclasses.dataclass(frozen=True)
class Speed:
    """The result of `measure`.

    Attributes:
      task: such as 'humanoid:walk'.
      device: its name, as the driver or the system reports it.
      num_envs: number of rows.
      steps_per_second: of all rows together.
      bare_steps_per_second: of MuJoCo Warp alone.
      ratio: of the two, the median over turns.
      bytes_per_row: memory that the simulation of a row takes.
      overflows: steps of rows whose contacts or constraints had no room.
    """

    task: str
    device: str
    num_envs: int
    steps_per_second: float
    bare_steps_per_second: float
    ratio: float
    bytes_per_row: int
    overflows: int


def measure(
    domain: str,
    task: str,
    num_envs: int = 4096,
    device: object = "cuda:0",
    seconds: float = 3.0,
    on_progress: Callable[[str, float], object] | None = None,
) -> Speed:
    """Measures how fast a task steps on a device, with random actions.

    Args:
      domain: such as 'humanoid'.
      task: such as 'walk'.
      num_envs: number of rows.
      device: see `load_vector`.
      seconds: approximate time of measuring, without compilation.
      on_progress: called between blocks of steps, with what is being done and the share of all that
        is done.

    Raises:
      ValueError: `seconds` is not positive; or see `load_vector`.
    """
    if not seconds > 0:
        raise ValueError(f"seconds is {seconds!r}; expected a positive number")
    report = on_progress or (lambda what, share: None)
    report("compiling kernels", 0.0)
    envs = load_vector(domain, task, num_envs, device=device, seed=0)
    envs.reset()
    players = {"environment": _environment(envs), "bare": _bare(envs)}
    for play in players.values():
        play(_WARM_UP_STEPS)
    taken: dict[str, list[float]] = {name: [] for name in players}
    begun = time.perf_counter()
    while (spent := time.perf_counter() - begun) < seconds or len(taken["bare"]) < _MIN_BLOCKS:
        report("measuring", min(spent / seconds, 1.0))
        for name, play in players.items():
            taken[name].append(_timed(play, envs))
    speed = _speed(f"{domain}:{task}", envs, taken)
    envs.close()
    return speed


def _speed(task: str, envs: VectorEnv, taken: Mapping[str, list[float]]) -> Speed:
    whole, bare = (statistics.median(taken[name]) for name in ("environment", "bare"))
    pairs = zip(taken["bare"], taken["environment"], strict=True)
    per_block = envs.num_envs * _BLOCK
    simulation = envs.batch.simulation
    return Speed(
        task,
        _name_of(envs.device),
        envs.num_envs,
        per_block / whole,
        per_block / bare,
        statistics.median(alone / both for alone, both in pairs),
        bytes_per_row(simulation.model, tuple(simulation.own), envs.batch.options.sizes),
        envs.overflows,
    )


def _environment(envs: VectorEnv) -> Callable[[int], None]:
    on_cpu = envs.batch.starts.batch
    low, high = bounds_to_try(envs.batch.task.action_spec(on_cpu.single))
    shape = (_BLOCK, *envs.action_shape)
    random = np.random.RandomState(0).uniform(low, high, shape).astype(np.float32)
    actions = torch.from_numpy(random).to(envs.device)

    def play(steps: int) -> None:
        for step in range(steps):
            envs.step(actions[step % _BLOCK])

    return play


def _bare(envs: VectorEnv) -> Callable[[int], None]:
    simulation, nstep = envs.batch.simulation, envs.batch.n_sub_steps

    def play(steps: int) -> None:
        with simulation.scope():
            for _ in range(steps):
                simulation.step_bare(nstep)

    return play


def _timed(play: Callable[[int], None], envs: VectorEnv) -> float:
    _wait(envs.device)
    begun = time.perf_counter()
    play(_BLOCK)
    _wait(envs.device)
    return time.perf_counter() - begun


def _wait(device: "torch.device") -> None:
    if device.type == "cuda":
        torch.cuda.synchronize(device)


def _name_of(device: "torch.device") -> str:
    return torch.cuda.get_device_name(device) if device.type == "cuda" else "the processor (Warp)"
