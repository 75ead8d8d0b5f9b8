"""`spec_of`: the specification from which Gymnasium makes an environment again, as JSON if needed.

spec = spec_of("humanoid", "walk", steps=200, flat=True)
env = gymnasium.make(spec)          # in any process: Gymnasium imports limberjack for it
text = spec.to_json()
"""

import copy

import gymnasium
from gymnasium.envs.registration import EnvSpec

__all__ = ["spec_of"]


def spec_of(domain: str, task: str, steps: int | None = None, **kwargs: object) -> EnvSpec:
    """The specification of a task's environment.

    Args:
      domain: such as 'humanoid'.
      task: such as 'walk'.
      steps: the length of its episodes; None for the id's own.
      kwargs: of `gym.load`.

    Raises:
      gymnasium.error.Error: there is no such id.
    """
    spec = copy.deepcopy(gymnasium.spec(f"limberjack/{domain}-{task}-v0"))
    spec.kwargs.update(kwargs)
    if steps is not None:
        spec.max_episode_steps = steps
    return spec
