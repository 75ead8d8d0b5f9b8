"""`load_vector`: a vector environment of a task, or of several tasks.

envs = gym.load_vector("humanoid", "walk", num_envs=256)
envs = gym.load_vector(["cheetah:run", "walker:walk"], rows=8)
envs = gym.load_vector("dmc28", rows=8)
"""

from collections.abc import Mapping, Sequence
from typing import Any

from limberjack import suite
from limberjack.gym import arguments
from limberjack.gym.many import ManyVectorEnv
from limberjack.gym.vector import VectorEnv
from limberjack.registry.sets import Tasks
from limberjack.rl.guards import at_least_one
from limberjack.utils.keywords import with_keywords

__all__ = ["load_vector"]


def load_vector(
    domain: Tasks,
    task: str | None = None,
    num_envs: int | None = None,
    *,
    rows: int | Sequence[int] | None = None,
    time_limit: float | None = None,
    task_kwargs: Mapping[str, object] | None = None,
    environment_kwargs: Mapping[str, object] | None = None,
    randomize: Mapping[str, object] | None = None,
    pixels: Mapping[str, object] | None = None,
    faults: str | Mapping[str, object] | None = None,
    appearance: str | Mapping[str, object] | None = None,
    num_threads: int | None = None,
    on_divergence: str = "end",
    vectorised: bool | None = None,
    action_repeat: int | None = None,
    stagger: bool = False,
    pipelined: bool = False,
    **kwargs: Any,  # of `VectorEnv`
) -> VectorEnv:
    """A vector environment of a task, or of several, which counts the steps of episodes itself.

    Args:
      domain: such as 'humanoid'; or several tasks: a list such as ['cheetah:run', 'walker:walk'],
        or the name of a set such as 'dmc28'. Then it is a `ManyVectorEnv`, and `flat` is True
        unless it is given.
      task: such as 'walk'; None with several tasks.
      num_envs: number of rows; of several tasks together, or give `rows`.
      rows: of each of several tasks: a number for all, or a list with one for each.
      time_limit: length of an episode, seconds; None for the task's own.
      task_kwargs: see `suite.load_batch`.
      environment_kwargs: see `suite.load_batch`.
      randomize: fields of the model to draw for each episode; see `limberjack.rl.randomize`.
      pixels: pictures to observe, such as {'camera': 0, 'frame_stack': 3}; see
        `limberjack.rl.pixels`.
      faults: of the real world, such as 'easy'; see `limberjack.worlds.faults`.
      appearance: of pictures, such as 'color_hard'; see `limberjack.worlds.appearance`.
      num_threads: threads that step the rows; by default as many of the available cores as the
        work of a step can occupy.
      on_divergence: see `suite.load_batch`.
      vectorised: False makes complete environments, with attributes of their own; see
        `suite.load_batch`.
      action_repeat: control steps per action, whose rewards are summed; see `suite.load_batch`.
      stagger: end the first episode of each row after a random number of steps; see
        `suite.load_batch`.
      pipelined: make two halves, for `send` and `recv`.
      kwargs: autoreset_mode, flat, dtype, copy, render_mode, render_kwargs, width, height,
        camera_id, camera_name: see `VectorEnv`.

    Raises:
      TypeError: an argument is unknown; the message suggests the nearest name.
    """
    arguments.refuse_unknown(kwargs, VectorEnv, load_vector)
    of_task = with_keywords("task_kwargs", task_kwargs, time_limit=time_limit)
    own = {"randomize": randomize, "pixels": pixels, "faults": faults, "appearance": appearance}
    of_environment = with_keywords("environment_kwargs", environment_kwargs, **own)
    how: dict[str, Any] = {  # Any: of `suite.load_batch`
        "num_threads": num_threads,
        "task_kwargs": of_task,
        "environment_kwargs": of_environment,
        "on_divergence": on_divergence,
        "vectorised": vectorised,
        "action_repeat": action_repeat,
        "stagger": stagger,
    }
    if task is None:
        kwargs = {"flat": True, **kwargs}
        how |= {"rows": rows, "num_envs": num_envs}
        if pipelined:
            return ManyVectorEnv(*suite.load_halves(domain, **how), **kwargs)
        return ManyVectorEnv(suite.load_batch(domain, **how), **kwargs)
    if not isinstance(domain, str) or num_envs is None or rows is not None:
        raise TypeError(
            f"domain is {domain!r}, task is {task!r}, num_envs is {num_envs}, rows is {rows}; "
            "expected a domain, a task and num_envs, or a list of tasks and rows"
        )
    batches = [suite.load_batch(domain, task, n, **how) for n in _sizes(num_envs, pipelined)]
    return VectorEnv(*batches, **kwargs)


def _sizes(num_envs: int, pipelined: bool) -> list[int]:
    """Numbers of rows of the batch, or of the halves."""
    num_envs = at_least_one("num_envs", num_envs)
    if pipelined and num_envs == 1:
        raise ValueError("num_envs is 1; expected at least 2 for two halves")
    return [num_envs - num_envs // 2, num_envs // 2] if pipelined else [num_envs]
